//! The walk that block-encodes `H`, and `e^{−iHT}` by it: calls of the oracles, bits of values,
//! registers.
//!
//! With `d` entries in a row, `X = ‖H‖_max` and the columns `k` of row `j`, the isometry
//!
//! ```text
//! V|j⟩ = d^{−½} Σ_k |j⟩|0⟩ ⊗ |k⟩(√(H_jk*/X)|0⟩ + √(1 − |H_jk|/X)|1⟩)
//! ```
//!
//! and the swap `W` of both halves give `V†WV = H/(dX)` (Berry and Childs 2012). A real entry below
//! 0 has the roots `±i√|H_jk|` above and below the diagonal; on the diagonal `W` has the sign,
//! which is that of `−μ_l`, as `S_ii ≤ 0`.
//!
//! | one `V` | calls |
//! |---|---|
//! | `(j, ℓ) → (j, k)`, in place | 1 of the location oracle |
//! | `H_jk` into its register, and out of it after the rotation | 2 of the value oracle |
//!
//! A step of the walk has `V` and `V†`: [`LOCATION_CALLS`] and [`VALUE_CALLS`]. In place, a row
//! with fewer entries than `d` needs different dummies: `ℓ` behind the last column. `e^{−iHT}`
//! takes `2K` phased steps, `K` being the degree at which the Jacobi–Anger series of `e^{−iτx}`, `τ
//! = dXT`, is cut: `t = 2 Σ_{k>K} |J_k(τ)| ≤ ε/2` (Low and Chuang 2017).
//!
//! **Bits.** Both parts of a value are rounded to multiples of `X/(2^{m−1} − 1)`, so that an entry
//! is off by `X/(√2 (2^{m−1} − 1))`, `H` by `d` times that, and `e^{−iHT}` by `τ/(√2 (2^{m−1} −
//! 1))`: `m` is about `log₂ τ` more than the `log₂ 1/ε` of the paper's theorems.
//!
//! **Budget.** Of the tolerance of the field the profile in its window has [`PROFILE_PART`], and
//! the evolution [`EVOLUTION_PART`]; without a profile the evolution has all of it
//! ([`evolution_part`]). Of the evolution's tolerance the cut series has [`SERIES_PART`], rounded
//! values, or jumps that are rounded to levels, have [`ROUNDING_PART`], and rotations by Clifford
//! and T gates [`ROTATIONS_PART`].
//! A series whose rest is `t` is within `2t` of the exponential as a sequence of steps
//! ([`phases`](crate::quantum::phases)): so `K` is the least degree with `2t` in its part.
//!
//! **Half as many calls.** With its reflection before the call instead of behind it the walk is its
//! inverse. So the qubit of the sequence may choose between a step forward and a step back, where
//! it chooses between a step and none above, and a call serves two powers of the walk. All powers
//! in such a sequence are odd, or all are even: the even part of the series is multiplied by one
//! more step, which a controlled call before and one behind undo (Berry, Motlagh, Pantaleoni and
//! Wiebe 2024). These are `d + 2` calls, `d` being the least odd number that is neither below `K`
//! nor below `τ` ([`calls_both_ways`]). The rotations of this sequence exist; they are not computed
//! here.

use crate::base::table::ColumnValues;
use crate::propagate::chebyshev::{LONGEST_SUMMED, degree};
use crate::quantum::labelled_number::LabelledNumber;
use serde::Serialize;
use std::f64::consts::SQRT_2;

/// Calls of the location oracle in a step of the walk, inverses included.
pub const LOCATION_CALLS: f64 = 2.0;
/// Calls of the value oracle in a step of the walk, inverses included.
pub const VALUE_CALLS: f64 = 4.0;
/// Part of the tolerance of the field that the profile may take, in the window or at the point.
pub const PROFILE_PART: f64 = 0.5;
/// Part of the tolerance of the field that the evolution may take, relative to the state.
pub const EVOLUTION_PART: f64 = 0.5;
/// Part of the evolution's tolerance that the cut series may take.
pub const SERIES_PART: f64 = 0.5;
/// Part of the evolution's tolerance that rounding may take, of values or of jumps of `V` to
/// levels.
pub const ROUNDING_PART: f64 = 0.25;
/// Part of the evolution's tolerance that the synthesis of rotations may take.
pub const ROTATIONS_PART: f64 = 0.25;

/// The cost of `e^{−iHT}`.
#[derive(Clone, Debug, PartialEq)]
pub struct WalkCost {
    /// `K`.
    pub degree: LabelledNumber,
    /// `2K` steps of the walk.
    pub steps: LabelledNumber,
    /// Bits of the real part of a value, its sign included, and of the imaginary part.
    pub bits: LabelledNumber,
}

impl WalkCost {
    /// The cost for `τ`, within `tolerance` relative to the norm of the state. Each number has the
    /// weaker label of the two.
    pub fn new(tau: &LabelledNumber, tolerance: &LabelledNumber) -> Self {
        let both = tau.times(tolerance);
        let (Some(tau), Some(tolerance)) = (tau.value(), tolerance.value()) else {
            return Self { degree: both.clone(), steps: both.clone(), bits: both };
        };
        let order = degree(&mut Vec::new(), tau, 0.5 * SERIES_PART * tolerance) as f64;
        let label =
            if tau <= LONGEST_SUMMED { LabelledNumber::exact } else { LabelledNumber::bound };
        let degree = both.with(1.0).times(&label(order));
        let bits = value_bits(tau, ROUNDING_PART * tolerance);
        Self { steps: degree.with(2.0 * order), bits: both.with(f64::from(bits)), degree }
    }

    /// Calls of an oracle that a step calls `each` times.
    pub fn calls(&self, each: f64) -> LabelledNumber {
        self.steps.with(each * self.steps.or_zero())
    }
}

/// Calls of the oracles of sparse access and of their inverses, by the sequence of `2K` steps.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct OracleQueries {
    /// Calls of the location oracle in an evolution.
    pub location_queries: LabelledNumber,
    /// Calls of the value oracle in an evolution.
    pub value_queries: LabelledNumber,
    /// Calls of both.
    pub queries: LabelledNumber,
    /// Calls of both until the field is measured in the window, or in the slice where there is
    /// none: repeated, and by amplitude amplification.
    pub queries_until_measured: [LabelledNumber; 2],
}

impl OracleQueries {
    /// The calls of an `evolution`. `evolutions` are those until the field is measured: repeated,
    /// and by amplitude amplification.
    pub fn new(evolution: &WalkCost, evolutions: &[LabelledNumber; 2]) -> Self {
        let queries = evolution.calls(LOCATION_CALLS + VALUE_CALLS);
        Self {
            location_queries: evolution.calls(LOCATION_CALLS),
            value_queries: evolution.calls(VALUE_CALLS),
            queries_until_measured: evolutions.each_ref().map(|n| n.times(&queries)),
            queries,
        }
    }

    /// The numbers of `all` as columns of a table.
    pub fn columns<'a>(all: impl Iterator<Item = &'a Self> + Clone) -> [ColumnValues; 5] {
        let column = |name: &str, figure: fn(&Self) -> &LabelledNumber| {
            LabelledNumber::column(name, all.clone().map(figure))
        };
        [
            column("location_queries", |calls| &calls.location_queries),
            column("value_queries", |calls| &calls.value_queries),
            column("queries", |calls| &calls.queries),
            column("queries_until_measured_repeated", |calls| &calls.queries_until_measured[0]),
            column("queries_until_measured_amplified", |calls| &calls.queries_until_measured[1]),
        ]
    }

    /// No numbers, for this reason.
    pub fn unavailable(why: &str) -> Self {
        let none = || LabelledNumber::unavailable(why);
        Self {
            location_queries: none(),
            value_queries: none(),
            queries: none(),
            queries_until_measured: [none(), none()],
        }
    }
}

/// Part of the field's tolerance that the evolution has: all of it without a profile.
pub fn evolution_part(has_profile: bool) -> f64 {
    if has_profile { EVOLUTION_PART } else { 1.0 }
}

/// `d`: calls of a sequence of steps forward and back, for a series of this degree and `τ`.
pub fn calls_both_ways(degree: f64, tau: f64) -> f64 {
    let least = degree.max(tau.ceil());
    if least % 2.0 == 1.0 { least } else { least + 1.0 }
}

/// The least `m` with `τ/(√2 (2^{m−1} − 1)) ≤ tolerance`; 2 or more.
pub fn value_bits(tau: f64, tolerance: f64) -> u32 {
    let magnitudes = 1.0 + tau / (SQRT_2 * tolerance);
    1 + magnitudes.log2().ceil().max(1.0) as u32
}

/// Qubits of the walk, the system's own included.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct WalkRegisters {
    /// Qubits of row and column: those of the system, one more for the dummies, and the flag;
    /// twice.
    pub row_and_column: usize,
    /// Qubits of the real and imaginary part of a value.
    pub value: usize,
    /// Scratch qubits of the rotation.
    pub arithmetic: LabelledNumber,
    /// Qubits of the phased sequence itself.
    pub phase: usize,
    /// Number of all qubits.
    pub total: LabelledNumber,
}

impl WalkRegisters {
    /// The registers for `system` qubits of the system and values of `bits` bits.
    pub fn new(system: usize, bits: f64) -> Self {
        const WHY: &str = "4 m for a modulus, its root and a comparison; no circuit is compiled";
        let (row_and_column, value, phase) = (2 * (system + 2), 2 * bits as usize, 1);
        let arithmetic = 4.0 * bits;
        let total = (row_and_column + value + phase) as f64 + arithmetic;
        Self {
            row_and_column,
            value,
            arithmetic: LabelledNumber::model(arithmetic, WHY),
            phase,
            total: LabelledNumber::model(total, WHY),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::quantum::labelled_number::Trust;
    use crate::quantum::phases::Phases;
    use num_complex::Complex64;
    use std::collections::BTreeMap;

    #[test]
    fn steps_of_the_walk() {
        // J_k(τ) falls off beyond k = τ: at least τ terms, more for smaller tolerances.
        let number = |figure: &LabelledNumber| figure.value().expect("a number");
        let exact = LabelledNumber::exact;
        let cost = |tau: f64, tolerance: f64| WalkCost::new(&exact(tau), &exact(tolerance));
        let count = |tau: f64, tolerance: f64| number(&cost(tau, tolerance).degree);
        // The sequence is within 2t, and that is in the part of the series.
        for tolerance in [1e-2, 1e-5] {
            let bound = Phases::new(20.0, count(20.0, tolerance) as usize).expect("phases").bound;
            assert!(bound <= SERIES_PART * tolerance, "{tolerance}: {bound:e}");
        }
        assert_eq!(SERIES_PART + ROUNDING_PART + ROTATIONS_PART, 1.0);
        let evolution = cost(50.0, 1e-6);
        assert_eq!(number(&evolution.steps), 2.0 * count(50.0, 1e-6));
        assert_eq!(number(&evolution.calls(VALUE_CALLS)), 8.0 * count(50.0, 1e-6));
        assert!(count(50.0, 1e-3) > 50.0 && count(50.0, 1e-9) > count(50.0, 1e-3));
        assert!(count(1e3, 1e-6) < 1.1e3);
        assert_eq!(cost(1e6, 1e-6).degree.trust(), Trust::UpperBound);
        // Steps are no more exact than what they follow from, and a bound of an estimate is none.
        assert_eq!(cost(50.0, 1e-6).steps.trust(), Trust::Exact);
        let estimate = LabelledNumber::estimate(1e-6, "sampled");
        for tau in [50.0, 1e6] {
            let WalkCost { degree, steps, bits } = WalkCost::new(&exact(tau), &estimate);
            assert_eq!([degree, steps, bits].map(|n| n.trust()), [Trust::Estimate; 3]);
        }
        let model = LabelledNumber::model(50.0, "assumed");
        assert_eq!(WalkCost::new(&model, &estimate).steps.trust(), Trust::Model);
    }

    #[test]
    fn bits_follow_from_the_error_that_rounding_makes() {
        for (tau, tolerance) in [(3.0, 0.1), (1e3, 1e-3), (7e5, 1e-8)] {
            let error = |m: u32| tau / (SQRT_2 * (f64::from(m - 1).exp2() - 1.0));
            let m = value_bits(tau, tolerance);
            assert!(error(m) <= tolerance && error(m - 1) > tolerance, "{tau} {tolerance}: {m}");
        }
    }

    const ORDER: usize = 5;
    /// Entries of the fullest row.
    const FULLEST: usize = 4;

    /// A Hermitian matrix with rows of different lengths and entries of every sign and phase.
    fn matrix() -> Vec<Vec<Complex64>> {
        let mut h = vec![vec![Complex64::ZERO; ORDER]; ORDER];
        let upper = [(0, 1, -0.7, 0.0), (0, 2, 0.3, -0.4), (0, 4, 0.0, 0.9), (1, 2, 0.5, 0.1)];
        for (j, k, re, im) in upper {
            h[j][k] = Complex64::new(re, im);
            h[k][j] = h[j][k].conj();
        }
        for (j, x) in [(0, -0.6), (2, 0.8), (3, -1.0)] {
            h[j][j] = Complex64::from(x);
        }
        h
    }

    /// Both halves of the walk's registers, and the value register.
    #[derive(Clone, Copy, PartialEq, Eq, PartialOrd, Ord)]
    struct DoubledRegisters {
        row: (usize, bool),
        column: (usize, bool),
        value: [u64; 2],
    }

    /// Amplitudes of basis states, and the calls that made them.
    struct WalkState {
        amplitudes: BTreeMap<DoubledRegisters, Complex64>,
        location_calls: f64,
        value_calls: f64,
    }

    impl WalkState {
        /// Every basis state to some others.
        fn map(&mut self, of: impl Fn(DoubledRegisters) -> Vec<(DoubledRegisters, Complex64)>) {
            let mut next = BTreeMap::new();
            for (registers, amplitude) in &self.amplitudes {
                for (to, factor) in of(*registers) {
                    *next.entry(to).or_insert(Complex64::ZERO) += factor * amplitude;
                }
            }
            self.amplitudes = next;
        }

        /// The value oracle: bits of `H_jk` are added to the register, without carries.
        fn value(&mut self, h: &[Vec<Complex64>]) {
            self.value_calls += 1.0;
            self.map(|mut at| {
                let entry = h[at.row.0].get(at.column.0).copied().unwrap_or(Complex64::ZERO);
                at.value[0] ^= entry.re.to_bits();
                at.value[1] ^= entry.im.to_bits();
                vec![(at, Complex64::ONE)]
            });
        }

        /// The location oracle in place; `ℓ` beyond the row's entries is a dummy.
        fn location(&mut self, h: &[Vec<Complex64>]) {
            self.location_calls += 1.0;
            self.map(|mut at| {
                let columns: Vec<usize> =
                    (0..ORDER).filter(|&k| h[at.row.0][k] != Complex64::ZERO).collect();
                let entry = at.column.0;
                at.column.0 = columns.get(entry).copied().unwrap_or(ORDER + entry);
                vec![(at, Complex64::ONE)]
            });
        }
    }

    /// `V|j⟩`.
    fn isometry(h: &[Vec<Complex64>], largest: f64, j: usize) -> WalkState {
        let start = DoubledRegisters { row: (j, false), column: (0, false), value: [0; 2] };
        let mut state = WalkState {
            amplitudes: BTreeMap::from([(start, Complex64::ONE)]),
            location_calls: 0.0,
            value_calls: 0.0,
        };
        let uniform = Complex64::from((FULLEST as f64).sqrt().recip());
        let entries = |at: DoubledRegisters| {
            let to = |entry| (DoubledRegisters { column: (entry, false), ..at }, uniform);
            (0..FULLEST).map(to).collect()
        };
        state.map(entries);
        state.location(h);
        state.value(h);
        state.map(|at| {
            let [re, im] = at.value.map(f64::from_bits);
            let (row, column) = (at.row.0, at.column.0);
            let is_negative = im == 0.0 && re < 0.0;
            let root = if is_negative && row < column {
                Complex64::new(0.0, -re.abs().sqrt())
            } else if is_negative && row > column {
                Complex64::new(0.0, re.abs().sqrt())
            } else if is_negative {
                Complex64::from(re.abs().sqrt())
            } else {
                Complex64::new(re, -im).sqrt()
            };
            let rest = (1.0 - re.hypot(im) / largest).max(0.0).sqrt();
            let flagged = DoubledRegisters { column: (column, true), ..at };
            vec![(at, root / largest.sqrt()), (flagged, Complex64::from(rest))]
        });
        state.value(h);
        state
    }

    /// A step of calls of the oracles, each a unitary of all registers, block-encodes `H/(dX)`.
    #[test]
    fn a_step_of_so_many_calls_encodes_the_matrix() {
        let h = matrix();
        let largest = h.iter().flatten().fold(0.0, |m: f64, x| m.max(x.norm()));
        let states: Vec<WalkState> = (0..ORDER).map(|j| isometry(&h, largest, j)).collect();
        for (j, left) in states.iter().enumerate() {
            // The value register is clear again, and the norm 1.
            assert!(left.amplitudes.keys().all(|at| at.value == [0; 2]));
            let norm: f64 = left.amplitudes.values().map(Complex64::norm_sqr).sum();
            assert!((norm - 1.0).abs() < 1e-14);
            assert_eq!(2.0 * left.location_calls, LOCATION_CALLS);
            assert_eq!(2.0 * left.value_calls, VALUE_CALLS);
            for (k, right) in states.iter().enumerate() {
                let mut block = Complex64::ZERO;
                for (at, amplitude) in &right.amplitudes {
                    let swapped =
                        DoubledRegisters { row: at.column, column: at.row, value: at.value };
                    let on_diagonal = at.row.0 == at.column.0 && h[at.row.0][at.row.0].re < 0.0;
                    let sign = if on_diagonal { -1.0 } else { 1.0 };
                    if let Some(other) = left.amplitudes.get(&swapped) {
                        block += sign * other.conj() * amplitude;
                    }
                }
                let expected = h[j][k] / (FULLEST as f64 * largest);
                assert!((block - expected).norm() < 1e-14, "{j} {k}: {block} {expected}");
            }
        }
    }
}
