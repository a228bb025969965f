//! The first commands of a user: `init`, `check --json`, `schema`, `completions`, `man`.

use crate::support::{
    Job, Mistake, case, cases, check, check_all, directory, plan, shrunk, text_of,
};

/// The case that `init` writes passes `check` without a warning in each dimension. In one dimension
/// its grid is fine enough for its tolerance.
#[test]
fn init_writes_a_case_without_warnings() {
    let place = directory();
    check_all(&["1", "2", "3"], |dimension| {
        let file = place.path().join(format!("{dimension}.toml")).display().to_string();
        let init = Job::new(["init", &file, "--dimension", dimension]);
        init.clone().on(if *dimension == "1" { 2 } else { 1 }).succeed()?;
        let written = text_of(&file)?;
        init.is_refused(&[&file, "--force"])?;
        init.with(["--force"]).succeed()?;
        if std::fs::read_to_string(&file).ok().as_deref() != Some(&written) {
            return Err(format!("{file}: another text"));
        }
        let found = Job::new(["check", &file, "--json"]).succeed()?.json()?;
        if found["warnings"].as_array().is_none_or(|warnings| !warnings.is_empty()) {
            return Err(format!("{file}: warnings: {}", found["warnings"]));
        }
        Ok(())
    });
    let job = Job::new(["run", "1.toml", "-o", "1"]).inside(place.path());
    let finished = job.succeed().unwrap();
    finished.contains(&finished.output, &["done in", "distance to the exact"]).unwrap();
    let resolved = !finished.output.contains("UNDER-RESOLVED");
    assert!(resolved, "{}", finished.report("a coarse grid"));
    assert!(!finished.errors.contains("warning"), "{}", finished.report("a warning"));
    // A case without a title has the name of its file.
    let nameless = Job::new(["run", "1.toml", "-o", "2", "--set", "title=''"]).inside(place.path());
    let small = ["axis.0.x.cells=12", "axis.0.v.cells=12"];
    let finished = nameless.set(&small).succeed().unwrap();
    finished.contains(&finished.errors, &["1.toml: 1296 unknowns"]).unwrap();
    Job::new(["init", "--dimension", "4"]).is_refused(&["--dimension", "'4'", "1..=3"]).unwrap();
}

/// The output of `check --json` has the numbers of the case.
#[test]
fn a_case_is_checked_as_json() {
    check_all(&cases(), |name| {
        // On two ranks only one prints.
        let ranks = if name == "example1.toml" { 2 } else { 1 };
        let found = check(name).set(shrunk(name)).with(["--json"]).on(ranks).succeed()?.json()?;
        let axes = found["axes"].as_array().ok_or("no axes")?;
        let cells = axes.iter().map(|axis| {
            let number = |key: &str| axis[key].as_u64().unwrap_or(0);
            number("elements") * (number("degree") + 1)
        });
        let (cells, kept) = (cells.product::<u64>(), found["cells"].as_u64().unwrap_or(0));
        let reduced = found["dropped"].as_array().is_some_and(|lines| !lines.is_empty());
        if kept == 0 || kept > cells || (!reduced && kept != cells) {
            return Err(format!("{kept} unknowns, {cells} of all axes"));
        }
        let rate = found["bounds"]["rate"].as_f64().unwrap_or(0.0);
        if rate <= 0.0 || found["settings"]["time.end"].is_null() || found["ledger"].is_null() {
            return Err(format!("{found}"));
        }
        Ok(())
    });
    let narrow = check("example1.toml").with(["--json"]);
    let narrow = narrow.set(&["axis.0.v.lower=-0.6", "axis.0.v.upper=0.6"]);
    let found = narrow.succeed().unwrap().json().unwrap();
    assert!(found["warnings"].to_string().contains("velocit"), "{}", found["warnings"]);
}

/// `check --json` reports the refusal of a case as JSON, in addition to the message.
#[test]
fn a_refused_case_is_reported_as_json() {
    let example = case("example1.toml");
    // Setting, key, value, and a text of the message.
    let rows = [
        ("time.end=-1", "time.end", "-1", "above"),
        ("solver.tolerence=1", "solver.tolerence", "", "did you mean"),
        ("degree=3", "degree", "", "(did you mean axis.N.x.degree or axis.N.v.degree or scheme."),
        ("initial.f=1/x + ln(v)", "initial.f", "1/x + ln(v)", "finite"),
        ("initial={table={file='none.csv'}}", "initial.table.file", "none.csv", "No such file"),
        ("initial.f=1 if x < -1", "initial.f", "1 if x < -1", "an `else` gives the value"),
        ("initial.field=none.h5", "initial.field", "none.h5", "No such file"),
        ("solver.tolerance=1e-16", "solver.tolerance", "1e-16", "round-off"),
    ];
    check_all(&rows, |(set, key, value, wording)| {
        // On two ranks only one prints.
        let ranks = if *key == "time.end" { 2 } else { 1 };
        let finished = Job::new(["check", &example, "--json"]).set(&[set]).on(ranks).run()?;
        finished.ended(2, &[wording])?;
        let found = finished.json()?;
        let error = &found["error"];
        let printed = |name: &str| error[name].as_str().unwrap_or_default().to_owned();
        let is_right = found["ok"] == false
            && printed("key") == *key
            && printed("value").contains(value)
            && printed("message").contains(wording)
            && printed("set").starts_with(key.split('.').next().unwrap_or_default())
            && error["exit_code"] == 2;
        if is_right { Ok(()) } else { Err(format!("{found:#}")) }
    });
    // A mistake in a file is reported with its line and column.
    let place = directory();
    let path = place.path().join("mine.toml");
    let text = text_of(&example).unwrap();
    std::fs::write(&path, text.replacen("cells = 128", "cells = 0", 1)).expect("a file");
    let file = path.display().to_string();
    let finished = Job::new(["check", &file, "--json"]).run().expect("an end");
    let error = finished.json().expect("JSON")["error"].take();
    assert_eq!((&error["file"], &error["key"]), (&file.into(), &"axis.0.x.cells".into()));
    assert!(error["line"].as_u64() > Some(1) && error["column"].as_u64() > Some(1), "{error}");
    assert!(error["set"].is_null(), "{error}");
    // A file that is not there.
    let missing = place.path().join("none.toml").display().to_string();
    let finished = Job::new(["check", &missing, "--json"]).run().expect("an end");
    let found = finished.json().expect("JSON");
    let message = found["error"]["message"].as_str().unwrap_or_default();
    assert!(found["ok"] == false && finished.code == Some(2), "{found}");
    assert!(message.contains("none.toml") && message.contains("No such file"), "{found}");
}

/// Formulas of constants can replace numbers, in files and in settings.
#[test]
fn numbers_are_formulas_of_constants() {
    let constants = "constants={T=0.25, L='6*T', eps='2*5e-7'}";
    let settings = |named: bool| {
        let pairs = [
            ("time.end", "2*T", "0.5"),
            ("axis.0.x.lower", "-L", "-1.5"),
            ("axis.0.x.upper", "L", "1.5"),
            ("solver.tolerance", "eps", "1e-6"),
            // In `--set`, a formula in a list needs no quotes.
            ("output.field_times", "[T, max(0.1, 0.3)]", "[0.25, 0.3]"),
            ("solver.warp.shift", "0*T", "0"),
            ("inflow.value", "1", "1"),
        ];
        pairs.map(|(key, name, number)| format!("{key}={}", if named { name } else { number }))
    };
    let plan = |named: bool| {
        let settings = settings(named);
        let settings: Vec<&str> = settings.iter().map(String::as_str).collect();
        let job = plan("example1.toml", 1).with(["--json"]).set(&[constants]).set(&settings);
        job.succeed().unwrap().json().unwrap()["warp"].take()
    };
    let named = plan(true);
    assert!(named.is_object());
    assert_eq!(named, plan(false));
    let rows: [(&str, &[&str]); 7] = [
        ("time.end=2*U", &["time.end = \"2*U\"", "unknown name \"U\" at character 3", "a number"]),
        ("time.end=-T", &["time.end = \"-T\" (-0.25)", "above"]),
        ("time.end=x", &["unknown name \"x\""]),
        ("time.end=1/0", &["time.end = \"1/0\"", "division by zero at character 2"]),
        ("time.end=exp(1e3)", &["time.end = \"exp(1e3)\"", "a finite number"]),
        ("axis.0.x.cells=2*T", &["axis.0.x.cells", "whole number"]),
        ("solver.warp.delta=maxx", &["solver.warp.delta", "did you mean \"max\""]),
    ];
    check_all(&rows, |(set, wording)| {
        Mistake::set("example1.toml", &[constants, set], wording).refused_by_reader()
    });
}

/// Schema, completions and manual pages cover every command and key.
#[test]
fn schema_completions_and_manual_pages_are_complete() {
    let schema = Job::new(["schema"]).on(2).succeed().unwrap().json().unwrap();
    let end = &schema["properties"]["time"]["properties"]["end"]["type"];
    assert_eq!(*end, serde_json::json!(["number", "string"]));
    for shell in ["bash", "zsh", "fish", "elvish", "powershell"] {
        let finished = Job::new(["completions", shell]).succeed().unwrap();
        finished.contains(&finished.output, &["check-result", "ranks-x", "stability"]).unwrap();
    }
    Job::new(["completions", "csh"]).is_refused(&["'csh'", "bash"]).unwrap();
    let place = directory();
    let pages = place.path().join("man1");
    let man = Job::new(["man", &pages.display().to_string()]).on(2);
    man.succeed().unwrap();
    for (page, wording) in [("phasewarp.1", "stability"), ("phasewarp-run.1", "walltime")] {
        let text = text_of(pages.join(page)).unwrap();
        assert!(text.contains(wording), "{page}");
    }
}
