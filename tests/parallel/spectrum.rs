//! Tests bounds and estimates of the spectrum of `S` and of `μS + iK` against all eigenvalues.

use crate::bits::report_bits;
use crate::dense_twins::Twin;
use crate::pieces::{Piece, Weighted, meshes, one_block};
use crate::support::dense::{Dense, ends_of_spectrum};
use phasewarp::matrix::block_matrix::BlockMatrix;
use phasewarp::matrix::bounds::Bounds;
use phasewarp::matrix::bounds::SpectralInterval;
use phasewarp::parallel::communicator::{GhostExchange, Group, World};
use phasewarp::solve::spectrum::SymmetricPart;

/// The spectrum of `μS + iK` lies in the interval of the Chebyshev series, which depends on the
/// known growth.
pub fn spectrum_in_its_interval(world: &World) {
    let mut twins = Twin::all();
    let grid = ["axis.0.x.cells=18", "axis.0.v.cells=16"];
    let with = |set: &'static str| [grid[0], grid[1], set];
    let unweighted = with("solver.warp.weights='none'");
    let conservative = with("scheme.interface='conservative'");
    twins.push(Twin::new("example 1, hat", "example1.toml", &grid));
    twins.push(Twin::new("no weights", "example1.toml", &unweighted));
    twins.push(Twin::new("well, hat", "well.toml", &grid));
    twins.push(Twin::new("well, conservative", "well.toml", &conservative));
    let group = world.group();
    let mut turn = 0;
    for twin in twins {
        let weighted = Weighted::new(world, &twin, &one_block(world, &twin.case));
        for mu in [0.0, 0.4, 2.0, 7.0, 30.0] {
            // The ranks share the work.
            turn += 1;
            if turn % group.size() == group.rank() {
                spectrum_of_a_mode(&weighted, twin.name, mu);
            }
        }
    }
}

fn spectrum_of_a_mode(weighted: &Weighted, name: &str, mu: f64) {
    let bounds = &weighted.prepared.bounds;
    let growth = bounds.growth;
    let (s, k) = (weighted.generator.symmetric(), weighted.generator.skew());
    let [low, high] = ends_of_spectrum(&s, &k, mu);
    let holds = |growth: f64| {
        let bounds = Bounds { growth, ..bounds.clone() };
        let SpectralInterval { centre, half_width } = bounds.interval(mu);
        let slack = 1e-13 * half_width;
        centre - half_width - slack <= low && high <= centre + half_width + slack
    };
    let at = format!("{name}, mu = {mu}: [{low}, {high}], growth {growth}");
    assert!(holds(growth), "{at}");
    // Control: without weights, an interval that neglects the growth is too small.
    if name == "no weights" && mu >= 7.0 {
        assert!(!holds(0.0), "{at}");
    }
}

/// Both ends of the spectrum of `S`, with and without weights, and Gershgorin's bounds, against all
/// eigenvalues.
pub fn extreme_eigenvalues(world: &World) {
    // On one rank the common unknown has as many rows as there are unknowns, on the others none.
    for twin in Twin::all().into_iter().chain([Twin::single_inflow()]) {
        let mut exact = [None, None];
        for mesh in meshes(world, &twin.case) {
            let mut weighted = Weighted::new(world, &twin, &mesh);
            let mut piece = Piece::assemble(world, &twin, &mesh);
            let prepared = &mut weighted.prepared;
            let terms = prepared.system.norm_terms;
            let mut systems = vec![DistributedMatrix {
                matrix: &piece.matrix,
                exchange: &mut piece.exchange,
                s: twin.generator.symmetric(),
            }];
            if prepared.bounds.weighted {
                systems.push(DistributedMatrix {
                    matrix: &prepared.system.matrix,
                    exchange: &mut prepared.system.exchange,
                    s: weighted.generator.symmetric(),
                });
            }
            for (k, system) in systems.iter_mut().enumerate() {
                let exact = *exact[k].get_or_insert_with(|| system.s.ends_of_spectrum());
                let name = format!("{}, {mesh:?}, weights {}", twin.name, k == 1);
                let found = system.check(&piece.communicator.space, terms, exact, &name);
                let name = format!("spectrum of {}, weights {}", twin.name, k == 1);
                report_bits(world, &name, &found);
            }
        }
    }
}

/// A distributed matrix and its `S` as a dense matrix.
struct DistributedMatrix<'a> {
    matrix: &'a BlockMatrix,
    exchange: &'a mut GhostExchange,
    s: Dense,
}

impl DistributedMatrix<'_> {
    /// Checks the bounds and the ends of the spectrum. Returns the ends and their residuals.
    fn check(&mut self, space: &Group, terms: usize, exact: [f64; 2], name: &str) -> [f64; 4] {
        let s = &self.s;
        let round_off = 1e-13 * s.largest();
        let (matrix, exchange) = (self.matrix, &mut *self.exchange);
        let mut part = SymmetricPart { matrix, exchange, unknowns: terms };
        let [lower, upper] = part.gershgorin(space);
        let [least, most] = dense_gershgorin(s);
        assert!((lower - least).abs() <= round_off, "{name}: {lower} {least}");
        assert!((upper - most).abs() <= round_off, "{name}: {upper} {most}");

        let [low, high] = exact;
        let norm = lower.abs().max(upper.abs());
        let found = part.extremes(space, norm, 2000);
        for (end, exact) in [(found.highest, high), (found.lowest, low)] {
            let off = (end.value - exact).abs();
            let at = format!("{name}: {end:?}, {exact} expected");
            assert!(off <= end.residual + round_off, "{at}");
            // The residual is of first order in the error of the vector, the value of second order.
            assert!(end.converged && off <= 1e-7 * norm, "{at}");
        }
        // Three steps are too few, which is reported as not converged.
        let few = part.extremes(space, norm, 3);
        assert!(!few.highest.converged && few.steps == 3, "{name}: {few:?}");
        assert!(few.highest.value <= high + round_off, "{name}: {few:?}");
        assert!(few.lowest.value >= low - round_off, "{name}: {few:?}");
        let (highest, lowest) = (found.highest, found.lowest);
        [highest.value, lowest.value, highest.residual, lowest.residual]
    }
}

/// `min_i (S_ii − r_i)` and `max_i (S_ii + r_i)`, `r_i = Σ_{j≠i} |S_ij|`.
fn dense_gershgorin(s: &Dense) -> [f64; 2] {
    let radius = |i: usize| s.row(i).iter().map(|x| x.abs()).sum::<f64>() - s.at(i, i).abs();
    let lower = (0..s.size).map(|i| s.at(i, i) - radius(i));
    let upper = (0..s.size).map(|i| s.at(i, i) + radius(i));
    [lower.fold(f64::INFINITY, f64::min), upper.fold(f64::NEG_INFINITY, f64::max)]
}
