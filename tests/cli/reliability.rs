//! Faults that a run survives or reports: damaged results, other runs in its directory, long paths,
//! and too small disks and memory.

use crate::checkpoint::{OFTEN, WHOLE, children, newest, run as long_run, same};
use crate::launcher::send;
use crate::support::{
    Finished, Job, RESULT_FILES, SMALL, case, change_hdf5, check_all, contents, copy, datasets,
    differences, directory, directory_on_disk, equals_whole, json_of, names_in, of_case,
    on_results, small_run as run,
};
use hdf5::types::VarLenUnicode;
use std::fs;
use std::path::{Path, PathBuf};
use std::sync::LazyLock;
use std::time::{Duration, SystemTime};

fn reports_finished(finished: &Finished) -> bool {
    finished.output.contains("the run is finished")
}

/// Changes a byte of a dataset of `result.h5`. A failing disk does not change the date of the file
/// (`keeps_date`).
fn change_byte(place: &Path, dataset: &str, keeps_date: bool) {
    let path = place.join("result.h5");
    let file = hdf5::File::open(&path).unwrap();
    let at = file.dataset(dataset).unwrap().offset().unwrap() as usize;
    drop(file);
    let mut bytes = fs::read(&path).unwrap();
    bytes[at + 100] ^= 1;
    let date = fs::metadata(&path).unwrap().modified().unwrap();
    fs::write(&path, bytes).unwrap();
    if keeps_date {
        date_file(&path, date);
    }
}

fn date_file(path: &Path, date: SystemTime) {
    fs::File::options().write(true).open(path).unwrap().set_modified(date).unwrap();
}

/// Cuts a file to half its length.
fn cut(place: &Path, name: &str) {
    let bytes = fs::read(place.join(name)).unwrap();
    fs::write(place.join(name), &bytes[..bytes.len() / 2]).unwrap();
}

/// Dates of results and files of others in `checkpoint/` say nothing about the results.
#[test]
fn undamaged_results_are_finished_whatever_their_dates() {
    let place = directory();
    let path = place.path();
    run().into(path).succeed().expect("a run");
    let before = contents(path);
    let hour = Duration::from_secs(3600);
    let now = SystemTime::now();
    for [result, summary] in [[now + hour, now], [now, now + hour]] {
        date_file(&path.join("result.h5"), result);
        date_file(&path.join("summary.json"), summary);
        let again = run().into(path).with(["--resume"]).succeed().expect("an end");
        assert!(reports_finished(&again), "{}", again.report("not finished"));
    }
    fs::create_dir_all(path.join("checkpoint/000007")).expect("a directory");
    fs::write(path.join("checkpoint/notes.txt"), "mine").expect("a file");
    fs::write(path.join("checkpoint/000007/data"), "mine").expect("a file");
    let again = run().into(path).with(["--resume"]).succeed().expect("an end");
    assert!(reports_finished(&again), "{}", again.report("not finished"));
    // They are no checkpoint from which a run of another case might go on.
    let other = run().set(&["time.end=0.2"]).into(path).with(["--resume"]);
    other.is_refused(&["it holds another result"]).unwrap();
    let continued = Job::new(["run", "--until", "0.31", "--continue", &path.display().to_string()]);
    let later = directory();
    continued.into(later.path()).succeed().expect("a later part");
    fs::remove_dir_all(path.join("checkpoint")).expect("a directory");
    assert!(contents(path) == before, "the results were changed");
}

/// A damaged attribute looks like a result of another program.
#[test]
fn damage_is_named_beside_another_result() {
    let place = directory();
    let path = place.path();
    run().into(path).succeed().expect("a run");
    let damage = |file: &hdf5::File| {
        file.attr("git")?.write_scalar(&"0123456".parse::<VarLenUnicode>().unwrap_or_default())
    };
    change_hdf5(&path.join("result.h5"), damage).expect("a changed file");
    let again = run().into(path).with(["--resume"]);
    let damaged = "result.h5: is not as it was written (";
    let printed = ["git 0123456", "it is damaged, too: ", damaged, "were written)", "--force"];
    again.is_refused(&printed).unwrap();
}

#[test]
fn damaged_results_do_not_count_as_finished() {
    /// Name of a damage, a function that damages the results, and a part of the message about it.
    type Damage = (&'static str, fn(&Path), &'static str);
    const DAMAGES: [Damage; 13] = [
        ("a value", |place| change_byte(place, "f", true), "dataset /f is not as it was written"),
        // The file has a newer date than its summary.
        ("edited", |place| change_byte(place, "f", false), "dataset /f is not as it was written"),
        ("case", |place| change_byte(place, "case", true), "result.h5: is not as it was written"),
        ("cut", |place| cut(place, "result.h5"), "result.h5: is not as it was written"),
        (
            "emptied",
            |place| fs::write(place.join("result.h5"), b"").unwrap(),
            "result.h5: is not as it was written",
        ),
        ("no warped field", |place| fs::remove_file(place.join("warped_f.h5")).unwrap(), "warped"),
        ("no summary", |place| fs::write(place.join("summary.json"), b"").unwrap(), "summary.json"),
        ("half a summary", |place| cut(place, "summary.json"), "summary.json"),
        ("no grids", |place| fs::remove_file(place.join("fields.xdmf")).unwrap(), "fields.xdmf"),
        ("half the grids", |place| cut(place, "fields.xdmf"), "fields.xdmf"),
        ("no points", |place| fs::remove_file(place.join("grids.h5")).unwrap(), "grids.h5"),
        ("no plane", |place| fs::write(place.join("plane_x.xdmf"), b"").unwrap(), "plane_x.xdmf"),
        ("no table", |place| fs::write(place.join("readout.csv"), b"").unwrap(), "readout.csv"),
    ];
    let sound = directory();
    let full = ["readout={cells=[[3]]}", "output.warped_field=true"];
    run().set(&full).on(2).solve(sound.path()).expect("a run");
    let expected = datasets(sound.path()).expect("datasets");
    let rows: Vec<(usize, &Damage)> = DAMAGES.iter().enumerate().collect();
    check_all(&rows, |(k, (what, damage, printed))| {
        let place = directory();
        let path = place.path();
        copy(sound.path(), path).map_err(|e| e.to_string())?;
        let job = || run().set(&full).into(path);
        damage(path);
        if printed.starts_with("result.h5") {
            let resumable = ["it holds a damaged result", "--resume computes it anew", "--force"];
            job().is_refused(&resumable)?;
            // The summary is that of another case.
            let other = job().set(&["title=other"]).with(["--resume"]);
            other.is_refused(&["it holds a damaged result of another case", "--force"])?;
        }
        if printed.contains("dataset") {
            for command in ["check-result", "plot", "report"] {
                let drawn = on_results(command, path).run()?;
                drawn.ended(1, &[printed])?;
            }
        }
        let ranks = if k % 6 == 0 { 3 } else { 1 };
        let again = job().on(ranks).with(["--resume"]).succeed()?;
        again.contains(&again.errors, &["is damaged and is computed anew", printed])?;
        if reports_finished(&again) || !differences(&datasets(path)?, &expected).is_empty() {
            return Err(again.report(&format!("{what}: not computed anew")));
        }
        let again = job().with(["--resume"]).succeed()?;
        if !reports_finished(&again) || again.errors.contains("damaged") {
            return Err(again.report(&format!("{what}: not repaired")));
        }
        Ok(())
    });
}

/// With closed standard streams, the files of a process get the numbers of these streams. No
/// printed text gets into the files.
#[test]
fn closed_streams_do_not_damage_files() {
    let (whole, alone) = (directory(), directory());
    run().into(whole.path()).succeed().unwrap();
    let finished = run().into(alone.path()).without_streams().succeed().unwrap();
    assert_eq!(finished.printed, "");
    let differ = differences(&datasets(alone.path()).unwrap(), &datasets(whole.path()).unwrap());
    assert!(differ.is_empty(), "{differ:?}");
    let path = alone.path().display().to_string();
    let check = Job::new(["check-result", &path]);
    check.succeed().unwrap();
    check.without_streams().succeed().unwrap();
    // A refusal still has its exit code.
    run().into(alone.path()).without_streams().run().unwrap().ended(2, &[]).unwrap();
}

/// A directory below `place` whose path has `length` bytes.
fn long(place: &Path, length: usize) -> PathBuf {
    let mut text = place.display().to_string();
    while text.len() < length {
        let left = length - text.len() - 1;
        text += "/";
        // A last name of 101 bytes would be split into 100 and an empty one.
        text += &"d".repeat(if left == 101 { 100 } else { left.min(100) });
    }
    PathBuf::from(text)
}

#[test]
fn long_paths_are_accepted() {
    check_all(&[226, 227, 300, 2000], |&length| {
        let place = directory();
        let path = long(place.path(), length);
        assert_eq!(path.as_os_str().len(), length);
        let settings = ["output.warped_field=true"];
        let ranks = if length == 227 { 2 } else { 1 };
        run().set(&settings).on(ranks).solve(&path)?;
        on_results("check-result", &path).on(ranks).succeed()?;
        let again = run().set(&settings).into(&path).with(["--resume"]).on(ranks).succeed()?;
        if reports_finished(&again) { Ok(()) } else { Err(again.report("not finished")) }
    });
}

/// The disk is full when the last file is written: a limit on the size of files is just above that
/// of the other files.
#[test]
fn a_run_without_a_summary_is_not_finished() {
    let place = directory();
    let path = place.path();
    // The readout of many cells makes the summary larger than the other files.
    let cells: Vec<String> = (0..200).map(|cell| format!("[{cell}]")).collect();
    let readout = format!("readout={{cells=[{}]}}", cells.join(","));
    let wide = ["output.xdmf=false", "axis.0.x.cells=200", "axis.0.v.cells=6", &readout];
    let job = || run().set(&wide).into(path);
    job().succeed().expect("a run");
    let kibibytes = |name: &str| fs::metadata(path.join(name)).expect("a file").len() / 1024;
    // The limit includes the plan's margin for metadata.
    let others = kibibytes("result.h5").max(kibibytes("readout.csv")) + 300;
    assert!(kibibytes("summary.json") > others, "{} and {others}", kibibytes("summary.json"));
    let sound = datasets(path).expect("datasets");
    for name in names_in(path) {
        fs::remove_file(path.join(name)).expect("a file");
    }
    let finished = job().on(2).files_up_to(others).run().expect("a run");
    finished.ended(1, &["summary.json"]).unwrap();
    assert_eq!(names_in(path), ["readout.csv", "result.h5"], "other files are left");
    let again = job().with(["--resume"]).succeed().expect("a run");
    assert!(!reports_finished(&again), "{}", again.report("there was no summary"));
    assert_eq!(names_in(path), ["readout.csv", "result.h5", "summary.json"]);
    equals_whole(path, &sound, &[]).unwrap();
}

/// Whether a run holds the lock of a directory. The file is there before it is locked, and empty.
fn holds_lock(directory: &Path) -> bool {
    fs::metadata(directory.join("run.lock")).is_ok_and(|file| file.len() > 0)
}

/// A run or a sweep that waits for another one in its directory looks at the results again when
/// that has ended: it replaces none without `--force`, and computes none again.
#[test]
fn a_run_that_waited_for_another_keeps_its_results() {
    const LATE: &str = "another run writes into it";
    let longer = ["axis.0.x.cells=90", "axis.0.v.cells=70", "time.end=1"];
    let first = || run().set(&longer);
    let sweep = || {
        let settings = [&SMALL[..], &longer[..2]].concat();
        of_case("sweep", "example1.toml").set(&settings).with(["--vary", "time.end=1,0.1"])
    };
    // Sweeps have a directory for each run.
    let is_locked = |path: &Path| {
        let of_runs = fs::read_dir(path).into_iter().flatten().flatten();
        let mut places = of_runs.map(|run| run.path()).chain([path.to_owned()]);
        places.any(|place| holds_lock(&place))
    };
    let waits = |first: Job, second: Job| {
        let place = directory();
        let path = place.path().to_owned();
        let (mut second, mut other) = (Some(second.into(&path).nested()), None);
        let first = first.into(&path).on(2).closely().run_while(|mpirun, _| {
            let ranks = children(mpirun.id());
            if second.is_none() || ranks.len() < 2 || !is_locked(&path) {
                return;
            }
            let Some(second) = second.take() else { return };
            ranks.iter().for_each(|&rank| send("-STOP", rank));
            other = Some(std::thread::spawn(move || second.run()));
            // It looks at the directory, and waits for five seconds.
            std::thread::sleep(Duration::from_millis(1500));
            ranks.iter().for_each(|&rank| send("-CONT", rank));
        });
        first.expect("the first job").ended(0, &[]).unwrap();
        let other = other.expect("a second job").join().expect("its thread");
        (place, other.expect("the end of the second job"))
    };
    let unchanged = |path: &Path| {
        let summary = json_of(path.join("summary.json")).expect("a summary");
        assert_eq!(summary["tolerance"], 1e-3, "the second run replaced the results");
    };
    for resume in [&[][..], &["--resume"]] {
        let second = first().set(&["solver.tolerance=2e-3"]).with(resume.iter().copied());
        let (place, other) = waits(first(), second);
        let refused = other.errors.contains("--force") || other.errors.contains(LATE);
        assert!(other.code == Some(2) && refused, "{}", other.report("another case"));
        unchanged(place.path());
    }
    let (place, same) = waits(first(), first().with(["--resume"]));
    let kept = same.code == Some(0) && reports_finished(&same);
    assert!(kept || same.errors.contains(LATE), "{}", same.report("the same case"));
    unchanged(place.path());
    on_results("check-result", place.path()).succeed().unwrap();
    let (_place, same) = waits(sweep(), sweep());
    let kept = same.code == Some(0) && same.errors.contains("finished before");
    assert!(kept || same.errors.contains(LATE), "{}", same.report("the same sweep"));
}

/// A second run in the directory of a run whose ranks are stopped is refused. After the ranks
/// continue, the results of the first run are complete.
#[test]
fn a_second_run_in_a_directory_is_refused() {
    let place = directory();
    let path = place.path();
    let job = run().set(&["time.end=0.29"]).into(path).on(2);
    let mut refusal = None;
    let first = job.closely().run_while(|mpirun, _| {
        let ranks = children(mpirun.id());
        if refusal.is_some() || ranks.len() < 2 || !holds_lock(path) {
            return;
        }
        ranks.iter().for_each(|&rank| send("-STOP", rank));
        refusal = Some(run().into(path).on(2).nested().run());
        ranks.iter().for_each(|&rank| send("-CONT", rank));
    });
    let first = first.expect("the first run");
    assert_eq!(first.code, Some(0), "{}", first.report("the first run"));
    let refusal = refusal.expect("a second run").expect("its end");
    refusal.ended(2, &["another run writes into it (run.lock: process", "-o"]).unwrap();
    assert_eq!(names_in(path), RESULT_FILES);
    on_results("check-result", path).succeed().unwrap();
    // Leftovers of a killed run do not block another run.
    fs::write(path.join("run.lock"), b"process 1").expect("a file");
    fs::write(path.join("result.h5.partial"), b"half").expect("a file");
    run().with(["--force"]).into(path).on(1).succeed().expect("a run");
    assert_eq!(names_in(path), RESULT_FILES);
}

/// A killed job is started again at once, while some of its old ranks still run.
#[test]
fn runs_are_continued_while_ranks_of_a_killed_run_end() {
    LazyLock::force(&WHOLE);
    let place = directory_on_disk();
    let path = place.path();
    let job = long_run().on(3).set(&[OFTEN]).into(path);
    let mut second = None;
    job.closely()
        .run_while(|mpirun, _| {
            if second.is_none() && newest(path).is_some() {
                send("-KILL", mpirun.id());
                second = Some(long_run().on(2).nested().with(["--resume"]).solve(path));
            }
        })
        .expect("the first run");
    let summary = second.expect("a second run").expect("its end");
    same(path, &summary).unwrap();
}

/// Links and pipes with the names of results are replaced; the targets of links stay unchanged.
#[test]
fn links_and_pipes_are_not_followed() {
    let place = directory();
    let victim = place.path().join("victim");
    fs::write(&victim, b"text").expect("a file");
    let path = place.path().join("results");
    fs::create_dir(&path).expect("a directory");
    let all = [&RESULT_FILES[..], &["readout.csv", "warped_f.h5"]].concat();
    for name in &all {
        std::os::unix::fs::symlink(&victim, path.join(name)).expect("a link");
        let partial = path.join(format!("{name}.partial"));
        if *name == "fields.xdmf" {
            make_pipe(&partial);
        } else {
            std::os::unix::fs::symlink(&victim, partial).expect("a link");
        }
    }
    let settings = ["output.warped_field=true", "readout={cells=[[3]]}"];
    run().set(&settings).with(["--force"]).on(2).solve(&path).expect("a run");
    assert_eq!(fs::read(&victim).expect("a file"), b"text");
    let mut expected = all.clone();
    expected.sort_unstable();
    assert_eq!(names_in(&path), expected);
    for name in all {
        assert!(fs::symlink_metadata(path.join(name)).expect("a file").is_file(), "{name}");
    }
}

/// Pictures replace links and pipes with their names, too.
#[test]
fn pictures_replace_links_and_pipes() {
    let place = directory();
    let victim = place.path().join("victim");
    fs::write(&victim, b"text").expect("a file");
    let results = place.path().join("results");
    run().solve(&results).expect("a run");
    let plots = results.join("plots");
    let draw = || on_results("plot", results.clone()).within(30).succeed().expect("pictures");
    draw();
    let names = names_in(&plots);
    assert!(names.iter().any(|name| name.ends_with(".png")), "{names:?}");
    for (k, name) in names.iter().enumerate() {
        let path = plots.join(name);
        fs::remove_file(&path).expect("a picture");
        if k % 4 < 2 {
            std::os::unix::fs::symlink(&victim, &path).expect("a link")
        } else {
            make_pipe(&path)
        }
    }
    draw();
    assert_eq!(fs::read(&victim).expect("a file"), b"text");
    assert_eq!(names_in(&plots), names);
    for name in names {
        assert!(fs::symlink_metadata(plots.join(&name)).expect("a file").is_file(), "{name}");
    }
}

/// What becomes of a pipe in an output directory.
#[derive(Clone, Copy, PartialEq)]
enum Pipe {
    /// The run is refused without `--force`, which replaces it.
    ReplacedByForce,
    /// It is removed without a question.
    Removed,
    /// The run is refused.
    Refused,
    /// The run does not need the name, and the pipe stays.
    Stays,
}

/// Seconds in which a run ends that is refused or has little to do, if it does not wait for a pipe.
const SECONDS_WITHOUT_WAITING: f64 = 5.0;

fn make_pipe(path: &Path) {
    let made = std::process::Command::new("mkfifo").arg(path).status();
    assert!(made.is_ok_and(|status| status.success()));
}

fn is_pipe(path: &Path) -> bool {
    use std::os::unix::fs::FileTypeExt;
    fs::symlink_metadata(path).is_ok_and(|found| found.file_type().is_fifo())
}

/// A pipe with the name of any file that a run reads or writes does not make the run wait.
#[test]
fn pipes_in_an_output_directory_are_not_waited_for() {
    const FULL: [&str; 2] = ["output.warped_field=true", "readout={cells=[[3]]}"];
    let results = [&RESULT_FILES[..], &["readout.csv", "warped_f.h5"]].concat();
    let mut rows: Vec<(String, &[&str], Pipe)> = Vec::new();
    for name in results {
        rows.push((name.to_owned(), &FULL, Pipe::ReplacedByForce));
        rows.push((format!("{name}.partial"), &FULL, Pipe::Removed));
    }
    rows.push(("run.lock".to_owned(), &FULL, Pipe::Refused));
    rows.push(("plane_z.xdmf".to_owned(), &FULL, Pipe::ReplacedByForce));
    for name in ["warped_f.h5", "warped_f_0001.h5", "report.html", "accuracy.json", "checkpoint"] {
        rows.push((name.to_owned(), &[], Pipe::Stays));
    }
    let options: [&[&str]; 4] = [&[], &["--force"], &["--resume"], &["--resume", "--force"]];
    let rows: Vec<_> = rows.iter().enumerate().collect();
    check_all(&rows, |(row, (name, settings, pipe))| {
        for (k, options) in options.iter().enumerate() {
            // All options with some of the names, one or two of them by turn with the others.
            let all = ["result.h5", "run.lock", "checkpoint"].contains(&name.as_str());
            if !all && (row + k) % if *pipe == Pipe::ReplacedByForce { 2 } else { 4 } != 0 {
                continue;
            }
            let place = directory();
            let path = place.path().join(name);
            make_pipe(&path);
            // Some on two ranks, where mpirun itself takes seconds to end on a busy machine.
            let ranks = if k == 1 && name == "result.h5" { 2 } else { 1 };
            let job = run().set(settings).with(options.iter().copied()).into(place.path());
            let finished = job.on(ranks).run()?;
            let forced = options.contains(&"--force");
            match pipe {
                Pipe::Refused => finished.ended(2, &[name, "is no file"])?,
                Pipe::ReplacedByForce if !forced => finished.ended(2, &[name, "is no file"])?,
                // No file of this run has this name.
                Pipe::ReplacedByForce if name == "plane_z.xdmf" => finished.ended(0, &[])?,
                Pipe::ReplacedByForce => {
                    finished.ended(0, &[])?;
                    if !path.is_file() {
                        return Err(finished.report(&format!("{name} is not replaced")));
                    }
                }
                Pipe::Removed | Pipe::Stays => {
                    finished.ended(0, &[])?;
                    if is_pipe(&path) != (*pipe == Pipe::Stays) {
                        return Err(finished.report(&format!("{name} is not left or removed")));
                    }
                }
            }
            if ranks == 1 && finished.seconds > SECONDS_WITHOUT_WAITING {
                return Err(finished.report(&format!("{name}: {} s", finished.seconds)));
            }
        }
        Ok(())
    });
}

/// The same beside finished results, by all commands that look there.
#[test]
fn pipes_beside_results_are_not_waited_for() {
    let whole = directory();
    let settings = ["output.warped_field=true", "readout={cells=[[3]]}"];
    run().set(&settings).into(whole.path()).succeed().expect("a run");
    // The name, the exit codes of the commands below, and whether they name it.
    let rows = names_in(whole.path());
    check_all(&rows, |name| {
        let place = directory();
        copy(whole.path(), place.path()).map_err(|e| e.to_string())?;
        let path = place.path().join(name);
        fs::remove_file(&path).map_err(|e| e.to_string())?;
        make_pipe(&path);
        let mut jobs = vec![on_results("check-result", place.path())];
        for options in [&[][..], &["--resume"]] {
            jobs.push(run().set(&settings).with(options.iter().copied()).into(place.path()));
        }
        if name == "result.h5" {
            jobs.extend(["plot", "report"].map(|command| on_results(command, place.path())));
        }
        for (k, job) in jobs.iter().enumerate() {
            let finished = job.run()?;
            // A damaged result has exit code 1.
            let code = if k == 0 && name != "result.h5" { 1 } else { 2 };
            finished.ended(code, &[name])?;
            if finished.seconds > SECONDS_WITHOUT_WAITING {
                return Err(finished.report(&format!("{name}: {} s", finished.seconds)));
            }
        }
        Ok(())
    });
    let page = directory();
    make_pipe(&page.path().join("report.html"));
    let report = on_results("report", whole.path()).into(page.path()).run().expect("an end");
    report.ended(2, &["report.html that is not phasewarp's"]).unwrap();
    for name in ["table.csv", "table.tex"] {
        let table = directory();
        make_pipe(&table.path().join(name));
        let sweep = Job::new(["sweep", &case("example1.toml"), "--vary", "time.end=0.1,0.2"]);
        let sweep = sweep.set(&SMALL[..3]).into(table.path()).run().expect("an end");
        sweep.ended(2, &[name, "that no sweep wrote"]).unwrap();
    }
}

/// Directories in the place of files are refused by name.
#[test]
fn directories_in_the_place_of_files_are_named() {
    for (name, printed) in [
        ("summary.json.partial", "summary.json.partial in it cannot be removed"),
        ("grids.h5.partial", "grids.h5.partial in it cannot be removed"),
        ("result.h5", "result.h5 in it is a directory"),
    ] {
        let place = directory();
        fs::create_dir(place.path().join(name)).expect("a directory");
        for options in [&[][..], &["--force"]] {
            let job = run().with(options.iter().copied()).into(place.path());
            job.is_refused(&[printed]).unwrap();
        }
    }
}

/// Directories of others in the place of checkpoints keep their files, and so do those to which a
/// link in such a place leads. A link in the place of the directory of checkpoints is refused.
#[test]
fn foreign_files_beside_checkpoints_stay() {
    let place = directory();
    let path = place.path().join("results");
    let foreign = path.join("checkpoint/000123");
    fs::create_dir_all(&foreign).expect("a directory");
    fs::write(foreign.join("data"), b"text").expect("a file");
    let finished = run().into(&path).succeed().expect("a run");
    assert_eq!(fs::read(foreign.join("data")).expect("a file"), b"text");
    finished.contains(&finished.printed, &["warning", "checkpoint could not be removed"]).unwrap();
    // Files with the names of a checkpoint's, behind a link to their directory.
    let victim = place.path().join("victim");
    fs::create_dir(&victim).expect("a directory");
    for name in ["rank-00000.bin", "manifest.json"] {
        fs::write(victim.join(name), b"text").expect("a file");
    }
    let kept = contents(&victim);
    for (k, options) in [&[][..], &["--resume"]].into_iter().enumerate() {
        let path = place.path().join(format!("linked {k}"));
        let link = path.join("checkpoint/000123");
        fs::create_dir_all(path.join("checkpoint")).expect("a directory");
        std::os::unix::fs::symlink(&victim, &link).expect("a link");
        let often = run().set(&[OFTEN]).with(options.iter().copied());
        often.into(&path).succeed().expect("a run");
        assert!(contents(&victim) == kept, "files of others are changed, {options:?}");
        assert!(link.is_symlink(), "the link is gone, {options:?}");
        assert_eq!(names_in(&path.join("checkpoint")), ["000123"], "{options:?}");
    }
    let other = place.path().join("other");
    fs::create_dir(&other).expect("a directory");
    std::os::unix::fs::symlink(&foreign, other.join("checkpoint")).expect("a link");
    let refused = run().on(2).into(&other).run().expect("an end");
    refused.ended(2, &["checkpoint", "symbolic link"]).unwrap();
    assert_eq!(fs::read(foreign.join("data")).expect("a file"), b"text");
}

/// A directory that not all ranks share is refused before the solve.
#[test]
fn a_directory_that_not_all_ranks_share_is_refused() {
    let [one, other] = [directory(), directory()];
    let job = run().with(["-o", "out"]).apart(&[one.path(), other.path()]);
    let finished = job.run().expect("an end");
    finished.ended(2, &["does not see what the first one wrote there"]).unwrap();
    assert_eq!(fs::read_dir(one.path().join("out")).expect("a directory").count(), 0);
    run().with(["-o", "out"]).apart(&[one.path(), one.path()]).succeed().expect("a run");
}

#[test]
fn a_run_does_not_overwrite_the_file_that_it_starts_from() {
    let place = directory();
    let path = place.path();
    let full = ["output.warped_field=true", "exact={f='0'}"];
    // Settings of a field from which a run can start.
    let flat = [
        "scheme.interface=conservative",
        "solver.warp.profile=smooth",
        "solver.warp.interval=[-160,40]",
        "solver.warp.points=4800",
    ];
    run().set(&flat).set(&full).on(2).solve(path).expect("a warped field");
    let start = path.join("warped_f.h5");
    let bytes = fs::read(&start).expect("a file");
    let from = format!("initial={{warped='{}'}}", start.display());
    let job = |settings: &[&str]| {
        let same = [flat[0], "solver.warp.recovery=1", "exact={f='0'}"];
        run().set(&[&from]).set(&same).set(settings).with(["--force"]).into(path)
    };
    let refused = job(&full[..1]).on(2).run().expect("an end");
    refused.ended(2, &["would overwrite warped_f.h5", "-o"]).unwrap();
    job(&[]).on(2).succeed().expect("a run that writes no warped field");
    assert_eq!(fs::read(&start).expect("a file"), bytes);
}

/// A case file can have a path that is not UTF-8. An output directory with such a path is refused
/// before the solve.
#[test]
fn paths_that_are_not_utf8_are_read_but_not_written() {
    use std::os::unix::ffi::OsStrExt;
    let place = directory();
    let path = place.path().join(std::ffi::OsStr::from_bytes(b"no text \xff"));
    let link = place.path().join(std::ffi::OsStr::from_bytes(b"case \xff.toml"));
    fs::copy(case("example1.toml"), &link).expect("a copy");
    let start = |output: &Path| {
        let mut command = std::process::Command::new(env!("CARGO_BIN_EXE_phasewarp"));
        command.arg("run").arg(&link).arg("-o").arg(output);
        command.args(SMALL.iter().flat_map(|setting| ["--set", setting]));
        command.output().expect("an end")
    };
    let refused = start(&path);
    let printed = String::from_utf8_lossy(&refused.stderr).into_owned();
    assert_eq!(refused.status.code(), Some(2), "{printed}");
    assert!(printed.contains("no UTF-8 text") && !printed.contains("panicked"), "{printed}");
    assert!(!path.exists());
    let done = start(&place.path().join("text"));
    assert_eq!(done.status.code(), Some(0), "{}", String::from_utf8_lossy(&done.stderr));
}

/// A run that needs 13 GiB is refused before it allocates anything if the address space of its
/// process is limited to 8 GiB (`ulimit -v`).
#[test]
fn limits_of_the_address_space_are_kept() {
    let place = directory();
    let large = ["axis.0.x.cells=6500", "axis.0.v.cells=6500", "solver.tolerance=0.1"];
    let job = run().set(&large).into(place.path()).capped();
    job.is_refused(&["memory: ", "available"]).unwrap();
}
