//! The record in the formats of other programs: Azure's resource estimator and QREF.

use crate::quantum::circuit::formats::{LogicalCounts, NOTE, logical_counts, ports, resource};
use crate::quantum::cost::{Access, Cost};
use crate::quantum::labelled_number::LabelledNumber;
use crate::quantum::resources::ResourceCounts;
use serde_json::{Map, Value, json};

const T_OF_ROTATION: &str = "The estimator makes rotations of logicalCounts of T gates by a \
                             formula of its own. tOfRotation chose the set-up and the access; \
                             tOfRotations has the T gates that follow from it";
const SYNTHESIZED: &str = "synthesizedCounts has them in tCount, and no rotations";

impl ResourceCounts {
    /// The access to `H` that takes the fewest gates until the field is measured, by the sequence
    /// whose rotations are computed.
    fn least_by_full_sequence(&self) -> &Cost {
        let gates = |cost: &Cost| cost.evolution.least();
        let least = self.by_access.costs.iter().min_by(|a, b| gates(a).total_cmp(&gates(b)));
        least.expect("sparse access has a cost")
    }

    /// The counts of an evolution for Azure's resource estimator, as `LogicalCounts`. They are
    /// those of emitted gates or, where no circuit is compiled, those that are known. Unknown
    /// counts stand beside them with the reason, since the estimator takes an absent count for
    /// zero.
    pub fn logical_counts(&self) -> Value {
        let cost = self.least_by_full_sequence();
        if cost.access == Access::Sparse {
            return self.counts_of_oracles(cost);
        }
        let count = |figure: &LabelledNumber| figure.value().map(|n| n as u64);
        let evolution = &cost.evolution;
        let counts = LogicalCounts {
            qubits: count(&evolution.qubits),
            toffoli: count(&evolution.toffoli),
            t: count(&evolution.t),
            rotations: count(&evolution.rotations),
        };
        let of_rotations = count(&evolution.t_of_rotations());
        let synthesized = LogicalCounts {
            t: counts.t.zip(of_rotations).map(|(t, of_rotations)| t + of_rotations),
            rotations: Some(0),
            ..counts
        };
        json!({
            "logicalCounts": logical_counts(&counts),
            "synthesizedCounts": logical_counts(&synthesized),
            "tOfRotations": of_rotations,
            "trust": {
                "a step": cost.evolution.toffoli_a_step.trust(),
                "steps": cost.evolution.steps.trust(),
            },
            "access": cost.access,
            "tOfRotation": self.by_access.t_of_rotation,
            "note": format!("{}. {T_OF_ROTATION}: {SYNTHESIZED}", NOTE),
        })
    }

    /// Counts of sparse access, which costs `sparse`.
    fn counts_of_oracles(&self, sparse: &Cost) -> Value {
        let qubits = self.qubits.walk.total.value().map(|n| n as u64);
        let rotations = self.walk_steps.value().map(|steps| steps as u64 + 1);
        let of_rotations = sparse.evolution.t_of_rotations().value();
        let not_compiled = self.by_access.no_circuit.as_deref();
        json!({
            "logicalCounts": {
                "numQubits": qubits,
                "rotationCount": rotations,
                "rotationDepth": rotations,
            },
            "oracleCalls": {
                "location": self.queries.location_queries.value(),
                "value": self.queries.value_queries.value(),
                "total": self.queries.queries.value(),
            },
            "toffoli": sparse.evolution.toffoli,
            "tOfRotations": of_rotations.map(|t| t as u64),
            "unavailable": {
                "tCount": not_compiled,
                "cczCount": not_compiled,
                "ccixCount": not_compiled,
                "measurementCount": "depends on what is read",
            },
            "tOfRotation": self.by_access.t_of_rotation,
            "note": format!(
                "phases of the walk's sequence only: what the estimator makes of it is without the \
                 oracles, whose absent counts it takes for zero. {T_OF_ROTATION}"
            ),
        })
    }

    /// A program of QREF v1 for one access to `H`: the routines of the algorithm, their registers
    /// and what is known of each. `meta` has the labels of the numbers.
    pub fn qref(&self) -> Value {
        let system = self.qubits.total - self.qubits.p;
        let gates = self.transform_gates.value().map(|x| self.transform_gates.with(0.5 * x));
        let transform = |name: &str| {
            let ports = ports("p", self.qubits.p);
            let figures: Vec<_> = gates.iter().map(|gates| ("gates_estimate", gates)).collect();
            routine(name, "transform_in_p", &ports, &figures)
        };
        let least = self.least_by_full_sequence();
        let (kind, figures) = match least.access {
            Access::Sparse => ("sparse_access_walk", self.of_oracles(least)),
            Access::Circuit(_) | Access::Rotated(_) => ("qubitization", of_circuit(least)),
        };
        let ports = [ports("system", system), ports("p", self.qubits.p)].concat();
        // Transforms reuse the qubits of the evolution: a peak is no sum.
        let all = [("qubits", &least.evolution.qubits)];
        let mut program = routine("schrodingerization", "quantum_algorithm", &ports, &all);
        program["children"] = json!([
            transform("qft"),
            routine("hamiltonian_simulation", kind, &ports, &figures),
            transform("inverse_qft"),
        ]);
        program["connections"] = json!([
            "in_p -> qft.in_p",
            "in_system -> hamiltonian_simulation.in_system",
            "qft.out_p -> hamiltonian_simulation.in_p",
            "hamiltonian_simulation.out_p -> inverse_qft.in_p",
            "hamiltonian_simulation.out_system -> out_system",
            "inverse_qft.out_p -> out_p",
        ]);
        json!({ "version": "v1", "program": program })
    }

    /// The figures of an evolution by sparse access, which costs `sparse`.
    fn of_oracles<'a>(&'a self, sparse: &'a Cost) -> Vec<(&'static str, &'a LabelledNumber)> {
        vec![
            ("walk_steps", &self.walk_steps),
            ("location_queries", &self.queries.location_queries),
            ("value_queries", &self.queries.value_queries),
            ("queries", &self.queries.queries),
            ("qubits", &self.qubits.walk.total),
            ("toffoli_model", &sparse.evolution.toffoli),
        ]
    }
}

/// The figures of an evolution by a circuit.
fn of_circuit(cost: &Cost) -> Vec<(&'static str, &LabelledNumber)> {
    let evolution = &cost.evolution;
    vec![
        ("calls", &evolution.steps),
        ("toffoli", &evolution.toffoli),
        ("t", &evolution.t),
        ("rotations", &evolution.rotations),
        ("qubits", &evolution.qubits),
    ]
}

/// A routine without children.
fn routine(name: &str, kind: &str, ports: &[Value], figures: &[(&str, &LabelledNumber)]) -> Value {
    let known = || figures.iter().filter(|(_, figure)| figure.value().is_some());
    let labels: Map<String, Value> =
        known().map(|(name, figure)| ((*name).to_owned(), json!(figure.trust()))).collect();
    let resources: Vec<Value> =
        known().map(|(name, figure)| resource(name, figure.value(), "additive")).collect();
    json!({
        "name": name,
        "type": kind,
        "ports": ports,
        "resources": resources,
        "meta": { "labels": labels },
    })
}
