//! Guaranteed bounds of the spectra of `S` and of `H_l`.

use crate::base::error::Result;
use crate::problem::case::{Case, Delta, Method};
use crate::problem::grid::MAX_DIMENSION;
use crate::problem::potential::Potential;
use crate::scheme::interface::law_of;
use crate::scheme::rows::{fastest, transport_rate};
use serde::Serialize;
use std::collections::HashSet;

/// More kinds of cells than this are not counted.
pub const MOST_KINDS: usize = 4096;

/// Growth over the whole run, `λ⁺T`, that the weights may leave where particles are trapped. Less
/// costs sweeps, more costs modes and degrees: from 0.375 to 0.15 the applications of example 1 at
/// 1e-11 fall by 5 %, the sweeps in a well double.
pub const WEIGHT_GROWTH: f64 = 0.15;

/// Shift of the weights' system, `sT`; its solution has growth `½ sT`, and the sweeps stop at
/// [`WEIGHT_GROWTH`].
pub const WEIGHT_SHIFT: f64 = 0.2;

/// Growth over the whole run, `θT`, that the inflow's couplings may add. Less makes the auxiliary
/// unknowns larger beside the field (as `1/√θ`), which tightens the tolerance of the state.
pub const INFLOW_GROWTH: f64 = 0.375;

/// Largest `rate·T`: such a run has some hundred thousand modes of some million applications each.
pub(crate) const LONGEST_SPAN: f64 = 1e6;

/// Bounds on the generator that hold without computing it.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct Bounds {
    /// `max |A_ii|`.
    pub rate: f64,
    /// `γ ≥ λ⁺`.
    pub growth: f64,
    /// `2 max |A_ii| + γ ≥ λ⁻`.
    pub decay: f64,
    /// Whether `V` jumps.
    pub jumps: bool,
    /// Kinds of space cells by slopes and jumps of `V`, up to [`MOST_KINDS`]: rows of the matrix
    /// repeat where a kind does.
    pub kinds: usize,
    /// Whether the interface law needs weights to keep `γ`.
    pub weighted: bool,
    /// Whether anything may enter.
    pub inflow: bool,
    /// Exponentials in a row that an inflow takes that depends on time; 0 where there is none, or
    /// before it is known.
    pub stages: usize,
}

impl Bounds {
    /// Bounds of `case`; evaluates `V` on the whole space grid. Growth is what weights and inflow
    /// are allowed; without weights a law that may grow has no such bound, nor has inflow with a
    /// given `δ`, and [`f64::INFINITY`] stands until it is measured.
    ///
    /// # Errors
    /// [`crate::base::error::Error::Formula`] where `V` is not finite.
    pub fn new(case: &Case) -> Result<Self> {
        // Layer by layer, so that the whole potential is never kept.
        let mut ranges: Vec<_> = case.space.x.iter().map(|a| 0..a.cells).collect();
        let (mut force, mut jumps) = (0.0f64, [false; MAX_DIMENSION]);
        let mut kinds = HashSet::new();
        for i in 0..case.space.x[0].cells {
            ranges[0] = i..i + 1;
            let layer = Potential::new(case, &ranges)?;
            force = force.max(layer.force_rate(&case.space));
            let found = layer.jumps();
            (jumps.iter_mut().zip(found)).for_each(|(j, found)| *j |= found);
            layer.collect_kinds(&mut kinds, MOST_KINDS);
        }
        // Through a jump a cell may be its own neighbour and particles move on all the same.
        let single: f64 = (0..case.space.dimension())
            .filter(|&a| jumps[a] && case.space.is_single(a))
            .map(|a| fastest(&case.space, a))
            .sum();
        let rate = transport_rate(&case.space) + single + force;
        let jumps = jumps.contains(&true);
        let inflow = case.embeds();
        let grows = jumps && law_of(case.interface).may_grow();
        let weights = match (grows, case.warp.weights) {
            (false, _) => 0.0,
            (true, true) => WEIGHT_GROWTH,
            (true, false) => f64::INFINITY,
        };
        let couplings = match (inflow, case.warp.delta) {
            (false, _) => 0.0,
            (true, Delta::Planned) => INFLOW_GROWTH,
            (true, _) => f64::INFINITY,
        };
        let growth = f64::max(weights, couplings) / case.end;
        Ok(Self {
            rate,
            growth,
            decay: 2.0 * rate + growth,
            jumps,
            kinds: kinds.len(),
            stages: 0,
            weighted: grows && case.warp.weights && case.method == Method::Schrodingerized,
            inflow,
        })
    }
}

impl Bounds {
    /// These bounds with a finite growth, for planning who does what before the growth is measured.
    pub fn expected(&self) -> Self {
        Self {
            growth: if self.growth.is_finite() { self.growth } else { 0.0 },
            decay: 2.0 * self.rate,
            ..self.clone()
        }
    }
}
