//! `[inflow]`: the values of a field on the boundary of the phase-space box.
//!
//! Uses file and reader (the keys), coordinates, data_files (a table of the inflow).

use crate::base::error::Result;
use crate::problem::case::coordinates::names_with_time;
use crate::problem::case::data_files::{FileTable, TableFile, TableOf};
use crate::problem::case::file::CaseFile;
use crate::problem::case::reader::Formula;
use crate::problem::formula::Expression;
use serde::Deserialize;

/// The inflow through the boundary of the phase-space box.
#[derive(Clone, Debug)]
pub enum Inflow {
    /// A formula, evaluated at centres of ghost cells, or just outside of the ends of the box.
    Formula(Expression),
    /// The initial formula, evaluated there.
    Initial,
}

/// `[inflow]` as it is written.
#[derive(Debug, Default, Deserialize)]
pub struct InflowTable {
    /// By default `initial` for measure-valued data and 0 for others.
    value: Option<Formula>,
    table: Option<FileTable>,
}

impl InflowTable {
    /// The inflow; `default` if the file gives none.
    pub(super) fn check(&self, file: &CaseFile<'_>, n: usize, default: &str) -> Result<Inflow> {
        if let Some(table) = self.table(file, n)? {
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

    /// The table file of the inflow in `n` dimensions, if the case gives one.
    pub(super) fn table(&self, file: &CaseFile<'_>, n: usize) -> Result<Option<TableFile>> {
        FileTable::read(&self.table, file, TableOf::Inflow, n)
    }
}
