//! Warnings are said once, and stand in the summary.

use crate::support::{Summary, check, check_all, directory, require, run};

/// An edge inside a cell is moved to a face: said, with the distance, by `check`, by `run` and in
/// `summary.json`.
#[test]
fn region_edges_off_the_faces_give_a_warning() {
    // Cells of 3/128 = 0.0234375; the nearest centre decides.
    let rows = [
        ("x < 0.01", "x = 0.01 misses", "1.00e-2"),
        ("x < 0.015", "x = 0.015 misses", "8.44e-3"),
        ("x < -0.005", "x = -0.005 misses", "5.00e-3"),
    ];
    check_all(&rows, |(condition, edge, by)| {
        let setting = format!("potential.0.where=\"{condition}\"");
        let says = ["warning: potential", edge, by];
        let finished = check("example1.toml").set(&[&setting]).succeed()?;
        finished.says(&finished.output, &says)?;
        let place = directory();
        let job = run("example1.toml").set(&[&setting, "time.end=0.01"]).on(2);
        let finished = job.clone().into(place.path()).succeed()?;
        for words in says {
            let times = finished.errors.matches(words).count();
            require(times == 1, &finished, || format!("\"{words}\" is said {times} times"))?;
        }
        let summary = Summary::read(finished, place.path())?;
        let warnings = summary.warnings();
        let known = warnings.contains(edge) && warnings.contains(by);
        summary.require(known, || format!("warnings in summary.json: {warnings}"))
    });
    // Of many the first are shown, the others counted.
    let often = "potential.0.where=\"sin(30*x) < 0\"";
    let finished = check("example1.toml").set(&[often]).succeed().unwrap();
    let shown = finished.output.matches("misses the faces of the grid; it").count();
    let more = ["potential: and at ", "places more a region's edge misses the faces"];
    finished.says(&finished.output, &more).unwrap();
    let all = finished.output.split("and at ").nth(1).and_then(|rest| rest.split(' ').next());
    let all = shown + all.and_then(|n| n.parse::<usize>().ok()).unwrap_or(0);
    // Between -1.5 and 1.5 sin(30 x) changes its sign at k pi/30, |k| <= 14; x = 0 is a face.
    assert!(shown == 8 && all == 28, "{}", finished.report(&format!("{shown} of {all}")));
    // Control: an edge on a face, and one that is on a face of this grid alone.
    for condition in ["x < 0", "x < 0.0234375"] {
        let setting = format!("potential.0.where=\"{condition}\"");
        let finished = check("example1.toml").set(&[&setting]).succeed().unwrap();
        assert!(!finished.output.contains("warning"), "{}", finished.report("no warning expected"));
    }
}
