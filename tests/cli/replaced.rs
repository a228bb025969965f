//! Existing files in an output directory: results are not replaced without `--force`.

use crate::support::{
    Job, RESULT_FILES, check_all, contents, copy, directory, of_case, on_results, small_run,
};
use std::fs;
use std::sync::LazyLock;
use tempfile::TempDir;

/// The grid of a study of two seconds.
const STUDIED: [&str; 2] = ["axis.0.x.cells=16", "axis.0.v.cells=16"];

/// A small run with these settings.
fn run(settings: &[&str]) -> Job {
    small_run().set(settings)
}

#[test]
fn results_are_not_replaced_without_force() {
    let place = directory();
    let path = place.path();
    run(&[]).into(path).succeed().expect("a run");
    let before = contents(path);
    let other = "it holds another result: solver.tolerance is 0.001 there, 0.01 here";
    // Settings, options, and a text of the refusal.
    let rows: [(&[&str], &[&str], &str); 6] = [
        (&[], &[], "it holds the result of this case; --resume keeps it"),
        (&["checkpoint.minutes=3"], &[], "it holds the result of this case; --resume keeps it"),
        (&["solver.tolerance=1e-2"], &[], other),
        (&["solver.tolerance=1e-2"], &["--resume"], other),
        (&["output.compression=1"], &["--resume"], "output.compression is not given there, 1 here"),
        // Refused before the trials, which would take longer than the limit of a refusal.
        (&[], &["--accuracy", "1e-2", "--budget", "1h"], "it holds"),
    ];
    // The first on two ranks.
    let rows: Vec<_> = rows.iter().enumerate().collect();
    check_all(&rows, |(k, (settings, options, printed))| {
        let ranks = if *k == 0 { 2 } else { 1 };
        let job = run(settings).with(options.iter().copied()).into(path).on(ranks);
        job.is_refused(&[printed, "--force replaces it", "-o gives another directory"])
    });
    assert!(contents(path) == before, "a refused run changed the directory");
    let finished = run(&[]).into(path).with(["--resume", "--force"]).succeed().expect("an end");
    assert!(finished.output.contains("the run is finished"), "{}", finished.report("finished"));
    assert!(contents(path) == before, "a finished run was repeated");
}

#[test]
fn replaced_results_lose_their_pictures() {
    let place = directory();
    let path = place.path();
    run(&["readout={cells=[[3]]}", "output.warped_field=true"]).into(path).succeed().unwrap();
    let shown = path.display().to_string();
    for command in ["plot", "report"] {
        Job::new([command, &shown]).succeed().expect("pictures");
    }
    let names = || contents(path).into_keys().collect::<Vec<_>>();
    for name in ["plots/phase_space.svg", "plots/readout.png", "report.html", "warped_f.h5"] {
        assert!(names().iter().any(|n| n == name), "{name}: {:?}", names());
    }
    fs::write(path.join("plots/mine.svg"), "mine").expect("a file");
    run(&["output.xdmf=false"]).with(["--force"]).into(path).succeed().unwrap();
    assert_eq!(names(), ["plots/mine.svg", "result.h5", "summary.json"]);
    fs::remove_file(path.join("plots/mine.svg")).expect("a file");
    Job::new(["plot", &shown]).succeed().expect("pictures");
    run(&[]).with(["--force"]).into(path).succeed().unwrap();
    assert_eq!(names(), RESULT_FILES);
    assert!(!path.join("plots").exists(), "the empty folder is left");
}

/// Results at two times, until 0.3 and until 0.2.
static RESULTS: LazyLock<[TempDir; 2]> = LazyLock::new(|| {
    ["time.end=0.3", "time.end=0.2"].map(|end| {
        let place = directory();
        run(&["output.field_times=[0.1]", end]).into(place.path()).succeed().expect("a run");
        place
    })
});

/// A command of the program with example 1 on a tiny grid.
fn tiny(command: &str) -> Job {
    let plan = ["solver.warp.profile=exponential", "solver.warp.points=16"];
    let grid = ["axis.0.x.cells=4", "axis.0.v.cells=4", "solver.tolerance=1e-1"];
    of_case(command, "example1.toml").set(&grid).set(&plan)
}

/// A chart or a stability study of two seconds.
fn study(command: &str) -> Job {
    of_case(command, "example1.toml").with(["--budget", "2s"]).set(&STUDIED)
}

/// A command that writes into a directory.
struct Writer {
    job: Job,
    /// The same for another case.
    other: Job,
    /// Its first file.
    file: &'static str,
    /// A text of the message that refuses the other case.
    printed: &'static str,
}

/// A command of a case, and the same with another end of time.
fn of_two_cases(job: Job, file: &'static str, printed: &'static str) -> Writer {
    Writer { other: job.clone().set(&["time.end=0.2"]), job, file, printed }
}

/// A command on two results.
fn of_two_results(command: &str, file: &'static str, printed: &'static str) -> Writer {
    let [job, other] = RESULTS.each_ref().map(|place| on_results(command, place.path()));
    Writer { job, other, file, printed }
}

/// A sweep, an export, a report, pictures and a movie replace their own files, and other files only
/// with `--force`.
#[test]
fn tables_exports_and_reports_are_not_replaced_without_force() {
    let vary = ["--vary", "solver.tolerance=1e-2,1e-1"];
    let sweep =
        of_case("sweep", "example1.toml").with(vary).set(&["axis.0.x.cells=4", "axis.0.v.cells=4"]);
    let stability = study("stability").with(["--only", "cfl"]);
    let rows = [
        of_two_cases(study("chart"), "chart.csv", "the chart of another case: time.end is 1"),
        of_two_cases(stability, "stability.csv", "of another case: time.end is 1"),
        of_two_cases(sweep, "table.csv", "a sweep with other runs"),
        of_two_cases(tiny("export-matrix"), "A.mtx", "time.end is 1"),
        of_two_cases(tiny("export-quantum"), "field.npy", "time.end"),
        of_two_results("report", "report.html", "of another case"),
        of_two_results("plot", "moments.svg", "time.end is 0.3"),
        of_two_results("movie", "movie.gif", "time.end is 0.3"),
    ];
    check_all(&rows, |Writer { job, other, file, printed }| {
        let place = directory();
        let path = place.path();
        // Two of them on two ranks.
        let ranks = if ["table.csv", "moments.svg"].contains(file) { 2 } else { 1 };
        job.clone().into(path).succeed()?;
        job.clone().into(path).on(ranks).succeed()?;
        let before = contents(path);
        let other = other.clone().into(path);
        other.clone().on(ranks).is_refused(&["it holds", printed, "--force", "-o"])?;
        if contents(path) != before {
            return Err(format!("{file}: a refused command changed the directory"));
        }
        other.with(["--force"]).succeed()?;
        if contents(path) == before {
            return Err(format!("{file}: --force replaced nothing"));
        }
        // A foreign file with the name of an output.
        let place = directory();
        fs::write(place.path().join(file), "a letter").map_err(|e| e.to_string())?;
        job.clone().into(place.path()).is_refused(&["it holds", file, "--force", "-o"])?;
        let kept = fs::read(place.path().join(file)).is_ok_and(|bytes| bytes == b"a letter");
        if !kept || contents(place.path()).len() != 1 {
            return Err(format!("{file}: the directory was changed"));
        }
        Ok(())
    });
}

/// Pictures of a run are not written into the results of another run, only into its own.
#[test]
fn pictures_are_not_written_into_other_results() {
    let [own, other] = [directory(), directory()];
    for (place, results) in [&own, &other].into_iter().zip(RESULTS.iter()) {
        copy(results.path(), place.path()).expect("a copy");
    }
    let before = contents(other.path());
    for command in ["plot", "report", "movie"] {
        for there in [other.path().to_owned(), other.path().join("plots")] {
            let refused = on_results(command, own.path()).into(&there);
            let wording = ["it holds the result.h5 of another run", "--force", "-o"];
            refused.is_refused(&wording).expect("a refusal");
            assert_eq!(contents(other.path()), before, "the directory was changed");
        }
    }
    let path = own.path();
    for place in [path.join("plots"), path.join("./plots/../plots"), path.to_owned()] {
        on_results("plot", path).into(&place).succeed().expect("pictures");
        assert!(!place.join("description.json").exists(), "{}", place.display());
    }
}

/// A chart and a stability study of one case share a directory, and leave an export there. Two
/// kinds of export in one directory are refused.
#[test]
fn studies_share_a_directory() {
    let place = directory();
    tiny("export-matrix").into(place.path()).succeed().expect("matrices");
    for command in ["chart", "stability", "chart"] {
        study(command).into(place.path()).succeed().expect("a study beside others");
    }
    let quantum = tiny("export-quantum").into(place.path());
    quantum.is_refused(&["an export of another kind, \"matrix\""]).expect("a refusal");
}

#[test]
fn foreign_files_are_not_replaced_without_force() {
    let rows = [
        ("result.h5", "it holds a result.h5 that is not phasewarp's"),
        ("summary.json", "it holds summary.json, which belongs to no result.h5 there"),
        ("fields.xdmf", "it holds fields.xdmf"),
        ("grids.h5", "it holds grids.h5"),
        ("space.xdmf", "it holds space.xdmf"),
        ("plane_z.xdmf", "it holds plane_z.xdmf"),
        ("readout.csv", "it holds readout.csv"),
        ("warped_f.h5", "it holds warped_f.h5"),
    ];
    check_all(&rows, |(name, printed)| {
        let place = directory();
        let path = place.path();
        let file = path.join(name);
        fs::write(&file, "a letter").map_err(|e| e.to_string())?;
        let job = run(&["output.warped_field=true"]).into(path);
        job.is_refused(&[printed, "--force"])?;
        // `--resume` does not replace them either.
        if *name == "result.h5" || *name == "summary.json" {
            job.clone().with(["--resume"]).is_refused(&[printed, "--force"])?;
        }
        let kept = fs::read(&file).is_ok_and(|bytes| bytes == b"a letter");
        if !kept || contents(path).len() != 1 {
            return Err(format!("{name}: the directory was changed"));
        }
        let ranks = if *name == "result.h5" { 2 } else { 1 };
        job.with(["--force"]).on(ranks).succeed().map(|_| ())
    });
    let chosen = directory();
    fs::write(chosen.path().join("accuracy.json"), "a letter").expect("a file");
    let wanted = run(&[]).into(chosen.path()).with(["--accuracy", "0.5", "--budget", "1s"]);
    wanted.is_refused(&["it holds accuracy.json", "--force"]).unwrap();
    // Without a result in the directory, files with the names of derived outputs are not removed.
    // They do not prevent a run, nor do files with other names.
    let place = directory();
    let others =
        ["report.html", "warped_f.h5", "warped_f_0001.h5", "plots/density.png", "letter.txt"];
    fs::create_dir(place.path().join("plots")).expect("a directory");
    others.iter().for_each(|name| fs::write(place.path().join(name), "a letter").expect("a file"));
    run(&[]).into(place.path()).succeed().expect("a run");
    for name in others {
        assert_eq!(fs::read(place.path().join(name)).ok().as_deref(), Some(&b"a letter"[..]));
    }
}
