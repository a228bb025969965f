//! Version and commit of the program.

/// The commit the program was built from, with "-dirty" where its sources were changed since;
/// "unknown" outside of a repository.
pub const GIT: &str = env!("PHASEWARP_GIT");

/// Name and version of the program, as files of its results carry them.
pub const PROGRAM: &str = concat!("phasewarp ", env!("CARGO_PKG_VERSION"));

/// Whether a file that carries `program` was written by this program, of any version.
pub fn is_own(program: &str) -> bool {
    program.starts_with("phasewarp ")
}

/// Version and commit.
pub const VERSION: &str = concat!(env!("CARGO_PKG_VERSION"), " (git ", env!("PHASEWARP_GIT"), ")");
