//! Products of the matrix with a real vector, and with one mode.

use crate::matrix::block_matrix::{BlockMatrix, Operator};
use crate::matrix::bundles::WIDTH;
use crate::matrix::inflow::AuxiliaryRow;
use crate::matrix::instruction_set::{InstructionSet, Vectorized};
use crate::matrix::row_lines::for_nodes;
use crate::matrix::vector::Vector;
use crate::matrix::velocity_lines::{NodeValue, ProductFactors};
use crate::parallel::communicator::GhostExchange;
use num_complex::Complex64;
use std::ops::{Mul, Range};

/// Number of rows whose products with a real vector are passed on while they are in the first
/// cache.
const PIECE: usize = 2048;

/// The products of lines with a real vector, without fused multiply-add, so that the bits are the
/// same for every instruction set.
struct RowProducts<'a> {
    matrix: &'a BlockMatrix,
    lines: &'a [Range<usize>],
    operator: Operator,
    y: &'a mut [f64],
    x: &'a [f64],
}

impl Vectorized for RowProducts<'_> {
    #[inline(always)]
    fn run<V: Vector, const FMA: bool, const ROWS: usize, const WHOLE: bool>(self) {
        self.matrix.sum_lines(self.lines, self.operator, self.y, self.x);
    }
}

impl BlockMatrix {
    /// The products of lines with a real vector.
    pub(crate) fn apply_rows(
        &self,
        lines: &[Range<usize>],
        operator: Operator,
        y: &mut [f64],
        x: &[f64],
    ) {
        InstructionSet::here().run(RowProducts { matrix: self, lines, operator, y, x });
    }

    #[inline(always)]
    fn sum_lines(&self, rows: &[Range<usize>], operator: Operator, y: &mut [f64], x: &[f64]) {
        // One loop for each operator, so that the choice is outside the loop.
        match operator {
            Operator::Generator => self.sum_entries(rows, |s, k| s + k, y, x),
            Operator::Transpose => self.sum_entries(rows, |s, k| s - k, y, x),
            Operator::Symmetric => self.sum_entries(rows, |s, _| s, y, x),
        }
        let k = match operator {
            Operator::Generator => 1.0,
            Operator::Transpose => -1.0,
            Operator::Symmetric => 0.0,
        };
        for run in rows {
            self.add_velocity_lines(run, ProductFactors { s: 1.0, k }, y, x);
        }
    }

    /// Adds the products along velocity axes in some lines.
    #[inline(always)]
    fn add_velocity_lines<T: NodeValue + Mul<Output = T>>(
        &self,
        lines: &Range<usize>,
        factors: ProductFactors<T>,
        y: &mut [T],
        x: &[T],
    ) {
        let (of_rows, of_cells) = (self.rows.lines(), self.rows.lines().of_cells());
        let of_cells = lines.start.min(of_cells)..lines.end.min(of_cells);
        let velocity_lines = self.rows.velocity_lines();
        if !velocity_lines.is_empty() {
            velocity_lines.add_products(of_rows, of_cells, factors, y, x);
        }
    }

    #[inline(always)]
    fn sum_entries(
        &self,
        runs: &[Range<usize>],
        entry: impl Fn(f64, f64) -> f64,
        y: &mut [f64],
        x: &[f64],
    ) {
        assert!(x.len() >= self.rows.reach(), "vector and matrix do not fit");
        for run in runs {
            match self.rows.lines().nodes {
                1 => self.sum_nodes::<1>(run.clone(), &entry, y, x),
                nodes => for_nodes!(nodes, NODES => {
                    self.sum_nodes::<NODES>(run.clone(), &entry, y, x)
                }),
            }
        }
    }

    /// Adds the products of row `i` with all columns but the nodes of its line to `sum`.
    #[inline(always)]
    fn add_others(
        &self,
        [template, i]: [usize; 2],
        entry: impl Fn(f64, f64) -> f64,
        x: &[f64],
        sum: f64,
    ) -> f64 {
        (self.rows.others(template, i))
            // SAFETY: every column is below the reach of the rows, which `x` has.
            .map(|(j, s, k)| entry(s, k) * unsafe { x.get_unchecked(j) })
            .fold(sum, |sum, term| sum + term)
    }

    /// The products of lines that are single rows.
    #[inline(always)]
    fn sum_single(
        &self,
        lines: Range<usize>,
        entry: &impl Fn(f64, f64) -> f64,
        y: &mut [f64],
        x: &[f64],
    ) {
        let behind = self.rows.lines().cells - self.rows.lines().of_cells();
        for line in lines {
            let i = line + behind;
            y[i] = self.add_others([self.rows.template(line), i], entry, x, 0.0);
        }
    }

    /// The products of lines, of which those of cells have `NODES` rows. With one row a line, the
    /// lines that may be in bundles are treated in the same way.
    #[inline(always)]
    fn sum_nodes<const NODES: usize>(
        &self,
        lines: Range<usize>,
        entry: &impl Fn(f64, f64) -> f64,
        y: &mut [f64],
        x: &[f64],
    ) {
        let of_cells = if NODES == 1 { self.bundles.lines() } else { self.rows.lines().of_cells() };
        let stride = self.rows.lines().stride;
        let (mut next, end) = (lines.start, lines.end.min(of_cells));
        while next < end {
            let (line, first) = (next, self.rows.lines().first(next));
            if line + WIDTH <= end
                && let Some(like) = self.bundles.at(line)
            {
                self.bundles.apply::<NODES>(like, [first, stride], entry, y, x);
                next += WIDTH;
                continue;
            }
            next += 1;
            let template = self.rows.template(line);
            let nodes: [f64; NODES] = std::array::from_fn(|n| x[first + n * stride]);
            for m in 0..NODES {
                let dense = self.rows.dense_row(template + m);
                let terms = nodes.iter().zip(dense).map(|(x, k)| entry(0.0, *k) * x);
                let sum = terms.fold(0.0, |sum, term| sum + term);
                let i = first + m * stride;
                y[i] = self.add_others([template + m, i], entry, x, sum);
            }
        }
        self.sum_single(lines.start.max(of_cells)..lines.end.max(of_cells), entry, y, x);
    }

    /// `y ← (S ± K) x` or `S x` for real vectors; refreshes the ghosts of `x`. Collective over the
    /// space group.
    pub fn apply(
        &self,
        exchange: &mut GhostExchange,
        operator: Operator,
        y: &mut [f64],
        x: &mut [f64],
    ) {
        self.apply_then(exchange, operator, y, x, |_, _, _| {});
        if self.common_is_coupled && operator != Operator::Generator {
            let share = |aux: &AuxiliaryRow| [aux.coupling * x[aux.row as usize]];
            let [sum] =
                (exchange.group()).sum_lanes(self.inflow_rows, self.inflow.iter().map(share));
            y[self.block.cells()] = if operator == Operator::Transpose { sum } else { 0.5 * sum };
        }
    }

    /// The products of [`apply`](Self::apply), without the row of a common auxiliary unknown, which
    /// is a sum over all ranks. Calls `then` with rows, `y` and `x` as soon as these products are
    /// done, while they are in cache.
    pub fn apply_then(
        &self,
        exchange: &mut GhostExchange,
        operator: Operator,
        y: &mut [f64],
        x: &mut [f64],
        mut then: impl FnMut(Range<usize>, &mut [f64], &[f64]),
    ) {
        let rows = self.rows();
        // The rows of a line of an element are not contiguous.
        let is_by_rows = self.rows.lines().nodes == 1;
        let mut apply = |runs: &[Range<usize>], y: &mut [f64], x: &[f64]| {
            if !is_by_rows {
                return self.apply_rows(runs, operator, y, x);
            }
            for run in runs {
                self.apply_run(run.clone(), operator, y, x, &mut then);
            }
        };
        exchange.start(&x[..rows]);
        apply(&self.interior, y, x);
        exchange.finish(&mut x[rows..]);
        apply(&self.border, y, x);
        if !is_by_rows {
            then(0..rows, y, x);
        }
    }

    /// `y ← (S ± K) x` or `S x` in rows that are lines and whose ghosts, if any, are there. Calls
    /// `then` with rows, `y` and `x` piece by piece, while they are in cache.
    pub(crate) fn apply_run(
        &self,
        rows: Range<usize>,
        operator: Operator,
        y: &mut [f64],
        x: &[f64],
        then: &mut impl FnMut(Range<usize>, &mut [f64], &[f64]),
    ) {
        for start in rows.clone().step_by(PIECE) {
            let piece = start..rows.end.min(start + PIECE);
            self.apply_rows(std::slice::from_ref(&piece), operator, y, x);
            then(piece, y, x);
        }
    }

    /// `y ← (−iμS + K)x` for one mode; refreshes the ghosts of `x`. Collective over the space
    /// group.
    pub fn apply_mode(
        &self,
        exchange: &mut GhostExchange,
        mu: f64,
        y: &mut [Complex64],
        x: &mut [Complex64],
    ) {
        let rows = self.rows();
        let apply = |runs: &[Range<usize>], y: &mut [Complex64], x: &[Complex64]| {
            let lines = self.rows.lines();
            for i in runs.iter().cloned().flatten().flat_map(|line| lines.rows(line)) {
                let mut sum = Complex64::ZERO;
                for (j, s, k) in self.rows.stored_row(i) {
                    sum += Complex64::new(k, -mu * s) * x[j];
                }
                y[i] = sum;
            }
            let factors = ProductFactors { s: Complex64::new(0.0, -mu), k: 1.0 };
            runs.iter().for_each(|run| self.add_velocity_lines(run, factors, y, x));
        };
        exchange.start(&x[..rows]);
        apply(&self.interior, y, x);
        exchange.finish(&mut x[rows..]);
        apply(&self.border, y, x);
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::parallel::partition::Block;
    use crate::parallel::partition::ProcessMesh;
    use crate::problem::case::Case;

    const CASE: &str = "[[axis]]\nx = { lower = -1, upper = 1, cells = 40 }\n\
                        v = { lower = -1.5, upper = 1.5, cells = 14 }\n\
                        [[potential]]\nwhere = \"x < 0\"\nvalue = \"0.2\"\n\
                        [[potential]]\nvalue = \"0\"\n\
                        [initial]\nf = \"exp(-x^2)\"\n[time]\nend = 1.0\n";

    /// Products of bundles have the same bits as row by row sums.
    #[test]
    fn bundles_keep_the_bits_of_rows() {
        for (degree, flux) in [("0", "1"), ("1", "1"), ("3", "0.5"), ("4", "1"), ("8", "0")] {
            let settings = [format!("scheme.degree={degree}"), format!("scheme.flux={flux}")];
            let case = Case::parse("case", CASE, &settings).expect("a case");
            let mesh = ProcessMesh { space: vec![1], groups: 1 };
            let block = Block::new(&case.space, &mesh, 0);
            let mut matrix = BlockMatrix::assemble(&case, block).expect("finite formulas");
            matrix.gather_elements();
            let (rows, lines) = (matrix.rows(), matrix.rows.line_count());
            let bundled = (0..lines).filter(|l| matrix.bundles.at(*l).is_some());
            assert!(WIDTH * bundled.count() > lines / 3, "degree {degree}: few lines in bundles");
            let x: Vec<f64> = (0..matrix.length()).map(|i| (0.7 * i as f64).sin()).collect();
            for operator in [Operator::Generator, Operator::Transpose, Operator::Symmetric] {
                let entry = |s: f64, k: f64| match operator {
                    Operator::Generator => s + k,
                    Operator::Transpose => s - k,
                    Operator::Symmetric => s,
                };
                let mut y = vec![0.0; rows];
                // The second range starts within a bundle.
                matrix.apply_rows(&[0..3, 3..lines], operator, &mut y, &x);
                for (i, y) in y.iter().enumerate() {
                    let terms = matrix.row(i).map(|(j, s, k)| entry(s, k) * x[j]);
                    assert_eq!(*y, terms.fold(0.0, |sum, term| sum + term), "{operator:?} {i}");
                }
            }
        }
    }
}
