//! The block encoding of `H` as gates: the conservative interface, jumps of `V`.
//!
//! | module | what it holds |
//! |---|---|
//! | [`scene`] | which cases have a circuit, and their whole numbers |
//! | [`interface`] | the block encoding, with its mathematics |
//! | `wires` | its registers, the weights of its sum |
//! | [`arithmetic`] | adders, comparators, square root, uniform superpositions |
//! | [`gates`] | gates, registers, counts |
//! | [`simulate`] | circuits on basis states and their sums |
//! | [`formats`] | OpenQASM 3, Azure's `LogicalCounts`, QREF |
//!
//! **Evolution.** The circuit `G` is its own inverse on the states that it starts from, and
//! `⟨0|G|0⟩ = H/α`. So `e^{−iHT}` is a sequence of `2K` phased steps of the walk, with `τ = αT` in
//! the place of `d‖H‖_max T` (see [`walk`](crate::quantum::walk)). A step has one call, controlled
//! by the qubit of the sequence, a reflection about the zeros of the block's qubits, controlled as
//! well, and one rotation of that qubit.
//!
//! | file | what |
//! |---|---|
//! | `interface.qasm` | `G`, OpenQASM 3 |
//! | `circuit.json` | `α`, counts, registers, gates as `[name, qubits]` or `[name, qubits, angle]` |
//! | `azure.json`, `qref.json` | the counts of the evolution for other programs |

pub mod arithmetic;
pub mod formats;
pub mod gates;
pub mod interface;
pub mod scene;
pub mod simulate;
#[cfg(test)]
mod tests;
mod wires;

use crate::base::disk;
use crate::base::error::{Error, Result};
use crate::quantum::access::{Scratch, SparseAccess, extremes};
use crate::quantum::circuit::gates::{Circuit, Counts, Role};
use crate::quantum::circuit::interface::{Levels, Modes, Transport};
use crate::quantum::circuit::scene::Scene;
use crate::quantum::circuit::simulate::block_column;
use crate::quantum::resources::Record;
use crate::quantum::walk;
use crate::solve::prepared::Prepared;
use num_complex::Complex64;
use serde::Serialize;
use serde_json::json;
use std::collections::HashMap;
use std::f64::consts::TAU;
use std::fmt;
use std::path::Path;

/// Most terms of a state in a check: `2^22`.
const MOST_TERMS: usize = 22;

/// What is compiled of a case.
#[derive(Clone, Copy, Debug, Default)]
pub struct Choice {
    /// Bits of the bins that divide a level; by default as few as make all jumps whole.
    pub bin_bits: Option<usize>,
    /// The register of the levels.
    pub levels: Levels,
    /// One mode, instead of all.
    pub wavenumber: Option<f64>,
    /// Columns of the block that are simulated.
    pub columns: usize,
}

/// Sparse access to the same `H`, with the same modes.
#[derive(Clone, Copy, Debug, PartialEq, Serialize)]
pub struct Sparse {
    /// `d`.
    pub nonzeros: usize,
    /// `‖H‖_max`.
    pub largest_entry: f64,
    /// `d‖H‖_max`.
    pub alpha: f64,
    /// `d‖H‖_max T`.
    pub tau: f64,
    /// `2K`.
    pub steps: usize,
}

/// `e^{−iHT}` by the circuit.
#[derive(Clone, Copy, Debug, PartialEq, Serialize)]
pub struct Evolution {
    /// `αT`.
    pub tau: f64,
    /// `2K`: calls of the controlled circuit.
    pub steps: usize,
    /// Toffoli gates of all calls and reflections.
    pub toffoli: usize,
    /// `t` and `tdg` of all calls.
    pub t: usize,
    /// Rotations of all calls, and the phases of the sequence.
    pub rotations: usize,
    /// With that of the sequence.
    pub qubits: usize,
}

/// Simulated columns of the block beside those of `H`.
#[derive(Clone, Copy, Debug, PartialEq, Serialize)]
pub struct Check {
    /// How many.
    pub columns: usize,
    /// Largest difference of an entry from `H/α`.
    pub difference: f64,
}

/// What was compiled.
#[derive(Clone, Debug, Serialize)]
pub struct Description {
    /// Title of the case.
    pub title: String,
    /// Cells along each axis, `(x1..xn, v1..vn)`.
    pub shape: Vec<usize>,
    /// `T`.
    pub time: f64,
    /// In whole numbers.
    pub transport: Transport,
    /// The modes.
    pub modes: Modes,
    /// The register of the levels.
    pub levels: Levels,
    /// The block is `H/α`.
    pub alpha: f64,
    /// `α` of the circuit of one mode, that of the highest wavenumber that carries something.
    pub alpha_of_highest: f64,
    /// How far a jump was rounded at most, in levels.
    pub rounded: f64,
    /// Bound of the norm of what that changes of `A`.
    pub change: f64,
    /// Today's sparse access.
    pub sparse: Sparse,
    /// Of the circuit.
    pub counts: Counts,
    /// Of the circuit with a qubit that says whether it is applied.
    pub controlled: Counts,
    /// By the controlled circuit.
    pub evolution: Evolution,
    /// What was simulated.
    pub check: Option<Check>,
}

/// A circuit and what it is.
pub struct Compiled {
    /// The circuit.
    pub circuit: Circuit,
    /// What it is.
    pub description: Description,
}

impl Compiled {
    /// Of a case whose whole grid is on this rank; `record` is what sparse access takes.
    ///
    /// # Errors
    /// As [`Scene::new`]; [`Error::Input`] for a check that is too large.
    pub fn new(prepared: &Prepared, record: &Record, choice: Choice) -> Result<Self> {
        let Prepared { case, system, .. } = prepared;
        let Scene { transport, rounded, change } = Scene::new(case, choice.bin_bits)?;
        let modes = match choice.wavenumber {
            Some(mu) => Modes::One(mu),
            None => Modes::Register {
                qubits: record.points.trailing_zeros() as usize,
                period: record.period,
            },
        };
        let (time, levels) = (case.duration(), choice.levels);
        let alpha = transport.alpha(modes, levels);
        let circuit = transport.encode(modes, levels, false);
        let controlled = transport.encode(modes, levels, true).counts();
        let tolerance = record.walk_tolerance.value().unwrap_or(case.tolerance);
        let highest = choice.wavenumber.unwrap_or(record.setup.highest_wavenumber);
        let (largest_entry, nonzeros) = extremes(&system.matrix, highest.abs());
        let sparse_alpha = nonzeros as f64 * largest_entry;
        let mut compiled = Self {
            description: Description {
                title: case.title.clone(),
                shape: case.space.shape(),
                time,
                modes,
                levels,
                alpha,
                alpha_of_highest: transport.alpha(Modes::One(highest), levels),
                rounded,
                change,
                sparse: Sparse {
                    nonzeros,
                    largest_entry,
                    alpha: sparse_alpha,
                    tau: sparse_alpha * time,
                    steps: steps(sparse_alpha * time, tolerance),
                },
                counts: circuit.counts(),
                controlled,
                evolution: Evolution::new(alpha * time, tolerance, &controlled),
                transport,
                check: None,
            },
            circuit,
        };
        if choice.columns > 0 {
            compiled.description.check = Some(compiled.check(prepared, choice.columns)?);
        }
        Ok(compiled)
    }

    /// Simulates so many columns of the block, evenly spread.
    fn check(&self, prepared: &Prepared, columns: usize) -> Result<Check> {
        let Prepared { case, system, .. } = prepared;
        let (transport, modes) = (&self.description.transport, self.description.modes);
        // The register of modes; of one mode, two points, the first of that wavenumber.
        let (points, period) = match modes {
            Modes::Register { qubits, period } => (1 << qubits, period),
            Modes::One(mu) => (2, -TAU / mu),
        };
        let of_block = self.circuit.registers.iter().filter(|r| r.role == Role::Block);
        let spread: usize = of_block.map(|r| r.size).sum();
        if spread > MOST_TERMS || self.circuit.qubits() > simulate::MOST_QUBITS {
            return Err(Error::Input(format!(
                "--check: 2^{spread} terms on {} qubits; at most 2^{MOST_TERMS} on {} are \
                 simulated: a smaller grid, or --wavenumber, has fewer",
                self.circuit.qubits(),
                simulate::MOST_QUBITS
            )));
        }
        let access = SparseAccess::new(case, system, points, period)?;
        let mut scratch = Scratch::default();
        let listed = if matches!(modes, Modes::One(_)) { 1 } else { points };
        let states = case.space.cells() * listed;
        let columns = columns.min(states);
        let axes = 2 * case.space.dimension();
        let place = |index: usize| transport.state(&case.space.cell(index)[..axes]);
        let mut difference = 0.0f64;
        for column in 0..columns {
            let (cell, l) =
                (column * states / columns / listed, column * states / columns % listed);
            let row = cell * points + l;
            let mut left: HashMap<usize, Complex64> = (0..access.sparsity())
                .map(|entry| access.location(&mut scratch, row, entry))
                .filter(|&k| k < access.order())
                .collect::<Vec<_>>()
                .into_iter()
                .map(|k| {
                    // The column of a Hermitian matrix, from its row.
                    let value = access.value(&mut scratch, row, k).conj();
                    (place(k / points) * listed + l, value / self.description.alpha)
                })
                .collect();
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
        let Self { circuit, description } = self;
        disk::make(directory)?;
        let write = |name: &str, text: &str| disk::write_text(&directory.join(name), text);
        write("interface.qasm", &formats::qasm(circuit, &description.title))?;
        let whole = json!({
            "description": description,
            "registers": circuit.registers,
            "gates": circuit.gates,
        });
        for (name, value) in [
            ("circuit.json", &whole),
            ("azure.json", &formats::azure(description)),
            ("qref.json", &formats::qref(description)),
        ] {
            write(name, &format!("{value:#}\n"))?;
        }
        Ok(())
    }
}

impl Evolution {
    /// For `τ`, within `tolerance`, by calls of a circuit with these counts.
    fn new(tau: f64, tolerance: f64, controlled: &Counts) -> Self {
        let steps = steps(tau, tolerance);
        // Zeros of all qubits of the block, and back.
        let reflection = 2 * controlled.block_qubits.saturating_sub(1);
        Self {
            tau,
            steps,
            toffoli: steps * (controlled.toffoli + reflection),
            t: steps * controlled.t,
            rotations: steps * controlled.rotations + steps + 1,
            qubits: controlled.qubits,
        }
    }
}

/// `2K` for `τ`.
fn steps(tau: f64, tolerance: f64) -> usize {
    walk::Evolution::new(tau, tolerance).steps.value().unwrap_or_default() as usize
}

impl fmt::Display for Description {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let Self { transport, counts, evolution, sparse, .. } = self;
        let shape: Vec<String> = self.shape.iter().map(usize::to_string).collect();
        writeln!(f, "{}: {} cells", self.title, shape.join(" x "))?;
        let bins = 1u64 << transport.bin_bits;
        writeln!(
            f,
            "jumps of V: {}; bins of a level of dv^2/2: {bins}; rounded by at most {:.1e} levels, \
             which changes A by at most {:.1e}",
            transport.axes.iter().map(|axis| axis.jumps.len()).sum::<usize>(),
            self.rounded,
            self.change
        )?;
        match self.modes {
            Modes::One(mu) => writeln!(f, "one mode, mu = {mu}")?,
            Modes::Register { qubits, period } => {
                writeln!(f, "{} modes on a length of {period:.4}", 1u64 << qubits)?;
            }
        }
        writeln!(f, "\n{:<22}{:>14}{:>16}", "", "circuit", "sparse access")?;
        writeln!(f, "{:<22}{:>14.4e}{:>16.4e}", "alpha", self.alpha, sparse.alpha)?;
        writeln!(f, "{:<22}{:>14.4e}", "alpha, highest mode", self.alpha_of_highest)?;
        writeln!(f, "{:<22}{:>14.4e}{:>16.4e}", "tau = alpha T", evolution.tau, sparse.tau)?;
        writeln!(f, "{:<22}{:>14}{:>16}", "walk steps 2K", evolution.steps, sparse.steps)?;
        writeln!(f, "\n{:<22}{:>14}{:>16}{:>16}", "", "one call", "controlled", "evolution")?;
        let call = &self.controlled;
        for (name, own, controlled, all) in [
            ("Toffoli", counts.toffoli, call.toffoli, evolution.toffoli),
            ("T beside them", counts.t, call.t, evolution.t),
            ("rotations", counts.rotations, call.rotations, evolution.rotations),
            ("qubits", counts.qubits, call.qubits, evolution.qubits),
        ] {
            writeln!(f, "{name:<22}{own:>14}{controlled:>16}{all:>16}")?;
        }
        writeln!(f, "{:<22}{:>14}{:>16}", "CNOT and CZ", counts.cnot, call.cnot)?;
        writeln!(
            f,
            "{:<22}{:>14}{:>16}",
            "Toffoli depth", counts.toffoli_depth, call.toffoli_depth
        )?;
        write!(
            f,
            "qubits of one call: {} of the system, {} of the block, {} scratch",
            counts.system_qubits, counts.block_qubits, counts.scratch_qubits
        )?;
        if let Some(Check { columns, difference }) = self.check {
            write!(
                f,
                "\n{columns} columns of the block simulated: within {difference:.1e} of H/alpha"
            )?;
        }
        Ok(())
    }
}
