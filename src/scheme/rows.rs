//! The Hamiltonian-preserving scheme, row by row: the only definition of `A` and `b`.
//!
//! `f' = A f + b` with (paper, section 4.2, and its n-dimensional form in section 6)
//!
//! ```text
//! (f_ij)_t = − Σ_a |v_a|/Δx_a (f_ij − Σ weight f_source)          transport, see `interface`
//!            − Σ_a |d_a| (f_ij − f_{i, j ∓ e_a})                  force, upwind
//! ```
//!
//! where `d_a = −slope_a/Δv_a`.
//!
//! Off-diagonal entries are not negative, row sums not positive. Minus a row sum is the rate at
//! which the row takes inflow.
//!
//! This is the upwind scheme of degree 0. Rows of a higher degree or another flux are in
//! [`galerkin`](crate::scheme::galerkin).

use crate::base::error::Result;
use crate::problem::case::{Case, LiouvilleField};
use crate::problem::grid::{Cell, PhaseSpace, describe_point};
use crate::problem::potential::Potential;
use crate::scheme::galerkin::{Elements, LineTerms};
use crate::scheme::interface::{SourceSide, sources, velocity};
pub use crate::scheme::row::Row;
use crate::scheme::row::{InflowTerm, UndefinedInflow};
use std::ops::Range;

/// The scheme on a part of the grid.
#[derive(Clone, Debug)]
pub struct Scheme<'a> {
    case: &'a Case,
    space: &'a PhaseSpace,
    /// `V` on the cells of these rows.
    pub potential: Potential,
    /// The fields that have inflow, and the time of the inflow.
    entering: InflowTerm<'a>,
    /// Constants of the Galerkin rows; none for the upwind scheme of degree 0.
    elements: Option<Elements>,
}

impl<'a> Scheme<'a> {
    /// The scheme for rows whose space cells lie in `ranges`.
    ///
    /// # Errors
    /// [`Error::Formula`](crate::base::error::Error::Formula) where `V` is not finite.
    pub fn new(case: &'a Case, ranges: &[Range<usize>]) -> Result<Self> {
        // Rows need the jump at their upper face: one more layer.
        let wider: Vec<_> = ranges
            .iter()
            .zip(&case.space.x)
            .map(|(r, axis)| r.start..(r.end + 1).min(axis.cells))
            .collect();
        let potential = Potential::new(case, &wider)?;
        let elements =
            if case.is_galerkin() { Some(Elements::new(case, &potential)?) } else { None };
        let fields: &[LiouvilleField] = if case.enters() { &case.fields } else { &[] };
        let entering = InflowTerm { fields, time: case.start_time };
        Ok(Self { case, space: &case.space, potential, entering, elements })
    }

    /// The scheme on the whole grid.
    ///
    /// # Errors
    /// As [`new`](Self::new).
    pub fn whole(case: &'a Case) -> Result<Self> {
        Self::new(case, &case.space.space_ranges())
    }

    /// Row `index` of `A` and `b`.
    pub fn row(&self, row: &mut Row, index: usize) {
        row.clear();
        let cell = self.space.cell(index);
        if let Some(lines) = self.lines() {
            return lines.row(row, &cell);
        }
        let n = self.space.dimension();
        let mut diagonal = 0.0;
        for axis in (0..n).flat_map(|a| [a, n + a]) {
            let speed = self.speed(&cell, axis);
            if speed != 0.0 {
                let rate = speed.abs();
                self.behind_face(row, &cell, axis, speed < 0.0, rate);
                diagonal -= rate;
            }
        }
        row.entries.push((index, diagonal));
        row.finish();
    }

    /// The terms along lines of elements; none for the upwind scheme of degree 0.
    fn lines(&self) -> Option<LineTerms<'_>> {
        self.elements.as_ref().map(|elements| LineTerms {
            space: self.space,
            potential: &self.potential,
            elements,
            entering: self.entering,
        })
    }

    /// The contribution of axis `axis` of the `2n` to row `index` of `A` and `b`: transport along a
    /// space axis, force along a velocity axis. Entries that are not zero.
    pub fn part(&self, row: &mut Row, index: usize, axis: usize) {
        row.clear();
        let cell = self.space.cell(index);
        if let Some(lines) = self.lines() {
            lines.add_axis(row, &cell, axis);
        } else {
            let speed = self.speed(&cell, axis);
            if speed != 0.0 {
                self.behind_face(row, &cell, axis, speed < 0.0, speed.abs());
                row.entries.push((index, -speed.abs()));
            }
        }
        row.finish();
        row.entries.retain(|e| e.1 != 0.0);
    }

    /// For degree 0, the cells that particles in `cell` cross along `axis` of the `2n` in a unit of
    /// time: `v_a/Δx_a` in space, `d_a` in velocity. Zero if the cell is its own neighbour, so that
    /// outflow returns unchanged.
    pub fn speed(&self, cell: &Cell, axis: usize) -> f64 {
        let n = self.space.dimension();
        if axis < n {
            if self.space.is_single(axis) && self.potential.jump_below(cell, axis) == 0.0 {
                return 0.0;
            }
            velocity(&self.space.v[axis], cell[n + axis] as i64) / self.space.x[axis].width()
        } else {
            // The force −slope pushes particles up in velocity where V falls.
            let a = axis - n;
            -self.potential.slope(cell, a) / self.space.v[a].width()
        }
    }

    /// The cell behind `cell`'s lower face along space axis `a`, or behind its upper one if
    /// `above`, at the same velocity; `None` where the face ends the box or `V` jumps.
    pub fn plain_neighbour(&self, cell: &Cell, a: usize, above: bool) -> Option<Cell> {
        let (step, jump) = if above {
            (1, self.potential.jump_above(cell, a))
        } else {
            (-1, self.potential.jump_below(cell, a))
        };
        let mut behind = *cell;
        behind[a] = self.space.wrap(a, cell[a] as i64 + step)?;
        (jump == 0.0).then_some(behind)
    }

    /// The value that the scheme of degree 0 takes behind the lower face of `cell` along `axis` of
    /// the `2n`, or behind the upper one if `above`, at the same energy: `Σ entries f + inflow`.
    /// The weights have the sum 1, of which `draw` lies off the grid. If particles leave the cell
    /// through this face, the entries are their destinations, by time reversal: transmitted or
    /// reflected.
    pub fn neighbour(&self, row: &mut Row, cell: &Cell, axis: usize, above: bool) {
        row.clear();
        self.behind_face(row, cell, axis, above, 1.0);
        row.finish();
    }

    /// Puts into `row.inflow` that in the second cell beyond an end of the box, beside which `cell`
    /// is, along `axis` of the `2n`; for degree 0.
    pub fn second_ghost(&self, row: &mut Row, cell: &Cell, axis: usize, above: bool) {
        row.clear();
        let n = self.space.dimension();
        let a = axis % n;
        let mut source = [cell[a] as i64, cell[n + a] as i64];
        source[axis / n] += if above { 2 } else { -2 };
        self.take(row, cell, a, source, 1.0);
    }

    /// Adds `rate` times the value behind a face, see [`neighbour`](Self::neighbour): in velocity
    /// the next cell, in space the sources of [`interface`].
    fn behind_face(&self, row: &mut Row, cell: &Cell, axis: usize, above: bool, rate: f64) {
        let n = self.space.dimension();
        let step = if above { 1 } else { -1 };
        if let Some(a) = axis.checked_sub(n) {
            let source = [cell[a] as i64, cell[n + a] as i64 + step];
            return self.take(row, cell, a, source, rate);
        }
        let a = axis;
        // V of this cell minus V of the neighbour.
        let rise = if above {
            -self.potential.jump_above(cell, a)
        } else {
            self.potential.jump_below(cell, a)
        };
        let mut list = std::mem::take(&mut row.scratch);
        let (v, j) = (&self.space.v[a], cell[n + a] as i64);
        sources(&mut list, v, self.case.scheme.interface, j, rise);
        for source in &list {
            let i = match source.side {
                SourceSide::Across => cell[a] as i64 + step,
                SourceSide::Same => cell[a] as i64,
            };
            self.take(row, cell, a, [i, source.velocity], rate * source.weight);
        }
        row.scratch = list;
    }

    /// Adds `rate · f` of the cell that has `(i, j)` instead of `cell`'s indices along space and
    /// velocity axis `a`; an inflow value where that is off the grid.
    fn take(&self, row: &mut Row, cell: &Cell, a: usize, [i, j]: [i64; 2], rate: f64) {
        let n = self.space.dimension();
        let (x, v) = (&self.space.x[a], &self.space.v[a]);
        let inside = self.space.wrap(a, i);
        if let Some(place) = inside.filter(|_| (0..v.cells as i64).contains(&j)) {
            let mut source = *cell;
            source[a] = place;
            source[n + a] = j as usize;
            row.entries.push((self.space.index(&source), rate));
            return;
        }
        row.inflow_rate += rate;
        row.damping += rate;
        // A cell that was left out has the value zero.
        if inside.is_some() && v.leaves_out(j) {
            return;
        }
        let mut point = self.space.point(cell);
        point[a] = x.centre(inside.map_or(i, |place| place as i64));
        point[3 + a] = v.centre(j);
        row.enter(self.entering, rate, point);
    }

    /// `Σ rate b²` over the sources of a row of the field with inflow; for degree 0, `b²/g` with
    /// the whole `b`, which is at most that.
    pub fn inflow_strength(&self, row: &Row) -> f64 {
        if self.elements.is_none() {
            let b: f64 = row.inflow.iter().sum();
            return if b == 0.0 { 0.0 } else { b * b / row.inflow_rate };
        }
        let square = |point: &[f64; 6]| {
            let values =
                self.case.fields.iter().map(|f| f.entering().at_point(point, self.case.start_time));
            let b: f64 = values.sum();
            b * b
        };
        row.sources.iter().map(|source| source.rate * square(&source.point)).sum()
    }

    /// The error of a row whose inflow was not finite, if there was one among the rows computed
    /// with `row`.
    ///
    /// # Errors
    /// [`Error::Formula`](crate::base::error::Error::Formula), naming the place.
    pub fn inflow_is_finite(&self, row: &Row) -> Result<()> {
        let Some(UndefinedInflow { field, value, point }) = row.bad else {
            return Ok(());
        };
        let point = describe_point(self.space.dimension(), &point);
        let formula = self.case.fields[field].entering();
        Err(formula.undefined(value, point))
    }
}

/// `Σ_a max |v_a|/Δx_a`, the fastest transport if `V` does not jump at the face of a cell that is
/// its own neighbour. With the steepest force it bounds `max_i |A_ii|`. It depends on the case
/// alone, not on the ranks.
pub fn transport_rate(space: &PhaseSpace) -> f64 {
    (0..space.dimension()).filter(|&a| !space.is_single(a)).map(|a| fastest(space, a)).sum()
}

/// The largest rate of transport along space axis `a`: `max |v_a|/Δx_a`.
pub fn fastest(space: &PhaseSpace, a: usize) -> f64 {
    let v = &space.v[a];
    let ends = [0, v.cells as i64 - 1].map(|j| velocity(v, j).abs());
    ends[0].max(ends[1]) / space.x[a].width()
}
