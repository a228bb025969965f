//! `phasewarp plan` and `check`: what a run will do, made without solving, is what it does.

use crate::support::{
    Finished, Job, case, cases, check, check_all, directory, near, parsed, plan, require, run,
    shrunk,
};
use phasewarp::plan::Plan;
use phasewarp::plan::layout::Resources;
use std::path::Path;

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
        // The hat interface does not keep mass, and not all data end within their box: said.
        let mut warnings = finished.output.lines().filter(|line| line.starts_with("warning"));
        let other = warnings.find(|line| !line.starts_with("warning: mass: "));
        require(other.is_none(), &finished, || "no other warning expected".into())
    });
}

/// A plan has a mesh of all ranks, for every case and number of them; the program's own, for few
/// ranks and many, says the same in words.
#[test]
fn plan_works_for_every_case_and_number_of_ranks() {
    check_all(&cases(), |name| {
        let read = parsed(name, shrunk(name))?;
        for ranks in [1, 2, 3, 4, 5, 6, 7, 64] {
            let resources = Resources { ranks, ..Resources::default() };
            let plan = Plan::new(&read, &resources, 1.0).map_err(|e| format!("{name}: {e}"))?;
            let mesh = &plan.layout.mesh;
            if mesh.space.iter().product::<usize>() * mesh.groups != ranks {
                return Err(format!("{name}: {mesh:?} on {ranks} ranks"));
            }
        }
        for ranks in [2, 64] {
            let plan = || plan(name, ranks).set(shrunk(name));
            let finished = plan().with(["--json"]).succeed()?;
            let value = finished.json()?;
            let mesh = &value["layout"]["mesh"];
            let blocks = mesh["space"].as_array().into_iter().flatten();
            let ranks_of_mesh: u64 =
                blocks.chain([&mesh["groups"]]).filter_map(|n| n.as_u64()).product();
            require(ranks_of_mesh == ranks as u64, &finished, || {
                format!("a mesh of {ranks_of_mesh} ranks: {mesh}")
            })?;
            let applications = planned(&finished, &value)?.applications.to_string();
            let says = ["memory", "modes", "degree", &applications, &ranks.to_string()];
            let text = plan().succeed()?;
            text.says(&text.output, &says)?;
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
        Some(applications) if memory > 0.0 => Ok(Planned { applications, memory }),
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
        let ranks = if tolerance.ends_with("1e-3") { 1 } else { 2 };
        let job = plan(name, ranks).set(small).set(&[tolerance]);
        let finished = job.with(["--json"]).succeed()?;
        let value = finished.json()?;
        let plan = planned(&finished, &value)?;
        let place = directory();
        let job = run(name).set(small).set(&[tolerance]).on(ranks);
        let summary = job.solve(place.path())?;
        let done = summary.number("matvecs")?;
        summary.holds(near(
            "applications planned over done",
            plan.applications / done,
            1.0,
            0.2,
        ))?;
        let memory = summary.number("memory_planned_bytes_per_rank")?;
        summary.holds(near(
            "memory planned alone over planned in the run",
            plan.memory / memory,
            1.0,
            0.2,
        ))
    });
}

/// `plan --calibrate` makes the plan of the run that it is started like, by every method, and tells
/// its seconds, of which the steps make up the whole. How near they are is measured by `make
/// calibration`; timings decide no test.
#[test]
fn calibrated_plans_are_those_of_the_run() {
    let rows = [
        (1, "example1.toml", vec!["solver.tolerance=1e-9"]),
        (2, "example1.toml", vec!["solver.tolerance=1e-9", "output.moments_every=0.3"]),
        (3, "example3.toml", vec!["axis.0.x.cells=12", "axis.1.x.cells=11"]),
        (4, "inflow_barrier.toml", vec![]),
        (2, "pulsed_inflow.toml", vec![]),
        (2, "example1.toml", vec!["solver.propagator.method=krylov", "axis.0.x.cells=64"]),
        (
            2,
            "step_up.toml",
            vec!["solver.propagator={method='crank-nicolson',step=0.05}", "solver.tolerance=1e-2"],
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
        let value = finished.json()?;
        let place = directory();
        let job = run(name).set(settings).on(ranks);
        let summary = job.solve(place.path())?;
        let blocks = summary.value["space_blocks"] == value["layout"]["mesh"]["space"];
        require(blocks, &finished, || "not the mesh of the run".to_owned())?;
        // The same modes, where a plan was made for them.
        let modes = value["warp"]["modes"].as_f64().unwrap_or(0.0);
        summary.holds(near("modes planned", modes, summary.number("modes")?, 0.0))?;
        let seconds = |key: &str| value["calibration"][key].as_f64().unwrap_or(f64::NAN);
        let (solve, wall) = (seconds("solve_seconds"), seconds("wall_seconds"));
        let sensible = solve > 0.0 && wall > solve && wall.is_finite();
        require(sensible, &finished, || format!("{solve} s of {wall} s"))
    };
    check_all(&rows, |(ranks, name, settings)| compare(*ranks, name, settings));
}

/// Fewer ranks than the run will have measure for it; nodes are counted and their memory is kept
/// to.
#[test]
fn plans_for_nodes() {
    let nodes = ["--ranks", "64", "--memory-per-node", "2GiB", "--ranks-per-node", "16"];
    let job = || Job::new(["plan", &case("example1.toml")]).with(nodes);
    let rows = [1, 2, 3];
    check_all(&rows, |ranks| {
        let finished = job().with(["--calibrate"]).on(*ranks).succeed()?;
        let says = [
            "64 = ",
            "nodes           4 of 16 ranks",
            "--ranks-x",
            "not the ranks of the run",
            "to solve",
        ];
        finished.says(&finished.output, &says)
    });
    let small = Job::new(["plan", &case("example1.toml"), "--ranks", "64"]);
    let small = small.with(["--memory-per-node", "100MiB", "--ranks-per-node", "16"]);
    small.is_refused(&["6.2 MiB"]).unwrap();
}

#[test]
fn every_case_is_in_the_readme() {
    let readme = std::fs::read_to_string(case("README.md")).unwrap();
    let papers = ["paper/example1.toml", "paper/example2.toml", "paper/example3.toml"];
    let all: Vec<String> = (cases().into_iter()).chain(papers.map(str::to_owned)).collect();
    check_all(&all, |name| {
        let row = readme.lines().find(|l| l.starts_with(&format!("| `{name}` |")));
        let row = row.ok_or_else(|| format!("cases/README.md has no row for {name}"))?;
        // The row's number of cells is the file's.
        let cells = format!("= {} |", parsed(name, &[])?.space.cells());
        match row.contains(&cells) {
            true => Ok(()),
            false => Err(format!("cases/README.md: \"{row}\" does not end with \"{cells}\"")),
        }
    });
    for word in readme.split(|c: char| !(c.is_alphanumeric() || "_./".contains(c))) {
        if let Some(name) = word.strip_prefix("cases/").filter(|n| n.ends_with(".toml")) {
            assert!(Path::new(&case(name)).is_file(), "cases/README.md names {name}");
        }
    }
}

/// Free transport of elements on a periodic axis with the central flux: `S = 0`, one mode is the
/// solution, on any ranks, and `plan` and `check` say so. Another flux, an open end or a jump of
/// `V` takes more.
#[test]
fn skew_systems_take_one_mode() {
    let free = [
        "potential=[{value='0'}]",
        "axis.0.x={lower=-1.5,upper=1.5,cells=6,boundary='periodic'}",
        "axis.0.v.cells=4",
        "scheme.degree=3",
        "scheme.flux=0",
        "exact={}",
        "initial.f=exp(cos(2*pi*x/3) - v^2)",
    ];
    let planned = plan("example1.toml", 1).set(&free).succeed().unwrap();
    assert!(planned.output.contains("as S = 0"), "{}", planned.output);
    let checked = check("example1.toml").set(&free).succeed().unwrap();
    assert!(checked.output.contains("S is zero"), "{}", checked.output);
    let modes = |more: &[&str], ranks: usize| {
        let place = directory();
        let job = run("example1.toml").set(&free).set(more).set(&["solver.verify=true"]);
        let summary = job.on(ranks).solve(place.path()).unwrap();
        let error = summary.number("error_semidiscrete").unwrap();
        assert!(error <= 1e-6, "{more:?}: {error:e}");
        summary.number("modes").unwrap()
    };
    for ranks in [1, 2, 4] {
        assert_eq!(modes(&["solver.tolerance=1e-6", "output.moments_every=0.4"], ranks), 1.0);
    }
    for other in
        ["scheme.flux=0.1", "axis.0.x.boundary='inflow'", "potential=[{value='0.3*cos(x)'}]"]
    {
        assert!(modes(&[other], 1) > 1.0, "{other}");
    }
}

/// `check` names each cause of `S` with the most that it adds, which no cause that is not there
/// has, and which together bound the norm.
#[test]
fn check_says_what_the_norm_of_s_is_made_of() {
    const CAUSES: [&str; 5] = [
        "flux between elements",
        "open ends of the box",
        "beyond the velocity box",
        "ends of the velocity box",
        "partial reflection",
    ];
    let periodic = "axis.0.x={lower=-1.5,upper=1.5,cells=6,boundary='periodic'}";
    let rows: [(&[&str], &[usize]); 4] = [
        (&["scheme.degree=2"], &[0, 1, 2]),
        (&["scheme.degree=2", "scheme.flux=0", periodic], &[2]),
        (&["scheme.degree=1", "potential=[{value='0.3*x'}]"], &[0, 1, 3]),
        (&["scheme.degree=2", "potential.0.reflection=0.5"], &[0, 1, 2, 4]),
    ];
    check_all(&rows, |(settings, causes)| {
        let job = check("example1.toml").set(settings).set(&["exact={}", "axis.0.v.cells=6"]);
        let finished = job.succeed()?;
        let line = finished.output.lines().find(|line| line.starts_with("Schrödingerized: "));
        let line = line.ok_or_else(|| format!("no line in {}", finished.output))?;
        for (k, cause) in CAUSES.iter().enumerate() {
            let named = line.contains(&format!("{cause} (at most "));
            require(named == causes.contains(&k), &finished, || format!("{cause}: {line}"))?;
        }
        let numbers: Vec<f64> = line
            .split("at most ")
            .skip(1)
            .filter_map(|rest| rest.split([')', ' ']).next()?.parse().ok())
            .collect();
        let (norm, parts) = numbers.split_last().ok_or("no numbers")?;
        let most = parts.iter().copied().fold(0.0, f64::max);
        let sum: f64 = parts.iter().sum();
        let right = parts.len() == causes.len() && most <= norm + 1e-3 && *norm <= sum + 1e-3;
        require(right, &finished, || format!("{parts:?} of {norm}: {line}"))
    });
}
