use super::*;
use crate::problem::case::ProfileChoice;
use crate::propagate::chebyshev::degree;
use crate::schrodingerization::profile::Profile;
use std::time::Instant;

const DECAYS: [f64; 9] = [1.0, 3.0, 10.0, 40.0, 128.0, 300.0, 512.0, 1000.0, 2000.0];
const GROWTHS: [f64; 3] = [0.0, 0.15, 0.525];

/// Applications of the modes, by their Chebyshev series.
fn applications(requirements: &ProfileRequirements, period: f64, modes: usize) -> usize {
    let tail = requirements.tolerance / (10.0 * modes as f64);
    let mut scratch = Vec::new();
    (0..modes)
        .map(|l| {
            let mu = TAU * l as f64 / period;
            degree(&mut scratch, 0.5 * requirements.decay * mu.hypot(1.0), tail)
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

/// Largest `|g − e^{−p}|/ε` on the domain, at other points than those of the design: equidistant
/// ones, and at distances from the ends that grow by a factor of 1.1.
fn worst(requirements: &ProfileRequirements, series: &Series) -> f64 {
    let [lower, upper] = domain(requirements);
    let unit = series.period / TURN as f64;
    let count = 2000.max(4 * series.modes()) as i64;
    let even = (0..=count).map(|i| lower + (upper - lower) * i as f64 / count as f64);
    let near = (-100..=10).map(|i| 1.1f64.powi(i)).filter(|d| *d < upper - lower);
    let ends = near.flat_map(|d| [lower + d, upper - d]);
    (even.chain(ends))
        .map(|p| {
            ((p / unit).ceil() as i64)
                .clamp((lower / unit).ceil() as i64, (upper / unit).floor() as i64)
        })
        .map(|k| (value(series, k) - (-(k as f64 * unit)).exp()).abs())
        .fold(0.0, f64::max)
        / requirements.tolerance
}

/// The table of docs/numerics.md:
/// `cargo test --release --lib table_of_designs -- --ignored --nocapture`.
#[test]
#[ignore = "prints a table"]
fn table_of_designs() {
    println!("decay growth tolerance | gap W modes applications error sum seconds | gaussian's");
    for decay in DECAYS {
        for growth in GROWTHS {
            for digits in 2..=12 {
                let tolerance = 10f64.powi(-digits);
                let requirements = ProfileRequirements::new(tolerance, growth, decay, 1.0);
                let started = Instant::now();
                let Some(PlacedProfile { profile: g, window }) = Designed::meeting(&requirements)
                else {
                    println!("{decay} {growth} {tolerance:e} | none");
                    continue;
                };
                let seconds = started.elapsed().as_secs_f64();
                let modes = g.series.modes();
                let sum: f64 = (0..modes).map(|l| g.series.factor(l).norm()).sum();
                let gaussian = Profile::plan(
                    &ProfileChoice::Gaussian { sigma: None },
                    &requirements,
                )
                .map_or(0, |PlacedProfile { window: w, .. }| {
                    applications(&requirements, w.period, w.modes(w.period) as usize)
                });
                println!(
                    "{decay:4} {growth:5} {tolerance:e} | {:5.1} {:.3} {modes:4} {:7} {:.2} {:.3} \
                    {seconds:.4} | {gaussian}",
                    window.period - growth - decay - 1.0,
                    window.cutoff,
                    applications(&requirements, window.period, modes),
                    worst(&requirements, &g.series),
                    sum * 20.0 * f64::EPSILON / tolerance,
                );
            }
        }
    }
}

/// On the domain of dependence and in the whole range of recovery points, the series is `e^{−p}` up
/// to the tolerance. Its round-off is small. It takes at most half of the Gaussian's applications,
/// and at most a third of large numbers of them.
#[test]
fn series_is_the_exponential_and_cheaper_than_the_gaussian() {
    for (i, decay) in DECAYS.into_iter().enumerate() {
        for (j, growth) in GROWTHS.into_iter().enumerate() {
            for digits in 2..=12 {
                // A third of the combinations, with each row and column; of long times, only with
                // few digits.
                let chosen = (i + j + digits as usize).is_multiple_of(3);
                if !chosen || (decay > 600.0 && digits > 9) {
                    continue;
                }
                let requirements =
                    ProfileRequirements::new(10f64.powi(-digits), growth, decay, 1.0);
                let what = format!("{decay} {growth} 1e-{digits}");
                let PlacedProfile { profile: g, window } =
                    Designed::meeting(&requirements).expect(&what);
                let error = worst(&requirements, &g.series);
                assert!(error < 0.8, "{what}: {error}");
                let reported = g.error / requirements.tolerance;
                assert!((0.5 * error..=SHARE).contains(&reported), "{what}: {reported}");
                let modes = g.series.modes();
                let sum: f64 = (0..modes).map(|l| g.series.factor(l).norm()).sum();
                assert!(sum <= requirements.tolerance / (20.0 * f64::EPSILON), "{what}: {sum:e}");
                let own = applications(&requirements, window.period, modes);
                let PlacedProfile { window: w, .. } =
                    Profile::plan(&ProfileChoice::Gaussian { sigma: None }, &requirements)
                        .expect(&what);
                let gaussian = applications(&requirements, w.period, w.modes(w.period) as usize);
                let factor = if own > 300 { 3 } else { 2 };
                assert!(factor * own <= gaussian, "{what}: {own}, {gaussian}");
                // The plan contains this design.
                let planned = Profile::plan(&ProfileChoice::Planned, &requirements);
                let own = PlacedProfile { profile: Profile::Designed(g), window };
                assert_eq!(planned, Some(own), "{what}");
            }
        }
    }
}

/// With a cut-off that is a tenth below the limit of the two-constants theorem, the least-squares
/// fit has a large error for each gap.
#[test]
fn cut_off_is_near_the_optimum() {
    for digits in [6, 9, 11] {
        let requirements = ProfileRequirements::new(10f64.powi(-digits), 0.0, 300.0, 0.0);
        let PlacedProfile { window, .. } = Designed::meeting(&requirements).expect("possible");
        let least = (FRAC_PI_2
            * crate::schrodingerization::profile::designed::digits(&requirements)
            / MOST_CANCELLATION)
            .tan();
        let ratio = window.cutoff / least;
        assert!((0.9..1.1).contains(&ratio), "1e-{digits}: {ratio}");
    }
}

/// Designs are refused because of round-off, of growth, and of settings by hand.
#[test]
fn refused_where_it_is_not_possible() {
    let smallest = |choice, growth| {
        Profile::smallest_tolerance(choice, &ProfileRequirements::new(0.1, growth, 100.0, 1.0))
    };
    let designed = smallest(&ProfileChoice::Designed, 1.0).expect("possible");
    assert!((designed / (SMALLEST * 1f64.exp()) - 1.0).abs() < 1e-9, "{designed:e}");
    let requirements = |tolerance| ProfileRequirements::new(tolerance, 1.0, 100.0, 1.0);
    assert!(Designed::meeting(&requirements(1.001 * designed)).is_some());
    assert!(Designed::meeting(&requirements(0.999 * designed)).is_none());
    assert_eq!(smallest(&ProfileChoice::Designed, f64::INFINITY), None);
    assert_eq!(smallest(&ProfileChoice::Planned, f64::INFINITY), None);
    // The domain of the Gaussian is smaller, and the plan extends as far.
    let gaussian = smallest(&ProfileChoice::Gaussian { sigma: None }, 1.0).expect("possible");
    assert_eq!(smallest(&ProfileChoice::Planned, 1.0), Some(gaussian.min(designed)));
    for by_hand in [
        ProfileRequirements { sampled: true, ..requirements(1e-6) },
        ProfileRequirements { interval: Some([-1e3, 1e3]), ..requirements(1e-6) },
        ProfileRequirements { decay: 1.001 * LONGEST, ..requirements(1e-6) },
    ] {
        assert_eq!(Profile::plan(&ProfileChoice::Designed, &by_hand), None);
        assert!(matches!(
            Profile::plan(&ProfileChoice::Planned, &by_hand),
            Some(PlacedProfile { profile: Profile::Gaussian(_), .. })
        ));
    }
}

/// For another recovery point, the profile is shifted: `e^{p◇} c_l e^{iμ_l p◇}` do not change.
#[test]
fn recovery_point_by_hand_moves_it() {
    let mut requirements = ProfileRequirements::new(1e-6, 0.2, 30.0, 1.0);
    let PlacedProfile { profile: zero, .. } = Designed::meeting(&requirements).expect("possible");
    requirements.recovery = Some(2.5);
    let PlacedProfile { profile: moved, window } =
        Designed::meeting(&requirements).expect("possible");
    assert_eq!((window.point, moved.domain), (2.5, [2.3, 32.5]));
    for p in [-0.2, 0.0, 1.0, 17.0, 31.0] {
        let (a, b) = (zero.series.value(p), 2.5f64.exp() * moved.series.value(p + 2.5));
        assert!((a - b).abs() < 5e-8, "{p}: {a} {b}");
        assert!((a - (-p).exp()).abs() < 1e-6, "{p}: {a}");
    }
}

/// Designs for very short and very long times, and with a tolerance close to round-off, succeed or
/// are refused without a panic.
#[test]
fn extreme_demands_are_met_or_refused() {
    for decay in [0.0, 1e-9, 1e-3, 0.2, 1.9e4, 2.1e4] {
        for growth in [0.0, 5.0] {
            for (tolerance, reach) in
                [(0.1, 0.0), (0.1, 2.0), (1e-4, 0.0), (1e-10, 0.0), (1e-10, 2.0)]
            {
                // Only one of the longest, which take a second each.
                if decay > 1e3 && (tolerance < 1e-3 || growth > 0.0) {
                    continue;
                }
                let requirements = ProfileRequirements::new(tolerance, growth, decay, reach);
                let found = Designed::meeting(&requirements);
                assert_eq!(found.is_some(), Designed::possible(&requirements), "{requirements:?}");
                if let Some(PlacedProfile { profile: g, .. }) = found {
                    let error = worst(&requirements, &g.series);
                    assert!(error < 0.8, "{requirements:?}: {error}");
                }
            }
        }
    }
}

/// The numbers of modes in single and in double precision, for the table of docs/performance.md:
/// `cargo test --release --lib modes_of_single_precision -- --ignored
/// --nocapture`.
#[test]
#[ignore = "prints a table"]
fn modes_of_single_precision() {
    println!("decay tolerance | modes, applications in double, in single precision");
    for decay in [28.0, 57.0, 101.0, 202.0] {
        for digits in 2..=4 {
            let double = ProfileRequirements::new(10f64.powi(-digits), 0.0, decay, 1.0);
            let single = ProfileRequirements { round_off: f64::from(f32::EPSILON), ..double };
            let [double, single] = [double, single].map(|requirements| {
                Designed::meeting(&requirements).map_or(
                    "none".to_owned(),
                    |PlacedProfile { profile: g, window }| {
                        let modes = g.series.modes();
                        format!("{modes}, {}", applications(&requirements, window.period, modes))
                    },
                )
            });
            println!("{decay} 1e-{digits} | {double} | {single}");
        }
    }
}
