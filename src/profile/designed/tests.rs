use super::*;
use crate::case::ProfileChoice;
use crate::profile::Profile;
use crate::propagate::chebyshev::degree;
use std::time::Instant;

const DECAYS: [f64; 9] = [1.0, 3.0, 10.0, 40.0, 128.0, 300.0, 512.0, 1000.0, 2000.0];
const GROWTHS: [f64; 3] = [0.0, 0.15, 0.525];

/// Applications of the modes, by their Chebyshev series.
fn applications(demand: &Demand, period: f64, modes: usize) -> usize {
    let tail = demand.tolerance / (10.0 * modes as f64);
    let mut scratch = Vec::new();
    (0..modes)
        .map(|l| {
            let mu = TAU * l as f64 / period;
            degree(&mut scratch, 0.5 * demand.decay * mu.hypot(1.0), tail)
        })
        .sum()
}

/// The series at `k P/TURN`, without the rounding of large arguments.
fn value(series: &Series, k: i64) -> f64 {
    let wave = |l: usize| {
        let turns = (l as i64 * k).rem_euclid(TURN) as f64 / TURN as f64;
        Complex64::new(0.0, TAU * turns).exp()
    };
    let terms = (0..series.modes()).map(|l| (series.factor(l) * wave(l)).re);
    terms.sum()
}

/// Largest `|g − e^{−p}|/ε` on the domain, on a grid unlike the design's: equally spaced, and by powers of 1.1 towards its ends.
fn worst(demand: &Demand, series: &Series) -> f64 {
    let [lower, upper] = domain(demand);
    let unit = series.period / TURN as f64;
    let count = 2000.max(4 * series.modes()) as i64;
    let even = (0..=count).map(|i| lower + (upper - lower) * i as f64 / count as f64);
    let near = (-100..=10).map(|i| 1.1f64.powi(i)).filter(|d| *d < upper - lower);
    let ends = near.flat_map(|d| [lower + d, upper - d]);
    (even.chain(ends))
        .map(|p| ((p / unit).ceil() as i64).clamp((lower / unit).ceil() as i64, (upper / unit).floor() as i64))
        .map(|k| (value(series, k) - (-(k as f64 * unit)).exp()).abs())
        .fold(0.0, f64::max)
        / demand.tolerance
}

/// The table of docs/numerics.md: `cargo test --release --lib table_of_designs -- --ignored --nocapture`.
#[test]
#[ignore = "prints a table"]
fn table_of_designs() {
    println!("decay growth tolerance | gap W modes applications error sum seconds | gaussian's");
    for decay in DECAYS {
        for growth in GROWTHS {
            for digits in 2..=12 {
                let tolerance = 10f64.powi(-digits);
                let demand = Demand::new(tolerance, growth, decay, 1.0);
                let started = Instant::now();
                let Some((g, window)) = Designed::meeting(&demand) else {
                    println!("{decay} {growth} {tolerance:e} | none");
                    continue;
                };
                let seconds = started.elapsed().as_secs_f64();
                let modes = g.series.modes();
                let sum: f64 = (0..modes).map(|l| g.series.factor(l).norm()).sum();
                let gaussian = Profile::plan(ProfileChoice::Gaussian, &demand)
                    .map_or(0, |(_, w)| applications(&demand, w.period, w.modes(w.period) as usize));
                println!(
                    "{decay:4} {growth:5} {tolerance:e} | {:5.1} {:.3} {modes:4} {:7} {:.2} {:.3} {seconds:.4} | {gaussian}",
                    window.period - growth - decay - 1.0,
                    window.cutoff,
                    applications(&demand, window.period, modes),
                    worst(&demand, &g.series),
                    sum * 20.0 * f64::EPSILON / tolerance,
                );
            }
        }
    }
}
