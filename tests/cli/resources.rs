//! `phasewarp resources`: its counts are consistent and agree with emitted circuits; and the
//! probabilities of a run agree with the whole warped field.

use phasewarp::base::text::csv_records;
use serde_json::Value;

use crate::support::{
    Finished, Job, case, check_all, datasets_of, directory, field, json_of, number, of_case,
    require, run, text_of,
};

/// Sparsity, queries and qubits are consistent for all kinds of cases and in every format, and the
/// same on several ranks. Unknown numbers are marked as such and are not zero.
#[test]
fn resources_are_consistent_in_every_format() {
    const SMALL: &[&str] = &["axis.0.x.cells=32", "axis.0.v.cells=32"];
    let rows: [(&str, &[&str], usize, f64); 8] = [
        ("example1.toml", &[], 1, 20.0),
        ("slope_jump.toml", &[], 3, 20.0),
        ("inflow_barrier.toml", SMALL, 1, 21.0),
        ("barrier2d.toml", &[], 4, 21.0),
        ("step3d.toml", &[], 1, 20.0),
        ("example2.toml", SMALL, 1, 22.0),
        ("smooth-beams.toml", &[], 1, 24.0),
        ("partial_reflection.toml", &[], 2, 24.0),
    ];
    check_all(&rows, |&(name, settings, ranks, qubits)| {
        let formats = Formats::of(name, settings, ranks)?;
        formats.agree()?;
        formats.have_the_cheapest_set_up()?;
        formats.explain_measure_valued(name)?;
        formats.name_no_directory()?;
        formats.have_what_the_case_allows(name)?;
        let Formats { alone, record, .. } = &formats;
        let own = &record["own"];
        let counted = number(&own["qubits"]["total"]);
        require(counted <= qubits + 8.0 && counted >= 8.0, alone, || format!("{counted} qubits"))?;
        bounds_of_sparsity(own).map_err(|why| format!("{why}: {own}"))
    });
    let text = of_case("resources", "example1.toml").succeed().unwrap();
    text.contains(&text.output, &["g exact (emitted gates)", "m model or estimate"]).unwrap();
}

#[test]
fn resources_of_other_problems_are_refused() {
    for (name, settings, words) in [
        ("example1.toml", "solver.method=classical", "has no quantum algorithm"),
        ("pulsed_inflow.toml", "solver.tolerance=1e-4", "depends on t"),
        ("example1.toml", "initial={warped='w.h5'}", "a file may hold any other"),
    ] {
        for (more, ranks) in [(None, 1), (Some("--optimise"), 2)] {
            let job = of_case("resources", name).with(more);
            let job = job.set(&[settings, "exact={f='0'}"]).on(ranks);
            job.is_refused(&[words]).unwrap();
        }
    }
}

/// The resources of a case in every format.
struct Formats {
    /// The job that printed the JSON.
    alone: Finished,
    record: Value,
    azure: Value,
    qref: Value,
}

impl Formats {
    /// Of a case, whose JSON is consistent and the same on `ranks`.
    fn of(name: &str, settings: &[&str], ranks: usize) -> Result<Self, String> {
        let job =
            |format: &str| of_case("resources", name).set(settings).with(["--format", format]);
        let alone = job("json").succeed()?;
        let record = alone.json()?;
        // Formats are of the same record.
        let read = |format: &str| job(format).succeed()?.json();
        let (azure, qref) = (read("azure")?, read("qref")?);
        if ranks > 1 {
            // Only round-off of norms depends on the ranks, and these numbers contain no norms.
            let same = job("json").on(ranks).succeed()?.json()? == record;
            require(same, &alone, || format!("other than on {ranks} ranks: {record}"))?;
        }
        [&record, &record["own"]]
            .into_iter()
            .try_for_each(|record| consistent(record).map_err(|why| format!("{why}: {record}")))?;
        Ok(Self { alone, record, azure, qref })
    }

    /// Whether the case has a circuit.
    fn is_compiled(&self) -> bool {
        self.record["no_circuit"].is_null()
    }

    /// The formats for Azure and QREF have the numbers of the JSON.
    fn agree(&self) -> Result<(), String> {
        let Self { alone, record, azure, qref } = self;
        let least = &least_cost(record);
        let of_azure = if self.is_compiled() {
            self.have_emitted_gates(least)
        } else {
            self.have_queries(least)
        };
        let sensible = of_azure
            && azure["tOfRotations"].as_f64() == Some(t_of_rotations(least, record))
            && (!self.is_compiled() || synthesized(azure, least, record))
            && peaks(&qref["program"])
            && azure["tOfRotation"]["factor"] == 3.0
            && record["t_of_rotation"] == azure["tOfRotation"]
            && qref["version"] == "v1"
            && qref["program"]["children"].as_array().is_some_and(|c| c.len() == 3);
        require(sensible, alone, || format!("{record} {azure} {qref}"))
    }

    /// The simulation in QREF.
    fn simulation(&self) -> &Value {
        &self.qref["program"]["children"][1]
    }

    /// A resource of the simulation in QREF.
    fn of_qref(&self, name: &str) -> Option<f64> {
        let all = self.simulation()["resources"].as_array()?;
        all.iter().find(|r| r["name"] == name)?["value"].as_f64()
    }

    /// Whether other formats have the gates of a compiled circuit, and no numbers of other kinds of
    /// access.
    fn have_emitted_gates(&self, least: &Value) -> bool {
        let counts = &self.azure["logicalCounts"];
        [("cczCount", "toffoli"), ("tCount", "t"), ("rotationCount", "rotations")]
            .into_iter()
            .chain([("numQubits", "qubits")])
            .all(|(count, key)| counts[count].as_f64() == least[key]["value"].as_f64())
            && self.of_qref("toffoli") == least["toffoli"]["value"].as_f64()
            && self.of_qref("calls") == least["steps"]["value"].as_f64()
            && self.of_qref("qubits") == least["qubits"]["value"].as_f64()
            && self.simulation()["meta"]["labels"]["toffoli"] == least["toffoli"]["label"]
            && self.of_qref("toffoli_model").is_none()
            && self.of_qref("queries").is_none()
    }

    /// Whether other formats have the queries of sparse access where there is no circuit.
    fn have_queries(&self, least: &Value) -> bool {
        let Self { record, azure, .. } = self;
        let (counts, calls) = (&azure["logicalCounts"], &azure["oracleCalls"]);
        let number = |key: &str| record[key]["value"].as_f64();
        counts["tCount"].is_null()
            && azure["unavailable"]["tCount"] == record["no_circuit"]
            && counts["rotationCount"].as_f64() == number("walk_steps").map(|steps| steps + 1.0)
            && counts["numQubits"].as_f64() == record["qubits"]["walk"]["total"]["value"].as_f64()
            && calls["location"].as_f64() == number("location_queries")
            && calls["value"].as_f64() == number("value_queries")
            && calls["total"].as_f64() == number("queries")
            && self.of_qref("toffoli_model") == least["toffoli"]["value"].as_f64()
            && self.of_qref("toffoli").is_none()
            && self.of_qref("queries") == number("queries")
            && self.of_qref("location_queries") == number("location_queries")
            && self.of_qref("value_queries") == number("value_queries")
            && self.simulation()["meta"]["labels"]["queries"] == record["queries"]["label"]
    }

    /// The record describes the cheapest choice on a quantum computer, which has no weights. Its
    /// entry `own` describes the set-up of the case, which is planned for emulation.
    fn have_the_cheapest_set_up(&self) -> Result<(), String> {
        let record = &self.record;
        let own = &record["own"];
        let cost = |record: &Value| {
            let both = record["queries_until_measured"].as_array();
            let known = both.into_iter().flatten().filter_map(|cost| cost["value"].as_f64());
            known.fold(f64::INFINITY, f64::min)
        };
        let cheapest = cost(record) <= cost(own) && record["interface"] == "conservative";
        let priced = is_weighted_table_priced(own)
            && record["weights_table"].is_null()
            && record["weighted"] == false;
        require(cheapest && priced, &self.alone, || format!("{record}"))
    }

    /// The counts for measure-valued data give no density, and say which keys do: they can be
    /// pasted.
    fn explain_measure_valued(&self, name: &str) -> Result<(), String> {
        let why = self.record["measure_valued"].as_str().unwrap_or_default();
        let is_explained = why.contains("is not linear") && why.contains("initial.f");
        let expected = is_explained == (name == "example2.toml");
        require(expected, &self.alone, || format!("{name}: {why}"))?;
        let Some((_, f)) = why.split_once("initial = { f = \"") else { return Ok(()) };
        let f = f.split('"').next().unwrap_or_default();
        let smooth = ["inflow.value=\"initial\"".to_owned(), format!("initial={{f=\"{f}\"}}")];
        let own = smooth.each_ref().map(String::as_str);
        let job = of_case("resources", name).set(&own).with(["--format", "json"]);
        let overlaps = job.succeed()?.json()?;
        let kind = &overlaps["cheapest"]["measure_valued"];
        require(kind.is_null(), &self.alone, || format!("{kind}"))
    }

    /// No reason names a directory of this machine.
    fn name_no_directory(&self) -> Result<(), String> {
        let record = &self.record;
        let reasons = [&record["no_circuit"], &record["not_unitary"], &record["own"]["no_circuit"]];
        let here = env!("CARGO_MANIFEST_DIR");
        let named = reasons.iter().filter_map(|why| why.as_str()).any(|why| why.contains(here));
        require(!named, &self.alone, || format!("{reasons:?}"))
    }

    /// Only two of the cases have a circuit. The unitary scheme has no inflow, and no velocity cell
    /// around 0 at a jump; without postselection, one evolution suffices for it.
    fn have_what_the_case_allows(&self, name: &str) -> Result<(), String> {
        let Self { alone, record, .. } = self;
        let compiles = ["example1.toml", "slope_jump.toml"].contains(&name);
        let expected = self.is_compiled() == compiles;
        require(expected, alone, || format!("{name}: {}", record["no_circuit"]))?;
        let none =
            ["inflow_barrier.toml", "partial_reflection.toml", "example2.toml", "barrier2d.toml"];
        let unitary = record["not_unitary"].is_null();
        require(unitary != none.contains(&name), alone, || format!("{}", record["not_unitary"]))?;
        for cost in record["unitary"]["costs"].as_array().into_iter().flatten() {
            let once = cost["toffoli_until_measured"][0]["value"] == cost["toffoli"]["value"];
            require(once, alone, || format!("{cost}"))?;
        }
        Ok(())
    }
}

/// Whether a set-up with weights has the cost of their table, and one without has none.
fn is_weighted_table_priced(own: &Value) -> bool {
    let table = &own["weights_table"];
    if own["weighted"] != true {
        return table.is_null();
    }
    let cells = own["shape"].as_array().into_iter().flatten().filter_map(Value::as_f64);
    let cells: f64 = cells.product();
    let reads = 2.0 * (cells - 1.0);
    let all = reads * number(&own["value_queries"]["value"]);
    table["entries"].as_f64() == Some(cells)
        && table["toffolis_a_value_query"]["value"].as_f64() == Some(reads)
        && table["toffolis"]["value"].as_f64() == Some(all)
        && table["sweeps"].as_f64() > Some(0.0)
}

/// T gates of all rotations of an evolution, by the documented formula from `t_of_rotation`.
fn t_of_rotations(cost: &Value, record: &Value) -> f64 {
    let rotations = number(&cost["rotations"]["value"]);
    let synthesis = &record["t_of_rotation"];
    // A quarter of the tolerance, in equal shares.
    let bits = (rotations / (0.25 * number(&record["walk_tolerance"]["value"]))).log2();
    rotations * (number(&synthesis["factor"]) * bits + number(&synthesis["constant"])).ceil()
}

/// Whether the counts for Azure without rotations have their T gates, and as many gates as the JSON
/// has of the same evolution.
fn synthesized(azure: &Value, cost: &Value, record: &Value) -> bool {
    let of = |counts: &str, key: &str| number(&azure[counts][key]);
    let t = of("logicalCounts", "tCount") + t_of_rotations(cost, record);
    let gates = of("synthesizedCounts", "cczCount") + 0.25 * of("synthesizedCounts", "tCount");
    of("synthesizedCounts", "tCount") == t
        && of("synthesizedCounts", "rotationCount") == 0.0
        && of("synthesizedCounts", "numQubits") == of("logicalCounts", "numQubits")
        && (gates / number(&cost["gates"]["value"]) - 1.0).abs() < 1e-9
}

/// Whether the numbers of qubits of all routines have the type `qubits`, so that they are not
/// added.
fn peaks(routine: &Value) -> bool {
    let mut resources = routine["resources"].as_array().into_iter().flatten();
    resources.all(|r| (r["name"] == "qubits") == (r["type"] == "qubits"))
        && routine["children"].as_array().into_iter().flatten().all(peaks)
}

/// The cost of the access with the fewest gates, for the sequence whose rotations are computed.
fn least_cost(record: &Value) -> Value {
    let number = |cost: &Value| {
        let both = cost["gates_until_measured"].as_array();
        let known = both.into_iter().flatten().filter_map(|cost| cost["value"].as_f64());
        known.fold(f64::INFINITY, f64::min)
    };
    let costs = record["costs"].as_array().into_iter().flatten().cloned();
    let least = |a: Value, b: Value| if number(&b) < number(&a) { b } else { a };
    costs.reduce(least).unwrap_or_default()
}

/// The counted gates of the unitary scheme are those of the circuit that `export-circuit` emits and
/// of the reflection in each step.
#[test]
fn counts_agree_with_the_emitted_circuit() {
    let of_width = |upper: f64, exact: bool| {
        let axis = format!("axis.0.v={{lower=-{upper},upper={upper},cells=8}}");
        let grid = ["axis.0.x.cells=8", &axis];
        let job = Job::new(["resources", &case("example1.toml"), "--format", "json"]).set(&grid);
        let found = job.succeed().unwrap().json().unwrap();
        let bins = found["unitary"]["rounding"]["bin_bits"].to_string();
        for levels in ["hadamard", "uniform"] {
            let place = directory();
            let path = place.path().display().to_string();
            let job = Job::new(["export-circuit", &case("example1.toml"), "-o", &path]).set(&grid);
            let job = job.set(&["scheme.flux=0", "scheme.ends=closed"]);
            // A circuit with many bins has too many terms for the simulation.
            let columns = if exact { "64" } else { "0" };
            let job = job.with(["--levels", levels, "--check", columns, "--sub-bins", &bins]);
            job.succeed().unwrap();
            let circuit = json_of(place.path().join("circuit.json")).unwrap();
            is_the_emitted_circuit(&found, &circuit, levels);
        }
        let rounding = &found["unitary"]["rounding"];
        assert_eq!(rounding["rounded"] == 0.0, exact, "{rounding}");
        assert_eq!(rounding["change"]["label"], "upper-bound");
    };
    // The step has 2.5 levels, then 2.84.
    of_width(1.6, true);
    of_width(1.5, false);
}

/// Checks that the counts of the unitary scheme in `found` are those of the `emitted` circuit with
/// these levels on 8 by 8 cells.
fn is_the_emitted_circuit(found: &Value, emitted: &Value, levels: &str) {
    let about = &emitted["description"];
    let difference = about["check"]["difference"].as_f64();
    assert!(difference.is_none_or(|difference| difference < 1e-13));
    assert_eq!(difference.is_some(), about["rounded"] == 0.0);
    let count = |key: &str| about["controlled"][key].as_f64().unwrap();
    let expected = count("toffoli") + 2.0 * (count("block_qubits") - 1.0);
    let costs = found["unitary"]["costs"].as_array().unwrap();
    let cost = costs.iter().find(|cost| cost["access"]["circuit"] == levels).unwrap();
    assert_eq!(cost["toffoli_a_step"]["value"].as_f64(), Some(expected));
    assert_eq!(cost["toffoli_a_step"]["label"], "emitted");
    // The counts and the circuit round the jump to the same bins.
    assert_eq!(found["unitary"]["rounding"]["bin_bits"], about["transport"]["bin_bits"]);
    assert_eq!(found["unitary"]["rounding"]["rounded"], about["rounded"]);
    // A reflection needs one clean qubit less than the block has qubits.
    let clean = count("scratch_qubits").max(count("block_qubits") - 1.0);
    let qubits = count("qubits") - count("scratch_qubits") + clean;
    for sequence in [cost, &cost["half_calls"]] {
        assert_eq!(sequence["qubits"]["value"].as_f64(), Some(qubits));
        assert_eq!(sequence["ancillas"]["value"].as_f64(), Some(clean));
    }
    assert_eq!(cost["alpha"]["value"], about["alpha"]);
    // The norm of the transport in a long box is v_max/dx; alpha is slightly larger.
    let norm = about["transport"]["axes"][0]["rate"].as_f64().unwrap() * 7.0;
    let alpha = about["alpha"].as_f64().unwrap() / norm;
    assert!((1.0 - 1e-12..1.2).contains(&alpha), "{levels}: {alpha}");
    assert!(levels == "hadamard" || alpha < 1.0 + 1e-12, "{alpha}");
}

/// A unitary flow has one mode, hence no register for p and no postselection: in a run, in its own
/// set-up, in the cheapest set-up and in the list of choices. All choices of the list have their
/// numbers, in rows of 100 columns.
#[test]
fn a_unitary_flow_has_no_register_for_p() {
    const CLOSED: &[&str] =
        &["axis.0.x.cells=8", "axis.0.v.cells=8", "scheme.flux=0", "scheme.ends=closed"];
    // Nothing leaves a ring without a force, also through open ends.
    const RING: &[&str] = &[
        "axis.0.x.cells=8", "axis.0.v.cells=8", "axis.0.x.boundary=periodic",
        "potential=[{value='0'}]", "scheme.flux=0",
    ];
    let rows: [(&str, &[&str], &[&str]); 4] = [
        ("example1.toml", RING, &["solver.tolerance=1e-3"]),
        ("unitary_advection.toml", &["scheme.degree=2", "solver.tolerance=1e-3"], &[]),
        ("example1.toml", CLOSED, &["solver.tolerance=1e-3"]),
        (
            "example1.toml",
            CLOSED,
            &["solver.warp.shift=2", "output.recovery_points=1", "solver.tolerance=1e-3"],
        ),
    ];
    let rows: Vec<_> = rows.iter().enumerate().collect();
    check_all(&rows, |&(k, (name, settings, more))| {
        let job = |words: &[&str]| {
            let job = of_case("resources", name).set(settings).set(more);
            job.with(words.iter().copied())
        };
        let found = job(&["--format", "json"]).succeed()?;
        let record = found.json()?;
        let costs_of_unitary = record["unitary"]["costs"].clone();
        let free = |record: &Value| {
            let chain = &record["probabilities"]["at_slice"];
            record["points"] == 1
                && record["qubits"]["p"] == 0
                && chain["all"]["value"] == 1.0
                && chain["repetitions"]["value"] == 1.0
                && record["costs"] == costs_of_unitary
        };
        require(free(&record), &found, || format!("{record}"))?;
        let of_cells = *name == "example1.toml";
        let compiled = record["own"]["no_circuit"].is_null();
        require(compiled == of_cells, &found, || format!("{}", record["own"]["no_circuit"]))?;
        let by_hand = more.iter().any(|key| key.contains("shift"));
        require(by_hand || free(&record["own"]), &found, || format!("{}", record["own"]))?;
        // Tables have what is the same once, by the name of the unitary scheme. All formats have
        // the rows of one table; here by turn.
        let format = ["text", "csv", "latex", "text"][k];
        let table = job(&["--format", format]).succeed()?;
        let rows_of = |name: &str| {
            let of = |line: &&str| line.starts_with(name) && line.contains("access");
            table.output.lines().filter(of).count()
        };
        let expected = [0, usize::from(by_hand), 1];
        let rows = ["cheapest", "own", "unitary"].map(rows_of);
        require(rows == expected, &table, || format!("{format}: {rows:?}"))?;
        let list = job(&["--optimise"]).succeed()?;
        let lines: Vec<&str> = list.output.lines().collect();
        require(lines[1].starts_with("one mode, S = 0"), &list, || lines[1].to_owned())?;
        let twice = list.output.contains("unitary scheme, no p");
        require(!twice, &list, || "the unitary scheme twice".to_owned())?;
        let end = lines.iter().position(|line| line.starts_with("calls:")).unwrap_or(0);
        let bare = lines[1..end].iter().any(|line| {
            let words: Vec<&str> = line.split_whitespace().collect();
            // Its last columns are empty, or the row is wrapped.
            words.len() > 3 && words[words.len() - 3..] == ["-"; 3] || words.len() < 3
        });
        require(!bare, &list, || "a choice without numbers, or a broken row".to_owned())?;
        if !by_hand {
            let summary = run(name).set(settings).set(more).summary()?;
            let found = &summary.value["probabilities"];
            let all = &found["at_slice"]["all"];
            let one = found["points"] == 1 && all["value"] == 1.0 && all["label"] == "exact";
            summary.require(one, || format!("{found}"))?;
        }
        Ok(())
    });
}

/// The table of costs as CSV has the numbers of the JSON, with all digits and with their labels. In
/// LaTeX it has the same number of rows.
#[test]
fn tables_of_costs_have_the_numbers_of_the_json() {
    let read = |more: &[&str], format: &str| {
        let job = Job::new(["resources", &case("example1.toml"), "--format", format]);
        job.set(&["axis.0.x.cells=16", "axis.0.v.cells=16"]).with(more.iter().copied()).succeed()
    };
    let record = read(&[], "json").unwrap().json().unwrap();
    let costs = |set_up: &Value| set_up["costs"].as_array().cloned().unwrap_or_default();
    let all: Vec<Value> =
        [&record, &record["own"], &record["unitary"]].into_iter().flat_map(costs).collect();
    let lines = csv_records(&read(&[], "csv").unwrap().output);
    assert!(all.len() >= 4 && lines.len() == all.len() + 1, "{lines:?}");
    let column = |name: &str| lines[0].iter().position(|n| n == name).expect("a column");
    for (line, cost) in lines[1..].iter().zip(&all) {
        for name in ["alpha", "steps", "toffoli", "t", "rotations", "qubits"] {
            assert_eq!(line[column(name)].parse().ok(), cost[name]["value"].as_f64(), "{name}");
            assert_eq!(line[column(&format!("{name}_label"))], cost[name]["label"], "{name}");
        }
        // The Toffoli gates are those of one sequence, the sum of all gates that of the cheaper
        // one.
        let number = |name: &str| line[column(name)].parse::<f64>().expect("a number");
        let half = &cost["half_calls"];
        let of = |sequence: &Value, key: &str, k: usize| sequence[key][k]["value"].as_f64();
        let cheaper = [cost, half].map(|s| {
            let both = [0, 1].map(|k| of(s, "gates_until_measured", k).unwrap_or(f64::INFINITY));
            (both[0].min(both[1]), both)
        });
        let [whole, halved] = cheaper;
        let (least, both) = if halved.0 < whole.0 { halved } else { whole };
        for (k, way) in ["repeated", "amplified"].into_iter().enumerate() {
            let toffoli = number(&format!("toffoli_until_measured_{way}"));
            for name in ["toffoli_until_measured", "until_measured"] {
                assert_eq!(Some(toffoli), of(cost, name, k), "{name}");
            }
            assert_eq!(number(&format!("until_measured_{way}")), both[k]);
        }
        assert_eq!(number("gates_until_measured"), least);
        // By the sequence whose rotations are computed.
        assert_eq!(number("gates_until_measured_2k"), whole.0);
        assert_eq!(cost["gates_until_measured_2k"]["value"].as_f64(), Some(whole.0));
        assert_eq!(Some(number("half_calls_qubits")), half["qubits"]["value"].as_f64());
        // Sparse access alone calls oracles, six times a step.
        let is_sparse = cost["access"] == "sparse";
        has_queries(&lines[0], line, cost);
        assert_eq!(line[column("queries")].is_empty(), !is_sparse, "{line:?}");
        assert_eq!(is_sparse, cost["queries"].is_object(), "{cost}");
        assert!(!is_sparse || number("queries") == 6.0 * number("steps"), "{line:?}");
    }
    // The set-up at the top of the JSON has the queries of its row of sparse access.
    for (line, record) in
        lines[1..].iter().filter(|line| line[1] == "sparse access").zip([&record, &record["own"]])
    {
        has_queries(&lines[0], line, record);
    }
    // Columns of wide numbers do not run together.
    let text = read(&["--t-of-rotation", "1e6,4"], "text").unwrap().output;
    let mut table = text.lines().skip_while(|line| !line.contains("alpha"));
    let columns = |line: &str| line.split("  ").filter(|cell| !cell.trim().is_empty()).count();
    let header = table.next().map(columns).expect("a header");
    let rows: Vec<&str> = table.take_while(|line| line.contains(", ")).take(all.len()).collect();
    assert!(rows.iter().any(|row| row.contains("e1")), "{rows:?}");
    assert!(rows.len() == all.len() && rows.iter().all(|row| columns(row) == header + 1), "{text}");
    let table = read(&[], "latex").unwrap().output;
    let rows = table.lines().filter(|line| line.ends_with("\\\\")).count();
    assert_eq!(rows, lines.len(), "{table}");
    let choices = read(&["--optimise"], "json").unwrap().json().unwrap();
    let lines = csv_records(&read(&["--optimise"], "csv").unwrap().output);
    assert_eq!(lines.len(), choices.as_array().map_or(0, Vec::len) + 1);
    // Columns with the same names have the same meaning there.
    let column = |name: &str| lines[0].iter().position(|n| n == name).expect("a column");
    for (line, choice) in lines[1..].iter().zip(choices.as_array().into_iter().flatten()) {
        let cheaper = if choice["half_calls"] == true { "half_calls_steps" } else { "steps" };
        assert_eq!(choice["walk_steps"]["value"], choice[cheaper]["value"], "{choice}");
        for (name, figure) in [
            ("steps", &choice["steps"]),
            ("half_calls_steps", &choice["half_calls_steps"]),
            ("until_measured_repeated", &choice["cost"][0]),
            ("until_measured_amplified", &choice["cost"][1]),
            ("gates_until_measured_2k", &choice["gates_until_measured_2k"]),
        ] {
            assert_eq!(line[column(name)].parse().ok(), figure["value"].as_f64(), "{name}");
        }
        has_queries(&lines[0], line, choice);
        assert!(choice["points"]["value"].is_null() || choice["queries"]["value"].is_number());
    }
    // The list contains the unitary scheme once, with the lowest of its costs.
    let unitary = choices.as_array().into_iter().flatten();
    let unitary: Vec<&Value> = unitary.filter(|choice| choice["unitary_scheme"] == true).collect();
    let gates = |cost: &Value, sequence: fn(&Value) -> &Value| {
        sequence(cost)["gates_until_measured"][0]["value"].as_f64().unwrap_or(f64::INFINITY)
    };
    let least = costs(&record["unitary"]).iter().fold(f64::INFINITY, |least, cost| {
        least.min(gates(cost, |cost| cost)).min(gates(cost, |cost| &cost["half_calls"]))
    });
    assert!(unitary.len() == 1 && unitary[0]["cost"][0]["value"] == least, "{unitary:?} {least}");
    read(&["--optimise"], "azure").unwrap_err();
}

/// Checks that the queries of a row of CSV are those of the JSON `found`.
fn has_queries(header: &[String], line: &[String], found: &Value) {
    let column = |name: &str| header.iter().position(|n| n == name).expect("a column");
    let both = &found["queries_until_measured"];
    for (name, figure) in [
        ("location_queries", &found["location_queries"]),
        ("value_queries", &found["value_queries"]),
        ("queries", &found["queries"]),
        ("queries_until_measured_repeated", &both[0]),
        ("queries_until_measured_amplified", &both[1]),
    ] {
        assert_eq!(line[column(name)].parse().ok(), figure["value"].as_f64(), "{name}");
    }
}

/// A density behind the step.
const DENSITY: &[&str] = &[
    "scheme.degree=0",
    "axis.0.x.cells=128",
    "axis.0.v.cells=128",
    "initial.f='exp(-((x + 0.5)^2 + (v - 0.6)^2)/0.02)'",
    "readout={points=[[0.2]],accuracy=0.1}",
];

/// The value of a number of the JSON.
fn value(figure: &Value) -> f64 {
    figure["value"].as_f64().unwrap()
}

/// The cost of a density with a required accuracy: the orders are as documented, the numbers follow
/// from each other, and the density is plausible.
#[test]
fn the_cost_of_a_density_is_consistent() {
    let found = end_to_end("smooth-beams.toml", "0.05", DENSITY);
    let ways = found["quantum"].as_array().unwrap();
    let [upwind, unitary, traced] = [0, 1, 2].map(|k| &ways[k]);
    for way in [upwind, unitary] {
        grid_follows_from_errors(way);
        cost_follows_from_gates(way);
    }
    // The state of the upwind scheme has a profile and a register for p, which is read at a point.
    assert!(upwind["profile"].is_object() && unitary["profile"].is_null(), "{upwind}");
    assert!(value(&upwind["points"]) > 1.0 && value(&unitary["points"]) == 1.0);
    assert!(value(&upwind["recovery"]) >= 0.0);
    // Cells have a lower order than elements.
    assert!(upwind["degrees"][0]["order"].as_f64() < Some(1.0));
    assert!(unitary["degrees"][0]["order"].as_f64() > Some(1.5));
    assert_eq!(value(&unitary["probability"]), 1.0);
    assert!(value(&upwind["probability"]) < 0.6);
    let gates = |way: &Value| value(&way["gates_until_measured"]);
    assert!(gates(upwind) > 10.0 * gates(unitary));
    assert_eq!(traced["gates_until_measured"]["label"], "model");
    // Particles from (-0.5, 0.6) reach 0.2 behind the step, with v = √(0.36 + 0.4).
    let density = found["density"].as_f64().unwrap();
    assert!(density > 0.02 && density < 0.3, "{density}");
    let verdict = found["verdict"].as_array().unwrap();
    assert!(verdict.iter().any(|line| line.as_str().unwrap_or_default().contains("does not win")));
}

/// Checks that the grid of a way is the one its errors require, and its degree the one with the
/// fewest gates.
fn grid_follows_from_errors(way: &Value) {
    let errors: Vec<f64> =
        way["errors"].as_array().unwrap().iter().filter_map(Value::as_f64).collect();
    let grids = way["grids"].as_array().unwrap();
    assert_eq!((errors.len(), grids.len()), (3, 4));
    assert!(errors[2] < errors[1] && errors[1] < errors[0], "{errors:?}");
    // The grid is between two grids whose errors are known, or extrapolated by the order.
    let sizes: Vec<f64> = grids.iter().filter_map(|grid| grid[0].as_f64()).collect();
    match errors.iter().rposition(|&error| error > 0.025) {
        Some(2) => {
            let order = way["order"].as_f64().unwrap();
            let finer = sizes[2] * (errors[2] / 0.025f64).powf(1.0 / order);
            assert!((sizes[3] / finer - 1.0).abs() < 0.1, "{sizes:?} {finer}");
        }
        Some(k) => assert!(sizes[k] <= sizes[3] && sizes[3] <= sizes[k + 1] + 1.0),
        None => assert!(sizes[3] <= sizes[0]),
    }
    // The degree is the one with the fewest gates of all that were tried.
    let degrees = way["degrees"].as_array().unwrap();
    assert_eq!(degrees.len(), 5);
    let gates = |degree: &Value| degree["gates"]["value"].as_f64().unwrap_or(f64::INFINITY);
    let least = degrees.iter().map(gates).fold(f64::INFINITY, f64::min);
    assert_eq!(least, value(&way["gates_until_measured"]));
    assert_eq!(gates(&degrees[way["degree"].as_u64().unwrap() as usize]), least);
}

/// Checks the labels of the cost of a way, and that its gates, qubits and seconds follow from it.
fn cost_follows_from_gates(way: &Value) {
    // The grid is an estimate, and so are numbers that depend on it.
    let cost = &way["cost"];
    let label = if cost["access"] == "sparse" { "model" } else { "estimate" };
    assert_eq!(cost["toffoli_a_step"]["label"], label);
    for key in ["alpha", "tau", "steps"] {
        assert_eq!(cost[key]["label"], "estimate", "{key}");
    }
    assert!(value(&way["tolerance"]) < 0.05 && value(&way["walk_tolerance"]) < 0.05);
    // The sequence with fewer gates counts, including T gates and rotations.
    let gates = value(&cost["gates"]).min(value(&cost["half_calls"]["gates"]));
    let all = gates * value(&way["evolutions"]);
    assert!((value(&way["gates_until_measured"]) / all - 1.0).abs() < 1e-9);
    assert_eq!(way["toffoli"], cost["toffoli"]);
    assert_eq!(way["physical_qubits"]["label"], "model");
    assert!(value(&way["physical_qubits"]) > 100.0 * value(&cost["qubits"]));
    // The seconds follow from the code distance.
    let d = way["code_distance"].as_f64().unwrap();
    let seconds = all * 5.5 * d / 4.0 * 1e-6;
    assert!((value(&way["seconds"]) / seconds - 1.0).abs() < 1e-9);
}

/// Checks that a table of the cost of a density, in CSV, has the numbers of the JSON, with their
/// labels.
fn table_has_the_numbers_of_the_json(table: &str, found: &Value) {
    let ways = found["quantum"].as_array().unwrap();
    let baselines = found["classical"].as_array().unwrap();
    let lines = csv_records(table);
    let names = ways.iter().chain(baselines).map(|way| way["name"].as_str().unwrap());
    assert!(lines[1..].iter().map(|line| line[0].as_str()).eq(names), "{lines:?}");
    let column = |name: &str| lines[0].iter().position(|n| n == name).expect("a column");
    for (line, way) in lines[1..3].iter().zip(ways) {
        for (name, figure) in [
            ("alpha", &way["cost"]["alpha"]),
            ("steps", &way["cost"]["steps"]),
            ("toffoli_a_step", &way["cost"]["toffoli_a_step"]),
            ("qubits", &way["cost"]["qubits"]),
            ("toffoli", &way["cost"]["toffoli"]),
            ("gates_until_measured", &way["gates_until_measured"]),
            ("gates_until_measured_2k", &way["cost"]["gates_until_measured_2k"]),
            ("seconds", &way["seconds"]),
        ] {
            assert_eq!(line[column(name)].parse().ok(), figure["value"].as_f64(), "{name}");
        }
    }
    // Numbers without a label of their own in the JSON have one here: by way, then by method.
    let of_grid = [true, true, false, false, false, false, false];
    let extrapolated = ["", "", "", "model", "model", "exact", "exact"];
    for (k, line) in lines[1..].iter().enumerate() {
        for (name, expected) in [
            ("grid", if of_grid[k] { "estimate" } else { "unavailable" }),
            ("order", if of_grid[k] { "estimate" } else { "unavailable" }),
            ("code_distance", if k < 3 { "model" } else { "unavailable" }),
            ("cells_or_traces", if k < 3 { "unavailable" } else { extrapolated[k] }),
        ] {
            let label = &line[column(&format!("{name}_label"))];
            assert_eq!(label, expected, "{name}: {line:?}");
            assert_eq!(line[column(name)].is_empty(), label == "unavailable", "{name}: {line:?}");
        }
    }
    assert!(lines[1][column("profile")].contains(' '), "{lines:?}");
}

#[test]
fn costs_of_what_is_no_density_are_refused() {
    let job = |name: &str| Job::new(["resources", &case(name), "--accuracy", "0.1"]);
    job("example2.toml").is_refused(&["is not linear", "initial = { f = \"(", "exp("]).unwrap();
    // An error relative to a density of almost zero is refused.
    let nowhere = ["readout={points=[[-1.4]],accuracy=0.1}"];
    let job_there = job("smooth-beams.toml").set(&DENSITY[..4]).set(&nowhere).on(2);
    job_there.is_refused(&["of the mean", "[readout]"]).unwrap();
    job("example1.toml").with(["--format", "qref"]).is_refused(&["--accuracy", "qref"]).unwrap();
    job("example1.toml").with(["--optimise"]).is_refused(&["--optimise"]).unwrap();
}

/// Where `V` jumps within cells, all grids have it at the same place of one, and every method has a
/// number. A method whose errors do not fall has none, but the reason, and the others keep theirs.
#[test]
fn walls_within_cells_and_a_method_without_a_number() {
    let read = |cells: [usize; 2], format: &str| {
        let [x, v] = cells.map(|n| n.to_string());
        let settings = [format!("axis.0.x.cells={x}"), format!("axis.0.v.cells={v}")];
        let settings = settings.each_ref().map(String::as_str);
        let job = Job::new(["resources", &case("example1.toml"), "--accuracy", "0.2"]);
        let job = job.set(&settings).set(&["scheme.degree=0"]).with(["--format", format]);
        job.succeed().unwrap()
    };
    let method = |found: &Value, name: &str| {
        let all = ["quantum", "classical"].map(|kind| found[kind].as_array().unwrap().clone());
        all.concat().into_iter().find(|way| way["name"] == name).expect("a method")
    };
    let known = |figure: &Value| figure["value"].as_f64().is_some_and(f64::is_finite);
    // The step at x = 0 is in the middle of a cell: of all grids with an odd number of them.
    let found = read([33, 32], "json").json().unwrap();
    for name in ["Schrödingerization, dissipative", "one mode, unitary"] {
        let way = method(&found, name);
        assert!(known(&way["gates_until_measured"]), "{way}");
        let of_cells = way["degree"] == 0;
        let grids = way["grids"].as_array().unwrap();
        let cells: Vec<u64> = grids.iter().filter_map(|grid| grid[0].as_u64()).collect();
        assert_eq!(cells.len(), 4, "{way}");
        assert!(!of_cells || cells.iter().all(|n| n % 2 == 1), "{name}: {cells:?}");
        let errors = way["errors"].as_array().unwrap();
        let errors: Vec<f64> = errors.iter().filter_map(Value::as_f64).collect();
        assert!(errors[2] < errors[1] && errors[1] < errors[0], "{errors:?}");
    }
    table_has_the_numbers_of_the_json(&read([33, 32], "csv").output, &found);
    let stepped = method(&found, "time stepping, van Leer");
    assert!(known(&stepped["seconds"]) && stepped["size"].as_f64() > Some(0.0), "{stepped}");
    // Slopes on too few velocities: one grid is worse than a coarser one.
    let found = read([11, 4], "json").json().unwrap();
    let stepped = method(&found, "time stepping, van Leer");
    let why = stepped["seconds"]["because"].as_str().unwrap_or_default();
    assert_eq!(stepped["seconds"]["label"], "unavailable");
    assert!(stepped["size"].is_null() && stepped["seconds"]["value"].is_null(), "{stepped}");
    assert!(why.contains("do not fall with the grid") && why.contains("on 11 x 4"), "{why}");
    for name in ["time stepping, exponential", "quadrature over characteristics"] {
        let other = method(&found, name);
        assert!(known(&other["seconds"]), "{other}");
    }
    // Without any circuit there is no table of them.
    let text = read([4, 4], "text").output;
    assert!(text.contains("CLASSICAL") && !text.contains("Toffoli  rot."), "{text}");
    assert!(!text.contains("2K steps") && !text.contains("\n\n\n"), "{text}");
    let text = read([11, 4], "text").output;
    let line = text.lines().find(|line| line.contains("van Leer")).unwrap_or_default();
    assert!(line.contains("unavailable") && !line.contains(" 0 "), "{line}");
    let lines = csv_records(&read([11, 4], "csv").output);
    let column = lines[0].iter().position(|name| name == "seconds").expect("a column");
    let row = lines.iter().find(|line| line[0] == "time stepping, van Leer").expect("a row");
    assert_eq!([&row[column], &row[column + 1]], ["", "unavailable"]);
}

/// Checks that the numbers of a record follow from each other.
fn consistent(record: &Value) -> Result<(), String> {
    let value = |key: &str| number(&record[key]["value"]);
    // If the tolerance is an estimate, the steps that follow from it are estimates.
    let trust = &record["walk_tolerance"]["label"];
    let rough = trust == "estimate";
    for key in ["degree", "walk_steps", "queries", "value_bits"] {
        if rough && record[key]["label"] != "estimate" {
            return Err(format!("{key} of a tolerance that is an {trust}: {}", record[key]));
        }
    }
    let time = number(&record["time"]);
    let tau = value("nonzeros") * value("largest_entry") * time;
    // Two calls of the location oracle and four of the value oracle a step.
    let holds = (value("tau") / tau - 1.0).abs() < 1e-12
        && value("walk_steps") == 2.0 * value("degree")
        && value("degree") > tau
        && value("location_queries") == 2.0 * value("walk_steps")
        && value("value_queries") == 4.0 * value("walk_steps")
        && value("queries") == 6.0 * value("walk_steps")
        && least_cost(record)["access"].is_string() | least_cost(record)["access"].is_object();
    if !holds {
        return Err("queries that do not follow from the steps".to_owned());
    }
    // A cost is the product of the steps of the series, the gates of a step, and the evolutions.
    let evolutions = |key: &str| {
        let found = &record["probabilities"];
        let chain = if found["window"].is_null() { "at_slice" } else { "in_window" };
        number(&found[chain][key]["value"])
    };
    // Sparse access has one row in the table, with the numbers of the record.
    let rows = record["costs"].as_array().into_iter().flatten();
    let sparse = rows
        .filter(|cost| cost["access"] == "sparse")
        .map(|cost| cost["tau"] == record["tau"] && cost["steps"] == record["walk_steps"]);
    if !sparse.eq([true]) {
        return Err("contradictory numbers of sparse access".to_owned());
    }
    for cost in record["costs"].as_array().into_iter().flatten() {
        let of = |key: &str| number(&cost[key]["value"]);
        let all = of("steps") * of("toffoli_a_step");
        let measured = |k: usize| number(&cost["toffoli_until_measured"][k]["value"]);
        let follows = (of("tau") / (of("alpha") * time) - 1.0).abs() < 1e-12
            && of("steps") > 2.0 * of("tau")
            && (of("toffoli") / all - 1.0).abs() < 1e-12
            && (measured(0) / (all * evolutions("repetitions")) - 1.0).abs() < 1e-9
            && (measured(1) / (all * evolutions("amplified_evolutions")) - 1.0).abs() < 1e-9;
        let emitted = cost["access"] != "sparse";
        let label = if emitted { "emitted" } else { "model" };
        let labels = [&cost["steps"], &cost["toffoli"], &cost["rotations"]];
        let exact = labels.iter().any(|n| ["exact", "emitted"].iter().any(|w| n["label"] == *w));
        if !follows || cost["toffoli_a_step"]["label"] != label || (rough && exact) {
            return Err(format!("a cost that does not follow: {cost}"));
        }
        all_gates(cost, [evolutions("repetitions"), evolutions("amplified_evolutions")])?;
    }
    // The number of bits of the real and of the imaginary part is about log₂ τ + log₂ 1/ε.
    let (bits, fine) = (value("value_bits"), value("walk_tolerance"));
    let least = (tau / fine).log2();
    let walk = &record["qubits"]["walk"];
    let system = number(&record["qubits"]["total"]);
    if bits < least || bits > least + 4.0 || walk["value"].as_f64() != Some(2.0 * bits) {
        return Err(format!("{bits} bits for log2(tau/eps) = {least}"));
    }
    if walk["row_and_column"].as_f64() != Some(2.0 * (system + 2.0)) {
        return Err("no qubits for dummies and flags".to_owned());
    }
    let shares = ["in_p", "field_given_p", "weights_given_field", "all"];
    let chain = &record["probabilities"]["at_slice"];
    let p: Vec<f64> = shares.iter().map(|k| number(&chain[*k]["value"])).collect();
    let product = (p[0] * p[1] * p[2] / p[3] - 1.0).abs() < 1e-12;
    if product && p.iter().all(|p| (0.0..=1.0 + 1e-12).contains(p)) {
        Ok(())
    } else {
        Err("invalid probabilities".to_owned())
    }
}

/// Checks the number of all gates, in which a model converts T gates and rotations to Toffoli
/// gates, for both sequences. `evolutions` are those until the field is measured.
fn all_gates(cost: &Value, evolutions: [f64; 2]) -> Result<(), String> {
    let tau = number(&cost["tau"]["value"]);
    let half = &cost["half_calls"];
    for sequence in [cost, half] {
        let of = |key: &str| number(&sequence[key]["value"]);
        let t = if cost["access"] == "sparse" { 0.0 } else { of("t") };
        let gates = of("toffoli") + (t + of("rotations") * of("t_a_rotation")) / 4.0;
        let measured = |k: usize| sequence["gates_until_measured"][k]["value"].as_f64();
        let times = |k: usize| measured(k).unwrap_or(f64::NAN) / (gates * evolutions[k]);
        // A rotation takes at least 3 log₂(4 · rotations) + 4 T gates.
        let least = 3.0 * (4.0 * of("rotations")).log2() + 4.0;
        let follows = (of("gates") / gates - 1.0).abs() < 1e-12
            && [0, 1].iter().all(|&k| (times(k) - 1.0).abs() < 1e-9)
            && of("t_a_rotation") >= least
            && of("rotations") >= of("rotations_a_step") * (of("steps") - 2.0);
        if !follows || sequence["gates"]["label"] != "model" {
            return Err(format!("gates that do not follow: {sequence}"));
        }
    }
    let steps = |of: &Value| number(&of["steps"]["value"]);
    let way_back = steps(half) - 2.0;
    let half_as_many = way_back % 2.0 == 1.0
        && way_back >= tau
        && 2.0 * way_back >= steps(cost)
        && way_back <= (0.5 * steps(cost)).max(tau.ceil()) + 1.0;
    if half_as_many && half["steps"]["label"] == "model" {
        Ok(())
    } else {
        Err(format!("not half as many calls: {cost}"))
    }
}

/// The planner compares both ways to implement the weights of modes and names the cheaper one. If
/// rotations cost nothing, it names rotations.
#[test]
fn weights_of_modes_are_compared() {
    let grid = ["axis.0.x.cells=16", "axis.0.v.cells=16", "solver.tolerance=1e-2"];
    let read = |t: &str| {
        let job = Job::new(["resources", &case("example1.toml"), "--format", "json"]).set(&grid);
        job.with(["--t-of-rotation", t]).succeed().unwrap().json().unwrap()
    };
    let [usual, free] = [read("3,4"), read("0,0")];
    for (record, cheaper) in [(&usual, "sum"), (&free, "rotations")] {
        let weights = &record["mode_weights"];
        assert_eq!(weights["cheaper"], cheaper, "{weights}");
        let value = |key: &str| weights[key]["value"].as_f64().unwrap();
        assert_eq!(value("rotations") < value("sum"), cheaper == "rotations", "{weights}");
        // With rotations, α is that of the highest mode, about half of that of the sum.
        let alpha = |access: &str| {
            let costs = record["costs"].as_array().unwrap();
            let cost = costs.iter().find(|cost| cost["access"][access] == "uniform").unwrap();
            cost["alpha"]["value"].as_f64().unwrap()
        };
        let ratio = alpha("rotated") / alpha("circuit");
        assert!(ratio > 0.4 && ratio < 1.0, "{ratio}");
    }
    // Azure's counts have the same T gates of rotations: those of the option.
    for (t, none) in [("3,4", false), ("0,0", true)] {
        let job = Job::new(["resources", &case("example1.toml"), "--format", "azure"]).set(&grid);
        let azure = job.with(["--t-of-rotation", t]).succeed().unwrap().json().unwrap();
        let count = |counts: &str| azure[counts]["tCount"].as_f64().unwrap();
        assert_eq!(azure["tOfRotations"] == 0, none, "{azure}");
        assert_eq!(count("synthesizedCounts") == count("logicalCounts"), none, "{azure}");
    }
    let job = of_case("resources", "example1.toml").set(&grid);
    let text = job.succeed().unwrap();
    text.contains(&text.output, &["by rotations of each mode", "cheaper: sum"]).unwrap();
    for wrong in ["3", "3,x", "-1,4", "nan,4", "1,2,3"] {
        let job = Job::new(["resources", &case("example1.toml"), "--t-of-rotation", wrong]);
        job.is_refused(&["two numbers"]).unwrap();
    }
}

/// Checks the bounds on the nonzeros of `H`: that of the paper, in one and two dimensions only, and
/// ours.
fn bounds_of_sparsity(record: &Value) -> Result<(), String> {
    let sparsity = &record["sparsity"];
    let of_hamiltonian = sparsity["counts"].as_array().and_then(|c| c.last());
    let stated = of_hamiltonian.map_or(&Value::Null, |count| &count["rows"]["bound"]);
    let ours = &sparsity["our_bound"];
    if sparsity["bounded"] != true {
        return if stated.is_null() && ours.is_null() {
            Ok(())
        } else {
            Err("a bound that does not apply to this case".to_owned())
        };
    }
    let q: Vec<u64> =
        sparsity["q"].as_array().into_iter().flatten().filter_map(Value::as_u64).collect();
    let (n, sum) = (q.len() as u64, q.iter().sum::<u64>());
    let expected = [Some(sum + 5), Some(sum + 7), None][q.len() - 1];
    if stated.as_u64() == expected && ours.as_u64() == Some(sum + 3 * n + 2) {
        Ok(())
    } else {
        Err(format!("bounds {stated} and {ours} for Q = {q:?}"))
    }
}

/// `τ` counts the modes that a run propagates, with the entries of `μS + iK` of the exported
/// matrices at the highest of these modes. The register has more modes, whose coefficients are
/// zero.
#[test]
fn tau_counts_modes_with_nonzero_coefficients() {
    let grid = ["axis.0.x.cells=8", "axis.0.v.cells=8", "solver.tolerance=1e-3"];
    let profile = "solver.warp.profile=smooth";
    let place = directory();
    let of_run = run("example1.toml").set(&grid).set(&[profile]).solve(place.path()).unwrap();
    let files = directory();
    let path = files.path().display().to_string();
    let job = Job::new(["export-matrix", &case("example1.toml"), "-o", &path]).set(&grid);
    job.succeed().unwrap();
    let entries = |name: &str| -> Vec<(String, f64)> {
        let text = text_of(files.path().join(name)).unwrap();
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
    // The register has more modes.
    let register = own["points"].as_f64().unwrap();
    assert!(register > 2.0 * modes + 1.0, "{register} {modes}");
}

/// The probabilities of the slice and of the window, and the norm of the field that follows from
/// them, agree with the whole warped field of a full run.
#[test]
fn probabilities_agree_with_the_warped_field() {
    // Without weights and inflow, the file holds the quantum state.
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
    // The recovery point is not a point of the file; the next point is used.
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

/// The JSON of a case from end to end, on one rank.
fn end_to_end(name: &str, accuracy: &str, settings: &[&str]) -> Value {
    let job = Job::new(["resources", &case(name), "--accuracy", accuracy, "--format", "json"]);
    job.set(settings).succeed().unwrap().json().unwrap()
}

/// The method of this name of such a JSON.
fn method_of<'a>(found: &'a Value, name: &str) -> &'a Value {
    let all = ["quantum", "classical"].iter().flat_map(|kind| found[kind].as_array().unwrap());
    let mut named = all.filter(|way| way["name"] == name);
    named.next().unwrap_or_else(|| panic!("{name}: {found}"))
}

/// Where `V` reflects in part, the density is that of the exact formula, and ways that trace
/// characteristics have no number but the reason.
#[test]
fn characteristics_that_branch_are_not_traced() {
    let settings = ["readout={points=[[-0.4]],accuracy=0.1}"];
    let found = end_to_end("partial_reflection.toml", "0.3", &settings);
    // ∫ R(v) f₀(−x + vt, −v) dv over v < 0, and what was not reflected yet; by hand 6.93e-4.
    let density = found["density"].as_f64().unwrap();
    assert!((density / 6.93e-4 - 1.0).abs() < 0.02, "{density:e}");
    for name in ["reversible characteristics", "quadrature over characteristics"] {
        let seconds = &method_of(&found, name)["seconds"];
        assert_eq!(seconds["label"], "unavailable", "{name}");
        assert!(seconds["because"].as_str().unwrap().contains("branch"), "{seconds}");
    }
    let verdict = found["verdict"].to_string();
    assert!(!verdict.contains("characteristics") && verdict.contains("time stepping"), "{verdict}");
}

/// Quadrature reaches the accuracy that it claims where `f` jumps along `v`, and Monte Carlo that
/// takes too many traces says that its seconds are extrapolated.
#[test]
fn a_density_has_the_accuracy_that_was_asked_for() {
    let settings = ["axis.0.x.cells=8", "axis.0.v.cells=8"];
    let found = end_to_end("example1.toml", "1e-4", &settings);
    // f(0) is 1 on a union of sectors: f(1) is 1 on three intervals of v.
    let density = found["density"].as_f64().unwrap();
    let exact = density_behind_the_step(found["point"][0].as_f64().unwrap());
    assert!((density / exact - 1.0).abs() <= 1e-4, "{density} {exact}");
    let sampled = method_of(&found, "Monte Carlo over characteristics");
    assert_eq!(sampled["seconds"]["label"], "model");
    assert!(sampled["size"].as_f64().unwrap() > 1e7, "{sampled}");
}

/// The density of example 1 at `T = 1` a little behind the step, by hand: what never met it, was
/// reflected by it, and was transmitted.
fn density_behind_the_step(x: f64) -> f64 {
    let never = 0.5 * ((2.0 - x * x).sqrt() - x);
    let slowest = 0.4f64.sqrt();
    let reflected = slowest - x;
    // A transmitted particle had u = √(v² − 0.4), and was at −u(1 − x/v).
    let inside = |v: f64| (v * v - 0.4) * (1.0 + (1.0 - x / v).powi(2)) < 1.0;
    let [mut low, mut high] = [slowest, 1.5];
    for _ in 0..60 {
        let middle = 0.5 * (low + high);
        *(if inside(middle) { &mut low } else { &mut high }) = middle;
    }
    never + reflected + low - slowest
}

/// The legs of a trace are in the record (a unit test counts those of curved potentials), and the
/// evolutions are those of amplitude estimation without control.
#[test]
fn legs_of_a_trace_are_in_the_record() {
    let grid = ["axis.0.x.cells=32", "axis.0.v.cells=32"];
    let step = end_to_end("example1.toml", "0.1", &grid);
    assert_eq!(method_of(&step, "reversible characteristics")["legs"], 2);
    // The density is the amplitude of an outcome: its sign needs no control of the evolution.
    let evolutions = &method_of(&step, "one mode, unitary")["evolutions"]["value"];
    assert!(evolutions.as_f64().unwrap() < 2e4, "{evolutions}");
}

/// The dissipative way dissipates, also where the case's own scheme is unitary.
#[test]
fn a_unitary_case_is_compared_with_upwind() {
    let job = Job::new(["resources", &case("unitary_advection.toml"), "--accuracy", "0.1"]);
    let found = job.with(["--format", "json"]).on(2).succeed().and_then(|f| f.json()).unwrap();
    let [upwind, unitary] = ["Schrödingerization, dissipative", "one mode, unitary"]
        .map(|name| method_of(&found, name));
    assert!(upwind["profile"].is_object() && unitary["profile"].is_null(), "{upwind}");
    assert!(upwind["points"]["value"].as_f64().unwrap() > 1.0);
    assert!(upwind["probability"]["value"].as_f64().unwrap() < 1.0);
    // Slopes are limited in upwind cells only, and that is what is said.
    let seconds = &method_of(&found, "time stepping, van Leer")["seconds"];
    let why = seconds["because"].as_str().unwrap_or_default();
    assert!(seconds["label"] == "unavailable" && why.contains("scheme."), "{seconds}");
}

/// The errors of the field add up to the tolerance in the cheapest set-up, and to what is stated in
/// the case's own, whose window may be looser.
#[test]
fn the_error_budget_adds_up() {
    let job = Job::new(["resources", &case("example1.toml")]).set(&["solver.tolerance=1e-3"]);
    let text = job.succeed().unwrap().output;
    let found = job.with(["--format", "json"]).succeed().unwrap().json().unwrap();
    for record in [&found, &found["own"]] {
        let budget = &record["error_budget"];
        let of = |key: &str| budget[key]["value"].as_f64().unwrap();
        let parts = ["profile_and_window", "series", "rounding", "rotations"].map(of);
        assert!((parts.iter().sum::<f64>() - of("sum")).abs() < 1e-12, "{budget}");
        let p = &record["probabilities"];
        let chain = if p["window"].is_null() { "at_slice" } else { "in_window" };
        let root = p[chain]["all"]["value"].as_f64().unwrap().sqrt();
        let evolution = parts[1..].iter().sum::<f64>() * 1e-3 * root;
        let walk = record["walk_tolerance"]["value"].as_f64().unwrap();
        assert!((walk / evolution - 1.0).abs() < 1e-9, "{walk} {evolution}");
        assert!(text.contains("error of the field"), "{text}");
    }
    let sum = |record: &Value| record["error_budget"]["sum"]["value"].as_f64().unwrap();
    assert!(sum(&found) <= 1.0 + 1e-12 && sum(&found) > 0.5, "{}", sum(&found));
    assert!(sum(&found["own"]) >= 1.5, "{}", sum(&found["own"]));
    // One mode has no profile: the evolution has all of the tolerance.
    let settings = ["solver.tolerance=1e-3", "scheme.flux=0", "scheme.ends=closed"];
    let job = Job::new(["resources", &case("example1.toml"), "--format", "json"]);
    let one = job.set(&settings).succeed().unwrap().json().unwrap();
    assert_eq!(one["error_budget"]["profile_and_window"]["value"], 0.0);
    assert_eq!(sum(&one), 1.0);
}

/// Of `f = 0` no state can be prepared, and that is what is said; its circuit is that of any `f`.
#[test]
fn without_a_field_there_is_no_state_to_prepare() {
    let settings = ["initial.f=0", "axis.0.x.cells=8", "axis.0.v.cells=6", "exact={}"];
    let job = Job::new(["resources", &case("example1.toml"), "--format", "json"]);
    let found = job.set(&settings).set(&["scheme.interface=conservative"]).succeed().unwrap();
    let found = found.json().unwrap();
    assert!(found["no_circuit"].is_null(), "{}", found["no_circuit"]);
    let all = &found["probabilities"]["at_slice"]["all"];
    assert_eq!(all["label"], "unavailable");
    assert!(all["because"].as_str().unwrap().contains("no state to prepare"), "{all}");
    let why = found["not_compared"].as_str().unwrap();
    assert!(why.contains("no choice") && why.contains("no state to prepare"), "{why}");
    // The unitary scheme has gates of an evolution, and none until a field is measured.
    let costs = found["unitary"]["costs"].as_array().unwrap();
    assert!(costs.len() > 1, "{}", found["unitary"]);
    for cost in costs {
        assert!(cost["gates"]["value"].as_f64() > Some(0.0), "{cost}");
        for sequence in [cost, &cost["half_calls"]] {
            for gates in sequence["gates_until_measured"].as_array().unwrap() {
                assert_eq!(gates["label"], "unavailable");
                assert!(gates["because"].as_str().unwrap().contains("no state to prepare"));
            }
        }
    }
    let job = |more: &[&str]| {
        of_case("resources", "example1.toml").set(&settings).with(more.iter().copied())
    };
    let list = job(&["--optimise", "--format", "json"]).succeed().unwrap().json().unwrap();
    let choices = list.as_array().unwrap();
    assert!(choices.len() > 5 && choices.iter().any(|choice| choice["unitary_scheme"] == true));
    for choice in choices {
        let why = choice["recovery"]["because"].as_str().unwrap_or_default();
        assert!(why.contains("no state to prepare"), "{choice}");
    }
    let text = job(&["--optimise"]).succeed().unwrap().output;
    assert_eq!(text.matches("no state to prepare").count(), 1, "{text}");
    job(&["--accuracy", "0.1"]).is_refused(&["density is zero"]).unwrap();
}

/// The settings that are printed for the cheapest set-up make it the case's own, with the same
/// counts.
#[test]
fn settings_of_the_cheapest_set_up_have_its_counts() {
    let rows: [(&str, &[&str]); 4] = [
        // By a circuit, with rounded jumps; the case has a profile with another parameter.
        (
            "example1.toml",
            &[
                "axis.0.x.cells=16",
                "axis.0.v.cells=16",
                "solver.tolerance=1e-3",
                "solver.warp={profile='smooth',order=3}",
            ],
        ),
        // By sparse access alone.
        ("inflow_barrier.toml", &["axis.0.x.cells=16", "axis.0.v.cells=16"]),
        ("barrier2d.toml", &["axis.0.x.cells=4", "axis.1.x.cells=4"]),
        ("slope_jump.toml", &["axis.0.x.cells=16", "axis.0.v.cells=16", "solver.warp.shift=0.1"]),
    ];
    check_all(&rows, |(name, settings)| {
        let job = of_case("resources", name).set(settings);
        let text = job.succeed()?;
        let found = job.with(["--format", "json"]).succeed()?;
        let record = found.json()?;
        let printed = &record["cheapest_settings"];
        let set: Vec<String> = printed["set"]
            .as_array()
            .into_iter()
            .flatten()
            .filter_map(|setting| setting.as_str().map(str::to_owned))
            .collect();
        require(set.len() == 4, &found, || format!("{printed}"))?;
        let shown = set.iter().all(|setting| text.output.contains(&format!("--set \"{setting}\"")));
        require(shown, &text, || format!("{set:?}"))?;
        let rounding = &record["rounding"]["bin_bits"];
        require(printed["sub_bins"] == *rounding, &found, || format!("{printed}"))?;
        let line = format!("--sub-bins {rounding}");
        require(rounding.is_null() || text.output.contains(&line), &text, || line.clone())?;
        let set: Vec<&str> = set.iter().map(String::as_str).collect();
        let again = of_case("resources", name).set(settings).set(&set).with(["--format", "json"]);
        let again = again.succeed()?;
        let own = &again.json()?["own"];
        for key in ["points", "period", "interface", "nonzeros", "costs", "error_budget"] {
            alike(&record[key], &own[key]).map_err(|why| again.report(&format!("{key}: {why}")))?;
        }
        let probability = |record: &Value| record["probabilities"]["in_window"]["all"].clone();
        alike(&probability(&record), &probability(own)).map_err(|why| again.report(&why))?;
        // Control: the own set-up without them is another.
        match alike(&record["costs"], &record["own"]["costs"]) {
            Ok(()) => Err(found.report("the case's own set-up is the cheapest")),
            Err(_) => Ok(()),
        }
    });
}

/// Whether two values of JSON are equal, their numbers but for round-off.
fn alike(a: &Value, b: &Value) -> Result<(), String> {
    let differ = || Err(format!("{a} beside {b}"));
    match (a, b) {
        (Value::Number(_), Value::Number(_)) => {
            let [x, y] = [a, b].map(number);
            if (x - y).abs() <= 1e-9 * x.abs() { Ok(()) } else { differ() }
        }
        (Value::Array(a), Value::Array(b)) if a.len() == b.len() => {
            a.iter().zip(b).try_for_each(|(a, b)| alike(a, b))
        }
        (Value::Object(x), Value::Object(y)) if x.len() == y.len() => {
            x.iter().try_for_each(|(key, value)| alike(value, y.get(key).unwrap_or(&Value::Null)))
        }
        _ if a == b => Ok(()),
        _ => differ(),
    }
}

/// A number of qubits that is out of range is refused with the range.
#[test]
fn options_of_circuits_are_refused_with_their_ranges() {
    for (command, option, range) in
        [("export-quantum", "--complete", "0..=8"), ("export-circuit", "--sub-bins", "0..=32")]
    {
        let job = Job::new([command, &case("example1.toml"), option, "-1"]);
        job.is_refused(&["-1", option, range]).unwrap();
    }
}

/// Where no choice can be priced, or the case's own set-up takes fewer gates, the command says so.
#[test]
fn the_cheapest_set_up_is_no_silent_stand_in() {
    let decayed = ["inflow.value=0", "solver.tolerance=1e-2", "axis.0.x.cells=18"];
    let job = Job::new(["resources", &case("lens2d.toml")]).set(&decayed);
    let text = job.succeed().unwrap().output;
    assert!(text.contains("no other set-up could be priced"), "{text}");
    let found = job.with(["--format", "json"]).succeed().unwrap().json().unwrap();
    assert_eq!(found["cheapest_is_own"], "no other set-up could be priced");
    assert!(found["not_compared"].as_str().unwrap().contains("no state to prepare"), "{found}");
    // A long period takes more modes than were compared once; the own window is looser.
    let long = [
        "axis.0.x.cells=4096",
        "axis.0.v.cells=8",
        "solver.tolerance=1e-3",
        "scheme.interface=conservative",
        "output.recovery_points=1",
        "solver.warp.profile=gaussian",
        "solver.warp.sigma=0.42",
        "solver.warp.interval=[-100,20540]",
    ];
    let job = Job::new(["resources", &case("example1.toml"), "--format", "json"]).set(&long);
    let found = job.succeed().unwrap().json().unwrap();
    let of_own = found["own"]["error_budget"]["sum"]["value"].as_f64().unwrap();
    let told = found["own_not_taken"].as_str().unwrap_or_default();
    assert!(of_own > 1.0 && told.contains("tolerances"), "{told} {of_own}");
    let told = found["not_compared"].as_str().unwrap_or_default();
    assert!(told.contains("up to 131072 are compared"), "{told}");
}
