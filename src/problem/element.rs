//! Reference elements on `[−1, 1]`: nodes, quadrature weights, derivative, traces.
//!
//! An axis of degree `k` has `k + 1` nodes in each element: Gauss–Lobatto nodes on space axes,
//! whose end nodes are the traces, and Gauss–Legendre nodes on velocity axes, whose rule integrates
//! `v φ_i φ_j` exactly. Degree 0 has one node in the middle on both: a finite volume.
//!
//! The quadrature and the derivative `D` have the property of summation by parts,
//! `W D + (W D)ᵀ = r rᵀ − l lᵀ`, with the traces `l`, `r` at the two ends.

use crate::base::quadrature::{QuadraturePoint, gauss_legendre, gauss_lobatto};
use serde::{Deserialize, Serialize};
use std::sync::OnceLock;

/// Largest degree of the polynomials in an element.
pub const LARGEST_DEGREE: usize = 8;

/// The family of an element's nodes.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Hash, Serialize, Deserialize)]
pub enum NodeFamily {
    /// Gauss–Legendre: all nodes are inside of the element.
    #[default]
    Gauss,
    /// Gauss–Lobatto: both ends are nodes.
    Lobatto,
}

/// Gauss's rule by which functions are projected on an element has this many more points along each
/// axis than the element has nodes.
pub const MORE_POINTS: usize = 2;
/// Distance from the ends of an element, in widths, at which a projection samples them.
pub const AT_END: f64 = 1e-9;

/// The nodes of each element of an axis.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Hash, Serialize, Deserialize)]
pub struct Nodes {
    /// Degree `k` of the polynomials.
    pub degree: usize,
    /// Family of the `k + 1` nodes.
    pub family: NodeFamily,
}

impl Nodes {
    /// The nodes of a space axis of this degree.
    pub fn of_space(degree: usize) -> Self {
        match degree {
            0 => Self::default(),
            _ => Self { degree, family: NodeFamily::Lobatto },
        }
    }

    /// The nodes of a velocity axis of this degree.
    pub fn of_velocity(degree: usize) -> Self {
        Self { degree, family: NodeFamily::Gauss }
    }

    /// Number of nodes in an element, `k + 1`.
    pub fn count(&self) -> usize {
        self.degree + 1
    }

    /// The reference element.
    ///
    /// # Panics
    /// For a degree above [`LARGEST_DEGREE`].
    pub fn reference(&self) -> &'static ReferenceElement {
        static TABLE: OnceLock<Vec<[ReferenceElement; 2]>> = OnceLock::new();
        let table = TABLE.get_or_init(|| {
            let pair =
                |k| [NodeFamily::Gauss, NodeFamily::Lobatto].map(|f| ReferenceElement::new(f, k));
            (0..=LARGEST_DEGREE).map(pair).collect()
        });
        &table[self.degree][usize::from(self.family == NodeFamily::Lobatto)]
    }
}

/// Nodes of an element on `[−1, 1]`, with their weights and matrices.
#[derive(Clone, Debug)]
pub struct ReferenceElement {
    /// The `k + 1` nodes, ascending. Their bits are symmetric about 0.
    pub nodes: Vec<f64>,
    /// Quadrature weights, of sum 2.
    pub weights: Vec<f64>,
    /// `derivative[m][n] = ℓ_n'(ξ_m)` of the Lagrange polynomials `ℓ_n` at the nodes.
    pub derivative: Vec<Vec<f64>>,
    /// `ℓ_n(−1)`.
    pub left: Vec<f64>,
    /// `ℓ_n(1)`.
    pub right: Vec<f64>,
    barycentric: Vec<f64>,
}

impl ReferenceElement {
    fn new(family: NodeFamily, degree: usize) -> Self {
        let rule = match (degree, family) {
            (0, _) => vec![QuadraturePoint { node: 0.0, weight: 2.0 }],
            (_, NodeFamily::Gauss) => gauss_legendre(degree + 1),
            (_, NodeFamily::Lobatto) => gauss_lobatto(degree + 1),
        };
        let (nodes, weights): (Vec<f64>, Vec<f64>) =
            rule.iter().map(|p| (p.node, p.weight)).unzip();
        let barycentric = barycentric_weights(&nodes);
        let mut this = Self {
            derivative: differentiation(&nodes, &barycentric),
            left: Vec::new(),
            right: Vec::new(),
            nodes,
            weights,
            barycentric,
        };
        this.left = this.values_at(-1.0);
        this.right = this.values_at(1.0);
        this
    }

    /// The Lagrange polynomials `ℓ_n(ξ)`.
    pub fn values_at(&self, xi: f64) -> Vec<f64> {
        let mut values = vec![0.0; self.nodes.len()];
        self.values_into(xi, &mut values);
        values
    }

    /// The Lagrange polynomials `ℓ_n(ξ)` into `values`, by the barycentric formula.
    pub fn values_into(&self, xi: f64, values: &mut [f64]) {
        if let Some(n) = self.nodes.iter().position(|node| *node == xi) {
            values.fill(0.0);
            values[n] = 1.0;
            return;
        }
        let terms = self.nodes.iter().zip(&self.barycentric).map(|(node, b)| b / (xi - node));
        for (value, term) in values.iter_mut().zip(terms) {
            *value = term;
        }
        let sum: f64 = values.iter().sum();
        values.iter_mut().for_each(|value| *value /= sum);
    }

    /// The value at `ξ` of the polynomial that has the values `f` at the nodes.
    pub fn interpolate(&self, f: &[f64], xi: f64) -> f64 {
        self.values_at(xi).iter().zip(f).map(|(l, f)| l * f).sum()
    }
}

fn barycentric_weights(nodes: &[f64]) -> Vec<f64> {
    let others = |n: usize| (0..nodes.len()).filter(move |m| *m != n);
    (0..nodes.len())
        .map(|n| 1.0 / others(n).map(|m| nodes[n] - nodes[m]).product::<f64>())
        .collect()
}

/// `ℓ_n'(ξ_m)`. The diagonal is minus the sum of the other entries, so that constants have
/// derivative zero.
fn differentiation(nodes: &[f64], barycentric: &[f64]) -> Vec<Vec<f64>> {
    let count = nodes.len();
    (0..count)
        .map(|m| {
            let mut row: Vec<f64> = (0..count)
                .map(|n| {
                    if m == n {
                        0.0
                    } else {
                        barycentric[n] / barycentric[m] / (nodes[m] - nodes[n])
                    }
                })
                .collect();
            row[m] = -row.iter().sum::<f64>();
            row
        })
        .collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    fn all() -> impl Iterator<Item = Nodes> {
        let families = [NodeFamily::Gauss, NodeFamily::Lobatto];
        (0..=LARGEST_DEGREE).flat_map(move |degree| families.map(|family| Nodes { degree, family }))
    }

    #[test]
    fn rules_integrate_polynomials_exactly() {
        for nodes in all() {
            let element = nodes.reference();
            let degree = match nodes.family {
                NodeFamily::Gauss => 2 * nodes.degree + 1,
                NodeFamily::Lobatto => (2 * nodes.degree).max(2) - 1,
            };
            for power in 0..=degree {
                let rule = element.nodes.iter().zip(&element.weights);
                let found: f64 = rule.map(|(x, w)| w * x.powi(power as i32)).sum();
                let exact = if power % 2 == 0 { 2.0 / (power + 1) as f64 } else { 0.0 };
                assert!((found - exact).abs() < 1e-14, "{nodes:?} {power}: {found} {exact}");
            }
        }
    }

    #[test]
    fn derivatives_sum_by_parts() {
        for nodes in all() {
            let e = nodes.reference();
            for m in 0..nodes.count() {
                assert!(e.derivative[m].iter().sum::<f64>().abs() < 1e-14);
                for n in 0..nodes.count() {
                    let both =
                        e.weights[m] * e.derivative[m][n] + e.weights[n] * e.derivative[n][m];
                    let ends = e.right[m] * e.right[n] - e.left[m] * e.left[n];
                    assert!((both - ends).abs() < 3e-13, "{nodes:?} {m} {n}: {both} {ends}");
                }
            }
        }
    }

    #[test]
    fn polynomials_are_interpolated_and_differentiated() {
        for nodes in all() {
            let e = nodes.reference();
            let p = |x: f64| (0..=nodes.degree).fold(0.0, |s, j| s * x + 1.0 + j as f64);
            let values: Vec<f64> = e.nodes.iter().map(|x| p(*x)).collect();
            for x in [-1.0, -0.37, 0.0, 0.8, 1.0] {
                assert!((e.interpolate(&values, x) - p(x)).abs() < 1e-12, "{nodes:?} {x}");
            }
            for m in 0..nodes.count() {
                let h = 1e-6;
                let slope: f64 = e.derivative[m].iter().zip(&values).map(|(d, f)| d * f).sum();
                let about = (p(e.nodes[m] + h) - p(e.nodes[m] - h)) / (2.0 * h);
                assert!((slope - about).abs() < 1e-5 * (1.0 + about.abs()), "{nodes:?} {m}");
            }
        }
    }
}
