//! `phasewarp check` and `phasewarp check-result`: cases and results without solving anything.

use crate::base::error::Result;
use crate::base::refusal::Refusal;
use crate::command::accuracy::with_accuracy;
use crate::command::cli::{CheckArgs, CheckResultArgs};
use crate::command::describe::describe;
use crate::command::loading::load;
use crate::command::printing::{print, print_json};
use crate::matrix::bounds::Bounds;
use crate::parallel::communicator::World;
use crate::plan::here::{announce_slow_steps, refuse_too_large_here};
use crate::plan::layout::Resources;
use crate::problem::case::Case;
use crate::results::ledger::Ledger;
use crate::results::result_grid::ResultGrid;
use crate::results::untrusted::{self, CheckedFile};
use crate::run::planning::{MeasuredCase, read_and_reduced};
use crate::run::{ledger, warnings};
use serde::Serialize;

/// The JSON of `check`.
#[derive(Serialize)]
struct CheckJson<'a> {
    /// Always true.
    ok: bool,
    title: &'a str,
    /// The keys that the case gives, with their values.
    settings: &'a std::collections::BTreeMap<String, String>,
    /// The space axes, then the velocity axes.
    axes: Vec<CheckedAxis>,
    /// Number of unknowns: cells of degree 0, nodes of elements.
    cells: usize,
    bounds: &'a Bounds,
    /// Parts of the grid that are left out, as the solution does not depend on them.
    dropped: &'a [String],
    /// Parts of the grid that could not be left out, and why.
    kept: &'a [String],
    ledger: &'a Ledger,
    warnings: &'a [String],
}

/// The JSON of `check` for a case that is refused.
#[derive(Serialize)]
struct RefusalJson {
    /// Always false.
    ok: bool,
    error: RefusedBy,
}

/// The reason of a refusal.
#[derive(Serialize)]
struct RefusedBy {
    #[serde(flatten)]
    refusal: Refusal,
    exit_code: i32,
    /// The error as it stands on standard error.
    text: String,
}

/// An axis in `check --json`.
#[derive(Serialize)]
struct CheckedAxis {
    name: String,
    lower: f64,
    upper: f64,
    /// Number of elements; for degree 0, of cells.
    elements: usize,
    degree: usize,
    periodic: bool,
}

/// Prints the case as it was read, and warnings about it; with `--json` also why it is refused.
/// Collective.
///
/// # Errors
/// As [`MeasuredCase::new`] and [`MeasuredCase::plan`].
pub fn execute(world: &World, args: &CheckArgs) -> Result<()> {
    let outcome = check(world, args);
    if let (true, Err(error)) = (args.json, &outcome) {
        let (exit_code, text) = (error.exit_code(), error.to_string());
        let error = RefusedBy { refusal: error.into(), exit_code, text };
        print_json(world, &RefusalJson { ok: false, error });
    }
    outcome
}

fn check(world: &World, args: &CheckArgs) -> Result<()> {
    let case = load(world, &args.case)?;
    let case = with_accuracy(world, case, &args.case.changes, &args.accuracy)?;
    let case = read_and_reduced(&world.group(), &case)?;
    refuse_too_large_here(world, &case)?;
    announce_slow_steps(world, &case);
    let bounds = Bounds::new(&case)?;
    let resources = Resources::unlimited(world);
    // Where the grid is small enough, planning finds formulas that are not finite and tolerances
    // that cannot be met.
    let measured = MeasuredCase::new(world, &case, &resources)?;
    let plan = measured.plan(&resources)?.plan;
    let mut ledger = ledger::before_run(&world.group(), &ResultGrid::new(&case).case)?.ledger;
    ledger.mass.initial = measured.at_start.map(|totals| totals.mass);
    let planned = plan.warp.map_or(Vec::new(), |w| w.warnings);
    let found = [warnings::warnings(&case), planned, ledger.warnings()].concat();
    if args.json {
        print_json(world, &checked(&case, &bounds, &ledger, &found));
        return Ok(());
    }
    print(world, &describe(&case, &bounds));
    print(world, &ledger.text());
    for warning in &found {
        print(world, &format!("warning: {warning}"));
    }
    Ok(())
}

fn checked<'a>(
    case: &'a Case,
    bounds: &'a Bounds,
    ledger: &'a Ledger,
    warnings: &'a [String],
) -> CheckJson<'a> {
    let whole = case.space.whole();
    let axes = whole.named_axes().map(|(name, axis, periodic)| CheckedAxis {
        name: name.to_string(),
        lower: axis.lower,
        upper: axis.upper,
        elements: axis.elements(),
        degree: axis.nodes.degree,
        periodic,
    });
    CheckJson {
        ok: true,
        title: &case.title,
        settings: &case.settings,
        axes: axes.collect(),
        cells: case.space.cells(),
        bounds,
        dropped: &case.reductions.dropped,
        kept: &case.reductions.kept,
        ledger,
        warnings,
    }
}

/// Compares the datasets of a run with their checksums. Collective.
///
/// # Errors
/// As [`untrusted::check_directory`].
pub fn check_result(world: &World, args: &CheckResultArgs) -> Result<()> {
    for file in untrusted::check_directory(&world.group(), &args.directory)? {
        let CheckedFile { path, datasets } = file;
        print(world, &format!("{}: {datasets} datasets as written", path.display()));
    }
    Ok(())
}
