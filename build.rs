//! Tells the program what it was built from: the commit that was checked out, and the compiler.
//! Works without git and outside of a repository. Runs again when the sources change, not with
//! every commit: that would compile everything once more for nothing. What was compiled before its
//! commit stays "-dirty" until then (or `touch build.rs`).

use std::path::Path;
use std::process::Command;

/// What the program is made of; other files do not make it "dirty".
const SOURCES: [&str; 4] = ["src", "build.rs", "Cargo.toml", "Cargo.lock"];

fn main() {
    for source in SOURCES {
        println!("cargo:rerun-if-changed={source}");
    }
    let rustc = std::env::var("RUSTC").unwrap_or_else(|_| "rustc".to_owned());
    let rustc = output(Command::new(rustc).arg("--version"));
    let rustc = rustc.unwrap_or_else(|| "unknown".to_owned());
    println!("cargo:rustc-env=PHASEWARP_RUSTC={rustc}");
    let git = commit().unwrap_or_else(|| "unknown".to_owned());
    println!("cargo:rustc-env=PHASEWARP_GIT={git}");
}

/// The commit, with "-dirty" where the sources differ from it; none where this directory is not the
/// root of a repository.
fn commit() -> Option<String> {
    let root = output(git().args(["rev-parse", "--show-toplevel"]))?;
    let here = std::env::var("CARGO_MANIFEST_DIR").ok()?;
    if Path::new(&root).canonicalize().ok()? != Path::new(&here).canonicalize().ok()? {
        return None;
    }
    let hash = output(git().args(["rev-parse", "--short=12", "HEAD"]))?;
    let changes =
        output(git().args(["status", "--porcelain", "--untracked-files=no", "--"]).args(SOURCES))?;
    let dirty = if changes.is_empty() { "" } else { "-dirty" };
    Some(hash + dirty)
}

/// git, about the repository that this directory is in, leaving its index alone.
fn git() -> Command {
    let mut git = Command::new("git");
    git.env_remove("GIT_DIR").env_remove("GIT_WORK_TREE").arg("--no-optional-locks");
    git
}

/// What a command says, if it succeeds.
fn output(command: &mut Command) -> Option<String> {
    let output = command.output().ok().filter(|o| o.status.success())?;
    Some(String::from_utf8(output.stdout).ok()?.trim().to_owned())
}
