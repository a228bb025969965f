//! The file of one rank: 64-bit words, little-endian.
//!
//! | words | |
//! |---|---|
//! | 1 | a mark |
//! | 1 | number of words of the header |
//! | | [`Header`] as JSON, filled up with spaces |
//! | | the sums: two integers a number, point by point of the space block, sum after sum |
//! | | the results: point by point of the share, result after result |
//! | | the cell of each auxiliary unknown |
//! | | the kept modes: a complex number a row, mode after mode |
//! | 1 | checksum of all words before ([`crate::base::checksum`]) |

use crate::base::checksum::run_checksum;
use crate::base::disk::open_regular;
use crate::base::row_major::volume;
use crate::parallel::partition::{CommonRun, common_runs};
use crate::solve::rank_modes::{ModeProgress, RankModes};
use crate::solve::snapshot::{Fingerprint, GroupProgress, Snapshot};
use num_complex::Complex64;
use serde::{Deserialize, Serialize};
use std::collections::HashMap;
use std::fs::File;
use std::io::{BufWriter, Error, ErrorKind, Result, Write};
use std::ops::Range;
use std::os::unix::fs::FileExt;
use std::path::Path;

const MARK: u64 = u64::from_le_bytes(*b"phwarp01");
/// Words read or written at a time: 512 KiB.
const PIECE: usize = 1 << 16;

/// The header of a file.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct Header {
    /// The run that the file belongs to.
    pub fingerprint: Fingerprint,
    /// Number of the checkpoint.
    pub generation: u64,
    /// The rank that wrote the file.
    pub rank: usize,
    /// Space cells of the rank's block.
    pub block: Vec<Range<usize>>,
    /// Space cells of the rank's share.
    pub share: Vec<Range<usize>>,
    /// Velocity cells at a point of space.
    pub velocity_cells: usize,
    /// Numbers at a point of space, of each sum.
    pub sums: Vec<usize>,
    /// Numbers at a point of space, of each result.
    pub results: Vec<usize>,
    /// Auxiliary unknowns of the block.
    pub auxiliary: usize,
    /// The modes in the file, and the progress of each.
    pub kept: Vec<(usize, ModeProgress)>,
    /// Progress of the rank's mode group.
    pub state: GroupProgress,
}

/// Offsets of the parts of a file, in words from the first sum.
struct PartOffsets {
    results: usize,
    auxiliary: usize,
    kept: usize,
    end: usize,
}

impl Header {
    /// Rows of a kept mode.
    fn rows(&self) -> usize {
        volume(&self.block) * self.velocity_cells + self.auxiliary
    }

    /// The offsets of its parts; `None` if they overflow.
    fn starts(&self) -> Option<PartOffsets> {
        let points = |ranges: &[Range<usize>]| {
            ranges.iter().try_fold(1usize, |n, range| n.checked_mul(range.len()))
        };
        let all = |widths: &[usize]| widths.iter().try_fold(0usize, |n, &w| n.checked_add(w));
        let block = points(&self.block)?;
        let sums = block.checked_mul(all(&self.sums)?)?.checked_mul(2)?;
        let results = points(&self.share)?.checked_mul(all(&self.results)?)?;
        let rows = block.checked_mul(self.velocity_cells)?.checked_add(self.auxiliary)?;
        let modes = rows.checked_mul(2)?.checked_mul(self.kept.len())?;
        let auxiliary = sums.checked_add(results)?;
        let kept = auxiliary.checked_add(self.auxiliary)?;
        Some(PartOffsets { results: sums, auxiliary, kept, end: kept.checked_add(modes)? })
    }

    /// Words from the first sum to the checksum; `None` if they overflow.
    #[cfg(test)]
    pub(super) fn words(&self) -> Option<usize> {
        self.starts().map(|starts| starts.end)
    }

    /// Whether its contents have the kind and widths that `to` reads, for any part of the grid.
    fn suits(&self, to: &ReadDestination<'_>) -> bool {
        let is_box = |ranges: &[Range<usize>], other: &[Range<usize>]| {
            ranges.len() == other.len() && ranges.iter().all(|range| range.start <= range.end)
        };
        let (block, share) = (volume(to.block), volume(to.share));
        let sums = to.sums.iter().map(|sum| sum.len());
        let results = to.results.iter().map(Vec::len);
        is_box(&self.block, to.block)
            && is_box(&self.share, to.share)
            && sums.eq(self.sums.iter().map(|width| width.saturating_mul(2 * block)))
            && results.eq(self.results.iter().map(|width| width.saturating_mul(share)))
            && to.kept.as_ref().is_none_or(|(auxiliary, modes)| {
                let cells = block.saturating_mul(self.velocity_cells);
                modes.rows() == cells.saturating_add(auxiliary.len())
            })
    }
}

/// The record of a written file.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
pub struct FileRecord {
    /// Size of the file in bytes.
    pub bytes: u64,
    /// Checksum: the last word of the file.
    pub checksum: u64,
}

/// Writes a file at `path` and flushes it to disk.
///
/// # Errors
/// The error of the file system.
pub fn write(path: &Path, header: &Header, snapshot: &Snapshot<'_>) -> Result<FileRecord> {
    let mut text = serde_json::to_vec(header)?;
    text.resize(text.len().next_multiple_of(8), b' ');
    let (words, _) = text.as_chunks::<8>();
    let file = BufWriter::with_capacity(8 * PIECE, File::create(path)?);
    let mut sink = FileWriter { file, words: 0, checksum: 0 };
    sink.put([MARK, words.len() as u64].into_iter())?;
    sink.put(words.iter().map(|w| u64::from_le_bytes(*w)))?;
    for sum in &snapshot.sums {
        sink.put(sum.values.iter().map(|&part| part as u64))?;
    }
    for result in &snapshot.results {
        sink.put(result.values.iter().map(|x| x.to_bits()))?;
    }
    if let Some(kept) = &snapshot.kept {
        sink.put(kept.auxiliary.iter().copied())?;
        for mode in &kept.modes {
            sink.put((mode.rows.iter()).flat_map(|w| [w.re.to_bits(), w.im.to_bits()]))?;
        }
    }
    let checksum = sink.checksum;
    sink.put(std::iter::once(checksum))?;
    sink.file.flush()?;
    sink.file.get_ref().sync_all()?;
    Ok(FileRecord { bytes: 8 * sink.words, checksum })
}

struct FileWriter {
    file: BufWriter<File>,
    words: u64,
    checksum: u64,
}

impl FileWriter {
    fn put(&mut self, words: impl Iterator<Item = u64>) -> Result<()> {
        for word in words {
            self.checksum =
                (self.checksum).wrapping_add(run_checksum(self.words, std::iter::once(word)));
            self.words += 1;
            self.file.write_all(&word.to_le_bytes())?;
        }
        Ok(())
    }
}

/// Checks that the file is as it was written.
///
/// # Errors
/// A sentence that says what is wrong with the file.
pub fn check(path: &Path, written: &FileRecord) -> std::result::Result<(), String> {
    let file = open_regular(path).map_err(|e| e.to_string())?;
    let bytes = file.metadata().map_err(|e| e.to_string())?.len();
    if bytes != written.bytes {
        let expected = written.bytes;
        return Err(format!("{bytes} bytes, {expected} were written"));
    }
    if bytes < 8 {
        return Err("is empty".to_owned());
    }
    let (count, mut sum, mut last) = (bytes as usize / 8 - 1, 0u64, 0);
    read_words(&file, 0, count, |at, words| {
        sum = sum.wrapping_add(run_checksum(at as u64, words.iter().copied()));
    })
    .and_then(|()| read_words(&file, count, 1, |_, words| last = words[0]))
    .map_err(|e| e.to_string())?;
    let is_sound = sum == last && sum == written.checksum;
    let damaged = || "is not as it was written (its checksum differs)".to_owned();
    is_sound.then_some(()).ok_or_else(damaged)
}

/// Reads `count` words from number `first` on, piece by piece: calls `visit(number of the piece's
/// first word, counted from first, words)`.
fn read_words(
    file: &File,
    first: usize,
    count: usize,
    mut visit: impl FnMut(usize, &[u64]),
) -> Result<()> {
    let mut bytes = vec![0u8; 8 * count.min(PIECE)];
    let mut words = Vec::with_capacity(count.min(PIECE));
    for start in (0..count).step_by(PIECE) {
        let bytes = &mut bytes[..8 * (count - start).min(PIECE)];
        file.read_exact_at(bytes, 8 * (first + start) as u64)?;
        words.clear();
        words.extend((bytes.as_chunks().0.iter()).map(|w| u64::from_le_bytes(*w)));
        visit(start, &words);
    }
    Ok(())
}

/// The error of a file that is no file of a checkpoint, or that does not fit its header.
fn not_a_checkpoint() -> Error {
    Error::new(ErrorKind::InvalidData, "is no file of a checkpoint")
}

/// A file that was checked, opened for reading.
pub struct RankFile {
    /// The header of the file.
    pub header: Header,
    starts: PartOffsets,
    file: File,
    /// Words before the arrays.
    before: usize,
}

/// The vectors into which a rank reads the contents of files.
pub struct ReadDestination<'a> {
    /// Space cells of its block.
    pub block: &'a [Range<usize>],
    /// Space cells of its share.
    pub share: &'a [Range<usize>],
    /// The sums, as many and as wide as in the files, whose values are added.
    pub sums: Vec<&'a mut [i64]>,
    /// The results, as many and as wide as in the files.
    pub results: Vec<Vec<f64>>,
    /// The modes that it stores, if any, and the cells to which their auxiliary unknowns belong
    /// ([`crate::solve::snapshot::StoredModes::auxiliary`]).
    pub kept: Option<(Vec<u64>, &'a mut RankModes)>,
}

impl RankFile {
    /// Opens a file and reads its header.
    ///
    /// # Errors
    /// The error of the file system, or that the file is no checkpoint.
    pub fn open(path: &Path) -> Result<Self> {
        let file = open_regular(path)?;
        let mut start = [0; 2];
        read_words(&file, 0, 2, |_, words| start.copy_from_slice(words))?;
        let words = file.metadata()?.len() / 8;
        // The header of a million modes takes more than 100 MB.
        if start[0] != MARK || start[1] >= words {
            return Err(not_a_checkpoint());
        }
        let length = start[1] as usize;
        let mut text = Vec::new();
        text.try_reserve_exact(8 * length).map_err(|_| not_a_checkpoint())?;
        read_words(&file, 2, length, |_, words| {
            text.extend(words.iter().flat_map(|w| w.to_le_bytes()));
        })?;
        let header: Header = serde_json::from_slice(&text).map_err(|_| not_a_checkpoint())?;
        let before = 2 + length;
        let starts = header.starts().ok_or_else(not_a_checkpoint)?;
        if before.checked_add(starts.end).and_then(|w| w.checked_add(1)) != Some(words as usize) {
            return Err(not_a_checkpoint());
        }
        Ok(Self { header, starts, file, before })
    }

    /// Reads the parts that overlap with `to`; the sums only if `with_sums`.
    ///
    /// # Errors
    /// If the file cannot be read, or its contents do not fit `to`.
    pub fn read_into(&self, to: &mut ReadDestination<'_>, with_sums: bool) -> Result<()> {
        let header = &self.header;
        if !header.suits(to) {
            return Err(not_a_checkpoint());
        }
        if with_sums {
            let sums = to.sums.iter_mut().map(|sum| &mut **sum);
            let sums = sums.zip(header.sums.iter().map(|numbers| 2 * numbers));
            self.read_arrays(0, [&header.block, to.block], sums, |sum, word| *sum += word as i64)?;
        }
        let results = to.results.iter_mut().map(|result| &mut result[..]);
        let results = results.zip(header.results.iter().copied());
        let boxes = [&header.share[..], to.share];
        self.read_arrays(self.starts.results, boxes, results, |x, word| *x = f64::from_bits(word))?;
        self.read_modes(to)
    }

    /// Reads arrays on the box `from` of space cells, which follow each other from word `first` on,
    /// where that overlaps with the box `to`. Each array comes with the count of its numbers at a
    /// space cell; `put` puts a word into a number.
    fn read_arrays<'v, T: 'v>(
        &self,
        mut first: usize,
        [from, to]: [&[Range<usize>]; 2],
        arrays: impl Iterator<Item = (&'v mut [T], usize)>,
        put: impl Fn(&mut T, u64),
    ) -> Result<()> {
        let runs = common_runs(from, to);
        for (array, width) in arrays {
            for run in &runs {
                let into = &mut array[run.to * width..(run.to + run.length) * width];
                self.read(first + run.from * width, into.len(), |at, words| {
                    into[at..].iter_mut().zip(words).for_each(|(number, &word)| put(number, word));
                })?;
            }
            first += volume(from) * width;
        }
        Ok(())
    }

    /// Reads the common rows of the modes that both the file and `to` store.
    fn read_modes(&self, to: &mut ReadDestination<'_>) -> Result<()> {
        let header = &self.header;
        let &PartOffsets { auxiliary, kept, .. } = &self.starts;
        let Some((mine, modes)) = &mut to.kept else {
            return Ok(());
        };
        // The destinations of the file's auxiliary unknowns.
        let places: HashMap<u64, usize> = mine.iter().copied().zip(0..).collect();
        let mut auxiliary_runs: Vec<CommonRun> = Vec::new();
        self.read(auxiliary, header.auxiliary, |at, words| {
            for (cell, from) in words.iter().zip(at..) {
                let Some(&to) = places.get(cell) else { continue };
                match auxiliary_runs.last_mut() {
                    Some(run) if [run.from + run.length, run.to + run.length] == [from, to] => {
                        run.length += 1;
                    }
                    _ => auxiliary_runs.push(CommonRun { from, to, length: 1 }),
                }
            }
        })?;
        let runs = common_runs(&header.block, to.block);
        let velocities = header.velocity_cells;
        let from_cells = volume(&header.block) * velocities;
        let to_cells = volume(to.block) * velocities;
        for (k, &(mode, progress)) in header.kept.iter().enumerate() {
            let Some(rows) = modes.replace(mode, progress) else {
                continue;
            };
            let first = kept + k * 2 * header.rows();
            for run in &runs {
                let cells = run.to * velocities..(run.to + run.length) * velocities;
                self.read_complex(first + 2 * run.from * velocities, &mut rows[cells])?;
            }
            for run in &auxiliary_runs {
                let own = &mut rows[to_cells + run.to..][..run.length];
                self.read_complex(first + 2 * (from_cells + run.from), own)?;
            }
        }
        Ok(())
    }

    fn read(&self, first: usize, count: usize, visit: impl FnMut(usize, &[u64])) -> Result<()> {
        read_words(&self.file, self.before + first, count, visit)
    }

    fn read_complex(&self, first: usize, into: &mut [Complex64]) -> Result<()> {
        self.read(first, 2 * into.len(), |at, words| {
            // Pieces hold an even number of words.
            for (w, pair) in into[at / 2..].iter_mut().zip(words.as_chunks().0) {
                let [re, im] = pair.map(f64::from_bits);
                *w = Complex64::new(re, im);
            }
        })
    }
}
