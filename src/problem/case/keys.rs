//! The keys that a case file may have, found by deserializing from a source that has every key.
//!
//! The tables of the sections are the only list of keys. A [`Deserializer`] that returns a value of
//! the requested kind for every key records which keys exist and what kind each expects.

use crate::problem::case::reader::{LIST, Mistake, NUMBER_OR, SWITCHES};
use serde::de::value::{MapDeserializer, SeqDeserializer, StrDeserializer, StringDeserializer};
use serde::de::{self, DeserializeOwned, Deserializer, IntoDeserializer, Visitor};
use std::cell::RefCell;
use std::iter;

/// The kind of value that a key expects.
#[derive(Clone, Debug, Default, PartialEq)]
pub enum ValueKind {
    /// No value was requested.
    #[default]
    Unknown,
    /// A number, or a formula of constants.
    Number,
    /// A whole number.
    Whole,
    /// True or false.
    Switch,
    /// Any text.
    Text,
    /// A formula: a text, or a number.
    Formula,
    /// One of these words.
    Word(&'static [&'static str]),
    /// A number, a formula of constants, or one of these words.
    NumberOr(&'static [&'static str]),
    /// A list.
    List(Box<ValueKind>),
    /// A table with these keys.
    Table(Vec<(&'static str, ValueKind)>),
    /// A table with these switches, or one switch for all of them.
    Switches(Vec<(&'static str, ValueKind)>),
    /// A table with keys of any name.
    Names(Box<ValueKind>),
}

impl ValueKind {
    /// Adds the keys below `path` that are no tables to `found`, with their kinds; `N` stands for
    /// the index in a list.
    fn add_leaves(&self, path: &str, found: &mut Vec<(String, ValueKind)>) {
        match self {
            Self::Table(entries) | Self::Switches(entries) => {
                for (name, kind) in entries {
                    kind.add_leaves(&format!("{path}.{name}"), found);
                }
            }
            Self::List(item) => item.add_leaves(&format!("{path}.N"), found),
            other => found.push((path.trim_start_matches('.').to_owned(), other.clone())),
        }
    }

    /// The keys that are no tables and end in `name`, as in `scheme.degree`.
    pub fn ending_in(&self, name: &str) -> Vec<String> {
        let mut all = Vec::new();
        self.add_leaves("", &mut all);
        let keys = all.into_iter().map(|(key, _)| key);
        keys.filter(|key| key.rsplit('.').next() == Some(name)).collect()
    }
}

/// The keys of `T`.
pub fn of<T: DeserializeOwned>() -> ValueKind {
    let kind = RefCell::default();
    // The values that are read are placeholders, and are dropped.
    let read = T::deserialize(KindRecorder { kind: &kind });
    debug_assert!(read.is_ok());
    kind.into_inner()
}

/// A deserializer that accepts every type, and records which one was requested.
#[derive(Clone, Copy)]
struct KindRecorder<'a> {
    /// The requested kind.
    kind: &'a RefCell<ValueKind>,
}

impl IntoDeserializer<'_, Mistake> for KindRecorder<'_> {
    type Deserializer = Self;

    fn into_deserializer(self) -> Self {
        self
    }
}

/// What a visitor made of a table, and the kind of each of its entries.
struct ReadTable<T> {
    value: T,
    kinds: Vec<(&'static str, ValueKind)>,
}

/// Lets `visitor` read a table with an entry for each of `names`.
fn read_table<'de, V: Visitor<'de>>(
    names: &[&'static str],
    visitor: V,
) -> Result<ReadTable<V::Value>, Mistake> {
    let kinds: Vec<RefCell<ValueKind>> = names.iter().map(|_| RefCell::default()).collect();
    let entries = names.iter().zip(&kinds).map(|(&name, kind)| (name, KindRecorder { kind }));
    let value = visitor.visit_map(MapDeserializer::new(entries))?;
    let kinds = kinds.into_iter().map(RefCell::into_inner);
    Ok(ReadTable { value, kinds: names.iter().copied().zip(kinds).collect() })
}

impl<'de> Deserializer<'de> for KindRecorder<'_> {
    type Error = Mistake;

    fn deserialize_any<V: Visitor<'de>>(self, _: V) -> Result<V::Value, Mistake> {
        Err(de::Error::custom("a value of any kind is requested"))
    }

    fn deserialize_f64<V: Visitor<'de>>(self, visitor: V) -> Result<V::Value, Mistake> {
        self.kind.replace(ValueKind::Number);
        visitor.visit_f64(1.0)
    }

    fn deserialize_i64<V: Visitor<'de>>(self, visitor: V) -> Result<V::Value, Mistake> {
        self.kind.replace(ValueKind::Whole);
        visitor.visit_i64(1)
    }

    fn deserialize_bool<V: Visitor<'de>>(self, visitor: V) -> Result<V::Value, Mistake> {
        self.kind.replace(ValueKind::Switch);
        visitor.visit_bool(true)
    }

    fn deserialize_string<V: Visitor<'de>>(self, visitor: V) -> Result<V::Value, Mistake> {
        self.kind.replace(ValueKind::Text);
        visitor.visit_str("")
    }

    fn deserialize_option<V: Visitor<'de>>(self, visitor: V) -> Result<V::Value, Mistake> {
        visitor.visit_some(self)
    }

    fn deserialize_newtype_struct<V: Visitor<'de>>(
        self,
        _: &'static str,
        visitor: V,
    ) -> Result<V::Value, Mistake> {
        self.kind.replace(ValueKind::Formula);
        let text: StringDeserializer<Mistake> = "1".to_owned().into_deserializer();
        visitor.visit_newtype_struct(text)
    }

    fn deserialize_seq<V: Visitor<'de>>(self, visitor: V) -> Result<V::Value, Mistake> {
        let item = RefCell::default();
        let read =
            visitor.visit_seq(SeqDeserializer::new(iter::once(KindRecorder { kind: &item })))?;
        self.kind.replace(ValueKind::List(Box::new(item.into_inner())));
        Ok(read)
    }

    fn deserialize_tuple_struct<V: Visitor<'de>>(
        self,
        name: &'static str,
        _: usize,
        visitor: V,
    ) -> Result<V::Value, Mistake> {
        debug_assert_eq!(name, LIST);
        self.deserialize_seq(visitor)
    }

    fn deserialize_map<V: Visitor<'de>>(self, visitor: V) -> Result<V::Value, Mistake> {
        let mut read = read_table(&["name"], visitor)?;
        let kind = read.kinds.pop().map(|(_, kind)| kind);
        self.kind.replace(ValueKind::Names(Box::new(kind.unwrap_or_default())));
        Ok(read.value)
    }

    fn deserialize_struct<V: Visitor<'de>>(
        self,
        name: &'static str,
        known: &'static [&'static str],
        visitor: V,
    ) -> Result<V::Value, Mistake> {
        let ReadTable { value, kinds } = read_table(known, visitor)?;
        self.kind.replace(match name {
            SWITCHES => ValueKind::Switches(kinds),
            _ => ValueKind::Table(kinds),
        });
        Ok(value)
    }

    fn deserialize_enum<V: Visitor<'de>>(
        self,
        name: &'static str,
        words: &'static [&'static str],
        visitor: V,
    ) -> Result<V::Value, Mistake> {
        if name == NUMBER_OR {
            self.kind.replace(ValueKind::NumberOr(words));
            return visitor.visit_f64(1.0);
        }
        self.kind.replace(ValueKind::Word(words));
        visitor.visit_enum(StrDeserializer::new(words[0]))
    }

    serde::forward_to_deserialize_any! {
        i8 i16 i32 i128 u8 u16 u32 u64 u128 f32 char str bytes byte_buf unit unit_struct tuple
        identifier ignored_any
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn every_key_has_a_kind() {
        let mut found = Vec::new();
        crate::problem::case::keys().add_leaves("", &mut found);
        assert!(found.len() > 60, "{found:?}");
        assert!(found.iter().all(|(_, kind)| *kind != ValueKind::Unknown), "{found:?}");
        let is = |key: &str| &found.iter().find(|(name, _)| name == key).expect(key).1;
        assert_eq!(*is("time.end"), ValueKind::Number);
        assert_eq!(*is("axis.N.x.cells"), ValueKind::Whole);
        assert_eq!(*is("potential.N.value"), ValueKind::Formula);
        assert_eq!(*is("solver.method"), ValueKind::Word(&["schrodingerized", "classical"]));
        assert_eq!(*is("solver.warp.delta"), ValueKind::NumberOr(&["max"]));
        assert_eq!(*is("solver.warp.alpha"), ValueKind::Formula);
        assert_eq!(*is("output.field_times.N"), ValueKind::Number);
        assert_eq!(*is("solver.reduce.axes"), ValueKind::Switch);
    }
}
