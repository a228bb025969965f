//! Colours, markers and dashes that can be distinguished by the colour-blind and in grey.

use plotters::style::RGBColor;
use plotters::style::colors::colormaps::{ColorMap, DerivedColorMap};
use std::sync::LazyLock;

/// Text and frames.
pub const INK: RGBColor = RGBColor(34, 34, 34);
/// Lines and texts of minor weight: theory, borders, notes.
pub const FAINT: RGBColor = RGBColor(120, 120, 120);
/// Grid lines.
pub const GRID: RGBColor = RGBColor(225, 225, 225);
/// The background.
pub const PAPER: RGBColor = RGBColor(255, 255, 255);

/// The qualitative palette of Okabe and Ito (2008) without its yellow, which is too light for
/// lines; neighbours differ in lightness.
const SERIES: [RGBColor; 7] = [
    RGBColor(0, 114, 178),
    RGBColor(230, 159, 0),
    RGBColor(0, 0, 0),
    RGBColor(0, 158, 115),
    RGBColor(86, 180, 233),
    RGBColor(213, 94, 0),
    RGBColor(204, 121, 167),
];

/// Colours of a heat map from dark blue to light yellow; their lightness rises evenly.
const SEQUENTIAL: [RGBColor; 5] = [
    RGBColor(0, 34, 78),
    RGBColor(63, 77, 107),
    RGBColor(124, 123, 120),
    RGBColor(186, 173, 103),
    RGBColor(254, 232, 56),
];

/// NaN in a map: unlike any shade, white included.
pub const NOTHING: RGBColor = RGBColor(195, 195, 195);

/// Colours at the ends of a map of differences: blue below, vermilion above. Zero is white.
const BELOW: RGBColor = RGBColor(0, 90, 160);
const ABOVE: RGBColor = RGBColor(200, 80, 0);

/// Shape of a marker.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Marker {
    /// Circle.
    Circle,
    /// Square.
    Square,
    /// Triangle with its tip up.
    Up,
    /// Diamond.
    Diamond,
    /// Triangle with its tip down.
    Down,
    /// Diagonal cross.
    Cross,
    /// Upright cross.
    Plus,
}

const MARKERS: [Marker; 7] = [
    Marker::Circle,
    Marker::Square,
    Marker::Up,
    Marker::Diamond,
    Marker::Down,
    Marker::Cross,
    Marker::Plus,
];

/// Lengths of dashes and gaps in points; `None` for a solid line.
const DASHES: [Option<[f64; 2]>; 4] = [None, Some([7.0, 3.0]), Some([2.0, 2.5]), Some([13.0, 4.0])];

/// The style of a series.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Style {
    /// Colour of lines and markers.
    pub colour: RGBColor,
    /// Marker at each point, if any.
    pub marker: Option<Marker>,
    /// Whether markers are filled.
    pub filled: bool,
    /// Number of the dash, from 0 (a solid line) to 3.
    pub dash: usize,
    /// Width of lines in points.
    pub width: f64,
}

impl Style {
    /// Colour and marker number `k`, a different pair for each `k` below 49, and a solid line.
    pub fn of(k: usize) -> Self {
        let n = SERIES.len();
        Self {
            colour: SERIES[k % n],
            marker: Some(MARKERS[(k + k / n) % n]),
            filled: true,
            dash: 0,
            width: 1.6,
        }
    }

    /// The style of theory: a thin, grey, dashed line without markers.
    pub fn theory() -> Self {
        Self { colour: FAINT, marker: None, filled: false, dash: 1, width: 1.1 }
    }

    /// The style with dash number `dash`, from 0 to 3.
    pub fn dashed(self, dash: usize) -> Self {
        Self { dash, ..self }
    }

    /// The style with hollow markers.
    pub fn hollow(self) -> Self {
        Self { filled: false, ..self }
    }

    /// The style without markers.
    pub fn plain(self) -> Self {
        Self { marker: None, ..self }
    }

    /// Lengths of dashes and gaps in points; `None` for a solid line.
    pub(crate) fn dashes(&self) -> Option<[f64; 2]> {
        DASHES[self.dash % DASHES.len()]
    }
}

/// Colours from the lower end of a colour bar to the upper one.
type ColourBar = LazyLock<DerivedColorMap<RGBColor>>;

static HEAT: ColourBar = LazyLock::new(|| DerivedColorMap::new(&SEQUENTIAL));
static DIFFERENCES: ColourBar = LazyLock::new(|| DerivedColorMap::new(&[BELOW, PAPER, ABOVE]));

/// The colour at `fraction` in [0, 1] of a colour bar; [`NOTHING`] for NaN.
fn along(bar: &ColourBar, fraction: f64) -> RGBColor {
    if fraction.is_nan() { NOTHING } else { bar.get_color(fraction) }
}

/// The colour at `fraction` in [0, 1] of a heat map's colour bar; [`NOTHING`] for NaN.
pub fn sequential(fraction: f64) -> RGBColor {
    along(&HEAT, fraction)
}

/// The colour at `fraction` in [0, 1] of a colour bar for differences. It is white in the middle,
/// which is zero, and darker away from it; [`NOTHING`] for NaN.
pub fn diverging(fraction: f64) -> RGBColor {
    along(&DIFFERENCES, fraction)
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Approximate relative luminance (WCAG 2): the lightness in grey.
    fn lightness(colour: RGBColor) -> f64 {
        let RGBColor(r, g, b) = colour;
        let [r, g, b] = [r, g, b].map(|c| (f64::from(c) / 255.0).powf(2.2));
        0.2126 * r + 0.7152 * g + 0.0722 * b
    }

    #[test]
    fn series_differ_in_more_than_hue() {
        let styles: Vec<Style> = (0..49).map(Style::of).collect();
        for (k, a) in styles.iter().enumerate() {
            for b in &styles[..k] {
                let same_grey = (lightness(a.colour) - lightness(b.colour)).abs() < 0.02;
                assert!(!same_grey || a.marker != b.marker || a.colour != b.colour);
                assert!(a.marker != b.marker || a.colour != b.colour);
            }
        }
        // Neighbours can be distinguished in grey.
        for pair in SERIES.windows(2) {
            assert!((lightness(pair[0]) - lightness(pair[1])).abs() > 0.05);
        }
    }

    #[test]
    fn heat_maps_grow_lighter() {
        let all: Vec<f64> = (0..=100).map(|k| lightness(sequential(k as f64 / 100.0))).collect();
        assert!(all.windows(2).all(|w| w[1] > w[0] - 1e-4));
        assert!(all[100] - all[0] > 0.7);
        assert_eq!((sequential(f64::NAN), diverging(f64::NAN)), (NOTHING, NOTHING));
        // No value looks like nothing.
        let apart = |a: RGBColor, b: RGBColor| {
            let pairs = [(a.0, b.0), (a.1, b.1), (a.2, b.2)];
            pairs.iter().map(|(a, b)| a.abs_diff(*b)).max()
        };
        for shade in [sequential, diverging] {
            let nearest = (0..=100).map(|k| apart(shade(k as f64 / 100.0), NOTHING)).min();
            assert!(nearest > Some(Some(20)), "{nearest:?}");
        }
        assert_eq!(sequential(7.0), sequential(1.0));
    }

    #[test]
    fn differences_grow_darker_both_ways() {
        assert_eq!(diverging(0.5), PAPER);
        assert_eq!((diverging(-3.0), diverging(2.0)), (BELOW, ABOVE));
        let all: Vec<f64> =
            (0..=50).map(|k| lightness(diverging(0.5 + k as f64 / 100.0))).collect();
        assert!(all.windows(2).all(|w| w[1] < w[0]));
        let all: Vec<f64> =
            (0..=50).map(|k| lightness(diverging(0.5 - k as f64 / 100.0))).collect();
        assert!(all.windows(2).all(|w| w[1] < w[0]));
    }
}
