//! Rows of `A` and `b` for any degree and flux: a discontinuous Galerkin scheme, linear and
//! dissipative by construction.
//!
//! Unknowns are the values at the nodes of the elements, Gauss–Lobatto along space axes and
//! Gauss–Legendre along velocity axes (see [`element`](crate::problem::element)). Every term acts
//! along a line of one axis: with the speed `c` (`v_a` in space, `−∂V/∂x_a` in velocity, constant
//! on the line) and `s = |c|`, node `m` of an element of width `h` has, in strong form,
//!
//! ```text
//! f_m' = − c (2/h) Σ_n D_mn f_n
//!        + s ½(1 + α) l_m (f_o − f_i) (2/h)/w_m          at the face where the flow comes in
//!        + s ½(1 − α) r_m (f_o − f_i) (2/h)/w_m          at the face where it goes out
//! ```
//!
//! with the traces `f_o` before the face and `f_i` behind it, and `l`, `r` the values of the
//! polynomials at the two faces. `α = 1` is the upwind flux, `α = 0` the central one. At open ends
//! of the box the flux is upwind, and `f_o` is the inflow. At closed ends the flux is that of inner
//! faces, with 0 outside. At a jump of `V` the traces are coupled by the energy-matched
//! [`FaceCoupling`]. If a region gives partial reflection (`potential.reflection`), the flux at its
//! jumps is upwind, and degree 0 uses this scheme, too.
//!
//! With the weights `π`, the products of quadrature weights, and `D = diag(√π)`, the symmetric part
//! of `D A D⁻¹` is `−½ Σ_faces α s (f_o − f_i)² − ½ Σ_outflow s f² ≤ 0` in any dimension.

use crate::base::error::{Error, Result};
use crate::problem::case::{Case, Region};
use crate::problem::element::ReferenceElement;
use crate::problem::grid::{Axis, Cell, MAX_DIMENSION, PhaseSpace};
use crate::problem::potential::{JumpKind, Potential};
use crate::scheme::interface::energy::{FaceCoupling, FaceSide};
use crate::scheme::interface::velocity;
use crate::scheme::row::{InflowTerm, Row};
use std::collections::HashMap;

/// The data that all rows of elements share.
#[derive(Clone, Debug)]
pub(super) struct Elements {
    /// `½(1 + α)` and `½(1 − α)`.
    inflow_part: f64,
    outflow_part: f64,
    /// Whether the ends of the box are closed.
    closed: bool,
    /// The couplings at jumps along each axis.
    couplings: [HashMap<JumpKind, Coupling>; MAX_DIMENSION],
}

impl Elements {
    /// The data of `case`, with a coupling for each jump of `potential`.
    ///
    /// # Errors
    /// [`Error::Input`] where a reflected part is not between 0 and 1.
    pub fn new(case: &Case, potential: &Potential) -> Result<Self> {
        let mut couplings: [HashMap<JumpKind, Coupling>; MAX_DIMENSION] = Default::default();
        for (a, axis) in case.space.v.iter().enumerate() {
            for kind in potential.jump_kinds(a) {
                couplings[a].insert(kind, coupling(&case.potential, axis, kind)?);
            }
        }
        Ok(Self {
            inflow_part: 0.5 * (1.0 + case.scheme.flux),
            outflow_part: 0.5 * (1.0 - case.scheme.flux),
            closed: case.is_closed(),
            couplings,
        })
    }
}

/// The coupling at a jump.
#[derive(Clone, Debug)]
struct Coupling {
    /// How the traces on both sides are coupled.
    traces: FaceCoupling,
    /// Whether the flux is upwind for any `α`. Partial reflection maps two traces to two by a
    /// contraction that is no isometry, so that its adjoint is not its inverse.
    is_upwind: bool,
}

/// The coupling at a jump, for the velocities of `axis`.
fn coupling(potential: &[Region], axis: &Axis, kind: JumpKind) -> Result<Coupling> {
    let region = kind.higher.map(|region| &potential[region]);
    let jump = kind.jump();
    let wrong = std::cell::Cell::new(None);
    let reflection = |energy: f64| {
        let part = region.map_or(0.0, |region| region.reflected(energy, jump.abs()));
        if !(0.0..=1.0).contains(&part) {
            wrong.set(Some((energy, part)));
        }
        part
    };
    let traces = FaceCoupling::new(axis, jump, &reflection);
    match (wrong.get(), region.and_then(|region| region.reflection.as_ref())) {
        (Some((energy, part)), Some(formula)) => Err(Error::Input(format!(
            "{} = \"{}\": {part} for E = {energy:.6}, jump = {:.6}; the reflected part must be \
             between 0 and 1",
            formula.place(),
            formula.text(),
            jump.abs()
        ))),
        (_, formula) => Ok(Coupling { traces, is_upwind: formula.is_some() }),
    }
}

/// A line of nodes through a cell, along one axis.
struct CellLine<'a> {
    reference: &'static ReferenceElement,
    axis: &'a Axis,
    /// The element of the cell, and the cell's node in it.
    element: i64,
    node: usize,
    /// Whether the speed is positive.
    up: bool,
    /// `s (2/h)`.
    rate: f64,
}

impl<'a> CellLine<'a> {
    fn new(axis: &'a Axis, cell: usize, speed: f64) -> Self {
        let (element, node) = axis.split(cell as i64);
        Self {
            reference: axis.nodes.reference(),
            axis,
            element,
            node,
            up: speed > 0.0,
            rate: speed.abs() * 2.0 / axis.width(),
        }
    }

    /// Values of the polynomials at the face where the flow comes in.
    fn entry(&self) -> &'static [f64] {
        if self.up { &self.reference.left } else { &self.reference.right }
    }

    /// Values of the polynomials at the face where the flow goes out.
    fn exit(&self) -> &'static [f64] {
        if self.up { &self.reference.right } else { &self.reference.left }
    }

    /// `s (2/h)/w_m`.
    fn lifted_rate(&self) -> f64 {
        self.rate / self.reference.weights[self.node]
    }

    /// The upstream and the downstream element.
    fn neighbours(&self) -> [i64; 2] {
        let step = if self.up { 1 } else { -1 };
        [self.element - step, self.element + step]
    }

    /// The first cell of an element.
    fn first(&self, element: i64) -> i64 {
        element * self.axis.nodes.count() as i64
    }

    /// The position just outside of the end of the box where the flow comes in.
    fn entry_end(&self) -> f64 {
        self.axis.just_outside(!self.up)
    }
}

/// The terms along the lines of a grid.
pub(super) struct LineTerms<'a> {
    /// The grid.
    pub space: &'a PhaseSpace,
    /// Jumps and slopes of `V`.
    pub potential: &'a Potential,
    /// The data that all rows share.
    pub elements: &'a Elements,
    /// The fields that have inflow, and the time of the inflow.
    pub entering: InflowTerm<'a>,
}

impl LineTerms<'_> {
    /// The row of `cell`.
    pub fn row(&self, row: &mut Row, cell: &Cell) {
        row.entries.push((self.space.index(cell), 0.0));
        let n = self.space.dimension();
        (0..n).flat_map(|a| [a, n + a]).for_each(|axis| self.add_axis(row, cell, axis));
        row.finish();
    }

    /// Adds the terms along axis `axis` of the `2n`.
    pub fn add_axis(&self, row: &mut Row, cell: &Cell, axis: usize) {
        match axis.checked_sub(self.space.dimension()) {
            None => self.add_transport(row, cell, axis),
            Some(a) => self.add_force(row, cell, a),
        }
    }

    /// Adds `value` times the cell that differs from `cell` in its index `j` along `axis`.
    fn couple(&self, row: &mut Row, cell: &Cell, [axis, j]: [usize; 2], value: f64) {
        let mut source = *cell;
        source[axis] = j;
        row.entries.push((self.space.index(&source), value));
    }

    /// Adds the derivative along a line of axis `axis` of the `2n`.
    fn add_derivative(&self, row: &mut Row, cell: &Cell, axis: usize, line: &CellLine<'_>) {
        let sign = if line.up { -1.0 } else { 1.0 };
        let first = line.first(line.element) as usize;
        for (n, d) in line.reference.derivative[line.node].iter().enumerate() {
            if *d != 0.0 {
                self.couple(row, cell, [axis, first + n], sign * line.rate * d);
            }
        }
    }

    /// Adds the transport along space axis `a`.
    fn add_transport(&self, row: &mut Row, cell: &Cell, a: usize) {
        let n = self.space.dimension();
        let speed = velocity(&self.space.v[a], cell[n + a] as i64);
        let single = self.space.is_single(a) && self.potential.jump_below(cell, a) == 0.0;
        if speed == 0.0 || single {
            return;
        }
        let line = CellLine::new(&self.space.x[a], cell[a], speed);
        self.add_derivative(row, cell, a, &line);
        // With Gauss–Lobatto nodes, one node carries the trace.
        if line.entry()[line.node] != 0.0 {
            self.add_entry(row, cell, a, &line);
        }
        if line.exit()[line.node] != 0.0 && self.elements.outflow_part != 0.0 {
            self.add_exit(row, cell, a, &line);
        }
    }

    /// The cell next to the element of `line`, upstream, or downstream if `downstream`; `None`
    /// beyond the box.
    fn across(&self, a: usize, line: &CellLine<'_>, downstream: bool) -> Option<usize> {
        let up = line.up == downstream;
        let beyond = if up { line.first(line.element + 1) } else { line.first(line.element) - 1 };
        self.space.wrap(a, beyond)
    }

    /// Adds the flux through the face where the flow comes in along space axis `a`.
    fn add_entry(&self, row: &mut Row, cell: &Cell, a: usize, line: &CellLine<'_>) {
        let (n, rate) = (self.space.dimension(), line.lifted_rate());
        let Some(across) = self.across(a, line, false) else {
            if self.elements.closed {
                let inner = self.elements.inflow_part * rate;
                return self.couple(row, cell, [a, cell[a]], -inner);
            }
            let mut point = self.space.point_in_element(cell);
            point[a] = line.entry_end();
            self.couple(row, cell, [a, cell[a]], -rate);
            row.inflow_rate += rate;
            row.damping += rate;
            return row.enter(self.entering, rate, point);
        };
        let kind = self.potential.jump_kind(cell, a, !line.up);
        let coupling = self.elements.couplings[a].get(&kind);
        let upwind = coupling.is_some_and(|coupling| coupling.is_upwind);
        let inner = if upwind { rate } else { self.elements.inflow_part * rate };
        self.couple(row, cell, [a, cell[a]], -inner);
        let Some(Coupling { traces, .. }) = coupling else {
            return self.couple(row, cell, [a, across], inner);
        };
        let side = if line.up { FaceSide::Above } else { FaceSide::Below };
        let trace = traces.trace(side, cell[n + a]);
        for share in &trace.partners {
            let mut source = *cell;
            source[a] = if share.side == side { cell[a] } else { across };
            source[n + a] = share.node;
            row.entries.push((self.space.index(&source), inner * share.weight));
        }
        if self.elements.closed {
            return;
        }
        // Inflow from outside the velocity box enters by the upwind flux.
        for &(node, weight) in &trace.unpaired {
            self.couple(row, cell, [n + a, node], -(rate - inner) * weight);
        }
        let (x, v) = (&self.space.x[a], &self.space.v[a]);
        for &(beyond, weight) in &trace.beyond {
            row.inflow_rate += rate * weight;
            if v.leaves_out(v.position(beyond).floor() as i64) {
                continue;
            }
            let mut point = self.space.point_in_element(cell);
            // The particle came to the face from above if it moved down.
            let above = beyond < 0.0;
            let element = if above == line.up { line.element } else { x.element_of(across as i64) };
            let face = x.face(if above { element } else { element + 1 });
            point[a] = x.beside(face, above);
            point[3 + a] = beyond;
            row.enter(self.entering, rate * weight, point);
        }
    }

    /// Adds the flux through the face where the flow goes out along space axis `a`.
    fn add_exit(&self, row: &mut Row, cell: &Cell, a: usize, line: &CellLine<'_>) {
        let n = self.space.dimension();
        let outer = self.elements.outflow_part * line.lifted_rate();
        let Some(across) = self.across(a, line, true) else {
            if self.elements.closed {
                self.couple(row, cell, [a, cell[a]], outer);
            }
            return;
        };
        let kind = self.potential.jump_kind(cell, a, line.up);
        let coupling = self.elements.couplings[a].get(&kind);
        if coupling.is_some_and(|coupling| coupling.is_upwind) {
            return;
        }
        self.couple(row, cell, [a, cell[a]], outer);
        let Some(Coupling { traces, .. }) = coupling else {
            return self.couple(row, cell, [a, across], -outer);
        };
        let side = if line.up { FaceSide::Below } else { FaceSide::Above };
        let trace = traces.trace(side, cell[n + a]);
        for share in &trace.partners {
            let mut target = *cell;
            target[a] = if share.side == side { cell[a] } else { across };
            target[n + a] = share.node;
            row.entries.push((self.space.index(&target), -outer * share.weight));
        }
        if self.elements.closed {
            return;
        }
        // Outflow from the velocity box leaves by the upwind flux.
        for &(node, weight) in &trace.unpaired {
            self.couple(row, cell, [n + a, node], -outer * weight);
        }
    }

    /// Adds the force along velocity axis `a`.
    fn add_force(&self, row: &mut Row, cell: &Cell, a: usize) {
        let speed = -self.potential.slope(cell, a);
        if speed == 0.0 {
            return;
        }
        let axis = self.space.dimension() + a;
        let v = &self.space.v[a];
        let line = CellLine::new(v, cell[axis], speed);
        self.add_derivative(row, cell, axis, &line);
        let [against, with] = line.neighbours();
        let inside = |e: i64| (0..v.elements() as i64).contains(&e);
        let (entry, exit) = (line.entry(), line.exit());
        let own = line.first(line.element) as usize;
        let add = |row: &mut Row, first: usize, trace: &[f64], rate: f64| {
            for (m, value) in trace.iter().enumerate().filter(|t| *t.1 != 0.0) {
                self.couple(row, cell, [axis, first + m], rate * value);
            }
        };
        let rate = line.lifted_rate() * entry[line.node];
        let inner = self.elements.inflow_part * rate;
        if inside(against) {
            add(row, line.first(against) as usize, exit, inner);
            add(row, own, entry, -inner);
        } else if self.elements.closed {
            add(row, own, entry, -inner);
        } else {
            add(row, own, entry, -rate);
            row.inflow_rate += rate;
            if !v.leaves_out(against) {
                let mut point = self.space.point_in_element(cell);
                point[3 + a] = line.entry_end();
                row.enter(self.entering, rate, point);
            }
        }
        let outer = self.elements.outflow_part * line.lifted_rate() * exit[line.node];
        if outer != 0.0 && (inside(with) || self.elements.closed) {
            add(row, own, exit, outer);
        }
        if outer != 0.0 && inside(with) {
            add(row, line.first(with) as usize, entry, -outer);
        }
    }
}
