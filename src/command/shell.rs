//! `phasewarp completions` and `phasewarp man`: shell completions and manual pages, generated from
//! the definition of the command line.

use crate::base::disk::{failure, make};
use crate::base::error::Result;
use crate::command::cli::{Cli, CompletionsArgs, ManArgs};
use crate::command::printing::{print, print_unwrapped};
use crate::parallel::communicator::World;
use clap::CommandFactory;

/// Prints a script by which a shell completes commands and options. Collective.
pub fn completions(world: &World, args: &CompletionsArgs) {
    let mut script = Vec::new();
    clap_complete::generate(args.shell, &mut Cli::command(), "phasewarp", &mut script);
    print_unwrapped(world, &String::from_utf8_lossy(&script));
}

/// Writes a manual page for the program and for each command. Collective.
///
/// # Errors
/// [`crate::base::error::Error::Directory`], [`crate::base::error::Error::Output`].
pub fn man(world: &World, args: &ManArgs) -> Result<()> {
    world.group().on_first_rank(|| {
        make(&args.directory)?;
        let pages = clap_mangen::generate_to(Cli::command(), &args.directory);
        pages.map_err(|e| failure(&args.directory, &e))
    })?;
    print(world, &format!("manual pages in {}", args.directory.display()));
    Ok(())
}
