//! The program that starts a job of several ranks: Open MPI's `mpirun`, or another MPI's. Signals
//! to the processes of a job.

use std::process::Command;

/// Environment variable: that program, `mpirun` by default.
const MPIRUN: &str = "PHASEWARP_MPIRUN";

/// The program that starts a job of several ranks.
pub fn mpirun() -> String {
    std::env::var(MPIRUN).unwrap_or_else(|_| "mpirun".to_owned())
}

/// Whether that is another program than Open MPI's: the hydra of MPICH.
pub fn by_hydra() -> bool {
    std::env::var_os(MPIRUN).is_some()
}

/// Sends a signal to a process.
pub fn send(signal: &str, process: u32) {
    let _ = Command::new("kill").args([signal, &process.to_string()]).status();
}
