//! From a case and a number of ranks to every derived number, before anything is allocated or solved.
//!
//! A [`Plan`] is data: printed by `phasewarp plan`, stored in every result, tested without MPI. It has two parts: what
//! is computed ([`WarpPlan`], the same for any ranks) and who computes it ([`Layout`]).
//!
//! **Tolerance.** The error of the recovered field is at most about `ε‖ũ(0)‖`, with `ũ(0)` the weighted state and its
//! auxiliary unknowns; what is asked for is relative to `‖f(T)‖`. So the profile is planned for
//! `ε = tolerance · ‖f(T)‖/‖ũ(0)‖`. The ratio is measured by a cheap probe when running (see [`crate::run`]); the plan
//! alone assumes [`ASSUMED_RATIO`].

use crate::case::{
    Case, Delta, Integrator, Interface, Limiter, Method, Propagation, PropagatorMethod,
};
pub mod advice;
mod balance;
mod layout;
mod placement;

pub use balance::{Batch, cost};
pub use layout::{Layout, Resources, bytes_text, refuse_hopeless};
pub use placement::MOST_MODES;

use crate::classical::limiter::longest_step;
use crate::classical::{EXACT, duhamel_applications, duhamel_panels, poisson_window};
use crate::error::{Error, Result};
use crate::grid::MAX_DIMENSION;
use crate::matrix::LANES;
use crate::partition::Block;
use crate::potential::Potential;
use crate::profile::{Profile, Series};
use crate::propagate;
use crate::propagate::Company;
use crate::propagate::commutator_free::stage_degree;
use crate::recover::Reading;
use crate::scheme::{fastest, transport_rate};
use crate::warp::fourier;
use num_complex::Complex64;
use placement::Placement;
use serde::Serialize;
use std::collections::{BTreeSet, HashSet};
use std::fmt;
use std::hash::{Hash, Hasher};

/// `‖ũ(0)‖/‖f(T)‖` before it is known.
pub const ASSUMED_RATIO: f64 = 1.5;

/// Growth over the whole run, `λ⁺T`, that the weights may leave where particles are trapped. Less costs sweeps, more costs modes and degrees: from
/// 0.375 to 0.15 the applications of example 1 at 1e-11 fall by 5 %, the sweeps in a well double.
pub const WEIGHT_GROWTH: f64 = 0.15;

/// Shift of the weights' system, `sT`; its solution has growth `½ sT`, and the sweeps stop at [`WEIGHT_GROWTH`].
pub const WEIGHT_SHIFT: f64 = 0.2;

/// Growth over the whole run, `θT`, that the inflow's couplings may add. Less makes the auxiliary unknowns larger beside
/// the field (as `1/√θ`), which tightens the tolerance of the state.
pub const INFLOW_GROWTH: f64 = 0.375;

/// Largest `rate·T`: such a run has some hundred thousand modes of some million applications each.
const LONGEST_SPAN: f64 = 1e6;

/// More kinds of cells than this are not counted.
pub const MOST_KINDS: usize = 4096;

/// Bounds on the generator that hold without computing it.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct Bounds {
    /// `max |A_ii|`.
    pub rate: f64,
    /// `γ ≥ λ⁺`.
    pub growth: f64,
    /// `2 max |A_ii| + γ ≥ λ⁻`.
    pub decay: f64,
    /// Whether `V` jumps.
    pub jumps: bool,
    /// Kinds of space cells by slopes and jumps of `V`, up to [`MOST_KINDS`]: rows of the matrix repeat where a kind does.
    pub kinds: usize,
    /// Whether the hat interface needs weights to keep `γ`.
    pub weighted: bool,
    /// Whether anything may enter.
    pub inflow: bool,
    /// Exponentials in a row that an inflow takes that depends on time; 0 where there is none, or before it is known.
    pub stages: usize,
}

/// What a Schrödingerized run computes, for any ranks.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct WarpPlan {
    /// `‖ũ(0)‖/‖f(T)‖` planned for.
    pub ratio: f64,
    /// The tolerance the profile is planned for.
    pub state_tolerance: f64,
    /// The profile; none where the warped field is read from a file.
    pub profile: Option<Profile>,
    /// Its Fourier series.
    pub series: Series,
    /// `[L, R]`: given by hand, or one that the tolerance asks for; of the analytic coefficients only its length matters.
    pub interval: [f64; 2],
    /// Number of modes that are propagated: those with `l ≥ 0`, whose conjugates the others are; with `solver.reduce.modes = false`
    /// behind them those with `l = −1, −2, …`.
    pub modes: usize,
    /// Points `N_p` of the whole warped field, where all modes are kept.
    pub points: Option<usize>,
    /// How `u` is read; a second reading gives the error estimate.
    pub readings: Vec<Reading>,
    /// What part of the error the distance of the two readings shows; more than 1 where it overstates it.
    pub seen: f64,
    /// The readings of `output.plateau`, of the first field.
    pub plateau: Vec<Reading>,
    /// What each mode takes: applications (Chebyshev: the degrees of its series; Krylov: at most), or solves of an implicit
    /// method. Who computes it with which others is the layout's.
    pub work: Vec<usize>,
    /// The same by leg, from one output time to the next, then by mode.
    #[serde(skip)]
    pub leg_work: Vec<Vec<usize>>,
    /// Relative error that each mode is allowed: its share of a tenth of the state's tolerance; where the warped field is read from a
    /// file, the tolerance itself, so that the whole of it is within the tolerance of its norm.
    #[serde(skip)]
    pub mode_tolerances: Vec<f64>,
    /// Applications, over the modes and fields, all stages of an inflow that depends on time included; 0 where systems are
    /// solved instead. A mode counts with its own degree, on any ranks: where others of its batch go on, its lane is idle.
    pub applications: usize,
    /// Solves of an implicit method, over the modes.
    pub solves: usize,
    /// `Σ |weight|` of the first reading: how much round-off is amplified.
    pub amplification: f64,
    /// What the user should know.
    pub warnings: Vec<String>,
}

/// Every derived number of a run.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct Plan {
    /// Title of the case.
    pub title: String,
    /// Cells along each axis, `(x1..xn, v1..vn)`.
    pub shape: Vec<usize>,
    /// Unknowns.
    pub cells: usize,
    /// What was left out of the case, a line each.
    pub reductions: Vec<String>,
    /// Final time.
    pub time: f64,
    /// The method.
    pub method: Method,
    /// Interface rows.
    pub interface: Interface,
    /// Slopes of the classical method.
    pub limiter: Limiter,
    /// What applies `exp(−iHT)` to a mode, and its step (of an implicit method: as it is used).
    pub propagation: Propagation,
    /// Steps of an implicit method.
    pub steps: usize,
    /// Number of fields evolved.
    pub fields: usize,
    /// What was asked for.
    pub tolerance: f64,
    /// Bounds on the generator.
    pub bounds: Bounds,
    /// The Schrödingerized part, unless the method is classical.
    pub warp: Option<WarpPlan>,
    /// Steps (or terms of the exponential) of the classical method.
    pub classical_steps: usize,
    /// Ranks and memory.
    pub layout: Layout,
}

impl Bounds {
    /// Bounds of `case`; evaluates `V` on the whole space grid. Growth is what weights and inflow are allowed; without
    /// weights the hat interface has no such bound, nor has inflow with a given `δ`, and [`f64::INFINITY`] stands until it
    /// is measured.
    ///
    /// # Errors
    /// [`Error::Formula`] where `V` is not finite.
    pub fn new(case: &Case) -> Result<Self> {
        // Layer by layer, so that the whole potential is never kept.
        let mut ranges: Vec<_> = case.space.x.iter().map(|a| 0..a.cells).collect();
        let (mut force, mut jumps) = (0.0f64, [false; MAX_DIMENSION]);
        let mut kinds = HashSet::new();
        for i in 0..case.space.x[0].cells {
            ranges[0] = i..i + 1;
            let layer = Potential::new(case, &ranges)?;
            force = force.max(layer.force_rate(&case.space));
            let found = layer.jumps();
            jumps
                .iter_mut()
                .zip(found)
                .for_each(|(j, found)| *j |= found);
            layer.collect_kinds(&mut kinds, MOST_KINDS);
        }
        // Through a jump a cell may be its own neighbour and particles move on all the same.
        let single: f64 = (0..case.space.dimension())
            .filter(|&a| jumps[a] && case.space.is_single(a))
            .map(|a| fastest(&case.space, a))
            .sum();
        let rate = transport_rate(&case.space) + single + force;
        let jumps = jumps.contains(&true);
        let inflow = case.embeds();
        let hat = jumps && case.interface == Interface::Hat;
        let weights = match (hat, case.warp.weights) {
            (false, _) => 0.0,
            (true, true) => WEIGHT_GROWTH,
            (true, false) => f64::INFINITY,
        };
        let couplings = match (inflow, case.warp.delta) {
            (false, _) => 0.0,
            (true, Delta::Planned) => INFLOW_GROWTH,
            (true, _) => f64::INFINITY,
        };
        let growth = f64::max(weights, couplings) / case.end;
        Ok(Self {
            rate,
            growth,
            decay: 2.0 * rate + growth,
            jumps,
            kinds: kinds.len(),
            stages: 0,
            weighted: hat && case.warp.weights && case.method == Method::Schrodingerized,
            inflow,
        })
    }
}

impl Bounds {
    /// These bounds with a finite growth, for planning who does what before the growth is measured.
    pub fn expected(&self) -> Self {
        Self {
            growth: if self.growth.is_finite() {
                self.growth
            } else {
                0.0
            },
            decay: 2.0 * self.rate,
            ..self.clone()
        }
    }
}

impl WarpPlan {
    /// Plans profile, modes and degrees for growth bound `bounds.growth`.
    ///
    /// # Errors
    /// [`Error::Tolerance`], [`Error::Growth`] and [`Error::Recovery`] when round-off forbids the tolerance, [`Error::Interval`] when the
    /// interval given by hand is too short, [`Error::Modes`] and [`Error::TooLong`] when it takes too much.
    pub fn new(case: &Case, bounds: &Bounds, ratio: f64) -> Result<Self> {
        let time = case.end;
        if bounds.rate * time > LONGEST_SPAN {
            return Err(Error::TooLong {
                end: time,
                rate: bounds.rate,
                span: 2.0 * bounds.rate * time,
                limit: 2.0 * LONGEST_SPAN,
            });
        }
        let state_tolerance = case.tolerance / ratio;
        let Placement {
            profile,
            series,
            interval,
            readings,
            plateau,
            seen,
            warnings,
        } = placement::place(case, bounds, ratio)?;
        let modes = modes_of(case, &series);
        let weight_of = |of: usize, l: usize| weight((&series, of), &readings[0], l).norm();
        let weight = |l: usize| weight_of(modes, l);
        // A mode and its conjugate share what is allowed, so that each is what it is without the other.
        let (own, share) = (series.modes(), |l| {
            weight_of(series.modes(), mode_of(&series, l).0)
        });
        let allowed = |l: usize| match profile {
            Some(_) => mode_tolerance(state_tolerance, own, share(l)),
            None => case.tolerance,
        };
        let mode_tolerances: Vec<f64> = (0..modes).map(allowed).collect();
        let mut scratch = Vec::new();
        let legs = case.legs();
        let mut leg_work = |&time: &f64| -> Vec<usize> {
            let mut work: Vec<usize> = (0..modes)
                .map(|l| {
                    let (mu, leg) = (
                        wavenumber(&series, l),
                        (time, mode_tolerances[l] / legs.len() as f64),
                    );
                    propagate::work(case, bounds, mu, leg, &mut scratch)
                })
                .collect();
            if propagate::company(case.propagator.method) == Company::Coupled {
                // Each takes what the longest of its block takes.
                for block in work.rchunks_mut(LANES) {
                    let most = block.iter().copied().max().unwrap_or(0);
                    block.fill(most);
                }
            }
            work
        };
        let leg_work: Vec<Vec<usize>> = legs.iter().map(&mut leg_work).collect();
        let work: Vec<usize> = (0..modes)
            .map(|l| leg_work.iter().map(|work| work[l]).sum())
            .collect();
        let mut each = |(l, work): (usize, &usize)| match bounds.stages {
            0 => *work,
            stages => {
                let span = (bounds.rate, bounds.growth, time);
                let mu = wavenumber(&series, l);
                stages * stage_degree(&mut scratch, mu, *work, span, stages)
            }
        };
        let total = work.iter().enumerate().map(&mut each).sum();
        let (applications, solves) = match propagate::order(case.propagator.method) {
            0 => (total, 0),
            _ => (0, total),
        };
        Ok(Self {
            ratio,
            state_tolerance,
            modes,
            applications: case.fields.len() * applications,
            solves: case.fields.len() * solves,
            amplification: (0..modes).map(weight).sum(),
            seen,
            readings,
            plateau,
            interval,
            mode_tolerances,
            points: (case.warped_field || case.start.is_some()).then(|| fourier::points(&series)),
            work,
            leg_work,
            profile,
            series,
            warnings,
        })
    }

    /// How many modes [`new`](Self::new) would plan: known long before what each of them takes.
    ///
    /// # Errors
    /// As [`new`](Self::new).
    pub fn modes_of(case: &Case, bounds: &Bounds, ratio: f64) -> Result<usize> {
        let placed = placement::place(case, bounds, ratio)?;
        Ok(modes_of(case, &placed.series))
    }

    /// What [`new`](Self::new) would plan, nearly, from some of the modes: applications or solves over all of them and all fields.
    ///
    /// # Errors
    /// As [`new`](Self::new).
    pub fn forecast(case: &Case, bounds: &Bounds, ratio: f64) -> Result<f64> {
        /// Modes that are looked at, about.
        const SAMPLE: usize = 64;
        let placed = placement::place(case, bounds, ratio)?;
        let (series, reading) = (&placed.series, &placed.readings[0]);
        let (modes, stages) = (modes_of(case, series), bounds.stages.max(1));
        let mut scratch = Vec::new();
        let stride = modes.div_ceil(SAMPLE);
        let (mut sum, mut count) = (0.0, 0);
        for l in (stride / 2..modes).step_by(stride) {
            let weight = weight((series, modes), reading, l).norm();
            let allowed = mode_tolerance(case.tolerance / ratio, modes, weight);
            let (mu, time) = (wavenumber(series, l), case.end / stages as f64);
            let work = propagate::work(case, bounds, mu, (time, allowed), &mut scratch);
            sum += (stages * work) as f64;
            count += 1;
        }
        let mean = sum / f64::from(count.max(1));
        Ok(mean * (modes * case.fields.len()) as f64)
    }

    /// A number that plans share which are the same to the last bit.
    pub fn fingerprint(&self) -> u64 {
        let mut hasher = std::hash::DefaultHasher::new();
        self.leg_work.hash(&mut hasher);
        for c in &self.series.coefficients {
            [c.re.to_bits(), c.im.to_bits()].hash(&mut hasher);
        }
        hasher.finish()
    }

    /// Factor of `w_l(T)` in `reading`.
    pub fn weight(&self, l: usize, reading: &Reading) -> Complex64 {
        weight((&self.series, self.modes), reading, l)
    }

    /// `μ` of mode `l`.
    pub fn wavenumber(&self, l: usize) -> f64 {
        wavenumber(&self.series, l)
    }

    /// `Σ |weight|` of a reading.
    pub fn amplification(&self, reading: &Reading) -> f64 {
        (0..self.modes)
            .map(|l| self.weight(l, reading).norm())
            .sum()
    }

    /// Relative error that mode `l` is allowed in a leg.
    pub fn leg_tolerance(&self, l: usize) -> f64 {
        self.mode_tolerances[l] / self.leg_work.len() as f64
    }

    /// Most work of a mode in a leg.
    pub fn largest_work(&self) -> usize {
        self.leg_work.iter().flatten().copied().max().unwrap_or(0)
    }
}

/// A mode's share of a tenth of the state's tolerance.
fn mode_tolerance(state_tolerance: f64, modes: usize, weight: f64) -> f64 {
    (state_tolerance / (10.0 * modes as f64 * weight)).min(1.0)
}

/// How many modes of `series` are propagated.
fn modes_of(case: &Case, series: &Series) -> usize {
    let own = series.modes();
    match case.reductions.every_mode {
        true => own + (0..own).filter(|&l| !series.is_alone(l)).count(),
        false => own,
    }
}

/// The mode of `series` that the `l`-th is, or, where the last is true, whose conjugate it is.
fn mode_of(series: &Series, l: usize) -> (usize, bool) {
    match l.checked_sub(series.modes()) {
        None => (l, false),
        Some(behind) => (behind + 1, true),
    }
}

fn wavenumber(series: &Series, l: usize) -> f64 {
    let (own, mirrored) = mode_of(series, l);
    if mirrored {
        -series.wavenumber(own)
    } else {
        series.wavenumber(own)
    }
}

/// Factor of the `l`-th of `modes` modes in `reading`.
fn weight((series, modes): (&Series, usize), reading: &Reading, l: usize) -> Complex64 {
    let (own, mirrored) = mode_of(series, l);
    let both = modes > series.modes() && !series.is_alone(own);
    let factor = series.factor(own) * if both { 0.5 } else { 1.0 };
    let weight = factor * reading.of_wave(series.wavenumber(own));
    if mirrored { weight.conj() } else { weight }
}

impl Plan {
    /// Plans `case` for `resources`, `ratio` being `‖ũ(0)‖/‖f(T)‖`.
    ///
    /// # Errors
    /// A tolerance that cannot be met, a mesh that does not fit, too little memory.
    pub fn new(case: &Case, resources: &Resources, ratio: f64) -> Result<Self> {
        let bounds = Bounds::new(case)?;
        Self::with_bounds(case, bounds, resources, ratio)
    }

    /// As [`new`](Self::new), with bounds known already.
    ///
    /// # Errors
    /// As [`new`](Self::new).
    pub fn with_bounds(
        case: &Case,
        bounds: Bounds,
        resources: &Resources,
        ratio: f64,
    ) -> Result<Self> {
        let warp = match case.method {
            Method::Schrodingerized => Some(WarpPlan::new(case, &bounds, ratio)?),
            Method::Classical if bounds.rate * case.end > LONGEST_SPAN * LONGEST_SPAN => {
                return Err(Error::TooLong {
                    end: case.end,
                    rate: bounds.rate,
                    span: bounds.rate * case.end,
                    limit: LONGEST_SPAN * LONGEST_SPAN,
                });
            }
            Method::Classical => None,
        };
        let steps: Vec<usize> = (case.legs().iter())
            .map(|&leg| propagate::steps(&case.propagator, leg))
            .collect();
        let longest = (case.legs().iter().zip(&steps))
            .map(|(leg, &steps)| leg / steps as f64)
            .fold(0.0, f64::max);
        let steps = steps.iter().sum();
        let layout = Layout::new(case, &bounds, warp.as_ref(), resources)?;
        let largest = Block::new(&case.space, &layout.mesh, 0);
        if 2 * largest.cells() + largest.ghosts() > u32::MAX as usize {
            return Err(Error::Ranks(format!(
                "{} cells on a rank, {} of memory; at most {} can be numbered: more blocks along x (--ranks-x)",
                largest.cells(),
                bytes_text(layout.memory()),
                u32::MAX / 2
            )));
        }
        Ok(Self {
            title: case.title.clone(),
            shape: case.space.shape(),
            cells: case.space.cells(),
            reductions: case.reductions.dropped.clone(),
            time: case.end,
            method: case.method,
            interface: case.interface,
            propagation: match steps {
                0 => case.propagator,
                _ => Propagation {
                    step: Some(longest),
                    ..case.propagator
                },
            },
            steps,
            limiter: case.limiter,
            fields: case.fields.len(),
            tolerance: case.tolerance,
            classical_steps: classical_steps(case, &bounds).iter().sum(),
            bounds,
            warp,
            layout,
        })
    }

    /// The batches of mode group `group` that are left of a stage whose modes `finished` are. Where modes are kept, each
    /// stays with its group.
    pub fn batches_left(&self, finished: &BTreeSet<usize>, group: usize) -> Vec<Batch> {
        let Some(warp) = &self.warp else {
            return Vec::new();
        };
        let company = propagate::company(self.propagation.method);
        let groups = self.layout.mesh.groups;
        if warp.points.is_none() {
            return balance::share_out(&warp.work, finished, company, groups).swap_remove(group);
        }
        let mut others = finished.clone();
        let kept = self.layout.modes();
        others.extend((0..groups).filter(|&g| g != group).flat_map(|g| &kept[g]));
        balance::share_out(&warp.work, &others, company, 1).swap_remove(0)
    }

    /// The plan before growth and norms are measured: who computes what, and about how much. A tolerance that may turn out
    /// too small, or an interval too short for it, is not refused yet.
    ///
    /// # Errors
    /// As [`new`](Self::new), but for the tolerance.
    pub fn provisional(case: &Case, bounds: &Bounds, resources: &Resources) -> Result<Self> {
        /// What can be reached with a growth that weights and inflow are allowed.
        const POSSIBLE: f64 = 1e-12;
        let mut case = case.clone();
        case.tolerance = case.tolerance.max(POSSIBLE);
        if case.start.is_none() {
            case.warp.interval = None;
        }
        Self::with_bounds(&case, bounds.expected(), resources, 1.0)
    }

    /// This plan with the modes of `series` instead of its own, each within `tolerance` of its norm, read as `readings` say:
    /// whether they give the field or not is not asked.
    ///
    /// # Errors
    /// [`Error::Ranks`] and [`Error::Memory`].
    pub fn with_series(
        &self,
        case: &Case,
        (series, readings): (Series, Vec<Reading>),
        tolerance: f64,
        resources: &Resources,
    ) -> Result<Self> {
        let modes = series.modes();
        let mut scratch = Vec::new();
        let mut of_mode = |l| {
            let leg = (case.end, tolerance);
            propagate::work(case, &self.bounds, series.wavenumber(l), leg, &mut scratch)
        };
        let work: Vec<usize> = (0..modes).map(&mut of_mode).collect();
        let warp = WarpPlan {
            ratio: 1.0,
            state_tolerance: tolerance,
            profile: None,
            interval: [0.0, series.period],
            modes,
            points: None,
            plateau: Vec::new(),
            seen: 1.0,
            leg_work: vec![work.clone()],
            mode_tolerances: vec![tolerance; modes],
            applications: case.fields.len() * work.iter().sum::<usize>(),
            solves: 0,
            amplification: readings.first().map_or(0.0, |r| {
                (0..modes)
                    .map(|l| weight((&series, modes), r, l).norm())
                    .sum()
            }),
            warnings: Vec::new(),
            work,
            readings,
            series,
        };
        Ok(Self {
            layout: Layout::new(case, &self.bounds, Some(&warp), resources)?,
            warp: Some(warp),
            ..self.clone()
        })
    }

    /// Planned bytes on the fullest rank.
    pub fn memory(&self) -> u64 {
        self.layout.memory()
    }

    fn propagator_text(&self, warp: &WarpPlan) -> String {
        let least = warp.work.iter().copied().min().unwrap_or(0);
        let most = warp.largest_work();
        let step = self.propagation.step;
        let steps = |name: &str| {
            let step = step.unwrap_or(self.time);
            format!("{name}: {} steps of {step:.6e}", self.steps)
        };
        match self.propagation.method {
            PropagatorMethod::Chebyshev => format!("chebyshev: degree {least} to {most}"),
            PropagatorMethod::Krylov => {
                let capped = step.map_or(String::new(), |s| format!(", steps of at most {s:e}"));
                format!("krylov: at most {least} to {most} applications a mode{capped}")
            }
            PropagatorMethod::CrankNicolson => steps("crank-nicolson"),
            PropagatorMethod::BackwardEuler => steps("backward-euler"),
        }
    }

    /// Jacobi sweeps that better weights are worth: a sweep takes about as long as two applications, and they should not
    /// take more than a few hundredths of the run.
    pub fn patience(&self) -> usize {
        self.warp.as_ref().map_or(0, |w| {
            let unit = propagate::unit(self.propagation.method);
            ((w.applications + w.solves) * unit / 50).max(16)
        })
    }
}

/// Steps of the classical method, leg by leg.
pub fn classical_steps(case: &Case, bounds: &Bounds) -> Vec<usize> {
    let steps = |&time: &f64| classical_steps_of(case, bounds.rate * time);
    case.legs().iter().map(steps).collect()
}

fn classical_steps_of(case: &Case, courant: f64) -> usize {
    match case.integrator {
        Integrator::Exponential if case.varies() => {
            duhamel_applications(courant, duhamel_panels(courant))
        }
        Integrator::Exponential => poisson_window(courant, EXACT).end,
        Integrator::ForwardEuler | Integrator::SspRk3 => (courant
            / (case.cfl * longest_step(case.limiter)))
        .ceil()
        .max(1.0) as usize,
    }
}

impl fmt::Display for Plan {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let shape: Vec<String> = self.shape.iter().map(usize::to_string).collect();
        writeln!(
            f,
            "grid            {} = {} cells",
            shape.join(" x "),
            self.cells
        )?;
        for line in &self.reductions {
            writeln!(f, "reduced         {line}")?;
        }
        let b = &self.bounds;
        let mut scene = vec![if b.jumps { "jumps" } else { "no jump" }];
        scene.push(if b.inflow { "inflow" } else { "no inflow" });
        if b.weighted {
            scene.push("dissipative weights");
        }
        writeln!(f, "scene           {}", scene.join(", "))?;
        if b.stages > 0 {
            writeln!(
                f,
                "time            {} steps of two exponentials",
                b.stages / 2
            )?;
        }
        if let Some(w) = &self.warp {
            writeln!(
                f,
                "spectrum of S   [-{:.4}, {:.4}] guaranteed, time {:e}",
                b.decay, b.growth, self.time
            )?;
            writeln!(
                f,
                "tolerance       {:e} (state {:.2e})",
                self.tolerance, w.state_tolerance
            )?;
            let file = || "that of initial.warped".to_owned();
            let profile = w.profile.as_ref().map_or_else(file, Profile::to_string);
            writeln!(
                f,
                "profile         {}: period {:.4}, cut-off {:.4}, read at {:.4}",
                profile,
                w.series.period,
                w.series.wavenumber(w.series.modes() - 1),
                w.readings[0].point
            )?;
            writeln!(
                f,
                "modes           {} ({}) in {} batches of at most {LANES}",
                w.modes,
                if w.modes > w.series.modes() {
                    "l of both signs"
                } else {
                    "l >= 0"
                },
                self.layout.groups.iter().map(Vec::len).sum::<usize>()
            )?;
            if let Some(points) = w.points {
                writeln!(
                    f,
                    "kept            all of them: w(T, x, v, p) at {points} points in p"
                )?;
            }
            writeln!(f, "propagator      {}", self.propagator_text(w))?;
            match w.solves {
                0 => writeln!(f, "applications    {}", w.applications)?,
                solves => writeln!(f, "solves          {solves}")?,
            }
            for warning in &w.warnings {
                writeln!(f, "warning         {warning}")?;
            }
        } else {
            writeln!(
                f,
                "method          classical, {} steps{}",
                self.classical_steps,
                match self.limiter {
                    Limiter::None => "",
                    Limiter::Minmod => ", minmod slopes",
                    Limiter::VanLeer => ", van Leer slopes",
                }
            )?;
        }
        let l = &self.layout;
        let blocks: Vec<String> = l.mesh.space.iter().map(usize::to_string).collect();
        writeln!(
            f,
            "ranks           {} = {} space blocks ({}) x {} mode groups, imbalance {:.3}",
            l.mesh.ranks(),
            l.mesh.blocks(),
            blocks.join(" x "),
            l.mesh.groups,
            l.imbalance
        )?;
        if l.mesh.blocks() == 1 && l.mesh.groups > 1 && self.warp.is_some() {
            writeln!(
                f,
                "reduced         space is not split: there are modes for all ranks"
            )?;
        }
        let idle = l.groups.iter().filter(|g| g.is_empty()).count();
        if idle > 0 && (self.warp.is_some() || idle < l.groups.len()) {
            writeln!(f, "                {idle} mode groups have nothing to do")?;
        }
        writeln!(f, "memory a rank   {}", bytes_text(self.memory()))?;
        for (name, bytes) in &l.arrays {
            writeln!(f, "  {:<24}{:>12}", name, bytes_text(*bytes))?;
        }
        Ok(())
    }
}
