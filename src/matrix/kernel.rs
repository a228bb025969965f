//! The inner loop: one step of a Chebyshev or Lanczos recurrence for a batch of modes, in one pass
//! over the matrix.
//!
//! ```text
//! y ← a ((−iμ S + K) x + i c x) + y + coefficient · start
//! ```
//!
//! Each lane, that is each mode of the batch, has its own scale `a`, shift `c` and wavenumber `μ`.
//! `start` is the vector to which the series is applied: a real vector that the lanes share, a
//! vector for each lane, or nothing.
//!
//! Vectors are `[row][re: B lanes][im: B lanes]`, so that no operation mixes lanes. The same loop
//! is compiled three times, for AVX-512, for AVX2 with FMA and for any processor. Which one runs is
//! decided once at the start.

use crate::matrix::instruction_set::Vectorized;
use crate::matrix::lanes::{Lanes, StartRow, StepConstants};
use crate::matrix::row_lines::for_nodes;
use crate::matrix::rows::{RowSlices, Rows};
use crate::matrix::vector::Vector;
use std::ops::Range;

/// The constants of a step, in registers.
#[derive(Clone, Copy)]
struct KernelConstants<V> {
    scale: V,
    shift: V,
    minus_shift: V,
    wavenumber: V,
    minus_wavenumber: V,
    coefficient: V,
}

impl<V: Vector> KernelConstants<V> {
    #[inline(always)]
    fn load(constants: &StepConstants) -> Self {
        let StepConstants { scale, shift, wavenumber, coefficient } = constants;
        Self {
            scale: V::load(scale),
            shift: V::load(shift),
            minus_shift: V::load(&shift.map(|c| -c)),
            wavenumber: V::load(wavenumber),
            minus_wavenumber: V::load(&wavenumber.map(|mu| -mu)),
            coefficient: V::load(coefficient),
        }
    }
}

/// Partial sums of `S x` and `K x` of a row, real and imaginary parts.
#[derive(Clone, Copy)]
struct Products<V> {
    s: [V; 2],
    k: [V; 2],
}

impl<V: Vector> Products<V> {
    /// Adds the entries of row `i` but those of the nodes of its line.
    #[inline(always)]
    fn add_others(&mut self, rows: RowSlices<'_>, template: usize, i: usize, x: &[Lanes]) {
        for (column, s, k) in rows.others(template, i) {
            // SAFETY: every column is below the reach of the rows, which `x` has, as `step_lines`
            // asserts.
            let value = unsafe { x.get_unchecked(column) }.load();
            let (s, k) = (V::splat(s), V::splat(k));
            for part in 0..2 {
                self.s[part] = self.s[part].add_product(s, value[part]);
                self.k[part] = self.k[part].add_product(k, value[part]);
            }
        }
    }

    /// The step of a row: `a ((−iμ S + K) x + i c x) + y`.
    #[inline(always)]
    fn finish(&self, constants: &KernelConstants<V>, own: [V; 2], out: [V; 2]) -> [V; 2] {
        let ([s_re, s_im], [k_re, k_im]) = (self.s, self.k);
        // (−iμ S + K + ic)(re + i im) = (μ S im + K re − c im) + i(−μ S re + K im + c re)
        let re = k_re.add_product(constants.wavenumber, s_im);
        let im = k_im.add_product(constants.minus_wavenumber, s_re);
        let re = re.add_product(constants.minus_shift, own[1]);
        let im = im.add_product(constants.shift, own[0]);
        [out[0].add_product(constants.scale, re), out[1].add_product(constants.scale, im)]
    }
}

/// The vectors of a step.
struct Vectors<'a, R> {
    y: &'a mut [Lanes],
    x: &'a [Lanes],
    start: &'a [R],
}

/// The loop over lines of a single row.
#[inline(always)]
fn step_rows<V: Vector, R: StartRow>(
    matrix: &Rows,
    lines: Range<usize>,
    constants: &KernelConstants<V>,
    vectors: &mut Vectors<'_, R>,
) {
    let Vectors { y, x, start } = vectors;
    let rows = matrix.slices();
    let (x, start): (&[Lanes], &[R]) = (x, start);
    let templates = &rows.template[lines.clone()];
    let behind = rows.lines.cells - rows.lines.of_cells();
    let numbers = lines.start + behind..lines.end + behind;
    let pairs = y[numbers.clone()].iter_mut().zip(&x[numbers.clone()]).zip(templates);
    for (i, ((out, own), template)) in numbers.zip(pairs) {
        let zero = [V::splat(0.0); 2];
        let mut products = Products { s: zero, k: zero };
        products.add_others(rows, *template as usize, i, x);
        let new = products.finish(constants, own.load(), out.load());
        out.store(R::add(start, i, constants.coefficient, new));
    }
}

/// Lines of at least this many rows are stepped as a whole, if `WHOLE` is set.
const LONG_LINE: usize = 8;

/// The loop over lines of several rows, compiled for each number of them.
#[inline(always)]
fn step_nodes<V: Vector, const ROWS: usize, const WHOLE: bool, R: StartRow>(
    matrix: &Rows,
    lines: Range<usize>,
    constants: &KernelConstants<V>,
    vectors: &mut Vectors<'_, R>,
) {
    match matrix.lines().nodes {
        // Lines of one row are in the loop of `step_rows`.
        1 => {}
        nodes => for_nodes!(nodes, NODES => {
            step_nodes_of::<V, ROWS, WHOLE, NODES, R>(matrix, lines, constants, vectors)
        }),
    }
}

/// The loop over lines of `NODES` rows, `ROWS` rows at a time, for which each node is read once.
#[inline(always)]
fn step_nodes_of<
    V: Vector,
    const ROWS: usize,
    const WHOLE: bool,
    const NODES: usize,
    R: StartRow,
>(
    matrix: &Rows,
    lines: Range<usize>,
    constants: &KernelConstants<V>,
    vectors: &mut Vectors<'_, R>,
) {
    let rows = matrix.slices();
    let stride = rows.lines.stride;
    let mut next = lines.start;
    while next < lines.end {
        // The lines of a layer of elements: one division for all of them.
        let layer = next / stride;
        let end = lines.end.min((layer + 1) * stride);
        for line in next..end {
            let first = line + layer * (NODES - 1) * stride;
            let line = NodeLine { first, stride, template: rows.template[line] as usize };
            if WHOLE && NODES >= LONG_LINE {
                line.step::<V, NODES, NODES, R>(rows, 0, constants, vectors);
                continue;
            }
            let whole = NODES / ROWS * ROWS;
            for from in (0..whole).step_by(ROWS) {
                line.step::<V, NODES, ROWS, R>(rows, from, constants, vectors);
            }
            match NODES - whole {
                1 => line.step::<V, NODES, 1, R>(rows, whole, constants, vectors),
                2 => line.step::<V, NODES, 2, R>(rows, whole, constants, vectors),
                3 => line.step::<V, NODES, 3, R>(rows, whole, constants, vectors),
                _ => {}
            }
        }
        next = end;
    }
}

/// A line of several rows.
#[derive(Clone, Copy)]
struct NodeLine {
    /// Its first row.
    first: usize,
    /// Distance from one row to the next.
    stride: usize,
    /// The template of its first row.
    template: usize,
}

impl NodeLine {
    /// A step of `COUNT` of its `NODES` rows, from row number `from` on.
    #[inline(always)]
    fn step<V: Vector, const NODES: usize, const COUNT: usize, R: StartRow>(
        self,
        rows: RowSlices<'_>,
        from: usize,
        constants: &KernelConstants<V>,
        vectors: &mut Vectors<'_, R>,
    ) {
        let Vectors { y, x, start } = vectors;
        let Self { first, stride, template } = self;
        let dense: [&[f64; NODES]; COUNT] =
            std::array::from_fn(|m| rows.dense_nodes(template + from + m));
        let zero = [V::splat(0.0); 2];
        let mut sums = [zero; COUNT];
        for n in 0..NODES {
            let value: [V; 2] = x[first + n * stride].load();
            for m in 0..COUNT {
                let k = V::splat(dense[m][n]);
                sums[m] =
                    [sums[m][0].add_product(k, value[0]), sums[m][1].add_product(k, value[1])];
            }
        }
        for m in 0..COUNT {
            let i = first + (from + m) * stride;
            let mut products = Products { s: zero, k: sums[m] };
            products.add_others(rows, template + from + m, i, x);
            let new = products.finish(constants, x[i].load(), y[i].load());
            y[i].store(R::add(start, i, constants.coefficient, new));
        }
    }
}

/// The loop over lines, `ROWS` rows at a time. `ROWS` is the number of rows whose sums stay in
/// registers together with the nodes of the line. `WHOLE` tells that the sums of a whole long line
/// fit into registers, though not together with its nodes.
#[inline(always)]
fn step_lines<V: Vector, const ROWS: usize, const WHOLE: bool, R: StartRow>(
    matrix: &Rows,
    lines: Range<usize>,
    constants: &StepConstants,
    y: &mut [Lanes],
    x: &[Lanes],
    start: &[R],
) {
    assert!(x.len() >= matrix.reach(), "vector and matrix do not fit");
    let loaded = KernelConstants::load(constants);
    let end = matrix.lines().of_cells();
    let gathered = lines.start.min(end)..lines.end.min(end);
    let single = lines.start.max(end)..lines.end.max(end);
    let mut vectors = Vectors { y, x, start };
    let velocity_lines = matrix.velocity_lines();
    // One loop, as it is large: of two copies the compiler would not inline all parts.
    let forced = !velocity_lines.is_empty();
    let mut whole = (!forced).then(|| gathered.clone());
    let mut pieces = forced.then(|| velocity_lines.pieces(matrix.lines(), gathered));
    while let Some(piece) = whole.take().or_else(|| pieces.as_mut()?.next()) {
        if forced {
            let Vectors { y, x, .. } = &mut vectors;
            velocity_lines.step::<V, ROWS, WHOLE>(matrix.lines(), piece.clone(), constants, y, x);
        }
        step_nodes::<V, ROWS, WHOLE, R>(matrix, piece, &loaded, &mut vectors);
    }
    step_rows::<V, R>(matrix, single, &loaded, &mut vectors);
}

/// The step of some lines.
pub struct LineStep<'a, R> {
    /// The rows.
    pub matrix: &'a Rows,
    /// The lines.
    pub lines: Range<usize>,
    /// Constants of the lanes.
    pub constants: &'a StepConstants,
    /// The vector that is updated.
    pub y: &'a mut [Lanes],
    /// The vector that the matrix is applied to; it has an element for every column of the rows.
    pub x: &'a [Lanes],
    /// The start vector of the series.
    pub start: &'a [R],
}

impl<R: StartRow> Vectorized for LineStep<'_, R> {
    #[inline(always)]
    fn run<V: Vector, const FMA: bool, const ROWS: usize, const WHOLE: bool>(self) {
        let Self { matrix, lines, constants, y, x, start } = self;
        // Passed one by one, so that the compiler knows that `y` does not alias the others.
        step_lines::<V, ROWS, WHOLE, R>(matrix, lines, constants, y, x, start);
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::matrix::instruction_set::InstructionSet;
    use crate::matrix::lanes::LANES;
    use crate::matrix::row_lines::{MOST_NODES, MatrixEntry, RowLines};
    use crate::matrix::rows::RowsBuilder;
    use crate::matrix::velocity_lines::VelocityLines;

    /// Reproducible numbers between −1 and 1.
    fn noise(number: usize) -> f64 {
        (number as f64 * 12.9898).sin()
    }

    fn lanes(row: usize) -> Lanes {
        Lanes(std::array::from_fn(|part| noise(100 * row + part)))
    }

    /// Rows of cells on a circle, the first of which also have ghost columns behind the rows. The
    /// entries of a row at itself and at the row `stride` behind it have `s = 0`, as in a line.
    fn entries(rows: usize, cells: usize, ghosts: usize, stride: usize) -> Vec<Vec<MatrixEntry>> {
        let row = |i: usize| {
            let mut columns = vec![i, (i + stride) % cells];
            let other = (i + cells - 2) % cells;
            columns.extend((!columns.contains(&other)).then_some(other));
            columns.extend((i < ghosts).then_some(rows + i));
            let entry = |(m, j): (usize, usize)| {
                let s = if m < 2 { 0.0 } else { noise(7 * i + m) };
                (j as u32, s, noise(3 * i + m))
            };
            columns.into_iter().enumerate().map(entry).collect()
        };
        (0..rows).map(row).collect()
    }

    /// Every instruction set against the formula, with single rows and with lines of every number
    /// of nodes.
    #[test]
    fn steps_are_those_of_the_formula() {
        for nodes in 1..=MOST_NODES {
            for stride in [1, 3] {
                check_steps(nodes, stride);
            }
        }
    }

    fn check_steps(nodes: usize, stride: usize) {
        let (cells, ghosts) = (2 * nodes * stride, 3);
        let rows = cells + 3;
        let list = entries(rows, cells, ghosts, stride);
        let mut builder = RowsBuilder::with_capacity(rows);
        list.iter().for_each(|row| builder.push(row));
        let single = builder.finish();
        let matrix = match nodes {
            1 => single,
            _ => single.gathered(RowLines { nodes, stride, cells }, VelocityLines::default()),
        };
        let x: Vec<Lanes> = (0..rows + ghosts).map(lanes).collect();
        let before: Vec<Lanes> = (0..rows).map(|i| lanes(1000 + i)).collect();
        let start: Vec<f64> = (0..rows).map(|i| noise(5 * i)).collect();
        let constants = StepConstants {
            scale: std::array::from_fn(|l| 0.5 + noise(l)),
            shift: std::array::from_fn(|l| noise(l + 10)),
            wavenumber: std::array::from_fn(|l| l as f64 - 3.0),
            coefficient: std::array::from_fn(|l| noise(l + 20)),
        };
        let matrix = &matrix;
        for set in InstructionSet::all() {
            let mut y = before.clone();
            let lines = 0..matrix.line_count();
            let constants = &constants;
            set.run(LineStep { matrix, lines, constants, y: &mut y, x: &x, start: &start });
            for (i, row) in list.iter().enumerate() {
                for l in 0..LANES {
                    let at = |j: u32| [l, LANES + l].map(|part| x[j as usize].0[part]);
                    let sum = |of: fn(&MatrixEntry) -> f64, part: usize| -> f64 {
                        row.iter().map(|entry| of(entry) * at(entry.0)[part]).sum()
                    };
                    let (a, c) = (constants.scale[l], constants.shift[l]);
                    let (mu, own) = (constants.wavenumber[l], at(i as u32));
                    let re = mu * sum(|e| e.1, 1) + sum(|e| e.2, 0) - c * own[1];
                    let im = -mu * sum(|e| e.1, 0) + sum(|e| e.2, 1) + c * own[0];
                    let old = [l, LANES + l].map(|part| before[i].0[part]);
                    let expected =
                        [a * re + old[0] + constants.coefficient[l] * start[i], a * im + old[1]];
                    let found = [l, LANES + l].map(|part| y[i].0[part]);
                    for (found, expected) in found.iter().zip(expected) {
                        let close = (found - expected).abs() < 1e-13;
                        assert!(close, "{set:?} {:?} row {i} lane {l}", matrix.lines());
                    }
                }
            }
        }
    }
}
