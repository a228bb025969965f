//! `e^{−p}` for `p ≥ 0`, `e^{p}` for `p ≤ −1`, and between them the polynomial `q` of degree `2r+1`
//! that matches `r` derivatives at both ends. With `A` the first `r+1` terms of
//! `e^y (1−y)^{−(r+1)}`, that is `A_k = Σ_{j≤k} C(r+k−j, k−j)/j!`, and `y = −p`,
//!
//! ```text
//! q(p) = (1−y)^{r+1} A(y) + e^{−1} y^{r+1} A(1−y).
//! ```
//!
//! `ĝ` is the sum of the transforms of the two exponentials and of `q`. For small `μ` the transform
//! of `q` follows from its Legendre coefficients `q_k` on `[−1, 0]` and spherical Bessel functions
//! (DLMF 10.54.2),
//!
//! ```text
//! ∫ q(p) e^{−iμp} dp = e^{iμ/2} Σ_{k ≤ 2r+1} (−i)^k q_k j_k(μ/2).
//! ```
//!
//! The `j_k` come from Miller's backward recurrence `j_{k−1} = (2k+1)/x j_k − j_{k+1}`, scaled by
//! `Σ (2k+1) j_k² = 1` (DLMF 10.60.12). For large `μ` the terms of `ĝ` in `1/μ … 1/μ^{r+1}` cancel;
//! they are left out there, so that the remainder, from the jumps of the derivatives `r+1 … 2r+1`,
//! keeps its digits:
//!
//! ```text
//! ĝ = (iμ)^{−r−1} [ (−1)^{r+1}/(1+iμ) + e^{−1+iμ}/(1−iμ) ]
//!     + Σ_{k>r} (q^{(k)}(−1) e^{iμ} − q^{(k)}(0)) (iμ)^{−k−1}.
//! ```

use crate::base::quadrature::{gauss_legendre, legendre_values};
use crate::schrodingerization::profile::shape::{Planned, ProfileForm, ProfileShape};
use crate::schrodingerization::profile::window::{
    PlacedProfile, ProfileRequirements, best_window, summed_by_parts,
};
use num_complex::Complex64;
use std::f64::consts::E;

/// The largest argument for which the polynomial's transform is a sum of spherical Bessel
/// functions.
const SMALL: f64 = 40.0;

/// The profile.
#[derive(Clone, Debug, PartialEq, serde::Serialize)]
pub struct Smooth {
    /// `r`.
    pub order: usize,
    /// `A_k`, `k ≤ r`.
    #[serde(skip)]
    terms: Vec<f64>,
    /// `q^{(k)}(−1)` and `q^{(k)}(0)`, `k = r+1 … 2r+1`.
    #[serde(skip)]
    derivatives: Vec<[f64; 2]>,
    /// `(−1)^⌊k/2⌋ q_k`, `k ≤ 2r+1`.
    #[serde(skip)]
    legendre: Vec<f64>,
}

fn binomial(n: usize, k: usize) -> f64 {
    (0..k).fold(1.0, |c, i| c * (n - i) as f64 / (i + 1) as f64)
}

fn factorial(n: usize) -> f64 {
    (1..=n).map(|i| i as f64).product()
}

impl Smooth {
    /// The profile of `r = order` for `requirements`, and its window.
    pub fn meeting(
        order: usize,
        requirements: &ProfileRequirements,
    ) -> Option<PlacedProfile<Self>> {
        best_window(Self::new(order), 0.0, requirements)
    }

    /// The profile of `r = order`, between 1 and
    /// [`MOST_ORDER`](crate::problem::limits::MOST_ORDER).
    pub fn new(order: usize) -> Self {
        let r = order;
        let term = |k: usize| (0..=k).map(|j| binomial(r + k - j, k - j) / factorial(j)).sum();
        let terms: Vec<f64> = (0..=r).map(term).collect();
        let sign = |k: usize| if k.is_multiple_of(2) { 1.0 } else { -1.0 };
        // Coefficients of y^m in (1−y)^{r+1} A(y) and in y^{r+1} A(1−y).
        let near = |m: usize| -> f64 {
            (m.saturating_sub(r)..=m.min(r + 1))
                .map(|i| sign(i) * binomial(r + 1, i) * terms[m - i])
                .sum()
        };
        let far = |m: usize| -> f64 {
            let j = m - r - 1;
            sign(j) * (j..=r).map(|k| terms[k] * binomial(k, j)).sum::<f64>()
        };
        let derivatives = (r + 1..=2 * r + 1)
            .map(|m| {
                let (near, far) = (near(m), far(m));
                [near / E + far, sign(m) * (near + far / E)].map(|c| factorial(m) * c)
            })
            .collect();
        let mut profile = Self { order, terms, derivatives, legendre: Vec::new() };
        profile.legendre = profile.legendre_coefficients();
        profile
    }

    /// `q(p)`, `−1 ≤ p ≤ 0`: no term is negative.
    fn polynomial(&self, p: f64) -> f64 {
        let sum = |y: f64| self.terms.iter().rev().fold(0.0, |sum, a| sum * y + a);
        let (y, s) = (-p, 1.0 + p);
        let power = self.order as i32 + 1;
        s.powi(power) * sum(y) + y.powi(power) * sum(s) / E
    }

    /// `(−1)^⌊k/2⌋ (2k+1) ∫ q P_k`, `k ≤ 2r+1`, by a quadrature that is exact.
    fn legendre_coefficients(&self) -> Vec<f64> {
        let count = 2 * self.order + 2;
        let mut sums = vec![0.0; count];
        for point in gauss_legendre(count) {
            let t = point.node;
            let point = point.moved_to([-1.0, 0.0]);
            let part = point.weight * self.polynomial(point.node);
            for (sum, legendre) in sums.iter_mut().zip(legendre_values(count - 1, t)) {
                *sum += part * legendre;
            }
        }
        let scaled = |(k, sum): (usize, f64)| {
            let sign = if k % 4 < 2 { 1.0 } else { -1.0 };
            sign * (2 * k + 1) as f64 * sum
        };
        sums.into_iter().enumerate().map(scaled).collect()
    }

    /// `∫ q(p) e^{−iμp} dp` without its `e^{iμ/2}`, for `0 ≤ x = μ/2 ≤ SMALL/2`.
    fn middle(&self, x: f64) -> Complex64 {
        /// Far above the least and far below the root of the largest number, for any `x` in use.
        const START: f64 = 1e-150;
        if x < 1e-20 {
            return self.legendre[0].into();
        }
        // Beyond, no j_k is above 1e-17.
        let last = if x < 0.1 { 12 } else { 20 + (1.6 * x) as usize };
        let inverse = 1.0 / x;
        let [mut above, mut bessel] = [0.0, START];
        let mut squares = 0.0;
        // Sums over even and over odd k.
        let mut sums = [0.0; 2];
        for k in (0..=last).rev() {
            let factor = (2 * k + 1) as f64;
            squares += factor * bessel * bessel;
            if let Some(coefficient) = self.legendre.get(k) {
                sums[k % 2] += coefficient * bessel;
            }
            [above, bessel] = [bessel, factor * inverse * bessel - above];
        }
        Complex64::new(sums[0], -sums[1]) / squares.sqrt()
    }

    /// The two parts of `ĝ`, from the corners at −1 (but for its `e^{iμ}`) and at 0, exact for all
    /// `μ ≠ 0`.
    fn corners(&self, mu: f64) -> [Complex64; 2] {
        let inverse = 1.0 / Complex64::new(0.0, mu);
        let sign = if self.order.is_multiple_of(2) { -1.0 } else { 1.0 };
        let mut corners = [1.0 / (E * Complex64::new(1.0, -mu)), sign / Complex64::new(1.0, mu)];
        let mut power = inverse;
        for [at_left, at_zero] in &self.derivatives {
            corners[0] += power * at_left;
            corners[1] -= power * at_zero;
            power *= inverse;
        }
        let common = inverse.powi(self.order as i32 + 1);
        corners.map(|c| c * common)
    }
}

impl Planned for Smooth {
    fn form(&self) -> ProfileForm<'_> {
        ProfileForm::Transform(self)
    }

    fn description(&self) -> String {
        format!("smooth: order {}", self.order)
    }
}

impl ProfileShape for Smooth {
    fn coefficient(&self, mu: f64) -> Complex64 {
        let i_mu = Complex64::new(0.0, mu);
        if mu.abs() <= SMALL {
            let turn = Complex64::cis(0.5 * mu);
            let (right, left) = (1.0 / (1.0 + i_mu), turn * turn / (E * (1.0 - i_mu)));
            let middle = self.middle(0.5 * mu.abs());
            return right + left + turn * if mu < 0.0 { middle.conj() } else { middle };
        }
        let [at_left, at_zero] = self.corners(mu);
        at_left * Complex64::cis(mu) + at_zero
    }

    fn value(&self, p: f64) -> f64 {
        if p >= 0.0 {
            (-p).exp()
        } else if p <= -1.0 {
            p.exp()
        } else {
            self.polynomial(p)
        }
    }

    fn left(&self, bound: f64) -> f64 {
        bound.ln().min(-1.0)
    }

    fn tail(&self, mu: f64, distance: f64) -> f64 {
        summed_by_parts(|x| self.corners(x), mu, distance)
    }
}
