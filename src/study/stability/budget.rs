//! How long measuring may take. Rank 0's clock decides, and all are told.

use crate::parallel::communicator::{Group, World};
use std::time::{Duration, Instant};

/// Numbers that a trial may update for each second of the budget: a tenth of what a core does.
const UPDATES_PER_SECOND: f64 = 2e7;

/// The time there is.
pub struct Budget {
    world: Group,
    started: Instant,
    limit: Duration,
    /// When the panel at hand is to end.
    end: Duration,
}

impl Budget {
    /// `limit`, from now on.
    pub fn new(world: &World, limit: Duration) -> Self {
        Self {
            world: world.group(),
            started: Instant::now(),
            limit,
            end: limit,
        }
    }

    /// The panel at hand is one of `panels` that are left, among which the time left is shared, what others did not use included; two shares if
    /// it is `cheap`: it seldom uses them up, and may where ranks are slow.
    pub fn share(&mut self, panels: usize, cheap: bool) {
        let now = self.started.elapsed();
        let left = self.limit.saturating_sub(now);
        let shares = if cheap && panels > 1 { 2 } else { 1 };
        self.end = now + left * shares / panels.max(1) as u32;
    }

    /// Whether the panel's time is over. Collective.
    pub fn over(&self) -> bool {
        let over = self.world.rank() == 0 && self.started.elapsed() > self.end;
        self.world.max(f64::from(u8::from(over))) > 0.0
    }

    /// Whether a trial of so many updates is too much; a matter of arithmetic, not of the clock.
    pub fn exceeds(&self, updates: f64) -> bool {
        updates > UPDATES_PER_SECOND * self.limit.as_secs_f64()
    }

    /// Seconds since the start.
    pub fn seconds(&self) -> f64 {
        self.started.elapsed().as_secs_f64()
    }
}
