//! Starts MPI, parses the command line, calls the library and turns an error into an exit code.

use clap::Parser;
use phasewarp::base::error::{Error, Result};
use phasewarp::base::log::{eprint_wrapped, print_wrapped, unwritten};
use phasewarp::base::machine::{self, RunPart};
use phasewarp::command::cli::Cli;
use phasewarp::command::execute;
use phasewarp::parallel::communicator::World;
use phasewarp::results::untrusted;

fn main() {
    if let Some(code) = untrusted::serve() {
        std::process::exit(code);
    }
    machine::catch_file_size_signal();
    // From now on SIGUSR1 makes a run write a checkpoint and stop.
    machine::stop_flag();
    // Parsed before MPI starts, which takes up to a tenth of a second: a stop signal may come
    // meanwhile.
    let parsed = Cli::try_parse();
    if parsed.as_ref().is_ok_and(|cli| cli.command.can_be_continued()) {
        machine::stop_when_terminated();
    }
    let Some(world) = World::start() else {
        eprint_wrapped("phasewarp: MPI could not be started");
        std::process::exit(1);
    };
    // Every rank parses the same command line; only rank 0 prints.
    let code = match parsed {
        Ok(cli) => executed(&world, &cli).map_or_else(|error| failed(&world, &error), |()| 0),
        Err(error) => {
            if world.group().is_first() {
                // Mistakes go to standard error, help and version to standard output.
                let text = error.render().to_string();
                if error.use_stderr() {
                    eprint_wrapped(text.trim_end())
                } else {
                    print_wrapped(text.trim_end())
                }
            }
            error.exit_code()
        }
    };
    let code = match unwritten().filter(|_| code == 0) {
        Some(why) => {
            eprint_wrapped(&format!("error: standard output could not be written: {why}"));
            1
        }
        None => code,
    };
    world.group().barrier();
    // Finalises MPI, on every rank, before the exit code is given.
    drop(world);
    std::process::exit(code);
}

/// Reports the error of a command, and returns its exit code. Ends the program if files are open.
fn failed(world: &World, error: &Error) -> i32 {
    if world.group().is_first() {
        if error.is_stop() {
            eprint_wrapped(&error.to_string())
        } else {
            eprint_wrapped(&format!("error: {error}"))
        }
    }
    if error.leaves_files_open() {
        // Closing the files, or finalising MPI, would wait for ranks that do not come.
        world.group().barrier();
        machine::leave(error.exit_code());
    }
    error.exit_code()
}

/// Executes a command. After it, stop signals do nothing: `mpirun` sends SIGTERM to the others when
/// the first rank ends with an error.
fn executed(world: &World, cli: &Cli) -> Result<()> {
    let ended = execute(world, cli);
    machine::begin(RunPart::Outside);
    ended
}
