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
    use num_complex::Complex64;

    /// Runs a program of these gates on all amplitudes of one register, from basis state `start`.
    fn run(text: &str, name: &str, qubits: usize, start: usize) -> Vec<Complex64> {
        let mut state = vec![Complex64::ZERO; 1 << qubits];
        state[start] = Complex64::ONE;
        for line in text.lines().filter(|l| l.contains(&format!(" {name}["))) {
            if line.starts_with("qubit") {
                continue;
            }
            let (gate, places) = line.split_once(' ').expect("a gate");
            let q: Vec<usize> = places
                .trim_end_matches(';')
                .split(", ")
                .map(|p| p[name.len() + 1..p.len() - 1].parse().expect("a number"))
                .collect();
            let angle: f64 =
                gate.split(['(', ')']).nth(1).map_or(0.0, |a| a.parse().expect("an angle"));
            let before = state.clone();
            for (j, after) in state.iter_mut().enumerate() {
                let bit = |k: usize| j >> q[k] & 1;
                let other = before[j ^ 1 << q[0]];
                *after = match gate.split('(').next() {
                    Some("h") => {
                        (other + before[j] * if bit(0) == 1 { -1.0 } else { 1.0 }) / 2f64.sqrt()
                    }
                    Some("ry") => {
                        let (sin, cos) = (0.5 * angle).sin_cos();
                        before[j] * cos + other * if bit(0) == 1 { sin } else { -sin }
                    }
                    Some("z") => before[j] * if bit(0) == 1 { -1.0 } else { 1.0 },
                    Some("cp") => {
                        before[j]
                            * if bit(0) * bit(1) == 1 {
                                Complex64::cis(angle)
                            } else {
                                Complex64::ONE
                            }
                    }
                    Some("cx") => {
                        if bit(0) == 1 {
                            before[j ^ 1 << q[1]]
                        } else {
                            before[j]
                        }
                    }
                    Some("swap") => {
                        if bit(0) == bit(1) {
                            before[j]
                        } else {
                            before[j ^ 1 << q[0] ^ 1 << q[1]]
                        }
                    }
                    gate => panic!("{gate:?}"),
                };
            }
        }
        state
    }

    #[test]
    fn the_transform_is_phi() {
        for qubits in 1..6 {
            let n = 1usize << qubits;
            let text = qasm(&transform(qubits), None);
            for l in 0..n {
                let found = run(&text, "warped", qubits, l);
                let mut modes = vec![Complex64::ZERO; n];
                modes[l] = Complex64::ONE;
                for (a, b) in found.iter().zip(super::super::transformed(&modes)) {
                    assert!((a - b).norm() < 1e-14, "{qubits} {l}: {a} {b}");
                }
            }
        }
    }

    #[test]
    fn prepared_states_are_the_vectors() {
        for (p, s) in [(1, 0), (2, 3), (5, 1), (3, 4)] {
            let vector = |qubits: usize, phase: f64| -> Vec<f64> {
                // Signs, zeros, and a part that is all zero.
                let value = |i: usize| match i {
                    i if i >= 1 << qubits >> 1 && i < 3 << qubits >> 2 => 0.0,
                    i => (1.3 * i as f64 + phase).sin(),
                };
                (0..1 << qubits).map(value).collect()
            };
            let vectors = [vector(p, 0.4), vector(s, 2.0)];
            let text = qasm(&preparation(&vectors[0], &vectors[1]), None);
            for (name, qubits, values) in [("warped", p, &vectors[0]), ("system", s, &vectors[1])] {
                if qubits == 0 {
                    continue;
                }
                let size = values.iter().map(|x| x * x).sum::<f64>().sqrt();
                let found = run(&text, name, qubits, 0);
                for (a, x) in found.iter().zip(values) {
                    assert!((a - x / size).norm() < 1e-14, "{name} {qubits}: {a} {}", x / size);
                }
            }
        }
    }
}
