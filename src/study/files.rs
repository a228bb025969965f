//! The files of a study: a JSON file, a table, and the figure.

use crate::base::disk;
use crate::base::error::Result;
use crate::problem::exported::ExportOwner;
use crate::results::figure::Figure;
use serde::Serialize;
use std::path::Path;

/// The endings of the files of a study, whose names are that of the study.
const ENDINGS: [&str; 4] = ["json", "csv", "svg", "png"];

/// The results of a study with the case that owns them.
#[derive(Serialize)]
struct OwnedStudy<'s, S> {
    #[serde(flatten)]
    owner: &'s ExportOwner,
    #[serde(flatten)]
    found: &'s S,
}

/// Refuses to replace the files of a study of another case in `directory`, and files of the same
/// names that no study wrote. On one rank.
///
/// # Errors
/// As [`ExportOwner::refuse_to_replace`].
pub fn refuse_to_replace_study(directory: &Path, owner: &ExportOwner) -> Result<()> {
    let name = owner.export.word();
    owner.refuse_to_replace(directory, &ENDINGS.map(|ending| format!("{name}.{ending}")))
}

/// Writes what a study `found` into `directory`: NAME.json with the owner, the `table` as NAME.csv,
/// and the figure as NAME.svg and NAME.png. On one rank.
///
/// # Errors
/// [`crate::base::error::Error::Output`].
pub fn write_study(
    directory: &Path,
    owner: &ExportOwner,
    found: &impl Serialize,
    table: &str,
    figure: &Figure,
) -> Result<()> {
    let name = owner.export.word();
    let at = |ending: &str| directory.join(format!("{name}.{ending}"));
    disk::write_json(&at("json"), &OwnedStudy { owner, found })?;
    disk::write_text(&at("csv"), table)?;
    figure.write(directory, &name)?;
    Ok(())
}
