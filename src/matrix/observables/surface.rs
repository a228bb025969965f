//! Measure-valued data on elements: `f = φ Π_a δ(ψ_a)` with `φ` and the level sets as polynomials,
//! integrated over cells of space without a discrete delta function.
//!
//! On the surface `Ψ = 0`, `n` of the `2n` coordinates `(x, v)` are functions of the others. If
//! `Ψ = 0` is solved for the coordinates `I`, with the others at the points of a quadrature rule,
//!
//! ```text
//! ∫ φ δ(Ψ) dx dv = Σ_points weight Σ_zeros φ/|det ∂Ψ/∂I|
//! ```
//!
//! Solving for the velocities, `I = v`, gives `ρ = Σ φ/|det ∂Ψ/∂v|` at the zeros of `Ψ` along the
//! velocities at one point of space, which is infinite at caustics. So each zero counts with a
//! share, where the shares of all choices `I` sum to 1 (by the coarea formula any such shares are
//! valid). With the minors `D_I = det ∂Ψ/∂I`, lengths in elements, and `r = D_v²/Σ_I D_I²`, the
//! share of `I = v` is a smooth step in `r` that is 1 from `STEEP` on. The other shares are
//! proportional to `D_I²`. So near caustics the surface is followed along coordinates in which it
//! is steep, and all terms are finite.
//!
//! Polynomials of neighbouring elements differ at their face by the error of the scheme, so that a
//! zero there may be found in both or in none. Velocity elements therefore reach over their faces
//! by `overlap`, with weights that fall linearly from 1 to 0 and sum to 1.

use crate::base::quadrature::{QuadraturePoint, gauss_legendre};
use crate::base::row_major::position;
use crate::matrix::elements::{Element, apply_along_all, for_each_element};
use crate::matrix::observables::level_sets::{IDENTITY, determinant};
use crate::matrix::observables::zeros::{basis, basis_slopes, evaluate, has_one_sign, zeros};
use crate::problem::element::Nodes;
use crate::problem::grid::{MAX_DIMENSION, PhaseSpace};
use std::ops::Range;

/// `D_v²/Σ D_I²` below which the share of a zero found along the velocities is less than 1.
const STEEP: f64 = 0.05;
/// Points of the rule in a cell of a space axis, by dimension.
const SPACE_POINTS: [usize; MAX_DIMENSION] = [8, 3, 1];
/// Points of the rule in an element of a velocity axis for each of its nodes, by dimension.
const VELOCITY_POINTS: [usize; MAX_DIMENSION] = [8, 2, 1];
/// Zeros at most this far beyond an end of the velocity box, in half elements, count as on it.
const AT_END: f64 = 1e-12;

/// A zero of the level sets.
pub struct SurfaceZero {
    /// The cell of space it lies in, numbered in the rank's share.
    pub cell: usize,
    /// The contribution of the zero to `∫ f dx dv` over that cell.
    pub mass: f64,
    /// Coordinates `[x, y, z, vx, vy, vz]` of the zero.
    pub point: [f64; 6],
}

/// Distance by which a velocity element of degree `k` reaches over its faces, in half widths. It is
/// about that of the outermost Gauss node, so that polynomials grow only by a constant factor.
fn overlap(degree: usize) -> f64 {
    0.5 / ((degree + 1) * (degree + 1)) as f64
}

/// An axis of the elements.
struct ElementAxis {
    nodes: Nodes,
    /// Ends of the domain of an element's polynomial in its reference element, `[−reach, reach]`.
    reach: f64,
    /// Maps values at the nodes to Bernstein coefficients on that domain.
    to_bernstein: Vec<Vec<f64>>,
    /// The points of the rule, with weights as parts of the element's width.
    samples: Vec<QuadraturePoint>,
    /// Upper ends of the cells in the reference element.
    faces: Vec<f64>,
}

impl ElementAxis {
    fn new(nodes: Nodes, is_velocity: bool, n: usize) -> Self {
        let (count, reference) = (nodes.count(), nodes.reference());
        let reach = if is_velocity { 1.0 + overlap(nodes.degree) } else { 1.0 };
        let mut faces = vec![-1.0];
        for (m, weight) in reference.weights.iter().enumerate() {
            faces.push(if m + 1 == count { 1.0 } else { faces[m] + weight });
        }
        let parts: Vec<[f64; 2]> = if is_velocity {
            vec![[-1.0, 1.0]]
        } else {
            faces.windows(2).map(|ends| [ends[0], ends[1]]).collect()
        };
        let points = if is_velocity { VELOCITY_POINTS[n - 1] * count } else { SPACE_POINTS[n - 1] };
        let rule = gauss_legendre(points);
        let samples = parts.iter().flat_map(|[lower, upper]| {
            let points = rule.iter().map(|point| point.moved_to([*lower, *upper]));
            points.map(|p| QuadraturePoint { weight: 0.5 * p.weight, ..p })
        });
        Self {
            nodes,
            reach,
            to_bernstein: to_bernstein(nodes, reach),
            samples: samples.collect(),
            faces: faces[1..].to_vec(),
        }
    }

    /// The coordinate in `[0, 1]` of `ξ` in the domain.
    fn coordinate(&self, xi: f64) -> f64 {
        0.5 * (1.0 + xi / self.reach)
    }

    /// The point `ξ` of the reference element with a coordinate in the domain.
    fn xi(&self, coordinate: f64) -> f64 {
        self.reach * (2.0 * coordinate - 1.0)
    }

    /// The cell of an element that holds `ξ`.
    fn cell(&self, xi: f64) -> usize {
        self.faces.iter().position(|face| xi < *face).unwrap_or(self.faces.len() - 1)
    }
}

/// The matrix that maps values at the nodes to Bernstein coefficients on `[−reach, reach]`. Each
/// Lagrange polynomial is the product of its linear factors `(ξ − ξ_m)/(ξ_n − ξ_m)`.
fn to_bernstein(nodes: Nodes, reach: f64) -> Vec<Vec<f64>> {
    let (count, at) = (nodes.count(), &nodes.reference().nodes);
    let column = |n: usize| {
        let mut coefficients = vec![1.0];
        for m in (0..count).filter(|m| *m != n) {
            let [lower, upper] = [-reach, reach].map(|end| (end - at[m]) / (at[n] - at[m]));
            let k = coefficients.len();
            let mut next = vec![0.0; k + 1];
            for (j, c) in coefficients.iter().enumerate() {
                next[j] += (k - j) as f64 / k as f64 * lower * c;
                next[j + 1] += (j + 1) as f64 / k as f64 * upper * c;
            }
            coefficients = next;
        }
        coefficients
    };
    let columns: Vec<Vec<f64>> = (0..count).map(column).collect();
    (0..count).map(|j| columns.iter().map(|column| column[j]).collect()).collect()
}

/// A set of axes.
#[derive(Clone, Copy, PartialEq, Eq)]
struct AxisSet(u32);

impl AxisSet {
    /// The sets of `size` of `axes` axes.
    fn of_size(axes: usize, size: usize) -> impl Iterator<Item = Self> {
        (0u32..1 << axes).filter(move |set| set.count_ones() as usize == size).map(Self)
    }

    /// The set of these axes.
    fn of_range(axes: Range<usize>) -> Self {
        Self(axes.fold(0, |set, axis| set | 1 << axis))
    }

    fn contains(self, axis: usize) -> bool {
        self.0 >> axis & 1 == 1
    }
}

/// The surface over one element.
struct SurfacePatch<'a> {
    element: &'a Element<'a>,
    space: &'a PhaseSpace,
    lines: &'a [ElementAxis],
    /// Coefficients of `φ`.
    phi: Vec<f64>,
    /// Coefficients of each level set.
    psi: Vec<Vec<f64>>,
}

/// Calls `visit` with the zeros of the level sets `psi` over the space cells `share` with all
/// velocities, where `phi` and each of `psi` hold nodal values. The masses of the zeros sum to the
/// integral of `φ Π_a δ(ψ_a)`.
pub fn for_each_zero(
    space: &PhaseSpace,
    share: &[Range<usize>],
    phi: &[f64],
    psi: &[&[f64]],
    mut visit: impl FnMut(&SurfaceZero),
) {
    let n = space.dimension();
    let lines: Vec<ElementAxis> =
        space.axes().enumerate().map(|(a, axis)| ElementAxis::new(axis.nodes, a >= n, n)).collect();
    for_each_element(space, share, |element| {
        let matrices = || lines.iter().map(|line| &line.to_bernstein);
        let coefficients =
            |field: &[f64]| apply_along_all(&element.nodal(share, field), matrices());
        // A level set of one sign has no zero in the element.
        let may_vanish = |psi: &&[f64]| Some(coefficients(psi)).filter(|psi| !has_one_sign(psi));
        let Some(psi) = psi.iter().map(may_vanish).collect() else { return };
        let patch = SurfacePatch { element, space, lines: &lines, phi: coefficients(phi), psi };
        for solved in AxisSet::of_size(2 * n, n) {
            let constant = |b: usize| solved.contains(b) && lines[b].nodes.degree == 0;
            if !(0..2 * n).any(constant) {
                patch.solve(solved, share, &mut visit);
            }
        }
    });
}

impl SurfacePatch<'_> {
    /// Visits the zeros along the axes of the set `solved`, at every point of the rule of the other
    /// axes.
    fn solve(&self, solved: AxisSet, share: &[Range<usize>], visit: &mut impl FnMut(&SurfaceZero)) {
        let axes = self.lines.len();
        let is_solved = |b: usize| solved.contains(b);
        let shape: Vec<usize> =
            (0..axes).filter(|b| is_solved(*b)).map(|b| self.lines[b].nodes.count()).collect();
        let counts: Vec<usize> =
            (0..axes).map(|b| if is_solved(b) { 1 } else { self.lines[b].samples.len() }).collect();
        for number in 0..counts.iter().product() {
            let (mut rest, mut weight, mut xi) = (number, 1.0, vec![0.0; axes]);
            for b in (0..axes).rev().filter(|b| !is_solved(*b)) {
                let sample = &self.lines[b].samples[rest % counts[b]];
                rest /= counts[b];
                xi[b] = sample.node;
                weight *= sample.weight;
            }
            let rows: Vec<AxisRow> = (self.lines.iter().enumerate())
                .map(|(b, line)| {
                    let row = basis(line.nodes.degree, line.coordinate(xi[b]));
                    AxisRow { count: line.nodes.count(), row: (!is_solved(b)).then_some(row) }
                })
                .collect();
            let restricted = |c: &Vec<f64>| {
                let mut out = Vec::new();
                restrict(c, &rows, &mut out);
                out
            };
            for zero in zeros(self.psi.iter().map(restricted).collect(), &shape) {
                for (coordinate, b) in zero.iter().zip((0..axes).filter(|b| is_solved(*b))) {
                    xi[b] = self.lines[b].xi(*coordinate);
                }
                if let Some(zero) = self.zero(solved, &xi, weight, share) {
                    visit(&zero);
                }
            }
        }
    }

    /// The contribution of a zero at `xi`, found with the axes `solved`, at a quadrature point of
    /// weight `weight`; `None` if it is zero.
    fn zero(
        &self,
        solved: AxisSet,
        xi: &[f64],
        weight: f64,
        share: &[Range<usize>],
    ) -> Option<SurfaceZero> {
        let n = self.space.dimension();
        let part: f64 =
            (n..2 * n).filter(|b| solved.contains(*b)).map(|b| self.part(b, xi[b])).product();
        let velocities = AxisSet::of_range(n..2 * n);
        let minors = self.minors(xi);
        let square = |set: AxisSet| minors.iter().find(|m| m.0 == set).map_or(0.0, |m| m.1 * m.1);
        let all: f64 = minors.iter().map(|m| m.1 * m.1).sum();
        let along_velocities = smooth_step(square(velocities) / (STEEP * all));
        let counts = if solved == velocities {
            along_velocities
        } else {
            (1.0 - along_velocities) * square(solved) / (all - square(velocities))
        };
        if part == 0.0 || counts.is_nan() || counts <= 0.0 {
            return None;
        }
        let bases: Vec<Vec<f64>> = (self.lines.iter().zip(xi))
            .map(|(line, xi)| basis(line.nodes.degree, line.coordinate(*xi)))
            .collect();
        let volume: f64 = self.space.axes().map(|axis| axis.width()).product();
        let density = evaluate(&self.phi, &bases) / square(solved).sqrt();
        let cell: [usize; MAX_DIMENSION] = std::array::from_fn(|a| {
            if a < n {
                self.element.index[a] * self.lines[a].nodes.count() + self.lines[a].cell(xi[a])
            } else {
                0
            }
        });
        let cell = position(share, &cell).expect("the element is in the share");
        let mass = part * counts * weight * volume * density;
        Some(SurfaceZero { cell, mass, point: self.element.point(xi) })
    }

    /// The weight of the element at `ξ` along a velocity axis; those of overlapping elements sum to
    /// 1.
    fn part(&self, b: usize, xi: f64) -> f64 {
        let elements = self.space.v[b - self.space.dimension()].elements();
        let overlap = self.lines[b].reach - 1.0;
        let e = self.element.index[b];
        let beyond = xi.abs() - 1.0;
        if (xi < 0.0 && e == 0) || (xi > 0.0 && e + 1 == elements) {
            return f64::from(u8::from(beyond <= AT_END));
        }
        (0.5 * (1.0 - beyond / overlap)).clamp(0.0, 1.0)
    }

    /// The minors `det ∂Ψ/∂I` at `xi` of all sets `I` of `n` axes, lengths in elements.
    fn minors(&self, xi: &[f64]) -> Vec<(AxisSet, f64)> {
        let (n, axes) = (self.space.dimension(), self.lines.len());
        let rows = |derived: usize| -> Vec<Vec<f64>> {
            (self.lines.iter().zip(xi).enumerate())
                .map(|(b, (line, xi))| {
                    let coordinate = line.coordinate(*xi);
                    if b == derived {
                        basis_slopes(line.nodes.degree, coordinate)
                    } else {
                        basis(line.nodes.degree, coordinate)
                    }
                })
                .collect()
        };
        // [axis][level set], with lengths in elements: an element is 1/reach of the domain.
        let slopes: Vec<Vec<f64>> = (0..axes)
            .map(|b| {
                let rows = rows(b);
                self.psi.iter().map(|psi| evaluate(psi, &rows) / self.lines[b].reach).collect()
            })
            .collect();
        AxisSet::of_size(axes, n)
            .map(|set| {
                let mut jacobian = IDENTITY;
                let chosen = (0..axes).filter(|b| set.contains(*b));
                for (column, b) in chosen.enumerate() {
                    for (a, row) in jacobian.iter_mut().enumerate().take(n) {
                        row[column] = slopes[b][a];
                    }
                }
                (set, determinant(&jacobian))
            })
            .collect()
    }
}

/// A step that rises smoothly from 0 to 1, which it reaches at `u = 1`.
fn smooth_step(u: f64) -> f64 {
    let u = u.min(1.0);
    u * u * (3.0 - 2.0 * u)
}

/// An axis of coefficients: their number, and the row with which the axis is contracted, if it is.
struct AxisRow {
    count: usize,
    row: Option<Vec<f64>>,
}

/// Appends to `out` the coefficients along the axes without a row; the other axes are contracted
/// with their rows.
fn restrict(coefficients: &[f64], axes: &[AxisRow], out: &mut Vec<f64>) {
    let Some((AxisRow { count, row }, rest)) = axes.split_first() else {
        out.extend_from_slice(coefficients);
        return;
    };
    let slices = coefficients.chunks_exact(coefficients.len() / count);
    match row {
        None => slices.for_each(|slice| restrict(slice, rest, out)),
        Some(row) => {
            let mut sum = vec![0.0; coefficients.len() / count];
            for (b, slice) in row.iter().zip(slices) {
                sum.iter_mut().zip(slice).for_each(|(sum, c)| *sum += b * c);
            }
            restrict(&sum, rest, out);
        }
    }
}

#[cfg(test)]
mod tests;
