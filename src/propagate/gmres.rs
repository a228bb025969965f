//! Restarted GMRES for `M = I − aG`, preconditioned by the factors of each rank.

use crate::base::fixed_point::{FixedPoint, larger};
use crate::propagate::evolution::Evolution;
use crate::propagate::local_factors::LocalFactors;
use num_complex::Complex64;
use std::ops::Range;

pub(super) struct Gmres {
    /// Largest dimension.
    restart: usize,
    /// Orthonormal vectors one after the other, each with room for ghosts.
    basis: Vec<Complex64>,
    length: usize,
    /// Residual, and a vector to be preconditioned.
    pub(super) residual: Vec<Complex64>,
    moved: Vec<Complex64>,
    /// Columns of the upper triangular matrix, rotations, right-hand side.
    upper: Vec<Complex64>,
    rotations: Vec<(f64, Complex64)>,
    right: Vec<Complex64>,
    products: Vec<Complex64>,
    integers: Vec<i64>,
}

/// `‖v‖`, NaN where it is not finite. Collective over the space group; allocates nothing.
pub(super) fn length(system: &Evolution<'_>, v: &[Complex64]) -> f64 {
    let square = |rows: Range<usize>| v[rows].iter().map(|v| v.norm_sqr()).sum::<f64>();
    let largest = system.matrix.pieces().map(square).fold(0.0, larger);
    let bound = system.space.max(largest);
    let squares = system.matrix.pieces().map(square);
    system.space.sum(bound, system.norm_terms, squares).sqrt()
}

/// Norms that an improvement of a solution needs.
pub(super) struct ResidualNorms {
    /// Norm of the residual before.
    pub from: f64,
    /// Norm of the residual that suffices.
    pub goal: f64,
    /// A bound on `‖M‖`.
    pub size: f64,
}

impl Gmres {
    pub(super) fn new(length: usize, restart: usize) -> Self {
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
    /// P⁻¹`, until its norm meets the goal of `norms`. Returns the applications.
    pub(super) fn improve(
        &mut self,
        local: &mut LocalFactors,
        system: &mut Evolution<'_>,
        z: &mut [Complex64],
        norms: &ResidualNorms,
    ) -> usize {
        let &ResidualNorms { from, goal, size } = norms;
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
