//! The case file as a TOML tree that remembers where each value stands, so that an error can name
//! file, line, key, value and limit.
//!
//! `--set key=value` replaces values of the tree. The span of a value is a range of bytes of the
//! file. For the `--set` of number `n` it is the empty range `n + 1` bytes beyond the file's end.

use crate::base::error::{Error, Result};
use crate::base::refusal::Refusal;
use crate::base::text::shortened;
use crate::problem::case::keys::{self, ValueKind};
use crate::problem::case::reader::{
    KeyValue, Mistake, decimal, integer, joined_key, key_of, number_of,
};
use crate::problem::formula::{Constants, Expression};
use serde::de::DeserializeOwned;
use serde_json::Value;
use std::collections::{BTreeMap, BTreeSet};
use std::ops::{Range, RangeInclusive};
use std::path::Path;
use toml::Spanned;
use toml::de::{DeTable, DeValue};

/// Largest number of characters of a value or of a line in a message.
pub(super) const MOST_SHOWN: usize = 120;

/// A case file with its `--set` options applied.
#[derive(Debug)]
pub struct CaseFile<'t> {
    /// The name of the file.
    pub(super) name: &'t str,
    /// The text of the file.
    pub(super) text: &'t str,
    /// The `--set` options.
    pub(super) overrides: &'t [String],
    root: DeValue<'t>,
    /// The constants that formulas may name; empty until `[constants]` is read.
    pub constants: Constants,
}

/// The value of a key, and where value and key stand.
struct FoundKey<'f> {
    /// The key's value, if the case gives one.
    value: Option<&'f DeValue<'f>>,
    /// The place of the value, or of a table's heading. For an absent key, the heading of the
    /// innermost table around it.
    span: Option<Range<usize>>,
    /// The place of the key itself.
    key: Option<Range<usize>>,
}

/// A key that is there only to be refused with the reason.
const REFUSED_KEY: &str = "axis.N.v.boundary";
/// The largest number of keys elsewhere that a message names instead of an unknown one.
const MOST_MEANT: usize = 3;

/// What the line of a syntax error at `place` probably should be, where the parser does not say so.
fn hint(text: &str, place: usize) -> &'static str {
    let line = position(text, place).content;
    let line = line.split('#').next().unwrap_or_default().trim();
    let value = line.split_once('=').map_or("", |(_, value)| value.trim());
    let is_number = |text: &str| text.parse::<f64>().is_ok();
    let digit = |byte: &u8| byte.is_ascii_digit();
    let has_comma = !line.contains(['[', '"', '\''])
        && line.as_bytes().windows(3).any(|w| digit(&w[0]) && w[1] == b',' && digit(&w[2]));
    if line.starts_with("[potential]") {
        "; each region of V begins with [[potential]]"
    } else if line.starts_with("[axis]") {
        "; each dimension of space begins with [[axis]]"
    } else if has_comma {
        "; a number has a decimal point, no comma"
    } else if value.split_once(' ').is_some_and(|(number, _)| is_number(number)) {
        "; numbers have no units"
    } else if is_formula(value)
        || !line.contains(['"', '\'']) && line.split('=').skip(1).any(|v| is_formula(v.trim()))
    {
        "; formulas and other texts are in quotes"
    } else {
        ""
    }
}

/// Whether a value that is not in quotes looks like a formula, as `0.1*x`, `-pi` or `f(x)`.
fn is_formula(value: &str) -> bool {
    let begins = value.trim_start_matches(['-', '+', '(']);
    let operator = |c: char| "*/^(".contains(c);
    // As `2pi`; the `e` of `1e5x` belongs to a number.
    let is_product = value.contains(|c: char| c.is_alphabetic() && !"eE".contains(c));
    !value.starts_with(['"', '\'', '[', '{'])
        && (begins.starts_with(|c: char| c.is_alphabetic())
            || value.contains(operator)
            || is_product)
}

impl<'t> CaseFile<'t> {
    /// Parses `text` (the file `name`) and applies `--set` overrides in order.
    pub fn parse(name: &'t str, text: &'t str, overrides: &'t [String]) -> Result<Self> {
        let root = DeValue::Table(DeTable::new());
        let mut file = CaseFile { name, text, overrides, root, constants: Constants::new() };
        let table = DeTable::parse(text).map_err(|e| {
            let hint = e.span().map_or("", |span| hint(text, span.start));
            file.error_at(e.span(), &format!("{}{hint}", e.message()))
        })?;
        file.root = DeValue::Table(table.into_inner());
        for (number, text) in overrides.iter().enumerate() {
            file.set(number, text)?;
        }
        Ok(file)
    }

    /// The name of the file without its directory.
    pub(super) fn last_name(&self) -> String {
        let name = Path::new(self.name).file_name().unwrap_or(self.name.as_ref());
        name.to_string_lossy().into_owned()
    }

    /// Applies the override `text`, which has this number.
    fn set(&mut self, number: usize, text: &'t str) -> Result<()> {
        // The span that represents this `--set`.
        let place = self.text.len() + 1 + number;
        let span = place..place;
        let fail = |file: &Self, message: &str| Err(file.error_at(Some(span.clone()), message));
        let Some((path, value)) = text.split_once('=') else {
            return fail(self, "expected key=value");
        };
        // A value that is not TOML is text, so that a shell needs no second pair of quotes.
        let value = match DeValue::parse(value.trim()) {
            Ok(value) => with_span(value.into_inner(), &span),
            Err(_) => Spanned::new(span.clone(), text_value(value.trim(), &span)),
        };
        let parts: Vec<&str> = path.split('.').map(str::trim).collect();
        if parts.iter().any(|p| p.is_empty()) {
            return fail(self, "expected key=value, the key without empty parts");
        }
        put(&mut self.root, &parts, value).or_else(|message| fail(self, &message))
    }

    /// Deserializes the whole file.
    pub fn read<T: DeserializeOwned>(&self) -> Result<T> {
        let root = KeyValue::new("", &self.root, &self.constants);
        T::deserialize(root).map_err(|mistake| self.report(mistake, &keys::of::<T>()))
    }

    /// Deserializes the value of `key`, if it is given.
    pub fn read_at<T: DeserializeOwned>(&self, key: &str) -> Result<Option<T>> {
        let value = self.find(key).value.map(|value| KeyValue::new(key, value, &self.constants));
        let value = value.map(T::deserialize).transpose();
        value.map_err(|mistake| self.report(mistake, &keys::of::<T>()))
    }

    /// The error of a mistake that serde found where there may be the keys `known`.
    fn report(&self, mistake: Mistake, known: &ValueKind) -> Error {
        let key = mistake.key.unwrap_or_default();
        if !mistake.unknown {
            return self.error(&key, &mistake.message);
        }
        let name = key.rsplit('.').next().unwrap_or_default();
        let mut meant = known.ending_in(name);
        meant.retain(|key| key != REFUSED_KEY);
        let meant = match meant.len() {
            1..=MOST_MEANT => format!(" (did you mean {}?)", meant.join(" or ")),
            _ => mistake.message,
        };
        let message = format!("unknown key {key}{meant}");
        let span = self.find(&key).key;
        self.refusal(span, Refusal { key: Some(key), message, ..Refusal::default() })
    }

    /// Looks up the dotted `key`.
    fn find(&self, key: &str) -> FoundKey<'_> {
        let mut found = FoundKey { value: Some(&self.root), span: None, key: None };
        let mut rest = key;
        while !rest.is_empty() {
            let (part, below) = match found.value {
                Some(DeValue::Table(table)) => {
                    let key = table.iter().find(|(key, _)| begins_with(rest, key.get_ref()));
                    found.key = key.map(|(key, _)| key.span());
                    (key.map_or(0, |(key, _)| key.get_ref().len()), key.map(|(_, value)| value))
                }
                Some(DeValue::Array(list)) => {
                    let part = rest.split('.').next().unwrap_or(rest);
                    let item = part.parse::<usize>().ok().and_then(|i| list.get(i));
                    found.key = item.map(|item| item.span());
                    (part.len(), item)
                }
                _ => (0, None),
            };
            found.value = below.map(|value| value.get_ref());
            let Some(value) = below else { return found };
            // An error about a table points at its heading.
            found.span = match value.get_ref() {
                DeValue::Table(_) => found.key.clone(),
                _ => Some(value.span()),
            };
            rest = rest[part..].trim_start_matches('.');
        }
        found
    }

    /// Whether `key` is given.
    pub fn has(&self, key: &str) -> bool {
        self.find(key).value.is_some()
    }

    /// An error about `key`, pointing at its place.
    pub fn error(&self, key: &str, message: &str) -> Error {
        let found = self.find(key);
        let value = found.value.map(value_text);
        let given = value.as_ref().map_or(String::new(), |value| format!(" = {value}"));
        // The value of a formula that is given for a number.
        let number = found.value.and_then(DeValue::as_str);
        let number = number.and_then(|text| number_of(text, &self.constants).ok());
        let number = number.filter(|number| number.is_finite());
        let number = number.map_or(String::new(), |number| format!(" ({number})"));
        let refusal = Refusal {
            key: Some(key.to_owned()),
            value,
            message: message.to_owned(),
            text: Some(format!("{key}{given}{number}: {message}")),
            ..Refusal::default()
        };
        self.refusal(found.span, refusal)
    }

    /// Refuses the value of `key`.
    pub fn refuse<T>(&self, key: &str, message: impl AsRef<str>) -> Result<T> {
        Err(self.error(key, message.as_ref()))
    }

    /// Refuses two keys that exclude each other: the one that a later `--set` gives, else the
    /// first.
    pub fn refuse_either<T>(&self, keys: [&str; 2], message: impl AsRef<str>) -> Result<T> {
        let [set, other] = keys.map(|key| self.override_of(key));
        self.refuse(if other > set { keys[1] } else { keys[0] }, message)
    }

    /// `value`, if it lies in `range`.
    pub fn within(
        &self,
        key: &str,
        value: f64,
        range: RangeInclusive<f64>,
        message: impl FnOnce() -> String,
    ) -> Result<f64> {
        if range.contains(&value) { Ok(value) } else { self.refuse(key, message()) }
    }

    /// `value`, if it lies between these limits.
    pub fn between(&self, key: &str, value: f64, [least, most]: [f64; 2]) -> Result<f64> {
        self.within(key, value, least..=most, || format!("must be between {least} and {most}"))
    }

    /// `count`, if it is at least `least`.
    pub fn count(&self, key: &str, count: i64, least: usize) -> Result<usize> {
        match usize::try_from(count) {
            Ok(count) if count >= least => Ok(count),
            _ => self.refuse(key, format!("must be at least {least}")),
        }
    }

    /// `value`, unless it is `None`.
    pub fn required<T>(&self, key: &str, value: Option<T>, expected: &str) -> Result<T> {
        value.ok_or_else(|| self.error(key, &format!("missing; {expected} expected")))
    }

    /// The formula `text` of `key`; `names[i]` lists the names under which coordinate `i` may
    /// appear.
    pub fn formula(&self, key: &str, text: &str, names: &[&[&str]]) -> Result<Expression> {
        Expression::parse(text, names, &self.constants)
            .map(|formula| formula.at(self.place(key)))
            .map_err(|message| self.error(key, &message))
    }

    /// File, line and name of `key`, for errors that are detected after reading.
    pub fn place(&self, key: &str) -> String {
        let found = self.find(key);
        let Some(start) = found.value.and(found.span).map(|span| span.start) else {
            return format!("{}: {key}", self.name);
        };
        match self.override_at(start) {
            Some(set) => format!("--set {}: {key}", shortened(set, MOST_SHOWN)),
            None => format!("{}:{}: {key}", self.name, position(self.text, start).line),
        }
    }

    /// The number of the `--set` that gives `key`, if one does.
    pub fn override_of(&self, key: &str) -> Option<usize> {
        let found = self.find(key);
        let start = found.value.and(found.span)?.start;
        self.override_at(start).map(|_| start - self.text.len() - 1)
    }

    /// The `--set` option that a span with this start represents, if it lies beyond the file.
    fn override_at(&self, start: usize) -> Option<&'t String> {
        self.overrides.get(start.checked_sub(self.text.len() + 1)?)
    }

    fn error_at(&self, span: Option<Range<usize>>, message: &str) -> Error {
        self.refusal(span, Refusal { message: message.to_owned(), ..Refusal::default() })
    }

    /// The error of `refusal`, which stands at `span`.
    fn refusal(&self, span: Option<Range<usize>>, mut refusal: Refusal) -> Error {
        let start = span.map(|span| span.start);
        if let Some(set) = start.and_then(|start| self.override_at(start)) {
            refusal.set = Some(shortened(set, MOST_SHOWN));
            return Error::Case(Box::new(refusal));
        }
        refusal.file = Some(self.name.to_owned());
        if let Some(start) = start {
            let Position { line, column, content } = position(self.text, start);
            let shown: String = content.chars().take(MOST_SHOWN).collect();
            let gutter = " ".repeat(line.to_string().len());
            let before = " ".repeat(column.min(MOST_SHOWN));
            (refusal.line, refusal.column) = (Some(line), Some(column + 1));
            refusal.excerpt = Some(format!("{gutter} |\n{line} | {shown}\n{gutter} | {before}^"));
        }
        Error::Case(Box::new(refusal))
    }

    /// The whole file as JSON. A number that JSON cannot represent is null, or text if it is whole.
    pub fn json(&self) -> Value {
        json(&self.root)
    }

    /// Every value that is given, by its key. Entries of lists have their index in the key.
    pub fn settings(&self) -> BTreeMap<String, String> {
        let mut settings = BTreeMap::new();
        collect(&self.root, "", &mut settings);
        settings
    }
}

/// A place in a text.
struct Position<'t> {
    /// From 1.
    line: usize,
    /// In characters, from 0.
    column: usize,
    /// The text of the line.
    content: &'t str,
}

fn position(text: &str, offset: usize) -> Position<'_> {
    let before = &text[..offset.min(text.len())];
    let start = before.rfind('\n').map_or(0, |i| i + 1);
    Position {
        line: before.matches('\n').count() + 1,
        column: before[start..].chars().count(),
        content: text[start..].lines().next().unwrap_or(""),
    }
}

/// Whether the first part of the dotted key `rest` is `key`.
fn begins_with(rest: &str, key: &str) -> bool {
    let after = rest.strip_prefix(key);
    !key.is_empty() && after.is_some_and(|after| after.is_empty() || after.starts_with('.'))
}

/// A value of `--set` that is not TOML: a list with formulas that are not quoted, or a text.
fn text_value<'t>(text: &'t str, span: &Range<usize>) -> DeValue<'t> {
    let list = text.strip_prefix('[').and_then(|rest| rest.strip_suffix(']'));
    let entries = list.map(entries_of).filter(|entries| entries.iter().all(|e| !e.is_empty()));
    let Some(entries) = entries else { return DeValue::String(text.into()) };
    let entry = |text: &&'t str| match DeValue::parse(text) {
        Ok(value) => with_span(value.into_inner(), span),
        Err(_) => Spanned::new(span.clone(), DeValue::String((*text).into())),
    };
    DeValue::Array(entries.iter().map(entry).collect())
}

/// Puts `value` into the tree `root`, at the key of these `parts`. Missing tables are made.
///
/// # Errors
/// What is no index, or no table.
fn put<'t>(
    root: &mut DeValue<'t>,
    parts: &[&'t str],
    value: Spanned<DeValue<'t>>,
) -> std::result::Result<(), String> {
    let Some((&last, before)) = parts.split_last() else { return Ok(()) };
    let span = value.span();
    let mut place = root;
    for (depth, &part) in before.iter().enumerate() {
        place = match place {
            DeValue::Table(table) => {
                let empty = || Spanned::new(span.clone(), DeValue::Table(DeTable::new()));
                let key = Spanned::new(span.clone(), part.into());
                table.entry(key).or_insert_with(empty).get_mut()
            }
            other => item(other, part, &before[..depth])?.get_mut(),
        };
    }
    match place {
        DeValue::Table(table) => {
            // The old key is removed too, as `insert` would keep its span.
            table.remove(last);
            table.insert(Spanned::new(span, last.into()), value);
        }
        other => *item(other, last, before)? = value,
    }
    Ok(())
}

/// The item with the number `index` of the list that `path` leads to.
fn item<'a, 't>(
    list: &'a mut DeValue<'t>,
    index: &str,
    path: &[&str],
) -> std::result::Result<&'a mut Spanned<DeValue<'t>>, String> {
    let path = path.join(".");
    let DeValue::Array(list) = list else { return Err(format!("{path} is not a table")) };
    let length = list.len();
    index.parse::<usize>().ok().and_then(|i| list.get_mut(i)).ok_or_else(|| {
        format!("\"{index}\" is no index into {path}, which has {length} entries, counted from 0")
    })
}

/// The entries of a list, separated by commas outside of brackets and quotes.
fn entries_of(list: &str) -> Vec<&str> {
    let (mut depth, mut quote) = (0, None);
    let is_between = |c: char| {
        match (quote, c) {
            (Some(open), _) if c == open => quote = None,
            (Some(_), _) => {}
            (None, '"' | '\'') => quote = Some(c),
            (None, '(' | '[' | '{') => depth += 1,
            (None, ')' | ']' | '}') => depth -= 1,
            _ => {}
        }
        c == ',' && depth == 0 && quote.is_none()
    };
    list.split(is_between).map(str::trim).collect()
}

/// `value` with `span` as the span of it and of everything in it.
fn with_span<'t>(value: DeValue<'t>, span: &Range<usize>) -> Spanned<DeValue<'t>> {
    let value = match value {
        DeValue::Array(list) => {
            let items = list.into_iter().map(|item| with_span(item.into_inner(), span));
            DeValue::Array(items.collect())
        }
        DeValue::Table(table) => {
            let entries = table.into_iter().map(|(key, value)| {
                let key = Spanned::new(span.clone(), key.into_inner());
                (key, with_span(value.into_inner(), span))
            });
            DeValue::Table(entries.collect())
        }
        other => other,
    };
    Spanned::new(span.clone(), value)
}

/// The key that a `--set` option changes, and those of all values that it gives below it.
pub fn keys_of(set: &str) -> BTreeSet<String> {
    let value = set.split_once('=').map_or("", |(_, value)| value.trim());
    let (key, mut settings) = (key_of(set), BTreeMap::new());
    // What is no value is text without quotes.
    if let Ok(value) = DeValue::parse(value) {
        collect(value.get_ref(), &key, &mut settings);
    }
    settings.into_keys().chain([key]).collect()
}

/// Adds the values at `path` and below to `settings`.
fn collect(value: &DeValue<'_>, path: &str, settings: &mut BTreeMap<String, String>) {
    let text = match value {
        DeValue::Table(table) => {
            return (table.iter()).for_each(|(key, value)| {
                collect(value.get_ref(), &joined_key(path, key.get_ref()), settings);
            });
        }
        DeValue::Array(list) => {
            return (list.iter().enumerate()).for_each(|(i, value)| {
                collect(value.get_ref(), &joined_key(path, &i.to_string()), settings);
            });
        }
        DeValue::String(text) => format!("{text:?}"),
        DeValue::Float(number) => match number.as_str().parse::<f64>() {
            Ok(number) if number.is_finite() => number.to_string(),
            _ => number.as_str().to_owned(),
        },
        other => value_text(other),
    };
    settings.insert(path.to_owned(), text);
}

/// A value as JSON.
fn json(value: &DeValue<'_>) -> Value {
    match value {
        DeValue::Table(table) => {
            let entries = table.iter();
            entries.map(|(key, value)| (key.get_ref().to_string(), json(value.get_ref()))).collect()
        }
        DeValue::Array(list) => list.iter().map(|item| json(item.get_ref())).collect(),
        DeValue::Integer(number) => match integer(number) {
            Some(number) => number.into(),
            None => number.as_str().into(),
        },
        DeValue::Float(number) => number.as_str().parse::<f64>().unwrap_or(f64::NAN).into(),
        DeValue::Boolean(b) => (*b).into(),
        DeValue::String(text) => text.as_ref().into(),
        DeValue::Datetime(date) => date.to_string().into(),
    }
}

/// A value as messages show it.
fn value_text(value: &DeValue<'_>) -> String {
    match value {
        DeValue::String(text) => format!("\"{}\"", shortened(text, MOST_SHOWN)),
        DeValue::Integer(number) => shortened(&decimal(number), MOST_SHOWN),
        DeValue::Float(number) => shortened(number.as_str(), MOST_SHOWN),
        DeValue::Datetime(date) => date.to_string(),
        DeValue::Boolean(b) => b.to_string(),
        DeValue::Array(list) => {
            let items = list.iter().take(8).map(|item| value_text(item.get_ref()));
            let items: Vec<String> = items.collect();
            let more = if list.len() > 8 { ", …" } else { "" };
            shortened(&format!("[{}{more}]", items.join(", ")), MOST_SHOWN)
        }
        DeValue::Table(_) => "a table".into(),
    }
}
