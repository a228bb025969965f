//! A number of the quantum side with its trust: exact, of emitted gates, an upper bound, an
//! estimate, of a model, or unavailable.

use crate::base::table::{ColumnValues, Label};
use crate::base::text::short;
use serde::Serialize;
use serde_json::Value;
use std::fmt;

/// How far a number is to be trusted, the most trusted first.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord, Serialize)]
#[serde(rename_all = "kebab-case")]
pub enum Trust {
    /// Computed for this case; only round-off is in it.
    Exact,
    /// Exact, and counted in gates that were emitted.
    Emitted,
    /// An upper bound of the true number.
    UpperBound,
    /// Derived from measured, sampled or approximate data.
    Estimate,
    /// A value of a formula whose constants are assumed.
    Model,
    /// An unknown number.
    Unavailable,
}

impl Trust {
    /// The label and its letter in tables.
    fn label(self) -> Label {
        let (word, mark) = match self {
            Self::Exact => ("exact", 'x'),
            Self::Emitted => ("emitted", 'g'),
            Self::UpperBound => ("upper-bound", 'b'),
            Self::Estimate => ("estimate", 'm'),
            Self::Model => ("model", 'm'),
            Self::Unavailable => ("unavailable", ' '),
        };
        Label { word, mark }
    }

    /// `column` with this label in every row that has a value.
    pub fn of_column(self, mut column: ColumnValues) -> ColumnValues {
        let label = |cell: &Value| if cell.is_null() { Self::Unavailable } else { self }.label();
        column.labels = column.cells.iter().map(label).collect();
        column
    }
}

/// A number and how far it is to be trusted.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct LabelledNumber {
    label: Trust,
    #[serde(skip_serializing_if = "Option::is_none")]
    value: Option<f64>,
    /// What an estimate or a model assumes, or why there is no number.
    #[serde(skip_serializing_if = "Option::is_none")]
    because: Option<String>,
}

impl LabelledNumber {
    /// An exact number, `value`.
    pub fn exact(value: f64) -> Self {
        Self { label: Trust::Exact, value: Some(value), because: None }
    }

    /// A number of emitted gates.
    pub fn emitted(value: f64) -> Self {
        Self { label: Trust::Emitted, ..Self::exact(value) }
    }

    /// An upper bound.
    pub fn bound(value: f64) -> Self {
        Self { label: Trust::UpperBound, ..Self::exact(value) }
    }

    /// An estimate.
    pub fn estimate(value: f64, because: &str) -> Self {
        Self { label: Trust::Estimate, value: Some(value), because: Some(because.to_owned()) }
    }

    /// A number of a model.
    pub fn model(value: f64, because: &str) -> Self {
        Self { label: Trust::Model, ..Self::estimate(value, because) }
    }

    /// An unavailable number; `because` is the reason.
    pub fn unavailable(because: &str) -> Self {
        Self { label: Trust::Unavailable, value: None, because: Some(because.to_owned()) }
    }

    /// The number `number` with this one's label and reason; unavailable where this one is.
    pub fn with(&self, number: f64) -> Self {
        Self { value: self.value.map(|_| number), ..self.clone() }
    }

    /// The one with the lower value.
    pub fn lower_of([first, second]: &[Self; 2]) -> &Self {
        if second.value() < first.value() { second } else { first }
    }

    /// The lowest value of `numbers`; infinite if none has one.
    pub fn least(numbers: &[Self]) -> f64 {
        numbers.iter().filter_map(Self::value).fold(f64::INFINITY, f64::min)
    }

    /// The product, labelled as the less trusted of both.
    pub fn times(&self, other: &Self) -> Self {
        let (more, less) = if self.label < other.label { (self, other) } else { (other, self) };
        match (more.value, less.value) {
            (Some(a), Some(b)) => less.with(a * b),
            _ => less.clone(),
        }
    }

    /// How far the number is to be trusted.
    pub fn trust(&self) -> Trust {
        self.label
    }

    /// What an estimate or a model assumes, or why there is no number.
    pub fn because(&self) -> Option<&str> {
        self.because.as_deref()
    }

    /// Why there is no number; `None` where there is one.
    pub fn why_not(&self) -> Option<&str> {
        self.because().filter(|_| self.value.is_none())
    }

    /// The number, if there is one.
    pub fn value(&self) -> Option<f64> {
        self.value
    }

    /// The number; 0 where there is none.
    pub fn or_zero(&self) -> f64 {
        self.value.unwrap_or_default()
    }

    /// The number; infinite where there is none.
    pub fn or_infinite(&self) -> f64 {
        self.value.unwrap_or(f64::INFINITY)
    }

    /// The number; not a number where there is none.
    pub fn or_nan(&self) -> f64 {
        self.value.unwrap_or(f64::NAN)
    }

    /// The number to three digits, with the letter of its label, for tables.
    pub fn marked(&self) -> String {
        self.marked_to(3)
    }

    /// The number to `digits` digits, with the letter of its label. Whole numbers below 1e5 are
    /// written in full, and `-` where there is no number.
    pub fn marked_to(&self, digits: usize) -> String {
        let decimals = digits.saturating_sub(1);
        let number = |x: f64| {
            if x.fract() == 0.0 && x.abs() < 1e5 {
                format!("{x}")
            } else {
                format!("{x:.decimals$e}")
            }
        };
        let Some(value) = self.value() else { return "-".to_owned() };
        format!("{} {}", number(value), self.label.label().mark)
    }

    /// Figures as a column of a table, with their labels.
    pub fn column<'a>(name: &str, figures: impl Iterator<Item = &'a Self>) -> ColumnValues {
        let mut column = ColumnValues::new(name, []);
        for figure in figures {
            column.cells.push(figure.value().into());
            column.labels.push(figure.label.label());
        }
        column
    }
}

impl fmt::Display for LabelledNumber {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let number =
            |x: f64| if x.fract() == 0.0 && x.abs() < 1e7 { format!("{x}") } else { short(x) };
        let word = match self.label {
            Trust::Emitted => "exact (emitted gates)",
            Trust::UpperBound => "upper bound",
            other => other.label().word,
        };
        write!(f, "{:>12}  {word}", self.value.map_or_else(|| "-".to_owned(), number))?;
        self.because.iter().try_for_each(|because| write!(f, ": {because}"))
    }
}
