//! A checksum of a dataset, computed by any ranks in any order.
//!
//! Let `b_i` be element `i` (row-major, from 0): its bits as an unsigned number, or a byte of a
//! text. Then
//!
//! ```text
//! checksum = Σ_i mix(b_i + (i + 1) 0x9e3779b97f4a7c15)   mod 2^64
//! mix(z):  z ← (z ⊕ z≫30) 0xbf58476d1ce4e5b9,  z ← (z ⊕ z≫27) 0x94d049bb133111eb,  z ⊕ z≫31
//! ```
//!
//! `mix` is a permutation of the 64-bit numbers (that of SplitMix64: Steele, Lea, Flood 2014). Any
//! single changed element changes the sum; other changes go undetected once in 2^64.

use crate::base::row_major::{DatasetBox, number};
use serde::{Deserialize, Serialize};
use std::collections::BTreeMap;
use std::fs::File;
use std::os::unix::fs::FileExt;
use std::path::Path;

/// The term of the element at `index`.
fn term(index: u64, bits: u64) -> u64 {
    let z = bits.wrapping_add(index.wrapping_add(1).wrapping_mul(0x9e37_79b9_7f4a_7c15));
    let z = (z ^ z >> 30).wrapping_mul(0xbf58_476d_1ce4_e5b9);
    let z = (z ^ z >> 27).wrapping_mul(0x94d0_49bb_1331_11eb);
    z ^ z >> 31
}

/// The sum over consecutive elements, the first of which has the index `first`.
pub fn run_checksum(first: u64, elements: impl Iterator<Item = u64>) -> u64 {
    (first..).zip(elements).fold(0, |sum, (index, bits)| sum.wrapping_add(term(index, bits)))
}

/// The checksum of a text.
pub fn of_text(bytes: &[u8]) -> u64 {
    run_checksum(0, bytes.iter().copied().map(u64::from))
}

/// A checksum as files give it: 16 hexadecimal digits.
pub fn text(checksum: u64) -> String {
    format!("{checksum:016x}")
}

/// Size and checksum of a file.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
pub struct FileChecksum {
    /// Size of the file in bytes.
    pub bytes: u64,
    /// The checksum of its bytes as 64-bit words, little-endian, the last one filled up with zeros.
    pub checksum: u64,
}

/// Sizes and checksums of files, by name.
pub type FileChecksums = BTreeMap<String, FileChecksum>;

/// Size of a file, and the contribution to its checksum of the pieces `first`, `first + of`, ….
///
/// # Errors
/// The error of the system.
pub fn of_file(path: &Path, first: usize, of: usize) -> std::io::Result<FileChecksum> {
    const PIECE: usize = 4 << 20;
    let file = File::open(path)?;
    let bytes = file.metadata()?.len();
    // No more than is there: most files are small, and to clear so much memory takes longer.
    let most = bytes.min(PIECE as u64) as usize;
    let (mut piece, mut checksum) = (vec![0; most.next_multiple_of(8)], 0u64);
    for start in (0..bytes).step_by(PIECE).skip(first).step_by(of) {
        let length = (bytes - start).min(PIECE as u64) as usize;
        file.read_exact_at(&mut piece[..length], start)?;
        let filled = length.next_multiple_of(8);
        piece[length..filled].fill(0);
        let (words, _) = piece[..filled].as_chunks();
        let words = words.iter().map(|word| u64::from_le_bytes(*word));
        checksum = checksum.wrapping_add(run_checksum(start / 8, words));
    }
    Ok(FileChecksum { bytes, checksum })
}

/// The contribution of a slab to the checksum of a dataset of this shape.
pub fn of_slab(shape: &[usize], slab: &DatasetBox, values: &[f64]) -> u64 {
    let Some(&run) = slab.count.last() else { return 0 };
    let mut sum: u64 = 0;
    let mut place = slab.start.clone();
    for values in values.chunks_exact(run.max(1)) {
        let first = number(shape.iter().copied(), place.iter().copied());
        sum = sum.wrapping_add(run_checksum(first as u64, values.iter().map(|x| x.to_bits())));
        // The next run: all axes but the last, row-major.
        for axis in (0..place.len() - 1).rev() {
            place[axis] += 1;
            if place[axis] < slab.start[axis] + slab.count[axis] {
                break;
            }
            place[axis] = slab.start[axis];
        }
    }
    sum
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::base::row_major::indices;

    fn values(count: usize) -> Vec<f64> {
        (0..count).map(|i| (i as f64 * 0.7).sin()).collect()
    }

    fn whole(shape: &[usize], values: &[f64]) -> u64 {
        of_slab(shape, &DatasetBox::whole(shape), values)
    }

    /// SplitMix64 seeded with 0 gives these: the terms of elements that are 0.
    #[test]
    fn terms_are_those_of_the_generator() {
        assert_eq!(term(0, 0), 0xe220_a839_7b1d_cdaf);
        assert_eq!(term(1, 0), 0x6e78_9e6a_a1b9_65f4);
        assert_eq!(term(2, 0), 0x06c4_5d18_8009_454f);
    }

    #[test]
    fn pieces_make_up_the_whole() {
        for shape in [&[5, 7, 3][..], &[1, 1], &[13], &[2, 9, 1, 4]] {
            let size: usize = shape.iter().product();
            let all = values(size);
            let expected = whole(shape, &all);
            assert_eq!(expected, run_checksum(0, all.iter().map(|x| x.to_bits())));
            for most in 1..=size + 1 {
                let (mut sum, mut seen) = (0u64, vec![0; size]);
                for slab in DatasetBox::pieces(shape, most) {
                    let mut part = Vec::new();
                    for (i, &value) in all.iter().enumerate() {
                        let place = indices(i, shape);
                        let within = |(a, at): (usize, &usize)| {
                            (slab.start[a]..slab.start[a] + slab.count[a]).contains(at)
                        };
                        if place.iter().enumerate().all(within) {
                            part.push(value);
                            seen[i] += 1;
                        }
                    }
                    assert_eq!(part.len(), slab.size(), "{shape:?} {slab:?}");
                    assert!(part.len() <= most, "{shape:?} {slab:?}");
                    sum = sum.wrapping_add(of_slab(shape, &slab, &part));
                }
                assert!(seen.iter().all(|&n| n == 1), "{shape:?} by {most}: {seen:?}");
                assert_eq!(sum, expected, "{shape:?} by {most}");
            }
        }
    }

    #[test]
    fn changes_are_seen() {
        let shape = [4, 6];
        let all = values(24);
        let expected = whole(&shape, &all);
        for i in 0..24 {
            let mut changed = all.clone();
            changed[i] = f64::from_bits(all[i].to_bits() ^ 1 << (2 * i));
            assert_ne!(whole(&shape, &changed), expected);
            let mut swapped = all.clone();
            swapped.swap(i, (i + 1) % 24);
            assert_ne!(whole(&shape, &swapped), expected);
        }
        assert_ne!(whole(&shape, &[0.0; 24]), whole(&shape, &[-0.0; 24]));
    }
}
