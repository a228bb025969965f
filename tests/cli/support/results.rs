//! Files of HDF5: reads all datasets, bit for bit; writes and changes files.

use std::collections::BTreeMap;
use std::fs;
use std::path::Path;

/// The shape of a dataset and its bytes as stored in the file.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Stored {
    /// Extent of each dimension.
    pub shape: Vec<usize>,
    /// The elements, row-major.
    pub bytes: Vec<u8>,
}

impl Stored {
    /// The elements of a dataset of real numbers.
    pub fn numbers(&self) -> Vec<f64> {
        self.bytes
            .chunks_exact(8)
            .map(|b| f64::from_le_bytes(std::array::from_fn(|k| b[k])))
            .collect()
    }
}

/// Writes a new HDF5 file.
pub fn write_hdf5(
    path: &Path,
    write: impl FnOnce(&hdf5::File) -> hdf5::Result<()>,
) -> Result<(), String> {
    let written = path.with_extension("written");
    let file = hdf5::File::create(&written).map_err(|e| e.to_string())?;
    write(&file).and_then(|()| file.close()).map_err(|e| e.to_string())?;
    replace_by_copy(&written, path)
}

/// Changes an HDF5 file.
pub fn change_hdf5(
    path: &Path,
    change: impl FnOnce(&hdf5::File) -> hdf5::Result<()>,
) -> Result<(), String> {
    let file = hdf5::File::open_rw(path).map_err(|e| e.to_string())?;
    change(&file).and_then(|()| file.close()).map_err(|e| e.to_string())?;
    replace_by_copy(path, path)
}

/// Replaces `path` by a copy of `written`. Processes that other tests start while `written` is open
/// inherit its lock and keep it; nobody has opened the copy.
fn replace_by_copy(written: &Path, path: &Path) -> Result<(), String> {
    let copy = path.with_extension("copy");
    let done = fs::copy(written, &copy).and_then(|_| fs::rename(&copy, path));
    let removed =
        done.and_then(|()| if written == path { Ok(()) } else { fs::remove_file(written) });
    removed.map_err(|e| format!("{}: {e}", path.display()))
}

/// All datasets of `directory/result.h5` by their paths, in all groups, without attributes.
pub fn datasets(directory: &Path) -> Result<BTreeMap<String, Stored>, String> {
    datasets_of(&directory.join("result.h5"))
}

/// All datasets of a file, in the same way.
pub fn datasets_of(path: &Path) -> Result<BTreeMap<String, Stored>, String> {
    let read = || {
        let file = hdf5::File::open(path)?;
        let mut found = BTreeMap::new();
        collect(&file, &mut found)?;
        Ok(found)
    };
    read().map_err(|e: hdf5::Error| format!("{}: {e}", path.display()))
}

fn collect(group: &hdf5::Group, found: &mut BTreeMap<String, Stored>) -> hdf5::Result<()> {
    for dataset in group.datasets()? {
        found.insert(dataset.name(), stored(&dataset)?);
    }
    group.groups()?.iter().try_for_each(|g| collect(g, found))
}

fn stored(dataset: &hdf5::Dataset) -> hdf5::Result<Stored> {
    let kind = dataset.dtype()?;
    let mut bytes = vec![0u8; kind.size() * dataset.size()];
    // SAFETY: all elements are read in the type that they have in the file. It has a fixed size, so
    // they take as many bytes as the buffer has.
    let status = hdf5::sync::sync(|| unsafe {
        assert!(hdf5_sys::h5t::H5Tdetect_class(kind.id(), hdf5_sys::h5t::H5T_VLEN) == 0);
        assert!(hdf5_sys::h5t::H5Tis_variable_str(kind.id()) == 0);
        hdf5_sys::h5d::H5Dread(
            dataset.id(),
            kind.id(),
            hdf5_sys::h5s::H5S_ALL,
            hdf5_sys::h5s::H5S_ALL,
            hdf5_sys::h5p::H5P_DEFAULT,
            bytes.as_mut_ptr().cast(),
        )
    });
    if status < 0 {
        return Err(format!("{} cannot be read", dataset.name()).into());
    }
    Ok(Stored { shape: dataset.shape(), bytes })
}

/// The values of `/f` in `directory/result.h5`.
pub fn field(directory: &Path) -> Result<Vec<f64>, String> {
    let all = datasets(directory)?;
    let f = all.get("/f").ok_or_else(|| format!("{}: no /f in result.h5", directory.display()))?;
    Ok(f.numbers())
}

/// The names of the datasets that differ or that only one of the files has.
pub fn differences(a: &BTreeMap<String, Stored>, b: &BTreeMap<String, Stored>) -> Vec<String> {
    let names: std::collections::BTreeSet<&String> = a.keys().chain(b.keys()).collect();
    names.into_iter().filter(|name| a.get(*name) != b.get(*name)).cloned().collect()
}

/// Checks that the results have the bits of a `whole` run, except in the datasets `except`.
pub fn equals_whole(
    directory: &Path,
    whole: &BTreeMap<String, Stored>,
    except: &[&str],
) -> Result<(), String> {
    let mut differing = differences(&datasets(directory)?, whole);
    differing.retain(|name| !except.contains(&name.as_str()));
    if differing.is_empty() {
        return Ok(());
    }
    Err(format!("differs from the whole run in {differing:?}"))
}
