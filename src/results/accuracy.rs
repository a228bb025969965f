//! The errors of a run ([`Accuracy`]) and a sentence about them.

use crate::base::text::{
    ALGORITHM_ERROR, GRID_ERROR, one_digit, percent, quoted, rounded_down, rounded_up, short,
};
pub use crate::problem::case::GridErrorPair;
use crate::problem::case::{Case, Exact, Limiter, Method};
use crate::problem::element::LARGEST_DEGREE;
use crate::problem::grid::MAX_DIMENSION;
use crate::problem::potential::oblique::oblique_edges;
use crate::scheme::interface::rest_face::{WITH_REST_ON_A_FACE, allows_elements};
use serde::{Deserialize, Serialize};

/// Parts of space along each axis whose masses particles of the exact flow compare, by dimension.
pub const PARTS_OF_SPACE: [usize; MAX_DIMENSION] = [16, 4, 3];

/// The relative error of the density where `f` is smeared out and has this `error`, on a grid of a
/// degree. On elements a front that is smeared over a width `w` is `√w` off, its density `w`. On
/// cells the errors nearly cancel in the density after phase mixing, as found in the scenes of
/// docs/verification.md.
pub fn density_of_smeared(degree: usize, error: f64) -> f64 {
    error.powi(if degree == 0 { 3 } else { 2 })
}

/// The error of the density over that of `f`, of what jumps of `V` add on cells: most of it cancels
/// in the integral over the velocities, as found in steady gases.
const INTERPOLATED_DENSITY: f64 = 1.0 / 40.0;

/// The estimate of the density's error on elements: what its own coefficients show, and the square
/// of the error of `f`.
pub fn smeared_density(shown: f64, of_field: f64) -> f64 {
    shown.hypot(of_field * of_field)
}

/// Relative errors of the grid that particles of the exact flow show; `None` where they do not.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct ErrorsByParticles {
    /// Of `f` in L2, beyond the scatter: at least this.
    pub field: Option<f64>,
    /// Of `f` in L2, where the scatter is small: about this.
    #[serde(default)]
    pub field_mean: Option<f64>,
    /// Of `f` in L2, whatever the scatter.
    #[serde(default)]
    pub field_rough: Option<f64>,
    /// Of the density in L1, beyond the scatter: at least this.
    pub density: Option<f64>,
    /// Of the density in L2, with the scatter: at most this, but for what varies within the parts
    /// of space whose masses are compared.
    #[serde(default)]
    pub density_most: Option<f64>,
    /// Of the density in L2, if `f` is smeared out within each part of space, or was in all of it:
    /// about this.
    #[serde(default)]
    pub density_smeared: Option<f64>,
}

/// Errors of the grid that are estimated from the solution alone.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct EstimatedErrors {
    /// Relative L2 errors of `f` and of the density.
    pub grid: GridErrorPair,
    /// Relative L2 error of the density as its own coefficients show it, with elements. The error
    /// of `f` may be smeared out there, so that `grid` counts more.
    pub density_shown: Option<f64>,
    /// With velocity cells of degree 0: the largest error that a jump of `V` adds, by interpolation
    /// or overlap between cells, relative to `f` in L2, by velocity axis.
    pub interpolation: Option<[f64; MAX_DIMENSION]>,
}

impl EstimatedErrors {
    /// These errors without that of the density, as a density that cancels has no relative error.
    pub fn without_density(self) -> Self {
        let grid = GridErrorPair { density: None, ..self.grid };
        Self { grid, density_shown: None, ..self }
    }

    /// These errors, where the square of the error of `f` in that of the density is limited by the
    /// `mean` error that particles show. An estimate far above it is too large, as for smooth data.
    pub fn limit_by_particle_mean(self, mean: Option<f64>) -> Self {
        let known = (mean, self.grid.field, self.density_shown);
        let (Some(mean), Some(field), Some(shown)) = known else { return self };
        let of_field = field.min(MOST_OF_MEAN * mean);
        let density = self.grid.density.map(|_| smeared_density(shown, of_field).min(1.0));
        Self { grid: GridErrorPair { density, ..self.grid }, ..self }
    }

    /// These errors, but at least `share` where they are known: the part of all mass that the law
    /// at jumps of `V` adds or takes. It is about the error where `f` hardly varies along paths, so
    /// that these estimates see nothing, and may be too large after that mass has left.
    pub fn raise_to_interface_share(self, share: f64) -> Self {
        let GridErrorPair { field, density } = self.grid;
        let [field, density] = [field, density].map(|known| known.map(|error| error.max(share)));
        Self { grid: GridErrorPair { field, density }, ..self }
    }

    /// These errors, but at least what jumps of `V` add that smeared `f` out so many times along
    /// each velocity axis. The other estimates do not see it, as in a steady gas, which does not
    /// vary in space.
    pub fn raise_to_smearing(self, times: [f64; MAX_DIMENSION]) -> Self {
        let by_axis = self.interpolation.unwrap_or_default();
        let added: f64 = by_axis.iter().zip(times).map(|(error, times)| error * times).sum();
        let added = if added.is_finite() { added.min(1.0) } else { 0.0 };
        let GridErrorPair { field, density } = self.grid;
        let field = field.map(|error| error.max(added));
        let density = density.map(|error| error.max(INTERPOLATED_DENSITY * added));
        Self { grid: GridErrorPair { field, density }, ..self }
    }

    /// These errors, but that of the density at least the part `share` of the kinetic energy by
    /// which paths are off, if it is no larger than the error of `f` that `particles` show, or else
    /// the estimate. The density is shifted as a whole then, so that neither its own coefficients
    /// nor the square of the error of `f` show it.
    pub fn raise_density_to_potential_share(
        self,
        share: f64,
        particles: &ErrorsByParticles,
    ) -> Self {
        let of_field = particles.field_mean.or(self.field_or_rough_particles(particles));
        let least = of_field.map_or(share, |error| error.min(share));
        let density = self.grid.density.map(|error| error.max(least));
        Self { grid: GridErrorPair { density, ..self.grid }, ..self }
    }

    /// The errors of the grid with what `particles` show.
    ///
    /// That of `f` is at least what they show with a large scatter. That of the density is no
    /// larger than what they and its own coefficients leave room for, and at least what they and
    /// their masses show. Where `f` was smeared out, the solution itself shows neither.
    pub fn with_particles(self, particles: &ErrorsByParticles) -> GridErrorPair {
        let most = self
            .density_shown
            .map_or(f64::INFINITY, |shown| particles.largest_density_error_beside(shown));
        let smeared = particles.density_smeared.unwrap_or(0.0);
        let smeared = smeared.min(particles.largest_density_error_beside(0.0));
        let least = particles.density.map_or(smeared, |error| error.max(smeared));
        let density = self.grid.density.map(|error| error.min(most).max(least));
        GridErrorPair { field: self.field_or_rough_particles(particles), density }
    }

    /// The error of `f`, but at least what particles show whose scatter is large. Those whose
    /// scatter is small take the place of an estimate.
    fn field_or_rough_particles(self, particles: &ErrorsByParticles) -> Option<f64> {
        let rough = particles.field_rough.filter(|_| particles.field_mean.is_none());
        self.grid.field.into_iter().chain(rough).reduce(f64::max)
    }
}

impl ErrorsByParticles {
    /// These errors where the paths of the particles are off by themselves, by the relative L2
    /// error `traced` of `f`: beyond that, and no mean of which it is a large part.
    pub fn beyond_tracing(self, traced: f64) -> Self {
        let is_accurate = |error: &f64| traced <= MOST_TRACED * error;
        let field_rough = self.field_rough.filter(is_accurate);
        Self {
            field: self.field.map(|error| (error - traced).max(0.0)),
            field_mean: self.field_mean.filter(is_accurate),
            field_rough,
            density_most: self.density_most.map(|error| error + traced),
            density_smeared: self.density_smeared.filter(|_| field_rough.is_some()),
            ..self
        }
    }

    /// The largest error of the density in L2 that these errors leave room for, beside one that its
    /// own coefficients show; infinite without particles.
    fn largest_density_error_beside(&self, shown: f64) -> f64 {
        self.density_most.map_or(f64::INFINITY, |most| WITHIN_PARTS * shown.hypot(most))
    }
}

/// Largest ratio of an error of `f` to the mean that particles show, with a margin.
const MOST_OF_MEAN: f64 = 2.0;
/// Factor on an error of the density in parts of space, for what varies within them.
const WITHIN_PARTS: f64 = 2.0;
/// Largest part of an error of `f` by particles that may be the error of their paths.
const MOST_TRACED: f64 = 0.25;

/// The way in which an error of the grid is known.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum ErrorSource {
    /// Measured against an exact solution.
    Measured,
    /// Estimated from the solution, and from particles whose scatter is large.
    Estimated,
    /// Shown by particles of the exact flow.
    Particles,
    /// The error of the result from which the run continues, which is larger than the estimate.
    Inherited,
}

/// The errors of a run: that of the algorithm, which is the distance to the semi-discrete solution,
/// and that of the grid, which is the distance from there to the exact solution.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct Accuracy {
    /// `solver.tolerance`; `None` for the classical method, and if no plan holds it, as the inflow
    /// jumps in time.
    pub asked: Option<f64>,
    /// `solver.accuracy`, if given.
    pub goal: Option<f64>,
    /// Relative l2 distance to the semi-discrete solution: the measured one (`solver.verify`), else
    /// the estimate if that is reliable. That of a continued run counts from time 0.
    pub algorithm: Option<f64>,
    /// What is known instead if that distance is not, as the end of a sentence about it.
    #[serde(default)]
    pub algorithm_unknown: Option<String>,
    /// Relative L2 distance of `f` to the exact solution.
    pub grid: Option<f64>,
    /// The way in which that is known.
    #[serde(default)]
    pub grid_source: Option<ErrorSource>,
    /// Relative L2 distance of the density to the exact solution; L1 if particles show it.
    pub grid_density: Option<f64>,
    /// The way in which that is known.
    #[serde(default)]
    pub grid_density_source: Option<ErrorSource>,
    /// Whether the grid's errors were measured against an exact solution, or else estimated.
    pub grid_measured: bool,
    /// Whether the error of the algorithm is more than half of the measured errors, so that they
    /// say little about the grid.
    #[serde(default)]
    pub includes_algorithm: bool,
    /// Relative L1 distance of the density to the cell averages of the exact one, which
    /// `solver.accuracy` bounds; `None` without `solver.accuracy` or `[exact]`.
    pub goal_error: Option<f64>,
    /// The value of `goal_error` that the trials expected which chose the grid for
    /// `solver.accuracy`.
    #[serde(default)]
    pub goal_estimate: Option<f64>,
    /// The grid's errors that particles of the exact flow show.
    #[serde(default)]
    pub particles: ErrorsByParticles,
    /// The grid's errors of the result from which the run continues: that of `f` relative to `f` at
    /// the end of the run.
    #[serde(default)]
    pub inherited: GridErrorPair,
    /// The reason why the grid's error is not known at all, or why an estimate of it says little.
    #[serde(default)]
    pub unknown: Option<String>,
    /// Estimate of the grid's error of `f`, if there is one; also if the error was measured.
    pub grid_estimate: Option<f64>,
    /// Estimate of the grid's error of the density, if there is one; also if the error was
    /// measured.
    pub grid_density_estimate: Option<f64>,
    /// Whether the grid's error is above a tenth, or more than ten times the larger of the
    /// algorithm's error and the tolerance. If `goal_error` is known, or else `goal_estimate`:
    /// whether `solver.accuracy` is missed. If the measured errors are mostly the algorithm's:
    /// whether they are above a tenth, and no tolerance is missed.
    pub under_resolved: bool,
    /// Whether the errors do not count what an edge of `V` that is not along the axes adds: the
    /// exact solution by characteristics meets the same staircase of faces as the scheme does, and
    /// an estimate knows no other edge.
    #[serde(default)]
    pub staircase: bool,
    /// A remedy, as the end of a sentence, if the run is under-resolved, or if the density meets
    /// `solver.accuracy` but `f` is far from exact. With a staircase, a sentence about it.
    #[serde(default)]
    pub advice: Option<String>,
}

/// What the errors leave out if an edge of `V` is not along the axes.
pub const STAIRCASE: &str = "an edge of V is not along the axes: the error of the staircase of \
                             faces in its place is not included, and more cells do not lower that";

/// Whether errors of runs of `case` leave out what an edge of `V` that is not along the axes adds:
/// all but those against a formula.
pub fn hides_staircase(case: &Case) -> bool {
    !matches!(case.exact, Some(Exact::Formula(_))) && !oblique_edges(case).is_empty()
}

/// What an estimate of the grid's error does not see, if `V` varies between the points of the grid.
pub const HIDDEN_VARIATION: &str = "V varies within cells, or jumps within a formula, which an \
                                    estimate does not see";

/// What errors that are not measured may leave out, if the data are narrower than cells somewhere.
pub const NARROW_DATA: &str = "the grid does not resolve a narrow part of the initial data, which \
                               an estimate may not count";

/// Particles show an error of `f` that a measurement misses if it is this many times the measured
/// one. In 79 trials it was at most 1.12 times where the measurement was right, and 1.2 to 220
/// times where it missed a pulse between its points: 1.8 times for that of `tests/cli/ledger.rs`.
const BEYOND_MEASURED: f64 = 1.3;

/// A larger relative error of the grid is large, whatever the algorithm's error.
const LARGE_GRID_ERROR: f64 = 0.1;

/// Whether a relative error of the grid is large.
pub fn is_large(error: f64) -> bool {
    error > LARGE_GRID_ERROR
}

/// The grid limits the run if its error is more than this multiple of the algorithm's.
const DOMINANT: f64 = 10.0;

impl Accuracy {
    /// These errors, with the grid's relative errors of `f` and of the density, measured and
    /// estimated. Where particles of small scatter show that of `f`, it takes the place of the
    /// estimate. A large error that they show beyond their scatter, or the inherited one, takes the
    /// place of a smaller estimate.
    pub fn with_grid(self, measured: GridErrorPair, estimated: GridErrorPair) -> Self {
        let [measured, estimated] = [measured, estimated].map(GridErrorPair::both);
        let grid_measured = measured.iter().any(Option::is_some);
        let shown = [self.particles.field, self.particles.density];
        let mean = [self.particles.field_mean, None];
        let inherited = self.inherited.both();
        let found = [0, 1].map(|k| {
            let all = [
                (measured[k], ErrorSource::Measured),
                // An estimate contains what particles show, which then is the source.
                (mean[k], ErrorSource::Particles),
                (shown[k].filter(|error| is_large(*error)), ErrorSource::Particles),
                (estimated[k].filter(|_| mean[k].is_none()), ErrorSource::Estimated),
                (inherited[k], ErrorSource::Inherited),
            ];
            let known = if grid_measured { &all[..1] } else { &all[1..] };
            let known = known.iter().filter_map(|(error, source)| Some(((*error)?, *source)));
            known.reduce(|a, b| if b.0 > a.0 { b } else { a }).unzip()
        });
        let [(grid, grid_source), (grid_density, grid_density_source)] = found;
        let [grid_estimate, grid_density_estimate] = estimated;
        let found = Self {
            grid,
            grid_source,
            grid_density,
            grid_density_source,
            grid_measured,
            grid_estimate,
            grid_density_estimate,
            ..self
        };
        let of_algorithm = found.algorithm_or_tolerance();
        // Without a tolerance there is none to loosen.
        let dominates = found.asked.is_some() && found.worst() > DOMINANT * of_algorithm;
        let under_resolved = found.is_coarse() || dominates;
        Self { under_resolved, ..found }
    }

    /// The larger of the grid's errors of `f` and of the density; zero if none is known.
    fn worst(&self) -> f64 {
        self.grid.into_iter().chain(self.grid_density).fold(0.0, f64::max)
    }

    /// The algorithm's error if it is known, or the tolerance if that is larger; 0 without both.
    fn algorithm_or_tolerance(&self) -> f64 {
        self.algorithm.into_iter().chain(self.asked).fold(0.0, f64::max)
    }

    /// The algorithm's error over the tolerance; 0 if one is not known.
    pub fn ratio_to_tolerance(&self) -> f64 {
        self.algorithm.zip(self.asked).map_or(0.0, |(error, asked)| error / asked)
    }

    /// Whether the grid's error is above a tenth, or that of the algorithm above the tolerance or
    /// not known.
    pub fn is_large_for_its_goals(&self) -> bool {
        self.is_coarse() || self.algorithm.is_none() || self.ratio_to_tolerance() > 1.0
    }

    /// Whether a large error is mostly that of the algorithm, so that the grid's is not known.
    pub fn is_hidden_by_algorithm(&self) -> bool {
        self.includes_algorithm && self.is_large_for_its_goals()
    }

    /// A large error of `f` that particles show beyond their scatter, if it is more than
    /// [`BEYOND_MEASURED`] times the measured one.
    pub fn unmeasured_error(&self) -> Option<f64> {
        let is_met = self.goal_error.zip(self.goal).is_some_and(|(error, goal)| error <= goal);
        let measured = self.grid.filter(|_| self.grid_measured && !is_met)?;
        self.particles.field.filter(|shown| is_large(*shown) && *shown > BEYOND_MEASURED * measured)
    }

    /// Whether nothing but an estimate from the solution is known of the grid's error.
    pub fn is_estimated_only(&self) -> bool {
        let ErrorsByParticles { field, field_mean, field_rough, .. } = self.particles;
        let by_particles = [field, field_mean, field_rough].iter().any(Option::is_some);
        !self.grid_measured && !by_particles && self.worst() > 0.0
    }

    /// Whether the grid's error is above a tenth.
    pub fn is_coarse(&self) -> bool {
        is_large(self.worst())
    }

    /// A sentence that compares the two errors; `None` if the grid's error is unknown.
    pub fn line(&self) -> Option<String> {
        let of_algorithm = match (self.algorithm, &self.algorithm_unknown) {
            (Some(error), _) => Some(format!("{ALGORITHM_ERROR} {error:.1e}")),
            (None, Some(known)) => Some(format!("{ALGORITHM_ERROR} {known}")),
            (None, None) => None,
        };
        let Some(errors) = self.errors_of_grid() else {
            let why = self.unknown.as_ref()?;
            let of_algorithm = of_algorithm.map_or(String::new(), |text| text + "; ");
            return Some(format!("accuracy: {of_algorithm}{GRID_ERROR} not estimated: {why}"));
        };
        let head = match (self.staircase, self.under_resolved) {
            (true, _) => "STAIRCASE",
            (false, true) => "UNDER-RESOLVED",
            (false, false) => "accuracy",
        };
        let advice = self.advice_after();
        let what = self.what_is_measured();
        let how = if self.grid_measured { "measured" } else { "estimated" };
        let of_algorithm = of_algorithm.map_or(String::new(), |text| format!("; {text}"));
        let doubt = self.unknown.as_ref().map_or(String::new(), |why| format!("; {why}"));
        Some(format!("{head}: {what} ({how}, relative L2) {errors}{of_algorithm}{doubt}{advice}"))
    }

    /// The name of the errors of the grid: the measured ones may be mostly the algorithm's.
    pub fn what_is_measured(&self) -> String {
        let and = if self.includes_algorithm { " and of the algorithm together" } else { "" };
        format!("{GRID_ERROR}{and}")
    }

    /// The grid's errors as text, in significant digits; `None` if none is known.
    pub fn errors_of_grid(&self) -> Option<String> {
        let named = |name: &str, error: Option<f64>, source: Option<ErrorSource>| {
            let error = error?;
            // An estimate may be wrong by a factor of ten.
            let about = format!("about {} %", short(one_digit(100.0 * error)));
            // What particles show beyond their scatter is a lower bound.
            let at_least = || format!("at least {} %", short(rounded_down(100.0 * error)));
            let is_mean = name == "f" && self.particles.field_mean.is_some();
            // Older summaries do not have the source.
            let source = source.unwrap_or(if self.grid_measured {
                ErrorSource::Measured
            } else {
                ErrorSource::Estimated
            });
            let digits = match source {
                ErrorSource::Measured => percent(error),
                ErrorSource::Estimated => about,
                ErrorSource::Particles if is_mean => format!("{about} by particles"),
                ErrorSource::Particles if name == "f" => format!("{} by particles", at_least()),
                ErrorSource::Particles => format!("{} by particles (L1)", at_least()),
                ErrorSource::Inherited => format!("{about} from before"),
            };
            Some(format!("{name} {digits}"))
        };
        let field = named("f", self.grid, self.grid_source);
        let density = named("density", self.grid_density, self.grid_density_source);
        let errors: Vec<String> = field.into_iter().chain(density).collect();
        (!errors.is_empty()).then(|| errors.join(", "))
    }

    /// `; ` and a remedy, if one is needed; otherwise empty.
    pub fn advice_after(&self) -> String {
        self.advice.as_ref().map_or(String::new(), |advice| format!("; {advice}"))
    }

    /// The relative L1 error of the density that `solver.accuracy` bounds: the measured one, or the
    /// larger of those that trials expect and that particles show.
    pub fn error_against_goal(&self) -> Option<f64> {
        let expected = self.goal_estimate.into_iter().chain(self.particles.density);
        self.goal_error.or(expected.reduce(f64::max))
    }

    /// The remedy for a run of `case` whose grid's error is too large.
    pub fn remedy(&self, case: &Case) -> String {
        let degree = case.space.lowest_degree();
        let missed = self.error_against_goal().zip(self.goal).filter(|(error, goal)| error > goal);
        let is_large = missed.is_some() || self.is_coarse();
        let (ratio, wanted) = match missed {
            Some((error, goal)) => (error / goal, format!("{goal:e}")),
            None => {
                (self.worst() / LARGE_GRID_ERROR, format!("{} %", short(100.0 * LARGE_GRID_ERROR)))
            }
        };
        let cells = match largest_order(case, degree).filter(|_| is_large) {
            Some(order) => {
                let times = short((10.0 * ratio.powf(1.0 / order)).ceil() / 10.0);
                format!("more cells (at least {times} times as many per axis for {wanted})")
            }
            None => "more cells".to_owned(),
        };
        let is_classical = case.method == Method::Classical;
        let may_have_slopes = is_classical && case.has_upwind_cells() && !case.varies();
        let key = case.degree_keys(degree);
        let needs = if allows_elements(case) { "" } else { WITH_REST_ON_A_FACE };
        let article = match key.as_str() {
            // Several keys.
            keys if keys.contains(" and ") => "",
            key if key.starts_with("axis") => "an ",
            _ => "a ",
        };
        let or = match degree {
            0 if case.scheme.limiter != Limiter::None => String::new(),
            0 if may_have_slopes => {
                format!(", {article}{key} above 0{needs} or slopes (scheme.limiter)")
            }
            0 => format!(" or {article}{key} above 0{needs}"),
            1 | 2 => format!(" or a higher {key}"),
            LARGEST_DEGREE.. => String::new(),
            // Where data jump, degrees above 3 gain little.
            _ => format!(", or a higher {key} where f does not jump,"),
        };
        let then = if !is_large {
            // A measured error may grow by as much as the tolerance.
            let enough = rounded_up(self.worst() / (DOMINANT - 1.0));
            format!("; with this grid solver.tolerance = {enough:e} would suffice")
        } else if case.starts_anew() && self.goal.is_none() {
            format!("; phasewarp advise {} --accuracy ε finds a grid", quoted(&case.name))
        } else {
            String::new()
        };
        format!("{cells}{or} would lower it{then}")
    }
}

/// The highest order of convergence, in the width of cells, of a run of `case` whose axes have at
/// least this `degree`: `degree + 1`, but 2 for degree 0 with the central flux or slopes. `None`
/// for measure-valued data.
fn largest_order(case: &Case, degree: usize) -> Option<f64> {
    let is_second = case.scheme.limiter != Limiter::None || case.scheme.flux == 0.0;
    let order = if degree == 0 && is_second { 2.0 } else { (degree + 1) as f64 };
    (!case.is_measure_valued()).then_some(order)
}

#[cfg(test)]
mod tests {
    use super::*;

    /// What particles show in parts of space raises estimates within what they leave room for; a
    /// mean of small scatter takes the place of an estimate of `f` later.
    #[test]
    fn estimates_contain_what_particles_show() {
        let estimated = EstimatedErrors {
            grid: GridErrorPair { field: Some(0.02), density: Some(0.001) },
            density_shown: Some(0.001),
            interpolation: None,
        };
        let none = ErrorsByParticles::default();
        let with = |particles: ErrorsByParticles| {
            let found = estimated.with_particles(&particles);
            [found.field, found.density].map(|error| error.expect("an error"))
        };
        assert_eq!(with(none), [0.02, 0.001]);
        assert_eq!(with(ErrorsByParticles { field_rough: Some(0.03), ..none }), [0.03, 0.001]);
        assert_eq!(with(ErrorsByParticles { field_rough: Some(0.01), ..none }), [0.02, 0.001]);
        let mean = ErrorsByParticles { field_mean: Some(0.03), field_rough: Some(0.03), ..none };
        assert_eq!(with(mean), [0.02, 0.001]);
        let smeared = ErrorsByParticles { density_smeared: Some(0.005), ..none };
        assert_eq!(with(smeared), [0.02, 0.005]);
        assert_eq!(with(ErrorsByParticles { density_most: Some(0.002), ..smeared }), [0.02, 0.004]);
        for of_masses in [0.07, 0.7] {
            let particles = ErrorsByParticles { density: Some(of_masses), ..smeared };
            assert_eq!(with(particles), [0.02, of_masses]);
            // A large one is reported as that of particles.
            let found = Accuracy { particles, ..Accuracy::default() };
            let found =
                found.with_grid(GridErrorPair::default(), estimated.with_particles(&particles));
            let of_particles = found.grid_density_source == Some(ErrorSource::Particles);
            assert_eq!((found.grid_density, of_particles), (Some(of_masses), of_masses > 0.1));
        }
        let without = estimated.without_density().with_particles(&smeared);
        assert_eq!((without.field, without.density), (Some(0.02), None));
    }

    /// Where the estimate of `f` is far above the mean of particles, its square is no error of the
    /// density.
    #[test]
    fn means_of_particles_limit_estimates() {
        let estimated = EstimatedErrors {
            grid: GridErrorPair { field: Some(0.5), density: Some(0.25) },
            density_shown: Some(0.0),
            interpolation: None,
        };
        let density = |mean| estimated.limit_by_particle_mean(mean).grid.density.expect("an error");
        assert_eq!([density(None), density(Some(0.4))], [0.25; 2]);
        assert!((density(Some(0.1)) - 0.04).abs() < 1e-15);
        let of_cells = EstimatedErrors { density_shown: None, ..estimated };
        assert_eq!(of_cells.limit_by_particle_mean(Some(0.1)), of_cells);
    }

    /// Means and parts count only where paths are far more accurate than `f`.
    #[test]
    fn errors_of_paths_hide_those_of_f() {
        let shown = ErrorsByParticles {
            field_mean: Some(0.1),
            field_rough: Some(0.1),
            density_smeared: Some(0.02),
            ..ErrorsByParticles::default()
        };
        let keeps = |traced: f64| {
            let found = shown.beyond_tracing(traced);
            [found.field_mean, found.field_rough, found.density_smeared].map(|e| e.is_some())
        };
        assert_eq!(keeps(0.9 * MOST_TRACED * 0.1), [true; 3]);
        assert_eq!(keeps(1.1 * MOST_TRACED * 0.1), [false; 3]);
    }
}
