//! The plan: every number derived from a case and a number of ranks, before memory is allocated or
//! the case is solved.
//!
//! A [`Plan`] is data: printed by `phasewarp plan`, stored in every result, tested without MPI. It
//! has two parts: the work ([`WarpPlan`], the same for any ranks) and its distribution over the
//! ranks ([`Layout`]).
//!
//! **Tolerance.** The error of the recovered field is at most about `ε‖ũ(0)‖`, with `ũ(0)` the
//! weighted state and its auxiliary unknowns; the tolerance is relative to `‖f(T)‖`. So the profile
//! is planned for `ε = tolerance · ‖f(T)‖/‖ũ(0)‖`. The ratio is measured by a cheap probe when
//! running (see [`crate::run`]); the plan alone assumes [`ASSUMED_RATIO`].
//!
//! Uses: schrodingerization, propagate, matrix, scheme, parallel, problem, base. Paper: sections
//! 3.1 (interval and points in `p`) and 3.2 (cost).

pub mod balance;
pub mod here;
pub mod job_request;
pub mod layout;
pub mod memory;

use crate::base::error::{Error, Result};
use crate::base::memory::NamedBytes;
use crate::base::text::{bytes_text, counted, joined, rounded, short};
use crate::matrix::bounds::{Bounds, LONGEST_SPAN};
use crate::matrix::lanes::LANES;
use crate::parallel::partition::ProcessMesh;
use crate::plan::balance::{Batch, share_out};
use crate::plan::layout::{Layout, Resources, refuse_too_large};
use crate::plan::memory::PlannedWork;
use crate::problem::case::{Case, Integrator, Interface, Limiter, Method, Propagation};
use crate::propagate;
use crate::propagate::classical::classical_steps;
use crate::propagate::descriptor;
use crate::propagate::inflow_panels::{InflowPanels, MOST};
use crate::propagate::method::{PropagatorSetting, RunWork};
use crate::scheme::rows::transport_rate;
use crate::schrodingerization::profile::Profile;
use crate::schrodingerization::profile::series::Series;
use crate::schrodingerization::recovery::Reading;
use crate::schrodingerization::warp_plan::{WarpPlan, refuse_too_long};
use serde::Serialize;
use std::collections::BTreeSet;
use std::fmt;

/// The ratio `‖ũ(0)‖/‖f(T)‖` that is assumed until it is measured.
pub const ASSUMED_RATIO: f64 = 1.5;

/// A run that is assembled on one process mesh is assembled again on another if that is at least
/// this many times as fast by the model.
pub const WORTH_REASSEMBLY: f64 = 1.06;

/// Every derived number of a run.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct Plan {
    /// Title of the case.
    pub title: String,
    /// Cells along each axis, `(x1..xn, v1..vn)`.
    pub shape: Vec<usize>,
    /// Unknowns.
    pub cells: usize,
    /// Elements along each axis; of degree 0 these are the cells.
    pub elements: Vec<usize>,
    /// The reductions of the case, one line each.
    pub reductions: Vec<String>,
    /// Final time.
    pub time: f64,
    /// The method that computes `f(T)`.
    pub method: Method,
    /// Interface law.
    pub interface: Interface,
    /// Slopes of the classical method.
    pub limiter: Limiter,
    /// The propagator, and its step (for an implicit method, the step that is used).
    pub propagation: Propagation,
    /// Steps of an implicit method.
    pub steps: usize,
    /// Number of fields evolved.
    pub fields: usize,
    /// The requested tolerance.
    pub tolerance: f64,
    /// Bounds on the generator.
    pub bounds: Bounds,
    /// The Schrödingerized part, unless the method is classical.
    pub warp: Option<WarpPlan>,
    /// Steps (or terms of the exponential) of the classical method; 0 by modes with an inflow that
    /// depends on time.
    pub classical_steps: usize,
    /// Ranks and memory; not a part of the plan as results store it.
    #[serde(skip)]
    pub layout: Layout,
}

/// The plan by which a case is assembled, before its growth and norms are measured.
#[derive(Clone, Debug)]
pub struct ProvisionalPlan {
    /// Bounds on the generator, without the measured growth.
    pub bounds: Bounds,
    /// The provisional plan; see [`Plan::provisional`].
    pub plan: Plan,
}

impl ProvisionalPlan {
    /// The provisional plan of `case` on `resources`.
    ///
    /// # Errors
    /// As [`bounds_if_it_fits`] and [`Plan::provisional`].
    pub fn new(case: &Case, resources: &Resources) -> Result<Self> {
        let bounds = bounds_if_it_fits(case, resources)?;
        let plan = Plan::provisional(case, &bounds, resources)?;
        Ok(Self { bounds, plan })
    }
}

/// Bounds on the generator of a case that may fit into `resources`.
///
/// # Errors
/// Before `V` is evaluated: [`Error::Memory`] if no layout fits, [`Error::TooLong`] if transport
/// alone makes the run too long; as [`Bounds::new`].
pub fn bounds_if_it_fits(case: &Case, resources: &Resources) -> Result<Bounds> {
    refuse_too_large(case, resources)?;
    refuse_long_transport(case)?;
    Bounds::new(case)
}

/// Refuses a run by modes that is too long whatever `V` is. The rate of elements is not known
/// without `V`.
///
/// # Errors
/// [`Error::TooLong`].
pub fn refuse_long_transport(case: &Case) -> Result<()> {
    match case.method {
        Method::Schrodingerized if !case.is_galerkin() => {
            refuse_too_long(case, transport_rate(&case.space))
        }
        _ => Ok(()),
    }
}

/// Refuses an inflow that varies too fast in time to be integrated, if the run needs its integral:
/// by the classical exponential, or for `solver.verify`.
///
/// # Errors
/// [`Error::Input`].
fn refuse_fast_inflow(case: &Case) -> Result<()> {
    let is_classical = case.method == Method::Classical;
    let needed = if is_classical {
        case.classical.integrator == Integrator::Exponential
    } else {
        case.verify
    };
    if !case.varies() || !needed {
        return Ok(());
    }
    let Some(from) = InflowPanels::new(case, f64::INFINITY).unresolved_from else { return Ok(()) };
    let instead = if is_classical {
        "solver.classical.integrator = \"ssp-rk3\" takes steps instead"
    } else {
        "without solver.verify it is not needed"
    };
    Err(Error::Input(format!(
        "{}: {}: its integral over time takes more than {MOST} panels, as it varies too fast from \
         t = {} on; {instead}",
        case.name,
        case.fields[0].entering().place(),
        short(case.start_time + from)
    )))
}

impl Plan {
    /// The setting of the propagator for the series `warp`.
    pub fn propagator_setting(&self, warp: &WarpPlan) -> PropagatorSetting {
        let applications = self.layout.groups.iter().map(|group| balance::applications(group));
        let fewest = applications.filter(|count| *count > 0).min();
        PropagatorSetting {
            propagation: self.propagation,
            largest_work: warp.largest_work(),
            applications: self.fields * fewest.unwrap_or(0),
            split: self.layout.mesh.blocks() > 1,
        }
    }

    /// Plans `case` for `resources`, `ratio` being `‖ũ(0)‖/‖f(T)‖`.
    ///
    /// # Errors
    /// A tolerance that cannot be met, a mesh that does not fit, too little memory.
    pub fn new(case: &Case, resources: &Resources, ratio: f64) -> Result<Self> {
        let bounds = Bounds::new(case)?;
        Self::with_bounds(case, bounds, resources, ratio)
    }

    /// Plans `case` as [`new`](Self::new) does, with known bounds.
    ///
    /// # Errors
    /// As [`new`](Self::new).
    pub fn with_bounds(
        case: &Case,
        bounds: Bounds,
        resources: &Resources,
        ratio: f64,
    ) -> Result<Self> {
        refuse_fast_inflow(case)?;
        let warp = match case.method {
            Method::Schrodingerized => Some(WarpPlan::new(case, &bounds, ratio)?),
            Method::Classical => {
                let (rate, span) = (bounds.rate, bounds.rate * case.duration());
                let (end, limit) = (case.end, LONGEST_SPAN * LONGEST_SPAN);
                if span > limit {
                    return Err(Error::TooLong {
                        end,
                        rate,
                        quantity: "that rate is",
                        span,
                        limit,
                    });
                }
                None
            }
        };
        let (mut steps, mut longest) = (0, 0.0f64);
        for leg in case.legs() {
            let of_leg = propagate::steps(&case.propagator, leg);
            longest = longest.max(leg / of_leg as f64);
            steps += of_leg;
        }
        let work = PlannedWork { case, bounds: &bounds, warp: warp.as_ref() };
        let layout = Layout::new(work, resources)?;
        Ok(Self {
            title: case.title.clone(),
            shape: case.space.shape(),
            cells: case.space.cells(),
            elements: case.space.elements(),
            reductions: case.reductions.dropped.clone(),
            time: case.duration(),
            method: case.method,
            interface: case.scheme.interface,
            propagation: match steps {
                0 => case.propagator,
                _ => Propagation { step: Some(longest), ..case.propagator },
            },
            steps,
            limiter: case.scheme.limiter,
            fields: case.fields.len(),
            tolerance: case.tolerance,
            classical_steps: match case.method {
                // Panels for the inflow take a while, and modes do not need them.
                Method::Schrodingerized if case.varies() => 0,
                _ => classical_steps(case, &bounds).iter().sum(),
            },
            bounds,
            warp,
            layout,
        })
    }

    /// The batches of mode group `group` that are left of a stage, when its modes `finished` are
    /// done. Modes that are kept stay with their group.
    pub fn batches_left(&self, finished: &BTreeSet<usize>, group: usize) -> Vec<Batch> {
        let Some(warp) = &self.warp else {
            return Vec::new();
        };
        let coupling = descriptor(self.propagation.method).batch_coupling();
        let groups = self.layout.mesh.groups;
        if warp.points.is_none() {
            return share_out(&warp.work, finished, coupling, groups).swap_remove(group);
        }
        let mut others = finished.clone();
        let kept = self.layout.modes();
        others.extend((0..groups).filter(|&g| g != group).flat_map(|g| &kept[g]));
        share_out(&warp.work, &others, coupling, 1).swap_remove(0)
    }

    /// The plan before growth and norms are measured: the layout and an estimate of the work. It
    /// does not yet refuse a tolerance that is too small or an interval that is too short.
    ///
    /// # Errors
    /// As [`new`](Self::new), but for the tolerance.
    pub fn provisional(case: &Case, bounds: &Bounds, resources: &Resources) -> Result<Self> {
        /// A tolerance that can be reached with the largest growth that weights and inflow may
        /// have.
        const POSSIBLE: f64 = 1e-12;
        let mut case = case.clone();
        case.tolerance = case.tolerance.max(POSSIBLE);
        if case.warped_start.is_none() {
            case.warp.interval = None;
        }
        Self::with_bounds(&case, bounds.expected(), resources, 1.0)
    }

    /// This plan, made by [`provisional`](Self::provisional), with the measured growth and `ratio`.
    /// It keeps the process mesh, on which the run is assembled, unless another one is faster by
    /// [`WORTH_REASSEMBLY`].
    ///
    /// # Errors
    /// As [`new`](Self::new).
    pub fn measured(
        &self,
        case: &Case,
        bounds: Bounds,
        resources: &Resources,
        ratio: f64,
    ) -> Result<Self> {
        let free = Self::with_bounds(case, bounds, resources, ratio)?;
        Ok(free.near(case, resources, &self.layout.mesh))
    }

    /// This plan on `mesh`, unless it does not fit there or takes more than [`WORTH_REASSEMBLY`]
    /// times as long.
    pub fn near(self, case: &Case, resources: &Resources, mesh: &ProcessMesh) -> Self {
        if self.layout.mesh == *mesh {
            return self;
        }
        let cost = |plan: &Self| plan.layout.cost(plan.work(case));
        match self.on(case, &resources.on_mesh(mesh)) {
            Ok(there) if cost(&there) <= WORTH_REASSEMBLY * cost(&self) => there,
            _ => self,
        }
    }

    /// The work of `case`, for which this plan was made.
    pub fn work<'a>(&'a self, case: &'a Case) -> PlannedWork<'a> {
        PlannedWork { case, bounds: &self.bounds, warp: self.warp.as_ref() }
    }

    /// This plan on other `resources`: the same modes, distributed again.
    ///
    /// # Errors
    /// [`Error::Ranks`] and [`Error::Memory`].
    pub fn on(&self, case: &Case, resources: &Resources) -> Result<Self> {
        let layout = Layout::new(self.work(case), resources)?;
        Ok(Self { layout, ..self.clone() })
    }

    /// This plan with the modes of `series` instead of its own, each to `tolerance` relative to its
    /// norm. `readings` are the recoveries, and need not be accurate.
    ///
    /// # Errors
    /// [`Error::Ranks`] and [`Error::Memory`].
    pub fn with_series(
        &self,
        case: &Case,
        series: Series,
        readings: Vec<Reading>,
        tolerance: f64,
        resources: &Resources,
    ) -> Result<Self> {
        let warp = WarpPlan::of_series(case, &self.bounds, series, readings, tolerance);
        Ok(Self {
            layout: Layout::new(PlannedWork { warp: Some(&warp), ..self.work(case) }, resources)?,
            warp: Some(warp),
            ..self.clone()
        })
    }

    /// `96 cells`, `864 unknowns on 8 x 12 elements`.
    pub fn grid_size(&self) -> String {
        if self.elements == self.shape {
            counted(self.cells, "cell", "cells")
        } else {
            format!("{} unknowns on {} elements", self.cells, joined(&self.elements, " x "))
        }
    }

    /// Planned bytes on the fullest rank.
    pub fn memory(&self) -> u64 {
        self.layout.memory()
    }

    fn propagator_text(&self, warp: &WarpPlan) -> String {
        let work = RunWork {
            least: warp.least_work(),
            most: warp.largest_work(),
            step: self.propagation.step,
            steps: self.steps,
            time: self.time,
        };
        descriptor(self.propagation.method).summary(&work)
    }

    /// Largest number of Jacobi sweeps for better weights. A sweep takes about as long as two
    /// applications, and all sweeps should take only a few hundredths of the run.
    pub fn max_weight_sweeps(&self) -> usize {
        self.warp.as_ref().map_or(0, |w| {
            let unit = descriptor(self.propagation.method).applications_per_work();
            ((w.applications + w.solves) * unit / 50).max(16)
        })
    }
}

impl fmt::Display for Plan {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        self.write_scene(f)?;
        match &self.warp {
            Some(warp) => self.write_modes(f, warp)?,
            None => self.write_classical(f)?,
        }
        self.write_ranks(f)
    }
}

impl Plan {
    /// The grid, and what its matrix contains.
    fn write_scene(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        writeln!(f, "grid            {} = {}", joined(&self.shape, " x "), self.grid_size())?;
        for line in &self.reductions {
            writeln!(f, "reduced         {line}")?;
        }
        let b = &self.bounds;
        let jumps = if b.jumps { "jumps" } else { "no jump" };
        let inflow = if b.inflow { "inflow" } else { "no inflow" };
        let weights = if b.weighted { ", dissipative weights" } else { "" };
        writeln!(f, "scene           {jumps}, {inflow}{weights}")?;
        if b.stages > 0 {
            writeln!(f, "time            {} steps of two exponentials", b.stages / 2)?;
        }
        Ok(())
    }

    /// The modes, their profile and their work.
    fn write_modes(&self, f: &mut fmt::Formatter<'_>, w: &WarpPlan) -> fmt::Result {
        writeln!(
            f,
            "spectrum of S   [-{}, {}] guaranteed, time {}",
            short(self.bounds.decay),
            short(rounded(self.bounds.growth, self.bounds.decay)),
            short(self.time)
        )?;
        writeln!(f, "tolerance       {:e} (state {:.2e})", self.tolerance, w.state_tolerance)?;
        let file = || "that of initial.warped".to_owned();
        let profile = w.profile.as_ref().map_or_else(file, Profile::to_string);
        writeln!(
            f,
            "profile         {}: period {}, cut-off {}, read at {}",
            profile,
            short(w.series.period),
            short(w.series.wavenumber(w.series.modes() - 1)),
            short(rounded(w.readings[0].point, 1.0))
        )?;
        writeln!(
            f,
            "modes           {} ({}) in {} of at most {LANES}",
            w.modes,
            if w.modes > w.series.modes() { "l of both signs" } else { "l >= 0" },
            counted(self.layout.groups.iter().map(Vec::len).sum(), "batch", "batches")
        )?;
        if let Some(points) = w.points {
            writeln!(f, "kept            all of them: w(T, x, v, p) at {points} points in p")?;
        }
        writeln!(f, "propagator      {}", self.propagator_text(w))?;
        let passed: usize = w.legs.iter().map(|leg| leg.passed.len()).sum();
        if passed > 0 {
            writeln!(f, "moments         at {passed} times from series that go past them")?;
        }
        match w.solves {
            0 => writeln!(f, "applications    {}", w.applications)?,
            solves => writeln!(f, "solves          {solves}")?,
        }
        for warning in &w.warnings {
            writeln!(f, "warning         {warning}")?;
        }
        Ok(())
    }

    /// The steps of the classical method.
    fn write_classical(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        writeln!(
            f,
            "method          classical, {} steps{}",
            self.classical_steps,
            match self.limiter {
                Limiter::None => "",
                Limiter::Minmod => ", minmod slopes",
                Limiter::VanLeer => ", van Leer slopes",
            }
        )
    }

    /// How the work is divided among the ranks, and the memory it takes.
    fn write_ranks(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let l = &self.layout;
        writeln!(
            f,
            "ranks           {} = {} ({}) x {}, imbalance {:.3}",
            l.mesh.ranks(),
            counted(l.mesh.blocks(), "space block", "space blocks"),
            joined(&l.mesh.space, " x "),
            counted(l.mesh.groups, "mode group", "mode groups"),
            l.imbalance
        )?;
        if l.mesh.blocks() == 1 && l.mesh.groups > 1 && self.warp.is_some() {
            writeln!(f, "                space is not split: there are modes for all ranks")?;
        }
        let idle = l.groups.iter().filter(|g| g.is_empty()).count();
        if idle > 0 && (self.warp.is_some() || idle < l.groups.len()) {
            let groups = counted(idle, "mode group has", "mode groups have");
            writeln!(f, "                {groups} nothing to do")?;
        }
        writeln!(f, "memory a rank   {}", bytes_text(self.memory()))?;
        for NamedBytes { name, bytes } in &l.arrays {
            writeln!(f, "  {:<24}{:>12}", name, bytes_text(*bytes))?;
        }
        Ok(())
    }
}
