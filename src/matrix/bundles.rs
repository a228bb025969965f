//! Bundles of lines, by which real vectors are multiplied.
//!
//! Lines that follow each other are those of one element along the first space axis and of
//! velocities, or other nodes, next to each other; of degree 0 they are the rows of velocities at
//! one space cell. Where their rows have entries at the same distances, the values of all lines of
//! a bundle stand side by side: a bundle takes one pass of vertical operations, with the sums of
//! each row in the order of its own entries.

use crate::matrix::rows::{RowLines, Rows};
use std::collections::HashMap;

/// Lines of a bundle.
pub(crate) const WIDTH: usize = 8;
/// Where lines are in no bundle.
const NONE: u32 = u32::MAX;
/// Rows that do not repeat at least so often on average are left in lines: bundles would take as
/// much memory again, whose bandwidth is the limit then.
const LEAST_REPEATS: usize = 2;

/// A number for each line of a bundle.
type BundleLanes = [f64; WIDTH];

/// The bundles of rows.
#[derive(Clone, Debug, Default)]
pub(crate) struct Bundles {
    /// Lines of a layer of elements; of degree 0, of a space cell.
    stride: usize,
    /// Bundles of a layer.
    in_layer: usize,
    /// By layer, the bundle that each bundle repeats; or [`NONE`].
    like: Vec<u32>,
    /// `k` to the nodes of a line: row by row of a bundle, node by node.
    dense: Vec<BundleLanes>,
    /// Entries `offsets[r]..offsets[r + 1]` are the others of row `r` of all bundles.
    offsets: Vec<usize>,
    /// Column minus row, modulo 2³².
    distances: Vec<u32>,
    /// `[s, k]`.
    values: Vec<[BundleLanes; 2]>,
}

/// Nodes to which the rows of a line of `nodes` have dense entries.
const fn dense_nodes(nodes: usize) -> usize {
    if nodes == 1 { 0 } else { nodes }
}

impl Bundles {
    /// The bundles of `rows`, whose `lines` are those that it is gathered into, or single rows in
    /// layers of `stride`; none where rows hardly repeat.
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

    /// Adds the bundle that begins with line `first`, of `nodes` rows, if its lines are alike;
    /// gives its number.
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

    /// Lines that may be in bundles, from the first.
    pub fn lines(&self) -> usize {
        self.like.len().checked_div(self.in_layer).map_or(0, |layers| layers * self.stride)
    }

    /// The bundle that begins with line `line`, if one does.
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

    /// `y ← Σ entry(s, k) x` in the rows of a bundle that is like number `like`, whose first row is
    /// `first`.
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

    /// Bytes that they take.
    pub fn bytes(&self) -> usize {
        4 * (self.like.len() + self.distances.len())
            + 8 * self.offsets.len()
            + size_of::<BundleLanes>() * (self.dense.len() + 2 * self.values.len())
    }
}
