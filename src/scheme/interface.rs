//! Transmission and reflection at a face: where the velocity `ξ_j` that leaves the face comes from.

use crate::problem::case::Interface;
use crate::problem::grid::Axis;

/// On which side of the face a source lies, seen from the cell being updated.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Side {
    /// The neighbouring cell: transmission.
    Across,
    /// The cell itself: reflection.
    Same,
}

/// A share of the flux: velocity cell `velocity` (possibly off the grid) on `side`, with `weight`.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Source {
    /// Side of the face.
    pub side: Side,
    /// Index along the velocity axis; outside `0..cells` it is a ghost, filled by the inflow.
    pub velocity: i64,
    /// Weight, in (0, 1].
    pub weight: f64,
}

/// Velocities closer to zero than this fraction of a cell do not move.
const STANDING: f64 = 1e-9;
/// Fractions of a cell below this are round-off of a velocity that lies on a cell centre.
const ON_CENTRE: f64 = 1e-11;

/// Cells further off the grid than this, behind absurdly high walls, are not told apart: their numbers stay exact.
const FARTHEST: f64 = 1e15;

/// The centre of velocity cell `j`, exactly zero where it is zero but for round-off.
pub fn velocity(axis: &Axis, j: i64) -> f64 {
    let v = axis.centre(j);
    if v.abs() < STANDING * axis.width() {
        0.0
    } else {
        v
    }
}

/// Sources of velocity cell `j` behind a face where the potential rises by `rise` from the source side to the target
/// side: `f(x⁺, ξ_j) = Σ weight · f(source)`.
///
/// Kinetic energy on the source side is `ξ²/2 + rise`. Weights are positive and sum to 1.
pub fn sources(out: &mut Vec<Source>, axis: &Axis, interface: Interface, j: i64, rise: f64) {
    out.clear();
    if rise == 0.0 {
        out.push(Source {
            side: Side::Across,
            velocity: j,
            weight: 1.0,
        });
        return;
    }
    match interface {
        Interface::Hat => sources_hat(out, axis, j, rise),
        Interface::Conservative => sources_conservative(out, axis, j, rise),
    }
}

/// The paper's: `a^T Σ_k h(±√(ξ² + 2 rise) − ξ_k) f_k + a^R f_{j'}` (section 4.2, with `j'` in the cell itself).
/// On boxes that are not symmetric about zero, `f_{j'}` is interpolated at `−ξ_j` by the same hat function.
fn sources_hat(out: &mut Vec<Source>, axis: &Axis, j: i64, rise: f64) {
    let xi = velocity(axis, j);
    let square = xi * xi + 2.0 * rise;
    if square > 0.0 {
        interpolate(out, axis, Side::Across, square.sqrt().copysign(xi));
    } else {
        interpolate(out, axis, Side::Same, -xi);
    }
}

/// Weights of the hat function `h(ξ − ξ_k)` of width `Δξ`.
fn interpolate(out: &mut Vec<Source>, axis: &Axis, side: Side, xi: f64) {
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
            out.push(Source {
                side,
                velocity,
                weight,
            });
        }
    }
}

/// Overlap of energy intervals. Velocity cell `[a, b]` of one sign holds the kinetic energies `[a²/2, b²/2]`, of length
/// `|ξ|Δξ`; shifted by `rise` they are given to the source cells by overlap, and the part below the grid's lowest
/// energy is reflected. Row sums are 1 and `Σ_j |ξ_j| w_jk = |ξ_k|`, so both sums of `A` vanish away from the box's
/// ends.
///
/// A cell that contains zero holds `[min², max²]/2` of its edges, so that the length stays `|ξ|Δξ`; the lowest energy of
/// the lattice, `floor`, then is that of the face nearest to zero, the same for both signs.
fn sources_conservative(out: &mut Vec<Source>, axis: &Axis, j: i64, rise: f64) {
    let xi = velocity(axis, j);
    let sign = if xi > 0.0 { 1 } else { -1 };
    let lattice = Lattice::new(axis);
    let (low, high) = lattice.energies(j);
    let length = high - low;
    // Reflection: the part of the interval below floor − rise, found at the opposite velocities of the same cell.
    let threshold = lattice.floor - rise;
    if low < threshold {
        lattice.share(out, Side::Same, -sign, low, high.min(threshold), length);
    }
    if high > threshold {
        lattice.share(
            out,
            Side::Across,
            sign,
            low.max(threshold) + rise,
            high + rise,
            length,
        );
    }
    // Beside a very high wall energies are rounded: the shares are made to add up to 1 again, whatever is left of them.
    let sum: f64 = out.iter().map(|s| s.weight).sum();
    if sum > 0.0 {
        out.iter_mut().for_each(|s| s.weight /= sum);
    } else {
        out.push(Source {
            side: Side::Across,
            velocity: lattice.cell_of(0.5 * (low + high) + rise, sign),
            weight: 1.0,
        });
    }
}

/// The velocity lattice, continued beyond the box, seen as energies.
struct Lattice<'a> {
    axis: &'a Axis,
    /// Energy of the face nearest to zero.
    floor: f64,
}

impl<'a> Lattice<'a> {
    fn new(axis: &'a Axis) -> Self {
        let nearest = axis.position(0.0).round() as i64;
        let face = axis.face(nearest);
        Self {
            axis,
            floor: 0.5 * face * face,
        }
    }

    /// Lowest and highest kinetic energy of cell `j`.
    fn energies(&self, j: i64) -> (f64, f64) {
        let (a, b) = (self.axis.face(j), self.axis.face(j + 1));
        let (a, b) = (0.5 * a * a, 0.5 * b * b);
        (a.min(b), a.max(b))
    }

    /// The cell of velocities with `sign` that holds kinetic energy `energy` (at least the floor).
    fn cell_of(&self, energy: f64, sign: i64) -> i64 {
        let speed = (2.0 * energy.max(0.0)).sqrt();
        let at = self.axis.position(speed * sign as f64);
        at.clamp(-FARTHEST, FARTHEST).floor() as i64
    }

    /// Shares the energies `[low, high]` among the cells of velocities with `sign`; weights are overlaps over `length`.
    fn share(
        &self,
        out: &mut Vec<Source>,
        side: Side,
        sign: i64,
        low: f64,
        high: f64,
        length: f64,
    ) {
        let mut k = self.cell_of(low, sign) - 2 * sign;
        let last = self.cell_of(high, sign) + 2 * sign;
        // Interval lengths below this are round-off of edges that coincide.
        let least = 1e-12 * length;
        while (last - k) * sign >= 0 {
            if velocity(self.axis, k) * sign as f64 > 0.0 {
                let (a, b) = self.energies(k);
                let overlap = b.min(high) - a.max(low);
                if overlap > least {
                    out.push(Source {
                        side,
                        velocity: k,
                        weight: overlap / length,
                    });
                }
            }
            k += sign;
        }
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

    fn each(interface: Interface, mut check: impl FnMut(&Axis, i64, f64, &[Source])) {
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
        for interface in [Interface::Hat, Interface::Conservative] {
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
        // Σ over targets on both sides of |ξ_j| w_jk = |ξ_k| for every source cell whose targets are on the lattice.
        let mut out = Vec::new();
        for (lower, upper, cells) in BOXES {
            let axis = Axis::new(lower, upper, cells);
            for rise in [-0.4, -0.013, 0.05, 0.3] {
                // Sources on the left side moving right: k > 0. Targets: right side moving right across `rise`,
                // left side moving left by reflection (their own rise is −rise).
                for k in -40..100i64 {
                    let xi = velocity(&axis, k);
                    if xi <= 0.0 {
                        continue;
                    }
                    let mut total = 0.0;
                    for j in -300..300i64 {
                        let target = velocity(&axis, j);
                        let (r, side) = if target > 0.0 {
                            (rise, Side::Across)
                        } else if target < 0.0 {
                            (-rise, Side::Same)
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
