//! Formulas and exact solutions on a rank's cells.
//!
//! Of degree 0, the value at the centre of each cell. Of a higher degree, the `L2` projection onto
//! the polynomials of each element, by Gauss's rule; an element in which a formula jumps is cut
//! into halves along every axis, again and again, where it does. On grids so large that this would
//! take too long, elements that look smooth have the values at their nodes.

use crate::base::error::Result;
use crate::base::quadrature::{QuadraturePoint, gauss_legendre};
use crate::parallel::communicator::Group;
use crate::parallel::partition::Block;
use crate::problem::element::{Family, Nodes};
use crate::problem::formula::Expression;
use crate::problem::grid::{Cell, MAX_DIMENSION, PhaseSpace, describe_point, for_each_cell};
use std::ops::Range;

/// Points of Gauss's rule beyond the nodes of an element, along each axis.
const MORE_POINTS: usize = 2;
/// Points of a rule for a whole grid at most; beyond, elements that look smooth have nodal values.
const MOST_POINTS: f64 = 4e7;
/// Points beyond which nothing is cut once more in two and three dimensions, if all were.
const MOST_CUT_POINTS: f64 = 1e8;
/// How often an element is cut where a formula jumps, by space dimension.
const MOST_CUTS: [usize; MAX_DIMENSION] = [6, 2, 1];
/// A part whose highest Legendre coefficients are above this fraction of the largest value on the
/// grid is cut.
const ROUGH: f64 = 1e-2;
/// So is one whose polynomial misses the value at an end by this fraction of it.
const MISSED: f64 = 5e-2;
/// How far inside of a part its ends are looked at, in widths.
const AT_END: f64 = 1e-9;

/// `value` at the centres of the block's cells `cells`, of those on a face just inside.
pub fn sample_with(
    space: &PhaseSpace,
    block: &Block,
    cells: &Range<usize>,
    mut value: impl FnMut(&[f64; 6]) -> f64,
) -> Vec<f64> {
    let mut values = Vec::with_capacity(cells.len());
    block.for_each_own(|global, local| {
        for v in 0..block.velocity_cells {
            if cells.contains(&(local + v)) {
                values.push(value(&space.inner_point(&space.cell(global + v))));
            }
        }
    });
    values
}

/// A formula on this rank's cells. Collective over `world` (the largest value).
///
/// # Errors
/// [`crate::base::error::Error::Formula`] where it is not finite, on the rank that finds it.
pub fn sample(
    world: &Group,
    space: &PhaseSpace,
    block: &Block,
    formula: &Expression,
    time: f64,
) -> Result<Vec<f64>> {
    let mut failure = None;
    let mut checked = |point: &[f64; 6]| {
        let value = formula.at_point(point, time);
        if !value.is_finite() && failure.is_none() {
            failure = Some(formula.undefined(value, describe_point(space.dimension(), point)));
        }
        value
    };
    let values = match space.degree() {
        0 => {
            let mut values = Vec::with_capacity(block.cells());
            block.for_each_own(|global, _| {
                for v in 0..block.velocity_cells {
                    values.push(checked(&space.point(&space.cell(global + v))));
                }
            });
            values
        }
        _ => projected(world, space, block, &mut checked),
    };
    match failure {
        Some(error) => Err(error),
        None => Ok(values),
    }
}

/// The `L2` projection of `value` on this rank's cells. Collective over `world`.
fn projected(
    world: &Group,
    space: &PhaseSpace,
    block: &Block,
    value: &mut impl FnMut(&[f64; 6]) -> f64,
) -> Vec<f64> {
    let nodal = sample_with(space, block, &(0..block.cells()), |point| value(point));
    let finite = nodal.iter().filter(|f| f.is_finite());
    let largest = world.max(finite.fold(0.0, |most, f| most.max(f.abs())));
    let mut values = vec![0.0; block.cells()];
    let points: f64 =
        space.axes().map(|a| (a.elements() * (a.nodes.count() + MORE_POINTS)) as f64).product();
    let always = points <= MOST_POINTS;
    let cuts = most_cuts(space.dimension(), points);
    for_each_element(space, &block.ranges, |element| {
        let mut at_nodes = vec![0.0; element.shape().iter().product()];
        element.for_each_cell(&block.ranges, |cell, node| at_nodes[node] = nodal[cell]);
        if always || element.is_rough(&at_nodes, largest) {
            at_nodes = element.projection(value, largest, cuts);
        }
        element.for_each_cell(&block.ranges, |cell, node| values[cell] = at_nodes[node]);
    });
    values
}

/// How often an element of a grid may be cut whose rules have `points` points in all.
fn most_cuts(dimension: usize, points: f64) -> usize {
    let most = MOST_CUTS[dimension - 1];
    let after = |cuts: usize| points * f64::powi(4.0, (dimension * cuts) as i32);
    let few = |cuts: &usize| dimension == 1 || after(*cuts) <= MOST_CUT_POINTS;
    (0..=most).rev().find(few).unwrap_or(0)
}

/// An element of the grid: one of each axis.
pub struct Element<'a> {
    space: &'a PhaseSpace,
    /// Its number along each of the `2n` axes.
    pub place: Cell,
}

/// Calls `visit` with every element over the space cells `ranges`, which are of whole elements, and
/// all velocities.
pub fn for_each_element(
    space: &PhaseSpace,
    ranges: &[Range<usize>],
    mut visit: impl FnMut(&Element<'_>),
) {
    let n = space.dimension();
    let of_space: Vec<Range<usize>> = (space.x.iter().zip(ranges))
        .map(|(a, r)| r.start / a.nodes.count()..r.end / a.nodes.count())
        .collect();
    let of_velocity: Vec<Range<usize>> = space.v.iter().map(|a| 0..a.elements()).collect();
    for_each_cell(&of_space, |i| {
        for_each_cell(&of_velocity, |j| {
            let mut place = Cell::default();
            place[..n].copy_from_slice(&i[..n]);
            place[n..2 * n].copy_from_slice(&j[..n]);
            visit(&Element { space, place });
        });
    });
}

/// The part `[−1 + 2 index/2^level, …]` of an axis of the reference element.
#[derive(Clone, Copy)]
struct Part {
    level: usize,
    index: usize,
}

impl Part {
    const WHOLE: Self = Self { level: 0, index: 0 };

    fn ends(self) -> [f64; 2] {
        let width = 2.0 / (1 << self.level) as f64;
        [-1.0 + width * self.index as f64, -1.0 + width * (self.index + 1) as f64]
    }

    fn half(self, upper: bool) -> Self {
        Self { level: self.level + 1, index: 2 * self.index + usize::from(upper) }
    }
}

impl Element<'_> {
    fn nodes(&self) -> impl DoubleEndedIterator<Item = Nodes> + '_ {
        let (x, v) = (&self.space.x, &self.space.v);
        x.iter().chain(v).map(|a| a.nodes)
    }

    /// Nodes along each axis.
    pub fn shape(&self) -> Vec<usize> {
        self.nodes().map(|nodes| nodes.count()).collect()
    }

    /// Products of the quadrature weights of its nodes on `[−1, 1]`, the last axis fastest.
    pub fn weights(&self) -> Vec<f64> {
        self.nodes().fold(vec![1.0], |products, nodes| {
            let weights = &nodes.reference().weights;
            products.iter().flat_map(|p| weights.iter().map(move |w| p * w)).collect()
        })
    }

    /// The point that has the coordinates `xi` in the reference element.
    pub fn point(&self, xi: &[f64]) -> [f64; 6] {
        let n = self.space.dimension();
        let mut point = [0.0; 6];
        for (a, axis) in self.space.axes().enumerate() {
            let slot = if a < n { a } else { 3 + a - n };
            point[slot] = axis.at(self.place[a] as i64, xi[a]);
        }
        point
    }

    /// Calls `visit(cell, node)` with the number of each of its cells in a block or share of the
    /// space cells `ranges` with all velocities, and the cell's number in the element.
    pub fn for_each_cell(&self, ranges: &[Range<usize>], mut visit: impl FnMut(usize, usize)) {
        let n = self.space.dimension();
        let shape = self.shape();
        let mut node = 0;
        let count: usize = shape.iter().product();
        let mut m = vec![0; shape.len()];
        while node < count {
            let mut cell = 0;
            for (a, axis) in self.space.axes().enumerate() {
                let j = self.place[a] * shape[a] + m[a];
                cell = match ranges.get(a).filter(|_| a < n) {
                    Some(range) => cell * range.len() + j - range.start,
                    None => cell * axis.cells + j,
                };
            }
            visit(cell, node);
            node += 1;
            advance(&mut m, &shape);
        }
    }

    /// Whether nodal values look as if the function jumps.
    fn is_rough(&self, nodal: &[f64], largest: f64) -> bool {
        let rules: Vec<Vec<f64>> =
            self.nodes().map(|nodes| nodes.reference().nodes.clone()).collect();
        is_rough(nodal, &rules, largest)
    }

    /// The `L2` projection of `value`: values at the nodes. Parts are cut at most `cuts` times.
    fn projection(
        &self,
        value: &mut impl FnMut(&[f64; 6]) -> f64,
        largest: f64,
        cuts: usize,
    ) -> Vec<f64> {
        let axes = 2 * self.space.dimension();
        let mut sum = vec![0.0; self.shape().iter().product()];
        let mut open = vec![[Part::WHOLE; 2 * MAX_DIMENSION]];
        while let Some(parts) = open.pop() {
            let rules: Vec<Vec<QuadraturePoint>> =
                (self.nodes().zip(&parts)).map(|(nodes, part)| part_rule(nodes, *part)).collect();
            let points: Vec<Vec<f64>> =
                rules.iter().map(|rule| rule.iter().map(|p| p.node).collect()).collect();
            let values = self.values_at(&points, value);
            let level = parts[0].level;
            let is_cut = level < cuts
                && (is_rough(&values, &points, largest)
                    || self.jumps_at_an_end(&values, &points, &parts[..axes], value, largest));
            if is_cut {
                for child in 0..1usize << axes {
                    let mut halves = parts;
                    for (a, part) in halves.iter_mut().enumerate().take(axes) {
                        *part = part.half(child >> a & 1 == 1);
                    }
                    open.push(halves);
                }
                continue;
            }
            let matrices: Vec<Vec<Vec<f64>>> =
                self.nodes().zip(&rules).map(|(nodes, rule)| projector(nodes, rule)).collect();
            let added = apply_along_all(&values, &matrices);
            sum.iter_mut().zip(added).for_each(|(sum, value)| *sum += value);
        }
        sum
    }

    /// Whether the polynomial through `values` at `points` misses `value` at an end of `parts`,
    /// where a jump beyond the outermost points is not seen otherwise. Looked at in one space
    /// dimension only: in more the ends are too many.
    fn jumps_at_an_end(
        &self,
        values: &[f64],
        points: &[Vec<f64>],
        parts: &[Part],
        value: &mut impl FnMut(&[f64; 6]) -> f64,
        largest: f64,
    ) -> bool {
        if parts.len() > 2 {
            return false;
        }
        (0..parts.len()).any(|a| {
            let [lower, upper] = parts[a].ends();
            let inside = AT_END * (upper - lower);
            let mut at_ends = points.to_vec();
            at_ends[a] = vec![lower + inside, upper - inside];
            let matrices: Vec<Vec<Vec<f64>>> = (points.iter().zip(&at_ends))
                .map(|(points, ends)| ends.iter().map(|x| lagrange_values(points, *x)).collect())
                .collect();
            let extrapolated = apply_along_all(values, &matrices);
            let found = self.values_at(&at_ends, value);
            let misses = |(a, b): (&f64, &f64)| (a - b).abs() > MISSED * largest;
            extrapolated.iter().zip(&found).any(misses)
        })
    }

    /// `value` on the product of `points` along the axes, the last running fastest.
    pub fn values_at(
        &self,
        points: &[Vec<f64>],
        value: &mut impl FnMut(&[f64; 6]) -> f64,
    ) -> Vec<f64> {
        let shape: Vec<usize> = points.iter().map(Vec::len).collect();
        let mut m = vec![0; shape.len()];
        let mut xi = vec![0.0; shape.len()];
        (0..shape.iter().product())
            .map(|_| {
                for (a, xi) in xi.iter_mut().enumerate() {
                    *xi = points[a][m[a]];
                }
                advance(&mut m, &shape);
                value(&self.point(&xi))
            })
            .collect()
    }
}

/// The next multi-index of a box, row-major.
fn advance(m: &mut [usize], shape: &[usize]) {
    for a in (0..m.len()).rev() {
        m[a] += 1;
        if m[a] < shape[a] {
            return;
        }
        m[a] = 0;
    }
}

/// Gauss's rule on a part of an axis: points of the reference element, and weights.
fn part_rule(nodes: Nodes, part: Part) -> Vec<QuadraturePoint> {
    let rule = gauss_legendre(nodes.count() + MORE_POINTS);
    rule.into_iter().map(|point| point.moved_to(part.ends())).collect()
}

/// `[m][q]`: what the value at point `q` of a rule adds to the projection's value at node `m`:
/// `Σ_n (M⁻¹)_mn ℓ_n(ξ_q) w_q`, with the exact mass matrix `M_mn = ∫ ℓ_m ℓ_n`.
///
/// By the orthogonal Legendre polynomials, `Σ_j (2j + 1)/2 P_j(ξ_m) P_j(ξ_q) w_q`.
fn projector(nodes: Nodes, rule: &[QuadraturePoint]) -> Vec<Vec<f64>> {
    let at_rule: Vec<Vec<f64>> =
        rule.iter().map(|p| legendre_values(nodes.degree, p.node)).collect();
    (nodes.reference().nodes.iter())
        .map(|node| {
            let at_node = legendre_values(nodes.degree, *node);
            (rule.iter().zip(&at_rule))
                .map(|(point, values)| {
                    let terms = values.iter().zip(&at_node).enumerate();
                    point.weight * terms.map(|(j, (p, q))| (j as f64 + 0.5) * p * q).sum::<f64>()
                })
                .collect()
        })
        .collect()
}

/// `[j][m]`: what the value at node `m` adds to the coefficient of the Legendre polynomial `P_j` of
/// the polynomial through all nodes: `w_m P_j(ξ_m)/γ_j` with the discrete norms `γ_j = 2/(2j + 1)`,
/// and `2/k` of `P_k` at Gauss–Lobatto nodes.
pub fn legendre_transform(nodes: Nodes) -> Vec<Vec<f64>> {
    let (k, reference) = (nodes.degree, nodes.reference());
    (0..=k)
        .map(|j| {
            let lobatto = j == k && k > 0 && nodes.family == Family::Lobatto;
            let norm = if lobatto { 2.0 / k as f64 } else { 2.0 / (2 * j + 1) as f64 };
            let rule = reference.nodes.iter().zip(&reference.weights);
            rule.map(|(xi, w)| w * legendre_values(k, *xi)[j] / norm).collect()
        })
        .collect()
}

/// `P_0(x), …, P_k(x)`.
fn legendre_values(degree: usize, x: f64) -> Vec<f64> {
    let mut values = vec![1.0, x];
    for j in 1..degree.max(1) {
        let n = j as f64;
        values.push(((2.0 * n + 1.0) * x * values[j] - n * values[j - 1]) / (n + 1.0));
    }
    values.truncate(degree + 1);
    values
}

/// Whether the polynomial through `values` on the product of `points` has, along an axis, highest
/// Legendre coefficients beyond [`ROUGH`] times `largest`.
fn is_rough(values: &[f64], points: &[Vec<f64>], largest: f64) -> bool {
    let shape: Vec<usize> = points.iter().map(Vec::len).collect();
    (0..shape.len()).filter(|&a| shape[a] > 1).any(|a| {
        let stride: usize = shape[a + 1..].iter().product();
        let rows = highest_coefficients(&points[a]);
        rows.iter().any(|row| {
            (0..values.len()).filter(|at| (at / stride).is_multiple_of(shape[a])).any(|at| {
                let line = row.iter().enumerate().map(|(q, c)| c * values[at + q * stride]);
                line.sum::<f64>().abs() > ROUGH * largest
            })
        })
    })
}

/// The Lagrange polynomials of `points` at `x`.
fn lagrange_values(points: &[f64], x: f64) -> Vec<f64> {
    let others = |q: usize| (0..points.len()).filter(move |o| *o != q);
    let value = |q: usize| -> f64 {
        others(q).map(|o| (x - points[o]) / (points[q] - points[o])).product()
    };
    (0..points.len()).map(value).collect()
}

/// `[j][q]`: what the value at point `q` adds to each of the two highest Legendre coefficients (to
/// the one, of two points) of the polynomial through all.
fn highest_coefficients(points: &[f64]) -> Vec<Vec<f64>> {
    let count = points.len();
    let (middle, half) = (0.5 * (points[0] + points[count - 1]), points[count - 1] - points[0]);
    let scaled: Vec<f64> = points.iter().map(|x| 2.0 * (x - middle) / half).collect();
    let rule = gauss_legendre(count);
    let least = if count > 2 { count - 2 } else { count - 1 };
    (least..count)
        .map(|j| {
            (0..count)
                .map(|q| {
                    let term = |p: &QuadraturePoint| {
                        let lagrange = lagrange_values(&scaled, p.node)[q];
                        p.weight * lagrange * legendre_values(j, p.node)[j]
                    };
                    (j as f64 + 0.5) * rule.iter().map(term).sum::<f64>()
                })
                .collect()
        })
        .collect()
}

/// Applies a matrix along each axis to `values`, whose last axis runs fastest.
pub fn apply_along_all(values: &[f64], matrices: &[Vec<Vec<f64>>]) -> Vec<f64> {
    apply_in_elements(values, &matrices.iter().map(|m| (1, &m[..])).collect::<Vec<_>>())
}

/// Applies a matrix along each axis in each of its elements: `values` has along an axis so many
/// elements of as many cells as the matrix has columns, and the last axis runs fastest.
pub fn apply_in_elements(values: &[f64], axes: &[(usize, &[Vec<f64>])]) -> Vec<f64> {
    let mut values = values.to_vec();
    let mut stride = 1;
    for (elements, matrix) in axes.iter().rev() {
        let (rows, columns) = (matrix.len(), matrix[0].len());
        let outer = values.len() / (columns * stride);
        let mut next = vec![0.0; outer * rows * stride];
        for o in 0..outer {
            for (m, row) in matrix.iter().enumerate() {
                let out = &mut next[(o * rows + m) * stride..(o * rows + m + 1) * stride];
                for (q, c) in row.iter().enumerate() {
                    let from = &values[(o * columns + q) * stride..(o * columns + q + 1) * stride];
                    out.iter_mut().zip(from).for_each(|(out, value)| *out += c * value);
                }
            }
        }
        values = next;
        stride *= rows * elements;
    }
    values
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::problem::grid::Axis;

    fn space(k: [usize; 2]) -> PhaseSpace {
        PhaseSpace {
            x: vec![Axis::new(-1.0, 1.0, 3).with_nodes(Nodes::of_space(k[0]))],
            v: vec![Axis::new(-1.5, 0.9, 5).with_nodes(Nodes::of_velocity(k[1]))],
            periodic: [false; MAX_DIMENSION],
        }
    }

    fn projection(space: &PhaseSpace, f: impl Fn(f64, f64) -> f64) -> Vec<f64> {
        let ranges: Vec<_> = space.x.iter().map(|x| 0..x.cells).collect();
        let mut values = vec![0.0; space.cells()];
        for_each_element(space, &ranges, |element| {
            let found = element.projection(&mut |p: &[f64; 6]| f(p[0], p[3]), 1.0, 6);
            element.for_each_cell(&ranges, |cell, node| values[cell] = found[node]);
        });
        values
    }

    #[test]
    fn polynomials_are_their_own_projections() {
        for k in [[1, 0], [0, 2], [3, 4], [8, 1]] {
            let space = space(k);
            let f =
                |x: f64, v: f64| (1.0 + x.powi(k[0] as i32)) * (2.0 - 0.5 * v.powi(k[1] as i32));
            for (i, found) in projection(&space, f).into_iter().enumerate() {
                let point = space.point(&space.cell(i));
                assert!((found - f(point[0], point[3])).abs() < 1e-12, "{k:?} {i}: {found}");
            }
        }
    }

    #[test]
    fn mass_of_what_jumps_is_kept() {
        // Along both axes the jump lies inside of elements.
        let f = |x: f64, v: f64| f64::from(x.abs() < 0.5 && v > -0.31);
        for k in [[1, 1], [2, 3], [4, 2]] {
            let space = space(k);
            let values = projection(&space, f);
            let volume = |i| space.cell_volume() * space.relative_volume(&space.cell(i));
            let mass: f64 = values.iter().enumerate().map(|(i, f)| f * volume(i)).sum();
            assert!((mass - 1.21).abs() < 4e-3, "{k:?}: {mass}");
        }
    }
}
