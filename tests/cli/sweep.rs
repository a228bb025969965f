//! `phasewarp sweep`: one table of all combinations, finished and failed runs, and job arrays.

use crate::support::{Finished, Job, check_all, directory, json_of, of_case, text_of};
use phasewarp::base::text::csv_records;
use std::path::{Path, PathBuf};

/// A sweep of a small case over these values, with results in a directory.
fn sweep(directory: &Path, vary: &[&str]) -> Job {
    let job = of_case("sweep", "example1.toml").into(directory);
    let job = job.set(&["axis.0.x.cells=16", "axis.0.v.cells=16", "solver.verify=true"]);
    vary.iter().fold(job, |job, vary| job.with(["--vary", vary]))
}

/// The directories of the runs of a sweep.
fn runs(sweep: &Job) -> Result<Vec<PathBuf>, String> {
    let list = sweep.clone().with(["--list"]).succeed()?;
    let last = list.output.lines().filter_map(|line| line.rsplit('\t').next());
    Ok(last.map(PathBuf::from).collect())
}

/// A CSV file: the names in its first line and the fields of the other lines.
struct Table {
    names: Vec<String>,
    rows: Vec<Vec<String>>,
}

impl Table {
    fn read(directory: &Path) -> Result<Self, String> {
        let mut rows = csv_records(&text_of(directory.join("table.csv"))?).into_iter();
        let names = rows.next().ok_or("no line of names")?;
        Ok(Self { names, rows: rows.collect() })
    }

    fn get(&self, row: usize, name: &str) -> &str {
        let column = self.names.iter().position(|n| n == name);
        column.and_then(|column| self.rows[row].get(column)).map_or("", String::as_str)
    }
}

fn fits(finished: &Finished) -> Result<(), String> {
    let widest = finished.output.lines().map(|line| line.chars().count()).max().unwrap_or(0);
    if widest > 100 { Err(finished.report(&format!("a line of {widest}"))) } else { Ok(()) }
}

/// Every combination has a row with the numbers of its `summary.json`. A larger sweep keeps the
/// finished runs.
#[test]
fn a_table_has_a_row_for_each_combination() {
    let place = directory();
    let degrees = "scheme.degree=0,1";
    let job = sweep(place.path(), &[degrees, "solver.tolerance=1e-2,1e-4"]);
    let finished = job.clone().on(2).succeed().unwrap();
    fits(&finished).unwrap();
    let printed = ["[2/4] scheme.degree=0 solver.tolerance=0.0001: ", "[4/4] ", " s\n"];
    finished.contains(&finished.errors, &printed).unwrap();
    finished.contains(&finished.output, &["run  scheme.degree  ", "error_semidiscrete"]).unwrap();
    let table = Table::read(place.path()).unwrap();
    let keys = ["cells", "modes", "matvecs", "error_semidiscrete", "mass", "wall_seconds"];
    let runs_before = runs(&job).unwrap();
    assert_eq!(table.rows.len(), 4);
    for (i, run) in runs_before.iter().enumerate() {
        let found = json_of(run.join("summary.json")).unwrap();
        for key in keys {
            let number: f64 = table.get(i, key).parse().unwrap_or(f64::NAN);
            assert_eq!(Some(number), found[key].as_f64(), "{key} of {}", run.display());
        }
        let grid: f64 = table.get(i, "accuracy.grid").parse().unwrap_or(f64::NAN);
        assert_eq!(Some(grid), found["accuracy"]["grid"].as_f64());
        let given = ["0", "0", "1", "1"][i];
        assert_eq!(table.get(i, "scheme.degree"), given);
        let tolerance: f64 = table.get(i, "solver.tolerance").parse().expect("a tolerance");
        assert!(found["error_semidiscrete"].as_f64().is_some_and(|error| error <= tolerance));
        assert_eq!(table.get(i, "directory"), run.display().to_string());
        assert_eq!(table.get(i, "error"), "");
    }
    let tex = text_of(place.path().join("table.tex")).unwrap();
    assert_eq!(tex.matches(" \\\\\n").count(), 5, "{tex}");
    assert!(tex.contains("scheme.degree & solver.tolerance & cells & modes"), "{tex}");
    // One more value, on other ranks.
    let written =
        |run: &PathBuf| std::fs::metadata(run.join("result.h5")).and_then(|m| m.modified());
    let before: Vec<_> = runs_before.iter().map(|run| written(run).expect("a result")).collect();
    let job = sweep(place.path(), &[degrees, "solver.tolerance=1e-3,1e-2,1e-4"]);
    let finished = job.on(3).succeed().unwrap();
    assert_eq!(finished.errors.matches(": finished before").count(), 4, "{}", finished.errors);
    let after: Vec<_> = runs_before.iter().map(|run| written(run).expect("a result")).collect();
    assert_eq!(before, after);
    assert_eq!(Table::read(place.path()).unwrap().rows.len(), 6);
}

/// Values can be arrays, formulas with commas and words, as in `--set`. Names of directories have
/// no special characters.
#[test]
fn values_can_be_arrays_and_formulas() {
    let place = directory();
    let path = place.path().join("a b; c");
    let vary = [
        "output.field_times=[0.1, 0.2],[]",
        "initial.f=\"exp(-20*((x+0.6)^2+(v-0.6)^2))\",max(0, 1-abs(4*(x+0.6)))*exp(-9*(v-0.6)^2)",
        "scheme.interface=hat",
    ];
    let job = sweep(&path, &vary).set(&["solver.tolerance=1e-2"]);
    let finished = job.clone().on(2).succeed().unwrap();
    fits(&finished).unwrap();
    let table = Table::read(&path).unwrap();
    assert_eq!(table.rows.len(), 4);
    assert_eq!(table.get(0, "output.field_times"), "[0.1,0.2]");
    assert_eq!(table.get(3, "output.field_times"), "[]");
    assert!(table.get(1, "initial.f").starts_with("max(0, 1-abs"));
    for run in runs(&job).unwrap() {
        let name = run.file_name().and_then(|name| name.to_str()).expect("a name").to_owned();
        assert!(name.chars().all(|c| c.is_ascii_alphanumeric() || ".,=+_-".contains(c)), "{name}");
        assert!(run.join("result.h5").exists(), "{name}");
    }
}

/// A refused case has a row with its message, and the other cases are run.
#[test]
fn a_refused_case_has_a_row() -> Result<(), String> {
    let ranks = 2;
    let place = directory();
    let job = sweep(place.path(), &["solver.tolerance=5,1e-2", "time.end=0.1"]);
    let finished = job.clone().on(ranks).run()?;
    finished.ended(3, &["[1/2] solver.tolerance=5 time.end=0.1: ", "1 of 2 runs failed"])?;
    fits(&finished)?;
    let reason = "\n\nrun 1: --set solver.tolerance=5: solver.tolerance = 5";
    finished.contains(&finished.output, &[reason])?;
    let table = Table::read(place.path())?;
    let refused = table.get(0, "error").contains("solver.tolerance");
    let right = [refused, table.get(0, "mass").is_empty(), table.get(1, "error").is_empty()];
    if right != [true; 3] || table.get(1, "mass").is_empty() {
        return Err(finished.report(&format!("{:?}", table.rows)));
    }
    let tex = text_of(place.path().join("table.tex"))?;
    finished.contains(&tex, &["% --set solver.tolerance=5"])?;
    // With `--index`, it is refused like a run.
    job.with(["--index", "1"]).on(ranks).is_refused(&["solver.tolerance", "5"])
}

/// A run that misses its tolerance counts as failed with `solver.strict`, also if it was finished
/// before. Its row has its numbers.
#[test]
fn a_missed_tolerance_is_a_failure_with_strict() {
    let place = directory();
    let job = sweep(place.path(), &["solver.strict=true,false", "solver.tolerance=1e-6"]);
    let job = job.set(&["solver.propagator={method='crank-nicolson',step=0.05}"]);
    for job in [job.clone().on(2), job.clone(), job.clone().with(["--table"])] {
        let finished = job.run().unwrap();
        assert_eq!(finished.code, Some(3), "{}", finished.report("a sweep"));
        let table = Table::read(place.path()).unwrap();
        assert!(table.get(0, "error").contains("MISSED"), "{:?}", table.rows);
        assert_eq!(table.get(1, "error"), "");
        for row in 0..2 {
            assert!(!table.get(row, "error_semidiscrete").is_empty(), "{:?}", table.rows);
        }
    }
}

/// Invalid sweeps are refused before any run.
#[test]
fn mistakes_are_refused_before_any_run() {
    let place = directory();
    let path = place.path().join("none");
    let rows: [(&[&str], &[&str]); 8] = [
        (&["solver.tolerence=1e-2,1e-3"], &["unknown key", "solver.tolerence", "did you mean"]),
        (&["axis.7.x.cells=2,4"], &["axis.7.x.cells", "no index"]),
        (&["solver.tolerance=5,6"], &["--set solver.tolerance=5", "solver.tolerance"]),
        (&["solver.tolerance=1e-2,"], &["--vary solver.tolerance=1e-2,", "empty"]),
        (&["output.field_times=[0.1"], &["--vary output.field_times=[0.1", "no partner"]),
        (&["time.end=1", "time.end=2"], &["--vary time.end", "twice"]),
        (&["time.end=0.1,0.2,1e-1"], &["runs 1 and 3 are the same", "time.end=0.1"]),
        (&["solver.accuracy=0.1,0.2"], &["solver.accuracy = 1e-1", "advise"]),
    ];
    check_all(&rows, |(vary, wording)| sweep(&path, vary).is_refused(wording));
    let job = sweep(&path, &["time.end=0.1,0.2"]);
    check_all(&["0", "3"], |index| {
        job.clone().with(["--index", index]).is_refused(&["--index", index, "from 1 to 2"])
    });
    let thousands = (0..101).map(|i| i.to_string()).collect::<Vec<_>>().join(",");
    let many = ["readout.seed", "readout.shots"].map(|key| format!("{key}={thousands}"));
    sweep(&path, &[&many[0], &many[1]]).is_refused(&["10201 combinations", "10000"]).unwrap();
    sweep(&path, &[]).is_refused(&["--vary"]).unwrap();
    let left = std::fs::read_dir(&path).map(Iterator::count).unwrap_or(0);
    assert_eq!(left, 0, "files in {}", path.display());
}

/// A job array solves the runs one by one and then writes the table.
#[test]
fn an_array_solves_run_by_run() {
    let place = directory();
    let job = sweep(place.path(), &["solver.tolerance=1e-2,1e-3", "scheme.interface=hat"]);
    let list = job.clone().with(["--list"]).on(2).succeed().unwrap();
    let lines: Vec<Vec<&str>> =
        list.output.lines().map(|line| line.split('\t').collect()).collect();
    assert_eq!(lines.len(), 2, "{}", list.output);
    assert_eq!(lines[1][..2], ["2", "solver.tolerance=0.001 scheme.interface=hat"]);
    let runs = runs(&job).unwrap();
    assert_eq!(lines[1][2], runs[1].display().to_string());
    assert!(std::fs::read_dir(place.path()).expect("a directory").next().is_none());
    let second = job.clone().with(["--index", "2"]).on(2).succeed().unwrap();
    second.contains(&second.errors, &["[2/2] ", " s"]).unwrap();
    assert!(runs[1].join("result.h5").exists() && !runs[0].exists());
    assert!(!place.path().join("table.csv").exists());
    let table = job.clone().with(["--table"]);
    let missing = table.run().unwrap();
    missing.ended(3, &["1 of 2 runs are not finished", "table.csv"]).unwrap();
    assert!(!runs[0].exists(), "--table solves nothing");
    let found = Table::read(place.path()).unwrap();
    assert_eq!([found.get(0, "error"), found.get(1, "error")], ["not finished", ""]);
    // The first run on other ranks; the second time it is finished.
    for printed in [" s", "finished before"] {
        let first = job.clone().with(["--index", "1"]).on(3).succeed().unwrap();
        first.contains(&first.errors, &["[1/2] ", printed]).unwrap();
    }
    table.on(2).succeed().unwrap();
    let found = Table::read(place.path()).unwrap();
    assert!(
        found.rows.len() == 2 && !found.names.contains(&"error".to_owned()),
        "{:?}",
        found.names
    );
    // The table counts a damaged result as not finished, and solves nothing.
    let result = runs[0].join("result.h5");
    let whole = std::fs::read(&result).expect("a result");
    std::fs::write(&result, &whole[..whole.len() / 2]).expect("half of it");
    let damaged = job.clone().with(["--table"]).run().unwrap();
    damaged.ended(3, &["1 of 2 runs are not finished"]).unwrap();
    damaged.contains(&damaged.errors, &["result.h5", "damaged, and so not finished"]).unwrap();
    for words in ["--resume", "computed anew"] {
        assert!(!damaged.errors.contains(words), "{}", damaged.errors);
    }
    assert_eq!(Table::read(place.path()).unwrap().get(0, "error"), "not finished");
    std::fs::write(&result, &whole).expect("all of it");
    // A damaged result is computed again.
    std::fs::remove_file(runs[0].join("summary.json")).expect("a summary");
    let again = job.on(2).succeed().unwrap();
    assert_eq!(again.errors.matches("finished before").count(), 1, "{}", again.report("kept"));
    assert!(runs[0].join("summary.json").exists());
}
