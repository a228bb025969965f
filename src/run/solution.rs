//! A solved case, and the writing of its results.

use crate::base::error::Result;
use crate::base::lock::DirectoryLock;
use crate::matrix::observables::Moments;
use crate::parallel::communicator::World;
use crate::plan::Plan;
use crate::problem::case::Case;
use crate::results;
use crate::results::dataset::{ExactSolution, PlateauPoint, Results, slices};
use crate::results::file_checksums;
use crate::results::finished;
use crate::results::provenance::provenance;
use crate::results::summary::Summary;
use crate::results::{grids, result_file, xdmf};
use crate::run::checkpointing::Checkpointing;
use crate::run::expand::ExpandedResults;
use crate::run::log::RunLog;
use std::ops::Range;
use std::path::Path;

/// A solved case, on this rank's share of the grid.
pub struct Solution {
    /// The case on the grid of the results.
    pub case: Case,
    /// The numbers of the run: errors, counts, seconds, memory.
    pub summary: Summary,
    /// The plan that was carried out.
    pub plan: Plan,
    /// Space cells of this rank, one range for each x-axis; may be empty.
    pub share: Vec<Range<usize>>,
    /// Results at `T`, fields `[x, …, v, …]` on the share and moments on its space cells, and those
    /// of the output times before.
    pub results: ExpandedResults,
    /// The exact solution on the share, if the case names one.
    pub exact: Option<ExactSolution>,
    /// Moments of the exact solution at the output times before the end, if they are wanted there,
    /// then at the end.
    pub exact_moments: Vec<Moments>,
    pub(super) plateau: Vec<PlateauPoint>,
    pub(super) checkpointing: Option<Checkpointing>,
    /// The lock that keeps other runs out of the directory until the results are written. On the
    /// first rank.
    pub(super) lock: Option<DirectoryLock>,
    pub(super) log: RunLog,
}

impl Solution {
    /// Writes `result.h5`, the XDMF and grid files that describe it, `readout.csv` and
    /// `summary.json` into `directory`, which is created. Collective.
    ///
    /// # Errors
    /// [`crate::base::error::Error::Directory`] and [`crate::base::error::Error::Output`].
    pub fn write(self, world: &World, directory: &Path) -> Result<Summary> {
        let _lock = results::prepare(&world.group(), directory, &self.case)?;
        self.write_prepared(world, directory)
    }

    /// Writes the results as [`write`](Self::write) does, into a directory that is already checked
    /// and locked. Deletes the checkpoints. Collective.
    pub(super) fn write_prepared(self, world: &World, directory: &Path) -> Result<Summary> {
        let Self { mut summary, mut log, results, lock: _lock, .. } = self;
        let (all, case) = (world.group(), &self.case);
        // Files of an older result do not belong to this one.
        all.on_first_rank(|| finished::remove_older(directory, case))?;
        let steps = result_file::write(
            &all,
            directory,
            &Results {
                case,
                plan: &self.plan,
                share: &self.share,
                fields: &slices(&results.fields),
                exact: self.exact.as_ref(),
                exact_moments: &self.exact_moments,
                moments: &results.moments,
                potential: &results.potential,
                totals: results.totals,
                early: &results.early,
                plateau: &self.plateau,
                readout: summary.readout.as_ref(),
                seconds: &log.watch.seconds.clone(),
                provenance: &provenance(world, case),
            },
        )?;
        all.on_first_rank(|| {
            xdmf::write(directory, &steps)?;
            grids::write(directory, &steps)
        })?;
        log.watch.lap("write");
        all.on_first_rank(|| summary.readout.iter().try_for_each(|found| found.write(directory)))?;
        let names: Vec<String> = results::files(case).map(|file| file.name).collect();
        summary.files = file_checksums::of_files(&all, directory, &names)?;
        summary.finish(&all, &log.watch);
        all.on_first_rank(|| summary.write(directory))?;
        if let Some(checkpointing) = self.checkpointing.filter(|_| log.prints) {
            checkpointing.remove(&log);
        }
        Ok(summary)
    }
}
