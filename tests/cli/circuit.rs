//! `phasewarp export-circuit`: the circuit that it writes is simulated here by independent code.
//! Its block is the matrix `H` of `export-quantum`.

use crate::support::{check_all, directory, json_of, of_case, text_of};
use num_complex::Complex64;
use serde_json::Value;
use std::collections::HashMap;
use std::f64::consts::{FRAC_1_SQRT_2, FRAC_PI_4, TAU};

/// A grid of 8 velocities with cells of 0.4, on which the step of 0.2 has 2.5 levels; a short time,
/// so that there are few modes.
const STEP: &[&str] = &[
    "scheme.interface=conservative",
    "axis.0.x.cells=4",
    "axis.0.v.lower=-1.6",
    "axis.0.v.upper=1.6",
    "axis.0.v.cells=8",
    "time.end=0.3",
];
const MODES: &[&str] = &["solver.warp.profile=gaussian", "solver.tolerance=0.1"];
/// Two walls.
const WELL: &[&str] = &["axis.0.x.lower=-1", "axis.0.x.upper=1"];
/// Six walls of 20, 40 and 60 levels; the numbers of cells are no powers of two.
const BARRIERS: &[&str] = &[
    "scheme.interface=conservative",
    "axis.0.x.cells=30",
    "axis.0.v.lower=-1",
    "axis.0.v.upper=1",
    "axis.0.v.cells=20",
    "solver.tolerance=1e-3",
];
/// The same walls with the unitary scheme.
const UNITARY_BARRIERS: &[&str] = &[
    "scheme.flux=0", "scheme.ends=closed", "axis.0.x.cells=30", "axis.0.v.lower=-1",
    "axis.0.v.upper=1", "axis.0.v.cells=20", "solver.tolerance=1e-3",
];
/// A barrier of 2 by 2 cells in a plane of 4 by 4.
const PLANE: &[&str] = &[
    "scheme.interface=conservative",
    "axis.0.x.lower=-0.8",
    "axis.0.x.upper=0.8",
    "axis.0.x.cells=4",
    "axis.1.x.lower=-0.8",
    "axis.1.x.upper=0.8",
    "axis.1.x.cells=4",
    "axis.0.v.lower=-0.8",
    "axis.0.v.upper=0.8",
    "axis.0.v.cells=4",
    "axis.1.v.lower=-0.4",
    "axis.1.v.upper=0.4",
    "axis.1.v.cells=2",
    "time.end=0.2",
];
/// A barrier of 4 by 4 cells in a plane of 12 by 10, with different numbers of velocities along the
/// axes.
const CORNERS: &[&str] = &[
    "scheme.interface=conservative",
    "axis.0.v.lower=-1.2",
    "axis.0.v.upper=1.2",
    "axis.0.v.cells=6",
    "axis.1.v.lower=-0.8",
    "axis.1.v.upper=0.8",
    "axis.1.v.cells=4",
    "solver.tolerance=1e-2",
];
/// Different numbers of cells, with one periodic axis.
const RING: &[&str] =
    &["scheme.interface=conservative", "axis.1.v.cells=6", "solver.tolerance=1e-2"];
const SPACE: &[&str] = &[
    "scheme.interface=conservative",
    "axis.1.v.cells=4",
    "axis.2.v.cells=2",
    "solver.tolerance=1e-2",
];

/// A parabola with a step of 1.25 levels: four slopes of both signs.
const PARABOLA: &[&str] = &["axis.0.x.lower=-0.75", "axis.0.x.upper=1.25"];
/// Two slopes with a jump between them.
const SLOPES: &[&str] = &["axis.0.x.lower=-1", "axis.0.x.upper=1"];
/// A potential in the plane with slopes along both axes and without jumps.
const BOWL: &[&str] = &["potential.0.where=x < 9", "potential.0.value=x^2/2 + 0.3*x*y"];
const CLOSED: &[&str] = &["scheme.flux=0", "scheme.ends=closed", "solver.tolerance=0.1"];

/// A gate of a circuit: name, angle, qubits.
struct Gate {
    name: String,
    angle: f64,
    qubits: Vec<usize>,
}

/// Reserved words of OpenQASM 3.
const RESERVED: &[&str] = &[
    "angle", "array", "barrier", "bit", "bool", "box", "break", "cal", "case", "complex", "const",
    "continue", "creg", "ctrl", "def", "default", "defcal", "delay", "duration", "durationof",
    "else", "end", "extern", "false", "float", "for", "gate", "gphase", "if", "im", "in",
    "include", "input", "int", "inv", "let", "measure", "mutable", "negctrl", "output", "pow",
    "pragma", "qreg", "qubit", "readonly", "reset", "return", "stretch", "switch", "true", "uint",
    "void", "while",
];

/// Parses a circuit in OpenQASM 3. Returns its gates and the first qubit outside of the system.
fn parse(text: &str) -> Result<(Vec<Gate>, usize), String> {
    let (mut first, mut qubits, mut system) = (HashMap::new(), 0usize, 0);
    let mut gates = Vec::new();
    for line in text.lines().filter(|line| line.ends_with(';')) {
        let wrong = || format!("not understood: {line}");
        let (head, rest) = line.trim_end_matches(';').split_once(' ').ok_or_else(wrong)?;
        if matches!(head, "OPENQASM" | "include") {
            continue;
        }
        let (name, number) = head.split_once(['(', '[']).unwrap_or((head, "0)"));
        let number = number.trim_end_matches([')', ']']);
        if name == "qubit" {
            // No parser of OpenQASM 3 accepts these words as names.
            if RESERVED.contains(&rest) {
                return Err(format!("a reserved word: {line}"));
            }
            first.insert(rest.to_owned(), qubits);
            qubits += number.parse::<usize>().map_err(|e| e.to_string())?;
            if ["warped", "velocity", "space"].iter().any(|name| rest.starts_with(name)) {
                system = qubits;
            }
            continue;
        }
        let place = |qubit: &str| {
            let (register, bit) = qubit.trim_end_matches(']').split_once('[')?;
            Some(first.get(register)? + bit.parse::<usize>().ok()?)
        };
        gates.push(Gate {
            name: name.to_owned(),
            angle: number.parse().map_err(|_| wrong())?,
            qubits: rest.split(", ").map(place).collect::<Option<_>>().ok_or_else(wrong)?,
        });
    }
    Ok((gates, system))
}

/// The column `start` of the block of a circuit.
fn column(gates: &[Gate], system: usize, start: usize) -> Result<Vec<(usize, Complex64)>, String> {
    let mut terms = vec![(start as u128, Complex64::ONE)];
    for Gate { name, angle, qubits } in gates {
        let target = 1u128 << qubits[qubits.len() - 1];
        let controls: u128 = qubits[..qubits.len() - 1].iter().map(|q| 1 << q).sum();
        let on = |state: u128| state & controls == controls;
        let one = |state: u128| on(state) && state & target != 0;
        let turns = Complex64::cis(0.5 * angle);
        let phases = match name.as_str() {
            "z" | "cz" => [Complex64::ONE, -Complex64::ONE],
            "s" => [Complex64::ONE, Complex64::I],
            "sdg" => [Complex64::ONE, -Complex64::I],
            "t" => [Complex64::ONE, Complex64::cis(FRAC_PI_4)],
            "tdg" => [Complex64::ONE, Complex64::cis(-FRAC_PI_4)],
            "rz" => [turns.conj(), turns],
            _ => [Complex64::ONE; 2],
        };
        match name.as_str() {
            "x" | "cx" | "ccx" => {
                terms.iter_mut().filter(|t| on(t.0)).for_each(|t| t.0 ^= target);
            }
            "z" | "cz" | "s" | "sdg" | "t" | "tdg" | "rz" => {
                terms.iter_mut().for_each(|t| t.1 *= phases[usize::from(one(t.0))]);
            }
            "h" | "ry" => {
                let r = FRAC_1_SQRT_2;
                let (sin, cos) = (0.5 * angle).sin_cos();
                let matrix =
                    if name == "h" { [[r, r], [r, -r]] } else { [[cos, -sin], [sin, cos]] };
                let mut parts = Vec::with_capacity(2 * terms.len());
                for (state, amplitude) in terms.drain(..) {
                    let from = usize::from(state & target != 0);
                    parts.push((state & !target, matrix[0][from] * amplitude));
                    parts.push((state | target, matrix[1][from] * amplitude));
                }
                parts.sort_unstable_by_key(|part| part.0);
                for (state, part) in parts {
                    match terms.last_mut() {
                        Some(last) if last.0 == state => last.1 += part,
                        _ => terms.push((state, part)),
                    }
                }
                terms.retain(|term| term.1.norm() > 1e-17);
            }
            _ => return Err(format!("gate {name}")),
        }
    }
    let inside = terms.into_iter().filter(|t| t.0 >> system == 0);
    Ok(inside.map(|(state, value)| (state as usize, value)).collect())
}

/// The columns of a Hermitian matrix in Matrix Market's format.
fn hermitian(text: &str) -> Result<Vec<HashMap<usize, Complex64>>, String> {
    let mut lines = text.lines().filter(|line| !line.starts_with('%'));
    let order = lines.next().and_then(|line| line.split(' ').next()?.parse().ok());
    let mut columns = vec![HashMap::new(); order.ok_or("no order")?];
    for line in lines {
        let numbers: Option<Vec<f64>> = line.split(' ').map(|n| n.parse().ok()).collect();
        let [i, j, re, im] = numbers.ok_or(line)?[..] else {
            return Err(line.to_owned());
        };
        let (i, j, value) = (i as usize - 1, j as usize - 1, Complex64::new(re, im));
        columns[j].insert(i, value);
        columns[i].insert(j, value.conj());
    }
    Ok(columns)
}

const ROTATED: &[&str] = &["--mode-weights", "rotations", "--levels", "uniform"];
const ROTATED_BINS: &[&str] = &["--mode-weights", "rotations", "--sub-bins", "1"];

/// For each mode of the register, whether the circuit has its own wavenumber: with a sum all modes,
/// with rotations those with nonzero coefficients.
fn carried(modes: &Value) -> Result<Vec<bool>, String> {
    let (kind, about) = match (&modes["Register"], &modes["Rotated"]) {
        (Value::Null, Value::Null) => return Ok(vec![true]),
        (Value::Null, about) => ("rotations", about),
        (about, _) => ("sum", about),
    };
    let number = |key: &str| about[key].as_f64().ok_or(format!("no {key}: {modes}"));
    let (points, period) = (number("qubits")?.exp2(), number("period")?);
    let highest = if kind == "sum" { f64::INFINITY } else { number("highest")? };
    let wavenumber = |l: i32| TAU * (f64::from(l) - 0.5 * points) / period;
    let carried: Vec<bool> =
        (0..points as i32).map(|l| wavenumber(l).abs() <= highest * (1.0 + 1e-12)).collect();
    // More than half of them.
    if 2 * carried.iter().filter(|&&is| is).count() > carried.len() {
        Ok(carried)
    } else {
        Err(format!("too few modes have nonzero coefficients: {modes}"))
    }
}

#[test]
fn the_block_is_the_exported_hamiltonian() {
    type Row = (&'static str, &'static [&'static [&'static str]], &'static [&'static str]);
    let rows: &[Row] = &[
        ("example1.toml", &[STEP, MODES], &[]),
        ("example1.toml", &[STEP, MODES], &["--levels", "uniform"]),
        ("well.toml", &[STEP, WELL, MODES], &[]),
        ("example1.toml", &[STEP, MODES, &["axis.0.x.boundary=periodic"]], &["--sub-bins", "3"]),
        ("barrier2d.toml", &[PLANE, MODES], &[]),
        ("unitary_advection.toml", &[STEP, MODES, &["scheme.degree=0", "scheme.flux=1"]], &[]),
        // Forces.
        ("harmonic_step.toml", &[STEP, PARABOLA, MODES], &[]),
        ("harmonic_step.toml", &[STEP, PARABOLA, MODES], &["--levels", "uniform"]),
        ("slope_jump.toml", &[STEP, SLOPES, MODES], &[]),
        ("slope_jump.toml", &[STEP, SLOPES, CLOSED], &[]),
        ("barrier2d.toml", &[PLANE, BOWL, MODES], &["--sub-bins", "1"]),
        // Each mode with its own weights, without and with forces.
        ("example1.toml", &[STEP, MODES], ROTATED),
        ("harmonic_step.toml", &[STEP, PARABOLA, MODES], ROTATED),
        ("slope_jump.toml", &[STEP, SLOPES, MODES], &["--mode-weights", "rotations"]),
        ("barrier2d.toml", &[PLANE, BOWL, MODES], ROTATED_BINS),
    ];
    check_all(rows, |(name, settings, options)| {
        let settings = settings.concat();
        let (matrix, circuit) = (directory(), directory());
        of_case("export-quantum", name).set(&settings).into(matrix.path()).succeed()?;
        let job = of_case("export-circuit", name).set(&settings).into(circuit.path());
        job.with(options.iter().copied()).succeed()?;
        let h = hermitian(&text_of(matrix.path().join("hamiltonian.mtx"))?)?;
        let (gates, system) = parse(&text_of(circuit.path().join("interface.qasm"))?)?;
        let about = json_of(circuit.path().join("circuit.json"))?;
        let about = &about["description"];
        let alpha = about["alpha"].as_f64().ok_or("no alpha")?;
        if h.len() != 1 << system {
            return Err(format!("{} rows on {system} qubits", h.len()));
        }
        // The printed counts are those of the gates.
        let count = |name: &str| gates.iter().filter(|gate| gate.name == name).count();
        for (key, expected) in [
            ("toffoli", count("ccx")),
            ("rotations", count("ry") + count("rz")),
            ("t", count("t") + count("tdg")),
            ("gates", gates.len()),
        ] {
            if about["counts"][key].as_u64() != Some(expected as u64) {
                return Err(format!("{key}: {} instead of {expected}", about["counts"][key]));
            }
        }
        let carried = carried(&about["modes"])?;
        let starts = (0..h.len()).step_by(h.len().div_ceil(40) | 1);
        for start in starts.filter(|start| carried[start % carried.len()]) {
            let mut left = h[start].clone();
            for (row, value) in column(&gates, system, start)? {
                let expected = left.remove(&row).unwrap_or_default();
                let apart = (alpha * value - expected).norm();
                if apart > 1e-12 * alpha {
                    return Err(format!("{row} {start}: {value} for {expected}/{alpha}"));
                }
            }
            if let Some((row, value)) = left.iter().find(|entry| entry.1.norm() > 1e-12 * alpha) {
                return Err(format!("{row} {start}: nothing for {value}"));
            }
        }
        Ok(())
    });
}

#[test]
fn columns_are_checked_on_any_grid() {
    type Row = (&'static str, &'static [&'static str], &'static [&'static str], usize);
    let rows: &[Row] = &[
        ("barriers.toml", BARRIERS, &[], 6),
        ("barriers.toml", BARRIERS, &["--levels=uniform"], 6),
        ("barriers.toml", BARRIERS, &["--wavenumber=-2.5"], 6),
        ("barriers.toml", BARRIERS, &["--wavenumber=0", "--sub-bins=2"], 6),
        // Two walls across each axis.
        ("barrier2d.toml", CORNERS, &["--wavenumber=1.3"], 8),
        ("barrier2d.toml", CORNERS, &["--wavenumber=1.3", "--levels=uniform"], 8),
        ("periodic2d.toml", RING, &["--wavenumber=0.4"], 1),
        ("step3d.toml", SPACE, &["--wavenumber=-0.7"], 1),
        // The unitary scheme has one mode, without a wavenumber.
        ("barriers.toml", UNITARY_BARRIERS, &[], 6),
        ("barriers.toml", UNITARY_BARRIERS, &["--levels=uniform"], 6),
    ];
    check_all(rows, |(name, settings, options, jumps)| {
        let place = directory();
        let job = of_case("export-circuit", name).set(settings).into(place.path());
        let printed = job.with(options.iter().copied().chain(["--check", "25"])).succeed()?.output;
        let about = json_of(place.path().join("circuit.json"))?;
        let about = &about["description"];
        let difference = about["check"]["difference"].as_f64().ok_or("no check")?;
        let axes = about["transport"]["axes"].as_array().ok_or("no axes")?;
        let found: usize =
            axes.iter().map(|axis| axis["jumps"].as_array().map_or(0, Vec::len)).sum();
        // For each mode, sparse access has the larger alpha. With one mode there is no highest one.
        let one = about["modes"]["One"].is_number();
        let highest = about[if one { "alpha" } else { "alpha_of_highest" }].as_f64();
        let highest = highest.ok_or("no alpha")?;
        if one != about["alpha_of_highest"].is_null() || one == printed.contains("highest mode") {
            return Err(format!("the highest of one mode: {printed}"));
        }
        let sparse = about["sparse"]["alpha"].as_f64().ok_or("no alpha")?;
        if difference <= 1e-13 && found == *jumps && sparse > highest {
            Ok(())
        } else {
            Err(format!("{found} jumps, {about:#}"))
        }
    });
}

#[test]
fn rounded_jumps_change_the_matrix_by_no_more_than_the_bound() {
    let settings = [BARRIERS, &["axis.0.v.cells=24"]].concat();
    // 28.8, 57.6 and 86.4 levels.
    let mut before = f64::INFINITY;
    for bins in ["0", "2", "4"] {
        let place = directory();
        let job = of_case("export-circuit", "barriers.toml").set(&settings).into(place.path());
        job.with(["--sub-bins", bins, "--wavenumber", "1", "--check", "600"]).succeed().unwrap();
        let about = json_of(place.path().join("circuit.json")).unwrap();
        let number = |key: &str| about["description"][key].as_f64().unwrap();
        let found = about["description"]["check"]["difference"].as_f64().unwrap();
        // |H| of this mode is at most √2 (1 + 1)/2 times that of A.
        let (found, bound) = (found * number("alpha"), number("change") * 2f64.sqrt());
        assert!(
            found > 1e-3 * bound && found <= bound && bound < before,
            "{found} {bound} {before}"
        );
        before = bound;
    }
}

#[test]
fn exports_are_the_same_on_any_ranks() {
    let files = |ranks: usize| {
        let place = directory();
        let settings = [STEP, MODES].concat();
        let job = of_case("export-circuit", "example1.toml").set(&settings).into(place.path());
        job.on(ranks).succeed().unwrap();
        ["interface.qasm", "circuit.json", "azure.json", "qref.json"]
            .map(|name| text_of(place.path().join(name)).unwrap())
    };
    assert_eq!(files(1), files(3));
}

/// A case that names no interface has the circuit of the conservative one, and the command says so.
#[test]
fn the_interface_is_that_of_resources_unless_it_is_named() {
    let files = |scheme: &str| {
        let place = directory();
        let settings = [STEP, MODES, &[scheme]].concat();
        let job = of_case("export-circuit", "example1.toml").set(&settings).into(place.path());
        let printed = job.succeed().unwrap().output;
        (printed, text_of(place.path().join("circuit.json")).unwrap())
    };
    let (printed, circuit) = files("scheme={}");
    assert!(printed.contains("interface conservative, as `resources` takes it"), "{printed}");
    let (printed, named) = files("scheme={interface='conservative'}");
    assert!(!printed.contains("interface"), "{printed}");
    assert_eq!(circuit, named);
}

/// Nothing leaves a ring without a force: the central flux is unitary there with open ends too.
#[test]
fn a_ring_has_the_circuit_of_the_unitary_scheme() {
    let settings = [
        "axis.0.x.cells=6", "axis.0.v.cells=8", "axis.0.x.boundary=periodic",
        "potential=[{value='0'}]", "scheme.flux=0",
    ];
    let place = directory();
    let job = of_case("export-circuit", "example1.toml").set(&settings).into(place.path());
    job.with(["--check", "48"]).succeed().unwrap();
    let about = json_of(place.path().join("circuit.json")).unwrap();
    let about = &about["description"];
    assert_eq!(about["modes"]["One"], 0.0);
    assert!(about["check"]["difference"].as_f64() < Some(1e-13), "{about}");
}

#[test]
fn cases_without_a_circuit_are_refused() {
    type Row = (&'static str, &'static [&'static str], &'static [&'static str]);
    const FLAT: &str = "scheme.interface=conservative";
    let rows: &[Row] = &[
        ("example1.toml", &[], &["scheme.interface", "hat", "conservative"]),
        ("example1.toml", &[FLAT], &["0.2", "728.17", "`export-circuit --sub-bins B`"]),
        ("example1.toml", &[FLAT, "solver.method=classical"], &["solver.method"]),
        ("example1.toml", &[FLAT, "scheme.flux=0.5"], &["scheme.flux", "closed"]),
        ("example1.toml", &["scheme.flux=0"], &["scheme.flux", "closed"]),
        ("example1.toml", &[FLAT, "inflow.value=0.3"], &["inflow.value"]),
        ("example1.toml", &[FLAT, "axis.0.v.cells=33"], &["vx has 33 cells", "even"]),
        ("example1.toml", &[FLAT, "axis.0.v.upper=2"], &["from -1.5 to 2"]),
        ("harmonic_step.toml", &[FLAT, "axis.0.x.cells=8192"], &["dV/dx", "13 bits", "2^12"]),
        ("partial_reflection.toml", &["scheme.degree=0"], &["potential.reflection"]),
        ("unitary_advection.toml", &[], &["scheme.degree", "degree 0"]),
        ("barrier2d.toml", &[FLAT], &["vx has 9 cells", "even"]),
    ];
    let rows: Vec<_> = rows.iter().enumerate().collect();
    check_all(&rows, |&(k, (name, settings, wording))| {
        let place = directory();
        let new = place.path().join("new");
        let ranks = if k == 0 { 2 } else { 1 };
        of_case("export-circuit", name).set(settings).into(&new).on(ranks).is_refused(wording)?;
        if new.exists() { Err(format!("{} was made", new.display())) } else { Ok(()) }
    });
}
