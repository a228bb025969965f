//! Reading `u(T)` from the warped field `v(T, p) = e^{−p} u(T)`.

use num_complex::Complex64;
use serde::Serialize;

/// A linear functional of a function of `p` that gives 1 for `e^{−p}`.
#[derive(Clone, Copy, Debug, PartialEq, Serialize)]
pub struct Reading {
    /// `p◇`.
    pub point: f64,
}

impl Reading {
    /// The functional of `e^{iμp}`.
    pub fn of_wave(&self, mu: f64) -> Complex64 {
        // e^{p◇} v(p◇)
        Complex64::new(self.point, mu * self.point).exp()
    }
}
