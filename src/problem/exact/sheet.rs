//! The exact density and mean velocity of measure-valued data, by following the initial surface
//! forward in time.
//!
//! `f(0) = ρ0(x) Π_a δ(v_a − w_a(x))` lives on the surface `(x, w(x))`, an n-dimensional sheet in
//! phase space. Inflow through an end of the box on axis `a` makes a further sheet, in which the
//! time of entry replaces `x_a` as a parameter, and the rate `ρ0 |w_a|` replaces `ρ0`. There `ρ0`
//! is the inflow value of `φ`, and the velocity is `w`. Particles carry the sheets to the time `T`
//! through the potential of the scheme (see [`super`]). Jumps of `V` tear sheets into branches;
//! folds make the velocity multivalued.
//!
//! A sheet is cut into boxes in its parameters `q`: `x`, or the time of entry in place of one
//! `x_a`. The mass of a box is `ρ0` at its centre times its volume. At time `T` it is spread evenly
//! over a box around the mean image of the corners, whose sides are the extents of the differences
//! between images of opposite sides. So mass is conserved, caustics are integrable, and the density
//! is given as averages over cells. In one dimension the images of neighbouring boxes meet end to
//! end. In more dimensions a sheared image is too wide, by less than its own size.
//!
//! A box is halved along an axis whose two ends have different histories (see [`TracedPath`]), and
//! if its image bends or its density changes, until it is as small as `FINEST` allows.
//!
//! First boxes, of which no box was halved yet, may be followed in any order and by any rank
//! ([`Sheets`]). The mass that a box leaves in a cell is a [`Deposit`] with the box's number, and
//! [`SheetSums`](sums::SheetSums) adds deposits in the order of these numbers.

pub mod sums;

use crate::base::error::{Error, Result};
use crate::base::row_major::indices;
use crate::problem::case::{Case, Data};
use crate::problem::exact::sheet::sums::{Deposit, Line};
use crate::problem::exact::{TracedPath, Tracer};
use crate::problem::formula::Expression;
use crate::problem::grid::{Axis, AxisEnd, MAX_DIMENSION, PhaseSpace, describe_point};

/// First boxes along each axis of a cell, by the number of dimensions.
const BOXES: [usize; MAX_DIMENSION] = [16, 4, 2];
/// First boxes that are followed in a round. It bounds the memory for their deposits.
pub const ROUND: usize = 1 << 15;
/// Most halvings of a box along an axis, by the number of dimensions. In one dimension tears are
/// located to round-off.
const FINEST: [i32; MAX_DIMENSION] = [45, 5, 3];
/// Boxes that were halved more often at a tear are no part of the curve in one dimension: their
/// images are so short that round-off would decide their density.
const MOST_TEARS: i32 = 18;
/// A box whose image bends by more than this fraction of a cell is halved.
const BENDING: f64 = 0.01;
/// A box whose density deviates from a linear one by more than this fraction is halved.
const CHANGE: f64 = 0.01;
/// In more than one dimension, a box whose image is wider than this fraction of a cell is halved.
const WIDEST: f64 = 0.6;
/// Corners are moved inside the box by this fraction of its half-width, so that those on a face are
/// in the same cell as the box.
const INSIDE: f64 = 1e-9;
/// Largest number of particles that halvings may add, by the number of dimensions. It bounds the
/// work for data that jump everywhere.
const BUDGET: [usize; MAX_DIMENSION] = [1 << 21, 1 << 23, 1 << 24];

/// A sheet of the initial surface.
#[derive(Clone, Copy, Debug)]
pub enum InitialSheet {
    /// `(x, w(x))` at time zero.
    Initial,
    /// Inflow at an end of a space axis `a`. The parameter `q_a` is the time of entry at the upper
    /// end, and the time between entry and `T` at the lower end, so that in one dimension the
    /// sheets join in the order of `x`.
    Entering(AxisEnd),
}

/// A box of parameters: centre and half-widths.
#[derive(Clone, Copy)]
struct ParameterBox {
    centre: [f64; MAX_DIMENSION],
    half: [f64; MAX_DIMENSION],
    /// Halvings along each axis.
    depth: [i32; MAX_DIMENSION],
    /// Halvings because particles took different branches.
    tears: i32,
}

/// A particle of a sheet at the time `T`.
#[derive(Clone, Copy)]
struct Image {
    /// Mass per unit of parameter volume.
    density: f64,
    followed: TracedPath,
}

impl Image {
    /// Whether both particles took the same branch, so that the image is continuous between them.
    fn same(&self, other: &Image) -> bool {
        self.followed.history == other.followed.history
            && self.followed.remaining.is_some() == other.followed.remaining.is_some()
    }
}

/// The image of a box whose corners all took the branch of the centre.
struct ImageShape {
    /// Mean of the corners.
    middle: [f64; 6],
    /// `secants[a]`: mean difference of images between the upper and the lower side along axis `a`.
    secants: [[f64; MAX_DIMENSION]; MAX_DIMENSION],
    /// Mean of the corners minus the centre.
    bend: [f64; MAX_DIMENSION],
    /// Mean density of the box.
    density: f64,
    /// Mean density of the corners minus that of the centre.
    change: f64,
}

impl ImageShape {
    fn new(n: usize, centre: &Image, corners: &[Image]) -> Self {
        let share = 1.0 / corners.len() as f64;
        let mut middle = [0.0; 6];
        let mut secants = [[0.0; MAX_DIMENSION]; MAX_DIMENSION];
        let mut density = 0.0;
        for (c, corner) in corners.iter().enumerate() {
            let point = &corner.followed.point;
            density += share * corner.density;
            for (middle, x) in middle.iter_mut().zip(point) {
                *middle += share * x;
            }
            for (a, secant) in secants.iter_mut().enumerate().take(n) {
                let sign = if c >> a & 1 == 1 { 2.0 } else { -2.0 };
                for (secant, x) in secant.iter_mut().zip(point) {
                    *secant += sign * share * x;
                }
            }
        }
        let change = density - centre.density;
        Self {
            secants,
            bend: std::array::from_fn(|b| middle[b] - centre.followed.point[b]),
            middle,
            // Simpson's rule along each axis, up to fourth derivatives.
            density: centre.density + change / 3.0,
            change,
        }
    }

    /// Half the extent of the image along each space axis.
    fn half(&self) -> [f64; MAX_DIMENSION] {
        std::array::from_fn(|b| self.secants.iter().map(|s| 0.5 * s[b].abs()).sum())
    }
}

/// Follows boxes of the sheets of a case with measure-valued data.
pub struct Sheets<'a> {
    case: &'a Case,
    tracer: Tracer<'a>,
    velocity: &'a [Expression],
    /// Faces of the cells of each axis.
    faces: Vec<Vec<f64>>,
    /// Number of particles that halvings may still add.
    budget: usize,
    found: FollowedBoxes,
    failure: Option<Error>,
    /// Number of the first box that is being followed.
    number: usize,
}

/// Mass and curve that the followed boxes leave, in the order of the boxes.
#[derive(Clone, Debug, Default)]
pub struct FollowedBoxes {
    /// Mass in cells.
    pub deposits: Vec<Deposit>,
    /// Pieces of the curve, in one dimension.
    pub lines: Vec<Line>,
    /// Number of particles that halvings added.
    pub added: usize,
}

/// Number of particles that halvings of boxes may add.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct ParticleBudget(usize);

impl ParticleBudget {
    /// Whether boxes of `case` that added `added` particles in all, each with the whole budget,
    /// would be halved in the same way with this one budget for all: it lasts until the last
    /// halving.
    pub fn allows(self, space: &PhaseSpace, added: usize) -> bool {
        added == 0 || added - particles_of_halving(space.dimension()) < self.0
    }

    /// The budget that is left after halvings that added `added` particles.
    pub fn less(self, added: usize) -> Self {
        Self(self.0.saturating_sub(added))
    }
}

/// The number of particles that one halving adds: centre and corners of two boxes.
fn particles_of_halving(n: usize) -> usize {
    2 * (1 + (1 << n))
}

/// Estimated number of points of the curve of a case: 1.5 times the number of first boxes. Zero in
/// more than one dimension.
pub fn curve_points(case: &Case) -> usize {
    if case.space.dimension() > 1 {
        return 0;
    }
    let sheets = [InitialSheet::Initial, InitialSheet::Entering(AxisEnd { axis: 0, upper: false })];
    let [initial, entering] = sheets.map(|sheet| FirstBoxes::of(case, sheet).counts[0]);
    let ends = if case.space.is_periodic(0) { 0 } else { 2 };
    3 * (initial + ends * entering) / 2
}

/// The first boxes of a sheet.
struct FirstBoxes {
    /// Number along each axis.
    counts: Vec<usize>,
    /// Width of each along each axis.
    widths: Vec<f64>,
}

impl FirstBoxes {
    /// The first boxes of `sheet`.
    fn of(case: &Case, sheet: InitialSheet) -> Self {
        let axes = &case.space.x;
        let boxes = BOXES[axes.len() - 1];
        // The number in each element.
        let boxes = |a: &Axis| boxes * a.nodes.count();
        let mut counts: Vec<_> = axes.iter().map(|a| a.elements() * boxes(a)).collect();
        let mut widths: Vec<f64> = axes.iter().map(|a| a.width() / boxes(a) as f64).collect();
        if let InitialSheet::Entering(AxisEnd { axis, .. }) = sheet {
            // The fastest particles cross one box of space in one interval of entry times.
            let fastest = case.space.v[axis].largest_magnitude();
            let times = (case.duration() * fastest / widths[axis]).ceil().max(1.0);
            counts[axis] = (times as usize).min(4 * counts[axis]);
            widths[axis] = case.duration() / counts[axis] as f64;
        }
        Self { counts, widths }
    }
}

impl<'a> Sheets<'a> {
    /// The sheets of `case` up to its end time.
    ///
    /// # Errors
    /// [`Error::Formula`] where `V` is not finite; [`Error::Input`] for data that are not
    /// measure-valued.
    pub fn new(case: &'a Case) -> Result<Self> {
        let Data::Measure { velocity, .. } = &case.data else {
            return Err(Error::input("only measure-valued data lie on a sheet"));
        };
        Ok(Self {
            case,
            tracer: Tracer::new(case)?.forward(),
            velocity,
            faces: case.space.x.iter().map(Axis::cell_faces).collect(),
            budget: 0,
            found: FollowedBoxes::default(),
            failure: None,
            number: 0,
        })
    }

    /// The sheets, in one dimension in the order of `x`.
    pub fn all(&self) -> Vec<InitialSheet> {
        let ends = |upper: bool| {
            let open = (0..self.space().dimension()).filter(|&a| !self.space().is_periodic(a));
            open.map(move |axis| InitialSheet::Entering(AxisEnd { axis, upper }))
        };
        ends(false).chain([InitialSheet::Initial]).chain(ends(true)).collect()
    }

    /// The number of first boxes of `sheet`.
    pub fn boxes(&self, sheet: InitialSheet) -> usize {
        FirstBoxes::of(self.case, sheet).counts.iter().product()
    }

    /// The budget before any box is followed.
    pub fn budget(&self) -> ParticleBudget {
        ParticleBudget(BUDGET[self.space().dimension() - 1])
    }

    /// Follows the first boxes `numbers` (row-major) of `sheet`, halved as far as needed within
    /// `budget`.
    ///
    /// # Errors
    /// [`Error::Formula`] where `density` or `velocity` is not finite.
    pub fn follow_boxes(
        &mut self,
        sheet: InitialSheet,
        numbers: impl Iterator<Item = usize>,
        ParticleBudget(budget): ParticleBudget,
    ) -> Result<FollowedBoxes> {
        self.budget = budget;
        let boxes = FirstBoxes::of(self.case, sheet);
        for number in numbers {
            self.number = number;
            let piece = self.first_box(sheet, &boxes);
            self.follow(sheet, piece);
        }
        let found = std::mem::take(&mut self.found);
        self.failure.take().map_or(Ok(found), Err)
    }

    fn space(&self) -> &'a PhaseSpace {
        &self.case.space
    }

    /// The one of number `self.number` of the first `boxes` of `sheet`.
    fn first_box(&self, sheet: InitialSheet, boxes: &FirstBoxes) -> ParameterBox {
        let FirstBoxes { counts, widths } = boxes;
        let n = self.space().dimension();
        let mut piece = ParameterBox {
            centre: [0.0; MAX_DIMENSION],
            half: [0.0; MAX_DIMENSION],
            depth: [0; MAX_DIMENSION],
            tears: 0,
        };
        for (a, k) in indices(self.number, counts).into_iter().enumerate() {
            piece.half[a] = 0.5 * widths[a];
            piece.centre[a] = match sheet {
                InitialSheet::Entering(end) if end.axis == a => (k as f64 + 0.5) * widths[a],
                // Counted from the face of the element, so that sides lie on faces to round-off.
                _ => {
                    let axis = &self.space().x[a];
                    let boxes = BOXES[n - 1] * axis.nodes.count();
                    let (element, part) = (k / boxes, k % boxes);
                    axis.face(element as i64) + (part as f64 + 0.5) * widths[a]
                }
            };
        }
        piece
    }

    /// The value of a formula at a point and a time. The first that is not finite becomes the
    /// error, and 0 is returned for it.
    fn value(&mut self, formula: &Expression, point: &[f64; 6], time: f64) -> f64 {
        let value = formula.at_point(point, time);
        if !value.is_finite() {
            let place = describe_point(self.space().dimension(), point);
            self.failure.get_or_insert_with(|| formula.undefined(value, place));
            return 0.0;
        }
        value
    }

    /// Follows the particle with parameters `q`. One that starts outside of the velocity box counts
    /// as having left; one that should enter but does not move inwards has density zero.
    fn image(&mut self, sheet: InitialSheet, q: &[f64; MAX_DIMENSION]) -> Image {
        let n = self.space().dimension();
        let mut point = [0.0; 6];
        point[..n].copy_from_slice(&q[..n]);
        let (mut data_at, mut time) = (point, self.case.end);
        if let InitialSheet::Entering(AxisEnd { axis, upper }) = sheet {
            let x = &self.space().x[axis];
            point[axis] = if upper { x.upper } else { x.lower };
            data_at[axis] = x.just_outside(upper);
            time = if upper { time - q[axis] } else { q[axis] };
        }
        let start = self.case.end - time;
        let velocity = self.velocity;
        for (a, formula) in velocity.iter().enumerate() {
            point[3 + a] = self.value(formula, &data_at, start);
        }
        data_at[3..].copy_from_slice(&point[3..]);
        let phi = &self.case.fields[0];
        let density = match sheet {
            InitialSheet::Initial => self.value(&phi.initial, &data_at, start),
            InitialSheet::Entering(AxisEnd { axis, upper }) => {
                let inwards = if upper { -point[3 + axis] } else { point[3 + axis] };
                if inwards > 0.0 {
                    inwards * self.value(phi.entering(), &data_at, start)
                } else {
                    0.0
                }
            }
        };
        let mut followed = if density == 0.0 {
            // A particle without mass need not be traced.
            TracedPath::at_start(point, time)
        } else {
            self.tracer.follow(&point, time)
        };
        // Periodic axes are unrolled, so that no image is cut in two.
        for (a, axis) in self.space().x.iter().enumerate() {
            followed.point[a] += f64::from(followed.turns[a]) * (axis.upper - axis.lower);
        }
        Image { density, followed }
    }

    /// Follows a box, or its halves.
    fn follow(&mut self, sheet: InitialSheet, piece: ParameterBox) {
        let n = self.space().dimension();
        let centre = self.image(sheet, &piece.centre);
        // Corner c is at the upper end of axis a where bit a of c is set.
        let mut corners = [centre; 1 << MAX_DIMENSION];
        let corners = &mut corners[..1 << n];
        for (c, corner) in corners.iter_mut().enumerate() {
            let mut q = piece.centre;
            for (a, q) in q.iter_mut().enumerate().take(n) {
                let sign = if c >> a & 1 == 1 { 1.0 } else { -1.0 };
                *q += sign * (1.0 - INSIDE) * piece.half[a];
            }
            *corner = self.image(sheet, &q);
        }
        let corners = &*corners;
        let whole = corners.iter().all(|c| c.same(&centre));
        let stays = centre.followed.remaining.is_none();
        let shape = (whole && stays).then(|| ImageShape::new(n, &centre, corners));
        let halve = self.axis_to_halve(&piece, &centre, corners, shape.as_ref());
        if let Some(a) = halve.filter(|_| self.budget > 0) {
            self.budget = self.budget.saturating_sub(particles_of_halving(n));
            self.found.added += particles_of_halving(n);
            for sign in [-1.0, 1.0] {
                let mut part = piece;
                part.half[a] *= 0.5;
                part.centre[a] += sign * part.half[a];
                part.depth[a] += 1;
                part.tears += i32::from(!whole);
                self.follow(sheet, part);
            }
        } else if stays {
            // A box that is torn or bent in spite of its small size goes as a whole where its
            // centre goes.
            let shape = shape.filter(|shape| !self.bent(shape));
            self.add(&piece, &centre, corners, shape.as_ref());
        }
    }

    /// Whether an image bends by more than [`BENDING`] allows.
    fn bent(&self, shape: &ImageShape) -> bool {
        let mut axes = self.space().x.iter().zip(&shape.bend);
        axes.any(|(axis, bend)| bend.abs() > BENDING * axis.mean_width())
    }

    /// The axis along which a box should be halved: the first along which its corners took
    /// different branches, or its image or its density is not linear.
    fn axis_to_halve(
        &self,
        piece: &ParameterBox,
        centre: &Image,
        corners: &[Image],
        shape: Option<&ImageShape>,
    ) -> Option<usize> {
        let n = self.space().dimension();
        let edges = |a: usize| {
            let lower = (0..1 << n).filter(move |c| c >> a & 1 == 0);
            lower.map(move |c| (&corners[c], &corners[c | 1 << a]))
        };
        let torn = |a: usize| edges(a).any(|(lower, upper)| !lower.same(upper));
        // If the corners agree with each other but not with the centre, no axis is distinguished.
        let whole = corners.iter().all(|c| c.same(centre));
        let astray = !whole && !(0..n).any(torn);
        let rough = |a: usize| {
            shape.is_some_and(|shape| {
                let mut axes = self.space().x.iter().zip(&shape.secants[a]);
                let change = shape.change.abs() > CHANGE * centre.density.abs();
                let mut wide = || axes.any(|(axis, s)| s.abs() > WIDEST * axis.mean_width());
                change || self.bent(shape) || n > 1 && wide()
            })
        };
        let finest = FINEST[n - 1];
        (0..n).find(|&a| piece.depth[a] < finest && (torn(a) || astray || rough(a)))
    }

    /// Adds the mass of a box, and in one dimension its piece of the curve.
    fn add(
        &mut self,
        piece: &ParameterBox,
        centre: &Image,
        corners: &[Image],
        shape: Option<&ImageShape>,
    ) {
        let n = self.space().dimension();
        let volume: f64 = (0..n).map(|a| 2.0 * piece.half[a]).product();
        let Some(shape) = shape else {
            let point = &centre.followed.point;
            return self.deposit(centre.density * volume, point, &[0.0; MAX_DIMENSION]);
        };
        let half = shape.half();
        let mass = shape.density * volume;
        self.deposit(mass, &shape.middle, &half);
        if n == 1 && piece.tears <= MOST_TEARS {
            let history = centre.followed.history;
            let ends = [corners[0].followed.point, corners[1].followed.point];
            let (number, density) = (self.number, mass / (2.0 * half[0]));
            for ends in self.cut_at_period(&ends) {
                let ends = ends.map(|point| [point[0], point[3]]);
                self.found.lines.push(Line { number, history, density, ends });
            }
        }
    }

    /// The line between two points in one dimension, in pieces. On a periodic axis the line is cut
    /// at the end of the period and continues at the other end of the axis.
    fn cut_at_period(&self, [first, last]: &[[f64; 6]; 2]) -> Vec<[[f64; 6]; 2]> {
        let axis = &self.space().x[0];
        if !self.space().is_periodic(0) {
            return vec![[*first, *last]];
        }
        let length = axis.upper - axis.lower;
        let (from, to) = (first[0].min(last[0]), first[0].max(last[0]));
        let turn = |x: f64| ((x - axis.lower) / length).floor();
        let mut lines = Vec::new();
        let mut shift = turn(from) * length;
        while lines.is_empty() || axis.lower + shift < to {
            let line = [first, last].map(|point| {
                let mut end = *point;
                let x = (point[0] - shift).clamp(axis.lower, axis.upper);
                if to > from {
                    let part = (x + shift - first[0]) / (last[0] - first[0]);
                    end[3] = first[3] + part * (last[3] - first[3]);
                }
                end[0] = x;
                end
            });
            lines.push(line);
            shift += length;
        }
        if last[0] < first[0] {
            lines.reverse();
        }
        lines
    }

    /// Spreads mass evenly over the box `middle ± half` of space.
    fn deposit(&mut self, mass: f64, middle: &[f64; 6], half: &[f64; MAX_DIMENSION]) {
        let n = self.space().dimension();
        let overlaps: [Vec<(usize, f64)>; MAX_DIMENSION] = std::array::from_fn(|b| {
            if b >= n {
                return vec![(0, 1.0)];
            }
            let cells = Cells { axis: &self.case.space.x[b], faces: &self.faces[b] };
            let (lower, upper) = (middle[b] - half[b], middle[b] + half[b]);
            if self.case.space.is_periodic(b) {
                cells.overlap_around(lower, upper)
            } else {
                cells.overlap(lower, upper)
            }
        });
        let axes = &self.case.space.x;
        let rows = |b: usize| axes.get(b).map_or(1, |a| a.cells);
        for &(i, part_x) in &overlaps[0] {
            for &(j, part_y) in &overlaps[1] {
                for &(k, part_z) in &overlaps[2] {
                    let cell = (i * rows(1) + j) * rows(2) + k;
                    let part = mass * part_x * part_y * part_z;
                    let momentum = std::array::from_fn(|b| part * middle[3 + b]);
                    let number = self.number;
                    self.found.deposits.push(Deposit { number, cell, mass: part, momentum });
                }
            }
        }
    }
}

/// The cells of an axis.
struct Cells<'a> {
    axis: &'a Axis,
    faces: &'a [f64],
}

impl Cells<'_> {
    /// The cell that holds `x`; beyond the axis, the cell at its end.
    fn at(&self, x: f64) -> usize {
        let place = ((x - self.axis.lower) / self.axis.width()).floor().max(0.0) as usize;
        let count = self.axis.nodes.count();
        let first = place.min(self.axis.elements() - 1) * count;
        (first..first + count).rfind(|i| self.faces[*i] <= x).unwrap_or(first)
    }

    /// The cells that `[lower, upper]` overlaps, each with its part of the interval. Parts sum to
    /// 1, as what lies beyond the axis counts for the cell at its end.
    fn overlap(&self, lower: f64, upper: f64) -> Vec<(usize, f64)> {
        let (first, last) = (self.at(lower), self.at(upper));
        if first == last {
            return vec![(first, 1.0)];
        }
        let length = upper - lower;
        (first..=last)
            .map(|i| {
                let from = if i == first { lower } else { self.faces[i] };
                let to = if i == last { upper } else { self.faces[i + 1] };
                (i, ((to - from) / length).max(0.0))
            })
            .collect()
    }

    /// The cells that an interval anywhere on a periodic axis overlaps, as
    /// [`overlap`](Self::overlap) gives them. A cell may occur more than once.
    fn overlap_around(&self, lower: f64, upper: f64) -> Vec<(usize, f64)> {
        let axis = self.axis;
        let length = axis.upper - axis.lower;
        let shift = ((lower - axis.lower) / length).floor() * length;
        let (lower, upper) = (lower - shift, upper - shift);
        if upper <= axis.upper || upper == lower {
            return self.overlap(lower, upper);
        }
        let inside = ((axis.upper - lower) / (upper - lower)).clamp(0.0, 1.0);
        let first = self.overlap(lower.min(axis.upper), axis.upper).into_iter();
        let rest = self.overlap_around(axis.lower, upper - length).into_iter();
        first
            .map(|(i, part)| (i, inside * part))
            .chain(rest.map(|(i, part)| (i, (1.0 - inside) * part)))
            .collect()
    }
}

#[cfg(test)]
mod tests;
