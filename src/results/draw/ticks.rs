//! Axes for `plotters`: the map from values to lengths, ticks and their labels.
//!
//! The ticks of `plotters` itself are not used: its logarithmic axes have no tick below 2e-16 and
//! none between two powers of ten, and its linear axes have no round numbers if they are shorter
//! than 2e-16.

use crate::results::figure::{PlotAxis, Scale};
use plotters::coord::ranged1d::{KeyPointHint, NoDefaultFormatting, Ranged, ValueFormatter};
use std::ops::Range;

/// Distance of labelled ticks, in points.
const SPACING: f64 = 62.0;

/// An axis between two ends, with its ticks.
#[derive(Clone)]
pub struct Ruler {
    ends: [f64; 2],
    scale: Scale,
    ticks: Vec<Tick>,
}

impl Ruler {
    /// The axis from `ends[0]` to `ends[1]`, drawn `length` points long.
    pub fn new(axis: &PlotAxis, ends: [f64; 2], length: f64) -> Self {
        let wanted = (length / SPACING).round().max(2.0) as usize;
        let ticks = match axis.scale {
            _ if !axis.names.is_empty() => named(&axis.names),
            Scale::Linear if axis.whole => whole(ends, wanted),
            Scale::Linear => linear(ends, wanted),
            Scale::Log => logarithmic(ends, wanted),
        };
        Self { ends, scale: axis.scale, ticks }
    }

    /// Fraction of the axis below `value`; NaN for a value that a logarithmic axis cannot show.
    pub fn fraction(&self, value: f64) -> f64 {
        let [lower, upper] = self.ends;
        match self.scale {
            Scale::Linear => (value - lower) / (upper - lower),
            Scale::Log if value > 0.0 => (value.ln() - lower.ln()) / (upper.ln() - lower.ln()),
            Scale::Log => f64::NAN,
        }
    }

    /// Labels of the ticks.
    pub fn labels(&self) -> impl Iterator<Item = &str> {
        self.ticks.iter().filter_map(|tick| tick.label.as_deref())
    }
}

impl Ranged for Ruler {
    type FormatOption = NoDefaultFormatting;
    type ValueType = f64;

    fn map(&self, value: &f64, limit: (i32, i32)) -> i32 {
        limit.0 + (self.fraction(*value) * f64::from(limit.1 - limit.0)).round() as i32
    }

    /// Positions of the ticks. Each tick is a light point; a tick with a label is a bold point too.
    fn key_points<Hint: KeyPointHint>(&self, hint: Hint) -> Vec<f64> {
        let light = hint.weight().allow_light_points();
        let shown = self.ticks.iter().filter(|tick| light || tick.label.is_some());
        shown.map(|tick| tick.at).collect()
    }

    fn range(&self) -> Range<f64> {
        self.ends[0]..self.ends[1]
    }
}

impl ValueFormatter<f64> for Ruler {
    fn format_ext(&self, value: &f64) -> String {
        let tick = self.ticks.iter().find(|tick| tick.at == *value);
        tick.and_then(|tick| tick.label.clone()).unwrap_or_default()
    }
}

/// A tick; it has no label if there is no room for one.
#[derive(Clone, Debug, PartialEq)]
struct Tick {
    at: f64,
    label: Option<String>,
}

/// Ticks with these names at 0, 1, … .
fn named(names: &[String]) -> Vec<Tick> {
    let tick = |(k, name): (usize, &String)| Tick { at: k as f64, label: Some(name.clone()) };
    names.iter().enumerate().map(tick).collect()
}

/// About `wanted` ticks of a linear axis, at whole numbers only.
fn whole(ends: [f64; 2], wanted: usize) -> Vec<Tick> {
    let most = (ends[1] - ends[0]).clamp(1.0, 100.0) as usize;
    let mut all = linear(ends, wanted.min(most));
    all.retain(|tick| tick.at.fract() == 0.0);
    all
}

/// About `wanted` multiples of 1, 2 or 5 times a power of ten.
fn linear([lower, upper]: [f64; 2], wanted: usize) -> Vec<Tick> {
    let rough = (upper - lower) / wanted.max(1) as f64;
    let power = 10f64.powf(rough.log10().floor());
    if !(power > 0.0 && (10.0 * power).is_finite()) {
        return Vec::new();
    }
    let numbers = |step: f64| {
        let slack = 1e-9 * (upper - lower) / step;
        [(lower / step - slack).ceil(), (upper / step + slack).floor()]
    };
    const STEPS: [f64; 7] = [0.1, 0.2, 0.5, 1.0, 2.0, 5.0, 10.0];
    let steps = STEPS.map(|m| m * power);
    let wide = steps.iter().position(|step| *step >= 0.999 * rough).unwrap_or(STEPS.len() - 1);
    // A scale needs two numbers.
    let has_two = |step: &&f64| {
        let [first, last] = numbers(**step);
        last > first
    };
    let step = *steps[..=wide].iter().rev().find(has_two).unwrap_or(&steps[wide]);
    let [first, last] = numbers(step);
    (0..=(last - first).clamp(0.0, 100.0) as usize)
        .map(|k| {
            let at = (first + k as f64) * step;
            Tick { at, label: Some(number(at, step)) }
        })
        .collect()
}

/// Ticks at powers of ten, about `wanted` of them labelled. With fewer than two powers, 2 and 5
/// times a power have labels, too. If that gives fewer than two labels, ticks are those of a linear
/// axis. There are none unless the ends are positive and finite.
fn logarithmic([lower, upper]: [f64; 2], wanted: usize) -> Vec<Tick> {
    if !(lower > 0.0 && upper.is_finite()) {
        return Vec::new();
    }
    let (first, last) =
        ((lower.log10() - 1e-9).floor() as i32, (upper.log10() + 1e-9).ceil() as i32);
    let inside = |at: &f64| (lower * (1.0 - 1e-9)..=upper * (1.0 + 1e-9)).contains(at);
    let decades: Vec<i32> = (first..=last).filter(|e| inside(&10f64.powi(*e))).collect();
    let every = decades.len().div_ceil(wanted.max(1)).max(1) as i32;
    let few = decades.len() < 2;
    let fine = decades.len() <= 5;
    let mut all = Vec::new();
    for e in first..=last {
        for m in 1..10 {
            let at = f64::from(m) * 10f64.powi(e);
            if !inside(&at) || (m > 1 && !fine) {
                continue;
            }
            let label = match m {
                1 => (e.rem_euclid(every) == 0).then(|| power_of_ten(e)),
                2 | 5 if few => Some(times_power(m, e)),
                _ => None,
            };
            all.push(Tick { at, label });
        }
    }
    let labels = all.iter().filter(|tick| tick.label.is_some()).count();
    if few && labels < 2 && lower < upper { linear([lower, upper], wanted) } else { all }
}

/// `10⁻³`; `1` and `10` as they are.
fn power_of_ten(exponent: i32) -> String {
    const DIGITS: [char; 10] = ['⁰', '¹', '²', '³', '⁴', '⁵', '⁶', '⁷', '⁸', '⁹'];
    match exponent {
        0 => "1".to_owned(),
        1 => "10".to_owned(),
        _ => {
            let digits = exponent.unsigned_abs().to_string();
            let raised = digits.bytes().map(|d| DIGITS[usize::from(d - b'0')]);
            let sign = (exponent < 0).then_some('⁻');
            "10".chars().chain(sign).chain(raised).collect()
        }
    }
}

/// `2·10⁻³`; `0.02` to `50` as they are.
fn times_power(factor: i32, exponent: i32) -> String {
    match exponent {
        -2..=1 => format!("{}", f64::from(factor) * 10f64.powi(exponent)),
        _ => format!("{factor}·{}", power_of_ten(exponent)),
    }
}

/// `value` with as many digits as distinguish multiples of `step`.
fn number(value: f64, step: f64) -> String {
    let value = if value.abs() < 1e-9 * step { 0.0 } else { value };
    let large = value.abs().max(step);
    if !(1e-4..1e6).contains(&step) || large >= 1e6 {
        let places = (large.log10().floor() - step.log10().floor()).clamp(0.0, 15.0) as usize;
        return if value == 0.0 { "0".to_owned() } else { format!("{value:.places$e}") };
    }
    let places = (-(step * 1.000_001).log10().floor()).max(0.0) as usize;
    format!("{value:.places$}")
}

#[cfg(test)]
mod tests {
    use super::*;

    fn labels(ticks: &[Tick]) -> Vec<&str> {
        ticks.iter().filter_map(|t| t.label.as_deref()).collect()
    }

    #[test]
    fn axes_of_all_numbers_have_a_few_ticks() {
        let all = [f64::from_bits(1), f64::MAX];
        assert!((2..=8).contains(&labels(&logarithmic(all, 6)).len()));
        assert_eq!(logarithmic([0.0, f64::INFINITY], 6), []);
        let ruler = Ruler::new(&PlotAxis::log("x"), all, 400.0);
        assert_eq!([all[0], all[1]].map(|end| ruler.fraction(end)), [0.0, 1.0]);
    }

    #[test]
    fn round_numbers_within_the_axis() {
        let found = linear([-1.5, 1.5], 6);
        assert_eq!(labels(&found), ["-1.5", "-1.0", "-0.5", "0.0", "0.5", "1.0", "1.5"]);
        assert_eq!(labels(&linear([0.0, 40.0], 4)), ["0", "10", "20", "30", "40"]);
        assert_eq!(labels(&linear([0.0, 3e-7], 3)), ["0", "1e-7", "2e-7", "3e-7"]);
        for (lower, upper) in [(0.0, 1.0), (-3.2, 17.9), (1e8, 1.1e8), (0.1, 0.100_3)] {
            let found = linear([lower, upper], 5);
            assert!((3..=8).contains(&found.len()), "{found:?}");
            let mut texts = labels(&found);
            texts.dedup();
            assert_eq!(texts.len(), found.len(), "{found:?}");
        }
        // Axes of colour bars for values of both signs.
        for most in (1..1000).map(|k| f64::from(k) * 0.01) {
            for wanted in 1..6 {
                let found = linear([-most, most], wanted);
                assert!((2..=8).contains(&found.len()), "{most}: {found:?}");
            }
        }
        // An axis without length has no ticks, and ends.
        assert!(linear([1.0, 1.0], 5).len() <= 1);
    }

    #[test]
    fn axes_of_whole_numbers() {
        let axis = PlotAxis::linear("applications").whole();
        for ends in [[27.9, 29.1], [0.0, 3.0], [0.0, 250.0], [-1.0, 1.0]] {
            let ruler = Ruler::new(&axis, ends, 280.0);
            assert!(!ruler.ticks.is_empty());
            for tick in ruler.ticks {
                let label = tick.label.unwrap_or_default();
                assert!(label.parse::<i64>().is_ok(), "{label}");
            }
        }
    }

    #[test]
    fn decades() {
        let found = logarithmic([1e-12, 1.0], 7);
        assert_eq!(labels(&found), ["10⁻¹²", "10⁻¹⁰", "10⁻⁸", "10⁻⁶", "10⁻⁴", "10⁻²", "1"]);
        assert_eq!(labels(&logarithmic([1.5, 8.0], 5)), ["2", "5"]);
        assert_eq!(labels(&logarithmic([0.5, 40.0], 5)), ["1", "10"]);
    }
}
