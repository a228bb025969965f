//! The data of a run that a checkpoint holds, and how a run continues from one.

use crate::base::error::Result;
use crate::base::row_major::volume;
use crate::matrix::block_matrix::BlockMatrix;
use crate::matrix::observables::MOMENTS;
use crate::problem::legs::Leg;
use crate::solve::checkpoint::ResumePoint;
use crate::solve::checkpoint::file::ReadDestination;
use crate::solve::field_readings::{FieldHistory, FieldReadings};
use crate::solve::rank_modes::RankModes;
use crate::solve::snapshot::{BoxValues, GroupProgress, Snapshot, StoredMode, StoredModes};
use crate::solve::stage::{RecoveredFields, Stage, StageBatches, Task};
use crate::solve::sum::ModeSum;

impl Stage<'_> {
    /// The finished work: the finished batches of this stage (`batches`), the stages before it, and
    /// the stored modes that have passed a leg. The other modes start from the field.
    pub(crate) fn snapshot<'b>(
        &'b self,
        batches: &StageBatches<'_>,
        task: &Task<'_>,
        matrix: &BlockMatrix,
        kept: Option<&'b RankModes>,
        recovered: &'b RecoveredFields,
    ) -> Snapshot<'b> {
        let sums = self.sums.iter().flatten().chain(&self.step_sum);
        Snapshot {
            state: GroupProgress {
                stage: batches.stage,
                finished: batches.finished.to_vec(),
                beyond: self.beyond.clone(),
                step_beyond: recovered.step_beyond.clone(),
                statistics: batches.statistics.clone(),
            },
            sums: sums.map(ModeSum::numbers).collect(),
            results: recovered.results(task, matrix.block.velocity_cells),
            kept: kept.map(|kept| StoredModes {
                auxiliary: matrix.auxiliary_cells(),
                modes: kept.begun().collect(),
            }),
        }
    }

    /// Restores this stage from the checkpoint: its modes into `kept`, the results of earlier
    /// stages into `recovered`. Not collective.
    ///
    /// # Errors
    /// If the checkpoint cannot be read.
    pub(crate) fn resume(
        &mut self,
        resumed: &ResumePoint<'_>,
        task: &Task<'_>,
        matrix: &BlockMatrix,
        kept: Option<&mut RankModes>,
        recovered: &mut RecoveredFields,
    ) -> Result<()> {
        let ResumePoint { generation, share, .. } = resumed;
        let modes = &task.communicator.modes;
        let points = volume(share);
        let sums = self.sums.iter_mut().flatten().chain(&mut self.step_sum);
        let mut into = ReadDestination {
            block: &matrix.block.ranges,
            share,
            sums: sums.map(|sum| &mut sum.parts[..]).collect(),
            results: (generation.results.iter()).map(|width| vec![0.0; width * points]).collect(),
            kept: kept.map(|kept| (matrix.auxiliary_cells(), kept)),
        };
        generation.read(modes, &mut into)?;
        let mut results = into.results.into_iter();
        let state = &generation.state;
        let mut next = |count: usize| results.by_ref().take(count).collect::<Vec<_>>();
        for k in 0..self.field {
            let times = next(Leg::output_times(task.legs).count() - 1);
            recovered.early.push(FieldHistory { times });
            recovered.fields.push(FieldReadings::new(next(task.warp.readings.len())));
            if k == 0 {
                recovered.plateau = next(task.warp.plateau.len());
            }
            let errors = usize::from(self.stepped);
            recovered.step_errors.extend(next(errors));
        }
        if self.legs.start > 0 {
            let times = next(Leg::output_times(&task.legs[..self.legs.start]).count());
            recovered.early.push(FieldHistory { times });
        }
        recovered.step_beyond.clone_from(&state.step_beyond);
        if modes.is_first() {
            self.beyond.extend_from_slice(&state.beyond);
        }
        Ok(())
    }
}

impl RecoveredFields {
    /// The results of the finished stages, field after field: early readings, and for finished
    /// fields the readings at the end, the plateau and the error of the step.
    fn results(&self, task: &Task<'_>, velocities: usize) -> Vec<BoxValues<'_, f64>> {
        let mut all = Vec::new();
        let moments = |only: bool| {
            if only && task.moments.is_some() { MOMENTS } else { velocities }
        };
        let field = |values| BoxValues { width: velocities, values };
        for (k, early) in self.early.iter().enumerate() {
            let times = early.times.iter().zip(Leg::output_times(task.legs));
            all.extend(times.map(|(values, only)| BoxValues { width: moments(only), values }));
            let Some(readings) = self.fields.get(k) else {
                continue;
            };
            let plateau = if k == 0 { &self.plateau[..] } else { &[] };
            let plateau = plateau.iter().map(Vec::as_slice);
            all.extend(readings.each().chain(plateau).map(field));
            all.extend(self.step_errors.get(k).map(|e| field(&e[..])));
        }
        all
    }
}

impl RankModes {
    /// The modes that were propagated over at least one leg.
    fn begun(&self) -> impl Iterator<Item = StoredMode<'_>> {
        let all = self.modes().iter().zip(self.progress());
        all.filter(|(_, progress)| progress.legs > 0).filter_map(|(&mode, &progress)| {
            let rows = self.mode(mode)?;
            Some(StoredMode { mode, progress, rows })
        })
    }
}
