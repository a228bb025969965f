//! One cost model: Toffoli gates until the field is measured, of every access to `H`.
//!
//! ```text
//! cost = (calls of a block encoding in e^{−iHT}) × (Toffoli gates of a call) × (1/P or 2r + 1)
//! ```
//!
//! A block encoding of `H/α` takes `2K` calls for `τ = αT` (see [`walk`](crate::quantum::walk)).
//!
//! | access | `α` | Toffoli gates of a call |
//! |---|---|---|
//! | sparse | `d‖H‖_max` | model: `n + m log₂(m)²` for each of 6 calls of the oracles |
//! | [circuit](crate::quantum::circuit) | of the circuit | counted, with the reflection |
//!
//! Of `S = 0`, the unitary scheme, `H = iK` is one mode, which is the field: `P = 1`.

use crate::base::table::ColumnValues;
use crate::matrix::bounds::Bounds;
use crate::problem::case::Case;
use crate::quantum::access::LargestEntries;
use crate::quantum::circuit::gates::GateCounts;
use crate::quantum::circuit::scene::{self, Bins, CircuitCase};
use crate::quantum::circuit::transport::{CaseTransport, CircuitModes, Levels};
use crate::quantum::labelled_number::LabelledNumber;
use crate::quantum::resources::regime::gates_factor;
use crate::quantum::walk::{LOCATION_CALLS, VALUE_CALLS, WalkCost, WalkRegisters};
use serde::Serialize;
use std::cell::RefCell;
use std::collections::HashMap;
use std::fmt;

/// How a quantum computer has `H`.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize)]
#[serde(rename_all = "kebab-case")]
pub enum Access {
    /// Sparse access, by oracles of the rows of `H`.
    Sparse,
    /// A compiled circuit with this register of levels.
    Circuit(Levels),
}

impl fmt::Display for Access {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.pad(match self {
            Self::Sparse => "sparse access",
            Self::Circuit(Levels::Hadamard) => "circuit",
            Self::Circuit(Levels::Uniform) => "circuit, uniform",
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
    /// `2K`: calls of the block encoding in an evolution.
    pub steps: LabelledNumber,
    /// Toffoli gates of a call and its reflection.
    pub toffoli_a_step: LabelledNumber,
    /// Toffoli gates of an evolution.
    pub toffoli: LabelledNumber,
    /// T gates of an evolution, beside the Toffoli gates and without those of rotations.
    pub t: LabelledNumber,
    /// Rotations of an evolution, phases of the sequence included.
    pub rotations: LabelledNumber,
    /// All qubits.
    pub qubits: LabelledNumber,
    /// Ancillas among the qubits, which are zero before and after.
    pub ancillas: LabelledNumber,
    /// Toffoli gates until the field is measured: repeated, and by amplitude amplification.
    pub until_measured: [LabelledNumber; 2],
}

impl Cost {
    /// The lower of both; infinite where there is none.
    pub fn least(&self) -> f64 {
        self.until_measured.iter().filter_map(LabelledNumber::value).fold(f64::INFINITY, f64::min)
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
    /// Counts of controlled circuits, by the qubits of `p`.
    counts: RefCell<HashMap<(usize, Levels), GateCounts>>,
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
    ) -> Self {
        let time = case.duration();
        let scene = scene::refuse(case)
            .and_then(|()| CircuitCase::new(case, Bins::Within(rounding / time)))
            .map(|scene| scene.transport)
            .map_err(|error| error.to_string());
        let counts = RefCell::default();
        Self { time, entries, qubits, skew: bounds.is_skew(), transport: scene, counts }
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
        self.transport.iter().flat_map(move |transport| {
            [Levels::Hadamard, Levels::Uniform]
                .map(|levels| self.by_circuit(transport, levels, demand, evolutions))
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
        let evolution = WalkCost::new(alpha * self.time, demand.tolerance);
        let of_p = if self.skew { 0 } else { demand.points.trailing_zeros() as usize };
        let system = self.qubits + of_p;
        let gates = gates_factor(system as f64, f64::from(evolution.bits));
        let a_step = LabelledNumber::model((LOCATION_CALLS + VALUE_CALLS) * gates, GATES);
        let walk = WalkRegisters::new(system, evolution.bits);
        let steps = label(1.0).times(&evolution.steps);
        let toffoli = steps.times(&a_step);
        Cost {
            access: Access::Sparse,
            alpha: label(alpha),
            tau: label(alpha * self.time),
            until_measured: evolutions.each_ref().map(|n| n.times(&toffoli)),
            toffoli,
            toffoli_a_step: a_step,
            t: LabelledNumber::unavailable("no circuit of the oracles is compiled"),
            rotations: steps.with(steps.value().unwrap_or_default() + 1.0),
            qubits: walk.total,
            ancillas: walk.arithmetic,
            steps,
        }
    }

    /// A circuit, whose register of modes has all wavenumbers.
    fn by_circuit(
        &self,
        transport: &CaseTransport,
        levels: Levels,
        demand: &EvolutionRequirements,
        evolutions: &[LabelledNumber; 2],
    ) -> Cost {
        let modes = match self.skew {
            true => CircuitModes::One(0.0),
            false => CircuitModes::Register {
                qubits: demand.points.trailing_zeros() as usize,
                period: demand.period,
            },
        };
        let counted = *self
            .counts
            .borrow_mut()
            .entry((demand.points, levels))
            .or_insert_with(|| transport.encode(modes, levels, true).counts());
        let alpha = transport.alpha(modes, levels);
        let WalkCost { steps, .. } = WalkCost::new(alpha * self.time, demand.tolerance);
        let all = |count: usize| steps.times(&LabelledNumber::emitted(count as f64));
        let toffoli = all(counted.toffoli_a_step());
        let rotations = all(counted.rotations_a_step());
        Cost {
            access: Access::Circuit(levels),
            alpha: LabelledNumber::exact(alpha),
            tau: LabelledNumber::exact(alpha * self.time),
            toffoli_a_step: LabelledNumber::emitted(counted.toffoli_a_step() as f64),
            until_measured: evolutions.each_ref().map(|n| n.times(&toffoli)),
            toffoli,
            t: all(counted.t),
            rotations: rotations.with(rotations.value().unwrap_or_default() + 1.0),
            qubits: LabelledNumber::emitted(counted.qubits as f64),
            ancillas: LabelledNumber::emitted(counted.scratch_qubits as f64),
            steps,
        }
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
            figures("steps", |cost| &cost.steps),
            figures("toffoli_a_step", |cost| &cost.toffoli_a_step),
            figures("toffoli", |cost| &cost.toffoli),
            figures("t", |cost| &cost.t),
            figures("rotations", |cost| &cost.rotations),
            figures("qubits", |cost| &cost.qubits),
            figures("until_measured_repeated", |cost| &cost.until_measured[0]),
            figures("until_measured_amplified", |cost| &cost.until_measured[1]),
        ]
    }
}

impl fmt::Display for CostTable<'_> {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        writeln!(
            f,
            "{:<27}{:>11}{:>9}{:>10}{:>11}{:>12}{:>11}{:>7}",
            "", "alpha", "steps", "Toffoli", "evolution", "repeated", "amplified", "qubits"
        )?;
        for (name, cost) in &self.0 {
            writeln!(
                f,
                "{:<27}{:>11}{:>9}{:>10}{:>11}{:>12}{:>11}{:>7}",
                format!("{name}, {}", cost.access),
                cost.alpha.marked(),
                cost.steps.marked(),
                cost.toffoli_a_step.marked(),
                cost.toffoli.marked(),
                cost.until_measured[0].marked(),
                cost.until_measured[1].marked(),
                cost.qubits.marked(),
            )?;
        }
        writeln!(
            f,
            "x exact, g exact (emitted gates), b upper bound, m model or estimate; Toffoli: of a \
             step; repeated, amplified: Toffoli gates until the field is measured"
        )
    }
}
