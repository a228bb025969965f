//! The overlaps of the field at a cell, and the result of each estimator.

use crate::base::row_major::position;
use crate::matrix::observables::VelocityFactors;
use crate::parallel::communicator::Group;
use crate::problem::case::{Case, MeasurementEffort, ReadoutSettings};
use crate::problem::grid::MAX_DIMENSION;
use crate::problem::limits::{MOST_EVALUATIONS, MOST_SHOTS};
use crate::quantum::labelled_number::{LabelledNumber, Trust};
use crate::quantum::probability::Probabilities;
use crate::quantum::readout::measurement::{self, Estimate};
use crate::quantum::readout::random::{Stream, StreamKey};
use crate::quantum::readout::row::{Measured, Observable, OverlapEstimator, ReadoutRow, reason};
use std::f64::consts::FRAC_1_SQRT_2;
use std::ops::Range;

/// The recovered field on a rank's share, and the states that hold it.
pub struct ReadoutSource<'a> {
    /// The share: space cells, one range an axis.
    pub share: &'a [Range<usize>],
    /// `f` on it, velocities fastest.
    pub field: &'a [f64],
    /// `π` there.
    pub pi: &'a [f64],
    /// Whether `π` are relative volumes of the cells: the state of the field holds `√π f` then, and
    /// `f` with dissipative weights, which are undone.
    pub holds_volumes: bool,
    /// `min f` over all ranks.
    pub least: f64,
    /// Probabilities of the enlarged state.
    pub probabilities: &'a Probabilities,
    /// Whether `C_f` needs no measurement: a unitary flow keeps `‖u(0)‖`, and then `P` is known
    /// too.
    pub norm_is_known: bool,
    /// `ε_F`.
    pub state_error: LabelledNumber,
}

impl ReadoutSource<'_> {
    /// `C_f`.
    pub fn norm(&self) -> f64 {
        self.probabilities.norms.field
    }
}

/// `‖x‖`.
pub(crate) fn norm(x: impl Iterator<Item = f64>) -> f64 {
    x.map(|x| x * x).sum::<f64>().sqrt()
}

/// An overlap and the prefactor by which it gives a moment.
#[derive(Clone, Copy, Debug)]
struct Overlap {
    value: f64,
    prefactor: f64,
    /// `C_f Δv ‖q‖`, with volumes `C_f Δv ‖q/√π‖`, by which an error of the field's state enters
    /// the moment.
    of_field: f64,
}

/// The estimates of a moment that are drawn at random.
struct DrawnEstimates {
    /// For a `C_f` that is known.
    bare: Estimate,
    /// For a `C_f` that is measured.
    whole: Estimate,
}

/// The length of a measurement of an overlap and of `C_f`.
#[derive(Clone, Copy, Debug)]
struct Repetitions {
    /// Number of shots, or of runs of amplitude estimation.
    shots: f64,
    /// Number of values of the register of amplitude estimation; 0 for other estimators.
    evaluations: f64,
    /// Number of values of the register of amplitude estimation of `P`. 0 if `C_f` is not measured,
    /// or follows from the number of shots that succeed.
    norm_evaluations: f64,
}

/// The measurement of an observable at a cell by one estimator. It has what the mean velocity
/// needs, in which `C_f` cancels.
struct MeasuredMoment {
    measured: Measured,
    /// The estimate if `C_f` is known exactly.
    estimate: Option<Estimate>,
    bound: Option<f64>,
    evolutions: [LabelledNumber; 2],
}

impl Repetitions {
    /// Bound on the error of an overlap, whatever the overlap.
    fn of_overlap(self, estimator: OverlapEstimator) -> f64 {
        match estimator {
            OverlapEstimator::AllZero => measurement::all_zero_bound(self.shots),
            _ if estimator.coherent() => measurement::amplitude_bound(0.0, self.evaluations),
            _ => measurement::hadamard_bound(self.shots),
        }
    }
}

/// Sums over the field at a cell, equal on all ranks.
pub(crate) struct CellSums {
    /// `Σ_j q_j f_j` for each of [`crate::matrix::observables::MOMENTS`] kinds of `q`.
    moments: [f64; MAX_DIMENSION + 1],
    /// `Σ_j q_j²/π_j`.
    unweighted: [f64; MAX_DIMENSION + 1],
    /// `Σ_j f_j²`, with volumes `Σ_j π_j f_j²`.
    pub(crate) square: f64,
}

/// The data that all rows have in common.
pub(crate) struct ReadoutContext<'a> {
    pub case: &'a Case,
    pub source: &'a ReadoutSource<'a>,
    pub readout: &'a ReadoutSettings,
    pub factors: &'a VelocityFactors,
}

impl ReadoutContext<'_> {
    /// Sums over the velocities at `cell`, on all ranks. The cell is on one of them. Collective
    /// over `world`.
    pub(crate) fn sums(&self, world: &Group, cell: &[usize]) -> CellSums {
        let mut sums = self.sums_here(cell);
        let CellSums { moments, unweighted, square } = &mut sums;
        let mut places: Vec<&mut f64> =
            moments.iter_mut().chain(unweighted).chain([square]).collect();
        let everywhere = world.gathered(places.iter().map(|x| **x).collect());
        places.iter_mut().zip(everywhere).for_each(|(place, x)| **place = x);
        sums
    }

    /// Sums over the velocities at `cell` on this rank's share; zeros if the share does not contain
    /// it.
    pub(crate) fn sums_here(&self, cell: &[usize]) -> CellSums {
        let share = self.source.share;
        let velocities = self.factors.cells();
        let mut sums =
            CellSums { moments: Default::default(), unweighted: Default::default(), square: 0.0 };
        if let Some(place) = position(share, cell) {
            let here = place * velocities..(place + 1) * velocities;
            let cells = self.source.field[here.clone()].iter().zip(&self.source.pi[here]);
            for ((f, pi), q) in cells.zip(self.factors.each()) {
                sums.square += if self.source.holds_volumes { pi * f * f } else { f * f };
                for (k, q) in q.iter().take(MAX_DIMENSION + 1).enumerate() {
                    sums.moments[k] += q * f;
                    sums.unweighted[k] += q * q / pi;
                }
            }
        }
        sums
    }

    pub(crate) fn rows(&self, cell: &[usize], sums: &CellSums) -> Vec<ReadoutRow> {
        let n = self.case.space.dimension();
        let volume = self.case.space.velocity_cell_volume();
        let observables = Observable::all(n);
        let row = |place: usize| ReadoutRow::at(&self.case.space, cell, observables[place]);
        let linear: Vec<(ReadoutRow, Vec<MeasuredMoment>)> = (0..=n)
            .map(|k| {
                let mut row = row(k);
                row.value = LabelledNumber::exact(sums.moments[k] * volume);
                let moments = OverlapEstimator::ALL.map(|e| self.moment(&row, k, sums, e));
                (row, moments.into())
            })
            .collect();
        let velocities: Vec<ReadoutRow> = (1..=n)
            .map(|k| {
                let mut row = row(n + k);
                row.value = match sums.moments[0] {
                    0.0 => LabelledNumber::unavailable("the density is 0"),
                    rho => LabelledNumber::exact(sums.moments[k] / rho),
                };
                let pairs = linear[0].1.iter().zip(&linear[k].1);
                row.measured = pairs.map(|(rho, m)| ratio(rho, m)).collect();
                row
            })
            .collect();
        let linear = linear.into_iter().map(|(mut row, moments)| {
            row.measured = moments.into_iter().map(|m| m.measured).collect();
            row
        });
        linear.chain(velocities).collect()
    }

    /// The overlap of moment `k` with the state that `estimator` measures.
    fn overlap(&self, k: usize, sums: &CellSums, estimator: OverlapEstimator) -> Option<Overlap> {
        let volume = self.case.space.velocity_cell_volume();
        let size = if self.source.holds_volumes {
            sums.unweighted[k].sqrt()
        } else {
            norm(self.factors.each().iter().map(|q| q[k]))
        };
        let of_field = self.source.norm() * volume * size;
        let prefactor = if !estimator.enlarged() {
            of_field
        } else {
            // Σ e^{−2p_k} over the window is P_p C_w²/‖u‖².
            let p = self.source.probabilities;
            let state = p.norms.weighted.hypot(p.norms.auxiliary);
            let part = p.nearest().in_p.value()?.sqrt();
            state / part * volume * sums.unweighted[k].sqrt()
        };
        let value = sums.moments[k] * volume / prefactor;
        // Along an axis of one cell whose centre is 0 there is no momentum, and no state of it.
        let overlap = Overlap { value: value.clamp(-1.0, 1.0), prefactor, of_field };
        (prefactor > 0.0 && value.is_finite()).then_some(overlap)
    }

    /// Moment `k` at the cell of `row`.
    fn moment(
        &self,
        row: &ReadoutRow,
        k: usize,
        sums: &CellSums,
        estimator: OverlapEstimator,
    ) -> MeasuredMoment {
        let none = |measured: Measured| MeasuredMoment {
            evolutions: [&measured.evolutions_repeated, &measured.evolutions_coherent]
                .map(LabelledNumber::clone),
            measured,
            estimate: None,
            bound: None,
        };
        if let Some(why) =
            self.not_squared(row, sums).filter(|_| estimator == OverlapEstimator::AllZero)
        {
            return none(Measured::unavailable(estimator, why));
        }
        let Some(overlap) = self.overlap(k, sums, estimator) else {
            let why =
                "there is no state to overlap with: every velocity is 0, or nothing of p is known";
            return none(Measured::unavailable(estimator, why));
        };
        let overlapping = |why: &str| Measured {
            overlap: LabelledNumber::exact(overlap.value),
            ..Measured::unavailable(estimator, why)
        };
        let from_state = (self.source.state_error.value()).map(|error| overlap.of_field * error);
        let repetitions = match self.repetitions(estimator, overlap, from_state) {
            Ok(repetitions) => repetitions,
            Err(why) => return none(overlapping(&why)),
        };
        let within = |error: f64| from_state.map(|of| overlap.prefactor * error + of);
        let bound = within(self.bound(estimator, repetitions, overlap.value));
        let drawn = self.draw(row, estimator, overlap, repetitions);
        let undrawn = overlapping("so many shots or evaluations are not emulated");
        let effort = self.effort(estimator, repetitions, undrawn);
        let mut measured = Measured { bound: self.labelled(bound), ..effort };
        if let Some(DrawnEstimates { whole: estimate, .. }) = &drawn {
            measured.estimate = LabelledNumber::estimate(estimate.value, "drawn at random");
            measured.standard_error = if estimator.coherent() {
                LabelledNumber::unavailable(
                    "the distribution has no variance in closed form; see bound",
                )
            } else {
                LabelledNumber::estimate(estimate.error, "from the counts")
            };
        }
        let evolutions = self.evolutions(estimator, repetitions);
        let bare_bound = within(repetitions.of_overlap(estimator));
        MeasuredMoment {
            measured,
            estimate: drawn.map(|drawn| drawn.bare),
            bound: bare_bound,
            evolutions,
        }
    }

    /// The shots, evaluations and evolutions of a measurement; the rest as in `measured`.
    fn effort(
        &self,
        estimator: OverlapEstimator,
        repetitions: Repetitions,
        measured: Measured,
    ) -> Measured {
        let of_norm = self.norm_evolutions(estimator, repetitions);
        let [repeated, coherent] = self.evolutions(estimator, repetitions);
        let coherent = match (coherent.value(), of_norm.value()) {
            (Some(x), Some(y)) => coherent.with(x + y),
            _ => coherent,
        };
        Measured {
            shots: LabelledNumber::exact(repetitions.shots),
            evolutions_repeated: repeated,
            evolutions_coherent: coherent,
            evolutions_norm: of_norm,
            evaluations: if estimator.coherent() {
                LabelledNumber::exact(repetitions.evaluations)
            } else {
                LabelledNumber::unavailable("shots, and no amplitude estimation")
            },
            ..measured
        }
    }

    /// Whether `C_f` is measured with this estimator.
    fn measures_norm(&self, estimator: OverlapEstimator) -> bool {
        !estimator.enlarged() && !self.source.norm_is_known
    }

    /// Bound on the relative error of `C_f`, and with it of the part by which an amplified overlap
    /// is too small; 0 if `C_f` is not measured.
    fn of_norm(&self, estimator: OverlapEstimator, repetitions: Repetitions) -> [f64; 2] {
        if !self.measures_norm(estimator) {
            return [0.0; 2];
        }
        if !estimator.coherent() {
            // With n = N/P trials, |√(k/n) − √P| ≤ √(ln 40/n): that of an all-zero outcome.
            return [measurement::all_zero_bound(repetitions.shots), 0.0];
        }
        let error = measurement::root_bound(self.probability(), repetitions.norm_evaluations);
        [error, measurement::amplification_loss(error)]
    }

    /// Bound on the error of the measured `overlap`, relative to its prefactor.
    fn bound(&self, estimator: OverlapEstimator, repetitions: Repetitions, overlap: f64) -> f64 {
        let error = repetitions.of_overlap(estimator);
        let of_norm: f64 = self.of_norm(estimator, repetitions).iter().sum();
        error + (overlap.abs() + error) * of_norm
    }

    /// The probability `P` of the window or the slice that is read; NaN where it is not known.
    fn probability(&self) -> f64 {
        self.source.probabilities.nearest().all.or_nan()
    }

    /// Why `|overlap|²` does not give the observable: its sign is not known. `None` if it does.
    fn not_squared(&self, row: &ReadoutRow, sums: &CellSums) -> Option<&'static str> {
        if row.observable != Observable::Density {
            return Some("a momentum may have either sign, and |overlap|^2 has none");
        }
        let allowed = -self.source.state_error.or_zero() * self.source.norm();
        let negative = self.source.least < allowed || sums.moments[0] < 0.0;
        negative.then_some("f is negative somewhere by more than its error")
    }

    /// Draws what is measured; `None` where this takes more outcomes than are emulated.
    fn draw(
        &self,
        row: &ReadoutRow,
        estimator: OverlapEstimator,
        overlap: Overlap,
        repetitions: Repetitions,
    ) -> Option<DrawnEstimates> {
        let Repetitions { shots, evaluations, norm_evaluations } = repetitions;
        if shots > MOST_SHOTS || evaluations.max(norm_evaluations) > MOST_EVALUATIONS {
            return None;
        }
        let key = StreamKey {
            cell: row.number as u64,
            observable: row.observable.number(),
            estimator: estimator as u32,
        };
        let stream = &mut Stream::new(self.readout.seed, key);
        let (o, shots, evaluations) = (overlap.value, shots as u64, evaluations as u64);
        let drawn = match estimator {
            OverlapEstimator::AllZero => measurement::all_zero(stream, o, shots),
            _ if estimator.coherent() => measurement::amplitude_estimation(stream, o, evaluations),
            _ => measurement::hadamard(stream, o, shots),
        };
        let bare = Estimate {
            value: overlap.prefactor * drawn.value,
            error: overlap.prefactor * drawn.error,
        };
        let probability = self.probability();
        let (root, error) = match (self.measures_norm(estimator), estimator.coherent()) {
            (false, _) => (1.0, 0.0),
            (true, false) => {
                // With more trials than are emulated, the same number succeeds.
                let trials = (repetitions.shots / probability).min(MOST_SHOTS).round();
                let probability = (repetitions.shots / trials).min(1.0);
                let root =
                    measurement::root_by_successes(stream, probability, trials.max(1.0) as u64);
                (root, 0.5 * ((1.0 - probability) / repetitions.shots).sqrt())
            }
            (true, true) => {
                let root =
                    measurement::root_by_estimation(stream, probability, norm_evaluations as u64);
                (root, self.of_norm(estimator, repetitions)[0])
            }
        };
        let whole = Estimate {
            value: root * bare.value,
            error: bare.error.hypot(bare.value.abs() * error),
        };
        Some(DrawnEstimates { bare, whole })
    }

    /// A bound that rests on `ε_F`, with its label.
    fn labelled(&self, bound: Option<f64>) -> LabelledNumber {
        let own = &self.source.state_error;
        match (bound, own.trust(), own.because()) {
            (Some(x), Trust::Estimate, Some(because)) => LabelledNumber::estimate(x, because),
            (Some(x), ..) => LabelledNumber::bound(x),
            (None, ..) => LabelledNumber::unavailable("the state's own error is not known"),
        }
    }

    /// The shots and values of the register, or why there are none.
    fn repetitions(
        &self,
        estimator: OverlapEstimator,
        overlap: Overlap,
        from_state: Option<f64>,
    ) -> Result<Repetitions, String> {
        let of_shots = |shots: f64| Repetitions { shots, evaluations: 0.0, norm_evaluations: 0.0 };
        let of_runs = |evaluations: f64, norm_evaluations: f64| Repetitions {
            shots: measurement::RUNS as f64,
            evaluations,
            norm_evaluations,
        };
        let accuracy = match self.readout.effort {
            MeasurementEffort::Given { shots, .. } if !estimator.coherent() => {
                return Ok(of_shots(shots as f64));
            }
            MeasurementEffort::Given { evaluations, .. } => {
                let of_norm = if self.measures_norm(estimator) { evaluations as f64 } else { 0.0 };
                return Ok(of_runs(evaluations as f64, of_norm));
            }
            MeasurementEffort::Accuracy(accuracy) => accuracy,
        };
        let from_state = from_state.ok_or("the state's own error is not known")?;
        if from_state >= accuracy {
            return Err(format!(
                "the state's own error may be {from_state:.1e}, more than the \
                 readout.accuracy = {accuracy:e} allows, which is absolute"
            ));
        }
        let error = (accuracy - from_state) / overlap.prefactor;
        let size = overlap.value.abs();
        // The error e of an overlap and c e of C_f: e + (|o| + e) c e = error.
        let beside_norm = |c: f64| {
            let linear = 1.0 + c * size;
            2.0 * error / (linear + (linear * linear + 4.0 * c * error).sqrt())
        };
        let measures_norm = self.measures_norm(estimator);
        let beside_norm = |c: f64| if measures_norm { beside_norm(c) } else { error };
        Ok(match estimator {
            OverlapEstimator::AllZero => of_shots(measurement::all_zero_shots(beside_norm(1.0))),
            OverlapEstimator::AmplitudeEstimation if measures_norm => {
                // Half for each; of C_f with what amplification then loses, h = η + 3η²/2.
                let half = 0.5 * error;
                let part = half / (size + half);
                let of_norm = 2.0 * part / (1.0 + (1.0 + 6.0 * part).sqrt());
                let evaluations = measurement::root_evaluations(self.probability(), of_norm);
                of_runs(measurement::evaluations(half), evaluations)
            }
            _ if estimator.coherent() => of_runs(measurement::evaluations(error), 0.0),
            _ => of_shots(measurement::hadamard_shots(beside_norm(FRAC_1_SQRT_2))),
        })
    }

    /// Evolutions that `C_f` takes where everything is coherent: by amplitude estimation of `P`, to
    /// the error that the number of successes gives where postselection is repeated.
    fn norm_evolutions(
        &self,
        estimator: OverlapEstimator,
        repetitions: Repetitions,
    ) -> LabelledNumber {
        if estimator.enlarged() {
            return LabelledNumber::unavailable("C_f is not measured: C_w is known");
        }
        if self.source.norm_is_known {
            return LabelledNumber::exact(0.0);
        }
        let probability = self.probability();
        if !probability.is_finite() {
            return self.source.probabilities.nearest().all.clone();
        }
        let evaluations = if repetitions.norm_evaluations > 0.0 {
            repetitions.norm_evaluations
        } else {
            let [error, _] = self.of_norm(estimator, repetitions);
            measurement::root_evaluations(probability, error)
        };
        LabelledNumber::exact(measurement::preparations(evaluations))
    }

    /// Evolutions by repetition and coherently.
    fn evolutions(
        &self,
        estimator: OverlapEstimator,
        repetitions: Repetitions,
    ) -> [LabelledNumber; 2] {
        const WHY: &str = "the mean over postselections that fail";
        const ROUNDS: &str = "exact amplitude amplification; its failure is in the bound";
        const NO_INVERSE: &str =
            "amplitude estimation inverts the preparation; repetition has no inverse";
        let chain = self.source.probabilities.nearest();
        let uses = if estimator.coherent() {
            measurement::preparations(repetitions.evaluations)
        } else {
            repetitions.shots
        };
        let times = |figure: &LabelledNumber, why| match figure.value() {
            Some(x) => LabelledNumber::estimate(uses * x, why),
            None => figure.clone(),
        };
        let repeated = times(&chain.repetitions, WHY);
        let coherent = times(&chain.amplified_evolutions, ROUNDS);
        let (all, none) = (LabelledNumber::exact(uses), LabelledNumber::unavailable);
        match (estimator.enlarged(), estimator.coherent()) {
            (false, false) => [repeated, coherent],
            (false, true) => [none(NO_INVERSE), coherent],
            (true, false) => [all, none("nothing is postselected")],
            (true, true) => [none("nothing is postselected"), all],
        }
    }
}

/// The mean velocity from measured density and momentum. With errors `δρ` and `δm` its error is
/// `|δu| ≤ (δm + |û|δρ)/(|ρ̂| − δρ)`. It costs both measurements, but for `C_f`, which cancels.
fn ratio(rho: &MeasuredMoment, m: &MeasuredMoment) -> Measured {
    let estimator = m.measured.estimator;
    let sum = |pick: fn(&MeasuredMoment) -> &LabelledNumber| {
        let [a, b] = [rho, m].map(pick);
        match (a.value(), b.value()) {
            (Some(x), Some(y)) => b.with(x + y),
            (None, _) => a.clone(),
            _ => b.clone(),
        }
    };
    let without = |why: &str| Measured {
        overlap: LabelledNumber::unavailable("a quotient of two overlaps"),
        shots: sum(|m| &m.measured.shots),
        evaluations: LabelledNumber::unavailable("those of density and momentum"),
        evolutions_repeated: sum(|m| &m.evolutions[0]),
        evolutions_coherent: sum(|m| &m.evolutions[1]),
        evolutions_norm: LabelledNumber::unavailable("C_f cancels in the quotient"),
        ..Measured::unavailable(estimator, why)
    };
    let (Some(below), Some(above)) = (rho.estimate, m.estimate) else {
        let part = if rho.estimate.is_none() { rho } else { m };
        return without(&reason(&part.measured.estimate));
    };
    if below.value == 0.0 {
        return without("the density was measured as 0");
    }
    let velocity = above.value / below.value;
    let bound = match (rho.bound, m.bound) {
        (Some(of_rho), Some(of_m)) if below.value.abs() > of_rho => {
            let bound = (of_m + velocity.abs() * of_rho) / (below.value.abs() - of_rho);
            m.measured.bound.with(bound)
        }
        (Some(_), Some(_)) => {
            LabelledNumber::unavailable("the density cannot be distinguished from 0")
        }
        _ => LabelledNumber::unavailable("the state's own error is not known"),
    };
    Measured {
        estimate: LabelledNumber::estimate(velocity, "drawn at random"),
        standard_error: if estimator.coherent() {
            m.measured.standard_error.clone()
        } else {
            LabelledNumber::estimate(
                above.error.hypot(velocity * below.error) / below.value.abs(),
                "to first order in the errors of density and momentum",
            )
        },
        bound,
        ..without("")
    }
}
