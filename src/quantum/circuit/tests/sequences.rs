//! Sequences of calls beside exponentials.

use super::*;
use crate::propagate::bessel::bessel_series;
use crate::propagate::chebyshev::degree;
use crate::quantum::circuit::evolution::Walk;
use crate::quantum::circuit::wires::Wires;
use crate::quantum::phases::Phases;

/// `e^{−iHt}` of a basis state of one mode, by its Taylor series.
fn evolved(h: &HashMap<(usize, usize), Complex64>, state: usize) -> HashMap<usize, Complex64> {
    let mut term = HashMap::from([(state, Complex64::ONE)]);
    let mut sum = term.clone();
    for k in 1..80 {
        let mut next: HashMap<usize, Complex64> = HashMap::new();
        for ((i, j), value) in h {
            if let Some(x) = term.get(j) {
                *next.entry(*i).or_default() += value * x * -Complex64::I / f64::from(k);
            }
        }
        next.iter().for_each(|(&i, x)| *sum.entry(i).or_default() += x);
        term = next;
    }
    sum
}

/// The sequence of phased steps is the exponential, as near as its series.
#[test]
fn sequences_are_exponentials() {
    let halves = JumpGrid { cells: 3, periodic: true, speeds: 1, bin_bits: 1, jumps: &[(0, 0.5)] };
    let modes = CircuitModes::Rotated { qubits: 1, period: 3.0, highest: TAU / 3.0 };
    for (grid, modes) in [(&halves, modes), (&GRIDS[11], CircuitModes::One(0.0))] {
        let transport = grid.transport();
        let mut circuit = Circuit::default();
        let wires = Wires::new(&mut circuit, &transport, modes, true);
        let walk = Walk::new(&mut circuit, &wires, &transport, modes, Levels::Uniform);
        let tau = transport.alpha(modes, Levels::Uniform);
        let tail = 1e-7;
        let degree = degree(&mut Vec::new(), tau, tail);
        let phases = Phases::new(tau, degree).expect("a short sequence");
        walk.evolve(&mut circuit, &phases);
        circuit.finish();
        let wavenumbers = modes.wavenumbers();
        for (l, &mu) in wavenumbers.iter().enumerate() {
            let h = grid.hamiltonian(mu);
            for state in grid.states() {
                let mut expected = evolved(&h, state);
                let mut apart = 0.0f64;
                for (found, value) in block_column(&circuit, state * wavenumbers.len() + l) {
                    let place = found / wavenumbers.len();
                    // Where the control is 1, the series is not.
                    if found >> walk.control & 1 == 0 {
                        let other = expected.remove(&place).unwrap_or_default();
                        apart += (value - other).norm_sqr();
                    }
                }
                apart += expected.values().map(Complex64::norm_sqr).sum::<f64>();
                assert!(apart.sqrt() <= phases.bound + 1e-12, "{mu} {state}: {apart:e}");
            }
        }
        // Control: half the time is another state.
        let other = Phases::new(0.5 * tau, degree).expect("a short sequence");
        assert!((other.angles[degree] - phases.angles[degree]).abs() > 1e-3);
    }
}

/// The sequence of steps forward and back of `d = 1`, whose polynomials are known in full: with
/// `y` of [`Phases`](crate::quantum::phases), `P = y(cJ_0 + i√a)`, `Q = 2cJ_1 y`. Between a
/// controlled step before and one back behind, and Hadamard gates, it is `c Σ_{|k|≤1} J_k y^k`, by
/// as many gates as are counted.
#[test]
fn steps_forward_and_back_are_exponentials() {
    const TAU_OF_TEST: f64 = 0.4;
    let (grid, modes) = (&GRIDS[11], CircuitModes::One(0.7));
    let transport = grid.transport();
    let mut circuit = Circuit::default();
    let mut wires = Wires::new(&mut circuit, &transport, modes, true);
    let walk = Walk::new(&mut circuit, &wires, &transport, modes, Levels::Uniform);
    wires.control = None;
    transport.call(&mut circuit, &wires, modes, Levels::Uniform);
    let plain = std::mem::take(&mut circuit.gates);
    let mut bessel = Vec::new();
    bessel_series(&mut bessel, TAU_OF_TEST, 0.0);
    let rest = 2.0 * bessel[2..].iter().map(|j| j.abs()).sum::<f64>();
    let scale = 1.0 / (1.0 + rest);
    let [even, odd] = [scale * bessel[0], 2.0 * scale * bessel[1]];
    let left = 1.0 - even * even - odd * odd;
    assert!(left > 0.0, "no such sequence: {left}");
    let (control, turn) = (walk.control, -left.sqrt().atan2(even));
    circuit.push(Gate::H(control));
    circuit.gates.extend(&walk.call);
    walk.reflect(&mut circuit);
    circuit.push(Gate::S(control));
    // Forward where the control is 0, back where it is 1; without a phase of i for both.
    walk.reflect(&mut circuit);
    circuit.gates.extend(&plain);
    let around = |c: &mut Circuit| c.push(Gate::X(control));
    circuit.within(around, |c| walk.reflect(c));
    circuit.push(Gate::Z(control));
    circuit.push(Gate::Rz(turn, control));
    circuit.push(Gate::Ry(2.0 * odd.atan2(even.hypot(left.sqrt())), control));
    circuit.push(Gate::Rz(turn, control));
    circuit.within(around, |c| {
        walk.reflect(c);
        c.gates.extend(&walk.call);
        c.push(Gate::Sdg(control));
    });
    circuit.push(Gate::H(control));
    circuit.finish();
    let [call, controlled] =
        [false, true].map(|c| transport.encode(modes, Levels::Uniform, c).counts());
    assert_eq!(toffolis(&circuit) as f64, call.toffoli_both_ways(&controlled, 1.0));
    assert_eq!(circuit.qubits(), controlled.qubits_of_sequence());
    let mut h = grid.hamiltonian(0.7);
    h.values_mut().for_each(|x| *x *= TAU_OF_TEST / transport.alpha(modes, Levels::Uniform));
    let mut largest = 0.0f64;
    for state in grid.states() {
        let mut expected = evolved(&h, state);
        let mut apart = 0.0f64;
        for (found, value) in block_column(&circuit, state) {
            if found >> control & 1 == 0 {
                let other = expected.remove(&found).unwrap_or_default();
                apart += (value * Complex64::I - other).norm_sqr();
            }
        }
        apart += expected.values().map(Complex64::norm_sqr).sum::<f64>();
        assert!(apart.sqrt() <= 2.0 * rest + 1e-12, "{state}: {apart:e} {rest:e}");
        largest = largest.max(apart.sqrt());
    }
    // The series is cut, and no better than that.
    assert!(largest > 0.1 * rest, "{largest:e} {rest:e}");
}
