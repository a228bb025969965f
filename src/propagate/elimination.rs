//! The order in which the unknowns of a sparse matrix of symmetric pattern are eliminated, and the
//! sizes of its factors (multifrontal method: Duff, Reid, ACM Trans. Math. Softw. 9, 302, 1983).
//!
//! Successive unknowns with nearly the same rows form a front: its pivots, and the rows below in
//! which their elimination changes entries. What it subtracts there waits on a stack until the next
//! front of which these rows are pivots. Unknowns are in an order of approximate minimum degree.
//! Fronts before which others are eliminated take these so that the fewest entries wait (Liu, ACM
//! Trans. Math. Softw. 12, 249, 1986).
//!
//! All sizes follow from the pattern alone.

use crate::base::error::{Error, Result};
use crate::base::memory;
use crate::matrix::block_matrix::BlockMatrix;
use faer::Side;
use faer::sparse::SymbolicSparseColMatRef;
use faer::sparse::linalg::SupernodalThreshold;
use faer::sparse::linalg::cholesky::supernodal::SymbolicSupernodalCholesky;
use faer::sparse::linalg::cholesky::{
    CholeskySymbolicParams, SymbolicCholeskyRaw, SymmetricOrdering, factorize_symbolic_cholesky,
};
use num_complex::Complex64;
use std::ops::Range;

/// Unknowns that are eliminated together.
pub(super) struct Front {
    /// Places of its pivots in the order of elimination.
    pub pivots: Range<usize>,
    /// Its rows below, as a range of [`Elimination::rows`].
    pub below: Range<usize>,
    /// Number of fronts that contribute to it; they come last of those that wait.
    pub parts: usize,
}

impl Front {
    /// Entries of the factors: a column for each pivot, and the rest of its row.
    pub fn entries(&self) -> usize {
        self.pivots.len() * (self.pivots.len() + 2 * self.below.len())
    }

    /// Entries that wait.
    pub fn waiting(&self) -> usize {
        self.below.len() * self.below.len()
    }
}

fn failure(reason: &dyn std::fmt::Debug) -> Error {
    Error::Factors(format!("{reason:?}"))
}

/// A vector of `count` zeros, if memory suffices.
pub(super) fn zeros(count: usize) -> Result<Vec<Complex64>> {
    let mut list = Vec::new();
    list.try_reserve_exact(count).map_err(|e| failure(&e))?;
    list.resize(count, Complex64::ZERO);
    Ok(list)
}

/// The order of elimination of a matrix.
pub(super) struct Elimination {
    /// The unknown at each place of the order.
    pub unknowns: Vec<u32>,
    /// The place of each unknown.
    pub places: Vec<u32>,
    /// The fronts, in the order in which they are eliminated.
    pub fronts: Vec<Front>,
    /// Places of the rows below of all fronts, in order.
    pub rows: Vec<u32>,
}

impl Elimination {
    /// The order for the part of `matrix` on this rank's rows.
    ///
    /// # Errors
    /// [`Error::Factors`] where memory does not suffice. Not collective.
    pub fn new(matrix: &BlockMatrix) -> Result<Self> {
        let (mut offsets, mut rows) = (vec![0], Vec::new());
        for j in 0..matrix.rows() {
            // The pattern is symmetric; its upper part suffices.
            rows.extend(matrix.row(j).map(|e| e.0).filter(|&i| i < j));
            rows.push(j);
            // Rows are in the order of global columns, not of local ones.
            rows[offsets[j]..].sort_unstable();
            offsets.push(rows.len());
        }
        let found = Self::of_pattern(&offsets, &rows)?;
        drop((offsets, rows));
        memory::give_back();
        Ok(found)
    }

    /// The order for a symmetric pattern, of which the columns of the upper part are given.
    fn of_pattern(offsets: &[usize], rows: &[usize]) -> Result<Self> {
        let count = offsets.len() - 1;
        let pattern = SymbolicSparseColMatRef::new_checked(count, count, offsets, None, rows);
        let parameters = CholeskySymbolicParams {
            // Fronts even for a diagonal pattern, of which the ratio is 0.
            supernodal_flop_ratio_threshold: SupernodalThreshold(-1.0),
            ..Default::default()
        };
        let (side, by) = (Side::Upper, SymmetricOrdering::Amd);
        let analysed = factorize_symbolic_cholesky(pattern, side, by, parameters);
        let analysed = analysed.map_err(|e| failure(&e))?;
        let (SymbolicCholeskyRaw::Supernodal(found), Some(order)) =
            (analysed.raw(), analysed.perm())
        else {
            return Err(failure(&"no fronts are found"));
        };
        let narrow = |list: &[usize]| list.iter().map(|&i| i as u32).collect::<Vec<u32>>();
        let (unknowns, places) = order.arrays();
        let parts = parts_of_fronts(found);
        let mut fronts = Vec::with_capacity(parts.len());
        let mut rows = Vec::with_capacity(found.row_idx().len());
        for s in order_of_fronts(found, &parts) {
            let start = rows.len();
            rows.extend(found.supernode(s).pattern().iter().map(|&i| i as u32));
            fronts.push(Front {
                pivots: found.supernode_begin()[s]..found.supernode_end()[s],
                below: start..rows.len(),
                parts: parts[s].len(),
            });
        }
        Ok(Self { unknowns: narrow(unknowns), places: narrow(places), fronts, rows })
    }

    /// Number of unknowns.
    pub fn count(&self) -> usize {
        self.unknowns.len()
    }

    /// Entries of the factors.
    pub fn entries(&self) -> usize {
        self.fronts.iter().map(Front::entries).sum()
    }

    /// The most entries that wait, with those of the front that is being eliminated.
    pub fn most_waiting(&self) -> usize {
        let (mut waiting, mut all, mut most) = (Vec::new(), 0, 0);
        for front in &self.fronts {
            most = most.max(all + front.waiting());
            all -= waiting.drain(waiting.len() - front.parts..).sum::<usize>();
            waiting.push(front.waiting());
            all += front.waiting();
        }
        most
    }

    /// Most pivots of a front.
    pub fn most_pivots(&self) -> usize {
        self.fronts.iter().map(|front| front.pivots.len()).max().unwrap_or(0)
    }

    /// Bytes of the factors, of what waits and of this order.
    pub fn bytes(&self) -> u64 {
        let numbers = self.entries() + self.most_waiting() + self.count();
        // Order and its inverse, exchanges of pivots, and the rows of a front.
        let integers = 4 * self.count() + self.rows.len();
        let bytes = numbers * size_of::<Complex64>()
            + integers * size_of::<u32>()
            + self.fronts.len() * size_of::<Front>();
        bytes as u64
    }
}

/// The fronts that contribute to each front, in the order in which they are to be eliminated.
fn parts_of_fronts(found: &SymbolicSupernodalCholesky<usize>) -> Vec<Vec<usize>> {
    let count = found.n_supernodes();
    let mut parts = vec![Vec::new(); count];
    // The most entries that wait while a front and all before it are eliminated.
    let mut most = vec![0usize; count];
    let waiting = |s: usize| found.supernode(s).pattern().len().pow(2);
    for s in 0..count {
        // Those with the largest excess come first.
        parts[s].sort_by_key(|&part| std::cmp::Reverse(most[part] - waiting(part)));
        let mut before = 0;
        for &part in &parts[s] {
            most[s] = most[s].max(before + most[part]);
            before += waiting(part);
        }
        most[s] = most[s].max(before + waiting(s));
        if let Some(&first) = found.supernode(s).pattern().first() {
            let next = found.supernode_begin().partition_point(|&begin| begin <= first) - 1;
            parts[next].push(s);
        }
    }
    parts
}

/// All fronts, each after its `parts`, which follow each other.
fn order_of_fronts(
    found: &SymbolicSupernodalCholesky<usize>,
    parts: &[Vec<usize>],
) -> impl Iterator<Item = usize> + use<> {
    let is_last = |&s: &usize| found.supernode(s).pattern().is_empty();
    let mut left: Vec<usize> = (0..found.n_supernodes()).filter(is_last).collect();
    let mut order = Vec::with_capacity(found.n_supernodes());
    while let Some(s) = left.pop() {
        order.push(s);
        left.extend(&parts[s]);
    }
    order.into_iter().rev()
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::collections::BTreeSet;

    /// The upper part of the pattern of a grid of `width · height` unknowns.
    fn grid(width: usize, height: usize) -> (Vec<usize>, Vec<usize>) {
        let (mut offsets, mut rows) = (vec![0], Vec::new());
        for j in 0..width * height {
            rows.extend(j.checked_sub(width));
            rows.extend(j.checked_sub(1).filter(|_| !j.is_multiple_of(width)));
            rows.push(j);
            offsets.push(rows.len());
        }
        (offsets, rows)
    }

    /// For each place, the later places in whose rows its elimination changes entries.
    fn filled(order: &Elimination, offsets: &[usize], rows: &[usize]) -> Vec<BTreeSet<usize>> {
        let mut later = vec![BTreeSet::new(); order.count()];
        for j in 0..order.count() {
            for &i in &rows[offsets[j]..offsets[j + 1]] {
                let [a, b] = [i, j].map(|unknown| order.places[unknown] as usize);
                later[a.min(b)].extend((a != b).then_some(a.max(b)));
            }
        }
        for place in 0..later.len() {
            let of_place = later[place].clone();
            for &next in &of_place {
                later[next].extend(of_place.range(next + 1..));
            }
        }
        later
    }

    #[test]
    fn fronts_hold_what_is_filled() {
        let grids = [(1, 1), (1, 9), (7, 6), (12, 12), (3, 40)].map(|(x, y)| grid(x, y));
        let diagonal = ((0..=5).collect(), (0..5).collect());
        for (offsets, rows) in grids.into_iter().chain([diagonal]) {
            let order = Elimination::of_pattern(&offsets, &rows).expect("an order");
            let later = filled(&order, &offsets, &rows);
            let mut eliminated = BTreeSet::new();
            let mut waiting: Vec<Vec<usize>> = Vec::new();
            let mut most = 0;
            for front in &order.fronts {
                let below = order.rows[front.below.clone()].iter().map(|&i| i as usize);
                let held: BTreeSet<usize> = front.pivots.clone().chain(below.clone()).collect();
                for place in front.pivots.clone() {
                    assert!(eliminated.insert(place) && later[place].is_subset(&held));
                }
                let size =
                    |parts: &[Vec<usize>]| parts.iter().map(|p| p.len().pow(2)).sum::<usize>();
                most = most.max(size(&waiting) + front.waiting());
                for part in waiting.drain(waiting.len() - front.parts..) {
                    assert!(front.pivots.contains(&part[0]));
                    assert!(part.iter().all(|place| held.contains(place)));
                }
                waiting.push(below.collect());
            }
            assert_eq!(eliminated.len(), order.count());
            assert!(waiting.iter().all(Vec::is_empty));
            assert_eq!(order.most_waiting(), most);
            // Unknowns are eliminated together even if their rows differ, the most in chains.
            let least: usize = later.iter().map(|later| 1 + 2 * later.len()).sum();
            assert!((least..=4 * least).contains(&order.entries()), "{} {least}", order.entries());
        }
    }
}
