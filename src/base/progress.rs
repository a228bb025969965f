//! Progress output of rank 0: a bar on a terminal, a line every few seconds otherwise.

use indicatif::{ProgressBar, ProgressDrawTarget, ProgressFinish, ProgressStyle};
use std::io::IsTerminal;
use std::time::{Duration, Instant};

/// Seconds between lines where there is no terminal.
const SECONDS_BETWEEN_LINES: f64 = 5.0;

/// Progress of a rank's work, in units of its modelled cost.
pub struct Progress {
    bar: Option<ProgressBar>,
    prints: bool,
    name: &'static str,
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
        Self { bar, prints, name, done: 0, total, started: Instant::now(), last: Instant::now() }
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
        } else if self.prints
            && self.last.elapsed() > Duration::from_secs_f64(SECONDS_BETWEEN_LINES)
        {
            self.last = Instant::now();
            let fraction = self.done as f64 / self.total.max(1) as f64;
            let left = self.started.elapsed().as_secs_f64() * (1.0 / fraction - 1.0);
            let line = format!("{} {:.0} %, {left:.0} s to go", self.name, 100.0 * fraction);
            crate::base::log::eprint_wrapped(&line);
        }
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
