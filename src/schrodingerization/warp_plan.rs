//! The series in `p` that a run takes: period, modes, coefficients, readings, applications.

use crate::base::error::{Error, Result};
use crate::matrix::bounds::{Bounds, LONGEST_SPAN};
use crate::matrix::lanes::LANES;
use crate::problem::case::Case;
use crate::propagate;
use crate::propagate::chebyshev::Interval;
use crate::propagate::commutator_free::stage_degree;
use crate::propagate::method::BatchCoupling;
use crate::propagate::{Span, descriptor};
use crate::schrodingerization::placement::Placement;
use crate::schrodingerization::profile::Profile;
use crate::schrodingerization::profile::series::{Series, points};
use crate::schrodingerization::recovery::Reading;
use num_complex::Complex64;
use serde::Serialize;
use std::hash::{Hash, Hasher};

/// What a Schrödingerized run computes, for any ranks.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct WarpPlan {
    /// `‖ũ(0)‖/‖f(T)‖` planned for.
    pub ratio: f64,
    /// The tolerance the profile is planned for.
    pub state_tolerance: f64,
    /// The profile; none where the warped field is read from a file.
    pub profile: Option<Profile>,
    /// Its Fourier series.
    pub series: Series,
    /// `[L, R]`: given by hand, or one that the tolerance asks for; of the analytic coefficients only its length matters.
    pub interval: [f64; 2],
    /// Number of modes that are propagated: those with `l ≥ 0`, whose conjugates the others are; with `solver.reduce.modes = false`
    /// behind them those with `l = −1, −2, …`.
    pub modes: usize,
    /// Points `N_p` of the whole warped field, where all modes are kept.
    pub points: Option<usize>,
    /// How `u` is read; a second reading gives the error estimate.
    pub readings: Vec<Reading>,
    /// What part of the error the distance of the two readings shows; more than 1 where it overstates it.
    pub seen: f64,
    /// The readings of `output.plateau`, of the first field.
    pub plateau: Vec<Reading>,
    /// What each mode takes: applications (Chebyshev: the degrees of its series; Krylov: at most), or solves of an implicit
    /// method. Who computes it with which others is the layout's.
    pub work: Vec<usize>,
    /// The same by leg, from one output time to the next, then by mode.
    #[serde(skip)]
    pub leg_work: Vec<Vec<usize>>,
    /// Relative error that each mode is allowed: its share of a tenth of the state's tolerance; where the warped field is read from a
    /// file, the tolerance itself, so that the whole of it is within the tolerance of its norm.
    #[serde(skip)]
    pub mode_tolerances: Vec<f64>,
    /// Applications, over the modes and fields, all stages of an inflow that depends on time included; 0 where systems are
    /// solved instead. A mode counts with its own degree, on any ranks: where others of its batch go on, its lane is idle.
    pub applications: usize,
    /// Solves of an implicit method, over the modes.
    pub solves: usize,
    /// `Σ |weight|` of the first reading: how much round-off is amplified.
    pub amplification: f64,
    /// What the user should know.
    pub warnings: Vec<String>,
}

impl WarpPlan {
    /// Plans profile, modes and degrees for growth bound `bounds.growth`.
    ///
    /// # Errors
    /// [`Error::Tolerance`], [`Error::Growth`] and [`Error::Recovery`] when round-off forbids the tolerance, [`Error::Interval`] when the
    /// interval given by hand is too short, [`Error::Modes`] and [`Error::TooLong`] when it takes too much.
    pub fn new(case: &Case, bounds: &Bounds, ratio: f64) -> Result<Self> {
        let time = case.end;
        if bounds.rate * time > LONGEST_SPAN {
            return Err(Error::TooLong {
                end: time,
                rate: bounds.rate,
                span: 2.0 * bounds.rate * time,
                limit: 2.0 * LONGEST_SPAN,
            });
        }
        let state_tolerance = case.tolerance / ratio;
        let Placement {
            profile,
            series,
            interval,
            readings,
            plateau,
            seen,
            warnings,
        } = crate::schrodingerization::placement::place(case, bounds, ratio)?;
        let modes = modes_of(case, &series);
        let weight_of = |of: usize, l: usize| weight((&series, of), &readings[0], l).norm();
        let weight = |l: usize| weight_of(modes, l);
        // A mode and its conjugate share what is allowed, so that each is what it is without the other.
        let (own, share) = (series.modes(), |l| {
            weight_of(series.modes(), mode_of(&series, l).0)
        });
        let allowed = |l: usize| match profile {
            Some(_) => mode_tolerance(state_tolerance, own, share(l)),
            None => case.tolerance,
        };
        let mode_tolerances: Vec<f64> = (0..modes).map(allowed).collect();
        let mut scratch = Vec::new();
        let legs = case.legs();
        let mut leg_work = |&time: &f64| -> Vec<usize> {
            let mut work: Vec<usize> = (0..modes)
                .map(|l| {
                    let span = Span {
                        time,
                        tolerance: mode_tolerances[l] / legs.len() as f64,
                    };
                    let mu = wavenumber(&series, l);
                    propagate::work(&case.propagator, bounds, mu, span, &mut scratch)
                })
                .collect();
            if descriptor(case.propagator.method).batch_coupling() == BatchCoupling::Coupled {
                // Each takes what the longest of its block takes.
                for block in work.rchunks_mut(LANES) {
                    let most = block.iter().copied().max().unwrap_or(0);
                    block.fill(most);
                }
            }
            work
        };
        let leg_work: Vec<Vec<usize>> = legs.iter().map(&mut leg_work).collect();
        let work: Vec<usize> = (0..modes)
            .map(|l| leg_work.iter().map(|work| work[l]).sum())
            .collect();
        let mut each = |(l, work): (usize, &usize)| match bounds.stages {
            0 => *work,
            stages => {
                let mu = wavenumber(&series, l);
                let tau = Interval::new(mu, bounds.rate, bounds.growth).half_width * time;
                stages * stage_degree(&mut scratch, tau, *work, stages)
            }
        };
        let total = work.iter().enumerate().map(&mut each).sum();
        let (applications, solves) = match case.propagator.method.order() {
            0 => (total, 0),
            _ => (0, total),
        };
        Ok(Self {
            ratio,
            state_tolerance,
            modes,
            applications: case.fields.len() * applications,
            solves: case.fields.len() * solves,
            amplification: (0..modes).map(weight).sum(),
            seen,
            readings,
            plateau,
            interval,
            mode_tolerances,
            points: (case.warped_field || case.start.is_some()).then(|| points(&series)),
            work,
            leg_work,
            profile,
            series,
            warnings,
        })
    }

    /// How many modes [`new`](Self::new) would plan: known long before what each of them takes.
    ///
    /// # Errors
    /// As [`new`](Self::new).
    pub fn modes_of(case: &Case, bounds: &Bounds, ratio: f64) -> Result<usize> {
        let placed = crate::schrodingerization::placement::place(case, bounds, ratio)?;
        Ok(modes_of(case, &placed.series))
    }

    /// What [`new`](Self::new) would plan, nearly, from some of the modes: applications or solves over all of them and all fields.
    ///
    /// # Errors
    /// As [`new`](Self::new).
    pub fn forecast(case: &Case, bounds: &Bounds, ratio: f64) -> Result<f64> {
        /// Modes that are looked at, about.
        const SAMPLE: usize = 64;
        let placed = crate::schrodingerization::placement::place(case, bounds, ratio)?;
        let (series, reading) = (&placed.series, &placed.readings[0]);
        let (modes, stages) = (modes_of(case, series), bounds.stages.max(1));
        let mut scratch = Vec::new();
        let stride = modes.div_ceil(SAMPLE);
        let (mut sum, mut count) = (0.0, 0);
        for l in (stride / 2..modes).step_by(stride) {
            let weight = weight((series, modes), reading, l).norm();
            let allowed = mode_tolerance(case.tolerance / ratio, modes, weight);
            let span = Span {
                time: case.end / stages as f64,
                tolerance: allowed,
            };
            let mu = wavenumber(series, l);
            let work = propagate::work(&case.propagator, bounds, mu, span, &mut scratch);
            sum += (stages * work) as f64;
            count += 1;
        }
        let mean = sum / f64::from(count.max(1));
        Ok(mean * (modes * case.fields.len()) as f64)
    }

    /// A number that plans share which are the same to the last bit.
    pub fn fingerprint(&self) -> u64 {
        let mut hasher = std::hash::DefaultHasher::new();
        self.leg_work.hash(&mut hasher);
        for c in &self.series.coefficients {
            [c.re.to_bits(), c.im.to_bits()].hash(&mut hasher);
        }
        hasher.finish()
    }

    /// Factor of `w_l(T)` in `reading`.
    pub fn weight(&self, l: usize, reading: &Reading) -> Complex64 {
        weight((&self.series, self.modes), reading, l)
    }

    /// `μ` of mode `l`.
    pub fn wavenumber(&self, l: usize) -> f64 {
        wavenumber(&self.series, l)
    }

    /// `Σ |weight|` of a reading.
    pub fn amplification(&self, reading: &Reading) -> f64 {
        (0..self.modes)
            .map(|l| self.weight(l, reading).norm())
            .sum()
    }

    /// Relative error that mode `l` is allowed in a leg.
    pub fn leg_tolerance(&self, l: usize) -> f64 {
        self.mode_tolerances[l] / self.leg_work.len() as f64
    }

    /// Most work of a mode in a leg.
    pub fn largest_work(&self) -> usize {
        self.leg_work.iter().flatten().copied().max().unwrap_or(0)
    }
}

/// A mode's share of a tenth of the state's tolerance.
pub(crate) fn mode_tolerance(state_tolerance: f64, modes: usize, weight: f64) -> f64 {
    (state_tolerance / (10.0 * modes as f64 * weight)).min(1.0)
}

/// How many modes of `series` are propagated.
pub(crate) fn modes_of(case: &Case, series: &Series) -> usize {
    let own = series.modes();
    match case.reductions.every_mode {
        true => own + (0..own).filter(|&l| !series.is_alone(l)).count(),
        false => own,
    }
}

/// The mode of `series` that the `l`-th is, or, where the last is true, whose conjugate it is.
pub(crate) fn mode_of(series: &Series, l: usize) -> (usize, bool) {
    match l.checked_sub(series.modes()) {
        None => (l, false),
        Some(behind) => (behind + 1, true),
    }
}

pub(crate) fn wavenumber(series: &Series, l: usize) -> f64 {
    let (own, mirrored) = mode_of(series, l);
    if mirrored {
        -series.wavenumber(own)
    } else {
        series.wavenumber(own)
    }
}

/// Factor of the `l`-th of `modes` modes in `reading`.
pub(crate) fn weight((series, modes): (&Series, usize), reading: &Reading, l: usize) -> Complex64 {
    let (own, mirrored) = mode_of(series, l);
    let both = modes > series.modes() && !series.is_alone(own);
    let factor = series.factor(own) * if both { 0.5 } else { 1.0 };
    let weight = factor * reading.of_wave(series.wavenumber(own));
    if mirrored { weight.conj() } else { weight }
}
