//! The amplification `e^{λ⁺T}` of errors by the recovery, against refinement, for each treatment.

use crate::base::error::{Error, Result};
use crate::matrix::bounds::Bounds;
use crate::problem::case::Case;
use crate::study::grids::{coarsened, refined};
use crate::study::stability::cases::{assembled, extremes, refuse_elements};
use crate::study::stability::grazing::expected_growth;
use crate::study::stability::panel::{
    Border, Curve, CurvePoint, PanelContents, PanelTask, nothing_tried,
};
use crate::study::treatment::Treatment;

/// Cells of the coarsest grid.
const FEWEST: usize = 256;
/// Largest number of cells.
const MOST: usize = 1 << 17;
/// Factors of refinement along every axis.
const FACTORS: [usize; 6] = [1, 2, 3, 4, 6, 8];
/// The time of a grid grows with this power of the factor in one dimension: cells, and steps of
/// Lanczos.
const POWER: i32 = 3;

/// Whether `λ⁺T` rises or falls with the logarithm of the cells, by a line of least squares. Its
/// slope counts if it exceeds `STUDENT_T_95` times its standard error and changes `λ⁺T` by at least
/// `LEAST_CHANGE` over all grids.
fn trend(points: &[CurvePoint]) -> &'static str {
    /// Fewer grids show no trend.
    const GRIDS: usize = 4;
    /// Student's t at 95 % for four grids, with two degrees of freedom.
    const STUDENT_T_95: f64 = 4.3;
    const LEAST_CHANGE: f64 = 0.01;
    if points.len() < GRIDS {
        return "too few grids for a trend";
    }
    let count = points.len() as f64;
    let pairs = || points.iter().map(|p| (p.x.ln(), p.measured.ln()));
    let (x_mean, y_mean) =
        pairs().fold((0.0, 0.0), |(a, b), (x, y)| (a + x / count, b + y / count));
    let spread: f64 = pairs().map(|(x, _)| (x - x_mean).powi(2)).sum();
    let slope = pairs().map(|(x, y)| (x - x_mean) * (y - y_mean)).sum::<f64>() / spread;
    let rest: f64 = pairs().map(|(x, y)| (y - y_mean - slope * (x - x_mean)).powi(2)).sum();
    let error = (rest / (count - 2.0) / spread).sqrt();
    let range = pairs().map(|(x, _)| x - x_mean).fold(0.0, |m: f64, x| m.max(x.abs()));
    match slope {
        s if s.abs() <= STUDENT_T_95 * error || s.abs() * 2.0 * range < LEAST_CHANGE => {
            "no trend by refinement"
        }
        s if s > 0.0 => "rising by refinement",
        s if s < 0.0 => "falling by refinement",
        _ => "no trend by refinement",
    }
}

/// The verdict on a curve, on its finest grid and over all grids. The finest grid is that of the
/// borders.
fn sentence(curve: &Curve) -> String {
    /// Relative round-off of an amplification of 1.
    const ROUND_OFF: f64 = 1e-9;
    let (name, points) = (&curve.name, &curve.points);
    let most = (points.iter()).max_by(|a, b| a.measured.total_cmp(&b.measured));
    let Some((finest, most)) = points.last().zip(most) else {
        return format!("{name}: nothing was tried within the budget.");
    };
    let grids = points.len();
    if most.measured <= 1.0 + ROUND_OFF {
        return format!(
            "{name}: does not amplify on any of {grids} grids (a factor {:.4} at {} cells along \
             x).",
            finest.measured, finest.x
        );
    }
    let amplified = |p: &CurvePoint| match p.measured {
        m if m <= 1.0 + ROUND_OFF => format!("does not amplify at {} cells along x", p.x),
        m => format!("a factor {m:.4e} at {} cells along x", p.x),
    };
    format!(
        "{name}: {}, at most {:.4e}, at {} cells, on {grids} grids; {}.",
        amplified(finest),
        most.measured,
        most.x,
        trend(points)
    )
}

/// `λ⁺` of `case` with this treatment, measured and by theory. Collective.
fn growth_of(task: &PanelTask<'_>, case: &Case, treatment: Treatment) -> Result<[f64; 2]> {
    let mut found = assembled(task.world, case)?;
    let measured = extremes(&mut found)?.highest.value;
    let theory = match treatment {
        // S ≤ 0.
        treatment if !treatment.has_growing_law() => 0.0,
        // The certificate is above λ⁺.
        treatment if treatment.weights => found.system.weights.certificate,
        _ => expected_growth(case)?.unwrap_or(f64::NAN),
    };
    Ok([measured, theory])
}

/// Measures the panel. Collective.
///
/// # Errors
/// As [`assembled`].
pub fn panel(task: &PanelTask<'_>) -> Result<PanelContents> {
    refuse_elements(task.case)?;
    let start = coarsened(&task.case.without_inflow(), FEWEST);
    if !Bounds::new(&start)?.jumps && !Bounds::new(task.case)?.jumps {
        let why = "V does not jump: S has no positive eigenvalues on any grid without weights";
        return Err(Error::input(why));
    }
    let treatments = Treatment::all();
    let mut curves: Vec<Curve> = (treatments.iter())
        // Theory gives the growth itself only for unweighted rows that may grow, else a bound.
        .map(|of| Curve { bound: !of.may_grow(), ..Curve::new(of.name(), Vec::new()) })
        .collect();
    let (mut borders, mut notes) = (Vec::new(), Vec::new());
    let mut shape = start.space.elements();
    // The seconds of a grid by those of the grid before it.
    let (mut before, mut expected) = (1, 0.0);
    for factor in FACTORS {
        let grid = refined(&start, factor);
        expected *= (factor as f64 / before as f64).powi(POWER);
        if grid.space.cells() > MOST || !task.budget.has_time_for(expected) {
            notes.push("finer grids take too long here".to_owned());
            break;
        }
        shape = grid.space.elements();
        let (x, begun) = (shape[0] as f64, task.budget.elapsed());
        borders.clear();
        for (treatment, curve) in treatments.iter().zip(&mut curves) {
            let case = treatment.of(&grid);
            let [measured, theory] = growth_of(task, &case, *treatment)?;
            let [measured_factor, by_theory] =
                [measured, theory].map(|of| (of * case.duration()).exp());
            curve.points.push(CurvePoint { x, measured: measured_factor, theory: by_theory });
            let name = format!("{}: lambda+ at {x} cells", curve.name);
            let border = Border::without_ratio(name, Some(measured), Some(theory));
            borders.push(Border { bound: curve.bound, ..border });
        }
        (before, expected) = (factor, task.budget.elapsed() - begun);
    }
    if curves.iter().all(|c| c.points.is_empty()) {
        return Err(nothing_tried());
    }
    let sentences: Vec<String> = curves.iter().map(sentence).collect();
    let verdict = format!(
        "The factor by which reading f amplifies errors of the modes. {}",
        sentences.join(" ")
    );
    Ok(PanelContents { shape, curves, borders, verdict, notes })
}
