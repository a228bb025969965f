//! How long a trial will take, from its plan and from the trials before it.
//!
//! ```text
//! seconds = a + b · cells + rate · work · cells,     work: applications or solves over all modes and fields
//! ```
//!
//! The rate of a kind of work is that of the longest trial of it so far; the overhead `a + b · cells` (matrix, weights, plan, what the result is
//! compared with) is from the quickest trials of the coarsest and of the finest grid.

use crate::base::error::Result;
use crate::matrix::bounds::Bounds;
use crate::plan::{ASSUMED_RATIO, Plan};
use crate::problem::case::{Case, Integrator, Limiter, Method, PropagatorMethod};
use crate::propagate::classical::classical_steps;
use crate::propagate::descriptor;
use crate::schrodingerization::warp_plan::WarpPlan;
use std::collections::BTreeMap;

/// Seconds an application takes a cell before anything is measured; on the slow side.
const RATE: f64 = 5e-9;
/// The same of the overhead.
const OVERHEAD: f64 = 3e-6;
/// Vectors that leave the cache may take so much longer than those the rate is from.
const COLDER: f64 = 2.0;
/// So many seconds of a trial may be starting up, whatever the cells, while only one grid was tried.
const STARTING: f64 = 0.2;

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
        let applications = |method| descriptor(method).applications_per_work() as f64;
        match self {
            Self::Steps | Self::Series => 1.0,
            Self::Slopes => 8.0,
            Self::Lanczos => applications(PropagatorMethod::Krylov),
            Self::Solves => applications(PropagatorMethod::CrankNicolson),
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
    /// Seconds besides the work: whether by modes and whether compared with the semi-discrete solution, then by cells the least.
    overheads: BTreeMap<(bool, bool), BTreeMap<usize, f64>>,
    /// Bounds before anything is measured, of matrices by modes and of others.
    bare: BTreeMap<(Matrix, bool), Bounds>,
    measured: BTreeMap<Matrix, (Bounds, f64)>,
}

impl Forecast {
    /// Applications or solves that `case` will take, from a plan of some of its modes; its error where it cannot be planned.
    ///
    /// # Errors
    /// As [`WarpPlan::forecast`].
    pub fn work(&mut self, case: &Case) -> Result<f64> {
        let (bounds, ratio) = match case.method {
            Method::Schrodingerized => self.bounds(case)?,
            Method::Classical => (self.bare(case)?, ASSUMED_RATIO),
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
    fn bounds(&mut self, case: &Case) -> Result<(Bounds, f64)> {
        let wanted = matrix(case);
        if let Some((bounds, ratio)) = self.measured.get(&wanted) {
            return Ok((bounds.clone(), *ratio));
        }
        let found = self.bare(case)?;
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

    /// Bounds of the case's matrix without a measurement; found once a matrix.
    fn bare(&mut self, case: &Case) -> Result<Bounds> {
        let key = (matrix(case), case.method == Method::Schrodingerized);
        if let Some(known) = self.bare.get(&key) {
            return Ok(known.clone());
        }
        let found = Bounds::new(case)?;
        self.bare.insert(key, found.clone());
        Ok(found)
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
        self.overhead(case, cells) + rate * work * cells
    }

    /// Seconds besides the work, on so many cells.
    pub fn overhead(&self, case: &Case, cells: f64) -> f64 {
        let modes = case.method == Method::Schrodingerized;
        let alike = |of: &(bool, bool)| (of.0 != modes, of.1 != case.verify);
        let nearest = self.overheads.iter().min_by_key(|(of, _)| alike(of));
        nearest.map_or(OVERHEAD * cells, |(_, known)| {
            overhead(known, cells, case.space.shape().len())
        })
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
        let overhead = (total - solve).max(0.0);
        let known = self.overheads.entry((modes, case.verify)).or_default();
        let least = known.entry(cells).or_insert(overhead);
        *least = least.min(overhead);
        if let Some(warp) = &plan.warp {
            (self.measured).insert(matrix(case), (plan.bounds.clone(), warp.ratio));
        }
    }
}

/// `a + b · cells` through the seconds known of the fewest and of the most cells; grows with the cells, at least by [`OVERHEAD`] a cell where
/// that is not more than what is known. Beyond them the steps of a comparison grow with the cells of an axis.
fn overhead(known: &BTreeMap<usize, f64>, cells: f64, axes: usize) -> f64 {
    let ends = known.iter().next().zip(known.iter().next_back());
    let Some(((&few, &little), (&many, &much))) = ends else {
        return OVERHEAD * cells;
    };
    let (few, many) = (few as f64, many as f64);
    let fixed = match many > few {
        true => little - (much - little) / (many - few) * few,
        false => (little - OVERHEAD * few).min(STARTING),
    };
    let fixed = fixed.clamp(0.0, little.min(much));
    let each = ((much - fixed) / many).max(OVERHEAD.min(much / many));
    let longer = (cells / many).powf(1.0 / axes.max(1) as f64).max(1.0);
    fixed + each * cells * longer
}

/// Applications of a step.
fn stages(case: &Case) -> usize {
    match case.integrator {
        Integrator::SspRk3 => 3,
        Integrator::ForwardEuler | Integrator::Exponential => 1,
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn overheads_grow_with_the_cells_and_starting_up_does_not() {
        // A slow start on 16 x 16 says little about 64 x 64.
        let noisy = BTreeMap::from([(256, 0.13)]);
        let found = overhead(&noisy, 4096.0, 2);
        assert!((0.13..0.3).contains(&found), "{found}");
        // Two grids give both parts back.
        let both = BTreeMap::from([(100, 0.05 + 100.0 * 1e-4), (400, 0.05 + 400.0 * 1e-4)]);
        assert!((overhead(&both, 200.0, 2) - 0.07).abs() < 1e-12);
        for known in [noisy, both, BTreeMap::from([(100, 0.4), (400, 0.1)])] {
            let all = [100.0, 400.0, 1600.0, 6400.0].map(|cells| overhead(&known, cells, 2));
            assert!(all.windows(2).all(|two| two[0] < two[1]), "{all:?}");
        }
    }
}
