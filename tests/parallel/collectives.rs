//! Counts the reductions of a run. With more ranks than cores each takes milliseconds, and small
//! runs take as long as their reductions.

use crate::warped::SharedDirectory;
use mpi::ffi::{MPI_Comm, MPI_Datatype, MPI_Op, PMPI_Allreduce};
use phasewarp::parallel::communicator::World;
use phasewarp::problem::case::Case;
use phasewarp::{Options, run};
use std::ffi::{c_int, c_void};
use std::sync::atomic::{AtomicUsize, Ordering};

/// Calls of `MPI_Allreduce` on this rank.
static REDUCTIONS: AtomicUsize = AtomicUsize::new(0);

/// Counts a call and passes it on. Takes the place of the function of the library, which is meant
/// to be replaced in this way: `PMPI_Allreduce` does the work (MPI 4.0, section 15.2).
///
/// # Safety
/// As `PMPI_Allreduce`.
// SAFETY: the signature is that of the function it replaces.
#[unsafe(no_mangle)]
unsafe extern "C" fn MPI_Allreduce(
    from: *const c_void,
    to: *mut c_void,
    count: c_int,
    datatype: MPI_Datatype,
    operation: MPI_Op,
    communicator: MPI_Comm,
) -> c_int {
    REDUCTIONS.fetch_add(1, Ordering::Relaxed);
    // SAFETY: as the caller promises.
    unsafe { PMPI_Allreduce(from, to, count, datatype, operation, communicator) }
}

/// A small run with an exact solution, a ledger and files makes few reductions, whatever its grid.
pub fn few_reductions(world: &World) {
    /// 200 to 215 on 1 to 4 ranks.
    const MOST: usize = 220;
    let example = include_str!("../../cases/example1.toml");
    let directory = SharedDirectory::new(&world.group());
    let options = Options { force: true, ..Options::default() };
    let counts = [12, 24].map(|cells| {
        let sizes = ["x", "v"].map(|axis| format!("axis.0.{axis}.cells={cells}"));
        let case = Case::parse("few_reductions", example, &sizes).expect("a valid case");
        let before = REDUCTIONS.load(Ordering::Relaxed);
        run(world, &case, &directory.path, &options).expect("a run");
        REDUCTIONS.load(Ordering::Relaxed) - before
    });
    assert!(counts.iter().all(|count| (100..=MOST).contains(count)), "{counts:?}");
}
