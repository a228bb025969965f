//! The recovery's amplification `e^{λ⁺T}` against refinement, for each kind of interface row.

use super::budget::Budget;
use super::grazing::expected_growth;
use super::scene::{assembled, coarsened, growth, refined, with_interface};
use super::{Border, Curve, Found, Name, Panel, Point, Scale};
use crate::case::{Case, Interface};
use crate::communicator::World;
use crate::error::Result;
use crate::plan::Bounds;

/// Cells that the sweep begins with.
const FEWEST: usize = 256;
/// Cells that are not exceeded.
const MOST: usize = 1 << 17;
/// What they are multiplied by along every axis.
const FACTORS: [usize; 6] = [1, 2, 3, 4, 6, 8];

/// The panel. Collective.
///
/// # Errors
/// As [`assembled`].
pub fn panel(world: &World, whole: &Case, budget: &Budget) -> Result<Found> {
    let start = coarsened(&whole.without_inflow(), FEWEST);
    if !Bounds::new(&start)?.jumps && !Bounds::new(whole)?.jumps {
        let why = "V does not jump: S has no positive eigenvalues on any grid, nor needs weights";
        return Ok(Err(why.to_owned()));
    }
    let kinds = [
        ("hat, no weights", Interface::Hat, false),
        ("hat, dissipative weights", Interface::Hat, true),
        ("conservative", Interface::Conservative, false),
    ];
    let mut curves: Vec<Curve> = kinds
        .map(|(name, ..)| Curve {
            name: name.to_owned(),
            points: Vec::new(),
        })
        .into();
    let (mut borders, mut notes) = (Vec::new(), Vec::new());
    let mut last = start.space.shape();
    for factor in FACTORS {
        let grid = refined(&start, factor);
        if grid.space.cells() > MOST || budget.over() {
            notes.push("finer grids take too long here".to_owned());
            break;
        }
        last = grid.space.shape();
        let x = grid.space.x[0].cells as f64;
        borders.clear();
        for ((name, interface, weights), curve) in kinds.iter().zip(&mut curves) {
            let case = with_interface(&grid, *interface, *weights);
            let mut found = assembled(world, &case)?;
            let measured = growth(&mut found)?;
            // The certificate is above λ⁺; conservative rows have S ≤ 0.
            let theory = match (interface, weights) {
                (Interface::Conservative, _) => 0.0,
                (Interface::Hat, true) => found.problem.weights.certificate,
                (Interface::Hat, false) => expected_growth(&case)?.unwrap_or(f64::NAN),
            };
            curve.points.push(Point {
                x,
                measured: (measured * case.end).exp(),
                theory: (theory * case.end).exp(),
            });
            borders.push(Border::place(
                format!("{name}: lambda+ at {x} cells"),
                Some(measured),
                Some(theory),
            ));
        }
    }
    let most = |curve: &Curve| curve.points.iter().map(|p| p.measured).fold(0.0, f64::max);
    let verdict = format!(
        "Reading f amplifies what is wrong with the modes by up to {:.3e} with hat rows without weights, more the finer the grid; by at most \
         {:.3} with weights and {:.3} with conservative rows on every grid.",
        most(&curves[0]),
        most(&curves[1]),
        most(&curves[2])
    );
    Ok(Ok(Panel {
        name: Name::Growth,
        title: "Growth against refinement".to_owned(),
        shape: last,
        x: Scale::log("cells along x"),
        y: Scale::log("amplification exp(lambda+ T)"),
        curves,
        borders,
        verdict,
        notes,
    }))
}
