//! The readout as columns of `result.h5` and as `readout.csv`.

use crate::base::disk;
use crate::base::error::Result;
use crate::base::text::joined;
use crate::problem::case::Case;
use crate::quantum::labelled_number::LabelledNumber;
use crate::quantum::readout::Readout;
use crate::quantum::readout::row::{OverlapEstimator, reason};
use std::fmt::Write;
use std::path::Path;

/// Name of the file.
pub const NAME: &str = "readout.csv";

/// Columns of `/readout`.
const COLUMNS: [(&str, &str); 13] = [
    ("cell", "number of the space cell, the last axis fastest"),
    ("observable", "0 density, 1 to 3 momentum along x, y, z, 4 to 6 mean velocity"),
    (
        "estimator",
        "0 Hadamard test, 1 amplitude estimation, 2 all-zero outcome; 3, 4 as 0, 1 of the enlarged \
         state",
    ),
    ("value", "of the recovered field"),
    ("overlap", "overlap of the moment's state"),
    ("shots", "shots, or runs of amplitude estimation"),
    ("evaluations", "values of the register of amplitude estimation"),
    ("estimate", "as measured"),
    ("standard_error", "standard error of the estimate"),
    ("bound", "bound on the error of the estimate"),
    ("evolutions_repeated", "evolutions, postselection repeated"),
    ("evolutions_coherent", "evolutions, coherent, those for C_f included"),
    ("evolutions_norm", "of these for C_f"),
];

/// The largest number of values that a case's readout writes into `result.h5`.
pub fn numbers(case: &Case) -> usize {
    let observables = 1 + 2 * case.space.dimension();
    let cells = case.readout.as_ref().map_or(0, |r| r.cells.len());
    COLUMNS.len() * OverlapEstimator::ALL.len() * observables * cells
}

/// A column of `/readout`.
pub struct ReadoutColumn {
    /// Name of its dataset.
    pub name: &'static str,
    /// The meaning of its numbers.
    pub description: &'static str,
    /// A number for every row and estimator, NaN where it is not known.
    pub values: Vec<f64>,
}

impl Readout {
    /// The columns of `/readout`.
    pub fn columns(&self) -> Vec<ReadoutColumn> {
        let known = LabelledNumber::or_nan;
        let mut columns =
            COLUMNS.map(|(name, description)| ReadoutColumn { name, description, values: vec![] });
        for row in &self.rows {
            for m in &row.measured {
                let place = [
                    row.number as f64,
                    f64::from(row.observable.number()),
                    f64::from(m.estimator as u32),
                    known(&row.value),
                ];
                let numbers = place.into_iter().chain(m.figures().map(known));
                for (column, number) in columns.iter_mut().zip(numbers) {
                    column.values.push(number);
                }
            }
        }
        columns.into()
    }

    /// Writes `readout.csv` into `directory`.
    ///
    /// # Errors
    /// [`crate::base::error::Error::Output`].
    pub fn write(&self, directory: &Path) -> Result<()> {
        disk::write_text(&directory.join(NAME), &self.csv())
    }

    /// A heading, then a line for every row and estimator. Whole numbers have no point. Numbers
    /// that are not known are empty; the last column says why.
    pub fn csv(&self) -> String {
        let figures = COLUMNS.map(|(name, _)| name)[4..].join(",");
        let mut text = format!("cell,point,observable,value,estimator,{figures},unavailable\n");
        let text_of = |x: f64| {
            if x.fract() == 0.0 && x.abs() < 1e15 { format!("{x:.0}") } else { format!("{x:?}") }
        };
        let number = |figure: &LabelledNumber| figure.value().map_or(String::new(), text_of);
        for row in &self.rows {
            let cell = joined(&row.cell, " ");
            let point: Vec<String> = row.point.iter().map(f64::to_string).collect();
            let point = point.join(" ");
            let start = format!("{cell},{point},{},{}", row.observable.name(), number(&row.value));
            if row.measured.is_empty() {
                let _ = writeln!(text, "{start},,,,,,,,,,,\"{}\"", reason(&row.value));
            }
            for m in &row.measured {
                let figures = m.figures();
                let numbers: Vec<String> = figures.iter().map(|f| number(f)).collect();
                let _ = writeln!(
                    text,
                    "{start},{},{},\"{}\"",
                    m.estimator.name(),
                    numbers.join(","),
                    reason(&m.estimate)
                );
            }
        }
        text
    }
}
