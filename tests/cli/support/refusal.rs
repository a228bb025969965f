//! Checks that mistakes are refused: by the program, and by the reader of case files in this
//! process, which is faster for long tables of mistakes.

use super::cases::{case, directory};
use super::checks::{check_all, require};
use super::launch::Job;
use super::outcome::Finished;
use phasewarp::problem::case::Case;
use std::path::{Path, PathBuf};
use std::time::Instant;

/// Processor time, in seconds, that an answer to bad input may take: `docs/reliability.md` promises
/// it. A busy machine does not add to it.
const PROCESSOR_SECONDS: f64 = 5.0;

/// Time of the clock for the same, on a machine that is busy with other tests. mpirun itself takes
/// one to two seconds to end a job that failed.
pub const SECONDS_TO_REFUSE: f64 = 30.0;

/// The stack of the program's main thread, which reads case files.
const STACK: usize = 8 << 20;

impl Job {
    /// Runs the job and checks that it is [`refused`].
    pub fn is_refused(&self, wording: &[&str]) -> Result<(), String> {
        refused(&self.run()?, wording)
    }
}

/// Checks that a job was refused for a mistake of the user: with exit code 2, within
/// [`SECONDS_TO_REFUSE`], and with one message from rank 0, after nothing but warnings. It contains
/// all of `wording`.
pub fn refused(finished: &Finished, wording: &[&str]) -> Result<(), String> {
    ended_by_one_message(finished, &[2], wording)?;
    require(finished.others.is_empty(), finished, || "only rank 0 prints".into())?;
    let before = finished.errors.split("error: ").next().unwrap_or_default();
    require(before.lines().all(|line| line.starts_with("warning: ")), finished, || {
        format!("printed before the error message: {before}")
    })
}

/// Checks that a job ended soon and by itself: with one of these exit codes, and with one error
/// message that contains all of `wording`.
pub fn ended_by_one_message(
    finished: &Finished,
    codes: &[i32],
    wording: &[&str],
) -> Result<(), String> {
    let expected = finished.code.is_some_and(|code| codes.contains(&code));
    require(expected, finished, || format!("one of the exit codes {codes:?} expected"))?;
    one_message(&finished.errors, wording).map_err(|what| finished.report(&what))?;
    soon(finished)
}

/// An answer to bad input takes little time. Under mpirun only the clock says so: ranks that wait
/// for each other use their processors.
pub fn soon(finished: &Finished) -> Result<(), String> {
    let &Finished { seconds, processor_seconds: used, ref command, .. } = finished;
    let is_soon =
        seconds < SECONDS_TO_REFUSE && (used < PROCESSOR_SECONDS || command.starts_with("mpirun"));
    require(is_soon, finished, || format!("took {seconds:.1} s, {used:.1} s of a processor"))
}

/// Checks that there is one error message, of no crash, and that it contains all of `wording`.
fn one_message(message: &str, wording: &[&str]) -> Result<(), String> {
    let errors = message.matches("error: ").count();
    if errors != 1 {
        return Err(format!("one message expected, \"error: \" occurs {errors} times"));
    }
    for crash in ["panicked", "backtrace", "RUST_BACKTRACE", "signal", "Signal"] {
        if message.contains(crash) {
            return Err(format!("the message contains \"{crash}\""));
        }
    }
    match wording.iter().find(|words| !message.contains(**words)) {
        Some(words) => Err(format!("the message does not contain \"{words}\"")),
        None => Ok(()),
    }
}

/// A mistake in a case file or in a setting, and the words that the message must contain.
pub struct Mistake {
    /// The case file.
    pub path: String,
    /// Values of `--set`.
    pub settings: Vec<String>,
    /// Texts that the message must contain.
    pub wording: Vec<String>,
}

impl Mistake {
    /// A mistake in these settings of a file of `cases/`.
    pub fn set(name: &str, settings: &[&str], wording: &[&str]) -> Self {
        let owned = |list: &[&str]| list.iter().map(|s| (*s).to_owned()).collect();
        Self { path: case(name), settings: owned(settings), wording: owned(wording) }
    }

    /// Checks that the reader refuses the mistake in this process. The error that the program would
    /// print must satisfy the conditions of [`refused`].
    pub fn refused_by_reader(&self) -> Result<(), String> {
        let read = || {
            let outcome = Case::load(Path::new(&self.path), &self.settings);
            outcome.map_err(|e| (e.exit_code(), format!("error: {e}")))
        };
        let started = Instant::now();
        let outcome = std::thread::scope(|scope| {
            let thread = std::thread::Builder::new().stack_size(STACK);
            thread.spawn_scoped(scope, read).map(|thread| thread.join())
        });
        let seconds = started.elapsed().as_secs_f64();
        let command = self.job().command();
        let (code, message) = match outcome {
            Ok(Ok(Err(refusal))) => refusal,
            Ok(Ok(Ok(_))) => return Err(format!("accepted: {command}")),
            Ok(Err(_)) => return Err(format!("panicked: {command}")),
            Err(e) => return Err(format!("no thread: {e}")),
        };
        let fails = |what: String| format!("{what}\n  as in: {command}\n  message: {message}");
        one_message(&message, &self.wording()).map_err(fails)?;
        if code != 2 || seconds >= SECONDS_TO_REFUSE {
            return Err(fails(format!("exit code {code} after {seconds:.1} s")));
        }
        Ok(())
    }

    /// Checks that `phasewarp check` on so many ranks refuses the mistake.
    pub fn refused_by_program(&self, ranks: usize) -> Result<(), String> {
        self.job().on(ranks).is_refused(&self.wording())
    }

    fn job(&self) -> Job {
        let settings: Vec<&str> = self.settings.iter().map(String::as_str).collect();
        Job::new(["check", &self.path]).set(&settings)
    }

    fn wording(&self) -> Vec<&str> {
        self.wording.iter().map(String::as_str).collect()
    }
}

/// Checks that the reader refuses the mistakes of all rows, and that the program refuses that of
/// the first row on two ranks and that of the last one alone. `mistake` may write files into the
/// directory that it gets.
pub fn all_refused<T: Sync>(rows: &[T], mistake: impl Fn(&T, &Path) -> Mistake + Sync) {
    let rows: Vec<(usize, &T)> = rows.iter().enumerate().collect();
    check_all(&rows, |(k, row)| {
        let place = directory();
        let mistake = mistake(row, place.path());
        if *k == 0 || k + 1 == rows.len() {
            mistake.refused_by_program(if *k == 0 { 2 } else { 1 })?;
        }
        mistake.refused_by_reader()
    });
}

/// Writes `cases/example1.toml` into `place` with the only occurrence of `old` replaced. Returns
/// the path of the file and the number of the line that is changed.
pub fn edited(place: &Path, old: &str, new: &str) -> (PathBuf, usize) {
    let text = std::fs::read_to_string(case("example1.toml")).unwrap();
    let found: Vec<usize> = text.match_indices(old).map(|(at, _)| at).collect();
    assert_eq!(found.len(), 1, "\"{old}\" occurs {} times in example1.toml", found.len());
    let line = 1 + text[..found[0]].matches('\n').count();
    let path = place.join("edited.toml");
    std::fs::write(&path, text.replace(old, new)).unwrap();
    (path, line)
}
