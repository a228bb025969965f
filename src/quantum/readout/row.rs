//! A row of the readout: an observable at a cell, and what each estimator gives of it.

use crate::base::row_major::number;
use crate::base::text::short;
use crate::problem::grid::{MAX_DIMENSION, PhaseSpace};
use crate::quantum::labelled_number::LabelledNumber;
use serde::Serialize;

/// An observable: the number that is read.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize)]
#[serde(rename_all = "kebab-case")]
pub enum Observable {
    /// `ρ`.
    Density,
    /// `m_a`, by axis.
    Momentum(usize),
    /// `u_a = m_a/ρ`, by axis.
    Velocity(usize),
}

impl Observable {
    /// All observables in `n` dimensions: the density, then momenta, then velocities.
    pub fn all(n: usize) -> Vec<Self> {
        std::iter::once(Self::Density)
            .chain((0..n).map(Self::Momentum))
            .chain((0..n).map(Self::Velocity))
            .collect()
    }

    /// Name in files.
    pub fn name(self) -> &'static str {
        match self {
            Self::Density => "density",
            Self::Momentum(a) => ["momentum_x", "momentum_y", "momentum_z"][a],
            Self::Velocity(a) => ["velocity_x", "velocity_y", "velocity_z"][a],
        }
    }

    /// Number in files and streams: 0, then from 1 and from 4 on.
    pub fn number(self) -> u32 {
        match self {
            Self::Density => 0,
            Self::Momentum(a) => 1 + a as u32,
            Self::Velocity(a) => 1 + (MAX_DIMENSION + a) as u32,
        }
    }
}

/// The measurement of an overlap.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize)]
#[serde(rename_all = "kebab-case")]
pub enum OverlapEstimator {
    /// Hadamard test with the postselected state.
    Hadamard,
    /// Amplitude estimation with the postselected state.
    AmplitudeEstimation,
    /// The frequency of zeros after the inverse preparation of `χ`, which is `|⟨χ|F⟩|²`. It serves
    /// where `f ≥ 0`.
    AllZero,
    /// Hadamard test with the enlarged state.
    EnlargedHadamard,
    /// Amplitude estimation with the enlarged state.
    EnlargedAmplitudeEstimation,
}

impl OverlapEstimator {
    /// The estimators, in the order of files.
    pub const ALL: [Self; 5] = [
        Self::Hadamard,
        Self::AmplitudeEstimation,
        Self::AllZero,
        Self::EnlargedHadamard,
        Self::EnlargedAmplitudeEstimation,
    ];

    /// Name in files.
    pub fn name(self) -> &'static str {
        match self {
            Self::Hadamard => "hadamard",
            Self::AmplitudeEstimation => "amplitude-estimation",
            Self::AllZero => "all-zero",
            Self::EnlargedHadamard => "enlarged-hadamard",
            Self::EnlargedAmplitudeEstimation => "enlarged-amplitude-estimation",
        }
    }

    pub(crate) fn enlarged(self) -> bool {
        matches!(self, Self::EnlargedHadamard | Self::EnlargedAmplitudeEstimation)
    }

    pub(crate) fn coherent(self) -> bool {
        matches!(self, Self::AmplitudeEstimation | Self::EnlargedAmplitudeEstimation)
    }
}

/// The result of one estimator for an observable.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct Measured {
    /// The estimator.
    pub estimator: OverlapEstimator,
    /// The overlap; unavailable for a mean velocity, which is a quotient.
    pub overlap: LabelledNumber,
    /// Shots: of an overlap, or of amplitude estimation the runs whose median is taken.
    pub shots: LabelledNumber,
    /// Values of the register of amplitude estimation.
    pub evaluations: LabelledNumber,
    /// The observable.
    pub estimate: LabelledNumber,
    /// The standard error of the estimate, from the counts. Amplitude estimation has none in closed
    /// form.
    pub standard_error: LabelledNumber,
    /// Bound on its distance to the moment of the exact semi-discrete solution.
    pub bound: LabelledNumber,
    /// Evolutions where postselection is repeated until it succeeds, on average.
    pub evolutions_repeated: LabelledNumber,
    /// Evolutions and their inverses where everything is coherent, those for `C_f` included.
    pub evolutions_coherent: LabelledNumber,
    /// Evolutions that measure `C_f`; of repeated postselections the number of successes gives it.
    /// None are needed for a unitary flow.
    pub evolutions_norm: LabelledNumber,
}

/// An observable at a cell.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct ReadoutRow {
    /// The space cell, along each axis from 0.
    pub cell: Vec<usize>,
    /// Number of the cell in the whole grid, the last axis fastest.
    pub number: usize,
    /// Centre of the cell.
    pub point: Vec<f64>,
    /// The observable.
    pub observable: Observable,
    /// Value of the recovered field: the expected result of the measurement.
    pub value: LabelledNumber,
    /// The result of each estimator.
    pub measured: Vec<Measured>,
}

/// Why a number is unavailable; without double quotes, since files put the text between them.
pub(crate) fn reason(figure: &LabelledNumber) -> String {
    figure.why_not().unwrap_or_default().replace('"', "'")
}

impl Measured {
    /// The figures, in the order of the columns of files.
    pub fn figures(&self) -> [&LabelledNumber; 9] {
        [
            &self.overlap, &self.shots, &self.evaluations, &self.estimate, &self.standard_error,
            &self.bound, &self.evolutions_repeated, &self.evolutions_coherent,
            &self.evolutions_norm,
        ]
    }

    pub(crate) fn unavailable(estimator: OverlapEstimator, why: &str) -> Self {
        let none = || LabelledNumber::unavailable(why);
        Self {
            estimator,
            overlap: none(),
            shots: none(),
            evaluations: none(),
            estimate: none(),
            standard_error: none(),
            bound: none(),
            evolutions_repeated: none(),
            evolutions_coherent: none(),
            evolutions_norm: none(),
        }
    }
}

impl ReadoutRow {
    /// The row in words: its value, and the first estimate of it or why there is none.
    pub fn text(&self) -> String {
        let position: Vec<String> = self.point.iter().map(|x| short(*x)).collect();
        let (name, at) = (self.observable.name(), position.join(", "));
        let Some(value) = self.value.value() else {
            return format!("{name} at ({at}) is unavailable: {}", reason(&self.value));
        };
        let mut estimates = self.measured.iter().filter_map(|measured| {
            let (estimate, bound) = (measured.estimate.value()?, measured.bound.value()?);
            let how = measured.estimator.name();
            Some(format!("measured as {} within {bound:.1e} ({how})", short(estimate)))
        });
        let measured = estimates.next().unwrap_or_else(|| {
            let why = self.measured.first().map(|measured| reason(&measured.estimate));
            format!("not measured: {}", why.unwrap_or_default())
        });
        format!("{name} at ({at}) is {}, {measured}", short(value))
    }

    /// A row without numbers.
    pub(crate) fn at(space: &PhaseSpace, cell: &[usize], observable: Observable) -> Self {
        let axes = || space.x.iter().zip(cell);
        Self {
            cell: cell.to_vec(),
            number: number(space.x.iter().map(|axis| axis.cells), cell.iter().copied()),
            point: axes().map(|(axis, &i)| axis.centre(i as i64)).collect(),
            observable,
            value: LabelledNumber::unavailable("not read"),
            measured: Vec::new(),
        }
    }
}
