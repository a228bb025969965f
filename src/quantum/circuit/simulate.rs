//! Circuits on basis states and their sums.

use crate::quantum::circuit::gates::{Circuit, Gate, RegisterRole};
use num_complex::Complex64;
use std::f64::consts::{FRAC_1_SQRT_2, FRAC_PI_4};

/// The largest number of qubits of a simulated circuit.
pub const MOST_QUBITS: usize = 128;
/// Amplitudes below this count as zero.
const ROUND_OFF: f64 = 1e-18;

/// A sum of basis states, each with its amplitude; a basis state is a number whose bits are the
/// qubits.
#[derive(Clone, Debug, PartialEq)]
pub struct SparseState {
    /// Different basis states, and their amplitudes.
    pub terms: Vec<(u128, Complex64)>,
}

impl SparseState {
    /// The basis state `number`.
    pub fn basis(number: u128) -> Self {
        Self { terms: vec![(number, Complex64::ONE)] }
    }

    /// The state after `gates` act on this one.
    pub fn after(mut self, gates: &[Gate]) -> Self {
        for &gate in gates {
            self.apply(gate);
        }
        self
    }

    fn apply(&mut self, gate: Gate) {
        let bit = |q: usize, state: u128| state >> q & 1;
        match gate {
            Gate::X(q) => self.terms.iter_mut().for_each(|(s, _)| *s ^= 1 << q),
            Gate::Cx(a, q) => self.terms.iter_mut().for_each(|(s, _)| *s ^= bit(a, *s) << q),
            Gate::Ccx(a, b, q) => {
                self.terms.iter_mut().for_each(|(s, _)| *s ^= (bit(a, *s) & bit(b, *s)) << q);
            }
            Gate::Z(q) => self.turn(|s| bit(q, s), -Complex64::ONE),
            Gate::Cz(a, b) => self.turn(|s| bit(a, s) & bit(b, s), -Complex64::ONE),
            Gate::Cp(angle, a, b) => {
                self.turn(|s| bit(a, s) & bit(b, s), Complex64::cis(angle));
            }
            Gate::Swap(a, b) => self.terms.iter_mut().for_each(|(s, _)| {
                let differ = bit(a, *s) ^ bit(b, *s);
                *s ^= differ << a | differ << b;
            }),
            Gate::S(q) => self.turn(|s| bit(q, s), Complex64::I),
            Gate::Sdg(q) => self.turn(|s| bit(q, s), -Complex64::I),
            Gate::T(q) => self.turn(|s| bit(q, s), Complex64::cis(FRAC_PI_4)),
            Gate::Tdg(q) => self.turn(|s| bit(q, s), Complex64::cis(-FRAC_PI_4)),
            Gate::Rz(angle, q) => {
                self.turn(|s| bit(q, s), Complex64::cis(0.5 * angle));
                self.turn(|s| 1 - bit(q, s), Complex64::cis(-0.5 * angle));
            }
            Gate::H(q) => {
                self.mix(q, [[FRAC_1_SQRT_2, FRAC_1_SQRT_2], [FRAC_1_SQRT_2, -FRAC_1_SQRT_2]])
            }
            Gate::Ry(angle, q) => {
                let (sin, cos) = (0.5 * angle).sin_cos();
                self.mix(q, [[cos, -sin], [sin, cos]]);
            }
        }
    }

    /// Multiplies the amplitudes of the states at which `on` is 1 by `phase`.
    fn turn(&mut self, on: impl Fn(u128) -> u128, phase: Complex64) {
        self.terms.iter_mut().filter(|(s, _)| on(*s) == 1).for_each(|(_, a)| *a *= phase);
    }

    /// Applies the real `matrix` to qubit `q`.
    fn mix(&mut self, q: usize, matrix: [[f64; 2]; 2]) {
        let one = 1u128 << q;
        self.terms.sort_unstable_by_key(|(s, _)| (s & !one, s & one));
        let mut mixed = Vec::with_capacity(2 * self.terms.len());
        for pair in self.terms.chunk_by(|a, b| a.0 & !one == b.0 & !one) {
            let state = pair[0].0 & !one;
            let mut before = [Complex64::ZERO; 2];
            pair.iter().for_each(|(s, a)| before[usize::from(s & one != 0)] = *a);
            for (row, state) in matrix.iter().zip([state, state | one]) {
                let after = row[0] * before[0] + row[1] * before[1];
                if after.norm_sqr() > ROUND_OFF * ROUND_OFF {
                    mixed.push((state, after));
                }
            }
        }
        self.terms = mixed;
    }
}

/// Column `number` of the block of `circuit`: amplitudes of the system's states.
pub fn block_column(circuit: &Circuit, number: usize) -> Vec<(usize, Complex64)> {
    let system = circuit.qubits_of(RegisterRole::System).len();
    let after = SparseState::basis(number as u128).after(&circuit.gates);
    let inside = after.terms.into_iter().filter(|(s, _)| s >> system == 0);
    inside.map(|(s, a)| (s as usize, a)).collect()
}
