//! Output lines for the user, on rank 0. Control characters are escaped.

use crate::base::text::{visible, wrapped};
use std::io::{ErrorKind, Write};
use std::sync::OnceLock;

/// Why something could not be printed.
static UNWRITTEN: OnceLock<String> = OnceLock::new();

/// Prints lines for people, wrapped.
pub fn print_wrapped(text: &str) {
    print_as_is(&wrapped(&visible(text)));
}

/// Prints lines for programs, as they are. A closed pipe (`| head`) is no error; any other failure
/// is kept for [`unwritten`].
pub(crate) fn print_as_is(text: &str) {
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

/// Prints lines for people to standard error, wrapped; a failure to write is ignored.
pub fn eprint_wrapped(text: &str) {
    let _ = writeln!(std::io::stderr(), "{}", wrapped(&visible(text)));
}
