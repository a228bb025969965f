//! Where methods fail: borders found by running up to and beyond them, each beside its theory.
//!
//! A [`Panel`](panel::Panel) varies one thing and measures another; its points have values by theory
//! where there is a theory. A [`Border`](panel::Border) is where the method begins to fail, measured and
//! by theory. Grids are coarsened so that a sweep takes seconds, which the notes say.
//!
//! | panel | varied | measured | theory |
//! |---|---|---|---|
//! | `cfl` | step of forward Euler and SSP-RK3 | growth of the largest value | norm of one step, von Neumann's symbol |
//! | `growth` | cells | `e^{λ⁺T}` | chains at a face; the weights' certificate; 0 |
//! | `recovery` | `p◇` | error of the field read there | the same of the profile alone, for any spectrum; round-off |
//! | `interval` | `L` and `R` | error | the same |
//! | `delta` | `δ` of the inflow | `e^{λ⁺T} ‖ũ(0)‖/‖f(T)‖` | one row and its unknown; norms |
//! | `grazing` | height of the jumps | `λ⁺` | chains at a face |
//! | `step` | step of the implicit methods | error | its leading term |
//! | `tolerance` | tolerance | error | the tolerance; the smallest that a plan accepts |

pub mod explicit;
pub mod grazing;
pub mod growth;
pub mod implicit;
pub mod inflow;
pub mod interval;
pub mod panel;
pub mod reading;
pub mod recovery;
pub mod report;
pub mod scene;
pub mod search;
pub mod tolerance;
pub mod yardstick;

use crate::base::error::{Error, Result};
use crate::parallel::communicator::World;
use crate::problem::case::Case;
use crate::study::budget::Budget;
use crate::study::stability::panel::{Found, LeftOut, Name, Stability, Sweep};
use crate::study::trial::title;
use std::time::Duration;

/// A panel and its function.
struct Entry {
    name: Name,
    /// Whether it seldom takes an eighth of the budget, so that it may get two shares.
    cheap: bool,
    measure: fn(&Sweep<'_>) -> Found,
}

/// All panels in the order in which they are measured, the cheap ones first.
#[rustfmt::skip]
const PANELS: [Entry; 8] = [
    Entry { name: Name::Delta, cheap: true, measure: inflow::panel },
    Entry { name: Name::Cfl, cheap: true, measure: explicit::panel },
    Entry { name: Name::Interval, cheap: true, measure: interval::panel },
    Entry { name: Name::Recovery, cheap: true, measure: recovery::panel },
    Entry { name: Name::Step, cheap: false, measure: implicit::panel },
    Entry { name: Name::Tolerance, cheap: false, measure: tolerance::panel },
    Entry { name: Name::Grazing, cheap: false, measure: grazing::panel },
    Entry { name: Name::Growth, cheap: false, measure: growth::panel },
];

/// Measures the panels `only` of `case`, all if there are none, within about `limit`. Collective.
///
/// # Errors
/// [`Error::Input`] for a case that starts from a warped field. A panel that fails is left out with the
/// reason.
pub fn measure(world: &World, case: &Case, only: &[Name], limit: Duration) -> Result<Stability> {
    if case.start.is_some() {
        let what = "initial.warped: stability takes a case whose field at the start is a formula";
        return Err(Error::Input(what.to_owned()));
    }
    let mut budget = Budget::new(world, limit.as_secs_f64());
    let wanted: Vec<&Entry> =
        (PANELS.iter()).filter(|entry| only.is_empty() || only.contains(&entry.name)).collect();
    let swept = scene::of(case);
    let (mut panels, mut left_out) = (Vec::new(), Vec::new());
    for (done, entry) in wanted.iter().enumerate() {
        let left = wanted.len() - done;
        budget.share(if entry.cheap && left > 1 { 2 } else { 1 }, left);
        let found = match budget.is_over() {
            true => Err("the budget is used up".into()),
            false => (entry.measure)(&Sweep { world, case: &swept, budget: &budget }),
        };
        match found {
            Ok(panel) => panels.push(panel),
            Err(reason) => left_out.push(LeftOut { name: entry.name, reason: reason.0 }),
        }
    }
    panels.sort_by_key(|panel| panel.name);
    left_out.sort_by_key(|left_out| left_out.name);
    Ok(Stability {
        title: title(case).to_owned(),
        shape: case.space.shape(),
        time: case.end,
        ranks: world.group().size(),
        panels,
        left_out,
        seconds: budget.elapsed(),
    })
}
