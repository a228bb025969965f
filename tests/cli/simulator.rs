//! `phasewarp export-quantum`: its files, and its circuits in Qiskit by `tests/simulator.py`.
//!
//! Without a Python with Qiskit, the second part is skipped with a message; with
//! `PHASEWARP_QISKIT=required`, which `.ci/run` sets after the installation, it fails.
//! `make qiskit` installs it.

use crate::support::{
    check_all, contents, directory, distance, json_of, of_case, python, require, skipped, text_of,
};
use std::path::Path;

const SCRIPT: &str = concat!(env!("CARGO_MANIFEST_DIR"), "/tests/simulator.py");

/// Settings of a small case in one dimension.
const TINY: &[&str] =
    &["axis.0.x.cells=4", "axis.0.v.cells=4", "time.end=0.3", "solver.tolerance=1e-3"];
/// Inflow; its auxiliary unknown takes a cell along v.
const INFLOW: &[&str] = &["inflow.value=0.3", "axis.0.v.cells=8", "time.end=0.1"];
/// The paper's profile, sampled.
const PAPER: &[&str] = &[
    "solver.warp.profile=exponential",
    "solver.warp.coefficients=sampled",
    "solver.warp.points=64",
    "solver.tolerance=0.1",
];
const SMOOTH: &[&str] =
    &["solver.warp.profile=smooth", "solver.warp.order=2", "solver.tolerance=0.05"];
const CONSERVATIVE: &[&str] = &["scheme.interface=conservative", "solver.warp.profile=gaussian"];
const UNITARY: &[&str] = &["scheme.flux=0", "scheme.ends=closed"];
const SMALL: &[&str] = &[
    "axis.0.x.cells=8", "axis.0.v.cells=8", "time.end=0.5", "solver.tolerance=1e-2",
    "solver.warp.profile=gaussian",
];
/// A recovery point p = 3 beyond the given interval.
const BEYOND: &[&str] =
    &["solver.warp.shift=6", "solver.warp.sigma=0.5", "solver.warp.interval=[-13,2.5]"];
const ELEMENTS: &[&str] = &["time.end=0.1", "solver.tolerance=1e-3"];
const PLANE: &[&str] = &[
    "axis.0.x.cells=4", "axis.0.v.cells=4", "axis.1.x.cells=2", "axis.1.v.cells=2", "time.end=0.2",
    "solver.tolerance=0.01",
];

/// Exports: a case and its settings.
const EXPORTS: &[(&str, &[&[&str]])] = &[
    ("example1.toml", &[TINY]),
    ("example1.toml", &[TINY, PAPER]),
    ("example1.toml", &[TINY, SMOOTH, &["solver.warp.weights=none", "time.end=0.1"]]),
    ("example1.toml", &[TINY, CONSERVATIVE]),
    ("example1.toml", &[TINY, INFLOW]),
    (
        "example1.toml",
        &[TINY, INFLOW, &["solver.warp.inflow=full", "solver.warp.profile=gaussian"]],
    ),
    ("example1.toml", &[TINY, INFLOW, &["solver.warp.inflow=scalar"]]),
    ("barrier2d.toml", &[PLANE]),
    (
        "smooth-beams.toml",
        &[&["axis.0.x.cells=2", "axis.0.v.cells=2", "scheme.degree=1"], ELEMENTS],
    ),
    ("partial_reflection.toml", &[TINY, &["scheme.degree=0"]]),
    // Only velocity 0, without transport.
    ("example1.toml", &[TINY, &["axis.0.x.cells=2", "axis.0.v.cells=1", "initial.f=1"]]),
    // One mode, without a register for p.
    ("example1.toml", &[TINY, UNITARY]),
];

/// Two cells on a periodic axis, at whose faces half of the particles are reflected.
const HALVES: &[&str] = &[
    "scheme.interface=conservative",
    "axis.0.x.cells=2",
    "axis.0.x.boundary=periodic",
    "axis.0.v.cells=2",
    "axis.0.v.lower=-1",
    "axis.0.v.upper=1",
    "potential.0.value=0.25",
    "time.end=0.3",
];
/// Four modes.
const FOUR: &[&str] = &[
    "solver.warp.profile=exponential",
    "solver.warp.coefficients=sampled",
    "solver.warp.points=4",
    "solver.tolerance=0.1",
];
/// A circuit of 20 qubits: 4 by 4 cells, 8 modes.
const TWENTY: &[&str] =
    &["axis.0.x.cells=4", "axis.0.v.cells=4", "solver.warp.points=8", "time.end=0.5"];
/// Initial data that are a product in x and v.
const BEAM: &[&str] = &["initial.f=1 if x < 0 && v > 0 else 0"];
/// Initial data on a set of cells that is no product.
const CORNERS: &[&str] = &["initial.f=1 if x * v < 0 || x < 0 else 0"];
/// Initial data that are neither a product nor constant on a set.
const SLOPE: &[&str] = &["initial.f=3 + x * v"];
const ONE_MODE: &[&str] = &[
    "scheme.flux=0", "scheme.ends=closed", "axis.0.x.cells=4", "time.end=1",
    "solver.tolerance=0.01",
];

/// Complete circuits: settings and the number of qubits for amplitude estimation.
const COMPLETE: &[(&[&[&str]], &str)] = &[
    (&[HALVES, FOUR, BEAM], "1"),
    (&[HALVES, FOUR, CORNERS], "0"),
    (&[HALVES, ONE_MODE, SLOPE], "1"),
    // Closed ends have a flag for the ends of the box, unlike a periodic axis.
    (&[HALVES, ONE_MODE, BEAM, &["axis.0.x.boundary=inflow"]], "0"),
    // A force instead of jumps, with weights of modes by rotations.
    (&[HALVES, FOUR, BEAM, &["axis.0.x.boundary=inflow", "potential=[{value='0.3*x'}]"]], "0"),
    // As many qubits as there may be.
    (&[HALVES, FOUR, BEAM, TWENTY], "0"),
];

/// Larger exports whose field is read, with narrow Gaussians, whose planned period is short.
const READ: &[(&str, &[&[&str]])] = &[
    ("example1.toml", &[SMALL, &["solver.warp.sigma=0.25"]]),
    ("example1.toml", &[SMALL, &["solver.warp.sigma=0.3"]]),
    ("example1.toml", &[SMALL, &["solver.warp.sigma=0.5"]]),
    ("example1.toml", &[SMALL, &["solver.warp.sigma=1"]]),
    ("example1.toml", &[SMALL, CONSERVATIVE]),
    ("example1.toml", &[SMALL, UNITARY, &["solver.warp.sigma=0.25"]]),
    ("example1.toml", &[SMALL, UNITARY, &["solver.warp.sigma=0.5"]]),
    ("example1.toml", &[SMALL, UNITARY, &["solver.warp.profile=planned"]]),
    ("example1.toml", &[SMALL, BEYOND]),
];

/// The output of the script, or its error messages if it fails.
fn simulate(python: &Path, arguments: &[&str]) -> Result<String, String> {
    python::run(python, SCRIPT, arguments)
}

#[test]
fn qiskit_finds_the_same_amplitudes() {
    let Some(python) = python::with_packages("qiskit", SCRIPT) else {
        let why =
            "no Python with qiskit, qiskit-qasm3-import and scipy; `make qiskit` installs them";
        return skipped("PHASEWARP_QISKIT", "tests/cli/simulator.rs", why);
    };
    check_all(EXPORTS, |(name, settings)| {
        let place = directory();
        let job = of_case("export-quantum", name).set(&settings.concat()).into(place.path());
        job.succeed()?;
        let path = place.path().display().to_string();
        let fails = |why: String| format!("{why}\n  command: {}", job.command());
        let printed = simulate(&python, &[&path]).map_err(fails)?;
        if !printed.contains("amplitudes within") {
            return Err(fails(printed));
        }
        // Control, for some exports: the script finds a wrong time.
        if settings.len() > 1 {
            return Ok(());
        }
        let file = place.path().join("description.json");
        let text = text_of(&file)?;
        let time = text.replace("\"time\": 0.", "\"time\": 1.");
        std::fs::write(&file, &time).map_err(|e| e.to_string())?;
        match simulate(&python, &[&path]) {
            Err(why) if why.contains("final_modes: differs") => Ok(()),
            other => Err(fails(format!("the wrong time was not found: {other:?}"))),
        }
    });
}

/// Complete circuits implement by gates the initial state, the transforms in p, the evolution, a
/// moment and its estimation.
#[test]
fn complete_circuits_find_the_field_and_a_moment() {
    let python = python::with_packages("qiskit", SCRIPT);
    check_all(COMPLETE, |(settings, estimate)| {
        let place = directory();
        let job =
            of_case("export-quantum", "example1.toml").set(&settings.concat()).into(place.path());
        job.with(["--complete", estimate]).succeed()?;
        // Without Qiskit, only the export is tested. The other test prints a message about it.
        let Some(python) = &python else { return Ok(()) };
        let path = place.path().display().to_string();
        let printed = simulate(python, &[&path])?;
        if !printed.contains("complete circuit: ") {
            return Err(printed);
        }
        let file = place.path().join("complete.json");
        let mut whole = json_of(&file)?;
        let qubits = whole["description"]["counts"]["qubits"].as_u64();
        let largest = settings.contains(&TWENTY);
        if largest != (qubits == Some(20)) {
            return Err(format!("{qubits:?} qubits"));
        }
        // The largest takes 15 s of a processor.
        if largest {
            return Ok(());
        }
        // Control: a hundredth of the bound does not hold.
        let bound = whole["description"]["bound"].as_f64().ok_or("no bound")?;
        whole["description"]["bound"] = (0.01 * bound).into();
        std::fs::write(&file, whole.to_string()).map_err(|e| e.to_string())?;
        match simulate(python, &[&path]) {
            Err(why) if why.contains("evolution: ") => Ok(()),
            other => Err(format!("a lower bound holds: {other:?}")),
        }
    });
}

/// Reads a vector in NumPy's format.
pub fn vector(path: &Path) -> Result<Vec<f64>, String> {
    let bytes = std::fs::read(path).map_err(|e| format!("{}: {e}", path.display()))?;
    let length = usize::from(u16::from_le_bytes([bytes[8], bytes[9]]));
    let (header, numbers) = bytes.split_at(10 + length);
    if !header.starts_with(b"\x93NUMPY\x01\x00") || header.len() % 64 != 0 {
        return Err(format!("{}: no NumPy header", path.display()));
    }
    let number = |b: &[u8]| f64::from_le_bytes(std::array::from_fn(|k| b[k]));
    Ok(numbers.chunks_exact(8).map(number).collect())
}

#[test]
fn the_exported_state_contains_the_field() {
    check_all(&[EXPORTS, READ].concat(), |(name, settings)| {
        let (exported, solved) = (directory(), directory());
        let settings = settings.concat();
        let job = of_case("export-quantum", name).set(&settings).into(exported.path());
        let done = job.succeed()?;
        let about = json_of(exported.path().join("description.json"))?;
        // A case of degree 0 that names no interface is exported with the conservative one.
        let law = about["interface"].as_str().ok_or("no interface")?;
        let chosen = done.output.contains("the case names none");
        require(chosen == (*name == "barrier2d.toml"), &done, || {
            format!("the interface is chosen: {chosen}")
        })?;
        require(!chosen || law == "conservative", &done, || format!("interface {law}"))?;
        // Both fields are within the tolerance of the exact one.
        let law = format!("scheme.interface={law}");
        let job = of_case("run", name).set(&settings).set(&[&law]);
        let summary = job.solve(solved.path())?;
        let field = vector(&exported.path().join("field.npy"))?;
        let expected = crate::support::field(solved.path())?;
        let apart = distance(&field, &expected);
        let tolerance = summary.number("tolerance")?;
        summary
            .require(apart <= 2.0 * tolerance, || format!("{apart:e} from the field of a run"))?;
        // The probability of the slice is that of the run, corrected for the number of points and
        // for the position of the slice.
        let number = |key: &str| about[key].as_f64().ok_or(format!("no {key}"));
        let probabilities = &summary.value["probabilities"];
        let of_run =
            |name: &str| probabilities["at_slice"][name]["value"].as_f64().ok_or("no probability");
        let points = probabilities["points"].as_f64().ok_or("no points")?;
        let moved = probabilities["recovery"].as_f64().ok_or("no recovery")? - number("recovery")?;
        let scale = points / number("qubits_p")?.exp2() * (2.0 * moved).exp();
        let expected = scale * of_run("in_p")? * of_run("field_given_p")?;
        let found = number("probability_p")? * number("probability_field_given_p")?;
        summary.require((found / expected - 1.0).abs() <= 10.0 * tolerance, || {
            format!("probability {found:e}, {expected:e} expected")
        })?;
        // All states have norm 1.
        for state in ["initial", "initial_modes", "final_modes", "final"] {
            let state = vector(&exported.path().join(format!("{state}.npy")))?;
            let norm = state.iter().map(|x| x * x).sum::<f64>().sqrt();
            summary.require((norm - 1.0).abs() < 1e-12, || format!("norm {norm}"))?;
        }
        Ok(())
    });
}

#[test]
fn exports_are_the_same_on_any_ranks() {
    let (name, settings) = ("example1.toml", [TINY, INFLOW].concat());
    let one = directory();
    of_case("export-quantum", name).set(&settings).into(one.path()).succeed().unwrap();
    let three = directory();
    of_case("export-quantum", name).set(&settings).into(three.path()).on(3).succeed().unwrap();
    let found = contents(one.path());
    assert_eq!(found.len(), 10);
    assert!(found == contents(three.path()));
    // Control: another state gives another file.
    let other = directory();
    let changed = [&settings[..], &["time.end=0.11"]].concat();
    of_case("export-quantum", name).set(&changed).into(other.path()).succeed().unwrap();
    assert!(found != contents(other.path()));
}

#[test]
fn large_cases_and_zero_states_are_refused() {
    type Row = (&'static str, &'static [&'static str], &'static [&'static str]);
    let rows: &[Row] = &[
        ("example1.toml", &["axis.0.x.cells=6"], &["6 cells along x", "power of two"]),
        ("example1.toml", &["axis.0.v.cells=12"], &["12 cells along vx", "power of two"]),
        ("example1.toml", &[], &["qubits", "at most 12"]),
        ("example1.toml", &["solver.method=classical"], &["solver.method", "schrodingerized"]),
        ("example2.toml", &[], &["measure-valued", "initial.f"]),
        ("pulsed_inflow.toml", &[], &["inflow.value", "depends on t"]),
        (
            "example1.toml",
            &[
                "axis.0.x.cells=4",
                "axis.0.v.cells=4",
                "time.end=0.3",
                "solver.tolerance=0.1",
                "solver.warp.profile=exponential",
                "solver.warp.points=48",
            ],
            &["48 points", "solver.warp.points = 64"],
        ),
    ];
    let rows: Vec<_> = rows.iter().enumerate().collect();
    check_all(&rows, |&(k, (name, settings, wording))| {
        let place = directory();
        let new = place.path().join("new");
        let ranks = if k == 0 { 2 } else { 1 };
        of_case("export-quantum", name).set(settings).into(&new).on(ranks).is_refused(wording)?;
        if new.exists() { Err(format!("{} was made", new.display())) } else { Ok(()) }
    });
}
