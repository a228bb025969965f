//! A method with its settings, and the case to run with them.

use crate::matrix::bounds::Bounds;
use crate::problem::case::{
    Alpha, Case, ClassicalSettings, Coefficients, DEFAULT_CFL, Delta, Embedding, Integrator,
    Interface, LARGEST_TOLERANCE, Limiter, Method, ProfileChoice, PropagatorMethod, RecoveryMethod,
    Shift,
};
use crate::problem::grid::PhaseSpace;
use crate::quantum::schemes::with_unitary_scheme;
use crate::study::treatment::Treatment;
use crate::study::trial::{final_fields_only, plan_series, propagation};

/// Schrödingerization by modes, planned from the tolerance.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Modes {
    /// The profile `g(p)`.
    pub profile: &'static ProfileChoice,
    /// Treatment of growth at jumps; `None` if `V` does not jump.
    pub treatment: Option<Treatment>,
    /// Propagator of a mode.
    pub propagator: PropagatorMethod,
    /// Steps of an implicit propagator.
    pub steps: Option<usize>,
    /// Requested relative error.
    pub tolerance: f64,
}

/// A method with its settings.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Setup {
    /// The settings of the case file.
    Given,
    /// Direct integration of `f' = A f + b`.
    Classical {
        /// Time integrator.
        integrator: Integrator,
        /// Slope limiter.
        limiter: Limiter,
        /// Step over the largest stable one.
        cfl: f64,
    },
    /// Schrödingerization by modes.
    Modes(Modes),
    /// The unitary scheme instead of the upwind one, of degree 0. It has one mode.
    Unitary {
        /// Requested relative error.
        tolerance: f64,
    },
    /// The paper's set-up: `e^{−|p|}` sampled on `N_p` points of `[−(λ⁻T + 5), λ⁺T + 5]`, no
    /// weights, the doubled system with `δ = max|b|`.
    Paper {
        /// The number `N_p` of points in `p`.
        points: usize,
        /// Number of Crank–Nicolson steps, as in the paper; if none, a Chebyshev series.
        steps: Option<usize>,
    },
}

impl From<Modes> for Setup {
    fn from(modes: Modes) -> Self {
        Self::Modes(modes)
    }
}

/// Margin at either end of the paper's interval.
const PAPER_MARGIN: f64 = 5.0;

impl Setup {
    /// A classical method at the default step.
    pub fn classical(integrator: Integrator, limiter: Limiter) -> Self {
        Self::Classical { integrator, limiter, cfl: DEFAULT_CFL }
    }

    /// `case` on the grid `space`, with this method. `case` has the degree of `space`. `bounds` are
    /// those of the matrix of [`Setup::Paper`], if they are known.
    pub fn apply(&self, case: &Case, space: &PhaseSpace, bounds: Option<&Bounds>) -> Case {
        let mut case = final_fields_only(case);
        case.space = space.clone();
        match *self {
            Self::Given => {}
            Self::Classical { integrator, limiter, cfl } => {
                case.method = Method::Classical;
                case.classical = ClassicalSettings { integrator, cfl };
                case.scheme.limiter = limiter;
                case.warp.delta = Delta::Planned;
            }
            Self::Modes(modes) => modes.apply(&mut case),
            Self::Unitary { tolerance } => {
                plan_modes(&mut case);
                case = with_unitary_scheme(&Case { tolerance, ..case });
            }
            Self::Paper { points, steps } => apply_paper(&mut case, points, steps, bounds),
        }
        // Slopes cannot be verified, and the exponential integrator is itself the reference.
        case.verify = case.scheme.limiter == Limiter::None && !is_reference(&case);
        case
    }
}

impl Modes {
    fn apply(&self, case: &mut Case) {
        plan_modes(case);
        case.warp.profile = self.profile.clone();
        case.tolerance = self.tolerance;
        case.propagator = propagation(case.duration(), self.propagator, self.steps);
        case.warp.weights = false;
        if let Some(treatment) = self.treatment {
            *case = treatment.of(case);
        }
    }
}

fn apply_paper(case: &mut Case, points: usize, steps: Option<usize>, bounds: Option<&Bounds>) {
    plan_modes(case);
    let time = case.duration();
    case.scheme.interface = Interface::Hat;
    // The paper's scheme of degree 0 is the upwind one.
    if case.space.degree() == 0 && !case.reflects() {
        case.scheme.flux = 1.0;
    }
    case.tolerance = LARGEST_TOLERANCE;
    case.warp.profile = ProfileChoice::Exponential { alpha: Alpha::Constant(1.0) };
    case.warp.coefficients = Coefficients::Sampled;
    case.warp.weights = false;
    (case.warp.inflow, case.warp.delta) = (Embedding::Full, Delta::Largest);
    case.warp.points = Some(points);
    case.warp.interval = bounds.map(|b| {
        let lower = b.decay * time + PAPER_MARGIN;
        [-lower, b.growth.max(0.0) * time + PAPER_MARGIN]
    });
    let method = match steps {
        Some(_) => PropagatorMethod::CrankNicolson,
        None => PropagatorMethod::Chebyshev,
    };
    case.propagator = propagation(case.duration(), method, steps);
}

/// Sets Schrödingerization by modes, with everything planned from the tolerance.
fn plan_modes(case: &mut Case) {
    case.method = Method::Schrodingerized;
    case.scheme.limiter = Limiter::None;
    plan_series(&mut case.warp);
    case.warp.recovery_method = RecoveryMethod::Point;
    case.warp.shift = Shift::Given(0.0);
}

/// Whether `case` computes the exact semi-discrete solution, to which others are compared.
pub fn is_reference(case: &Case) -> bool {
    case.method == Method::Classical && case.classical.integrator == Integrator::Exponential
}

/// The reason why a case file with the choices of `case` would be refused, or why the unitary
/// scheme is none for it.
pub fn refused(case: &Case) -> Option<String> {
    let no_isometry = case.is_unitary() && case.reflects();
    let conflict = case.conflict().map(|conflict| conflict.reason);
    conflict.or_else(|| no_isometry.then(|| "partial reflection is no isometry".to_owned()))
}
