//! Tests the distributed `(S, K)`: its entries, its products, one step and several at once.

use crate::*;

pub fn matrix_entry_for_entry(world: &World) {
    for_every_piece(world, |twin, mesh, piece| {
        let name = format!("{}, {mesh:?}", twin.name);
        let (s, k) = piece.gather_matrix(world, twin);
        // The scalar's δ is a sum, exact here and rounded there.
        let round_off = match twin.case.warp.inflow {
            Embedding::Scalar => 1e-15 * twin.generator.largest(),
            _ => 0.0,
        };
        assert_same(&name, &s, &twin.generator.symmetric(), round_off);
        assert_same(&name, &k, &twin.generator.skew(), round_off);
        let space = &piece.communicator.space;
        let coupled = piece.matrix.inflow.iter().filter(|aux| aux.coupling != 0.0);
        assert_eq!(
            space.sum_count(coupled.count()),
            twin.coupled.len(),
            "{name}"
        );
        for (m, r) in piece.matrix.auxiliary(0, twin.case.enters()).enumerate() {
            let m = piece.number[piece.matrix.block.cells() + m];
            assert!((r - twin.state[m]).abs() <= 1e-14 * r.abs(), "{name}: {r}");
        }
        // In weighted unknowns.
        let mut weighted = Weighted::new(world, twin, mesh);
        let (s, k) = {
            let matrix = std::mem::replace(
                &mut weighted.problem.matrix,
                Piece::assemble(world, twin, mesh).matrix,
            );
            Piece::new(twin, Communicator::new(world, mesh), matrix).gather_matrix(world, twin)
        };
        let tolerance = 1e-14 * weighted.generator.largest();
        assert_same(&name, &s, &weighted.generator.symmetric(), tolerance);
        assert_same(&name, &k, &weighted.generator.skew(), tolerance);
        let local = &weighted.problem.states[0][..weighted.problem.matrix.rows()];
        for (i, u) in local.iter().enumerate() {
            let expected = weighted.state[weighted.number[i]];
            assert!(
                (u - expected).abs() <= 1e-14 * expected.abs(),
                "{name}: {u} {expected}"
            );
        }
    });
}

pub fn application_of_all_parts(world: &World) {
    for_every_piece(world, |twin, mesh, piece| {
        let x = random(twin, 2);
        for (part, expected) in [
            (Operator::Generator, twin.generator.apply(&x)),
            (Operator::Transpose, twin.generator.transposed().apply(&x)),
            (Operator::Symmetric, twin.generator.symmetric().apply(&x)),
        ] {
            let mut y = vec![f64::NAN; piece.matrix.length()];
            let mut local = piece.scatter(&x);
            piece
                .matrix
                .apply(&mut piece.exchange, part, &mut y, &mut local);
            let found = piece.gather(twin, &y);
            let name = format!("{}, {mesh:?}, {part:?}", twin.name);
            assert_close(&name, &found, &expected, 1e-14 * twin.generator.largest());
            report_bits(world, &format!("{part:?} of {}", twin.name), &found);
        }
    });
}

/// `⟨y, A x⟩ = ⟨Aᵀ y, x⟩` of what is distributed.
pub fn adjoint(world: &World) {
    for_every_piece(world, |twin, mesh, piece| {
        let (mut x, mut y) = (
            piece.scatter(&random(twin, 3)),
            piece.scatter(&random(twin, 4)),
        );
        let mut ax = vec![f64::NAN; piece.matrix.length()];
        let mut aty = ax.clone();
        piece
            .matrix
            .apply(&mut piece.exchange, Operator::Generator, &mut ax, &mut x);
        piece
            .matrix
            .apply(&mut piece.exchange, Operator::Transpose, &mut aty, &mut y);
        let product = |a: &[f64], b: &[f64], sign: fn(f64) -> f64| {
            let terms: Vec<f64> = (0..piece.matrix.counted_rows())
                .map(|i| sign(a[i] * b[i]))
                .collect();
            piece.communicator.space.sum_terms(&terms)
        };
        let (left, right) = (product(&y, &ax, |t| t), product(&aty, &x, |t| t));
        let scale = product(&y, &ax, f64::abs);
        assert!(
            (left - right).abs() <= 1e-15 * scale * (twin.size() as f64).sqrt(),
            "{} {mesh:?}: {left} {right}",
            twin.name
        );
        // The generator is not its own adjoint, or the test would see nothing.
        let mut ay = vec![f64::NAN; piece.matrix.length()];
        piece
            .matrix
            .apply(&mut piece.exchange, Operator::Generator, &mut ay, &mut y);
        assert!((left - product(&ay, &x, |t| t)).abs() > 1e-6 * scale);
    });
}

/// `y ← a ((−iμS + K) x + i c x) + y + coefficient · start`, the start being real, complex or nothing.
pub fn one_step(world: &World) {
    let lane = |l: usize, seed| std::array::from_fn::<f64, LANES, _>(|m| noise(m * 8 + l, seed));
    let constants = StepConstants {
        scale: lane(0, 5),
        shift: lane(1, 6),
        wavenumber: lane(2, 7).map(|mu| 10.0 * mu),
        coefficient: lane(3, 8),
    };
    for_every_piece(world, |twin, mesh, piece| {
        let complex = |i: usize, l: usize, seed: u64| {
            Complex64::new(noise(i * LANES + l, seed), noise(i * LANES + l, seed + 50))
        };
        let local = |seed: u64| -> Vec<Lanes> {
            let lanes = |&i: &usize| {
                Lanes(std::array::from_fn(|l| match l < LANES {
                    true => complex(i, l, seed).re,
                    false => complex(i, l - LANES, seed).im,
                }))
            };
            let rows = piece.matrix.rows();
            let mut list: Vec<Lanes> = piece.number[..rows].iter().map(lanes).collect();
            list.resize(piece.matrix.length(), Lanes([f64::NAN; 2 * LANES]));
            list
        };
        let (y, mut x, start) = (local(20), local(21), local(22));
        let rows = piece.matrix.rows();
        let real: Vec<f64> = (piece.number[..rows].iter())
            .map(|&i| noise(i, 23))
            .collect();
        let nothing: &[()] = &[];
        let (mut plain, mut from_real, mut from_complex) = (y.clone(), y.clone(), y);
        let (matrix, exchange) = (&piece.matrix, &mut piece.exchange);
        matrix.step(exchange, &constants, None, &mut plain, &mut x, nothing);
        matrix.step(exchange, &constants, None, &mut from_real, &mut x, &real);
        matrix.step(
            exchange,
            &constants,
            None,
            &mut from_complex,
            &mut x,
            &start,
        );
        let (s, k) = (twin.generator.symmetric(), twin.generator.skew());
        let scale = twin.generator.largest() * 10.0;
        // The same to round-off by every instruction set, but for the row that is a sum over all ranks.
        for set in InstructionSet::all() {
            let mut other = local(20);
            let step = kernel::stepper_for(set);
            step(matrix.stored(), 0..rows, &constants, &mut other, &x, &start);
            for i in (0..rows).filter(|&i| Some(i) != matrix.shared_row()) {
                for (a, b) in other[i].0.iter().zip(&from_complex[i].0) {
                    let near = (a - b).abs() <= 1e-14 * scale;
                    assert!(near, "{} {mesh:?} {set:?} row {i}: {a} {b}", twin.name);
                }
            }
        }
        for l in 0..LANES {
            let [a, c, mu, coefficient] = [
                constants.scale[l],
                constants.shift[l],
                constants.wavenumber[l],
                constants.coefficient[l],
            ];
            for (local, &i) in piece.number[..piece.matrix.rows()].iter().enumerate() {
                let mut hx = Complex64::new(0.0, c) * complex(i, l, 21);
                for j in 0..twin.size() {
                    hx += Complex64::new(k.at(i, j), -mu * s.at(i, j)) * complex(j, l, 21);
                }
                let expected = a * hx + complex(i, l, 20);
                for (found, expected) in [
                    (&plain, expected),
                    (&from_real, expected + coefficient * noise(i, 23)),
                    (&from_complex, expected + coefficient * complex(i, l, 22)),
                ] {
                    let Lanes(row) = found[local];
                    let found = Complex64::new(row[l], row[LANES + l]);
                    assert!(
                        (found - expected).norm() <= 1e-14 * scale,
                        "{} {mesh:?} row {i} lane {l}: {found} {expected}",
                        twin.name
                    );
                }
            }
        }
    });
}

/// Several steps in one trip through memory have the bits of step after step, whatever the shape: strips and ranges that do
/// not divide, more levels than cells, trips of fewer steps than the blocking is made for; with the inflow of a stage too.
pub fn blocked_steps(world: &World) {
    const LEVELS: usize = 7;
    let shapes = [
        (2, 1, 1),
        (3, 2, 1),
        (LEVELS, 1, 3),
        (LEVELS, 3, 2),
        (LEVELS, 100, 1000),
    ];
    let levels: Vec<StepConstants> = (0..LEVELS as u64)
        .map(|k| {
            let lane = |seed| std::array::from_fn::<f64, LANES, _>(|l| noise(l, 10 * k + seed));
            StepConstants {
                scale: lane(1).map(|a| 0.01 * a),
                shift: lane(2),
                wavenumber: lane(3),
                coefficient: lane(4),
            }
        })
        .collect();
    let mut blocked = 0;
    for_every_piece(world, |twin, mesh, piece| {
        if !Blocking::possible(&piece.matrix) {
            assert!(piece.matrix.shared_row().is_some());
            return;
        }
        let rows = piece.matrix.rows();
        let vector = |seed: usize| -> Vec<Lanes> {
            let row = |i| Lanes(std::array::from_fn(|l| noise(i, (100 * seed + l) as u64)));
            let mut list: Vec<Lanes> = piece.number[..rows].iter().copied().map(row).collect();
            list.resize(piece.matrix.length(), Lanes([f64::NAN; 2 * LANES]));
            list
        };
        let start: Vec<f64> = (0..rows).map(|i| noise(i, 5)).collect();
        let couplings: Vec<f64> = (0..piece.matrix.inflow.len())
            .map(|m| noise(m, 6))
            .collect();
        for couplings in [None, Some(&couplings[..])] {
            let mut run = |blocking: Option<&Blocking>, steps: usize| {
                let (mut y, mut x) = (vector(1), vector(2));
                let (matrix, exchange) = (&piece.matrix, &mut piece.exchange);
                let steps = Steps {
                    levels: &levels[..steps],
                    couplings,
                };
                matrix.steps(exchange, blocking, &steps, &mut y, &mut x, &start);
                let bits = |v: &[Lanes]| -> Vec<_> {
                    v[..rows].iter().map(|r| r.0.map(f64::to_bits)).collect()
                };
                (bits(&y), bits(&x))
            };
            for (depth, width, parts) in shapes {
                let shape = BlockingShape {
                    depth,
                    width,
                    parts,
                };
                let blocking = Blocking::new(&piece.matrix, &shape);
                for steps in [depth, depth - 1] {
                    let same = run(Some(&blocking), steps) == run(None, steps);
                    assert!(same, "{} {mesh:?} {shape:?}, {steps} steps", twin.name);
                    blocked += 1;
                }
            }
            // A step fewer is another result, or the test would see nothing.
            assert!(run(None, LEVELS) != run(None, LEVELS - 2));
        }
    });
    assert!(blocked > 0);
}
