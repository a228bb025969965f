//! Particles whose motions along the axes are independent of each other.
//!
//! If the slopes and jumps of `V` along each axis depend on the position along that axis alone, so
//! does the motion. Then particles that agree in `(x_a, v_a)` are followed along axis `a` only
//! once, and the points of a quadrature in several dimensions share a few paths. That saves most of
//! the work where `V` has slopes, as each cell is an event there.
//!
//! [`AxisLine`] follows such a particle by one slope per cell and one jump per face, with the rules
//! of [`Tracer::follow`](super::Tracer::follow), which takes over in rare situations.

use crate::problem::grid::{MAX_DIMENSION, PhaseSpace, for_each_cell};
use crate::problem::potential::Potential;
use std::cell::RefCell;
use std::collections::HashMap;

/// A particle that cannot move further from a face than this fraction of a cell, on either side,
/// rests on it. Its velocity has an error of up to `√(8 · REST · Δx · slope)` then.
pub(super) const REST: f64 = 1e-12;
/// Slopes and jumps that differ by less than this part of the largest are equal up to round-off.
const SAME: f64 = 1e-11;
/// Largest number of stored paths.
const MOST_PATHS: usize = 1 << 18;

/// A path along an axis: the axis, and the bits of position, velocity and time.
type Path = [u64; 4];

/// Paths that were followed, with position and velocity at their end, or `None` if they leave the
/// box.
#[derive(Clone, Debug, Default)]
pub(super) struct AxisPaths(RefCell<HashMap<Path, Option<[f64; 2]>>>);

/// The end of a particle's path.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) enum EndByAxes {
    /// The particle is in the box, at this point of phase space.
    Inside([f64; 6]),
    /// The particle leaves the box.
    Leaves,
}

/// Whether there is more than one dimension, `V` has slopes, and motions along the axes are
/// independent of each other.
pub(super) fn moves_by_axes(space: &PhaseSpace, potential: &Potential) -> bool {
    let n = space.dimension();
    let ranges = space.space_ranges();
    let mut largest = [0.0f64; MAX_DIMENSION];
    for_each_cell(&ranges, |i| {
        for (a, largest) in largest.iter_mut().enumerate().take(n) {
            *largest = largest.max(potential.jump_below(i, a).abs());
        }
    });
    let steepest: Vec<f64> = (0..n).map(|a| potential.steepest(a)).collect();
    let mut same = n > 1 && steepest.iter().any(|slope| *slope != 0.0);
    if !same {
        return false;
    }
    for_each_cell(&ranges, |i| {
        for a in 0..n {
            let mut alone = [0; MAX_DIMENSION];
            alone[a] = i[a];
            let slopes = [i, &alone].map(|i| potential.slope(i, a));
            let jumps = [i, &alone].map(|i| potential.jump_below(i, a));
            same &= (slopes[0] - slopes[1]).abs() <= SAME * steepest[a];
            same &= (jumps[0] - jumps[1]).abs() <= SAME * largest[a];
            same &= (jumps[0] == 0.0) == (jumps[1] == 0.0);
        }
    });
    same
}

/// A particle that moves along an axis.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct LineParticle {
    /// The cell in which the particle is.
    pub cell: usize,
    /// Position of the particle, within the cell.
    pub x: f64,
    /// Velocity in the direction of motion, `direction · v`.
    pub w: f64,
    /// The time for which the particle is still to be followed.
    pub left: f64,
}

/// Faces, slopes and jumps along an axis on which they depend on the position along it alone.
#[derive(Clone, Debug)]
pub(super) struct AxisLine {
    faces: Vec<f64>,
    /// `∂V/∂x` by cell.
    slopes: Vec<f64>,
    /// `V⁺ − V⁻` by face, the lowest first, zero at the ends.
    jumps: Vec<f64>,
    /// By cell without a slope: the first and the last cell of the run of such cells around it that
    /// no jump interrupts.
    flat: Vec<[usize; 2]>,
    /// Whether the axis is periodic: the first cell follows the last one.
    is_periodic: bool,
    /// Least and largest velocity.
    box_ends: [f64; 2],
    /// A particle with `w²` up to this may come to rest at a face.
    rest: f64,
}

/// The outcome for a particle that has arrived at a face.
enum AtFace {
    /// The particle moves on in the box.
    Goes,
    /// The particle leaves the box.
    Leaves,
    /// Only [`Tracer::follow`](super::Tracer::follow) can tell.
    Rare,
}

impl AxisLine {
    /// All axes of `space`, with these `faces`; no axis if a velocity box does not contain zero.
    /// Velocities are `w = direction · v`.
    pub(super) fn all(
        space: &PhaseSpace,
        potential: &Potential,
        faces: &[Vec<f64>],
        direction: f64,
    ) -> Vec<Self> {
        let line = |a: usize| {
            let cells = faces[a].len() - 1;
            let at = |i: usize| {
                let mut cell = [0; MAX_DIMENSION];
                cell[a] = i;
                cell
            };
            let inside = |i: usize| 0 < i && i < cells;
            let jump = |i: usize| if inside(i) { potential.jump_below(&at(i), a) } else { 0.0 };
            let slopes: Vec<f64> = (0..cells).map(|i| potential.slope(&at(i), a)).collect();
            let jumps: Vec<f64> = (0..=cells).map(jump).collect();
            let goes_on = |i: usize| slopes[i - 1] == 0.0 && slopes[i] == 0.0 && jumps[i] == 0.0;
            let mut flat: Vec<[usize; 2]> = (0..cells).map(|i| [i, i]).collect();
            for i in (1..cells).filter(|i| goes_on(*i)) {
                flat[i][0] = flat[i - 1][0];
            }
            for i in (1..cells).rev().filter(|i| goes_on(*i)) {
                flat[i - 1][1] = flat[i][1];
            }
            let ends = [space.v[a].lower, space.v[a].upper].map(|v| direction * v);
            Self {
                faces: faces[a].clone(),
                slopes,
                jumps,
                flat,
                is_periodic: space.is_periodic(a),
                box_ends: [ends[0].min(ends[1]), ends[0].max(ends[1])],
                rest: 8.0 * REST * space.x[a].width() * potential.steepest(a),
            }
        };
        if space.v.iter().all(|v| v.lower <= 0.0 && v.upper >= 0.0) {
            (0..space.dimension()).map(line).collect()
        } else {
            Vec::new()
        }
    }

    /// The particle when no time is left, or when it leaves the box. `None` if it may come to rest
    /// at a face, leaves its velocity box within a cell, goes around a periodic axis, or meets more
    /// than `most` faces.
    pub(super) fn follow(
        &self,
        start: LineParticle,
        round_off: f64,
        most: usize,
    ) -> Option<LineParticle> {
        let mut particle = start;
        for _ in 0..most {
            let LineParticle { cell, x, w, left } = particle;
            let up = w > 0.0;
            let face = if self.slopes[cell] == 0.0 {
                let [first, last] = self.flat[cell];
                let (lower, upper) = (self.faces[first], self.faces[last + 1]);
                let ahead = if up { upper - x } else { x - lower };
                let time = ahead / w.abs();
                // A particle at rest stays, even on a face.
                if w == 0.0 || time >= left - round_off {
                    let x = (x + w * left).max(lower).min(upper);
                    return Some(LineParticle { x, left: 0.0, ..particle });
                }
                particle.left -= time;
                if up { last + 1 } else { first }
            } else {
                if w == 0.0 || !self.glide(&mut particle, round_off) {
                    return None;
                }
                if particle.left == 0.0 {
                    return Some(particle);
                }
                particle.cell + usize::from(particle.w > 0.0)
            };
            match self.meet(&mut particle, face) {
                AtFace::Goes => {}
                AtFace::Leaves => return Some(particle),
                AtFace::Rare => return None,
            }
        }
        None
    }

    /// Moves a particle through cells with slopes until its time ends, or up to a face with a jump,
    /// at an end of the box or of a cell without a slope. Its cell is then that before the face.
    /// Returns false if only [`Tracer::follow`](super::Tracer::follow) can tell.
    fn glide(&self, particle: &mut LineParticle, round_off: f64) -> bool {
        let LineParticle { cell: mut i, mut x, mut w, mut left } = *particle;
        let fastest = |sign: f64| if sign > 0.0 { self.box_ends[1] } else { -self.box_ends[0] };
        let mut sign = w.signum();
        let (mut square, mut speed) = (w * w, w.abs());
        loop {
            let (up, slope) = (sign > 0.0, self.slopes[i]);
            let [behind, ahead] = if up {
                [x - self.faces[i], self.faces[i + 1] - x]
            } else {
                [self.faces[i + 1] - x, x - self.faces[i]]
            };
            let push = -sign * slope;
            let turns = square + 2.0 * push * ahead <= 0.0;
            let gain = if turns { -push * behind } else { push * ahead };
            let next = square + 2.0 * gain;
            let there = next.sqrt();
            let time = if turns { (speed + there) / -push } else { 2.0 * ahead / (speed + there) };
            let out = if turns { -sign } else { sign };
            if time >= left - round_off {
                w = sign * speed;
                x = (x + left * (w - 0.5 * slope * left)).max(self.faces[i]).min(self.faces[i + 1]);
                w -= slope * left;
                *particle = LineParticle { cell: i, x, w, left: 0.0 };
                return (self.box_ends[0]..=self.box_ends[1]).contains(&w);
            }
            if there >= fastest(out) || next <= self.rest {
                return false;
            }
            left -= time;
            (sign, square, speed) = (out, next, there);
            let face = i + usize::from(sign > 0.0);
            x = self.faces[face];
            let end = face == 0 || face + 1 == self.faces.len();
            let beyond = if sign > 0.0 { i + 1 } else { i.wrapping_sub(1) };
            if end || self.jumps[face] != 0.0 || self.slopes[beyond] == 0.0 {
                *particle = LineParticle { cell: i, x, w: sign * speed, left };
                return true;
            }
            i = beyond;
        }
    }

    /// Transmits or reflects a particle that has arrived at a face.
    fn meet(&self, particle: &mut LineParticle, face: usize) -> AtFace {
        let up = particle.w > 0.0;
        particle.x = self.faces[face];
        if face == 0 || face + 1 == self.faces.len() {
            return if self.is_periodic { AtFace::Rare } else { AtFace::Leaves };
        }
        let [here, there] = if up { [face - 1, face] } else { [face, face - 1] };
        particle.cell = there;
        if self.jumps[face] == 0.0 {
            return AtFace::Goes;
        }
        // V before the face minus V behind it.
        let rise = if up { -self.jumps[face] } else { self.jumps[face] };
        let square = particle.w * particle.w + 2.0 * rise;
        if square > 0.0 {
            particle.w = square.sqrt().copysign(particle.w);
        } else {
            (particle.cell, particle.w) = (here, -particle.w);
        }
        let slow = particle.w * particle.w <= self.rest;
        if slow {
            AtFace::Rare
        } else if (self.box_ends[0]..=self.box_ends[1]).contains(&particle.w) {
            AtFace::Goes
        } else {
            AtFace::Leaves
        }
    }
}

impl AxisPaths {
    /// The end of the path from `point` after `time` along the first `axes` axes. Unknown paths are
    /// followed by `follow(axis, [x, v])`, which returns `[x, v]` at the end, or `None` if the
    /// particle leaves the box.
    pub(super) fn end(
        &self,
        axes: usize,
        point: &[f64; 6],
        time: f64,
        follow: impl Fn(usize, [f64; 2]) -> Option<[f64; 2]>,
    ) -> EndByAxes {
        let mut end = [0.0; 6];
        for a in 0..axes {
            let (x, v) = (point[a], point[3 + a]);
            let path = [a as u64, x.to_bits(), v.to_bits(), time.to_bits()];
            let known = self.0.borrow().get(&path).copied();
            let found = known.unwrap_or_else(|| {
                let found = follow(a, [x, v]);
                let mut paths = self.0.borrow_mut();
                if paths.len() == MOST_PATHS {
                    paths.clear();
                }
                paths.insert(path, found);
                found
            });
            let Some([x, v]) = found else { return EndByAxes::Leaves };
            (end[a], end[3 + a]) = (x, v);
        }
        EndByAxes::Inside(end)
    }
}
