//! The exact density and mean velocity of measure-valued data, by following the initial surface
//! forward in time.
//!
//! `f(0) = ρ0(x) Π_a δ(v_a − w_a(x))` lives on the surface `(x, w(x))`, an n-dimensional sheet in
//! phase space; what enters through the end of the box on axis `a` makes further sheets, with the
//! time of entry in place of `x_a`, on which the rate `ρ0 |w_a|` takes the place of `ρ0` (what
//! enters is `φ`'s inflow value, at the velocity `w`). Particles carry the sheets on to the time
//! `T`, through `V` as the scheme sees it (see [`super`]). Jumps of `V` tear them into branches;
//! folds make the velocity multivalued.
//!
//! A sheet is cut into boxes in its parameters `q` (`x`, or the time and the others): `ρ0` at its
//! centre times its volume is a box's mass, and the images of its centre and corners say where the
//! mass is at `T`: evenly over the box that the differences of opposite sides span, axis by axis.
//! So mass is kept, caustics are integrable, and the density comes as averages over cells. In one
//! dimension the images of neighbouring boxes meet end to end; in more, a sheared image is a little
//! wider than it should be, by less than its own size.
//!
//! A box is halved along an axis whose ends have other histories (see [`Followed`]), and where its
//! image bends or its density changes, until it is as small as `FINEST` says.

use crate::base::error::Result;
use crate::problem::case::{Case, Data};
use crate::problem::exact::{Followed, Tracer};
use crate::problem::formula::Expression;
use crate::problem::grid::{Axis, MAX_DIMENSION, PhaseSpace, describe_point, for_each_cell};
use std::ops::Range;

/// Boxes along each axis of a cell to begin with, by the number of dimensions.
const BOXES: [usize; MAX_DIMENSION] = [16, 4, 2];
/// The most halvings of a box along each axis: in one dimension breaks are found to round-off.
const FINEST: [i32; MAX_DIMENSION] = [45, 5, 3];
/// A box whose image bends by more than this fraction of a cell is halved.
const BENDING: f64 = 0.01;
/// A box whose density is not linear by this fraction is halved.
const CHANGE: f64 = 0.01;
/// In more than one dimension, a box whose image is wider than this fraction of a cell is halved.
const WIDEST: f64 = 0.6;
/// Corners lie inside the box by this fraction of its half-width: a side on a face belongs to one
/// cell.
const INSIDE: f64 = 1e-9;
/// Largest number of particles beyond those of the first boxes. It bounds the work for data that
/// jump everywhere.
const BUDGET: [usize; MAX_DIMENSION] = [1 << 21, 1 << 23, 1 << 24];
/// Cells with less than this fraction of the largest mass are empty: particles within 1e-11 of a
/// cell's face count for the cell above.
const EMPTY: f64 = 1e-9;
/// Points further apart than this fraction of a cell are not neighbours on a branch.
const GAP: f64 = 1e-6;

/// The multivalued velocity in one dimension: points along the branches.
#[derive(Clone, Debug, Default)]
pub struct MultivaluedVelocity {
    /// Position.
    pub x: Vec<f64>,
    /// Velocity.
    pub v: Vec<f64>,
    /// `ρ0/|∂x/∂x0|`, the branch's part of the density.
    pub density: Vec<f64>,
    /// Number of the branch, from 0. Neighbouring points of a branch are joined by a line.
    pub branch: Vec<f64>,
}

/// The exact moments on the whole space grid, as averages over cells.
#[derive(Clone, Debug)]
pub struct ExactMoments {
    /// `ρ`, row-major.
    pub density: Vec<f64>,
    /// `ρ u_a`, one vector an axis.
    pub momentum: Vec<Vec<f64>>,
    /// `u_a`, one vector for each axis; NaN where the density is zero.
    pub velocity: Vec<Vec<f64>>,
    /// The multivalued velocity, in one dimension.
    pub curve: Option<MultivaluedVelocity>,
}

/// A sheet of the initial surface.
#[derive(Clone, Copy)]
enum InitialSheet {
    /// `(x, w(x))` at time zero.
    Initial,
    /// What enters at an end of axis `axis`: at time `q_axis` at the upper one, a time `q_axis`
    /// before the end at the lower one, so that in one dimension the sheets join in the order of
    /// `x`.
    Entering { axis: usize, upper: bool },
}

/// A box of parameters: centre and half-widths.
#[derive(Clone, Copy)]
struct ParameterBox {
    centre: [f64; MAX_DIMENSION],
    half: [f64; MAX_DIMENSION],
    /// Halvings along each axis.
    depth: [i32; MAX_DIMENSION],
}

/// A particle of a sheet, at the end.
#[derive(Clone, Copy)]
struct Image {
    /// Mass a unit of parameter volume.
    density: f64,
    followed: Followed,
}

impl Image {
    fn same(&self, other: &Image) -> bool {
        self.followed.history == other.followed.history
            && self.followed.left.is_some() == other.followed.left.is_some()
    }
}

/// The image of a box whose corners all went the centre's way.
struct ImageShape {
    /// Mean of the corners.
    middle: [f64; 6],
    /// `secants[a]`: from the lower to the upper side along axis `a`.
    secants: [[f64; MAX_DIMENSION]; MAX_DIMENSION],
    /// Mean of the corners minus the centre.
    bend: [f64; MAX_DIMENSION],
    /// Mean density, and that of the corners minus the centre's.
    density: f64,
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

    /// Half the extent along each axis of space.
    fn half(&self) -> [f64; MAX_DIMENSION] {
        std::array::from_fn(|b| self.secants.iter().map(|s| 0.5 * s[b].abs()).sum())
    }
}

/// The results that are accumulated.
struct Sheets<'a> {
    case: &'a Case,
    tracer: Tracer<'a>,
    velocity: &'a [Expression],
    /// Faces of the cells of each axis.
    faces: Vec<Vec<f64>>,
    mass: Vec<f64>,
    momentum: Vec<Vec<f64>>,
    curve: MultivaluedVelocity,
    /// History and end of the last piece on the curve.
    last: Option<(u64, [f64; 6])>,
    budget: usize,
    failure: Option<crate::base::error::Error>,
}

/// The exact moments of a case with measure-valued data at its end time; `None` for other data.
///
/// # Errors
/// [`Error::Formula`](crate::base::error::Error::Formula) where `V`, `density` or `velocity` is not
/// finite.
pub fn exact_moments(case: &Case) -> Result<Option<ExactMoments>> {
    let Data::Measure { velocity, .. } = &case.data else { return Ok(None) };
    let n = case.space.dimension();
    let cells = case.space.space_cells();
    let mut sheets = Sheets {
        case,
        tracer: Tracer::new(case)?.forward(),
        velocity,
        faces: case.space.x.iter().map(Axis::cell_faces).collect(),
        mass: vec![0.0; cells],
        momentum: vec![vec![0.0; cells]; n],
        curve: MultivaluedVelocity::default(),
        last: None,
        budget: BUDGET[n - 1],
        failure: None,
    };
    let ends = |upper: bool| {
        let open = (0..n).filter(|&axis| !case.space.is_periodic(axis));
        open.map(move |axis| InitialSheet::Entering { axis, upper })
    };
    // In one dimension in the order of x.
    for sheet in ends(false).chain([InitialSheet::Initial]).chain(ends(true)) {
        sheets.cover(sheet);
    }
    sheets.finish().map(Some)
}

impl ExactMoments {
    /// The moments on the space cells of `share`, one range an x-axis; the curve stays whole.
    pub fn on(self, space: &PhaseSpace, share: &[Range<usize>]) -> Self {
        let mut cells = Vec::new();
        let axes = &space.x;
        for_each_cell(share, |i| {
            let row_major = |k: usize, (axis, i): (&Axis, &usize)| k * axis.cells + i;
            cells.push(axes.iter().zip(i).fold(0, row_major));
        });
        let pick = |whole: &Vec<f64>| cells.iter().map(|&c| whole[c]).collect();
        Self {
            density: pick(&self.density),
            momentum: self.momentum.iter().map(pick).collect(),
            velocity: self.velocity.iter().map(pick).collect(),
            curve: self.curve,
        }
    }
}

/// Estimated number of points of the curve of a case: those of its first boxes, times 1.5.
/// Zero in more than one dimension.
pub fn curve_points(case: &Case) -> usize {
    if case.space.dimension() > 1 {
        return 0;
    }
    let sheets = [InitialSheet::Initial, InitialSheet::Entering { axis: 0, upper: false }];
    let [initial, entering] = sheets.map(|sheet| grid(case, sheet).0[0].len());
    let ends = if case.space.is_periodic(0) { 0 } else { 2 };
    3 * (initial + ends * entering) / 2
}

/// The first boxes of a sheet: their numbers and widths along each axis.
fn grid(case: &Case, sheet: InitialSheet) -> (Vec<Range<usize>>, Vec<f64>) {
    let axes = &case.space.x;
    let boxes = BOXES[axes.len() - 1];
    // So many in each element.
    let boxes = |a: &Axis| boxes * a.nodes.count();
    let mut ranges: Vec<_> = axes.iter().map(|a| 0..a.elements() * boxes(a)).collect();
    let mut width: Vec<f64> = axes.iter().map(|a| a.width() / boxes(a) as f64).collect();
    if let InitialSheet::Entering { axis, .. } = sheet {
        // As many times as the fastest particles cross boxes until the end.
        let v = &case.space.v[axis];
        let fastest = v.lower.abs().max(v.upper.abs());
        let times = (case.end * fastest / width[axis]).ceil().max(1.0);
        ranges[axis] = 0..(times as usize).min(4 * ranges[axis].len());
        width[axis] = case.end / ranges[axis].len() as f64;
    }
    (ranges, width)
}

impl Sheets<'_> {
    fn space(&self) -> &PhaseSpace {
        &self.case.space
    }

    /// Cuts a sheet into pieces and follows them.
    fn cover(&mut self, sheet: InitialSheet) {
        let n = self.space().dimension();
        let boxes = BOXES[n - 1];
        let (ranges, width) = grid(self.case, sheet);
        for_each_cell(&ranges, |k| {
            let mut piece = ParameterBox {
                centre: [0.0; MAX_DIMENSION],
                half: [0.0; MAX_DIMENSION],
                depth: [0; MAX_DIMENSION],
            };
            for a in 0..n {
                let middle = (k[a] as f64 + 0.5) * width[a];
                piece.half[a] = 0.5 * width[a];
                piece.centre[a] = match sheet {
                    InitialSheet::Entering { axis, .. } if axis == a => middle,
                    // Counted from the cell's own face, so that sides on faces are there to
                    // round-off.
                    _ => {
                        let axis = &self.space().x[a];
                        let boxes = boxes * axis.nodes.count();
                        let (element, part) = (k[a] / boxes, k[a] % boxes);
                        axis.face(element as i64) + (part as f64 + 0.5) * width[a]
                    }
                };
            }
            self.follow(sheet, piece);
        });
    }

    /// The value of a formula at a point and a time; the first that is not finite is the error.
    fn value(&mut self, formula: &Expression, point: &[f64; 6], time: f64) -> f64 {
        let [x, y, z, vx, vy, vz] = *point;
        let value = formula.eval(&[x, y, z, vx, vy, vz, time]);
        if !value.is_finite() {
            let place = describe_point(self.space().dimension(), point);
            self.failure.get_or_insert_with(|| formula.undefined(value, place));
            return 0.0;
        }
        value
    }

    /// Follows the particle with parameters `q`. What starts outside of the velocity box, or does
    /// not go inwards where it should enter, is not there.
    fn image(&mut self, sheet: InitialSheet, q: &[f64; MAX_DIMENSION]) -> Image {
        let n = self.space().dimension();
        let mut point = [0.0; 6];
        point[..n].copy_from_slice(&q[..n]);
        let mut time = self.case.end;
        if let InitialSheet::Entering { axis, upper } = sheet {
            let x = &self.space().x[axis];
            point[axis] = if upper { x.upper } else { x.lower };
            time = if upper { time - q[axis] } else { q[axis] };
        }
        let start = self.case.end - time;
        let velocity = self.velocity;
        for (a, formula) in velocity.iter().enumerate() {
            point[3 + a] = self.value(formula, &point, start);
        }
        let phi = &self.case.fields[0];
        let density = match sheet {
            InitialSheet::Initial => self.value(&phi.initial, &point, start),
            InitialSheet::Entering { axis, upper } => {
                let inwards = if upper { -point[3 + axis] } else { point[3 + axis] };
                if inwards > 0.0 {
                    inwards * self.value(phi.entering(), &point, start)
                } else {
                    0.0
                }
            }
        };
        let mut followed = if density == 0.0 {
            // Zero density: the particle need not be traced.
            Followed { point, left: Some(time), exit: None, history: 0, turns: [0; MAX_DIMENSION] }
        } else {
            self.tracer.follow(&point, time)
        };
        // Periodic axes unrolled, so that no image is cut in two.
        for (a, axis) in self.space().x.iter().enumerate() {
            followed.point[a] += f64::from(followed.turns[a]) * (axis.upper - axis.lower);
        }
        Image { density, followed }
    }

    /// Follows a piece, or its halves.
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
        let stays = centre.followed.left.is_none();
        let shape = (whole && stays).then(|| ImageShape::new(n, &centre, corners));
        let halve = self.axis_to_halve(&piece, &centre, corners, shape.as_ref());
        if let Some(a) = halve.filter(|_| self.budget > 0) {
            self.budget = self.budget.saturating_sub(2 * (1 + corners.len()));
            for sign in [-1.0, 1.0] {
                let mut part = piece;
                part.half[a] *= 0.5;
                part.centre[a] += sign * part.half[a];
                part.depth[a] += 1;
                self.follow(sheet, part);
            }
        } else if stays {
            // Where the piece is torn or bent in spite of its size, all of it goes where its centre
            // goes.
            let shape = shape.filter(|shape| !self.bent(shape));
            self.add(&piece, &centre, corners, shape.as_ref());
        }
    }

    /// Whether an image bends by more than a part of a cell.
    fn bent(&self, shape: &ImageShape) -> bool {
        let mut axes = self.space().x.iter().zip(&shape.bend);
        axes.any(|(axis, bend)| bend.abs() > BENDING * mean_width(axis))
    }

    /// Along which axis a piece is to be halved: the first along which its corners went other ways,
    /// or its image or its density is not linear.
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
        // If the corners agree with each other and not with the centre, they do not identify the
        // axis.
        let whole = corners.iter().all(|c| c.same(centre));
        let astray = !whole && !(0..n).any(torn);
        let rough = |a: usize| {
            shape.is_some_and(|shape| {
                let mut axes = self.space().x.iter().zip(&shape.secants[a]);
                let change = shape.change.abs() > CHANGE * centre.density.abs();
                let mut wide = || axes.any(|(axis, s)| s.abs() > WIDEST * mean_width(axis));
                change || self.bent(shape) || n > 1 && wide()
            })
        };
        let finest = FINEST[n - 1];
        (0..n).find(|&a| piece.depth[a] < finest && (torn(a) || astray || rough(a)))
    }

    /// Adds a piece to the mass, and in one dimension to the curve.
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
        if n == 1 {
            let history = centre.followed.history;
            let ends = [corners[0].followed.point, corners[1].followed.point];
            for ends in self.rolled(&ends) {
                self.draw(mass / (2.0 * half[0]), history, &ends);
            }
        }
    }

    /// The line between two points in one dimension, on a periodic axis cut where it goes on at the
    /// other end.
    fn rolled(&self, [first, last]: &[[f64; 6]; 2]) -> Vec<[[f64; 6]; 2]> {
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

    /// Puts mass evenly over the box `middle ± half` of space.
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
                    self.mass[cell] += part;
                    for (b, momentum) in self.momentum.iter_mut().enumerate() {
                        momentum[cell] += part * middle[3 + b];
                    }
                }
            }
        }
    }

    /// Adds a piece to the curve: its ends, the first only where a branch begins.
    fn draw(&mut self, density: f64, history: u64, [first, last]: &[[f64; 6]; 2]) {
        let width = [self.space().x[0].width(), self.space().v[0].width()];
        let continues = self.last.is_some_and(|(before, end)| {
            history == before
                && (first[0] - end[0]).abs() < GAP * width[0]
                && (first[3] - end[3]).abs() < GAP * width[1]
        });
        let mut branch = self.curve.branch.last().copied().unwrap_or(-1.0);
        let curve = &mut self.curve;
        let mut add = |point: &[f64; 6], branch: f64| {
            curve.x.push(point[0]);
            curve.v.push(point[3]);
            curve.density.push(density);
            curve.branch.push(branch);
        };
        if !continues {
            branch += 1.0;
            add(first, branch);
        }
        add(last, branch);
        self.last = Some((history, *last));
    }

    fn finish(self) -> Result<ExactMoments> {
        if let Some(failure) = self.failure {
            return Err(failure);
        }
        let space = &self.case.space;
        let mut volumes = Vec::with_capacity(self.mass.len());
        let cells: Vec<Range<usize>> = space.x.iter().map(|a| 0..a.cells).collect();
        for_each_cell(&cells, |i| {
            volumes.push(space.x.iter().zip(i).map(|(a, i)| a.weight(*i)).product::<f64>());
        });
        let average =
            |sums: &Vec<f64>| sums.iter().zip(&volumes).map(|(sum, volume)| sum / volume).collect();
        let largest = self.mass.iter().fold(0.0, |m: f64, x| m.max(x.abs()));
        let mean = |momentum: &Vec<f64>| {
            let ratio = |(p, m): (&f64, &f64)| {
                if m.abs() > EMPTY * largest { p / m } else { f64::NAN }
            };
            momentum.iter().zip(&self.mass).map(ratio).collect()
        };
        Ok(ExactMoments {
            density: average(&self.mass),
            momentum: self.momentum.iter().map(average).collect(),
            velocity: self.momentum.iter().map(mean).collect(),
            curve: (space.dimension() == 1).then_some(self.curve),
        })
    }
}

/// Mean width of the cells of an axis.
fn mean_width(axis: &Axis) -> f64 {
    axis.width() / axis.nodes.count() as f64
}

/// The cells of an axis.
struct Cells<'a> {
    axis: &'a Axis,
    faces: &'a [f64],
}

impl Cells<'_> {
    /// The cell that holds `x`; beyond the axis the one at its end.
    fn at(&self, x: f64) -> usize {
        let place = ((x - self.axis.lower) / self.axis.width()).floor().max(0.0) as usize;
        let count = self.axis.nodes.count();
        let first = place.min(self.axis.elements() - 1) * count;
        (first..first + count).rfind(|i| self.faces[*i] <= x).unwrap_or(first)
    }

    /// The cells that `[lower, upper]` overlaps, each with its part of the interval; parts sum to
    /// 1. What sticks out of the axis counts for the cell at its end.
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

    /// As [`overlap`](Self::overlap), on a periodic axis, of an interval anywhere: cells may come
    /// more than once.
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
