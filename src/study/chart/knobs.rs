//! What is turned from one trial to the next, and the case that each setting makes.

use crate::matrix::bounds::Bounds;
use crate::problem::case::{
    Case, Coefficients, DEFAULT_CFL, Delta, Embedding, Integrator, Interface, LARGEST_TOLERANCE,
    Limiter, Method, ProfileChoice, Propagation, PropagatorMethod, RecoveryMethod, Shift,
};
use crate::problem::grid::PhaseSpace;

/// What is done against the growth that the hat interface brings.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Treatment {
    /// The hat interface and dissipative weights.
    Weights,
    /// The conservative interface, which has no growth.
    Conservative,
    /// The hat interface as it is.
    Neither,
    /// `V` does not jump: the interfaces are the same, and there is nothing to weight.
    NoJump,
}

impl Treatment {
    /// As tables write it.
    pub fn name(self) -> &'static str {
        match self {
            Self::Weights => "weights",
            Self::Conservative => "conservative",
            Self::Neither => "neither",
            Self::NoJump => "no jump",
        }
    }

    /// Those that differ where `V` jumps, or where it does not.
    pub fn all(jumps: bool) -> &'static [Self] {
        match jumps {
            true => &[Self::Weights, Self::Conservative, Self::Neither],
            false => &[Self::NoJump],
        }
    }
}

/// A method with its knobs.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Setup {
    /// As the case file has it.
    Given,
    /// `f' = A f + b` directly.
    Classical {
        /// Steps of what kind.
        integrator: Integrator,
        /// Slopes.
        limiter: Limiter,
        /// Step over the largest stable one.
        cfl: f64,
    },
    /// By modes, planned from the tolerance.
    Warped {
        /// `g(p)`.
        profile: ProfileChoice,
        /// Against growth.
        treatment: Treatment,
        /// Of a mode.
        propagator: PropagatorMethod,
        /// Steps of an implicit propagator.
        steps: Option<usize>,
        /// What is asked for.
        tolerance: f64,
    },
    /// The paper's: `e^{−|p|}` sampled on `N_p` points of `[−(λ⁻T + 5), λ⁺T + 5]`, no weights, the doubled system with `δ = max|b|`.
    Paper {
        /// `N_p`.
        points: usize,
        /// Crank–Nicolson in so many steps, as in the paper; a series where there are none.
        steps: Option<usize>,
    },
}

/// Points left over at either end of the paper's interval.
const PAPER_MARGIN: f64 = 5.0;

impl Setup {
    /// A classical method at the default step.
    pub fn classical(integrator: Integrator, limiter: Limiter) -> Self {
        Self::Classical {
            integrator,
            limiter,
            cfl: DEFAULT_CFL,
        }
    }

    /// What its case depends on beside the case file: bounds of the matrix that are measured.
    pub fn needs_bounds(&self) -> bool {
        matches!(self, Self::Paper { .. })
    }

    /// `case` on `space` with this method. `bounds` are those of [`Setup::Paper`]'s matrix, where it is known.
    pub fn settle(&self, case: &Case, space: &PhaseSpace, bounds: Option<&Bounds>) -> Case {
        let mut case = plain(case, space);
        match *self {
            Self::Given => {}
            Self::Classical {
                integrator,
                limiter,
                cfl,
            } => {
                case.method = Method::Classical;
                (case.integrator, case.limiter, case.cfl) = (integrator, limiter, cfl);
                case.warp.delta = Delta::Planned;
            }
            Self::Warped {
                profile,
                treatment,
                propagator,
                steps,
                tolerance,
            } => {
                planned(&mut case);
                case.warp.profile = profile;
                case.tolerance = tolerance;
                case.propagator = propagation(propagator, steps, case.end);
                match treatment {
                    Treatment::Weights | Treatment::Neither => case.interface = Interface::Hat,
                    Treatment::Conservative => case.interface = Interface::Conservative,
                    Treatment::NoJump => {}
                }
                case.warp.weights = treatment == Treatment::Weights;
            }
            Self::Paper { points, steps } => {
                planned(&mut case);
                let time = case.end;
                case.interface = Interface::Hat;
                case.tolerance = LARGEST_TOLERANCE;
                case.warp.profile = ProfileChoice::Exponential { alpha: 1.0 };
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
                case.propagator = propagation(method, steps, time);
            }
        }
        // The distance to exp(AT) f(0) says nothing about slopes, and the exponential is that solution.
        case.verify = case.limiter == Limiter::None && !is_reference(&case);
        case
    }
}

/// Whether `case` computes what others are compared with.
pub fn is_reference(case: &Case) -> bool {
    case.method == Method::Classical && case.integrator == Integrator::Exponential
}

/// `case` on `space` without what it writes besides the fields at the end.
fn plain(case: &Case, space: &PhaseSpace) -> Case {
    let mut case = case.clone();
    case.space = space.clone();
    (case.plateau, case.readout) = (None, None);
    case.times.clear();
    case.warped_field = false;
    case
}

/// By modes, with nothing given by hand.
fn planned(case: &mut Case) {
    case.method = Method::Schrodingerized;
    case.limiter = Limiter::None;
    case.warp.coefficients = Coefficients::Analytic;
    case.warp.recovery_method = RecoveryMethod::Point;
    case.warp.shift = Shift::Given(0.0);
    case.warp.delta = Delta::Planned;
    (case.warp.interval, case.warp.points, case.warp.recovery) = (None, None, None);
}

fn propagation(method: PropagatorMethod, steps: Option<usize>, time: f64) -> Propagation {
    Propagation {
        method,
        step: steps.map(|n| time / n as f64),
    }
}

/// What a case file with these choices would be refused for.
pub fn refused(case: &Case) -> Option<&'static str> {
    let modes = case.method == Method::Schrodingerized;
    let other = case.propagator.method != PropagatorMethod::Chebyshev;
    if case.varies() && case.limiter != Limiter::None {
        return Some("slopes take the inflow at time 0, and it depends on t");
    }
    if case.varies() && modes && other {
        return Some("the inflow depends on t; only chebyshev is stepped");
    }
    if modes && other && case.enters() && case.warp.inflow == Embedding::Scalar {
        return Some(
            "solver.warp.inflow = \"scalar\" couples one unknown to all rows, which only chebyshev applies",
        );
    }
    None
}

/// `64 x 64`.
pub fn grid_name(space: &PhaseSpace) -> String {
    let cells: Vec<String> = space.shape().iter().map(usize::to_string).collect();
    cells.join(" x ")
}
