//! Particles whose motions along the axes are independent of each other.
//!
//! If the slopes and jumps of `V` along each axis depend on the position along that axis alone, so
//! does the motion. Then particles that agree in `(x_a, v_a)` are followed along axis `a` only
//! once, and the points of a quadrature in several dimensions share a few paths. That saves most of
//! the work where `V` is approximated, as each cell is an event there.
//!
//! [`AxisLine`] follows such a particle from piece to piece of `V`, with the rules of
//! [`Tracer::follow`](super::Tracer::follow), which takes over in rare situations.

use crate::problem::exact::cells::TracedPotential;
use crate::problem::exact::motion::{AxisMotion, CellForce, directed_ends};
use crate::problem::grid::{MAX_DIMENSION, for_each_cell};
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
/// box. Without a map none is stored: random particles share no paths.
#[derive(Clone, Debug)]
pub(super) struct AxisPaths(Option<RefCell<HashMap<Path, Option<[f64; 2]>>>>);

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
pub(super) fn moves_by_axes(traced: &TracedPotential) -> bool {
    let space = &traced.space;
    let n = space.dimension();
    let ranges = space.space_ranges();
    let jumps = traced.linear.largest_jumps(space);
    let largest = jumps.map(|jump| jump.map_or(0.0, |jump| jump.height));
    let steepest: Vec<f64> = (0..n).map(|a| traced.steepest(a)).collect();
    let mut same = n > 1 && steepest.iter().any(|slope| *slope != 0.0);
    if !same {
        return false;
    }
    for_each_cell(&ranges, |i| {
        for a in 0..n {
            let mut alone = [0; MAX_DIMENSION];
            alone[a] = i[a];
            let slopes = [i, &alone].map(|i| traced.linear.slope(i, a));
            let bent = [i, &alone].map(|i| traced.curvatures(i)[a] * space.x[a].width());
            let jumps = [i, &alone].map(|i| traced.linear.jump_below(i, a));
            same &= (slopes[0] - slopes[1]).abs() <= SAME * steepest[a];
            same &= (bent[0] - bent[1]).abs() <= SAME * steepest[a];
            same &= (jumps[0] - jumps[1]).abs() <= SAME * largest[a];
            same &= (jumps[0] == 0.0) == (jumps[1] == 0.0);
        }
    });
    same
}

/// A particle that moves along an axis.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct LineParticle {
    /// The piece of `V` in which the particle is.
    pub piece: usize,
    /// Position of the particle, within the piece.
    pub x: f64,
    /// Velocity in the direction of motion, `direction · v`.
    pub w: f64,
    /// The time for which the particle is still to be followed.
    pub left: f64,
}

impl LineParticle {
    /// Whether this particle, behind a face, is where it was at another time, up to round-off.
    fn is_again(&self, other: &Self) -> bool {
        let differs = (self.w - other.w).abs() > SAME * other.w.abs();
        (self.piece, self.x) == (other.piece, other.x) && !differs
    }
}

/// A part of an axis on which `V` is one quadratic function: a cell, or several.
#[derive(Clone, Copy, Debug)]
struct AxisPiece {
    lower: f64,
    upper: f64,
    force: CellForce,
}

impl AxisPiece {
    /// Whether the force vanishes inside of the piece and drives particles to that place.
    fn has_well(&self) -> bool {
        let [lower, upper] = [self.lower, self.upper].map(|x| self.force.slope_at(x));
        self.force.curvature > 0.0 && lower < 0.0 && upper > 0.0
    }

    /// One piece instead of successive `pieces` of equal widths, and whether it has their slopes up
    /// to `tolerance`.
    fn joined(pieces: &[Self], tolerance: f64) -> (Self, bool) {
        let [first, last] = [pieces[0], pieces[pieces.len() - 1]];
        let (lower, upper) = (first.lower, last.upper);
        let slopes = pieces.iter().map(|piece| piece.force.slope);
        let slope = slopes.sum::<f64>() / pieces.len() as f64;
        let is_bent = pieces.iter().any(|piece| piece.force.curvature != 0.0);
        let curvature = if is_bent && pieces.len() > 1 {
            (last.force.slope - first.force.slope) / (last.force.centre - first.force.centre)
        } else {
            first.force.curvature
        };
        let force = CellForce { centre: 0.5 * (lower + upper), slope, curvature };
        let misses = |of: &CellForce| (force.slope_at(of.centre) - of.slope).abs() > tolerance;
        let fits = !pieces.iter().any(|piece| misses(&piece.force));
        (Self { lower, upper, force }, fits)
    }
}

/// Faces, slopes and jumps along an axis on which they depend on the position along it alone.
#[derive(Clone, Debug)]
pub(super) struct AxisLine {
    pieces: Vec<AxisPiece>,
    /// The piece of each cell.
    pub(super) of_cell: Vec<usize>,
    /// `V⁺ − V⁻` by end of a piece, the lowest first. That of both ends of a periodic axis is the
    /// same, and zero at the ends of another one.
    jumps: Vec<f64>,
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
    /// All axes, for motion back in time; none if a velocity box does not contain zero.
    pub(super) fn all(potential: &TracedPotential) -> Vec<Self> {
        let space = &potential.space;
        if space.v.iter().all(|v| v.lower <= 0.0 && v.upper >= 0.0) {
            (0..space.dimension()).map(|a| Self::along(potential, a)).collect()
        } else {
            Vec::new()
        }
    }

    /// The line through the first cells of the other axes.
    fn along(potential: &TracedPotential, a: usize) -> Self {
        let space = &potential.space;
        let axis = &space.x[a];
        let at = |i: usize| {
            let mut cell = [0; MAX_DIMENSION];
            cell[a] = i;
            cell
        };
        let cell = |i: usize| AxisPiece {
            lower: axis.face(i as i64),
            upper: axis.face(i as i64 + 1),
            force: potential.force(&at(i), a),
        };
        let cells: Vec<AxisPiece> = (0..axis.cells).map(cell).collect();
        // Zero at the ends of an axis that is not periodic.
        let jump = |i: usize| potential.linear.jump_below(&at(i % axis.cells), a);
        let tolerance = SAME * potential.steepest(a);
        let goes_on = |i: usize| {
            let [below, above] = [&cells[i - 1], &cells[i]];
            let bend = above.force.slope_at(above.lower) - below.force.slope_at(below.upper);
            let change = (above.force.curvature - below.force.curvature) * axis.width();
            jump(i) == 0.0 && bend.abs() <= tolerance && change.abs() <= tolerance
        };
        let (mut pieces, mut of_cell, mut jumps) = (Vec::new(), Vec::new(), vec![jump(0)]);
        let mut first = 0;
        while first < axis.cells {
            let end = (first + 1..axis.cells).find(|&i| !goes_on(i)).unwrap_or(axis.cells);
            let (joined, fits) = AxisPiece::joined(&cells[first..end], 16.0 * tolerance);
            let end = if fits { end } else { first + 1 };
            pieces.push(if fits { joined } else { cells[first] });
            of_cell.resize(end, pieces.len() - 1);
            jumps.push(jump(end));
            first = end;
        }
        Self {
            pieces,
            of_cell,
            jumps,
            is_periodic: space.is_periodic(a),
            box_ends: directed_ends(&space.v[a], -1.0),
            rest: 8.0 * REST * axis.width() * potential.steepest(a),
        }
    }

    /// The particle when no time is left, or when it leaves the box. `None` if it may come to rest
    /// at a face, leaves its velocity box within a piece, or meets more than `most` faces.
    ///
    /// Whole periods of a closed path are left out.
    pub(super) fn follow(
        &self,
        start: LineParticle,
        round_off: f64,
        most: usize,
    ) -> Option<LineParticle> {
        let mut particle = start;
        // The particle at the first face, and the time since then.
        let (mut first, mut since): (Option<LineParticle>, f64) = (None, 0.0);
        let is_inside = |w: f64| self.box_ends[0] < w && w < self.box_ends[1];
        for _ in 0..most {
            let LineParticle { piece, x, w, left } = particle;
            let here = &self.pieces[piece];
            let motion = here.force.motion(x, w);
            if w == 0.0 && motion.acceleration != 0.0 {
                return None;
            }
            let next = motion.arrival(here.lower, here.upper);
            let is_last = next.time >= left - round_off;
            if here.has_well() && self.leaves_velocities(&motion, next.time.min(left)) {
                return None;
            }
            if is_last {
                let [x, w] = motion.after(left);
                let x = x.max(here.lower).min(here.upper);
                let is_free = motion.acceleration == 0.0 && motion.curvature == 0.0;
                let end = LineParticle { piece, x, w, left: 0.0 };
                return (is_free || is_inside(w)).then_some(end);
            }
            let changes = next.w != w;
            if changes && (!is_inside(next.w) || next.w * next.w <= self.rest) {
                return None;
            }
            particle.left -= next.time;
            particle.w = next.w;
            match self.meet(&mut particle, piece + usize::from(next.at_upper)) {
                AtFace::Goes => {}
                AtFace::Leaves => return Some(particle),
                AtFace::Rare => return None,
            }
            since += next.time;
            match first {
                None => (first, since) = (Some(particle), 0.0),
                Some(start) if particle.left > since && particle.is_again(&start) => {
                    // A particle that ends at a face stays before it.
                    let rest = particle.left % since;
                    particle.left = if rest > round_off { rest } else { rest + since };
                    since = 0.0;
                }
                Some(_) => {}
            }
        }
        None
    }

    /// Whether a velocity leaves its box within a time.
    fn leaves_velocities(&self, motion: &AxisMotion, time: f64) -> bool {
        let [lower, upper] = self.box_ends;
        motion.may_leave(lower, upper) && motion.of_velocity().arrival(lower, upper).time <= time
    }

    /// Transmits or reflects a particle that has arrived at a face.
    fn meet(&self, particle: &mut LineParticle, face: usize) -> AtFace {
        let up = particle.w > 0.0;
        let pieces = self.pieces.len();
        let end_of = |piece: usize, is_upper: bool| {
            let AxisPiece { lower, upper, .. } = self.pieces[piece];
            if is_upper { upper } else { lower }
        };
        let [below, above] = [(face + pieces - 1) % pieces, face % pieces];
        let [here, there] = if up { [below, above] } else { [above, below] };
        if (face == 0 || face == pieces) && !self.is_periodic {
            particle.x = end_of(here, up);
            return AtFace::Leaves;
        }
        (particle.piece, particle.x) = (there, end_of(there, !up));
        if self.jumps[face] == 0.0 {
            return AtFace::Goes;
        }
        // V before the face minus V behind it.
        let rise = if up { -self.jumps[face] } else { self.jumps[face] };
        let square = particle.w * particle.w + 2.0 * rise;
        if square > 0.0 {
            particle.w = square.sqrt().copysign(particle.w);
        } else {
            particle.w = -particle.w;
            (particle.piece, particle.x) = (here, end_of(here, up));
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
    /// For particles that share paths.
    pub(super) fn shared() -> Self {
        Self(Some(RefCell::default()))
    }

    /// For random particles.
    pub(super) fn not_shared() -> Self {
        Self(None)
    }

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
            let known = self.0.as_ref().and_then(|paths| paths.borrow().get(&path).copied());
            let found = known.unwrap_or_else(|| {
                let found = follow(a, [x, v]);
                if let Some(paths) = &self.0 {
                    let mut paths = paths.borrow_mut();
                    if paths.len() == MOST_PATHS {
                        paths.clear();
                    }
                    paths.insert(path, found);
                }
                found
            });
            let Some([x, v]) = found else { return EndByAxes::Leaves };
            (end[a], end[3 + a]) = (x, v);
        }
        EndByAxes::Inside(end)
    }
}
