//! `M = I − aG` on this rank's rows, by sparse factors.

use crate::base::error::{Error, Result};
use crate::matrix::block_matrix::BlockMatrix;
use crate::propagate::evolution::Evolution;
use faer::dyn_stack::{MemBuffer, MemStack};
use faer::sparse::linalg::lu::{LuRef, NumericLu, SymbolicLu, factorize_symbolic_lu};
use faer::sparse::{SparseColMatRef, SymbolicSparseColMatRef};
use faer::{Conj, MatMut, Par};
use num_complex::Complex64;

/// A mode for which `M` is solved.
#[derive(Clone, Copy, Debug)]
pub struct ShiftedMode {
    /// `a`.
    pub shift: f64,
    /// `μ`.
    pub wavenumber: f64,
}

/// `M` on this rank's rows, column by column, with its factors.
pub(super) struct LocalFactors {
    offsets: Vec<usize>,
    rows: Vec<usize>,
    values: Vec<Complex64>,
    symbolic: SymbolicLu<usize>,
    numeric: NumericLu<usize, Complex64>,
    factor_scratch: MemBuffer,
    solve_scratch: MemBuffer,
    /// The mode of the factors.
    pub(super) mode: ShiftedMode,
}

fn failure(reason: &dyn std::fmt::Debug) -> Error {
    Error::Factors(format!("{reason:?}"))
}

impl LocalFactors {
    pub(super) fn new(matrix: &BlockMatrix) -> Result<Self> {
        let count = matrix.rows();
        let (mut offsets, mut rows) = (vec![0usize], Vec::new());
        for j in 0..count {
            // The pattern is symmetric: row j lists the rows of column j. Auxiliary unknowns have
            // no diagonal entry.
            rows.extend(matrix.row(j).map(|e| e.0).filter(|&i| i < count && i != j));
            rows.push(j);
            // Rows are in the order of global columns, not of local ones.
            let start = offsets[j];
            rows[start..].sort_unstable();
            offsets.push(rows.len());
        }
        let pattern = pattern(&offsets, &rows);
        let symbolic =
            factorize_symbolic_lu(pattern, Default::default()).map_err(|e| failure(&e))?;
        let scratch = |requirement| MemBuffer::try_new(requirement).map_err(|e| failure(&e));
        let par = Par::Seq;
        let factor_scratch =
            scratch(symbolic.factorize_numeric_lu_scratch::<Complex64>(par, Default::default()))?;
        let solve_scratch = scratch(symbolic.solve_in_place_scratch::<Complex64>(1, par))?;
        Ok(Self {
            values: vec![Complex64::ZERO; rows.len()],
            offsets,
            rows,
            symbolic,
            numeric: NumericLu::new(),
            factor_scratch,
            solve_scratch,
            mode: ShiftedMode { shift: 0.0, wavenumber: 0.0 },
        })
    }

    /// Factorises this rank's part of `M` of `mode`.
    pub(super) fn factorise(&mut self, matrix: &BlockMatrix, mode: ShiftedMode) -> Result<()> {
        let ShiftedMode { shift: a, wavenumber: mu } = mode;
        self.mode = mode;
        let count = self.count();
        for j in 0..count {
            let range = self.offsets[j]..self.offsets[j + 1];
            let (rows, values) = (&self.rows[range.clone()], &mut self.values[range]);
            for (&i, value) in rows.iter().zip(&mut *values) {
                *value = f64::from(u8::from(i == j)).into();
            }
            for (i, s, k) in matrix.row(j).filter(|e| e.0 < count) {
                // Entry (i, j) from (j, i): S is symmetric, K skew.
                if let Ok(at) = rows.binary_search(&i) {
                    values[at] += Complex64::new(a * k, a * mu * s);
                }
            }
        }
        let matrix = SparseColMatRef::new(pattern(&self.offsets, &self.rows), &self.values[..]);
        let factors = self.symbolic.factorize_numeric_lu(
            &mut self.numeric,
            matrix,
            Par::Seq,
            MemStack::new(&mut self.factor_scratch),
            Default::default(),
        );
        factors.map(|_| ()).map_err(|e| failure(&e))
    }

    /// `x ←` (this rank's part of `M`)`⁻¹ x`.
    pub(super) fn precondition(&mut self, x: &mut [Complex64]) {
        LuRef::new_unchecked(&self.symbolic, &self.numeric).solve_in_place_with_conj(
            Conj::No,
            MatMut::from_column_major_slice_mut(x, self.count(), 1),
            Par::Seq,
            MemStack::new(&mut self.solve_scratch),
        );
    }

    pub(super) fn count(&self) -> usize {
        self.offsets.len() - 1
    }

    /// `y ← Mx`. Collective over the space group.
    pub(super) fn apply(
        &self,
        system: &mut Evolution<'_>,
        y: &mut [Complex64],
        x: &mut [Complex64],
    ) {
        system.matrix.apply_mode(system.exchange, self.mode.wavenumber, y, x);
        for (y, x) in y.iter_mut().zip(&x[..self.count()]) {
            *y = x - self.mode.shift * *y;
        }
    }
}

fn pattern<'a>(offsets: &'a [usize], rows: &'a [usize]) -> SymbolicSparseColMatRef<'a, usize> {
    let count = offsets.len() - 1;
    SymbolicSparseColMatRef::new_checked(count, count, offsets, None, rows)
}
