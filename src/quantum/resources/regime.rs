//! The paper's asymptotic counts of queries, beside forward Euler's operations.
//!
//! Where the solution has discontinuities at interfaces only, `N = ε^{−1}` cells an axis, elsewhere
//! `ε^{−2}` (paper, theorems of sections 4 to 6). `Δp = ε`, `‖H‖_max = Σ_a (N_xa + N_va)/Δp`,
//! `d = Σ Q_a + n`. Forward Euler takes `n² T ε^{−(2n+1)}` or `n² T ε^{−(4n+2)}` operations.
//! `Δp = ε` is for an initial function with a corner, `e^{−|p|}`; where it is in `H^r`, the paper
//! remarks, `N_p = O(ε^{−1/r})`. Nothing is compared: what is left out of an asymptotic count is as
//! large as a crossover.

use crate::problem::case::Case;
use crate::quantum::labelled_number::LabelledNumber;
use crate::quantum::sparsity::{Sparsity, q};
use serde::Serialize;

/// The paper's asymptotic count at a tolerance, with constants 1.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct Regime {
    /// Where the solution is discontinuous, in words.
    pub discontinuities: String,
    /// Number of cells for each axis.
    pub cells_per_axis: LabelledNumber,
    /// Number of queries: `(Σ Q_a + n) n T/ε^{2 or 3} + log(1/ε)/log log(1/ε)`.
    pub queries: LabelledNumber,
    /// Number of other gates for each query.
    pub gates_factor: LabelledNumber,
    /// Number of qubits, if `p` does not grow.
    pub qubits: LabelledNumber,
    /// Number of qubits, if `p` grows with the spectrum.
    pub qubits_with_growth: LabelledNumber,
    /// Operations of forward Euler.
    pub classical_operations: LabelledNumber,
}

/// `log(1/ε)/log log(1/ε)`; natural logarithms, at least 1.
pub(crate) fn logarithms(tolerance: f64) -> f64 {
    let log = (1.0 / tolerance).ln();
    if log > std::f64::consts::E { log / log.ln() } else { 1.0 }
}

/// `n + m log₂(m)²` for values of `m` bits; the theorems have `m = log₂(1/ε)`.
pub(crate) fn gates_factor(qubits: f64, bits: f64) -> f64 {
    qubits + bits * bits.log2().max(1.0).powi(2)
}

/// The parameters of the paper's counts, beside the tolerance and the dimension.
#[derive(Clone, Copy)]
struct RegimeParameters {
    /// Order of the scheme: 1, or ½ where the solution jumps anywhere.
    order: f64,
    /// `T`.
    time: f64,
    /// Largest jump of `V`.
    jump: f64,
    /// Largest extent of a velocity axis.
    extent: f64,
}

struct PaperCounts {
    queries: f64,
    /// Operations of forward Euler.
    operations: f64,
}

impl RegimeParameters {
    /// The paper's counts at the tolerance `tolerance` in `n` space dimensions.
    fn counts(&self, n: usize, tolerance: f64) -> PaperCounts {
        let (n, cells) = (n as f64, tolerance.powf(-1.0 / self.order));
        let each = q(self.extent / cells, self.jump) as f64;
        let queries = (n * each + n) * n * self.time * cells / tolerance + logarithms(tolerance);
        // n nonzeros a row, N^{2n} cells, n T N steps.
        let operations = n * n * self.time * cells.powf(2.0 * n + 1.0);
        PaperCounts { queries, operations }
    }
}

impl Regime {
    /// The regime for the order, 1 or ½, that the scheme has.
    pub(crate) fn new(case: &Case, sparsity: &Sparsity, order: f64) -> Self {
        const WHY: &str = "the theorem's form with constants 1";
        let (n, tolerance) = (case.space.dimension(), case.tolerance);
        let parameters = RegimeParameters {
            order,
            time: case.duration(),
            jump: sparsity.jumps.iter().fold(0.0, |m: f64, j| m.max(*j)),
            extent: case.space.v.iter().map(|v| v.upper - v.lower).fold(0.0, f64::max),
        };
        let PaperCounts { queries, operations } = parameters.counts(n, tolerance);
        let bits = (1.0 / tolerance).log2();
        let axis = bits / order;
        let (each, with_growth) = (2.0 * n as f64 * axis, bits + axis);
        let estimate = |x: f64| LabelledNumber::model(x, WHY);
        Self {
            discontinuities: if order == 1.0 { "at interfaces only" } else { "anywhere" }
                .to_owned(),
            cells_per_axis: estimate(tolerance.powf(-1.0 / order)),
            queries: estimate(queries),
            gates_factor: estimate(gates_factor(each + bits, bits.max(1.0))),
            qubits: estimate(each + bits),
            qubits_with_growth: estimate(each + with_growth),
            classical_operations: estimate(operations),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::quantum::test_support::exponent;

    /// The theorems of sections 4 to 6: queries `(ΣQ + n) n T ε^{−2}` or `ε^{−3}`, where `Q` itself
    /// grows like `ε^{−1/2}` or `ε^{−1}` with the number of velocity cells, and `n² T ε^{−(2n+1)}`
    /// or `ε^{−(4n+2)}` operations of forward Euler.
    #[test]
    fn exponents_are_those_of_the_theorems() {
        let inverse: Vec<f64> = (4..=9).map(|k| 10f64.powi(k)).collect();
        for n in 1..=3 {
            for (order, power) in [(1.0, 2.0), (0.5, 3.0)] {
                let parameters = RegimeParameters { order, time: 1.0, jump: 0.2, extent: 3.0 };
                let of = |x: f64| parameters.counts(n, 1.0 / x);
                let q_of = |x: f64| q(3.0 / x.powf(1.0 / order), 0.2) as f64;
                let queries: Vec<(f64, f64)> =
                    inverse.iter().map(|&x| (x, of(x).queries / (q_of(x) + 1.0))).collect();
                let found = exponent(&queries);
                assert!((found - power).abs() < 1e-3, "{n} {order}: {found}");
                let cells: Vec<(f64, f64)> = inverse.iter().map(|&x| (x, q_of(x))).collect();
                let found = exponent(&cells);
                assert!((found - 0.5 / order).abs() < 0.03, "Q, order {order}: {found}");
                let operations: Vec<(f64, f64)> =
                    inverse.iter().map(|&x| (x, of(x).operations)).collect();
                let found = exponent(&operations);
                let expected = (2.0 * n as f64 + 1.0) / order;
                assert!((found - expected).abs() < 1e-9, "{n} {order}: {found}");
            }
        }
        // Q of the paper's example 1: 128 cells on [-1.5, 1.5], a jump of 0.2.
        assert_eq!(q(3.0 / 128.0, 0.2), 16);
    }
}
