//! What a run leaves behind: `result.h5`, written by all ranks, `fields.xdmf` and `summary.json`.

pub mod checksum;
pub mod finished;
pub mod hdf5;
pub mod history;
pub mod provenance;
pub mod readback;
pub mod summary;
pub mod views;
pub mod warped;
pub mod writer;
pub mod xdmf;

use crate::case::Case;
use crate::communicator::Group;
use crate::error::{Error, Result};
use std::path::Path;

/// Makes the output directory and makes sure that it can be written and has room, before anything is computed. Collective.
///
/// # Errors
/// [`Error::Directory`].
pub fn prepare(world: &Group, directory: &Path, case: &Case) -> Result<()> {
    let attempt = || -> std::io::Result<()> {
        let warped = warped::names(case);
        let names = ["result.h5", xdmf::NAME, "summary.json", "readout.csv"];
        for name in names.into_iter().chain(warped.iter().map(String::as_str)) {
            if directory.join(name).is_dir() {
                return Err(std::io::Error::other(format!(
                    "{name} in it is a directory"
                )));
            }
        }
        Ok(())
    };
    let result = if world.rank() == 0 {
        make(directory)
            .and_then(|()| attempt().map_err(|e| refused(directory, &e)))
            .and_then(|()| hdf5::enough_room(directory, case))
    } else {
        Ok(())
    };
    world.agree(result)
}

/// Makes `directory` and makes sure that it can be written. On one rank.
///
/// # Errors
/// [`Error::Directory`].
pub fn make(directory: &Path) -> Result<()> {
    let probe = directory.join(".phasewarp-can-write");
    std::fs::create_dir_all(directory)
        .and_then(|()| std::fs::write(&probe, b""))
        .and_then(|()| std::fs::remove_file(&probe))
        .map_err(|e| refused(directory, &e))
}

fn refused(directory: &Path, why: &std::io::Error) -> Error {
    Error::Directory {
        path: directory.to_owned(),
        reason: why.to_string(),
    }
}

/// An [`Error::Output`] about `path`.
pub(crate) fn failure(path: &Path, reason: &dyn std::fmt::Display) -> Error {
    Error::Output {
        path: path.to_owned(),
        reason: reason.to_string(),
    }
}
