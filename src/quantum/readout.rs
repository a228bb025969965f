//! Density, momentum and mean velocity at some cells, as a quantum computer measures them (paper,
//! section 7.2).
//!
//! Moments are overlaps. With `q = 1` for the density and `q = v_a` for momentum `a`, at the space
//! cell `i`
//!
//! ```text
//! m_i = Δv Σ_j q_j f_ij
//!     = C_f Δv ‖q‖ ⟨χ_i|F⟩               |χ_i⟩ = |i⟩ ⊗ Σ_j q_j|j⟩/‖q‖,  |F⟩ = f/C_f
//!     = C_w/G Δv ‖q/√π‖ ⟨ζ_i|w⟩          |ζ_i⟩ = |0⟩ ⊗ |i⟩ ⊗ Σ_j q_j π_ij^{−½}|j⟩/‖q/√π‖ ⊗ |g⟩
//!                                        |g⟩ = Σ_k e^{−p_k}|k⟩/G,  G² = Σ_k e^{−2p_k}
//! ```
//!
//! from the postselected and from the enlarged state, `k` going over the window in which the
//! profile is `e^{−p}` (the paper reads at its first point, where `G = e^{−p◇}`; the probability of
//! a slice halves with every doubling of `N_p`). The enlarged state holds `√π f`. There the weights
//! are undone in `ζ`: since `π ≥ 1`, this never costs more than undoing them in the state, which
//! has a probability of its own ([`crate::quantum::probability`]). Without weights these are the
//! paper's formulas. On elements of a degree above 0 the weights are relative volumes, which the
//! state of the field holds, too: `|F⟩ = √π f/C_f` and `q/√π` takes the place of `q` in `χ`.
//!
//! Each overlap is measured as in [`measurement`], with counts drawn from their exact
//! distributions. What is drawn depends on the seed, the cell, the observable and the estimator
//! only: it is the same on any ranks and for any other selection of cells.
//!
//! **Accuracy.** An overlap with error `ε_obs` of a state with error `ε_F` gives a moment with
//! error `prefactor · ε_obs + C_f Δv ‖q‖ ε_F`; `ε_F` is the tolerance of the run, or as much more
//! as the window's points have. The postselected state needs `C_f` too, with relative error `η`,
//! which adds `|m| η`, and, as exact amplitude amplification rests on the `P` that gave it, `3/2
//! |m| η²`; of a unitary flow `C_f = ‖u(0)‖` and `P` are known, and `η` is 0. A bound holds with
//! probability [`CONFIDENCE`] for each measurement that it needs: one from the enlarged state and
//! of a unitary flow, two from the postselected state else, and for a mean velocity.
//!
//! **Cost**, in evolutions `e^{−iHT}` of the whole state. A shot from the postselected state takes
//! `1/P` of them by repetition, `2r + 1` with `r` rounds of exact amplitude amplification; a shot
//! from the enlarged state takes one. Amplitude estimation inverts the preparation, which excludes
//! repetition. `C_f = C_w √P/G` follows from how many repetitions succeed, or else takes an
//! amplitude estimation of `P` of its own; that of a unitary flow takes nothing.
//!
//! A measurement of the x-register alone does not give the density: it finds the cell `i` with
//! probability `Σ_j f_ij²/C_f²` (the paper's last remark there), with volumes
//! `Σ_j π_ij f_ij²/C_f²`, reported as `basis_probability`.

pub mod files;
pub mod measurement;
pub mod random;
pub mod reader;
pub mod row;

use crate::base::text::{counted, on_one_line};
use crate::matrix::observables::VelocityFactors;
use crate::parallel::communicator::Group;
use crate::problem::case::{Case, Data};
use crate::problem::formula::Expression;
use crate::problem::grid::axis_names;
use crate::quantum::labelled_number::LabelledNumber;
use crate::quantum::readout::measurement::CONFIDENCE;
use crate::quantum::readout::reader::{ReadoutContext, ReadoutSource};
use crate::quantum::readout::row::{Observable, ReadoutRow};
use serde::Serialize;
use std::f64::consts::TAU;

/// The readout: estimates, bounds, and the evolutions that they take.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct Readout {
    /// The least probability with which the bound of each measurement holds.
    pub confidence: f64,
    /// `C_f`.
    pub norm_of_field: LabelledNumber,
    /// `P` of the window, or of the slice at `p◇` where there is none.
    pub probability: LabelledNumber,
    /// `1/P`.
    pub repetitions: LabelledNumber,
    /// Number of rounds of exact amplitude amplification.
    pub amplification_rounds: LabelledNumber,
    /// `ε_F`.
    pub state_error: LabelledNumber,
    /// Probability, for each cell, that a measurement of the x-register finds it.
    pub basis_probability: Vec<LabelledNumber>,
    /// The rows, cell by cell.
    pub rows: Vec<ReadoutRow>,
}

impl Readout {
    /// A line with the first row, and the number of further rows.
    pub fn line(&self) -> Option<String> {
        let first = self.rows.first()?.text();
        let more = match self.rows.len() - 1 {
            0 => String::new(),
            many => format!("; {} in readout.csv", counted(many, "more row", "more rows")),
        };
        Some(format!("readout: {first}{more}"))
    }

    /// The readout of all cells and observables of `[readout]` in `case`, with every number
    /// unavailable; `why` is the reason.
    pub fn unavailable(case: &Case, why: &str) -> Self {
        let none = || LabelledNumber::unavailable(why);
        let cells = case.readout.as_ref().map_or(&[][..], |r| &r.cells);
        let rows = cells.iter().flat_map(|cell| {
            Observable::all(case.space.dimension()).into_iter().map(move |observable| ReadoutRow {
                value: none(),
                ..ReadoutRow::at(&case.space, cell, observable)
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

    /// Reads the cells and observables of `case` from `source`; the same on all ranks. Collective
    /// over `world`.
    pub fn new(world: &Group, case: &Case, source: &ReadoutSource<'_>) -> Self {
        let Some(readout) = &case.readout else {
            return Self::unavailable(case, "the case has no [readout]");
        };
        if let Some(why) = source.probabilities.norms.no_field() {
            return Self::unavailable(case, why);
        }
        let chain = source.probabilities.nearest();
        let factors = VelocityFactors::new(&case.space);
        let reader = ReadoutContext { case, source, readout, factors: &factors };
        let (mut rows, mut basis) = (Vec::new(), Vec::new());
        for cell in &readout.cells {
            let sums = reader.sums(world, cell);
            basis.push(LabelledNumber::exact(sums.square / (source.norm() * source.norm())));
            rows.extend(reader.rows(cell, &sums));
        }
        Self {
            confidence: CONFIDENCE,
            norm_of_field: LabelledNumber::exact(source.norm()),
            probability: chain.all.clone(),
            repetitions: chain.repetitions.clone(),
            amplification_rounds: chain.amplification_rounds.clone(),
            state_error: source.state_error.clone(),
            basis_probability: basis,
            rows,
        }
    }
}

/// Why the moments of measure-valued data are no overlaps, and which data have the same moments.
pub const MEASURE_VALUED: &str = "f = phi delta(psi) is not a vector of amplitudes: phi and psi \
     are in separate states, and the density, the integral of phi delta(psi) over v, is not linear \
     in them; initial.f = density * a smooth delta function of v - velocity, of a width of about \
     2/3 of a cell, is transported linearly, and its density and mean velocity are overlaps";

/// The keys of measure-valued data with a smooth delta function in its place: the normal density
/// whose standard deviation is two thirds of a cell along each axis of velocity, the best width on
/// most grids of docs/quantum.md. None for other data.
pub fn smooth_delta(case: &Case) -> Option<String> {
    const CELLS: f64 = 2.0 / 3.0;
    let Data::Measure { density, velocity } = &case.data else { return None };
    let one_line = |formula: &Expression| on_one_line(formula.text());
    let names = axis_names(case.space.dimension());
    let names = &names[case.space.dimension()..];
    let mut f = format!("({})", one_line(density));
    for ((v, u), axis) in names.iter().zip(velocity).zip(&case.space.v) {
        let width = CELLS * axis.width();
        let (variance, scale) = (2.0 * width * width, TAU.sqrt() * width);
        f += &format!(" * exp(-({v} - ({}))^2/{variance:.6e})/{scale:.6e}", one_line(u));
    }
    Some(format!("initial = {{ f = \"{f}\" }}, inflow.value = \"initial\""))
}

#[cfg(test)]
mod tests;
