//! Functions of one variable as piecewise polynomials, with transforms, jumps and variations.
//!
//! On a piece with middle `m` and half width `h`, with Legendre polynomials `P_n` and spherical
//! Bessel functions `j_n`,
//!
//! ```text
//! f(m + ht) = Σ_n c_n P_n(t),     ∫ f(x) e^{−iμx} dx = 2h e^{−iμm} Σ_n (−i)^n c_n j_n(μh),
//! ```
//!
//! for every `μ` to round-off. A piece is halved until its last coefficients are round-off. If
//! pieces become ever smaller about a point, `f` or a derivative jumps there: the point becomes the
//! common end of two wide pieces.

use crate::base::quadrature::{QuadraturePoint, gauss_legendre, legendre_values};
use num_complex::Complex64;

/// Jumps are known of the derivatives `0 … ORDERS − 1`, integrals also of the next one.
pub const ORDERS: usize = 10;
/// Coefficients of a piece.
const NODES: usize = 24;
/// Number of last coefficients that show whether a piece is resolved.
const LAST: usize = 4;
/// Largest size of these coefficients in a resolved piece, relative to the larger of 1 and the
/// largest value: round-off, or more if the function itself is rounded coarsely.
const RESOLVED: [f64; 3] = [4e-15, 1e-13, 2e-12];
/// Largest error at points between the nodes, as a multiple of that size.
const CLOSE: f64 = 25.0;
/// Least width of a piece, relative to the larger of 1 and its distance from 0.
const LEAST_WIDTH: f64 = 1e-12;
/// Width below which a piece beside wider ones shows a jump.
const NARROW: f64 = 1e-3;
const MOST_PIECES: usize = 1000;
const MOST_JUMPS: usize = 50;
/// Jumps of values and of slopes up to these are round-off.
const ROUNDED_JUMPS: [f64; 2] = [1e-13, 1e-9];

/// Why a function has no representation.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Failure {
    /// The function's value at this point is too large, or not a number.
    Unbounded { at: f64 },
    /// More pieces than allowed, or smaller ones, about this point.
    Rough { at: f64 },
}

/// A polynomial on an interval.
#[derive(Clone, Debug, PartialEq)]
struct PolynomialPiece {
    lower: f64,
    upper: f64,
    /// Coefficients of the Legendre polynomials `P_n(t)`, `t` in `[−1, 1]`.
    coefficients: Vec<f64>,
    resolved: bool,
}

impl PolynomialPiece {
    fn middle(&self) -> f64 {
        0.5 * (self.lower + self.upper)
    }

    fn half(&self) -> f64 {
        0.5 * (self.upper - self.lower)
    }

    fn value(&self, x: f64) -> f64 {
        let t = (x - self.middle()) / self.half();
        let (mut before, mut now, mut sum) = (0.0, 1.0, 0.0);
        for (n, c) in self.coefficients.iter().enumerate() {
            sum += c * now;
            let n = n as f64;
            (before, now) = (now, ((2.0 * n + 1.0) * t * now - n * before) / (n + 1.0));
        }
        sum
    }

    /// `2h e^{−iμm} Σ (−i)^n c_n j_n(μh)` for `μ ≥ 0`.
    fn transform(&self, mu: f64) -> Complex64 {
        let bessel = spherical_bessel(mu * self.half());
        let mut sum = Complex64::ZERO;
        // (−i)^n.
        let mut turn = Complex64::ONE;
        for (c, j) in self.coefficients.iter().zip(bessel) {
            sum += turn * (c * j);
            turn *= -Complex64::I;
        }
        let (sin, cos) = (mu * self.middle()).sin_cos();
        2.0 * self.half() * Complex64::new(cos, -sin) * sum
    }

    /// The derivative, by `d_n = (2n + 1) Σ c_m` over `m > n`, `m − n` odd.
    fn derivative(&self) -> Self {
        let count = self.coefficients.len();
        let mut sums = [0.0; 2];
        let mut coefficients = vec![0.0; count];
        for n in (0..count).rev() {
            coefficients[n] = (2 * n + 1) as f64 * sums[(n + 1) % 2] / self.half();
            sums[n % 2] += self.coefficients[n];
        }
        Self { coefficients, ..*self }
    }

    /// The values at both ends.
    fn ends(&self) -> [f64; 2] {
        let signs = [1.0, -1.0].into_iter().cycle();
        let lower = self.coefficients.iter().zip(signs).map(|(c, sign)| c * sign).sum();
        [lower, self.coefficients.iter().sum()]
    }

    /// Bound on `∫|f|`, by Cauchy and Schwarz: `2h (Σ c_n²/(2n + 1))^{1/2}`.
    fn magnitude(&self) -> f64 {
        let terms = self.coefficients.iter().enumerate();
        let squares: f64 = terms.map(|(n, c)| c * c / (2 * n + 1) as f64).sum();
        2.0 * self.half() * squares.sqrt()
    }
}

/// A point where a function or its slope jumps.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct FunctionJump {
    /// The point.
    pub at: f64,
    /// `|f^{(k)}(at+) − f^{(k)}(at−)|`.
    pub sizes: [f64; ORDERS],
}

/// A piecewise polynomial on an interval, zero outside.
#[derive(Clone, Debug, PartialEq)]
pub struct Piecewise {
    pieces: Vec<PolynomialPiece>,
    /// Points other than the upper end where the function or its slope jumps; ascending.
    pub jumps: Vec<FunctionJump>,
    /// By `k`: `Σ |f^{(k)}(x+) − f^{(k)}(x−)|` over the ends of pieces without a jump, except the
    /// last.
    pub rounded: [f64; ORDERS],
    /// By `k`: `f^{(k)}` at the upper end.
    pub at_end: [f64; ORDERS],
    /// By `k ≤ ORDERS`: bound on `∫|f^{(k)}|` over the pieces.
    pub variations: [f64; ORDERS + 1],
}

impl Piecewise {
    /// `function` on `[lower, upper]`, whose values are at most `largest`.
    ///
    /// # Errors
    /// [`Failure`] where it is larger, or too rough.
    pub fn fit(
        function: &dyn Fn(f64) -> f64,
        [lower, upper]: [f64; 2],
        largest: f64,
    ) -> Result<Self, Failure> {
        let mut fit = PiecewiseFit::new(function, largest);
        let mut attempt = |resolved| {
            fit.resolved = resolved;
            fit.pieces(lower, upper).map(Self::new)
        };
        let [finest, coarser @ ..] = RESOLVED;
        coarser.into_iter().fold(attempt(finest), |found, resolved| match found {
            Err(Failure::Rough { .. }) => attempt(resolved),
            found => found,
        })
    }

    /// The function with these consecutive pieces, and its jumps.
    fn new(pieces: Vec<PolynomialPiece>) -> Self {
        let mut found = Self {
            jumps: Vec::new(),
            rounded: [0.0; ORDERS],
            at_end: [0.0; ORDERS],
            variations: [0.0; ORDERS + 1],
            pieces: Vec::new(),
        };
        let mut before = [0.0; ORDERS];
        for piece in &pieces {
            let (mut of_lower, mut of_upper) = ([0.0; ORDERS], [0.0; ORDERS]);
            let mut derivative = piece.clone();
            for k in 0..ORDERS {
                [of_lower[k], of_upper[k]] = derivative.ends();
                found.variations[k] += derivative.magnitude();
                derivative = derivative.derivative();
            }
            found.variations[ORDERS] += derivative.magnitude();
            let sizes: [f64; ORDERS] = std::array::from_fn(|k| (of_lower[k] - before[k]).abs());
            if sizes.iter().zip(ROUNDED_JUMPS).any(|(size, limit)| *size > limit) {
                found.jumps.push(FunctionJump { at: piece.lower, sizes });
            } else {
                sizes.iter().zip(&mut found.rounded).for_each(|(size, sum)| *sum += size);
            }
            before = of_upper;
        }
        found.at_end = before;
        Self { pieces, ..found }
    }

    /// The value at `x`.
    pub fn value(&self, x: f64) -> f64 {
        let next = self.pieces.partition_point(|piece| piece.upper < x);
        (self.pieces.get(next)).filter(|p| p.lower <= x).map_or(0.0, |piece| piece.value(x))
    }

    /// `∫ f(x) e^{−iμx} dx`.
    pub fn transform(&self, mu: f64) -> Complex64 {
        let sum: Complex64 = self.pieces.iter().map(|piece| piece.transform(mu.abs())).sum();
        if mu < 0.0 { sum.conj() } else { sum }
    }

    /// A point below which `|f| ≤ bound`, found on closely spaced samples.
    pub fn first_above(&self, bound: f64) -> f64 {
        const STEPS: u32 = 64;
        const SAFETY: f64 = 0.9;
        let mut last = f64::NEG_INFINITY;
        for piece in &self.pieces {
            last = last.max(piece.lower);
            let most: f64 = piece.coefficients.iter().map(|c| c.abs()).sum();
            if most <= bound {
                continue;
            }
            for i in 0..=STEPS {
                let x = piece.lower + 2.0 * piece.half() * f64::from(i) / f64::from(STEPS);
                if piece.value(x).abs() > SAFETY * bound {
                    return last;
                }
                last = x;
            }
        }
        self.pieces.last().map_or(last, |piece| piece.upper)
    }
}

/// The middle of the narrowest piece if it is narrow enough for a jump, and not the last of pieces
/// that become narrower towards an end.
fn narrowest(pieces: &[PolynomialPiece]) -> Option<f64> {
    let widths: Vec<f64> = pieces.iter().map(PolynomialPiece::half).collect();
    let first = widths.windows(2).position(|pair| pair[1] < pair[0])?;
    let last = 1 + widths.windows(2).rposition(|pair| pair[0] < pair[1])?;
    let within = pieces.get(first..=last)?.iter();
    let found = within.min_by(|a, b| a.half().total_cmp(&b.half()))?;
    (2.0 * found.half() < NARROW).then(|| found.middle())
}

/// The function that is fitted, and the rule by which its pieces are made.
struct PiecewiseFit<'f> {
    function: &'f dyn Fn(f64) -> f64,
    largest: f64,
    /// Relative size of coefficients that count as round-off.
    resolved: f64,
    rule: Vec<QuadraturePoint>,
    /// `P_n` at the nodes.
    values: Vec<Vec<f64>>,
    /// The points at which a piece is compared: between nodes and close to its ends.
    between: Vec<f64>,
}

impl<'f> PiecewiseFit<'f> {
    fn new(function: &'f dyn Fn(f64) -> f64, largest: f64) -> Self {
        /// Close to 1.
        const EDGE: f64 = 1.0 - 1e-4;
        let rule = gauss_legendre(NODES);
        let middles = rule.windows(2).map(|pair| 0.5 * (pair[0].node + pair[1].node));
        Self {
            function,
            largest,
            resolved: 0.0,
            values: rule.iter().map(|point| legendre_values(NODES - 1, point.node)).collect(),
            between: middles.chain([-EDGE, EDGE]).collect(),
            rule,
        }
    }

    fn at(&self, x: f64) -> Result<f64, Failure> {
        let value = (self.function)(x);
        if value.abs() <= self.largest { Ok(value) } else { Err(Failure::Unbounded { at: x }) }
    }

    /// `c_n = (2n + 1)/2 Σ_i w_i f(x_i) P_n(t_i)`.
    fn piece(&self, lower: f64, upper: f64) -> Result<PolynomialPiece, Failure> {
        let mut piece =
            PolynomialPiece { lower, upper, coefficients: vec![0.0; NODES], resolved: false };
        let (middle, half) = (piece.middle(), piece.half());
        let mut size = 1f64;
        for (point, values) in self.rule.iter().zip(&self.values) {
            let value = self.at(middle + half * point.node)?;
            size = size.max(value.abs());
            for (n, (c, p)) in piece.coefficients.iter_mut().zip(values).enumerate() {
                *c += (n as f64 + 0.5) * point.weight * value * p;
            }
        }
        let small = |c: &f64| c.abs() <= self.resolved * size;
        piece.resolved = piece.coefficients[NODES - LAST..].iter().all(small);
        for t in &self.between {
            let x = middle + half * t;
            piece.resolved &= (self.at(x)? - piece.value(x)).abs() <= CLOSE * self.resolved * size;
        }
        while piece.resolved && piece.coefficients.last().is_some_and(small) {
            piece.coefficients.pop();
        }
        Ok(piece)
    }

    /// Pieces from `lower` to `upper` that end where something jumps.
    fn pieces(&self, lower: f64, upper: f64) -> Result<Vec<PolynomialPiece>, Failure> {
        let mut pieces = Vec::new();
        let mut ends = vec![upper];
        let (mut from, mut jumps) = (lower, 0);
        while let Some(&to) = ends.last() {
            let found = self.resolve(from, to)?;
            if let Some(at) = narrowest(&found) {
                ends.push(at);
                jumps += 1;
            } else if let Some(rough) = found.iter().find(|piece| !piece.resolved) {
                return Err(Failure::Rough { at: rough.middle() });
            } else {
                pieces.extend(found);
                ends.pop();
                from = to;
            }
            if jumps > MOST_JUMPS || pieces.len() > MOST_PIECES {
                return Err(Failure::Rough { at: from });
            }
        }
        Ok(pieces)
    }

    /// Pieces from `lower` to `upper`, halved until they are resolved or as narrow as may be.
    fn resolve(&self, lower: f64, upper: f64) -> Result<Vec<PolynomialPiece>, Failure> {
        let mut pieces = Vec::new();
        let mut left = vec![[lower, upper]];
        while let Some([lower, upper]) = left.pop() {
            let piece = self.piece(lower, upper)?;
            let least = LEAST_WIDTH * lower.abs().max(1.0);
            if piece.resolved || upper - lower <= least {
                pieces.push(piece);
            } else {
                let middle = piece.middle();
                left.extend([[middle, upper], [lower, middle]]);
            }
            if pieces.len() > MOST_PIECES {
                return Err(Failure::Rough { at: lower });
            }
        }
        Ok(pieces)
    }
}

/// `j_n(z)`, `n < NODES`, `z ≥ 0`: upwards as far as `n ≤ z`, where that is stable; beyond, by the
/// ratios `j_n/j_{n−1} = z/(2n + 1 − z j_{n+1}/j_n)`, from far enough down.
fn spherical_bessel(z: f64) -> [f64; NODES] {
    /// From here on upwards, ratios may begin with 0.
    const BEYOND: usize = 30;
    let mut j = [0.0; NODES];
    let (sin, cos) = z.sin_cos();
    j[0] = if z > 0.0 { sin / z } else { 1.0 };
    let turn = (z as usize).min(NODES - 1);
    if turn > 0 {
        j[1] = (j[0] - cos) / z;
    }
    for n in 2..=turn {
        j[n] = (2 * n - 1) as f64 / z * j[n - 1] - j[n - 2];
    }
    let mut ratios = [0.0; NODES + BEYOND];
    for n in (turn + 1..NODES + BEYOND - 1).rev() {
        ratios[n] = z / ((2 * n + 1) as f64 - z * ratios[n + 1]);
    }
    for n in turn + 1..NODES {
        j[n] = ratios[n] * j[n - 1];
    }
    j
}

#[cfg(test)]
mod tests {
    use super::*;

    type Function = fn(f64) -> f64;

    /// Functions that are smooth, or have kinks, a jump or a singular end, with the places of
    /// these.
    const FUNCTIONS: [(Function, &[f64]); 7] = [
        (|x| x.exp(), &[]),
        (|x| (-x * x).exp(), &[]),
        (|x| (30.0 * (x + 2.3)).tanh(), &[]),
        (|x| (x + 1.3).abs(), &[-1.3]),
        (|x| if x < -3.0 { 0.2 } else { x.exp() }, &[-3.0]),
        (|x| (x + 5.5).max(0.0) + (-x - 2.0).max(0.0) * x.cos(), &[-5.5, -2.0]),
        (|x| (-x).powf(1.5), &[]),
    ];
    const INTERVAL: [f64; 2] = [-8.0, 0.0];

    fn fits() -> impl Iterator<Item = (Function, Piecewise, &'static [f64])> {
        FUNCTIONS
            .into_iter()
            .map(|(f, jumps)| (f, Piecewise::fit(&f, INTERVAL, 1e3).expect("smooth enough"), jumps))
    }

    #[test]
    fn spherical_bessel_functions_satisfy_their_sum_and_wronskian() {
        for z in [0.0, 1e-9, 0.3, 1.0, 3.2, std::f64::consts::TAU, 14.5, 23.9, 24.1, 300.0, 1e6] {
            let j = spherical_bessel(z);
            // As sums of waves over [−1, 1], by a rule that resolves them.
            if z < 30.0 {
                for n in 0..NODES {
                    let rule = gauss_legendre(64);
                    let term = |q: &QuadraturePoint| {
                        let wave = Complex64::new(0.0, z * q.node).exp();
                        wave * (q.weight * legendre_values(n, q.node)[n])
                    };
                    let sum: Complex64 = rule.iter().map(term).sum();
                    let expected = 0.5 * sum * (-Complex64::I).powi(n as i32);
                    assert!((j[n] - expected.re).abs() < 2e-15, "{n} {z}: {} {expected}", j[n]);
                }
            } else {
                // To first order in 1/z.
                let wave = |n: usize| (z - 0.5 * std::f64::consts::PI * n as f64).sin() / z;
                let error = (0..3).map(|n| (j[n] - wave(n)).abs()).fold(0.0, f64::max);
                assert!(error < 4.0 / (z * z), "{z}: {error:e}");
            }
        }
    }

    #[test]
    fn values_and_jumps_are_those_of_the_function() {
        for (f, fit, jumps) in fits() {
            let found: Vec<f64> = fit.jumps.iter().map(|jump| jump.at).collect();
            let inside: Vec<f64> = found.iter().copied().filter(|x| *x > INTERVAL[0]).collect();
            for jump in jumps {
                let near = inside.iter().any(|x| (x - jump).abs() < 1e-11);
                assert!(near, "{jump}: {found:?}");
            }
            for i in 0..4000 {
                let x = -8.0 + 0.002 * (f64::from(i) + 0.37);
                let error = (f(x) - fit.value(x)).abs();
                assert!(error < 1e-12, "at {x}: {error:e}");
            }
            assert!((fit.at_end[0] - f(-1e-15)).abs() < 1e-11);
        }
    }

    #[test]
    fn transforms_are_integrals() {
        let rule = gauss_legendre(16);
        for (f, fit, jumps) in fits() {
            // From end to end in pieces that become narrower towards the next one.
            let ends: Vec<f64> = [-8.0].into_iter().chain(jumps.iter().copied()).collect();
            let next = ends.iter().skip(1).copied().chain([0.0]);
            let mut nodes = Vec::new();
            for (&from, to) in ends.iter().zip(next) {
                let at = |k: i32| to - (to - from) * 0.96f64.powi(k);
                let pieces = (0..800).map(|k| [at(k), if k < 799 { at(k + 1) } else { to }]);
                nodes.extend(pieces.flat_map(|piece| rule.iter().map(move |q| q.moved_to(piece))));
            }
            for mu in [0.0, 0.3, -2.0, 11.0, 60.0] {
                let term = |q: &QuadraturePoint| {
                    Complex64::new(0.0, -mu * q.node).exp() * (q.weight * f(q.node))
                };
                let expected: Complex64 = nodes.iter().map(term).sum();
                let error = (fit.transform(mu) - expected).norm();
                assert!(error < 1e-11, "{mu}: {error:e}");
            }
        }
    }

    #[test]
    fn coarse_round_off_is_no_roughness() {
        let f = |x: f64| 1e3 + x.exp() - 1e3;
        let fit = Piecewise::fit(&f, [-8.0, 0.0], 2.0).expect("smooth");
        assert!((fit.value(-1.0) - f(-1.0)).abs() < 1e-12);
        assert!(fit.pieces.len() < 10, "{}", fit.pieces.len());
    }

    #[test]
    fn derivatives_and_variations_of_an_exponential() {
        let fit = Piecewise::fit(&|x: f64| (3.0 * x).exp(), [-12.0, 0.0], 1.0).expect("smooth");
        for k in 0..=ORDERS {
            let variation = 3f64.powi(k as i32 - 1);
            let bound = fit.variations[k];
            assert!((variation..4.0 * variation).contains(&bound), "{k}: {bound}");
        }
        for k in 0..6 {
            let (found, expected) = (fit.at_end[k], 3f64.powi(k as i32));
            assert!((found / expected - 1.0).abs() < 1e-7, "{k}: {found} {expected}");
        }
        let below = fit.first_above(1e-3);
        assert!((3.0 * below).exp() <= 1e-3 && (3.0 * (below + 0.3)).exp() > 1e-3, "{below}");
    }

    #[test]
    fn rough_or_unbounded_functions_are_refused() {
        let fit = |f: Function| Piecewise::fit(&f, [-1.0, 0.0], 10.0);
        assert!(matches!(fit(|x| (1e6 * x).sin()), Err(Failure::Rough { .. })));
        assert!(matches!(fit(|x| -(-x).powf(0.2)), Err(Failure::Rough { .. })));
        assert!(matches!(fit(|x| 1.0 / (x + 0.5)), Err(Failure::Unbounded { .. })));
        assert!(matches!(fit(|_| f64::NAN), Err(Failure::Unbounded { .. })));
    }
}
