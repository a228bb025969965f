//! What the algorithm takes on a quantum computer, in the model of sparse access, and forward
//! Euler's cost beside it.
//!
//! **Queries.** With `τ = d ‖H‖_max T`, `H` is block-encoded as `H/(d‖H‖_max)` by a walk, and
//! `e^{−iHT}` by a sequence of `2K` phased steps of it. `K` is the degree at which the Jacobi–Anger
//! series is cut: `2 Σ_{k>K} |J_k(τ)| ≤ ε` (Low and Chuang 2017). The paper's form of the same is
//! `O(τ + log(1/ε)/log log(1/ε))` queries and a factor `O(n + m polylog m)` of other gates, for `n`
//! qubits and values of `m = log₂(1/ε)` bits (its lemma in section 3.2); with constants 1 it is an
//! estimate.
//!
//! The paper's asymptotic counts are in [`regime`], the printed table in `text`, the formats of
//! other programs in `formats`.

mod formats;
pub mod regime;
mod text;

use crate::base::error::Result;
use crate::problem::case::{Case, Interface};
use crate::propagate::chebyshev::degree;
use crate::quantum::access::extremes;
use crate::quantum::figure::Figure;
use crate::quantum::planned_modes;
use crate::quantum::probability::{PlannedState, Probabilities};
use crate::quantum::resources::regime::{Regime, gates_factor, logarithms};
use crate::quantum::sparsity;
use crate::quantum::sparsity::Sparsity;
use crate::schrodingerization::profile::series::points;
use crate::solve::prepared::Prepared;
use crate::solve::system::StateNorms;
use serde::Serialize;

/// Registers, in qubits.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct Registers {
    /// Each space axis, then each velocity axis.
    pub phase_space: Vec<usize>,
    /// The auxiliary unknowns of the inflow: one qubit says which half; 0 where nothing enters.
    pub auxiliary: usize,
    /// `p`: of `N_p` points on the planned period, which grows with the spectrum.
    pub p: usize,
    /// All of them.
    pub total: usize,
    /// `p` of the paper's count without that growth: `log₂(1/ε)`, for `Δp = ε` on an interval of
    /// length 1.
    pub p_without_growth: Figure,
    /// All of them, `p` counted so.
    pub total_without_growth: Figure,
}

/// What a case takes.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct Record {
    /// Title of the case.
    pub title: String,
    /// Cells along each axis, `(x1..xn, v1..vn)`.
    pub shape: Vec<usize>,
    /// Cells and auxiliary unknowns.
    pub unknowns: usize,
    /// `T`.
    pub time: f64,
    /// `ε`.
    pub tolerance: f64,
    /// The interface's rows.
    pub interface: Interface,
    /// Whether the unknowns are scaled by dissipative weights.
    pub weighted: bool,
    /// `N_p`.
    pub points: usize,
    /// Length of the interval in `p`.
    pub period: f64,
    /// Nonzeros, measured, against the paper's bounds.
    pub sparsity: Sparsity,
    /// `ε√P`, to which the evolution is approximated: beside the field that is measured in it, an
    /// error of the whole state is `1/√P` times as large.
    pub walk_tolerance: Figure,
    /// `d`: nonzeros of a row of `H`.
    pub nonzeros: Figure,
    /// `‖H‖_max`.
    pub largest_entry: Figure,
    /// `τ = d ‖H‖_max T`.
    pub tau: Figure,
    /// `K`, of the Jacobi–Anger series.
    pub degree: Figure,
    /// `2K`: phased steps of the walk, each of a fixed number of queries to either oracle.
    pub walk_steps: Figure,
    /// The paper's form.
    pub queries: Figure,
    /// `n + m log₂(m)²`: other gates for each query.
    pub gates_factor: Figure,
    /// Gates of the two transforms in `p`, `n_p log₂ n_p` each.
    pub transform_gates: Figure,
    /// T gates.
    pub t_gates: Figure,
    /// Registers.
    pub qubits: Registers,
    /// Forward Euler on the same grid: products with the nonzeros of `A`, at CFL 1.
    pub classical_operations: Figure,
    /// With what probability the first field is measured.
    pub probabilities: Probabilities,
    /// The paper's regimes.
    pub regimes: Vec<Regime>,
}

/// Qubits that number `count` things.
fn qubits(count: usize) -> usize {
    count.next_power_of_two().trailing_zeros() as usize
}

/// The degree `K` of the Jacobi–Anger series for `τ` to `tolerance`, and the `2K` steps of the
/// walk.
pub fn walk(tau: f64, tolerance: f64) -> (Figure, Figure) {
    /// Up to here the series is summed, beyond it is bounded (see [`degree`]).
    const SUMMED: f64 = 1e4;
    let order = degree(&mut Vec::new(), tau, tolerance) as f64;
    let label = if tau <= SUMMED { Figure::exact } else { Figure::bound };
    (label(order), label(2.0 * order))
}

/// What the norms rest on.
const NORMS: &str = "norms of the classical solution to three digits";

impl Record {
    /// What a case takes, with its plan of the modes and this rank's part of the system.
    /// Collective.
    ///
    /// # Errors
    /// As [`sparsity::measure`]; [`crate::base::error::Error::Input`] for a plan without modes.
    pub fn new(prepared: &Prepared, norms: StateNorms) -> Result<Self> {
        let Prepared { case, bounds, plan, system, communicator, .. } = prepared;
        let (warp, space) = (planned_modes(case, plan)?, &communicator.space);
        let sparsity = sparsity::measure(case, &system.matrix, space)?;
        // A register has a power of two of points, and H the modes of all of them.
        let points = points(&warp.series).next_power_of_two();
        let highest = warp.series.wavenumber(points / 2);
        let largest = space.max(extremes(&system.matrix, highest).0);
        let d = sparsity.of_hamiltonian() as f64;
        let (time, tolerance) = (case.duration(), case.tolerance);
        let planned = PlannedState { bounds, warp, time, points };
        let probabilities = Probabilities::new(&planned, norms, &|x| Figure::estimate(x, NORMS));
        let fine = tolerance * probabilities.amplitude();
        let tau = d * largest * time;
        let (degree, walk_steps) = walk(tau, fine);
        let unknowns = system.terms - case.space.space_cells() + case.space.cells();
        let qubits = Registers::new(case, unknowns, points);
        let operations = sparsity.entries as f64 * (bounds.rate * time).ceil().max(1.0);
        Ok(Self {
            title: case.title.clone(),
            shape: case.space.shape(),
            unknowns,
            time,
            tolerance,
            interface: case.interface,
            weighted: bounds.weighted,
            points,
            period: warp.series.period,
            walk_tolerance: Figure::estimate(fine, NORMS),
            nonzeros: Figure::exact(d),
            largest_entry: Figure::exact(largest),
            tau: Figure::exact(tau),
            degree,
            walk_steps,
            queries: Figure::estimate(
                tau + logarithms(fine),
                "O(tau + log(1/eps)/log log(1/eps)) with constants 1",
            ),
            gates_factor: Figure::estimate(
                gates_factor(qubits.total as f64, fine),
                "O(n + m polylog m) as n + m log2(m)^2, m = log2(1/eps)",
            ),
            transform_gates: Figure::estimate(
                2.0 * qubits.p as f64 * (qubits.p as f64).log2().max(1.0),
                "O(n_p log n_p) for each of two approximate transforms, constants 1",
            ),
            t_gates: Figure::unavailable(
                "the oracles' circuits are not compiled, and they are most of it",
            ),
            qubits,
            classical_operations: Figure::exact(operations),
            probabilities,
            regimes: [1.0, 0.5].map(|order| Regime::new(case, &sparsity, order)).to_vec(),
            sparsity,
        })
    }
}

impl Registers {
    /// For `unknowns` of the system and `points` in `p`.
    fn new(case: &Case, unknowns: usize, points: usize) -> Self {
        const WITHOUT: &str = "dp = eps on an interval of length 1";
        let phase_space: Vec<usize> = case.space.axes().map(|a| qubits(a.cells)).collect();
        let auxiliary = usize::from(unknowns > case.space.cells());
        let p = qubits(points);
        let system = phase_space.iter().sum::<usize>() + auxiliary;
        let without = (1.0 / case.tolerance).log2().ceil();
        Self {
            phase_space,
            auxiliary,
            p,
            total: system + p,
            p_without_growth: Figure::estimate(without, WITHOUT),
            total_without_growth: Figure::estimate(system as f64 + without, WITHOUT),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn steps_of_the_walk() {
        // J_k(τ) falls off beyond k = τ: at least τ terms, more for smaller tolerances.
        let count = |tau: f64, tolerance: f64| walk(tau, tolerance).0.value().expect("a number");
        assert_eq!(walk(50.0, 1e-6).1.value(), Some(2.0 * count(50.0, 1e-6)));
        assert!(count(50.0, 1e-3) > 50.0 && count(50.0, 1e-9) > count(50.0, 1e-3));
        assert!(count(1e3, 1e-6) < 1.1e3);
        assert!(matches!(walk(1e6, 1e-6).0, Figure::UpperBound { .. }));
    }
}
