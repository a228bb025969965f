//! `phasewarp chart`: charts of every case, alone and under mpirun, within their budgets, and the
//! contents of their files.

use crate::support::{Job, case, check_all, directory, finite_volumes, json_of, shrunk, text_of};
use serde_json::Value;
use std::path::Path;
use std::sync::{LazyLock, Mutex};

/// Seconds that a chart may take beyond its budget on a busy machine, to finish the last trial and
/// to start and stop under mpirun.
const LATE: f64 = 10.0;

/// Budget in seconds of a chart of which only the form is checked.
const BUDGET: f64 = 1.5;

/// Budgets in seconds of charts whose trials are checked: enough on most machines, then on busy
/// ones.
const BUDGETS: [f64; 3] = [12.0, 36.0, 108.0];

/// Makes a chart of the case `name` within `budget` seconds and returns `chart.json`.
fn chart(
    name: &str,
    settings: &[&str],
    (ranks, budget): (usize, f64),
    place: &Path,
) -> Result<Value, String> {
    let job = Job::new(["chart", &case(name), "--budget", &format!("{budget}s")])
        .set(settings)
        .into(place)
        .on(ranks);
    // The clock decides which trials are made, and how accurate they are.
    let job = if budget > BUDGET { job.undisturbed() } else { job };
    let finished = job.succeed()?;
    let found = json_of(place.join("chart.json")).map_err(|e| finished.report(&e))?;
    let sentences = found["sentences"].as_array().map_or(&[][..], Vec::as_slice);
    for sentence in sentences.iter().filter_map(Value::as_str) {
        if !finished.output.contains(sentence) {
            return Err(finished.report(&format!("not printed: {sentence}")));
        }
    }
    if sentences.is_empty() { Err(finished.report("no sentence")) } else { Ok(found) }
}

/// The chart of the case `name` on so many `ranks` with the least of [`BUDGETS`] that is `enough`,
/// or with the largest.
fn chart_until(
    name: &str,
    settings: &[&str],
    ranks: usize,
    enough: impl Fn(&Value) -> bool,
) -> Result<Value, String> {
    let [first, others @ ..] = BUDGETS;
    let with = |budget| chart(name, settings, (ranks, budget), directory().path());
    let mut found = with(first)?;
    for budget in others {
        if enough(&found) {
            break;
        }
        found = with(budget)?;
    }
    Ok(found)
}

fn entries(chart: &Value) -> &[Value] {
    chart["entries"].as_array().map_or(&[], Vec::as_slice)
}

/// The trials that ran.
fn done(chart: &Value) -> impl Iterator<Item = &Value> {
    entries(chart).iter().filter(|e| e["status"] == "done")
}

/// An entry has the values that its status requires, and only trials that ran are on a front.
fn complete(entry: &Value) -> Result<(), String> {
    let known = |key: &str| !entry[key].is_null();
    let right = match entry["status"].as_str() {
        Some("done") => {
            known("seconds") && known("total_seconds") && (known("applications") || known("solves"))
        }
        Some("refused") => known("reason") && !known("seconds"),
        Some("left-out") => known("expected_seconds") && !known("seconds"),
        _ => false,
    };
    let front = ["front_exact", "front_seconds", "front_applications", "front_until_measured"];
    let on = front.iter().any(|key| entry[key] == true);
    if right && known("grid") && (!on || known("seconds")) {
        Ok(())
    } else {
        Err(format!("not complete: {entry}"))
    }
}

/// Checks that all tags are closed in the right order.
fn is_well_formed(svg: &str) -> Result<(), String> {
    let mut open: Vec<&str> = Vec::new();
    for piece in svg.split('<').skip(1) {
        let (tag, _) = piece.split_once('>').ok_or("a tag without end")?;
        let name = tag.split([' ', '\n', '/']).find(|n| !n.is_empty()).unwrap_or("");
        if tag.starts_with(['?', '!']) || tag.ends_with('/') {
            continue;
        }
        match tag.strip_prefix('/') {
            Some(closed) if open.pop() != Some(closed.trim()) => {
                return Err(format!("</{closed}> closes nothing"));
            }
            Some(_) => {}
            None => open.push(name),
        }
    }
    if open.is_empty() && svg.contains("<svg") {
        Ok(())
    } else {
        Err(format!("{open:?} not closed"))
    }
}

/// The width and the height in the header of a PNG file.
fn png_size(path: &Path) -> Result<[u32; 2], String> {
    let bytes = std::fs::read(path).map_err(|e| e.to_string())?;
    if bytes.get(..8) != Some(b"\x89PNG\r\n\x1a\n") || bytes.get(12..16) != Some(b"IHDR") {
        return Err("no PNG".to_owned());
    }
    let number = |at: usize| u32::from_be_bytes(std::array::from_fn(|k| bytes[at + k]));
    Ok([number(16), number(20)])
}

#[test]
fn every_case_has_a_chart_within_its_budget() {
    let papers = ["paper/example1.toml", "paper/example2.toml", "paper/example3.toml"];
    let all: Vec<(usize, String)> =
        (finite_volumes().into_iter()).chain(papers.map(str::to_owned)).enumerate().collect();
    let without_modes = Mutex::new(Vec::new());
    check_all(&all, |(k, name)| {
        let place = directory();
        let ranks = [1, 2, 1, 3][k % 4];
        let with = |budget| chart(name, shrunk(name), (ranks, budget), place.path());
        // On a busy machine the time may be over before the first trial.
        let found = with(BUDGET).or_else(|error| {
            if error.contains("no time is left") { with(8.0 * BUDGET) } else { Err(error) }
        })?;
        entries(&found).iter().try_for_each(complete).map_err(|e| format!("{name}: {e}"))?;
        // On more ranks than cores, the time that ranks wait for each other is unknown.
        let took = found["took_seconds"].as_f64().unwrap_or(f64::INFINITY);
        let budget = found["budget_seconds"].as_f64().unwrap_or(BUDGET);
        if ranks == 1 && took > 3.0 * budget + LATE {
            return Err(format!("{name}: {took} s of {budget} s"));
        }
        let tried = |method: &str| done(&found).any(|e| e["method"] == method);
        if !tried("classical") {
            return Err(format!("{name}: no classical method was tried"));
        }
        if !tried("schrodingerized") {
            without_modes.lock().map_err(|e| e.to_string())?.push(name.clone());
        }
        // One line per trial and one line of names.
        let csv = text_of(place.path().join("chart.csv"))?;
        if csv.lines().count() != entries(&found).len() + 1 {
            return Err(format!("{name}: chart.csv has {} lines", csv.lines().count()));
        }
        is_well_formed(&text_of(place.path().join("chart.svg"))?)
            .map_err(|e| format!("{name}: {e}"))?;
        let [width, height] = png_size(&place.path().join("chart.png"))?;
        if width >= 800 && height >= 600 {
            Ok(())
        } else {
            Err(format!("{name}: a picture of {width} x {height}"))
        }
    });
    // On a busy machine some charts have time for the first trial only, and get more.
    let without_modes = without_modes.into_inner().expect("no test stopped");
    let mut both = all.len() - without_modes.len();
    for name in without_modes {
        if 3 * both >= all.len() {
            break;
        }
        let found = chart(&name, shrunk(&name), (1, 8.0 * BUDGET), directory().path());
        both += usize::from(
            found.is_ok_and(|found| done(&found).any(|e| e["method"] == "schrodingerized")),
        );
    }
    assert!(3 * both >= all.len(), "by modes: {both} of {} cases", all.len());
}

/// Settings of a case small enough for all of the first rounds.
const SMALL: [&str; 3] = ["axis.0.x.cells=24", "axis.0.v.cells=20", "time.end=0.5"];

/// The chart of this case on one rank, shared by several tests.
static OF_STEP_UP: LazyLock<Value> = LazyLock::new(|| {
    let steps = |found: &Value, name| errors_by_applications(found, name).len();
    let enough = |found: &Value| {
        INTEGRATORS.iter().all(|(name, _)| steps(found, name) >= 2)
            && missing_degree(found).is_none()
    };
    chart_until("step_up.toml", &SMALL, 1, enough).expect("a chart")
});

/// Runge–Kutta methods and their orders in the step.
const INTEGRATORS: [(&str, f64); 2] = [("forward-euler", 1.0), ("ssp-rk3", 3.0)];

/// Applications and errors above round-off of this integrator on the grid of the comparison, in
/// the order of the applications.
fn errors_by_applications(found: &Value, integrator: &str) -> Vec<[f64; 2]> {
    let grid = &found["compared_on"];
    let mut points: Vec<[f64; 2]> = (entries(found).iter())
        .filter(|e| e["integrator"] == integrator && e["limiter"] == "none" && e["grid"] == *grid)
        .filter_map(|e| Some([e["applications"].as_f64()?, e["error_semidiscrete"].as_f64()?]))
        .filter(|[_, error]| *error > 1e-11)
        .collect();
    points.sort_by(|a, b| a[0].total_cmp(&b[0]));
    points
}

/// Trials of the same set-up that ran in both charts.
fn ran_in_both<'a>(one: &'a Value, other: &'a Value) -> Vec<[&'a Value; 2]> {
    let knobs = [
        "method", "grid", "degree", "flux", "interface", "integrator", "limiter", "cfl", "profile",
        "coefficients", "weights", "propagator", "step", "tolerance", "points", "as_given",
        "paper",
    ];
    let of_other = |entry: &'a Value| {
        let same = |e: &&Value| knobs.iter().all(|key| e[key] == entry[key]);
        Some([entry, done(other).find(same)?])
    };
    done(one).filter_map(of_other).collect()
}

#[test]
fn charts_do_not_depend_on_ranks() {
    let enough = |found: &Value| ran_in_both(&OF_STEP_UP, found).len() >= 15;
    let three = chart_until("step_up.toml", &SMALL, 3, enough).unwrap();
    let both = ran_in_both(&OF_STEP_UP, &three);
    for [one, other] in &both {
        let numbers: &[&str] = if one["solves"].is_null() {
            &["modes", "applications", "error_exact", "error_semidiscrete", "probability_window"]
        } else {
            &["modes", "solves"]
        };
        for key in numbers {
            assert_eq!(one[key], other[key], "{key} of {one}");
        }
    }
    assert!(both.len() >= 15, "{} trials compared", both.len());
}

#[test]
fn errors_fall_as_they_should() {
    let found = &*OF_STEP_UP;
    let mut checked = 0;
    for e in done(found).filter(|e| e["paper"] == false) {
        let (Some(tolerance), Some(error)) =
            (e["tolerance"].as_f64(), e["error_semidiscrete"].as_f64())
        else {
            continue;
        };
        // Every profile and treatment meets its tolerance; without weights the growth is measured.
        assert!(error <= 1.5 * tolerance, "{e}");
        checked += 1;
    }
    assert!(checked >= 10, "{checked} tolerances checked");
    // The unitary scheme is among them, by one mode.
    let unitary = done(found).find(|e| e["profile"] == "unitary").expect("the unitary scheme");
    assert!(unitary["modes"] == 1 && unitary["flux"] == 0.0, "{unitary}");
    for (integrator, order) in INTEGRATORS {
        let points = errors_by_applications(found, integrator);
        let [first, .., last] = points[..] else { panic!("{integrator}: {points:?}") };
        let slope = (first[1] / last[1]).ln() / (last[0] / first[0]).ln();
        assert!((slope - order).abs() < 0.25, "{integrator}: {slope} of {points:?}");
    }
}

/// The trials of elements of this degree that ran by this method, classically by the exponential.
fn of_degree<'a>(found: &'a Value, degree: u64, method: &str) -> impl Iterator<Item = &'a Value> {
    done(found).filter(move |e| {
        let reference = method == "schrodingerized" || e["integrator"] == "exponential";
        e["degree"] == degree && e["method"] == method && reference
    })
}

/// A degree and a method of which no trial ran.
fn missing_degree(found: &Value) -> Option<String> {
    let methods = ["classical", "schrodingerized"];
    let mut all = methods.iter().flat_map(|method| (0..=4).map(move |degree| (degree, method)));
    let missing = all.find(|(degree, method)| of_degree(found, *degree, method).next().is_none());
    missing.map(|(degree, method)| format!("no {method} trial of degree {degree}"))
}

/// Elements of all degrees are tried by modes and classically, for a case of degree 0 and for one
/// of degree 4. For smooth data, a higher degree has a smaller error.
#[test]
fn degrees_are_compared() {
    assert_eq!(missing_degree(&OF_STEP_UP), None);
    let small = ["axis.0.x.cells=12", "axis.0.v.cells=12", "time.end=0.4"];
    // All with the number of unknowns of 12 x 12 elements of degree 4.
    let least = |found: &Value, degree, method| {
        let there = of_degree(found, degree, method).filter(|e| e["cells"] == 3600);
        there.filter_map(|e| e["error_exact"].as_f64()).fold(f64::INFINITY, f64::min)
    };
    let compared = |found: &Value| {
        ["classical", "schrodingerized"]
            .map(|method| [0, 4].map(|degree| least(found, degree, method)))
    };
    let enough =
        |found: &Value| compared(found).iter().all(|[first, high]| (first + high).is_finite());
    let found = chart_until("smooth-beams.toml", &small, 1, enough).unwrap();
    assert_eq!(missing_degree(&found), None);
    for [first, high] in compared(&found) {
        assert!(high < 0.5 * first && first.is_finite(), "{high} of degree 4, {first} of degree 0");
    }
}

#[test]
fn without_an_exact_solution_errors_are_against_the_semi_discrete_one() {
    let place = directory();
    let settings = ["axis.0.x.cells=24", "axis.0.v.cells=20", "exact={}"];
    let found = chart("step_up.toml", &settings, (2, 3.0), place.path()).unwrap();
    assert!(found["exact"].is_null());
    assert!(entries(&found).iter().all(|e| e["error_exact"].is_null()));
    let text = found["sentences"].to_string();
    assert!(!text.contains("exact solution") && text.contains("semi-discrete"), "{text}");
}

#[test]
fn invalid_charts_are_refused() {
    let place = directory();
    let file = place.path().join("file");
    std::fs::write(&file, "").unwrap();
    let inside = file.join("chart");
    let rows = [
        (
            Job::new(["chart", &case("step_up.toml"), "-o", &inside.display().to_string()]),
            "output directory",
        ),
        (Job::new(["chart", &case("step_up.toml"), "--budget", "0"]), "--budget"),
        (Job::new(["chart", &case("step_up.toml"), "--set", "initial.f=1/(x-x)"]), "initial.f"),
        (
            Job::new([
                "chart",
                &case("step_up.toml"),
                "--set",
                "initial={warped=\"none.h5\"}",
                "--set",
                "exact={}",
            ]),
            "initial.warped",
        ),
    ];
    check_all(&rows, |(job, word)| job.clone().inside(place.path()).run()?.ended(2, &[word]));
    let (job, word) = &rows[0];
    job.clone().on(3).inside(place.path()).run().and_then(|f| f.ended(2, &[word])).unwrap();
}
