//! The rows with inflow through the boundary.

use crate::problem::case::{LiouvilleField, MOST_FIELDS};
use crate::scheme::row::InflowSource;
use crate::scheme::rows::Row;

/// The rows that have an auxiliary unknown, or are coupled to the common one.
pub(crate) struct InflowRows {
    /// The rows in order.
    pub list: Vec<AuxiliaryRow>,
    /// The sources of a time-dependent inflow for each row of `list`; empty if it is constant.
    pub entering: VaryingInflow,
    /// Whether all rows share one auxiliary unknown.
    pub shared: bool,
}

/// A row with an auxiliary unknown, its own or the common one.
#[derive(Clone, Copy, Debug)]
pub struct AuxiliaryRow {
    /// Local number of row `i`.
    pub row: u32,
    /// `b_i` of each field; at the start, if it depends on time.
    pub values: [f64; MOST_FIELDS],
    /// `g_i`: the row itself adds `−½ g_i x_i²` to `xᵀSx`.
    pub damping: f64,
    /// `Σ rate b²` over the points of inflow; for degree 0 it is `b_i²/g_i`. Summed over rows with
    /// their weights, it bounds the growth of the squared norm by the inflow in a unit of time.
    pub strength: f64,
    /// `κ_i` in weighted unknowns; zero if it depends on time.
    pub coupling: f64,
}

impl AuxiliaryRow {
    /// The coupling with which this row and its unknown grow by at most the rate `growth`, `θ`: for
    /// degree 0 `κ² = 2 g θ`; for higher degrees, where `g` may be zero, the root of `λ_i = θ`.
    pub fn planned_coupling(&self, growth: f64, by_elements: bool) -> f64 {
        let rate = if by_elements { self.damping + 2.0 * growth } else { self.damping };
        (2.0 * rate * growth).sqrt()
    }

    /// Whether any field has inflow here.
    pub fn enters(&self) -> bool {
        self.values.iter().any(|&b| b != 0.0)
    }

    /// Largest `|b_i|` over the fields.
    pub(super) fn largest(&self) -> f64 {
        self.values.iter().fold(0.0, |m, b| m.max(b.abs()))
    }
}

/// The sources of a time-dependent inflow: `b_i(t) = Σ rate · value(point, t)` for each row.
#[derive(Clone, Debug, Default)]
pub struct VaryingInflow {
    /// `sources[ends[m − 1]..ends[m]]` are those of row `m`.
    ends: Vec<usize>,
    sources: Vec<InflowSource>,
}

/// A source of a varying inflow whose value is not finite.
#[derive(Clone, Copy, Debug)]
pub struct UndefinedSource {
    /// The value of the inflow.
    pub value: f64,
    /// The point of the source.
    pub point: [f64; 6],
}

impl VaryingInflow {
    /// Bytes of a row with one source.
    pub const ROW_BYTES: usize = size_of::<InflowSource>() + size_of::<usize>();

    /// Bytes of the sources.
    pub fn bytes(&self) -> usize {
        size_of::<InflowSource>() * self.sources.len() + size_of::<usize>() * self.ends.len()
    }

    /// Adds a row.
    pub(crate) fn push(&mut self, row: &Row) {
        self.sources.extend_from_slice(&row.sources);
        self.ends.push(self.sources.len());
    }

    /// `b_i(time)` of `field` for each row with inflow.
    pub fn values(&self, field: &LiouvilleField, time: f64) -> impl Iterator<Item = f64> {
        let formula = field.entering();
        // A formula of t alone has one value.
        let everywhere = (0..6).all(|k| !formula.depends_on(k));
        let value = everywhere.then(|| formula.at_point(&[0.0; 6], time));
        self.sums(move |point| value.unwrap_or_else(|| formula.at_point(point, time)))
    }

    /// `Σ rate · value(point)` for each row with inflow.
    pub fn sums(&self, value: impl Fn(&[f64; 6]) -> f64) -> impl Iterator<Item = f64> {
        let all = 0..self.ends.len();
        let term = move |source: &InflowSource| source.rate * value(&source.point);
        all.map(move |m| self.sources_of(m).iter().map(&term).sum())
    }

    /// The sources of row `m`.
    fn sources_of(&self, m: usize) -> &[InflowSource] {
        let start = m.checked_sub(1).map_or(0, |before| self.ends[before]);
        &self.sources[start..self.ends[m]]
    }

    /// The first source of row `m` where `field`'s inflow is not finite.
    pub fn undefined(&self, field: &LiouvilleField, m: usize, time: f64) -> UndefinedSource {
        let at_source = |&InflowSource { point, .. }: &InflowSource| UndefinedSource {
            value: field.entering().at_point(&point, time),
            point,
        };
        let mut values = self.sources_of(m).iter().map(at_source);
        let undefined = values.find(|source| !source.value.is_finite());
        undefined.unwrap_or(UndefinedSource { value: f64::NAN, point: [0.0; 6] })
    }
}
