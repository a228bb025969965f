//! phasewarp
pub mod case;
mod case_file;
pub mod error;
pub mod expression;
pub mod grid;
pub mod potential;
pub mod scheme;
