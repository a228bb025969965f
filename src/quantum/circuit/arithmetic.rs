//! Reversible arithmetic: adders, comparators, square root; uniform superpositions.
//!
//! Numbers are lists of qubits, the lowest bit first. Scratch is clean before and after.

use crate::quantum::circuit::gates::{Circuit, Gate, Qubit};
use std::f64::consts::PI;

/// A qubit and the value that it is to have.
pub type Literal = (Qubit, bool);

/// The literals of the condition `number = value`.
pub fn equals(number: &[Qubit], value: usize) -> impl Iterator<Item = Literal> {
    number.iter().enumerate().map(move |(bit, &q)| (q, value >> bit & 1 == 1))
}

/// The qubits of `number` at which `value` has the bit 1.
pub fn ones(number: &[Qubit], value: usize) -> Vec<Qubit> {
    equals(number, value).filter(|bit| bit.1).map(|bit| bit.0).collect()
}

impl Circuit {
    /// Calls `body` with a qubit that is 1 where all `literals` hold. This takes `literals − 1`
    /// Toffoli gates before `body` and as many after it. `body` leaves the qubit and the literals
    /// as they are.
    pub fn where_all(&mut self, literals: &[Literal], body: impl FnOnce(&mut Self, Qubit)) {
        let zeros: Vec<Qubit> = literals.iter().filter(|l| !l.1).map(|l| l.0).collect();
        let chain = self.take(literals.len() - 1);
        let ladder = |c: &mut Self| {
            c.flip(&zeros);
            let mut all = literals[0].0;
            for (&next, literal) in chain.iter().zip(&literals[1..]) {
                c.push(Gate::Ccx(all, literal.0, next));
                all = next;
            }
            // A single literal is its own conjunction.
            if !chain.is_empty() {
                c.flip(&zeros);
            }
        };
        self.within(ladder, |c| body(c, chain.last().copied().unwrap_or(literals[0].0)));
        self.give_back(&chain);
    }

    /// Flips `target` where all `literals` hold; everywhere if there are none.
    pub fn flip_where(&mut self, literals: &[Literal], target: Qubit) {
        match literals.len() {
            0 => self.push(Gate::X(target)),
            _ => self.where_all(literals, |c, all| c.push(Gate::Cx(all, target))),
        }
    }

    /// Flips `target` where `from` is 1, and `control` too if there is one.
    fn flip_given(&mut self, control: Option<Qubit>, from: Qubit, target: Qubit) {
        self.push(match control {
            Some(control) => Gate::Ccx(control, from, target),
            None => Gate::Cx(from, target),
        });
    }

    /// `(carry, b, a) → (carry ⊕ a, a ⊕ b, the next carry)` (Cuccaro and others 2004).
    fn majority(&mut self, carry: Qubit, b: Qubit, a: Qubit) {
        self.push(Gate::Cx(a, b));
        self.push(Gate::Cx(a, carry));
        self.push(Gate::Ccx(carry, b, a));
    }

    /// Adds: `b += a` modulo `2^b.len()`, only where `control` is 1 if there is one. `b` has as
    /// many bits as `a`, or one more. With `n + 1` bits of `b` this takes `2n` Toffoli gates. A
    /// control adds one Toffoli gate for each bit of `a` and of the carries that is added: `n + 1`
    /// or `n + 2`.
    pub fn add(&mut self, a: &[Qubit], b: &[Qubit], control: Option<Qubit>) {
        debug_assert!(b.len() == a.len() || b.len() == a.len() + 1);
        let carry = self.take(1);
        let low = b.len() - 1;
        let before = |i: usize| if i == 0 { carry[0] } else { a[i - 1] };
        let sum = |c: &mut Self, from: Qubit, to: Qubit| c.flip_given(control, from, to);
        for i in 0..low {
            self.majority(before(i), b[i], a[i]);
        }
        sum(self, before(low), b[low]);
        if let Some(&top) = a.get(low) {
            sum(self, top, b[low]);
        }
        for i in (0..low).rev() {
            // Now `a ⊕ carry` is in place of the carry, `a ⊕ b` in that of `b`.
            self.push(Gate::Ccx(before(i), b[i], a[i]));
            if control.is_some() {
                sum(self, before(i), b[i]);
                self.push(Gate::Cx(a[i], before(i)));
                self.push(Gate::Cx(a[i], b[i]));
            } else {
                self.push(Gate::Cx(a[i], before(i)));
                sum(self, before(i), b[i]);
            }
        }
        self.give_back(&carry);
    }

    /// Compares: `target ^= [b < a]`, only where `control` is 1 if there is one. `a` and `b` have
    /// equal numbers of bits. This takes two Toffoli gates for each bit, and one more with a
    /// control.
    pub fn less(&mut self, b: &[Qubit], a: &[Qubit], control: Option<Qubit>, target: Qubit) {
        debug_assert!(a.len() == b.len() && !a.is_empty());
        let carry = self.take(1);
        // The carry of `(2ⁿ − 1 − b) + a`.
        let chain = |c: &mut Self| {
            c.flip(b);
            for i in 0..a.len() {
                c.majority(if i == 0 { carry[0] } else { a[i - 1] }, b[i], a[i]);
            }
        };
        let last = a[a.len() - 1];
        self.within(chain, |c| c.flip_given(control, last, target));
        self.give_back(&carry);
    }

    /// `number += bit` modulo `2^number.len()`: `2(number.len() − 1)` Toffoli gates.
    pub fn add_bit(&mut self, bit: Qubit, number: &[Qubit]) {
        if number.is_empty() {
            return;
        }
        let carries = self.take(number.len() - 1);
        let before = |i: usize| if i == 0 { bit } else { carries[i - 1] };
        for (i, &carry) in carries.iter().enumerate() {
            self.push(Gate::Ccx(before(i), number[i], carry));
        }
        for i in (0..number.len()).rev() {
            if let Some(&carry) = carries.get(i) {
                self.push(Gate::Ccx(before(i), number[i], carry));
            }
            self.push(Gate::Cx(before(i), number[i]));
        }
        self.give_back(&carries);
    }

    /// Square root in place, of `2n` bits and a highest one that is 0: `e = j² + m`, `0 ≤ m ≤ 2j`,
    /// becomes `m` in the first `n + 1` bits and `2ⁿ − 1 − j` in the `n` above.
    ///
    /// Digit by digit without restoring. Step `k` has the root `Q` of `k − 1` bits so far, and a
    /// remainder `R`, maybe negative. It takes two more bits of `e`, so that `R` becomes
    /// `4R + pair − (4Q + 1)` where it was not negative, else `4R + pair + (4Q + 3)`; the next bit
    /// of the root is `[R ≥ 0]`. `R` fits into `k + 2` bits, so that its old sign, just above them,
    /// stays: the signs are the complement of the root. At last a negative `R` takes back `2Q + 1`.
    /// `n² + 6n + 2` Toffoli gates for `n ≥ 1`.
    pub fn square_root(&mut self, e: &[Qubit]) {
        let n = e.len() / 2;
        if n == 0 {
            return;
        }
        let constants = self.take(2);
        let [one, other] = [constants[0], constants[1]];
        self.push(Gate::X(one));
        for k in 1..=n {
            let window = &e[2 * (n - k)..2 * (n - k) + k + 2];
            let root = &e[2 * n + 2 - k..];
            let operand = [&[one, other], root].concat();
            let around = |c: &mut Self| {
                // The second bit of the summand: whether `R` was negative.
                root.first().inspect(|&&sign| c.push(Gate::Cx(sign, other)));
                c.flip(root);
                match root.first() {
                    Some(&positive) => c.flip_if(positive, window),
                    None => c.flip(window),
                }
            };
            self.within(around, |c| c.add(&operand, window, None));
        }
        let (remainder, negative, above) = (&e[..n + 1], e[n + 1], &e[n + 2..]);
        let operand = [&[one, other], above].concat();
        let around = |c: &mut Self| c.flip(above);
        self.within(around, |c| c.add(&operand, remainder, Some(negative)));
        self.push(Gate::X(one));
        self.give_back(&constants);
    }

    /// Flips `target` where all `controls` are 1. The `borrowed` qubits may be in any state; beyond
    /// two controls at least one is needed. For `k` controls and `k − 2` borrowed qubits this takes
    /// `4(k − 2)` Toffoli gates; with fewer borrowed qubits the controls are halved (Barenco and
    /// others 1995).
    pub fn flip_where_all(&mut self, controls: &[Qubit], target: Qubit, borrowed: &[Qubit]) {
        match *controls {
            [] => return self.push(Gate::X(target)),
            [a] => return self.push(Gate::Cx(a, target)),
            [a, b] => return self.push(Gate::Ccx(a, b, target)),
            _ => {}
        }
        let rest = controls.len() - 2;
        if borrowed.len() >= rest {
            let end = [&borrowed[..rest], &[target]].concat();
            let step =
                |c: &mut Self, i: usize| c.push(Gate::Ccx(controls[i + 1], end[i - 1], end[i]));
            for last in [rest + 1, rest] {
                (1..last).rev().for_each(|i| step(self, i));
                self.push(Gate::Ccx(controls[0], controls[1], end[0]));
                (1..last).for_each(|i| step(self, i));
            }
            return;
        }
        let (first, second) = controls.split_at(controls.len().div_ceil(2));
        let (one, others) = (borrowed[0], &borrowed[1..]);
        let last = [second, &[one]].concat();
        for _ in 0..2 {
            self.flip_where_all(first, one, &[second, &[target], others].concat());
            self.flip_where_all(&last, target, &[first, others].concat());
        }
    }

    /// Rotates `target` by `angles[c]` where `controls` have the value `c`. This takes one rotation
    /// for each angle, by the Walsh transform of the angles, in the order of the Gray code. A
    /// controlled not follows each rotation (Möttönen, Vartiainen, Bergholm and Salomaa 2004).
    pub fn rotate(
        &mut self,
        rotation: fn(f64, Qubit) -> Gate,
        controls: &[Qubit],
        target: Qubit,
        angles: &[f64],
    ) {
        let count = angles.len();
        let gray = |j: usize| j ^ j >> 1;
        let mut sums = angles.to_vec();
        let mut half = 1;
        while half < count {
            for both in sums.chunks_exact_mut(2 * half) {
                let (a, b) = both.split_at_mut(half);
                a.iter_mut().zip(b).for_each(|(a, b)| (*a, *b) = (*a + *b, *a - *b));
            }
            half *= 2;
        }
        for j in 0..count {
            self.push(rotation(sums[gray(j)] / count as f64, target));
            if count > 1 {
                // The bit that changes next; after the last the first bit, which closes the circle.
                let bit = (gray(j) ^ gray((j + 1) % count)).trailing_zeros() as usize;
                self.push(Gate::Cx(controls[bit], target));
            }
        }
    }

    /// Prepares the normalised real vector `values` from zeros, by uniformly controlled rotations.
    pub fn prepare(&mut self, qubits: &[Qubit], values: &[f64]) {
        for bit in 0..qubits.len() {
            let (below, above) = qubits.split_at(qubits.len() - bit);
            self.rotate(Gate::Ry, above, below[below.len() - 1], &halves(values, bit));
        }
    }

    /// Appends the Fourier transform with the positive sign, of numbers whose first bit is the
    /// lowest.
    pub fn fourier(&mut self, qubits: &[Qubit]) {
        for (place, &target) in qubits.iter().enumerate().rev() {
            self.push(Gate::H(target));
            for (control, &q) in qubits[..place].iter().enumerate().rev() {
                self.push(Gate::Cp(PI / (1u64 << (place - control)) as f64, q, target));
            }
        }
        for (low, &q) in qubits[..qubits.len() / 2].iter().enumerate() {
            self.push(Gate::Swap(q, qubits[qubits.len() - 1 - low]));
        }
    }

    /// Appends a Hadamard gate of `target` that is controlled by `control`: two T gates.
    fn controlled_hadamard(&mut self, control: Qubit, target: Qubit) {
        let around = |c: &mut Self| {
            c.push(Gate::S(target));
            c.push(Gate::H(target));
            c.push(Gate::T(target));
        };
        self.within(around, |c| c.push(Gate::Cx(control, target)));
    }

    /// Appends `rotation(angle)` of `target`, `Ry` or `Rz`, controlled by `control`: two rotations.
    pub fn controlled(
        &mut self,
        rotation: fn(f64, Qubit) -> Gate,
        angle: f64,
        control: Qubit,
        target: Qubit,
    ) {
        for half in [0.5 * angle, -0.5 * angle] {
            self.push(rotation(half, target));
            self.push(Gate::Cx(control, target));
        }
    }

    /// Prepares `Σ_{m < count} |m⟩/√count` from zeros, `1 ≤ count ≤ 2^number.len()` (Shukla and
    /// Vedula 2024).
    ///
    /// With the bits `l_0 < l_1 < …` of `count`, the last `2^{l_0}` numbers have the bits `l_1, …`
    /// and are free below `l_0`. Of the others, whose bit `l_1` is 0, the last `2^{l_1}` have the
    /// bits `l_2, …` and are free below `l_1`; and so on. A power of two takes Hadamard gates only.
    pub fn uniform(&mut self, number: &[Qubit], count: usize) {
        debug_assert!(count >= 1 && count <= 1 << number.len());
        let bits: Vec<usize> = (0..usize::BITS as usize).filter(|l| count >> l & 1 == 1).collect();
        bits[1..].iter().for_each(|&l| self.push(Gate::X(number[l])));
        number[..bits[0]].iter().for_each(|&q| self.push(Gate::H(q)));
        let mut rest = count;
        for (k, pair) in bits.windows(2).enumerate() {
            let (size, q) = (1usize << pair[0], number[pair[1]]);
            // The bit stays 1 with probability `size/rest`.
            let angle = -angle_of(size as f64 / rest as f64);
            rest -= size;
            if k == 0 {
                self.push(Gate::Ry(angle, q));
            } else {
                let control = number[pair[0]];
                self.within(
                    |c| c.push(Gate::X(control)),
                    |c| c.controlled(Gate::Ry, angle, control, q),
                );
            }
            self.within(
                |c| c.push(Gate::X(q)),
                |c| number[pair[0]..pair[1]].iter().for_each(|&f| c.controlled_hadamard(q, f)),
            );
        }
    }
}

/// The angles of the rotations of bit `bit`, counted from the first. Each value of the bits before
/// it selects a part of the vector, whose halves have the norms `a` and `b`: the angle is
/// `2 atan(b/a)`. For the last bit `a` and `b` are the numbers themselves, with their signs.
fn halves(values: &[f64], bit: usize) -> Vec<f64> {
    let size = values.len() >> bit;
    let angle = |part: &[f64]| {
        let (first, second) = part.split_at(size / 2);
        let norm = |x: &[f64]| match x {
            [one] => *one,
            _ => x.iter().map(|x| x * x).sum::<f64>().sqrt(),
        };
        2.0 * norm(second).atan2(norm(first))
    };
    values.chunks_exact(size).map(angle).collect()
}

/// The angle of the `ry` that keeps the value of a qubit with this probability.
pub fn angle_of(probability: f64) -> f64 {
    2.0 * ((1.0 - probability) / probability).sqrt().atan()
}
