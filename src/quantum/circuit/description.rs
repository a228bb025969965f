//! The compiled circuit, and the cost of an evolution by it.

use crate::base::text::joined;
use crate::quantum::access::AccessBounds;
use crate::quantum::circuit::gates::GateCounts;
use crate::quantum::circuit::transport::{CaseTransport, CircuitModes, Levels};
use crate::quantum::cost::sequence::SequenceCounts;
use crate::quantum::labelled_number::LabelledNumber;
use crate::quantum::phases::Phases;
use crate::quantum::walk::WalkCost;
use serde::Serialize;
use std::fmt;

/// The cost of sparse access to the same `H`, with the same modes.
#[derive(Clone, Copy, Debug, PartialEq, Serialize)]
pub struct SparseAccessCost {
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

impl SparseAccessCost {
    /// The steps of an evolution over `time` to `tolerance`, for an `H` with these `bounds`.
    pub fn new(bounds: AccessBounds, time: f64, tolerance: f64) -> Self {
        let AccessBounds { largest: largest_entry, sparsity: nonzeros } = bounds;
        let alpha = nonzeros as f64 * largest_entry;
        let tau = alpha * time;
        let steps = walk_of(tau, tolerance).steps.or_zero() as usize;
        Self { nonzeros, largest_entry, alpha, tau, steps }
    }
}

/// `e^{−iHT}` by the circuit.
#[derive(Clone, Copy, Debug, PartialEq, Serialize)]
pub struct EvolutionDescription {
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
    /// Qubits of the evolution: those of the circuit, the qubit of the sequence, and the ancillas
    /// of its reflections.
    pub qubits: usize,
}

/// Comparison of simulated columns of the block with the columns of `H/α`.
#[derive(Clone, Copy, Debug, PartialEq, Serialize)]
pub struct Check {
    /// Number of columns that were compared.
    pub columns: usize,
    /// Largest difference between an entry of these columns and `H/α`.
    pub difference: f64,
}

/// The error of the rotations of the evolution.
#[derive(Clone, Copy, Debug, PartialEq, Serialize)]
pub struct RotationSequence {
    /// Bound on the distance of the sequence from `e^{−iHT}` in norm.
    pub bound: f64,
    /// Largest difference between the product of the steps and their polynomial, at points of the
    /// unit circle.
    pub difference: f64,
}

impl RotationSequence {
    /// The error of the rotations of `phases`: bound and measured difference.
    pub fn of(phases: &Phases) -> Self {
        const POINTS: usize = 64;
        Self { bound: phases.bound, difference: phases.difference(POINTS) }
    }
}

/// The compiled circuit.
#[derive(Clone, Debug, Serialize)]
pub struct CircuitDescription {
    /// Title of the case.
    pub title: String,
    /// Cells along each axis, `(x1..xn, v1..vn)`.
    pub shape: Vec<usize>,
    /// `T`.
    pub time: f64,
    /// The transport of the case, in whole numbers.
    pub transport: CaseTransport,
    /// The modes.
    pub modes: CircuitModes,
    /// The register of the levels.
    pub levels: Levels,
    /// `α`: the circuit encodes the block `H/α`.
    pub alpha: f64,
    /// `α` of the circuit of one mode, the one with the highest wavenumber that carries something.
    /// `None` if the circuit is of one mode, or has rotations for each mode.
    pub alpha_of_highest: Option<f64>,
    /// The largest change of a jump by rounding, in levels.
    pub rounded: f64,
    /// Bound on the norm of the change of `A` by that rounding.
    pub change: f64,
    /// The cost of the same evolution by sparse access.
    pub sparse: SparseAccessCost,
    /// Counts of the circuit.
    pub counts: GateCounts,
    /// Counts of the controlled circuit, which a further qubit applies.
    pub controlled: GateCounts,
    /// The tolerance of the evolution. It is an estimate where it depends on an estimated
    /// probability: then the steps that follow from it, and all counts of the evolution, are
    /// estimates too.
    pub walk_tolerance: LabelledNumber,
    /// The evolution that calls the controlled circuit.
    pub evolution: EvolutionDescription,
    /// The error of its rotations; `None` where `no_sequence` says why there are none.
    pub sequence: Option<RotationSequence>,
    /// Why there are no rotations.
    pub no_sequence: Option<String>,
    /// The comparison of simulated columns, if any were simulated.
    pub check: Option<Check>,
}

impl EvolutionDescription {
    /// The evolution for `τ`, within `tolerance`, by calls of a circuit with the counts
    /// `controlled`.
    pub fn new(tau: f64, tolerance: f64, controlled: &GateCounts) -> Self {
        let emitted = LabelledNumber::emitted(1.0);
        let all = SequenceCounts::whole(&walk_of(tau, tolerance), controlled, &emitted);
        let count = |number: &LabelledNumber| number.or_zero() as usize;
        Self {
            tau,
            steps: count(&all.steps),
            toffoli: count(&all.toffoli),
            t: count(&all.t),
            rotations: count(&all.rotations),
            qubits: count(&all.qubits),
        }
    }
}

/// The cost of an evolution for `τ`, within `tolerance`.
fn walk_of(tau: f64, tolerance: f64) -> WalkCost {
    let [tau, tolerance] = [tau, tolerance].map(LabelledNumber::exact);
    WalkCost::new(&tau, &tolerance)
}

impl fmt::Display for CircuitDescription {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        self.write_case(f)?;
        self.write_steps(f)?;
        self.write_gates(f)?;
        self.write_tolerances(f)
    }
}

impl CircuitDescription {
    /// The grid, the potential and the modes.
    fn write_case(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let transport = &self.transport;
        writeln!(f, "{}: {} cells", self.title, joined(&self.shape, " x "))?;
        let bins = 1u64 << transport.bin_bits;
        writeln!(
            f,
            "jumps of V: {}; forces: {}; bins of a level of dv^2/2: {bins}; rounded by at most \
             {:.1e} levels, which changes A by at most {:.1e}",
            transport.axes.iter().map(|axis| axis.jumps.len()).sum::<usize>(),
            transport.forces.len(),
            self.rounded,
            self.change
        )?;
        match self.modes {
            CircuitModes::One(mu) => writeln!(f, "one mode, mu = {mu}"),
            CircuitModes::Register { qubits, period }
            | CircuitModes::Rotated { qubits, period, .. } => {
                writeln!(f, "{} modes on a length of {period:.4}", 1u64 << qubits)
            }
        }
    }

    /// The subnormalisation and the steps, beside those of sparse access.
    fn write_steps(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let Self { evolution, sparse, .. } = self;
        writeln!(f, "\n{:<22}{:>14}{:>16}", "", "circuit", "sparse access")?;
        writeln!(f, "{:<22}{:>14.4e}{:>16.4e}", "alpha", self.alpha, sparse.alpha)?;
        if let Some(alpha) = self.alpha_of_highest {
            writeln!(f, "{:<22}{alpha:>14.4e}", "alpha, highest mode")?;
        }
        writeln!(f, "{:<22}{:>14.4e}{:>16.4e}", "tau = alpha T", evolution.tau, sparse.tau)?;
        writeln!(f, "{:<22}{:>14}{:>16}", "walk steps 2K", evolution.steps, sparse.steps)
    }

    /// The gates and qubits of one call, of a controlled one, and of the evolution.
    fn write_gates(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let Self { counts, evolution, .. } = self;
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
        )
    }

    /// The tolerances of the evolution and of its rotations, and the check of the block.
    fn write_tolerances(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "\ntolerance of the evolution, from which its steps follow:")?;
        write!(f, " {}", self.walk_tolerance.to_string().trim_start())?;
        match self.sequence {
            Some(RotationSequence { bound, difference }) => write!(
                f,
                "\nrotations of the evolution: within {bound:.1e} of exp(-iHT); their product \
                 within {difference:.1e} of its polynomial"
            )?,
            None => write!(
                f,
                "\nno rotations of the evolution are computed: {}",
                self.no_sequence.as_deref().unwrap_or_default()
            )?,
        }
        if let Some(Check { columns, difference }) = self.check {
            write!(
                f,
                "\n{columns} columns of the block simulated: within {difference:.1e} of H/alpha"
            )?;
        }
        Ok(())
    }
}
