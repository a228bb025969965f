//! The exact solution on a rank's share, where the case names one.

use crate::base::error::Result;
use crate::matrix::sampling::{sample, sample_with};
use crate::parallel::communicator::Group;
use crate::problem::case::{Case, Exact};
use crate::problem::exact::Tracer;
use crate::problem::exact::sheet::exact_moments;
use crate::results::dataset::ExactSolution;
use crate::solve::place::Place;

/// The exact solution at `T` on `place`: `f` at cell centres, or density and velocity as cell
/// averages. Collective over `world`.
///
/// # Errors
/// A formula or a start of a characteristic that is not finite.
pub fn exact_solution(world: &Group, case: &Case, place: &Place) -> Result<Option<ExactSolution>> {
    let (space, block) = (&case.space, &place.block);
    Ok(match &case.exact {
        None => None,
        Some(Exact::Formula(f)) => {
            let all = sample(world, space, block, f, case.end)?;
            Some(ExactSolution::Field(all[place.mine.clone()].to_vec()))
        }
        Some(Exact::Characteristics) => {
            if let Some(moments) = exact_moments(case)? {
                return Ok(Some(ExactSolution::Moments(moments.on(space, &place.share))));
            }
            let tracer = Tracer::new(case)?;
            let value = |point: &[f64; 6]| tracer.value(point, case.end);
            let exact = sample_with(space, block, &place.mine, value);
            if exact.iter().any(|f| !f.is_finite()) {
                let place = "where a characteristic of exact.kind = \"characteristics\" begins";
                return Err(case.fields[0].initial.undefined(f64::NAN, place.to_owned()));
            }
            Some(ExactSolution::Field(exact))
        }
    })
}
