//! One circuit of all steps, of a case that has a [block encoding](crate::quantum::circuit).
//!
//! | stage | what its gates do |
//! |---|---|
//! | `start` | `f(0)`: a product by axis, a set of cells by comparators, else by cell; `g` |
//! | `modes` | `Φ⁻¹` on the register of `p` |
//! | `evolution` | `e^{−iHT}` in `2K` steps of the [`Walk`], with the [`Phases`] of its sequence |
//! | `points` | `Φ` |
//! | `moment` | the inverse of what prepares `ζ`: the point p◇, a cell, all its velocities |
//! | `estimation` | phase estimation of `Q = −A S_0 A⁻¹ S_0`, `A` being all of the above |
//!
//! After `points` the field is where the qubits of the block, `control` and `start` are 0, at the
//! point p◇. After `moment` all qubits are 0 with the amplitude `a = √s ⟨ζ|w(T)⟩`, where `s` is the
//! probability of the start: 1, or the part of the grid that comparators let pass. Amplitude
//! estimation finds `|a|`. Each of these is off by the distance of the cut series from `e^{−iτH}`.

use crate::base::error::{Error, Result};
use crate::problem::grid::PhaseSpace;
use crate::propagate::chebyshev::degree;
use crate::quantum::circuit::arithmetic::{equals, ones};
use crate::quantum::circuit::circuit_case::{self, Bins, CircuitCase};
use crate::quantum::circuit::evolution::Walk;
use crate::quantum::circuit::formats::qasm;
use crate::quantum::circuit::gates::{Circuit, Gate, GateCounts, Qubit, RegisterRole};
use crate::quantum::circuit::transport::{CaseTransport, CircuitModes, Levels};
use crate::quantum::circuit::wires::Wires;
use crate::quantum::export::circuit::phi;
use crate::quantum::export::reading::{ExportedState, MeasuredField};
use crate::quantum::phases::Phases;
use num_complex::Complex64;
use serde::Serialize;
use serde_json::json;

/// The largest number of qubits of a complete circuit.
pub const MOST_QUBITS: usize = 20;
/// Relative differences of cells below this are round-off.
const ROUND_OFF: f64 = 1e-14;

pub(super) struct CompleteCircuitInput<'a> {
    pub exported: ExportedState<'a>,
    /// The highest wavenumber that carries something.
    pub highest: f64,
    /// The normalised amplitudes in `p`, or why no circuit prepares them.
    pub profile: std::result::Result<Vec<f64>, String>,
    /// `f(0)` by cell.
    pub start: &'a [f64],
    /// `w(T)`, normalised.
    pub end: &'a [Complex64],
    /// Qubits of amplitude estimation.
    pub estimate: usize,
}

/// A part of the circuit.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize)]
pub struct CircuitStage {
    /// The name of the part, as in the table above.
    pub name: &'static str,
    /// The number of its first gate.
    pub first: usize,
}

/// The description of the circuit, and its expected results.
#[derive(Clone, Debug, Serialize)]
pub struct CompleteDescription {
    /// `α`: the block is `H/α`.
    pub alpha: f64,
    /// `αT`.
    pub tau: f64,
    /// `K`.
    pub degree: usize,
    /// `2K`.
    pub steps: usize,
    /// Bound on the distance of the cut series from `e^{−iτH}`, which bounds all others.
    pub bound: f64,
    /// `s`.
    pub probability_start: f64,
    /// Factor between amplitude and field: the field at a cell is `scale` times the amplitude
    /// there, over `√s`. It is `C_w e^{p◇}`.
    pub scale: f64,
    /// Bound on the error of the field, in the norm of its vector.
    pub field_bound: f64,
    /// The space cell of the moment, where the density is largest.
    pub cell: Vec<usize>,
    /// `a` as this program finds it: real and imaginary part.
    pub amplitude: [f64; 2],
    /// Factor between `a` and the density at that cell: the density is `moment_scale` times `a`,
    /// over `√s`.
    pub moment_scale: f64,
    /// Bound on the error of the density.
    pub moment_bound: f64,
    /// Qubits of amplitude estimation.
    pub estimate: usize,
    /// The parts of the circuit, and where each begins.
    pub stages: Vec<CircuitStage>,
    /// Counts of all gates.
    pub counts: GateCounts,
}

pub(super) struct CompleteCircuit {
    circuit: Circuit,
    pub about: CompleteDescription,
}

impl CompleteCircuit {
    /// The circuit of a task.
    ///
    /// # Errors
    /// As [`circuit_case::refuse`] and [`CircuitCase::new`]; [`Error::Input`] for more than
    /// [`MOST_QUBITS`] qubits, and what has no circuit of this kind.
    pub fn new(task: &CompleteCircuitInput<'_>) -> Result<Self> {
        let ExportedState { case, registers, grid, reading, .. } = task.exported;
        let wrong = |what: String| Error::Input(format!("{}: --complete: {what}", case.name));
        circuit_case::refuse(case)?;
        let CircuitCase { transport, .. } = CircuitCase::new(case, Bins::Whole)?;
        let profile = task.profile.clone().map_err(wrong)?;
        let modes = match (case.scheme.flux == 0.0, registers.p) {
            (true, 0) => CircuitModes::One(0.0),
            (true, _) => {
                let what = "the unitary scheme needs no p: leave out what is set in solver.warp";
                return Err(wrong(what.to_owned()));
            }
            (false, qubits) => {
                CircuitModes::Rotated { qubits, period: grid.period, highest: task.highest }
            }
        };
        let alpha = transport.alpha(modes, Levels::Uniform);
        let tau = alpha * case.duration();
        // The field is a part of the state.
        let tail = 0.5 * case.tolerance * reading.in_block.sqrt();
        let phases = Phases::new(tau, degree(&mut Vec::new(), tau, tail));
        let phases = phases.map_err(|why| wrong(format!("tau = {tau:.1}: {why}")))?;
        let start = StatePreparation::new(task);
        let mut builder = CircuitBuilder::new(task, &transport, modes, &start);
        let qubits = builder.circuit.qubits();
        if qubits > MOST_QUBITS {
            let size = |role| builder.circuit.qubits_of(role).len();
            return Err(wrong(format!(
                "{qubits} qubits ({} of the system and its control, {} of the block, {} read, {} \
                 scratch); one circuit has at most {MOST_QUBITS}: fewer cells, fewer modes by a \
                 larger solver.tolerance, or fewer qubits of amplitude estimation",
                size(RegisterRole::System),
                size(RegisterRole::Block),
                size(RegisterRole::Readout),
                builder.circuit.clean_scratch().len()
            )));
        }
        let cell = densest(reading, &case.space);
        builder.run(&start, &profile, &phases, [grid.recovery_index, cell]);
        let CircuitBuilder { mut circuit, stages, .. } = builder;
        circuit.finish();
        let described = DescribedCircuit { alpha, phases, start, cell, stages };
        let about = task.about(described, circuit.counts());
        Ok(Self { circuit, about })
    }

    /// The circuit in OpenQASM 3.
    pub fn qasm(&self, title: &str) -> String {
        qasm(&self.circuit, Some(title))
    }

    /// The description, registers and gates of the circuit, as JSON.
    pub fn json(&self) -> String {
        let Self { circuit, about } = self;
        let whole = json!({
            "description": about,
            "registers": circuit.registers,
            "gates": circuit.gates,
        });
        format!("{whole}\n")
    }
}

/// The number of the space cell where the density is largest.
fn densest(reading: &MeasuredField, space: &PhaseSpace) -> usize {
    let cells = reading.field.chunks_exact(space.velocity_cells());
    let densities = cells.map(|f| f.iter().sum::<f64>());
    let largest = densities.enumerate().max_by(|a, b| a.1.total_cmp(&b.1));
    largest.map_or(0, |found| found.0)
}

impl CompleteCircuitInput<'_> {
    fn about(&self, described: DescribedCircuit, counts: GateCounts) -> CompleteDescription {
        let DescribedCircuit { alpha, phases, start, cell, stages } = described;
        let ExportedState { case, grid, norm_of_state, .. } = self.exported;
        let velocities = case.space.velocity_cells();
        let at = |j: usize| self.end[(cell * velocities + j) * grid.points + grid.recovery_index];
        let root = (velocities as f64).sqrt();
        let probability_start = start.probability(self.start);
        let a = (0..velocities).map(at).sum::<Complex64>() / root * probability_start.sqrt();
        let scale = grid.recovery.exp() * norm_of_state;
        let moment_scale = scale * root * case.space.velocity_cell_volume();
        CompleteDescription {
            alpha,
            tau: phases.tau,
            degree: phases.degree,
            steps: 2 * phases.degree,
            bound: phases.bound,
            probability_start,
            scale,
            field_bound: scale * phases.bound,
            cell: case.space.cell(cell * velocities)[..case.space.dimension()].to_vec(),
            amplitude: [a.re, a.im],
            moment_scale,
            moment_bound: moment_scale * phases.bound,
            estimate: self.estimate,
            stages,
            counts,
        }
    }
}

/// A circuit as its description needs it: its block encoding, series, start and moment.
struct DescribedCircuit {
    alpha: f64,
    phases: Phases,
    start: StatePreparation,
    /// The number of the space cell of the moment.
    cell: usize,
    stages: Vec<CircuitStage>,
}

/// The preparation of `f(0)`.
enum StatePreparation {
    /// A product of vectors, one for each axis, `(x1..xn, v1..vn)`.
    Product(Vec<Vec<f64>>),
    /// The velocities `first..last` of each space cell, in one dimension.
    Set(Vec<[usize; 2]>),
    /// The values of all cells.
    Cells(Vec<f64>),
}

impl StatePreparation {
    fn new(task: &CompleteCircuitInput<'_>) -> Self {
        let (f, shape) = (task.start, task.exported.case.space.shape());
        let one = task.exported.case.space.dimension() == 1;
        if let Some(factors) = product(f, &shape) {
            return Self::Product(factors);
        }
        match set(f, shape[1]) {
            Some(intervals) if one && shape[0] > 1 => Self::Set(intervals),
            _ => Self::Cells(f.to_vec()),
        }
    }

    /// `s`.
    fn probability(&self, f: &[f64]) -> f64 {
        match self {
            Self::Set(intervals) => {
                let inside: usize = intervals.iter().map(|[first, last]| last - first).sum();
                inside as f64 / f.len() as f64
            }
            _ => 1.0,
        }
    }
}

/// The vectors whose product is `f`, one for each axis; `None` if `f` is no product.
fn product(f: &[f64], shape: &[usize]) -> Option<Vec<Vec<f64>>> {
    let largest = (0..f.len()).max_by(|&a, &b| f[a].abs().total_cmp(&f[b].abs()))?;
    let stride = |axis: usize| shape[axis + 1..].iter().product::<usize>();
    let number = |cell: usize, axis: usize| cell / stride(axis) % shape[axis];
    let along = |axis: usize| -> Vec<f64> {
        let zero = largest - number(largest, axis) * stride(axis);
        (0..shape[axis]).map(|k| f[zero + k * stride(axis)] / f[largest]).collect()
    };
    let mut factors: Vec<Vec<f64>> = (0..shape.len()).map(along).collect();
    let value = |cell: usize| -> f64 {
        factors.iter().enumerate().map(|(axis, factor)| factor[number(cell, axis)]).product()
    };
    let same = |cell: usize| (value(cell) - f[cell] / f[largest]).abs() <= ROUND_OFF;
    let is_product = (0..f.len()).all(same);
    if let Some(factor) = factors.iter_mut().find(|factor| factor.len() > 1) {
        factor.iter_mut().for_each(|x| *x *= f[largest].signum());
    }
    is_product.then_some(factors)
}

/// The interval of velocities of each cell, if `f` has one value above 0 there and is 0 elsewhere.
fn set(f: &[f64], velocities: usize) -> Option<Vec<[usize; 2]>> {
    let value = f.iter().copied().find(|&f| f != 0.0).filter(|&f| f > 0.0)?;
    let interval = |cell: &[f64]| {
        let first = cell.iter().position(|&f| f != 0.0).unwrap_or(0);
        let last = cell.iter().rposition(|&f| f != 0.0).map_or(first, |last| last + 1);
        cell[first..last].iter().all(|&f| f == value).then_some([first, last])
    };
    f.chunks_exact(velocities).map(interval).collect()
}

struct CircuitBuilder {
    circuit: Circuit,
    walk: Walk,
    warped: Vec<Qubit>,
    /// The qubits of each axis, `(x1..xn, v1..vn)`.
    axes: Vec<Vec<Qubit>>,
    /// A qubit that is 1 where comparators found no part of the start.
    outside: Option<Qubit>,
    estimate: Vec<Qubit>,
    stages: Vec<CircuitStage>,
}

impl CircuitBuilder {
    fn new(
        task: &CompleteCircuitInput<'_>,
        transport: &CaseTransport,
        modes: CircuitModes,
        start: &StatePreparation,
    ) -> Self {
        let mut circuit = Circuit::default();
        let wires = Wires::new(&mut circuit, transport, modes, true);
        let flag = usize::from(matches!(start, StatePreparation::Set(_)));
        let outside = circuit.register("start", flag, RegisterRole::Readout).first().copied();
        let estimate = circuit.register("estimate", task.estimate, RegisterRole::Readout);
        let walk = Walk::new(&mut circuit, &wires, transport, modes, Levels::Uniform);
        // The last axis is the lowest, velocities below space.
        let sizes = &task.exported.registers.phase_space;
        let (x, v) = sizes.split_at(sizes.len() / 2);
        let mut next = modes.qubits();
        let mut axes: Vec<Vec<Qubit>> = Vec::new();
        for &size in x.iter().chain(v).rev() {
            axes.insert(0, (next..next + size).collect());
            next += size;
        }
        let warped = (0..modes.qubits()).collect();
        let mut builder =
            Self { circuit, walk, warped, axes, outside, estimate, stages: Vec::new() };
        // Scratch of the start.
        if let StatePreparation::Set(intervals) = start {
            builder.compare(intervals);
            builder.circuit.gates.clear();
        }
        builder
    }

    fn stage(&mut self, name: &'static str) {
        let first = self.circuit.gates.len();
        self.stages.push(CircuitStage { name, first });
        self.circuit.comment(name);
    }

    /// All stages. The moment is that at a point in `p` and a space cell of these numbers.
    fn run(
        &mut self,
        start: &StatePreparation,
        profile: &[f64],
        phases: &Phases,
        [point, cell]: [usize; 2],
    ) {
        self.stage("start");
        self.prepare(start);
        let warped = self.warped.clone();
        self.circuit.prepare(&warped, profile);
        self.stage("modes");
        self.circuit.inverse_of(|c| phi(c, &warped));
        self.stage("evolution");
        self.walk.evolve(&mut self.circuit, phases);
        self.stage("points");
        phi(&mut self.circuit, &warped);
        self.stage("moment");
        self.moment(point, cell);
        self.stage("estimation");
        self.estimate();
    }

    fn prepare(&mut self, start: &StatePreparation) {
        match start {
            StatePreparation::Product(factors) => {
                for (qubits, factor) in self.axes.iter().zip(factors) {
                    self.circuit.prepare(qubits, factor);
                }
            }
            StatePreparation::Set(intervals) => self.compare(intervals),
            StatePreparation::Cells(values) => {
                let all: Vec<Qubit> = self.axes.iter().rev().flatten().copied().collect();
                self.circuit.prepare(&all, values);
            }
        }
    }

    /// Prepares the sum of all cells, and flips `outside` where the velocity is outside the
    /// interval of its cell. The flag is flipped where the velocity is below the last of its cell,
    /// again where it is below the first, and once more everywhere.
    fn compare(&mut self, intervals: &[[usize; 2]]) {
        let Some(outside) = self.outside else { return };
        let (space, velocity) = (self.axes[0].clone(), self.axes[1].clone());
        let c = &mut self.circuit;
        c.gates.extend(space.iter().chain(&velocity).map(|&q| Gate::H(q)));
        let zero = c.take(1);
        let limit = c.take(velocity.len() + 1);
        let number = [&velocity[..], &zero].concat();
        for end in [1, 0] {
            let load = |c: &mut Circuit| {
                for (cell, interval) in intervals.iter().enumerate().filter(|i| i.1[end] > 0) {
                    let here: Vec<_> = equals(&space, cell).collect();
                    c.where_all(&here, |c, here| c.flip_if(here, &ones(&limit, interval[end])));
                }
            };
            c.within(load, |c| c.less(&number, &limit, None, outside));
        }
        c.push(Gate::X(outside));
        c.give_back(&limit);
        c.give_back(&zero);
    }

    /// The inverse of what prepares the point `index` of `p`, the space cell `cell` and the sum of
    /// all velocities.
    fn moment(&mut self, index: usize, cell: usize) {
        let (space, velocities) = self.axes.split_at(self.axes.len() / 2);
        let space: Vec<Qubit> = space.iter().rev().flatten().copied().collect();
        let c = &mut self.circuit;
        c.flip(&ones(&self.warped, index));
        c.flip(&ones(&space, cell));
        c.gates.extend(velocities.iter().flatten().map(|&q| Gate::H(q)));
    }

    /// Appends amplitude estimation: `2^m − 1` times `Q`, each with two evolutions.
    fn estimate(&mut self) {
        let estimate = self.estimate.clone();
        let forward = self.circuit.gates.clone();
        let back: Vec<Gate> = forward.iter().rev().map(|gate| gate.inverse()).collect();
        self.circuit.gates.extend(estimate.iter().map(|&q| Gate::H(q)));
        for (bit, &control) in estimate.iter().enumerate() {
            for _ in 0..1 << bit {
                self.reflect_all(control);
                self.circuit.gates.extend(&back);
                self.reflect_all(control);
                self.circuit.gates.extend(&forward);
                self.circuit.push(Gate::Z(control));
            }
        }
        self.circuit.inverse_of(|c| c.fourier(&estimate));
    }

    /// Changes the sign where `control` is 1 and all qubits but those of the estimate are 0.
    fn reflect_all(&mut self, control: Qubit) {
        let mut zeros = self.circuit.qubits_of(RegisterRole::System);
        zeros.extend(self.circuit.qubits_of(RegisterRole::Block));
        zeros.extend(self.outside);
        let others = self.estimate.iter().copied().filter(|&q| q != control);
        let borrowed: Vec<Qubit> = self.circuit.clean_scratch().into_iter().chain(others).collect();
        let c = &mut self.circuit;
        let target = zeros[0];
        c.flip(&zeros);
        c.push(Gate::H(target));
        let controls = [&zeros[1..], &[control]].concat();
        c.flip_where_all(&controls, target, &borrowed);
        c.push(Gate::H(target));
        c.flip(&zeros);
    }
}
