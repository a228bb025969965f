//! Panels in time on which the inflow `b(t)` is smooth, for integrals over time by Gauss's rule.
//!
//! A panel of [`FIRST`] equal ones is halved until the Legendre series of `b` on it has decayed at
//! the last of [`NODES`] coefficients, at [`SAMPLES`] points of the ends of the box. What is
//! shorter than [`SHORTEST`] of the whole is not halved: `b` jumps there. Neighbours are merged
//! again where `b` is smooth on both together, so that a jump takes three panels.

use crate::base::quadrature::{gauss_legendre, legendre_values};
use crate::problem::case::Case;
use crate::problem::grid::MAX_DIMENSION;

/// Nodes of Gauss's rule on a panel.
pub const NODES: usize = 16;
/// Number of panels to begin with.
const FIRST: usize = 32;
/// Largest number of panels.
const MOST: usize = 1 << 14;
/// Length, as a part of the whole, below which a panel is not halved.
const SHORTEST: f64 = 1e-12;
/// The last coefficients of a decayed series, relative to the largest `|b|`. Those that Gauss's
/// rule does not integrate, of twice the degree, are about the square of it.
const DECAYED: f64 = 1e-8;
/// Largest distance of the series from the values at the ends, relative to the largest `|b|`.
const AT_ENDS: f64 = 1e-6;
/// Points at which panels are tested: of [`CANDIDATES`] those where `b` varies most.
const SAMPLES: usize = 64;
/// Random points at the ends of the box, and times at which `b` is compared there.
const CANDIDATES: usize = 4096;
const TIMES: usize = 64;
/// The golden ratio.
const GOLDEN: f64 = 1.618_033_988_749_895;

/// Panels over a run.
#[derive(Clone, Debug, PartialEq)]
pub struct InflowPanels {
    /// Their ends, from 0 to the duration of the run, ascending.
    pub ends: Vec<f64>,
    /// Whether the inflow is smooth on each, but for those shorter than round-off. Otherwise it
    /// varies too fast.
    pub resolved: bool,
}

impl InflowPanels {
    /// Panels for the inflow of `case`, which depends on time, of length `longest` at most. The
    /// same on all ranks.
    pub fn new(case: &Case, longest: f64) -> Self {
        let duration = case.duration();
        let inflow = SampledInflow::new(case);
        let first = (0..FIRST).map(|k| [k, k + 1].map(|k| duration * k as f64 / FIRST as f64));
        let mut stack: Vec<[f64; 2]> = first.rev().collect();
        let mut panels: Vec<[f64; 2]> = Vec::new();
        let shortest = SHORTEST * duration;
        let mut resolved = true;
        while let Some(panel) = stack.pop() {
            let [begin, end] = panel;
            let is_last = panels.len() + stack.len() >= MOST;
            if end - begin <= shortest || inflow.is_smooth_on(panel) || is_last {
                resolved &= !is_last;
                panels.push(panel);
            } else {
                let middle = 0.5 * (begin + end);
                stack.extend([[middle, end], [begin, middle]]);
            }
        }
        let widest = duration / FIRST as f64 * (1.0 + 1e-12);
        let mut merged: Vec<[f64; 2]> = Vec::new();
        for panel in panels {
            let length = |panel: &[f64; 2]| panel[1] - panel[0];
            match merged.last_mut() {
                // What is shorter stays, as it holds a jump.
                Some(last)
                    if resolved
                        && length(last).min(length(&panel)) > shortest
                        && panel[1] - last[0] <= widest
                        && inflow.is_smooth_on([last[0], panel[1]]) =>
                {
                    last[1] = panel[1];
                }
                _ => merged.push(panel),
            }
        }
        let mut ends = vec![0.0];
        for [begin, end] in merged {
            let parts = ((end - begin) / longest).ceil().max(1.0) as usize;
            let part = |k: usize| begin + (end - begin) * k as f64 / parts as f64;
            ends.extend((1..parts).map(part).chain([end]));
        }
        Self { ends, resolved }
    }

    /// The panels, in order.
    pub fn each(&self) -> impl Iterator<Item = [f64; 2]> {
        self.ends.windows(2).map(|ends| [ends[0], ends[1]])
    }
}

/// The inflow at points of the ends of the box.
struct SampledInflow<'a> {
    case: &'a Case,
    points: Vec<[f64; 6]>,
    /// The largest `|b|` found.
    largest: f64,
    /// Nodes on `[−1, 1]`, each with its weight times the Legendre polynomials there.
    rule: Vec<(f64, Vec<f64>)>,
}

impl<'a> SampledInflow<'a> {
    fn new(case: &'a Case) -> Self {
        let (n, space) = (case.space.dimension(), &case.space);
        let ends: Vec<_> = space
            .axes()
            .enumerate()
            .flat_map(|(k, axis)| [false, true].map(|up| (k, axis, up)))
            .collect();
        let mut points = space.random_points(CANDIDATES);
        for (point, (k, axis, at_upper)) in points.iter_mut().zip(ends.iter().cycle()) {
            let at = if *k < n { *k } else { MAX_DIMENSION + k - n };
            point[at] = axis.just_outside(*at_upper);
        }
        let formula = case.fields[0].entering();
        let mut ranges = vec![[f64::INFINITY, f64::NEG_INFINITY]; CANDIDATES];
        for k in 0..TIMES {
            // No period fits the distances of these times.
            let part = (k as f64 * GOLDEN).fract();
            let time = case.begin + case.duration() * (k as f64 + part) / TIMES as f64;
            for ([least, most], value) in ranges.iter_mut().zip(formula.at_points(&points, time)) {
                (*least, *most) = (least.min(value), most.max(value));
            }
        }
        let largest = ranges.iter().flatten().fold(0.0, |most: f64, value| most.max(value.abs()));
        let variation = |k: usize| ranges[k][1] - ranges[k][0];
        let mut order: Vec<usize> = (0..CANDIDATES).collect();
        order.sort_by(|&a, &b| variation(b).total_cmp(&variation(a)));
        let points = order.iter().take(SAMPLES).map(|&k| points[k]).collect();
        let rule = gauss_legendre(NODES).into_iter().map(|point| {
            let values = legendre_values(NODES - 1, point.node);
            let weighted = values.into_iter().map(|value| value * point.weight).collect();
            (point.node, weighted)
        });
        Self { case, points, largest, rule: rule.collect() }
    }

    /// The values at a time after the begin of the run, point by point.
    fn at(&self, time: f64) -> Vec<f64> {
        self.case.fields[0].entering().at_points(&self.points, self.case.begin + time)
    }

    /// Whether at every point the last two coefficients of the Legendre series on a panel have
    /// decayed, and the series has the values at the ends: no node is near them, and a jump there
    /// would be overlooked.
    fn is_smooth_on(&self, [begin, end]: [f64; 2]) -> bool {
        let mut series = vec![[0.0; NODES]; self.points.len()];
        for (node, weighted) in &self.rule {
            let values = self.at(0.5 * (begin + end + node * (end - begin)));
            for (coefficients, value) in series.iter_mut().zip(values) {
                for (j, (sum, factor)) in coefficients.iter_mut().zip(weighted).enumerate() {
                    *sum += (j as f64 + 0.5) * factor * value;
                }
            }
        }
        let decays = |c: &[f64; NODES]| c[NODES - 2].abs().max(c[NODES - 1].abs());
        if !series.iter().all(|c| decays(c) <= DECAYED * self.largest) {
            return false;
        }
        // Just inside, as a panel may begin or end at a jump.
        let inside = 0.25 * SHORTEST * self.case.duration();
        [(begin + inside, -1.0), (end - inside, 1.0)].into_iter().all(|(time, sign)| {
            let values = self.at(time);
            series.iter().zip(values).all(|(coefficients, value)| {
                // P_j(±1) = (±1)^j.
                let at_end = coefficients.iter().rev().fold(0.0, |sum, c| sum * sign + c);
                (at_end - value).abs() <= AT_ENDS * self.largest
            })
        })
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// A case from time 0 to 1 with this inflow.
    fn case_with(inflow: &str) -> Case {
        let text = format!(
            "[[axis]]\nx = {{ lower = 0, upper = 1, cells = 4 }}\n\
             v = {{ lower = 0.5, upper = 1, cells = 4 }}\n\
             [[potential]]\nvalue = \"0\"\n[initial]\nf = \"0\"\n\
             [inflow]\nvalue = \"{inflow}\"\n[time]\nend = 1\n"
        );
        Case::parse("test", &text, &[]).expect("a case")
    }

    /// The number of panels for an inflow, after its integral on them was compared with `exact`.
    fn panels_for(inflow: &str, exact: f64) -> usize {
        let case = case_with(inflow);
        let panels = InflowPanels::new(&case, f64::INFINITY);
        assert!(panels.resolved, "{inflow}");
        let formula = case.fields[0].entering();
        let mut sum = 0.0;
        for panel in panels.each() {
            for point in gauss_legendre(NODES).into_iter().map(|point| point.moved_to(panel)) {
                sum += point.weight * formula.at_point(&[0.0; 6], point.node);
            }
        }
        assert!((sum - exact).abs() < 3e-12, "{inflow}: {sum:e} for {exact:e}");
        panels.ends.len() - 1
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
        let pulse = panels_for("exp(-((t - 0.5)/0.002)^2)", 0.002 * std::f64::consts::PI.sqrt());
        assert!((FIRST + 2..FIRST + 20).contains(&pulse), "{pulse}");
        let fast = panels_for("1 + cos(2*pi*512*t)", 1.0);
        assert!((256..=1024).contains(&fast), "{fast}");
    }

    /// An inflow that varies too fast for the panels is found out.
    #[test]
    fn noise_is_not_resolved() {
        assert!(!InflowPanels::new(&case_with("1 + cos(1e7*t)"), f64::INFINITY).resolved);
    }
}
