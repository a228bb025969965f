//! Checks a directory before a run writes there: it may hold the finished results of the same run,
//! or others, which are replaced only on demand.

use crate::base::disk::{self, failure};
use crate::base::error::{Error, Result};
use crate::base::version::GIT;
use crate::parallel::communicator::Group;
use crate::problem::case::{Case, differing_setting};
use crate::results::dataset::RESULT;
use crate::results::readback::{read_text, text_attribute};
use crate::results::untrusted::{self, Inspection};
use crate::results::writer::Hdf5Result;
use crate::results::{file_checksums, grids, pictures, report, warped, xdmf};
use hdf5::File;
use std::path::Path;
use std::time::SystemTime;

/// The text files of a run, except those of its grids.
const TEXTS: [&str; 3] = ["summary.json", xdmf::NAME, "readout.csv"];

/// Whether `directory` holds the complete results of `case` by this program, written after the
/// files that the case reads. The interval of checkpoints does not matter. Every dataset is
/// compared with its checksum, and every file with that in `summary.json`. Collective over `world`.
///
/// # Errors
/// [`crate::base::error::Error::Output`], the same on all ranks, if the results are those of `case`
/// but a file is damaged.
pub fn is_finished(world: &Group, directory: &Path, case: &Case) -> Result<bool> {
    // One rank reads the file without MPI.
    let same = world.rank() == 0
        && is_whole(directory, case)
        && matches!(difference(directory, case), Ok(None));
    if world.max_count(usize::from(same)) == 0 {
        return Ok(false);
    }
    for name in [RESULT].into_iter().chain(warped::names(case).iter().map(String::as_str)) {
        untrusted::check(world, &directory.join(name))?;
    }
    // Only files that the run would write; others may be in the directory.
    let listed = file_checksums::check(world, directory)?;
    let written = |name: &&str| case_writes(case, name);
    let texts = [RESULT, xdmf::NAME, "readout.csv"].into_iter().filter(written);
    let mut names = texts.map(str::to_owned).chain(grids::names_of(case));
    match names.find(|name| !listed.contains_key(name)) {
        Some(name) => Err(file_checksums::not_listed(directory, &name)),
        None => Ok(true),
    }
}

/// Whether a run of `case` writes the file `name`.
fn case_writes(case: &Case, name: &str) -> bool {
    match name {
        xdmf::NAME => case.storage.xdmf,
        RESULT => true,
        _ => case.readout.is_some(),
    }
}

/// Whether all files exist, the summary is the newest, and there is no checkpoint to continue from.
fn is_whole(directory: &Path, case: &Case) -> bool {
    let written = |name: &str| modified(&directory.join(name));
    let (Some(result), Some(summary)) = (written(RESULT), written("summary.json")) else {
        return false;
    };
    let given = [
        case.start.as_ref().map(|start| &start.path),
        case.start_field.as_ref().map(|start| &start.path),
    ];
    let tables = case.tables.iter().map(|file| &file.path);
    let mut given = given.into_iter().flatten().chain(tables);
    let older = given.all(|path| modified(path).is_some_and(|start| start < result));
    let fields = warped::names(case);
    let stopped = directory.join("checkpoint").exists();
    !stopped && summary >= result && older && fields.iter().all(|name| written(name).is_some())
}

/// The time at which a file was written; `None` if there is no such file.
fn modified(path: &Path) -> Option<SystemTime> {
    let found = std::fs::metadata(path).ok().filter(|found| found.is_file());
    found.and_then(|found| found.modified().ok())
}

/// A text that says how the case or the program of `result.h5` differs from `case` or this program;
/// `None` if they do not differ.
fn difference(directory: &Path, case: &Case) -> Hdf5Result<Option<String>> {
    let path = directory.join(RESULT);
    untrusted::inspect(&path, Inspection::Description).map_err(hdf5::Error::from)?;
    let file = File::open(path)?;
    let program = format!("phasewarp {}", env!("CARGO_PKG_VERSION"));
    let [by, git] = [text_attribute(&file, "program")?, text_attribute(&file, "git")?];
    let dataset = file.dataset("case")?;
    let overrides = text_attribute(&dataset, "overrides")?;
    let overrides: Vec<String> = overrides.lines().map(str::to_owned).collect();
    if by != program || git != GIT {
        return Ok(Some(format!("it is by {by} (git {git}), this is {program} (git {GIT})")));
    }
    let Ok(found) = Case::parse(&case.name, &read_text(&dataset)?, &overrides) else {
        return Ok(Some("its case is not one of this program".to_owned()));
    };
    Ok(differing_setting(&found.settings, &case.settings))
}

/// Refuses to replace files in `directory`: results of a finished run, and files with names of
/// results that no run wrote. A run with `resume` may replace results of the same case, as they are
/// damaged if they are not finished. If there is a checkpoint, it may replace any results.
/// Collective over `world`.
///
/// # Errors
/// [`Error::Directory`], the same on all ranks.
pub fn refuse_to_replace(world: &Group, directory: &Path, case: &Case, resume: bool) -> Result<()> {
    world.on_first_rank(|| match obstacle(directory, case, resume) {
        None => Ok(()),
        Some(reason) => Err(Error::Directory { path: directory.to_owned(), reason }),
    })
}

/// The reason why a run of `case` may not write into `directory`, with a remedy; `None` if it may.
fn obstacle(directory: &Path, case: &Case, resume: bool) -> Option<String> {
    let there = |name: &&str| std::fs::symlink_metadata(directory.join(name)).is_ok();
    let instead = "--force replaces it, -o gives another directory";
    if there(&RESULT) {
        let goes_on = resume && directory.join("checkpoint").is_dir();
        return match difference(directory, case) {
            Ok(_) if goes_on => None,
            Ok(None) if resume => None,
            Ok(None) => Some(format!(
                "it holds the result of this case; --resume keeps it if it is finished and \
                 undamaged, {instead}"
            )),
            Ok(Some(what)) => Some(format!("it holds another result: {what}; {instead}")),
            Err(_) => Some(format!("it holds a result.h5 that is not phasewarp's; {instead}")),
        };
    }
    // Warped fields may be there without a result.h5: a stopped run leaves those that it finished.
    let foreign = |name: &&str| !is_of_this_program(&directory.join(name));
    let warped = warped::names(case);
    let warped = warped.iter().map(String::as_str).filter(foreign);
    let grids: Vec<String> = grids::names().collect();
    let mut names = TEXTS.into_iter().chain(grids.iter().map(String::as_str)).chain(warped);
    let name = names.find(there)?;
    Some(format!("it holds {name}, which belongs to no result.h5 there; {instead}"))
}

/// Whether `path` is an HDF5 file that this program wrote.
fn is_of_this_program(path: &Path) -> bool {
    let is_sound = untrusted::inspect(path, Inspection::Description).is_ok();
    let program = || File::open(path).and_then(|file| text_attribute(&file, "program"));
    is_sound && program().is_ok_and(|program| program.starts_with("phasewarp "))
}

/// Removes files of an earlier run from `directory` that this run does not write: warped fields,
/// the table of readings, the report and the pictures. Only one rank calls it.
///
/// # Errors
/// [`Error::Output`].
pub fn remove_older(directory: &Path, case: &Case) -> Result<()> {
    let is_replaced = std::fs::symlink_metadata(directory.join(RESULT)).is_ok();
    warped::remove_older(directory, case, |path| is_replaced || is_of_this_program(path))?;
    if !is_replaced {
        return Ok(());
    }
    let table = case.readout.is_none().then_some(Path::new("readout.csv").to_owned());
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
