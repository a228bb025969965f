//! The trials of a chart: run, refused or left out, one after the other.
//!
//! Rank 0's clock decides. What is told beforehand follows from numbers that all ranks share, so that a setting that is left out costs two short
//! messages; once the budget is used up, nothing is decided any more, and no rank waits for another.

use crate::base::error::{Error, Result};
use crate::matrix::bounds::Bounds;
use crate::parallel::communicator::{Group, World};
use crate::plan::here::{memory_per_rank, refuse_hopeless_here};
use crate::plan::layout::Resources;
use crate::problem::case::{Case, Limiter, Reductions};
use crate::problem::grid::PhaseSpace;
use crate::run::assembled::Assembled;
use crate::run::trial::{Trial, trial};
use crate::scheme::reduce::reduced;
use crate::study::chart::entry::{Entry, Status};
use crate::study::chart::forecast::Forecast;
use crate::study::chart::knobs::{Setup, refused};
use crate::study::chart::programme::{Programme, Setting};
use crate::study::chart::verdict::time;
use std::time::Instant;

/// No trial takes more of the budget than this, so that there is breadth, and one that takes longer than expected does little harm.
const LARGEST_PART: f64 = 0.125;
/// The case as it is given may take so much.
const GIVEN_PART: f64 = 0.25;
/// A trial is begun where so many times what it is expected to take is left.
const MARGIN: f64 = 1.3;
/// Methods are compared on the finest grid where all profiles' first trials take no more of the budget than this together.
const COMPARED: f64 = 0.1;
/// A trial that takes no more of the budget than this is run so often: a few milliseconds are noisy.
const QUICK: f64 = 5e-4;
const REPEATS: usize = 3;
/// What telling how long trials will take may take of the budget.
const FORECASTING: f64 = 0.1;
/// Seconds a cell takes to find what a scene needs, before that is measured.
const LOOKING: f64 = 1e-7;
/// That is measured where it takes so many seconds.
const MEASURABLE: f64 = 0.01;

/// What rank 0 decides of a setting.
#[derive(Clone, Copy, PartialEq, Eq)]
enum Decision {
    LeaveOut,
    Refuse,
    Run,
}

/// What a scene needs of a grid, by what that depends on.
type Needed = ((Vec<usize>, String), (PhaseSpace, Reductions));

/// The chart while it is made.
pub(crate) struct Work<'a> {
    world: &'a World,
    all: Group,
    case: &'a Case,
    /// Whether `V` does.
    jumps: bool,
    /// Seconds.
    budget: f64,
    started: Instant,
    /// Whether the budget is used up.
    over: bool,
    /// Seconds that forecasts took on this rank.
    forecasting: f64,
    /// Seconds a cell took to find what a scene needs, and of how many cells that is from.
    looking: (f64, usize),
    forecast: Forecast,
    needed: Vec<Needed>,
    seen: Vec<Setting>,
    /// What became of each setting.
    pub entries: Vec<Entry>,
    /// Why the first trial failed that did.
    pub first_error: Option<Error>,
    /// Whether the solution is zero everywhere, once a trial told.
    pub zero: Option<bool>,
}

impl<'a> Work<'a> {
    /// Begins now, for so many seconds.
    pub fn new(world: &'a World, case: &'a Case, jumps: bool, budget: f64) -> Self {
        Self {
            world,
            all: world.group(),
            case,
            jumps,
            budget,
            started: Instant::now(),
            over: false,
            forecasting: 0.0,
            looking: (LOOKING, 0),
            forecast: Forecast::default(),
            needed: Vec::new(),
            seen: Vec::new(),
            entries: Vec::new(),
            first_error: None,
            zero: None,
        }
    }

    /// Whether anything ran.
    pub fn has_results(&self) -> bool {
        self.entries.iter().any(|e| e.status == Status::Done)
    }

    /// Seconds since the beginning, by this rank's clock.
    pub fn elapsed(&self) -> f64 {
        self.started.elapsed().as_secs_f64()
    }

    /// Rank 0's numbers. Collective.
    fn told<const N: usize>(&self, mut numbers: [f64; N]) -> [f64; N] {
        if self.all.rank() > 0 {
            numbers = [f64::NEG_INFINITY; N];
        }
        self.all.max_into(&mut numbers);
        numbers
    }

    /// Rank 0's decision. Collective.
    fn decided(&self, mine: Decision) -> Decision {
        let code = match mine {
            Decision::LeaveOut => 0.0,
            Decision::Refuse => 1.0,
            Decision::Run => 2.0,
        };
        match self.told([code])[0] {
            c if c < 0.5 => Decision::LeaveOut,
            c if c < 1.5 => Decision::Refuse,
            _ => Decision::Run,
        }
    }

    /// Whether `seconds` more fit, of a trial. The very first always does.
    fn fits(&self, setup: &Setup, seconds: f64) -> bool {
        let room = self.elapsed() + MARGIN * seconds <= self.budget;
        let part = match setup {
            Setup::Given => GIVEN_PART,
            _ => LARGEST_PART,
        };
        !self.has_results() || (room && seconds <= part * self.budget)
    }

    /// What `setup` took, or would take, on grids of fewer cells: on `cells` it does not take less.
    fn on_coarser(&self, setup: &Setup, cells: usize) -> f64 {
        let known = self.seen.iter().zip(&self.entries);
        let coarser = known.filter(|((space, other), _)| other == setup && space.cells() < cells);
        coarser
            .filter_map(|(_, e)| e.expected_seconds.or(e.total_seconds))
            .fold(0.0, f64::max)
    }

    /// What a trial takes at least, before it is known how many cells its scene needs: the part of them that it needed on another grid.
    fn least(&self, case: &Case) -> f64 {
        let (_, what) = Self::key(case);
        let cells = case.space.cells() as f64;
        let alike = self
            .needed
            .iter()
            .rev()
            .find(|((_, other), _)| *other == what);
        let part = alike.map_or(1.0, |((shape, _), (space, _))| {
            space.cells() as f64 / shape.iter().product::<usize>() as f64
        });
        self.forecast.overhead(case, part * cells)
    }

    /// Whether there is no time to look for what the scene of `case` needs, or its trial takes too long anyway.
    fn too_late(&self, case: &Case, setup: &Setup, least: f64) -> bool {
        let seconds = self.looking.0 * case.space.cells() as f64;
        // Another look at the coarsest grid is not dear where the first was not, and without it there is no breadth.
        let cells = |((shape, _), _): &Needed| shape.iter().product::<usize>();
        let fewest = self.needed.iter().map(cells).min();
        let larger = fewest.is_some_and(|fewest| case.space.cells() > fewest);
        let spent = larger && self.forecasting + seconds > FORECASTING * self.budget;
        self.has_results() && (spent || !self.fits(setup, least + seconds))
    }

    /// Tries `settings` in order, each once. Collective.
    pub fn through(&mut self, settings: Vec<Setting>) {
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
        let named = |entry: Entry| Entry {
            as_given: *setup == Setup::Given,
            paper: matches!(setup, Setup::Paper { .. }),
            no_jump: !jumps,
            ..entry
        };
        let refusal = |case: &Case, reason: String| Entry {
            reason: Some(reason),
            ..named(Entry::of(case, Status::Refused))
        };
        let coarser = self.on_coarser(setup, space.cells());
        let left_out = |case: &Case, seconds: f64, at_least: bool| Entry {
            expected_seconds: Some(seconds.max(coarser)),
            expected_at_least: at_least || coarser > seconds,
            ..named(Entry::of(case, Status::LeftOut))
        };
        if let Some(why) = refused(&case) {
            return refusal(&case, why.to_owned());
        }
        if !self.over {
            let used_up = self.has_results() && self.elapsed() > self.budget;
            self.over = self.told([f64::from(used_up)])[0] > 0.5;
        }
        if self.over {
            return left_out(&case, self.least(&case), true);
        }
        if self.known(&case).is_none() {
            let least = self.least(&case);
            let late = self.too_late(&case, setup, least);
            if self.told([f64::from(late)])[0] > 0.5 {
                return left_out(&case, least, true);
            }
        }
        // What runs has no more cells than the scene needs.
        let mut needed = match self.needed(&case) {
            Ok(needed) => needed,
            Err(error) => return refusal(&case, self.failed(error)),
        };
        if setup.needs_bounds() {
            let least = self.forecast.overhead(&needed, needed.space.cells() as f64);
            let mine = match self.fits(setup, least) {
                true => Decision::Run,
                false => Decision::LeaveOut,
            };
            if self.decided(mine) != Decision::Run {
                return left_out(&case, least, true);
            }
            match self.measured(&needed) {
                Ok(bounds) => case = setup.settle(self.case, space, Some(&bounds)),
                Err(error) => return refusal(&case, self.failed(error)),
            }
            needed.warp = case.warp;
        }
        let (seconds, at_least, error) = self.expected(&needed);
        let mine = match &error {
            // With what was measured it is the plan's own; else the trial tells.
            Some(_) if self.forecast.knows(&needed) => Decision::Refuse,
            _ if self.fits(setup, seconds) => Decision::Run,
            _ => Decision::LeaveOut,
        };
        match self.decided(mine) {
            Decision::LeaveOut => return left_out(&case, seconds, at_least),
            Decision::Refuse => {
                return refusal(&case, error.map_or(String::new(), |e| e.to_string()));
            }
            Decision::Run => {}
        }
        match self.timed(&needed) {
            Ok((trial, [seconds, solve, total])) => {
                (self.forecast).learn(&needed, &trial.plan, [solve, total]);
                if self.zero.is_none() {
                    let all = trial.fields.iter().flatten();
                    let mut largest = [all.fold(0.0, |largest, f| f64::max(largest, f.abs()))];
                    self.all.max_into(&mut largest);
                    self.zero = Some(largest[0] == 0.0);
                }
                named(Entry::done(&case, &trial, [seconds, total]))
            }
            Err(error) => refusal(&case, self.failed(error)),
        }
    }

    /// The reason for a refusal; the first is kept for when nothing runs.
    fn failed(&mut self, error: Error) -> String {
        let reason = error.to_string();
        self.first_error.get_or_insert(error);
        reason
    }

    /// Seconds that a trial of `case` is expected to take, and why it cannot be planned if it cannot; where there is no time to
    /// plan it, or where it is much too long without its work, what it takes at least, and that it is that.
    fn expected(&mut self, case: &Case) -> (f64, bool, Option<Error>) {
        let least = (self.forecast).overhead(case, case.space.cells() as f64);
        let spent = self.forecasting > FORECASTING * self.budget;
        if self.has_results() && (spent || least > LARGEST_PART * self.budget) {
            return (least, true, None);
        }
        let began = Instant::now();
        let work = self.forecast.work(case);
        self.forecasting += began.elapsed().as_secs_f64();
        match work {
            Ok(work) => (self.forecast.seconds(case, work), false, None),
            Err(error) => (least, true, Some(error)),
        }
    }

    /// What the needs of a scene depend on.
    fn key(case: &Case) -> (Vec<usize>, String) {
        let slopes = case.limiter != Limiter::None;
        let what = format!("{:?} {:?} {slopes}", case.interface, case.method);
        (case.space.shape(), what)
    }

    /// `case` with no more cells than it needs, where that was found before.
    fn known(&self, case: &Case) -> Option<Case> {
        let key = Self::key(case);
        let (_, (space, reductions)) = self.needed.iter().find(|(other, _)| *other == key)?;
        Some(Case {
            space: space.clone(),
            reductions: reductions.clone(),
            ..case.clone()
        })
    }

    /// `case` with no more cells than it needs. Collective.
    fn needed(&mut self, case: &Case) -> Result<Case> {
        if let Some(known) = self.known(case) {
            return Ok(known);
        }
        let began = Instant::now();
        let found = reduced(&self.all, case);
        let took = began.elapsed().as_secs_f64();
        self.forecasting += took;
        let cells = case.space.cells();
        if took > MEASURABLE && cells >= self.looking.1 {
            self.looking = (took / cells as f64, cells);
        }
        let found = found?;
        let found_of = (found.space.clone(), found.reductions.clone());
        self.needed.push((Self::key(case), found_of));
        Ok(found)
    }

    /// A trial, and its seconds for the result, to solve and in all: of a quick one the least of a few. Collective.
    fn timed(&self, case: &Case) -> Result<(Trial, [f64; 3])> {
        let once = || -> Result<(Trial, [f64; 3])> {
            let began = Instant::now();
            let trial = trial(self.world, case)?;
            let solve = trial.summary.solve_seconds;
            let mine = [trial.seconds, solve, began.elapsed().as_secs_f64()];
            Ok((trial, self.told(mine)))
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

    /// The finest grid, up to the case's own, where comparing methods is affordable: that of rank 0; and why it is not the case's own.
    /// Collective.
    pub fn comparable(&mut self, programme: &Programme) -> (PhaseSpace, Option<String>) {
        let candidates = &programme.grids[..=programme.own];
        let mut finest = 0;
        let mut why = None;
        for (k, space) in candidates.iter().enumerate().rev() {
            let dearer = self.too_dear(&programme.profiles(space));
            if dearer.is_none() {
                finest = k;
                break;
            }
            if k == programme.own {
                why = dearer;
            }
        }
        let finest = self.told([finest as f64])[0] as usize;
        let finest = finest.min(programme.own);
        (
            candidates[finest].clone(),
            why.filter(|_| finest < programme.own),
        )
    }

    /// Why these trials are too dear together to compare methods where they are.
    fn too_dear(&mut self, settings: &[Setting]) -> Option<String> {
        let allowed = COMPARED * self.budget;
        if self.elapsed() > self.budget {
            return Some("the budget was used up before it".to_owned());
        }
        let began = Instant::now();
        let (mut sum, mut least) = (0.0, false);
        for (space, setup) in settings {
            let case = setup.settle(self.case, space, None);
            let overhead = self.least(&case);
            if sum + overhead > allowed {
                (sum, least) = (sum + overhead, true);
                break;
            }
            let case = self.known(&case).unwrap_or(case);
            // What is refused costs nothing.
            if let Ok(work) = self.forecast.work(&case) {
                sum += self.forecast.seconds(&case, work);
            }
        }
        self.forecasting += began.elapsed().as_secs_f64();
        (sum > allowed).then(|| {
            format!(
                "a trial of each profile there is expected to take {}{} in all, more than {} of the budget",
                if least { "at least " } else { "" },
                time(sum),
                time(allowed)
            )
        })
    }
}
