//! The task and all methods as a table, and sentences on them.

use crate::base::table::ColumnValues;
use crate::base::text::choice_text;
use crate::quantum::cost::Cost;
use crate::quantum::cost::table::CostTable;
use crate::quantum::labelled_number::{LabelledNumber, Trust};
use crate::quantum::optimise::ranking::profile_text;
use crate::study::end_to_end::methods::{
    ClassicalMethod, DegreeCost, EndToEnd, QuantumMethod, QuantumName,
};
use crate::study::grids::shape_text;
use crate::study::order::orders_text;
use serde_json::Value;
use std::fmt;

/// Sentences on the cheapest methods, of a density that is `share` of the mean one.
pub(super) fn verdict(
    quantum: &[QuantumMethod],
    classical: &[ClassicalMethod],
    share: f64,
) -> Vec<String> {
    let gates = |way: &QuantumMethod| way.gates_until_measured.value();
    let known: Vec<(&QuantumMethod, f64)> =
        quantum.iter().filter_map(|way| Some((way, gates(way)?))).collect();
    let seconds = |method: &ClassicalMethod| method.seconds.or_infinite();
    let fastest = classical.iter().min_by(|a, b| seconds(a).total_cmp(&seconds(b)));
    let mut lines = Vec::new();
    if share < 1.0 {
        lines.push(format!(
            "warning: the density is {share:.1e} of the mean one, and the error of a grid is that \
             of the whole density: relative to this one it may be {:.1e} times as large",
            share.recip()
        ));
    }
    if let Some((best, least)) = known.iter().min_by(|a, b| a.1.total_cmp(&b.1)) {
        lines.push(format!("fewest gates: {}", choice_text(&best.name)));
        for (way, gates) in known.iter().filter(|(way, _)| way.name != best.name) {
            lines.push(format!("{}: {:.1e} times as many", choice_text(&way.name), gates / least));
        }
    }
    for (way, _) in known {
        let (Some(seconds), Some(baseline)) = (way.physical.seconds.value(), fastest) else {
            continue;
        };
        let classical = baseline.seconds.or_nan();
        let wins = if seconds < classical { "wins" } else { "does not win" };
        let pace = way.physical.seconds.because().unwrap_or_default();
        lines.push(format!(
            "{} {wins} against {}: {seconds:.1e} s ({pace}; assumed), {classical:.1e} s",
            choice_text(&way.name),
            choice_text(&baseline.name)
        ));
    }
    lines
}

/// A number of a quantum method; `None` if it has none.
type NumberOf = fn(&QuantumMethod) -> Option<&LabelledNumber>;

impl EndToEnd {
    /// A column of values: `quantum` of each quantum method, then `classical` of each other one.
    fn values(
        &self,
        name: &str,
        quantum: impl Fn(&QuantumMethod) -> Value,
        classical: impl Fn(&ClassicalMethod) -> Value,
    ) -> ColumnValues {
        let quantum = self.quantum.iter().map(quantum);
        ColumnValues::new(name, quantum.chain(self.classical.iter().map(classical)))
    }

    /// A column of labelled numbers: `quantum` of each quantum method, then `classical` of each
    /// other one. Without a number the label is empty.
    fn numbers(
        &self,
        name: &str,
        quantum: NumberOf,
        classical: fn(&ClassicalMethod) -> LabelledNumber,
    ) -> ColumnValues {
        let none = LabelledNumber::unavailable("");
        let quantum = self.quantum.iter().map(|way| quantum(way).unwrap_or(&none));
        let classical: Vec<LabelledNumber> = self.classical.iter().map(classical).collect();
        LabelledNumber::column(name, quantum.chain(&classical))
    }

    /// The columns of a table: a row a way with a quantum computer, then one a classical method.
    pub fn columns(&self) -> Vec<ColumnValues> {
        let words = |name: &str, word: fn(&QuantumMethod) -> Value| {
            self.values(name, word, |_| Value::Null)
        };
        let quantum = |name: &str, number: NumberOf| {
            self.numbers(name, number, |_| LabelledNumber::unavailable(""))
        };
        vec![
            self.values(
                "way",
                |way| choice_text(&way.name).into(),
                |method| choice_text(&method.name).into(),
            ),
            Trust::Estimate.of_column(words("grid", |way| {
                way.grids.last().map(|grid| shape_text(grid)).into()
            })),
            self.values("degree", |way| way.degree.into(), |method| method.degree.into()),
            Trust::Estimate.of_column(words("order", |way| way.order.into())),
            words("profile", |way| way.profile.as_ref().map(profile_text).into()),
            quantum("recovery", |way| Some(&way.recovery)),
            quantum("points", |way| Some(&way.points)),
            quantum("tolerance", |way| Some(&way.tolerance)),
            quantum("walk_tolerance", |way| Some(&way.walk_tolerance)),
            words("access", |way| way.cost.as_ref().map(|cost| cost.access.to_string()).into()),
            quantum("alpha", |way| Some(&way.cost.as_ref()?.alpha)),
            quantum("steps", |way| Some(&way.cost.as_ref()?.evolution.steps)),
            quantum("toffoli_a_step", |way| Some(&way.cost.as_ref()?.evolution.toffoli_a_step)),
            quantum("rotations_a_step", |way| Some(&way.cost.as_ref()?.evolution.rotations_a_step)),
            quantum("toffoli", |way| Some(&way.toffoli)),
            quantum("gates", |way| Some(&way.cost.as_ref()?.evolution.gates)),
            quantum("half_calls_steps", |way| Some(&way.cost.as_ref()?.half_calls.steps)),
            quantum("half_calls_gates", |way| Some(&way.cost.as_ref()?.half_calls.gates)),
            quantum("qubits", |way| Some(&way.cost.as_ref()?.evolution.qubits)),
            quantum("probability", |way| Some(&way.probability)),
            quantum("evolutions", |way| Some(&way.evolutions)),
            quantum("gates_until_measured", |way| Some(&way.gates_until_measured)),
            quantum("gates_until_measured_2k", |way| {
                Some(&way.cost.as_ref()?.gates_until_measured_2k)
            }),
            quantum("physical_qubits", |way| Some(&way.physical.physical_qubits)),
            Trust::Model.of_column(words("code_distance", |way| way.physical.code_distance.into())),
            self.numbers("cells_or_traces", |_| None, ClassicalMethod::labelled_size),
            self.numbers(
                "seconds",
                |way| Some(&way.physical.seconds),
                |method| method.seconds.clone(),
            ),
            quantum("queries", |way| Some(&way.cost.as_ref()?.queries.as_ref()?.queries)),
        ]
    }
}

impl QuantumMethod {
    /// The name of its flux, for a grid method. The table of costs has no room for a longer name.
    fn short_name(&self) -> &'static str {
        match self.name {
            QuantumName::Unitary => "unitary",
            QuantumName::Dissipative | QuantumName::OverCharacteristics => "upwind",
        }
    }

    /// The grids with their errors, the one needed, and how degree and profile were chosen there.
    fn grid_lines(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        for (grid, error) in self.grids.iter().zip(&self.errors) {
            writeln!(f, "  {:<24}relative L1 error of the density {error:.3e}", shape_text(grid))?;
        }
        if let (Some(order), Some(grid)) = (self.order, self.grids.last()) {
            let shown = orders_text(&self.orders);
            writeln!(
                f,
                "  {:<24}needed (order of the error: {order:.2}; from grid to grid {shown})",
                shape_text(grid)
            )?;
        }
        if let Some(remark) = &self.order_remark {
            writeln!(f, "  {remark}")?;
        }
        if self.cost.is_some() {
            let profile = self.profile.as_ref().map(profile_text);
            let degree = self.degree.unwrap_or_default();
            let profile = profile.unwrap_or_else(|| "none: one mode, no p".to_owned());
            writeln!(f, "  {:<24}{degree}\n  {:<24}{profile}", "degree", "profile")?;
        }
        Ok(())
    }
}

impl fmt::Display for QuantumMethod {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        writeln!(f, "{}", choice_text(&self.name).to_uppercase())?;
        // Degrees that have no number for the same reason are in one line.
        let alike =
            |a: &DegreeCost, b: &DegreeCost| a.why_not().is_some() && a.why_not() == b.why_not();
        for degrees in self.degrees.chunk_by(alike) {
            degrees_line(f, degrees)?;
        }
        self.grid_lines(f)?;
        if let Some(segments) = self.segments {
            writeln!(
                f,
                "  {:<24}{segments:>12}  estimate: the most of 1000 traces",
                "segments of a trace"
            )?;
        }
        // A reason that several numbers share is given once, that of the degrees above.
        let mut last = self.degrees.first().and_then(DegreeCost::why_not);
        for (name, figure) in [
            ("recovery point p", &self.recovery),
            ("points in p, N_p", &self.points),
            ("tolerance of f", &self.tolerance),
            ("tolerance of evolution", &self.walk_tolerance),
            ("probability", &self.probability),
            ("evolutions", &self.evolutions),
            ("gates, as Toffoli", &self.gates_until_measured),
            ("physical qubits", &self.physical.physical_qubits),
            ("seconds", &self.physical.seconds),
        ] {
            if figure.value().is_none() && figure.because() == last {
                continue;
            }
            last = figure.because();
            writeln!(f, "  {name:<24}{figure}")?;
        }
        Ok(())
    }
}

impl DegreeCost {
    /// The reason why this degree has no number of gates, if it has none.
    fn why_not(&self) -> Option<&str> {
        let known = self.grid.is_some() && self.order.is_some() && self.gates.value().is_some();
        (!known).then(|| self.gates.because().unwrap_or_default())
    }
}

/// A line of a degree, or of several that have no number for one reason.
fn degrees_line(f: &mut fmt::Formatter<'_>, degrees: &[DegreeCost]) -> fmt::Result {
    let Some(one) = degrees.first() else { return Ok(()) };
    let name = match degrees {
        [first, .., last] => format!("degrees {} to {}", first.degree, last.degree),
        _ => format!("degree {}", one.degree),
    };
    write!(f, "  {name:<24}")?;
    match (&one.grid, one.order, one.gates.value()) {
        (Some(grid), Some(order), Some(gates)) => {
            writeln!(f, "order {order:.2}, {} needed, {gates:.1e} gates", shape_text(grid))
        }
        _ => writeln!(f, "unavailable: {}", one.why_not().unwrap_or_default()),
    }
}

impl fmt::Display for EndToEnd {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        writeln!(
            f,
            "{}: the density at {:?}, {:.4e}, to {:e} of it\n",
            self.title, self.point, self.density, self.accuracy
        )?;
        for way in &self.quantum {
            writeln!(f, "{way}")?;
        }
        let rows: Vec<(&str, &Cost)> = (self.quantum.iter())
            .filter_map(|way| Some((way.short_name(), way.cost.as_ref()?)))
            .collect();
        if !rows.is_empty() {
            writeln!(f, "{}", CostTable(rows))?;
        }
        writeln!(f, "CLASSICAL")?;
        for ClassicalMethod { name, degree, size, seconds } in &self.classical {
            let size = size.map_or("-".to_owned(), |size| format!("{size:.2e}"));
            let degree = degree.map_or(String::new(), |degree| format!(", degree {degree}"));
            writeln!(
                f,
                "  {:<37}{size:>10} {:<7}{seconds}",
                format!("{}{degree}", choice_text(name)),
                name.unit()
            )?;
        }
        writeln!(f)?;
        self.verdict.iter().try_for_each(|line| writeln!(f, "{line}"))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// A way without a number says why once, whatever number of degrees it has.
    #[test]
    fn a_reason_is_said_once() {
        let degree = |degree: usize, why: &str| DegreeCost {
            degree,
            order: None,
            grid: None,
            gates: LabelledNumber::unavailable(why),
        };
        let text = |reasons: [&str; 3]| {
            let degrees = (0..3).map(|k| degree(k, reasons[k])).collect();
            let way = QuantumMethod::unavailable(QuantumName::Unitary, reasons[0]);
            QuantumMethod { degrees, ..way }.to_string()
        };
        let why = "no isometry";
        let shown = text([why; 3]);
        assert_eq!(shown.matches(why).count(), 1, "{shown}");
        assert!(shown.contains("degrees 0 to 2") && shown.contains("unavailable"), "{shown}");
        assert_eq!(shown.lines().count(), 2, "{shown}");
        let shown = text([why, why, "errors do not fall"]);
        assert_eq!(shown.matches(why).count(), 1, "{shown}");
        assert!(shown.contains("degrees 0 to 1") && shown.contains("degree 2 "), "{shown}");
        // Without degrees it is that of the first number.
        let shown = QuantumMethod::unavailable(QuantumName::Unitary, why).to_string();
        assert_eq!(shown.matches(why).count(), 1, "{shown}");
    }
}
