//! Transmission and reflection at a face: the sources of the velocity `ξ_j` that leaves it.
//!
//! For degree 0, an interface law is a file of this folder that implements [`InterfaceLaw`];
//! [`law_of`] is the table. For higher degrees, [`energy::FaceCoupling`] couples the traces.

pub mod conservative;
pub mod energy;
pub mod hat;
pub mod law;
pub mod rest_face;

pub use crate::scheme::interface::law::{FluxSource, InterfaceLaw, SourceSide, velocity};

use crate::problem::case::Interface;
use crate::problem::grid::Axis;

/// The law that a case names.
pub fn law_of(interface: Interface) -> &'static dyn InterfaceLaw {
    match interface {
        Interface::Hat => &hat::Hat,
        Interface::Conservative => &conservative::Conservative,
    }
}

/// Sources of velocity cell `j` behind a face where the potential rises by `rise` from the source
/// side to the target side (see [`InterfaceLaw::sources`]); without a jump, cell `j` on the other
/// side.
pub fn sources(out: &mut Vec<FluxSource>, axis: &Axis, interface: Interface, j: i64, rise: f64) {
    out.clear();
    if rise == 0.0 {
        out.push(FluxSource { side: SourceSide::Across, velocity: j, weight: 1.0 });
    } else {
        law_of(interface).sources(out, axis, j, rise);
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const BOXES: [(f64, f64, usize); 7] = [
        (-1.5, 1.5, 64),
        (-1.5, 1.5, 33),
        (-1.0, 2.0, 31),
        (-0.7, 1.6, 40),
        (0.3, 0.9, 8),
        (-1.6, -0.1, 17),
        (-1.0, 1.0, 1),
    ];

    fn each(interface: Interface, mut check: impl FnMut(&Axis, i64, f64, &[FluxSource])) {
        let mut out = Vec::new();
        for (lower, upper, cells) in BOXES {
            let axis = Axis::new(lower, upper, cells);
            for rise in [-0.4, -0.2, -0.013, 1e-9, 0.05, 0.2, 0.7] {
                for j in 0..cells as i64 {
                    if velocity(&axis, j) != 0.0 {
                        sources(&mut out, &axis, interface, j, rise);
                        check(&axis, j, rise, &out);
                    }
                }
            }
        }
    }

    #[test]
    fn weights_are_positive_and_sum_to_one() {
        for interface in Interface::ALL {
            each(interface, |axis, j, rise, out| {
                let sum: f64 = out.iter().map(|s| s.weight).sum();
                assert!(
                    (sum - 1.0).abs() < 1e-10,
                    "{interface:?} {axis:?} {j} {rise}: {sum} {out:?}"
                );
                assert!(out.iter().all(|s| s.weight > 0.0));
            });
        }
    }

    #[test]
    fn conservative_flux_is_conserved() {
        // Σ over targets on both sides of |ξ_j| w_jk = |ξ_k| for every source cell whose targets
        // are on the lattice.
        let mut out = Vec::new();
        for (lower, upper, cells) in BOXES {
            let axis = Axis::new(lower, upper, cells);
            for rise in [-0.4, -0.013, 0.05, 0.3] {
                // Sources on the left side moving right: k > 0. Targets: right side moving right
                // across `rise`, left side moving left by reflection (their own rise is −rise).
                for k in -40..100i64 {
                    let xi = velocity(&axis, k);
                    if xi <= 0.0 {
                        continue;
                    }
                    let mut total = 0.0;
                    for j in -300..300i64 {
                        let target = velocity(&axis, j);
                        let (r, side) = if target > 0.0 {
                            (rise, SourceSide::Across)
                        } else if target < 0.0 {
                            (-rise, SourceSide::Same)
                        } else {
                            continue;
                        };
                        sources(&mut out, &axis, Interface::Conservative, j, r);
                        total += out
                            .iter()
                            .filter(|s| s.side == side && s.velocity == k)
                            .map(|s| target.abs() * s.weight)
                            .sum::<f64>();
                    }
                    assert!(
                        (total - xi).abs() < 1e-9 * xi.max(1.0),
                        "{axis:?} {rise} {k}: {total} {xi}"
                    );
                }
            }
        }
    }
}
