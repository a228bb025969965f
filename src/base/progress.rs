//! Progress output of rank 0: a bar on a terminal, a line every few seconds otherwise.

use crate::base::log::eprint_wrapped;
use indicatif::{ProgressBar, ProgressDrawTarget, ProgressFinish, ProgressStyle};
use std::io::IsTerminal;
use std::time::{Duration, Instant};

/// Seconds between lines where there is no terminal.
const SECONDS_BETWEEN_LINES: f64 = 5.0;
/// Seconds to go from which a remedy is printed.
const LONG: f64 = 60.0;

/// Progress of a rank's work, in units of its modelled cost.
pub struct Progress {
    bar: Option<ProgressBar>,
    prints: bool,
    name: &'static str,
    /// A sentence on how to avoid the work, until it is printed.
    remedy: Option<&'static str>,
    done: usize,
    total: usize,
    started: Instant,
    last: Instant,
}

impl Progress {
    /// Progress of `total` units of work, called `name`; only the rank that `prints` shows it.
    pub fn new(prints: bool, name: &'static str, total: usize) -> Self {
        let bar = (prints && std::io::stderr().is_terminal()).then(|| {
            let style = ProgressStyle::with_template("{msg} {wide_bar} {percent}% ETA {eta}");
            ProgressBar::with_draw_target(Some(total as u64), ProgressDrawTarget::stderr())
                .with_style(style.unwrap_or_else(|_| ProgressStyle::default_bar()))
                .with_message(name)
                .with_finish(ProgressFinish::AndClear)
        });
        let now = Instant::now();
        Self { bar, prints, name, remedy: None, done: 0, total, started: now, last: now }
    }

    /// This progress, with a sentence that is printed once if the work takes minutes.
    pub fn with_remedy(self, remedy: &'static str) -> Self {
        Self { remedy: Some(remedy), ..self }
    }

    /// Progress that is not shown.
    pub fn silent() -> Self {
        Self::new(false, "", 0)
    }

    /// Counts `work` more units as done.
    pub fn advance(&mut self, work: usize) {
        self.done += work;
        if let Some(bar) = &self.bar {
            bar.set_position(self.done as u64);
        }
        let is_due = self.last.elapsed() > Duration::from_secs_f64(SECONDS_BETWEEN_LINES);
        if !self.prints || !is_due || self.done == 0 {
            return;
        }
        self.last = Instant::now();
        let fraction = self.done as f64 / self.total.max(1) as f64;
        let left = self.started.elapsed().as_secs_f64() * (1.0 / fraction - 1.0);
        if self.bar.is_none() {
            eprint_wrapped(&format!("{} {:.0} %, {left:.0} s to go", self.name, 100.0 * fraction));
        }
        if let Some(remedy) = self.due_remedy(left) {
            match &self.bar {
                Some(bar) => bar.suspend(|| eprint_wrapped(remedy)),
                None => eprint_wrapped(remedy),
            }
        }
    }

    /// The remedy if `left` seconds are long, once.
    fn due_remedy(&mut self, left: f64) -> Option<&'static str> {
        self.remedy.take_if(|_| left > LONG)
    }

    /// Counts `work` units as done in all, if they are more than those before.
    pub fn advance_to(&mut self, work: usize) {
        self.advance(work.saturating_sub(self.done));
    }

    /// Removes the bar.
    pub fn finish(&self) {
        if let Some(bar) = &self.bar {
            bar.finish_and_clear();
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_remedy_is_given_once_and_for_long_work_only() {
        let mut progress = Progress::silent().with_remedy("less");
        let given = [10.0, 100.0, 1000.0].map(|left| progress.due_remedy(left));
        assert_eq!(given, [None, Some("less"), None]);
        assert_eq!(Progress::silent().due_remedy(1e9), None);
    }
}
