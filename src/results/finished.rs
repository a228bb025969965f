//! Whether a run was finished before.

use crate::base::version::GIT;
use crate::parallel::communicator::Group;
use crate::problem::case::Case;
use crate::results::readback::{read_text, text_attribute};
use crate::results::warped;
use crate::results::writer::Outcome;
use hdf5::File;
use std::path::Path;
use std::time::SystemTime;

/// Whether `directory` holds the results of `case` as this program makes them, written after the
/// file that it starts from; how often it makes checkpoints does not matter. Collective over
/// `world`.
pub fn is_finished(world: &Group, directory: &Path, case: &Case) -> bool {
    // One rank looks, as any program would.
    let same =
        world.rank() == 0 && is_whole(directory, case) && is_same(directory, case).unwrap_or(false);
    world.max_count(usize::from(same)) > 0
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
