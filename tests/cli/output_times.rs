//! Fields and moments before the end equal those of shorter runs.

use crate::random_cases::check_scenes;
use crate::reduce::{THREE_METHODS, scene};
use crate::support::{
    Job, at_most, check_all, datasets, directory, distance, near, number, parsed, require, run,
    text_of, tolerance_is_met, written,
};

/// Fields and moments at output times equal those of runs that end at these times, by modes and by
/// the classical method. The moments are the same with and without the fields.
#[test]
fn results_before_the_end_equal_those_of_shorter_runs() {
    let grid = ["axis.0.x.cells=40", "axis.0.v.cells=33"];
    let measure = ["axis.0.x.cells=7", "axis.1.x.cells=6", "axis.0.v.cells=5", "axis.1.v.cells=6"];
    let modes = ["solver.tolerance=1e-7"];
    let classical = ["solver.method=classical"];
    let elements =
        ["axis.0.x.cells=10", "axis.0.v.cells=6", "scheme.degree=2", "axis.0.v.degree=3"];
    let rows = [
        ("smooth-beams.toml", &elements[..], &modes[..], 0.36),
        ("partial_reflection.toml", &elements, &classical, 0.36),
        ("example1.toml", &grid, &classical, 0.36),
        ("inflow_barrier.toml", &grid, &modes, 0.1),
        ("example3.toml", &measure, &modes, 0.1),
        ("example3.toml", &measure, &classical, 0.1),
    ];
    check_all(&rows, |&(name, grid, method, time)| {
        let (long, short) = (directory(), directory());
        let at = format!("output.field_times=[{time}, {}]", 0.5 * time);
        let every = format!("output.moments_every={}", 0.25 * time);
        let job = run(name).set(grid).set(method).set(&["solver.verify=true"]);
        let summary = job.clone().set(&[&at, &every]).on(3).solve(long.path())?;
        let end = format!("time.end={time}");
        job.set(&[&end]).solve(short.path())?;
        let (long, short) = (datasets(long.path())?, datasets(short.path())?);
        let times = long["/axis/time"].numbers();
        let place = times.iter().position(|t| (t - time).abs() < 1e-12);
        let place = place.ok_or_else(|| format!("{time} is not among {times:?}"))?;
        let wanted = place == 3 && long["/axis/field_time"].numbers() == [0.5 * time, time];
        summary.require(wanted, || format!("/time: {times:?}"))?;
        let close = |dataset: &str, k: usize| {
            let all = long[&format!("/history{dataset}")].numbers();
            let one = short[dataset].numbers();
            // Cells without a mean velocity are left out.
            let found: Vec<f64> = all[k * one.len()..(k + 1) * one.len()].to_vec();
            let (found, one): (Vec<f64>, Vec<f64>) =
                (found.into_iter().zip(one)).filter(|(a, b)| !a.is_nan() || !b.is_nan()).unzip();
            at_most(dataset, distance(&found, &one), 2e-6)
        };
        let density = if name == "example3.toml" { ["/phi", "/psi"].as_slice() } else { &["/f"] };
        density.iter().try_for_each(|dataset| close(dataset, 1))?;
        let mut moments = vec!["/density", "/momentum"];
        if short.contains_key("/density_exact") {
            moments.extend(["/density_exact", "/momentum_exact", "/velocity_exact"]);
        }
        let exact = parsed(name, &[]).is_ok_and(|case| case.exact.is_some());
        summary.require(exact == (moments.len() > 2), || format!("{exact}: {moments:?}"))?;
        moments.iter().try_for_each(|dataset| close(dataset, 3))?;
        // The last entry of the history is the result at the end.
        let last = times.len() - 1;
        for dataset in moments {
            let (all, end) = (&long[&format!("/history{dataset}")].bytes, &long[dataset].bytes);
            let same = all[last * end.len()..] == end[..];
            summary.require(same, || format!("the last of /history{dataset} is not {dataset}"))?;
        }
        let mass = long["/history/mass"].numbers();
        near("mass", mass[last], summary.number("mass")?, 1e-15)
    });
}

/// The same for random scenes, cells and elements mixed by axis, by three methods.
#[test]
fn random_fields_before_the_end_equal_those_of_shorter_runs() {
    check_scenes(12, 0.5, |choices| {
        let text = scene(choices);
        let place = directory();
        let path = written(place.path(), &text)?;
        let time = choices.of(&[0.02, 0.05, 0.0777]);
        let method = choices.of(&THREE_METHODS);
        let job = Job::new(["run", &path]).set(&[method]);
        let agree = fields_agree(&job, time, choices.of(&[1, 2, 3]));
        agree.map_err(|e| format!("{e}\n  of {method}, {time}:\n{text}"))
    });
}

/// Checks that the field of a run at `time` is that of a run that ends there. Returns whether these
/// are not refused.
fn fields_agree(job: &Job, time: f64, ranks: usize) -> Result<bool, String> {
    let (long, short) = (directory(), directory());
    let until = job.clone().set(&[&format!("time.end={time}"), "output.moment_times=[]"]);
    let until = until.into(short.path()).run()?;
    if until.code == Some(2) {
        return Ok(false);
    }
    require(until.code == Some(0), &until, || "neither solved nor refused".into())?;
    job.clone().set(&[&format!("output.field_times=[{time}]")]).on(ranks).solve(long.path())?;
    let (long, short) = (datasets(long.path())?, datasets(short.path())?);
    let times = long["/axis/time"].numbers();
    let place = times.iter().position(|t| (t - time).abs() < 1e-12);
    let place = place.ok_or_else(|| format!("{time} is not among {times:?}"))?;
    for (history, dataset, k) in [("/history/f", "/f", 0), ("/history/density", "/density", place)]
    {
        let (all, one) = (long[history].numbers(), short[dataset].numbers());
        let found = &all[k * one.len()..(k + 1) * one.len()];
        let same = one.iter().all(|x| *x == 0.0) && found.iter().all(|x| *x == 0.0);
        let apart = if same { 0.0 } else { distance(found, &one) };
        at_most(dataset, apart, 3e-7)?;
    }
    Ok(true)
}

/// `solver.verify` compares the fields at each output time with the exact ones at that time. The
/// start may be among the output times.
#[test]
fn the_error_is_that_of_fields_at_their_own_times() {
    let (modes, classical) = ("solver.tolerance=1e-6", "solver.method=classical");
    let rows: [(&[&str], &str); 4] = [
        (&["output.fields_every=0.25"], modes),
        (&["output.fields_every=0.25"], classical),
        (&["output.field_times=[0]"], classical),
        (&["output.moment_times=[0]", "output.field_times=[0.3]"], modes),
    ];
    check_all(&rows, |(at, method)| {
        let (first, second) = (directory(), directory());
        let grid = ["axis.0.x.cells=23", "axis.0.v.cells=18", "solver.verify=true", method];
        let job = run("example1.toml").set(&grid).set(at);
        tolerance_is_met(&job.on(2).solve(first.path())?)?;
        // A later part, whose start is at another time.
        let from = first.path().display().to_string();
        let later = Job::new(["run", "--continue", &from, "--until", "1.75"]);
        let later = later.set(&["output.fields_every=0.25"]).solve(second.path())?;
        tolerance_is_met(&later)?;
        let total = number(&later.value["continued"]["error_total"]);
        later.require(total <= 1e-4, || format!("error_total {total:e}"))
    });
}

/// With `exact.moments = "end"` exact moments are left out before the end, and all else is the
/// same: other datasets, errors, and views for ParaView of the datasets that are there.
#[test]
fn exact_moments_before_the_end_can_be_left_out() {
    let rows: [(&str, &[&str]); 3] = [
        ("example1.toml", &["axis.0.x.cells=20", "axis.0.v.cells=18"]),
        ("example2.toml", &["axis.0.x.cells=16", "axis.0.v.cells=16"]),
        ("barrier2d.toml", &["solver.tolerance=1e-3", "exact.kind='characteristics'"]),
    ];
    check_all(&rows, |(name, settings)| {
        let (all, end) = (directory(), directory());
        let job = run(name).set(settings).set(&["output.moment_times=[0.02, 0.05]"]);
        let with = job.clone().solve(all.path())?;
        let without = job.set(&["exact.moments=end"]).on(2).solve(end.path())?;
        let (more, less) = (datasets(all.path())?, datasets(end.path())?);
        let exact = |name: &String| name.contains("history/") && name.ends_with("_exact");
        let left_out: Vec<&String> = more.keys().filter(|name| !less.contains_key(*name)).collect();
        let history: Vec<&String> = more.keys().filter(|name| exact(name)).collect();
        without.require(history.len() >= 3 && left_out == history, || format!("{left_out:?}"))?;
        without.require(less.keys().all(|name| more.contains_key(name)), || "more".to_owned())?;
        let texts = ["/case", "/plan"];
        for (name, dataset) in less.iter().filter(|(name, _)| !texts.contains(&name.as_str())) {
            without.require(dataset.bytes == more[name].bytes, || format!("{name} differs"))?;
        }
        for key in ["error_density_l1", "mass_exact"] {
            let (here, there) = (without.number(key)?, with.number(key)?);
            without.require(here == there, || format!("{key}: {here}, {there}"))?;
        }
        // Three times with a density, one with an exact density.
        let text = text_of(end.path().join("space.xdmf"))?;
        let counts = ["\"density\"", "\"density_exact\""].map(|name| text.matches(name).count());
        without.require(counts == [3, 1], || format!("{counts:?} views in space.xdmf"))
    });
}

/// The exact moments are integrals over the velocities, also for elements. At the start they are
/// close to the moments of the run, and at the end they do not depend on earlier output times.
#[test]
fn exact_moments_are_integrals_over_the_velocities() {
    const ELEMENTS: &[&str] = &["scheme.degree=2", "axis.0.x.cells=10", "axis.0.v.cells=8"];
    const CELLS: &[&str] = &["axis.0.x.cells=26", "axis.0.v.cells=24"];
    for settings in [CELLS, ELEMENTS] {
        let (with, without) = (directory(), directory());
        let job = run("example1.toml").set(settings);
        let times = "output.moment_times=[0, 0.5]";
        job.clone().set(&[times]).on(2).solve(with.path()).unwrap();
        job.solve(without.path()).unwrap();
        let (with, without) = (datasets(with.path()).unwrap(), datasets(without.path()).unwrap());
        for name in ["/density_exact", "/momentum_exact", "/velocity_exact"] {
            assert_eq!(with[name].bytes, without[name].bytes, "{name}");
        }
        // f(0) is 1 in two quarters of a disc, so that its density is √(1 − x²), at nodes or
        // averaged over cells. The mass is the same at the end, as nothing enters or leaves.
        let (x, density) = (with["/axis/x"].numbers(), with["/density_exact"].numbers());
        let half = 1.5 / x.len() as f64;
        let nodal = with.contains_key("/axis/weights_x");
        let area = |x: f64| 0.5 * (x * (1.0 - x * x).sqrt() + x.asin());
        let at_start = with["/history/density_exact"].numbers();
        for (x, found) in x.iter().zip(&at_start).filter(|(x, _)| x.abs() < 0.9) {
            let expected = if nodal {
                (1.0 - x * x).sqrt()
            } else {
                (area(x + half) - area(x - half)) / (2.0 * half)
            };
            assert!((found - expected).abs() < 1e-3, "{x}: {found} {expected}");
        }
        let weights = match with.get("/axis/weights_x") {
            Some(weights) => weights.numbers(),
            None => vec![2.0 * half; x.len()],
        };
        let mass: f64 = density.iter().zip(&weights).map(|(rho, weight)| rho * weight).sum();
        assert!((mass / (0.5 * std::f64::consts::PI) - 1.0).abs() < 1e-2, "{mass}");
        let cells = density.len();
        let [found, exact] =
            ["/history/density", "/history/density_exact"].map(|name| with[name].numbers());
        assert_eq!(exact.len(), 3 * cells);
        let off = distance(&found[..cells], &exact[..cells]);
        assert!(off < 0.2, "density at the start: {off}");
        assert_ne!(exact[..cells], exact[cells..2 * cells]);
    }
}

/// Moments without fields equal those of fields at the same times up to round-off. The fields at
/// the end agree to the tolerance; they differ because only fields divide the run into legs.
#[test]
fn moments_without_fields_equal_those_of_fields() {
    let (alone, with) = (directory(), directory());
    let job = run("barrier2d.toml")
        .set(&["axis.0.x.cells=9", "axis.1.v.cells=7", "solver.tolerance=1e-8"]);
    job.clone().set(&["output.moment_times=[0.1, 0.2]"]).solve(alone.path()).unwrap();
    job.set(&["output.field_times=[0.1, 0.2]"]).on(2).solve(with.path()).unwrap();
    let (alone, with) = (datasets(alone.path()).unwrap(), datasets(with.path()).unwrap());
    assert!(!alone.contains_key("/history/f") && with.contains_key("/history/f"));
    for name in ["density", "momentum", "mass", "kinetic_energy"] {
        let [a, b] = [&alone, &with].map(|all| all[&format!("/history/{name}")].numbers());
        let off = distance(&a, &b);
        // Round-off of the sums over velocities, amplified by the recovery.
        assert!(off < 1e-9, "{name}: {off:e}");
    }
    // Each run differs from the semi-discrete solution by at most its tolerance.
    let off = distance(&alone["/f"].numbers(), &with["/f"].numbers());
    assert!(off < 2e-8, "f: {off:e}");
}

/// Moments at many times need no more applications of the matrix than a run without them, or a
/// third more where a box fills, whose field is small soon after the start. They equal the moments
/// of a run that is divided into legs.
#[test]
fn moments_at_many_times_need_few_more_applications() {
    let rows = [
        ("example1.toml", &["solver.tolerance=1e-9"][..], 100, 1.05),
        ("inflow_barrier.toml", &[], 100, 1.3),
        ("barrier2d.toml", &["axis.0.x.cells=9", "axis.1.v.cells=7"], 20, 1.05),
        (
            "smooth-beams.toml",
            &["axis.0.x.cells=10", "axis.0.v.cells=6", "scheme.degree=2"],
            20,
            1.05,
        ),
    ];
    check_all(&rows, |&(name, settings, times, most)| {
        let (many, legs) = (directory(), directory());
        let job = run(name).set(settings).set(&["time.end=0.5", "exact={}"]);
        let every = format!("output.moments_every={}", 0.5 / f64::from(times));
        let first = job.summary()?;
        let summary = job.clone().set(&[&every]).on(2).solve(many.path())?;
        let [few, all] = [&first, &summary].map(|summary| summary.number("matvecs"));
        let (few, all) = (few?, all?);
        summary.require(all <= most * few, || format!("{all} applications, {few}"))?;
        // A field at each of two times in the middle: three legs.
        let fields = "output.field_times=[0.2, 0.3]";
        job.set(&[&every, fields]).solve(legs.path())?;
        let (many, legs) = (datasets(many.path())?, datasets(legs.path())?);
        ["density", "momentum", "mass", "kinetic_energy"].iter().try_for_each(|dataset| {
            let name = format!("/history/{dataset}");
            at_most(dataset, distance(&many[&name].numbers(), &legs[&name].numbers()), 2e-6)
        })
    });
}

/// The output at time 0 consists of the initial data, and fields follow at every multiple of
/// `output.fields_every`.
#[test]
fn the_output_at_time_0_is_the_initial_data() {
    const F: &str = "exp(-8*x^2 - 9*(v - 0.3)^2)";
    let data = format!("initial.f={F}");
    let exact = format!("exact={{ f = \"{F}\" }}");
    let grid = ["axis.0.x.cells=24", "axis.0.v.cells=20", "time.end=0.1", "solver.tolerance=1e-4"];
    let rows: [(&[&str], &[f64], &[f64]); 4] = [
        (&["output.field_times=[0, 0.05]"], &[0.0, 0.05, 0.1], &[0.0, 0.05]),
        (&["output.fields_every=0.04"], &[0.0, 0.04, 0.08, 0.1], &[0.0, 0.04, 0.08]),
        (&["output.moment_times=[0]", "output.field_times=[0.05]"], &[0.0, 0.05, 0.1], &[0.05]),
        (&["output.fields_every=0.05", "solver.method=classical"], &[0.0, 0.05, 0.1], &[0.0, 0.05]),
    ];
    check_all(&rows, |(settings, times, with_fields)| {
        let place = directory();
        let job = run("example1.toml").set(&grid).set(&[&data, &exact]).set(settings).on(2);
        let summary = job.solve(place.path())?;
        let stored = datasets(place.path())?;
        let near_all = |name: &str, expected: &[f64]| {
            let found = stored[name].numbers();
            let same = found.len() == expected.len() && distance(&found, expected) < 1e-12;
            summary.require(same, || format!("{name}: {found:?}"))
        };
        near_all("/axis/time", times)?;
        near_all("/axis/field_time", with_fields)?;
        let fields = &stored["/history/f"].bytes;
        let start = stored["/exact"].bytes == fields[..stored["/f"].bytes.len()];
        summary.require(start == (with_fields[0] == 0.0), || "f at the start".to_owned())?;
        let ledger = &summary.value["ledger"];
        for (name, group, key) in [
            ("mass", "mass", "initial"),
            ("kinetic_energy", "energy", "kinetic_initial"),
            ("potential_energy", "energy", "potential_initial"),
        ] {
            let first = stored[&format!("/history/{name}")].numbers()[0];
            let expected = number(&ledger[group][key]);
            near(name, first, expected, 1e-14)?;
        }
        Ok(())
    });
}
