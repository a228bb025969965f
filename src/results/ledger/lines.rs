//! The lines of a ledger, as `phasewarp run` prints them.

use crate::base::text::{counted, percent, short};
use crate::results::ledger::{AxisJumps, BoxEnd, Ledger, NarrowRegion};

impl Ledger {
    /// The ledger as text: [`lines`](Self::lines) under a heading.
    pub fn text(&self) -> String {
        let lines = self.lines().into_iter().map(|line| format!("  {line}\n"));
        format!("ledger\n{}", lines.collect::<String>())
    }

    /// The lines of the ledger, without those whose numbers are unknown.
    pub fn lines(&self) -> Vec<String> {
        let mut lines: Vec<String> =
            [self.start_line(), self.balance_line()].into_iter().flatten().collect();
        lines.extend(self.ends_lines());
        let found = [self.interface_line(), self.energy_line(), self.regions_line()];
        lines.extend(found.into_iter().flatten());
        lines.extend(self.jumps.iter().map(jump_line));
        lines.extend(self.omitted.iter().map(|why| format!("not known: {why}")));
        lines
    }

    fn start_line(&self) -> Option<String> {
        let formula = self.mass.formula.map(|mass| {
            let error = self.mass.formula_error.unwrap_or(0.0);
            format!("{} by the formula (+- {})", short(mass), short(error))
        });
        let grid = self.mass.initial.map(|mass| format!("{} on the grid", short(mass)));
        let missed = self.missed_by_grid().map(|missed| format!("off by {}", percent(missed)));
        let parts: Vec<String> = formula.into_iter().chain(grid).chain(missed).collect();
        (!parts.is_empty()).then(|| format!("mass at the start: {}", parts.join(", ")))
    }

    fn balance_line(&self) -> Option<String> {
        let end = format!("mass at the end: {}", short(self.mass.end?));
        let parts = [("entered", self.mass.entered), ("lost in all", self.mass.lost)];
        let parts = parts
            .into_iter()
            .filter_map(|(name, mass)| Some(format!(", {name} {}", self.with_share(mass?))));
        Some(end + &parts.collect::<String>())
    }

    /// The total outflow, then that of each end, some ends per line.
    fn ends_lines(&self) -> Vec<String> {
        const ENDS_A_LINE: usize = 4;
        let Some(left) = self.mass.left_estimate else { return Vec::new() };
        let passes = |end: &&BoxEnd| end.outflow + end.outflow_at_jumps != 0.0;
        let part = |end: &BoxEnd| {
            let share = self.share(end.outflow + end.outflow_at_jumps).unwrap_or(0.0);
            format!("{} {} {}", end.axis, end.end, percent(share))
        };
        let parts: Vec<String> = self.ends.iter().filter(passes).map(part).collect();
        let parts = parts.chunks(ENDS_A_LINE).map(|some| format!("  by {}", some.join(", ")));
        let all = format!("leaves, estimated: {}", self.with_share(left));
        [all].into_iter().chain(parts).collect()
    }

    fn interface_line(&self) -> Option<String> {
        let gain = self.mass.interface_estimate.filter(|gain| *gain != 0.0)?;
        let scatter = self.mass.interface_error.map(|error| format!(" +- {}", short(error)));
        let scatter = scatter.unwrap_or_default();
        Some(format!("hat interface adds, estimated: {}{scatter}", self.with_share(gain)))
    }

    fn energy_line(&self) -> Option<String> {
        let kinetic = self.energy.kinetic?;
        let change = |before: Option<f64>, after: f64| {
            before.map_or(String::new(), |before| short(before) + " -> ") + &short(after)
        };
        let kinetic = change(self.energy.kinetic_initial, kinetic);
        let potential = (self.energy.potential)
            .map(|after| format!(", potential {}", change(self.energy.potential_initial, after)));
        Some(format!("energy: kinetic {kinetic}{}", potential.unwrap_or_default()))
    }

    fn regions_line(&self) -> Option<String> {
        let narrowest = self.regions.iter().min_by_key(|region| region.cells)?;
        let NarrowRegion { potential, axis, cells, degree, .. } = narrowest;
        let [one, many] = if *degree == 0 { ["cell", "cells"] } else { ["element", "elements"] };
        let cells = counted(*cells, one, many);
        Some(format!("narrowest region of V: potential.{potential}, {cells} along {axis}"))
    }

    /// A mass, and its share of all mass.
    fn with_share(&self, mass: f64) -> String {
        match self.share(mass) {
            Some(0.0) => "0".to_owned(),
            Some(share) => format!("{} ({})", short(mass), percent(share)),
            None => short(mass),
        }
    }
}

/// The line about the jumps along an axis.
fn jump_line(jump: &AxisJumps) -> String {
    let [least, largest] = [jump.least, jump.largest].map(short);
    let range = if least == largest { largest } else { format!("{least} to {largest}") };
    let mean = jump.mean_energy.map(|mean| format!("mean {}, ", short(mean)));
    format!(
        "jumps of V along {}: {range}; v^2/2 there: {}at most {}",
        jump.axis,
        mean.unwrap_or_default(),
        short(jump.largest_energy)
    )
}
