//! What is advised: set-ups, each with its grid, its error and how that is known, its cost and its
//! command.

use crate::problem::case::{Interface, Limiter, Method};
use crate::study::advise::order::Order;
use crate::study::advise::reach::{Known, Level};
use crate::study::advise::trials::MODE;
use crate::study::cost::application_weight;
use serde::Serialize;

/// Parts of the error of the density, each relative to it in L1.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct Parts {
    /// Discretisation in space and velocity together.
    pub discretisation: f64,
    /// That in space, where the two were told apart.
    pub space: Option<f64>,
    /// That in velocity.
    pub velocity: Option<f64>,
    /// Schrödingerization, as measured on a coarse grid or guaranteed by the tolerance, whichever
    /// is known and larger.
    pub schrodingerization: Option<f64>,
    /// The step of an implicit propagator.
    pub step: Option<f64>,
    /// What `readout.accuracy` leaves, were all cells read.
    pub readout: Option<f64>,
}

impl Parts {
    /// The error of the discretisation by its two parts, where they are known.
    pub fn of_discretisation(error: f64, part_of_space: Option<f64>) -> Self {
        Self {
            discretisation: error,
            space: part_of_space.map(|part| error * part),
            velocity: part_of_space.map(|part| error * (1.0 - part)),
            schrodingerization: None,
            step: None,
            readout: None,
        }
    }
}

/// A set-up on the coarsest grid that reaches the accuracy.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct Entry {
    /// What it is, in words.
    pub name: String,
    /// Schrödingerized or classical.
    pub method: Method,
    /// Interface rows.
    pub interface: Interface,
    /// Slopes.
    pub limiter: Limiter,
    /// Degree of the elements.
    pub degree: usize,
    /// Flux between them; none of the upwind scheme of degree 0.
    pub flux: Option<f64>,
    /// Elements along each axis; of degree 0 cells.
    pub shape: Vec<usize>,
    /// All unknowns.
    pub cells: f64,
    /// Those that are left to compute on, where the case has more than it needs.
    pub computed_cells: f64,
    /// `solver.tolerance`.
    pub tolerance: Option<f64>,
    /// Relative L1 error of the density.
    pub error: f64,
    /// How it is known.
    pub known: Known,
    /// What it is made of.
    pub parts: Parts,
    /// Order by pairs of grids.
    pub order: Order,
    /// The grids behind it.
    pub levels: Vec<Level>,
    /// Space axes, counted from 0, on which no grid nearby has faces on all edges of `V`.
    pub moved_edges: Vec<usize>,
    /// Applications of a mode's Hamiltonian, or of `A`.
    pub applications: f64,
    /// Planned bytes a rank.
    pub memory_bytes_per_rank: f64,
    /// Seconds on as many ranks as this.
    pub seconds: Option<f64>,
    /// Whether they were measured on this grid, or follow from trials.
    pub seconds_measured: bool,
    /// What forbids it, in words; absent where it can be run.
    pub refused: Option<String>,
    /// Why this is an estimate and no advice, in words; absent where it is advice.
    pub estimate: Option<String>,
    /// What `--set` takes.
    pub settings: Vec<String>,
    /// The whole command.
    pub command: String,
}

impl Entry {
    /// Its work, which no clock counts: updates of unknowns.
    pub fn work(&self) -> f64 {
        let each = application_weight(self.degree, self.limiter) as f64;
        self.applications * self.computed_cells * each
    }

    /// Updates that a run of it counts as in the budget of trials.
    pub fn updates(&self) -> f64 {
        match self.method {
            Method::Schrodingerized => MODE * self.work(),
            Method::Classical => self.work(),
        }
    }

    /// Where the grid follows from orders that are not settled, what begins the reason why it is
    /// not advised: a longer budget may find a smaller one.
    pub fn not_settled_yet(&self) -> &'static str {
        match self.known == Known::Extrapolated && !self.order.settled {
            true => "not settled yet, a longer --budget may settle it; by the orders so far ",
            false => "",
        }
    }

    /// Why it is an estimate and no advice, if it is: from one pair of grids, or of more seconds
    /// than `longest`.
    pub fn not_settled(&self, longest: f64) -> Option<String> {
        let open = "not settled within this budget; ";
        if self.refused.is_some() {
            None
        } else if self.known == Known::Extrapolated && self.order.pairs.len() < 2 {
            Some(format!("{open}a longer --budget may settle it"))
        } else if self.seconds.is_some_and(|seconds| seconds > longest) {
            Some(format!("{open}it is expected to take more than 30 days on these ranks"))
        } else {
            None
        }
    }
}

/// An extrapolated set-up whose order is not settled is no advice where it takes more than so many
/// times the work of another set-up that may do.
const DEAREST: f64 = 100.0;

/// Marks set-ups as estimates whose grids follow from orders that are not settled, and which take
/// far more work than another one.
pub fn doubt_the_dearest(entries: &mut [Entry]) {
    let possible = entries.iter().filter(|e| e.refused.is_none());
    let Some(least) = possible.min_by(|a, b| a.work().total_cmp(&b.work())) else { return };
    let (name, least) = (least.name.clone(), least.work());
    for entry in entries {
        let open = entry.known == Known::Extrapolated && !entry.order.settled;
        if open && entry.refused.is_none() && entry.work() > DEAREST * least {
            entry.estimate.get_or_insert_with(|| {
                format!(
                    "not settled within this budget; {name} may take less than a hundredth of its \
                     work: a longer --budget may decide"
                )
            });
        }
    }
}

/// The case as it stands.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct Given {
    /// Degree of the elements.
    pub degree: usize,
    /// Elements along each axis; of degree 0 cells.
    pub shape: Vec<usize>,
    /// Relative L1 error of the density, all parts together.
    pub error: f64,
    /// How the discretisation's part is known.
    pub known: Known,
    /// What it is made of.
    pub parts: Parts,
}

/// What `phasewarp advise` says.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct Advised {
    /// Title of the case.
    pub title: String,
    /// What was asked for: the relative L1 error of the density.
    pub accuracy: f64,
    /// Ranks that seconds and memory are for.
    pub ranks: usize,
    /// Whether errors are against the exact solution; otherwise they are by Richardson's
    /// extrapolation.
    pub exact: bool,
    /// The case as it stands.
    pub given: Option<Given>,
    /// The Schrödingerized set-up of least work that is no mere estimate, by position in `entries`.
    pub best: Option<usize>,
    /// The same of the classical ones.
    pub best_classical: Option<usize>,
    /// What reaches the accuracy, quickest first; then what cannot be run.
    pub entries: Vec<Entry>,
    /// What was not tried, and why.
    pub left_out: Vec<String>,
    /// What the user should know.
    pub warnings: Vec<String>,
}

impl Advised {
    /// The set-up of least work by `method`, if one is advised.
    pub fn best_of(&self, method: Method) -> Option<&Entry> {
        let best = match method {
            Method::Schrodingerized => self.best,
            Method::Classical => self.best_classical,
        };
        best.and_then(|k| self.entries.get(k))
    }

    /// Why nothing by `method` is advised.
    pub fn why_nothing(&self, method: Method) -> String {
        let mut of_method = self.entries.iter().filter(|e| e.method == method);
        let why = of_method.find_map(|e| e.estimate.clone().or_else(|| e.refused.clone()));
        why.unwrap_or_else(|| format!("nothing was tried; {}", self.left_out.join("; ")))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// A set-up of so many applications, extrapolated by orders that are settled or not.
    fn entry(applications: f64, settled: bool) -> Entry {
        let order = Order { pairs: vec![0.6, 1.1], order: 0.85, counted_on: 0.6, settled };
        Entry {
            name: format!("{applications}"),
            method: Method::Classical,
            interface: Interface::Conservative,
            limiter: Limiter::None,
            degree: 0,
            flux: None,
            shape: vec![10, 10],
            cells: 100.0,
            computed_cells: 100.0,
            tolerance: None,
            error: 0.01,
            known: Known::Extrapolated,
            parts: Parts::of_discretisation(0.01, Some(0.5)),
            order,
            levels: Vec::new(),
            moved_edges: Vec::new(),
            applications,
            memory_bytes_per_rank: 0.0,
            seconds: None,
            seconds_measured: false,
            refused: None,
            estimate: None,
            settings: Vec::new(),
            command: String::new(),
        }
    }

    #[test]
    fn what_is_open_and_far_dearer_than_another_is_an_estimate() {
        let mut entries = [
            entry(1.0, false),
            entry(99.0, false),
            entry(101.0, false),
            entry(1e6, true),
            Entry { known: Known::Estimated, ..entry(1e6, false) },
            Entry { refused: Some("no".into()), ..entry(1e-6, false) },
        ];
        doubt_the_dearest(&mut entries);
        let doubted = entries.each_ref().map(|e| e.estimate.is_some());
        assert_eq!(doubted, [false, false, true, false, false, false]);
        assert!(entries[2].estimate.as_deref().is_some_and(|why| why.contains("; 1 may take")));
    }
}
