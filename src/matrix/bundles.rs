//! Bundles of lines, for products with real vectors.
//!
//! Consecutive lines belong to one element along the first space axis and to neighbouring
//! velocities or other nodes; for degree 0 they are the rows of velocities at one space cell. If
//! their rows have entries at the same distances from the diagonal, the values of the lines of a
//! bundle are stored side by side. A bundle then takes one pass of vector operations, which adds
//! the entries of each row in their own order.

use crate::matrix::row_lines::RowLines;
use crate::matrix::rows::Rows;
use std::collections::HashMap;

/// Number of lines of a bundle.
pub(crate) const WIDTH: usize = 8;
/// Marks lines that are in no bundle.
const NONE: u32 = u32::MAX;
/// There are no bundles if equal rows repeat less often than this on average: bundles would take as
/// much memory again, and memory bandwidth is then the limit.
const LEAST_REPEATS: usize = 2;

/// A number for each line of a bundle.
type BundleLanes = [f64; WIDTH];

/// The bundles of rows.
#[derive(Clone, Debug, Default)]
pub(crate) struct Bundles {
    /// Lines of a layer of elements; for degree 0, of a space cell.
    stride: usize,
    /// Bundles of a layer.
    in_layer: usize,
    /// For each bundle, layer by layer, the stored bundle that it equals, or [`NONE`].
    like: Vec<u32>,
    /// `k` at the nodes of a line, by row of a bundle and node.
    dense: Vec<BundleLanes>,
    /// Entries `offsets[r]..offsets[r + 1]` are the other entries of row `r`, counted over all
    /// bundles.
    offsets: Vec<usize>,
    /// Column minus row, modulo 2³².
    distances: Vec<u32>,
    /// `[s, k]`.
    values: Vec<[BundleLanes; 2]>,
}

/// Number of dense entries of a row in a line of `nodes` nodes.
const fn dense_nodes(nodes: usize) -> usize {
    if nodes == 1 { 0 } else { nodes }
}

impl Bundles {
    /// The bundles of `rows`. `lines` are those of the rows, or single rows in layers of `stride`.
    /// There are no bundles if rows hardly repeat.
    pub fn of(rows: &Rows, lines: RowLines) -> Self {
        let RowLines { nodes, stride, cells } = lines;
        let mut this = Self { stride, offsets: vec![0], ..Self::default() };
        if rows.templates() * LEAST_REPEATS > cells {
            return this;
        }
        this.in_layer = stride / WIDTH;
        let mut seen: HashMap<[u32; WIDTH], u32> = HashMap::new();
        for layer in 0..cells / (nodes * stride) {
            for bundle in 0..this.in_layer {
                let first = layer * stride + bundle * WIDTH;
                let templates: [u32; WIDTH] =
                    std::array::from_fn(|lane| rows.template(first + lane) as u32);
                let add = || this.add(rows, nodes, first);
                let like = *seen.entry(templates).or_insert_with(add);
                this.like.push(like);
            }
        }
        this
    }

    /// Adds the bundle that begins with line `first`, if its lines have entries at the same
    /// distances. Lines have `nodes` rows. Returns the number of the bundle, or [`NONE`].
    fn add(&mut self, rows: &Rows, nodes: usize, first: usize) -> u32 {
        let entries = |lane: usize, m: usize| rows.others(rows.template(first + lane) + m, 0);
        let distances = |lane: usize, m: usize| entries(lane, m).map(|(distance, ..)| distance);
        let is_alike = |m: usize| (1..WIDTH).all(|lane| distances(lane, m).eq(distances(0, m)));
        if !(0..nodes).all(is_alike) {
            return NONE;
        }
        let number = ((self.offsets.len() - 1) / nodes) as u32;
        for m in 0..nodes {
            let dense = |lane: usize| rows.dense_row(rows.template(first + lane) + m);
            self.dense.extend(
                (0..dense_nodes(nodes))
                    .map(|n| -> BundleLanes { std::array::from_fn(|lane| dense(lane)[n]) }),
            );
            for (e, distance) in distances(0, m).enumerate() {
                let mut values = [[0.0; WIDTH]; 2];
                for lane in 0..WIDTH {
                    if let Some((_, s, k)) = entries(lane, m).nth(e) {
                        (values[0][lane], values[1][lane]) = (s, k);
                    }
                }
                self.distances.push(distance as u32);
                self.values.push(values);
            }
            self.offsets.push(self.distances.len());
        }
        number
    }

    /// Number of lines, from the first, that may be in bundles.
    pub fn lines(&self) -> usize {
        self.like.len().checked_div(self.in_layer).map_or(0, |layers| layers * self.stride)
    }

    /// The stored bundle of the one that begins with line `line`, if one does.
    #[inline(always)]
    pub fn at(&self, line: usize) -> Option<usize> {
        if self.in_layer == 0 {
            return None;
        }
        let (layer, within) = (line / self.stride, line % self.stride);
        let begins = within.is_multiple_of(WIDTH) && within / WIDTH < self.in_layer;
        let like = || self.like[layer * self.in_layer + within / WIDTH];
        begins.then(like).filter(|like| *like != NONE).map(|like| like as usize)
    }

    /// `y ← Σ entry(s, k) x` in the rows of a bundle that equals the stored one `like` and whose
    /// first row is `first`.
    #[inline(always)]
    pub fn apply<const NODES: usize>(
        &self,
        like: usize,
        [first, stride]: [usize; 2],
        entry: &impl Fn(f64, f64) -> f64,
        y: &mut [f64],
        x: &[f64],
    ) {
        let add = |sum: &mut BundleLanes, s: &BundleLanes, k: &BundleLanes, from: usize| {
            let x = &x[from..from + WIDTH];
            for lane in 0..WIDTH {
                sum[lane] += entry(s[lane], k[lane]) * x[lane];
            }
        };
        for m in 0..NODES {
            let (row, i) = (like * NODES + m, first + m * stride);
            let mut sum = [0.0; WIDTH];
            let nodes = const { dense_nodes(NODES) };
            for (n, k) in self.dense[row * nodes..(row + 1) * nodes].iter().enumerate() {
                add(&mut sum, &[0.0; WIDTH], k, first + n * stride);
            }
            let others = self.offsets[row]..self.offsets[row + 1];
            for (distance, [s, k]) in
                self.distances[others.clone()].iter().zip(&self.values[others])
            {
                add(&mut sum, s, k, (i as u32).wrapping_add(*distance) as usize);
            }
            y[i..i + WIDTH].copy_from_slice(&sum);
        }
    }

    /// Bytes of the bundles.
    pub fn bytes(&self) -> usize {
        4 * (self.like.len() + self.distances.len())
            + 8 * self.offsets.len()
            + size_of::<BundleLanes>() * (self.dense.len() + 2 * self.values.len())
    }
}
