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
    /// `−Σ_j A_ij ≥ 0`: the rate at which the row draws on the inflow.
    pub draw: f64,
    /// The ghost cells of the inflow, `(rate, ghost centre)`: `b_i(t) = Σ rate · value(ghost
    /// centre, t)`.
    pub ghosts: Vec<(f64, [f64; 6])>,
    /// `g_i ≥ 0`: the row's inflow adds `−½ g_i x_i²` to `xᵀSx`. For degree 0 it equals `draw`.
    pub damping: f64,
    /// First place where an inflow formula was not finite.
    pub(super) bad: Option<(usize, f64, [f64; 6])>,
    pub(super) scratch: Vec<FluxSource>,
}

/// Inflow of a row.
#[derive(Clone, Copy)]
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
        self.draw = 0.0;
        self.damping = 0.0;
        self.ghosts.clear();
    }

    /// Sorts by column and adds up entries of the same column.
    pub(super) fn finish(&mut self) {
        self.entries.sort_unstable_by_key(|e| e.0);
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
        self.ghosts.push((rate, point));
        for (f, field) in fields.iter().enumerate() {
            let value = field.entering().at_point(&point, time);
            if !value.is_finite() && self.bad.is_none() {
                self.bad = Some((f, value, point));
            }
            self.inflow[f] += rate * value;
        }
    }
}
