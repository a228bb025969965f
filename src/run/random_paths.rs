//! The error of `f` where jumps of `V` reflect in part, by random paths.
//!
//! Behind such a jump `f` is a mixture, so that a point has no single characteristic. `f(T, z)` is
//! the mean of the data at the ends of random paths back from `z`: each turns back at a jump with
//! the reflected part as its probability. At nodes `z_k` of the grid, with volumes `w_k` and the
//! data `a` and `b` at the ends of any two of [`PATHS`] independent paths,
//!
//! ```text
//! Σ w_k (f_h(z_k) − a)(f_h(z_k) − b)   has the mean Σ w_k (f_h(z_k) − f(T, z_k))²
//! Σ w_k a b                            has the mean Σ w_k f(T, z_k)²
//! ```
//!
//! The numbers of a sample depend on its own number alone, and the sums are exact: the bits do not
//! depend on the number of ranks.
//!
//! Uses: the tracer, the sums of the ledger's particles.

use crate::base::error::Result;
use crate::base::random::evenly_spread;
use crate::base::row_major;
use crate::matrix::observables::CellVolumes;
use crate::parallel::communicator::Group;
use crate::problem::exact::{MOST_EXAMINED, MostCells, Tracer};
use crate::results::accuracy::ParticleErrors;
use crate::run::ledger::arrivals::{ComparedResult, beyond_scatter};
use crate::run::ledger::draw::REPLICATES;
use crate::run::ledger::tracking::is_reflected;
use rand_chacha::ChaCha8Rng;
use rand_chacha::rand_core::SeedableRng;

/// Paths from a node. Their own scatter falls faster with them than with the number of nodes.
const PATHS: usize = 8;
/// Least and largest number of samples, each of a node and its paths.
const LEAST_SAMPLES: usize = 1 << 9;
const MOST_SAMPLES: usize = 1 << 13;
/// Largest sum over all paths of the bound on the faces that each meets. They meet a sixteenth of
/// it or fewer.
const MOST_FACES: usize = 1 << 32;
/// The stream of the random numbers of a sample. The points of the ledger's particles are of stream
/// 0, their reflections of [`tracking::STREAM`](crate::run::ledger::tracking::STREAM).
const STREAM: u64 = 2;

/// The relative L2 error of `f` in `result`, of a case with partial reflection that starts from a
/// formula at time 0. None on very fine grids of space, after very long times, and where `V` is
/// approximated: the error of tracing is not known there. Collective.
///
/// # Errors
/// If `V` is not finite.
pub fn errors(world: &Group, result: &ComparedResult<'_>) -> Result<ParticleErrors> {
    let case = result.case;
    if case.space.space_cells() > MOST_EXAMINED {
        return Ok(ParticleErrors::default());
    }
    let tracer = Tracer::with_cells(case, MostCells::ESTIMATES)?;
    let samples = MOST_SAMPLES.min(MOST_FACES / (PATHS * tracer.most_faces(case.end)));
    if tracer.is_approximate || samples < LEAST_SAMPLES {
        return Ok(ParticleErrors::default());
    }
    let volumes = CellVolumes::new(&case.space, result.share);
    let terms = (0..samples).filter_map(|k| sample(&tracer, result, &volumes, k));
    let terms: Vec<[f64; 2 * REPLICATES]> = terms.collect();
    let sums = world.sum_lanes(samples, terms.iter().copied());
    let (errors, sizes) = sums.split_at(REPLICATES);
    let [field, field_mean] = beyond_scatter(errors, sizes);
    Ok(ParticleErrors { field, field_mean, ..ParticleErrors::default() })
}

/// What sample `k` adds to the square of the error and to that of `f`, by replicate; `None` if its
/// node is on another rank.
fn sample(
    tracer: &Tracer<'_>,
    result: &ComparedResult<'_>,
    volumes: &CellVolumes,
    k: usize,
) -> Option<[f64; 2 * REPLICATES]> {
    let (case, space) = (result.case, &result.case.space);
    let cell = space.cell((evenly_spread(k) * space.cells() as f64) as usize);
    let (n, velocities) = (space.dimension(), space.velocity_cells());
    let place = row_major::position(result.share, &cell[..n])?;
    let velocity = row_major::position(&space.velocity_ranges(), &cell[n..2 * n])?;
    let at = place * velocities + velocity;
    let mut random = ChaCha8Rng::seed_from_u64(k as u64);
    random.set_stream(STREAM);
    let point = space.point_in_element(&cell);
    let ends: [f64; PATHS] = std::array::from_fn(|_| {
        tracer.value_by(&point, case.end, &mut |met| is_reflected(case, met, &mut random))
    });
    let weight = volumes.relative(at);
    let mut terms = [0.0; 2 * REPLICATES];
    terms[k % REPLICATES] = weight * mean_of_pairs(ends.map(|end| result.field[at] - end));
    terms[REPLICATES + k % REPLICATES] = weight * mean_of_pairs(ends);
    Some(terms)
}

/// The mean of the products of any two of the `values`.
fn mean_of_pairs(values: [f64; PATHS]) -> f64 {
    let sum: f64 = values.iter().sum();
    let squares: f64 = values.iter().map(|x| x * x).sum();
    (sum * sum - squares) / (PATHS * (PATHS - 1)) as f64
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
        assert!((mean_of_pairs(values) - mean).abs() < 1e-12 * mean.abs());
    }
}
