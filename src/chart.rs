//! `phasewarp chart`: accuracy against cost, method by method.
//!
//! The methods are run on one case over a range of their knobs ([`programme`]), within a budget of time: breadth first, each trial
//! only where what it will take fits ([`forecast`]). Rank 0's clock decides, for all. What ran, what was refused and what was left out are the
//! [`Entry`]s; from them follow Pareto fronts ([`front`]), the sentences that say which method to take ([`verdict`]), files ([`files`])
//! and the picture ([`picture`]).
//!
//! Two errors are told apart: the distance to the exact solution, where one is named, which is mostly the grid's; and the distance to the exact
//! solution of the semi-discrete system, which is the method's own.

pub mod entry;
pub mod files;
mod forecast;
pub mod front;
pub mod knobs;
mod picture;
mod programme;
#[cfg(test)]
mod tests;
pub mod verdict;

pub use entry::{Entry, Status};

use crate::advise::grids::Grids;
use crate::case::{Case, Method};
use crate::communicator::{Group, World};
use crate::error::{Error, Result};
use crate::grid::PhaseSpace;
use crate::plan::{Bounds, Resources};
use crate::potential::overlooked;
use crate::reduce::reduced;
use crate::run::trial::{Trial, trial};
use crate::run::{Assembled, memory_per_rank, refuse_hopeless_here};
use forecast::Forecast;
use front::front;
use knobs::{Setup, grid_name, refused};
use programme::{Programme, Setting};
use serde::Serialize;
use std::time::{Duration, Instant};

/// No trial takes more of the budget than this, so that there is breadth, and one that takes longer than expected does little harm.
const LARGEST_PART: f64 = 0.125;
/// A trial is begun where so many times what it is expected to take is left.
const MARGIN: f64 = 1.3;
/// Methods are compared on the finest grid where all profiles' first trials take no more of the budget than this together.
const COMPARED: f64 = 0.1;
/// A trial that takes no more of the budget than this is run so often: a few milliseconds are noisy.
const QUICK: f64 = 5e-4;
const REPEATS: usize = 3;
/// What telling how long trials will take may take of the budget.
const FORECASTING: f64 = 0.1;

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
        let mut work = Work {
            world,
            all: world.group(),
            case,
            jumps,
            budget: budget.as_secs_f64(),
            started: Instant::now(),
            forecasting: 0.0,
            forecast: Forecast::default(),
            seen: Vec::new(),
            entries: Vec::new(),
            first_error: None,
        };
        work.through(programme.every_method());
        let own = programme.every_grid();
        // The case's own grid first: the others tell less.
        let (mine, others): (Vec<Setting>, Vec<Setting>) =
            own.into_iter().partition(|(space, _)| *space == case.space);
        work.through(mine);
        let compared = work.comparable(&programme);
        work.through(programme.every_knob(&compared));
        work.through(others);
        work.through(programme.everything(&compared));
        work.finish(&compared)
    }
}

/// The chart while it is made.
struct Work<'a> {
    world: &'a World,
    all: Group,
    case: &'a Case,
    /// Whether `V` does.
    jumps: bool,
    /// Seconds.
    budget: f64,
    started: Instant,
    /// Seconds that forecasts took.
    forecasting: f64,
    forecast: Forecast,
    seen: Vec<Setting>,
    entries: Vec<Entry>,
    first_error: Option<Error>,
}

impl Work<'_> {
    /// Rank 0's number.
    fn told(&self, number: f64) -> f64 {
        let mine = if self.all.rank() == 0 {
            number
        } else {
            f64::NEG_INFINITY
        };
        self.all.max(mine)
    }

    /// Seconds since the beginning, rank 0's. Collective.
    fn elapsed(&self) -> f64 {
        self.told(self.started.elapsed().as_secs_f64())
    }

    /// Whether `seconds` more fit, of a trial. The very first always does.
    fn fits(&self, seconds: f64, elapsed: f64) -> bool {
        let anything = self.entries.iter().any(|e| e.status == Status::Done);
        !anything
            || (seconds <= LARGEST_PART * self.budget && elapsed + MARGIN * seconds <= self.budget)
    }

    /// Tries `settings` in order, each once. Collective.
    fn through(&mut self, settings: Vec<Setting>) {
        for setting in settings {
            if !self.seen.contains(&setting) {
                let entry = self.attempt(&setting);
                self.entries.push(entry);
                self.seen.push(setting);
            }
        }
    }

    /// One setting: run, refused or left out. Collective.
    fn attempt(&mut self, (space, setup): &Setting) -> Entry {
        let mut case = setup.settle(self.case, space, None);
        let jumps = self.jumps;
        let label = |case: &Case, status| Entry {
            as_given: *setup == Setup::Given,
            paper: matches!(setup, Setup::Paper { .. }),
            no_jump: !jumps,
            ..Entry::of(case, status)
        };
        let refusal = |case: &Case, reason: String| Entry {
            reason: Some(reason),
            ..label(case, Status::Refused)
        };
        if let Some(why) = refused(&case) {
            return refusal(&case, why.to_owned());
        }
        // What runs has no more cells than the scene needs.
        let mut needed = match reduced(&self.all, &case) {
            Ok(needed) => needed,
            Err(error) => return refusal(&case, error.to_string()),
        };
        let elapsed = self.elapsed();
        let left_out = |case: &Case, seconds: f64| Entry {
            expected_seconds: Some(seconds),
            ..label(case, Status::LeftOut)
        };
        // What can be told without a plan.
        let least = self.told(self.forecast.overhead(&needed));
        let hopeless = setup.needs_bounds()
            || least > LARGEST_PART * self.budget
            || self.forecasting > FORECASTING * self.budget;
        if hopeless && !self.fits(least, elapsed) {
            return left_out(&case, least);
        }
        if setup.needs_bounds() {
            match self.measured(&needed) {
                Ok(bounds) => case = setup.settle(self.case, space, Some(&bounds)),
                Err(error) => return refusal(&case, error.to_string()),
            }
            needed.warp = case.warp;
        }
        let began = Instant::now();
        let work = self.all.agree(self.forecast.work(&needed));
        self.forecasting += self.told(began.elapsed().as_secs_f64());
        let seconds = match &work {
            Ok(work) => self.told(self.forecast.seconds(&needed, *work)),
            Err(_) => f64::NAN,
        };
        match work {
            Ok(_) if !self.fits(seconds, elapsed) => return left_out(&case, seconds),
            Err(error) if self.forecast.knows(&needed) => return refusal(&case, error.to_string()),
            _ => {}
        }
        match self.timed(&needed) {
            Ok((trial, [seconds, solve, total])) => {
                (self.forecast).learn(&needed, &trial.plan, [solve, total]);
                let Entry {
                    as_given,
                    paper,
                    no_jump,
                    ..
                } = label(&case, Status::Done);
                Entry {
                    as_given,
                    paper,
                    no_jump,
                    ..Entry::done(&case, &trial, [seconds, total])
                }
            }
            Err(error) => {
                let entry = refusal(&case, error.to_string());
                self.first_error.get_or_insert(error);
                entry
            }
        }
    }

    /// A trial, and its seconds for the result, to solve and in all: of a quick one the least of a few. Collective.
    fn timed(&self, case: &Case) -> Result<(Trial, [f64; 3])> {
        let once = || -> Result<(Trial, [f64; 3])> {
            let began = Instant::now();
            let trial = trial(self.world, case)?;
            let seconds = [
                trial.seconds,
                trial.summary.solve_seconds,
                began.elapsed().as_secs_f64(),
            ];
            Ok((trial, seconds.map(|s| self.told(s))))
        };
        let (trial, mut least) = once()?;
        for _ in 1..REPEATS {
            if least[2] > QUICK * self.budget {
                break;
            }
            let (_, again) = once()?;
            least = std::array::from_fn(|k| least[k].min(again[k]));
        }
        Ok((trial, least))
    }

    /// Bounds of the case's matrix, measured where they must be. Collective.
    fn measured(&self, case: &Case) -> Result<Bounds> {
        refuse_hopeless_here(self.world, case)?;
        let here = Resources {
            ranks: self.all.size(),
            ranks_x: None,
            memory_per_rank: Some(memory_per_rank(&self.all)),
        };
        let found = Assembled::new(self.world, case, &Bounds::new(case)?, (&here, 1))?;
        Ok(found.bounds)
    }

    /// The finest grid, up to the case's own, where comparing methods is affordable. Collective.
    fn comparable(&mut self, programme: &Programme) -> PhaseSpace {
        let together = |work: &Self, space: &PhaseSpace| {
            let seconds = |(space, setup): &Setting| {
                let case = reduced(&work.all, &setup.settle(work.case, space, None));
                let foretold = |case: Case| {
                    let much = work.forecast.work(&case)?;
                    Ok::<f64, Error>(work.forecast.seconds(&case, much))
                };
                match case.and_then(foretold) {
                    Ok(seconds) => seconds,
                    // It is refused, and costs nothing.
                    Err(_) => 0.0,
                }
            };
            let all: f64 = programme.profiles(space).iter().map(seconds).sum();
            work.told(all)
        };
        let candidates = &programme.grids[..=programme.own];
        let affordable =
            (candidates.iter().rev()).find(|space| together(self, space) <= COMPARED * self.budget);
        affordable.unwrap_or(&candidates[0]).clone()
    }

    /// Fronts and sentences.
    fn finish(mut self, compared: &PhaseSpace) -> Result<Chart> {
        if !self.entries.iter().any(|e| e.status == Status::Done)
            && let Some(error) = self.first_error
        {
            return Err(error);
        }
        mark_fronts(&mut self.entries);
        let (all, case) = (&self.all, self.case);
        let compared_on = grid_name(compared);
        let mut chart = Chart {
            title: match case.title.is_empty() {
                true => case.name.clone(),
                false => case.title.clone(),
            },
            version: env!("CARGO_PKG_VERSION").to_owned(),
            git: crate::output::provenance::GIT.to_owned(),
            ranks: all.size(),
            budget_seconds: self.budget,
            took_seconds: self.elapsed(),
            exact: (case.exact.as_ref()).map(|_| match case.fields.len() {
                1 => "f".to_owned(),
                _ => "density".to_owned(),
            }),
            grid: grid_name(&case.space),
            compared_on,
            sentences: Vec::new(),
            entries: self.entries,
        };
        chart.sentences = verdict::sentences(&chart);
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
