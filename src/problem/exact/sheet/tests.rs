//! Exact densities against closed forms, counted particles, and the way back.

use super::*;
use crate::problem::exact::sheet::sums::{ExactMoments, MultivaluedVelocity, SheetSums};

/// A case with measure-valued data and the same axes in each of `n` dimensions.
#[derive(Clone, Copy)]
struct Scene<'a> {
    n: usize,
    lower: f64,
    upper: f64,
    cells: usize,
    /// Condition and value of each region of `V`.
    potential: &'a [(&'a str, &'a str)],
    density: &'a str,
    velocity: &'a [&'a str],
    inflow: &'a str,
    end: f64,
}

/// A uniform beam at rest, in one dimension without forces.
const BEAM: Scene<'static> = Scene {
    n: 1,
    lower: -1.0,
    upper: 1.0,
    cells: 8,
    potential: &[("", "0")],
    density: "1",
    velocity: &["0"],
    inflow: "initial",
    end: 1.0,
};

impl Scene<'_> {
    fn case(&self) -> Case {
        let Self { lower, upper, cells, density, velocity, inflow, end, .. } = self;
        let axis = format!(
            "[[axis]]\nx = {{ lower = {lower:?}, upper = {upper:?}, cells = {cells} }}\n\
             v = {{ lower = -2.0, upper = 2.0, cells = 4 }}\n"
        );
        let mut text = axis.repeat(self.n);
        for (condition, value) in self.potential {
            text += &format!("[[potential]]\nvalue = \"{value}\"\n");
            if !condition.is_empty() {
                text += &format!("where = \"{condition}\"\n");
            }
        }
        text += &format!(
            "[initial]\ndensity = \"{density}\"\nvelocity = {velocity:?}\n\
             [inflow]\nvalue = \"{inflow}\"\n[time]\nend = {end:?}\n"
        );
        Case::parse("test", &text, &[]).unwrap_or_else(|e| panic!("{e}\n{text}"))
    }
}

/// The exact moments on the whole space grid.
fn exact_moments(case: &Case) -> Result<ExactMoments> {
    let mut sheets = Sheets::new(case)?;
    let whole = case.space.space_ranges();
    let mut sums = SheetSums::new(&case.space, &whole);
    let mut budget = sheets.budget();
    for sheet in sheets.all() {
        let found = sheets.follow_boxes(sheet, 0..sheets.boxes(sheet), budget)?;
        found.deposits.iter().for_each(|deposit| sums.add(deposit));
        found.lines.iter().for_each(|line| sums.draw(line));
        budget = budget.less(found.added);
    }
    let largest = sums.largest();
    Ok(sums.finish(largest))
}

fn exact(case: &Case) -> ExactMoments {
    exact_moments(case).unwrap_or_else(|e| panic!("{e}"))
}

/// A beam between two places.
struct Beam {
    from: f64,
    to: f64,
    density: f64,
    velocity: f64,
}

const fn piece(from: f64, to: f64, density: f64, velocity: f64) -> Beam {
    Beam { from, to, density, velocity }
}

/// Density and momentum of `pieces`, averaged over the cells of `axis`.
fn averages(axis: &Axis, pieces: &[Beam]) -> Vec<(f64, f64)> {
    (0..axis.cells as i64)
        .map(|i| {
            let (lower, upper) = (axis.face(i), axis.face(i + 1));
            pieces.iter().fold((0.0, 0.0), |(rho, m), piece| {
                let inside = (piece.to.min(upper) - piece.from.max(lower)).max(0.0);
                let density = inside / (upper - lower) * piece.density;
                (rho + density, m + density * piece.velocity)
            })
        })
        .collect()
}

/// Time at which the straight beams are compared.
const BEAM_TIME: f64 = 0.7;

/// The exact moments of a straight beam are those of `pieces`.
fn check_beam(scene: Scene<'_>, pieces: &[Beam]) {
    let case = Scene { cells: 14, end: BEAM_TIME, ..scene }.case();
    let found = exact(&case);
    let expected = averages(&case.space.x[0], pieces);
    for (i, &(rho, m)) in expected.iter().enumerate() {
        let (r, u) = (found.density[i], found.velocity[0][i]);
        let what = format!("{}, {:?}, {}, cell {i}", scene.density, scene.velocity, scene.inflow);
        assert!((r - rho).abs() < 1e-7, "{what}: {r} {rho}");
        let close = if rho == 0.0 { u.is_nan() } else { (u - m / rho).abs() < 1e-6 };
        assert!(close, "{what}: {u}");
    }
}

/// Straight beams in one dimension without forces: what enters, or does not, is behind them.
#[test]
fn free_beams_have_their_closed_form() {
    let moved = 0.9 * BEAM_TIME;
    let fast = Scene { velocity: &["0.9"], ..BEAM };
    check_beam(fast, &[piece(-1.0, 1.0, 1.0, 0.9)]);
    let half = Scene { inflow: "0.5", ..fast };
    let front = -1.0 + moved;
    check_beam(half, &[piece(-1.0, front, 0.5, 0.9), piece(front, 1.0, 1.0, 0.9)]);
    let backwards = Scene { velocity: &["-0.9"], inflow: "0", ..BEAM };
    check_beam(backwards, &[piece(-1.0, 1.0 - moved, 1.0, -0.9)]);
    // Velocities jump inside a cell.
    let two = Scene { velocity: &["0.3 if x < 0.0321 else 0.8"], ..BEAM };
    let [slow, fast] = [0.3, 0.8].map(|v| 0.0321 + v * BEAM_TIME);
    check_beam(two, &[piece(-1.0, slow, 1.0, 0.3), piece(fast, 1.0, 1.0, 0.8)]);
    // At rest, and outside of the velocity box.
    check_beam(BEAM, &[piece(-1.0, 1.0, 1.0, 0.0)]);
    let outside = Scene { velocity: &["2.1"], ..BEAM };
    check_beam(outside, &[]);
}

/// Beams that come from the left over a step, down and up, or are turned back by it.
#[test]
fn beams_over_steps_have_their_closed_form() {
    let left = Scene { density: "1 if x < 0 else 0", velocity: &["0.9"], ..BEAM };
    let down = Scene { potential: &[("x < 0", "0.2"), ("", "0")], ..left };
    let up = Scene { potential: &[("x < 0", "0"), ("", "0.2")], ..left };
    for (scene, beyond) in [(down, 1.21f64.sqrt()), (up, 0.41f64.sqrt())] {
        let transmitted = piece(0.0, beyond * BEAM_TIME, 0.9 / beyond, beyond);
        check_beam(scene, &[piece(-1.0, 0.0, 1.0, 0.9), transmitted]);
    }
    let slow = Scene { velocity: &["0.5"], ..up };
    let reflected = piece(-0.5 * BEAM_TIME, 0.0, 1.0, -0.5);
    check_beam(slow, &[piece(-1.0, 0.0, 1.0, 0.5), reflected]);
}

/// Linear velocities: `x = (1 + aT) x0`; for a below −1/T the beam has turned inside out.
#[test]
fn linear_velocities_have_their_closed_form() {
    let linear = |velocity| Scene { cells: 9, velocity, ..BEAM };
    let wide = linear(&["0.3*x"]).case();
    let found = exact(&wide);
    let axis = wide.space.x[0].clone();
    for (i, x) in axis.centres().into_iter().enumerate() {
        assert!((found.density[i] - 1.0 / 1.3).abs() < 1e-8);
        assert!((found.velocity[0][i] - 0.3 * x / 1.3).abs() < 1e-4);
    }
    // x = −x0/2, and what enters at both ends with the velocity 1.5 inwards.
    let found = exact(&linear(&["-1.5*x"]).case());
    let pieces =
        [piece(-0.5, 0.5, 2.0, 0.0), piece(-1.0, 0.5, 1.0, 1.5), piece(-0.5, 1.0, 1.0, -1.5)];
    for (i, (rho, _)) in averages(&axis, &pieces).into_iter().enumerate() {
        assert!((found.density[i] - rho).abs() < 1e-7, "{i}: {} {rho}", found.density[i]);
    }
    let curve = found.curve.expect("one dimension");
    // One branch, from the lower end to the upper, three times over the middle.
    assert_eq!(curve.branch.last(), Some(&0.0));
    let mut found = curve_velocity(&curve, 0.31, 0.0);
    found.sort_by(f64::total_cmp);
    assert_eq!(found.len(), 3, "{found:?}");
    for (v, expected) in found.iter().zip([-1.5, 3.0 * 0.31, 1.5]) {
        assert!((v - expected).abs() < 1e-7, "{found:?}");
    }
}

/// Velocities at which branch `branch` passes `x`.
fn curve_velocity(curve: &MultivaluedVelocity, x: f64, branch: f64) -> Vec<f64> {
    (1..curve.x.len())
        .filter(|&i| curve.branch[i] == branch && curve.branch[i - 1] == branch)
        .filter(|&i| (curve.x[i - 1] - x) * (curve.x[i] - x) < 0.0)
        .map(|i| {
            let t = (x - curve.x[i - 1]) / (curve.x[i] - curve.x[i - 1]);
            curve.v[i - 1] + t * (curve.v[i] - curve.v[i - 1])
        })
        .collect()
}

/// A constant force: the same acceleration for all particles, no inflow at rest.
#[test]
fn constant_force() {
    let slope = Scene { cells: 10, potential: &[("", "0.5*x")], ..BEAM }.case();
    let found = exact(&slope);
    let axis = &slope.space.x[0];
    let expected = averages(axis, &[piece(-1.0, 0.75, 1.0, -0.5)]);
    for (i, (rho, _)) in expected.into_iter().enumerate() {
        assert!((found.density[i] - rho).abs() < 1e-7, "{i}");
        assert!(rho == 0.0 || (found.velocity[0][i] + 0.5).abs() < 1e-7);
    }
}

/// The curve of a beam that spreads, `v = a + bx`, and leaves the box: `ρ = 1/(1 + bt)` up to the
/// point that has just left.
#[test]
fn densities_beside_an_exit_are_those_of_the_beam() {
    for velocity in ["0.1*x", "0.3 + 0.1*x", "-0.2 + 0.1*x"] {
        let velocity = &[velocity][..];
        let beam = Scene { velocity, cells: 20, inflow: "0", end: 0.5, ..BEAM }.case();
        let curve = exact(&beam).curve.expect("one dimension");
        assert!(curve.density.len() > 200, "{} points", curve.density.len());
        for (x, density) in curve.x.iter().zip(&curve.density) {
            assert!((density * 1.05 - 1.0).abs() < 1e-3, "{velocity:?}: {density} at {x}");
        }
    }
}

/// Where the initial density jumps, the curve goes on: `v = 3x` is one branch.
#[test]
fn a_jump_of_the_density_does_not_part_the_curve() {
    let density = "1 if x < 0.0123 else 2";
    let fan = Scene { velocity: &["3*x"], density, inflow: "0", end: 2.0, ..BEAM }.case();
    let curve = exact(&fan).curve.expect("one dimension");
    assert!(curve.branch.iter().all(|branch| *branch == 0.0), "{:?}", curve.branch.last());
    let densities = |x: f64| if x < 0.0123 * 7.0 { 1.0 / 7.0 } else { 2.0 / 7.0 };
    let off = |(x, density): &(&f64, &f64)| (*density - densities(**x)).abs() > 1e-3;
    // The piece with the jump has a density between both.
    assert!(curve.x.iter().zip(&curve.density).filter(off).count() <= 2);
}

/// Folds: masses of cells against ten million particles counted one by one, in free flight.
#[test]
fn folds_hold_the_mass_that_is_counted() {
    let (time, cells) = (0.9, 24);
    let folded = Scene {
        lower: -1.5,
        upper: 1.5,
        cells,
        density: "1 + 0.5*cos(x)",
        velocity: &["-0.8*sin(3*x)"],
        inflow: "0",
        end: time,
        ..BEAM
    }
    .case();
    let found = exact(&folded);
    let mut counted = vec![0.0; cells];
    let particles = 10_000_000;
    for k in 0..particles {
        let x0 = -1.5 + 3.0 * (k as f64 + 0.5) / particles as f64;
        let x = x0 - 0.8 * (3.0 * x0).sin() * time;
        if x.abs() < 1.5 {
            counted[(((x + 1.5) / 0.125) as usize).min(cells - 1)] +=
                3.0 / particles as f64 * (1.0 + 0.5 * x0.cos()) / 0.125;
        }
    }
    let mut total = 0.0;
    for (i, (rho, expected)) in found.density.iter().zip(&counted).enumerate() {
        assert!((rho - expected).abs() < 2e-3 * expected.max(1.0), "{i}: {rho} {expected}");
        total += (rho - expected).abs() * 0.125;
    }
    assert!(total < 1e-3, "{total}");
    // Neighbouring cells differ: the test could fail.
    assert!(counted.iter().fold(0.0, |m: f64, r| m.max(*r)) > 2.0);
}

/// The paper's closed form of example 3, counted on a lattice of 200 points a cell and axis.
#[test]
fn example_3_has_the_density_of_the_paper() {
    let text = std::fs::read_to_string(concat!(env!("CARGO_MANIFEST_DIR"), "/cases/example3.toml"))
        .unwrap();
    let case = Case::parse("example3.toml", &text, &[]).unwrap();
    let found = exact(&case);
    let front = 14.0 / 150.0;
    let rho = |x: f64, y: f64| {
        if x < 0.0 || y < 0.0 {
            1.0
        } else if x <= front && y >= 1.5 * x || y <= front && y <= 2.0 * x / 3.0 {
            1.5
        } else {
            0.0
        }
    };
    let fine = 200;
    for i in 0..8 {
        for j in 0..8 {
            let at = |i: usize, k: usize| -0.2 + 0.05 * (i as f64 + (k as f64 + 0.5) / fine as f64);
            let sum: f64 = (0..fine)
                .flat_map(|k| (0..fine).map(move |l| (k, l)))
                .map(|(k, l)| rho(at(i, k), at(j, l)))
                .sum();
            let expected = sum / (fine * fine) as f64;
            let value = found.density[8 * i + j];
            assert!((value - expected).abs() < 0.01, "{i} {j}: {value} {expected}");
        }
    }
}

/// A beam oblique to a step in space; it fills the box from the ends.
#[test]
fn oblique_beam_over_a_step_in_space() {
    let time = 0.4;
    let case = Scene {
        n: 3,
        lower: -0.5,
        upper: 0.5,
        cells: 6,
        potential: &[("x < 0", "0"), ("", "0.1")],
        density: "1 if x < 0 else 0",
        velocity: &["0.6", "0.3", "-0.2"],
        end: time,
        ..BEAM
    }
    .case();
    let found = exact(&case);
    let pieces = [piece(-0.5, 0.0, 1.0, 0.6), piece(0.0, 0.4 * time, 1.5, 0.4)];
    let expected = averages(&case.space.x[0], &pieces);
    let mut total = 0.0;
    for (k, &rho) in found.density.iter().enumerate() {
        let (e, m) = expected[k / 36];
        // Behind the step there is no inflow through the lower end of y and the upper end of z.
        if k / 6 % 6 == 0 || k % 6 == 5 {
            continue;
        }
        total += (rho - e).abs() / found.density.len() as f64;
        // Torn boxes are sixteenths of a cell, counted whole or not: 1/32 for each of two surfaces
        // that meet in a cell.
        assert!((rho - e).abs() < 2.0 / 32.0 * e.max(1.0), "{k}: {rho} {e}");
        if e > 0.0 {
            let u: Vec<f64> = (0..3).map(|a| found.velocity[a][k]).collect();
            let right = (u[0] - m / e).abs() < 0.01
                && (u[1] - 0.3).abs() < 1e-12
                && (u[2] + 0.2).abs() < 1e-12;
            assert!(right, "{k}: {u:?}");
        }
    }
    assert!(total < 5e-3, "{total}");
}

/// Forward and back again, over slopes and jumps, with histories that identify the jumps.
#[test]
fn the_way_forward_is_the_way_back() {
    let scene = Scene {
        n: 2,
        cells: 10,
        potential: &[("x < 0.2", "0.3*x + 0.1*y"), ("y > 0", "0.4"), ("", "0.1*x")],
        velocity: &["0", "0"],
        ..BEAM
    }
    .case();
    let back = Tracer::new(&scene).unwrap();
    let forward = back.clone().forward();
    let (mut stayed, mut histories) = (0, std::collections::BTreeSet::new());
    for k in 0..500 {
        let part = |step: f64| (k as f64 * step).fract();
        let point = [
            1.8 * part(0.754_877_67) - 0.9,
            1.8 * part(0.569_840_29) - 0.9,
            0.0,
            1.6 * part(0.430_159_7) - 0.8,
            1.6 * part(0.324_717_9) - 0.8,
            0.0,
        ];
        let there = forward.follow(&point, 0.8);
        if there.remaining.is_some() {
            continue;
        }
        stayed += 1;
        histories.insert(there.history);
        let here = back.follow(&there.point, 0.8);
        assert_eq!(here.remaining, None);
        for (a, b) in point.iter().zip(here.point) {
            assert!((a - b).abs() < 1e-9, "{point:?} {there:?} {here:?}");
        }
    }
    assert!(stayed > 200 && histories.len() > 3, "{stayed} {histories:?}");
}

/// Data that jump everywhere end within the budget; undefined formulas are named.
#[test]
fn wild_data_end() {
    let closed = Scene { inflow: "0", ..BEAM };
    let wild = Scene { velocity: &["sin(1e9*x)"], ..closed };
    let found = exact(&wild.case());
    assert!(found.density.iter().all(|r| r.is_finite()));
    let jumpy = Scene { density: "step(sin(1e9*x))", end: 0.1, ..closed };
    let mass: f64 = exact(&jumpy.case()).density.iter().sum::<f64>() * 0.25;
    assert!((mass - 1.0).abs() < 0.1, "{mass}");
    let undefined = Scene { density: "sqrt(x)", ..closed };
    let error = exact_moments(&undefined.case()).expect_err("undefined").to_string();
    assert!(error.contains("initial.density") && error.contains("x = -0.99"), "{error}");
}

/// The density and the branches on a periodic axis are those of the middle one of five copies in a
/// row: with a jump inside and one at the end, where data change and particles pass.
#[test]
fn periodic_axes_hold_what_copies_side_by_side_hold() {
    let (closed, open) = (exact(&copies_in_a_row(0)), exact(&copies_in_a_row(2)));
    let middle = 24..36;
    let mass: f64 = closed.density.iter().sum::<f64>() / 6.0;
    assert!((mass - 2.0).abs() < 1e-9, "{mass}");
    for (i, j) in middle.enumerate() {
        let (a, b) = (closed.density[i], open.density[j]);
        assert!((a - b).abs() < 1e-7 * b.abs().max(1.0), "cell {i}: {a} {b}");
        let (a, b) = (closed.velocity[0][i], open.velocity[0][j]);
        assert!((a - b).abs() < 1e-7, "cell {i}: velocity {a} {b}");
    }
    let (line, lines) = (closed.curve.unwrap(), open.curve.unwrap());
    assert!(line.x.iter().all(|x| (-1.0..=1.0).contains(x)));
    for x in [-0.93, -0.21, 0.333, 0.87] {
        let (a, b) = (all_velocities(&line, x), all_velocities(&lines, x));
        assert!(!a.is_empty() && a.len() == b.len(), "{x}: {a:?} {b:?}");
        for (a, b) in a.iter().zip(&b) {
            assert!((a - b).abs() < 1e-4, "{x}: {a:?} {b:?}");
        }
    }
    // Particles did go around: the data are not where they were.
    assert!(line.branch.last().is_some_and(|b| *b >= 2.0));
}

/// At the end of the period the curve goes on at the other end with the same velocity.
#[test]
fn the_curve_goes_on_around_a_periodic_axis() {
    let velocity: &[&str] = &["0.7 + 0.4*cos(pi*x)"];
    let mut case = Scene { cells: 12, velocity, end: 0.45, ..BEAM }.case();
    case.space.periodic[0] = true;
    let MultivaluedVelocity { x, v, .. } = exact(&case).curve.expect("a curve");
    let around = (1..x.len()).filter(|&i| [x[i - 1], x[i]] == [1.0, -1.0]);
    let apart: Vec<f64> = around.map(|i| (v[i] - v[i - 1]).abs()).collect();
    assert!(!apart.is_empty() && apart.iter().all(|apart| *apart < 1e-12), "{apart:?}");
}

/// A periodic axis, or copies of it to both sides of the middle one, in a box with ends.
fn copies_in_a_row(copies: i64) -> Case {
    let length = 1 + 2 * copies;
    let steps = (-copies..=copies)
        .flat_map(|k| [(format!("x < {}", 2 * k), "0"), (format!("x < {}", 2 * k + 1), "0.1")]);
    let steps: Vec<(String, &str)> = steps.chain([(String::new(), "0")]).collect();
    let steps: Vec<(&str, &str)> = steps.iter().map(|(c, v)| (c.as_str(), *v)).collect();
    let mut case = Scene {
        lower: -length as f64,
        upper: length as f64,
        cells: (12 * length) as usize,
        potential: &steps,
        density: "1 + 0.5*sin(pi*x)",
        velocity: &["0.7 + 0.4*cos(pi*x)"],
        end: 1.7,
        ..BEAM
    }
    .case();
    case.space.periodic[0] = copies == 0;
    case
}

/// Velocities at which any branch passes `x`, ascending.
fn all_velocities(curve: &MultivaluedVelocity, x: f64) -> Vec<f64> {
    let branches = curve.branch.last().copied().unwrap_or(0.0) as usize;
    let of_branch = |b: usize| curve_velocity(curve, x, b as f64);
    let mut found: Vec<f64> = (0..=branches).flat_map(of_branch).collect();
    found.sort_by(f64::total_cmp);
    found
}
