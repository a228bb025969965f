//! Tests the integrals of the exact solution over the velocities, the reference of density errors.

use crate::bits::report_bits;
use phasewarp::parallel::communicator::{Group, World};
use phasewarp::problem::case::Case;
use phasewarp::problem::grid::for_each_cell;
use phasewarp::run::exact::averaged_density;
use phasewarp::run::exact::sheets::exact_moments;
use phasewarp::run::exact::solution::ExactValues;
use phasewarp::run::exact::velocities::VelocityIntegrals;
use phasewarp::run::exact::velocities::panels::VelocityIntegral;

/// A case, its exact solution at the final time, and the integrals of that over the velocities. The
/// parts refer to each other, and are kept until the process ends.
struct Scene {
    group: Group,
    case: &'static Case,
    values: &'static ExactValues<'static>,
    integrals: VelocityIntegrals<'static>,
}

impl Scene {
    fn parsed(world: &World, text: &str) -> Self {
        let group = world.group();
        let case: &Case = Box::leak(Box::new(Case::parse("exact", text, &[]).expect("a case")));
        let exact = case.exact.as_ref().expect("an exact solution");
        let values = ExactValues::new(&group, case, exact).expect("its values");
        let values: &ExactValues<'_> = Box::leak(Box::new(values));
        let integrals = VelocityIntegrals::on_grid(&group, values, case, case.end);
        Self { group, case, values, integrals }
    }

    /// The density at a position by equal steps along each velocity axis.
    fn by_equal_steps(&self, place: &[f64; 3], steps: &[usize]) -> f64 {
        let axes = &self.case.space.v;
        let [x, y, z] = *place;
        let (mut sum, mut points) = (0.0, Vec::new());
        let count = steps.iter().product();
        for k in 0..count {
            let mut v = [0.0; 3];
            let mut rest = k;
            for ((v, axis), steps) in v.iter_mut().zip(axes).zip(steps) {
                let part = ((rest % steps) as f64 + 0.5) / *steps as f64;
                *v = axis.lower + (axis.upper - axis.lower) * part;
                rest /= steps;
            }
            points.push([x, y, z, v[0], v[1], v[2]]);
            if points.len() == 4096 || k + 1 == count {
                sum += self.values.values_at(&points, self.case.end).iter().sum::<f64>();
                points.clear();
            }
        }
        let volume: f64 = axes.iter().map(|axis| axis.upper - axis.lower).product();
        sum * volume / count as f64
    }

    /// Calls `compare` with each position of this rank's part of `places`, with the integral there,
    /// and with the density by equal steps.
    fn for_each_place(
        &self,
        places: &[[f64; 3]],
        steps: &[usize],
        mut compare: impl FnMut(&[f64; 3], VelocityIntegral, f64),
    ) {
        for place in &places[self.group.piece_of(&(0..places.len()))] {
            compare(place, self.integrals.at(place), self.by_equal_steps(place, steps));
        }
    }

    /// The density, averaged over each cell. Its bits must not depend on the ranks.
    fn density(&self, world: &World, name: &str) -> Vec<f64> {
        let exact = self.case.exact.as_ref().expect("an exact solution");
        let density = averaged_density(&self.group, self.case, exact).expect("a density");
        report_bits(world, name, &density);
        density
    }
}

/// Integrals of a solution with jumps at velocities that depend on `x`, at nodes and over cells,
/// against formulas.
pub fn jumps_are_integrated(world: &World) {
    let from = |x: f64| 0.3 * x + 0.1;
    for degree in [0, 2] {
        let text = format!(
            r#"
            scheme.degree = {degree}
            initial.f = "1"
            potential = [{{ value = "0" }}]
            time.end = 1
            exact.f = "(1 if v > 0.3*x + 0.1 else 0) + (10 if abs(v + 0.6) < 0.02 else 0)"
            [[axis]]
            x = {{ lower = -1, upper = 1, cells = 7 }}
            v = {{ lower = -1.3, upper = 1.7, cells = 5 }}
            "#
        );
        let scene = Scene::parsed(world, &text);
        let axis = &scene.case.space.x[0];
        let mine = scene.group.piece_of(&(0..axis.cells));
        let cells: Vec<[usize; 3]> = mine.clone().map(|j| [j, 0, 0]).collect();
        let found = scene.integrals.on_cells(scene.case, &cells);
        assert_eq!(found.len(), mine.len());
        for (j, integral) in mine.zip(found) {
            let found = integral.moments;
            let a = from(axis.centre(j as i64));
            // For degree 0 the momentum is an average over the cell, which adds this term.
            let spread = if degree == 0 { (0.3 * axis.width()).powi(2) / 12.0 } else { 0.0 };
            let density = 1.7 - a + 0.4;
            let momentum = 0.5 * (1.7f64.powi(2) - a * a - spread) - 0.24;
            assert!((found[0] - density).abs() < 1e-4, "{degree} {j}: {} {density}", found[0]);
            assert!((found[1] - momentum).abs() < 1e-4, "{degree} {j}: {} {momentum}", found[1]);
            let cube = |v: f64| v.powi(3) / 6.0;
            let energy = cube(1.7) - cube(a) + 10.0 * (cube(-0.58) - cube(-0.62));
            assert!((found[4] - energy).abs() < 2e-3, "{degree} {j}: {} {energy}", found[4]);
        }
    }
}

/// Slow particles in a well between two barriers form filaments. Their integrals agree with sums
/// over very many equal steps, and the mass is kept.
pub fn filaments_are_integrated(world: &World) {
    let scene = Scene::parsed(
        world,
        r#"
        initial.f = "exp(-((x + 1.3)^2/0.05 + (v - 0.85)^2/0.03))"
        time.end = 2.3
        exact.kind = "characteristics"
        [[potential]]
        where = "x > -0.6 && x < -0.4"
        value = "0.3"
        [[potential]]
        where = "x >= -0.4 && x < 0.4"
        value = "-0.15"
        [[potential]]
        where = "x >= 0.4 && x < 0.7"
        value = "0.22"
        [[potential]]
        value = "0"
        [[axis]]
        x = { lower = -2.2, upper = 1.8, cells = 80 }
        v = { lower = -1.6, upper = 1.6, cells = 16 }
        "#,
    );
    let places: Vec<[f64; 3]> = (0..9).map(|k| [-1.9 + 0.41 * k as f64, 0.0, 0.0]).collect();
    scene.for_each_place(&places, &[100_000], |place, found, sum| {
        let found = found.moments[0];
        assert!((found - sum).abs() < 2e-4, "{place:?}: {found} {sum}");
    });
    let density = scene.density(world, "the exact density");
    let mass = density.iter().sum::<f64>() * 4.0 / density.len() as f64;
    let expected = std::f64::consts::PI * f64::sqrt(0.05 * 0.03);
    assert!((mass / expected - 1.0).abs() < 2e-3, "{mass} {expected}");
}

/// A square barrier in the plane splits the particles at its corners. The integrals agree with sums
/// over very many equal steps. Sums over the velocities of the grid have a far larger error.
pub fn corners_are_integrated(world: &World) {
    let scene = Scene::parsed(
        world,
        r#"
        initial.f = "exp(-((x + 0.7)^2 + (y + 0.2)^2)/0.1 - ((vx - 0.6)^2 + (vy - 0.2)^2)/0.15)"
        time.end = 1.5
        exact.kind = "characteristics"
        [[potential]]
        where = "abs(x) < 0.4 && abs(y) < 0.4"
        value = "0.2"
        [[potential]]
        value = "0"
        [[axis]]
        x = { lower = -1.2, upper = 1.2, cells = 12 }
        v = { lower = -1.5, upper = 1.5, cells = 16 }
        [[axis]]
        x = { lower = -1.2, upper = 1.2, cells = 12 }
        v = { lower = -1.2, upper = 1.2, cells = 16 }
        "#,
    );
    let places: Vec<[f64; 3]> =
        (0..8).map(|k| [-0.9 + 0.27 * k as f64, 0.5 - 0.31 * (k % 4) as f64, 0.0]).collect();
    let (mut sizes, mut errors, mut estimates, mut fixed) = (vec![], vec![], vec![], vec![]);
    scene.for_each_place(&places, &[700, 700], |place, found, sum| {
        sizes.push(sum);
        estimates.push(found.error);
        errors.push((found.moments[0] - sum).abs());
        fixed.push((scene.by_equal_steps(place, &[16, 16]) - sum).abs());
    });
    let [size, error, estimate, fixed] =
        [sizes, errors, estimates, fixed].map(|terms| scene.group.sum_terms(&terms));
    assert!(error < 5e-3 * size, "{error} {size}");
    assert!(estimate < 1e-2 * size && error < 4.0 * estimate, "{error} {estimate} {size}");
    assert!(fixed > 10.0 * error, "{fixed} {error}");
    scene.density(world, "the exact density in the plane");
}

/// A step along the first of three axes, which reflects slow particles: the integrals agree with
/// sums over equal steps.
pub fn a_step_in_space_is_integrated(world: &World) {
    let scene = Scene::parsed(
        world,
        r#"
        initial.f = "exp(-((x + 0.3)^2 + y^2 + z^2 + (vx - 0.5)^2 + vy^2 + vz^2)/0.2)"
        time.end = 0.4
        exact.kind = "characteristics"
        [[potential]]
        where = "x < 0"
        value = "0"
        [[potential]]
        value = "0.1"
        [[axis]]
        x = { lower = -0.9, upper = 0.9, cells = 4 }
        v = { lower = -1.2, upper = 1.2, cells = 8 }
        [[axis]]
        x = { lower = -0.8, upper = 0.8, cells = 3 }
        v = { lower = -0.8, upper = 0.8, cells = 8 }
        [[axis]]
        x = { lower = -0.8, upper = 0.8, cells = 3 }
        v = { lower = -0.8, upper = 0.8, cells = 8 }
        "#,
    );
    let places = [[-0.2, 0.1, 0.0], [-0.03, -0.2, 0.1], [0.15, 0.05, -0.1], [0.4, 0.0, 0.2]];
    const STEPS: [usize; 3] = [1600, 24, 24];
    let largest = scene.by_equal_steps(&places[0], &STEPS);
    scene.for_each_place(&places, &STEPS, |place, found, sum| {
        let error = (found.moments[0] - sum).abs();
        assert!(error < 5e-3 * largest, "{place:?}: {} {sum} {largest}", found.moments[0]);
        assert!(error < 4.0 * found.error, "{place:?}: {error} {}", found.error);
    });
    scene.density(world, "the exact density in space");
}

/// Without jumps of `V`, the velocities of the grid are sufficient for smooth data, but not for
/// discontinuous data.
pub fn smooth_data_take_the_grid(world: &World) {
    for (initial, smooth) in [("exp(-r/0.1)", true), ("1 if r < 0.4 else 0", false)] {
        let text = format!(
            r#"
            initial.f = "{}"
            potential = [{{ value = "0" }}]
            time.end = 0.3
            exact.kind = "characteristics"
            [[axis]]
            x = {{ lower = -1, upper = 1, cells = 8 }}
            v = {{ lower = -1.4, upper = 1.4, cells = 24 }}
            [[axis]]
            x = {{ lower = -1, upper = 1, cells = 8 }}
            v = {{ lower = -1.4, upper = 1.4, cells = 24 }}
            "#,
            initial.replace("r", "(x^2 + y^2 + vx^2 + vy^2)")
        );
        let scene = Scene::parsed(world, &text);
        let grid_error = scene.integrals.grid_error();
        assert_eq!(grid_error.is_some(), smooth, "{initial}");
        let place = [0.13, -0.2, 0.0];
        let found = scene.integrals.at(&place);
        let sum = scene.by_equal_steps(&place, &[800, 800]);
        let bound = if smooth { 1e-6 } else { 5e-3 };
        assert!((found.moments[0] - sum).abs() < bound * sum, "{} {sum}", found.moments[0]);
        assert!(grid_error.is_none_or(|error| error < 1e-4 * sum));
    }
}

/// Measure-valued data with jumps, folds and inflow, in one to three dimensions: name, dimension,
/// density, velocity and potential. The last one jumps everywhere and uses up the particle budget.
const SHEETS: [(&str, usize, &str, &str, &str); 5] = [
    ("a step", 1, "1 if x < 0.1 else 0.5", "0.6", "0.3 if x < 0 else 0"),
    ("a fold", 1, "exp(-x^2)", "-x", "0.1*x"),
    ("a step in 2D", 2, "1 + 0.2*x*y", "0.5", "0.2 if x < 0.1 else 0"),
    ("a step in 3D", 3, "1", "0.4", "0.1 if x < 0.2 else 0"),
    ("jumps everywhere", 1, "1 if sin(1e9*x) > 0 else 0", "0.2", "0"),
];

/// A case with measure-valued data on axes of 5, 4 and 3 cells.
fn sheet_case(n: usize, density: &str, velocity: &str, potential: &str) -> Case {
    let axes: String = (5 - n..=5)
        .rev()
        .take(n)
        .map(|cells| {
            format!(
                "[[axis]]\nx = {{ lower = -1, upper = 1, cells = {cells} }}\n\
                 v = {{ lower = -2, upper = 2, cells = 4 }}\n"
            )
        })
        .collect();
    let mut velocities = vec!["0.1"; n];
    velocities[0] = velocity;
    let text = format!(
        "time.end = 0.8\ninitial.density = \"{density}\"\ninitial.velocity = {velocities:?}\n\
         inflow.value = \"initial\"\nexact.kind = \"characteristics\"\n\
         potential = [{{ value = \"{potential}\" }}]\n{axes}"
    );
    Case::parse("sheets", &text, &[]).unwrap_or_else(|e| panic!("{e}\n{text}"))
}

/// The exact moments of measure-valued data have the same bits on any ranks and for any axis along
/// which the ranks share the work, and so has the error if a formula is not finite.
pub fn sheets_are_followed_together(world: &World) {
    let group = world.group();
    for (name, n, density, velocity, potential) in SHEETS {
        let case = sheet_case(n, density, velocity, potential);
        let whole = case.space.space_ranges();
        for shared in 0..n {
            let mut share = whole.clone();
            share[shared] = group.piece_of(&whole[shared]);
            let moments = exact_moments(&group, &case, &share).expect("finite");
            let mut cells = Vec::new();
            for_each_cell(&share, |i| {
                cells.push(case.space.x.iter().zip(i).fold(0, |k, (axis, i)| k * axis.cells + i));
            });
            let on_all = |values: &[f64]| {
                let mut all = vec![0.0; case.space.space_cells()];
                cells.iter().zip(values).for_each(|(cell, value)| all[*cell] = *value);
                group.gathered(all)
            };
            let density = on_all(&moments.density);
            assert!(density.iter().sum::<f64>() > 0.0, "{name}: {density:?}");
            let mut all = density.clone();
            moments.momentum.iter().chain(&moments.velocity).for_each(|m| all.extend(on_all(m)));
            if let Some(curve) = &moments.curve {
                let parts = [&curve.x, &curve.v, &curve.density, &curve.branch];
                parts.iter().for_each(|part| all.extend(*part));
            }
            report_bits(world, &format!("sheets of {name}"), &all);
            let Some(exact) = &case.exact else { panic!("no exact solution") };
            assert_eq!(averaged_density(&group, &case, exact).expect("finite"), density, "{name}");
        }
    }
    let undefined = sheet_case(1, "1 if x < 0.5 else log(0.5 - x)", "0.2", "0");
    let whole = group.piece_of(&(0..5));
    let error = exact_moments(&group, &undefined, &[whole]).expect_err("log of less than 0");
    let error: Vec<f64> = error.to_string().bytes().map(f64::from).collect();
    report_bits(world, "the first box that is not finite", &error);
}
