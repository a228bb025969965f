//! Support for all modules: errors, text, tables, log lines, directories, the machine, checksums,
//! quadrature, piecewise polynomials, fixed-point sums.
//!
//! [`error::Error`] is the error of every module.
//!
//! Uses: no other module. Paper: none.

pub mod bisect;
pub mod checksum;
pub mod disk;
pub mod error;
pub mod fixed_point;
pub mod lock;
pub mod log;
pub mod machine;
pub mod memory;
pub mod piecewise;
pub mod progress;
pub mod quadrature;
pub mod random;
pub mod refusal;
pub mod row_major;
pub mod stopwatch;
pub mod table;
pub mod text;
pub mod version;
