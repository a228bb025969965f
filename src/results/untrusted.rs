//! HDF5 files of earlier runs and of other programs, inspected in a subprocess before they are
//! read.
//!
//! The HDF5 library trusts a file: a damaged or hostile one makes it loop for ever, abort, overflow
//! the stack or allocate without end. So the program starts itself once more, without MPI, and the
//! subprocess reads the file as it will be read. Only if that went well does this process read it.
//! The subprocess has a limit on its memory and one on the processor time between two reports of
//! progress, which a slow disk does not use up.
//!
//! A program that merely uses the library has no such subprocess: it reads files in its own
//! process.

use crate::base::disk::{self, failure};
use crate::base::error::{Error, Result};
use crate::base::machine;
use crate::parallel::communicator::Group;
use crate::problem::grid::{MAX_DIMENSION, axis_names};
use crate::results::dataset::RESULT;
use crate::results::pictures::stored::StoredRun;
use crate::results::readback::{
    ChecksumParts, FileShare, check_readable, compare, datasets, differs, numbers, read_text,
    sum_of, sums_of, text_attribute,
};
use crate::results::{FileResult, file_checksums};
use crate::solve::checkpoint::store;
use hdf5::{Dataset, File};
use serde::{Deserialize, Serialize};
use std::collections::{BTreeMap, BTreeSet};
use std::ffi::OsString;
use std::io::{BufRead, BufReader, Write};
use std::os::unix::process::{CommandExt, ExitStatusExt};
use std::path::{Path, PathBuf};
use std::process::{Child, Command, Stdio};
use std::sync::OnceLock;
use std::sync::mpsc::{RecvTimeoutError, channel};
use std::time::Duration;

/// First argument of a subprocess; no command has this name.
const CALL: &str = "inspect-file";
/// Allowed seconds of processor time between two reports of progress, rounded up by at most one.
const SECONDS_A_STEP: u64 = 1;
/// Least number of bytes that are decompressed in a second.
const BYTES_A_SECOND: u64 = 50 << 20;
/// A subprocess that reports nothing for this time is killed, whether it works or waits.
const SILENCE: Duration = Duration::from_secs(60);
/// Address space of a subprocess, to which that for chunks is added.
const MEMORY: u64 = 2 << 30;
/// Largest magnitude in fields, moments and axes; its square is finite.
const LARGEST: f64 = 1e150;

/// The role of this process in the inspection of files.
#[derive(Clone, Copy, PartialEq, Eq)]
enum ProcessRole {
    /// The process that reads files, after a subprocess has inspected them.
    Parent,
    /// The subprocess that inspects files.
    Child,
}

static ROLE: OnceLock<ProcessRole> = OnceLock::new();

/// The extent of an inspection.
#[derive(Clone, Debug, Serialize, Deserialize)]
pub(crate) enum Inspection {
    /// Names and shapes of all datasets, and all attributes and texts, by which runs are compared.
    Description,
    /// Names and shapes of all datasets, and the values of a share of each.
    Values(FileShare),
    /// `result.h5` in a directory: all values, and everything that pictures need.
    Directory,
    /// A result from which a run starts: its description, its axes, and `/f`.
    Field,
    /// A warped field from which a run starts, of any program: its axes and `/w`.
    Warped,
    /// The datasets of these names and their values, for a table.
    Table(Vec<String>),
}

/// The checksums of the datasets of a file, or a sentence that says what is wrong with the file.
type InspectionResult = FileResult<ChecksumParts>;

/// Does the work of a subprocess and returns its exit code, if this process is one. Otherwise it
/// returns `None`, and the process starts subprocesses from now on. The program calls this before
/// anything else, and before MPI starts.
pub fn serve() -> Option<i32> {
    let arguments: Vec<OsString> = std::env::args_os().skip(1).collect();
    let (inspection, path) = match &arguments[..] {
        [call, inspection, path] if call == CALL => (inspection, path),
        _ => {
            let _ = ROLE.set(ProcessRole::Parent);
            return None;
        }
    };
    let _ = ROLE.set(ProcessRole::Child);
    machine::end_with_parent();
    machine::limit_memory(MEMORY);
    progress(0);
    let inspection = inspection.to_str().and_then(|text| serde_json::from_str(text).ok());
    let found = match inspection {
        Some(inspection) => inspect_here(Path::new(path), inspection),
        None => Err("no such inspection".to_owned()),
    };
    let answer = serde_json::to_string(&found).unwrap_or_default();
    let _ = writeln!(std::io::stdout(), "{answer}");
    // HDF5's clean-up is skipped, as it would walk through everything that was read.
    machine::leave(0)
}

/// The file that an inspection of `path` reads.
fn inspected(path: &Path, inspection: &Inspection) -> PathBuf {
    match inspection {
        Inspection::Directory => path.join(RESULT),
        _ => path.to_owned(),
    }
}

/// Inspects the file `path`, or for [`Inspection::Directory`] that of a directory. A pipe is
/// refused, as opening it may wait for ever.
///
/// # Errors
/// A sentence that says what is wrong with the file.
pub(crate) fn inspect(path: &Path, inspection: Inspection) -> InspectionResult {
    disk::require_file(&inspected(path, &inspection)).map_err(|e| e.to_string())?;
    if ROLE.get() != Some(&ProcessRole::Parent) {
        return inspect_here(path, inspection);
    }
    let call = serde_json::to_string(&inspection).map_err(|e| e.to_string())?;
    // This path works even if the program's file was replaced since it started.
    let child = Command::new("/proc/self/exe")
        .args([CALL, &call])
        .arg(path)
        .stdin(Stdio::null())
        .stdout(Stdio::piped())
        .stderr(Stdio::null())
        // Signals that ask the program to stop go to its group. They are no reason to call a file
        // damaged.
        .process_group(0)
        .spawn();
    let mut child = child.map_err(|e| format!("no process can be started to read it: {e}"))?;
    let answer = answer(&mut child);
    // A subprocess that has answered has nothing more to do.
    let _ = child.kill();
    let ended = child.wait();
    answer.unwrap_or_else(|| {
        let signal = ended.ok().and_then(|status| status.signal());
        Err(match signal {
            Some(libc::SIGXCPU) => "reading it makes no progress".to_owned(),
            Some(libc::SIGKILL) | None => "reading it came to no end".to_owned(),
            Some(signal) => format!("reading it ends the process ({signal})"),
        } + ": it is damaged, or no file of this program's")
    })
}

/// The answer of a subprocess, if it gives one. Empty lines report progress.
fn answer(child: &mut Child) -> Option<InspectionResult> {
    let lines = BufReader::new(child.stdout.take()?).lines();
    let (sender, receiver) = channel();
    // The thread ends with the child.
    std::thread::spawn(move || {
        for line in lines.map_while(std::result::Result::ok) {
            if sender.send(line).is_err() {
                return;
            }
        }
    });
    loop {
        match receiver.recv_timeout(SILENCE) {
            Ok(line) if line.is_empty() => {}
            Ok(line) => return serde_json::from_str(&line).ok(),
            Err(RecvTimeoutError::Disconnected) => {
                // It is ending, and its signal tells why.
                let _ = child.wait();
                return None;
            }
            Err(RecvTimeoutError::Timeout) => return None,
        }
    }
}

/// Reports progress, and allows [`SECONDS_A_STEP`] and the time to decompress `bytes` until the
/// next report.
fn progress(bytes: u64) {
    if ROLE.get() == Some(&ProcessRole::Child) {
        machine::limit_processor_time(SECONDS_A_STEP + bytes / BYTES_A_SECOND);
        let _ = writeln!(std::io::stdout());
    }
}

fn inspect_here(path: &Path, inspection: Inspection) -> InspectionResult {
    let reason = |e: hdf5::Error| e.to_string();
    let file = inspected(path, &inspection);
    let bytes = std::fs::metadata(&file).map_err(|e| e.to_string())?.len();
    let opened =
        File::open(&file).map_err(|e| format!("cannot be read as HDF5; is it whole? ({e})"))?;
    match inspection {
        Inspection::Description => description(&opened, bytes).map_err(reason)?,
        Inspection::Values(share) => return values(&opened, bytes, share).map_err(reason),
        Inspection::Directory => {
            let sums = values(&opened, bytes, FileShare::WHOLE).map_err(reason)?;
            // Where this process is the one that asks, it reads them next.
            if ROLE.get() == Some(&ProcessRole::Child) {
                StoredRun::read(path)?;
            }
            return Ok(sums);
        }
        Inspection::Table(names) => {
            for name in &names {
                if let Some(chunk) = check_dataset(&opened, bytes, name)? {
                    allow_memory(chunk);
                }
                if let Ok(dataset) = opened.dataset(name) {
                    numbers(name, &dataset)?;
                }
            }
        }
        Inspection::Field => {
            description(&opened, bytes).map_err(reason)?;
            start(&opened, bytes, "f")?;
        }
        Inspection::Warped => start(&opened, bytes, "w")?,
    }
    Ok(ChecksumParts::new())
}

/// Checks that all datasets can be read; returns the bytes of the largest chunk.
fn shapes(all: &BTreeMap<String, Dataset>, bytes: u64) -> hdf5::Result<u64> {
    let mut largest = 0;
    for (name, dataset) in all {
        let chunk = check_readable(dataset, bytes)
            .map_err(|e| hdf5::Error::from(format!("dataset {name}: {e}")))?;
        largest = largest.max(chunk);
    }
    Ok(largest)
}

fn values(file: &File, bytes: u64, share: FileShare) -> hdf5::Result<ChecksumParts> {
    let all = datasets(file)?;
    let chunk = shapes(&all, bytes)?;
    allow_memory(chunk);
    sums_of(share, all, |name, values| {
        progress(chunk);
        match values.iter().find(|v| v.is_nan() || v.abs() > LARGEST) {
            Some(value) if holds_numbers(name) => {
                Err(hdf5::Error::from(format!("holds {value:e}, which no run writes")))
            }
            _ => Ok(()),
        }
    })
}

/// Allows memory for chunks of `chunk` bytes: as they are stored, while filters work, and after.
fn allow_memory(chunk: u64) {
    if ROLE.get() == Some(&ProcessRole::Child) {
        machine::limit_memory(MEMORY.saturating_add(chunk.saturating_mul(4)));
    }
    progress(chunk);
}

/// Whether the numbers of this dataset must be moderate: those of fields, densities, momenta and
/// axes. The density of a multivalued velocity is infinite at a caustic.
fn holds_numbers(name: &str) -> bool {
    if name.starts_with("/multivalued/") {
        return false;
    }
    let last = name.rsplit('/').next().unwrap_or_default();
    name.starts_with("/axis/") || ["f", "phi", "psi", "w", "density", "momentum"].contains(&last)
}

/// Reads the attributes of a file or a dataset, and the text of a dataset, as far as they can be
/// read. Data that cannot be read are reported by the functions that need them. A read that never
/// ends is ended here, with the subprocess.
fn read_descriptions(location: &hdf5::Location) {
    for name in location.attr_names().unwrap_or_default() {
        let _ = text_attribute(location, &name);
        progress(0);
    }
    if let Ok(dataset) = location.as_dataset() {
        let _ = read_text(&dataset);
    }
}

/// Checks all datasets, and reads what describes them and the file.
fn description(file: &File, bytes: u64) -> hdf5::Result<()> {
    let all = datasets(file)?;
    shapes(&all, bytes)?;
    read_descriptions(file);
    all.values().for_each(|dataset| read_descriptions(dataset));
    Ok(())
}

/// Reads the axes of the dataset `name` and its attributes, and its values where they are stored in
/// chunks, which HDF5 finds by an index.
fn start(file: &File, bytes: u64, name: &str) -> FileResult<()> {
    let chunk = check_dataset(file, bytes, name)?.unwrap_or(0);
    allow_memory(chunk);
    let names = axis_names(MAX_DIMENSION).into_iter().chain(["p"]);
    for axis in names.map(|name| format!("axis/{name}")) {
        check_dataset(file, bytes, &axis)?;
        if let Ok(dataset) = file.dataset(&axis) {
            // What it holds instead of numbers is reported by those that need them.
            let _ = numbers(&axis, &dataset);
        }
    }
    let Ok(dataset) = file.dataset(name) else { return Ok(()) };
    read_descriptions(&dataset);
    if chunk == 0 {
        return Ok(());
    }
    let read = sum_of(FileShare::WHOLE, &dataset, |_| {
        progress(chunk);
        Ok(())
    });
    read.map(|_| ()).map_err(|e| format!("/{name}: {e}"))
}

/// Checks that the dataset `name` can be read; returns the bytes of a chunk, or `None` if there is
/// no such dataset, which the caller may report.
fn check_dataset(file: &File, bytes: u64, name: &str) -> FileResult<Option<u64>> {
    let dataset = file.dataset(name).ok();
    dataset
        .map(|dataset| check_readable(&dataset, bytes).map_err(|e| format!("/{name}: {e}")))
        .transpose()
}

/// Opens a file that the user names, after a subprocess has inspected it.
///
/// # Errors
/// A sentence that says what is wrong with it.
pub(crate) fn open_given(path: &Path, inspection: Inspection) -> FileResult<File> {
    disk::open_regular(path).map_err(|e| e.to_string())?;
    inspect(path, inspection)?;
    // HDF5's own message lists every function that the error passed.
    File::open(path).map_err(|_| "cannot be read as HDF5; is it whole?".to_owned())
}

/// Opens `directory/result.h5` and compares its datasets with their checksums. Only one rank calls
/// it.
///
/// # Errors
/// [`Error::Input`] if there is no file that can be read; [`Error::Output`] if a dataset or a file
/// is damaged.
pub fn open(directory: &Path) -> Result<StoredRun> {
    let path = directory.join(RESULT);
    let wrong = |why: &dyn std::fmt::Display| not_a_result(&path, why);
    require_result(directory)?;
    file_checksums::check_sizes(directory)?;
    let sums = inspect(directory, Inspection::Directory).map_err(|e| wrong(&e))?;
    if let Some((name, _)) = sums.iter().find(|(_, [found, expected])| found != expected) {
        return Err(failure(&path, &differs(name)));
    }
    file_checksums::check_alone(directory)?;
    StoredRun::read(directory).map_err(|e| wrong(&e))
}

/// The error of a `path` without a result that can be read.
fn not_a_result(path: &Path, why: &dyn std::fmt::Display) -> Error {
    Error::Input(format!(
        "{}: {why}; a directory that `phasewarp run` wrote is expected",
        path.display()
    ))
}

/// Fails unless `directory/result.h5` is a file.
fn require_result(directory: &Path) -> Result<()> {
    let path = directory.join(RESULT);
    if !path.exists() && store::is_begun(directory) {
        return Err(Error::Input(format!(
            "{}: the run was stopped and is not finished; with --resume it goes on",
            directory.display()
        )));
    }
    disk::require_file(&path).map_err(|e| not_a_result(&path, &e))
}

/// A file whose datasets are as they were written.
pub struct CheckedFile {
    /// The file.
    pub path: PathBuf,
    /// Number of its datasets.
    pub datasets: usize,
}

/// Compares the datasets of `directory/result.h5` and of the warped fields beside it, and all
/// files, with their checksums. Collective over `world`.
///
/// # Errors
/// [`Error::Output`], which names the first dataset or file that has changed; [`Error::Input`] if
/// there is no `result.h5`.
pub fn check_directory(world: &Group, directory: &Path) -> Result<Vec<CheckedFile>> {
    world.agree(require_result(directory))?;
    // One rank lists the files, as ranks may see different states of the directory.
    let names = world.of_first_rank(|| {
        file_checksums::check_sizes(directory)?;
        let entries = std::fs::read_dir(directory).into_iter().flatten();
        let all = entries.filter_map(|entry| entry.ok()?.file_name().into_string().ok());
        let warped = all.filter(|name| name.starts_with("warped_") && name.ends_with(".h5"));
        Ok(warped.collect::<BTreeSet<String>>())
    })?;
    let names = [RESULT].into_iter().chain(names.iter().map(String::as_str));
    let files = names.map(|name| directory.join(name));
    let checked =
        files.map(|path| check(world, &path).map(|datasets| CheckedFile { path, datasets }));
    let checked: Vec<_> = checked.collect::<Result<_>>()?;
    file_checksums::check(world, directory)?;
    Ok(checked)
}

/// Compares every dataset of a file with its checksum; returns the number of datasets. Collective
/// over `world`.
///
/// # Errors
/// [`Error::Output`], which names the first dataset that has changed.
pub(crate) fn check(world: &Group, path: &Path) -> Result<usize> {
    let share = FileShare { rank: world.rank(), ranks: world.size() };
    let sums = inspect(path, Inspection::Values(share)).map_err(|e| failure(path, &e));
    compare(world, path, &world.agree(sums)?)
}
