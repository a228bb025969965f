//! Embeddings of the inflow: each meets its tolerances, and inflows beyond all of them are refused.

use crate::support::{
    at_most, check_all, directory, distance, field, meets_its_tolerance, refused, run,
};

/// Every embedding with planned and given δ, and shifts: the tolerance is met and the error
/// estimate is right.
#[test]
fn tolerances_are_met_with_every_embedding() {
    let steady = ["inflow_barrier.toml", "axis.0.x.cells=32", "axis.0.v.cells=36"];
    let pulsed = ["pulsed_inflow.toml", "axis.0.x.cells=20", "axis.0.v.cells=22"];
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
    let rows: Vec<_> = rows.into_iter().enumerate().collect();
    check_all(&rows, |(k, ([name, x, v], settings))| {
        let mut set = vec![*x, *v, "solver.verify=true", "solver.tolerance=1e-5"];
        set.extend(settings.iter().map(String::as_str).filter(|s| !s.is_empty()));
        // Every embedding and every δ has runs on two ranks.
        let ranks = if k % 4 == 0 { 2 } else { 1 };
        meets_its_tolerance(&run(name).on(ranks).set(&set).summary()?)
    });
}

/// A δ so small that the growth of the enlarged system leaves no digits is refused, and so is an
/// inflow that is not finite at some time or changes too fast. A δ without inflow causes a warning.
#[test]
fn inflows_that_no_embedding_can_treat_are_refused() {
    let rows: &[(&str, &[&str], &[&str])] = &[
        (
            "inflow_barrier.toml",
            &["solver.warp.inflow=full", "solver.warp.delta=0.01"],
            &["growth x time", "solver.warp.delta"],
        ),
        (
            "step_up.toml",
            &["axis.0.x.cells=8", "axis.0.v.cells=6", "time.end=3000"],
            &["nearly all of f has left the box by time.end", "an earlier one"],
        ),
        // The probe ends as soon as the norm has fallen by a factor of 1e40.
        (
            "step_up.toml",
            &["axis.0.x.cells=8", "axis.0.v.cells=6", "time.end=100000"],
            &["falls by a factor", "e40 from state to field", "an earlier one"],
        ),
        (
            "pulsed_inflow.toml",
            &["inflow.value='1/(t - 1.2)'"],
            &["inflow.value", "inf", "t = 1.2", "must be finite"],
        ),
        (
            "pulsed_inflow.toml",
            &["axis.0.x.cells=8", "axis.0.v.cells=6", "inflow.value='sin(40000*t)'"],
            &["inflow.value", "changes too fast", "8192 steps"],
        ),
    ];
    check_all(rows, |(name, settings, wording)| {
        let place = directory();
        refused(&run(name).set(settings).into(place.path()).run()?, wording)
    });
    let grid = ["axis.0.x.cells=16", "axis.0.v.cells=16", "solver.warp.delta=2"];
    let summary = run("example1.toml").set(&grid).summary().unwrap();
    let warnings = summary.warnings();
    assert!(warnings.contains("delta has no effect"), "{warnings}");
}

/// Inflow that jumps at an end of the run does not jump in it: the run is that with what enters
/// before or after the jump.
#[test]
fn jumps_at_the_ends_of_a_run_are_none() {
    let rows = [
        ("1 if t < 0.4 else 0.2", "1"),
        ("1 if t < 0.4 else 20", "1"),
        ("5 if t <= 0 else 1 + 0.3*t", "1 + 0.3*t"),
    ];
    check_all(&rows, |(jumps, smooth)| {
        let solve = |value: &str| {
            let place = directory();
            let value = format!("inflow.value='({value})*exp(-t)'");
            let coarse = ["axis.0.x.cells=8", "axis.0.v.cells=6", "time.end=0.4", &value];
            let summary = run("pulsed_inflow.toml").set(&coarse).solve(place.path())?;
            summary.require(!summary.warnings().contains("jumps in time"), || value.clone())?;
            field(place.path())
        };
        let off = distance(&solve(jumps)?, &solve(smooth)?);
        at_most("distance to the smooth inflow", off, 1e-6)
    });
    // A jump at the start does not hide one in the run.
    let value = "inflow.value='5 if t <= 0 else (1 if t < 0.2 else 0.5)'";
    let coarse = ["axis.0.x.cells=8", "axis.0.v.cells=6", "time.end=0.4", value];
    let set = ["solver.tolerance=1e-2"];
    let summary = run("pulsed_inflow.toml").set(&coarse).set(&set).summary().unwrap();
    assert!(summary.warnings().contains("jumps in time"), "{}", summary.command);
}
