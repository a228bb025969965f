//! Sentences on which method to take at which accuracy.

use crate::base::text::{ALGORITHM_ERROR, GRID_ERROR, counted, sentence, time_text};
use crate::problem::case::Method;
use crate::results::draw::extent::smallest_and_largest;
use crate::study::chart::entry::{ChartEntry, PointOf, Status};
use crate::study::chart::result::Chart;
use crate::study::choices::distinct;

/// Accuracies of the sentences on the error to the exact solution, loose to tight.
const EXACT: [f64; 10] = [0.3, 0.1, 0.03, 0.01, 3e-3, 1e-3, 1e-4, 1e-5, 1e-6, 1e-8];
/// Accuracies of the sentences on the error to the semi-discrete solution, loose to tight.
const SEMIDISCRETE: [f64; 5] = [1e-2, 1e-4, 1e-6, 1e-8, 1e-10];

/// A number of few digits as text: `0.03`, `1e-5`.
fn accuracy_text(x: f64) -> String {
    if (0.001..1.0).contains(&x) { format!("{x}") } else { format!("{x:.0e}") }
}

/// A number as text, to two digits.
fn figures(x: f64) -> String {
    if (0.01..10.0).contains(&x) { format!("{x:.2}") } else { format!("{x:.1e}") }
}

/// The cheapest entries at some accuracies.
pub struct Winners<'a> {
    /// Each with the tightest accuracy at which it is the cheapest.
    pub within: Vec<(f64, &'a ChartEntry)>,
    /// The first accuracy that no entry reaches.
    pub missed: Option<f64>,
}

/// The cheapest of `entries` at each of `accuracies`, up to the first that no entry reaches. An
/// entry that is cheapest at several accuracies in turn stands once, with the tightest of them.
pub fn winners<'a>(
    entries: &[&'a ChartEntry],
    accuracies: &[f64],
    point: impl Fn(&ChartEntry) -> Option<[f64; 2]>,
) -> Winners<'a> {
    let mut within: Vec<(f64, &ChartEntry)> = Vec::new();
    for &accuracy in accuracies {
        let reach = entries.iter().filter_map(|e| {
            let [cost, error] = point(e)?;
            (error <= accuracy && cost.is_finite()).then_some((cost, *e))
        });
        let Some((_, best)) = reach.min_by(|(a, _), (b, _)| a.total_cmp(b)) else {
            return Winners { within, missed: Some(accuracy) };
        };
        match within.last_mut() {
            Some((tightest, last)) if std::ptr::eq(*last, best) => *tightest = accuracy,
            _ => within.push((accuracy, best)),
        }
    }
    Winners { within, missed: None }
}

/// The sentence on the cheapest entries at each of some accuracies.
struct CheapestByAccuracy<'a> {
    entries: &'a [&'a ChartEntry],
    accuracies: &'a [f64],
    /// Cost and error.
    point: PointOf,
    name: fn(&ChartEntry) -> String,
    cost: fn(&ChartEntry) -> String,
    /// Text on entries left out that could be closer than the given closest one.
    left_out: fn(&Chart, &ChartEntry) -> String,
}

impl CheapestByAccuracy<'_> {
    /// `within 0.1 …, 0.02 s; within 0.03 …; none came within 0.01 (closest …)`; none where no
    /// entry has an error.
    fn text(&self, chart: &Chart) -> Option<String> {
        let error =
            |e: &ChartEntry| (self.point)(e).map(|[_, error]| error).filter(|e| e.is_finite());
        let closest = (self.entries.iter())
            .filter_map(|e| Some((error(e)?, *e)))
            .min_by(|(a, _), (b, _)| a.total_cmp(b));
        let (closest_error, closest) = closest?;
        let Winners { within, missed } = winners(self.entries, self.accuracies, self.point);
        let mut parts: Vec<String> = (within.iter())
            .map(|(within, e)| {
                let (name, cost) = ((self.name)(e), (self.cost)(e));
                format!("within {} {name}, {cost}", accuracy_text(*within))
            })
            .collect();
        if let Some(missed) = missed {
            parts.push(format!(
                "none came within {} (closest: {}, {}{})",
                accuracy_text(missed),
                (self.name)(closest),
                figures(closest_error),
                (self.left_out)(chart, closest)
            ));
        }
        Some(parts.join("; "))
    }
}

fn measured_time_text(e: &ChartEntry) -> String {
    e.seconds.map_or(String::new(), time_text)
}

/// Kinds of methods that are compared apart.
const KINDS: [(&str, Method); 2] =
    [("classically", Method::Classical), ("by modes", Method::Schrodingerized)];

/// All sentences about a chart.
pub fn sentences(chart: &Chart) -> Vec<String> {
    let grid = &chart.compared_on;
    let done = |method| {
        (chart.entries.iter()).filter(move |e| e.status == Status::Done && e.method == method)
    };
    let compared = KINDS.map(|(kind, method)| {
        let there: Vec<&ChartEntry> = done(method).filter(|e| e.grid == *grid).collect();
        (kind, there)
    });
    let mut found = Vec::new();
    for (kind, method) in KINDS {
        found.extend(of_exact(chart, kind, &done(method).collect::<Vec<_>>()));
    }
    for (kind, entries) in &compared {
        found.extend(of_semidiscrete(chart, kind, entries));
    }
    let [_, (_, by_modes)] = &compared;
    found.extend(until_measured(chart, by_modes));
    found.extend(without_window(by_modes));
    if found.is_empty() && chart.zero {
        found.push(
            "The solution is zero: no error relative to its size is defined, and no method is \
             better than another."
                .to_owned(),
        );
    }
    if let Some(why) = &chart.compared_why {
        found.push(format!(
            "Methods are compared on {grid}, not on the case's own {}: {why}.",
            chart.grid
        ));
    }
    found.push(counts_of_trials(chart));
    found
}

/// A sentence on the error to the exact solution, over all grids.
fn of_exact(chart: &Chart, kind: &str, entries: &[&ChartEntry]) -> Option<String> {
    let of = match chart.exact.as_deref()? {
        "f" => "solution",
        _ => "density",
    };
    let sentence_of = CheapestByAccuracy {
        entries,
        accuracies: &EXACT,
        point: |e| Some([e.seconds?, e.error_exact?]),
        name: |e| format!("{} on {}", e.name(), e.grid),
        cost: measured_time_text,
        left_out: left_out_on_any_grid,
    };
    let text = sentence_of.text(chart)?;
    let what = sentence(GRID_ERROR);
    Some(format!("{what} (relative L1 distance to the exact {of}), {kind}: {text}."))
}

/// A sentence on the error to the semi-discrete solution, on the grid where methods are compared.
fn of_semidiscrete(chart: &Chart, kind: &str, entries: &[&ChartEntry]) -> Option<String> {
    let sentence_of = CheapestByAccuracy {
        entries,
        accuracies: &SEMIDISCRETE,
        point: |e| Some([e.seconds?, e.error_semidiscrete?]),
        name: ChartEntry::name,
        cost: measured_time_text,
        left_out: left_out_on_grid,
    };
    let reference = entries.iter().find(|e| e.is_reference());
    let also = reference.map_or(String::new(), |e| {
        let seconds = measured_time_text(e);
        format!(" (the exponential is that solution to round-off: {seconds})")
    });
    let (text, grid) = (sentence_of.text(chart)?, &chart.compared_on);
    let what = sentence(ALGORITHM_ERROR);
    Some(format!(
        "{what} (relative l2 distance to the semi-discrete solution on {grid}), {kind}{also}: \
         {text}."
    ))
}

/// A sentence on the cost until the field is measured.
fn until_measured(chart: &Chart, entries: &[&ChartEntry]) -> Option<String> {
    let sentence_of = CheapestByAccuracy {
        entries,
        accuracies: &SEMIDISCRETE,
        point: |e| Some([e.until_measured?, e.error_semidiscrete?]),
        name: ChartEntry::name,
        cost: |e| {
            let by = (e.measured_by.as_ref()).map_or(String::new(), |by| format!(" ({by})"));
            (e.until_measured).map_or(String::new(), |n| format!("{n:.1e}{by}"))
        },
        left_out: left_out_on_grid,
    };
    let text = sentence_of.text(chart)?;
    Some(format!(
        "On a quantum computer, by applications over the probability of measuring the field: \
         {text}."
    ))
}

/// The profiles without a probability in the window of `p`.
fn without_window(entries: &[&ChartEntry]) -> Option<String> {
    let without =
        |e: &&&ChartEntry| e.probability_window.is_none() && e.probability_slice.is_some();
    let profile = |e: &&ChartEntry| e.profile.clone().unwrap_or_default();
    let profiles = distinct(entries.iter().filter(without).map(profile));
    (!profiles.is_empty()).then(|| {
        format!(
            "Trials by {} have no window of p whose probability is known: theirs is that of the \
             slice at p◇.",
            profiles.join(", ")
        )
    })
}

/// Text on entries left out that could be closer to the exact solution than `closest`.
fn left_out_on_any_grid(chart: &Chart, closest: &ChartEntry) -> String {
    let out = (chart.entries.iter())
        .filter(|e| e.status == Status::LeftOut && e.method == closest.method);
    let slopes = |e: &ChartEntry| e.slopes().is_some();
    let finer = out.clone().any(|e| e.cells > closest.cells);
    let limited = !slopes(closest) && out.clone().any(|e| e.cells >= closest.cells && slopes(e));
    let what = match (finer, limited) {
        (true, true) => "settings on finer grids and limiters",
        (true, false) => "settings on finer grids",
        (false, true) => "limiters",
        (false, false) => return String::new(),
    };
    format!("; {what} were left out for the budget")
}

/// Text on the entries by the method of `closest` on its grid that were left out.
fn left_out_on_grid(chart: &Chart, closest: &ChartEntry) -> String {
    let out = (chart.entries.iter()).filter(|e| {
        e.status == Status::LeftOut && e.method == closest.method && e.grid == closest.grid
    });
    match out.count() {
        0 => String::new(),
        n => format!("; left out for the budget: {n}"),
    }
}

/// The expected seconds of `entries`: one number, or the least and the most.
pub fn expected_seconds_text(entries: &[&ChartEntry]) -> String {
    let all: Vec<f64> = entries.iter().filter_map(|e| e.expected_seconds).collect();
    let [least, most] = smallest_and_largest(all.into_iter()).map(time_text);
    let bound = if entries.iter().any(|e| e.expected_at_least) { "at least " } else { "" };
    if least == most { format!("{bound}{least}") } else { format!("{bound}{least} to {most}") }
}

/// A sentence on the numbers of trials that ran, were refused, and were left out.
fn counts_of_trials(chart: &Chart) -> String {
    let count = |status| chart.entries.iter().filter(|e| e.status == status).count();
    let mut text = format!(
        "{} trials on {} took {:.1} s of a budget of {} s; refused: {}",
        count(Status::Done),
        counted(chart.ranks, "rank", "ranks"),
        chart.took_seconds,
        chart.budget_seconds,
        count(Status::Refused),
    );
    let out = count(Status::LeftOut);
    if out > 0 {
        let all: Vec<&ChartEntry> =
            (chart.entries.iter()).filter(|e| e.status == Status::LeftOut).collect();
        text += &format!(
            ", left out as they did not fit: {out} (expected to take {} each)",
            expected_seconds_text(&all)
        );
    }
    text + "."
}
