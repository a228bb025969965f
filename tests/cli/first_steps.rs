//! What a user begins with: `init`, `check --json`, `schema`, `completions`, `man`.

use crate::support::{Job, cases, check_all, directory};

/// In each dimension the case that `init` writes is checked without a warning.
#[test]
fn a_case_to_begin_with() {
    let place = directory();
    check_all(&["1", "2", "3"], |dimension| {
        let file = place.path().join(format!("{dimension}.toml")).display().to_string();
        let init = Job::new(["init", &file, "--dimension", dimension]).on(2);
        init.succeed()?;
        let written = std::fs::read_to_string(&file).map_err(|e| e.to_string())?;
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
    finished.says(&finished.output, &["done in", "distance to the exact"]).unwrap();
    assert!(!finished.errors.contains("warning"), "{}", finished.report("a warning"));
    Job::new(["init", "--dimension", "4"]).is_refused(&["--dimension", "'4'", "1..=3"]).unwrap();
}

/// The numbers of `check --json` are those of the case.
#[test]
fn a_case_is_checked_as_json() {
    check_all(&cases(), |name| {
        let job = Job::new(["check", &crate::support::case(name), "--json"]).within(60);
        let found = job.on(2).succeed()?.json()?;
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
    let narrow = Job::new(["check", &crate::support::case("example1.toml"), "--json"])
        .set(&["axis.0.v.lower=-0.6", "axis.0.v.upper=0.6"]);
    let found = narrow.succeed().unwrap().json().unwrap();
    assert!(found["warnings"].to_string().contains("velocit"), "{}", found["warnings"]);
}

/// What editors and shells read is about every command and key.
#[test]
fn editors_and_shells_are_served() {
    let schema = Job::new(["schema"]).on(2).succeed().unwrap().json().unwrap();
    assert_eq!(schema["properties"]["time"]["properties"]["end"]["type"], "number");
    for shell in ["bash", "zsh", "fish", "elvish", "powershell"] {
        let finished = Job::new(["completions", shell]).succeed().unwrap();
        finished.says(&finished.output, &["check-result", "ranks-x", "stability"]).unwrap();
    }
    Job::new(["completions", "csh"]).is_refused(&["'csh'", "bash"]).unwrap();
    let place = directory();
    let pages = place.path().join("man1");
    let man = Job::new(["man", &pages.display().to_string()]).on(2);
    man.succeed().unwrap();
    for (page, says) in [("phasewarp.1", "stability"), ("phasewarp-run.1", "walltime")] {
        let text = std::fs::read_to_string(pages.join(page)).unwrap();
        assert!(text.contains(says), "{page}");
    }
}
