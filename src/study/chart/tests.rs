//! Fronts, sentences and files from made-up trials.

use super::*;
use crate::problem::case::{Integrator, Limiter, ProfileChoice, PropagatorMethod};
use crate::study::chart::entry::{ChartEntry, Status};
use crate::study::chart::files::{COLUMNS, csv};
use crate::study::chart::setup::{Modes, Setup, refused};
use crate::study::chart::verdict::{Winners, winners};
use crate::study::treatment::Treatment;
use serde_json::Value;

fn case() -> Case {
    case_with(&[])
}

/// The case with these `--set` options.
fn case_with(settings: &[&str]) -> Case {
    let settings: Vec<String> = settings.iter().map(|&set| set.to_owned()).collect();
    let text = r#"
        title = "Step, \"a, b\""
        [[axis]]
        x = { lower = -1, upper = 1, cells = 16 }
        v = { lower = -1, upper = 1, cells = 14 }
        [[potential]]
        where = "x < 0"
        value = "0.2"
        [[potential]]
        value = "0"
        [initial]
        f = "exp(-x^2 - v^2)"
        [time]
        end = 0.3
    "#;
    Case::parse("made-up.toml", text, &settings).unwrap()
}

/// A trial by the designed profile, or classical, that reached `error` in `seconds` with
/// `applications`.
fn made_up(designed: bool, [seconds, error]: [f64; 2], applications: usize) -> ChartEntry {
    let case = case();
    let setup = if designed {
        Setup::from(Modes {
            profile: &ProfileChoice::Designed,
            treatment: Some(Treatment::all()[1]),
            propagator: PropagatorMethod::Chebyshev,
            steps: None,
            tolerance: error,
        })
    } else {
        Setup::classical(Integrator::SspRk3, Limiter::VanLeer)
    };
    ChartEntry {
        seconds: Some(seconds),
        error_exact: (!designed).then_some(error),
        error_semidiscrete: designed.then_some(error),
        applications: Some(applications),
        until_measured: designed.then_some(10.0 * applications as f64),
        ..ChartEntry::of(&setup.apply(&case, &case.space, None), Status::Done)
    }
}

fn chart(entries: Vec<ChartEntry>) -> Chart {
    Chart {
        title: "made up".to_owned(),
        version: String::new(),
        git: String::new(),
        ranks: 1,
        budget_seconds: 60.0,
        took_seconds: 12.0,
        exact: Some("f".to_owned()),
        grid: "16 x 14".to_owned(),
        compared_on: "16 x 14".to_owned(),
        compared_why: None,
        zero: false,
        sentences: Vec::new(),
        entries,
    }
}

#[test]
fn the_cheapest_wins_at_each_accuracy() {
    let entries = [
        made_up(true, [3.0, 1e-9], 300),
        made_up(true, [1.0, 5e-3], 100),
        // More expensive than the first, and less accurate.
        made_up(true, [4.0, 1e-5], 200),
        made_up(true, [0.5, 0.5], 50),
    ];
    let all: Vec<&ChartEntry> = entries.iter().collect();
    let point = |e: &ChartEntry| Some([e.seconds?, e.error_semidiscrete?]);
    let Winners { within: found, missed } = winners(&all, &[1e-2, 1e-4, 1e-6, 1e-8, 1e-10], point);
    assert_eq!(missed, Some(1e-10));
    let found: Vec<(f64, f64)> =
        (found.iter()).map(|(within, e)| (*within, e.seconds.unwrap())).collect();
    assert_eq!(found, [(1e-2, 1.0), (1e-8, 3.0)]);
    // By applications the third entry is the cheapest at one accuracy.
    let point = |e: &ChartEntry| Some([e.applications? as f64, e.error_semidiscrete?]);
    let found = winners(&all, &[1e-2, 1e-4, 1e-6], point).within;
    let cost: Vec<usize> = found.iter().map(|(_, e)| e.applications.unwrap()).collect();
    assert_eq!(cost, [100, 200, 300]);
}

#[test]
fn sentences_name_the_best_method_and_unreached_errors() {
    let mut left_out = made_up(true, [0.0, 1e-10], 0);
    left_out.status = Status::LeftOut;
    (left_out.seconds, left_out.error_semidiscrete) = (None, None);
    left_out.expected_seconds = Some(1234.0);
    let chart = chart(vec![
        made_up(false, [0.002, 0.08], 9),
        made_up(false, [0.04, 0.009], 9),
        made_up(true, [0.5, 1e-3], 1000),
        left_out,
    ]);
    let text = sentences(&chart);
    assert_eq!(
        text[0],
        "Error of the grid (relative L1 distance to the exact solution), classically: within 0.1 \
         van-leer, ssp-rk3 at CFL 0.9 on 16 x 14, 2.0 ms; \
         within 0.01 van-leer, ssp-rk3 at CFL 0.9 on 16 x 14, 40.0 ms; none came within 0.003 \
         (closest: van-leer, ssp-rk3 at CFL 0.9 on 16 x 14, 9.0e-3)."
    );
    assert_eq!(
        text[1],
        "Error of the algorithm (relative l2 distance to the semi-discrete solution on 16 x 14), \
         by modes: within 0.01 designed chebyshev to 1e-3 (weights), \
         500.0 ms; none came within 1e-4 (closest: designed chebyshev to 1e-3 (weights), 1.0e-3; \
         left out for the budget: 1)."
    );
    assert!(
        text[2].contains("within 0.01 designed chebyshev to 1e-3 (weights), 1.0e4"),
        "{}",
        text[2]
    );
    assert!(text[3].contains("3 trials on 1 rank took 12.0 s"), "{}", text[3]);
    assert!(text[3].contains("fit: 1 (expected to take 21 min"), "{}", text[3]);
    // The table names the omitted methods.
    let table = Chart { sentences: text, ..chart }.to_string();
    assert!(table.contains("designed: 1 setting, 21 min"), "{table}");
}

#[test]
fn missing_comparisons_are_reported() {
    let mut nothing = made_up(true, [0.1, 1e-3], 100);
    nothing.error_semidiscrete = None;
    let zero = Chart {
        zero: true,
        compared_why: Some("it takes too long".to_owned()),
        grid: "64 x 64".to_owned(),
        ..chart(vec![nothing])
    };
    let text = sentences(&zero);
    assert!(text[0].starts_with("The solution is zero"), "{text:?}");
    let why = "Methods are compared on 16 x 14, not on the case's own 64 x 64: it takes too long.";
    assert_eq!(text[1], why);
    // The omitted settings might have had smaller errors.
    let mut finer = made_up(false, [0.0, 0.0], 0);
    finer.status = Status::LeftOut;
    (finer.seconds, finer.error_exact, finer.cells) = (None, None, 10_000);
    (finer.expected_seconds, finer.expected_at_least) = (Some(70.0), true);
    let text = sentences(&chart(vec![made_up(false, [0.1, 0.2], 9), finer]));
    assert!(text[0].contains("settings on finer grids were left out for the budget"), "{text:?}");
    let last = text.last().unwrap();
    assert!(last.contains("at least 70.0 s each"), "{last}");
}

#[test]
fn fronts_are_of_a_kind_and_a_grid() {
    let mut other = made_up(true, [9.0, 0.1], 900);
    other.grid = "8 x 7".to_owned();
    let mut entries = vec![
        made_up(true, [1.0, 1e-2], 100),
        made_up(true, [2.0, 2e-2], 50),
        made_up(true, [3.0, 1e-3], 500),
        made_up(false, [1e-3, 0.5], 1),
        made_up(false, [2e-3, 0.6], 1),
        other,
    ];
    mark_fronts(&mut entries);
    let of = |on: fn(&ChartEntry) -> bool| entries.iter().map(on).collect::<Vec<bool>>();
    assert_eq!(of(|e| e.front_seconds), [true, false, true, false, false, true]);
    assert_eq!(of(|e| e.front_applications), [true, true, true, false, false, true]);
    assert_eq!(of(|e| e.front_until_measured), [true, true, true, false, false, true]);
    assert_eq!(of(|e| e.front_exact), [false, false, false, true, false, false]);
}

/// The fields of a line of a CSV file.
fn split(line: &str) -> Vec<String> {
    let mut fields = vec![String::new()];
    let (mut quoted, mut characters) = (false, line.chars().peekable());
    while let Some(c) = characters.next() {
        let last = fields.len() - 1;
        match (c, quoted) {
            ('"', true) if characters.peek() == Some(&'"') => {
                characters.next();
                fields[last].push('"');
            }
            ('"', _) => quoted = !quoted,
            (',', false) => fields.push(String::new()),
            (c, _) => fields[last].push(c),
        }
    }
    fields
}

#[test]
fn the_table_holds_everything_of_a_trial() {
    let mut refused = made_up(false, [1.0, 1.0], 1);
    refused.status = Status::Refused;
    refused.reason = Some("solver.warp: \"x\", and\nmore".to_owned());
    let entries = [made_up(true, [0.25, 1e-3], 7), refused];
    let Value::Object(map) = serde_json::to_value(&entries[0]).unwrap() else {
        panic!("an entry is an object");
    };
    let mut keys: Vec<&str> = map.keys().map(String::as_str).collect();
    let mut columns = COLUMNS.to_vec();
    keys.sort_unstable();
    columns.sort_unstable();
    assert_eq!(keys, columns);
    let text = csv(&entries);
    let rows: Vec<Vec<String>> = text.lines().map(split).collect();
    assert_eq!(rows.len(), 3);
    assert!(rows.iter().all(|row| row.len() == COLUMNS.len()), "{text}");
    let value = |row: usize, name: &str| {
        let column = rows[0].iter().position(|c| c == name).unwrap();
        rows[row][column].clone()
    };
    assert_eq!(value(1, "status"), "done");
    assert_eq!(value(1, "seconds"), "0.25");
    assert_eq!(value(1, "grid"), "16 x 14");
    assert_eq!(value(1, "integrator"), "");
    assert_eq!(value(2, "reason"), "solver.warp: \"x\", and more");
    assert_eq!(value(2, "limiter"), "van-leer");
}

#[test]
fn settings_make_the_cases_they_name() {
    let case = case();
    let paper = Setup::Paper { points: 256, steps: Some(50) };
    let bounds = Bounds { growth: 2.0, decay: 100.0, ..Bounds::new(&case).unwrap() };
    let made = paper.apply(&case, &case.space, Some(&bounds));
    let [lower, upper] = made.warp.interval.unwrap();
    assert!((lower + 35.0).abs() < 1e-12 && (upper - 5.6).abs() < 1e-12);
    assert!(made.verify && !made.warp.weights);
    assert!((made.propagator.step.unwrap() * 50.0 - case.end).abs() < 1e-12);
    // The paper's scheme is the upwind one for any scheme of the case.
    let mut central = case.clone();
    central.scheme.flux = 0.5;
    assert!(paper.apply(&central, &central.space, Some(&bounds)).scheme.flux >= 1.0);
    let slopes = Setup::classical(Integrator::SspRk3, Limiter::Minmod);
    assert!(!slopes.apply(&case, &case.space, None).verify);
    let exponential = Setup::classical(Integrator::Exponential, Limiter::None);
    assert!(!exponential.apply(&case, &case.space, None).verify);
}

/// A chart refuses what a case file with these settings is refused for.
#[test]
fn settings_are_refused_as_in_a_case_file() {
    let why = |setting: &str, setup: Setup| {
        let case = case_with(&[setting]);
        refused(&setup.apply(&case, &case.space, None))
    };
    let unitary = Setup::Unitary { tolerance: 1e-3 };
    let closed = "nothing enters through closed ends";
    assert_eq!(why("inflow.value=1", unitary).as_deref(), Some(closed));
    assert_eq!(why("inflow.value=0", unitary), None);
    let reflection = why("potential.0.reflection=0.5", unitary);
    assert_eq!(reflection.as_deref(), Some("partial reflection is no isometry"));
    let slopes = Setup::classical(Integrator::SspRk3, Limiter::Minmod);
    let of_inflow = why("inflow.value=1 + t", slopes).expect("slopes with a varying inflow");
    assert!(of_inflow.contains("inflow at time 0"), "{of_inflow}");
    let of_elements = why("scheme.degree=1", slopes).expect("slopes with elements");
    assert!(of_elements.contains("the upwind scheme of degree 0"), "{of_elements}");
    for (setting, word) in [("inflow.value=1 + t", "t in inflow.value"), ("inflow.value=1", "")] {
        let krylov = Setup::from(Modes {
            profile: &ProfileChoice::Designed,
            treatment: None,
            propagator: PropagatorMethod::Krylov,
            steps: None,
            tolerance: 1e-3,
        });
        let reason = why(setting, krylov).unwrap_or_default();
        assert!(reason.contains(word) && reason.is_empty() == word.is_empty(), "{reason}");
    }
}
