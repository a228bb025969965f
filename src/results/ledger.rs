//! The ledger of a run: where its mass and its energy went, and whether its potential matters.
//!
//! Masses are in the problem's own units. Numbers called estimates follow particles of the exact
//! flow; all others are measured on the grid, or are integrals of the case's formulas. Unknown
//! numbers are `null` in `summary.json`.

use crate::base::text::{counted, percent, rounded, short};
use crate::problem::case::DEGREE_KEY;
use crate::scheme::interface::energy::WITH_REST_ON_A_FACE;
use serde::{Deserialize, Serialize};

/// Larger parts of the mass give a warning, and jumps of `V` below this part of the mean energy.
const NOTICEABLE: f64 = 0.01;
/// Larger parts of the mass that vanish or enter unexplained give a warning; smaller ones are due
/// to the dissipation of a coarse grid near an end.
const UNBALANCED: f64 = 0.02;
/// A grid that holds less than this part of the mass of the data lacks most of them.
const LEAST_PART: f64 = 0.5;
/// Least number of cells across a region of `V` that is resolved. For a degree above 0 one element
/// resolves a region of its own width.
const CELLS_OF_REGION: usize = 4;
/// Jumps of `V` larger than this many times the largest `v²/2` are a wall, or an error in units.
const WALL: f64 = 100.0;
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
    /// Integral of `|f|` at time zero plus that of the inflow. Shares are relative to it.
    pub absolute: Option<f64>,
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
        let all = self.mass.absolute.or(self.mass.initial.map(f64::abs))?;
        Some(rounded(mass / all, 1.0)).filter(|share| share.is_finite())
    }

    /// The share of a mass, if it is large enough for a warning.
    fn noticeable(&self, mass: f64) -> Option<f64> {
        self.share(mass).filter(|share| share.abs() > NOTICEABLE)
    }

    /// A mass, and its share of all mass.
    fn with_share(&self, mass: f64) -> String {
        match self.share(mass) {
            Some(0.0) => "0".to_owned(),
            Some(share) => format!("{} ({})", short(mass), percent(share)),
            None => short(mass),
        }
    }

    /// The grid's mass at time zero minus that of the formula, as a share of all mass; `None` if
    /// the integral of the formula is not known well enough.
    fn missed_by_grid(&self) -> Option<f64> {
        let (initial, formula) = (self.mass.initial?, self.mass.formula?);
        let uncertain = STANDARD_ERRORS * self.mass.formula_error?;
        let missed = initial - formula;
        self.share(missed).filter(|share| missed.abs() > uncertain && *share != 0.0)
    }

    /// Whether the grid holds the initial data, or is not known to lack most of their mass. About a
    /// grid without them estimates by particles of the data say nothing.
    fn holds_data(&self) -> bool {
        let part = |initial: f64| Some(initial.abs() / self.mass.formula?.abs());
        let part = self.missed_by_grid().and(self.mass.initial).and_then(part);
        part.is_none_or(|part| part > LEAST_PART)
    }

    /// Warnings to the user, each with a remedy.
    pub fn warnings(&self) -> Vec<String> {
        let found = self.doubts().into_iter();
        found.chain(self.wall_warnings()).chain(self.narrow_warnings()).collect()
    }

    /// The warnings that put mass or energy in doubt. Other warnings are about potentials that may
    /// be intended.
    pub fn doubts(&self) -> Vec<String> {
        let found = [
            self.grid_warning(),
            self.start_warning(),
            self.interface_warning(),
            self.empty_field_warning(),
            self.inflow_warning(),
            self.unexplained_warning(),
            self.balance_warning(),
        ];
        let found = found.into_iter().flatten();
        found.chain(self.velocity_warnings()).chain(self.jump_warnings()).collect()
    }

    fn grid_warning(&self) -> Option<String> {
        let missed = self.missed_by_grid().filter(|m| m.abs() > NOTICEABLE)?;
        Some(format!(
            "mass: the grid holds {} at t = 0, the formula {}: {} {}; take more cells where the \
             data change, or a higher {}{}",
            short(self.mass.initial?),
            short(self.mass.formula?),
            percent(missed.abs()),
            if missed > 0.0 { "too much" } else { "is missing" },
            self.degree_keys,
            self.after_degree()
        ))
    }

    /// Warning of initial data beyond the velocity box.
    fn start_warning(&self) -> Option<String> {
        if let Some(share) = self.mass.outside.and_then(|mass| self.noticeable(mass)) {
            return Some(format!(
                "mass: initial.velocity is outside of the velocity box for {} of the data, which \
                 are left out; take a wider box",
                percent(share)
            ));
        }
        let share = self.noticeable(self.mass.beyond?)?;
        Some(format!(
            "mass: the initial data go beyond the velocity box: up to half its width beyond it \
             there is {} of what is in it; take a wider box if these particles matter",
            percent(share)
        ))
    }

    fn interface_warning(&self) -> Option<String> {
        let share = self.noticeable(self.mass.interface_estimate?)?;
        self.holds_data().then(|| {
            format!(
                "mass: scheme.interface = \"hat\" changes it by an estimated {}; take more \
                 velocity cells, or \"conservative\"",
                percent(share)
            )
        })
    }

    /// Warning of a solution that is zero.
    fn empty_field_warning(&self) -> Option<String> {
        let none = |mass: Option<f64>| mass.is_none_or(|mass| mass == 0.0);
        let mass = &self.mass;
        let nothing = mass.absolute == Some(0.0) && none(mass.initial) && none(mass.entered);
        nothing.then(|| {
            "mass: the initial data are zero on the grid, and nothing enters: the solution is zero \
             everywhere; are the data outside of the box, or narrower than its cells?"
                .to_owned()
        })
    }

    /// Warning that the inflow on the grid is not that of its formula.
    fn inflow_warning(&self) -> Option<String> {
        let (entered, expected) = (self.mass.entered?, self.mass.entered_estimate?);
        self.unbalanced(entered - expected, self.mass.entered_error)?;
        Some(format!(
            "mass: {} enters the grid, the formula gives an estimated {}: the grid does not \
             resolve the inflow, an edge of V misses the faces of the grid, or a pulse of the \
             inflow is too short for the run's time steps",
            short(entered),
            short(expected)
        ))
    }

    /// Warning of mass that is lost or gained, but that no particle carries over an end of the box.
    fn unexplained_warning(&self) -> Option<String> {
        let (lost, left) = (self.mass.lost?, self.mass.left_estimate?);
        let unexplained = lost - (left - self.mass.interface_estimate.unwrap_or(0.0));
        let share = self.unbalanced(unexplained, self.mass.left_error)?;
        if !self.holds_data() {
            return None;
        }
        let gone_or_gained = if share > 0.0 {
            "is gone that should still be in the box"
        } else {
            "is in the box that should have left, or should not have entered"
        };
        let is_some = |mass: Option<f64>| mass.is_some_and(|mass| mass != 0.0);
        let or_pulse = if is_some(self.mass.entered) {
            ", or the run misses a pulse of the inflow"
        } else {
            ""
        };
        // The estimate is exactly zero for interface laws that conserve mass.
        let or_interface = if is_some(self.mass.interface_estimate) {
            ", scheme.interface = \"conservative\""
        } else {
            ""
        };
        Some(format!(
            "mass: {} of it {gone_or_gained}, by the particles of the exact flow: the grid does \
             not resolve V or f, or smears f over an end of the box{or_pulse}; more \
             cells{or_interface} or a higher {}{}",
            percent(share.abs()),
            self.degree_keys,
            self.after_degree()
        ))
    }

    /// What a higher degree takes besides, if it is refused on these velocity cells.
    fn after_degree(&self) -> &'static str {
        if self.rest_in_cell { WITH_REST_ON_A_FACE } else { "" }
    }

    /// A difference of masses with the standard error `error`, as a share of all mass, if it is
    /// large enough for a warning.
    fn unbalanced(&self, difference: f64, error: Option<f64>) -> Option<f64> {
        let uncertain = STANDARD_ERRORS * self.share(error.unwrap_or(0.0))?;
        self.share(difference).filter(|share| share.abs() > UNBALANCED + uncertain)
    }

    /// Warning of lost mass, if the outflow through the ends is unknown.
    fn balance_warning(&self) -> Option<String> {
        let lost = self.mass.lost.filter(|_| self.mass.left_estimate.is_none())?;
        let share = self.noticeable(lost)?;
        Some(format!(
            "mass: {} of it is gone at the end, through an unknown end of the box; take a wider \
             box where nothing should leave",
            percent(share)
        ))
    }

    /// Warnings of outflow through the ends of the velocity box.
    fn velocity_warnings(&self) -> Vec<String> {
        let lost = |end: &&BoxEnd| {
            let all = end.outflow + end.outflow_at_jumps;
            end.axis.starts_with('v') && self.noticeable(all).is_some()
        };
        let warning = |end: &BoxEnd| {
            let [all, jumps] = [end.outflow + end.outflow_at_jumps, end.outflow_at_jumps]
                .map(|mass| self.share(mass).unwrap_or(0.0));
            let by_jumps = match jumps {
                0.0 => String::new(),
                _ if percent(jumps) == percent(all) => ", at jumps of V".to_owned(),
                _ => format!(", {} at jumps of V", percent(jumps)),
            };
            format!(
                "mass: an estimated {} leaves through the {} end of {}{by_jumps}: the velocity box \
                 is too small",
                percent(all),
                end.end,
                end.axis
            )
        };
        self.ends.iter().filter(lost).map(warning).collect()
    }

    /// Warnings of jumps that are small relative to the energies of the data.
    fn jump_warnings(&self) -> impl Iterator<Item = String> + '_ {
        self.jumps.iter().filter_map(|jump| {
            let mean = jump.mean_energy.unwrap_or(jump.largest_energy);
            (jump.largest < NOTICEABLE * mean).then(|| {
                format!(
                    "potential: the largest jump along {}, {}, is {} of the mean v^2/2 there, {}: \
                     it has hardly any effect; are the units those of v^2?",
                    jump.axis,
                    short(jump.largest),
                    percent(jump.largest / mean),
                    short(mean)
                )
            })
        })
    }

    /// Warnings of jumps that are far too high for any velocity of the box.
    fn wall_warnings(&self) -> impl Iterator<Item = String> + '_ {
        let walls = self.jumps.iter().filter(|jump| jump.largest > WALL * jump.largest_energy);
        walls.map(|jump| {
            format!(
                "potential: the largest jump along {}, {}, is far above the largest v^2/2 of the \
                 box there, {}: it reflects all velocities of the box, as a wall does; if no wall \
                 is meant, are the units those of v^2?",
                jump.axis,
                short(jump.largest),
                short(jump.largest_energy)
            )
        })
    }

    /// Warnings of regions that are too narrow for the grid, where particles may enter them.
    fn narrow_warnings(&self) -> impl Iterator<Item = String> + '_ {
        let entered = |region: &&NarrowRegion| {
            let jump = self.jumps.iter().find(|jump| jump.axis == region.axis);
            jump.is_some_and(|jump| jump.least <= jump.largest_energy)
        };
        let narrow = |region: &&NarrowRegion| region.degree == 0 && region.cells < CELLS_OF_REGION;
        self.regions.iter().filter(narrow).filter(entered).map(|region| {
            let NarrowRegion { potential, axis, cells, degree_key, .. } = region;
            format!(
                "potential.{potential}: {} wide along {axis}: the grid does not resolve f in it, \
                 where slow particles may be several times as many as they should be; take more \
                 cells ({CELLS_OF_REGION} across it), or {degree_key} = 2{}",
                counted(*cells, "cell", "cells"),
                self.after_degree()
            )
        })
    }

    /// The ledger as text: [`lines`](Self::lines) under a heading.
    pub fn text(&self) -> String {
        let lines = self.lines().into_iter().map(|line| format!("  {line}\n"));
        format!("ledger\n{}", lines.collect::<String>())
    }

    /// The lines of the ledger, without those whose numbers are unknown.
    pub fn lines(&self) -> Vec<String> {
        let mut lines: Vec<String> =
            [self.start_line(), self.balance_line()].into_iter().flatten().collect();
        lines.extend(self.ends_lines());
        let found = [self.interface_line(), self.energy_line(), self.regions_line()];
        lines.extend(found.into_iter().flatten());
        lines.extend(self.jumps.iter().map(jump_line));
        lines.extend(self.omitted.iter().map(|why| format!("not known: {why}")));
        lines
    }

    fn start_line(&self) -> Option<String> {
        let formula = self.mass.formula.map(|mass| {
            let error = self.mass.formula_error.unwrap_or(0.0);
            format!("{} by the formula (+- {})", short(mass), short(error))
        });
        let grid = self.mass.initial.map(|mass| format!("{} on the grid", short(mass)));
        let missed = self.missed_by_grid().map(|missed| format!("off by {}", percent(missed)));
        let parts: Vec<String> = formula.into_iter().chain(grid).chain(missed).collect();
        (!parts.is_empty()).then(|| format!("mass at the start: {}", parts.join(", ")))
    }

    fn balance_line(&self) -> Option<String> {
        let end = format!("mass at the end: {}", short(self.mass.end?));
        let parts = [("entered", self.mass.entered), ("lost in all", self.mass.lost)];
        let parts = parts
            .into_iter()
            .filter_map(|(name, mass)| Some(format!(", {name} {}", self.with_share(mass?))));
        Some(end + &parts.collect::<String>())
    }

    /// The total outflow, then that of each end, some ends per line.
    fn ends_lines(&self) -> Vec<String> {
        const ENDS_A_LINE: usize = 4;
        let Some(left) = self.mass.left_estimate else { return Vec::new() };
        let passes = |end: &&BoxEnd| end.outflow + end.outflow_at_jumps != 0.0;
        let part = |end: &BoxEnd| {
            let share = self.share(end.outflow + end.outflow_at_jumps).unwrap_or(0.0);
            format!("{} {} {}", end.axis, end.end, percent(share))
        };
        let parts: Vec<String> = self.ends.iter().filter(passes).map(part).collect();
        let parts = parts.chunks(ENDS_A_LINE).map(|some| format!("  by {}", some.join(", ")));
        let all = format!("leaves, estimated: {}", self.with_share(left));
        [all].into_iter().chain(parts).collect()
    }

    fn interface_line(&self) -> Option<String> {
        let gain = self.mass.interface_estimate.filter(|gain| *gain != 0.0)?;
        Some(format!("hat interface adds, estimated: {}", self.with_share(gain)))
    }

    fn energy_line(&self) -> Option<String> {
        let kinetic = self.energy.kinetic?;
        let change = |before: Option<f64>, after: f64| {
            before.map_or(String::new(), |before| short(before) + " -> ") + &short(after)
        };
        let kinetic = change(self.energy.kinetic_initial, kinetic);
        let potential = (self.energy.potential)
            .map(|after| format!(", potential {}", change(self.energy.potential_initial, after)));
        Some(format!("energy: kinetic {kinetic}{}", potential.unwrap_or_default()))
    }

    fn regions_line(&self) -> Option<String> {
        let narrowest = self.regions.iter().min_by_key(|region| region.cells)?;
        let NarrowRegion { potential, axis, cells, degree, .. } = narrowest;
        let [one, many] = if *degree == 0 { ["cell", "cells"] } else { ["element", "elements"] };
        let cells = counted(*cells, one, many);
        Some(format!("narrowest region of V: potential.{potential}, {cells} along {axis}"))
    }
}

/// The line about the jumps along an axis.
fn jump_line(jump: &AxisJumps) -> String {
    let [least, largest] = [jump.least, jump.largest].map(short);
    let range = if least == largest { largest } else { format!("{least} to {largest}") };
    let mean = jump.mean_energy.map(|mean| format!("mean {}, ", short(mean)));
    format!(
        "jumps of V along {}: {range}; v^2/2 there: {}at most {}",
        jump.axis,
        mean.unwrap_or_default(),
        short(jump.largest_energy)
    )
}

#[cfg(test)]
mod tests {
    use super::*;

    fn end(axis: &str, outflow: f64, outflow_at_jumps: f64) -> BoxEnd {
        BoxEnd { axis: axis.into(), end: "upper".into(), outflow, outflow_at_jumps, inflow: 0.0 }
    }

    /// A ledger without warnings.
    fn sound() -> Ledger {
        Ledger {
            mass: Mass {
                formula: Some(2.0),
                formula_error: Some(1e-4),
                absolute: Some(2.0),
                initial: Some(2.001),
                lost: Some(1.5),
                left_estimate: Some(1.511),
                entered_estimate: Some(0.0),
                beyond: Some(0.001),
                interface_estimate: Some(-0.01),
                ..Mass::default()
            },
            degree_keys: degree_key(),
            ends: vec![end("x", 1.5, 0.0), end("v", 0.001, 0.01)],
            jumps: vec![AxisJumps {
                axis: "x".into(),
                least: 0.1,
                largest: 0.2,
                mean_energy: Some(0.5),
                largest_energy: 1e3,
            }],
            ..Ledger::default()
        }
    }

    #[test]
    fn warnings_begin_at_one_percent() {
        assert_eq!(sound().warnings(), Vec::<String>::new());
        type Change = (fn(&mut Ledger), &'static str);
        let changes: [Change; 13] = [
            (|l| l.mass.initial = Some(1.9), "5.00 % is missing"),
            (
                |l| {
                    // A grid without the data neither loses nor gains what their particles do.
                    (l.mass.initial, l.mass.end, l.mass.lost) = (Some(0.0), Some(0.0), Some(0.0));
                    l.mass.interface_estimate = Some(0.04);
                },
                "the grid holds 0 at t = 0, the formula 2: 100.00 % is missing",
            ),
            (|l| l.mass.beyond = Some(0.1), "5.00 % of what is in it"),
            (|l| l.mass.outside = Some(1.0), "50.00 % of the data"),
            (|l| l.mass.interface_estimate = Some(0.04), "an estimated 2.00 %"),
            (
                |l| l.ends[1].outflow_at_jumps = 0.199,
                "10.00 % leaves through the upper end of v, 9.95 %",
            ),
            (|l| l.jumps[0].mean_energy = Some(5e11), "4e-11 % of the mean"),
            (|l| l.mass.left_estimate = None, "75.00 % of it is gone"),
            (|l| l.mass.lost = Some(1.9), "18.95 % of it is gone that should still be"),
            (|l| l.mass.lost = Some(1.57), "2.45 % of it is gone that should still be"),
            (|l| l.mass.lost = Some(1.0), "26.05 % of it is in the box that should have left"),
            (|l| l.mass.entered = Some(0.2), "mass: 0.2 enters the grid, the formula gives an"),
            (
                |l| l.mass = Mass { absolute: Some(0.0), initial: Some(0.0), ..Mass::default() },
                "the initial data are zero on the grid",
            ),
        ];
        for (change, words) in changes {
            let mut ledger = sound();
            change(&mut ledger);
            let found = ledger.warnings();
            assert!(found.len() == 1 && found[0].contains(words), "{words}: {found:?}");
        }
        let mut uncertain = sound();
        (uncertain.mass.initial, uncertain.mass.formula_error) = (Some(1.9), Some(0.1));
        assert!(uncertain.warnings().is_empty());
        let mut uncertain = sound();
        (uncertain.mass.lost, uncertain.mass.left_error) = (Some(1.7), Some(0.05));
        assert!(uncertain.warnings().is_empty());
    }

    /// Walls and narrow regions give warnings that put neither mass nor energy in doubt.
    #[test]
    fn potentials_that_may_be_meant_are_no_doubts() {
        let narrow = |cells, degree, least| {
            let mut ledger = sound();
            ledger.jumps[0].least = least;
            let axis = "x".to_owned();
            let degree_key = "axis.0.x.degree".to_owned();
            ledger.regions = vec![NarrowRegion { potential: 2, axis, cells, degree, degree_key }];
            ledger
        };
        let wall = |largest| {
            let mut ledger = sound();
            ledger.jumps[0].largest = largest;
            ledger
        };
        let rows = [
            (narrow(1, 0, 0.1), "potential.2: 1 cell wide along x"),
            (narrow(3, 0, 0.1), "potential.2: 3 cells wide along x"),
            (narrow(3, 0, 0.1), "or axis.0.x.degree = 2"),
            (narrow(4, 0, 0.1), ""),
            (narrow(1, 1, 0.1), ""),
            // No particle can enter.
            (narrow(1, 0, 2e3), ""),
            (wall(2e5), "the largest jump along x, 2e5, is far above"),
            (wall(9e4), ""),
        ];
        for (ledger, words) in rows {
            let found = ledger.warnings();
            assert_eq!(found.len(), usize::from(!words.is_empty()), "{words}: {found:?}");
            assert!(found.iter().all(|warning| warning.contains(words)), "{words}: {found:?}");
            assert!(ledger.doubts().is_empty());
        }
        let text = narrow(1, 3, 0.1).text();
        assert!(text.contains("potential.2, 1 element along x\n"), "{text}");
    }

    #[test]
    fn lines_contain_known_numbers_only() {
        assert!(Ledger::default().lines().is_empty());
        let lines = sound().lines().join("\n");
        assert!(lines.contains("2.001 on the grid, off by 0.05 %"), "{lines}");
        assert!(lines.contains("0.1 to 0.2; v^2/2 there: mean 0.5, at most 1000"), "{lines}");
        assert!(!lines.contains("entered"), "{lines}");
    }
}
