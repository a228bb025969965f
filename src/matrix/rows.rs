//! Sparse rows of `(S, K)`, those that repeat stored once.
//!
//! Far from jumps, ends and weights the row of a cell is that of the next cell along x: the same
//! values at the same distances from the diagonal. Such rows share a template, so that the inner
//! loop reads four bytes a row instead of a hundred, and templates stay in the first cache.

use std::collections::HashMap;
use std::hash::{BuildHasherDefault, Hasher};

/// An entry: local column, `s` and `k`.
pub type Entry = (u32, f64, f64);

/// Rows in their order. Only the order of a row's entries matters to the bits of a product, and it
/// is kept.
#[derive(Clone, Debug)]
pub struct Rows {
    /// Template of each row.
    template: Vec<u32>,
    /// Entries `offsets[t]..offsets[t + 1]` are those of template `t`.
    offsets: Vec<usize>,
    /// Column minus row, modulo 2³².
    distances: Vec<u32>,
    /// `[s, k]`.
    values: Vec<[f64; 2]>,
    /// Entries over all rows.
    entries: usize,
    /// Every column is below this.
    reach: usize,
}

impl Rows {
    /// Number of rows.
    pub(crate) fn len(&self) -> usize {
        self.template.len()
    }

    /// Entries over all rows.
    pub fn entries(&self) -> usize {
        self.entries
    }

    /// Rows that differ.
    pub fn templates(&self) -> usize {
        self.offsets.len() - 1
    }

    /// Bytes it takes.
    pub fn bytes(&self) -> usize {
        4 * self.template.len() + 8 * self.offsets.len() + 20 * self.distances.len()
    }

    /// The entries of row `i`, in the order they were given.
    #[inline(always)]
    pub fn row(&self, i: usize) -> impl Iterator<Item = (usize, f64, f64)> + '_ {
        let t = self.template[i] as usize;
        // SAFETY: templates are numbers below `templates()`, so that `t + 1` is a place in
        // `offsets`, which rise to the common length of `distances` and `values`; `Builder` makes
        // nothing else, and nobody changes them.
        let entry = |e: usize| unsafe {
            let [s, k] = *self.values.get_unchecked(e);
            (*self.distances.get_unchecked(e), s, k)
        };
        let (start, end) = unsafe {
            let start = *self.offsets.get_unchecked(t);
            (start, *self.offsets.get_unchecked(t + 1))
        };
        (start..end).map(move |e| {
            let (distance, s, k) = entry(e);
            ((i as u32).wrapping_add(distance) as usize, s, k)
        })
    }

    /// One more than the largest column: a vector that long can be multiplied.
    pub fn reach(&self) -> usize {
        self.reach
    }

    /// The same rows with entries changed by `change(row, entries)`.
    pub fn changed(&self, mut change: impl FnMut(usize, &mut Vec<Entry>)) -> Self {
        let mut builder = Builder::with_capacity(self.len());
        let mut entries: Vec<Entry> = Vec::new();
        for i in 0..self.len() {
            entries.clear();
            entries.extend(self.row(i).map(|(column, s, k)| (column as u32, s, k)));
            change(i, &mut entries);
            builder.push(&entries);
        }
        builder.finish()
    }
}

/// Hashes are used as they are.
#[derive(Default)]
struct AsItIs(u64);

impl Hasher for AsItIs {
    fn finish(&self) -> u64 {
        self.0
    }
    fn write(&mut self, _: &[u8]) {}
    fn write_u64(&mut self, value: u64) {
        self.0 = value;
    }
}

/// Makes [`Rows`], row by row.
pub struct Builder {
    rows: Rows,
    /// Templates by hash.
    seen: HashMap<u64, u32, BuildHasherDefault<AsItIs>>,
}

/// Templates that are remembered: rows that repeat do so within a few layers of cells.
const REMEMBERED: usize = 1 << 20;

impl Builder {
    /// For about so many rows.
    pub fn with_capacity(rows: usize) -> Self {
        Self {
            rows: Rows {
                template: Vec::with_capacity(rows),
                offsets: vec![0],
                distances: Vec::new(),
                values: Vec::new(),
                entries: 0,
                reach: 0,
            },
            seen: HashMap::default(),
        }
    }

    /// The next row.
    pub fn push(&mut self, entries: &[Entry]) {
        let rows = &mut self.rows;
        let i = rows.template.len() as u32;
        rows.entries += entries.len();
        for &(column, ..) in entries {
            rows.reach = rows.reach.max(column as usize + 1);
        }
        let words =
            |&(column, s, k): &Entry| [u64::from(column.wrapping_sub(i)), s.to_bits(), k.to_bits()];
        // Multiply and fold (as wyhash does): all bits of a word reach all bits of the hash.
        let mix = |hash: u64, word: u64| {
            let product = u128::from(hash ^ word ^ 0x9e37_79b9_7f4a_7c15) * 0xd1b5_4a32_d192_ed03;
            (product as u64) ^ (product >> 64) as u64
        };
        let hash = entries.iter().flat_map(words).fold(entries.len() as u64, mix);
        let same = |t: u32| {
            let range = rows.offsets[t as usize]..rows.offsets[t as usize + 1];
            let known = rows.distances[range.clone()].iter().zip(&rows.values[range.clone()]);
            range.len() == entries.len()
                && known
                    .zip(entries)
                    .all(|((d, [s, k]), e)| [u64::from(*d), s.to_bits(), k.to_bits()] == words(e))
        };
        let found = self.seen.get(&hash).copied().filter(|&t| same(t));
        let template = found.unwrap_or_else(|| {
            let new = (rows.offsets.len() - 1) as u32;
            for &(column, s, k) in entries {
                rows.distances.push(column.wrapping_sub(i));
                rows.values.push([s, k]);
            }
            rows.offsets.push(rows.distances.len());
            if self.seen.len() == REMEMBERED {
                self.seen.clear();
            }
            self.seen.insert(hash, new);
            new
        });
        rows.template.push(template);
    }

    /// All rows.
    pub fn finish(mut self) -> Rows {
        let rows = &mut self.rows;
        rows.offsets.shrink_to_fit();
        rows.distances.shrink_to_fit();
        rows.values.shrink_to_fit();
        self.rows
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn rows_come_back_and_those_that_repeat_are_stored_once() {
        let list: Vec<Vec<Entry>> = vec![
            vec![(0, -1.0, 0.0), (1, 0.5, -0.5)],
            vec![(1, -1.0, 0.0), (2, 0.5, -0.5)],
            vec![],
            vec![(1, 0.5, 0.5), (3, -1.0, 0.0)],
            vec![(4, -1.0, 0.0), (5, 0.5, -0.5)],
            vec![(5, -1.0, -0.0), (6, 0.5, -0.5)],
        ];
        let mut builder = Builder::with_capacity(list.len());
        list.iter().for_each(|row| builder.push(row));
        let rows = builder.finish();
        // Rows 0, 1 and 4 are one; the sign of zero tells 5 from them.
        assert_eq!((rows.len(), rows.templates(), rows.entries()), (6, 4, 10));
        let back = |rows: &Rows| -> Vec<Vec<Entry>> {
            (0..rows.len())
                .map(|i| rows.row(i).map(|(c, s, k)| (c as u32, s, k)).collect())
                .collect()
        };
        assert_eq!(back(&rows), list);
        assert_eq!(rows.reach(), 7);
        let doubled = rows.changed(|_, entries| entries.iter_mut().for_each(|e| e.1 *= 2.0));
        assert_eq!(doubled.templates(), 4);
        assert_eq!(back(&doubled)[3], vec![(1, 1.0, 0.5), (3, -2.0, 0.0)]);
    }
}
