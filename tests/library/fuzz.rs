//! Random case files, `--set` options and formulas: for any contents, reading ends soon with a
//! valid case or with a message.
//!
//! The texts are random changes of those in `cases/` and `tests/corpus/`.

use crate::fuzzing::mutate::Corpus;
use crate::fuzzing::{Random, Reader, finds, fuzz};
use phasewarp::matrix::bounds::Bounds;
use phasewarp::plan::Plan;
use phasewarp::plan::layout::Resources;
use phasewarp::problem::case::{Case, Exact, Inflow, ValueKind, keys};
use phasewarp::problem::formula::{Constants, Expression};
use std::fmt::Debug;

/// The texts of the files in a folder with this extension, sorted by name.
fn texts(folder: &str, ending: &str) -> Vec<String> {
    let folder = std::path::Path::new(env!("CARGO_MANIFEST_DIR")).join(folder);
    let mut paths: Vec<_> = std::fs::read_dir(&folder)
        .expect("the folder is there")
        .filter_map(|e| Some(e.ok()?.path()))
        .filter(|p| p.extension().is_some_and(|e| e == ending))
        .collect();
    paths.sort();
    paths.iter().map(|p| std::fs::read_to_string(p).expect("a text")).collect()
}

/// Valid case files.
fn cases() -> Corpus {
    let all = [texts("cases", "toml"), texts("tests/corpus", "toml")].concat();
    assert!(all.len() >= 12, "{} files", all.len());
    Corpus::new(all)
}

/// Evaluates a formula at points inside and outside of the box.
fn evaluate(formula: &Expression) {
    for value in [0.0, -1.0, 0.3, 1e300, f64::NAN, f64::INFINITY] {
        formula.eval(&[value; 7]);
        formula.holds(&[value; 7]);
    }
}

/// Checks the guarantees of `Case::parse` and returns whether the case is accepted. The error names
/// the violated guarantee.
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
        ("cfl", case.classical.cfl > 0.0 && case.classical.cfl <= 1.0),
        ("recovery_points", (1..=2).contains(&case.output.recovery_points)),
        ("compression", case.output.storage.compression <= 9),
        (
            "chunks",
            (case.output.storage.chunks.iter())
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
        return Err(format!("accepted, but {what} is invalid: {case:?}"));
    }
    // Small cases are also planned.
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

struct Cases(Corpus);

impl Reader for Cases {
    type Input = String;
    const INPUTS: u64 = 30_000;
    fn new() -> Self {
        Self(cases())
    }
    fn input(&self, random: &mut Random) -> String {
        self.0.changed(random)
    }
    fn read(&mut self, text: &String) -> Result<bool, String> {
        sound(text, &[])
    }
}

#[test]
fn changed_cases_end_in_a_case_or_a_message() {
    fuzz::<Cases>("fuzz::changed_cases_end_in_a_case_or_a_message");
}

/// A case and `--set` options for it.
#[derive(Debug)]
struct Options {
    case: usize,
    settings: Vec<String>,
}

struct Settings {
    corpus: Corpus,
    /// All valid keys of a case file, and some invalid ones.
    keys: Vec<String>,
}

/// Collects the keys below `path`; for lists, those of the first two entries.
fn flat(path: &str, kind: &ValueKind, found: &mut Vec<String>) {
    found.push(path.trim_start_matches('.').to_owned());
    match kind {
        ValueKind::Table(entries) | ValueKind::Switches(entries) => {
            entries.iter().for_each(|(name, kind)| flat(&format!("{path}.{name}"), kind, found));
        }
        ValueKind::List(item) => (0..2).for_each(|k| flat(&format!("{path}.{k}"), item, found)),
        ValueKind::Names(item) => flat(&format!("{path}.c"), item, found),
        _ => {}
    }
}

impl Reader for Settings {
    type Input = Options;
    const INPUTS: u64 = 30_000;
    fn new() -> Self {
        let mut list =
            [".", "axis.-1.x", "axis.9.x", "a.b.c.d.e", "=", "é"].map(str::to_owned).to_vec();
        flat("", &keys(), &mut list);
        Self { corpus: cases(), keys: list }
    }
    fn input(&self, random: &mut Random) -> Options {
        let Corpus { texts, words, values, pairs } = &self.corpus;
        let settings = (0..=random.below(3)).map(|_| {
            let key = random.of_list(&self.keys);
            let last = key.rsplit('.').next().unwrap_or_default();
            let of_key: Vec<&String> =
                pairs.iter().filter(|(key, _)| key == last).map(|(_, value)| value).collect();
            let value = match random.below(8) {
                0..=4 if !of_key.is_empty() => random.of_list(&of_key).to_string(),
                0..=5 => random.of_list(values).clone(),
                6 => random.of_list(words).clone(),
                _ => (0..random.below(6)).map(|_| random.of_list(words).as_str()).collect(),
            };
            format!("{key}={value}")
        });
        Options { settings: settings.collect(), case: random.below(texts.len()) }
    }
    fn read(&mut self, Options { case, settings }: &Options) -> Result<bool, String> {
        sound(&self.corpus.texts[*case], settings)
    }
}

#[test]
fn changed_settings_end_in_a_case_or_a_message() {
    fuzz::<Settings>("fuzz::changed_settings_end_in_a_case_or_a_message");
}

struct Formulas(Corpus);

impl Formulas {
    /// A formula that is built from operators and functions: `a op b`, `f(a)`.
    fn built(&self, random: &mut Random, depth: usize) -> String {
        const OPERATORS: [&str; 13] =
            ["+", "-", "*", "/", "^", "<", ">=", "==", "!=", "&&", "||", " if ", " else "];
        const FUNCTIONS: [&str; 14] = [
            "abs", "sqrt", "exp", "-", "!", "step", "cos", "", "ln", "sign", "floor", "sin",
            "tanh", "atan",
        ];
        if depth == 0 || random.once_in(5) {
            return random.of_list(&["x", "v", "pi", "0.5", "1e-3", "2", "0", "t"]).to_string();
        }
        let inner = self.built(random, depth - 1);
        match random.below(3) {
            0 => {
                let operator = random.of_list(&OPERATORS);
                format!("{inner}{operator}{}", self.built(random, depth - 1))
            }
            1 => format!("{}({inner})", random.of_list(&FUNCTIONS)),
            _ => format!("min({inner}, {})", self.built(random, depth - 1)),
        }
    }
}

impl Reader for Formulas {
    type Input = String;
    const INPUTS: u64 = 30_000;
    fn new() -> Self {
        // All texts in quotes of the cases, and the formulas of the corpus.
        let cases = cases().texts;
        let quoted = cases.iter().flat_map(|text| text.split('"').skip(1).step_by(2));
        let quoted = quoted.map(str::to_owned);
        let lines = texts("tests/corpus", "txt");
        let lines = lines.iter().flat_map(|text| text.lines().map(str::to_owned));
        Self(Corpus::new(quoted.chain(lines).collect()))
    }
    fn input(&self, random: &mut Random) -> String {
        match random.below(4) {
            0 => self.built(random, 6),
            1 => {
                let words = &self.0.words;
                (0..=random.below(25)).map(|_| random.of_list(words).as_str()).collect()
            }
            _ => self.0.changed(random),
        }
    }
    fn read(&mut self, formula: &String) -> Result<bool, String> {
        let names: [&[&str]; 7] = [&["x"], &["y"], &[], &["v", "vx"], &["vy"], &[], &["t"]];
        match Expression::parse(formula, &names, &Constants::new()) {
            Ok(read) => {
                evaluate(&read);
                if read.text() == formula {
                    Ok(true)
                } else {
                    Err(format!("read as {}", read.text()))
                }
            }
            Err(message) if message.is_empty() => Err("no message".to_owned()),
            Err(_) => Ok(false),
        }
    }
}

#[test]
fn changed_formulas_end_in_a_value_or_a_message() {
    fuzz::<Formulas>("fuzz::changed_formulas_end_in_a_value_or_a_message");
}

/// Faulty readers, which fail in different ways for input 777 of 1000.
struct Wrong<const WAY: usize>;

impl<const WAY: usize> Reader for Wrong<WAY> {
    type Input = u64;
    const INPUTS: u64 = 1000;
    fn new() -> Self {
        Self
    }
    fn input(&self, random: &mut Random) -> u64 {
        random.below(1 << 40) as u64
    }
    fn read(&mut self, &input: &u64) -> Result<bool, String> {
        match WAY {
            _ if input != self.input(&mut Random::of(777)) => Ok(input % 2 == 0),
            0 => Err("is wrong".to_owned()),
            1 => panic!("a panic"),
            2 => std::process::abort(),
            3 => loop {
                std::hint::spin_loop();
            },
            4 => Ok(std::hint::black_box(vec![1u8; 3 << 30]).len() == 1),
            _ => {
                fn deeper(n: u64) -> u64 {
                    if n == 0 { 0 } else { std::hint::black_box(n + deeper(n + 1)) }
                }
                Ok(deeper(1) == 0)
            }
        }
    }
}

#[test]
fn the_fuzzer_finds_errors() {
    finds::<Wrong<0>>("fuzz::the_fuzzer_finds_errors", "input 777: is wrong");
}

#[test]
fn the_fuzzer_finds_panics() {
    finds::<Wrong<1>>("fuzz::the_fuzzer_finds_panics", "a panic");
}

#[test]
fn the_fuzzer_finds_aborts() {
    finds::<Wrong<2>>("fuzz::the_fuzzer_finds_aborts", "input 777: signal: 6");
}

#[test]
fn the_fuzzer_finds_loops() {
    finds::<Wrong<3>>("fuzz::the_fuzzer_finds_loops", "input 777: signal: 24");
}

#[test]
fn the_fuzzer_finds_large_allocations() {
    finds::<Wrong<4>>(
        "fuzz::the_fuzzer_finds_large_allocations",
        "memory allocation of 3221225472",
    );
}

#[test]
fn the_fuzzer_finds_deep_recursion() {
    finds::<Wrong<5>>("fuzz::the_fuzzer_finds_deep_recursion", "has overflowed its stack");
}
