//! Exact densities against closed forms, counted particles, and the way back.

use super::*;

/// A case with measure-valued data and the same axes in each of `n` dimensions.
fn case(
    n: usize,
    (lower, upper, cells): (f64, f64, usize),
    potential: &[(&str, &str)],
    (density, velocity): (&str, &[&str]),
    inflow: &str,
    end: f64,
) -> Case {
    let mut text = String::new();
    for _ in 0..n {
        text += &format!(
            "[[axis]]\nx = {{ lower = {lower:?}, upper = {upper:?}, cells = {cells} }}\n\
             v = {{ lower = -2.0, upper = 2.0, cells = 4 }}\n"
        );
    }
    for (condition, value) in potential {
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

fn exact(case: &Case) -> ExactMoments {
    exact_moments(case)
        .unwrap_or_else(|e| panic!("{e}"))
        .expect("measure-valued data")
}

/// Density and momentum of pieces `(from, to, density, velocity)`, averaged over the cells of
/// `axis`.
fn averages(axis: &Axis, pieces: &[(f64, f64, f64, f64)]) -> Vec<(f64, f64)> {
    (0..axis.cells as i64)
        .map(|i| {
            let (lower, upper) = (axis.face(i), axis.face(i + 1));
            pieces
                .iter()
                .fold((0.0, 0.0), |(rho, m), &(from, to, r, v)| {
                    let part = (to.min(upper) - from.max(lower)).max(0.0) / (upper - lower);
                    (rho + part * r, m + part * r * v)
                })
        })
        .collect()
}

/// Straight beams in one dimension: free, over steps, turned back, let in or not.
#[test]
fn beams_have_their_closed_form() {
    const FREE: &[(&str, &str)] = &[("", "0")];
    const DOWN: &[(&str, &str)] = &[("x < 0", "0.2"), ("", "0")];
    const UP: &[(&str, &str)] = &[("x < 0", "0"), ("", "0.2")];
    let (fast, slow) = (1.21f64.sqrt(), 0.41f64.sqrt());
    let left = "1 if x < 0 else 0";
    let time = 0.7;
    type Row<'a> = (
        &'a [(&'a str, &'a str)],
        (&'a str, &'a str),
        &'a str,
        Vec<(f64, f64, f64, f64)>,
    );
    let rows: Vec<Row> = vec![
        (FREE, ("1", "0.9"), "initial", vec![(-1.0, 1.0, 1.0, 0.9)]),
        (
            FREE,
            ("1", "-0.9"),
            "0",
            vec![(-1.0, 1.0 - 0.9 * time, 1.0, -0.9)],
        ),
        (
            FREE,
            ("1", "0.9"),
            "0.5",
            vec![
                (-1.0, -1.0 + 0.9 * time, 0.5, 0.9),
                (-1.0 + 0.9 * time, 1.0, 1.0, 0.9),
            ],
        ),
        (
            DOWN,
            (left, "0.9"),
            "initial",
            vec![(-1.0, 0.0, 1.0, 0.9), (0.0, fast * time, 0.9 / fast, fast)],
        ),
        (
            UP,
            (left, "0.9"),
            "initial",
            vec![(-1.0, 0.0, 1.0, 0.9), (0.0, slow * time, 0.9 / slow, slow)],
        ),
        (
            UP,
            (left, "0.5"),
            "initial",
            vec![(-1.0, 0.0, 1.0, 0.5), (-0.5 * time, 0.0, 1.0, -0.5)],
        ),
        // Velocities jump inside a cell.
        (
            FREE,
            ("1", "0.3 if x < 0.0321 else 0.8"),
            "initial",
            vec![
                (-1.0, 0.0321 + 0.3 * time, 1.0, 0.3),
                (0.0321 + 0.8 * time, 1.0, 1.0, 0.8),
            ],
        ),
        // At rest, and outside of the velocity box.
        (FREE, ("1", "0"), "initial", vec![(-1.0, 1.0, 1.0, 0.0)]),
        (FREE, ("1", "2.1"), "initial", vec![]),
    ];
    for (potential, (density, velocity), inflow, pieces) in rows {
        let case = case(
            1,
            (-1.0, 1.0, 14),
            potential,
            (density, &[velocity]),
            inflow,
            time,
        );
        let found = exact(&case);
        let expected = averages(&case.space.x[0], &pieces);
        for (i, &(rho, m)) in expected.iter().enumerate() {
            let what = format!("{density}, {velocity}, {inflow}, cell {i}");
            let r = found.density[i];
            assert!((r - rho).abs() < 1e-7, "{what}: {r} {rho}");
            let u = found.velocity[0][i];
            assert!(
                if rho == 0.0 {
                    u.is_nan()
                } else {
                    (u - m / rho).abs() < 1e-6
                },
                "{what}: {u}"
            );
        }
    }
}

/// Linear velocities: `x = (1 + aT) x0`; for a below −1/T the beam has turned inside out.
#[test]
fn linear_velocities_have_their_closed_form() {
    let (time, free) = (1.0, &[("", "0")][..]);
    let wide = case(1, (-1.0, 1.0, 9), free, ("1", &["0.3*x"]), "initial", time);
    let found = exact(&wide);
    let axis = wide.space.x[0].clone();
    for (i, x) in axis.centres().into_iter().enumerate() {
        assert!((found.density[i] - 1.0 / 1.3).abs() < 1e-8);
        assert!((found.velocity[0][i] - 0.3 * x / 1.3).abs() < 1e-4);
    }
    // x = −x0/2, and what enters at both ends with the velocity 1.5 inwards.
    let inside_out = case(1, (-1.0, 1.0, 9), free, ("1", &["-1.5*x"]), "initial", time);
    let found = exact(&inside_out);
    let pieces = [
        (-0.5, 0.5, 2.0, 0.0),
        (-1.0, 0.5, 1.0, 1.5),
        (-0.5, 1.0, 1.0, -1.5),
    ];
    for (i, (rho, _)) in averages(&axis, &pieces).into_iter().enumerate() {
        assert!(
            (found.density[i] - rho).abs() < 1e-7,
            "{i}: {} {rho}",
            found.density[i]
        );
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
fn curve_velocity(curve: &Curve, x: f64, branch: f64) -> Vec<f64> {
    (1..curve.x.len())
        .filter(|&i| curve.branch[i] == branch && curve.branch[i - 1] == branch)
        .filter(|&i| (curve.x[i - 1] - x) * (curve.x[i] - x) < 0.0)
        .map(|i| {
            let t = (x - curve.x[i - 1]) / (curve.x[i] - curve.x[i - 1]);
            curve.v[i - 1] + t * (curve.v[i] - curve.v[i - 1])
        })
        .collect()
}

/// A constant force: all fall alike, nothing enters at rest.
#[test]
fn constant_force() {
    let slope = case(
        1,
        (-1.0, 1.0, 10),
        &[("", "0.5*x")],
        ("1", &["0"]),
        "initial",
        1.0,
    );
    let found = exact(&slope);
    let axis = &slope.space.x[0];
    let expected = averages(axis, &[(-1.0, 0.75, 1.0, -0.5)]);
    for (i, (rho, _)) in expected.into_iter().enumerate() {
        assert!((found.density[i] - rho).abs() < 1e-7, "{i}");
        assert!(rho == 0.0 || (found.velocity[0][i] + 0.5).abs() < 1e-7);
    }
}

/// Folds: masses of cells against ten million particles counted one by one, in free flight.
#[test]
fn folds_hold_the_mass_that_is_counted() {
    let (time, cells) = (0.9, 24);
    let folded = case(
        1,
        (-1.5, 1.5, cells),
        &[("", "0")],
        ("1 + 0.5*cos(x)", &["-0.8*sin(3*x)"]),
        "0",
        time,
    );
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
        assert!(
            (rho - expected).abs() < 2e-3 * expected.max(1.0),
            "{i}: {rho} {expected}"
        );
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
            assert!(
                (value - expected).abs() < 0.01,
                "{i} {j}: {value} {expected}"
            );
        }
    }
}

/// A beam oblique to a step in space; it fills the box from the ends.
#[test]
fn oblique_beam_over_a_step_in_space() {
    let time = 0.4;
    let case = case(
        3,
        (-0.5, 0.5, 6),
        &[("x < 0", "0"), ("", "0.1")],
        ("1 if x < 0 else 0", &["0.6", "0.3", "-0.2"]),
        "initial",
        time,
    );
    let found = exact(&case);
    let pieces = [(-0.5, 0.0, 1.0, 0.6), (0.0, 0.4 * time, 1.5, 0.4)];
    let expected = averages(&case.space.x[0], &pieces);
    let mut total = 0.0;
    for (k, &rho) in found.density.iter().enumerate() {
        let (e, m) = expected[k / 36];
        // Behind the step nothing enters through the lower end of y and the upper end of z.
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

/// Forward and back again, over slopes and jumps, and histories that tell jumps apart.
#[test]
fn the_way_forward_is_the_way_back() {
    let scene = case(
        2,
        (-1.0, 1.0, 10),
        &[
            ("x < 0.2", "0.3*x + 0.1*y"),
            ("y > 0", "0.4"),
            ("", "0.1*x"),
        ],
        ("1", &["0", "0"]),
        "initial",
        1.0,
    );
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
        if there.left.is_some() {
            continue;
        }
        stayed += 1;
        histories.insert(there.history);
        let here = back.follow(&there.point, 0.8);
        assert_eq!(here.left, None);
        for (a, b) in point.iter().zip(here.point) {
            assert!((a - b).abs() < 1e-9, "{point:?} {there:?} {here:?}");
        }
    }
    assert!(
        stayed > 200 && histories.len() > 3,
        "{stayed} {histories:?}"
    );
}

/// Data that jump everywhere end within the budget; undefined formulas are named.
#[test]
fn wild_data_end() {
    let free = &[("", "0")][..];
    let wild = case(1, (-1.0, 1.0, 8), free, ("1", &["sin(1e9*x)"]), "0", 1.0);
    let found = exact(&wild);
    assert!(found.density.iter().all(|r| r.is_finite()));
    let jumpy = case(
        1,
        (-1.0, 1.0, 8),
        free,
        ("step(sin(1e9*x))", &["0"]),
        "0",
        0.1,
    );
    let mass: f64 = exact(&jumpy).density.iter().sum::<f64>() * 0.25;
    assert!((mass - 1.0).abs() < 0.1, "{mass}");
    let undefined = case(1, (-1.0, 1.0, 8), free, ("sqrt(x)", &["0"]), "0", 1.0);
    let error = exact_moments(&undefined)
        .expect_err("undefined")
        .to_string();
    assert!(
        error.contains("initial.density") && error.contains("x = -0.99"),
        "{error}"
    );
}

/// The density and the branches on a periodic axis are those of the middle one of five copies in a
/// row: with a jump inside and one at the end, where data change and particles pass.
#[test]
fn periodic_axes_hold_what_copies_side_by_side_hold() {
    let build = |copies: i64| {
        let length = 1 + 2 * copies;
        let mut regions = Vec::new();
        for k in -copies..=copies {
            regions.push((format!("x < {}", 2 * k), "0"));
            regions.push((format!("x < {}", 2 * k + 1), "0.1"));
        }
        regions.push((String::new(), "0"));
        let regions: Vec<(&str, &str)> = regions.iter().map(|(c, v)| (c.as_str(), *v)).collect();
        let mut scene = case(
            1,
            (-length as f64, length as f64, (12 * length) as usize),
            &regions,
            ("1 + 0.5*sin(pi*x)", &["0.7 + 0.4*cos(pi*x)"]),
            "initial",
            1.7,
        );
        scene.space.periodic[0] = copies == 0;
        scene
    };
    let (closed, open) = (build(0), build(2));
    let (found, all) = (exact(&closed), exact(&open));
    let middle = 24..36;
    let mass: f64 = found.density.iter().sum::<f64>() / 6.0;
    assert!((mass - 2.0).abs() < 1e-9, "{mass}");
    for (i, j) in middle.enumerate() {
        let (a, b) = (found.density[i], all.density[j]);
        assert!((a - b).abs() < 1e-7 * b.abs().max(1.0), "cell {i}: {a} {b}");
        let (a, b) = (found.velocity[0][i], all.velocity[0][j]);
        assert!((a - b).abs() < 1e-7, "cell {i}: velocity {a} {b}");
    }
    let (line, lines) = (found.curve.unwrap(), all.curve.unwrap());
    assert!(line.x.iter().all(|x| (-1.0..=1.0).contains(x)));
    for x in [-0.93, -0.21, 0.333, 0.87] {
        let at = |curve: &Curve| {
            let branches = curve.branch.last().copied().unwrap_or(0.0) as usize;
            let mut found: Vec<f64> = (0..=branches)
                .flat_map(|b| curve_velocity(curve, x, b as f64))
                .collect();
            found.sort_by(f64::total_cmp);
            found
        };
        let (a, b) = (at(&line), at(&lines));
        assert!(!a.is_empty() && a.len() == b.len(), "{x}: {a:?} {b:?}");
        for (a, b) in a.iter().zip(&b) {
            assert!((a - b).abs() < 1e-4, "{x}: {a:?} {b:?}");
        }
    }
    // Particles did go around: the data are not where they were.
    assert!(line.branch.last().is_some_and(|b| *b >= 2.0));
}
