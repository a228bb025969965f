//! Whether the disk has room.

use crate::base::error::{Error, Result};
use crate::base::machine;
use crate::base::text::bytes_text;
use std::path::Path;

/// Refuses to start what the disk cannot hold; `what` says what takes so much, from its size as a
/// text.
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
