//! The search for the coarsest grid of each scheme that reaches the accuracy.

use crate::base::error::{Error, Result};
use crate::problem::case::{Limiter, Method};
use crate::study::advise::grid_search::{DISCRETISATION, GridSearch, SearchGoal, SearchStart};
use crate::study::advise::reached_grid::{Evidence, ReachedGrid};
use crate::study::advise::scheme::SchemeChoice;
use crate::study::advise::setups::SkippedSetup;
use crate::study::advise::{ROUND_OFF, Study};
use crate::study::budget::{Budget, longer};
use crate::study::grids::{AxisGroup, cells, shape_text};

/// The largest number of budgets, as counted, that the run on the first grid may take. A budget
/// counts about a third of what a core does ([`crate::study::budget`]).
const MOST_BUDGETS: f64 = 4.0;
/// Part of the budget for the grid searches of all schemes.
const FOR_GRIDS: f64 = 0.7;
/// Largest part of the budget that a trial of the case on its own grid may take.
const FOR_CASE: f64 = 0.3;

/// The reason why there is no grid of a scheme.
enum NoGrid {
    /// The budget does not hold a run on the first grid, which has this shape.
    BudgetTooSmall(Vec<usize>),
    /// A trial failed.
    Failed(Error),
}

/// The result of the search for the grid of a scheme.
type SearchResult = std::result::Result<ReachedGrid, NoGrid>;

/// A search from a grid of this `shape`, whose space and velocities are balanced first.
fn balanced(shape: &[usize]) -> SearchStart<'_> {
    SearchStart { shape, balance: true }
}

/// A scheme, and the result of the search for its grid.
struct SearchedScheme {
    scheme: SchemeChoice,
    tried: SearchResult,
}

impl Study<'_> {
    /// Tries the case's own grid first if that is cheap, so that its error is not extrapolated.
    /// Collective.
    pub(super) fn try_own_grid(&mut self) -> Result<()> {
        let (scheme, own) = (SchemeChoice::of(self.case), self.case.space.elements());
        let trials = &mut self.trials;
        if trials.is_cheap(scheme, &own, FOR_CASE)? {
            let twice = trials.degree_case(scheme).grids.doubled(&own, AxisGroup::All);
            let known = match trials.error(scheme, &own) {
                Ok(None) if trials.is_cheap(scheme, &twice, FOR_CASE)? => {
                    trials.run(scheme, &twice).map(|_| ())
                }
                other => other.map(|_| ()),
            };
            if let Err(error) = known {
                let name = scheme.name(Method::Classical, self.jumps);
                self.left_out.push(SkippedSetup::new(format!("{name} as it stands"), error));
            }
        }
        Ok(())
    }

    /// The first grid on which `scheme` is tried: the coarsest; or the case's own, if a run on the
    /// coarsest fails, as with data so narrow that no cell holds them. Collective.
    pub(super) fn start(&mut self, scheme: SchemeChoice) -> Vec<usize> {
        let degree_case = self.trials.degree_case(scheme);
        let own = degree_case.base.space.elements();
        let coarsest = degree_case.grids.coarsest(&own);
        if self.trials.has_run(scheme, &own) && self.trials.run(scheme, &coarsest).is_err() {
            own
        } else {
            coarsest
        }
    }

    /// The schemes that can be tried. If a degree is refused, one line says so for all higher ones.
    fn schemes(&mut self) -> Vec<SchemeChoice> {
        let mut schemes = SchemeChoice::candidates(self.case, self.jumps);
        let refused =
            schemes.iter().find_map(|s| Some((s.degree, self.trials.prepare(s.degree).err()?)));
        if let Some((degree, error)) = refused {
            let elements = format!("elements of degree {degree} and more");
            self.left_out.push(SkippedSetup::new(elements, error));
        }
        schemes.retain(|scheme| self.trials.is_prepared(scheme.degree));
        schemes
    }

    /// The coarsest grid of each scheme that reaches the accuracy. Collective.
    ///
    /// # Errors
    /// The last one, if no scheme could be tried.
    pub(super) fn grids_by_scheme(&mut self) -> Result<Vec<ReachedGrid>> {
        let schemes = self.schemes();
        let first = self.start(schemes[0]);
        // The first scheme is tried even if the budget holds it only roughly.
        if !self.trials.is_cheap(schemes[0], &first, MOST_BUDGETS)? {
            return Err(Error::Input(format!(
                "--budget {} s: it holds no run on the first grid to try, {}; fewer cells \
                 (axis.N.x.cells) or a longer --budget",
                self.trials.budget.limit(),
                shape_text(&first)
            )));
        }
        let mut found: Vec<SearchedScheme> = Vec::new();
        for (k, &scheme) in schemes.iter().enumerate() {
            // Each scheme has an equal share of the budget for grids.
            let share = FOR_GRIDS * (k + 1) as f64 / schemes.len() as f64;
            let tried = match k {
                0 => self.coarsest(scheme, balanced(&first), share).map_err(NoGrid::Failed),
                _ => self.search_grid(scheme, share)?,
            };
            found.push(SearchedScheme { scheme, tried });
        }
        self.spend_rest_on_modes(&mut found)?;
        self.reached_grids(found)
    }

    /// If no scheme that modes can run reaches the accuracy: gives the shares that others left over
    /// to these schemes one by one, fewest expected unknowns first, until one reaches it.
    /// Collective.
    fn spend_rest_on_modes(&mut self, found: &mut [SearchedScheme]) -> Result<()> {
        let by_modes = |scheme: &SchemeChoice| scheme.limiter == Limiter::None;
        if found.iter().any(|s| by_modes(&s.scheme) && !self.misses_accuracy(&s.tried)) {
            return Ok(());
        }
        found.sort_by(|a, b| Self::expected_unknowns(a).total_cmp(&Self::expected_unknowns(b)));
        for SearchedScheme { scheme, tried } in found {
            if !by_modes(scheme) || matches!(tried, Err(NoGrid::Failed(_))) {
                continue;
            }
            // A failed second search does not replace the result of the first.
            let more = self.search_grid(*scheme, FOR_GRIDS)?;
            if more.is_ok() {
                *tried = more;
            }
            if !self.misses_accuracy(tried) {
                break;
            }
        }
        Ok(())
    }

    /// The grids of `found`; schemes without one are left out, with the reason.
    ///
    /// # Errors
    /// The last error, if there is no grid at all.
    fn reached_grids(&mut self, found: Vec<SearchedScheme>) -> Result<Vec<ReachedGrid>> {
        let (mut grids, mut failure, schemes) = (Vec::new(), None, found.len());
        for SearchedScheme { scheme, tried } in found {
            let name = self.name(Method::Classical, scheme);
            match tried {
                Ok(reached) => grids.push(reached),
                Err(NoGrid::BudgetTooSmall(start)) => {
                    let grid = shape_text(&start);
                    // Each scheme has at least an equal share.
                    let updates = self.trials.updates_to_try(scheme, &start);
                    let part = FOR_GRIDS / schemes as f64;
                    let budget = Budget::seconds_for(updates.unwrap_or(f64::INFINITY), part);
                    let budget = longer(budget.max(2.0 * self.request.budget));
                    let why =
                        format!("the budget does not hold a run on {grid}; {budget} may allow it");
                    self.left_out.push(SkippedSetup::new(name, why));
                }
                Err(NoGrid::Failed(error)) => {
                    self.left_out.push(SkippedSetup::new(name, &error));
                    failure = Some(error);
                }
            }
        }
        if grids.is_empty() {
            Err(failure.unwrap_or_else(|| Error::Input("nothing to try".to_owned())))
        } else {
            Ok(grids)
        }
    }

    /// The coarsest grid of `scheme` that reaches the accuracy, within this part of the budget.
    /// Collective.
    fn search_grid(&mut self, scheme: SchemeChoice, share: f64) -> Result<SearchResult> {
        let start = self.start(scheme);
        if self.trials.affords(scheme, &start, share)? {
            Ok(self.coarsest(scheme, balanced(&start), share).map_err(NoGrid::Failed))
        } else {
            Ok(Err(NoGrid::BudgetTooSmall(start)))
        }
    }

    /// The coarsest grid of `scheme` that reaches the accuracy, searched from `start` on up to this
    /// part of the budget. Collective.
    pub(super) fn coarsest(
        &mut self,
        scheme: SchemeChoice,
        start: SearchStart<'_>,
        share: f64,
    ) -> Result<ReachedGrid> {
        let goal = SearchGoal { accuracy: self.request.accuracy, share };
        GridSearch::new(&mut self.trials, scheme, goal).coarsest(start)
    }

    /// Unknowns of the grid that is expected to reach the accuracy.
    fn expected_unknowns(searched: &SearchedScheme) -> f64 {
        let Ok(reached) = &searched.tried else { return f64::INFINITY };
        let nodes = (searched.scheme.degree + 1) as f64;
        cells(&reached.shape) * nodes.powi(reached.shape.len() as i32)
    }

    /// Whether no grid that was tried reaches the accuracy.
    fn misses_accuracy(&self, tried: &SearchResult) -> bool {
        let Ok(reached) = tried else { return true };
        let wanted = DISCRETISATION * self.request.accuracy * (1.0 + ROUND_OFF);
        reached.known == Evidence::Extrapolated || reached.error > wanted
    }
}
