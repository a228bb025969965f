//! The files of a study: a JSON file, a table, and the figure.

use crate::base::disk;
use crate::base::error::Result;
use crate::results::figure::Figure;
use serde::Serialize;
use std::path::Path;

/// Writes what a study `found` into `directory`: NAME.json, the `table` as NAME.csv, and the figure
/// as NAME.svg and NAME.png. On one rank.
///
/// # Errors
/// [`crate::base::error::Error::Output`].
pub fn write_study(
    directory: &Path,
    name: &str,
    found: &impl Serialize,
    table: &str,
    figure: &Figure,
) -> Result<()> {
    let at = |ending: &str| directory.join(format!("{name}.{ending}"));
    disk::write_json(&at("json"), found)?;
    disk::write_text(&at("csv"), table)?;
    figure.write(directory, name)?;
    Ok(())
}
