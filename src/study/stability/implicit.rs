//! The step of the implicit methods: Crank–Nicolson is of second order, backward Euler of first.

use crate::base::error::Result;
use crate::parallel::communicator::World;
use crate::plan::Plan;
use crate::plan::layout::Resources;
use crate::problem::case::{Case, PropagatorMethod};
use crate::propagate::descriptor;
use crate::run::planning;
use crate::study::budget::Budget;
use crate::study::grids::coarsened;
use crate::study::stability::scene::note;
use crate::study::stability::{Border, Curve, Found, Name, Panel, Point, Scale};
use crate::study::trial::trial;

/// Cells that are enough: each mode and step solves a system.
const CELLS: usize = 256;
/// The tolerance of everything but the steps, at most.
const TOLERANCE: f64 = 1e-6;
/// Steps over the whole time: powers of two from …
const FEWEST: u32 = 4;
/// … to.
const MOST: u32 = 12;

/// The slope of `ln y` over `ln x` between the points with the two shortest steps whose error is that of the step, and those steps.
fn slope(points: &[Point]) -> Option<(f64, [f64; 2])> {
    let mut fine = points
        .iter()
        .filter(|p| p.measured > 20.0 * TOLERANCE && p.measured < 0.3);
    let (a, b) = (fine.next()?, fine.next()?);
    let slope = (b.measured / a.measured).ln() / (b.x / a.x).ln();
    Some((slope, [a.x, b.x]))
}

/// Of points by rising step, the one with the longest step of which no shorter one makes the error smaller by a tenth.
fn stalled(points: &[Point]) -> Option<usize> {
    let shorter = |k: usize| points[..k].iter().map(|p| p.measured);
    (1..points.len())
        .rev()
        .find(|&k| shorter(k).fold(f64::INFINITY, f64::min) >= 0.9 * points[k].measured)
}

/// The step at which `of` crosses `level`, on the line between its neighbours in logarithms.
fn crossing(points: &[Point], level: f64, of: fn(&Point) -> f64) -> Option<f64> {
    points.windows(2).find_map(|pair| {
        let [a, b] = [of(&pair[0]), of(&pair[1])];
        (a <= level && level < b).then(|| {
            let part = (level / a).ln() / (b / a).ln();
            (pair[0].x.ln() + part * (pair[1].x / pair[0].x).ln()).exp()
        })
    })
}

/// The panel. Collective.
///
/// # Errors
/// None but those of the trials, which are left out.
pub fn panel(world: &World, whole: &Case, budget: &Budget) -> Result<Found> {
    if whole.varies() {
        let why = "what enters depends on time: modes are stepped by a commutator-free scheme";
        return Ok(Err(why.to_owned()));
    }
    let mut case = coarsened(whole, CELLS);
    case.tolerance = TOLERANCE;
    case.verify = true;
    let warp = &mut case.warp;
    (warp.recovery, warp.interval, warp.points) = (None, None, None);
    (warp.weights, warp.coefficients) = (true, crate::problem::case::Coefficients::Analytic);
    warp.profile = crate::problem::case::ProfileChoice::Planned;
    warp.delta = crate::problem::case::Delta::Planned;
    let mut notes = note(whole, &case);
    let (mut curves, mut borders, mut verdict) = (Vec::new(), Vec::new(), String::new());
    // Where both can tell.
    let level = 1e-3;
    let methods = [
        ("Crank-Nicolson", PropagatorMethod::CrankNicolson),
        ("backward Euler", PropagatorMethod::BackwardEuler),
    ];
    let mut refused = None;
    for (name, method) in methods {
        let mut points: Vec<Point> = Vec::new();
        for power in FEWEST..=MOST {
            case.propagator.method = method;
            let step = case.end / f64::from(1u32 << power);
            case.propagator.step = Some(step);
            if budget.is_over() {
                notes.push(format!("{name}: {} steps at most", 1u32 << (power - 1)));
                break;
            }
            let here = Resources {
                ranks: world.group().size(),
                ..Resources::default()
            };
            let cost = |plan: &Plan| {
                let solves = plan.warp.as_ref().map_or(0, |w| w.solves);
                (solves * descriptor(method).applications_per_work() * case.space.cells()) as f64
            };
            let planned = planning::plan(world, &case, &here);
            if planned
                .as_ref()
                .is_ok_and(|plan| !budget.holds(cost(plan), 1.0))
            {
                notes.push(format!("{name}: {} steps at most", 1u32 << (power - 1)));
                break;
            }
            match planned.and_then(|_| trial(world, &case)) {
                Ok(found) => points.push(Point {
                    x: step,
                    measured: found.summary.error_semidiscrete.unwrap_or(f64::NAN),
                    theory: found.summary.step_error.unwrap_or(f64::NAN),
                }),
                Err(error) => {
                    refused = Some(error.to_string());
                    break;
                }
            }
        }
        points.reverse();
        let expected = method.order() as f64;
        let stalled = stalled(&points);
        // Beyond, what is seen is not the step's.
        let found = slope(&points[stalled.unwrap_or(0)..]);
        let enough = crossing(&points, level, |p| p.measured);
        let theory = crossing(&points, level, |p| p.theory);
        borders.push(Border::new(
            format!("{name}: order"),
            found.map(|f| f.0),
            Some(expected),
        ));
        borders.push(Border::new(
            format!("{name}: step of an error of {level:e}"),
            enough,
            theory,
        ));
        verdict += &match found {
            Some((order, [short, long])) => format!(
                "{name} converges with order {order:.2} (theory {expected}) between the steps {long:.2e} and {short:.2e}. "
            ),
            None => format!("{name}: no two steps whose error is that of the step show an order. "),
        };
        if let Some((from, shortest)) = stalled.map(|k| points[k]).zip(points.first()) {
            verdict += &format!(
                "From a step of {:.2e} on its error no longer falls: {:.1e} there, {:.1e} at the shortest, {:.2e}. ",
                from.x, from.measured, shortest.measured, shortest.x
            );
        }
        curves.push(Curve {
            name: name.to_owned(),
            points,
            bound: false,
        });
    }
    if curves.iter().all(|c| c.points.is_empty()) {
        let why = refused.unwrap_or_else(|| "no step could be tried within the budget".to_owned());
        return Ok(Err(why));
    }
    notes.extend(refused);
    verdict += "Runs say when the step's error exceeds the tolerance, and which step would do.";
    Ok(Ok(Panel {
        name: Name::Step,
        title: "Step of the implicit methods".to_owned(),
        shape: case.space.shape(),
        x: Scale::log("step"),
        y: Scale::log("relative l2 error"),
        curves,
        borders,
        verdict,
        notes,
    }))
}

#[cfg(test)]
mod tests {
    use super::*;

    /// An error that falls to the shortest step, one that turns, one that stays.
    #[test]
    fn where_errors_no_longer_fall() {
        let points = |errors: &[f64]| -> Vec<Point> {
            let point = |(k, &measured): (usize, &f64)| Point {
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
        let (order, steps) = slope(&turns[2..]).expect("it falls there");
        assert!((order - 2.0).abs() < 1e-12 && steps == [4.0, 8.0]);
        assert_eq!(stalled(&[]), None);
    }
}
