//! The results of a run: `result.h5`, which all ranks write, `summary.json`, and views of the grids
//! for other programs (`fields.xdmf`, and a file for each grid).
//!
//! [`dataset::Results`] is the content of `result.h5`, [`summary::Summary`] that of `summary.json`.
//!
//! Uses: quantum, solve, and every room below. Paper: the figures and tables of section 8.

pub mod averages;
pub mod dataset;
pub mod draw;
pub mod fields;
pub mod figure;
pub mod file_checksums;
pub mod finished;
pub mod grids;
pub mod history;
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
pub mod views;
pub mod warped;
pub mod writer;
pub mod xdmf;

use crate::base::disk::{self, refused};
use crate::base::error::{Error, Result};
use crate::base::lock::{self, DirectoryLock};
use crate::parallel::communicator::Group;
use crate::problem::case::Case;
use std::path::Path;
use std::time::{Duration, Instant};

/// The contents of a file, or a sentence that says why it cannot be used.
pub type FileResult<T> = std::result::Result<T, String>;

/// The longest time that a rank waits until it sees a file that another rank made. Network file
/// systems show it with a delay.
const LATE: Duration = Duration::from_secs(10);

/// Names of the files that a run may write before `summary.json`.
pub(crate) fn file_names(case: &Case) -> Vec<String> {
    let texts = ["result.h5", xdmf::NAME, "readout.csv"].map(str::to_owned);
    texts.into_iter().chain(grids::names()).chain(warped::names(case)).collect()
}

/// Makes the output directory, and checks before anything is computed that only this run writes
/// there, that all ranks see the directory, and that the disk has room. Returns the lock of the
/// directory on the first rank. Collective.
///
/// # Errors
/// [`crate::base::error::Error::Directory`].
pub fn prepare(world: &Group, directory: &Path, case: &Case) -> Result<Option<DirectoryLock>> {
    let clear_way = || -> std::io::Result<()> {
        let given = [
            case.start.as_ref().map(|start| ("initial.warped".to_owned(), &start.path)),
            case.start_field.as_ref().map(|start| ("initial.field".to_owned(), &start.path)),
        ];
        let given = given
            .into_iter()
            .flatten()
            .chain(case.tables.iter().map(|file| (file.of.key(), &file.path)))
            .filter_map(|(key, path)| std::fs::canonicalize(path).ok().map(|path| (key, path)));
        let given: Vec<(String, std::path::PathBuf)> = given.collect();
        let names = file_names(case);
        for name in names.iter().map(String::as_str).chain([summary::NAME]) {
            let path = directory.join(name);
            if path.is_dir() {
                return Err(std::io::Error::other(format!("{name} in it is a directory")));
            }
            let same =
                |(_, file): &&(String, _)| std::fs::canonicalize(&path).ok().as_ref() == Some(file);
            if let Some((key, _)) = given.iter().find(same) {
                let what = format!(
                    "the run would overwrite {name}, from which it starts ({key}); give another \
                     directory (-o)"
                );
                return Err(std::io::Error::other(what));
            }
            // Partial files of a killed run would take room.
            disk::clear(&disk::partial(&path)).map_err(|e| {
                std::io::Error::other(format!("{name}.partial in it cannot be removed: {e}"))
            })?;
        }
        Ok(())
    };
    if directory.to_str().is_none() {
        let why = std::io::Error::other("its path is no UTF-8 text, which HDF5 requires");
        return world.agree(Err(refused(directory, &why)));
    }
    let lock = world.on_first_rank(|| DirectoryLock::take(directory).map(Some))?;
    require_shared(world, directory, lock.as_ref())?;
    world.on_first_rank(|| {
        clear_way().map_err(|e| refused(directory, &e))?;
        crate::results::result_file::enough_room(directory, case)
    })?;
    Ok(lock)
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
            return world.agree(Err(Error::Directory { path, reason: reason.to_owned() }));
        }
        std::thread::sleep(Duration::from_millis(50));
    }
    world.agree(Ok(()))
}
