//! Ranks that wait and leave the cores to those that work.
//!
//! Open MPI's ranks ask for messages all the time, and call `sched_yield` in between. With more
//! ranks than cores they take turns with the ranks that they wait for, and a job takes several
//! times as long. Here `sched_yield` sleeps.

use std::path::{Path, PathBuf};
use std::process::Command;
use std::sync::OnceLock;

/// Lets ranks that `mpirun`, a command, starts sleep while they wait. Does nothing where there is
/// no C compiler, or no Linux.
pub fn ranks_sleep(mpirun: &mut Command) {
    static LIBRARY: OnceLock<Option<PathBuf>> = OnceLock::new();
    if let Some(library) = LIBRARY.get_or_init(compiled) {
        mpirun.env("LD_PRELOAD", library);
    }
}

/// The library, compiled once for each test program.
fn compiled() -> Option<PathBuf> {
    if !cfg!(target_os = "linux") || std::env::var_os("LD_PRELOAD").is_some() {
        return None;
    }
    let source = Path::new(env!("CARGO_MANIFEST_DIR")).join("tests/support/sched_yield.c");
    let name = format!("{}-sched_yield.so", env!("CARGO_CRATE_NAME"));
    let library = Path::new(env!("CARGO_TARGET_TMPDIR")).join(name);
    let compiler = std::env::var_os("CC").unwrap_or_else(|| "cc".into());
    let mut compile = Command::new(compiler);
    compile.args(["-O2", "-shared", "-fPIC", "-o"]).arg(&library).arg(source);
    compile.status().is_ok_and(|status| status.success()).then_some(library)
}
