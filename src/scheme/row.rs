//! One row of `A` and `b`, whatever the degree.

use crate::problem::case::{LiouvilleField, MOST_FIELDS};
use crate::scheme::interface::FluxSource;

/// One row of `A` and `b`.
#[derive(Clone, Debug, Default)]
pub struct Row {
    /// `(column, value)`, ascending and distinct columns.
    pub entries: Vec<(usize, f64)>,
    /// `b_i` of each field at the start: the inflow through the boundary.
    pub inflow: [f64; MOST_FIELDS],
    /// The rate at which the row draws on the inflow, `≥ 0`; with open ends `−Σ_j A_ij`.
    pub inflow_rate: f64,
    /// The sources of the inflow.
    pub sources: Vec<InflowSource>,
    /// `g_i ≥ 0`: the row's inflow adds `−½ g_i x_i²` to `xᵀSx`. For degree 0 it equals
    /// `inflow_rate`.
    pub damping: f64,
    /// First place where an inflow formula was not finite.
    pub(super) bad: Option<UndefinedInflow>,
    pub(super) scratch: Vec<FluxSource>,
}

/// A source of the inflow of a row: `b_i(t) = Σ rate · value(point, t)`.
#[derive(Clone, Copy, Debug)]
pub struct InflowSource {
    /// The rate at which the row draws on it.
    pub rate: f64,
    /// The centre of the ghost cell, or the point at a face of an element.
    pub point: [f64; 6],
}

/// A value of an inflow that is not finite.
#[derive(Clone, Copy, Debug)]
pub(super) struct UndefinedInflow {
    /// Number of the field.
    pub field: usize,
    pub value: f64,
    pub point: [f64; 6],
}

/// Inflow of a row.
#[derive(Clone, Copy, Debug)]
pub(super) struct InflowTerm<'a> {
    /// The fields that have inflow; empty without inflow.
    pub fields: &'a [LiouvilleField],
    /// The start, at which a varying inflow is taken.
    pub time: f64,
}

impl Row {
    /// Clears the row, but keeps the record of values that are not finite.
    pub(crate) fn clear(&mut self) {
        self.entries.clear();
        self.inflow = [0.0; MOST_FIELDS];
        self.inflow_rate = 0.0;
        self.damping = 0.0;
        self.sources.clear();
    }

    /// Sorts by column and adds up entries of the same column, in the order in which they were
    /// added: the bits do not depend on the algorithm that sorts.
    pub(super) fn finish(&mut self) {
        self.entries.sort_by_key(|e| e.0);
        self.entries.dedup_by(|next, kept| {
            let same = next.0 == kept.0;
            if same {
                kept.1 += next.1;
            }
            same
        });
    }

    /// Adds `rate` times the inflow `enters` at `point`.
    pub(super) fn enter(&mut self, enters: InflowTerm<'_>, rate: f64, point: [f64; 6]) {
        let InflowTerm { fields, time } = enters;
        if fields.is_empty() {
            return;
        }
        self.sources.push(InflowSource { rate, point });
        for (field, of) in fields.iter().enumerate() {
            let value = of.entering().at_point(&point, time);
            if !value.is_finite() && self.bad.is_none() {
                self.bad = Some(UndefinedInflow { field, value, point });
            }
            self.inflow[field] += rate * value;
        }
    }
}
