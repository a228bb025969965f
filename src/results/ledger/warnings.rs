//! The warnings of a ledger: mass or energy in doubt, and potentials that may not be meant.

use crate::base::text::{counted, percent, short};
use crate::results::ledger::{BoxEnd, Ledger, NarrowRegion, STANDARD_ERRORS};
use crate::scheme::interface::rest_face::WITH_REST_ON_A_FACE;

/// Larger parts of the mass give a warning, and jumps of `V` below this part of the mean energy.
const NOTICEABLE: f64 = 0.01;
/// Larger parts of the mass that vanish or enter unexplained give a warning; smaller ones are due
/// to the dissipation of a coarse grid near an end.
const UNBALANCED: f64 = 0.02;
/// Why the mass of measure-valued data may change.
const OF_MEASURES: &str = "the density is read off phi and psi, which does not keep the mass where \
                           the grid does not resolve them";
/// A grid that holds less than this part of the mass of the data lacks most of them.
const LEAST_PART: f64 = 0.5;
/// A box that holds less than this part of the data at the end is empty: one of the particles that
/// are followed is more.
const LEAST_LEFT: f64 = 1e-4;
/// Least number of cells across a region of `V` that is resolved. For a degree above 0 one element
/// resolves a region of its own width.
const CELLS_OF_REGION: usize = 4;
/// Jumps of `V` larger than this many times the largest `v²/2` are a wall, or an error in units.
const WALL: f64 = 100.0;

impl Ledger {
    /// Warnings to the user, each with a remedy.
    pub fn warnings(&self) -> Vec<String> {
        let found = self.doubts().into_iter();
        let found = found.chain(self.wall_warnings()).chain(self.narrow_warnings());
        found.chain(self.all_left_warning()).collect()
    }

    /// The warnings that put mass or energy in doubt. Other warnings are about potentials and times
    /// that may be intended.
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
            if missed * self.sign() > 0.0 {
                "too much (or the formula's random points miss narrow data)"
            } else {
                "is missing"
            },
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
        let (lost, left) = (self.lost_with_error()?, self.mass.left_estimate?);
        let ([lost, of_lost], of_left) = (lost, self.mass.left_error.unwrap_or(0.0));
        let unexplained = lost - (left - self.mass.interface_estimate.unwrap_or(0.0));
        let share = self.unbalanced(unexplained, Some(of_lost.hypot(of_left)))?;
        if !self.holds_data() {
            return None;
        }
        let gone_or_gained = if share * self.sign() > 0.0 {
            "is missing that should be in the box"
        } else {
            "is in the box that should have left, or should not have entered"
        };
        Some(format!(
            "mass: {} of it {gone_or_gained}, by the particles of the exact flow: {} or a higher \
             {}{}",
            percent(share.abs()),
            self.reason_and_cells(),
            self.degree_keys,
            self.after_degree()
        ))
    }

    /// The mass that is lost, and the standard error of it. What enters measure-valued data is not
    /// measured: it is that of the particles, and nothing where they are not known and space has no
    /// ends.
    fn lost_with_error(&self) -> Option<[f64; 2]> {
        let mass = &self.mass;
        if !self.measure_valued {
            return Some([mass.lost?, 0.0]);
        }
        let entered = mass.entered_estimate.or(self.closed_space.then_some(0.0))?;
        Some([mass.initial? + entered - mass.end?, mass.entered_error.unwrap_or(0.0)])
    }

    /// Why mass may be lost or gained, and the remedies but for a higher degree.
    fn reason_and_cells(&self) -> String {
        if self.measure_valued {
            return OF_MEASURES.to_owned() + "; more cells";
        }
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
        format!(
            "the grid does not resolve V or f, or smears f over an end of the box{or_pulse}; more \
             cells{or_interface}"
        )
    }

    /// What a higher degree takes besides, if it is refused on these velocity cells.
    fn after_degree(&self) -> &'static str {
        if self.rest_in_cell { WITH_REST_ON_A_FACE } else { "" }
    }

    /// The sign of all mass: data that are negative on the whole lose mass as it rises.
    fn sign(&self) -> f64 {
        let all = self.mass.initial.unwrap_or(0.0) + self.mass.entered.unwrap_or(0.0);
        if all < 0.0 { -1.0 } else { 1.0 }
    }

    /// A difference of masses with the standard error `error`, as a share of all mass, if it is
    /// large enough for a warning.
    fn unbalanced(&self, difference: f64, error: Option<f64>) -> Option<f64> {
        let uncertain = STANDARD_ERRORS * self.share(error.unwrap_or(0.0))?;
        self.share(difference).filter(|share| share.abs() > UNBALANCED + uncertain)
    }

    /// Warning of mass that the balance does not explain, if the outflow through the ends is
    /// unknown. That mass leaves through ends in space is no fault.
    fn balance_warning(&self) -> Option<String> {
        let lost = self.lost_with_error().filter(|_| self.mass.left_estimate.is_none());
        let share = self.noticeable(lost?[0])?;
        if self.measure_valued {
            return self.unbalanced(lost?[0], None).map(|share| {
                format!(
                    "mass: {} of it {} at the end, and space has no ends: {OF_MEASURES}; more \
                     cells or a higher {}{}",
                    percent(share.abs()),
                    if share * self.sign() > 0.0 { "is gone" } else { "is new" },
                    self.degree_keys,
                    self.after_degree()
                )
            });
        }
        if share < 0.0 {
            return Some(format!(
                "mass: there is {} more of it at the end than at the start and entered: \
                 scheme.interface = \"hat\" adds it, or the error of the algorithm; take more \
                 velocity cells, \"conservative\", or a smaller solver.tolerance",
                percent(-share)
            ));
        }
        self.closed_space.then(|| {
            format!(
                "mass: {} of it is gone at the end, and space has no ends: the velocity box is too \
                 small, or scheme.interface = \"hat\" takes it",
                percent(share)
            )
        })
    }

    /// Warning that hardly any of the data are left at the end.
    fn all_left_warning(&self) -> Option<String> {
        let entered = [self.mass.entered, self.mass.entered_estimate];
        let nothing_enters = entered.into_iter().flatten().all(|mass| mass == 0.0);
        let left = self.share(self.mass.left_estimate?)?.abs();
        (nothing_enters && left > 1.0 - LEAST_LEFT).then(|| {
            format!(
                "mass: an estimated {} leaves the box by time.end, and errors are relative to \
                 what little is left; choose an earlier end or a larger box",
                percent(left)
            )
        })
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

    /// The share of a mass, if it is large enough for a warning.
    fn noticeable(&self, mass: f64) -> Option<f64> {
        self.share(mass).filter(|share| share.abs() > NOTICEABLE)
    }

    /// Whether the grid holds the initial data, or is not known to lack most of their mass. About a
    /// grid without them estimates by particles of the data say nothing.
    fn holds_data(&self) -> bool {
        let part = |initial: f64| Some(initial.abs() / self.mass.formula?.abs());
        let part = self.missed_by_grid().and(self.mass.initial).and_then(part);
        part.is_none_or(|part| part > LEAST_PART)
    }
}
