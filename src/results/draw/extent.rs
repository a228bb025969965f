//! The ends of the axes of a panel.

use crate::results::figure::{Layer, Map, Panel, PlotAxis, Scale};

/// Values that differ by less than this, relative to the largest, are equal.
const ROUND_OFF: f64 = 1e-12;
/// The smallest positive number, which is subnormal.
const LEAST_POSITIVE: f64 = f64::from_bits(1);

/// The ends of the two axes: the given ones, else those of the data with a margin.
pub fn ends(panel: &Panel) -> [[f64; 2]; 2] {
    let places: Vec<[f64; 2]> = panel.layers.iter().flat_map(places).collect();
    let tight = (panel.layers.iter()).any(|layer| matches!(layer, Layer::Map(_)));
    let along = |k: usize, axis: &PlotAxis| {
        let usable = |v: &f64| v.is_finite() && (axis.scale == Scale::Linear || *v > 0.0);
        let found = smallest_and_largest(places.iter().map(|place| place[k]).filter(usable));
        axis.range.unwrap_or_else(|| {
            if found[0] < found[1] && tight { found } else { with_margin(found, axis.scale) }
        })
    };
    [along(0, &panel.x), along(1, &panel.y)]
}

/// Points of a layer that the axes must include; NaN along an axis that they do not determine.
fn places(layer: &Layer) -> Vec<[f64; 2]> {
    match layer {
        Layer::Line { points, .. } | Layer::Points { points, .. } => points.clone(),
        Layer::Intervals { points, .. } => {
            (points.iter()).flat_map(|(p, ends)| [*p, [p[0], ends[0]], [p[0], ends[1]]]).collect()
        }
        Layer::Bars { bars, .. } => {
            (bars.iter()).flat_map(|(ends, _)| ends.map(|x| [x, f64::NAN])).collect()
        }
        Layer::Map(map) => vec![[map.x[0], map.y[0]], [map.x[1], map.y[1]]],
        Layer::Vertical { at, .. } => vec![[*at, f64::NAN]],
        Layer::Horizontal { at, .. } => vec![[f64::NAN, *at]],
        Layer::Band { .. } => Vec::new(),
    }
}

/// The smallest and the largest of `values`; the first is above the second if there are none.
pub fn smallest_and_largest(values: impl Iterator<Item = f64>) -> [f64; 2] {
    let none = [f64::INFINITY, f64::NEG_INFINITY];
    values.fold(none, |[l, u], v| [l.min(v), u.max(v)])
}

/// The ends of an axis that shows values from `lower` to `upper`; there are no values if `lower` is
/// above `upper`.
fn with_margin([lower, upper]: [f64; 2], scale: Scale) -> [f64; 2] {
    match scale {
        Scale::Linear if lower > upper => [0.0, 1.0],
        Scale::Log if lower > upper => [0.1, 10.0],
        Scale::Log => {
            // The quotient of the two ends may be infinite.
            let part = (0.06 * (upper.ln() - lower.ln())).exp().max(1.3);
            [(lower / part).max(LEAST_POSITIVE), (upper * part).min(f64::MAX)]
        }
        Scale::Linear => {
            let largest = upper.abs().max(lower.abs());
            let part = if upper - lower > ROUND_OFF * largest {
                0.05 * (upper - lower)
            } else if largest > 0.0 {
                0.5 * largest
            } else {
                1.0
            };
            [lower - part, upper + part]
        }
    }
}

/// Values at the ends of a map's colours. They differ even for a constant map, so that it has a
/// colour.
pub fn map_range(map: &Map) -> [f64; 2] {
    let finite = map.values.iter().copied().filter(|v| v.is_finite());
    let [lower, upper] = map.range.unwrap_or_else(|| smallest_and_largest(finite));
    let half = 0.5 * lower.abs().max(1.0);
    if upper > lower {
        [lower, upper]
    } else if lower.is_finite() {
        [lower - half, lower + half]
    } else {
        [0.0, 1.0]
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::results::figure::palette::Style;

    /// A logarithmic axis has finite ends above zero for any data.
    #[test]
    fn logarithmic_axes_hold_all_numbers() {
        for values in [[1e-318, 1.0], [1e-10, 1e300], [LEAST_POSITIVE, f64::MAX], [1.0, 1.0]] {
            let [lower, upper] = with_margin(values, Scale::Log);
            assert!(0.0 < lower && lower <= values[0], "{values:?}: {lower:e}");
            assert!(values[1] <= upper && upper.is_finite(), "{values:?}: {upper:e}");
        }
    }

    #[test]
    fn axes_of_a_single_value() {
        for (values, expected) in
            [([0.0, 0.0], [-1.0, 1.0]), ([2.0, 2.0], [1.0, 3.0]), ([2.0, 2.0 + 1e-15], [1.0, 3.0])]
        {
            let points = vec![[0.0, values[0]], [1.0, values[1]]];
            let panel = Panel::new("", PlotAxis::linear("x"), PlotAxis::linear("y"));
            let found = ends(&panel.line("", Style::of(0), points))[1];
            assert!((0..2).all(|k| (found[k] - expected[k]).abs() < 1e-12));
        }
    }
}
