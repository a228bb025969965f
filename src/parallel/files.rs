//! HDF5 files that all ranks read.

use crate::base::checksum::DatasetBox;
use crate::parallel::communicator::Group;
use hdf5::{Dataset, File, Hyperslab, SliceOrIndex};
use ndarray::IxDyn;
use std::path::Path;

/// Name of the attribute with the checksum of a dataset ([`crate::base::checksum`]).
pub const CHECKSUM: &str = "checksum";

/// Opens a file on all ranks of `world`. Collective, as is closing it.
///
/// A file that only some ranks can open stays open until the process ends, as closing it would wait
/// for the other ranks. HDF5 does not close it at exit (the crate `hdf5` switches that off).
///
/// # Errors
/// The error of HDF5.
pub fn open(world: &Group, path: &Path) -> hdf5::Result<File> {
    File::with_options().with_fapl(|p| p.mpio(world.raw(), None)).open(path)
}

/// The numbers of a slab, row-major, read by this rank on its own.
///
/// # Errors
/// The error of HDF5.
pub fn read_slab(dataset: &Dataset, slab: &DatasetBox) -> hdf5::Result<Vec<f64>> {
    let selection: Vec<SliceOrIndex> = (slab.start.iter().zip(&slab.count))
        .map(|(&start, &count)| SliceOrIndex::SliceTo {
            start,
            step: 1,
            end: start + count,
            block: 1,
        })
        .collect();
    let values = dataset.read_slice::<f64, _, IxDyn>(Hyperslab::from(selection))?;
    Ok(values.into_raw_vec_and_offset().0)
}
