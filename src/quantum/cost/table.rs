//! Costs as a table.

use crate::base::table::{Column, ColumnValues, in_pieces};
use crate::quantum::cost::Cost;
use crate::quantum::labelled_number::LabelledNumber;
use crate::quantum::walk::OracleQueries;
use std::fmt;

/// A table of costs, each by its name.
pub struct CostTable<'a>(pub Vec<(&'a str, &'a Cost)>);

impl CostTable<'_> {
    /// The columns of the table, a row for each cost.
    pub fn columns(&self) -> Vec<ColumnValues> {
        let figures = |name: &str, figure: fn(&Cost) -> &LabelledNumber| {
            LabelledNumber::column(name, self.0.iter().map(|(_, cost)| figure(cost)))
        };
        let none = OracleQueries::unavailable("a circuit calls no oracles");
        let queries = self.0.iter().map(|(_, cost)| cost.queries.as_ref().unwrap_or(&none));
        let columns = [
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
            figures("gates_until_measured_2k", |cost| &cost.gates_until_measured_2k),
        ];
        columns.into_iter().chain(OracleQueries::columns(queries)).collect()
    }
}

impl fmt::Display for CostTable<'_> {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        if self.0.is_empty() {
            return Ok(());
        }
        // Gates of a model are no whole numbers.
        let whole = |figure: &LabelledNumber, digits: usize| {
            figure.with(figure.or_zero().round()).marked_to(digits)
        };
        let figures = |name: &str, digits: usize, figure: fn(&Cost) -> &LabelledNumber| {
            Column::new(name, self.0.iter().map(|(_, cost)| whole(figure(cost), digits)))
        };
        let names = || self.0.iter().map(|(name, cost)| format!("{name}, {}", cost.access));
        let columns = [
            figures("alpha", 3, |cost| &cost.alpha),
            figures("steps", 3, |cost| &cost.evolution.steps),
            figures("Toffoli", 3, |cost| &cost.evolution.toffoli_a_step),
            figures("rot.", 3, |cost| &cost.evolution.rotations_a_step),
            figures("whole", 2, |cost| &cost.evolution.gates),
            figures("halved", 2, |cost| &cost.half_calls.gates),
            figures("measured", 3, Cost::measured),
            figures("qb.", 3, |cost| &cost.cheaper().qubits),
        ];
        f.write_str(&in_pieces(&Column::of_words("", names()), &columns))?;
        writeln!(
            f,
            "x exact, g exact (emitted gates), b upper bound, m model or estimate. Toffoli, rot.: \
             Toffoli gates and rotations of a step. whole: gates of an evolution of 2K steps, in \
             Toffoli gates (4 T gates are one; T gates of rotations are a model). halved: the same \
             by about half as many steps. measured: until the result is measured, the cheapest \
             way. qb.: qubits"
        )?;
        writeln!(
            f,
            "Gates until the result is measured, by 2K steps, whose rotations are computed and \
             exported, and by half as many, whose rotations are not:"
        )?;
        let indented = Column::of_words("", names().map(|name| format!("  {name}")));
        let sequences = [
            figures("2K steps", 3, |cost| &cost.gates_until_measured_2k),
            figures("half as many", 3, |cost| cost.half_calls.measured()),
        ];
        f.write_str(&in_pieces(&indented, &sequences))
    }
}
