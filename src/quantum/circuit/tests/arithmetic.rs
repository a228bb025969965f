//! Arithmetic and reflections on all numbers.

use super::*;
use crate::quantum::circuit::amplification::AmplifiedRegisters;

/// With any number of borrowed qubits, in any state, which stay as they are.
#[test]
fn flips_with_borrowed_qubits() {
    for controls in 0..=7usize {
        for borrowed in usize::from(controls > 2)..=5 {
            let bits = controls + borrowed + 1;
            let circuit = on_register(bits, |c, q| {
                c.flip_where_all(&q[..controls], q[controls], &q[controls + 1..]);
            });
            let all = (1u128 << controls) - 1;
            check_all(&circuit, bits, |s| s ^ u128::from(s & all == all) << controls);
            if controls > 2 && borrowed >= controls - 2 {
                assert_eq!(toffolis(&circuit), 4 * (controls - 2));
            }
        }
    }
}

#[test]
fn sums_and_comparisons_of_all_numbers() {
    for bits in 1..=6 {
        let size = 1u128 << bits;
        let split = |s: u128| (s % size, s / size % size, s / size / size);
        let join = |a: u128, b: u128, c: u128| a + size * (b + size * c);
        for controlled in [false, true] {
            let control = |q: &[usize]| controlled.then_some(q[2 * bits]);
            let counts = |c: u128| !controlled || c % 2 == 1;
            let add = on_register(2 * bits + 1, |c, q| {
                c.add(&q[..bits], &q[bits..2 * bits], control(q));
            });
            check_all(&add, 2 * bits + 1, |s| {
                let (a, b, c) = split(s);
                join(a, (b + if counts(c) { a } else { 0 }) % size, c)
            });
            assert_eq!(toffolis(&add), 2 * (bits - 1) + if controlled { bits + 1 } else { 0 });
            let less = on_register(2 * bits + 2, |c, q| {
                c.less(&q[bits..2 * bits], &q[..bits], control(q), q[2 * bits + 1]);
            });
            check_all(&less, 2 * bits + 2, |s| {
                let (a, b, c) = split(s);
                join(a, b, c ^ if counts(c) && b < a { 2 } else { 0 })
            });
            assert_eq!(toffolis(&less), 2 * bits + usize::from(controlled));
            // One bit more in the sum.
            let longer = on_register(2 * bits + 2, |c, q| {
                c.add(&q[..bits], &q[bits..2 * bits + 1], controlled.then_some(q[2 * bits + 1]));
            });
            check_all(&longer, 2 * bits + 2, |s| {
                let (a, b, c) = (s % size, s / size % (2 * size), s / size / size / 2);
                a + size * ((b + if counts(c) { a } else { 0 }) % (2 * size) + 2 * size * c)
            });
        }
        let add_bit = on_register(bits + 1, |c, q| c.add_bit(q[bits], &q[..bits]));
        check_all(&add_bit, bits + 1, |s| (s % size + s / size) % size + s / size * size);
        assert_eq!(toffolis(&add_bit), 2 * (bits - 1));
    }
}

/// Up to 20 bits of `e`.
#[test]
fn square_roots_of_all_numbers() {
    for n in 0..=10usize {
        let circuit = on_register(2 * n + 1, |c, q| c.square_root(q));
        assert_eq!(toffolis(&circuit), if n == 0 { 0 } else { n * n + 6 * n + 2 });
        for (e, end) in (0u128..).zip(images(&circuit.gates, 0..1 << (2 * n))) {
            let j = e.isqrt();
            assert_eq!(end, (e - j * j) | ((1 << n) - 1 - j) << (n + 1), "of {e}");
        }
    }
    // Its inverse sets the highest bit where there is no such level, and only there.
    let n = 5;
    let inverse = on_register(2 * n + 1, |c, q| c.inverse_of(|c| c.square_root(q)));
    for j in 0..1u128 << n {
        for m in 0..2u128 << n {
            let start = m | ((1 << n) - 1 - j) << (n + 1);
            let end = SparseState::basis(start).after(&inverse.gates).terms[0].0;
            assert_eq!(end >> (2 * n), u128::from(m > 2 * j), "{j} {m}");
        }
    }
}

#[test]
fn uniform_sums_of_any_number() {
    for bits in 1..=6 {
        for count in 1..=1usize << bits {
            let circuit = on_register(bits, |c, q| c.uniform(q, count));
            let mut state = SparseState::basis(0).after(&circuit.gates);
            state.terms.retain(|term| term.1.norm() > 1e-15);
            state.terms.sort_by_key(|term| term.0);
            assert_eq!(state.terms.len(), count);
            for (m, (number, amplitude)) in state.terms.iter().enumerate() {
                assert_eq!(*number, m as u128);
                assert!((amplitude - 1.0 / (count as f64).sqrt()).norm() < 1e-14);
            }
            let rotations = circuit.counts().rotations;
            assert_eq!(rotations == 0, count.is_power_of_two());
            // Toffoli gates and T gates are those of controlled Hadamard gates.
            assert!(circuit.counts().t <= 2 * bits && rotations < 2 * bits);
        }
    }
}

/// A round's reflections change the signs that they should, of all basis states, in as many Toffoli
/// gates as their parts have by hand.
#[test]
fn reflections_of_amplification() {
    let (warped, system, block) = (3usize, 2usize, 2usize);
    for window in [[0, 1], [2, 7], [4, 8]] {
        let circuit = AmplifiedRegisters { warped, system, block }.round(window);
        let bits = warped + system + block + 1;
        let mut signs = [0, 0];
        for start in 0..1u128 << bits {
            let end = SparseState::basis(start).after(&circuit.gates);
            let p = start as usize % (1 << warped);
            let wanted = (window[0]..window[1]).contains(&p) && start >> (warped + system) == 0;
            let sign = if wanted != (start == 0) { -1.0 } else { 1.0 };
            assert_eq!(end.terms, [(start, Complex64::from(sign))], "{start:b} {window:?}");
            signs[usize::from(sign < 0.0)] += 1;
        }
        assert!(signs[1] > 0 && signs[0] > signs[1], "{signs:?}");
        // Two comparisons of n + 1 bits there and back; conjunctions of both flags and the zeros of
        // the block, and of all zeros.
        let comparisons = 4 * 2 * (warped + 1);
        let conjunctions = 2 * (block + 2) + 2 * (bits - 1);
        assert_eq!(toffolis(&circuit), comparisons + conjunctions);
        assert_eq!(circuit.counts().rotations + circuit.counts().t, 0);
    }
    // Without p there is nothing to compare.
    let circuit = AmplifiedRegisters { warped: 0, system, block }.round([0, 1]);
    assert_eq!(toffolis(&circuit), 2 * block + 2 * (system + block));
}
