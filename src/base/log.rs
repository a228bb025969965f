//! Lines for the user, on rank 0. What a terminal would obey is shown instead.

use crate::base::text::{visible, wrapped};
use std::io::Write;

/// Prints lines for people, wrapped; a reader that went away (`| head`) is no error.
pub fn say(text: &str) {
    say_unwrapped(&wrapped(&visible(text)));
}

/// Prints lines for programs, as they are.
pub(crate) fn say_unwrapped(text: &str) {
    let _ = writeln!(std::io::stdout(), "{}", visible(text));
}

/// Prints lines for people to standard error, wrapped; that they cannot be written is no reason to
/// stop.
pub fn report(text: &str) {
    let _ = writeln!(std::io::stderr(), "{}", wrapped(&visible(text)));
}
