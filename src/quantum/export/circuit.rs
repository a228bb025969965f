//! Circuits in OpenQASM 3. Registers have long names: `p` and `s` are gates there.

use std::f64::consts::PI;
use std::fmt::Write;

/// The beginning of a program.
const HEAD: &str = "OPENQASM 3.0;\ninclude \"stdgates.inc\";\n";

/// `Φ` on a register `warped` of `qubits` qubits, the last bit first: the Fourier transform with
/// the positive sign, then `(−1)^k`.
pub fn transform(qubits: usize) -> String {
    let mut text = HEAD.to_owned();
    if qubits == 0 {
        return text;
    }
    let _ = writeln!(text, "qubit[{qubits}] warped;");
    for target in (0..qubits).rev() {
        let _ = writeln!(text, "h warped[{target}];");
        for control in (0..target).rev() {
            let angle = PI / (1u64 << (target - control)) as f64;
            let _ = writeln!(text, "cp({angle:?}) warped[{control}], warped[{target}];");
        }
    }
    for low in 0..qubits / 2 {
        let _ = writeln!(text, "swap warped[{low}], warped[{}];", qubits - 1 - low);
    }
    text + "z warped[0];\n"
}

/// Prepares the product of two normalised real vectors from zeros: `profile` on a register
/// `warped`, `system` on a register of that name.
pub fn preparation(profile: &[f64], system: &[f64]) -> String {
    let mut text = HEAD.to_owned();
    let registers = [("warped", profile), ("system", system)].map(|(name, values)| {
        let qubits = values.len().trailing_zeros() as usize;
        (name, values, qubits)
    });
    for (name, _, qubits) in registers.iter().filter(|r| r.2 > 0) {
        let _ = writeln!(text, "qubit[{qubits}] {name};");
    }
    for (name, values, qubits) in registers {
        for level in 0..qubits {
            rotate(&mut text, name, qubits - 1 - level, &angles(values, level));
        }
    }
    text
}

/// Angles of the rotations of bit `level`, counted from the first. Each value of the bits before it
/// selects a part of the vector, whose halves have the norms `a` and `b`: the angle is
/// `2 atan(b/a)`. For the last bit `a` and `b` are the numbers themselves, with their signs.
fn angles(values: &[f64], level: usize) -> Vec<f64> {
    let size = values.len() >> level;
    let halves = |part: &[f64]| {
        let (first, second) = part.split_at(size / 2);
        let norm = |x: &[f64]| match x {
            [one] => *one,
            _ => x.iter().map(|x| x * x).sum::<f64>().sqrt(),
        };
        2.0 * norm(second).atan2(norm(first))
    };
    values.chunks_exact(size).map(halves).collect()
}

/// Rotates qubit `target` about y by `angles[c]` where the qubits above it are `c`: as many
/// rotations by the Walsh transform of the angles, in the order of the Gray code, each followed by
/// a controlled not (Möttönen, Vartiainen, Bergholm and Salomaa 2004).
fn rotate(text: &mut String, name: &str, target: usize, angles: &[f64]) {
    let count = angles.len();
    let gray = |j: usize| j ^ j >> 1;
    for j in 0..count {
        let sign = |c: usize| {
            if (c & gray(j)).count_ones().is_multiple_of(2) { 1.0 } else { -1.0 }
        };
        let sum: f64 = angles.iter().enumerate().map(|(c, angle)| sign(c) * angle).sum();
        let _ = writeln!(text, "ry({:?}) {name}[{target}];", sum / count as f64);
        if count > 1 {
            // The bit that changes next; after the last the first bit, which closes the circle.
            let bit = (gray(j) ^ gray((j + 1) % count)).trailing_zeros() as usize;
            let _ = writeln!(text, "cx {name}[{}], {name}[{target}];", target + 1 + bit);
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
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
            let text = transform(qubits);
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
            let text = preparation(&vectors[0], &vectors[1]);
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
