//! Runs that start from a warped field.

use super::{POINTS, small, warped};
use crate::dense::{self};
use crate::support::{
    Job, Summary, case, check_all, directory, distance, field, of_case, text_of, write_hdf5,
};
use phasewarp::problem::case::Case;
use std::path::Path;

/// A run to T and a second run of length T from its file equal one run to 2T, in the field and in
/// the whole warped field: on other ranks, streamed and full, and with an output time in between.
#[test]
fn a_run_from_a_warped_field_equals_one_longer_run() {
    let tolerances = ["1e-5", "1e-9"];
    check_all(&tolerances, |tolerance| {
        let allowed: f64 = tolerance.parse().map_err(|_| "a tolerance")?;
        let tolerance = format!("solver.tolerance={tolerance}");
        let places = [directory(), directory(), directory(), directory()];
        // Neither weights nor profile depend on the time. The last mode, of which the points show
        // only the real part, is almost zero.
        let same = ["scheme.interface=conservative", "exact={f='0'}"];
        let run = |end: f64| small(&[&tolerance, &format!("time.end={end}")]).set(&same);
        let full = ["--mode", "full"];
        let free = &["solver.warp.profile=smooth", POINTS[0], "solver.warp.points=4800"];
        run(0.5).set(free).with(full).on(3).solve(places[0].path())?;
        let file = places[0].path().join("warped_f.h5");
        let from = format!("initial={{warped='{}'}}", file.display());
        let second = run(0.5).set(&[&from, "solver.warp.recovery=1"]);
        let summary = second.clone().with(full).on(2).solve(places[1].path())?;
        run(1.0)
            .set(free)
            .set(&["solver.warp.recovery=1"])
            .with(full)
            .on(1)
            .solve(places[2].path())?;
        let streamed = second.set(&["output.field_times=[0.2]"]).on(4).solve(places[3].path())?;
        let (found, p) = warped(places[1].path(), "f")?;
        let (expected, other) = warped(places[2].path(), "f")?;
        let moved = p.iter().zip(&other).map(|(a, b)| (a - b).abs()).fold(0.0, f64::max);
        summary.require(p.len() == other.len() && moved < 1e-9, || "points".to_owned())?;
        let off = distance(&found, &expected);
        summary.require(off < 2.0 * allowed, || format!("w is off by {off:e}"))?;
        for place in [&places[1], &places[3]] {
            let off = distance(&field(place.path())?, &field(places[2].path())?);
            summary.require(off < 10.0 * allowed, || format!("f is off by {off:e}"))?;
        }
        let warned = |s: &Summary| s.warnings().contains("initial.warped");
        summary.require(warned(&summary) && warned(&streamed), || "no warning".to_owned())?;
        summary.require(summary.value["mass_initial"].is_null(), || "a mass_initial".to_owned())?;
        summary.require(summary.value["error_estimate"].is_null(), || "an estimate".to_owned())
    });
}

/// The interval of a file contains the recovery point and the plateau around it, so that a run can
/// start from the file: also for narrow Gaussians, whose period is short, and for a recovery point
/// at large p.
#[test]
fn a_run_can_start_from_a_field_of_any_planned_period() {
    let rows: [&[&str]; 5] = [
        &["solver.warp.sigma=0.25"],
        &["solver.warp.sigma=0.5"],
        &["solver.warp.sigma=0.7"],
        &["scheme.flux=0", "scheme.ends=closed", "solver.warp.sigma=0.5"],
        &["solver.warp.sigma=0.5", "solver.warp.shift=20"],
    ];
    // On this coarse grid, the period of a run over half of the time suffices for the whole time.
    let grid = ["axis.0.x.cells=8", "axis.0.v.cells=8", "scheme.interface=conservative"];
    check_all(&rows, |settings| {
        let [first, second, whole] = [directory(), directory(), directory()];
        let run = |end: f64| {
            let end = format!("time.end={end}");
            small(&grid).set(settings).set(&[&end, "solver.tolerance=1e-3"])
        };
        let gaussian = ["solver.warp.profile=gaussian"];
        let begun = run(0.35).set(&gaussian).with(["--mode", "full"]).on(2).solve(first.path())?;
        let (_, p) = warped(first.path(), "f")?;
        let read = begun.value["probabilities"]["recovery"].as_f64().ok_or("no reading")?;
        let holds = p[0] <= read - 2.0 && read + 2.0 <= p[p.len() - 1];
        begun.require(holds, || format!("{read} in {} to {}", p[0], p[p.len() - 1]))?;
        if read > 5.0 {
            // The error of the next run would be e^7 times as large.
            return Ok(());
        }
        let file = first.path().join("warped_f.h5");
        let from = format!("initial={{warped='{}'}}", file.display());
        // The file records the settings of its plan.
        let kept = settings.iter().filter(|s| !s.starts_with("solver.warp"));
        let kept: Vec<&str> = kept.copied().chain(["solver.tolerance=1e-3"]).collect();
        let on = small(&grid).set(&kept).set(&[&from, "time.end=0.35"]);
        on.on(3).solve(second.path())?;
        run(0.7).set(&gaussian).solve(whole.path())?;
        let off = distance(&field(second.path())?, &field(whole.path())?);
        begun.require(off < 3e-3, || format!("f is off by {off:e}"))
    });
}

/// The plan of a run that starts from a file has the points of the file, with and without
/// `--calibrate`.
#[test]
fn plans_of_runs_from_a_file_have_its_points() {
    let place = directory();
    let free = ["solver.warp.profile=smooth", POINTS[0], "solver.warp.points=4800"];
    let end = ["time.end=0.5", "solver.tolerance=1e-5"];
    let first = small(&end).set(&free).with(["--mode", "full"]);
    first.solve(place.path()).unwrap();
    let file = place.path().join("warped_f.h5");
    let from = format!("initial={{warped='{}'}}", file.display());
    let rows: [(usize, &[&str]); 3] =
        [(1, &[]), (2, &["--calibrate"]), (1, &["--calibrate", "--ranks", "2"])];
    check_all(&rows, |(ranks, options)| {
        let plan = of_case("plan", "example1.toml")
            .set(&["axis.0.x.cells=14", "axis.0.v.cells=11", "exact={f='0'}"])
            .set(&[&from, "output.warped_field=true"])
            .set(&end)
            .with(options.iter().copied());
        let finished = plan.on(*ranks).succeed()?;
        let printed = |words: &str| finished.output.contains(words);
        if printed("2401 (l >= 0)") && printed("at 4800 points in p") {
            Ok(())
        } else {
            Err(finished.report("2401 modes, 4800 points expected"))
        }
    });
}

/// The start may be a field that comes from no profile, with a random value at every point and
/// cell. Its norm is kept, and after a negligible time it is unchanged.
#[test]
fn any_field_may_be_the_start() {
    let place = directory();
    let path = place.path().join("start.h5");
    let written = place.path().join("written.h5");
    let (cells, velocities, points) = (7, 6, 50);
    let value = |n: usize| dense::noise(n, 3);
    let values: Vec<f64> = (0..cells * velocities * points).map(value).collect();
    let p: Vec<f64> = (0..points).map(|j| -3.0 + 0.2 * j as f64).collect();
    let case = dense::case("example1.toml", &["axis.0.x.cells=7", "axis.0.v.cells=6"]);
    write_field(&written, &case, &p, &values);
    // A copy: programs that other tests start at the same time inherit the open file and with it
    // the lock of HDF5.
    std::fs::copy(&written, &path).unwrap();
    let run = |end: f64, to: &Path| {
        let from = format!("initial={{warped='{}'}}", path.display());
        let end = format!("time.end={end}");
        let settings = [&from, &end, "solver.tolerance=1e-10", "scheme.interface=conservative"];
        let grid = ["axis.0.x.cells=7", "axis.0.v.cells=6"];
        small(&grid).set(&settings).with(["--mode", "full"]).on(3).solve(to)
    };
    let short = directory();
    run(1e-9, short.path()).unwrap();
    let (found, p) = warped(short.path(), "f").unwrap();
    assert_eq!(p.len(), points);
    let off = distance(&found, &values);
    assert!(off < 1e-6, "{off:e}");
    // Modes keep their norms. So does the field without its mode N_p/2.
    let long = directory();
    run(0.2, long.path()).unwrap();
    let (found, _) = warped(long.path(), "f").unwrap();
    let norm = |w: &[f64]| {
        // The mode N_p/2, which alternates from point to point, is subtracted.
        let line = |line: &[f64]| {
            let alternating: f64 =
                line.iter().enumerate().map(|(j, w)| if j % 2 == 0 { *w } else { -w }).sum::<f64>()
                    / points as f64;
            line.iter()
                .enumerate()
                .map(|(j, w)| (w - if j % 2 == 0 { alternating } else { -alternating }).powi(2))
                .sum::<f64>()
        };
        w.chunks_exact(points).map(line).sum::<f64>().sqrt()
    };
    let (before, after) = (norm(&values), norm(&found));
    assert!((after / before - 1.0).abs() < 1e-9, "{before} {after}");
    assert!(distance(&found, &values) > 0.1, "the field did not change");
}

/// Writes a file that holds `w` on the grid of `case` at the points `p`.
fn write_field(path: &Path, case: &Case, p: &[f64], w: &[f64]) {
    let (x, v) = (case.space.x[0].centres(), case.space.v[0].centres());
    let written = write_hdf5(path, |file| {
        file.create_group("axis")?;
        for (name, values) in [("axis/x", &x[..]), ("axis/vx", &v), ("axis/p", p)] {
            file.new_dataset::<f64>().shape(values.len()).create(name)?.write(values)?;
        }
        let dataset = file.new_dataset::<f64>().shape([x.len(), v.len(), p.len()]);
        dataset.create("w")?.write_raw(w)
    });
    written.unwrap();
}

/// `e^p w` of `e^{−|p|}` is flat at points above 0. With few points, the trigonometric interpolant
/// oscillates between them, and `e^{p◇}` amplifies this. Beyond the last point the field is
/// repeated, so that an interval that is too short is refused, too.
#[test]
fn a_start_that_oscillates_between_its_points_is_refused() {
    let grid = ["axis.0.x.cells=14", "axis.0.v.cells=11"];
    let case = dense::case("example1.toml", &grid);
    let place = directory();
    let start = |[lower, upper]: [f64; 2], points: usize| {
        // A new file each time: a job that another test starts may hold the lock of the last one.
        let own = directory();
        let (written, path) = (own.path().join("written.h5"), place.path().join("start.h5"));
        let step = (upper - lower) / points as f64;
        let p: Vec<f64> = (0..points).map(|j| lower + step * j as f64).collect();
        let cells = 0..case.space.cells();
        let f = cells.map(|i| {
            let point = case.space.point(&case.space.cell(i));
            case.fields[0].initial.at_point(&point, 0.0)
        });
        let w: Vec<f64> = f.flat_map(|f| p.iter().map(move |p| f * (-p.abs()).exp())).collect();
        write_field(&written, &case, &p, &w);
        std::fs::copy(&written, &path).unwrap();
        let from = format!("initial={{warped='{}'}}", path.display());
        small(&["time.end=0.5", "solver.tolerance=1e-4"]).set(&[&from])
    };
    let (long, repeated) = ([-12.0, 24.0], "to 4.0000, the field is repeated");
    let rows = [
        (long, 192, 1, ["e-2 of"; 2]),
        (long, 192, 8, ["e0 of"; 2]),
        (long, 768, 8, ["e-1 of"; 2]),
        ([-4.0, 4.0], 512, 1, ["e0 of", repeated]),
    ];
    for (interval, points, recovery, printed) in rows {
        let read = format!("solver.warp.recovery={recovery}");
        let job = start(interval, points).set(&[&read]);
        let refused = job.into(directory().path()).run().unwrap();
        let printed = ["initial.warped", "e^p w varies by", printed[0], printed[1]];
        refused.ended(2, &printed).unwrap();
    }
    let summary = start(long, 6144).set(&["solver.warp.recovery=1"]).on(3).summary().unwrap();
    assert!(!summary.warnings().contains("e^p w varies by"), "{}", summary.warnings());
}

/// Without weights S has positive eigenvalues. Then f at p = 0.01 depends on e^p w below p = 0,
/// where it is not flat.
#[test]
fn a_start_that_is_not_flat_is_refused() {
    let place = directory();
    let short = ["exact={f='0'}", "time.end=0.5", "solver.tolerance=1e-3"];
    let profile = ["solver.warp.profile=exponential", POINTS[0], "solver.warp.points=4800"];
    small(&short).set(&profile).with(["--mode", "full"]).solve(place.path()).unwrap();
    let from = format!("initial={{warped='{}'}}", place.path().join("warped_f.h5").display());
    let start = |settings: &[&str]| {
        let read = ["solver.warp.recovery=0.01", &from];
        small(&short).set(&read).set(settings)
    };
    let grows = "solver.warp.weights=none";
    let refused = start(&[grows]).into(directory().path()).on(3).run().unwrap();
    let wording = ["initial.warped", "e^p w varies by 2.", "solver.warp.recovery"];
    refused.ended(2, &wording).unwrap();
    // A run that only writes w is accepted, and so is one with weights, which does not depend on
    // p < 0. Both print a warning.
    for (settings, most) in [(&[grows, "output.warped_field=true"][..], "e-1 of"), (&[], "e-3 of")]
    {
        let summary = start(settings).summary().unwrap();
        let warnings = summary.warnings();
        assert!(warnings.contains("e^p w varies by") && warnings.contains(most), "{warnings}");
        // What the line about accuracy says of the algorithm does not contradict it.
        let known = summary.value["accuracy"]["algorithm_unknown"].as_str().unwrap_or_default();
        let off = known.split_once("up to ").and_then(|(_, rest)| rest.split_once(" by "));
        assert!(off.is_some_and(|(off, _)| warnings.contains(off)), "{known}: {warnings}");
    }
}

/// Inconsistent settings are refused by key, before the run.
#[test]
fn starts_with_inconsistent_settings_are_refused() {
    let place = directory();
    small(&[]).with(["--mode", "full"]).solve(place.path()).unwrap();
    let file = place.path().join("warped_f.h5").display().to_string();
    let from = format!("initial={{warped='{file}'}}");
    let rows: [(&[&str], &[&str]); 13] = [
        (&["initial={warped=5}"], &["initial.warped", "text"]),
        (&["initial={warped=''}"], &["initial.warped", "path"]),
        (&["initial={warped='no.h5'}"], &["initial.warped", "no.h5", "No such file"]),
        (&["initial={warped='../README.md'}"], &["initial.warped", "README.md"]),
        (&[&format!("initial.warped='{file}'")], &["initial.f", "either initial.warped"]),
        (&[&from, "axis.0.x.cells=13"], &["initial.warped", "[14, 11", "[13, 11]"]),
        (&[&from, "axis.0.v.upper=1.6"], &["initial.warped", "/axis/vx", "1.6"]),
        (&[&from, "inflow.value=1"], &["initial.warped", "nothing may enter"]),
        (&[&from, "solver.method=classical"], &["initial.warped", "schrodingerized"]),
        (&[&from, "exact={kind='characteristics'}"], &["initial.warped", "exact.f"]),
        (&[&from, "solver.verify=true"], &["solver.verify", "initial.warped"]),
        (&[&from, "solver.warp.points=64"], &["solver.warp.points", "initial.warped"]),
        (&[&from, "solver.warp.recovery=250"], &["solver.warp.recovery", "250", "points"]),
    ];
    // Two of them on two ranks.
    let rows: Vec<_> = rows.iter().enumerate().collect();
    check_all(&rows, |(k, (settings, wording))| {
        let ranks = if k % 6 == 5 { 2 } else { 1 };
        small(settings).into(directory().path()).on(ranks).is_refused(wording)
    });
    // A relative path counts from the directory of the case file, not from the working directory.
    let home = directory();
    let text = text_of(case("example1.toml")).unwrap();
    std::fs::write(home.path().join("case.toml"), text).unwrap();
    std::fs::copy(&file, home.path().join("start.h5")).unwrap();
    let job = Job::new(["run", &home.path().join("case.toml").display().to_string()]);
    let grid = ["axis.0.x.cells=14", "axis.0.v.cells=11", "exact={f='0'}"];
    job.set(&grid)
        .set(&["initial={warped='start.h5'}", "output.warped_field=true"])
        .solve(home.path())
        .unwrap();
    // Such a run cannot be continued: the message names what to do instead.
    let begun = home.path().display().to_string();
    let job = Job::new(["run", "--continue", &begun, "--until", "9"]).into(directory().path());
    job.is_refused(&["its run began from initial.warped", "--set time.end=9"]).unwrap();
    // `check` and `plan` read the file as well.
    for command in ["plan", "check"] {
        let job = of_case(command, "example1.toml").set(&grid);
        job.clone().set(&[&from]).succeed().unwrap();
        let job = job.set(&["initial={warped='no.h5'}"]);
        job.is_refused(&["initial.warped"]).unwrap();
    }
}
