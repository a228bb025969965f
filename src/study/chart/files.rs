//! `chart.csv`, `chart.json`, and the table on the terminal.

use crate::base::error::Result;
use crate::base::table::{self, Column, ColumnValues, in_pieces};
use crate::base::text::{counted, json_text};
use crate::problem::exported::ExportOwner;
use crate::study::chart::entry::{ChartEntry, Status};
use crate::study::chart::picture::{self, MIB};
use crate::study::chart::result::Chart;
use crate::study::chart::verdict::expected_seconds_text;
use crate::study::choices::distinct;
use crate::study::files::write_study;
use serde_json::Value;
use std::fmt;
use std::path::Path;

/// Columns of `chart.csv`: all of an [`ChartEntry`], in its order.
#[rustfmt::skip]
pub const COLUMNS: [&str; 43] = [
    "status", "reason", "expected_seconds", "expected_at_least", "as_given", "paper", "method",
    "grid", "degree", "flux", "cells", "interface", "integrator", "limiter", "cfl",
    "profile", "coefficients", "weights", "no_jump", "embedding", "propagator", "step", "tolerance",
    "points", "modes",
    "applications", "solves", "seconds", "total_seconds", "memory_bytes_per_rank", "error_exact",
    "error_exact_l2", "error_semidiscrete", "error_estimate", "probability_window",
    "probability_slice", "until_measured", "measured_by", "front_exact", "front_seconds",
    "front_applications", "front_until_measured", "warnings",
];

/// A field of the CSV table, on one line.
fn field(value: &Value) -> String {
    let text = match value {
        Value::Null => String::new(),
        Value::String(text) => text.clone(),
        Value::Array(list) => list.iter().map(json_text).collect::<Vec<_>>().join("; "),
        other => other.to_string(),
    };
    text.replace(['\n', '\r'], " ")
}

/// `chart.csv`: a line of names, then one a trial.
pub fn csv(entries: &[ChartEntry]) -> String {
    let rows = entries.iter().map(|entry| serde_json::to_value(entry).unwrap_or_default());
    let rows: Vec<Value> = rows.collect();
    let cells = |name: &str| rows.iter().map(|row| field(&row[name]).into()).collect::<Vec<_>>();
    table::csv(&COLUMNS.map(|name| ColumnValues::new(name, cells(name))))
}

impl Chart {
    /// Writes `chart.csv`, `chart.json`, `chart.svg` and `chart.png` of the case `owner` into
    /// `directory`. On one rank.
    ///
    /// # Errors
    /// [`crate::base::error::Error::Output`].
    pub fn write(&self, directory: &Path, owner: &ExportOwner) -> Result<()> {
        write_study(directory, owner, self, &csv(&self.entries), &picture::figure(self))
    }

    /// Prints the number of settings left out, by method.
    fn left_out(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let left_out = || self.entries.iter().filter(|e| e.status == Status::LeftOut);
        let methods = distinct(left_out().map(ChartEntry::method_name));
        if methods.is_empty() {
            return Ok(());
        }
        writeln!(f, "\nleft out, with the time expected of each (all of them in chart.csv):")?;
        for name in methods {
            let all: Vec<&ChartEntry> = left_out().filter(|e| e.method_name() == name).collect();
            let settings = counted(all.len(), "setting", "settings");
            writeln!(f, "  {name}: {settings}, {}", expected_seconds_text(&all))?;
        }
        Ok(())
    }
}

impl fmt::Display for Chart {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let fronts = |e: &ChartEntry| {
            let marks = [
                ('e', e.front_exact),
                ('s', e.front_seconds),
                ('a', e.front_applications),
                ('m', e.front_until_measured),
            ];
            let on = marks.into_iter().filter(|(_, on)| *on);
            on.map(|(mark, _)| mark).collect::<String>()
        };
        let mut rows: Vec<&ChartEntry> =
            (self.entries.iter()).filter(|e| !fronts(e).is_empty()).collect();
        let key = |e: &&ChartEntry| (e.cells, e.method as u8);
        rows.sort_by_key(key);
        if rows.is_empty() {
            writeln!(f, "{}: no trial is on a front\n", self.title)?
        } else {
            writeln!(f, "{}, on a front:\n", self.title)?;
            table(f, &rows, &fronts)?;
        }
        for sentence in &self.sentences {
            writeln!(f, "{sentence}")?;
        }
        self.left_out(f)
    }
}

/// A number of the table; a dash if there is none.
fn error(x: Option<f64>) -> String {
    x.map_or("-".to_owned(), |x| format!("{x:.2e}"))
}

/// A column of numbers on the terminal: its name, and the text of an entry.
type NumberColumn = (&'static str, fn(&ChartEntry) -> String);

/// Columns of numbers on the terminal.
#[rustfmt::skip]
const TABLE: [NumberColumn; 7] = [
    ("exact", |e| error(e.error_exact)),
    ("semi-discrete", |e| error(e.error_semidiscrete)),
    ("seconds", |e| e.seconds.map_or("-".to_owned(), |s| format!("{s:.4}"))),
    ("applications", |e| e.applications.map_or("-".to_owned(), |n| n.to_string())),
    ("MiB", |e| e.memory_bytes_per_rank.map_or("-".to_owned(), mib_text)),
    ("P(window)", |e| error(e.probability_window)),
    ("P(slice)", |e| error(e.probability_slice)),
];

fn mib_text(bytes: u64) -> String {
    format!("{:.0}", bytes as f64 / MIB)
}

/// A line of titles, a line for each entry, and the meaning of the columns.
fn table(
    f: &mut fmt::Formatter<'_>,
    rows: &[&ChartEntry],
    fronts: &dyn Fn(&ChartEntry) -> String,
) -> fmt::Result {
    let of = |text: &dyn Fn(&ChartEntry) -> String| -> Vec<String> {
        rows.iter().map(|e| text(e)).collect()
    };
    let numbers = (1..=rows.len()).map(|number| number.to_string());
    let words = [
        Column::of_words("grid", of(&|e| e.grid.clone())),
        Column::of_words("method", of(&ChartEntry::name)),
        Column::of_words("front", of(fronts)),
    ];
    let numbers_of = TABLE.iter().map(|(name, text)| Column::new(name, of(text)));
    let columns: Vec<Column> = words.into_iter().chain(numbers_of).collect();
    writeln!(f, "{}", in_pieces(&Column::new("trial", numbers), &columns))?;
    writeln!(
        f,
        "exact: relative error against the exact solution.\n\
         semi-discrete: against that of the grid.\n\
         P: probability of finding the field in the window of p, or in the slice at p◇.\n\
         fronts, of classical methods and of modes apart:\n  \
         e  exact error against seconds\n  \
         s  semi-discrete error against seconds\n  \
         a  semi-discrete error against applications\n  \
         m  semi-discrete error against applications until the field is measured\n"
    )
}
