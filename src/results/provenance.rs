//! The origin of a result: program, commit, compiler, libraries, command, time.

use crate::base::checksum;
use crate::base::version::{GIT, PROGRAM};
use crate::parallel::communicator::World;
use crate::problem::case::{Case, ResultOrigin};
use crate::results::table_file::{checksum_name, file_name};
use std::time::SystemTime;

/// The attribute of a continued run that says that all its parts are of one problem.
pub const SAME_PROBLEM: &str = "same_problem";

/// Attributes of a result file as names and texts, the same on all ranks. Collective.
pub fn provenance(world: &World, case: &Case) -> Vec<(String, String)> {
    let (major, minor, micro) = hdf5::library_version();
    // The first rank's clock gives the date on all ranks.
    let now = humantime::format_rfc3339_seconds(SystemTime::now());
    let date = world.group().broadcast_text(&now.to_string());
    let command: Vec<_> =
        std::env::args_os().map(|word| word.to_string_lossy().into_owned()).collect();
    let all = [
        ("program", PROGRAM.to_owned()),
        ("git", GIT.to_owned()),
        ("rustc", env!("PHASEWARP_RUSTC").to_owned()),
        ("mpi", world.library()),
        ("hdf5", format!("{major}.{minor}.{micro}")),
        ("command", command.join(" ")),
        ("case_file", case.name.clone()),
        ("date", date),
    ];
    let mut all = all.map(|(name, text)| (name.to_owned(), text)).to_vec();
    for file in &case.tables {
        let path = std::fs::canonicalize(&file.path).unwrap_or_else(|_| file.path.clone());
        all.push((file_name(file.of), path.display().to_string()));
        all.extend(file.checksum.map(|sum| (checksum_name(file.of), checksum::text(sum))));
    }
    if let Some(start) = &case.start_field {
        all.push(("start_file".to_owned(), start.path.display().to_string()));
        if case.follows_from_formulas() {
            all.push((SAME_PROBLEM.to_owned(), "since t = 0".to_owned()));
        }
        if let Some(ResultOrigin { checksum, time, .. }) = start.origin {
            all.push(("start_checksum".to_owned(), checksum::text(checksum)));
            all.push(("start_time".to_owned(), time.to_string()));
        }
    }
    all
}
