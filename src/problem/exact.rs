//! The exact solution, by tracing particles back through `V`.
//!
//! The density is constant along the characteristics `x' = v`, `v' = −∇V(x)`, and across a jump of
//! `V` when the normal velocity changes so that `v²/2 + V` is kept: `f(t, x⁺, v⁺) = f(t, x⁻, v⁻)`
//! (paper, section 2). So `f(T, x, v)` is the initial value at the foot of the characteristic
//! through `(x, v)`, or the inflow value at the point of the phase-space box through which it came
//! in.
//!
//! `follow` moves a particle through the cells, back or forward in time, with the rules at faces;
//! `by_axes` shares paths among particles where motions along the axes are independent. `V` in the
//! cells is that of `cells`, and `traced_grid` chooses them. [`sheet`] follows measure-valued data
//! forward.

mod by_axes;
mod cells;
mod follow;
mod motion;
mod orbit;
pub mod sheet;
mod traced_grid;

use crate::base::error::Result;
use crate::problem::case::{Case, Inflow};
use crate::problem::exact::by_axes::{AxisLine, AxisPaths, EndByAxes, LineParticle, moves_by_axes};
use crate::problem::exact::cells::TracedPotential;
pub use crate::problem::exact::follow::{BoxExit, Crossing, TracedPath};
use crate::problem::exact::follow::{Flow, ROUND_OFF, TracedParticle};
pub use crate::problem::exact::traced_grid::{
    CellLimits, MOST_EXAMINED, traced_bytes, traced_cells_of_axis,
};
use crate::problem::exact::traced_grid::{TracedGrid, traced_grid};
use crate::problem::grid::{MAX_DIMENSION, for_each_cell};

/// The origin of a characteristic.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Foot {
    /// The point of phase space, `[x, y, z, vx, vy, vz]`.
    pub point: [f64; 6],
    /// Time at which the particle entered the phase-space box at that point; zero if it was in the
    /// box from the start.
    pub entry: f64,
}

/// A particle before a jump of `V` that brings it to a given velocity.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct BeforeFace {
    /// The normal velocity before the face.
    pub velocity: f64,
    /// The coordinate of the face on the side before it, and on that behind it. They differ at the
    /// ends of a periodic axis.
    pub from: f64,
    /// See [`from`](Self::from).
    pub to: f64,
}

/// A tracer with half as many cells along each axis as another.
#[derive(Clone, Copy, Debug)]
pub struct HalvedCells {
    /// Limits on its number of cells.
    pub most: CellLimits,
    /// Order of convergence in the width of the cells, for particles that turn around: the lowest.
    pub order: f64,
}

/// The exact solution of a case's boundary-value problem.
///
/// The solution is exact if `V` is a sum of quadratic functions of one coordinate each in regions
/// whose edges are planes across an axis, wherever these lie. It is exact up to `1e-11` a step,
/// relative to the box, where particles follow smooth formulas of `V` (in two and three dimensions,
/// if motions along the axes are not independent). Otherwise `V` is approximated in traced cells of
/// the width `Δx`. If it is a sum over the axes, the error is `O(Δx³)`, and `O(Δx^(5/2))` for
/// particles that turn around on the way; if not, `O(Δx²)` and `O(Δx^(3/2))`. Edges of another
/// shape are staircases of the traced cells, which are the case's cells unless `V` is approximated.
///
/// Energy is conserved to round-off if `V` of every region is a sum of functions of one coordinate
/// each, and those along a face with a jump are quadratic; and along smooth formulas up to `1e-11`
/// a step. Otherwise slopes are taken at the centre of a cell, and energy is conserved to `O(Δx)`.
#[derive(Clone, Debug)]
pub struct Tracer<'a> {
    case: &'a Case,
    /// The motion of particles in the cells, back in time or forward.
    flow: Flow,
    /// Known paths along the axes, if the motions along them are independent.
    paths: Option<AxisPaths>,
    /// Faces, slopes and jumps along each axis, if they depend on the position along it alone.
    lines: Vec<AxisLine>,
    /// Whether paths are accurate: `V` is followed by its formulas, exact in the cells, or
    /// approximated on at least 128 cells along each axis that has more than one.
    pub is_accurate: bool,
    /// Whether `V` is approximated in the cells.
    pub is_approximate: bool,
}

impl<'a> Tracer<'a> {
    /// Prepares tracing in `case`'s potential.
    ///
    /// # Errors
    /// [`Error::Formula`](crate::base::error::Error::Formula) where `V` is not finite.
    pub fn new(case: &'a Case) -> Result<Self> {
        Self::with_cells(case, CellLimits::EXACT)
    }

    /// Prepares tracing in `case`'s potential, with elements cut into at most `most` space cells.
    ///
    /// # Errors
    /// As [`new`](Self::new).
    pub fn with_cells(case: &'a Case, most: CellLimits) -> Result<Self> {
        let TracedGrid { space, is_bent, by_formulas, is_approximate, is_accurate } =
            traced_grid(case, most)?;
        let mut potential = TracedPotential::new(case, space, is_bent)?;
        if by_formulas {
            potential = potential.by_formulas(case);
        }
        let paths = (!by_formulas && moves_by_axes(&potential)).then(AxisPaths::shared);
        let lines = if paths.is_some() || potential.space.dimension() == 1 {
            AxisLine::all(&potential)
        } else {
            Vec::new()
        };
        Ok(Self { case, flow: Flow::new(potential), paths, lines, is_accurate, is_approximate })
    }

    /// A tracer with half the cells along each axis, which shows the error of this one; `None` if
    /// `V` is exact in the cells, so that there is none, or no element is cut.
    pub fn halved(&self) -> Option<HalvedCells> {
        let axes = || self.flow.space.x.iter().zip(&self.case.space.x);
        let is_cut = axes().all(|(cut, axis)| axis.cells == 1 || cut.cells > axis.elements());
        let approximated = axes().map(|(cut, _)| cut.cells.div_ceil(2)).product();
        let is_sum = self.flow.space.dimension() == 1 || self.paths.is_some();
        (self.is_approximate && is_cut).then_some(HalvedCells {
            most: CellLimits { approximated, ..CellLimits::ESTIMATES },
            order: if is_sum { 2.5 } else { 1.5 },
        })
    }

    /// This tracer, whose [`follow`](Self::follow) goes forward in time, for random particles.
    pub fn forward(self) -> Self {
        let paths = self.paths.is_some().then(AxisPaths::not_shared);
        // The lines are those of motion back in time, and only save time.
        Self { flow: self.flow.forward(), paths, lines: Vec::new(), ..self }
    }

    /// The exact `f(time, x, v)` at `point = [x, y, z, vx, vy, vz]`, absent coordinates zero, `time
    /// ≥ 0`.
    ///
    /// Outside the phase-space box it is the inflow value at the point. It is NaN where the formula
    /// that gives it is undefined.
    pub fn value(&self, point: &[f64; 6], time: f64) -> f64 {
        self.values(std::slice::from_ref(point), time)[0]
    }

    /// About the number of cells that a path passes in a time, at half of the largest speed of the
    /// box, where `V` is approximated in them. Elsewhere it counts as one: many cells are passed at
    /// once there, or there are few.
    pub fn steps_of_a_path(&self, time: f64) -> f64 {
        if !self.is_approximate {
            return 1.0;
        }
        let space = &self.flow.space;
        let axes = space.x.iter().zip(&space.v).filter(|(x, _)| x.cells > 1);
        let steps = axes.map(|(x, v)| time * 0.5 * v.largest_magnitude() / x.width());
        steps.sum::<f64>().max(1.0)
    }

    /// The exact `f(time, x, v)` at many points, as [`value`](Self::value) gives it at one.
    pub fn values(&self, points: &[[f64; 6]], time: f64) -> Vec<f64> {
        let field = &self.case.fields[0];
        let inflow_is_constant =
            matches!(&field.inflow, Inflow::Formula(inflow) if inflow.constant().is_some());
        let foot = |point: &[f64; 6]| match self.end_by_axes(point, time) {
            Some(EndByAxes::Inside(point)) => Foot { point, entry: 0.0 },
            // The inflow is constant, so neither place nor time of entry matter.
            Some(EndByAxes::Leaves) if inflow_is_constant => Foot { point: *point, entry: time },
            _ => self.foot(point, time),
        };
        let feet: Vec<Foot> = points.iter().map(foot).collect();
        self.values_at(&feet)
    }

    /// The data at `feet`: `f` along the characteristics from there.
    pub fn values_at(&self, feet: &[Foot]) -> Vec<f64> {
        let field = &self.case.fields[0];
        let at: Vec<[f64; 6]> = feet.iter().map(|foot| self.data_point(foot)).collect();
        let mut values = field.initial.at_points(&at, 0.0);
        if let Inflow::Formula(inflow) = &field.inflow {
            for ((foot, at), value) in feet.iter().zip(&at).zip(&mut values) {
                if foot.entry > 0.0 {
                    *value = inflow.at_point(at, foot.entry);
                }
            }
        }
        values
    }

    /// The mean number of [steps](TracedPath::steps) of paths over `time` from places in the box.
    pub fn mean_steps(&self, time: f64) -> f64 {
        const SAMPLED: usize = 200;
        let points = self.case.space.random_points(SAMPLED);
        let steps: usize = points.iter().map(|point| self.follow(point, time).steps).sum();
        steps as f64 / SAMPLED as f64
    }

    /// The point at which the data of the particle from `foot` are evaluated: just outside of the
    /// box where it entered through an end. If a jump of `V` brought it in, that is on the side of
    /// the face from which it came.
    fn data_point(&self, foot: &Foot) -> [f64; 6] {
        let mut point = foot.point;
        if foot.entry == 0.0 {
            return point;
        }
        for (a, (x, v)) in self.flow.space.x.iter().zip(&self.flow.space.v).enumerate() {
            let at = point[a];
            if !(v.lower..=v.upper).contains(&point[3 + a]) && self.flow.is_on_face(a, at) {
                point[a] = x.beside(at, point[3 + a] < 0.0);
            } else if !self.flow.space.is_periodic(a) {
                point[a] = x.outside_of_end(at);
            }
            point[3 + a] = v.outside_of_end(point[3 + a]);
        }
        point
    }

    /// The end of the path from `point` after `time`, found axis by axis; `None` if the motions
    /// along the axes are not independent, or the point is outside of the box.
    fn end_by_axes(&self, point: &[f64; 6], time: f64) -> Option<EndByAxes> {
        let paths = self.paths.as_ref()?;
        self.flow.start(point)?;
        let follow = |a: usize, start: [f64; 2]| self.path_along(a, start, time);
        Some(paths.end(self.flow.space.dimension(), point, time, follow))
    }

    /// Position and velocity after `time` of a particle that moves along axis `a` alone; `None` if
    /// it leaves the box.
    fn path_along(&self, a: usize, [x, v]: [f64; 2], time: f64) -> Option<[f64; 2]> {
        let mut point = [0.0; 6];
        for (b, (x, v)) in self.flow.space.x.iter().zip(&self.flow.space.v).enumerate() {
            (point[b], point[3 + b]) = (x.centre(0), 0.5 * (v.lower + v.upper));
        }
        (point[a], point[3 + a]) = (x, v);
        let particle = self.flow.start(&point)?.along(a);
        if let Some(end) = self.along_line(&particle, a, time) {
            return (end.left == 0.0).then_some([end.x, 0.0 + self.flow.direction * end.w]);
        }
        let TracedPath { point, remaining, .. } = self.flow.follow(particle, time, &mut |_| false);
        remaining.is_none().then(|| [point[a], point[3 + a]])
    }

    /// `∂V/∂x_a` for `a = axis` in the cell that holds `point`, which is in the box.
    pub fn slope_at(&self, point: &[f64; 6], axis: usize) -> f64 {
        let cells: [usize; MAX_DIMENSION] = std::array::from_fn(|a| {
            if a < self.flow.faces.len() { self.flow.cell_at(a, point[a]) } else { 0 }
        });
        self.flow.potential.slope_at(&cells, axis, &std::array::from_fn(|a| point[a]))
    }

    /// The faces across an axis at which `V` may jump anywhere: the numbers of the cells above
    /// them.
    pub fn faces_with_jumps(&self, axis: usize) -> Vec<usize> {
        let mut found = vec![false; self.flow.space.x[axis].cells];
        for_each_cell(&self.flow.space.space_ranges(), |cell| {
            found[cell[axis]] |= self.flow.potential.may_jump_below(cell, axis);
        });
        (0..found.len()).filter(|face| found[*face]).collect()
    }

    /// The particle that has the velocity of `point`, not zero along `axis`, right behind the face
    /// below cell `face` of that axis, before it met the jump there; `None` if `V` does not jump at
    /// that place. The coordinate of `point` along the axis is ignored.
    pub fn before_face(&self, point: &[f64; 6], axis: usize, face: usize) -> Option<BeforeFace> {
        let (x, v) = (&self.flow.space.x[axis], point[3 + axis]);
        let up = v > 0.0;
        let below = self.flow.space.wrap(axis, face as i64 - 1)?;
        let (behind, before) = if up { (face, below) } else { (below, face) };
        let [to, from] = [(behind, up), (before, !up)]
            .map(|(cell, is_above)| self.flow.faces[axis][cell + usize::from(!is_above)]);
        let mut place = *point;
        place[axis] = x.centre(behind as i64);
        // Back through the face: V behind it minus V before it.
        let rise = self.flow.rise(&self.flow.start(&place)?, axis, !up, before);
        let square = v * v + 2.0 * rise;
        let reflected = BeforeFace { velocity: -v, from: to, to };
        let transmitted = BeforeFace { velocity: square.max(0.0).sqrt().copysign(v), from, to };
        (rise != 0.0).then_some(if square > 0.0 { transmitted } else { reflected })
    }

    /// The origin of the particle that is at `point = [x, y, z, vx, vy, vz]` at `time ≥ 0`.
    pub fn foot(&self, point: &[f64; 6], time: f64) -> Foot {
        if self.flow.space.dimension() == 1
            && let Some(particle) = self.flow.start(point)
            && let Some(end) = self.along_line(&particle, 0, time)
        {
            let point = [end.x, 0.0, 0.0, 0.0 + self.flow.direction * end.w, 0.0, 0.0];
            return Foot { point, entry: end.left };
        }
        self.foot_by(point, time, &mut |_| false)
    }

    /// The foot of the path back from `point`, with reflections as for
    /// [`follow_with`](Self::follow_with).
    pub fn foot_by(
        &self,
        point: &[f64; 6],
        time: f64,
        turns_back: &mut dyn FnMut(&Crossing) -> bool,
    ) -> Foot {
        let followed = self.follow_with(point, time, turns_back);
        Foot { point: followed.point, entry: followed.remaining.unwrap_or(0.0) }
    }

    /// A particle that moves along axis `a` alone, after `time` or when it leaves the box; `None`
    /// if only [`follow`](Self::follow) can tell.
    fn along_line(&self, particle: &TracedParticle, a: usize, time: f64) -> Option<LineParticle> {
        let line = self.lines.get(a)?;
        let left = time.max(0.0);
        let piece = line.of_cell[particle.cell[a]];
        let start = LineParticle { piece, x: particle.x[a], w: particle.w[a], left };
        let end = line.follow(start, ROUND_OFF * left, self.flow.most_faces(left))?;
        let x = if end.left == 0.0 { self.flow.snapped_to_face(a, end.x) } else { end.x };
        Some(LineParticle { x, ..end })
    }

    /// The path of the particle at `point = [x, y, z, vx, vy, vz]` over a time `time ≥ 0`: back in
    /// time, or [`forward`](Self::forward). It ends where the particle was, or will be.
    ///
    /// The work is bounded: a particle that has met more faces than physics allows, or takes too
    /// many steps, stays where it is. In the cells around a corner, the slopes of a `V` that is not
    /// a sum over axes may drive a particle at rest in a circle.
    pub fn follow(&self, point: &[f64; 6], time: f64) -> TracedPath {
        self.follow_with(point, time, &mut |_| false)
    }

    /// The path as [`follow`](Self::follow) gives it, if `turns_back` is never true. It is called
    /// for every jump of `V` on the path, and says whether the particle is reflected although it
    /// could be transmitted.
    pub fn follow_with(
        &self,
        point: &[f64; 6],
        time: f64,
        turns_back: &mut dyn FnMut(&Crossing) -> bool,
    ) -> TracedPath {
        match self.flow.start(point) {
            Some(particle) => self.flow.follow(particle, time, turns_back),
            None => TracedPath::at_start(*point, time.max(0.0)),
        }
    }
}

#[cfg(test)]
mod tests;
