//! The record in the formats of other programs: Azure's resource estimator and QREF.

use crate::quantum::circuit;
use crate::quantum::circuit::formats::LogicalCounts;
use crate::quantum::cost::{Access, Cost};
use crate::quantum::labelled_number::LabelledNumber;
use crate::quantum::resources::Record;
use serde_json::{Value, json};

impl Record {
    /// The access to `H` that takes the fewest gates until the field is measured, by the sequence
    /// whose rotations are computed.
    fn least(&self) -> Option<&Cost> {
        let gates = |cost: &Cost| cost.evolution.least();
        self.costs.iter().reduce(|best, next| if gates(next) < gates(best) { next } else { best })
    }

    /// The same, if its gates are emitted.
    fn emitted(&self) -> Option<&Cost> {
        self.least().filter(|cost| cost.access != Access::Sparse)
    }

    /// For Azure's resource estimator, of an evolution: `LogicalCounts` of emitted gates, or, where
    /// no circuit is compiled, as far as they are known. What is not known stands beside them with
    /// the reason, since the estimator takes an absent count for zero.
    pub fn logical_counts(&self) -> Value {
        let Some(cost) = self.emitted() else { return self.counts_of_oracles() };
        let count = |figure: &LabelledNumber| figure.value().map(|n| n as u64);
        json!({
            "logicalCounts": circuit::formats::logical_counts(&LogicalCounts {
                qubits: count(&cost.qubits),
                toffoli: count(&cost.evolution.toffoli),
                t: count(&cost.evolution.t),
                rotations: count(&cost.evolution.rotations),
            }),
            "trust": "exact (emitted gates) a step, times the steps of a series that is cut",
            "access": cost.access,
            "note": circuit::formats::NOTE,
        })
    }

    /// Counts of sparse access.
    fn counts_of_oracles(&self) -> Value {
        let model = self.least().map(|cost| &cost.evolution.toffoli);
        let qubits = self.qubits.walk.total.value().map(|n| n as u64);
        let rotations = self.walk_steps.value().map(|steps| steps as u64 + 1);
        let not_compiled = self.no_circuit.as_deref();
        json!({
            "logicalCounts": {
                "numQubits": qubits,
                "rotationCount": rotations,
                "rotationDepth": rotations,
            },
            "oracleCalls": {
                "location": self.location_queries.value(),
                "value": self.value_queries.value(),
                "total": self.queries.value(),
            },
            "toffoli": model,
            "unavailable": {
                "tCount": not_compiled,
                "cczCount": not_compiled,
                "ccixCount": not_compiled,
                "measurementCount": "depends on what is read",
            },
            "note": "phases of the walk's sequence only: what the estimator makes of it is \
                     without the oracles, whose absent counts it takes for zero",
        })
    }

    /// As a program of QREF v1: the routines of the algorithm, their registers and what is known of
    /// each.
    pub fn qref(&self) -> Value {
        let system = self.qubits.total - self.qubits.p;
        let half = self.transform_gates.value().map(|x| LabelledNumber::bound(0.5 * x));
        let transform = |name: &str| {
            let gates = half.as_ref().and_then(|x| resource("gates_estimate", x));
            json!({
                "name": name,
                "type": "transform_in_p",
                "ports": ports("p", self.qubits.p),
                "resources": Vec::from_iter(gates),
            })
        };
        let emitted = self.emitted();
        let kind = if emitted.is_some() { "qubitization" } else { "sparse_access_walk" };
        let ports = [ports("system", system), ports("p", self.qubits.p)].concat();
        json!({
            "version": "v1",
            "program": {
                "name": "schrodingerization",
                "ports": ports,
                "children": [
                    transform("qft"),
                    {
                        "name": "hamiltonian_simulation",
                        "type": kind,
                        "ports": ports,
                        "resources": self.simulation_resources(emitted),
                    },
                    transform("inverse_qft"),
                ],
                "connections": [
                    "in_p -> qft.in_p",
                    "in_system -> hamiltonian_simulation.in_system",
                    "qft.out_p -> hamiltonian_simulation.in_p",
                    "hamiltonian_simulation.out_p -> inverse_qft.in_p",
                    "hamiltonian_simulation.out_system -> out_system",
                    "inverse_qft.out_p -> out_p",
                ],
            },
        })
    }

    /// The cost of the simulation of the Hamiltonian: queries of the model, and gates of the
    /// circuit where one is `emitted`.
    fn simulation_resources(&self, emitted: Option<&Cost>) -> Vec<Value> {
        let mut figures = vec![
            ("walk_steps", &self.walk_steps),
            ("location_queries", &self.location_queries),
            ("value_queries", &self.value_queries),
            ("queries", &self.queries),
        ];
        if let Some(cost) = emitted {
            figures.extend([
                ("calls", &cost.evolution.steps),
                ("toffoli", &cost.evolution.toffoli),
                ("t", &cost.evolution.t),
                ("rotations", &cost.evolution.rotations),
                ("qubits", &cost.qubits),
            ]);
        } else if let Some(cost) = self.least() {
            figures.push(("toffoli_model", &cost.evolution.toffoli));
        }
        figures.into_iter().filter_map(|(name, figure)| resource(name, figure)).collect()
    }
}

/// The two ports of a register of `size` qubits.
fn ports(register: &str, size: usize) -> [Value; 2] {
    let port = |prefix: &str, direction: &str| {
        let name = format!("{prefix}_{register}");
        json!({"name": name, "size": size, "direction": direction})
    };
    [port("in", "input"), port("out", "output")]
}

/// A figure as a resource, if it has a number.
fn resource(name: &str, figure: &LabelledNumber) -> Option<Value> {
    let value = figure.value()?;
    Some(json!({"name": name, "type": "additive", "value": value}))
}
