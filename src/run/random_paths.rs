//! The error of `f` where jumps of `V` reflect in part, by random paths.
//!
//! Behind such a jump `f` is a mixture, so that a point has no single characteristic. `f(T, z)` is
//! the mean of the data at the ends of random paths back from `z`: each turns back at a jump with
//! the reflected part as its probability. At nodes `z_k` of the grid, with volumes `w_k` and the
//! ends `a_k` and `b_k` of two independent paths,
//!
//! ```text
//! Σ w_k (f_h(z_k) − a_k)(f_h(z_k) − b_k)   has the mean Σ w_k (f_h(z_k) − f(T, z_k))²
//! Σ w_k a_k b_k                            has the mean Σ w_k f(T, z_k)²
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

/// Least and largest number of samples, each of two paths.
const LEAST_SAMPLES: usize = 1 << 10;
const MOST_SAMPLES: usize = 1 << 14;
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
    let samples = MOST_SAMPLES.min(MOST_FACES / (2 * tracer.most_faces(case.end)));
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
    let mut end = || {
        let point = space.point(&cell);
        tracer.value_by(&point, case.end, &mut |met| is_reflected(case, met, &mut random))
    };
    let [a, b] = [end(), end()];
    let (found, weight) = (result.field[at], volumes.relative(at));
    let mut terms = [0.0; 2 * REPLICATES];
    terms[k % REPLICATES] = weight * (found - a) * (found - b);
    terms[REPLICATES + k % REPLICATES] = weight * a * b;
    Some(terms)
}
