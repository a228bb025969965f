//! `δ` of the inflow. A small `δ` couples strongly, so that the state grows; with a large one the
//! auxiliary unknowns are much larger than the field.
//!
//! A row `i` and its unknown have the block `(−d_i, κ_i/2; κ_i/2, 0)` of `S`, so
//! `λ⁺ ≥ ½(√(d_i² + κ_i²) − d_i)`, `κ_i = b_i/δ`; the certificate `γ` of the weights and the row's
//! draw bound it from above ([`crate::matrix::block_matrix`]). The tolerance of the state is that
//! of the field times `‖f(T)‖/‖ũ(0)‖`. So round-off and truncation errors appear in the field
//! multiplied by the loss `e^{λ⁺T} ‖ũ(0)‖/‖f(T)‖`.

use crate::base::error::{Error, Result};
use crate::matrix::inflow::AuxiliaryRow;
use crate::problem::case::{Case, Delta};
use crate::solve::prepared::Prepared;
use crate::study::grids::coarsened;
use crate::study::stability::cases::{assembled, extremes, grid_notes};
use crate::study::stability::panel::{Border, Curve, CurvePoint, PanelContents, PanelTask};
use crate::study::trial::with_delta;

/// Largest number of cells.
const CELLS: usize = 4096;
/// Values of `δ` a decade, and decades below and above the largest `|b|`.
const PER_DECADE: i32 = 4;
const DECADES: i32 = 3;

/// Largest of `of` over the rows of inflow on all ranks. Collective.
fn over_rows(found: &Prepared, of: impl Fn(&AuxiliaryRow) -> f64) -> f64 {
    let rows = found.system.matrix.inflow.iter();
    found.communicator.world.max(rows.map(of).fold(0.0, f64::max))
}

/// The two factors of the loss.
struct InflowLoss {
    /// The exponent `λ⁺T` of the growth.
    exponent: f64,
    /// A lower bound on `λ⁺T`, from one row and its unknown.
    least_exponent: f64,
    /// The ratio of norms `‖ũ(0)‖/‖f(T)‖`.
    ratio: f64,
}

impl InflowLoss {
    /// The loss of a matrix at time `end`. Collective.
    fn of(found: &mut Prepared, end: f64) -> Result<Self> {
        let ratio = found.probe();
        let exponent = extremes(found)?.highest.value * end;
        let matrix = &found.system.matrix;
        let block = |aux: &AuxiliaryRow| {
            let row = aux.row as usize;
            let own: f64 = (matrix.row(row).filter(|&(j, ..)| j == row)).map(|(_, s, _)| s).sum();
            0.5 * (own + own.hypot(aux.coupling))
        };
        Ok(Self { exponent, least_exponent: over_rows(found, block) * end, ratio })
    }

    fn total(&self) -> f64 {
        self.exponent.exp() * self.ratio
    }
}

/// The loss and its two factors over `δ`.
#[derive(Default)]
struct LossCurves {
    total: Vec<CurvePoint>,
    growth: Vec<CurvePoint>,
    state: Vec<CurvePoint>,
}

impl LossCurves {
    /// The curves of `case` over [`DECADES`] decades of `δ` on each side of `middle`. Collective.
    ///
    /// # Errors
    /// As [`assembled`] and [`InflowLoss::of`].
    fn measure(
        task: &PanelTask<'_>,
        case: &Case,
        middle: f64,
        notes: &mut Vec<String>,
    ) -> Result<Self> {
        let mut curves = Self::default();
        for k in -PER_DECADE * DECADES..=PER_DECADE * DECADES {
            if task.is_over(notes) {
                break;
            }
            let delta = middle * 10f64.powf(f64::from(k) / f64::from(PER_DECADE));
            let mut found = assembled(task.world, &with_delta(case, Delta::Given(delta)))?;
            let bound = found.bounds.growth * case.duration();
            let loss = InflowLoss::of(&mut found, case.duration())?;
            let point = |measured: f64, theory: f64| CurvePoint { x: delta, measured, theory };
            curves.growth.push(point(loss.exponent.exp(), loss.least_exponent.exp()));
            curves.state.push(point(loss.ratio, f64::NAN));
            curves.total.push(point(loss.total(), bound.exp() * loss.ratio));
        }
        Ok(curves)
    }

    /// The point of least loss.
    fn least(&self, of: fn(&CurvePoint) -> f64) -> Option<CurvePoint> {
        let finite = self.total.iter().filter(|p| of(p).is_finite());
        finite.min_by(|a, b| of(a).total_cmp(&of(b))).copied()
    }
}

/// Measures the panel. Collective.
///
/// # Errors
/// As [`assembled`].
pub fn panel(task: &PanelTask<'_>) -> Result<PanelContents> {
    let PanelTask { world, case: whole, .. } = *task;
    if !whole.enters() {
        return Err(Error::input("nothing enters"));
    }
    if whole.varies() {
        return Err(Error::input(
            "the inflow depends on time: its couplings are planned step by step",
        ));
    }
    let case = coarsened(whole, CELLS);
    let mut planned = assembled(world, &with_delta(&case, Delta::Planned))?;
    let largest =
        over_rows(&planned, |aux| aux.values.iter().fold(0.0, |m: f64, b| m.max(b.abs())));
    if largest == 0.0 {
        return Err(Error::input("the inflow is zero on this grid"));
    }
    let chosen = InflowLoss::of(&mut planned, case.duration())?.total();
    let mut notes = grid_notes(whole, &case);
    let curves = LossCurves::measure(task, &case, largest, &mut notes)?;
    let (measured, theory) = (curves.least(|p| p.measured), curves.least(|p| p.theory));
    let [at, best] = measured.map_or([f64::NAN; 2], |p| [p.x, p.measured]);
    Ok(PanelContents {
        shape: case.space.elements(),
        borders: vec![
            Border::new("delta of least loss", measured.map(|p| p.x), theory.map(|p| p.x)),
            Border::new(
                "loss with the planned couplings, beside the least",
                Some(chosen),
                Some(best),
            ),
        ],
        verdict: format!(
            "The least that a single delta loses is a factor {best:.3e}, at delta = {at:.3e}; \
             below it lambda+ T explodes, above it the auxiliary unknowns exceed the field. The \
             planned couplings lose {chosen:.3e}."
        ),
        curves: vec![
            Curve::bounded("loss: growth x state", curves.total),
            Curve::bounded("growth exp(lambda+ T)", curves.growth),
            Curve::bounded("state over field", curves.state),
        ],
        notes,
    })
}
