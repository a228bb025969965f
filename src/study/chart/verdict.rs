//! Which method to take at which accuracy, in sentences that follow from the trials.

use crate::problem::case::Method;
use crate::study::chart::entry::{Entry, Status, time_text};
use crate::study::chart::result::Chart;

/// Accuracies that are asked for, loose to tight.
const EXACT: [f64; 10] = [0.3, 0.1, 0.03, 0.01, 3e-3, 1e-3, 1e-4, 1e-5, 1e-6, 1e-8];
const SEMIDISCRETE: [f64; 5] = [1e-2, 1e-4, 1e-6, 1e-8, 1e-10];

/// A number of few digits, as people write it.
pub fn short(x: f64) -> String {
    if (0.001..1.0).contains(&x) {
        format!("{x}")
    } else {
        format!("{x:.0e}")
    }
}

/// A number to two digits.
fn figures(x: f64) -> String {
    if (0.01..10.0).contains(&x) {
        format!("{x:.2}")
    } else {
        format!("{x:.1e}")
    }
}

/// The cheapest of `entries` at each of `accuracies`: the tightest accuracy that each winner is the winner of, and the one that nothing
/// reaches.
pub fn winners<'a>(
    entries: &[&'a Entry],
    accuracies: &[f64],
    point: impl Fn(&Entry) -> Option<[f64; 2]>,
) -> (Vec<(f64, &'a Entry)>, Option<f64>) {
    let mut found: Vec<(f64, &Entry)> = Vec::new();
    for &accuracy in accuracies {
        let reach = entries.iter().filter_map(|e| {
            let [cost, error] = point(e)?;
            (error <= accuracy && cost.is_finite()).then_some((cost, *e))
        });
        let Some((_, best)) = reach.min_by(|(a, _), (b, _)| a.total_cmp(b)) else {
            return (found, Some(accuracy));
        };
        match found.last_mut() {
            Some((tightest, last)) if std::ptr::eq(*last, best) => *tightest = accuracy,
            _ => found.push((accuracy, best)),
        }
    }
    (found, None)
}

/// `within 0.1 …, 0.02 s; within 0.03 …; none came within 0.01 (closest …)`; `besides` tells of the closest what was left out.
fn ladder(
    entries: &[&Entry],
    accuracies: &[f64],
    point: impl Fn(&Entry) -> Option<[f64; 2]>,
    [name, cost, besides]: [&dyn Fn(&Entry) -> String; 3],
) -> Option<String> {
    let error = |e: &Entry| point(e).map(|[_, error]| error).filter(|e| e.is_finite());
    let closest = (entries.iter())
        .filter_map(|e| Some((error(e)?, *e)))
        .min_by(|(a, _), (b, _)| a.total_cmp(b));
    let (closest_error, closest) = closest?;
    let (winners, missed) = winners(entries, accuracies, &point);
    let mut parts: Vec<String> = (winners.iter())
        .map(|(within, e)| format!("within {} {}, {}", short(*within), name(e), cost(e)))
        .collect();
    if let Some(missed) = missed {
        parts.push(format!(
            "none came within {} (closest: {}, {}{})",
            short(missed),
            name(closest),
            figures(closest_error),
            besides(closest)
        ));
    }
    Some(parts.join("; "))
}

/// All sentences about a chart.
pub fn sentences(chart: &Chart) -> Vec<String> {
    let done = |method| -> Vec<&Entry> {
        let entries = chart.entries.iter();
        (entries.filter(|e| e.status == Status::Done && e.method == method)).collect()
    };
    let kinds = [
        ("classically", done(Method::Classical)),
        ("by modes", done(Method::Schrodingerized)),
    ];
    let seconds = |e: &Entry| e.seconds.map_or(String::new(), time_text);
    let here = |e: &Entry| e.name();
    let anywhere = |e: &Entry| format!("{} on {}", e.name(), e.grid);
    let mut found = Vec::new();
    if let Some(exact) = &chart.exact {
        let of = match exact.as_str() {
            "f" => "the exact solution",
            _ => "the exact density",
        };
        for (kind, entries) in &kinds {
            let point = |e: &Entry| Some([e.seconds?, e.error_exact?]);
            let besides = |closest: &Entry| unseen(chart, closest);
            let ladder = ladder(entries, &EXACT, point, [&anywhere, &seconds, &besides]);
            found.extend(ladder.map(|l| format!("Of {of} (relative L1), {kind}: {l}.")));
        }
    }
    let grid = &chart.compared_on;
    for (kind, entries) in &kinds {
        let entries: Vec<&Entry> = entries
            .iter()
            .filter(|e| e.grid == *grid)
            .copied()
            .collect();
        let point = |e: &Entry| Some([e.seconds?, e.error_semidiscrete?]);
        let besides = |closest: &Entry| unseen_there(chart, closest);
        let ladder_ = ladder(&entries, &SEMIDISCRETE, point, [&here, &seconds, &besides]);
        let reference = entries.iter().find(|e| e.is_reference());
        let also = reference.map_or(String::new(), |e| {
            format!(
                " (the exponential is that solution to round-off: {})",
                seconds(e)
            )
        });
        found.extend(ladder_.map(|l| {
            format!("Of the semi-discrete solution on {grid} (relative l2), {kind}{also}: {l}.")
        }));
    }
    let entries: Vec<&Entry> = (kinds[1].1.iter())
        .filter(|e| e.grid == *grid)
        .copied()
        .collect();
    let point = |e: &Entry| Some([e.until_measured?, e.error_semidiscrete?]);
    let until = |e: &Entry| {
        let by = (e.measured_by.as_ref()).map_or(String::new(), |by| format!(" ({by})"));
        e.until_measured
            .map_or(String::new(), |n| format!("{n:.1e}{by}"))
    };
    let besides = |closest: &Entry| unseen_there(chart, closest);
    let measured = ladder(&entries, &SEMIDISCRETE, point, [&here, &until, &besides]);
    found.extend(measured.map(|l| {
        format!(
            "On a quantum computer, by applications over the probability of measuring the field: {l}."
        )
    }));
    let mut without: Vec<String> = Vec::new();
    for e in &entries {
        if e.probability_window.is_none() && e.probability_slice.is_some() {
            let profile = e.profile.clone().unwrap_or_default();
            if !without.contains(&profile) {
                without.push(profile);
            }
        }
    }
    if !without.is_empty() {
        let names = without.join(", ");
        found.push(format!(
            "Trials by {names} have no window of p whose probability is known: theirs is that of the slice at p◇."
        ));
    }
    if found.is_empty() && chart.zero {
        found.push(
            "The solution is zero: no error relative to its size is defined, and no method is better than another."
                .to_owned(),
        );
    }
    if let Some(why) = &chart.compared_why {
        found.push(format!(
            "Methods are compared on {grid}, not on the case's own {}: {why}.",
            chart.grid
        ));
    }
    found.push(account(chart));
    found
}

/// What was left out that could have come closer to the exact solution than `closest`.
fn unseen(chart: &Chart, closest: &Entry) -> String {
    let out = (chart.entries.iter())
        .filter(|e| e.status == Status::LeftOut && e.method == closest.method);
    let slopes = |e: &Entry| e.limiter.as_ref().is_some_and(|l| l != "none");
    let finer = out.clone().any(|e| e.cells > closest.cells);
    let steeper = !slopes(closest) && out.clone().any(|e| e.cells >= closest.cells && slopes(e));
    let what = match (finer, steeper) {
        (true, true) => "settings on finer grids and limiters",
        (true, false) => "settings on finer grids",
        (false, true) => "limiters",
        (false, false) => return String::new(),
    };
    format!("; {what} were left out for the budget")
}

/// The same of the semi-discrete solution, on its grid.
fn unseen_there(chart: &Chart, closest: &Entry) -> String {
    let out = (chart.entries.iter()).filter(|e| {
        e.status == Status::LeftOut && e.method == closest.method && e.grid == closest.grid
    });
    match out.count() {
        0 => String::new(),
        n => format!("; left out for the budget: {n}"),
    }
}

/// Seconds that are expected of `entries`: one number, or the least and the most.
pub fn expected(entries: &[&Entry]) -> String {
    let all: Vec<f64> = entries.iter().filter_map(|e| e.expected_seconds).collect();
    let [least, most] = ends(&all).map(time_text);
    let bound = match entries.iter().any(|e| e.expected_at_least) {
        true => "at least ",
        false => "",
    };
    match least == most {
        true => format!("{bound}{least}"),
        false => format!("{bound}{least} to {most}"),
    }
}

/// The least and the largest.
pub fn ends(all: &[f64]) -> [f64; 2] {
    let least = all.iter().copied().fold(f64::INFINITY, f64::min);
    [least, all.iter().copied().fold(f64::NEG_INFINITY, f64::max)]
}

/// What was run and what was not.
fn account(chart: &Chart) -> String {
    let count = |status| chart.entries.iter().filter(|e| e.status == status).count();
    let mut text = format!(
        "{} trials on {} {} took {:.1} s of a budget of {} s; refused: {}",
        count(Status::Done),
        chart.ranks,
        if chart.ranks == 1 { "rank" } else { "ranks" },
        chart.took_seconds,
        chart.budget_seconds,
        count(Status::Refused),
    );
    let out = count(Status::LeftOut);
    if out > 0 {
        let all: Vec<&Entry> = (chart.entries.iter())
            .filter(|e| e.status == Status::LeftOut)
            .collect();
        text += &format!(
            ", left out as they did not fit: {out} (expected to take {} each)",
            expected(&all)
        );
    }
    text + "."
}
