//! What a run leaves behind: `result.h5`, written by all ranks, `fields.xdmf` and `summary.json`.

pub mod averages;
pub mod dataset;
pub mod draw;
pub mod fields;
pub mod figure;
pub mod finished;
pub mod history;
pub mod pictures;
pub mod provenance;
pub mod readback;
pub mod report;
pub mod result_file;
pub mod room;
pub mod shown;
pub mod summary;
pub mod views;
pub mod warped;
pub mod writer;
pub mod xdmf;

use crate::base::disk::{make, refused};
use crate::base::error::Result;
use crate::parallel::communicator::Group;
use crate::problem::case::Case;
use std::path::Path;

/// Makes the output directory and makes sure that it can be written and has room, before anything
/// is computed. Collective.
///
/// # Errors
/// [`crate::base::error::Error::Directory`].
pub fn prepare(world: &Group, directory: &Path, case: &Case) -> Result<()> {
    let attempt = || -> std::io::Result<()> {
        let warped = crate::results::warped::names(case);
        let names = ["result.h5", crate::results::xdmf::NAME, "summary.json", "readout.csv"];
        for name in names.into_iter().chain(warped.iter().map(String::as_str)) {
            if directory.join(name).is_dir() {
                return Err(std::io::Error::other(format!("{name} in it is a directory")));
            }
        }
        Ok(())
    };
    world.on_first_rank(|| {
        make(directory)?;
        attempt().map_err(|e| refused(directory, &e))?;
        crate::results::result_file::enough_room(directory, case)
    })
}
