//! Parses the command line, starts MPI, calls the library, turns an error into an exit code.

use clap::Parser;
use phasewarp::cli::Cli;
use phasewarp::command::execute;
use phasewarp::communicator::World;

fn main() {
    let Some(world) = World::start() else {
        eprintln!("phasewarp: MPI could not be started");
        std::process::exit(1);
    };
    let rank = world.group().rank();
    // Every rank parses the same line; one speaks.
    let code = match Cli::try_parse() {
        Ok(cli) => match execute(&world, &cli) {
            Ok(()) => 0,
            Err(error) => {
                if rank == 0 {
                    eprintln!("error: {error}");
                }
                error.exit_code()
            }
        },
        Err(error) => {
            if rank == 0 {
                // Help and version go to standard output, mistakes to standard error.
                let _ = error.print();
            }
            error.exit_code()
        }
    };
    world.group().barrier();
    // Finalises MPI, on every rank, before the exit code is given.
    drop(world);
    std::process::exit(code);
}
