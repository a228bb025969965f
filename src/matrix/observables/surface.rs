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
//! Along the velocities level sets are continuous (`surface/stretches.rs`).

use crate::base::row_major::position;
use crate::matrix::elements::apply_along_all;
use crate::matrix::observables::level_sets::{IDENTITY, Jacobian, determinant};
use crate::matrix::observables::surface::stretches::{AxisStretch, upper_face};
use crate::matrix::observables::zeros::{basis, basis_slopes, evaluate, has_one_sign, zeros};
use crate::problem::grid::{PhaseSpace, box_cells, coordinate};
use std::ops::Range;

mod stretches;

/// `D_v²/Σ D_I²` below which the share of a zero found along the velocities is less than 1.
const STEEP: f64 = 0.05;
/// Where a level set is this many times as steep between two elements as in both, it jumps: a front
/// passes there, and a zero in it does not count.
const FRONT: f64 = 4.0;

/// A zero of the level sets.
pub struct SurfaceZero {
    /// The cell of space it lies in, numbered in the rank's share.
    pub cell: usize,
    /// The contribution of the zero to `∫ f dx dv` over that cell.
    pub mass: f64,
    /// Coordinates `[x, y, z, vx, vy, vz]` of the zero.
    pub point: [f64; 6],
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
    let of_space = space.x.iter().map(|axis| AxisStretch::of_space(axis, n));
    let of_velocity = space.v.iter().map(|axis| AxisStretch::of_velocity(axis, n));
    let axes = of_space.chain(of_velocity).collect();
    let surface = Surface { space, share, axes, psi };
    let elements: Vec<Range<usize>> = (space.x.iter().zip(share))
        .map(|(axis, range)| range.start / axis.nodes.count()..range.end / axis.nodes.count())
        .collect();
    let velocities: Vec<Range<usize>> = surface.axes[n..].iter().map(|a| 0..a.len()).collect();
    for i in box_cells(&elements) {
        for j in box_cells(&velocities) {
            let stretches: Vec<usize> = i[..n].iter().chain(&j[..n]).copied().collect();
            if let Some(patch) = SurfacePatch::new(&surface, stretches, phi) {
                patch.visit(&mut visit);
            }
        }
    }
}

/// The level sets on the grid.
struct Surface<'a> {
    space: &'a PhaseSpace,
    /// The rank's cells of space.
    share: &'a [Range<usize>],
    /// The stretches of each axis.
    axes: Vec<Vec<AxisStretch>>,
    /// Nodal values of the level sets.
    psi: &'a [&'a [f64]],
}

impl Surface<'_> {
    /// Bernstein coefficients of a field on the box of these `stretches`, from its nodal values.
    fn coefficients(&self, stretches: &[usize], field: &[f64]) -> Vec<f64> {
        let n = self.space.dimension();
        let boxed = || self.axes.iter().zip(stretches).map(|(axis, number)| &axis[*number]);
        let nodes: Vec<Range<usize>> = boxed().map(|stretch| stretch.nodes.clone()).collect();
        let all: Vec<Range<usize>> = self.space.v.iter().map(|axis| 0..axis.cells).collect();
        let velocity_cells = self.space.velocity_cells();
        let mut values = Vec::with_capacity(nodes.iter().map(Range::len).product());
        for i in box_cells(&nodes[..n]) {
            let point = position(self.share, &i[..n]).expect("the element is in the share");
            values.extend(box_cells(&nodes[n..]).map(|j| {
                let velocity = position(&all, &j[..n]).expect("nodes are cells");
                field[point * velocity_cells + velocity]
            }));
        }
        apply_along_all(&values, boxed().map(|stretch| &stretch.to_bernstein))
    }
}

/// The surface over a box of stretches.
struct SurfacePatch<'a> {
    surface: &'a Surface<'a>,
    /// Number of the stretch along each axis.
    stretches: Vec<usize>,
    /// Coefficients of `φ`.
    phi: Vec<f64>,
    /// Coefficients of each level set.
    psi: Vec<Vec<f64>>,
}

impl<'a> SurfacePatch<'a> {
    /// The surface over the box of these `stretches`; `None` if there is none.
    fn new(surface: &'a Surface<'a>, stretches: Vec<usize>, phi: &[f64]) -> Option<Self> {
        let coefficients = |field: &[f64]| surface.coefficients(&stretches, field);
        // A level set of one sign has no zero.
        let may_vanish = |psi: &&[f64]| Some(coefficients(psi)).filter(|psi| !has_one_sign(psi));
        let psi = surface.psi.iter().map(may_vanish).collect::<Option<_>>()?;
        let phi = coefficients(phi);
        Some(Self { surface, stretches, phi, psi })
    }

    fn stretch(&self, axis: usize) -> &AxisStretch {
        &self.surface.axes[axis][self.stretches[axis]]
    }

    /// The axes, by number, with their stretches.
    fn each(&self) -> impl Iterator<Item = (usize, &AxisStretch)> {
        (0..self.stretches.len()).map(|axis| (axis, self.stretch(axis)))
    }

    /// Visits the zeros along every set of axes.
    fn visit(&self, visit: &mut impl FnMut(&SurfaceZero)) {
        let axes = self.stretches.len();
        for solved in AxisSet::of_size(axes, axes / 2) {
            let constant = |b: usize| solved.contains(b) && self.stretch(b).nodes.len() == 1;
            if !(0..axes).any(constant) {
                self.solve(solved, visit);
            }
        }
    }

    /// Visits the zeros along the axes of the set `solved`, at every point of the rule of the other
    /// axes.
    fn solve(&self, solved: AxisSet, visit: &mut impl FnMut(&SurfaceZero)) {
        let axes = self.stretches.len();
        let is_solved = |b: usize| solved.contains(b);
        let shape: Vec<usize> =
            self.each().filter(|(b, _)| is_solved(*b)).map(|(_, s)| s.nodes.len()).collect();
        let counts: Vec<usize> =
            self.each().map(|(b, s)| if is_solved(b) { 1 } else { s.samples.len() }).collect();
        for number in 0..counts.iter().product() {
            let (mut rest, mut weight, mut places) = (number, 1.0, vec![0.0; axes]);
            for b in (0..axes).rev().filter(|b| !is_solved(*b)) {
                let sample = &self.stretch(b).samples[rest % counts[b]];
                rest /= counts[b];
                places[b] = sample.node;
                weight *= sample.weight;
            }
            let rows: Vec<AxisRow> = (self.each())
                .map(|(b, stretch)| {
                    let count = stretch.nodes.len();
                    let row = || basis(count - 1, stretch.coordinate(places[b]));
                    AxisRow { count, row: (!is_solved(b)).then(row) }
                })
                .collect();
            let restricted = |c: &Vec<f64>| {
                let mut out = Vec::new();
                restrict(c, &rows, &mut out);
                out
            };
            for zero in zeros(self.psi.iter().map(restricted).collect(), &shape) {
                for (coordinate, b) in zero.iter().zip((0..axes).filter(|b| is_solved(*b))) {
                    places[b] = self.stretch(b).place(*coordinate);
                }
                if let Some(zero) = self.zero(solved, &places, weight) {
                    visit(&zero);
                }
            }
        }
    }

    /// The contribution of a zero at `places`, in elements, found with the axes `solved`, at a
    /// quadrature point of weight `weight`; `None` if it is zero.
    fn zero(&self, solved: AxisSet, places: &[f64], weight: f64) -> Option<SurfaceZero> {
        let Surface { space, share, .. } = self.surface;
        let n = space.dimension();
        let along = self.each().skip(n).filter(|(b, _)| solved.contains(*b));
        let part: f64 = along.map(|(b, stretch)| stretch.part(places[b])).product();
        let velocities = AxisSet::of_range(n..2 * n);
        let slopes = self.slopes(places);
        let square = |set: AxisSet| determinant(&jacobian(&slopes, set)).powi(2);
        let all: f64 = AxisSet::of_size(2 * n, n).map(square).sum();
        let along_velocities = smooth_step(square(velocities) / (STEEP * all));
        let counts = if solved == velocities {
            along_velocities
        } else {
            (1.0 - along_velocities) * square(solved) / (all - square(velocities))
        };
        if part == 0.0 || counts.is_nan() || counts <= 0.0 {
            return None;
        }
        if self.is_at_front(solved, places, square(solved).sqrt()) {
            return None;
        }
        let bases: Vec<Vec<f64>> =
            self.each().map(|(b, s)| basis(s.nodes.len() - 1, s.coordinate(places[b]))).collect();
        let volume: f64 = space.axes().map(|axis| axis.width()).product();
        let density = evaluate(&self.phi, &bases) / square(solved).sqrt();
        let cell: Vec<usize> = (0..n).map(|a| self.cell(a, places[a])).collect();
        let cell = position(share, &cell).expect("the element is in the share");
        let mut point = [0.0; 6];
        for (a, axis) in space.axes().enumerate() {
            let element = places[a].floor();
            let xi = 2.0 * (places[a] - element) - 1.0;
            point[coordinate(n, a)] = axis.at(element as i64, xi);
        }
        Some(SurfaceZero { cell, mass: part * counts * weight * volume * density, point })
    }

    /// The cell of a space axis that holds a place of this patch.
    fn cell(&self, a: usize, place: f64) -> usize {
        let nodes = self.surface.space.x[a].nodes;
        let element = self.stretches[a];
        let part = place - element as f64;
        let node = (0..nodes.count()).position(|node| part < upper_face(nodes, node));
        element * nodes.count() + node.unwrap_or(nodes.count() - 1)
    }

    /// Whether a zero between elements, found with the axes `solved` with this `steepness`, lies at
    /// a front: the level sets are far less steep in the elements.
    fn is_at_front(&self, solved: AxisSet, places: &[f64], steepness: f64) -> bool {
        let n = self.surface.space.dimension();
        let nodes = |b: usize| self.surface.space.v[b - n].nodes;
        let bridges: Vec<usize> = (self.each().skip(n))
            .filter(|(b, stretch)| solved.contains(*b) && stretch.is_bridge(nodes(*b)))
            .map(|(b, _)| b)
            .collect();
        let of_element = |side: usize| {
            let mut stretches = self.stretches.clone();
            for (k, b) in bridges.iter().enumerate() {
                // The elements are before and behind the bridge.
                stretches[*b] =
                    if side >> k & 1 == 0 { stretches[*b] - 1 } else { stretches[*b] + 1 };
            }
            let psi: Vec<Vec<f64>> = (self.surface.psi.iter())
                .map(|psi| self.surface.coefficients(&stretches, psi))
                .collect();
            let element = Self { surface: self.surface, stretches, phi: Vec::new(), psi };
            let at: Vec<f64> = element.each().map(|(b, s)| s.nearest(places[b])).collect();
            determinant(&jacobian(&element.slopes(&at), solved)).abs()
        };
        let sides = 0..1usize << bridges.len();
        !bridges.is_empty() && sides.map(of_element).all(|slope| steepness > FRONT * slope)
    }

    /// The slopes of the level sets at `places`, axis by axis, lengths in elements.
    fn slopes(&self, places: &[f64]) -> Vec<Vec<f64>> {
        let along = |derived: usize| {
            let rows: Vec<Vec<f64>> = (self.each())
                .map(|(b, stretch)| {
                    let basis = if b == derived { basis_slopes } else { basis };
                    basis(stretch.nodes.len() - 1, stretch.coordinate(places[b]))
                })
                .collect();
            let width = self.stretch(derived).width();
            self.psi.iter().map(|psi| evaluate(psi, &rows) / width).collect()
        };
        (0..self.stretches.len()).map(along).collect()
    }
}

/// `∂Ψ/∂I` of the axes `set`, from the slopes along all axes.
fn jacobian(slopes: &[Vec<f64>], set: AxisSet) -> Jacobian {
    let mut jacobian = IDENTITY;
    let chosen = slopes.iter().enumerate().filter(|(b, _)| set.contains(*b));
    for (column, (_, slopes)) in chosen.enumerate() {
        for (row, slope) in jacobian.iter_mut().zip(slopes) {
            row[column] = *slope;
        }
    }
    jacobian
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
