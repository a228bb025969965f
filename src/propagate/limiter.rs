//! Limited slopes, of second order in `x` and `v`: a correction of the first-order right-hand side
//! `A f + b`.
//!
//! The paper (remark after section 4.2) replaces the source `f` of a face by its value at the face,
//! `f ± ½Δ s`. The scheme is linear in its sources, so this adds, axis by axis,
//!
//! ```text
//! −|speed| (face of the cell itself − Σ weight · face of the source),   face = ± half,
//! half_i = ½ (f_{i+1} − f_i) ψ(θ_i),  θ_i = (f_i − f_{i−1})/(f_{i+1} − f_i)
//! ```
//!
//! with `+` at an upper and `−` at a lower face, and the weights of `A` from [`Scheme::neighbour`].
//! `ψ = 0` adds nothing. `ψ` is minmod or van Leer, both symmetric in the two differences.
//!
//! **Next to a jump** `f_{i±1}` at the same velocity belongs to another energy. The difference is
//! taken along the path instead, to `f` behind the face at the same energy, transmitted or
//! reflected: `Σ weight · f` again. So a face value always lies between `f_i` and a mean of values
//! on the path, and the maximum principle holds across jumps, too: forward Euler keeps `min f, max
//! f` while `dt · rate · (1 + ½ max ψ) ≤ 1` (Harten 1983), [`longest_step`], and so does every
//! convex combination of such steps.
//!
//! **At the box's ends** two ghost cells hold the inflow. The first has a slope like a cell, so
//! that nothing enters from an empty outside. At a jump that particles pass from beyond the
//! velocities of the box, that slope is zero. Where particles leave, nothing is known beyond, and
//! the slope is zero.

use crate::base::error::Result;
use crate::matrix::block_matrix::BlockMatrix;
use crate::parallel::communicator::GhostExchange;
use crate::parallel::partition::LocalIndex;
use crate::problem::case::{Case, Limiter};
use crate::problem::grid::PhaseSpace;
use crate::scheme::rows::{Row, Scheme};
use std::ops::Range;

/// The longest step of forward Euler that keeps the maximum principle, times the largest rate:
/// `1/(1 + ½ max ψ)`.
pub fn longest_step(limiter: Limiter) -> f64 {
    match limiter {
        Limiter::None => 1.0,
        Limiter::Minmod => 2.0 / 3.0,
        Limiter::VanLeer => 0.5,
    }
}

/// `½ b ψ(a/b)` for the differences `a` to the lower and `b` to the upper neighbour.
#[inline]
pub fn half_difference(limiter: Limiter, a: f64, b: f64) -> f64 {
    let monotone = (a > 0.0 && b > 0.0) || (a < 0.0 && b < 0.0);
    match limiter {
        Limiter::Minmod if monotone => 0.5 * if a.abs() < b.abs() { a } else { b },
        Limiter::VanLeer if monotone => a * (b / (a + b)),
        _ => 0.0,
    }
}

/// The half difference of the first ghost cell at an end of the box where `speed` leads inwards,
/// for the values of the second ghost cell, of the first, and of the cell beside it.
#[inline]
fn half_of_ghost(limiter: Limiter, speed: f64, [farther, ghost, cell]: [f64; 3]) -> f64 {
    if speed > 0.0 {
        half_difference(limiter, ghost - farther, cell - ghost)
    } else {
        half_difference(limiter, ghost - cell, farther - ghost)
    }
}

/// The neighbour at one side of a space cell.
#[derive(Clone, Copy, Debug)]
enum SideNeighbour {
    /// A cell, by the number of its first unknown.
    Cell(u32),
    /// A jump or an end of the box: one face for each velocity, by the number of the first.
    Faces(u32),
}

/// A face with a jump, or at an end of the box.
#[derive(Clone, Debug)]
struct LimitedFace {
    /// The first of the face's sources in `shares`.
    first: u32,
    count: u32,
    /// The contribution of the sources off the grid.
    entering: f64,
    /// At an end of the box, the inflow one cell farther outside.
    farther: Option<f64>,
    /// Whether `f` behind it is known.
    known: bool,
}

/// A source of a face.
#[derive(Clone, Copy, Debug)]
struct SourceShare {
    /// Local number of the source's unknown.
    column: u32,
    /// Whether the source lies in the cell itself, by reflection.
    same: bool,
    weight: f64,
}

/// Transport along a space axis.
struct LimitedTransport {
    /// `v/Δx`, by velocity cell.
    speed: Vec<f64>,
    /// The neighbours below and above each space cell.
    beyond: Vec<[SideNeighbour; 2]>,
    faces: Vec<LimitedFace>,
    shares: Vec<SourceShare>,
}

/// The force along a velocity axis.
struct LimitedForce {
    /// `−slope/Δv`, by space cell.
    speed: Vec<f64>,
    /// Cells along the axis, and how far apart they are in the ordering.
    cells: usize,
    stride: usize,
    /// Inflow in the two ghost cells at the upstream end, the first one first, by space cell and
    /// line; empty if it is `constant`.
    entering: Vec<[f64; 2]>,
    constant: f64,
}

/// The slopes of one field on this rank, with all that is needed to compute them; made once.
pub struct Reconstruction {
    limiter: Limiter,
    velocity_cells: usize,
    transport: Vec<LimitedTransport>,
    force: Vec<LimitedForce>,
    half: Vec<f64>,
}

impl Reconstruction {
    /// The reconstruction for field number `field` of `case` on the block of `matrix`; `None`
    /// without a limiter.
    ///
    /// # Errors
    /// [`crate::base::error::Error::Formula`] where the inflow is not finite. Not collective.
    pub fn new(case: &Case, matrix: &BlockMatrix, field: usize) -> Result<Option<Self>> {
        if case.scheme.limiter == Limiter::None {
            return Ok(None);
        }
        let scheme = Scheme::new(case, &matrix.block.wide_ranges())?;
        let mut row = Row::default();
        let n = case.space.dimension();
        let this = Self {
            limiter: case.scheme.limiter,
            velocity_cells: matrix.block.velocity_cells,
            transport: (0..n)
                .map(|a| LimitedTransport::new(&case.space, &scheme, matrix, a, field, &mut row))
                .collect(),
            force: (0..n)
                .map(|a| LimitedForce::new(case, &scheme, matrix, a, field, &mut row))
                .filter(|force| force.speed.iter().any(|&d| d != 0.0))
                .collect(),
            half: vec![0.0; matrix.length()],
        };
        scheme.inflow_is_finite(&row)?;
        Ok(Some(this))
    }

    /// `image ← image +` the second-order part for `state`, whose ghosts are up to date. Collective
    /// over the space group.
    pub fn add(
        &mut self,
        exchange: &mut GhostExchange,
        image: &mut [f64],
        state: &[f64],
        rows: usize,
    ) {
        let (limiter, nv, half) = (self.limiter, self.velocity_cells, &mut self.half);
        for transport in &self.transport {
            transport.slopes(half, state, limiter);
            exchange.start(&half[..rows]);
            exchange.finish(&mut half[rows..]);
            transport.add(image, state, half, limiter);
        }
        for force in &self.force {
            force.slopes(half, state, limiter, nv);
            force.add(image, state, half, limiter, nv);
        }
    }
}

impl LimitedTransport {
    fn new(
        space: &PhaseSpace,
        scheme: &Scheme<'_>,
        matrix: &BlockMatrix,
        axis: usize,
        field: usize,
        row: &mut Row,
    ) -> Self {
        let block = &matrix.block;
        let nv = block.velocity_cells;
        // The number of an unknown on this rank, ghosts behind the rows; `None` if it is not there.
        let local = |global: usize| match block.local(global)? {
            LocalIndex::Own(cell) => Some(cell as u32),
            LocalIndex::Ghost(ghost) => Some((matrix.rows() + ghost) as u32),
        };
        let mut this =
            Self {
                // A periodic axis of one cell has no slope and needs no correction.
                speed: (0..nv)
                    .map(|v| {
                        if space.is_single(axis) { 0.0 } else { scheme.speed(&space.cell(v), axis) }
                    })
                    .collect(),
                beyond: Vec::with_capacity(block.space_cells()),
                faces: Vec::new(),
                shares: Vec::new(),
            };
        block.for_each_own(|first, _| {
            let cell = space.cell(first);
            let mut beyond = [SideNeighbour::Faces(0); 2];
            for (side, above) in [false, true].into_iter().enumerate() {
                let plain = scheme.plain_neighbour(&cell, axis, above);
                if let Some(number) = plain.and_then(|next| local(space.index(&next))) {
                    beyond[side] = SideNeighbour::Cell(number);
                    continue;
                }
                beyond[side] = SideNeighbour::Faces(this.faces.len() as u32);
                let step = if above { 1 } else { -1 };
                let ends_box = space.wrap(axis, cell[axis] as i64 + step).is_none();
                for v in 0..nv {
                    let speed = this.speed[v];
                    row.clear();
                    if speed != 0.0 {
                        scheme.neighbour(row, &space.cell(first + v), axis, above);
                    }
                    // For particles that leave the grid through this face, the value behind it is
                    // not the inflow.
                    let leaves = (speed > 0.0) == above;
                    let known = speed != 0.0 && !(leaves && row.inflow_rate > 0.0);
                    let own = first..first + nv;
                    let mut face = this.face(row, field, known, own, &local);
                    if ends_box && known {
                        scheme.second_ghost(row, &space.cell(first + v), axis, above);
                        face.farther = Some(row.inflow[field]);
                    }
                    this.faces.push(face);
                }
            }
            this.beyond.push(beyond);
        });
        this
    }

    /// The face of the next velocity cell, with its share of the inflow of `field`, which is in
    /// `row`. Adds its shares of cells. The unknowns of the same space cell are `own`. The number
    /// of an unknown on this rank is `local`.
    fn face(
        &mut self,
        row: &Row,
        field: usize,
        known: bool,
        own: Range<usize>,
        local: &impl Fn(usize) -> Option<u32>,
    ) -> LimitedFace {
        let first = self.shares.len();
        self.shares.extend(row.entries.iter().filter_map(|&(column, weight)| {
            Some(SourceShare { column: local(column)?, same: own.contains(&column), weight })
        }));
        LimitedFace {
            first: first as u32,
            count: (self.shares.len() - first) as u32,
            entering: row.inflow[field],
            farther: None,
            known,
        }
    }

    fn shares(&self, face: &LimitedFace) -> &[SourceShare] {
        &self.shares[face.first as usize..][..face.count as usize]
    }

    /// `f` behind a side of cell `v` of a space cell, if it is known.
    fn value(&self, beyond: SideNeighbour, v: usize, state: &[f64]) -> Option<f64> {
        match beyond {
            SideNeighbour::Cell(first) => Some(state[first as usize + v]),
            SideNeighbour::Faces(first) => {
                let face = &self.faces[first as usize + v];
                let sum = |sum, s: &SourceShare| sum + s.weight * state[s.column as usize];
                face.known.then(|| self.shares(face).iter().fold(face.entering, sum))
            }
        }
    }

    fn slopes(&self, half: &mut [f64], state: &[f64], limiter: Limiter) {
        let nv = self.speed.len();
        for (c, &[below, above]) in self.beyond.iter().enumerate() {
            let cells = c * nv..(c + 1) * nv;
            if let (SideNeighbour::Cell(below), SideNeighbour::Cell(above)) = (below, above) {
                let lower = &state[below as usize..][..nv];
                let upper = &state[above as usize..][..nv];
                let own = &state[cells.clone()];
                for (v, half) in half[cells].iter_mut().enumerate() {
                    *half = half_difference(limiter, own[v] - lower[v], upper[v] - own[v]);
                }
                continue;
            }
            for (v, i) in cells.enumerate() {
                let f = state[i];
                half[i] = match (self.value(below, v, state), self.value(above, v, state)) {
                    (Some(lower), Some(upper)) => half_difference(limiter, f - lower, upper - f),
                    _ => 0.0,
                };
            }
        }
    }

    fn add(&self, image: &mut [f64], state: &[f64], half: &[f64], limiter: Limiter) {
        let nv = self.speed.len();
        for (c, beyond) in self.beyond.iter().enumerate() {
            for (v, &speed) in self.speed.iter().enumerate() {
                if speed == 0.0 {
                    continue;
                }
                let i = c * nv + v;
                image[i] -= speed * half[i];
                match beyond[usize::from(speed < 0.0)] {
                    SideNeighbour::Cell(first) => image[i] += speed * half[first as usize + v],
                    SideNeighbour::Faces(first) => {
                        let face = &self.faces[first as usize + v];
                        self.add_across(face, speed, half, &mut image[i]);
                        if let Some(farther) = face.farther {
                            let values = [farther, face.entering, state[i]];
                            image[i] += speed * half_of_ghost(limiter, speed, values);
                        }
                    }
                }
            }
        }
    }

    /// Adds to `image` what enters from other cells across `face` with `speed`.
    #[inline]
    fn add_across(&self, face: &LimitedFace, speed: f64, half: &[f64], image: &mut f64) {
        for share in self.shares(face) {
            // The source across this face continues its motion; the reflected source returns.
            let signed = if share.same { -speed } else { speed };
            *image += signed * share.weight * half[share.column as usize];
        }
    }
}

impl LimitedForce {
    fn new(
        case: &Case,
        scheme: &Scheme<'_>,
        matrix: &BlockMatrix,
        a: usize,
        field: usize,
        row: &mut Row,
    ) -> Self {
        let (space, block) = (&case.space, &matrix.block);
        let axis = space.dimension() + a;
        let constant = case.fields[field].entering().constant();
        let mut this = Self {
            speed: Vec::with_capacity(block.space_cells()),
            cells: space.v[a].cells,
            stride: space.stride(axis),
            entering: Vec::new(),
            constant: constant.unwrap_or(0.0),
        };
        block.for_each_own(|first, _| {
            let d = scheme.speed(&space.cell(first), axis);
            this.speed.push(d);
            if constant.is_some() {
                return;
            }
            let end = if d < 0.0 { this.cells - 1 } else { 0 };
            for line in this.lines(block.velocity_cells) {
                let mut entering = [0.0; 2];
                if d != 0.0 {
                    let cell = space.cell(first + line + end * this.stride);
                    scheme.neighbour(row, &cell, axis, d < 0.0);
                    entering[0] = row.inflow[field];
                    scheme.second_ghost(row, &cell, axis, d < 0.0);
                    entering[1] = row.inflow[field];
                }
                this.entering.push(entering);
            }
        });
        this
    }

    /// First unknowns of the lines along the axis, of `velocity_cells`.
    fn lines(&self, velocity_cells: usize) -> impl Iterator<Item = usize> + use<> {
        let (stride, block) = (self.stride, self.cells * self.stride);
        (0..velocity_cells)
            .step_by(block)
            .flat_map(move |outer| (0..stride).map(move |inner| outer + inner))
    }

    /// Calls `visit` with the speed, the first unknown and the inflow of every line.
    fn for_each_line(&self, velocity_cells: usize, mut visit: impl FnMut(f64, usize, [f64; 2])) {
        let mut number = 0;
        for (c, &d) in self.speed.iter().enumerate() {
            for line in self.lines(velocity_cells) {
                let entering = self.entering.get(number).copied();
                number += 1;
                if d != 0.0 {
                    let entering = entering.unwrap_or([self.constant; 2]);
                    visit(d, c * velocity_cells + line, entering);
                }
            }
        }
    }

    fn slopes(&self, half: &mut [f64], state: &[f64], limiter: Limiter, velocity_cells: usize) {
        let (stride, last) = (self.stride, self.cells - 1);
        self.for_each_line(velocity_cells, |d, line, [entering, _]| {
            let value = |j: usize| state[line + j * stride];
            for j in 0..=last {
                let lower = match j {
                    0 => (d > 0.0).then_some(entering),
                    _ => Some(value(j - 1)),
                };
                let upper =
                    if j < last { Some(value(j + 1)) } else { (d < 0.0).then_some(entering) };
                let f = value(j);
                half[line + j * stride] = match (lower, upper) {
                    (Some(lower), Some(upper)) => half_difference(limiter, f - lower, upper - f),
                    _ => 0.0,
                };
            }
        });
    }

    fn add(
        &self,
        image: &mut [f64],
        state: &[f64],
        half: &[f64],
        limiter: Limiter,
        velocity_cells: usize,
    ) {
        let (stride, last) = (self.stride, self.cells - 1);
        self.for_each_line(velocity_cells, |d, line, [entering, farther]| {
            let end = line + if d > 0.0 { 0 } else { last * stride };
            image[end] += d * half_of_ghost(limiter, d, [farther, entering, state[end]]);
            for j in 0..=last {
                let i = line + j * stride;
                image[i] -= d * half[i];
                if i != end {
                    let source = if d > 0.0 { i - stride } else { i + stride };
                    image[i] += d * half[source];
                }
            }
        });
    }
}
