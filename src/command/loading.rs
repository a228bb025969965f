//! Case files of a command, and where its results go.

use crate::base::error::{Error, Result};
use crate::command::cli::{CaseArgs, Mode};
use crate::parallel::communicator::World;
use crate::problem::case;
use crate::problem::case::Case;
use crate::run::planning;
use crate::scheme::reduce::reduced;
use std::path::{Path, PathBuf};

/// The case of a study, which varies grids and methods of degree 0. Collective.
///
/// # Errors
/// As [`load`]; a degree above 0.
pub fn load_finite_volumes(world: &World, args: &CaseArgs, command: &str) -> Result<Case> {
    let case = load(world, args)?;
    if !case.is_galerkin() {
        return Ok(case);
    }
    let has = match case.space.degree() {
        0 => "partial reflection (potential.reflection)".to_owned(),
        degree => format!("elements of degree {degree}"),
    };
    Err(Error::Input(format!(
        "{}: phasewarp {command} compares grids and methods of degree 0, and the case has {has}; \
         give the cells of degree 0 by --set, and scheme.degree=0",
        case.name
    )))
}

/// Reads the case file on rank 0 and parses it on all. Collective.
pub fn load(world: &World, args: &CaseArgs) -> Result<Case> {
    let group = world.group();
    let text = group.on_first_rank(|| case::read_text(&args.case))?;
    let text = group.broadcast_text(&text);
    let mode = (args.mode).map(|mode| format!("output.warped_field={}", mode == Mode::Full));
    let set: Vec<String> = args.set.iter().cloned().chain(mode).collect();
    Case::parse(&args.case.display().to_string(), &text, &set)
}

/// The case as it is solved: its start is read, and what its answer does not depend on is left out.
/// Collective.
pub fn load_reduced(world: &World, args: &CaseArgs) -> Result<Case> {
    let (all, case) = (world.group(), load(world, args)?);
    reduced(&all, &*planning::with_start(&all, &case)?)
}

/// `results/NAME` of the case file.
pub fn default_directory(case: &str) -> PathBuf {
    let stem = Path::new(case).file_stem().unwrap_or_default();
    Path::new("results").join(stem)
}

/// `results/NAME-what`.
pub fn default_directory_of(case: &str, what: &str) -> PathBuf {
    let mut name = default_directory(case).into_os_string();
    name.push(format!("-{what}"));
    name.into()
}
