//! An entry of the chart: a setting and its result.

use crate::base::text::choice_text;
use crate::problem::case::{
    Case, Coefficients, DEFAULT_FLUX, Embedding, Integrator, Interface, Limiter, Method,
    PropagatorMethod,
};
use crate::quantum::probability::Probabilities;
use crate::run::Solution;
use crate::study::chart::setup::is_reference;
use crate::study::cost::TrialSeconds;
use crate::study::grids::grid_name;
use serde::Serialize;

/// The name in place of a profile, for the unitary scheme, which has none.
const UNITARY: &str = "unitary";

/// The coordinates of an entry in a picture, such as its cost and its error; `None` if one is
/// unknown.
pub type PointOf = fn(&ChartEntry) -> Option<[f64; 2]>;

/// The result of a setting.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize)]
#[serde(rename_all = "kebab-case")]
pub enum Status {
    /// The setting ran.
    Done,
    /// The setting cannot run; `reason` says why.
    Refused,
    /// The setting did not fit into the budget.
    #[default]
    LeftOut,
}

/// A trial: its settings, then its numbers. A setting that its method does not have is none, as is
/// an unknown number.
#[derive(Clone, Debug, Default, Serialize)]
pub struct ChartEntry {
    /// The result.
    pub status: Status,
    /// The reason of a refusal.
    pub reason: Option<String>,
    /// Expected seconds, with comparisons, if it was left out.
    pub expected_seconds: Option<f64>,
    /// Whether the expected seconds are a lower bound: without the steps, or those of a coarser
    /// grid.
    pub expected_at_least: bool,
    /// Whether the entry is the case as its file has it.
    pub as_given: bool,
    /// Whether the entry is the paper's set-up.
    pub paper: bool,
    /// The method: classical, or by modes.
    pub method: Method,
    /// Elements along each axis, and their degree; of degree 0 cells.
    pub grid: String,
    /// Degree of the elements.
    pub degree: usize,
    /// Flux between the elements; the upwind scheme of degree 0 has none.
    pub flux: Option<f64>,
    /// Number of unknowns.
    pub cells: usize,
    /// Interface law.
    pub interface: Interface,
    /// The time integrator of a classical run.
    pub integrator: Option<Integrator>,
    /// The slope limiter of a classical run.
    pub limiter: Option<Limiter>,
    /// The step of a classical run, relative to the largest stable one.
    pub cfl: Option<f64>,
    /// Profile `g(p)` of a run by modes, or the unitary scheme, which has none.
    pub profile: Option<String>,
    /// Whether its Fourier coefficients are analytic or sampled.
    pub coefficients: Option<Coefficients>,
    /// Whether the unknowns are weighted.
    pub weights: Option<bool>,
    /// Whether interface law and weights make no difference: `V` does not jump, or the case has
    /// elements.
    pub no_jump: bool,
    /// Embedding of the inflow, if there is inflow.
    pub embedding: Option<Embedding>,
    /// Method that applies `exp(−iHT)`.
    pub propagator: Option<PropagatorMethod>,
    /// Time step of the setting.
    pub step: Option<f64>,
    /// Tolerance; `None` if `N_p` or a step is given instead, or a tolerance has no effect.
    pub tolerance: Option<f64>,
    /// The number `N_p` of points in `p`, if it is given.
    pub points: Option<usize>,
    /// Number of modes `l ≥ 0`.
    pub modes: Option<usize>,
    /// Applications of the matrix, over all modes and fields.
    pub applications: Option<usize>,
    /// Linear systems solved.
    pub solves: Option<usize>,
    /// Seconds for the result.
    pub seconds: Option<f64>,
    /// Seconds including comparisons.
    pub total_seconds: Option<f64>,
    /// Largest resident memory of a rank.
    pub memory_bytes_per_rank: Option<u64>,
    /// Relative L1 distance to the exact solution, of `f`; of the density with measure-valued data.
    pub error_exact: Option<f64>,
    /// Relative L2 distance of `f` to the exact solution.
    pub error_exact_l2: Option<f64>,
    /// Relative l2 distance to the exact semi-discrete solution, the largest over the fields.
    pub error_semidiscrete: Option<f64>,
    /// The estimate of that distance by the run itself.
    pub error_estimate: Option<f64>,
    /// Probability that a measurement finds the field in the window of `p` where it can be read.
    pub probability_window: Option<f64>,
    /// Probability that a measurement finds the field in the slice at `p◇`.
    pub probability_slice: Option<f64>,
    /// Applications over the larger of the two probabilities: the cost until the field is measured.
    pub until_measured: Option<f64>,
    /// Which of the two is larger: `window` or `slice`.
    pub measured_by: Option<String>,
    /// Whether no other of its kind (classical, by modes) is as close to the exact solution in as
    /// few seconds.
    pub front_exact: bool,
    /// Whether no other of its kind on its grid is as close to the semi-discrete solution in as few
    /// seconds.
    pub front_seconds: bool,
    /// Whether no other of its kind on its grid is as close to the semi-discrete solution in as few
    /// applications. Implicit methods are left out: they have no applications.
    pub front_applications: bool,
    /// Whether no other of its kind on its grid is as close to the semi-discrete solution in as few
    /// applications until the field is measured.
    pub front_until_measured: bool,
    /// Warnings of the run.
    pub warnings: Vec<String>,
}

impl ChartEntry {
    /// The settings of `case`, without numbers.
    pub fn of(case: &Case, status: Status) -> Self {
        let modes = case.method == Method::Schrodingerized;
        let warp = &case.warp;
        let stepped = case.propagator.method.order() > 0;
        let steps = !modes && !is_reference(case);
        Self {
            status,
            method: case.method,
            grid: grid_name(&case.space),
            degree: case.space.degree(),
            flux: case.flux_of_elements(),
            cells: case.space.cells(),
            interface: case.scheme.interface,
            integrator: (!modes).then_some(case.classical.integrator),
            limiter: (!modes).then_some(case.scheme.limiter),
            cfl: steps.then_some(case.classical.cfl),
            profile: modes.then(|| {
                if case.is_unitary() { UNITARY.to_owned() } else { choice_text(&warp.profile) }
            }),
            coefficients: modes.then_some(warp.coefficients),
            weights: modes.then_some(warp.weights),
            embedding: (modes && case.enters()).then_some(warp.inflow),
            propagator: modes.then_some(case.propagator.method),
            step: case.propagator.step.filter(|_| modes),
            tolerance: (modes && warp.points.is_none() && !stepped).then_some(case.tolerance),
            points: warp.points.filter(|_| modes),
            ..Self::default()
        }
    }

    /// The settings of `case` with the numbers of its `trial`.
    pub fn done(case: &Case, trial: &Solution, seconds: TrialSeconds) -> Self {
        let summary = &trial.summary;
        let probability =
            |of: fn(&Probabilities) -> Option<f64>| summary.probabilities.as_ref().and_then(of);
        // The unitary scheme has one mode, which is the field.
        let one_mode = case.is_unitary().then_some(1.0);
        let window = one_mode.or_else(|| probability(|p| p.in_window.all.value()));
        let slice = probability(|p| p.at_slice.all.value());
        let modes = case.method == Method::Schrodingerized;
        let solves = Some(summary.solves).filter(|n| *n > 0);
        let applications = Some(summary.matvecs).filter(|_| solves.is_none());
        let likely = window.into_iter().chain(slice).fold(0.0, f64::max);
        let until = applications.map(|n| n as f64 / likely);
        let until = until.filter(|n| modes && n.is_finite());
        let by = if window.is_some_and(|p| p == likely) { "window" } else { "slice" };
        Self {
            modes: modes.then_some(summary.modes),
            applications,
            solves,
            seconds: Some(seconds.result),
            total_seconds: Some(seconds.total),
            memory_bytes_per_rank: Some(summary.memory_peak_bytes_per_rank).filter(|m| *m > 0),
            error_exact: summary.error_l1_relative.or(summary.error_density_l1_relative),
            error_exact_l2: summary.error_l2_relative,
            error_semidiscrete: summary.error_semidiscrete,
            error_estimate: (summary.error_estimate).filter(|_| summary.error_estimate_reliable),
            probability_window: window,
            probability_slice: slice,
            until_measured: until,
            measured_by: until.map(|_| by.to_owned()),
            warnings: summary.warnings.clone(),
            ..Self::of(case, Status::Done)
        }
    }

    /// Whether the entry is the exact semi-discrete solution itself.
    pub fn is_reference(&self) -> bool {
        self.integrator == Some(Integrator::Exponential)
    }

    /// Name by which entries left out are counted: the integrator, the paper's set-up or the
    /// profile.
    pub fn method_name(&self) -> String {
        let own = match (&self.integrator, &self.profile) {
            _ if self.as_given => "the case as given".to_owned(),
            _ if self.paper => "the paper's set-up".to_owned(),
            (Some(integrator), _) => choice_text(integrator),
            (None, profile) => profile.clone().unwrap_or_default(),
        };
        match self.slopes() {
            Some(limiter) if !self.as_given => format!("{}, {own}", choice_text(&limiter)),
            _ => own,
        }
    }

    /// The limiter of a run with slopes.
    pub fn slopes(&self) -> Option<Limiter> {
        self.limiter.filter(|limiter| *limiter != Limiter::None)
    }

    /// The settings of the entry in words, without the grid.
    pub fn name(&self) -> String {
        let mut parts: Vec<String> = Vec::new();
        if self.as_given {
            parts.push("as given:".to_owned());
        }
        if self.paper {
            parts.push("the paper's set-up:".to_owned());
        }
        parts.extend(self.slopes().map(|limiter| format!("{},", choice_text(&limiter))));
        parts.extend(self.integrator.as_ref().map(choice_text));
        parts.extend(self.cfl.map(|cfl| format!("at CFL {cfl}")));
        parts.extend(self.profile.clone());
        if self.coefficients == Some(Coefficients::Sampled) {
            parts.push("sampled".to_owned());
        }
        parts.extend(self.propagator.as_ref().map(choice_text));
        parts.extend(self.step.map(|step| format!("in steps of {step:.2e}")));
        parts.extend(self.tolerance.map(|t| format!("to {t:.0e}")));
        parts.extend(self.points.map(|n| format!("with N_p = {n}")));
        // The flux of the unitary scheme is fixed.
        let is_unitary = self.profile.as_deref() == Some(UNITARY);
        let flux = self.flux.filter(|flux| *flux != DEFAULT_FLUX && !is_unitary);
        parts.extend(flux.map(|flux| format!("with flux {flux}")));
        match self.weights {
            Some(_) if self.no_jump => {}
            Some(true) => parts.push("(weights)".to_owned()),
            Some(false) => parts.push(format!("({}, no weights)", choice_text(&self.interface))),
            None => {}
        }
        parts.join(" ")
    }
}
