//! The ledger of a run: where its mass and its energy went, and whether its potential matters.
//!
//! Masses are in the problem's own units. Numbers called estimates follow particles of the exact
//! flow; all others are measured on the grid, or are integrals of the case's formulas. Unknown
//! numbers are `null` in `summary.json`. `lines` prints a ledger, `warnings` says what is wrong.

mod lines;
mod warnings;

use crate::base::text::rounded;
use crate::problem::case::DEGREE_KEY;
use serde::{Deserialize, Serialize};

/// Differences below this many standard errors do not count.
pub const STANDARD_ERRORS: f64 = 4.0;

/// `ledger` of `summary.json`.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct Ledger {
    /// The balance of mass.
    pub mass: Mass,
    /// The open ends of the phase-space box.
    pub ends: Vec<BoxEnd>,
    /// The energies.
    pub energy: Energy,
    /// The axes along which `V` jumps.
    pub jumps: Vec<AxisJumps>,
    /// The regions of `V` that lie between others.
    pub regions: Vec<NarrowRegion>,
    /// Whether a degree above 0 is refused on the velocity cells, as `v = 0` is not on a face of
    /// them where `V` jumps.
    #[serde(default)]
    pub rest_in_cell: bool,
    /// Whether the data are measure-valued: their density is read off `phi` and `psi`, and nothing
    /// keeps its mass.
    #[serde(default)]
    pub measure_valued: bool,
    /// Whether no axis of space has ends: what leaves then leaves the velocity box.
    #[serde(default)]
    pub closed_space: bool,
    /// The numbers that could not be found, and why.
    pub omitted: Vec<String>,
    /// The keys that give the lowest degree of the axes, for remedies.
    #[serde(default = "degree_key")]
    pub degree_keys: String,
}

/// The key of degrees in ledgers of older versions, which do not say it.
fn degree_key() -> String {
    DEGREE_KEY.to_owned()
}

/// Integrals of `f` over phase space, or of `ρ` over space for measure-valued data.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct Mass {
    /// Integral of the formula of the initial data over the phase-space box.
    pub formula: Option<f64>,
    /// Standard error of that integral.
    pub formula_error: Option<f64>,
    /// Integral of `|f|` at the start plus that of the inflow. Shares are relative to it.
    pub absolute: Option<f64>,
    /// Integral of `|f|` at the start. What the grid misses there is relative to it.
    #[serde(default)]
    pub absolute_initial: Option<f64>,
    /// Integral of the formula over velocities beyond the box, up to half its width on each side.
    pub beyond: Option<f64>,
    /// Mass whose velocity is outside of the box at time zero, for measure-valued data.
    pub outside: Option<f64>,
    /// Mass on the grid at time zero.
    pub initial: Option<f64>,
    /// Mass that entered the grid, by the rows of the scheme; unknown for measure-valued data.
    pub entered: Option<f64>,
    /// Estimate of the mass that enters, without that at jumps of `V`.
    pub entered_estimate: Option<f64>,
    /// Standard error of that estimate.
    #[serde(default)]
    pub entered_error: Option<f64>,
    /// Mass on the grid at the end.
    pub end: Option<f64>,
    /// `initial + entered − end`.
    pub lost: Option<f64>,
    /// Estimate of the mass that leaves the box.
    pub left_estimate: Option<f64>,
    /// Standard error of that estimate.
    pub left_error: Option<f64>,
    /// Estimate of the mass that the `hat` interface adds; 0 for laws that conserve mass.
    pub interface_estimate: Option<f64>,
    /// Standard error of that estimate.
    #[serde(default)]
    pub interface_error: Option<f64>,
    /// Number of particles that were followed for the estimates.
    pub particles: usize,
}

/// An open end of the phase-space box, with estimates of the mass that passes it.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct BoxEnd {
    /// The axis: `x`, …, `vz`.
    pub axis: String,
    /// `lower` or `upper`.
    pub end: String,
    /// Mass that leaves through this end: by its motion, or along a velocity axis by slopes of `V`.
    pub outflow: f64,
    /// Mass that leaves because a jump of `V` gives it a velocity beyond this end; 0 along space
    /// axes.
    pub outflow_at_jumps: f64,
    /// Mass that enters through this end.
    pub inflow: f64,
}

/// Kinetic energy `½ ∫ |v|² f` and potential energy `∫ V f`, on the grid.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct Energy {
    /// Kinetic energy at time zero.
    pub kinetic_initial: Option<f64>,
    /// Potential energy at time zero.
    pub potential_initial: Option<f64>,
    /// Kinetic energy at the end.
    pub kinetic: Option<f64>,
    /// Potential energy at the end.
    pub potential: Option<f64>,
}

/// The jumps of `V` along an axis, and the energies of the motion along it.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct AxisJumps {
    /// The space axis.
    pub axis: String,
    /// Least `|V⁺ − V⁻|`.
    pub least: f64,
    /// Largest `|V⁺ − V⁻|`.
    pub largest: f64,
    /// Mean of `½v²` along this axis over the initial data and the inflow.
    pub mean_energy: Option<f64>,
    /// `½v²` of the fastest velocity of the box.
    pub largest_energy: f64,
}

/// A region of `V` between others.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct NarrowRegion {
    /// Index of the region in `[[potential]]`.
    pub potential: usize,
    /// The axis along which it is narrowest.
    pub axis: String,
    /// Cells across it; elements of a degree above 0.
    pub cells: usize,
    /// Degree of the scheme along this axis.
    #[serde(default)]
    pub degree: usize,
    /// The key that gives this degree.
    #[serde(default = "degree_key")]
    pub degree_key: String,
}

impl Ledger {
    /// A mass as a part of all there is.
    fn share(&self, mass: f64) -> Option<f64> {
        part(mass, self.mass.absolute?)
    }

    /// The mass that the hat interface adds or takes, as a share of all mass. The scatter of the
    /// particles that show it does not depend on `f`: what may be scatter counts up to the error of
    /// one `interpolation` between velocities, if that is known.
    pub fn interface_share(&self, interpolation: Option<f64>) -> Option<f64> {
        let mass = self.mass.interface_estimate?.abs();
        let share = self.share(mass)?;
        let may_be_scatter = self.mass.interface_error.is_none_or(|e| mass <= STANDARD_ERRORS * e);
        Some(interpolation.filter(|_| may_be_scatter).map_or(share, |most| share.min(most)))
    }

    /// The grid's mass at time zero minus that of the formula, as a share of the mass at that time;
    /// `None` if the integral of the formula is not known well enough.
    fn missed_by_grid(&self) -> Option<f64> {
        let (initial, formula) = (self.mass.initial?, self.mass.formula?);
        let uncertain = STANDARD_ERRORS * self.mass.formula_error?;
        let missed = initial - formula;
        // Older summaries have all mass only.
        let all = self.mass.absolute_initial.or(self.mass.absolute)?;
        part(missed, all).filter(|share| missed.abs() > uncertain && *share != 0.0)
    }
}

/// A mass as a part of `all`, if there is any.
fn part(mass: f64, all: f64) -> Option<f64> {
    Some(rounded(mass / all, 1.0)).filter(|part| part.is_finite())
}

#[cfg(test)]
mod tests;
