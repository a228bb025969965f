//! The error that is reached against the tolerance, for each profile, down to round-off.

use crate::base::error::{Error, Result};
use crate::matrix::bounds::Bounds;
use crate::plan::ASSUMED_RATIO;
use crate::plan::layout::Resources;
use crate::problem::case::{Case, PropagatorMethod};
use crate::run::{Solution, planning};
use crate::schrodingerization::warp_plan::WarpPlan;
use crate::study::choices::PROFILES;
use crate::study::grids::coarsened;
use crate::study::stability::cases::grid_notes;
use crate::study::stability::panel::{
    Border, Curve, CurvePoint, PanelContents, PanelTask, nothing_tried,
};
use crate::study::trial::{plan_series, propagation};

/// Largest number of cells.
const CELLS: usize = 1024;
/// Tolerances that are tried; no profile reaches the last ones.
const ASKED: [f64; 8] = [1e-2, 1e-4, 1e-6, 1e-8, 1e-10, 1e-12, 1e-13, 1e-14];
/// Largest number of modes for which a plan is made.
const MOST_MODES: usize = 1 << 13;
/// A tolerance below every error.
const BELOW_ALL_ERRORS: f64 = 1e-16;

/// The trials of one profile.
#[derive(Default)]
struct ToleranceErrors {
    name: &'static str,
    /// Points by falling tolerance.
    points: Vec<CurvePoint>,
    /// The smallest tolerance that a plan accepts, if it is known.
    smallest: Option<f64>,
    /// Whether the budget did not hold smaller tolerances.
    too_long: bool,
    /// The reason why the last plan or trial that failed did so.
    refused: Option<String>,
}

impl ToleranceErrors {
    /// Tries the profile of `case` at ever smaller tolerances. Collective.
    fn measure(task: &PanelTask<'_>, name: &'static str, mut case: Case) -> Result<Self> {
        let mut found = Self { name, ..Self::default() };
        if task.budget.is_over() {
            found.too_long = true;
            return Ok(found);
        }
        case.tolerance = BELOW_ALL_ERRORS;
        found.smallest = match planning::plan(task.world, &case, &Resources::unlimited(task.world))
        {
            Err(Error::Tolerance { smallest, .. }) => Some(smallest),
            Ok(_) => Some(BELOW_ALL_ERRORS),
            Err(error) => {
                // As with too many modes: the smallest tolerance is not known.
                found.refused = Some(error.to_string());
                None
            }
        };
        let larger = |&asked: &f64| found.smallest.is_none_or(|smallest| asked > smallest);
        let asked: Vec<f64> = (ASKED.into_iter().filter(larger)).chain(found.smallest).collect();
        for tolerance in asked {
            case.tolerance = tolerance;
            let Some(tried) = trial_within(task, &case)? else {
                found.too_long = true;
                break;
            };
            match tried {
                Ok(trial) => found.points.push(CurvePoint {
                    x: tolerance,
                    measured: trial.summary.error_semidiscrete.unwrap_or(f64::NAN),
                    theory: tolerance,
                }),
                Err(error) => found.refused = Some(error.to_string()),
            }
        }
        Ok(found)
    }

    fn measured(&self) -> impl Iterator<Item = &CurvePoint> {
        self.points.iter().filter(|p| p.measured.is_finite())
    }

    /// The smallest tolerance that was tried.
    fn last(&self) -> Option<f64> {
        self.measured().last().map(|p| p.x)
    }

    /// The first trial whose error exceeds its tolerance.
    fn missed(&self) -> Option<&CurvePoint> {
        self.measured().find(|p| p.measured > p.theory)
    }

    fn border(&self) -> Border {
        // Trials that the budget ended do not show the smallest error.
        let complete = !self.too_long && (self.missed().is_some() || self.last() == self.smallest);
        let errors = self.measured().map(|p| p.measured);
        let reached = errors.filter(|_| complete).reduce(f64::min);
        let name = self.name;
        let name = format!("{name}: smallest error, beside the smallest tolerance planned");
        Border::new(name, reached, self.smallest).bounded()
    }
}

/// A trial of `case`; none if the budget does not hold it. Collective.
fn trial_within(task: &PanelTask<'_>, case: &Case) -> Result<Option<Result<Solution>>> {
    // With more modes even the plan takes too long.
    let modes = WarpPlan::modes_of(case, &Bounds::new(case)?, ASSUMED_RATIO);
    Ok(if modes.is_ok_and(|modes| modes > MOST_MODES) { None } else { task.trial(case) })
}

/// A sentence on the tolerances that were reached, missed, and not tried.
fn verdict(all: &[ToleranceErrors], borders: &[Border]) -> String {
    let (mut reached, mut missed, mut ended) = (Vec::new(), Vec::new(), Vec::new());
    for errors in all {
        let (name, last) = (errors.name, errors.last());
        match (errors.missed(), last) {
            (Some(p), _) => missed.push(format!("{name} at {:.1e} ({:.1e})", p.x, p.measured)),
            (None, Some(last)) => reached.push(format!("{name} down to {last:.1e}")),
            (None, None) if !errors.too_long => ended.push(format!("{name} (refused)")),
            (None, None) => {}
        }
        if errors.too_long {
            let below = last.map_or(String::new(), |last| format!(" below {last:.0e}"));
            ended.push(format!("{name}{below} (more than the budget, or {MOST_MODES} modes)"));
        }
    }
    let mut verdict = String::new();
    for (what, list) in [
        ("Every tolerance tried was kept by", reached),
        ("Tolerances were missed by", missed),
        ("Not tried:", ended),
    ] {
        if !list.is_empty() {
            verdict += &format!("{what} {}. ", list.join(", "));
        }
    }
    let smallest = (borders.iter())
        .filter_map(|b| Some((b.theory?, &b.name)))
        .min_by(|a, b| a.0.total_cmp(&b.0));
    if let Some((smallest, name)) = smallest {
        let name = name.split(':').next().unwrap_or_default();
        verdict += &format!(
            "The smallest that a plan accepts is {smallest:.1e} ({name}); runs refuse smaller ones."
        );
    }
    verdict
}

/// Measures the panel. Collective.
///
/// # Errors
/// As [`Bounds::new`]; errors of the trials are left out.
pub fn panel(task: &PanelTask<'_>) -> Result<PanelContents> {
    let mut case = coarsened(task.case, CELLS);
    case.verify = true;
    plan_series(&mut case.warp);
    case.warp.weights = true;
    case.propagator = propagation(case.duration(), PropagatorMethod::Chebyshev, None);
    let mut all = Vec::new();
    for (name, profile) in &PROFILES {
        let mut case = case.clone();
        case.warp.profile = profile.clone();
        all.push(ToleranceErrors::measure(task, name, case)?);
    }
    let borders: Vec<Border> = all.iter().map(ToleranceErrors::border).collect();
    let verdict = verdict(&all, &borders);
    let refused = all.iter().rev().find_map(|errors| errors.refused.clone());
    let curves: Vec<Curve> = (all.into_iter())
        .filter(|errors| !errors.points.is_empty())
        .map(|errors| Curve::bounded(errors.name, errors.points.into_iter().rev().collect()))
        .collect();
    if curves.is_empty() {
        return Err(refused.map_or_else(nothing_tried, Error::Input));
    }
    Ok(PanelContents {
        shape: case.space.elements(),
        curves,
        borders,
        verdict,
        notes: grid_notes(task.case, &case),
    })
}
