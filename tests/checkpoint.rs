//! Runs that are stopped and go on: killed at any moment, told to stop, out of time, with damaged checkpoints, on a full disk.
//! Whatever happened, the end has the bits of a run that nothing happened to.

#[path = "support/launch.rs"]
mod launch;
#[path = "support/results.rs"]
mod results;

use launch::{Finished, Job, Summary, case, check_all, directory};
use results::{Stored, datasets, datasets_of, differences};
use serde_json::Value;
use std::collections::BTreeMap;
use std::fs;
use std::path::{Path, PathBuf};
use std::process::Command;
use std::sync::LazyLock;
use std::time::{Duration, Instant};
use tempfile::TempDir;

/// About a second and a half on two ranks: 129 batches of modes.
const LONG: [&str; 5] = [
    "solver.tolerance=1e-3",
    "solver.warp.profile=exponential",
    "solver.warp.points=2048",
    "axis.0.x.cells=40",
    "axis.0.v.cells=26",
];
/// A checkpoint after nearly every batch.
const OFTEN: &str = "checkpoint.minutes=0.00001";

/// A result and its summary.
type Result<T> = std::result::Result<T, String>;

fn run() -> Job {
    Job::new(["run", &case("example1.toml")]).set(&LONG)
}

/// What a run gives that nothing happens to.
static WHOLE: LazyLock<(BTreeMap<String, Stored>, usize)> = LazyLock::new(|| {
    let whole = directory();
    let summary = run().on(2).solve(whole.path()).expect("a whole run");
    let matvecs = count(&summary, "matvecs").expect("matvecs");
    assert_eq!(count(&summary, "matvecs_here"), Ok(matvecs));
    assert_eq!(summary.boolean("resumed"), Ok(false));
    assert_eq!(count(&summary, "checkpoints"), Ok(0));
    (datasets(whole.path()).expect("datasets"), matvecs)
});

fn count(summary: &Summary, key: &str) -> Result<usize> {
    summary.number(key).map(|n| n as usize)
}

fn io<T>(result: std::io::Result<T>) -> Result<T> {
    result.map_err(|e| e.to_string())
}

/// Goes on from what is in `directory`, to the end, and compares with the whole run, bit for bit; every application that the
/// checkpoint holds is done once.
fn ends_well(job: Job, directory: &Path) -> Result<Summary> {
    let done = match newest(directory) {
        Some(newest) => manifest(&newest)?["matvecs"].as_u64().unwrap_or(0) as usize,
        None => 0,
    };
    let summary = job.with(["--resume"]).solve(directory)?;
    same(directory, &summary)?;
    let (here, all) = (count(&summary, "matvecs_here")?, WHOLE.1);
    summary.require(here + done == all, || {
        format!("{done} applications in the checkpoint and {here} after it are not {all}")
    })?;
    summary.require(!directory.join("checkpoint").exists(), || {
        "the checkpoints of a finished run are still there".to_owned()
    })?;
    Ok(summary)
}

/// Whether the results are those of the whole run.
fn same(directory: &Path, summary: &Summary) -> Result<()> {
    let differing = differences(&datasets(directory)?, &WHOLE.0);
    summary.require(differing.is_empty(), || {
        format!("differs from the whole run in {differing:?}")
    })?;
    let (found, expected) = (count(summary, "matvecs")?, WHOLE.1);
    summary.require(found == expected, || {
        format!("{found} applications, {expected} in the whole run")
    })
}

/// The generations in `directory`, newest first; complete ones only.
fn generations(directory: &Path) -> Vec<PathBuf> {
    let entries = fs::read_dir(directory.join("checkpoint"));
    let mut found: Vec<PathBuf> = (entries.into_iter().flatten().flatten())
        .map(|entry| entry.path())
        .filter(|path| path.join("manifest.json").exists())
        .collect();
    found.sort();
    found.reverse();
    found
}

fn newest(directory: &Path) -> Option<PathBuf> {
    generations(directory).into_iter().next()
}

fn manifest(generation: &Path) -> Result<Value> {
    let text = io(fs::read_to_string(generation.join("manifest.json")))?;
    let value: Value = serde_json::from_str(&text).map_err(|e| e.to_string())?;
    Ok(value["manifest"].clone())
}

/// A number in [0, 1) for `seed`.
fn random(seed: u64) -> f64 {
    let z = (seed + 1).wrapping_mul(0x9e37_79b9_7f4a_7c15);
    let z = (z ^ (z >> 30)).wrapping_mul(0xbf58_476d_1ce4_e5b9);
    let z = (z ^ (z >> 27)).wrapping_mul(0x94d0_49bb_1331_11eb);
    ((z ^ (z >> 31)) >> 11) as f64 / (1u64 << 53) as f64
}

fn send(signal: &str, process: u32) {
    let _ = Command::new("kill")
        .args([signal, &process.to_string()])
        .status();
}

/// The processes that `parent` started.
fn children(parent: u32) -> Vec<u32> {
    let path = format!("/proc/{parent}/task/{parent}/children");
    let text = fs::read_to_string(path).unwrap_or_default();
    text.split_whitespace()
        .filter_map(|id| id.parse().ok())
        .collect()
}

fn is_alive(process: u32) -> bool {
    // A zombie has ended.
    let text = fs::read_to_string(format!("/proc/{process}/stat")).unwrap_or_default();
    !text.is_empty() && !text.contains(") Z")
}

/// What a run is stopped by.
#[derive(Clone, Copy, Debug)]
enum Blow {
    /// SIGKILL of this rank.
    Rank(usize),
    /// SIGKILL of mpirun.
    Launcher,
    /// SIGUSR1 to mpirun.
    Signal,
}

/// Runs a job and deals it a blow at the first moment that `now` finds right; all its ranks have ended when this returns.
fn struck(job: &Job, blow: Blow, mut now: impl FnMut(Duration) -> bool) -> Result<Finished> {
    let (mut ranks, mut struck) = (Vec::new(), false);
    let finished = job.clone().closely().run_while(|mpirun, since| {
        if struck {
            return;
        }
        ranks = children(mpirun.id());
        if ranks.is_empty() || !now(since) {
            return;
        }
        struck = true;
        match blow {
            Blow::Rank(rank) => send("-KILL", ranks[rank.min(ranks.len() - 1)]),
            Blow::Launcher => send("-KILL", mpirun.id()),
            Blow::Signal => send("-USR1", mpirun.id()),
        }
    })?;
    // Ranks that lost their mpirun end by themselves, a moment later.
    let waiting = Instant::now();
    while ranks.iter().any(|&rank| is_alive(rank)) {
        if waiting.elapsed() > Duration::from_secs(20) {
            return Err(finished.report("ranks outlive mpirun by 20 s"));
        }
        std::thread::sleep(Duration::from_millis(10));
    }
    Ok(finished)
}

/// A run with checkpoints, stopped by SIGUSR1 when two are there.
fn stopped(ranks: usize) -> Result<TempDir> {
    let directory = directory();
    let path = directory.path();
    let job = run().on(ranks).set(&[OFTEN]).into(path);
    let finished = struck(&job, Blow::Signal, |_| generations(path).len() == 2)?;
    if finished.code == Some(75) && finished.errors.contains("--resume") {
        Ok(directory)
    } else {
        Err(finished.report("exit code 75 expected, and how to go on"))
    }
}

#[test]
fn runs_killed_at_any_moment_end_with_the_same_bits() {
    LazyLock::force(&WHOLE);
    // Each is killed three times, then left alone; every start is on other ranks.
    let rows: Vec<u64> = (0..6).collect();
    check_all(&rows, |&row| {
        let directory = directory();
        let path = directory.path();
        for strike in 0..3 {
            let seed = 10 * row + strike;
            let ranks = 1 + (row + strike) as usize % 4;
            let blow = match seed % 3 {
                0 => Blow::Launcher,
                rank => Blow::Rank(rank as usize - 1),
            };
            let blocks = if ranks == 4 { "2" } else { "1" };
            let job =
                run()
                    .on(ranks)
                    .set(&[OFTEN])
                    .into(path)
                    .with(["--resume", "--ranks-x", blocks]);
            let after = Duration::from_secs_f64(0.3 + 1.2 * random(seed));
            let finished = struck(&job, blow, |since| since > after)?;
            if finished.code == Some(0) {
                break;
            }
        }
        if path.join("summary.json").exists() {
            // It was over before it was killed.
            let differing = differences(&datasets(path)?, &WHOLE.0);
            return match differing.is_empty() {
                true => Ok(()),
                false => Err(format!("row {row} differs in {differing:?}")),
            };
        }
        let ranks = 1 + (row as usize + 3) % 4;
        ends_well(run().on(ranks), path).map(|_| ())
    });
}

#[test]
fn runs_killed_while_they_write_a_checkpoint_end_with_the_same_bits() {
    LazyLock::force(&WHOLE);
    let rows = [
        (2, Blow::Rank(0)),
        (2, Blow::Rank(1)),
        (3, Blow::Launcher),
        (4, Blow::Rank(2)),
    ];
    check_all(&rows, |&(ranks, blow)| {
        let directory = directory();
        let path = directory.path();
        let job = run().on(ranks).set(&[OFTEN]).into(path);
        // In the middle of a generation that follows others: without a manifest.
        let mut seen = 0;
        let finished = struck(&job, blow, |_| {
            let all = fs::read_dir(path.join("checkpoint"))
                .into_iter()
                .flatten()
                .count();
            let writes = generations(path).len() >= 2 && all > generations(path).len();
            seen += usize::from(writes);
            writes
        })?;
        if finished.code == Some(0) || seen == 0 {
            return Err(finished.report("not killed"));
        }
        ends_well(run().on(5 - ranks), path).map(|_| ())
    });
}

#[test]
fn told_to_stop_a_run_leaves_a_checkpoint_for_any_ranks() {
    LazyLock::force(&WHOLE);
    let rows = [
        (2, 2, "1"),
        (2, 1, "1"),
        (1, 3, "3"),
        (3, 4, "2"),
        (4, 2, "2"),
    ];
    check_all(&rows, |&(before, after, blocks)| {
        let directory = stopped(before)?;
        let path = directory.path();
        let summary = ends_well(run().on(after).with(["--ranks-x", blocks]), path)?;
        summary.require(summary.boolean("resumed")?, || "did not go on".to_owned())
    });
}

/// Stops a run in stage number `stage`, goes on with it on other ranks, and compares everything with a run that nothing
/// happened to.
fn goes_on_in_stage(
    job: &Job,
    stage: u64,
    ranks: [(usize, &str); 2],
    numbers: &[&str],
) -> Result<()> {
    let [before, after] =
        ranks.map(|(ranks, blocks)| job.clone().on(ranks).with(["--ranks-x", blocks]));
    let whole = directory();
    let expected = job.clone().on(2).solve(whole.path())?;
    let cut = directory();
    let path = cut.path();
    let finished = struck(&before.set(&[OFTEN]).into(path), Blow::Signal, |_| {
        let found = newest(path).and_then(|newest| manifest(&newest).ok());
        found.is_some_and(|m| m["stage"] == stage)
    })?;
    if finished.code != Some(75) {
        return Err(finished.report("exit code 75 expected"));
    }
    let summary = after.with(["--resume"]).solve(path)?;
    for file in fs::read_dir(whole.path()).into_iter().flatten().flatten() {
        let name = file.file_name();
        if name.to_string_lossy().ends_with(".h5") {
            let [found, expected] = [path, whole.path()].map(|d| datasets_of(&d.join(&name)));
            let differing = differences(&found?, &expected?);
            summary.require(differing.is_empty(), || {
                format!("{name:?}: {differing:?} differ")
            })?;
        }
    }
    for key in numbers {
        let (found, expected) = (&summary.value[key], &expected.value[key]);
        summary.require(found == expected, || {
            format!("{key}: {found}, {expected} expected")
        })?;
    }
    let here = count(&summary, "matvecs_here")?;
    summary.require(here < count(&expected, "matvecs")?.max(1), || {
        "nothing was taken over".to_owned()
    })
}

#[test]
fn stages_that_are_finished_are_not_computed_again() {
    // Density and level set one after the other, with moments before the end, an implicit method and a plateau.
    let fields = Job::new(["run", &case("example2.toml")]).set(&[
        "axis.0.x.cells=32",
        "axis.0.v.cells=24",
        "solver.tolerance=1e-2",
        "solver.propagator={method='crank-nicolson',step=0.01}",
        "solver.warp.profile=exponential",
        "solver.warp.points=512",
        "output.moments_every=0.5",
        "output.plateau.points=3",
    ]);
    // All modes kept, with inflow: auxiliary unknowns move with their cells.
    let kept = |more: &[&str]| {
        Job::new(["run", &case("example2.toml"), "--mode", "full"])
            .set(&[
                "axis.0.x.cells=32",
                "axis.0.v.cells=24",
                "solver.tolerance=1e-2",
                "solver.warp.profile=exponential",
                "solver.warp.points=512",
                "output.field_times=[0.3,0.6]",
            ])
            .set(more)
    };
    let told = [
        "matvecs",
        "solves",
        "unitarity_defect",
        "norm_kept",
        "step_error",
        "error_estimate",
    ];
    let rows = [
        (fields, 1, [(2, "1"), (3, "1")]),
        (kept(&[]), 1, [(2, "2"), (3, "3")]),
        (kept(&[]), 4, [(3, "1"), (4, "2")]),
        (
            kept(&["solver.warp.inflow='full'"]),
            0,
            [(1, "1"), (4, "4")],
        ),
        (
            kept(&["solver.warp.inflow='full'"]),
            5,
            [(4, "2"), (1, "1")],
        ),
    ];
    check_all(&rows, |(job, stage, ranks)| {
        goes_on_in_stage(job, *stage, *ranks, &told)
    });
}

#[test]
fn runs_stop_before_their_time_is_over_and_go_on() {
    LazyLock::force(&WHOLE);
    let directory = directory();
    let path = directory.path();
    // How long the start and the rest take depends on what else the machine does: neither too little nor enough for all.
    let (mut pieces, mut seconds) = (0, 0.5_f64);
    for attempt in 1.. {
        let time = format!("{seconds}s");
        let job = run()
            .on(2)
            .into(path)
            .with(["--resume", "--walltime", &time]);
        let finished = job.run().expect("a run");
        let said = finished.errors.contains(&format!("--walltime {seconds}"));
        match finished.code {
            Some(75) if said && finished.seconds < seconds + 20.0 => pieces += 1,
            Some(2) if said => seconds = (125.0 * seconds).ceil() / 100.0,
            Some(0) if pieces == 0 => seconds = (80.0 * seconds).ceil() / 100.0,
            Some(0) => break,
            _ => panic!("{}", finished.report("exit code 75 or 0 expected, in time")),
        }
        assert!(attempt < 60, "{}", finished.report("makes no progress"));
    }
    assert!(pieces > 0);
    let differing = differences(&datasets(path).expect("datasets"), &WHOLE.0);
    assert!(differing.is_empty(), "{differing:?}");
}

#[test]
fn a_time_too_short_for_anything_is_an_error() {
    let directory = directory();
    for ranks in [1, 3] {
        let job = run()
            .on(ranks)
            .into(directory.path())
            .with(["--walltime", "0.01"]);
        let finished = job.run().expect("a run");
        assert_eq!(finished.code, Some(2), "{}", finished.report("refused"));
        assert!(
            finished.errors.contains("--walltime 0.01"),
            "{}",
            finished.errors
        );
    }
    assert!(!directory.path().join("checkpoint").exists());
}

/// Something that happened to the newest generation of a checkpoint by two ranks, and what is said about it.
type Damage = (
    &'static str,
    fn(&Path, &Path) -> std::io::Result<()>,
    &'static str,
);

const DAMAGES: [Damage; 9] = [
    (
        "truncated",
        |newest, _| {
            let path = newest.join("rank-00001.bin");
            let bytes = fs::read(&path)?;
            fs::write(path, &bytes[..bytes.len() / 2])
        },
        "were written",
    ),
    (
        "a bit flipped",
        |newest, _| {
            let path = newest.join("rank-00001.bin");
            let mut bytes = fs::read(&path)?;
            let middle = bytes.len() * 2 / 3;
            bytes[middle] ^= 4;
            fs::write(path, bytes)
        },
        "checksum",
    ),
    (
        "a bit of the header flipped",
        |newest, _| {
            let path = newest.join("rank-00000.bin");
            let mut bytes = fs::read(&path)?;
            bytes[100] ^= 1;
            fs::write(path, bytes)
        },
        "checksum",
    ),
    (
        "empty",
        |newest, _| fs::write(newest.join("rank-00000.bin"), b""),
        "0 bytes",
    ),
    (
        "missing",
        |newest, _| fs::remove_file(newest.join("rank-00001.bin")),
        "No such file",
    ),
    (
        "ranks swapped",
        |newest, _| {
            let [a, b] = ["rank-00000.bin", "rank-00001.bin"].map(|name| newest.join(name));
            let kept = fs::read(&a)?;
            fs::copy(&b, &a)?;
            fs::write(&b, kept)
        },
        "rank-0000",
    ),
    (
        "a file of the older generation",
        |newest, older| {
            fs::copy(older.join("rank-00001.bin"), newest.join("rank-00001.bin")).map(|_| ())
        },
        "rank-00001.bin",
    ),
    (
        "the manifest of the older generation",
        |newest, older| {
            fs::copy(older.join("manifest.json"), newest.join("manifest.json")).map(|_| ())
        },
        "manifest.json is that of",
    ),
    (
        "a number of the manifest changed",
        |newest, _| {
            let path = newest.join("manifest.json");
            let text = fs::read_to_string(&path)?;
            fs::write(path, text.replacen("\"stage\": 0", "\"stage\": 1", 1))
        },
        "not as it was written",
    ),
];

fn copy(from: &Path, to: &Path) -> std::io::Result<()> {
    fs::create_dir_all(to)?;
    for entry in fs::read_dir(from)? {
        let entry = entry?;
        let target = to.join(entry.file_name());
        if entry.path().is_dir() {
            copy(&entry.path(), &target)?;
        } else {
            fs::copy(entry.path(), target)?;
        }
    }
    Ok(())
}

#[test]
fn damaged_checkpoints_are_refused_and_the_older_one_used() {
    LazyLock::force(&WHOLE);
    let sound = stopped(2).expect("a stopped run");
    check_all(&DAMAGES, |(what, damage, said)| {
        let directory = directory();
        let path = directory.path();
        io(copy(sound.path(), path))?;
        let [newest, older] = &generations(path)[..] else {
            return Err(format!("{what}: two generations expected"));
        };
        io(damage(newest, older))?;
        let older_done = manifest(older)?["matvecs"].as_u64();
        // The second start finds the first one's result in place, and nothing to go on from.
        let finished = run().on(2).into(path).with(["--resume"]).succeed()?;
        let name = newest
            .file_name()
            .and_then(|n| n.to_str())
            .unwrap_or_default();
        if !(finished.errors.contains(said) && finished.errors.contains(name)) {
            return Err(finished.report(&format!("{what}: \"{said}\" expected")));
        }
        let text = io(fs::read_to_string(path.join("summary.json")))?;
        let summary = Summary {
            command: finished.command,
            value: serde_json::from_str(&text).map_err(|e| e.to_string())?,
        };
        same(path, &summary)?;
        let here = count(&summary, "matvecs_here")?;
        summary.require(older_done == Some((WHOLE.1 - here) as u64), || {
            format!("{what}: the older generation was not used")
        })
    });
}

#[test]
fn without_a_valid_checkpoint_a_run_does_not_go_on() {
    let sound = stopped(2).expect("a stopped run");
    // Both damaged.
    let directory = directory();
    io(copy(sound.path(), directory.path())).expect("a copy");
    for generation in generations(directory.path()) {
        fs::write(generation.join("rank-00000.bin"), b"").expect("a file");
    }
    let go_on = |job: Job, path: &Path| job.into(path).with(["--resume"]).run().expect("a run");
    let finished = go_on(run().on(3), directory.path());
    assert_eq!(finished.code, Some(1), "{}", finished.report("refused"));
    assert!(
        finished.errors.contains("without --resume"),
        "{}",
        finished.errors
    );
    // Of another case.
    let finished = go_on(run().on(2).set(&["time.end=0.9"]), sound.path());
    assert_eq!(finished.code, Some(1), "{}", finished.report("refused"));
    assert!(
        finished.errors.contains("time.end is 1 there, 0.9 here"),
        "{}",
        finished.errors
    );
    // Of the same case, said in another way, and stored in another.
    let differently = [
        "axis.0.v.cells=26",
        "output.compression=1",
        "output.xdmf=true",
        "checkpoint.minutes=7",
        "solver.tolerance=0.001",
        "title=another",
    ];
    let copied = self::directory();
    io(copy(sound.path(), copied.path())).expect("a copy");
    let finished = go_on(run().on(2).set(&differently), copied.path());
    assert_eq!(finished.code, Some(0), "{}", finished.report("goes on"));
    let said = finished.errors.contains("going on from");
    assert!(said, "{}", finished.errors);
    let found = datasets(copied.path()).expect("datasets");
    assert_eq!(found["/f"], WHOLE.0["/f"]);
    // None at all: from the beginning.
    let empty = self::directory();
    let finished = go_on(run().on(2), empty.path());
    assert_eq!(finished.code, Some(0), "{}", finished.report("done"));
    assert!(
        finished.errors.contains("starts from its beginning"),
        "{}",
        finished.errors
    );
    // Not asked for: from the beginning, with a warning.
    let finished = run().on(2).into(sound.path()).succeed().expect("a run");
    assert!(
        finished.errors.contains("replaces it"),
        "{}",
        finished.errors
    );
    assert!(!sound.path().join("checkpoint").exists());
}

#[test]
fn a_run_from_a_file_does_not_go_on_from_another() {
    let files = directory();
    let grid = [
        "axis.0.x.cells=24",
        "axis.0.v.cells=18",
        "scheme.interface=conservative",
        "solver.tolerance=1e-2",
        "exact={f='0'}",
    ];
    let field = |name: &str, settings: &[&str]| {
        let place = files.path().join(name);
        let job = Job::new(["run", &case("example1.toml"), "--mode", "full"]).set(&grid);
        let job = job.set(&["solver.warp.profile=exponential", "time.end=0.1"]);
        job.set(settings)
            .on(2)
            .solve(&place)
            .expect("a warped field");
        place.join("warped_f.h5")
    };
    let points = "solver.warp.points=1024";
    let written = field("first", &[points]);
    let others = [
        field("values", &[points, "time.end=0.2"]),
        field("points", &["solver.warp.points=1280"]),
    ];
    let start = files.path().join("start.h5");
    fs::copy(&written, &start).expect("a copy");
    let from = format!("initial={{warped='{}'}}", start.display());
    let run = || {
        Job::new(["run", &case("example1.toml")])
            .set(&grid)
            .set(&[&from])
    };
    let cut = directory();
    let path = cut.path();
    let job = run().on(2).set(&[OFTEN]).into(path);
    let finished = struck(&job, Blow::Signal, |_| generations(path).len() == 2).expect("a run");
    assert_eq!(finished.code, Some(75), "{}", finished.report("stopped"));
    let go_on = || {
        run()
            .on(3)
            .into(path)
            .with(["--resume"])
            .run()
            .expect("a run")
    };
    for other in others {
        fs::copy(other, &start).expect("a copy");
        let finished = go_on();
        assert_eq!(finished.code, Some(1), "{}", finished.report("refused"));
        let said = finished.errors.contains("initial.warped has changed");
        assert!(said, "{}", finished.errors);
    }
    fs::copy(&written, &start).expect("a copy");
    let finished = go_on();
    assert_eq!(finished.code, Some(0), "{}", finished.report("goes on"));
    assert!(
        finished.errors.contains("going on from"),
        "{}",
        finished.errors
    );
    let whole = directory();
    run().on(1).solve(whole.path()).expect("a whole run");
    let [found, expected] = [path, whole.path()].map(|d| datasets(d).expect("datasets"));
    let differing = differences(&found, &expected);
    assert!(differing.is_empty(), "{differing:?}");
}

#[test]
fn what_is_finished_is_not_computed_again() {
    let place = directory();
    let path = place.path();
    let first = [
        "time.end=0.1",
        "output.warped_field=true",
        "solver.tolerance=0.01",
    ];
    let job = |settings: &[&str]| run().set(&first).set(settings).into(path).on(2);
    job(&[]).succeed().expect("a run");
    let said = |finished: &Finished| finished.output.contains("the run is finished");
    let rows: [(&[&str], bool); 4] = [
        (&[], true),
        (&["checkpoint.minutes=3", "time.end=0.10"], true),
        (&["output.compression=1"], false),
        (&["time.end=0.05"], false),
    ];
    for (settings, finished) in rows {
        let written = fs::read(path.join("summary.json")).expect("a summary");
        let again = job(settings).with(["--resume"]).succeed().expect("a run");
        assert_eq!(said(&again), finished, "{}", again.report("finished"));
        let now = fs::read(path.join("summary.json")).expect("a summary");
        assert_eq!(now == written, finished, "{settings:?}");
    }
    // Something is missing, or it was not asked.
    fs::remove_file(path.join("warped_f.h5")).expect("a file");
    let last = job(rows[3].0);
    let again = last.clone().with(["--resume"]).succeed().expect("a run");
    assert!(!said(&again), "{}", again.report("solved"));
    let again = last.succeed().expect("a run");
    assert!(!said(&again), "{}", again.report("solved"));
}

#[test]
fn a_checkpoint_that_cannot_be_written_stops_no_run_but_one_that_was_to_stop() {
    LazyLock::force(&WHOLE);
    // Files may not grow to the size of a rank's, which holds 82 sums; the results may.
    let wide = || {
        run()
            .on(2)
            .set(&["output.plateau.points=80", OFTEN])
            .files_up_to(700)
    };
    let directory = directory();
    let finished = wide().into(directory.path()).succeed().expect("a run");
    assert!(
        finished.errors.contains("the run goes on"),
        "{}",
        finished.errors
    );
    assert!(finished.errors.contains("rank-0000"), "{}", finished.errors);
    let all = datasets(directory.path()).expect("datasets");
    assert_eq!(all["/f"], WHOLE.0["/f"]);

    let directory = self::directory();
    let path = directory.path();
    let job = wide().set(&["checkpoint.minutes=0"]).into(path);
    let finished = struck(&job, Blow::Signal, |since| {
        since > Duration::from_millis(700)
    })
    .expect("a run");
    assert_eq!(finished.code, Some(1), "{}", finished.report("an error"));
    assert!(finished.errors.contains("rank-0000"), "{}", finished.errors);

    // Something is in the way.
    let directory = self::directory();
    let path = directory.path();
    fs::write(path.join("checkpoint"), b"a file").expect("a file");
    let summary = run().on(2).set(&[OFTEN]).solve(path).expect("a run");
    same(path, &summary).expect("the whole run");
}
