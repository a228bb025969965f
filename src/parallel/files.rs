//! HDF5 files that all ranks have open together.

use crate::base::error::{Error, Result};
use crate::base::row_major::DatasetBox;
use crate::parallel::group::Group;
use hdf5::{Dataset, File, Hyperslab, SliceOrIndex};
use ndarray::IxDyn;
use std::fmt::Display;
use std::mem::ManuallyDrop;
use std::ops::Deref;
use std::path::Path;

/// Name of the attribute with the checksum of a dataset ([`crate::base::checksum`]).
pub const CHECKSUM: &str = "checksum";

/// The checksum that is stored with a dataset.
///
/// # Errors
/// If there is none.
pub fn stored_checksum(dataset: &Dataset) -> hdf5::Result<u64> {
    dataset.attr(CHECKSUM)?.read_scalar()
}

/// Makes the error of an operation on a file from a text that says what is wrong.
pub type MakeError<'a> = &'a dyn Fn(&dyn Display) -> Error;

/// A file that all ranks have open.
///
/// Closing it waits for all ranks. So it stays open until the process ends where some ranks could
/// not open it, and after an error; HDF5 does not close it at exit (the crate `hdf5` switches that
/// off). Where only some ranks can read or write any more, all may wait within HDF5 for ever: then
/// the job ends ([`Group::in_time`]).
pub struct SharedFile<'a> {
    world: &'a Group,
    file: ManuallyDrop<File>,
}

impl Deref for SharedFile<'_> {
    type Target = File;

    fn deref(&self) -> &File {
        &self.file
    }
}

impl<'a> SharedFile<'a> {
    /// Opens a file, returns what `read` makes of it, and closes it, also after an error. `read`
    /// must have the same outcome on all ranks. Collective over `world`, as are all methods.
    ///
    /// # Errors
    /// What `fail` makes of HDF5's error, the same on all ranks; as `read`.
    pub fn read<T>(
        world: &'a Group,
        path: &Path,
        fail: MakeError<'_>,
        read: impl FnOnce(&File) -> Result<T>,
    ) -> Result<T> {
        let file = || File::with_options().with_fapl(|p| p.mpio(world.raw(), None)).open(path);
        let file = Self::new(world, fail, file)?;
        let found = read(&file);
        file.close(fail)?;
        found
    }

    /// Creates a file for writing.
    ///
    /// # Errors
    /// What `fail` makes of HDF5's error, the same on all ranks.
    pub fn create(world: &'a Group, path: &Path, fail: MakeError<'_>) -> Result<Self> {
        let file = || {
            File::with_options()
                .with_fapl(|p| {
                    p.mpio(world.raw(), None).all_coll_metadata_ops(true).coll_metadata_write(true)
                })
                .create(path)
        };
        Self::new(world, fail, file)
    }

    fn new(
        world: &'a Group,
        fail: MakeError<'_>,
        file: impl FnOnce() -> hdf5::Result<File>,
    ) -> Result<Self> {
        let late = fail(&"could not be opened on all ranks");
        let file = world.in_time(&late, || file().map_err(|e| fail(&e)))?;
        Ok(Self { world, file: ManuallyDrop::new(file) })
    }

    /// Closes the file. All ranks must have had the same outcomes before.
    ///
    /// # Errors
    /// As [`create`](Self::create).
    pub fn close(self, fail: MakeError<'_>) -> Result<()> {
        let late = fail(&"could not be closed on all ranks");
        let file = ManuallyDrop::into_inner(self.file);
        self.world.in_time(&late, || file.close().map_err(|e| fail(&e)))
    }
}

/// The numbers of a slab, row-major, read by this rank on its own.
///
/// # Errors
/// The error of HDF5.
pub fn read_slab(dataset: &Dataset, slab: &DatasetBox) -> hdf5::Result<Vec<f64>> {
    let values = dataset.read_slice::<f64, _, IxDyn>(selection(slab))?;
    Ok(values.into_raw_vec_and_offset().0)
}

/// A slab as HDF5 takes it.
pub(crate) fn selection(slab: &DatasetBox) -> Hyperslab {
    let along = |(&start, &count): (&usize, &usize)| SliceOrIndex::SliceTo {
        start,
        step: 1,
        end: start + count,
        block: 1,
    };
    Hyperslab::from(slab.start.iter().zip(&slab.count).map(along).collect::<Vec<_>>())
}
