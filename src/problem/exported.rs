//! `description.json` of an export or of pictures, and the JSON file of a study, say which case the
//! files in a directory belong to. Files of another case are not replaced unless the user asks for
//! it.

use crate::base::disk;
use crate::base::error::Result;
use crate::base::text::choice_text;
use crate::problem::case::{Settings, differing_setting};
use serde::{Deserialize, Serialize};
use std::path::Path;

/// File name of the description.
pub const DESCRIPTION: &str = "description.json";

/// The kind of files in a directory.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum ExportKind {
    /// Matrices and vectors.
    Matrix,
    /// States, `H` and circuits.
    Quantum,
    /// A block encoding of `H` as gates.
    Circuit,
    /// Pictures and movies of a run.
    Pictures,
    /// Accuracy against cost, method by method.
    Chart,
    /// Limits beyond which methods fail.
    Stability,
}

impl ExportKind {
    /// The name of the kind in messages and directories.
    pub fn word(self) -> String {
        choice_text(&self)
    }

    /// The name of the file that says to which case the files belong, and what the files are, in
    /// messages.
    fn description_and_noun(self) -> [&'static str; 2] {
        match self {
            Self::Matrix | Self::Quantum | Self::Circuit | Self::Pictures => {
                [DESCRIPTION, "export"]
            }
            Self::Chart => ["chart.json", "chart"],
            Self::Stability => ["stability.json", "stability study"],
        }
    }
}

/// The case that an export belongs to.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct ExportOwner {
    /// The kind of export.
    pub export: ExportKind,
    /// Every setting of the case, by key.
    pub settings: Settings,
}

impl ExportOwner {
    /// The owner of an export of the case with these `settings`.
    pub fn new(export: ExportKind, settings: &Settings) -> Self {
        Self { export, settings: settings.clone() }
    }

    /// Refuses to replace, in `directory`, an export of another case or another kind, and files
    /// called `names` that no description claims. Only one rank calls it.
    ///
    /// # Errors
    /// [`crate::base::error::Error::Directory`].
    pub fn refuse_to_replace(&self, directory: &Path, names: &[String]) -> Result<()> {
        let there = |name: &str| disk::is_taken(&directory.join(name));
        let [description, noun] = self.export.description_and_noun();
        let what = if there(description) {
            match self.read(directory) {
                None => format!("a {description} that no {noun} wrote"),
                Some(owner) if owner.export != self.export => {
                    format!("an export of another kind, \"{}\"", owner.export.word())
                }
                Some(owner) => match differing_setting(&owner.settings, &self.settings) {
                    None => return Ok(()),
                    Some(what) => format!("the {noun} of another case: {what}"),
                },
            }
        } else {
            match names.iter().find(|name| there(name)) {
                None => return Ok(()),
                Some(name) => format!("{name} without a {description} beside it"),
            }
        };
        Err(disk::not_replaced(directory, &what))
    }

    /// The owner that the description in `directory` names.
    fn read(&self, directory: &Path) -> Option<Self> {
        let [description, _] = self.export.description_and_noun();
        serde_json::from_str(&disk::read_text(&directory.join(description)).ok()?).ok()
    }
}

/// Writes the description of an export. It is the last file of an export, so that it describes a
/// complete one.
///
/// # Errors
/// [`crate::base::error::Error::Output`].
pub fn write(directory: &Path, description: &impl Serialize) -> Result<()> {
    disk::write_json(&directory.join(DESCRIPTION), description)
}
