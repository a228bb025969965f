//! `A`, `b` and `(S, K)` of a case as files, for any program of linear algebra.
//!
//! `f' = A f + b` are the rows of the scheme. `S` and `K` are the symmetric and the skew part of
//! `D A D⁻¹`, `D = diag(√π)`, with the auxiliary unknowns of the inflow behind the cells: mode `l`
//! obeys `w' = (−iμ_l S + K) w`.
//!
//! | file | what |
//! |---|---|
//! | `description.json` | the case, and how many cells, unknowns and entries there are |
//! | `A.mtx` | `A`, (cells, cells), real |
//! | `S.mtx`, `K.mtx` | `S` and `K`, (unknowns, unknowns), lower triangles |
//! | `weights.npy` | `√π`, (unknowns): `u = √π f` |
//! | `b_f.npy`, … | `b` of each field, (cells) |
//! | `initial_f.npy`, … | `u` of each field at time zero, (unknowns) |
//!
//! Matrices are in Matrix Market's coordinate format, vectors in NumPy's. Cells are in the order
//! `(x1..xn, v1..vn)`, the last axis fastest.

use crate::base::disk;
use crate::base::error::Result;
use crate::base::text::visible;
use crate::problem::case::LiouvilleField;
use crate::problem::exported::{self, ExportKind, ExportOwner};
use crate::quantum::export::numpy;
use crate::scheme::rows::{Row, Scheme};
use crate::solve::prepared::Prepared;
use serde::Serialize;
use std::fmt::{self, Write};
use std::path::Path;

/// The numbers of a matrix, and its entries that a file lists.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Symmetry {
    General,
    Symmetric,
    SkewSymmetric,
    /// Complex, with the lower triangle.
    Hermitian,
}

impl Symmetry {
    /// The words for numbers and symmetry in the header of Matrix Market.
    fn words(self) -> &'static str {
        match self {
            Self::General => "real general",
            Self::Symmetric => "real symmetric",
            Self::SkewSymmetric => "real skew-symmetric",
            Self::Hermitian => "complex hermitian",
        }
    }

    pub(super) fn lists(self, row: usize, column: usize) -> bool {
        match self {
            Self::General => true,
            Self::Symmetric | Self::Hermitian => column <= row,
            Self::SkewSymmetric => column < row,
        }
    }
}

/// Numbers of unknowns and entries that were written.
#[derive(Clone, Copy, Debug, Default, Serialize)]
pub struct MatrixCounts {
    /// Cells, rows of `A`.
    pub cells: usize,
    /// Cells and auxiliary unknowns, rows of `S` and `K`.
    pub unknowns: usize,
    /// Entries of `A` that are not zero.
    pub entries: usize,
}

/// `description.json`.
#[derive(Serialize)]
struct MatrixDescription<'a> {
    #[serde(flatten)]
    owner: ExportOwner,
    title: &'a str,
    #[serde(flatten)]
    counts: MatrixCounts,
}

/// Names of all files but the description.
pub fn names(fields: &[LiouvilleField]) -> Vec<String> {
    let vectors =
        |field: &LiouvilleField| ["b", "initial"].map(|what| format!("{what}_{}.npy", field.name));
    let fixed = ["A.mtx", "S.mtx", "K.mtx", "weights.npy"].map(str::to_owned);
    fixed.into_iter().chain(fields.iter().flat_map(vectors)).collect()
}

/// Writes the files into `directory`; the whole grid is on this rank.
///
/// # Errors
/// As [`disk::write`] and [`exported::write`]; as [`Scheme::inflow_is_finite`].
pub fn export(prepared: &Prepared, directory: &Path) -> Result<MatrixCounts> {
    let Prepared { case, system, .. } = prepared;
    disk::make(directory)?;
    let write = |name: &str, bytes: &[u8]| disk::write(&directory.join(name), bytes);
    let (cells, unknowns) = (case.space.cells(), system.matrix.rows());

    let scheme = Scheme::whole(case)?;
    let mut row = Row::default();
    let mut a = MatrixMarket::new(cells, Symmetry::General);
    let mut b = vec![Vec::with_capacity(cells); case.fields.len()];
    for i in 0..cells {
        scheme.row(&mut row, i);
        for &(j, value) in &row.entries {
            a.entry(i, j, value);
        }
        for (b, value) in b.iter_mut().zip(row.inflow) {
            b.push(value);
        }
    }
    scheme.inflow_is_finite(&row)?;
    let entries = a.entries;
    write("A.mtx", a.text(&case.title).as_bytes())?;

    let mut s = MatrixMarket::new(unknowns, Symmetry::Symmetric);
    let mut k = MatrixMarket::new(unknowns, Symmetry::SkewSymmetric);
    for i in 0..unknowns {
        for (j, of_s, of_k) in system.matrix.row(i) {
            s.entry(i, j, of_s);
            k.entry(i, j, of_k);
        }
    }
    write("S.mtx", s.text(&case.title).as_bytes())?;
    write("K.mtx", k.text(&case.title).as_bytes())?;

    let roots: Vec<f64> = system.weights.pi[..unknowns].iter().map(|pi| pi.sqrt()).collect();
    write("weights.npy", &numpy::real(&roots))?;
    for ((field, b), state) in case.fields.iter().zip(&b).zip(&system.states) {
        write(&format!("b_{}.npy", field.name), &numpy::real(b))?;
        write(&format!("initial_{}.npy", field.name), &numpy::real(&state[..unknowns]))?;
    }
    let counts = MatrixCounts { cells, unknowns, entries };
    let owner = ExportOwner::new(ExportKind::Matrix, &case.settings);
    exported::write(directory, &MatrixDescription { owner, title: &case.title, counts })?;
    Ok(counts)
}

/// A square matrix in Matrix Market's coordinate format.
pub(super) struct MatrixMarket {
    order: usize,
    symmetry: Symmetry,
    entries: usize,
    lines: String,
}

impl MatrixMarket {
    pub(super) fn new(order: usize, symmetry: Symmetry) -> Self {
        Self { order, symmetry, entries: 0, lines: String::new() }
    }

    /// Adds a real entry, unless it is zero or follows from the one that mirrors it.
    fn entry(&mut self, row: usize, column: usize, value: f64) {
        if value != 0.0 && self.symmetry.lists(row, column) {
            self.push(row, column, format_args!("{value:e}"));
        }
    }

    /// Adds an entry with this text.
    pub(super) fn push(&mut self, row: usize, column: usize, value: fmt::Arguments<'_>) {
        let _ = writeln!(self.lines, "{} {} {value}", row + 1, column + 1);
        self.entries += 1;
    }

    /// The file, with the title of the case.
    pub(super) fn text(&self, title: &str) -> String {
        let Self { order, entries, lines, .. } = self;
        let (words, title) = (self.symmetry.words(), visible(title).replace('\n', " "));
        format!(
            "%%MatrixMarket matrix coordinate {words}\n% {title}\n\
             {order} {order} {entries}\n{lines}"
        )
    }
}
