//! Checkpoints: the finished work of a run on disk, from which a stopped run continues.
//!
//! The unit is the batch of modes. A checkpoint holds ([`Snapshot`])
//!
//! - which modes of the current stage are finished, and the fixed-point sums of their readings:
//!   integers, which do not depend on the order, the ranks or the processes that added them;
//! - the results of finished stages;
//! - in a full run, the modes themselves.
//!
//! ```text
//! DIR/checkpoint/000007/rank-00000.bin …   a file of each rank (see `file`)
//! DIR/checkpoint/000007/manifest.json      sizes and checksums; written last, then renamed
//! ```
//!
//! A generation without a manifest was not completed and does not count. Two generations are
//! stored. A run on any number of ranks and any mesh can continue: it adds the integer sums of mode
//! groups, and gives everything else to the ranks that now have the cells and modes. Each rank
//! reads only what it needs.

pub mod file;
pub mod store;
pub mod watch;

use crate::base::error::{Error, Result};
use crate::base::log::eprint_wrapped;
use crate::base::text::seconds_text;
use crate::parallel::communicator::Communicator;
use crate::parallel::partition::ProcessMesh;
use crate::plan::balance::Batch;
use crate::solve::checkpoint::store::{Generation, Store};
use crate::solve::checkpoint::watch::{CheckpointTimes, CommonDecision, RankState, Watch};
use crate::solve::snapshot::Snapshot;
use std::ops::Range;
use std::time::Instant;

/// The checkpoint that a run continues from.
pub struct ResumePoint<'a> {
    /// The checkpoint.
    pub generation: Generation,
    /// The unfinished batches of this rank's mode group in its stage.
    pub batches: Vec<Batch>,
    /// Space cells of this rank's share.
    pub share: &'a [Range<usize>],
}

/// The tasks of a run.
#[derive(Clone, Copy, Debug)]
pub struct RunSize {
    /// Modes of a stage.
    pub modes: usize,
    /// Number of stages.
    pub stages: usize,
}

/// The checkpoints that a run makes, and the one it continues from.
pub struct Checkpoints<'a> {
    communicator: &'a Communicator,
    mesh: &'a ProcessMesh,
    store: &'a mut Store,
    watch: Watch,
    wall_seconds: Option<f64>,
    /// Seconds of the program before the modes.
    set_up_seconds: f64,
    size: RunSize,
    /// The checkpoint to continue from, taken when the run begins.
    pub resumed: Option<ResumePoint<'a>>,
    /// Number of checkpoints that were written.
    pub written: usize,
}

impl<'a> Checkpoints<'a> {
    /// The checkpoints of a run of `size`, kept in `store`. Collective.
    pub fn new(
        communicator: &'a Communicator,
        mesh: &'a ProcessMesh,
        store: &'a mut Store,
        times: CheckpointTimes,
        size: RunSize,
        resumed: Option<ResumePoint<'a>>,
    ) -> Self {
        Self {
            communicator,
            mesh,
            store,
            wall_seconds: times.wall.map(|(_, wall)| wall.as_secs_f64()),
            set_up_seconds: times.wall.map_or(0.0, |(start, _)| start.elapsed().as_secs_f64()),
            watch: Watch::new(communicator, times),
            size,
            resumed,
            written: 0,
        }
    }

    /// Writes a checkpoint of `snapshot` where it is time for one, and stops the run if it is to
    /// stop. Called at the beginning of a stage and after each batch; returns whether the batches
    /// of the stage are finished on all ranks. If a checkpoint by the clock cannot be written, rank
    /// 0 reports it and the run continues. Collective at the end of a stage and where a checkpoint
    /// is written, otherwise over the space group.
    ///
    /// # Errors
    /// On all ranks: [`Error::Stopped`] if the run is to stop and its checkpoint was written,
    /// [`Error::Checkpoint`] if it could not be written, [`Error::WallTime`] if the wall time did
    /// not suffice for one batch.
    pub fn write_if_due<'s>(
        &mut self,
        standing: RankState,
        snapshot: impl Fn() -> Snapshot<'s>,
    ) -> Result<bool> {
        let world = &self.communicator.world;
        self.watch.predict_write_time(|| snapshot().bytes());
        loop {
            let verdict = self.watch.decide(self.communicator, standing);
            match verdict {
                CommonDecision::GoOn => {
                    self.watch.begin(standing);
                    return Ok(false);
                }
                CommonDecision::Finished | CommonDecision::Failed => return Ok(true),
                CommonDecision::StopByWallTime if world.sum_count(self.watch.batches) == 0 => {
                    return Err(self.too_late());
                }
                CommonDecision::Write
                | CommonDecision::StopBySignal
                | CommonDecision::StopByWallTime => {}
            }
            let started = Instant::now();
            let snapshot = snapshot();
            let written = self.store.write(world, self.mesh, &snapshot);
            self.watch.wrote(started.elapsed());
            match self.why_stopped(verdict) {
                Some(why) => return Err(self.stopped(why, written?, snapshot.state.stage)),
                None => self.count(written),
            }
        }
    }

    /// The error of a wall time that does not suffice for one batch.
    fn too_late(&self) -> Error {
        Error::WallTime {
            seconds: self.wall_seconds.unwrap_or(0.0),
            why: format!(
                "not one batch of modes was finished after a set-up of {}; it takes a longer time, \
                 or more ranks",
                seconds_text(self.set_up_seconds)
            ),
        }
    }

    /// The reason why the run stops by `verdict`; `None` if it goes on.
    fn why_stopped(&self, verdict: CommonDecision) -> Option<String> {
        match (verdict, self.wall_seconds) {
            (CommonDecision::StopBySignal, _) => Some("stopped by a signal".to_owned()),
            (CommonDecision::StopByWallTime, Some(seconds)) => {
                Some(format!("stopped by --walltime {seconds}"))
            }
            _ => None,
        }
    }

    /// The end of a run with `finished` modes in its checkpoint of `stage`.
    fn stopped(&self, why: String, finished: usize, stage: usize) -> Error {
        let RunSize { modes, stages } = self.size;
        let path = self.store.directory().to_owned();
        Error::Stopped { why, path, finished, modes, stage: stage + 1, stages }
    }

    /// Counts a checkpoint of a run that goes on, or reports that it could not be written.
    fn count(&mut self, written: Result<usize>) {
        match written {
            Ok(_) => self.written += 1,
            Err(error) if self.communicator.world.is_first() => {
                eprint_wrapped(&format!("warning: {error}; the run goes on"));
            }
            Err(_) => {}
        }
    }
}

#[cfg(test)]
mod tests;
