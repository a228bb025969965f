//! Lines for the user, on rank 0. What a terminal would obey is shown instead.

use crate::base::text::{visible, wrapped};
use std::io::{ErrorKind, Write};
use std::sync::OnceLock;

/// Why something could not be printed.
static UNWRITTEN: OnceLock<String> = OnceLock::new();

/// Prints lines for people, wrapped.
pub fn say(text: &str) {
    say_unwrapped(&wrapped(&visible(text)));
}

/// Prints lines for programs, as they are. A reader that went away (`| head`) is no error; any
/// other reason why they are not written is kept for [`unwritten`].
pub(crate) fn say_unwrapped(text: &str) {
    let mut output = std::io::stdout().lock();
    let written = writeln!(output, "{}", visible(text)).and_then(|()| output.flush());
    if let Some(why) = written.err().filter(|why| why.kind() != ErrorKind::BrokenPipe) {
        // The first reason is kept.
        let _ = UNWRITTEN.set(why.to_string());
    }
}

/// Why output was not written, if it was not: for example a full disk.
pub fn unwritten() -> Option<&'static str> {
    UNWRITTEN.get().map(String::as_str)
}

/// Prints lines for people to standard error, wrapped; that they cannot be written is no reason to
/// stop.
pub fn report(text: &str) {
    let _ = writeln!(std::io::stderr(), "{}", wrapped(&visible(text)));
}
