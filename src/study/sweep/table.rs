//! The table of a sweep: printed, as `table.csv` and as `table.tex`.

use crate::base::disk;
use crate::base::error::Result;
use crate::base::table::{Column, ColumnValues, csv, in_pieces, tabular};
use crate::base::text::{counted, csv_records, json_text, short, shortened};
use serde_json::Value;
use std::ffi::{OsStr, OsString};
use std::fmt;
use std::io::Read;
use std::path::Path;

/// Entries of `summary.json` in the table, as in the Python package. A column that is empty for all
/// runs is left out.
const ENTRIES: [&str; 14] = [
    "cells", "modes", "matvecs", "error_estimate", "error_semidiscrete", "error_l1_relative",
    "error_density_l1_relative", "accuracy.grid", "accuracy.grid_source", "verdict", "mass",
    "solve_seconds", "wall_seconds", "memory_peak_bytes_per_rank",
];
/// The largest number of characters of a cell on the terminal.
const MOST_SHOWN: usize = 40;
/// The largest number of characters of an error on the terminal.
const LONGEST_ERROR: usize = 180;
/// The largest number of errors on the terminal.
const MOST_ERRORS: usize = 10;
/// First line of `table.tex`.
const TEX_HEAD: &str = "% Written by phasewarp sweep, which replaces it; edit a copy.";
/// Name of the last column.
const DIRECTORY: &str = "directory";
/// The largest number of bytes of a file that may be a table of a sweep.
const MOST_BYTES: u64 = 64 << 20;

/// The value of a dotted key.
pub fn value_of(tree: &Value, key: &str) -> Value {
    let parts: Vec<&str> = key.split('.').map(str::trim).collect();
    tree.pointer(&format!("/{}", parts.join("/"))).cloned().unwrap_or_default()
}

/// A run in the table.
#[derive(Debug)]
pub struct SweepRow {
    /// Values of the varied keys.
    pub values: Vec<Value>,
    /// Directory of the results of the run.
    pub directory: String,
    /// Whether the run ended, with or without an error.
    pub ended: bool,
    /// `summary.json`; null where there is none, and on other ranks than the first.
    pub summary: Value,
    /// The error of the run. If there is a summary, too, the results miss the requested accuracy.
    pub error: Option<String>,
}

impl SweepRow {
    /// The error of the run, or that the run is not finished.
    pub fn problem(&self) -> Option<&str> {
        self.error.as_deref().or((!self.ended).then_some("not finished"))
    }

    /// All warnings as one text; null if there are none.
    fn warnings(&self) -> Value {
        let list = self.summary["warnings"].as_array().map_or(&[][..], Vec::as_slice);
        let list: Vec<&str> = list.iter().filter_map(Value::as_str).collect();
        if list.is_empty() { Value::Null } else { list.join("; ").into() }
    }
}

/// The table, with a row for each run.
#[derive(Debug)]
pub struct SweepTable {
    keys: Vec<String>,
    /// The runs.
    pub rows: Vec<SweepRow>,
}

impl SweepTable {
    /// A table without rows.
    pub fn new(keys: &[String]) -> Self {
        Self { keys: keys.to_vec(), rows: Vec::new() }
    }

    /// Number of runs that failed.
    pub fn failed(&self) -> usize {
        self.rows.iter().filter(|row| row.error.is_some()).count()
    }

    /// The first errors, one a line, each with the number of its run.
    fn errors(&self) -> String {
        let errors =
            (1usize..).zip(&self.rows).filter_map(|(k, row)| Some((k, row.error.as_ref()?)));
        let first = errors.take(MOST_ERRORS).map(|(number, error)| {
            // The other lines show the place in the case file.
            let error = error.lines().next().unwrap_or_default();
            format!("run {number}: {}\n", shortened(error, LONGEST_ERROR))
        });
        let mut text: String = first.collect();
        if let Some(more) = self.failed().checked_sub(MOST_ERRORS).filter(|more| *more > 0) {
            text += &format!("and {} more\n", counted(more, "error", "errors"));
        }
        text
    }

    /// Number of runs that have no results yet.
    pub fn unfinished(&self) -> usize {
        self.rows.iter().filter(|row| !row.ended).count()
    }

    /// `value` of all rows, as a column of this name.
    fn column(&self, name: &str, value: impl Fn(&SweepRow) -> Value) -> ColumnValues {
        ColumnValues::new(name, self.rows.iter().map(value))
    }

    /// The varied keys, and the numbers that any run knows.
    fn numbers(&self) -> Vec<ColumnValues> {
        let keys = self.keys.iter().enumerate();
        let keys = keys.map(|(i, key)| self.column(key, |row| row.values[i].clone()));
        let entries = ENTRIES.iter().map(|key| self.column(key, |row| value_of(&row.summary, key)));
        keys.chain(entries.filter(|column| !column.is_empty())).collect()
    }

    /// All columns.
    fn columns(&self) -> Vec<ColumnValues> {
        let texts = [
            self.column("warnings", SweepRow::warnings),
            self.column("error", |row| row.problem().into()),
            self.column(DIRECTORY, |row| row.directory.clone().into()),
        ];
        let texts = texts.into_iter().filter(|column| !column.is_empty());
        self.numbers().into_iter().chain(texts).collect()
    }

    /// `table.csv`: a line of names, then one a run.
    fn csv(&self) -> String {
        csv(&self.columns())
    }

    /// `table.tex`: a `tabular` of the numbers, with the errors of runs as comments.
    fn tex(&self) -> String {
        let comment = |row: usize| {
            let error = self.rows[row].problem().unwrap_or_default();
            error.lines().map(|line| format!("% {line}\n")).collect()
        };
        format!("{TEX_HEAD}\n{}", tabular(&self.numbers(), comment))
    }

    /// Writes `table.csv` and `table.tex` into `directory`, which is made. By one rank.
    ///
    /// # Errors
    /// [`crate::base::error::Error::Directory`] and [`crate::base::error::Error::Output`].
    pub fn write(&self, directory: &Path) -> Result<()> {
        disk::make(directory)?;
        disk::write_text(&directory.join("table.csv"), &self.csv())?;
        disk::write_text(&directory.join("table.tex"), &self.tex())
    }
}

/// Refuses to replace a table in `directory` that has rows of other runs than those in the
/// directories `runs`, and files of that name that no sweep wrote. By one rank.
///
/// # Errors
/// [`crate::base::error::Error::Directory`].
pub fn refuse_to_replace<'a>(directory: &Path, runs: impl Iterator<Item = &'a Path>) -> Result<()> {
    let runs: Vec<&OsStr> = runs.filter_map(Path::file_name).collect();
    let table = found_table(&directory.join("table.csv"));
    let what = match (table, head(&directory.join("table.tex"))) {
        (Some(FoundTable::Foreign), _) => "a table.csv that no sweep wrote".to_owned(),
        (Some(FoundTable::OfRuns(rows)), _)
            if rows.iter().any(|row| !runs.contains(&row.as_os_str())) =>
        {
            "the table of a sweep with other runs".to_owned()
        }
        (_, Some(head)) if head != TEX_HEAD => "a table.tex that no sweep wrote".to_owned(),
        _ => return Ok(()),
    };
    Err(disk::not_replaced(directory, &what))
}

/// A file that has the name of a table.
enum FoundTable {
    /// It is of a sweep with runs in directories of these names.
    OfRuns(Vec<OsString>),
    /// No sweep wrote it.
    Foreign,
}

/// What the table file is, if it exists.
fn found_table(path: &Path) -> Option<FoundTable> {
    let found = std::fs::symlink_metadata(path).ok()?;
    let names = || -> Option<Vec<OsString>> {
        let text = (found.len() <= MOST_BYTES).then(|| disk::read_text(path).ok())??;
        let records = csv_records(&text);
        let last = records.first()?.iter().position(|name| name == DIRECTORY)?;
        let name =
            |record: &Vec<String>| Some(Path::new(record.get(last)?).file_name()?.to_owned());
        records[1..].iter().map(name).collect()
    };
    Some(names().map_or(FoundTable::Foreign, FoundTable::OfRuns))
}

/// The first line of a file, if it exists; empty if it is not text.
fn head(path: &Path) -> Option<String> {
    std::fs::symlink_metadata(path).ok()?;
    let mut bytes = Vec::new();
    let most = TEX_HEAD.len() as u64 + 1;
    let read = disk::open_regular(path).and_then(|file| file.take(most).read_to_end(&mut bytes));
    let line = read.ok().and_then(|_| String::from_utf8(bytes).ok()).unwrap_or_default();
    Some(line.lines().next().unwrap_or_default().to_owned())
}

/// The table on the terminal: the columns of numbers in blocks that fit, each with the numbers of
/// the runs, then the errors.
impl fmt::Display for SweepTable {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let runs = (1..=self.rows.len()).map(|number| number.to_string());
        let columns: Vec<Column> = self.numbers().iter().map(shown).collect();
        write!(f, "{}", in_pieces(&Column::new("run", runs), &columns))?;
        match self.errors() {
            errors if errors.is_empty() => Ok(()),
            errors => write!(f, "\n{errors}"),
        }
    }
}

/// A column for the terminal.
fn shown(column: &ColumnValues) -> Column {
    let fit = |text: &str| shortened(&text.replace(['\n', '\t'], " "), MOST_SHOWN - 1);
    let cell = |cell: &Value| match cell {
        Value::Null => "-".to_owned(),
        Value::Number(number) if number.is_f64() => short(number.as_f64().unwrap_or(f64::NAN)),
        other => fit(&json_text(other)),
    };
    Column::new(&fit(&column.name), column.cells.iter().map(cell))
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::base::text::COLUMNS;
    use serde_json::json;

    fn table() -> SweepTable {
        let keys = ["solver.tolerance", "initial.f"].map(str::to_owned);
        let row = |values, summary, error| SweepRow {
            values,
            directory: "a b".to_owned(),
            ended: true,
            summary,
            error,
        };
        let summary = json!({
            "cells": 64, "mass": 0.25, "matvecs": null,
            "accuracy": { "grid": 1e-5, "grid_source": "measured" }, "verdict": "resolved",
            "warnings": ["one, \"two\"", "three"], "wall_seconds": 1.0, "solve_seconds": 0.5,
            "error_l1_relative": 1.5e-3, "error_density_l1_relative": 2.5e-4,
            "memory_peak_bytes_per_rank": 123_456_789,
        });
        let values = |tolerance: f64| vec![json!(tolerance), json!("exp(-x^2), 50 %")];
        let error = Some("solver.tolerance = 5.0:\nbelow 1".to_owned());
        let rows = vec![row(values(1e-5), summary, None), row(values(5.0), Value::Null, error)];
        SweepTable { rows, ..SweepTable::new(&keys) }
    }

    #[test]
    fn all_digits_are_in_the_csv() {
        let text = "solver.tolerance,initial.f,cells,error_l1_relative,error_density_l1_relative,\
                    accuracy.grid,accuracy.grid_source,verdict,mass,solve_seconds,wall_seconds,\
                    memory_peak_bytes_per_rank,warnings,error,directory\n\
                    1e-05,\"exp(-x^2), 50 %\",64,0.0015,0.00025,1e-05,measured,resolved,0.25,0.5,\
                    1.0,123456789,\
                    \"one, \"\"two\"\"; three\",,a b\n\
                    5.0,\"exp(-x^2), 50 %\",,,,,,,,,,,,\"solver.tolerance = 5.0:\nbelow 1\",a b\n";
        assert_eq!(table().csv(), text);
        assert_eq!(table().failed(), 1);
    }

    #[test]
    fn latex_takes_every_character() {
        let text = table().tex();
        let lines: Vec<&str> = text.lines().collect();
        assert_eq!(lines[0], TEX_HEAD);
        let lines = &lines[1..];
        assert_eq!(lines[0], "\\begin{tabular}{rlrrrrllrrrr}");
        assert!(
            lines[2].starts_with("solver.tolerance & initial.f & cells & error\\_l1\\_relative &")
        );
        let row = "$10^{-5}$ & exp(-x\\textasciicircum{}2), 50 \\% & $64$ & $0.0015$ & \
                   $2.5 \\times 10^{-4}$ & $10^{-5}$ &";
        assert!(lines[4].starts_with(row), "{}", lines[4]);
        assert_eq!(lines[5..7], ["% solver.tolerance = 5.0:", "% below 1"]);
        assert!(lines[7].starts_with("$5$ & exp") && lines[7].ends_with("& -- \\\\"));
    }

    #[test]
    fn a_terminal_shows_the_first_errors() {
        let mut table = table();
        let row = |error: Option<String>| SweepRow {
            values: vec![json!(7), json!("x")],
            directory: "c".to_owned(),
            ended: error.is_some(),
            summary: Value::Null,
            error,
        };
        table.rows.extend((0..12).map(|_| row(Some("é".repeat(500)))));
        table.rows.push(row(None));
        let text = table.errors();
        let lines: Vec<&str> = text.lines().collect();
        assert_eq!((lines.len(), lines[10]), (11, "and 3 errors more"));
        assert!(lines[9].starts_with("run 11: é") && lines[9].chars().count() < 200);
    }

    #[test]
    fn tables_of_other_runs_are_not_replaced() {
        let place = tempfile::tempdir().unwrap();
        let refused = |runs: &[&str]| {
            let found = refuse_to_replace(place.path(), runs.iter().map(Path::new));
            found.err().map(|error| error.to_string()).unwrap_or_default()
        };
        assert_eq!(refused(&["a b"]), "");
        table().write(place.path()).unwrap();
        // The runs of the table, and more; wherever they are.
        assert_eq!(refused(&["x/a b", "x/c"]), "");
        assert!(refused(&["x/c"]).contains("sweep with other runs; --force replaces it"));
        for (name, mine, reason) in [
            ("table.tex", "\\begin{tabular}", "a table.tex that no sweep wrote"),
            ("table.csv", "x,f\n1,2\n", "a table.csv that no sweep wrote"),
            ("table.csv", "x,directory\n1\n", "a table.csv that no sweep wrote"),
            ("table.csv", "", "a table.csv that no sweep wrote"),
        ] {
            table().write(place.path()).unwrap();
            std::fs::write(place.path().join(name), mine).unwrap();
            assert!(refused(&["a b"]).contains(reason), "{name}, {mine}: {}", refused(&["a b"]));
        }
    }

    #[test]
    fn a_terminal_shows_all_columns() {
        let text = table().to_string();
        assert!(text.lines().all(|line| line.chars().count() <= COLUMNS), "{text}");
        let mut pieces: Vec<&str> = text.split("\n\n").collect();
        assert_eq!(pieces.pop(), Some("run 2: solver.tolerance = 5.0:\n"));
        assert_eq!(pieces.len(), 3, "{text}");
        assert!(pieces.iter().all(|piece| piece.starts_with("run  ")), "{text}");
        for column in table().numbers() {
            let words = pieces.iter().flat_map(|piece| piece.split_whitespace());
            assert_eq!(words.filter(|word| *word == column.name).count(), 1, "{}", column.name);
        }
        assert!(text.contains("1.5e-3") || text.contains("0.0015"), "{text}");
    }
}
