//! `[initial]`: the initial data, and the fields that evolve from them.
//!
//! Uses file and reader (the keys), coordinates, data_files, inflow.

use crate::base::error::Result;
use crate::problem::case::coordinates::{
    TIME, names_of_phase_space, names_of_space, required_formula,
};
use crate::problem::case::data_files::{
    FileTable, StartField, TableFile, TableOf, WarpedStart, path_of,
};
use crate::problem::case::file::CaseFile;
use crate::problem::case::inflow::{Inflow, InflowTable};
use crate::problem::case::reader::{Formula, List};
use crate::problem::formula::Expression;
use crate::problem::grid::MAX_DIMENSION;
use serde::Deserialize;

/// Largest number of fields of a case: a density, and a level set for each velocity axis.
pub const MOST_FIELDS: usize = 1 + MAX_DIMENSION;

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
        let table = self.table(file, n)?;
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

    /// The table file of `f0` in `n` dimensions, if the case gives one.
    pub(super) fn table(&self, file: &CaseFile<'_>, n: usize) -> Result<Option<TableFile>> {
        FileTable::read(&self.table, file, TableOf::Initial, n)
    }
}
