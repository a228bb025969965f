//! The error of `f` where jumps of `V` reflect in part, by random paths.
//!
//! Behind such a jump `f` is a mixture, so that a point has no single characteristic. `f(T, z)` is
//! the mean of the data at the ends of random paths back from `z`: each turns back at a jump with
//! the reflected part as its probability. At random points `z` of the box, with the data `a` and
//! `b` at the ends of any two of [`PATHS`] independent paths,
//!
//! ```text
//! (f_h(z) − a)(f_h(z) − b)   has the mean ∫ (f_h − f)² / volume
//! a b                        has the mean ∫ f² / volume
//! ```
//!
//! with `f_h` as in [`point_values`](crate::run::particles::point_values).
//!
//! The numbers of a sample depend on its own number alone, and the sums are exact: the bits do not
//! depend on the number of ranks.
//!
//! Uses: the tracer, the sums of the ledger's particles.

use crate::base::error::Result;
use crate::parallel::communicator::Group;
use crate::problem::case::Case;
use crate::problem::exact::{CellLimits, Crossing, Foot, MOST_EXAMINED, Tracer};
use crate::results::accuracy::ErrorsByParticles;
use crate::run::errors::ResultOnShare;
use crate::run::particles::arrivals::ShownError;
use crate::run::particles::draw::REPLICATES;
use crate::run::particles::point_values::{is_mixed, most_values, values_at};
use crate::run::particles::tracking::is_reflected;
use rand_chacha::ChaCha8Rng;
use rand_chacha::rand_core::SeedableRng;

/// Paths from a point. Their own scatter falls faster with them than with the number of points.
const PATHS: usize = 8;
/// Least and largest number of samples, each of a point and its paths.
const LEAST_SAMPLES: usize = 1 << 9;
const MOST_SAMPLES: usize = 1 << 15;
/// About the largest number of steps of all paths.
const MOST_STEPS: f64 = 33_554_432.0;
/// Part by which an error may change on half the cells in which `V` is approximated.
const SAME: f64 = 0.1;
/// The stream of the random numbers of a sample. The points of the ledger's particles are of stream
/// 0, their reflections of [`tracking::STREAM`](crate::run::particles::tracking::STREAM).
const STREAM: u64 = 2;

/// The relative L2 error of `f` in `result`, of a case with partial reflection whose data at time 0
/// are a formula. None on very fine grids of space, where paths take very many steps. Where `V` is
/// approximated, it must be the same on half the cells, so that it is not the error of tracing.
/// Collective.
///
/// # Errors
/// If `V` is not finite.
pub fn errors(result: &ResultOnShare<'_>) -> Result<ErrorsByParticles> {
    let ResultOnShare { world, case, .. } = *result;
    let space = &case.space;
    if space.space_cells() > MOST_EXAMINED {
        return Ok(ErrorsByParticles::default());
    }
    let tracer = Tracer::with_cells(case, CellLimits::ESTIMATES)?;
    let most_steps = if tracer.is_approximate { MOST_STEPS / 16.0 } else { MOST_STEPS };
    // Processors of different kinds may take different numbers of steps.
    let steps = world.max(tracer.mean_steps(case.end));
    let most = (most_steps / (PATHS as f64 * steps)) as usize;
    let many = most.min(most_values(space)).min(MOST_SAMPLES) / REPLICATES;
    if many * REPLICATES < LEAST_SAMPLES {
        return Ok(ErrorsByParticles::default());
    }
    let points = space.random_points(many * REPLICATES);
    let samples = Samples { world, case, found: values_at(result, &points), points };
    let mut shown = samples.error(&tracer);
    if tracer.is_approximate {
        let by_coarser = match tracer.halved().filter(|_| tracer.is_accurate) {
            Some(halved) => samples.error(&Tracer::with_cells(case, halved.most)?),
            None => None,
        };
        let is_same = |error: &ShownError| {
            by_coarser.is_some_and(|by| (by.rough - error.rough).abs() <= SAME * error.rough)
        };
        shown = shown.filter(is_same);
    }
    Ok(ErrorsByParticles {
        field: shown.map(|shown| shown.least),
        field_mean: shown.and_then(|shown| shown.mean()).filter(|_| !is_mixed(space)),
        density_smeared: shown.and_then(|shown| shown.smeared(space)).filter(|_| !is_mixed(space)),
        ..ErrorsByParticles::default()
    })
}

/// Random points, as many for each replicate.
struct Samples<'a> {
    world: &'a Group,
    case: &'a Case,
    points: Vec<[f64; 6]>,
    /// `f_h` at the points.
    found: Vec<f64>,
}

impl Samples<'_> {
    /// The error of `f_h` by random paths of `tracer`. Collective.
    fn error(&self, tracer: &Tracer<'_>) -> Option<ShownError> {
        let Self { world, case, points, found } = self;
        let many = points.len() / REPLICATES;
        let mine = (world.rank()..points.len()).step_by(world.size());
        let term = |k: usize| {
            let mut random = ChaCha8Rng::seed_from_u64(k as u64);
            random.set_stream(STREAM);
            let feet: [Foot; PATHS] = std::array::from_fn(|_| {
                let mut turns_back = |met: &Crossing| is_reflected(case, met, &mut random);
                tracer.foot_by(&points[k], case.end, &mut turns_back)
            });
            let ends = tracer.values_at(&feet);
            let errors: Vec<f64> = ends.iter().map(|end| found[k] - end).collect();
            [mean_of_pairs(&errors), mean_of_pairs(&ends)]
        };
        let terms: Vec<[f64; 2]> = mine.clone().map(term).collect();
        // Two sums for each replicate; a sample belongs to one.
        let lanes = mine.zip(&terms).map(|(k, [error, size])| {
            let mut lanes = [0.0; 2 * REPLICATES];
            (lanes[k / many], lanes[REPLICATES + k / many]) = (*error, *size);
            lanes
        });
        let sums = world.sum_lanes(points.len(), lanes);
        let (errors, sizes) = sums.split_at(REPLICATES);
        ShownError::of(errors, sizes)
    }
}

/// The mean of the products of any two of the `values`.
fn mean_of_pairs(values: &[f64]) -> f64 {
    let count = values.len() as f64;
    let sum: f64 = values.iter().sum();
    let squares: f64 = values.iter().map(|x| x * x).sum();
    (sum * sum - squares) / (count * (count - 1.0))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn pairs_are_of_different_values() {
        let values: [f64; PATHS] = std::array::from_fn(|k| (k * k) as f64 - 7.0);
        let pairs =
            (0..PATHS).flat_map(|i| (0..PATHS).filter(move |j| *j != i).map(move |j| [i, j]));
        let products: Vec<f64> = pairs.map(|[i, j]| values[i] * values[j]).collect();
        let mean = products.iter().sum::<f64>() / products.len() as f64;
        assert!((mean_of_pairs(&values) - mean).abs() < 1e-12 * mean.abs());
    }
}
