//! `--vary KEY=VALUE[,VALUE…]`.

use crate::base::error::{Error, Result};

/// A key and the values that it takes, each as `--set` reads it.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Vary {
    /// The dotted key.
    pub key: String,
    /// The values.
    pub values: Vec<String>,
}

impl Vary {
    /// Reads the option. Commas between quotes or brackets belong to a value.
    ///
    /// # Errors
    /// [`Error::Input`] that says what is expected.
    pub fn parse(text: &str) -> Result<Self> {
        let wrong = |what: &str| Err(Error::Input(format!("--vary {text}: {what}")));
        let Some((key, values)) = text.split_once('=') else {
            return wrong("KEY=VALUE[,VALUE…] expected");
        };
        if key.split('.').any(|part| part.trim().is_empty()) {
            return wrong("KEY=VALUE[,VALUE…] expected, the key without empty parts");
        }
        let Some(values) = parts(values) else {
            return wrong("a quote or a bracket has no partner");
        };
        if values.iter().any(|value| value.is_empty()) {
            return wrong("a value is empty; text without characters is \"\"");
        }
        Ok(Self { key: key.trim().to_owned(), values })
    }
}

/// The parts of `text` between commas that stand in no quotes and no brackets; `None` where quotes
/// or brackets do not match.
fn parts(text: &str) -> Option<Vec<String>> {
    let mut parts = vec![String::new()];
    let mut open = Vec::new();
    let mut characters = text.chars();
    while let Some(c) = characters.next() {
        let quoted = open.last().copied().filter(|end| matches!(end, '"' | '\''));
        match c {
            ',' if open.is_empty() => {
                parts.push(String::new());
                continue;
            }
            _ if Some(c) == open.last().copied() => drop(open.pop()),
            '\\' if quoted == Some('"') => {
                parts.last_mut()?.push(c);
                parts.last_mut()?.push(characters.next()?);
                continue;
            }
            _ if quoted.is_some() => {}
            '"' | '\'' => open.push(c),
            '(' => open.push(')'),
            '[' => open.push(']'),
            '{' => open.push('}'),
            ')' | ']' | '}' => return None,
            _ => {}
        }
        parts.last_mut()?.push(c);
    }
    open.is_empty().then(|| parts.iter().map(|part| part.trim().to_owned()).collect())
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn values_are_separated_by_commas_outside() {
        for (text, key, values) in [
            ("axis.0.x.cells=64,128", "axis.0.x.cells", &["64", "128"][..]),
            (
                "solver.warp.profile = designed , smooth",
                "solver.warp.profile",
                &["designed", "smooth"],
            ),
            ("output.field_times=[0.1, 0.2],[]", "output.field_times", &["[0.1, 0.2]", "[]"]),
            ("initial.f=\"exp(-x^2)\",'x'", "initial.f", &["\"exp(-x^2)\"", "'x'"]),
            ("initial.f=min(x, v),max(x,v)", "initial.f", &["min(x, v)", "max(x,v)"]),
            (r#"title="a \", b",'c, "'"#, "title", &[r#""a \", b""#, "'c, \"'"]),
            ("exact={f='x, v'},{f=\"(\"}", "exact", &["{f='x, v'}", "{f=\"(\"}"]),
            ("potential.0.where=x<0", "potential.0.where", &["x<0"]),
        ] {
            let values = values.iter().map(|v| (*v).to_owned()).collect();
            assert_eq!(Vary::parse(text).expect(text), Vary { key: key.to_owned(), values });
        }
    }

    #[test]
    fn invalid_lists_are_refused() {
        for (text, reason) in [
            ("time.end", "KEY=VALUE"),
            ("=1", "empty parts"),
            ("time..end=1", "empty parts"),
            ("time.end=", "a value is empty"),
            ("time.end=1,,2", "a value is empty"),
            ("time.end=1,", "a value is empty"),
            ("output.field_times=[1,2", "no partner"),
            ("output.field_times=1],[2", "no partner"),
            ("initial.f=(x]", "no partner"),
            ("title=it's", "no partner"),
            ("title=\"a\\", "no partner"),
        ] {
            let message = Vary::parse(text).expect_err(text).to_string();
            assert!(message.starts_with(&format!("--vary {text}: ")), "{message}");
            assert!(message.contains(reason), "{message}");
        }
    }
}
