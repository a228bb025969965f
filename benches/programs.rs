//! Whole-program runs: what a user waits for, counted and timed.
//!
//! `cargo bench --bench programs -- [--quick] [--counts] [--only TABLE] [--output FILE]` starts the
//! program under mpirun as a user would, on the cases of `cases/`, and writes one JSON file with
//! every figure. `scripts/bench/report.py` makes the tables of docs/performance.md from it.
//!
//! A timed run is repeated, with a triad right before it; rows that are compared take turns.
//! Errors, which are the same bits each time, come from one more run with `solver.verify`.
//! `--counts` times nothing: every row runs once, which gives modes, applications, errors and
//! memory on a machine that others use. `--only` leaves out all other tables.

use serde_json::{Map, Value, json};
use std::hint::black_box;
use std::path::{Path, PathBuf};
use std::process::{Command, ExitCode};
use std::time::{Duration, Instant};

/// Ranks of a run unless the row says otherwise.
const RANKS: usize = 2;
/// Seconds after which a row is not run again.
const ENOUGH: Duration = Duration::from_secs(8);
const TOLERANCES: [&str; 4] = ["1e-3", "1e-6", "1e-9", "1e-11"];

type Outcome<T> = Result<T, Box<dyn std::error::Error>>;

/// A row of a table: a case with changes, and what is measured of it.
#[derive(Clone)]
struct Row {
    table: &'static str,
    case: &'static str,
    set: Vec<String>,
    ranks: usize,
    /// What the row stands for, by name: cells, time, tolerance, …
    labels: Map<String, Value>,
    measure: Measure,
}

#[derive(Clone, Copy, PartialEq)]
enum Measure {
    /// `phasewarp plan --json`: nothing is solved.
    Plan,
    /// Timed.
    Time,
    /// Timed, and one run more that measures the distance to exp(AT).
    TimeAndError,
}

impl Row {
    fn new(table: &'static str, case: &'static str, measure: Measure) -> Self {
        Self { table, case, set: Vec::new(), ranks: RANKS, labels: Map::new(), measure }
    }

    fn set(mut self, key: &str, value: &str) -> Self {
        self.set.push(format!("{key}={value}"));
        self
    }

    fn label(mut self, name: &str, value: impl Into<Value>) -> Self {
        self.labels.insert(name.into(), value.into());
        self
    }

    fn on(mut self, ranks: usize) -> Self {
        self.ranks = ranks;
        self.label("ranks", ranks)
    }

    fn tolerance(self, tolerance: &str) -> Self {
        let value: f64 = tolerance.parse().unwrap_or(f64::NAN);
        self.set("solver.tolerance", tolerance).label("tolerance", value)
    }

    /// `n` cells on every axis.
    fn cells(mut self, n: usize) -> Self {
        let axes = if self.case == "example3" { 2 } else { 1 };
        for axis in 0..axes {
            for kind in ["x", "v"] {
                self = self.set(&format!("axis.{axis}.{kind}.cells"), &n.to_string());
            }
        }
        self.label("cells", n)
    }

    fn arguments(&self, verb: &str, extra: &[String]) -> Vec<String> {
        let case = Path::new(env!("CARGO_MANIFEST_DIR")).join(format!("cases/{}.toml", self.case));
        let mut words = vec![verb.to_owned(), case.display().to_string()];
        for setting in &self.set {
            words.extend(["--set".to_owned(), setting.clone()]);
        }
        words.extend_from_slice(extra);
        words
    }

    /// What to paste into a shell.
    fn command(&self) -> String {
        let plain = |c: char| c.is_ascii_alphanumeric() || "-_./=,:".contains(c);
        let mut text = match self.measure {
            Measure::Plan => format!("phasewarp plan cases/{}.toml", self.case),
            _ => format!("mpirun -np {} phasewarp run cases/{}.toml", self.ranks, self.case),
        };
        for setting in &self.set {
            text += &if setting.chars().all(plain) {
                format!(" --set {setting}")
            } else {
                format!(" --set '{setting}'")
            };
        }
        text
    }

    fn plan(&self) -> Outcome<Value> {
        let words = self.arguments("plan", &["--json".into(), "--ranks".into(), "2".into()]);
        let finished = Command::new(env!("CARGO_BIN_EXE_phasewarp")).args(&words).output()?;
        if !finished.status.success() {
            return Err(self.failure(&finished.stderr));
        }
        Ok(serde_json::from_slice(&finished.stdout)?)
    }

    /// One run: seconds from outside, and its summary.
    fn run(&self, directory: &Path, extra: &[&str]) -> Outcome<(f64, Value)> {
        let mut more =
            ["-o", &directory.display().to_string(), "--force"].map(str::to_owned).to_vec();
        for setting in extra {
            more.extend(["--set".to_owned(), (*setting).to_owned()]);
        }
        let mut command = Command::new("mpirun");
        command
            .args(["-np", &self.ranks.to_string()])
            .arg(env!("CARGO_BIN_EXE_phasewarp"))
            .args(self.arguments("run", &more));
        let start = Instant::now();
        let finished = command.output()?;
        let seconds = start.elapsed().as_secs_f64();
        if !finished.status.success() {
            return Err(self.failure(&finished.stderr));
        }
        let summary = std::fs::read_to_string(directory.join("summary.json"))?;
        Ok((seconds, serde_json::from_str(&summary)?))
    }

    fn failure(&self, errors: &[u8]) -> Box<dyn std::error::Error> {
        format!("{}\n  failed: {}", self.command(), String::from_utf8_lossy(errors).trim()).into()
    }

    /// Timed runs: more where it is the seconds that are looked at, not how they grow.
    fn repeats(&self) -> usize {
        match self.table {
            "tolerance" | "ranks" => 5,
            _ => 3,
        }
    }

    /// Everything about the row as JSON but seconds; without the summary of a run that `is_timed`.
    fn counted(&self, directory: &Path, is_timed: bool) -> Outcome<Value> {
        let plan = self.plan()?;
        let mut found = json!({
            "table": self.table, "case": self.case, "command": self.command(),
            "labels": self.labels,
            "plan": {
                "rate": plan["bounds"]["rate"], "decay": plan["bounds"]["decay"],
                "growth": plan["bounds"]["growth"], "time": plan["time"], "cells": plan["cells"],
                "fields": plan["fields"], "profile": plan["warp"]["profile"]["kind"],
                "period": plan["warp"]["series"]["period"], "modes": plan["warp"]["modes"],
                "applications": plan["warp"]["applications"],
            },
        });
        if self.measure == Measure::TimeAndError {
            let (_, summary) = self.run(directory, &["solver.verify=true"])?;
            found["error_semidiscrete"] = summary["error_semidiscrete"].clone();
        }
        if self.measure != Measure::Plan && !is_timed {
            found["summary"] = self.run(directory, &[])?.1;
        }
        Ok(found)
    }

    /// Whether runs of this row and of `other` take turns, so that the machine's pace is that of
    /// both: rows whose seconds are compared with each other.
    fn takes_turns_with(&self, other: &Row) -> bool {
        let which = |row: &Row| (row.case, row.labels.get("error").cloned());
        self.table == "error" && other.table == "error" && which(self) == which(other)
    }
}

/// Timed runs of a row.
#[derive(Default)]
struct Times {
    wall: Vec<f64>,
    solve: Vec<f64>,
    triads: Vec<f64>,
    summaries: Vec<Value>,
}

impl Times {
    /// One more run of `row`.
    fn add(&mut self, row: &Row, directory: &Path) -> Outcome<()> {
        self.triads.push(triad());
        let (seconds, summary) = row.run(directory, &[])?;
        self.wall.push(seconds);
        self.solve.push(summary["solve_seconds"].as_f64().ok_or("no solve_seconds")?);
        self.summaries.push(summary);
        Ok(())
    }

    fn write(mut self, found: &mut Value) {
        // Parts of the run whose whole took the median.
        found["summary"] = self.summaries.swap_remove(middle(&self.solve));
        found["wall_seconds"] = json!(self.wall);
        found["solve_seconds"] = json!(self.solve);
        found["triad"] = json!(self.triads);
    }
}

/// Everything about `rows` as JSON, with so many timed runs of each, in turns; with none they are
/// run, but not timed.
fn measured(rows: &[Row], directory: &Path, repeats: usize) -> Outcome<Vec<Value>> {
    let counted = rows.iter().map(|row| row.counted(directory, repeats > 0));
    let mut found = counted.collect::<Outcome<Vec<Value>>>()?;
    let mut times: Vec<Times> = rows.iter().map(|_| Times::default()).collect();
    for round in 0..repeats {
        for (row, times) in rows.iter().zip(&mut times) {
            let is_enough = round > 0 && times.wall.iter().sum::<f64>() > ENOUGH.as_secs_f64();
            if row.measure != Measure::Plan && !is_enough {
                times.add(row, directory)?;
            }
        }
    }
    for (times, found) in times.into_iter().zip(&mut found) {
        if !times.wall.is_empty() {
            times.write(found);
        }
    }
    Ok(found)
}

/// Bytes per second of `a ← b + 3 c` by one core on arrays far larger than the caches of a core,
/// the best of three.
fn triad() -> f64 {
    let n = 4 << 20;
    let (mut a, b, c) = (vec![0.0; n], vec![1.0; n], vec![2.0; n]);
    let mut best = f64::INFINITY;
    for _ in 0..4 {
        let start = Instant::now();
        for i in 0..n {
            a[i] = b[i] + 3.0 * c[i];
        }
        black_box(&mut a);
        best = best.min(start.elapsed().as_secs_f64());
    }
    24.0 * n as f64 / best
}

/// Index of the (lower) median.
fn middle(values: &[f64]) -> usize {
    let mut order: Vec<usize> = (0..values.len()).collect();
    order.sort_by(|a, b| values[*a].total_cmp(&values[*b]));
    order[(order.len() - 1) / 2]
}

/// Grids that reach an error of the exact solution: relative L2 of the smooth case, relative L1 of
/// example 1.
struct Reached {
    case: &'static str,
    error: f64,
    /// Cells an axis of van Leer's slopes with SSP-RK3; none where they take half an
    /// hour.
    limited: Option<usize>,
    /// Degree and elements an axis of the modes, and of the same system integrated directly.
    elements: [usize; 2],
    /// Their flux.
    flux: &'static str,
}

const REACHED: [Reached; 5] = [
    Reached {
        case: "smooth-beams",
        error: 5e-2,
        limited: Some(392),
        elements: [4, 24],
        flux: "0.5",
    },
    Reached {
        case: "smooth-beams",
        error: 1e-2,
        limited: Some(1024),
        elements: [6, 20],
        flux: "0.5",
    },
    Reached { case: "smooth-beams", error: 1e-3, limited: None, elements: [6, 30], flux: "0.5" },
    // The upwind flux, for velocities that nothing reaches are left out only then.
    Reached { case: "example1", error: 1e-1, limited: Some(106), elements: [3, 26], flux: "1" },
    Reached { case: "example1", error: 5e-2, limited: Some(264), elements: [3, 58], flux: "1" },
];

/// Seconds to an error of the exact solution, modes beside the classical methods.
fn by_error(quick: bool) -> Vec<Row> {
    let mut rows = Vec::new();
    for Reached { case, error, limited, elements: [degree, elements], flux } in REACHED {
        if quick && error < 5e-2 {
            continue;
        }
        let row = |method: &str| {
            Row::new("error", case, Measure::Time).label("error", error).label("method", method)
        };
        if let Some(cells) = limited {
            let row = row("van Leer, SSP-RK3").cells(cells).set("scheme.degree", "0");
            let row = row.set("scheme.limiter", "van-leer").set("solver.method", "classical");
            rows.push(row.set("solver.classical.integrator", "ssp-rk3"));
        }
        let of_elements = |method: &str| {
            let row = row(method).cells(elements).label("degree", degree);
            row.set("scheme.degree", &degree.to_string()).set("scheme.flux", flux)
        };
        rows.push(of_elements("elements, exp(AT)").set("solver.method", "classical"));
        rows.push(of_elements("modes").tolerance(&format!("{:e}", error / 10.0)));
    }
    rows
}

fn rows(quick: bool) -> Vec<Row> {
    use Measure::{Plan, Time, TimeAndError};
    let mut rows = Vec::new();
    let pick = |all: &[usize], few: usize| -> Vec<usize> {
        all.iter().copied().take(if quick { few } else { all.len() }).collect()
    };

    // Examples at several tolerances.
    for case in ["example1", "example2", "example3"] {
        for tolerance in TOLERANCES.into_iter().take(if quick { 2 } else { 4 }) {
            let row = Row::new("tolerance", case, TimeAndError).tolerance(tolerance);
            rows.push(if quick && case == "example2" { row.cells(64) } else { row });
        }
    }
    // One rank and two.
    for (case, tolerance) in [("example1", "1e-6"), ("example1", "1e-9")] {
        for ranks in [1, 2] {
            rows.push(Row::new("ranks", case, Time).tolerance(tolerance).on(ranks));
        }
    }
    // Growth with cells, time and points in p.
    for n in pick(&[32, 64, 128, 256, 512], 3) {
        rows.push(Row::new("cells", "example1", Time).cells(n));
    }
    for n in pick(&[6, 8, 12, 16], 3) {
        rows.push(Row::new("cells4", "example3", Time).cells(n));
    }
    for end in ["0.25", "0.5", "1", "2", "4"].into_iter().take(if quick { 3 } else { 5 }) {
        let value: f64 = end.parse().unwrap_or(f64::NAN);
        rows.push(Row::new("time", "example1", Time).set("time.end", end).label("time", value));
    }
    for points in pick(&[64, 128, 256, 512, 1024], 3) {
        let row = Row::new("points", "example1", TimeAndError)
            .cells(32)
            .set("solver.warp.profile", "exponential");
        rows.push(row.set("solver.warp.points", &points.to_string()).label("points", points));
    }
    // Applications as planned, over Λ and over the tolerance.
    let spans: &[usize] = &[8, 16, 32, 64, 128, 256, 512, 1024, 2048];
    for tolerance in ["1e-3", "1e-6", "1e-9"] {
        for n in pick(spans, 5) {
            rows.push(Row::new("span", "example1", Plan).tolerance(tolerance).cells(n));
        }
    }
    for exponent in 2..=12 {
        rows.push(Row::new("digits", "example1", Plan).tolerance(&format!("1e-{exponent}")));
    }
    rows.extend(by_error(quick));
    rows
}

/// First words of a command's output, or "unknown".
fn said(program: &str, arguments: &[&str]) -> String {
    let output =
        Command::new(program).args(arguments).current_dir(env!("CARGO_MANIFEST_DIR")).output();
    match output {
        Ok(o) if o.status.success() => String::from_utf8_lossy(&o.stdout).trim().to_owned(),
        _ => "unknown".to_owned(),
    }
}

fn machine() -> Value {
    let read = |path: &str| std::fs::read_to_string(path).unwrap_or_default();
    let (processor, memory) = (read("/proc/cpuinfo"), read("/proc/meminfo"));
    let value = |text: &str, key: &str| {
        text.lines()
            .find_map(|l| l.strip_prefix(key)?.split_once(':'))
            .map_or("unknown".to_owned(), |(_, v)| v.trim().to_owned())
    };
    let cache = |index: usize| {
        let folder = format!("/sys/devices/system/cpu/cpu0/cache/index{index}");
        read(&format!("{folder}/size")).trim().to_owned()
    };
    json!({
        "processor": value(&processor, "model name"),
        "cores": std::thread::available_parallelism().map_or(0, usize::from),
        "l1": cache(0), "l2": cache(2), "l3": cache(3),
        "memory": value(&memory, "MemTotal"),
        "rustc": said("rustc", &["--version"]),
        "mpi": said("mpirun", &["--version"]).lines().next().unwrap_or_default(),
        "commit": said("git", &["describe", "--always", "--dirty"]),
        "version": env!("CARGO_PKG_VERSION"),
        "load": load(),
    })
}

/// Cores that work for others, on average over two seconds in which this process sleeps; -1 if
/// unknown.
fn load() -> f64 {
    // Ticks of all cores since the start of the machine: all, and those at work.
    let ticks = || {
        let text = std::fs::read_to_string("/proc/stat").unwrap_or_default();
        let line = text.lines().next().unwrap_or_default();
        let kinds: Vec<f64> = line.split_whitespace().filter_map(|w| w.parse().ok()).collect();
        // user, nice, system, idle, iowait, irq, softirq, steal.
        let all: f64 = kinds.iter().take(8).sum();
        let idle: f64 = kinds.iter().skip(3).take(2).sum();
        [all, all - idle]
    };
    let before = ticks();
    std::thread::sleep(Duration::from_secs(2));
    let after = ticks();
    let cores = std::thread::available_parallelism().map_or(0, usize::from) as f64;
    let load = cores * (after[1] - before[1]) / (after[0] - before[0]);
    if load.is_finite() { load } else { -1.0 }
}

/// The arguments of the command line.
struct Arguments {
    quick: bool,
    counts: bool,
    /// The table whose rows alone are measured.
    only: Option<String>,
    output: PathBuf,
}

fn all(arguments: &Arguments) -> Outcome<()> {
    let &Arguments { quick, counts, ref only, ref output } = arguments;
    let place = tempfile::tempdir()?;
    let mut found = json!({ "quick": quick, "machine": machine(), "rows": [] });
    let mut rows = rows(quick);
    rows.retain(|row| only.as_deref().is_none_or(|table| row.table == table));
    if rows.is_empty() {
        return Err(format!("no table {}", only.as_deref().unwrap_or_default()).into());
    }
    let start = Instant::now();
    let mut number = 0;
    for together in rows.chunk_by(Row::takes_turns_with) {
        let repeats = match (counts, quick) {
            (true, _) => 0,
            (false, true) => 1,
            (false, false) => together[0].repeats(),
        };
        for (row, value) in together.iter().zip(measured(together, place.path(), repeats)?) {
            number += 1;
            let shown = match value["solve_seconds"][0].as_f64() {
                Some(seconds) => format!("solve {seconds:.4} s"),
                None => format!("{} applications", value["plan"]["applications"]),
            };
            println!("{number}/{} {}: {shown}", rows.len(), row.command());
            if let Some(list) = found["rows"].as_array_mut() {
                list.push(value);
            }
        }
    }
    found["seconds"] = json!(start.elapsed().as_secs_f64());
    if let Some(parent) = output.parent() {
        std::fs::create_dir_all(parent)?;
    }
    std::fs::write(output, serde_json::to_string_pretty(&found)? + "\n")?;
    println!("{}", output.display());
    Ok(())
}

fn main() -> ExitCode {
    let words: Vec<String> = std::env::args().skip(1).collect();
    let given = |option: &str| words.iter().any(|w| w == option);
    let value = |option: &str| {
        let place = words.iter().position(|w| w == option);
        place.and_then(|at| words.get(at + 1))
    };
    let standard = Path::new(env!("CARGO_MANIFEST_DIR")).join("results/bench/programs.json");
    let arguments = Arguments {
        quick: given("--quick"),
        counts: given("--counts"),
        only: value("--only").cloned(),
        output: value("--output").map_or(standard, PathBuf::from),
    };
    match all(&arguments) {
        Ok(()) => ExitCode::SUCCESS,
        Err(error) => {
            eprintln!("programs: {error}");
            ExitCode::FAILURE
        }
    }
}
