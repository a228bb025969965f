//! Polynomials with known zeros: simple and multiple ones, at the ends and at points where boxes
//! are halved, and without zeros.

use super::*;

/// Bernstein coefficients of the product of the factors `t − root`, scaled by `factor`.
fn with_roots(roots: &[f64], factor: f64) -> Vec<f64> {
    let mut coefficients = vec![factor];
    for root in roots {
        let k = coefficients.len();
        let mut next = vec![0.0; k + 1];
        for (j, c) in coefficients.iter().enumerate() {
            next[j] -= (k - j) as f64 / k as f64 * root * c;
            next[j + 1] += (j + 1) as f64 / k as f64 * (1.0 - root) * c;
        }
        coefficients = next;
    }
    coefficients
}

fn zeros_of_roots(roots: &[f64], factor: f64) -> Vec<f64> {
    let coefficients = with_roots(roots, factor);
    let shape = [coefficients.len()];
    let mut found: Vec<f64> = zeros(vec![coefficients], &shape).iter().map(|z| z[0]).collect();
    found.sort_by(f64::total_cmp);
    found
}

#[test]
fn known_zeros_are_found_once_and_no_others() {
    let lists: &[(&[f64], &[f64])] = &[
        (&[0.3], &[0.3]),
        (&[-0.2], &[]),
        (&[1.0001], &[]),
        // Both ends, and points at which boxes are halved.
        (&[0.0, 1.0], &[0.0, 1.0]),
        (&[0.25, 0.5, 0.75], &[0.25, 0.5, 0.75]),
        (&[0.1, 0.5, 1.7, -3.0], &[0.1, 0.5]),
        (&[0.4, 0.40001], &[0.4, 0.40001]),
        (
            &[0.05, 0.15, 0.33, 0.48, 0.61, 0.77, 0.86, 0.99],
            &[0.05, 0.15, 0.33, 0.48, 0.61, 0.77, 0.86, 0.99],
        ),
    ];
    for (roots, inside) in lists {
        for factor in [1.0, -3.0, 1e-9, 1e12] {
            let found = zeros_of_roots(roots, factor);
            assert_eq!(found.len(), inside.len(), "{roots:?} {factor}: {found:?}");
            for (found, exact) in found.iter().zip(*inside) {
                assert!((found - exact).abs() < 1e-9, "{roots:?}: {found} {exact}");
            }
        }
    }
}

/// A double zero is not found. A simple one next to it is, and so are both zeros if the polynomial
/// is shifted slightly down.
#[test]
fn double_zeros_are_no_zeros() {
    assert!(zeros_of_roots(&[0.3, 0.3], 1.0).is_empty());
    let beside = zeros_of_roots(&[0.3, 0.3, 0.8], 1.0);
    assert!(beside.len() == 1 && (beside[0] - 0.8).abs() < 1e-12, "{beside:?}");
    let mut lowered = with_roots(&[0.3, 0.3], 1.0);
    lowered.iter_mut().for_each(|c| *c -= 1e-10);
    let pair = zeros(vec![lowered], &[3]);
    assert_eq!(pair.len(), 2, "{pair:?}");
    assert!(((pair[0][0] - pair[1][0]).abs() - 2e-5).abs() < 1e-9, "{pair:?}");
    assert!(zeros(vec![vec![0.0; 3]], &[3]).is_empty());
    assert!(zeros(vec![vec![1.0]], &[1]).is_empty());
}

/// A function of a point.
type Function<'a> = &'a dyn Fn(&[f64]) -> f64;

/// Coefficients of `f`, a polynomial of the degrees `shape − 1`, by interpolation at equidistant
/// points; the last axis is the fastest.
fn coefficients(shape: &[usize], f: Function<'_>) -> Vec<f64> {
    let cells: usize = shape.iter().product();
    let point = |mut i: usize| -> Vec<f64> {
        let mut t = vec![0.0; shape.len()];
        for (b, count) in shape.iter().enumerate().rev() {
            t[b] = (i % count) as f64 / (count - 1) as f64;
            i /= count;
        }
        t
    };
    // Richardson's iteration c ← c + f − (Bernstein operator of c), which converges.
    let mut c: Vec<f64> = (0..cells).map(|i| f(&point(i))).collect();
    for _ in 0..4000 {
        let residuals: Vec<f64> = (0..cells)
            .map(|i| {
                let t = point(i);
                let bases: Vec<Vec<f64>> =
                    t.iter().zip(shape).map(|(t, count)| basis(count - 1, *t)).collect();
                f(&t) - evaluate(&c, &bases)
            })
            .collect();
        c.iter_mut().zip(residuals).for_each(|(c, r)| *c += r);
    }
    c
}

#[test]
fn zeros_of_two_and_three_polynomials() {
    // A circle and a line: two zeros; a line that misses it: none.
    let shape = [3, 3];
    let circle = coefficients(&shape, &|t| (t[0] - 0.5).powi(2) + (t[1] - 0.5).powi(2) - 0.09);
    for (offset, expected) in [(0.0, 2), (0.4, 2), (0.43, 0), (5.0, 0)] {
        let line = coefficients(&shape, &|t| t[0] - t[1] + offset);
        let found = zeros(vec![circle.clone(), line], &shape);
        assert_eq!(found.len(), expected, "{offset}: {found:?}");
        for zero in found {
            let off = (zero[0] - 0.5).powi(2) + (zero[1] - 0.5).powi(2) - 0.09;
            assert!(off.abs() < 1e-9 && (zero[0] - zero[1] + offset).abs() < 1e-9, "{zero:?}");
        }
    }
    // Two, two and one zeros along the axes: four in all, some on faces between halves.
    let shape = [3, 3, 2];
    let functions: [Function<'_>; 3] = [
        &|t| (t[0] - 0.25) * (t[0] - 0.7),
        &|t| (t[1] - 0.5) * (t[1] - 0.9) * (1.0 + t[0]),
        &|t| t[2] - 0.2 - 0.5 * t[0],
    ];
    let components = functions.map(|f| coefficients(&shape, f)).to_vec();
    let mut found = zeros(components, &shape);
    found.sort_by(|a, b| a.partial_cmp(b).expect("numbers"));
    assert_eq!(found.len(), 4, "{found:?}");
    for (zero, (x, y)) in found.iter().zip([(0.25, 0.5), (0.25, 0.9), (0.7, 0.5), (0.7, 0.9)]) {
        let off = [zero[0] - x, zero[1] - y, zero[2] - 0.2 - 0.5 * x];
        assert!(off.iter().all(|d| d.abs() < 1e-9), "{zero:?}");
    }
}

/// The search ends for components that are zero on a common line, and finds no zero.
#[test]
fn common_lines_end() {
    let shape = [2, 2];
    let line = coefficients(&shape, &|t| t[0] - 0.37);
    assert!(zeros(vec![line.clone(), line], &shape).is_empty());
}

#[test]
fn halves_are_the_polynomial_on_half_of_the_box() {
    let shape = [3, 4];
    let f = |t: &[f64]| 1.0 - t[0] * t[0] + 2.0 * t[0] * t[1].powi(3) - t[1];
    let c = coefficients(&shape, &f);
    for axis in 0..2 {
        for upper in [false, true] {
            let part = half(&c, &shape, axis, upper);
            for t in [[0.1, 0.8], [0.0, 1.0], [0.6, 0.5]] {
                let bases: Vec<Vec<f64>> = (0..2).map(|b| basis(shape[b] - 1, t[b])).collect();
                let mut whole = t;
                whole[axis] = 0.5 * (t[axis] + f64::from(u8::from(upper)));
                assert!((evaluate(&part, &bases) - f(&whole)).abs() < 1e-9, "{axis} {upper}");
            }
        }
    }
}
