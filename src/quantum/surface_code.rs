//! Physical qubits and seconds of a computation in the surface code, under assumptions that are
//! stated.
//!
//! A logical qubit of distance `d` has `2(d + 1)²` physical ones, and as many again lie between
//! them for lattice surgery. It fails in a cycle with probability `0.1 (p/p_th)^{(d+1)/2}`,
//! `p = 10⁻³`, `p_th = 10⁻²` (Fowler and Gidney 2018). Four factories of `144 d²` physical qubits
//! make a CCZ state in `5.5 d` cycles each (Gidney and Fowler 2019), one Toffoli gate after the
//! other. `d` is the least odd number with which all logical qubits together fail with probability
//! 0.01 or less. Seconds follow from the same `d` and factories, and from cycles of 1 µs: `5.5 d/4`
//! of them a Toffoli gate.
//!
//! Not in it: the errors of the states that the factories make, the time and room of Clifford gates
//! and of the preparation, and states that wait for a decoder.

use crate::quantum::labelled_number::LabelledNumber;
use serde::Serialize;

/// The assumptions, for a record.
const ASSUMED: &str = "surface code, physical errors 1e-3, threshold 1e-2, failure 0.01 in all, 4 \
                       factories of CCZ states, half of the rest for lattice surgery";
/// `p/p_th`.
const ERROR: f64 = 0.1;
/// Probability that the computation fails.
const FAILURE: f64 = 0.01;
const FACTORIES: f64 = 4.0;
/// Cycles in which a factory makes a state, for each unit of the code distance.
const CYCLES: f64 = 5.5;
/// Seconds of a cycle.
const CYCLE: f64 = 1e-6;
const MOST_DISTANCE: u32 = 101;

/// The least code distance for `qubits` logical qubits and `toffoli` Toffoli gates; `None` above
/// 101.
fn distance(qubits: f64, toffoli: f64) -> Option<u32> {
    (3..=MOST_DISTANCE).step_by(2).find(|&d| {
        let cycles = toffoli * CYCLES * f64::from(d) / FACTORIES;
        2.0 * qubits * cycles * 0.1 * ERROR.powf(0.5 * f64::from(d + 1)) <= FAILURE
    })
}

/// A computation in the surface code: a model.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct PhysicalCost {
    /// Physical qubits, factories included.
    pub physical_qubits: LabelledNumber,
    /// `d`; `None` where there is no number.
    pub code_distance: Option<u32>,
    /// Seconds that the computation takes.
    pub seconds: LabelledNumber,
}

impl PhysicalCost {
    /// The cost of `qubits` logical qubits and `toffoli` gates, counted in Toffoli gates.
    pub fn new(qubits: &LabelledNumber, toffoli: &LabelledNumber) -> Self {
        let (Some(n), Some(gates)) = (qubits.value(), toffoli.value()) else {
            return Self::unavailable(
                "the number of logical qubits or of Toffoli gates is not known",
            );
        };
        let Some(distance) = distance(n, gates) else {
            return Self::unavailable("no distance up to 101 suffices");
        };
        let d = f64::from(distance);
        let count = 2.0 * n * 2.0 * (d + 1.0).powi(2) + FACTORIES * 144.0 * d * d;
        let of_gate = CYCLES * d / FACTORIES * CYCLE;
        let pace = format!(
            "distance {distance}; {:.1e} Toffoli gates a second: 4 factories, {CYCLES} d cycles of \
             1 us a state",
            of_gate.recip()
        );
        Self {
            physical_qubits: LabelledNumber::model(count, &format!("distance {d}; {ASSUMED}")),
            code_distance: Some(distance),
            seconds: LabelledNumber::model(gates * of_gate, &pace),
        }
    }

    /// No numbers, for this reason.
    pub fn unavailable(why: &str) -> Self {
        let none = || LabelledNumber::unavailable(why);
        Self { physical_qubits: none(), code_distance: None, seconds: none() }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn distances_suffice_and_are_least() {
        for (qubits, toffoli) in [(20.0, 1e3), (67.0, 7.8e8), (89.0, 1e13)] {
            let d = distance(qubits, toffoli).expect("a distance");
            let failure = |d: u32| {
                0.2 * qubits * toffoli * 5.5 * f64::from(d) / 4.0
                    * 10f64.powf(-0.5 * f64::from(d + 1))
            };
            assert!(failure(d) <= 0.01 && failure(d - 2) > 0.01, "{qubits} {toffoli}: {d}");
        }
        assert_eq!(distance(100.0, 1e60), None);
    }

    /// Qubits and seconds are of one distance: seconds follow from the factories that are among the
    /// qubits.
    #[test]
    fn seconds_are_those_of_the_factories() {
        for (qubits, toffoli) in [(100.0, 1e9), (89.0, 1e13)] {
            let exact = LabelledNumber::exact;
            let cost = PhysicalCost::new(&exact(qubits), &exact(toffoli));
            let d = f64::from(cost.code_distance.expect("a distance"));
            let number = |figure: &LabelledNumber| figure.value().expect("a number");
            let factories = (number(&cost.physical_qubits) - 4.0 * qubits * (d + 1.0).powi(2))
                / (144.0 * d * d);
            assert!((factories - 4.0).abs() < 1e-9, "{factories}");
            let seconds = toffoli / factories * 5.5 * d * 1e-6;
            assert!((number(&cost.seconds) / seconds - 1.0).abs() < 1e-12);
        }
    }
}
