//! Sizes and checksums of a run's files, which `summary.json` lists together with a checksum of
//! itself.
//!
//! The checksums inside of `result.h5` are those of its datasets, which do not depend on ranks. The
//! checksums of files also cover attributes and everything else that HDF5 stores.

use crate::base::checksum::{self, FileChecksum, FileChecksums};
use crate::base::disk::failure;
use crate::base::error::{Error, Result};
use crate::parallel::communicator::Group;
use crate::results::summary;
use serde::Deserialize;
use serde_json::Value;
use std::path::Path;

/// Checksums of the files `names` of `directory`, as far as they exist. Collective over `world`.
///
/// # Errors
/// [`Error::Output`], the same on all ranks.
pub fn of_files(world: &Group, directory: &Path, names: &[String]) -> Result<FileChecksums> {
    let exists = |name: &&String| directory.join(name).is_file();
    // One rank decides which files exist, as ranks may see different states of the directory.
    let there: Vec<String> =
        world.of_first_rank(|| Ok(names.iter().filter(exists).cloned().collect()))?;
    of_existing(world, directory, there)
}

/// Checksums of files, each read by all ranks. Collective.
fn of_existing(world: &Group, directory: &Path, names: Vec<String>) -> Result<FileChecksums> {
    let part = |name: &String| {
        let path = directory.join(name);
        checksum::of_file(&path, world.rank(), world.size()).map_err(|e| failure(&path, &e))
    };
    let parts: Vec<FileChecksum> = world.agree(names.iter().map(part).collect())?;
    // The length is that which the first rank sees.
    let numbers = |part: &FileChecksum| {
        let bytes = if world.is_first() { part.bytes } else { 0 };
        [part.checksum as i64, bytes as i64]
    };
    let mut sums: Vec<[i64; 2]> = parts.iter().map(numbers).collect();
    world.sum_integers(sums.as_flattened_mut());
    let found = |[checksum, bytes]: [i64; 2]| FileChecksum {
        bytes: bytes as u64,
        checksum: checksum as u64,
    };
    Ok(names.into_iter().zip(sums.into_iter().map(found)).collect())
}

/// Compares the files of `directory` with their checksums. Collective over `world`.
///
/// # Errors
/// [`Error::Output`], the same on all ranks, which names a file that cannot be read, or else the
/// first one that has changed.
pub fn check(world: &Group, directory: &Path) -> Result<FileChecksums> {
    let expected = world.of_first_rank(|| of_all(directory))?;
    let found = of_existing(world, directory, expected.keys().cloned().collect())?;
    compare(directory, &expected, |name| Ok(found[name]))?;
    Ok(expected)
}

/// Compares the files of `directory` with their checksums, as [`check`] does, by one process alone.
///
/// # Errors
/// As [`check`].
pub fn check_alone(directory: &Path) -> Result<()> {
    compare(directory, &of_all(directory)?, |name| of_file_alone(&directory.join(name)))
}

fn of_file_alone(path: &Path) -> Result<FileChecksum> {
    checksum::of_file(path, 0, 1).map_err(|e| failure(path, &e))
}

fn compare(
    directory: &Path,
    all: &FileChecksums,
    found: impl Fn(&str) -> Result<FileChecksum>,
) -> Result<()> {
    let differs = |(name, expected): (&String, &FileChecksum)| {
        if found(name)? == *expected { Ok(()) } else { Err(changed(&directory.join(name))) }
    };
    all.iter().try_for_each(differs)
}

/// The error that the file `name` of `directory` has another size or checksum than `summary.json`
/// gives; `None` if it has not, if it cannot be read, or if there is no such checksum. By one
/// process alone.
pub(crate) fn damage(directory: &Path, name: &str) -> Option<Error> {
    let expected = of_summary(directory).ok()?.remove(name)?;
    let path = directory.join(name);
    let changed = || (of_file_alone(&path).ok()? != expected).then(|| changed(&path));
    resized(&path, &expected).or_else(changed)
}

/// Compares the files of `directory` that are there with their sizes, without reading them: a file
/// may have grown to any size. By one process alone.
///
/// # Errors
/// [`Error::Output`], which names a file that has another size, or `summary.json` if that is not as
/// it was written.
pub(crate) fn check_sizes(directory: &Path) -> Result<()> {
    compare_sizes(directory, &of_summary(directory)?)
}

fn compare_sizes(directory: &Path, all: &FileChecksums) -> Result<()> {
    let mut errors = all.iter().filter_map(|(name, sum)| resized(&directory.join(name), sum));
    errors.next().map_or(Ok(()), Err)
}

/// The error that a file has another size than when it was written; `None` if it has not, or is not
/// there.
fn resized(path: &Path, expected: &FileChecksum) -> Option<Error> {
    let (bytes, written) = (std::fs::metadata(path).ok()?.len(), expected.bytes);
    let why = format!("is not as it was written ({bytes} bytes, {written} were written)");
    (bytes != written).then(|| failure(path, &why))
}

/// The error that a file has another checksum than when it was written.
fn changed(path: &Path) -> Error {
    failure(path, &"is not as it was written (its checksum differs)")
}

/// The checksums that `summary.json` lists, of files that are all there and have their sizes; empty
/// if there is no such file, or if an older version wrote it.
fn of_all(directory: &Path) -> Result<FileChecksums> {
    let expected = of_summary(directory)?;
    let there = |name: &String| {
        let path = directory.join(name);
        if name.contains('/') || !path.is_file() {
            Err(failure(&path, &"is missing"))
        } else {
            Ok(())
        }
    };
    expected.keys().try_for_each(there)?;
    compare_sizes(directory, &expected)?;
    Ok(expected)
}

fn of_summary(directory: &Path) -> Result<FileChecksums> {
    let path = directory.join(summary::NAME);
    if !path.exists() {
        return Ok(FileChecksums::new());
    }
    match &summary::read(directory)?["files"] {
        Value::Null => Ok(FileChecksums::new()),
        files => FileChecksums::deserialize(files)
            .map_err(|_| failure(&path, &"is not as it was written")),
    }
}

/// The error that `summary.json` does not list the file `name`, which it should.
pub(crate) fn not_listed(directory: &Path, name: &str) -> Error {
    failure(&directory.join(name), &format!("is not named in {}", summary::NAME))
}
