//! One cost model: gates until the field is measured, of every access to `H`.
//!
//! ```text
//! cost = (calls of a block encoding in e^{−iHT}) × (gates of a call) × (1/P or 2r + 1)
//! ```
//!
//! A block encoding of `H/α` takes `2K` calls for `τ = αT`, or about half as many (see
//! [`walk`](crate::quantum::walk)).
//!
//! | access | `α` | Toffoli gates of a call |
//! |---|---|---|
//! | sparse | `d‖H‖_max` | model: `n + m log₂(m)²` for each of 6 calls of the oracles |
//! | [circuit](crate::quantum::circuit) | of the circuit | counted, with the reflection |
//! | the same, rotated | of the highest mode | counted; weights of modes by rotations |
//!
//! T gates and rotations are compared with Toffoli gates by a model of their
//! [`synthesis`](crate::quantum::synthesis).
//!
//! Of `S = 0`, the unitary scheme, `H = iK` is one mode, which is the field: `P = 1`.

pub mod sequence;
pub mod table;

use crate::matrix::bounds::Bounds;
use crate::problem::case::Case;
use crate::quantum::access::LargestEntries;
use crate::quantum::circuit::circuit_case::{self, Bins, CircuitCase};
use crate::quantum::circuit::gates::GateCounts;
use crate::quantum::circuit::transport::{
    CaseTransport, CircuitModes, Levels, ModeWeights, bits_of,
};
use crate::quantum::cost::sequence::{SequenceCost, SequenceCounts};
use crate::quantum::labelled_number::LabelledNumber;
use crate::quantum::resources::regime::gates_factor;
use crate::quantum::synthesis::{RotationSynthesis, T_OF_TOFFOLI_STATE};
use crate::quantum::walk::{
    LOCATION_CALLS, OracleQueries, VALUE_CALLS, WalkCost, WalkRegisters, calls_both_ways,
};
use serde::Serialize;
use std::cell::RefCell;
use std::collections::HashMap;
use std::fmt;

/// Rotations of a call for each mode of the register, where rotations weight the modes.
const ROTATIONS_OF_A_MODE: usize = 6;

/// How a quantum computer accesses `H`.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash, Serialize)]
#[serde(rename_all = "kebab-case")]
pub enum Access {
    /// Sparse access, by oracles of the rows of `H`.
    Sparse,
    /// A compiled circuit with this register of levels.
    Circuit(Levels),
    /// A compiled circuit with this register of levels that weights each mode by rotations.
    Rotated(Levels),
}

impl fmt::Display for Access {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.pad(match self {
            Self::Sparse => "sparse access",
            Self::Circuit(Levels::Hadamard) => "circuit",
            Self::Circuit(Levels::Uniform) => "circuit, uniform",
            Self::Rotated(Levels::Hadamard) => "rotated",
            Self::Rotated(Levels::Uniform) => "rotated, uniform",
        })
    }
}

/// The cost of `e^{−iHT}` by an access to `H`, and of the measurement of the field.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct Cost {
    /// The access to `H`.
    pub access: Access,
    /// `α`: the access block-encodes `H/α`.
    pub alpha: LabelledNumber,
    /// `αT`.
    pub tau: LabelledNumber,
    /// Qubits of the block encoding that are zero before and, where it is `H/α`, after.
    pub block_qubits: usize,
    /// The cost by a sequence of `2K` steps, whose rotations are computed.
    #[serde(flatten)]
    pub evolution: SequenceCost,
    /// The cost by a sequence of steps forward and back, about half as many.
    pub half_calls: SequenceCost,
    /// Gates until the field is measured by the sequence of `2K` steps, repeated or amplified,
    /// whichever is fewer.
    pub gates_until_measured_2k: LabelledNumber,
    /// Calls of the oracles; `None` unless the access is sparse.
    #[serde(flatten)]
    pub queries: Option<OracleQueries>,
}

impl Cost {
    /// The access of these that takes the fewest gates until the field is measured.
    pub fn least_of<'a>(costs: impl IntoIterator<Item = &'a Self>) -> Option<&'a Self> {
        costs.into_iter().min_by(|a, b| a.least().total_cmp(&b.least()))
    }

    /// The sequence with fewer gates.
    pub fn cheaper(&self) -> &SequenceCost {
        if self.half_calls.least() < self.evolution.least() {
            &self.half_calls
        } else {
            &self.evolution
        }
    }

    /// Gates of the cheaper sequence until the field is measured; infinite where there is no
    /// number.
    pub fn least(&self) -> f64 {
        self.cheaper().least()
    }

    /// Gates of the cheaper sequence until the field is measured, with their label.
    pub fn measured(&self) -> &LabelledNumber {
        self.cheaper().measured()
    }
}

/// Gates until the field is measured, by both ways to weight the modes in a circuit.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct ModeWeightsCost {
    /// Gates with the weights as one sum of signs of bits.
    pub sum: LabelledNumber,
    /// Gates with a rotation for each mode.
    pub rotations: LabelledNumber,
    /// The cheaper of the two.
    pub cheaper: ModeWeights,
}

impl ModeWeightsCost {
    /// The least of `costs`, the costs of a set-up, for either kind of weights. `None` without
    /// circuits of many modes.
    pub fn of(costs: &[Cost]) -> Option<Self> {
        let least = |wanted: &dyn Fn(&Access) -> bool| {
            Cost::least_of(costs.iter().filter(|cost| wanted(&cost.access))).map(Cost::measured)
        };
        let sum = least(&|access| matches!(access, Access::Circuit(_)))?;
        let rotations = least(&|access| matches!(access, Access::Rotated(_)))?;
        let cheaper =
            if rotations.value() < sum.value() { ModeWeights::Rotations } else { ModeWeights::Sum };
        Some(Self { sum: sum.clone(), rotations: rotations.clone(), cheaper })
    }
}

/// The time and accuracy of an evolution.
#[derive(Clone, Debug, PartialEq)]
pub struct EvolutionRequirements {
    /// The highest wavenumber that carries something.
    pub highest: f64,
    /// `N_p`, a power of two.
    pub points: usize,
    /// `P`.
    pub period: f64,
    /// The error of the state that the evolution may make.
    pub tolerance: LabelledNumber,
}

impl EvolutionRequirements {
    /// The requirements of the unitary scheme: one mode, and no register of `p`.
    pub fn unitary(tolerance: LabelledNumber) -> Self {
        Self { highest: 0.0, points: 1, period: 1.0, tolerance }
    }
}

/// How a circuit rounds jumps of `V`, as `export-circuit --sub-bins` does.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct JumpRounding {
    /// `B`: a level of `Δv²/2` has `2^B` bins, and jumps are whole numbers of them.
    pub bin_bits: usize,
    /// The largest change of a jump, in levels.
    pub rounded: f64,
    /// Bound on the norm of the change of `A`.
    pub change: LabelledNumber,
}

/// The access that costs least, and the oracles' calls of sparse access beside it.
pub struct LeastCost {
    /// The cost of that access.
    pub cost: Cost,
    /// Calls of the oracles by sparse access.
    pub queries: OracleQueries,
}

struct CircuitAccess<'a> {
    transport: &'a CaseTransport,
    weights: ModeWeights,
    levels: Levels,
}

impl CircuitAccess<'_> {
    /// The modes that it acts on; a single mode if the matrix is `skew`.
    fn modes(&self, requirements: &EvolutionRequirements, skew: bool) -> CircuitModes {
        let EvolutionRequirements { points, period, highest, .. } = *requirements;
        if skew {
            CircuitModes::One(0.0)
        } else {
            self.weights.of_register(points, period, highest)
        }
    }
}

/// The data on which the accesses to a case's `H` depend.
pub struct Accesses {
    time: f64,
    /// The largest entries of `(S, K)`.
    pub entries: LargestEntries,
    /// Qubits that number the unknowns.
    qubits: usize,
    /// Whether `S = 0`.
    skew: bool,
    /// The case in whole numbers, for a circuit, or why there is no circuit.
    pub circuit: Result<CircuitCase, String>,
    /// The number of T gates that a rotation takes.
    pub synthesis: RotationSynthesis,
    /// Counts of circuits, controlled and not, by the qubits of `p`.
    counts: RefCell<HashMap<(usize, Access), [GateCounts; 2]>>,
}

impl Accesses {
    /// The accesses to the `H` of `case` with these bounds and the `entries` of its `(S, K)`. The
    /// rounding of jumps to levels may change the field by `rounding`, relative to it.
    pub fn new(
        case: &Case,
        bounds: &Bounds,
        entries: LargestEntries,
        rounding: f64,
        synthesis: RotationSynthesis,
    ) -> Self {
        let time = case.duration();
        let of_phase_space: usize = case.space.axes().map(|axis| bits_of(axis.cells)).sum();
        let qubits = of_phase_space + usize::from(case.embeds());
        let circuit = circuit_case::refuse(case)
            .and_then(|()| CircuitCase::new(case, Bins::Within(rounding / time)))
            .map_err(|error| case.reason(&error));
        let counts = RefCell::default();
        Self { time, entries, qubits, skew: bounds.is_skew(), circuit, synthesis, counts }
    }

    /// How a circuit rounds jumps of `V`; `None` without a circuit.
    pub fn rounding(&self) -> Option<JumpRounding> {
        let CircuitCase { transport, rounded, change } = self.circuit.as_ref().ok()?;
        let (bin_bits, rounded, change) = (transport.bin_bits, *rounded, *change);
        Some(JumpRounding { bin_bits, rounded, change: LabelledNumber::bound(change) })
    }

    /// The costs of every access. `evolutions` are those until the field is measured: repeated, and
    /// by amplitude amplification.
    pub fn costs(
        &self,
        requirements: &EvolutionRequirements,
        evolutions: &[LabelledNumber; 2],
    ) -> Vec<Cost> {
        let sparse = self.by_oracles(requirements, evolutions).cost;
        let circuits = self.circuits().map(|it| self.by_circuit(&it, requirements, evolutions));
        std::iter::once(sparse).chain(circuits).collect()
    }

    /// The circuits of a case; empty where no circuit is compiled.
    fn circuits(&self) -> impl Iterator<Item = CircuitAccess<'_>> {
        // One mode has one weight.
        let weights = [ModeWeights::Sum, ModeWeights::Rotations];
        let weights = weights.into_iter().filter(|&w| !self.skew || w == ModeWeights::Sum);
        let choices = weights.flat_map(|w| [Levels::Hadamard, Levels::Uniform].map(|l| (w, l)));
        self.circuit.iter().flat_map(move |CircuitCase { transport, .. }| {
            let access = |(weights, levels)| CircuitAccess { transport, weights, levels };
            choices.clone().map(access)
        })
    }

    /// The access that costs least. `evolutions` are those until the field is measured: repeated,
    /// and by amplitude amplification.
    pub fn least(
        &self,
        requirements: &EvolutionRequirements,
        evolutions: &[LabelledNumber; 2],
    ) -> LeastCost {
        let LeastCost { mut cost, queries } = self.by_oracles(requirements, evolutions);
        for circuit in self.circuits() {
            // A table of rotations is not emitted where its rotations alone are too many.
            if self.rotations_alone(&circuit, requirements, evolutions) > cost.least() {
                continue;
            }
            let next = self.by_circuit(&circuit, requirements, evolutions);
            if next.least() < cost.least() {
                cost = next;
            }
        }
        LeastCost { cost, queries }
    }

    /// A lower bound of the cost by a circuit: the cost of the rotations which weight its modes.
    fn rotations_alone(
        &self,
        circuit: &CircuitAccess<'_>,
        requirements: &EvolutionRequirements,
        evolutions: &[LabelledNumber; 2],
    ) -> f64 {
        if circuit.weights == ModeWeights::Sum {
            return 0.0;
        }
        let tau = circuit.transport.alpha(circuit.modes(requirements, self.skew), circuit.levels);
        let tau = tau * self.time;
        let evolution = WalkCost::new(&LabelledNumber::exact(tau), &requirements.tolerance);
        let degree = evolution.degree.or_zero();
        let calls = calls_both_ways(degree, tau).min(2.0 * degree);
        let rotations = calls * (ROTATIONS_OF_A_MODE * requirements.points) as f64;
        let t_of_each = self.synthesis.t_of_each(rotations, requirements.tolerance.or_zero());
        let t = rotations * t_of_each.or_zero();
        let [repeated, amplified] = evolutions.each_ref().map(LabelledNumber::or_zero);
        repeated.min(amplified) * t / T_OF_TOFFOLI_STATE
    }

    /// The cost by sparse access.
    fn by_oracles(
        &self,
        requirements: &EvolutionRequirements,
        evolutions: &[LabelledNumber; 2],
    ) -> LeastCost {
        const GATES: &str = "n + m log2(m)^2 for each of 6 calls of the oracles, constants 1";
        let alpha = self.entries.nonzeros as f64 * self.entries.largest(requirements.highest);
        let tau = self.of_grid(LabelledNumber::exact(alpha * self.time));
        let evolution = WalkCost::new(&tau, &requirements.tolerance);
        let queries = OracleQueries::new(&evolution, evolutions);
        let of_p = if self.skew { 0 } else { bits_of(requirements.points) };
        let system = self.qubits + of_p;
        let bits = evolution.bits.or_zero();
        let gates = gates_factor(system as f64, bits);
        let a_step = LabelledNumber::model((LOCATION_CALLS + VALUE_CALLS) * gates, GATES);
        let walk = WalkRegisters::new(system, bits);
        let sequences = SequenceCounts::of_oracles(&evolution, &tau, &a_step, &walk);
        let tolerance = requirements.tolerance.or_zero();
        let [evolution, half_calls] =
            sequences.map(|counts| counts.cost(self.synthesis, tolerance, evolutions));
        let cost = Cost {
            access: Access::Sparse,
            alpha: tau.with(alpha),
            tau,
            block_qubits: walk.row_and_column - system,
            gates_until_measured_2k: evolution.measured().clone(),
            evolution,
            half_calls,
            queries: Some(queries.clone()),
        };
        LeastCost { cost, queries }
    }

    /// A number that depends on the grid. It is an estimate where the entries are extrapolated.
    fn of_grid(&self, number: LabelledNumber) -> LabelledNumber {
        let Some(how) = self.entries.extrapolated else { return number };
        number.times(&LabelledNumber::estimate(1.0, how))
    }

    /// The cost by a circuit. Its register of modes has all wavenumbers.
    fn by_circuit(
        &self,
        circuit: &CircuitAccess<'_>,
        requirements: &EvolutionRequirements,
        evolutions: &[LabelledNumber; 2],
    ) -> Cost {
        let CircuitAccess { transport, weights, levels } = *circuit;
        let modes = circuit.modes(requirements, self.skew);
        let access = match weights {
            ModeWeights::Sum => Access::Circuit(levels),
            ModeWeights::Rotations => Access::Rotated(levels),
        };
        let [call, controlled] =
            *self.counts.borrow_mut().entry((requirements.points, access)).or_insert_with(|| {
                [false, true].map(|controlled| transport.encode(modes, levels, controlled).counts())
            });
        let alpha = transport.alpha(modes, levels);
        let [alpha, tau] =
            [alpha, alpha * self.time].map(|x| self.of_grid(LabelledNumber::exact(x)));
        let a_gate = self.of_grid(LabelledNumber::emitted(1.0));
        let evolution = WalkCost::new(&tau, &requirements.tolerance);
        let tolerance = requirements.tolerance.or_zero();
        let costs = |counts: SequenceCounts| counts.cost(self.synthesis, tolerance, evolutions);
        let both = [&call, &controlled];
        let forward = tau.or_zero();
        let whole = costs(SequenceCounts::whole(&evolution, &controlled, &a_gate));
        Cost {
            access,
            block_qubits: controlled.block_qubits,
            gates_until_measured_2k: whole.measured().clone(),
            evolution: whole,
            half_calls: costs(SequenceCounts::both_ways(&evolution, forward, both, &a_gate)),
            queries: None,
            alpha,
            tau,
        }
    }
}
