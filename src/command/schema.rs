//! `phasewarp schema`: the keys of a case file as a JSON schema, by which editors complete and
//! check them, or as a reference page.

use crate::command::cli::SchemaArgs;
use crate::command::printing::{print_json, print_unwrapped};
use crate::parallel::communicator::World;
use crate::problem::case::{ValueKind, keys};
use serde_json::{Map, Value, json};
use std::collections::BTreeMap;

/// The tables of keys in this document give the descriptions of the schema.
const DOCUMENT: &str = include_str!("../../docs/usage.md");

/// Prints the schema, or the page. Collective.
pub fn execute(world: &World, args: &SchemaArgs) {
    if args.markdown { print_unwrapped(world, &page()) } else { print_json(world, &schema()) }
}

/// Every key of a case file in Markdown, with one table per section of the file.
fn page() -> String {
    let texts = descriptions();
    let mut text = String::from(
        "# Keys of a case file\n\n\
         Every key that the program reads, printed by `phasewarp schema --markdown`.\n\
         [Usage](usage.md#the-case-file) explains them. `N` counts from 0.\n",
    );
    let mut section = "";
    let keys = every_key();
    for (key, kind) in &keys {
        let top = key.split('.').next().unwrap_or_default();
        if top != section {
            section = top;
            text += &format!("\n## {top}\n\n| key | takes | meaning |\n|---|---|---|\n");
        }
        let meaning = texts.get(key).map_or("", String::as_str).replace('|', "\\|");
        let takes = words_of(kind).replace('|', "\\|");
        text += &format!("| `{key}` | {takes} | {meaning} |\n");
    }
    text
}

/// The values that a key takes, in words.
fn words_of(kind: &ValueKind) -> String {
    let quoted = |words: &[&str]| {
        words.iter().map(|word| format!("`{word}`")).collect::<Vec<_>>().join(", ")
    };
    match kind {
        ValueKind::Unknown => String::new(),
        ValueKind::Number => "number".to_owned(),
        ValueKind::Whole => "whole number".to_owned(),
        ValueKind::Switch => "`true`, `false`".to_owned(),
        ValueKind::Text => "text".to_owned(),
        ValueKind::Formula => "formula".to_owned(),
        ValueKind::Word(words) => quoted(words),
        ValueKind::NumberOr(words) => format!("number, {}", quoted(words)),
        ValueKind::List(item) => format!("list: {}", words_of(item)),
        ValueKind::Table(_) => "table".to_owned(),
        ValueKind::Switches(_) => "`true`, `false`, table".to_owned(),
        ValueKind::Names(value) => format!("table of names: {}", words_of(value)),
    }
}

/// All keys with the kinds of their values, each table before its entries; `N` stands for the index
/// of a table in a list.
fn every_key() -> Vec<(String, ValueKind)> {
    fn collect(path: &str, kind: &ValueKind, found: &mut Vec<(String, ValueKind)>) {
        if !path.is_empty() && !path.ends_with(".N") {
            found.push((path.to_owned(), kind.clone()));
        }
        match kind {
            ValueKind::Table(entries) | ValueKind::Switches(entries) => {
                for (name, below) in entries {
                    let path = if path.is_empty() { "" } else { &format!("{path}.") };
                    collect(&format!("{path}{name}"), below, found);
                }
            }
            ValueKind::List(item) if matches!(**item, ValueKind::Table(_)) => {
                collect(&format!("{path}.N"), item, found);
            }
            _ => {}
        }
    }
    let mut found = Vec::new();
    collect("", &keys(), &mut found);
    found
}

/// JSON schema (draft 7) of a case file: every key that the reader knows, with its description from
/// docs/usage.md.
pub fn schema() -> Value {
    let mut schema = described("", &keys(), &descriptions());
    if let Value::Object(schema) = &mut schema {
        schema.insert("$schema".to_owned(), json!("http://json-schema.org/draft-07/schema#"));
        schema.insert("title".to_owned(), json!("phasewarp case"));
        schema.insert("required".to_owned(), json!(["axis", "potential", "initial", "time"]));
    }
    schema
}

/// The schema of the value at `path`, with its description.
fn described(path: &str, kind: &ValueKind, descriptions: &BTreeMap<String, String>) -> Value {
    let mut schema = expected(path, kind, descriptions);
    if let (Some(text), Value::Object(schema)) = (descriptions.get(path), &mut schema) {
        schema.insert("description".to_owned(), json!(text));
    }
    schema
}

/// The schema of a value of this kind at `path`, without its own description.
fn expected(path: &str, kind: &ValueKind, descriptions: &BTreeMap<String, String>) -> Value {
    let table = |entries: &[(&'static str, ValueKind)]| {
        let below = |name: &str| match path {
            "" => name.to_owned(),
            _ => format!("{path}.{name}"),
        };
        let entry = |(name, kind): &(&'static str, ValueKind)| {
            ((*name).to_owned(), described(&below(name), kind, descriptions))
        };
        let entries: Map<String, Value> = entries.iter().map(entry).collect();
        json!({ "type": "object", "properties": entries, "additionalProperties": false })
    };
    match kind {
        ValueKind::Unknown => json!({}),
        // A string is a formula of constants.
        ValueKind::Number | ValueKind::Formula => json!({ "type": ["number", "string"] }),
        ValueKind::Whole => json!({ "type": "integer" }),
        ValueKind::Switch => json!({ "type": "boolean" }),
        ValueKind::Text => json!({ "type": "string" }),
        ValueKind::Word(words) => json!({ "enum": words }),
        ValueKind::NumberOr(words) => {
            json!({ "anyOf": [{ "enum": words }, { "type": ["number", "string"] }] })
        }
        ValueKind::List(item) => {
            let item = described(&format!("{path}.N"), item, descriptions);
            json!({ "type": "array", "items": item })
        }
        ValueKind::Table(entries) => table(entries),
        ValueKind::Switches(entries) => json!({ "anyOf": [{ "type": "boolean" }, table(entries)] }),
        ValueKind::Names(value) => {
            let value = described(&format!("{path}.N"), value, descriptions);
            json!({ "type": "object", "additionalProperties": value })
        }
    }
}

/// Replaces an escaped `|` within a table cell while the row is split.
const BAR: &str = "\u{1}";

/// The descriptions in the tables of [`DOCUMENT`], by key; `N` stands for the index of a table in a
/// list.
fn descriptions() -> BTreeMap<String, String> {
    let mut found = BTreeMap::new();
    let section = DOCUMENT.split("\n## ").find(|part| part.starts_with("The case file"));
    for line in section.unwrap_or_default().lines().filter(|line| line.starts_with("| `")) {
        let line = line.replace("\\|", BAR);
        let cells: Vec<&str> = line.trim_matches('|').split('|').map(str::trim).collect();
        let [names, default, meaning] = cells[..] else { continue };
        let mut text = plain(meaning);
        if !default.is_empty() {
            text += &format!(" (default: {})", plain(default));
        }
        // In "`a.b`, `.c`, or `.d`" the later keys belong to the table of the first.
        let mut parent = "";
        for name in names.split('`').skip(1).step_by(2) {
            let key = match name.strip_prefix('.') {
                Some(name) => format!("{parent}.{name}"),
                None => name.trim_matches(['[', ']']).to_owned(),
            };
            if !name.starts_with('.') {
                parent = name.rsplit_once('.').map_or("", |(parent, _)| parent);
            }
            found.insert(key, text.clone());
        }
    }
    found
}

/// A table cell as plain text, in which links are replaced by their text.
fn plain(text: &str) -> String {
    let mut plain = String::new();
    let mut rest = text;
    while let Some((before, after)) = rest.split_once('[') {
        plain += before;
        match after.split_once("](") {
            Some((shown, link)) if !shown.contains('[') => {
                plain += shown;
                rest = link.split_once(')').map_or("", |(_, rest)| rest);
            }
            _ => {
                plain.push('[');
                rest = after;
            }
        }
    }
    (plain + rest).replace('`', "").replace(BAR, "|").trim().to_owned()
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::path::Path;

    /// Adds to `found` everything in `value` at `path` that `schema` does not allow.
    fn mistakes(path: &str, value: &Value, schema: &Value, found: &mut Vec<String>) {
        if let Some(choices) = schema["anyOf"].as_array() {
            let fits = |choice: &&Value| {
                let mut wrong = Vec::new();
                mistakes(path, value, choice, &mut wrong);
                wrong.is_empty()
            };
            if choices.iter().find(fits).is_none() {
                found.push(format!("{path} = {value}: none of {choices:?}"));
            }
            return;
        }
        if let Some(words) = schema["enum"].as_array()
            && !words.contains(value)
        {
            found.push(format!("{path} = {value}: not in {words:?}"));
        }
        let is = |kind: &str| match kind {
            "object" => value.is_object(),
            "array" => value.is_array(),
            "string" => value.is_string(),
            "boolean" => value.is_boolean(),
            "integer" => value.is_i64(),
            _ => value.is_number(),
        };
        let kinds: Vec<&str> = match &schema["type"] {
            Value::Array(kinds) => kinds.iter().filter_map(Value::as_str).collect(),
            kind => kind.as_str().into_iter().collect(),
        };
        if !kinds.is_empty() && !kinds.iter().any(|kind| is(kind)) {
            found.push(format!("{path} = {value}: {kinds:?} expected"));
        }
        for (name, value) in value.as_object().into_iter().flatten() {
            match [&schema["properties"][name], &schema["additionalProperties"]] {
                [Value::Null, below @ Value::Object(_)] => {
                    mistakes(&format!("{path}.{name}"), value, below, found);
                }
                [Value::Null, _] => found.push(format!("{path}.{name}: no such key")),
                [below, _] => mistakes(&format!("{path}.{name}"), value, below, found),
            }
        }
        for value in value.as_array().into_iter().flatten() {
            mistakes(path, value, &schema["items"], found);
        }
    }

    fn wrong(text: &str) -> Vec<String> {
        let value: Value = toml::from_str(text).expect("TOML");
        let mut found = Vec::new();
        mistakes("", &value, &schema(), &mut found);
        found
    }

    #[test]
    fn all_cases_fit() {
        let root = Path::new(env!("CARGO_MANIFEST_DIR")).join("cases");
        let mut count = 0;
        for folder in [root.clone(), root.join("paper")] {
            for entry in folder.read_dir().expect("a folder") {
                let path = entry.expect("an entry").path();
                if path.extension().is_some_and(|ending| ending == "toml") {
                    let found = wrong(&std::fs::read_to_string(&path).expect("a case"));
                    assert!(found.is_empty(), "{}: {found:?}", path.display());
                    count += 1;
                }
            }
        }
        assert!(count > 12, "only {count} cases");
    }

    #[test]
    fn mistakes_do_not_fit() {
        for (text, key) in [
            ("tme.end = 1", ".tme"),
            ("time.end = true", ".time.end"),
            ("axis = [{ x = { cells = 1.5 } }]", ".axis.x.cells"),
            ("solver.method = \"clasical\"", ".solver.method"),
            ("solver.warp.delta = true", ".solver.warp.delta"),
            ("solver.reduce = 3", ".solver.reduce"),
            ("output.field_times = 0.5", ".output.field_times"),
            ("initial.f = true", ".initial.f"),
        ] {
            let found = wrong(text);
            assert!(found.len() == 1 && found[0].starts_with(key), "{text}: {found:?}");
        }
        for text in ["initial.f = 1", "solver.reduce = false", "solver.warp.delta = \"max\""] {
            assert!(wrong(text).is_empty(), "{text}");
        }
    }

    /// Every key and every table is in the document, and the document has no other.
    #[test]
    fn the_document_has_every_key_and_no_other() {
        let (described, keys) = (descriptions(), every_key());
        let known: Vec<&str> = keys.iter().map(|(key, _)| key.as_str()).collect();
        assert!(known.len() > 80, "{known:?}");
        let missing: Vec<_> = known.iter().filter(|key| !described.contains_key(**key)).collect();
        let stale: Vec<_> = described.keys().filter(|key| !known.contains(&key.as_str())).collect();
        assert!(missing.is_empty() && stale.is_empty(), "missing {missing:?}, stale {stale:?}");
    }

    /// The page has a row for every key, of three cells.
    #[test]
    fn the_page_has_every_key() {
        let page = page();
        let rows: Vec<&str> = page.lines().filter(|line| line.starts_with("| `")).collect();
        assert_eq!(rows.len(), every_key().len());
        for row in rows {
            let bars = row.replace("\\|", "").matches('|').count();
            assert_eq!(bars, 4, "{row}");
        }
        assert!(page.contains("| `axis.N.x.cells` | whole number |"), "{page}");
        assert!(page.contains("| `solver.warp.delta` | number, `max` |"), "{page}");
    }
}
