//! Advice as people read it.

use super::{Advised, Entry, Known, Order, Parts};
use crate::plan::bytes_text;
use crate::run::calibrate::seconds_text;
use std::fmt;

/// `128 x 128`.
pub fn shape(shape: &[usize]) -> String {
    let cells: Vec<String> = shape.iter().map(usize::to_string).collect();
    cells.join(" x ")
}

/// Orders by pairs of grids, coarsest first.
pub fn pairs(order: &Order) -> String {
    if order.pairs.is_empty() {
        return "one pair of grids".to_owned();
    }
    let pairs: Vec<String> = order.pairs.iter().map(|q| format!("{q:.2}")).collect();
    pairs.join(", ")
}

fn known(known: Known) -> &'static str {
    match known {
        Known::Measured => "measured",
        Known::Estimated => "estimated from a grid twice as fine",
        Known::Extrapolated => "extrapolated",
    }
}

fn parts(parts: &Parts) -> String {
    let mut text = format!(
        "discretisation in x {:.1e}, in v {:.1e}",
        parts.space, parts.velocity
    );
    let others = [
        ("Schrödingerization", parts.schrodingerization),
        ("implicit step", parts.step),
        ("readout", parts.readout),
    ];
    for (name, part) in others {
        if let Some(part) = part {
            text += &format!(", {name} {part:.1e}");
        }
    }
    text
}

fn entry(f: &mut fmt::Formatter<'_>, entry: &Entry) -> fmt::Result {
    writeln!(f, "{}", entry.name)?;
    if let Some(reason) = &entry.refused {
        return writeln!(f, "  cannot be had: {reason}");
    }
    let tolerance = entry
        .tolerance
        .map_or(String::new(), |t| format!(", tolerance {t:e}"));
    writeln!(
        f,
        "  grid    {} = {:.3e} cells{tolerance}",
        shape(&entry.shape),
        entry.cells
    )?;
    writeln!(
        f,
        "  error   {:.2e}, {}: {}",
        entry.error,
        known(entry.known),
        parts(&entry.parts)
    )?;
    let settled = if entry.order.settled {
        "settled"
    } else {
        "not settled"
    };
    writeln!(
        f,
        "  order   {:.2}, {settled} ({})",
        entry.order.order,
        pairs(&entry.order)
    )?;
    let seconds = entry
        .seconds
        .map_or("unknown time".to_owned(), seconds_text);
    let how = if entry.seconds_measured {
        "measured"
    } else {
        "from trials"
    };
    writeln!(
        f,
        "  cost    {} applications, {seconds} ({how}), {} a rank",
        entry.applications,
        bytes_text(entry.memory_bytes_per_rank as u64)
    )?;
    writeln!(f, "  {}", entry.command)
}

impl fmt::Display for Advised {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        if !self.title.is_empty() {
            writeln!(f, "{}", self.title)?;
        }
        let against = if self.exact {
            "against the exact solution"
        } else {
            "by Richardson's extrapolation: no exact solution is named"
        };
        writeln!(
            f,
            "Relative L1 error of the density at most {:e}, on {} ranks; errors are {against}.",
            self.accuracy, self.ranks
        )?;
        if let Some(given) = &self.given {
            writeln!(f, "\nThe case as it stands: {}", shape(&given.shape))?;
            writeln!(
                f,
                "  error   {:.2e}, {}: {}",
                given.error,
                known(given.known),
                parts(&given.parts)
            )?;
        }
        if let Some(best) = self.best.and_then(|k| self.entries.get(k)) {
            write!(f, "\nAdvised: ")?;
            entry(f, best)?;
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
