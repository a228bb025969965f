//! Couplings along velocity axes, where a force acts on elements.
//!
//! The force is constant along a line of a velocity axis, so that all lines share the matrices of
//! the reference element. With the rate `g = ∂V/∂x_a 2/h` for elements of width `h`, the unknowns
//! `x_m = √w_m f_m` at the nodes of an element, and the traces `L = Σ l_n x_n` at its lower and
//! `R = Σ r_n x_n` at its upper face,
//!
//! ```text
//! K x = g (Skew x + ½ r L₊ − ½ l R₋)
//! S x = ½ α |g| (r (L₊ − R) − l (L − R₋))
//! ```
//!
//! `Skew` is the skew-symmetric part of the derivative, `l` and `r` are the values of the
//! polynomials at the two faces over `√w_m`, `L₊` and `R₋` are the traces of the elements above and
//! below, and `α` is the flux. At the ends of the box the terms of the face are left out. These are
//! the couplings of [`crate::scheme::galerkin`], with about `2k + 13` multiply-adds a row and mode
//! instead of `12 (k + 1)`. Couplings that differ at the ends of the box stay in the rows.

mod element;
mod pass;

pub use crate::matrix::velocity_lines::pass::{NodeValue, ProductFactors};

use crate::matrix::lanes::{Lanes, StepConstants};
use crate::matrix::row_lines::{MatrixEntry, RowLines, for_nodes};
use crate::matrix::vector::Vector;
use crate::matrix::velocity_lines::element::{LineElement, LineRows};
use crate::matrix::velocity_lines::pass::{LinePass, ProductPass, StepPass};
use crate::parallel::partition::Block;
use crate::problem::grid::PhaseSpace;
use crate::problem::potential::Potential;
use std::ops::{Mul, Range};

/// Entries below this, relative to the largest one of an element, are round-off.
const ROUND_OFF: f64 = 256.0 * f64::EPSILON;
/// Rows of a piece of lines, whose vectors are to stay in the first cache.
const PIECE_ROWS: usize = 96;

/// A velocity axis along which a force acts.
#[derive(Clone, Debug)]
pub(crate) struct ForcedAxis {
    element: LineElement,
    elements: usize,
    /// Distance between the rows of two nodes.
    stride: usize,
    /// `g` in each space cell.
    rates: Vec<f64>,
}

impl ForcedAxis {
    /// `g` in row `i`.
    fn rate(&self, i: usize, velocities: usize) -> f64 {
        self.rates[i / velocities]
    }

    /// Whether it couples the velocities `i` and `j` of a space cell.
    fn couples(&self, i: usize, j: usize) -> bool {
        let block = self.elements * self.element.nodes * self.stride;
        let element = |v: usize| v % block / self.stride / self.element.nodes;
        let is_one_line = i / block == j / block && i % self.stride == j % self.stride;
        is_one_line && element(i).abs_diff(element(j)) <= 1
    }

    /// Calls `visit(column, s, k)` for each coupling of row `i`.
    fn visit_couplings(
        &self,
        i: usize,
        velocities: usize,
        flux: f64,
        mut visit: impl FnMut(usize, f64, f64),
    ) {
        let &Self { ref element, elements, stride, .. } = self;
        let &LineElement { nodes, ref skew, ref left, ref right, .. } = element;
        let rate = self.rate(i, velocities);
        let (half_k, half_s) = (0.5 * rate, 0.5 * flux * rate.abs());
        let along = i % velocities / stride % (nodes * elements);
        let (e, m) = (along / nodes, along % nodes);
        let column = |node: usize| i + node * stride - along * stride;
        let (is_first, is_last) = (e == 0, e + 1 == elements);
        for n in 0..nodes {
            let (l, r) = (left[m], right[m]);
            let lower = if is_first { 0.0 } else { l * left[n] };
            let upper = if is_last { 0.0 } else { r * right[n] };
            visit(column(e * nodes + n), -half_s * (lower + upper), rate * skew[n * nodes + m]);
            if !is_first {
                visit(column((e - 1) * nodes + n), half_s * l * right[n], -half_k * l * right[n]);
            }
            if !is_last {
                visit(column((e + 1) * nodes + n), half_s * r * left[n], half_k * r * left[n]);
            }
        }
    }

    /// The lines of the rows `wanted`, which are those of whole elements, of the space cell that
    /// begins with row `first`.
    #[inline(always)]
    fn lines(&self, first: usize, wanted: Range<usize>) -> impl Iterator<Item = LineRows> {
        let Self { elements, stride, .. } = *self;
        let layer = self.element.nodes * stride;
        let block = elements * layer;
        (wanted.start / block..wanted.end.div_ceil(block)).flat_map(move |outer| {
            let base = outer * block;
            let start = wanted.start.saturating_sub(base) / layer;
            let end = (wanted.end - base).min(block) / layer;
            (0..stride).map(move |inner| LineRows {
                first: first + base + inner,
                stride,
                elements,
                wanted: start..end,
            })
        })
    }

    /// Adds the couplings of the wanted rows of the space cell that begins with row `first`.
    #[inline(always)]
    fn add<P: LinePass, const ROWS: usize, const WHOLE: bool>(
        &self,
        first: usize,
        wanted: Range<usize>,
        pass: &mut P,
    ) {
        for_nodes!(self.element.nodes, NODES => {
            self.add_sized::<P, ROWS, WHOLE, NODES>(first, wanted, pass)
        })
    }

    #[inline(always)]
    fn add_sized<P: LinePass, const ROWS: usize, const WHOLE: bool, const NODES: usize>(
        &self,
        first: usize,
        wanted: Range<usize>,
        pass: &mut P,
    ) {
        let block = self.elements * NODES * self.stride;
        let end = first + wanted.end.div_ceil(block) * block;
        assert!(pass.is_within(end), "vector and lines do not fit");
        let element = self.element.sized::<NODES>();
        for line in self.lines(first, wanted) {
            element.add_line::<P, ROWS, WHOLE>(&line, pass);
        }
    }
}

/// The lines of all velocity axes.
#[derive(Clone, Debug, Default)]
pub struct VelocityLines {
    axes: Vec<ForcedAxis>,
    /// Velocities at a space cell.
    velocities: usize,
    flux: f64,
}

impl VelocityLines {
    /// The lines of elements of `space` in `block` along which the force of `potential` acts, with
    /// the flux `α`.
    pub fn new(space: &PhaseSpace, block: &Block, potential: &Potential, flux: f64) -> Self {
        let n = space.dimension();
        let axis = |a: usize| {
            let axis = &space.v[a];
            let mut rates = vec![0.0; block.space_cells()];
            block.for_each_own(|global, local| {
                let slope = potential.slope(&space.cell(global)[..n], a);
                rates[local / block.velocity_cells] = slope * (2.0 / axis.width());
            });
            ForcedAxis {
                element: LineElement::new(axis),
                elements: axis.elements(),
                stride: space.v[a + 1..].iter().map(|axis| axis.cells).product(),
                rates,
            }
        };
        let of_elements = (0..n).filter(|a| space.v[*a].nodes.count() > 1);
        let forced = |axis: &ForcedAxis| axis.rates.iter().any(|rate| *rate != 0.0);
        let axes = of_elements.map(axis).filter(forced).collect();
        Self { axes, velocities: block.velocity_cells, flux }
    }

    /// Whether no force acts.
    pub fn is_empty(&self) -> bool {
        self.axes.is_empty()
    }

    /// Ranges of velocities at a space cell must begin and end at multiples of this number: with
    /// whole elements.
    pub fn unit(&self) -> usize {
        self.axes.first().map_or(1, |axis| axis.element.nodes * axis.stride)
    }

    /// Bytes of the lines.
    pub fn bytes(&self) -> usize {
        self.axes.iter().map(|axis| 8 * axis.rates.len()).sum()
    }

    /// Fused multiply-adds of a Chebyshev step of one mode.
    pub fn multiply_adds(&self) -> usize {
        let of_axis = |axis: &ForcedAxis| {
            let (nodes, cells) = (axis.element.nodes, axis.rates.iter().filter(|g| **g != 0.0));
            // Of an element: `Skew`, two traces and two terms a row, the update, and a face.
            let of_element = nodes * (2 * nodes + 4 + 4 + 2) + 10;
            cells.count() * (self.velocities / nodes) * of_element
        };
        self.axes.iter().map(of_axis).sum()
    }

    /// The couplings of row `i` of cells: along each axis, the diagonal last.
    pub fn entries(&self, i: usize) -> Vec<MatrixEntry> {
        let mut entries = Vec::new();
        let mut diagonal = 0.0;
        for axis in self.forced_at(i) {
            axis.visit_couplings(i, self.velocities, self.flux, |column, s, k| {
                if column == i { diagonal += s } else { entries.push((column as u32, s, k)) }
            });
        }
        if !entries.is_empty() {
            entries.push((i as u32, diagonal, 0.0));
        }
        entries
    }

    /// The axes with a force in row `i`, which may be behind those of cells.
    pub(crate) fn forced_at(&self, i: usize) -> impl Iterator<Item = &ForcedAxis> {
        let acts = move |axis: &&ForcedAxis| {
            axis.rates.get(i / self.velocities).is_some_and(|rate| *rate != 0.0)
        };
        self.axes.iter().filter(acts)
    }

    /// Whether one of these couplings is that of row `i` to row `j`.
    pub fn couples(&self, i: usize, j: usize) -> bool {
        i / self.velocities.max(1) == j / self.velocities.max(1)
            && self.forced_at(i).any(|axis| axis.couples(i % self.velocities, j % self.velocities))
    }

    /// Takes the couplings of row `i` from its `entries`; what is left beyond round-off stays.
    pub fn take_from(&self, i: usize, entries: &mut Vec<MatrixEntry>) {
        let largest =
            |axis: &ForcedAxis| axis.rate(i, self.velocities).abs() * axis.element.largest;
        let round_off = ROUND_OFF * self.forced_at(i).map(largest).sum::<f64>();
        for (column, s, k) in self.entries(i) {
            let at = entries.iter().position(|entry| entry.0 == column);
            let (old_s, old_k) = at.map_or((0.0, 0.0), |at| (entries[at].1, entries[at].2));
            let rest = (column, old_s - s, old_k - k);
            let is_round_off = rest.1.abs() <= round_off && rest.2.abs() <= round_off;
            match (at, is_round_off) {
                (Some(at), true) => drop(entries.remove(at)),
                (Some(at), false) => entries[at] = rest,
                (None, true) => {}
                (None, false) => entries.push(rest),
            }
        }
    }

    /// The lines of cells `range` in pieces: lines of one space cell, or of the nodes of an element
    /// along the first axis, few enough for the first cache.
    #[inline(always)]
    pub fn pieces(
        &self,
        lines: &RowLines,
        range: Range<usize>,
    ) -> impl Iterator<Item = Range<usize>> + use<> {
        let velocities = self.velocities;
        let unit = self.unit();
        let is_whole = |line: usize| (line % velocities).is_multiple_of(unit);
        assert!(is_whole(range.start) && is_whole(range.end), "an element is parted");
        let length = (PIECE_ROWS / (lines.nodes * unit)).max(1) * unit;
        let mut next = range.start;
        std::iter::from_fn(move || {
            let start = next;
            let velocity = start % velocities;
            let to = velocities.min((velocity / length + 1) * length);
            next = range.end.min(start - velocity + to);
            (start < next).then_some(start..next)
        })
    }

    /// The share of the lines in a step, `y ← a (−iμS + K) x + y`, in a piece of the lines of
    /// cells.
    #[inline(always)]
    pub fn step<V: Vector, const ROWS: usize, const WHOLE: bool>(
        &self,
        lines: &RowLines,
        piece: Range<usize>,
        constants: &StepConstants,
        y: &mut [Lanes],
        x: &[Lanes],
    ) {
        for ForcedCell { axis, first, rate, wanted } in self.forced_cells(lines, piece) {
            let zero = V::splat(0.0);
            let half = 0.5 * self.flux * rate.signum();
            let (scale, wavenumber) = (V::load(&constants.scale), V::load(&constants.wavenumber));
            let mut pass = StepPass {
                y: &mut *y,
                x,
                scale: zero.add_product(V::splat(rate), scale),
                dissipation: [
                    zero.add_product(V::splat(half), wavenumber),
                    zero.add_product(V::splat(-half), wavenumber),
                ],
            };
            axis.add::<_, ROWS, WHOLE>(first, wanted, &mut pass);
        }
    }

    /// Adds the share of the lines in a product to `y`, in the lines of cells `range`.
    #[inline(always)]
    pub fn add_products<T: NodeValue + Mul<Output = T>>(
        &self,
        lines: &RowLines,
        range: Range<usize>,
        factors: ProductFactors<T>,
        y: &mut [T],
        x: &[T],
    ) {
        for piece in self.pieces(lines, range) {
            for ForcedCell { axis, first, rate, wanted } in self.forced_cells(lines, piece) {
                let half = 0.5 * self.flux * rate.signum();
                let mut pass = ProductPass {
                    y: &mut *y,
                    x,
                    rate,
                    skew: factors.k,
                    dissipation: T::zero().plus(half, factors.s),
                };
                axis.add::<_, 1, true>(first, wanted, &mut pass);
            }
        }
    }

    /// The space cells of a piece with each axis along which a force acts there.
    #[inline(always)]
    fn forced_cells(
        &self,
        lines: &RowLines,
        piece: Range<usize>,
    ) -> impl Iterator<Item = ForcedCell<'_>> {
        let velocity = piece.start % self.velocities;
        let wanted = velocity..velocity + piece.len();
        lines.rows_of_cells(piece.start - velocity).flat_map(move |first| {
            let wanted = wanted.clone();
            let here = move |axis| {
                let rate = ForcedAxis::rate(axis, first, self.velocities);
                ForcedCell { axis, first, rate, wanted: wanted.clone() }
            };
            self.axes.iter().map(here).filter(|cell| cell.rate != 0.0)
        })
    }
}

/// A space cell with an axis along which a force acts.
struct ForcedCell<'a> {
    axis: &'a ForcedAxis,
    /// The first row of the cell.
    first: usize,
    /// `g`.
    rate: f64,
    /// The wanted rows of the cell.
    wanted: Range<usize>,
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::matrix::block_matrix::{BlockMatrix, Operator};
    use crate::matrix::instruction_set::InstructionSet;
    use crate::matrix::kernel::LineStep;
    use crate::matrix::lanes::LANES;
    use crate::matrix::weights::Weights;
    use crate::parallel::partition::ProcessMesh;
    use crate::problem::case::Case;

    const ONE: &str = "[[axis]]\nx = { lower = -1, upper = 1, cells = 6 }\n\
                       v = { lower = -1.5, upper = 1.1, cells = 7 }\n\
                       [[potential]]\nwhere = \"x < 0\"\nvalue = \"0.2 - 0.3*x\"\n\
                       [[potential]]\nvalue = \"0.4*x^2\"\n\
                       [initial]\nf = \"exp(-x^2)\"\n[time]\nend = 1.0\n";

    /// A force along `v` where `x < 0` and along `w` everywhere.
    const TWO: &str = "[[axis]]\nx = { lower = -1, upper = 1, cells = 2 }\n\
                       v = { lower = -1.5, upper = 1.1, cells = 3 }\n\
                       [[axis]]\nx = { lower = 0, upper = 1, cells = 2 }\n\
                       v = { lower = -1, upper = 1, cells = 4 }\n\
                       [[potential]]\nwhere = \"x < 0\"\nvalue = \"0.3*x + 0.1*y^2\"\n\
                       [[potential]]\nvalue = \"-0.2*y\"\n\
                       [initial]\nf = \"exp(-x^2)\"\n[time]\nend = 1.0\n";

    /// The matrix in weighted unknowns before and after its rows are gathered.
    fn matrices(text: &str, degree: usize, flux: &str) -> [BlockMatrix; 2] {
        let settings = [format!("scheme.degree={degree}"), format!("scheme.flux={flux}")];
        let case = Case::parse("case", text, &settings).expect("a case");
        let mesh = ProcessMesh { space: vec![1; case.space.dimension()], groups: 1 };
        [false, true].map(|gathered| {
            let block = Block::new(&case.space, &mesh, 0);
            let mut matrix = BlockMatrix::assemble(&case, block).expect("finite formulas");
            matrix.scale(&Weights::volumes(&matrix, &case.space).pi);
            if gathered {
                matrix.gather_elements();
            }
            matrix
        })
    }

    fn for_all(mut check: impl FnMut(&str, [BlockMatrix; 2])) {
        let degrees = (1..=8).map(|degree| (ONE, degree)).chain([(TWO, 1), (TWO, 2), (TWO, 3)]);
        for (text, degree) in degrees {
            for flux in ["0", "0.3", "1"] {
                let axes = text.matches("[[axis]]").count();
                let name = format!("{axes} axes, degree {degree}, flux {flux}");
                check(&name, matrices(text, degree, flux));
            }
        }
    }

    /// Rows with the couplings of the lines are those of the scheme. Only rows next to an end of
    /// the box keep couplings along velocities.
    #[test]
    fn couplings_are_those_of_the_scheme() {
        for_all(|name, [before, after]| {
            let lines = after.stored().velocity_lines();
            assert!(!lines.is_empty());
            let mut kept = 0;
            for i in 0..before.rows() {
                let sorted = |matrix: &BlockMatrix| {
                    let mut row: Vec<_> = matrix.row(i).collect();
                    row.retain(|(_, s, k)| s.abs().max(k.abs()) > 1e-12);
                    row.sort_by_key(|entry| entry.0);
                    row
                };
                let (expected, found) = (sorted(&before), sorted(&after));
                assert_eq!(expected.len(), found.len(), "{name}, row {i}");
                for (expected, found) in expected.iter().zip(&found) {
                    let largest = 1e-13 * (1.0 + expected.1.abs() + expected.2.abs()) * 1e2;
                    assert_eq!(expected.0, found.0, "{name}, row {i}");
                    assert!((expected.1 - found.1).abs() < largest, "{name}, row {i}");
                    assert!((expected.2 - found.2).abs() < largest, "{name}, row {i}");
                }
                let stored = after.stored().stored_row(i).filter(|e| e.0 != i);
                kept += stored.filter(|e| lines.couples(i, e.0)).count();
            }
            let all: usize = (0..before.rows()).map(|i| lines.entries(i).len()).sum();
            assert!(kept * 4 < all, "{name}: {kept} of {all} couplings are stored");
        });
    }

    /// Products of all kinds of numbers are those of the rows.
    #[test]
    fn products_are_those_of_the_rows() {
        for_all(|name, [before, after]| {
            let x: Vec<f64> = (0..before.length()).map(|i| (0.7 * i as f64).sin()).collect();
            let largest = (0..before.rows()).flat_map(|i| before.row(i)).map(|e| e.2.abs());
            let tolerance = 1e-13 * (1.0 + largest.fold(0.0, f64::max)) * 20.0;
            for operator in [Operator::Generator, Operator::Transpose, Operator::Symmetric] {
                let [expected, found] = [&before, &after].map(|matrix| {
                    let mut y = vec![0.0; matrix.rows()];
                    let lines = 0..matrix.stored().line_count();
                    matrix.apply_rows(&[lines], operator, &mut y, &x);
                    y
                });
                for (i, (expected, found)) in expected.iter().zip(&found).enumerate() {
                    let close = (expected - found).abs() < tolerance;
                    assert!(close, "{name}, {operator:?}, row {i}: {expected} {found}");
                }
            }
            check_steps(name, &before, &after, tolerance);
        });
    }

    /// Steps by every instruction set, of all lines at once and of parts.
    fn check_steps(name: &str, before: &BlockMatrix, after: &BlockMatrix, tolerance: f64) {
        let noise = |i: usize, part: usize| (1.3 * i as f64 + 0.31 * part as f64).sin();
        let lanes = |i: usize| Lanes(std::array::from_fn(|part| noise(i, part)));
        let x: Vec<Lanes> = (0..before.length()).map(lanes).collect();
        let constants = StepConstants {
            scale: std::array::from_fn(|l| 0.5 + 0.1 * l as f64),
            shift: std::array::from_fn(|l| noise(l, 10)),
            wavenumber: std::array::from_fn(|l| l as f64 - 3.0),
            coefficient: [0.0; LANES],
        };
        let step = |set: InstructionSet, matrix: &BlockMatrix, parts: usize| {
            let mut y = vec![Lanes::ZERO; matrix.rows()];
            let (all, unit) =
                (matrix.stored().line_count(), matrix.stored().velocity_lines().unit());
            let of_part = all.div_ceil(parts).next_multiple_of(unit);
            for first in (0..all).step_by(of_part) {
                let lines = first..all.min(first + of_part);
                let (matrix, y) = (matrix.stored(), &mut y[..]);
                let (constants, start) = (&constants, &[(); 0][..]);
                set.run(LineStep { matrix, lines, constants, y, x: &x, start });
            }
            y
        };
        for set in InstructionSet::all() {
            let expected = step(set, before, 1);
            let found = step(set, after, 1);
            for (i, (expected, found)) in expected.iter().zip(&found).enumerate() {
                for (expected, found) in expected.0.iter().zip(found.0) {
                    let close = (expected - found).abs() < 10.0 * tolerance;
                    assert!(close, "{name}, {set:?}, row {i}: {expected} {found}");
                }
            }
            // Parts have the same bits.
            assert_eq!(found, step(set, after, 5), "{name}, {set:?}");
        }
    }
}
