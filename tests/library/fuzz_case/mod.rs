//! Random case files: whatever is in them, reading ends soon, with a sound case or with a message,
//! and never with a panic.
//!
//! The same mutations every time, about ten seconds of them; `PHASEWARP_FUZZ=1000000 cargo test
//! --release --test library fuzz_case` tries that many others, new ones each time.

mod mutate;

use mutate::{TERMS, WORDS, apply, change};
use phasewarp::matrix::bounds::Bounds;
use phasewarp::plan::Plan;
use phasewarp::plan::layout::Resources;
use phasewarp::problem::case::{Case, Exact, Inflow};
use phasewarp::problem::formula::{Constants, Expression};
use proptest::prelude::*;
use proptest::test_runner::{Config, RngAlgorithm, TestError, TestRng, TestRunner};
use std::cell::Cell;
use std::sync::mpsc::{RecvTimeoutError, Sender, channel};
use std::time::{Duration, Instant};

/// Longest time for one text; a hang is an endless one.
const SECONDS_A_TEXT: u64 = 5;

/// `cases/*.toml`, sorted by name.
fn cases() -> Vec<String> {
    let folder = concat!(env!("CARGO_MANIFEST_DIR"), "/cases");
    let mut paths: Vec<_> = std::fs::read_dir(folder)
        .expect("cases/ is there")
        .filter_map(|e| Some(e.ok()?.path()))
        .filter(|p| p.extension().is_some_and(|e| e == "toml"))
        .collect();
    paths.sort();
    assert!(paths.len() >= 7, "{paths:?}");
    paths.iter().map(|p| std::fs::read_to_string(p).expect("a case is text")).collect()
}

/// Values in the corners and the middle of the box, and where there is nothing.
fn evaluate(formula: &Expression) {
    for value in [0.0, -1.0, 0.3, 1e300, f64::NAN, f64::INFINITY] {
        formula.eval(&[value; 7]);
        formula.holds(&[value; 7]);
    }
}

/// What `Case::parse` promises, or why not.
fn sound(text: &str, overrides: &[String]) -> Result<bool, String> {
    let case = match Case::parse("fuzz.toml", text, overrides) {
        Ok(case) => case,
        Err(error) => {
            let message = error.to_string();
            let named = message.starts_with("fuzz.toml") || message.starts_with("--set ");
            return match (error.exit_code(), named && message.len() > "fuzz.toml: ".len()) {
                (2, true) => Ok(false),
                (code, _) => Err(format!("exit code {code}, message: {message}")),
            };
        }
    };
    let holds = [
        (
            "1 to 3 dimensions",
            (1..=3).contains(&case.space.x.len()) && case.space.x.len() == case.space.v.len(),
        ),
        ("time.end", case.end > 0.0 && case.end.is_finite()),
        ("tolerance", case.tolerance > 0.0 && case.tolerance <= 0.1),
        ("cfl", case.cfl > 0.0 && case.cfl <= 1.0),
        ("recovery_points", (1..=2).contains(&case.recovery_points)),
        ("compression", case.storage.compression <= 9),
        (
            "chunks",
            (case.storage.chunks.iter())
                .all(|c| c.len() == 2 * case.space.x.len() && c.iter().all(|&cells| cells > 0)),
        ),
        ("cells", case.space.axes().all(|a| a.cells >= 1)),
        (
            "bounds",
            case.space
                .axes()
                .all(|a| a.lower < a.upper && a.width().is_finite() && a.width() > 0.0),
        ),
        ("last region", case.potential.last().is_some_and(|r| r.condition.is_none())),
        ("other regions", case.potential.iter().rev().skip(1).all(|r| r.condition.is_some())),
    ];
    for region in &case.potential {
        evaluate(&region.value);
        region.condition.iter().for_each(evaluate);
    }
    for field in &case.fields {
        evaluate(&field.initial);
        if let Inflow::Formula(formula) = &field.inflow {
            evaluate(formula);
        }
    }
    if let Some(Exact::Formula(formula)) = &case.exact {
        evaluate(formula);
    }
    if let Some((what, _)) = holds.iter().find(|(_, holds)| !holds) {
        return Err(format!("accepted, but {what} is unsound: {case:?}"));
    }
    // Small ones are planned, too.
    if case.space.cells() < 2000 && Bounds::new(&case).is_ok_and(|b| b.rate * case.end < 100.0) {
        let resources = Resources { ranks: 3, ..Resources::default() };
        if let Err(error) = Plan::new(&case, &resources, 1.5)
            && error.exit_code() != 2
        {
            return Err(format!("exit code {} of the plan: {error}", error.exit_code()));
        }
    }
    Ok(true)
}

/// Runs `test` on values of `strategy` on a thread of its own, as large as the program's, and fails
/// if a value takes too long. Every value is announced to the channel before it is tried. Returns
/// how many of them `test` found true.
fn fuzz<S>(count: u32, strategy: fn() -> S, test: fn(&S::Value) -> Result<bool, String>)
where
    S: Strategy + 'static,
    S::Value: std::fmt::Debug,
{
    let (announce, announced) = channel();
    let wanted: Option<u32> = std::env::var("PHASEWARP_FUZZ").ok().and_then(|n| n.parse().ok());
    let work = move |announce: Sender<String>| {
        let config = Config {
            cases: wanted.unwrap_or(count),
            failure_persistence: None,
            ..Config::default()
        };
        let mut runner = match wanted {
            None => {
                TestRunner::new_with_rng(config, TestRng::deterministic_rng(RngAlgorithm::ChaCha))
            }
            Some(_) => TestRunner::new(config),
        };
        let (accepted, tried, slowest) = (Cell::new(0), Cell::new(0), Cell::new(0.0f64));
        let outcome = runner.run(&strategy(), |value| {
            let _ = announce.send(format!("{value:?}"));
            let started = Instant::now();
            let outcome = test(&value);
            slowest.set(slowest.get().max(started.elapsed().as_secs_f64()));
            tried.set(tried.get() + 1);
            accepted.set(accepted.get() + u32::from(outcome == Ok(true)));
            outcome.map(|_| ()).map_err(TestCaseError::fail)
        });
        if let Err(TestError::Fail(reason, value)) = outcome {
            panic!("{reason}\nfor {value:?}");
        }
        (accepted.get(), tried.get(), slowest.get())
    };
    let thread = std::thread::Builder::new()
        .stack_size(8 << 20)
        .spawn(move || work(announce))
        .expect("a thread");
    let mut last = String::new();
    loop {
        match announced.recv_timeout(Duration::from_secs(SECONDS_A_TEXT)) {
            Ok(value) => last = value,
            Err(RecvTimeoutError::Timeout) => panic!("no end after {SECONDS_A_TEXT} s of {last}"),
            Err(RecvTimeoutError::Disconnected) => break,
        }
    }
    match thread.join() {
        Ok((accepted, tried, slowest)) => {
            println!("{accepted} of {tried} accepted, the slowest took {slowest:.3} s");
            // Neither everything nor nothing is a case: the mutations are of the right size.
            assert!(accepted * 200 > tried, "only {accepted} of {tried} are accepted");
            assert!(accepted * 10 < tried * 9, "{accepted} of {tried} are accepted");
        }
        Err(panic) => std::panic::resume_unwind(panic),
    }
}

fn texts() -> impl Strategy<Value = String> {
    let cases = cases();
    let changes = prop::collection::vec(change(), 1..6);
    (0..cases.len(), changes).prop_map(move |(k, changes)| {
        let mut text = cases[k].clone();
        changes.iter().for_each(|c| apply(&mut text, c));
        text
    })
}

#[test]
fn mutated_cases_end_in_a_case_or_a_message() {
    fuzz(60_000, texts, |text| sound(text, &[]));
}

fn settings() -> impl Strategy<Value = (usize, Vec<String>)> {
    const KEYS: &[&str] = &[
        "axis.0.x.cells", "axis.0.v.lower", "axis.1.x", "axis", "potential.0.where",
        "potential.1.value", "potential", "initial.f", "initial.warped", "initial", "inflow.value",
        "time.end", "solver.tolerance", "solver.warp.weights", "solver.warp.profile",
        "solver.warp.alpha", "solver.warp.order", "solver.warp.c", "solver.warp.beta",
        "solver.warp.coefficients", "solver.warp.interval", "solver.warp.points",
        "solver.warp.recovery", "solver.warp.recovery_method", "output.plateau",
        "output.plateau.from", "output.plateau.points", "output.moments_every",
        "output.moment_times", "output.field_times", "solver.warp.inflow", "solver.warp.delta",
        "solver.warp.shift", "solver", "exact.f", "exact", "output.recovery_points",
        "output.warped_field", "output.compression", "output.chunks", "output.xdmf", "title", "",
        ".", "axis.-1.x", "a.b.c.d.e",
    ];
    let words = prop::collection::vec(0..WORDS.len(), 0..5);
    let setting = (0..KEYS.len(), words).prop_map(|(key, words)| {
        let value: String = words.iter().map(|&w| WORDS[w]).collect();
        format!("{}={value}", KEYS[key])
    });
    (0..cases().len(), prop::collection::vec(setting, 1..3))
}

#[test]
fn mutated_overrides_end_in_a_case_or_a_message() {
    fuzz(60_000, settings, |(k, settings)| sound(&cases()[*k], settings));
}

fn formulas() -> impl Strategy<Value = String> {
    let words = prop::collection::vec(0..TERMS.len(), 1..25);
    let random = words.prop_map(|words| words.iter().map(|&w| TERMS[w]).collect::<String>());
    // Half of the formulas that make sense are built to make sense: `a op b`, `f(a)`.
    let leaf =
        prop::sample::select(vec!["x", "v", "pi", "0.5", "1e-3", "2", "0"]).prop_map(str::to_owned);
    let built = leaf.prop_recursive(5, 40, 2, |inner| {
        let operator = prop::sample::select(vec![
            "+", "-", "*", "/", "^", "<", ">=", "==", "!=", "&&", "||", " if ", " else ",
        ]);
        let function =
            prop::sample::select(vec!["abs", "sqrt", "exp", "-", "!", "step", "cos", ""]);
        prop_oneof![
            (inner.clone(), operator, inner.clone()).prop_map(|(a, o, b)| format!("{a}{o}{b}")),
            (function, inner.clone()).prop_map(|(f, a)| format!("{f}({a})")),
            (inner.clone(), inner).prop_map(|(a, b)| format!("min({a}, {b})")),
        ]
    });
    prop_oneof![random, built]
}

#[test]
fn random_formulas_end_in_a_value_or_a_message() {
    fuzz(60_000, formulas, |formula| {
        let names: [&[&str]; 7] = [&["x"], &[], &[], &["v", "vx"], &[], &[], &["t"]];
        match Expression::parse(formula, &names, &Constants::new()) {
            Ok(read) => {
                evaluate(&read);
                if read.text() != formula {
                    return Err(format!("read as {}", read.text()));
                }
                Ok(true)
            }
            Err(message) if message.is_empty() => Err("no message".to_owned()),
            Err(_) => Ok(false),
        }
    });
}

/// The fuzzer itself notices what it should: a test that fails for some values.
#[test]
#[should_panic(expected = "holds a seven")]
fn the_fuzzer_finds_a_needle() {
    fuzz(
        10_000,
        || 0..1000u32,
        |&n| match n {
            777 => Err("holds a seven".to_owned()),
            n => Ok(n % 2 == 0),
        },
    );
}
