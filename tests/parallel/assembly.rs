//! Tests the distributed `(S, K)` against dense matrices: its entries, its products, one step, and
//! several steps at once.

use crate::bits::report_bits;
use crate::dense_twins::Twin;
use crate::pieces::{Piece, Weighted, for_every_piece, meshes};
use crate::support::dense::{assert_close, assert_same, case, noise};
use crate::support::prepared::block_of;
use num_complex::Complex64;
use phasewarp::matrix::block_matrix::{BlockMatrix, Operator};
use phasewarp::matrix::blocking::fastest::FastestBlocking;
use phasewarp::matrix::blocking::{Blocking, BlockingShape, Caches, MOST_LEVELS, RecurrenceSteps};
use phasewarp::matrix::instruction_set::InstructionSet;
use phasewarp::matrix::kernel::LineStep;
use phasewarp::matrix::lanes::{LANES, Lanes, StepConstants};
use phasewarp::parallel::communicator::{Communicator, GhostExchange, World};
use phasewarp::parallel::partition::ProcessMesh;
use phasewarp::problem::case::Embedding;

/// The entries of `S`, `K` and `u(0)`, without weights and with them.
pub fn matrix_entry_for_entry(world: &World) {
    for_every_piece(world, |twin, mesh, piece| {
        let name = format!("{}, {mesh:?}", twin.name);
        let (s, k) = piece.gather_matrix(world, twin);
        // δ of the scalar embedding is a sum, which the two codes round differently.
        let round_off = match twin.case.warp.inflow {
            Embedding::Scalar => 1e-15 * twin.generator.largest(),
            _ => 0.0,
        };
        assert_same(&name, &s, &twin.generator.symmetric(), round_off);
        assert_same(&name, &k, &twin.generator.skew(), round_off);
        let coupled = piece.matrix.inflow.iter().filter(|aux| aux.coupling != 0.0);
        let coupled = piece.communicator.space.sum_count(coupled.count());
        assert_eq!(coupled, twin.coupled.len(), "{name}");
        for (m, r) in piece.matrix.auxiliary(0, twin.case.enters()).enumerate() {
            let m = piece.number[piece.matrix.block.cells() + m];
            assert!((r - twin.state[m]).abs() <= 1e-14 * r.abs(), "{name}: {r}");
        }
        weighted_entry_for_entry(world, twin, mesh);
    });
}

fn weighted_entry_for_entry(world: &World, twin: &Twin, mesh: &ProcessMesh) {
    let name = format!("{}, {mesh:?}", twin.name);
    let weighted = Weighted::new(world, twin, mesh);
    let system = weighted.prepared.system;
    for (i, u) in system.states[0][..system.matrix.rows()].iter().enumerate() {
        let expected = weighted.state[weighted.number[i]];
        // The initial values of elements are a projection.
        let round_off = if twin.by_elements() { 1e-13 } else { 1e-14 };
        let close = (u - expected).abs() <= round_off * expected.abs();
        assert!(close, "{name}: {u} {expected}");
    }
    let piece = Piece::new(twin, Communicator::new(world, mesh), system.matrix);
    let (s, k) = piece.gather_matrix(world, twin);
    let tolerance = 1e-14 * weighted.generator.largest();
    assert_same(&name, &s, &weighted.generator.symmetric(), tolerance);
    assert_same(&name, &k, &weighted.generator.skew(), tolerance);
}

/// The products `A x`, `Aᵀ x` and `S x`.
pub fn application_of_all_parts(world: &World) {
    for_every_piece(world, |twin, mesh, piece| {
        let x = twin.noise(2);
        for (part, expected) in [
            (Operator::Generator, twin.generator.apply(&x)),
            (Operator::Transpose, twin.generator.transposed().apply(&x)),
            (Operator::Symmetric, twin.generator.symmetric().apply(&x)),
        ] {
            let image = piece.apply(part, &mut piece.scatter(&x));
            let found = piece.gather(twin, &image);
            let name = format!("{}, {mesh:?}, {part:?}", twin.name);
            assert_close(&name, &found, &expected, 1e-14 * twin.generator.largest());
            report_bits(world, &format!("{part:?} of {}", twin.name), &found);
        }
    });
}

/// `⟨y, A x⟩ = ⟨Aᵀ y, x⟩` for the distributed matrices.
pub fn adjoint(world: &World) {
    for_every_piece(world, |twin, mesh, piece| {
        let mut x = piece.scatter(&twin.noise(3));
        let mut y = piece.scatter(&twin.noise(4));
        let ax = piece.apply(Operator::Generator, &mut x);
        let aty = piece.apply(Operator::Transpose, &mut y);
        let ay = piece.apply(Operator::Generator, &mut y);
        let product = |a: &[f64], b: &[f64], sign: fn(f64) -> f64| {
            let rows = 0..piece.matrix.counted_rows();
            let terms: Vec<f64> = rows.map(|i| sign(a[i] * b[i])).collect();
            piece.communicator.space.sum_terms(&terms)
        };
        let (left, right) = (product(&y, &ax, |t| t), product(&aty, &x, |t| t));
        let scale = product(&y, &ax, f64::abs);
        let round_off = 1e-15 * scale * (twin.size() as f64).sqrt();
        let name = format!("{} {mesh:?}: {left} {right}", twin.name);
        assert!((left - right).abs() <= round_off, "{name}");
        // Control: the generator is not its own adjoint.
        assert!((left - product(&ay, &x, |t| t)).abs() > 1e-6 * scale, "{name}");
    });
}

/// Row `i` of a random complex vector in every lane, the same on any number of ranks.
fn complex_noise(i: usize, seed: u64) -> [Complex64; LANES] {
    let part = |l, seed| noise(i * LANES + l, seed);
    std::array::from_fn(|l| Complex64::new(part(l, seed), part(l, seed + 50)))
}

/// The same row of a batch: real parts, then imaginary parts.
fn lanes_of_noise(i: usize, seed: u64) -> [f64; 2 * LANES] {
    let values = complex_noise(i, seed);
    std::array::from_fn(|l| if l < LANES { values[l].re } else { values[l - LANES].im })
}

/// Constants of a step, which differ from lane to lane.
fn step_constants(seeds: [u64; 4]) -> StepConstants {
    let lane = |l: usize| std::array::from_fn::<f64, LANES, _>(|m| noise(m * 8 + l, seeds[l]));
    StepConstants {
        scale: lane(0),
        shift: lane(1),
        wavenumber: lane(2).map(|mu| 10.0 * mu),
        coefficient: lane(3),
    }
}

/// Seeds of the vectors of a step `y ← a ((−iμS + K) x + i c x) + y + coefficient · start`, where
/// the start is real, complex or missing: [`complex_noise`] for `y`, `x` and a complex start, and
/// real noise for a real start.
const Y: u64 = 20;
const X: u64 = 21;
const START: u64 = 22;
const REAL_START: u64 = 23;

/// One step against the dense formula, with every instruction set.
pub fn one_step(world: &World) {
    let constants = step_constants([5, 6, 7, 8]);
    for_every_piece(world, |twin, mesh, piece| {
        let name = format!("{}, {mesh:?}", twin.name);
        let vector = |seed| piece.batch(|i| lanes_of_noise(i, seed));
        let (y, mut x, start) = (vector(Y), vector(X), vector(START));
        let mut real = piece.reals(|i| noise(i, REAL_START));
        real.truncate(piece.matrix.rows());
        let nothing: &[()] = &[];
        let (mut plain, mut from_real, mut from_complex) = (y.clone(), y.clone(), y);
        let (matrix, exchange) = (&piece.matrix, &mut piece.exchange);
        matrix.step(exchange, &constants, None, &mut plain, &mut x, nothing);
        matrix.step(exchange, &constants, None, &mut from_real, &mut x, &real);
        matrix.step(exchange, &constants, None, &mut from_complex, &mut x, &start);
        let tolerance = 1e-14 * twin.generator.largest() * 10.0;
        for set in InstructionSet::all() {
            let mut other = piece.batch(|i| lanes_of_noise(i, Y));
            let rows = 0..piece.matrix.rows();
            set.run(LineStep {
                matrix: piece.matrix.stored(),
                lines: rows.clone(),
                constants: &constants,
                y: &mut other,
                x: &x,
                start: &start,
            });
            // Except for the row that is a sum over all ranks.
            for i in rows.filter(|&i| Some(i) != piece.matrix.shared_row()) {
                let name = format!("{name}, {set:?} row {i}");
                assert_close(&name, &other[i].0, &from_complex[i].0, tolerance);
            }
        }
        let expected = dense_step(twin, &constants);
        for (local, &i) in piece.number[..piece.matrix.rows()].iter().enumerate() {
            let complex_start = complex_noise(i, START);
            for l in 0..LANES {
                let coefficient = constants.coefficient[l];
                for (found, added) in [
                    (&plain, Complex64::ZERO),
                    (&from_real, noise(i, REAL_START).into()),
                    (&from_complex, complex_start[l]),
                ] {
                    let Lanes(row) = found[local];
                    let found = Complex64::new(row[l], row[LANES + l]);
                    let expected = expected[i][l] + coefficient * added;
                    let close = (found - expected).norm() <= tolerance;
                    assert!(close, "{name} row {i} lane {l}: {found} {expected}");
                }
            }
        }
    });
}

/// `a ((−iμS + K) x + i c x) + y` for every row and lane.
fn dense_step(twin: &Twin, constants: &StepConstants) -> Vec<[Complex64; LANES]> {
    let (s, k) = (twin.generator.symmetric(), twin.generator.skew());
    let x: Vec<[Complex64; LANES]> = (0..twin.size()).map(|i| complex_noise(i, X)).collect();
    let row = |i: usize| {
        let y = complex_noise(i, Y);
        std::array::from_fn(|l| {
            let mu = constants.wavenumber[l];
            let mut hx = Complex64::new(0.0, constants.shift[l]) * x[i][l];
            for (j, x) in x.iter().enumerate() {
                hx += Complex64::new(k.at(i, j), -mu * s.at(i, j)) * x[l];
            }
            constants.scale[l] * hx + y[l]
        })
    };
    (0..twin.size()).map(row).collect()
}

/// The largest number of steps in one pass through memory.
const LEVELS: usize = 7;

/// Several steps in one pass through memory give the same bits as single steps, for any shape of
/// the blocking: strips and ranges that do not divide the grid, more levels than cells, and passes
/// of fewer steps than the blocking allows; also with the inflow of a stage.
pub fn blocked_steps(world: &World) {
    let shapes = [(2, 1, 1), (3, 2, 1), (LEVELS, 1, 3), (LEVELS, 3, 2), (LEVELS, 100, 1000)];
    let levels: Vec<StepConstants> = (0..LEVELS as u64).map(constants_of_level).collect();
    let mut blocked = 0;
    for_every_piece(world, |twin, mesh, piece| {
        if !Blocking::possible(&piece.matrix) {
            assert!(piece.matrix.shared_row().is_some());
            return;
        }
        let couplings: Vec<f64> = (0..piece.matrix.inflow.len()).map(|m| noise(m, 6)).collect();
        for couplings in [None, Some(&couplings[..])] {
            let bits = |piece: &mut Piece,
                        blocking: Option<&Blocking>,
                        levels: &[StepConstants]| {
                let (matrix, exchange) = (&piece.matrix, &mut piece.exchange);
                bits_of_steps(matrix, exchange, blocking, &RecurrenceSteps { levels, couplings })
            };
            for (depth, width, parts) in shapes {
                let shape = BlockingShape { depth, width, parts };
                let blocking = Blocking::new(&piece.matrix, &shape);
                for levels in [&levels[..depth], &levels[..depth - 1]] {
                    let found = bits(piece, Some(&blocking), levels);
                    let same = found == bits(piece, None, levels);
                    let steps = levels.len();
                    assert!(same, "{} {mesh:?} {shape:?}, {steps} steps", twin.name);
                    blocked += 1;
                }
            }
            // Control: fewer steps give another result.
            let [all, fewer] =
                [LEVELS, LEVELS - 2].map(|steps| bits(piece, None, &levels[..steps]));
            assert!(all != fewer);
        }
    });
    assert!(blocked > 0);
}

/// The candidates that are planned for small caches give the same bits as single steps: ranges of
/// velocities, elements with a force in few cells or everywhere, other candidates on each rank.
///
/// On more than two ranks, each mesh is tested with two of the six pairs of caches, in turn, as
/// ranks that share a core wait for each other at every step.
pub fn planned_blockings(world: &World) {
    let pairs = [16e3, 64e3, 256e3].map(|own| [own, 8.0 * own].map(|last| Caches { own, last }));
    let apart = if world.group().size() > 2 { 3 } else { 1 };
    let settings = |degree: usize, potential: &str| {
        vec![format!("scheme.degree={degree}"), format!("potential=[{potential},{{value='0'}}]")]
    };
    let line = |degree: usize, [x, v]: [usize; 2], potential: &str| {
        let cells = [format!("axis.0.x.cells={x}"), format!("axis.0.v.cells={v}")];
        ("example1.toml", [settings(degree, potential), cells.to_vec()].concat())
    };
    let plane = |degree: usize, potential: &str| {
        let cells = [("0.x", 9), ("0.v", 6), ("1.x", 5), ("1.v", 6)];
        let cells = cells.map(|(axis, cells)| format!("axis.{axis}.cells={cells}"));
        ("barrier2d.toml", [settings(degree, potential), cells.to_vec()].concat())
    };
    let [step, few] = ["{where='x < 0',value='0.2'}", "{where='x < -0.9',value='x + 0.9'}"];
    let cases = [
        line(0, [41, 130], step),
        line(2, [23, 46], step),
        line(8, [22, 15], few),
        line(3, [31, 31], few),
        line(3, [20, 18], "{where='x < 2',value='x^2'}"),
        plane(0, few),
        plane(2, few),
    ];
    let levels: Vec<StepConstants> = (0..2 * MOST_LEVELS as u64).map(constants_of_level).collect();
    let mut found = [0; 3];
    for (c, (name, settings)) in cases.into_iter().enumerate() {
        let settings: Vec<&str> = settings.iter().map(String::as_str).collect();
        let case = case(name, &settings);
        for (m, mesh) in meshes(world, &case).into_iter().enumerate() {
            let communicator = Communicator::new(world, &mesh);
            let block = block_of(&case, &mesh, &communicator);
            let mut matrix = BlockMatrix::assemble(&case, block).expect("formulas are finite");
            matrix.gather_elements();
            let mut exchange = GhostExchange::new(&communicator.space, &matrix.block, 2 * LANES);
            let mut steps = |blocking: Option<&Blocking>| {
                let steps = RecurrenceSteps { levels: &levels, couplings: None };
                bits_of_steps(&matrix, &mut exchange, blocking, &steps)
            };
            let single = steps(None);
            let chosen = pairs.iter().flatten().skip((c + m) % apart).step_by(apart);
            for caches in chosen {
                let planned = FastestBlocking::planned_for(&matrix, 1 << 20, *caches);
                let blockings = planned.all().iter().flatten();
                found[0] += blockings.clone().count();
                found[1] += usize::from(blockings.clone().count() > 1);
                found[2] += blockings.filter(|b| b.shape().parts > 1).count();
                // Ranks have different candidates, and take as many steps with each.
                for blocking in planned.all().iter().cycle().take(4) {
                    let shape = blocking.as_ref().map(Blocking::shape);
                    let same = steps(blocking.as_ref()) == single;
                    assert!(same, "{name} {settings:?} {mesh:?}, {caches:?}: {shape:?}");
                }
            }
        }
    }
    assert!(found.iter().all(|count| *count > 0), "{found:?}");
}

/// The bits of two vectors after `steps`, in passes of the depth of `blocking`.
fn bits_of_steps(
    matrix: &BlockMatrix,
    exchange: &mut GhostExchange,
    blocking: Option<&Blocking>,
    steps: &RecurrenceSteps<'_>,
) -> [Vec<[u64; 2 * LANES]>; 2] {
    let rows = matrix.rows();
    let value = |i, seed| Lanes(std::array::from_fn(|l| noise(i, 100 * seed + l as u64)));
    let [mut y, mut x] = [1u64, 2].map(|seed| {
        let mut vector: Vec<Lanes> = (0..rows).map(|i| value(i, seed)).collect();
        vector.resize(matrix.length(), Lanes([f64::NAN; 2 * LANES]));
        vector
    });
    let start: Vec<f64> = (0..rows).map(|i| noise(i, 5)).collect();
    for levels in steps.levels.chunks(blocking.map_or(steps.levels.len(), Blocking::depth)) {
        let steps = RecurrenceSteps { levels, ..*steps };
        matrix.steps(exchange, blocking, &steps, &mut y, &mut x, &start);
    }
    [y, x].map(|v| v[..rows].iter().map(|row| row.0.map(f64::to_bits)).collect())
}

fn constants_of_level(level: u64) -> StepConstants {
    let lane = |seed| std::array::from_fn::<f64, LANES, _>(|l| noise(l, 10 * level + seed));
    StepConstants {
        scale: lane(1).map(|a| 0.01 * a),
        shift: lane(2),
        wavenumber: lane(3),
        coefficient: lane(4),
    }
}
