//! `[[potential]]`, `[initial]`, `[inflow]` and `[exact]`: the formulas and data files of a case.

use crate::base::error::{Error, Result};
use crate::base::refusal::Refusal;
use crate::problem::case::file::CaseFile;
use crate::problem::case::reader::{Formula, Item, List};
use crate::problem::formula::Expression;
use crate::problem::grid::MAX_DIMENSION;
use crate::problem::limits::COORDINATES;
use crate::problem::table::Interpolation;
use serde::{Deserialize, Serialize};
use std::fmt;
use std::path::{Path, PathBuf};

/// Largest number of fields of a case: a density, and a level set for each velocity axis.
pub const MOST_FIELDS: usize = 1 + MAX_DIMENSION;

/// Position of `t` among the coordinates `[x, y, z, vx, vy, vz, t]` of a formula.
pub const TIME: usize = COORDINATES - 1;

/// A region of the potential. The first region whose condition holds at the centre of a cell gives
/// `V` in that cell.
#[derive(Clone, Debug)]
pub struct Region {
    /// `where`; absent in the last region.
    pub condition: Option<Expression>,
    /// `V(x, y, z)`.
    pub value: Expression,
    /// `reflection`: a formula of `E` and `jump`. At jumps where this region has the higher `V`, it
    /// gives the part, in `[0, 1]`, that is reflected of the particles with enough energy to be
    /// transmitted.
    pub reflection: Option<Expression>,
}

/// The variables of the formula `reflection`: `E`, the normal kinetic energy on the side of the
/// higher `V`, and `jump`, the height of the jump.
pub const REFLECTION_NAMES: Names = [&["E"], &["jump"], &[], &[], &[], &[], &[]];

impl Region {
    /// The reflected part for normal kinetic energy `energy` on the higher side of a jump of height
    /// `jump`; 0 if the case gives no formula.
    pub fn reflected(&self, energy: f64, jump: f64) -> f64 {
        self.reflection.as_ref().map_or(0.0, |formula| formula.eval(&[energy, jump]))
    }
}

/// The inflow through the boundary of the phase-space box.
#[derive(Clone, Debug)]
pub enum Inflow {
    /// A formula, evaluated at centres of ghost cells, or just outside of the ends of the box.
    Formula(Expression),
    /// The initial formula, evaluated there.
    Initial,
}

/// The data of `[initial]`.
#[derive(Clone, Debug)]
pub enum Data {
    /// The data are a function `f0(x, v)`.
    Density,
    /// The data are a measure, `f0 = density(x) Π_a δ(v_a − velocity_a(x))`, represented by level
    /// sets.
    Measure {
        /// The factor `density(x)`.
        density: Expression,
        /// The velocities `velocity_a(x)`, one formula for each axis.
        velocity: Vec<Expression>,
    },
}

impl Data {
    /// Whether the data are a measure.
    pub fn is_measure(&self) -> bool {
        matches!(self, Self::Measure { .. })
    }
}

/// A function on phase space that obeys the Liouville equation.
#[derive(Clone, Debug)]
pub struct LiouvilleField {
    /// `f`; or `phi`, `psi_x`, `psi_y`, `psi_z`.
    pub name: &'static str,
    /// Values of the field at time zero.
    pub initial: Expression,
    /// Values of the field on the boundary.
    pub inflow: Inflow,
}

impl LiouvilleField {
    /// The formula of the inflow.
    pub fn entering(&self) -> &Expression {
        match &self.inflow {
            Inflow::Formula(f) => f,
            Inflow::Initial => &self.initial,
        }
    }

    /// Whether the field may have inflow.
    pub fn enters(&self) -> bool {
        self.entering().constant() != Some(0.0)
    }

    /// Whether the inflow depends on time.
    pub fn varies(&self) -> bool {
        self.entering().depends_on(TIME)
    }
}

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

/// The error that something is wrong with the file `path`, which a key at `place` names.
fn wrong_file(place: &str, path: &Path, what: &dyn fmt::Display) -> Error {
    let path = format!("\"{}\"", path.display());
    Error::Case(Box::new(Refusal::at_place(place, &path, &what.to_string())))
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
    fn unread(&self) -> Expression {
        let text = format!("the table {} of {}", self.dataset, self.path.display());
        Expression::of_file(text, self.place.clone(), self.positions.clone())
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

/// Relative errors of the grid; `None` where they are not known.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct GridErrorPair {
    /// Of `f`, in L2.
    pub field: Option<f64>,
    /// Of the density, in L2; in L1 if particles showed it.
    pub density: Option<f64>,
}

impl GridErrorPair {
    /// The errors of `f` and of the density.
    pub fn both(self) -> [Option<f64>; 2] {
        [self.field, self.density]
    }
}

/// The properties of a result from which a run continues.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub struct ResultOrigin {
    /// The checksum of `/f`.
    pub checksum: u64,
    /// Time of the result.
    pub time: f64,
    /// Relative l2 distance of its `f` to the semi-discrete solution, if known.
    pub error: Option<f64>,
    /// Its errors of the grid.
    pub grid_errors: GridErrorPair,
    /// Whether its `f` was limited to positive values.
    pub positive: bool,
}

/// The exact solution with which results are compared.
#[derive(Clone, Debug)]
pub enum Exact {
    /// Particles are traced back through the piecewise linear potential.
    Characteristics,
    /// A formula for `f(t, x, v)`.
    Formula(Expression),
}

/// `exact.moments`: the times at which moments of the exact solution are computed.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum ExactTimes {
    /// All output times.
    #[default]
    All,
    /// The end only.
    End,
}

/// A table `[[potential]]` as it is written.
#[derive(Debug, Default, Deserialize)]
pub struct RegionTable {
    #[serde(rename = "where")]
    condition: Option<Formula>,
    value: Option<Formula>,
    table: Option<FileTable>,
    interpolation: Option<Interpolation>,
    reflection: Option<Formula>,
}

impl RegionTable {
    /// `V` of region `i` in `n` dimensions.
    fn value(&self, file: &CaseFile<'_>, i: usize, n: usize) -> Result<Expression> {
        let [value, interpolation] =
            ["value", "interpolation"].map(|key| format!("potential.{i}.{key}"));
        match self.table(file, i, n)? {
            Some(_) if self.value.is_some() => {
                let table = TableOf::Potential(i);
                let message = format!("give either {}, or {value}", table.key());
                file.refuse_either([&value, &table.file_key()], message)
            }
            Some(table) => Ok(table.unread()),
            None if self.interpolation.is_some() => {
                let message = "says how a table is interpolated; a formula needs none";
                file.refuse(&interpolation, message)
            }
            None => required_formula(file, &value, &self.value, &names_of_space(n)),
        }
    }

    /// The file of `V` of region `i`.
    fn table(&self, file: &CaseFile<'_>, i: usize, n: usize) -> Result<Option<TableFile>> {
        let found = FileTable::read(&self.table, file, TableOf::Potential(i), n)?;
        let interpolation = self.interpolation.unwrap_or(Interpolation::Constant);
        Ok(found.map(|table| TableFile { interpolation, ..table }))
    }
}

impl Item for RegionTable {
    const PLURAL: &'static str = "tables, [[potential]],";
}

/// `[initial]` as it is written.
#[derive(Debug, Default, Deserialize)]
pub struct InitialTable {
    f: Option<Formula>,
    density: Option<Formula>,
    velocity: Option<List<Formula>>,
    warped: Option<String>,
    field: Option<String>,
    table: Option<FileTable>,
}

/// `initial.table`, `potential.N.table` or `inflow.table` as it is written.
#[derive(Debug, Default, Deserialize)]
struct FileTable {
    file: Option<String>,
    dataset: Option<String>,
    axes: Option<List<String>>,
}

impl FileTable {
    /// The file of a table in `n` dimensions, if the case gives one.
    fn read(
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

/// `[inflow]` as it is written.
#[derive(Debug, Default, Deserialize)]
pub struct InflowTable {
    /// By default `initial` for measure-valued data and 0 for others.
    value: Option<Formula>,
    table: Option<FileTable>,
}

/// `[exact]` as it is written.
#[derive(Debug, Default, Deserialize)]
pub struct ExactTable {
    kind: Option<ExactKind>,
    f: Option<Formula>,
    moments: Option<ExactTimes>,
}

/// The words that `exact.kind` takes.
#[derive(Clone, Copy, Debug, Deserialize)]
#[serde(rename_all = "kebab-case")]
enum ExactKind {
    Characteristics,
}

/// The names by which a formula may use each of the coordinates `[x, y, z, vx, vy, vz, t]`.
pub type Names = [&'static [&'static str]; COORDINATES];

/// Names of the coordinates of space.
fn names_of_space(n: usize) -> Names {
    let space: Names = [&["x"], &["y"], &["z"], &[], &[], &[], &[]];
    std::array::from_fn(|a| if a < n { space[a] } else { &[] })
}

/// Names of the coordinates of phase space.
fn names_of_phase_space(n: usize) -> Names {
    let mut names = names_of_space(n);
    let velocities: [&[&str]; MAX_DIMENSION] = [&["vx"], &["vy"], &["vz"]];
    names[3..3 + n].copy_from_slice(&velocities[..n]);
    if n == 1 {
        names[3] = &["v", "vx"];
    }
    names
}

/// Names of the coordinates of phase space, and of time.
fn names_with_time(n: usize) -> Names {
    let mut names = names_of_phase_space(n);
    names[TIME] = &["t"];
    names
}

/// The formula of `key`, if it is given.
fn formula(
    file: &CaseFile<'_>,
    key: &str,
    text: &Option<Formula>,
    names: &Names,
) -> Result<Option<Expression>> {
    let text = text.as_ref();
    text.map(|Formula(text)| file.formula(key, text, names)).transpose()
}

/// The formula of `key`, which must be given.
fn required_formula(
    file: &CaseFile<'_>,
    key: &str,
    text: &Option<Formula>,
    names: &Names,
) -> Result<Expression> {
    file.required(key, formula(file, key, text, names)?, "a formula")
}

/// The regions of `V` in `n` dimensions.
pub fn potential(file: &CaseFile<'_>, tables: &[RegionTable], n: usize) -> Result<Vec<Region>> {
    if tables.is_empty() {
        let message = "missing; at least one [[potential]] with value = \"…\"";
        return file.refuse("potential", message);
    }
    let names = names_of_space(n);
    let region = |(i, table): (usize, &RegionTable)| {
        let key = format!("potential.{i}.where");
        let condition = formula(file, &key, &table.condition, &names)?;
        let last = i + 1 == tables.len();
        if last && condition.is_some() {
            let message = "the last [[potential]] holds everywhere else and needs no where";
            return file.refuse(&key, message);
        }
        if !last && condition.is_none() {
            return file.refuse(&key, "missing; only the last [[potential]] has no where");
        }
        let value = table.value(file, i, n)?;
        let key = format!("potential.{i}.reflection");
        let reflection = formula(file, &key, &table.reflection, &REFLECTION_NAMES)?;
        Ok(Region { condition, value, reflection })
    };
    tables.iter().enumerate().map(region).collect()
}

impl InflowTable {
    /// The inflow; `default` if the file gives none.
    fn check(&self, file: &CaseFile<'_>, n: usize, default: &str) -> Result<Inflow> {
        if let Some(table) = FileTable::read(&self.table, file, TableOf::Inflow, n)? {
            return match &self.value {
                Some(_) => file.refuse_either(
                    ["inflow.value", &TableOf::Inflow.file_key()],
                    "give either inflow.table, or inflow.value",
                ),
                None => Ok(Inflow::Formula(table.unread())),
            };
        }
        let text = self.value.as_ref().map_or(default, |Formula(text)| text);
        match text {
            "initial" => Ok(Inflow::Initial),
            text => file.formula("inflow.value", text, &names_with_time(n)).map(Inflow::Formula),
        }
    }
}

/// The table files that a case in `n` dimensions names.
pub fn tables(
    file: &CaseFile<'_>,
    potential: &[RegionTable],
    initial: &InitialTable,
    inflow: &InflowTable,
    n: usize,
) -> Result<Vec<TableFile>> {
    let regions = (0..).zip(potential).map(|(i, region)| region.table(file, i, n));
    let initial = FileTable::read(&initial.table, file, TableOf::Initial, n);
    let inflow = FileTable::read(&inflow.table, file, TableOf::Inflow, n);
    let all = [initial, inflow].into_iter().chain(regions);
    all.filter_map(Result::transpose).collect()
}

impl InitialTable {
    /// The fields to evolve in `n` dimensions, with their inflow.
    pub fn check(
        &self,
        file: &CaseFile<'_>,
        n: usize,
        inflow: &InflowTable,
    ) -> Result<(Data, Vec<LiouvilleField>)> {
        let keys = ["initial.f", "initial.density", "initial.velocity"];
        let given = |keys: &[&'static str]| keys.iter().copied().find(|key| file.has(key));
        let table_key = TableOf::Initial.file_key();
        if let Some(other) = given(&keys) {
            if self.warped.is_some() {
                let message = format!("give either initial.warped, or {other}");
                return file.refuse_either([other, "initial.warped"], message);
            }
            if self.table.is_some() {
                let message = format!("give either initial.table, or {other}");
                return file.refuse_either([other, &table_key], message);
            }
        }
        if given(&keys[1..]).is_some() {
            return self.measure(file, n, inflow);
        }
        let names = names_of_phase_space(n);
        let table = FileTable::read(&self.table, file, TableOf::Initial, n)?;
        let initial = match (&self.warped, table) {
            (Some(_), Some(_)) => {
                let message = "give either initial.warped, or initial.table";
                return file.refuse_either([&table_key, "initial.warped"], message);
            }
            // f(0) is unknown; the formula 0 is a placeholder that is not used.
            (Some(_), None) => file.formula("initial.warped", "0", &names)?,
            (None, Some(table)) => table.unread(),
            (None, None) => required_formula(file, "initial.f", &self.f, &names)?,
        };
        let field = LiouvilleField { name: "f", initial, inflow: inflow.check(file, n, "0")? };
        Ok((Data::Density, vec![field]))
    }

    /// Measure-valued data: the density `φ` and the level sets `ψ_a = v_a − velocity_a(x)`.
    fn measure(
        &self,
        file: &CaseFile<'_>,
        n: usize,
        inflow: &InflowTable,
    ) -> Result<(Data, Vec<LiouvilleField>)> {
        if self.f.is_some() {
            let message = "give either initial.f, or initial.density and initial.velocity";
            let [density, velocity] = ["initial.density", "initial.velocity"];
            let measure = if file.has(density) { density } else { velocity };
            return file.refuse_either(["initial.f", measure], message);
        }
        let names = names_of_space(n);
        let density = required_formula(file, "initial.density", &self.density, &names)?;
        let key = "initial.velocity";
        let texts = self.velocity.as_ref().map_or(&[][..], |list| &list.0);
        if texts.len() != n {
            let given = texts.len();
            let message = format!("{given} formulas given; a list of {n} expected, one per axis");
            return file.refuse(key, message);
        }
        let mut fields = vec![LiouvilleField {
            name: "phi",
            initial: density.clone(),
            inflow: inflow.check(file, n, "initial")?,
        }];
        let mut velocity = Vec::new();
        for (a, Formula(text)) in texts.iter().enumerate() {
            velocity.push(file.formula(key, text, &names)?);
            let level_set = format!("{} - ({text})", ["vx", "vy", "vz"][a]);
            fields.push(LiouvilleField {
                name: ["psi_x", "psi_y", "psi_z"][a],
                initial: file.formula(key, &level_set, &names_of_phase_space(n))?,
                inflow: Inflow::Initial,
            });
        }
        Ok((Data::Measure { density, velocity }, fields))
    }

    /// The file that `initial.warped` names, if the case gives it.
    pub fn warped_start(&self, file: &CaseFile<'_>) -> Result<Option<WarpedStart>> {
        let path = path_of(file, "initial.warped", self.warped.as_ref(), "warped_f.h5")?;
        let place = file.place("initial.warped");
        Ok(path.map(|path| WarpedStart { path, place }))
    }

    /// The file that `initial.field` names, if the case gives it. It may be given beside
    /// `initial.f`.
    pub fn field(&self, file: &CaseFile<'_>, data: &Data) -> Result<Option<StartField>> {
        let key = "initial.field";
        let Some(path) = path_of(file, key, self.field.as_ref(), "result.h5")? else {
            return Ok(None);
        };
        if self.warped.is_some() {
            let message = "give either initial.warped, or initial.field and initial.f";
            return file.refuse_either([key, "initial.warped"], message);
        }
        if data.is_measure() {
            return file.refuse(
                key,
                "measure-valued data are several fields, and a run continues from /f only; run \
                 the case from time 0 to the later time.end",
            );
        }
        Ok(Some(StartField { path, place: file.place(key), origin: None }))
    }
}

/// The file that `key` names, relative to the directory of the case file.
fn path_of(
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

impl ExactTable {
    /// The exact solution that results are compared with.
    pub fn check(&self, file: &CaseFile<'_>, n: usize, data: &Data) -> Result<Option<Exact>> {
        if self.f.is_some() && data.is_measure() {
            return file.refuse(
                "exact.f",
                "measure-valued data have no f; exact.kind = \"characteristics\" gives density \
                 and velocity",
            );
        }
        match (self.kind, formula(file, "exact.f", &self.f, &names_with_time(n))?) {
            (None, None) => Ok(None),
            (None, Some(f)) => Ok(Some(Exact::Formula(f))),
            (Some(ExactKind::Characteristics), None) => Ok(Some(Exact::Characteristics)),
            (Some(_), Some(_)) => {
                let message = "give either exact.kind or exact.f";
                file.refuse_either(["exact.f", "exact.kind"], message)
            }
        }
    }

    /// The times at which moments of the exact solution are computed.
    pub fn times(&self, file: &CaseFile<'_>) -> Result<ExactTimes> {
        if self.moments.is_some() && self.kind.is_none() && self.f.is_none() {
            let message = "needs an exact solution; give exact.kind or exact.f, or leave it out";
            return file.refuse("exact.moments", message);
        }
        Ok(self.moments.unwrap_or_default())
    }
}
