//! Tests the weights of the norm in which `S ≤ 0`: the growth that they certify, and equal bits on
//! every mesh.

use crate::bits::report_bits;
use crate::dense_twins::Twin;
use crate::pieces::{Piece, Weighted, meshes};
use crate::support::dense::Dense;
use phasewarp::matrix::observables::CellVolumes;
use phasewarp::matrix::weights::Weights;
use phasewarp::parallel::communicator::World;
use phasewarp::parallel::partition::ProcessMesh;

/// Twins with some growth: particles are trapped between walls or circle around a periodic axis.
const TRAPPED: [&str; 3] =
    ["well", "periodic, a jump at the end, inflow of velocities", "periodic along the step"];

/// `½ max_j (Aᵀπ)_j/π_j` over the cells.
fn certificate(twin: &Twin, pi: &[f64]) -> f64 {
    let cells = 0..twin.cells;
    let sum = |j: usize| cells.clone().map(|i| twin.generator.at(i, j) * pi[i]).sum::<f64>();
    let column = |j: usize| 0.5 * sum(j) / pi[j];
    cells.clone().map(column).fold(f64::NEG_INFINITY, f64::max)
}

/// The dissipative weights of degree 0 on every mesh. Weights of elements are tested by
/// [`volumes`].
pub fn dissipative_weights(world: &World) {
    for twin in Twin::of_degree_0() {
        let mut highest = None;
        for mesh in meshes(world, &twin.case) {
            let name = format!("{}, {mesh:?}", twin.name);
            let weighted = Weighted::new(world, &twin, &mesh);
            claims_hold(&twin, &weighted, &name);
            weights_of_auxiliary_unknowns(&twin, &weighted, &name);
            let highest = *highest
                .get_or_insert_with(|| weighted.generator.symmetric().ends_of_spectrum()[1]);
            certified_growth(&twin, &weighted, highest, &name);
            compared_with_none(world, &twin, &mesh, &weighted);
        }
    }
}

/// The reported certificate and spread follow from the weights.
fn claims_hold(twin: &Twin, weighted: &Weighted, name: &str) {
    let weights = &weighted.prepared.system.weights;
    let (claimed, found) = (weights.certificate, certificate(twin, &weighted.pi));
    let close = (claimed - found).abs() <= 1e-13 * twin.generator.largest();
    assert!(close, "{name}: {claimed} {found}");
    assert!(weighted.pi.iter().all(|&pi| pi >= 1.0), "{name}");
    assert_eq!(claimed > 1e-6, TRAPPED.contains(&twin.name), "{name}: {claimed}");
    for (pi, &i) in weights.pi.iter().zip(&weighted.number) {
        assert_eq!(*pi, weighted.pi[i], "{name}: ghosts too");
    }
    let most = weighted.pi.iter().copied().fold(0.0, f64::max);
    let least = weighted.pi.iter().copied().fold(f64::INFINITY, f64::min);
    assert_eq!(weights.spread, (most / least).sqrt(), "{name}");
}

/// An auxiliary unknown of one row has the weight of the row. The weight of a shared unknown keeps
/// `Σ κ²/(2g)`.
fn weights_of_auxiliary_unknowns(twin: &Twin, weighted: &Weighted, name: &str) {
    for (m, &i) in twin.inflow.iter().enumerate() {
        assert_eq!(weighted.pi[twin.cells + m], weighted.pi[i], "{name}");
    }
    let theta = |a: &Dense| -> f64 { twin.coupled.iter().map(|c| c.growth(a)).sum() };
    let (before, after) = (theta(&twin.generator), theta(&weighted.generator));
    assert!((before - after).abs() <= 1e-13 * before, "{name}: {before} {after}");
}

/// No eigenvalue of `S` is above the certified growth, which includes the couplings of the inflow.
fn certified_growth(twin: &Twin, weighted: &Weighted, highest: f64, name: &str) {
    let claimed = weighted.prepared.system.weights.certificate;
    let allowed = weighted.prepared.bounds.growth;
    if twin.coupled.is_empty() {
        assert_eq!(allowed, claimed, "{name}");
    } else {
        let most = claimed.max(twin.theta()) * (1.0 + 1e-12);
        assert!(allowed <= most, "{name}: {allowed} {most}");
    }
    let round_off = 1e-13 * twin.generator.largest();
    assert!(highest <= allowed + round_off, "{name}: {highest} {allowed}");
}

/// Without weights the certificate is half the largest column sum, which is larger if weights are
/// needed.
fn compared_with_none(world: &World, twin: &Twin, mesh: &ProcessMesh, weighted: &Weighted) {
    let name = format!("{}, {mesh:?}", twin.name);
    let mut piece = Piece::assemble(world, twin, mesh);
    let space = &piece.communicator.space;
    let none = Weights::none(&piece.matrix, &mut piece.exchange, space);
    let expected = certificate(twin, &vec![1.0; twin.size()]);
    let close = (none.certificate - expected).abs() <= 1e-14 * twin.generator.largest();
    assert!(close, "{name}");
    assert!(none.pi.iter().all(|&pi| pi == 1.0));
    let weights = &weighted.prepared.system.weights;
    let most = weighted.pi.iter().copied().fold(0.0, f64::max);
    if weighted.prepared.bounds.weighted {
        assert!(weights.sweeps > 0 && most > 1.0, "{name}");
        assert!(weights.certificate < 0.5 * none.certificate, "{name}");
        report_bits(world, &format!("weights of {}", twin.name), &weighted.pi);
    } else {
        assert_eq!((most, weights.certificate), (1.0, none.certificate), "{name}");
    }
}

/// The weights of elements are the volumes of their cells. With them, only the couplings of the
/// inflow cause growth, which is at most the bound.
pub fn volumes(world: &World) {
    for twin in Twin::all().into_iter().filter(Twin::by_elements) {
        let space = &twin.case.space;
        let volume = |i: usize| {
            let cell = space.cell(i);
            let widths = space.axes().zip(cell).map(|(axis, j)| axis.weight(j));
            widths.product::<f64>() / space.cell_volume()
        };
        // A test function that depends on the velocity, as the weights do.
        let nv = space.velocity_cells();
        let term = |i: usize| 1.0 + (i % nv) as f64;
        let squares: f64 = (0..twin.cells).map(|i| volume(i) * term(i) * term(i)).sum();
        let mut highest = None;
        for mesh in meshes(world, &twin.case) {
            let name = format!("{}, {mesh:?}", twin.name);
            let rank = world.group().rank();
            let share = mesh.share(space, rank % mesh.blocks(), rank / mesh.blocks());
            let found = CellVolumes::new(space, &share).sum(&world.group(), |i| term(i) * term(i));
            assert!((found / squares - 1.0).abs() < 1e-13, "{name}: {found} {squares}");
            let weighted = Weighted::new(world, &twin, &mesh);
            for i in 0..twin.cells {
                let (found, expected) = (weighted.pi[i], volume(i));
                assert!((found - expected).abs() <= 1e-14 * expected, "{name}: {found} {expected}");
            }
            let weights = &weighted.prepared.system.weights;
            for (pi, &i) in weights.pi.iter().zip(&weighted.number) {
                assert_eq!(*pi, weighted.pi[i], "{name}: ghosts too");
            }
            assert_eq!((weights.certificate, weights.sweeps), (0.0, 0), "{name}");
            let cells = &weighted.pi[..twin.cells];
            let most = cells.iter().copied().fold(0.0, f64::max);
            let least = cells.iter().copied().fold(f64::INFINITY, f64::min);
            let spread = (most / least).sqrt();
            assert!((weights.spread / spread - 1.0).abs() < 1e-14, "{name}: {spread}");
            let highest = *highest
                .get_or_insert_with(|| weighted.generator.symmetric().ends_of_spectrum()[1]);
            let allowed = weighted.prepared.bounds.growth;
            let round_off = 1e-13 * weighted.generator.largest();
            assert!(highest <= allowed + round_off, "{name}: {highest} {allowed}");
            assert!(!twin.coupled.is_empty() || allowed == 0.0, "{name}: {allowed}");
        }
    }
}
