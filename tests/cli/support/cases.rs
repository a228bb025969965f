//! The case files, settings that make them small, and directories for results.

use super::launch::Job;
use crate::dense::{case_path, parsed};
use std::path::Path;
use std::sync::LazyLock;

/// The case files, sorted by name.
pub fn cases() -> Vec<String> {
    let folder = Path::new(env!("CARGO_MANIFEST_DIR")).join("cases");
    let mut names: Vec<String> = std::fs::read_dir(&folder)
        .unwrap_or_else(|e| panic!("{}: {e}", folder.display()))
        .filter_map(|entry| entry.ok()?.file_name().into_string().ok())
        .filter(|name| name.ends_with(".toml"))
        .collect();
    names.sort();
    assert!(names.len() >= 7, "cases/: only {names:?}");
    names
}

/// The cases of degree 0. Only this degree has limited slopes and two interface laws.
pub fn finite_volumes() -> Vec<String> {
    let of_degree_0 = |name: &String| parsed(name, &[]).is_ok_and(|c| c.space.degree() == 0);
    cases().into_iter().filter(of_degree_0).collect()
}

/// The cases with dissipation. Without it, a plan has one mode, which needs no error estimate.
pub fn dissipative() -> Vec<String> {
    let dissipates = |name: &String| parsed(name, &[]).is_ok_and(|case| case.scheme.flux > 0.0);
    cases().into_iter().filter(dissipates).collect()
}

/// Settings that make a case small enough for tests of all cases, with jumps of `V` still on faces;
/// none for most cases.
pub fn shrunk(name: &str) -> &'static [&'static str] {
    match name {
        "barriers.toml" => &["axis.0.x.cells=60", "axis.0.v.cells=41", "time.end=1.2"],
        "example1.toml" => &["axis.0.x.cells=64", "axis.0.v.cells=64"],
        "example2.toml" => &["axis.0.x.cells=48", "axis.0.v.cells=40"],
        "harmonic_step.toml" => &["axis.0.x.cells=48", "axis.0.v.cells=43"],
        "lens2d.toml" => &[
            "axis.0.x.cells=18", "axis.0.v.cells=7", "axis.1.x.cells=7", "axis.1.v.cells=4",
            "time.end=1.0",
        ],
        "periodic2d.toml" => {
            &["axis.0.x.cells=12", "axis.0.v.cells=7", "axis.1.x.cells=5", "axis.1.v.cells=5"]
        }
        "partial_reflection.toml" => &["axis.0.x.cells=10", "axis.0.v.cells=12"],
        "pulsed_inflow.toml" => &["axis.0.x.cells=24", "axis.0.v.cells=26"],
        "quantum_dot2d.toml" => {
            &["axis.0.x.cells=12", "axis.0.v.cells=8", "axis.1.x.cells=12", "axis.1.v.cells=7"]
        }
        "quadrant2d.toml" => {
            &["axis.0.x.cells=4", "axis.0.v.cells=4", "axis.1.x.cells=4", "axis.1.v.cells=2"]
        }
        "smooth-beams.toml" => &["axis.0.x.cells=10", "axis.0.v.cells=12"],
        "smooth_step3d.toml" => &[
            "axis.0.v.cells=2", "axis.1.x.cells=1", "axis.1.v.cells=1", "axis.2.x.cells=1",
            "axis.2.v.cells=1",
        ],
        "step_slope3d.toml" => &[
            "axis.0.x.cells=6", "axis.0.v.cells=5", "axis.1.x.cells=4", "axis.1.v.cells=4",
            "axis.2.x.cells=3", "axis.2.v.cells=4",
        ],
        _ => &[],
    }
}

/// The path of a case file.
pub fn case(name: &str) -> String {
    case_path(name).display().to_string()
}

/// Results are kept in memory if at least this many bytes are free there.
const ENOUGH: u64 = 4 << 30;

/// The directory of all results: in memory if there is room, otherwise below `target/`. On a disk,
/// short runs mostly wait until their results are written.
static RESULTS: LazyLock<&Path> = LazyLock::new(|| {
    let memory = Path::new("/dev/shm");
    let on_disk = Path::new(env!("CARGO_TARGET_TMPDIR"));
    let room = rustix::fs::statvfs(memory).map_or(0, |room| room.f_bavail * room.f_frsize);
    let writable = tempfile::tempfile_in(memory).is_ok();
    if room >= ENOUGH && writable { memory } else { on_disk }
});

/// A new directory for results, deleted when the value is dropped.
pub fn directory() -> tempfile::TempDir {
    tempfile::tempdir_in(*RESULTS).expect("a temporary directory")
}

/// The same below `target/`, for tests that act while a run writes to a disk.
pub fn directory_on_disk() -> tempfile::TempDir {
    tempfile::tempdir_in(env!("CARGO_TARGET_TMPDIR")).expect("a temporary directory below target/")
}

/// The method of a run with limited slopes.
pub const SLOPES: [&str; 2] = ["solver.method=classical", "solver.classical.integrator=ssp-rk3"];

/// Both interface laws.
pub const INTERFACES: [&str; 2] = ["hat", "conservative"];

/// A command of the program with a case of `cases/`.
pub fn of_case(command: &str, name: &str) -> Job {
    Job::new([command, &case(name)])
}

/// `phasewarp run` of a case of `cases/`.
pub fn run(name: &str) -> Job {
    of_case("run", name)
}

/// The settings of [`small_run`].
pub const SMALL: [&str; 4] =
    ["axis.0.x.cells=23", "axis.0.v.cells=17", "solver.tolerance=1e-3", "time.end=0.3"];

/// A run of example 1 of half a second at most, on odd numbers of cells.
pub fn small_run() -> Job {
    run("example1.toml").set(&SMALL)
}

/// `phasewarp check` of a case of `cases/`.
pub fn check(name: &str) -> Job {
    of_case("check", name)
}

/// A command of the program with a directory of results.
pub fn on_results(command: &str, results: impl AsRef<Path>) -> Job {
    Job::new([command, &results.as_ref().display().to_string()])
}

/// `phasewarp plan` of a case of `cases/`, for `ranks` ranks.
pub fn plan(name: &str, ranks: usize) -> Job {
    Job::new(["plan", &case(name), "--ranks", &ranks.to_string()])
}
