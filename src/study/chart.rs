//! `phasewarp chart`: accuracy against cost, method by method.
//!
//! The methods are run on one case over a range of their knobs (`programme`), within a budget of time: breadth first, each trial
//! only where what it will take fits (`forecast`). Rank 0's clock decides, for all. What ran, what was refused and what was left out are the
//! [`Entry`]s; from them follow Pareto fronts (`front`), the sentences that say which method to take (`verdict`), files (`files`)
//! and the picture (`picture`).
//!
//! Two errors are told apart: the distance to the exact solution, where one is named, which is mostly the grid's; and the distance to the exact
//! solution of the semi-discrete system, which is the method's own.

pub mod entry;
pub mod files;
pub mod forecast;
pub mod front;
pub mod knobs;
pub mod picture;
pub mod programme;
pub mod verdict;
pub mod work;

use crate::base::error::{Error, Result};
use crate::base::version::GIT;
use crate::matrix::bounds::Bounds;
use crate::parallel::communicator::World;
use crate::plan::here::refuse_hopeless_here;
use crate::problem::case::{Case, Method};
use crate::problem::grid::PhaseSpace;
use crate::problem::potential::overlooked;
use crate::problem::refine::Grids;
use crate::study::chart::entry::Entry;
use crate::study::chart::front::front;
use crate::study::chart::knobs::{Setup, grid_name};
use crate::study::chart::programme::{Programme, Setting};
use crate::study::chart::work::Work;
use serde::Serialize;
use std::time::Duration;

#[cfg(test)]
mod tests;

/// All trials of a case.
#[derive(Clone, Debug, Serialize)]
pub struct Chart {
    /// Title of the case, or its file's name.
    pub title: String,
    /// Version of the program.
    pub version: String,
    /// The commit it was built from.
    pub git: String,
    /// Number of ranks.
    pub ranks: usize,
    /// Seconds allowed.
    pub budget_seconds: f64,
    /// Seconds taken.
    pub took_seconds: f64,
    /// Whether the exact solution is that of a density (measure-valued data), of `f`, or not known.
    pub exact: Option<String>,
    /// The case's own grid.
    pub grid: String,
    /// The grid on which methods are compared.
    pub compared_on: String,
    /// Why that is not the case's own, where it is not.
    pub compared_why: Option<String>,
    /// Whether the solution is zero, so that nothing is relative to its size.
    pub zero: bool,
    /// Which method to take at which accuracy.
    pub sentences: Vec<String>,
    /// The trials.
    pub entries: Vec<Entry>,
}

impl Chart {
    /// Runs the trials of `case` that fit into `budget`. Collective.
    ///
    /// # Errors
    /// [`Error::Input`] for a case that starts from a warped field; the first trial's error where nothing could be run.
    pub fn new(world: &World, case: &Case, budget: Duration) -> Result<Self> {
        if case.start.is_some() {
            return Err(Error::Input(format!(
                "{}: initial.warped fixes profile, period and N_p, which a chart turns: give initial.f",
                case.name
            )));
        }
        refuse_hopeless_here(world, case)?;
        let jumps = Bounds::new(case)?.jumps;
        let stray = |space: &PhaseSpace| {
            let found = overlooked(&Case {
                space: space.clone(),
                ..case.clone()
            });
            found.edges.len() + found.empty.len()
        };
        let own = stray(&case.space);
        let programme = Programme::new(&case.space, &Grids::new(case), jumps, |space| {
            stray(space) <= own
        });
        let mut work = Work::new(world, case, jumps, budget.as_secs_f64());
        work.through(programme.every_method());
        work.through(vec![(case.space.clone(), Setup::Given)]);
        let own = programme.every_grid();
        // The case's own grid first: the others tell less.
        let (mine, others): (Vec<Setting>, Vec<Setting>) =
            own.into_iter().partition(|(space, _)| *space == case.space);
        work.through(mine);
        // What fails on two grids, whatever the method, fails on all.
        if !work.has_results()
            && let Some(error) = work.first_error
        {
            return Err(error);
        }
        let (compared, compared_why) = work.comparable(&programme);
        work.through(programme.every_knob(&compared));
        work.through(others);
        work.through(programme.everything(&compared));
        let mut chart = Self {
            title: match case.title.is_empty() {
                true => case.name.clone(),
                false => case.title.clone(),
            },
            version: env!("CARGO_PKG_VERSION").to_owned(),
            git: GIT.to_owned(),
            ranks: world.group().size(),
            budget_seconds: budget.as_secs_f64(),
            took_seconds: work.elapsed(),
            exact: (case.exact.as_ref()).map(|_| match case.fields.len() {
                1 => "f".to_owned(),
                _ => "density".to_owned(),
            }),
            grid: grid_name(&case.space),
            compared_on: grid_name(&compared),
            compared_why,
            zero: work.zero == Some(true),
            sentences: Vec::new(),
            entries: work.entries,
        };
        mark_fronts(&mut chart.entries);
        chart.sentences = crate::study::chart::verdict::sentences(&chart);
        Ok(chart)
    }
}

/// Marks what no other trial of its kind beats; errors to the semi-discrete solution only on the same grid.
pub fn mark_fronts(entries: &mut [Entry]) {
    type Point = fn(&Entry) -> Option<[f64; 2]>;
    let semidiscrete: [Point; 3] = [
        |e| Some([e.seconds?, e.error_semidiscrete?]),
        |e| Some([e.applications? as f64, e.error_semidiscrete?]),
        |e| Some([e.until_measured?, e.error_semidiscrete?]),
    ];
    let of = |entries: &[Entry], belongs: &dyn Fn(&Entry) -> bool, point: Point| {
        let points: Vec<_> = (entries.iter())
            .map(|e| belongs(e).then(|| point(e)).flatten())
            .collect();
        front(&points)
    };
    let mut groups: Vec<(Method, String)> = Vec::new();
    for entry in entries.iter() {
        let group = (entry.method, entry.grid.clone());
        if !groups.contains(&group) {
            groups.push(group);
        }
    }
    for (method, grid) in groups {
        let belongs = |e: &Entry| e.method == method && e.grid == grid;
        let [seconds, applications, until] = semidiscrete.map(|p| of(entries, &belongs, p));
        for (i, entry) in entries.iter_mut().enumerate() {
            entry.front_seconds |= seconds[i];
            entry.front_applications |= applications[i];
            entry.front_until_measured |= until[i];
        }
    }
    for method in [Method::Classical, Method::Schrodingerized] {
        let belongs = |e: &Entry| e.method == method;
        let exact = of(entries, &belongs, |e| Some([e.seconds?, e.error_exact?]));
        for (entry, on) in entries.iter_mut().zip(exact) {
            entry.front_exact |= on;
        }
    }
}
