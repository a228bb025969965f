//! The log of a run: warnings, lines for the user, seconds by step.

use crate::base::log::eprint_wrapped;
use crate::base::stopwatch::Stopwatch;
use crate::parallel::communicator::World;
use crate::plan::Plan;
use crate::run::warnings::opening_line;

/// Warnings and seconds of a run. Rank 0 prints lines if the run writes files.
pub(crate) struct RunLog {
    /// Whether this rank prints.
    pub prints: bool,
    /// The warnings so far.
    pub warnings: Vec<String>,
    /// Number of warnings printed so far.
    pub printed: usize,
    /// Seconds by step.
    pub watch: Stopwatch,
}

impl RunLog {
    /// An empty log. Nothing is printed unless the run `writes` files.
    pub fn new(world: &World, writes: bool) -> Self {
        Self {
            prints: writes && world.group().is_first(),
            warnings: Vec::new(),
            printed: 0,
            watch: Stopwatch::start(world.start_seconds),
        }
    }

    /// Prints `line`.
    pub fn line(&self, line: &str) {
        if self.prints {
            eprint_wrapped(line);
        }
    }

    /// Prints the warnings of a plan, and a line that describes the run.
    pub fn open(&mut self, plan: &Plan) {
        let planned = plan.warp.iter().flat_map(|warp| &warp.warnings);
        planned.for_each(|warning| self.warn(warning.clone()));
        self.line(&opening_line(plan));
    }

    /// Records `warning` and prints it. It is called before the solve only.
    pub fn warn(&mut self, warning: String) {
        self.line(&format!("warning: {warning}"));
        self.warnings.push(warning);
        self.printed = self.warnings.len();
    }

    /// Records `warnings`, which are printed after the solve.
    pub fn warn_later(&mut self, warnings: impl IntoIterator<Item = String>) {
        self.warnings.extend(warnings);
    }
}
