//! A number of the quantum side with its trust: exact, an upper bound, an estimate, or unavailable.

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
    /// Not below what it stands for.
    UpperBound {
        /// The number.
        value: f64,
    },
    /// From a formula or a model whose constants are not known, or that was sampled.
    Estimate {
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

    /// An upper bound.
    pub fn bound(value: f64) -> Self {
        Self::UpperBound { value }
    }

    /// An estimate.
    pub fn estimate(value: f64, because: &str) -> Self {
        Self::Estimate { value, because: because.to_owned() }
    }

    /// No number.
    pub fn unavailable(because: &str) -> Self {
        Self::Unavailable { because: because.to_owned() }
    }

    /// Another number with this one's label.
    pub fn with(&self, number: f64) -> Self {
        let mut figure = self.clone();
        if let Self::Exact { value } | Self::UpperBound { value } | Self::Estimate { value, .. } =
            &mut figure
        {
            *value = number;
        }
        figure
    }

    /// The number, if there is one.
    pub fn value(&self) -> Option<f64> {
        match self {
            Self::Exact { value } | Self::UpperBound { value } | Self::Estimate { value, .. } => {
                Some(*value)
            }
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
            Self::UpperBound { value } => write!(f, "{:>12}  upper bound", number(*value)),
            Self::Estimate { value, because } => {
                write!(f, "{:>12}  estimate: {because}", number(*value))
            }
            Self::Unavailable { because } => write!(f, "{:>12}  unavailable: {because}", "-"),
        }
    }
}
