//! The `L2` projection of a function onto the polynomials of an element, by Gauss's rule.
//!
//! An element in which the function jumps is repeatedly cut into halves along every axis, where it
//! jumps. The rules on the parts, and the matrices from their points to the nodes, depend only on
//! the degree: they are made once for all elements.

use crate::base::quadrature::{QuadraturePoint, gauss_legendre, legendre_values};
use crate::matrix::elements::{Element, apply_along_all};
use crate::problem::element::{AT_END, MORE_POINTS, NodeFamily, Nodes};
use crate::problem::grid::{MAX_DIMENSION, PhaseSpace};

/// A part whose highest Legendre coefficients are above this fraction of the largest value on the
/// grid is cut.
const ROUGH: f64 = 1e-2;
/// A part is cut, too, if its polynomial misses the function at an end by this fraction of the
/// largest value.
const MISSED: f64 = 5e-2;

/// A matrix by rows.
type Matrix = Vec<Vec<f64>>;

/// Projects functions onto the elements of a grid.
pub struct Projection {
    /// The rules along each axis of phase space.
    axes: Vec<AxisRules>,
    /// Largest number of successive cuts of an element.
    cuts: usize,
    /// Largest value of the function on the grid.
    largest: f64,
}

/// The rules of an axis.
struct AxisRules {
    /// The rule on each part, by halvings and number.
    parts: Vec<Vec<PartRule>>,
    /// Maps values at the points of a rule to the two highest Legendre coefficients.
    highest: Matrix,
    /// Maps values at the nodes to the two highest Legendre coefficients.
    highest_of_nodes: Matrix,
    /// Maps values at the points of a rule to those just inside the two ends of its part.
    to_ends: Matrix,
}

/// Gauss's rule on a part of the reference element.
struct PartRule {
    points: Vec<f64>,
    /// Points just inside the ends of the part.
    ends: Vec<f64>,
    /// Maps values at the quadrature points to their contributions to the projection at the nodes.
    projector: Matrix,
}

/// Part number `index` of `2^halvings` equal parts of an axis of the reference element.
#[derive(Clone, Copy)]
struct IntervalPart {
    halvings: usize,
    index: usize,
}

impl IntervalPart {
    const WHOLE: Self = Self { halvings: 0, index: 0 };

    fn ends(self) -> [f64; 2] {
        let width = 2.0 / (1 << self.halvings) as f64;
        [-1.0 + width * self.index as f64, -1.0 + width * (self.index + 1) as f64]
    }

    fn half(self, upper: bool) -> Self {
        Self { halvings: self.halvings + 1, index: 2 * self.index + usize::from(upper) }
    }
}

impl Projection {
    /// The projection onto the elements of `space`, cut at most `cuts` times, for a function with
    /// the largest value `largest`.
    pub fn new(space: &PhaseSpace, cuts: usize, largest: f64) -> Self {
        let axes = space.x.iter().chain(&space.v);
        Self { axes: axes.map(|a| AxisRules::new(a.nodes, cuts)).collect(), cuts, largest }
    }

    /// Whether nodal values indicate a jump of the function.
    pub fn is_rough(&self, nodal: &[f64]) -> bool {
        self.any_rough(nodal, |axis| &axis.highest_of_nodes)
    }

    /// The projection onto `element` of the function with `values_at(points)`, as values at the
    /// nodes.
    pub fn onto(
        &self,
        element: &Element<'_>,
        values_at: &mut impl FnMut(&[[f64; 6]]) -> Vec<f64>,
    ) -> Vec<f64> {
        let axes = self.axes.len();
        let mut sum = vec![0.0; element.shape().iter().product()];
        let mut open = vec![[IntervalPart::WHOLE; 2 * MAX_DIMENSION]];
        while let Some(parts) = open.pop() {
            let rules: Vec<&PartRule> = self.rules(&parts).collect();
            let points: Vec<&[f64]> = rules.iter().map(|rule| &rule.points[..]).collect();
            let values = values_at(&element.points(&points));
            let is_cut = parts[0].halvings < self.cuts
                && (self.any_rough(&values, |axis| &axis.highest)
                    || self.jumps_at_an_end(element, &rules, &values, values_at));
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
            let added = apply_along_all(&values, rules.iter().map(|rule| &rule.projector));
            sum.iter_mut().zip(added).for_each(|(sum, value)| *sum += value);
        }
        sum
    }

    /// The rules on `parts` of the axes.
    fn rules(&self, parts: &[IntervalPart]) -> impl Iterator<Item = &PartRule> {
        self.axes.iter().zip(parts).map(|(axis, part)| &axis.parts[part.halvings][part.index])
    }

    /// Whether the polynomial through `values` has, along an axis, one of its highest Legendre
    /// coefficients, by `matrix`, above [`ROUGH`] times the largest value.
    fn any_rough(&self, values: &[f64], matrix: impl Fn(&AxisRules) -> &Matrix) -> bool {
        let mut stride = 1;
        for axis in self.axes.iter().rev() {
            let rows = matrix(axis);
            // One point along the axis has no coefficient.
            let count = rows.first().map_or(1, Vec::len);
            let is_rough = |at: usize, row: &Vec<f64>| {
                let line = row.iter().enumerate().map(|(q, c)| c * values[at + q * stride]);
                line.sum::<f64>().abs() > ROUGH * self.largest
            };
            let mut starts = (0..values.len()).filter(|at| (at / stride).is_multiple_of(count));
            if starts.any(|at| rows.iter().any(|row| is_rough(at, row))) {
                return true;
            }
            stride *= count;
        }
        false
    }

    /// Whether the polynomial through `values` misses the function at an end of the parts of
    /// `rules`: there is then a jump beyond the outermost points. Only in one space dimension; in
    /// more there are too many ends.
    fn jumps_at_an_end(
        &self,
        element: &Element<'_>,
        rules: &[&PartRule],
        values: &[f64],
        values_at: &mut impl FnMut(&[[f64; 6]]) -> Vec<f64>,
    ) -> bool {
        let [x, v] = &self.axes[..] else { return false };
        let along_v = rules[1].points.len();
        let tolerance = MISSED * self.largest;
        let mut misses = |points: [&[f64]; 2], extrapolated: &dyn Fn(usize) -> f64| {
            let found = values_at(&element.points(&points));
            found.iter().enumerate().any(|(i, f)| (f - extrapolated(i)).abs() > tolerance)
        };
        let sum = |row: &[f64], at: usize, stride: usize| -> f64 {
            row.iter().enumerate().map(|(q, c)| c * values[at + q * stride]).sum()
        };
        misses([&rules[0].ends, &rules[1].points], &|i| {
            sum(&x.to_ends[i / along_v], i % along_v, along_v)
        }) || misses([&rules[0].points, &rules[1].ends], &|i| {
            sum(&v.to_ends[i % 2], i / 2 * along_v, 1)
        })
    }
}

impl AxisRules {
    fn new(nodes: Nodes, cuts: usize) -> Self {
        let rule = gauss_legendre(nodes.count() + MORE_POINTS);
        let points: Vec<f64> = rule.iter().map(|p| p.node).collect();
        let parts_after = |halvings: usize| -> Vec<PartRule> {
            (0..1 << halvings)
                .map(|index| PartRule::new(nodes, &rule, IntervalPart { halvings, index }))
                .collect()
        };
        let ends = [-1.0 + 2.0 * AT_END, 1.0 - 2.0 * AT_END];
        Self {
            parts: (0..=cuts).map(parts_after).collect(),
            highest: highest_coefficients(&points),
            highest_of_nodes: match nodes.degree {
                0 => Vec::new(),
                _ => highest_coefficients(&nodes.reference().nodes),
            },
            to_ends: ends.iter().map(|x| lagrange_values(&points, *x)).collect(),
        }
    }
}

impl PartRule {
    fn new(nodes: Nodes, rule: &[QuadraturePoint], part: IntervalPart) -> Self {
        let [lower, upper] = part.ends();
        let rule: Vec<_> = rule.iter().map(|point| point.moved_to([lower, upper])).collect();
        let inside = AT_END * (upper - lower);
        Self {
            points: rule.iter().map(|p| p.node).collect(),
            ends: vec![lower + inside, upper - inside],
            projector: projector(nodes, &rule),
        }
    }
}

/// `[m][q]`: the factor of the value at point `q` of a rule in the projection's value at node `m`,
/// `Σ_n (M⁻¹)_mn ℓ_n(ξ_q) w_q`, with the exact mass matrix `M_mn = ∫ ℓ_m ℓ_n`.
///
/// With the orthogonal Legendre polynomials this is `Σ_j (2j + 1)/2 P_j(ξ_m) P_j(ξ_q) w_q`.
fn projector(nodes: Nodes, rule: &[QuadraturePoint]) -> Matrix {
    let at_rule: Matrix = rule.iter().map(|p| legendre_values(nodes.degree, p.node)).collect();
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

/// `[j][m]`: the factor of the value at node `m` in the coefficient of the Legendre polynomial
/// `P_j` of the polynomial through all nodes, `w_m P_j(ξ_m)/γ_j`. The discrete norms are
/// `γ_j = 2/(2j + 1)`, and `2/k` for `P_k` at Gauss–Lobatto nodes.
pub fn legendre_transform(nodes: Nodes) -> Matrix {
    let (k, reference) = (nodes.degree, nodes.reference());
    (0..=k)
        .map(|j| {
            let lobatto = j == k && k > 0 && nodes.family == NodeFamily::Lobatto;
            let norm = if lobatto { 2.0 / k as f64 } else { 2.0 / (2 * j + 1) as f64 };
            let rule = reference.nodes.iter().zip(&reference.weights);
            rule.map(|(xi, w)| w * legendre_values(k, *xi)[j] / norm).collect()
        })
        .collect()
}

/// The Lagrange polynomials of `points` at `x`.
fn lagrange_values(points: &[f64], x: f64) -> Vec<f64> {
    let others = |q: usize| (0..points.len()).filter(move |o| *o != q);
    let value = |q: usize| -> f64 {
        others(q).map(|o| (x - points[o]) / (points[q] - points[o])).product()
    };
    (0..points.len()).map(value).collect()
}

/// `[j][q]`: the factor of the value at point `q` in each of the two highest Legendre coefficients
/// of the polynomial through all points; with two points only the highest.
fn highest_coefficients(points: &[f64]) -> Matrix {
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

#[cfg(test)]
mod tests {
    use super::*;
    use crate::matrix::elements::for_each_element;
    use crate::problem::grid::Axis;

    fn space(k: [usize; 2]) -> PhaseSpace {
        PhaseSpace {
            x: vec![Axis::new(-1.0, 1.0, 3).with_nodes(Nodes::of_space(k[0]))],
            v: vec![Axis::new(-1.5, 0.9, 5).with_nodes(Nodes::of_velocity(k[1]))],
            periodic: [false; MAX_DIMENSION],
        }
    }

    fn projection(space: &PhaseSpace, f: impl Fn(f64, f64) -> f64) -> Vec<f64> {
        let ranges = space.space_ranges();
        let mut values = vec![0.0; space.cells()];
        let projection = Projection::new(space, 6, 1.0);
        for_each_element(space, &ranges, |element| {
            let found = projection.onto(element, &mut |points: &[[f64; 6]]| {
                points.iter().map(|p| f(p[0], p[3])).collect()
            });
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

    /// The coefficients of a Legendre polynomial at the nodes are those of itself alone.
    #[test]
    fn legendre_polynomials_have_one_coefficient() {
        for k in 1..=8 {
            for nodes in [Nodes::of_space(k), Nodes::of_velocity(k)] {
                for (i, row) in legendre_transform(nodes).iter().enumerate() {
                    for j in 0..=k {
                        let values =
                            nodes.reference().nodes.iter().map(|x| legendre_values(k, *x)[j]);
                        let found: f64 = row.iter().zip(values).map(|(c, value)| c * value).sum();
                        let expected = f64::from(u8::from(i == j));
                        assert!((found - expected).abs() < 1e-12, "{nodes:?}, {i}, {j}: {found}");
                    }
                }
            }
        }
    }

    #[test]
    fn mass_of_what_jumps_is_kept() {
        // The jump lies inside elements along both axes.
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
