//! Sparse rows of `(S, K)`; equal rows are stored once.
//!
//! Away from jumps and ends, and without weights, the row of a cell equals that of the next cell
//! along x: the same values at the same distances from the diagonal. Such rows share a template, so
//! that the inner loop reads four bytes a row instead of a hundred, and templates stay in the first
//! cache.
//!
//! Rows of elements are gathered (`Rows::gathered`): the rows of an element's nodes along the first
//! space axis form a line, whose couplings to each other are a dense block of `K`. A kernel reads
//! the nodes of a line once for all of its rows. Couplings along velocity axes are those of
//! `VelocityLines` and are not stored.

use crate::matrix::row_lines::{MOST_NODES, MatrixEntry, RowLines};
use crate::matrix::velocity_lines::VelocityLines;
use std::collections::HashMap;
use std::hash::{BuildHasherDefault, Hasher};

/// Rows in order, gathered into lines: of one row each, or of the rows of an element's nodes.
/// Gathering keeps the order of a row's entries, and so the bits of products, but for couplings
/// along velocity axes, which are summed by themselves.
#[derive(Clone, Debug)]
pub struct Rows {
    /// The lines that the rows of cells are gathered into.
    lines: RowLines,
    /// Template of the first row of each line; those of its other rows are the next ones.
    template: Vec<u32>,
    /// `k` of each template at the nodes of its line, `lines.nodes` numbers a template; empty if a
    /// line is one row.
    dense: Vec<f64>,
    /// Entries `offsets[t]..offsets[t + 1]` are the other entries of template `t`.
    offsets: Vec<usize>,
    /// Column minus row, modulo 2³².
    distances: Vec<u32>,
    /// `[s, k]`.
    values: Vec<[f64; 2]>,
    /// Couplings along velocity axes, in addition to the entries.
    velocity_lines: VelocityLines,
    /// Every column is below this.
    reach: usize,
}

/// The fields of [`Rows`] that the inner loop reads.
///
/// A loop that holds them keeps their addresses and lengths in registers. Through `&Rows` it would
/// read them again after every store, because the compiler cannot tell that `y` is elsewhere.
#[derive(Clone, Copy)]
pub(crate) struct RowSlices<'a> {
    /// The lines that the rows of cells are gathered into.
    pub lines: RowLines,
    /// Template of the first row of each line.
    pub template: &'a [u32],
    dense: &'a [f64],
    offsets: &'a [usize],
    distances: &'a [u32],
    values: &'a [[f64; 2]],
}

impl<'a> RowSlices<'a> {
    /// `k` of a template at the nodes of its line of `NODES` rows.
    #[inline(always)]
    pub fn dense_nodes<const NODES: usize>(self, template: usize) -> &'a [f64; NODES] {
        let (rows, _) = self.dense.as_chunks::<NODES>();
        &rows[template]
    }

    /// As [`Rows::others`].
    #[inline(always)]
    pub fn others(self, template: usize, i: usize) -> impl Iterator<Item = (usize, f64, f64)> + 'a {
        let range = self.offsets[template]..self.offsets[template + 1];
        let entries = self.distances[range.clone()].iter().zip(&self.values[range]);
        entries.map(move |(distance, [s, k])| ((i as u32).wrapping_add(*distance) as usize, *s, *k))
    }
}

impl Rows {
    /// The lines of the rows.
    pub fn lines(&self) -> &RowLines {
        &self.lines
    }

    /// Number of lines.
    pub fn line_count(&self) -> usize {
        self.template.len()
    }

    /// Number of rows.
    pub(crate) fn len(&self) -> usize {
        self.template.len() + self.lines.of_cells() * (self.lines.nodes - 1)
    }

    /// Number of different rows.
    pub fn templates(&self) -> usize {
        self.offsets.len() - 1
    }

    /// Bytes of the rows.
    pub fn bytes(&self) -> usize {
        let entries = 20 * self.distances.len() + 8 * self.dense.len();
        let stored = 4 * self.template.len() + 8 * self.offsets.len() + entries;
        stored + self.velocity_lines.bytes()
    }

    /// Bytes of the table in which equal rows are searched while so many different ones are built.
    pub(crate) fn bytes_to_find_equal(templates: usize) -> usize {
        // A hash, a template and a control byte; an eighth of the table stays free. While it grows,
        // a table of half the size is there, too.
        17 * (templates.min(REMEMBERED) * 8 / 7).next_power_of_two() * 3 / 2
    }

    /// The couplings along velocity axes.
    #[inline(always)]
    pub(crate) fn velocity_lines(&self) -> &VelocityLines {
        &self.velocity_lines
    }

    /// The entries of row `i`: those of the nodes of its line, the others in the given order, then
    /// those along velocity axes.
    pub fn row(&self, i: usize) -> impl Iterator<Item = (usize, f64, f64)> + '_ {
        let mut along_velocities = self.velocity_lines.entries(i);
        if !along_velocities.is_empty() {
            for (column, s, k) in self.stored_row(i) {
                let same = along_velocities.iter_mut().find(|entry| entry.0 as usize == column);
                if let Some((_, sum_s, sum_k)) = same {
                    (*sum_s, *sum_k) = (*sum_s + s, *sum_k + k);
                }
            }
        }
        let apart = move |entry: &(usize, f64, f64)| !self.velocity_lines.couples(i, entry.0);
        let along_velocities = along_velocities.into_iter().map(|(j, s, k)| (j as usize, s, k));
        self.stored_row(i).filter(apart).chain(along_velocities)
    }

    /// The entries of a row without those along velocity axes.
    #[inline(always)]
    pub(crate) fn stored_row(&self, i: usize) -> impl Iterator<Item = (usize, f64, f64)> + '_ {
        let (line, node) = self.lines.line_and_node(i);
        let template = self.template[line] as usize + node;
        let first = i - node * self.lines.stride;
        let column = move |m: usize| first + m * self.lines.stride;
        let dense = self.dense_row(template).iter().enumerate().filter(|(_, k)| **k != 0.0);
        dense.map(move |(m, k)| (column(m), 0.0, *k)).chain(self.others(template, i))
    }

    /// The template of the first row of a line.
    #[inline(always)]
    pub(crate) fn template(&self, line: usize) -> usize {
        self.template[line] as usize
    }

    /// `k` of a template at the nodes of its line.
    #[inline(always)]
    pub(crate) fn dense_row(&self, template: usize) -> &[f64] {
        let nodes = self.lines.nodes;
        if self.dense.is_empty() { &[] } else { &self.dense[template * nodes..][..nodes] }
    }

    /// The entries of a template but those of the nodes of its line, with the columns for row `i`.
    #[inline(always)]
    pub(crate) fn others(
        &self,
        template: usize,
        i: usize,
    ) -> impl Iterator<Item = (usize, f64, f64)> + '_ {
        self.slices().others(template, i)
    }

    /// The rows as slices.
    #[inline(always)]
    pub(crate) fn slices(&self) -> RowSlices<'_> {
        RowSlices {
            lines: self.lines,
            template: &self.template,
            dense: &self.dense,
            offsets: &self.offsets,
            distances: &self.distances,
            values: &self.values,
        }
    }

    /// One more than the largest column: the length that a vector must have.
    pub fn reach(&self) -> usize {
        self.reach
    }

    /// Fused multiply-adds of a Chebyshev step of one mode: two for an entry at a node of its line,
    /// which only `K` has, four for any other entry, and seven more for a row.
    pub fn multiply_adds(&self) -> usize {
        let of_row = |template: usize, i: usize| {
            7 + 2 * self.dense_row(template).len() + 4 * self.others(template, i).count()
        };
        let of_line = |line: usize| {
            let rows = self.lines.rows(line).enumerate();
            rows.map(|(m, i)| of_row(self.template(line) + m, i)).sum::<usize>()
        };
        let along_velocities = self.velocity_lines.multiply_adds();
        (0..self.line_count()).map(of_line).sum::<usize>() + along_velocities
    }

    /// The rows with entries changed by `change(row, entries)`. For `plain` rows the change depends
    /// only on the values of the entries.
    pub fn changed(
        &self,
        plain: impl Fn(usize) -> bool,
        mut change: impl FnMut(usize, &mut Vec<MatrixEntry>),
    ) -> Self {
        let mut builder = RowsBuilder::with_capacity(self.len());
        builder.reserve_as(self);
        let mut entries: Vec<MatrixEntry> = Vec::new();
        // The first plain row of each template.
        let mut first: Vec<Option<u32>> = vec![None; self.templates()];
        for i in 0..self.len() {
            if plain(i) {
                let (line, node) = self.lines.line_and_node(i);
                match &mut first[self.template[line] as usize + node] {
                    Some(earlier) => {
                        builder.repeat(*earlier as usize);
                        continue;
                    }
                    first => *first = Some(i as u32),
                }
            }
            entries.clear();
            entries.extend(self.row(i).map(|(column, s, k)| (column as u32, s, k)));
            change(i, &mut entries);
            builder.push(&entries);
        }
        builder.finish()
    }

    /// Rows without the couplings of `velocity_lines`.
    pub(crate) fn without(&self, velocity_lines: &VelocityLines) -> Self {
        let unforced = |i: usize| velocity_lines.forced_at(i).next().is_none();
        self.changed(unforced, |i, entries| velocity_lines.take_from(i, entries))
    }

    /// Rows that are not gathered yet, gathered into `lines`, beside the couplings of
    /// `velocity_lines`, which they are [`without`](Self::without). Couplings between the nodes of
    /// a line whose `s` is only round-off of `k` get `s = 0`, as in exact arithmetic: the
    /// derivative in an element is skew but for its ends.
    pub(crate) fn gathered(&self, lines: RowLines, velocity_lines: VelocityLines) -> Self {
        assert!(self.lines.nodes == 1 && (2..=MOST_NODES).contains(&lines.nodes));
        let count = lines.of_cells() + self.len() - lines.cells;
        let mut gathered =
            Self { velocity_lines, reach: self.reach, ..Self::with_capacity(lines, count) };
        // Lines are equal if the templates of their rows are.
        let mut seen: HashMap<[u32; MOST_NODES], u32> = HashMap::default();
        for line in 0..count {
            // A line of one row differs from a line of several.
            let mut of_rows = [u32::MAX; MOST_NODES];
            for (of_row, i) in of_rows.iter_mut().zip(lines.rows(line)) {
                *of_row = self.template[i];
            }
            let template = seen.get(&of_rows).copied().unwrap_or_else(|| {
                let new = gathered.templates() as u32;
                lines.rows(line).for_each(|i| gathered.push_gathered(i, self.row(i)));
                if seen.len() == REMEMBERED {
                    seen.clear();
                }
                seen.insert(of_rows, new);
                new
            });
            gathered.template.push(template);
        }
        gathered.shrunk()
    }

    /// No rows yet, with room for `count` lines.
    fn with_capacity(lines: RowLines, count: usize) -> Self {
        Self {
            lines,
            template: Vec::with_capacity(count),
            dense: Vec::new(),
            offsets: vec![0],
            distances: Vec::new(),
            values: Vec::new(),
            velocity_lines: VelocityLines::default(),
            reach: 0,
        }
    }

    /// These rows without room for more templates.
    fn shrunk(mut self) -> Self {
        self.dense.shrink_to_fit();
        self.offsets.shrink_to_fit();
        self.distances.shrink_to_fit();
        self.values.shrink_to_fit();
        self
    }

    /// Adds the template of row `i` with these `entries`.
    fn push_gathered(&mut self, i: usize, entries: impl Iterator<Item = (usize, f64, f64)>) {
        let RowLines { nodes, cells, .. } = self.lines;
        let begin = self.dense.len();
        self.dense.resize(begin + nodes, 0.0);
        let (line, _) = self.lines.line_and_node(i);
        for (column, s, k) in entries {
            let inside = i < cells && column < cells && s.abs() <= 4.0 * f64::EPSILON * k.abs();
            let (other, node) = self.lines.line_and_node(column);
            if inside && other == line {
                self.dense[begin + node] = k;
            } else {
                self.distances.push((column as u32).wrapping_sub(i as u32));
                self.values.push([s, k]);
            }
        }
        self.offsets.push(self.distances.len());
    }
}

/// A hasher for keys that are already hashes.
#[derive(Default)]
struct IdentityHasher(u64);

impl Hasher for IdentityHasher {
    fn finish(&self) -> u64 {
        self.0
    }
    fn write(&mut self, _: &[u8]) {}
    fn write_u64(&mut self, value: u64) {
        self.0 = value;
    }
}

/// Memory of an assembly, as measured while it is done.
#[derive(Clone, Copy, Debug, Default)]
pub struct AssemblySize {
    /// Largest number of contributions to a row, on average over the layers that are stored.
    pub contributions_per_row: f64,
    /// Bytes of the rows before they are weighted and elements are gathered.
    pub bytes: usize,
    /// Most bytes while rows are replaced by others: of both.
    pub changed_bytes: usize,
}

impl AssemblySize {
    /// Notes that `new` rows were made from `old` ones.
    pub(crate) fn add_change(&mut self, old: &Rows, new: &Rows) {
        let both = old.bytes() + new.bytes() + Rows::bytes_to_find_equal(new.templates());
        self.changed_bytes = self.changed_bytes.max(both);
    }
}

/// Builds [`Rows`], row by row.
pub struct RowsBuilder {
    rows: Rows,
    /// Templates by hash.
    seen: HashMap<u64, u32, BuildHasherDefault<IdentityHasher>>,
}

/// Number of templates in which equal rows are searched: equal rows repeat within a few layers of
/// cells.
const REMEMBERED: usize = 1 << 20;

impl RowsBuilder {
    /// Reserves memory for about `rows` rows.
    pub fn with_capacity(rows: usize) -> Self {
        Self { rows: Rows::with_capacity(RowLines::SINGLE, rows), seen: HashMap::default() }
    }

    /// Reserves memory for the templates of `rows` and a few more. Memory that is not used is never
    /// touched; a vector that grows is copied, and leaves gaps.
    fn reserve_as(&mut self, rows: &Rows) {
        let more = |length: usize| length + length / 16;
        self.rows.offsets.reserve_exact(more(rows.offsets.len()));
        self.rows.distances.reserve_exact(more(rows.distances.len()));
        self.rows.values.reserve_exact(more(rows.values.len()));
    }

    /// Adds the next row.
    pub fn push(&mut self, entries: &[MatrixEntry]) {
        let rows = &mut self.rows;
        let i = rows.template.len() as u32;
        for &(column, ..) in entries {
            rows.reach = rows.reach.max(column as usize + 1);
        }
        let words = |&(column, s, k): &MatrixEntry| {
            [u64::from(column.wrapping_sub(i)), s.to_bits(), k.to_bits()]
        };
        // Multiply and fold, as in wyhash: all bits of a word affect all bits of the hash.
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

    /// Adds a row with the entries of row `earlier`, at the same distances from the diagonal.
    pub fn repeat(&mut self, earlier: usize) {
        let rows = &mut self.rows;
        let (template, i) = (rows.template[earlier], rows.template.len());
        let columns = rows.others(template as usize, i).map(|(column, ..)| column);
        rows.reach = columns.fold(rows.reach, |reach, column| reach.max(column + 1));
        rows.template.push(template);
    }

    /// The finished rows.
    pub fn finish(self) -> Rows {
        self.rows.shrunk()
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn rows_come_back_and_those_that_repeat_are_stored_once() {
        let list: Vec<Vec<MatrixEntry>> = vec![
            vec![(0, -1.0, 0.0), (1, 0.5, -0.5)],
            vec![(1, -1.0, 0.0), (2, 0.5, -0.5)],
            vec![],
            vec![(1, 0.5, 0.5), (3, -1.0, 0.0)],
            vec![(4, -1.0, 0.0), (5, 0.5, -0.5)],
            vec![(5, -1.0, -0.0), (6, 0.5, -0.5)],
        ];
        let mut builder = RowsBuilder::with_capacity(list.len());
        list.iter().for_each(|row| builder.push(row));
        let rows = builder.finish();
        // Rows 0, 1 and 4 are one; row 5 differs by the sign of zero.
        assert_eq!((rows.len(), rows.templates()), (6, 4));
        let back = |rows: &Rows| -> Vec<Vec<MatrixEntry>> {
            (0..rows.len())
                .map(|i| rows.row(i).map(|(c, s, k)| (c as u32, s, k)).collect())
                .collect()
        };
        assert_eq!(back(&rows), list);
        assert_eq!(rows.reach(), 7);
        for plain in [false, true] {
            let double = |_, entries: &mut Vec<_>| {
                entries.iter_mut().for_each(|e: &mut MatrixEntry| e.1 *= 2.0)
            };
            let doubled = rows.changed(|_| plain, double);
            assert_eq!((doubled.templates(), doubled.reach()), (4, 7));
            assert_eq!(back(&doubled)[3], vec![(1, 1.0, 0.5), (3, -2.0, 0.0)]);
            assert_eq!(back(&doubled)[4], vec![(4, -2.0, 0.0), (5, 1.0, -0.5)]);
        }
    }

    /// With a flux of little dissipation, the symmetric part of an entry is small, but it is kept.
    #[test]
    fn gathered_rows_keep_small_symmetric_parts() {
        let list: Vec<Vec<MatrixEntry>> =
            vec![vec![(0, -1e-6, 0.0), (1, 1e-6, -0.5)], vec![(0, 1e-6, 0.5), (1, 0.0, -2.0)]];
        let mut builder = RowsBuilder::with_capacity(list.len());
        list.iter().for_each(|row| builder.push(row));
        let lines = RowLines { nodes: 2, stride: 1, cells: 2 };
        let rows = builder.finish().gathered(lines, VelocityLines::default());
        for (i, expected) in list.iter().enumerate() {
            let mut found: Vec<MatrixEntry> =
                rows.row(i).map(|(c, s, k)| (c as u32, s, k)).collect();
            found.sort_by_key(|entry| entry.0);
            assert_eq!(found, *expected);
        }
        assert_eq!(rows.dense_row(rows.template(0) + 1), [0.0, -2.0]);
    }
}
