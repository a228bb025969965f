//! Order of convergence, the potential on the grid, and periodic axes.

use super::Lattice;
use super::paper::assert_same_system;
use super::{ROUND_OFF, scenes};
use crate::dense::{System, case, order_of};
use phasewarp::matrix::bounds::Bounds;
use phasewarp::problem::case::Case;
use phasewarp::problem::exact::Tracer;
use phasewarp::problem::potential::Potential;
use phasewarp::scheme::rows::{Row, Scheme};

/// The nonzero entries of `A`, row by row.
fn rows(case: &Case) -> Vec<Vec<(usize, f64)>> {
    let scheme = Scheme::whole(case).expect("V is finite");
    let mut row = Row::default();
    (0..case.space.cells())
        .map(|i| {
            scheme.row(&mut row, i);
            row.entries.clone()
        })
        .collect()
}

/// A cloud in a harmonic potential turns about the origin: the error is of first order.
#[test]
fn first_order_convergence_without_a_jump() {
    const TIME: f64 = 0.5;
    let cloud = |x: f64, v: f64| (-((x - 0.4).powi(2) + (v + 0.2).powi(2)) / 0.5).exp();
    let errors: Vec<f64> = [32, 64, 128]
        .into_iter()
        .map(|cells| {
            let axis = format!("{{ lower = -4.0, upper = 4.0, cells = {cells} }}");
            let text = format!(
                "[[axis]]\nx = {axis}\nv = {axis}\n[[potential]]\nvalue = \"x^2/2\"\n\
                 [initial]\nf = \"0\"\n[time]\nend = {TIME}\n"
            );
            let case = Case::parse("turning cloud", &text, &[]).expect("a good case");
            // The exact solution of x' = v, v' = −x.
            error_in_l1(&case, TIME, |[x, _, _, v, _, _], time| {
                let (s, c) = time.sin_cos();
                cloud(c * x - s * v, s * x + c * v)
            })
        })
        .collect();
    assert_first_order(&errors);
}

/// Fails unless errors on grids, each twice as fine as the one before, are of first order.
fn assert_first_order(errors: &[f64]) {
    for pair in errors.windows(2) {
        let order = order_of([pair[0], pair[1]], 2.0);
        assert!((0.8..1.2).contains(&order), "order {order}: {errors:?}");
    }
}

/// Slopes and jumps of the potential on the grid are those of the formulas, and the jump at a face
/// is the same from both cells.
#[test]
fn slopes_and_jumps_of_the_potential_are_those_of_its_formulas() {
    for scene in scenes() {
        let space = &scene.case.space;
        let found = Potential::whole(&scene.case).expect("V is finite");
        let mut jumps = 0;
        for index in (0..space.cells()).step_by(space.velocity_cells()) {
            let cell = space.cell(index);
            for (a, axis) in space.x.iter().enumerate() {
                let lattice = Lattice::new(axis);
                let point = |i: i64| {
                    let mut centre = [0.0; 3];
                    for (b, other) in space.x.iter().enumerate() {
                        centre[b] = Lattice::new(other).centre(cell[b] as i64);
                    }
                    centre[a] = lattice.centre(i);
                    centre
                };
                let value = |i: i64, face: i64| {
                    let mut at = point(i);
                    at[a] = lattice.lower_face(face);
                    (scene.potential)(point(i), at)
                };
                let i = cell[a] as i64;
                let close =
                    |x: f64, y: f64| assert!((x - y).abs() < 1e-14, "{}: {x} {y}", scene.name);
                close(found.slope(&cell, a) * lattice.width, value(i, i + 1) - value(i, i));
                let n = lattice.cells;
                let (first, last) = (i == 0, i + 1 == n);
                let below = match (first, space.is_periodic(a)) {
                    (false, _) => value(i, i) - value(i - 1, i),
                    (true, false) => 0.0,
                    (true, true) => value(0, 0) - value(n - 1, n),
                };
                close(found.jump_below(&cell, a), below);
                let above = match (last, space.is_periodic(a)) {
                    (false, _) => value(i + 1, i + 1) - value(i, i + 1),
                    (true, false) => 0.0,
                    (true, true) => value(0, 0) - value(n - 1, n),
                };
                close(found.jump_above(&cell, a), above);
                jumps += usize::from(below.abs() > 0.01);
            }
        }
        let largest = found.largest_jumps(space);
        assert!(jumps > 0 && largest.iter().any(Option::is_some), "{}", scene.name);
    }
}

/// With a constant potential, each velocity has the circulant matrix of upwind transport: `−c` on
/// the diagonal, and `c` from the upwind cell, also around the end.
#[test]
fn transport_around_a_periodic_axis_is_a_circulant() {
    for cells in [1, 2, 3, 7] {
        let text = format!(
            "[[axis]]\n\
             x = {{ lower = -0.4, upper = 1.0, cells = {cells}, boundary = 'periodic' }}\n\
             v = {{ lower = -1.0, upper = 1.5, cells = 5 }}\n[[potential]]\nvalue = '0.3'\n\
             [initial]\nf = '0'\n[inflow]\nvalue = '1'\n[time]\nend = 1.0\n"
        );
        let case = Case::parse("circulant", &text, &[]).expect("a good case");
        let found = System::of_rows(&case);
        let (h, v) = (1.4 / cells as f64, [-0.75, -0.25, 0.25, 0.75, 1.25f64]);
        let mut expected = System::zero(5 * cells);
        for i in 0..cells {
            for (j, v) in v.iter().enumerate() {
                let behind = (i + if *v > 0.0 { cells - 1 } else { 1 }) % cells;
                let rate = v.abs() / h;
                expected.generator.add(5 * i + j, 5 * i + j, -rate);
                expected.generator.add(5 * i + j, 5 * behind + j, rate);
            }
        }
        // The columns sum to zero, as the number of particles is conserved.
        assert_same_system(&format!("{cells} cells"), &found, &expected);
        assert!(found.inflow.iter().chain(&found.inflow_rate).all(|b| *b == 0.0));
        for j in 0..5 * cells {
            let sum: f64 = (0..5 * cells).map(|i| found.generator.at(i, j)).sum();
            assert!(sum.abs() < 1e-13, "column {j}: {sum}");
        }
    }
}

/// If the potential does not vary along a periodic axis, `A` is invariant under translation along
/// it, to the last bit.
#[test]
fn rows_are_invariant_under_translation_along_a_periodic_axis() {
    for interface in ["hat", "conservative"] {
        let settings = [
            "axis.0.x.cells=6",
            "axis.0.v.cells=6",
            "axis.1.v.cells=4",
            "potential.0.value='0.1*x'",
            &format!("scheme.interface='{interface}'"),
        ];
        let case = case("periodic2d.toml", &settings);
        let space = &case.space;
        let all = rows(&case);
        let cells = space.x[1].cells;
        let moved = |index: usize, by: usize| {
            let mut cell = space.cell(index);
            cell[1] = (cell[1] + by) % cells;
            space.index(&cell)
        };
        for (i, row) in all.iter().enumerate() {
            for by in [1, 3, cells - 1] {
                let mut expected: Vec<_> = row.iter().map(|&(j, a)| (moved(j, by), a)).collect();
                expected.sort_unstable_by_key(|e| e.0);
                assert_eq!(all[moved(i, by)], expected, "{interface}: row {i} by {by}");
            }
        }
    }
}

/// With the conservative interface and periodic axes, columns sum to zero unless velocities leave
/// the box.
#[test]
fn a_conservative_interface_around_a_periodic_axis_keeps_the_mass() {
    let step = "example1.toml";
    let size = [
        "axis.0.x={lower=-1.5,upper=1.5,cells=6,boundary='periodic'}",
        "axis.0.v.cells=24",
        "scheme.interface='conservative'",
    ];
    let found = System::of_rows(&case(step, &size)).generator;
    let scale = found.largest();
    let mut kept = 0;
    for j in 0..found.size {
        let sum: f64 = (0..found.size).map(|i| found.at(i, j)).sum();
        // The jump may carry the 6 fastest of 24 velocities at each end out of the box, but no
        // others: √(0.75² + 0.4) is far inside.
        if (6..18).contains(&(j % 24)) {
            assert!(sum.abs() < ROUND_OFF * scale, "column {j}: {sum}");
            kept += 1;
        }
    }
    assert_eq!(kept, 72);
    // Control: with open ends, mass leaves the box.
    let ends = ["axis.0.x.cells=6", size[1], size[2]];
    let open = System::of_rows(&case(step, &ends)).generator;
    let lost = |j: usize| (0..open.size).map(|i| open.at(i, j)).sum::<f64>();
    assert!((0..open.size).any(|j| (6..18).contains(&(j % 24)) && lost(j) < -0.1 * scale));
}

/// A bump that crosses the end of a periodic axis, in a smooth potential, converges to the exact
/// solution with first order.
#[test]
fn first_order_convergence_around_a_periodic_axis() {
    const TIME: f64 = 0.8;
    let errors: Vec<f64> = [64, 128, 256]
        .into_iter()
        .map(|cells| {
            let text = format!(
                "[[axis]]\n\
                 x = {{ lower = -0.5, upper = 0.5, cells = {cells}, boundary = 'periodic' }}\n\
                 v = {{ lower = 0.2, upper = 1.8, cells = {} }}\n\
                 [[potential]]\nvalue = '0.03*cos(2*pi*x)'\n\
                 [initial]\nf = 'exp(cos(2*pi*(x - 0.2)) - ((v - 1)/0.25)^2)'\n\
                 [time]\nend = {TIME}\n",
                cells / 2
            );
            let case = Case::parse("bump", &text, &[]).expect("a good case");
            let tracer = Tracer::new(&case).expect("V is finite");
            error_in_l1(&case, TIME, |p, time| tracer.value(p, time))
        })
        .collect();
    assert_first_order(&errors);
}

/// Two smooth beams through a step, one up and one down, converge to the exact solution with order
/// `k + 1`.
#[test]
fn beams_through_a_step_converge_with_order_k_plus_1() {
    for (degree, coarse) in [(1, 112), (2, 26), (3, 16), (4, 14)] {
        for flux in [0.5, 1.0] {
            let errors =
                [coarse, 2 * coarse].map(|elements| error_of_beams(degree, flux, elements));
            let order = order_of(errors, 2.0);
            println!("degree {degree}, flux {flux}: order {order:.2}, errors {errors:?}");
            let least = degree as f64 + 0.7;
            assert!(order > least, "degree {degree}, flux {flux}: order {order}, {errors:?}");
        }
    }
}

/// The relative L2 error of the beams on `elements` elements per axis.
fn error_of_beams(degree: usize, flux: f64, elements: usize) -> f64 {
    const TIME: f64 = 0.7;
    let axis = |half: f64| format!("{{ lower = -{half}, upper = {half}, cells = {elements} }}");
    let text = format!(
        "[scheme]\ndegree = {degree}\nflux = {flux}\n[[axis]]\nx = {}\nv = {}\n\
         [[potential]]\nwhere = 'x < 0'\nvalue = '0.2'\n[[potential]]\nvalue = '0'\n\
         [initial]\nf = 'exp(-((x + 0.5)^2 + (v - 0.75)^2)/0.025) + \
         exp(-((x - 0.5)^2 + (v + 1.1)^2)/0.02)'\n[time]\nend = {TIME}\n",
        axis(1.0),
        axis(1.6)
    );
    let case = Case::parse("beams", &text, &[]).expect("a good case");
    let tracer = Tracer::new(&case).expect("V is finite");
    error_of(&case, TIME, |p, time| tracer.value(p, time))
}

/// The solution after `time` that starts from `exact` at time zero, and the exact one, by nodes.
fn compared(case: &Case, time: f64, exact: impl Fn(&[f64; 6], f64) -> f64) -> [Vec<f64>; 2] {
    let space = &case.space;
    let at = |time: f64| {
        let cells = 0..space.cells();
        cells.map(|i| exact(&space.inner_point(&space.cell(i)), time)).collect::<Vec<f64>>()
    };
    [evolved(case, &rows(case), at(0.0), time), at(time)]
}

/// The relative L2 error after `time` of the solution that starts from `exact` at time zero.
fn error_of(case: &Case, time: f64, exact: impl Fn(&[f64; 6], f64) -> f64) -> f64 {
    let [found, exact] = compared(case, time, exact);
    let mut sums = [0.0; 2];
    for (i, (found, exact)) in found.iter().zip(&exact).enumerate() {
        let volume = case.space.relative_volume(&case.space.cell(i));
        sums[0] += volume * (found - exact).powi(2);
        sums[1] += volume * exact.powi(2);
    }
    (sums[0] / sums[1]).sqrt()
}

/// The L1 error of the same, on cells of degree 0.
fn error_in_l1(case: &Case, time: f64, exact: impl Fn(&[f64; 6], f64) -> f64) -> f64 {
    let [found, exact] = compared(case, time, exact);
    let difference: f64 = found.iter().zip(&exact).map(|(f, exact)| (f - exact).abs()).sum();
    difference * case.space.cell_volume()
}

/// A beam in two dimensions, which turns in a harmonic potential along x and streams along y,
/// converges with order `k + 1`.
#[test]
fn a_beam_in_two_dimensions_converges_with_order_k_plus_1() {
    const TIME: f64 = 0.6;
    let mut orders = Vec::new();
    for (degree, coarse) in [(1, [24, 12]), (2, [10, 4]), (3, [6, 4])] {
        let errors = [2, 3].map(|finer| {
            let [turning, streaming] = coarse.map(|elements| elements * finer / 2);
            let box_of = |half: f64, cells: usize| {
                format!("lower = -{half}, upper = {half}, cells = {cells}")
            };
            let text = format!(
                "[scheme]\ndegree = {degree}\nflux = 1.0\n\
                 [[axis]]\nx = {{ {turning} }}\nv = {{ {turning} }}\n\
                 [[axis]]\nx = {{ {}, boundary = 'periodic' }}\n\
                 v = {{ lower = 0.2, upper = 1.2, cells = 1 }}\n\
                 [[potential]]\nvalue = 'x^2/2'\n[initial]\nf = '1'\n[time]\nend = {TIME}\n",
                box_of(1.0, streaming),
                turning = box_of(1.8, turning),
            );
            error_of(&Case::parse("beam", &text, &[]).expect("a good case"), TIME, beam)
        });
        let order = order_of(errors, 1.5);
        println!("degree {degree}: order {order:.2}, errors {errors:?}");
        orders.push((order - (degree + 1) as f64).abs());
    }
    assert!(orders.iter().all(|off| *off < 0.3), "off by {orders:?}");
}

/// The exact beam at `time`.
fn beam(point: &[f64; 6], time: f64) -> f64 {
    let [x, y, _, vx, vy, _] = *point;
    let (sin, cos) = time.sin_cos();
    let [x, vx, y] = [x * cos - vx * sin, vx * cos + x * sin, y - vy * time];
    (-4.0 * ((x - 0.2).powi(2) + (vx + 0.1).powi(2))).exp()
        * (1.0 + 0.5 * (std::f64::consts::PI * y + x).sin())
}

/// A beam in two dimensions that goes down a step along x and streams along y converges to the
/// exact solution with order `k + 1` for degree `k = 2`. Degrees 1 and 3 need grids that take too
/// long here (`docs/verification.md`).
#[test]
fn a_beam_down_a_step_in_two_dimensions_converges_with_order_3() {
    let errors = [[16, 4], [24, 6]].map(|[falling, streaming]| {
        let text = format!(
            "[scheme]\ndegree = 2\nflux = 1.0\n\
             [[axis]]\nx = {{ lower = -1.6, upper = 1.6, cells = {falling} }}\n\
             v = {{ lower = -1.8, upper = 1.8, cells = {falling} }}\n\
             [[axis]]\n\
             x = {{ lower = -1, upper = 1, cells = {streaming}, boundary = 'periodic' }}\n\
             v = {{ lower = 0.6, upper = 0.7, cells = 1 }}\n\
             [[potential]]\nwhere = 'x < 0'\nvalue = '0.2'\n[[potential]]\nvalue = '0'\n\
             [initial]\n\
             f = 'exp(-((x + 0.85)^2 + (vx - 0.9)^2)/0.06)*(1 + 0.5*sin(pi*y + x))'\n\
             [time]\nend = 0.9\n"
        );
        let case = Case::parse("beam", &text, &[]).expect("a good case");
        let tracer = Tracer::new(&case).expect("V is finite");
        error_of(&case, case.end, |p, time| tracer.value(p, time))
    });
    let order = order_of(errors, 1.5);
    println!("order {order:.2}, errors {errors:?}");
    assert!((order - 3.0).abs() < 0.3, "order {order}, {errors:?}");
}

/// For degree 2 and more the energy `v²/2 + V` is conserved inside the box, also at a step. For
/// degree 1 it is not.
#[test]
fn energy_is_conserved_from_degree_2_on() {
    for degree in [1, 2, 3, 5] {
        for flux in [0.0, 0.4, 1.0] {
            let settings = [
                "axis.0.x.cells=4",
                "axis.0.v.cells=6",
                "scheme.interface='conservative'",
                &format!("scheme.degree={degree}"),
                &format!("scheme.flux={flux}"),
            ];
            let case = case("example1.toml", &settings);
            let (space, a) = (&case.space, System::of_rows(&case).generator);
            let energy = |i: usize| {
                let p = space.point(&space.cell(i));
                let below = space.x[0].element_of(space.cell(i)[0] as i64) < 2;
                space.relative_volume(&space.cell(i))
                    * (0.5 * p[3] * p[3] + if below { 0.2 } else { 0.0 })
            };
            let mut worst = 0.0f64;
            for j in 0..a.size {
                let cell = space.cell(j);
                let (element, v) = (space.x[0].element_of(cell[0] as i64), space.point(&cell)[3]);
                // Outflow through an end of the box; the step carries the fastest particles out of
                // it, too.
                let leaves = element == if v > 0.0 { 3 } else { 0 };
                if leaves || space.v[0].element_of(cell[1] as i64) % 5 == 0 {
                    continue;
                }
                let change: f64 = (0..a.size).map(|i| energy(i) * a.at(i, j)).sum();
                worst = worst.max(change.abs());
            }
            let at = format!("degree {degree}, flux {flux}: {worst:e} of {}", a.largest());
            let kept = worst < 1e-13 * a.largest();
            assert_eq!(kept, degree > 1, "{at}");
        }
    }
}

/// `exp(A time) f` by the classical Runge–Kutta method. Its steps are so short that their error is
/// far below that in space.
fn evolved(case: &Case, matrix: &[Vec<(usize, f64)>], mut f: Vec<f64>, time: f64) -> Vec<f64> {
    let steps = (Bounds::new(case).expect("V is finite").rate * time).ceil();
    let dt = time / steps;
    for _ in 0..steps as usize {
        let mut stage = f.clone();
        for k in [4.0, 3.0, 2.0, 1.0] {
            let apply =
                |row: &Vec<(usize, f64)>| -> f64 { row.iter().map(|&(j, a)| a * stage[j]).sum() };
            let change: Vec<f64> = matrix.iter().map(apply).collect();
            stage = f.iter().zip(&change).map(|(f, a)| f + dt / k * a).collect();
        }
        f = stage;
    }
    f
}
