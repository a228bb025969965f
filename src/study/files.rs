//! The files of a study: a JSON file, a table, and the figure.

use crate::base::disk;
use crate::base::error::Result;
use crate::results::figure::Figure;
use serde::Serialize;
use std::path::Path;

/// The files of a study.
pub struct StudyFiles<'a, T> {
    /// Name of the files, without an ending.
    pub name: &'a str,
    /// The result, for the JSON file.
    pub found: &'a T,
    /// The CSV file.
    pub table: String,
    /// The figure.
    pub figure: Figure,
}

impl<T: Serialize> StudyFiles<'_, T> {
    /// Writes NAME.json, NAME.csv, NAME.svg and NAME.png into `directory`. On one rank.
    ///
    /// # Errors
    /// [`crate::base::error::Error::Output`].
    pub fn write(self, directory: &Path) -> Result<()> {
        let at = |ending: &str| directory.join(format!("{}.{ending}", self.name));
        disk::write_json(&at("json"), self.found)?;
        disk::write_text(&at("csv"), &self.table)?;
        self.figure.write(directory, self.name)?;
        Ok(())
    }
}
