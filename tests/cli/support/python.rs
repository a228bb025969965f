//! Python scripts that need packages, which a machine may lack.

use std::path::{Path, PathBuf};
use std::process::Command;

/// Runs the script and returns its standard output, or its error messages if it fails.
pub fn run(python: &Path, script: &str, arguments: &[&str]) -> Result<String, String> {
    let mut command = Command::new(python);
    // Threads of NumPy and Aer would spin while they wait for each other, and take two thirds of
    // the processor's time.
    command.envs([("OMP_NUM_THREADS", "1"), ("OPENBLAS_NUM_THREADS", "1")]);
    let output = command.arg(script).args(arguments).output();
    let output = output.map_err(|e| format!("{}: {e}", python.display()))?;
    let printed = |bytes: &[u8]| String::from_utf8_lossy(bytes).into_owned();
    if output.status.success() { Ok(printed(&output.stdout)) } else { Err(printed(&output.stderr)) }
}

/// A Python that has the packages of the script: in `target/FOLDER`, or else on the `PATH`.
pub fn with_packages(folder: &str, script: &str) -> Option<PathBuf> {
    let target = Path::new(env!("CARGO_TARGET_TMPDIR")).parent()?;
    let found = [target.join(folder).join("bin/python"), "python3".into()];
    let has = |python: &PathBuf| run(python, script, &["--packages"]).is_ok();
    found.into_iter().find(has)
}
