//! The tolerance that is asked against the error that is reached, by profile, down to round-off.

use crate::base::error::{Error, Result};
use crate::matrix::bounds::Bounds;
use crate::parallel::communicator::World;
use crate::plan::ASSUMED_RATIO;
use crate::plan::layout::Resources;
use crate::problem::case::{
    Case, Coefficients, DEFAULT_ALPHA, DEFAULT_BETA, DEFAULT_ORDER, Delta, ProfileChoice,
    Propagation, PropagatorMethod,
};
use crate::run::planning;
use crate::schrodingerization::warp_plan::WarpPlan;
use crate::study::budget::Budget;
use crate::study::grids::coarsened;
use crate::study::stability::scene::note;
use crate::study::stability::{Border, Curve, Found, Name, Panel, Point, Scale};
use crate::study::trial::trial;

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
    let (mut curves, mut borders, notes) = (Vec::new(), Vec::new(), note(whole, &case));
    let mut refused = None;
    let (mut kept, mut missed, mut ended) = (Vec::new(), Vec::new(), Vec::new());
    for (name, profile) in profiles {
        case.warp.profile = profile;
        // What the plan says it can do.
        case.tolerance = NONE;
        let smallest = match planning::plan(world, &case, &here) {
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
            if budget.is_over() {
                costly = true;
                break;
            }
            // Where there are so many, to plan what each of them takes is too much already.
            let modes = WarpPlan::modes_of(&case, &Bounds::new(&case)?, ASSUMED_RATIO);
            if modes.is_ok_and(|modes| modes > MOST_MODES) {
                costly = true;
                break;
            }
            let planned = planning::plan(world, &case, &here);
            let updates = |modes: usize| (modes * case.space.cells()) as f64;
            let applications = planned
                .as_ref()
                .map(|p| p.warp.as_ref().map_or(0, |w| w.applications));
            match applications {
                Ok(count) if !budget.holds(updates(count), 1.0) => costly = true,
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
        let tried: Vec<Point> = (points.iter().copied())
            .filter(|p| p.measured.is_finite())
            .collect();
        let misses = tried.iter().find(|p| p.measured > p.theory);
        let last = tried.last().map(|p| p.x);
        match (misses, last) {
            (Some(p), _) => missed.push(format!("{name} at {:.1e} ({:.1e})", p.x, p.measured)),
            (None, Some(last)) => kept.push(format!("{name} down to {last:.1e}")),
            (None, None) if !costly => ended.push(format!("{name} (refused)")),
            (None, None) => {}
        }
        if costly {
            ended.push(match last {
                Some(last) => format!("{name} below {last:.0e} (takes too long here)"),
                None => format!("{name} (takes too long here)"),
            });
        }
        // What ended for its cost has not come to the smallest.
        let complete = !costly && (misses.is_some() || last == smallest);
        let reached = (tried.iter().map(|p| p.measured))
            .filter(|_| complete)
            .reduce(f64::min);
        let name_of = format!("{name}: smallest error, beside the smallest tolerance planned");
        borders.push(Border::new(name_of, reached, smallest).bounded());
        points.reverse();
        curves.push(Curve {
            name: name.to_owned(),
            points,
            bound: true,
        });
    }
    curves.retain(|c| !c.points.is_empty());
    if curves.is_empty() {
        let why = refused.unwrap_or_else(|| "nothing could be tried within the budget".to_owned());
        return Ok(Err(why));
    }
    let best = (borders.iter())
        .filter_map(|b| Some((b.theory?, &b.name)))
        .min_by(|a, b| a.0.total_cmp(&b.0));
    let mut verdict = String::new();
    for (what, list) in [
        ("Every tolerance tried was kept by", kept),
        ("Tolerances were missed by", missed),
        ("Not tried:", ended),
    ] {
        if !list.is_empty() {
            verdict += &format!("{what} {}. ", list.join(", "));
        }
    }
    if let Some((smallest, name)) = best {
        let name = name.split(':').next().unwrap_or_default();
        verdict += &format!(
            "The smallest that a plan accepts is {smallest:.1e} ({name}); runs refuse less."
        );
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
