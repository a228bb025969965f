//! Runs of many kinds, with faults at random moments and continued on other ranks: they end with
//! the bits of an undisturbed run. `make test` tries a few, `make torture` many.

use crate::checkpoint::{Fault, OFTEN, Result, random, with_fault};
use crate::support::{
    Job, Stored, case, check_all, datasets, differences, directory_on_disk as directory,
    number_from_environment,
};
use std::collections::BTreeMap;
use std::fs;
use std::path::Path;
use std::sync::{Mutex, OnceLock};
use std::time::Duration;

/// A kind of run.
struct Kind {
    name: &'static str,
    case: &'static str,
    settings: &'static [&'static str],
    options: &'static [&'static str],
}

/// Many modes, so that there are many batches and checkpoints.
const MANY: [&str; 3] =
    ["solver.tolerance=1e-2", "solver.warp.profile=exponential", "solver.warp.points=512"];

const KINDS: [Kind; 8] = [
    Kind {
        name: "streamed",
        case: "example1.toml",
        settings: &["axis.0.x.cells=43", "axis.0.v.cells=30"],
        options: &[],
    },
    Kind {
        name: "full",
        case: "example1.toml",
        settings: &["axis.0.x.cells=23", "axis.0.v.cells=18", "output.warped_field=true"],
        options: &["--mode", "full"],
    },
    Kind {
        name: "output times",
        case: "example1.toml",
        settings: &["axis.0.x.cells=31", "axis.0.v.cells=22", "output.field_times=[0.2,0.7]"],
        options: &[],
    },
    Kind {
        name: "elements",
        case: "smooth-beams.toml",
        settings: &["scheme.degree=2", "axis.0.x.cells=11", "axis.0.v.cells=8"],
        options: &[],
    },
    Kind {
        name: "inflow in time",
        case: "pulsed_inflow.toml",
        settings: &["axis.0.x.cells=20", "axis.0.v.cells=22", "solver.tolerance=1e-2"],
        options: &[],
    },
    Kind {
        name: "level sets",
        case: "example2.toml",
        settings: &["axis.0.x.cells=24", "axis.0.v.cells=20", "time.end=0.3"],
        options: &[],
    },
    Kind {
        name: "two dimensions",
        case: "quadrant2d.toml",
        settings: &[
            "scheme.degree=0", "axis.0.x.cells=8", "axis.0.v.cells=6", "axis.1.x.cells=6",
            "axis.1.v.cells=6",
        ],
        options: &[],
    },
    Kind {
        name: "Crank-Nicolson",
        case: "example1.toml",
        settings: &[
            "axis.0.x.cells=23",
            "axis.0.v.cells=18",
            "solver.propagator={method='crank-nicolson',step=0.02}",
        ],
        // Other blocks of space give other bits.
        options: &["--ranks-x", "1"],
    },
];

impl Kind {
    fn job(&self) -> Job {
        let job = Job::new(["run", &case(self.case)]).set(&MANY).set(self.settings);
        job.set(&[OFTEN]).with(self.options.iter().copied())
    }
}

/// An undisturbed run of a kind.
struct Whole {
    datasets: BTreeMap<String, Stored>,
    seconds: f64,
}

/// Of each kind, run once.
static WHOLES: [OnceLock<Result<Whole>>; KINDS.len()] = [const { OnceLock::new() }; KINDS.len()];

impl Whole {
    fn new(kind: &Kind) -> Result<Self> {
        let place = directory();
        let finished = kind.job().on(2).into(place.path()).succeed()?;
        Ok(Self { datasets: datasets(place.path())?, seconds: finished.seconds })
    }
}

/// How many trials, and of which number the first is: of the environment in `make torture`.
fn trials() -> std::ops::Range<u64> {
    let first = number_from_environment("PHASEWARP_FIRST_TRIAL", 0);
    first..first + number_from_environment("PHASEWARP_TRIALS", KINDS.len() as u64)
}

const FAULTS: [(&str, Fault); 7] = [
    ("SIGKILL to mpirun", Fault::Launcher),
    ("SIGKILL to a rank", Fault::Rank(0)),
    ("SIGKILL to a rank", Fault::Rank(1)),
    ("SIGTERM to mpirun", Fault::Terminate),
    ("SIGINT to mpirun", Fault::Interrupt),
    ("SIGUSR1 to mpirun", Fault::Signal),
    ("SIGSTOP of a rank for half a second", Fault::Pause(0)),
];

/// Trials of each fault: how many, how many of them met a run at work, how many failed.
type Tally = Mutex<BTreeMap<&'static str, [usize; 3]>>;

/// Up to three faults at random moments, then an end that is left alone.
fn trial(number: u64, tally: &Tally) -> Result<()> {
    let draw = |what: u64, of: usize| (random(101 * number + what) * of as f64) as usize;
    let index = number as usize % KINDS.len();
    let kind = &KINDS[index];
    let whole = WHOLES[index].get_or_init(|| Whole::new(kind)).as_ref().map_err(String::clone)?;
    let place = directory();
    let path = place.path();
    let mut faults = Vec::new();
    for part in 0..1 + draw(0, 3) as u64 {
        let [of, moment, ranks] = [1, 2, 3].map(|what| 10 * (part + 1) + what);
        let (name, fault) = FAULTS[draw(of, FAULTS.len())];
        let after = Duration::from_secs_f64(1.05 * whole.seconds * random(101 * number + moment));
        let ranks = 1 + draw(ranks, 4);
        let job = kind.job().with(["--resume"]).on(ranks).into(path);
        let finished = with_fault(&job, fault, |since| since > after)?;
        let met = finished.code != Some(0);
        let mut tally = tally.lock().map_err(|e| e.to_string())?;
        let counts = tally.entry(name).or_default();
        *counts = [counts[0] + 1, counts[1] + usize::from(met), counts[2]];
        faults.push((name, after, ranks, finished.report("with a fault")));
    }
    let ended = ends(kind, path, 1 + draw(99, 4), whole);
    ended.map_err(|why| {
        if let (Ok(mut tally), Some((name, ..))) = (tally.lock(), faults.last()) {
            tally.entry(name).or_default()[2] += 1;
        }
        format!("trial {number}, {}: {why}\n{faults:?}", kind.name)
    })
}

/// Continues to the end. The result equals that of the whole run, and no temporary file is left.
fn ends(kind: &Kind, path: &Path, ranks: usize, whole: &Whole) -> Result<()> {
    kind.job().on(ranks).with(["--resume"]).into(path).succeed()?;
    let differing = differences(&datasets(path)?, &whole.datasets);
    if !differing.is_empty() {
        return Err(format!("differs from the whole run in {differing:?}"));
    }
    let names = fs::read_dir(path).map_err(|e| e.to_string())?;
    let mut names = names.filter_map(|entry| entry.ok()?.file_name().into_string().ok());
    match names.find(|name| name.ends_with(".partial") || name == "checkpoint") {
        Some(name) => Err(format!("{name} is still there")),
        None => Job::new(["check-result", &path.display().to_string()]).succeed().map(drop),
    }
}

#[test]
fn runs_of_all_kinds_survive_any_fault() {
    let tally = Tally::default();
    let all: Vec<u64> = trials().collect();
    check_all(&all, |&number| trial(number, &tally));
    let tally = tally.into_inner().expect("no thread failed");
    println!("| fault | faults | met a run at work | failures |\n|---|---|---|---|");
    for (name, [faults, met, failures]) in tally {
        println!("| {name} | {faults} | {met} | {failures} |");
    }
}
