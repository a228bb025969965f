//! `[exact]`: the exact solution with which results are compared.
//!
//! Uses file and reader (the keys), coordinates, initial (measure-valued data have no `f`).

use crate::base::error::Result;
use crate::problem::case::coordinates::{formula, names_with_time};
use crate::problem::case::file::CaseFile;
use crate::problem::case::initial::Data;
use crate::problem::case::reader::Formula;
use crate::problem::formula::Expression;
use serde::Deserialize;

/// The exact solution with which results are compared.
#[derive(Clone, Debug)]
pub enum Exact {
    /// Particles are traced back through the piecewise linear potential.
    Characteristics,
    /// A formula for `f(t, x, v)`.
    Formula(Expression),
}

/// `exact.moments`: the times at which moments of the exact solution are computed.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum ExactTimes {
    /// All output times.
    #[default]
    All,
    /// The end only.
    End,
}

/// `[exact]` as it is written.
#[derive(Debug, Default, Deserialize)]
pub struct ExactTable {
    kind: Option<ExactKind>,
    f: Option<Formula>,
    moments: Option<ExactTimes>,
}

/// The words that `exact.kind` takes.
#[derive(Clone, Copy, Debug, Deserialize)]
#[serde(rename_all = "kebab-case")]
enum ExactKind {
    Characteristics,
}

impl ExactTable {
    /// The exact solution that results are compared with.
    pub fn check(&self, file: &CaseFile<'_>, n: usize, data: &Data) -> Result<Option<Exact>> {
        if self.f.is_some() && data.is_measure() {
            return file.refuse(
                "exact.f",
                "measure-valued data have no f; exact.kind = \"characteristics\" gives density \
                 and velocity",
            );
        }
        match (self.kind, formula(file, "exact.f", &self.f, &names_with_time(n))?) {
            (None, None) => Ok(None),
            (None, Some(f)) => Ok(Some(Exact::Formula(f))),
            (Some(ExactKind::Characteristics), None) => Ok(Some(Exact::Characteristics)),
            (Some(_), Some(_)) => {
                let message = "give either exact.kind or exact.f";
                file.refuse_either(["exact.f", "exact.kind"], message)
            }
        }
    }

    /// The times at which moments of the exact solution are computed.
    pub fn times(&self, file: &CaseFile<'_>) -> Result<ExactTimes> {
        if self.moments.is_some() && self.kind.is_none() && self.f.is_none() {
            let message = "needs an exact solution; give exact.kind or exact.f, or leave it out";
            return file.refuse("exact.moments", message);
        }
        Ok(self.moments.unwrap_or_default())
    }
}
