//! Reading a [`Case`] from its file.

use super::*;
use crate::case_file::{CaseFile, Table};
use crate::error::{Error, Result};
use crate::grid::{Axis, MAX_DIMENSION};
use std::io::Read;
use std::path::Path;

/// Largest number of phase-space cells that is looked at; memory is checked against the machine by the plan.
const MOST_CELLS: f64 = 1e12;
/// Largest number of space cells: `V` is evaluated on all of them before anything else.
const MOST_SPACE_CELLS: f64 = 1e8;

/// Names of the coordinates `[x, y, z, vx, vy, vz, t]` in `n` dimensions; `v` and `t` only where allowed.
fn names(n: usize, velocity: bool, time: bool) -> [&'static [&'static str]; 7] {
    const NONE: &[&str] = &[];
    let space: [&[&str]; 3] = [&["x"], &["y"], &["z"]];
    let speed: [&[&str]; 3] = [
        if n == 1 { &["v", "vx"] } else { &["vx"] },
        &["vy"],
        &["vz"],
    ];
    let mut names = [NONE; 7];
    for a in 0..n {
        names[a] = space[a];
        if velocity {
            names[3 + a] = speed[a];
        }
    }
    if time {
        names[6] = &["t"];
    }
    names
}

impl Case {
    /// Reads a case from the text of a file called `name`, with `--set` overrides applied.
    ///
    /// # Errors
    /// [`Error::Input`] with file, line, key, value and limit.
    pub fn parse(name: &str, text: &str, overrides: &[String]) -> Result<Self> {
        let file = CaseFile::parse(name, text, overrides)?;
        let root = file.root().knowing(&[
            "title",
            "reference",
            "axis",
            "potential",
            "initial",
            "inflow",
            "time",
            "scheme",
            "solver",
            "exact",
            "output",
        ])?;
        let space = read_axes(&root)?;
        let n = space.dimension();
        let scheme = root.table("scheme")?.knowing(&["interface", "limiter"])?;
        let output = root
            .table("output")?
            .knowing(&["recovery_points", "warped_field"])?;
        let solver = root.table("solver")?.knowing(&[
            "method",
            "tolerance",
            "verify",
            "warp",
            "propagator",
            "classical",
        ])?;
        let warp = solver.table("warp")?.knowing(&[
            "profile",
            "alpha",
            "order",
            "c",
            "beta",
            "coefficients",
            "interval",
            "points",
            "recovery",
            "recovery_method",
            "weights",
            "inflow",
            "delta",
            "shift",
        ])?;
        let propagator = solver.table("propagator")?.knowing(&["method", "step"])?;
        let classical = solver.table("classical")?.knowing(&["integrator", "cfl"])?;
        let (data, fields) = read_data(&root, n)?;
        let read = read_warp(&warp)?;
        embeddable(&warp, &read, &fields)?;
        let method = solver.choice(
            "method",
            &[
                ("schrodingerized", Method::Schrodingerized),
                ("classical", Method::Classical),
            ],
        )?;
        let case = Case {
            name: name.to_owned(),
            title: root.text("title")?.unwrap_or_default(),
            reference: root.text("reference")?.unwrap_or_default(),
            potential: read_potential(&root, n)?,
            data,
            fields,
            end: read_end(&root)?,
            interface: scheme.choice(
                "interface",
                &[
                    ("hat", Interface::Hat),
                    ("conservative", Interface::Conservative),
                ],
            )?,
            limiter: scheme.choice("limiter", &[("none", Limiter::None)])?,
            method,
            tolerance: read_tolerance(&solver)?,
            tolerance_place: solver.place("tolerance"),
            verify: solver.boolean("verify")?.unwrap_or(false),
            warp: read,
            propagator: read_propagation(&propagator)?,
            integrator: classical.choice(
                "integrator",
                &[
                    ("exponential", Integrator::Exponential),
                    ("forward-euler", Integrator::ForwardEuler),
                    ("ssp-rk3", Integrator::SspRk3),
                ],
            )?,
            cfl: read_cfl(&classical)?,
            exact: read_exact(&root, n)?,
            recovery_points: read_recovery_points(&output)?,
            text: file.text().to_owned(),
            overrides: overrides.to_vec(),
            space,
        };
        if case.varies() {
            steppable(&case, &scheme, &propagator)?;
        }
        if output.boolean("warped_field")? == Some(true) {
            return Err(output.error(
                "warped_field",
                "only streamed runs are possible so far; leave it out or false",
            ));
        }
        Ok(case)
    }

    /// Reads a case file from disk.
    ///
    /// # Errors
    /// As [`parse`](Self::parse), and when the file cannot be read.
    pub fn load(path: &Path, overrides: &[String]) -> Result<Self> {
        Self::parse(&path.display().to_string(), &read_text(path)?, overrides)
    }
}

/// Longest case file read, in bytes.
const LONGEST: u64 = 1 << 20;

/// The text of a case file.
///
/// # Errors
/// [`Error::Input`] when it cannot be read or is larger than 1 MiB.
pub fn read_text(path: &Path) -> Result<String> {
    let fail = |e: &dyn std::fmt::Display| Error::Input(format!("{}: {e}", path.display()));
    let mut text = String::new();
    std::fs::File::open(path)
        .and_then(|file| file.take(LONGEST + 1).read_to_string(&mut text))
        .map_err(|e| fail(&e))?;
    if text.len() as u64 > LONGEST {
        return Err(fail(&format!("a case file has at most {LONGEST} bytes")));
    }
    // A byte order mark is no part of the text.
    Ok(text.trim_start_matches('\u{feff}').to_owned())
}

fn read_axis(table: Table<'_>) -> Result<Axis> {
    let table = table.knowing(&["lower", "upper", "cells"])?;
    let axis = Axis {
        lower: table.required_number("lower")?,
        upper: table.required_number("upper")?,
        cells: table
            .count("cells", 1)?
            .ok_or_else(|| table.error("cells", "missing; a whole number expected"))?,
    };
    if axis.lower >= axis.upper {
        return Err(table.error("upper", &format!("must be above lower = {}", axis.lower)));
    }
    let width = axis.width();
    for (key, value) in [("lower", axis.lower), ("upper", axis.upper)] {
        if value.abs() > MOST {
            return Err(table.error(key, &format!("must be between -{MOST:e} and {MOST:e}")));
        }
    }
    if axis.cells as f64 > MOST_CELLS {
        return Err(table.error("cells", "more cells than any machine's memory holds"));
    }
    if width < 1.0 / MOST || axis.lower + width == axis.lower || axis.upper - width == axis.upper {
        return Err(table.error(
            "cells",
            &format!("cells of width {width:e} cannot be told apart in double precision"),
        ));
    }
    Ok(axis)
}

fn read_axes(root: &Table<'_>) -> Result<PhaseSpace> {
    let tables = root.tables("axis")?;
    if tables.is_empty() || tables.len() > MAX_DIMENSION {
        return Err(root.error(
            "axis",
            &format!(
                "{} tables given; one [[axis]] a space dimension, 1 to {MAX_DIMENSION}",
                tables.len()
            ),
        ));
    }
    let mut space = PhaseSpace {
        x: Vec::new(),
        v: Vec::new(),
    };
    for table in tables {
        let table = table.knowing(&["x", "v"])?;
        for (key, list) in [("x", &mut space.x), ("v", &mut space.v)] {
            if !table.has(key) {
                return Err(
                    table.error(key, "missing; { lower = …, upper = …, cells = … } expected")
                );
            }
            list.push(read_axis(table.table(key)?)?);
        }
    }
    let cells: f64 = space.axes().map(|a| a.cells as f64).product();
    if cells > MOST_CELLS {
        return Err(root.error(
            "axis",
            &format!(
                "{cells:.3e} phase-space cells; the state alone takes {:.1e} bytes of memory",
                8.0 * cells
            ),
        ));
    }
    let points: f64 = space.x.iter().map(|a| a.cells as f64).product();
    if points > MOST_SPACE_CELLS {
        return Err(root.error(
            "axis",
            &format!("{points:.3e} space cells; at most {MOST_SPACE_CELLS:e} are planned for (memory and time)"),
        ));
    }
    Ok(space)
}

fn parse_formula(
    table: &Table<'_>,
    key: &str,
    text: &str,
    names: &[&[&str]],
) -> Result<Expression> {
    Expression::parse(text, names)
        .map(|formula| formula.at(table.place(key)))
        .map_err(|message| table.error(key, &message))
}

fn formula(table: &Table<'_>, key: &str, names: &[&[&str]]) -> Result<Option<Expression>> {
    match table.formula(key)? {
        Some(text) => parse_formula(table, key, &text, names).map(Some),
        None => Ok(None),
    }
}

fn required_formula(table: &Table<'_>, key: &str, names: &[&[&str]]) -> Result<Expression> {
    formula(table, key, names)?.ok_or_else(|| table.error(key, "missing; a formula expected"))
}

fn read_potential(root: &Table<'_>, n: usize) -> Result<Vec<Region>> {
    let tables = root.tables("potential")?;
    if tables.is_empty() {
        return Err(root.error(
            "potential",
            "missing; at least one [[potential]] with value = \"…\"",
        ));
    }
    let names = names(n, false, false);
    let mut regions = Vec::new();
    let count = tables.len();
    for (i, table) in tables.into_iter().enumerate() {
        let table = &table.knowing(&["where", "value"])?;
        let condition = formula(table, "where", &names)?;
        let last = i + 1 == count;
        if last && condition.is_some() {
            return Err(table.error(
                "where",
                "the last [[potential]] holds everywhere else and needs no where",
            ));
        }
        if !last && condition.is_none() {
            return Err(table.error("where", "missing; only the last [[potential]] goes without"));
        }
        regions.push(Region {
            condition,
            value: required_formula(table, "value", &names)?,
        });
    }
    Ok(regions)
}

/// `[initial]` and `[inflow]`: the fields to evolve.
fn read_data(root: &Table<'_>, n: usize) -> Result<(Data, Vec<Field>)> {
    let table = root.table("initial")?.knowing(&["f"])?;
    let field = Field {
        name: "f",
        initial: required_formula(&table, "f", &names(n, true, false))?,
        inflow: read_inflow(root, n)?,
    };
    Ok((Data::Density, vec![field]))
}

fn read_inflow(root: &Table<'_>, n: usize) -> Result<Inflow> {
    let table = root.table("inflow")?.knowing(&["value"])?;
    let inflow = match table.formula("value")?.as_deref() {
        Some("initial") => Inflow::Initial,
        text => Inflow::Formula(parse_formula(
            &table,
            "value",
            text.unwrap_or("0"),
            &names(n, true, true),
        )?),
    };
    Ok(inflow)
}

/// `[solver.warp]`.
fn read_warp(table: &Table<'_>) -> Result<Warp> {
    Ok(Warp {
        profile: read_profile(table)?,
        coefficients: table.choice("coefficients", &[("analytic", Coefficients::Analytic)])?,
        interval: None,
        points: None,
        recovery: None,
        recovery_method: table.choice("recovery_method", &[("point", RecoveryMethod::Point)])?,
        weights: table.choice("weights", &[("dissipative", true), ("none", false)])?,
        inflow: table.choice(
            "inflow",
            &[
                ("boundary", Embedding::Boundary),
                ("full", Embedding::Full),
                ("scalar", Embedding::Scalar),
            ],
        )?,
        delta: read_delta(table)?,
        shift: read_shift(table)?,
    })
}

/// `delta`: absent, `"max"` or a number.
fn read_delta(table: &Table<'_>) -> Result<Delta> {
    if !table.has("delta") {
        return Ok(Delta::Planned);
    }
    if table.is_text("delta") {
        return table.choice("delta", &[("max", Delta::Largest)]);
    }
    match table.number("delta")? {
        Some(delta) if (1.0 / MOST..=MOST).contains(&delta) => Ok(Delta::Given(delta)),
        _ => Err(table.error(
            "delta",
            &format!("must be above 0, between {:e} and {MOST:e}; or \"max\" for max |b|; leave it out to have it planned", 1.0 / MOST),
        )),
    }
}

/// `shift`: a number or `"growth"`.
fn read_shift(table: &Table<'_>) -> Result<Shift> {
    if table.is_text("shift") {
        return table.choice("shift", &[("growth", Shift::Growth)]);
    }
    let shift = table.number("shift")?.unwrap_or(0.0);
    if shift.abs() > MOST {
        return Err(table.error("shift", &format!("must be between -{MOST:e} and {MOST:e}")));
    }
    Ok(Shift::Given(shift))
}

/// Refuses methods that do not know of an inflow that depends on time.
fn steppable(case: &Case, scheme: &Table<'_>, propagator: &Table<'_>) -> Result<()> {
    if case.limiter != Limiter::None {
        return Err(scheme.error(
            "limiter",
            "takes the inflow at time 0; with t in inflow.value only \"none\"",
        ));
    }
    if case.propagator.method != PropagatorMethod::Chebyshev {
        return Err(propagator.error(
            "method",
            "with t in inflow.value the generator depends on time; only \"chebyshev\" is stepped",
        ));
    }
    Ok(())
}

/// Refuses embeddings that several fields cannot share: there is one matrix for all.
fn embeddable(table: &Table<'_>, warp: &Warp, fields: &[Field]) -> Result<()> {
    let entering = fields.iter().filter(|f| f.enters()).count();
    if fields.len() > 1 && fields.iter().any(Field::varies) {
        return Err(table.error(
            "inflow",
            "what enters may depend on t where initial.f is given; the unknowns of measure-valued data have one value each",
        ));
    }
    if entering > 1 && warp.inflow == Embedding::Scalar {
        return Err(table.error(
            "inflow",
            &format!(
                "\"scalar\" has one unknown for all rows, and its couplings are one field's; {entering} fields have inflow here: \"boundary\" or \"full\""
            ),
        ));
    }
    Ok(())
}

fn read_profile(table: &Table<'_>) -> Result<ProfileChoice> {
    table.choice("profile", &[("gaussian", ProfileChoice::Gaussian)])
}

/// `[solver.propagator]`.
fn read_propagation(table: &Table<'_>) -> Result<Propagation> {
    Ok(Propagation {
        method: table.choice("method", &[("chebyshev", PropagatorMethod::Chebyshev)])?,
        step: None,
    })
}

fn read_end(root: &Table<'_>) -> Result<f64> {
    let table = root.table("time")?.knowing(&["end"])?;
    let end = table.required_number("end")?;
    if !(1.0 / MOST..=MOST).contains(&end) {
        return Err(table.error(
            "end",
            &format!("must be above 0, between {:e} and {MOST:e}", 1.0 / MOST),
        ));
    }
    Ok(end)
}

fn read_tolerance(solver: &Table<'_>) -> Result<f64> {
    let tolerance = solver.number("tolerance")?.unwrap_or(DEFAULT_TOLERANCE);
    if !(tolerance > 0.0 && tolerance <= LARGEST_TOLERANCE) {
        return Err(solver.error(
            "tolerance",
            &format!("must be above 0 and at most {LARGEST_TOLERANCE}"),
        ));
    }
    Ok(tolerance)
}

fn read_cfl(classical: &Table<'_>) -> Result<f64> {
    let cfl = classical.number("cfl")?.unwrap_or(DEFAULT_CFL);
    if !(cfl > 0.0 && cfl <= 1.0) {
        return Err(classical.error(
            "cfl",
            "must be above 0 and at most 1, where forward Euler stops being stable",
        ));
    }
    Ok(cfl)
}

fn read_exact(root: &Table<'_>, n: usize) -> Result<Option<Exact>> {
    let table = root.table("exact")?.knowing(&["kind", "f"])?;
    let exact = match (
        table.has("kind"),
        formula(&table, "f", &names(n, true, true))?,
    ) {
        (false, None) => None,
        (false, Some(f)) => Some(Exact::Formula(f)),
        (true, None) => {
            table.choice("kind", &[("characteristics", ())])?;
            Some(Exact::Characteristics)
        }
        (true, Some(_)) => return Err(table.error("f", "give either exact.kind or exact.f")),
    };
    Ok(exact)
}

fn read_recovery_points(output: &Table<'_>) -> Result<usize> {
    match output.count("recovery_points", 1)?.unwrap_or(2) {
        points @ 1..=2 => Ok(points),
        _ => Err(output.error("recovery_points", "must be 1, or 2 for the error estimate")),
    }
}
