//! Runs of many kinds, with faults at random moments and continued on other ranks, end with the
//! bits of an undisturbed run. `make test` tries a few, `make torture` many.

use crate::checkpoint::{Fault, Faulty, OFTEN, Result, inject, newest};
use crate::dense::random;
use crate::launcher::by_hydra;
use crate::support::{
    Finished, Job, Stored, case, check_all, datasets, directory_on_disk as directory, equals_whole,
    holds, names_in, nothing_unfinished, number_from_environment, on_results,
};
use std::collections::{BTreeMap, BTreeSet};
use std::panic::{AssertUnwindSafe, catch_unwind, resume_unwind};
use std::path::Path;
use std::sync::{Mutex, OnceLock, PoisonError};
use std::time::Duration;
use tempfile::TempDir;

/// A kind of run.
struct Kind {
    name: &'static str,
    /// Whether the run continues the results of the case until time 1.5 instead of starting at time
    /// 0.
    continues: bool,
    case: &'static str,
    settings: &'static [&'static str],
    options: &'static [&'static str],
}

/// Many modes, so that there are many batches and checkpoints.
const MANY: [&str; 3] =
    ["solver.tolerance=1e-2", "solver.warp.profile=exponential", "solver.warp.points=512"];

const KINDS: [Kind; 10] = [
    Kind {
        continues: false,
        name: "streamed",
        case: "example1.toml",
        settings: &["axis.0.x.cells=43", "axis.0.v.cells=30"],
        options: &[],
    },
    Kind {
        continues: false,
        name: "full",
        case: "example1.toml",
        settings: &["axis.0.x.cells=23", "axis.0.v.cells=18", "output.warped_field=true"],
        options: &["--mode", "full"],
    },
    Kind {
        continues: false,
        name: "output times",
        case: "example1.toml",
        settings: &["axis.0.x.cells=31", "axis.0.v.cells=22", "output.field_times=[0.2,0.7]"],
        options: &[],
    },
    Kind {
        continues: false,
        name: "elements",
        case: "smooth-beams.toml",
        settings: &["scheme.degree=2", "axis.0.x.cells=11", "axis.0.v.cells=8"],
        options: &[],
    },
    Kind {
        continues: false,
        name: "inflow in time",
        case: "pulsed_inflow.toml",
        settings: &["axis.0.x.cells=20", "axis.0.v.cells=22", "solver.tolerance=1e-2"],
        options: &[],
    },
    Kind {
        continues: false,
        name: "level sets",
        case: "example2.toml",
        settings: &["axis.0.x.cells=24", "axis.0.v.cells=20", "time.end=0.3"],
        options: &[],
    },
    Kind {
        continues: false,
        name: "two dimensions",
        case: "quadrant2d.toml",
        settings: &[
            "scheme.degree=0", "axis.0.x.cells=8", "axis.0.v.cells=6", "axis.1.x.cells=6",
            "axis.1.v.cells=6",
        ],
        options: &[],
    },
    Kind {
        continues: false,
        name: "Crank-Nicolson",
        case: "example1.toml",
        settings: &[
            "axis.0.x.cells=23",
            "axis.0.v.cells=18",
            "solver.propagator={method='crank-nicolson',step=0.02}",
        ],
        // The bits depend on the blocks of space.
        options: &["--ranks-x", "1"],
    },
    Kind {
        continues: false,
        name: "verified",
        case: "example1.toml",
        settings: &["axis.0.x.cells=60", "axis.0.v.cells=50", "solver.verify=true", "time.end=3"],
        options: &[],
    },
    Kind {
        continues: true,
        name: "continued",
        case: "example1.toml",
        settings: &["axis.0.x.cells=43", "axis.0.v.cells=30"],
        options: &[],
    },
];

/// The results that a run continues.
static BEGINNING: OnceLock<Result<TempDir>> = OnceLock::new();

impl Kind {
    fn job(&self) -> Result<Job> {
        let from_start = || Job::new(["run", &case(self.case)]).set(&MANY).set(self.settings);
        let job = if self.continues {
            let beginning = BEGINNING.get_or_init(|| {
                let place = directory();
                from_start().into(place.path()).succeed().map(|_| place)
            });
            let path = beginning.as_ref().map_err(String::clone)?.path().display().to_string();
            Job::new(["run", "--continue", &path, "--until", "1.5"])
        } else {
            from_start()
        };
        Ok(job.set(&[OFTEN]).with(self.options.iter().copied()))
    }
}

/// An undisturbed run of a kind.
struct Whole {
    datasets: BTreeMap<String, Stored>,
    seconds: f64,
}

/// The undisturbed run of each kind, which runs once.
static WHOLES: [OnceLock<Result<Whole>>; KINDS.len()] = [const { OnceLock::new() }; KINDS.len()];

impl Whole {
    fn new(kind: &Kind) -> Result<Self> {
        let place = directory();
        let finished = kind.job()?.on(2).into(place.path()).succeed()?;
        Ok(Self { datasets: datasets(place.path())?, seconds: finished.seconds })
    }
}

/// The numbers of the trials, which `make torture` sets in the environment.
fn trials() -> std::ops::Range<u64> {
    let first = number_from_environment("PHASEWARP_FIRST_TRIAL", 0);
    first..first + number_from_environment("PHASEWARP_TRIALS", KINDS.len() as u64)
}

/// A fault and the exit codes that the launcher may have after it in a shell, except for 0 of a run
/// that ended before the fault.
struct FaultKind {
    name: &'static str,
    fault: Fault,
    /// Open MPI's `mpirun`.
    codes: &'static [i32],
    /// MPICH's.
    codes_of_hydra: &'static [i32],
}

/// A kind of fault, with the exit codes by Open MPI and by MPICH.
const fn fault(
    name: &'static str,
    fault: Fault,
    codes: &'static [i32],
    codes_of_hydra: &'static [i32],
) -> FaultKind {
    FaultKind { name, fault, codes, codes_of_hydra }
}

const FAULTS: [FaultKind; 10] = [
    fault("SIGKILL to mpirun", Fault::Launcher, &[137], &[137]),
    fault("SIGKILL to a rank", Fault::Rank(0), &[137], &[9, 255]),
    fault("SIGKILL to a rank", Fault::Rank(1), &[137], &[9, 255]),
    // For these signals mpirun has its own exit code or ends by the signal. MPICH's hands them on;
    // in a set-up the first rank that ends with 75 makes it kill the others, and it returns 9. It
    // returns 255 if it was about to write to a rank that was killed or ended by a signal.
    fault("SIGTERM to mpirun", Fault::Terminate, &[1, 143], &[75, 143, 9]),
    fault("SIGINT to mpirun", Fault::Interrupt, &[1, 130], &[75, 130, 9]),
    fault("SIGUSR1 to mpirun", Fault::Signal, &[75], &[75, 9]),
    fault("SIGTERM to a rank", Fault::Send("-TERM", 1), &[75], &[75, 9, 255]),
    fault("SIGINT to a rank", Fault::Send("-INT", 0), &[75], &[75, 9, 255]),
    fault("SIGUSR1 to a rank", Fault::Send("-USR1", 1), &[75], &[75, 9, 255]),
    fault("SIGSTOP of a rank for half a second", Fault::Pause(0), &[], &[]),
];

/// Exit codes of faults in mpirun itself: abort, invalid memory, closed pipe.
const CRASHES: [i32; 3] = [134, 139, 141];

impl FaultKind {
    /// Whether a run may end with this exit code. If mpirun itself hangs or crashes after its ranks
    /// have ended, this is counted but allowed.
    fn allows(&self, faulty: &Faulty) -> bool {
        let code = faulty.finished.shell_code;
        let codes = if by_hydra() { self.codes_of_hydra } else { self.codes };
        // A rank that has not yet installed its signal handlers is ended by the signal.
        let of_signal = if by_hydra() { 0 } else { 128 };
        let by_default = match self.fault {
            Fault::Signal | Fault::Send("-USR1", _) => of_signal + libc::SIGUSR1,
            Fault::Send("-TERM", _) => of_signal + libc::SIGTERM,
            Fault::Send("-INT", _) => of_signal + libc::SIGINT,
            Fault::Terminate if by_hydra() => libc::SIGTERM,
            Fault::Interrupt if by_hydra() => libc::SIGINT,
            _ => 0,
        };
        code == 0
            || launcher_failed(faulty)
            || (faulty.injected && codes.contains(&code))
            || (!faulty.begun && (code == by_default || launch_failed(faulty)))
    }
}

/// Whether mpirun ended without starting the program: a signal to a child of it that was not yet
/// the program ended that child.
fn launch_failed(faulty: &Faulty) -> bool {
    let Finished { shell_code, output, errors, .. } = &faulty.finished;
    *shell_code == 1 && output.is_empty() && errors.is_empty()
}

fn launcher_failed(faulty: &Faulty) -> bool {
    let code = faulty.finished.shell_code;
    // In MPICH a rank may end by invalid memory where another one ends while MPI starts.
    faulty.hung || CRASHES.contains(&code) || (by_hydra() && code == libc::SIGSEGV)
}

/// The state of a run at which a fault is injected.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord)]
enum Moment {
    AnyTime,
    SetUp,
    Modes,
    Checkpoint,
    Results,
    Summary,
}

const MOMENTS: [Moment; 8] = [
    Moment::AnyTime,
    Moment::AnyTime,
    Moment::AnyTime,
    Moment::SetUp,
    Moment::Modes,
    Moment::Checkpoint,
    Moment::Results,
    Moment::Summary,
];

impl Moment {
    /// Whether a run into `path`, which started from the checkpoint `before`, has reached the
    /// moment.
    fn has_come(self, path: &Path, before: Option<&Path>) -> bool {
        match self {
            Self::AnyTime => true,
            Self::SetUp => newest(path).as_deref() == before,
            Self::Modes => newest(path).is_some_and(|newest| Some(&*newest) != before),
            Self::Checkpoint => {
                let begun = names_in(&path.join("checkpoint")).into_iter().max();
                let begun = begun.map(|name| path.join("checkpoint").join(name));
                begun.is_some_and(|begun| !begun.join("manifest.json").exists())
            }
            Self::Results => holds(path, ".partial"),
            Self::Summary => holds(path, "result.h5") && !holds(path, "summary.json"),
        }
    }
}

/// Counts of faults.
#[derive(Default)]
struct Count {
    faults: usize,
    /// Faults that interrupted a run.
    met: usize,
    /// Faults after which a run ended with a wrong exit code or was not continued correctly.
    failures: usize,
    /// Faults after which mpirun itself failed.
    launcher: usize,
    codes: BTreeSet<i32>,
}

/// The counts of each fault and of each moment.
type Tally = Mutex<BTreeMap<String, Count>>;

fn count(tally: &Tally, names: &[String], change: impl Fn(&mut Count)) {
    let mut tally = tally.lock().unwrap_or_else(PoisonError::into_inner);
    names.iter().for_each(|name| change(tally.entry(name.clone()).or_default()));
}

/// Up to three faults at random moments, then a continuation to the end.
fn trial(number: u64, tally: &Tally) -> Result<()> {
    let draw = |what: u64, of: usize| (random(101 * number + what) * of as f64) as usize;
    let index = number as usize % KINDS.len();
    let kind = &KINDS[index];
    let whole = WHOLES[index].get_or_init(|| Whole::new(kind)).as_ref().map_err(String::clone)?;
    let place = directory();
    let path = place.path();
    let mut faults: Vec<String> = Vec::new();
    let mut last = [const { String::new() }; 2];
    for part in 0..1 + draw(0, 3) as u64 {
        let [of, delay, ranks, moment] = [1, 2, 3, 4].map(|what| 10 * (part + 1) + what);
        let fault = &FAULTS[draw(of, FAULTS.len())];
        let (moment, ranks) = (MOMENTS[draw(moment, MOMENTS.len())], 1 + draw(ranks, 4));
        let longest = match moment {
            Moment::AnyTime => 1.05 * whole.seconds,
            Moment::SetUp => 0.15,
            _ => 0.005,
        };
        let after = Duration::from_secs_f64(longest * random(101 * number + delay));
        let before = newest(path);
        let mut come = None;
        let job = kind.job()?.with(["--resume"]).on(ranks).into(path);
        let faulty = inject(&job, fault.fault, |since| {
            if come.is_none() && moment.has_come(path, before.as_deref()) {
                come = Some(since);
            }
            come.is_some_and(|come| {
                since >= after + if moment == Moment::AnyTime { Duration::ZERO } else { come }
            })
        })?;
        let Faulty { finished, injected, .. } = &faulty;
        last = [fault.name.to_owned(), format!("{moment:?}")];
        count(tally, &last, |count| {
            count.faults += usize::from(*injected);
            count.met += usize::from(*injected && finished.code != Some(0));
            count.launcher += usize::from(launcher_failed(&faulty));
            count.codes.insert(finished.shell_code);
        });
        let report =
            finished.report(&format!("{}, {moment:?}, {after:?}, {ranks} ranks", fault.name));
        if !fault.allows(&faulty) {
            count(tally, &last, |count| count.failures += 1);
            let code = finished.shell_code;
            return Err(format!("trial {number}, {}: exit code {code}\n{report}", kind.name));
        }
        faults.push(report);
    }
    ends(kind, path, 1 + draw(99, 4), whole).map_err(|why| {
        count(tally, &last, |count| count.failures += 1);
        format!("trial {number}, {}: {why}\n{faults:?}", kind.name)
    })
}

/// Continues a run to its end. The result must equal that of the undisturbed run, and no temporary
/// file may be left.
fn ends(kind: &Kind, path: &Path, ranks: usize, whole: &Whole) -> Result<()> {
    kind.job()?.on(ranks).with(["--resume"]).into(path).succeed()?;
    equals_whole(path, &whole.datasets, &[])?;
    nothing_unfinished(path)?;
    on_results("check-result", path).succeed().map(drop)
}

#[test]
fn runs_of_all_kinds_survive_any_fault() {
    let tally = Tally::default();
    let all: Vec<u64> = trials().collect();
    let trials = AssertUnwindSafe(|| check_all(&all, |&number| trial(number, &tally)));
    // The table is also printed if trials fail.
    let outcome = catch_unwind(trials);
    let tally = tally.into_inner().unwrap_or_else(PoisonError::into_inner);
    println!(
        "| fault or moment | faults | met a run at work | failures | mpirun failed | exit codes |"
    );
    println!("|---|---|---|---|---|---|");
    for (name, Count { faults, met, failures, launcher, codes }) in tally {
        let codes: Vec<String> = codes.iter().map(i32::to_string).collect();
        println!("| {name} | {faults} | {met} | {failures} | {launcher} | {} |", codes.join(", "));
    }
    outcome.unwrap_or_else(|failures| resume_unwind(failures));
}
