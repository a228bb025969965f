//! The case file: a problem, and how to solve it.
//!
//! [`Case::parse`] reads a case in four steps, without MPI:
//!
//! 1. `file` reads TOML and `--set` into a tree that remembers the place of each value.
//! 2. serde makes `CaseTables` of the tree through `reader`, which refuses unknown keys and wrong
//!    types, and evaluates formulas of constants given for numbers.
//! 3. `Case::new` makes a [`Case`] of the tables, section by section.
//! 4. `Case::validate` refuses settings that contradict each other; those that studies vary are in
//!    `conflict`.
//!
//! Functions of these modules fail with [`Error::Case`]: file, line, key, value and limit.
//!
//! A key of the case file is a field of its section's table, with its default in the table's
//! `Default` and its check in the table's `check`: `constants`, `axes`, `potential`, `initial`,
//! `inflow`, `time`, `scheme`, `solver`, `warp`, `exact`, `output`, `checkpoint`, `readout`. Limits
//! are in [`limits`](crate::problem::limits).

pub(crate) mod alpha;
pub(crate) mod axes;
mod checkpoint;
pub(crate) mod conflict;
pub(crate) mod constants;
mod coordinates;
mod data_files;
mod degrees;
mod exact;
pub(crate) mod file;
mod inflow;
mod initial;
pub(crate) mod keys;
pub(crate) mod output;
mod overridden;
mod potential;
pub(crate) mod reader;
pub(crate) mod readout;
mod result_origin;
pub(crate) mod scheme;
pub(crate) mod settings;
pub(crate) mod solver;
mod time;
mod validate;
pub(crate) mod warp;

pub use crate::problem::case::alpha::{Alpha, DEFAULT_ALPHA};
pub use crate::problem::case::axes::DEGREE_KEY;
pub use crate::problem::case::coordinates::TIME;
pub use crate::problem::case::data_files::{StartField, TableFile, TableOf, WarpedStart};
pub use crate::problem::case::exact::{Exact, ExactTimes};
pub use crate::problem::case::inflow::Inflow;
pub use crate::problem::case::initial::{Data, LiouvilleField, MOST_FIELDS};
pub use crate::problem::case::keys::ValueKind;
pub use crate::problem::case::output::{
    DeltaWidth, IdleInterval, OutputSettings, OutputTime, Plateau, Storage,
};
pub use crate::problem::case::potential::Region;
pub use crate::problem::case::readout::{MeasurementEffort, ReadoutSettings};
pub use crate::problem::case::result_origin::{GridErrorPair, ResultOrigin};
pub use crate::problem::case::scheme::{DEFAULT_FLUX, EndFlux, Interface, Limiter, SchemeSettings};
pub use crate::problem::case::settings::{Settings, differing_setting};
pub use crate::problem::case::solver::{
    AllowedReductions, ClassicalSettings, DEFAULT_CFL, Integrator, Method, Propagation,
    PropagatorMethod, SolverPlaces,
};
pub use crate::problem::case::warp::{
    Coefficients, DEFAULT_BETA, DEFAULT_ORDER, Delta, Embedding, ProfileChoice, RecoveryMethod,
    Shift, Warp,
};
pub use crate::problem::limits::LARGEST_TOLERANCE;

use crate::base::error::{Error, Result};
use crate::problem::case::axes::AxisPair;
use crate::problem::case::checkpoint::CheckpointTable;
use crate::problem::case::constants::ConstantsTable;
use crate::problem::case::exact::ExactTable;
use crate::problem::case::file::CaseFile;
use crate::problem::case::inflow::InflowTable;
use crate::problem::case::initial::InitialTable;
use crate::problem::case::output::OutputTable;
use crate::problem::case::potential::RegionTable;
use crate::problem::case::reader::List;
use crate::problem::case::readout::ReadoutTable;
use crate::problem::case::scheme::SchemeTable;
use crate::problem::case::solver::SolverTable;
use crate::problem::case::time::TimeTable;
use crate::problem::formula::{Constants, Expression};
use crate::problem::grid::{Axis, PhaseSpace};
use crate::problem::limits::LONGEST_FILE;
use crate::problem::table::Table;
use serde::Deserialize;
use serde_json::Value;
use std::ffi::OsStr;
use std::io::Read;
use std::path::Path;
use std::time::Duration;

/// The sections of a case file as they are written, before any check.
#[derive(Debug, Default, Deserialize)]
#[serde(default)]
struct CaseTables {
    title: String,
    reference: String,
    /// `[constants]`. `constants::evaluate` has read it before, as numbers may be formulas of
    /// constants.
    #[serde(rename = "constants")]
    _constants: ConstantsTable,
    axis: List<AxisPair>,
    potential: List<RegionTable>,
    initial: InitialTable,
    inflow: InflowTable,
    time: TimeTable,
    scheme: SchemeTable,
    solver: SolverTable,
    exact: ExactTable,
    output: OutputTable,
    checkpoint: CheckpointTable,
    readout: Option<ReadoutTable>,
}

/// All keys that a case file may have, as a table for the whole file.
pub fn keys() -> ValueKind {
    keys::of::<CaseTables>()
}

/// The values of a case file with its `--set` options, as JSON. They are not checked.
///
/// # Errors
/// [`Error::Case`] if the text is not TOML, or an override is not a `key=value` that fits it.
pub fn values(name: &str, text: &str, overrides: &[String]) -> Result<Value> {
    Ok(CaseFile::parse(name, text, overrides)?.json())
}

/// A problem and how to solve it, as read from a case file.
#[derive(Clone, Debug)]
pub struct Case {
    /// Name of the file it was read from.
    pub name: String,
    /// `title`; by default the name of the case file.
    pub title: String,
    /// `reference`: a text that is stored with the results.
    pub reference: String,
    /// `[constants]`, by name.
    pub constants: Constants,
    /// The grid.
    pub space: PhaseSpace,
    /// Branches of `V`.
    pub potential: Vec<Region>,
    /// The initial data.
    pub data: Data,
    /// The functions that obey the Liouville equation: `f`, or the density `φ` and the level sets
    /// `ψ_a`.
    pub fields: Vec<LiouvilleField>,
    /// `initial.warped`. With it `f(0)` is unknown, and its formula is not used.
    pub warped_start: Option<WarpedStart>,
    /// `initial.field`: `f` at [`start_time`](Self::start_time), in place of `initial.f` at time 0.
    pub start_field: Option<StartField>,
    /// The files that give `f0`, `V` or the inflow in place of formulas.
    pub tables: Vec<TableFile>,
    /// `time.start`: 0 unless a file gives `f` at that time. Times in formulas and output times
    /// count from 0.
    pub start_time: f64,
    /// `time.end`: final time `T`.
    pub end: f64,
    /// `[scheme]`: interface law, numerical fluxes and limiter.
    pub scheme: SchemeSettings,
    /// `solver.method`: Schrödingerization, or direct integration of the semi-discrete system.
    pub method: Method,
    /// `solver.tolerance`: relative l2 distance to the exact semi-discrete solution.
    pub tolerance: f64,
    /// `solver.accuracy`: relative L1 error of the density for which `run`, `plan` and `check`
    /// choose grid, degree, flux, interface and tolerance.
    pub accuracy: Option<f64>,
    /// `solver.verify`: whether to measure the distance that `tolerance` bounds, which takes one
    /// classical solve.
    pub verify: bool,
    /// `solver.strict`: whether a run that misses its tolerance or accuracy ends with an error.
    pub strict: bool,
    /// `[solver.warp]`: the settings of the auxiliary variable `p`.
    pub warp: Warp,
    /// `[solver.propagator]`: the method that propagates the modes, and its time step.
    pub propagator: Propagation,
    /// `[solver.classical]`: the settings of the classical method.
    pub classical: ClassicalSettings,
    /// `[solver.reduce]`: the reductions that are allowed.
    pub reduce: AllowedReductions,
    /// Files and lines of settings of `[solver]`, for errors.
    pub places: SolverPlaces,
    /// `[exact]`: the exact solution with which results are compared.
    pub exact: Option<Exact>,
    /// `exact.moments`: the times at which moments of the exact solution are computed.
    pub exact_times: ExactTimes,
    /// `[output]`: what is written, when, and how it is stored.
    pub output: OutputSettings,
    /// `checkpoint.minutes`: time between checkpoints; `None` if they are not made by the clock.
    pub checkpoint_every: Option<Duration>,
    /// `[readout]`: the observables that are measured on a quantum computer.
    pub readout: Option<ReadoutSettings>,
    /// The case file as read.
    pub text: String,
    /// The `--set` options applied to it.
    pub overrides: Vec<String>,
    /// Every value that the file and the options give, by key.
    pub settings: Settings,
    /// The reductions that were made, and those that could not be made.
    pub reductions: Reductions,
    /// What a study sets.
    pub study: StudySettings,
}

impl Case {
    /// Reads a case from the text of a file called `name`, with `--set` overrides applied.
    ///
    /// # Errors
    /// [`Error::Case`] with file, line, key, value and limit.
    pub fn parse(name: &str, text: &str, overrides: &[String]) -> Result<Self> {
        let mut file = CaseFile::parse(name, text, overrides)?;
        file.constants = constants::evaluate(&file)?;
        let tables: CaseTables = file.read()?;
        let mut case = Self::new(&file, tables)?;
        case.validate(&file)?;
        Ok(case)
    }

    /// Reads a case file from disk.
    ///
    /// # Errors
    /// As [`parse`](Self::parse), and when the file cannot be read or is larger than 1 MiB.
    pub fn load(path: &Path, overrides: &[String]) -> Result<Self> {
        Self::parse(&path.display().to_string(), &read_text(path)?, overrides)
    }

    /// The case of `tables`. Each section is checked by itself.
    fn new(file: &CaseFile<'_>, tables: CaseTables) -> Result<Self> {
        let space = axes::space(file, &tables.axis.0, tables.scheme.degree)?;
        let n = space.dimension();
        let potential = potential::regions(file, &tables.potential.0, n)?;
        let (data, fields) = tables.initial.check(file, n, &tables.inflow)?;
        let run = tables.time.check(file)?;
        let duration = run.end - run.start;
        let scheme = tables.scheme.check(file, &space, &potential)?;
        let warped_start = tables.initial.warped_start(file)?;
        let start_field = tables.initial.field(file, &data)?;
        let regions = &tables.potential.0;
        let files = table_files(file, regions, &tables.initial, &tables.inflow, n)?;
        let output = tables.output.check(file, &space, run.clone(), warped_start.is_none())?;
        let solver = tables.solver;
        Ok(Self {
            name: file.name.to_owned(),
            title: if tables.title.is_empty() { file.last_name() } else { tables.title },
            reference: tables.reference,
            constants: file.constants.clone(),
            potential,
            exact: tables.exact.check(file, n, &data)?,
            exact_times: tables.exact.times(file)?,
            data,
            fields,
            warped_start,
            start_field,
            tables: files,
            start_time: run.start,
            end: run.end,
            scheme,
            method: solver.method,
            tolerance: solver.tolerance(file)?,
            accuracy: solver.accuracy(file)?,
            verify: solver.verify,
            strict: solver.strict,
            warp: solver.warp.check(file, duration)?,
            propagator: solver.propagator.check(file, duration)?,
            classical: solver.classical.check(file)?,
            reduce: solver.reduce,
            places: SolverPlaces::of(file),
            output,
            checkpoint_every: tables.checkpoint.check(file)?,
            readout: tables.readout.map(|table| table.check(file, &space)).transpose()?,
            text: file.text.to_owned(),
            overrides: file.overrides.to_vec(),
            settings: file.settings(),
            reductions: Reductions::default(),
            study: StudySettings::default(),
            space,
        })
    }

    /// Whether the scheme is that of [`galerkin`](crate::scheme::galerkin): for a degree above 0, a
    /// flux other than upwind, or partial reflection. A reduced case keeps the scheme of the whole
    /// one.
    pub fn is_galerkin(&self) -> bool {
        self.space.whole_degree() > 0 || self.scheme.flux < 1.0 || self.reflects()
    }

    /// Whether the initial data are a measure, represented by level sets.
    pub fn is_measure_valued(&self) -> bool {
        self.data.is_measure()
    }

    /// Number of axes along which points of the data and of the inflow differ: of measure-valued
    /// data those of space.
    pub fn source_dimensions(&self) -> usize {
        let n = self.space.dimension();
        if self.is_measure_valued() { n } else { 2 * n }
    }

    /// Whether the scheme of degree 0 for this case is the upwind scheme, with interface laws and
    /// limiters. For a case of a higher degree: whether it would be at degree 0.
    pub fn has_upwind_cells(&self) -> bool {
        !self.reflects() && (self.space.whole_degree() > 0 || self.scheme.flux >= 1.0)
    }

    /// `scheme.flux`; `None` for the upwind scheme of degree 0.
    pub fn flux_of_elements(&self) -> Option<f64> {
        (self.space.whole_degree() > 0 || self.scheme.flux < 1.0).then_some(self.scheme.flux)
    }

    /// Whether no particle leaves or enters through the ends of the box.
    pub fn is_closed(&self) -> bool {
        self.scheme.ends == EndFlux::Closed
    }

    /// Whether the scheme has the central flux and closed ends. It is unitary then, unless there is
    /// partial reflection.
    pub fn is_unitary(&self) -> bool {
        self.scheme.flux == 0.0 && self.is_closed()
    }

    /// Whether a region reflects part of the particles that could be transmitted.
    pub fn reflects(&self) -> bool {
        self.first_reflection().is_some()
    }

    /// Ends of the coordinates `[x, y, z, vx, vy, vz, t]` that the case has, by position.
    pub fn coordinate_ends(&self) -> Vec<(usize, [f64; 2])> {
        let PhaseSpace { x, v, .. } = self.space.whole();
        let axes = (x.iter().zip(0..)).chain(v.iter().zip(3..));
        let ends = axes.map(|(axis, position)| (position, [axis.lower, axis.upper]));
        ends.chain([(TIME, [self.start_time, self.end])]).collect()
    }

    /// The expression that holds the values of a table.
    fn of_table(&self, of: TableOf) -> Option<&Expression> {
        match of {
            TableOf::Initial => self.fields.first().map(|field| &field.initial),
            TableOf::Inflow => self.fields.first().map(LiouvilleField::entering),
            TableOf::Potential(i) => self.potential.get(i).map(|region| &region.value),
        }
    }

    /// This case with the values and the checksum of table number `k`.
    fn with_values(mut self, k: usize, values: Expression, checksum: Option<u64>) -> Self {
        self.tables[k].checksum = checksum;
        match (self.tables[k].of, self.fields.first_mut()) {
            (TableOf::Initial, Some(field)) => field.initial = values,
            (TableOf::Inflow, Some(field)) => field.inflow = Inflow::Formula(values),
            (TableOf::Potential(i), _) => self.potential[i].value = values,
            (_, None) => {}
        }
        self
    }

    /// This case with the values of table number `k`, which were read from its file.
    #[must_use]
    pub fn with_table(self, k: usize, table: Table) -> Self {
        let TableFile { of, interpolation, .. } = self.tables[k];
        let checksum = Some(table.checksum());
        let table = table.with_interpolation(interpolation);
        match self.of_table(of).map(|formula| formula.with_table(table)) {
            Some(values) => self.with_values(k, values, checksum),
            None => self,
        }
    }

    /// This case with the tables that `other` read from the same files.
    #[must_use]
    pub fn with_tables_of(mut self, other: &Self) -> Self {
        for k in 0..self.tables.len() {
            let same = other.tables.iter().find(|table| table.is_same(&self.tables[k]));
            let values = same.and_then(|table| other.of_table(table.of).zip(Some(table.checksum)));
            if let Some((values, checksum)) = values {
                self = self.with_values(k, values.clone(), checksum);
            }
        }
        self
    }

    /// This case read again with `more` `--set` options after its own, and the tables that it has.
    ///
    /// # Errors
    /// As [`Self::parse`].
    pub fn with_settings(&self, more: impl IntoIterator<Item = String>) -> Result<Self> {
        let set: Vec<String> = self.overrides.iter().cloned().chain(more).collect();
        Ok(Self::parse(&self.name, &self.text, &set)?.with_tables_of(self))
    }

    /// The values of all tables that were read.
    pub fn table_values(&self) -> impl Iterator<Item = (&TableFile, &Table)> {
        let values = |file: &TableFile| self.of_table(file.of).and_then(Expression::table);
        self.tables.iter().filter_map(move |file| Some((file, values(file)?)))
    }

    /// Whether the run starts from formulas or tables, not from the result of another run.
    pub fn starts_anew(&self) -> bool {
        self.warped_start.is_none() && self.start_field.is_none()
    }

    /// Whether the exact solution follows from the formulas of this case: not if the run starts
    /// from the result of another problem.
    pub fn follows_from_formulas(&self) -> bool {
        let of_same_problem =
            |start: &StartField| start.origin.is_some_and(|origin| origin.is_same_problem);
        self.warped_start.is_none() && self.start_field.as_ref().is_none_or(of_same_problem)
    }

    /// This case from time 0 on.
    pub fn from_time_zero(&self) -> Self {
        Self { start_field: None, start_time: 0.0, ..self.clone() }
    }

    /// Whether `other` has the same characteristics, and the same data at their feet: box, `V`,
    /// data, inflow and constants. Tables in files are not compared: with them it is false.
    pub fn is_same_problem(&self, other: &Self) -> bool {
        let text = |formula: Option<&Expression>| formula.map(|f| f.text().to_owned());
        let of_region = |region: &Region| {
            let Region { condition, value, reflection } = region;
            [condition.as_ref(), Some(value), reflection.as_ref()].map(text)
        };
        let of_field = |field: &LiouvilleField| {
            [field.initial.text().to_owned(), field.entering().text().to_owned()]
        };
        let ends = |axis: &Axis| [axis.lower, axis.upper];
        let have_tables = !self.tables.is_empty() || !other.tables.is_empty();
        !have_tables
            && self.potential.iter().map(of_region).eq(other.potential.iter().map(of_region))
            && self.fields.iter().map(of_field).eq(other.fields.iter().map(of_field))
            && self.constants == other.constants
            && self.space.axes().map(ends).eq(other.space.axes().map(ends))
            && self.space.periodic == other.space.periodic
    }

    /// The key that gives `V` in a region.
    pub fn potential_key(&self, region: usize) -> String {
        match self.potential[region].value.table() {
            Some(_) => TableOf::Potential(region).key(),
            None => format!("potential.{region}.value"),
        }
    }

    /// The key of the inflow.
    pub fn inflow_key(&self) -> &'static str {
        let is_table = self.tables.iter().any(|table| table.of == TableOf::Inflow);
        if is_table { "inflow.table" } else { "inflow.value" }
    }

    /// Whether any field may have inflow.
    pub fn enters(&self) -> bool {
        self.fields.iter().any(LiouvilleField::enters)
    }

    /// Whether there are auxiliary unknowns: if a field may have inflow, or if they are kept
    /// without.
    pub fn embeds(&self) -> bool {
        self.enters() || self.reductions.idle_unknowns
    }

    /// This case without inflow.
    pub fn without_inflow(&self) -> Self {
        let mut case = self.clone();
        for field in &mut case.fields {
            field.inflow = Inflow::Formula(field.entering().vanishing());
        }
        case
    }

    /// Whether the exact solution is found by tracing particles.
    pub fn traces_exact(&self) -> bool {
        matches!(self.exact, Some(Exact::Characteristics))
    }

    /// The times before the end at which results are written.
    pub fn shown_times(&self) -> impl Iterator<Item = &OutputTime> + Clone {
        self.output.at_start.iter().chain(&self.output.times)
    }

    /// Whether moments of the exact solution are computed at the output times before the end.
    pub fn has_exact_history(&self) -> bool {
        self.exact.is_some() && self.exact_times == ExactTimes::All
    }

    /// The text of `error` for a record that other people read: without the leading name of the
    /// case, and with the file's name in place of its path.
    pub fn reason(&self, error: &Error) -> String {
        let text = error.to_string();
        let text = text.strip_prefix(&format!("{}: ", self.name)).unwrap_or(&text);
        let file = Path::new(&self.name).file_name().and_then(OsStr::to_str);
        file.map_or_else(|| text.to_owned(), |file| text.replace(&self.name, file))
    }

    /// Simulated time of the run: `time.end − time.start`.
    pub fn duration(&self) -> f64 {
        self.end - self.start_time
    }

    /// Simulated time of each leg of the run, from one output time to the next and to the end.
    pub fn legs(&self) -> Vec<f64> {
        let ends = (self.output.times.iter().map(|t| t.time)).chain([self.end]);
        let mut now = self.start_time;
        ends.map(|end| end - std::mem::replace(&mut now, end)).collect()
    }

    /// Whether the inflow of any field depends on time.
    pub fn varies(&self) -> bool {
        self.fields.iter().any(LiouvilleField::varies)
    }
}

/// The table files that a case in `n` dimensions names.
fn table_files(
    file: &CaseFile<'_>,
    potential: &[RegionTable],
    initial: &InitialTable,
    inflow: &InflowTable,
    n: usize,
) -> Result<Vec<TableFile>> {
    let regions = (0..).zip(potential).map(|(i, region)| region.table(file, i, n));
    let all = [initial.table(file, n), inflow.table(file, n)].into_iter().chain(regions);
    all.filter_map(Result::transpose).collect()
}

/// The text of a case file.
///
/// # Errors
/// [`Error::Input`] if it cannot be read or is larger than 1 MiB.
pub fn read_text(path: &Path) -> Result<String> {
    let fail = |e: &dyn std::fmt::Display| Error::Input(format!("{}: {e}", path.display()));
    let mut text = String::new();
    std::fs::File::open(path)
        .and_then(|file| file.take(LONGEST_FILE + 1).read_to_string(&mut text))
        .map_err(|e| fail(&e))?;
    if text.len() as u64 > LONGEST_FILE {
        return Err(fail(&format!("a case file has at most {LONGEST_FILE} bytes")));
    }
    // Some editors put a byte order mark in front of the text.
    Ok(text.trim_start_matches('\u{feff}').to_owned())
}

/// The reductions that were made and those that could not be made, one line each.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub struct Reductions {
    /// The reductions that were made: the parts of the problem that are left out, one line each.
    pub dropped: Vec<String>,
    /// The parts that could not be left out, each with the reason.
    pub kept: Vec<String>,
    /// Whether auxiliary unknowns are kept although nothing enters.
    pub idle_unknowns: bool,
    /// Whether modes of both signs are propagated, and not only `l ≥ 0`.
    pub every_mode: bool,
}

/// What a study sets in the cases that it makes. A case file does not give it.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct StudySettings {
    /// Relative L1 error of the density that the trials for `solver.accuracy` expect on the grid
    /// that they chose; `None` before that.
    pub expected_error: Option<f64>,
    /// Largest number of points of the integrals of the exact solution over the velocities, in a
    /// study whose time is limited; else as many as they allow themselves.
    pub most_exact_points: Option<usize>,
}
