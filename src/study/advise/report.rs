//! Advice as text.

use crate::base::text::{
    ALGORITHM_ERROR, GRID_ERROR, bytes_text, count_text, counted, quoted, seconds_text,
};
use crate::problem::case::{Case, Method};
use crate::problem::grid::SPACE_NAMES;
use crate::results::accuracy::{STAIRCASE, hides_staircase};
use crate::study::advise::reached_grid::Evidence;
use crate::study::advise::setups::{AdviceReport, ErrorParts, NotCompared, SetupReport};
use crate::study::budget::BudgetClock;
use crate::study::grids::{cells, shape_text};
use crate::study::order::{Order, orders_text};
use std::fmt;

/// Largest number of unknowns of a grid whose shape is printed.
pub const MOST_SHOWN: f64 = 1e15;

/// A grid as text: `128 x 128 = 16384 cells`; of a degree above 0 `26 x 26 elements = 16900
/// unknowns`.
pub fn grid_text(shape: &[usize], degree: usize) -> String {
    let all = cells(shape) * ((degree + 1) as f64).powi(shape.len() as i32);
    if all > MOST_SHOWN {
        return "more than 1e15 unknowns".to_owned();
    }
    let (shape, all) = (shape_text(shape), count_text(all));
    match degree {
        0 => format!("{shape} = {all} cells"),
        _ => format!("{shape} elements = {all} unknowns"),
    }
}

/// Orders by pairs of grids as text, coarsest first.
fn pairs(order: &Order) -> String {
    match &order.pairs[..] {
        [] => "one pair of grids".to_owned(),
        pairs => orders_text(pairs),
    }
}

/// The note of advice by counted work.
const COUNTED: &str =
    "--reproducible: all times are those of the counted work on one average core, not of here";

/// Warnings about the set-ups `entries`, which were found by `clock`.
pub fn warnings(case: &Case, entries: &[SetupReport], clock: BudgetClock) -> Vec<String> {
    let mut warnings = Vec::new();
    if clock == BudgetClock::Updates {
        warnings.push(COUNTED.to_owned());
    }
    let can = || entries.iter().filter(|e| e.refused.is_none());
    let unsettled: Vec<String> = can()
        .filter(|e| !e.order.settled && e.known == Evidence::Extrapolated)
        .map(|e| format!("{} ({})", e.name, pairs(&e.order)))
        .collect();
    if !unsettled.is_empty() {
        warnings.push(format!(
            "the order of convergence has not settled: the lower of the last two orders is used \
             where errors fall, and the grid may be finer or coarser than necessary: {}",
            unsettled.join("; ")
        ));
    }
    if hides_staircase(case) {
        warnings.push(STAIRCASE.to_owned());
    }
    for (axis, name) in SPACE_NAMES.into_iter().enumerate() {
        if can().any(|e| e.moved_edges.contains(&axis)) {
            let error = match case.exact {
                Some(_) => "which is part of the error",
                None => "which the estimated error does not include",
            };
            warnings.push(format!(
                "no grid nearby has faces on all edges of V across {name}; they are moved to the \
                 nearest faces, {error}"
            ));
        }
    }
    if case.readout.is_some() {
        let what = "readout.cells are cells of the case's own grid: on another grid they lie at \
                    other places, or do not exist";
        warnings.push(what.to_owned());
    }
    warnings
}

/// A warning if the set-up `best` takes longer than the `budget`, and some were not compared as it
/// does not hold two of their grids.
pub fn may_be_slow(best: &SetupReport, entries: &[SetupReport], budget: f64) -> Option<String> {
    let seconds = best.seconds.filter(|seconds| *seconds > budget)?;
    let others = NotCompared::of(entries)?.text();
    let time = seconds_text(seconds);
    Some(format!("{} takes about {time}, longer than the budget, and {others}", best.name))
}

fn evidence(known: Evidence) -> &'static str {
    match known {
        Evidence::Measured => "measured",
        Evidence::Estimated => "estimated from a grid twice as fine",
        Evidence::Extrapolated => "extrapolated",
    }
}

/// An error with the evidence for it and its parts.
fn error_text(error: f64, known: Evidence, of: &ErrorParts) -> String {
    format!("{error:.2e}, {}: {}", evidence(known), parts(of))
}

fn parts(parts: &ErrorParts) -> String {
    let mut text = match parts.space.zip(parts.velocity) {
        Some((space, velocity)) => format!("{GRID_ERROR} in x {space:.1e}, in v {velocity:.1e}"),
        None => format!("{GRID_ERROR} {:.1e} (x and v not measured apart)", parts.discretisation),
    };
    let others = [
        (format!("{ALGORITHM_ERROR} at most"), parts.schrodingerization),
        ("error of the implicit step".to_owned(), parts.step),
        ("error of the readout".to_owned(), parts.readout),
    ];
    for (name, part) in others {
        if let Some(part) = part {
            text += &format!(", {name} {part:.1e}");
        }
    }
    text
}

impl SetupReport {
    /// Name, grid, error, and `--set` options, on two lines.
    pub fn summary(&self) -> String {
        let set: String =
            self.settings.iter().map(|set| format!(" --set {}", quoted(set))).collect();
        let (grid, how) = (grid_text(&self.shape, self.degree), evidence(self.known));
        format!("{}, {grid}, error {:.1e} ({how})\n {set}", self.name, self.error)
    }
}

fn entry(f: &mut fmt::Formatter<'_>, entry: &SetupReport) -> fmt::Result {
    writeln!(f, "{}", entry.name)?;
    if let Some(reason) = &entry.refused {
        return writeln!(f, "  not advised: {reason}");
    }
    if let Some(why) = &entry.estimate {
        writeln!(f, "  an estimate, not advice: {why}")?;
    }
    let computed = if entry.computed_cells < entry.cells {
        format!(", {} of them computed", count_text(entry.computed_cells))
    } else {
        String::new()
    };
    let tolerance = entry.tolerance.map_or(String::new(), |t| format!(", tolerance {t:e}"));
    writeln!(f, "  grid    {}{computed}{tolerance}", grid_text(&entry.shape, entry.degree))?;
    writeln!(f, "  error   {}", error_text(entry.error, entry.known, &entry.parts))?;
    let settled = if entry.order.settled { "settled" } else { "not settled" };
    writeln!(f, "  order   {:.2}, {settled} ({})", entry.order.order, pairs(&entry.order))?;
    let seconds = entry.seconds.map_or("unknown time".to_owned(), seconds_text);
    let how = match (entry.seconds_counted, entry.seconds_measured) {
        (true, _) => "counted",
        (false, true) => "measured",
        (false, false) => "from trials",
    };
    writeln!(
        f,
        "  cost    {} applications, {seconds} ({how}), {} a rank",
        entry.applications,
        bytes_text(entry.memory_bytes_per_rank as u64)
    )?;
    writeln!(f, "  {}", entry.command)
}

impl fmt::Display for AdviceReport {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        writeln!(f, "{}", self.title)?;
        let against = if self.exact {
            "against the exact solution"
        } else {
            "by Richardson's extrapolation: no exact solution is named"
        };
        writeln!(
            f,
            "Relative L1 error of the density at most {:e}, on {}; errors are {against}.",
            self.accuracy,
            counted(self.ranks, "rank", "ranks")
        )?;
        if let Some(given) = &self.given {
            let grid = grid_text(&given.shape, given.degree);
            writeln!(f, "\nThe case as it stands: {grid}")?;
            writeln!(f, "  error   {}", error_text(given.error, given.known, &given.parts))?;
        }
        for (method, how) in
            [(Method::Schrodingerized, "by modes"), (Method::Classical, "classically")]
        {
            if let Some(best) = self.best_of(method) {
                write!(f, "\nAdvised {how}: ")?;
                entry(f, best)?;
            } else {
                let why = self.why_nothing(method);
                writeln!(f, "\nNothing is advised {how}: {why}.")?;
            }
        }
        writeln!(f, "\nAll that was tried, quickest first:\n")?;
        for one in &self.entries {
            entry(f, one)?;
        }
        for left_out in &self.left_out {
            writeln!(f, "left out: {left_out}")?;
        }
        for warning in &self.warnings {
            writeln!(f, "warning: {warning}")?;
        }
        Ok(())
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Parts that are not known apart are not printed as two halves.
    #[test]
    fn inseparable_parts_are_reported() {
        let together = parts(&ErrorParts::of_discretisation(0.026, None));
        assert_eq!(together, "error of the grid 2.6e-2 (x and v not measured apart)");
        let apart = parts(&ErrorParts::of_discretisation(0.026, Some(1.0)));
        assert_eq!(apart, "error of the grid in x 2.6e-2, in v 0.0e0");
    }
}
