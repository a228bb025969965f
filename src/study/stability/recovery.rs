//! The recovery point: at which `p` may `f` be read from the warped field?

use crate::base::error::Result;
use crate::matrix::bounds::Bounds;
use crate::problem::case::Case;
use crate::schrodingerization::profile::series::Series;
use crate::schrodingerization::profile::shape::ProfileShape;
use crate::study::grids::coarsened;
use crate::study::stability::cases::grid_notes;
use crate::study::stability::panel::{
    Border, Curve, CurvePoint, PanelContents, PanelTask, nothing_tried,
};
use crate::study::stability::reading::{
    SpectrumExtent, SwitchedGaussian, THRESHOLD, expected, plateau, refuse_varying,
    switched_gaussian,
};
use crate::study::stability::reference::ReferenceProblem;
use crate::study::treatment::Treatment;

/// Largest number of cells: growth may show only on fine grids.
const CELLS: usize = 4096;
/// First and last point `p` of the readings, and the distance between neighbours.
const FROM: f64 = -4.0;
const TO: f64 = 22.0;
const APART: f64 = 0.5;

/// The treatments to compare, by name, with the case of each. If `V` jumps, these are the laws that
/// may grow, the weighted ones first.
fn treatments(case: &Case, jumps: bool) -> Vec<(String, Case)> {
    if case.is_galerkin() {
        return vec![("elements".to_owned(), case.clone())];
    }
    if !jumps {
        return vec![("no jump".to_owned(), case.clone())];
    }
    let growing = Treatment::all().into_iter().rev().filter(|kind| kind.has_growing_law());
    growing.map(|kind| (kind.name(), kind.of(case))).collect()
}

/// The readings with one treatment.
struct TreatmentReadings {
    name: String,
    points: Vec<CurvePoint>,
    extent: SpectrumExtent,
    /// The bound on `λ⁺T` that runs use.
    growth_bound: f64,
    /// The error on the plateau.
    threshold: f64,
}

impl TreatmentReadings {
    /// The ends of the plateau, measured and by theory.
    fn ends(&self) -> [[Option<f64>; 2]; 2] {
        [|p: &CurvePoint| p.measured, |p: &CurvePoint| p.theory]
            .map(|of| plateau(&self.points, self.threshold, of))
    }

    fn verdict(&self) -> String {
        let [[left, right], [left_theory, right_theory]] = self.ends();
        let number = |x: Option<f64>| x.map_or("nowhere".to_owned(), |x| format!("{x:.2}"));
        format!(
            "{}: lambda+ T = {:.3}; the error is below {:.1e} from p = {} (bound {}) to p = {} \
             (bound {}). ",
            self.name,
            self.extent.growth,
            self.threshold,
            number(left),
            number(left_theory),
            number(right),
            number(right_theory)
        )
    }

    fn borders(&self) -> [Border; 3] {
        let [[left, right], [left_theory, right_theory]] = self.ends();
        let name = &self.name;
        let growth = format!("{name}: lambda+ T, beside the bound of a run");
        [
            Border::without_ratio(growth, Some(self.extent.growth), Some(self.growth_bound)),
            Border::without_ratio(format!("{name}: plateau begins"), left, left_theory),
            Border::new(format!("{name}: round-off ends it"), right, right_theory),
        ]
        .map(Border::bounded)
    }
}

/// Reads the field at every point with one treatment; none if the budget does not hold it, which is
/// then added to `notes`. Collective.
fn read(
    task: &PanelTask<'_>,
    name: String,
    case: &Case,
    notes: &mut Vec<String>,
) -> Result<Option<TreatmentReadings>> {
    let SwitchedGaussian { profile, room } = switched_gaussian();
    let at: Vec<f64> =
        (0..).map(|k| FROM + APART * f64::from(k)).take_while(|p| *p <= TO).collect();
    let mut reference = ReferenceProblem::new(task.world, case)?;
    let extent = SpectrumExtent::measured(&mut reference, case.duration())?;
    let period = extent.length() + TO + room;
    let modes = (profile.cutoff * period / std::f64::consts::TAU).ceil() as usize + 1;
    let series = Series::analytic(period, modes, |mu| profile.coefficient(mu));
    if !task.budget.fits_count(reference.updates(&series)?, 1.0) {
        notes.push(format!("{name}: {modes} modes take too long here"));
        return Ok(None);
    }
    let ratio = reference.ratio;
    let errors = reference.errors(&series, &at)?;
    let point = |(&x, &measured): (&f64, &f64)| CurvePoint {
        x,
        measured,
        theory: expected(&series, x, extent, ratio),
    };
    Ok(Some(TreatmentReadings {
        name,
        points: at.iter().zip(&errors).map(point).collect(),
        extent,
        growth_bound: reference.prepared.bounds.growth * case.duration(),
        // Twice the error of the profile, amplified by the recovery.
        threshold: THRESHOLD * ratio * extent.growth.max(0.0).exp() * 2.0,
    }))
}

/// Measures the panel. Collective.
///
/// # Errors
/// As [`ReferenceProblem::new`].
pub fn panel(task: &PanelTask<'_>) -> Result<PanelContents> {
    refuse_varying(task.case)?;
    let coarse = coarsened(task.case, CELLS);
    let jumps = Bounds::new(&coarse)?.jumps;
    let mut notes = grid_notes(task.case, &coarse);
    let mut all: Vec<TreatmentReadings> = Vec::new();
    for (name, case) in treatments(&coarse, jumps) {
        if task.budget.is_over() {
            notes.push(format!("{name}: the budget is used up"));
            break;
        }
        all.extend(read(task, name, &case, &mut notes)?);
    }
    if all.is_empty() {
        return Err(nothing_tried());
    }
    let verdicts: String = all.iter().map(TreatmentReadings::verdict).collect();
    Ok(PanelContents {
        shape: coarse.space.elements(),
        borders: all.iter().flat_map(TreatmentReadings::borders).collect(),
        curves: (all.into_iter())
            .map(|readings| Curve::bounded(readings.name, readings.points))
            .collect(),
        verdict: verdicts
            + "Runs refuse a recovery point at which round-off exceeds the tolerance, and warn \
               below lambda+ T.",
        notes,
    })
}
