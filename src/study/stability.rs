//! Where methods fail: borders found by running up to and beyond them, each beside what theory says of it.
//!
//! A [`Panel`] varies one thing and measures another; each of its points has a theory value where there is a theory. A
//! [`Border`] is where it begins to fail, measured and by theory. Scenes are coarsened so that a sweep takes seconds, which is said.
//!
//! | panel | varied | measured | theory |
//! |---|---|---|---|
//! | `cfl` | step of forward Euler and SSP-RK3 | growth of the largest value | norm of one step, von Neumann's symbol |
//! | `growth` | cells | `e^{λ⁺T}` | chains at a face; the weights' certificate; 0 |
//! | `recovery` | `p◇` | error of what is read there | the same of the profile alone, for any spectrum; round-off |
//! | `interval` | `L` and `R` | error | the same |
//! | `delta` | `δ` of the inflow | `e^{λ⁺T} ‖ũ(0)‖/‖f(T)‖` | one row and its unknown; norms |
//! | `grazing` | height of the jumps | `λ⁺` | chains at a face |
//! | `step` | step of the implicit methods | error | its leading term |
//! | `tolerance` | what is asked | error | the tolerance; the smallest that a plan accepts |

pub mod explicit;
pub mod grazing;
pub mod growth;
pub mod implicit;
pub mod inflow;
pub mod reading;
pub mod report;
pub mod scene;
pub mod tolerance;
pub mod yardstick;

use crate::base::error::{Error, Result};
use crate::parallel::communicator::World;
use crate::problem::case::Case;
use crate::study::budget::Budget;
use serde::Serialize;
use std::time::Duration;

/// A point of a curve; NaN where there is no number.
#[derive(Clone, Copy, Debug, PartialEq, Serialize)]
pub struct Point {
    /// What is varied.
    pub x: f64,
    /// What was measured.
    pub measured: f64,
    /// What theory says.
    pub theory: f64,
}

/// A series of points.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct Curve {
    /// Of what.
    pub name: String,
    /// By rising `x`.
    pub points: Vec<Point>,
    /// Whether theory only bounds what is measured.
    pub bound: bool,
}

/// Where something begins to fail.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct Border {
    /// What.
    pub name: String,
    /// Where it was found; none where it was not.
    pub measured: Option<f64>,
    /// Where theory has it.
    pub theory: Option<f64>,
    /// Measured over theory, where that is not about zero.
    pub ratio: Option<f64>,
    /// Whether theory only bounds what is measured.
    pub bound: bool,
    /// What stands beside a line across the figure at the theory's value.
    #[serde(skip)]
    line: Option<String>,
}

impl Border {
    fn new(name: impl Into<String>, measured: Option<f64>, theory: Option<f64>) -> Self {
        let [measured, theory] = [measured, theory].map(|x| x.filter(|x| x.is_finite()));
        let both = measured.zip(theory).filter(|(_, theory)| *theory != 0.0);
        Self {
            name: name.into(),
            measured,
            theory,
            ratio: both.map(|(measured, theory)| measured / theory),
            bound: false,
            line: None,
        }
    }

    /// A place that may be about zero: its ratio to theory tells nothing.
    fn place(name: impl Into<String>, measured: Option<f64>, theory: Option<f64>) -> Self {
        Self {
            ratio: None,
            ..Self::new(name, measured, theory)
        }
    }

    /// What theory only bounds.
    fn bounded(self) -> Self {
        Self {
            bound: true,
            ..self
        }
    }

    /// Drawn at the theory's value.
    fn drawn(self, label: impl Into<String>) -> Self {
        Self {
            line: Some(label.into()),
            ..self
        }
    }
}

/// What a quantity is drawn on.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct Scale {
    /// What it is.
    pub label: String,
    /// Whether its axis is logarithmic.
    pub logarithmic: bool,
}

impl Scale {
    fn linear(label: impl Into<String>) -> Self {
        Self {
            label: label.into(),
            logarithmic: false,
        }
    }

    fn log(label: impl Into<String>) -> Self {
        Self {
            label: label.into(),
            logarithmic: true,
        }
    }
}

/// One thing varied.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct Panel {
    /// As `--only` calls it.
    pub name: Name,
    /// For people.
    pub title: String,
    /// Cells along each axis that it was measured on.
    pub shape: Vec<usize>,
    /// What is varied.
    pub x: Scale,
    /// What is measured.
    pub y: Scale,
    /// The curves.
    pub curves: Vec<Curve>,
    /// The borders.
    pub borders: Vec<Border>,
    /// What it says, in a sentence or two.
    pub verdict: String,
    /// What was left out, or changed, and why.
    pub notes: Vec<String>,
}

/// The panels.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord, Serialize, clap::ValueEnum)]
#[serde(rename_all = "kebab-case")]
pub enum Name {
    /// Step of the explicit methods.
    Cfl,
    /// Growth against refinement.
    Growth,
    /// The recovery point.
    Recovery,
    /// The interval in p.
    Interval,
    /// Delta of the inflow.
    Delta,
    /// Growth against the height of the jumps.
    Grazing,
    /// Step of the implicit methods.
    Step,
    /// Tolerance against round-off.
    Tolerance,
}

impl Name {
    /// All of them, in the order in which they are measured: those that take seconds first, then those that take what there is.
    const BY_COST: [Self; 8] = [
        Self::Delta,
        Self::Cfl,
        Self::Interval,
        Self::Recovery,
        Self::Step,
        Self::Tolerance,
        Self::Grazing,
        Self::Growth,
    ];

    /// Whether it seldom takes an eighth of the budget, so that two shares may be set aside for it.
    fn is_cheap(self) -> bool {
        matches!(
            self,
            Self::Delta | Self::Cfl | Self::Interval | Self::Recovery
        )
    }
}

/// A panel that a case does not have.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct LeftOut {
    /// Which.
    pub name: Name,
    /// Why.
    pub reason: String,
}

/// All that was found.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct Stability {
    /// Title of the case, or its name.
    pub title: String,
    /// Its cells along each axis.
    pub shape: Vec<usize>,
    /// The final time.
    pub time: f64,
    /// Ranks that measured.
    pub ranks: usize,
    /// What there is to see.
    pub panels: Vec<Panel>,
    /// What there is not.
    pub left_out: Vec<LeftOut>,
    /// Seconds it took.
    pub seconds: f64,
}

/// Measures the panels `only` of `case`, all if there are none, within about `limit`. Collective.
///
/// # Errors
/// What is wrong with the case itself; a panel that is refused is left out with the reason.
pub fn measure(world: &World, case: &Case, only: &[Name], limit: Duration) -> Result<Stability> {
    if case.start.is_some() {
        let what = "initial.warped: stability takes a case whose field at the start is a formula";
        return Err(Error::Input(what.to_owned()));
    }
    let mut budget = Budget::new(world, limit.as_secs_f64());
    let wanted: Vec<Name> = (Name::BY_COST.into_iter())
        .filter(|name| only.is_empty() || only.contains(name))
        .collect();
    let scene = crate::study::stability::scene::plain(case);
    let (mut panels, mut left_out) = (Vec::new(), Vec::new());
    for (done, &name) in wanted.iter().enumerate() {
        let left = wanted.len() - done;
        budget.share(if name.is_cheap() && left > 1 { 2 } else { 1 }, left);
        let found = match name {
            _ if budget.is_over() => Ok(Err("the budget is used up".to_owned())),
            Name::Cfl => crate::study::stability::explicit::panel(world, &scene, &budget),
            Name::Growth => crate::study::stability::growth::panel(world, &scene, &budget),
            Name::Recovery => crate::study::stability::reading::recovery(world, &scene, &budget),
            Name::Interval => crate::study::stability::reading::interval(world, &scene, &budget),
            Name::Delta => crate::study::stability::inflow::panel(world, &scene, &budget),
            Name::Grazing => crate::study::stability::grazing::panel(world, &scene, &budget),
            Name::Step => crate::study::stability::implicit::panel(world, &scene, &budget),
            Name::Tolerance => crate::study::stability::tolerance::panel(world, &scene, &budget),
        };
        match found {
            Ok(Ok(panel)) => panels.push(panel),
            Ok(Err(reason)) => left_out.push(LeftOut { name, reason }),
            Err(error) => left_out.push(LeftOut {
                name,
                reason: error.to_string(),
            }),
        }
    }
    panels.sort_by_key(|panel| panel.name);
    left_out.sort_by_key(|left_out| left_out.name);
    Ok(Stability {
        title: if case.title.is_empty() {
            case.name.clone()
        } else {
            case.title.clone()
        },
        shape: case.space.shape(),
        time: case.end,
        ranks: world.group().size(),
        panels,
        left_out,
        seconds: budget.elapsed(),
    })
}

/// A panel, or why a case does not have it.
type Found = std::result::Result<Panel, String>;
