//! Circuits of `H`: reversible parts on all basis states, blocks against the scheme's own rows,
//! sequences, counts.

mod arithmetic;
mod blocks;
mod counts;
mod sequences;

use crate::problem::case::Interface;
use crate::problem::grid::Axis;
use crate::quantum::circuit::gates::{Circuit, Gate, RegisterRole};
use crate::quantum::circuit::simulate::{SparseState, block_column};
use crate::quantum::circuit::transport::{
    AxisTransport, CaseTransport, CircuitModes, Levels, PotentialJump,
};
use crate::scheme::interface::{SourceSide, sources, velocity};
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
                    let from = if source.side == SourceSide::Same { x as i64 } else { behind };
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
