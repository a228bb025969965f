//! Runs that continue from the results of other runs: `run --continue DIR --until T2`.

use crate::checkpoint::{Fault, OFTEN, generations, with_fault};
use crate::random_cases::{Choices, check_scenes};
use crate::reduce::{THREE_METHODS, scene};
use crate::support::{
    Job, Summary, at_most, case, change_hdf5, check_all, datasets, differences, directory,
    directory_on_disk, distance, field, near, of_case, run, written,
};
use std::fs;
use std::path::Path;

/// A run that continues from the results in `directory` until `time`.
fn on(directory: &Path, time: f64) -> Job {
    let directory = directory.display().to_string();
    Job::new(["run", "--continue", &directory, "--until", &time.to_string()])
}

/// A number of `summary.continued`.
fn inherited(summary: &Summary, key: &str) -> Option<f64> {
    summary.value["continued"][key].as_f64()
}

/// A run in two parts equals one run, up to the errors that both report. Its error against the
/// exact solution is the same, so the time of that solution counts from 0.
#[test]
fn two_parts_are_one_run() {
    const CLASSICAL: &str = "solver.method=classical";
    type Row<'a> = (&'a str, &'a [&'a str], f64, f64);
    let elements = &["axis.0.x.cells=10", "axis.0.v.cells=6", "scheme.degree=2"][..];
    let grid = &["axis.0.x.cells=40", "axis.0.v.cells=34", "solver.tolerance=1e-7"][..];
    let pulse = &["axis.0.x.cells=24", "axis.0.v.cells=21", "solver.tolerance=1e-5"][..];
    let plane = &["axis.0.x.cells=9", "axis.1.x.cells=8", "axis.0.v.cells=7", "axis.1.v.cells=6"];
    let rows: [Row<'_>; 10] = [
        ("example1.toml", grid, 0.2, 0.5),
        ("example1.toml", &[grid, &[CLASSICAL]].concat(), 0.2, 0.5),
        ("inflow_barrier.toml", grid, 0.1, 0.4),
        ("inflow_barrier.toml", elements, 0.1, 0.2),
        ("smooth-beams.toml", elements, 0.1, 0.3),
        ("pulsed_inflow.toml", pulse, 0.8, 1.2),
        ("pulsed_inflow.toml", &[pulse, &[CLASSICAL]].concat(), 0.8, 1.2),
        ("well.toml", &[grid, &["scheme.interface=conservative"]].concat(), 0.4, 0.9),
        ("barrier2d.toml", plane, 0.1, 0.2),
        // The reduced grid of the first part has one cell along y.
        ("periodic2d.toml", &["axis.0.x.cells=12", "axis.1.x.cells=4"], 0.3, 0.5),
    ];
    let rows: Vec<_> = rows.into_iter().enumerate().collect();
    check_all(&rows, |&(k, (name, settings, middle, end))| {
        let (whole, first, second) = (directory(), directory(), directory());
        let verified = ["solver.verify=true"];
        let job = run(name).set(settings).set(&verified);
        let until = |time: f64| format!("time.end={time}");
        let at_once = job.clone().set(&[&until(end), "output.expand=true"]);
        let at_once = at_once.solve(whole.path())?;
        // One of the parts on several ranks.
        let ranks = [[3, 1], [1, 2]][k % 2];
        let before = job.set(&[&until(middle)]).on(ranks[0]).solve(first.path())?;
        let summary = on(first.path(), end).on(ranks[1]).solve(second.path())?;
        let off = distance(&field(second.path())?, &field(whole.path())?);
        let error = at_once.number("error_semidiscrete")?;
        let reported = inherited(&summary, "error_total");
        let reported = reported.ok_or_else(|| "no error since time 0".to_owned())?;
        summary.holds(at_most("distance to one run", off, 1.01 * (reported + error) + 1e-13))?;
        let tolerance =
            if settings.contains(&CLASSICAL) { 1e-12 } else { at_once.number("tolerance")? };
        summary.holds(at_most("distance to one run", off, 5.0 * tolerance))?;
        let own = summary.number("error_semidiscrete")?;
        summary.holds(at_most("error of the second part", own, tolerance))?;
        let known = inherited(&summary, "error") == before.value["error_semidiscrete"].as_f64();
        summary.require(known, || {
            format!("error of the first part: {}", summary.value["continued"])
        })?;
        let key = "error_l2_relative";
        if at_once.value[key].is_number() {
            near(key, summary.number(key)?, at_once.number(key)?, 10.0 * tolerance)?;
        }
        near("mass at the start", summary.number("mass_initial")?, before.number("mass")?, 1e-12)?;
        near("mass", summary.number("mass")?, at_once.number("mass")?, 10.0 * tolerance)
    });
}

/// The same for random scenes, cells and elements mixed by axis, by three methods: the distance of
/// two parts to one run is at most what the runs report.
#[test]
fn random_runs_in_two_parts_are_one_run() {
    check_scenes(12, 0.5, |choices| {
        let text = scene(choices);
        let place = directory();
        let path = written(place.path(), &text)?;
        let middle = choices.of(&[0.02, 0.05, 0.0777]);
        let method = choices.of(&THREE_METHODS);
        let job = Job::new(["run", &path]);
        let exact = choices.of(&["exact={}", "exact.kind=characteristics"]);
        let job = job.set(&[method, exact, "solver.verify=true"]);
        let agree = parts_agree(&job, [middle, choices.of(&[0.1, 0.3])], choices);
        agree.map_err(|e| format!("{e}\n  of {method}, {exact}, {middle}:\n{text}"))
    });
}

/// Checks that a run until `middle`, continued until `end`, is one run. Returns whether these are
/// not refused.
fn parts_agree(job: &Job, [middle, end]: [f64; 2], choices: &mut Choices) -> Result<bool, String> {
    let (whole, first, second) = (directory(), directory(), directory());
    let until = |time: f64| format!("time.end={time}");
    let finished = job.clone().set(&[&until(end)]).into(whole.path()).run()?;
    if finished.code == Some(2) {
        return Ok(false);
    }
    let at_once = Summary::read(finished, whole.path())?;
    let before = job.clone().set(&["output.moment_times=[]", &until(middle)]);
    before.on(choices.of(&[1, 1, 2, 3])).solve(first.path())?;
    let summary = on(first.path(), end).on(choices.of(&[1, 1, 2, 3])).solve(second.path())?;
    let (found, expected) = (field(second.path())?, field(whole.path())?);
    if expected.iter().all(|x| *x == 0.0) {
        return Ok(false);
    }
    let off = distance(&found, &expected);
    let reported = inherited(&summary, "error_total").unwrap_or(f64::NAN)
        + at_once.number("error_semidiscrete")?;
    summary.holds(at_most("distance to one run", off, 1.01 * reported + 1e-13))?;
    summary.holds(at_most("distance to one run", off, 5e-7))?;
    for key in ["mass", "error_l2_relative", "mass_exact"] {
        if let Some(once) = at_once.value[key].as_f64() {
            let near = near(key, summary.number(key)?, once, 1e-6 * once.abs().max(1.0));
            summary.holds(near)?;
        }
    }
    Ok(true)
}

/// Explicit steps are continued, too. The inflow depends on the time since 0.
#[test]
fn steps_go_on() {
    let (whole, first, second) = (directory(), directory(), directory());
    let job = run("pulsed_inflow.toml").set(&[
        "axis.0.x.cells=24",
        "axis.0.v.cells=21",
        "solver.method=classical",
        "solver.classical.integrator=ssp-rk3",
    ]);
    job.clone().set(&["time.end=1.2"]).solve(whole.path()).unwrap();
    job.set(&["time.end=0.8"]).solve(first.path()).unwrap();
    let finished = on(first.path(), 1.2).on(2).into(second.path()).succeed().unwrap();
    let off = distance(&field(second.path()).unwrap(), &field(whole.path()).unwrap());
    // The two runs differ by the error of the steps, which have order 3.
    assert!(off < 1e-3, "{off:e}");
    finished
        .contains(&finished.output, &["error inherited from before t = 0.8: not known"])
        .unwrap();
    let summary = Summary::read(finished, second.path()).unwrap();
    assert_eq!(inherited(&summary, "error_total"), None);
}

/// The classical exponential has the error of round-off: a part by it has a known error, and so has
/// what continues it.
#[test]
fn the_error_of_a_classical_exponential_is_known() {
    const CLASSICAL: &[&str] = &["solver.method=classical"];
    let coarse = ["axis.0.x.cells=24", "axis.0.v.cells=20", "solver.tolerance=1e-6"];
    const VERIFIED: &[&str] = &["solver.verify=true"];
    const NEXT: &[&str] = &["solver.method=classical", "solver.verify=false"];
    let rows: [([&[&str]; 2], [f64; 2]); 2] =
        [([CLASSICAL, &[]], [1e-15, 1e-11]), ([VERIFIED, NEXT], [1e-9, 1e-4])];
    check_all(&rows, |&([before, after], [least, most])| {
        let (first, second) = (directory(), directory());
        let job = run("inflow_barrier.toml").set(&coarse).set(&["time.end=0.2"]).set(before);
        job.solve(first.path())?;
        let job = on(first.path(), 0.3).set(after).into(second.path());
        let finished = job.succeed()?;
        let summary = Summary::read(finished, second.path())?;
        let total = inherited(&summary, "error_total").unwrap_or(f64::NAN);
        let is_known = total >= least && total <= most;
        summary.require(is_known, || format!("error since time 0: {total:e}"))?;
        let verdict = &summary.value["verdict"];
        let is_given = summary.value["accuracy"]["algorithm"] == total && *verdict != "unknown";
        summary.require(is_given, || format!("{verdict}: {}", summary.value["accuracy"]))
    });
}

/// Shares of a second part are of what is in the box at its start and what enters: a steady beam
/// loses as much as enters, and data of both signs have no mass of their own. That mass leaves
/// through ends in space gives no warning.
#[test]
fn shares_of_a_second_part_are_of_all_there_is() {
    const STEADY: &str = "[[axis]]\nx = { lower = 0, upper = 2, cells = 20 }\n\
        v = { lower = -1.4, upper = 1.4, cells = 20 }\n\
        [[potential]]\nwhere = \"x < 1\"\nvalue = 0\n[[potential]]\nvalue = 0.1\n\
        [initial]\nf = 0\n[inflow]\nvalue = \"exp(-(v - 0.9)^2/0.02) if x < 1 else 0\"\n\
        [scheme]\ndegree = 3\n[time]\nend = 3\n[solver]\nmethod = \"classical\"\n";
    const SIGNED: &str = "[[axis]]\n\
        x = { lower = 0, upper = 2, cells = 20, boundary = \"periodic\" }\n\
        v = { lower = -1.4, upper = 1.4, cells = 20 }\n[[potential]]\nvalue = 0\n\
        [initial]\nf = \"sin(pi*x)*exp(-v^2/0.1)\"\n[scheme]\ndegree = 3\n[time]\nend = 0.2\n\
        [solver]\nmethod = \"classical\"\n";
    // ∫|sin(πx)| dx is 4/π, and ∫exp(-v²/0.1) dv is √(0.1 π).
    let size = 4.0 / std::f64::consts::PI * (0.1 * std::f64::consts::PI).sqrt();
    let rows = [(STEADY, 6.0, None), (SIGNED, 0.4, Some(size))];
    check_all(&rows, |&(text, until, size)| {
        let place = directory();
        let path = written(place.path(), text)?;
        let first = place.path().join("first");
        Job::new(["run", &path]).solve(&first)?;
        let summary = on(&first, until).summary()?;
        let mass = |key: &str| {
            let found = summary.value["ledger"]["mass"][key].as_f64();
            found.ok_or_else(|| format!("no mass.{key}: {}", summary.command))
        };
        let expected =
            size.map_or_else(|| Ok(mass("initial")? + mass("entered")?), Ok::<_, String>);
        near("all mass", mass("absolute")? / expected?, 1.0, 0.03)?;
        let warnings = summary.warnings();
        summary.require(!warnings.contains("mass:"), || warnings.clone())
    });
}

/// A second part has the same bits on any ranks and any mesh, and after a stop. A third part adds
/// up the errors.
#[test]
fn a_second_part_has_the_same_bits_on_any_ranks() {
    let first = directory_on_disk();
    let settings = [
        "axis.0.x.cells=33",
        "axis.0.v.cells=22",
        "solver.tolerance=1e-2",
        "solver.warp.profile=exponential",
        "solver.warp.points=512",
        "time.end=0.3",
    ];
    run("inflow_barrier.toml")
        .set(&settings)
        .set(&["solver.verify=true"])
        .solve(first.path())
        .unwrap();
    let reference = directory_on_disk();
    let job =
        || on(first.path(), 0.7).set(&["output.field_times=[0.3, 0.5]", "solver.verify=true"]);
    let before = job().solve(reference.path()).unwrap();
    let expected = datasets(reference.path()).unwrap();
    let start = expected["/history/f"].bytes.len() / 2;
    assert_eq!(
        expected["/history/f"].bytes[..start],
        datasets(first.path()).unwrap()["/f"].bytes,
        "f at the start is that of the file"
    );
    assert_eq!(expected["/axis/field_time"].numbers(), [0.3, 0.5]);
    let rows = [(3, "3"), (4, "2")];
    check_all(&rows, |&(ranks, blocks)| {
        let place = directory_on_disk();
        let job = job().on(ranks).with(["--ranks-x", blocks]);
        let summary = job.solve(place.path())?;
        let differ = differences(&datasets(place.path())?, &expected);
        summary.require(differ.is_empty(), || format!("other bits in {differ:?}"))
    });
    let place = directory_on_disk();
    let path = place.path();
    let stopped = job().on(2).set(&[OFTEN]).into(path);
    let stopped = with_fault(&stopped, Fault::Signal, |_| generations(path).len() == 2).unwrap();
    assert_eq!(stopped.code, Some(75), "{}", stopped.report("stopped"));
    let summary = job().on(3).with(["--resume"]).solve(path).unwrap();
    assert_eq!(summary.boolean("resumed"), Ok(true));
    let differ = differences(&datasets(path).unwrap(), &expected);
    assert!(differ.is_empty(), "other bits after a stop in {differ:?}");
    let again = job().with(["--resume"]).into(path).succeed().unwrap();
    assert!(again.output.contains("the run is finished"), "{}", again.output);

    // A third part, which starts from the file of the second.
    let summary = on(reference.path(), 0.8).set(&["solver.verify=true"]).summary().unwrap();
    let total = inherited(&before, "error_total");
    assert!(total.is_some() && inherited(&summary, "error") == total, "{total:?}");
    assert!(inherited(&summary, "error_total") > inherited(&summary, "error_inherited"));
}

/// Output times count from 0. Times of the first part are left out with a message.
#[test]
fn output_times_are_absolute() {
    let (first, second) = (directory(), directory());
    let settings = [
        "axis.0.x.cells=23", "axis.0.v.cells=17", "solver.tolerance=1e-3", "time.end=0.25",
        "output.field_times=[0.1]", "output.moments_every=0.1",
    ];
    run("example1.toml").set(&settings).solve(first.path()).unwrap();
    let finished = on(first.path(), 0.5).into(second.path()).succeed().unwrap();
    finished.contains(&finished.errors, &["--continue: output.field_times left out"]).unwrap();
    let stored = datasets(second.path()).unwrap();
    let times = stored["/axis/time"].numbers();
    assert!(distance(&times, &[0.3, 0.4, 0.5]) < 1e-12, "{times:?}");
    assert!(!stored.contains_key("/history/f"));
    let rows: [(&[&str], &[f64]); 3] = [
        (&["output.fields_every=0.1"], &[0.25, 0.3, 0.4, 0.5]),
        (&["output.field_times=[0.25, 0.45]"], &[0.25, 0.3, 0.4, 0.45, 0.5]),
        (&["output.moment_times=[0.35]"], &[0.3, 0.35, 0.4, 0.5]),
    ];
    check_all(&rows, |(settings, expected)| {
        let place = directory();
        let summary = on(first.path(), 0.5).set(settings).solve(place.path())?;
        let times = datasets(place.path())?["/axis/time"].numbers();
        let same = times.len() == expected.len() && distance(&times, expected) < 1e-12;
        summary.require(same, || format!("{times:?}"))
    });
    on(first.path(), 0.5)
        .set(&["output.field_times=[0.1]"])
        .into(second.path())
        .with(["--force"])
        .is_refused(&["output.field_times", "times from 0.25 on and below time.end = 0.5"])
        .unwrap();
}

#[test]
fn what_cannot_go_on_is_refused() {
    let first = directory();
    let path = first.path();
    let small = ["axis.0.x.cells=24", "axis.0.v.cells=16", "solver.tolerance=1e-3"];
    run("example1.toml").set(&small).set(&["time.end=0.2"]).into(path).succeed().unwrap();
    let measure = directory();
    let measured = ["axis.0.x.cells=24", "axis.0.v.cells=16", "time.end=0.1"];
    run("example2.toml").set(&measured).into(measure.path()).succeed().unwrap();
    let nothing = directory();
    let place = directory();
    let file = format!("initial.field={}", path.join("result.h5").display());
    let go = |settings: &[&str]| on(path, 0.5).set(settings).into(place.path());
    let given = |command: &str, settings: &[&str]| {
        of_case(command, "example1.toml").set(&small).set(&[&file]).set(settings)
    };
    let start = "time.start=0.2";
    let short = "solver.propagator={method='crank-nicolson',step=1e-9}";
    let rows: [(Job, &[&str]); 25] = [
        (run("example1.toml").with(["--until", "0.5"]), &["--until 0.5", "--set time.end"]),
        (Job::new(["run", "--continue", "results"]), &["--until <TIME>"]),
        (on(path, 0.2), &["--until 0.2", "its results are at t = 0.2", "a later time"]),
        (on(path, 0.1), &["--until 0.1", "a later time"]),
        (on(nothing.path(), 0.5), &["result.h5", "a directory that `phasewarp run` wrote"]),
        (on(measure.path(), 0.5), &["--continue", "measure-valued data are several fields"]),
        (go(&["time.start=0"]), &["--set time.start", "follows from DIR and --until"]),
        (go(&["initial.field=a.h5"]), &["--set initial.field", "follows from DIR"]),
        (go(&["time={end=9}"]), &["--set time.end", "follows from DIR"]),
        (go(&["time . start=0"]), &["--set time.start", "follows from DIR"]),
        (go(&["axis.0.x.cells=26"]), &["initial.field", "cells along x: 24 there, 26 in the case"]),
        (go(&["scheme.degree=1"]), &["degree along x: 0 there, 1 in the case"]),
        (go(&["axis.0.v.upper=3"]), &["upper end of vx", "3 in the case"]),
        (
            on(path, 0.5).into(path).with(["--force"]),
            &["would overwrite result.h5", "initial.field"],
        ),
        (on(path, 0.5).into(path), &["it holds another result", "--force replaces it"]),
        (given("run", &["time.start=0.3"]), &["is f at t = 0.2, time.start is 0.3"]),
        (
            given("run", &["time.start=2", "time.end=1"]),
            &["time.start", "must be below time.end = 1"],
        ),
        (given("run", &["time.start=-1"]), &["time.start", "must be from 0"]),
        (given("run", &[start, short]), &["solver.propagator.step", "a duration of"]),
        (
            given("run", &[start, "solver.warp.shift=1000"]),
            &["solver.warp.shift", "times a duration of"],
        ),
        (given("run", &[start, "initial.warped=w.h5"]), &["initial.f", "initial.warped"]),
        (given("advise", &[start]), &["initial.field", "advice takes other grids"]),
        (given("chart", &[start]), &["initial.field", "which a chart varies"]),
        (given("stability", &[start]), &["initial.field", "a formula"]),
        (
            run("example1.toml").set(&[start]),
            &["time.start", "initial.field", "a later start needs"],
        ),
    ];
    // A directory without results, for runs without -o.
    let apart = directory();
    check_all(&rows, |(job, wording)| job.clone().inside(apart.path()).is_refused(wording));
    // A result with a flipped bit, and the result of a run that is not finished.
    let damaged = directory();
    let bytes = fs::read(path.join("result.h5")).unwrap();
    let f = datasets(path).unwrap()["/f"].bytes.clone();
    let at = bytes.windows(f.len()).position(|w| w == f).expect("f in the file");
    let mut changed = bytes;
    changed[at + f.len() / 2] ^= 4;
    fs::write(damaged.path().join("result.h5"), changed).unwrap();
    fs::copy(path.join("summary.json"), damaged.path().join("summary.json")).unwrap();
    let finished = on(damaged.path(), 0.5).into(place.path()).run().unwrap();
    finished.ended(1, &["/f is not as it was written"]).unwrap();
    let file = format!("initial.field={}", damaged.path().join("result.h5").display());
    let job = run("example1.toml").set(&small).set(&[&file, start, "time.end=0.5"]);
    job.on(2).into(place.path()).is_refused(&["/f is not as it was written"]).unwrap();
    // A degree that no file of a run has.
    let foreign = directory();
    let file = foreign.path().join("result.h5");
    fs::copy(path.join("result.h5"), &file).unwrap();
    change_hdf5(&file, |file| {
        let axis = file.dataset("axis/x")?;
        axis.new_attr::<u64>().create("degree")?.write_scalar(&u64::MAX)
    })
    .unwrap();
    let file = format!("initial.field={}", file.display());
    let job = run("example1.toml").set(&small).set(&[&file, start, "time.end=0.5"]);
    job.into(place.path()).is_refused(&["degree along x: 18446744073709551615 there"]).unwrap();
    // A checkpoint counts, not a directory of this name.
    let checkpoint = path.join("checkpoint/000001");
    fs::create_dir_all(&checkpoint).unwrap();
    fs::write(checkpoint.join("manifest.json"), "{}").unwrap();
    on(path, 0.5).is_refused(&["a run there is not finished"]).unwrap();
}

/// Other commands accept a field to start from. Without -o, the directory of the results has the
/// name of the first one and the end time, which may be a formula of the case's constants.
#[test]
fn other_commands_take_a_field() {
    let first = directory();
    let path = first.path();
    let small = ["axis.0.x.cells=16", "axis.0.v.cells=16", "solver.tolerance=1e-2"];
    let part = path.join("part");
    let settings = ["time.end=0.2", "constants.half=0.5"];
    run("example1.toml").set(&small).set(&settings).solve(&part).unwrap();
    let until = |time: &str| Job::new(["run", "--continue", "part/", "--until", time]).inside(path);
    until("half/2").succeed().unwrap();
    until("half/5").is_refused(&["--until half/5", "at t = 0.2", "a later time"]).unwrap();
    let changed = until("half/2").set(&["constants.half=0.6"]).with(["--force"]);
    changed.is_refused(&["--until half/2", "constants that --set changes"]).unwrap();
    until("halve").is_refused(&["--until halve", "unknown name \"halve\""]).unwrap();
    assert!(path.join("part-until-0.25/summary.json").exists());
    let file = format!("initial.field={}", part.join("result.h5").display());
    let out = path.join("out").display().to_string();
    let rows: [(&str, &[&str]); 5] = [
        ("check", &[]),
        ("plan", &["--calibrate"]),
        ("spectrum", &[]),
        ("resources", &[]),
        ("export-matrix", &["-o", &out]),
    ];
    check_all(&rows, |(command, options)| {
        let job = Job::new([command, case("example1.toml").as_str()]).with(options.iter().copied());
        let job = job.set(&small).set(&[&file, "time.start=0.2", "time.end=0.3"]);
        let finished = job.succeed()?;
        match *command {
            "check" => {
                finished.contains(&finished.output, &["f(0.2) = /f of", "from t = 0.2 to T = 0.3"])
            }
            _ => Ok(()),
        }
    });
}

/// Characteristics of a second part with another inflow would be traced back to time 0 with it. So
/// there is no exact solution in that part, nor in those that follow.
#[test]
fn a_part_with_another_inflow_has_no_exact_solution() {
    let [first, second, third] = [directory(), directory(), directory()];
    let coarse = ["axis.0.x.cells=12", "axis.0.v.cells=10", "solver.method=classical"];
    let job = run("inflow_barrier.toml").set(&coarse).set(&["time.end=0.2"]);
    let before = job.solve(first.path()).unwrap();
    assert!(before.number("error_l1").is_ok());
    let alike = on(first.path(), 0.3).solve(third.path()).unwrap();
    assert!(alike.number("error_l1").is_ok(), "{}", alike.command);
    let job = on(first.path(), 0.3).set(&["inflow.value=0.25"]).into(second.path());
    let finished = job.succeed().unwrap();
    let left_out = "exact left out, as --set inflow.value may change the case";
    assert!(finished.errors.contains(left_out), "{}", finished.errors);
    let other = Summary::read(finished, second.path()).unwrap();
    assert!(other.value["error_l1"].is_null(), "{}", other.command);
    let later = on(second.path(), 0.4).solve(directory().path()).unwrap();
    assert!(later.value["error_l1"].is_null(), "{}", later.command);
}
