//! Disks that fill up during a run, and directories of results that are removed or made read-only.
//! The run ends with the right results or with one message and leaves no incomplete file. After the
//! fault is repaired, it can be continued. `make test` tries a few moments on each file system,
//! `make torture` many.

use crate::checkpoint::{OFTEN, Result};
use crate::dense::random;
use crate::support::{
    Finished, Job, Stored, check_all, datasets, directory_on_disk, equals_whole, half_written,
    names_in, number_from_environment, of_case, on_results,
};
use std::collections::BTreeMap;
use std::fs;
use std::io::Write;
use std::path::{Path, PathBuf};
use std::process::{Command, Stdio};
use std::sync::{Mutex, OnceLock};
use std::time::Duration;

/// The size of a disk in bytes.
const SIZE: u64 = 16 << 20;
/// A run on a full disk that takes longer than this number of seconds counts as hanging.
const LIMIT: u64 = 60;

/// File systems with and without reservations of space (`fallocate`).
const SYSTEMS: [&str; 3] = ["tmpfs", "ext4", "ext2"];

/// What happens to a disk, or to the directory of the results on it.
#[derive(Clone, Copy, Debug, PartialEq)]
enum Event {
    Full,
    Removed,
    ReadOnly,
}

const EVENTS: [Event; 3] = [Event::Full, Event::Removed, Event::ReadOnly];

/// Settings of the kinds of runs, which differ in the files they write.
const KINDS: [&[&str]; 5] = [
    &[],
    &["output.warped_field=true"],
    &["output.compression=4", "output.chunks=[5,5]"],
    &["output.field_times=[0.1,0.2]", "output.moments_every=0.05", "readout={cells=[[3]]}"],
    &["solver.tolerance=1e-2", "solver.warp.profile=exponential", "solver.warp.points=512", OFTEN],
];

fn job(kind: usize) -> Job {
    let small = ["axis.0.x.cells=60", "axis.0.v.cells=50", "time.end=0.3"];
    let job = of_case("run", "example1.toml").set(&small).set(KINDS[kind]);
    // Where HDF5 leaves all ranks waiting for each other, the job ends after that.
    job.environment("PHASEWARP_STOPPED_SECONDS", "20")
}

/// A mounted disk, unmounted when the value is dropped.
struct Disk {
    place: tempfile::TempDir,
    root: PathBuf,
}

impl Disk {
    /// An empty disk, or an error if this process may not mount one.
    fn new(system: &str) -> Result<Self> {
        let place = directory_on_disk();
        let root = place.path().join("disk");
        fs::create_dir(&root).map_err(|e| e.to_string())?;
        let target = root.display().to_string();
        if system == "tmpfs" {
            let size = format!("size={SIZE}");
            call("mount", &["-t", "tmpfs", "-o", &size, "tmpfs", &target])?;
        } else {
            let image = place.path().join("image");
            let file = fs::File::create(&image).map_err(|e| e.to_string())?;
            file.set_len(SIZE).map_err(|e| e.to_string())?;
            let image = image.display().to_string();
            call(&format!("mkfs.{system}"), &["-q", "-m", "0", &image])?;
            call("mount", &["-o", "loop", &image, &target])?;
        }
        Ok(Self { place, root })
    }

    /// The file that fills the disk.
    fn filler(&self) -> PathBuf {
        self.root.join("filler")
    }

    /// Fills the disk up to `room` free bytes.
    fn fill(&self, room: u64) -> Result<()> {
        let free = rustix::fs::statvfs(&self.root).map_err(|e| e.to_string())?;
        let mut file = fs::File::create(self.filler()).map_err(|e| e.to_string())?;
        let mut left = (free.f_bavail * free.f_frsize).saturating_sub(room);
        let block = [0; 1 << 16];
        while left > 0 {
            // If the run writes at the same time, the disk may be full earlier.
            match file.write(&block[..left.min(block.len() as u64) as usize]) {
                Ok(written) if written > 0 => left -= written as u64,
                _ => break,
            }
        }
        Ok(())
    }
}

impl Drop for Disk {
    fn drop(&mut self) {
        let _ = protect(&self.root, false);
        let root = self.root.display().to_string();
        let lazy = call("umount", &[&root]).or_else(|_| call("umount", &["-l", &root]));
        if let Err(why) = lazy {
            eprintln!("{}: {why}", self.place.path().display());
        }
    }
}

/// Makes a directory and its contents immutable, also for root, or mutable again.
fn protect(directory: &Path, now: bool) -> Result<()> {
    call("chattr", &["-R", if now { "+i" } else { "-i" }, &directory.display().to_string()])
}

fn call(program: &str, arguments: &[&str]) -> Result<()> {
    let mut command = Command::new(program);
    let found = command.args(arguments).stdin(Stdio::null()).output();
    let output = found.map_err(|e| format!("{program}: {e}"))?;
    if output.status.success() {
        Ok(())
    } else {
        Err(format!("{program}: {}", String::from_utf8_lossy(&output.stderr)))
    }
}

/// The datasets of each kind of run on a disk with enough room.
static WHOLES: [OnceLock<Result<BTreeMap<String, Stored>>>; KINDS.len()] =
    [const { OnceLock::new() }; KINDS.len()];

fn whole(kind: usize) -> Result<&'static BTreeMap<String, Stored>> {
    let run = || {
        let place = directory_on_disk();
        job(kind).solve(place.path())?;
        datasets(place.path())
    };
    WHOLES[kind].get_or_init(run).as_ref().map_err(String::clone)
}

/// Moments of events: each begins when a file or directory appears whose name contains the text.
const MOMENTS: [(&str, &str); 5] = [
    ("any time", ""),
    ("checkpoint", "checkpoint"),
    ("fields", "result.h5.partial"),
    ("summary", "summary.json"),
    ("other files", ".partial"),
];

/// The number of trials and of those that ended with an error.
type Trials = [usize; 2];

/// The trials by event and file system, and by event and moment.
#[derive(Default)]
struct Tally {
    by_system: [[Trials; SYSTEMS.len()]; EVENTS.len()],
    by_moment: [[Trials; MOMENTS.len()]; EVENTS.len()],
}

/// One run on one disk, with an event at a random time after one of the [`MOMENTS`].
fn trial(number: u64, tally: &Mutex<Tally>) -> Result<()> {
    let draw = |what: u64| random(977 * number + what);
    let kind = number as usize / SYSTEMS.len() % KINDS.len();
    let event = number as usize / SYSTEMS.len() % EVENTS.len();
    let expected = whole(kind)?;
    let system = number as usize % SYSTEMS.len();
    let disk = Disk::new(SYSTEMS[system])?;
    let results = disk.root.join("results");
    let moment = (MOMENTS.len() as f64 * draw(1)) as usize;
    let awaited = MOMENTS[moment].1;
    let longest = if awaited.is_empty() { 0.5 } else { 0.02 };
    let delay = Duration::from_secs_f64(longest * draw(2));
    let room = if draw(3) < 0.3 { 0 } else { (2e5 * draw(4)) as u64 };
    let mut begun = awaited.is_empty().then_some(Duration::ZERO);
    let mut happened = None;
    let run = job(kind).on(1 + (3.0 * draw(5)) as usize).into(&results).within(LIMIT);
    let finished = run.closely().run_while(|_, since| {
        if begun.is_none() && names_in(&results).iter().any(|name| name.contains(awaited)) {
            begun = Some(since);
        }
        if happened.is_none() && begun.is_some_and(|begun| since >= begun + delay) {
            happened = Some(happen(EVENTS[event], &disk, &results, room));
        }
    })?;
    happened.unwrap_or(Ok(()))?;
    ended_well(EVENTS[event], &finished, &results)?;
    {
        let Tally { by_system, by_moment } = &mut *tally.lock().map_err(|e| e.to_string())?;
        for [runs, errors] in [&mut by_system[event][system], &mut by_moment[event][moment]] {
            (*runs, *errors) = (*runs + 1, *errors + usize::from(finished.code != Some(0)));
        }
    }
    protect(&disk.root, false)?;
    if disk.filler().exists() {
        fs::remove_file(disk.filler()).map_err(|e| e.to_string())?;
    }
    let again = job(kind).on(1 + (2.0 * draw(6)) as usize).into(&results).with(["--resume"]);
    again.succeed()?;
    equals_whole(&results, expected, &[]).map_err(|what| finished.report(&what))?;
    if let Some(name) = half_written(&results) {
        return Err(finished.report(&format!("{name} is not removed")));
    }
    on_results("check-result", results).succeed().map(drop)
}

fn happen(event: Event, disk: &Disk, results: &Path, room: u64) -> Result<()> {
    match event {
        Event::Full => disk.fill(room),
        // The removal may fail because the run writes at the same time.
        Event::Removed if results.exists() => {
            let _ = fs::remove_dir_all(results);
            Ok(())
        }
        Event::Removed => Ok(()),
        // The command may fail because the run renames files at the same time.
        Event::ReadOnly => {
            let _ = protect(&disk.root, true);
            Ok(())
        }
    }
}

/// Checks that a run succeeded, or ended with a message and left no incomplete file that it could
/// have removed.
fn ended_well(event: Event, finished: &Finished, results: &Path) -> Result<()> {
    let left = half_written(results).filter(|_| event != Event::ReadOnly);
    match finished.code {
        Some(0) => Ok(()),
        Some(1 | 2) if finished.errors.contains("error: ") && left.is_none() => Ok(()),
        _ => {
            Err(finished.report(&format!("{event:?}: ended so, and left {:?}", names_in(results))))
        }
    }
}

#[test]
fn full_lost_and_read_only_disks_are_survived() {
    if let Some(why) = SYSTEMS.iter().find_map(|system| Disk::new(system).err()) {
        println!("skipped: no disk to fill: {why}");
        return;
    }
    let first = number_from_environment("PHASEWARP_FIRST_TRIAL", 0);
    let count = number_from_environment("PHASEWARP_TRIALS", 9);
    let all: Vec<u64> = (first..first + count).collect();
    let tally = Mutex::new(Tally::default());
    check_all(&all, |&number| {
        trial(number, &tally).map_err(|why| format!("trial {number}: {why}"))
    });
    let Tally { by_system, by_moment } = tally.into_inner().expect("no thread failed");
    println!("| event | disk | runs | ended with an error |\n|---|---|---|---|");
    for (event, tally) in EVENTS.iter().zip(by_system) {
        for (system, [runs, errors]) in SYSTEMS.iter().zip(tally) {
            println!("| {event:?} | {system} | {runs} | {errors} |");
            // With few runs, the event may come after the end of all of them.
            assert!(errors > 0 || runs < 20, "no run on {system} failed by {event:?}");
        }
    }
    println!("| event | moment | runs | ended with an error |\n|---|---|---|---|");
    for (event, tally) in EVENTS.iter().zip(by_moment) {
        for ((moment, _), [runs, errors]) in MOMENTS.iter().zip(tally) {
            println!("| {event:?} | {moment} | {runs} | {errors} |");
        }
    }
}
