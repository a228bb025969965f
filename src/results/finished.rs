//! Checks a directory before a run writes there: it may hold the finished results of the same run,
//! or others, which are replaced only on demand.

use crate::base::disk::{self, failure};
use crate::base::error::{Error, Result};
use crate::base::log::eprint_wrapped;
use crate::base::version::{self, GIT, PROGRAM};
use crate::parallel::communicator::Group;
use crate::problem::case::{Case, differing_setting};
use crate::quantum::readout;
use crate::results::accuracy::Accuracy;
use crate::results::continued_result::ContinuedResult;
use crate::results::dataset::RESULT;
use crate::results::readback::{StoredCase, text_attribute};
use crate::results::untrusted::{self, Inspection};
use crate::results::verdict::MissedGoals;
use crate::results::{file_checksums, files, given_files, pictures, report, summary, warped};
use crate::solve::checkpoint::store;
use hdf5::File;
use serde::Deserialize;
use std::path::Path;
use std::time::SystemTime;

/// Whether `directory` holds the complete results of `case` by this program, written after the
/// files that the case reads. The interval of checkpoints does not matter. Every dataset is
/// compared with its checksum, and every file with that in `summary.json`; the dates of the results
/// do not matter. Collective over `world`.
///
/// # Errors
/// [`crate::base::error::Error::Output`], the same on all ranks, if the results are those of `case`
/// but a file is damaged.
pub fn is_finished(world: &Group, directory: &Path, case: &Case) -> Result<bool> {
    // One rank reads the file without MPI.
    let looks_finished = world.on_first_rank(|| looks_finished(directory, case))?;
    if world.max_count(usize::from(looks_finished)) == 0 {
        return Ok(false);
    }
    // What has another size is not read.
    world.on_first_rank(|| file_checksums::check_sizes(directory))?;
    for name in [RESULT.to_owned()].into_iter().chain(warped::names(case)) {
        untrusted::check(world, &directory.join(name))?;
    }
    // Only files that the run would write; others may be in the directory.
    let listed = file_checksums::check(world, directory)?;
    let mut written = files(case).filter(|file| file.is_written);
    match written.find(|file| !listed.contains_key(&file.name)) {
        Some(file) => Err(file_checksums::not_listed(directory, &file.name)),
        None => Ok(true),
    }
}

/// Whether `directory` holds the finished results of `case`. Damaged results count as unfinished,
/// and are reported in the words of the caller: `warning` of the damage. Collective.
pub fn is_done(
    world: &Group,
    directory: &Path,
    case: &Case,
    warning: impl Fn(&Error) -> String,
) -> bool {
    let found = is_finished(world, directory, case);
    if let (Err(damage), true) = (&found, world.is_first()) {
        eprint_wrapped(&format!("warning: {}", warning(damage)));
    }
    matches!(found, Ok(true))
}

/// Whether the run of `case` in `directory` came to its end, as far as names, dates of given files
/// and the description of `result.h5` say it.
///
/// # Errors
/// [`Error::Output`] if `result.h5` is damaged.
fn looks_finished(directory: &Path, case: &Case) -> Result<bool> {
    let there = |name: &str| disk::is_taken(&directory.join(name));
    let ended = there(summary::NAME) && no_file(directory, case).is_none();
    if !ended || store::is_begun(directory) || !is_later_than_given(directory, case) {
        return Ok(false);
    }
    match StoredResult::new(directory, case) {
        StoredResult::Same => Ok(true),
        StoredResult::Damaged { error, of_this_case: true } => Err(error),
        StoredResult::Damaged { .. } | StoredResult::Other(_) | StoredResult::Foreign => Ok(false),
    }
}

/// Whether `result.h5` is there and was written after all files that the case reads.
fn is_later_than_given(directory: &Path, case: &Case) -> bool {
    let Some(result) = modified(&directory.join(RESULT)) else { return false };
    given_files(case).all(|(_, path)| modified(path).is_some_and(|start| start < result))
}

/// The time at which a file was written; `None` if there is no such file.
fn modified(path: &Path) -> Option<SystemTime> {
    let found = std::fs::metadata(path).ok().filter(|found| found.is_file());
    found.and_then(|found| found.modified().ok())
}

/// The first name of a file of the run in whose place there is something else: a pipe, a device, a
/// directory, a link that leads to none.
fn no_file(directory: &Path, case: &Case) -> Option<String> {
    let is_other = |name: &String| {
        let path = directory.join(name);
        disk::is_taken(&path) && disk::require_file(&path).is_err()
    };
    let mut names = files(case).map(|file| file.name).chain([summary::NAME.to_owned()]);
    names.find(is_other)
}

/// What the file `result.h5` in a directory is to a case.
enum StoredResult {
    /// The result of this case by this program.
    Same,
    /// Another result; the text says how it differs.
    Other(String),
    /// A file that is not as this program wrote it.
    Damaged {
        error: Error,
        /// Whether it was the result of the case, as far as its summary says.
        of_this_case: bool,
    },
    /// A file of others.
    Foreign,
}

impl StoredResult {
    fn new(directory: &Path, case: &Case) -> Self {
        match difference(directory, case) {
            Ok(None) => Self::Same,
            Ok(Some(what)) => Self::Other(what),
            // A file that cannot be read is ours if its checksum is known.
            Err(_) => match file_checksums::damage(directory, RESULT) {
                Some(error) => Self::Damaged { error, of_this_case: is_of(directory, case) },
                None => Self::Foreign,
            },
        }
    }
}

/// Whether the summary in `directory` may be that of `case`: it has its title.
fn is_of(directory: &Path, case: &Case) -> bool {
    summary::read(directory).is_ok_and(|found| found["title"].as_str() == Some(&*case.title))
}

/// A text that says how the case or the program of `result.h5` differs from `case` or this program;
/// `None` if they do not differ.
///
/// # Errors
/// If it cannot be read, is not this program's, or if its case is not as it was written.
fn difference(directory: &Path, case: &Case) -> hdf5::Result<Option<String>> {
    let path = directory.join(RESULT);
    untrusted::inspect(&path, Inspection::Description).map_err(hdf5::Error::from)?;
    let file = File::open(path)?;
    let [by, git] = [text_attribute(&file, "program")?, text_attribute(&file, "git")?];
    let stored = StoredCase::read(&file)?;
    if by != PROGRAM || git != GIT {
        return Ok(Some(format!("it is by {by} (git {git}), this is {PROGRAM} (git {GIT})")));
    }
    stored.check()?;
    let Ok(found) = Case::parse(&case.name, &stored.text()?, &stored.overrides) else {
        return Ok(Some("its case is not one of this program".to_owned()));
    };
    Ok(differing_setting(&found.settings, &case.settings))
}

/// Refuses to replace files in `directory`: results of a finished run, and files with names of
/// results that no run wrote or that are no files. A run with `resume` may replace results of the
/// same case, as they are damaged if they are not finished. If there is a checkpoint, it may
/// replace any results. Collective over `world`.
///
/// # Errors
/// [`Error::Directory`], the same on all ranks.
pub fn refuse_to_replace(world: &Group, directory: &Path, case: &Case, resume: bool) -> Result<()> {
    world.on_first_rank(|| match obstacle(directory, case, resume) {
        None => Ok(()),
        Some(reason) => Err(disk::directory_error(directory, reason)),
    })
}

/// The reason why a run of `case` may not write into `directory`, with a remedy; `None` if it may.
fn obstacle(directory: &Path, case: &Case, resume: bool) -> Option<String> {
    let there = |name: &str| disk::is_taken(&directory.join(name));
    let instead = "--force replaces it, -o gives another directory";
    if let Some(name) = no_file(directory, case) {
        return Some(if directory.join(&name).is_dir() {
            format!("{name} in it is a directory; -o gives another directory")
        } else {
            format!("{name} in it is no file; {instead}")
        });
    }
    if there(RESULT) {
        let found = StoredResult::new(directory, case);
        let goes_on =
            resume && !matches!(found, StoredResult::Foreign) && store::is_begun(directory);
        return match found {
            _ if goes_on => None,
            StoredResult::Same | StoredResult::Damaged { of_this_case: true, .. } if resume => None,
            StoredResult::Same => Some(format!(
                "it holds the result of this case; --resume keeps it if it is finished and \
                 undamaged, {instead}"
            )),
            StoredResult::Damaged { error, of_this_case: true } => {
                let again = "--resume computes it anew";
                Some(format!("it holds a damaged result: {error}; {again}, {instead}"))
            }
            StoredResult::Damaged { error, .. } => {
                Some(format!("it holds a damaged result of another case: {error}; {instead}"))
            }
            StoredResult::Other(what) => {
                // A damaged attribute looks like another case or program.
                let damage = if resume { file_checksums::damage(directory, RESULT) } else { None };
                let damage = damage.map(|error| format!("; it is damaged, too: {error}"));
                let damage = damage.unwrap_or_default();
                Some(format!("it holds another result: {what}{damage}; {instead}"))
            }
            StoredResult::Foreign => {
                Some(format!("it holds a result.h5 that is not phasewarp's; {instead}"))
            }
        };
    }
    // Warped fields may be there without a result.h5: a stopped run leaves those that it finished.
    let warped = warped::names(case);
    let is_left = |name: &str| {
        warped.iter().any(|warped| warped == name) && is_of_this_program(&directory.join(name))
    };
    let others = files(case).map(|file| file.name);
    let mut names = [summary::NAME.to_owned()].into_iter().chain(others);
    let name = names.find(|name| there(name) && !is_left(name))?;
    Some(format!("it holds {name}, which belongs to no result.h5 there; {instead}"))
}

/// Whether `path` is an HDF5 file that this program wrote.
fn is_of_this_program(path: &Path) -> bool {
    let is_sound = untrusted::inspect(path, Inspection::Description).is_ok();
    let program = || File::open(path).and_then(|file| text_attribute(&file, "program"));
    is_sound && program().is_ok_and(|program| version::is_own(&program))
}

/// Removes files of an earlier run from `directory` that this run does not write: warped fields,
/// the table of readings, the report and the pictures. Only one rank calls it.
///
/// # Errors
/// [`Error::Output`].
pub fn remove_older(directory: &Path, case: &Case) -> Result<()> {
    let is_replaced = disk::is_taken(&directory.join(RESULT));
    warped::remove_older(directory, case, |path| is_replaced || is_of_this_program(path))?;
    if !is_replaced {
        return Ok(());
    }
    let table = case.readout.is_none().then_some(readout::files::NAME.into());
    let others = [report::NAME.into()].into_iter().chain(table).chain(pictures::files(directory));
    for name in others {
        let path = directory.join(name);
        if !path.is_dir() {
            disk::clear(&path).map_err(|e| failure(&path, &e))?;
        }
    }
    // This fails if the folder holds anything else, which is intended.
    let _ = std::fs::remove_dir(directory.join(pictures::FOLDER));
    Ok(())
}

/// Returns an error if the finished run of `case` in `directory` misses its goals and
/// `solver.strict` is set. Collective.
///
/// # Errors
/// [`Error::Missed`]; [`Error::Output`] if its summary cannot be read.
pub fn refuse_missed(world: &Group, directory: &Path, strict: bool) -> Result<()> {
    world.on_first_rank(|| {
        let missed = MissedGoals::deserialize(&summary::read(directory)?["missed"]);
        missed.unwrap_or_default().refuse(strict)
    })
}

/// The lines about the errors of the finished run in `directory`, and the goals that it misses, the
/// latter not if they are an error (`strict`). On other ranks than the first they are empty.
/// Collective.
///
/// # Errors
/// [`Error::Output`] if its summary cannot be read.
pub fn lines_about_errors(world: &Group, directory: &Path, strict: bool) -> Result<Vec<String>> {
    world.on_first_rank(|| {
        let stored = summary::read(directory)?;
        let accuracy = Accuracy::deserialize(&stored["accuracy"]).unwrap_or_default();
        let missed = MissedGoals::deserialize(&stored["missed"]).unwrap_or_default();
        let missed = missed.line().filter(|_| !strict);
        let continued = ContinuedResult::deserialize(&stored["continued"]).ok();
        let inherited = continued.as_ref().map(ContinuedResult::line);
        Ok(inherited.into_iter().chain(accuracy.line()).chain(missed).collect())
    })
}
