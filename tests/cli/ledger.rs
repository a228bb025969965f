//! The ledger of a run: measured quantities balance, estimates agree with them, and deviations are
//! reported.

use crate::support::{
    Job, Stored, Summary, at_most, cases, check, check_all, datasets, directory, near, of_case,
    require, run, text_of, written,
};
use serde_json::Value;
use std::path::Path;

/// A number of the ledger that must be there.
fn number(summary: &Summary, group: &str, key: &str) -> Result<f64, String> {
    let found = summary.value["ledger"][group][key].as_f64();
    found.ok_or_else(|| format!("ledger.{group}.{key} of {}", summary.command))
}

/// Outflow through an end, by motion, slopes and jumps.
fn outflow(summary: &Summary, axis: &str, end: &str) -> f64 {
    let ends = summary.value["ledger"]["ends"].as_array();
    let found = ends.into_iter().flatten().find(|e| e["axis"] == axis && e["end"] == end);
    let mass = |key: &str| found.and_then(|e| e[key].as_f64()).unwrap_or(f64::NAN);
    mass("outflow") + mass("outflow_at_jumps")
}

const UPPER: &[&str] = &["upper"];
const BOTH: &[&str] = &["lower", "upper"];
const CONSERVATIVE: &str = "scheme.interface=conservative";
const CLASSICAL: &str = "solver.method=classical";
const DEGREE: &[&str] = &["scheme.degree=3", "axis.0.x.cells=24", "axis.0.v.cells=20"];

/// A case that loses mass.
struct Loss<'a> {
    case: &'a str,
    settings: Vec<&'a [&'a str]>,
    /// The axis along which mass leaves the box, and the ends through which it leaves.
    axis: &'a str,
    ends: &'a [&'a str],
    /// Limit on the error of the estimate, relative to the total mass.
    by: f64,
}

/// A beam between all nodes, with a fifth of the mass and nearly all of the norm of `f`: the ledger
/// has its mass, and particles show that the grid misses it. A short pulse of inflow is in the
/// ledger.
#[test]
fn narrow_beams_and_pulses_are_not_overlooked() {
    let cloud = "exp(-((x + 0.3)^2 + (v - 0.3)^2)/0.09)";
    let box_of = "axis.0={x={lower=-1,upper=1,cells=20},v={lower=-1.2,upper=1.2,cells=16}}";
    let base = ["potential.1.value=0.1", box_of, "time.end=0.8", "solver.tolerance=2e-2"];
    let beam = format!("initial.f={cloud} + 2500*exp(-((x + 0.37)^2 + (v - 0.77)^2)/9e-6)");
    let pi = std::f64::consts::PI;
    let expected = 0.09 * pi + 2500.0 * 9e-6 * pi;
    let rows: [(&str, &str, usize); 4] = [
        ("scheme.degree=2", "exact={}", 1),
        ("scheme.degree=2", "exact.kind=characteristics", 2),
        ("scheme.degree=0", "exact={}", 1),
        ("scheme.degree=0", "exact.kind=characteristics", 1),
    ];
    check_all(&rows, |(degree, exact, ranks)| {
        let job = run("step_up.toml").set(&base).set(&[degree, exact, &beam]).on(*ranks);
        let summary = job.summary()?;
        let [mass, error] = ["formula", "formula_error"].map(|key| number(&summary, "mass", key));
        let (mass, error) = (mass?, error?);
        let is_found = (mass - expected).abs() < 4.0 * error + 1e-4 && error < 1e-3;
        summary.require(is_found, || format!("{mass} +- {error}, {expected}"))?;
        let shown = summary.value["accuracy"]["particles"]["field"].as_f64();
        summary.require(shown.is_some_and(|error| error > 0.9), || format!("{shown:?}"))?;
        summary.require(summary.value["verdict"] != "resolved", || "resolved".to_owned())
    });
    // Where particles are not followed, an estimate does not see the beam.
    let reflecting = ["potential.1.reflection=0.5", "inflow.value=0.01", "exact={}", &beam];
    let job = run("step_up.toml").set(&base).set(&["scheme.degree=2"]).set(&reflecting);
    let summary = job.summary().unwrap();
    let judged = [&summary.value["verdict"], &summary.value["accuracy"]["unknown"]];
    assert_eq!(judged[0], "unknown", "{judged:?}");
    assert!(judged[1].as_str().is_some_and(|why| why.contains("narrow part")), "{judged:?}");
    // 0.3 of mass in a millisecond, beside a thin stream.
    let pulse = "inflow.value=0.01 + 3e5*exp(-((t - 0.4)^2 + (v - 0.6)^2)/1e-6) if x < 0 else 0";
    let job = run("step_up.toml").set(&base).set(&[pulse, "scheme.degree=2", "exact={}"]);
    let summary = job.summary().unwrap();
    let entered = number(&summary, "mass", "entered_estimate").unwrap();
    // ∫ v f dv dt of both.
    let expected = 0.01 * 0.8 * 0.5 * 1.44 + 0.6 * 3e5 * 1e-6 * pi;
    assert!((entered - expected).abs() < 0.01 * expected, "{entered} {expected}");
}

/// Errors of `f` are measured at points of the elements, between which a short pulse may be: 9.7 %
/// of the 18 % that particles show.
#[test]
fn particles_doubt_the_measured_error_of_a_pulse() {
    let pulse = "inflow.value=4*exp(-((t - 0.3)/0.004)^2 - ((v - 0.8)/0.1)^2)";
    let grid = ["axis.0.x.cells=30", "axis.0.v.cells=20", "scheme.degree=2", "time.end=1.5"];
    let data = "initial.f=exp(-((x + 0.5)/0.4)^2 - ((v - 0.3)/0.4)^2)";
    let exact = ["exact.kind=characteristics", "solver.tolerance=2e-2"];
    let job = run("step_up.toml").set(&grid).set(&[data, pulse]).set(&exact);
    let summary = job.summary().unwrap();
    let accuracy = &summary.value["accuracy"];
    let [measured, shown] =
        [&accuracy["grid"], &accuracy["particles"]["field"]].map(|e| e.as_f64().unwrap());
    assert!(measured < 0.12 && shown > 1.5 * measured, "{measured} {shown}");
    assert_eq!(summary.value["verdict"], "unknown");
    let why = accuracy["unknown"].as_str().unwrap();
    assert!(why.contains("[exact] measures a part"), "{why}");
}

/// A smooth pulse may begin at almost nothing: here at 1e-133.
#[test]
fn pulses_that_begin_at_almost_nothing_enter() {
    let pulse = "inflow.value=exp(-((t - 0.7)/0.04)^2) if x < 0 else 0";
    let settings = ["axis.0.v.cells=24", "time.end=0.9", "solver.tolerance=1e-2", "exact={}"];
    let rows = ["solver.method=schrodingerized", "solver.method=classical"];
    check_all(&rows, |method| {
        let job = run("step_up.toml").set(&settings).set(&["initial.f=0", pulse, method]);
        let summary = job.summary()?;
        let entered = number(&summary, "mass", "entered")?;
        // ∫ v dv ∫ f dt over the velocities up to 1.25, and over those up to √(1.25² + 0.4), which
        // the step by 0.2 slows down into the box.
        let expected = (0.5 * 1.25 * 1.25 + 0.2) * 0.04 * std::f64::consts::PI.sqrt();
        summary.holds(near("entered mass", entered, expected, 0.02 * expected))
    });
}

/// The mass by the formula is that of a box of data whose grid is too large to look at every node,
/// with numbers of cells of which the sampled nodes are multiples.
#[test]
fn a_box_of_data_in_a_large_grid_is_found() {
    let rows =
        [(128, 8, 20, 0.005), (127, 9, 26, 0.005), (64, 16, 26, 0.005), (128, 10, 13, 0.005)];
    check_all(&rows, |&(first, second, half, allowed)| {
        let place = directory();
        let axis = |cells: usize| {
            format!(
                "[[axis]]\nx = {{ lower = -1, upper = 1, cells = 64 }}\n\
                 v = {{ lower = -1, upper = 1, cells = {cells} }}\n"
            )
        };
        let half = f64::from(half) / 100.0;
        let text = format!(
            "{}{}[[potential]]\nvalue = \"0\"\n[initial]\nf = \"1 if abs(x) < 0.1 && abs(y) < 0.1 \
             && abs(vx) < 0.1 && abs(vy) < {half} else 0\"\n[time]\nend = 0.01\n[solver]\n\
             method = \"classical\"\n",
            axis(first),
            axis(second)
        );
        let path = written(place.path(), &text)?;
        let summary = Job::new(["run", &path]).solve(place.path())?;
        let mass = number(&summary, "mass", "formula")?;
        let uncertain = number(&summary, "mass", "formula_error")?;
        let exact = 0.2f64.powi(3) * 2.0 * half;
        summary.holds(near("mass", mass, exact, 5.0 * uncertain))?;
        summary.holds(at_most("standard error", uncertain, allowed * exact))
    });
}

/// The outflow estimated by particles equals the loss of mass on the grid, through the expected
/// ends, up to the dissipation of the scheme.
#[test]
fn the_estimated_outflow_is_the_loss_of_the_grid() {
    let slope: &[&str] = &["potential.0.value=-0.5*x", "potential.1.value=-0.5*x", CLASSICAL];
    let jump: &[&str] = &["potential.0.value=0.75", CLASSICAL, CONSERVATIVE];
    let out: &[&str] = &["time.end=4", "potential.1.value=0.1", CLASSICAL, CONSERVATIVE];
    let modes: &[&str] = &["potential.0.value=0.75", CONSERVATIVE, "solver.tolerance=1e-4"];
    let far: &[&str] = &["time.end=6", CONSERVATIVE, CLASSICAL];
    let loss = |case, settings, (axis, ends), by| Loss { case, settings, axis, ends, by };
    let (fast, right, along) = (("vx", UPPER), ("x", UPPER), ("x", BOTH));
    let rows: &[Loss<'_>] = &[
        loss("step_up.toml", vec![slope, DEGREE], fast, 0.01),
        loss("step_up.toml", vec![slope], fast, 0.05),
        loss("step_up.toml", vec![jump, DEGREE], fast, 0.01),
        loss("step_up.toml", vec![jump], fast, 0.05),
        loss("step_up.toml", vec![modes], fast, 0.05),
        loss("step_up.toml", vec![out, DEGREE], right, 0.02),
        loss("inflow_barrier.toml", vec![far], along, 0.05),
        loss("pulsed_inflow.toml", vec![far], along, 0.1),
        loss("partial_reflection.toml", vec![&["time.end=3", CLASSICAL]], along, 0.02),
        loss("periodic2d.toml", vec![&["time.end=3", CLASSICAL, CONSERVATIVE]], right, 0.1),
    ];
    check_all(rows, |Loss { case, settings, axis, ends, by }| {
        let summary = run(case).set(&settings.concat()).set(&["exact={}"]).summary()?;
        let mass = |key: &str| number(&summary, "mass", key);
        let all = mass("absolute")?;
        near("formula", mass("formula")? / all, mass("initial")? / all, 0.005)?;
        near("entered", mass("entered")? / all, mass("entered_estimate")? / all, 0.03)?;
        let lost = mass("lost")? / all;
        summary.require(lost > 0.1, || format!("only {lost} is lost: nothing is tested"))?;
        summary.holds(near("left", mass("left_estimate")? / all, lost, *by))?;
        let left: f64 = ends.iter().map(|end| outflow(&summary, axis, end)).sum();
        summary.holds(near("by these ends", left / all, lost, 2.0 * by))?;
        let balance = mass("initial")? + mass("entered")? - mass("end")?;
        near("balance", mass("lost")?, balance, 1e-15)?;
        near("end", mass("end")?, summary.number("mass")?, 0.0)?;
        let printed = summary.warnings().contains("velocity box is too small");
        summary.require(printed == (*axis == "vx"), || format!("warnings: {}", summary.warnings()))
    });
}

/// The inflow is counted exactly: without outflow, all of it is in the box at the end.
#[test]
fn inflow_stays_in_the_box_without_outflow() {
    let elements: &[&str] = &["scheme.degree=2", "axis.0.x.cells=16", "axis.0.v.cells=14"];
    let rows: &[(&str, &[&str])] = &[
        ("inflow_barrier.toml", &[]),
        ("inflow_barrier.toml", elements),
        ("inflow_barrier.toml", &["solver.warp.inflow=scalar"]),
        ("inflow_barrier.toml", &["solver.warp.inflow=full", "axis.0.x.cells=16"]),
        ("pulsed_inflow.toml", &[]),
        ("pulsed_inflow.toml", &["solver.method=classical"]),
    ];
    check_all(rows, |(name, settings)| {
        let short = ["time.end=0.2", "solver.tolerance=1e-8", CONSERVATIVE];
        let summary = run(name).set(&short).set(settings).summary()?;
        let (entered, lost) =
            (number(&summary, "mass", "entered")?, number(&summary, "mass", "lost")?);
        require_positive(&summary, entered)?;
        summary.holds(at_most("lost", (lost / entered).abs(), 1e-4))
    });
}

/// Inflow that jumps in time is integrated up to its jumps, however many velocities enter.
#[test]
fn jumping_inflow_is_counted_to_round_off() {
    const TEXT: &str = "[[axis]]\nx = { lower = 0, upper = 1, cells = 9 }\n\
        v = { lower = -0.5, upper = 1.5, cells = 4000 }\n\
        [[potential]]\nvalue = \"0\"\n[initial]\nf = \"0\"\n\
        [inflow]\nvalue = \"(2 if t < 0.0837 else 0) * (v > 0)\"\n[time]\nend = 0.1\n\
        [solver]\nmethod = \"classical\"\n";
    let place = directory();
    let path = written(place.path(), TEXT).unwrap();
    let late: &[&str] = &["inflow.value=(2 if t > 0.0931 else 0) * (v > 0)"];
    for (name, settings, seconds) in [("early", &[][..], 0.0837), ("late", late, 0.1 - 0.0931)] {
        let job = Job::new(["run", &path]).set(settings);
        let summary = job.solve(&place.path().join(name)).unwrap();
        // 2 v of the velocities up to 1.5, for so many seconds.
        let exact = 1.5 * 1.5 * seconds;
        let entered = number(&summary, "mass", "entered").unwrap();
        summary.holds(near("entered", entered / exact, 1.0, 1e-10)).unwrap();
    }
}

fn require_positive(summary: &Summary, value: f64) -> Result<(), String> {
    summary.require(value > 0.0, || format!("{value} is not above 0"))
}

/// The ledger has the same bits on one rank and on three or four.
#[test]
fn the_ledger_does_not_depend_on_ranks() {
    let fewer: &[&str] = &["axis.0.x.cells=32", "axis.0.v.cells=30"];
    let rows: &[(&str, &[&str])] = &[
        ("step_up.toml", fewer),
        ("inflow_barrier.toml", fewer),
        ("slope_jump.toml", &["scheme.degree=2", "axis.0.x.cells=12", "axis.0.v.cells=10"]),
        ("example2.toml", &["axis.0.x.cells=24", "axis.0.v.cells=20", "time.end=0.2"]),
        ("barrier2d.toml", &["time.end=0.1", "output.field_times=[0.05]"]),
    ];
    let rows: Vec<_> = rows.iter().enumerate().collect();
    check_all(&rows, |&(k, (name, settings))| {
        let ledger = |ranks: usize| -> Result<Value, String> {
            let job = run(name).set(settings).set(&["solver.tolerance=1e-3"]).on(ranks);
            Ok(job.summary()?.value["ledger"].clone())
        };
        let one = ledger(1)?;
        let known = one["mass"]["formula"].is_f64() && one["energy"]["potential"].is_f64();
        if !known {
            return Err(format!("{name}: {one}"));
        }
        let ranks = 3 + k % 2;
        let other = ledger(ranks)?;
        if one == other {
            Ok(())
        } else {
            Err(format!("{name} on {ranks} ranks: {other}\non one: {one}"))
        }
    });
}

/// Deviations are reported by runs, and by `check` if they are known without a solve.
#[test]
fn deviations_are_reported_before_and_after() {
    let fast = "axis.0.v={ lower=-1e6, upper=1e6, cells=80 }";
    let units: &[&str] =
        &[fast, "time.end=1e-7", "initial.f=exp(-((x + 0.6)/0.3)^2 - ((v - 3e5)/2e5)^2)"];
    let slow: &[&str] = &[fast, "time.end=1e-7"];
    let narrow: &[&str] = &["initial.f=exp(-((x + 0.6)/0.003)^2 - ((v - 0.7)/0.003)^2)"];
    let wide: &[&str] = &["initial.f=exp(-(x + 0.6)^2/0.01 - v^2)"];
    let hat: &[&str] = &["axis.0.x.cells=12", "axis.0.v.cells=10"];
    let rows: &[(&str, &[&str], &[&str])] = &[
        ("step_up.toml", units, &["the largest jump along x, 0.2, is", "units"]),
        ("step_up.toml", units, &["80 cells of 25000"]),
        (
            "step_up.toml",
            slow,
            &["does not resolve 100.00 % of the data", "along vx", "is missing"],
        ),
        ("step_up.toml", narrow, &["mass: the grid holds", "more cells"]),
        ("step_up.toml", wide, &["mass: the initial data go beyond the velocity box"]),
        ("step_up.toml", hat, &["\"hat\" changes it by an estimated", "conservative"]),
        ("step_up.toml", &["potential.0.value=0.6"], &["upper end of vx", "at jumps of V"]),
        (
            "example2.toml",
            &["initial.velocity=[\"2 if x < -0.5 else 0.6\"]"],
            &["initial.velocity is outside of the velocity box for"],
        ),
        ("barriers.toml", &[], &["narrowest region of V: potential.0, 8 cells along x"]),
        ("step_up.toml", &["potential.1.value=1e3"], &["x, 1000, is far above", "as a wall does"]),
        ("periodic2d.toml", &["axis.0.x.cells=24"], &["mass at the start: "]),
    ];
    check_all(rows, |(name, settings, words)| {
        let finished = check(name).set(settings).succeed()?;
        finished.contains(&finished.output, words)
    });
    // A run prints the same warnings and the ledger. Without warnings, it prints the ledger only
    // with `-v`.
    let place = directory();
    let job = run("step_up.toml").set(&["potential.0.value=0.6", "solver.tolerance=1e-3"]);
    let finished = job.on(2).into(place.path()).succeed().unwrap();
    finished.contains(&finished.errors, &["warning: mass: an estimated"]).unwrap();
    finished.contains(&finished.output, &["ledger\n", "lost in all"]).unwrap();
    for (verbose, wording) in [(&[][..], false), (&["-v"][..], true)] {
        let place = directory();
        let job = run("step_up.toml").set(&["time.end=0.1", "solver.tolerance=1e-3"]);
        let finished = job.with(verbose.iter().copied()).into(place.path()).succeed().unwrap();
        let printed = finished.output.contains("\n  energy: kinetic");
        require(printed == wording, &finished, || "the ledger".to_owned()).unwrap();
    }
}

/// A barrier of `cells` cells, or of elements of a `degree` above 0.
struct Barrier {
    cells: usize,
    degree: usize,
}

impl Barrier {
    /// The number of cells or elements from -1.5 to 1.5.
    const fn grid(&self) -> usize {
        if self.degree == 0 { 120 } else { 60 }
    }

    /// Settings of a cloud that has mostly passed the barrier, which begins at `x = 0`.
    fn settings(&self) -> Vec<String> {
        let end = 3.0 * self.cells as f64 / self.grid() as f64;
        vec![
            format!("potential.0={{where=\"x > 0 && x < {end:?}\", value=\"0.2\"}}"),
            format!("axis.0.x.cells={}", self.grid()),
            format!("axis.0.v.cells={}", self.grid() * 5 / 6),
            format!("scheme.degree={}", self.degree),
            "potential.1.value=0".to_owned(),
            "time.end=1.5".to_owned(),
            CLASSICAL.to_owned(),
        ]
    }

    /// The mass in the barrier relative to the exact one, and the error of the density behind it
    /// relative to the mass there.
    fn measured(&self, results: &Path) -> Result<[f64; 2], String> {
        let found = datasets(results)?;
        let numbers = |name: &str| found.get(name).map(Stored::numbers).unwrap_or_default();
        let (density, exact) = (numbers("/density"), numbers("/density_exact"));
        let (nodes, first) = (self.degree + 1, self.grid() / 2 * (self.degree + 1));
        let weights = match self.degree {
            0 => vec![1.0; density.len()],
            _ => numbers("/axis/weights_x"),
        };
        let sum = |values: &[f64], range: std::ops::Range<usize>| -> f64 {
            range.map(|i| weights[i] * values[i]).sum()
        };
        let behind = first + self.cells * nodes;
        let apart = density.iter().zip(&exact).map(|(a, b)| (a - b).abs());
        let apart: Vec<f64> = apart.collect();
        let all = behind..density.len();
        Ok([
            sum(&density, first..behind) / sum(&exact, first..behind),
            sum(&apart, all.clone()) / sum(&exact, all),
        ])
    }
}

/// Barriers so narrow that they contain too many particles are reported before and after a run.
/// Behind them, the density is as accurate as behind wide ones.
#[test]
fn unresolved_narrow_regions_are_reported() {
    let rows = [(1, 0, true), (2, 0, true), (3, 0, true), (4, 0, false), (8, 0, false)];
    let rows = [&rows[..], &[(1, 1, false), (2, 1, false)]].concat();
    check_all(&rows, |&(cells, degree, printed)| {
        let barrier = Barrier { cells, degree };
        let settings = barrier.settings();
        let settings: Vec<&str> = settings.iter().map(String::as_str).collect();
        let unit = if cells == 1 { "1 cell wide" } else { "cells wide" };
        let place = directory();
        for job in [check("step_up.toml"), run("step_up.toml").into(place.path())] {
            let finished = job.set(&settings).succeed()?;
            let all = [&finished.output[..], &finished.errors].concat();
            let found = all.contains(unit) && all.contains("does not resolve f in it");
            require(found == printed, &finished, || format!("a narrow region: {found}"))?;
        }
        let [inside, behind] = barrier.measured(place.path())?;
        println!("{cells} of degree {degree}: {inside:.3} inside, {behind:.3} behind");
        let right = if printed { inside > 1.35 } else { (0.9..1.3).contains(&inside) };
        if right && behind < 0.25 {
            return Ok(());
        }
        Err(format!("{cells} of degree {degree}: {inside} of the mass inside, error {behind}"))
    });
}

/// Remedies name the keys that give the degrees: those of axes, where axes have their own.
#[test]
fn remedies_name_the_degrees_of_axes() {
    let own: &[&str] = &["axis.0.x.degree=0", "axis.0.v.degree=0"];
    let narrow = Barrier { cells: 1, degree: 0 }.settings();
    let narrow: Vec<&str> = narrow.iter().map(String::as_str).collect();
    let bump: &[&str] = &["initial.f=exp(-((x - 0.31)/0.01)^2 - ((v - 0.5)/0.3)^2)", "exact={}"];
    let both = "axis.0.x.degree and axis.0.v.degree";
    let rows: [(Vec<&str>, &str); 4] = [
        (narrow.clone(), "or scheme.degree = 2"),
        ([&narrow[..], own].concat(), "or axis.0.x.degree = 2"),
        (bump.to_vec(), "or a higher scheme.degree"),
        ([bump, own].concat(), &format!("or a higher {both}")),
    ];
    check_all(&rows, |(settings, words)| {
        let finished = check("step_up.toml").set(settings).succeed()?;
        finished.contains(&finished.output, &[words])
    });
    // Data that vary within the cells.
    let wave = "initial.f=(1 + cos(2*pi*16*(x + 1.5)/3))*exp(-(v - 0.5)^2/0.1)";
    let job = check("example1.toml").set(&[wave, "axis.0.x.cells=32"]).set(own);
    let finished = job.succeed().unwrap();
    let words = format!("take more cells or {both} above 0");
    finished.contains(&finished.output, &[&words]).unwrap();
}

/// No case of `cases/` loses or gains mass without a reason. If `V` or a pulse is not resolved, the
/// mass is unbalanced, and the report marks it.
#[test]
fn unbalanced_mass_is_reported() {
    let off = |summary: &Summary| {
        let warnings = summary.warnings();
        let words = ["by the particles of the exact flow", "enters the grid"];
        words.map(|words| warnings.contains(words))
    };
    check_all(&cases(), |name| {
        let unitary = name.starts_with("unitary");
        let method: &[&str] = if unitary { &[] } else { &[CLASSICAL] };
        let summary = run(name).set(method).set(&["exact={}"]).summary()?;
        // The coarse grids of these cases smear 4 to 5 % of the mass over the ends of the box.
        // In example 2 beams converge: the discrete delta function has 7.54 of a mass of 7.24.
        let is_off = ["barrier2d.toml", "step3d.toml", "example2.toml"].contains(&name.as_str());
        summary.require(off(&summary) == [is_off, false], || summary.warnings())
    });
    let bump: &[&str] = &["potential.1.value=0.4*exp(-((x - 0.3)/0.02)^2)", "scheme.degree=3"];
    let bump = [bump, &["axis.0.x.cells=12", "axis.0.v.cells=20", CLASSICAL]].concat();
    let pulse: &[&str] = &["initial.f=0", "axis.0.x.cells=12", "axis.0.v.cells=10", "exact={}"];
    let pulse = |value: &'static str| [pulse, &[value, "solver.tolerance=1e-3"]].concat();
    let seen = "inflow.value=exp(-((t - 0.5)/0.0004)^2) if x < -1 && v > 0.5 else 0";
    let missed = "inflow.value=1 if t > 0.7345 && t < 0.7357 && x < -1 && v > 0.5 else 0";
    let seen = run("step_up.toml").set(&pulse(seen)).summary().unwrap();
    assert_eq!(off(&seen), [false; 2], "{}", seen.warnings());
    let rows = [("step_up.toml", bump), ("step_up.toml", pulse(missed))];
    check_all(&rows, |(name, settings)| {
        let place = directory();
        let summary = run(name).set(settings).solve(place.path())?;
        summary.require(off(&summary)[0], || summary.warnings())?;
        let page = place.path().join("page");
        let [from, to] = [place.path(), &page].map(|path| path.display().to_string());
        Job::new(["report", &from, "-o", &to]).succeed()?;
        let page = page.join("report.html");
        let page = text_of(page)?;
        // The page shows each warning once.
        let first = page.matches("by the particles of the exact flow").count()
            + page.matches("enters the grid, the formula").count();
        summary.require(first == off(&summary).iter().filter(|off| **off).count(), || {
            format!("shown {first} times: {}", summary.warnings())
        })?;
        let row = page.split("Mass and energy").nth(1).unwrap_or_default();
        let sign = row.find('✗').unwrap_or(usize::MAX) < row.find('✓').unwrap_or(usize::MAX);
        summary.require(sign, || row.chars().take(200).collect())
    });
}

/// `check` says that nothing is left at the end, where it does not measure the norm then.
#[test]
fn a_box_that_is_empty_at_the_end_gives_a_warning() {
    let checked = of_case("check", "example1.toml").set(&["time.end=10000"]).succeed().unwrap();
    let warns = checked.output.contains("mass: an estimated 100.00 % leaves the box by time.end");
    require(warns, &checked, || "a warning expected".to_owned()).unwrap();
}

/// A scene in equilibrium: `V` is 0.3 where `raised` holds, and `f` a function of the energy.
/// Particles beyond the velocity box come in at the jump.
fn equilibrium(axes: [&str; 2], raised: &str, end: f64, degree: usize) -> String {
    let axis = |axis: &str| format!("[[axis]]\n{axis}\n");
    let (axes, speed) = match axes {
        [x, ""] => (axis(x), "v^2"),
        [x, y] => (axis(x) + &axis(y), "(vx^2 + vy^2)"),
    };
    let f = format!("exp(-{speed})*(exp(-0.6) if {raised} else 1)");
    format!(
        r#"
{axes}
[[potential]]
where = "{raised}"
value = 0.3
[[potential]]
value = 0
[initial]
f = "{f}"
[inflow]
value = "initial"
[time]
end = {end}
[scheme]
degree = {degree}
[solver]
tolerance = 1e-5
[exact]
f = "{f}"
"#
    )
}

/// What comes from beyond the velocity box at a jump, or through an end of the box where a jump
/// meets it, is inflow of the side from which it comes: whatever the condition says on the face
/// itself, which round-off decides, an equilibrium stays. The ledger counts it.
#[test]
fn inflow_at_jumps_is_that_of_its_side() {
    let v = "v = { lower = -1, upper = 1, cells = 20 }";
    let [even, odd] = [[-1.0, 1.0], [-1.3, 1.7]].map(|[lower, upper]| {
        format!("x = {{ lower = {lower}, upper = {upper}, cells = 30 }}\n{v}")
    });
    let plane = |lower: f64, upper: f64, cells: usize| {
        format!(
            "x = {{ lower = {lower}, upper = {upper}, cells = {cells} }}\n\
             v = {{ lower = -0.9, upper = 0.9, cells = 6 }}"
        )
    };
    let [along_x, along_y] = [plane(-1.0, 1.0, 8), plane(-0.5, 1.0, 6)];
    let fine: &[&str] = &["axis.0.x.cells=60", "axis.0.v.cells=60"];
    let central: &[&str] = &["scheme.flux=0.5"];
    let traced: &[&str] = &["exact={kind='characteristics'}"];
    let line = |x: &str, raised: &str, degree| equilibrium([x, ""], raised, 3.0, degree);
    let fast =
        even.replace("lower = -1, upper = 1, cells = 20", "lower = 0.4, upper = 1.4, cells = 10");
    let around = even.replace("cells = 30", "cells = 30, boundary = 'periodic'");
    let reflects: &[&str] = &["potential.0.reflection=0.3"];
    let rows = [
        (line(&fast, "x >= 0", 2), vec![], 1e-3),
        (line(&around, "x >= 0", 2), vec![], 1e-3),
        (line(&around, "x > 0 && x <= 1", 2), traced.to_vec(), 1e-3),
        (line(&even, "x >= 0", 2), reflects.to_vec(), 1e-3),
        (line(&even, "x > 0", 2), vec![], 1e-3),
        (line(&even, "x >= 0", 2), vec![], 1e-3),
        (line(&odd, "x < 0.5", 2), vec![], 1e-3),
        (line(&odd, "x < 0.5", 2), traced.to_vec(), 1e-3),
        (line(&even, "x >= 0", 0), fine.to_vec(), 1e-3),
        (line(&even, "x >= 0", 0), [fine, central].concat(), 1e-2),
        (equilibrium([&along_x, &along_y], "x > 0 && y > 0.25", 1.0, 2), vec![CLASSICAL], 1e-2),
        (equilibrium([&along_x, &along_y], "x >= 0 && y >= 0.25", 1.0, 1), vec![CLASSICAL], 1e-2),
    ];
    check_all(&rows, |(text, settings, most)| {
        let place = directory();
        let file = written(place.path(), text)?;
        let summary = Job::new(["run", &file]).set(settings).summary()?;
        let known = |key: &str| summary.value[key].as_f64().unwrap_or(f64::NAN);
        let [field, density] = ["error_l2_relative", "error_density_l1_relative"].map(known);
        summary.require(field <= *most && density <= *most, || format!("{field:e} {density:e}"))?;
        let warnings = summary.warnings();
        // The traced density is known to 1e-7.
        let density = if settings == traced { "by the particles" } else { "exact density" };
        for wrong in ["enters the grid", "by the particles", "in the box", density] {
            summary.require(!warnings.contains(wrong), || warnings.clone())?;
        }
        if settings == reflects {
            let omitted = summary.value["ledger"]["omitted"].to_string();
            return summary.require(omitted.contains("mass that enters"), || omitted.clone());
        }
        let [entered, estimate, error] = ["entered", "entered_estimate", "entered_error"]
            .map(|key| number(&summary, "mass", key));
        let (entered, estimate, error) = (entered?, estimate?, error?);
        let off = (entered - estimate).abs() / estimate;
        summary.require(off <= 5e-3 + 5.0 * error / estimate, || format!("{entered} {estimate}"))
    });
}

/// The total energy is kept if V is smooth and the elements resolve it.
#[test]
fn the_total_energy_is_kept() {
    let settings = ["solver.method=classical", "axis.0.x.cells=32", "axis.0.v.cells=28"];
    let job = run("harmonic_step.toml").set(&settings).set(&["scheme.degree=3"]);
    let summary = job.summary().unwrap();
    let energy = |key: &str| number(&summary, "energy", key).unwrap();
    let before = energy("kinetic_initial") + energy("potential_initial");
    let after = energy("kinetic") + energy("potential");
    assert!(energy("potential") > 0.0 && energy("kinetic") > 0.0);
    summary.holds(near("energy", after / before, 1.0, 2e-3)).unwrap();
    assert_eq!(summary.number("potential_energy").unwrap(), energy("potential"));
}

/// For measure-valued data, the masses are known, but not the inflow into the grid.
#[test]
fn measure_valued_data_have_a_ledger() {
    let settings = ["axis.0.x.cells=48", "axis.0.v.cells=48", "solver.tolerance=1e-4"];
    let summary = run("example2.toml").set(&settings).on(2).summary().unwrap();
    let mass = &summary.value["ledger"]["mass"];
    for unknown in ["entered", "lost", "interface_estimate"] {
        assert!(mass[unknown].is_null(), "{unknown}: {mass}");
    }
    let number = |key: &str| mass[key].as_f64().unwrap();
    near("formula", number("formula"), number("initial"), 0.05 * number("initial")).unwrap();
    let balance = number("formula") + number("entered_estimate") - number("left_estimate");
    near("balance", number("end"), balance, 0.1 * number("absolute")).unwrap();
    let printed = summary.value["ledger"]["omitted"].to_string();
    for why in ["not linear in the fields", "changes phi and psi"] {
        assert!(printed.contains(why), "{printed}");
    }
}

/// The mass of measure-valued data that is gone without having left gives a warning with a remedy.
/// Where the density nearly keeps its mass there is none.
#[test]
fn mass_that_measure_valued_data_lose_gives_a_warning() {
    const SLAB: &str = r#"
        time.end = 0.6
        solver.tolerance = 1e-4
        potential = [{ where = "x > 0.1 && x < 0.3", value = 0.15 }, { value = 0 }]
        [initial]
        density = "exp(-((x + 0.2)/0.15)^2)*(1 + 0.4*cos(2*pi*(y - 1)/0.8))"
        velocity = ["0.8", "0.2"]
        [[axis]]
        x = { lower = -0.6, upper = 0.6, cells = 24 }
        v = { lower = 0.2, upper = 1.2, cells = 20 }
        [[axis]]
        x = { lower = 1, upper = 1.8, cells = 8, boundary = "periodic" }
        v = { lower = -0.2, upper = 0.6, cells = 8 }
    "#;
    let place = directory();
    let file = written(place.path(), SLAB).unwrap();
    let velocity = "initial.velocity=['0.7','0.2']";
    let flat: &[&str] = &["potential=[{value=0}]", velocity, "axis.0.x.cells=48"];
    check_all(&[(&[][..], true), (flat, false)], |(settings, lost)| {
        let results = directory();
        let summary = Job::new(["run", &file]).set(settings).solve(results.path())?;
        let mass = |key: &str| number(&summary, "mass", key);
        let gone = mass("initial")? + mass("entered_estimate")? - mass("left_estimate")?;
        let share = (gone - mass("end")?) / mass("absolute")?;
        let found = summary.warnings();
        summary
            .require((share > 0.04) == *lost && share > -0.02, || format!("{share}: {found}"))?;
        let words = ["is missing that should be in the box", "more cells or a higher"];
        summary.require(words.iter().all(|words| found.contains(words) == *lost), || found)
    });
}

/// Constants have the effect of their numbers. Mistakes in them are reported with key and value.
#[test]
fn constants_have_the_effect_of_their_numbers() {
    let (named, plain) = (directory(), directory());
    let short = ["axis.0.x.cells=24", "axis.0.v.cells=20", "time.end=0.3", CLASSICAL];
    let job = run("step_up.toml").set(&short);
    let constants = ["constants.h=\"2*tenth\"", "constants.tenth=0.1", "potential.1.value=h"];
    job.clone().set(&constants).solve(named.path()).unwrap();
    job.solve(plain.path()).unwrap();
    let [named, plain] = [named, plain].map(|place| crate::support::field(place.path()).unwrap());
    assert_eq!(named, plain);
    for (setting, words) in [
        (&["potential.1.value=2*hh"][..], ["potential.1.value = \"2*hh\"", "unknown name \"hh\""]),
        (&["constants.a=b", "constants.b=2*a"], ["constants.a = \"b\"", "a -> b -> a"]),
        (&["constants.vx=1"], ["constants.vx = 1", "already means something"]),
    ] {
        let finished = check("step_up.toml").set(setting).run().unwrap();
        finished.ended(2, &words).unwrap();
    }
}

/// What the `hat` interface adds is estimated to within 2 % of the mass where particles go to and
/// fro between two barriers: the scatter of the factors of velocity cells is no growth.
#[test]
fn scatter_between_velocity_cells_is_no_growth() {
    const TEXT: &str = "[[axis]]\nx = { lower = 0, upper = 8, cells = 160 }\n\
        v = { lower = -1.45, upper = 1.45, cells = 116 }\n\
        [[potential]]\nwhere = \"x > 3.7 && x < 3.9\"\nvalue = \"0.32\"\n\
        [[potential]]\nwhere = \"x > 4.3 && x < 4.5\"\nvalue = \"0.5\"\n\
        [[potential]]\nvalue = \"0\"\n[initial]\n\
        f = \"exp(-((x - 2.5)/0.5)^2 - ((v - 0.95)/0.2)^2)\"\n[time]\nend = 3\n\
        [solver]\nmethod = \"classical\"\n";
    let place = directory();
    let path = written(place.path(), TEXT).unwrap();
    let summary = Job::new(["run", &path]).solve(&place.path().join("results")).unwrap();
    let number = |key: &str| number(&summary, "mass", key).unwrap();
    let measured = number("left_estimate") - number("lost");
    let off = (number("interface_estimate") - measured).abs() / number("initial");
    assert!(measured > 0.0 && off < 0.02, "{off}, {measured}: {}", summary.command);
}
