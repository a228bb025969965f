use super::*;
use crate::base::quadrature::{QuadraturePoint, gauss_legendre};
use crate::problem::case::alpha::NAMES;
use crate::problem::case::{Alpha, ProfileChoice as Choice};
use crate::problem::formula::{Constants, Expression};
use crate::problem::limits::MOST_ORDER;
use crate::schrodingerization::profile::series::Series;
use crate::schrodingerization::test_support::simpson;
use num_complex::Complex64;
use std::f64::consts::{PI, TAU};

/// The Gaussian of planned width.
const GAUSSIAN: Choice = Choice::Gaussian { sigma: None };

/// The exponential profile with a constant or a formula.
fn exponential(alpha: &str) -> Choice {
    let alpha = Expression::parse(alpha, &NAMES, &Constants::new()).expect("a formula");
    Choice::Exponential { alpha: Alpha::of(&alpha).expect("a profile") }
}

/// An `α(p)` that jumps, and with it `g`.
const JUMP: &str = "5 if p < -1 else 2";

/// All continuous profiles, each with tolerances that it reaches in these tests.
fn profiles() -> Vec<(Choice, &'static [f64])> {
    vec![
        (GAUSSIAN, &[1e-2, 1e-6, 1e-11]),
        (exponential("1"), &[1e-1, 1e-3]),
        (exponential("0.2"), &[1e-2]),
        (exponential("10"), &[1e-2]),
        (exponential("1 + 4*(1 - exp(p))"), &[1e-1, 1e-3]),
        (exponential("max(1, -p)"), &[1e-2]),
        (exponential("(-p)^1.5"), &[1e-2]),
        (exponential("-1 - p"), &[1e-2, 1e-5]),
        (exponential("-1 + p^2"), &[1e-2, 1e-5]),
        (exponential("-1 + (-p)^7"), &[1e-2, 1e-6, 1e-9]),
        (Choice::Smooth { order: 1 }, &[1e-2, 1e-5]),
        (Choice::Smooth { order: 8 }, &[1e-2, 1e-6, 1e-10]),
        (Choice::Smooth { order: 16 }, &[1e-6, 1e-11]),
        (Choice::LowSomma { c: None }, &[1e-2, 1e-6, 1e-11]),
        (Choice::LowSomma { c: Some(1.0) }, &[1e-6]),
        (Choice::Acl { beta: 0.75 }, &[1e-2, 1e-6, 1e-10]),
        (Choice::Acl { beta: 0.5 }, &[1e-2]),
    ]
}

/// The profiles of [`profiles`], and one with a jump.
fn all_profiles() -> Vec<(Choice, &'static [f64])> {
    let jump: (Choice, &[f64]) = (exponential(JUMP), &[1e-1, 1e-2]);
    profiles().into_iter().chain([jump]).collect()
}

fn planned(choice: &Choice, requirements: &ProfileRequirements) -> PlacedProfile<Profile> {
    Profile::plan(choice, requirements).unwrap_or_else(|| panic!("{choice:?} {requirements:?}"))
}

fn shape(profile: &Profile) -> &dyn ProfileShape {
    match profile.form() {
        ProfileForm::Transform(shape) => shape,
        ProfileForm::Series(_) => panic!("{profile} is no function on the line"),
    }
}

/// Points and `g` times the weights of Simpson's rule, on pieces that end where profiles have
/// corners.
fn samples(g: &dyn ProfileShape) -> Vec<[f64; 2]> {
    let pieces = [([-200.0, -1.0], 160_000), ([-1.0, 0.0], 800), ([0.0, 40.0], 40_000)];
    let points = pieces.into_iter().flat_map(|(piece, intervals)| simpson(piece, intervals));
    points.map(|QuadraturePoint { node, weight }| [node, weight * g.value(node)]).collect()
}

#[test]
fn coefficients_are_the_transform_of_the_values() {
    for (choice, _) in profiles() {
        let PlacedProfile { profile, .. } =
            planned(&choice, &ProfileRequirements::new(1e-2, 0.1, 5.0, 0.0));
        let g = shape(&profile);
        let samples = samples(g);
        for mu in [0.0, 0.4, 1.7, 6.3, 20.0] {
            let found = g.coefficient(mu);
            let expected: Complex64 =
                (samples.iter()).map(|[p, g]| Complex64::new(0.0, -mu * p).exp() * g).sum();
            let limit = 1e-8 * g.coefficient(0.0).norm().max(1.0);
            let error = (found - expected).norm();
            assert!(error < limit, "{profile} at {mu}: {found} {expected}");
        }
    }
}

/// A constant formula is the constant, and a formula that depends on `p` in name only equals it up
/// to round-off.
#[test]
fn a_formula_without_p_is_the_constant() {
    assert_eq!(exponential("1 + 1"), Choice::Exponential { alpha: Alpha::Constant(2.0) });
    for alpha in ["0.3", "1", "2.5", "40"] {
        let [constant, formula] = [exponential(alpha), exponential(&format!("{alpha} + 0*p"))];
        assert_ne!(constant, formula);
        for (growth, decay) in [(0.0, 3.0), (0.375, 40.0)] {
            let requirements = ProfileRequirements::new(1e-2, growth, decay, 0.0);
            let [of_constant, of_formula] =
                [&constant, &formula].map(|choice| planned(choice, &requirements));
            let [g, h] = [&of_constant, &of_formula].map(|placed| shape(&placed.profile));
            for mu in [0.0, 0.4, 7.0, 33.0, 400.0, 1e4] {
                let error = (g.coefficient(mu) - h.coefficient(mu)).norm();
                assert!(error < 1e-14 * g.coefficient(0.0).norm(), "{alpha} {mu}: {error:e}");
            }
            for p in [-9.7, -1.3, -0.2, -1e-9, 0.0, 2.0] {
                let error = (g.value(p) - h.value(p)).abs();
                assert!(error < 1e-13, "{alpha} {p}: {error:e}");
            }
            let windows = [of_constant.window, of_formula.window];
            let modes = windows.map(|w| w.modes(w.period));
            assert_eq!(windows[0].point, windows[1].point);
            // The bound of a formula may be the smaller one.
            assert!(modes[1] < 1.02 * modes[0], "{alpha}: {modes:?}");
        }
    }
}

/// The coefficients of `smooth` at 40, from which another formula is used: the formula without
/// cancellation agrees with quadrature.
#[test]
fn smooth_coefficients_agree_where_their_formulas_meet() {
    for order in 1..=MOST_ORDER {
        let g = Smooth::new(order);
        let (below, above) = (g.coefficient(40.0), g.coefficient(40.0 * (1.0 + 1e-15)));
        assert!((below - above).norm() < 1e-15, "{order}: {below} {above}");
        // At both ends, the values match the exponentials up to the order.
        for h in [1e-3, 1e-2f64] {
            let close =
                |a: f64, b: f64| (a - b).abs() <= 1e-14 + 1e3 * (20.0 * h).powi(order as i32 + 1);
            assert!(close(g.value(-h), h.exp()), "{order} {h}");
            assert!(close(g.value(h - 1.0), (h - 1.0).exp()), "{order} {h}");
        }
        for p in [-1.0, 0.0] {
            let jump = g.value(p + 1e-12) - g.value(p - 1e-12);
            assert!(jump.abs() < 1e-11, "{order} at {p}: {jump}");
        }
    }
}

/// `smooth` near 0: Legendre coefficients and spherical Bessel functions against quadrature.
#[test]
fn smooth_coefficients_are_those_of_quadrature() {
    for order in 1..=MOST_ORDER {
        let g = Smooth::new(order);
        let steps = (0..=400).map(|k| f64::from(k) * 0.1);
        for mu in steps.chain([1e-300, 1e-19, 1e-9, 1e-3, 0.19999, 0.20001, TAU, -0.7, -33.3]) {
            let i_mu = Complex64::new(0.0, mu);
            let middle: Complex64 = gauss_legendre(64)
                .into_iter()
                .map(|point| point.moved_to([-1.0, 0.0]))
                .map(|point| (-i_mu * point.node).exp() * point.weight * g.value(point.node))
                .sum();
            let ends = 1.0 / (1.0 + i_mu) + (i_mu - 1.0).exp() / (1.0 - i_mu);
            let (found, by_nodes) = (g.coefficient(mu), ends + middle);
            assert!((found - by_nodes).norm() < 2e-15, "{order}, {mu}: {found} {by_nodes}");
        }
    }
}

/// The periodic sum of the values of `g`.
fn periodic(g: &dyn ProfileShape, period: f64, p: f64) -> f64 {
    (-6..=6).map(|m| g.value(p + period * f64::from(m))).sum()
}

#[test]
fn tails_bound_the_truncation_error() {
    for (choice, _) in all_profiles() {
        let PlacedProfile { profile, window } =
            planned(&choice, &ProfileRequirements::new(1e-2, 0.1, 30.0, 0.0));
        let (g, period) = (shape(&profile), window.period);
        for mu in [2.0, 5.0, 17.0] {
            let modes = (mu * period / (2.0 * PI)) as usize + 1;
            let series = Series::analytic(period, modes, |mu| g.coefficient(mu));
            for (from, distance) in [(0.0, 0.0), (1.0, 1.0), (0.3, 0.3)] {
                let bound = g.tail(series.wavenumber(modes - 1), distance);
                let largest = (0..200)
                    .map(|i| from + 0.05 * f64::from(i))
                    .map(|p| (series.value(p) - periodic(g, period, p)).abs())
                    .fold(0.0, f64::max);
                assert!(
                    largest <= bound + 1e-12 * g.coefficient(0.0).norm(),
                    "{profile}, mu {mu}, distance {distance}: {largest:e}, bound {bound:e}"
                );
                // The bound is not too large by orders of magnitude, unless `mu` is too small to
                // show the order of smoothness.
                let sharp = choice == exponential("1") || matches!(choice, Choice::LowSomma { .. });
                assert!(
                    !sharp || largest < 1e-9 || bound < 60.0 * largest,
                    "{profile}, mu {mu}, distance {distance}: {largest:e}, bound {bound:e}"
                );
            }
        }
    }
}

#[test]
fn rounding_is_amplified_as_planned() {
    for (choice, _) in all_profiles() {
        if choice == GAUSSIAN {
            continue;
        }
        let PlacedProfile { profile, window } =
            planned(&choice, &ProfileRequirements::new(1e-2, 0.1, 30.0, 0.0));
        let modes = window.modes(window.period) as usize;
        let series = Series::analytic(window.period, modes, |mu| shape(&profile).coefficient(mu));
        let sum: f64 = (0..modes).map(|l| series.factor(l).norm()).sum();
        let excess = match &profile {
            Profile::Exponential(exponential) => exponential.excess(),
            _ => 1.0,
        };
        assert!(sum < 2.0 * excess, "{profile}: {sum}, {excess}");
    }
}

/// `e^{p◇}` times the error of the series on the domain of dependence, relative to the tolerance.
fn worst(series: &Series, requirements: &ProfileRequirements, window: &Window) -> f64 {
    let (from, to) = (
        window.point - requirements.growth,
        window.point + requirements.reach + requirements.decay,
    );
    let count = 400;
    (0..=count)
        .map(|i| from + (to - from) * f64::from(i) / f64::from(count))
        .map(|p| (series.value(p) - (-p).exp()).abs() * window.point.exp() / requirements.tolerance)
        .fold(0.0, f64::max)
}

#[test]
fn series_is_the_exponential_on_the_domain_of_dependence() {
    for (choice, tolerances) in all_profiles() {
        for &tolerance in tolerances {
            for (growth, decay) in [(0.0, 3.0), (0.375, 40.0), (2.0, 127.0)] {
                let mut requirements = ProfileRequirements::new(tolerance, growth, decay, 0.0);
                if Profile::plan(&choice, &requirements).is_none() {
                    // Round-off makes this tolerance impossible, but not a slightly larger one.
                    let least =
                        Profile::smallest_tolerance(&choice, &requirements).expect("possible");
                    assert!(least > tolerance && least < 1e-7, "{choice:?}: {least:e}");
                    continue;
                }
                let PlacedProfile { profile, window } = planned(&choice, &requirements);
                let modes = window.modes(window.period) as usize;
                let series =
                    Series::analytic(window.period, modes, |mu| shape(&profile).coefficient(mu));
                let error = worst(&series, &requirements, &window);
                let limit = if choice == GAUSSIAN { 3.0 * growth.exp() } else { 1.0 };
                assert!(error < limit, "{profile}, {tolerance}, {growth}, {decay}: {error}");

                requirements.sampled = true;
                requirements.truncation = 0.2;
                let PlacedProfile { profile, window } = planned(&choice, &requirements);
                let interval = requirements.ends(shape(&profile), &window);
                let modes = window.modes(interval[1] - interval[0]) as usize;
                if modes > 20_000 {
                    continue;
                }
                let series =
                    Series::sampled(interval, 2 * (modes - 1), |p| shape(&profile).value(p));
                let error = worst(&series, &requirements, &window);
                assert!(
                    error < limit,
                    "{profile} sampled, {tolerance}, {growth}, {decay}: {error}"
                );
            }
        }
    }
}

/// A reading over a window, or at a second point, needs a larger interval.
#[test]
fn series_reach_as_far_as_readings() {
    for (choice, tolerances) in all_profiles() {
        let requirements = ProfileRequirements::new(tolerances[0], 0.375, 10.0, 1.5);
        let PlacedProfile { profile, window } = planned(&choice, &requirements);
        let modes = window.modes(window.period) as usize;
        let series = Series::analytic(window.period, modes, |mu| shape(&profile).coefficient(mu));
        let error = worst(&series, &requirements, &window);
        assert!(error < 3.0 * 0.375f64.exp(), "{profile}: {error}");
    }
}

/// The coefficient `c_l` of samples is `Σ_m c_{l+mN}` of the analytic coefficients if the interval
/// is long.
#[test]
fn coefficients_of_samples_are_sums_of_analytic_ones() {
    for (choice, _) in profiles() {
        let PlacedProfile { profile, .. } =
            planned(&choice, &ProfileRequirements::new(1e-2, 0.0, 5.0, 0.0));
        let g = shape(&profile);
        let interval: [f64; 2] = [-45.0, 40.0];
        let (period, points) = (interval[1] - interval[0], 340);
        let sampled = Series::sampled(interval, points, |p| g.value(p));
        assert_eq!(sampled.modes(), points / 2 + 1);
        for l in [0usize, 3, 100, 169, 170] {
            let c = |l: i64| {
                let mu = 2.0 * PI * l as f64 / period;
                let c = g.coefficient(mu.abs()) / period;
                if l < 0 { c.conj() } else { c }
            };
            let terms = 4000;
            let alias: Complex64 = (-terms..=terms).map(|m| c(l as i64 + m * points as i64)).sum();
            let error = (sampled.coefficients[l] - alias).norm();
            // The value at the left end of the profile with alpha = 0.2, and the truncation of the
            // sum over m.
            let limit = match choice {
                Choice::Exponential { .. } if choice == exponential("0.2") => 1e-5,
                Choice::Exponential { .. } => 1e-6,
                _ => 1e-9,
            };
            assert!(error < limit, "{profile}, l = {l}: {error:e}");
        }
    }
}

/// `σ` and the cut-off as published.
fn published(c: f64, tolerance: f64) -> (LowSomma, f64) {
    let gamma = (c + ((1.0 + 0.5 / PI) / tolerance).ln()).sqrt() / c;
    let sigma = 1.0 / (std::f64::consts::SQRT_2 * gamma);
    (LowSomma { c, sigma }, 2.0 * c * gamma * gamma)
}

/// The published parameters of Low and Somma keep the deviation and the cut-off within the
/// tolerance, and those planned here are not far from them.
#[test]
fn low_somma_is_as_published() {
    for tolerance in [1e-3, 1e-6, 1e-9] {
        for c in [0.5, 1.0, 3.0] {
            let (published, cutoff) = published(c, tolerance);
            assert!(published.deviation() <= tolerance, "{c} {tolerance}");
            let left_out = c.exp() * published.tail(cutoff, 0.0);
            assert!(left_out <= tolerance, "{c} {tolerance}: {left_out:e}");
            let own = LowSomma::within(c, tolerance).expect("possible");
            let ratio = own.sigma / published.sigma;
            assert!((1.0..1.3).contains(&ratio), "{c} {tolerance}: {ratio}");
            // Spacing: at most 2 pi over the period that our conditions require, and not half of
            // it.
            let decay = 60.0;
            let requirements = ProfileRequirements::new(tolerance, 0.0, decay, 0.0);
            let spacing = PI / (0.5 * decay + (64.0 * (1.5 * c).exp() / (15.0 * tolerance)).ln());
            let period = requirements.period(&published, c);
            let ratio = 2.0 * PI / period / spacing;
            assert!((0.9..2.0).contains(&ratio), "{c} {tolerance}: {ratio}");
        }
    }
}

/// The order of convergence of the interpolant at a point, from its errors with both numbers of
/// points.
fn order(g: &dyn ProfileShape, point: f64, phase: f64, points: [usize; 2], sampled: bool) -> f64 {
    let interval = [-42.0 - phase, 38.0 - phase];
    let error = |n: usize| {
        let series = if sampled {
            Series::sampled(interval, n, |p| g.value(p))
        } else {
            Series::analytic_points(80.0, n, |mu| g.coefficient(mu))
        };
        // Over a cell of the coarsest grid: single points may lie where the error vanishes.
        let cell = 80.0 / points[0] as f64;
        (0..=40)
            .map(|i| point + cell * f64::from(i) / 40.0)
            .map(|p| (series.value(p) - g.value(p)).abs())
            .fold(0.0, f64::max)
    };
    (error(points[0]) / error(points[1])).log2() / (points[1] as f64 / points[0] as f64).log2()
}

/// Near the corner the order is 1, far from it 2. For smooth(r), and for an `α(p)` with which the
/// first `r` derivatives do not jump, the orders are `r + 1` and `r + 2`. This holds for samples
/// and for `ĝ`, and for corners on the grid and between its points. (On the grid, the leading term
/// far from a corner of odd `r` vanishes, so the order is higher.)
#[test]
fn orders_in_the_number_of_points() {
    let rows: [(Choice, f64, [usize; 2]); 8] = [
        (exponential("1"), 1.0, [960, 3840]),
        (exponential("4"), 1.0, [1920, 7680]),
        (exponential("1 - p"), 1.0, [1920, 7680]),
        (exponential("-1 - p"), 2.0, [960, 3840]),
        (exponential("-1 + p^2"), 3.0, [3840, 15360]),
        (Choice::Smooth { order: 1 }, 2.0, [960, 3840]),
        (Choice::Smooth { order: 2 }, 3.0, [3840, 15360]),
        (Choice::Smooth { order: 3 }, 4.0, [3840, 15360]),
    ];
    for (choice, expected, points) in rows {
        let PlacedProfile { profile, .. } =
            planned(&choice, &ProfileRequirements::new(1e-2, 0.0, 5.0, 0.0));
        for sampled in [true, false] {
            // Cell sizes that divide 1: the corner is on the grid, or a third of a cell from a
            // point of the coarse and of the fine grid.
            for phase in [0.0, 80.0 / 3.0 / points[0] as f64] {
                let g = shape(&profile);
                let at = order(g, 0.0, phase, points, sampled);
                assert!(
                    (at - expected).abs() < 0.25,
                    "{profile}, sampled {sampled}, phase {phase}: {at} at the corner"
                );
                let away = order(g, 2.0, phase, points, sampled);
                assert!(
                    away > expected + 0.65 && (away < expected + 1.35 || (sampled && phase == 0.0)),
                    "{profile}, sampled {sampled}, phase {phase}: {away} away from it"
                );
            }
        }
    }
    // Convergence is faster than any power: the order grows with each doubling of the points.
    for (choice, points) in
        [(GAUSSIAN, 20), (Choice::LowSomma { c: Some(2.0) }, 30), (Choice::Acl { beta: 0.75 }, 80)]
    {
        let PlacedProfile { profile, .. } =
            planned(&choice, &ProfileRequirements::new(1e-9, 0.0, 5.0, 0.0));
        let g = shape(&profile);
        let found = [1, 2].map(|k| order(g, 1.0, 0.0, [k * points, 2 * k * points], false));
        assert!(found[0] > 1.0 && found[1] > found[0] + 0.7, "{profile}: {found:?}");
    }
}
