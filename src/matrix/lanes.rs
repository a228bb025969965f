//! A row of a batch of modes: [`LANES`] complex numbers, and the constants of a Chebyshev step.

use crate::parallel::communicator::VectorRow;

/// Modes in a batch, `B`.
pub const LANES: usize = 8;

/// A row of a batch vector: real parts, then imaginary parts.
#[derive(Clone, Copy, Debug, PartialEq)]
#[repr(C, align(64))]
pub struct Lanes(pub [f64; 2 * LANES]);

impl Lanes {
    /// All zero.
    pub const ZERO: Lanes = Lanes([0.0; 2 * LANES]);
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

/// What a step needs besides the matrix, per lane.
#[derive(Clone, Debug)]
#[repr(C, align(64))]
pub struct StepConstants {
    /// `a`.
    pub scale: [f64; LANES],
    /// `c`, the centre of the spectral interval.
    pub shift: [f64; LANES],
    /// `μ`.
    pub wavenumber: [f64; LANES],
    /// What of the start is added.
    pub coefficient: [f64; LANES],
}

/// A row of the vector that a series is of.
pub trait StartRow: Copy {
    /// Adds `coefficient` times row `i` of `start` to `out`.
    fn add<const FMA: bool>(
        start: &[Self],
        i: usize,
        coefficient: &[f64; LANES],
        out: &mut [f64; 2 * LANES],
    );
}

/// A complex vector a lane.
impl StartRow for Lanes {
    #[inline(always)]
    fn add<const FMA: bool>(
        start: &[Self],
        i: usize,
        coefficient: &[f64; LANES],
        out: &mut [f64; 2 * LANES],
    ) {
        let Lanes(value) = &start[i];
        for part in 0..2 * LANES {
            out[part] = multiply_add::<FMA>(coefficient[part % LANES], value[part], out[part]);
        }
    }
}

#[inline(always)]
pub(crate) fn multiply_add<const FMA: bool>(a: f64, b: f64, c: f64) -> f64 {
    if FMA { a.mul_add(b, c) } else { a * b + c }
}
