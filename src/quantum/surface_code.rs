//! Physical qubits of a computation in the surface code, under assumptions that are stated.
//!
//! A logical qubit of distance `d` has `2(d + 1)²` physical ones, and as many again lie between
//! them for lattice surgery. It fails in a cycle with probability `0.1 (p/p_th)^{(d+1)/2}`,
//! `p = 10⁻³`, `p_th = 10⁻²` (Fowler and Gidney 2018). Four factories of `144 d²` physical qubits
//! make a CCZ state in `5.5 d` cycles each (Gidney and Fowler 2019), one Toffoli gate after the
//! other. `d` is the least odd number with which all logical qubits together fail with probability
//! 0.01 or less.

use crate::quantum::labelled_number::LabelledNumber;

/// The assumptions, for a record.
const ASSUMED: &str = "surface code, physical errors 1e-3, threshold 1e-2, failure 0.01 in all, 4 \
                       factories of CCZ states, half of the rest for lattice surgery";
/// `p/p_th`.
const ERROR: f64 = 0.1;
/// Probability that the computation fails.
const FAILURE: f64 = 0.01;
const FACTORIES: f64 = 4.0;
/// The largest code distance that is considered.
const MOST_DISTANCE: u32 = 101;

/// The code's distance for so many logical qubits and Toffoli gates; none above 101.
fn distance(qubits: f64, toffoli: f64) -> Option<u32> {
    (3..=MOST_DISTANCE).step_by(2).find(|&d| {
        let cycles = toffoli * 5.5 * f64::from(d) / FACTORIES;
        2.0 * qubits * cycles * 0.1 * ERROR.powf(0.5 * f64::from(d + 1)) <= FAILURE
    })
}

/// Physical qubits for these numbers of logical qubits and Toffoli gates.
pub fn physical_qubits(qubits: &LabelledNumber, toffoli: &LabelledNumber) -> LabelledNumber {
    let (Some(n), Some(gates)) = (qubits.value(), toffoli.value()) else {
        return LabelledNumber::unavailable("the logical qubits or Toffoli gates are");
    };
    let Some(d) = distance(n, gates).map(f64::from) else {
        return LabelledNumber::unavailable("no distance up to 101 suffices");
    };
    let count = 2.0 * n * 2.0 * (d + 1.0).powi(2) + FACTORIES * 144.0 * d * d;
    LabelledNumber::model(count, &format!("distance {d}; {ASSUMED}"))
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
        let physical = physical_qubits(&LabelledNumber::exact(100.0), &LabelledNumber::exact(1e9));
        assert!(physical.value().is_some_and(|n| n > 1e5 && n < 1e7));
    }
}
