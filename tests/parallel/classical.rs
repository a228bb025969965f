//! Tests the classical solution of `f' = A f + b`: its exponential, time steps, limited slopes.

use crate::*;

pub fn classical_exponential(world: &World) {
    for twin in Twin::all() {
        let time = twin.case.end;
        let expected = exponential(&twin.generator, &twin.state, time);
        for mesh in meshes(world, &twin.case) {
            let name = format!("{}, {mesh:?}", twin.name);
            let mut weighted = Weighted::new(world, &twin, &mesh);
            let rate = weighted.bounds.rate;
            let problem = &mut weighted.problem;
            let mut state = problem.states[0].clone();
            Classical::new(&problem.matrix).exponential(
                &mut problem.exchange,
                &mut state,
                (rate, time),
                EXACT,
            );
            let entries = (0..problem.matrix.counted_rows()).map(|i| {
                let number = weighted.number[i];
                (number, state[i] / weighted.pi[number].sqrt())
            });
            let found = gather(&weighted.communicator.space, twin.size(), entries);
            let error = distance(&found, &expected);
            assert!(error <= 1e-13, "{name}: {error:e}");
            let change = distance(twin.field(&expected), twin.field(&twin.state));
            assert!(change > 0.1, "{name}: the state moves by {change}");
            report_bits(world, &format!("exponential of {}", twin.name), &found);
        }
    }
}

pub fn orders_of_the_integrators(world: &World) {
    for twin in Twin::all() {
        if twin.coupled.is_empty() {
            continue;
        }
        let time = twin.case.end;
        let expected = exponential(&twin.generator, &twin.state, time);
        for mesh in meshes(world, &twin.case) {
            let mut piece = Piece::assemble(world, &twin, &mesh);
            for (integrator, order) in [(Integrator::ForwardEuler, 1.0), (Integrator::SspRk3, 3.0)]
            {
                let coarse = (8.0 * twin.generator.largest() * time).ceil() as usize;
                let errors = [coarse, 2 * coarse].map(|steps| {
                    let mut state = piece.scatter(&twin.state);
                    Classical::new(&piece.matrix).steps(
                        &mut piece.exchange,
                        &mut state,
                        integrator,
                        time,
                        steps,
                    );
                    distance(&piece.gather(&twin, &state), &expected)
                });
                let found = (errors[0] / errors[1]).log2();
                assert!(
                    (found - order).abs() < 0.1,
                    "{}, {mesh:?}, {integrator:?}: order {found}, errors {errors:?}",
                    twin.name
                );
            }
        }
    }
}

/// `A f + b` with slopes, against the naive twin; and a step, which stays between the least and the largest value.
pub fn limited_slopes(world: &World) {
    for mut twin in Twin::unshared() {
        for limiter in [Limiter::Minmod, Limiter::VanLeer] {
            twin.case.limiter = limiter;
            // Noise, and data with long monotone pieces; the auxiliary unknowns hold the inflow in both.
            for data in ["noise", "waves"] {
                let mut x = twin.state.clone();
                for (i, x) in x[..twin.cells].iter_mut().enumerate() {
                    let p = twin.case.space.point(&twin.case.space.cell(i));
                    *x = match data {
                        "noise" => noise(i, 11),
                        _ => (2.0 * p[0] + 3.0 * p[1] - p[2] + 2.5 * p[3] - p[4] + p[5]).sin(),
                    };
                }
                let expected = limited_right_hand_side(&twin.case, twin.field(&x));
                let linear = twin.generator.apply(&x);
                let added = distance(&expected, twin.field(&linear));
                assert!(added > 0.01, "{}: slopes add {added}", twin.name);
                for mesh in meshes(world, &twin.case) {
                    let name = format!("{}, {mesh:?}, {limiter:?}, {data}", twin.name);
                    let mut piece = Piece::assemble(world, &twin, &mesh);
                    let mut reconstruction = Reconstruction::new(&twin.case, &piece.matrix, 0)
                        .expect("formulas are finite")
                        .expect("a limiter");
                    let rows = piece.matrix.rows();
                    let mut local = piece.scatter(&x);
                    let mut image = vec![f64::NAN; piece.matrix.length()];
                    let exchange = &mut piece.exchange;
                    (piece.matrix).apply(exchange, Operator::Generator, &mut image, &mut local);
                    reconstruction.add(exchange, &mut image, &local, rows);
                    let found = piece.gather(&twin, &image);
                    let tolerance = 2e-14 * twin.generator.largest();
                    assert_close(&name, twin.field(&found), &expected, tolerance);
                    report_bits(
                        world,
                        &format!("slopes of {}, {limiter:?}, {data}", twin.name),
                        &found,
                    );

                    // One longest step of forward Euler keeps the bounds, zero being what enters.
                    if !twin.inflow.is_empty() {
                        continue;
                    }
                    let dt = longest_step(limiter) / transport_and_force(&twin);
                    let mut state = piece.scatter(&x);
                    Classical::new(&piece.matrix)
                        .with_slopes(Some(reconstruction))
                        .steps(
                            &mut piece.exchange,
                            &mut state,
                            Integrator::ForwardEuler,
                            dt,
                            1,
                        );
                    let after = piece.gather(&twin, &state);
                    let change: Vec<f64> =
                        (x.iter().zip(&expected)).map(|(x, f)| x + dt * f).collect();
                    assert_close(&name, &after, &change, 1e-13);
                    let bounds = |values: &[f64]| {
                        values
                            .iter()
                            .fold([0.0f64; 2], |[low, high], &x| [low.min(x), high.max(x)])
                    };
                    let ([low, high], [least, most]) = (bounds(&x), bounds(&after));
                    let bounded = least >= low - 1e-14 && most <= high + 1e-14;
                    assert!(bounded, "{name}: [{least}, {most}] of [{low}, {high}]");
                }
            }
        }
    }
}

/// `max |A_ii|`.
pub fn transport_and_force(twin: &Twin) -> f64 {
    (0..twin.cells)
        .map(|i| -twin.generator.at(i, i))
        .fold(0.0, f64::max)
}
