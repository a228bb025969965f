//! Whether a run was finished before, and its files are as they were written.

use crate::base::disk::failure;
use crate::base::error::Result;
use crate::base::version::GIT;
use crate::parallel::communicator::Group;
use crate::problem::case::Case;
use crate::results::readback::{self, read_text, text_attribute};
use crate::results::warped;
use crate::results::writer::Outcome;
use crate::results::xdmf;
use hdf5::File;
use std::path::Path;
use std::time::SystemTime;

/// Whether `directory` holds the results of `case` as this program makes them, written after the
/// file that it starts from; how often it makes checkpoints does not matter. Every dataset is
/// compared with its checksum. Collective over `world`.
///
/// # Errors
/// [`crate::base::error::Error::Output`], the same on all ranks, where the results are those of
/// `case`, but a file is damaged.
pub fn is_finished(world: &Group, directory: &Path, case: &Case) -> Result<bool> {
    // One rank looks, as any program would.
    let same =
        world.rank() == 0 && is_whole(directory, case) && is_same(directory, case).unwrap_or(false);
    if world.max_count(usize::from(same)) == 0 {
        return Ok(false);
    }
    world.on_first_rank(|| check_texts(directory, case))?;
    for name in ["result.h5"].into_iter().chain(warped::names(case).iter().map(String::as_str)) {
        readback::check(world, &directory.join(name))?;
    }
    Ok(true)
}

/// Whether all files are there, the summary last, and no checkpoint is left to continue from.
fn is_whole(directory: &Path, case: &Case) -> bool {
    let written = |name: &str| modified(&directory.join(name));
    let (Some(result), Some(summary)) = (written("result.h5"), written("summary.json")) else {
        return false;
    };
    let start = case.start.as_ref();
    let older = start.is_none_or(|start| modified(&start.path).is_some_and(|start| start < result));
    let fields = warped::names(case);
    let stopped = directory.join("checkpoint").exists();
    !stopped && summary >= result && older && fields.iter().all(|name| written(name).is_some())
}

/// When a file was written, if there is one.
fn modified(path: &Path) -> Option<SystemTime> {
    let found = std::fs::metadata(path).ok().filter(|found| found.is_file());
    found.and_then(|found| found.modified().ok())
}

/// Whether `result.h5` says that it is of this case, by this program.
fn is_same(directory: &Path, case: &Case) -> Outcome<bool> {
    let file = File::open(directory.join("result.h5"))?;
    let program = format!("phasewarp {}", env!("CARGO_PKG_VERSION"));
    if text_attribute(&file, "program")? != program || text_attribute(&file, "git")? != GIT {
        return Ok(false);
    }
    let dataset = file.dataset("case")?;
    let overrides = text_attribute(&dataset, "overrides")?;
    let overrides: Vec<String> = overrides.lines().map(str::to_owned).collect();
    let found = Case::parse(&case.name, &read_text(&dataset)?, &overrides);
    let settings = |case: &Case| {
        let mut settings = case.settings.clone();
        settings.retain(|key, _| !key.starts_with("checkpoint."));
        settings
    };
    Ok(found.is_ok_and(|found| settings(&found) == settings(case)))
}

/// Whether the files of text are there and end as they were written. By one rank.
fn check_texts(directory: &Path, case: &Case) -> Result<()> {
    let read = |name: &str| {
        let path = directory.join(name);
        std::fs::read_to_string(&path).map_err(|e| failure(&path, &e))
    };
    let incomplete = |name: &str| failure(&directory.join(name), &"is not as it was written");
    if serde_json::from_str::<serde_json::Value>(&read("summary.json")?).is_err() {
        return Err(incomplete("summary.json"));
    }
    if case.storage.xdmf && !read(xdmf::NAME)?.ends_with(xdmf::END) {
        return Err(incomplete(xdmf::NAME));
    }
    if case.readout.is_some() && !read("readout.csv")?.ends_with('\n') {
        return Err(incomplete("readout.csv"));
    }
    Ok(())
}
