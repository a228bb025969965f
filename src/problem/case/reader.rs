//! A deserializer for values of the case file, with error messages for people who do not know Rust.
//!
//! The deserializer of the crate `toml` says "expected f64" and lists all known keys. This one
//! names the key, says what is expected there, and suggests the nearest known name.

use crate::problem::formula::{Constants, Expression, is_word};
use serde::de::value::{MapDeserializer, SeqAccessDeserializer, SeqDeserializer, StrDeserializer};
use serde::de::{
    self, Deserialize, DeserializeOwned, Deserializer, Expected, IntoDeserializer, SeqAccess,
    Unexpected, Visitor,
};
use std::fmt::{self, Display, Formatter};
use std::marker::PhantomData;
use toml::Spanned;
use toml::de::{DeInteger, DeTable, DeValue};

/// A mistake in a case file.
#[derive(Debug, thiserror::Error)]
#[error("{message}")]
pub struct Mistake {
    /// The full key of the mistake, once it is known.
    pub key: Option<String>,
    /// Whether there is no such key.
    pub unknown: bool,
    /// A sentence that says what is wrong, or what is expected.
    pub message: String,
}

impl Mistake {
    fn expected(what: impl Display) -> Self {
        de::Error::custom(format!("{what} expected"))
    }

    /// This mistake with `key`, unless it has a key already.
    fn at(mut self, key: &str) -> Self {
        self.key.get_or_insert_with(|| key.to_owned());
        self
    }
}

impl de::Error for Mistake {
    fn custom<T: Display>(message: T) -> Self {
        Self { key: None, unknown: false, message: message.to_string() }
    }

    fn invalid_type(_: Unexpected<'_>, expected: &dyn Expected) -> Self {
        Self::expected(expected)
    }

    fn unknown_variant(given: &str, known: &'static [&'static str]) -> Self {
        let quoted: Vec<String> = known.iter().map(|name| format!("\"{name}\"")).collect();
        let quoted = quoted.join(", ");
        Self::custom(format!("not one of {quoted}{}", nearest(given, known)))
    }
}

/// ` (did you mean "…"?)` if one of `known` is close to `given`, else nothing.
fn nearest(given: &str, known: &[&str]) -> String {
    known
        .iter()
        .map(|k| (strsim::damerau_levenshtein(given, k), k))
        .min()
        .filter(|(distance, k)| *distance <= 1 + k.len() / 3)
        .map_or(String::new(), |(_, k)| format!(" (did you mean \"{k}\"?)"))
}

/// ` as { … }`: an example of the table that the struct `name` reads, with the `given` text in it.
/// Empty for tables that need no example.
fn example(name: &str, given: &DeValue<'_>) -> String {
    let text = given.as_str();
    let quoted = |other: &str| format!("{:?}", text.unwrap_or(other));
    let inner = match name {
        "FileTable" => format!("file = {}", quoted("V.csv")),
        "AxisTable" => "lower = -1.0, upper = 1.0, cells = 64".to_owned(),
        "RegionTable" | "InflowTable" => format!("value = {}", quoted("0")),
        "InitialTable" => format!("f = {}", quoted("exp(-x^2 - v^2)")),
        "TimeTable" => "end = 1.0".to_owned(),
        "ExactTable" => "kind = \"characteristics\"".to_owned(),
        _ => return String::new(),
    };
    format!(" as {{ {inner} }}")
}

/// The number, if it fits into 64 bits.
pub fn integer(number: &DeInteger<'_>) -> Option<i64> {
    i64::from_str_radix(number.as_str(), number.radix()).ok()
}

/// `number`, if it is a whole number below 2^53, up to which floats tell all whole numbers apart.
fn whole(number: f64) -> Option<i64> {
    let is_whole = number.fract() == 0.0 && number.abs() < (1u64 << 53) as f64;
    is_whole.then_some(number as i64)
}

/// A whole number in decimal digits if it fits into 64 bits, else as it was given.
pub fn decimal(number: &DeInteger<'_>) -> String {
    integer(number).map_or_else(|| number.as_str().to_owned(), |number| number.to_string())
}

/// The key `name` of the table `path`.
pub fn joined_key(path: &str, name: &str) -> String {
    match path {
        "" => name.to_owned(),
        _ => format!("{path}.{name}"),
    }
}

/// A value with its key.
#[derive(Clone, Debug)]
pub struct KeyValue<'t> {
    key: String,
    value: &'t DeValue<'t>,
    /// Constants that a formula in the place of a number may name.
    constants: &'t Constants,
}

/// The key that a `--set` option changes, without blanks around its parts.
pub fn key_of(set: &str) -> String {
    let key = set.split('=').next().unwrap_or_default();
    key.split('.').map(str::trim).collect::<Vec<_>>().join(".")
}

/// Whether the key `inner` is `outer`, or that of a value below it.
pub fn is_within(inner: &str, outer: &str) -> bool {
    inner.strip_prefix(outer).is_some_and(|rest| rest.is_empty() || rest.starts_with('.'))
}

/// The value of a formula of constants that is given instead of a number.
///
/// # Errors
/// The mistake in the formula.
pub fn number_of(text: &str, constants: &Constants) -> Result<f64, String> {
    Expression::parse(text, &[], constants).map(|formula| formula.eval(&[]))
}

impl<'t> KeyValue<'t> {
    /// The value of `key`; an empty `key` stands for the whole file.
    pub fn new(key: &str, value: &'t DeValue<'t>, constants: &'t Constants) -> Self {
        Self { key: key.to_owned(), value, constants }
    }

    /// The entry `name` of a table or a list.
    fn below(&self, name: &str, value: &'t Spanned<DeValue<'t>>) -> Self {
        KeyValue {
            key: joined_key(&self.key, name),
            value: value.get_ref(),
            constants: self.constants,
        }
    }

    /// The entries of its table `table`, by name.
    fn entries(&self, table: &'t DeTable<'t>) -> impl Iterator<Item = (&'t str, Self)> {
        table.iter().map(|(name, value)| {
            let name = name.get_ref().as_ref();
            (name, self.below(name, value))
        })
    }

    /// The mistake of a value that is not of the kind `expected`.
    fn wrong<T>(&self, expected: impl Display) -> Result<T, Mistake> {
        Err(Mistake::expected(expected).at(&self.key))
    }

    /// The value as a number, or as a formula of constants.
    fn number(&self) -> Result<f64, Mistake> {
        let number = match self.value {
            DeValue::Integer(number) => integer(number).map_or(f64::INFINITY, |i| i as f64),
            DeValue::Float(number) => number.as_str().parse().unwrap_or(f64::NAN),
            DeValue::String(text) => match number_of(text, self.constants) {
                Ok(number) => number,
                Err(what) => {
                    return self.wrong(format!("{what}; a number, or a formula of constants,"));
                }
            },
            _ => return self.wrong("a number"),
        };
        if number.is_finite() { Ok(number) } else { self.wrong("a finite number") }
    }

    /// The value as the text of a formula; a number without quotes is one, too.
    fn formula(&self) -> Result<String, Mistake> {
        match self.value {
            DeValue::String(text) => Ok(text.to_string()),
            DeValue::Integer(number) => Ok(decimal(number)),
            DeValue::Float(number) => Ok(number.as_str().to_owned()),
            _ => self.wrong("a formula in quotes"),
        }
    }
}

impl<'de> IntoDeserializer<'de, Mistake> for KeyValue<'de> {
    type Deserializer = Self;

    fn into_deserializer(self) -> Self {
        self
    }
}

impl<'de> Deserializer<'de> for KeyValue<'de> {
    type Error = Mistake;

    fn deserialize_any<V: Visitor<'de>>(self, visitor: V) -> Result<V::Value, Mistake> {
        match self.value {
            DeValue::String(text) => visitor.visit_str(text),
            DeValue::Boolean(b) => visitor.visit_bool(*b),
            DeValue::Integer(_) | DeValue::Float(_) => visitor.visit_f64(self.number()?),
            DeValue::Array(list) => {
                let items = list.iter().enumerate();
                let items = items.map(|(i, value)| self.below(&i.to_string(), value));
                visitor.visit_seq(SeqDeserializer::new(items))
            }
            DeValue::Table(_) | DeValue::Datetime(_) => {
                Err(Mistake::expected(&visitor as &dyn Expected))
            }
        }
        .map_err(|mistake| mistake.at(&self.key))
    }

    fn deserialize_f64<V: Visitor<'de>>(self, visitor: V) -> Result<V::Value, Mistake> {
        visitor.visit_f64(self.number()?)
    }

    fn deserialize_i64<V: Visitor<'de>>(self, visitor: V) -> Result<V::Value, Mistake> {
        let number = match self.value {
            DeValue::Integer(number) => integer(number),
            DeValue::Float(number) => number.as_str().parse().ok().and_then(whole),
            _ => None,
        };
        match number {
            Some(number) => visitor.visit_i64(number),
            None if matches!(self.value, DeValue::String(_)) => {
                self.wrong("a whole number without quotes")
            }
            None => self.wrong("a whole number"),
        }
    }

    fn deserialize_bool<V: Visitor<'de>>(self, visitor: V) -> Result<V::Value, Mistake> {
        match self.value.as_bool() {
            Some(b) => visitor.visit_bool(b),
            None => self.wrong("true or false"),
        }
    }

    fn deserialize_string<V: Visitor<'de>>(self, visitor: V) -> Result<V::Value, Mistake> {
        match self.value.as_str() {
            Some(text) => visitor.visit_str(text),
            None => self.wrong("text in quotes"),
        }
    }

    fn deserialize_option<V: Visitor<'de>>(self, visitor: V) -> Result<V::Value, Mistake> {
        visitor.visit_some(self)
    }

    /// Reads a [`Formula`], the only newtype of case files.
    fn deserialize_newtype_struct<V: Visitor<'de>>(
        self,
        _: &'static str,
        visitor: V,
    ) -> Result<V::Value, Mistake> {
        visitor.visit_newtype_struct(self.formula()?.into_deserializer())
    }

    /// All keys are checked before any value is read, so that a misspelt key is reported as such,
    /// not as a missing one.
    fn deserialize_struct<V: Visitor<'de>>(
        self,
        name: &'static str,
        known: &'static [&'static str],
        visitor: V,
    ) -> Result<V::Value, Mistake> {
        let table = match self.value {
            DeValue::Table(table) => table,
            // One switch in place of a table of switches is the value of each of them.
            DeValue::Boolean(_) if name == SWITCHES => {
                let entries = known.iter().map(|key| (*key, self.clone()));
                return visitor.visit_map(MapDeserializer::new(entries));
            }
            _ if name == SWITCHES => return self.wrong("true, false or a table"),
            other => return self.wrong(format!("a table{}", example(name, other))),
        };
        if let Some(name) = (table.keys()).find(|name| !known.contains(&name.get_ref().as_ref())) {
            let near = nearest(name.get_ref(), known);
            return Err(Mistake {
                key: Some(joined_key(&self.key, name.get_ref())),
                unknown: true,
                message: format!("{near}; known here: {}", known.join(", ")),
            });
        }
        visitor.visit_map(MapDeserializer::new(self.entries(table)))
    }

    /// Reads a table with keys of any name.
    fn deserialize_map<V: Visitor<'de>>(self, visitor: V) -> Result<V::Value, Mistake> {
        let DeValue::Table(table) = self.value else { return self.wrong("a table") };
        visitor.visit_map(MapDeserializer::new(self.entries(table)))
    }

    fn deserialize_enum<V: Visitor<'de>>(
        self,
        name: &'static str,
        words: &'static [&'static str],
        visitor: V,
    ) -> Result<V::Value, Mistake> {
        if name == NUMBER_OR {
            // A misspelt word is reported as such, not as a formula with an unknown name.
            let is_formula = |text: &str| {
                !words.contains(&text)
                    && (!is_word(text) || number_of(text, self.constants).is_ok())
            };
            return if self.value.as_str().is_some_and(is_formula) {
                visitor.visit_f64(self.number()?)
            } else {
                self.deserialize_any(visitor)
            };
        }
        match self.value.as_str() {
            Some(text) => (visitor.visit_enum(StrDeserializer::new(text)))
                .map_err(|mistake: Mistake| mistake.at(&self.key)),
            None => self.wrong("text in quotes"),
        }
    }

    serde::forward_to_deserialize_any! {
        i8 i16 i32 i128 u8 u16 u32 u64 u128 f32 char str bytes byte_buf unit unit_struct seq tuple
        tuple_struct identifier ignored_any
    }
}

/// The text of a formula.
#[derive(Clone, Debug, serde::Deserialize)]
pub struct Formula(pub String);

/// The name of the table that one switch may replace: [`solver.reduce`].
///
/// [`solver.reduce`]: crate::problem::case::solver::AllowedReductions
pub const SWITCHES: &str = "AllowedReductions";
/// The name by which a [`List`] requests a value.
pub const LIST: &str = "List";
/// The name by which a [`NumberOr`] requests a value.
pub const NUMBER_OR: &str = "NumberOr";

/// Words that a key takes instead of a number.
pub trait Words: DeserializeOwned {
    /// The words that the key takes.
    const ALL: &'static [&'static str];
}

/// The value of a key that takes a number, or one of the words of `W`.
#[derive(Clone, Copy, Debug)]
pub enum NumberOr<W> {
    Number(f64),
    Word(W),
}

impl<'de, W: Words> Deserialize<'de> for NumberOr<W> {
    fn deserialize<D: Deserializer<'de>>(deserializer: D) -> Result<Self, D::Error> {
        struct Reader<W>(PhantomData<W>);

        impl<W: Words> Visitor<'_> for Reader<W> {
            type Value = NumberOr<W>;

            fn expecting(&self, f: &mut Formatter<'_>) -> fmt::Result {
                f.write_str("a number")
            }

            fn visit_f64<E: de::Error>(self, number: f64) -> Result<Self::Value, E> {
                Ok(NumberOr::Number(number))
            }

            fn visit_str<E: de::Error>(self, word: &str) -> Result<Self::Value, E> {
                W::deserialize(word.into_deserializer()).map(NumberOr::Word)
            }
        }

        deserializer.deserialize_enum(NUMBER_OR, W::ALL, Reader(PhantomData))
    }
}

/// An element of a [`List`].
pub trait Item: DeserializeOwned {
    /// Name of several elements in messages.
    const PLURAL: &'static str;
}

impl Item for f64 {
    const PLURAL: &'static str = "numbers";
}

impl Item for String {
    const PLURAL: &'static str = "texts in quotes";
}

impl Item for i64 {
    const PLURAL: &'static str = "whole numbers";
}

impl Item for Formula {
    const PLURAL: &'static str = "formulas in quotes";
}

impl Item for List<f64> {
    const PLURAL: &'static str = "lists of numbers";
}

/// A list whose error messages name its elements.
#[derive(Clone, Debug, Default)]
pub struct List<T>(pub Vec<T>);

impl<'de, T: Item> Deserialize<'de> for List<T> {
    fn deserialize<D: Deserializer<'de>>(deserializer: D) -> Result<Self, D::Error> {
        struct Reader<T>(PhantomData<T>);

        impl<'de, T: Item> Visitor<'de> for Reader<T> {
            type Value = List<T>;

            fn expecting(&self, f: &mut Formatter<'_>) -> fmt::Result {
                write!(f, "a list of {}", T::PLURAL)
            }

            fn visit_seq<A: SeqAccess<'de>>(self, items: A) -> Result<Self::Value, A::Error> {
                Vec::deserialize(SeqAccessDeserializer::new(items)).map(List)
            }
        }

        deserializer.deserialize_tuple_struct(LIST, 1, Reader(PhantomData))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn keys_are_within_their_tables() {
        assert!(is_within("potential.1.table", "potential.1"));
        assert!(is_within("potential.1", "potential.1"));
        assert!(!is_within("potential.10.table", "potential.1"));
        assert!(!is_within("potential", "potential.1"));
    }
}
