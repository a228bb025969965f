//! The program from outside: started as a user starts it, alone and under mpirun, on the cases of `cases/`, changed by
//! `--set`.

#[path = "support/launch.rs"]
mod launch;
#[path = "support/results.rs"]
mod results;

use launch::{Finished, Job, Summary, case, cases, check_all, directory, shrunk};
use phasewarp::case::Case;
use results::{datasets, differences, distance, field};
use std::collections::BTreeMap;
use std::path::{Path, PathBuf};

/// What a run with slopes needs.
const SLOPES: [&str; 2] = [
    "solver.method=classical",
    "solver.classical.integrator=ssp-rk3",
];
const INTERFACES: [&str; 2] = ["hat", "conservative"];
const TOLERANCES: [&str; 4] = ["1e-3", "1e-6", "1e-9", "1e-11"];
/// Slower than this is no answer to bad input; mpirun itself takes one to two seconds to end a job that failed.
const SECONDS_TO_REFUSE: f64 = 10.0;
/// Longer than this is no message.
const LONGEST_MESSAGE: usize = 2000;

fn run(name: &str) -> Job {
    Job::new(["run", &case(name)])
}

fn check(name: &str) -> Job {
    Job::new(["check", &case(name)])
}

fn plan(name: &str, ranks: usize) -> Job {
    Job::new(["plan", &case(name), "--ranks", &ranks.to_string()])
}

fn require(holds: bool, finished: &Finished, what: impl FnOnce() -> String) -> Result<(), String> {
    if holds {
        Ok(())
    } else {
        Err(finished.report(&what()))
    }
}

/// `value` is at most `limit`; written so that NaN fails.
fn at_most(what: &str, value: f64, limit: f64) -> Result<(), String> {
    if value <= limit {
        Ok(())
    } else {
        Err(format!("{what} is {value:e}, at most {limit:e} expected"))
    }
}

fn near(what: &str, value: f64, expected: f64, by: f64) -> Result<(), String> {
    if (value - expected).abs() <= by {
        Ok(())
    } else {
        Err(format!("{what} is {value}, {expected} ± {by:e} expected"))
    }
}

// ---------------------------------------------------------------------------------------------------------------------
// Tolerances

/// Every case, both interfaces: the tolerance is met, the estimate is right or says that it cannot tell, every mode is
/// unitary. Measured by the program itself (`solver.verify`).
#[test]
fn tolerances_are_met_in_every_case() {
    let mut rows = Vec::new();
    for name in cases() {
        for interface in INTERFACES {
            for tolerance in TOLERANCES {
                rows.push((name.clone(), interface, tolerance));
            }
        }
    }
    check_all(&rows, |(name, interface, tolerance)| {
        let place = directory();
        let job = run(name).on(2).set(shrunk(name)).set(&[
            "solver.verify=true",
            &format!("scheme.interface={interface}"),
            &format!("solver.tolerance={tolerance}"),
        ]);
        let summary = job.solve(place.path())?;
        meets_its_tolerance(&summary)
    });
}

/// Every case by every other propagator: Krylov meets the tolerance; the implicit methods are as far from the exact solution as
/// the error that they report, say so, and run with split space too.
#[test]
fn every_propagator_runs_in_every_case() {
    let mut rows = Vec::new();
    // What an inflow that varies refuses is tried elsewhere.
    for name in (cases().into_iter()).filter(|name| name != "pulsed_inflow.toml") {
        rows.push((name.clone(), "krylov", "1e-6", None, 2));
        rows.push((name.clone(), "crank-nicolson", "1e-2", Some(30.0), 2));
        rows.push((name.clone(), "backward-euler", "1e-2", Some(60.0), 1));
    }
    check_all(&rows, |(name, method, tolerance, steps, ranks)| {
        let place = directory();
        let mut job = run(name).on(*ranks).set(&[
            "solver.verify=true",
            &format!("solver.propagator.method={method}"),
            &format!("solver.tolerance={tolerance}"),
        ]);
        // Grids small enough to be quick.
        job = job.set(shrunk(name));
        if ["example1", "slope", "step_up", "well"]
            .iter()
            .any(|n| name.starts_with(n))
        {
            job = job.set(&["axis.0.x.cells=48", "axis.0.v.cells=40"]);
        }
        let Some(steps) = steps else {
            return meets_its_tolerance(&job.solve(place.path())?);
        };
        let text = std::fs::read_to_string(case(name)).map_err(|e| e.to_string())?;
        let sooner = shrunk(name).iter();
        let end: f64 = (sooner.filter_map(|s| s.strip_prefix("time.end=")))
            .chain(text.lines().filter_map(|l| l.trim().strip_prefix("end = ")))
            .find_map(|l| l.split_whitespace().next()?.parse().ok())
            .ok_or("no end in the file")?;
        let step = format!("solver.propagator.step={}", end / steps);
        let summary = job.set(&[&step]).solve(place.path())?;
        let (error, estimate) = (
            summary.number("error_semidiscrete")?,
            summary.number("error_estimate")?,
        );
        let told = summary.boolean("error_estimate_reliable")?;
        let ratio = estimate / error;
        summary.require(!told || (1.0 / 3.0..=3.0).contains(&ratio), || {
            format!("error_estimate {estimate:e}, error {error:e}")
        })?;
        let leading = summary.number("step_error")?;
        let warned = summary.value["warnings"]
            .to_string()
            .contains("solver.propagator.step");
        summary.require(warned == (leading > summary.number("tolerance")?), || {
            format!("step_error {leading:e}, warned: {warned}")
        })?;
        let (solves, modes) = (summary.number("solves")?, summary.number("modes")?);
        let fields = summary.value["fields"].as_array().map_or(0, Vec::len) as f64;
        summary.require(solves == steps * modes * fields, || {
            format!("{solves} solves")
        })?;
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

/// What holds for every Schrödingerized run with `solver.verify`.
fn meets_its_tolerance(summary: &Summary) -> Result<(), String> {
    meets_its_tolerance_within(summary, 3.0)
}

/// The same, with an estimate that may be wrong by `factor`.
fn meets_its_tolerance_within(summary: &Summary, factor: f64) -> Result<(), String> {
    let tolerance = summary.number("tolerance")?;
    let error = summary.number("error_semidiscrete")?;
    let outcome = at_most("error_semidiscrete", error, tolerance);
    summary.require(outcome.is_ok(), || outcome.unwrap_err())?;
    let estimate = summary.number("error_estimate")?;
    let reliable = summary.boolean("error_estimate_reliable")?;
    let ratio = estimate / error;
    summary.require(!reliable || (1.0 / factor..=factor).contains(&ratio), || {
        format!("error_estimate {estimate:e} is {ratio:.3} times the true error {error:e}, and called reliable")
    })?;
    let defect = summary.number("unitarity_defect")?;
    summary.require(defect > 0.0 && defect <= 1.0, || {
        format!("unitarity_defect {defect}, above 0 and at most 1 expected")
    })
}

/// Every profile by every reading, on cases that differ: steps, trapped particles, inflow, two dimensions.
#[test]
fn every_profile_and_reading_meets_its_tolerance() {
    const PROFILES: [(&str, &[&str]); 7] = [
        ("planned", &["1e-3", "1e-8"]),
        ("designed", &["1e-2", "1e-6"]),
        ("gaussian", &["1e-3", "1e-8"]),
        ("exponential", &["1e-2"]),
        ("smooth", &["1e-3", "1e-5"]),
        ("low-somma", &["1e-3", "1e-8"]),
        ("acl", &["1e-2"]),
    ];
    const CASES: [(&str, &[&str]); 4] = [
        ("example1.toml", &["axis.0.x.cells=24", "axis.0.v.cells=22"]),
        ("well.toml", &["axis.0.x.cells=20", "axis.0.v.cells=18"]),
        (
            "inflow_barrier.toml",
            &["axis.0.x.cells=20", "axis.0.v.cells=16", "time.end=0.5"],
        ),
        (
            "barrier2d.toml",
            &[
                "axis.0.x.cells=6",
                "axis.1.x.cells=6",
                "axis.0.v.cells=6",
                "axis.1.v.cells=6",
            ],
        ),
    ];
    let mut rows = Vec::new();
    for (case, size) in CASES {
        for (profile, tolerances) in PROFILES {
            for tolerance in tolerances {
                for method in ["point", "integral", "least-squares"] {
                    // A designed series is no function to take samples of.
                    let coefficients = match profile {
                        "designed" => "analytic",
                        _ => ["analytic", "sampled"][rows.len() % 2],
                    };
                    rows.push((case, size, profile, *tolerance, method, coefficients));
                }
            }
        }
    }
    check_all(
        &rows,
        |(case, size, profile, tolerance, method, coefficients)| {
            let place = directory();
            let job = run(case).set(size).set(&[
                "solver.verify=true",
                &format!("solver.tolerance={tolerance}"),
                &format!("solver.warp.profile={profile}"),
                &format!("solver.warp.recovery_method={method}"),
                &format!("solver.warp.coefficients={coefficients}"),
            ]);
            let summary = job.solve(place.path())?;
            let plain = *profile == "gaussian" && *method == "point";
            meets_its_tolerance_within(&summary, if plain { 3.0 } else { 6.0 })
        },
    );
}

/// The orders in `N_p` through the whole recovery: `r + 1` where what is read reaches the corner (`r = 0` for the exponential: the
/// first order that the paper states), one more away from it. The corner is a third of a cell off the grid, as samples
/// are exact on it; in a short time all of the spectrum of `S` stays at the corner, and in a long one only a part
/// of it does, so that the order there is higher.
#[test]
fn points_given_by_hand_converge_with_the_order_of_the_profile() {
    const SHORT: &str = "1e-4";
    const LONG: &str = "0.6";
    let rows: [(&str, &str, &str, &str, usize, f64); 9] = [
        ("exponential", "0", SHORT, "sampled", 512, 1.0),
        ("exponential", "0", SHORT, "analytic", 512, 1.0),
        ("exponential", "1", LONG, "sampled", 512, 2.0),
        ("exponential", "1", LONG, "analytic", 512, 2.0),
        ("smooth/1", "0", SHORT, "sampled", 1024, 2.0),
        ("smooth/2", "0", SHORT, "analytic", 4096, 3.0),
        ("smooth/1", "1", LONG, "analytic", 2048, 3.0),
        ("smooth/2", "0", SHORT, "sampled", 4096, 3.0),
        ("smooth/3", "0", SHORT, "sampled", 4096, 4.0),
    ];
    check_all(
        &rows,
        |&(profile, recovery, end, coefficients, points, expected)| {
            let (name, order) = profile.split_once('/').unwrap_or((profile, ""));
            let period = 48.0;
            let shift = period / (3.0 * points as f64);
            let (lower, upper) = (-0.5 * period - shift, 0.5 * period - shift);
            let error = |points: usize| -> Result<f64, String> {
                let place = directory();
                let mut job = run("example1.toml").set(&[
                    "axis.0.x.cells=16",
                    "axis.0.v.cells=16",
                    "solver.tolerance=1e-9",
                    "solver.verify=true",
                    &format!("time.end={end}"),
                    &format!("solver.warp.interval=[{lower},{upper}]"),
                    &format!("solver.warp.points={points}"),
                    &format!("solver.warp.profile={name}"),
                    &format!("solver.warp.recovery={recovery}"),
                    &format!("solver.warp.coefficients={coefficients}"),
                ]);
                if !order.is_empty() {
                    job = job.set(&[&format!("solver.warp.order={order}")]);
                }
                job.solve(place.path())?.number("error_semidiscrete")
            };
            let (coarse, fine) = (error(points)?, error(4 * points)?);
            let order = (coarse / fine).log(4.0);
            let what = format!(
                "order of {profile} at {recovery}, {coefficients} (errors {coarse:e}, {fine:e})"
            );
            near(&what, order, expected, 0.35)
        },
    );
}

/// An interval too short is refused with ends that will do.
#[test]
fn intervals_too_short_are_refused_with_what_is_needed() {
    let rows = [
        ("gaussian", "analytic", "1e-6"),
        ("gaussian", "sampled", "1e-6"),
        ("exponential", "sampled", "1e-2"),
        ("smooth", "analytic", "1e-4"),
        ("low-somma", "sampled", "1e-6"),
        ("acl", "analytic", "1e-2"),
    ];
    check_all(&rows, |(profile, coefficients, tolerance)| {
        let place = directory();
        let job = |interval: &str| {
            run("example1.toml").set(&[
                "axis.0.x.cells=20",
                "axis.0.v.cells=16",
                "solver.verify=true",
                "solver.reduce={axes=false, velocities=false}",
                &format!("solver.tolerance={tolerance}"),
                &format!("solver.warp.profile={profile}"),
                &format!("solver.warp.coefficients={coefficients}"),
                &format!("solver.warp.interval={interval}"),
            ])
        };
        let finished = job("[-9, 3.5]").into(place.path()).run()?;
        let says = [
            "solver.warp.interval = [-9, 3.5]",
            "too short",
            "length",
            tolerance,
        ];
        refused(&finished, &says)?;
        let named = finished.errors.split("about ").nth(1);
        let ends = named.and_then(|text| text.split(';').next());
        let ends = ends.ok_or_else(|| finished.report("no ends named"))?;
        let summary = job(ends).on(2).solve(place.path())?;
        meets_its_tolerance_within(&summary, 10.0)
    });
}

/// A set-up by hand in the manner of the paper runs, and what it lacks is said before and in the summary.
#[test]
fn what_is_given_by_hand_and_not_enough_is_warned_of() {
    let place = directory();
    let job = run("example1.toml").set(&[
        "axis.0.x.cells=16",
        "axis.0.v.cells=16",
        "solver.tolerance=0.05",
        "solver.warp.weights=none",
        "solver.warp.profile=exponential",
        "solver.warp.coefficients=sampled",
        "solver.warp.interval=[-24,8]",
        "solver.warp.points=32",
        "solver.warp.recovery=0.2",
    ]);
    let finished = job.clone().into(place.path()).succeed().unwrap();
    for words in [
        "recovery = 0.2 is below",
        "points = 32: the modes",
        "points do",
    ] {
        let said = finished.errors.matches(words).count();
        assert_eq!(said, 1, "{words}: {}", finished.errors);
    }
    let summary = job.solve(place.path()).unwrap();
    let warnings = summary.value["warnings"].as_array().map_or(0, Vec::len);
    assert!(warnings >= 2, "{}", summary.value["warnings"]);
}

/// The plateau: flat above where the corner is reached, and not below.
#[test]
fn the_plateau_is_flat_where_the_field_can_be_read() {
    let place = directory();
    let job = run("example1.toml").on(2).set(&[
        "axis.0.x.cells=20",
        "axis.0.v.cells=16",
        "solver.tolerance=1e-3",
        "solver.warp.profile=exponential",
        "output.plateau={ from = -1, to = 3, points = 9 }",
    ]);
    job.solve(place.path()).unwrap();
    let all = datasets(place.path()).unwrap();
    let column = |name: &str| all[&format!("/plateau/{name}")].numbers();
    let (p, distance, norm) = (column("p"), column("distance"), column("norm"));
    for k in 0..9 {
        assert!((p[k] - (-1.0 + 0.5 * k as f64)).abs() < 1e-12, "{p:?}");
        let flat = distance[k] < 5e-3 && (norm[k] / norm[4] - 1.0).abs() < 5e-3;
        assert_eq!(flat, p[k] >= 0.0, "{distance:?} {norm:?}");
    }
    // The plan reads at p = 1, too.
    assert!(distance[4] < 1e-12, "{distance:?}");
}

/// What is written before the end is what runs that end there find, fields and moments, by modes and classically; with the same
/// sums of moments whether the fields are kept or not.
#[test]
fn results_before_the_end_are_those_of_shorter_runs() {
    let grid = ["axis.0.x.cells=40", "axis.0.v.cells=33"];
    let measure = [
        "axis.0.x.cells=7",
        "axis.1.x.cells=6",
        "axis.0.v.cells=5",
        "axis.1.v.cells=6",
    ];
    let modes = ["solver.tolerance=1e-7"];
    let classical = ["solver.method=classical"];
    let rows = [
        ("example1.toml", &grid[..], &modes[..], 0.36),
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
        // Which may be one leg more or less at the end, where the interval divides the time.
        let end = format!("time.end={time}");
        job.set(&[&end]).on(2).solve(short.path())?;
        let (long, short) = (datasets(long.path())?, datasets(short.path())?);
        let times = long["/axis/time"].numbers();
        let place = times.iter().position(|t| (t - time).abs() < 1e-12);
        let place = place.ok_or_else(|| format!("{time} is not among {times:?}"))?;
        let wanted = place == 3 && long["/axis/field_time"].numbers() == [0.5 * time, time];
        summary.require(wanted, || format!("/time: {times:?}"))?;
        let close = |dataset: &str, k: usize| {
            let all = long[&format!("/history{dataset}")].numbers();
            let one = short[dataset].numbers();
            // There is nothing to compare where there is no mean velocity.
            let found: Vec<f64> = all[k * one.len()..(k + 1) * one.len()].to_vec();
            let (found, one): (Vec<f64>, Vec<f64>) = (found.into_iter().zip(one))
                .filter(|(a, b)| !a.is_nan() || !b.is_nan())
                .unzip();
            at_most(dataset, distance(&found, &one), 2e-6)
        };
        let density = if name == "example3.toml" {
            ["/phi", "/psi"].as_slice()
        } else {
            &["/f"]
        };
        density.iter().try_for_each(|dataset| close(dataset, 1))?;
        ["/density", "/momentum"]
            .iter()
            .try_for_each(|dataset| close(dataset, 3))?;
        // The last of the history is the end.
        let last = times.len() - 1;
        for dataset in ["/density", "/momentum"] {
            let (all, end) = (
                &long[&format!("/history{dataset}")].bytes,
                &long[dataset].bytes,
            );
            let same = all[last * end.len()..] == end[..];
            summary.require(same, || {
                format!("the last of /history{dataset} is not {dataset}")
            })?;
        }
        let mass = long["/history/mass"].numbers();
        near("mass", mass[last], summary.number("mass")?, 1e-15)
    });
}

/// Moments alone, and those of fields that are written at the same times, are the same but for round-off; the field at the end is
/// the same to the last bit.
#[test]
fn moments_alone_are_those_of_the_field() {
    let (alone, with) = (directory(), directory());
    let job = run("barrier2d.toml").set(&[
        "axis.0.x.cells=9",
        "axis.1.v.cells=7",
        "solver.tolerance=1e-8",
    ]);
    job.clone()
        .set(&["output.moment_times=[0.1, 0.2]"])
        .on(2)
        .solve(alone.path())
        .unwrap();
    job.set(&["output.field_times=[0.1, 0.2]"])
        .on(3)
        .solve(with.path())
        .unwrap();
    let (alone, with) = (
        datasets(alone.path()).unwrap(),
        datasets(with.path()).unwrap(),
    );
    assert!(!alone.contains_key("/history/f") && with.contains_key("/history/f"));
    for name in ["density", "momentum", "mass", "kinetic_energy"] {
        let [a, b] = [&alone, &with].map(|all| all[&format!("/history/{name}")].numbers());
        let off = distance(&a, &b);
        // Round-off of the sums over velocities, amplified by the recovery.
        assert!(off < 1e-9, "{name}: {off:e}");
    }
    assert_eq!(alone["/f"], with["/f"]);
}

/// Sparsity, queries and qubits of every kind of scene, on any ranks; in every form; what is not known is said and not zero.
#[test]
fn resources_are_counted() {
    let rows = [
        ("example1.toml", 1, 20.0),
        ("slope_jump.toml", 3, 20.0),
        ("inflow_barrier.toml", 2, 21.0),
        ("barrier2d.toml", 4, 21.0),
        ("step3d.toml", 2, 20.0),
        ("example2.toml", 2, 22.0),
    ];
    check_all(&rows, |&(name, ranks, qubits)| {
        let job = |format: &str| Job::new(["resources", &case(name), "--format", format]);
        let read = |format: &str| -> Result<serde_json::Value, String> {
            let finished = job(format).on(ranks).succeed()?;
            serde_json::from_str(&finished.output).map_err(|e| finished.report(&e.to_string()))
        };
        let (record, azure, qref) = (read("json")?, read("azure")?, read("qref")?);
        let alone = job("json").succeed()?;
        // Nothing depends on ranks but round-off of norms, of which there is none.
        let same =
            serde_json::from_str::<serde_json::Value>(&alone.output).ok() == Some(record.clone());
        require(same, &alone, || {
            format!("other than on {ranks} ranks: {record}")
        })?;
        let value = |key: &str| record[key]["value"].as_f64().unwrap_or(f64::NAN);
        let tau = value("nonzeros")
            * value("largest_entry")
            * record["time"].as_f64().unwrap_or(f64::NAN);
        let sensible = (value("tau") / tau - 1.0).abs() < 1e-12
            && value("walk_steps") == 2.0 * value("degree")
            && value("degree") > tau
            && record["t_gates"]["label"] == "unavailable"
            && record["t_gates"]["because"].is_string()
            && azure["logicalCounts"]["tCount"].is_null()
            && azure["unavailable"]["tCount"].is_string()
            && azure["logicalCounts"]["rotationCount"].as_u64()
                == Some(value("walk_steps") as u64 + 1)
            && azure["logicalCounts"]["numQubits"].is_u64()
            && qref["version"] == "v1"
            && qref["program"]["children"]
                .as_array()
                .is_some_and(|c| c.len() == 3);
        require(sensible, &alone, || format!("{record} {azure} {qref}"))?;
        let counted = record["qubits"]["total"].as_f64().unwrap_or(f64::NAN);
        require(counted <= qubits + 8.0 && counted >= 8.0, &alone, || {
            format!("{counted} qubits")
        })?;
        let shares = ["in_p", "field_given_p", "weights_given_field", "all"];
        let chain = &record["probabilities"]["at_slice"];
        let p: Vec<f64> = shares
            .iter()
            .map(|k| chain[*k]["value"].as_f64().unwrap_or(f64::NAN))
            .collect();
        let product = (p[0] * p[1] * p[2] / p[3] - 1.0).abs() < 1e-12;
        require(
            product && p.iter().all(|p| (0.0..=1.0 + 1e-12).contains(p)),
            &alone,
            || format!("{chain}"),
        )?;
        let text = Job::new(["resources", &case(name)]).succeed()?;
        require(
            text.output.contains("unavailable: the oracles"),
            &text,
            || "T gates".to_owned(),
        )
    });
    for (name, settings, words) in [
        (
            "example1.toml",
            "solver.method=classical",
            "no quantum side",
        ),
        (
            "pulsed_inflow.toml",
            "solver.tolerance=1e-4",
            "depends on t",
        ),
        (
            "example1.toml",
            "initial={warped='w.h5'}",
            "a file holds any",
        ),
    ] {
        for more in [None, Some("--optimise")] {
            let job = Job::new(["resources", &case(name)]).with(more);
            let finished = job.set(&[settings, "exact={f='0'}"]).on(2).run().unwrap();
            assert_eq!(finished.code, Some(2), "{}", finished.report("refused"));
            let said = finished.errors.contains(words);
            assert!(said, "{}", finished.report(words));
        }
    }
}

/// The probability of the slice and of the window, and the norm of the field that follows, against the whole warped field of a full run.
#[test]
fn probabilities_are_those_of_the_warped_field() {
    // Neither weights nor inflow: the file holds the state.
    let place = directory();
    let job = run("example1.toml").set(&[
        "axis.0.x.cells=18",
        "axis.0.v.cells=14",
        "scheme.interface=conservative",
        "solver.tolerance=1e-5",
        "solver.warp.profile=smooth",
    ]);
    let summary = job
        .with(["--mode", "full"])
        .on(3)
        .solve(place.path())
        .unwrap();
    let all = results::datasets_of(&place.path().join("warped_f.h5")).unwrap();
    let (w, p) = (all["/w"].numbers(), all["/axis/p"].numbers());
    let found = &summary.value["probabilities"];
    let number = |chain: &str, key: &str| found[chain][key]["value"].as_f64().unwrap();
    assert_eq!(found["points"].as_f64(), Some(p.len() as f64));
    let square = |k: usize| {
        w.iter()
            .skip(k)
            .step_by(p.len())
            .map(|w| w * w)
            .sum::<f64>()
    };
    let whole: f64 = (0..p.len()).map(square).sum();
    let norm = found["norm_of_state"]["value"].as_f64().unwrap();
    assert!(
        (whole.sqrt() / norm - 1.0).abs() < 1e-6,
        "{} {norm}",
        whole.sqrt()
    );
    let [begin, end] = [0, 1].map(|k| found["window"][k].as_f64().unwrap());
    // The points of the file are not at p of the recovery: the slice next to it.
    let k = p.iter().position(|p| *p >= begin).unwrap();
    let slice = square(k) / whole * (2.0 * (p[k] - begin)).exp();
    assert!(
        (slice / number("at_slice", "in_p") - 1.0).abs() < 1e-3,
        "{slice}"
    );
    let inside: f64 = (0..p.len())
        .filter(|&k| p[k] >= begin && p[k] < end)
        .map(square)
        .sum();
    let ratio = inside / whole / number("in_window", "in_p");
    let spacing = p[1] - p[0];
    assert!((ratio.ln()).abs() <= 2.0 * spacing + 1e-3, "{ratio}");
    // The field's norm from the probability alone.
    let f = field(place.path()).unwrap();
    let exact = f.iter().map(|f| f * f).sum::<f64>().sqrt();
    let from = found["norm_of_field"]["value"].as_f64().unwrap();
    assert!((from / exact - 1.0).abs() < 1e-12, "{from} {exact}");
}

/// The distance taken here, between the files of two runs, not by the program; on different numbers of ranks.
#[test]
fn distance_between_files_is_what_was_asked_for() {
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
        let asked = format!("solver.tolerance={tolerance:e}");
        let job = run(name).set(&[&interface, &asked, "solver.verify=true"]);
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
        let outcome = at_most("distance between the files", found, tolerance)
            .and_then(|()| {
                let said = summary.number("error_semidiscrete")?;
                near(
                    "error_semidiscrete over that distance",
                    said / found,
                    1.0,
                    0.01,
                )
            })
            // The comparison can fail: a thousandth of the tolerance is not met.
            .and_then(|()| match at_most("", found, 1e-3 * tolerance) {
                Ok(()) => Err(format!(
                    "distance {found:e}: not a run at tolerance {tolerance:e}"
                )),
                Err(_) => Ok(()),
            });
        summary.require(outcome.is_ok(), || outcome.unwrap_err())
    });
}

/// The reference itself: forward Euler and SSP-RK3 tend to the exponential with orders 1 and 3.
#[test]
fn classical_integrators_converge_to_the_exponential() {
    let solve = |settings: &[&str]| -> Result<Vec<f64>, String> {
        let place = directory();
        run("well.toml")
            .set(&["solver.method=classical"])
            .set(settings)
            .on(2)
            .solve(place.path())?;
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

/// Applications of example 1 stay below those of the prototypes: of the designed profile, which is what is planned, and, at most 15 % above
/// them, of the Gaussian.
#[test]
fn applications_stay_near_the_prototype() {
    let rows = [
        ("planned", 64, 1e-3, 0.8e3),
        ("planned", 64, 1e-6, 1.4e3),
        ("planned", 64, 1e-9, 2.4e3),
        ("planned", 64, 1e-11, 4.5e3),
        ("planned", 128, 1e-3, 1.8e3),
        ("planned", 128, 1e-6, 3.4e3),
        ("planned", 128, 1e-9, 6.9e3),
        ("planned", 128, 1e-11, 15e3),
        ("gaussian", 64, 1e-6, 1.15 * 4.4e3),
        ("gaussian", 64, 1e-11, 1.15 * 16.6e3),
        ("gaussian", 128, 1e-3, 1.15 * 7.4e3),
        ("gaussian", 128, 1e-9, 1.15 * 24.8e3),
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
        let outcome = at_most("matvecs", done, prototype);
        summary.require(outcome.is_ok(), || outcome.unwrap_err())?;
        // Counted as done, and as planned: the two agree.
        let stored = &datasets(place.path())?["/plan"].bytes;
        let text = String::from_utf8_lossy(stored);
        let plan: serde_json::Value =
            serde_json::from_str(text.trim_end_matches('\0')).map_err(|e| format!("/plan: {e}"))?;
        let planned = plan["warp"]["applications"].as_f64();
        summary.require(planned == Some(done), || {
            format!("matvecs {done}, but /plan in result.h5 says {planned:?}")
        })
    });
}

/// The plan tells the whole profile: its coefficients sum up to e^{-p} where the spectrum of ST lies, to within the tolerance.
#[test]
fn the_plan_holds_the_profile() {
    let rows = [
        ("example1.toml", "1e-3"),
        ("example1.toml", "1e-9"),
        ("well.toml", "1e-6"),
    ];
    check_all(&rows, |(name, tolerance)| {
        let job = plan(name, 2).set(&[&format!("solver.tolerance={tolerance}")]);
        let finished = job.with(["--json"]).succeed()?;
        let value: serde_json::Value =
            serde_json::from_str(&finished.output).map_err(|e| finished.report(&e.to_string()))?;
        let number = |path: &str| {
            (value.pointer(path).and_then(serde_json::Value::as_f64))
                .ok_or_else(|| finished.report(&format!("no number at {path}")))
        };
        let series = &value["warp"]["series"];
        let pairs: Vec<[f64; 2]> = serde_json::from_value(series["coefficients"].clone())
            .map_err(|e| finished.report(&format!("warp.series.coefficients: {e}")))?;
        let modes = number("/warp/modes")?;
        require(pairs.len() as f64 == modes, &finished, || {
            format!("{} coefficients, {modes} modes", pairs.len())
        })?;
        let wave = std::f64::consts::TAU / number("/warp/series/period")?;
        let reach = number("/bounds/decay")? * number("/time")?;
        let point = number("/warp/readings/0/point")?;
        for k in 0..=1000 {
            let p = point + reach * (f64::from(k) / 1000.0).powi(2);
            let terms = pairs.iter().enumerate().map(|(l, [re, im])| {
                let (sin, cos) = (wave * l as f64 * p).sin_cos();
                (if l == 0 { 1.0 } else { 2.0 }) * (re * cos - im * sin)
            });
            let off = (terms.sum::<f64>() - (-p).exp()).abs() * point.exp();
            let limit = 2.0 * number("/warp/state_tolerance")?;
            at_most(&format!("distance of g({p}) to e^-p"), off, limit)
                .map_err(|e| finished.report(&e))?;
        }
        Ok(())
    });
}

/// However short the time and however small the tolerance: met, with an estimate that is right or says that it cannot
/// tell.
#[test]
fn estimate_is_right_or_silent_at_the_edges() {
    let small = ["axis.0.x.cells=32", "axis.0.v.cells=32"];
    let rows: [(&str, &[&str]); 6] = [
        ("example1.toml", &["time.end=0.001"]),
        (
            "example1.toml",
            &["time.end=1e-10", "solver.tolerance=1e-2"],
        ),
        ("example1.toml", &["time.end=0.01", "solver.tolerance=1e-9"]),
        ("example1.toml", &["solver.tolerance=2e-14"]),
        ("example1.toml", &["solver.tolerance=1e-12"]),
        ("slope_jump.toml", &["time.end=10", "solver.tolerance=0.1"]),
    ];
    check_all(&rows, |(name, settings)| {
        let place = directory();
        let job = run(name)
            .set(&small)
            .set(settings)
            .set(&["solver.verify=true"]);
        let summary = job.solve(place.path())?;
        let (error, estimate) = (
            summary.number("error_semidiscrete")?,
            summary.number("error_estimate")?,
        );
        let outcome = at_most("error_semidiscrete", error, summary.number("tolerance")?);
        summary.require(outcome.is_ok(), || outcome.unwrap_err())?;
        let reliable = summary.boolean("error_estimate_reliable")?;
        let ratio = estimate / error;
        summary.require(!reliable || (1.0 / 3.0..=3.0).contains(&ratio), || {
            format!("error_estimate {estimate:e} is {ratio:.3} times the true error {error:e}, and called reliable")
        })
    });
}

/// Nothing moves: no rate, no spectrum, and the field stays what it was.
#[test]
fn standing_particles_stay() {
    let rows = INTERFACES.map(|interface| format!("scheme.interface={interface}"));
    check_all(&rows, |interface| {
        let place = directory();
        let job = run("step_up.toml").set(&[
            "axis.0.v.lower=-1",
            "axis.0.v.upper=1",
            "axis.0.v.cells=1",
            "initial.f=1 + x^2",
            interface,
        ]);
        let summary = job.solve(place.path())?;
        let f = field(place.path())?;
        let cells = f.len() as f64;
        let expected: Vec<f64> = (0..f.len())
            .map(|i| 1.0 + (-1.5 + 3.0 * (i as f64 + 0.5) / cells).powi(2))
            .collect();
        let outcome = at_most("distance from f(0)", distance(&f, &expected), 1e-6);
        summary.require(outcome.is_ok(), || outcome.unwrap_err())
    });
}

/// Scenes put together at random, the same ones every time: solved to the tolerance, with the same bits on more ranks, or
/// refused; whatever the estimate says is of the right size.
#[test]
fn random_scenes_are_solved_or_refused() {
    let seeds: Vec<u64> = (0..60).collect();
    let solved = std::sync::atomic::AtomicUsize::new(0);
    check_all(&seeds, |&seed| {
        let (place, more) = (directory(), directory());
        let path = place.path().join("scene.toml");
        let mut choices = Choices(seed);
        let text = scene(&mut choices);
        let told = |message: String| format!("{message}\n  of scene {seed}:\n{text}");
        std::fs::write(&path, &text).map_err(|e| e.to_string())?;
        let path = path.display().to_string();
        let finished = Job::new(["run", &path]).into(place.path()).run()?;
        if finished.code == Some(2) {
            return refused(&finished, &[]).map_err(told);
        }
        let job = Job::new(["run", &path]).on(choices.of(&[2, 3, 4]));
        let summary = job.solve(more.path()).map_err(told)?;
        let differ = differences(&datasets(place.path())?, &datasets(more.path())?);
        let same = differ.is_empty();
        summary
            .require(same, || {
                format!("other bits than on one rank in {}", differ.join(", "))
            })
            .map_err(told)?;
        if summary.value["error_semidiscrete"].is_null() {
            let nothing = summary.value["maximum"] == 0.0 && summary.value["minimum"] == 0.0;
            return summary
                .require(nothing, || {
                    "no error_semidiscrete of a field that is there".into()
                })
                .map_err(told);
        }
        solved.fetch_add(1, std::sync::atomic::Ordering::Relaxed);
        let error = summary.number("error_semidiscrete")?;
        let outcome = at_most("error_semidiscrete", error, summary.number("tolerance")?);
        summary
            .require(outcome.is_ok(), || outcome.unwrap_err())
            .map_err(told)?;
        let ratio = summary.number("error_estimate")? / error;
        let silent = !summary.boolean("error_estimate_reliable")?;
        summary
            .require(silent || (1.0 / 6.0..=6.0).contains(&ratio), || {
                format!("the estimate is {ratio:.3} times the true error, and called reliable")
            })
            .map_err(told)
    });
    // Most scenes hold something that can be solved.
    let solved = solved.into_inner();
    assert!(
        solved > seeds.len() / 2,
        "only {solved} of {} solved",
        seeds.len()
    );
}

/// A sequence of choices that depends on its seed alone (SplitMix64).
struct Choices(u64);

impl Choices {
    fn of<T: Copy>(&mut self, list: &[T]) -> T {
        self.0 = self.0.wrapping_add(0x9e37_79b9_7f4a_7c15);
        let mut h = self.0;
        h = (h ^ (h >> 30)).wrapping_mul(0xbf58_476d_1ce4_e5b9);
        h = (h ^ (h >> 27)).wrapping_mul(0x94d0_49bb_1331_11eb);
        list[((h ^ (h >> 31)) % list.len() as u64) as usize]
    }
}

/// A case in one or two dimensions: standing, grazing, trapped and escaping particles, edges off the faces, forces,
/// inflow, boxes on one side of zero, single cells.
fn scene(choices: &mut Choices) -> String {
    let dimension = choices.of(&[1, 1, 2]);
    let mut text = String::new();
    for _ in 0..dimension {
        let cells = if dimension == 1 {
            [4, 5, 8, 17, 32, 40]
        } else {
            [1, 2, 3, 4, 5, 8]
        };
        let (x, width) = (
            choices.of(&[-1.5, -1.0, -0.3, 0.2]),
            choices.of(&[0.5, 1.0, 2.0, 3.0]),
        );
        let (v, speeds) = (
            choices.of(&[-1.2, -1.0, -0.5, 0.0, 0.3]),
            choices.of(&[0.4, 1.0, 2.0, 3.0]),
        );
        text += &format!(
            "[[axis]]\nx = {{ lower = {x}, upper = {}, cells = {} }}\nv = {{ lower = {v}, upper = {}, cells = {} }}\n",
            x + width,
            choices.of(&cells),
            v + speeds,
            choices.of(&cells),
        );
    }
    let values = [
        "0", "0.2", "-0.3", "5", "0.2*x", "0.1*x^2", "1e-6", "sin(3*x)", "100",
    ];
    for _ in 0..choices.of(&[0, 1, 1, 2]) {
        let place = choices.of(&["x < 0", "abs(x) < 0.5", "x < 0.5", "x > 0.3 && x < 0.6"]);
        text += &format!(
            "[[potential]]\nwhere = \"{place}\"\nvalue = \"{}\"\n",
            choices.of(&values)
        );
    }
    text += &format!("[[potential]]\nvalue = \"{}\"\n", choices.of(&values));
    let fields = [
        "1",
        "exp(-x^2 - vx^2)",
        "1 if x < 0 else 0",
        "x*vx",
        "1e-8",
        "sin(30*x)",
        "1e9*abs(vx)",
    ];
    text += &format!("[initial]\nf = \"{}\"\n", choices.of(&fields));
    let inflows = [
        "0",
        "0",
        "0",
        "1",
        "initial",
        "exp(-vx^2)",
        "1e-3",
        "1e3",
        "-1 if vx > 0 else 0",
    ];
    text += &format!("[inflow]\nvalue = \"{}\"\n", choices.of(&inflows));
    text += &format!(
        "[time]\nend = {}\n",
        choices.of(&["1e-4", "0.01", "0.1", "0.5", "1"])
    );
    text += &format!("[scheme]\ninterface = \"{}\"\n", choices.of(&INTERFACES));
    let tolerances = ["0.1", "1e-2", "1e-3", "1e-6", "1e-9", "1e-11"];
    text += &format!(
        "[solver]\nverify = true\ntolerance = {}\n",
        choices.of(&tolerances)
    );
    let weights = choices.of(&["dissipative", "dissipative", "none"]);
    text + &format!("[solver.warp]\nweights = \"{weights}\"\n")
}

/// Units are the user's: a field of any size is solved to the tolerance, or refused; never a zero instead.
#[test]
fn fields_of_any_size_are_solved_or_refused() {
    let rows = ["1e-300", "1e-200", "1e-100", "1e100", "1e200", "1e300"];
    check_all(&rows, |factor| {
        let place = directory();
        let finished = run("step_up.toml")
            .set(&[
                "axis.0.x.cells=32",
                "axis.0.v.cells=32",
                "solver.verify=true",
                &format!("initial.f=\"{factor}*exp(-20*((x+0.6)^2+(v-0.7)^2))\""),
            ])
            .into(place.path())
            .run()?;
        solved_or_refused(&finished, place.path(), 1e-6, &["initial.f"])
    });
}

/// When (almost) nothing is left of the field, an error relative to it cannot be promised: met or refused.
#[test]
fn what_is_left_of_a_field_is_solved_or_refused() {
    let rows = ["14", "30", "46", "54", "62"];
    check_all(&rows, |end| {
        let place = directory();
        let job = run("step_up.toml").set(&[
            "axis.0.x.cells=4",
            "axis.0.v.cells=6",
            "axis.0.v.lower=0.5",
            &format!("time.end={end}"),
            "solver.tolerance=0.1",
            "solver.verify=true",
        ]);
        let finished = job.into(place.path()).run()?;
        solved_or_refused(&finished, place.path(), 0.1, &["time.end"])
    });
}

/// Done, with the error that was asked for (`solver.verify`), or refused with a message that says all of `says`.
fn solved_or_refused(
    finished: &Finished,
    directory: &Path,
    tolerance: f64,
    says: &[&str],
) -> Result<(), String> {
    if finished.code == Some(2) {
        return refused(finished, says);
    }
    require(finished.code == Some(0), finished, || {
        "neither solved nor refused".into()
    })?;
    let text = std::fs::read_to_string(directory.join("summary.json"))
        .map_err(|e| finished.report(&format!("summary.json: {e}")))?;
    let value: serde_json::Value =
        serde_json::from_str(&text).map_err(|e| finished.report(&format!("summary.json: {e}")))?;
    let error = value["error_semidiscrete"].as_f64().unwrap_or(f64::NAN);
    require(error <= tolerance, finished, || {
        format!(
            "called a success: error_semidiscrete {}, tolerance {tolerance:e}, largest value of f {}",
            value["error_semidiscrete"], value["maximum"]
        )
    })
}

/// The smallest tolerance that a refusal names is accepted when it is asked for, and met.
#[test]
fn smallest_tolerance_is_accepted_and_met() {
    let smallest = |name: &str, settings: &[&str]| -> Result<String, String> {
        let job = plan(name, 1).set(settings).set(&["solver.tolerance=1e-15"]);
        let finished = job.run()?;
        refused(&finished, &["tolerance", "1e-15"])?;
        let words = finished.errors.split_whitespace();
        let mut after = words.skip_while(|w| *w != "than").skip(1);
        let number = after.next().unwrap_or_default().to_owned();
        let is_number = number.parse::<f64>().is_ok_and(|x| x > 1e-15 && x < 1e-9);
        require(is_number, &finished, || {
            "no smallest tolerance named".into()
        })?;
        Ok(number)
    };
    check_all(&cases(), |name| {
        let small = shrunk(name);
        let number = smallest(name, small)?;
        let job = plan(name, 1).set(small);
        let job = job.set(&[&format!("solver.tolerance={number}")]);
        job.succeed().map(|_| ())
    });
    let small = ["axis.0.x.cells=24", "axis.0.v.cells=20"];
    let number = smallest("slope_jump.toml", &small).unwrap();
    let place = directory();
    let summary = run("slope_jump.toml")
        .set(&small)
        .set(&[&format!("solver.tolerance={number}"), "solver.verify=true"])
        .on(2)
        .solve(place.path())
        .unwrap();
    let error = summary.number("error_semidiscrete").unwrap();
    at_most(&summary.command, error, number.parse().unwrap()).unwrap();
}

/// Any number of cells, odd ones with a standing velocity among them, and boxes of a single cell.
#[test]
fn any_number_of_cells_is_solved() {
    let mut rows = Vec::new();
    for interface in INTERFACES {
        for cells in [1, 2, 3, 4, 5, 6, 7, 8, 15, 16, 17] {
            rows.push((
                interface,
                format!("axis.0.v.cells={cells}"),
                "axis.0.x.cells=20",
            ));
            rows.push((
                interface,
                format!("axis.0.x.cells={cells}"),
                "axis.0.v.cells=20",
            ));
        }
    }
    check_all(&rows, |(interface, cells, others)| {
        let place = directory();
        let job = run("step_up.toml").set(&[
            &format!("scheme.interface={interface}"),
            cells,
            others,
            "solver.verify=true",
        ]);
        let summary = job.solve(place.path())?;
        // One row of cells may hold nothing at all.
        if summary.number("mass_initial")? == 0.0 {
            let largest = summary.number("maximum")?;
            return summary.require(largest == 0.0, || format!("maximum {largest} of nothing"));
        }
        let error = summary.number("error_semidiscrete")?;
        let outcome = at_most("error_semidiscrete", error, summary.number("tolerance")?);
        summary.require(outcome.is_ok(), || outcome.unwrap_err())
    });
}

// ---------------------------------------------------------------------------------------------------------------------
// Figures

/// Numbers of a line of `phasewarp spectrum`: the line that starts with `label`, the word after `key`.
fn spectrum_number(finished: &Finished, label: &str, key: &str) -> Result<f64, String> {
    let line = finished.output.lines().find(|l| l.starts_with(label));
    let mut words = line.unwrap_or_default().split_whitespace();
    words.find(|w| *w == key);
    let number = words.next().and_then(|w| w.parse().ok());
    number.ok_or_else(|| finished.report(&format!("no \"{label} … {key} <number>\"")))
}

#[test]
fn spectrum_of_example_1() {
    // cells, λ⁻ and λ⁺ without weights; the first to 5 digits as in the issue.
    let rows = [
        (128, "hat", 126.9287, 2.0707, 1),
        (128, "hat", 126.9287, 2.0707, 3),
        (64, "hat", 62.8672, 2.7878, 2),
        (64, "conservative", 62.8651, 0.0, 2),
        (128, "conservative", 126.9280, 0.0, 2),
    ];
    check_all(&rows, |&(cells, interface, lowest, highest, ranks)| {
        let finished = Job::new(["spectrum", &case("example1.toml")])
            .set(&[
                &format!("axis.0.x.cells={cells}"),
                &format!("axis.0.v.cells={cells}"),
                &format!("scheme.interface={interface}"),
            ])
            .on(ranks)
            .succeed()?;
        let found = |label, key, expected, by| {
            let value = spectrum_number(&finished, label, key)?;
            near(&format!("{label}: {key}"), value, expected, by).map_err(|e| finished.report(&e))
        };
        found("no weights", "lambda-", lowest, 1e-3)?;
        if interface == "conservative" {
            let highest = spectrum_number(&finished, "no weights", "lambda+")?;
            return at_most("lambda+", highest, 1e-6).map_err(|e| finished.report(&e));
        }
        found("no weights", "lambda-", lowest, 1e-4)?;
        found("no weights", "lambda+", highest, 1e-4)?;
        found("dissipative weights", "lambda-", lowest, 1e-2)?;
        let highest = spectrum_number(&finished, "dissipative weights", "lambda+")?;
        at_most("lambda+ with weights", highest, 1e-6).map_err(|e| finished.report(&e))
    });
}

/// λ± of example 1 by refinement, both ends with their residuals; the known figures, as a table and as JSON.
#[test]
fn spectrum_by_refinement() {
    // λ⁺ and λ⁻ at 32², 64², 128².
    type Row = (&'static str, bool, [f64; 3], [f64; 3]);
    let rows: [Row; 3] = [
        (
            "hat",
            false,
            [0.080298, 2.787772, 2.070673],
            [30.7491, 62.8672, 126.9287],
        ),
        (
            "hat",
            true,
            [-0.002264, -0.000584, -0.000148],
            [30.7491, 62.8660, 126.9283],
        ),
        (
            "conservative",
            false,
            [-0.002264, -0.000584, -0.000148],
            [30.7492, 62.8651, 126.9279],
        ),
    ];
    check_all(&["hat", "conservative"], |interface| {
        let job = Job::new([
            "spectrum",
            &case("example1.toml"),
            "--refine",
            "1,2,4",
            "--json",
        ]);
        let finished = job
            .set(&["axis.0.x.cells=32", "axis.0.v.cells=32"])
            .set(&[&format!("scheme.interface={interface}")])
            .on(2)
            .succeed()?;
        let value: serde_json::Value =
            serde_json::from_str(&finished.output).map_err(|e| finished.report(&e.to_string()))?;
        for (_, weighted, highest, lowest) in rows.iter().filter(|r| r.0 == *interface) {
            for (k, refinement) in [1, 2, 4].into_iter().enumerate() {
                let found = value
                    .as_array()
                    .into_iter()
                    .flatten()
                    .find(|v| v["refinement"] == refinement && v["weighted"] == *weighted);
                let found = found.ok_or_else(|| finished.report("a row is missing"))?;
                let at = format!("{interface}, weights {weighted}, x {refinement}");
                let number = |path: &str| {
                    let value = found.pointer(path).and_then(serde_json::Value::as_f64);
                    value.ok_or_else(|| finished.report(&format!("{at}: no {path}")))
                };
                for (end, expected, by) in
                    [("highest", highest[k], 2e-6), ("lowest", -lowest[k], 1e-4)]
                {
                    let value = number(&format!("/lanczos/{end}/value"))?;
                    near(&format!("{at}: {end}"), value, expected, by)?;
                    let residual = number(&format!("/lanczos/{end}/residual"))?;
                    at_most(&format!("{at}: residual"), residual, 2e-4)?;
                    let converged = found["lanczos"][end]["converged"] == true;
                    require(converged, &finished, || {
                        format!("{at}: {end} has not converged")
                    })?;
                }
                // Bounds are bounds.
                let (low, high) = (number("/gershgorin/0")?, number("/gershgorin/1")?);
                at_most(
                    "lowest below Gershgorin",
                    low,
                    number("/lanczos/lowest/value")?,
                )?;
                at_most(
                    "highest above Gershgorin",
                    number("/lanczos/highest/value")?,
                    high,
                )?;
                at_most(
                    "highest above the certificate",
                    number("/lanczos/highest/value")?,
                    number("/certificate")?,
                )?;
                at_most("sqrt(pi)", number("/sqrt_pi/1")?, number("/sqrt_pi/0")?)?;
                require(
                    (number("/sqrt_pi/0")? > 1.0) == *weighted,
                    &finished,
                    || format!("{at}: sqrt(pi)"),
                )?;
            }
        }
        Ok(())
    });
    // Too few steps are said to be too few.
    let job = Job::new(["spectrum", &case("example1.toml"), "--steps", "20"]);
    let finished = job.succeed().unwrap();
    assert!(
        finished.output.contains("not converged"),
        "{}",
        finished.report("20 steps")
    );
}

/// Wells, slopes, inflow, two and three dimensions: every case has a spectrum, its ends inside the bounds.
#[test]
fn spectrum_of_every_case() {
    check_all(&cases(), |name| {
        let job = Job::new(["spectrum", &case(name), "--json"]);
        let job = job.set(shrunk(name)).set(&["axis.0.x.cells=12"]).on(2);
        let finished = job.succeed()?;
        let value: serde_json::Value =
            serde_json::from_str(&finished.output).map_err(|e| finished.report(&e.to_string()))?;
        let rows = value.as_array().filter(|rows| !rows.is_empty());
        for row in rows.ok_or_else(|| finished.report("no rows"))? {
            let number = |path: &str| {
                row.pointer(path)
                    .and_then(serde_json::Value::as_f64)
                    .unwrap_or(f64::NAN)
            };
            let (low, high) = (
                number("/lanczos/lowest/value"),
                number("/lanczos/highest/value"),
            );
            let slack = 1e-12 * low.abs();
            let inside = low < 0.0
                && low < high
                && number("/gershgorin/0") <= low + slack
                && high <= number("/gershgorin/1") + slack
                && high <= number("/growth").max(0.0) + slack
                && -low <= number("/decay") + slack;
            require(inside, &finished, || format!("outside its bounds: {row}"))?;
        }
        Ok(())
    });
}

/// L1 error against the exact solution and its order, about ½: the solution jumps.
#[test]
fn error_of_example_1_against_the_exact_solution() {
    let rows = [("hat", 0.4614, 0.3297), ("conservative", 0.4605, 0.3296)];
    check_all(&rows, |&(interface, coarse, fine)| {
        let error = |cells: usize, expected: f64| -> Result<f64, String> {
            let place = directory();
            let summary = run("example1.toml")
                .on(2)
                .set(&[
                    &format!("axis.0.x.cells={cells}"),
                    &format!("axis.0.v.cells={cells}"),
                    &format!("scheme.interface={interface}"),
                ])
                .solve(place.path())?;
            let l1 = summary.number("error_l1")?;
            let outcome = near("error_l1", l1, expected, 1e-4);
            summary.require(outcome.is_ok(), || outcome.unwrap_err())?;
            // The same from the file: f and the exact solution are both there.
            let stored = datasets(place.path())?;
            let exact = stored
                .get("/exact")
                .ok_or_else(|| format!("no /exact in result.h5\n  command: {}", summary.command))?;
            let volume = (3.0 / cells as f64).powi(2);
            let pairs = stored["/f"].numbers().into_iter().zip(exact.numbers());
            let sum: f64 = pairs.map(|(f, g)| (f - g).abs()).sum();
            let outcome = near("error_l1 from result.h5", volume * sum, l1, 1e-12);
            summary.require(outcome.is_ok(), || outcome.unwrap_err())?;
            Ok(l1)
        };
        let order = (error(64, coarse)? / error(128, fine)?).log2();
        near(&format!("order of error_l1, {interface}"), order, 0.5, 0.1)
    });
}

/// The gain of slopes on example 1: the L1 error at two sizes. The figures of the hat interface are those of a separate
/// implementation of the formulas; the conservative interface is next to it, as without slopes.
#[test]
fn slopes_gain_on_example_1() {
    let rows = [
        ("hat", "minmod", [0.2735, 0.1742], 1e-4),
        ("hat", "van-leer", [0.2227, 0.1356], 1e-4),
        ("conservative", "minmod", [0.2735, 0.1742], 2e-3),
        ("conservative", "van-leer", [0.2227, 0.1356], 2e-3),
    ];
    check_all(&rows, |&(interface, limiter, expected, by)| {
        for (cells, expected) in [64, 128].into_iter().zip(expected) {
            let place = directory();
            let job = run("example1.toml").on(2).set(&SLOPES).set(&[
                &format!("axis.0.x.cells={cells}"),
                &format!("axis.0.v.cells={cells}"),
                &format!("scheme.interface={interface}"),
                &format!("scheme.limiter={limiter}"),
            ]);
            let summary = job.solve(place.path())?;
            let outcome = near("error_l1", summary.number("error_l1")?, expected, by);
            summary.require(outcome.is_ok(), || outcome.unwrap_err())?;
        }
        Ok(())
    });
}

/// Monotone data, so without extrema: order 2 with slopes, order 1 without; transport alone, with a force, in the plane.
#[test]
fn slopes_are_of_second_order() {
    // S rises from 0 to 1; what enters is 0, from the lower ends in x and the upper end in v.
    let rise = |of: &str, at: f64, width: f64| format!("(1 + tanh(({of} - ({at}))/{width}))/2");
    let line = |potential: &str, x: &str, v: &str| {
        let f = |x: &str, v: &str| {
            format!(
                "{} * {}",
                rise(x, -0.5, 0.5),
                rise(&format!("2.5 - ({v})"), 0.0, 0.35)
            )
        };
        (potential.to_owned(), f("x", "v"), f(x, v))
    };
    let transport = line("0", "x - v*t", "v");
    let force = line("0.5*x", "x - v*t - 0.25*t^2", "v + 0.5*t");
    let cloud = |x: &str, y: &str| format!("{} * {}", rise(x, -0.3, 0.5), rise(y, -0.2, 0.6));
    let plane = (
        "0".to_owned(),
        cloud("x", "y"),
        cloud("x - vx*t", "y - vy*t"),
    );
    // Name, scene, axes by refinement, end.
    type Scene<'a> = (
        &'a str,
        &'a (String, String, String),
        fn(usize) -> String,
        f64,
    );
    let axes_line = |n: usize| {
        format!(
            "[[axis]]\nx = {{ lower = -4, upper = 5, cells = {} }}\nv = {{ lower = 0.5, upper = 4.5, cells = 6 }}\n",
            72 * n
        )
    };
    let axes_force = |n: usize| {
        format!(
            "[[axis]]\nx = {{ lower = -4, upper = 5, cells = {} }}\nv = {{ lower = 0.5, upper = 4.9, cells = {} }}\n",
            36 * n,
            22 * n
        )
    };
    let axes_plane = |n: usize| {
        format!(
            "[[axis]]\nx = {{ lower = -3.5, upper = 3.5, cells = {} }}\nv = {{ lower = 0.4, upper = 1.2, cells = 3 }}\n\
             [[axis]]\nx = {{ lower = -4, upper = 4, cells = {} }}\nv = {{ lower = 0.3, upper = 0.9, cells = 2 }}\n",
            24 * n,
            26 * n
        )
    };
    let scenes: [Scene<'_>; 3] = [
        ("transport", &transport, axes_line, 0.5),
        ("force", &force, axes_force, 0.5),
        ("plane", &plane, axes_plane, 0.6),
    ];
    let mut rows = Vec::new();
    for scene in &scenes {
        for (limiter, order) in [("none", 1.0), ("minmod", 2.0), ("van-leer", 2.0)] {
            rows.push((scene, limiter, order));
        }
    }
    check_all(
        &rows,
        |((name, (potential, initial, exact), axes, end), limiter, order)| {
            let error = |n: usize| -> Result<f64, String> {
                let place = directory();
                let file = place.path().join("smooth.toml");
                let text = format!(
                    "{}[[potential]]\nvalue = \"{potential}\"\n[initial]\nf = \"{initial}\"\n[time]\nend = {end}\n\
                 [scheme]\nlimiter = \"{limiter}\"\n[solver]\nmethod = \"classical\"\n\
                 [solver.classical]\nintegrator = \"ssp-rk3\"\n[exact]\nf = \"{exact}\"\n",
                    axes(n)
                );
                std::fs::write(&file, text).map_err(|e| e.to_string())?;
                let job = Job::new(["run".to_owned(), file.display().to_string()]);
                job.on(2).solve(place.path())?.number("error_l1")
            };
            let (coarse, fine) = (error(4)?, error(8)?);
            let what = format!("order, {name}, {limiter} (errors {coarse:e}, {fine:e})");
            near(&what, (coarse / fine).log2(), *order, 0.2)
        },
    );
}

/// With slopes and the longest step, nothing rises above the data and what enters, and nothing falls below.
#[test]
fn slopes_keep_the_bounds() {
    let mut rows = Vec::new();
    // Slopes do not go with an inflow that varies.
    for name in (cases().into_iter()).filter(|name| name != "pulsed_inflow.toml") {
        for (limiter, integrator) in [
            ("minmod", "forward-euler"),
            ("van-leer", "forward-euler"),
            ("van-leer", "ssp-rk3"),
        ] {
            for interface in INTERFACES {
                rows.push((name.clone(), limiter, integrator, interface));
            }
        }
    }
    check_all(&rows, |(name, limiter, integrator, interface)| {
        let place = directory();
        let summary = run(name)
            .set(shrunk(name))
            .set(&[
                "solver.method=classical",
                "solver.classical.cfl=1",
                &format!("solver.classical.integrator={integrator}"),
                &format!("scheme.limiter={limiter}"),
                &format!("scheme.interface={interface}"),
            ])
            .solve(place.path())?;
        // Every case has data and inflow between 0 and 1.
        let (least, most) = (summary.number("minimum")?, summary.number("maximum")?);
        summary.require(least >= -1e-14 && most <= 1.0 + 1e-14, || {
            format!("f from {least:e} to {most}")
        })
    });
}

/// Snell's law: the velocity of the beam in the strip and behind it, from the moments in the file.
#[test]
fn the_lens_refracts_its_beam() {
    let place = directory();
    let cells = [36, 16];
    let job = run("lens2d.toml").set(&[
        "axis.1.x.cells=16",
        "solver.method=classical",
        "solver.classical.integrator=ssp-rk3",
        "scheme.limiter=van-leer",
    ]);
    let summary = job.on(2).within(120).solve(place.path()).unwrap();
    let stored = datasets(place.path()).unwrap();
    let (density, momentum) = (stored["/density"].numbers(), stored["/momentum"].numbers());
    let points = density.len();
    assert_eq!(points, cells[0] * cells[1]);
    // Fluxes through the strip of cells x from..to: Σ v_y f / Σ v_x f is the tangent of the beam's angle.
    let tangent = |columns: std::ops::Range<usize>| {
        let sum = |axis: usize| -> f64 {
            columns
                .clone()
                .map(|i| {
                    momentum[axis * points + i * cells[1]..][..cells[1]]
                        .iter()
                        .sum::<f64>()
                })
                .sum()
        };
        sum(1) / sum(0)
    };
    let (before, inside, behind) = (tangent(8..12), tangent(20..24), tangent(28..32));
    // The mean of the beam is (0.8, 0.45); in the strip vx = √(0.64 − 0.3).
    for (what, found, expected) in [
        ("before", before, 0.45 / 0.8),
        ("inside", inside, 0.45 / (0.64f64 - 0.3).sqrt()),
        ("behind", behind, 0.45 / 0.8),
    ] {
        let off = (found / expected - 1.0).abs();
        assert!(
            off < 0.05,
            "{what}: tan = {found:.4}, {expected:.4} expected: {}",
            summary.command
        );
    }
}

/// Trapped and transmitted particles at both walls of the well, nobody at the ends of the box.
#[test]
fn conservative_interface_keeps_the_mass() {
    let change = |settings: &[&str]| -> Result<f64, String> {
        let place = directory();
        let summary = run("well.toml")
            .on(2)
            .set(&["time.end=0.2"])
            .set(settings)
            .solve(place.path())?;
        let (after, before) = (summary.number("mass")?, summary.number("mass_initial")?);
        summary.require(before > 0.1, || format!("mass_initial {before}"))?;
        Ok((after / before - 1.0).abs())
    };
    let conservative = "scheme.interface=conservative";
    for (settings, limit) in [
        ([conservative, "solver.method=classical"], 1e-12),
        ([conservative, "solver.tolerance=2e-13"], 1e-12),
    ] {
        at_most(
            &format!("change of mass, {settings:?}"),
            change(&settings).unwrap(),
            limit,
        )
        .unwrap();
    }
    // Control: the walls were met, where the hat interface makes mass.
    let hat = change(&["scheme.interface=hat", "solver.method=classical"]).unwrap();
    assert!(
        hat > 1e-5,
        "hat: change of mass {hat:e}; the well's walls were not met"
    );
}

// ---------------------------------------------------------------------------------------------------------------------
// Equal bits

/// Every way to split `ranks` into blocks along `axes` x-axes and mode groups: `--ranks-x`.
fn meshes(axes: usize, ranks: usize) -> Vec<Vec<usize>> {
    let mut all = vec![Vec::new()];
    for _ in 0..axes {
        all = (all.iter())
            .flat_map(|mesh: &Vec<usize>| {
                (1..=ranks)
                    .map(move |parts| mesh.iter().copied().chain([parts]).collect::<Vec<_>>())
            })
            .filter(|mesh| ranks.is_multiple_of(mesh.iter().product()))
            .collect();
    }
    all
}

#[test]
fn every_mesh_is_listed() {
    assert_eq!(meshes(1, 4), [[1], [2], [4]]);
    assert_eq!(meshes(2, 3), [[1, 1], [1, 3], [3, 1]]);
    assert_eq!(meshes(3, 4).len(), 10);
}

/// A run to be repeated on every mesh.
struct Scene {
    name: &'static str,
    settings: &'static [&'static str],
    axes: usize,
    datasets: &'static [&'static str],
}

const LINE: &[&str] = &[
    "/axis/component",
    "/axis/vx",
    "/axis/x",
    "/case",
    "/density",
    "/exact",
    "/f",
    "/momentum",
    "/plan",
    "/velocity",
    "/xdmf/plane_x/exact",
    "/xdmf/plane_x/f",
];
const PLANE: &[&str] = &[
    "/axis/component",
    "/axis/vx",
    "/axis/vy",
    "/axis/x",
    "/axis/y",
    "/case",
    "/density",
    "/exact",
    "/f",
    "/momentum",
    "/plan",
    "/velocity",
    "/xdmf/plane_x/f",
    "/xdmf/plane_y/exact",
    "/xdmf/space/density",
    "/xdmf/space/velocity",
];
const SPACE: &[&str] = &[
    "/axis/component",
    "/axis/vx",
    "/axis/vy",
    "/axis/vz",
    "/axis/x",
    "/axis/y",
    "/axis/z",
    "/case",
    "/density",
    "/exact",
    "/f",
    "/momentum",
    "/plan",
    "/velocity",
    "/xdmf/plane_z/f",
    "/xdmf/space/density",
    "/xdmf/space/momentum",
];

const MEASURE_LINE: &[&str] = &[
    "/axis/component",
    "/axis/point",
    "/axis/vx",
    "/axis/x",
    "/density",
    "/density_exact",
    "/momentum",
    "/multivalued/branch",
    "/multivalued/density",
    "/multivalued/v",
    "/multivalued/x",
    "/phi",
    "/psi",
    "/velocity",
    "/velocity_exact",
    "/xdmf/plane_x/phi",
    "/xdmf/plane_x/psi_x",
];
const MEASURE_PLANE: &[&str] = &[
    "/axis/vy",
    "/axis/y",
    "/density",
    "/density_exact",
    "/momentum",
    "/phi",
    "/psi",
    "/velocity",
    "/velocity_exact",
];

/// Compares a scene's results on every mesh of 1 to 4 ranks, and of 7 where `--ranks-x` is left to the program, with
/// those of one rank.
fn same_bits_everywhere(scene: &Scene) {
    let reference = directory();
    let job = || run(scene.name).set(scene.settings);
    job().solve(reference.path()).unwrap();
    let reference = datasets(reference.path()).unwrap();
    for name in scene.datasets {
        assert!(
            reference.contains_key(*name),
            "no {name} in result.h5: {}",
            job().command()
        );
    }

    let mut rows: Vec<(usize, Option<Vec<usize>>)> = Vec::new();
    let settings: Vec<String> = scene.settings.iter().map(|s| s.to_string()).collect();
    let space = Case::load(Path::new(&case(scene.name)), &settings)
        .unwrap()
        .space;
    let whole =
        |m: &Vec<usize>| (m.iter().enumerate()).all(|(a, m)| *m == 1 || !space.is_periodic(a));
    for ranks in 1..=4 {
        rows.push((ranks, None));
        rows.extend(
            meshes(scene.axes, ranks)
                .into_iter()
                .filter(whole)
                .map(|m| (ranks, Some(m))),
        );
    }
    rows.push((7, None));
    check_all(&rows, |(ranks, mesh)| {
        let place = directory();
        let mut job = job().on(*ranks);
        if let Some(mesh) = mesh {
            let list: Vec<String> = mesh.iter().map(usize::to_string).collect();
            job = job.with(["--ranks-x", &list.join(",")]);
        }
        let summary = job.solve(place.path())?;
        // It really ran so.
        let found = (&summary.value["ranks"], &summary.value["space_blocks"]);
        summary.require(*found.0 == serde_json::json!(ranks), || {
            format!("ranks: {}", found.0)
        })?;
        if let Some(mesh) = mesh {
            let groups = ranks / mesh.iter().product::<usize>();
            let as_asked = *found.1 == serde_json::json!(mesh)
                && summary.value["mode_groups"] == serde_json::json!(groups);
            summary.require(as_asked, || format!("space_blocks: {}", found.1))?;
        }
        let differ = differences(&datasets(place.path())?, &reference);
        summary.require(differ.is_empty(), || {
            format!("other bits than on one rank in {}", differ.join(", "))
        })
    });

    // Control: a case changed by a billionth differs, in the field at least and not on the axes.
    let place = directory();
    let end = format!("time.end={}", 0.7 * (1.0 + 1e-9));
    job().set(&[&end]).solve(place.path()).unwrap();
    let differ = differences(&datasets(place.path()).unwrap(), &reference);
    let field = if scene.datasets.contains(&"/phi") {
        "/psi"
    } else {
        "/f"
    };
    assert!(
        differ.contains(&field.to_owned()) && !differ.contains(&"/axis/x".to_owned()),
        "a changed time.end changes {differ:?}"
    );
}

#[test]
fn same_bits_with_inflow() {
    same_bits_everywhere(&Scene {
        name: "inflow_barrier.toml",
        settings: &["axis.0.x.cells=37", "axis.0.v.cells=29", "time.end=0.7"],
        axes: 1,
        datasets: LINE,
    });
}

#[test]
fn same_bits_with_samples_and_a_plateau() {
    same_bits_everywhere(&Scene {
        name: "example1.toml",
        settings: &[
            "axis.0.x.cells=23",
            "axis.0.v.cells=17",
            "time.end=0.7",
            "solver.tolerance=1e-4",
            "solver.warp.profile=smooth",
            "solver.warp.coefficients=sampled",
            "solver.warp.recovery_method=least-squares",
            "output.plateau.points=3",
        ],
        axes: 1,
        datasets: &["/f", "/plateau/distance", "/plateau/norm", "/plateau/p"],
    });
}

#[test]
fn same_bits_at_output_times() {
    same_bits_everywhere(&Scene {
        name: "inflow_barrier.toml",
        settings: &[
            "axis.0.x.cells=23",
            "axis.0.v.cells=17",
            "time.end=0.7",
            "solver.tolerance=1e-4",
            "output.moments_every=0.2",
            "output.field_times=[0.3, 0.4]",
            "output.chunks=[5, 6]",
        ],
        axes: 1,
        datasets: &[
            "/f",
            "/history/f",
            "/history/density",
            "/history/mass",
            "/axis/time",
        ],
    });
}

#[test]
fn same_bits_with_a_common_auxiliary_unknown() {
    same_bits_everywhere(&Scene {
        name: "inflow_barrier.toml",
        settings: &[
            "axis.0.x.cells=35",
            "axis.0.v.cells=27",
            "time.end=0.7",
            "solver.warp.inflow=scalar",
        ],
        axes: 1,
        datasets: LINE,
    });
}

#[test]
fn same_bits_with_inflow_that_varies() {
    same_bits_everywhere(&Scene {
        name: "pulsed_inflow.toml",
        settings: &[
            "axis.0.x.cells=33",
            "axis.0.v.cells=23",
            "time.end=0.7",
            "solver.tolerance=1e-4",
            "solver.warp.inflow=full",
        ],
        axes: 1,
        datasets: LINE,
    });
}

/// Every embedding, δ planned and given, a shift: the tolerance is met and the estimate is right.
#[test]
fn tolerances_are_met_with_every_embedding() {
    let steady = [
        "inflow_barrier.toml",
        "axis.0.x.cells=32",
        "axis.0.v.cells=36",
    ];
    let pulsed = [
        "pulsed_inflow.toml",
        "axis.0.x.cells=20",
        "axis.0.v.cells=22",
    ];
    let mut rows = Vec::new();
    for grid in [steady, pulsed] {
        for embedding in ["boundary", "full", "scalar"] {
            for delta in ["", "solver.warp.delta=max", "solver.warp.delta=30"] {
                let embedding = format!("solver.warp.inflow={embedding}");
                rows.push((grid, vec![embedding, delta.to_owned()]));
            }
        }
        for shift in ["growth", "0.4", "-0.3", "-4"] {
            rows.push((grid, vec![format!("solver.warp.shift={shift}")]));
        }
    }
    check_all(&rows, |([name, x, v], settings)| {
        let mut set = vec![*x, *v, "solver.verify=true", "solver.tolerance=1e-5"];
        set.extend(
            settings
                .iter()
                .map(String::as_str)
                .filter(|s| !s.is_empty()),
        );
        let place = directory();
        meets_its_tolerance(&run(name).on(2).set(&set).solve(place.path())?)
    });
}

/// A δ so small that the enlarged system grows beyond all digits; a δ where nothing enters; inflow that is not finite at
/// some time, or changes too fast.
#[test]
fn what_no_embedding_can_do() {
    let rows: &[(&str, &[&str], &[&str])] = &[
        (
            "inflow_barrier.toml",
            &["solver.warp.inflow=full", "solver.warp.delta=0.01"],
            &["growth x time", "solver.warp.delta"],
        ),
        (
            "pulsed_inflow.toml",
            &["inflow.value='1/(t - 1.2)'"],
            &["inflow.value", "inf", "t = 1.2", "must be finite"],
        ),
        (
            "pulsed_inflow.toml",
            &[
                "axis.0.x.cells=8",
                "axis.0.v.cells=6",
                "inflow.value='sin(40000*t)'",
            ],
            &["inflow.value", "changes too fast", "8192 steps"],
        ),
    ];
    check_all(rows, |(name, settings, says)| {
        let place = directory();
        refused(
            &run(name).on(2).set(settings).into(place.path()).run()?,
            says,
        )
    });
    let place = directory();
    let grid = [
        "axis.0.x.cells=16",
        "axis.0.v.cells=16",
        "solver.warp.delta=2",
    ];
    let summary = run("example1.toml").set(&grid).solve(place.path()).unwrap();
    let warnings = summary.value["warnings"].to_string();
    assert!(warnings.contains("delta has no effect"), "{warnings}");
}

/// λ± of the enlarged system and of `A` alone: the paper's δ adds nothing, δ = 1 a quarter of the largest rate where 1 enters.
#[test]
fn spectrum_with_inflow() {
    let set = |delta: &'static str| {
        Job::new(["spectrum", &case("example1.toml")])
            .set(&["inflow.value=1", "solver.warp.inflow=full", delta])
            .succeed()
    };
    let number = |finished: &Finished, label: &str, key: &str| {
        spectrum_number(finished, label, key).unwrap_or_else(|e| panic!("{e}"))
    };
    let largest = set("solver.warp.delta=max").unwrap();
    let alone = number(&largest, "no weights, A alone", "lambda+");
    let enlarged = number(&largest, "no weights, with inflow", "lambda+");
    assert!((alone - 2.0707).abs() < 1e-4 && (enlarged - alone).abs() < 1e-5);
    let one = set("solver.warp.delta=1").unwrap();
    let enlarged = number(&one, "no weights, with inflow", "lambda+");
    // The end of a chain with diagonal −d and neighbours d/2, coupled by d/2 to an unknown of its own: λ = d/4.
    let fastest = (1.5 - 1.5 / 128.0) / (3.0 / 128.0);
    assert!((enlarged - fastest / 4.0).abs() < 1e-4, "{enlarged}");
}

#[test]
fn same_bits_with_shifted_weights() {
    same_bits_everywhere(&Scene {
        name: "well.toml",
        settings: &["axis.0.x.cells=39", "axis.0.v.cells=31", "time.end=0.7"],
        axes: 1,
        datasets: LINE,
    });
}

#[test]
fn same_bits_with_slopes_and_conservative_interface() {
    same_bits_everywhere(&Scene {
        name: "slope_jump.toml",
        settings: &[
            "axis.0.x.cells=41",
            "axis.0.v.cells=27",
            "time.end=0.7",
            "scheme.interface=conservative",
            "solver.tolerance=1e-9",
        ],
        axes: 1,
        datasets: LINE,
    });
}

#[test]
fn same_bits_in_the_plane() {
    same_bits_everywhere(&Scene {
        name: "barrier2d.toml",
        settings: &["axis.0.x.cells=13", "axis.1.x.cells=7", "time.end=0.7"],
        axes: 2,
        datasets: PLANE,
    });
}

#[test]
fn same_bits_around_periodic_axes() {
    same_bits_everywhere(&Scene {
        name: "periodic2d.toml",
        settings: &["axis.0.x.cells=13", "axis.1.x.cells=5", "time.end=0.7"],
        axes: 2,
        datasets: PLANE,
    });
    same_bits_everywhere(&Scene {
        name: "periodic2d.toml",
        settings: &[
            "axis.0.x.boundary=periodic",
            "axis.1.x={lower=-0.5,upper=0.5,cells=6}",
            "time.end=0.7",
            "solver.method=classical",
            "solver.classical.integrator=ssp-rk3",
            "scheme.limiter=van-leer",
        ],
        axes: 2,
        datasets: PLANE,
    });
}

/// Where periodic axes are asked for and where they are not to be had.
#[test]
fn boundaries_that_cannot_be_are_refused() {
    let rows: [(&[&str], &[&str], &[&str]); 4] = [
        (
            &["axis.0.x.boundary=reflecting"],
            &[],
            &["axis.0.x.boundary", "reflecting", "periodic"],
        ),
        (
            &["axis.0.v.boundary=periodic"],
            &[],
            &["axis.0.v.boundary", "velocity"],
        ),
        (
            &["axis.0.x.boundry=periodic"],
            &[],
            &["boundry", "boundary"],
        ),
        (
            &[],
            &["--ranks-x", "1,2"],
            &["--ranks-x", "2 blocks", "y", "periodic"],
        ),
    ];
    check_all(&rows, |(settings, arguments, says)| {
        let place = directory();
        let job = run("periodic2d.toml")
            .set(settings)
            .with(arguments.iter().copied());
        let finished = job.on(2).into(place.path()).run()?;
        refused(&finished, says)
    });
}

#[test]
fn same_bits_in_space() {
    same_bits_everywhere(&Scene {
        name: "step3d.toml",
        settings: &["axis.0.v.cells=7", "time.end=0.7", "inflow.value=initial"],
        axes: 3,
        datasets: SPACE,
    });
}

#[test]
fn same_bits_with_measure_valued_data() {
    same_bits_everywhere(&Scene {
        name: "example2.toml",
        settings: &["axis.0.x.cells=38", "axis.0.v.cells=27", "time.end=0.7"],
        axes: 1,
        datasets: MEASURE_LINE,
    });
    same_bits_everywhere(&Scene {
        name: "example3.toml",
        settings: &[
            "axis.0.x.cells=4",
            "axis.0.v.cells=5",
            "time.end=0.7",
            "solver.tolerance=1e-3",
            "output.delta_width=gradient",
        ],
        axes: 2,
        datasets: MEASURE_PLANE,
    });
}

#[test]
fn same_bits_with_the_classical_method() {
    same_bits_everywhere(&Scene {
        name: "inflow_barrier.toml",
        settings: &[
            "axis.0.x.cells=37",
            "axis.0.v.cells=29",
            "time.end=0.7",
            "solver.method=classical",
        ],
        axes: 1,
        datasets: LINE,
    });
    same_bits_everywhere(&Scene {
        name: "barrier2d.toml",
        settings: &[
            "axis.0.x.cells=13",
            "axis.1.x.cells=7",
            "time.end=0.7",
            "solver.method=classical",
            "solver.classical.integrator=ssp-rk3",
        ],
        axes: 2,
        datasets: PLANE,
    });
}

#[test]
fn same_bits_with_slopes_of_both_kinds() {
    same_bits_everywhere(&Scene {
        name: "slope_jump.toml",
        settings: &[
            "axis.0.x.cells=37",
            "axis.0.v.cells=29",
            "time.end=0.7",
            "inflow.value='1 + x*v'",
            "solver.method=classical",
            "solver.classical.integrator=ssp-rk3",
            "scheme.limiter=van-leer",
        ],
        axes: 1,
        datasets: LINE,
    });
    same_bits_everywhere(&Scene {
        name: "barrier2d.toml",
        settings: &[
            "axis.0.x.cells=13",
            "axis.1.x.cells=7",
            "time.end=0.7",
            "potential.0.value='0.2 + 0.1*x - 0.1*y'",
            "solver.method=classical",
            "solver.classical.integrator=forward-euler",
            "scheme.limiter=minmod",
        ],
        axes: 2,
        datasets: PLANE,
    });
}

// ---------------------------------------------------------------------------------------------------------------------
// Measure-valued data

/// The fields `phi`, `psi_x` of one run, with one matrix and one pass over the modes, are those of runs of their own with
/// plain data: the same bits by the classical method, within the tolerance by the other, whose plan follows the field.
#[test]
fn fields_of_one_run_are_those_of_runs_of_their_own() {
    let size = ["axis.0.x.cells=38", "axis.0.v.cells=30", "time.end=0.9"];
    let measure: String = std::fs::read_to_string(case("example2.toml")).unwrap();
    let w = "0.9 if x <= -2 else 0.9 - 0.225*(x + 2)^2 if x <= 0 else -0.9 + 0.225*(x - 2)^2 if x < 2 else -0.9";
    let (before, after) = (
        measure.find("[initial]").unwrap(),
        measure.find("[time]").unwrap(),
    );
    let plain = |f: &str| {
        format!(
            "{}[initial]\nf = \"{f}\"\n[inflow]\nvalue = \"initial\"\n{}",
            &measure[..before],
            &measure[after..]
        )
    };
    let place = directory();
    let file = |name: &str, text: String| {
        let path = place.path().join(name);
        std::fs::write(&path, text).unwrap();
        path.display().to_string()
    };
    let runs = [
        file("measure.toml", measure.clone()),
        file("phi.toml", plain("1")),
        file("psi.toml", plain(&format!("v - ({w})"))),
    ];
    for (method, limit) in [("classical", 0.0), ("schrodingerized", 2e-9)] {
        let solved = runs.each_ref().map(|path| {
            let results = directory();
            let job = Job::new(["run", path]).set(&size).set(&[
                &format!("solver.method={method}"),
                "solver.tolerance=1e-9",
                "exact={}",
            ]);
            job.on(2).solve(results.path()).unwrap();
            datasets(results.path()).unwrap()
        });
        let [together, phi, psi] = solved;
        for (name, alone) in [("/phi", phi), ("/psi", psi)] {
            let found = distance(&together[name].numbers(), &alone["/f"].numbers());
            assert!(found <= limit, "{method}: {name} differs by {found:e}");
        }
    }
}

/// Example 2: errors of density and mean velocity fall with the cells, and the mass with them towards the exact one,
/// 4 + 2 · 0.9 · 1.8.
#[test]
fn error_of_example_2_against_the_exact_moments() {
    for interface in INTERFACES {
        let rows = [64, 256].map(|cells| {
            let place = directory();
            let summary = run("example2.toml")
                .set(&[
                    "solver.method=classical",
                    &format!("scheme.interface={interface}"),
                    &format!("axis.0.x.cells={cells}"),
                    &format!("axis.0.v.cells={cells}"),
                ])
                .solve(place.path())
                .unwrap();
            let number = |key: &str| summary.number(key).unwrap();
            assert!((number("mass_exact") - 7.24).abs() < 1e-6);
            let mass = (number("mass") - number("mass_exact")).abs();
            let errors = ["error_density_l1", "error_velocity_l1"].map(number);
            [errors[0], errors[1], mass]
        });
        let [coarse, fine] = rows;
        for (k, limit) in [1.3, 0.25, 0.3].into_iter().enumerate() {
            let falls = fine[k] < 0.8 * coarse[k] && fine[k] < limit;
            assert!(falls, "{interface}: {coarse:?} {fine:?}");
        }
    }
}

/// Moments in the file are those of its `phi` and `psi` by the paper's formula, recomputed here in two dimensions.
#[test]
fn moments_of_example_3_are_those_of_its_level_sets() {
    let place = directory();
    run("example3.toml").on(2).solve(place.path()).unwrap();
    let all = datasets(place.path()).unwrap();
    let numbers = |name: &str| all[name].numbers();
    let (phi, psi, density) = (numbers("/phi"), numbers("/psi"), numbers("/density"));
    let (momentum, axis) = (numbers("/momentum"), numbers("/axis/vx"));
    let (n, h) = (8, 0.075);
    let mut most: f64 = 0.0;
    for x in 0..n * n {
        let at = |a: usize, i: usize, j: usize| psi[((a * n * n + x) * n + i) * n + j];
        let around = |i: usize| (i.saturating_sub(1), (i + 1).min(n - 1));
        let (mut rho, mut m) = (0.0, 0.0);
        for i in 0..n {
            for j in 0..n {
                let ((a, b), (c, d)) = (around(i), around(j));
                let by_x = |k| (at(k, b, j) - at(k, a, j)) / ((b - a) as f64 * h);
                let by_y = |k| (at(k, i, d) - at(k, i, c)) / ((d - c) as f64 * h);
                let determinant: f64 = by_x(0) * by_y(1) - by_y(0) * by_x(1);
                let omega = determinant.abs().max(1.0) * h;
                let mut f = phi[(x * n + i) * n + j] * h * h;
                for k in 0..2 {
                    let y = at(k, i, j) / omega;
                    let bell = (1.0 + (std::f64::consts::PI * y).cos()) / (2.0 * omega);
                    f *= if y.abs() <= 1.0 { bell } else { 0.0 };
                }
                rho += f;
                m += axis[i] * f;
            }
        }
        assert!(
            (rho - density[x]).abs() < 1e-12,
            "{x}: {rho} {}",
            density[x]
        );
        assert!((m - momentum[x]).abs() < 1e-12, "{x}: {m}");
        most = most.max(rho);
    }
    assert!(most > 1.0);
}

#[test]
fn mistakes_in_measure_valued_data_are_refused() {
    let rows: &[(&str, &[&str])] = &[
        ("initial.f=1", &["initial.f", "either"]),
        (
            "initial.velocity=[]",
            &["initial.velocity", "0 formulas", "list of 1"],
        ),
        (
            "initial.velocity=[\"0\", \"1\"]",
            &["initial.velocity", "2 formulas", "list of 1"],
        ),
        (
            "initial.velocity=0.9*x",
            &["initial.velocity", "a list of formulas"],
        ),
        (
            "initial.velocity=[true]",
            &["initial.velocity", "a list of formulas"],
        ),
        (
            "initial.velocity=[\"v\"]",
            &["initial.velocity", "unknown name \"v\""],
        ),
        (
            "initial.density=v^2",
            &["initial.density", "unknown name \"v\""],
        ),
        ("initial.density=sqrt(x)", &["initial.density", "NaN"]),
        (
            "initial.velocity=[\"sqrt(x)\"]",
            &["initial.velocity", "NaN"],
        ),
        ("exact={f=\"x\"}", &["exact.f", "measure-valued"]),
        (
            "output.delta_width=wide",
            &["output.delta_width", "determinant", "gradient"],
        ),
        (
            "initial={density=\"1\"}",
            &["initial.velocity", "list of 1"],
        ),
        (
            "initial={velocity=[\"1\"]}",
            &["initial.density", "missing"],
        ),
    ];
    check_all(rows, |(setting, says)| {
        let finished = check("example2.toml").set(&[setting]).run()?;
        refused(&finished, says)
    });
}

// ---------------------------------------------------------------------------------------------------------------------
// Bad input

/// Refused as a mistake of the user: exit code 2, soon, with one message, from rank 0, that says all of `says`.
fn refused(finished: &Finished, says: &[&str]) -> Result<(), String> {
    let message = &finished.errors;
    require(finished.code == Some(2), finished, || {
        "exit code 2 expected".into()
    })?;
    require(finished.others.is_empty(), finished, || {
        "only rank 0 speaks".into()
    })?;
    let errors = message.matches("error: ").count();
    require(errors == 1, finished, || {
        format!("one message expected, \"error: \" occurs {errors} times")
    })?;
    let before = message.split("error: ").next().unwrap_or_default();
    let at_once = before.lines().all(|l| l.starts_with("warning: "));
    require(at_once, finished, || {
        format!("said before it was refused: {before}")
    })?;
    for crash in ["panicked", "backtrace", "RUST_BACKTRACE", "signal"] {
        require(!message.contains(crash), finished, || {
            format!("\"{crash}\"")
        })?;
    }
    for words in says {
        require(message.contains(words), finished, || {
            format!("the message does not say \"{words}\"")
        })?;
    }
    let seconds = finished.seconds;
    require(seconds < SECONDS_TO_REFUSE, finished, || {
        format!("refused after {seconds:.1} s")
    })
}

/// `cases/example1.toml` with the one occurrence of `old` replaced, written into `place`; the file and the line of it.
fn edited(place: &Path, old: &str, new: &str) -> (PathBuf, usize) {
    let text = std::fs::read_to_string(case("example1.toml")).unwrap();
    let found: Vec<usize> = text.match_indices(old).map(|(at, _)| at).collect();
    assert_eq!(
        found.len(),
        1,
        "\"{old}\" occurs {} times in example1.toml",
        found.len()
    );
    let line = 1 + text[..found[0]].matches('\n').count();
    let path = place.join("edited.toml");
    std::fs::write(&path, text.replace(old, new)).unwrap();
    (path, line)
}

#[test]
fn mistakes_in_the_file_are_named_with_their_line() {
    const X: &str = "x = { lower = -1.5, upper = 1.5, cells = 128 }";
    let rows: &[(&str, &str, &[&str])] = &[
        // Unknown keys, with the nearest known one.
        (
            "tolerance = 1e-6",
            "tolerence = 1e-6",
            &["solver.tolerence", "mean \"tolerance\""],
        ),
        (
            "[solver.propagator]",
            "[solver.propogator]",
            &["propogator", "mean \"propagator\""],
        ),
        ("title     =", "tittle    =", &["tittle", "mean \"title\""]),
        (
            "end = 1.0",
            "end = 1.0\nbegin = 0",
            &["time.begin", "known here: end"],
        ),
        // Wrong types.
        (
            "tolerance = 1e-6",
            "tolerance = \"small\"",
            &["solver.tolerance", "\"small\"", "number"],
        ),
        (
            "verify    = false",
            "verify    = 0",
            &["solver.verify", "0", "true or false"],
        ),
        (
            "end = 1.0",
            "end = 1979-05-27",
            &["time.end", "1979-05-27", "number"],
        ),
        ("end = 1.0", "end = [1.0]", &["time.end", "number"]),
        (X, "x = 128", &["axis.0.x", "128", "table"]),
        (
            "value = \"0.2\"",
            "value = true",
            &["potential.0.value", "true", "formula"],
        ),
        (
            "title     = \"Step down (example 1)\"",
            "title = 1",
            &["title", "1", "text"],
        ),
        // The inflow's embedding and the shift; t only where it means something.
        (
            "inflow  = \"boundary\"",
            "inflow  = \"diagonal\"",
            &[
                "solver.warp.inflow",
                "diagonal",
                "boundary",
                "full",
                "scalar",
            ],
        ),
        (
            "inflow  = \"boundary\"",
            "inflow  = \"full\"\ndelta = 0",
            &["solver.warp.delta", "0", "above 0", "max"],
        ),
        (
            "inflow  = \"boundary\"",
            "inflow  = \"full\"\ndelta = -1.5",
            &["solver.warp.delta", "-1.5", "above 0"],
        ),
        (
            "inflow  = \"boundary\"",
            "inflow  = \"full\"\ndelta = \"mx\"",
            &["solver.warp.delta", "mx", "mean \"max\""],
        ),
        (
            "inflow  = \"boundary\"",
            "shift = inf",
            &["solver.warp.shift", "inf", "finite"],
        ),
        (
            "inflow  = \"boundary\"",
            "shift = \"growht\"",
            &["solver.warp.shift", "growht", "mean \"growth\""],
        ),
        (
            "value = \"0.2\"",
            "value = \"0.2*t\"",
            &["potential.0.value", "unknown name \"t\""],
        ),
        (
            "f = \"1 if x^2",
            "f = \"t if x^2",
            &["initial.f", "unknown name \"t\""],
        ),
        // Cell counts.
        (
            X,
            "x = { lower = -1.5, upper = 1.5, cells = 0 }",
            &["axis.0.x.cells", "0", "at least 1"],
        ),
        (
            X,
            "x = { lower = -1.5, upper = 1.5, cells = -7 }",
            &["axis.0.x.cells", "-7", "at least 1"],
        ),
        (
            X,
            "x = { lower = -1.5, upper = 1.5, cells = 12.5 }",
            &["axis.0.x.cells", "12.5", "whole"],
        ),
        (
            X,
            "x = { lower = -1.5, upper = 1.5, cells = 10000000000000000 }",
            &["axis.0.x.cells", "memory"],
        ),
        (
            X,
            "x = { lower = -1.5, upper = 1.5, cells = 99999999999999999999 }",
            &["axis.0.x.cells", "99999999999999999999"],
        ),
        (
            X,
            "x = { lower = -1.5, upper = 1.5 }",
            &["axis.0.x.cells", "missing"],
        ),
        // Bounds.
        (
            X,
            "x = { lower = 1.5, upper = -1.5, cells = 128 }",
            &["axis.0.x.upper", "-1.5", "above", "1.5"],
        ),
        (
            X,
            "x = { lower = 1.5, upper = 1.5, cells = 128 }",
            &["axis.0.x.upper", "1.5", "above"],
        ),
        (
            X,
            "x = { lower = 1.0, upper = 1.0000000000000002, cells = 128 }",
            &["axis.0.x", "double precision"],
        ),
        (
            X,
            "x = { lower = -1e308, upper = 1e308, cells = 128 }",
            &["axis.0.x", "1e100"],
        ),
        // Numbers that are none.
        (
            X,
            "x = { lower = nan, upper = 1.5, cells = 128 }",
            &["axis.0.x.lower", "nan", "finite"],
        ),
        (
            X,
            "x = { lower = -1.5, upper = inf, cells = 128 }",
            &["axis.0.x.upper", "inf", "finite"],
        ),
        (
            X,
            "x = { lower = -1e999, upper = 1.5, cells = 128 }",
            &["axis.0.x.lower", "1e999", "finite"],
        ),
        ("end = 1.0", "end = nan", &["time.end", "nan", "finite"]),
        ("end = 1.0", "end = -inf", &["time.end", "inf", "finite"]),
        ("end = 1.0", "end = 0", &["time.end", "0", "above 0"]),
        ("end = 1.0", "end = -1.0", &["time.end", "-1", "above 0"]),
        (
            "cfl        = 0.9",
            "cfl = 1.5",
            &["solver.classical.cfl", "1.5", "at most 1"],
        ),
        // Tolerances.
        (
            "tolerance = 1e-6",
            "tolerance = 0",
            &["solver.tolerance", "0", "above 0", "0.1"],
        ),
        (
            "tolerance = 1e-6",
            "tolerance = -1e-6",
            &["solver.tolerance", "-1e-6", "above 0"],
        ),
        (
            "tolerance = 1e-6",
            "tolerance = 1",
            &["solver.tolerance", "1", "at most 0.1"],
        ),
        (
            "tolerance = 1e-6",
            "tolerance = nan",
            &["solver.tolerance", "nan", "finite"],
        ),
        // Formulas.
        (
            "value = \"0.2\"",
            "value = \"0.2 +* x\"",
            &["potential.0.value", "0.2 +* x", "character 6"],
        ),
        (
            "value = \"0.2\"",
            "value = \"0.2*v\"",
            &["potential.0.value", "0.2*v", "\"v\""],
        ),
        (
            "value = \"0.2\"",
            "value = \"(1 + 2\"",
            &["potential.0.value", "(1 + 2"],
        ),
        ("value = \"0.2\"", "value = \"\"", &["potential.0.value"]),
        (
            "where = \"x < 0\"",
            "where = \"x < < 0\"",
            &["potential.0.where", "x < < 0", "character 5"],
        ),
        (
            "where = \"x < 0\"",
            "where = \"y < 0\"",
            &["potential.0.where", "\"y\"", "known here: x"],
        ),
        (
            "where = \"x < 0\"",
            "where = \"sine(x) < 0\"",
            &["potential.0.where", "\"sine\"", "sin"],
        ),
        // Regions.
        (
            "value = \"0\"                                           # low side",
            "where = \"x > 0\"\nvalue = \"0\"  # low side",
            &["potential.1.where", "x > 0", "last"],
        ),
        (
            "where = \"x < 0\"",
            "",
            &["potential.0.where", "missing", "last"],
        ),
        // Choices.
        (
            "interface = \"hat\"",
            "interface = \"hatt\"",
            &["scheme.interface", "hatt", "mean \"hat\"", "conservative"],
        ),
        (
            "method    = \"schrodingerized\"",
            "method = \"classic\"",
            &["solver.method", "mean \"classical\""],
        ),
        (
            "weights = \"dissipative\"",
            "weights = \"dissipatif\"",
            &["solver.warp.weights", "mean \"dissipative\"", "none"],
        ),
        (
            "profile = \"planned\"",
            "profile = \"gausian\"",
            &["solver.warp.profile", "mean \"gaussian\"", "low-somma"],
        ),
        (
            "profile = \"planned\"",
            "profile = \"gaussian\"\nalpha = 2",
            &["solver.warp.alpha", "2", "exponential"],
        ),
        (
            "profile = \"planned\"",
            "profile = \"smooth\"\norder = 17",
            &["solver.warp.order", "17", "between 1 and 16"],
        ),
        (
            "profile = \"planned\"",
            "profile = \"acl\"\nbeta = 1.0",
            &["solver.warp.beta", "0.95"],
        ),
        (
            "profile = \"planned\"",
            "profile = \"designed\"\npoints = 32",
            &["solver.warp.points", "designed", "gaussian"],
        ),
        (
            "profile = \"planned\"",
            "profile = \"designed\"\ninterval = [-50, 90]",
            &["solver.warp.interval", "designed", "gaussian"],
        ),
        (
            "profile = \"planned\"",
            "profile = \"gaussian\"\npoints = 33",
            &["solver.warp.points", "33", "even"],
        ),
        (
            "profile = \"planned\"",
            "profile = \"gaussian\"\ninterval = [1, 2]",
            &["solver.warp.interval", "[1, 2]", "below"],
        ),
        (
            "profile = \"planned\"",
            "profile = \"gaussian\"\ninterval = [-1, 2, 3]",
            &["solver.warp.interval", "two numbers"],
        ),
        (
            "profile = \"planned\"",
            "profile = \"gaussian\"\nrecovery = -1",
            &["solver.warp.recovery", "-1", "between 0"],
        ),
        (
            "integrator = \"exponential\"",
            "integrator = \"rk4\"",
            &["solver.classical.integrator", "rk4", "ssp-rk3"],
        ),
        (
            "kind = \"characteristics\"",
            "kind = \"exact\"",
            &["exact.kind", "exact", "characteristics"],
        ),
        (
            "kind = \"characteristics\"",
            "kind = \"characteristics\"\nf = \"0\"",
            &["exact.f", "either"],
        ),
        (
            "recovery_points = 2",
            "recovery_points = 3",
            &["output.recovery_points", "3", "1", "2"],
        ),
        (
            "recovery_points = 2",
            "recovery_points = 2\nplateau = { points = 1 }",
            &["output.plateau.points", "1", "at least 2"],
        ),
        (
            "recovery_points = 2",
            "recovery_points = 2\nplateau = { from = 2, to = 1 }",
            &["output.plateau.to", "above from = 2"],
        ),
        (
            "recovery_points = 2",
            "recovery_points = 2\nmoment_times = [0.5, 1.0]",
            &["output.moment_times", "1 given", "below time.end = 1"],
        ),
        (
            "recovery_points = 2",
            "recovery_points = 2\nfield_times = 0.5",
            &["output.field_times", "0.5", "list of numbers"],
        ),
        (
            "recovery_points = 2",
            "recovery_points = 2\nmoments_every = 0",
            &["output.moments_every", "above 0"],
        ),
        (
            "recovery_points = 2",
            "recovery_points = 2\ncompression = 10",
            &["output.compression", "10", "0 (none) to 9"],
        ),
        (
            "recovery_points = 2",
            "recovery_points = 2\ncompression = \"gzip\"",
            &["output.compression", "gzip", "whole number"],
        ),
        (
            "recovery_points = 2",
            "recovery_points = 2\nchunks = [8]",
            &["output.chunks", "list of 2 whole numbers"],
        ),
        (
            "recovery_points = 2",
            "recovery_points = 2\nchunks = [8, 0]",
            &["output.chunks", "whole numbers above 0"],
        ),
        (
            "recovery_points = 2",
            "recovery_points = 2\nxdmf = 1",
            &["output.xdmf", "true or false"],
        ),
        // No TOML.
        ("end = 1.0", "end = = 1.0", &[]),
        ("end = 1.0", "end = 1.0 2.0", &[]),
        ("interface = \"hat\"", "interface = \"hat", &[]),
        (
            "recovery_points = 2",
            "recovery_points = 2\n[time]",
            &["time"],
        ),
    ];
    check_all(rows, |(old, new, says)| {
        let place = directory();
        let (path, mut line) = edited(place.path(), old, new);
        // A mistake on a later line of the new text, where that is what is wrong.
        if new.contains('\n') && !new.starts_with("where") {
            line += 1;
        }
        let path = path.display().to_string();
        let finished = Job::new(["check", &path]).on(2).within(20).run()?;
        let mut says = says.to_vec();
        let location = format!("{path}:{line}:");
        // A key that is missing is missed in its table, which starts further up.
        let missing = says.contains(&"missing");
        says.push(if missing { &path } else { &location });
        refused(&finished, &says).map_err(|e| format!("{old}  ->  {new}\n{e}"))
    });
}

/// A key that must be there and is misspelt: missing, and the nearest to it is known.
/// Slopes are not linear: refused wherever a matrix is needed.
#[test]
fn slopes_where_none_can_be_are_refused() {
    let rows: &[(&[&str], &[&str])] = &[
        (&[], &["schrodingerized", "not linear", "ssp-rk3"]),
        (&SLOPES[..1], &["exponential", "not linear", "ssp-rk3"]),
        (
            &[SLOPES[0], SLOPES[1], "solver.verify=true"],
            &["solver.verify"],
        ),
    ];
    check_all(rows, |(settings, says)| {
        let job = check("example1.toml")
            .set(&["scheme.limiter=van-leer"])
            .set(settings);
        let finished = job.on(2).run()?;
        refused(&finished, says)?;
        refused(&finished, &["scheme.limiter", "van-leer"])
    });
    let job = check("example1.toml").set(&["scheme.limiter=superbee"]);
    let finished = job.set(&SLOPES).on(2).run().unwrap();
    refused(&finished, &["superbee", "minmod", "van-leer"]).unwrap();
}

#[test]
fn misspelt_keys_that_must_be_there_are_named() {
    let place = directory();
    let (path, line) = edited(place.path(), "end = 1.0", "edn = 1.0");
    let path = path.display().to_string();
    let finished = Job::new(["check", &path]).run().unwrap();
    let location = format!("{path}:{line}:");
    refused(&finished, &["edn", "mean \"end\"", &location]).unwrap();
}

/// An implicit method without its step, in the file or set from outside.
#[test]
fn a_missing_step_is_named_with_its_place() {
    let place = directory();
    for method in ["crank-nicolson", "backward-euler"] {
        let new = format!("method = \"{method}\"");
        let (path, _) = edited(place.path(), "method = \"chebyshev\"", &new);
        let path = path.display().to_string();
        let finished = Job::new(["check", &path]).run().unwrap();
        refused(&finished, &["solver.propagator.step", "missing", &path]).unwrap();
        let setting = format!("solver.propagator.method={method}");
        let finished = check("example1.toml").set(&[&setting]).run().unwrap();
        refused(&finished, &["solver.propagator.step", "missing"]).unwrap();
    }
}

#[test]
fn mistakes_in_a_set_option_are_named_with_its_text() {
    let rows: &[(&str, &[&str])] = &[
        (
            "solver.tolerence=1e-3",
            &["solver.tolerence", "mean \"tolerance\""],
        ),
        ("solvre.tolerance=1e-3", &["solvre", "mean \"solver\""]),
        (
            "solver.tolerance=small",
            &["solver.tolerance", "\"small\"", "number"],
        ),
        ("solver.tolerance=", &["solver.tolerance", "number"]),
        (
            "solver.tolerance=1",
            &["solver.tolerance = 1", "at most 0.1"],
        ),
        (
            "solver.tolerance=-1e-3",
            &["solver.tolerance = -1e-3", "above 0"],
        ),
        ("axis.0.x.cells=0", &["axis.0.x.cells = 0", "at least 1"]),
        ("axis.0.x.cells=-3", &["axis.0.x.cells = -3", "at least 1"]),
        ("axis.5.x.cells=3", &["\"5\"", "axis", "1 entries"]),
        ("axis.x.x.cells=3", &["\"x\"", "axis", "index"]),
        ("axis.0.x.cells.more=3", &["axis.0.x.cells", "not a table"]),
        (
            "axis.0.x.upper=-2",
            &["axis.0.x.upper = -2", "above", "-1.5"],
        ),
        ("time.end=inf", &["time.end = inf", "finite"]),
        (
            "solver.propagator.step=0.1",
            &["solver.propagator.step = 0.1", "Chebyshev", "leave it out"],
        ),
        (
            "solver.propagator.method=crank",
            &["solver.propagator.method", "\"crank-nicolson\""],
        ),
        (
            "solver.propagator={method='crank-nicolson',step=0}",
            &["solver.propagator.step = 0", "above 0"],
        ),
        (
            "solver.propagator={method='krylov',step=-0.1}",
            &["solver.propagator.step = -0.1", "above 0"],
        ),
        (
            "solver.propagator={method='backward-euler',step=1e-9}",
            &["solver.propagator.step = 1e-9", "steps"],
        ),
        ("time.end=nan", &["time.end = nan", "finite"]),
        ("initial.f=x + * v", &["initial.f", "character 5"]),
        ("inflow.value=1 +", &["inflow.value"]),
        ("potential=[]", &["potential", "at least one"]),
        ("potential=3", &["potential", "list of tables"]),
        (
            "scheme.interface=hats",
            &["scheme.interface", "mean \"hat\""],
        ),
        ("time", &["key=value"]),
        ("=3", &["key"]),
    ];
    check_all(rows, |(setting, says)| {
        let finished = check("example1.toml")
            .set(&[setting])
            .on(2)
            .within(20)
            .run()?;
        let text = format!("--set {setting}: ");
        let says: Vec<&str> = says.iter().copied().chain([text.as_str()]).collect();
        refused(&finished, &says)
    });
}

/// More cells than there is memory for: refused before anything is allocated, whatever is to be done with them.
#[test]
fn grids_beyond_the_memory_are_refused() {
    let rows: &[(&str, [&str; 2], &[&str])] = &[
        (
            "run",
            ["axis.0.x.cells=1000000000", "axis.0.v.cells=1000000000"],
            &[],
        ),
        (
            "plan",
            ["axis.0.x.cells=1000000000", "axis.0.v.cells=1000000000"],
            &[],
        ),
        (
            "check",
            ["axis.0.x.cells=1000000000", "axis.0.v.cells=1000000000"],
            &[],
        ),
        ("run", ["axis.0.x.cells=40000", "axis.0.v.cells=40000"], &[]),
        (
            "run",
            ["axis.0.x.cells=40000", "axis.0.v.cells=40000"],
            &["solver.method=classical"],
        ),
        (
            "run",
            ["axis.0.x.cells=1000000000", "axis.0.v.cells=2"],
            &[],
        ),
        (
            "run",
            ["axis.0.x.cells=2", "axis.0.v.cells=1000000000"],
            &[],
        ),
        (
            "run",
            ["axis.0.x.cells=1000000000", "axis.0.v.cells=1000"],
            &["scheme.interface=conservative"],
        ),
    ];
    check_all(rows, |(command, cells, settings)| {
        let place = directory();
        let mut job = Job::new([*command, &case("example1.toml")])
            .set(cells)
            .set(settings);
        if *command == "run" {
            job = job.into(place.path());
        }
        refused(&job.on(2).within(20).capped().run()?, &["memory", "cells"])
    });
    let plan = plan("example1.toml", 4).with(["--memory-per-rank", "1MB"]);
    refused(&plan.run().unwrap(), &["memory", "needed", "976.6 KiB"]).unwrap();
}

/// As above, for `spectrum`, which needs the matrix; a refinement too many is found before the first grid is computed.
#[test]
fn spectrum_of_a_grid_beyond_the_memory_is_refused() {
    let more: &[(&str, &str, &[&str])] = &[
        ("example1.toml", "1,64", &["axis.0.x.cells=2000"]),
        ("step_slope3d.toml", "1,64", &[]),
        ("barrier2d.toml", "20", &[]),
    ];
    check_all(more, |(name, refine, settings)| {
        let job = Job::new(["spectrum", &case(name), "--refine", refine]);
        let job = job.set(settings).on(2).within(20).capped();
        refused(&job.run()?, &["memory", "cells"])
    });
    let job = Job::new(["spectrum", &case("example1.toml")]);
    let job = job.set(&["axis.0.x.cells=40000", "axis.0.v.cells=40000"]);
    let job = job.on(2).within(20).capped();
    refused(&job.run().unwrap(), &["memory"]).unwrap();
}

/// However many cells, `plan` and `check` answer or refuse.
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
        let job = Job::new([*command, &case("example1.toml")]).set(cells);
        let finished = job.within(SECONDS_TO_REFUSE as u64).capped().run()?;
        match finished.code {
            Some(0) => Ok(()),
            _ => refused(&finished, &["memory"]),
        }
    });
}

/// Numbers that are finite and yet absurd: too long, too fast, too fine. Solved, or refused naming a key.
#[test]
fn absurd_scales_are_refused() {
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
    check_all(rows, |(command, settings)| {
        let place = directory();
        let small = ["axis.0.x.cells=16", "axis.0.v.cells=16"];
        let mut job = Job::new([*command, &case("example1.toml")])
            .set(&small)
            .set(settings);
        if *command == "run" {
            job = job.set(&["solver.verify=true"]).into(place.path());
        }
        let finished = job.on(2).within(20).capped().run()?;
        if *command == "plan" && finished.code == Some(0) {
            return Ok(());
        }
        solved_or_refused(&finished, place.path(), 1e-6, &[])
    });
}

const NOT_FINITE: &[(&str, &str, &[&str])] = &[
    ("initial.f", "sqrt(-x)", &["NaN", "x = 0.0", "v = -1.4"]),
    (
        "initial.f",
        "1/(x - 0.01171875)",
        &["inf", "x = 0.01171875"],
    ),
    ("initial.f", "exp(800*abs(v))", &["inf", "v = -1.4"]),
    // Found by one rank only, which need not be the first.
    ("initial.f", "sqrt(1.4 - x)", &["NaN", "x = 1.4"]),
    ("potential.0.value", "1/(x + 1.5)", &["inf", "x = -1.5"]),
    ("potential.0.value", "sqrt(-1.4 - x)", &["NaN", "x = -1.3"]),
    ("inflow.value", "ln(v)", &["NaN", "v = -"]),
    ("inflow.value", "1e308*v^2*1e10", &["inf", "x = -1.5"]),
];

/// A formula that yields no number somewhere: named, with its text, the value and the place.
#[test]
fn formulas_that_are_not_finite_are_named_with_the_place() {
    check_all(NOT_FINITE, |(key, formula, says)| {
        let place = directory();
        let job = run("example1.toml").set(&[&format!("{key}=\"{formula}\"")]);
        let job = job.with(["--ranks-x", "2"]).into(place.path());
        let finished = job.on(2).within(20).run()?;
        let says: Vec<&str> = says.iter().copied().chain([*formula, *key]).collect();
        refused(&finished, &says)
    });
}

/// `check` refuses what `run` will refuse for its formulas.
#[test]
fn check_finds_formulas_that_are_not_finite() {
    check_all(NOT_FINITE, |(key, formula, says)| {
        let job = check("example1.toml").set(&[&format!("{key}=\"{formula}\"")]);
        refused(&job.run()?, says)
    });
}

/// A condition that yields no number is a mistake too, not false.
#[test]
fn conditions_that_are_not_finite_are_refused() {
    let job = check("example1.toml").set(&["potential.0.where=\"sqrt(x)\""]);
    refused(&job.run().unwrap(), &["where", "sqrt(x)", "NaN"]).unwrap();
}

/// An exact solution that yields no number is found before the solve, not after it.
#[test]
fn exact_solution_is_checked_before_the_solve() {
    let place = directory();
    let job = run("example1.toml").set(&["exact={f=\"sqrt(-x)\"}"]);
    let finished = job.into(place.path()).on(2).within(20).run().unwrap();
    refused(&finished, &["exact.f", "sqrt(-x)", "NaN", "x = 0.0"]).unwrap();
}

/// Mistakes that only the grid or the plan brings to light say in which file they are.
#[test]
fn late_mistakes_name_the_file() {
    let rows = [
        ("value = \"0.2\"", "value = \"1/(x + 1.5)\"", "potential"),
        ("tolerance = 1e-6", "tolerance = 1e-15", "solver.tolerance"),
    ];
    check_all(&rows, |(old, new, key)| {
        let place = directory();
        let (path, _) = edited(place.path(), old, new);
        let path = path.display().to_string();
        let finished = Job::new(["plan", &path]).run()?;
        refused(&finished, &[key, &path])
    });
}

/// A file that is none, or cannot be one.
#[test]
fn files_that_are_no_case_are_refused() {
    let deep = |open: &str, middle: &str, close: &str| {
        format!(
            "a = {}{middle}{}\n",
            open.repeat(20_000),
            close.repeat(20_000)
        )
    };
    let text = std::fs::read_to_string(case("example1.toml")).unwrap();
    let formula = |f: String| text.replace("value = \"0.2\"", &format!("value = \"{f}\""));
    let rows: Vec<(&str, Vec<u8>, &[&str])> = vec![
        ("empty", b"".to_vec(), &["axis", "1 to 3"]),
        ("comment", b"# nothing\n".to_vec(), &["axis"]),
        ("prose", b"this is not a case file\n".to_vec(), &[":1:"]),
        (
            "binary",
            vec![0x89, b'H', b'D', b'F', 0xff, 0xfe, 0],
            &["UTF-8"],
        ),
        ("zeros", vec![0; 1000], &[]),
        ("json", b"{\"axis\": 3}".to_vec(), &[":1:"]),
        ("large", vec![b'#'; (1 << 20) + 1], &["1048576"]),
        ("lists", deep("[", "", "]").into_bytes(), &["recurs"]),
        ("tables", deep("{a=", "1", "}").into_bytes(), &["recurs"]),
        (
            "key",
            format!("{}a = 1\n", "a.".repeat(20_000)).into_bytes(),
            &["recurs"],
        ),
        (
            "heading",
            format!("[{}a]\n", "a.".repeat(20_000)).into_bytes(),
            &["recurs"],
        ),
        (
            "parentheses",
            formula(format!("{}1{}", "(".repeat(60), ")".repeat(60))).into_bytes(),
            &["potential.0.value", "nested"],
        ),
        (
            "functions",
            formula(format!("{}x{}", "abs(".repeat(900), ")".repeat(900))).into_bytes(),
            &["potential.0.value", "nested"],
        ),
        (
            "signs",
            formula(format!("{}x", "-".repeat(9_000))).into_bytes(),
            &["potential.0.value", "nested"],
        ),
        (
            "powers",
            formula(format!("x{}", "^x".repeat(4_000))).into_bytes(),
            &["potential.0.value", "nested"],
        ),
        (
            "terms",
            formula(format!("x{}", "+x".repeat(6_000))).into_bytes(),
            &["potential.0.value", "10000"],
        ),
    ];
    check_all(&rows, |(name, bytes, says)| {
        let place = directory();
        let path = place.path().join(format!("{name}.toml"));
        std::fs::write(&path, bytes).map_err(|e| e.to_string())?;
        let path = path.display().to_string();
        let finished = Job::new(["check", &path]).on(2).within(20).run()?;
        let says: Vec<&str> = says.iter().copied().chain([path.as_str()]).collect();
        refused(&finished, &says)
    });
    // The longest list of terms that is read does no harm.
    let place = directory();
    let path = place.path().join("long.toml");
    std::fs::write(&path, formula(format!("x{}", "+x".repeat(4_900)))).unwrap();
    Job::new(["check", &path.display().to_string()])
        .succeed()
        .unwrap();
}

/// Messages can be read: a value of thousands of characters is not repeated in full.
#[test]
fn messages_stay_short() {
    let long = format!("initial.f=\"{}\"", "-".repeat(9_000));
    let finished = check("example1.toml").set(&[&long]).run().unwrap();
    refused(&finished, &["initial.f"]).unwrap();
    let length = finished.errors.chars().count();
    assert!(
        length <= LONGEST_MESSAGE,
        "a message of {length} characters"
    );
}

#[test]
fn mistakes_on_the_command_line_are_refused() {
    let place = directory();
    let out = place.path().join("out").display().to_string();
    let (example, plane) = (case("example1.toml"), case("barrier2d.toml"));
    let folder = place.path().display().to_string();
    let says_folder = [folder.as_str(), "directory"];
    let nowhere = place.path().join("nowhere.toml").display().to_string();
    let rows: Vec<(Vec<&str>, &[&str])> = vec![
        (vec!["chekc", &example], &["'chekc'", "'check'"]),
        (vec!["check", &example, "--frobnicate"], &["'--frobnicate'"]),
        (
            vec!["run", &example, "--ouput", "x"],
            &["'--ouput'", "'--output'"],
        ),
        (vec!["check"], &["<CASE>"]),
        (vec!["check", &nowhere], &["nowhere.toml", "No such file"]),
        (vec!["run", &nowhere], &["nowhere.toml", "No such file"]),
        (vec!["check", &folder], &says_folder),
        (
            vec!["plan", &example, "--ranks", "0"],
            &["'0'", "--ranks", "1..="],
        ),
        (vec!["plan", &example, "--ranks", "-1"], &["-1"]),
        (
            vec!["plan", &example, "--ranks", "two"],
            &["'two'", "--ranks"],
        ),
        (
            vec!["plan", &example, "--memory-per-rank", "4 parsecs"],
            &["4 parsecs", "--memory-per-rank", "GiB"],
        ),
        (
            vec!["plan", &example, "--ranks", "6", "--ranks-x", "4"],
            &["--ranks-x", "4", "6", "1, 2, 3, 6"],
        ),
        (
            vec!["run", &example, "-o", &out, "--ranks-x", "3"],
            &["--ranks-x", "3 blocks", "2 ranks", "1, 2"],
        ),
        (
            vec!["run", &example, "-o", &out, "--ranks-x", "0"],
            &["--ranks-x", "0", "1 to 128"],
        ),
        (
            vec!["run", &example, "-o", &out, "--ranks-x", "129"],
            &["--ranks-x", "129", "128 cells"],
        ),
        (
            vec!["run", &example, "-o", &out, "--ranks-x", "1,2"],
            &["--ranks-x", "2 numbers", "1 x-axes"],
        ),
        (
            vec!["run", &plane, "-o", &out, "--ranks-x", "2,2"],
            &["--ranks-x", "4 blocks", "2 ranks"],
        ),
        (
            vec![
                "run",
                &plane,
                "-o",
                &out,
                "--ranks-x",
                "1,99999999999999999999",
            ],
            &["--ranks-x"],
        ),
        (
            vec![
                "run",
                &plane,
                "-o",
                &out,
                "--ranks-x",
                "4294967296,4294967296",
            ],
            &["--ranks-x", "4294967296"],
        ),
        (
            vec!["run", &example, "-o", &out, "--ranks-x", "one"],
            &["--ranks-x", "'one'"],
        ),
        (
            vec!["run", &example, "-o", &out, "--mode", "fast"],
            &["--mode", "'fast'", "streamed"],
        ),
        (vec!["run", &example, "-o", ""], &["--output"]),
        (
            vec!["spectrum", &example, "--steps", "1"],
            &["--steps", "'1'"],
        ),
        (
            vec!["spectrum", &example, "--refine", "1,0"],
            &["--refine", "'0'", "1 to 64"],
        ),
        (
            vec!["spectrum", &example, "--refine", "65"],
            &["--refine", "'65'", "1 to 64"],
        ),
        (
            vec!["spectrum", &example, "--refine", "1,two"],
            &["--refine", "'two'", "1 to 64"],
        ),
    ];
    check_all(&rows, |(arguments, says)| {
        let job = Job::new(arguments.iter().copied());
        refused(&job.on(2).within(20).run()?, says)
    });
    assert!(
        !Path::new(&out).exists(),
        "a refused run made its output directory"
    );
    // More ranks than x-cells and modes: 3 blocks at most, and 128 ranks planned.
    let small = ["axis.0.x.cells=3", "axis.0.v.cells=2"];
    let finished = plan("example1.toml", 128).set(&small).run().unwrap();
    if finished.code != Some(0) {
        refused(&finished, &["128 ranks"]).unwrap();
    }
}

/// Every rank comes to its own end, with exit code 2, also where only one of them found the mistake.
#[test]
fn every_rank_ends_with_the_code() {
    let (example, place) = (case("example1.toml"), directory());
    let out = place.path().display().to_string();
    let rows: [&[&str]; 8] = [
        &["chekc"],
        &["check", "nowhere.toml"],
        &["check", &example, "--set", "solver.tolerance=0"],
        &[
            "run",
            &example,
            "-o",
            &out,
            "--set",
            "solver.tolerance=1e-15",
        ],
        &["run", &example, "-o", &out, "--ranks-x", "2"],
        &[
            "run",
            &example,
            "-o",
            &out,
            "--set",
            "axis.0.x.cells=10000000",
        ],
        &[
            "run",
            &example,
            "-o",
            &out,
            "--ranks-x",
            "3",
            "--set",
            "initial.f=sqrt(1.4 - x)",
        ],
        &[
            "run",
            &example,
            "-o",
            &out,
            "--ranks-x",
            "3",
            "--set",
            "initial.f=sqrt(x + 1.4)",
        ],
    ];
    check_all(&rows, |arguments| {
        let job = Job::new(arguments.iter().copied()).on(3).within(20);
        let finished = job.telling_codes().run()?;
        let said = finished.output.clone() + &finished.others;
        let codes = said.matches("ended with 2").count();
        require(codes == 3, &finished, || {
            format!("{codes} of 3 ranks ended with 2")
        })?;
        let messages = finished.errors.matches("error: ").count();
        require(messages == 1, &finished, || format!("{messages} messages"))
    });
}

/// Nothing asked for: the usage, exit code 2. Help and version: said once, exit code 0.
#[test]
fn help_is_said_once() {
    let finished = Job::new([""; 0]).on(2).run().unwrap();
    assert!(
        finished.code == Some(2) && finished.errors.matches("Usage:").count() == 1,
        "{}",
        finished.report("usage expected")
    );
    for (option, says) in [
        ("--help", "Usage:"),
        ("--version", env!("CARGO_PKG_VERSION")),
    ] {
        let finished = Job::new([option]).on(2).succeed().unwrap();
        assert_eq!(
            finished.output.matches(says).count(),
            1,
            "{}",
            finished.report(option)
        );
    }
}

/// Exit code 2, before anything is computed, and what is there stays.
#[test]
fn an_output_directory_that_cannot_be_written_is_refused() {
    let place = directory();
    let file = place.path().join("file");
    std::fs::write(&file, "kept").unwrap();
    let made = |name: &str| {
        let path = place.path().join(name);
        std::fs::create_dir_all(path.join("result.h5")).unwrap();
        path
    };
    let rows = [
        file.clone(),
        file.join("below"),
        file.join("far/below"),
        PathBuf::from("/proc/nowhere"),
        PathBuf::from("/proc"),
        PathBuf::from("/dev/null"),
        made("occupied"),
    ];
    check_all(&rows, |path| {
        let finished = run("example1.toml").into(path).on(2).within(20).run()?;
        refused(&finished, &["output", &path.display().to_string()])
    });
    assert_eq!(std::fs::read_to_string(&file).unwrap(), "kept");
}

/// A refused run leaves older results as they are; a good one replaces them.
#[test]
fn refused_runs_leave_older_results() {
    let place = directory();
    let small = ["axis.0.x.cells=16", "axis.0.v.cells=16"];
    let solve = |settings: &[&str]| {
        run("example1.toml")
            .set(&small)
            .set(settings)
            .into(place.path())
    };
    let contents = || -> BTreeMap<String, Vec<u8>> {
        std::fs::read_dir(place.path())
            .unwrap()
            .map(|e| e.unwrap())
            .map(|e| {
                (
                    e.file_name().into_string().unwrap(),
                    std::fs::read(e.path()).unwrap(),
                )
            })
            .collect()
    };
    solve(&[]).on(2).succeed().unwrap();
    let before = contents();
    assert_eq!(
        before.keys().collect::<Vec<_>>(),
        ["fields.xdmf", "result.h5", "summary.json"]
    );
    for bad in [
        "solver.tolerance=1e-15",
        "initial.f=sqrt(-x)",
        "axis.0.x.cells=0",
    ] {
        let finished = solve(&[bad]).on(2).run().unwrap();
        refused(&finished, &[]).unwrap();
        assert!(
            contents() == before,
            "{}",
            finished.report("older results changed")
        );
    }
    solve(&["time.end=0.5"]).on(2).succeed().unwrap();
    let after = contents();
    assert_eq!(
        after.keys().collect::<Vec<_>>(),
        before.keys().collect::<Vec<_>>()
    );
    assert!(
        after["result.h5"] != before["result.h5"],
        "result.h5 was not replaced"
    );
}

/// However the fields are stored, they are the same, on any ranks; also where a rank has none of them.
#[test]
fn same_bits_compressed_and_in_chunks() {
    const ODD: [&str; 2] = ["axis.0.x.cells=23", "axis.0.v.cells=17"];
    const FEW: [&str; 2] = ["axis.0.x.cells=3", "axis.0.v.cells=6"];
    let scenes: [(&str, &[&str], &str, &[usize]); 4] = [
        ("example1.toml", &ODD, "[5,4]", &[1, 2, 3, 4]),
        ("example1.toml", &FEW, "[2,5]", &[1, 2, 4, 7]),
        ("example2.toml", &ODD, "[100,3]", &[2, 3]),
        ("barrier2d.toml", &[], "[5,3,4,6]", &[1, 2, 3, 4]),
    ];
    for (name, settings, shape, ranks) in scenes {
        let plain = directory();
        run(name).set(settings).solve(plain.path()).unwrap();
        let reference = datasets(plain.path()).unwrap();
        let mut rows = Vec::new();
        for &ranks in ranks {
            let chunks = format!("output.chunks={shape}");
            rows.push((ranks, vec!["output.compression=6".to_owned()]));
            rows.push((ranks, vec![chunks.clone()]));
            rows.push((ranks, vec![chunks, "output.compression=1".to_owned()]));
        }
        check_all(&rows, |(ranks, storage)| {
            let place = directory();
            let storage: Vec<&str> = storage.iter().map(String::as_str).collect();
            let job = run(name).set(settings).set(&storage).on(*ranks);
            let summary = job.solve(place.path())?;
            let mut differ = differences(&datasets(place.path())?, &reference);
            // The text of the case does not hold what is set, but the plan is the same.
            differ.retain(|name| name != "/case");
            summary.require(differ.is_empty(), || {
                format!("other bits than plain in {}", differ.join(", "))
            })?;
            // It really is stored so.
            let file =
                hdf5::File::open(place.path().join("result.h5")).map_err(|e| e.to_string())?;
            let density = file.dataset("density").map_err(|e| e.to_string())?;
            let filters = usize::from(storage.iter().any(|s| s.contains("compression"))) * 2;
            let found = (density.is_chunked(), density.filters().len());
            summary.require(found == (true, filters), || format!("stored as {found:?}"))
        });
    }
    // Control: what compresses takes less room.
    let size = |settings: &[&str]| {
        let place = directory();
        let job = run("example1.toml").set(&["initial.f=0.5"]).set(settings);
        job.solve(place.path()).unwrap();
        std::fs::metadata(place.path().join("result.h5"))
            .unwrap()
            .len()
    };
    let (plain, compressed) = (size(&[]), size(&["output.compression=1"]));
    assert!(
        2 * compressed < plain,
        "{compressed} bytes, {plain} without"
    );
}

/// What is said about a run in its file is true; what is not wanted is not written.
#[test]
fn results_say_what_made_them() {
    let place = directory();
    let settings = ["time.end=0.5", "axis.0.x.cells=24", "axis.0.v.cells=16"];
    let job = run("example1.toml").set(&settings).on(3);
    let summary = job.solve(place.path()).unwrap();
    let attribute = |name: &str| {
        let file = hdf5::File::open(place.path().join("result.h5")).unwrap();
        let text = file
            .attr(name)
            .unwrap()
            .read_scalar::<hdf5::types::VarLenUnicode>();
        text.unwrap_or_else(|e| panic!("{name}: {e}")).to_string()
    };
    let file = hdf5::File::open(place.path().join("result.h5")).unwrap();
    assert_eq!(file.attr("ranks").unwrap().read_scalar::<u64>().unwrap(), 3);
    assert_eq!(
        file.attr("time").unwrap().read_scalar::<f64>().unwrap(),
        0.5
    );
    drop(file);
    assert!(attribute("command").ends_with(&format!("-o {}", place.path().display())));
    assert!(attribute("case_file").ends_with("cases/example1.toml"));
    assert!(
        attribute("rustc").starts_with("rustc 1."),
        "{}",
        attribute("rustc")
    );
    assert!(attribute("mpi").contains(" v") && attribute("hdf5").starts_with("1."));
    assert_eq!(summary.value["git"].as_str(), Some(&attribute("git")[..]));
    let version = Job::new(["--version"]).succeed().unwrap().output;
    assert!(version.contains(&attribute("git")), "{version}");
    // Now, to a minute or so, in whatever time zone this is.
    let now = std::process::Command::new("date")
        .args(["-u", "+%FT%H"])
        .output()
        .unwrap();
    let (now, date) = (String::from_utf8(now.stdout).unwrap(), attribute("date"));
    let turned = date.contains(":59:");
    assert!(date.starts_with(now.trim()) || turned, "{date}, not {now}");
    let stored = datasets(place.path()).unwrap();
    let case_text = std::fs::read(case("example1.toml")).unwrap();
    assert_eq!(stored["/case"].bytes, case_text);

    // Without what is shown by ParaView, and what an earlier run left of it.
    assert!(place.path().join("fields.xdmf").is_file());
    assert!(stored.contains_key("/xdmf/plane_x/f"));
    job.set(&["output.xdmf=false"]).solve(place.path()).unwrap();
    assert!(!place.path().join("fields.xdmf").exists());
    let names: Vec<String> = datasets(place.path()).unwrap().into_keys().collect();
    assert!(!names.iter().any(|name| name.contains("xdmf")), "{names:?}");
}

/// A file that is not as it was written is told, on any ranks, with the dataset that differs.
#[test]
fn damaged_results_are_found() {
    let place = directory();
    run("example2.toml")
        .set(&["axis.0.x.cells=23", "axis.0.v.cells=17", "time.end=0.3"])
        .on(2)
        .solve(place.path())
        .unwrap();
    let path = place.path().join("result.h5");
    let whole = std::fs::read(&path).unwrap();
    let look = |ranks: usize| {
        let directory = place.path().display().to_string();
        Job::new(["check-result", &directory]).on(ranks).within(20)
    };
    for ranks in 1..=4 {
        let finished = look(ranks).succeed().unwrap();
        assert!(
            finished.output.contains("datasets as written"),
            "{}",
            finished.output
        );
    }
    let found = |bytes: &[u8], ranks: usize, says: &str| {
        std::fs::write(&path, bytes).unwrap();
        let finished = look(ranks).run().unwrap();
        let told = finished.code == Some(1) && finished.errors.contains(says);
        assert!(
            told && finished.others.is_empty(),
            "{}",
            finished.report(says)
        );
    };
    for name in [
        "/psi",
        "/density",
        "/axis/x",
        "/multivalued/v",
        "/xdmf/plane_x/phi",
    ] {
        let file = hdf5::File::open(&path).unwrap();
        let dataset = file.dataset(name).unwrap();
        let last = dataset.offset().unwrap() as usize + 8 * dataset.size() - 1;
        drop((dataset, file));
        let mut bytes = whole.clone();
        bytes[last] ^= 0x40;
        for ranks in [1, 3] {
            found(
                &bytes,
                ranks,
                &format!("dataset {name} is not as it was written"),
            );
        }
        std::fs::write(&path, &whole).unwrap();
    }
    // A letter of the case.
    let title = whole.windows(8).position(|w| w == b"[[axis]]").unwrap();
    let mut bytes = whole.clone();
    bytes[title + 3] = b'A';
    found(&bytes, 2, "dataset /case");
    found(&whole[..whole.len() / 2], 2, "truncated file");
    found(&[], 2, "result.h5");
    found(b"no HDF5 at all", 2, "result.h5");
    std::fs::remove_file(&path).unwrap();
    refused(&look(2).run().unwrap(), &["result.h5"]).unwrap();
    std::fs::create_dir(&path).unwrap();
    refused(&look(2).run().unwrap(), &["result.h5", "no file"]).unwrap();
}

/// Without `-o`, results go to `results/<name of the case>`.
#[test]
fn results_have_a_place_by_default() {
    let place = directory();
    run("step3d.toml").inside(place.path()).succeed().unwrap();
    assert!(place.path().join("results/step3d/summary.json").is_file());
    assert!(place.path().join("results/step3d/result.h5").is_file());
}

// ---------------------------------------------------------------------------------------------------------------------
// Check and plan

#[test]
fn check_prints_what_was_understood() {
    check_all(&cases(), |name| {
        let finished = check(name).succeed()?;
        let text = std::fs::read_to_string(case(name)).map_err(|e| e.to_string())?;
        let value: toml::Value = toml::from_str(&text).map_err(|e| format!("{name}: {e}"))?;
        let title = value["title"].as_str().unwrap_or_default();
        let mut says = vec![title.to_owned()];
        for axis in value["axis"].as_array().into_iter().flatten() {
            for part in ["x", "v"] {
                says.push(format!("{} cells", axis[part]["cells"]));
            }
        }
        for region in value["potential"].as_array().into_iter().flatten() {
            says.push(region["value"].as_str().unwrap_or("?").to_owned());
        }
        for words in &says {
            let said = !words.is_empty() && finished.output.contains(words.as_str());
            require(said, &finished, || format!("\"{words}\" is not said"))?;
        }
        require(!finished.output.contains("warning"), &finished, || {
            "no warning expected".into()
        })
    });
}

#[test]
fn plan_works_for_every_case_and_number_of_ranks() {
    let mut rows = Vec::new();
    for name in cases() {
        for ranks in [1, 2, 3, 4, 5, 6, 7, 64] {
            rows.push((name.clone(), ranks));
        }
    }
    check_all(&rows, |(name, ranks)| {
        let plan = || plan(name, *ranks).set(shrunk(name));
        let finished = plan().with(["--json"]).succeed()?;
        let value: serde_json::Value = serde_json::from_str(&finished.output)
            .map_err(|e| finished.report(&format!("no JSON: {e}")))?;
        let mesh = &value["layout"]["mesh"];
        let blocks = mesh["space"].as_array().into_iter().flatten();
        let ranks_of_mesh: u64 = blocks
            .chain([&mesh["groups"]])
            .filter_map(|n| n.as_u64())
            .product();
        require(ranks_of_mesh == *ranks as u64, &finished, || {
            format!("a mesh of {ranks_of_mesh} ranks: {mesh}")
        })?;
        // The text says the same; looked at for one number and for many.
        if ![2, 64].contains(ranks) {
            return Ok(());
        }
        let text = plan().succeed()?;
        let applications = planned(&finished, &value)?.applications;
        for words in [
            "memory",
            "modes",
            "degree",
            &format!("{applications}"),
            &format!("{ranks}"),
        ] {
            require(text.output.contains(words), &text, || {
                format!("\"{words}\" is not said")
            })?;
        }
        Ok(())
    });
}

/// What a plan promises.
struct Planned {
    applications: f64,
    /// Bytes a rank.
    memory: f64,
}

fn planned(finished: &Finished, value: &serde_json::Value) -> Result<Planned, String> {
    let applications = value["warp"]["applications"].as_f64();
    let arrays = value["layout"]["arrays"].as_array().into_iter().flatten();
    let memory: f64 = arrays.filter_map(|a| a[1].as_f64()).sum();
    match applications {
        Some(applications) if memory > 0.0 => Ok(Planned {
            applications,
            memory,
        }),
        _ => Err(finished.report("no warp.applications or layout.arrays in the plan")),
    }
}

/// The plan, made without solving, against the run: applications within 20 %.
#[test]
fn plans_are_kept() {
    let mut rows = Vec::new();
    for name in cases() {
        for tolerance in ["1e-3", "1e-9"] {
            rows.push((name.clone(), format!("solver.tolerance={tolerance}")));
        }
    }
    check_all(&rows, |(name, tolerance)| {
        let small = shrunk(name);
        let job = plan(name, 2).set(small).set(&[tolerance]);
        let finished = job.with(["--json"]).succeed()?;
        let value =
            serde_json::from_str(&finished.output).map_err(|e| finished.report(&e.to_string()))?;
        let plan = planned(&finished, &value)?;
        let place = directory();
        let job = run(name).set(small).set(&[tolerance]).on(2);
        let summary = job.solve(place.path())?;
        let done = summary.number("matvecs")?;
        let outcome = near(
            "applications planned over done",
            plan.applications / done,
            1.0,
            0.2,
        );
        summary.require(outcome.is_ok(), || outcome.unwrap_err())?;
        let memory = summary.number("memory_planned_bytes_per_rank")?;
        let outcome = near(
            "memory planned alone over planned in the run",
            plan.memory / memory,
            1.0,
            0.2,
        );
        summary.require(outcome.is_ok(), || outcome.unwrap_err())
    });
}

/// `plan --calibrate` makes the plan of the run that it is started like, by every method, and tells its seconds, of which the steps make up the
/// whole. How near they are is measured by `make calibration`; timings decide no test.
#[test]
fn calibrated_plans_are_those_of_the_run() {
    let rows = [
        (1, "example1.toml", vec!["solver.tolerance=1e-9"]),
        (
            2,
            "example1.toml",
            vec!["solver.tolerance=1e-9", "output.moments_every=0.3"],
        ),
        (
            3,
            "example3.toml",
            vec!["axis.0.x.cells=12", "axis.1.x.cells=11"],
        ),
        (4, "inflow_barrier.toml", vec![]),
        (2, "pulsed_inflow.toml", vec![]),
        (
            2,
            "example1.toml",
            vec!["solver.propagator.method=krylov", "axis.0.x.cells=64"],
        ),
        (
            2,
            "step_up.toml",
            vec![
                "solver.propagator={method='crank-nicolson',step=0.05}",
                "solver.tolerance=1e-2",
            ],
        ),
        (
            1,
            "example1.toml",
            vec![
                "solver.method=classical",
                "solver.classical.integrator=ssp-rk3",
                "solver.classical.cfl=0.02",
            ],
        ),
    ];
    let compare = |ranks: usize, name: &str, settings: &[&str]| {
        let job = Job::new(["plan", &case(name), "--calibrate", "--json"]).set(settings);
        let finished = job.on(ranks).succeed()?;
        let value: serde_json::Value =
            serde_json::from_str(&finished.output).map_err(|e| finished.report(&e.to_string()))?;
        let place = directory();
        let job = run(name).set(settings).on(ranks);
        let summary = job.solve(place.path())?;
        let blocks = summary.value["space_blocks"] == value["layout"]["mesh"]["space"];
        require(blocks, &finished, || "not the mesh of the run".to_owned())?;
        // The same modes, where a plan was made for them.
        let modes = value["warp"]["modes"].as_f64().unwrap_or(0.0);
        let outcome = near("modes planned", modes, summary.number("modes")?, 0.0);
        summary.require(outcome.is_ok(), || outcome.unwrap_err())?;
        let seconds = |key: &str| value["calibration"][key].as_f64().unwrap_or(f64::NAN);
        let (solve, wall) = (seconds("solve_seconds"), seconds("wall_seconds"));
        let sensible = solve > 0.0 && wall > solve && wall.is_finite();
        require(sensible, &finished, || format!("{solve} s of {wall} s"))
    };
    check_all(&rows, |(ranks, name, settings)| {
        compare(*ranks, name, settings)
    });
}

/// Fewer ranks than the run will have measure for it; nodes are counted and their memory is kept to.
#[test]
fn plans_for_nodes() {
    let nodes = [
        "--ranks",
        "64",
        "--memory-per-node",
        "2GiB",
        "--ranks-per-node",
        "16",
    ];
    let job = || Job::new(["plan", &case("example1.toml")]).with(nodes);
    let rows = [1, 2, 3];
    check_all(&rows, |ranks| {
        let finished = job().with(["--calibrate"]).on(*ranks).succeed()?;
        for words in [
            "64 = ",
            "nodes           4 of 16 ranks",
            "--ranks-x",
            "not the ranks of the run",
            "to solve",
        ] {
            require(finished.output.contains(words), &finished, || {
                format!("\"{words}\" is not said")
            })?;
        }
        let small = Job::new(["plan", &case("example1.toml"), "--ranks", "64"]);
        let refused = small
            .with(["--memory-per-node", "100MiB", "--ranks-per-node", "16"])
            .run()?;
        require(
            refused.code == Some(2) && refused.errors.contains("6.2 MiB"),
            &refused,
            || "100 MiB for 16 ranks are enough".to_owned(),
        )
    });
}

/// Planned memory against the peak that was measured, where arrays outweigh the program.
#[test]
fn memory_is_what_was_planned() {
    // Resident memory of the program with next to no arrays: what a plan may be wrong by.
    let place = directory();
    let tiny = run("example1.toml").set(&["axis.0.x.cells=2", "axis.0.v.cells=2"]);
    let base = tiny.on(1).solve(place.path()).unwrap();
    let base = base.number("memory_peak_bytes_per_rank").unwrap();
    let grid = [
        "axis.0.x.cells=512",
        "axis.0.v.cells=512",
        "time.end=0.05",
        "solver.tolerance=0.01",
    ];
    let large = [
        "axis.0.x.cells=1024",
        "axis.0.v.cells=1024",
        "time.end=0.05",
    ];
    let plane = [
        "axis.0.x.cells=30",
        "axis.1.x.cells=30",
        "axis.0.v.cells=18",
        "axis.1.v.cells=16",
        "time.end=0.05",
        "solver.tolerance=0.01",
    ];
    let slopes = [SLOPES[0], SLOPES[1], "scheme.limiter=minmod"];
    let rows: &[(&str, &[&str], &[&str], usize)] = &[
        ("example1.toml", &grid, &[], 1),
        (
            "example1.toml",
            &grid,
            &["scheme.interface=conservative"],
            2,
        ),
        ("example1.toml", &large, &["solver.method=classical"], 1),
        ("example1.toml", &grid, &["solver.verify=true"], 1),
        ("slope_jump.toml", &grid, &slopes, 1),
        ("inflow_barrier.toml", &grid, &[], 1),
        ("slope_jump.toml", &grid, &[], 2),
        ("barrier2d.toml", &plane, &[], 1),
        (
            "slope_jump.toml",
            &grid,
            &["solver.propagator.method=krylov"],
            1,
        ),
        ("example2.toml", &grid, &[], 1),
        ("example3.toml", &plane, &[], 2),
    ];
    check_all(rows, |(name, size, settings, ranks)| {
        let place = directory();
        let summary = run(name)
            .set(size)
            .set(settings)
            .on(*ranks)
            .solve(place.path())?;
        let peak = summary.number("memory_peak_bytes_per_rank")?;
        let planned = summary.number("memory_planned_bytes_per_rank")?;
        let mib = |bytes: f64| format!("{:.0} MiB", bytes / f64::from(1 << 20));
        let (peak_text, planned_text, base_text) = (mib(peak), mib(planned), mib(base));
        let arrays_count = peak > 1.4 * base;
        summary.require(arrays_count, || {
            format!("peak {peak_text} of a program of {base_text}")
        })?;
        summary.require(planned >= peak - base && planned <= 3.0 * peak, || {
            format!("planned {planned_text}, peak {peak_text}, program {base_text}")
        })?;
        // The arrays alone.
        let arrays = (planned - base) / (peak - base);
        summary.require((0.75..=3.0).contains(&arrays), || {
            format!("planned {planned_text}, peak {peak_text}, program {base_text}: arrays by a factor {arrays:.2}")
        })
    });
}

/// The room for sparse factors is an estimate: not less than they take, and at most several times as much.
#[test]
fn factors_take_no_more_memory_than_planned() {
    let place = directory();
    let tiny = run("example1.toml").set(&["axis.0.x.cells=2", "axis.0.v.cells=2"]);
    let base = tiny.on(1).solve(place.path()).unwrap();
    let base = base.number("memory_peak_bytes_per_rank").unwrap();
    let implicit = "solver.propagator={method='crank-nicolson',step=0.02}";
    let line = ["axis.0.x.cells=160", "axis.0.v.cells=150"];
    let plane = ["axis.0.x.cells=16", "axis.1.x.cells=16"];
    let sloped = [
        "axis.0.x.cells=8",
        "potential.0.value='0.2+0.1*x-0.1*y'",
        "potential.1.value='0.1*x+0.1*y'",
    ];
    let rows: &[(&str, &[&str], usize)] = &[
        ("example1.toml", &line, 1),
        ("slope_jump.toml", &line, 1),
        ("slope_jump.toml", &line, 2),
        ("barrier2d.toml", &plane, 1),
        ("barrier2d.toml", &sloped, 2),
    ];
    check_all(rows, |(name, size, ranks)| {
        let place = directory();
        let job = run(name)
            .set(size)
            .set(&[implicit, "time.end=0.02", "solver.tolerance=0.1"]);
        let job = if *ranks > 1 {
            job.with(["--ranks-x", "2"])
        } else {
            job
        };
        let summary = job.on(*ranks).solve(place.path())?;
        let peak = summary.number("memory_peak_bytes_per_rank")?;
        let planned = summary.number("memory_planned_bytes_per_rank")?;
        let arrays = (planned - base) / (peak - base);
        summary.require((0.75..=6.0).contains(&arrays), || {
            format!("planned {planned:e}, peak {peak:e}, program {base:e}: arrays by a factor {arrays:.2}")
        })
    });
}

/// Memory does not grow with the number of modes.
#[test]
fn memory_does_not_grow_with_the_modes() {
    let peak = |tolerance: &str| {
        let place = directory();
        let summary = run("example1.toml")
            .set(&["axis.0.x.cells=256", "axis.0.v.cells=256", "time.end=0.05"])
            .set(&[&format!("solver.tolerance={tolerance}")])
            .solve(place.path())
            .unwrap();
        (
            summary.number("modes").unwrap(),
            summary.number("memory_peak_bytes_per_rank").unwrap(),
        )
    };
    let ((few, low), (many, high)) = (peak("1e-2"), peak("1e-12"));
    assert!(many > 2.0 * few, "{few} and {many} modes");
    assert!(
        high < 1.05 * low,
        "{low} bytes for {few} modes, {high} bytes for {many}"
    );
}

/// Numbers of ranks that divide nothing.
#[test]
fn odd_numbers_of_ranks_run() {
    let mut rows = Vec::new();
    for name in ["step3d.toml", "well.toml", "inflow_barrier.toml"] {
        for ranks in [5, 6, 7] {
            rows.push((name, ranks));
        }
    }
    check_all(&rows, |(name, ranks)| {
        let place = directory();
        let summary = run(name)
            .on(*ranks)
            .set(&["solver.verify=true"])
            .solve(place.path())?;
        let found = summary.number("ranks")?;
        summary.require(found == *ranks as f64, || format!("ranks: {found}"))?;
        meets_its_tolerance(&summary)
    });
}

// ---------------------------------------------------------------------------------------------------------------------
// Warnings, documentation

/// An edge inside a cell is moved to a face: said, with the distance, by `check`, by `run` and in `summary.json`.
#[test]
fn region_edges_off_the_faces_give_a_warning() {
    // Cells of 3/128 = 0.0234375; the nearest centre decides.
    let rows = [
        ("x < 0.01", "0.010000", "1.00e-2"),
        ("x < 0.015", "0.015000", "8.44e-3"),
        ("x < -0.005", "-0.005000", "5.00e-3"),
    ];
    check_all(&rows, |(condition, edge, by)| {
        let setting = format!("potential.0.where=\"{condition}\"");
        let says = ["warning: potential", "x = ", edge, by];
        let finished = check("example1.toml").set(&[&setting]).succeed()?;
        for words in says {
            require(finished.output.contains(words), &finished, || {
                format!("\"{words}\" is not said")
            })?;
        }
        let place = directory();
        let job = run("example1.toml").set(&[&setting, "time.end=0.01"]).on(2);
        let finished = job.clone().into(place.path()).succeed()?;
        for words in says {
            let times = finished.errors.matches(words).count();
            require(times == 1, &finished, || {
                format!("\"{words}\" is said {times} times")
            })?;
        }
        let text = std::fs::read_to_string(place.path().join("summary.json")).unwrap_or_default();
        let value: serde_json::Value = serde_json::from_str(&text).unwrap_or_default();
        let warnings = value["warnings"].to_string();
        require(
            warnings.contains(edge) && warnings.contains(by),
            &finished,
            || format!("warnings in summary.json: {warnings}"),
        )
    });
    // Control: an edge on a face, and one that is on a face of this grid alone.
    for condition in ["x < 0", "x < 0.0234375"] {
        let setting = format!("potential.0.where=\"{condition}\"");
        let finished = check("example1.toml").set(&[&setting]).succeed().unwrap();
        assert!(
            !finished.output.contains("warning"),
            "{}",
            finished.report("no warning expected")
        );
    }
}

/// Every profile with every propagator, and with shifts up and down: the tolerance is met, or, where the step's error is
/// above it, that is said.
#[test]
fn profiles_with_propagators_and_shifts() {
    let profiles = [
        ("designed", "1e-5"),
        ("gaussian", "1e-5"),
        ("low-somma", "1e-5"),
        ("smooth", "1e-3"),
        ("exponential", "3e-2"),
        ("acl", "3e-2"),
    ];
    let mut rows = Vec::new();
    for (profile, tolerance) in profiles {
        for more in [
            ["solver.propagator.method=krylov", ""],
            [
                "solver.propagator.method=crank-nicolson",
                "solver.propagator.step=0.01",
            ],
            [
                "solver.propagator.method=backward-euler",
                "solver.propagator.step=0.01",
            ],
            ["solver.warp.shift=2", ""],
            ["solver.warp.shift=-3", ""],
            ["solver.warp.shift=-8", ""],
        ] {
            rows.push((profile, tolerance, more));
        }
    }
    check_all(&rows, |(profile, tolerance, more)| {
        let place = directory();
        let set: Vec<&str> = more.iter().copied().filter(|s| !s.is_empty()).collect();
        let summary = run("slope_jump.toml")
            .set(&[
                "axis.0.x.cells=12",
                "axis.0.v.cells=11",
                "time.end=0.4",
                "exact={}",
                "solver.verify=true",
                &format!("solver.warp.profile={profile}"),
                &format!("solver.tolerance={tolerance}"),
            ])
            .set(&set)
            .solve(place.path())?;
        let (error, tolerance) = (
            summary.number("error_semidiscrete")?,
            summary.number("tolerance")?,
        );
        let told = summary.boolean("error_estimate_reliable")?;
        let warned = summary.value["warnings"].to_string();
        let implicit = set.len() > 1;
        let met = error <= tolerance || implicit && (warned.contains("step") || !told);
        summary.require(met, || format!("error {error:e}, told {told}: {warned}"))?;
        let estimate = summary.number("error_estimate")?;
        summary.require(!told || estimate > 0.1 * error, || {
            format!("error_estimate {estimate:e}, error {error:e}")
        })
    });
}

/// The paper's own set-ups, on smaller grids and with fewer points: interval, recovery point, step and embedding are
/// taken as given, what they do not guarantee is said, and the first and the third come out within their tolerance.
#[test]
fn the_papers_own_set_ups() {
    let rows: [(&str, &[&str], &[&str], f64); 3] = [
        (
            "paper/example1.toml",
            &[
                "axis.0.x.cells=32",
                "axis.0.v.cells=32",
                "solver.warp.points=1024",
            ],
            &["solver.warp.points"],
            2e-2,
        ),
        (
            "paper/example2.toml",
            &[
                "axis.0.x.cells=16",
                "axis.0.v.cells=16",
                "solver.warp.points=256",
            ],
            &["solver.warp.points"],
            f64::INFINITY,
        ),
        (
            "paper/example3.toml",
            &["solver.warp.points=128"],
            &["solver.warp.points", "solver.warp.interval"],
            1e-1,
        ),
    ];
    check_all(&rows, |(name, settings, warned, limit)| {
        let place = directory();
        let job = run(name)
            .set(settings)
            .set(&["solver.verify=true", "exact={}"])
            .on(2);
        let summary = job.solve(place.path())?;
        let steps = summary.number("solves")?;
        summary.require(steps > 0.0, || "no implicit steps".to_owned())?;
        let error = summary.number("error_semidiscrete")?;
        summary.require(error <= *limit, || format!("error {error:e} above {limit}"))?;
        let text = std::fs::read_to_string(place.path().join("summary.json")).unwrap_or_default();
        let value: serde_json::Value = serde_json::from_str(&text).unwrap_or_default();
        let warnings = value["warnings"].to_string();
        for key in *warned {
            summary.require(warnings.contains(key), || {
                format!("no warning about {key}: {warnings}")
            })?;
        }
        Ok(())
    });
}

#[test]
fn every_case_is_in_the_readme() {
    let readme = std::fs::read_to_string(case("README.md")).unwrap();
    let papers = [
        "paper/example1.toml",
        "paper/example2.toml",
        "paper/example3.toml",
    ];
    let all: Vec<String> = (cases().into_iter())
        .chain(papers.map(str::to_owned))
        .collect();
    check_all(&all, |name| {
        let row = readme
            .lines()
            .find(|l| l.starts_with(&format!("| `{name}` |")));
        let row = row.ok_or_else(|| format!("cases/README.md has no row for {name}"))?;
        // The row's number of cells is the file's.
        let all = plan(name, 1).set(&["solver.reduce=false"]);
        let finished = all.with(["--json"]).succeed()?;
        let value: serde_json::Value =
            serde_json::from_str(&finished.output).map_err(|e| finished.report(&e.to_string()))?;
        let cells = format!("= {} |", value["cells"]);
        require(row.contains(&cells), &finished, || {
            format!("cases/README.md: \"{row}\" does not end with \"{cells}\"")
        })
    });
    for word in readme.split(|c: char| !(c.is_alphanumeric() || "_./".contains(c))) {
        if let Some(name) = word.strip_prefix("cases/").filter(|n| n.ends_with(".toml")) {
            assert!(
                Path::new(&case(name)).is_file(),
                "cases/README.md names {name}"
            );
        }
    }
}
