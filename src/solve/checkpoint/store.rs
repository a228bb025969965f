//! The directory of checkpoints.

use crate::base::checksum;
use crate::base::disk::text_of;
use crate::base::error::{Error, Result};
use crate::parallel::communicator::Group;
use crate::parallel::partition::{ProcessMesh, common_runs};
use crate::problem::grid::PhaseSpace;
use crate::solve::checkpoint::file::{self, FileRecord, Header, RankFile, ReadDestination};
use crate::solve::snapshot::{Fingerprint, GroupProgress, Snapshot};
use serde::{Deserialize, Serialize};
use std::ffi::OsStr;
use std::fs::{self, File, FileType};
use std::path::{Path, PathBuf};

const MANIFEST: &str = "manifest.json";
/// The suffix of a file's name while it is written.
const UNFINISHED: &str = "unfinished";
/// What to do about checkpoints that cannot be used.
const START_AGAIN: &str = "without --resume the run starts from its beginning";

/// The file that completes a generation: it lists what each rank wrote.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub(super) struct Manifest {
    pub fingerprint: Fingerprint,
    pub generation: u64,
    /// The process mesh it was written on.
    pub mesh: ProcessMesh,
    /// For people: the stage, how many of its modes are finished, and the applications done so far.
    pub stage: usize,
    pub finished: usize,
    pub matvecs: usize,
    /// The files, rank after rank.
    pub files: Vec<FileRecord>,
}

/// A manifest with the checksum of its text.
#[derive(Serialize, Deserialize)]
pub(super) struct SealedManifest {
    pub manifest: Manifest,
    checksum: u64,
}

impl Manifest {
    /// The text of the file.
    ///
    /// # Errors
    /// The error of the text format.
    pub fn text(&self) -> serde_json::Result<String> {
        serde_json::to_string_pretty(&SealedManifest {
            checksum: self.checksum()?,
            manifest: self.clone(),
        })
    }

    fn checksum(&self) -> serde_json::Result<u64> {
        Ok(checksum::of_text(&serde_json::to_vec(self)?))
    }

    /// The manifest of generation number `generation`, if the text is one.
    fn parse(text: &str, generation: u64) -> std::result::Result<Self, String> {
        let broken = || format!("{MANIFEST} is not as it was written");
        let sealed: SealedManifest = serde_json::from_str(text).map_err(|_| broken())?;
        let manifest = sealed.manifest;
        if manifest.checksum().ok() != Some(sealed.checksum) {
            return Err(broken());
        }
        if manifest.generation != generation {
            return Err(format!("its {MANIFEST} is that of {:06}", manifest.generation));
        }
        Ok(manifest)
    }

    /// Writes it into `directory` and flushes it to disk, which completes the generation.
    fn write(&self, directory: &Path) -> std::io::Result<()> {
        let path = directory.join(MANIFEST);
        let unfinished = path.with_extension(UNFINISHED);
        fs::write(&unfinished, self.text()? + "\n")?;
        File::open(&unfinished)?.sync_all()?;
        fs::rename(&unfinished, &path)?;
        File::open(directory)?.sync_all()?;
        let parent = directory.parent().unwrap_or(directory);
        File::open(parent)?.sync_all()
    }
}

pub(super) fn rank_file(directory: &Path, rank: usize) -> PathBuf {
    directory.join(format!("rank-{rank:05}.bin"))
}

/// The checkpoints of a run.
pub struct Store {
    directory: PathBuf,
    fingerprint: Fingerprint,
    space: PhaseSpace,
    /// Number of the newest complete generation that was not refused.
    newest: Option<u64>,
    /// Number of the next generation.
    next: u64,
}

/// A complete generation that can be read.
pub struct Generation {
    directory: PathBuf,
    space: PhaseSpace,
    manifest: Manifest,
    /// Progress of all mode groups together.
    pub state: GroupProgress,
    /// Numbers at a point of space, of each result.
    pub results: Vec<usize>,
}

impl Store {
    /// The checkpoints in `directory` of a run on the grid `space`. Nothing is written yet.
    pub fn new(directory: PathBuf, fingerprint: Fingerprint, space: PhaseSpace) -> Self {
        let found = generations(&directory);
        Self {
            newest: found.iter().copied().find(|&g| complete(&directory, g)),
            // No generation takes the name of anything that is there.
            next: numbers(&directory).map(|(number, _)| number + 1).max().unwrap_or(1),
            directory,
            fingerprint,
            space,
        }
    }

    /// The directory of the checkpoints.
    pub fn directory(&self) -> &Path {
        &self.directory
    }

    /// Whether there are any.
    pub fn is_empty(&self) -> bool {
        self.newest.is_none()
    }

    /// Sets the checksum of the warped field from which the run starts; it is known only after the
    /// field was read.
    ///
    /// # Errors
    /// [`Error::AnotherRun`] if the run of `generation` started from another field.
    pub fn begins_with(&mut self, values: u64, generation: Option<&Generation>) -> Result<()> {
        if let Some(start) = &mut self.fingerprint.start {
            start.values = Some(values);
        }
        let Some(generation) = generation else {
            return Ok(());
        };
        match (self.fingerprint).difference(&generation.manifest.fingerprint) {
            None => Ok(()),
            Some(difference) => {
                let reason = format!("{difference}; {START_AGAIN}");
                Err(Error::AnotherRun { path: generation.directory.clone(), reason })
            }
        }
    }

    /// Writes a generation, and removes those before the last; returns the number of finished
    /// modes. The generation counts only if this succeeds. Collective.
    ///
    /// # Errors
    /// [`Error::Checkpoint`], of the first rank that has one.
    pub fn write(
        &mut self,
        world: &Group,
        mesh: &ProcessMesh,
        snapshot: &Snapshot<'_>,
    ) -> Result<usize> {
        // Other ranks may not see the files that rank 0 found.
        let number = world.broadcast_text(&self.next.to_string());
        let number = number.parse().unwrap_or(self.next);
        self.next = number + 1;
        let directory = generation(&self.directory, number);
        let is_first = world.is_first();
        let written = self.write_files(world, mesh, number, &directory, snapshot);
        if written.is_err() {
            if is_first {
                // An incomplete generation would take disk space from the next one.
                let _ = remove(&directory);
            }
            return written;
        }
        let before = self.newest.replace(number);
        if is_first {
            for old in generations(&self.directory) {
                if old != number && Some(old) != before {
                    let _ = remove(&generation(&self.directory, old));
                }
            }
        }
        written
    }

    fn write_files(
        &self,
        world: &Group,
        mesh: &ProcessMesh,
        number: u64,
        directory: &Path,
        snapshot: &Snapshot<'_>,
    ) -> Result<usize> {
        let rank = world.rank();
        let failed = |e: std::io::Error| failure(directory, &e);
        world.on_first_rank(|| {
            let made = fs::create_dir_all(&self.directory);
            // A link in its place would not be followed.
            made.and_then(|()| fs::create_dir(directory)).map_err(failed)
        })?;
        let header = self.header(mesh, rank, number, snapshot);
        let path = rank_file(directory, rank);
        let unfinished = path.with_extension(UNFINISHED);
        let written = file::write(&unfinished, &header, snapshot)
            .and_then(|written| fs::rename(&unfinished, &path).map(|()| written));
        let written = world.agree(written.map_err(|e| failure(&path, &e)))?;
        let files = world.gather_counts(&[written.bytes, written.checksum]);
        // All space blocks of a mode group have the same count.
        let once = |count: usize| usize::from(rank.is_multiple_of(mesh.blocks())) * count;
        let finished = world.sum_count(once(header.state.finished.len()));
        let matvecs = world.sum_count(once(header.state.statistics.applications));
        if rank > 0 {
            return world.agree(Ok(finished));
        }
        let manifest = Manifest {
            fingerprint: self.fingerprint.clone(),
            generation: number,
            mesh: mesh.clone(),
            stage: header.state.stage,
            finished,
            matvecs,
            files: (files.as_chunks().0.iter())
                .map(|&[bytes, checksum]| FileRecord { bytes, checksum })
                .collect(),
        };
        world.agree(manifest.write(directory).map_err(failed).map(|()| finished))
    }

    fn header(
        &self,
        mesh: &ProcessMesh,
        rank: usize,
        generation: u64,
        snapshot: &Snapshot<'_>,
    ) -> Header {
        let (block, group) = (rank % mesh.blocks(), rank / mesh.blocks());
        let kept = snapshot.kept.as_ref();
        Header {
            fingerprint: self.fingerprint.clone(),
            generation,
            rank,
            block: mesh.ranges(&self.space, block),
            share: mesh.share(&self.space, block, group),
            velocity_cells: self.space.velocity_cells(),
            sums: snapshot.sums.iter().map(|s| s.width).collect(),
            results: snapshot.results.iter().map(|r| r.width).collect(),
            auxiliary: kept.map_or(0, |k| k.auxiliary.len()),
            kept: kept
                .map_or(Vec::new(), |k| k.modes.iter().map(|m| (m.mode, m.progress)).collect()),
            state: snapshot.state.clone(),
        }
    }

    /// The newest valid generation; `None` if there are no generations. Rank 0 passes the reasons
    /// why newer ones are not valid to `say`. Collective.
    ///
    /// # Errors
    /// If there are generations, but none is valid: [`Error::AnotherRun`] if all of them are those
    /// of another run, [`Error::Checkpoint`] if one is damaged.
    pub fn open(
        &mut self,
        world: &Group,
        mut say: impl FnMut(String),
    ) -> Result<Option<Generation>> {
        let mut found = generations(&self.directory);
        // Rank 0's view of the directory.
        let text = world.broadcast_text(&serde_json::to_string(&found).unwrap_or_default());
        found = serde_json::from_str(&text).unwrap_or_default();
        let (mut refused, mut damaged) = (0, 0);
        for number in found {
            let text = world.on_first_rank(|| self.manifest_text(number));
            let text = text.map(|text| world.broadcast_text(&text));
            if text.as_ref().is_ok_and(String::is_empty) {
                let path = generation(&self.directory, number);
                let shown = path.display();
                say(format!("checkpoint {shown} is not complete: its writing was interrupted"));
                continue;
            }
            match text.and_then(|text| self.checked(world, number, &text)) {
                Ok(generation) => {
                    self.newest = Some(number);
                    return Ok(Some(generation));
                }
                Err(error) => {
                    refused += 1;
                    damaged += usize::from(!matches!(error, Error::AnotherRun { .. }));
                    say(format!("{error}; it is not used"));
                }
            }
        }
        if refused == 0 {
            self.newest = None;
            return Ok(None);
        }
        let reason = format!("none of the checkpoints in it can be used; {START_AGAIN}");
        match damaged {
            0 => Err(Error::AnotherRun { path: self.directory.clone(), reason }),
            _ => Err(failure(&self.directory, &reason)),
        }
    }

    /// The text of a generation's manifest; empty if there is no such file.
    fn manifest_text(&self, number: u64) -> Result<String> {
        if !complete(&self.directory, number) {
            return Ok(String::new());
        }
        let path = generation(&self.directory, number).join(MANIFEST);
        text_of(&path).map_err(|e| failure(&path, &e))
    }

    /// A generation with this manifest, if it is valid. Collective.
    fn checked(&self, world: &Group, number: u64, text: &str) -> Result<Generation> {
        let path = generation(&self.directory, number);
        let refuse = |reason: String| failure(&path, &reason);
        let manifest = self.manifest(number, text)?;
        let mine = (world.rank()..manifest.files.len()).step_by(world.size());
        let sound = mine.map(|rank| self.check_file(&manifest, rank));
        world.agree(sound.collect::<Result<()>>())?;
        let read = match world.rank() {
            0 => self.read_state(&manifest),
            _ => Ok(String::new()),
        };
        let text = world.broadcast_text(&world.agree(read)?);
        let read = serde_json::from_str(&text).map_err(|e| refuse(e.to_string()));
        let (state, results) = world.agree(read)?;
        let space = self.space.clone();
        Ok(Generation { directory: path, space, manifest, state, results })
    }

    /// The manifest of a generation of this run, if the text is one.
    ///
    /// # Errors
    /// [`Error::Checkpoint`] and [`Error::AnotherRun`].
    pub(super) fn manifest(&self, number: u64, text: &str) -> Result<Manifest> {
        let path = generation(&self.directory, number);
        let manifest = Manifest::parse(text, number).map_err(|reason| failure(&path, &reason))?;
        if let Some(reason) = self.fingerprint.difference(&manifest.fingerprint) {
            return Err(Error::AnotherRun { path, reason });
        }
        let mesh = &manifest.mesh;
        let fits = mesh.space.len() == self.space.dimension()
            && mesh.validate(&self.space).is_ok()
            && mesh.blocks().checked_mul(mesh.groups) == Some(manifest.files.len());
        if !fits {
            return Err(failure(&path, &format!("its {MANIFEST} does not fit the case")));
        }
        Ok(manifest)
    }

    /// Whether the file of `rank` is the one that was written.
    pub(super) fn check_file(&self, manifest: &Manifest, rank: usize) -> Result<()> {
        let path = rank_file(&generation(&self.directory, manifest.generation), rank);
        let refuse = |reason: String| failure(&path, &reason);
        file::check(&path, &manifest.files[rank]).map_err(refuse)?;
        let Header { fingerprint, generation, rank: found, .. } = open(&path)?.header;
        if fingerprint != manifest.fingerprint || generation != manifest.generation || found != rank
        {
            return Err(refuse(format!(
                "is the file of rank {found} of checkpoint {generation:06}"
            )));
        }
        Ok(())
    }

    /// Progress of all mode groups together, and the widths of the results, as text.
    pub(super) fn read_state(&self, manifest: &Manifest) -> Result<String> {
        let directory = generation(&self.directory, manifest.generation);
        let blocks = manifest.mesh.blocks();
        let first = open(&rank_file(&directory, 0))?.header;
        let mut state = first.state;
        for group in 1..manifest.mesh.groups {
            state.add(open(&rank_file(&directory, group * blocks))?.header.state);
        }
        serde_json::to_string(&(state, first.results)).map_err(|e| failure(&directory, &e))
    }
}

impl Generation {
    /// Reads the parts of the files that overlap with this rank's part of the grid. `modes` is the
    /// rank's mode group. The sums of all groups that wrote are added. Not collective.
    ///
    /// # Errors
    /// [`Error::Checkpoint`] where a file cannot be read.
    pub fn read(&self, modes: &Group, to: &mut ReadDestination<'_>) -> Result<()> {
        let manifest = &self.manifest;
        let mesh = &manifest.mesh;
        for rank in 0..mesh.ranks() {
            let block = mesh.ranges(&self.space, rank % mesh.blocks());
            if common_runs(&block, to.block).is_empty() {
                continue;
            }
            let path = rank_file(&self.directory, rank);
            let with_sums = rank / mesh.blocks() % modes.size() == modes.rank();
            (open(&path)?.read_into(to, with_sums)).map_err(|e| failure(&path, &e))?;
        }
        Ok(())
    }

    /// Directory of the generation.
    pub fn path(&self) -> &Path {
        &self.directory
    }
}

fn generation(directory: &Path, number: u64) -> PathBuf {
    directory.join(format!("{number:06}"))
}

/// Numbers of the generations in `directory`, newest first. A link to a directory is none, as what
/// it leads to is not this program's.
fn generations(directory: &Path) -> Vec<u64> {
    let own = numbers(directory).filter(|(_, kind)| kind.is_some_and(|kind| kind.is_dir()));
    let mut found: Vec<u64> = own.map(|(number, _)| number).collect();
    found.sort_unstable_by_key(|&n| std::cmp::Reverse(n));
    found
}

/// The numbers of all entries of `directory` with the name of a generation, and what they are
/// themselves, links not followed.
fn numbers(directory: &Path) -> impl Iterator<Item = (u64, Option<FileType>)> {
    let entries = fs::read_dir(directory).into_iter().flatten().flatten();
    // A next number must be left.
    let is_number = |n: &u64, name: &str| *n < u64::MAX && format!("{n:06}") == name;
    let number = move |name: &str| name.parse().ok().filter(|n| is_number(n, name));
    entries.filter_map(move |e| Some((number(e.file_name().to_str()?)?, e.file_type().ok())))
}

/// The directory of the checkpoints of a run whose results are in `results`.
pub fn folder(results: &Path) -> PathBuf {
    results.join("checkpoint")
}

/// Whether there is a complete checkpoint, valid or not, of a run whose results are in `results`.
/// Other files beside it do not matter.
pub fn is_begun(results: &Path) -> bool {
    let directory = folder(results);
    generations(&directory).into_iter().any(|number| complete(&directory, number))
}

/// Removes the checkpoints in `directory`, complete or not, and then the directory if nothing else
/// is in it. What cannot be removed stays.
///
/// # Errors
/// The error of the file system, if there was a checkpoint.
pub fn remove_all(directory: &Path) -> std::io::Result<()> {
    let found = generations(directory);
    (found.iter()).try_for_each(|&number| remove(&generation(directory, number)))?;
    match fs::remove_dir(directory) {
        // An empty directory is that of a run that was killed as it ended.
        Err(_) if found.is_empty() => Ok(()),
        removed => removed,
    }
}

fn complete(directory: &Path, number: u64) -> bool {
    generation(directory, number).join(MANIFEST).is_file()
}

/// Removes the files of a generation, the manifest first, as half of one does not count, and then
/// its directory, which stays if it holds anything else. A link is not followed.
fn remove(directory: &Path) -> std::io::Result<()> {
    if !fs::symlink_metadata(directory)?.is_dir() {
        return Err(std::io::Error::other("is no directory"));
    }
    let _ = fs::remove_file(directory.join(MANIFEST));
    for entry in fs::read_dir(directory)? {
        let path = entry?.path();
        if is_own(&path) {
            fs::remove_file(path)?;
        }
    }
    fs::remove_dir(directory)
}

/// Whether a file has a name that this module gives.
fn is_own(path: &Path) -> bool {
    let text = |part: Option<&OsStr>| part.and_then(OsStr::to_str).unwrap_or_default().to_owned();
    let (stem, ending) = (text(path.file_stem()), text(path.extension()));
    let number = stem.strip_prefix("rank-").map(str::as_bytes);
    let of_rank = number.is_some_and(|n| n.len() >= 5 && n.iter().all(u8::is_ascii_digit));
    (of_rank && ["bin", UNFINISHED].contains(&ending.as_str()))
        || (stem == "manifest" && ending == UNFINISHED)
}

fn open(path: &Path) -> Result<RankFile> {
    RankFile::open(path).map_err(|e| failure(path, &e))
}

fn failure(path: &Path, reason: &dyn std::fmt::Display) -> Error {
    Error::Checkpoint { path: path.to_owned(), reason: reason.to_string() }
}
