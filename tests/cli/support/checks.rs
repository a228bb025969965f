//! What tests check often: a table of rows, a bound, a tolerance that is met, a refusal.

use super::launch::SLOTS;
use super::outcome::{Finished, Summary};
use std::path::Path;
use std::sync::atomic::{AtomicUsize, Ordering};
use std::sync::{Mutex, PoisonError};

/// Checks every row of a table, several at a time, and fails with all that failed.
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
    let failures = failures
        .into_inner()
        .unwrap_or_else(PoisonError::into_inner);
    assert!(
        failures.is_empty(),
        "{} of {} failed:\n\n{}\n",
        failures.len(),
        rows.len(),
        failures.join("\n\n")
    );
}

/// Slower than this is no answer to bad input; mpirun itself takes one to two seconds to end a job that failed.
pub const SECONDS_TO_REFUSE: f64 = 10.0;

pub fn require(
    holds: bool,
    finished: &Finished,
    what: impl FnOnce() -> String,
) -> Result<(), String> {
    if holds {
        Ok(())
    } else {
        Err(finished.report(&what()))
    }
}

/// `value` is at most `limit`; written so that NaN fails.
pub fn at_most(what: &str, value: f64, limit: f64) -> Result<(), String> {
    if value <= limit {
        Ok(())
    } else {
        Err(format!("{what} is {value:e}, at most {limit:e} expected"))
    }
}

pub fn near(what: &str, value: f64, expected: f64, by: f64) -> Result<(), String> {
    if (value - expected).abs() <= by {
        Ok(())
    } else {
        Err(format!("{what} is {value}, {expected} ± {by:e} expected"))
    }
}

/// What holds for every Schrödingerized run with `solver.verify`.
pub fn meets_its_tolerance(summary: &Summary) -> Result<(), String> {
    meets_its_tolerance_within(summary, 3.0)
}

/// The same, with an estimate that may be wrong by `factor`.
pub fn meets_its_tolerance_within(summary: &Summary, factor: f64) -> Result<(), String> {
    let tolerance = summary.number("tolerance")?;
    let error = summary.number("error_semidiscrete")?;
    let outcome = at_most("error_semidiscrete", error, tolerance);
    summary.require(outcome.is_ok(), || outcome.unwrap_err())?;
    let estimate = summary.number("error_estimate")?;
    let reliable = summary.boolean("error_estimate_reliable")?;
    let ratio = estimate / error;
    summary.require(!reliable || (1.0 / factor..=factor).contains(&ratio), || {
        format!("error_estimate {estimate:e} is {ratio:.3} times the true error {error:e}, and called reliable")
    })?;
    let defect = summary.number("unitarity_defect")?;
    summary.require(defect > 0.0 && defect <= 1.0, || {
        format!("unitarity_defect {defect}, above 0 and at most 1 expected")
    })
}

/// Refused as a mistake of the user: exit code 2, soon, with one message, from rank 0, that says all of `says`.
pub fn refused(finished: &Finished, says: &[&str]) -> Result<(), String> {
    let message = &finished.errors;
    require(finished.code == Some(2), finished, || {
        "exit code 2 expected".into()
    })?;
    require(finished.others.is_empty(), finished, || {
        "only rank 0 speaks".into()
    })?;
    let errors = message.matches("error: ").count();
    require(errors == 1, finished, || {
        format!("one message expected, \"error: \" occurs {errors} times")
    })?;
    let before = message.split("error: ").next().unwrap_or_default();
    let at_once = before.lines().all(|l| l.starts_with("warning: "));
    require(at_once, finished, || {
        format!("said before it was refused: {before}")
    })?;
    for crash in ["panicked", "backtrace", "RUST_BACKTRACE", "signal"] {
        require(!message.contains(crash), finished, || {
            format!("\"{crash}\"")
        })?;
    }
    for words in says {
        require(message.contains(words), finished, || {
            format!("the message does not say \"{words}\"")
        })?;
    }
    let seconds = finished.seconds;
    require(seconds < SECONDS_TO_REFUSE, finished, || {
        format!("refused after {seconds:.1} s")
    })
}

/// Done, with the error that was asked for (`solver.verify`), or refused with a message that says all of `says`.
pub fn solved_or_refused(
    finished: &Finished,
    directory: &Path,
    tolerance: f64,
    says: &[&str],
) -> Result<(), String> {
    if finished.code == Some(2) {
        return refused(finished, says);
    }
    require(finished.code == Some(0), finished, || {
        "neither solved nor refused".into()
    })?;
    let text = std::fs::read_to_string(directory.join("summary.json"))
        .map_err(|e| finished.report(&format!("summary.json: {e}")))?;
    let value: serde_json::Value =
        serde_json::from_str(&text).map_err(|e| finished.report(&format!("summary.json: {e}")))?;
    let error = value["error_semidiscrete"].as_f64().unwrap_or(f64::NAN);
    require(error <= tolerance, finished, || {
        format!(
            "called a success: error_semidiscrete {}, tolerance {tolerance:e}, largest value of f {}",
            value["error_semidiscrete"], value["maximum"]
        )
    })
}
