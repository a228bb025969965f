//! Lines for the user, on rank 0. What a terminal would obey is shown instead.

use crate::base::text::visible;
use std::io::Write;

/// Prints a line; a reader that went away (`| head`) is no error.
pub(crate) fn say(line: &str) {
    let _ = writeln!(std::io::stdout(), "{}", visible(line));
}

/// Prints a line to standard error; one that cannot be written is no reason to stop.
pub fn report(line: &str) {
    let _ = writeln!(std::io::stderr(), "{}", visible(line));
}
