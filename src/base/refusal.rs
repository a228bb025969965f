//! A mistake in a case and its place: as text for people, and in parts for programs.

use serde::Serialize;
use std::fmt::{self, Display, Formatter};

/// A mistake in a case file or a `--set`. Unknown parts are `None`.
#[derive(Clone, Debug, Default, PartialEq, Eq, Serialize)]
pub struct Refusal {
    /// The full key.
    pub key: Option<String>,
    /// The value of the key in the case.
    pub value: Option<String>,
    /// What is wrong with it, and what is allowed.
    pub message: String,
    /// The case file.
    pub file: Option<String>,
    /// The line, from 1.
    pub line: Option<usize>,
    /// The column in characters, from 1.
    pub column: Option<usize>,
    /// The `--set` that contains it.
    pub set: Option<String>,
    /// The text after the place, if key and value precede the message.
    #[serde(skip)]
    pub text: Option<String>,
    /// The line of the file, with a mark below the column.
    #[serde(skip)]
    pub excerpt: Option<String>,
}

impl Refusal {
    /// A refusal of `value` at `place`: `file:line: key`, or `--set …: key`.
    pub fn at_place(place: &str, value: &str, message: &str) -> Self {
        let (before, key) = place.rsplit_once(": ").unwrap_or(("", place));
        let mut refusal = Self {
            key: Some(key.to_owned()),
            value: Some(value.to_owned()),
            message: message.to_owned(),
            text: Some(format!("{key} = {value}: {message}")),
            ..Self::default()
        };
        let with_line = before.rsplit_once(':').map(|(file, line)| (file, line.parse().ok()));
        match (before.strip_prefix("--set "), with_line) {
            (Some(set), _) => refusal.set = Some(set.to_owned()),
            (None, Some((file, Some(line)))) => {
                (refusal.file, refusal.line) = (Some(file.to_owned()), Some(line));
            }
            _ => refusal.file = Some(before.to_owned()).filter(|file| !file.is_empty()),
        }
        refusal
    }
}

impl Display for Refusal {
    fn fmt(&self, f: &mut Formatter<'_>) -> fmt::Result {
        match (&self.set, &self.file) {
            (Some(set), _) => write!(f, "--set {set}: ")?,
            (None, Some(file)) => {
                f.write_str(file)?;
                for place in [self.line, self.column].into_iter().flatten() {
                    write!(f, ":{place}")?;
                }
                f.write_str(": ")?;
            }
            (None, None) => {}
        }
        f.write_str(self.text.as_ref().unwrap_or(&self.message))?;
        match &self.excerpt {
            Some(excerpt) => write!(f, "\n{excerpt}"),
            None => Ok(()),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_place_is_taken_apart() {
        let at = |place: &str| Refusal::at_place(place, "2", "too large");
        let found = at("cases/a b: c.toml:12: time.end");
        assert_eq!(found.file.as_deref(), Some("cases/a b: c.toml"));
        assert_eq!((found.line, found.key.as_deref()), (Some(12), Some("time.end")));
        assert_eq!(found.to_string(), "cases/a b: c.toml:12: time.end = 2: too large");
        let found = at("--set time.end=2: time.end");
        assert_eq!(found.set.as_deref(), Some("time.end=2"));
        assert_eq!(found.to_string(), "--set time.end=2: time.end = 2: too large");
        let found = at("case.toml: time.end");
        assert_eq!((found.file.as_deref(), found.line), (Some("case.toml"), None));
        assert_eq!(found.to_string(), "case.toml: time.end = 2: too large");
    }
}
