//! Linear systems `(I − aG) z = w` with `G = −iμS + K`, one mode at a time.
//!
//! `G` is skew-Hermitian, so `M = I − aG` is normal, its eigenvalues lie on `1 + i[−a‖H‖, a‖H‖]`,
//! `‖M⁻¹‖ ≤ 1`: a residual bounds the error. The part of `M` on this rank's rows has the same form.
//! It is factorised by a sparse LU, whose symbolic part is done once. If one rank holds all of
//! space, the factors solve the system; if space is split, they are the preconditioner (block
//! Jacobi) of restarted GMRES. Either way the residual of the whole system is computed and must
//! fall below a limit.
//!
//! Sums over ranks go through fixed-point integers: the bits depend on how space is split, not on
//! timing or mode groups.

use crate::base::error::{Error, Result};
use crate::base::fixed_point::{FixedPoint, larger};
use crate::matrix::block_matrix::BlockMatrix;
use crate::propagate::evolution::{Evolution, MatrixShare};
use faer::dyn_stack::{MemBuffer, MemStack};
use faer::sparse::linalg::lu::{LuRef, NumericLu, SymbolicLu, factorize_symbolic_lu};
use faer::sparse::{SparseColMatRef, SymbolicSparseColMatRef};
use faer::{Conj, MatMut, Par};
use num_complex::Complex64;
use std::ops::Range;

/// The target of the relative residual: round-off.
const AIM: f64 = 4.0 * f64::EPSILON;
/// The relative residual that is accepted if it stagnates, without the part that round-off hides.
const RESIDUAL: f64 = 1e-13;
/// Largest dimension of a Krylov space before GMRES is restarted.
pub const RESTART: usize = 60;
/// Largest dimension where one rank holds all of space, so that the factors solve the system and an
/// iteration is a refinement.
pub const REFINEMENTS: usize = 2;
/// Largest number of iterations for a system.
const MOST_ITERATIONS: usize = 3000;

/// Peak bytes a row of the factors and their workspace beside the entries of the matrix, from
/// measurements on grids of one to three dimensions and elements (docs/reliability.md). Not a
/// bound; it is up to three times too large.
///
/// The coupled unknowns form a grid of the x-axes, and of the v-axes along which a force acts. The
/// fill-in is small for one axis. For two it grows with the shorter one, for more with the largest
/// separator. Elements with a force have the more fill-in, the more nodes they have.
pub fn factor_bytes(share: &MatrixShare<'_>) -> f64 {
    let MatrixShare { case, bounds, mesh, .. } = share;
    let x = case.space.x.iter().zip(&mesh.space).map(|(a, p)| a.cells.div_ceil(*p));
    let mut lengths: Vec<f64> = x.map(|cells| cells as f64).collect();
    let forced = case.space.v.iter().zip(bounds.forces).filter(|(_, acts)| *acts);
    lengths.extend(forced.map(|(a, _)| a.cells as f64));
    let nodes = case.space.x.iter().map(|axis| axis.nodes.degree + 1).max().unwrap_or(1) as f64;
    let within = if bounds.has_forces() { nodes } else { 1.0 };
    let longest = lengths.iter().copied().fold(1.0, f64::max);
    let across = lengths.iter().product::<f64>() / longest;
    let fill = match lengths.len() {
        1 => 0.0,
        2 => 190.0 * across.powf(0.6) * (2.0 - across / longest) * within,
        _ => 65.0 * across * 0.5 * (within + 1.0),
    };
    // Jumps couple velocities along a face.
    let jumps = if bounds.jumps && case.space.dimension() > 1 { 1100.0 } else { 0.0 };
    200.0 + jumps * nodes * nodes + fill
}

/// Solves with `M`, for one `a` and `μ` at a time.
pub struct ShiftedSolver {
    local: LocalFactors,
    gmres: Gmres,
}

/// `M` on this rank's rows, column by column, with its factors.
struct LocalFactors {
    offsets: Vec<usize>,
    rows: Vec<usize>,
    values: Vec<Complex64>,
    symbolic: SymbolicLu<usize>,
    numeric: NumericLu<usize, Complex64>,
    factor_scratch: MemBuffer,
    solve_scratch: MemBuffer,
    /// `a` of the factors.
    shift: f64,
    /// `μ` of the factors.
    wavenumber: f64,
}

/// Scratch of GMRES.
struct Gmres {
    /// Largest dimension.
    restart: usize,
    /// Orthonormal vectors one after the other, each with room for ghosts.
    basis: Vec<Complex64>,
    length: usize,
    /// Residual, and a vector to be preconditioned.
    residual: Vec<Complex64>,
    moved: Vec<Complex64>,
    /// Columns of the upper triangular matrix, rotations, right-hand side.
    upper: Vec<Complex64>,
    rotations: Vec<(f64, Complex64)>,
    right: Vec<Complex64>,
    products: Vec<Complex64>,
    integers: Vec<i64>,
}

/// The residual of a solved system, and the work that it took.
#[derive(Clone, Copy, Debug)]
pub struct SolveCounts {
    /// `‖w − Mz‖/‖w‖`, plus the part that round-off may hide.
    pub residual: f64,
    /// Applications of `G`.
    pub applications: usize,
}

/// A failure of the factorisation.
fn failure(reason: &dyn std::fmt::Debug) -> Error {
    Error::Factors(format!("{reason:?}"))
}

impl LocalFactors {
    fn new(matrix: &BlockMatrix) -> Result<Self> {
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
            shift: 0.0,
            wavenumber: 0.0,
        })
    }

    fn factorise(&mut self, matrix: &BlockMatrix, a: f64, mu: f64) -> Result<()> {
        (self.shift, self.wavenumber) = (a, mu);
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
    fn precondition(&mut self, x: &mut [Complex64]) {
        LuRef::new_unchecked(&self.symbolic, &self.numeric).solve_in_place_with_conj(
            Conj::No,
            MatMut::from_column_major_slice_mut(x, self.count(), 1),
            Par::Seq,
            MemStack::new(&mut self.solve_scratch),
        );
    }

    fn count(&self) -> usize {
        self.offsets.len() - 1
    }

    /// `y ← Mx`. Collective over the space group.
    fn apply(&self, system: &mut Evolution<'_>, y: &mut [Complex64], x: &mut [Complex64]) {
        system.matrix.apply_mode(system.exchange, self.wavenumber, y, x);
        for (y, x) in y.iter_mut().zip(&x[..self.count()]) {
            *y = x - self.shift * *y;
        }
    }
}

impl ShiftedSolver {
    /// The pattern of `matrix`, analysed; `split` says that space is split over ranks.
    ///
    /// # Errors
    /// [`Error::Factors`] where memory or the range of indices does not suffice. Not collective.
    pub fn new(matrix: &BlockMatrix, split: bool) -> Result<Self> {
        Ok(Self {
            local: LocalFactors::new(matrix)?,
            gmres: Gmres::new(matrix.length(), if split { RESTART } else { REFINEMENTS }),
        })
    }

    /// Factorises `I − aG` for wavenumber `mu`. Collective over the space group.
    ///
    /// # Errors
    /// [`Error::Factors`] on any rank.
    pub fn factorise(&mut self, system: &Evolution<'_>, a: f64, mu: f64) -> Result<()> {
        let done = self.local.factorise(system.matrix, a, mu);
        system.space.agree(done)
    }

    /// `z ← M⁻¹ w`, `w` of norm at most `norm`; `w` and `z` have room for ghosts. Collective over
    /// the space group.
    ///
    /// # Errors
    /// [`Error::Solver`] where the residual does not come below its limit, on all ranks.
    pub fn solve(
        &mut self,
        system: &mut Evolution<'_>,
        z: &mut [Complex64],
        w: &[Complex64],
        norm: f64,
    ) -> Result<SolveCounts> {
        let (local, gmres) = (&mut self.local, &mut self.gmres);
        let rows = local.count();
        let interval = system.bounds.interval(local.wavenumber);
        // A bound on ‖M‖, and the round-off of a residual.
        let size = 1.0 + local.shift * (interval.centre.abs() + interval.half_width);
        let round_off = f64::EPSILON * size;
        let (aim, limit) = (AIM + 0.5 * round_off, RESIDUAL + round_off);
        z[..rows].copy_from_slice(&w[..rows]);
        local.precondition(&mut z[..rows]);
        let mut applications = 0;
        let mut before = f64::INFINITY;
        loop {
            local.apply(system, &mut gmres.residual, z);
            applications += 1;
            for (r, w) in gmres.residual[..rows].iter_mut().zip(w) {
                *r = w - *r;
            }
            let found = length(system, &gmres.residual);
            let stays = found > 0.5 * before;
            if found <= aim * norm || (stays && found <= limit * norm) {
                return Ok(SolveCounts { residual: found / norm + round_off, applications });
            }
            if applications >= MOST_ITERATIONS || !found.is_finite() {
                return Err(Error::Solver {
                    wavenumber: local.wavenumber,
                    residual: found / norm,
                    limit,
                    iterations: applications,
                });
            }
            before = found;
            applications += gmres.improve(local, system, z, found, aim * norm, size);
        }
    }
}

/// `‖v‖`, NaN where it is not finite. Collective over the space group; allocates nothing.
fn length(system: &Evolution<'_>, v: &[Complex64]) -> f64 {
    let square = |rows: Range<usize>| v[rows].iter().map(|v| v.norm_sqr()).sum::<f64>();
    let largest = system.matrix.pieces().map(square).fold(0.0, larger);
    let bound = system.space.max(largest);
    let squares = system.matrix.pieces().map(square);
    system.space.sum(bound, system.norm_terms, squares).max(0.0).sqrt()
}

fn pattern<'a>(offsets: &'a [usize], rows: &'a [usize]) -> SymbolicSparseColMatRef<'a, usize> {
    let count = offsets.len() - 1;
    SymbolicSparseColMatRef::new_checked(count, count, offsets, None, rows)
}

impl Gmres {
    fn new(length: usize, restart: usize) -> Self {
        let zeros = |n: usize| vec![Complex64::ZERO; n];
        Self {
            restart,
            basis: zeros((restart + 1) * length),
            length,
            residual: zeros(length),
            moved: zeros(length),
            upper: zeros(restart * restart),
            rotations: vec![(1.0, Complex64::ZERO); restart],
            right: zeros(restart + 1),
            products: zeros(restart),
            integers: vec![0; 4 * restart],
        }
    }

    /// `products[k] ← ⟨v_k, v_count⟩` for `k < count`, of magnitude at most `bound`. Collective
    /// over the space group.
    fn project(&mut self, system: &Evolution<'_>, count: usize, bound: f64) {
        let fixed = FixedPoint::new(bound, system.norm_terms);
        let integers = &mut self.integers[..4 * count];
        integers.fill(0);
        let last = &self.basis[count * self.length..];
        for rows in system.matrix.pieces() {
            for k in 0..count {
                let v = &self.basis[k * self.length..];
                let sum: Complex64 = rows.clone().map(|i| v[i].conj() * last[i]).sum();
                for (part, value) in [sum.re, sum.im].into_iter().enumerate() {
                    let parts = fixed.split(value);
                    integers[4 * k + 2 * part] += parts[0];
                    integers[4 * k + 2 * part + 1] += parts[1];
                }
            }
        }
        system.space.sum_integers(integers);
        for (product, i) in self.products.iter_mut().zip(integers.chunks_exact(4)) {
            *product = Complex64::new(fixed.join([i[0], i[1]]), fixed.join([i[2], i[3]]));
        }
    }

    /// `z ← z + P⁻¹ Σ y_k v_k` with the `y` that minimises the residual in a Krylov space of `M
    /// P⁻¹`, until its norm, initially `from`, is below `goal`. Returns the applications.
    fn improve(
        &mut self,
        local: &mut LocalFactors,
        system: &mut Evolution<'_>,
        z: &mut [Complex64],
        from: f64,
        goal: f64,
        size: f64,
    ) -> usize {
        let (rows, stride, restart) = (system.matrix.rows(), self.length, self.restart);
        for (v, r) in self.basis[..rows].iter_mut().zip(&self.residual) {
            *v = r / from;
        }
        self.right.fill(Complex64::ZERO);
        self.right[0] = from.into();
        let mut used = 0;
        for j in 0..restart {
            let (past, future) = self.basis.split_at_mut((j + 1) * stride);
            self.moved[..rows].copy_from_slice(&past[j * stride..j * stride + rows]);
            local.precondition(&mut self.moved[..rows]);
            local.apply(system, &mut future[..stride], &mut self.moved);
            used = j + 1;
            let below = self.orthogonalise(system, j, size);
            self.rotate(j, below);
            let closed = below <= f64::EPSILON * size;
            if closed || self.right[j + 1].norm() <= 0.5 * goal {
                break;
            }
            for q in &mut self.basis[(j + 1) * stride..(j + 1) * stride + rows] {
                *q /= below;
            }
        }
        self.substitute_back(used);
        self.moved[..rows].fill(Complex64::ZERO);
        for k in 0..used {
            let y = self.right[k];
            for (d, v) in self.moved[..rows].iter_mut().zip(&self.basis[k * stride..]) {
                *d += y * v;
            }
        }
        local.precondition(&mut self.moved[..rows]);
        for (z, d) in z[..rows].iter_mut().zip(&self.moved) {
            *z += d;
        }
        used
    }

    /// Makes vector `j + 1` of the basis, which is `M P⁻¹ v_j`, orthogonal to those before by Gram
    /// and Schmidt, twice; the products go to column `j`. Returns its norm. As `‖P⁻¹‖ ≤ 1`,
    /// `‖M P⁻¹ v‖ ≤ ‖M‖`, which is at most `size`. Collective over the space group.
    fn orthogonalise(&mut self, system: &Evolution<'_>, j: usize, size: f64) -> f64 {
        let (rows, stride, column) = (system.matrix.rows(), self.length, j * self.restart);
        self.upper[column..=column + j].fill(Complex64::ZERO);
        for _ in 0..2 {
            self.project(system, j + 1, 2.0 * size);
            for k in 0..=j {
                let product = self.products[k];
                self.upper[column + k] += product;
                let (past, last) = self.basis.split_at_mut((j + 1) * stride);
                for (q, v) in last[..rows].iter_mut().zip(&past[k * stride..]) {
                    *q -= product * v;
                }
            }
        }
        length(system, &self.basis[(j + 1) * stride..(j + 2) * stride])
    }

    /// Makes column `j`, with `below` under its diagonal, upper triangular: by the rotations of the
    /// columns before and a new one, which turns the right-hand side too.
    fn rotate(&mut self, j: usize, below: f64) {
        let column = j * self.restart;
        for k in 0..j {
            let (c, s) = self.rotations[k];
            let (a, b) = (self.upper[column + k], self.upper[column + k + 1]);
            self.upper[column + k] = c * a + s * b;
            self.upper[column + k + 1] = c * b - s.conj() * a;
        }
        let a = self.upper[column + j];
        let radius = a.norm().hypot(below);
        let (c, s) = match a.norm() {
            0.0 => (0.0, Complex64::ONE),
            length => (length / radius, a / length * (below / radius)),
        };
        self.rotations[j] = (c, s);
        self.upper[column + j] = c * a + s * below;
        let g = self.right[j];
        self.right[j] = c * g;
        self.right[j + 1] = -s.conj() * g;
    }

    /// Solves the triangular system of the first `used` columns, in place of its right-hand side.
    fn substitute_back(&mut self, used: usize) {
        for k in (0..used).rev() {
            let mut y = self.right[k];
            for j in k + 1..used {
                y -= self.upper[j * self.restart + k] * self.right[j];
            }
            self.right[k] = y / self.upper[k * self.restart + k];
        }
    }
}
