//! Panels in time on which the inflow `b(t)` is smooth, for integrals over time by Gauss's rule.
//!
//! There are 32 equal panels to begin with. One is halved until the Legendre series of `b` on it
//! has decayed at the last of [`NODES`] coefficients and has the values at both ends of the panel,
//! at some points of every end of the box. What is shorter than 1e-12 of the whole is not halved:
//! `b` jumps there. Neighbours are merged again where `b` is smooth on both together, so that a
//! jump takes two or three panels more.

use crate::base::quadrature::{gauss_legendre, legendre_values};
use crate::base::random::evenly_spread;
use crate::problem::case::Case;
use crate::problem::grid::{Axis, AxisEnd, coordinate};

/// Nodes of Gauss's rule on a panel.
pub const NODES: usize = 16;
/// Number of panels to begin with.
const FIRST: usize = 32;
/// Largest number of panels.
pub const MOST: usize = 1 << 14;
/// Length, as a part of the whole, below which a panel is not halved.
const SHORTEST: f64 = 1e-12;
/// The last coefficients of a decayed series, relative to the largest `|b|`. Those that Gauss's
/// rule does not integrate, of twice the degree, are about the square of it.
const DECAYED: f64 = 1e-8;
/// Largest distance of the series from the values at the ends, relative to the largest `|b|`.
const AT_ENDS: f64 = 1e-6;
/// The largest `|b|` is taken to be at least this: the tail of a pulse between the times of all
/// candidates underflows, and numbers without all their digits are smooth on no panel.
const TINY: f64 = 1e-290;
/// Points at all ends of the box at which `b` is compared at [`TIMES`] times. There are at most as
/// many of an end as it has nodes with entering velocities.
const CANDIDATES: usize = 4096;
const TIMES: usize = 64;
/// Of these, the number of points at which panels are tested, shared out equally to the ends: half
/// of them where `b` has the largest range, half where it varies most from time to time.
const SAMPLES: usize = 64;

/// A panel, cut into equal parts.
#[derive(Clone, Copy, Debug, PartialEq)]
struct TimePanel {
    begin: f64,
    end: f64,
    parts: usize,
}

impl TimePanel {
    /// Its parts, in order.
    fn each(self) -> impl Iterator<Item = [f64; 2]> {
        let length = self.end - self.begin;
        let face = move |k: usize| {
            if k == self.parts {
                self.end
            } else {
                self.begin + length * k as f64 / self.parts as f64
            }
        };
        (0..self.parts).map(move |k| [face(k), face(k + 1)])
    }
}

/// Panels over a run.
#[derive(Clone, Debug, PartialEq)]
pub struct InflowPanels {
    panels: Vec<TimePanel>,
    /// The time after the begin of the run from which on the inflow varies too fast for [`MOST`]
    /// panels; `None` if it is smooth on each, but for those shorter than round-off.
    pub unresolved_from: Option<f64>,
}

impl InflowPanels {
    /// Panels for the inflow of `case`, which depends on time, of length `longest` at most. The
    /// same on all ranks.
    pub fn new(case: &Case, longest: f64) -> Self {
        let duration = case.duration();
        let inflow = SampledInflow::new(case);
        let first = (0..FIRST).map(|k| [k, k + 1].map(|k| duration * k as f64 / FIRST as f64));
        let mut stack: Vec<[f64; 2]> = first.rev().collect();
        let mut smooth: Vec<[f64; 2]> = Vec::new();
        let (shortest, widest) = (SHORTEST * duration, duration / FIRST as f64 * (1.0 + 1e-12));
        let mut unresolved_from = None;
        while let Some(panel) = stack.pop() {
            let [begin, end] = panel;
            let is_short = end - begin <= shortest;
            if unresolved_from.is_none() && !is_short && !inflow.is_smooth_on(panel) {
                if smooth.len() + stack.len() < MOST {
                    let middle = 0.5 * (begin + end);
                    stack.extend([[middle, end], [begin, middle]]);
                    continue;
                }
                unresolved_from = Some(begin);
            }
            match smooth.last_mut() {
                // What is short stays, as it holds a jump.
                Some(last)
                    if !is_short
                        && last[1] - last[0] > shortest
                        && end - last[0] <= widest
                        && unresolved_from.is_none()
                        && inflow.is_smooth_on([last[0], end]) =>
                {
                    last[1] = end;
                }
                _ => smooth.push(panel),
            }
        }
        let parts = |[begin, end]: [f64; 2]| ((end - begin) / longest).ceil().max(1.0) as usize;
        let panel = |ends: [f64; 2]| TimePanel { begin: ends[0], end: ends[1], parts: parts(ends) };
        Self { panels: smooth.into_iter().map(panel).collect(), unresolved_from }
    }

    /// The parts of all panels, in order.
    pub fn each(&self) -> impl Iterator<Item = [f64; 2]> {
        self.panels.iter().flat_map(|panel| panel.each())
    }

    /// The sum of `cost` over the parts of all panels, which is asked for two parts of each: all
    /// but the first cost as much as the second.
    pub fn sum(&self, mut cost: impl FnMut([f64; 2]) -> usize) -> usize {
        let of_panel = |panel: &TimePanel| {
            let mut parts = panel.each();
            let first = parts.next().map_or(0, &mut cost);
            first + (panel.parts - 1) * parts.next().map_or(0, &mut cost)
        };
        self.panels.iter().map(of_panel).sum()
    }
}

/// The inflow at points of the ends of the box.
struct SampledInflow<'a> {
    case: &'a Case,
    points: Vec<[f64; 6]>,
    /// The largest `|b|` at the candidates.
    largest: f64,
    /// Nodes on `[−1, 1]`, each with its weight times the Legendre polynomials there.
    rule: Vec<(f64, Vec<f64>)>,
}

/// The values of the inflow at a candidate.
#[derive(Clone, Copy)]
struct SampledPoint {
    point: [f64; 6],
    least: f64,
    most: f64,
    /// The value at the last time.
    last: f64,
    /// The sum of `|changes|` from time to time.
    variation: f64,
}

impl<'a> SampledInflow<'a> {
    fn new(case: &'a Case) -> Self {
        let ends = case.space.open_ends();
        let (mut points, mut largest) = (Vec::new(), TINY);
        for end in &ends {
            let mut found = candidates(case, *end, CANDIDATES / ends.len());
            largest = found.iter().fold(largest, |most, c| most.max(c.most).max(-c.least));
            let quota = SAMPLES / ends.len() / 2;
            found.sort_by(|a, b| (b.most - b.least).total_cmp(&(a.most - a.least)));
            let rest = found.split_off(quota.min(found.len()));
            points.extend(found.iter().map(|candidate| candidate.point));
            let mut found = rest;
            found.sort_by(|a, b| b.variation.total_cmp(&a.variation));
            points.extend(found.iter().take(quota).map(|candidate| candidate.point));
        }
        let rule = gauss_legendre(NODES).into_iter().map(|point| {
            let values = legendre_values(NODES - 1, point.node);
            let weighted = values.into_iter().map(|value| value * point.weight).collect();
            (point.node, weighted)
        });
        Self { case, points, largest, rule: rule.collect() }
    }

    /// The values at a time after the begin of the run, point by point.
    fn at(&self, time: f64) -> Vec<f64> {
        self.case.fields[0].entering().at_points(&self.points, self.case.start_time + time)
    }

    /// Whether at every point the last two coefficients of the Legendre series on a panel have
    /// decayed, and the series has the values at the ends: no node is near them, and a jump there
    /// would be overlooked. Values that are not finite are refused elsewhere.
    fn is_smooth_on(&self, [begin, end]: [f64; 2]) -> bool {
        let mut series = vec![[0.0; NODES]; self.points.len()];
        let mut largest = self.largest;
        for (node, weighted) in &self.rule {
            let values = self.at(0.5 * (begin + end + node * (end - begin)));
            for (coefficients, value) in series.iter_mut().zip(values) {
                if value.is_finite() {
                    largest = largest.max(value.abs());
                }
                for (j, (sum, factor)) in coefficients.iter_mut().zip(weighted).enumerate() {
                    *sum += (j as f64 + 0.5) * factor * value;
                }
            }
        }
        let last = |c: &[f64; NODES]| c[NODES - 2].abs().max(c[NODES - 1].abs());
        if series.iter().any(|c| last(c) > DECAYED * largest) {
            return false;
        }
        // Just inside, as a panel may begin or end at a jump.
        let inside = 0.25 * SHORTEST * self.case.duration();
        let is_off = |(time, sign): (f64, f64)| {
            series.iter().zip(self.at(time)).any(|(coefficients, value)| {
                // P_j(±1) = (±1)^j.
                let at_end = coefficients.iter().rev().fold(0.0, |sum, c| sum * sign + c);
                (at_end - value).abs() > AT_ENDS * largest
            })
        };
        ![(begin + inside, -1.0), (end - inside, 1.0)].into_iter().any(is_off)
    }
}

/// At most `most` points of an end of the box, nodes along the other axes and entering, at which
/// the inflow is finite at [`TIMES`] times.
fn candidates(case: &Case, end: AxisEnd, most: usize) -> Vec<SampledPoint> {
    let (n, space) = (case.space.dimension(), &case.space);
    let nodes = |(k, axis): (usize, &Axis)| -> Vec<f64> {
        if k == end.axis {
            return vec![axis.just_outside(end.upper)];
        }
        let mut nodes: Vec<f64> =
            (0..axis.cells).map(|i| axis.centre_in_element(i as i64)).collect();
        if k == end.axis + n {
            nodes.retain(|v| if end.upper { *v < 0.0 } else { *v > 0.0 });
        }
        nodes
    };
    let nodes: Vec<Vec<f64>> = space.axes().enumerate().map(nodes).collect();
    let all: f64 = nodes.iter().map(|nodes| nodes.len() as f64).product();
    let count = (most as f64).min(all) as usize;
    let point = |i: usize| {
        let spread = (evenly_spread(i) * all).floor();
        let mut left = if count as f64 == all { i as f64 } else { spread };
        let mut point = [0.0; 6];
        for (k, nodes) in nodes.iter().enumerate() {
            let of_axis = nodes.len() as f64;
            point[coordinate(n, k)] = nodes[(left % of_axis) as usize];
            left = (left / of_axis).floor();
        }
        point
    };
    let points: Vec<[f64; 6]> = (0..count).map(point).collect();
    let formula = case.fields[0].entering();
    let mut found: Vec<SampledPoint> = Vec::new();
    for k in 0..TIMES {
        // No period fits the distances of these times; of `k` times the golden ratio, 64 times a
        // Fibonacci number almost would.
        let part = evenly_spread(k * k);
        let time = case.start_time + case.duration() * (k as f64 + part) / TIMES as f64;
        let values = formula.at_points(&points, time);
        if k == 0 {
            let start = |(&point, &value)| SampledPoint {
                point,
                least: value,
                most: value,
                last: value,
                variation: 0.0,
            };
            found = points.iter().zip(&values).map(start).collect();
        }
        for (candidate, value) in found.iter_mut().zip(values) {
            candidate.variation += (value - candidate.last).abs();
            candidate.last = value;
            (candidate.least, candidate.most) =
                (candidate.least.min(value), candidate.most.max(value));
        }
    }
    // One value that is not finite stays in the sum.
    found.retain(|candidate| candidate.variation.is_finite() && candidate.last.is_finite());
    found
}

#[cfg(test)]
mod tests {
    use super::*;

    /// A case from time 0 to 1 with this inflow.
    fn case_with(inflow: &str) -> Case {
        case_with_settings(inflow, &[])
    }

    fn case_with_settings(inflow: &str, settings: &[String]) -> Case {
        let text = format!(
            "[[axis]]\nx = {{ lower = 0, upper = 1, cells = 4 }}\n\
             v = {{ lower = 0.5, upper = 1, cells = 200 }}\n\
             [[potential]]\nvalue = \"0\"\n[initial]\nf = \"0\"\n\
             [inflow]\nvalue = \"{inflow}\"\n[time]\nend = 1\n"
        );
        Case::parse("test", &text, settings).expect("a case")
    }

    /// The number of panels for an inflow, after its integral on them was compared with `exact`.
    fn panels_for(inflow: &str, exact: f64) -> usize {
        let case = case_with(inflow);
        let panels = InflowPanels::new(&case, f64::INFINITY);
        assert_eq!(panels.unresolved_from, None, "{inflow}");
        let formula = case.fields[0].entering();
        let mut sum = 0.0;
        for panel in panels.each() {
            for point in gauss_legendre(NODES).into_iter().map(|point| point.moved_to(panel)) {
                sum += point.weight * formula.at_point(&[0.0; 6], point.node);
            }
        }
        assert!((sum - exact).abs() < 3e-12, "{inflow}: {sum:e} for {exact:e}");
        panels.panels.len()
    }

    /// Panels are few where the inflow is smooth, and many where it is fast; a jump or a kink takes
    /// a few more.
    #[test]
    fn panels_follow_the_inflow() {
        assert_eq!(panels_for("1 + cos(3*t)", 1.0 + 3f64.sin() / 3.0), FIRST);
        let jump = panels_for("1 if t < 0.3 else 0.25", 0.475);
        assert!((FIRST + 2..=FIRST + 3).contains(&jump), "{jump}");
        let kink = panels_for("abs(t - 0.37)", 0.5 * (0.37f64.powi(2) + 0.63f64.powi(2)));
        assert!((FIRST + 1..=FIRST + 3).contains(&kink), "{kink}");
        for k in 1..10 {
            let centre = 0.1 * f64::from(k);
            let area = 0.002 * std::f64::consts::PI.sqrt();
            let pulse = panels_for(&format!("exp(-((t - {centre})/0.002)^2)"), area);
            assert!((FIRST + 2..FIRST + 20).contains(&pulse), "{centre}: {pulse}");
            let width = 0.005;
            let square = panels_for(&format!("1 if abs(t - {centre}) < {width}/2 else 0"), width);
            assert!((FIRST..=FIRST + 6).contains(&square), "{centre}: {square}");
        }
        let fast = panels_for("1 + cos(2*pi*512*t)", 1.0);
        assert!((256..=1024).contains(&fast), "{fast}");
    }

    /// An inflow that varies too fast for the panels is found out, with its place in time.
    #[test]
    fn noise_is_not_resolved() {
        let from =
            |inflow: &str| InflowPanels::new(&case_with(inflow), f64::INFINITY).unresolved_from;
        assert!(from("1 + cos(1e7*t)").is_some_and(|time| time < 1e-3));
        let late = from("1 + (cos(1e7*t) if t > 0.6 else 0)").expect("noise");
        assert!((0.59..0.63).contains(&late), "{late}");
    }

    /// Panels follow a fast beam beside a larger slow one, and a beam of one cell. What is not
    /// finite where nothing enters does not matter.
    #[test]
    fn every_beam_counts() {
        let fast = "(1 + cos(2*pi*512*t))";
        let rows = [
            format!("3*(1 + cos(2*pi*3*t)) if v > 0.52 else {fast}"),
            // Beside the ends of the velocity axis, where points are as well.
            format!("3*(1 + cos(2*pi*3*t)) if abs(v - 0.6) > 0.02 else {fast}"),
            format!("{fast} if abs(v - 0.68875) < 0.001 else 0"),
            format!("{fast} if x < 0.5 else sqrt(x - 2)"),
        ];
        for inflow in rows {
            let panels = InflowPanels::new(&case_with(&inflow), f64::INFINITY);
            assert_eq!(panels.unresolved_from, None, "{inflow}");
            assert!(panels.panels.len() > 200, "{inflow}: {}", panels.panels.len());
        }
        // What is nowhere finite is refused by the run itself.
        let nowhere = InflowPanels::new(&case_with("sqrt(0.2 - t)"), f64::INFINITY);
        assert_eq!(nowhere.unresolved_from, None);
    }

    /// A pulse that no candidate sees is found, or missed, and not taken for noise.
    #[test]
    fn tails_of_pulses_are_not_noise() {
        for centre in ["0.90696", "0.95394", "0.3815", "0.1396"] {
            for width in ["0.00045", "0.0004", "0.0003", "0.0001"] {
                let pulse = case_with(&format!("exp(-((t - {centre})/{width})^2)"));
                let panels = InflowPanels::new(&pulse, f64::INFINITY);
                assert_eq!(panels.unresolved_from, None, "{centre}, {width}");
                assert!(panels.panels.len() < 1000, "{centre}, {width}: {}", panels.panels.len());
            }
        }
    }

    /// What varies where nothing enters does not matter, nor what is below 1e-8 of the largest
    /// inflow, also if that is negative. Many panels are not too many.
    #[test]
    fn only_what_enters_is_looked_at() {
        let both_ways = |inflow: &str| {
            let velocity = ["axis.0.v.lower=-1".to_owned()];
            let case = case_with_settings(inflow, &velocity);
            let panels = InflowPanels::new(&case, f64::INFINITY);
            assert_eq!(panels.unresolved_from, None, "{inflow}");
            panels.panels.len()
        };
        let leaving = both_ways("cos(1e7*t) if (x - 0.5)*v > 0 && abs(v) < 0.8 else 1");
        assert_eq!(leaving, FIRST);
        let upper = both_ways("1 + cos(2*pi*512*t) if x > 0.5 && abs(v + 0.5) < 0.2 else 1");
        assert!(upper > 200, "{upper}");
        let small = both_ways("-1 if t < 0.5 else -1e-9*(1 + cos(1e7*t))");
        assert!(small <= FIRST + 3, "{small}");
        assert!(both_ways("1 + cos(2*pi*5000*t)") > 2500);
        // The jump of one beam beside others that vary more often, by less.
        let jump =
            both_ways("(1 if t < 0.3 else 0) if abs(v - 0.6) < 0.006 else 1 + 0.1*cos(2*pi*20*t)");
        assert!(jump >= FIRST + 2, "{jump}");
    }

    /// Many parts take no memory and no time.
    #[test]
    fn parts_are_counted_together() {
        let panels = InflowPanels::new(&case_with("1 + cos(t)"), 1e-12);
        assert!(panels.sum(|_| 1) > 900_000_000_000);
        let few = InflowPanels::new(&case_with("1 + cos(t)"), 1e-3);
        assert_eq!(few.sum(|_| 1), few.each().count());
    }
}
