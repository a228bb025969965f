//! Reading a [`Case`] from its file.

pub mod output;
pub mod readout;

use crate::base::error::{Error, Result};
use crate::problem::case::file::{CaseFile, Table};
use crate::problem::case::{
    Allowed, Case, Coefficients, DEFAULT_ALPHA, DEFAULT_BETA, DEFAULT_CFL, DEFAULT_CHECKPOINT,
    DEFAULT_ORDER, DEFAULT_TOLERANCE, Data, Delta, DeltaWidth, Embedding, Exact, Field, Inflow,
    Integrator, Interface, LARGEST_TOLERANCE, Limiter, MOST, Method, ProfileChoice, Propagation,
    PropagatorMethod, RecoveryMethod, Reductions, Region, Shift, Warp, WarpedStart,
};
use crate::problem::formula::Expression;
use crate::problem::grid::{Axis, MAX_DIMENSION, PhaseSpace};
use crate::problem::limits::{BETAS, MOST_MODES, MOST_ORDER};
use std::io::Read;
use std::path::Path;
use std::time::Duration;

/// Largest number of phase-space cells that is looked at; memory is checked against the machine by the plan.
const MOST_CELLS: f64 = 1e12;
/// Largest number of space cells: `V` is evaluated on all of them before anything else.
const MOST_SPACE_CELLS: f64 = 1e8;

/// Largest number of time steps of a propagator.
const MOST_STEPS: f64 = 1e7;

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
            "checkpoint",
            "readout",
        ])?;
        let space = read_axes(&root)?;
        let n = space.dimension();
        let scheme = root.table("scheme")?.knowing(&["interface", "limiter"])?;
        let output = root.table("output")?.knowing(&[
            "recovery_points",
            "warped_field",
            "plateau",
            "moments_every",
            "moment_times",
            "field_times",
            "delta_width",
            "expand",
            "compression",
            "chunks",
            "xdmf",
        ])?;
        let solver = root.table("solver")?.knowing(&[
            "method",
            "tolerance",
            "verify",
            "warp",
            "propagator",
            "classical",
            "reduce",
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
        let start = read_start(&root, name)?;
        let end = read_end(&root)?;
        let exact = read_exact(&root, n, &data)?;
        let method = solver.choice(
            "method",
            &[
                ("schrodingerized", Method::Schrodingerized),
                ("classical", Method::Classical),
            ],
        )?;
        let mut read = read_warp(&warp)?;
        if method == Method::Classical {
            // What is embedded how is nothing to it.
            (read.inflow, read.delta) = (Embedding::Boundary, Delta::Planned);
        }
        embeddable(&warp, &read, &fields)?;
        if let Shift::Given(shift) = read.shift
            && (shift * end).abs() > LARGEST_SHIFT
        {
            return Err(warp.error(
                "shift",
                &format!(
                    "times time.end is {:.1}; at most {LARGEST_SHIFT} either way, e^{{shift T}} leaves no digits beyond",
                    shift * end
                ),
            ));
        }
        let mut case = Case {
            name: name.to_owned(),
            title: root.text("title")?.unwrap_or_default(),
            reference: root.text("reference")?.unwrap_or_default(),
            potential: read_potential(&root, n)?,
            data,
            fields,
            start,
            end,
            interface: scheme.choice(
                "interface",
                &[
                    ("hat", Interface::Hat),
                    ("conservative", Interface::Conservative),
                ],
            )?,
            limiter: scheme.choice(
                "limiter",
                &[
                    ("none", Limiter::None),
                    ("minmod", Limiter::Minmod),
                    ("van-leer", Limiter::VanLeer),
                ],
            )?,
            method,
            tolerance: read_tolerance(&solver)?,
            tolerance_place: solver.place("tolerance"),
            interval_place: warp.place("interval"),
            verify: solver.boolean("verify")?.unwrap_or(false),
            warp: read,
            propagator: read_propagation(&propagator, end)?,
            integrator: classical.choice(
                "integrator",
                &[
                    ("exponential", Integrator::Exponential),
                    ("forward-euler", Integrator::ForwardEuler),
                    ("ssp-rk3", Integrator::SspRk3),
                ],
            )?,
            cfl: read_cfl(&classical)?,
            reduce: read_reduce(&solver)?,
            reductions: Reductions::default(),
            exact,
            recovery_points: crate::problem::case::read::output::recovery_points(&output)?,
            plateau: crate::problem::case::read::output::plateau(&output)?,
            times: crate::problem::case::read::output::times(&output, end)?,
            warped_field: output.boolean("warped_field")?.unwrap_or(false),
            expand: output.boolean("expand")?.unwrap_or(false),
            delta_width: output.choice(
                "delta_width",
                &[
                    ("determinant", DeltaWidth::Determinant),
                    ("gradient", DeltaWidth::Gradient),
                ],
            )?,
            storage: crate::problem::case::read::output::storage(&output, &space)?,
            checkpoint_every: read_checkpoint(&root)?,
            readout: crate::problem::case::read::readout::readout(&root, &space)?,
            text: file.text().to_owned(),
            overrides: overrides.to_vec(),
            settings: file.settings(),
            space,
        };
        case.refuse_slopes_where_linear(&scheme)?;
        if case.varies() {
            steppable(&case, &scheme, &propagator, &output)?;
        }
        let summed = case.warp.inflow == Embedding::Scalar && case.enters();
        if summed && case.propagator.method != PropagatorMethod::Chebyshev {
            return Err(propagator.error(
                "method",
                "solver.warp.inflow = \"scalar\" couples one unknown to all rows, which only \"chebyshev\" applies: \
                 choose it, or \"boundary\" or \"full\"",
            ));
        }
        if case.start.is_some() {
            startable(&case, &root.table("initial")?, &solver, &warp)?;
        }
        if !case.reduce.modes && case.method == Method::Schrodingerized {
            every_mode(&mut case, &solver)?;
        }
        if case.warped_field && case.method == Method::Classical {
            return Err(output.error(
                "warped_field",
                "solver.method = \"classical\" has no modes; leave it out, or choose \"schrodingerized\"",
            ));
        }
        Ok(case)
    }

    /// A limiter is not linear: refused where `A` is needed as a matrix.
    fn refuse_slopes_where_linear(&self, scheme: &Table<'_>) -> Result<()> {
        if self.limiter == Limiter::None {
            return Ok(());
        }
        let wanted = "solver.method = \"classical\" with solver.classical.integrator = \"ssp-rk3\" or \"forward-euler\" takes one";
        let conflict = if self.method == Method::Schrodingerized {
            "solver.method = \"schrodingerized\" evolves a linear system, and slopes are not linear"
        } else if self.integrator == Integrator::Exponential {
            "solver.classical.integrator = \"exponential\" is that of a linear system, and slopes are not linear"
        } else if self.verify {
            return Err(scheme.error(
                "limiter",
                "solver.verify = true measures the distance to exp(A T) f0, which slopes leave; set one of them to its default",
            ));
        } else {
            return Ok(());
        };
        Err(scheme.error(
            "limiter",
            &format!("{conflict}; {wanted}, or leave limiter = \"none\""),
        ))
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

/// An axis, and whether it closes on itself: a question for space axes only.
fn read_axis(table: Table<'_>, of_space: bool) -> Result<(Axis, bool)> {
    let table = table.knowing(&["lower", "upper", "cells", "boundary"])?;
    if !of_space && table.has("boundary") {
        return Err(table.error(
            "boundary",
            "a velocity axis has none to choose; what enters there has the value of inflow.value",
        ));
    }
    let periodic = table.choice("boundary", &[("inflow", false), ("periodic", true)])?;
    let axis = Axis::new(
        table.required_number("lower")?,
        table.required_number("upper")?,
        table
            .count("cells", 1)?
            .ok_or_else(|| table.error("cells", "missing; a whole number expected"))?,
    );
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
    Ok((axis, periodic))
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
        periodic: [false; MAX_DIMENSION],
    };
    for (a, table) in tables.into_iter().enumerate() {
        let table = table.knowing(&["x", "v"])?;
        for key in ["x", "v"] {
            if !table.has(key) {
                return Err(
                    table.error(key, "missing; { lower = …, upper = …, cells = … } expected")
                );
            }
            let (axis, periodic) = read_axis(table.table(key)?, key == "x")?;
            space.periodic[a] |= periodic;
            let list = if key == "x" {
                &mut space.x
            } else {
                &mut space.v
            };
            list.push(axis);
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
    let table = root
        .table("initial")?
        .knowing(&["f", "density", "velocity", "warped"])?;
    if table.has("warped") {
        let others = ["f", "density", "velocity"];
        if let Some(other) = others.into_iter().find(|key| table.has(key)) {
            let message = format!("give either initial.warped, or initial.{other}");
            return Err(table.error(other, &message));
        }
        // f(0) stands nowhere; with this formula nothing is left of it.
        let zero = |key| parse_formula(&table, key, "0", &names(n, true, false));
        let field = Field {
            name: "f",
            initial: zero("warped")?,
            inflow: read_inflow(root, n, "0")?,
        };
        return Ok((Data::Density, vec![field]));
    }
    if !table.has("density") && !table.has("velocity") {
        let field = Field {
            name: "f",
            initial: required_formula(&table, "f", &names(n, true, false))?,
            inflow: read_inflow(root, n, "0")?,
        };
        return Ok((Data::Density, vec![field]));
    }
    if table.has("f") {
        return Err(table.error(
            "f",
            "give either initial.f, or initial.density and initial.velocity",
        ));
    }
    let space = names(n, false, false);
    let density = required_formula(&table, "density", &space)?;
    let texts = table.formulas("velocity")?.unwrap_or_default();
    if texts.len() != n {
        let message = format!(
            "{} formulas given; a list of {n} expected, one an axis",
            texts.len()
        );
        return Err(table.error("velocity", &message));
    }
    let mut fields = vec![Field {
        name: "phi",
        initial: density.clone(),
        inflow: read_inflow(root, n, "initial")?,
    }];
    let mut velocity = Vec::new();
    for (a, text) in texts.iter().enumerate() {
        let key = "velocity";
        velocity.push(parse_formula(&table, key, text, &space)?);
        let level_set = format!("{} - ({text})", ["vx", "vy", "vz"][a]);
        fields.push(Field {
            name: ["psi_x", "psi_y", "psi_z"][a],
            initial: parse_formula(&table, key, &level_set, &names(n, true, false))?,
            inflow: Inflow::Initial,
        });
    }
    Ok((Data::Measure { density, velocity }, fields))
}

/// `initial.warped`: relative to the directory of the case file `name`.
fn read_start(root: &Table<'_>, name: &str) -> Result<Option<WarpedStart>> {
    let table = root.table("initial")?;
    let Some(file) = table.text("warped")? else {
        return Ok(None);
    };
    if file.is_empty() {
        return Err(table.error(
            "warped",
            "the path of a file expected, such as \"warped_f.h5\"",
        ));
    }
    let directory = Path::new(name).parent().unwrap_or(Path::new(""));
    Ok(Some(WarpedStart {
        path: directory.join(file),
        place: table.place("warped"),
    }))
}

/// What makes no sense with a warped field to start from.
fn startable(case: &Case, initial: &Table<'_>, solver: &Table<'_>, warp: &Table<'_>) -> Result<()> {
    let refuse = |why: &str| Err(initial.error("warped", why));
    if case.method == Method::Classical {
        return refuse("solver.method = \"classical\" knows no p; \"schrodingerized\" does");
    }
    if case.enters() {
        return refuse(
            "nothing may enter, as the file has no auxiliary unknowns: leave inflow.value out or 0",
        );
    }
    if matches!(case.exact, Some(Exact::Characteristics)) {
        return refuse(
            "exact.kind = \"characteristics\" needs initial.f; leave it out, or give exact.f",
        );
    }
    if case.verify {
        return Err(solver.error(
            "verify",
            "needs initial.f; with initial.warped leave it out",
        ));
    }
    let read = &case.warp;
    let given = [
        ("profile", read.profile != ProfileChoice::Planned),
        ("coefficients", read.coefficients != Coefficients::Analytic),
        ("interval", read.interval.is_some()),
        ("points", read.points.is_some()),
        ("shift", read.shift != Shift::Given(0.0)),
    ];
    match given.into_iter().find(|(_, given)| *given) {
        Some((key, _)) => Err(warp.error(
            key,
            "with initial.warped the file says what w is at every p; leave it out",
        )),
        None => Ok(()),
    }
}

fn read_inflow(root: &Table<'_>, n: usize, default: &str) -> Result<Inflow> {
    let table = root.table("inflow")?.knowing(&["value"])?;
    let text = table.formula("value")?;
    let inflow = match text.as_deref().unwrap_or(default) {
        "initial" => Inflow::Initial,
        text => Inflow::Formula(parse_formula(&table, "value", text, &names(n, true, true))?),
    };
    Ok(inflow)
}

/// `[solver.warp]`.
fn read_warp(table: &Table<'_>) -> Result<Warp> {
    let warp = Warp {
        profile: read_profile(table)?,
        coefficients: table.choice(
            "coefficients",
            &[
                ("analytic", Coefficients::Analytic),
                ("sampled", Coefficients::Sampled),
            ],
        )?,
        interval: read_interval(table)?,
        points: read_points(table)?,
        recovery: read_recovery(table)?,
        recovery_method: table.choice(
            "recovery_method",
            &[
                ("point", RecoveryMethod::Point),
                ("integral", RecoveryMethod::Integral),
                ("least-squares", RecoveryMethod::LeastSquares),
            ],
        )?,
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
    };
    match warp.by_hand() {
        Some(key) if warp.profile == ProfileChoice::Designed => Err(table.error(
            key,
            "is of profiles that are functions on the line; solver.warp.profile = \"designed\" is a series, known on its domain only: \
             \"gaussian\", or another, or the key left out",
        )),
        _ => Ok(warp),
    }
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

/// Largest `|σT|`.
const LARGEST_SHIFT: f64 = 25.0;

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

/// Refuses modes of both signs where they have no use; what asks for all that there is does without them there.
fn every_mode(case: &mut Case, solver: &Table<'_>) -> Result<()> {
    let why = if case.warped_field || case.start.is_some() {
        "the warped field is kept by its modes l >= 0"
    } else if case.propagator.method.order() > 0 {
        "crank-nicolson and backward-euler take modes l >= 0 only"
    } else {
        return Ok(());
    };
    if solver.is_boolean("reduce") {
        case.reduce.modes = true;
        return Ok(());
    }
    let message = format!("{why}; leave it out, or true");
    Err(solver.table("reduce")?.error("modes", &message))
}

/// Refuses methods that do not know of an inflow that depends on time.
fn steppable(
    case: &Case,
    scheme: &Table<'_>,
    propagator: &Table<'_>,
    output: &Table<'_>,
) -> Result<()> {
    let timed = ["moments_every", "moment_times", "field_times"];
    if let Some(key) = timed.into_iter().find(|key| output.has(key)) {
        return Err(output.error(
            key,
            "with t in inflow.value results are written at time.end only; leave it out",
        ));
    }
    if case.limiter != Limiter::None {
        return Err(scheme.error(
            "limiter",
            "takes the inflow at time 0; with t in inflow.value only \"none\"",
        ));
    }
    let modes = case.method == Method::Schrodingerized;
    if modes && case.propagator.method != PropagatorMethod::Chebyshev {
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

/// The profile with its own parameter; the others' parameters are refused.
fn read_profile(table: &Table<'_>) -> Result<ProfileChoice> {
    /// Largest `alpha` and largest `c`: beyond, the profile is as good as a jump, or read where nothing is left of it.
    const LARGEST: [f64; 2] = [100.0, 16.0];
    let choices = [
        ("planned", "", ProfileChoice::Planned),
        ("designed", "", ProfileChoice::Designed),
        ("gaussian", "", ProfileChoice::Gaussian),
        (
            "exponential",
            "alpha",
            ProfileChoice::Exponential {
                alpha: DEFAULT_ALPHA,
            },
        ),
        (
            "smooth",
            "order",
            ProfileChoice::Smooth {
                order: DEFAULT_ORDER,
            },
        ),
        ("low-somma", "c", ProfileChoice::LowSomma { c: None }),
        ("acl", "beta", ProfileChoice::Acl { beta: DEFAULT_BETA }),
    ];
    let named = choices.map(|(name, _, profile)| (name, profile));
    let profile = table.choice("profile", &named)?;
    for (name, key, other) in choices {
        if !key.is_empty() && other != profile && table.has(key) {
            let message = format!("belongs to solver.warp.profile = \"{name}\" only");
            return Err(table.error(key, &message));
        }
    }
    let number = |key: &str, least: f64, most: f64| match table.number(key)? {
        Some(x) if !(least..=most).contains(&x) => {
            Err(table.error(key, &format!("must be between {least} and {most}")))
        }
        given => Ok(given),
    };
    Ok(match profile {
        ProfileChoice::Planned | ProfileChoice::Designed | ProfileChoice::Gaussian => profile,
        ProfileChoice::Exponential { alpha } => ProfileChoice::Exponential {
            alpha: number("alpha", 0.01, LARGEST[0])?.unwrap_or(alpha),
        },
        ProfileChoice::Smooth { order } => match table.count("order", 1)? {
            Some(given) if given > MOST_ORDER => {
                let message = format!("must be between 1 and {MOST_ORDER}");
                return Err(table.error("order", &message));
            }
            given => ProfileChoice::Smooth {
                order: given.unwrap_or(order),
            },
        },
        ProfileChoice::LowSomma { .. } => ProfileChoice::LowSomma {
            c: number("c", 0.05, LARGEST[1])?,
        },
        ProfileChoice::Acl { beta } => ProfileChoice::Acl {
            beta: number("beta", BETAS[0], BETAS[1])?.unwrap_or(beta),
        },
    })
}

/// Largest magnitude of a point in `p`.
const MOST_P: f64 = 1e9;

/// `interval = [L, R]`.
fn read_interval(table: &Table<'_>) -> Result<Option<[f64; 2]>> {
    let interval = table.pair("interval")?;
    match interval {
        Some([lower, upper]) if lower.is_nan() || lower >= 0.0 || upper <= 0.0 => Err(table.error(
            "interval",
            &format!("[{lower}, {upper}] given; L below and R above 0, where the profile changes, expected"),
        )),
        Some([lower, upper]) if -lower > MOST_P || upper > MOST_P => Err(table.error(
            "interval",
            &format!("[{lower}, {upper}] given; ends between -{MOST_P:e} and {MOST_P:e} expected"),
        )),
        given => Ok(given),
    }
}

/// `points = N_p`.
fn read_points(table: &Table<'_>) -> Result<Option<usize>> {
    match table.count("points", 2)? {
        Some(points) if !points.is_multiple_of(2) || points > 2 * MOST_MODES - 2 => {
            let most = 2 * MOST_MODES - 2;
            Err(table.error("points", &format!("must be even, and at most {most}")))
        }
        given => Ok(given),
    }
}

/// `recovery = p◇`.
fn read_recovery(table: &Table<'_>) -> Result<Option<f64>> {
    /// Beyond this `e^{p◇}` is no number.
    const HIGHEST: f64 = 300.0;
    let interval = table.pair("interval")?;
    match (table.number("recovery")?, interval) {
        (Some(point), _) if !(0.0..=HIGHEST).contains(&point) => {
            Err(table.error("recovery", &format!("must be between 0 and {HIGHEST}")))
        }
        (Some(point), Some([_, upper])) if point >= upper => {
            let message = format!("must be below the end of solver.warp.interval, {upper}");
            Err(table.error("recovery", &message))
        }
        (given, _) => Ok(given),
    }
}

/// `[solver.propagator]` of a run to `end`.
fn read_propagation(table: &Table<'_>, end: f64) -> Result<Propagation> {
    let method = table.choice(
        "method",
        &[
            ("chebyshev", PropagatorMethod::Chebyshev),
            ("krylov", PropagatorMethod::Krylov),
            ("crank-nicolson", PropagatorMethod::CrankNicolson),
            ("backward-euler", PropagatorMethod::BackwardEuler),
        ],
    )?;
    let step = table.number("step")?;
    let implicit = method.order() > 0;
    match step {
        None if implicit => Err(table.error(
            "step",
            "missing; crank-nicolson and backward-euler need a time step above 0",
        )),
        Some(_) if method == PropagatorMethod::Chebyshev => Err(table.error(
            "step",
            "the Chebyshev series takes the whole time at once; leave it out, or choose another method",
        )),
        Some(step) if !(end / step > 0.0 && end / step <= MOST_STEPS) => Err(table.error(
            "step",
            &format!("must be above 0, and time.end = {end:e} at most {MOST_STEPS:e} steps"),
        )),
        _ => Ok(Propagation { method, step }),
    }
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

/// `[solver.reduce]`, or `reduce = false` for none of it.
fn read_reduce(solver: &Table<'_>) -> Result<Allowed> {
    if solver.is_boolean("reduce") {
        return Ok(Allowed::all(solver.boolean("reduce")?.unwrap_or(true)));
    }
    let table = solver
        .table("reduce")
        .map_err(|_| solver.error("reduce", "true, false or a table expected"))?
        .knowing(&["axes", "velocities", "inflow", "modes"])?;
    let allowed = |key| Ok(table.boolean(key)?.unwrap_or(true));
    Ok(Allowed {
        axes: allowed("axes")?,
        velocities: allowed("velocities")?,
        inflow: allowed("inflow")?,
        modes: allowed("modes")?,
    })
}

/// `[checkpoint]`.
fn read_checkpoint(root: &Table<'_>) -> Result<Option<Duration>> {
    /// A year.
    const MOST: f64 = 525_600.0;
    let table = root.table("checkpoint")?.knowing(&["minutes"])?;
    let minutes = table.number("minutes")?.unwrap_or(DEFAULT_CHECKPOINT);
    if !(0.0..=MOST).contains(&minutes) {
        let message = format!("must be from 0 (no checkpoints by the clock) to {MOST}");
        return Err(table.error("minutes", &message));
    }
    Ok((minutes > 0.0).then(|| Duration::from_secs_f64(60.0 * minutes)))
}

fn read_exact(root: &Table<'_>, n: usize, data: &Data) -> Result<Option<Exact>> {
    let table = root.table("exact")?.knowing(&["kind", "f"])?;
    if table.has("f") && !matches!(data, Data::Density) {
        return Err(table.error(
            "f",
            "measure-valued data have no f; exact.kind = \"characteristics\" gives density and velocity",
        ));
    }
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
