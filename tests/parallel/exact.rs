//! Integrals of the exact solution over the velocities, which errors of the density are against.

use crate::bits::report_bits;
use phasewarp::parallel::communicator::World;
use phasewarp::parallel::partition::split;
use phasewarp::problem::case::{Case, Exact};
use phasewarp::run::exact::averaged_density;
use phasewarp::run::exact::solution::Exactly;
use phasewarp::run::exact::velocities::VelocityIntegrals;

/// The case `text`, with an exact solution.
fn parsed(text: &str) -> (Case, Exact) {
    let case = Case::parse("exact", text, &[]).expect("a case");
    let exact = case.exact.clone().expect("an exact solution");
    (case, exact)
}

/// Jumps along the velocities that depend on `x`: integrals by hand, of nodes and of cells.
pub fn jumps_are_integrated(world: &World) {
    let group = world.group();
    let from = |x: f64| 0.3 * x + 0.1;
    for degree in [0, 2] {
        let (case, exact) = parsed(&format!(
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
        ));
        let exactly = Exactly::new(&group, &case, &exact).expect("an exact solution");
        let integrals = VelocityIntegrals::new(&exactly, &case, 1.0).expect("one dimension");
        let axis = &case.space.x[0];
        let mine = split(&(0..axis.cells), group.size(), group.rank());
        let found = integrals.on_axis(&group, axis, mine.clone());
        assert_eq!(found.len(), mine.len());
        for (j, found) in mine.zip(found) {
            let a = from(axis.centre(j as i64));
            // Of degree 0 the momentum is an average, of which only the linear part is known so.
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

/// Slow particles in a well between two barriers leave filaments; the same sums by very many
/// equal steps, and no mass is gained or lost.
pub fn filaments_are_integrated(world: &World) {
    let group = world.group();
    let (case, exact) = parsed(
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
    let exactly = Exactly::new(&group, &case, &exact).expect("an exact solution");
    let integrals = VelocityIntegrals::new(&exactly, &case, case.end).expect("one dimension");
    let places: Vec<f64> = (0..9).map(|k| -1.9 + 0.41 * k as f64).collect();
    let mine = split(&(0..places.len()), group.size(), group.rank());
    let found = integrals.at(&group, &places[mine.clone()]);
    const STEPS: usize = 100_000;
    let step = 3.2 / STEPS as f64;
    for (x, found) in places[mine].iter().zip(found) {
        let velocities = (0..STEPS).map(|k| -1.6 + (k as f64 + 0.5) * step);
        let points: Vec<[f64; 6]> = velocities.map(|v| [*x, 0.0, 0.0, v, 0.0, 0.0]).collect();
        let sum: f64 = exactly.values_at(&points, case.end).iter().sum();
        assert!((found[0] - sum * step).abs() < 2e-4, "{x}: {} {}", found[0], sum * step);
    }
    let density = averaged_density(&group, &case, &exact).expect("a density");
    let mass = density.iter().sum::<f64>() * 4.0 / density.len() as f64;
    let expected = std::f64::consts::PI * f64::sqrt(0.05 * 0.03);
    assert!((mass / expected - 1.0).abs() < 2e-3, "{mass} {expected}");
    report_bits(world, "the exact density", &density);
}
