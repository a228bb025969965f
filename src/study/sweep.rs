//! `phasewarp sweep`: one run for every combination of values, each in its own directory, and one
//! table of results.
//!
//! A directory is named after its values and a checksum of its case ([`name`]), as in the Python
//! package. So a sweep that was interrupted, or extended by a value, can continue: finished runs
//! are kept, and a run with a checkpoint resumes from it.

pub mod name;
pub mod table;
pub mod vary;

use crate::base::error::{CAN_GO_ON, Error, Result};
use crate::base::log::eprint_wrapped;
use crate::base::machine::{self, RunPart};
use crate::base::memory;
use crate::base::row_major::indices;
use crate::base::text::json_text;
use crate::parallel::communicator::World;
use crate::problem::case::{self, Case, Method};
use crate::results::dataset::RESULT;
use crate::results::{finished, summary};
use crate::run;
use crate::run::options::Options;
use crate::solve::checkpoint::store;
use crate::study::sweep::name::{run_name, with_absolute_paths};
use crate::study::sweep::table::{SweepRow, SweepTable, value_of};
use crate::study::sweep::vary::Vary;
use serde_json::Value;
use std::fmt;
use std::path::PathBuf;
use std::sync::atomic::Ordering;

/// The largest number of runs of a sweep.
const MOST_RUNS: usize = 10_000;

/// The request of the user.
pub struct SweepRequest {
    /// The case file.
    pub path: PathBuf,
    /// Text of the case file.
    pub text: String,
    /// `--set` options.
    pub set: Vec<String>,
    /// `streamed` or `full`; `None` without `--mode`.
    pub mode: Option<&'static str>,
    /// The keys and their values.
    pub vary: Vec<Vary>,
    /// The directory in which the directories of the runs are made.
    pub directory: PathBuf,
}

/// A run of a sweep.
pub struct SweepRun {
    /// Number of the run, from 1.
    pub number: usize,
    /// A value for each key.
    pub values: Vec<Value>,
    /// Directory of the results of the run.
    pub directory: PathBuf,
    /// The reason why the case of the run is refused.
    pub refused: Option<String>,
    /// `--set` options of its case.
    overrides: Vec<String>,
}

impl SweepRun {
    /// The table row of this run, which has ended: its `summary.json`, or null, and its error.
    fn row(&self, summary: Value, error: Option<String>) -> SweepRow {
        let directory = self.directory.display().to_string();
        SweepRow { values: self.values.clone(), directory, ended: true, summary, error }
    }
}

/// All runs, the last key varying fastest.
pub struct Sweep {
    /// The runs.
    pub runs: Vec<SweepRun>,
    /// The request of the user.
    pub request: SweepRequest,
    keys: Vec<String>,
}

/// The result of a sweep, complete or stopped.
pub struct SweepResult {
    /// The runs that were attempted.
    pub table: SweepTable,
    /// The reason why the sweep stopped early; `None` if it is complete.
    pub stopped: Option<Error>,
}

impl Sweep {
    /// All combinations, read but not run.
    ///
    /// # Errors
    /// [`Error::Input`] if a key is varied twice, there are too many runs, two of them are the
    /// same, or no combination is a valid case, as with an unknown key.
    pub fn new(request: SweepRequest) -> Result<Self> {
        let keys: Vec<String> = request.vary.iter().map(|vary| vary.key.clone()).collect();
        if let Some(i) = (1..keys.len()).find(|&i| keys[..i].contains(&keys[i])) {
            return Err(Error::Input(format!("--vary {}: given twice", keys[i])));
        }
        let factors = request.vary.iter().map(|vary| vary.values.len());
        let count = factors.fold(1usize, usize::saturating_mul);
        if count > MOST_RUNS {
            let message = format!("--vary: {count} combinations; at most {MOST_RUNS} expected");
            return Err(Error::Input(message));
        }
        let mut sweep = Self { runs: Vec::new(), request, keys };
        let mut refusals = Vec::new();
        for index in 0..count {
            let mut run = sweep.combination(index)?;
            if let Some(same) = sweep.runs.iter().find(|same| same.directory == run.directory) {
                return Err(Error::Input(format!(
                    "--vary: runs {} and {} are the same, {}",
                    same.number,
                    run.number,
                    sweep.label(&run)
                )));
            }
            if let Err(error) = sweep.case(&run) {
                run.refused = Some(error.to_string());
                refusals.push(error);
            }
            sweep.runs.push(run);
        }
        if refusals.len() == count { Err(refusals.swap_remove(0)) } else { Ok(sweep) }
    }

    /// The run of this index, from 0.
    fn combination(&self, index: usize) -> Result<SweepRun> {
        let SweepRequest { path, text, set, mode, vary, directory } = &self.request;
        let counts: Vec<usize> = vary.iter().map(|vary| vary.values.len()).collect();
        let chosen = vary.iter().zip(indices(index, &counts));
        let chosen = chosen.map(|(Vary { key, values }, k)| format!("{key}={}", values[k]));
        let mut overrides: Vec<String> = set.iter().cloned().chain(chosen).collect();
        let mut tree = case::values(&path.display().to_string(), text, &overrides)?;
        with_absolute_paths(&mut tree, path);
        let values: Vec<Value> = self.keys.iter().map(|key| value_of(&tree, key)).collect();
        let name = run_name(&tree, *mode, &self.keys, &values);
        overrides.extend(mode.map(|mode| format!("output.warped_field={}", mode == "full")));
        let directory = directory.join(name);
        Ok(SweepRun { number: index + 1, values, directory, refused: None, overrides })
    }

    /// The case of a run.
    fn case(&self, run: &SweepRun) -> Result<Case> {
        let case = Case::parse(
            &self.request.path.display().to_string(),
            &self.request.text,
            &run.overrides,
        )?;
        match case.accuracy {
            None => Ok(case),
            Some(accuracy) => Err(Error::Input(format!(
                "{}: solver.accuracy = {accuracy:e} chooses a grid by trials, and a sweep runs the \
                 grids that it is given; leave it out, and take the --set options that `phasewarp \
                 advise` prints",
                case.name
            ))),
        }
    }

    /// `key=value` of a run, for all keys.
    pub fn label(&self, run: &SweepRun) -> String {
        let words = self.keys.iter().zip(&run.values);
        let words: Vec<String> =
            words.map(|(key, value)| format!("{key}={}", json_text(value))).collect();
        words.join(" ")
    }

    /// Solves one run, counted from 1, unless it is finished. Collective.
    ///
    /// # Errors
    /// [`Error::Input`] if there is no such run; [`Error::SweepStopped`]; as [`run::run`].
    pub fn solve_one(&self, world: &World, number: usize, options: &Options) -> Result<()> {
        let Some(run) = number.checked_sub(1).and_then(|index| self.runs.get(index)) else {
            let last = self.runs.len();
            let message = format!("--index {number}: runs are counted from 1 to {last}");
            return Err(Error::Input(message));
        };
        match self.attempt(world, run, options) {
            Ok(done) => {
                self.report_end(world, run, &completion(done));
                finished::refuse_missed(&world.group(), &run.directory, self.case(run)?.strict)
            }
            Err(error) if error.exit_code() == CAN_GO_ON => {
                Err(self.stopped(reason_text(&error), 0, 1))
            }
            Err(error) => Err(error),
        }
    }

    /// Solves all runs that are not finished; one that fails becomes a row with its message.
    /// Collective.
    ///
    /// # Errors
    /// Errors after which the sweep cannot continue: results cannot be written, or the wall time is
    /// too short for the first run.
    pub fn solve(&self, world: &World, options: &Options) -> Result<SweepResult> {
        let mut table = SweepTable::new(&self.keys);
        let (mut finished, mut computed) = (0, 0);
        for run in &self.runs {
            if !table.rows.is_empty() {
                // A signal in the set-up of a run ends the program at once.
                world.group().on_first_rank(|| table.write(&self.request.directory))?;
            }
            let stopped = |why: String| self.stopped(why, finished, self.runs.len());
            let found = match reason_to_stop(world, options, computed > 0) {
                Some(why) => Err(stopped(why)),
                None => self.attempt(world, run, options),
            };
            let error = match found {
                Ok(done) => {
                    finished += 1;
                    computed += usize::from(done.is_some());
                    let row = self.row(world, run)?;
                    match row.error.as_deref() {
                        Some(missed) => self.report_end(world, run, &missed),
                        None => self.report_end(world, run, &completion(done)),
                    }
                    table.rows.push(row);
                    continue;
                }
                Err(error) => error,
            };
            let too_late = world.group().any(matches!(error, Error::WallTime { .. }));
            if error.leaves_files_open() || (too_late && computed == 0) {
                return Err(error);
            }
            if too_late || error.exit_code() == CAN_GO_ON {
                let stopped = Some(stopped(reason_text(&error)));
                return Ok(SweepResult { table, stopped });
            }
            self.report_end(world, run, &error);
            table.rows.push(run.row(Value::Null, Some(error.to_string())));
        }
        Ok(SweepResult { table, stopped: None })
    }

    /// The table of the finished runs; nothing is solved. Collective.
    ///
    /// # Errors
    /// A summary that cannot be read.
    pub fn collect(&self, world: &World) -> Result<SweepTable> {
        let mut table = SweepTable::new(&self.keys);
        let damaged = |damage: &Error| format!("{damage}: damaged, and so not finished");
        let is_done = |run: &SweepRun, case: &Case| {
            finished::is_done(&world.group(), &run.directory, case, damaged)
        };
        for run in &self.runs {
            table.rows.push(match self.case(run) {
                Ok(case) if is_done(run, &case) => self.row(world, run)?,
                Ok(_) => SweepRow { ended: false, ..run.row(Value::Null, None) },
                Err(error) => run.row(Value::Null, Some(error.to_string())),
            });
        }
        Ok(table)
    }

    /// Solves a run, unless it is finished: the seconds that it took; `None` if an earlier process
    /// finished it. Collective.
    fn attempt(&self, world: &World, run: &SweepRun, options: &Options) -> Result<Option<f64>> {
        let case = self.case(run)?;
        let damaged =
            |damage: &Error| format!("{damage}: the finished run is damaged and is computed anew");
        if run::is_done_removing_rest(world, &run.directory, &case, damaged) {
            return Ok(None);
        }
        if world.group().is_first() {
            eprint_wrapped(&format!("[{}/{}] {}", run.number, self.runs.len(), self.label(run)));
        }
        // Only a run that has begun can be resumed.
        let left = [store::folder(&run.directory), run.directory.join(RESULT)];
        let begun = world.group().is_first() && left.iter().any(|path| path.exists());
        let resume = options.resume && world.group().any(begun);
        // So that the peak is that of this run alone.
        memory::reset_peak();
        let options = Options { resume, ..options.clone() };
        if case.method == Method::Schrodingerized {
            machine::begin(RunPart::SetUp);
        }
        let solved = run::run(world, &case, &run.directory, &options);
        machine::begin(RunPart::Modes);
        let summary = match solved {
            Err(Error::FinishedByOthers) => return Ok(None),
            other => other?,
        };
        if world.group().is_first() {
            summary.report_late_warnings();
        }
        Ok(Some(summary.wall_seconds))
    }

    /// Reports how a run ended.
    fn report_end(&self, world: &World, run: &SweepRun, end: &dyn fmt::Display) {
        if world.group().is_first() {
            let label = self.label(run);
            eprint_wrapped(&format!("[{}/{}] {label}: {end}", run.number, self.runs.len()));
        }
    }

    /// The table row of a finished run. It has an error if the results miss the requested accuracy
    /// and `solver.strict` makes that an error. Only the first rank has the summary. Collective.
    fn row(&self, world: &World, run: &SweepRun) -> Result<SweepRow> {
        let found = world.group().on_first_rank(|| summary::read(&run.directory))?;
        let missed =
            finished::refuse_missed(&world.group(), &run.directory, self.case(run)?.strict);
        Ok(run.row(found, missed.err().map(|error| error.to_string())))
    }

    fn stopped(&self, why: String, finished: usize, runs: usize) -> Error {
        Error::SweepStopped { why, path: self.request.directory.clone(), finished, runs }
    }
}

/// How a run ended that took these seconds, or that an earlier process finished.
fn completion(seconds: Option<f64>) -> String {
    seconds.map_or("finished before".to_owned(), |seconds| format!("{seconds:.2} s"))
}

/// The reason why a run or the sweep stopped early, as text.
fn reason_text(error: &Error) -> String {
    match error {
        Error::Stopped { why, .. } | Error::SweepStopped { why, .. } => why.clone(),
        other => other.to_string(),
    }
}

/// The reason why no further run may begin: any rank received a signal, or the wall time is over.
/// The wall time counts only if something was `computed`; if it is too short for the first run,
/// that run fails. Collective.
fn reason_to_stop(world: &World, options: &Options, computed: bool) -> Option<String> {
    let signal = options.stop.load(Ordering::Relaxed);
    let wall = options.walltime.filter(|_| computed);
    let late = wall.is_some_and(|wall| world.started.elapsed() >= wall);
    match world.group().max_count(2 * usize::from(signal) + usize::from(late)) {
        0 => None,
        1 => Some(format!("stopped by --walltime {}", wall.unwrap_or_default().as_secs_f64())),
        _ => Some("stopped by a signal".to_owned()),
    }
}
