//! `[readout]`: observables of some cells as a quantum computer would measure them.

use crate::support::{Job, Mistake, Summary, all_refused, check_all, directory, of_case, text_of};
use crate::support::{datasets, differences, near};
use serde_json::Value;
use std::path::Path;

const SMALL: &[&str] = &["axis.0.x.cells=23", "axis.0.v.cells=17"];
/// A profile with a high probability of the recovery point.
const LIKELY: &[&str] = &["solver.warp.profile=smooth", "solver.tolerance=1e-4"];

fn run(settings: &[&[&str]]) -> Job {
    of_case("run", "example1.toml").set(&settings.concat())
}

fn csv(place: &Path) -> Result<String, String> {
    text_of(place.join("readout.csv"))
}

#[test]
fn samples_depend_neither_on_ranks_nor_on_other_cells() {
    const CELLS: &[&str] = &["readout={cells=[[3],[11],[22]],seed=7}"];
    let reference = directory();
    let printed = run(&[SMALL, CELLS]).into(reference.path()).succeed().unwrap();
    let words =
        ["readout: density at (-1.043) is ", "measured as ", "; 8 more rows in readout.csv"];
    printed.contains(&printed.output, &words).unwrap();
    let found = datasets(reference.path()).unwrap();
    let text = csv(reference.path()).unwrap();
    assert_eq!(found["/readout/estimate"].shape, [3 * 3 * 5]);
    let meshes: &[(usize, &str)] = &[(3, "3"), (4, "2")];
    check_all(meshes, |(ranks, blocks)| {
        let place = directory();
        run(&[SMALL, CELLS]).with(["--ranks-x", blocks]).on(*ranks).solve(place.path())?;
        let differ = differences(&datasets(place.path())?, &found);
        if differ.is_empty() && csv(place.path())? == text {
            return Ok(());
        }
        Err(format!("{ranks} ranks, {blocks} blocks: {differ:?}"))
    });
    // Another seed changes the samples only. A single cell has the same samples as before, by index
    // or by position.
    let place = directory();
    run(&[SMALL, &["readout={cells=[[3],[11],[22]],seed=8}"]]).solve(place.path()).unwrap();
    let differ = differences(&datasets(place.path()).unwrap(), &found);
    assert!(differ.contains(&"/readout/estimate".to_owned()), "{differ:?}");
    assert!(!differ.contains(&"/readout/overlap".to_owned()), "{differ:?}");
    // Cell 11 is the middle one of [-1.5, 1.5].
    for alone in ["readout={cells=[[11]],seed=7}", "readout={points=[[0.01]],seed=7}"] {
        run(&[SMALL, &[alone]]).with(["--force"]).solve(place.path()).unwrap();
        let found = csv(place.path()).unwrap();
        let lines: Vec<&str> = found.lines().skip(1).collect();
        assert_eq!(lines.len(), 15);
        let expected: Vec<&str> = text.lines().filter(|l| l.starts_with("11,")).collect();
        assert_eq!(lines, expected, "{alone}");
    }
}

/// Of one moment, the overlap of the enlarged state is `√P` times that of the postselected state on
/// elements, whose state holds their volumes; it is larger where weights above 1 are undone.
fn overlaps_agree(readout: &Value, are_elements: bool) -> Result<(), String> {
    let probability = readout["probability"]["value"].as_f64().ok_or("no probability")?;
    for row in readout["rows"].as_array().ok_or("no rows")? {
        let of = |k: usize| row["measured"][k]["overlap"]["value"].as_f64();
        if let Some((postselected, enlarged)) = of(0).zip(of(3)) {
            let ratio = enlarged / (probability.sqrt() * postselected);
            if ratio < 1.0 - 1e-9 || are_elements && ratio > 1.0 + 1e-9 {
                return Err(format!("{ratio}: {row}"));
            }
        }
    }
    Ok(())
}

/// The samples have the same bits on any ranks in the plane, and with partial reflection for cells
/// and for elements.
#[test]
fn samples_of_other_scenes_do_not_depend_on_ranks() {
    const PLANE: &[&str] = &[
        "axis.0.x.cells=7",
        "axis.0.v.cells=6",
        "axis.1.x.cells=5",
        "axis.1.v.cells=4",
        "readout={cells=[[0,0],[3,4],[5,1]],accuracy=0.02,seed=1}",
    ];
    const CELLS: &[&str] =
        &["axis.0.x.cells=12", "axis.0.v.cells=10", "readout={cells=[[3],[5],[11]]}"];
    let elements = [CELLS, &["scheme.degree=2"]].concat();
    let cells = [CELLS, &["scheme.degree=0"]].concat();
    // Case, settings, ranks and blocks of space, and the number of observables of a cell.
    let rows = [
        ("barrier2d.toml", PLANE, (4, "2,2"), 5),
        ("partial_reflection.toml", &cells, (3, "1"), 3),
        ("partial_reflection.toml", &elements, (4, "2"), 3),
    ];
    check_all(&rows, |(name, settings, (ranks, blocks), observables)| {
        let job = || of_case("run", name).set(settings);
        let reference = directory();
        let summary = job().solve(reference.path())?;
        let found = datasets(reference.path())?;
        let shape = &found["/readout/cell"].shape;
        if *shape != [3 * observables * 5] {
            return Err(format!("{name}: rows {shape:?}"));
        }
        // The values are those of the moments.
        let [values, density] = ["/readout/value", "/density"].map(|d| found[d].numbers());
        let cell = found["/readout/cell"].numbers()[0] as usize;
        near("the density at the first cell", values[0], density[cell], 1e-13)?;
        overlaps_agree(&summary.value["readout"], settings.contains(&"scheme.degree=2"))
            .map_err(|e| format!("{name} {settings:?}: {e}"))?;
        let place = directory();
        job().with(["--ranks-x", *blocks]).on(*ranks).solve(place.path())?;
        let differ = differences(&datasets(place.path())?, &found);
        if differ.is_empty() && csv(place.path())? == csv(reference.path())? {
            return Ok(());
        }
        Err(format!("{name}: {ranks} ranks, {blocks} blocks: {differ:?}"))
    });
}

/// The rows of `summary.json`.
fn rows(summary: &Value) -> &Vec<Value> {
    summary["readout"]["rows"].as_array().expect("rows")
}

#[test]
fn values_are_the_moments_and_estimates_within_their_bounds() {
    let place = directory();
    let cells = &["readout={cells=[[5],[8],[14]],accuracy=0.05}", "solver.verify=true"];
    let summary = run(&[SMALL, LIKELY, cells]).solve(place.path()).unwrap();
    let stored = datasets(place.path()).unwrap();
    let (density, momentum) = (stored["/density"].numbers(), stored["/momentum"].numbers());
    let mut missed = 0;
    let value = |figure: &Value| figure["value"].as_f64();
    for row in rows(&summary.value) {
        let cell = row["cell"][0].as_u64().unwrap() as usize;
        let expected = match &row["observable"] {
            Value::String(s) if s == "density" => density[cell],
            Value::Object(o) if o.contains_key("momentum") => momentum[cell],
            _ => momentum[cell] / density[cell],
        };
        let found = value(&row["value"]).unwrap();
        assert!((found - expected).abs() <= 1e-13 * expected.abs(), "{row}");
        for m in row["measured"].as_array().unwrap() {
            // An unknown number has no value but a reason.
            for (name, figure) in m.as_object().unwrap() {
                if name == "estimator" {
                    continue;
                }
                let unknown = figure["label"] == "unavailable";
                assert_eq!(unknown, figure.get("value").is_none(), "{name}: {figure}");
                assert!(!unknown || figure["because"].as_str().is_some_and(|w| w.len() > 5));
            }
            if let (Some(estimate), Some(bound)) = (value(&m["estimate"]), value(&m["bound"])) {
                let linear =
                    row["observable"] == "density" || row["observable"].get("momentum").is_some();
                assert!(!linear || bound <= 0.05 * (1.0 + 1e-12), "{m}");
                missed += usize::from((estimate - found).abs() > bound);
            }
        }
    }
    // There are about 40 bounds. Each is missed with a probability of at most 1/20.
    assert!(missed <= 6, "{missed}");
    // The norm of the field, and the probability of the slice.
    let f = stored["/f"].numbers();
    let norm = f.iter().map(|f| f * f).sum::<f64>().sqrt();
    let readout = &summary.value["readout"];
    assert!((value(&readout["norm_of_field"]).unwrap() / norm - 1.0).abs() < 1e-12);
    let (p, repetitions) =
        (value(&readout["probability"]).unwrap(), value(&readout["repetitions"]).unwrap());
    assert!(p > 1e-6 && p < 1.0 && (p * repetitions - 1.0).abs() < 1e-12, "{p}");
    // A measurement of the x-register finds a cell with the probability Σ f² / C_f², which is not
    // its density.
    for (k, cell) in [5usize, 8, 14].into_iter().enumerate() {
        let square: f64 = f[17 * cell..17 * (cell + 1)].iter().map(|f| f * f).sum();
        let basis = value(&readout["basis_probability"][k]).unwrap();
        assert!((basis - square / (norm * norm)).abs() < 1e-13);
    }
}

/// `C_f` is known of a unitary flow and takes no evolution; of the upwind flux it is measured.
#[test]
fn a_unitary_flow_pays_nothing_for_its_norm() {
    const GRID: &[&str] = &["axis.0.x.cells=24", "axis.0.v.cells=16"];
    let cells = &["readout={cells=[[5]],shots=1000,evaluations=64}"];
    let unitary = &["scheme.flux=0", "scheme.ends=closed", "solver.warp.profile=designed"];
    let of_norm = |settings: &[&[&str]]| -> Vec<Option<f64>> {
        let summary = run(settings).summary().unwrap().value;
        let measured = rows(&summary)[0]["measured"].as_array().unwrap().clone();
        measured.iter().map(|m| m["evolutions_norm"]["value"].as_f64()).collect()
    };
    // f is negative somewhere, so that the outcome of all zeros says nothing.
    let kept = of_norm(&[GRID, cells, &unitary[..2]]);
    assert_eq!(kept, [Some(0.0), Some(0.0), None, None, None]);
    // With a register of p, too.
    assert_eq!(of_norm(&[GRID, cells, unitary]), kept);
    let measured = of_norm(&[GRID, LIKELY, cells]);
    assert!(measured[..3].iter().all(|of| of > &Some(0.0)), "{measured:?}");
}

#[test]
fn a_readout_without_a_quantum_state_gives_a_reason() {
    type Row = (&'static str, &'static [&'static str], usize, &'static str);
    const TINY: &[&str] = &["axis.0.x.cells=20", "axis.0.v.cells=16", "readout={points=[[0.1]]}"];
    let table: &[Row] = &[
        ("example2.toml", &[], 3, "not a vector of amplitudes"),
        ("example2.toml", &[], 3, "is transported linearly"),
        ("example1.toml", &["solver.method=classical"], 3, "prepares no quantum state"),
        ("pulsed_inflow.toml", &["time.end=0.2", "solver.tolerance=1e-3"], 3, "depends on t"),
    ];
    check_all(table, |(name, settings, count, why)| {
        let place = directory();
        let job = of_case("run", name).set(&[TINY, settings].concat());
        let finished = job.into(place.path()).succeed()?;
        finished.contains(&finished.output, &[" is unavailable: ", why])?;
        let summary = Summary::read(finished, place.path())?;
        let readout = &summary.value["readout"];
        let is_labelled = |figure: &Value| {
            figure["label"] == "unavailable"
                && figure.get("value").is_none()
                && figure["because"].as_str().is_some_and(|w| w.contains(why))
        };
        let rows = rows(&summary.value);
        let all =
            rows.iter().all(|r| is_labelled(&r["value"])) && is_labelled(&readout["probability"]);
        let text = csv(place.path())?;
        let lines = text.lines().skip(1).filter(|l| l.contains(why)).count();
        summary.require(all && rows.len() == *count && lines == *count, || {
            format!("{readout}\n{text}")
        })
    });
}

/// `check` and `plan` say that nothing will be read, and why, as the run does.
#[test]
fn no_readout_is_announced_before_the_run() {
    let rows: [(&str, &[&str], &str); 2] = [
        (
            "example1.toml",
            &["solver.method=classical", "readout={points=[[0.5]]}"],
            "readout of 1 cell: unavailable: solver.method = \"classical\" prepares no",
        ),
        ("example2.toml", &["readout={cells=[[3],[4]]}"], "readout of 2 cells: unavailable: "),
    ];
    check_all(&rows, |(name, set, words)| {
        // `check` and `plan` by turn.
        let command = if *name == "example1.toml" { "check" } else { "plan" };
        let finished = of_case(command, name).set(set).succeed()?;
        finished.contains(&finished.output, &[words])
    });
}

#[test]
fn mistakes_are_refused() {
    let table: &[(&str, &[&str])] = &[
        ("{}", &["readout.cells", "missing", "readout.points"]),
        ("{cells=[]}", &["readout.cells", "0 given", "1 to 256"]),
        ("{cells=[3]}", &["readout.cells.0", "3", "a list of numbers"]),
        ("{cells=[[3,4]]}", &["readout.cells", "lists of 1 number each"]),
        ("{cells=[[128]]}", &["readout.cells", "128 along x", "from 0 to 127"]),
        ("{cells=[[-1]]}", &["readout.cells", "-1 along x"]),
        ("{cells=[[0.5]]}", &["readout.cells", "0.5 along x", "whole numbers"]),
        ("{points=[[1.51]]}", &["readout.points", "1.51 along x", "-1.5 to 1.5"]),
        ("{cells=[[1]],points=[[0]]}", &["readout.points", "either"]),
        ("{cells=[[1]],shots=0}", &["readout.shots", "at least 1"]),
        ("{cells=[[1]],shots=1.5}", &["readout.shots", "a whole number"]),
        ("{cells=[[1]],shots=1e16}", &["readout.shots", "a whole number"]),
        ("{cells=[[1]],shots=9000000000000000}", &["readout.shots", "at most"]),
        ("{cells=[[1]],evaluations=100}", &["readout.evaluations", "power of two"]),
        ("{cells=[[1]],accuracy=0}", &["readout.accuracy", "above 0"]),
        ("{cells=[[1]],accuracy=0.1,shots=10}", &["readout.shots", "readout.accuracy"]),
        ("{cells=[[1]],seed=-1}", &["readout.seed", "at least 0"]),
        ("{cells=[[1]],shot=10}", &["readout.shot", "did you mean \"shots\""]),
        ("3", &["readout", "a table"]),
    ];
    // Correct settings are accepted.
    let right = "readout={points=[[0],[1.5]],accuracy=0.1,seed=4}";
    let understood = of_case("check", "example1.toml").set(&[right]);
    let printed = understood.succeed().unwrap().output;
    assert!(printed.contains("readout of 2 cells: to 1e-1, seed 4"), "{printed}");
    // A whole number may be a float.
    let shots = ["readout={points=[[0.5]]}", "readout.shots=1e4", "readout.evaluations=6.4e1"];
    let printed = of_case("check", "example1.toml").set(&shots).succeed().unwrap().output;
    assert!(printed.contains("readout of 1 cell: 10000 shots, 64 evaluations"), "{printed}");
    all_refused(table, |(readout, wording), _| {
        Mistake::set("example1.toml", &[&format!("readout={readout}")], wording)
    });
}
