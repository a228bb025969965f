//! The hat law of the paper (section 4.2): `f` at the velocity of the same energy, interpolated.
//!
//! ```text
//! f(x⁺, ξ_j) = a^T Σ_k h(±√(ξ_j² + 2 rise) − ξ_k) f_k + a^R f_{j'}
//! ```
//!
//! `h` is the hat function of width `Δξ`; `j'`, in the cell itself, has the velocity `−ξ_j`. On
//! boxes that are not symmetric about zero `f_{j'}` is interpolated at `−ξ_j` by the same hat
//! function.

use crate::problem::grid::Axis;
use crate::scheme::interface::law::{FARTHEST, FluxSource, InterfaceLaw, SourceSide, velocity};

/// Fractions of a cell below this are round-off of a velocity that lies on a cell centre.
const ON_CENTRE: f64 = 1e-11;

/// The hat law.
#[derive(Debug)]
pub struct Hat;

impl InterfaceLaw for Hat {
    fn sources(&self, out: &mut Vec<FluxSource>, axis: &Axis, j: i64, rise: f64) {
        let xi = velocity(axis, j);
        let square = xi * xi + 2.0 * rise;
        if square > 0.0 {
            interpolate(out, axis, SourceSide::Across, square.sqrt().copysign(xi));
        } else {
            interpolate(out, axis, SourceSide::Same, -xi);
        }
    }

    fn may_grow(&self) -> bool {
        true
    }
}

/// Weights of the hat function `h(ξ − ξ_k)` of width `Δξ`.
fn interpolate(out: &mut Vec<FluxSource>, axis: &Axis, side: SourceSide, xi: f64) {
    let position = axis.position(xi) - 0.5;
    let position = position.clamp(-FARTHEST, FARTHEST);
    let mut k = position.floor();
    let mut fraction = position - k;
    if fraction < ON_CENTRE {
        fraction = 0.0;
    } else if fraction > 1.0 - ON_CENTRE {
        k += 1.0;
        fraction = 0.0;
    }
    let k = k as i64;
    for (velocity, weight) in [(k, 1.0 - fraction), (k + 1, fraction)] {
        if weight > 0.0 {
            out.push(FluxSource { side, velocity, weight });
        }
    }
}
