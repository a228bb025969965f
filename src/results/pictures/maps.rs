//! Planes of a run as heat maps.

use crate::base::text::short;
use crate::results::figure::palette::Style;
use crate::results::figure::{Layer, Map, Panel, PlotAxis};
use crate::results::pictures::stored::{Plane, StoredRun};

/// Values count as being of both signs if the end nearer to zero has at least this part of the
/// magnitude of the other one; otherwise the errors of a scheme may explain its sign.
const SIGNED: f64 = 0.1;

/// The part of a positive quantity's integral up to which negative values are undershoots of a
/// scheme, which are drawn as zero.
const UNDERSHOOT: f64 = 0.05;

/// Width and height of the frame of a map, in points.
pub const FRAME: [f64; 2] = [300.0, 260.0];

/// The number of columns of a figure with rows of `row` maps.
pub fn columns(row: usize) -> usize {
    if row == 4 { 2 } else { row.min(3) }
}

/// A panel with pieces of lines where `V` jumps, if there are any.
pub fn bordered(panel: Panel, border: &[[f64; 2]]) -> Panel {
    if border.is_empty() { panel } else { panel.line("", Style::theory(), border.to_vec()) }
}

/// The values of a quantity that should be positive, such as `f` and the density.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct ValueSpread {
    /// Smallest and largest finite value.
    pub ends: Option<[f64; 2]>,
    /// Sums of magnitudes: of values below zero, and of all.
    sums: [f64; 2],
}

impl ValueSpread {
    /// The spread of the values of planes.
    pub fn of<'a>(planes: impl IntoIterator<Item = &'a Plane>) -> Self {
        let mut spread = Self::default();
        planes.into_iter().for_each(|plane| spread.include(plane.values.iter().copied()));
        spread
    }

    /// Adds more values.
    pub fn include(&mut self, values: impl Iterator<Item = f64>) {
        for value in values.filter(|value| value.is_finite()) {
            let [lower, upper] = self.ends.unwrap_or([value; 2]);
            self.ends = Some([lower.min(value), upper.max(value)]);
            self.sums[0] += (-value).max(0.0);
            self.sums[1] += value.abs();
        }
    }

    /// The smallest value if there are undershoots: negative values that are few enough not to be
    /// part of the quantity, and larger than round-off.
    pub fn undershoot(&self) -> Option<f64> {
        let [lower, upper] = self.ends?;
        let few = self.sums[0] <= UNDERSHOOT * self.sums[1];
        (few && lower < -ROUND_OFF * upper).then_some(lower)
    }

    /// The range of values that colours represent: from zero on if there are undershoots, else as
    /// for [`range`] of values as large as `scale`.
    pub fn range(&self, scale: f64) -> Option<[f64; 2]> {
        let [lower, upper] = self.ends?;
        match self.undershoot() {
            Some(_) => Some([0.0, upper]),
            None => widened([lower, upper], scale),
        }
    }
}

/// The sentence of a caption about values down to `lowest` that are drawn as zero.
pub fn undershoots(lowest: Option<f64>) -> String {
    lowest.map_or(String::new(), |lowest| {
        format!(" Undershoots down to {} here have the colour of 0.", short(lowest))
    })
}

/// A range symmetric about zero, if the values are of both signs.
fn about_zero([lower, upper]: [f64; 2]) -> Option<[f64; 2]> {
    let most = upper.max(-lower);
    (upper.min(-lower) > SIGNED * most).then_some([-most, most])
}

/// A panel with a plane of a run over its axes number `axes`. Values of both signs have the colours
/// of differences, with zero in the middle.
pub fn map(
    run: &StoredRun,
    axes: [usize; 2],
    title: String,
    plane: Plane,
    range: Option<[f64; 2]>,
) -> Panel {
    let names = run.names();
    let ends = axes.map(|a| [run.axis(a).lower, run.axis(a).upper]);
    let signed = range.and_then(about_zero);
    Panel::new(title, PlotAxis::linear(names[axes[0]]), PlotAxis::linear(names[axes[1]])).map(Map {
        x: ends[0],
        y: ends[1],
        shape: plane.shape,
        values: plane.values,
        range: signed.or(range),
        differences: signed.is_some(),
        label: String::new(),
    })
}

/// The map of a difference of values as large as `scale`. Zero is in the middle of the colours, and
/// round-off looks like zero.
pub fn difference_map(
    run: &StoredRun,
    axes: [usize; 2],
    title: String,
    plane: Plane,
    scale: f64,
) -> Panel {
    let most = largest([&plane]).max(ROUND_OFF * scale);
    let range = (most > 0.0).then_some([-most, most]);
    let mut panel = map(run, axes, title, plane, range);
    for layer in &mut panel.layers {
        if let Layer::Map(map) = layer {
            map.differences = true;
        }
    }
    panel
}

/// Largest magnitude of finite values.
pub fn largest<'a>(planes: impl IntoIterator<Item = &'a Plane>) -> f64 {
    let all = planes.into_iter().flat_map(|p| &p.values);
    all.filter(|v| v.is_finite()).fold(0.0, |most, v| v.abs().max(most))
}

/// Part of a quantity's scale that is round-off.
const ROUND_OFF: f64 = 1e-12;

/// The difference of two planes, `a − b`.
pub fn difference(a: &Plane, b: &Plane) -> Plane {
    Plane { shape: a.shape, values: a.values.iter().zip(&b.values).map(|(a, b)| a - b).collect() }
}

/// Smallest and largest finite value. If they differ by round-off of `scale` or very little, the
/// range is widened, so that a constant looks constant.
pub fn range<'a>(planes: impl IntoIterator<Item = &'a Plane>, scale: f64) -> Option<[f64; 2]> {
    ValueSpread::of(planes).ends.and_then(|ends| widened(ends, scale))
}

fn widened([lower, upper]: [f64; 2], scale: f64) -> Option<[f64; 2]> {
    /// Relative difference of values that can be distinguished.
    const SEEN: f64 = 1e-3;
    let least = (SEEN * lower.abs().max(upper.abs())).max(ROUND_OFF * scale);
    if upper - lower < least {
        let middle = 0.5 * (lower + upper);
        return Some([middle - least, middle + least]);
    }
    (lower < upper).then_some([lower, upper])
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn values_of_both_signs_are_seen_about_zero() {
        assert_eq!(about_zero([-0.5, 2.0]), Some([-2.0, 2.0]));
        assert_eq!(about_zero([-3.0, 2.0]), Some([-3.0, 3.0]));
        for range in [[0.0, 2.0], [-0.1, 2.0], [1.0, 2.0], [-2.0, -1.0]] {
            assert_eq!(about_zero(range), None);
        }
    }

    #[test]
    fn undershoots_are_drawn_as_zero() {
        let spread = |values: &[f64]| {
            ValueSpread::of([&Plane { shape: [1, values.len()], values: values.to_vec() }])
        };
        // Deep, but few.
        let few = spread(&[-0.4, f64::NAN, 1.4, 1.0, 1.0, 1.0, 1.0, 1.0, 1.0, 1.0]);
        assert_eq!((few.undershoot(), few.range(1.4)), (Some(-0.4), Some([0.0, 1.4])));
        assert!(undershoots(few.undershoot()).contains("down to -0.4 here"));
        // A quantity of both signs, round-off, and none below zero.
        let both = spread(&[-0.4, 1.4, 1.0]);
        assert_eq!((both.undershoot(), both.range(1.4)), (None, Some([-0.4, 1.4])));
        assert_eq!(spread(&[-1e-15, 1.0, 1.0]).undershoot(), None);
        assert_eq!(spread(&[0.0, 1.0]).range(1.0), Some([0.0, 1.0]));
        assert_eq!((spread(&[]).range(1.0), undershoots(None)), (None, String::new()));
    }

    #[test]
    fn round_off_is_no_structure() {
        let plane = |values: &[f64]| Plane { shape: [1, values.len()], values: values.to_vec() };
        let noise = plane(&[5e-18, -5e-18, f64::NAN]);
        let [lower, upper] = range([&noise], 2.0).unwrap();
        assert!(lower < -1e-12 && upper > 1e-12);
        assert_eq!(range([&noise], 0.0), Some([-5e-18, 5e-18]));
        assert_eq!(range([&plane(&[0.0, 2.0])], 2.0), Some([0.0, 2.0]));
        assert_eq!(range([&plane(&[f64::NAN])], 2.0), None);
        assert_eq!(largest([&plane(&[1.0, -3.0, f64::NAN])]), 3.0);
    }
}
