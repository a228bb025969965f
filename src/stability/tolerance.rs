//! The tolerance that is asked against the error that is reached, by profile, down to round-off.

use super::budget::Budget;
use super::scene::{coarsened, note};
use super::{Border, Curve, Found, Name, Panel, Point, Scale};
use crate::case::{
    Case, Coefficients, DEFAULT_ALPHA, DEFAULT_BETA, DEFAULT_ORDER, Delta, ProfileChoice,
    Propagation, PropagatorMethod,
};
use crate::communicator::World;
use crate::error::{Error, Result};
use crate::plan::{ASSUMED_RATIO, Bounds, Resources, WarpPlan};
use crate::run;
use crate::run::trial::trial;

/// Cells that are enough.
const CELLS: usize = 1024;
/// What is asked, as powers of ten; from here on what no profile gives.
const ASKED: [f64; 8] = [1e-2, 1e-4, 1e-6, 1e-8, 1e-10, 1e-12, 1e-13, 1e-14];
/// More modes than this take long.
const MOST_MODES: usize = 1 << 13;
/// Below what any gives.
const NONE: f64 = 1e-16;

/// The panel. Collective.
///
/// # Errors
/// None but those of the trials, which are left out.
pub fn panel(world: &World, whole: &Case, budget: &Budget) -> Result<Found> {
    let mut case = coarsened(whole, CELLS);
    case.verify = true;
    let warp = &mut case.warp;
    (warp.recovery, warp.interval, warp.points) = (None, None, None);
    (warp.weights, warp.coefficients) = (true, Coefficients::Analytic);
    warp.delta = Delta::Planned;
    case.propagator = Propagation {
        method: PropagatorMethod::Chebyshev,
        step: None,
    };
    let profiles = [
        ("designed", ProfileChoice::Designed),
        ("gaussian", ProfileChoice::Gaussian),
        (
            "smooth",
            ProfileChoice::Smooth {
                order: DEFAULT_ORDER,
            },
        ),
        ("low-somma", ProfileChoice::LowSomma { c: None }),
        ("acl", ProfileChoice::Acl { beta: DEFAULT_BETA }),
        (
            "exponential",
            ProfileChoice::Exponential {
                alpha: DEFAULT_ALPHA,
            },
        ),
    ];
    let here = Resources {
        ranks: world.group().size(),
        ..Resources::default()
    };
    let (mut curves, mut borders, mut notes) = (Vec::new(), Vec::new(), note(whole, &case));
    let mut refused = None;
    for (name, profile) in profiles {
        case.warp.profile = profile;
        // What the plan says it can do.
        case.tolerance = NONE;
        let smallest = match run::plan(world, &case, &here) {
            Err(Error::Tolerance { smallest, .. }) => Some(smallest),
            Ok(_) => Some(NONE),
            Err(error) => {
                // Too many modes for the smallest: where it is is not known.
                refused = Some(error.to_string());
                None
            }
        };
        let mut points: Vec<Point> = Vec::new();
        let mut costly = false;
        let asked = ASKED
            .into_iter()
            .filter(|&a| smallest.is_none_or(|s| a > s));
        let asked: Vec<f64> = asked.chain(smallest).collect();
        for &asked in &asked {
            case.tolerance = asked;
            if budget.over() {
                costly = true;
                break;
            }
            // Where there are so many, to plan what each of them takes is too much already.
            let modes = WarpPlan::modes_of(&case, &Bounds::new(&case)?, ASSUMED_RATIO);
            if modes.is_ok_and(|modes| modes > MOST_MODES) {
                costly = true;
                break;
            }
            let planned = run::plan(world, &case, &here);
            let updates = |modes: usize| (modes * case.space.cells()) as f64;
            let applications = planned
                .as_ref()
                .map(|p| p.warp.as_ref().map_or(0, |w| w.applications));
            match applications {
                Ok(count) if budget.exceeds(updates(count)) => costly = true,
                Err(Error::Modes { .. }) => costly = true,
                _ => {}
            }
            if costly {
                break;
            }
            match planned.and_then(|_| trial(world, &case)) {
                Ok(found) => points.push(Point {
                    x: asked,
                    measured: found.summary.error_semidiscrete.unwrap_or(f64::NAN),
                    theory: asked,
                }),
                Err(error) => refused = Some(error.to_string()),
            }
        }
        if costly {
            let last = points.last().map_or(0.1, |p| p.x);
            notes.push(format!("{name}: below {last:.0e} it takes too long here"));
        }
        // What ended for its cost has not come to the smallest.
        let reached = (points.iter().map(|p| p.measured))
            .filter(|e| e.is_finite() && !costly)
            .reduce(f64::min);
        borders.push(Border::new(
            format!("{name}: smallest error, beside the smallest tolerance planned"),
            reached,
            smallest,
        ));
        points.reverse();
        curves.push(Curve {
            name: name.to_owned(),
            points,
        });
    }
    curves.retain(|c| !c.points.is_empty());
    if curves.is_empty() {
        let why = refused.unwrap_or_else(|| "nothing could be tried within the budget".to_owned());
        return Ok(Err(why));
    }
    let kept = |c: &Curve| {
        c.points
            .iter()
            .all(|p| p.measured.is_nan() || p.measured <= p.theory)
    };
    let missed: Vec<&str> = (curves.iter().filter(|c| !kept(c)))
        .map(|c| c.name.as_str())
        .collect();
    let best = (borders.iter())
        .filter_map(|b| Some((b.theory?, &b.name)))
        .min_by(|a, b| a.0.total_cmp(&b.0));
    let mut verdict = match missed.is_empty() {
        true => "Every profile keeps every tolerance that its plan accepts. ".to_owned(),
        false => format!("Tolerances missed: {}. ", missed.join(", ")),
    };
    if let Some((smallest, name)) = best {
        let name = name.split(':').next().unwrap_or_default();
        verdict +=
            &format!("The smallest that is accepted is {smallest:.1e} ({name}); runs refuse less.");
    }
    Ok(Ok(Panel {
        name: Name::Tolerance,
        title: "Tolerance against round-off".to_owned(),
        shape: case.space.shape(),
        x: Scale::log("tolerance asked"),
        y: Scale::log("relative l2 error reached"),
        curves,
        borders,
        verdict,
        notes,
    }))
}
