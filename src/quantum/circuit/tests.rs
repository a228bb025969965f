//! Reversible parts on all basis states, blocks against the scheme's own rows, counts.

use crate::problem::case::Interface;
use crate::problem::grid::Axis;
use crate::propagate::bessel::bessel_series;
use crate::propagate::chebyshev::degree;
use crate::quantum::circuit::evolution::Walk;
use crate::quantum::circuit::formats::qasm;
use crate::quantum::circuit::gates::{Circuit, Gate, RegisterRole};
use crate::quantum::circuit::simulate::{SparseState, block_column};
use crate::quantum::circuit::transport::{
    AxisTransport, CaseTransport, CircuitModes, Levels, PotentialJump,
};
use crate::quantum::circuit::wires::Wires;
use crate::quantum::phases::Phases;
use crate::scheme::interface::{Side, sources, velocity};
use num_complex::Complex64;
use std::collections::HashMap;
use std::f64::consts::TAU;

/// A circuit on a register of `bits` qubits.
fn on_register(bits: usize, part: impl FnOnce(&mut Circuit, &[usize])) -> Circuit {
    let mut circuit = Circuit::default();
    let qubits = circuit.register("all", bits, RegisterRole::System);
    part(&mut circuit, &qubits);
    circuit.finish();
    circuit
}

/// The images of the basis states `starts` under reversible `gates`. They are the terms of one
/// state, so that each gate is read once for all of them.
fn images(gates: &[Gate], starts: impl IntoIterator<Item = u128>) -> Vec<u128> {
    let terms = starts.into_iter().map(|start| (start, Complex64::ONE)).collect();
    let ends = SparseState { terms }.after(gates).terms;
    assert!(ends.iter().all(|(_, amplitude)| *amplitude == Complex64::ONE), "a phase");
    ends.into_iter().map(|(end, _)| end).collect()
}

/// Checks the image of every value of the register under a reversible circuit. Scratch must be
/// clean.
fn check_all(circuit: &Circuit, bits: usize, expected: impl Fn(u128) -> u128) {
    for (start, end) in (0..).zip(images(&circuit.gates, 0..1 << bits)) {
        assert_eq!(end, expected(start), "of {start:b}");
    }
}

fn toffolis(circuit: &Circuit) -> usize {
    circuit.counts().toffoli
}

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

/// A grid, its jumps of `V` by face, and how finely levels are divided.
struct JumpGrid {
    cells: usize,
    periodic: bool,
    speeds: usize,
    bin_bits: usize,
    /// Cell below the face, jump in levels.
    jumps: &'static [(usize, f64)],
}

const WIDTH: f64 = 0.25;
const DX: f64 = 0.5;

impl JumpGrid {
    fn transport(&self) -> CaseTransport {
        let bins = (1 << self.bin_bits) as f64;
        let jumps = self.jumps.iter();
        let whole = |height: f64| (height * bins) as i64;
        let jumps = jumps.map(|&(below, height)| {
            let part = Vec::new();
            PotentialJump { below, levels: whole(height), part }
        });
        let axis = AxisTransport {
            cells: self.cells,
            periodic: self.periodic,
            speeds: self.speeds,
            jumps: jumps.collect(),
            rate: 0.5 * WIDTH / DX,
        };
        CaseTransport { axes: vec![axis], forces: Vec::new(), bin_bits: self.bin_bits }
    }

    /// `A` by the program's conservative law, at states of the circuit.
    fn matrix(&self) -> HashMap<(usize, usize), f64> {
        let (transport, speeds) = (self.transport(), self.speeds as f64);
        let axis = Axis::new(-speeds * WIDTH, speeds * WIDTH, 2 * self.speeds);
        let mut a = HashMap::new();
        let mut out = Vec::new();
        for x in 0..self.cells {
            for j in 0..axis.cells {
                let v = velocity(&axis, j as i64);
                let row = transport.state(&[x, j]);
                *a.entry((row, row)).or_insert(0.0) -= v.abs() / DX;
                let step = if v > 0.0 { -1 } else { 1 };
                let cells = self.cells as i64;
                let other = x as i64 + step;
                let behind = if self.periodic { other.rem_euclid(cells) } else { other };
                let face = if v > 0.0 { behind } else { x as i64 };
                let jump = self.jumps.iter().find(|jump| jump.0 as i64 == face);
                let rise = jump.map_or(0.0, |jump| 0.5 * WIDTH * WIDTH * jump.1);
                let rise = if v > 0.0 { rise } else { -rise };
                sources(&mut out, &axis, Interface::Conservative, j as i64, rise);
                for source in &out {
                    let from = if source.side == Side::Same { x as i64 } else { behind };
                    let inside = (0..axis.cells as i64).contains(&source.velocity);
                    if inside && (0..cells).contains(&from) {
                        let column = transport.state(&[from as usize, source.velocity as usize]);
                        *a.entry((row, column)).or_insert(0.0) += v.abs() / DX * source.weight;
                    }
                }
            }
        }
        a
    }

    /// `H` of one wavenumber, from `A`.
    fn hamiltonian(&self, mu: f64) -> HashMap<(usize, usize), Complex64> {
        let mut h = HashMap::new();
        for ((i, j), a) in self.matrix() {
            // μS + iK with S, K = (A ± Aᵀ)/2.
            *h.entry((i, j)).or_insert(Complex64::ZERO) += 0.5 * a * Complex64::new(mu, 1.0);
            *h.entry((j, i)).or_insert(Complex64::ZERO) += 0.5 * a * Complex64::new(mu, -1.0);
        }
        h
    }

    /// The states of the circuit that are cells.
    fn states(&self) -> Vec<usize> {
        let transport = self.transport();
        let of = |x| (0..2 * self.speeds).map(move |v| (x, v));
        (0..self.cells).flat_map(of).map(|(x, v)| transport.state(&[x, v])).collect()
    }
}

const GRIDS: &[JumpGrid] = &[
    JumpGrid { cells: 4, periodic: false, speeds: 4, bin_bits: 0, jumps: &[] },
    JumpGrid { cells: 4, periodic: false, speeds: 4, bin_bits: 0, jumps: &[(1, 5.0)] },
    JumpGrid { cells: 5, periodic: false, speeds: 3, bin_bits: 0, jumps: &[(1, 3.0), (3, -2.0)] },
    JumpGrid { cells: 3, periodic: true, speeds: 3, bin_bits: 0, jumps: &[(0, -4.0), (2, 4.0)] },
    JumpGrid { cells: 4, periodic: true, speeds: 4, bin_bits: 0, jumps: &[(0, 1.0), (3, -1.0)] },
    JumpGrid { cells: 6, periodic: true, speeds: 2, bin_bits: 0, jumps: &[] },
    // Walls higher than any energy, up and down; in halves and quarters of levels.
    JumpGrid { cells: 3, periodic: false, speeds: 4, bin_bits: 0, jumps: &[(0, 16.0), (1, -16.0)] },
    JumpGrid { cells: 3, periodic: false, speeds: 5, bin_bits: 0, jumps: &[(0, -25.0), (1, 25.0)] },
    JumpGrid { cells: 3, periodic: false, speeds: 3, bin_bits: 2, jumps: &[(0, 1.25), (1, -2.5)] },
    JumpGrid { cells: 2, periodic: false, speeds: 4, bin_bits: 1, jumps: &[(0, 0.5)] },
    // The smallest.
    JumpGrid { cells: 1, periodic: false, speeds: 3, bin_bits: 0, jumps: &[] },
    JumpGrid { cells: 2, periodic: true, speeds: 1, bin_bits: 0, jumps: &[(0, 1.0), (1, -1.0)] },
    JumpGrid { cells: 2, periodic: false, speeds: 1, bin_bits: 3, jumps: &[(0, 0.125)] },
];

/// Compares all columns of the block with `H/α`; the number of columns.
fn check_block(grid: &JumpGrid, modes: CircuitModes, levels: Levels) -> usize {
    let transport = grid.transport();
    let alpha = transport.alpha(modes, levels);
    let circuit = transport.encode(modes, levels, false);
    let wavenumbers = match modes {
        CircuitModes::One(mu) => vec![mu],
        CircuitModes::Register { qubits, period }
        | CircuitModes::Rotated { qubits, period, .. } => {
            let points = 1i32 << qubits;
            (0..points).map(|l| TAU * f64::from(l - points / 2) / period).collect()
        }
    };
    let points = wavenumbers.len();
    let states = grid.states();
    for (l, mu) in wavenumbers.into_iter().enumerate().filter(|(l, _)| modes.carries(*l)) {
        let h = grid.hamiltonian(mu);
        for &column in &states {
            let mut left = h.clone();
            left.retain(|place, _| place.1 == column);
            for (row, value) in block_column(&circuit, column * points + l) {
                assert_eq!(row % points, l);
                let entry = left.remove(&(row / points, column)).unwrap_or_default();
                let apart = (alpha * value - entry).norm();
                assert!(apart < 1e-12, "{modes:?} {row} {column}: {value} {entry}");
            }
            assert!(left.values().all(|entry| entry.norm() < 1e-12), "{left:?}");
        }
    }
    states.len() * points
}

#[test]
fn blocks_are_the_hamiltonian_of_the_scheme() {
    let register = CircuitModes::Register { qubits: 2, period: 7.3 };
    for grid in GRIDS {
        let highest = TAU / 7.3;
        let rotated = CircuitModes::Rotated { qubits: 2, period: 7.3, highest };
        let all = CircuitModes::Rotated { qubits: 2, period: 7.3, highest: 2.0 * highest };
        for modes in [
            register,
            rotated,
            all,
            CircuitModes::One(3.7),
            CircuitModes::One(-0.4),
            CircuitModes::One(0.0),
        ] {
            for levels in [Levels::Hadamard, Levels::Uniform] {
                check_block(grid, modes, levels);
            }
        }
    }
}

/// The qubits of a register; none if the circuit has no such register.
fn qubits_of(circuit: &Circuit, name: &str) -> Vec<usize> {
    let found = circuit.registers.iter().find(|register| register.name == name);
    found.map_or(Vec::new(), |r| (r.first..r.first + r.size).collect())
}

/// `value` in these qubits.
fn set(qubits: &[usize], value: u128) -> u128 {
    assert!(value >> qubits.len() == 0, "{value} in {} bits", qubits.len());
    qubits.iter().enumerate().map(|(bit, &q)| (value >> bit & 1) << q).sum()
}

/// Grids of states of up to 20 bits.
const LARGE_GRIDS: [JumpGrid; 2] = [
    JumpGrid {
        cells: 64,
        periodic: true,
        speeds: 64,
        bin_bits: 1,
        jumps: &[(7, 900.5), (63, -8.0), (8, -0.5)],
    },
    JumpGrid {
        cells: 25,
        periodic: false,
        speeds: 100,
        bin_bits: 0,
        jumps: &[(3, 77.0), (4, -9000.0), (20, 10000.0)],
    },
];

/// Between preparations, every state moves as a classical particle.
#[test]
fn particles_move_one_to_one() {
    for grid in GRIDS.iter().chain(&LARGE_GRIDS) {
        let transport = grid.transport();
        let circuit = transport.encode(CircuitModes::One(1.0), Levels::Hadamard, false);
        let place = |what: &str| {
            let found = circuit.comments.iter().find(|comment| comment.1.starts_with(what));
            found.unwrap_or_else(|| panic!("{what}")).0
        };
        // Without the gate that reverses time.
        let moves = &circuit.gates[place("to the face")..place("energy to speed") - 1];
        let [space, velocity, level, bins, above, end, outside, moved] =
            ["space", "velocity", "level", "bins", "above", "boundary", "outside", "moved"]
                .map(|name| qubits_of(&circuit, name));
        let low = velocity.len() - 1;
        let levels = [&bins[..], &[&level[..], &velocity[..low]].concat()[..2 * low]].concat();
        let bin = 1i64 << grid.bin_bits;
        let most = (grid.speeds * grid.speeds) as i64 * bin;
        let cells = grid.cells as i64;
        assert!(space.len() + 1 + levels.len() <= 20);
        let state = |x: i64, up: bool, e: i64| {
            set(&space, x as u128)
                | set(&velocity[low..], u128::from(up))
                | set(&levels, e as u128)
                | set(&moved, 1)
        };
        let particles: Vec<(i64, bool, i64)> = (0..cells)
            .flat_map(|x| [false, true].map(|up| (x, up)))
            .flat_map(|(x, up)| (0..most).map(move |e| (x, up, e)))
            .collect();
        let starts = || particles.iter().map(|&(x, up, e)| state(x, up, e));
        for (&(x, up, e), after) in particles.iter().zip(images(moves, starts())) {
            // The face ahead, and where it leads.
            let to = if up { x + 1 } else { x - 1 };
            let to = if grid.periodic { to.rem_euclid(cells) } else { to };
            let face = if up { x } else { to };
            let jump = transport.axes[0].jumps.iter().find(|jump| jump.below as i64 == face);
            let rise = jump.map_or(0, |jump| if up { jump.levels } else { -jump.levels });
            let leaves = !grid.periodic && !(0..cells).contains(&to);
            let flag = |qubits: &[usize]| qubits.iter().any(|&q| after >> q & 1 == 1);
            if leaves {
                assert!(flag(&end), "{x} {up} {e}: not at the end");
            } else if e < rise {
                assert_eq!(after, state(x, !up, e), "{x} {up} {e}: not reflected");
            } else if e - rise >= most {
                assert!(flag(&above) || flag(&outside), "{x} {up} {e}: not too fast");
            } else {
                assert_eq!(after, state(to, up, e - rise), "{x} {up} {e}");
            }
        }
        // An operator that is not selected has no effect.
        let resting = || starts().map(|start| start ^ set(&moved, 1));
        assert!(images(moves, resting()).into_iter().eq(resting()));
    }
}

/// Applied twice it is the identity on its initial states; under control it is applied zero times
/// or once.
#[test]
fn circuits_are_their_own_inverses() {
    for grid in GRIDS {
        let rotated = CircuitModes::Rotated { qubits: 1, period: 2.0, highest: 3.2 };
        for modes in
            [CircuitModes::One(0.8), CircuitModes::Register { qubits: 1, period: 2.0 }, rotated]
        {
            let encode = |controlled| grid.transport().encode(modes, Levels::Uniform, controlled);
            let (circuit, controlled) = (encode(false), encode(true));
            let points = if matches!(modes, CircuitModes::One(_)) { 1 } else { 2 };
            let on = qubits_of(&controlled, "control")[0];
            for state in grid.states().iter().flat_map(|s| (0..points).map(move |l| s * points + l))
            {
                let near = |found: SparseState, expected: u128| {
                    let amplitude = found.terms.iter().find(|term| term.0 == expected);
                    let apart = amplitude.map_or(1.0, |term| (term.1 - 1.0).norm());
                    assert!(apart < 1e-12, "{state}: {apart}");
                };
                let start = state as u128;
                let once = SparseState::basis(start).after(&circuit.gates);
                near(once.after(&circuit.gates), start);
                near(SparseState::basis(start).after(&controlled.gates), start);
                let with = start | 1 << on;
                let block = block_column(&controlled, with as usize);
                let own = block_column(&circuit, state);
                assert_eq!(block.len(), own.len());
                for (number, value) in block {
                    let own = own.iter().find(|term| term.0 | 1 << on == number);
                    assert!((own.expect("the same rows").1 - value).norm() < 1e-13);
                }
            }
        }
    }
}

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

/// A system of 12 qubits: 16 modes, 16 velocities, 16 cells; all of its 4096 columns.
#[test]
fn a_block_on_twelve_qubits() {
    let jumps: &[_] = &[(3, 9.0), (7, -25.0), (15, 16.0)];
    let grid = JumpGrid { cells: 16, periodic: true, speeds: 8, bin_bits: 0, jumps };
    let modes = CircuitModes::Register { qubits: 4, period: 5.5 };
    assert_eq!(check_block(&grid, modes, Levels::Hadamard), 4096);
}

/// Without jumps on a long box, α of the fewest levels is the norm of `H`, nearly.
#[test]
fn alpha_is_the_norm() {
    let grid = JumpGrid { cells: 64, periodic: false, speeds: 2, bin_bits: 0, jumps: &[] };
    let mu = 2.5;
    let h = grid.hamiltonian(mu);
    let (mut x, mut norm) = (HashMap::new(), 0.0);
    // Long waves of the fastest particles are the extreme ones, with the sign of T's phase.
    let phase = Complex64::new(mu, 1.0).arg();
    for cell in 0..64usize {
        let place = grid.transport().state(&[cell, 3]);
        x.insert(place, Complex64::cis((std::f64::consts::PI + phase) * cell as f64));
    }
    for _ in 0..400 {
        let mut y: HashMap<usize, Complex64> = HashMap::new();
        for ((i, j), value) in &h {
            *y.entry(*i).or_default() += value * x.get(j).copied().unwrap_or_default();
        }
        norm = y.values().map(Complex64::norm_sqr).sum::<f64>().sqrt();
        x = y.into_iter().map(|(i, y)| (i, y / norm)).collect();
    }
    let least = grid.transport().alpha(CircuitModes::One(mu), Levels::Uniform);
    assert!(norm < least * (1.0 + 1e-12) && norm > 0.995 * least, "{norm} {least}");
    // That of Hadamard gates is larger by one level of the fastest cell.
    let hadamard = grid.transport().alpha(CircuitModes::One(mu), Levels::Hadamard);
    assert!((hadamard / least - 4.0 / 3.0).abs() < 1e-14);
}

/// The counts equal those of the program's text, counted again.
#[test]
fn counts_are_those_of_the_text() {
    for grid in GRIDS {
        for controlled in [false, true] {
            let modes = CircuitModes::Register { qubits: 3, period: 4.0 };
            let circuit = grid.transport().encode(modes, Levels::Uniform, controlled);
            let text = qasm(&circuit, Some("a\ntitle"));
            let tally = |names: &[&str]| {
                let named = |line: &&str| {
                    let name = line.split([' ', '(']).next().unwrap_or_default();
                    names.contains(&name)
                };
                text.lines().filter(named).count()
            };
            let size = |line: &str| line["qubit[".len()..].split(']').next()?.parse::<usize>().ok();
            let declared = text.lines().filter(|line| line.starts_with("qubit["));
            let qubits: Option<usize> = declared.map(size).sum();
            let counts = circuit.counts();
            assert_eq!(Some(counts.qubits), qubits);
            let parts = [counts.system_qubits, counts.block_qubits, counts.scratch_qubits];
            assert_eq!(parts.iter().sum::<usize>(), counts.qubits);
            assert_eq!(counts.toffoli, tally(&["ccx"]));
            assert_eq!(counts.t, tally(&["t", "tdg"]));
            assert_eq!(counts.t_with_toffoli, counts.t + 7 * counts.toffoli);
            assert_eq!(counts.rotations, tally(&["ry", "rz"]));
            assert_eq!(counts.cnot, tally(&["cx", "cz"]));
            assert_eq!(counts.hadamard, tally(&["h"]));
            let all = ["x", "h", "z", "s", "sdg", "t", "tdg", "ry", "rz", "cx", "cz", "ccx"];
            assert_eq!(counts.gates, tally(&all));
            assert_eq!(counts.gates, text.lines().filter(|line| line.ends_with("];")).count());
            assert!(counts.toffoli_depth <= counts.toffoli && counts.depth <= counts.gates);
        }
    }
}

/// Toffoli gates by hand: with n bits of a speed, n_x of space, w = 2n + 1, one jump, open ends.
#[test]
fn counts_are_those_by_hand() {
    let grid = JumpGrid { cells: 32, periodic: false, speeds: 16, bin_bits: 0, jumps: &[(7, 5.0)] };
    let (n, space, modes) = (4, 5, 3);
    let w = 2 * n + 1;
    let circuit = grid.transport().encode(
        CircuitModes::Register { qubits: modes, period: 4.0 },
        Levels::Hadamard,
        false,
    );
    let roots = 2 * (n * n + 6 * n + 2);
    // Each with the conjunction of sign and `moved`.
    let steps = 2 * (2 * (space - 1) + 2);
    // At the end, and at the jump before and after; each there and back.
    let faces = 2 * space + 2 * 2 * space;
    let jump = 2 * (2 * w + 1) + 2 * (w - 1) + w + 1;
    let weights = 2 * modes + 2;
    assert_eq!(toffolis(&circuit), roots + steps + faces + jump + weights);
}
