//! The exact moments of measure-valued data, computed by all ranks together.
//!
//! The boxes of a sheet are distributed over the ranks one by one, in rounds that bound the memory.
//! A rank sends every [`Deposit`] to the rank whose share holds the cell. That rank adds deposits
//! in the order of the boxes' numbers, as a single rank would, so that the bits are the same.
//!
//! In two cases every rank follows all boxes of a round, and keeps the deposits on its share. The
//! budget of particles may run out: a box may use what those before it left. Or a formula is not
//! finite: the error is that of the first box.

use crate::base::error::Result;
use crate::parallel::communicator::Group;
use crate::problem::case::Case;
use crate::problem::exact::sheet::sums::{Deposit, ExactMoments, Line, SheetSums};
use crate::problem::exact::sheet::{FollowedBoxes, InitialSheet, ParticleBudget, ROUND, Sheets};
use crate::problem::grid::{PhaseSpace, for_each_cell};
use std::ops::Range;

/// Number of words of a line in a message.
const LINE: usize = 7;

/// The exact moments of `case`, whose data are measure-valued, at its end time on the space cells
/// of `share`, one range an x-axis. The shares of all ranks are a partition of the space cells.
/// Collective.
///
/// # Errors
/// As [`Sheets::new`]; if `density` or `velocity` is not finite.
pub fn exact_moments(group: &Group, case: &Case, share: &[Range<usize>]) -> Result<ExactMoments> {
    let mut sheets = group.agree(Sheets::new(case))?;
    let owners = CellOwners::new(group, &case.space, share);
    let mut sums = SheetSums::new(&case.space, share);
    let mut budget = sheets.budget();
    for sheet in sheets.all() {
        let boxes = sheets.boxes(sheet);
        for first in (0..boxes).step_by(ROUND) {
            let round = BoxRound { group, case, sheet, boxes: first..boxes.min(first + ROUND) };
            let found = round.follow(&mut sheets, budget, &owners)?;
            found.deposits.iter().for_each(|deposit| sums.add(deposit));
            found.lines.iter().for_each(|line| sums.draw(line));
            budget = budget.less(found.added);
        }
    }
    let largest = group.max(sums.largest());
    Ok(sums.finish(largest))
}

/// The rank of each space cell.
struct CellOwners {
    rank: usize,
    /// The rank of each cell, row-major.
    rank_of_cell: Vec<u32>,
}

impl CellOwners {
    fn new(group: &Group, space: &PhaseSpace, share: &[Range<usize>]) -> Self {
        let ends: Vec<u64> = share.iter().flat_map(|r| [r.start as u64, r.end as u64]).collect();
        let all = group.exchanged(&vec![ends; group.size()]);
        let mut rank_of_cell = vec![0; space.space_cells()];
        for (rank, ends) in all.iter().enumerate() {
            let share: Vec<_> = ends.chunks(2).map(|e| e[0] as usize..e[1] as usize).collect();
            for_each_cell(&share, |i| {
                rank_of_cell[space.space_index(i)] = rank as u32;
            });
        }
        Self { rank: group.rank(), rank_of_cell }
    }

    fn mine(&self, deposit: &Deposit) -> bool {
        self.rank_of_cell[deposit.cell] as usize == self.rank
    }
}

/// First boxes of a sheet that the ranks follow together.
struct BoxRound<'a> {
    group: &'a Group,
    case: &'a Case,
    sheet: InitialSheet,
    boxes: Range<usize>,
}

impl BoxRound<'_> {
    /// The deposits of the boxes on this rank's share and all lines, in the order of the boxes, and
    /// the particles that all ranks added. Collective.
    fn follow(
        &self,
        sheets: &mut Sheets<'_>,
        budget: ParticleBudget,
        owners: &CellOwners,
    ) -> Result<FollowedBoxes> {
        let Self { group, case, sheet, ref boxes } = *self;
        if group.size() > 1 {
            let mine = boxes.clone().skip(group.rank()).step_by(group.size());
            let mine = sheets.follow_boxes(sheet, mine, budget).ok();
            let failed = group.sum_count(usize::from(mine.is_none()));
            let added = group.sum_count(mine.as_ref().map_or(0, |mine| mine.added));
            if let Some(mine) = mine.filter(|_| failed == 0 && budget.allows(&case.space, added)) {
                return Ok(FollowedBoxes { added, ..self.exchanged(mine, owners) });
            }
        }
        let mut found = group.agree(sheets.follow_boxes(sheet, boxes.clone(), budget))?;
        found.deposits.retain(|deposit| owners.mine(deposit));
        Ok(found)
    }

    /// Sends the boxes `found` by each rank, and returns them as [`follow`](Self::follow) does.
    /// Collective.
    fn exchanged(&self, found: FollowedBoxes, owners: &CellOwners) -> FollowedBoxes {
        let group = self.group;
        let n = self.case.space.dimension();
        let mut messages = vec![Vec::new(); group.size()];
        for deposit in &found.deposits {
            let message = &mut messages[owners.rank_of_cell[deposit.cell] as usize];
            message.extend([deposit.number as u64, deposit.cell as u64, deposit.mass.to_bits()]);
            message.extend(deposit.momentum[..n].iter().map(|p| p.to_bits()));
        }
        drop(found.deposits);
        let received = group.exchanged(&messages);
        let deposits = received.iter().flat_map(|words| words.chunks(3 + n).map(deposit_of));
        let mut deposits: Vec<Deposit> = deposits.collect();
        // The sort is stable: deposits of one box keep their order.
        deposits.sort_by_key(|deposit| deposit.number);
        let mut lines = Vec::new();
        if n == 1 {
            let message: Vec<u64> = found.lines.iter().flat_map(words_of).collect();
            let received = group.exchanged(&vec![message; group.size()]);
            lines.extend(received.iter().flat_map(|words| words.chunks(LINE).map(line_of)));
            lines.sort_by_key(|line: &Line| line.number);
        }
        FollowedBoxes { deposits, lines, added: found.added }
    }
}

fn deposit_of(words: &[u64]) -> Deposit {
    let number = |k: usize| words.get(k).map_or(0.0, |word| f64::from_bits(*word));
    let momentum = std::array::from_fn(|a| number(3 + a));
    Deposit { number: words[0] as usize, cell: words[1] as usize, mass: number(2), momentum }
}

fn words_of(line: &Line) -> [u64; LINE] {
    let [[x, v], [to_x, to_v]] = line.ends.map(|end| end.map(f64::to_bits));
    [line.number as u64, line.history, line.density.to_bits(), x, v, to_x, to_v]
}

fn line_of(words: &[u64]) -> Line {
    let number = |k: usize| f64::from_bits(words[k]);
    Line {
        number: words[0] as usize,
        history: words[1],
        density: number(2),
        ends: [[number(3), number(4)], [number(5), number(6)]],
    }
}
