//! `phasewarp resources` and the probabilities of a run: counts, and measurements of the whole
//! warped field.

use serde_json::Value;

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
        let own = &record["own"];
        [&record, own]
            .into_iter()
            .try_for_each(|record| consistent(record).map_err(|why| format!("{why}: {record}")))?;
        let number = |key: &str| record[key]["value"].as_f64();
        let calls = &azure["oracleCalls"];
        let evolution = &qref["program"]["children"][1]["resources"];
        let of_qref = |name: &str| {
            let all = evolution.as_array()?;
            all.iter().find(|r| r["name"] == name)?["value"].as_f64()
        };
        let sensible = azure["logicalCounts"]["tCount"].is_null()
            && azure["unavailable"]["tCount"].is_string()
            && azure["logicalCounts"]["rotationCount"].as_f64()
                == number("walk_steps").map(|steps| steps + 1.0)
            && azure["logicalCounts"]["numQubits"].as_f64()
                == record["qubits"]["walk"]["total"]["value"].as_f64()
            && calls["location"].as_f64() == number("location_queries")
            && calls["value"].as_f64() == number("value_queries")
            && calls["total"].as_f64() == number("queries")
            && of_qref("queries") == number("queries")
            && of_qref("location_queries") == number("location_queries")
            && of_qref("value_queries") == number("value_queries")
            && qref["version"] == "v1"
            && qref["program"]["children"].as_array().is_some_and(|c| c.len() == 3);
        require(sensible, &alone, || format!("{record} {azure} {qref}"))?;
        let counted = own["qubits"]["total"].as_f64().unwrap_or(f64::NAN);
        require(counted <= qubits + 8.0 && counted >= 8.0, &alone, || format!("{counted} qubits"))?;
        // What is priced first is what is cheapest on a quantum computer, without weights; the
        // case's own set-up is planned to be emulated.
        let cost = |record: &Value| {
            let both = record["queries_until_measured"].as_array();
            let known = both.into_iter().flatten().filter_map(|cost| cost["value"].as_f64());
            known.fold(f64::INFINITY, f64::min)
        };
        let cheapest = cost(&record) <= cost(own) && record["interface"] == "conservative";
        let weighted = own["weighted"] == true;
        let table = &own["weights_table"];
        let cells = own["shape"].as_array().into_iter().flatten().filter_map(Value::as_f64);
        let cells: f64 = cells.product();
        let priced = match weighted {
            false => table.is_null(),
            true => {
                let reads = 2.0 * (cells - 1.0);
                let all = reads * own["value_queries"]["value"].as_f64().unwrap_or(f64::NAN);
                table["entries"].as_f64() == Some(cells)
                    && table["toffolis_a_value_query"]["value"].as_f64() == Some(reads)
                    && table["toffolis"]["value"].as_f64() == Some(all)
                    && table["sweeps"].as_f64() > Some(0.0)
            }
        };
        let priced = priced && record["weights_table"].is_null() && record["weighted"] == false;
        require(cheapest && priced, &alone, || format!("{record}"))?;
        // What is counted of measure-valued data gives no density.
        let why = record["measure_valued"].as_str().unwrap_or_default();
        let told = why.contains("is not linear") && why.contains("initial.f");
        require(told == (name == "example2.toml"), &alone, || format!("{name}: {why}"))?;
        bounds_of_sparsity(own).map_err(|why| format!("{why}: {own}"))?;
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

/// Whether the numbers of a record belong together.
fn consistent(record: &Value) -> Result<(), String> {
    let value = |key: &str| record[key]["value"].as_f64().unwrap_or(f64::NAN);
    let time = record["time"].as_f64().unwrap_or(f64::NAN);
    let tau = value("nonzeros") * value("largest_entry") * time;
    // Two calls of the location oracle and four of the value oracle a step.
    let holds = (value("tau") / tau - 1.0).abs() < 1e-12
        && value("walk_steps") == 2.0 * value("degree")
        && value("degree") > tau
        && value("location_queries") == 2.0 * value("walk_steps")
        && value("value_queries") == 4.0 * value("walk_steps")
        && value("queries") == 6.0 * value("walk_steps")
        && record["t_gates"]["label"] == "unavailable"
        && record["t_gates"]["because"].is_string();
    if !holds {
        return Err("queries that do not follow from the steps".to_owned());
    }
    // Bits: about log₂ τ more than log₂ 1/ε, of real and imaginary part.
    let (bits, fine) = (value("value_bits"), value("walk_tolerance"));
    let least = (tau / fine).log2();
    let walk = &record["qubits"]["walk"];
    let system = record["qubits"]["total"].as_f64().unwrap_or(f64::NAN);
    if bits < least || bits > least + 4.0 || walk["value"].as_f64() != Some(2.0 * bits) {
        return Err(format!("{bits} bits for log2(tau/eps) = {least}"));
    }
    if walk["row_and_column"].as_f64() != Some(2.0 * (system + 2.0)) {
        return Err("no room for dummies and flags".to_owned());
    }
    let shares = ["in_p", "field_given_p", "weights_given_field", "all"];
    let chain = &record["probabilities"]["at_slice"];
    let p: Vec<f64> =
        shares.iter().map(|k| chain[*k]["value"].as_f64().unwrap_or(f64::NAN)).collect();
    let product = (p[0] * p[1] * p[2] / p[3] - 1.0).abs() < 1e-12;
    match product && p.iter().all(|p| (0.0..=1.0 + 1e-12).contains(p)) {
        true => Ok(()),
        false => Err("probabilities that are none".to_owned()),
    }
}

/// The paper's bounds on `H` in one and two dimensions only, and the one of its argument.
fn bounds_of_sparsity(record: &Value) -> Result<(), String> {
    let sparsity = &record["sparsity"];
    let of_hamiltonian = sparsity["counts"].as_array().and_then(|c| c.last());
    let stated = of_hamiltonian.map_or(&Value::Null, |count| &count["rows"]["bound"]);
    let ours = &sparsity["our_bound"];
    if sparsity["bounded"] != true {
        return match stated.is_null() && ours.is_null() {
            true => Ok(()),
            false => Err("a bound that is made for other cases".to_owned()),
        };
    }
    let q: Vec<u64> =
        sparsity["q"].as_array().into_iter().flatten().filter_map(Value::as_u64).collect();
    let (n, sum) = (q.len() as u64, q.iter().sum::<u64>());
    let expected = [Some(sum + 5), Some(sum + 7), None][q.len() - 1];
    match stated.as_u64() == expected && ours.as_u64() == Some(sum + 3 * n + 2) {
        true => Ok(()),
        false => Err(format!("bounds {stated} and {ours} for Q = {q:?}")),
    }
}

/// `τ` is of the modes that carry something: as many as a run propagates, and of the entries of
/// `μS + iK` at the highest of them, read from the exported matrices; not of all that the register
/// has.
#[test]
fn tau_is_of_the_modes_that_carry_something() {
    let grid = ["axis.0.x.cells=8", "axis.0.v.cells=8", "solver.tolerance=1e-3"];
    let profile = "solver.warp.profile=smooth";
    let place = directory();
    let of_run = run("example1.toml").set(&grid).set(&[profile]).solve(place.path()).unwrap();
    let files = directory();
    let path = files.path().display().to_string();
    let job = Job::new(["export-matrix", &case("example1.toml"), "-o", &path]).set(&grid);
    job.succeed().unwrap();
    let entries = |name: &str| -> Vec<(String, f64)> {
        let text = std::fs::read_to_string(files.path().join(name)).unwrap();
        let lines = text.lines().filter(|line| !line.starts_with('%')).skip(1);
        let entry = |line: &str| {
            let (place, value) = line.rsplit_once(' ').unwrap();
            (place.to_owned(), value.parse().unwrap())
        };
        lines.map(entry).collect()
    };
    let job = Job::new(["resources", &case("example1.toml"), "--format", "json"]);
    let found = job.set(&grid).set(&[profile]).succeed().unwrap().json().unwrap();
    let own = &found["own"];
    let modes = own["setup"]["modes"].as_f64().unwrap();
    assert_eq!(modes, of_run.number("modes").unwrap());
    let highest = std::f64::consts::TAU * (modes - 1.0) / own["period"].as_f64().unwrap();
    let skew: std::collections::HashMap<String, f64> = entries("K.mtx").into_iter().collect();
    let moduli = entries("S.mtx")
        .into_iter()
        .map(|(place, s)| (highest * s).hypot(skew.get(&place).copied().unwrap_or(0.0)));
    let expected = moduli.fold(0.0, f64::max);
    let largest = own["largest_entry"]["value"].as_f64().unwrap();
    assert!((largest / expected - 1.0).abs() < 1e-12, "{largest} {expected}");
    // The register has more.
    let register = own["points"].as_f64().unwrap();
    assert!(register > 2.0 * modes + 1.0, "{register} {modes}");
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
