//! The results of a run: `result.h5`, which all ranks write, `summary.json`, and views of the grids
//! for other programs (`fields.xdmf`, and a file for each grid).
//!
//! [`dataset::Results`] is the content of `result.h5`, [`summary::Summary`] that of `summary.json`.
//! `judgement` compares its errors with the goals of the case.
//!
//! Uses: quantum, solve, and every module below. Paper: the figures and tables of section 8.

pub mod accuracy;
pub mod averages;
pub mod chosen_setup;
pub mod continued_result;
pub mod dataset;
pub mod draw;
pub mod fields;
pub mod figure;
pub mod file_checksums;
pub mod finished;
pub mod grids;
pub mod history;
mod judgement;
pub mod ledger;
pub mod movie;
pub mod pictures;
pub mod provenance;
pub mod readback;
pub mod report;
pub mod result_file;
pub mod result_grid;
pub mod start_field;
pub mod summary;
pub mod table_file;
pub mod untrusted;
pub mod verdict;
pub mod views;
pub mod warped;
pub mod writer;
pub mod xdmf;

use crate::base::disk::{self, directory_error, refused};
use crate::base::error::Result;
use crate::base::lock::{self, DirectoryLock};
use crate::parallel::communicator::Group;
use crate::problem::case::Case;
use crate::quantum::readout;
use crate::results::dataset::RESULT;
use std::path::{Path, PathBuf};
use std::time::{Duration, Instant};

/// The contents of a file, or a sentence that says why it cannot be used.
pub type FileResult<T> = std::result::Result<T, String>;

/// The longest time that a rank waits until it sees a file that another rank made. Network file
/// systems show it with a delay.
const LATE: Duration = Duration::from_secs(10);

/// A file that a run may write before `summary.json`.
pub(crate) struct RunFile {
    /// Name of the file.
    pub name: String,
    /// Whether a run of the case writes it.
    pub is_written: bool,
}

/// The files that a run may write before `summary.json`, warped fields only as far as `case` writes
/// them.
pub(crate) fn files(case: &Case) -> impl Iterator<Item = RunFile> {
    let readings = case.readout.is_some();
    let single =
        [(RESULT, true), (xdmf::NAME, case.output.storage.xdmf), (readout::files::NAME, readings)];
    let single = single.into_iter().map(|(name, is_written)| (name.to_owned(), is_written));
    let warped = warped::names(case).into_iter().map(|name| (name, true));
    let all = single.chain(grids::files(case)).chain(warped);
    all.map(|(name, is_written)| RunFile { name, is_written })
}

/// The files that `case` reads, with the keys that name them.
pub(crate) fn given_files(case: &Case) -> impl Iterator<Item = (String, &Path)> {
    let modes = case.warped_start.iter().map(|start| ("initial.warped".to_owned(), &*start.path));
    let field = case.start_field.iter().map(|start| ("initial.field".to_owned(), &*start.path));
    let tables = case.tables.iter().map(|file| (file.of.key(), &*file.path));
    modes.chain(field).chain(tables)
}

/// Makes the output directory, and checks before anything is computed that only this run writes
/// there, that all ranks see the directory, and that the disk has room. Returns the lock of the
/// directory on the first rank. Collective.
///
/// # Errors
/// [`crate::base::error::Error::Directory`].
pub fn prepare(world: &Group, directory: &Path, case: &Case) -> Result<Option<DirectoryLock>> {
    if directory.to_str().is_none() {
        let why = std::io::Error::other("its path is no UTF-8 text, which HDF5 requires");
        return world.agree(Err(refused(directory, &why)));
    }
    let lock = world.on_first_rank(|| DirectoryLock::take(directory).map(Some))?;
    require_shared(world, directory, lock.as_ref())?;
    world.on_first_rank(|| {
        clear_way(directory, case).map_err(|reason| directory_error(directory, reason))?;
        result_file::enough_room(directory, case)
    })?;
    Ok(lock)
}

/// Removes partial files of a killed run, which would take room. Only one rank calls it.
///
/// # Errors
/// A sentence, where a directory is in the place of a file of the run, or the run would overwrite
/// a file that it reads.
fn clear_way(directory: &Path, case: &Case) -> FileResult<()> {
    let resolved = |path: &Path| std::fs::canonicalize(path).ok();
    let given = given_files(case).filter_map(|(key, path)| Some((key, resolved(path)?)));
    let given: Vec<(String, PathBuf)> = given.collect();
    for name in files(case).map(|file| file.name).chain([summary::NAME.to_owned()]) {
        let path = directory.join(&name);
        if path.is_dir() {
            return Err(format!("{name} in it is a directory"));
        }
        let there = resolved(&path);
        if let Some((key, _)) = given.iter().find(|(_, file)| there.as_ref() == Some(file)) {
            return Err(format!(
                "the run would overwrite {name}, from which it starts ({key}); give another \
                 directory (-o)"
            ));
        }
        disk::clear(&disk::partial(&path))
            .map_err(|e| format!("{name}.partial in it cannot be removed: {e}"))?;
    }
    Ok(())
}

/// Checks that every rank sees the directory that the first one locked. Collective.
fn require_shared(world: &Group, directory: &Path, lock: Option<&DirectoryLock>) -> Result<()> {
    let text = world.broadcast_text(lock.map_or("", |lock| &lock.text));
    let path = directory.join(lock::NAME);
    let start = Instant::now();
    let sees = || std::fs::read_to_string(&path).is_ok_and(|found| found == text);
    while !sees() {
        if start.elapsed() > LATE {
            let reason = "this rank does not see what the first one wrote there; all ranks need \
                          the same directory: a shared file system, and the same working \
                          directory or an absolute path (-o)";
            let path = std::path::absolute(directory).unwrap_or_else(|_| directory.to_owned());
            return world.agree(Err(directory_error(&path, reason)));
        }
        std::thread::sleep(Duration::from_millis(50));
    }
    world.agree(Ok(()))
}
