//! The block encoding of `H` as gates: the conservative interface, jumps of `V`, forces.
//!
//! | module | what it holds |
//! |---|---|
//! | [`circuit_case`] | which cases have a circuit; from a case to whole numbers |
//! | [`transport`] | these whole numbers, forces, modes and levels |
//! | [`interface`] | the block encoding, with its mathematics |
//! | [`force`] | the terms of forces in it |
//! | `wires` | its registers, the weights of its sum |
//! | [`arithmetic`] | adders, comparators, square root, uniform superpositions |
//! | [`evolution`] | `e^{−iHT}` by calls of it |
//! | [`amplification`] | the reflections of amplitude amplification |
//! | [`gates`] | gates, registers, counts |
//! | [`simulate`] | circuits on basis states and their sums |
//! | [`description`] | what was compiled, and the counts of the evolution |
//! | [`formats`] | OpenQASM 3, Azure's `LogicalCounts`, QREF |
//!
//! **Evolution.** The circuit `G` is its own inverse on the states that it starts from, and
//! `⟨0|G|0⟩ = H/α`. So `e^{−iHT}` is a sequence of `2K` phased steps of the walk, with `τ = αT` in
//! the place of `d‖H‖_max T` (see [`walk`](crate::quantum::walk)). A step has one call, controlled
//! by the qubit of the sequence, a reflection about the zeros of the block's qubits, controlled as
//! well, and one rotation of that qubit, whose angles are those of [`Phases`].
//!
//! | file | what |
//! |---|---|
//! | `interface.qasm` | `G`, OpenQASM 3 |
//! | `circuit.json` | `α`, counts, registers, gates `[name, qubits, angle]`, phases |
//! | `azure.json`, `qref.json` | the counts of the evolution for other programs |

pub mod amplification;
pub mod arithmetic;
pub mod circuit_case;
pub mod description;
pub mod evolution;
pub mod force;
pub mod formats;
pub mod gates;
pub mod interface;
pub mod simulate;
#[cfg(test)]
mod tests;
pub mod transport;
pub(in crate::quantum) mod wires;

use crate::base::disk;
use crate::base::error::{Error, Result};
use crate::problem::case::Case;
use crate::quantum::access::{AccessBounds, Scratch, SparseAccess};
use crate::quantum::circuit::circuit_case::{Bins, CircuitCase};
use crate::quantum::circuit::description::{
    Check, CircuitDescription, EvolutionDescription, RotationSequence, SparseAccessCost,
};
use crate::quantum::circuit::gates::{Circuit, RegisterRole};
use crate::quantum::circuit::simulate::block_column;
use crate::quantum::circuit::transport::{CircuitModes, Levels, ModeWeights};
use crate::quantum::labelled_number::LabelledNumber;
use crate::quantum::phases::{NoPhases, Phases};
use crate::quantum::resources::ResourceCounts;
use crate::solve::prepared::Prepared;
use num_complex::Complex64;
use serde_json::json;
use std::collections::HashMap;
use std::f64::consts::TAU;
use std::path::Path;

/// Binary logarithm of the largest number of terms of a simulated state: `2^22` terms.
const MOST_TERMS: usize = 22;

/// The circuit that is compiled for a case.
#[derive(Clone, Copy, Debug, Default)]
pub struct CircuitChoice {
    /// Bits of the bins that divide a level; by default as few as make all jumps whole.
    pub bin_bits: Option<usize>,
    /// The register of the levels.
    pub levels: Levels,
    /// The way in which the modes have their wavenumbers.
    pub mode_weights: ModeWeights,
    /// The wavenumber of the only mode; `None` for a circuit of all modes.
    pub wavenumber: Option<f64>,
    /// Number of columns of the block that are simulated.
    pub columns: usize,
}

/// A circuit and its description.
pub struct CompiledCircuit {
    /// The circuit.
    pub circuit: Circuit,
    /// The description of the circuit.
    pub description: CircuitDescription,
    /// The rotations of the evolution, or why there are none.
    pub phases: std::result::Result<Phases, NoPhases>,
}

/// Names of all files but the description.
pub const NAMES: [&str; 4] = ["interface.qasm", "circuit.json", "azure.json", "qref.json"];

/// The modes of the circuit of `case`: one of the wavenumber of `choice`, the one mode of the
/// unitary scheme, or a register of all modes of `counts`.
fn circuit_modes(case: &Case, counts: &ResourceCounts, choice: &CircuitChoice) -> CircuitModes {
    match choice.wavenumber {
        Some(mu) => CircuitModes::One(mu),
        // The unitary scheme: H = iK.
        None if case.scheme.flux == 0.0 => CircuitModes::One(0.0),
        None => {
            let highest = counts.setup.highest_wavenumber;
            choice.mode_weights.of_register(counts.points, counts.period, highest)
        }
    }
}

/// The tolerance of the walk. The unitary scheme's one mode is the field, whatever the profile.
fn walk_tolerance(case: &Case, counts: &ResourceCounts) -> LabelledNumber {
    match case.scheme.flux {
        0.0 => LabelledNumber::exact(case.tolerance),
        _ => counts.walk_tolerance.clone(),
    }
}

/// The highest wavenumber of the modes of a circuit; `None` for those of a register.
fn highest_mode(modes: CircuitModes) -> Option<f64> {
    match modes {
        CircuitModes::One(mu) | CircuitModes::Rotated { highest: mu, .. } => Some(mu),
        CircuitModes::Register { .. } => None,
    }
}

impl CompiledCircuit {
    /// Compiles the circuit of a case whose whole grid is on this rank. `counts` has the cost of
    /// sparse access.
    ///
    /// # Errors
    /// As [`CircuitCase::new`]; [`Error::Input`] for a check that is too large.
    pub fn new(
        prepared: &Prepared,
        counts: &ResourceCounts,
        choice: CircuitChoice,
    ) -> Result<Self> {
        let Prepared { case, system, .. } = prepared;
        let bins = choice.bin_bits.map_or(Bins::Whole, Bins::Given);
        let CircuitCase { transport, rounded, change } = CircuitCase::new(case, bins)?;
        let modes = circuit_modes(case, counts, &choice);
        let (time, levels) = (case.duration(), choice.levels);
        let alpha = transport.alpha(modes, levels);
        let circuit = transport.encode(modes, levels, false);
        let controlled = transport.encode(modes, levels, true).counts();
        let walk_tolerance = walk_tolerance(case, counts);
        let tolerance = walk_tolerance.value().unwrap_or(case.tolerance);
        let of_register = counts.setup.highest_wavenumber;
        let highest = highest_mode(modes).unwrap_or(of_register);
        let alpha_of_highest = (highest_mode(modes).is_none())
            .then(|| transport.alpha(CircuitModes::One(of_register), levels));
        let access = AccessBounds::of(&system.matrix, highest.abs());
        let evolution = EvolutionDescription::new(alpha * time, tolerance, &controlled);
        let phases = Phases::new(alpha * time, evolution.steps / 2);
        let mut compiled = Self {
            description: CircuitDescription {
                title: case.title.clone(),
                shape: case.space.shape(),
                time,
                modes,
                levels,
                alpha,
                alpha_of_highest,
                rounded,
                change,
                sparse: SparseAccessCost::new(access, time, tolerance),
                counts: circuit.counts(),
                controlled,
                walk_tolerance,
                evolution,
                transport,
                sequence: phases.as_ref().ok().map(RotationSequence::of),
                no_sequence: phases.as_ref().err().map(NoPhases::to_string),
                check: None,
            },
            circuit,
            phases,
        };
        if choice.columns > 0 {
            compiled.description.check = Some(compiled.check(prepared, choice.columns)?);
        }
        Ok(compiled)
    }

    /// Refuses a check that takes too many terms or qubits.
    ///
    /// # Errors
    /// [`Error::Input`].
    fn refuse_large_check(&self) -> Result<()> {
        let spread = self.circuit.qubits_of(RegisterRole::Block).len();
        if spread > MOST_TERMS || self.circuit.qubits() > simulate::MOST_QUBITS {
            return Err(Error::Input(format!(
                "--check: 2^{spread} terms on {} qubits; at most 2^{MOST_TERMS} on {} are \
                 simulated: a smaller grid, or --wavenumber, has fewer",
                self.circuit.qubits(),
                simulate::MOST_QUBITS
            )));
        }
        Ok(())
    }

    /// Simulates evenly spread columns of the block.
    fn check(&self, prepared: &Prepared, columns: usize) -> Result<Check> {
        let Prepared { case, system, .. } = prepared;
        let (transport, modes) = (&self.description.transport, self.description.modes);
        // The register of modes; of one mode, two points, the first of that wavenumber.
        let (points, period) = match modes {
            CircuitModes::Register { period, .. } | CircuitModes::Rotated { period, .. } => {
                (1 << modes.qubits(), period)
            }
            CircuitModes::One(mu) => (2, -TAU / mu),
        };
        self.refuse_large_check()?;
        let access = SparseAccess::new(case, system, points, period)?;
        let mut scratch = Scratch::default();
        let listed = if matches!(modes, CircuitModes::One(_)) { 1 } else { points };
        let states = case.space.cells() * listed;
        let columns = columns.min(states);
        let axes = 2 * case.space.dimension();
        let place = |index: usize| transport.state(&case.space.cell(index)[..axes]);
        let mut difference = 0.0f64;
        for column in 0..columns {
            let (cell, l) =
                (column * states / columns / listed, column * states / columns % listed);
            let row = cell * points + l;
            if !modes.carries(l) {
                continue;
            }
            // The column of a Hermitian matrix, from its row.
            let found: Vec<usize> = (0..access.sparsity())
                .map(|entry| access.location(&mut scratch, row, entry))
                .filter(|&k| k < access.order())
                .collect();
            let mut entry = |k: usize| {
                let value = access.value(&mut scratch, row, k).conj();
                (place(k / points) * listed + l, value / self.description.alpha)
            };
            let mut left: HashMap<usize, Complex64> = found.into_iter().map(&mut entry).collect();
            for (state, value) in block_column(&self.circuit, place(cell) * listed + l) {
                let expected = left.remove(&state).unwrap_or_default();
                difference = difference.max((value - expected).norm());
            }
            difference = left.values().fold(difference, |m, value| m.max(value.norm()));
        }
        Ok(Check { columns, difference })
    }

    /// Writes the files into `directory`.
    ///
    /// # Errors
    /// [`Error::Directory`], [`Error::Output`].
    pub fn write(&self, directory: &Path) -> Result<()> {
        let Self { circuit, description, phases } = self;
        disk::make(directory)?;
        let text = formats::qasm(circuit, Some(&description.title));
        disk::write_text(&directory.join("interface.qasm"), &text)?;
        let whole = json!({
            "description": description,
            "registers": circuit.registers,
            "gates": circuit.gates,
            "phases": phases.as_ref().ok().map(|phases| &phases.angles),
        });
        for (name, value) in [
            ("circuit.json", &whole),
            ("azure.json", &formats::azure(description)),
            ("qref.json", &formats::qref(description)),
        ] {
            disk::write_json(&directory.join(name), value)?;
        }
        Ok(())
    }
}
