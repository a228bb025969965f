//! `δ` of the inflow: small, it couples strongly and grows; large, the auxiliary unknowns dwarf the field.
//!
//! A row `i` and its unknown have the block `(−d_i, κ_i/2; κ_i/2, 0)` of `S`, so `λ⁺ ≥ ½(√(d_i² + κ_i²) − d_i)`, `κ_i = b_i/δ`; the certificate
//! `γ` of the weights and the row's draw bound it from above ([`crate::matrix::block_matrix`]). The tolerance of the state is that of the field times
//! `‖f(T)‖/‖ũ(0)‖`. What is lost by both is `e^{λ⁺T} ‖ũ(0)‖/‖f(T)‖`: the factor by which round-off and everything left out appear in the field.

use crate::base::error::Result;
use crate::parallel::communicator::World;
use crate::problem::case::{Case, Delta};
use crate::solve::prepared::Prepared;
use crate::study::budget::Budget;
use crate::study::grids::coarsened;
use crate::study::stability::scene::{assembled, growth, note};
use crate::study::stability::{Border, Curve, Found, Name, Panel, Point, Scale};

/// Cells that are enough.
const CELLS: usize = 4096;
/// Values of `δ`, four a decade, around the largest `|b|`.
const PER_DECADE: i32 = 4;
const DECADES: i32 = 3;

/// Largest of `of` over the rows of inflow on all ranks. Collective.
fn over_rows(found: &Prepared, of: impl Fn(&crate::matrix::inflow::Inflow) -> f64) -> f64 {
    let rows = found.system.matrix.inflow.iter();
    found
        .communicator
        .world
        .max(rows.map(of).fold(0.0, f64::max))
}

/// The panel. Collective.
///
/// # Errors
/// As [`assembled`].
pub fn panel(world: &World, whole: &Case, budget: &Budget) -> Result<Found> {
    if !whole.enters() {
        return Ok(Err("nothing enters".to_owned()));
    }
    if whole.varies() {
        let why = "what enters depends on time: its couplings are planned step by step";
        return Ok(Err(why.to_owned()));
    }
    let case = coarsened(whole, CELLS);
    let with = |delta: Delta| {
        let mut case = case.clone();
        case.warp.delta = delta;
        case
    };
    let planned = assembled(world, &with(Delta::Planned))?;
    let largest = over_rows(&planned, |aux| {
        aux.values.iter().fold(0.0, |m: f64, b| m.max(b.abs()))
    });
    if largest == 0.0 {
        return Ok(Err("what enters is zero on this grid".to_owned()));
    }
    let loss = |found: &mut Prepared| -> Result<[f64; 3]> {
        let ratio = found.probe();
        let grows = growth(found)? * case.end;
        let matrix = &found.system.matrix;
        let block = |aux: &crate::matrix::inflow::Inflow| {
            let row = aux.row as usize;
            let own: f64 = (matrix.row(row).filter(|&(j, ..)| j == row))
                .map(|(_, s, _)| s)
                .sum();
            0.5 * (own + own.hypot(aux.coupling))
        };
        let least = over_rows(found, block) * case.end;
        Ok([grows, least, ratio])
    };
    let [grows, _, ratio] = loss(&mut assembled(world, &with(Delta::Planned))?)?;
    let chosen = grows.exp() * ratio;
    let mut notes = note(whole, &case);
    let [mut total, mut growing, mut state] = [Vec::new(), Vec::new(), Vec::new()];
    for k in -PER_DECADE * DECADES..=PER_DECADE * DECADES {
        if budget.is_over() {
            notes.push("curves end where the budget did".to_owned());
            break;
        }
        let delta = largest * 10f64.powf(f64::from(k) / f64::from(PER_DECADE));
        let mut found = assembled(world, &with(Delta::Given(delta)))?;
        let bound = found.bounds.growth * case.end;
        let [grows, least, ratio] = loss(&mut found)?;
        let point = |measured: f64, theory: f64| Point {
            x: delta,
            measured,
            theory,
        };
        growing.push(point(grows.exp(), least.exp()));
        state.push(point(ratio, f64::NAN));
        total.push(point(grows.exp() * ratio, bound.exp() * ratio));
    }
    let least = |of: fn(&Point) -> f64| {
        let finite = total.iter().filter(|p| of(p).is_finite());
        finite.min_by(|a, b| of(a).total_cmp(&of(b))).copied()
    };
    let (measured, theory) = (least(|p| p.measured), least(|p| p.theory));
    let best = measured.map_or(f64::NAN, |p| p.measured);
    let borders = vec![
        Border::new(
            "delta of least loss",
            measured.map(|p| p.x),
            theory.map(|p| p.x),
        ),
        Border::new(
            "loss with the planned couplings, beside the least",
            Some(chosen),
            Some(best),
        ),
    ];
    let verdict = format!(
        "The least that a single delta loses is a factor {best:.3e}, at delta = {:.3e}; below it lambda+ T explodes, above it the auxiliary unknowns \
         dwarf the field. The planned couplings lose {chosen:.3e}.",
        measured.map_or(f64::NAN, |p| p.x)
    );
    let curve = |name: &str, points: Vec<Point>| Curve {
        name: name.to_owned(),
        points,
        bound: true,
    };
    Ok(Ok(Panel {
        name: Name::Delta,
        title: "Delta of the inflow".to_owned(),
        shape: case.space.shape(),
        x: Scale::log("delta"),
        y: Scale::log("factor"),
        curves: vec![
            curve("loss: growth x state", total),
            curve("growth exp(lambda+ T)", growing),
            curve("state over field", state),
        ],
        borders,
        verdict,
        notes,
    }))
}
