//! Costs as a table.

use crate::base::table::ColumnValues;
use crate::quantum::cost::Cost;
use crate::quantum::labelled_number::LabelledNumber;
use std::fmt;

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
            figures("qubits", |cost| &cost.evolution.qubits),
            figures("half_calls_qubits", |cost| &cost.half_calls.qubits),
            figures("toffoli_until_measured_repeated", |cost| {
                &cost.evolution.toffoli_until_measured[0]
            }),
            figures("toffoli_until_measured_amplified", |cost| {
                &cost.evolution.toffoli_until_measured[1]
            }),
            figures("until_measured_repeated", |cost| &cost.cheaper().gates_until_measured[0]),
            figures("until_measured_amplified", |cost| &cost.cheaper().gates_until_measured[1]),
            figures("gates_until_measured", Cost::measured),
        ]
    }
}

impl fmt::Display for CostTable<'_> {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        writeln!(
            f,
            "{:<26}{:>10}{:>10}{:>8}{:>9}{:>10}{:>10}{:>11}{:>6}",
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
                "{:<26}{:>10}{:>10}{:>8}{:>9}{:>10}{:>10}{:>11}{:>6}",
                format!("{name}, {}", cost.access),
                cost.alpha.marked(),
                evolution.steps.marked(),
                whole(&evolution.toffoli_a_step),
                evolution.rotations_a_step.marked(),
                evolution.gates.marked(),
                half_calls.gates.marked(),
                cost.measured().marked(),
                cost.cheaper().qubits.marked(),
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
