//! A file that all ranks write through MPI-IO. It has datasets over named axes, of which each rank
//! writes the slab that it holds.
//!
//! All ranks write metadata together. After each dataset they agree whether it was written, so that
//! none waits for a rank that failed. Each rank writes contiguous datasets on its own. Chunked
//! datasets are written by all ranks together, even those that have nothing to write, as HDF5 sends
//! the pieces of a chunk to the one rank that compresses it.
//!
//! Functions with the result [`Result`] are collective and fail with
//! [`crate::base::error::Error::Output`], the same on all ranks. After those with [`hdf5::Result`]
//! the ranks must agree on the outcome, as by [`metadata`](Writer::metadata).

use crate::base::disk::failure;
use crate::base::error::Result;
use crate::base::row_major::DatasetBox;
use crate::base::{checksum, machine};
use crate::parallel::communicator::Group;
use crate::parallel::files::{CHECKSUM, SharedFile};
use crate::problem::case::Storage;
use crate::problem::limits::{CHUNK, MOST_CHUNKS};
use hdf5::sync::sync;
use hdf5::types::{VarLenArray, VarLenUnicode};
use hdf5::{Dataset, File, H5Type, Location, ObjectReference1};
use hdf5_sys::h5i::hid_t;
use std::cell::RefCell;
use std::collections::BTreeMap;
use std::ffi::{CStr, CString};
use std::mem::ManuallyDrop;
use std::path::Path;

/// A dimension scale.
struct DimensionScale {
    /// Length of the scale.
    length: usize,
    /// Cells of a chunk along it, if the user gives a number.
    chunk: Option<usize>,
}

/// A text as a dataset stores it. Rank 0 has its bytes, every rank knows the rest.
pub struct StoredText {
    bytes: Vec<u8>,
    /// Number of bytes.
    pub length: usize,
    checksum: u64,
}

impl StoredText {
    /// A text that all ranks know.
    pub fn of_all_ranks(text: String) -> Self {
        // An empty text is stored as one zero byte.
        let bytes = if text.is_empty() { vec![0] } else { text.into_bytes() };
        Self { length: bytes.len(), checksum: checksum::of_text(&bytes), bytes }
    }

    /// A long text that rank 0 makes and keeps. Collective over `world`.
    pub fn of_first_rank(world: &Group, text: impl FnOnce() -> String) -> Self {
        let own = world.is_first().then(|| Self::of_all_ranks(text()));
        let mut words = own.as_ref().map_or([0; 2], |own| [own.length as u64, own.checksum]);
        world.broadcast_words(&mut words);
        let ([length, checksum], bytes) = (words, own.map_or(Vec::new(), |own| own.bytes));
        Self { bytes, length: length as usize, checksum }
    }
}

/// The file while it is written.
pub struct Writer<'a> {
    world: &'a Group,
    path: &'a Path,
    storage: &'a Storage,
    file: SharedFile<'a>,
    /// The first failure of what rank 0 writes alone, until the next collective step reports it.
    first_rank_error: RefCell<Option<hdf5::Error>>,
    scales: RefCell<BTreeMap<&'static str, DimensionScale>>,
}

/// A text in the form in which attributes store it.
pub fn text(s: &str) -> VarLenUnicode {
    // Zero bytes are left out, as HDF5 cannot store them.
    s.replace('\0', "").parse().unwrap_or_default()
}

/// Writes a new attribute.
pub fn attribute<T: H5Type>(at: &Location, name: &str, value: &T) -> hdf5::Result<()> {
    at.new_attr::<T>().create(name)?.write_scalar(value)
}

impl<'a> Writer<'a> {
    /// Creates the file, of at most `bytes` bytes. Collective over `world`.
    ///
    /// If the file system can, space is reserved before anything is written. Then a full disk is an
    /// error of one call on one rank, and not of a collective call, in which HDF5 would leave the
    /// other ranks waiting.
    pub fn create(
        world: &'a Group,
        path: &'a Path,
        bytes: u64,
        storage: &'a Storage,
    ) -> Result<Self> {
        let file = SharedFile::create(world, path, &|e| failure(path, e))?;
        world.on_first_rank(|| machine::reserve(path, bytes).map_err(|e| failure(path, &e)))?;
        Ok(Self {
            world,
            path,
            storage,
            file,
            first_rank_error: RefCell::new(None),
            scales: RefCell::default(),
        })
    }

    /// The file, for attributes and groups.
    pub fn file(&self) -> &File {
        &self.file
    }

    /// Creates a group. Collective.
    pub fn group(&self, name: &str) -> Result<()> {
        self.metadata(|| self.file.create_group(name).map(drop))
    }

    /// Makes all ranks agree on the outcome of a step of all ranks, and of the steps that rank 0
    /// wrote alone.
    fn agree<T>(&self, outcome: hdf5::Result<T>) -> Result<T> {
        self.world.agree_in_time(self.or_first_rank_error(outcome))
    }

    /// Writes metadata, by all ranks together, and agrees on the outcome. HDF5 writes what it holds
    /// back at any of these steps. Where that fails, all ranks may wait for each other: then the
    /// job ends.
    pub fn metadata<T>(&self, write: impl FnOnce() -> hdf5::Result<T>) -> Result<T> {
        let late = failure(self.path, &"could not be written on all ranks");
        self.world.in_time(&late, || self.or_first_rank_error(write()))
    }

    /// The outcome of a step, or of the earlier one that rank 0 wrote alone, if that failed.
    fn or_first_rank_error<T>(&self, outcome: hdf5::Result<T>) -> Result<T> {
        let outcome = self.first_rank_error.take().map_or(outcome, Err);
        outcome.map_err(|e| failure(self.path, &e))
    }

    /// Lets rank 0 write something alone.
    fn by_first_rank(&self, write: impl FnOnce() -> hdf5::Result<()>) {
        if self.world.is_first()
            && let Err(error) = write()
        {
            self.first_rank_error.borrow_mut().get_or_insert(error);
        }
    }

    /// Writes a scalar text dataset of fixed length, as parallel HDF5 does not write texts of
    /// variable length.
    pub fn text(&self, name: &str, value: &StoredText) -> hdf5::Result<Dataset> {
        let dataset = self
            .file
            .new_dataset_builder()
            .empty_as(hdf5::types::TypeDescriptor::FixedUnicode(value.length))
            .create(name)?;
        attribute(&dataset, CHECKSUM, &value.checksum)?;
        self.by_first_rank(|| write_bytes(&dataset, &value.bytes));
        Ok(dataset)
    }

    /// Writes, by rank 0, a list of numbers that all ranks know.
    pub fn list(&self, name: &str, values: &[f64], what: Option<&str>) -> hdf5::Result<Dataset> {
        let dataset = self.file.new_dataset::<f64>().shape(values.len()).create(name)?;
        if let Some(what) = what {
            attribute(&dataset, "long_name", &text(what))?;
        }
        attribute(&dataset, "units", &text("1"))?;
        let sum = checksum::run_checksum(0, values.iter().map(|x| x.to_bits()));
        attribute(&dataset, CHECKSUM, &sum)?;
        self.by_first_rank(|| dataset.write(values));
        Ok(dataset)
    }

    /// Writes a dimension scale in the root, where netCDF readers look for it, and links it from
    /// `/axis`. `chunk` is the number of cells of a chunk along it, if the user gives one.
    pub fn scale(
        &self,
        name: &'static str,
        values: &[f64],
        chunk: Option<usize>,
    ) -> hdf5::Result<Dataset> {
        let dataset = self.list(name, values, None)?;
        terminated_text(&dataset, "CLASS", c"DIMENSION_SCALE")?;
        terminated_text(&dataset, "NAME", &CString::new(name).unwrap_or_default())?;
        self.file.link_hard(&format!("/{name}"), &format!("/axis/{name}"))?;
        let length = values.len();
        self.scales.borrow_mut().insert(name, DimensionScale { length, chunk });
        Ok(dataset)
    }

    fn create_field(&self, name: &str, axes: &[&str], what: &str) -> hdf5::Result<Dataset> {
        let known = self.scales.borrow();
        let scales: Vec<&DimensionScale> = axes.iter().map(|a| &known[a]).collect();
        let shape: Vec<usize> = scales.iter().map(|s| s.length).collect();
        let mut builder = self.file.new_dataset::<f64>().shape(&shape[..]);
        if let Some(chunk) = chunks(&scales, self.storage) {
            // HDF5 need not fill chunks, as all values are written.
            builder = builder.chunk(chunk).fill_time(hdf5::plist::dataset_create::FillTime::Never);
            if self.storage.compression > 0 {
                builder = builder.shuffle().deflate(self.storage.compression);
            }
        }
        let dataset = builder.create(name)?;
        attribute(&dataset, "long_name", &text(what))?;
        attribute(&dataset, "units", &text("1"))?;
        // Dimension scales by the HDF5 specification: one list of references per dimension.
        let scale = |axis: &&str| {
            let path = format!("/{axis}");
            let reference = self.file.reference::<ObjectReference1>(&path)?;
            Ok(VarLenArray::from_slice(&[reference]))
        };
        let list = axes.iter().map(scale).collect::<hdf5::Result<Vec<_>>>()?;
        dataset
            .new_attr::<VarLenArray<ObjectReference1>>()
            .shape(list.len())
            .create("DIMENSION_LIST")?
            .write(&list)?;
        Ok(dataset)
    }

    /// Writes a dataset over `axes` of which each rank has `slabs`. Every rank has the same number
    /// of slabs, some of which may be empty.
    pub fn field(
        &self,
        name: &str,
        axes: &[&str],
        slabs: &[(DatasetBox, &[f64])],
        what: &str,
    ) -> Result<()> {
        let mut field = self.slabs(name, axes, what)?;
        for (slab, values) in slabs {
            // No rank begins with the next slab before all have written this one.
            field.write(slab, values)?;
        }
        field.finish()
    }

    /// Writes, by the first rank, a dataset over one axis that is the same on all ranks.
    pub fn replicated(&self, name: &str, axis: &str, values: &[f64], what: &str) -> Result<()> {
        let count = if self.world.is_first() { values.len() } else { 0 };
        let slab = DatasetBox::whole(&[count]);
        self.field(name, &[axis], &[(slab, &values[..count])], what)
    }

    /// Creates a dataset over `axes`, which the caller writes slab by slab.
    pub fn slabs(&self, name: &str, axes: &[&str], what: &str) -> Result<Slabs<'_>> {
        let dataset = ManuallyDrop::new(self.metadata(|| self.create_field(name, axes, what))?);
        Ok(Slabs {
            writer: self,
            shape: dataset.shape(),
            together: dataset.is_chunked(),
            dataset,
            sum: 0,
        })
    }

    /// Closes the file.
    pub fn close(self) -> Result<()> {
        // With everything on the disk, the rest takes little time.
        let flushed = machine::flush(self.path).map_err(|e| failure(self.path, &e));
        self.world.agree(flushed)?;
        self.metadata(|| self.file.flush())?;
        self.file.close(&|e| failure(self.path, e))?;
        self.world
            .on_first_rank(|| machine::give_back(self.path).map_err(|e| failure(self.path, &e)))
    }
}

/// A dataset while it is written.
pub struct Slabs<'a> {
    writer: &'a Writer<'a>,
    /// The dataset. After an error it is not closed, like the file.
    dataset: ManuallyDrop<Dataset>,
    shape: Vec<usize>,
    /// Whether all ranks write together.
    together: bool,
    /// The part of this rank in the checksum.
    sum: u64,
}

impl Slabs<'_> {
    /// Writes this rank's next slab. Every rank writes the same number of slabs, some of which may
    /// be empty. No two slabs overlap.
    pub fn write(&mut self, slab: &DatasetBox, values: &[f64]) -> Result<()> {
        let part = checksum::of_slab(&self.shape, slab, values);
        self.sum = self.sum.wrapping_add(part);
        self.writer.agree(write_slab(&self.dataset, slab, values, self.together))
    }

    /// Writes the checksum of the complete dataset.
    pub fn finish(self) -> Result<()> {
        let sum = self.writer.world.sum_modulo(self.sum);
        self.writer.metadata(|| attribute(&self.dataset, CHECKSUM, &sum))?;
        drop(ManuallyDrop::into_inner(self.dataset));
        Ok(())
    }
}

/// Chunks of a dataset over `scales`, if it has any: along each axis the number of cells that the
/// user gives. If none is given, chunks take whole axes from the last one on, up to [`CHUNK`]
/// cells, or more if there would be too many chunks.
fn chunks(scales: &[&DimensionScale], storage: &Storage) -> Option<Vec<usize>> {
    if storage.compression == 0 && storage.chunks.is_none() {
        return None;
    }
    let size: usize = scales.iter().map(|s| s.length).product();
    // A chunk has at least half of this, and half of all chunks may be cut by the end of an axis.
    let mut room = CHUNK.max(size / (MOST_CHUNKS / 4));
    let mut chunk: Vec<usize> = (scales.iter().rev())
        .map(|scale| {
            let cells = scale.chunk.unwrap_or(room).min(scale.length).max(1);
            room = (room / cells).max(1);
            cells
        })
        .collect();
    chunk.reverse();
    Some(chunk)
}

/// Writes an attribute that is a zero-terminated text. The dimension-scale interface of HDF5 takes
/// only this kind, and the safe interface cannot write it.
fn terminated_text(at: &Dataset, name: &str, value: &CStr) -> hdf5::Result<()> {
    use hdf5_sys::{h5a, h5p::H5P_DEFAULT, h5s, h5t};
    let name = CString::new(name).unwrap_or_default();
    // SAFETY: no other thread is in the library (`sync`). The dataset is open as long as `at` is
    // borrowed; each other handle is made and closed here, and of one that could not be made the
    // library says so. Both texts end with a zero, and `kind` is as long as the value.
    let written = sync(|| unsafe {
        let kind = h5t::H5Tcopy(*h5t::H5T_C_S1);
        let sized = h5t::H5Tset_size(kind, value.to_bytes_with_nul().len());
        let scalar = h5s::H5Screate(h5s::H5S_class_t::H5S_SCALAR);
        let attribute =
            h5a::H5Acreate2(at.id(), name.as_ptr(), kind, scalar, H5P_DEFAULT, H5P_DEFAULT);
        let written = h5a::H5Awrite(attribute, kind, value.as_ptr().cast());
        let closed = [h5a::H5Aclose(attribute), h5s::H5Sclose(scalar), h5t::H5Tclose(kind)];
        sized.min(written).min(closed.into_iter().min().unwrap_or(0))
    });
    if written >= 0 { Ok(()) } else { Err("an attribute could not be written".into()) }
}

/// Writes a text whose length is known only at run time; the safe interface has no type for it.
fn write_bytes(dataset: &Dataset, bytes: &[u8]) -> hdf5::Result<()> {
    let kind = dataset.dtype()?;
    assert!(dataset.is_scalar() && kind.size() == bytes.len(), "a text and its dataset");
    // SAFETY: no other thread is in the library (`sync`). The dataset has one element, of the type
    // `kind` and as long as `bytes`, and both are open as long as they are borrowed.
    let status = sync(|| unsafe {
        hdf5_sys::h5d::H5Dwrite(
            dataset.id(),
            kind.id(),
            hdf5_sys::h5s::H5S_ALL,
            hdf5_sys::h5s::H5S_ALL,
            hdf5_sys::h5p::H5P_DEFAULT,
            bytes.as_ptr().cast(),
        )
    });
    if status >= 0 { Ok(()) } else { Err("a text could not be written".into()) }
}

/// The property list of a transfer, which the caller closes, and its status: below 0 for a failure.
fn transfer_list(together: bool) -> (hid_t, i32) {
    use hdf5_sys::h5p;
    // SAFETY: no other thread is in the library (`sync`); the list is made here, and where it could
    // not be, the library says so.
    sync(|| unsafe {
        let transfer = h5p::H5Pcreate(*h5p::H5P_CLS_DATASET_XFER);
        if !together {
            return (transfer, 0);
        }
        let collective =
            h5p::H5Pset_dxpl_mpio(transfer, h5p::H5FD_mpio_xfer_t::H5FD_MPIO_COLLECTIVE);
        // All chunks are written at once at the end. Otherwise ranks would wait for one that failed
        // in between.
        let at_once = h5p::H5Pset_dxpl_mpio_chunk_opt(
            transfer,
            h5p::H5FD_mpio_chunk_opt_t::H5FD_MPIO_CHUNK_ONE_IO,
        );
        (transfer, collective.min(at_once))
    })
}

/// Selects the elements of `slab` in the space `there` of a dataset; none there and in `here` if
/// the slab `is_empty`. Returns the status, below 0 for a failure.
///
/// # Safety
/// No other thread is in the library, and the slab has a number for each dimension of `there`.
unsafe fn select(there: hid_t, here: hid_t, slab: &DatasetBox, is_empty: bool) -> i32 {
    use hdf5_sys::h5s;
    let numbers = |list: &[usize]| -> Vec<u64> { list.iter().map(|&n| n as u64).collect() };
    let (start, count) = (numbers(&slab.start), numbers(&slab.count));
    let one = vec![1; start.len()];
    // SAFETY: as the caller promises, and the library refuses handles that could not be made.
    unsafe {
        if is_empty {
            return h5s::H5Sselect_none(there).min(h5s::H5Sselect_none(here));
        }
        h5s::H5Sselect_hyperslab(
            there,
            h5s::H5S_seloper_t::H5S_SELECT_SET,
            start.as_ptr(),
            std::ptr::null(),
            one.as_ptr(),
            count.as_ptr(),
        )
    }
}

/// Writes this rank's slab. If `together`, all ranks write at once, even with an empty slab.
fn write_slab(
    dataset: &Dataset,
    slab: &DatasetBox,
    values: &[f64],
    together: bool,
) -> hdf5::Result<()> {
    use hdf5_sys::{h5d, h5p, h5s, h5t};
    assert_eq!(slab.size(), values.len(), "a slab and its values");
    assert_eq!(slab.start.len(), dataset.ndim(), "a slab and its dataset");
    if values.is_empty() && !together {
        return Ok(());
    }
    let size = values.len() as u64;
    // SAFETY: no other thread is in the library (`sync`). The dataset is open as long as it is
    // borrowed; each other handle is made and closed here, and of one that could not be made the
    // library says so. The slab has a number for each dimension of the dataset. The library reads
    // as many numbers as `here` has selected, which are those of `values`: all, or none where there
    // are none.
    sync(|| unsafe {
        let (transfer, mut status) = transfer_list(together);
        let there = h5d::H5Dget_space(dataset.id());
        let here = h5s::H5Screate_simple(1, &size.max(1), std::ptr::null());
        status = status.min(select(there, here, slab, values.is_empty()));
        // Ranks also call this after a failure, as others may already wait in it.
        let written = h5d::H5Dwrite(
            dataset.id(),
            *h5t::H5T_NATIVE_DOUBLE,
            here,
            there,
            transfer,
            values.as_ptr().cast(),
        );
        let outcome = if status.min(written) < 0 {
            Err(hdf5::Error::query().unwrap_or_else(|e| e))
        } else {
            Ok(())
        };
        h5s::H5Sclose(there);
        h5s::H5Sclose(here);
        h5p::H5Pclose(transfer);
        outcome
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn planned_chunks() {
        let of = |lengths: &[(usize, Option<usize>)], compression| {
            let scales: Vec<DimensionScale> =
                (lengths.iter()).map(|&(length, chunk)| DimensionScale { length, chunk }).collect();
            let storage =
                Storage { compression, chunks: lengths[0].1.map(|_| Vec::new()), xdmf: false };
            chunks(&scales.iter().collect::<Vec<_>>(), &storage)
        };
        assert_eq!(of(&[(9, None), (9, None)], 0), None);
        assert_eq!(of(&[(9, None), (11, None)], 1), Some(vec![9, 11]));
        assert_eq!(of(&[(1 << 20, None)], 1), Some(vec![1 << 15]));
        assert_eq!(of(&[(500, None), (1000, None)], 9), Some(vec![32, 1000]));
        assert_eq!(of(&[(500, None), (1 << 16, None)], 9), Some(vec![1, 1 << 15]));
        // No more chunks than can be written.
        let many = of(&[(1 << 20, None), (1 << 12, None)], 9);
        assert_eq!(many, Some(vec![1 << 8, 1 << 12]));
        // The user's chunks hold with and without compression, cut to the axis.
        assert_eq!(of(&[(9, Some(4)), (11, Some(40))], 0), Some(vec![4, 11]));
    }
}
