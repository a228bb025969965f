//! Common checks: all rows of a table, bounds, and the tolerance of a run.

use super::files::number;
use super::launch::SLOTS;
use super::outcome::{Finished, Summary};
use super::refusal::refused;
use std::io::Write;
use std::path::Path;
use std::sync::atomic::{AtomicUsize, Ordering};
use std::sync::{Mutex, PoisonError};

/// The number in an environment variable, which `make torture` sets, or `default`.
pub fn number_from_environment(name: &str, default: u64) -> u64 {
    std::env::var(name).ok().and_then(|text| text.parse().ok()).unwrap_or(default)
}

/// Checks every row of a table, several at a time. Fails with the messages of all rows that failed.
pub fn check_all<T: Sync>(rows: &[T], check: impl Fn(&T) -> Result<(), String> + Sync) {
    assert!(!rows.is_empty(), "a table without rows tests nothing");
    let next = AtomicUsize::new(0);
    let failures = Mutex::new(Vec::new());
    std::thread::scope(|scope| {
        for _ in 0..SLOTS.min(rows.len()) {
            scope.spawn(|| {
                while let Some(row) = rows.get(next.fetch_add(1, Ordering::Relaxed)) {
                    if let Err(failure) = check(row) {
                        let mut failures = failures.lock().unwrap_or_else(PoisonError::into_inner);
                        failures.push(failure);
                    }
                }
            });
        }
    });
    let failures = failures.into_inner().unwrap_or_else(PoisonError::into_inner);
    assert!(
        failures.is_empty(),
        "{} of {} failed:\n\n{}\n",
        failures.len(),
        rows.len(),
        failures.join("\n\n")
    );
}

/// Returns an error with the whole output of the job unless `holds`.
pub fn require(
    holds: bool,
    finished: &Finished,
    what: impl FnOnce() -> String,
) -> Result<(), String> {
    if holds { Ok(()) } else { Err(finished.report(&what())) }
}

/// Checks that `value` is at most `limit`. NaN fails.
pub fn at_most(what: &str, value: f64, limit: f64) -> Result<(), String> {
    if value <= limit {
        Ok(())
    } else {
        Err(format!("{what} is {value:e}, at most {limit:e} expected"))
    }
}

/// Checks that `value` differs from `expected` by at most `by`. NaN fails.
pub fn near(what: &str, value: f64, expected: f64, by: f64) -> Result<(), String> {
    if (value - expected).abs() <= by {
        Ok(())
    } else {
        Err(format!("{what} is {value}, {expected} ± {by:e} expected"))
    }
}

/// Checks what every Schrödingerized run with `solver.verify` must satisfy: the tolerance is met,
/// the error estimate is right up to a factor 3 or marked as unreliable, and modes keep their
/// norms.
pub fn meets_its_tolerance(summary: &Summary) -> Result<(), String> {
    meets_its_tolerance_within(summary, 3.0)
}

/// The same, with an error estimate that may be wrong by `factor`.
pub fn meets_its_tolerance_within(summary: &Summary, factor: f64) -> Result<(), String> {
    tolerance_is_met(summary)?;
    estimate_is_right_or_silent(summary, factor)?;
    let defect = summary.number("unitarity_defect")?;
    summary.require(defect > 0.0 && defect <= 1.0, || {
        format!("unitarity_defect {defect}, above 0 and at most 1 expected")
    })
}

/// Checks that the error is at most the tolerance.
pub fn tolerance_is_met(summary: &Summary) -> Result<(), String> {
    let (error, tolerance) = (summary.number("error_semidiscrete")?, summary.number("tolerance")?);
    summary.holds(at_most("error_semidiscrete", error, tolerance))
}

/// Checks that the error estimate is right up to `factor` or marked as unreliable.
pub fn estimate_is_right_or_silent(summary: &Summary, factor: f64) -> Result<(), String> {
    let (error, estimate) =
        (summary.number("error_semidiscrete")?, summary.number("error_estimate")?);
    let reliable = summary.boolean("error_estimate_reliable")?;
    let ratio = estimate / error;
    let right = (1.0 / factor..=factor).contains(&ratio);
    summary.require(!reliable || right, || {
        format!("error_estimate {estimate:e}, called reliable: {ratio:.3} times the true {error:e}")
    })
}

/// Checks that a run with `solver.verify` ended with an error of at most `tolerance`, or was
/// refused with a message that contains all of `wording`.
pub fn solved_or_refused(
    finished: &Finished,
    directory: &Path,
    tolerance: f64,
    wording: &[&str],
) -> Result<(), String> {
    if finished.code == Some(2) {
        return refused(finished, wording);
    }
    require(finished.code == Some(0), finished, || "neither solved nor refused".into())?;
    let value = Summary::read(finished.clone(), directory)?.value;
    let error = number(&value["error_semidiscrete"]);
    require(error <= tolerance, finished, || {
        format!(
            "called a success: error_semidiscrete {}, tolerance {tolerance:e}, maximum of f {}",
            value["error_semidiscrete"], value["maximum"]
        )
    })
}

/// Reports that the tests in `file` are skipped, and why. If the environment variable is
/// `required`, this is a failure.
pub fn skipped(variable: &str, file: &str, why: &str) {
    let required = std::env::var(variable).is_ok_and(|v| v == "required");
    assert!(!required, "{why}");
    // Not through the test's own output, which is shown of failures only.
    let _ = writeln!(std::io::stderr(), "SKIPPED: {file}: {why}");
}
