//! Where `f` is read from the warped field, and how long the interval in `p` must be.
//!
//! A component of the state that `S` multiplies by `−s/T` moves by `s` in `p`: with the periodic series `G` it is read at `p◇` as
//! `e^{p◇} G(p◇ + s)` and should be `e^{−s}`. So the error relative to the field is about
//!
//! ```text
//! ‖ũ(0)‖/‖f(T)‖ · ( max |e^{p◇} G(p◇ + s) − e^{−s}|  over s in [−λ⁺T, λ⁻T]  +  ε_machine e^{p◇} Σ|c_l| )
//! ```
//!
//! in which everything shows: below `λ⁺T` what comes from where `g` is not `e^{−p}`, the ends of the interval, modes left out, and
//! round-off. (`K` does not commute with `S` and mixes the components; they stay within the same bounds.)

use crate::base::error::Result;
use crate::matrix::bounds::Bounds;
use crate::parallel::communicator::World;
use crate::problem::case::{Case, Coefficients, Interface, LARGEST_TOLERANCE, ProfileChoice};
use crate::schrodingerization::profile::Shape;
use crate::schrodingerization::profile::gaussian::{Gaussian, normal_quantile};
use crate::schrodingerization::profile::series::Series;
use crate::schrodingerization::warp_plan::WarpPlan;
use crate::solve::spectrum;
use crate::study::budget::Budget;
use crate::study::grids::coarsened;
use crate::study::stability::scene::{note, with_interface};
use crate::study::stability::yardstick::Yardstick;
use crate::study::stability::{Border, Curve, Found, Name, Panel, Point, Scale};
use crate::study::trial::trial;

/// Cells that are enough; more where the profile is propagated but twice, as the growth shows on finer grids.
const CELLS: usize = 1024;
const CELLS_OF_RECOVERY: usize = 4096;
/// The profile equals `e^{−p}` for `p ≥ 0` to within this.
const LEVEL: f64 = 1e-8;
/// Width of its switch.
const SIGMA: f64 = 1.0;
/// Readings: the first, the last, and how far apart.
const FROM: f64 = -4.0;
const TO: f64 = 22.0;
const APART: f64 = 0.5;
/// Lanczos steps.
const LANCZOS: usize = 4000;

/// `[λ⁺T, λ⁻T]` as measured. Collective.
fn extent(yardstick: &mut Yardstick, time: f64) -> Result<[f64; 2]> {
    let (problem, communicator) = yardstick.parts();
    let (found, _) = spectrum::of(problem, &communicator.space, LANCZOS)?;
    Ok([found.highest.value * time, -found.lowest.value * time])
}

/// The Gaussian that switches on below zero; what it takes of an interval to be small at its left end.
fn gaussian() -> (Gaussian, f64) {
    let offset = -normal_quantile(LEVEL) * SIGMA;
    // Beyond this wavenumber nothing is left but round-off.
    let digits = -libm::log(LEVEL * f64::EPSILON);
    let square = SIGMA * SIGMA;
    let profile = Gaussian {
        sigma: SIGMA,
        offset,
        period: 0.0,
        cutoff: (1.0 + 2.0 * (digits - offset) / square).sqrt(),
    };
    let tail = square + SIGMA * (square + 2.0 * (-libm::log(LEVEL) - offset)).sqrt();
    (profile, tail - offset)
}

/// Points of an interval of this length that resolve the profile.
fn points(profile: &Gaussian, period: f64) -> usize {
    2 * (0.5 * profile.cutoff * period / std::f64::consts::PI).ceil() as usize + 2
}

/// The error of a reading at `p`, by theory, for a state that is `ratio` times the field.
fn expected(series: &Series, p: f64, [growth, decay]: [f64; 2], ratio: f64) -> f64 {
    const SAMPLES: u32 = 400;
    let error = |s: f64| (p.exp() * series.value(p + s) - (-s).exp()).abs();
    let all = |from: f64, to: f64| {
        (0..=SAMPLES).map(move |k| from + (to - from) * f64::from(k) / f64::from(SAMPLES))
    };
    // What grows, and what hardly decays, more closely.
    let near = all(-growth, (4.0 - growth).min(decay));
    let worst = all(-growth, decay)
        .chain(near)
        .map(error)
        .fold(0.0, f64::max);
    let amplified: f64 = (0..series.modes()).map(|l| series.factor(l).norm()).sum();
    ratio * (worst + f64::EPSILON * p.exp() * amplified)
}

/// Where `of` falls to `level` first and where it rises above it last, between the points on a line in logarithms.
fn plateau(points: &[Point], level: f64, of: fn(&Point) -> f64) -> [Option<f64>; 2] {
    let between = |a: &Point, b: &Point| {
        let part = (level / of(a)).ln() / (of(b) / of(a)).ln();
        Some(a.x + part * (b.x - a.x)).filter(|x| x.is_finite())
    };
    let inside = |p: &Point| of(p) <= level;
    let pairs = || points.windows(2);
    let first = pairs().find(|w| !inside(&w[0]) && inside(&w[1]));
    let last = pairs().rfind(|w| inside(&w[0]) && !inside(&w[1]));
    [first, last].map(|pair| pair.and_then(|w| between(&w[0], &w[1])))
}

/// Why a case has no panel about `p` here.
fn unfit(case: &Case) -> Option<String> {
    case.varies().then(|| {
        "what enters depends on time: its modes have couplings that change from step to step"
            .to_owned()
    })
}

/// The panel of the recovery point. Collective.
///
/// # Errors
/// As [`Yardstick::new`].
pub fn recovery(world: &World, whole: &Case, budget: &Budget) -> Result<Found> {
    if let Some(why) = unfit(whole) {
        return Ok(Err(why));
    }
    let coarse = coarsened(whole, CELLS_OF_RECOVERY);
    let jumps = Bounds::new(&coarse)?.jumps;
    let mut kinds = vec![if jumps {
        (
            "hat, dissipative weights",
            with_interface(&coarse, Interface::Hat, true),
        )
    } else {
        ("no jump", coarse.clone())
    }];
    if jumps {
        kinds.push((
            "hat, no weights",
            with_interface(&coarse, Interface::Hat, false),
        ));
    }
    let (mut curves, mut borders, mut notes) = (Vec::new(), Vec::new(), note(whole, &coarse));
    let mut verdict = String::new();
    let (profile, room) = gaussian();
    let readings: Vec<f64> = (0..)
        .map(|k| FROM + APART * f64::from(k))
        .take_while(|p| *p <= TO)
        .collect();
    for (name, case) in kinds {
        if budget.is_over() {
            notes.push(format!("{name}: the budget is used up"));
            break;
        }
        let mut yardstick = Yardstick::new(world, &case)?;
        let extent = extent(&mut yardstick, case.end)?;
        let period = extent[1] + extent[0].max(0.0) + TO + room;
        let modes = (profile.cutoff * period / std::f64::consts::TAU).ceil() as usize + 1;
        let series = Series::analytic(period, modes, |mu| profile.coefficient(mu));
        if !budget.holds(yardstick.updates(&series)?, 1.0) {
            notes.push(format!("{name}: {modes} modes take too long here"));
            continue;
        }
        let ratio = yardstick.ratio;
        let errors = yardstick.errors(&series, &readings)?;
        let point = |(&x, &measured): (&f64, &f64)| Point {
            x,
            measured,
            theory: expected(&series, x, extent, ratio),
        };
        let points: Vec<Point> = readings.iter().zip(&errors).map(point).collect();
        // What the profile's own error becomes in the field.
        let level = LEVEL * ratio * extent[0].max(0.0).exp() * 2.0;
        let [left, right] = plateau(&points, level, |p| p.measured);
        let [left_theory, right_theory] = plateau(&points, level, |p| p.theory);
        let number = |x: Option<f64>| x.map_or("nowhere".to_owned(), |x| format!("{x:.2}"));
        verdict += &format!(
            "{name}: lambda+ T = {:.3}; the error is below {level:.1e} from p = {} (bound {}) to p = {} (bound {}). ",
            extent[0],
            number(left),
            number(left_theory),
            number(right),
            number(right_theory)
        );
        let growth = Border::place(
            format!("{name}: lambda+ T, beside the bound of a run"),
            Some(extent[0]),
            Some(yardstick.bounds().growth * case.end),
        );
        borders.push(growth.bounded());
        let begins = format!("{name}: plateau begins");
        borders.push(Border::place(begins, left, left_theory).bounded());
        let ends = format!("{name}: round-off ends it");
        borders.push(Border::new(ends, right, right_theory).bounded());
        curves.push(Curve {
            name: name.to_owned(),
            points,
            bound: true,
        });
    }
    if curves.is_empty() {
        return Ok(Err("nothing could be tried within the budget".to_owned()));
    }
    verdict += "Runs refuse a recovery point at which round-off exceeds the tolerance, and warn below lambda+ T.";
    Ok(Ok(Panel {
        name: Name::Recovery,
        title: "Error against the recovery point".to_owned(),
        shape: coarse.space.shape(),
        x: Scale::linear("recovery point p"),
        y: Scale::log("relative l2 error"),
        curves,
        borders,
        verdict,
        notes,
    }))
}

/// The panel of the interval. Collective.
///
/// # Errors
/// As [`Yardstick::new`].
pub fn interval(world: &World, whole: &Case, budget: &Budget) -> Result<Found> {
    const LENGTHS: u32 = 20;
    if let Some(why) = unfit(whole) {
        return Ok(Err(why));
    }
    let mut case = coarsened(whole, CELLS);
    case.warp.weights = true;
    let mut notes = note(whole, &case);
    let mut yardstick = Yardstick::new(world, &case)?;
    let extent = extent(&mut yardstick, case.end)?;
    let ratio = yardstick.ratio;
    let (profile, room) = gaussian();
    // Ends that are far enough: what is left of e^{−p} there is small beside the level, as is the switch.
    let far = -libm::log(1e-3 * LEVEL);
    let needed = extent[1] + extent[0].max(0.0) + room;
    let mut tried = |ends: [f64; 2], x: f64| -> Result<Option<Point>> {
        let period = ends[1] - ends[0];
        let series = Series::sampled(ends, points(&profile, period), |p| profile.value(p));
        if !budget.holds(yardstick.updates(&series)?, 1.0) {
            return Ok(None);
        }
        let errors = yardstick.errors(&series, &[0.0])?;
        Ok(Some(Point {
            x,
            measured: errors.first().copied().unwrap_or(f64::NAN),
            theory: expected(&series, 0.0, extent, ratio),
        }))
    };
    let [mut left, mut right] = [Vec::new(), Vec::new()];
    let mut long = 0;
    for k in 0..=LENGTHS {
        let part = f64::from(k) / f64::from(LENGTHS);
        if budget.is_over() {
            notes.push("curves end where the budget did".to_owned());
            break;
        }
        // From far too short to longer than it takes, shortest last as x rises.
        let lower = -1.25 * needed + part * (1.25 * needed - 1.0);
        let upper = 1.0 + part * (far - 1.0);
        for (list, ends, x) in [
            (&mut left, [lower, far], lower),
            (&mut right, [-1.25 * needed, upper], upper),
        ] {
            match tried(ends, x)? {
                Some(point) => list.push(point),
                None => long += 1,
            }
        }
    }
    if left.is_empty() && right.is_empty() {
        return Ok(Err(
            "intervals that are long enough take too long here".to_owned()
        ));
    }
    if long > 0 {
        notes.push(format!("{long} intervals took too many modes to be tried"));
    }
    // Twice what the profile itself leaves.
    let level = 4.0 * LEVEL * ratio;
    let [_, left_end] = plateau(&left, level, |p| p.measured);
    let [_, left_theory] = plateau(&left, level, |p| p.theory);
    let [right_end, _] = plateau(&right, level, |p| p.measured);
    let [right_theory, _] = plateau(&right, level, |p| p.theory);
    // The shortest that a run takes for this tolerance, with the profile that it plans for it, and what it reaches there.
    case.warp.profile = ProfileChoice::Gaussian;
    case.warp.coefficients = Coefficients::Sampled;
    (case.warp.recovery, case.warp.points) = (None, None);
    case.tolerance = (LEVEL * ratio).min(LARGEST_TOLERANCE);
    case.verify = true;
    let accepts = |case: &mut Case, length: f64| {
        case.warp.interval = Some([far - length, far]);
        WarpPlan::modes_of(case, yardstick.bounds(), ratio).is_ok()
    };
    let (mut short, mut enough) = (1.0, 4.0 * (needed + far));
    let mut shortest = None;
    if accepts(&mut case, enough) && !budget.is_over() {
        for _ in 0..12 {
            let middle = 0.5 * (short + enough);
            if accepts(&mut case, middle) {
                enough = middle;
            } else {
                short = middle;
            }
        }
        case.warp.interval = Some([far - enough, far]);
        let reached = trial(world, &case)?.summary.error_semidiscrete;
        shortest = Some(far - enough).zip(reached);
    }
    // Whether all lengths were tried.
    let all = long == 0 && right.len() > LENGTHS as usize;
    let unknown = if all {
        "(not located: the error does not cross it)"
    } else {
        "(not located within the budget)"
    };
    let number = |x: Option<f64>| x.map_or(unknown.to_owned(), |x| format!("{x:.2}"));
    let verdict = format!(
        "The error is below {level:.1e} for L up to {} (bound {}), beyond which the field wraps around, and for R from {} on (bound {}), short of \
         which e^(-p) is cut off. The bounds hold for any data; a case's may do with shorter intervals. {}",
        number(left_end),
        number(left_theory),
        number(right_end),
        number(right_theory),
        match shortest {
            Some((end, _)) => format!("Runs refuse what is too short for their own profile, here L above {end:.2}."),
            None => "Runs refuse what is too short for their own profile; from which L on was not located.".to_owned(),
        }
    );
    let borders = vec![
        Border::new("left end L: the field wraps around", left_end, left_theory).bounded(),
        Border::new("right end R: exp(-p) is cut off", right_end, right_theory).bounded(),
        Border::new(
            "shortest that a run accepts: its error, beside its tolerance",
            shortest.map(|s| s.1),
            Some(case.tolerance),
        )
        .bounded(),
    ];
    let curve = |name: &str, points: Vec<Point>| Curve {
        name: name.to_owned(),
        points,
        bound: true,
    };
    Ok(Ok(Panel {
        name: Name::Interval,
        title: "Error against the interval".to_owned(),
        shape: case.space.shape(),
        x: Scale::linear("end of the interval in p"),
        y: Scale::log("relative l2 error"),
        curves: vec![curve("left end L", left), curve("right end R", right)],
        borders,
        verdict,
        notes,
    }))
}
