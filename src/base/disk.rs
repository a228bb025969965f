//! Output directories, files written atomically, and errors about both.

use crate::base::error::{Error, Result};
use crate::base::machine;
use crate::base::text::{bytes_text, visible};
use serde::Serialize;
use std::ffi::OsString;
use std::fs::File;
use std::io::{self, BufWriter, ErrorKind, Read, Write};
use std::path::{Path, PathBuf};

/// Creates `directory` and checks that it is writable. Called by one rank.
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

/// The name of the file `path` while it is written: with `.partial` appended.
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

/// Writes the file `path` and flushes it to disk; an older file stays intact until then.
///
/// # Errors
/// [`Error::Output`].
pub fn write(path: &Path, bytes: &[u8]) -> Result<()> {
    write_with(path, |file| file.write_all(bytes))
}

/// Writes a file as [`write`] does, with the contents that `fill` writes into it.
///
/// # Errors
/// [`Error::Output`].
pub fn write_with(path: &Path, fill: impl FnOnce(&mut File) -> io::Result<()>) -> Result<()> {
    put_in_place(path, |partial| {
        // `create_new` neither follows nor overwrites what someone else puts there.
        let mut file = File::create_new(partial)?;
        fill(&mut file)?;
        file.sync_all()
    })
}

/// Lets `write` make the file `path` under another name, and renames it: an older file stays intact
/// until then, and a failed write leaves no file.
///
/// # Errors
/// [`Error::Output`].
pub(crate) fn put_in_place<E: std::fmt::Display>(
    path: &Path,
    write: impl FnOnce(&Path) -> std::result::Result<(), E>,
) -> Result<()> {
    let partial = partial(path);
    clear(&partial).map_err(|e| failure(&partial, &e))?;
    let written = write(&partial).map_err(|e| failure(path, &e));
    let placed =
        written.and_then(|()| std::fs::rename(&partial, path).map_err(|e| failure(path, &e)));
    if placed.is_err() {
        let _ = clear(&partial);
    }
    placed
}

/// Writes a text as [`write`] does. Its control characters are escaped.
///
/// # Errors
/// [`Error::Output`].
pub fn write_text(path: &Path, text: &str) -> Result<()> {
    write(path, visible(text).as_bytes())
}

/// Writes `value` as JSON on several lines, as [`write_text`] does.
///
/// # Errors
/// [`Error::Output`].
pub fn write_json(path: &Path, value: &impl Serialize) -> Result<()> {
    let text = serde_json::to_string_pretty(value).map_err(|e| failure(path, &e))?;
    write_text(path, &(text + "\n"))
}

/// Writes a long text in pieces as [`write_text`] does. One piece at a time is in memory.
///
/// # Errors
/// [`Error::Output`].
pub fn write_pieces(path: &Path, pieces: impl Iterator<Item = String>) -> Result<()> {
    write_with(path, |file| {
        let mut file = BufWriter::new(file);
        for piece in pieces {
            file.write_all(visible(&piece).as_bytes())?;
        }
        file.flush()
    })
}

/// Longest text that is read, in bytes: 64 MiB. The program writes summaries and manifests of some
/// MB at most.
const LONGEST_TEXT: u64 = 64 << 20;

/// The text of a regular file of at most 64 MiB. A pipe is refused, as reading it may wait for
/// ever.
///
/// # Errors
/// [`Error::Output`].
pub fn read_text(path: &Path) -> Result<String> {
    text_of(path).map_err(|e| failure(path, &e))
}

/// The text of a file, as [`read_text`] reads it.
///
/// # Errors
/// Of the file system; that it is no file, no text, or larger.
pub(crate) fn text_of(path: &Path) -> io::Result<String> {
    let file = open_regular(path)?;
    let within = |bytes: u64| match bytes {
        0..=LONGEST_TEXT => Ok(()),
        _ => Err(io::Error::other(format!("{bytes} bytes; at most {LONGEST_TEXT} are read"))),
    };
    within(file.metadata()?.len())?;
    let mut text = String::new();
    // It may grow meanwhile.
    within(file.take(LONGEST_TEXT + 1).read_to_string(&mut text)? as u64)?;
    Ok(text)
}

/// Opens a regular file. A pipe is refused, as opening it may wait for ever.
///
/// # Errors
/// Of the file system, or that it is no file.
pub(crate) fn open_regular(path: &Path) -> io::Result<File> {
    require_file(path)?;
    File::open(path)
}

/// Whether there is anything at `path`: a file, a directory, a link even if it leads to none.
pub(crate) fn is_taken(path: &Path) -> bool {
    std::fs::symlink_metadata(path).is_ok()
}

/// Refuses what is no regular file, nor a link to one: a directory, a pipe, a device.
///
/// # Errors
/// Of the file system, or that it is no file.
pub(crate) fn require_file(path: &Path) -> io::Result<()> {
    if std::fs::metadata(path)?.is_file() { Ok(()) } else { Err(io::Error::other("is no file")) }
}

/// Refuses files of `needed` bytes that the disk of `directory` cannot hold. `what` makes the
/// beginning of the message from the size as text.
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
    Err(directory_error(directory, format!("{what}, there is room for {room}")))
}

pub(crate) fn refused(directory: &Path, why: &io::Error) -> Error {
    // The nearest existing ancestor.
    let there = directory.ancestors().find(|path| std::fs::metadata(path).is_ok());
    let reason = match (there, why.kind()) {
        (Some(file), _) if file.is_file() && file == directory => "is not a directory".to_owned(),
        (Some(file), _) if file.is_file() => format!("{} is not a directory", file.display()),
        (Some(place), ErrorKind::NotFound) => {
            format!("no directory can be made in {}", place.display())
        }
        _ => why.to_string(),
    };
    directory_error(directory, reason)
}

/// The refusal to replace `what` in `directory`, where others' files stay unless the user asks.
pub(crate) fn not_replaced(directory: &Path, what: &str) -> Error {
    let reason = format!("it holds {what}; --force replaces it, -o gives another directory");
    directory_error(directory, reason)
}

/// An [`Error::Directory`] about `directory`.
pub(crate) fn directory_error(directory: &Path, reason: impl Into<String>) -> Error {
    Error::Directory { path: directory.to_owned(), reason: reason.into() }
}

/// An [`Error::Output`] about `path`.
pub(crate) fn failure(path: &Path, reason: &dyn std::fmt::Display) -> Error {
    Error::Output { path: path.to_owned(), reason: reason.to_string() }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn texts_of_any_size_are_refused_without_reading_them() {
        let place = tempfile::tempdir().expect("a directory");
        let path = place.path().join("text");
        let file = File::create(&path).expect("a file");
        for (bytes, is_read) in [(0, true), (1 << 20, true), (LONGEST_TEXT + 1, false)] {
            file.set_len(bytes).expect("a size");
            assert_eq!(read_text(&path).is_ok(), is_read, "{bytes} bytes");
        }
        file.set_len(60 << 30).expect("a size");
        let refusal = read_text(&path).expect_err("too large").to_string();
        let named = ["text: 64424509440 bytes", "at most 67108864"];
        assert!(named.iter().all(|words| refusal.contains(words)), "{refusal}");
    }
}
