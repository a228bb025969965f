//! How long a trial will take, from its plan and from the trials before it.
//!
//! ```text
//! seconds = overhead(grid) + rate · work · cells,     work: applications or solves over all modes and fields
//! ```
//!
//! The rate of a kind of work is that of the longest trial of it so far; the overhead (matrix, weights, plan, what the result is compared
//! with) goes with the cells.

use crate::case::{Case, Integrator, Limiter, Method, PropagatorMethod};
use crate::error::Result;
use crate::plan::{ASSUMED_RATIO, Bounds, Plan, WarpPlan, classical_steps};
use crate::propagate::unit;
use std::collections::BTreeMap;

/// Seconds an application takes a cell before anything is measured; on the slow side.
const RATE: f64 = 5e-9;
/// The same of the overhead.
const OVERHEAD: f64 = 3e-6;
/// Vectors that leave the cache may take so much longer than those the rate is from.
const COLDER: f64 = 2.0;

/// Work that goes at a rate of its own.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord)]
enum Kind {
    Steps,
    Slopes,
    Series,
    Lanczos,
    Solves,
}

impl Kind {
    fn of(case: &Case) -> Self {
        match (case.method, case.limiter, case.propagator.method) {
            (Method::Classical, Limiter::None, _) => Self::Steps,
            (Method::Classical, _, _) => Self::Slopes,
            (_, _, PropagatorMethod::Chebyshev) => Self::Series,
            (_, _, PropagatorMethod::Krylov) => Self::Lanczos,
            (_, _, PropagatorMethod::CrankNicolson | PropagatorMethod::BackwardEuler) => {
                Self::Solves
            }
        }
    }

    /// How many applications a unit of it is like, about.
    fn unit(self) -> f64 {
        match self {
            Self::Steps | Self::Series => 1.0,
            Self::Slopes => 8.0,
            Self::Lanczos => unit(PropagatorMethod::Krylov) as f64,
            Self::Solves => unit(PropagatorMethod::CrankNicolson) as f64,
        }
    }

    /// How a unit's time a cell grows with the cells, beside that on a small grid: that of sparse factors does.
    fn growth(self, cells: f64) -> f64 {
        match self {
            Self::Solves => (cells / 1024.0).sqrt(),
            _ => 1.0,
        }
    }
}

/// What is measured of a matrix and holds for every plan on it.
type Matrix = (Vec<usize>, String);

fn matrix(case: &Case) -> Matrix {
    let warp = (case.warp.weights, case.warp.inflow, case.warp.delta);
    (
        case.space.shape(),
        format!("{:?} {warp:?} {:?}", case.interface, case.warp.shift),
    )
}

/// A rate and where it is from.
#[derive(Clone, Copy, Debug)]
struct Rate {
    per_cell: f64,
    cells: f64,
    seconds: f64,
}

/// What the trials so far tell.
#[derive(Debug, Default)]
pub struct Forecast {
    rates: BTreeMap<Kind, Rate>,
    /// Seconds besides the work by method and cells: the least, as others on the machine only add to it.
    overheads: BTreeMap<(bool, usize), f64>,
    measured: BTreeMap<Matrix, (Bounds, f64)>,
}

impl Forecast {
    /// Applications or solves that `case` will take, from a plan of some of its modes; its error where it cannot be planned.
    ///
    /// # Errors
    /// As [`WarpPlan::forecast`].
    pub fn work(&self, case: &Case) -> Result<f64> {
        let (bounds, ratio) = match case.method {
            Method::Schrodingerized => self.bounds(case)?,
            Method::Classical => (Bounds::new(case)?, ASSUMED_RATIO),
        };
        match case.method {
            Method::Schrodingerized => WarpPlan::forecast(case, &bounds, ratio),
            Method::Classical => {
                let steps: usize = classical_steps(case, &bounds).iter().sum();
                Ok((stages(case) * steps * case.fields.len()) as f64)
            }
        }
    }

    /// Bounds and norms of the case's matrix: as measured, or with the growth that was measured on the grid nearest to it, which goes with
    /// the cells of an axis.
    fn bounds(&self, case: &Case) -> Result<(Bounds, f64)> {
        let wanted = matrix(case);
        if let Some((bounds, ratio)) = self.measured.get(&wanted) {
            return Ok((bounds.clone(), *ratio));
        }
        let found = Bounds::new(case)?;
        let count = |shape: &[usize]| shape.iter().product::<usize>();
        let cells = count(&wanted.0);
        let nearest = (self.measured.iter())
            .filter(|((_, what), _)| *what == wanted.1)
            .min_by_key(|((shape, _), _)| count(shape).abs_diff(cells));
        let Some(((shape, _), (known, ratio))) = nearest else {
            return Ok((found.expected(), ASSUMED_RATIO));
        };
        let finer = (cells as f64 / count(shape) as f64).powf(1.0 / shape.len() as f64);
        let growth = match found.growth.is_finite() {
            true => found.growth,
            false => known.growth.max(0.0) * finer.max(1.0),
        };
        let bounds = Bounds {
            growth,
            decay: 2.0 * found.rate + growth,
            stages: known.stages,
            ..found
        };
        Ok((bounds, *ratio))
    }

    /// Whether bounds and norms of the case's matrix were measured: its forecast is then the plan's.
    pub fn knows(&self, case: &Case) -> bool {
        case.method == Method::Classical || self.measured.contains_key(&matrix(case))
    }

    /// Seconds of `case` for so much work, comparisons included.
    pub fn seconds(&self, case: &Case, work: f64) -> f64 {
        let (kind, cells) = (Kind::of(case), case.space.cells() as f64);
        let known = self.rates.get(&kind).map(|rate| (kind, rate));
        let other = || (self.rates.iter().map(|(kind, rate)| (*kind, rate))).next_back();
        let rate = match known.or_else(other) {
            Some((of, rate)) => {
                let colder = if cells > 2.0 * rate.cells {
                    COLDER
                } else {
                    1.0
                };
                let larger = kind.growth(cells) / of.growth(rate.cells);
                rate.per_cell * kind.unit() / of.unit() * colder * larger
            }
            None => RATE * kind.unit(),
        };
        self.overhead(case) + rate * work * cells
    }

    /// Seconds besides the work.
    pub fn overhead(&self, case: &Case) -> f64 {
        let modes = case.method == Method::Schrodingerized;
        let cells = case.space.cells();
        let of = |modes: bool| {
            (self.overheads.iter())
                .filter(|((m, _), _)| *m == modes)
                .min_by_key(|((_, c), _)| c.abs_diff(cells))
        };
        match of(modes).or_else(|| of(!modes)) {
            Some(((_, known), seconds)) => {
                let larger = cells as f64 / *known as f64;
                // The steps of a comparison grow with the cells of an axis.
                let axes = case.space.shape().len() as f64;
                seconds * larger * larger.powf(1.0 / axes).max(1.0)
            }
            None => OVERHEAD * cells as f64,
        }
    }

    /// A trial of `case` with this plan took so many seconds to solve and in all.
    pub fn learn(&mut self, case: &Case, plan: &Plan, [solve, total]: [f64; 2]) {
        let cells = case.space.cells();
        let modes = case.method == Method::Schrodingerized;
        let work = match &plan.warp {
            Some(warp) => warp.applications + warp.solves,
            None => stages(case) * plan.classical_steps * plan.fields,
        };
        if work > 0 && solve > 0.0 {
            let rate = Rate {
                per_cell: solve / (work * cells) as f64,
                cells: cells as f64,
                seconds: solve,
            };
            let known = self.rates.entry(Kind::of(case)).or_insert(rate);
            if rate.seconds >= known.seconds {
                *known = rate;
            }
        }
        let besides = (total - solve).max(0.0);
        let least = (self.overheads).entry((modes, cells)).or_insert(besides);
        *least = least.min(besides);
        if let Some(warp) = &plan.warp {
            (self.measured).insert(matrix(case), (plan.bounds.clone(), warp.ratio));
        }
    }
}

/// Applications of a step.
fn stages(case: &Case) -> usize {
    match case.integrator {
        Integrator::SspRk3 => 3,
        Integrator::ForwardEuler | Integrator::Exponential => 1,
    }
}
