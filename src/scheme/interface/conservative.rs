//! The conservative law: overlap of energy intervals.
//!
//! Velocity cell `[a, b]` of one sign holds the kinetic energies `[a²/2, b²/2]`, of length `|ξ|Δξ`.
//! The interval, shifted by `rise`, is shared among the source cells by overlap; its part below the
//! lowest energy of the grid is reflected. Row sums are 1 and `Σ_j |ξ_j| w_jk = |ξ_k|`, so both
//! sums of `A` vanish away from the ends of the box.
//!
//! A cell that contains zero holds `[min², max²]/2` of its edges, so that the length stays `|ξ|Δξ`.
//! The lowest energy of the lattice, `floor`, is then that of the face nearest to zero, for both
//! signs.

use crate::problem::grid::Axis;
use crate::scheme::interface::law::{FARTHEST, FluxSource, InterfaceLaw, SourceSide, velocity};

/// The conservative law.
#[derive(Debug)]
pub struct Conservative;

impl InterfaceLaw for Conservative {
    fn sources(&self, out: &mut Vec<FluxSource>, axis: &Axis, j: i64, rise: f64) {
        let xi = velocity(axis, j);
        let sign = if xi > 0.0 { 1 } else { -1 };
        let lattice = Lattice::new(axis);
        let EnergyInterval { low, high } = lattice.energies(j);
        let length = high - low;
        // Reflection: the part of the interval below floor − rise, found at the opposite velocities
        // of the same cell.
        let threshold = lattice.floor - rise;
        if low < threshold {
            let reflected = EnergyInterval { low, high: high.min(threshold) };
            lattice.share(out, SourceSide::Same, -sign, reflected, length);
        }
        if high > threshold {
            let across = EnergyInterval { low: low.max(threshold) + rise, high: high + rise };
            lattice.share(out, SourceSide::Across, sign, across, length);
        }
        // Energies at a very high wall are rounded, so the shares are normalised to the sum 1.
        let sum: f64 = out.iter().map(|s| s.weight).sum();
        if sum > 0.0 {
            out.iter_mut().for_each(|s| s.weight /= sum);
        } else {
            out.push(FluxSource {
                side: SourceSide::Across,
                velocity: lattice.cell_of(0.5 * (low + high) + rise, sign),
                weight: 1.0,
            });
        }
    }

    fn may_grow(&self) -> bool {
        false
    }
}

/// An interval of kinetic energies.
#[derive(Clone, Copy)]
struct EnergyInterval {
    low: f64,
    high: f64,
}

/// The energies of the velocity lattice, continued beyond the box.
struct Lattice<'a> {
    axis: &'a Axis,
    /// Energy of the face nearest to zero.
    floor: f64,
}

impl<'a> Lattice<'a> {
    fn new(axis: &'a Axis) -> Self {
        let nearest = axis.position(0.0).round() as i64;
        let face = axis.face(nearest);
        Self { axis, floor: 0.5 * face * face }
    }

    /// The kinetic energies of cell `j`.
    fn energies(&self, j: i64) -> EnergyInterval {
        let (a, b) = (self.axis.face(j), self.axis.face(j + 1));
        let (a, b) = (0.5 * a * a, 0.5 * b * b);
        EnergyInterval { low: a.min(b), high: a.max(b) }
    }

    /// The cell of velocities with `sign` that holds kinetic energy `energy` (at least the floor).
    fn cell_of(&self, energy: f64, sign: i64) -> i64 {
        let speed = (2.0 * energy.max(0.0)).sqrt();
        let at = self.axis.position(speed * sign as f64);
        at.clamp(-FARTHEST, FARTHEST).floor() as i64
    }

    /// Shares an interval of energies among the cells of velocities with `sign`; weights are
    /// overlaps over `length`.
    fn share(
        &self,
        out: &mut Vec<FluxSource>,
        side: SourceSide,
        sign: i64,
        EnergyInterval { low, high }: EnergyInterval,
        length: f64,
    ) {
        let mut k = self.cell_of(low, sign) - 2 * sign;
        let last = self.cell_of(high, sign) + 2 * sign;
        // Interval lengths below this are round-off of edges that coincide.
        let least = 1e-12 * length;
        while (last - k) * sign >= 0 {
            if velocity(self.axis, k) * sign as f64 > 0.0 {
                let cell = self.energies(k);
                let overlap = cell.high.min(high) - cell.low.max(low);
                if overlap > least {
                    out.push(FluxSource { side, velocity: k, weight: overlap / length });
                }
            }
            k += sign;
        }
    }
}
