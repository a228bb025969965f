//! Sparse access to `H = H1 ⊗ D_μ − H2 ⊗ I` (paper, section 3.2): location and value oracle.
//!
//! Row `j = i N_p + l` of `H` is unknown `i` of the (weighted, augmented) system in mode `l`, with
//! the wavenumber `μ_l = 2π(l − N_p/2)/P`. With `H1 = S` and `iH2 = K`
//!
//! ```text
//! H_{jk} = μ_l S_{ii'} + i K_{ii'}      where k = i' N_p + l,   0 in other modes.
//! ```
//!
//! Both oracles evaluate only rows of the scheme, [`Scheme::row`]. A value takes two of them, rows
//! `i` and `i'` of `A`. The location of an entry takes row `i`, and the rows `i'` that may have an
//! entry in column `i`: the neighbouring cells and, across the faces of its space cell, all
//! velocities along the axis of the face. A quantum computer would load as data what is not
//! computed: the weights `π`, one number a cell, and the couplings of the inflow.

use crate::base::error::Result;
use crate::matrix::block_matrix::BlockMatrix;
use crate::parallel::communicator::Group;
use crate::problem::case::Case;
use crate::problem::grid::PhaseSpace;
use crate::scheme::rows::{Row, Scheme};
use crate::solve::system::DiscreteSystem;
use num_complex::Complex64;
use std::f64::consts::TAU;

/// The oracles of sparse access to the `H` of a case.
pub struct SparseAccess<'a> {
    scheme: Scheme<'a>,
    space: &'a PhaseSpace,
    /// `π` of the cells.
    pi: &'a [f64],
    inflow: Couplings,
    /// `N_p`.
    points: usize,
    /// `P`.
    period: f64,
    bounds: AccessBounds,
}

/// The couplings `κ` of the rows that the inflow enters, in weighted unknowns.
struct Couplings {
    /// `(row, κ)`, ascending in the row.
    rows: Vec<(usize, f64)>,
    /// Whether a single auxiliary unknown serves all rows.
    shared: bool,
}

impl Couplings {
    /// `κ` of cell `row` and the auxiliary unknown `number`; zero where these are not coupled.
    fn coupling(&self, row: usize, number: usize) -> f64 {
        match self.rows.binary_search_by_key(&row, |e| e.0) {
            Ok(place) if self.shared || place == number => self.rows[place].1,
            _ => 0.0,
        }
    }
}

/// Scratch of an oracle: a row of the scheme and the nonzeros found.
#[derive(Default)]
pub struct Scratch {
    row: Row,
    candidates: Vec<usize>,
    /// `(column, s, k)`, ascending.
    entries: Vec<(usize, f64, f64)>,
}

impl<'a> SparseAccess<'a> {
    /// The oracles of `case` for `points` modes on the period `period`; `problem` is the whole grid
    /// on this rank.
    ///
    /// # Errors
    /// [`crate::base::error::Error::Formula`] where `V` is not finite.
    pub fn new(
        case: &'a Case,
        problem: &'a DiscreteSystem,
        points: usize,
        period: f64,
    ) -> Result<Self> {
        let matrix = &problem.matrix;
        let shared = matrix.shared_row().is_some();
        let rows = matrix.inflow.iter().map(|aux| (aux.row as usize, aux.coupling));
        let mut this = Self {
            scheme: Scheme::whole(case)?,
            space: &case.space,
            pi: &problem.weights.pi[..case.space.cells()],
            inflow: Couplings { rows: rows.collect(), shared },
            points,
            period,
            bounds: AccessBounds::default(),
        };
        let highest = this.wavenumber(0).abs();
        this.bounds = AccessBounds::of(matrix, highest);
        Ok(this)
    }

    /// Unknowns of the system: cells and auxiliary ones.
    pub fn unknowns(&self) -> usize {
        let auxiliary = if self.inflow.shared { 1 } else { self.inflow.rows.len() };
        self.space.cells() + auxiliary
    }

    /// Order of `H`.
    pub fn order(&self) -> usize {
        self.unknowns() * self.points
    }

    /// `d`: entries of the fullest row that are not zero.
    pub fn sparsity(&self) -> usize {
        self.bounds.sparsity
    }

    /// `‖H‖_max`.
    pub fn largest(&self) -> f64 {
        self.bounds.largest
    }

    /// `μ_l`.
    pub fn wavenumber(&self, l: usize) -> f64 {
        TAU * (l as f64 - (self.points / 2) as f64) / self.period
    }

    /// `f_H(j, ℓ)`: the column of the `ℓ`-th nonzero entry of row `j`, in ascending order;
    /// [`order`](Self::order), the dummy, where the row has no more.
    pub fn location(&self, scratch: &mut Scratch, j: usize, entry: usize) -> usize {
        let (i, l) = (j / self.points, j % self.points);
        self.row(scratch, i);
        let mu = self.wavenumber(l);
        let present = |e: &&(usize, f64, f64)| mu * e.1 != 0.0 || e.2 != 0.0;
        let found = scratch.entries.iter().filter(present).nth(entry);
        found.map_or(self.order(), |e| e.0 * self.points + l)
    }

    /// `H_jk`; zero at the dummy.
    pub fn value(&self, scratch: &mut Scratch, j: usize, k: usize) -> Complex64 {
        let l = j % self.points;
        if k >= self.order() || k % self.points != l {
            return Complex64::ZERO;
        }
        let [s, k] = self.pair(&mut scratch.row, j / self.points, k / self.points);
        Complex64::new(self.wavenumber(l) * s, k)
    }

    /// `(S_ij, K_ij)`, from the two rows `i` and `j` of the scheme.
    fn pair(&self, row: &mut Row, i: usize, j: usize) -> [f64; 2] {
        let cells = self.space.cells();
        match (i < cells, j < cells) {
            (true, true) if i == j => [self.of_scheme(row, i, i), 0.0],
            (true, true) => {
                let there = 0.5 * self.of_scheme(row, i, j) * self.ratio(i, j);
                let back = 0.5 * self.of_scheme(row, j, i) * self.ratio(j, i);
                [there + back, there - back]
            }
            (true, false) => {
                let half = 0.5 * self.inflow.coupling(i, j - cells);
                [half, half]
            }
            (false, true) => {
                let half = 0.5 * self.inflow.coupling(j, i - cells);
                [half, -half]
            }
            (false, false) => [0.0; 2],
        }
    }

    /// `A_ij` of cells.
    fn of_scheme(&self, row: &mut Row, i: usize, j: usize) -> f64 {
        self.scheme.row(row, i);
        let found = row.entries.binary_search_by_key(&j, |e| e.0);
        found.map_or(0.0, |place| row.entries[place].1)
    }

    /// `√(π_i/π_j)` for cells.
    fn ratio(&self, i: usize, j: usize) -> f64 {
        (self.pi[i] / self.pi[j]).sqrt()
    }

    /// Puts row `i` of `(S, K)` into `scratch.entries`.
    pub fn row(&self, scratch: &mut Scratch, i: usize) {
        let Scratch { row, candidates, entries } = scratch;
        entries.clear();
        let cells = self.space.cells();
        if i >= cells {
            // An auxiliary unknown: its own row, or all that share it; A has no row for it.
            let own = if self.inflow.shared {
                &self.inflow.rows[..]
            } else {
                std::slice::from_ref(&self.inflow.rows[i - cells])
            };
            entries.extend(own.iter().map(|&(row, kappa)| (row, 0.5 * kappa, -0.5 * kappa)));
            return;
        }
        self.scheme.row(row, i);
        for &(j, a) in &row.entries {
            if i == j {
                entries.push((i, a, 0.0))
            } else {
                let half = 0.5 * a * self.ratio(i, j);
                entries.push((j, half, half));
            }
        }
        self.drawing_on(candidates, i);
        for &k in candidates.iter().filter(|&&k| k != i) {
            self.scheme.row(row, k);
            if let Ok(place) = row.entries.binary_search_by_key(&i, |e| e.0) {
                let half = 0.5 * row.entries[place].1 * self.ratio(k, i);
                entries.push((k, half, -half));
            }
        }
        entries.sort_unstable_by_key(|e| e.0);
        entries.dedup_by(|next, kept| {
            let same = next.0 == kept.0;
            if same {
                kept.1 += next.1;
                kept.2 += next.2;
            }
            same
        });
        if let Ok(place) = self.inflow.rows.binary_search_by_key(&i, |e| e.0) {
            let kappa = self.inflow.rows[place].1;
            let column = if self.inflow.shared { cells } else { cells + place };
            entries.push((column, 0.5 * kappa, 0.5 * kappa));
        }
    }

    /// Fills `candidates` with the cells whose rows of `A` may have an entry in column `i`,
    /// ascending, each once. These are the cells of its element, and the nearest cells beyond its
    /// two faces.
    fn drawing_on(&self, candidates: &mut Vec<usize>, i: usize) {
        candidates.clear();
        let n = self.space.dimension();
        let cell = self.space.cell(i);
        for a in 0..n {
            let (x, v) = (&self.space.x[a], &self.space.v[a]);
            let count = x.nodes.count() as i64;
            let first = x.element_of(cell[a] as i64) * count;
            let near = (first - 1..=first + count).filter_map(|i| self.space.wrap(a, i));
            for (place, velocity) in near.flat_map(|p| (0..v.cells).map(move |j| (p, j))) {
                let mut other = cell;
                (other[a], other[n + a]) = (place, velocity);
                candidates.push(self.space.index(&other));
            }
        }
        candidates.sort_unstable();
        candidates.dedup();
    }
}

/// The data from which `d` and `‖H‖_max` follow, for any wavenumbers.
#[derive(Clone, Debug, PartialEq)]
pub struct LargestEntries {
    /// The `(|S_ij|, |K_ij|)` that no other exceeds in both, `|S|` descending.
    pairs: Vec<[f64; 2]>,
    /// Nonzeros of the fullest row.
    pub nonzeros: usize,
    /// How the entries were extrapolated; `None` where they are of this grid.
    pub extrapolated: Option<&'static str>,
}

impl LargestEntries {
    /// The entries of a matrix: the largest of `pairs`, each `(|S_ij|, |K_ij|)`, with `nonzeros`
    /// nonzeros in its fullest row.
    pub fn new(mut pairs: Vec<[f64; 2]>, nonzeros: usize) -> Self {
        keep_outermost(&mut pairs);
        Self { pairs, nonzeros, extrapolated: None }
    }

    /// The largest entries of `matrix`, over the ranks of `space`. Collective.
    pub fn of(matrix: &BlockMatrix, space: &Group) -> Self {
        /// Number of further entries that are collected before dominated ones are removed.
        const AT_ONCE: usize = 4096;
        let (mut own, mut most) = (Vec::new(), AT_ONCE);
        for i in 0..matrix.counted_rows() {
            own.extend(matrix.row(i).map(|(_, s, k)| [s.abs(), k.abs()]));
            if own.len() > most {
                keep_outermost(&mut own);
                most = own.len() + AT_ONCE;
            }
        }
        keep_outermost(&mut own);
        // Each rank writes its own entries; zeros dominate no entry.
        let room = space.max_count(own.len());
        let mut all = vec![[0.0; 2]; room * space.size()];
        all[room * space.rank()..][..own.len()].copy_from_slice(&own);
        space.max_into(all.as_flattened_mut());
        Self::new(all, fullest_row(matrix, space))
    }

    /// The entries of a grid whose entries are `factor` times as large, with `nonzeros` nonzeros in
    /// the fullest row. `how` says how this was extrapolated.
    pub fn scaled(&self, factor: f64, nonzeros: usize, how: &'static str) -> Self {
        let pairs = self.pairs.iter().map(|pair| pair.map(|x| factor * x)).collect();
        Self { pairs, nonzeros, extrapolated: Some(how) }
    }

    /// `‖H‖_max` for wavenumbers up to `highest`.
    pub fn largest(&self, highest: f64) -> f64 {
        self.pairs.iter().fold(0.0, |m: f64, [s, k]| m.max((highest * s).hypot(*k)))
    }
}

/// Leaves out pairs that another pair exceeds in both numbers.
fn keep_outermost(pairs: &mut Vec<[f64; 2]>) {
    pairs.sort_by(|a, b| b[0].total_cmp(&a[0]).then(b[1].total_cmp(&a[1])));
    let mut most = f64::NEG_INFINITY;
    pairs.retain(|&[_, k]| {
        let further = k > most;
        most = most.max(k);
        further
    });
}

/// The numbers of sparse access to `H` that determine its cost.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct AccessBounds {
    /// `‖H‖_max`.
    pub largest: f64,
    /// `d`: nonzeros of the fullest row.
    pub sparsity: usize,
}

impl AccessBounds {
    /// The bounds of this rank's rows, for wavenumbers up to `highest`.
    pub fn of(matrix: &BlockMatrix, highest: f64) -> Self {
        let (mut largest, mut sparsity) = (0.0f64, 0);
        for i in 0..matrix.counted_rows() {
            let modulus = matrix.row(i).map(|(_, s, k)| (highest * s).hypot(k));
            largest = modulus.fold(largest, f64::max);
            sparsity = sparsity.max(nonzeros(matrix, i));
        }
        Self { largest, sparsity }
    }
}

/// Nonzeros of the fullest row over the ranks of `space`. The row of a common auxiliary unknown is
/// that of all ranks together. Collective.
fn fullest_row(matrix: &BlockMatrix, space: &Group) -> usize {
    let common = matrix.shared_row();
    let own = 0..common.unwrap_or(matrix.rows());
    let fullest = space.max_count(own.map(|i| nonzeros(matrix, i)).max().unwrap_or(0));
    common.map_or(fullest, |row| fullest.max(space.sum_count(nonzeros(matrix, row))))
}

fn nonzeros(matrix: &BlockMatrix, row: usize) -> usize {
    matrix.row(row).filter(|&(_, s, k)| s != 0.0 || k != 0.0).count()
}
