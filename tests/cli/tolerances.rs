//! Tolerances are met, and the error estimate is right or marked as unreliable.

use crate::support::{
    INTERFACES, Job, Summary, at_most, check_all, directory, dissipative, distance,
    estimate_is_right_or_silent, field, finite_volumes, meets_its_tolerance, near, parsed, plan,
    refused, run, shrunk, stored_plan, tolerance_is_met, written,
};
use phasewarp::plan::Plan;
use phasewarp::plan::layout::Resources;
use std::sync::atomic::{AtomicUsize, Ordering};

/// The tolerances of all cases.
pub const TOLERANCES: [&str; 4] = ["1e-3", "1e-6", "1e-9", "1e-11"];

/// The settings of a run that measures its error, at a tolerance.
pub fn verifying(interface: &str, tolerance: &str) -> [String; 3] {
    let [interface, tolerance] = [("scheme.interface", interface), ("solver.tolerance", tolerance)]
        .map(|(key, value)| format!("{key}={value}"));
    ["solver.verify=true".to_owned(), interface, tolerance]
}

/// The number of its ranks. Ranks change no bits, so two ranks are used for one tolerance only.
pub fn ranks_at(tolerance: &str) -> usize {
    if tolerance == "1e-6" { 2 } else { 1 }
}

/// The run of a small case with these settings. Tests share it.
pub fn verified(name: &str, interface: &str, tolerance: &str) -> Job {
    let settings = verifying(interface, tolerance);
    let job = run(name).set(shrunk(name)).set(&settings.each_ref().map(String::as_str));
    job.on(ranks_at(tolerance))
}

/// For every case and both interfaces, the tolerance is met, the error estimate is right or marked
/// as unreliable, and all modes keep their norms. The program measures the error (`solver.verify`).
#[test]
fn tolerances_are_met_in_every_case() {
    let mut rows = Vec::new();
    let of_degree_0 = finite_volumes();
    // Two of the tolerances each, by turns.
    for (n, name) in dissipative().into_iter().enumerate() {
        let half = TOLERANCES.into_iter().skip(n % 2).step_by(2);
        rows.extend(half.map(|tolerance| (name.clone(), INTERFACES[0], tolerance)));
        // Only degree 0 has the other law. It is tested with one of the other tolerances.
        if of_degree_0.contains(&name) {
            rows.push((name, INTERFACES[1], TOLERANCES[(n + 1) % 4]));
        }
    }
    check_all(&rows, |(name, interface, tolerance)| {
        meets_its_tolerance(&verified(name, interface, tolerance).summary()?)
    });
}

/// Where a box nearly empties, the error of the field may be larger than that of the profile, as
/// `S` and `K` do not commute.
#[test]
fn tolerances_are_met_in_boxes_that_empty() {
    const TEXT: &str = "[[axis]]\nx = { lower = -1, upper = -0.5, cells = 1, degree = 5 }\n\
        v = { lower = 0.3, upper = 2, cells = 1 }\n[[potential]]\nvalue = \"0\"\n\
        [initial]\nf = \"1\"\n[time]\nend = 1\n[scheme]\ndegree = 1\n\
        [solver]\nverify = true\n";
    let rows: [(&[&str], [&str; 3]); 5] = [
        (&[], ["0.1", "7.36e-4", "1e-6"]),
        (&["time.end=2"], ["1e-3", "1.17e-4", "1e-7"]),
        (&["axis.0.x.degree=3"], ["1e-2", "2.15e-4", "1e-6"]),
        (&["axis.0.x.cells=2"], ["1e-2", "1.17e-4", "1e-6"]),
        (
            &["axis.0.x.degree=1", "axis.0.x.cells=8", "axis.0.v.lower=0"],
            ["0.1", "1.23e-5", "1e-8"],
        ),
    ];
    let rows: Vec<_> =
        rows.iter().flat_map(|row| row.1.map(|tolerance| (row.0, tolerance))).collect();
    check_all(&rows, |(settings, tolerance)| {
        let place = directory();
        let job = Job::new(["run", &written(place.path(), TEXT)?]).set(settings);
        let job = job.set(&[&format!("solver.tolerance={tolerance}")]);
        meets_its_tolerance(&job.summary()?)
    });
}

/// If elements resolve smooth data, nearly all of the state is at the end of the spectrum of `S`.
/// There the part of the error that two readings show is known, and the estimate is right.
#[test]
fn estimates_of_resolved_data_are_right() {
    let beams = ["1e-4", "2e-6", "1e-6", "7e-7", "1e-7", "1e-9"];
    let gaussian = ["1e-3", "1e-4", "1e-5", "1e-6", "1e-8"];
    let beams = beams.map(|tolerance| ("smooth-beams.toml", tolerance));
    let gaussian = gaussian.map(|tolerance| ("unitary_advection.toml", tolerance));
    let rows: Vec<(&str, &str)> = beams.into_iter().chain(gaussian).collect();
    check_all(&rows, |(name, tolerance)| {
        let tolerance = format!("solver.tolerance={tolerance}");
        let set = ["solver.verify=true", "scheme.flux=0.5", &tolerance];
        let summary = run(name).set(&set).summary()?;
        let ratio = summary.number("error_estimate")? / summary.number("error_semidiscrete")?;
        let reliable = summary.value["error_estimate_reliable"] == true;
        summary.require(reliable && (1.0 / 3.0..3.0).contains(&ratio), || {
            format!("the estimate is {ratio} times the error, reliable: {reliable}")
        })
    });
}

/// Without dissipation one mode is the solution, for any tolerance.
#[test]
fn a_unitary_flow_needs_one_mode() {
    check_all(&TOLERANCES, |tolerance| {
        let summary = verified("unitary_advection.toml", INTERFACES[0], tolerance).summary()?;
        summary.require(summary.number("modes")? == 1.0, || "more than one mode".into())?;
        tolerance_is_met(&summary)
    });
}

/// The unitary scheme (central flux of degree 0, closed ends) for a Gaussian at a step has one mode
/// and an error of order 2, while the upwind scheme has order ½ to 1 on these grids. The numbers
/// are those of docs/high-order.md.
#[test]
fn the_unitary_scheme_has_order_2_at_a_step() {
    let error = |cells: usize, scheme: &[&str]| {
        let grid = [format!("axis.0.x.cells={cells}"), format!("axis.0.v.cells={cells}")];
        let grid: Vec<&str> = grid.iter().map(String::as_str).collect();
        let data = "initial.f='exp(-((x + 0.5)^2 + (v - 0.6)^2)/0.02)'";
        let job = run("smooth-beams.toml").set(&["scheme.degree=0", data]).set(&grid).set(scheme);
        let summary = job.summary().unwrap();
        let modes = summary.number("modes").unwrap();
        (summary.number("error_l2_relative").unwrap(), modes)
    };
    let rows = [(64, 0.268, 0.468), (128, 0.078, 0.327), (256, 0.0244, 0.207)];
    for (cells, unitary, upwind) in rows {
        let (found, modes) = error(cells, &["scheme.flux=0", "scheme.ends=closed"]);
        assert_eq!(modes, 1.0, "{cells}");
        assert!((found / unitary - 1.0).abs() < 0.01, "{cells}: {found}");
        let (found, modes) = error(cells, &["scheme.interface=conservative"]);
        assert!(modes > 10.0, "{cells}: {modes}");
        assert!((found / upwind - 1.0).abs() < 0.01, "{cells}: {found}");
    }
    let job = run("inflow_barrier.toml").set(&["scheme.flux=0", "scheme.ends=closed"]);
    job.is_refused(&["scheme.ends", "inflow.value", "open"]).unwrap();
}

/// In every case, Krylov meets the tolerance, and one of the implicit methods has the error that it
/// reports, with a warning if it is above the tolerance, also if the ranks split space.
#[test]
fn every_propagator_runs_in_every_case() {
    let mut rows = Vec::new();
    // A time-dependent inflow does not support these methods.
    let names = dissipative().into_iter().filter(|name| name != "pulsed_inflow.toml");
    for (n, name) in names.enumerate() {
        // The implicit methods alternate. Of four runs by Krylov one has two ranks, of four by an
        // implicit method two.
        let (method, steps) = [("crank-nicolson", 30.0), ("backward-euler", 60.0)][n % 2];
        rows.push((name.clone(), "krylov", "1e-6", None, if n % 4 == 0 { 2 } else { 1 }));
        rows.push((name, method, "1e-2", Some(steps), if n % 4 > 1 { 2 } else { 1 }));
    }
    check_all(&rows, |(name, method, tolerance, steps, ranks)| {
        let mut job = run(name).on(*ranks).set(&[
            "solver.verify=true",
            &format!("solver.propagator.method={method}"),
            &format!("solver.tolerance={tolerance}"),
        ]);
        // Grids small enough to be quick.
        job = job.set(shrunk(name));
        if ["example1", "slope", "step_up", "well"].iter().any(|n| name.starts_with(n)) {
            job = job.set(&["axis.0.x.cells=48", "axis.0.v.cells=40"]);
        }
        let Some(steps) = steps else { return meets_its_tolerance(&job.summary()?) };
        let end = parsed(name, shrunk(name))?.end;
        let step = format!("solver.propagator.step={}", end / steps);
        let summary = job.set(&[&step]).summary()?;
        estimate_is_right_or_silent(&summary, 3.0)?;
        // The warning compares the whole error estimate with the tolerance, and names it.
        let [whole, part] = ["error_estimate", "step_error"].map(|key| summary.number(key));
        let (whole, part) = (whole?, part?);
        let named = format!("solver.propagator.step: the error estimate {whole:.1e} is above");
        let warned = summary.warnings().contains(&named);
        let above = whole > summary.number("tolerance")?;
        summary.require(warned == above && part <= whole, || {
            format!("error_estimate {whole:e}, step_error {part:e}, warned: {warned}")
        })?;
        let (solves, modes) = (summary.number("solves")?, summary.number("modes")?);
        let fields = summary.value["fields"].as_array().map_or(0, Vec::len) as f64;
        summary.require(solves == steps * modes * fields, || format!("{solves} solves"))?;
        let kept = summary.number("norm_kept")?;
        if *method == "crank-nicolson" {
            let defect = summary.number("unitarity_defect")?;
            summary.require(defect <= 1.0 && (kept - 1.0).abs() < 1e-11, || {
                format!("norm kept {kept}, unitarity_defect {defect}")
            })
        } else {
            let silent = summary.value["unitarity_defect"].is_null();
            summary.require(silent && kept < 0.999, || format!("norm kept {kept}"))
        }
    });
}

/// The error of implicit steps counts those of all legs between output times, also where the steps
/// of the last leg are shorter. The step that the warning names meets the tolerance.
#[test]
fn implicit_steps_of_all_legs_are_counted() {
    let solved = |step: &str| {
        let step = format!("solver.propagator={{method='crank-nicolson',step={step}}}");
        let small = ["axis.0.x.cells=16", "axis.0.v.cells=16", "output.moment_times=[0.97]"];
        let job = run("example1.toml").set(&small).set(&[&step]);
        job.set(&["solver.tolerance=1e-4", "solver.verify=true"]).summary().unwrap()
    };
    let measured = |summary: &Summary| summary.number("error_semidiscrete").unwrap();
    let long = solved("0.06");
    let ratio = long.number("error_estimate").unwrap() / measured(&long);
    assert!((0.7..1.5).contains(&ratio), "{ratio}");
    let warnings = long.warnings();
    let named = warnings.split_once(" would meet it").and_then(|(text, _)| text.rsplit(' ').next());
    let short = solved(named.unwrap_or_else(|| panic!("{warnings}")));
    short.holds(at_most("error", measured(&short), 1e-4)).unwrap();
}

/// The distance between the files of two runs on different numbers of ranks, computed here and not
/// by the program, is within the tolerance.
#[test]
fn distance_between_files_is_within_the_tolerance() {
    let rows = [
        ("example1.toml", "hat", 1e-6),
        ("barrier2d.toml", "conservative", 1e-9),
        ("inflow_barrier.toml", "hat", 1e-9),
        ("well.toml", "hat", 1e-11),
        ("step3d.toml", "conservative", 1e-3),
    ];
    check_all(&rows, |&(name, interface, tolerance)| {
        let (warped, exact) = (directory(), directory());
        let interface = format!("scheme.interface={interface}");
        let tolerance_key = format!("solver.tolerance={tolerance:e}");
        let job = run(name).set(&[&interface, &tolerance_key, "solver.verify=true"]);
        let summary = job.on(3).solve(warped.path())?;
        run(name)
            .set(&[
                &interface,
                "solver.method=classical",
                "solver.classical.integrator=exponential",
            ])
            .on(1)
            .solve(exact.path())?;
        let (f, reference) = (field(warped.path())?, field(exact.path())?);
        let found = distance(&f, &reference);
        let close = at_most("distance between the files", found, tolerance)
            .and_then(|()| {
                let printed = summary.number("error_semidiscrete")?;
                near("error_semidiscrete over that distance", printed / found, 1.0, 0.01)
            })
            // Control: the distance is above a thousandth of the tolerance.
            .and_then(|()| match at_most("", found, 1e-3 * tolerance) {
                Ok(()) => Err(format!("distance {found:e}: not a run at tolerance {tolerance:e}")),
                Err(_) => Ok(()),
            });
        summary.holds(close)
    });
}

/// Forward Euler and SSP-RK3 converge to the classical exponential, the reference of all errors,
/// with orders 1 and 3.
#[test]
fn classical_integrators_converge_to_the_exponential() {
    let solve = |settings: &[&str]| -> Result<Vec<f64>, String> {
        let place = directory();
        let small = ["solver.method=classical", "axis.0.x.cells=36", "axis.0.v.cells=20"];
        run("well.toml").set(&small).set(settings).solve(place.path())?;
        field(place.path())
    };
    let reference = solve(&[]).unwrap();
    let rows = [("forward-euler", 1.0, 0.05), ("ssp-rk3", 3.0, 0.2)];
    check_all(&rows, |&(integrator, order, cfl)| {
        let error = |cfl: f64| -> Result<f64, String> {
            let f = solve(&[
                &format!("solver.classical.integrator={integrator}"),
                &format!("solver.classical.cfl={cfl}"),
            ])?;
            Ok(distance(&f, &reference))
        };
        let (coarse, fine) = (error(cfl)?, error(cfl / 2.0)?);
        let what = format!("order of {integrator} (errors {coarse:e}, {fine:e})");
        near(&what, (coarse / fine).log2(), order, 0.15)
    });
}

/// Example 1 needs at most as many applications of the matrix as the prototype with the designed
/// profile, which is the planned one, and at most 15 % more with the Gaussian.
#[test]
fn applications_are_at_most_those_of_the_prototype() {
    let rows = [
        ("planned", 64, 1e-6, 1.4e3),
        ("planned", 64, 1e-11, 4.5e3),
        ("planned", 128, 1e-3, 1.8e3),
        ("planned", 128, 1e-9, 6.9e3),
        ("gaussian", 64, 1e-11, 1.15 * 16.6e3),
        ("gaussian", 128, 1e-3, 1.15 * 7.4e3),
    ];
    check_all(&rows, |&(profile, cells, tolerance, prototype)| {
        let place = directory();
        let summary = run("example1.toml")
            .on(2)
            .set(&[
                &format!("axis.0.x.cells={cells}"),
                &format!("axis.0.v.cells={cells}"),
                &format!("solver.tolerance={tolerance:e}"),
                &format!("solver.warp.profile={profile}"),
                "solver.verify=true",
            ])
            .solve(place.path())?;
        meets_its_tolerance(&summary)?;
        let done = summary.number("matvecs")?;
        summary.holds(at_most("matvecs", done, prototype))?;
        // The applications agree with the plan.
        let plan = stored_plan(place.path().join("result.h5"))?;
        let planned = plan["warp"]["applications"].as_f64();
        summary.require(planned == Some(done), || {
            format!("matvecs {done}, but /plan in result.h5 says {planned:?}")
        })
    });
}

/// For very short times and very small tolerances, the tolerance is met, and the error estimate is
/// right or marked as unreliable.
#[test]
fn estimates_at_extreme_settings_are_right_or_unreliable() {
    let small = ["axis.0.x.cells=32", "axis.0.v.cells=32"];
    let gaussian = "solver.warp.profile=gaussian";
    let rows: [(&str, &[&str]); 9] = [
        ("example1.toml", &["time.end=0.001"]),
        ("example1.toml", &["time.end=1e-10", "solver.tolerance=1e-2"]),
        ("example1.toml", &["time.end=0.01", "solver.tolerance=1e-9"]),
        ("example1.toml", &["solver.tolerance=2e-14"]),
        ("example1.toml", &["solver.tolerance=1e-12"]),
        ("slope_jump.toml", &["time.end=10", "solver.tolerance=0.1"]),
        // Both readings have the same error, and their difference shows that of the truncated
        // series.
        ("inflow_barrier.toml", &["time.end=0.2", gaussian, "solver.tolerance=3e-12"]),
        ("inflow_barrier.toml", &["time.end=0.05", gaussian, "solver.tolerance=1e-11"]),
        ("example1.toml", &["time.end=0.05", gaussian, "solver.tolerance=6e-12"]),
    ];
    check_all(&rows, |(name, settings)| {
        let job = run(name).set(&small).set(settings).set(&["solver.verify=true"]);
        let summary = job.summary()?;
        tolerance_is_met(&summary)?;
        estimate_is_right_or_silent(&summary, 3.0)
    });
}

/// Thousands of stages of a time-dependent inflow have no more round-off than one exponential:
/// tolerances are met down to 1e-11, and the error estimate is right.
#[test]
fn many_stages_in_time_do_not_add_round_off() {
    let wave = "inflow.value='0.5 + 0.5*cos(t*3)'";
    let [x, v, end] = ["axis.0.x.cells=24", "axis.0.v.cells=26", "time.end=4.8"];
    let rows: [(&[&str], f64); 3] = [
        (&["solver.tolerance=1e-10"], 1000.0),
        (&["solver.tolerance=1e-11", wave, x, v, end], 4000.0),
        (&["solver.tolerance=1e-8", "inflow.value='exp(-vx^2)*(1 + 0.2*sin(9*t))'"], 500.0),
    ];
    check_all(&rows, |(settings, steps)| {
        let job = run("pulsed_inflow.toml").set(settings).set(&["solver.verify=true"]);
        let summary = job.summary()?;
        let found = summary.number("time_steps")?;
        summary.require(found > *steps, || format!("{found} steps"))?;
        tolerance_is_met(&summary)?;
        let [error, estimate] =
            ["error_semidiscrete", "error_estimate"].map(|key| summary.number(key));
        let ratio = estimate? / error?;
        summary
            .require((0.33..3.0).contains(&ratio), || format!("estimate {ratio} times the error"))
    });
}

/// With inflow that depends on time, nearly all estimates are called reliable, and those are right:
/// two readings show the whole error, but for round-off and for the stages in time.
#[test]
fn estimates_with_inflow_in_time_are_mostly_reliable() {
    const RELIABLE: usize = 22;
    let pulses = ["exp(-((t - 0.3)/0.2)^2)", "0.5 + 0.5*cos(3*t)", "exp(-vx^2)*(1 + 0.2*sin(9*t))"];
    let mut rows = Vec::new();
    for pulse in pulses {
        for end in ["0.1", "1"] {
            rows.extend(["1e-3", "1e-5", "1e-7", "1e-9"].map(|tolerance| [pulse, end, tolerance]));
        }
    }
    let reliable = AtomicUsize::new(0);
    check_all(&rows, |[pulse, end, tolerance]| {
        let grid = ["axis.0.x.cells=20", "axis.0.v.cells=14", "solver.verify=true"];
        let summary = run("pulsed_inflow.toml")
            .set(&grid)
            .set(&[&format!("inflow.value='{pulse}'"), &format!("time.end={end}")])
            .set(&[&format!("solver.tolerance={tolerance}")])
            .summary()?;
        tolerance_is_met(&summary)?;
        estimate_is_right_or_silent(&summary, 3.0)?;
        let is_reliable = summary.boolean("error_estimate_reliable")?;
        reliable.fetch_add(usize::from(is_reliable), Ordering::Relaxed);
        Ok(())
    });
    let reliable = reliable.into_inner();
    assert!(reliable >= RELIABLE, "only {reliable} of {} estimates are reliable", rows.len());
}

/// Without transport, the rate and the spectrum are zero, and the field does not change.
#[test]
fn particles_of_velocity_zero_do_not_move() {
    let rows = INTERFACES.map(|interface| format!("scheme.interface={interface}"));
    check_all(&rows, |interface| {
        let place = directory();
        let job = run("step_up.toml").set(&[
            "axis.0.v.lower=-1", "axis.0.v.upper=1", "axis.0.v.cells=1", "initial.f=1 + x^2",
            interface,
        ]);
        let summary = job.solve(place.path())?;
        let f = field(place.path())?;
        let cells = f.len() as f64;
        let expected: Vec<f64> =
            (0..f.len()).map(|i| 1.0 + (-1.5 + 3.0 * (i as f64 + 0.5) / cells).powi(2)).collect();
        summary.holds(at_most("distance from f(0)", distance(&f, &expected), 1e-6))
    });
}

/// The smallest tolerance that a message names.
fn named_smallest(message: &str) -> Result<String, String> {
    let words = message.split_whitespace();
    let number = words.skip_while(|w| *w != "than").nth(1).unwrap_or_default().to_owned();
    let is_number = number.parse::<f64>().is_ok_and(|x| x > 1e-15 && x < 1e-9);
    if is_number { Ok(number) } else { Err(format!("no smallest tolerance in: {message}")) }
}

/// The smallest tolerance that a refusal names is accepted and met.
#[test]
fn smallest_tolerance_is_accepted_and_met() {
    check_all(&dissipative(), |name| {
        let planned = |tolerance: &str| {
            let tolerance = format!("solver.tolerance={tolerance}");
            let case = parsed(name, &[shrunk(name), &[&tolerance]].concat())?;
            Plan::new(&case, &Resources { ranks: 1, ..Resources::default() }, 1.0)
                .map_err(|e| e.to_string())
        };
        let Err(message) = planned("1e-15") else { return Err(format!("{name}: accepted")) };
        let number = named_smallest(&message)?;
        planned(&number).map(|_| ()).map_err(|e| format!("{name}: {e}"))
    });
    let small = ["axis.0.x.cells=24", "axis.0.v.cells=20"];
    let job = plan("slope_jump.toml", 1).set(&small).set(&["solver.tolerance=1e-15"]);
    let finished = job.run().unwrap();
    refused(&finished, &["tolerance", "1e-15"]).unwrap();
    let number = named_smallest(&finished.errors).unwrap();
    let summary = run("slope_jump.toml")
        .set(&small)
        .set(&[&format!("solver.tolerance={number}"), "solver.verify=true"])
        .on(2)
        .summary()
        .unwrap();
    let error = summary.number("error_semidiscrete").unwrap();
    at_most(&summary.command, error, number.parse().unwrap()).unwrap();
}

/// Tolerances are met for any number of cells: odd numbers, which have a velocity zero, and single
/// cells.
#[test]
fn any_number_of_cells_is_solved() {
    let mut rows = Vec::new();
    for (k, cells) in [1, 2, 3, 4, 5, 6, 7, 8, 15, 16, 17].into_iter().enumerate() {
        // The interface law acts on velocities: odd and even numbers of them have both laws.
        let interface = INTERFACES[k / 2 % 2];
        rows.push((interface, format!("axis.0.v.cells={cells}"), "axis.0.x.cells=20"));
        let interface = INTERFACES[k % 2];
        rows.push((interface, format!("axis.0.x.cells={cells}"), "axis.0.v.cells=20"));
    }
    check_all(&rows, |(interface, cells, others)| {
        let job = run("step_up.toml").set(&[
            &format!("scheme.interface={interface}"),
            cells,
            others,
            "solver.verify=true",
            "exact={}",
        ]);
        let summary = job.summary()?;
        // On few cells, f may be zero everywhere.
        if summary.number("mass_initial")? == 0.0 {
            let largest = summary.number("maximum")?;
            return summary.require(largest == 0.0, || format!("maximum {largest} without mass"));
        }
        tolerance_is_met(&summary)
    });
}

/// Tolerances are met on numbers of ranks that do not divide the numbers of cells.
#[test]
fn tolerances_are_met_on_5_to_7_ranks() {
    let rows = [("step3d.toml", 5), ("well.toml", 6), ("inflow_barrier.toml", 7)];
    check_all(&rows, |(name, ranks)| {
        let summary = run(name).on(*ranks).set(&["solver.verify=true"]).summary()?;
        let found = summary.number("ranks")?;
        summary.require(found == *ranks as f64, || format!("ranks: {found}"))?;
        meets_its_tolerance(&summary)
    });
}

/// A beam that enters an empty box.
const BEAM: &str = r#"
title = "A beam that is switched"
[[axis]]
x = { lower = 0, upper = 1, cells = 31 }
v = { lower = 0, upper = 2, cells = 19 }
[[potential]]
value = "0"
[initial]
f = "0"
[inflow]
value = "exp(-((v-1)/0.3)^2)"
[time]
end = 0.31
[solver]
tolerance = 1e-4
"#;

/// The classical exponential, which measures the error for `solver.verify`, is exact for an inflow
/// that changes fast, or jumps, in time.
#[test]
fn fast_and_jumping_inflow_is_integrated() {
    let place = directory();
    let file = written(place.path(), BEAM).unwrap();
    let beam = |settings: &[&str]| Job::new(["run", &file, "--force"]).set(settings);
    // 512 periods: 16 on each of the panels to begin with. The modes have steps of their own.
    let wave = "inflow.value=exp(-((v-1)/0.3)^2)*(1 + cos(2*pi*1651*t))";
    let summary = beam(&[wave, "solver.verify=true"]).solve(&place.path().join("wave"));
    let summary = summary.unwrap();
    meets_its_tolerance(&summary).unwrap();
    let [measured, estimated] =
        ["error_semidiscrete", "error_estimate"].map(|key| summary.number(key).unwrap());
    assert!((0.5..2.0).contains(&(estimated / measured)), "{estimated:e}, {measured:e}");

    const CLASSICAL: &str = "solver.method=classical";
    let [first, second, whole] = ["first", "second", "whole"].map(|name| place.path().join(name));
    beam(&[CLASSICAL]).solve(&first).unwrap();
    let path = first.display().to_string();
    let continued = Job::new(["run", "--continue", &path, "--until", "0.5"]);
    continued.set(&["inflow.value=0"]).solve(&second).unwrap();
    let jump = "inflow.value=exp(-((v-1)/0.3)^2) if t < 0.31 else 0";
    beam(&[CLASSICAL, jump, "time.end=0.5"]).on(2).solve(&whole).unwrap();
    let [second, whole] = [second, whole].map(|path| field(&path).unwrap());
    let error = distance(&second, &whole);
    assert!(error < 1e-12, "{error:e}");

    let noise = "inflow.value=1 + cos(1e9*t)";
    let refused = "inflow.value: its integral over time takes more than 16384 panels";
    beam(&[noise, CLASSICAL]).is_refused(&[refused, "from t = ", "ssp-rk3"]).unwrap();
    beam(&[noise, "solver.verify=true"]).is_refused(&[refused, "solver.verify"]).unwrap();
    // Where it is not finite, that is the reason.
    let undefined = ["inflow.value=sqrt(0.2 - t)", CLASSICAL];
    beam(&undefined).is_refused(&["inflow.value", "NaN", "must be finite"]).unwrap();
}
