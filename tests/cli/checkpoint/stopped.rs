//! Runs that are killed, stopped by a signal or out of time end with the same bits when continued.

use super::{
    Fault, LONG, OFTEN, Result, WHOLE, children, count, ends_well, generations, manifest, newest,
    run, same, stopped, takes_requests, with_fault,
};
use crate::dense::random;
use crate::launcher::send;
use crate::support::{
    Finished, Job, Summary, case, check_all, datasets, datasets_of, differences,
    directory_on_disk as directory, equals_whole, names_in, of_case,
};
use std::fs;
use std::path::{Path, PathBuf};
use std::sync::LazyLock;
use std::time::{Duration, Instant};

#[test]
fn runs_killed_at_any_moment_end_with_the_same_bits() {
    LazyLock::force(&WHOLE);
    // Each run is killed three times and then continued to its end, each time on other ranks.
    check_all(&[0, 1], |&row| {
        let directory = directory();
        let path = directory.path();
        for strike in 0..3 {
            let seed = 10 * row + strike;
            let ranks = 1 + (row + strike) as usize % 4;
            let fault = match seed % 3 {
                0 => Fault::Launcher,
                rank => Fault::Rank(rank as usize - 1),
            };
            let blocks = if ranks == 4 { "2" } else { "1" };
            let job =
                run().on(ranks).set(&[OFTEN]).into(path).with(["--resume", "--ranks-x", blocks]);
            let after = Duration::from_secs_f64(0.25 + 0.6 * random(seed));
            let finished = with_fault(&job, fault, |since| since > after)?;
            if finished.code == Some(0) {
                break;
            }
        }
        if path.join("summary.json").exists() {
            // The run ended before it was killed.
            return equals_whole(path, &WHOLE.0, &[]).map_err(|what| format!("row {row} {what}"));
        }
        let ranks = 1 + (row as usize + 3) % 4;
        ends_well(run().on(ranks), path).map(|_| ())
    });
}

#[test]
fn runs_killed_while_they_write_a_checkpoint_end_with_the_same_bits() {
    LazyLock::force(&WHOLE);
    check_all(&[(2, Fault::Rank(1)), (3, Fault::Launcher)], |&(ranks, fault)| {
        let directory = directory();
        let path = directory.path();
        let job = run().on(ranks).set(&[OFTEN]).into(path);
        // A generation after the second one has no manifest yet, so it is being written.
        let mut seen = 0;
        let finished = with_fault(&job, fault, |_| {
            let all = fs::read_dir(path.join("checkpoint")).into_iter().flatten().count();
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
fn a_stop_signal_leaves_a_checkpoint_for_any_ranks() {
    LazyLock::force(&WHOLE);
    let rows = [(3, 1, "1"), (1, 3, "3"), (4, 2, "2")];
    check_all(&rows, |&(before, after, blocks)| {
        let directory = stopped(before)?;
        let path = directory.path();
        let summary = ends_well(run().on(after).with(["--ranks-x", blocks]), path)?;
        summary.require(summary.boolean("resumed")?, || "not continued".to_owned())
    });
}

/// The signals of a test and the process that gets them.
#[derive(Clone, Copy, Debug, PartialEq)]
enum StopRequest {
    /// One signal to a process without mpirun.
    Once(&'static str),
    /// Two signals at once to a process without mpirun, as launchers send them.
    Twice(&'static str),
    /// A signal and, a second later, another one to a rank that waits for a stopped rank.
    Again(&'static str),
    /// A signal to the last of this number of ranks.
    Rank(&'static str, usize),
}

#[test]
fn ctrl_c_and_sigterm_leave_a_checkpoint_and_a_second_one_ends_at_once() {
    LazyLock::force(&WHOLE);
    let rows = [
        StopRequest::Once("-TERM"),
        StopRequest::Twice("-INT"),
        StopRequest::Again("-TERM"),
        StopRequest::Rank("-INT", 2),
        StopRequest::Rank("-TERM", 3),
    ];
    check_all(&rows, |request| {
        let place = directory();
        let path = place.path();
        let job = match request {
            StopRequest::Rank(_, ranks) => run().on(*ranks),
            StopRequest::Again(_) => run().on(2),
            _ => run(),
        };
        let job = job.set(&[OFTEN]).into(path);
        let mut sent: Option<Instant> = None;
        let mut again = false;
        let finished = job.closely().run_while(|process, _| {
            let ranks = children(process.id());
            if let Some(sent) = sent {
                let StopRequest::Again(signal) = request else { return };
                if !again && sent.elapsed() > Duration::from_secs(1) {
                    again = true;
                    send(signal, ranks[0]);
                }
                return;
            }
            if generations(path).len() >= 2 {
                sent = Some(Instant::now());
                match *request {
                    StopRequest::Once(signal) => send(signal, process.id()),
                    StopRequest::Again(signal) => {
                        send("-STOP", ranks[1]);
                        send(signal, ranks[0]);
                    }
                    StopRequest::Twice(signal) => (0..2).for_each(|_| send(signal, process.id())),
                    StopRequest::Rank(signal, _) => send(signal, *ranks.last().expect("a rank")),
                }
            }
        })?;
        if let StopRequest::Again(_) = request {
            let ended = finished.code != Some(75) && !finished.errors.contains("--resume");
            return if again && ended {
                Ok(())
            } else {
                Err(finished.report("the second signal must end the rank at once"))
            };
        }
        if finished.code != Some(75) || !finished.errors.contains("stopped by a signal") {
            return Err(finished.report("exit code 75 expected"));
        }
        let summary = ends_well(run(), path)?;
        summary.require(summary.boolean("resumed")?, || "did not go on".to_owned())
    });
}

/// A signal in the middle of a batch that takes seconds stores the finished modes at once, also if
/// the ranks split space. No stored mode is computed again, and the bits are the same.
#[test]
fn a_signal_interrupts_a_batch_and_stores_finished_modes() {
    let slow =
        ["axis.0.x.cells=500", "axis.0.v.cells=500", "solver.warp.points=64", "exact={f='0'}"];
    let job = || run().set(&slow).with(["--ranks-x", "1"]);
    let whole = directory();
    let expected = job().on(2).solve(whole.path()).expect("a whole run");
    let (all, bits) = (count(&expected, "matvecs"), datasets(whole.path()).expect("datasets"));
    // The batches run one after the other, so that one is running after the first checkpoint.
    for (ranks, blocks, signal) in [(None, "1", "-TERM"), (Some(2), "2", "-USR1")] {
        let place = directory();
        let path = place.path();
        let job = run().set(&slow).set(&[OFTEN]).into(path).with(["--ranks-x", blocks]);
        let job = ranks.map_or(job.clone(), |ranks| job.on(ranks)).closely();
        let mut sent: Option<Instant> = None;
        let stored = || -> Option<u64> { manifest(&newest(path)?).ok()?["matvecs"].as_u64() };
        let finished = job.run_while(|process, _| {
            // At the beginning of the second batch.
            if sent.is_none() && stored() > Some(0) {
                sent = Some(Instant::now());
                send(signal, process.id());
            }
        });
        let finished = finished.expect("an end");
        let elapsed = sent.map(|sent| sent.elapsed()).expect("a signal");
        let done = finished.errors.contains("stopped by a signal");
        assert!(done, "{}", finished.report("stopped by a signal"));
        assert!(elapsed < Duration::from_secs(3), "{elapsed:?}: {}", finished.report("at once"));
        // One of them is continued.
        if ranks.is_none() {
            continue;
        }
        let done = stored().unwrap_or(0) as usize;
        let summary = run().set(&slow).on(2).with(["--resume"]).solve(path).expect("an end");
        assert_eq!(count(&summary, "matvecs_here").map(|here| here + done), all);
        assert!(differences(&bits, &datasets(path).expect("datasets")).is_empty());
    }
}

#[test]
fn a_signal_ends_a_classical_run_at_once() {
    let place = directory();
    let path = place.path();
    let classical = ["solver.method=classical", "axis.0.x.cells=600", "axis.0.v.cells=600"];
    let mut sent = false;
    let job = run().set(&classical).set(&["time.end=9"]).into(path).closely();
    let finished = job.run_while(|process, since| {
        if !sent && path.join("run.lock").exists() && since > Duration::from_millis(500) {
            sent = true;
            send("-INT", process.id());
        }
    });
    let finished = finished.expect("an end");
    assert!(sent && finished.code.is_none(), "{}", finished.report("ended by the signal"));
}

/// Settings of a run whose set-up takes many seconds: the probe propagates the field to a late end.
const LONG_SET_UP: [&str; 3] = ["axis.0.x.cells=900", "axis.0.v.cells=900", "time.end=9"];

/// Runs `job`, and sends a signal to mpirun, or to the last of its ranks, half a second after the
/// directory of `run` was locked. The job must end within eight seconds, with exit code 75
/// and a message of rank 0 alone, and leave nothing but the lock.
fn ends_in_set_up(job: &Job, run: &Path, signal: &str, to_a_rank: bool) -> Result<()> {
    let (mut locked, mut sent) = (None, None);
    let finished = job.clone().closely().run_while(|process, since| {
        if locked.is_none() && run.join("run.lock").exists() {
            locked = Some(since);
        }
        if sent.is_none() && locked.is_some_and(|at| since > at + Duration::from_millis(500)) {
            sent = Some(Instant::now());
            let rank = children(process.id()).last().copied().filter(|_| to_a_rank);
            send(signal, rank.unwrap_or(process.id()));
        }
    })?;
    let took = sent.map(|sent| sent.elapsed()).ok_or_else(|| finished.report("no signal sent"))?;
    finished.ended(75, &["stopped by a signal before the first mode", "the same command"])?;
    if took > Duration::from_secs(8) || !finished.others.is_empty() {
        return Err(finished.report(&format!("{took:?}: at once, and said by rank 0 alone")));
    }
    let left = fs::read_dir(run).into_iter().flatten().flatten().map(|entry| entry.file_name());
    match left.filter(|name| name != "run.lock").collect::<Vec<_>>() {
        left if left.is_empty() => Ok(()),
        left => Err(finished.report(&format!("{left:?} stay"))),
    }
}

/// There is nothing to store yet.
#[test]
fn a_signal_ends_a_set_up_at_once() {
    let rows = [(None, "-INT", false), (Some(2), "-USR1", false), (Some(2), "-TERM", true)];
    check_all(&rows, |&(ranks, signal, to_a_rank)| {
        let place = directory();
        let job = of_case("run", "example1.toml").set(&LONG_SET_UP).into(place.path());
        // mpirun gives the other ranks a second to end, which is its default.
        let job = job.environment("OMPI_MCA_odls_base_sigkill_timeout", "1");
        let job = ranks.map_or(job.clone(), |ranks| job.on(ranks));
        ends_in_set_up(&job, place.path(), signal, to_a_rank)
    });
}

/// Nor do the trial runs that choose a grid store anything.
#[test]
fn a_signal_ends_the_trials_of_an_accuracy_at_once() {
    let rows = [("-TERM", "schrodingerized"), ("-INT", "classical")];
    check_all(&rows, |(signal, method)| {
        let place = directory();
        let wanted = ["--accuracy", "1e-4", "--budget", "40s"];
        let job = of_case("run", "example1.toml").set(&[&format!("solver.method={method}")]);
        let mut sent = None;
        // Some trials have ended by then.
        let finished =
            job.with(wanted).into(place.path()).closely().run_while(|process, since| {
                if sent.is_none() && since > Duration::from_secs(5) {
                    sent = Some(Instant::now());
                    send(signal, process.id());
                }
            })?;
        finished.ended(75, &["stopped by a signal before the first mode"])?;
        match sent.map(|sent| sent.elapsed()) {
            Some(took) if took < Duration::from_secs(8) => Ok(()),
            took => Err(finished.report(&format!("{took:?} after the signal"))),
        }
    });
}

/// From the moment when the handlers are there, a stop signal ends a run with exit code 75. The
/// signal comes at once, or up to a tenth of a second later: while MPI starts, while the case is
/// read, or in the set-up that follows.
#[test]
fn a_signal_right_after_the_start_ends_with_the_documented_code() {
    let rows = [
        (0, "-TERM", None),
        (1, "-INT", None),
        (3, "-USR1", Some(2)),
        (10, "-TERM", Some(2)),
        (30, "-INT", Some(2)),
        (100, "-USR1", None),
    ];
    check_all(&rows, |&(delay, signal, ranks)| {
        let place = directory();
        let job = of_case("run", "example1.toml").set(&LONG_SET_UP).into(place.path());
        let job = job.environment("OMPI_MCA_odls_base_sigkill_timeout", "1");
        let job = ranks.map_or(job.clone(), |ranks| job.on(ranks)).closely();
        let (mut ready, mut sent) = (None, false);
        let finished = job.run_while(|process, since| {
            let rank = match ranks {
                Some(_) => children(process.id()).last().copied(),
                None => Some(process.id()),
            };
            let Some(rank) = rank.filter(|&rank| !sent && takes_requests(rank)) else { return };
            let ready = *ready.get_or_insert(since);
            if since >= ready + Duration::from_millis(delay) {
                sent = true;
                send(signal, rank);
            }
        })?;
        let what = format!("{signal} after {delay} ms");
        let said = finished.printed.matches("stopped by a signal before the first mode").count();
        if !sent || finished.code != Some(75) || said != 1 || finished.seconds > 20.0 {
            return Err(finished.report(&format!("{what}: exit code 75 and one message expected")));
        }
        Ok(())
    });
}

/// The table then has the runs that are finished.
#[test]
fn a_signal_in_a_set_up_ends_a_sweep_at_once() {
    let place = directory();
    let sweep = of_case("sweep", "example1.toml").set(&LONG_SET_UP[..2]).into(place.path());
    let sweep = sweep.with(["--vary", "time.end=0.01,9"]);
    let list = sweep.clone().with(["--list"]).succeed().expect("a list");
    let second = list.output.lines().nth(1).and_then(|line| line.rsplit('\t').next());
    let second = PathBuf::from(second.expect("two runs"));
    ends_in_set_up(&sweep.on(2), &second, "-USR1", false).unwrap();
    let table = fs::read_to_string(place.path().join("table.csv")).expect("a table");
    assert_eq!(table.lines().count(), 2, "{table}");
}

/// A sweep that gets a stop signal ends with a checkpoint of the current run and a table of the
/// finished ones, if any. It continues on other ranks to the same bits.
#[test]
fn a_stopped_sweep_is_continued() {
    LazyLock::force(&WHOLE);
    let rows = [(Some(2), "-USR1", 1), (None, "-TERM", 0)];
    check_all(&rows, |&(ranks, signal, number)| {
        let place = directory();
        let sweep = of_case("sweep", "example1.toml").set(&LONG).into(place.path());
        let sweep = sweep.with(["--vary", "checkpoint.minutes=0.00001,0.00002"]);
        let list = sweep.clone().with(["--list"]).succeed()?;
        let runs = list.output.lines().filter_map(|line| line.rsplit('\t').next());
        let runs: Vec<PathBuf> = runs.map(PathBuf::from).collect();
        let mut sent = false;
        let job = ranks.map_or(sweep.clone(), |ranks| sweep.clone().on(ranks)).closely();
        let finished = job.run_while(|process, _| {
            if !sent && generations(&runs[number]).len() == 2 {
                sent = true;
                send(signal, process.id());
            }
        })?;
        let printed = format!("stopped by a signal: {number} of 2 runs are finished");
        finished.ended(75, &[&printed, "same command"])?;
        let rows = || fs::read_to_string(place.path().join("table.csv")).unwrap_or_default();
        let rows_before = rows().lines().count();
        let finished = sweep.on(if number == 1 { 3 } else { 1 }).succeed()?;
        if number == 1 {
            finished
                .contains(&finished.errors, &["[1/2] checkpoint.minutes=1e-05: finished before"])?;
        }
        finished.contains(&finished.errors, &["going on from"])?;
        if [rows_before, rows().lines().count()] != [2 * number, 3] {
            return Err(finished.report(&format!("rows before: {rows_before}")));
        }
        for (run, path) in runs.iter().enumerate() {
            let summary = Summary::read(finished.clone(), path)?;
            same(path, &summary)?;
            let found = summary.boolean("resumed")?;
            summary.require(found == (run == number), || format!("{}: resumed", path.display()))?;
        }
        Ok(())
    });
}

/// Stops a run in stage number `stage` or a later one, continues it on other ranks, and compares
/// all results with an undisturbed run.
fn goes_on_in_stage(
    job: &Job,
    stage: u64,
    ranks: [(usize, &str); 2],
    numbers: &[&str],
) -> Result<()> {
    let [before, after] =
        ranks.map(|(ranks, blocks)| job.clone().on(ranks).with(["--ranks-x", blocks]));
    let whole = directory();
    let expected = job.clone().solve(whole.path())?;
    // A busy machine would keep this process from seeing the stage before the run ends.
    let before = before.set(&[OFTEN]).undisturbed();
    let mut cut = directory();
    // If that happens, an earlier stage is tried.
    for missed in 0.. {
        let path = cut.path();
        let finished = with_fault(&before.clone().into(path), Fault::Signal, |_| {
            let found = newest(path).and_then(|newest| manifest(&newest).ok());
            let number = |key: &str| found.as_ref().and_then(|m| m[key].as_u64());
            let reached = number("stage").is_some_and(|reached| reached + missed >= stage);
            // A checkpoint of the first stage must hold some finished modes.
            reached && (stage > 0 || number("matvecs").is_some_and(|done| done > 0))
        })?;
        match finished.code {
            Some(75) => break,
            Some(0) if missed < 20 => cut = directory(),
            _ => return Err(finished.report("exit code 75 expected")),
        }
    }
    let path = cut.path();
    let summary = after.with(["--resume"]).solve(path)?;
    for file in fs::read_dir(whole.path()).into_iter().flatten().flatten() {
        let name = file.file_name();
        if name.to_string_lossy().ends_with(".h5") {
            let [found, expected] = [path, whole.path()].map(|d| datasets_of(&d.join(&name)));
            let differing = differences(&found?, &expected?);
            summary.require(differing.is_empty(), || format!("{name:?}: {differing:?} differ"))?;
        }
    }
    for key in numbers {
        let (found, expected) = (&summary.value[key], &expected.value[key]);
        summary.require(found == expected, || format!("{key}: {found}, {expected} expected"))?;
    }
    let here = count(&summary, "matvecs_here")?;
    summary
        .require(here < count(&expected, "matvecs")?.max(1), || "all was computed again".to_owned())
}

#[test]
fn stages_that_are_finished_are_not_computed_again() {
    // Density and level set in two stages, with moments before the end, an implicit method and a
    // plateau.
    let fields = of_case("run", "example2.toml").set(&[
        "axis.0.x.cells=32",
        "axis.0.v.cells=24",
        "solver.tolerance=1e-2",
        "solver.propagator={method='crank-nicolson',step=0.05}",
        "solver.warp.profile=exponential",
        "solver.warp.points=512",
        "output.moments_every=0.5",
        "output.plateau.points=3",
    ]);
    // A full run with inflow: the auxiliary unknowns change ranks with their cells.
    let kept = |more: &str| {
        Job::new(["run", &case("example2.toml"), "--mode", "full"])
            .set(&[
                "axis.0.x.cells=32",
                "axis.0.v.cells=24",
                "solver.tolerance=1e-2",
                "solver.warp.profile=exponential",
                "solver.warp.points=256",
                "output.field_times=[0.3,0.6]",
            ])
            .set(&[more])
    };
    let recorded =
        ["matvecs", "solves", "unitarity_defect", "norm_kept", "step_error", "error_estimate"];
    // Elements: the widths of blocks depend on the number of ranks.
    let elements = Job::new(["run", &case("inflow_barrier.toml"), "--mode", "full"]).set(&[
        "scheme.degree=2",
        "axis.0.v.degree=3",
        "axis.0.x.cells=9",
        "axis.0.v.cells=6",
        "time.end=0.7",
        "solver.tolerance=1e-2",
        "solver.warp.profile=exponential",
        "solver.warp.points=256",
        "output.field_times=[0.3,0.6]",
        // Moments within the stages.
        "output.moment_times=[0.05,0.1,0.15,0.2,0.25,0.35,0.4,0.45,0.5,0.55]",
    ]);
    let rows = [
        // A late stage: on a busy machine, ranks that split space wait for each other for some
        // milliseconds per exchange.
        (elements, 9, [(2, "1"), (3, "3")]),
        (fields, 1, [(2, "1"), (3, "1")]),
        (kept("solver.warp.alpha='2 - p'"), 4, [(3, "1"), (4, "2")]),
        (kept("solver.warp.inflow='full'"), 0, [(1, "1"), (4, "4")]),
    ];
    check_all(&rows, |(job, stage, ranks)| goes_on_in_stage(job, *stage, *ranks, &recorded));
}

#[test]
fn runs_stop_before_their_walltime_ends_and_are_continued() {
    LazyLock::force(&WHOLE);
    let mut place = directory();
    // The times of the start and of the whole run depend on the load of the machine. This finds a
    // wall time between them, for the first piece. A second piece may take twice as long.
    let (mut pieces, mut seconds) = (0, 1.0_f64);
    for attempt in 1.. {
        let time = format!("{seconds}s");
        let job = run().on(2).into(place.path()).with(["--resume", "--walltime", &time]);
        let finished = job.run().expect("a run");
        let printed = finished.errors.contains(&format!("--walltime {seconds}"));
        match finished.code {
            Some(75) if printed && finished.seconds < seconds + 20.0 => {
                pieces += 1;
                seconds *= 2.0;
            }
            Some(2) if printed => seconds = (125.0 * seconds).ceil() / 100.0,
            Some(0) if pieces == 0 => {
                seconds = (80.0 * seconds).floor().max(1.0) / 100.0;
                place = directory();
            }
            Some(0) => break,
            _ => panic!("{}", finished.report("exit code 75 or 0 expected, in time")),
        }
        assert!(attempt < 60, "{}", finished.report("makes no progress"));
    }
    assert!(pieces > 0);
    equals_whole(place.path(), &WHOLE.0, &[]).unwrap();
}

#[test]
fn a_walltime_too_short_for_any_work_is_an_error() {
    let directory = directory();
    let job = run().on(3).into(directory.path()).with(["--walltime", "0.01"]);
    job.run().expect("a run").ended(2, &["--walltime 0.01"]).unwrap();
    assert!(!directory.path().join("checkpoint").exists());
    // The same holds for a sweep. Otherwise its job script would submit it again for ever.
    let sweep = Job::new(["sweep", &case("example1.toml"), "--vary", "time.end=1,2"]).set(&LONG);
    let finished = sweep.into(directory.path()).with(["--walltime", "0.01"]).run().expect("a run");
    finished.ended(2, &["--walltime 0.01"]).unwrap();
}

/// The wall time counts while the exact solution is computed, which comes before the modes.
#[test]
fn a_walltime_too_short_for_the_exact_solution_names_it() {
    let directory = directory();
    let job = of_case("run", "lens2d.toml").set(&["output.moments_every=0.05"]);
    for ranks in [1, 2] {
        let finished = job.clone().on(ranks).into(directory.path()).with(["--walltime", "2s"]);
        let wording =
            ["--walltime 2: set-up and the exact solution", "exact.moments", "--set exact={}"];
        finished.run().expect("a run").ended(2, &wording).unwrap();
        assert!(names_in(directory.path()).is_empty(), "{:?}", names_in(directory.path()));
    }
}

/// A run that is killed while it removes its checkpoints leaves parts of them beside its finished
/// results.
#[test]
fn rests_of_checkpoints_beside_finished_results_are_removed() {
    let place = directory();
    let path = place.path();
    let job = || run().set(&["time.end=0.1", "solver.tolerance=0.01"]).into(path);
    job().succeed().expect("a run");
    let checkpoint = path.join("checkpoint");
    let part = checkpoint.join("000003/rank-00001.bin");
    // What is there, and whether it is removed.
    let rows: [(&[&str], bool); 3] =
        [(&[], true), (&["000003/rank-00001.bin"], true), (&["mine.txt"], false)];
    for (names, removed) in rows {
        fs::create_dir_all(part.parent().expect("a directory")).expect("a directory");
        names.iter().for_each(|name| fs::write(checkpoint.join(name), "").expect("a file"));
        let again = job().with(["--resume"]).succeed().expect("an end");
        assert!(again.output.contains("the run is finished"), "{}", again.report("finished"));
        assert_eq!(!checkpoint.exists(), removed, "{names:?}: {:?}", names_in(&checkpoint));
        assert!(!checkpoint.join("000003").exists(), "{names:?}");
    }
}

#[test]
fn finished_work_is_not_computed_again() {
    let place = directory();
    let path = place.path();
    let first = ["time.end=0.1", "output.warped_field=true", "solver.tolerance=0.01"];
    let job = |settings: &[&str]| run().set(&first).set(settings).into(path);
    job(&[]).on(2).succeed().expect("a run");
    let printed = |finished: &Finished| finished.output.contains("the run is finished");
    // Settings, and whether the finished run is theirs; other results are not replaced without
    // --force.
    let rows: [(&[&str], bool); 4] = [
        (&[], true),
        (&["checkpoint.minutes=3", "time.end=0.10"], true),
        (&["output.compression=1"], false),
        (&["time.end=0.05"], false),
    ];
    for (settings, finished) in rows {
        let written = fs::read(path.join("summary.json")).expect("a summary");
        let again = job(settings).with(["--resume"]);
        if finished {
            let again = again.succeed().expect("a run");
            assert!(printed(&again), "{}", again.report("finished"));
        } else {
            again.is_refused(&["another result", " there, ", "--force"]).unwrap()
        }
        let now = fs::read(path.join("summary.json")).expect("a summary");
        assert_eq!(now, written, "{settings:?}");
    }
    // An output file of the run is missing.
    fs::remove_file(path.join("warped_f.h5")).expect("a file");
    let again = job(&[]).with(["--resume"]).succeed().expect("a run");
    assert!(!printed(&again), "{}", again.report("solved"));
    let again = job(&[]).with(["--force"]).succeed().expect("a run");
    assert!(!printed(&again), "{}", again.report("solved"));
}
