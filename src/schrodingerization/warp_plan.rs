//! The series in `p` that a run takes: period, modes, coefficients, readings, applications.

use crate::base::checksum;
use crate::base::error::{Error, Result};
use crate::matrix::bounds::{Bounds, LONGEST_SPAN};
use crate::matrix::lanes::LANES;
use crate::problem::case::{Case, Propagation, Reductions};
use crate::problem::grid::PhaseSpace;
use crate::problem::legs::Leg;
use crate::propagate::commutator_free::stage_degree;
use crate::propagate::method::BatchCoupling;
use crate::propagate::{self, PropagationSpan, descriptor};
use crate::schrodingerization::placement::{Placement, plan_placement};
use crate::schrodingerization::profile::series::{Series, points};
use crate::schrodingerization::profile::{EstimatorQuality, Profile, ProfileForm};
use crate::schrodingerization::recovery::Reading;
use num_complex::Complex64;
use serde::Serialize;
use std::collections::BTreeSet;
use std::sync::Arc;

/// The plan of a Schrödingerized run, independent of the ranks.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct WarpPlan {
    /// `‖ũ(0)‖/‖f(T)‖` planned for.
    pub ratio: f64,
    /// The tolerance the profile is planned for.
    pub state_tolerance: f64,
    /// The profile; `None` if the warped field is read from a file.
    pub profile: Option<Profile>,
    /// Fourier series of the profile.
    pub series: Series,
    /// `[L, R]`: given by hand, or derived from the tolerance. With analytic coefficients only its
    /// length matters.
    pub interval: [f64; 2],
    /// Number of modes that are propagated: those with `l ≥ 0`, as the others are their conjugates;
    /// with `solver.reduce.modes = false` also those with `l = −1, −2, …` after them.
    pub modes: usize,
    /// Points `N_p` of the whole warped field, where all modes are kept.
    pub points: Option<usize>,
    /// The readings of `u`; a second one gives the error estimate.
    pub readings: Vec<Reading>,
    /// How well the distance of the two readings shows the error.
    #[serde(flatten)]
    pub estimator_quality: EstimatorQuality,
    /// The readings of `output.plateau`, of the first field.
    pub plateau: Vec<Reading>,
    /// The work of each mode: applications (Chebyshev: the degree of its series; Krylov: at most),
    /// or solves of an implicit method. The layout assigns modes to batches and ranks.
    pub work: Vec<usize>,
    /// The legs of the run.
    #[serde(skip)]
    pub legs: Vec<Leg>,
    /// The work by leg, then by mode. Legs of one length share it.
    #[serde(skip)]
    pub leg_work: Vec<Arc<[usize]>>,
    /// Allowed relative error of each mode: its share of a tenth of the state's tolerance; if the
    /// warped field is read from a file, the tolerance itself, so that the whole field is within
    /// the tolerance of its norm.
    #[serde(skip)]
    pub mode_tolerances: Vec<f64>,
    /// Applications, over the modes and fields, all stages of an inflow that depends on time
    /// included; 0 where systems are solved instead. A mode counts with its own degree, on any
    /// ranks: its lane idles while longer modes of its batch continue.
    pub applications: usize,
    /// Solves of an implicit method, over the modes.
    pub solves: usize,
    /// `Σ |weight|` of the first reading: the amplification of round-off.
    pub amplification: f64,
    /// Warnings for the user.
    pub warnings: Vec<String>,
}

/// Cost of an application whose result is read and added to a sum, relative to one of a backward
/// sum.
const READING: f64 = 1.3;
/// Additional cost of such an application for each output time and moment, relative to a velocity
/// cell.
const ADDING: f64 = 0.1;

/// Refuses a run by modes whose generator has at least this `rate`, if it would be too long.
///
/// # Errors
/// [`Error::TooLong`].
pub fn refuse_too_long(case: &Case, rate: f64) -> Result<()> {
    if rate * case.duration() <= LONGEST_SPAN {
        return Ok(());
    }
    Err(Error::TooLong {
        end: case.end,
        rate,
        quantity: "the spectrum of S spans",
        span: 2.0 * rate * case.duration(),
        limit: 2.0 * LONGEST_SPAN,
    })
}

impl WarpPlan {
    /// The reason why the distance of the two readings may not estimate the error; `None` if it
    /// does.
    pub fn estimate_doubt(&self) -> Option<&'static str> {
        self.profile.as_ref()?.estimate_doubt(self.modes, self.estimator_quality)
    }

    /// Whether `solver.warp.points` can be given; a file of the warped field has its own `N_p`, and
    /// so has a series, as it is no function on the whole line.
    pub fn takes_points(&self) -> bool {
        let is_function = |profile: &Profile| matches!(profile.form(), ProfileForm::Transform(_));
        self.profile.as_ref().is_some_and(is_function)
    }

    /// Plans profile, modes and degrees for growth bound `bounds.growth`.
    ///
    /// # Errors
    /// [`Error::Tolerance`], [`Error::Growth`] and [`Error::Recovery`] when round-off forbids the
    /// tolerance, [`Error::Interval`] when the interval given by hand is too short,
    /// [`Error::Modes`] and [`Error::TooLong`] when the run would be too large.
    pub fn new(case: &Case, bounds: &Bounds, ratio: f64) -> Result<Self> {
        refuse_too_long(case, bounds.rate)?;
        let placement = plan_placement(case, bounds, ratio)?;
        let (series, reading) = (&placement.series, &placement.readings[0]);
        let modes = PropagatedModes::of(&case.reductions, series);
        let tolerance = |l| placement.mode_tolerance(case, ratio, modes.source(l).number);
        let mode_tolerances: Vec<f64> = (0..modes.count).map(tolerance).collect();
        let PlannedLegs { legs, work: leg_work } =
            PlannedLegs::cheapest(case, bounds, &modes, &mode_tolerances);
        let work: Vec<usize> =
            (0..modes.count).map(|l| leg_work.iter().map(|work| work[l]).sum()).collect();
        let total = case.fields.len() * total_work(case.duration(), bounds, &modes, &work);
        let (applications, solves) = match case.propagator.method.order() {
            0 => (total, 0),
            _ => (0, total),
        };
        Ok(Self {
            ratio,
            state_tolerance: case.warp.share * case.tolerance / ratio,
            modes: modes.count,
            applications,
            solves,
            amplification: modes.amplification(reading),
            points: (case.output.warped_field || case.warped_start.is_some())
                .then(|| points(series)),
            mode_tolerances,
            work,
            legs,
            leg_work,
            estimator_quality: placement.quality,
            readings: placement.readings,
            plateau: placement.plateau,
            interval: placement.interval,
            profile: placement.profile,
            series: placement.series,
            warnings: placement.warnings,
        })
    }

    /// The plan of all modes of `series` in one leg, each to `tolerance` relative to its norm.
    /// `readings` are the recoveries, and need not be accurate.
    pub fn of_series(
        case: &Case,
        bounds: &Bounds,
        series: Series,
        readings: Vec<Reading>,
        tolerance: f64,
    ) -> Self {
        let modes = PropagatedModes { count: series.modes(), series: &series };
        let span = PropagationSpan { time: case.duration(), tolerance };
        let mut scratch = Vec::new();
        let mut of_mode = |l| {
            let mu = series.wavenumber(l);
            propagate::work(&case.propagator, bounds, mu, span, &mut scratch)
        };
        let work: Vec<usize> = (0..modes.count).map(&mut of_mode).collect();
        Self {
            ratio: 1.0,
            state_tolerance: tolerance,
            profile: None,
            interval: [0.0, series.period],
            modes: modes.count,
            points: None,
            plateau: Vec::new(),
            estimator_quality: EstimatorQuality::UNKNOWN,
            legs: vec![Leg::new(case.duration(), false)],
            leg_work: vec![work.as_slice().into()],
            mode_tolerances: vec![tolerance; modes.count],
            applications: case.fields.len() * work.iter().sum::<usize>(),
            solves: 0,
            amplification: readings.first().map_or(0.0, |reading| modes.amplification(reading)),
            warnings: Vec::new(),
            work,
            readings,
            series,
        }
    }

    /// The number of modes that [`new`](Self::new) would plan; much cheaper than their work.
    ///
    /// # Errors
    /// As [`new`](Self::new).
    pub fn modes_of(case: &Case, bounds: &Bounds, ratio: f64) -> Result<usize> {
        let placement = plan_placement(case, bounds, ratio)?;
        Ok(PropagatedModes::of(&case.reductions, &placement.series).count)
    }

    /// Estimates, from a sample of the modes, the applications or solves over all modes and fields
    /// that [`new`](Self::new) would plan.
    ///
    /// # Errors
    /// As [`new`](Self::new).
    pub fn forecast(case: &Case, bounds: &Bounds, ratio: f64) -> Result<f64> {
        const SAMPLE: usize = 64;
        let placement = plan_placement(case, bounds, ratio)?;
        let modes = PropagatedModes::of(&case.reductions, &placement.series);
        let (count, stages) = (modes.count, bounds.stages.max(1));
        let mut scratch = Vec::new();
        let stride = count.div_ceil(SAMPLE);
        let (mut sum, mut sampled) = (0.0, 0);
        for l in (stride / 2..count).step_by(stride) {
            let number = modes.source(l).number;
            let span = PropagationSpan {
                time: case.duration() / stages as f64,
                tolerance: placement.mode_tolerance(case, ratio, number),
            };
            let mu = modes.wavenumber(l);
            let work = propagate::work(&case.propagator, bounds, mu, span, &mut scratch);
            sum += (stages * work) as f64;
            sampled += 1;
        }
        let mean = sum / f64::from(sampled.max(1));
        Ok(mean * (count * case.fields.len()) as f64)
    }

    /// A checksum: plans with the same bits have the same one.
    pub fn fingerprint(&self) -> u64 {
        let lengths = self.leg_work.iter().map(|work| work.len());
        let counts = lengths.chain(self.works());
        let bits = self.series.coefficients.iter().flat_map(|c| [c.re.to_bits(), c.im.to_bits()]);
        checksum::run_checksum(0, counts.map(|count| count as u64).chain(bits))
    }

    fn propagated(&self) -> PropagatedModes<'_> {
        PropagatedModes { series: &self.series, count: self.modes }
    }

    /// Factor of `w_l(T)` in `reading`.
    pub fn weight(&self, l: usize, reading: &Reading) -> Complex64 {
        self.propagated().weight(l, reading)
    }

    /// `μ` of mode `l`.
    pub fn wavenumber(&self, l: usize) -> f64 {
        self.propagated().wavenumber(l)
    }

    /// `Σ |weight|` of a reading.
    pub fn amplification(&self, reading: &Reading) -> f64 {
        self.propagated().amplification(reading)
    }

    /// Relative error that mode `l` is allowed in a leg.
    pub fn leg_tolerance(&self, l: usize) -> f64 {
        self.mode_tolerances[l] / self.leg_work.len() as f64
    }

    /// Least work of a mode in a leg.
    pub fn least_work(&self) -> usize {
        self.works().min().unwrap_or(0)
    }

    /// Most work of a mode in a leg.
    pub fn largest_work(&self) -> usize {
        self.works().max().unwrap_or(0)
    }

    fn works(&self) -> impl Iterator<Item = usize> {
        self.leg_work.iter().flat_map(|work| work.iter()).copied()
    }

    /// Number of legs of different lengths, each with its own table of [`work`](Self::leg_work).
    pub fn different_legs(&self) -> usize {
        let tables: BTreeSet<*const usize> = self.leg_work.iter().map(|w| w.as_ptr()).collect();
        tables.len()
    }
}

/// The legs of a run by modes.
struct PlannedLegs {
    legs: Vec<Leg>,
    /// `work[leg][l]`: the work of mode `l` in the leg.
    work: Vec<Arc<[usize]>>,
}

impl PlannedLegs {
    /// The legs of least cost: from one output time to the next, or past output times that need
    /// moments only.
    fn cheapest(
        case: &Case,
        bounds: &Bounds,
        modes: &PropagatedModes<'_>,
        tolerances: &[f64],
    ) -> Self {
        let with_work = |legs: Vec<Leg>| {
            let work = leg_work(&case.propagator, bounds, modes, tolerances, &legs);
            Self { legs, work }
        };
        let single = with_work(Leg::all(case));
        let joined = Leg::joined(&single.legs);
        let passes = descriptor(case.propagator.method).passes_times();
        if !passes || joined.len() == single.legs.len() {
            return single;
        }
        let joined = with_work(joined);
        if joined.cost(&case.space) < single.cost(&case.space) { joined } else { single }
    }

    /// The work of all modes in all legs, with that of passing output times.
    fn cost(&self, space: &PhaseSpace) -> f64 {
        let of_leg = |(leg, work): (&Leg, &Arc<[usize]>)| {
            cost_of_passing(space, leg.passed.len()) * work.iter().sum::<usize>() as f64
        };
        self.legs.iter().zip(&self.work).map(of_leg).sum()
    }
}

/// Relative cost of an application in a leg that passes `times` output times. Like the plan, it
/// does not depend on ranks or processor.
fn cost_of_passing(space: &PhaseSpace, times: usize) -> f64 {
    if times == 0 {
        return 1.0;
    }
    let moments = (space.dimension() + 2) as f64;
    let each = moments / space.velocity_cells() as f64;
    READING + ADDING * each * times as f64
}

/// The work of each mode in each leg. It is found once for legs of one length.
fn leg_work(
    propagator: &Propagation,
    bounds: &Bounds,
    modes: &PropagatedModes<'_>,
    tolerances: &[f64],
    legs: &[Leg],
) -> Vec<Arc<[usize]>> {
    /// Legs between equidistant times differ by round-off.
    const ROUND_OFF: f64 = 1e-9;
    let mut scratch = Vec::new();
    let mut of_leg = |leg: &Leg| -> Arc<[usize]> {
        let of_mode = |l: usize| {
            let span =
                PropagationSpan { time: leg.time, tolerance: tolerances[l] / legs.len() as f64 };
            let mu = modes.wavenumber(l);
            let work = propagate::work(propagator, bounds, mu, span, &mut scratch);
            // For `k ≥ ht`, `J_k(ht)` grows with the time: the truncation error is largest at the
            // end.
            let turn = bounds.interval(mu).half_width * leg.time;
            if leg.passed.is_empty() { work } else { work.max(turn.ceil() as usize) }
        };
        let mut work: Vec<usize> = (0..modes.count).map(of_mode).collect();
        if descriptor(propagator.method).batch_coupling() == BatchCoupling::Coupled {
            // Each mode takes as many steps as the longest of its block.
            for block in work.rchunks_mut(LANES) {
                let most = block.iter().copied().max().unwrap_or(0);
                block.fill(most);
            }
        }
        work.into()
    };
    let mut found: Vec<Arc<[usize]>> = Vec::with_capacity(legs.len());
    for (k, leg) in legs.iter().enumerate() {
        let is_same = |other: &Leg| {
            (other.time - leg.time).abs() <= ROUND_OFF * leg.time
                && other.passed.is_empty() == leg.passed.is_empty()
        };
        let work = match legs[..k].iter().position(is_same) {
            Some(other) => found[other].clone(),
            None => of_leg(leg),
        };
        found.push(work);
    }
    found
}

/// The sum of `work` over the modes, all stages of a varying inflow included.
fn total_work(
    duration: f64,
    bounds: &Bounds,
    modes: &PropagatedModes<'_>,
    work: &[usize],
) -> usize {
    let (stages, mut scratch) = (bounds.stages, Vec::new());
    if stages == 0 {
        return work.iter().sum();
    }
    let of_mode = |(l, &work): (usize, &usize)| {
        let interval = bounds.interval(modes.wavenumber(l));
        stages * stage_degree(&mut scratch, interval.half_width * duration, work, stages)
    };
    work.iter().enumerate().map(of_mode).sum()
}

impl Placement {
    /// The relative error that a mode of the series is allowed: its share of a tenth of the state's
    /// tolerance. It does not depend on whether the conjugate is propagated, too.
    fn mode_tolerance(&self, case: &Case, ratio: f64, number: usize) -> f64 {
        if self.profile.is_none() {
            return case.tolerance;
        }
        let own = PropagatedModes { count: self.series.modes(), series: &self.series };
        let weight = own.weight(number, &self.readings[0]).norm();
        (case.tolerance / ratio / (10.0 * own.count as f64 * weight)).min(1.0)
    }
}

/// The mode of a series that gives a propagated one.
struct SourceMode {
    number: usize,
    /// Whether its conjugate is propagated.
    is_mirrored: bool,
}

/// The modes of a series that are propagated: its own, `l ≥ 0`, and perhaps after them their
/// conjugates.
#[derive(Clone, Copy)]
pub(crate) struct PropagatedModes<'a> {
    /// The series.
    pub series: &'a Series,
    /// How many are propagated.
    pub count: usize,
}

impl<'a> PropagatedModes<'a> {
    /// The modes of `series` in a run of a case with these `reductions`.
    fn of(reductions: &Reductions, series: &'a Series) -> Self {
        let own = series.modes();
        let conjugates = if reductions.every_mode {
            (0..own).filter(|&l| !series.is_unpaired(l)).count()
        } else {
            0
        };
        let count = own + conjugates;
        Self { series, count }
    }

    /// The mode of the series that gives the `l`-th.
    fn source(&self, l: usize) -> SourceMode {
        match l.checked_sub(self.series.modes()) {
            None => SourceMode { number: l, is_mirrored: false },
            Some(behind) => SourceMode { number: behind + 1, is_mirrored: true },
        }
    }

    /// `μ` of the `l`-th.
    fn wavenumber(&self, l: usize) -> f64 {
        let SourceMode { number, is_mirrored } = self.source(l);
        let mu = self.series.wavenumber(number);
        if is_mirrored { -mu } else { mu }
    }

    /// Factor of the `l`-th mode in `reading`; a propagated conjugate has half of it.
    fn weight(&self, l: usize, reading: &Reading) -> Complex64 {
        let (series, SourceMode { number, is_mirrored }) = (self.series, self.source(l));
        let both = self.count > series.modes() && !series.is_unpaired(number);
        let factor = series.factor(number) * if both { 0.5 } else { 1.0 };
        let weight = factor * reading.of_wave(series.wavenumber(number));
        if is_mirrored { weight.conj() } else { weight }
    }

    /// `Σ |weight|` of a reading.
    pub fn amplification(&self, reading: &Reading) -> f64 {
        (0..self.count).map(|l| self.weight(l, reading).norm()).sum()
    }
}
