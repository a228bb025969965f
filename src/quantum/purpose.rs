//! The purposes for which a case is taken to the quantum side, and the cases that each refuses.

use crate::base::error::{Error, Result};
use crate::problem::case::{Case, Method};
use crate::quantum::readout::MEASURE_VALUED;

/// The use of a case on the quantum side.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum CasePurpose {
    /// Counts of queries, gates and qubits.
    Counts,
    /// Files of states, `H` and circuits.
    States,
    /// Files of `A`, `b` and `(S, K)`.
    Matrices,
    /// Moments as they would be measured.
    Readout,
}

/// A property of a case that some purpose does not allow.
#[derive(Clone, Copy)]
enum Obstacle {
    ClassicalMethod,
    MeasureValued,
    InflowInTime,
    WarpedStart,
}

impl CasePurpose {
    /// Why `case` does not serve this purpose; `None` if it does.
    pub fn why_not(self, case: &Case) -> Option<String> {
        Some(self.sentence(self.obstacle(case)?, case))
    }

    /// Refuses a case that does not serve this purpose.
    ///
    /// # Errors
    /// [`Error::Input`] with the key and what would do.
    pub fn refuse(self, case: &Case) -> Result<()> {
        let Some(obstacle) = self.obstacle(case) else { return Ok(()) };
        let place = match (self, obstacle, &case.warped_start) {
            (Self::Counts, Obstacle::WarpedStart, Some(start)) => &start.place,
            _ => &case.name,
        };
        Err(Error::Input(format!("{place}: {}", self.sentence(obstacle, case))))
    }

    fn obstacle(self, case: &Case) -> Option<Obstacle> {
        use Obstacle::{ClassicalMethod, InflowInTime, MeasureValued, WarpedStart};
        let obstacles: &[Obstacle] = match self {
            Self::Counts => &[ClassicalMethod, InflowInTime, WarpedStart],
            Self::States => &[ClassicalMethod, MeasureValued, InflowInTime, WarpedStart],
            Self::Matrices => &[InflowInTime, WarpedStart],
            Self::Readout => &[MeasureValued, ClassicalMethod, InflowInTime],
        };
        let is_there = |obstacle: &Obstacle| match obstacle {
            ClassicalMethod => case.method == Method::Classical,
            MeasureValued => case.is_measure_valued(),
            InflowInTime => case.varies(),
            WarpedStart => case.warped_start.is_some(),
        };
        obstacles.iter().copied().find(is_there)
    }

    fn sentence(self, obstacle: Obstacle, case: &Case) -> String {
        let words = match (obstacle, self) {
            (Obstacle::ClassicalMethod, Self::Readout) => {
                "solver.method = \"classical\" prepares no quantum state"
            }
            (Obstacle::ClassicalMethod, _) => {
                "solver.method = \"classical\" has no quantum algorithm; choose \"schrodingerized\""
            }
            (Obstacle::MeasureValued, Self::Readout) => MEASURE_VALUED,
            (Obstacle::MeasureValued, _) => {
                "initial.density: phi and psi of measure-valued data are separate states; \
                 initial.f is one"
            }
            (Obstacle::InflowInTime, Self::Readout) => {
                "what enters depends on t, and the evolution is that of a Hamiltonian that does not"
            }
            (Obstacle::InflowInTime, _) => {
                let others = match self {
                    Self::Counts => "the paper's counts hold for a generator that does not",
                    Self::Matrices => "b, which is exported, does not",
                    Self::States | Self::Readout => "H does not",
                };
                return format!("{} depends on t; {others}", case.inflow_key());
            }
            (Obstacle::WarpedStart, Self::Counts) => {
                "the counts hold for an initial state u(0) g(p), and a file may hold any other; \
                 give initial.f"
            }
            (Obstacle::WarpedStart, Self::Matrices) => {
                "initial.warped: the start is in that file; initial.f can be exported"
            }
            (Obstacle::WarpedStart, Self::States | Self::Readout) => {
                "initial.warped: a start u(0) g(p) is exported, and a file holds any"
            }
        };
        words.to_owned()
    }
}
