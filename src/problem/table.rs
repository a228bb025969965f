//! A function given by its values on a tensor grid of its own. It is linear along each axis between
//! the points, or constant around each point.

use crate::base::checksum;
use crate::base::row_major::indices;
use crate::base::text::joined;
use crate::problem::limits::COORDINATES;
use serde::{Deserialize, Serialize};
use std::fmt;

/// Largest number of values of a table: 128 MiB, which every rank holds.
pub const MOST_VALUES: usize = 1 << 24;
/// A position half-way between two points, to within this part of their distance, belongs to the
/// upper point, so that round-off does not matter.
const HALF_WAY: f64 = 1e-9;

/// An axis of a table.
#[derive(Clone, Debug, PartialEq)]
pub struct TableAxis {
    /// Name of the axis.
    pub name: String,
    /// Position of the axis among the coordinates `[x, y, z, vx, vy, vz, t]`.
    pub position: usize,
    /// Points of the axis, ascending.
    pub points: Vec<f64>,
}

/// The interpolation of a table between its points.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum Interpolation {
    /// The value of the nearest point. It jumps half-way between two points, where the value is
    /// that of the upper one.
    Constant,
    /// Linear along each axis.
    Linear,
}

/// Values on the tensor product of the points of some axes, the last of which varies fastest.
#[derive(Clone, PartialEq)]
pub struct Table {
    axes: Vec<TableAxis>,
    values: Vec<f64>,
    interpolation: Interpolation,
}

/// A table that ends before an axis of the case does.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct ShortTable {
    /// Whether the lower and the upper end of the case's axis are too far beyond the table.
    pub beyond: [bool; 2],
    /// A sentence with the ends of both.
    pub what: String,
}

impl Table {
    /// `values` at the points of `axes`, linear between them.
    ///
    /// # Errors
    /// A sentence about axes that do not ascend or have one point, a number that is not finite, or
    /// a number of values other than that of points.
    pub fn new(axes: Vec<TableAxis>, values: Vec<f64>) -> Result<Self, String> {
        for (i, axis) in axes.iter().enumerate() {
            let name = &axis.name;
            if axes[..i].iter().any(|other| other.position == axis.position) {
                return Err(format!("the axis {name} is given twice"));
            }
            if axis.points.len() < 2 {
                let found = axis.points.len();
                return Err(format!("points of the axis {name}: {found}, at least 2 expected"));
            }
            if let Some(k) = axis.points.iter().position(|p| !p.is_finite()) {
                return Err(format!("point {k} of the axis {name} is {}", axis.points[k]));
            }
            if let Some(k) = axis.points.windows(2).position(|pair| pair[1] <= pair[0]) {
                let (a, b) = (axis.points[k], axis.points[k + 1]);
                return Err(format!("the axis {name} does not ascend: {a}, then {b}"));
            }
        }
        let shape: Vec<usize> = axes.iter().map(|axis| axis.points.len()).collect();
        check_size(&shape)?;
        let expected: usize = shape.iter().product();
        if axes.is_empty() || values.len() != expected {
            return Err(format!("{} values for axes of {shape:?} points", values.len()));
        }
        if let Some(k) = values.iter().position(|value| !value.is_finite()) {
            return Err(format!("the value at {} is {}", place_text(&axes, k), values[k]));
        }
        Ok(Self { axes, values, interpolation: Interpolation::Linear })
    }

    /// This table with another interpolation between its points.
    #[must_use]
    pub fn with_interpolation(self, interpolation: Interpolation) -> Self {
        Self { interpolation, ..self }
    }

    /// Whether the table is constant around each point.
    pub fn is_stepped(&self) -> bool {
        self.interpolation == Interpolation::Constant
    }

    /// The axes of the table.
    pub fn axes(&self) -> &[TableAxis] {
        &self.axes
    }

    /// The values, row-major over the axes.
    pub fn values(&self) -> &[f64] {
        &self.values
    }

    /// The checksum of axes, points and values.
    pub fn checksum(&self) -> u64 {
        let axis = |axis: &TableAxis| {
            let head = [axis.position as u64, axis.points.len() as u64];
            head.into_iter().chain(axis.points.iter().map(|p| p.to_bits())).collect::<Vec<_>>()
        };
        let values = self.values.iter().map(|value| value.to_bits());
        checksum::run_checksum(0, self.axes.iter().flat_map(axis).chain(values))
    }

    /// Whether coordinate `position` is one of its axes.
    pub fn depends_on(&self, position: usize) -> bool {
        self.axes.iter().any(|axis| axis.position == position)
    }

    /// The interpolant at `coordinates`. It is constant beyond the first and the last point of an
    /// axis, and NaN if a coordinate is NaN.
    pub fn eval(&self, coordinates: &[f64]) -> f64 {
        match self.interpolation {
            Interpolation::Constant => self.nearest(coordinates),
            Interpolation::Linear => self.multilinear(coordinates),
        }
    }

    /// The least and the largest value on the box `ranges` of coordinates, or bounds of them, as
    /// points beside the box count.
    pub fn range(&self, ranges: &[[f64; 2]]) -> [f64; 2] {
        self.range_of_rows(&self.axes, 0, ranges)
    }

    /// The range over the rows that begin with the place `row`, which `axes` continue.
    fn range_of_rows(&self, axes: &[TableAxis], row: usize, ranges: &[[f64; 2]]) -> [f64; 2] {
        let Some((axis, inner)) = axes.split_first() else { return [self.values[row]; 2] };
        let (points, [lower, upper]) = (&axis.points, ranges[axis.position]);
        let first = points.partition_point(|p| *p <= lower).saturating_sub(1);
        let last = points.partition_point(|p| *p < upper).min(points.len() - 1);
        let rows = (first..=last).map(|k| row * points.len() + k);
        rows.map(|row| self.range_of_rows(inner, row, ranges))
            .fold([f64::INFINITY, f64::NEG_INFINITY], |a, b| [a[0].min(b[0]), a[1].max(b[1])])
    }

    fn nearest(&self, coordinates: &[f64]) -> f64 {
        let mut place = 0;
        for axis in &self.axes {
            let x = coordinates[axis.position];
            if x.is_nan() {
                return f64::NAN;
            }
            let points = &axis.points;
            let above = points.partition_point(|p| *p <= x).clamp(1, points.len() - 1);
            let [a, b] = [points[above - 1], points[above]];
            let is_lower = x < a + (0.5 - HALF_WAY) * (b - a);
            place = place * points.len() + above - usize::from(is_lower);
        }
        self.values[place]
    }

    fn multilinear(&self, coordinates: &[f64]) -> f64 {
        // Index of the lower corner; for each axis its stride and the position between two points.
        let (mut lower, mut stride) = (0, 1);
        let mut steps = [(0, 0.0); COORDINATES];
        for (axis, step) in self.axes.iter().zip(&mut steps).rev() {
            let x = coordinates[axis.position];
            if x.is_nan() {
                return f64::NAN;
            }
            let above = axis.points.partition_point(|p| *p <= x).clamp(1, axis.points.len() - 1);
            let [a, b] = [axis.points[above - 1], axis.points[above]];
            lower += (above - 1) * stride;
            *step = (stride, ((x - a) / (b - a)).clamp(0.0, 1.0));
            stride *= axis.points.len();
        }
        let steps = &steps[..self.axes.len()];
        let corner = |corner: usize| {
            let (mut place, mut weight) = (lower, 1.0);
            for (a, (stride, part)) in steps.iter().enumerate() {
                let is_upper = corner >> a & 1 == 1;
                place += if is_upper { *stride } else { 0 };
                weight *= if is_upper { *part } else { 1.0 - part };
            }
            // Without the zero terms, the value at a point of the table is exact.
            if weight == 0.0 { 0.0 } else { weight * self.values[place] }
        };
        (0..1usize << steps.len()).map(corner).sum()
    }

    /// Number of pairs of neighbouring points with different values, and number of pairs.
    pub fn steps(&self) -> [usize; 2] {
        let (mut found, mut stride) = ([0, 0], 1);
        for axis in self.axes.iter().rev() {
            let count = axis.points.len();
            for (place, value) in self.values.iter().enumerate() {
                if place / stride % count + 1 < count {
                    found[0] += usize::from(*value != self.values[place + stride]);
                    found[1] += 1;
                }
            }
            stride *= count;
        }
        found
    }

    /// The ends of the table along the axis of coordinate `position`: its first and last point, or
    /// half a step beyond them if it is constant around its points.
    pub fn ends(&self, position: usize) -> Option<[f64; 2]> {
        let points = &self.axes.iter().find(|axis| axis.position == position)?.points;
        let last = points.len() - 1;
        let on = if self.is_stepped() { 0.5 } else { 0.0 };
        let [below, above] = [points[1] - points[0], points[last] - points[last - 1]];
        Some([points[0] - on * below, points[last] + on * above])
    }

    /// What is wrong if `[lower, upper]` of coordinate `position` goes beyond the table by more
    /// than one step of it.
    pub fn beyond(&self, position: usize, [lower, upper]: [f64; 2]) -> Option<ShortTable> {
        let axis = self.axes.iter().find(|axis| axis.position == position)?;
        let [first, second] = [axis.points[0], axis.points[1]];
        let [before, last] =
            [axis.points[axis.points.len() - 2], axis.points[axis.points.len() - 1]];
        let beyond = [lower < first - (second - first), upper > last + (last - before)];
        let what = || {
            format!(
                "its axis {} goes from {first} to {last}, the case's from {lower} to {upper}, \
                 which may be at most one step of the table beyond its ends",
                axis.name
            )
        };
        beyond.contains(&true).then(|| ShortTable { beyond, what: what() })
    }

    /// The numbers of points along the axes: `64 x 32`.
    pub fn shape_text(&self) -> String {
        let counts: Vec<usize> = self.axes.iter().map(|axis| axis.points.len()).collect();
        joined(&counts, " x ")
    }
}

/// The coordinates of the value of this number: `x = 1, v = 0.5`.
fn place_text(axes: &[TableAxis], number: usize) -> String {
    let lengths: Vec<usize> = axes.iter().map(|axis| axis.points.len()).collect();
    let places = axes.iter().zip(indices(number, &lengths));
    let places = places.map(|(axis, at)| format!("{} = {}", axis.name, axis.points[at]));
    places.collect::<Vec<_>>().join(", ")
}

/// Refuses a table with more than [`MOST_VALUES`].
///
/// # Errors
/// A sentence with the limit.
pub fn check_size(shape: &[usize]) -> Result<(), String> {
    let count = shape.iter().try_fold(1usize, |count, &n| count.checked_mul(n));
    match count.filter(|count| *count <= MOST_VALUES) {
        Some(_) => Ok(()),
        None => Err(format!("a table of {shape:?} values; at most {MOST_VALUES} are read")),
    }
}

/// Prints the shape only.
impl fmt::Debug for Table {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "Table({})", self.shape_text())
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn axis(name: &str, position: usize, points: &[f64]) -> TableAxis {
        TableAxis { name: name.to_owned(), position, points: points.to_vec() }
    }

    #[test]
    fn multilinear_functions_are_exact() {
        let [x, v, t] = [&[-1.0, 0.0, 0.5][..], &[0.0, 2.0], &[0.0, 1.0, 3.0, 4.0]];
        let f = |x: f64, v: f64, t: f64| (1.0 + 2.0 * x) * (3.0 - v) * (0.5 + t);
        let mut values = Vec::new();
        for (x, v, t) in
            x.iter().flat_map(|x| v.iter().flat_map(move |v| t.iter().map(move |t| (*x, *v, *t))))
        {
            values.push(f(x, v, t));
        }
        let axes = vec![axis("x", 0, x), axis("v", 3, v), axis("t", 6, t)];
        let table = Table::new(axes, values).unwrap();
        let at = |x: f64, v: f64, t: f64| table.eval(&[x, f64::NAN, f64::NAN, v, 0.0, 0.0, t]);
        for (x, v, t) in [(-0.3, 0.7, 2.2), (0.4, 2.0, 0.1), (0.25, 1.5, 3.5)] {
            assert!((at(x, v, t) - f(x, v, t)).abs() < 1e-14);
        }
        // Exact at points, constant beyond the ends.
        assert_eq!(at(0.0, 2.0, 3.0), f(0.0, 2.0, 3.0));
        assert_eq!(at(9.0, -9.0, 4.5), f(0.5, 0.0, 4.0));
        assert!(at(f64::NAN, 0.0, 0.0).is_nan());
        assert!(table.depends_on(3) && !table.depends_on(1));
    }

    /// Bounds hold on any box, also beyond the table, and are those of the points beside the box.
    #[test]
    fn values_are_within_the_range() {
        let axes = vec![axis("x", 0, &[-1.0, 0.0, 0.5, 2.0]), axis("v", 3, &[0.0, 1.0, 3.0])];
        let values: Vec<f64> = (0..12).map(|k| f64::from(k * 7 % 12)).collect();
        let linear = Table::new(axes, values).unwrap();
        for table in [linear.clone(), linear.with_interpolation(Interpolation::Constant)] {
            for (x, v) in
                [([-3.0, -2.0], [0.2, 0.3]), ([-0.5, 0.7], [0.5, 5.0]), ([0.5; 2], [1.0; 2])]
            {
                let none = [f64::NAN; 2];
                let [least, most] = table.range(&[x, none, none, v]);
                for (i, j) in (0..=20).flat_map(|i| (0..=20).map(move |j| (i, j))) {
                    let at = |[a, b]: [f64; 2], k: i32| a + (b - a) * f64::from(k) / 20.0;
                    let found = table.eval(&[at(x, i), 0.0, 0.0, at(v, j)]);
                    assert!(least <= found && found <= most, "{x:?} {v:?}: {found}");
                }
            }
            assert_eq!(table.range(&[[-9.0, -1.5], [0.0; 2], [0.0; 2], [-2.0, -1.0]]), [0.0; 2]);
        }
    }

    #[test]
    fn a_stepped_table_jumps_half_way_between_its_points() {
        let axes = vec![axis("x", 0, &[0.0, 1.0, 3.0]), axis("y", 1, &[0.0, 1.0])];
        let table = Table::new(axes, vec![1.0, 2.0, 3.0, 4.0, 5.0, 6.0]).unwrap();
        assert!(!table.is_stepped());
        let table = table.with_interpolation(Interpolation::Constant);
        assert!(table.is_stepped());
        let rows = [(-9.0, 1.0), (0.49, 1.0), (0.5, 3.0), (1.99, 3.0), (2.0, 5.0), (9.0, 5.0)];
        for (x, value) in rows {
            assert_eq!(table.eval(&[x, 0.0]), value, "{x}");
            assert_eq!(table.eval(&[x, 0.5]), value + 1.0, "{x}");
        }
        assert!(table.eval(&[0.0, f64::NAN]).is_nan());
    }

    #[test]
    fn one_more_point_quarters_the_error() {
        let error = |count: usize| {
            let points: Vec<f64> = (0..=count).map(|i| i as f64 / count as f64).collect();
            let values = points.iter().map(|x| (3.0 * x).sin()).collect();
            let table = Table::new(vec![axis("x", 0, &points)], values).unwrap();
            let at = |i: usize| (i as f64 + 0.5) / 1000.0;
            (0..1000)
                .map(|i| (table.eval(&[at(i)]) - (3.0 * at(i)).sin()).abs())
                .fold(0.0, f64::max)
        };
        let ratio = error(20) / error(40);
        assert!((3.8..4.2).contains(&ratio), "{ratio}");
    }

    #[test]
    fn a_changed_number_changes_the_checksum() {
        let table = |points: &[f64], last: f64| {
            Table::new(vec![axis("x", 0, points)], vec![1.0, last]).unwrap().checksum()
        };
        let own = table(&[0.0, 1.0], 2.0);
        assert_eq!(own, table(&[0.0, 1.0], 2.0));
        assert!(own != table(&[0.0, 1.5], 2.0) && own != table(&[0.0, 1.0], 2.5));
    }

    #[test]
    fn invalid_tables_are_refused() {
        let one = |points: &[f64], values: &[f64]| {
            Table::new(vec![axis("x", 0, points)], values.to_vec()).unwrap_err()
        };
        assert!(one(&[0.0, 0.0], &[1.0, 1.0]).contains("does not ascend: 0, then 0"));
        assert!(one(&[0.0, f64::NAN], &[1.0, 1.0]).contains("point 1 of the axis x is NaN"));
        assert!(one(&[0.0], &[1.0]).contains("points of the axis x: 1, at least 2"));
        assert!(one(&[0.0, 1.0], &[1.0]).contains("1 values for axes of [2]"));
        assert!(one(&[0.0, 1.0], &[1.0, f64::INFINITY]).contains("the value at x = 1 is inf"));
        let two = |values: [f64; 4]| {
            let axes = vec![axis("x", 0, &[0.0, 1.0]), axis("v", 3, &[2.0, 3.5])];
            Table::new(axes, values.to_vec()).unwrap_err()
        };
        assert!(two([0.0, f64::NAN, 0.0, 0.0]).contains("the value at x = 0, v = 3.5 is NaN"));
        assert!(check_size(&[1 << 13, 1 << 12]).unwrap_err().contains("at most 16777216"));
        let twice = vec![axis("x", 0, &[0.0, 1.0]), axis("x", 0, &[0.0, 1.0])];
        assert!(Table::new(twice, vec![0.0; 4]).unwrap_err().contains("twice"));
    }

    #[test]
    fn one_step_beyond_the_ends_is_near_enough() {
        let table = Table::new(vec![axis("v", 3, &[0.0, 0.5, 1.0, 3.0])], vec![0.0; 4]).unwrap();
        assert_eq!(table.beyond(3, [-0.5, 5.0]), None);
        assert_eq!(table.beyond(0, [-99.0, 99.0]), None);
        assert!(table.beyond(3, [-0.6, 3.0]).unwrap().what.contains("axis v goes from 0 to 3"));
        assert!(table.beyond(3, [0.0, 5.1]).is_some());
        assert_eq!((table.ends(3), table.ends(0)), (Some([0.0, 3.0]), None));
        let table = table.with_interpolation(Interpolation::Constant);
        assert_eq!(table.ends(3), Some([-0.25, 4.0]));
    }
}
