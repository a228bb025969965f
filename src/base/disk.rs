//! Output directories, and errors about them.

use crate::base::error::{Error, Result};
use std::path::Path;

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

pub(crate) fn refused(directory: &Path, why: &std::io::Error) -> Error {
    Error::Directory { path: directory.to_owned(), reason: why.to_string() }
}

/// An [`Error::Output`] about `path`.
pub(crate) fn failure(path: &Path, reason: &dyn std::fmt::Display) -> Error {
    Error::Output { path: path.to_owned(), reason: reason.to_string() }
}
