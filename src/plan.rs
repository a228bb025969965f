//! From a case and a number of ranks to every derived number, before anything is allocated or solved.
//!
//! A [`Plan`] is data: printed by `phasewarp plan`, stored in every result, tested without MPI. It has two parts: what
//! is computed ([`WarpPlan`], the same for any ranks) and who computes it ([`Layout`]).
//!
//! **Tolerance.** The error of the recovered field is at most about `ε‖ũ(0)‖`, with `ũ(0)` the weighted state and its
//! auxiliary unknowns; what is asked for is relative to `‖f(T)‖`. So the profile is planned for
//! `ε = tolerance · ‖f(T)‖/‖ũ(0)‖`. The ratio is measured by a cheap probe when running (see [`crate::run`]); the plan
//! alone assumes [`ASSUMED_RATIO`].

use crate::case::{Case, Exact, Integrator, Interface, LARGEST_TOLERANCE, Method};
use crate::classical::{EXACT, poisson_window};
use crate::error::{Error, Result};
use crate::matrix::LANES;
use crate::partition::{Block, Mesh};
use crate::potential::Potential;
use crate::profile::Gaussian;
use crate::propagate::chebyshev::{Chebyshev, Interval, degree};
use crate::scheme::transport_rate;
use num_complex::Complex64;
use serde::Serialize;
use std::fmt;

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

/// Resident memory of the program and its libraries, HDF5's buffers included.
const PROGRAM_BYTES: u64 = 28 << 20;

/// Largest `rate·T`: such a run has some hundred thousand modes of some million applications each.
const LONGEST_SPAN: f64 = 1e6;

/// Distance in `p` of the second recovery point from the first.
const SECOND_POINT: f64 = 1.0;

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
    /// Whether the hat interface needs weights to keep `γ`.
    pub weighted: bool,
    /// Whether anything may enter.
    pub inflow: bool,
}

/// A batch of neighbouring modes that share a degree.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct Batch {
    /// First mode.
    pub first: usize,
    /// Number of modes, at most [`LANES`].
    pub modes: usize,
    /// Degree of the Chebyshev series.
    pub degree: usize,
}

/// What a Schrödingerized run computes, for any ranks.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct WarpPlan {
    /// `‖ũ(0)‖/‖f(T)‖` planned for.
    pub ratio: f64,
    /// The tolerance the profile is planned for.
    pub state_tolerance: f64,
    /// The profile.
    pub profile: Gaussian,
    /// Number of modes `l ≥ 0`; the others are their conjugates.
    pub modes: usize,
    /// Recovery points `p◇`.
    pub recovery: Vec<f64>,
    /// The modes in batches, of rising wavenumber.
    pub batches: Vec<Batch>,
    /// Applications: degrees summed over the modes.
    pub applications: usize,
    /// `Σ |weight|` of the recovery: how much round-off is amplified.
    pub amplification: f64,
}

/// Who computes it, and in how much memory.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct Layout {
    /// The process mesh.
    pub mesh: Mesh,
    /// Mode batches by group: `groups[g]` lists indices of batches.
    pub groups: Vec<Vec<usize>>,
    /// Largest and mean modelled cost of a group, as a ratio.
    pub imbalance: f64,
    /// Bytes by array, on the fullest rank.
    pub arrays: Vec<(String, u64)>,
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
    /// Final time.
    pub time: f64,
    /// The method.
    pub method: Method,
    /// Interface rows.
    pub interface: Interface,
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
    /// weights the hat interface has no such bound, and [`f64::INFINITY`] stands until it is measured.
    ///
    /// # Errors
    /// [`Error::Formula`] where `V` is not finite.
    pub fn new(case: &Case) -> Result<Self> {
        // Layer by layer, so that the whole potential is never kept.
        let mut ranges: Vec<_> = case.space.x.iter().map(|a| 0..a.cells).collect();
        let (mut force, mut jumps) = (0.0f64, false);
        for i in 0..case.space.x[0].cells {
            ranges[0] = i..i + 1;
            let layer = Potential::new(case, &ranges)?;
            force = force.max(layer.force_rate(&case.space));
            jumps |= layer.has_jump();
        }
        let rate = transport_rate(&case.space) + force;
        let formula = match &case.inflow {
            crate::case::Inflow::Formula(f) => f,
            crate::case::Inflow::Initial => &case.initial,
        };
        let inflow = formula.constant() != Some(0.0);
        let hat = jumps && case.interface == Interface::Hat;
        let weights = match (hat, case.weights) {
            (false, _) => 0.0,
            (true, true) => WEIGHT_GROWTH,
            (true, false) => f64::INFINITY,
        };
        let couplings = if inflow { INFLOW_GROWTH } else { 0.0 };
        let growth = f64::max(weights, couplings) / case.end;
        Ok(Self {
            rate,
            growth,
            decay: 2.0 * rate + growth,
            jumps,
            weighted: hat && case.weights && case.method == Method::Schrodingerized,
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

/// `x > 0` rounded up to two digits.
fn round_up(x: f64) -> f64 {
    let unit = 10f64.powi(x.log10().floor() as i32 - 1);
    (x / unit * (1.0 + 1e-9)).ceil() * unit
}

impl WarpPlan {
    /// Plans profile, modes and degrees for growth bound `bounds.growth`.
    ///
    /// # Errors
    /// [`Error::Tolerance`] when round-off forbids the tolerance.
    pub fn new(case: &Case, bounds: &Bounds, ratio: f64) -> Result<Self> {
        let time = case.end;
        let (growth, decay) = (bounds.growth * time, bounds.decay * time);
        if bounds.rate * time > LONGEST_SPAN {
            return Err(Error::TooLong {
                end: time,
                rate: bounds.rate,
                span: 2.0 * bounds.rate * time,
                limit: 2.0 * LONGEST_SPAN,
            });
        }
        let state_tolerance = case.tolerance / ratio;
        let recovery: Vec<f64> = (0..case.recovery_points)
            .map(|k| k as f64 * SECOND_POINT)
            .collect();
        let reach = recovery.last().copied().unwrap_or(0.0);
        let profile = Gaussian::plan(state_tolerance, growth, decay, reach).ok_or_else(|| {
            match Gaussian::smallest_tolerance(growth, decay, reach) {
                Some(smallest) if smallest * ratio <= LARGEST_TOLERANCE => Error::Tolerance {
                    place: case.tolerance_place.clone(),
                    tolerance: case.tolerance,
                    smallest: round_up(smallest * ratio),
                    ratio,
                    growth,
                },
                _ => Error::Growth { ratio, growth },
            }
        })?;
        let modes = profile.modes();
        let mut series = Vec::new();
        let degrees: Vec<usize> = (0..modes)
            .map(|l| {
                let mu = profile.wavenumber(l);
                let weight = weight(&profile, l, 0.0).norm();
                let tail = state_tolerance / (10.0 * modes as f64 * weight);
                let tau = Interval::new(mu, bounds.rate, bounds.growth).half_width * time;
                degree(&mut series, tau, tail)
            })
            .collect();
        // Cut from the top, so that the batch that is not full is the cheapest.
        let mut batches = Vec::new();
        let mut end = modes;
        while end > 0 {
            let first = end.saturating_sub(LANES);
            batches.push(Batch {
                first,
                modes: end - first,
                degree: degrees[first..end].iter().copied().max().unwrap_or(0),
            });
            end = first;
        }
        batches.reverse();
        Ok(Self {
            ratio,
            state_tolerance,
            modes,
            applications: batches.iter().map(|b| b.modes * b.degree).sum(),
            amplification: (0..modes).map(|l| weight(&profile, l, 0.0).norm()).sum(),
            recovery,
            batches,
            profile,
        })
    }

    /// Factor of `w_l(T)` in the recovery at `p◇`; twice the coefficient for `l > 0`, which stands for `−l` too.
    pub fn weight(&self, l: usize, recovery: f64) -> Complex64 {
        weight(&self.profile, l, recovery)
    }

    /// Largest degree of a batch.
    pub fn largest_degree(&self) -> usize {
        self.batches.iter().map(|b| b.degree).max().unwrap_or(0)
    }
}

fn weight(profile: &Gaussian, l: usize, recovery: f64) -> Complex64 {
    let mu = profile.wavenumber(l);
    let twice = if l == 0 { 1.0 } else { 2.0 };
    profile.coefficient(mu)
        * Complex64::new(recovery, mu * recovery).exp()
        * (twice / profile.period)
}

/// Refuses a grid that no layout can fit into the memory of `resources`: arithmetic only, before anything is
/// evaluated on the grid.
///
/// # Errors
/// [`Error::Memory`].
pub fn refuse_hopeless(case: &Case, resources: &Resources) -> Result<()> {
    let (ranks, limit) = (
        resources.ranks,
        resources.memory_per_rank.unwrap_or(u64::MAX),
    );
    // The tracer keeps V and distances for all of space on every rank.
    let tracer = if matches!(case.exact, Some(Exact::Characteristics)) {
        80.0
    } else {
        0.0
    };
    let bytes_per_cell = match case.method {
        Method::Schrodingerized => 500.0,
        Method::Classical => 120.0,
    };
    let needed = bytes_per_cell * case.space.cells() as f64 / ranks as f64
        + tracer * case.space.space_cells() as f64;
    if needed > limit as f64 {
        return Err(Error::Memory {
            needed: bytes_text(needed as u64),
            available: bytes_text(limit),
            detail: format!("{:.3e} cells on {ranks} ranks", case.space.cells() as f64),
        });
    }
    Ok(())
}

/// What limits the layout.
#[derive(Clone, Debug, Default)]
pub struct Resources {
    /// Number of ranks.
    pub ranks: usize,
    /// Blocks along each x-axis, if the user says.
    pub ranks_x: Option<Vec<usize>>,
    /// Bytes a rank may take, if known.
    pub memory_per_rank: Option<u64>,
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
            time: case.end,
            method: case.method,
            interface: case.interface,
            tolerance: case.tolerance,
            classical_steps: classical_steps(case, &bounds),
            bounds,
            warp,
            layout,
        })
    }

    /// The plan before growth and norms are measured: who computes what, and about how much. A tolerance that may turn out
    /// too small is not refused yet.
    ///
    /// # Errors
    /// As [`new`](Self::new), but for the tolerance.
    pub fn provisional(case: &Case, bounds: &Bounds, resources: &Resources) -> Result<Self> {
        /// What can be reached with a growth that weights and inflow are allowed.
        const POSSIBLE: f64 = 1e-12;
        let tolerance = case.tolerance.max(POSSIBLE);
        let case = Case {
            tolerance,
            ..case.clone()
        };
        Self::with_bounds(&case, bounds.expected(), resources, 1.0)
    }

    /// Planned bytes on the fullest rank.
    pub fn memory(&self) -> u64 {
        self.layout.memory()
    }

    /// Jacobi sweeps that better weights are worth: a sweep takes about as long as two applications, and they should not
    /// take more than a few hundredths of the run.
    pub fn patience(&self) -> usize {
        self.warp
            .as_ref()
            .map_or(0, |w| (w.applications / 50).max(16))
    }
}

/// Steps of the classical method.
pub fn classical_steps(case: &Case, bounds: &Bounds) -> usize {
    let courant = bounds.rate * case.end;
    match case.integrator {
        Integrator::Exponential => poisson_window(courant, EXACT).end,
        Integrator::ForwardEuler | Integrator::SspRk3 => {
            (courant / case.cfl).ceil().max(1.0) as usize
        }
    }
}

impl Layout {
    fn new(
        case: &Case,
        bounds: &Bounds,
        warp: Option<&WarpPlan>,
        resources: &Resources,
    ) -> Result<Self> {
        let ranks = resources.ranks;
        let limit = resources.memory_per_rank.unwrap_or(u64::MAX);
        if let Some(space) = &resources.ranks_x {
            let layout = Self::of_mesh(case, bounds, warp, mesh_of(case, space, ranks)?);
            return layout.within(limit);
        }
        // Every split of the ranks into blocks × groups; the cheapest that fits, fewest blocks first.
        let mut best: Option<(bool, f64, Self)> = None;
        for blocks in (1..=ranks).filter(|b| ranks.is_multiple_of(*b)) {
            let Some(space) = split_axes(case, blocks) else {
                continue;
            };
            let mesh = Mesh {
                space,
                groups: ranks / blocks,
            };
            let layout = Self::of_mesh(case, bounds, warp, mesh);
            let fits = layout.memory() <= limit;
            let cost = if fits {
                layout.cost(case, warp)
            } else {
                layout.memory() as f64
            };
            let better = match &best {
                None => true,
                Some((other, least, _)) => (fits && !other) || (fits == *other && cost < *least),
            };
            if better {
                best = Some((fits, cost, layout));
            }
        }
        match best {
            Some((_, _, layout)) => layout.within(limit),
            None => Err(Error::Ranks(format!("{ranks} ranks do not fit the grid"))),
        }
    }

    fn of_mesh(case: &Case, bounds: &Bounds, warp: Option<&WarpPlan>, mesh: Mesh) -> Self {
        // Longest batch first, each to the group with least to do.
        let costs: Vec<usize> =
            warp.map_or(Vec::new(), |w| w.batches.iter().map(|b| b.degree).collect());
        let mut order: Vec<usize> = (0..costs.len()).collect();
        order.sort_by_key(|&b| (std::cmp::Reverse(costs[b]), b));
        let mut groups = vec![Vec::new(); mesh.groups];
        let mut load = vec![0usize; mesh.groups];
        for b in order {
            let lightest = (0..load.len()).min_by_key(|&g| (load[g], g)).unwrap_or(0);
            load[lightest] += costs[b];
            groups[lightest].push(b);
        }
        let (most, sum): (usize, usize) =
            (load.iter().copied().max().unwrap_or(0), load.iter().sum());
        let imbalance = if sum == 0 {
            1.0
        } else {
            most as f64 * mesh.groups as f64 / sum as f64
        };
        let arrays = arrays(case, bounds, warp, &mesh);
        Self {
            mesh,
            groups,
            imbalance,
            arrays,
        }
    }

    /// Modelled time, in applications of a batch on the whole grid.
    fn cost(&self, case: &Case, warp: Option<&WarpPlan>) -> f64 {
        let total: f64 = warp.map_or(1.0, |w| w.batches.iter().map(|b| b.degree as f64).sum());
        let group = if warp.is_some() {
            total * self.imbalance / self.mesh.groups as f64
        } else {
            total
        };
        let fullest = Block::new(&case.space, &self.mesh, 0);
        // Ghost rows are packed, sent and unpacked: about the work of two rows each, and a round of latency.
        let rows = fullest.cells() as f64 + 2.0 * fullest.ghosts() as f64;
        let latency = if self.mesh.blocks() > 1 { 1.02 } else { 1.0 };
        group * latency * rows / case.space.cells() as f64
    }

    /// Planned bytes on the fullest rank.
    pub fn memory(&self) -> u64 {
        self.arrays.iter().map(|a| a.1).sum()
    }

    /// Refuses what does not fit into `limit` bytes a rank.
    ///
    /// # Errors
    /// [`Error::Memory`].
    pub fn within(self, limit: u64) -> Result<Self> {
        if self.memory() <= limit {
            return Ok(self);
        }
        let (name, bytes) = self
            .arrays
            .iter()
            .max_by_key(|a| a.1)
            .cloned()
            .unwrap_or_default();
        Err(Error::Memory {
            needed: bytes_text(self.memory()),
            available: bytes_text(limit),
            detail: format!("{name}: {}", bytes_text(bytes)),
        })
    }
}

fn mesh_of(case: &Case, space: &[usize], ranks: usize) -> Result<Mesh> {
    let n = case.space.dimension();
    if space.len() > n {
        return Err(Error::Ranks(format!(
            "--ranks-x: {} numbers given, the case has {n} x-axes",
            space.len()
        )));
    }
    let mut space = space.to_vec();
    space.resize(n, 1);
    let mesh = Mesh { space, groups: 1 };
    mesh.validate(&case.space)?;
    let blocks = mesh.blocks();
    if !ranks.is_multiple_of(blocks) {
        let divisors: Vec<String> = (1..=ranks)
            .filter(|d| ranks.is_multiple_of(*d))
            .map(|d| d.to_string())
            .collect();
        return Err(Error::Ranks(format!(
            "--ranks-x: {blocks} blocks do not divide {ranks} ranks; products of {} do",
            divisors.join(", ")
        )));
    }
    Ok(Mesh {
        groups: ranks / blocks,
        ..mesh
    })
}

/// `blocks` split over the x-axes with the fewest ghosts; `None` if no axis has that many cells.
fn split_axes(case: &Case, blocks: usize) -> Option<Vec<usize>> {
    fn visit(
        case: &Case,
        axis: usize,
        left: usize,
        parts: &mut Vec<usize>,
        best: &mut Option<(usize, Vec<usize>)>,
    ) {
        let axes = &case.space.x;
        if axis == axes.len() {
            if left == 1 {
                // Ghost cells of an inner block.
                let size: Vec<usize> = axes
                    .iter()
                    .zip(&*parts)
                    .map(|(a, p)| a.cells.div_ceil(*p))
                    .collect();
                let volume: usize = size.iter().product();
                let ghosts = size
                    .iter()
                    .zip(&*parts)
                    .filter(|(_, p)| **p > 1)
                    .map(|(s, _)| 2 * volume / s)
                    .sum();
                if best.as_ref().is_none_or(|(least, _)| ghosts < *least) {
                    *best = Some((ghosts, parts.clone()));
                }
            }
            return;
        }
        for p in (1..=left.min(axes[axis].cells)).filter(|p| left.is_multiple_of(*p)) {
            parts.push(p);
            visit(case, axis + 1, left / p, parts, best);
            parts.pop();
        }
    }
    let mut best = None;
    visit(case, 0, blocks, &mut Vec::new(), &mut best);
    best.map(|(_, parts)| parts)
}

/// The arrays of the fullest rank, in bytes.
fn arrays(
    case: &Case,
    bounds: &Bounds,
    warp: Option<&WarpPlan>,
    mesh: &Mesh,
) -> Vec<(String, u64)> {
    let n = case.space.dimension() as u64;
    let space_block: u64 = case
        .space
        .x
        .iter()
        .zip(&mesh.space)
        .map(|(a, p)| a.cells.div_ceil(*p) as u64)
        .product();
    let velocities = case.space.velocity_cells() as u64;
    let cells = space_block * velocities;
    let ghosts: u64 = (case.space.x.iter().zip(&mesh.space))
        .filter(|(_, p)| **p > 1)
        .map(|(a, p)| {
            let sides = if *p > 2 { 2 } else { 1 };
            sides * cells / a.cells.div_ceil(*p) as u64
        })
        .sum();
    // Inflow rows lie on the box's ends: half of each of the two x-ends of an axis.
    let inflow: u64 = if bounds.inflow {
        case.space
            .x
            .iter()
            .map(|a| cells / a.cells as u64)
            .sum::<u64>()
    } else {
        0
    };
    let rows = cells + inflow;
    let length = rows + ghosts;
    let force = u64::from(bounds.rate > transport_rate(&case.space));
    let entries = rows * (1 + 2 * n + 2 * n * force);
    let mut list = vec![
        ("program and libraries".to_owned(), PROGRAM_BYTES),
        ("matrix (S, K)".to_owned(), 20 * entries + 24 * rows),
        ("field, weights, probe".to_owned(), 8 * 6 * length),
    ];
    if let Some(warp) = warp {
        let bytes = Chebyshev::BYTES_PER_ROW as u64;
        list.push((format!("batch of {LANES} modes"), bytes * length));
        let points = warp.recovery.len() as u64;
        list.push(("recovery sums".to_owned(), (16 + 8) * points * cells));
        list.push(("ghost exchange".to_owned(), 2 * 128 * ghosts));
    } else {
        list.push(("integrator".to_owned(), 8 * 4 * length));
    }
    if case.exact.is_some() {
        let tracer = 80 * case.space.space_cells() as u64;
        list.push(("exact solution".to_owned(), 8 * cells + tracer));
    }
    list
}

/// Bytes for people.
pub fn bytes_text(bytes: u64) -> String {
    const UNITS: [&str; 5] = ["B", "KiB", "MiB", "GiB", "TiB"];
    let mut value = bytes as f64;
    let mut unit = 0;
    while value >= 1024.0 && unit + 1 < UNITS.len() {
        value /= 1024.0;
        unit += 1;
    }
    if unit == 0 {
        format!("{bytes} B")
    } else {
        format!("{value:.1} {}", UNITS[unit])
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
        let b = &self.bounds;
        let mut scene = vec![if b.jumps { "jumps" } else { "no jump" }];
        scene.push(if b.inflow { "inflow" } else { "no inflow" });
        if b.weighted {
            scene.push("dissipative weights");
        }
        writeln!(f, "scene           {}", scene.join(", "))?;
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
            writeln!(
                f,
                "profile         gaussian: sigma {:.4}, offset {:.4}, period {:.4}, cut-off {:.4}",
                w.profile.sigma, w.profile.offset, w.profile.period, w.profile.cutoff
            )?;
            writeln!(
                f,
                "modes           {} (l >= 0) in {} batches of at most {LANES}",
                w.modes,
                w.batches.len()
            )?;
            let least = w.batches.iter().map(|b| b.degree).min().unwrap_or(0);
            writeln!(f, "degree          {least} to {}", w.largest_degree())?;
            writeln!(f, "applications    {}", w.applications)?;
        } else {
            writeln!(
                f,
                "method          classical, {} steps",
                self.classical_steps
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
