//! Gauss's rules on `[−1, 1]`, by Newton's method on Legendre polynomials.

use std::f64::consts::PI;

/// A node of a rule, and its weight.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct QuadraturePoint {
    /// The point at which the integrand is evaluated.
    pub node: f64,
    /// What its value is multiplied by.
    pub weight: f64,
}

impl QuadraturePoint {
    /// The point of the rule on `[lower, upper]` instead of `[−1, 1]`.
    pub fn moved_to(self, [lower, upper]: [f64; 2]) -> Self {
        let (middle, half) = (0.5 * (lower + upper), 0.5 * (upper - lower));
        Self { node: middle + half * self.node, weight: half * self.weight }
    }
}

/// The Gauss–Legendre rule of `count` points, ascending: exact for polynomials of degree
/// `2 count − 1`. Nodes and weights are mirror images exactly.
pub fn gauss_legendre(count: usize) -> Vec<QuadraturePoint> {
    let n = count as f64;
    let point = |k: usize| {
        let start = (PI * (k as f64 - 0.25) / (n + 0.5)).cos();
        let node = newton(start, |x| {
            let [value, slope] = legendre(count, x);
            value / slope
        });
        let [_, slope] = legendre(count, node);
        QuadraturePoint { node, weight: 2.0 / ((1.0 - node * node) * slope * slope) }
    };
    symmetric((1..=count).rev().map(point).collect())
}

/// The Gauss–Lobatto rule of `count ≥ 2` points, ascending: the ends, and the zeros of
/// `P'_{count−1}`; exact for polynomials of degree `2 count − 3`. Nodes and weights are mirror
/// images exactly.
pub fn gauss_lobatto(count: usize) -> Vec<QuadraturePoint> {
    let k = count - 1;
    let factor = (k * (k + 1)) as f64;
    let inner = |j: usize| {
        newton((PI * j as f64 / k as f64).cos(), |x| {
            // (1 − x²) P'' = 2x P' − k(k+1) P.
            let [value, slope] = legendre(k, x);
            let bend = (2.0 * x * slope - factor * value) / (1.0 - x * x);
            slope / bend
        })
    };
    let end = |node| QuadraturePoint { node, weight: 2.0 / factor };
    let inside = (1..k).rev().map(inner).map(|node| {
        let [value, _] = legendre(k, node);
        QuadraturePoint { node, weight: 2.0 / (factor * value * value) }
    });
    symmetric(std::iter::once(end(-1.0)).chain(inside).chain([end(1.0)]).collect())
}

/// A zero of the function whose Newton correction is `correction`.
fn newton(start: f64, correction: impl Fn(f64) -> f64) -> f64 {
    let mut x = start;
    for _ in 0..100 {
        let change = correction(x);
        x -= change;
        if change.abs() < 1e-16 {
            break;
        }
    }
    x
}

/// The Legendre polynomials `P_0(x), …, P_n(x)`, by their three-term recurrence.
pub fn legendre_values(n: usize, x: f64) -> Vec<f64> {
    let mut values = vec![1.0, x];
    for j in 1..n {
        let k = j as f64;
        values.push(((2.0 * k + 1.0) * x * values[j] - k * values[j - 1]) / (k + 1.0));
    }
    values.truncate(n + 1);
    values
}

/// `P_n(x)` and `P_n'(x)`, `n ≥ 1`, `|x| < 1`.
fn legendre(n: usize, x: f64) -> [f64; 2] {
    let values = legendre_values(n, x);
    [values[n], n as f64 * (x * values[n] - values[n - 1]) / (x * x - 1.0)]
}

/// The mean of the nodes found from both ends.
fn symmetric(rule: Vec<QuadraturePoint>) -> Vec<QuadraturePoint> {
    let mean = |(a, b): (&QuadraturePoint, &QuadraturePoint)| QuadraturePoint {
        node: 0.5 * (a.node - b.node),
        weight: 0.5 * (a.weight + b.weight),
    };
    rule.iter().zip(rule.iter().rev()).map(mean).collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Largest error of the integrals of `x^p`, `p ≤ degree`.
    fn error(rule: &[QuadraturePoint], degree: usize) -> f64 {
        let error = |p: usize| {
            let found: f64 = rule.iter().map(|q| q.weight * q.node.powi(p as i32)).sum();
            let exact = if p.is_multiple_of(2) { 2.0 / (p + 1) as f64 } else { 0.0 };
            (found - exact).abs()
        };
        (0..=degree).map(error).fold(0.0, f64::max)
    }

    #[test]
    fn rules_are_exact_up_to_their_degree_and_not_beyond() {
        for count in [1, 2, 3, 5, 8, 16, 64] {
            let rule = gauss_legendre(count);
            assert!(error(&rule, 2 * count - 1) < 1e-14, "{count}");
            assert!(count > 8 || error(&rule, 2 * count) > 1e-6, "{count}");
        }
        for count in [2, 3, 5, 9, 16] {
            let rule = gauss_lobatto(count);
            assert!(error(&rule, 2 * count - 3) < 1e-14, "{count}");
            assert!(count > 5 || error(&rule, 2 * count - 2) > 1e-6, "{count}");
        }
    }

    #[test]
    fn a_rule_moves_to_another_interval() {
        let rule = gauss_legendre(4).into_iter().map(|p| p.moved_to([2.0, 5.0]));
        let found: f64 = rule.map(|p| p.weight * p.node * p.node).sum();
        assert!((found - 39.0).abs() < 1e-13, "{found}");
    }
}
