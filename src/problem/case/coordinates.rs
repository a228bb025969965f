//! The names of coordinates in the formulas of a case.
//!
//! Uses file (the formula of a key), reader.

use crate::base::error::Result;
use crate::problem::case::file::CaseFile;
use crate::problem::case::reader::Formula;
use crate::problem::formula::Expression;
use crate::problem::grid::MAX_DIMENSION;
use crate::problem::limits::COORDINATES;

/// Position of `t` among the coordinates `[x, y, z, vx, vy, vz, t]` of a formula.
pub const TIME: usize = COORDINATES - 1;

/// The names by which a formula may use each of the coordinates `[x, y, z, vx, vy, vz, t]`.
pub type Names = [&'static [&'static str]; COORDINATES];

/// Names of the coordinates of space.
pub(super) fn names_of_space(n: usize) -> Names {
    let space: Names = [&["x"], &["y"], &["z"], &[], &[], &[], &[]];
    std::array::from_fn(|a| if a < n { space[a] } else { &[] })
}

/// Names of the coordinates of phase space.
pub(super) fn names_of_phase_space(n: usize) -> Names {
    let mut names = names_of_space(n);
    let velocities: [&[&str]; MAX_DIMENSION] = [&["vx"], &["vy"], &["vz"]];
    names[3..3 + n].copy_from_slice(&velocities[..n]);
    if n == 1 {
        names[3] = &["v", "vx"];
    }
    names
}

/// Names of the coordinates of phase space, and of time.
pub(super) fn names_with_time(n: usize) -> Names {
    let mut names = names_of_phase_space(n);
    names[TIME] = &["t"];
    names
}

/// The formula of `key`, if it is given.
pub(super) fn formula(
    file: &CaseFile<'_>,
    key: &str,
    text: &Option<Formula>,
    names: &Names,
) -> Result<Option<Expression>> {
    let text = text.as_ref();
    text.map(|Formula(text)| file.formula(key, text, names)).transpose()
}

/// The formula of `key`, which must be given.
pub(super) fn required_formula(
    file: &CaseFile<'_>,
    key: &str,
    text: &Option<Formula>,
    names: &Names,
) -> Result<Expression> {
    file.required(key, formula(file, key, text, names)?, "a formula")
}
