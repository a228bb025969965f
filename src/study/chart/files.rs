//! `chart.csv`, `chart.json`, and the table on the terminal.

use crate::base::error::Result;
use crate::base::text::csv_field;
use crate::study::chart::entry::{Entry, Status};
use crate::study::chart::picture;
use crate::study::chart::result::Chart;
use crate::study::chart::verdict::expected;
use crate::study::files::Files;
use serde_json::Value;
use std::fmt;
use std::path::Path;

/// Columns of `chart.csv`: all of an [`Entry`], in its order.
#[rustfmt::skip]
pub const COLUMNS: [&str; 42] = [
    "status", "reason", "expected_seconds", "expected_at_least", "as_given", "paper", "method",
    "grid", "degree", "cells", "interface", "integrator", "limiter", "cfl", "profile",
    "coefficients", "weights", "no_jump", "embedding", "propagator", "step", "tolerance",
    "points", "modes",
    "applications", "solves", "seconds", "total_seconds", "memory_bytes_per_rank", "error_exact",
    "error_exact_l2", "error_semidiscrete", "error_estimate", "probability_window",
    "probability_slice", "until_measured", "measured_by", "front_exact", "front_seconds",
    "front_applications", "front_until_measured", "warnings",
];

/// A field of the table, on one line.
fn field(value: &Value) -> String {
    let text = match value {
        Value::Null => String::new(),
        Value::String(text) => text.clone(),
        Value::Array(list) => list.iter().map(field_text).collect::<Vec<_>>().join("; "),
        other => other.to_string(),
    };
    csv_field(&text.replace(['\n', '\r'], " "))
}

fn field_text(value: &Value) -> String {
    value.as_str().map_or_else(|| value.to_string(), str::to_owned)
}

/// `chart.csv`: a line of names, then one a trial.
pub fn csv(entries: &[Entry]) -> String {
    let mut text = COLUMNS.join(",") + "\n";
    for entry in entries {
        let row = serde_json::to_value(entry).unwrap_or_default();
        let fields: Vec<String> = COLUMNS.iter().map(|name| field(&row[*name])).collect();
        text += &(fields.join(",") + "\n");
    }
    text
}

impl Chart {
    /// Writes `chart.csv`, `chart.json`, `chart.svg` and `chart.png` into `directory`. On one rank.
    ///
    /// # Errors
    /// [`crate::base::error::Error::Output`].
    pub fn write(&self, directory: &Path) -> Result<()> {
        let (table, figure) = (csv(&self.entries), picture::figure(self));
        Files { name: "chart", found: self, table, figure }.write(directory)
    }
}

impl fmt::Display for Chart {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let fronts = |e: &Entry| {
            let marks = [
                ('e', e.front_exact),
                ('s', e.front_seconds),
                ('a', e.front_applications),
                ('m', e.front_until_measured),
            ];
            let on = marks.into_iter().filter(|(_, on)| *on);
            on.map(|(mark, _)| mark).collect::<String>()
        };
        let mut rows: Vec<&Entry> =
            (self.entries.iter()).filter(|e| !fronts(e).is_empty()).collect();
        let key = |e: &&Entry| (e.cells, e.method as u8);
        rows.sort_by_key(key);
        match rows.is_empty() {
            true => writeln!(f, "{}: no trial is on a front\n", self.title)?,
            false => {
                writeln!(f, "{}, on a front:\n", self.title)?;
                table(f, &rows, &fronts)?;
            }
        }
        for sentence in &self.sentences {
            writeln!(f, "{sentence}")?;
        }
        self.left_out(f)
    }
}

/// A number of the table; a dash where there is none.
fn error(x: Option<f64>) -> String {
    x.map_or("-".to_owned(), |x| format!("{x:.2e}"))
}

/// A column of the table on the terminal.
struct Column {
    title: &'static str,
    width: usize,
    text: fn(&Entry) -> String,
}

/// Columns between the method and the fronts.
#[rustfmt::skip]
const TABLE: [Column; 7] = [
    Column { title: "exact", width: 9, text: |e| error(e.error_exact) },
    Column { title: "semi-discrete", width: 13, text: |e| error(e.error_semidiscrete) },
    Column { title: "seconds", width: 9,
             text: |e| e.seconds.map_or("-".to_owned(), |s| format!("{s:.4}")) },
    Column { title: "applications", width: 12,
             text: |e| e.applications.map_or("-".to_owned(), |n| n.to_string()) },
    Column { title: "MiB", width: 7,
             text: |e| e.memory_bytes_per_rank.map_or("-".to_owned(), mib_text) },
    Column { title: "P(window)", width: 9, text: |e| error(e.probability_window) },
    Column { title: "P(slice)", width: 8, text: |e| error(e.probability_slice) },
];

fn mib_text(bytes: u64) -> String {
    format!("{:.0}", bytes as f64 / 1048576.0)
}

/// A line of titles, then one an entry.
fn table(
    f: &mut fmt::Formatter<'_>,
    rows: &[&Entry],
    fronts: &dyn Fn(&Entry) -> String,
) -> fmt::Result {
    let names: Vec<String> = rows.iter().map(|e| e.name()).collect();
    let width = names.iter().map(|n| n.chars().count()).max().unwrap_or(0).max(6);
    let grid = rows.iter().map(|e| e.grid.len()).max().unwrap_or(0).max(4);
    let columns = |text: &dyn Fn(&Column) -> String| -> String {
        TABLE.iter().map(|c| format!("  {:>1$}", text(c), c.width)).collect()
    };
    let titles = columns(&|c| c.title.to_owned());
    writeln!(f, "{:<grid$}  {:<width$}{titles}  front", "grid", "method")?;
    for (e, name) in rows.iter().zip(&names) {
        let numbers = columns(&|c| (c.text)(e));
        writeln!(f, "{:<grid$}  {name:<width$}{numbers}  {}", e.grid, fronts(e))?;
    }
    writeln!(
        f,
        "\nfronts: e exact error against seconds; to the semi-discrete solution of the grid: \
         s against seconds, a against applications, m against applications until it is measured; \
         classical methods and modes apart. P: probability of finding the field in the window of \
         p, or in the slice at p◇\n"
    )?;
    Ok(())
}

impl Chart {
    /// How much was left out of each method; each setting is in `chart.csv` and `chart.json`.
    fn left_out(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let mut methods: Vec<(String, Vec<&Entry>)> = Vec::new();
        for e in (self.entries.iter()).filter(|e| e.status == Status::LeftOut) {
            let name = e.method_name();
            match methods.iter_mut().find(|(other, _)| *other == name) {
                Some((_, all)) => all.push(e),
                None => methods.push((name, vec![e])),
            }
        }
        if methods.is_empty() {
            return Ok(());
        }
        writeln!(f, "\nleft out, with the time expected of each (all of them in chart.csv):")?;
        for (name, all) in methods {
            let settings = match all.len() {
                1 => "1 setting".to_owned(),
                n => format!("{n} settings"),
            };
            writeln!(f, "  {name}: {settings}, {}", expected(&all))?;
        }
        Ok(())
    }
}
