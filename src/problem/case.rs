//! The case file: typed, with every default here, unknown keys refused, values checked.

pub mod file;
pub mod read;

use crate::problem::formula::Expression;
use crate::problem::grid::PhaseSpace;
use crate::problem::limits::{CHUNK, MOST_CHUNKS};
use serde::{Deserialize, Serialize};
use std::collections::BTreeMap;
use std::path::PathBuf;
use std::time::Duration;

/// Default of `checkpoint.minutes`.
pub const DEFAULT_CHECKPOINT: f64 = 30.0;

/// Default of `solver.tolerance`.
pub const DEFAULT_TOLERANCE: f64 = 1e-6;
/// Default of `solver.warp.alpha`.
pub const DEFAULT_ALPHA: f64 = 1.0;
/// Default of `solver.warp.order`.
pub const DEFAULT_ORDER: usize = 8;
/// Default of `solver.warp.beta`.
pub const DEFAULT_BETA: f64 = 0.75;
/// Default of `output.plateau.points`.
pub const DEFAULT_PLATEAU: usize = 9;
/// Default of `solver.classical.cfl`.
pub const DEFAULT_CFL: f64 = 0.9;
/// Default of `readout.shots`.
pub const DEFAULT_SHOTS: u64 = 10_000;
/// Default of `readout.evaluations`.
pub const DEFAULT_EVALUATIONS: u64 = 256;
/// Most fields of a case: a density and a level set for each velocity axis.
pub const MOST_FIELDS: usize = 4;
/// Largest `solver.tolerance`.
pub const LARGEST_TOLERANCE: f64 = 0.1;
/// Lengths, velocities and times lie between the inverse of this and this: their products stay finite.
pub const MOST: f64 = 1e100;

/// One branch of the potential; the first whose condition holds at a cell's centre gives `V` in that cell.
#[derive(Clone, Debug)]
pub struct Region {
    /// `where`; absent in the last region.
    pub condition: Option<Expression>,
    /// `V(x, y, z)`.
    pub value: Expression,
}

/// What enters through the boundary of the phase-space box.
#[derive(Clone, Debug)]
pub enum Inflow {
    /// A formula taken at ghost centres.
    Formula(Expression),
    /// The initial formula, taken at ghost centres.
    Initial,
}

/// How the Hamiltonian-preserving flux at a jump of `V` finds its sources.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord, Serialize)]
#[serde(rename_all = "kebab-case")]
pub enum Interface {
    /// Linear interpolation at the source velocity (the paper's).
    Hat,
    /// Overlap of energy intervals; keeps row and flux-weighted column sums.
    Conservative,
}

/// Time integrator of the classical method `f' = A f + b`.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize)]
#[serde(rename_all = "kebab-case")]
pub enum Integrator {
    /// The exact exponential of the semi-discrete system.
    Exponential,
    /// First-order forward Euler.
    ForwardEuler,
    /// Third-order strong-stability-preserving Runge–Kutta.
    SspRk3,
}

/// Slope limiter of the classical method (paper, the remark after section 4.2).
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord, Serialize)]
#[serde(rename_all = "kebab-case")]
pub enum Limiter {
    /// First order, the scheme itself.
    None,
    /// `ψ(θ) = max(0, min(1, θ))`.
    Minmod,
    /// `ψ(θ) = (|θ| + θ)/(1 + |θ|)`.
    VanLeer,
}

/// What computes `f(T)`.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize)]
#[serde(rename_all = "kebab-case")]
pub enum Method {
    /// Schrödingerization: unitary modes, recovered by the profile.
    #[default]
    Schrodingerized,
    /// Direct integration of the semi-discrete system.
    Classical,
}

/// Which profile `g(p)`, with its parameter (see [`crate::schrodingerization::profile`]).
#[derive(Clone, Copy, Debug, PartialEq, Serialize)]
#[serde(tag = "kind", rename_all = "kebab-case")]
pub enum ProfileChoice {
    /// `Designed` or `Gaussian`, whichever takes less work.
    Planned,
    /// A trigonometric polynomial that is `e^{−p}` where it must be, by least squares.
    Designed,
    /// `e^{−p}` cut off by a normal distribution function.
    Gaussian,
    /// `e^{−p}` for `p ≥ 0`, `e^{αp}` for `p < 0` (the paper's).
    Exponential {
        /// `α > 0`.
        alpha: f64,
    },
    /// `e^{−|p|}` with the polynomial of degree `2r+1` between −1 and 0 that is smooth to `r` derivatives.
    Smooth {
        /// `r`.
        order: usize,
    },
    /// `e^{−|p|}` convolved with a Gaussian, read at `c` (Low and Somma, arXiv 2508.19238).
    LowSomma {
        /// `c > 0`; planned where none is given.
        c: Option<f64>,
    },
    /// The kernel of An, Childs and Lin (arXiv 2312.03916).
    Acl {
        /// `β` in [`BETAS`](crate::problem::limits::BETAS).
        beta: f64,
    },
}

/// Where the Fourier coefficients come from.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize)]
#[serde(rename_all = "kebab-case")]
pub enum Coefficients {
    /// `ĝ` itself.
    Analytic,
    /// The discrete Fourier transform of samples of `g` on `[L, R)` (the paper's).
    Sampled,
}

/// How `u` is read from the warped field.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum RecoveryMethod {
    /// `e^{p◇} v(p◇)`.
    Point,
    /// From the integral of `v` over `p ≥ p◇`.
    Integral,
    /// From several points at and above `p◇`, by least squares.
    LeastSquares,
}

/// How the inflow becomes part of a homogeneous system.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize)]
#[serde(rename_all = "kebab-case")]
pub enum Embedding {
    /// An auxiliary unknown for each row that something enters.
    Boundary,
    /// An auxiliary unknown for every row (the paper's).
    Full,
    /// One auxiliary unknown for all.
    Scalar,
}

/// `δ`, the initial value of the auxiliary unknowns.
#[derive(Clone, Copy, Debug, PartialEq, Serialize)]
#[serde(rename_all = "kebab-case")]
pub enum Delta {
    /// From the growth it may add.
    Planned,
    /// `max |b|` (the paper's).
    #[serde(rename = "max")]
    Largest,
    /// This number.
    Given(f64),
}

/// `[solver.warp]`: everything about the auxiliary variable `p`.
#[derive(Clone, Copy, Debug, PartialEq, Serialize)]
pub struct Warp {
    /// `profile` and its parameter.
    pub profile: ProfileChoice,
    /// `coefficients`.
    pub coefficients: Coefficients,
    /// `interval = [L, R]`, by hand.
    pub interval: Option<[f64; 2]>,
    /// `points = N_p`, by hand.
    pub points: Option<usize>,
    /// `recovery = p◇`, by hand.
    pub recovery: Option<f64>,
    /// `recovery_method`.
    pub recovery_method: RecoveryMethod,
    /// `weights = "dissipative"`.
    pub weights: bool,
    /// `inflow`.
    pub inflow: Embedding,
    /// `delta`.
    pub delta: Delta,
    /// `shift`: `u = e^{σt} ũ`.
    pub shift: Shift,
}

impl Warp {
    /// The profile to be planned: `Planned` is the Gaussian where samples, an interval or points are given by hand, as a
    /// designed one is no function on the line.
    pub fn choice(&self) -> ProfileChoice {
        match (self.profile, self.by_hand()) {
            (ProfileChoice::Planned, Some(_)) => ProfileChoice::Gaussian,
            (given, _) => given,
        }
    }

    /// A key that a designed profile does not take, where one is given.
    pub fn by_hand(&self) -> Option<&'static str> {
        let sampled = self.coefficients == Coefficients::Sampled;
        let keys = [
            ("coefficients", sampled),
            ("interval", self.interval.is_some()),
            ("points", self.points.is_some()),
        ];
        keys.into_iter()
            .find(|(_, given)| *given)
            .map(|(key, _)| key)
    }
}

/// `σ` of the spectral shift `u = e^{σt} ũ`, `ũ' = (A − σ) ũ`.
#[derive(Clone, Copy, Debug, PartialEq, Serialize)]
#[serde(rename_all = "kebab-case")]
pub enum Shift {
    /// The bound on the growth, so that `ũ` does not grow.
    Growth,
    /// This number.
    Given(f64),
}

impl Shift {
    /// `σ` where the growth is at most `growth`.
    pub fn of(self, growth: f64) -> f64 {
        match self {
            Self::Growth => growth,
            Self::Given(sigma) => sigma,
        }
    }
}

/// `output.plateau`: the field read at several points.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Plateau {
    /// The first point; from the plan where none is given.
    pub from: Option<f64>,
    /// The last point, above `from`; from the plan where none is given.
    pub to: Option<f64>,
    /// Number of points, at least 2.
    pub points: usize,
}

/// What applies `exp(−iHT)` to a mode.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize)]
#[serde(rename_all = "kebab-case")]
pub enum PropagatorMethod {
    /// Chebyshev series.
    Chebyshev,
    /// Lanczos.
    Krylov,
    /// Second-order implicit midpoint, unitary.
    CrankNicolson,
    /// First-order implicit, dissipative.
    BackwardEuler,
}

impl PropagatorMethod {
    /// Order in the time step; 0 where the method meets a tolerance by itself.
    pub fn order(self) -> usize {
        match self {
            Self::Chebyshev | Self::Krylov => 0,
            Self::CrankNicolson => 2,
            Self::BackwardEuler => 1,
        }
    }
}

/// `[solver.propagator]`.
#[derive(Clone, Copy, Debug, PartialEq, Serialize)]
pub struct Propagation {
    /// `method`.
    pub method: PropagatorMethod,
    /// `step`: of the implicit methods, which need it; the longest of `krylov`.
    pub step: Option<f64>,
}

/// What `[initial]` gives.
#[derive(Clone, Debug)]
pub enum Data {
    /// `f0(x, v)`.
    Density,
    /// `f0 = density(x) Π δ(v_a − velocity_a(x))`, by level sets.
    Measure {
        /// `density(x)`.
        density: Expression,
        /// `velocity_a(x)`.
        velocity: Vec<Expression>,
    },
}

/// Half-width `ω_a` of the discrete delta function of `ψ_a` (see [`crate::matrix::observables`]).
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize)]
#[serde(rename_all = "kebab-case")]
pub enum DeltaWidth {
    /// `max(|det ∂Ψ/∂v|, 1) Δv_a` (the paper's).
    Determinant,
    /// `max(Σ_b |∂ψ_a/∂v_b| Δv_b, Δv_a)`; the same in one dimension.
    Gradient,
}

/// A function on phase space that obeys the Liouville equation.
#[derive(Clone, Debug)]
pub struct Field {
    /// `f`; or `phi`, `psi_x`, `psi_y`, `psi_z`.
    pub name: &'static str,
    /// Its values at time zero.
    pub initial: Expression,
    /// Its values on the boundary.
    pub inflow: Inflow,
}

impl Field {
    /// The formula of what enters.
    pub fn entering(&self) -> &Expression {
        match &self.inflow {
            Inflow::Formula(f) => f,
            Inflow::Initial => &self.initial,
        }
    }

    /// Whether anything may enter.
    pub fn enters(&self) -> bool {
        self.entering().constant() != Some(0.0)
    }

    /// Whether what enters depends on time.
    pub fn varies(&self) -> bool {
        self.entering().depends_on(TIME)
    }
}

/// `initial.warped`: a file that holds `w(0, x, v, p)`.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct WarpedStart {
    /// Where it is.
    pub path: PathBuf,
    /// File and line of the key, for errors.
    pub place: String,
}

/// Position of `t` among the coordinates `[x, y, z, vx, vy, vz, t]` of a formula.
pub const TIME: usize = 6;

/// A time before the end at which results are written.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct OutputTime {
    /// The time.
    pub time: f64,
    /// Whether the fields are, and not their moments only.
    pub fields: bool,
}

/// The exact solution results are compared with.
#[derive(Clone, Debug)]
pub enum Exact {
    /// Particles traced back through the piecewise linear potential.
    Characteristics,
    /// A formula for `f(T, x, v)`; `t` may occur.
    Formula(Expression),
}

/// How the fields are stored in `result.h5`.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Storage {
    /// `output.compression`: level of deflate, 0 for none.
    pub compression: u8,
    /// `output.chunks`: cells of a chunk along each axis, in storage order; planned where there is compression.
    pub chunks: Option<Vec<usize>>,
    /// `output.xdmf`: whether to write `fields.xdmf`, and what it shows.
    pub xdmf: bool,
}

impl Storage {
    /// At most so many chunks has a dataset; 0 where there are none.
    pub fn most_chunks(&self, space: &PhaseSpace) -> usize {
        match &self.chunks {
            Some(chunks) => (chunks.iter().zip(space.axes()))
                .map(|(c, axis)| axis.cells.div_ceil(*c))
                .product(),
            // Planned chunks are of CHUNK/2 cells at least, and not more than half of them at the ends of an axis.
            None if self.compression > 0 => (1 + 4 * space.cells() / CHUNK).min(MOST_CHUNKS),
            None => 0,
        }
    }
}

/// `[readout]`: what is measured of the result on a quantum computer (see [`crate::quantum::readout`]).
#[derive(Clone, Debug, PartialEq)]
pub struct Readout {
    /// Space cells, along each axis from 0.
    pub cells: Vec<Vec<usize>>,
    /// How long it is measured.
    pub effort: Effort,
    /// `seed` of the random numbers.
    pub seed: u64,
}

/// How long an observable is measured.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Effort {
    /// So long.
    Given {
        /// Shots of a Hadamard test.
        shots: u64,
        /// Values of the register of amplitude estimation, a power of two.
        evaluations: u64,
    },
    /// As long as density and momentum take to be known to within this.
    Accuracy(f64),
}

/// A problem and how to solve it, as read from a case file.
#[derive(Clone, Debug)]
pub struct Case {
    /// Name of the file it was read from.
    pub name: String,
    /// `title`.
    pub title: String,
    /// `reference`.
    pub reference: String,
    /// The grid.
    pub space: PhaseSpace,
    /// Branches of `V`.
    pub potential: Vec<Region>,
    /// What `initial` gives.
    pub data: Data,
    /// The functions that obey the Liouville equation: `f`, or the density `φ` and the level sets `ψ_a`.
    pub fields: Vec<Field>,
    /// `initial.warped`; `f(0)` is not known then, and its formula stands for nothing.
    pub start: Option<WarpedStart>,
    /// Final time `T`.
    pub end: f64,
    /// `scheme.interface`.
    pub interface: Interface,
    /// `scheme.limiter`.
    pub limiter: Limiter,
    /// `solver.method`.
    pub method: Method,
    /// `solver.tolerance`: relative l2 distance to the exact semi-discrete solution.
    pub tolerance: f64,
    /// File and line of the tolerance, for errors.
    pub tolerance_place: String,
    /// File and line of `solver.warp.interval`, for errors.
    pub interval_place: String,
    /// `solver.verify`: whether to measure that distance (one classical solve).
    pub verify: bool,
    /// `[solver.warp]`.
    pub warp: Warp,
    /// `[solver.propagator]`.
    pub propagator: Propagation,
    /// `solver.classical.integrator`.
    pub integrator: Integrator,
    /// `solver.classical.cfl`.
    pub cfl: f64,
    /// `[solver.reduce]`.
    pub reduce: Allowed,
    /// What was left out of what the file gives.
    pub reductions: Reductions,
    /// `[exact]`.
    pub exact: Option<Exact>,
    /// `output.recovery_points`: 2 gives the error estimate.
    pub recovery_points: usize,
    /// `output.plateau`.
    pub plateau: Option<Plateau>,
    /// `output.moments_every`, `moment_times` and `field_times`, ascending.
    pub times: Vec<OutputTime>,
    /// `output.warped_field`: whether all modes are kept, and `w(t, x, v, p)` is written.
    pub warped_field: bool,
    /// `output.expand`: whether results are shown on axes that were left out.
    pub expand: bool,
    /// `output.delta_width`, for measure-valued data.
    pub delta_width: DeltaWidth,
    /// How the fields are stored.
    pub storage: Storage,
    /// `checkpoint.minutes`: how often a checkpoint is made; never by the clock where there is none.
    pub checkpoint_every: Option<Duration>,
    /// `[readout]`.
    pub readout: Option<Readout>,
    /// The case file as read.
    pub text: String,
    /// The `--set` options applied to it.
    pub overrides: Vec<String>,
    /// Every value that both give, by its key.
    pub settings: BTreeMap<String, String>,
}

impl Case {
    /// Whether anything may enter, of any field.
    pub fn enters(&self) -> bool {
        self.fields.iter().any(Field::enters)
    }

    /// Whether there are auxiliary unknowns: where anything may enter, or where they are wanted all the same.
    pub fn embeds(&self) -> bool {
        self.enters() || self.reductions.idle_unknowns
    }

    /// The same case with nothing that enters.
    pub fn without_inflow(&self) -> Self {
        let mut case = self.clone();
        for field in &mut case.fields {
            field.inflow = Inflow::Formula(field.entering().vanishing());
        }
        case
    }

    /// How long each leg of the run takes: from one output time to the next, the last to the end.
    pub fn legs(&self) -> Vec<f64> {
        let ends = (self.times.iter().map(|t| t.time)).chain([self.end]);
        let mut now = 0.0;
        ends.map(|end| end - std::mem::replace(&mut now, end))
            .collect()
    }

    /// Whether what enters depends on time, of any field.
    pub fn varies(&self) -> bool {
        self.fields.iter().any(Field::varies)
    }
}

/// `[solver.reduce]`: what may be left out.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Allowed {
    /// Axes along which nothing varies.
    pub axes: bool,
    /// Velocities that nothing reaches.
    pub velocities: bool,
    /// Auxiliary unknowns where nothing enters.
    pub inflow: bool,
    /// The modes `l < 0`.
    pub modes: bool,
}

impl Allowed {
    /// All, or nothing.
    pub fn all(allowed: bool) -> Self {
        Self {
            axes: allowed,
            velocities: allowed,
            inflow: allowed,
            modes: allowed,
        }
    }
}

/// What was left out of a case, and what was not though it looks so; a line each.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub struct Reductions {
    /// Left out.
    pub dropped: Vec<String>,
    /// Kept, and why.
    pub kept: Vec<String>,
    /// Whether there are auxiliary unknowns though nothing enters.
    pub idle_unknowns: bool,
    /// Whether modes of both signs are propagated.
    pub every_mode: bool,
}
