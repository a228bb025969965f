//! The subcommands: each has a file that reads its options, calls the modules below and prints.
//!
//! [`cli::Cli`] is the command line, [`execute`] runs it.
//!
//! Uses: every module. Only the program uses commands. Paper: none.

pub mod accuracy;
pub mod advise;
pub mod chart;
pub mod check;
pub mod cli;
pub mod describe;
pub mod export;
pub mod init;
mod loading;
pub mod movie;
pub mod plan;
pub mod plot;
mod printing;
pub mod resources;
pub mod run;
pub mod sbatch;
pub mod schema;
pub mod shell;
pub mod spectrum;
pub mod stability;
pub mod sweep;
pub mod values;

use crate::base::error::Result;
use crate::command::cli::{Cli, Command};
use crate::matrix::instruction_set::InstructionSet;
use crate::parallel::communicator::World;

/// Carries out a command. Collective.
///
/// # Errors
/// The first error of any rank, the same on all.
pub fn execute(world: &World, cli: &Cli) -> Result<()> {
    world.group().agree(InstructionSet::chosen())?;
    match &cli.command {
        Command::Run(args) => run::execute(world, args),
        Command::Sweep(args) => sweep::execute(world, args),
        Command::Schema(args) => {
            schema::execute(world, args);
            Ok(())
        }
        Command::Completions(args) => {
            shell::completions(world, args);
            Ok(())
        }
        Command::Init(args) => init::execute(world, args),
        Command::Man(args) => shell::man(world, args),
        Command::Plan(args) => plan::execute(world, args),
        Command::Check(args) => check::execute(world, args),
        Command::CheckResult(args) => check::check_result(world, args),
        Command::Advise(args) => advise::execute(world, args),
        Command::Plot(args) => plot::execute(world, args),
        Command::Movie(args) => movie::execute(world, args),
        Command::Report(args) => plot::execute_report(world, args),
        Command::Chart(args) => chart::execute(world, args),
        Command::ExportQuantum(args) => export::quantum(world, args),
        Command::ExportMatrix(args) => export::matrix(world, args),
        Command::ExportCircuit(args) => export::circuit(world, args),
        Command::Resources(args) => resources::execute(world, args),
        Command::Stability(args) => stability::execute(world, args),
        Command::Spectrum(args) => spectrum::execute(world, args),
    }
}
