//! Counts of gates, counted again.

use super::*;
use crate::quantum::circuit::formats::qasm;

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
