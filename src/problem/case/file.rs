//! Reading TOML so that every mistake is named with file, line, key, value and limit.
//!
//! A case file becomes a tree of [`Node`]s that remember where they stand. `--set key=value` replaces nodes of the tree.

use crate::base::error::{Error, Result};
use std::collections::BTreeMap;
use toml::de::{DeTable, DeValue};

/// Where a node comes from.
#[derive(Clone, Debug)]
enum Origin {
    /// Byte range of the case file.
    File(std::ops::Range<usize>),
    /// The text of a `--set`.
    Set(String),
    /// A table made on the way to a `--set`, or the root.
    Nowhere,
}

#[derive(Clone, Debug)]
enum Value {
    Text(String),
    Integer(i64),
    /// An integer beyond 64 bits, or a float; the text is what the user wrote.
    Number(f64, String),
    Boolean(bool),
    List(Vec<Node>),
    Table(BTreeMap<String, Node>),
    /// Dates, which no key takes.
    Other(String),
}

/// A value of the case file and its place.
#[derive(Clone, Debug)]
pub struct Node {
    value: Value,
    origin: Origin,
    /// Where its key stands; the same as `origin` where there is none.
    key: Origin,
}

/// The whole file: its name, its text and its root table.
#[derive(Debug)]
pub struct CaseFile {
    name: String,
    text: String,
    root: Node,
    /// Stands for every table that is absent.
    empty: Node,
}

/// A text as messages show it.
fn shortened(text: &str) -> String {
    const MOST: usize = 120;
    if text.chars().count() <= MOST {
        return text.to_owned();
    }
    text.chars().take(MOST).chain("…".chars()).collect()
}

fn line_of(text: &str, offset: usize) -> (usize, usize, &str) {
    let before = &text[..offset.min(text.len())];
    let line = before.matches('\n').count() + 1;
    let start = before.rfind('\n').map_or(0, |i| i + 1);
    let content = text[start..].lines().next().unwrap_or("");
    (
        line,
        text[start..offset.min(text.len())].chars().count(),
        content,
    )
}

fn convert(value: &DeValue<'_>, span: std::ops::Range<usize>) -> Node {
    let value = match value {
        DeValue::String(s) => Value::Text(s.to_string()),
        DeValue::Integer(i) => match i64::from_str_radix(i.as_str(), i.radix()) {
            Ok(integer) => Value::Integer(integer),
            Err(_) => Value::Number(f64::INFINITY, i.as_str().to_owned()),
        },
        DeValue::Float(f) => Value::Number(
            f.as_str().parse().unwrap_or(f64::NAN),
            f.as_str().to_owned(),
        ),
        DeValue::Boolean(b) => Value::Boolean(*b),
        DeValue::Datetime(d) => Value::Other(d.to_string()),
        DeValue::Array(list) => Value::List(
            list.iter()
                .map(|v| convert(v.get_ref(), v.span()))
                .collect(),
        ),
        DeValue::Table(table) => Value::Table(convert_table(table)),
    };
    Node {
        value,
        origin: Origin::File(span.clone()),
        key: Origin::File(span),
    }
}

fn convert_table(table: &DeTable<'_>) -> BTreeMap<String, Node> {
    table
        .iter()
        .map(|(key, value)| {
            // The span of the key, so that a mistake in a table points at its heading.
            let span = match value.get_ref() {
                DeValue::Table(_) => key.span(),
                _ => value.span(),
            };
            {
                let node = Node {
                    key: Origin::File(key.span()),
                    ..convert(value.get_ref(), span)
                };
                (key.get_ref().to_string(), node)
            }
        })
        .collect()
}

impl CaseFile {
    /// Parses `text` (the file `name`) and applies `--set` overrides in order.
    pub fn parse(name: &str, text: &str, overrides: &[String]) -> Result<Self> {
        let empty = Node {
            value: Value::Table(BTreeMap::new()),
            origin: Origin::Nowhere,
            key: Origin::Nowhere,
        };
        let mut file = CaseFile {
            name: name.to_owned(),
            text: text.to_owned(),
            root: empty.clone(),
            empty,
        };
        let table = DeTable::parse(text).map_err(|e| {
            let at = e.span().map(Origin::File).unwrap_or(Origin::Nowhere);
            file.error_at(&at, e.message())
        })?;
        file.root.value = Value::Table(convert_table(table.get_ref()));
        for text in overrides {
            file.set(text)?;
        }
        Ok(file)
    }

    fn error_at(&self, origin: &Origin, message: &str) -> Error {
        Error::Input(match origin {
            Origin::File(span) => {
                let (line, column, content) = line_of(&self.text, span.start);
                let shown: String = content.chars().take(120).collect();
                let gutter = " ".repeat(line.to_string().len());
                format!(
                    "{}:{line}:{}: {message}\n{gutter} |\n{line} | {shown}\n{gutter} | {}^",
                    self.name,
                    column + 1,
                    " ".repeat(column.min(120))
                )
            }
            Origin::Set(text) => format!("--set {}: {message}", shortened(text)),
            Origin::Nowhere => format!("{}: {message}", self.name),
        })
    }

    fn set(&mut self, text: &str) -> Result<()> {
        let origin = Origin::Set(text.to_owned());
        let Some((path, value)) = text.split_once('=') else {
            return Err(self.error_at(&origin, "expected key=value"));
        };
        // A value that is no TOML is taken as text, so that shells need no second pair of quotes.
        let parsed = DeValue::parse(value.trim());
        let mut node = match &parsed {
            Ok(v) => convert(v.get_ref(), 0..0),
            Err(_) => Node {
                value: Value::Text(value.trim().to_owned()),
                origin: origin.clone(),
                key: origin.clone(),
            },
        };
        node.mark(&origin);
        let parts: Vec<&str> = path.split('.').map(str::trim).collect();
        if parts.iter().any(|p| p.is_empty()) {
            return Err(self.error_at(&origin, "expected key=value, the key without empty parts"));
        }
        let mut place = &mut self.root;
        for (depth, part) in parts.iter().enumerate() {
            let last = depth + 1 == parts.len();
            place = match &mut place.value {
                Value::Table(table) => {
                    if last {
                        table.insert((*part).to_owned(), node);
                        return Ok(());
                    }
                    table.entry((*part).to_owned()).or_insert_with(|| Node {
                        value: Value::Table(BTreeMap::new()),
                        origin: origin.clone(),
                        key: origin.clone(),
                    })
                }
                Value::List(list) => {
                    let length = list.len();
                    match part.parse::<usize>().ok().and_then(|i| list.get_mut(i)) {
                        Some(item) if last => {
                            *item = node;
                            return Ok(());
                        }
                        Some(item) => item,
                        None => {
                            let message = format!(
                                "\"{part}\" is no index into {}, which has {length} entries, counted from 0",
                                parts[..depth].join(".")
                            );
                            return Err(self.error_at(&origin, &message));
                        }
                    }
                }
                _ => {
                    let message = format!("{} is not a table", parts[..depth].join("."));
                    return Err(self.error_at(&origin, &message));
                }
            };
        }
        Ok(())
    }

    /// The root table.
    pub fn root(&self) -> Table<'_> {
        Table {
            file: self,
            path: String::new(),
            node: &self.root,
        }
    }

    /// Every value that is given, by its key; those of lists by their numbers.
    pub fn settings(&self) -> BTreeMap<String, String> {
        let mut found = BTreeMap::new();
        self.root.collect("", &mut found);
        found
    }

    /// The file's text as read.
    pub fn text(&self) -> &str {
        &self.text
    }
}

impl Node {
    fn mark(&mut self, origin: &Origin) {
        self.origin = origin.clone();
        self.key = origin.clone();
        match &mut self.value {
            Value::List(list) => list.iter_mut().for_each(|n| n.mark(origin)),
            Value::Table(table) => table.values_mut().for_each(|n| n.mark(origin)),
            _ => {}
        }
    }

    /// A finite number, if it is one.
    fn finite(&self) -> Option<f64> {
        match &self.value {
            Value::Integer(i) => Some(*i as f64),
            Value::Number(x, _) if x.is_finite() => Some(*x),
            _ => None,
        }
    }

    /// Adds what is at `path` and below to `found`.
    fn collect(&self, path: &str, found: &mut BTreeMap<String, String>) {
        let below = |key: &str| match path {
            "" => key.to_owned(),
            _ => format!("{path}.{key}"),
        };
        let text = match &self.value {
            Value::Table(table) => {
                return (table.iter()).for_each(|(key, node)| node.collect(&below(key), found));
            }
            Value::List(list) => {
                let items = list.iter().enumerate();
                return items.for_each(|(i, node)| node.collect(&below(&i.to_string()), found));
            }
            Value::Text(s) => format!("{s:?}"),
            Value::Integer(i) => i.to_string(),
            Value::Number(x, _) if x.is_finite() => x.to_string(),
            Value::Number(_, text) | Value::Other(text) => text.clone(),
            Value::Boolean(b) => b.to_string(),
        };
        found.insert(path.to_owned(), text);
    }

    fn describe(&self) -> String {
        match &self.value {
            Value::Text(s) => format!("\"{}\"", shortened(s)),
            Value::Integer(i) => i.to_string(),
            Value::Number(_, text) | Value::Other(text) => shortened(text),
            Value::Boolean(b) => b.to_string(),
            Value::List(list) => {
                let items: Vec<String> = list.iter().take(8).map(Node::describe).collect();
                let more = if list.len() > 8 { ", …" } else { "" };
                shortened(&format!("[{}{more}]", items.join(", ")))
            }
            Value::Table(_) => "a table".into(),
        }
    }
}

/// A table being read.
#[derive(Clone, Debug)]
pub struct Table<'a> {
    file: &'a CaseFile,
    path: String,
    node: &'a Node,
}

impl<'a> Table<'a> {
    fn entries(&self) -> Option<&'a BTreeMap<String, Node>> {
        match &self.node.value {
            Value::Table(table) => Some(table),
            _ => None,
        }
    }

    fn key(&self, key: &str) -> String {
        if self.path.is_empty() {
            key.to_owned()
        } else {
            format!("{}.{key}", self.path)
        }
    }

    fn get(&self, key: &str) -> Option<&'a Node> {
        self.entries()?.get(key)
    }

    /// An error about `key`, pointing at its place.
    pub fn error(&self, key: &str, message: &str) -> Error {
        match self.get(key) {
            Some(node) => self.file.error_at(
                &node.origin,
                &format!("{} = {}: {message}", self.key(key), node.describe()),
            ),
            None => self
                .file
                .error_at(&self.node.origin, &format!("{}: {message}", self.key(key))),
        }
    }

    fn wrong(&self, key: &str, expected: &str) -> Error {
        self.error(key, &format!("{expected} expected"))
    }

    /// Whether `key` is given.
    pub fn has(&self, key: &str) -> bool {
        self.get(key).is_some()
    }

    /// Whether `key` is given as text.
    pub fn is_text(&self, key: &str) -> bool {
        matches!(self.get(key).map(|n| &n.value), Some(Value::Text(_)))
    }

    /// Whether `key` is given as true or false.
    pub fn is_boolean(&self, key: &str) -> bool {
        matches!(self.get(key).map(|n| &n.value), Some(Value::Boolean(_)))
    }

    /// A table below this one; an empty one when absent.
    pub fn table(&self, key: &str) -> Result<Table<'a>> {
        let node = self.get(key).unwrap_or(&self.file.empty);
        let table = Table {
            file: self.file,
            path: self.key(key),
            node,
        };
        if table.entries().is_none() {
            return Err(self.wrong(key, "a table"));
        }
        Ok(table)
    }

    /// A list of tables; empty when absent.
    pub fn tables(&self, key: &str) -> Result<Vec<Table<'a>>> {
        let Some(node) = self.get(key) else {
            return Ok(Vec::new());
        };
        let Value::List(list) = &node.value else {
            return Err(self.wrong(key, &format!("a list of tables, [[{}]],", self.key(key))));
        };
        list.iter()
            .enumerate()
            .map(|(i, node)| match node.value {
                Value::Table(_) => Ok(Table {
                    file: self.file,
                    path: format!("{}.{i}", self.key(key)),
                    node,
                }),
                _ => Err(self.wrong(key, "a list of tables")),
            })
            .collect()
    }

    /// Text, if given.
    pub fn text(&self, key: &str) -> Result<Option<String>> {
        match self.get(key).map(|n| &n.value) {
            None => Ok(None),
            Some(Value::Text(s)) => Ok(Some(s.clone())),
            Some(_) => Err(self.wrong(key, "text in quotes")),
        }
    }

    /// A formula's text, if given; a bare number is one too.
    pub fn formula(&self, key: &str) -> Result<Option<String>> {
        match self.get(key).map(|n| &n.value) {
            None => Ok(None),
            Some(Value::Text(s)) => Ok(Some(s.clone())),
            Some(Value::Integer(i)) => Ok(Some(i.to_string())),
            Some(Value::Number(_, text)) => Ok(Some(text.clone())),
            Some(_) => Err(self.wrong(key, "a formula in quotes")),
        }
    }

    /// The texts of a list of formulas, if given.
    pub fn formulas(&self, key: &str) -> Result<Option<Vec<String>>> {
        let Some(node) = self.get(key) else {
            return Ok(None);
        };
        let text = |node: &Node| match &node.value {
            Value::Text(s) => Some(s.clone()),
            Value::Integer(i) => Some(i.to_string()),
            Value::Number(_, text) => Some(text.clone()),
            _ => None,
        };
        let list = match &node.value {
            Value::List(list) => list.iter().map(text).collect(),
            _ => None,
        };
        list.map(Some)
            .ok_or_else(|| self.wrong(key, "a list of formulas in quotes"))
    }

    /// A finite number, if given.
    pub fn number(&self, key: &str) -> Result<Option<f64>> {
        let value = match self.get(key).map(|n| &n.value) {
            None => return Ok(None),
            Some(Value::Integer(i)) => *i as f64,
            Some(Value::Number(x, _)) => *x,
            Some(_) => return Err(self.wrong(key, "a number")),
        };
        if !value.is_finite() {
            return Err(self.wrong(key, "a finite number"));
        }
        Ok(Some(value))
    }

    /// Two finite numbers, if given.
    pub fn pair(&self, key: &str) -> Result<Option<[f64; 2]>> {
        let expected = "a list of two numbers, [L, R],";
        match self.list_of_numbers(key, expected)?.as_deref() {
            None => Ok(None),
            Some(&[first, second]) => Ok(Some([first, second])),
            Some(_) => Err(self.wrong(key, expected)),
        }
    }

    /// A list of finite numbers, if given.
    pub fn numbers(&self, key: &str) -> Result<Option<Vec<f64>>> {
        self.list_of_numbers(key, "a list of numbers")
    }

    fn list_of_numbers(&self, key: &str, expected: &str) -> Result<Option<Vec<f64>>> {
        let list = match self.get(key).map(|n| &n.value) {
            None => return Ok(None),
            Some(Value::List(list)) => list,
            Some(_) => return Err(self.wrong(key, expected)),
        };
        let numbers: Option<Vec<f64>> = list.iter().map(Node::finite).collect();
        numbers.map(Some).ok_or_else(|| self.wrong(key, expected))
    }

    /// A list of lists of `length` finite numbers each, if given.
    pub fn rows(&self, key: &str, length: usize) -> Result<Option<Vec<Vec<f64>>>> {
        let Some(node) = self.get(key) else {
            return Ok(None);
        };
        let row = |node: &Node| match &node.value {
            Value::List(list) if list.len() == length => list.iter().map(Node::finite).collect(),
            _ => None,
        };
        let rows: Option<Vec<Vec<f64>>> = match &node.value {
            Value::List(list) => list.iter().map(row).collect(),
            _ => None,
        };
        let plural = if length == 1 { "" } else { "s" };
        rows.map(Some).ok_or_else(|| {
            self.wrong(
                key,
                &format!("a list of lists of {length} number{plural} each"),
            )
        })
    }

    /// A finite number that must be given.
    pub fn required_number(&self, key: &str) -> Result<f64> {
        self.number(key)?
            .ok_or_else(|| self.error(key, "missing; a number expected"))
    }

    /// A whole number at least `least`, if given.
    pub fn count(&self, key: &str, least: i64) -> Result<Option<usize>> {
        match self.get(key).map(|n| &n.value) {
            None => Ok(None),
            Some(Value::Integer(i)) if *i >= least => Ok(Some(*i as usize)),
            Some(Value::Integer(_)) => Err(self.error(key, &format!("must be at least {least}"))),
            Some(_) => Err(self.wrong(key, "a whole number")),
        }
    }

    /// A list of `length` whole numbers from 1 on, if given.
    pub fn counts(&self, key: &str, length: usize) -> Result<Option<Vec<usize>>> {
        let Some(node) = self.get(key) else {
            return Ok(None);
        };
        let count = |node: &Node| match &node.value {
            Value::Integer(i) if *i >= 1 => usize::try_from(*i).ok(),
            _ => None,
        };
        let list: Option<Vec<usize>> = match &node.value {
            Value::List(list) if list.len() == length => list.iter().map(count).collect(),
            _ => None,
        };
        list.map(Some)
            .ok_or_else(|| self.wrong(key, &format!("a list of {length} whole numbers above 0")))
    }

    /// A yes or no, if given.
    pub fn boolean(&self, key: &str) -> Result<Option<bool>> {
        match self.get(key).map(|n| &n.value) {
            None => Ok(None),
            Some(Value::Boolean(b)) => Ok(Some(*b)),
            Some(_) => Err(self.wrong(key, "true or false")),
        }
    }

    /// One of the named choices; the first is the default.
    pub fn choice<T: Copy>(&self, key: &str, choices: &[(&str, T)]) -> Result<T> {
        let Some(text) = self.text(key)? else {
            return Ok(choices[0].1);
        };
        if let Some((_, value)) = choices.iter().find(|(name, _)| *name == text) {
            return Ok(*value);
        }
        let names: Vec<&str> = choices.iter().map(|(name, _)| *name).collect();
        Err(self.error(
            key,
            &format!(
                "not one of {}{}",
                names
                    .iter()
                    .map(|n| format!("\"{n}\""))
                    .collect::<Vec<_>>()
                    .join(", "),
                nearest(&text, &names)
            ),
        ))
    }

    /// File, line and name of `key`, for errors that are found later.
    pub fn place(&self, key: &str) -> String {
        let name = self.key(key);
        match self.get(key).map(|n| &n.origin) {
            Some(Origin::File(span)) => {
                let (line, ..) = line_of(&self.file.text, span.start);
                format!("{}:{line}: {name}", self.file.name)
            }
            Some(Origin::Set(text)) => format!("--set {}: {name}", shortened(text)),
            _ => format!("{}: {name}", self.file.name),
        }
    }

    /// This table, if it holds keys of `known` only. To be called before any key is read, so that a misspelt key is
    /// named before the one it stands for is missed.
    ///
    /// # Errors
    /// Names the unknown key and the nearest of `known`.
    pub fn knowing(self, known: &[&str]) -> Result<Self> {
        for (key, node) in self.entries().into_iter().flatten() {
            if !known.contains(&key.as_str()) {
                return Err(self.file.error_at(
                    &node.key,
                    &format!(
                        "unknown key {}{}; known here: {}",
                        self.key(key),
                        nearest(key, known),
                        known.join(", ")
                    ),
                ));
            }
        }
        Ok(self)
    }
}

/// ` (did you mean "…"?)` when one of `known` is close to `given`.
fn nearest(given: &str, known: &[&str]) -> String {
    known
        .iter()
        .map(|k| (strsim::damerau_levenshtein(given, k), k))
        .min()
        .filter(|(distance, k)| *distance <= 1 + k.len() / 3)
        .map_or(String::new(), |(_, k)| format!(" (did you mean \"{k}\"?)"))
}
