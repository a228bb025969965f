//! A number of the quantum side with its trust: exact, of emitted gates, an upper bound, an
//! estimate, of a model, or unavailable.

use crate::base::table::{Label, Values};
use crate::base::text::short;
use serde::Serialize;
use std::fmt;

/// A number and how far it is to be trusted.
#[derive(Clone, Debug, PartialEq, Serialize)]
#[serde(tag = "label", rename_all = "kebab-case")]
pub enum Figure {
    /// Computed for this case, but for round-off.
    Exact {
        /// The number.
        value: f64,
    },
    /// Exact, and counted in gates that were emitted.
    Emitted {
        /// The number.
        value: f64,
    },
    /// Not below what it stands for.
    UpperBound {
        /// The number.
        value: f64,
    },
    /// Rests on what was measured, sampled or solved roughly.
    Estimate {
        /// The number.
        value: f64,
        /// What was assumed.
        because: String,
    },
    /// From a formula whose constants are assumed.
    Model {
        /// The number.
        value: f64,
        /// What was assumed.
        because: String,
    },
    /// Not known.
    Unavailable {
        /// Why.
        because: String,
    },
}

impl Figure {
    /// An exact number.
    pub fn exact(value: f64) -> Self {
        Self::Exact { value }
    }

    /// A number of emitted gates.
    pub fn emitted(value: f64) -> Self {
        Self::Emitted { value }
    }

    /// An upper bound.
    pub fn bound(value: f64) -> Self {
        Self::UpperBound { value }
    }

    /// An estimate.
    pub fn estimate(value: f64, because: &str) -> Self {
        Self::Estimate { value, because: because.to_owned() }
    }

    /// A number of a model.
    pub fn model(value: f64, because: &str) -> Self {
        Self::Model { value, because: because.to_owned() }
    }

    /// No number.
    pub fn unavailable(because: &str) -> Self {
        Self::Unavailable { because: because.to_owned() }
    }

    /// Another number with this one's label.
    pub fn with(&self, number: f64) -> Self {
        let mut figure = self.clone();
        match &mut figure {
            Self::Exact { value }
            | Self::Emitted { value }
            | Self::UpperBound { value }
            | Self::Estimate { value, .. }
            | Self::Model { value, .. } => *value = number,
            Self::Unavailable { .. } => {}
        }
        figure
    }

    /// The product, labelled as the less trusted of both.
    pub fn times(&self, other: &Self) -> Self {
        let (more, less) =
            if self.distrust() < other.distrust() { (self, other) } else { (other, self) };
        match (more.value(), less.value()) {
            (Some(a), Some(b)) => less.with(a * b),
            _ => less.clone(),
        }
    }

    /// The order of the labels.
    fn distrust(&self) -> u8 {
        match self {
            Self::Exact { .. } => 0,
            Self::Emitted { .. } => 1,
            Self::UpperBound { .. } => 2,
            Self::Estimate { .. } => 3,
            Self::Model { .. } => 4,
            Self::Unavailable { .. } => 5,
        }
    }

    /// The label and its letter in tables.
    fn label(&self) -> Label {
        let (word, mark) = match self {
            Self::Exact { .. } => ("exact", 'x'),
            Self::Emitted { .. } => ("emitted", 'g'),
            Self::UpperBound { .. } => ("upper-bound", 'b'),
            Self::Estimate { .. } => ("estimate", 'm'),
            Self::Model { .. } => ("model", 'm'),
            Self::Unavailable { .. } => ("unavailable", ' '),
        };
        Label { word, mark }
    }

    /// The number to three digits with a letter for its label, of tables.
    pub fn marked(&self) -> String {
        let number = |x: f64| match x.fract() == 0.0 && x.abs() < 1e6 {
            true => format!("{x}"),
            false => format!("{x:.3e}"),
        };
        let Some(value) = self.value() else { return "-".to_owned() };
        format!("{} {}", number(value), self.label().mark)
    }

    /// Figures as a column of a table, with their labels.
    pub fn column<'a>(name: &str, figures: impl Iterator<Item = &'a Self>) -> Values {
        let mut column = Values::new(name, []);
        for figure in figures {
            column.cells.push(figure.value().into());
            column.labels.push(figure.label());
        }
        column
    }

    /// The number, if there is one.
    pub fn value(&self) -> Option<f64> {
        match self {
            Self::Exact { value }
            | Self::Emitted { value }
            | Self::UpperBound { value }
            | Self::Estimate { value, .. }
            | Self::Model { value, .. } => Some(*value),
            Self::Unavailable { .. } => None,
        }
    }
}

impl fmt::Display for Figure {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let number = |x: f64| match x.fract() == 0.0 && x.abs() < 1e7 {
            true => format!("{x}"),
            false => short(x),
        };
        match self {
            Self::Exact { value } => write!(f, "{:>12}  exact", number(*value)),
            Self::Emitted { value } => {
                write!(f, "{:>12}  exact (emitted gates)", number(*value))
            }
            Self::UpperBound { value } => write!(f, "{:>12}  upper bound", number(*value)),
            Self::Estimate { value, because } => {
                write!(f, "{:>12}  estimate: {because}", number(*value))
            }
            Self::Model { value, because } => {
                write!(f, "{:>12}  model: {because}", number(*value))
            }
            Self::Unavailable { because } => write!(f, "{:>12}  unavailable: {because}", "-"),
        }
    }
}
