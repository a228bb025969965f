//! A row of a batch of modes: [`LANES`] complex numbers, and the constants of a Chebyshev step.

pub use crate::matrix::vector::LANES;
use crate::matrix::vector::{Portable, Vector};
use crate::parallel::communicator::VectorRow;
use num_complex::Complex64;

/// A row of a batch vector: real parts, then imaginary parts.
#[derive(Clone, Copy, Debug, PartialEq)]
#[repr(C, align(64))]
pub struct Lanes(pub [f64; 2 * LANES]);

impl Lanes {
    /// A row of zeros.
    pub const ZERO: Lanes = Lanes([0.0; 2 * LANES]);

    /// Real and imaginary parts.
    #[inline(always)]
    pub(crate) fn load<V: Vector>(&self) -> [V; 2] {
        let (parts, _) = self.0.as_chunks::<LANES>();
        [V::load(&parts[0]), V::load(&parts[1])]
    }

    /// The number in a lane.
    #[inline(always)]
    pub fn lane(&self, l: usize) -> Complex64 {
        Complex64::new(self.0[l], self.0[LANES + l])
    }

    /// Sets the number in a lane.
    #[inline(always)]
    pub fn set_lane(&mut self, l: usize, value: Complex64) {
        (self.0[l], self.0[LANES + l]) = (value.re, value.im);
    }

    /// Sets real and imaginary parts.
    #[inline(always)]
    pub(crate) fn store<V: Vector>(&mut self, [re, im]: [V; 2]) {
        let (parts, _) = self.0.as_chunks_mut::<LANES>();
        re.store(&mut parts[0]);
        im.store(&mut parts[1]);
    }
}

impl VectorRow for Lanes {
    const WIDTH: usize = 2 * LANES;
    #[inline]
    fn write_to(&self, numbers: &mut [f64]) {
        numbers.copy_from_slice(&self.0);
    }
    #[inline]
    fn of(numbers: &[f64]) -> Self {
        let mut row = Self::ZERO;
        row.0.copy_from_slice(numbers);
        row
    }
}

/// The coefficients of a step for each lane.
#[derive(Clone, Debug)]
#[repr(C, align(64))]
pub struct StepConstants {
    /// The factor `a` of the step, see [`kernel`](crate::matrix::kernel).
    pub scale: [f64; LANES],
    /// `c`, the centre of the spectral interval.
    pub shift: [f64; LANES],
    /// The wavenumber `μ`.
    pub wavenumber: [f64; LANES],
    /// The factor of the start vector, which is added.
    pub coefficient: [f64; LANES],
}

/// A row of the start vector, to which a series is applied.
pub trait StartRow: Copy {
    /// `sum` (real and imaginary parts) plus `coefficient` times row `i` of `start`.
    fn add<V: Vector>(start: &[Self], i: usize, coefficient: V, sum: [V; 2]) -> [V; 2];

    /// Adds the same to `row` without fused operations, so with the same bits on any processor.
    fn add_unfused(start: &[Self], i: usize, coefficient: &[f64; LANES], row: &mut Lanes) {
        let coefficient = Portable::<false>::load(coefficient);
        row.store(Self::add(start, i, coefficient, row.load()));
    }
}

/// A complex vector for each lane.
impl StartRow for Lanes {
    #[inline(always)]
    fn add<V: Vector>(start: &[Self], i: usize, coefficient: V, [re, im]: [V; 2]) -> [V; 2] {
        let value = start[i].load();
        [re.add_product(coefficient, value[0]), im.add_product(coefficient, value[1])]
    }
}

/// No start vector.
impl StartRow for () {
    #[inline(always)]
    fn add<V: Vector>(_: &[Self], _: usize, _: V, sum: [V; 2]) -> [V; 2] {
        sum
    }
}

/// A real vector, the same in every lane.
impl StartRow for f64 {
    #[inline(always)]
    fn add<V: Vector>(start: &[Self], i: usize, coefficient: V, [re, im]: [V; 2]) -> [V; 2] {
        [re.add_product(coefficient, V::splat(start[i])), im]
    }
}
