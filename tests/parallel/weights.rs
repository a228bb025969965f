//! Tests the weights of the norm in which `S ≤ 0`, and the spectrum of `S`.

use crate::*;

/// `½ max_j (Aᵀπ)_j/π_j` over the cells.
pub fn certificate(twin: &Twin, pi: &[f64]) -> f64 {
    let column = |j: usize| {
        let sum: f64 = (0..twin.cells)
            .map(|i| twin.generator.at(i, j) * pi[i])
            .sum();
        0.5 * sum / pi[j]
    };
    (0..twin.cells)
        .map(column)
        .fold(f64::NEG_INFINITY, f64::max)
}

pub fn dissipative_weights(world: &World) {
    for twin in Twin::all() {
        let rate = twin.generator.largest();
        let mut highest = None;
        for mesh in meshes(world, &twin.case) {
            let name = format!("{}, {mesh:?}", twin.name);
            let weighted = Weighted::new(world, &twin, &mesh);
            let weights = &weighted.problem.weights;
            let claimed = weights.certificate;
            let found = certificate(&twin, &weighted.pi);
            assert!(
                (claimed - found).abs() <= 1e-13 * rate,
                "{name}: {claimed} {found}"
            );
            assert!(weighted.pi.iter().all(|&pi| pi >= 1.0), "{name}");
            // Only trapped particles leave some growth, between walls or around an axis.
            let trapped = [
                "well",
                "periodic, a jump at the end, inflow of velocities",
                "periodic along the step",
            ];
            let trapped = trapped.contains(&twin.name);
            assert_eq!(claimed > 1e-6, trapped, "{name}: {claimed}");
            for (pi, &i) in weights.pi.iter().zip(&weighted.number) {
                assert_eq!(*pi, weighted.pi[i], "{name}: ghosts too");
            }
            for (m, &i) in twin.inflow.iter().enumerate() {
                assert_eq!(weighted.pi[twin.cells + m], weighted.pi[i], "{name}");
            }
            // The weight of a common unknown keeps Σ κ²/(2g).
            let theta = |a: &Dense| -> f64 {
                let added = |&(i, m, draw): &(usize, usize, f64)| a.at(i, m).powi(2) / (2.0 * draw);
                twin.coupled.iter().map(added).sum()
            };
            let (before, after) = (theta(&twin.generator), theta(&weighted.generator));
            assert!(
                (before - after).abs() <= 1e-13 * before,
                "{name}: {before} {after}"
            );
            let most = weighted.pi.iter().copied().fold(0.0, f64::max);
            let least = weighted.pi.iter().copied().fold(f64::INFINITY, f64::min);
            assert_eq!(weights.spread, (most / least).sqrt(), "{name}");

            // What it certifies: no eigenvalue of S above it, inflow couplings aside.
            let theta = twin.theta();
            let allowed = weighted.bounds.growth;
            if twin.coupled.is_empty() {
                assert_eq!(allowed, claimed, "{name}");
            } else {
                assert!(
                    allowed <= claimed.max(theta) * (1.0 + 1e-12),
                    "{name}: {allowed} {theta}"
                );
            }
            let highest = *highest.get_or_insert_with(|| {
                let s = weighted.generator.symmetric();
                *eigenvalues(&s, &Dense::zero(s.size), 1.0)
                    .last()
                    .expect("there are some")
            });
            assert!(
                highest <= allowed + 1e-13 * rate,
                "{name}: {highest} {allowed}"
            );

            // Without weights the certificate is half the largest column sum: larger, where weights were needed.
            let mut piece = Piece::assemble(world, &twin, &mesh);
            let space = &piece.communicator.space;
            let none = Weights::none(&piece.matrix, &mut piece.exchange, space);
            let expected = certificate(&twin, &vec![1.0; twin.size()]);
            assert!(
                (none.certificate - expected).abs() <= 1e-14 * rate,
                "{name}"
            );
            assert!(none.pi.iter().all(|&pi| pi == 1.0));
            if weighted.bounds.weighted {
                assert!(weights.sweeps > 0 && most > 1.0, "{name}");
                assert!(claimed < 0.5 * none.certificate, "{name}");
                report_bits(world, &format!("weights of {}", twin.name), &weighted.pi);
            } else {
                assert_eq!((most, claimed), (1.0, none.certificate), "{name}");
            }
        }
    }
}

/// Both ends of the spectrum of `S`, with and without weights, and Gershgorin's bounds, against all eigenvalues.
pub fn extreme_eigenvalues(world: &World) {
    for twin in Twin::all() {
        let mut expected: BTreeMap<bool, (f64, f64)> = BTreeMap::new();
        for mesh in meshes(world, &twin.case) {
            let mut weighted = Weighted::new(world, &twin, &mesh);
            let mut piece = Piece::assemble(world, &twin, &mesh);
            let terms = weighted.problem.terms;
            for with_weights in [false, true] {
                if with_weights && !weighted.bounds.weighted {
                    continue;
                }
                let s = if with_weights {
                    weighted.generator.symmetric()
                } else {
                    twin.generator.symmetric()
                };
                let (low, high) = *expected.entry(with_weights).or_insert_with(|| {
                    let values = eigenvalues(&s, &Dense::zero(s.size), 1.0);
                    (values[0], values[values.len() - 1])
                });
                let name = format!("{}, {mesh:?}, weights {with_weights}", twin.name);
                let (matrix, exchange) = if with_weights {
                    (&weighted.problem.matrix, &mut weighted.problem.exchange)
                } else {
                    (&piece.matrix, &mut piece.exchange)
                };
                let space = &piece.communicator.space;
                let [lower, upper] = gershgorin(matrix, space);
                let radius = |i: usize| -> f64 {
                    let others = s.row(i).iter().map(|x| x.abs()).sum::<f64>();
                    others - s.at(i, i).abs()
                };
                let least = (0..s.size)
                    .map(|i| s.at(i, i) - radius(i))
                    .fold(f64::INFINITY, f64::min);
                let most = (0..s.size)
                    .map(|i| s.at(i, i) + radius(i))
                    .fold(f64::NEG_INFINITY, f64::max);
                let round_off = 1e-13 * s.largest();
                assert!(
                    (lower - least).abs() <= round_off,
                    "{name}: {lower} {least}"
                );
                assert!((upper - most).abs() <= round_off, "{name}: {upper} {most}");

                let norm = lower.abs().max(upper.abs());
                let found = extremes(matrix, exchange, space, norm, terms, 2000);
                for (end, exact) in [(found.highest, high), (found.lowest, low)] {
                    let off = (end.value - exact).abs();
                    assert!(
                        off <= end.residual + round_off,
                        "{name}: {end:?}, {exact} expected"
                    );
                    // A residual is first order in the vector's error, the value second.
                    assert!(
                        end.converged && off <= 1e-7 * norm,
                        "{name}: {end:?}, {exact} expected"
                    );
                }
                // Three steps do not do, and the residual says so.
                let few = extremes(matrix, exchange, space, norm, terms, 3);
                assert!(!few.highest.converged && few.steps == 3, "{name}: {few:?}");
                assert!(
                    few.highest.value <= high + round_off && few.lowest.value >= low - round_off
                );
                report_bits(
                    world,
                    &format!("spectrum of {}, weights {with_weights}", twin.name),
                    &[
                        found.highest.value,
                        found.lowest.value,
                        found.highest.residual,
                        found.lowest.residual,
                    ],
                );
            }
        }
    }
}
