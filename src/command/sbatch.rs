//! Writes a job script for Slurm that runs a case as it was planned. The script can be submitted
//! from any directory: it contains the shared functions of `jobscripts/`, and names program, case
//! and results by absolute paths.

use crate::base::disk;
use crate::base::error::{Error, Result};
use crate::base::log::eprint_wrapped;
use crate::base::text::{joined, quoted};
use crate::base::version::VERSION;
use crate::command::cli::PlanArgs;
use crate::command::loading::default_directory;
use crate::parallel::communicator::World;
use crate::problem::case::Case;
use std::fmt;
use std::path::Path;

/// Requested memory over planned memory. Plans are at most 1 % too low where they were measured
/// (`tests/cli/memory.rs`); other MPI libraries and more ranks were not measured.
const MEMORY_MARGIN: f64 = 1.25;
/// Least number of bytes requested beyond the plan, as libraries and MPI differ between machines.
const LEAST_EXTRA_MEMORY: f64 = (32 << 20) as f64;
/// Requested time over expected time, before [`EXTRA_SECONDS`] are added.
const TIME_MARGIN: f64 = 1.5;
/// Seconds added for the start of MPI and for the checkpoint that Slurm's signal requests.
const EXTRA_SECONDS: f64 = 240.0;
/// The settings of the site, read from the directory in which the case is planned.
const SITE: &str = "jobscripts/env.sh";
/// The settings where that file is missing.
const USUAL_SITE: &str = include_str!("../../jobscripts/env.sh");
/// The functions that job scripts share.
const STEPS: &str = include_str!("../../jobscripts/steps.sh");

/// The comment at the head of a script.
const HEAD: &str = "\
# Submit this script from any directory; logs are written there. A job that stops with a checkpoint
# submits the script again, until the run is finished. `plan --sbatch FILE --force` replaces it.";
/// Takes the place of an unknown time.
const NO_TIME: &str = "\
# Fill in the time and remove one #; plan --calibrate predicts it.
##SBATCH --time=01:00:00";

/// The resources of a job.
#[derive(Clone, Copy, Debug)]
pub struct JobResources {
    /// Number of ranks.
    pub ranks: usize,
    /// Planned bytes on the fullest rank.
    pub memory: u64,
    /// Expected seconds, if they were measured.
    pub seconds: Option<f64>,
}

struct JobScript {
    /// Name of the job: letters, digits and `._-` only.
    name: String,
    needs: JobResources,
    /// Ranks on a node, if given.
    ranks_per_node: Option<u64>,
    site: String,
    /// Absolute paths of the program and of the script.
    program: String,
    script: String,
    /// Case, results, options.
    words: Vec<String>,
}

/// Refuses, before anything is planned, a file that exists already, and a `case` that chooses its
/// grid anew in each run. Collective.
///
/// # Errors
/// [`Error::Input`].
pub fn refuse(world: &World, args: &PlanArgs, case: &Case) -> Result<()> {
    let Some(file) = &args.sbatch else { return Ok(()) };
    let refused = |what: &str| Err(Error::Input(format!("--sbatch {}: {what}", file.display())));
    if case.accuracy.is_some() {
        return refused(
            "a job with solver.accuracy cannot be resumed; leave the key out and give --accuracy, \
             whose choice is written into the script as --set",
        );
    }
    world.group().on_first_rank(|| {
        let exists = !args.force && disk::is_taken(file);
        if exists { refused("exists; --force replaces it") } else { Ok(()) }
    })
}

/// Writes the job script that `args` ask for, on the first rank. Collective.
///
/// # Errors
/// [`Error::Input`] for a name that is no text; [`Error::Output`].
pub fn write(world: &World, args: &PlanArgs, case: &Case, needs: JobResources) -> Result<()> {
    let Some(file) = &args.sbatch else { return Ok(()) };
    world.group().on_first_rank(|| {
        let script = JobScript::new(args, file, case, needs)?;
        disk::write(file, script.to_string().as_bytes())?;
        // Not on standard output, which may be JSON.
        let word = quoted(&absolute(file)?);
        eprint_wrapped(&format!("{} is written. Submit it:\n  sbatch {word}", file.display()));
        Ok(())
    })
}

impl JobScript {
    fn new(args: &PlanArgs, script: &Path, case: &Case, needs: JobResources) -> Result<Self> {
        let file = &args.case.case;
        let results = args.output.clone().unwrap_or_else(|| default_directory(&case.name));
        let mut words = vec![absolute(file)?, absolute(&results)?];
        for set in &case.overrides {
            words.extend(["--set".to_owned(), set.clone()]);
        }
        if let Some(blocks) = &args.ranks_x {
            words.push(format!("--ranks-x={}", joined(blocks, ",")));
        }
        let stem = file.file_stem().unwrap_or_default().to_string_lossy().into_owned();
        let plain = |c: char| if c.is_ascii_alphanumeric() || "._-".contains(c) { c } else { '-' };
        let name = format!("phasewarp-{}", stem.chars().map(plain).collect::<String>());
        let site = match Path::new(SITE) {
            site if site.is_file() => disk::read_text(site)?,
            _ => USUAL_SITE.to_owned(),
        };
        let program = std::env::current_exe()
            .map_err(|e| Error::Input(format!("--sbatch: the program's own path: {e}")))?;
        let [program, script] = [absolute(&program)?, absolute(script)?];
        Ok(Self { name, needs, ranks_per_node: args.ranks_per_node, site, program, script, words })
    }
}

fn absolute(path: &Path) -> Result<String> {
    let refused =
        |why: &dyn fmt::Display| Error::Input(format!("--sbatch: {}: {why}", path.display()));
    let found = std::path::absolute(path).map_err(|e| refused(&e))?;
    found.to_str().map(str::to_owned).ok_or_else(|| refused(&"is no UTF-8 text; rename it"))
}

impl fmt::Display for JobScript {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let JobResources { ranks, memory, seconds } = self.needs;
        writeln!(f, "#!/bin/bash\n# Written by phasewarp {VERSION}.\n{HEAD}")?;
        writeln!(f, "#SBATCH --job-name={}", self.name)?;
        writeln!(f, "#SBATCH --ntasks={ranks}")?;
        if let Some(each) = self.ranks_per_node {
            writeln!(f, "#SBATCH --ntasks-per-node={}", each.min(ranks as u64))?;
        }
        writeln!(f, "#SBATCH --cpus-per-task=1")?;
        let bytes = (MEMORY_MARGIN * memory as f64).max(memory as f64 + LEAST_EXTRA_MEMORY);
        let mebibytes = (bytes / f64::from(1 << 20)).ceil();
        writeln!(f, "#SBATCH --mem-per-cpu={mebibytes}M")?;
        match seconds {
            Some(seconds) => {
                let minutes = ((TIME_MARGIN * seconds + EXTRA_SECONDS) / 60.0).ceil();
                let (hours, minutes) = ((minutes / 60.0).floor(), minutes % 60.0);
                writeln!(f, "#SBATCH --time={hours:02}:{minutes:02}:00")?;
            }
            None => writeln!(f, "{NO_TIME}")?,
        }
        writeln!(f, "#SBATCH --signal=B:USR1@120")?;
        writeln!(f, "#SBATCH --output=%x-%j.log")?;
        writeln!(f, "\nset -euo pipefail\n")?;
        writeln!(f, "# --- the site: {SITE}, copied ---\n\n{}", self.site.trim_end())?;
        writeln!(f, "\n# --- what job scripts share ---\n\n{}", STEPS.trim_end())?;
        writeln!(f, "\n# --- this run ---\n")?;
        writeln!(f, "program=${{PHASEWARP:-}}")?;
        writeln!(f, "[ -n \"$program\" ] || program={}", quoted(&self.program))?;
        writeln!(f, "again=({})", quoted(&self.script))?;
        writeln!(f, "default_ranks={ranks} # without Slurm")?;
        write!(f, "solve_in_jobs")?;
        for word in &self.words {
            write!(f, " \\\n    {}", quoted(word))?;
        }
        writeln!(f)
    }
}
