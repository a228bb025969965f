//! Checkpoints that one mesh writes and another one reads, and the runs that may continue from
//! them.

#[path = "../../../tests/support/fuzz.rs"]
mod fuzzing;

use super::*;
use crate::base::row_major::volume;
use crate::parallel::partition::{ProcessMesh, common_runs};
use crate::problem::grid::{Axis, PhaseSpace};
use crate::solve::checkpoint::file::{self, Header, RankFile, ReadDestination};
use crate::solve::checkpoint::store::{Manifest, SealedManifest, rank_file};
use crate::solve::rank_modes::{ModeProgress, RankModes};
use crate::solve::snapshot::{
    BoxValues, Fingerprint, GroupProgress, StoredMode, StoredModes, WarpedFieldKey,
};
use crate::solve::statistics::BatchStatistics;
use fuzzing::mutate::Corpus;
use fuzzing::{Random, Reader, fuzz};
use num_complex::Complex64;
use std::collections::BTreeMap;
use std::path::{Path, PathBuf};

const SUMS: [usize; 2] = [6, 4];
const RESULTS: [usize; 3] = [6, 4, 1];
const MODES: usize = 7;

fn space(x: &[usize]) -> PhaseSpace {
    let axis = |&cells: &usize| Axis::new(0.0, 1.0, cells);
    let v: &[usize] = if x.len() == 1 { &[6] } else { &[2, 3] };
    PhaseSpace {
        x: x.iter().map(axis).collect(),
        v: v.iter().map(axis).collect(),
        periodic: [false; 3],
    }
}

/// The test value of array `array` at number `index` of the whole grid.
fn value(array: usize, index: usize) -> u64 {
    crate::base::checksum::run_checksum((1000 * array + index) as u64, std::iter::once(7))
}

fn real(array: usize, index: usize) -> f64 {
    value(array, index) as i64 as f64
}

/// The points of a block, as numbers in the whole grid.
fn global_points(space: &PhaseSpace, ranges: &[Range<usize>]) -> Vec<usize> {
    let whole = space.space_ranges();
    let runs = crate::parallel::partition::common_runs(ranges, &whole);
    runs.iter().flat_map(|run| run.to..run.to + run.length).collect()
}

/// Cells of a block that have an auxiliary unknown.
fn auxiliary(space: &PhaseSpace, ranges: &[Range<usize>]) -> Vec<u64> {
    let velocities = space.velocity_cells();
    let cells = global_points(space, ranges).into_iter();
    let cells = cells.flat_map(|point| point * velocities..(point + 1) * velocities);
    cells.filter(|cell| cell % 5 == 2).map(|cell| cell as u64).collect()
}

fn settings(given: &[(&str, &str)]) -> BTreeMap<String, String> {
    let given = given.iter();
    given.map(|&(key, value)| (key.to_owned(), value.to_owned())).collect()
}

fn fingerprint() -> Fingerprint {
    Fingerprint {
        program: "1".to_owned(),
        settings: settings(&[("time.end", "2"), ("output.xdmf", "true")]),
        start: Some(WarpedFieldKey { points: ([4, 5], 6), values: Some(7) }),
        field: Some(9),
        tables: [("potential.0.table".to_owned(), Some(8))].into(),
        plan: 3,
        fused: true,
    }
}

fn progress(mode: usize) -> ModeProgress {
    ModeProgress {
        legs: mode % 3 + 1,
        phase: Complex64::new(0.1 * mode as f64, 1.0 / 3.0),
        norm: std::f64::consts::PI,
        allowed: 1e-12,
    }
}

/// The rows of a mode on a block: cells, then auxiliary unknowns.
fn rows(space: &PhaseSpace, ranges: &[Range<usize>], mode: usize) -> Vec<Complex64> {
    let velocities = space.velocity_cells();
    let number = |array: usize, index: usize| {
        Complex64::new(real(array + mode, index), real(array + 50 + mode, index))
    };
    let cells = global_points(space, ranges).into_iter();
    let cells = cells.flat_map(|point| point * velocities..(point + 1) * velocities);
    let behind = auxiliary(space, ranges).into_iter();
    (cells.map(|cell| number(100, cell)))
        .chain(behind.map(|cell| number(200, cell as usize)))
        .collect()
}

/// The part of a sum on mode group `group`; the parts add up to `value`.
fn part(array: usize, index: usize, (group, groups): (usize, usize)) -> i64 {
    let others = |group: usize| value(array + 10 * (group + 1), index) as i64 >> 8;
    if group + 1 < groups {
        others(group)
    } else {
        let rest: i64 = (0..group).map(others).sum();
        (value(array, index) as i64 >> 4) - rest
    }
}

/// A rank of a mesh.
struct Rank<'a> {
    space: &'a PhaseSpace,
    number: usize,
    group: usize,
    groups: usize,
    block: Vec<Range<usize>>,
    share: Vec<Range<usize>>,
    modes: Vec<usize>,
}

impl<'a> Rank<'a> {
    fn all(space: &'a PhaseSpace, mesh: &ProcessMesh) -> Vec<Self> {
        (0..mesh.ranks())
            .map(|number| {
                let (block, group) = (number % mesh.blocks(), number / mesh.blocks());
                Self {
                    space,
                    number,
                    group,
                    groups: mesh.groups,
                    block: mesh.ranges(space, block),
                    share: mesh.share(space, block, group),
                    modes: (0..MODES).filter(|l| l % mesh.groups == group).collect(),
                }
            })
            .collect()
    }

    /// Cells with an auxiliary unknown.
    fn auxiliary(&self) -> Vec<u64> {
        auxiliary(self.space, &self.block)
    }

    fn header(&self, state: &GroupProgress) -> Header {
        Header {
            fingerprint: fingerprint(),
            generation: 3,
            rank: self.number,
            velocity_cells: self.space.velocity_cells(),
            sums: SUMS.to_vec(),
            results: RESULTS.to_vec(),
            auxiliary: self.auxiliary().len(),
            kept: self.modes.iter().map(|&mode| (mode, progress(mode))).collect(),
            state: state.clone(),
            block: self.block.clone(),
            share: self.share.clone(),
        }
    }

    /// Writes the rank's file below `directory`; returns the record of the file.
    fn write(&self, directory: &Path) -> file::FileRecord {
        let points = global_points(self.space, &self.block);
        let sums: Vec<Vec<i64>> = (SUMS.iter().enumerate())
            .map(|(k, width)| {
                let numbers = points.iter().flat_map(|p| 2 * width * p..2 * width * (p + 1));
                numbers.map(|i| part(k, i, (self.group, self.groups))).collect()
            })
            .collect();
        let results = (RESULTS.iter().enumerate())
            .map(|(k, width)| expected_result(self.space, &self.share, k, *width));
        let results: Vec<Vec<f64>> = results.collect();
        let kept = self.modes.iter().map(|&mode| rows(self.space, &self.block, mode));
        let kept: Vec<Vec<Complex64>> = kept.collect();
        let modes = self.modes.iter().zip(&kept).map(|(&mode, rows)| StoredMode {
            mode,
            progress: progress(mode),
            rows,
        });
        let snapshot = Snapshot {
            state: GroupProgress {
                finished: self.modes.clone(),
                beyond: vec![1.0 / 3.0, 1e-300, 0.1 + 0.2],
                ..GroupProgress::default()
            },
            sums: (sums.iter().zip(SUMS))
                .map(|(values, width)| BoxValues { width, values })
                .collect(),
            results: (results.iter().zip(RESULTS))
                .map(|(values, width)| BoxValues { width, values })
                .collect(),
            kept: Some(StoredModes { auxiliary: self.auxiliary(), modes: modes.collect() }),
        };
        let header = self.header(&snapshot.state);
        let path = file_of(directory, self.number);
        let written = file::write(&path, &header, &snapshot).expect("a file");
        assert_eq!(file::check(&path, &written), Ok(()));
        assert_eq!(RankFile::open(&path).expect("a file").header, header);
        written
    }

    /// Reads the rank's parts of the files that the ranks of `from` wrote, and compares results and
    /// modes; returns the rank's part of the sums.
    fn read(&self, directory: &Path, from: &ProcessMesh) -> Vec<Vec<i64>> {
        let own = volume(&self.block);
        let sum = |width: &usize| vec![0; 2 * width * own];
        let mut sums: Vec<Vec<i64>> = SUMS.iter().map(sum).collect();
        let behind = self.auxiliary();
        let cells = own * self.space.velocity_cells();
        let mut kept = RankModes::new(cells + behind.len(), self.modes.clone());
        let result = |width: &usize| vec![0.0; width * volume(&self.share)];
        let mut into = ReadDestination {
            block: &self.block,
            share: &self.share,
            sums: sums.iter_mut().map(|sum| &mut sum[..]).collect(),
            results: RESULTS.iter().map(result).collect(),
            kept: Some((behind, &mut kept)),
        };
        for other in 0..from.ranks() {
            let file = RankFile::open(&file_of(directory, other)).expect("a file");
            let with_sums = other / from.blocks() % self.groups == self.group;
            file.read_into(&mut into, with_sums).expect("a reading");
        }
        for (k, result) in into.results.iter().enumerate() {
            let expected = expected_result(self.space, &self.share, k, RESULTS[k]);
            assert_eq!(result, &expected);
        }
        for &mode in &self.modes {
            let expected = rows(self.space, &self.block, mode);
            assert_eq!(kept.mode(mode), Some(&expected[..]));
            assert_eq!(kept.progress_of(mode), Some(progress(mode)));
        }
        sums
    }
}

fn write_all(directory: &Path, space: &PhaseSpace, mesh: &ProcessMesh) -> Vec<file::FileRecord> {
    let ranks = Rank::all(space, mesh);
    ranks.iter().map(|rank| rank.write(directory)).collect()
}

fn file_of(directory: &Path, rank: usize) -> PathBuf {
    directory.join(format!("{rank}"))
}

fn expected_result(space: &PhaseSpace, share: &[Range<usize>], k: usize, width: usize) -> Vec<f64> {
    let points = global_points(space, share).into_iter();
    let numbers = points.flat_map(|p| width * p..width * (p + 1));
    numbers.map(|i| real(20 + k, i)).collect()
}

#[test]
fn files_of_a_mesh_are_read_on_any_other() {
    let mesh = |space: &[usize], groups: usize| ProcessMesh { space: space.to_vec(), groups };
    // With more groups than layers of a block, some ranks have no results.
    let line = [(1, 1), (3, 1), (1, 4), (4, 3), (2, 7)].map(|(x, groups)| mesh(&[x], groups));
    let plane = [([1, 1], 2), ([2, 3], 1), ([5, 1], 2), ([1, 4], 3)];
    let plane = plane.map(|(space, groups)| mesh(&space, groups));
    for (space, meshes) in [(space(&[11]), &line[..]), (space(&[5, 4]), &plane)] {
        for from in meshes {
            let directory = tempfile::tempdir().expect("a directory");
            write_all(directory.path(), &space, from);
            for to in meshes {
                read_all(directory.path(), &space, from, to);
            }
        }
    }
}

/// Reads the files of the ranks of `from` on the ranks of `to`, and checks that the sums of all
/// ranks are complete.
fn read_all(directory: &Path, space: &PhaseSpace, from: &ProcessMesh, to: &ProcessMesh) {
    let whole = space.space_ranges();
    let sum = |width: &usize| vec![0; 2 * width * volume(&whole)];
    let mut sums: Vec<Vec<i64>> = SUMS.iter().map(sum).collect();
    for rank in Rank::all(space, to) {
        let own = global_points(space, &rank.block);
        let parts = rank.read(directory, from);
        for ((sum, part), width) in sums.iter_mut().zip(parts).zip(SUMS) {
            let places = own.iter().flat_map(|p| 2 * width * p..2 * width * (p + 1));
            places.zip(part).for_each(|(place, part)| sum[place] += part);
        }
    }
    for (k, sum) in sums.iter().enumerate() {
        for (i, &found) in sum.iter().enumerate() {
            assert_eq!(found, value(k, i) as i64 >> 4, "{from:?} to {to:?}");
        }
    }
}

/// The header of a million modes takes more than 64 MiB.
#[test]
fn headers_of_many_modes_are_read() {
    const MODES: usize = 4_000_000;
    let space = space(&[1]);
    let rank = &Rank::all(&space, &ProcessMesh { space: vec![1], groups: 1 })[0];
    let state = GroupProgress { beyond: vec![0.1 + 0.2; MODES], ..GroupProgress::default() };
    let header = Header {
        sums: Vec::new(),
        results: Vec::new(),
        auxiliary: 0,
        kept: Vec::new(),
        ..rank.header(&state)
    };
    let snapshot = Snapshot { state, sums: Vec::new(), results: Vec::new(), kept: None };
    let directory = tempfile::tempdir().expect("a directory");
    let path = file_of(directory.path(), 0);
    let written = file::write(&path, &header, &snapshot).expect("a file");
    assert!(written.bytes > 64 << 20, "{}", written.bytes);
    assert_eq!(file::check(&path, &written), Ok(()));
    assert!(RankFile::open(&path).expect("a file").header == header);
}

#[test]
fn every_flipped_bit_is_found() {
    let space = space(&[3]);
    let mesh = ProcessMesh { space: vec![1], groups: 1 };
    let directory = tempfile::tempdir().expect("a directory");
    let written = write_all(directory.path(), &space, &mesh)[0];
    let path = file_of(directory.path(), 0);
    let bytes = std::fs::read(&path).expect("a file");
    for at in 0..bytes.len() {
        let mut changed = bytes.clone();
        changed[at] ^= 1 << (at % 8);
        std::fs::write(&path, changed).expect("a file");
        assert!(file::check(&path, &written).is_err(), "byte {at}");
    }
    for length in [0, 7, 8, 16, 24, bytes.len() - 8, bytes.len() - 1] {
        std::fs::write(&path, &bytes[..length]).expect("a file");
        assert!(file::check(&path, &written).is_err(), "{length} bytes");
        assert!(RankFile::open(&path).is_err(), "{length} bytes");
    }
}

/// Files of checkpoints with a correct checksum and wrong contents.
struct DamagedFiles {
    space: PhaseSpace,
    mesh: ProcessMesh,
    directory: tempfile::TempDir,
    /// The file of each rank as it was written.
    written: Vec<Vec<u8>>,
}

impl Reader for DamagedFiles {
    /// A rank, and the replacement of its file.
    type Input = (usize, Vec<u8>);
    const INPUTS: u64 = 2000;

    fn new() -> Self {
        let (space, mesh) = (space(&[5, 4]), ProcessMesh { space: vec![2, 1], groups: 2 });
        let directory = tempfile::tempdir().expect("a directory");
        write_all(directory.path(), &space, &mesh);
        let read = |rank| std::fs::read(file_of(directory.path(), rank)).expect("a file");
        let written = (0..mesh.ranks()).map(read).collect();
        Self { space, mesh, directory, written }
    }

    fn input(&self, random: &mut Random) -> (usize, Vec<u8>) {
        let rank = random.below(self.written.len());
        (rank, changed(&self.written[rank], random))
    }

    fn read(&mut self, (rank, bytes): &(usize, Vec<u8>)) -> std::result::Result<bool, String> {
        let path = file_of(self.directory.path(), *rank);
        std::fs::write(&path, bytes).expect("a file");
        let reader = &Rank::all(&self.space, &self.mesh)[*rank];
        Ok(RankFile::open(&path).is_ok_and(|file| is_read(&file, reader)))
    }
}

#[test]
fn changed_files_are_refused_or_read() {
    fuzz::<DamagedFiles>("solve::checkpoint::tests::changed_files_are_refused_or_read");
}

/// Changed manifests; half of them get a correct checksum again.
struct DamagedManifests {
    corpus: Corpus,
    store: Store,
    _directory: tempfile::TempDir,
}

/// The number of the generation that [`Rank::header`] names.
const GENERATION: u64 = 3;

impl Reader for DamagedManifests {
    type Input = String;
    const INPUTS: u64 = 2000;

    fn new() -> Self {
        let (space, mesh) = (space(&[5, 4]), ProcessMesh { space: vec![2, 1], groups: 2 });
        let directory = tempfile::tempdir().expect("a directory");
        let files = write_all(directory.path(), &space, &mesh);
        let generation = directory.path().join(format!("{GENERATION:06}"));
        std::fs::create_dir(&generation).expect("a directory");
        for rank in 0..mesh.ranks() {
            let target = rank_file(&generation, rank);
            std::fs::rename(file_of(directory.path(), rank), target).expect("a file");
        }
        let (fingerprint, [stage, finished, matvecs]) = (fingerprint(), [0, MODES, 1234]);
        let generation = GENERATION;
        let manifest = Manifest { fingerprint, generation, mesh, stage, finished, matvecs, files };
        let store = Store::new(directory.path().to_owned(), manifest.fingerprint.clone(), space);
        let corpus = Corpus::new(vec![manifest.text().expect("a text")]);
        Self { corpus, store, _directory: directory }
    }

    fn input(&self, random: &mut Random) -> String {
        let text = self.corpus.changed(random);
        let sealed =
            serde_json::from_str::<SealedManifest>(&text).ok().filter(|_| random.once_in(2));
        sealed.map_or(text, |sealed| sealed.manifest.text().expect("a text"))
    }

    fn read(&mut self, text: &String) -> std::result::Result<bool, String> {
        let Ok(manifest) = self.store.manifest(GENERATION, text) else { return Ok(false) };
        let (mesh, space) = (&manifest.mesh, space(&[5, 4]));
        let whole = space.space_ranges();
        let cells: usize = (0..mesh.blocks())
            .flat_map(|block| common_runs(&mesh.ranges(&space, block), &whole))
            .map(|run| run.length)
            .sum();
        if cells != space.space_cells() {
            return Err(format!("{cells} cells"));
        }
        let sound = (0..mesh.ranks()).all(|rank| self.store.check_file(&manifest, rank).is_ok());
        Ok(sound && self.store.read_state(&manifest).is_ok())
    }
}

#[test]
fn changed_manifests_are_refused_or_read() {
    fuzz::<DamagedManifests>("solve::checkpoint::tests::changed_manifests_are_refused_or_read");
}

/// Whether `rank` can read the file.
fn is_read(file: &RankFile, rank: &Rank<'_>) -> bool {
    let own = volume(&rank.block);
    let mut sums: Vec<Vec<i64>> = SUMS.iter().map(|width| vec![0; 2 * width * own]).collect();
    let behind = rank.auxiliary();
    let rows = own * rank.space.velocity_cells() + behind.len();
    let mut kept = RankModes::new(rows, rank.modes.clone());
    let result = |width: &usize| vec![0.0; width * volume(&rank.share)];
    let mut into = ReadDestination {
        block: &rank.block,
        share: &rank.share,
        sums: sums.iter_mut().map(|sum| &mut sum[..]).collect(),
        results: RESULTS.iter().map(result).collect(),
        kept: Some((behind, &mut kept)),
    };
    file.read_into(&mut into, true).is_ok()
}

/// A file with a few changes of its words, its length and numbers of its header. Half of the files
/// then get the length that the header gives.
fn changed(whole: &[u8], random: &mut Random) -> Vec<u8> {
    const NUMBERS: [&str; 8] =
        ["0", "1", "2", "7", "-1", "4294967296", "1152921504606846976", "18446744073709551615"];
    let mut below = |n: usize| random.below(n);
    let length = 8 * u64::from_le_bytes(whole.as_chunks().0[1]) as usize;
    let mut header = String::from_utf8_lossy(&whole[16..16 + length]).into_owned();
    let mut words = whole[16 + length..].to_vec();
    for _ in 0..=below(3) {
        match below(5) {
            0 if words.len() >= 8 => {
                let at = 8 * below(words.len() / 8);
                words[at..at + 8].copy_from_slice(&(1u64 << below(64)).to_le_bytes());
            }
            1 => words.resize(8 * below(words.len() / 4 + 2), 0),
            _ => {
                let is_digit = |at: &usize| header.as_bytes()[*at].is_ascii_digit();
                let digits: Vec<usize> = (0..header.len()).filter(is_digit).collect();
                let (start, rest) = header.split_at(digits[below(digits.len())]);
                let rest = rest.trim_start_matches(|c: char| c.is_ascii_digit());
                header = [start, NUMBERS[below(NUMBERS.len())], rest].concat();
            }
        }
    }
    let count = serde_json::from_str::<Header>(&header).ok().and_then(|header| header.words());
    if let Some(count) = count.filter(|&count| count < 1 << 16 && below(2) == 0) {
        words.resize(8 * (count + 1), 0);
    }
    let length = header.len().next_multiple_of(8);
    let start = [&whole[..8], &(length as u64 / 8).to_le_bytes()].concat();
    [start, format!("{header:length$}").into_bytes(), words].concat()
}

#[test]
fn different_runs_are_distinguished() {
    let own = fingerprint();
    assert_eq!(own.difference(&own), None);
    let start = |points, values| Some(WarpedFieldKey { points, values });
    let change = |change: &dyn Fn(&mut Fingerprint)| {
        let mut other = own.clone();
        change(&mut other);
        other
    };
    for (other, word) in [
        (change(&|f| f.program = "2".to_owned()), "phasewarp 2"),
        (
            change(&|f| f.settings = settings(&[("time.end", "3"), ("output.xdmf", "true")])),
            "time.end is 3 there, 2 here",
        ),
        (
            change(&|f| f.settings = settings(&[("time.end", "2")])),
            "output.xdmf is not given there, true here",
        ),
        (
            change(&|f| f.settings.extend(settings(&[("scheme.flux", "1")]))),
            "scheme.flux is 1 there, not given here",
        ),
        // Other points also make another plan, but the reason given is the points.
        (change(&|f| (f.start, f.plan) = (start(([4, 5], 8), Some(7)), 9)), "initial.warped"),
        (change(&|f| f.start = start(([4, 5], 6), Some(8))), "initial.warped"),
        (change(&|f| f.field = Some(8)), "initial.field"),
        (change(&|f| f.tables.values_mut().for_each(|sum| *sum = Some(9))), "potential.0.table"),
        (change(&|f| f.plan = 9), "another plan"),
        // Other roundings may also make another plan, but the reason given is the rounding.
        (change(&|f| (f.plan, f.fused) = (9, false)), "was computed without fused multiply-adds"),
    ] {
        let why = own.difference(&other);
        assert!(why.as_ref().is_some_and(|why| why.contains(word)), "{why:?}");
    }
    // A setting of a start file that is not read yet makes no difference.
    let unread = change(&|f| f.start = start(([4, 5], 6), None));
    assert_eq!(unread.difference(&own), None);
}

#[test]
fn progress_of_mode_groups_is_added() {
    let statistics = |least_norm_ratio, defect, applications| BatchStatistics {
        least_norm_ratio,
        defect,
        applications,
        solves: 2,
    };
    let state = |finished: &[usize], statistics: BatchStatistics| GroupProgress {
        finished: finished.to_vec(),
        beyond: vec![0.5],
        statistics,
        ..GroupProgress::default()
    };
    let mut all = state(&[3, 4], statistics(Some(0.5), None, 7));
    all.add(state(&[1], statistics(Some(0.25), Some(0.1), 5)));
    all.add(state(&[], statistics(None, Some(0.3), 0)));
    let expected = BatchStatistics {
        least_norm_ratio: Some(0.25),
        defect: Some(0.3),
        applications: 12,
        solves: 6,
    };
    assert_eq!((all.finished, all.beyond.len(), all.statistics), (vec![3, 4, 1], 3, expected));
}
