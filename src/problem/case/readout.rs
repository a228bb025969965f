//! `[readout]`: the observables of the result that are measured on a quantum computer.

use crate::base::error::Result;
use crate::problem::case::file::CaseFile;
use crate::problem::case::reader::List;
use crate::problem::grid::{Axis, PhaseSpace, SPACE_NAMES};
use crate::problem::limits::{LARGEST_NUMBER, MOST_EVALUATIONS, MOST_SHOTS};
use serde::Deserialize;

/// Largest number of cells that are read. A quantum computer has no advantage in reading all cells,
/// and each cell takes some 15 kB of `summary.json`.
const MOST_READ: usize = 256;

/// The observables of the result that are measured on a quantum computer (see
/// [`crate::quantum::readout`]).
#[derive(Clone, Debug, PartialEq)]
pub struct ReadoutSettings {
    /// The space cells that are read, by their number along each axis, from 0.
    pub cells: Vec<Vec<usize>>,
    /// How often each observable is measured.
    pub effort: MeasurementEffort,
    /// `readout.seed`: the seed of the random numbers.
    pub seed: u64,
}

/// How often an observable is measured.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum MeasurementEffort {
    /// A given number of times.
    Given {
        /// Shots of a Hadamard test.
        shots: u64,
        /// Number of values of the register of amplitude estimation, a power of two.
        evaluations: u64,
    },
    /// As often as it takes to know density and momentum to this absolute accuracy.
    Accuracy(f64),
}

/// `[readout]` as it is written.
#[derive(Debug, Deserialize)]
pub struct ReadoutTable {
    cells: Option<List<List<f64>>>,
    points: Option<List<List<f64>>>,
    shots: Option<i64>,
    evaluations: Option<i64>,
    accuracy: Option<f64>,
    #[serde(default)]
    seed: i64,
}

impl ReadoutTable {
    /// The measured observables on the grid `space`.
    pub fn check(&self, file: &CaseFile<'_>, space: &PhaseSpace) -> Result<ReadoutSettings> {
        Ok(ReadoutSettings {
            cells: self.cells(file, space)?,
            effort: self.effort(file)?,
            seed: file.count("readout.seed", self.seed, 0)? as u64,
        })
    }

    fn effort(&self, file: &CaseFile<'_>) -> Result<MeasurementEffort> {
        let Some(accuracy) = self.accuracy else {
            return Ok(MeasurementEffort::Given {
                shots: self.shots(file)?,
                evaluations: self.evaluations(file)?,
            });
        };
        if let Some(key) =
            (["readout.shots", "readout.evaluations"].into_iter()).find(|k| file.has(k))
        {
            return file.refuse(key, "follows from readout.accuracy; give one of them");
        }
        let least = 1.0 / LARGEST_NUMBER;
        file.within("readout.accuracy", accuracy, least..=LARGEST_NUMBER, || {
            format!("must be above 0, between {least:e} and {LARGEST_NUMBER:e}")
        })
        .map(MeasurementEffort::Accuracy)
    }

    fn shots(&self, file: &CaseFile<'_>) -> Result<u64> {
        let key = "readout.shots";
        let shots = file.count(key, self.shots.unwrap_or(10_000), 1)?;
        if shots as f64 > MOST_SHOTS {
            return file.refuse(key, format!("must be at most {MOST_SHOTS:e}"));
        }
        Ok(shots as u64)
    }

    fn evaluations(&self, file: &CaseFile<'_>) -> Result<u64> {
        let key = "readout.evaluations";
        let evaluations = file.count(key, self.evaluations.unwrap_or(256), 2)?;
        if !evaluations.is_power_of_two() || evaluations as f64 > MOST_EVALUATIONS {
            let message = format!(
                "is the number of values of a register of qubits; a power of two, at most \
                 {MOST_EVALUATIONS:e}, expected"
            );
            return file.refuse(key, message);
        }
        Ok(evaluations as u64)
    }

    /// The space cells, by `cells` or by `points`.
    fn cells(&self, file: &CaseFile<'_>, space: &PhaseSpace) -> Result<Vec<Vec<usize>>> {
        let (key, List(rows)) = match (&self.cells, &self.points) {
            (Some(_), Some(_)) => {
                let message = "give either readout.cells or readout.points";
                return file.refuse_either(["readout.points", "readout.cells"], message);
            }
            (Some(rows), None) => ("readout.cells", rows),
            (None, Some(rows)) => ("readout.points", rows),
            (None, None) => {
                return file.refuse(
                    "readout.cells",
                    "missing; a list of space cells, counted from 0, or readout.points, a list of \
                     points",
                );
            }
        };
        let n = space.dimension();
        if rows.iter().any(|List(row)| row.len() != n) {
            let plural = if n == 1 { "" } else { "s" };
            let message = format!("a list of lists of {n} number{plural} each expected");
            return file.refuse(key, message);
        }
        if rows.is_empty() || rows.len() > MOST_READ {
            let message = format!("{} given; 1 to {MOST_READ} are read", rows.len());
            return file.refuse(key, message);
        }
        let by_number = self.cells.is_some();
        let cell = |List(row): &List<f64>| -> Result<Vec<usize>> {
            let axes = space.x.iter().zip(row).enumerate();
            axes.map(|(a, (axis, &x))| {
                let cell = if by_number { cell_of_number(axis, x) } else { axis.cell_holding(x) };
                cell.ok_or_else(|| {
                    let allowed = if by_number {
                        format!("whole numbers from 0 to {}", axis.cells - 1)
                    } else {
                        format!("numbers from {} to {}", axis.lower, axis.upper)
                    };
                    let name = SPACE_NAMES[a];
                    file.error(key, &format!("{x} along {name}; {allowed} expected"))
                })
            })
            .collect()
        };
        rows.iter().map(cell).collect()
    }
}

/// The cell of `axis` whose number is `x`.
fn cell_of_number(axis: &Axis, x: f64) -> Option<usize> {
    let known = x.fract() == 0.0 && x >= 0.0 && x < axis.cells as f64;
    known.then_some(x as usize)
}
