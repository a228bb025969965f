//! Version and commit of the program.

/// The commit the program was built from, with "-dirty" where its sources were changed since;
/// "unknown" outside of a repository.
pub const GIT: &str = env!("PHASEWARP_GIT");

/// Version and commit.
pub const VERSION: &str = concat!(env!("CARGO_PKG_VERSION"), " (git ", env!("PHASEWARP_GIT"), ")");
