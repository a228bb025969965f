//! Zeros of polynomial maps `Ψ: [0, 1]^n → R^n`, by subdivision in Bernstein coefficients.
//!
//! A polynomial lies between the least and the largest of its coefficients in the basis
//! `C(k, j) t^j (1 − t)^(k−j)`. A box on which a component has coefficients of one sign holds no
//! zero. A box on which `‖I − M ∂Ψ/∂t‖ ≤ ¼`, with the inverse `M` of the mean Jacobian, holds at
//! most one, to which `t ← t − M Ψ(t)` converges. Any other box is halved along every axis
//! (Mourrain and Pavone, J. Symb. Comput. 44, 2009). Multiple zeros are not found: no box about one
//! passes the second test.

use crate::matrix::observables::level_sets::{IDENTITY, Jacobian, determinant};
use crate::problem::grid::MAX_DIMENSION;

/// A point of the box; entries from the number of axes on are unused.
pub type BoxPoint = [f64; MAX_DIMENSION];

/// Largest number of halvings. In a box of width 2^−26 two zeros agree to half of the digits.
const DEEPEST: i32 = 26;
/// Largest number of boxes, so that the search ends if components have a zero surface in common.
const MOST_BOXES: usize = 4096;
/// `‖I − M ∂Ψ/∂t‖` on a box with at most one zero.
const CONTRACTION: f64 = 0.25;
/// Largest number of steps to a zero: `CONTRACTION^30` is below round-off.
const STEPS: usize = 30;
/// Tolerance of `M Ψ` at a zero, in widths of its box.
const RESIDUAL: f64 = 1e-12;
/// Zeros nearer to each other than this count as one, found by two boxes at their common face.
const SAME_ZERO: f64 = 1e-10;

/// The polynomials `C(k, j) t^j (1 − t)^(k−j)`, `j = 0 … k`.
pub fn basis(degree: usize, t: f64) -> Vec<f64> {
    let mut values = vec![1.0];
    for _ in 0..degree {
        let mut next = vec![0.0; values.len() + 1];
        for (j, value) in values.iter().enumerate() {
            next[j] += (1.0 - t) * value;
            next[j + 1] += t * value;
        }
        values = next;
    }
    values
}

/// Derivatives of the polynomials of [`basis`] at `t`.
pub fn basis_slopes(degree: usize, t: f64) -> Vec<f64> {
    let mut slopes = vec![0.0; degree + 1];
    if degree > 0 {
        for (j, value) in basis(degree - 1, t).into_iter().enumerate() {
            slopes[j] -= degree as f64 * value;
            slopes[j + 1] += degree as f64 * value;
        }
    }
    slopes
}

/// The value of a tensor product polynomial from its coefficients, the last axis fastest, and the
/// values of the basis along each axis.
pub fn evaluate(coefficients: &[f64], bases: &[Vec<f64>]) -> f64 {
    let Some((first, rest)) = bases.split_first() else {
        return coefficients[0];
    };
    let slices = coefficients.chunks_exact(coefficients.len() / first.len());
    first.iter().zip(slices).map(|(b, slice)| b * evaluate(slice, rest)).sum()
}

/// Whether all coefficients are above zero, or all below.
pub fn has_one_sign(coefficients: &[f64]) -> bool {
    coefficients.iter().all(|c| *c > 0.0) || coefficients.iter().all(|c| *c < 0.0)
}

/// A box of width `2^−halvings`, with the coefficients of each component on it.
struct BoxPart {
    lower: BoxPoint,
    halvings: i32,
    components: Vec<Vec<f64>>,
}

/// The zeros in the closed box, without multiple ones. `components` are coefficients, the last axis
/// fastest; `shape` is their number along each axis. There are as many axes as components.
pub fn zeros(components: Vec<Vec<f64>>, shape: &[usize]) -> Vec<BoxPoint> {
    let mut found: Vec<BoxPoint> = Vec::new();
    let mut open = vec![BoxPart { lower: [0.0; MAX_DIMENSION], halvings: 0, components }];
    let mut boxes = 0;
    while let Some(part) = open.pop() {
        boxes += 1;
        if boxes > MOST_BOXES {
            break;
        }
        if part.components.iter().any(|c| has_one_sign(c)) {
            continue;
        }
        if let Some(inverse) = contraction(&part.components, shape) {
            if let Some(local) = follow(&part.components, shape, &inverse) {
                let width = f64::powi(0.5, part.halvings);
                let zero: BoxPoint = std::array::from_fn(|b| part.lower[b] + width * local[b]);
                let apart = |other: &BoxPoint| {
                    (0..shape.len()).any(|b| (other[b] - zero[b]).abs() > SAME_ZERO)
                };
                if found.iter().all(apart) {
                    found.push(zero);
                }
            }
        } else if part.halvings < DEEPEST {
            open.extend(halves(part, shape));
        }
    }
    found
}

/// The inverse `M` of the mean Jacobian, if `‖I − M ∂Ψ/∂t‖_∞` is at most [`CONTRACTION`] on the
/// box; otherwise `None`.
fn contraction(components: &[Vec<f64>], shape: &[usize]) -> Option<Jacobian> {
    let n = shape.len();
    // [axis][component]: coefficients of the derivatives.
    let slopes: Vec<Vec<Vec<f64>>> =
        (0..n).map(|b| components.iter().map(|c| derivative(c, shape, b)).collect()).collect();
    let mut mean = IDENTITY;
    for (a, row) in mean.iter_mut().enumerate().take(n) {
        for (b, entry) in row.iter_mut().enumerate().take(n) {
            *entry = slopes[b][a].iter().sum::<f64>() / slopes[b][a].len().max(1) as f64;
        }
    }
    let inverse = inverse(&mean)?;
    let defect = |a: usize, b: usize| {
        let unit = f64::from(u8::from(a == b));
        let entry = |j: usize| -> f64 { (0..n).map(|c| inverse[a][c] * slopes[b][c][j]).sum() };
        (0..slopes[b][0].len()).map(|j| (entry(j) - unit).abs()).fold(0.0, f64::max)
    };
    let norm = |a: usize| -> f64 { (0..n).map(|b| defect(a, b)).sum() };
    (0..n).all(|a| norm(a) <= CONTRACTION).then_some(inverse)
}

/// `J⁻¹` by cofactors; none if it is not finite.
fn inverse(j: &Jacobian) -> Option<Jacobian> {
    let scale = 1.0 / determinant(j);
    let inverse: Jacobian = std::array::from_fn(|a| {
        std::array::from_fn(|b| {
            let (r, s) = ([(b + 1) % 3, (b + 2) % 3], [(a + 1) % 3, (a + 2) % 3]);
            scale * (j[r[0]][s[0]] * j[r[1]][s[1]] - j[r[0]][s[1]] * j[r[1]][s[0]])
        })
    });
    inverse.iter().flatten().all(|x| x.is_finite()).then_some(inverse)
}

/// The zero in the box, if there is one. Steps that leave the box are cut at its sides, which does
/// not increase the distance from a zero inside.
fn follow(components: &[Vec<f64>], shape: &[usize], inverse: &Jacobian) -> Option<BoxPoint> {
    let n = shape.len();
    let mut t = [0.5; MAX_DIMENSION];
    for _ in 0..STEPS {
        let bases: Vec<Vec<f64>> = (0..n).map(|b| basis(shape[b] - 1, t[b])).collect();
        let values: Vec<f64> = components.iter().map(|c| evaluate(c, &bases)).collect();
        let step = |a: usize| -> f64 { (0..n).map(|c| inverse[a][c] * values[c]).sum() };
        if (0..n).all(|a| step(a).abs() < RESIDUAL) {
            return Some(t);
        }
        for (a, t) in t.iter_mut().enumerate().take(n) {
            *t = (*t - step(a)).clamp(0.0, 1.0);
        }
    }
    None
}

/// Coefficients of the derivative along `axis`; empty for a constant.
fn derivative(coefficients: &[f64], shape: &[usize], axis: usize) -> Vec<f64> {
    let (count, stride) = (shape[axis], shape[axis + 1..].iter().product::<usize>());
    let slabs = coefficients.chunks_exact(count * stride);
    slabs
        .flat_map(|slab| {
            let next = slab[stride..].iter();
            next.zip(slab).map(move |(b, a)| (count - 1) as f64 * (b - a))
        })
        .collect()
}

/// The `2^n` halves of a box.
fn halves(part: BoxPart, shape: &[usize]) -> Vec<BoxPart> {
    let mut parts = vec![BoxPart { halvings: part.halvings + 1, ..part }];
    for axis in 0..shape.len() {
        parts = parts
            .into_iter()
            .flat_map(|part| {
                [false, true].map(|upper| {
                    let halves = part.components.iter().map(|c| half(c, shape, axis, upper));
                    let mut lower = part.lower;
                    lower[axis] += if upper { f64::powi(0.5, part.halvings) } else { 0.0 };
                    BoxPart { lower, halvings: part.halvings, components: halves.collect() }
                })
            })
            .collect();
    }
    parts
}

/// The coefficients on the lower or the upper half along `axis`, by de Casteljau's algorithm.
fn half(coefficients: &[f64], shape: &[usize], axis: usize, upper: bool) -> Vec<f64> {
    let (count, stride) = (shape[axis], shape[axis + 1..].iter().product::<usize>());
    let mut out = coefficients.to_vec();
    for slab in out.chunks_exact_mut(count * stride) {
        for s in 0..stride {
            for done in 1..count {
                // Means of neighbours; finished values stay at the side of the half.
                for j in 0..count - done {
                    let (to, from) =
                        if upper { (j, j + 1) } else { (count - 1 - j, count - 2 - j) };
                    let [to, from] = [to, from].map(|j| j * stride + s);
                    slab[to] = 0.5 * (slab[to] + slab[from]);
                }
            }
        }
    }
    out
}

#[cfg(test)]
mod tests;
