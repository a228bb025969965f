//! Judges a run by the numbers of its summary: its accuracy, the goals that it misses, what would
//! help, what is not known.

use crate::problem::case::{Case, Data, Integrator, Method};
use crate::problem::narrow_parts::unresolved_part;
use crate::problem::potential::resolution::unresolved_on_finer_grids;
use crate::results::accuracy::{
    Accuracy, EstimatedErrors, GridErrorPair, HIDDEN_VARIATION, NARROW_DATA, PARTS_OF_SPACE,
    STAIRCASE, hides_staircase, is_large,
};
use crate::results::summary::Summary;
use crate::results::verdict::{FAR_ABOVE, MissedGoals, Verdict};

/// The algorithm's error is most of a measured one from this part on.
const LARGE_PART: f64 = 0.5;

impl Summary {
    /// Sets accuracy and missed goals once all other numbers are known. `estimated` are the grid's
    /// estimated errors.
    pub fn judge(&mut self, case: &Case, estimated: EstimatedErrors) {
        self.set_accuracy(case, estimated);
        self.set_advice(case);
        let continued = self.continued.as_ref();
        self.verdict = Some(Verdict::of(&self.missed, &self.accuracy, continued));
    }

    /// Sets the errors, and the goals that are missed.
    fn set_accuracy(&mut self, case: &Case, estimated: EstimatedErrors) {
        let measured = GridErrorPair {
            field: self.error_l2_relative,
            density: self.error_density_l2_relative,
        };
        let is_planned = case.method == Method::Schrodingerized && !self.inflow_jumps;
        let asked = is_planned.then_some(case.tolerance);
        let own = self.own_error();
        let algorithm = self.continued.as_ref().map_or(own, |continued| continued.error_total);
        let start_error = self.start_error;
        let planned = |asked: f64| match start_error {
            None => format!("not estimated (planned within {asked:e})"),
            Some(start) => format!(
                "not estimated (up to {start:.1e} by initial.warped, and planned within {asked:e} \
                 from there)"
            ),
        };
        let inherited = self.continued.as_ref().map(|continued| continued.error_inherited);
        let algorithm_unknown = match (algorithm, own, &self.continued) {
            (Some(_), ..) => None,
            (None, own, Some(continued)) => {
                let before = inherited.flatten().map(|error| format!("at most {error:.1e}"));
                let before = before.unwrap_or_else(|| "not known".to_owned());
                let since = own.map(|own| format!("{own:.1e}")).or(asked.map(planned));
                let since = since.map_or(String::new(), |since| format!(", {since} since then"));
                Some(format!("{before} from before t = {}{since}", continued.time))
            }
            _ => asked.map(planned),
        };
        let accuracy = Accuracy {
            asked,
            goal: case.accuracy,
            goal_error: self.accuracy.goal_error,
            goal_estimate: case.study.expected_error,
            algorithm,
            algorithm_unknown,
            staircase: hides_staircase(case),
            particles: self.accuracy.particles,
            inherited: self.continued.as_ref().map_or(GridErrorPair::default(), |c| c.grid),
            ..Accuracy::default()
        };
        let estimated = estimated.with_particles(&accuracy.particles);
        self.accuracy = accuracy.with_grid(measured, estimated);
        self.missed = missed_goals(case, self);
        let rough = self.error_estimate.filter(|_| self.missed.tolerance.is_some());
        let accuracy = &mut self.accuracy;
        let measured = accuracy.grid.or(accuracy.grid_density).filter(|_| accuracy.grid_measured);
        let known = [accuracy.algorithm, own, rough, inherited.flatten()];
        let of_algorithm = known.into_iter().flatten().reduce(f64::max);
        accuracy.includes_algorithm =
            of_algorithm.zip(measured).is_some_and(|(part, all)| part > LARGE_PART * all);
    }

    /// Sets what would help, and what is not known.
    fn set_advice(&mut self, case: &Case) {
        let accuracy = &mut self.accuracy;
        accuracy.unknown = doubt(accuracy, case);
        let of_density = accuracy.error_against_goal();
        if let Some((error, goal)) = of_density.zip(accuracy.goal) {
            accuracy.under_resolved = error > goal;
        }
        if accuracy.includes_algorithm {
            // The line about a missed tolerance says it all.
            accuracy.under_resolved = accuracy.is_coarse() && self.missed.tolerance.is_none();
            let knob = match (case.method, self.step_error, &self.continued) {
                (Method::Classical, _, Some(_))
                    if case.classical.integrator == Integrator::Exponential =>
                {
                    "a smaller solver.tolerance of the first part"
                }
                (Method::Classical, ..) => "a smaller solver.classical.cfl",
                (_, Some(_), _) => "a shorter solver.propagator.step",
                (_, None, Some(_)) => "a smaller solver.tolerance, also of the first part,",
                (_, None, None) => "a smaller solver.tolerance",
            };
            if accuracy.is_large_for_its_goals() {
                let advice = format!("most of it is the algorithm's: {knob} lowers it");
                accuracy.advice = Some(advice);
            }
        } else if accuracy.staircase {
            let more = accuracy.under_resolved.then(|| accuracy.remedy(case));
            let more = more.map_or(String::new(), |advice| format!("; for the rest, {advice}"));
            accuracy.advice = Some(format!("{STAIRCASE}{more}"));
        } else if accuracy.under_resolved {
            accuracy.advice = Some(accuracy.remedy(case));
        } else if accuracy.grid.is_none()
            && accuracy.grid_density.is_none()
            && (self.minimum != 0.0 || self.maximum != 0.0)
        {
            let why = match case.data {
                Data::Density => "jumps of V or ends of the box are nearly everywhere",
                Data::Measure { .. } => "there is no estimate for measure-valued data",
            };
            let small = format!(
                "; particles of the exact flow show no error of the density above a tenth on \
                 scales above 1/{} of each axis",
                PARTS_OF_SPACE[case.space.dimension() - 1]
            );
            let small = accuracy.particles.density.map_or(String::new(), |_| small);
            let measured = "; [exact] kind = \"characteristics\" measures it";
            let measured =
                if case.reflects() || case.warped_start.is_some() { "" } else { measured };
            accuracy.unknown = Some(format!("{why}{small}{measured}"));
        } else if of_density.is_some() && accuracy.grid.is_some_and(is_large) {
            let what = match accuracy.goal_error {
                Some(_) => "the accuracy of the density is met, but f needs a finer grid",
                None => {
                    "the trial runs expect the density to meet its accuracy; f needs a finer grid"
                }
            };
            accuracy.advice = Some(what.to_owned());
        }
    }
}

/// What the errors of a run of `case` do not see.
fn doubt(accuracy: &Accuracy, case: &Case) -> Option<String> {
    // Cells of degree 0 are compared at their centres, by definition.
    let is_integral = case.space.lowest_degree() > 0;
    if let Some(shown) = accuracy.unmeasured_error().filter(|_| is_integral) {
        return Some(format!(
            "particles show an error of f of at least {:.0} %, of which [exact] measures a part: f \
             varies between its points",
            (100.0 * shown).floor()
        ));
    }
    if accuracy.is_estimated_only() && unresolved_on_finer_grids(case).is_some() {
        return Some(HIDDEN_VARIATION.to_owned());
    }
    // Random paths behind partial reflection begin at random points, and not where the data are.
    let by_particles = accuracy.particles.field_mean.is_some() && !case.reflects();
    let is_hidden = || unresolved_part(case).is_some_and(|part| part.matters(accuracy.goal));
    (!accuracy.grid_measured && !by_particles && is_hidden()).then(|| NARROW_DATA.to_owned())
}

/// The goals that the run of `case` misses, by the errors of its summary.
fn missed_goals(case: &Case, summary: &Summary) -> MissedGoals {
    let is_far = |error: f64| !summary.hidden_by_round_off && error > FAR_ABOVE * case.tolerance;
    let estimate = summary.error_estimate.and_then(|error| {
        if summary.error_estimate_reliable {
            Some((error, "estimated"))
        } else {
            is_far(error).then_some((error, "roughly estimated"))
        }
    });
    let measured = summary.error_semidiscrete.map(|error| (error, "measured"));
    let own = measured.or(estimate);
    let tolerance = (own.filter(|_| case.method == Method::Schrodingerized))
        .filter(|(error, _)| *error > case.tolerance)
        .map(|(error, how)| {
            format!("tolerance {:e} MISSED: {error:.2e} ({how}, relative l2)", case.tolerance)
        });
    let density = summary.accuracy.goal_error.zip(case.accuracy);
    let missed = density.filter(|(error, goal)| error > goal).map(|(error, goal)| {
        format!("accuracy {goal:e} of the density MISSED: {error:.2e} (relative L1)")
    });
    let shown = summary.accuracy.particles.density.zip(case.accuracy);
    let shown = shown.filter(|(error, goal)| density.is_none() && error > goal);
    let missed = missed.or(shown.map(|(error, goal)| {
        format!(
            "accuracy {goal:e} of the density MISSED: {error:.2e} (relative L1, shown by \
             particles)"
        )
    }));
    let unknown = case.accuracy.filter(|_| summary.accuracy.staircase).map(|goal| {
        format!("accuracy {goal:e} of the density NOT SHOWN: an edge of V is not along the axes")
    });
    let accuracy = missed.or(unknown);
    MissedGoals { tolerance, accuracy }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::results::accuracy::ErrorsByParticles;

    /// A goal without an exact solution is missed if particles show a larger error of the density,
    /// and not by a smaller one, nor against a measured error.
    #[test]
    fn particles_refute_a_goal() {
        let text = "[[axis]]\nx = { lower = 0, upper = 1, cells = 8 }\n\
                    v = { lower = -1, upper = 1, cells = 8 }\n[[potential]]\nvalue = \"0\"\n\
                    [initial]\nf = \"1\"\n[time]\nend = 1\n[solver]\naccuracy = 1e-2\n";
        let case = Case::parse("test", text, &[]).expect("a case");
        let judged = |shown: f64, measured: Option<f64>| {
            let particles =
                ErrorsByParticles { density: Some(shown), ..ErrorsByParticles::default() };
            let accuracy = Accuracy { particles, goal_error: measured, ..Accuracy::default() };
            let mut summary = Summary { accuracy, ..Summary::default() };
            let grid = GridErrorPair { field: Some(1e-3), density: Some(1e-3) };
            summary.judge(&case, EstimatedErrors { grid, ..EstimatedErrors::default() });
            (summary.missed.accuracy, summary.accuracy.under_resolved)
        };
        let (missed, under_resolved) = judged(0.2, None);
        let missed = missed.expect("missed");
        assert!(missed.contains("MISSED: 2.00e-1 (relative L1, shown by particles)"), "{missed}");
        assert!(under_resolved);
        // What is advised is for the missed goal: no tolerance is too small for a grid.
        let particles = ErrorsByParticles { density: Some(0.02), ..ErrorsByParticles::default() };
        let accuracy = Accuracy { particles, goal: Some(1e-2), ..Accuracy::default() };
        let remedy = accuracy.remedy(&case);
        assert!(remedy.starts_with("more cells (at least 2 times as many"), "{remedy}");
        assert!(!remedy.contains("tolerance"), "{remedy}");
        assert_eq!(judged(5e-3, None), (None, false));
        assert_eq!(judged(0.2, Some(5e-3)), (None, false));
    }

    /// An estimate does not see a barrier that the grid misses, so that the verdict is unknown.
    /// Particles follow `V`, and an exact solution does.
    #[test]
    fn a_potential_that_the_grid_misses_leaves_the_verdict_unknown() {
        let text = "[[axis]]\nx = { lower = 0, upper = 1, cells = 8 }\n\
                    v = { lower = -1, upper = 1, cells = 8 }\n[[potential]]\n\
                    value = \"0.2 if abs(x - 0.5625) < 0.01 else 0\"\n\
                    [initial]\nf = \"1\"\n[time]\nend = 1\n[solver]\nmethod = \"classical\"\n";
        let case = Case::parse("test", text, &[]).expect("a case");
        let smooth = text.replace("0.2 if abs(x - 0.5625) < 0.01 else 0", "0.2*x");
        let smooth = Case::parse("test", &smooth, &[]).expect("a case");
        let grid = GridErrorPair { field: Some(1e-3), density: Some(1e-3) };
        let judged = |case: &Case, by_particles: Option<f64>, measured: Option<f64>| {
            let particles =
                ErrorsByParticles { field_mean: by_particles, ..ErrorsByParticles::default() };
            let accuracy = Accuracy { particles, ..Accuracy::default() };
            let mut summary =
                Summary { accuracy, error_l2_relative: measured, ..Summary::default() };
            summary.judge(case, EstimatedErrors { grid, ..EstimatedErrors::default() });
            let line = summary.accuracy.line().expect("errors");
            assert_eq!(summary.accuracy.unknown.is_some(), line.contains("V varies within cells"));
            summary.verdict
        };
        assert_eq!(judged(&case, None, None), Some(Verdict::Unknown));
        assert_eq!(judged(&case, Some(1e-3), None), Some(Verdict::Resolved));
        assert_eq!(judged(&case, None, Some(1e-3)), Some(Verdict::Resolved));
        assert_eq!(judged(&smooth, None, None), Some(Verdict::Resolved));
    }
    /// Between the points of the quadrature on elements an exact solution may vary: particles show
    /// it. With degree 0 values at centres are compared.
    #[test]
    fn particles_doubt_a_measured_error() {
        let text = "[[axis]]\nx = { lower = 0, upper = 1, cells = 8 }\n\
                    v = { lower = -1, upper = 1, cells = 8 }\n[[potential]]\nvalue = \"0\"\n\
                    [initial]\nf = \"1\"\n[time]\nend = 1\n[solver]\nmethod = \"classical\"\n";
        let judged = |degree: usize, goal_error: Option<f64>, shown: f64| {
            let text = format!("{text}accuracy = 0.1\n[scheme]\ndegree = {degree}\n");
            let case = Case::parse("test", &text, &[]).expect("a case");
            let particles =
                ErrorsByParticles { field: Some(shown), ..ErrorsByParticles::default() };
            let accuracy = Accuracy { particles, goal_error, ..Accuracy::default() };
            let measured = Some(0.09);
            let mut summary =
                Summary { accuracy, error_l2_relative: measured, ..Summary::default() };
            summary.judge(&case, EstimatedErrors::default());
            summary.verdict
        };
        assert_eq!(judged(2, None, 0.46), Some(Verdict::Unknown));
        assert_eq!(judged(2, None, 0.13), Some(Verdict::Unknown));
        assert_eq!(judged(2, None, 0.11), Some(Verdict::Resolved));
        assert_eq!(judged(2, Some(0.05), 0.46), Some(Verdict::Resolved));
        assert_eq!(judged(0, None, 0.46), Some(Verdict::Resolved));
    }
}
