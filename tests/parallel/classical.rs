//! Tests the classical solution of `f' = A f + b`: its exponential, time steps, limited slopes.

use crate::bits::report_bits;
use crate::dense_twins::Twin;
use crate::pieces::{Piece, Weighted, gather, meshes};
use crate::support::dense::{assert_close, distance, exponential, noise, order_of};
use crate::support::limited::limited_right_hand_side;
use phasewarp::matrix::block_matrix::Operator;
use phasewarp::parallel::communicator::World;
use phasewarp::parallel::partition::ProcessMesh;
use phasewarp::problem::case::{Integrator, Limiter};
use phasewarp::propagate::classical::{Classical, ClassicalSpan, EXACT};
use phasewarp::propagate::limiter::{Reconstruction, longest_step};

/// `exp(A T) f(0)` with the weights of a run, against a dense Taylor series.
pub fn classical_exponential(world: &World) {
    for twin in Twin::all() {
        let time = twin.case.end;
        let expected = exponential(&twin.generator, &twin.state, time);
        for mesh in meshes(world, &twin.case) {
            let name = format!("{}, {mesh:?}", twin.name);
            let Weighted { mut prepared, number, pi, .. } = Weighted::new(world, &twin, &mesh);
            let span = ClassicalSpan { rate: prepared.bounds.rate, time };
            let system = &mut prepared.system;
            let mut state = system.states[0].clone();
            let exchange = &mut system.exchange;
            Classical::new(&system.matrix).exponential(exchange, &mut state, span, EXACT);
            let rows = 0..system.matrix.counted_rows();
            let entries = rows.map(|i| (number[i], state[i] / pi[number[i]].sqrt()));
            let found = gather(&prepared.communicator.space, twin.size(), entries);
            let error = distance(&found, &expected);
            assert!(error <= 1e-13, "{name}: {error:e}");
            let change = distance(twin.field(&expected), twin.field(&twin.state));
            assert!(change > 0.1, "{name}: the state moves by {change}");
            report_bits(world, &format!("exponential of {}", twin.name), &found);
        }
    }
}

/// Forward Euler converges with order 1, SSP-RK3 with order 3.
pub fn orders_of_the_integrators(world: &World) {
    for twin in Twin::all() {
        if twin.coupled.is_empty() {
            continue;
        }
        let time = twin.case.end;
        let expected = exponential(&twin.generator, &twin.state, time);
        let coarse = (8.0 * twin.generator.largest() * time).ceil() as usize;
        for mesh in meshes(world, &twin.case) {
            let mut piece = Piece::assemble(world, &twin, &mesh);
            for (integrator, order) in [(Integrator::ForwardEuler, 1.0), (Integrator::SspRk3, 3.0)]
            {
                let errors = [coarse, 2 * coarse].map(|steps| {
                    let mut state = piece.scatter(&twin.state);
                    let mut classical = Classical::new(&piece.matrix);
                    classical.steps(&mut piece.exchange, &mut state, integrator, time, steps);
                    distance(&piece.gather(&twin, &state), &expected)
                });
                let found = order_of(errors, 2.0);
                let at = format!("{}, {mesh:?}, {integrator:?}", twin.name);
                assert!((found - order).abs() < 0.1, "{at}: order {found}, errors {errors:?}");
            }
        }
    }
}

/// `A f + b` with slopes against a simple reference, and one step, which keeps the bounds of the
/// data. Only degree 0 has slopes.
pub fn limited_slopes(world: &World) {
    for mut twin in Twin::of_degree_0().into_iter().filter(|twin| !twin.is_shared()) {
        for limiter in [Limiter::Minmod, Limiter::VanLeer] {
            twin.case.scheme.limiter = limiter;
            for data in ["noise", "waves"] {
                let x = limiter_data(&twin, data);
                let expected = limited_right_hand_side(&twin.case, twin.field(&x));
                let linear = twin.generator.apply(&x);
                let added = distance(&expected, twin.field(&linear));
                assert!(added > 0.01, "{}: slopes add {added}", twin.name);
                for mesh in meshes(world, &twin.case) {
                    let found = slopes_on_a_mesh(world, &twin, &mesh, &x, &expected);
                    let name = format!("slopes of {}, {limiter:?}, {data}", twin.name);
                    report_bits(world, &name, &found);
                }
            }
        }
    }
}

/// Noise, or data with long monotone pieces. The auxiliary unknowns have the values of the inflow.
fn limiter_data(twin: &Twin, data: &str) -> Vec<f64> {
    let mut x = twin.state.clone();
    for (i, x) in x[..twin.cells].iter_mut().enumerate() {
        let p = twin.case.space.point(&twin.case.space.cell(i));
        *x = match data {
            "noise" => noise(i, 11),
            _ => (2.0 * p[0] + 3.0 * p[1] - p[2] + 2.5 * p[3] - p[4] + p[5]).sin(),
        };
    }
    x
}

/// Compares `A x + b` with slopes with `expected`, and returns it.
fn slopes_on_a_mesh(
    world: &World,
    twin: &Twin,
    mesh: &ProcessMesh,
    x: &[f64],
    expected: &[f64],
) -> Vec<f64> {
    let name = format!("{}, {mesh:?}, {:?}", twin.name, twin.case.scheme.limiter);
    let mut piece = Piece::assemble(world, twin, mesh);
    let reconstruction = Reconstruction::new(&twin.case, &piece.matrix, 0);
    let mut reconstruction = reconstruction.expect("formulas are finite").expect("a limiter");
    let rows = piece.matrix.rows();
    let mut local = piece.scatter(x);
    let mut image = piece.apply(Operator::Generator, &mut local);
    reconstruction.add(&mut piece.exchange, &mut image, &local, rows);
    let found = piece.gather(twin, &image);
    let tolerance = 2e-14 * twin.generator.largest();
    assert_close(&name, twin.field(&found), expected, tolerance);
    // Only without inflow: then zero enters, which the bounds include.
    if twin.inflow.is_empty() {
        longest_step_keeps_bounds(twin, piece, reconstruction, x, expected);
    }
    found
}

/// Forward Euler with the longest step keeps the bounds of the data.
fn longest_step_keeps_bounds(
    twin: &Twin,
    mut piece: Piece,
    slopes: Reconstruction,
    x: &[f64],
    derivative: &[f64],
) {
    let dt = longest_step(twin.case.scheme.limiter) / transport_and_force(twin);
    let mut state = piece.scatter(x);
    let mut classical = Classical::new(&piece.matrix).with_slopes(Some(slopes));
    classical.steps(&mut piece.exchange, &mut state, Integrator::ForwardEuler, dt, 1);
    let after = piece.gather(twin, &state);
    let expected: Vec<f64> = x.iter().zip(derivative).map(|(x, f)| x + dt * f).collect();
    assert_close(twin.name, &after, &expected, 1e-13);
    let bounds = |values: &[f64]| {
        let both = |[low, high]: [f64; 2], x: &f64| [low.min(*x), high.max(*x)];
        values.iter().fold([0.0f64; 2], both)
    };
    let ([low, high], [least, most]) = (bounds(x), bounds(&after));
    let bounded = least >= low - 1e-14 && most <= high + 1e-14;
    assert!(bounded, "{}: [{least}, {most}] of [{low}, {high}]", twin.name);
}

/// `max |A_ii|`.
fn transport_and_force(twin: &Twin) -> f64 {
    let diagonal = (0..twin.cells).map(|i| -twin.generator.at(i, i));
    diagonal.fold(0.0, f64::max)
}
