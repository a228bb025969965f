//! The errors, in one place. A message names the key, the value and the limit, and says what to do.

use crate::base::refusal::Refusal;
use std::path::PathBuf;

/// The sentence on what lowers the memory of any run.
pub const LESS_MEMORY: &str = "fewer cells (axis.N.x.cells, axis.N.v.cells), more ranks on more \
                               nodes, or a larger solver.tolerance need less";

/// The part of a message about a formula that is not finite which says what may be missing.
fn without_else(formula: &str) -> &'static str {
    let has = |word| formula.split(|c: char| !c.is_alphanumeric()).any(|part| part == word);
    if has("if") && !has("else") { "; where no `if` holds, an `else` gives the value" } else { "" }
}

/// Growth below which it is not the reason why no digits are left.
const SMALL_GROWTH: f64 = 1.0;

/// The message of [`Error::Growth`].
fn no_digits(ratio: f64, growth: f64) -> String {
    if growth < SMALL_GROWTH {
        return format!(
            "the norm falls by a factor {ratio:.3e} from state to field, which leaves no digits \
             in double precision: nearly all of f has left the box by time.end; choose an earlier \
             one, a larger box, or, with inflow, no solver.warp.delta"
        );
    }
    format!(
        "growth x time {growth:.3} and a norm that falls by a factor {ratio:.3e} from state to \
         field leave no digits in double precision; a smaller time.end does, and against growth \
         solver.warp.weights = \"dissipative\" or scheme.interface = \"conservative\", and \
         solver.warp.delta left out"
    )
}

/// Everything that ends a command early.
#[derive(Debug, thiserror::Error)]
pub enum Error {
    /// An option or an input file is wrong; the text carries it, its value and the limit.
    #[error("{0}")]
    Input(String),
    /// The case file or a `--set` is wrong: file, line, key, value and limit.
    #[error("{0}")]
    Case(Box<Refusal>),
    /// A formula yields NaN or infinity.
    #[error(
        "{key} = \"{formula}\" is {value} at {place}; it must be finite everywhere on the grid{}",
        without_else(formula)
    )]
    Formula {
        /// File, line and key of the formula.
        key: String,
        /// Text of the formula.
        formula: String,
        /// Its value.
        value: f64,
        /// The point, written `x = …, v = …`.
        place: String,
    },
    /// More memory than there is.
    #[error("memory: {needed} needed per rank ({detail}), {available} available; {remedies}")]
    Memory {
        /// Planned bytes a rank, as text.
        needed: String,
        /// Bytes a rank may take, as text.
        available: String,
        /// The largest array.
        detail: String,
        /// The sentence on changes of the case or of the job with which it fits.
        remedies: String,
    },
    /// No profile reaches the tolerance in double precision.
    #[error(
        "{place} = {tolerance:e}: round-off allows no less than {smallest:.1e} here, where the \
         norm falls by a factor {ratio:.3e} from state to field and growth x time is {growth:.3}; \
         ask for at least that"
    )]
    Tolerance {
        /// File, line and key.
        place: String,
        /// The tolerance asked for.
        tolerance: f64,
        /// The smallest that can be met.
        smallest: f64,
        /// ‖ũ(0)‖/‖f(T)‖, see [`crate::plan`].
        ratio: f64,
        /// λ⁺T.
        growth: f64,
    },
    /// The generator grows too much for any tolerance.
    #[error("solver: {}", no_digits(*ratio, *growth))]
    Growth {
        /// ‖ũ(0)‖/‖f(T)‖, see [`crate::plan`].
        ratio: f64,
        /// λ⁺T.
        growth: f64,
    },
    /// An interval in `p` too short for the tolerance.
    #[error(
        "{place} = [{}, {}]: too short for solver.tolerance = {tolerance:e}, which takes a length \
         of {needed:.4} and, read at p = {point:.4}, about [{}, {}]; a longer interval, a larger \
         tolerance, or none given by hand",
        given[0], given[1], ends[0], ends[1]
    )]
    Interval {
        /// File, line and key.
        place: String,
        /// `[L, R]`.
        given: [f64; 2],
        /// The least length.
        needed: f64,
        /// Ends that suffice.
        ends: [f64; 2],
        /// `p◇`.
        point: f64,
        /// The tolerance asked for.
        tolerance: f64,
    },
    /// A recovery point at which the field is lost in round-off.
    #[error(
        "solver.warp.recovery = {point}: reading there amplifies round-off by exp({point}); \
         solver.tolerance = {tolerance:e} allows no more than {highest:.3}"
    )]
    Recovery {
        /// `p◇`.
        point: f64,
        /// The largest point that keeps the tolerance.
        highest: f64,
        /// The tolerance asked for.
        tolerance: f64,
    },
    /// More modes than any machine can propagate.
    #[error(
        "solver.warp.profile ({profile}): solver.tolerance = {tolerance:e} takes {modes:.3e} \
         modes, at most {limit} are planned; a smoother profile (designed, gaussian, low-somma, \
         smooth of higher order) or a larger tolerance"
    )]
    Modes {
        /// The profile.
        profile: String,
        /// The number of modes that it takes.
        modes: f64,
        /// The largest number allowed.
        limit: usize,
        /// The tolerance asked for.
        tolerance: f64,
    },
    /// A rank layout that does not fit the grid.
    #[error("{0}")]
    Ranks(String),
    /// The weights did not reach their certificate.
    #[error(
        "dissipative weights: growth bound {certificate:.3e} after {sweeps} sweeps, {limit:.3e} \
         wanted; set scheme.interface = \"conservative\""
    )]
    Weights {
        /// ½ max (Aᵀπ)/π reached.
        certificate: f64,
        /// The bound asked for.
        limit: f64,
        /// Sweeps done.
        sweeps: usize,
    },
    /// A generator for which dissipative weights prove nothing.
    #[error(
        "dissipative weights need off-diagonal entries of the generator that are not negative; row \
         {row}, column {column} holds {value:e}: solver.warp.weights = \"none\""
    )]
    Negative {
        /// Local row.
        row: usize,
        /// Local column.
        column: usize,
        /// The entry.
        value: f64,
    },
    /// A mode's norm moved by more than its truncated series allows.
    #[error(
        "mode {mode} (wavenumber {wavenumber:.6}): its norm changed by {defect:.3e}, {allowed:.3e} \
         allowed; the run is not unitary and its result is not written"
    )]
    Unitarity {
        /// Index of the mode.
        mode: usize,
        /// Wavenumber `μ` of the mode.
        wavenumber: f64,
        /// Relative change of the norm.
        defect: f64,
        /// What the truncated series allows, plus 1e-12.
        allowed: f64,
    },
    /// The linear system of an implicit step was not solved.
    #[error(
        "solver.propagator: the step's linear system for wavenumber {wavenumber:.6} has a relative \
         residual of {residual:.1e} after {iterations} iterations, {limit:.1e} wanted; a smaller \
         solver.propagator.step or fewer space blocks (--ranks-x 1) need fewer iterations"
    )]
    Solver {
        /// The mode's wavenumber μ.
        wavenumber: f64,
        /// The residual reached.
        residual: f64,
        /// The residual wanted.
        limit: f64,
        /// Iterations done.
        iterations: usize,
    },
    /// The matrix of an implicit step could not be factorised.
    #[error(
        "solver.propagator: the sparse factors of an implicit step: {0}; more space blocks \
         (--ranks-x) make them smaller, solver.propagator.method = \"chebyshev\" or \"krylov\" \
         need none"
    )]
    Factors(String),
    /// The results are written, but less accurate than requested (`solver.strict`).
    #[error("{0}; solver.strict = true makes this an error, the results are kept")]
    Missed(String),
    /// The result holds NaN or infinity.
    #[error("the computed field is not finite ({0}); please report this case")]
    NotFinite(String),
    /// The output directory cannot be written.
    #[error("output directory {}: {reason}", path.display())]
    Directory {
        /// The directory.
        path: PathBuf,
        /// The message of the system.
        reason: String,
    },
    /// A file of the results cannot be written.
    #[error("output {}: {reason}", path.display())]
    Output {
        /// The file.
        path: PathBuf,
        /// The message of the system.
        reason: String,
    },
    /// A checkpoint cannot be written, or none can be used.
    #[error("checkpoint {}: {reason}", path.display())]
    Checkpoint {
        /// The file or directory.
        path: PathBuf,
        /// What is wrong.
        reason: String,
    },
    /// A checkpoint is sound, but that of a run with other settings or files.
    #[error("checkpoint {}: {reason}", path.display())]
    AnotherRun {
        /// The generation, or the directory of all of them.
        path: PathBuf,
        /// What differs.
        reason: String,
    },
    /// A batch of modes was interrupted; the run stops.
    #[error("a batch of modes was interrupted")]
    Interrupted,
    /// The run was stopped before its end on request, and can be resumed.
    #[error(
        "{why}; {} holds {finished} of {modes} modes of stage {stage} of {stages}: the same \
         command with --resume goes on from there",
        path.display()
    )]
    Stopped {
        /// Why.
        why: String,
        /// The directory of the checkpoints.
        path: PathBuf,
        /// Modes finished.
        finished: usize,
        /// All modes.
        modes: usize,
        /// The stage, from 1.
        stage: usize,
        /// All stages.
        stages: usize,
    },
    /// A sweep was stopped before its end on request; the same command goes on.
    #[error(
        "{why}: {finished} of {runs} runs are finished in {}; the same command goes on from there",
        path.display()
    )]
    SweepStopped {
        /// Why.
        why: String,
        /// The directory of the sweep.
        path: PathBuf,
        /// Runs finished.
        finished: usize,
        /// All runs.
        runs: usize,
    },
    /// Runs of a sweep failed or are not finished; the others are done.
    #[error(
        "{}: {} says why, in its column error",
        unsuccessful(*failed, *unfinished, *runs),
        path.display()
    )]
    SweepFailed {
        /// The table.
        path: PathBuf,
        /// Runs that failed.
        failed: usize,
        /// Runs that are not finished, and did not fail.
        unfinished: usize,
        /// All runs.
        runs: usize,
    },
    /// The wall time did not suffice for the exact solution, or for one batch of modes.
    #[error("--walltime {seconds}: {why}")]
    WallTime {
        /// The time given, in seconds.
        seconds: f64,
        /// What takes longer, and the remedies.
        why: String,
    },
    /// The run is finished: another process did it, which no user sees as an error.
    #[error("another process has finished this run")]
    FinishedByOthers,
    /// A run too long for any machine.
    #[error(
        "time.end = {end:e}: with the grid's largest rate {rate:.3e} {quantity} {span:.3e} times \
         1/T, at most {limit:e} is planned; a smaller time.end or wider cells"
    )]
    TooLong {
        /// `time.end`.
        end: f64,
        /// `max |A_ii|`.
        rate: f64,
        /// The limited quantity with its verb: `the spectrum of S spans`.
        quantity: &'static str,
        /// The quantity times the duration `T` of the run.
        span: f64,
        /// The largest allowed.
        limit: f64,
    },
    /// Numbers so large or small that their squares cannot be computed.
    #[error(
        "{key}: the largest value on the grid is {value:e}; between 1e-100 and 1e100 (or 0) can be \
         computed"
    )]
    Magnitude {
        /// The key.
        key: String,
        /// The largest magnitude.
        value: f64,
    },
    /// Another rank failed; its message was printed there.
    #[error("rank {rank}: {message}")]
    Remote {
        /// The lowest rank that failed.
        rank: usize,
        /// Message of the error on that rank.
        message: String,
        /// Exit code of that error.
        code: i32,
        /// See [`Error::leaves_files_open`].
        files_open: bool,
    },
}

/// How many runs of a sweep have no results.
fn unsuccessful(failed: usize, unfinished: usize, runs: usize) -> String {
    let failures = format!("{failed} of {runs} runs failed");
    let others = format!("{unfinished} of {runs} runs are not finished");
    match (failed, unfinished) {
        (_, 0) => failures,
        (0, _) => others,
        _ => format!("{failures} and {others}"),
    }
}

impl Error {
    /// An input error with this message.
    pub fn input(message: impl Into<String>) -> Self {
        Self::Input(message.into())
    }

    /// Whether files stay open because they are half-written.
    pub fn leaves_files_open(&self) -> bool {
        match self {
            Error::Output { .. } => true,
            Error::Remote { files_open, .. } => *files_open,
            _ => false,
        }
    }

    /// Whether this is no failure, but a batch of modes interrupted because the run is to stop.
    pub fn is_interruption(&self) -> bool {
        matches!(self, Error::Interrupted)
    }

    /// Whether this is no failure, but a run that was asked to stop.
    pub fn is_stop(&self) -> bool {
        matches!(self, Error::Stopped { .. } | Error::SweepStopped { .. })
    }

    /// The process's exit code: 2 when the user's input is wrong, [`CAN_GO_ON`] when the same
    /// command with `--resume` continues, 3 when runs of a sweep failed, 1 otherwise.
    pub fn exit_code(&self) -> i32 {
        match self {
            Error::Input(_)
            | Error::Case(_)
            | Error::Formula { .. }
            | Error::Memory { .. }
            | Error::Tolerance { .. }
            | Error::Growth { .. }
            | Error::Interval { .. }
            | Error::Recovery { .. }
            | Error::Modes { .. }
            | Error::Ranks(_)
            | Error::Directory { .. }
            | Error::TooLong { .. }
            | Error::WallTime { .. }
            | Error::AnotherRun { .. }
            | Error::Magnitude { .. } => 2,
            Error::FinishedByOthers => 0,
            Error::Stopped { .. } | Error::SweepStopped { .. } => CAN_GO_ON,
            Error::SweepFailed { .. } => 3,
            Error::Remote { code, .. } => *code,
            Error::Output { .. }
            | Error::Checkpoint { .. }
            | Error::Interrupted
            | Error::Weights { .. }
            | Error::Negative { .. }
            | Error::Unitarity { .. }
            | Error::Solver { .. }
            | Error::Factors(_)
            | Error::Missed(_)
            | Error::NotFinite(_) => 1,
        }
    }
}

impl From<&Error> for Refusal {
    /// This error as a refusal of the case; only its text if the error has no key.
    fn from(error: &Error) -> Self {
        let text = error.to_string();
        match error {
            Error::Case(refusal) => (**refusal).clone(),
            Error::Formula { key, formula, .. } => Self::at_place(key, formula, &text),
            Error::Tolerance { place, tolerance, .. } => {
                Self::at_place(place, &format!("{tolerance:e}"), &text)
            }
            Error::Interval { place, given, .. } => {
                Self::at_place(place, &format!("{given:?}"), &text)
            }
            _ => Self { message: text, ..Self::default() },
        }
    }
}

/// Exit code of a command that was stopped and can be resumed by `--resume`: sendmail's code of a
/// temporary failure.
pub const CAN_GO_ON: i32 = 75;

/// `Result` with this crate's [`Error`].
pub type Result<T> = std::result::Result<T, Error>;
