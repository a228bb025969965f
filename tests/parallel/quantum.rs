//! Oracles, sparsity and probabilities against dense twins.

use super::*;
use phasewarp::quantum::access::{Scratch, SparseAccess};
use phasewarp::quantum::probability::{points, square_sum, window_end};
use phasewarp::quantum::sparsity::measure;

/// The oracles rebuild `H = H1 ⊗ D_μ − H2 ⊗ I` of the dense twin, weights and inflow included: every entry that is not zero is found, once, and
/// nothing else; it is Hermitian; no row is fuller than stated; values to m bits are the nearest.
pub fn oracles(world: &World) {
    const POINTS: usize = 6;
    const PERIOD: f64 = 9.0;
    for twin in Twin::all() {
        let mesh = one_block(world, &twin.case);
        let weighted = Weighted::new(world, &twin, &mesh);
        let (s, k) = (weighted.generator.symmetric(), weighted.generator.skew());
        let access = SparseAccess::new(&twin.case, &weighted.problem, (POINTS, PERIOD))
            .expect("V is finite");
        assert_eq!(access.unknowns(), twin.size(), "{}", twin.name);
        assert_eq!(access.order(), POINTS * twin.size());
        let mut scratch = Scratch::default();
        let number = |j: usize| (weighted.number[j / POINTS], j % POINTS);
        let exact = |j: usize, column: usize| {
            let ((i, l), (other, m)) = (number(j), number(column));
            let mu = std::f64::consts::TAU * (l as f64 - 3.0) / PERIOD;
            match l == m {
                true => Complex64::new(mu * s.at(i, other), k.at(i, other)),
                false => Complex64::ZERO,
            }
        };
        let (mut largest, mut fullest) = (0.0f64, 0);
        // Every row of small twins; of larger ones those of a few unknowns, all ranks together going through all.
        let group = world.group();
        let step = 1 + access.order() / 600;
        for j in (group.rank()..access.order()).step_by(step) {
            let mut found = Vec::new();
            for entry in 0..=access.sparsity() {
                let column = access.location(&mut scratch, j, entry);
                if column == access.order() {
                    assert_eq!(access.value(&mut scratch, j, column), Complex64::ZERO);
                    break;
                }
                assert!(
                    found.last().is_none_or(|last| *last < column),
                    "{}: row {j}",
                    twin.name
                );
                found.push(column);
                let value = access.value(&mut scratch, j, column);
                let back = access.value(&mut scratch, column, j);
                assert!(
                    (value - back.conj()).norm() <= 1e-14 * access.largest(),
                    "{}: {j} {column}",
                    twin.name
                );
                assert!(value != Complex64::ZERO);
                for m in [4, 20, 50] {
                    let unit = access.unit(m);
                    let [re, im] = access.value_bits(&mut scratch, (j, column), m);
                    for (bits, x) in [(re, value.re), (im, value.im)] {
                        // The largest itself is one unit more than the bits hold; beyond the bits of a double nothing is told.
                        let off = (bits as f64 * unit - x).abs();
                        let most = if x.abs() > access.largest() - unit {
                            1.0
                        } else {
                            0.5
                        };
                        let round_off = 1e-15 * access.largest();
                        assert!(off <= most * unit + round_off, "{m} bits: {off:e} {unit:e}");
                        assert!(bits.unsigned_abs() < 1 << (m - 1));
                    }
                }
            }
            assert!(found.len() <= access.sparsity(), "{}: row {j}", twin.name);
            fullest = fullest.max(found.len());
            for column in 0..access.order() {
                let exact = exact(j, column);
                largest = largest.max(exact.norm());
                let value = access.value(&mut scratch, j, column);
                assert!(
                    (value - exact).norm() <= 1e-13 * access.largest(),
                    "{}: {j} {column}: {value} {exact}",
                    twin.name
                );
                assert_eq!(
                    value != Complex64::ZERO,
                    found.contains(&column),
                    "{}: {j} {column}",
                    twin.name
                );
            }
        }
        assert!(largest <= access.largest() * (1.0 + 1e-13));
        if step == 1 {
            assert_eq!(group.max_count(fullest), access.sparsity(), "{}", twin.name);
            let most = group.max(largest) / access.largest();
            assert!((most - 1.0).abs() < 1e-13, "{}: {most}", twin.name);
        }
    }
}

/// Nonzeros of rows and columns are those of the dense twins, on every mesh.
pub fn sparsity_counted(world: &World) {
    for twin in Twin::all() {
        for mesh in meshes(world, &twin.case) {
            let weighted = Weighted::new(world, &twin, &mesh);
            let name = format!("{}, {mesh:?}", twin.name);
            let found = measure(
                &twin.case,
                &weighted.problem.matrix,
                &weighted.communicator.space,
            )
            .expect("V is finite");
            let of = |matrix: &str| {
                let found = found.counts.iter().find(|c| c.matrix == matrix);
                let found = found.unwrap_or_else(|| panic!("{matrix} is counted"));
                (found.rows.most, found.columns.most)
            };
            let count = |size: usize, present: &dyn Fn(usize, usize) -> bool| {
                let rows = (0..size)
                    .map(|i| (0..size).filter(|&j| present(i, j)).count())
                    .max();
                let columns = (0..size)
                    .map(|j| (0..size).filter(|&i| present(i, j)).count())
                    .max();
                (rows.unwrap_or(0), columns.unwrap_or(0))
            };
            let a = &twin.generator;
            assert_eq!(
                of("A"),
                count(twin.cells, &|i, j| a.at(i, j) != 0.0),
                "{name}"
            );
            let (s, k) = (weighted.generator.symmetric(), weighted.generator.skew());
            assert_eq!(
                of("H"),
                count(twin.size(), &|i, j| s.at(i, j) != 0.0 || k.at(i, j) != 0.0),
                "{name}"
            );
            // Every part's nonzeros are among A's, and they make it up.
            let n = twin.case.space.dimension();
            let parts: Vec<(usize, usize)> = (0..n)
                .map(|a| of(["A_x", "A_y", "A_z"][a]))
                .chain([of("A_v")])
                .collect();
            assert!(
                parts.iter().all(|p| p.0 <= of("A").0 && p.1 <= of("A").1),
                "{name}"
            );
            assert!(
                parts.iter().map(|p| p.0).sum::<usize>() >= of("A").0,
                "{name}"
            );
            // The bounds that are stated are kept, and stated where they are made for the case.
            for c in &found.counts {
                assert!(c.rows.holds && c.columns.holds, "{name}: {c:?}");
                assert!(
                    found.bounded || (c.rows.bound.is_none() && c.columns.bound.is_none()),
                    "{name}"
                );
            }
            let places = found
                .counts
                .iter()
                .flat_map(|c| [&c.rows.place, &c.columns.place]);
            // Scenes that differ in their couplings only have the same places.
            let text = |p: &str| p.bytes().map(f64::from).sum();
            let bits: Vec<f64> = places.map(|p| text(p)).chain([text(twin.name)]).collect();
            report_bits(
                world,
                &format!("places of the fullest rows of {}", twin.name),
                &bits,
            );
        }
    }
}

/// `C_w²/‖u(0)‖² = N_p Σ|c_l|²` is `Σ_k g(p_k)²`; and a window ends where the series leaves the exponential.
pub fn norm_of_the_state(world: &World) {
    let mut twin = Twin::all().swap_remove(0);
    let resources = Resources {
        ranks: world.group().size(),
        ..Resources::default()
    };
    for (profile, tolerance) in [
        (ProfileChoice::Designed, 1e-6),
        (ProfileChoice::Gaussian, 1e-9),
        (ProfileChoice::Smooth { order: 4 }, 1e-4),
        (ProfileChoice::Exponential { alpha: 1.0 }, 1e-2),
    ] {
        twin.case.warp.profile = profile;
        twin.case.tolerance = tolerance;
        let plan = Plan::new(&twin.case, &resources, 2.0).expect("a plan");
        let warp_plan = plan.warp.as_ref().expect("a schrodingerized run");
        let series = &warp_plan.series;
        let count = points(series);
        assert!(count >= 2 * (series.modes() - 1));
        for origin in [-3.1, 0.4] {
            let at = |k: usize| origin + series.period * k as f64 / count as f64;
            let sum: f64 = (0..count).map(|k| series.value(at(k)).powi(2)).sum();
            let exact = count as f64 * square_sum(series);
            assert!(
                (sum / exact - 1.0).abs() < 1e-10,
                "{profile:?}: {sum} {exact}"
            );
        }
        let lambda = [plan.bounds.growth, plan.bounds.decay].map(|x| x * twin.case.end);
        let point = warp_plan.readings[0].point;
        let allowed = 10.0 * warp_plan.state_tolerance;
        let end = window_end(series, point, lambda, allowed)
            .unwrap_or_else(|| panic!("{profile:?}: no window"));
        assert!(
            end > point && end <= point + 12.0,
            "{profile:?}: {point} {end}"
        );
        let good = |p: f64| {
            (0..2000).all(|k| {
                let q = p - lambda[0] + (lambda[0] + lambda[1]) * f64::from(k) / 1999.0;
                (series.value(q) - (-q).exp()).abs() <= 1.5 * allowed * (-p).exp()
            })
        };
        assert!(
            (0..=8).all(|k| good(point + (end - point) * f64::from(k) / 8.0)),
            "{profile:?}"
        );
        assert!(
            end == point + 12.0 || !(1..=40).all(|k| good(end + 0.05 * f64::from(k))),
            "{profile:?}"
        );
    }
}
