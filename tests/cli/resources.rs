//! `phasewarp resources` and the probabilities of a run: counts, and measurements of the whole
//! warped field.

use crate::support::{Job, case, check_all, datasets_of, directory, field, require, run};

/// Sparsity, queries and qubits of every kind of scene, on any ranks; in every form; what is not
/// known is said and not zero.
#[test]
fn resources_are_counted() {
    let rows = [
        ("example1.toml", 1, 20.0),
        ("slope_jump.toml", 3, 20.0),
        ("inflow_barrier.toml", 2, 21.0),
        ("barrier2d.toml", 4, 21.0),
        ("step3d.toml", 2, 20.0),
        ("example2.toml", 2, 22.0),
        ("smooth-beams.toml", 3, 24.0),
        ("partial_reflection.toml", 2, 24.0),
    ];
    check_all(&rows, |&(name, ranks, qubits)| {
        let job = |format: &str| Job::new(["resources", &case(name), "--format", format]);
        let read = |format: &str| job(format).on(ranks).succeed()?.json();
        let (record, azure, qref) = (read("json")?, read("azure")?, read("qref")?);
        let alone = job("json").succeed()?;
        // Nothing depends on ranks but round-off of norms, of which there is none.
        let same = alone.json()? == record;
        require(same, &alone, || format!("other than on {ranks} ranks: {record}"))?;
        let value = |key: &str| record[key]["value"].as_f64().unwrap_or(f64::NAN);
        let tau = value("nonzeros")
            * value("largest_entry")
            * record["time"].as_f64().unwrap_or(f64::NAN);
        let sensible = (value("tau") / tau - 1.0).abs() < 1e-12
            && value("walk_steps") == 2.0 * value("degree")
            && value("degree") > tau
            && record["t_gates"]["label"] == "unavailable"
            && record["t_gates"]["because"].is_string()
            && azure["logicalCounts"]["tCount"].is_null()
            && azure["unavailable"]["tCount"].is_string()
            && azure["logicalCounts"]["rotationCount"].as_u64()
                == Some(value("walk_steps") as u64 + 1)
            && azure["logicalCounts"]["numQubits"].is_u64()
            && qref["version"] == "v1"
            && qref["program"]["children"].as_array().is_some_and(|c| c.len() == 3);
        require(sensible, &alone, || format!("{record} {azure} {qref}"))?;
        let counted = record["qubits"]["total"].as_f64().unwrap_or(f64::NAN);
        require(counted <= qubits + 8.0 && counted >= 8.0, &alone, || format!("{counted} qubits"))?;
        let shares = ["in_p", "field_given_p", "weights_given_field", "all"];
        let chain = &record["probabilities"]["at_slice"];
        let p: Vec<f64> =
            shares.iter().map(|k| chain[*k]["value"].as_f64().unwrap_or(f64::NAN)).collect();
        let product = (p[0] * p[1] * p[2] / p[3] - 1.0).abs() < 1e-12;
        require(product && p.iter().all(|p| (0.0..=1.0 + 1e-12).contains(p)), &alone, || {
            format!("{chain}")
        })?;
        let text = Job::new(["resources", &case(name)]).succeed()?;
        text.says(&text.output, &["unavailable: the oracles"])
    });
    for (name, settings, words) in [
        ("example1.toml", "solver.method=classical", "no quantum side"),
        ("pulsed_inflow.toml", "solver.tolerance=1e-4", "depends on t"),
        ("example1.toml", "initial={warped='w.h5'}", "a file holds any"),
    ] {
        for more in [None, Some("--optimise")] {
            let job = Job::new(["resources", &case(name)]).with(more);
            let job = job.set(&[settings, "exact={f='0'}"]).on(2);
            job.is_refused(&[words]).unwrap();
        }
    }
}

/// The probability of the slice and of the window, and the norm of the field that follows, against
/// the whole warped field of a full run.
#[test]
fn probabilities_are_those_of_the_warped_field() {
    // Neither weights nor inflow: the file holds the state.
    let place = directory();
    let job = run("example1.toml").set(&[
        "axis.0.x.cells=18",
        "axis.0.v.cells=14",
        "scheme.interface=conservative",
        "solver.tolerance=1e-5",
        "solver.warp.profile=smooth",
    ]);
    let summary = job.with(["--mode", "full"]).on(3).solve(place.path()).unwrap();
    let all = datasets_of(&place.path().join("warped_f.h5")).unwrap();
    let (w, p) = (all["/w"].numbers(), all["/axis/p"].numbers());
    let found = &summary.value["probabilities"];
    let number = |chain: &str, key: &str| found[chain][key]["value"].as_f64().unwrap();
    assert_eq!(found["points"].as_f64(), Some(p.len() as f64));
    let square = |k: usize| w.iter().skip(k).step_by(p.len()).map(|w| w * w).sum::<f64>();
    let whole: f64 = (0..p.len()).map(square).sum();
    let norm = found["norm_of_state"]["value"].as_f64().unwrap();
    assert!((whole.sqrt() / norm - 1.0).abs() < 1e-6, "{} {norm}", whole.sqrt());
    let [begin, end] = [0, 1].map(|k| found["window"][k].as_f64().unwrap());
    // The points of the file are not at p of the recovery: the slice next to it.
    let k = p.iter().position(|p| *p >= begin).unwrap();
    let slice = square(k) / whole * (2.0 * (p[k] - begin)).exp();
    assert!((slice / number("at_slice", "in_p") - 1.0).abs() < 1e-3, "{slice}");
    let inside: f64 = (0..p.len()).filter(|&k| p[k] >= begin && p[k] < end).map(square).sum();
    let ratio = inside / whole / number("in_window", "in_p");
    let spacing = p[1] - p[0];
    assert!((ratio.ln()).abs() <= 2.0 * spacing + 1e-3, "{ratio}");
    // The field's norm from the probability alone.
    let f = field(place.path()).unwrap();
    let exact = f.iter().map(|f| f * f).sum::<f64>().sqrt();
    let from = found["norm_of_field"]["value"].as_f64().unwrap();
    assert!((from / exact - 1.0).abs() < 1e-12, "{from} {exact}");
}
