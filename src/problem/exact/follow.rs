//! Follows a particle through the cells of `V`, from face to face.
//!
//! Back in time, `(x, −v)` obeys Newton's equations again. That motion is followed here, with
//! `w = −v`; forward in time, for measure-valued data ([`sheet`](super::sheet)), `w = v`. Where `V`
//! is quadratic along each axis in a cell, a particle moves there on a parabola, an oscillation or
//! an exponential (`motion`); where particles follow a formula, it is integrated (`orbit`). `V`
//! jumps at faces, where a particle obeys the rule of the scheme
//! (`scheme::interface`; `rise` is `V` before the face minus `V` behind it):
//!
//! ```text
//! w² + 2 rise > 0    transmitted; the normal speed becomes √(w² + 2 rise)
//! otherwise          reflected; the normal velocity becomes −w
//! ```
//!
//! On sets of measure zero, where the solution may jump, these rules hold:
//!
//! - A point on a face belongs to the cell above it.
//! - A particle that is on a face at time zero starts there with the velocity of the side to which
//!   it moves. Its initial value is that of the formula on the face; at the end of a periodic axis,
//!   on the end to which it was traced.
//! - If several faces are met at once, at an edge or a corner of a cell, that of the lowest axis is
//!   crossed first.
//!
//! Uses cells (`V`), motion and orbit (between faces), traced_grid (blocks without jumps).

use crate::base::row_major::number;
use crate::problem::exact::by_axes::REST;
use crate::problem::exact::cells::{FacePlace, TracedPotential, slopes};
use crate::problem::exact::motion::{Arrival, AxisMotion, CellForce, directed_ends};
use crate::problem::exact::orbit::{OrbitBound, OrbitState, Orbits};
use crate::problem::exact::traced_grid::free_layers;
use crate::problem::formula::Expression;
use crate::problem::grid::{Axis, AxisEnd, MAX_DIMENSION, PhaseSpace};
use std::cell::Cell;

/// Times closer than this fraction of the traced time are equal up to round-off. A face reached so
/// close to time zero is not crossed.
pub(super) const ROUND_OFF: f64 = 1e-13;
/// Least number of places along an axis of the box at which a formula of `V` is evaluated on a path
/// through it; a place in two cells if that is more.
const LEAST_PROBES: f64 = 64.0;
/// Steps through cells that take the time of an evaluation of a formula of `V`.
const STEPS_PER_EVALUATION: usize = 3;
/// A particle that ends closer to a face than this fraction of a cell is moved onto it.
const ON_FACE: f64 = 1e-11;

/// A path that was followed for a time: its end, and what the particle met.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct TracedPath {
    /// The point of phase space, `[x, y, z, vx, vy, vz]`.
    pub point: [f64; 6],
    /// The time that remained when the particle left the phase-space box; `None` if it did not.
    pub remaining: Option<f64>,
    /// The end of the box through which it left; `None` if it did not, or was outside from the
    /// start.
    pub exit: Option<BoxExit>,
    /// A hash of the jumps that the particle met, in order, and of whether they transmitted it.
    /// Among particles with the same hash, the point depends continuously on the start.
    pub history: u64,
    /// Number of turns around each periodic axis, upwards minus downwards.
    pub turns: [i32; MAX_DIMENSION],
    /// Parts of the path on which `V` is linear, of a tracer with linear cells: one more than the
    /// faces with a jump of `V` or of its slope that were met.
    pub segments: usize,
    /// Steps that were computed, each up to an end of a block of cells. An evaluation of a formula
    /// of `V` counts as several.
    pub steps: usize,
}

impl TracedPath {
    /// The path that ends at its first point, with this time left.
    pub(super) fn at_start(point: [f64; 6], remaining: f64) -> Self {
        Self { point, remaining: Some(remaining), segments: 1, ..Self::default() }
    }
}

/// The exit of a particle from the phase-space box.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct BoxExit {
    /// The end through which it left.
    pub end: AxisEnd,
    /// Whether a jump of `V` gave the particle a velocity outside of the box. Otherwise a slope
    /// did, or the particle moved out of the box in space.
    pub at_jump: bool,
}

/// A particle that meets a jump of `V`.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Crossing {
    /// The space axis.
    pub axis: usize,
    /// `V` before the face minus `V` behind it, at the centre of the face, where the scheme takes
    /// it.
    pub rise: f64,
    /// The normal velocity before.
    pub velocity: f64,
    /// The height of the jump at the place of the particle.
    pub height: f64,
    /// The normal kinetic energy on the side of the higher `V`; not positive where the particle
    /// cannot be transmitted.
    pub energy: f64,
    /// The region on that side; `None` if no region reflects in part, or if another side is the
    /// higher one at the centre of the face.
    pub higher: Option<usize>,
}

/// A particle that is traced.
pub(super) struct TracedParticle {
    /// The space cell it is in. The cell, and not `x`, tells on which side of a face the particle
    /// is, so that round-off in `x` does not matter.
    pub cell: [usize; MAX_DIMENSION],
    /// Position, never outside the cell.
    pub x: [f64; MAX_DIMENSION],
    /// Velocity in the direction of motion, `direction · v`.
    pub w: [f64; MAX_DIMENSION],
    /// Axes along which the particle rests at a face towards which both sides push it.
    rests: [bool; MAX_DIMENSION],
    /// Axes along which the particle is not moved, as its path is followed along another axis
    /// alone.
    held: [bool; MAX_DIMENSION],
    /// The length of the next step where the particle is followed by a formula of `V`.
    orbit_step: f64,
    /// What it met so far. The end is not known yet.
    path: TracedPath,
}

impl TracedParticle {
    /// This particle, which moves along `axis` alone.
    pub fn along(self, axis: usize) -> Self {
        let mut held = [true; MAX_DIMENSION];
        held[axis] = false;
        Self { rests: held, held, ..self }
    }
}

/// A block of cells that a particle crosses in one step, and the slopes of `V` in it.
struct FreeBlock<'a> {
    /// First and last cell along each axis.
    first: [usize; MAX_DIMENSION],
    last: [usize; MAX_DIMENSION],
    /// Lower and upper face along each axis.
    lower: [f64; MAX_DIMENSION],
    upper: [f64; MAX_DIMENSION],
    /// Slopes of `V` at the centre of the particle's cell.
    slopes: &'a [f64; MAX_DIMENSION],
    /// The motion of the particle along each axis.
    motions: [AxisMotion; MAX_DIMENSION],
}

/// The next event of a particle, on one axis.
#[derive(Clone, Copy)]
struct Event {
    /// Time until the event.
    time: f64,
    axis: usize,
    /// The new `w` on this axis.
    w: f64,
    /// The face at which it arrives, and whether that is the upper one; `None` if the velocity
    /// leaves its box.
    face: Option<(f64, bool)>,
}

/// The flow of the characteristics through cells.
#[derive(Clone, Debug)]
pub(super) struct Flow {
    /// The case's box in cells.
    pub space: PhaseSpace,
    /// `V` in the cells.
    pub potential: TracedPotential,
    /// `w = direction · v`: −1 back in time, 1 forward.
    pub direction: f64,
    /// `faces[a][i]` is the lower face of cell `i` on space axis `a`.
    pub faces: Vec<Vec<f64>>,
    /// Cells per unit of length along each space axis.
    cells_per_length: Vec<f64>,
    /// By space cell: the number of layers of cells around it in which `V` is the same function as
    /// in itself. A particle crosses this block of cells in one step.
    pub free: Vec<u32>,
    /// Bound on the number of faces a particle meets in unit time.
    face_rate: f64,
    /// The widths of the box, in space and then in velocity; 1 for absent axes.
    scales: OrbitState,
    /// Where a formula of `V` determines a path: the distances along each axis at which it is
    /// evaluated.
    probe_distances: [f64; MAX_DIMENSION],
    /// The length of the first step along such a path.
    first_step: f64,
}

impl Flow {
    /// The flow back in time in `potential`.
    pub fn new(potential: TracedPotential) -> Self {
        let space = potential.space.clone();
        let rate = |a: usize| {
            let (x, v) = (space.x[a].width(), &space.v[a]);
            let fastest = v.largest_magnitude();
            // A particle that returns to a face without resting on it takes at least the time
            // √(8 · REST · Δx / slope).
            fastest / x + (potential.steepest(a) / (8.0 * REST * x)).sqrt()
        };
        let face_rate = (0..space.dimension()).map(rate).sum();
        let free = free_layers(&potential);
        let faces = |axis: &Axis| (0..=axis.cells as i64).map(|i| axis.face(i)).collect();
        let faces: Vec<Vec<f64>> = space.x.iter().map(faces).collect();
        let cells_per_length = space.x.iter().map(|axis| 1.0 / axis.width()).collect();
        let mut scales = [1.0; 2 * MAX_DIMENSION];
        for (a, (x, v)) in space.x.iter().zip(&space.v).enumerate() {
            (scales[a], scales[MAX_DIMENSION + a]) = (x.upper - x.lower, v.upper - v.lower);
        }
        let mut probe_distances = [1.0; MAX_DIMENSION];
        for (distance, x) in probe_distances.iter_mut().zip(&space.x) {
            *distance = (2.0 * x.width()).min((x.upper - x.lower) / LEAST_PROBES);
        }
        // A part of the time to cross the box, and of that to fall through it.
        let shortest = |a: usize| {
            let fastest = space.v[a].largest_magnitude();
            (scales[a] / fastest).min((scales[a] / potential.steepest(a)).sqrt())
        };
        let first_step = (0..space.dimension()).map(shortest).fold(f64::INFINITY, f64::min) / 8.0;
        let direction = -1.0;
        Self {
            space,
            potential,
            direction,
            faces,
            cells_per_length,
            free,
            face_rate,
            scales,
            probe_distances,
            first_step,
        }
    }

    /// This flow, forward in time.
    pub fn forward(self) -> Self {
        Self { direction: 1.0, ..self }
    }

    /// The particle at `point`; `None` if that is outside of the box.
    pub fn start(&self, point: &[f64; 6]) -> Option<TracedParticle> {
        let space = &self.space;
        let mut particle = TracedParticle {
            cell: [0; MAX_DIMENSION],
            x: [0.0; MAX_DIMENSION],
            w: [0.0; MAX_DIMENSION],
            rests: [false; MAX_DIMENSION],
            held: [false; MAX_DIMENSION],
            orbit_step: self.first_step,
            path: TracedPath {
                history: 0xcbf2_9ce4_8422_2325,
                ..TracedPath::at_start(*point, 0.0)
            },
        };
        for a in 0..space.dimension() {
            // The outermost faces may differ from the ends of the box by round-off.
            particle.x[a] = point[a].clamp(self.faces[a][0], self.faces[a][space.x[a].cells]);
            particle.w[a] = self.direction * point[3 + a];
            let inside = space.x[a].lower <= point[a] && point[a] <= space.x[a].upper;
            if !inside || !self.speed_is_inside(&particle, a) {
                return None;
            }
            particle.cell[a] = self.cell_at(a, particle.x[a]);
        }
        Some(particle)
    }

    /// Follows a particle that is in the box. At every jump of `V`, `turns_back` says whether the
    /// particle is reflected although it could be transmitted.
    pub fn follow(
        &self,
        mut particle: TracedParticle,
        time: f64,
        turns_back: &mut dyn FnMut(&Crossing) -> bool,
    ) -> TracedPath {
        let mut left = time.max(0.0);
        let round_off = ROUND_OFF * left;
        for _ in 0..self.most_faces(left) {
            particle.path.steps += 1;
            let block = self.block(&particle);
            let Some(event) = self.move_to_event(&mut particle, &block, left, round_off) else {
                for a in 0..self.faces.len() {
                    particle.x[a] = self.snapped_to_face(a, particle.x[a]);
                }
                break;
            };
            left -= event.time;
            particle.w[event.axis] = event.w;
            let exit = match event.face {
                Some((face, upper)) => {
                    particle.x[event.axis] = face;
                    particle.cell = self.cell_at_face(&particle, &block, event.axis, upper);
                    let before = particle.path.history;
                    let exit = self.cross(&mut particle, event.axis, upper, turns_back);
                    let bends = !alike(block.slopes, self.potential.linear.slopes(&particle.cell));
                    let path = &mut particle.path;
                    path.segments += usize::from(bends || path.history != before);
                    exit
                }
                None => Some(self.velocity_end(&particle, event.axis, false)),
            };
            if exit.is_some() {
                return TracedPath { remaining: Some(left), exit, ..self.traced_path(&particle) };
            }
        }
        self.traced_path(&particle)
    }

    /// Number of faces that a particle may meet in `time`. One that meets more is not followed on.
    pub fn most_faces(&self, time: f64) -> usize {
        // Each face met along one axis may end a rest along another one, where the particle then
        // meets two faces before it rests again.
        (64.0 + 16.0 * self.face_rate * time) as usize
    }

    /// `x` on axis `a`, moved onto a face that it misses by round-off only.
    pub fn snapped_to_face(&self, a: usize, x: f64) -> f64 {
        let faces = &self.faces[a];
        let i = self.cell_at(a, x);
        let near = |face: &f64| (x - face).abs() < ON_FACE * (faces[i + 1] - faces[i]);
        [faces[i], faces[i + 1]].into_iter().find(near).unwrap_or(x)
    }

    /// Whether `x` is the coordinate of a face across axis `a`.
    pub fn is_on_face(&self, a: usize, x: f64) -> bool {
        let i = self.cell_at(a, x);
        self.faces[a][i..i + 2].contains(&x)
    }

    /// The cell along axis `a` that holds `x`, the upper one on a face.
    pub fn cell_at(&self, a: usize, x: f64) -> usize {
        let faces = &self.faces[a];
        let last = faces.len() - 2;
        // Round-off may make this one too large or too small.
        let i = (((x - faces[0]) * self.cells_per_length[a]) as usize).min(last);
        if x < faces[i] {
            i.saturating_sub(1)
        } else if x >= faces[i + 1] {
            last.min(i + 1)
        } else {
            i
        }
    }

    /// The block that the particle crosses in one step.
    fn block(&self, particle: &TracedParticle) -> FreeBlock<'_> {
        let axes = &self.space.x;
        let cells = axes.iter().map(|axis| axis.cells);
        let free = self.free[number(cells, particle.cell)] as usize;
        let mut block = FreeBlock {
            first: [0; MAX_DIMENSION],
            last: [0; MAX_DIMENSION],
            lower: [0.0; MAX_DIMENSION],
            upper: [0.0; MAX_DIMENSION],
            slopes: self.potential.linear.slopes(&particle.cell),
            motions: [AxisMotion::REST; MAX_DIMENSION],
        };
        let curvatures = self.potential.curvatures(&particle.cell);
        for (a, faces) in self.faces.iter().enumerate() {
            let i = particle.cell[a];
            let (first, last) = (i.saturating_sub(free), (i + free).min(faces.len() - 2));
            (block.first[a], block.last[a]) = (first, last);
            (block.lower[a], block.upper[a]) = (faces[first], faces[last + 1]);
            let centre = 0.5 * (faces[i] + faces[i + 1]);
            let force = CellForce { centre, slope: block.slopes[a], curvature: curvatures[a] };
            block.motions[a] = force.motion(particle.x[a], particle.w[a]);
        }
        block
    }

    /// Moves the particle to its next event within a time `left`; `None` if there is none, and the
    /// particle has moved for that time.
    fn move_to_event(
        &self,
        particle: &mut TracedParticle,
        block: &FreeBlock<'_>,
        left: f64,
        round_off: f64,
    ) -> Option<Event> {
        let in_time = |event: &Event| event.time < left - round_off;
        if let Some(formula) = self.potential.formula(&particle.cell) {
            return self.follow_orbit(particle, block, formula, left).filter(in_time);
        }
        let event = self.next_event(particle, block, round_off).filter(in_time);
        self.advance(particle, block, event.map_or(left, |event| event.time));
        event
    }

    /// Moves the particle under the force of `formula` for a time `left`, or to its first event.
    fn follow_orbit(
        &self,
        particle: &mut TracedParticle,
        block: &FreeBlock<'_>,
        formula: &Expression,
        left: f64,
    ) -> Option<Event> {
        let n = self.space.dimension();
        let rests = particle.rests;
        let moving = || (0..n).filter(|&a| !rests[a]);
        let mut state = [0.0; 2 * MAX_DIMENSION];
        state[..n].copy_from_slice(&particle.x[..n]);
        let mut bounds = [[f64::NEG_INFINITY, f64::INFINITY]; 2 * MAX_DIMENSION];
        for a in moving() {
            state[MAX_DIMENSION + a] = particle.w[a];
            bounds[a] = [block.lower[a], block.upper[a]];
            bounds[MAX_DIMENSION + a] = directed_ends(&self.space.v[a], self.direction);
        }
        let evaluations = Cell::new(0);
        let acceleration = |x: &[f64; MAX_DIMENSION]| {
            evaluations.set(evaluations.get() + 1);
            // Outside of the block the formula may be undefined.
            let within = || std::array::from_fn(|a| x[a].max(block.lower[a]).min(block.upper[a]));
            let slopes = slopes(formula, x)
                .or_else(|| slopes(formula, &within()))
                .unwrap_or([0.0; MAX_DIMENSION]);
            std::array::from_fn(|a| if a < n && !rests[a] { -slopes[a] } else { 0.0 })
        };
        let orbits = Orbits {
            acceleration,
            bounds,
            scales: self.scales,
            probe_distances: self.probe_distances,
        };
        let end = orbits.follow(state, left, &mut particle.orbit_step);
        particle.path.steps += STEPS_PER_EVALUATION * evaluations.get();
        for a in moving() {
            particle.x[a] = end.state[a].max(block.lower[a]).min(block.upper[a]);
            particle.w[a] = end.state[MAX_DIMENSION + a];
        }
        let OrbitBound { coordinate, upper } = end.bound?;
        let axis = coordinate % MAX_DIMENSION;
        let face = if upper { block.upper[axis] } else { block.lower[axis] };
        let face = (coordinate < MAX_DIMENSION).then_some((face, upper));
        Some(Event { time: end.time, axis, w: particle.w[axis], face })
    }

    /// The first event along any axis on which the particle moves. Of events within `round_off` of
    /// each other, an arrival at a face comes first, and then the lowest axis.
    fn next_event(
        &self,
        particle: &TracedParticle,
        block: &FreeBlock<'_>,
        round_off: f64,
    ) -> Option<Event> {
        let mut first: Option<Event> = None;
        let mut take = |event: Event| {
            if first.is_none_or(|f| event.time < f.time - round_off) {
                first = Some(event);
            }
        };
        let moving = || (0..self.space.dimension()).filter(|&a| !particle.rests[a]);
        for a in moving() {
            let (lower, upper) = (block.lower[a], block.upper[a]);
            let Arrival { time, w, at_upper } = block.motions[a].arrival(lower, upper);
            let end = if at_upper { upper } else { lower };
            take(Event { time, axis: a, w, face: Some((end, at_upper)) });
        }
        for a in moving() {
            let [lower, upper] = directed_ends(&self.space.v[a], self.direction);
            let motion = block.motions[a];
            if motion.may_leave(lower, upper) {
                let Arrival { time, at_upper, .. } = motion.of_velocity().arrival(lower, upper);
                take(Event { time, axis: a, w: if at_upper { upper } else { lower }, face: None });
            }
        }
        first
    }

    /// Moves the particle for a time in which it stays in the block, up to round-off.
    fn advance(&self, particle: &mut TracedParticle, block: &FreeBlock<'_>, time: f64) {
        for a in 0..self.space.dimension() {
            if !particle.rests[a] {
                let [x, w] = block.motions[a].after(time);
                particle.x[a] = x.max(block.lower[a]).min(block.upper[a]);
                particle.w[a] = w;
            }
        }
    }

    /// Transmits, reflects or rests a particle that has arrived at its cell's upper or lower face
    /// along `a`. Returns the end of the phase-space box, if it leaves through one.
    fn cross(
        &self,
        particle: &mut TracedParticle,
        a: usize,
        upper: bool,
        turns_back: &mut dyn FnMut(&Crossing) -> bool,
    ) -> Option<BoxExit> {
        let i = particle.cell[a];
        let step = if upper { 1 } else { -1 };
        let outward = f64::from(step);
        let beyond = i as i64 + i64::from(step);
        let Some(there) = self.space.wrap(a, beyond) else {
            return Some(BoxExit { end: AxisEnd { axis: a, upper }, at_jump: false });
        };
        let rise = self.rise(particle, a, upper, there);
        let reach_before = self.reach(particle, a, outward);
        let square = particle.w[a] * particle.w[a] + 2.0 * rise;
        let (mut crosses, mut by_chance) = (rise == 0.0 || square > 0.0, false);
        if rise != 0.0 {
            let at_centre = self.rise_at_centre(&particle.cell, a, upper);
            let kind = self.potential.linear.jump_kind(&particle.cell, a, upper);
            let met = Crossing {
                axis: a,
                rise: at_centre,
                velocity: self.direction * particle.w[a],
                height: rise.abs(),
                energy: 0.5 * square.min(particle.w[a] * particle.w[a]),
                higher: kind.higher.filter(|_| rise * at_centre > 0.0),
            };
            let turns_back = turns_back(&met);
            by_chance = crosses && turns_back;
            crosses &= !by_chance;
            let face = 2 * (i + usize::from(upper)) + usize::from(crosses);
            let history = &mut particle.path.history;
            *history = append(*history, (MAX_DIMENSION * face + a) as u64);
        }
        let reach_after = if crosses {
            particle.cell[a] = there;
            if there as i64 != beyond {
                particle.path.turns[a] += step;
                particle.x[a] = self.faces[a][if upper { 0 } else { there + 1 }];
            }
            // Other slopes may hold here.
            particle.rests = particle.held;
            if rise != 0.0 {
                particle.w[a] = outward * square.sqrt();
            }
            self.reach(particle, a, -outward)
        } else {
            particle.w[a] = -particle.w[a];
            reach_before
        };
        // One that was reflected by chance may be transmitted when it comes back.
        let is_slow = reach_before.max(reach_after) < REST * self.space.x[a].width();
        particle.rests[a] = is_slow && !by_chance;
        let stays = self.speed_is_inside(particle, a);
        (!stays).then(|| self.velocity_end(particle, a, true))
    }

    /// `V` before the upper or lower face of `cell` along `a` minus `V` behind it, at the centre of
    /// the face.
    fn rise_at_centre(&self, cell: &[usize; MAX_DIMENSION], a: usize, upper: bool) -> f64 {
        let potential = &self.potential.linear;
        if upper { -potential.jump_above(cell, a) } else { potential.jump_below(cell, a) }
    }

    /// `V` before a face that the particle has reached minus `V` behind it, in cell `there` along
    /// `a`, at the place of the particle. It differs from that at the centre of the face where `V`
    /// has other slopes along the face behind it than before it. Zero where no face of a jump is
    /// near, but for formulas: there the cells of a curved `V` do not fit together, and no particle
    /// is to meet that.
    pub fn rise(&self, particle: &TracedParticle, a: usize, upper: bool, there: usize) -> f64 {
        let cell = &particle.cell;
        let mut behind = *cell;
        behind[a] = there;
        let [mut from, mut to] = [particle.x; 2];
        from[a] = self.faces[a][cell[a] + usize::from(upper)];
        to[a] = self.faces[a][there + usize::from(!upper)];
        let sides = [FacePlace { cell, x: &from }, FacePlace { cell: &behind, x: &to }];
        if let Some(rise) = self.potential.rise_by_formulas(a, sides) {
            return rise;
        }
        let [slopes, slopes_behind] =
            [cell, &behind].map(|cell| self.potential.linear.slopes(cell));
        let [bends, bends_behind] = [cell, &behind].map(|cell| self.potential.curvatures(cell));
        let differs = |b: usize| slopes[b] != slopes_behind[b] || bends[b] != bends_behind[b];
        let mut rise = self.rise_at_centre(cell, a, upper);
        let mut is_jump = rise != 0.0;
        for b in (0..self.space.dimension()).filter(|&b| b != a && differs(b)) {
            let [before, beyond] = [cell, &behind].map(|cell| self.potential.force(cell, b));
            let own = cell[b] as i64;
            rise -= beyond.rise_to(particle.x[b]) - before.rise_to(particle.x[b]);
            let mut neighbours =
                [own - 1, own + 1].into_iter().filter_map(|j| self.space.wrap(b, j));
            is_jump |= neighbours.any(|j| {
                let mut beside = *cell;
                beside[b] = j;
                self.rise_at_centre(&beside, a, upper) != 0.0
            });
        }
        if is_jump { rise } else { 0.0 }
    }

    /// The cell, within `block`, of a particle that has arrived at the block's upper or lower face
    /// along `a`.
    fn cell_at_face(
        &self,
        particle: &TracedParticle,
        block: &FreeBlock<'_>,
        a: usize,
        upper: bool,
    ) -> [usize; MAX_DIMENSION] {
        let mut cell = particle.cell;
        for (b, i) in cell.iter_mut().enumerate().take(self.space.dimension()) {
            let (first, last) = (block.first[b], block.last[b]);
            *i = if b != a {
                self.cell_at(b, particle.x[b]).clamp(first, last)
            } else if upper {
                last
            } else {
                first
            };
        }
        cell
    }

    /// The distance by which a particle at a face can move away from the face within its cell:
    /// `w²/(2|slope|)` if the slope pushes it back in the direction `to_face`, else infinity.
    fn reach(&self, particle: &TracedParticle, a: usize, to_face: f64) -> f64 {
        let mut at_face = particle.x;
        at_face[a] = self.faces[a][particle.cell[a] + usize::from(to_face > 0.0)];
        let push = -self.potential.slope_at(&particle.cell, a, &at_face) * to_face;
        if push > 0.0 { particle.w[a] * particle.w[a] / (2.0 * push) } else { f64::INFINITY }
    }

    fn speed_is_inside(&self, particle: &TracedParticle, a: usize) -> bool {
        let v = &self.space.v[a];
        (v.lower..=v.upper).contains(&(self.direction * particle.w[a]))
    }

    /// The end of the velocity box along axis `a` through which a particle leaves: the nearer one.
    fn velocity_end(&self, particle: &TracedParticle, a: usize, at_jump: bool) -> BoxExit {
        let v = &self.space.v[a];
        let velocity = self.direction * particle.w[a];
        let upper = (velocity - v.lower).abs() > (v.upper - velocity).abs();
        BoxExit { end: AxisEnd { axis: self.space.dimension() + a, upper }, at_jump }
    }

    /// The end of the path of a particle that is still in the box.
    fn traced_path(&self, particle: &TracedParticle) -> TracedPath {
        let mut point = [0.0; 6];
        for a in 0..self.space.dimension() {
            point[a] = particle.x[a];
            // Adding zero turns the −0 of a particle at rest into 0.
            point[3 + a] = 0.0 + self.direction * particle.w[a];
        }
        TracedPath { point, remaining: None, ..particle.path }
    }
}

/// Whether two slopes of `V` are equal up to round-off.
fn alike(a: &[f64; MAX_DIMENSION], b: &[f64; MAX_DIMENSION]) -> bool {
    const ROUND_OFF: f64 = 1e-9;
    let near = |(a, b): (&f64, &f64)| (a - b).abs() <= ROUND_OFF * a.abs().max(b.abs());
    a == b || a.iter().zip(b).all(near)
}

/// A history with one more event (FNV-1a, over words).
fn append(history: u64, event: u64) -> u64 {
    (history ^ event).wrapping_mul(0x0100_0000_01b3)
}
