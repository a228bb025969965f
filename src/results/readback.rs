//! Checks that a file holds the values that were written: every dataset is read, and its checksum
//! is compared with the stored one.

use crate::base::checksum;
use crate::base::disk::failure;
use crate::base::error::Result;
use crate::base::row_major::DatasetBox;
use crate::parallel::communicator::Group;
use crate::parallel::files::{SharedFile, read_slab, stored_checksum};
use crate::problem::table::check_size;
use hdf5::filters::Filter;
use hdf5::plist::dataset_create::Layout;
use hdf5::sync::sync;
use hdf5::types::{TypeDescriptor, VarLenUnicode};
use hdf5::{Dataset, File, LinkType, Location, LocationToken, LocationType};
use serde::{Deserialize, Serialize};
use std::collections::BTreeMap;
use std::path::Path;

/// Largest number of values read at a time: 4 MiB.
pub(crate) const PIECE: usize = 1 << 19;
/// The largest number of objects in a file: several times what a run writes.
const MOST_OBJECTS: usize = 1000;
/// The deepest nesting of groups in a file, also more than a run writes.
const DEEPEST: usize = 6;
/// Bytes of a chunk that may be larger than its dataset. HDF5 reads a chunk as a whole, so that a
/// few numbers could take seconds.
const LARGEST_CHUNK: u64 = 1 << 20;
/// Largest factor by which deflate makes a dataset smaller.
const MOST_DEFLATED: u64 = 1040;

/// For each dataset, by its name, a part of its checksum, and the stored checksum.
pub type ChecksumParts = BTreeMap<String, [u64; 2]>;

/// Reads every dataset of a file that this run wrote and compares checksums; returns the number of
/// datasets. Each piece is read by one rank, mostly not the one that wrote it. Collective over
/// `world`.
///
/// # Errors
/// [`crate::base::error::Error::Output`], naming the first dataset that is not as written.
pub fn check(world: &Group, path: &Path) -> Result<usize> {
    let fail = |e: &dyn std::fmt::Display| failure(path, e);
    let share = FileShare { rank: world.rank(), ranks: world.size() };
    SharedFile::read(world, path, &fail, |file| {
        let sums = datasets(file).and_then(|all| sums_of(share, all, |_, _| Ok(())));
        compare(world, path, &world.agree(sums.map_err(|e| fail(&e)))?)
    })
}

/// Compares the sums of the ranks' parts with the stored checksums; returns the number of datasets.
/// Collective.
pub(crate) fn compare(world: &Group, path: &Path, sums: &ChecksumParts) -> Result<usize> {
    let fail = |what: &str| world.agree(Err(failure(path, &what)));
    if !world.same(sums.len() as u64) {
        return fail("holds other datasets on some ranks");
    }
    if sums.is_empty() {
        return fail("holds no dataset with a checksum");
    }
    let mut found: Vec<i64> = sums.values().map(|[mine, _]| *mine as i64).collect();
    world.sum_integers(&mut found);
    let differing =
        sums.iter().zip(found).find(|((_, [_, expected]), sum)| *sum as u64 != *expected);
    world.agree(match differing {
        Some(((name, _), _)) => Err(failure(path, &differs(name))),
        None => Ok(sums.len()),
    })
}

/// The message about a dataset whose checksum differs.
pub(crate) fn differs(name: &str) -> String {
    format!("dataset {name} is not as it was written (its checksum differs)")
}

/// The pieces of a file that a process reads: every `ranks`-th.
#[derive(Clone, Copy, Debug, Serialize, Deserialize)]
pub struct FileShare {
    /// Number of the process.
    pub rank: usize,
    /// Number of processes.
    pub ranks: usize,
}

impl FileShare {
    /// The share of a process that reads alone.
    pub const WHOLE: Self = Self { rank: 0, ranks: 1 };
}

/// The datasets of a file by their names. Links other than hard ones, and more objects or groups
/// than a run writes, are errors. A dataset with several names is listed once, by the name that is
/// found last.
pub(crate) fn datasets(file: &hdf5::Group) -> hdf5::Result<BTreeMap<String, Dataset>> {
    let (mut found, mut objects) = (BTreeMap::<String, (LocationToken, Dataset)>::new(), 0);
    let mut left = vec![(file.group("/")?, String::new(), 0)];
    while let Some((group, path, depth)) = left.pop() {
        let mut names = Vec::new();
        group.iter_visit_default(|name, link| {
            objects += 1;
            if objects > MOST_OBJECTS {
                return Err(format!("holds more than {MOST_OBJECTS} objects").into());
            }
            if link.link_type != LinkType::Hard {
                return Err(format!("{path}/{name} leads elsewhere, which no run writes").into());
            }
            names.push(name.to_owned());
            Ok(())
        })?;
        for name in names {
            let place = format!("{path}/{name}");
            let info = group.loc_info_by_name(&name)?;
            match info.loc_type {
                LocationType::Group if depth == DEEPEST => {
                    let what = format!("holds more than {DEEPEST} groups in each other");
                    return Err(what.into());
                }
                LocationType::Group => left.push((group.group(&name)?, place, depth + 1)),
                LocationType::Dataset => {
                    found.retain(|_, (token, _)| *token != info.token);
                    found.insert(place, (info.token, group.dataset(&name)?));
                }
                _ => return Err(format!("{place} is no dataset").into()),
            }
        }
    }
    Ok(found.into_iter().map(|(place, (_, dataset))| (place, dataset)).collect())
}

/// Checks that a dataset can be read: its values are in this file, and as many as its shape says.
/// Returns the bytes of a chunk, or 0 without chunks.
pub(crate) fn check_readable(dataset: &Dataset, file_bytes: u64) -> hdf5::Result<u64> {
    let list = dataset.dcpl()?;
    if !list.external().is_empty() || list.layout() == Layout::Virtual {
        return Err("its values are in another file".into());
    }
    let filters = list.filters();
    if let Some(other) = filters.iter().find(|f| matches!(f, Filter::User(..))) {
        return Err(format!("is stored by a filter that is not known ({other:?})").into());
    }
    let size = dataset.dtype()?.size();
    let bytes = |lengths: &[usize]| {
        let all = lengths.iter().try_fold(size, |bytes, &n| bytes.checked_mul(n));
        all.map_or(u64::MAX, |bytes| bytes as u64)
    };
    let shape = dataset.shape();
    let (all, there) = (bytes(&shape), dataset.storage_size());
    let most = if filters.is_empty() { there } else { there.saturating_mul(MOST_DEFLATED) };
    if all > most || there > file_bytes.saturating_add(size as u64) {
        return Err(format!(
            "its shape is {shape:?}, and {there} bytes of it are there, in a file of {file_bytes}"
        )
        .into());
    }
    let chunk = dataset.chunk().map_or(0, |chunk| bytes(&chunk));
    if chunk > LARGEST_CHUNK.max(all) {
        return Err(format!("its chunks of {chunk} bytes are larger than it is").into());
    }
    Ok(chunk)
}

/// Refuses a dataset `name` that does not hold real numbers.
pub(crate) fn refuse_other_than_reals(
    name: &str,
    dataset: &Dataset,
) -> std::result::Result<(), String> {
    match dataset.dtype().and_then(|kind| kind.to_descriptor()) {
        Ok(TypeDescriptor::Float(_) | TypeDescriptor::Integer(_)) => Ok(()),
        _ => Err(format!("/{name} holds other than real numbers, which are expected")),
    }
}

/// The numbers of the dataset `name`, which may be as large as a table, or a sentence that says
/// what is wrong with it.
pub(crate) fn numbers(name: &str, dataset: &Dataset) -> std::result::Result<Vec<f64>, String> {
    check_size(&dataset.shape()).map_err(|what| format!("/{name}: {what}"))?;
    refuse_other_than_reals(name, dataset)?;
    dataset.read_raw().map_err(|e| format!("/{name}: {e}"))
}

/// For each dataset of `all`, by its name, a share of its checksum, and the stored checksum. Calls
/// `visit` with the name and the values of each piece that is read.
pub(crate) fn sums_of(
    share: FileShare,
    all: BTreeMap<String, Dataset>,
    mut visit: impl FnMut(&str, &[f64]) -> hdf5::Result<()>,
) -> hdf5::Result<ChecksumParts> {
    let sum = |(name, dataset): (String, Dataset)| {
        let expected =
            stored_checksum(&dataset).map_err(|_| format!("dataset {name} carries no checksum"))?;
        let mine = sum_of(share, &dataset, |values| visit(&name, values))
            .map_err(|e| format!("dataset {name} {e}"))?;
        Ok((name, [mine, expected]))
    };
    all.into_iter().map(sum).collect()
}

/// A share of the checksum of a dataset. Calls `visit` with the values of each piece.
pub(crate) fn sum_of(
    FileShare { rank, ranks }: FileShare,
    dataset: &Dataset,
    mut visit: impl FnMut(&[f64]) -> hdf5::Result<()>,
) -> hdf5::Result<u64> {
    let unread = |e: hdf5::Error| hdf5::Error::from(format!("cannot be read: {e}"));
    let written = dataset.dtype().and_then(|written| written.to_descriptor());
    if let TypeDescriptor::FixedUnicode(length) = written.map_err(unread)? {
        return match rank {
            0 => read_bytes(dataset, length).map(|text| checksum::of_text(&text)).map_err(unread),
            _ => Ok(0),
        };
    }
    let shape = dataset.shape();
    let mut sum: u64 = 0;
    for (k, slab) in DatasetBox::pieces(&shape, PIECE).enumerate() {
        // Shifted by one rank, so that mostly another rank reads a piece than wrote it.
        if (k + 1) % ranks != rank {
            continue;
        }
        let values = read_slab(dataset, &slab).map_err(unread)?;
        visit(&values).map_err(|e| format!("is not as it was written: {e}"))?;
        sum = sum.wrapping_add(checksum::of_slab(&shape, &slab, &values));
    }
    Ok(sum)
}

/// The case of a result: its dataset `/case`, and the `--set` options beside it.
pub(crate) struct StoredCase {
    dataset: Dataset,
    pub overrides: Vec<String>,
}

impl StoredCase {
    /// The case in `file`.
    pub fn read(file: &File) -> hdf5::Result<Self> {
        let dataset = file.dataset("case")?;
        let overrides = text_attribute(&dataset, "overrides")?;
        let overrides = overrides.lines().map(str::to_owned).collect();
        Ok(Self { dataset, overrides })
    }

    /// The case in `file`, without options where the file has none that can be read.
    pub fn read_leniently(file: &File) -> hdf5::Result<Self> {
        Self::read(file).or_else(|_| Ok(Self { dataset: file.dataset("case")?, overrides: vec![] }))
    }

    /// Checks that the case file has the checksum that is stored with it.
    pub fn check(&self) -> hdf5::Result<()> {
        let expected = stored_checksum(&self.dataset)?;
        if sum_of(FileShare::WHOLE, &self.dataset, |_| Ok(()))? == expected {
            Ok(())
        } else {
            Err(differs("/case").into())
        }
    }

    /// The case file.
    pub fn text(&self) -> hdf5::Result<String> {
        read_text(&self.dataset)
    }
}

/// An attribute that [`crate::results::writer::text`] made.
pub(crate) fn text_attribute(at: &Location, name: &str) -> hdf5::Result<String> {
    let text: VarLenUnicode = at.attr(name)?.read_scalar()?;
    utf8(text.as_bytes().to_vec())
}

/// An attribute that is a number.
pub(crate) fn number_attribute(at: &Location, name: &str) -> hdf5::Result<f64> {
    at.attr(name)?.read_scalar()
}

/// A text of a file, which the HDF5 crate takes for UTF-8 unchecked.
fn utf8(bytes: Vec<u8>) -> hdf5::Result<String> {
    String::from_utf8(bytes).map_err(|e| hdf5::Error::from(e.to_string()))
}

/// The text of a dataset that [`crate::results::writer::Writer::text`] wrote; an empty one is one
/// zero byte.
pub(crate) fn read_text(dataset: &Dataset) -> hdf5::Result<String> {
    let text = utf8(read_bytes(dataset, dataset.dtype()?.size())?)?;
    Ok(text.trim_end_matches('\0').to_owned())
}

/// Reads a text whose length is known only at run time; the safe interface has no type for it.
fn read_bytes(dataset: &Dataset, length: usize) -> hdf5::Result<Vec<u8>> {
    let kind = dataset.dtype()?;
    if !dataset.is_scalar() || kind.size() != length {
        return Err(hdf5::Error::from("a text could not be read"));
    }
    let mut bytes = vec![0u8; length];
    // SAFETY: no other thread is in the library (`sync`). The dataset has one element, of the type
    // `kind` and as long as `bytes`, and both are open as long as they are borrowed.
    let status = sync(|| unsafe {
        hdf5_sys::h5d::H5Dread(
            dataset.id(),
            kind.id(),
            hdf5_sys::h5s::H5S_ALL,
            hdf5_sys::h5s::H5S_ALL,
            hdf5_sys::h5p::H5P_DEFAULT,
            bytes.as_mut_ptr().cast(),
        )
    });
    if status >= 0 { Ok(bytes) } else { Err(hdf5::Error::from("a text could not be read")) }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::results::writer::text;

    /// The file says UTF-8, and the bytes are not: an error, no text that crashes its readers.
    #[test]
    fn attributes_that_are_not_utf8_are_refused() {
        let directory = tempfile::tempdir().expect("a directory");
        let path = directory.path().join("attributes.h5");
        let file = hdf5::File::create(&path).expect("a file");
        for value in ["first", "second"] {
            let attribute = file.new_attr::<VarLenUnicode>().create(value).expect("an attribute");
            attribute.write_scalar(&text(&format!("the {value}"))).expect("written");
        }
        drop(file);
        let mut bytes = std::fs::read(&path).expect("a file");
        let at = bytes.windows(10).position(|found| found == b"the second").expect("the text");
        bytes[at + 9] = 0xff;
        std::fs::write(&path, bytes).expect("a file");
        let file = hdf5::File::open(&path).expect("a file");
        assert_eq!(text_attribute(&file, "first").expect("a text"), "the first");
        let refused = text_attribute(&file, "second").map_err(|e| e.to_string());
        assert!(refused.as_ref().is_err_and(|e| e.contains("utf-8")), "{refused:?}");
    }
}
