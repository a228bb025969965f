//! `[[potential]]`: the regions of `V`.
//!
//! Uses file and reader (the keys), coordinates, data_files (tables of `V`).

use crate::base::error::Result;
use crate::problem::case::coordinates::{Names, formula, names_of_space, required_formula};
use crate::problem::case::data_files::{FileTable, TableFile, TableOf};
use crate::problem::case::file::CaseFile;
use crate::problem::case::reader::{Formula, Item};
use crate::problem::formula::Expression;
use crate::problem::table::Interpolation;
use serde::Deserialize;

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
    pub(super) fn table(
        &self,
        file: &CaseFile<'_>,
        i: usize,
        n: usize,
    ) -> Result<Option<TableFile>> {
        let found = FileTable::read(&self.table, file, TableOf::Potential(i), n)?;
        let interpolation = self.interpolation.unwrap_or(Interpolation::Constant);
        Ok(found.map(|table| table.interpolated(interpolation)))
    }
}

impl Item for RegionTable {
    const PLURAL: &'static str = "tables, [[potential]],";
}

/// The regions of `V` in `n` dimensions.
pub fn regions(file: &CaseFile<'_>, tables: &[RegionTable], n: usize) -> Result<Vec<Region>> {
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
        // A region that reflects nothing is one without the key.
        let reflection = formula(file, &key, &table.reflection, &REFLECTION_NAMES)?
            .filter(|part| part.constant() != Some(0.0));
        Ok(Region { condition, value, reflection })
    };
    tables.iter().enumerate().map(region).collect()
}
