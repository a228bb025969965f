//! MPI: start and end, and the settings of the library.

use crate::base::machine;
use crate::parallel::communicator::watch::{RankWatch, abort_job, is_running};
use crate::parallel::group::Group;
use mpi::topology::SimpleCommunicator;
use mpi::traits::*;
use std::ffi::OsStr;
use std::path::PathBuf;
use std::time::Instant;
use tempfile::TempDir;

/// MPI, from initialisation to the end of the process.
pub struct World {
    universe: mpi::environment::Universe,
    /// Dropped after MPI is finalised.
    _watch: Option<RankWatch>,
    /// Where Open MPI keeps files of a process without a launcher. Removed after MPI is finalised.
    _session: Option<TempDir>,
    /// Seconds that MPI took to start.
    pub start_seconds: f64,
    /// The time at which MPI was started.
    pub started: Instant,
}

impl World {
    /// Starts MPI; a panic on any rank then ends the whole job, and so does a rank that was stopped
    /// for too long. Must be called before the program starts a thread, as it may set
    /// environment variables.
    ///
    /// Returns `None` when MPI was started before.
    pub fn start() -> Option<Self> {
        let started = Instant::now();
        let session = configure_open_mpi();
        let universe = mpi::initialize()?;
        let start_seconds = started.elapsed().as_secs_f64();
        let hook = std::panic::take_hook();
        std::panic::set_hook(Box::new(move |info| {
            hook(info);
            if is_running() {
                let rank = SimpleCommunicator::world().rank();
                let line = format!("phasewarp: rank {rank} stopped; ending the job");
                crate::base::log::eprint_wrapped(&line);
                abort_job();
            }
        }));
        let watch = RankWatch::start(&universe.world());
        Some(Self { universe, _watch: watch, _session: session, start_seconds, started })
    }

    /// All ranks, as one group.
    pub fn group(&self) -> Group {
        Group::new(self.universe.world())
    }

    /// Name and version of the MPI library.
    pub fn library(&self) -> String {
        let text = mpi::environment::library_version().unwrap_or_default();
        text.split(',').next().unwrap_or("").trim().to_owned()
    }
}

impl Drop for World {
    /// Keeps Open MPI's components loaded. Open MPI unloads them while its own thread may still
    /// call them: about one command in a thousand ended with a segmentation fault (version 4.1.4).
    fn drop(&mut self) {
        machine::keep_libraries("/mca_");
    }
}

/// Settings of Open MPI that this program needs. The user's own settings take precedence; other MPI
/// libraries ignore these.
///
/// - The component for shared file pointers, which is not used here, is off. It copies the name of
///   every opened file into 256 bytes, and longer names abort the program (version 4.1.4).
/// - On one machine, messages use shared memory. The search for networks would take 0.2 s with the
///   library of Debian (`docs/performance.md`).
/// - A process without a launcher starts no daemon. The daemon takes longer to start than the
///   program, and one command in some thousand then waited for ever at its end, for a thread of
///   PMIx (version 4.1.4). Without a daemon, processes do not know of each other, and each needs a
///   directory of its own for what Open MPI keeps in files. It is made where the user's Open MPI
///   has its own, and returned. If it cannot be made, there is a daemon.
fn configure_open_mpi() -> Option<TempDir> {
    const BASE: &str = "OMPI_MCA_orte_tmpdir_base";
    let variable = |name: &str| std::env::var(name).ok();
    // SAFETY: no other thread reads the environment; see `World::start`.
    let set = |name: &str, value: &OsStr| unsafe { std::env::set_var(name, value) };
    let propose = |name: &str, value: &str| {
        if std::env::var_os(name).is_none() {
            set(name, value.as_ref());
        }
    };
    propose("OMPI_MCA_sharedfp", "^lockedfile");
    if on_one_machine(variable) {
        propose("OMPI_MCA_pml", "ob1");
    }
    // Ranks of Slurm without PMI, or a shell in a step.
    let in_a_step = std::env::var_os("SLURM_STEP_ID").is_some();
    if has_launcher(variable) || in_a_step {
        return None;
    }
    let base = std::env::var_os(BASE).map_or_else(std::env::temp_dir, PathBuf::from);
    let session = tempfile::Builder::new().prefix("phasewarp-").tempdir_in(base).ok()?;
    propose("OMPI_MCA_ess_singleton_isolated", "1");
    set(BASE, session.path().as_os_str());
    Some(session)
}

/// Whether a launcher started this process.
fn has_launcher(variable: impl Fn(&str) -> Option<String>) -> bool {
    // Open MPI's own launcher, and those of Slurm and other batch systems.
    ["OMPI_COMM_WORLD_SIZE", "PMIX_RANK", "PMI_RANK"].iter().any(|name| variable(name).is_some())
}

/// Whether all ranks are on this machine: the launcher's variables count as many local ranks as
/// ranks in all, or there is no launcher. Every rank of a job gets the same answer.
fn on_one_machine(variable: impl Fn(&str) -> Option<String>) -> bool {
    match (variable("OMPI_COMM_WORLD_SIZE"), variable("OMPI_COMM_WORLD_LOCAL_SIZE")) {
        (Some(all), Some(here)) => all == here,
        _ => !has_launcher(variable),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn one_machine_is_recognised() {
        let ask = |set: &[(&str, &str)]| {
            on_one_machine(|name| {
                set.iter().find(|(key, _)| *key == name).map(|(_, value)| (*value).to_owned())
            })
        };
        let (all, here) = ("OMPI_COMM_WORLD_SIZE", "OMPI_COMM_WORLD_LOCAL_SIZE");
        assert!(ask(&[]), "no launcher");
        assert!(ask(&[("PMIX_RANK", "1"), (all, "3"), (here, "3")]));
        assert!(!ask(&[("PMIX_RANK", "1"), (all, "12"), (here, "3")]));
        // Slurm's launcher does not set Open MPI's variables: the ranks may be on any node.
        assert!(!ask(&[("PMIX_RANK", "1")]));
        assert!(!ask(&[("PMI_RANK", "0")]));
    }

    #[test]
    fn launchers_are_recognised() {
        let ask = |set: &str| has_launcher(|name| (name == set).then(|| "0".to_owned()));
        assert!(["OMPI_COMM_WORLD_SIZE", "PMIX_RANK", "PMI_RANK"].into_iter().all(ask));
        // A shell within a job of Slurm.
        assert!(!ask("SLURM_JOB_ID"));
    }
}
