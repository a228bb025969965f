//! Errors of tables that a `--set` causes, although the case file names the table's file.

use crate::base::error::Error;
use crate::base::refusal::Refusal;
use crate::base::text::shortened;
use crate::problem::case::file::MOST_SHOWN;
use crate::problem::case::reader::{is_within, key_of};
use crate::problem::case::{Case, TableFile};

impl Case {
    /// The number of the last `--set` that gives `key`, a table around it, or an entry of it.
    fn override_of(&self, key: &str) -> Option<usize> {
        self.settings.keys().find(|given| is_within(given, key))?;
        self.overrides.iter().rposition(|set| {
            let set = key_of(set);
            is_within(&set, key) || is_within(key, &set)
        })
    }

    /// The value of `key` in messages; a list of its entries.
    fn value_text(&self, key: &str) -> String {
        let entries = (0..).map_while(|i| self.settings.get(&format!("{key}.{i}")));
        let entries: Vec<&str> = entries.map(String::as_str).collect();
        self.settings.get(key).cloned().unwrap_or_else(|| format!("[{}]", entries.join(", ")))
    }

    /// The error that something is wrong with `table`, which may be due to these `keys` of the
    /// case: about the one that the last `--set` gives. About the table's file if the case file
    /// gives them all, or a later `--set` the table's file.
    pub fn wrong_table(&self, table: &TableFile, keys: &[String], what: &str) -> Error {
        let last = keys.iter().max_by_key(|key| self.override_of(key));
        let set_later =
            |key: &&String| self.override_of(key) > self.override_of(&table.of.file_key());
        let Some(key) = last.filter(set_later) else { return table.wrong(&what) };
        let set = self.override_of(key).map_or("", |number| &self.overrides[number]);
        let place = format!("--set {}: {key}", shortened(set, MOST_SHOWN));
        let message = format!("{} = \"{}\": {what}", table.of.file_key(), table.path.display());
        let value = shortened(&self.value_text(key), MOST_SHOWN);
        Error::Case(Box::new(Refusal::at_place(&place, &value, &message)))
    }
}
