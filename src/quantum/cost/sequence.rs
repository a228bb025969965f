//! The cost of an evolution by a sequence of calls: `2K` steps, or about half as many forward and
//! back.

use crate::quantum::circuit::gates::GateCounts;
use crate::quantum::labelled_number::LabelledNumber;
use crate::quantum::synthesis::{RotationSynthesis, T_OF_TOFFOLI_STATE};
use crate::quantum::walk::{WalkCost, WalkRegisters, calls_both_ways};
use serde::Serialize;

/// The cost of `e^{−iHT}` by a sequence of calls, and of the measurement of the field.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct SequenceCost {
    /// Calls of the block encoding in an evolution.
    pub steps: LabelledNumber,
    /// Toffoli gates of a call and its reflection.
    pub toffoli_a_step: LabelledNumber,
    /// Rotations of a call, and of the sequence in that step.
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
    /// Toffoli gates alone until the field is measured: repeated, and by amplitude amplification.
    pub toffoli_until_measured: [LabelledNumber; 2],
    /// Toffoli gates until the field is measured, by the former name of the field, which scripts
    /// read.
    until_measured: [LabelledNumber; 2],
    /// All `gates` until the field is measured: repeated, and by amplitude amplification.
    pub gates_until_measured: [LabelledNumber; 2],
    /// The number of qubits of the sequence, all in use at once.
    pub qubits: LabelledNumber,
    /// Ancillas among the qubits, which are zero before and after.
    pub ancillas: LabelledNumber,
}

pub(in crate::quantum) struct SequenceCounts {
    pub steps: LabelledNumber,
    toffoli_a_step: LabelledNumber,
    rotations_a_step: LabelledNumber,
    /// Toffoli gates of an evolution, with those that its ends have in addition.
    pub toffoli: LabelledNumber,
    pub t: LabelledNumber,
    pub rotations: LabelledNumber,
    pub qubits: LabelledNumber,
    ancillas: LabelledNumber,
}

impl SequenceCounts {
    /// The cost of these counts. Rotations are made of T gates by `synthesis`, for an evolution
    /// that is exact to `tolerance`. `evolutions` are those until the field is measured: repeated,
    /// and by amplitude amplification.
    pub(super) fn cost(
        self,
        synthesis: RotationSynthesis,
        tolerance: f64,
        evolutions: &[LabelledNumber; 2],
    ) -> SequenceCost {
        let Self { steps, toffoli_a_step, rotations_a_step, toffoli, t, rotations, .. } = self;
        let t_a_rotation = synthesis.t_of_each(rotations.or_zero(), tolerance);
        let all_t = t.or_zero() + rotations.or_zero() * t_a_rotation.or_zero();
        // Of the least trust of the factors.
        let gates = toffoli.times(&t_a_rotation);
        let gates = gates.with(toffoli.or_zero() + all_t / T_OF_TOFFOLI_STATE);
        let toffoli_until_measured = evolutions.each_ref().map(|n| n.times(&toffoli));
        SequenceCost {
            until_measured: toffoli_until_measured.clone(),
            toffoli_until_measured,
            gates_until_measured: evolutions.each_ref().map(|n| n.times(&gates)),
            steps,
            toffoli_a_step,
            rotations_a_step,
            toffoli,
            t,
            rotations,
            t_a_rotation,
            gates,
            qubits: self.qubits,
            ancillas: self.ancillas,
        }
    }
}

impl SequenceCost {
    /// Gates until the field is measured, repeated or amplified, whichever is fewer.
    pub fn measured(&self) -> &LabelledNumber {
        LabelledNumber::lower_of(&self.gates_until_measured)
    }

    /// T gates of all rotations of an evolution.
    pub fn t_of_rotations(&self) -> LabelledNumber {
        self.rotations.times(&self.t_a_rotation)
    }

    /// Gates until the field is measured, repeated or amplified, the fewer of both; infinite where
    /// there is no number.
    pub fn least(&self) -> f64 {
        LabelledNumber::least(&self.gates_until_measured)
    }
}

/// Controlled calls at the ends of a sequence of steps forward and back.
const CALLS_AT_ENDS: f64 = 2.0;
/// Rotations of the sequence's qubit in a step forward or back: its series is complex.
const ROTATIONS_BOTH_WAYS: usize = 2;

impl SequenceCounts {
    /// The counts of `2K` calls of a `controlled` circuit, whose counts have the label of `a_gate`.
    pub(in crate::quantum) fn whole(
        evolution: &WalkCost,
        controlled: &GateCounts,
        a_gate: &LabelledNumber,
    ) -> Self {
        let steps = evolution.steps.clone();
        let emitted = |count: usize| a_gate.with(count as f64);
        let all = |count: usize| steps.times(&emitted(count));
        let rotations = all(controlled.rotations_a_step());
        Self {
            toffoli_a_step: emitted(controlled.toffoli_a_step()),
            rotations_a_step: emitted(controlled.rotations_a_step()),
            toffoli: all(controlled.toffoli_a_step()),
            t: all(controlled.t),
            rotations: rotations.with(rotations.or_zero() + 1.0),
            qubits: emitted(controlled.qubits_of_sequence()),
            ancillas: emitted(controlled.ancillas_of_sequence()),
            steps,
        }
    }

    /// The counts of `d` calls of a circuit between two reflections, and of two controlled calls.
    pub(super) fn both_ways(
        evolution: &WalkCost,
        tau: f64,
        [call, controlled]: [&GateCounts; 2],
        a_gate: &LabelledNumber,
    ) -> Self {
        let steps = steps_both_ways(evolution, tau);
        let emitted = |count: usize| a_gate.with(count as f64);
        let count = steps.or_zero() - CALLS_AT_ENDS;
        let all = |of_call: usize, of_end: usize| {
            steps.with(count * of_call as f64 + CALLS_AT_ENDS * of_end as f64)
        };
        let a_step = call.toffoli + call.toffoli_of_reflection();
        let rotations = call.rotations + ROTATIONS_BOTH_WAYS;
        Self {
            toffoli_a_step: emitted(a_step),
            rotations_a_step: emitted(rotations),
            qubits: emitted(controlled.qubits_of_sequence()),
            ancillas: emitted(controlled.ancillas_of_sequence()),
            toffoli: steps.with(call.toffoli_both_ways(controlled, count)),
            t: all(call.t, controlled.t),
            rotations: all(rotations, controlled.rotations + 1),
            steps,
        }
    }

    /// The counts by sparse access: of `2K` calls, and of about half as many forward and back.
    /// Toffoli gates are `a_step` for each step, from a model. Rotations are those of the
    /// sequences: the model includes those of the oracles.
    pub(super) fn of_oracles(
        evolution: &WalkCost,
        tau: &LabelledNumber,
        a_step: &LabelledNumber,
        walk: &WalkRegisters,
    ) -> [Self; 2] {
        let both_ways = steps_both_ways(evolution, tau.or_zero());
        let whole = evolution.steps.clone();
        [(whole, 1.0), (both_ways, ROTATIONS_BOTH_WAYS as f64)].map(|(steps, each)| Self {
            qubits: walk.total.clone(),
            ancillas: walk.arithmetic.clone(),
            toffoli: steps.times(a_step),
            toffoli_a_step: a_step.clone(),
            rotations_a_step: LabelledNumber::exact(each),
            t: LabelledNumber::unavailable("no circuit of the oracles is compiled"),
            rotations: steps.with(each * steps.or_zero() + 1.0),
            steps,
        })
    }
}

/// `d + 2`: the calls of a sequence of steps forward and back.
fn steps_both_ways(evolution: &WalkCost, tau: f64) -> LabelledNumber {
    const WHY: &str = "d + 2 calls, d the least odd number from K and tau on (Berry and others \
                       2024); the rotations of this sequence are not computed";
    let degree = evolution.degree.or_zero();
    LabelledNumber::model(calls_both_ways(degree, tau) + CALLS_AT_ENDS, WHY)
}
