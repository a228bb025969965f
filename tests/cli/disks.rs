//! Disks that fill up while a run works: it ends with the right results or with one message, leaves
//! nothing half-written, and goes on when there is room again. `make test` tries a few moments on
//! each file system, `make torture` many.

use crate::checkpoint::{OFTEN, Result, random};
use crate::support::{
    Job, Stored, case, check_all, datasets, differences, directory_on_disk, number_from_environment,
};
use std::collections::BTreeMap;
use std::fs;
use std::io::Write;
use std::path::{Path, PathBuf};
use std::process::{Command, Stdio};
use std::sync::{Mutex, OnceLock};
use std::time::Duration;

/// Bytes of a disk.
const SIZE: u64 = 16 << 20;
/// Seconds after which a run on a full disk is taken for one that hangs.
const LIMIT: u64 = 60;

/// File systems with and without reservations of space (`fallocate`).
const SYSTEMS: [&str; 3] = ["tmpfs", "ext4", "ext2"];

/// What runs write, and how.
const KINDS: [&[&str]; 5] = [
    &[],
    &["output.warped_field=true"],
    &["output.compression=4", "output.chunks=[5,5]"],
    &["output.field_times=[0.1,0.2]", "output.moments_every=0.05", "readout={cells=[[3]]}"],
    &["solver.tolerance=1e-2", "solver.warp.profile=exponential", "solver.warp.points=512", OFTEN],
];

fn job(kind: usize) -> Job {
    let small = ["axis.0.x.cells=60", "axis.0.v.cells=50", "time.end=0.3"];
    Job::new(["run", &case("example1.toml")]).set(&small).set(KINDS[kind])
}

/// A disk of its own, unmounted when the trial is over.
struct Disk {
    place: tempfile::TempDir,
    root: PathBuf,
}

impl Disk {
    /// An empty disk; an error where this process may not mount one.
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

    /// The file that takes the room.
    fn filler(&self) -> PathBuf {
        self.root.join("filler")
    }

    /// Leaves at most `room` bytes.
    fn fill(&self, room: u64) -> Result<()> {
        let free = rustix::fs::statvfs(&self.root).map_err(|e| e.to_string())?;
        let mut file = fs::File::create(self.filler()).map_err(|e| e.to_string())?;
        let mut left = (free.f_bavail * free.f_frsize).saturating_sub(room);
        let block = [0; 1 << 16];
        while left > 0 {
            // It fails where the run writes at the same time: then the disk is full.
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
        let root = self.root.display().to_string();
        let lazy = call("umount", &[&root]).or_else(|_| call("umount", &["-l", &root]));
        if let Err(why) = lazy {
            eprintln!("{}: {why}", self.place.path().display());
        }
    }
}

fn call(program: &str, arguments: &[&str]) -> Result<()> {
    let mut command = Command::new(program);
    let found = command.args(arguments).stdin(Stdio::null()).output();
    let output = found.map_err(|e| format!("{program}: {e}"))?;
    match output.status.success() {
        true => Ok(()),
        false => Err(format!("{program}: {}", String::from_utf8_lossy(&output.stderr))),
    }
}

/// The datasets of each kind, on a disk with room.
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

fn names(directory: &Path) -> Vec<String> {
    let entries = fs::read_dir(directory).into_iter().flatten();
    entries.filter_map(|entry| entry.ok()?.file_name().into_string().ok()).collect()
}

/// Trials on each file system, and how many of them ended with an error.
type Tally = Mutex<[[usize; 2]; SYSTEMS.len()]>;

/// One run on one disk that is filled at a moment: at a time, with the first checkpoint, or as soon
/// as a file is written.
fn trial(number: u64, tally: &Tally) -> Result<()> {
    let draw = |what: u64| random(977 * number + what);
    let kind = number as usize / SYSTEMS.len() % KINDS.len();
    let expected = whole(kind)?;
    let system = number as usize % SYSTEMS.len();
    let disk = Disk::new(SYSTEMS[system])?;
    let results = disk.root.join("results");
    let awaited = ["", "checkpoint", ".partial", ".partial"][(4.0 * draw(1)) as usize];
    let longest = if awaited.is_empty() { 0.5 } else { 0.02 };
    let delay = Duration::from_secs_f64(longest * draw(2));
    let room = match draw(3) < 0.3 {
        true => 0,
        false => (2e5 * draw(4)) as u64,
    };
    let mut begun = awaited.is_empty().then_some(Duration::ZERO);
    let mut filled = None;
    let run = job(kind).on(1 + (3.0 * draw(5)) as usize).into(&results).within(LIMIT);
    let finished = run.closely().run_while(|_, since| {
        if begun.is_none() && names(&results).iter().any(|name| name.contains(awaited)) {
            begun = Some(since);
        }
        if filled.is_none() && begun.is_some_and(|begun| since >= begun + delay) {
            filled = Some(disk.fill(room));
        }
    })?;
    filled.unwrap_or(Ok(()))?;
    let left = names(&results);
    let half_written = left.iter().find(|name| name.ends_with(".partial"));
    match finished.code {
        Some(0) => {}
        Some(1 | 2) if finished.errors.contains("error: ") && half_written.is_none() => {}
        _ => return Err(finished.report(&format!("ended on a full disk, which holds {left:?}"))),
    }
    let met = usize::from(finished.code != Some(0));
    {
        let mut tally = tally.lock().map_err(|e| e.to_string())?;
        tally[system] = [tally[system][0] + 1, tally[system][1] + met];
    }
    if disk.filler().exists() {
        fs::remove_file(disk.filler()).map_err(|e| e.to_string())?;
    }
    let again = job(kind).on(1 + (2.0 * draw(6)) as usize).into(&results).with(["--resume"]);
    again.succeed()?;
    let differ = differences(&datasets(&results)?, expected);
    if !differ.is_empty() {
        return Err(finished.report(&format!("then other bits in {differ:?}")));
    }
    Job::new(["check-result", &results.display().to_string()]).succeed().map(drop)
}

#[test]
fn full_disks_are_survived() {
    if let Some(why) = SYSTEMS.iter().find_map(|system| Disk::new(system).err()) {
        println!("skipped: no disk to fill: {why}");
        return;
    }
    let first = number_from_environment("PHASEWARP_FIRST_TRIAL", 0);
    let count = number_from_environment("PHASEWARP_TRIALS", 6);
    let all: Vec<u64> = (first..first + count).collect();
    let tally = Tally::default();
    check_all(&all, |&number| {
        trial(number, &tally).map_err(|why| format!("trial {number}: {why}"))
    });
    let tally = tally.into_inner().expect("no thread failed");
    println!("| disk | runs | ended with an error |\n|---|---|---|");
    for (system, [runs, errors]) in SYSTEMS.iter().zip(tally) {
        println!("| {system} | {runs} | {errors} |");
        // Of a few runs none may meet a full disk.
        assert!(errors > 0 || runs < 20, "no run on {system} met a full disk");
    }
}
