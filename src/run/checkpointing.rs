//! The checkpoints of a run: where they are, and the one that it continues from.

use crate::base::disk::directory_error;
use crate::base::error::Result;
use crate::base::lock::DirectoryLock;
use crate::base::log::eprint_wrapped;
use crate::run::log::RunLog;
use crate::run::options::Output;
use crate::solve::checkpoint::store::{self, Generation, Store, remove_all};
use crate::solve::checkpoint::watch::CheckpointTimes;
use crate::solve::prepared::Prepared;
use crate::solve::snapshot::Fingerprint;
use std::io::ErrorKind;
use std::path::Path;
use std::sync::Arc;
use std::time::Instant;

/// The checkpoints that a run by modes makes.
pub(crate) struct Checkpointing {
    /// The files of the checkpoints.
    pub store: Store,
    /// The checkpoint to continue from, until it is read.
    pub generation: Option<Generation>,
    /// The times at which they are made.
    pub times: CheckpointTimes,
}

impl Checkpointing {
    /// Opens the checkpoints of `output`; `None` for the classical method. The wall time counts
    /// from `program_start`. Collective.
    ///
    /// # Errors
    /// As [`Store::open`]; [`Error::Directory`] if a link is in the place of their directory.
    pub fn open(
        prepared: &Prepared,
        output: &Output<'_>,
        program_start: Instant,
        log: &mut RunLog,
    ) -> Result<Option<Self>> {
        let (case, options) = (&prepared.case, output.options);
        let Some(warp) = &prepared.plan.warp else {
            if options.resume || options.walltime.is_some() {
                let what = "solver.method = \"classical\" makes no checkpoints";
                log.warn(format!("--resume and --walltime have no effect: {what}"));
            }
            return Ok(None);
        };
        let folder = store::folder(output.directory);
        prepared.communicator.world.on_first_rank(|| refuse_link(&folder))?;
        let mut store = Store::new(folder, Fingerprint::new(case, warp), case.space.clone());
        let generation = if options.resume {
            newest_checkpoint(prepared, &mut store, log)?
        } else {
            if !store.is_empty() {
                log.warn(format!(
                    "{} holds the checkpoint of a run that was not finished; this one replaces it. \
                     --resume would continue from it",
                    store.directory().display()
                ));
            }
            None
        };
        let times = CheckpointTimes {
            every: case.checkpoint_every,
            wall: options.walltime.map(|wall| (program_start, wall)),
            stop: Arc::clone(&options.stop),
        };
        Ok(Some(Self { store, generation, times }))
    }

    /// Deletes the checkpoints of a finished run. On rank 0.
    pub fn remove(self, log: &RunLog) {
        if let Err(error) = remove_all(self.store.directory()) {
            let path = self.store.directory().display();
            log.line(&format!("warning: {path} could not be removed: {error}"));
        }
    }
}

/// Deletes what a finished run that was killed as it ended left of its checkpoints in `results`.
/// Other files stay, a symbolic link is not followed, and nothing is done while another run has
/// locked the directory. On one rank.
pub(crate) fn remove_rest(results: &Path) {
    let folder = store::folder(results);
    if folder.is_dir()
        && refuse_link(&folder).is_ok()
        && let Ok(_lock) = DirectoryLock::at_once(results)
        && let Err(error) = remove_all(&folder)
        && error.kind() != ErrorKind::DirectoryNotEmpty
    {
        eprint_wrapped(&format!("warning: {} could not be removed: {error}", folder.display()));
    }
}

/// Refuses a symbolic link in the place of the directory of checkpoints, as its target may belong
/// to others.
fn refuse_link(folder: &Path) -> Result<()> {
    match std::fs::symlink_metadata(folder) {
        Ok(found) if found.is_symlink() => Err(directory_error(
            folder,
            "it is a symbolic link, which is not followed; -o gives another directory",
        )),
        _ => Ok(()),
    }
}

/// The newest valid checkpoint of `store`, reported to the user. Collective.
fn newest_checkpoint(
    prepared: &Prepared,
    store: &mut Store,
    log: &mut RunLog,
) -> Result<Option<Generation>> {
    let folder = store.directory().display().to_string();
    let world = &prepared.communicator.world;
    let found = store.open(world, |line| log.warn(line))?;
    log.line(&match &found {
        None => format!("--resume: no checkpoint in {folder}; the run starts from its beginning"),
        Some(generation) => format!(
            "going on from {}: {} of {} modes of stage {} are finished",
            generation.path().display(),
            generation.state.finished.len(),
            prepared.plan.warp.as_ref().map_or(0, |warp| warp.modes),
            generation.state.stage + 1,
        ),
    });
    Ok(found)
}
