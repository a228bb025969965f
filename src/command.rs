//! The subcommands: each has a file that reads its options, calls the rooms below and prints.

pub mod advise;
pub mod chart;
pub mod check;
pub mod cli;
pub mod describe;
pub mod export;
pub mod plan;
pub mod plot;
pub mod resources;
pub mod run;
pub mod spectrum;
pub mod stability;
pub mod values;

use crate::base::error::{Error, Result};
use crate::base::log::say;
use crate::command::cli::{CaseArgs, Cli, Command, Mode};
use crate::parallel::communicator::World;
use crate::problem::case;
use crate::problem::case::Case;
use crate::run::planning;
use crate::scheme::reduce::reduced;
use serde::Serialize;
use std::fmt::Display;
use std::path::{Path, PathBuf};

/// Carries out a command. Collective.
///
/// # Errors
/// The first error of any rank, the same on all.
pub fn execute(world: &World, cli: &Cli) -> Result<()> {
    match &cli.command {
        Command::Run(args) => run::execute(world, args),
        Command::Plan(args) => plan::execute(world, args),
        Command::Check(args) => check::execute(world, args),
        Command::CheckResult(args) => check::execute_on_result(world, args),
        Command::Advise(args) => advise::execute(world, args),
        Command::Plot(args) => plot::execute(world, args),
        Command::Report(args) => plot::execute_report(world, args),
        Command::Chart(args) => chart::execute(world, args),
        Command::ExportQuantum(args) => export::execute(world, args),
        Command::Resources(args) => resources::execute(world, args),
        Command::Stability(args) => stability::execute(world, args),
        Command::Spectrum(args) => spectrum::execute(world, args),
    }
}

/// The case of a study, which varies grids and methods of degree 0. Collective.
///
/// # Errors
/// As [`load`]; a degree above 0.
fn load_finite_volumes(world: &World, args: &CaseArgs, command: &str) -> Result<Case> {
    let case = load(world, args)?;
    match case.space.degree() {
        0 => Ok(case),
        degree => Err(Error::Input(format!(
            "{}: phasewarp {command} compares grids and methods of degree 0, and the case has \
             elements of degree {degree}; give the cells of degree 0 by --set, and \
             scheme.degree=0",
            case.name
        ))),
    }
}

/// Reads the case file on rank 0 and parses it on all. Collective.
fn load(world: &World, args: &CaseArgs) -> Result<Case> {
    let group = world.group();
    let text = group.on_first_rank(|| case::read_text(&args.case))?;
    let text = group.broadcast_text(&text);
    let mode = (args.mode).map(|mode| format!("output.warped_field={}", mode == Mode::Full));
    let set: Vec<String> = args.set.iter().cloned().chain(mode).collect();
    Case::parse(&args.case.display().to_string(), &text, &set)
}

/// The case as it is solved: its start is read, and what its answer does not depend on is left out.
/// Collective.
fn load_reduced(world: &World, args: &CaseArgs) -> Result<Case> {
    let (all, case) = (world.group(), load(world, args)?);
    reduced(&all, &*planning::with_start(&all, &case)?)
}

/// Prints on the first rank.
fn print(world: &World, text: &str) {
    if world.group().rank() == 0 {
        say(text.trim_end());
    }
}

/// Prints on the first rank, as JSON or for people.
fn print_as<T: Serialize + Display>(world: &World, found: &T, json: bool) {
    match json {
        true => print_json(world, found),
        false => print(world, &found.to_string()),
    }
}

/// Prints JSON on the first rank.
fn print_json(world: &World, found: &impl Serialize) {
    print(world, &serde_json::to_string_pretty(found).unwrap_or_default());
}

/// `results/NAME` of the case file.
fn default_directory(case: &str) -> PathBuf {
    let stem = Path::new(case).file_stem().unwrap_or_default();
    Path::new("results").join(stem)
}

/// `results/NAME-what`.
fn default_directory_of(case: &str, what: &str) -> PathBuf {
    let mut name = default_directory(case).into_os_string();
    name.push(format!("-{what}"));
    name.into()
}
