//! The cases that panels measure, and their growth.

use crate::base::error::{Error, Result};
use crate::parallel::communicator::World;
use crate::plan::layout::Resources;
use crate::problem::case::{Case, Limiter, Method, SchemeSettings};
use crate::solve::prepared::Prepared;
use crate::solve::spectrum::SpectrumExtremes;
use crate::study::grids::{grid_name, stray_edges};
use crate::study::trial::final_fields_only;

/// The largest number of Lanczos steps.
const LANCZOS: usize = 4000;

/// `case` by modes, with no output but the fields at its end, and without comparisons.
pub fn by_modes(case: &Case) -> Case {
    let case = final_fields_only(case);
    Case {
        verify: false,
        exact: None,
        scheme: SchemeSettings { limiter: Limiter::None, ..case.scheme },
        method: Method::Schrodingerized,
        ..case
    }
}

/// Notes of a panel that was measured on the grid of `used` instead of that of `case`.
pub fn grid_notes(case: &Case, used: &Case) -> Vec<String> {
    let [shape, coarse] = [case, used].map(|case| grid_name(&case.space));
    let mut notes = Vec::new();
    if shape != coarse {
        notes.push(format!("measured on {coarse} instead of {shape}"));
        if stray_edges(used) > stray_edges(case) {
            notes.push("the edges of V lie on other faces there".to_owned());
        }
    }
    notes
}

/// `case` with `factor` times its potential.
pub fn with_potential_times(case: &Case, factor: f64) -> Case {
    let mut case = case.clone();
    for region in &mut case.potential {
        region.value = region.value.times(factor);
    }
    case
}

/// Refuses a case whose growth at jumps is zero by construction.
///
/// # Errors
/// With elements, and with partial reflection.
pub fn refuse_elements(case: &Case) -> Result<()> {
    if case.is_galerkin() {
        Err(Error::input(
            "not applicable: S <= 0 by construction with elements or partial reflection, \
                 on any grid and at any jump, and there are no weights to compare",
        ))
    } else {
        Ok(())
    }
}

/// `case` assembled on all ranks. Collective.
///
/// # Errors
/// As [`Prepared::new`].
pub fn assembled(world: &World, case: &Case) -> Result<Prepared> {
    Prepared::new(world, case, &Resources::unlimited(world))
}

/// Both ends of the spectrum of `S` of an assembled case; the highest is `λ⁺`. Collective.
///
/// # Errors
/// As [`spectrum`](crate::solve::system::DiscreteSystem::spectrum).
pub fn extremes(found: &mut Prepared) -> Result<SpectrumExtremes> {
    Ok(found.system.spectrum(&found.communicator.space, LANCZOS)?.extremes)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::problem::potential::unresolved_regions;

    /// A region without a cell centre counts on both grids, and a grid that is the case's own has
    /// no notes.
    #[test]
    fn regions_without_a_centre_are_no_moved_edges() {
        let text = r#"
            axis = [
            { x = { lower = -1, upper = 1, cells = 20 }, v = { lower = -1, upper = 1, cells = 20 } }
            ]
            potential = [
            { where = "abs(x - 0.02) < 0.01", value = "0.2" }, { where = "x < 0", value = "0.1" },
            { value = "0" }
            ]
            initial.f = "exp(-20*(x^2 + v^2))"
            time.end = 0.5
            solver.tolerance = 1e-5
        "#;
        let read = |cells: &str| Case::parse("case.toml", text, &[cells.to_owned()]).unwrap();
        let case = read("axis.0.x.cells=20");
        assert!(stray_edges(&case) > unresolved_regions(&case).edges.len());
        assert!(grid_notes(&case, &case).is_empty());
        let notes = |cells: &str| grid_notes(&case, &read(cells));
        assert_eq!(notes("axis.0.v.cells=10"), ["measured on 20 x 10 instead of 20 x 20"]);
        // An edge at 0 lies within a cell of an odd number of cells.
        assert_eq!(notes("axis.0.x.cells=15").len(), 2);
    }
}
