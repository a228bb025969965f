//! Warnings are printed once and are in the summary.

use crate::support::{Summary, check, check_all, directory, parsed, require, run};
use phasewarp::run::warnings::warnings;

/// The warnings of a case, a line each.
#[derive(Debug)]
struct Found(String);

/// The warnings of a case of `cases/` with these settings, which `check` and `run` print.
fn found(name: &str, settings: &[&str]) -> Result<Found, String> {
    Ok(Found(warnings(&parsed(name, settings)?).join("\n") + "\n"))
}

impl Found {
    /// Returns an error unless the warnings contain all of `words`.
    fn has(&self, words: &[&str]) -> Result<(), String> {
        words.iter().try_for_each(|words| self.has_if(true, words))
    }

    /// Returns an error unless the warnings contain the words if and only if `expected`.
    fn has_if(&self, expected: bool, words: &str) -> Result<(), String> {
        if self.0.contains(words) == expected {
            return Ok(());
        }
        Err(format!("\"{words}\": {}, {expected} expected, in: {}", !expected, self.0))
    }
}

/// Inflow that jumps in time gives a warning, unless the error is measured, and no run says that
/// its plan keeps the tolerance. A smooth pulse gives none.
#[test]
fn inflow_that_jumps_in_time_gives_a_warning() {
    let small = ["axis.0.x.cells=16", "axis.0.v.cells=12", "solver.tolerance=1e-3", "time.end=0.5"];
    let jumping = "inflow.value='1 if t < 0.31 else 0'";
    let rows: [(&[&str], bool); 3] = [
        (&[jumping], true),
        (&[jumping, "solver.verify=true"], false),
        (&["inflow.value='sin(t)^2'"], false),
    ];
    check_all(&rows, |(settings, warns)| {
        let place = directory();
        let job = run("inflow_barrier.toml").set(&small).set(settings).on(2);
        let finished = job.into(place.path()).succeed()?;
        let found = finished.errors.contains("warning: inflow.value jumps in time");
        require(found == *warns, &finished, || format!("warns: {found}"))?;
        let planned = finished.output.contains("planned within");
        require(!(planned && *warns), &finished, || "called planned".to_owned())
    });
}

/// An edge of a region inside a cell is moved to a face. A warning names the distance, in `check`,
/// in `run` and in `summary.json`.
#[test]
fn region_edges_off_the_faces_give_a_warning() {
    // The cells have the width 3/128 = 0.0234375.
    let rows = [
        ("x < 0.01", "x = 0.01 misses", "1.00e-2"),
        ("x < 0.015", "x = 0.015 misses", "8.44e-3"),
        ("x < -0.005", "x = -0.005 misses", "5.00e-3"),
    ];
    check_all(&rows, |(condition, edge, by)| {
        let setting = format!("potential.0.where=\"{condition}\"");
        found("example1.toml", &[&setting])?.has(&["potential", edge, by])
    });
    let (condition, edge, by) = rows[0];
    let setting = format!("potential.0.where=\"{condition}\"");
    let wording = ["warning: potential", edge, by];
    let finished = check("example1.toml").set(&[&setting]).succeed().unwrap();
    finished.contains(&finished.output, &wording).unwrap();
    let place = directory();
    let job = run("example1.toml").set(&[&setting, "time.end=0.01"]).on(2);
    let finished = job.into(place.path()).succeed().unwrap();
    for words in wording {
        assert_eq!(finished.errors.matches(words).count(), 1, "{}", finished.report(words));
    }
    let summary = Summary::read(finished, place.path()).unwrap();
    let warnings = summary.warnings();
    assert!(warnings.contains(edge) && warnings.contains(by), "{warnings}");
    // Of many edges, the first are listed and the others counted.
    let often = "potential.0.where=\"sin(30*x) < 0\"";
    let found_often = found("example1.toml", &[often]).unwrap();
    let shown = found_often.0.matches("misses the faces of the grid; it").count();
    found_often
        .has(&["potential: and at ", "places more a region's edge misses the faces"])
        .unwrap();
    let all = found_often.0.split("and at ").nth(1).and_then(|rest| rest.split(' ').next());
    let all = shown + all.and_then(|n| n.parse::<usize>().ok()).unwrap_or(0);
    // Between -1.5 and 1.5 sin(30 x) changes its sign at k pi/30, |k| <= 14; x = 0 is a face.
    assert!(shown == 8 && all == 28, "{shown} of {all}: {found_often:?}");
    // Control: no warning for edges on faces.
    for condition in ["x < 0", "x < 0.0234375"] {
        let setting = format!("potential.0.where=\"{condition}\"");
        let finished = check("example1.toml").set(&[&setting]).succeed().unwrap();
        assert!(!finished.output.contains("warning"), "{}", finished.report("no warning expected"));
    }
}

/// Where elements would be refused, as `v = 0` is inside of a cell, a warning that names a degree
/// names the face that is needed, too.
#[test]
fn a_degree_that_would_be_refused_is_not_a_remedy() {
    let slab = "potential=[{where=\"x > 0.1 && x < 0.14\", value=\"0.3\"}, {value=\"0\"}]";
    let rows = [(128, false), (127, true), (53, true)];
    check_all(&rows, |(cells, refused)| {
        let velocities = format!("axis.0.v.cells={cells}");
        let remedy = if *refused {
            "or scheme.degree = 2 on velocity cells with a face at v = 0"
        } else {
            "or scheme.degree = 2\n"
        };
        let finished = check("example1.toml").set(&[slab, &velocities]).succeed()?;
        finished.contains(&finished.output, &[remedy])?;
        let elements = check("example1.toml").set(&[slab, &velocities, "scheme.degree=2"]).run()?;
        let more = format!("{} cells on the same box have it there.", cells + 1);
        let words: &[&str] = if *refused { &["v = 0 must be a face", &more] } else { &[] };
        elements.ended(if *refused { 2 } else { 0 }, words)
    });
}

/// Steps of forward Euler grow with elements, and with small fluxes; upwind cells are stable.
#[test]
fn forward_euler_of_elements_gives_a_warning() {
    let euler = ["solver.method=classical", "solver.classical.integrator=forward-euler"];
    let rows: [(&[&str], bool); 5] = [
        (&["scheme.degree=2"], true),
        (&["scheme.flux=0.25"], true),
        (&["scheme.flux=0.5"], false),
        (&[], false),
        (&["scheme.degree=2", "solver.classical.integrator=ssp-rk3"], false),
    ];
    check_all(&rows, |(settings, warns)| {
        let found = found("example1.toml", &[&euler, *settings].concat())?;
        found.has_if(*warns, "has no stable step with scheme.")
    });
}

const OVER: &[&str] = &["scheme.degree=3", "axis.0.x.cells=12", "axis.0.v.cells=12"];

/// If `V` jumps or bends between the points of the scheme, `check` prints a warning with the place.
/// A smooth `V` causes none.
#[test]
fn unresolved_potentials_give_a_warning() {
    let jump = "potential.1.value=0.4 if x > 0.06 else 0";
    let narrow = "potential.1.value=0.4*exp(-((x - 0.7)/0.02)^2)";
    let slab = "potential.0={where=\"x < 0.3\", value=\"0.4*step(x + 0.7)\"}";
    let wave = "potential.1.value=0.2*sin(2*x)";
    let coarse: &[&str] = &["axis.0.x.cells=24"];
    let rows: &[(&str, &[&str], &[&str])] = &[
        (jump, &[], &["potential.1.value", "between x = 0.04", "as written"]),
        (jump, OVER, &["potential.1.value", "between x = 0 and 0.25:", "region of their own"]),
        (narrow, coarse, &["potential.1.value", "x = 0.625 and 0.75", "features more cells"]),
        (narrow, OVER, &["potential.1.value", "between x = 0.5 and 0.75"]),
        (slab, &[], &["potential.0.value", "between x = -0.70"]),
        (wave, &[], &[]),
        (wave, OVER, &[]),
        ("potential.0.value=0.2 + 0.1*x", coarse, &[]),
        ("potential.0.value=x^2/2", OVER, &[]),
    ];
    check_all(rows, |(setting, grid, words)| {
        let found = found("example1.toml", &[grid, &[*setting][..]].concat())?;
        found.has(words)?;
        found.has_if(!words.is_empty(), "does not resolve V")
    });
    // Also along the second axis.
    let plane = found("barrier2d.toml", &["potential.1.value=0.1 if y > 0.53 else 0"]).unwrap();
    plane.has(&["between y = 0.4 and 0.6 (and in 11 cells more)"]).unwrap();
}

/// Edges that are not parallel to the axes cause a warning. Edges of boxes do not, on and off
/// faces, nor do steps of an edge that are smaller than a cell.
#[test]
fn oblique_edges_give_a_warning() {
    let oblique = [
        "x^2 + y^2 < 0.16",
        "(x - 0.1)^2 + (y - 0.1)^2 < 0.0144",
        "x > y",
        "x > 0.3*y",
        "(x/0.9)^2 + (y/0.35)^2 < 1",
        "abs(x) + abs(y) < 0.6",
    ];
    let along = [
        "abs(x) < 0.37 && abs(y) < 0.45",
        "x > 0.13",
        "x > 0 && y > 0",
        "(x > 0 && x < 0.33 && y < 0.2) || (x > 0.05 && x < 0.4 && y >= 0.2)",
        "x > (0.1 if y > 0.11 else 0.15)",
        "max(abs(x - 0.1), abs(y)) < 0.3 || max(abs(x + 0.7), abs(y - 0.3)) < 0.25",
    ];
    let rows = oblique.map(|edge| (edge, true)).into_iter().chain(along.map(|edge| (edge, false)));
    check_all(&rows.collect::<Vec<_>>(), |(edge, printed)| {
        let setting = format!("potential.0.where=\"{edge}\"");
        found("barrier2d.toml", &[&setting])?.has_if(*printed, "potential.0: its edge at x = ")
    });
    // No warning if V is continuous at the edge.
    let flat = ["potential.0.where=x > y", "potential.0.value=0.3*(x - y)"];
    found("barrier2d.toml", &flat).unwrap().has_if(false, "its edge at").unwrap();
}

/// Data that vary within the cells of degree 0 cause a warning; finer cells and elements hold them.
#[test]
fn data_that_vary_within_cells_give_a_warning() {
    // The centres of 32 cells are zeros of the wave.
    let wave = "initial.f=(1 + cos(2*pi*16*(x + 1.5)/3))*exp(-(v - 0.5)^2/0.1)";
    let rows: [(&[&str], bool); 3] = [
        (&["axis.0.x.cells=32"], true),
        (&["axis.0.x.cells=256"], false),
        (&["axis.0.x.cells=32", "scheme.degree=3"], false),
    ];
    check_all(&rows, |(settings, warns)| {
        let finished = check("example1.toml").set(&[wave]).set(settings).succeed()?;
        let found = finished.output.contains("initial.f varies within the cells");
        require(found == *warns, &finished, || format!("warns: {found}"))
    });
}

/// A beam between the nodes causes a warning that names it, and data that the grid resolves do not,
/// in one to three dimensions.
#[test]
fn narrow_data_give_a_warning() {
    const BEAM: &str = "initial.f=exp(-((x + 0.3)^2 + (v - 0.3)^2)/0.09) \
                        + 2500*exp(-((x + 0.37)^2 + (v - 0.77)^2)/9e-6)";
    let few = ["axis.0.x.cells=40", "axis.0.v.cells=40"];
    let fine = ["axis.0.x.cells=1500", "axis.0.v.cells=1500"];
    let elements = [few[0], few[1], "scheme.degree=3"];
    let rows: [(&str, &[&str], &[&str], bool); 7] = [
        ("step_up.toml", &few, &[BEAM], true),
        ("step_up.toml", &elements, &[BEAM], true),
        ("step_up.toml", &fine, &[BEAM], false),
        ("step_up.toml", &few, &[], false),
        ("barrier2d.toml", &[], &[], false),
        ("quantum_dot2d.toml", &[], &[], false),
        ("smooth_step3d.toml", &[], &[], false),
    ];
    check_all(&rows, |(name, grid, settings, warns)| {
        let finished = check(name).set(grid).set(settings).succeed()?;
        let found = ["initial data: the grid does not resolve ", "% of the data, near x = -0.3"];
        let found = found.iter().all(|words| finished.output.contains(words));
        let any = finished.output.contains("initial data: the grid does not resolve");
        require(found == *warns && any == *warns, &finished, || format!("warns: {found} {any}"))
    });
}

/// Formulas that are zero at every point of the grid cause a warning, constants 0 do not.
#[test]
fn formulas_that_are_zero_on_the_grid_give_a_warning() {
    let inflow = "inflow.value=exp(-(x + 1.5)^2)";
    let nothing = "inflow.value=exp(-(x - 90)^2)";
    let rows: &[(&[&str], &str, bool)] = &[
        (&["initial.f=exp(-(x - 90)^2)", inflow], "initial.f is zero at every point", true),
        (&["initial.f=0", inflow], "is zero at", false),
        (&[nothing], "inflow.value is zero at all ends of the box", true),
        (&[inflow], "is zero at", false),
        (&["inflow.value=1 if x < -1.5 else 0", "scheme.degree=1"], "is zero at", false),
        (&["inflow.value=1 if x < -1.5 else 0"], "is zero at", false),
        (&["inflow.value=0"], "is zero at", false),
        // What a jump of 0.2 brings in comes from below 1.63.
        (&["inflow.value=1 if v > 1.6 else 0"], "is zero at", false),
        (&["potential.0.value=exp(-(x - 90)^2)"], "potential.0.value is zero at every", true),
        (&["potential.1.value=0.1*sin(x)"], "is zero at", false),
        (&["potential.1.value=0"], "is zero at", false),
    ];
    check_all(rows, |(settings, words, printed)| {
        let small = ["axis.0.x.cells=16", "axis.0.v.cells=16", "exact={}"];
        found("example1.toml", &[&small, *settings].concat())?.has_if(*printed, words)
    });
}

/// Keys without effect and initial data that are zero on the grid cause warnings.
#[test]
fn keys_without_effect_and_zero_data_give_a_warning() {
    let own: &[&str] = &["scheme.degree=2", "axis.0.x.degree=1", "axis.0.v.degree=1"];
    let rows: &[(&[&str], &str, bool)] = &[
        (own, "scheme.degree has no effect", true),
        (&own[..2], "scheme.degree has no effect", false),
        (&["potential.1.reflection=0.5"], "potential.1.reflection reflects nothing", true),
        (&["potential.0.reflection=0.5"], "reflection reflects nothing", false),
        (&["output.moments_every=2"], "output.moments_every = 2 has no effect: no multiple", true),
        (&["output.moments_every=1"], "and time.end = 1; below 1 there is one", true),
        (&["output.moments_every=0.9"], "moments_every", false),
        (&["output.fields_every=2"], "output.fields_every = 2 adds the start only", true),
        (&["output.fields_every=0.5"], "fields_every", false),
    ];
    let small = ["axis.0.x.cells=16", "axis.0.v.cells=16", "exact={}"];
    check_all(rows, |(settings, words, printed)| {
        found("example1.toml", &[&small, *settings].concat())?.has_if(*printed, words)
    });
    // What only `check` says, or a plan.
    let nothing = "the initial data are zero on the grid, and nothing enters";
    let rows: [(&[&str], &str, bool); 4] = [
        (&["potential.0.reflection=0.5"], "where x < 0  reflection 0.5", true),
        (&["initial.f=0"], nothing, true),
        (&["initial.f=exp(-(x - 90)^2/0.01)"], "initial data are zero on the grid", true),
        (&["initial.f=0", "inflow.value=1 if v < 1 else 0"], "are zero on the grid", false),
    ];
    check_all(&rows, |(settings, words, printed)| {
        let finished = check("example1.toml").set(&small).set(settings).succeed()?;
        let found = finished.output.contains(words);
        require(found == *printed, &finished, || format!("\"{words}\": {found}"))
    });
}
