//! Grids that do not fit into memory and absurd scales are refused soon.

use crate::support::{
    SECONDS_TO_REFUSE, check_all, directory, of_case, plan, refused, solved_or_refused,
};

/// Grids that do not fit into memory are refused before allocation, by every command.
#[test]
fn grids_that_do_not_fit_into_memory_are_refused() {
    let rows: &[(&str, [&str; 2], &[&str])] = &[
        ("run", ["axis.0.x.cells=1000000000", "axis.0.v.cells=1000000000"], &[]),
        ("plan", ["axis.0.x.cells=1000000000", "axis.0.v.cells=1000000000"], &[]),
        ("check", ["axis.0.x.cells=1000000000", "axis.0.v.cells=1000000000"], &[]),
        ("run", ["axis.0.x.cells=40000", "axis.0.v.cells=40000"], &[]),
        ("run", ["axis.0.x.cells=40000", "axis.0.v.cells=40000"], &["solver.method=classical"]),
        ("run", ["axis.0.x.cells=1000000000", "axis.0.v.cells=2"], &[]),
        ("run", ["axis.0.x.cells=2", "axis.0.v.cells=1000000000"], &[]),
        (
            "run",
            ["axis.0.x.cells=1000000000", "axis.0.v.cells=1000"],
            &["scheme.interface=conservative"],
        ),
    ];
    check_all(rows, |(command, cells, settings)| {
        let place = directory();
        let mut job = of_case(command, "example1.toml").set(cells).set(settings);
        if *command == "run" {
            job = job.into(place.path());
        }
        let ranks = if settings.is_empty() { 1 } else { 2 };
        job.on(ranks).capped().is_refused(&["memory", "cells"])
    });
    // A grid that --set makes too large is reported as a mistake of --set, not of a line of the
    // file.
    let set = "axis.0.x.cells=100000000000";
    let job = of_case("check", "example1.toml").set(&["axis.0.v.cells=20", set]);
    job.is_refused(&[&format!("--set {set}"), "axis.0.x.cells", "memory"]).unwrap();
    let plan = plan("example1.toml", 4).with(["--memory-per-rank", "1MB"]);
    plan.is_refused(&["memory", "needed", "976.6 KiB"]).unwrap();
}

/// For any number of cells, `plan` and `check` answer or refuse within the time limit.
#[test]
fn plan_and_check_of_absurd_grids_do_not_hang() {
    let mut rows = Vec::new();
    for command in ["plan", "check"] {
        for cells in [
            ["axis.0.x.cells=1000000000", "axis.0.v.cells=2"],
            ["axis.0.x.cells=1000000000000", "axis.0.v.cells=1"],
            ["axis.0.x.cells=1000000", "axis.0.v.cells=1000000"],
        ] {
            rows.push((command, cells));
        }
    }
    check_all(&rows, |(command, cells)| {
        let job = of_case(command, "example1.toml").set(cells);
        let mut finished = job.within(SECONDS_TO_REFUSE as u64).capped().run()?;
        // A slow machine announces that this takes about so long.
        let announced = finished.errors.find("evaluating V and planning take about");
        if let Some(end) = announced.and_then(|at| Some(at + finished.errors[at..].find('\n')? + 1))
        {
            finished.errors.drain(..end);
        }
        match finished.code {
            Some(0) => Ok(()),
            _ => refused(&finished, &["memory"]),
        }
    });
}

/// A run that is too long whatever `V` is, is refused before `V` is evaluated.
#[test]
fn long_transport_is_refused_before_the_potential_is_evaluated() {
    let job = of_case("plan", "example1.toml").set(&["axis.0.x.cells=100000000"]);
    let finished = job.run().expect("an end");
    refused(&finished, &["the spectrum of S spans"]).unwrap();
    let used = finished.processor_seconds;
    assert!(used < 1.0, "{}", finished.report(&format!("{used:.1} s of a processor")));
}

/// A classical run has no `S`, so that its rate is named.
#[test]
fn long_classical_runs_are_refused_for_their_rate() {
    let settings = ["solver.method=classical", "time.end=1e12"];
    let finished = of_case("plan", "example1.toml").set(&settings).run().expect("an end");
    refused(&finished, &["time.end = 1e12", "that rate is"]).unwrap();
}

/// Cases with absurd scales, which are too long, too fast or too fine, are solved or refused.
#[test]
fn absurd_scales_are_solved_or_refused() {
    let rows: &[(&str, &[&str])] = &[
        ("run", &["time.end=1e300"]),
        ("run", &["time.end=1e300", "scheme.interface=conservative"]),
        ("run", &["time.end=1e8"]),
        ("plan", &["time.end=1e8"]),
        ("plan", &["time.end=1e300"]),
        ("run", &["time.end=1e-100"]),
        ("run", &["axis.0.v.upper=1e10"]),
        ("run", &["axis.0.v.upper=1e150"]),
        ("run", &["axis.0.v.lower=-1e300", "axis.0.v.upper=1e300"]),
        ("run", &["axis.0.x.lower=-1e-10", "axis.0.x.upper=1e-10"]),
        ("run", &["potential.0.value=1e10*x"]),
        ("run", &["potential.0.value=1e300*x"]),
        ("run", &["inflow.value=1e300"]),
    ];
    let rows: Vec<_> = rows.iter().enumerate().collect();
    check_all(&rows, |(k, (command, settings))| {
        let place = directory();
        let small = ["axis.0.x.cells=16", "axis.0.v.cells=16"];
        let mut job = of_case(command, "example1.toml").set(&small).set(settings);
        if *command == "run" {
            job = job.set(&["solver.verify=true"]).into(place.path());
        }
        // Some on two ranks.
        let finished = job.on(if k % 5 == 0 { 2 } else { 1 }).capped().run()?;
        if *command == "plan" && finished.code == Some(0) {
            return Ok(());
        }
        solved_or_refused(&finished, place.path(), 1e-6, &[])
    });
}
