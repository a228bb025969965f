//! Guaranteed spectral bounds of lines of elements.
//!
//! For one axis, speed 1 and weighted unknowns `D A D⁻¹`, an element has the skew matrix `Q̂`, from
//! `−½(Q − Qᵀ)`, and the traces `l̂`, `r̂` in its two ends. A face adds to the quadratic form of
//! `H = μS + iK`, for the traces `t_o` before it and `t_i` behind it,
//!
//! ```text
//! −½αμ (|t_o|² + |t_i|²) + 2 Re(c t_i* B t_o),      |c| = ½√(α²μ² + 1),   ‖B‖ ≤ 1
//! ```
//!
//! where `B` is the identity or the coupling at a jump. With `2|t_i||t_o| ≤ |t_i|² + |t_o|²` each
//! element is bounded by itself:
//!
//! ```text
//! λ_min(iQ̂ − (½αμ + |c|) P)  ≤  H  ≤  λ_max(iQ̂ − (½αμ − |c|) P),      P = l̂ l̂ᵀ + r̂ r̂ᵀ
//! ```
//!
//! which the Bloch waves of the periodic line attain. Ends of the box have `−½μ |t|²` instead. A
//! speed that differs from line to line scales traces and elements alike, so the fastest line
//! bounds all; axes add. Both bounds are convex in `μ` (the lower one concave), so that linear
//! interpolation between tabulated `μ` stays on the safe side.
//!
//! For degree 0 this is `−(μ + √(1 + μ²))` and `√(1 + μ²) − μ` times `s/h`.

use crate::problem::element::Nodes;
use faer::{Mat, c64};
use std::sync::Arc;

/// Wavenumbers of the table: geometric, this many a factor of 10.
const PER_DECADE: f64 = 24.0;
/// Decades of the table: from the first of these powers to the second.
const DECADES: [i32; 2] = [-3, 5];

/// What the bounds of a line depend on.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct LineKind {
    /// Nodes of an element.
    pub nodes: Nodes,
    /// `α` of the flux.
    pub flux: f64,
    /// Whether the line has ends; a periodic one has none, unless `V` jumps on it.
    pub ends: bool,
    /// Whether there are jumps with partial reflection on it, where the flux is upwind.
    pub reflects: bool,
}

/// Bounds of a line of speed 1 and element width 1, by `μ ≥ 0`.
#[derive(Debug, PartialEq)]
struct Table {
    /// `(μ, lower, upper)`, ascending.
    rows: Vec<[f64; 3]>,
    /// Bound on `−S`.
    dissipation: f64,
    /// Bound on `‖K‖`.
    skew: f64,
}

/// Bounds of the lines along an axis.
#[derive(Clone, Debug, PartialEq)]
pub struct LineBounds {
    /// Largest `s/h`.
    rate: f64,
    table: Arc<Table>,
}

/// The matrix of an element: `iQ̂` and its traces.
struct Element {
    skew: Vec<Vec<f64>>,
    left: Vec<f64>,
    right: Vec<f64>,
}

impl Element {
    fn new(nodes: Nodes) -> Self {
        let e = nodes.reference();
        // Weighted unknowns √(w/2) f: of width 1, `w/2` is the quadrature weight.
        let root = |m: usize| (0.5 * e.weights[m]).sqrt();
        let count = nodes.count();
        let q = |m: usize, n: usize| 0.5 * e.weights[m] * 2.0 * e.derivative[m][n];
        let skew = |m: usize, n: usize| -0.5 * (q(m, n) - q(n, m)) / (root(m) * root(n));
        let trace = |values: &[f64]| (0..count).map(|m| values[m] / root(m)).collect();
        Self {
            skew: (0..count).map(|m| (0..count).map(|n| skew(m, n)).collect()).collect(),
            left: trace(&e.left),
            right: trace(&e.right),
        }
    }

    /// Least and largest eigenvalue of `i · with_skew · Q̂ − a l̂l̂ᵀ − b r̂r̂ᵀ`.
    fn extremes(&self, with_skew: bool, a: f64, b: f64) -> [f64; 2] {
        let count = self.left.len();
        let (l, r) = (&self.left, &self.right);
        let matrix = Mat::from_fn(count, count, |m, n| {
            let skew = if with_skew { self.skew[m][n] } else { 0.0 };
            c64::new(-a * l[m] * l[n] - b * r[m] * r[n], skew)
        });
        match matrix.self_adjoint_eigenvalues(faer::Side::Lower) {
            Ok(values) => [values[0], values[count - 1]],
            // Never seen of a finite matrix; the Frobenius norm bounds all eigenvalues.
            Err(_) => [-matrix.norm_l2(), matrix.norm_l2()],
        }
    }
}

impl LineKind {
    /// What the two faces of an element may add: between elements, or at an end of the box or a
    /// jump with partial reflection.
    fn pairs(&self, inside: f64, end: f64) -> Vec<[f64; 2]> {
        match self.ends || self.reflects {
            true => vec![[inside, inside], [end, inside], [inside, end], [end, end]],
            false => vec![[inside, inside]],
        }
    }

    /// An upwind face, where there may be one, has more of both than an end.
    fn end_or_upwind(&self, end: f64, upwind: f64) -> f64 {
        if self.reflects { upwind } else { end }
    }

    /// The least eigenvalue of an element, and zero.
    fn lowest(&self, element: &Element, with_skew: bool, inside: f64, end: f64) -> f64 {
        let values = self.pairs(inside, end).into_iter();
        values.map(|[a, b]| element.extremes(with_skew, a, b)[0]).fold(0.0, f64::min)
    }

    /// Bound on the spectrum of `−S` of a line of speed 1 and element width 1.
    pub fn dissipation(&self) -> f64 {
        let element = Element::new(self.nodes);
        -self.lowest(&element, false, self.flux, self.end_or_upwind(0.5, 1.0))
    }
}

impl Table {
    fn new(kind: &LineKind) -> Self {
        let element = Element::new(kind.nodes);
        let pairs = |inside, end| kind.pairs(inside, end);
        let end_or_upwind = |end, upwind| kind.end_or_upwind(end, upwind);
        let lowest = |with_skew, inside, end| kind.lowest(&element, with_skew, inside, end);
        let bounds = |mu: f64| {
            let (half, root) = (0.5 * kind.flux * mu, 0.5 * (kind.flux * mu).hypot(1.0));
            // Inside |c| is at least 0, at an end there is none: the same table holds both.
            let upper = pairs(half - root, 0.5 * mu).into_iter();
            let upper = upper.map(|[a, b]| element.extremes(true, a, b)[1]).fold(0.0, f64::max);
            let end = end_or_upwind(0.5 * mu, 0.5 * mu + 0.5 * mu.hypot(1.0));
            [mu, lowest(true, half + root, end), upper]
        };
        let steps = PER_DECADE * f64::from(DECADES[1] - DECADES[0]);
        let grid = (0..=steps as i32)
            .map(|k| 10f64.powf(f64::from(DECADES[0]) + f64::from(k) / PER_DECADE));
        let rows: Vec<[f64; 3]> = std::iter::once(0.0).chain(grid).map(bounds).collect();
        let skew = f64::max(-rows[0][1], rows[0][2]);
        Self { rows, dissipation: kind.dissipation(), skew }
    }

    /// `[lower, upper]` at `mu ≥ 0`.
    fn at(&self, mu: f64) -> [f64; 2] {
        let after = self.rows.partition_point(|row| row[0] <= mu);
        let before = self.rows[after.saturating_sub(1)];
        let Some(next) = self.rows.get(after) else {
            // S is at most zero and at least −dissipation.
            return [before[1] - (mu - before[0]) * self.dissipation, before[2]];
        };
        let part = (mu - before[0]) / (next[0] - before[0]);
        [1, 2].map(|k| before[k] + part * (next[k] - before[k]))
    }
}

impl LineBounds {
    /// Bounds of lines of which the fastest goes through `rate` elements a unit of time.
    pub fn new(kind: &LineKind, rate: f64) -> Self {
        Self { rate, table: Arc::new(Table::new(kind)) }
    }

    /// `[lower, upper]` of the spectrum of `μS + iK`, `mu ≥ 0`.
    pub fn interval(&self, mu: f64) -> [f64; 2] {
        self.table.at(mu).map(|bound| self.rate * bound)
    }

    /// Bound on the spectrum of `−S`.
    pub fn dissipation(&self) -> f64 {
        self.rate * self.table.dissipation
    }

    /// Bound on `‖A‖`.
    pub fn norm(&self) -> f64 {
        self.rate * (self.table.dissipation + self.table.skew)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn kind(nodes: Nodes, flux: f64, ends: bool) -> LineKind {
        LineKind { nodes, flux, ends, reflects: false }
    }

    #[test]
    fn degree_0_has_the_bounds_of_the_upwind_scheme() {
        let bounds = LineBounds::new(&kind(Nodes::default(), 1.0, true), 3.0);
        for mu in [0.0f64, 0.01, 0.7, 12.0, 3000.0] {
            let root = mu.hypot(1.0);
            let [lower, upper] = bounds.interval(mu);
            assert!((lower + 3.0 * (mu + root)).abs() < 1e-3 * root, "{mu}: {lower}");
            assert!(lower <= -3.0 * (mu + root) * (1.0 - 1e-14));
            assert!((upper - 3.0 * (root - mu)).abs() < 1e-2, "{mu}: {upper}");
        }
        assert!((bounds.dissipation() - 6.0).abs() < 1e-13);
    }

    #[test]
    fn norms_are_the_known_ones() {
        // Symbols of the periodic line, as high-order prototypes measured them.
        let lobatto = [2.0, 5.1, 9.1, 14.3];
        let gauss = [4.0, 8.1, 13.3, 19.7];
        for k in 1..=4 {
            for flux in [0.2, 0.5, 1.0] {
                let (n, table) = (k as f64, |nodes| Table::new(&kind(nodes, flux, false)));
                let found = table(Nodes::of_space(k));
                assert!((found.dissipation - flux * n * (n + 1.0)).abs() < 1e-12);
                assert!((found.skew - lobatto[k - 1]).abs() < 0.06, "{k}: {}", found.skew);
                let found = table(Nodes::of_velocity(k));
                assert!((found.dissipation - flux * (n + 1.0) * (n + 2.0)).abs() < 1e-12);
                assert!((found.skew - gauss[k - 1]).abs() < 0.06, "{k}: {}", found.skew);
            }
        }
    }
}
