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

use crate::base::table::ColumnValues;
use crate::matrix::bounds::Bounds;
use crate::problem::case::Case;
use crate::quantum::access::LargestEntries;
use crate::quantum::circuit::gates::GateCounts;
use crate::quantum::circuit::scene::{self, Bins, CircuitCase};
use crate::quantum::circuit::transport::{CaseTransport, CircuitModes, Levels, ModeWeights};
use crate::quantum::labelled_number::LabelledNumber;
use crate::quantum::resources::regime::gates_factor;
use crate::quantum::synthesis::{RotationSynthesis, T_OF_TOFFOLI_STATE};
use crate::quantum::walk::{LOCATION_CALLS, VALUE_CALLS, WalkCost, WalkRegisters, calls_both_ways};
use serde::Serialize;
use std::cell::RefCell;
use std::collections::HashMap;
use std::fmt;

/// How a quantum computer has `H`.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash, Serialize)]
#[serde(rename_all = "kebab-case")]
pub enum Access {
    /// Sparse access, by oracles of the rows of `H`.
    Sparse,
    /// A compiled circuit with this register of levels.
    Circuit(Levels),
    /// The same, with the weights of each mode by rotations.
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
    /// How `H` is had.
    pub access: Access,
    /// `H/α` is block-encoded.
    pub alpha: LabelledNumber,
    /// `αT`.
    pub tau: LabelledNumber,
    /// By a sequence of `2K` steps, whose rotations are computed.
    #[serde(flatten)]
    pub evolution: SequenceCost,
    /// By steps forward and back, about half as many.
    pub half_calls: SequenceCost,
    /// All qubits.
    pub qubits: LabelledNumber,
    /// Ancillas among the qubits, which are zero before and after.
    pub ancillas: LabelledNumber,
}

/// The cost of `e^{−iHT}` by a sequence of calls, and of the measurement of the field.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct SequenceCost {
    /// Calls of the block encoding in an evolution.
    pub steps: LabelledNumber,
    /// Toffoli gates of a call and its reflection.
    pub toffoli_a_step: LabelledNumber,
    /// Rotations of a call, and of the sequence for it.
    pub rotations_a_step: LabelledNumber,
    /// Toffoli gates of an evolution.
    pub toffoli: LabelledNumber,
    /// T gates of an evolution, beside the Toffoli gates and without those of rotations.
    pub t: LabelledNumber,
    /// Rotations of an evolution, phases of the sequence included.
    pub rotations: LabelledNumber,
    /// T gates that each of these rotations takes.
    pub t_a_rotation: LabelledNumber,
    /// Toffoli gates, T gates and rotations of an evolution, in Toffoli gates.
    pub gates: LabelledNumber,
    /// Toffoli gates until the field is measured: repeated, and by amplitude amplification.
    pub until_measured: [LabelledNumber; 2],
    /// All `gates` until then.
    pub gates_until_measured: [LabelledNumber; 2],
}

/// Counts of a sequence.
struct SequenceCounts {
    steps: LabelledNumber,
    toffoli_a_step: LabelledNumber,
    rotations_a_step: LabelledNumber,
    /// Of an evolution, with what its ends have in addition.
    toffoli: LabelledNumber,
    t: LabelledNumber,
    rotations: LabelledNumber,
}

impl SequenceCounts {
    /// With T gates for the rotations of an evolution that is to be exact to `tolerance`, and with
    /// this many evolutions until the field is measured.
    fn cost(
        self,
        synthesis: RotationSynthesis,
        tolerance: f64,
        evolutions: &[LabelledNumber; 2],
    ) -> SequenceCost {
        let Self { steps, toffoli_a_step, rotations_a_step, toffoli, t, rotations } = self;
        let number = |figure: &LabelledNumber| figure.value().unwrap_or_default();
        let t_a_rotation = synthesis.t_of_each(number(&rotations), tolerance);
        let all_t = number(&t) + number(&rotations) * number(&t_a_rotation);
        // Of the least trust of the factors.
        let gates = toffoli.times(&t_a_rotation);
        let gates = gates.with(number(&toffoli) + all_t / T_OF_TOFFOLI_STATE);
        SequenceCost {
            until_measured: evolutions.each_ref().map(|n| n.times(&toffoli)),
            gates_until_measured: evolutions.each_ref().map(|n| n.times(&gates)),
            steps,
            toffoli_a_step,
            rotations_a_step,
            toffoli,
            t,
            rotations,
            t_a_rotation,
            gates,
        }
    }
}

impl SequenceCost {
    /// Gates until the field is measured, repeated or amplified, the fewer of both; infinite where
    /// there is no number.
    pub fn least(&self) -> f64 {
        let known = self.gates_until_measured.iter().filter_map(LabelledNumber::value);
        known.fold(f64::INFINITY, f64::min)
    }
}

impl Cost {
    /// The sequence with fewer gates.
    pub fn cheaper(&self) -> &SequenceCost {
        match self.half_calls.least() < self.evolution.least() {
            true => &self.half_calls,
            false => &self.evolution,
        }
    }

    /// Its gates until the field is measured.
    pub fn least(&self) -> f64 {
        self.cheaper().least()
    }

    /// The same as a number with its label.
    pub fn measured(&self) -> &LabelledNumber {
        let [repeated, amplified] = &self.cheaper().gates_until_measured;
        match amplified.value() < repeated.value() {
            true => amplified,
            false => repeated,
        }
    }
}

/// Gates until the field is measured by both ways to have the weights of modes in a circuit.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct ModeWeightsCost {
    /// As one sum of signs of bits.
    pub sum: LabelledNumber,
    /// By rotations of each mode.
    pub rotations: LabelledNumber,
    /// The cheaper one.
    pub cheaper: ModeWeights,
}

impl ModeWeightsCost {
    /// Of these costs of a set-up; none without circuits of many modes.
    pub fn of(costs: &[Cost]) -> Option<Self> {
        let least = |wanted: fn(&Access) -> bool| {
            let all = costs.iter().filter(|cost| wanted(&cost.access));
            all.reduce(|a, b| if b.least() < a.least() { b } else { a }).map(Cost::measured)
        };
        let sum = least(|access| matches!(access, Access::Circuit(_)))?;
        let rotations = least(|access| matches!(access, Access::Rotated(_)))?;
        let cheaper = match rotations.value() < sum.value() {
            true => ModeWeights::Rotations,
            false => ModeWeights::Sum,
        };
        Some(Self { sum: sum.clone(), rotations: rotations.clone(), cheaper })
    }
}

/// The time and accuracy of an evolution.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct EvolutionRequirements {
    /// The highest wavenumber that carries something.
    pub highest: f64,
    /// `N_p`, a power of two.
    pub points: usize,
    /// `P`.
    pub period: f64,
    /// Error of the state that it may make.
    pub tolerance: f64,
}

impl EvolutionRequirements {
    /// The demand of the unitary scheme: one mode, and no register of `p`.
    pub fn unitary(tolerance: f64) -> Self {
        Self { highest: 0.0, points: 1, period: 1.0, tolerance }
    }
}

/// The data on which the accesses to a case's `H` depend.
pub struct Accesses {
    time: f64,
    /// The largest entries of `(S, K)`.
    entries: LargestEntries,
    /// Qubits that number the unknowns.
    qubits: usize,
    /// Whether `S = 0`.
    skew: bool,
    /// In whole numbers, for a circuit; or why there is none.
    transport: Result<CaseTransport, String>,
    /// T gates of rotations.
    synthesis: RotationSynthesis,
    /// Counts of circuits, controlled and not, by the qubits of `p`.
    counts: RefCell<HashMap<(usize, Access), [GateCounts; 2]>>,
}

impl Accesses {
    /// For `case` with these bounds and the `entries` of its `(S, K)`. Of the relative error of the
    /// field the rounding of jumps to levels may take `rounding`.
    pub fn new(
        case: &Case,
        bounds: &Bounds,
        entries: LargestEntries,
        qubits: usize,
        rounding: f64,
        synthesis: RotationSynthesis,
    ) -> Self {
        let time = case.duration();
        let scene = scene::refuse(case)
            .and_then(|()| CircuitCase::new(case, Bins::Within(rounding / time)))
            .map(|scene| scene.transport)
            .map_err(|error| error.to_string());
        let counts = RefCell::default();
        Self { time, entries, qubits, skew: bounds.is_skew(), transport: scene, synthesis, counts }
    }

    /// `‖H‖_max` for wavenumbers up to `highest`.
    pub fn largest_entry(&self, highest: f64) -> f64 {
        self.entries.largest(highest)
    }

    /// Why there is no circuit; none where there is one.
    pub fn no_circuit(&self) -> Option<&str> {
        self.transport.as_ref().err().map(String::as_str)
    }

    /// The costs of every access, with this many evolutions until the field is measured: repeated,
    /// and by amplitude amplification.
    pub fn costs(
        &self,
        demand: &EvolutionRequirements,
        evolutions: &[LabelledNumber; 2],
    ) -> Vec<Cost> {
        let sparse = self.by_oracles(demand, evolutions);
        std::iter::once(sparse).chain(self.by_circuits(demand, evolutions)).collect()
    }

    /// Costs by all circuits; none where no circuit is compiled.
    fn by_circuits(
        &self,
        demand: &EvolutionRequirements,
        evolutions: &[LabelledNumber; 2],
    ) -> impl Iterator<Item = Cost> {
        // One mode has one weight.
        let weights = [ModeWeights::Sum, ModeWeights::Rotations];
        let weights = weights.into_iter().filter(|&w| !self.skew || w == ModeWeights::Sum);
        let choices = weights.flat_map(|w| [Levels::Hadamard, Levels::Uniform].map(|l| (w, l)));
        self.transport.iter().flat_map(move |transport| {
            choices.clone().map(move |(weights, levels)| {
                self.by_circuit(transport, weights, levels, demand, evolutions)
            })
        })
    }

    /// The cost by the access that costs least.
    pub fn least(&self, demand: &EvolutionRequirements, evolutions: &[LabelledNumber; 2]) -> Cost {
        let sparse = self.by_oracles(demand, evolutions);
        let circuits = self.by_circuits(demand, evolutions);
        circuits.fold(sparse, |best, next| if next.least() < best.least() { next } else { best })
    }

    /// Sparse access.
    fn by_oracles(&self, demand: &EvolutionRequirements, evolutions: &[LabelledNumber; 2]) -> Cost {
        const GATES: &str = "n + m log2(m)^2 for each of 6 calls of the oracles, constants 1";
        let alpha = self.entries.nonzeros as f64 * self.entries.largest(demand.highest);
        let label = |x: f64| match self.entries.extrapolated {
            None => LabelledNumber::exact(x),
            Some(how) => LabelledNumber::estimate(x, how),
        };
        let tau = alpha * self.time;
        let evolution = WalkCost::new(tau, demand.tolerance);
        let of_p = if self.skew { 0 } else { demand.points.trailing_zeros() as usize };
        let system = self.qubits + of_p;
        let gates = gates_factor(system as f64, f64::from(evolution.bits));
        let a_step = LabelledNumber::model((LOCATION_CALLS + VALUE_CALLS) * gates, GATES);
        let walk = WalkRegisters::new(system, evolution.bits);
        // Phases only: the oracles' rotations are in their model.
        let sequence = |steps: LabelledNumber, each: f64| {
            let count = steps.value().unwrap_or_default();
            SequenceCounts {
                toffoli: steps.times(&a_step),
                toffoli_a_step: a_step.clone(),
                rotations_a_step: LabelledNumber::exact(each),
                t: LabelledNumber::unavailable("no circuit of the oracles is compiled"),
                rotations: steps.with(each * count + 1.0),
                steps,
            }
            .cost(self.synthesis, demand.tolerance, evolutions)
        };
        let steps = label(1.0).times(&evolution.steps);
        let both = steps_both_ways(&evolution, tau);
        let ends = both.with(both.value().unwrap_or_default() + CALLS_AT_ENDS);
        Cost {
            access: Access::Sparse,
            alpha: label(alpha),
            tau: label(tau),
            evolution: sequence(steps, 1.0),
            half_calls: sequence(ends, 2.0),
            qubits: walk.total,
            ancillas: walk.arithmetic,
        }
    }

    /// A circuit, whose register of modes has all wavenumbers.
    fn by_circuit(
        &self,
        transport: &CaseTransport,
        weights: ModeWeights,
        levels: Levels,
        demand: &EvolutionRequirements,
        evolutions: &[LabelledNumber; 2],
    ) -> Cost {
        let EvolutionRequirements { highest, points, period, tolerance } = *demand;
        let qubits = points.trailing_zeros() as usize;
        let (access, modes) = match weights {
            _ if self.skew => (Access::Circuit(levels), CircuitModes::One(0.0)),
            ModeWeights::Sum => {
                (Access::Circuit(levels), CircuitModes::Register { qubits, period })
            }
            ModeWeights::Rotations => {
                (Access::Rotated(levels), CircuitModes::Rotated { qubits, period, highest })
            }
        };
        let [call, controlled] =
            *self.counts.borrow_mut().entry((points, access)).or_insert_with(|| {
                [false, true].map(|controlled| transport.encode(modes, levels, controlled).counts())
            });
        let alpha = transport.alpha(modes, levels);
        let tau = alpha * self.time;
        let evolution = WalkCost::new(tau, tolerance);
        let costs = |counts: SequenceCounts| counts.cost(self.synthesis, tolerance, evolutions);
        Cost {
            access,
            alpha: LabelledNumber::exact(alpha),
            tau: LabelledNumber::exact(tau),
            evolution: costs(whole_sequence(&evolution, &controlled)),
            half_calls: costs(half_sequence(&evolution, tau, &call, &controlled)),
            qubits: LabelledNumber::emitted(controlled.qubits as f64),
            ancillas: LabelledNumber::emitted(controlled.scratch_qubits as f64),
        }
    }
}

/// Controlled calls at the ends of a sequence of steps forward and back.
const CALLS_AT_ENDS: f64 = 2.0;

/// `2K` calls of a `controlled` circuit.
fn whole_sequence(evolution: &WalkCost, controlled: &GateCounts) -> SequenceCounts {
    let steps = evolution.steps.clone();
    let emitted = |count: usize| LabelledNumber::emitted(count as f64);
    let all = |count: usize| steps.times(&emitted(count));
    let rotations = all(controlled.rotations_a_step());
    SequenceCounts {
        toffoli_a_step: emitted(controlled.toffoli_a_step()),
        rotations_a_step: emitted(controlled.rotations_a_step()),
        toffoli: all(controlled.toffoli_a_step()),
        t: all(controlled.t),
        rotations: rotations.with(rotations.value().unwrap_or_default() + 1.0),
        steps,
    }
}

/// `d` of a sequence of steps forward and back.
fn steps_both_ways(evolution: &WalkCost, tau: f64) -> LabelledNumber {
    const WHY: &str = "d + 2 calls, d the least odd number from K and tau on (Berry and others \
                       2024); the rotations of this sequence are not computed";
    let degree = evolution.degree.value().unwrap_or_default();
    LabelledNumber::model(calls_both_ways(degree, tau), WHY)
}

/// `d` calls of a circuit between two reflections, of which neighbouring ones share the qubit that
/// marks the zeros; two controlled calls. A step has two rotations, since its series is complex.
fn half_sequence(
    evolution: &WalkCost,
    tau: f64,
    call: &GateCounts,
    controlled: &GateCounts,
) -> SequenceCounts {
    const ROTATIONS: usize = 2;
    let steps = steps_both_ways(evolution, tau);
    let count = steps.value().unwrap_or_default();
    let all = |of_call: usize, of_end: usize| {
        steps.with(count * of_call as f64 + CALLS_AT_ENDS * of_end as f64)
    };
    let a_step = call.toffoli + call.toffoli_of_reflection();
    SequenceCounts {
        steps: steps.with(count + CALLS_AT_ENDS),
        toffoli_a_step: LabelledNumber::emitted(a_step as f64),
        rotations_a_step: LabelledNumber::emitted((call.rotations + ROTATIONS) as f64),
        toffoli: steps.with(call.toffoli_both_ways(controlled, count)),
        t: all(call.t, controlled.t),
        rotations: all(call.rotations + ROTATIONS, controlled.rotations + 1),
    }
}

/// A table of costs, each by its name.
pub struct CostTable<'a>(pub Vec<(&'a str, &'a Cost)>);

impl CostTable<'_> {
    /// The columns of the table, a row for each cost.
    pub fn columns(&self) -> Vec<ColumnValues> {
        let figures = |name: &str, figure: fn(&Cost) -> &LabelledNumber| {
            LabelledNumber::column(name, self.0.iter().map(|(_, cost)| figure(cost)))
        };
        vec![
            ColumnValues::new("set_up", self.0.iter().map(|&(name, _)| name.into())),
            ColumnValues::new(
                "access",
                self.0.iter().map(|(_, cost)| cost.access.to_string().into()),
            ),
            figures("alpha", |cost| &cost.alpha),
            figures("steps", |cost| &cost.evolution.steps),
            figures("toffoli_a_step", |cost| &cost.evolution.toffoli_a_step),
            figures("rotations_a_step", |cost| &cost.evolution.rotations_a_step),
            figures("toffoli", |cost| &cost.evolution.toffoli),
            figures("t", |cost| &cost.evolution.t),
            figures("rotations", |cost| &cost.evolution.rotations),
            figures("t_a_rotation", |cost| &cost.evolution.t_a_rotation),
            figures("gates", |cost| &cost.evolution.gates),
            figures("half_calls_steps", |cost| &cost.half_calls.steps),
            figures("half_calls_gates", |cost| &cost.half_calls.gates),
            figures("qubits", |cost| &cost.qubits),
            figures("until_measured_repeated", |cost| &cost.evolution.until_measured[0]),
            figures("until_measured_amplified", |cost| &cost.evolution.until_measured[1]),
            figures("gates_until_measured", Cost::measured),
        ]
    }
}

impl fmt::Display for CostTable<'_> {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        writeln!(
            f,
            "{:<26}{:>10}{:>10}{:>9}{:>8}{:>10}{:>10}{:>11}{:>6}",
            "", "alpha", "steps", "Toffoli", "rot.", "evolution", "halved", "measured", "qb."
        )?;
        // Gates of a model are no whole numbers.
        let whole = |figure: &LabelledNumber| match figure.value() {
            Some(value) => figure.with(value.round()).marked(),
            None => figure.marked(),
        };
        for (name, cost) in &self.0 {
            let Cost { evolution, half_calls, .. } = cost;
            writeln!(
                f,
                "{:<26}{:>10}{:>10}{:>9}{:>8}{:>10}{:>10}{:>11}{:>6}",
                format!("{name}, {}", cost.access),
                cost.alpha.marked(),
                evolution.steps.marked(),
                whole(&evolution.toffoli_a_step),
                evolution.rotations_a_step.marked(),
                evolution.gates.marked(),
                half_calls.gates.marked(),
                cost.measured().marked(),
                cost.qubits.marked(),
            )?;
        }
        writeln!(
            f,
            "x exact, g exact (emitted gates), b upper bound, m model or estimate. Toffoli, rot.: \
             Toffoli gates and rotations of a step. evolution: gates of 2K steps, in Toffoli gates \
             (4 T gates are one; T gates of rotations are a model). halved: the same by about half \
             as many steps. measured: until the result is measured, the cheapest way. qb.: qubits"
        )
    }
}
