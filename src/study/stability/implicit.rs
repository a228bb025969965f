//! The step of the implicit methods: Crank–Nicolson is of second order, backward Euler of first.

use crate::base::error::{Error, Result};
use crate::problem::case::{Case, ProfileChoice, PropagatorMethod};
use crate::study::choices::IMPLICIT_PROPAGATORS;
use crate::study::grids::coarsened;
use crate::study::stability::cases::grid_notes;
use crate::study::stability::panel::{Border, Curve, CurvePoint, PanelContents, PanelTask};
use crate::study::stability::reading::plateau;
use crate::study::trial::{plan_series, propagation};

/// Largest number of cells: each step of each mode solves a system.
const CELLS: usize = 256;
/// Tolerance of everything but the steps.
const TOLERANCE: f64 = 1e-6;
/// Fewest steps over the whole time, as a power of two.
const FEWEST: u32 = 4;
/// Binary logarithm of the largest number of steps.
const MOST: u32 = 12;
/// Error at which measured and predicted steps are compared: both are accurate there.
const COMPARED: f64 = 1e-3;

/// An order of convergence that was measured.
struct MeasuredOrder {
    order: f64,
    /// The shorter and the longer step between which the error has this order.
    steps: [f64; 2],
}

/// The order of the error between two steps: the two shortest whose error is neither near the
/// tolerance nor too large for an asymptotic order.
fn slope(points: &[CurvePoint]) -> Option<MeasuredOrder> {
    let mut fine = points.iter().filter(|p| p.measured > 20.0 * TOLERANCE && p.measured < 0.3);
    let (a, b) = (fine.next()?, fine.next()?);
    let order = (b.measured / a.measured).ln() / (b.x / a.x).ln();
    Some(MeasuredOrder { order, steps: [a.x, b.x] })
}

/// The index of the longest step, in points by rising step, that no shorter step improves on: none
/// makes the error smaller by a tenth.
fn stalled(points: &[CurvePoint]) -> Option<usize> {
    let shorter = |k: usize| points[..k].iter().map(|p| p.measured);
    (1..points.len())
        .rev()
        .find(|&k| shorter(k).fold(f64::INFINITY, f64::min) >= 0.9 * points[k].measured)
}

/// The step at which `of` crosses `threshold`, on the line between its neighbours in logarithms.
fn crossing(points: &[CurvePoint], threshold: f64, of: fn(&CurvePoint) -> f64) -> Option<f64> {
    let logarithmic = |point: &CurvePoint| CurvePoint { x: point.x.ln(), ..*point };
    let points: Vec<CurvePoint> = points.iter().map(logarithmic).collect();
    let [_, rising] = plateau(&points, threshold, of);
    rising.map(f64::exp)
}

/// The trials of one method.
struct ImplicitSteps {
    name: &'static str,
    method: PropagatorMethod,
    /// Points by rising step.
    points: Vec<CurvePoint>,
    /// The reason why a trial failed, if one did.
    refused: Option<String>,
    /// The largest number of steps, if the budget ended the trials.
    most_steps: Option<u32>,
}

impl ImplicitSteps {
    /// Tries `method` with ever shorter steps. Collective.
    fn measure(task: &PanelTask<'_>, case: &Case, method: PropagatorMethod) -> Self {
        let name = match method {
            PropagatorMethod::BackwardEuler => "backward Euler",
            _ => "Crank-Nicolson",
        };
        let mut found = Self { name, method, points: Vec::new(), refused: None, most_steps: None };
        for steps in (FEWEST..=MOST).map(|power| 1u32 << power) {
            let mut case = case.clone();
            case.propagator = propagation(case.duration(), method, Some(steps as usize));
            let Some(tried) = task.trial(&case) else {
                found.most_steps = Some(steps / 2);
                break;
            };
            match tried {
                Ok(trial) => found.points.push(CurvePoint {
                    x: case.duration() / f64::from(steps),
                    measured: trial.summary.error_semidiscrete.unwrap_or(f64::NAN),
                    theory: trial.summary.step_error.unwrap_or(f64::NAN),
                }),
                Err(error) => {
                    found.refused = Some(error.to_string());
                    break;
                }
            }
        }
        found.points.reverse();
        found
    }

    /// The order of convergence. Steps at which the error stalls do not count.
    fn order(&self) -> Option<MeasuredOrder> {
        slope(&self.points[stalled(&self.points).unwrap_or(0)..])
    }

    fn borders(&self) -> [Border; 2] {
        let Self { name, points, .. } = self;
        let order = self.order().map(|found| found.order);
        [
            Border::new(format!("{name}: order"), order, Some(self.method.order() as f64)),
            Border::new(
                format!("{name}: step of an error of {COMPARED:e}"),
                crossing(points, COMPARED, |p| p.measured),
                crossing(points, COMPARED, |p| p.theory),
            ),
        ]
    }

    fn verdict(&self) -> String {
        let Self { name, points, .. } = self;
        let expected = self.method.order();
        let mut verdict = match self.order() {
            Some(MeasuredOrder { order, steps: [short, long] }) => format!(
                "{name} converges with order {order:.2} (theory {expected}) between the steps \
                 {long:.2e} and {short:.2e}. "
            ),
            None => {
                format!("{name}: no order, as too few errors are those of the step. ")
            }
        };
        if let (Some(k), Some(shortest)) = (stalled(points), points.first()) {
            let from = points[k];
            verdict += &format!(
                "Below a step of {:.2e} its error no longer falls: {:.1e} there, {:.1e} at the \
                 shortest, {:.2e}. ",
                from.x, from.measured, shortest.measured, shortest.x
            );
        }
        verdict
    }
}

/// Measures the panel. Collective.
///
/// # Errors
/// [`Error::Input`] if the inflow depends on time, or no step could be tried. Errors of single
/// trials become notes.
pub fn panel(task: &PanelTask<'_>) -> Result<PanelContents> {
    if task.case.varies() {
        let why = "the inflow depends on time: modes are stepped by a commutator-free scheme";
        return Err(Error::input(why));
    }
    let mut case = coarsened(task.case, CELLS);
    (case.tolerance, case.verify) = (TOLERANCE, true);
    plan_series(&mut case.warp);
    (case.warp.weights, case.warp.profile) = (true, ProfileChoice::Planned);
    let all = IMPLICIT_PROPAGATORS.map(|method| ImplicitSteps::measure(task, &case, method));
    let refused = all.iter().rev().find_map(|steps| steps.refused.clone());
    if all.iter().all(|steps| steps.points.is_empty()) {
        let none = || "no step could be tried within the budget".to_owned();
        return Err(Error::Input(refused.unwrap_or_else(none)));
    }
    let mut notes = grid_notes(task.case, &case);
    notes.extend(all.iter().filter_map(|steps| {
        let most = steps.most_steps?;
        Some(format!("{}: {most} steps at most", steps.name))
    }));
    notes.extend(refused);
    let verdicts: String = all.iter().map(ImplicitSteps::verdict).collect();
    let last =
        "Runs warn if the error of the step exceeds the tolerance, and name a step that meets it.";
    Ok(PanelContents {
        shape: case.space.elements(),
        borders: all.iter().flat_map(ImplicitSteps::borders).collect(),
        curves: (all.into_iter()).map(|steps| Curve::new(steps.name, steps.points)).collect(),
        verdict: verdicts + last,
        notes,
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    /// An error that falls down to the shortest step, one that rises again, and one that is
    /// constant.
    #[test]
    fn where_errors_no_longer_fall() {
        let points = |errors: &[f64]| -> Vec<CurvePoint> {
            let point = |(k, &measured): (usize, &f64)| CurvePoint {
                x: f64::from(1u32 << k),
                measured,
                theory: f64::NAN,
            };
            errors.iter().enumerate().map(point).collect()
        };
        let [falls, turns, stays] = [
            points(&[1e-4, 4e-4, 1.6e-3, 6.4e-3]),
            points(&[8e-4, 4e-4, 1e-4, 4e-4, 1.6e-3]),
            points(&[1e-3, 1e-3, 1e-3]),
        ];
        assert_eq!(stalled(&falls), None);
        assert_eq!(stalled(&turns), Some(2));
        assert_eq!(stalled(&stays), Some(2));
        let MeasuredOrder { order, steps } = slope(&turns[2..]).expect("it falls there");
        assert!((order - 2.0).abs() < 1e-12 && steps == [4.0, 8.0]);
        assert_eq!(stalled(&[]), None);
    }
}
