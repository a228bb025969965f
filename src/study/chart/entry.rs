//! A row of the chart: a setting, and what became of it.

use crate::base::text::word;
use crate::problem::case::{Case, Coefficients, Integrator, Limiter, Method};
use crate::run::trial::Trial;
use crate::study::chart::knobs::{grid_name, is_reference};
use serde::Serialize;

/// What became of a setting.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize)]
#[serde(rename_all = "kebab-case")]
pub enum Status {
    /// It ran.
    Done,
    /// It cannot run; `reason` says why.
    Refused,
    /// It would not have fitted into the budget.
    LeftOut,
}

/// A trial: its knobs, then its numbers. What a method does not have, or what is not known, is empty.
#[derive(Clone, Debug, Serialize)]
pub struct Entry {
    /// What became of it.
    pub status: Status,
    /// Why it was refused.
    pub reason: Option<String>,
    /// Seconds it would take, comparisons included, where it was left out.
    pub expected_seconds: Option<f64>,
    /// Whether it would take longer: those seconds are without its work, which there was no time to plan, or those of a coarser grid.
    pub expected_at_least: bool,
    /// Whether it is the case as its file has it.
    pub as_given: bool,
    /// Whether it is the paper's set-up.
    pub paper: bool,
    /// Classical or by modes.
    pub method: Method,
    /// Cells along each axis.
    pub grid: String,
    /// Their number.
    pub cells: usize,
    /// Interface rows.
    pub interface: String,
    /// Classical: what kind of steps.
    pub integrator: Option<String>,
    /// Classical: slopes.
    pub limiter: Option<String>,
    /// Classical: step over the largest stable one.
    pub cfl: Option<f64>,
    /// By modes: `g(p)`.
    pub profile: Option<String>,
    /// Where its coefficients come from.
    pub coefficients: Option<String>,
    /// Whether the unknowns are weighted.
    pub weights: Option<bool>,
    /// Whether `V` does not jump: interfaces and weights are then all the same.
    pub no_jump: bool,
    /// How the inflow is embedded, where something enters.
    pub embedding: Option<String>,
    /// What applies `exp(−iHT)`.
    pub propagator: Option<String>,
    /// Its step.
    pub step: Option<f64>,
    /// What was asked for; none where `N_p` or the step is what is turned, or nothing can be asked for.
    pub tolerance: Option<f64>,
    /// `N_p`, where it is given.
    pub points: Option<usize>,
    /// Modes `l ≥ 0`.
    pub modes: Option<usize>,
    /// Applications of the matrix, over all modes and fields.
    pub applications: Option<usize>,
    /// Linear systems solved.
    pub solves: Option<usize>,
    /// Seconds for the result.
    pub seconds: Option<f64>,
    /// Seconds with what it is compared with.
    pub total_seconds: Option<f64>,
    /// Largest resident memory of a rank.
    pub memory_bytes_per_rank: Option<u64>,
    /// Distance to the exact solution over its size, L1; of measure-valued data that of the density.
    pub error_exact: Option<f64>,
    /// The same in L2, of `f`.
    pub error_exact_l2: Option<f64>,
    /// Relative l2 distance to `exp(AT) f(0) + …`, the largest over the fields.
    pub error_semidiscrete: Option<f64>,
    /// What the run itself says of that distance.
    pub error_estimate: Option<f64>,
    /// With what probability a measurement finds the field in the window of `p` where it can be read.
    pub probability_window: Option<f64>,
    /// The same at `p◇` alone, the slice.
    pub probability_slice: Option<f64>,
    /// Applications over the larger of the two: what it takes until the field is measured.
    pub until_measured: Option<f64>,
    /// Which of the two that is: `window` or `slice`.
    pub measured_by: Option<String>,
    /// Whether no other of its kind (classical, by modes) is as close to the exact solution in as few seconds.
    pub front_exact: bool,
    /// Whether no other of its kind on its grid is as close to the semi-discrete solution in as few seconds.
    pub front_seconds: bool,
    /// The same in applications; without the implicit methods, which have none.
    pub front_applications: bool,
    /// The same in applications until it is measured.
    pub front_until_measured: bool,
    /// Warnings of the run.
    pub warnings: Vec<String>,
}

impl Entry {
    /// A setting that did not run: `case` is what would have.
    pub fn of(case: &Case, status: Status) -> Self {
        let modes = case.method == Method::Schrodingerized;
        let warp = &case.warp;
        let stepped = case.propagator.method.order() > 0;
        let steps = !modes && !is_reference(case);
        Self {
            status,
            reason: None,
            expected_seconds: None,
            expected_at_least: false,
            as_given: false,
            paper: false,
            method: case.method,
            grid: grid_name(&case.space),
            cells: case.space.cells(),
            interface: word(&case.interface),
            integrator: (!modes).then(|| word(&case.integrator)),
            limiter: (!modes).then(|| word(&case.limiter)),
            cfl: steps.then_some(case.cfl),
            profile: modes.then(|| word(&warp.profile)),
            coefficients: modes.then(|| word(&warp.coefficients)),
            weights: modes.then_some(warp.weights),
            no_jump: false,
            embedding: (modes && case.enters()).then(|| word(&warp.inflow)),
            propagator: modes.then(|| word(&case.propagator.method)),
            step: case.propagator.step.filter(|_| modes),
            tolerance: (modes && warp.points.is_none() && !stepped).then_some(case.tolerance),
            points: warp.points.filter(|_| modes),
            modes: None,
            applications: None,
            solves: None,
            seconds: None,
            total_seconds: None,
            memory_bytes_per_rank: None,
            error_exact: None,
            error_exact_l2: None,
            error_semidiscrete: None,
            error_estimate: None,
            probability_window: None,
            probability_slice: None,
            until_measured: None,
            measured_by: None,
            front_exact: false,
            front_seconds: false,
            front_applications: false,
            front_until_measured: false,
            warnings: Vec::new(),
        }
    }

    /// What `trial` gave, which took so many seconds for the result, and in all.
    pub fn done(case: &Case, trial: &Trial, [seconds, total]: [f64; 2]) -> Self {
        let summary = &trial.summary;
        let relative = |error: Option<f64>, size: Option<f64>| Some(error? / size?);
        let chain = |part: fn(&crate::quantum::probability::Probabilities) -> Option<f64>| {
            summary.probabilities.as_ref().and_then(part)
        };
        let window = chain(|p| p.in_window.all.value());
        let slice = chain(|p| p.at_slice.all.value());
        let modes = case.method == Method::Schrodingerized;
        let solves = Some(summary.solves).filter(|n| *n > 0);
        let applications = Some(summary.matvecs).filter(|_| solves.is_none());
        let density = relative(summary.error_density_l1, summary.mass_exact);
        let field = relative(summary.error_l1, summary.exact_l1);
        let likely = window.into_iter().chain(slice).fold(0.0, f64::max);
        let until = applications.map(|n| n as f64 / likely);
        let until = until.filter(|n| modes && n.is_finite());
        let by = match window.is_some_and(|p| p == likely) {
            true => "window",
            false => "slice",
        };
        Self {
            modes: modes.then_some(summary.modes),
            applications,
            solves,
            seconds: Some(seconds),
            total_seconds: Some(total),
            memory_bytes_per_rank: Some(summary.memory_peak_bytes_per_rank).filter(|m| *m > 0),
            error_exact: density.or(field).filter(|e| e.is_finite()),
            error_exact_l2: relative(summary.error_l2, summary.exact_l2).filter(|e| e.is_finite()),
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

    /// Whether it gives `exp(AT) f(0) + …` itself.
    pub fn is_reference(&self) -> bool {
        self.integrator.as_deref() == Some(&word(&Integrator::Exponential))
    }

    /// The integrator, the paper's set-up or the profile: what is left out is counted by it.
    pub fn method_name(&self) -> String {
        let own = match (&self.integrator, &self.profile) {
            _ if self.as_given => "the case as given".to_owned(),
            _ if self.paper => "the paper's set-up".to_owned(),
            (Some(integrator), _) => integrator.clone(),
            (None, profile) => profile.clone().unwrap_or_default(),
        };
        match &self.limiter {
            Some(limiter) if *limiter != word(&Limiter::None) && !self.as_given => {
                format!("{limiter}, {own}")
            }
            _ => own,
        }
    }

    /// What it is, in words, without the grid.
    pub fn name(&self) -> String {
        let mut parts: Vec<String> = Vec::new();
        if self.as_given {
            parts.push("as given:".to_owned());
        }
        if self.paper {
            parts.push("the paper's set-up:".to_owned());
        }
        let without = word(&Limiter::None);
        let limiter = self.limiter.clone().filter(|l| *l != without);
        parts.extend(limiter.map(|l| format!("{l},")));
        parts.extend(self.integrator.clone());
        parts.extend(self.cfl.map(|cfl| format!("at CFL {cfl}")));
        parts.extend(self.profile.clone());
        if self.coefficients == Some(word(&Coefficients::Sampled)) {
            parts.push("sampled".to_owned());
        }
        parts.extend(self.propagator.clone());
        parts.extend(self.step.map(|step| format!("in steps of {step:.2e}")));
        parts.extend(self.tolerance.map(|t| format!("to {t:.0e}")));
        parts.extend(self.points.map(|n| format!("with N_p = {n}")));
        match self.weights {
            Some(_) if self.no_jump => {}
            Some(true) => parts.push("(weights)".to_owned()),
            Some(false) => parts.push(format!("({}, no weights)", self.interface)),
            None => {}
        }
        parts.join(" ")
    }
}
