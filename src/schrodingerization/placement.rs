//! Chooses profile, Fourier series and recovery points from the tolerance, the bounds of the
//! spectrum and the settings of the case.

use crate::base::error::{Error, Result};
use crate::matrix::bounds::Bounds;
use crate::problem::case::{
    Case, Coefficients, Delta, LARGEST_TOLERANCE, ProfileChoice, RecoveryMethod, Warp,
};
use crate::problem::limits::MOST_MODES;
use crate::propagate;
use crate::scheme::interface::law_of;
use crate::schrodingerization::profile::constant::Constant;
use crate::schrodingerization::profile::series::Series;
use crate::schrodingerization::profile::window::PLATEAU;
use crate::schrodingerization::profile::{
    PlacedProfile, Profile, ProfileForm, ProfileRequirements, ProfileShape, Window,
};
use crate::schrodingerization::recovery::{Reading, visible_error_parts};
use std::f64::consts::PI;

/// Distance in `p` of the second recovery point from the first.
const SECOND_POINT: f64 = 1.0;
/// Width in `p` of the window of an integral or least-squares recovery.
const WINDOW: f64 = 1.0;
/// Growth over the run beyond which a warning names its remedy: an amplification by e.
const MUCH_GROWTH: f64 = 1.0;
/// For series with more modes than this, the two readings are not compared mode by mode.
const MOST_TO_COMPARE: usize = 1 << 13;
/// Part of the tolerance that truncated modes may take where coefficients come from samples: the
/// truncated modes are aliased to the wavenumbers that are kept.
const SAMPLED_TRUNCATION: f64 = 0.2;

/// The profile of a run and how it is read.
pub(crate) struct Placement {
    pub profile: Option<Profile>,
    pub series: Series,
    pub interval: [f64; 2],
    pub readings: Vec<Reading>,
    pub plateau: Vec<Reading>,
    pub estimator_efficiency: f64,
    pub estimator_doubt: f64,
    pub warnings: Vec<String>,
}

/// The plan of the auxiliary variable for the state's tolerance `ε = share·tolerance/ratio`.
///
/// # Errors
/// [`Error::Tolerance`], [`Error::Growth`], [`Error::Recovery`] when round-off forbids it,
/// [`Error::Interval`] when the interval given by hand is too short, [`Error::Modes`] when there
/// are too many.
pub(crate) fn plan_placement(case: &Case, bounds: &Bounds, ratio: f64) -> Result<Placement> {
    let warp = &case.warp;
    if let (Some(_), Some(interval), Some(points)) =
        (&case.warped_start, warp.interval, warp.points)
    {
        return from_file(case, bounds, interval, points);
    }
    if takes_one_mode(case, bounds) {
        return Ok(one_mode());
    }
    let mut warnings: Vec<String> = much_growth(case, bounds).into_iter().collect();
    let PlannedProfile { requirements, profile, window } =
        PlannedProfile::new(case, bounds, ratio, &mut warnings)?;
    let (series, interval) = match profile.form() {
        ProfileForm::Series(series) => (series.clone(), profile.ends(&requirements, &window)),
        ProfileForm::Transform(shape) => {
            let (series, interval) = transformed(case, &requirements, &profile, shape, &window)?;
            if let Some(points) = warp.points {
                warnings.extend(too_few(&requirements, shape, &window, series.period, points));
            }
            (series, interval)
        }
    };
    if window.distance < -1e-9 && warp.recovery.is_some() {
        warnings.push(recovery_is_low(&window, requirements.growth));
    }
    // The modes of A − σ are those of A times e^{iμσT}: e^{σT} e^{p◇} ṽ(p◇) is e^p v(p) read at p =
    // p◇ + σT. An interval of which only the length matters is moved along.
    let shift = shift(case, bounds);
    let fixed = warp.interval.is_some() || requirements.sampled;
    let at = |apart| readings(case, &window, interval, apart);
    let ErrorEstimator { readings, efficiency, doubt } =
        error_estimator(case, &series, [shift, requirements.decay], at);
    Ok(Placement {
        estimator_efficiency: efficiency,
        estimator_doubt: doubt,
        plateau: moved(plateau(case, &window, interval, readings[0].width), shift),
        profile: Some(profile),
        series,
        interval: if fixed { interval } else { interval.map(|p| p + shift) },
        readings: moved(readings, shift),
        warnings,
    })
}

/// The warning of a recovery point given by hand below that of the plan.
fn recovery_is_low(window: &Window, growth: f64) -> String {
    format!(
        "solver.warp.recovery = {} is below {:.4}, which growth x time = {growth:.4} asks for: \
         where S grows that much, what is read there comes from where the profile is not exp(-p)",
        window.point,
        window.point - window.distance
    )
}

/// The readings of `series` by which the error is estimated, which `at` gives for a distance of the
/// second point from the first. The spectrum of `−ST` lies in `spectrum`.
fn error_estimator(
    case: &Case,
    series: &Series,
    spectrum: [f64; 2],
    at: impl Fn(f64) -> Vec<Reading>,
) -> ErrorEstimator {
    match case.recovery_points {
        0..2 => ErrorEstimator { readings: at(0.0), efficiency: 1.0, doubt: f64::INFINITY },
        // The two errors are independent; the second is at most e times as large, and may cancel
        // the first or add to it.
        _ if series.modes() > MOST_TO_COMPARE => ErrorEstimator {
            readings: at(SECOND_POINT),
            efficiency: 1f64.hypot(SECOND_POINT.exp()).sqrt(),
            doubt: f64::INFINITY,
        },
        _ => most_alike(series, spectrum, at),
    }
}

/// A profile and its window, with what they meet.
struct PlannedProfile {
    requirements: ProfileRequirements,
    profile: Profile,
    window: Window,
}

impl PlannedProfile {
    /// The profile of `case`, with warnings of an interval that is short.
    ///
    /// # Errors
    /// As [`plan_placement`].
    fn new(case: &Case, bounds: &Bounds, ratio: f64, warnings: &mut Vec<String>) -> Result<Self> {
        let requirements = requirements(case, bounds, ratio);
        let PlacedProfile { profile, window } =
            match Profile::plan(&case.warp.choice(), &requirements) {
                Some(planned) => planned,
                None => relaxed(case, bounds, ratio, &requirements, warnings)?,
            };
        Ok(Self { requirements, profile, window })
    }
}

/// What [`plan_placement`] plans of a case that gives no interval and no points and takes analytic
/// coefficients, before any of these is computed.
pub(crate) struct Outline {
    /// The profile.
    pub profile: Profile,
    /// `p◇`.
    pub point: f64,
    /// `P`.
    pub period: f64,
    /// Modes `l ≥ 0` on that period; as a float, since there may be too many to count.
    pub modes: f64,
}

impl Outline {
    /// The outline of the plan of `case`.
    ///
    /// # Errors
    /// As [`plan_placement`], but for the number of modes.
    pub fn new(case: &Case, bounds: &Bounds, ratio: f64) -> Result<Self> {
        if takes_one_mode(case, bounds) {
            let profile = Constant::default();
            let period = profile.series.period;
            return Ok(Self { profile: profile.into(), point: 0.0, period, modes: 1.0 });
        }
        let PlannedProfile { profile, window, .. } =
            PlannedProfile::new(case, bounds, ratio, &mut Vec::new())?;
        let (period, modes) = match profile.form() {
            ProfileForm::Series(series) => (series.period, series.modes() as f64),
            ProfileForm::Transform(_) => (window.period, window.modes(window.period)),
        };
        Ok(Self { point: window.point + shift(case, bounds), profile, period, modes })
    }
}

/// Whether `A` is skew (`S = 0`) and the case does not need the warped field at other `p`.
pub(crate) fn takes_one_mode(case: &Case, bounds: &Bounds) -> bool {
    let warp = &case.warp;
    let by_hand = warp.choice() != ProfileChoice::Planned || warp.recovery.is_some();
    let is_shown = case.warped_field || case.plateau.is_some();
    let shifted = shift(case, bounds) != 0.0;
    bounds.is_skew() && !bounds.inflow && !by_hand && !is_shown && !shifted
}

/// The one mode of a skew `A`, which is the solution. There is no second reading, as it would equal
/// the first.
fn one_mode() -> Placement {
    let profile = Constant::default();
    let series = profile.series.clone();
    Placement {
        interval: [-0.5 * series.period, 0.5 * series.period],
        series,
        profile: Some(profile.into()),
        readings: vec![Reading { method: RecoveryMethod::Point, point: 0.0, width: 0.0 }],
        plateau: Vec::new(),
        estimator_efficiency: 1.0,
        estimator_doubt: f64::INFINITY,
        warnings: Vec::new(),
    }
}

/// The placement for a given warped field on `points` points of `interval`, assumed to be `e^{−p}
/// f` on the domain of dependence of the recovery point.
///
/// # Errors
/// [`Error::Input`] if the recovery point is not in the interval; [`Error::Modes`] for too many
/// points.
fn from_file(case: &Case, bounds: &Bounds, interval: [f64; 2], points: usize) -> Result<Placement> {
    let period = interval[1] - interval[0];
    if points / 2 + 1 > MOST_MODES {
        let profile = "that of initial.warped".to_owned();
        return Err(too_many_modes(case, profile, (points / 2 + 1) as f64));
    }
    // Information arrives from up to λ⁺T below.
    let growth = bounds.growth.max(0.0) * case.duration();
    let point = case.warp.recovery.unwrap_or(growth);
    if !(interval[0]..interval[1]).contains(&point) {
        let [lower, upper] = interval;
        return Err(Error::Input(format!(
            "solver.warp.recovery: f would be read at p = {point}; the points of initial.warped \
            go from {lower:.4} to {upper:.4}"
        )));
    }
    let series = Series::ones(period, points);
    let window =
        Window { point, distance: point - growth, period, cutoff: series.wavenumber(points / 2) };
    let readings = readings(case, &window, interval, SECOND_POINT);
    Ok(Placement {
        estimator_efficiency: 1.0,
        estimator_doubt: f64::INFINITY,
        plateau: plateau(case, &window, interval, readings[0].width),
        warnings: vec![format!(
            "initial.warped: f is e^p w read at p = {point:.4}, which is right where w(0) is \
            e^(-p) f for all p above {:.4}",
            point - growth
        )],
        profile: None,
        series,
        interval,
        readings,
    })
}

/// The error that a profile has more modes than a run may have.
fn too_many_modes(case: &Case, profile: String, modes: f64) -> Error {
    Error::Modes { profile, modes, limit: MOST_MODES, tolerance: case.tolerance }
}

/// The series of a profile that is known on the line, and its interval: both planned, unless the
/// case gives them.
fn transformed(
    case: &Case,
    requirements: &ProfileRequirements,
    profile: &Profile,
    shape: &dyn ProfileShape,
    window: &Window,
) -> Result<(Series, [f64; 2])> {
    let warp = &case.warp;
    let interval = warp.interval.unwrap_or_else(|| requirements.ends(shape, window));
    let fixed = warp.interval.is_some() || requirements.sampled;
    let period = if fixed { interval[1] - interval[0] } else { window.period };
    let modes = warp.points.map_or(window.modes(period), |points| (points / 2 + 1) as f64);
    if modes > MOST_MODES as f64 {
        return Err(too_many_modes(case, profile.to_string(), modes));
    }
    let series = match (warp.coefficients, warp.points) {
        (Coefficients::Sampled, points) => {
            let points = points.unwrap_or(2 * (modes as usize - 1).max(1));
            Series::sampled(interval, points, |p| shape.value(p))
        }
        (Coefficients::Analytic, Some(points)) => {
            Series::analytic_points(period, points, |mu| shape.coefficient(mu))
        }
        (Coefficients::Analytic, None) => {
            Series::analytic(period, modes as usize, |mu| shape.coefficient(mu))
        }
    };
    Ok((series, interval))
}

/// A warning about large growth that the case causes: no weights although particles graze, or a
/// small `δ`.
fn much_growth(case: &Case, bounds: &Bounds) -> Option<String> {
    let growth = bounds.growth * case.duration();
    if growth <= MUCH_GROWTH {
        return None;
    }
    let grazes = bounds.jumps && law_of(case.interface).may_grow() && !case.warp.weights;
    let (key, instead) = match case.warp.delta {
        _ if grazes => (
            "solver.warp.weights = \"none\"".to_owned(),
            "\"dissipative\", or scheme.interface = \"conservative\", keeps it small",
        ),
        Delta::Given(delta) if bounds.inflow => (
            format!("solver.warp.delta = {delta:e}"),
            "a larger one, or none given by hand, keeps it small",
        ),
        Delta::Largest if bounds.inflow => {
            ("solver.warp.delta = \"max\"".to_owned(), "none given by hand keeps it small")
        }
        _ => return None,
    };
    Some(format!(
        "{key}: growth x time may be up to {growth:.3}, where {MUCH_GROWTH} is much; what is \
        wrong with a mode is read up to {:.1e} times as \
         large; {instead}",
        growth.exp()
    ))
}

/// `σT` of the spectral shift.
fn shift(case: &Case, bounds: &Bounds) -> f64 {
    case.warp.shift.of(bounds.growth) * case.duration()
}

/// The requirements on the profile. All effects share the tolerance. If the interval is given by
/// hand, any one effect may take the whole tolerance, and the second reading may be worse.
fn requirements(case: &Case, bounds: &Bounds, ratio: f64) -> ProfileRequirements {
    let (warp, time) = (&case.warp, case.duration());
    // Spectral shift: u = e^{σt} ũ, ũ' = (A − σ) ũ, planned for.
    let shift = shift(case, bounds);
    let growth = (bounds.growth * time - shift).max(0.0);
    let decay = bounds.decay * time + shift;
    let tolerance = warp.share * case.tolerance / ratio * libm::exp(-shift.max(0.0));
    let width = width(warp);
    let second = if case.recovery_points > 1 { SECOND_POINT } else { 0.0 };
    let mut requirements = ProfileRequirements::new(tolerance, growth, decay, width + second);
    requirements.round_off = propagate::round_off(propagate::steps(&case.propagator, time));
    requirements.recovery = warp.recovery;
    requirements.interval = warp.interval;
    requirements.sampled = warp.coefficients == Coefficients::Sampled;
    if requirements.sampled {
        requirements.truncation = SAMPLED_TRUNCATION;
    }
    if requirements.interval.is_some() {
        requirements.images = 1.0;
        requirements.reach = width;
    }
    requirements
}

/// Width in `p` that the readings need above `p◇`.
fn width(warp: &Warp) -> f64 {
    match warp.recovery_method {
        RecoveryMethod::Point => 0.0,
        RecoveryMethod::Integral | RecoveryMethod::LeastSquares => WINDOW,
    }
}

/// The plan if the guaranteed one does not fit into the interval given by hand: for the decay of
/// the transport alone, with a warning. Or the reason why there is none.
fn relaxed(
    case: &Case,
    bounds: &Bounds,
    ratio: f64,
    requirements: &ProfileRequirements,
    warnings: &mut Vec<String>,
) -> Result<PlacedProfile<Profile>> {
    let choice = &case.warp.choice();
    let growth = requirements.growth;
    let open = ProfileRequirements { interval: None, shortest: true, ..*requirements };
    let Some(guaranteed) = Profile::plan(choice, &open) else {
        return Err(no_profile(case, ratio, &open));
    };
    let transport = ProfileRequirements {
        decay: bounds.dissipation * case.duration() + shift(case, bounds),
        ..*requirements
    };
    if let Some(planned) = Profile::plan(choice, &transport) {
        warnings.push(format!(
            "solver.warp.interval has a length of {:.4}; {:.4} guarantees the tolerance, with the \
            decay x time of at most {:.4} \
             that follows from a growth x time of at most {growth:.4}; without that growth it is \
             long enough",
            length(requirements),
            guaranteed.window.period,
            requirements.decay
        ));
        return Ok(planned);
    }
    // The state at the start, with its auxiliary unknowns, may be far larger than the field at the
    // end. Then an error relative to the state may be large relative to the field.
    let of_state = ProfileRequirements { tolerance: requirements.tolerance * ratio, ..transport };
    if let Some(planned) = Profile::plan(choice, &of_state) {
        warnings.push(format!(
            "solver.warp.interval has a length of {:.4}: long enough for the tolerance relative \
            to the state at the start, {ratio:.3e} times \
             as large as the field at the end; relative to the field {:.4} guarantees it",
            length(requirements),
            guaranteed.window.period
        ));
        return Ok(planned);
    }
    // A sufficient interval for the refusal's message: its ends for the decay of the transport
    // alone, relative to the state.
    let open = ProfileRequirements { decay: of_state.decay, tolerance: of_state.tolerance, ..open };
    let placed = Profile::plan(choice, &open).unwrap_or(guaranteed);
    Err(too_short(case, requirements, &open, &placed))
}

/// The refusal of the interval of `requirements`, with that of `placed`, which meets `open`.
fn too_short(
    case: &Case,
    requirements: &ProfileRequirements,
    open: &ProfileRequirements,
    PlacedProfile { profile, window }: &PlacedProfile<Profile>,
) -> Error {
    let [lower, upper] = profile.ends(open, window);
    Error::Interval {
        place: case.interval_place.clone(),
        given: requirements.interval.unwrap_or_default(),
        needed: window.period,
        ends: [(lower * 1e3).floor() / 1e3, (upper * 1e3).ceil() / 1e3],
        point: window.point,
        tolerance: case.tolerance,
    }
}

/// Why no profile meets `requirements`, whatever the interval.
fn no_profile(case: &Case, ratio: f64, requirements: &ProfileRequirements) -> Error {
    let (growth, share) = (requirements.growth, case.warp.share);
    match case.warp.recovery {
        Some(point) if !requirements.keeps_digits(point) => Error::Recovery {
            point,
            highest: requirements.highest_point(),
            tolerance: case.tolerance,
        },
        _ => match Profile::smallest_tolerance(&case.warp.choice(), requirements) {
            Some(smallest) if smallest * ratio / share <= LARGEST_TOLERANCE => Error::Tolerance {
                place: case.tolerance_place.clone(),
                tolerance: case.tolerance,
                smallest: round_up(smallest * ratio / share),
                ratio,
                growth,
            },
            _ => Error::Growth { ratio, growth },
        },
    }
}

fn length(requirements: &ProfileRequirements) -> f64 {
    requirements.interval.map_or(0.0, |[lower, upper]| upper - lower)
}

/// `x > 0` rounded up to two digits.
fn round_up(x: f64) -> f64 {
    let unit = 10f64.powi(x.log10().floor() as i32 - 1);
    (x / unit * (1.0 + 1e-9)).ceil() * unit
}

/// The warning for a number of points that is too small for the tolerance. It is no error, since
/// studies of convergence in `N_p` need such runs.
fn too_few(
    requirements: &ProfileRequirements,
    shape: &dyn ProfileShape,
    window: &Window,
    period: f64,
    points: usize,
) -> Option<String> {
    // The omitted modes and, for samples, their aliases; relative to the state.
    let folded = if requirements.sampled { 0.5 / SAMPLED_TRUNCATION } else { 1.0 };
    let tail = shape.tail(PI * points as f64 / period, window.distance.max(0.0));
    let bound = folded * window.point.exp() * tail;
    let needed = 2.0 * (0.5 * window.cutoff * period / PI).ceil();
    (bound > requirements.tolerance).then(|| {
        format!(
            "solver.warp.points = {points}: the modes left out may add {bound:.1e} of the state, \
            the tolerance allows {:.1e}; \
             {needed} points do",
            requirements.tolerance
        )
    })
}

/// The reading at `p◇` and the one above it for the error estimate; both within an interval given
/// by hand.
fn readings(case: &Case, window: &Window, interval: [f64; 2], apart: f64) -> Vec<Reading> {
    let room =
        if case.warp.interval.is_some() { interval[1] - window.point } else { f64::INFINITY };
    let width = width(&case.warp).min(0.5 * room);
    let second = apart.min(0.5 * room);
    (0..case.recovery_points)
        .map(|k| Reading {
            method: case.warp.recovery_method,
            point: window.point + k as f64 * second,
            width,
        })
        .collect()
}

/// The readings, and the relation of their distance to the error.
struct ErrorEstimator {
    readings: Vec<Reading>,
    /// The part of the error that the distance shows.
    efficiency: f64,
    /// Bound, for any state, on the factor by which that part may deviate.
    doubt: f64,
}

/// The readings of a series with an oscillating error. The second is placed where their distance
/// shows about the same part of the error for any state.
fn most_alike(
    series: &Series,
    spectrum: [f64; 2],
    at: impl Fn(f64) -> Vec<Reading>,
) -> ErrorEstimator {
    /// Number of points tried: the last is [`SECOND_POINT`] above the first reading, the first half
    /// as far (closer ones share too much of the error).
    const TRIED: u32 = 16;
    let candidates = (TRIED / 2..=TRIED).map(|i| {
        let readings = at(SECOND_POINT * f64::from(i) / f64::from(TRIED));
        let [least, largest] = visible_error_parts(series, [&readings[0], &readings[1]], spectrum);
        (readings, least, largest)
    });
    let ratio = |(_, least, largest): &(Vec<Reading>, f64, f64)| largest / least;
    let best = candidates.min_by(|a, b| ratio(a).total_cmp(&ratio(b)));
    let (readings, least, largest) = best.unwrap_or_else(|| (at(SECOND_POINT), 1.0, f64::INFINITY));
    ErrorEstimator {
        readings,
        efficiency: (least * largest).sqrt(),
        doubt: (largest / least).sqrt(),
    }
}

fn moved(mut readings: Vec<Reading>, distance: f64) -> Vec<Reading> {
    readings.iter_mut().for_each(|r| r.point += distance);
    readings
}

/// The readings of the plateau, equally spaced.
fn plateau(case: &Case, window: &Window, interval: [f64; 2], width: f64) -> Vec<Reading> {
    let Some(plateau) = &case.plateau else {
        return Vec::new();
    };
    let from = plateau.from.unwrap_or((window.point - PLATEAU).max(interval[0]));
    let to = plateau.to.unwrap_or((window.point + PLATEAU).min(interval[1]).max(from));
    (0..plateau.points)
        .map(|k| Reading {
            method: case.warp.recovery_method,
            point: from + (to - from) * k as f64 / (plateau.points - 1) as f64,
            width,
        })
        .collect()
}
