//! Points of the unit circle at multiples of a small angle, without the rounding of large
//! arguments.

use num_complex::Complex64;
use std::f64::consts::TAU;

/// Multiples of the small angle in a turn.
pub const TURN: i64 = 1 << 20;
/// `√TURN`.
const ROOT: i64 = 1 << 10;

/// `e^{2πik/TURN}` for whole `k`, from two tables.
pub struct Circle {
    coarse: Vec<Complex64>,
    fine: Vec<Complex64>,
}

impl Circle {
    pub(crate) fn new() -> Self {
        let point = |k: i64| {
            let (sin, cos) = libm::sincos(TAU * (k as f64 / TURN as f64));
            Complex64::new(cos, sin)
        };
        Self {
            coarse: (0..ROOT).map(|k| point(k * ROOT)).collect(),
            fine: (0..ROOT).map(point).collect(),
        }
    }

    /// `e^{2πik/TURN}`.
    #[inline]
    pub fn at(&self, k: i64) -> Complex64 {
        let k = (k & (TURN - 1)) as usize;
        let root = ROOT as usize;
        self.coarse[k / root] * self.fine[k % root]
    }
}
