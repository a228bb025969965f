//! A circuit as a program of OpenQASM 3, and its counts in the formats of other programs.

use crate::quantum::circuit::description::{CircuitDescription, EvolutionDescription};
use crate::quantum::circuit::gates::{Circuit, GateParts};
use serde_json::{Value, json};
use std::fmt::Write;

/// `circuit` in OpenQASM 3, with the gates of `stdgates.inc`, and a title if it has one.
pub fn qasm(circuit: &Circuit, title: Option<&str>) -> String {
    let mut text = "OPENQASM 3.0;\ninclude \"stdgates.inc\";\n".to_owned();
    if let Some(title) = title {
        let _ = writeln!(text, "// {}", title.replace(['\n', '\r'], " "));
    }
    let mut names = Vec::with_capacity(circuit.qubits());
    for register in &circuit.registers {
        let _ = writeln!(text, "qubit[{}] {};", register.size, register.name);
        names.extend((0..register.size).map(|bit| format!("{}[{bit}]", register.name)));
    }
    let mut comments = circuit.comments.iter().peekable();
    for (place, gate) in circuit.gates.iter().enumerate() {
        while let Some((_, comment)) = comments.next_if(|comment| comment.0 == place) {
            let _ = writeln!(text, "// {comment}");
        }
        let GateParts { name, angle, qubits } = gate.parts();
        text += name;
        if let Some(angle) = angle {
            let _ = write!(text, "({angle:?})");
        }
        for (place, &q) in qubits.iter().enumerate() {
            text += if place == 0 { " " } else { ", " };
            text += &names[q];
        }
        text += ";\n";
    }
    text
}

/// The parts that the counts of an evolution do not include.
pub const NOTE: &str = "the evolution alone: neither the preparation of the state, nor the two \
                        transforms in p, nor what is read";

/// Counts of a whole evolution.
#[derive(Clone, Copy, Debug)]
pub struct LogicalCounts {
    /// Number of qubits.
    pub qubits: Option<u64>,
    /// Number of Toffoli gates.
    pub toffoli: Option<u64>,
    /// Number of T gates beside them.
    pub t: Option<u64>,
    /// Number of rotations.
    pub rotations: Option<u64>,
}

/// `LogicalCounts` of Azure's resource estimator.
pub fn logical_counts(counts: &LogicalCounts) -> Value {
    json!({
        "numQubits": counts.qubits,
        "tCount": counts.t,
        "rotationCount": counts.rotations,
        "rotationDepth": counts.rotations,
        "cczCount": counts.toffoli,
        "ccixCount": 0,
        "measurementCount": 0,
    })
}

/// `LogicalCounts` of the evolution by a circuit.
pub fn azure(description: &CircuitDescription) -> Value {
    let EvolutionDescription { toffoli, t, rotations, qubits, .. } = description.evolution;
    let count = |n: usize| Some(n as u64);
    let counts = LogicalCounts {
        qubits: count(qubits),
        toffoli: count(toffoli),
        t: count(t),
        rotations: count(rotations),
    };
    json!({ "logicalCounts": logical_counts(&counts), "note": NOTE })
}

/// QREF v1: the evolution, and one call of the circuit in it.
pub fn qref(description: &CircuitDescription) -> Value {
    let call = &description.controlled;
    let system = description.counts.system_qubits;
    let EvolutionDescription { steps, toffoli, t, rotations, qubits, .. } = description.evolution;
    let ports = ports("system", system);
    json!({
        "version": "v1",
        "program": {
            "name": "hamiltonian_simulation",
            "type": "qubitization",
            "ports": ports,
            "children": [{
                "name": "block_encoding",
                "type": "controlled_interface",
                "ports": ports,
                "resources": resources("additive", &[
                    ("toffoli", call.toffoli),
                    ("t", call.t),
                    ("rotations", call.rotations),
                    ("cnot", call.cnot),
                    ("qubits", call.qubits),
                ]),
            }],
            "connections": [
                "in_system -> block_encoding.in_system",
                "block_encoding.out_system -> out_system",
            ],
            "resources": resources("other", &[
                ("calls", steps),
                ("toffoli", toffoli),
                ("t", t),
                ("rotations", rotations),
                ("qubits", qubits),
            ]),
        },
    })
}

/// The counts of a routine, of this kind.
fn resources(kind: &str, counts: &[(&str, usize)]) -> Vec<Value> {
    counts.iter().map(|&(name, count)| resource(name, count as f64, kind)).collect()
}

/// The two ports of a register of `size` qubits.
pub fn ports(register: &str, size: usize) -> [Value; 2] {
    let port = |prefix: &str, direction: &str| {
        let name = format!("{prefix}_{register}");
        json!({"name": name, "size": size, "direction": direction})
    };
    [port("in", "input"), port("out", "output")]
}

/// A resource of a routine; unknown ones have no value. Qubits are a kind of their own, since those
/// of consecutive routines do not add up.
pub fn resource(name: &str, value: impl Into<Option<f64>>, kind: &str) -> Value {
    let value: Option<f64> = value.into();
    let kind = if name == "qubits" { name } else { kind };
    json!({"name": name, "type": kind, "value": value})
}
