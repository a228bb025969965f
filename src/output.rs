//! What a run leaves behind: `result.h5`, written by all ranks, and `summary.json`.

pub mod hdf5;
pub mod summary;

use crate::communicator::Group;
use crate::error::{Error, Result};
use std::path::Path;

/// Makes the output directory and makes sure that it can be written, before anything is computed. Collective.
///
/// # Errors
/// [`Error::Output`].
pub fn prepare(world: &Group, directory: &Path) -> Result<()> {
    let attempt = || -> std::io::Result<()> {
        std::fs::create_dir_all(directory)?;
        let probe = directory.join(".phasewarp-can-write");
        std::fs::write(&probe, b"")?;
        std::fs::remove_file(&probe)
    };
    let result = if world.rank() == 0 {
        attempt().map_err(|e| failure(directory, &e))
    } else {
        Ok(())
    };
    world.agree(result)
}

/// An [`Error::Output`] about `path`.
fn failure(path: &Path, reason: &dyn std::fmt::Display) -> Error {
    Error::Output {
        path: path.to_owned(),
        reason: reason.to_string(),
    }
}
