//! Profiles g(p) and readings: tolerances, orders, intervals and points given by hand, the plateau,
//! and the set-ups of the paper.

use crate::support::{
    Job, at_most, check_all, datasets, directory, meets_its_tolerance_within, near, plan, refused,
    require, run,
};

/// `job` with a profile, given as its name or as `name/α` or `name/order`.
fn with_profile(job: Job, profile: &str) -> Job {
    let (name, parameter) = profile.split_once('/').unwrap_or((profile, ""));
    let job = job.set(&[&format!("solver.warp.profile={name}")]);
    let key = if name == "smooth" { "order" } else { "alpha" };
    match parameter {
        "" => job,
        _ => job.set(&[&format!("solver.warp.{key}={parameter}")]),
    }
}

/// Every profile with every reading meets its tolerance: on steps, trapped particles, inflow, and
/// in two dimensions, with analytic and sampled coefficients. A row has one reading for each case,
/// so that pairs of profile, reading, case and kind of coefficients occur, not all products.
#[test]
fn every_profile_and_reading_meets_its_tolerance() {
    const PROFILES: [(&str, [&str; 2]); 10] = [
        ("planned", ["1e-3", "1e-8"]),
        ("designed", ["1e-2", "1e-6"]),
        ("gaussian", ["1e-3", "1e-8"]),
        ("exponential", ["1e-2"; 2]),
        ("exponential/1 + 4*(1 - exp(p))", ["1e-2"; 2]),
        ("exponential/5 if p < -1 else 2", ["3e-2"; 2]),
        ("exponential/-1 + 0.02*p^2", ["1e-3", "1e-5"]),
        ("smooth", ["1e-3", "1e-5"]),
        ("low-somma", ["1e-3", "1e-8"]),
        ("acl", ["1e-2"; 2]),
    ];
    const CASES: [(&str, &[&str]); 4] = [
        ("example1.toml", &["axis.0.x.cells=24", "axis.0.v.cells=22"]),
        ("well.toml", &["axis.0.x.cells=20", "axis.0.v.cells=18"]),
        ("inflow_barrier.toml", &["axis.0.x.cells=20", "axis.0.v.cells=16", "time.end=0.5"]),
        (
            "barrier2d.toml",
            &["axis.0.x.cells=6", "axis.1.x.cells=6", "axis.0.v.cells=6", "axis.1.v.cells=6"],
        ),
    ];
    let mut rows = Vec::new();
    for (p, (profile, tolerances)) in PROFILES.into_iter().enumerate() {
        for (c, (case, size)) in CASES.into_iter().enumerate() {
            let method = ["point", "integral", "least-squares"][(p + c) % 3];
            let tolerance = tolerances[(c / 2 + c) % 2];
            // A designed series is no function of which samples can be taken.
            let coefficients = match profile {
                "designed" => "analytic",
                _ => ["analytic", "sampled"][(p + c / 2) % 2],
            };
            rows.push((case, size, profile, tolerance, method, coefficients));
        }
    }
    check_all(&rows, |(case, size, profile, tolerance, method, coefficients)| {
        let job = run(case).set(size).set(&[
            "solver.verify=true",
            &format!("solver.tolerance={tolerance}"),
            &format!("solver.warp.recovery_method={method}"),
            &format!("solver.warp.coefficients={coefficients}"),
        ]);
        let job = with_profile(job, profile);
        let summary = job.summary()?;
        let plain = *profile == "gaussian" && *method == "point";
        meets_its_tolerance_within(&summary, if plain { 3.0 } else { 6.0 })
    });
}

/// The order of the recovered field in `N_p` is `r + 1` if the reading depends on the corner of the
/// profile (`r = 0` for the exponential: the first order of the paper), and one more otherwise. The
/// corner is a third of a cell off the points, as samples at a corner on a point would be exact. In
/// a short time, all of the spectrum of `S` stays at the corner, in a long time only a part of it,
/// which makes the order higher.
#[test]
fn points_given_by_hand_converge_with_the_order_of_the_profile() {
    const SHORT: &str = "1e-4";
    const LONG: &str = "0.6";
    let rows: [(&str, &str, &str, &str, usize, f64); 11] = [
        ("exponential", "0", SHORT, "sampled", 512, 1.0),
        ("exponential", "0", SHORT, "analytic", 512, 1.0),
        ("exponential", "1", LONG, "sampled", 512, 2.0),
        ("exponential", "1", LONG, "analytic", 512, 2.0),
        ("exponential/2 - p", "0", SHORT, "sampled", 512, 1.0),
        ("exponential/-1 - p", "0", SHORT, "sampled", 1024, 2.0),
        ("smooth/1", "0", SHORT, "sampled", 1024, 2.0),
        ("smooth/2", "0", SHORT, "analytic", 4096, 3.0),
        ("smooth/1", "1", LONG, "analytic", 2048, 3.0),
        ("smooth/2", "0", SHORT, "sampled", 4096, 3.0),
        ("smooth/3", "0", SHORT, "sampled", 4096, 4.0),
    ];
    check_all(&rows, |&(profile, recovery, end, coefficients, points, expected)| {
        let period = 48.0;
        let shift = period / (3.0 * points as f64);
        let (lower, upper) = (-0.5 * period - shift, 0.5 * period - shift);
        let error = |points: usize| -> Result<f64, String> {
            let job = run("example1.toml").set(&[
                "axis.0.x.cells=16",
                "axis.0.v.cells=16",
                "solver.tolerance=1e-9",
                "solver.verify=true",
                &format!("time.end={end}"),
                &format!("solver.warp.interval=[{lower},{upper}]"),
                &format!("solver.warp.points={points}"),
                &format!("solver.warp.recovery={recovery}"),
                &format!("solver.warp.coefficients={coefficients}"),
            ]);
            with_profile(job, profile).summary()?.number("error_semidiscrete")
        };
        let (coarse, fine) = (error(points)?, error(4 * points)?);
        let order = (coarse / fine).log(4.0);
        let what = format!(
            "order of {profile} at {recovery}, {coefficients} (errors {coarse:e}, {fine:e})"
        );
        near(&what, order, expected, 0.35)
    });
}

/// A too short interval is refused with ends that suffice.
#[test]
fn short_intervals_are_refused_with_a_sufficient_one() {
    let rows = [
        ("gaussian", "analytic", "1e-6"),
        ("gaussian", "sampled", "1e-6"),
        ("exponential", "sampled", "1e-2"),
        ("exponential/-1 + p^2", "analytic", "1e-4"),
        ("exponential/5 if p < -1 else 2", "sampled", "2e-2"),
        ("smooth", "analytic", "1e-4"),
        ("low-somma", "sampled", "1e-6"),
        ("acl", "analytic", "1e-2"),
    ];
    check_all(&rows, |(profile, coefficients, tolerance)| {
        let place = directory();
        let job = |interval: &str| {
            let job = run("example1.toml").set(&[
                "axis.0.x.cells=20",
                "axis.0.v.cells=16",
                "solver.verify=true",
                "solver.reduce={axes=false, velocities=false}",
                &format!("solver.tolerance={tolerance}"),
                &format!("solver.warp.coefficients={coefficients}"),
                &format!("solver.warp.interval={interval}"),
            ]);
            with_profile(job, profile)
        };
        let finished = job("[-9, 3.5]").into(place.path()).run()?;
        let wording = ["solver.warp.interval = [-9, 3.5]", "too short", "length", tolerance];
        refused(&finished, &wording)?;
        let named = finished.errors.split("about ").nth(1);
        let ends = named.and_then(|text| text.split(';').next());
        let ends = ends.ok_or_else(|| finished.report("no ends named"))?;
        meets_its_tolerance_within(&job(ends).summary()?, 10.0)
    });
}

/// A set-up given by hand, similar to those of the paper, runs. Warnings before the run and in the
/// summary name its shortcomings.
#[test]
fn insufficient_settings_by_hand_cause_warnings() {
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
    for words in ["recovery = 0.2 is below", "points = 32: the modes", "points do"] {
        let printed = finished.errors.matches(words).count();
        assert_eq!(printed, 1, "{words}: {}", finished.errors);
    }
    let summary = job.with(["--force"]).solve(place.path()).unwrap();
    let warnings = summary.value["warnings"].as_array().map_or(0, Vec::len);
    assert!(warnings >= 2, "{}", summary.value["warnings"]);
}

/// The plateau is flat above the corner of the profile, and not below it.
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
    // The plan also reads at p = 1.
    assert!(distance[4] < 1e-12, "{distance:?}");
}

/// The plan contains the coefficients of the profile. Their sum equals e^{-p} to the tolerance on
/// the spectrum of ST.
#[test]
fn the_plan_holds_the_profile() {
    let rows = [("example1.toml", "1e-3"), ("example1.toml", "1e-9"), ("well.toml", "1e-6")];
    check_all(&rows, |(name, tolerance)| {
        let job = plan(name, 2).set(&[&format!("solver.tolerance={tolerance}")]);
        let finished = job.with(["--json"]).succeed()?;
        let value = finished.json()?;
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

/// Profiles with propagators, and with shifts up and down, meet their tolerances, or a
/// warning says that the error of the time step is above it.
#[test]
fn profiles_meet_tolerances_with_propagators_and_shifts() {
    let profiles = [
        ("designed", "1e-5"),
        ("gaussian", "1e-5"),
        ("low-somma", "1e-5"),
        ("smooth", "1e-3"),
        ("exponential", "3e-2"),
        ("exponential/1 - 2*p", "3e-2"),
        ("exponential/-1 + 0.02*p^2", "1e-3"),
        ("acl", "3e-2"),
    ];
    // Three of six for each profile.
    let settings: [&[&str]; 6] = [
        &["solver.propagator.method=krylov"],
        &["solver.propagator.method=crank-nicolson", "solver.propagator.step=0.01"],
        &["solver.warp.shift=2"],
        &["solver.propagator.method=backward-euler", "solver.propagator.step=0.01"],
        &["solver.warp.shift=-3"],
        &["solver.warp.shift=-8"],
    ];
    let mut rows = Vec::new();
    for (k, (profile, tolerance)) in profiles.into_iter().enumerate() {
        rows.extend([0, 1, 3].map(|j| (profile, tolerance, settings[(k + j) % 6])));
    }
    check_all(&rows, |(profile, tolerance, more)| {
        let job = run("slope_jump.toml").set(&[
            "axis.0.x.cells=12",
            "axis.0.v.cells=11",
            "time.end=0.4",
            "exact={}",
            "solver.verify=true",
            &format!("solver.tolerance={tolerance}"),
        ]);
        let summary = with_profile(job, profile).set(more).summary()?;
        let (error, tolerance) =
            (summary.number("error_semidiscrete")?, summary.number("tolerance")?);
        let reliable = summary.boolean("error_estimate_reliable")?;
        let warned = summary.warnings();
        let implicit = more.len() > 1;
        let met = error <= tolerance || implicit && (warned.contains("step") || !reliable);
        summary.require(met, || format!("error {error:e}, reliable {reliable}: {warned}"))?;
        let estimate = summary.number("error_estimate")?;
        summary.require(!reliable || estimate > 0.1 * error, || {
            format!("error_estimate {estimate:e}, error {error:e}")
        })
    });
}

/// A formula for α without p has the plan of its value, bit for bit. A formula that contains p
/// without depending on it agrees up to round-off. A formula that continues `e^{−p}` smoothly to
/// the left needs far fewer modes than any constant.
#[test]
fn alpha_can_be_a_formula() {
    let planned = |alpha: &str| {
        let job = plan("example1.toml", 2).set(&[
            "axis.0.x.cells=64",
            "axis.0.v.cells=64",
            "constants.k=0.5",
            "solver.tolerance=1e-3",
            "solver.warp.profile=exponential",
            &format!("solver.warp.alpha={alpha}"),
        ]);
        let warp = job.with(["--json"]).succeed().unwrap().json().unwrap()["warp"].take();
        let number = |key: &str| warp[key].as_f64().expect(key);
        (number("modes"), number("applications"), warp.clone())
    };
    let (modes, applications, constant) = planned("1.5");
    for alpha in ["3*k", "\"1.5\""] {
        assert_eq!(planned(alpha).2, constant, "{alpha}");
    }
    let (close, _, warp) = planned("3*k + 0*p");
    assert!((close / modes - 1.0).abs() < 0.02, "{close} {modes}");
    assert_eq!(warp["profile"]["alpha"], "3*k + 0*p");
    let (_, smooth, _) = planned("-1 + 0.01*p^2");
    for alpha in ["0.3", "1"] {
        let (_, constant, _) = planned(alpha);
        assert!(constant < applications, "{alpha}: {constant}");
        assert!(100.0 * smooth < constant, "{alpha}: {constant}, {smooth}");
    }
}

/// The set-ups of the paper, on smaller grids and with fewer points, run with the given interval,
/// recovery point, step and embedding. Warnings name missing guarantees, and the errors of the
/// first and of the third are within a limit.
#[test]
fn set_ups_of_the_paper_run_as_given() {
    let rows: [(&str, &[&str], &[&str], f64); 3] = [
        (
            "paper/example1.toml",
            &["axis.0.x.cells=24", "axis.0.v.cells=24", "solver.warp.points=1024"],
            &["solver.warp.points"],
            2e-2,
        ),
        (
            "paper/example2.toml",
            &["axis.0.x.cells=16", "axis.0.v.cells=16", "solver.warp.points=256"],
            &["solver.warp.points"],
            f64::INFINITY,
        ),
        (
            "paper/example3.toml",
            &["axis.0.x.cells=6", "axis.0.v.cells=6", "axis.1.v.cells=6", "solver.warp.points=128"],
            &["solver.warp.points", "solver.warp.interval"],
            1e-1,
        ),
    ];
    check_all(&rows, |(name, settings, warned, limit)| {
        let job = run(name).set(settings).set(&["solver.verify=true", "exact={}"]).on(2);
        let summary = job.summary()?;
        let steps = summary.number("solves")?;
        summary.require(steps > 0.0, || "no implicit steps".to_owned())?;
        let error = summary.number("error_semidiscrete")?;
        summary.require(error <= *limit, || format!("error {error:e} above {limit}"))?;
        let warnings = summary.warnings();
        for key in *warned {
            summary.require(warnings.contains(key), || {
                format!("no warning about {key}: {warnings}")
            })?;
        }
        Ok(())
    });
}
