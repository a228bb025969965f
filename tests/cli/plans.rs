//! `phasewarp plan` and `check`: the plan, made without solving, agrees with the run.

use crate::support::{
    Finished, INTERFACES, Job, case, cases, check, check_all, directory, dissipative, near, number,
    of_case, parsed, plan, require, run, shrunk, text_of,
};
use crate::tolerances::{TOLERANCES, ranks_at, verified, verifying};
use phasewarp::plan::Plan;
use phasewarp::plan::layout::Resources;
use std::path::Path;

#[test]
fn check_describes_every_case() {
    check_all(&cases(), |name| {
        let finished = check(name).succeed()?;
        let text = text_of(case(name))?;
        let value: toml::Value = toml::from_str(&text).map_err(|e| format!("{name}: {e}"))?;
        let title = value["title"].as_str().unwrap_or_default();
        let mut wording = vec![title.to_owned()];
        for axis in value["axis"].as_array().into_iter().flatten() {
            for part in ["x", "v"] {
                wording.push(format!("{} cells", axis[part]["cells"]));
            }
        }
        for region in value["potential"].as_array().into_iter().flatten() {
            wording.push(region["value"].as_str().unwrap_or("?").to_owned());
        }
        for words in &wording {
            let printed = !words.is_empty() && finished.output.contains(words.as_str());
            require(printed, &finished, || format!("\"{words}\" is not printed"))?;
        }
        // The only warnings are those about mass: the hat interface does not keep it, and some data
        // reach the ends of their box.
        let mut warnings = finished.output.lines().filter(|line| line.starts_with("warning"));
        let other = warnings.find(|line| !line.starts_with("warning: mass: "));
        require(other.is_none(), &finished, || "no other warning expected".into())
    });
}

/// `plan` warns of the case as `check` does.
#[test]
fn plans_have_the_warnings_of_their_case() {
    let stray = ["potential.0.where='x < 0.013'"];
    let warning = |finished: &Finished| {
        let line = finished.output.lines().find(|line| line.contains("misses the faces"));
        line.map(str::to_owned)
    };
    let [checked, planned, json] = [
        of_case("check", "example1.toml"),
        plan("example1.toml", 1),
        plan("example1.toml", 1).with(["--json"]),
    ]
    .map(|job| job.set(&stray).succeed().unwrap());
    assert!(warning(&checked).is_some());
    assert_eq!(warning(&checked), warning(&planned));
    let json: serde_json::Value = serde_json::from_str(&json.output).unwrap();
    let warnings = json["warnings"].as_array().unwrap();
    assert!(warnings[0].as_str().unwrap().contains("misses the faces"), "{warnings:?}");
}

/// With and without output times, the printed degrees are those of a leg, the least one first.
#[test]
fn degrees_are_a_range() {
    let small = ["axis.0.x.cells=24", "axis.0.v.cells=16"];
    let mut ranges = Vec::new();
    for settings in [&[][..], &["output.fields_every=0.1"]] {
        let finished = plan("example1.toml", 1).set(&small).set(settings).succeed().unwrap();
        let (_, range) = finished.output.split_once("chebyshev: degree ").expect("a degree");
        let words: Vec<&str> = range.split_whitespace().take(3).collect();
        let [least, most] = [words[0], words[2]].map(|word| word.parse::<usize>().unwrap());
        assert!(0 < least && least <= most, "degree {least} to {most}");
        ranges.push(most);
    }
    assert!(ranges[1] < ranges[0], "the legs are shorter: {ranges:?}");
}

/// For every case and number of ranks, the mesh of the plan has all ranks. The text that the
/// program prints has the numbers of its JSON.
#[test]
fn plan_works_for_every_case_and_number_of_ranks() {
    let rows: Vec<(usize, String)> = cases().into_iter().enumerate().collect();
    check_all(&rows, |(k, name)| {
        let read = parsed(name, shrunk(name))?;
        for ranks in [1, 2, 3, 4, 5, 6, 7, 64] {
            let resources = Resources { ranks, ..Resources::default() };
            let plan = Plan::new(&read, &resources, 1.0).map_err(|e| format!("{name}: {e}"))?;
            let mesh = &plan.layout.mesh;
            if mesh.space.iter().product::<usize>() * mesh.groups != ranks {
                return Err(format!("{name}: {mesh:?} on {ranks} ranks"));
            }
        }
        // The program, for some of the cases.
        if k % 4 != 0 {
            return Ok(());
        }
        let ranks = [2, 64][k / 4 % 2];
        let plan = || plan(name, ranks).set(shrunk(name));
        let finished = plan().with(["--json"]).succeed()?;
        let applications = planned(&finished, ranks)?.applications.to_string();
        let wording = ["memory", "modes", "degree", &applications, &ranks.to_string()];
        let text = plan().succeed()?;
        text.contains(&text.output, &wording)
    });
}

/// Numbers of a plan.
struct Planned {
    applications: f64,
    /// Bytes per rank.
    memory: f64,
}

/// The numbers of a plan in JSON, whose mesh must have so many ranks.
fn planned(finished: &Finished, ranks: usize) -> Result<Planned, String> {
    let value = finished.json()?;
    let mesh = &value["layout"]["mesh"];
    let blocks = mesh["space"].as_array().into_iter().flatten();
    let of_mesh: u64 = blocks.chain([&mesh["groups"]]).filter_map(|n| n.as_u64()).product();
    require(of_mesh == ranks as u64, finished, || format!("a mesh of {of_mesh} ranks: {mesh}"))?;
    let applications = value["warp"]["applications"].as_f64();
    let arrays = value["layout"]["arrays"].as_array().into_iter().flatten();
    let memory: f64 = arrays.filter_map(|a| a[1].as_f64()).sum();
    match applications {
        Some(applications) if memory > 0.0 => Ok(Planned { applications, memory }),
        _ => Err(finished.report("no warp.applications or layout.arrays in the plan")),
    }
}

/// The applications and the memory of a plan agree with those of the run to 20 %, at one tolerance
/// for each case. The runs are those that measure their errors.
#[test]
fn plans_agree_with_runs() {
    let dissipative = dissipative();
    let mut rows: Vec<(String, &str)> = cases()
        .into_iter()
        .filter(|name| !dissipative.contains(name))
        .map(|n| (n, "1e-6"))
        .collect();
    let with_tolerance = |(n, name)| (name, TOLERANCES[n % 4]);
    rows.extend(dissipative.into_iter().enumerate().map(with_tolerance));
    check_all(&rows, |(name, tolerance)| {
        let (settings, ranks) = (verifying(INTERFACES[0], tolerance), ranks_at(tolerance));
        let settings = settings.each_ref().map(String::as_str);
        let finished = plan(name, ranks).set(shrunk(name)).set(&settings).with(["--json"]);
        let plan = planned(&finished.succeed()?, ranks)?;
        let summary = verified(name, INTERFACES[0], tolerance).summary()?;
        let applications = plan.applications / summary.number("matvecs")?;
        summary.holds(near("applications planned over done", applications, 1.0, 0.2))?;
        let memory = plan.memory / summary.number("memory_planned_bytes_per_rank")?;
        summary.holds(near("memory planned alone over planned in the run", memory, 1.0, 0.2))
    });
}

/// `plan --calibrate` makes the plan of a run with the same arguments, by every method, and
/// predicts its time. `make calibration` measures the accuracy of the prediction; timings decide no
/// test.
#[test]
fn calibrated_plans_equal_those_of_the_run() {
    let rows = [
        (2, "example1.toml", vec!["solver.tolerance=1e-9", "output.moments_every=0.3"]),
        (3, "example3.toml", vec!["axis.0.x.cells=12", "axis.1.x.cells=11"]),
        (4, "inflow_barrier.toml", vec![]),
        (2, "pulsed_inflow.toml", vec!["solver.verify=true"]),
        (2, "quadrant2d.toml", vec!["axis.0.x.cells=6", "axis.1.x.cells=5"]),
        (1, "example1.toml", vec!["solver.propagator.method=krylov", "axis.0.x.cells=64"]),
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
        let job = run(name).set(settings).on(ranks);
        let summary = job.summary()?;
        let blocks = summary.value["space_blocks"] == value["layout"]["mesh"]["space"];
        require(blocks, &finished, || "not the mesh of the run".to_owned())?;
        // The same modes; a classical plan has none.
        let modes = value["warp"]["modes"].as_f64().unwrap_or(0.0);
        summary.holds(near("modes planned", modes, summary.number("modes")?, 0.0))?;
        let seconds = |key: &str| number(&value["calibration"][key]);
        let (solve, wall) = (seconds("solve_seconds"), seconds("wall_seconds"));
        let sensible = solve > 0.0 && wall > solve && wall.is_finite();
        require(sensible, &finished, || format!("{solve} s of {wall} s"))?;
        // Every step of the run is predicted, and as much memory as the run itself plans.
        let of_run = summary.value["seconds"].as_object().ok_or("no seconds")?;
        let mut steps = of_run.keys().filter(|step| !["start", "readout"].contains(&step.as_str()));
        let missing = steps.find(|step| value["calibration"]["seconds"].get(step).is_none());
        require(missing.is_none(), &finished, || format!("no {missing:?} in the prediction"))?;
        let arrays = value["layout"]["arrays"].as_array().into_iter().flatten();
        let memory: f64 = arrays.filter_map(|a| a[1].as_f64()).sum();
        let memory = memory / summary.number("memory_planned_bytes_per_rank")?;
        summary.holds(near("memory calibrated over planned in the run", memory, 1.0, 0.1))
    };
    check_all(&rows, |(ranks, name, settings)| compare(*ranks, name, settings));
}

/// A calibration on fewer ranks than the planned run says so. The plan counts the nodes and keeps
/// their memory limit.
#[test]
fn plans_for_nodes() {
    let nodes = ["--ranks", "64", "--memory-per-node", "2GiB", "--ranks-per-node", "16"];
    let job = || of_case("plan", "example1.toml").with(nodes);
    let rows = [1, 2, 3];
    check_all(&rows, |ranks| {
        let finished = job().with(["--calibrate"]).on(*ranks).succeed()?;
        let wording = [
            "64 = ",
            "nodes           4 of 16 ranks",
            "--ranks-x",
            "not the ranks of the run",
            "to solve",
        ];
        finished.contains(&finished.output, &wording)
    });
    let small = Job::new(["plan", &case("example1.toml"), "--ranks", "64"]);
    let small = small.with(["--memory-per-node", "100MiB", "--ranks-per-node", "16"]);
    let few = "program and libraries alone take more than that: fewer ranks on a node";
    let refused = small.run().unwrap();
    refused.ended(2, &["6.2 MiB", few]).unwrap();
    assert!(!refused.errors.contains("fewer cells"), "{}", refused.report("no remedy here"));
}

/// The process mesh of a plan or of a run.
#[derive(Debug, PartialEq)]
struct Mesh {
    blocks: serde_json::Value,
    groups: serde_json::Value,
}

/// `plan` for one number of ranks and for several, `plan --calibrate` and `run` choose the same
/// process mesh; each case has half of the numbers. By the model of the plan, no other mesh is
/// faster by more than 15 %.
#[test]
fn plans_and_runs_choose_the_same_mesh() {
    const NUMBERS: [usize; 7] = [1, 2, 3, 4, 6, 8, 16];
    const FASTER: f64 = 1.15;
    let rows: [(&str, &[&str]); 6] = [
        ("example1.toml", &["axis.0.x.cells=64", "axis.0.v.cells=64"]),
        ("example1.toml", &["axis.0.x.cells=64", "axis.0.v.cells=64", "solver.tolerance=1e-9"]),
        ("example1.toml", &["axis.0.x.cells=32", "axis.0.v.cells=32", "output.warped_field=true"]),
        ("pulsed_inflow.toml", shrunk("pulsed_inflow.toml")),
        ("smooth-beams.toml", shrunk("smooth-beams.toml")),
        ("barrier2d.toml", &[]),
    ];
    let rows: Vec<_> = rows.iter().enumerate().collect();
    check_all(&rows, |&(row, (name, settings))| {
        let list = NUMBERS.map(|n| n.to_string()).join(",");
        let planned = |words: &[&str]| {
            let job = Job::new(["plan", &case(name), "--json"]).with(words.to_vec());
            let finished = job.set(settings).succeed()?;
            finished.json()
        };
        let table = planned(&["--ranks", &list])?;
        for (k, ranks) in NUMBERS.iter().enumerate().skip(row % 2).step_by(2) {
            let line = &table[k];
            let of_table =
                Mesh { blocks: line["space_blocks"].clone(), groups: line["mode_groups"].clone() };
            let same = |what: &str, mesh: Mesh| {
                if mesh == of_table {
                    Ok(())
                } else {
                    Err(format!(
                        "{name} {settings:?} on {ranks} ranks: {what} {mesh:?}, \
                the table {of_table:?}"
                    ))
                }
            };
            let mesh_of = |plan: &serde_json::Value| Mesh {
                blocks: plan["layout"]["mesh"]["space"].clone(),
                groups: plan["layout"]["mesh"]["groups"].clone(),
            };
            let number = ranks.to_string();
            let plan = planned(&["--ranks", &number])?;
            same("plan", mesh_of(&plan))?;
            let times = plan["advice"]["meshes"].as_array().into_iter().flatten();
            let fastest = times.filter_map(|mesh| mesh["cost"].as_f64()).fold(1.0, f64::min);
            if fastest < 1.0 / FASTER {
                return Err(format!("{name} {settings:?} on {ranks} ranks: {}", plan["advice"]));
            }
            if [3, 8].contains(ranks) {
                same("--calibrate", mesh_of(&planned(&["--ranks", &number, "--calibrate"])?))?;
            }
            if *ranks > 4 {
                continue;
            }
            let summary = run(name).set(settings).on(*ranks).summary()?.value;
            let [blocks, groups] = ["space_blocks", "mode_groups"].map(|key| summary[key].clone());
            same("run", Mesh { blocks, groups })?;
        }
        Ok(())
    });
}

/// For several numbers of ranks, `plan` prints one line each and the largest number that is worth
/// its cost.
#[test]
fn numbers_of_ranks_are_compared() {
    let job = |more: &[&str]| {
        Job::new(["plan", &case("example1.toml"), "--ranks-per-node", "16", "--ranks"])
            .with(more.to_vec())
    };
    let finished = job(&["1..4096", "--json"]).succeed().unwrap();
    let lines = finished.json().unwrap();
    let lines = lines.as_array().expect("an array");
    let numbers = |key: &str| -> Vec<f64> { lines.iter().map(|line| number(&line[key])).collect() };
    let (ranks, time, efficiency) = (numbers("ranks"), numbers("time"), numbers("efficiency"));
    assert_eq!(ranks, (0..13).map(|k| f64::from(1 << k)).collect::<Vec<_>>());
    let marked = |key: &str| -> Vec<f64> {
        let those = lines.iter().filter(|line| line[key] == true);
        those.filter_map(|line| line["ranks"].as_f64()).collect()
    };
    let (worth, last) = (marked("worth_it"), marked("recommended"));
    assert_eq!(last[..], worth[worth.len() - 1..], "{}", finished.output);
    // 128 x 128 cells are too few for thousands of ranks, and enough for two.
    assert!((2.0..1024.0).contains(&last[0]), "{}", finished.output);
    for (k, (&n, &t)) in ranks.iter().zip(&time).enumerate() {
        assert!((efficiency[k] - 1.0 / (n * t)).abs() < 1e-12, "{n}: {}", efficiency[k]);
        assert!(!worth.contains(&n) || efficiency[k] >= 0.5, "{n}: {}", efficiency[k]);
        let blocks = lines[k]["space_blocks"][0].as_f64().unwrap_or(0.0);
        assert_eq!(blocks * numbers("mode_groups")[k], n);
        let on_node = numbers("memory")[k] * n.min(16.0);
        assert_eq!(
            (numbers("memory_per_node")[k], numbers("nodes")[k]),
            (on_node, (n / 16.0).ceil())
        );
    }
    let text = job(&["1,2,4096"]).succeed().unwrap();
    text.contains(&text.output, &["last worth it", "not worth it", "up to 2 ranks; more"]).unwrap();
    assert!(text.output.lines().all(|line| line.chars().count() <= 100), "{}", text.output);
    // The efficiency is against one rank, also if the list begins above it.
    let list = |text: &str| job(&[text, "--json"]).succeed().unwrap().json().unwrap();
    let (long, short) = (list("1,2,4,…,64"), list("4,64"));
    for (k, line) in [(2, &short[0]), (6, &short[1])] {
        let same = (long[k]["ranks"].as_u64(), long[k]["efficiency"].as_f64())
            == (line["ranks"].as_u64(), line["efficiency"].as_f64());
        assert!(same, "{} and {line}", long[k]);
    }
    // Seven ranks have no more to do than one, for which six modes are one batch.
    let six = Job::new(["plan", &case("step3d.toml"), "--ranks"]);
    let text = six.clone().with(["7"]).with(["--json"]).succeed().unwrap();
    assert_eq!(text.json().unwrap()["warp"]["modes"].as_u64(), Some(6), "{}", text.output);
    let text = six.with(["7,11"]).succeed().unwrap();
    text.contains(&text.output, &["14 %", "worth it        none of these"]).unwrap();
    assert!(!text.output.contains("last worth it"), "{}", text.output);
    let text = job(&["1,4096"]).succeed().unwrap();
    text.contains(&text.output, &["up to 1 rank; more"]).unwrap();
    // All numbers are worth it. If some do not fit into memory, the first that fits is the
    // reference.
    let text = job(&["1,2"]).succeed().unwrap();
    text.contains(&text.output, &["up to 2 ranks, the last of these"]).unwrap();
    let limited = |limit: &str| {
        job(&["1,64"]).with(["--memory-per-rank", limit]).set(&["output.warped_field=true"])
    };
    let finished = limited("50MiB").with(["--json"]).succeed().unwrap();
    let value = finished.json().unwrap();
    assert!(
        value[0]["refused"].as_str().is_some_and(|why| why.ends_with("a rank, 50.0 MiB there"))
    );
    assert_eq!(
        (value[1]["time"].as_f64(), value[1]["recommended"].as_bool()),
        (Some(1.0), Some(true))
    );
    limited("10MiB").is_refused(&["10.0 MiB"]).unwrap();
}

/// With `--calibrate`, the table has seconds and core-hours, which agree with the relative times.
#[test]
fn compared_numbers_of_ranks_are_calibrated() {
    let job = Job::new(["plan", &case("example1.toml"), "--ranks", "1,2,8", "--calibrate"]);
    let finished = job.with(["--json"]).on(2).succeed().unwrap();
    let table = finished.json().unwrap();
    for line in table.as_array().expect("an array") {
        let of = |key: &str| number(&line[key]);
        let hours = of("ranks") * of("seconds") / 3600.0;
        assert!(of("seconds") > 0.0 && (of("core_hours") / hours - 1.0).abs() < 1e-12);
        let of_first = of("seconds") / number(&table[0]["seconds"]);
        assert!((of("time") / of_first - 1.0).abs() < 1e-12, "{}", finished.output);
    }
}

/// A stub of a launcher: it writes its arguments, each in brackets, and ends a run with a
/// checkpoint if `STOPS` is set.
const LAUNCHER: &str = r#"#!/bin/bash
printf '<%s>' "$@" >>"$CALLS"
echo >>"$CALLS"
if [ "$3" = run ] && [ -n "${STOPS:-}" ]; then
    mkdir -p "$6/checkpoint/1"
    echo '  "finished": 8' >"$6/checkpoint/1/manifest.json"
    exit 75
fi
"#;

/// `plan --sbatch` writes a script that bash accepts and that starts the run, with any names of
/// files. If the run stops, the script submits itself again.
#[test]
fn job_scripts_are_written() {
    const NAME: &str = "a b;touch gone $(touch gone) 'c'.toml";
    const RESULTS: &str = "all of; it's `touch gone`";
    // The path as the program prints it.
    let place = directory();
    let real = place.path().canonicalize().unwrap();
    let at = |name: &str| real.join(name);
    std::fs::copy(case("example1.toml"), at(NAME)).unwrap();
    // The script is submitted from another directory.
    let elsewhere = directory();
    let title = "title=\"it's $HOME; touch gone\"";
    let job = |more: &[&str]| {
        let words = ["plan", NAME, "--sbatch", "my job.sbatch", "-o", RESULTS];
        Job::new(words).set(&[title]).with(more.to_vec()).inside(&real)
    };
    job(&["--ranks", "1,2,4096", "--ranks-per-node", "16"]).succeed().unwrap();
    job(&[]).is_refused(&["my job.sbatch", "--force"]).unwrap();
    let script = text_of(at("my job.sbatch")).unwrap();
    let header: Vec<&str> = script.lines().filter(|line| line.starts_with("#SBATCH")).collect();
    assert_eq!(
        header[..3],
        [
            "#SBATCH --job-name=phasewarp-a-b-touch-gone---touch-gone---c-",
            "#SBATCH --ntasks=2",
            "#SBATCH --ntasks-per-node=2"
        ]
    );
    assert!(header[4].starts_with("#SBATCH --mem-per-cpu=") && header[4].ends_with('M'));
    assert!(script.contains("remove one #"), "{script}");
    assert!(script.contains("\n##SBATCH --time=01:00:00\n"), "{script}");
    let shown = [NAME, RESULTS, "my job.sbatch"].map(|name| at(name).display().to_string());
    let [name, results, job_script] = &shown;
    let started = bash(elsewhere.path(), &["-n", job_script], &[]);
    assert_eq!(started.code, 0, "{}", started.calls);

    // Slurm starts the script; then once more, and the run stops with a checkpoint.
    let run = format!("<run><{name}><-o><{results}><--resume>");
    let sets = format!("<--set><{title}>");
    let started = bash(elsewhere.path(), &[job_script], &[("SLURM_NTASKS", "2")]);
    assert_eq!(started.code, 0, "{}", started.calls);
    let calls: Vec<&str> = started.calls.lines().collect();
    assert_eq!(calls[0], format!("<1><PROGRAM><check><{name}>{sets}"));
    assert_eq!(calls[1], format!("<1><PROGRAM><plan><{name}><--ranks><2>{sets}"));
    assert_eq!(calls[2], format!("<2><PROGRAM>{run}{sets}"));
    let in_job = [
        ("SLURM_NTASKS", "2"),
        ("SLURM_JOB_ID", "7"),
        ("SLURM_JOB_NAME", "n"),
        ("SLURM_JOB_NUM_NODES", "1"),
        ("SLURM_JOB_PARTITION", "p"),
        ("STOPS", "yes"),
    ];
    let stopped = bash(elsewhere.path(), &[job_script], &in_job);
    assert_eq!(stopped.code, 75, "{}", stopped.calls);
    let again = format!("<{job_script}>");
    let last = stopped.calls.lines().last().unwrap_or_default();
    assert!(last.starts_with("<--job-name=n>") && last.ends_with(&again), "{}", stopped.calls);
    let gone = [at("gone"), elsewhere.path().join("gone")];
    assert!(gone.iter().all(|path| !path.exists()), "a file name was executed");
    // Without `PHASEWARP` in the environment, the script starts the program that planned.
    let own = format!("program={}\n", Path::new(env!("CARGO_BIN_EXE_phasewarp")).display());
    assert!(script.contains(&own), "{script}");
    // The script uses the settings of the site.
    std::fs::create_dir(at("jobscripts")).unwrap();
    let site = "LAUNCH='launcher --of-site' most_jobs=1 reserve=60 memory_per_node=";
    std::fs::write(at("jobscripts/env.sh"), format!("{site}\nprogram=absent\n")).unwrap();
    job(&["--force"]).succeed().unwrap();
    let started = bash(elsewhere.path(), &[job_script], &[]);
    assert!(started.calls.starts_with("<--of-site><1><PROGRAM><check>"), "{}", started.calls);

    // With `--calibrate`, the script has the predicted time. Without -o, the results go where a run
    // puts them.
    let job = Job::new(["plan", NAME, "--sbatch", "timed", "--calibrate"]).inside(&real);
    job.succeed().unwrap();
    let script = text_of(at("timed")).unwrap();
    assert!(script.contains("#SBATCH --ntasks=1\n#SBATCH --cpus-per-task=1\n"), "{script}");
    assert!(script.contains("#SBATCH --time=00:0"), "{script}");
    // Without Slurm it takes as many ranks.
    let started = bash(&real, &["timed"], &[]);
    assert!(started.calls.contains("<--ranks><1>"), "{}", started.calls);
    let results = format!("results/{}", NAME.trim_end_matches(".toml"));
    let results = at(&results).display().to_string().replace('\'', r"'\''");
    assert!(script.ends_with(&format!("    '{results}'\n")), "{script}");
    let chosen = ["--set", "solver.accuracy=1e-2", "--force"];
    job.with(chosen).is_refused(&["--sbatch", "solver.accuracy", "--accuracy"]).unwrap();
}

/// The exit code of a script and the commands that it called.
struct Started {
    code: i32,
    calls: String,
}

/// Starts bash inside `place` with stubs of the launcher and of Slurm's commands.
fn bash(place: &Path, words: &[&str], variables: &[(&str, &str)]) -> Started {
    let (stubs, calls) = (place.join("stubs"), place.join("calls"));
    std::fs::create_dir_all(&stubs).unwrap();
    let _ = std::fs::remove_file(&calls);
    for name in ["launcher", "sbatch", "squeue"] {
        let stub = stubs.join(name);
        std::fs::write(&stub, LAUNCHER).unwrap();
        std::fs::set_permissions(&stub, std::os::unix::fs::PermissionsExt::from_mode(0o755))
            .unwrap();
    }
    let path = format!("{}:{}", stubs.display(), std::env::var("PATH").unwrap_or_default());
    let mut command = std::process::Command::new("bash");
    command.args(words).current_dir(place).env("PATH", path).envs(variables.iter().copied());
    command.env("LAUNCH", "launcher").env("PHASEWARP", "PROGRAM").env("CALLS", &calls);
    let output = command.output().unwrap();
    eprint!("{}", String::from_utf8_lossy(&output.stderr));
    let calls = std::fs::read_to_string(&calls).unwrap_or_default();
    Started { code: output.status.code().unwrap_or(-1), calls }
}

#[test]
fn every_case_is_in_the_readme() {
    let readme = text_of(case("README.md")).unwrap();
    let papers = ["paper/example1.toml", "paper/example2.toml", "paper/example3.toml"];
    let all: Vec<String> = (cases().into_iter()).chain(papers.map(str::to_owned)).collect();
    check_all(&all, |name| {
        let row = readme.lines().find(|l| l.starts_with(&format!("| `{name}` |")));
        let row = row.ok_or_else(|| format!("cases/README.md has no row for {name}"))?;
        // The row's number of cells is the file's.
        let cells = format!("= {} |", parsed(name, &[])?.space.cells());
        if row.contains(&cells) {
            Ok(())
        } else {
            Err(format!("cases/README.md: \"{row}\" does not end with \"{cells}\""))
        }
    });
    for word in readme.split(|c: char| !(c.is_alphanumeric() || "_./".contains(c))) {
        if let Some(name) = word.strip_prefix("cases/").filter(|n| n.ends_with(".toml")) {
            assert!(Path::new(&case(name)).is_file(), "cases/README.md names {name}");
        }
    }
}

/// Free transport of elements on a periodic axis with the central flux has `S = 0`: one mode is the
/// solution, on any ranks, and `plan` and `check` say so. Another flux, an open end or a force
/// needs more modes.
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
        let job = run("example1.toml").set(&free).set(more).set(&["solver.verify=true"]);
        let summary = job.on(ranks).summary().unwrap();
        let error = summary.number("error_semidiscrete").unwrap();
        assert!(error <= 1e-6, "{more:?}: {error:e}");
        summary.number("modes").unwrap()
    };
    for ranks in [1, 4] {
        assert_eq!(modes(&["solver.tolerance=1e-6", "output.moments_every=0.4"], ranks), 1.0);
    }
    for other in
        ["scheme.flux=0.1", "axis.0.x.boundary='inflow'", "potential=[{value='0.3*cos(x)'}]"]
    {
        assert!(modes(&[other], 1) > 1.0, "{other}");
    }
}

/// `check` names the causes of `S` that the case has, each with a bound on its part of the norm.
/// The largest bound is at most the norm, and their sum is at least the norm.
#[test]
fn check_reports_the_parts_of_the_norm_of_s() {
    const CAUSES: [&str; 5] = [
        "flux between elements", "open ends of the box", "beyond the velocity box",
        "ends of the velocity box", "partial reflection",
    ];
    let periodic = "axis.0.x={lower=-1.5,upper=1.5,cells=6,boundary='periodic'}";
    let rows: [(&[&str], &[usize]); 4] = [
        (&["scheme.degree=2"], &[0, 1, 2]),
        (&["scheme.degree=2", "scheme.flux=0", periodic], &[2]),
        (&["scheme.degree=1", "potential=[{value='0.3*x'}]"], &[0, 1, 3]),
        // Partial reflection comes with particles beyond the velocity box at the jump.
        (&["scheme.degree=2", "potential.0.reflection=0.5"], &[0, 1, 4]),
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

/// `check` and `plan` say at first that a step takes long, and nothing of short ones.
#[test]
fn slow_steps_are_announced() {
    let fine = ["axis.0.x.cells=600000", "axis.0.v.cells=2"];
    let points = ["solver.warp.points=1048580", "solver.warp.interval=[-6,6]"];
    let coarse = ["axis.0.x.cells=8", "axis.0.v.cells=4", "solver.tolerance=1e-3"];
    let evaluating = "1.200e6 cells, 6.000e5 of space: evaluating V and planning take about";
    let modes = "solver.warp.points = 1048580: the work of each mode is planned, which may take";
    let rows: [(&str, &[&str], Option<&str>); 5] = [
        ("check", &fine, Some(evaluating)),
        ("plan", &fine, Some(evaluating)),
        ("check", &coarse, None),
        ("plan", &coarse, None),
        ("plan", &[&coarse[..], &points].concat(), Some(modes)),
    ];
    check_all(&rows, |(command, settings, announced)| {
        let finished = of_case(command, "example1.toml").set(settings).succeed()?;
        let found = finished.errors.lines().find(|line| line.contains("take"));
        let is_first = finished.errors.starts_with(announced.unwrap_or_default());
        require(announced.is_some() == found.is_some() && is_first, &finished, || {
            format!("{announced:?} expected, found {found:?}")
        })
    });
}
