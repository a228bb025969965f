//! Where the warped field is read: the readings that give `u`, those of the plateau, and how well
//! the distance of two readings shows the error.
//!
//! Uses requirements (the width of a reading), profile, recovery.

use crate::problem::case::Case;
use crate::schrodingerization::placement::requirements::{SECOND_POINT, width};
use crate::schrodingerization::profile::series::Series;
use crate::schrodingerization::profile::window::PLATEAU;
use crate::schrodingerization::profile::{EstimatorQuality, Window};
use crate::schrodingerization::recovery::{Reading, visible_error_parts};

/// For series with more modes than this, the two readings are not compared mode by mode.
const MOST_TO_COMPARE: usize = 1 << 13;

/// The reading at `p◇` and the one above it for the error estimate; both within an interval given
/// by hand.
pub(super) fn readings(
    case: &Case,
    window: &Window,
    interval: [f64; 2],
    apart: f64,
) -> Vec<Reading> {
    let room =
        if case.warp.interval.is_some() { interval[1] - window.point } else { f64::INFINITY };
    let width = width(&case.warp).min(0.5 * room);
    let second = apart.min(0.5 * room);
    (0..case.output.recovery_points)
        .map(|k| Reading {
            method: case.warp.recovery_method,
            point: window.point + k as f64 * second,
            width,
        })
        .collect()
}

/// The readings of the plateau, equally spaced.
pub(super) fn plateau(
    case: &Case,
    window: &Window,
    interval: [f64; 2],
    width: f64,
) -> Vec<Reading> {
    let Some(plateau) = &case.output.plateau else {
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

/// The readings at points higher by `distance`.
pub(super) fn moved(mut readings: Vec<Reading>, distance: f64) -> Vec<Reading> {
    readings.iter_mut().for_each(|r| r.point += distance);
    readings
}

/// The readings, and the relation of their distance to the error.
pub(super) struct ErrorEstimator {
    /// The readings, the main one first.
    pub readings: Vec<Reading>,
    /// The quality of the estimate from two readings.
    pub quality: EstimatorQuality,
}

/// The readings of `series` by which the error is estimated, which `at` gives for a distance of the
/// second point from the first. The spectrum of `−ST` lies in `spectrum`.
pub(super) fn error_estimator(
    case: &Case,
    series: &Series,
    spectrum: [f64; 2],
    at: impl Fn(f64) -> Vec<Reading>,
) -> ErrorEstimator {
    match case.output.recovery_points {
        0..2 => ErrorEstimator { readings: at(0.0), quality: EstimatorQuality::UNKNOWN },
        // The two errors are independent; the second is at most e times as large, and may cancel
        // the first or add to it.
        _ if series.modes() > MOST_TO_COMPARE => ErrorEstimator {
            readings: at(SECOND_POINT),
            quality: EstimatorQuality {
                efficiency: 1f64.hypot(SECOND_POINT.exp()).sqrt(),
                ..EstimatorQuality::UNKNOWN
            },
        },
        _ => most_alike(series, spectrum, at),
    }
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
    let (efficiency, doubt) = ((least * largest).sqrt(), (largest / least).sqrt());
    ErrorEstimator { readings, quality: EstimatorQuality { efficiency, doubt } }
}
