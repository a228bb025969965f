//! The parts of a stability map: panels of curves and borders.

use crate::base::error::{Error, Result};
use crate::parallel::communicator::World;
use crate::plan::layout::Resources;
use crate::problem::case::Case;
use crate::run::{Solution, planning};
use crate::study::budget::Budget;
use crate::study::cost::planned_updates;
use crate::study::trial::trial;
use serde::Serialize;

/// The task of measuring a panel.
pub struct PanelTask<'a> {
    /// The world of all ranks.
    pub world: &'a World,
    /// The case on its own grid.
    pub case: &'a Case,
    /// The time that the panel may take.
    pub budget: &'a Budget,
}

/// The error of a budget that ended before anything was tried.
pub fn nothing_tried() -> Error {
    Error::input("nothing could be tried within the budget")
}

/// The contents of a panel. Its name, title and axes are in the table of panels.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct PanelContents {
    /// Elements along each axis of the grid that it was measured on.
    pub shape: Vec<usize>,
    /// What was measured, and the theory beside it.
    pub curves: Vec<Curve>,
    /// The borders.
    pub borders: Vec<Border>,
    /// Conclusions, in a sentence or two.
    pub verdict: String,
    /// Changes to the case and trials left out, each with the reason.
    pub notes: Vec<String>,
}

impl PanelTask<'_> {
    /// Whether the time of the panel is over. If it is, a note is added. Collective.
    pub fn is_over(&self, notes: &mut Vec<String>) -> bool {
        let over = self.budget.is_over();
        if over {
            notes.push("curves end where the budget did".to_owned());
        }
        over
    }

    /// A trial of `case`; `None` if the budget does not hold it. Collective.
    ///
    /// # Errors
    /// As [`planning::plan`] and [`trial`].
    pub fn trial(&self, case: &Case) -> Option<Result<Solution>> {
        if self.budget.is_over() {
            return None;
        }
        match planning::plan(self.world, case, &Resources::unlimited(self.world)) {
            Err(Error::Modes { .. }) => None,
            Err(error) => Some(Err(error)),
            Ok(plan) => (self.budget)
                .fits_count(planned_updates(case, &plan), 1.0)
                .then(|| trial(self.world, case)),
        }
    }
}

/// A point of a curve; NaN where there is no number.
#[derive(Clone, Copy, Debug, PartialEq, Serialize)]
pub struct CurvePoint {
    /// The varied quantity.
    pub x: f64,
    /// The measured value.
    pub measured: f64,
    /// The value, or a bound on it, by theory.
    pub theory: f64,
}

/// A series of points.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct Curve {
    /// Name of the curve.
    pub name: String,
    /// Points by rising `x`.
    pub points: Vec<CurvePoint>,
    /// Whether theory is only a bound on the measured values.
    pub bound: bool,
}

/// The value of the varied quantity at which a method begins to fail.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct Border {
    /// Name of the border.
    pub name: String,
    /// The measured border; `None` if it was not located.
    pub measured: Option<f64>,
    /// The border by theory.
    pub theory: Option<f64>,
    /// Measured over theory, unless theory is zero.
    pub ratio: Option<f64>,
    /// Whether theory is only a bound on the measured one.
    pub bound: bool,
    /// Label of a line across the figure at the theory's value.
    #[serde(skip)]
    pub line: Option<String>,
}

impl Curve {
    /// A curve whose theory is exact.
    pub fn new(name: impl Into<String>, points: Vec<CurvePoint>) -> Self {
        Self { name: name.into(), points, bound: false }
    }

    /// A curve whose theory is a bound.
    pub fn bounded(name: impl Into<String>, points: Vec<CurvePoint>) -> Self {
        Self { bound: true, ..Self::new(name, points) }
    }
}

impl Border {
    /// A border, `measured` and by `theory`.
    pub fn new(name: impl Into<String>, measured: Option<f64>, theory: Option<f64>) -> Self {
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

    /// A border without a ratio, as its value may be about zero.
    pub fn without_ratio(
        name: impl Into<String>,
        measured: Option<f64>,
        theory: Option<f64>,
    ) -> Self {
        Self { ratio: None, ..Self::new(name, measured, theory) }
    }

    /// The border, with its theory as a bound.
    pub fn bounded(self) -> Self {
        Self { bound: true, ..self }
    }

    /// The border, drawn at the theory's value with this label.
    pub fn drawn(self, label: impl Into<String>) -> Self {
        Self { line: Some(label.into()), ..self }
    }
}

/// An axis of a panel.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct AxisScale {
    /// The label of the series.
    pub label: &'static str,
    /// Whether its axis is logarithmic.
    pub logarithmic: bool,
}

impl AxisScale {
    /// A linear axis.
    pub const fn linear(label: &'static str) -> Self {
        Self { label, logarithmic: false }
    }

    /// A logarithmic axis.
    pub const fn log(label: &'static str) -> Self {
        Self { label, logarithmic: true }
    }
}

/// What a panel measures: the varied quantity along `x`, the measured one along `y`, and how.
#[derive(Debug, Serialize)]
pub struct PanelSpec {
    /// The name of the panel for `--only`.
    pub name: PanelName,
    /// The title of the panel.
    pub title: &'static str,
    /// Whether the panel rarely uses an equal share of the budget. It may then take two shares of
    /// the time that is left.
    #[serde(skip)]
    pub cheap: bool,
    /// The axis of the varied quantity.
    pub x: AxisScale,
    /// The axis of the measured quantity.
    pub y: AxisScale,
    /// The measurement.
    #[serde(skip)]
    pub measure: fn(&PanelTask<'_>) -> Result<PanelContents>,
}

/// A panel: measurements over one varied quantity.
#[derive(Clone, Debug, Serialize)]
pub struct StabilityPanel {
    /// What it measures.
    #[serde(flatten)]
    pub spec: &'static PanelSpec,
    /// The contents of the panel.
    #[serde(flatten)]
    pub findings: PanelContents,
}

/// Names of the panels.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord, Serialize, clap::ValueEnum)]
#[serde(rename_all = "kebab-case")]
pub enum PanelName {
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

/// A panel that a case does not have.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct LeftOut {
    /// Name of the panel.
    pub name: PanelName,
    /// The reason why the case does not have the panel.
    pub reason: String,
}

/// All panels of a case.
#[derive(Clone, Debug, Serialize)]
pub struct Stability {
    /// Title of the case, or its name.
    pub title: String,
    /// Degree of the elements.
    pub degree: usize,
    /// Elements of the case along each axis.
    pub shape: Vec<usize>,
    /// The final time.
    pub time: f64,
    /// Number of ranks.
    pub ranks: usize,
    /// The panels.
    pub panels: Vec<StabilityPanel>,
    /// The panels that the case does not have.
    pub left_out: Vec<LeftOut>,
    /// Seconds that all panels took.
    pub seconds: f64,
}
