//! The goals that a run misses, and the verdict on its errors in a word.

use crate::base::error::{Error, Result};
use crate::results::accuracy::Accuracy;
use crate::results::continued_result::ContinuedResult;
use serde::{Deserialize, Serialize};

/// An estimate that is not reliable counts as missed from this ratio to the tolerance on: more than
/// such estimates are off (docs/verification.md).
pub const FAR_ABOVE: f64 = 10.0;

/// The goals that a run misses, a sentence for each; `None` for a goal that is met or unknown.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct MissedGoals {
    /// `solver.tolerance`, by the run's own error: the measured one, else the estimate if that is
    /// reliable or far above the tolerance.
    pub tolerance: Option<String>,
    /// `solver.accuracy`.
    pub accuracy: Option<String>,
}

impl MissedGoals {
    /// The sentences about missed goals; `None` if no goal is missed.
    pub fn line(&self) -> Option<String> {
        let both: Vec<&str> = self.tolerance.iter().chain(&self.accuracy).map(|s| &**s).collect();
        (!both.is_empty()).then(|| both.join("; "))
    }

    /// Refuses missed goals if `strict` (`solver.strict`).
    ///
    /// # Errors
    /// [`Error::Missed`].
    pub fn refuse(&self, strict: bool) -> Result<()> {
        self.line().filter(|_| strict).map_or(Ok(()), |line| Err(Error::Missed(line)))
    }
}

/// The errors of a run in a word: the first that applies.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize)]
#[serde(rename_all = "kebab-case")]
pub enum Verdict {
    /// The tolerance or the accuracy is missed, or the latter is not shown; or the error of a
    /// continued run since time 0 is far above the tolerance.
    Missed,
    /// An edge of `V` is not along the axes, and the errors leave out what that adds.
    Staircase,
    /// The grid's error is large, or far larger than the algorithm's.
    UnderResolved,
    /// An error is not known, that of the grid is hidden by that of the algorithm, or a bound on
    /// that of a continued run is above the tolerance.
    Unknown,
    /// None of these.
    Resolved,
}

impl Verdict {
    /// The verdict on a run that misses the goals `missed`.
    pub fn of(
        missed: &MissedGoals,
        accuracy: &Accuracy,
        continued: Option<&ContinuedResult>,
    ) -> Self {
        let ratio = accuracy.ratio_to_tolerance();
        let unknown_before = continued.is_some_and(|before| {
            before.leaves_grid_unknown(accuracy) || before.error_total.is_none()
        });
        if missed.line().is_some() || ratio > FAR_ABOVE {
            Self::Missed
        } else if accuracy.staircase {
            Self::Staircase
        } else if accuracy.under_resolved {
            Self::UnderResolved
        } else if accuracy.unknown.is_some()
            || accuracy.is_hidden_by_algorithm()
            || unknown_before
            || ratio > 1.0
        {
            Self::Unknown
        } else {
            Self::Resolved
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::results::accuracy::GridErrorPair;

    #[test]
    fn a_verdict_is_the_first_that_applies() {
        let missed = MissedGoals { tolerance: Some("MISSED".to_owned()), accuracy: None };
        let good = Accuracy { asked: Some(1e-6), algorithm: Some(1e-7), ..Accuracy::default() };
        let measured = GridErrorPair { field: Some(1e-7), density: None };
        let good = good.with_grid(measured, GridErrorPair::default());
        let error = |algorithm: f64| Accuracy { algorithm: Some(algorithm), ..good.clone() };
        let hidden = Accuracy { includes_algorithm: true, ..error(2e-6) };
        for (accuracy, expected) in [
            (good.clone(), Verdict::Resolved),
            (Accuracy { includes_algorithm: true, ..good.clone() }, Verdict::Resolved),
            (hidden, Verdict::Unknown),
            (error(2e-6), Verdict::Unknown),
            (error(2e-5), Verdict::Missed),
            (Accuracy { unknown: Some("why".to_owned()), ..good.clone() }, Verdict::Unknown),
            (Accuracy { under_resolved: true, ..good.clone() }, Verdict::UnderResolved),
            (Accuracy { staircase: true, ..good.clone() }, Verdict::Staircase),
        ] {
            assert_eq!(Verdict::of(&MissedGoals::default(), &accuracy, None), expected);
            assert_eq!(Verdict::of(&missed, &accuracy, None), Verdict::Missed);
        }
        // Without a tolerance the grid's error does not dominate that of exact steps.
        let exact = Accuracy { algorithm: Some(1e-14), ..Accuracy::default() };
        let exact = exact.with_grid(measured, GridErrorPair::default());
        assert_eq!(Verdict::of(&MissedGoals::default(), &exact, None), Verdict::Resolved);
        let before = ContinuedResult {
            file: String::new(),
            checksum: String::new(),
            time: 0.5,
            error: None,
            error_inherited: None,
            error_total: None,
            grid: GridErrorPair::default(),
        };
        let verdict = Verdict::of(&MissedGoals::default(), &good, Some(&before));
        assert_eq!(verdict, Verdict::Unknown);
    }
}
