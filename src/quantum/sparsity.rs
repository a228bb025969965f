//! Nonzeros of rows and columns of the scheme's matrices, against the paper's bounds.
//!
//! | matrix | bound on rows | on columns |
//! |---|---|---|
//! | `A^x_a`, transport along one axis | 3 | `Q_a` |
//! | `A^v`, force along all | `2n + 1` | `2n + 1` |
//! | `H` | `Q + 5` (n = 1), `Q_1 + Q_2 + 7` (n = 2) | the same |
//!
//! with `Q_a = 2⌈√(5/4 + (2/Δv_a) √((Δv_a/2)² + 2 max|V⁻ − V⁺|)) − ½⌉ + 2` over the faces normal to
//! axis `a` (paper, sections 4 to 6 and appendix A). For `H` in three dimensions the paper has the
//! order `O(Σ Q_a + n)` and no number. Its argument, carried through, is
//!
//! ```text
//! s(H) ≤ Σ_a (s_r(A^x_a) + s_c(A^x_a) − 1) + Σ_a s(A^v_a) − (2n − 1) + 1
//!      ≤ Σ Q_a + 2n + 3n − 2n + 2  =  Σ Q_a + 3n + 2,
//! ```
//!
//! the diagonals of `2n` matrices being one, and the diagonal of the inflow one entry: `Q + 5`, but
//! `Q_1 + Q_2 + 8` in two dimensions. This bound is ours, [`Sparsity::our_bound`]. All are for the
//! hat function on a velocity axis whose cells lie symmetrically about zero; other cases are
//! measured without a bound.

use crate::base::error::Result;
use crate::matrix::block_matrix::BlockMatrix;
use crate::parallel::communicator::Group;
use crate::parallel::partition::{Block, LocalIndex};
use crate::problem::case::{Case, Interface};
use crate::problem::grid::describe_point;
use crate::problem::potential::Potential;
use crate::scheme::rows::{Row, Scheme};
use serde::Serialize;

/// The most nonzeros of a row, or of a column, and where they are.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct LargestCount {
    /// The number of nonzeros.
    pub most: usize,
    /// The first such row (column): its cell, or the number of the auxiliary unknown.
    #[serde(rename = "place")]
    pub unknown: String,
    /// The paper's bound; `None` where it has none.
    pub bound: Option<usize>,
    /// Whether the bound holds; true where there is none.
    pub holds: bool,
}

/// The nonzeros of a matrix.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct NonzeroCounts {
    /// `A_x`, `A_y`, `A_z` (transport along one axis), `A_v` (force), `A`, `H1`, `H2`, `H`.
    pub matrix: String,
    /// The fullest row: `s_r`.
    pub rows: LargestCount,
    /// The fullest column: `s_c`.
    pub columns: LargestCount,
}

/// Sparsity of a case's matrices.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct Sparsity {
    /// `Q_a`, axis by axis.
    pub q: Vec<usize>,
    /// Largest jump of `V` over the faces normal to each axis.
    pub jumps: Vec<f64>,
    /// Whether the bounds are made for this case: hat interface, velocity cells symmetric about
    /// zero.
    pub bounded: bool,
    /// `Σ Q_a + 3n + 2`: our bound on the nonzeros of a row of `H`, by the paper's argument. `None`
    /// where no bound is made for the case.
    pub our_bound: Option<usize>,
    /// Nonzeros of `A` in all.
    pub entries: usize,
    /// The counts of each matrix.
    pub counts: Vec<NonzeroCounts>,
}

impl Sparsity {
    /// Nonzeros of the fullest row of `H`.
    pub fn of_hamiltonian(&self) -> usize {
        self.counts.last().map_or(0, |c| c.rows.most)
    }
}

/// `Q` for velocity cells of width `dv` and a largest jump `jump`.
pub fn q(dv: f64, jump: f64) -> usize {
    let root = (0.25 * dv * dv + 2.0 * jump).sqrt();
    2 * ((1.25 + 2.0 / dv * root).sqrt() - 0.5).ceil() as usize + 2
}

/// The fullest row or column so far: its number of nonzeros, and the global number of its unknown.
#[derive(Clone, Copy)]
struct FullestLine(usize, usize);

/// A number that no unknown has.
const NOWHERE: usize = i64::MAX as usize;

impl FullestLine {
    const NONE: Self = Self(0, NOWHERE);

    fn count_line(&mut self, count: usize, unknown: usize) {
        if count > self.0 || (count == self.0 && unknown < self.1) {
            *self = Self(count, unknown);
        }
    }

    /// The fullest over the ranks of `group`.
    fn over(self, group: &Group) -> Self {
        let most = group.max_count(self.0);
        let mine = if self.0 == most { self.1 } else { NOWHERE };
        Self(most, group.min_count(mine))
    }
}

/// Counts the nonzeros of `case`'s matrices; `matrix` are this rank's rows of `(S, K)`, weighted as
/// in a run. Collective over `space`.
///
/// # Errors
/// [`crate::base::error::Error::Formula`] where `V` is not finite.
pub fn measure(case: &Case, matrix: &BlockMatrix, space: &Group) -> Result<Sparsity> {
    let n = case.space.dimension();
    let block = &matrix.block;
    let scheme = space.agree(Scheme::new(case, &block.wide_ranges()))?;
    let jumps = largest_jumps(case, block, space)?;
    let q: Vec<usize> =
        case.space.v.iter().zip(&jumps).map(|(v, &jump)| q(v.width(), jump)).collect();
    let symmetric = (case.space.v.iter())
        .all(|v| (v.lower + v.upper).abs() < 1e-9 * v.width() && v.cells % 2 == 0);
    let bounded = symmetric && case.scheme.interface == Interface::Hat;
    let report = CountsReport { case, space, bounded };

    let mut parts = NonzeroParts::new(n, block);
    parts.count(&scheme, block);
    let mut counts: Vec<NonzeroCounts> =
        (0..=n + 1).map(|part| parts.counts(part, &q, &report)).collect();
    // H1, H2 and their pattern together, which is H's wherever μ is not 0.
    let of_columns: usize = q.iter().sum();
    let stated = match n {
        1 => Some(of_columns + 5),
        2 => Some(of_columns + 7),
        _ => None,
    };
    let our_bound = bounded.then_some(of_columns + 3 * n + 2);
    type Present = fn(f64, f64) -> bool;
    let kinds: [(&str, Present, Option<usize>); 3] = [
        ("H1", |s, _| s != 0.0, None),
        ("H2", |_, k| k != 0.0, None),
        ("H", |s, k| s != 0.0 || k != 0.0, stated),
    ];
    for (name, present, bound) in kinds {
        let fullest = parts.fullest_hamiltonian_row(matrix, &report, present);
        let found = report.count(fullest, bound);
        // Symmetric but for signs.
        counts.push(NonzeroCounts { matrix: name.to_owned(), rows: found.clone(), columns: found });
    }
    let entries = space.sum_count(parts.entries);
    Ok(Sparsity { q, jumps, bounded, our_bound, entries, counts })
}

/// Nonzeros of `A` by parts on this rank: transport axis by axis, then force (part `n`), then all.
struct NonzeroParts {
    dimension: usize,
    /// The fullest row of each part.
    rows: Vec<FullestLine>,
    /// Nonzeros of each column, by part, then by cell of the block.
    columns: Vec<Vec<u32>>,
    /// Global numbers of the cells of the block.
    globals: Vec<usize>,
    /// Nonzeros of `A`.
    entries: usize,
}

impl NonzeroParts {
    /// Zero counts.
    fn new(dimension: usize, block: &Block) -> Self {
        let (parts, cells) = (dimension + 2, block.cells());
        Self {
            dimension,
            rows: vec![FullestLine::NONE; parts],
            columns: vec![vec![0; cells]; parts],
            globals: vec![0; cells],
            entries: 0,
        }
    }

    /// Counts the block's rows, and the entries of its ghosts' rows in its columns.
    fn count(&mut self, scheme: &Scheme<'_>, block: &Block) {
        let mut starts = Vec::new();
        block.for_each_own(|global, local| starts.push((global, Some(local))));
        block.for_each_ghost(|global, _| starts.push((global, None)));
        let (mut row, mut columns) = (Row::default(), vec![Vec::new(); self.rows.len()]);
        for &(start, own) in &starts {
            for v in 0..block.velocity_cells {
                let global = start + v;
                if let Some(local) = own {
                    self.globals[local + v] = global;
                }
                self.row_columns(scheme, global, &mut row, &mut columns);
                for (part, list) in columns.iter().enumerate() {
                    if own.is_some() {
                        self.rows[part].count_line(list.len(), global);
                    }
                    for &column in list {
                        if let Some(LocalIndex::Own(j)) = block.local(column) {
                            self.columns[part][j] += 1;
                        }
                    }
                }
                if own.is_some() {
                    self.entries += columns[self.dimension + 1].len();
                }
            }
        }
    }

    /// Columns with entries in row `global`, by part.
    fn row_columns(
        &self,
        scheme: &Scheme<'_>,
        global: usize,
        row: &mut Row,
        columns: &mut [Vec<usize>],
    ) {
        let n = self.dimension;
        columns.iter_mut().for_each(Vec::clear);
        for axis in 0..2 * n {
            scheme.part(row, global, axis);
            for part in [axis.min(n), n + 1] {
                columns[part].extend(row.entries.iter().map(|e| e.0));
            }
        }
        for list in columns {
            list.sort_unstable();
            list.dedup();
        }
    }

    /// The counts of a part over all ranks. Collective.
    fn counts(&self, part: usize, q: &[usize], report: &CountsReport<'_>) -> NonzeroCounts {
        let n = self.dimension;
        let mut fullest_column = FullestLine::NONE;
        for (&number, &global) in self.columns[part].iter().zip(&self.globals) {
            fullest_column.count_line(number as usize, global);
        }
        let (name, [of_rows, of_columns]) = match part {
            part if part < n => (["A_x", "A_y", "A_z"][part], [Some(3), Some(q[part])]),
            part if part == n => ("A_v", [Some(2 * n + 1); 2]),
            _ => ("A", [None; 2]),
        };
        NonzeroCounts {
            matrix: name.to_owned(),
            rows: report.count(self.rows[part], of_rows),
            columns: report.count(fullest_column, of_columns),
        }
    }

    /// The fullest of this rank's rows of `(S, K)`, and of the row that all ranks share, with the
    /// entries that are `present`. Collective.
    fn fullest_hamiltonian_row(
        &self,
        matrix: &BlockMatrix,
        report: &CountsReport<'_>,
        present: fn(f64, f64) -> bool,
    ) -> FullestLine {
        let all = report.case.space.cells();
        // Auxiliary unknowns are numbered behind the cells, like their rows.
        let unknown = |i: usize| match i.checked_sub(self.globals.len()) {
            None => self.globals[i],
            Some(m) => all + self.globals[matrix.inflow[m].row as usize],
        };
        let mut fullest = FullestLine::NONE;
        let number = |i: usize| matrix.row(i).filter(|&(_, s, k)| present(s, k)).count();
        let own = matrix.shared_row().unwrap_or(matrix.rows());
        (0..own).for_each(|i| fullest.count_line(number(i), unknown(i)));
        if let Some(shared) = matrix.shared_row() {
            fullest.count_line(report.space.sum_count(number(shared)), 2 * all);
        }
        fullest
    }
}

/// Makes counts of all ranks' fullest rows.
struct CountsReport<'a> {
    case: &'a Case,
    space: &'a Group,
    /// Whether the paper's bounds are made for this case.
    bounded: bool,
}

impl CountsReport<'_> {
    /// The fullest over all ranks, beside its bound. Collective.
    fn count(&self, found: FullestLine, bound: Option<usize>) -> LargestCount {
        let FullestLine(most, unknown) = found.over(self.space);
        let bound = bound.filter(|_| self.bounded);
        let unknown = self.describe(unknown);
        LargestCount { most, unknown, bound, holds: bound.is_none_or(|b| most <= b) }
    }

    fn describe(&self, unknown: usize) -> String {
        let space = &self.case.space;
        let all = space.cells();
        let point =
            |global: usize| describe_point(space.dimension(), &space.point(&space.cell(global)));
        match unknown {
            NOWHERE => "no row".to_owned(),
            unknown if unknown < all => point(unknown),
            unknown if unknown == 2 * all => "the common auxiliary unknown".to_owned(),
            unknown => format!("the auxiliary unknown of {}", point(unknown - all)),
        }
    }
}

/// The largest jump of `V` over the faces normal to each axis. Collective over `space`.
fn largest_jumps(case: &Case, block: &Block, space: &Group) -> Result<Vec<f64>> {
    let potential = space.agree(Potential::new(case, &block.wide_ranges()))?;
    let n = case.space.dimension();
    let mut largest = vec![0.0f64; n];
    block.for_each_own(|global, _| {
        let cell = case.space.cell(global);
        for (a, largest) in largest.iter_mut().enumerate() {
            *largest = largest.max(potential.jump_below(&cell, a).abs());
        }
    });
    Ok(largest.into_iter().map(|jump| space.max(jump)).collect())
}
