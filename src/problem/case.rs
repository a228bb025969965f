//! The case file: a problem, and how to solve it.
//!
//! [`Case::parse`] reads a case in three steps, without MPI: `file` reads TOML and `--set` into a
//! tree that remembers where each value stands; serde makes a `Tables` of it, by `reader`, which
//! refuses unknown keys and wrong types, and takes formulas of constants for numbers; `Case::new`
//! turns that into a [`Case`], a section after the other, and `Case::validate` refuses what does
//! not go together.
//!
//! A key of the case file is a field of its section's table, with its default in the table's
//! `Default` and its check in the table's `check`: `constants`, `axes`, `data`, `solver`, `warp`,
//! `output`, `readout`. Limits are in [`limits`](crate::problem::limits).

pub(crate) mod alpha;
pub(crate) mod axes;
pub(crate) mod constants;
pub(crate) mod data;
pub(crate) mod file;
pub(crate) mod keys;
pub(crate) mod output;
pub(crate) mod reader;
pub(crate) mod readout;
pub(crate) mod settings;
pub(crate) mod solver;
mod validate;
pub(crate) mod warp;

pub use crate::problem::case::alpha::{Alpha, DEFAULT_ALPHA};
pub use crate::problem::case::data::{
    Data, Exact, Inflow, LiouvilleField, MOST_FIELDS, Origin, Region, StartField, TIME, TableFile,
    TableOf, WarpedStart,
};
pub use crate::problem::case::keys::ValueKind;
pub use crate::problem::case::output::{DeltaWidth, OutputTime, Plateau, Storage};
pub use crate::problem::case::readout::{MeasurementEffort, ReadoutSettings};
pub use crate::problem::case::settings::{Settings, differing_setting};
pub use crate::problem::case::solver::{
    Allowed, DEFAULT_CFL, DEFAULT_FLUX, EndFlux, Integrator, Interface, Limiter, Method,
    Propagation, PropagatorMethod,
};
pub use crate::problem::case::warp::{
    Coefficients, DEFAULT_BETA, DEFAULT_ORDER, Delta, Embedding, ProfileChoice, RecoveryMethod,
    Shift, Warp,
};
pub use crate::problem::limits::LARGEST_TOLERANCE;

use crate::base::error::{Error, Result};
use crate::problem::case::axes::AxisPair;
use crate::problem::case::constants::ConstantsTable;
use crate::problem::case::data::{ExactTable, InflowTable, InitialTable, RegionTable};
use crate::problem::case::file::CaseFile;
use crate::problem::case::output::OutputTable;
use crate::problem::case::reader::List;
use crate::problem::case::readout::ReadoutTable;
use crate::problem::case::solver::{CheckpointTable, SchemeTable, SolverTable, TimeTable};
use crate::problem::formula::{Constants, Expression};
use crate::problem::grid::PhaseSpace;
use crate::problem::limits::LONGEST_FILE;
use crate::problem::table::Table;
use serde::Deserialize;
use serde_json::Value;
use std::ffi::OsStr;
use std::io::Read;
use std::ops::Range;
use std::path::Path;
use std::time::Duration;

/// The case file as it is written.
#[derive(Debug, Default, Deserialize)]
#[serde(default)]
struct Tables {
    title: String,
    reference: String,
    /// Read before all else, as numbers may be formulas of them.
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

/// All keys that a case file may have, as the table that the whole file is.
pub fn keys() -> ValueKind {
    keys::of::<Tables>()
}

/// The values of a case file with its `--set` options, as JSON; they are not checked.
///
/// # Errors
/// [`Error::Input`] where the text is no TOML, or an override no `key=value` that fits it.
pub fn values(name: &str, text: &str, overrides: &[String]) -> Result<Value> {
    Ok(CaseFile::parse(name, text, overrides)?.json())
}

/// A problem and how to solve it, as read from a case file.
#[derive(Clone, Debug)]
pub struct Case {
    /// Name of the file it was read from.
    pub name: String,
    /// `title`; the name of the case's file where it gives none.
    pub title: String,
    /// `reference`.
    pub reference: String,
    /// `[constants]`, by their names.
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
    /// `initial.warped`. Then `f(0)` is not known, and its formula is not used.
    pub start: Option<WarpedStart>,
    /// `initial.field`: `f` at [`begin`](Self::begin), where that is not `initial.f` at 0.
    pub start_field: Option<StartField>,
    /// The files of `f0`, `V` and what enters, where these are no formulas.
    pub tables: Vec<TableFile>,
    /// `time.start`, 0 unless a file gives `f` there. Formulas and outputs count from 0.
    pub begin: f64,
    /// `time.end`: final time `T`.
    pub end: f64,
    /// `scheme.interface`.
    pub interface: Interface,
    /// `scheme.flux`: `α` of the numerical flux between elements, 1 upwind, 0 central.
    pub flux: f64,
    /// `scheme.ends`.
    pub ends: EndFlux,
    /// `scheme.limiter`.
    pub limiter: Limiter,
    /// `solver.method`.
    pub method: Method,
    /// `solver.tolerance`: relative l2 distance to the exact semi-discrete solution.
    pub tolerance: f64,
    /// `solver.accuracy`: relative L1 error of the density for which `run`, `plan` and `check`
    /// choose grid, degree, flux, interface and tolerance.
    pub accuracy: Option<f64>,
    /// File and line of the tolerance, for errors.
    pub tolerance_place: String,
    /// File and line of `solver.warp.interval`, for errors.
    pub interval_place: String,
    /// `solver.verify`: whether to measure that distance (one classical solve).
    pub verify: bool,
    /// `solver.strict`: whether a run that misses its tolerance or accuracy ends with an error.
    pub strict: bool,
    /// `[solver.warp]`.
    pub warp: Warp,
    /// `[solver.propagator]`.
    pub propagator: Propagation,
    /// `solver.classical.integrator`.
    pub integrator: Integrator,
    /// `solver.classical.cfl`.
    pub cfl: f64,
    /// `[solver.reduce]`.
    pub reduce: Allowed,
    /// The reductions of the case: cells, axes and modes that were left out.
    pub reductions: Reductions,
    /// `[exact]`.
    pub exact: Option<Exact>,
    /// `output.recovery_points`: 2 gives the error estimate.
    pub recovery_points: usize,
    /// `output.plateau`.
    pub plateau: Option<Plateau>,
    /// The output at time zero, from `output.moment_times`, `field_times` and `fields_every`.
    pub at_start: Option<OutputTime>,
    /// The rest of these and of `output.moments_every`, ascending.
    pub times: Vec<OutputTime>,
    /// `output.warped_field`: whether all modes are kept, and `w(t, x, v, p)` is written.
    pub warped_field: bool,
    /// `output.expand`: whether results are shown on axes that were left out.
    pub expand: bool,
    /// `output.positive`: whether `f` is limited to positive values before it is written.
    pub positive: bool,
    /// `output.delta_width`, for measure-valued data.
    pub delta_width: DeltaWidth,
    /// How the fields are stored.
    pub storage: Storage,
    /// `checkpoint.minutes`: how often a checkpoint is made; never by the clock where there is
    /// none.
    pub checkpoint_every: Option<Duration>,
    /// `[readout]`.
    pub readout: Option<ReadoutSettings>,
    /// The case file as read.
    pub text: String,
    /// The `--set` options applied to it.
    pub overrides: Vec<String>,
    /// Every value that both give, by its key.
    pub settings: Settings,
}

impl Case {
    /// Reads a case from the text of a file called `name`, with `--set` overrides applied.
    ///
    /// # Errors
    /// [`Error::Input`] with file, line, key, value and limit.
    pub fn parse(name: &str, text: &str, overrides: &[String]) -> Result<Self> {
        let mut file = CaseFile::parse(name, text, overrides)?;
        file.constants = constants::resolved(&file)?;
        let tables: Tables = file.read()?;
        let mut case = Self::new(&file, tables)?;
        case.validate(&file)?;
        name.clone_into(&mut case.name);
        if case.title.is_empty() {
            let file = Path::new(name).file_name().unwrap_or(name.as_ref());
            case.title = file.to_string_lossy().into_owned();
        }
        text.clone_into(&mut case.text);
        case.overrides = overrides.to_vec();
        Ok(case)
    }

    /// Reads a case file from disk.
    ///
    /// # Errors
    /// As [`parse`](Self::parse), and when the file cannot be read or is larger than 1 MiB.
    pub fn load(path: &Path, overrides: &[String]) -> Result<Self> {
        Self::parse(&path.display().to_string(), &read_text(path)?, overrides)
    }

    /// The case of `tables`, each section checked by itself.
    fn new(file: &CaseFile<'_>, tables: Tables) -> Result<Self> {
        let space = axes::space(file, &tables.axis.0, tables.scheme.degree)?;
        let degree = space.degree();
        let n = space.dimension();
        let potential = data::potential(file, &tables.potential.0, n)?;
        let reflects = potential.iter().any(|region| region.reflection.is_some());
        let (data, fields) = tables.initial.check(file, n, &tables.inflow)?;
        let Range { start: begin, end } = tables.time.check(file)?;
        let duration = end - begin;
        let solver = tables.solver;
        let flux = tables.scheme.flux(file, degree)?;
        let output = tables.output;
        let start = tables.initial.start(file)?;
        let start_field = tables.initial.field(file, &data)?;
        let regions = &tables.potential.0;
        let files = data::tables(file, regions, &tables.initial, &tables.inflow, n)?;
        let times = output.times(file, begin..end, start.is_none())?;
        let readout = tables.readout.map(|table| table.check(file, &space));
        Ok(Self {
            name: String::new(),
            title: tables.title,
            reference: tables.reference,
            constants: file.constants.clone(),
            potential,
            exact: tables.exact.check(file, n, &data)?,
            data,
            fields,
            start,
            start_field,
            tables: files,
            begin,
            end,
            interface: tables.scheme.interface(degree > 0 || reflects || flux < 1.0),
            flux,
            ends: tables.scheme.ends,
            limiter: tables.scheme.limiter,
            method: solver.method,
            tolerance: solver.tolerance(file)?,
            accuracy: solver.accuracy(file)?,
            tolerance_place: file.place("solver.tolerance"),
            interval_place: file.place("solver.warp.interval"),
            verify: solver.verify,
            strict: solver.strict,
            warp: solver.warp.check(file, duration)?,
            propagator: solver.propagator.check(file, duration)?,
            integrator: solver.classical.integrator,
            cfl: solver.classical.cfl(file)?,
            reduce: solver.reduce,
            reductions: Reductions::default(),
            recovery_points: output.recovery_points(file)?,
            plateau: output.plateau(file)?,
            at_start: times.start,
            times: times.between,
            warped_field: output.warped_field,
            expand: output.expand,
            positive: output.positive,
            delta_width: output.delta_width,
            storage: output.storage(file, &space)?,
            checkpoint_every: tables.checkpoint.check(file)?,
            readout: readout.transpose()?,
            text: String::new(),
            overrides: Vec::new(),
            settings: file.settings(),
            space,
        })
    }

    /// Whether the scheme is the one of [`galerkin`](crate::scheme::galerkin): of a degree above 0,
    /// with another flux than upwind, or with partial reflection.
    pub fn is_galerkin(&self) -> bool {
        self.space.degree() > 0 || self.flux < 1.0 || self.reflects()
    }

    /// Whether its scheme of degree 0 is the upwind one, with laws at jumps and slopes; of a case
    /// of a higher degree, whether it would be.
    pub fn has_upwind_cells(&self) -> bool {
        !self.reflects() && (self.space.degree() > 0 || self.flux >= 1.0)
    }

    /// `scheme.flux`, where the scheme is not the upwind one of degree 0.
    pub fn flux_of_elements(&self) -> Option<f64> {
        (self.space.degree() > 0 || self.flux < 1.0).then_some(self.flux)
    }

    /// Whether no particle leaves or enters through the ends of the box.
    pub fn is_closed(&self) -> bool {
        self.ends == EndFlux::Closed
    }

    /// Whether the scheme is the unitary one, but for partial reflection: the central flux and
    /// closed ends.
    pub fn is_unitary(&self) -> bool {
        self.flux == 0.0 && self.is_closed()
    }

    /// Whether anything is reflected in part at jumps of `V`.
    pub fn reflects(&self) -> bool {
        self.potential.iter().any(|region| region.reflection.is_some())
    }

    /// The text that represents the values of a table.
    fn of_table(&self, of: TableOf) -> Option<&Expression> {
        match of {
            TableOf::Initial => self.fields.first().map(|field| &field.initial),
            TableOf::Inflow => self.fields.first().map(LiouvilleField::entering),
            TableOf::Potential(i) => self.potential.get(i).map(|region| &region.value),
        }
    }

    /// The same case with `values` of table number `k`, and its checksum.
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

    /// The same case with the values that were read of table number `k`.
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

    /// The same case with the tables that `other` has read of the same files.
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

    /// The values of all tables that were read.
    pub fn table_values(&self) -> impl Iterator<Item = (&TableFile, &Table)> {
        let values = |file: &TableFile| self.of_table(file.of).and_then(Expression::table);
        self.tables.iter().filter_map(move |file| Some((file, values(file)?)))
    }

    /// The key of the inflow.
    pub fn inflow_key(&self) -> &'static str {
        let is_table = self.tables.iter().any(|table| table.of == TableOf::Inflow);
        if is_table { "inflow.table" } else { "inflow.value" }
    }

    /// Whether anything may enter, of any field.
    pub fn enters(&self) -> bool {
        self.fields.iter().any(LiouvilleField::enters)
    }

    /// Whether there are auxiliary unknowns: where anything may enter, or where they are wanted all
    /// the same.
    pub fn embeds(&self) -> bool {
        self.enters() || self.reductions.idle_unknowns
    }

    /// The same case without inflow.
    pub fn without_inflow(&self) -> Self {
        let mut case = self.clone();
        for field in &mut case.fields {
            field.inflow = Inflow::Formula(field.entering().vanishing());
        }
        case
    }

    /// The times at which results are written, but for the end.
    pub fn shown_times(&self) -> impl Iterator<Item = &OutputTime> + Clone {
        self.at_start.iter().chain(&self.times)
    }

    /// What `error` says of this case, for a record that other people read: without the case's name
    /// in front, and without the directories of its file.
    pub fn reason(&self, error: &Error) -> String {
        let text = error.to_string();
        let text = text.strip_prefix(&format!("{}: ", self.name)).unwrap_or(&text);
        let file = Path::new(&self.name).file_name().and_then(OsStr::to_str);
        file.map_or_else(|| text.to_owned(), |file| text.replace(&self.name, file))
    }

    /// How long the run is: `time.end − time.start`.
    pub fn duration(&self) -> f64 {
        self.end - self.begin
    }

    /// How long each leg of the run takes: from one output time to the next, the last to the end.
    pub fn legs(&self) -> Vec<f64> {
        let ends = (self.times.iter().map(|t| t.time)).chain([self.end]);
        let mut now = self.begin;
        ends.map(|end| end - std::mem::replace(&mut now, end)).collect()
    }

    /// Whether what enters depends on time, of any field.
    pub fn varies(&self) -> bool {
        self.fields.iter().any(LiouvilleField::varies)
    }
}

/// The text of a case file.
///
/// # Errors
/// [`Error::Input`] when it cannot be read or is larger than 1 MiB.
pub fn read_text(path: &Path) -> Result<String> {
    let fail = |e: &dyn std::fmt::Display| Error::Input(format!("{}: {e}", path.display()));
    let mut text = String::new();
    std::fs::File::open(path)
        .and_then(|file| file.take(LONGEST_FILE + 1).read_to_string(&mut text))
        .map_err(|e| fail(&e))?;
    if text.len() as u64 > LONGEST_FILE {
        return Err(fail(&format!("a case file has at most {LONGEST_FILE} bytes")));
    }
    // A byte order mark is no part of the text.
    Ok(text.trim_start_matches('\u{feff}').to_owned())
}

/// The reductions of a case, and those that looked possible but were not made; a line each.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub struct Reductions {
    /// Left out.
    pub dropped: Vec<String>,
    /// Kept, and why.
    pub kept: Vec<String>,
    /// Whether there are auxiliary unknowns without inflow.
    pub idle_unknowns: bool,
    /// Whether modes of both signs are propagated.
    pub every_mode: bool,
}
