//! The settings of a case, key by key, and the difference between two cases.

use crate::base::text::shortened;
use std::collections::BTreeMap;

/// Largest number of characters of a value in a message.
const MOST_SHOWN: usize = 40;

/// Every value that a case file and the `--set` options give, by its key.
pub type Settings = BTreeMap<String, String>;

/// A text about the first setting that differs between `there` and `here`; `None` if they are the
/// same case. Settings of checkpoints are ignored.
pub fn differing_setting(there: &Settings, here: &Settings) -> Option<String> {
    let of = |settings: &Settings, key: &str| {
        settings.get(key).map_or("not given".to_owned(), |value| {
            shortened(value.trim_matches(['"', ' ', '\n']), MOST_SHOWN)
        })
    };
    let differs =
        |key: &&String| !key.starts_with("checkpoint.") && there.get(*key) != here.get(*key);
    let key = there.keys().chain(here.keys()).find(differs)?;
    Some(format!("{key} is {} there, {} here", of(there, key), of(here, key)))
}
