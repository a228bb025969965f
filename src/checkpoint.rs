//! Checkpoints: what a run has finished, on disk, so that a run that was stopped goes on where it was.
//!
//! The unit is the batch of modes. A checkpoint holds ([`Snapshot`])
//!
//! - which modes of the current stage are finished, and the fixed-point sums of what was read from them: integers, so that it
//!   does not matter in which order, on which ranks or in which of several processes they were added;
//! - the results of finished stages;
//! - of a full run, the modes themselves.
//!
//! ```text
//! DIR/checkpoint/000007/rank-00000.bin …   a file of each rank (see `file`)
//! DIR/checkpoint/000007/manifest.json      sizes and checksums of the files; comes last, under a temporary name first
//! ```
//!
//! A generation without a manifest was not completed and does not count. Two are kept. A run of any number of ranks and any
//! mesh reads what others wrote: sums of mode groups are integers that are added, everything else goes to who has the cells
//! and the modes now; each rank reads what it needs and no more.

pub mod file;
mod store;
pub mod watch;

pub use file::{Destination, KeptDestination};
pub use store::{Generation, Store};

use crate::case::Case;
use crate::output::checksum;
use crate::output::provenance::VERSION;
use crate::plan::WarpPlan;
use num_complex::Complex64;
use serde::{Deserialize, Serialize};

/// What runs share that may go on where the other was stopped, with the same bits.
#[derive(Clone, Debug, PartialEq, Eq, Serialize, Deserialize)]
pub struct Fingerprint {
    /// Version and commit of the program.
    program: String,
    /// Of the text of the case and what was set.
    case: u64,
    /// Of the plan.
    plan: u64,
}

impl Fingerprint {
    /// That of a run. How often it makes checkpoints is not in it.
    pub fn new(case: &Case, warp: &WarpPlan) -> Self {
        let set = case.overrides.iter();
        let set: Vec<&String> = set
            .filter(|o| !o.trim_start().starts_with("checkpoint."))
            .collect();
        let planned = (
            warp.fingerprint(),
            warp.interval,
            &warp.readings,
            &warp.plateau,
        );
        Self {
            program: VERSION.to_owned(),
            case: checksum::of_text(format!("{set:?}\n{}", case.text).as_bytes()),
            plan: checksum::of_text(format!("{planned:?}").as_bytes()),
        }
    }

    /// How `other` differs, if it does.
    fn difference(&self, other: &Self) -> Option<String> {
        if self.program != other.program {
            let (other, own) = (&other.program, &self.program);
            return Some(format!("was written by phasewarp {other}; this is {own}"));
        }
        if self.case != other.case {
            return Some("is of another case, or of other --set options".to_owned());
        }
        (self.plan != other.plan)
            .then(|| "is of another plan, made on a processor of another kind".to_owned())
    }
}

/// What the batches of a mode group tell besides the fields.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct Told {
    /// Largest change of a norm, as a fraction of what is allowed.
    pub defect: Option<f64>,
    /// Smallest `‖w_l(T)‖/‖w_l(0)‖`.
    pub kept: Option<f64>,
    /// Applications.
    pub applications: usize,
    /// Linear systems solved.
    pub solves: usize,
}

impl Told {
    /// Adds what others tell.
    fn add(&mut self, other: &Self) {
        let join = |a: Option<f64>, b: Option<f64>, choose: fn(f64, f64) -> f64| {
            a.into_iter().chain(b).reduce(choose)
        };
        self.defect = join(self.defect, other.defect, f64::max);
        self.kept = join(self.kept, other.kept, f64::min);
        self.applications += other.applications;
        self.solves += other.solves;
    }
}

/// How far a mode group is; or all of them together.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct State {
    /// Number of the stage.
    pub stage: usize,
    /// Its modes that are finished.
    pub finished: Vec<usize>,
    /// What is beyond the leading term of the time step's error, by mode, of the current stage.
    pub beyond: Vec<f64>,
    /// The same of the finished stages, summed.
    pub step_beyond: Vec<f64>,
    /// What the batches told.
    pub told: Told,
}

impl State {
    /// Adds another mode group's.
    fn add(&mut self, other: Self) {
        self.finished.extend(other.finished);
        self.beyond.extend(other.beyond);
        self.told.add(&other.told);
    }
}

/// What a rank keeps of a run.
pub struct Snapshot<'a> {
    /// How far its mode group is.
    pub state: State,
    /// The sums of the current stage, two integers a number, point by point of the space block.
    pub sums: Vec<Numbers<'a, i64>>,
    /// The results of finished stages, point by point of the rank's share.
    pub results: Vec<Numbers<'a, f64>>,
    /// The modes that it keeps, in a full run.
    pub kept: Option<Kept<'a>>,
}

impl Snapshot<'_> {
    /// Bytes of its arrays.
    pub fn bytes(&self) -> usize {
        let sums: usize = self.sums.iter().map(|s| s.values.len()).sum();
        let results: usize = self.results.iter().map(|r| r.values.len()).sum();
        8 * (sums + results + self.kept.as_ref().map_or(0, |kept| 2 * kept.rows.len()))
    }
}

/// Numbers, point by point of a box of space.
#[derive(Clone, Copy)]
pub struct Numbers<'a, T> {
    /// So many at a point.
    pub width: usize,
    /// All of them.
    pub values: &'a [T],
}

/// Modes that are kept.
pub struct Kept<'a> {
    /// The modes.
    pub modes: &'a [usize],
    /// The cell, by its global number, whose auxiliary unknown each row behind the cells is; any number that is none of a
    /// cell for the common one.
    pub auxiliary: &'a [u64],
    /// The block's cells and its auxiliary unknowns, mode after mode.
    pub rows: &'a [Complex64],
}
