//! Whether a result can be trusted: the first section of the page.

use crate::base::text::{ALGORITHM_ERROR, GRID_ERROR, counted, percent, sentence, short};
use crate::results::accuracy::Accuracy;
use crate::results::continued_result::ContinuedResult;
use crate::results::ledger::Ledger;
use crate::results::report::html::Text;
use crate::results::verdict::{FAR_ABOVE, MissedGoals};
use maud::{Markup, html};
use serde::Deserialize;
use serde_json::Value;

#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Mark {
    /// The finding is as it should be.
    Good,
    /// The finding is not as it should be.
    Bad,
    /// It is unknown whether the finding is as it should be.
    Unknown,
}

/// A finding on which the trust in a result depends.
struct Finding {
    what: String,
    mark: Mark,
    /// A number, or a word.
    value: String,
    /// The meaning of the finding.
    text: String,
}

/// The parts of a summary that judge a run; `None` for those that it lacks.
pub struct Judgement {
    /// The errors of algorithm and grid.
    pub accuracy: Option<Accuracy>,
    /// The ledger of mass and energy.
    pub ledger: Option<Ledger>,
    /// The missed goals, which results of older versions do not have.
    missed: Option<MissedGoals>,
    /// The result from which the run continued.
    pub continued: Option<ContinuedResult>,
}

impl Judgement {
    /// The judgement in a summary.
    pub fn of(summary: &Value) -> Self {
        Self {
            accuracy: Accuracy::deserialize(&summary["accuracy"]).ok(),
            ledger: Ledger::deserialize(&summary["ledger"]).ok(),
            missed: MissedGoals::deserialize(&summary["missed"]).ok(),
            continued: ContinuedResult::deserialize(&summary["continued"]).ok(),
        }
    }

    /// The ledger of a finished run.
    fn whole_ledger(&self) -> Option<&Ledger> {
        self.ledger.as_ref().filter(|ledger| ledger.mass.end.is_some())
    }
}

/// The findings on the error of the algorithm, that of the grid, and mass and energy, with a
/// sentence as heading.
pub fn trust(summary: &Value, judgement: &Judgement, classical: bool) -> Markup {
    let findings = [
        if classical { steps(summary) } else { algorithm(summary, judgement) },
        grid(judgement),
        conservation(judgement.whole_ledger()),
    ];
    let marks = findings.each_ref().map(|finding| finding.mark);
    let has_goal = judgement.accuracy.as_ref().is_some_and(|accuracy| accuracy.goal.is_some());
    let (class, heading) = heading(marks, has_goal);
    html! {
        section id="trust" class={ "trust " (class) } {
            h2 { (heading) }
            dl {
                @for finding in &findings {
                    @let [class, sign] = finding.mark.class_and_sign();
                    div class=(class) {
                        dt { (finding.what) }
                        dd {
                            strong { (sign) " " (Text(&finding.value)) }
                            " " (Text(&finding.text))
                        }
                    }
                }
            }
        }
    }
}

impl Mark {
    /// Class in the style sheet, and a sign that can be distinguished without colours.
    fn class_and_sign(self) -> [&'static str; 2] {
        match self {
            Self::Good => ["good", "✓"],
            Self::Bad => ["bad", "✗"],
            Self::Unknown => ["unknown", "?"],
        }
    }
}

/// The class and the sentence for the marks of algorithm, grid, and mass and energy. An accuracy
/// that was asked for is that of the density, and says nothing about the error of `f`.
///
/// It is not the [verdict](crate::results::verdict::Verdict) of the summary, which says nothing
/// about mass and energy and which older results lack.
fn heading(
    [algorithm, grid, conservation]: [Mark; 3],
    has_goal: bool,
) -> (&'static str, &'static str) {
    match (algorithm, grid, conservation) {
        (Mark::Bad, ..) => ("bad", "Do not trust this result: the tolerance is not met"),
        (_, Mark::Bad, _) if has_goal => ("bad", "The accuracy of the density is not met"),
        (_, Mark::Bad, _) => ("bad", "The grid is too coarse"),
        (_, _, Mark::Bad) => ("bad", "Mass or energy is off: read the warnings"),
        (Mark::Good, Mark::Good, Mark::Good) if has_goal => {
            ("good", "Tolerance and accuracy of the density met, mass and energy kept")
        }
        (Mark::Good, Mark::Good, Mark::Good) => {
            ("good", "Tolerance met, error of the grid below 10 %, mass and energy kept")
        }
        _ => ("unknown", "Not all errors of this result are known"),
    }
}

/// The finding on the error of a classical run's time steps.
fn steps(summary: &Value) -> Finding {
    let total = summary["continued"]["error_total"].as_f64();
    let (value, text) = match (total, summary["error_semidiscrete"].as_f64()) {
        (Some(total), _) => (short(total), "relative l2, with that of the run that it continues"),
        (None, Some(error)) => (short(error), "relative l2, measured: of the time steps"),
        (None, None) => (
            "none".to_owned(),
            "the classical scheme has no modes; its time steps are not measured",
        ),
    };
    Finding { what: sentence(ALGORITHM_ERROR), mark: Mark::Unknown, value, text: text.to_owned() }
}

/// The finding on the distance to the exact solution of the scheme's equations.
fn algorithm(summary: &Value, judgement: &Judgement) -> Finding {
    let (accuracy, missed) = (judgement.accuracy.as_ref(), judgement.missed.as_ref());
    let what = sentence(ALGORITHM_ERROR);
    let own = ["error_semidiscrete", "error_estimate"].map(|key| summary[key].as_f64());
    if let Some(missed) = missed.and_then(|missed| missed.tolerance.as_ref()) {
        let value = own.into_iter().flatten().next().map_or(String::new(), short);
        return Finding { what, mark: Mark::Bad, value, text: missed.clone() };
    }
    let Some(error) = accuracy.and_then(|accuracy| accuracy.algorithm) else {
        let known = accuracy.and_then(|accuracy| accuracy.algorithm_unknown.as_deref());
        let known = known.unwrap_or("planned, and not estimated");
        return Finding {
            what,
            mark: Mark::Unknown,
            value: "not known".to_owned(),
            text: format!("{known}; solver.verify measures it"),
        };
    };
    // That of a continued run is a bound since time 0.
    let mark = match accuracy.map_or(0.0, Accuracy::ratio_to_tolerance) {
        ratio if ratio > FAR_ABOVE => Mark::Bad,
        ratio if ratio > 1.0 || missed.is_none() => Mark::Unknown,
        _ => Mark::Good,
    };
    let asked = summary["tolerance"].as_f64();
    let asked = asked.map_or(String::new(), |asked| format!("; the tolerance is {}", short(asked)));
    let inherited = summary["continued"]["error_inherited"].as_f64();
    let inherited = inherited.map_or(String::new(), |error| {
        format!(", {} of it inherited from the run that it continues", short(error))
    });
    let text = format!("relative l2{inherited}{asked}");
    Finding { what, mark, value: short(error), text }
}

/// The finding on the distance between the solutions of the scheme's equations and of the problem.
fn grid(judgement: &Judgement) -> Finding {
    let (accuracy, missed) = (judgement.accuracy.as_ref(), judgement.missed.as_ref());
    let known = accuracy.and_then(|accuracy| Some((accuracy, accuracy.errors_of_grid()?)));
    let Some((accuracy, errors)) = known else {
        let why = accuracy.and_then(|accuracy| accuracy.unknown.clone());
        return Finding {
            what: sentence(GRID_ERROR),
            mark: Mark::Unknown,
            value: "not known".to_owned(),
            text: why.unwrap_or_else(|| {
                "neither measured nor estimated; a run on twice as many cells would show it"
                    .to_owned()
            }),
        };
    };
    let what = sentence(&accuracy.what_is_measured());
    let how = if accuracy.grid_measured { "measured" } else { "estimated" };
    let mut text = format!("relative L2, {how}");
    let goal_missed = missed.and_then(|missed| missed.accuracy.as_deref());
    let mut mark = mark_of_grid(&mut text, accuracy, goal_missed, judgement.continued.as_ref());
    if let Some(doubt) = &accuracy.unknown {
        text += &format!("; {doubt}");
        mark = if mark == Mark::Good { Mark::Unknown } else { mark };
    }
    if mark == Mark::Good && accuracy.under_resolved {
        text += "; UNDER-RESOLVED, as the error of the algorithm is far smaller";
    }
    text += &accuracy.advice_after();
    Finding { what, mark, value: errors, text }
}

/// The mark of the error of the grid. Adds to the `text` of the finding what is known of the
/// accuracy that was asked for.
fn mark_of_grid(
    text: &mut String,
    accuracy: &Accuracy,
    goal_missed: Option<&str>,
    continued: Option<&ContinuedResult>,
) -> Mark {
    match (goal_missed, accuracy.goal) {
        (Some(sentence), _) => {
            *text += &format!("; {sentence}");
            Mark::Bad
        }
        (None, Some(goal)) => {
            *text += &format!("; the accuracy {} of the density was asked for", short(goal));
            match (accuracy.goal_error, accuracy.goal_estimate) {
                (Some(_), _) => Mark::Good,
                (None, Some(estimate)) => {
                    *text += &format!(
                        ", and the trial runs that chose the grid expect an error of {}",
                        short(estimate)
                    );
                    if estimate <= goal { Mark::Good } else { Mark::Bad }
                }
                (None, None) => {
                    *text += ", and its error was not measured";
                    if accuracy.is_coarse() { Mark::Bad } else { Mark::Unknown }
                }
            }
        }
        (None, None) if accuracy.is_hidden_by_algorithm() => Mark::Unknown,
        (None, None) if accuracy.is_coarse() => Mark::Bad,
        (None, None) if continued.is_some_and(|before| before.leaves_grid_unknown(accuracy)) => {
            Mark::Unknown
        }
        (None, None) if accuracy.staircase => Mark::Unknown,
        (None, None) => Mark::Good,
    }
}

/// The warning that [`trust`] quotes in full, if any.
pub fn main_warning(judgement: &Judgement) -> Option<String> {
    judgement.whole_ledger()?.doubts().into_iter().next()
}

/// The finding on the balance of mass and energy.
fn conservation(ledger: Option<&Ledger>) -> Finding {
    let what = "Mass and energy".to_owned();
    let Some(ledger) = ledger else {
        let (value, text) = ("not known".to_owned(), "there is no ledger".to_owned());
        return Finding { what, mark: Mark::Unknown, value, text };
    };
    let warnings = ledger.doubts();
    let (mark, value) = match warnings.len() {
        0 => (Mark::Good, "no warning".to_owned()),
        count => (Mark::Bad, counted(count, "warning", "warnings")),
    };
    let lost = || Some(percent((ledger.mass.lost? / ledger.mass.absolute?).abs()));
    let share = |share: String| format!("{share} of the mass left the box or is lost");
    let text = warnings.into_iter().next().or_else(|| lost().map(share)).unwrap_or_default();
    Finding { what, mark, value, text }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::results::accuracy::GridErrorPair;
    use serde_json::json;

    fn page(algorithm: f64, grid: f64, lost: f64) -> String {
        let accuracy =
            Accuracy { asked: Some(1e-6), algorithm: Some(algorithm), ..Accuracy::default() };
        let measured = GridErrorPair { field: Some(grid), density: None };
        let accuracy = accuracy.with_grid(measured, GridErrorPair::default());
        let mut ledger = Ledger::default();
        let all = Some(1.0);
        (ledger.mass.absolute, ledger.mass.initial, ledger.mass.end) = (all, all, all);
        ledger.mass.beyond = Some(lost);
        let missed = MissedGoals {
            tolerance: (algorithm > 1e-6).then(|| "tolerance".to_owned()),
            accuracy: None,
        };
        let summary = json!({
            "tolerance": 1e-6, "accuracy": accuracy, "missed": missed, "ledger": ledger
        });
        section(&summary, false)
    }

    /// The first section of the page for a summary.
    fn section(summary: &Value, classical: bool) -> String {
        trust(summary, &Judgement::of(summary), classical).into_string()
    }

    #[test]
    fn the_heading_is_that_of_the_worst() {
        for (found, words) in [
            (page(1e-7, 0.02, 0.0), "Tolerance met"),
            (page(1e-5, 0.02, 0.0), "the tolerance is not met"),
            (page(1e-7, 0.2, 0.0), "The grid is too coarse"),
            (page(1e-7, 0.02, 0.5), "is off"),
            (section(&json!({}), false), "Not all errors"),
            (section(&json!({}), true), "has no modes"),
            (section(&json!({"error_semidiscrete": 2e-3}), true), "of the time steps"),
        ] {
            assert!(found.contains(words), "{words}: {found}");
        }
        let found = page(1e-7, 0.02, 0.0);
        assert!(found.contains("f 2.00 %") && found.contains("far smaller"), "{found}");
    }

    /// An accuracy that was asked for decides, whatever the tolerance.
    #[test]
    fn a_goal_is_met_or_missed() {
        let missed = Some("accuracy MISSED");
        for ([goal_error, goal_estimate], error, sentence, mark, words) in [
            ([Some(0.2), Some(0.4)], 0.25, None, Mark::Good, "0.3 of the density"),
            ([Some(0.4), Some(0.2)], 0.25, missed, Mark::Bad, "MISSED"),
            ([None, Some(0.2)], 0.25, None, Mark::Good, "expect an error of 0.2"),
            ([None, None], 0.25, None, Mark::Bad, "not measured"),
            ([None, None], 0.05, None, Mark::Unknown, "not measured"),
        ] {
            let goal = Some(0.3);
            let accuracy = Accuracy { goal, goal_error, goal_estimate, ..Accuracy::default() };
            let measured = GridErrorPair { field: Some(error), density: None };
            let accuracy = accuracy.with_grid(measured, GridErrorPair::default());
            let missed = MissedGoals { accuracy: sentence.map(str::to_owned), tolerance: None };
            let (accuracy, missed) = (Some(accuracy), Some(missed));
            let found = grid(&Judgement { accuracy, missed, ledger: None, continued: None });
            assert_eq!(found.mark, mark, "{}", found.text);
            assert!(found.text.contains(words), "{}", found.text);
        }
    }

    /// The error of a continued run is that since time 0; the inherited part is shown.
    #[test]
    fn inherited_errors_are_reported() {
        let accuracy = Accuracy {
            algorithm: Some(3e-3),
            asked: Some(1e-6),
            grid: Some(0.02),
            ..Accuracy::default()
        };
        let summary = json!({
            "tolerance": 1e-6, "accuracy": accuracy, "missed": MissedGoals::default(),
            "continued": { "error_inherited": 2e-3 },
        });
        let found = algorithm(&summary, &Judgement::of(&summary));
        assert_eq!(found.mark, Mark::Bad);
        assert!(found.text.contains("0.002 of it inherited"), "{}", found.text);
    }
}
