//! The data files that a case names: tables, a warped field, and a result from which a run
//! continues.
//!
//! Uses file and reader (the keys), coordinates (the axes of a table), result_origin.

use crate::base::error::{Error, Result};
use crate::base::refusal::Refusal;
use crate::problem::case::coordinates::{
    Names, TIME, names_of_phase_space, names_of_space, names_with_time,
};
use crate::problem::case::file::CaseFile;
use crate::problem::case::reader::List;
use crate::problem::case::result_origin::ResultOrigin;
use crate::problem::formula::Expression;
use crate::problem::table::Interpolation;
use serde::Deserialize;
use std::fmt;
use std::path::{Path, PathBuf};

/// `initial.warped`: a file that holds `w(0, x, v, p)`.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct WarpedStart {
    /// Path of the file.
    pub path: PathBuf,
    /// File and line of the key, for errors.
    pub place: String,
}

impl WarpedStart {
    /// The error that something is wrong with the file.
    pub fn wrong(&self, what: &dyn fmt::Display) -> Error {
        wrong_file(&self.place, &self.path, what)
    }
}

/// `initial.field`: a result that holds `f` at `time.start`.
#[derive(Clone, Debug, PartialEq)]
pub struct StartField {
    /// Path of the file.
    pub path: PathBuf,
    /// File and line of the key, for errors.
    pub place: String,
    /// The run that wrote the result, once the file was read.
    pub origin: Option<ResultOrigin>,
}

impl StartField {
    /// The error that something is wrong with the file.
    pub fn wrong(&self, what: &dyn fmt::Display) -> Error {
        wrong_file(&self.place, &self.path, what)
    }
}

/// The function that a table in a file gives.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum TableOf {
    /// `f0`.
    Initial,
    /// `V` of the region of this number.
    Potential(usize),
    /// The inflow.
    Inflow,
}

impl TableOf {
    /// The key of the table: `initial.table`, `potential.0.table` or `inflow.table`.
    pub fn key(self) -> String {
        match self {
            Self::Initial => "initial.table".to_owned(),
            Self::Potential(region) => format!("potential.{region}.table"),
            Self::Inflow => "inflow.table".to_owned(),
        }
    }

    /// The key of the table's file.
    pub fn file_key(self) -> String {
        format!("{}.file", self.key())
    }

    /// The names that the axes of the table may have in `n` dimensions.
    fn names(self, n: usize) -> Names {
        match self {
            Self::Initial => names_of_phase_space(n),
            Self::Potential(_) => names_of_space(n),
            Self::Inflow => names_with_time(n),
        }
    }
}

/// A file that holds a function on a tensor grid of its own.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct TableFile {
    /// The function that the file gives.
    pub of: TableOf,
    /// Path of the file.
    pub path: PathBuf,
    /// Name of the dataset in an HDF5 file, or of the column in a CSV file.
    pub dataset: String,
    /// The interpolation between its points.
    pub interpolation: Interpolation,
    /// File and line of the key, for errors.
    pub place: String,
    /// The checksum of the table, once it was read.
    pub checksum: Option<u64>,
    /// The coordinate along each axis of the dataset, by its position in formulas.
    positions: Vec<usize>,
    /// The names that coordinates may have in the file.
    names: Names,
}

impl TableFile {
    /// The file `path` with default settings: linear interpolation along all axes that the function
    /// has in `n` dimensions, except time.
    pub fn new(of: TableOf, path: &Path, place: &str, n: usize) -> Self {
        let names = of.names(n);
        Self {
            of,
            path: path.to_owned(),
            dataset: if matches!(of, TableOf::Potential(_)) { "V" } else { "f" }.to_owned(),
            interpolation: Interpolation::Linear,
            place: place.to_owned(),
            checksum: None,
            positions: (0..TIME).filter(|&i| !names[i].is_empty()).collect(),
            names,
        }
    }

    /// This file with another interpolation between its points.
    pub(super) fn interpolated(self, interpolation: Interpolation) -> Self {
        Self { interpolation, ..self }
    }

    /// The position in formulas of the coordinate of this name.
    fn position(&self, name: &str) -> Option<usize> {
        self.names.iter().position(|names| names.contains(&name))
    }

    /// The position in formulas of the coordinate of this name, if that is an axis of this table.
    pub fn position_of_axis(&self, name: &str) -> Option<usize> {
        self.position(name).filter(|position| self.positions.contains(position))
    }

    /// Whether an axis of a table of this kind may have this name.
    pub fn has_axis(&self, name: &str) -> bool {
        self.position(name).is_some()
    }

    /// The names that axes may have: `x, v, t`.
    pub fn all_axes_text(&self) -> String {
        let names: Vec<&str> = self.names.iter().filter_map(|n| n.first().copied()).collect();
        names.join(", ")
    }

    /// Position and names of each axis, in the order of an HDF5 dataset.
    pub fn axes(&self) -> Vec<(usize, Vec<&'static str>)> {
        self.positions.iter().map(|&i| (i, self.names[i].to_vec())).collect()
    }

    /// The names of its axes: `x, v`.
    pub fn axes_text(&self) -> String {
        self.axes().iter().map(|(_, names)| names[0]).collect::<Vec<_>>().join(", ")
    }

    /// Whether both are the same table of the same file, wherever the key stands.
    pub fn is_same(&self, other: &Self) -> bool {
        *self == Self { checksum: self.checksum, place: self.place.clone(), ..other.clone() }
    }

    /// The error that something is wrong with the file.
    pub fn wrong(&self, what: &dyn fmt::Display) -> Error {
        wrong_file(&self.place, &self.path, what)
    }

    /// The expression that stands for the values until the file is read.
    pub(super) fn unread(&self) -> Expression {
        let text = format!("the table {} of {}", self.dataset, self.path.display());
        Expression::of_file(text, self.place.clone(), self.positions.clone())
    }
}

/// `initial.table`, `potential.N.table` or `inflow.table` as it is written.
#[derive(Debug, Default, Deserialize)]
pub(super) struct FileTable {
    file: Option<String>,
    dataset: Option<String>,
    axes: Option<List<String>>,
}

impl FileTable {
    /// The file of a table in `n` dimensions, if the case gives one.
    pub fn read(
        table: &Option<Self>,
        file: &CaseFile<'_>,
        of: TableOf,
        n: usize,
    ) -> Result<Option<TableFile>> {
        table.as_ref().map(|table| table.check(file, of, n)).transpose()
    }

    fn check(&self, file: &CaseFile<'_>, of: TableOf, n: usize) -> Result<TableFile> {
        let key = of.file_key();
        let path = path_of(file, &key, self.file.as_ref(), "table.h5")?;
        let path = file.required(&key, path, "the path of an HDF5 or CSV file")?;
        let mut found = TableFile::new(of, &path, &file.place(&key), n);
        if let Some(dataset) = &self.dataset {
            dataset.trim_start_matches('/').clone_into(&mut found.dataset);
        }
        let Some(axes) = &self.axes else { return Ok(found) };
        let key = format!("{}.axes", of.key());
        let known = found.all_axes_text();
        let mut positions = Vec::new();
        for name in &axes.0 {
            match found.position(name) {
                Some(position) if !positions.contains(&position) => positions.push(position),
                Some(_) => return file.refuse(&key, format!("{name} is given twice")),
                None => return file.refuse(&key, format!("{name} is none of {known}")),
            }
        }
        if positions.is_empty() {
            return file.refuse(&key, format!("some of {known} expected"));
        }
        found.positions = positions;
        Ok(found)
    }
}

/// The file that `key` names, relative to the directory of the case file.
pub(super) fn path_of(
    file: &CaseFile<'_>,
    key: &str,
    path: Option<&String>,
    example: &str,
) -> Result<Option<PathBuf>> {
    let Some(path) = path else { return Ok(None) };
    if path.is_empty() {
        return file.refuse(key, format!("the path of a file expected, such as \"{example}\""));
    }
    let directory = Path::new(file.name).parent().unwrap_or(Path::new(""));
    Ok(Some(directory.join(path)))
}

/// The error that something is wrong with the file `path`, which a key at `place` names.
fn wrong_file(place: &str, path: &Path, what: &dyn fmt::Display) -> Error {
    let path = format!("\"{}\"", path.display());
    Error::Case(Box::new(Refusal::at_place(place, &path, &what.to_string())))
}
