//! What produced a result: program, commit, compiler, libraries, command, time.

use crate::base::version::GIT;
use crate::parallel::communicator::World;
use crate::problem::case::{Case, Origin};
use std::time::SystemTime;

/// Attributes of a result file as names and texts, the same on all ranks. Collective.
pub fn provenance(world: &World, case: &Case) -> Vec<(&'static str, String)> {
    let (major, minor, micro) = hdf5::library_version();
    // Clocks differ.
    let now = humantime::format_rfc3339_seconds(SystemTime::now());
    let date = world.group().broadcast_text(&now.to_string());
    let command: Vec<_> =
        std::env::args_os().map(|word| word.to_string_lossy().into_owned()).collect();
    let mut all = vec![
        ("program", format!("phasewarp {}", env!("CARGO_PKG_VERSION"))),
        ("git", GIT.to_owned()),
        ("rustc", env!("PHASEWARP_RUSTC").to_owned()),
        ("mpi", world.library()),
        ("hdf5", format!("{major}.{minor}.{micro}")),
        ("command", command.join(" ")),
        ("case_file", case.name.clone()),
        ("date", date),
    ];
    if let Some(file) = &case.initial_table {
        all.push(("table_file", file.path.display().to_string()));
        all.extend(file.checksum.map(|sum| ("table_checksum", format!("{sum:016x}"))));
    }
    if let Some(start) = &case.start_field {
        all.push(("start_file", start.path.display().to_string()));
        if let Some(Origin { checksum, time, .. }) = start.origin {
            all.push(("start_checksum", format!("{checksum:016x}")));
            all.push(("start_time", time.to_string()));
        }
    }
    all
}
