//! Chooses profile, Fourier series and recovery points from the tolerance, the bounds of the
//! spectrum and the settings of the case.
//!
//! `requirements` says what the case asks of the profile, `readings` where the field is read,
//! `refusals` why there is no profile, `warnings` which settings given by hand are doubtful.

mod readings;
mod refusals;
mod requirements;
mod warnings;

use crate::base::error::{Error, Result};
use crate::matrix::bounds::Bounds;
use crate::problem::case::{Case, Coefficients, ProfileChoice, RecoveryMethod};
use crate::problem::limits::MOST_MODES;
use crate::schrodingerization::placement::readings::{
    ErrorEstimator, error_estimator, moved, plateau, readings,
};
use crate::schrodingerization::placement::refusals::{relaxed, too_many_modes};
use crate::schrodingerization::placement::requirements::{SECOND_POINT, requirements, shift};
use crate::schrodingerization::placement::warnings::{much_growth, recovery_is_low, too_few};
use crate::schrodingerization::profile::constant::Constant;
use crate::schrodingerization::profile::series::Series;
use crate::schrodingerization::profile::{
    EstimatorQuality, PlacedProfile, Profile, ProfileForm, ProfileRequirements, ProfileShape,
    Window,
};
use crate::schrodingerization::recovery::Reading;

/// The profile of a run and how it is read.
pub(crate) struct Placement {
    pub profile: Option<Profile>,
    pub series: Series,
    pub interval: [f64; 2],
    pub readings: Vec<Reading>,
    pub plateau: Vec<Reading>,
    /// The quality of the estimate from two readings.
    pub quality: EstimatorQuality,
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
    let ErrorEstimator { readings, quality } =
        error_estimator(case, &series, [shift, requirements.decay], at);
    Ok(Placement {
        quality,
        plateau: moved(plateau(case, &window, interval, readings[0].width), shift),
        profile: Some(profile),
        series,
        interval: if fixed { interval } else { interval.map(|p| p + shift) },
        readings: moved(readings, shift),
        warnings,
    })
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
    let is_shown = case.output.warped_field || case.output.plateau.is_some();
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
        quality: EstimatorQuality::UNKNOWN,
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
        quality: EstimatorQuality::UNKNOWN,
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
            Series::sampled(interval, points, shape.values())
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
