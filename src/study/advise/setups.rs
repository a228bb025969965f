//! The result of `advise`: set-ups, each with its grid, its error and the evidence for it, its cost
//! and its command.

use crate::base::text::{counted, seconds_text};
use crate::problem::case::{Interface, Limiter, Method};
use crate::study::advise::reached_grid::{Evidence, MeasuredGrid};
use crate::study::advise::trials::UPDATES_PER_MODE;
use crate::study::budget::longer;
use crate::study::cost::application_weight;
use crate::study::grids::shape_text;
use crate::study::order::{Order, orders_text};
use serde::{Serialize, Serializer};
use std::fmt;

/// A run that is expected to take more than this multiple of the budget of its trials is refused.
const TOO_LONG: f64 = 1000.0;

/// Parts of the relative L1 error of the density.
#[derive(Clone, Debug, Default, PartialEq, Serialize)]
pub struct ErrorParts {
    /// Discretisation in space and velocity together.
    pub discretisation: f64,
    /// Discretisation in space, if the two were measured apart.
    pub space: Option<f64>,
    /// Discretisation in velocity, if space and velocity were measured apart.
    pub velocity: Option<f64>,
    /// Schrödingerization: the larger of the error measured on a coarse grid and the bound by the
    /// tolerance.
    pub schrodingerization: Option<f64>,
    /// Time step of an implicit propagator.
    pub step: Option<f64>,
    /// Readout of all cells to `readout.accuracy`.
    pub readout: Option<f64>,
}

impl ErrorParts {
    /// An error of the discretisation alone, with the parts of space and velocity if that of space
    /// is known.
    pub fn of_discretisation(error: f64, part_of_space: Option<f64>) -> Self {
        Self {
            discretisation: error,
            space: part_of_space.map(|part| error * part),
            velocity: part_of_space.map(|part| error * (1.0 - part)),
            ..Self::default()
        }
    }
}

/// A set-up on the coarsest grid that reaches the accuracy.
#[derive(Clone, Debug, Default, PartialEq, Serialize)]
pub struct SetupReport {
    /// Name of method and scheme.
    pub name: String,
    /// Schrödingerized or classical.
    pub method: Method,
    /// Interface law.
    pub interface: Interface,
    /// Slope limiter.
    pub limiter: Limiter,
    /// Degree of the elements.
    pub degree: usize,
    /// Flux parameter `α` between elements; the upwind scheme of degree 0 has none.
    pub flux: Option<f64>,
    /// Elements along each axis; of degree 0 cells.
    pub shape: Vec<usize>,
    /// Number of unknowns.
    pub cells: f64,
    /// Number of unknowns that are computed, after the reduction of the case.
    pub computed_cells: f64,
    /// `solver.tolerance`.
    pub tolerance: Option<f64>,
    /// Relative L1 error of the density.
    pub error: f64,
    /// The evidence for the error.
    pub known: Evidence,
    /// Parts of the error.
    pub parts: ErrorParts,
    /// Order by pairs of grids.
    pub order: Order,
    /// The grids that show the order.
    #[serde(rename = "levels")]
    pub grids: Vec<MeasuredGrid>,
    /// Space axes, counted from 0, along which no grid nearby has faces at all edges of `V`.
    pub moved_edges: Vec<usize>,
    /// Applications of a mode's Hamiltonian, or of `A`.
    pub applications: f64,
    /// Planned memory of a rank, in bytes.
    pub memory_bytes_per_rank: f64,
    /// Seconds of a run on the ranks that ran the study, or of its counted work on one core.
    pub seconds: Option<f64>,
    /// Whether the seconds were measured on this grid; otherwise they are predicted from trials or
    /// counted.
    pub seconds_measured: bool,
    /// Whether the seconds are those of counted work.
    pub seconds_counted: bool,
    /// The budget in seconds that may hold the next grid of its sequence, if its order is assumed
    /// or is from one pair of errors.
    pub wanted_budget: Option<f64>,
    /// The reason why the set-up is refused; `None` if it can be run.
    pub refused: Option<String>,
    /// The reason why the set-up is only an estimate; `None` if it is advice.
    pub estimate: Option<String>,
    /// `--set` options that turn the case into this set-up.
    pub settings: Vec<String>,
    /// The command that runs the set-up, to be pasted into a shell.
    pub command: String,
}

impl SetupReport {
    /// The reason why the set-up takes too long to be run after trials of `budget` seconds: more
    /// than 1000 times as long.
    pub fn too_long(&self, budget: f64) -> Option<String> {
        let seconds = self.seconds.filter(|seconds| *seconds > TOO_LONG * budget)?;
        Some(format!(
            "the cheapest set-up found takes about {}, more than {TOO_LONG} times the --budget of \
             {budget} s; a longer --budget may find a cheaper one. To run this one: {}",
            seconds_text(seconds),
            self.command
        ))
    }

    /// Work of a run: updates of unknowns, the same on every machine.
    pub fn work(&self) -> f64 {
        let each = application_weight(self.degree, self.limiter);
        self.applications * self.computed_cells * each
    }

    /// Updates that a run counts as, in the units of the budget.
    pub fn updates(&self) -> f64 {
        match self.method {
            Method::Schrodingerized => UPDATES_PER_MODE * self.work(),
            Method::Classical => self.work(),
        }
    }

    /// Whether, without the exact solution, one of the last two refinements more than doubled an
    /// error to one above that of the set-up: a grid missed what a finer one sees, and the orders
    /// say nothing about others.
    fn is_erratic(&self) -> bool {
        let last = &self.grids[self.grids.len().saturating_sub(3)..];
        let grows = |pair: &[MeasuredGrid]| {
            let [before, after] = [&pair[0], &pair[1]].map(|grid| grid.error);
            after > GROWTH * before && after > self.error.max(ROUND_OFF)
        };
        self.known != Evidence::Measured && last.windows(2).any(grows)
    }

    /// First words of the reason of a refusal, if the grid is extrapolated by an order that has not
    /// settled: a longer budget may find a smaller grid. Empty otherwise.
    pub fn not_settled_yet(&self) -> String {
        if self.known == Evidence::Extrapolated && !self.order.settled {
            let budget = longer(self.wanted_budget.unwrap_or(f64::INFINITY));
            format!("not settled yet, {budget} may settle it; by the orders found so far ")
        } else {
            String::new()
        }
    }

    /// The reason why the set-up is only an estimate, if it is: its order is from one pair of
    /// grids, errors grew on finer grids, or it takes more than `longest` seconds.
    pub fn not_settled(&self, longest: f64) -> Option<String> {
        let open = "not settled within this budget; ";
        if self.refused.is_some() {
            None
        } else if self.known == Evidence::Extrapolated && self.order.pairs.len() < 2 {
            let budget = self.wanted_budget.unwrap_or(f64::INFINITY);
            Some(format!("{open}{} holds its next grid and may settle it", longer(budget)))
        } else if self.is_erratic() {
            let budget = longer(self.wanted_budget.unwrap_or(f64::INFINITY));
            Some(format!(
                "{open}the density changes more than twice as much from one of its last grids to \
                 the next as before, so that not all of them resolve it (orders {}); {budget} may \
                 settle it",
                orders_text(&self.order.pairs)
            ))
        } else if self.seconds.is_some_and(|seconds| seconds > longest) {
            Some(format!(
                "{open}it is expected to take more than 30 days on these ranks; a longer --budget, \
                 or [exact], may find another"
            ))
        } else {
            None
        }
    }
}

/// Errors that grow by more than this factor from a grid to one twice as fine are no order.
const GROWTH: f64 = 2.0;
/// Errors of a density below this may be round-off.
const ROUND_OFF: f64 = 1e-10;
/// An extrapolated set-up whose order has not settled, or which takes longer than the budget, is
/// only an estimate if it takes more than this many times the work of another set-up.
const MOST_WORK_RATIO: f64 = 100.0;

/// The set-up that the least budget may settle, of those that a longer one may.
pub fn nearest<'e>(entries: &[&'e SetupReport]) -> Option<&'e SetupReport> {
    let wanted = |entry: &SetupReport| entry.wanted_budget.unwrap_or(f64::INFINITY);
    let open = entries.iter().copied().filter(|entry| wanted(entry).is_finite());
    open.min_by(|a, b| wanted(a).total_cmp(&wanted(b)))
}

/// Set-ups whose grids show no order yet.
#[derive(Clone, Copy, Debug)]
pub struct NotCompared {
    /// Number of set-ups.
    pub count: usize,
    /// The least budget in seconds that may hold the next grid of one.
    pub budget: f64,
}

impl NotCompared {
    /// The set-ups of `entries` that show no order yet; `None` if there is none.
    pub fn of(entries: &[SetupReport]) -> Option<Self> {
        let open = entries.iter().filter(|entry| entry.order.pairs.is_empty());
        let wanted = open.filter_map(|entry| entry.wanted_budget);
        Some(Self { count: wanted.clone().count(), budget: wanted.reduce(f64::min)? })
    }

    /// The number of set-ups, and the budget that may find quicker ones, as `5 set-ups were not
    /// compared: a --budget of about 40 s may find quicker ones`.
    pub fn text(self) -> String {
        let were = counted(self.count, "set-up was", "set-ups were");
        format!("{were} not compared: {} may find quicker ones", longer(self.budget))
    }
}

/// Marks extrapolated set-ups as estimates if they take more than `TOO_LONG` times the `budget`
/// in seconds, and a budget that is shorter than such a run compares others.
pub fn mark_too_long(entries: &mut [SetupReport], budget: f64) {
    let Some(others) = NotCompared::of(entries) else { return };
    let least = others.budget.max(TOO_LONG * budget);
    for entry in entries.iter_mut().filter(|e| e.refused.is_none()) {
        let is_extrapolated = entry.known == Evidence::Extrapolated;
        let seconds = entry.seconds.filter(|seconds| is_extrapolated && *seconds > least);
        if let Some(seconds) = seconds {
            let (time, others) = (seconds_text(seconds), others.text());
            entry.estimate.get_or_insert_with(|| {
                format!("about {time} is more than {TOO_LONG} times the --budget, and {others}")
            });
        }
    }
}

/// Marks extrapolated set-ups as estimates if they take more than `MOST_WORK_RATIO` times the work
/// of another one, and their orders have not settled or they take longer than `budget` seconds. An
/// order that has settled on coarse grids may be far below that of fine ones.
pub fn mark_expensive(entries: &mut [SetupReport], budget: f64) {
    let possible = entries.iter().filter(|e| e.refused.is_none() && !e.is_erratic());
    let Some(least) = possible.min_by(|a, b| a.work().total_cmp(&b.work())) else { return };
    let (name, least) = (least.name.clone(), least.work());
    for entry in entries {
        let is_long = entry.seconds.is_some_and(|seconds| seconds > budget);
        let open = entry.known == Evidence::Extrapolated && (is_long || !entry.order.settled);
        if open && entry.refused.is_none() && entry.work() > MOST_WORK_RATIO * least {
            entry.estimate.get_or_insert_with(|| {
                format!(
                    "not settled within this budget; {name} may take less than a hundredth of its \
                     work: a longer --budget may decide"
                )
            });
        }
    }
}

/// The case as its file has it.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct GivenCase {
    /// Degree of the elements.
    pub degree: usize,
    /// Elements along each axis; of degree 0 cells.
    pub shape: Vec<usize>,
    /// Relative L1 error of the density, all parts together.
    pub error: f64,
    /// The evidence for the error of the discretisation.
    pub known: Evidence,
    /// Parts of the error.
    pub parts: ErrorParts,
}

/// A set-up that was not tried. In text and in JSON one line says so.
#[derive(Clone, Debug, PartialEq)]
pub struct SkippedSetup {
    /// The name of the set-up, or of several.
    pub name: String,
    /// The grid on which its runs by modes failed; `None` if no grid was searched for them.
    pub grid: Option<Vec<usize>>,
    /// The reason.
    pub why: String,
}

impl SkippedSetup {
    /// The set-up of this name, for the reason `why`.
    pub fn new(name: impl Into<String>, why: impl ToString) -> Self {
        Self { name: name.into(), grid: None, why: why.to_string() }
    }
}

impl fmt::Display for SkippedSetup {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let Self { name, grid, why } = self;
        match grid {
            Some(shape) => write!(f, "{name} on {}: {why}", shape_text(shape)),
            None => write!(f, "{name}: {why}"),
        }
    }
}

impl Serialize for SkippedSetup {
    fn serialize<S: Serializer>(&self, serializer: S) -> Result<S::Ok, S::Error> {
        serializer.collect_str(self)
    }
}

/// The result of `phasewarp advise`.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct AdviceReport {
    /// Title of the case.
    pub title: String,
    /// Relative L1 error of the density that was asked for.
    pub accuracy: f64,
    /// Number of ranks that seconds and memory are for.
    pub ranks: usize,
    /// Whether errors are against the exact solution; otherwise they are Richardson's estimates.
    pub exact: bool,
    /// The case as its file has it, if its error could be estimated.
    pub given: Option<GivenCase>,
    /// Index in `entries` of the Schrödingerized set-up of least work that is no estimate.
    pub best: Option<usize>,
    /// Index in `entries` of the classical set-up of least work that is no estimate.
    pub best_classical: Option<usize>,
    /// The set-ups that reach the accuracy, quickest first; then those that are refused.
    pub entries: Vec<SetupReport>,
    /// The set-ups that were not tried.
    pub left_out: Vec<SkippedSetup>,
    /// Warnings to the user.
    pub warnings: Vec<String>,
}

impl AdviceReport {
    /// The set-up of least work by `method`, if one is advised.
    pub fn best_of(&self, method: Method) -> Option<&SetupReport> {
        let best = match method {
            Method::Schrodingerized => self.best,
            Method::Classical => self.best_classical,
        };
        best.and_then(|k| self.entries.get(k))
    }

    /// The reason why no set-up by `method` is advised: of the one that the least longer budget may
    /// settle, or else of the quickest.
    pub fn why_nothing(&self, method: Method) -> String {
        let of_method: Vec<&SetupReport> =
            self.entries.iter().filter(|e| e.method == method).collect();
        let first = nearest(&of_method).or_else(|| of_method.first().copied());
        let why = first.and_then(|e| e.estimate.clone().or_else(|| e.refused.clone()));
        let left_out =
            || self.left_out.iter().map(SkippedSetup::to_string).collect::<Vec<_>>().join("; ");
        why.unwrap_or_else(|| format!("nothing was tried; {}", left_out()))
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::study::advise::report::may_be_slow;

    /// A set-up that takes longer than the budget is named, if others were not compared.
    #[test]
    fn a_slow_set_up_may_not_be_the_quickest() {
        let best = SetupReport { seconds: Some(100.0), ..entry(1.0, true) };
        let [other, far] = [120.0, f64::INFINITY].map(without_order);
        assert_eq!(may_be_slow(&best, &[entry(1.0, true)], 60.0), None);
        assert_eq!(may_be_slow(&best, std::slice::from_ref(&other), 200.0), None);
        let words = may_be_slow(&best, &[far.clone(), other], 60.0).expect("a warning");
        assert!(words.contains("2 set-ups were") && words.contains("of about 120 s"), "{words}");
        let words = may_be_slow(&best, &[far], 60.0).expect("a warning");
        assert!(words.contains("a longer --budget"), "{words}");
    }

    /// A set-up whose grids show no order, the next one of which takes this budget.
    fn without_order(budget: f64) -> SetupReport {
        let refused = Some("the budget does not hold two grids to compare".to_owned());
        let order = Order::default();
        SetupReport { wanted_budget: Some(budget), refused, order, ..entry(1.0, true) }
    }

    /// A run of a thousand budgets is no advice if a shorter budget compares other set-ups.
    #[test]
    fn set_ups_that_take_far_longer_than_comparing_others_are_estimates() {
        let doubted = |known: Evidence, seconds: f64, wanted: &[f64]| {
            let mut entries =
                vec![SetupReport { known, seconds: Some(seconds), ..entry(1.0, true) }];
            entries.extend(wanted.iter().map(|&budget| without_order(budget)));
            mark_too_long(&mut entries, 20.0);
            entries.swap_remove(0).estimate
        };
        let why = doubted(Evidence::Extrapolated, 1.2e6, &[4e4, 40.0]).expect("an estimate");
        assert!(why.contains("2 set-ups were") && why.contains("about 40 s"), "{why}");
        assert_eq!(doubted(Evidence::Extrapolated, 1.9e4, &[40.0]), None);
        assert_eq!(doubted(Evidence::Extrapolated, 1.2e6, &[2e6]), None);
        assert_eq!(doubted(Evidence::Extrapolated, 1.2e6, &[]), None);
        assert_eq!(doubted(Evidence::Estimated, 1.2e6, &[40.0]), None);
    }

    /// The reason names the least budget of all set-ups that a longer one may settle.
    #[test]
    fn the_least_budget_is_named() {
        let [far, near, never] = [4e4, 40.0, f64::INFINITY].map(without_order);
        let all = [&far, &near, &never];
        assert_eq!(nearest(&all).and_then(|entry| entry.wanted_budget), Some(40.0));
        assert!(nearest(&all[2..]).is_none());
        let order = Order { pairs: vec![1.6], ..Order::default() };
        let open = SetupReport { wanted_budget: Some(61.3), order, ..entry(1.0, true) };
        let why = open.not_settled(1e9).expect("an estimate");
        assert!(why.contains("a --budget of about 62 s holds its next grid"), "{why}");
    }

    /// Errors that grow on a finer grid are no order, unless they are small or measured.
    #[test]
    fn a_grid_that_missed_something_is_no_advice() {
        let of = |known: Evidence, errors: &[f64]| {
            let grids = errors.iter().map(|&error| MeasuredGrid { shape: vec![4, 4], error });
            SetupReport { known, grids: grids.collect(), error: 1e-3, ..entry(1.0, true) }
        };
        for known in [Evidence::Extrapolated, Evidence::Estimated] {
            for errors in [&[0.01, 0.17, 0.002][..], &[0.3, 0.1, 0.21], &[0.5, 0.01, 0.17, 0.1]] {
                let why = of(known, errors).not_settled(1e9).expect("an estimate");
                assert!(why.contains("more than twice as much"), "{errors:?}: {why}");
            }
        }
        assert_eq!(of(Evidence::Measured, &[0.01, 0.17, 0.002]).not_settled(1e9), None);
        for errors in [&[0.11, 0.12, 0.06][..], &[0.01, 0.2, 0.1, 0.05], &[0.0, 1e-16, 5e-16]] {
            assert_eq!(of(Evidence::Extrapolated, errors).not_settled(1e9), None, "{errors:?}");
        }
        // Nor is it the reason why another set-up is none.
        let wrong = of(Evidence::Estimated, &[0.01, 0.17, 0.002]);
        let dear = SetupReport { seconds: Some(100.0), ..entry(1e4, false) };
        let mut entries = vec![wrong, dear];
        mark_expensive(&mut entries, 8.0);
        assert_eq!(entries[1].estimate, None);
    }

    /// A set-up of `applications` applications, extrapolated by an order that is `settled` or not.
    fn entry(applications: f64, settled: bool) -> SetupReport {
        let order = Order { pairs: vec![0.6, 1.1], order: 0.85, counted_on: 0.6, settled };
        SetupReport {
            name: format!("{applications}"),
            method: Method::Classical,
            interface: Interface::Conservative,
            limiter: Limiter::None,
            shape: vec![10, 10],
            cells: 100.0,
            computed_cells: 100.0,
            error: 0.01,
            known: Evidence::Extrapolated,
            parts: ErrorParts::of_discretisation(0.01, Some(0.5)),
            order,
            applications,
            ..SetupReport::default()
        }
    }

    /// A run of days after trials of seconds is not begun; the command that begins it is named.
    #[test]
    fn runs_far_beyond_the_budget_are_too_long() {
        let of = |seconds: Option<f64>| {
            let command = "phasewarp run a.toml --set b=1".to_owned();
            SetupReport { seconds, command, ..entry(1.0, true) }.too_long(4.0)
        };
        assert_eq!(of(None), None);
        assert_eq!(of(Some(4000.0)), None);
        let why = of(Some(90_000.0)).expect("too long");
        let parts =
            ["25:00:00", "1000 times the --budget of 4 s", "phasewarp run a.toml --set b=1"];
        assert!(parts.iter().all(|part| why.contains(part)), "{why}");
    }

    #[test]
    fn set_ups_of_far_more_work_than_another_are_estimates() {
        let mut entries = [
            entry(1.0, false),
            entry(99.0, false),
            entry(101.0, false),
            SetupReport { seconds: Some(8.0), ..entry(1e6, true) },
            SetupReport { known: Evidence::Estimated, ..entry(1e6, false) },
            SetupReport { refused: Some("no".into()), ..entry(1e-6, false) },
            SetupReport { seconds: Some(8.1), ..entry(1e6, true) },
        ];
        mark_expensive(&mut entries, 8.0);
        let doubted = entries.each_ref().map(|e| e.estimate.is_some());
        assert_eq!(doubted, [false, false, true, false, false, false, true]);
        assert!(entries[2].estimate.as_deref().is_some_and(|why| why.contains("; 1 may take")));
    }
}
