//! The circuits of an export. Registers have long names: `p` and `s` are gates in OpenQASM.

use crate::quantum::circuit::gates::{Circuit, Gate, Qubit, RegisterRole};

/// `Φ`, the last bit of the register first: the Fourier transform with the positive sign, then
/// `(−1)^k`.
pub fn phi(c: &mut Circuit, warped: &[Qubit]) {
    c.fourier(warped);
    c.gates.extend(warped.first().map(|&q| Gate::Z(q)));
}

/// `Φ` on a register `warped` of `qubits` qubits.
pub fn transform(qubits: usize) -> Circuit {
    let mut circuit = Circuit::default();
    let warped = circuit.register("warped", qubits, RegisterRole::System);
    phi(&mut circuit, &warped);
    circuit
}

/// Prepares the product of two normalised real vectors from zeros: `profile` on a register
/// `warped`, `system` on a register of that name.
pub fn preparation(profile: &[f64], system: &[f64]) -> Circuit {
    let mut circuit = Circuit::default();
    let registers = [("warped", profile), ("system", system)].map(|(name, values)| {
        let qubits = values.len().trailing_zeros() as usize;
        (circuit.register(name, qubits, RegisterRole::System), values)
    });
    for (qubits, values) in &registers {
        circuit.prepare(qubits, values);
    }
    circuit
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::quantum::circuit::formats::qasm;
    use crate::quantum::circuit::simulate::SparseState;
    use num_complex::Complex64;

    /// The amplitudes of all states of `qubits` qubits after a circuit acts on basis state `start`.
    fn run(circuit: &Circuit, qubits: usize, start: usize) -> Vec<Complex64> {
        let mut state = vec![Complex64::ZERO; 1 << qubits];
        for (number, amplitude) in SparseState::basis(start as u128).after(&circuit.gates).terms {
            state[number as usize] = amplitude;
        }
        state
    }

    #[test]
    fn the_transform_is_phi() {
        for qubits in 1..6 {
            let n = 1usize << qubits;
            let circuit = transform(qubits);
            for l in 0..n {
                let found = run(&circuit, qubits, l);
                let mut modes = vec![Complex64::ZERO; n];
                modes[l] = Complex64::ONE;
                for (a, b) in found.iter().zip(super::super::transformed(&modes)) {
                    assert!((a - b).norm() < 1e-14, "{qubits} {l}: {a} {b}");
                }
            }
        }
    }

    /// A vector with signs, zeros, and a part that is all zero.
    fn vector(qubits: usize, phase: f64) -> Vec<f64> {
        let value = |i: usize| match i {
            i if i >= 1 << qubits >> 1 && i < 3 << qubits >> 2 => 0.0,
            i => (1.3 * i as f64 + phase).sin(),
        };
        (0..1 << qubits).map(value).collect()
    }

    #[test]
    fn prepared_states_are_the_vectors() {
        for (p, s) in [(1, 0), (2, 3), (5, 1), (3, 4)] {
            let (profile, system) = (vector(p, 0.4), vector(s, 2.0));
            let found = run(&preparation(&profile, &system), p + s, 0);
            let size = |values: &[f64]| values.iter().map(|x| x * x).sum::<f64>().sqrt();
            let sizes = size(&profile) * size(&system);
            for (i, a) in found.iter().enumerate() {
                let x = profile[i % (1 << p)] * system[i >> p] / sizes;
                assert!((a - x).norm() < 1e-14, "{p} {s} {i}: {a} {x}");
            }
        }
    }

    /// The text has the angles of the gates, bit by bit.
    #[test]
    fn angles_survive_the_text() {
        let circuit = preparation(&vector(4, 0.4), &vector(2, 2.0));
        let text = qasm(&circuit, None);
        let angle = |line: &str| line.strip_prefix("ry(")?.split(')').next()?.parse().ok();
        let found: Vec<f64> = text.lines().filter_map(angle).collect();
        let of_gate = |gate: &Gate| match gate {
            Gate::Ry(angle, _) => Some(*angle),
            _ => None,
        };
        let expected: Vec<f64> = circuit.gates.iter().filter_map(of_gate).collect();
        assert!(!expected.is_empty() && found == expected, "{found:?} {expected:?}");
    }
}
