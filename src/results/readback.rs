//! Whether a file holds what was written: every dataset is read and its checksum compared with the
//! one it carries.

use crate::base::checksum;
use crate::base::checksum::Slab;
use crate::base::disk::failure;
use crate::base::error::{Error, Result};
use crate::parallel::communicator::Group;
use crate::parallel::files::{CHECKSUM, open, read_slab};
use crate::results::writer::Outcome;
use hdf5::types::{TypeDescriptor, VarLenUnicode};
use hdf5::{Dataset, File, Location};
use std::collections::BTreeMap;
use std::mem::ManuallyDrop;
use std::path::{Path, PathBuf};

/// Numbers read at a time: 4 MiB.
const PIECE: usize = 1 << 19;

/// Reads every dataset of the file, each piece on one rank, mostly another one than wrote it; gives
/// their number. Collective over `world`.
///
/// # Errors
/// [`Error::Output`], naming the first dataset that is not as written.
pub fn check(world: &Group, path: &Path) -> Result<usize> {
    let fail = |e: &dyn std::fmt::Display| failure(path, e);
    let opened = open(world, path).map_err(|e| fail(&e));
    // Closing waits for all ranks: a file that only some could open stays open.
    let file = ManuallyDrop::new(world.agree(opened)?);
    let compared = compare(world, path, &file);
    // All ranks have the same outcome, so that all close it.
    let closed = ManuallyDrop::into_inner(file).close();
    world.agree(closed.map_err(|e| fail(&e)))?;
    compared
}

/// Compares every dataset with the checksum it carries; gives their number. Collective.
fn compare(world: &Group, path: &Path, file: &File) -> Result<usize> {
    let mut sums = BTreeMap::new();
    let share = Share { rank: world.rank(), ranks: world.size() };
    let read = sums_of(share, file, &mut sums).map_err(|e| failure(path, &e));
    world.agree(read)?;
    if sums.is_empty() {
        return world.agree(Err(failure(path, &"holds no dataset with a checksum")));
    }
    for (name, (mine, expected)) in &sums {
        if world.sum_modulo(*mine) != *expected {
            return world.agree(Err(failure(path, &differs(name))));
        }
    }
    Ok(sums.len())
}

/// As [`check`], of an open file, by one process alone.
///
/// # Errors
/// What HDF5 says; the name of the first dataset that is not as written.
pub(crate) fn check_alone(file: &File) -> Outcome<()> {
    let mut sums = BTreeMap::new();
    sums_of(Share { rank: 0, ranks: 1 }, file, &mut sums)?;
    match sums.iter().find(|(_, (found, expected))| found != expected) {
        Some((name, _)) => Err(hdf5::Error::from(differs(name))),
        None => Ok(()),
    }
}

fn differs(name: &str) -> String {
    format!("dataset {name} is not as it was written (its checksum differs)")
}

/// The pieces of a file that a process reads: every `ranks`-th.
#[derive(Clone, Copy)]
struct Share {
    rank: usize,
    ranks: usize,
}

/// By name, this rank's part of the checksum of each dataset in the group and below, and the one
/// the dataset carries.
fn sums_of(
    share: Share,
    group: &hdf5::Group,
    sums: &mut BTreeMap<String, (u64, u64)>,
) -> Outcome<()> {
    for dataset in group.datasets()? {
        let name = dataset.name();
        let expected = (dataset.attr(CHECKSUM).and_then(|a| a.read_scalar()))
            .map_err(|_| hdf5::Error::from(format!("dataset {name} carries no checksum")))?;
        let mine = sum_of(share, &dataset)
            .map_err(|e| hdf5::Error::from(format!("dataset {name} cannot be read: {e}")))?;
        sums.insert(name, (mine, expected));
    }
    (group.groups()?.iter()).try_for_each(|group| sums_of(share, group, sums))
}

/// This rank's part of the checksum of a dataset.
fn sum_of(Share { rank, ranks }: Share, dataset: &Dataset) -> Outcome<u64> {
    if let TypeDescriptor::FixedUnicode(length) = dataset.dtype()?.to_descriptor()? {
        return if rank == 0 {
            Ok(checksum::of_text(&read_bytes(dataset, length)?))
        } else {
            Ok(0)
        };
    }
    let shape = dataset.shape();
    let mut sum: u64 = 0;
    for (k, slab) in Slab::pieces(&shape, PIECE).enumerate() {
        // One further than the ranks that wrote, as far as shares go by the first axis.
        if (k + 1) % ranks != rank {
            continue;
        }
        let values = read_slab(dataset, &slab)?;
        sum = sum.wrapping_add(checksum::of_slab(&shape, &slab, &values));
    }
    Ok(sum)
}

/// An attribute that [`crate::results::writer::text`] made.
pub(crate) fn text_attribute(at: &Location, name: &str) -> Outcome<String> {
    let text: VarLenUnicode = at.attr(name)?.read_scalar()?;
    Ok(text.to_string())
}

/// The text of a dataset that [`crate::results::writer::Writer::text`] wrote; an empty one is one
/// zero byte.
pub(crate) fn read_text(dataset: &Dataset) -> Outcome<String> {
    let bytes = read_bytes(dataset, dataset.dtype()?.size())?;
    let text = String::from_utf8(bytes).map_err(|e| hdf5::Error::from(e.to_string()))?;
    Ok(text.trim_end_matches('\0').to_owned())
}

/// Reads a text whose length is known at run time only, which the safe interface has no type for.
fn read_bytes(dataset: &Dataset, length: usize) -> Outcome<Vec<u8>> {
    let kind = dataset.dtype()?;
    if !dataset.is_scalar() || kind.size() != length {
        return Err(hdf5::Error::from("a text could not be read"));
    }
    let mut bytes = vec![0u8; length];
    // SAFETY: the dataset is scalar and of the type `kind`, which takes `length` bytes, and the
    // handles are alive.
    let status = unsafe {
        hdf5_sys::h5d::H5Dread(
            dataset.id(),
            kind.id(),
            hdf5_sys::h5s::H5S_ALL,
            hdf5_sys::h5s::H5S_ALL,
            hdf5_sys::h5p::H5P_DEFAULT,
            bytes.as_mut_ptr().cast(),
        )
    };
    if status >= 0 { Ok(bytes) } else { Err(hdf5::Error::from("a text could not be read")) }
}

/// As [`check`], of `directory/result.h5` and the warped fields beside it; gives the number of
/// datasets of each file.
///
/// # Errors
/// As [`check`]; [`Error::Input`] where there is no `result.h5`.
pub fn check_result(world: &Group, directory: &Path) -> Result<Vec<(PathBuf, usize)>> {
    let path = directory.join("result.h5");
    let fail = |what: &dyn std::fmt::Display| Error::Input(format!("{}: {what}", path.display()));
    world.agree(match std::fs::metadata(&path) {
        Ok(found) if found.is_file() => Ok(()),
        Ok(_) => Err(fail(&"is no file")),
        Err(e) => Err(fail(&e)),
    })?;
    // What there is is for one rank to say.
    let mut names = Vec::new();
    if world.rank() == 0
        && let Ok(entries) = std::fs::read_dir(directory)
    {
        let all = entries.filter_map(|entry| entry.ok()?.file_name().into_string().ok());
        names.extend(all.filter(|name| name.starts_with("warped_") && name.ends_with(".h5")));
        names.sort_unstable();
    }
    let names = world.broadcast_text(&names.join("\n"));
    ["result.h5"]
        .into_iter()
        .chain(names.lines())
        .map(|name| {
            let path = directory.join(name);
            let datasets = check(world, &path)?;
            Ok((path, datasets))
        })
        .collect()
}
