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

pub use file::Destination;
pub use store::{Generation, Store};
pub use watch::{Standing, Times};

use crate::case::Case;
use crate::command::report;
use crate::communicator::Communicator;
use crate::error::{Error, Result};
use crate::output::checksum;
use crate::output::provenance::VERSION;
use crate::partition::Mesh;
use crate::plan::{Batch, WarpPlan};
use crate::warp::{Passage, Told};
use num_complex::Complex64;
use serde::{Deserialize, Serialize};
use std::collections::BTreeMap;
use std::ops::Range;
use std::time::Instant;
use watch::{Verdict, Watch};

/// Beginnings of the keys that change no bit of a checkpoint.
const WITHOUT_EFFECT: [&str; 8] = [
    "title",
    "reference",
    "initial.warped",
    "output.compression",
    "output.chunks",
    "output.expand",
    "output.xdmf",
    "checkpoint.",
];

/// What runs share that may go on where the other was stopped, with the same bits.
#[derive(Clone, Debug, PartialEq, Eq, Serialize, Deserialize)]
pub struct Fingerprint {
    /// Version and commit of the program.
    program: String,
    /// What the case gives, by its keys.
    settings: BTreeMap<String, String>,
    /// The warped field that it starts from, if it does.
    start: Option<Start>,
    /// Of the plan.
    plan: u64,
}

/// What tells a warped field to start from.
#[derive(Clone, Debug, PartialEq, Eq, Serialize, Deserialize)]
struct Start {
    /// Bits of the ends of its interval, and its points.
    points: ([u64; 2], usize),
    /// The checksum of its numbers, once they were read.
    values: Option<u64>,
}

impl Fingerprint {
    /// That of a run. What changes no bit of a checkpoint is not in it, nor where a file is whose values are.
    pub fn new(case: &Case, warp: &WarpPlan) -> Self {
        let counts = |key: &String| !WITHOUT_EFFECT.iter().any(|start| key.starts_with(start));
        let mut settings = case.settings.clone();
        settings.retain(|key, _| counts(key));
        let planned = (
            warp.fingerprint(),
            warp.interval,
            &warp.readings,
            &warp.plateau,
        );
        Self {
            program: VERSION.to_owned(),
            settings,
            start: case.start.as_ref().map(|_| Start {
                points: (warp.interval.map(f64::to_bits), warp.points.unwrap_or(0)),
                values: None,
            }),
            plan: checksum::of_text(format!("{planned:?}").as_bytes()),
        }
    }

    /// How `other` differs, if it does.
    fn difference(&self, other: &Self) -> Option<String> {
        if self.program != other.program {
            let (other, own) = (&other.program, &self.program);
            return Some(format!("was written by phasewarp {other}; this is {own}"));
        }
        let keys = self.settings.keys().chain(other.settings.keys());
        let of = |key: &String| [self, other].map(|f| f.settings.get(key));
        let differs = |key: &&String| matches!(of(key), [own, other] if own != other);
        if let Some(key) = keys.min_by_key(|key| (!differs(key), *key)).filter(differs) {
            let [own, other] = of(key).map(|value| value.map_or("not given", String::as_str));
            return Some(format!(
                "is of another case, or of other --set options: {key} is {other} there, {own} here"
            ));
        }
        if let (Some(own), Some(other)) = (&self.start, &other.start) {
            let values = own.values.zip(other.values);
            if own.points != other.points || values.is_some_and(|(own, other)| own != other) {
                return Some(
                    "began from another file: that of initial.warped has changed".to_owned(),
                );
            }
        }
        (self.plan != other.plan)
            .then(|| "is of another plan, made on a processor of another kind".to_owned())
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
        let kept = self.kept.iter().flat_map(|kept| &kept.modes);
        8 * (sums + results + 2 * kept.map(|mode| mode.rows.len()).sum::<usize>())
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
    /// The global number of the cell to which the auxiliary unknown in each row behind the block's cells belongs; the largest
    /// there is for the common one.
    pub auxiliary: Vec<u64>,
    /// The modes.
    pub modes: Vec<KeptMode<'a>>,
}

/// A mode that is kept.
pub struct KeptMode<'a> {
    /// Its number.
    pub mode: usize,
    /// How far it is.
    pub passage: Passage,
    /// The block's cells and its auxiliary unknowns.
    pub rows: &'a [Complex64],
}

/// The checkpoint that a run goes on from.
pub struct Resumed<'a> {
    /// What is read.
    pub generation: Generation,
    /// The batches of this rank's mode group that are left of its stage.
    pub batches: Vec<Batch>,
    /// Space cells of this rank's share.
    pub share: &'a [Range<usize>],
}

/// The checkpoints that a run makes, and the one it goes on from.
pub struct Checkpoints<'a> {
    communicator: &'a Communicator,
    mesh: &'a Mesh,
    store: &'a mut Store,
    watch: Watch,
    wall_seconds: Option<f64>,
    /// Modes of a stage, and stages.
    size: (usize, usize),
    /// Taken when the run begins.
    pub resumed: Option<Resumed<'a>>,
    /// How many were written.
    pub written: usize,
}

impl<'a> Checkpoints<'a> {
    /// Those of a run of `size` modes a stage and stages, kept in `store`. Collective.
    pub fn new(
        (communicator, mesh): (&'a Communicator, &'a Mesh),
        store: &'a mut Store,
        times: Times,
        size: (usize, usize),
        resumed: Option<Resumed<'a>>,
    ) -> Self {
        Self {
            communicator,
            mesh,
            store,
            wall_seconds: times.wall.map(|(_, wall)| wall.as_secs_f64()),
            watch: Watch::new(communicator, times),
            size,
            resumed,
            written: 0,
        }
    }

    /// Whether the batches of a stage are over, on all ranks; asked at its beginning and after each batch. Writes a
    /// checkpoint of `snapshot` where it is time for one. One by the clock that cannot be written is told by rank 0, and the
    /// run goes on. Collective at the end of a stage and where a checkpoint is written, otherwise over the space group.
    ///
    /// # Errors
    /// On all ranks: [`Error::Stopped`] when the run is to stop and its checkpoint was written, [`Error::Checkpoint`] when that
    /// could not be, [`Error::WallTime`] when the wall time is too short for anything.
    pub fn are_over<'s>(
        &mut self,
        standing: Standing,
        snapshot: impl Fn() -> Snapshot<'s>,
    ) -> Result<bool> {
        let world = &self.communicator.world;
        self.watch.expect(|| snapshot().bytes());
        loop {
            let verdict = self.watch.ask(self.communicator, standing);
            match verdict {
                Verdict::GoOn => {
                    self.watch.begin(standing);
                    return Ok(false);
                }
                Verdict::Finished | Verdict::Failed => return Ok(true),
                Verdict::StopInTime if world.sum_count(self.watch.batches) == 0 => {
                    return Err(Error::WallTime {
                        seconds: self.wall_seconds.unwrap_or(0.0),
                    });
                }
                Verdict::Write | Verdict::StopAsTold | Verdict::StopInTime => {}
            }
            let started = Instant::now();
            let snapshot = snapshot();
            let written = self.store.write(world, self.mesh, &snapshot);
            self.watch.wrote(started.elapsed());
            let why = match (verdict, self.wall_seconds) {
                (Verdict::StopAsTold, _) => "stopped by SIGUSR1".to_owned(),
                (Verdict::StopInTime, Some(seconds)) => format!("stopped by --walltime {seconds}"),
                _ => {
                    match written {
                        Ok(_) => self.written += 1,
                        Err(error) if world.rank() == 0 => {
                            report(&format!("warning: {error}; the run goes on"));
                        }
                        Err(_) => {}
                    }
                    continue;
                }
            };
            let (modes, stages) = self.size;
            return Err(Error::Stopped {
                why,
                path: self.store.directory().to_owned(),
                finished: written?,
                modes,
                stage: snapshot.state.stage + 1,
                stages,
            });
        }
    }
}

#[cfg(test)]
mod tests;
