//! Output directories, files that are written whole or not at all, and errors about both.

use crate::base::error::{Error, Result};
use crate::base::machine;
use crate::base::text::{bytes_text, visible};
use std::ffi::OsString;
use std::fs::File;
use std::io::{self, ErrorKind, Write};
use std::path::{Path, PathBuf};

/// Makes `directory` and makes sure that it can be written. On one rank.
///
/// # Errors
/// [`Error::Directory`].
pub fn make(directory: &Path) -> Result<()> {
    let probe = directory.join(format!(".phasewarp-can-write-{}", std::process::id()));
    std::fs::create_dir_all(directory)
        .and_then(|()| clear(&probe))
        .and_then(|()| File::create_new(&probe))
        .and_then(|_| std::fs::remove_file(&probe))
        .map_err(|e| refused(directory, &e))
}

/// The name that the file `path` has while it is written: its own, and `.partial`.
pub(crate) fn partial(path: &Path) -> PathBuf {
    let mut name = OsString::from(path);
    name.push(".partial");
    name.into()
}

/// Removes the file or the link at `path` that an earlier run left; the target of a link stays. A
/// path without a file is no error.
pub(crate) fn clear(path: &Path) -> io::Result<()> {
    match std::fs::remove_file(path) {
        Err(e) if e.kind() != ErrorKind::NotFound => Err(e),
        _ => Ok(()),
    }
}

/// Writes the file `path` under another name, flushes it to disk and renames it: an older file
/// stays whole until then, and nothing stays of a file that could not be written.
///
/// # Errors
/// [`Error::Output`].
pub fn write(path: &Path, bytes: &[u8]) -> Result<()> {
    write_with(path, |file| file.write_all(bytes))
}

/// As [`write`], with the contents that `fill` writes into the file.
///
/// # Errors
/// [`Error::Output`].
pub fn write_with(path: &Path, fill: impl FnOnce(&mut File) -> io::Result<()>) -> Result<()> {
    let partial = partial(path);
    let written = clear(&partial).and_then(|()| {
        // Exclusively: nothing that someone puts there meanwhile is followed or overwritten.
        let mut file = File::create_new(&partial)?;
        fill(&mut file)?;
        file.sync_all()?;
        std::fs::rename(&partial, path)
    });
    if written.is_err() {
        let _ = clear(&partial);
    }
    written.map_err(|e| failure(path, &e))
}

/// As [`write`], of a text: what a terminal or a page would obey is shown instead.
///
/// # Errors
/// [`Error::Output`].
pub fn write_text(path: &Path, text: &str) -> Result<()> {
    write(path, visible(text).as_bytes())
}

/// The text of a file, which must be one: nothing waits for the other end of a pipe.
///
/// # Errors
/// [`Error::Output`].
pub fn read_text(path: &Path) -> Result<String> {
    match std::fs::metadata(path) {
        Ok(found) if !found.is_file() => Err(failure(path, &"is no file")),
        Ok(_) => std::fs::read_to_string(path).map_err(|e| failure(path, &e)),
        Err(e) => Err(failure(path, &e)),
    }
}

/// Refuses files of `needed` bytes that the disk of `directory` cannot hold. `what` makes the first
/// words of the message of their size as text.
///
/// # Errors
/// [`Error::Directory`].
pub fn require_room(
    directory: &Path,
    needed: u64,
    what: impl FnOnce(&str) -> String,
) -> Result<()> {
    let room = machine::room_for_file(directory);
    if needed <= room {
        return Ok(());
    }
    let (what, room) = (what(&bytes_text(needed)), bytes_text(room));
    Err(Error::Directory {
        path: directory.to_owned(),
        reason: format!("{what}, there is room for {room}"),
    })
}

pub(crate) fn refused(directory: &Path, why: &io::Error) -> Error {
    // The nearest that there is on the way to it.
    let there = directory.ancestors().find(|path| std::fs::metadata(path).is_ok());
    let reason = match (there, why.kind()) {
        (Some(file), _) if file.is_file() && file == directory => "is not a directory".to_owned(),
        (Some(file), _) if file.is_file() => format!("{} is not a directory", file.display()),
        (Some(place), ErrorKind::NotFound) => {
            format!("no directory can be made in {}", place.display())
        }
        _ => why.to_string(),
    };
    Error::Directory { path: directory.to_owned(), reason }
}

/// An [`Error::Output`] about `path`.
pub(crate) fn failure(path: &Path, reason: &dyn std::fmt::Display) -> Error {
    Error::Output { path: path.to_owned(), reason: reason.to_string() }
}
