//! `phasewarp stability`: where methods fail, measured and by theory.
//!
//! A [`StabilityPanel`](panel::StabilityPanel) varies one quantity and measures another; its points
//! also have values by theory, if there is one. A [`Border`](panel::Border) is where the method
//! begins to fail, measured by runs on both sides of it, and by theory. Grids are coarsened so that
//! a panel takes seconds; the notes then say so.
//!
//! | panel | varied | measured | theory |
//! |---|---|---|---|
//! | `cfl` | step of forward Euler and SSP-RK3 | growth of the largest value | norm of a step |
//! | `growth` | cells | `e^{λ⁺T}` | chains at a face; the weights' certificate; 0 |
//! | `recovery` | `p◇` | error of the field read there | the same of the profile alone; round-off |
//! | `interval` | `L` and `R` | error | the same |
//! | `delta` | `δ` of the inflow | `e^{λ⁺T} ‖ũ(0)‖/‖f(T)‖` | one row and its unknown; norms |
//! | `grazing` | height of the jumps | `λ⁺` | chains at a face |
//! | `step` | step of the implicit methods | error | its leading term |
//! | `tolerance` | tolerance | error | the tolerance; the smallest that a plan accepts |

pub mod cases;
pub mod explicit;
pub mod grazing;
pub mod growth;
pub mod implicit;
pub mod inflow;
pub mod interval;
pub mod panel;
pub mod reading;
pub mod recovery;
pub mod reference;
pub mod report;
pub mod search;
pub mod tolerance;

use crate::base::error::{Error, Result};
use crate::parallel::communicator::World;
use crate::problem::case::Case;
use crate::study::budget::{Budget, BudgetClock, refuse_slow_grid};
use crate::study::stability::panel::{
    AxisScale, LeftOut, PanelName, PanelSpec, PanelTask, Stability, StabilityPanel,
};
use crate::study::trial::refuse_start_from_file;
use std::time::Duration;

/// All panels in the order in which they are measured, the cheap ones first.
#[rustfmt::skip]
static PANELS: [PanelSpec; 8] = [
    PanelSpec { name: PanelName::Delta, title: "Delta of the inflow", cheap: true,
            x: AxisScale::log("delta"), y: AxisScale::log("factor"), measure: inflow::panel },
    PanelSpec { name: PanelName::Cfl, title: "Step of the explicit methods", cheap: true,
            x: AxisScale::linear("cfl = step x largest rate"), y: AxisScale::log(explicit::GROWTH),
            measure: explicit::panel },
    PanelSpec { name: PanelName::Interval, title: "Error against the interval", cheap: true,
            x: AxisScale::linear("end of the interval in p"),
            y: AxisScale::log("relative l2 error"),
            measure: interval::panel },
    PanelSpec { name: PanelName::Recovery, title: "Error against the recovery point", cheap: true,
            x: AxisScale::linear("recovery point p"), y: AxisScale::log("relative l2 error"),
            measure: recovery::panel },
    PanelSpec { name: PanelName::Step, title: "Step of the implicit methods", cheap: false,
            x: AxisScale::log("step"), y: AxisScale::log("relative l2 error"),
            measure: implicit::panel },
    PanelSpec { name: PanelName::Tolerance, title: "Tolerance against round-off", cheap: false,
            x: AxisScale::log("tolerance asked"), y: AxisScale::log("relative l2 error reached"),
            measure: tolerance::panel },
    PanelSpec { name: PanelName::Grazing, title: "Grazing: growth against the jump", cheap: false,
            x: AxisScale::linear("largest jump of V"),
            y: AxisScale::linear("lambda+ T, hat, no weights"),
            measure: grazing::panel },
    PanelSpec { name: PanelName::Growth, title: "Growth against refinement", cheap: false,
            x: AxisScale::log("cells along x"), y: AxisScale::log("amplification exp(lambda+ T)"),
            measure: growth::panel },
];

/// Measures the panels `only` of `case`, or all if `only` is empty, within about `limit`.
/// Collective.
///
/// # Errors
/// [`crate::base::error::Error::Input`] for a case that starts from a file. A panel that fails is
/// left out with the reason.
pub fn measure(
    world: &World,
    case: &Case,
    only: &[PanelName],
    limit: Duration,
) -> Result<Stability> {
    refuse_start_from_file(case, "stability takes a case whose field at the start is a formula")?;
    let mut budget =
        Budget::new(world, "stability (of its budget)", limit.as_secs_f64(), BudgetClock::Seconds);
    refuse_slow_grid(world, case, limit.as_secs_f64())?;
    let wanted: Vec<&'static PanelSpec> =
        (PANELS.iter()).filter(|spec| only.is_empty() || only.contains(&spec.name)).collect();
    let by_modes = cases::by_modes(case);
    let (mut panels, mut left_out) = (Vec::new(), Vec::new());
    for (done, &spec) in wanted.iter().enumerate() {
        let left = wanted.len() - done;
        budget.share(if spec.cheap && left > 1 { 2 } else { 1 }, left);
        let found = if budget.is_over() {
            Err(Error::input("the budget is used up"))
        } else {
            (spec.measure)(&PanelTask { world, case: &by_modes, budget: &budget })
        };
        match found {
            Ok(findings) => panels.push(StabilityPanel { spec, findings }),
            Err(reason) => left_out.push(LeftOut { name: spec.name, reason: reason.to_string() }),
        }
    }
    panels.sort_by_key(|panel| panel.spec.name);
    left_out.sort_by_key(|left_out| left_out.name);
    Ok(Stability {
        title: case.title.clone(),
        degree: case.space.degree(),
        shape: case.space.elements(),
        time: case.duration(),
        ranks: world.group().size(),
        panels,
        left_out,
        seconds: budget.elapsed(),
    })
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::results::draw::text::width;

    /// Labels are no longer than the sides of a frame of 360 by 260 points.
    #[test]
    fn labels_are_no_longer_than_their_axes() {
        for panel in &PANELS {
            for (scale, length) in [(&panel.x, 360.0), (&panel.y, 260.0)] {
                assert!(width(scale.label, 10.5) < length, "{}", scale.label);
            }
        }
    }
}
