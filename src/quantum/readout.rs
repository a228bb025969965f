//! What a quantum computer would tell of density, momentum and mean velocity at some cells of space (paper, section 7.2).
//!
//! Moments are overlaps. With `q = 1` for the density and `q = v_a` for momentum `a`, at the space cell `i`
//!
//! ```text
//! m_i = Δv Σ_j q_j f_ij = C_f Δv ‖q‖ ⟨χ_i|F⟩          |χ_i⟩ = |i⟩ ⊗ Σ_j q_j|j⟩/‖q‖,   |F⟩ = f/C_f            postselected
//!                       = e^{p◇} C_w Δv ‖q/√π‖ ⟨ζ_i|w⟩  |ζ_i⟩ = |0⟩ ⊗ |i⟩ ⊗ Σ_j q_j π_ij^{−½}|j⟩/‖q/√π‖ ⊗ |k◇⟩    enlarged
//! ```
//!
//! The enlarged state holds `√π f`: there the weights are undone in `ζ`, which costs nothing, and as `π ≥ 1` never more than to undo them in the
//! state, which has a probability of its own ([`super::probability`]). Without weights these are the paper's.
//!
//! Each overlap is measured as [`measurement`] says, the counts drawn at random from their exact distributions. What is drawn depends on the seed, the
//! cell, the observable and the estimator only, so that it is the same on any ranks and beside any other cells.
//!
//! **Accuracy.** An overlap known to `ε_obs` of a state known to `ε_F` gives a moment to `prefactor · ε_obs + C_f Δv ‖q‖ ε_F`, both ways; `ε_F` is the
//! tolerance of the run. Bounds hold with probability [`CONFIDENCE`], those of a mean velocity, which take two of them, with that
//! of both.
//!
//! **Cost**, in evolutions `e^{−iHT}` of the whole state: a shot from the postselected state takes `1/P` of them by repetition, `2r + 1` with `r` rounds of amplitude
//! amplification; from the enlarged one, one. Amplitude estimation needs the preparation and its inverse, which repetition is not.
//!
//! A measurement of the x-register alone is none of the density: it gives the cell `i` with probability `Σ_j f_ij²/C_f²` (the paper's last
//! remark there), which is told as `basis_probability`.

pub mod measurement;
pub mod random;

use super::Figure;
use super::probability::Probabilities;
use crate::case::{Case, Data, Effort, Method};
use crate::communicator::Group;
use crate::error::Result;
use crate::grid::MAX_DIMENSION;
use crate::observables::VelocityFactors;
use crate::output;
use measurement::{CONFIDENCE, Estimate};
use random::{Purpose, Stream};
use serde::Serialize;
use std::fmt::Write;
use std::ops::Range;
use std::path::Path;

/// Which number is read.
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
    /// Those of `n` dimensions: the density, then momenta, then velocities.
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

/// How an overlap is measured.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize)]
#[serde(rename_all = "kebab-case")]
pub enum Estimator {
    /// Hadamard test with the postselected state.
    Hadamard,
    /// Amplitude estimation of that.
    AmplitudeEstimation,
    /// How often the inverse preparation of `χ` gives zeros: `|⟨χ|F⟩|²`, where `f ≥ 0`.
    AllZero,
    /// Hadamard test with the enlarged state.
    EnlargedHadamard,
    /// Amplitude estimation of that.
    EnlargedAmplitudeEstimation,
}

impl Estimator {
    /// All, in the order of files.
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

    fn enlarged(self) -> bool {
        matches!(
            self,
            Self::EnlargedHadamard | Self::EnlargedAmplitudeEstimation
        )
    }

    fn coherent(self) -> bool {
        matches!(
            self,
            Self::AmplitudeEstimation | Self::EnlargedAmplitudeEstimation
        )
    }
}

/// What one estimator says of an observable.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct Measured {
    /// Which.
    pub estimator: Estimator,
    /// The overlap as it is; of a mean velocity, which is none, unavailable.
    pub overlap: Figure,
    /// Shots: of an overlap, or of amplitude estimation the runs whose median is taken.
    pub shots: Figure,
    /// Values of the register of amplitude estimation.
    pub evaluations: Figure,
    /// What was measured.
    pub estimate: Figure,
    /// Its standard error, told from the counts; of amplitude estimation, which has none in closed form, unavailable.
    pub standard_error: Figure,
    /// Bound on its distance to the moment of the exact semi-discrete solution.
    pub bound: Figure,
    /// Evolutions where postselection is repeated until it succeeds, on average.
    pub evolutions_repeated: Figure,
    /// Evolutions and their inverses where everything is coherent.
    pub evolutions_coherent: Figure,
}

/// An observable at a cell.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct Row {
    /// The space cell, along each axis from 0.
    pub cell: Vec<usize>,
    /// Its number over the whole grid, the last axis fastest.
    pub number: usize,
    /// Its centre.
    pub point: Vec<f64>,
    /// Which.
    pub observable: Observable,
    /// Of the recovered field: what is measured but for statistics.
    pub value: Figure,
    /// What each estimator says.
    pub measured: Vec<Measured>,
}

/// What is read, and what it takes.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct Readout {
    /// Probability with which each bound holds, at least.
    pub confidence: f64,
    /// `C_f`.
    pub norm_of_field: Figure,
    /// `P` of the slice at `p◇`.
    pub probability: Figure,
    /// `1/P`.
    pub repetitions: Figure,
    /// Rounds of amplitude amplification.
    pub amplification_rounds: Figure,
    /// `ε_F`.
    pub state_error: Figure,
    /// By cell, the probability that a measurement of the x-register gives it: `Σ_j f_ij²/C_f²`, which is no density.
    pub basis_probability: Vec<Figure>,
    /// The rows, cell by cell.
    pub rows: Vec<Row>,
}

/// The recovered field on a rank's share, and the states that hold it.
pub struct Source<'a> {
    /// The share: space cells, one range an axis.
    pub share: &'a [Range<usize>],
    /// `f` on it, velocities fastest.
    pub field: &'a [f64],
    /// `π` there.
    pub pi: &'a [f64],
    /// `C_f`.
    pub norm: f64,
    /// `min f` over all ranks.
    pub least: f64,
    /// Of the enlarged state.
    pub probabilities: &'a Probabilities,
    /// `ε_F`.
    pub state_error: Figure,
}

/// Why there is nothing to be read from a case, if so.
pub fn refused(case: &Case) -> Option<&'static str> {
    match (&case.data, case.method) {
        (Data::Measure { .. }, _) => Some(
            "f = phi delta(psi) is not a vector of amplitudes: phi and psi are in separate states",
        ),
        (_, Method::Classical) => Some("solver.method = \"classical\" prepares no quantum state"),
        _ if case.varies() => Some(
            "inflow.value depends on t, and the evolution is that of a Hamiltonian that does not",
        ),
        _ => None,
    }
}

/// `‖x‖`.
fn norm(x: impl Iterator<Item = f64>) -> f64 {
    x.map(|x| x * x).sum::<f64>().sqrt()
}

/// An overlap and what it is multiplied by to give a moment.
#[derive(Clone, Copy, Debug)]
struct Overlap {
    value: f64,
    prefactor: f64,
}

/// An observable at a cell by one estimator, with what the mean velocity needs of it.
struct Moment {
    measured: Measured,
    estimate: Option<Estimate>,
    bound: Option<f64>,
}

impl Readout {
    /// All cells and observables that `case` asks for, with every figure unavailable.
    pub fn unavailable(case: &Case, why: &str) -> Self {
        let none = || Figure::unavailable(why);
        let cells = case.readout.as_ref().map_or(&[][..], |r| &r.cells);
        let rows = cells.iter().flat_map(|cell| {
            Observable::all(case.space.dimension())
                .into_iter()
                .map(move |observable| Row {
                    value: none(),
                    measured: Vec::new(),
                    ..Row::at(case, cell, observable)
                })
        });
        Self {
            confidence: CONFIDENCE,
            norm_of_field: none(),
            probability: none(),
            repetitions: none(),
            amplification_rounds: none(),
            state_error: none(),
            basis_probability: cells.iter().map(|_| none()).collect(),
            rows: rows.collect(),
        }
    }

    /// Reads what `case` asks for from `source`; the same on all ranks. Collective over `world`.
    pub fn new(world: &Group, case: &Case, source: &Source<'_>) -> Self {
        let Some(readout) = &case.readout else {
            return Self::unavailable(case, "no [readout] is asked for");
        };
        if source.norm == 0.0 {
            return Self::unavailable(case, "nothing is left of the field");
        }
        let chain = &source.probabilities.at_slice;
        let factors = VelocityFactors::new(&case.space);
        let reader = Reader {
            case,
            source,
            readout,
            factors: &factors,
        };
        let (mut rows, mut basis) = (Vec::new(), Vec::new());
        for cell in &readout.cells {
            let sums = reader.sums(world, cell);
            basis.push(Figure::exact(sums.square / (source.norm * source.norm)));
            rows.extend(reader.rows(cell, &sums));
        }
        Self {
            confidence: CONFIDENCE,
            norm_of_field: Figure::exact(source.norm),
            probability: chain.all.clone(),
            repetitions: chain.repetitions.clone(),
            amplification_rounds: chain.amplification_rounds.clone(),
            state_error: source.state_error.clone(),
            basis_probability: basis,
            rows,
        }
    }

    /// The columns of `/readout`: name, a number for every row and estimator (NaN where it is not known), what they are.
    pub fn columns(&self) -> Vec<(&'static str, Vec<f64>, &'static str)> {
        let known = |figure: &Figure| figure.value().unwrap_or(f64::NAN);
        let mut columns: Vec<(&'static str, Vec<f64>, &'static str)> = COLUMNS
            .iter()
            .map(|&(name, what)| (name, Vec::new(), what))
            .collect();
        for row in &self.rows {
            for m in &row.measured {
                let place = [
                    row.number as f64,
                    f64::from(row.observable.number()),
                    f64::from(m.estimator as u32),
                    known(&row.value),
                ];
                let numbers = place.into_iter().chain(m.figures().map(known));
                for (column, number) in columns.iter_mut().zip(numbers) {
                    column.1.push(number);
                }
            }
        }
        columns
    }

    /// Writes `readout.csv` into `directory`.
    ///
    /// # Errors
    /// [`crate::error::Error::Output`].
    pub fn write(&self, directory: &Path) -> Result<()> {
        let path = directory.join("readout.csv");
        std::fs::write(&path, self.csv()).map_err(|e| output::failure(&path, &e))
    }

    /// A line for every row and estimator, with a heading. Numbers that are not known are empty; the last column says why.
    pub fn csv(&self) -> String {
        let mut text = "cell,point,observable,value,estimator,overlap,shots,evaluations,estimate,standard_error,bound,\
                        evolutions_repeated,evolutions_coherent,unavailable\n"
            .to_owned();
        let number = |figure: &Figure| figure.value().map_or(String::new(), |x| format!("{x:?}"));
        let joined = |list: Vec<String>| list.join(" ");
        for row in &self.rows {
            let cell = joined(row.cell.iter().map(usize::to_string).collect());
            let point = joined(row.point.iter().map(f64::to_string).collect());
            let start = format!(
                "{cell},{point},{},{}",
                row.observable.name(),
                number(&row.value)
            );
            if row.measured.is_empty() {
                let _ = writeln!(text, "{start},,,,,,,,,,\"{}\"", quoted(&row.value));
            }
            for m in &row.measured {
                let figures = m.figures();
                let numbers: Vec<String> = figures.iter().map(|f| number(f)).collect();
                let _ = writeln!(
                    text,
                    "{start},{},{},\"{}\"",
                    m.estimator.name(),
                    numbers.join(","),
                    quoted(&m.estimate)
                );
            }
        }
        text
    }
}

/// Columns of `/readout`.
const COLUMNS: [(&str, &str); 12] = [
    ("cell", "number of the space cell, the last axis fastest"),
    (
        "observable",
        "0 density, 1 to 3 momentum along x, y, z, 4 to 6 mean velocity",
    ),
    (
        "estimator",
        "0 Hadamard test, 1 amplitude estimation, 2 all-zero outcome; 3, 4 as 0, 1 of the enlarged state",
    ),
    ("value", "of the recovered field"),
    ("overlap", "overlap of the moment's state"),
    ("shots", "shots, or runs of amplitude estimation"),
    (
        "evaluations",
        "values of the register of amplitude estimation",
    ),
    ("estimate", "as measured"),
    ("standard_error", "standard error of the estimate"),
    ("bound", "bound on the error of the estimate"),
    ("evolutions_repeated", "evolutions, postselection repeated"),
    ("evolutions_coherent", "evolutions, coherent"),
];

/// Most numbers that a case's readout takes in `result.h5`.
pub fn numbers(case: &Case) -> usize {
    let observables = 1 + 2 * case.space.dimension();
    let cells = case.readout.as_ref().map_or(0, |r| r.cells.len());
    COLUMNS.len() * Estimator::ALL.len() * observables * cells
}

/// Why a figure is unavailable, as it stands between quotes.
fn quoted(figure: &Figure) -> String {
    match figure {
        Figure::Unavailable { because } => because.replace('"', "'"),
        _ => String::new(),
    }
}

impl Measured {
    /// The figures, in the order of the columns of files.
    pub fn figures(&self) -> [&Figure; 8] {
        [
            &self.overlap,
            &self.shots,
            &self.evaluations,
            &self.estimate,
            &self.standard_error,
            &self.bound,
            &self.evolutions_repeated,
            &self.evolutions_coherent,
        ]
    }

    fn unavailable(estimator: Estimator, why: &str) -> Self {
        let none = || Figure::unavailable(why);
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
        }
    }
}

impl Row {
    /// A row with nothing in it.
    fn at(case: &Case, cell: &[usize], observable: Observable) -> Self {
        let axes = || case.space.x.iter().zip(cell);
        Self {
            cell: cell.to_vec(),
            number: axes().fold(0, |number, (axis, i)| number * axis.cells + i),
            point: axes().map(|(axis, &i)| axis.centre(i as i64)).collect(),
            observable,
            value: Figure::unavailable("not read"),
            measured: Vec::new(),
        }
    }
}

/// What is computed from the field at a cell; known to all ranks.
struct CellSums {
    /// `Σ_j q_j f_j` for each of [`crate::observables::MOMENTS`] kinds of `q`.
    moments: [f64; MAX_DIMENSION + 1],
    /// `Σ_j q_j²/π_j`.
    unweighted: [f64; MAX_DIMENSION + 1],
    /// `Σ_j f_j²`.
    square: f64,
}

/// All that the rows have in common.
struct Reader<'a> {
    case: &'a Case,
    source: &'a Source<'a>,
    readout: &'a crate::case::Readout,
    factors: &'a VelocityFactors,
}

impl Reader<'_> {
    /// Sums over the velocities at `cell`, which is on one rank; on all. Collective over `world`.
    fn sums(&self, world: &Group, cell: &[usize]) -> CellSums {
        let mut sums = self.sums_here(cell);
        // The other ranks add zero bits.
        let everywhere = |x: &mut f64| *x = f64::from_bits(world.sum_modulo(x.to_bits()));
        sums.moments.iter_mut().for_each(everywhere);
        sums.unweighted.iter_mut().for_each(everywhere);
        everywhere(&mut sums.square);
        sums
    }

    /// The same on this rank's share; zeros where it has not the cell.
    fn sums_here(&self, cell: &[usize]) -> CellSums {
        let share = self.source.share;
        let velocities = self.factors.cells();
        let mut sums = CellSums {
            moments: Default::default(),
            unweighted: Default::default(),
            square: 0.0,
        };
        if share.iter().zip(cell).all(|(range, i)| range.contains(i)) {
            let place =
                (share.iter().zip(cell)).fold(0, |p, (range, i)| p * range.len() + i - range.start);
            let here = place * velocities..(place + 1) * velocities;
            let cells = self.source.field[here.clone()]
                .iter()
                .zip(&self.source.pi[here]);
            for ((f, pi), q) in cells.zip(self.factors.each()) {
                sums.square += f * f;
                for (k, q) in q.iter().take(MAX_DIMENSION + 1).enumerate() {
                    sums.moments[k] += q * f;
                    sums.unweighted[k] += q * q / pi;
                }
            }
        }
        sums
    }

    /// The rows of a cell.
    fn rows(&self, cell: &[usize], sums: &CellSums) -> Vec<Row> {
        let n = self.case.space.dimension();
        let volume = self.case.space.velocity_volume();
        let row = |observable| Row::at(self.case, cell, observable);
        let linear: Vec<(Row, Vec<Moment>)> = (0..=n)
            .map(|k| {
                let observable = match k {
                    0 => Observable::Density,
                    k => Observable::Momentum(k - 1),
                };
                let mut row = row(observable);
                row.value = Figure::exact(sums.moments[k] * volume);
                let moments = Estimator::ALL.map(|e| self.moment(&row, k, sums, e));
                (row, moments.into())
            })
            .collect();
        let velocities: Vec<Row> = (1..=n)
            .map(|k| {
                let mut row = row(Observable::Velocity(k - 1));
                row.value = match sums.moments[0] {
                    0.0 => Figure::unavailable("the density is 0"),
                    rho => Figure::exact(sums.moments[k] / rho),
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

    /// The overlap of moment `k` with the state that `estimator` measures, and `C_f Δv ‖q‖`.
    fn overlap(&self, k: usize, sums: &CellSums, estimator: Estimator) -> Option<(Overlap, f64)> {
        let volume = self.case.space.velocity_volume();
        let of_field = self.source.norm * volume * norm(self.factors.each().iter().map(|q| q[k]));
        let prefactor = match estimator.enlarged() {
            false => of_field,
            true => {
                let p = self.source.probabilities;
                p.recovery.exp() * p.norm_of_state.value()? * volume * sums.unweighted[k].sqrt()
            }
        };
        let value = sums.moments[k] * volume / prefactor;
        // Along an axis of one cell whose centre is 0 there is no momentum, and no state of it.
        let overlap = Overlap {
            value: value.clamp(-1.0, 1.0),
            prefactor,
        };
        (prefactor > 0.0 && value.is_finite()).then_some((overlap, of_field))
    }

    /// Moment `k` at the cell of `row`.
    fn moment(&self, row: &Row, k: usize, sums: &CellSums, estimator: Estimator) -> Moment {
        let none = |why: &str| Moment {
            measured: Measured::unavailable(estimator, why),
            estimate: None,
            bound: None,
        };
        if estimator == Estimator::AllZero {
            if row.observable != Observable::Density {
                return none("a momentum may have either sign, and |overlap|^2 has none");
            }
            let allowed = -self.source.state_error.value().unwrap_or(0.0) * self.source.norm;
            if self.source.least < allowed || sums.moments[0] < 0.0 {
                return none("f is negative somewhere by more than its error");
            }
        }
        let Some((overlap, of_field)) = self.overlap(k, sums, estimator) else {
            return none(
                "there is no state to overlap with: every velocity is 0, or nothing of p is known",
            );
        };
        let from_state = (self.source.state_error.value()).map(|error| of_field * error);
        let (shots, evaluations) = match self.effort(estimator, overlap.prefactor, from_state) {
            Ok(effort) => effort,
            Err(why) => return none(&why),
        };
        let purpose = Purpose {
            cell: row.number as u64,
            observable: row.observable.number(),
            estimator: estimator as u32,
        };
        let mut stream = Stream::new(self.readout.seed, purpose);
        let (drawn, bound) = match estimator {
            Estimator::Hadamard | Estimator::EnlargedHadamard => (
                measurement::hadamard(&mut stream, overlap.value, shots),
                measurement::hadamard_bound(shots),
            ),
            Estimator::AllZero => (
                measurement::all_zero(&mut stream, overlap.value, shots),
                measurement::all_zero_bound(shots),
            ),
            Estimator::AmplitudeEstimation | Estimator::EnlargedAmplitudeEstimation => (
                measurement::amplitude_estimation(&mut stream, overlap.value, evaluations),
                // Whatever the overlap.
                measurement::amplitude_bound(0.0, evaluations),
            ),
        };
        let estimate = Estimate {
            value: overlap.prefactor * drawn.value,
            error: overlap.prefactor * drawn.error,
        };
        let bound = from_state.map(|from_state| overlap.prefactor * bound + from_state);
        let [repeated, coherent] = self.evolutions(estimator, (shots, evaluations));
        let coherently = estimator.coherent();
        Moment {
            measured: Measured {
                estimator,
                overlap: Figure::exact(overlap.value),
                shots: Figure::exact(shots as f64),
                evaluations: match coherently {
                    true => Figure::exact(evaluations as f64),
                    false => Figure::unavailable("shots, and no amplitude estimation"),
                },
                estimate: Figure::estimate(estimate.value, "drawn at random"),
                standard_error: match coherently {
                    true => Figure::unavailable(
                        "the distribution has no variance in closed form; see bound",
                    ),
                    false => Figure::estimate(estimate.error, "from the counts"),
                },
                bound: self.labelled(bound),
                evolutions_repeated: repeated,
                evolutions_coherent: coherent,
            },
            estimate: Some(estimate),
            bound,
        }
    }

    /// A bound that rests on `ε_F`, with its label.
    fn labelled(&self, bound: Option<f64>) -> Figure {
        match (bound, &self.source.state_error) {
            (Some(x), Figure::Estimate { because, .. }) => Figure::estimate(x, because),
            (Some(x), _) => Figure::bound(x),
            (None, _) => Figure::unavailable("the state's own error is not known"),
        }
    }

    /// Shots and values of the register, or why there are none.
    fn effort(
        &self,
        estimator: Estimator,
        prefactor: f64,
        from_state: Option<f64>,
    ) -> std::result::Result<(u64, u64), String> {
        let runs = measurement::RUNS as u64;
        let accuracy = match self.readout.effort {
            Effort::Given { shots, .. } if !estimator.coherent() => return Ok((shots, 0)),
            Effort::Given { evaluations, .. } => return Ok((runs, evaluations)),
            Effort::Accuracy(accuracy) => accuracy,
        };
        let from_state = from_state.ok_or("the state's own error is not known")?;
        if from_state >= accuracy {
            return Err(format!(
                "the state's own error may be {from_state:.1e} of it, more than readout.accuracy = {accuracy:e} allows"
            ));
        }
        let error = (accuracy - from_state) / prefactor;
        let found = match estimator {
            Estimator::Hadamard | Estimator::EnlargedHadamard => {
                measurement::hadamard_shots(error).map(|n| (n, 0))
            }
            Estimator::AllZero => measurement::all_zero_shots(error).map(|n| (n, 0)),
            Estimator::AmplitudeEstimation | Estimator::EnlargedAmplitudeEstimation => {
                measurement::evaluations(error).map(|m| (runs, m))
            }
        };
        found.ok_or_else(|| {
            format!("an overlap to {error:.1e} takes more shots or evaluations than are emulated")
        })
    }

    /// Evolutions by repetition and coherently.
    fn evolutions(&self, estimator: Estimator, (shots, evaluations): (u64, u64)) -> [Figure; 2] {
        const WHY: &str = "the mean over postselections that fail";
        const ROUNDS: &str = "rounds of amplitude amplification, taken to succeed";
        let chain = &self.source.probabilities.at_slice;
        let uses = match estimator.coherent() {
            true => measurement::preparations(evaluations),
            false => shots as f64,
        };
        let times = |figure: &Figure, each: &dyn Fn(f64) -> f64, why| match figure.value() {
            Some(x) => Figure::estimate(uses * each(x), why),
            None => figure.clone(),
        };
        let repeated = times(&chain.repetitions, &|r| r, WHY);
        let coherent = times(&chain.amplification_rounds, &|r| 2.0 * r + 1.0, ROUNDS);
        match estimator {
            Estimator::Hadamard | Estimator::AllZero => [repeated, coherent],
            Estimator::AmplitudeEstimation => [
                Figure::unavailable(
                    "amplitude estimation inverts the preparation; repetition has no inverse",
                ),
                coherent,
            ],
            Estimator::EnlargedHadamard => [
                Figure::exact(uses),
                Figure::unavailable("nothing is postselected"),
            ],
            Estimator::EnlargedAmplitudeEstimation => [
                Figure::unavailable("nothing is postselected"),
                Figure::exact(uses),
            ],
        }
    }
}

/// The mean velocity from measured density and momentum: with errors `δρ` and `δm`, `|δu| ≤ (δm + |û|δρ)/(|ρ̂| − δρ)`.
fn ratio(rho: &Moment, m: &Moment) -> Measured {
    let estimator = m.measured.estimator;
    let none = |why: &str| Measured::unavailable(estimator, why);
    let (Some(below), Some(above)) = (rho.estimate, m.estimate) else {
        let part = if rho.estimate.is_none() { rho } else { m };
        return none(&quoted(&part.measured.estimate));
    };
    if below.value == 0.0 {
        return none("the density was measured as 0");
    }
    let velocity = above.value / below.value;
    let bound = match (rho.bound, m.bound) {
        (Some(of_rho), Some(of_m)) if below.value.abs() > of_rho => {
            let bound = (of_m + velocity.abs() * of_rho) / (below.value.abs() - of_rho);
            match &m.measured.bound {
                Figure::Estimate { because, .. } => Figure::estimate(bound, because),
                _ => Figure::bound(bound),
            }
        }
        (Some(_), Some(_)) => Figure::unavailable("the density is not told from 0"),
        _ => Figure::unavailable("the state's own error is not known"),
    };
    let sum = |pick: fn(&Measured) -> &Figure| match (pick(&rho.measured), pick(&m.measured)) {
        (a, b) => match (a.value(), b.value()) {
            (Some(x), Some(y)) => b.with(x + y),
            (None, _) => a.clone(),
            _ => b.clone(),
        },
    };
    Measured {
        estimator,
        overlap: Figure::unavailable("a quotient of two overlaps"),
        shots: sum(|m| &m.shots),
        evaluations: sum(|m| &m.evaluations),
        estimate: Figure::estimate(velocity, "drawn at random"),
        standard_error: match estimator.coherent() {
            true => m.measured.standard_error.clone(),
            false => Figure::estimate(
                above.error.hypot(velocity * below.error) / below.value.abs(),
                "to first order in the errors of density and momentum",
            ),
        },
        bound,
        evolutions_repeated: sum(|m| &m.evolutions_repeated),
        evolutions_coherent: sum(|m| &m.evolutions_coherent),
    }
}

#[cfg(test)]
mod tests;
