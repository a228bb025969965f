//! Divides modes into batches, and batches among mode groups, so that the largest work of a group
//! is as small as possible.
//!
//! If the lanes of a batch are independent, batches are cut from the modes in the order of falling
//! work, each with `B` modes but the last. No other division has a cheaper `b`-th costliest batch:
//! the `b − 1` costlier ones hold at most `(b − 1) B` modes, so the `b`-th costs at least as much
//! as mode `(b − 1) B + 1` of that order. Then whole batches are assigned to groups.

use crate::matrix::lanes::LANES;
use crate::propagate::method::BatchCoupling;
use serde::Serialize;
use std::cmp::Reverse;
use std::collections::BTreeSet;

/// Largest number of pieces that are assigned by search.
const SEARCHED: usize = 24;
/// Largest number of steps of a search.
const MOST_STEPS: usize = 100_000;

/// Modes that are propagated together.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct Batch {
    /// The modes, at most [`LANES`].
    pub modes: Vec<usize>,
    /// Modelled cost in applications (or solves) of one mode, idle lanes included.
    pub cost: usize,
}

impl Batch {
    /// The mode of a lane; the last one also fills the lanes after it.
    pub fn mode(&self, lane: usize) -> usize {
        self.modes[lane.min(self.modes.len() - 1)]
    }
}

/// Modelled cost of a group.
pub fn cost(group: &[Batch]) -> usize {
    group.iter().map(|b| b.cost).sum()
}

/// Modelled applications to whole batches of a group.
pub fn applications(group: &[Batch]) -> usize {
    cost(group) / LANES
}

/// The batches of each of `groups` mode groups, longest first, for modes that take `work`. Modes
/// that are `finished` are left out; coupled modes of a batch finish together.
pub fn share_out(
    work: &[usize],
    finished: &BTreeSet<usize>,
    coupling: BatchCoupling,
    groups: usize,
) -> Vec<Vec<Batch>> {
    let mut falling: Vec<usize> = (0..work.len()).filter(|l| !finished.contains(l)).collect();
    falling.sort_by_key(|&l| (Reverse(work[l]), l));
    let neighbours: Vec<usize> = (0..work.len()).collect();
    // Pieces of work that stay together.
    let pieces: Vec<&[usize]> = match coupling {
        BatchCoupling::Independent => falling.chunks(LANES).collect(),
        // From the highest mode down, so that the batch that is not full is the cheapest.
        BatchCoupling::Coupled => {
            (neighbours.rchunks(LANES)).filter(|piece| !finished.contains(&piece[0])).collect()
        }
        BatchCoupling::Sequential => falling.chunks(1).collect(),
    };
    let batch = |modes: &[usize]| Batch {
        modes: modes.to_vec(),
        cost: coupling.cost(modes.iter().map(|&l| work[l])),
    };
    let costs: Vec<usize> = pieces.iter().map(|piece| batch(piece).cost).collect();
    let mut shares: Vec<Vec<Batch>> = vec![Vec::new(); groups];
    for (piece, group) in pieces.iter().zip(assign_groups(&costs, groups)) {
        let share = &mut shares[group];
        match share.last_mut() {
            Some(last) if coupling == BatchCoupling::Sequential && last.modes.len() < LANES => {
                last.modes.extend_from_slice(piece);
                *last = batch(&last.modes);
            }
            _ => share.push(batch(piece)),
        }
    }
    shares.iter_mut().for_each(|share| share.sort_by_key(|b| Reverse(b.cost)));
    shares
}

/// The group of each piece. The longest pieces come first, each to the group with least to do. For
/// few pieces a search improves this to the best assignment.
fn assign_groups(costs: &[usize], groups: usize) -> Vec<usize> {
    let mut order: Vec<usize> = (0..costs.len()).collect();
    order.sort_by_key(|&k| (Reverse(costs[k]), k));
    let sorted: Vec<usize> = order.iter().map(|&k| costs[k]).collect();
    let mut loads = vec![0; groups];
    let choice: Vec<usize> = (sorted.iter())
        .map(|cost| {
            let lightest = (0..groups).min_by_key(|&g| (loads[g], g)).unwrap_or(0);
            loads[lightest] += cost;
            lightest
        })
        .collect();
    let mut search = LoadSearch {
        costs: &sorted,
        least: sorted.iter().sum::<usize>().div_ceil(groups),
        most: loads.iter().copied().max().unwrap_or(0),
        best: choice,
        steps: MOST_STEPS,
    };
    if sorted.len() <= SEARCHED {
        search.assign(&mut Vec::new(), &mut vec![0; groups]);
    }
    let mut dealt = vec![0; costs.len()];
    order.iter().zip(search.best).for_each(|(&k, group)| dealt[k] = group);
    dealt
}

/// The search for the assignment with the smallest largest load, piece by piece.
struct LoadSearch<'a> {
    /// Costs of the pieces, falling.
    costs: &'a [usize],
    /// A lower bound on the largest load.
    least: usize,
    /// Largest load of the best assignment so far.
    most: usize,
    /// The best assignment so far: the group of each piece.
    best: Vec<usize>,
    /// Steps left.
    steps: usize,
}

impl LoadSearch<'_> {
    fn assign(&mut self, choice: &mut Vec<usize>, loads: &mut [usize]) {
        let Some(cost) = self.costs.get(choice.len()) else {
            // All pieces are assigned, with a smaller largest load than before.
            self.most = loads.iter().copied().max().unwrap_or(0);
            self.best.clone_from(choice);
            return;
        };
        for g in 0..loads.len() {
            // Groups with equal loads are equivalent.
            let seen = loads[..g].contains(&loads[g]);
            if seen || loads[g] + cost >= self.most || self.most <= self.least || self.steps == 0 {
                continue;
            }
            self.steps -= 1;
            loads[g] += cost;
            choice.push(g);
            self.assign(choice, loads);
            choice.pop();
            loads[g] -= cost;
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    /// Degrees like those of Chebyshev series for the modes of a designed profile.
    fn degrees(modes: usize) -> Vec<usize> {
        (0..modes).map(|l| 85 + 85 * l / modes).collect()
    }

    fn imbalance(shares: &[Vec<Batch>]) -> f64 {
        let most = shares.iter().map(|s| cost(s)).max().unwrap_or(0);
        let sum: usize = shares.iter().map(|s| cost(s)).sum();
        (most * shares.len()) as f64 / sum as f64
    }

    #[test]
    fn groups_are_as_even_as_whole_batches_can_be() {
        // Modes, groups, largest imbalance. With fewer than two batches a group, or not a multiple
        // of their number, whole batches cannot be even: there the layout splits space.
        for (modes, groups, most) in [
            (13, 2, 1.20),
            (19, 2, 1.15),
            (19, 4, 1.71),
            (28, 2, 1.005),
            (28, 4, 1.28),
            (47, 2, 1.02),
            (47, 3, 1.005),
            (47, 4, 1.19),
            (60, 2, 1.005),
            (60, 4, 1.005),
            (84, 2, 1.005),
            (84, 4, 1.03),
            (90, 4, 1.01),
            (500, 4, 1.05),
        ] {
            let work = degrees(modes);
            let shares = share_out(&work, &BTreeSet::new(), BatchCoupling::Independent, groups);
            let found = imbalance(&shares);
            assert!(found <= most, "{modes} modes on {groups} groups: {found}");
            // Modes one by one are even wherever there are enough of them.
            let found =
                imbalance(&share_out(&work, &BTreeSet::new(), BatchCoupling::Sequential, groups));
            assert!(found <= 1.2, "{modes} modes on {groups} groups one by one: {found}");
        }
    }

    #[test]
    fn blocks_of_coupled_modes_are_the_same_for_any_groups() {
        let work = degrees(29);
        let blocks = |groups: usize| {
            let shares = share_out(&work, &BTreeSet::new(), BatchCoupling::Coupled, groups);
            let mut blocks: Vec<Vec<usize>> =
                shares.into_iter().flatten().map(|b| b.modes).collect();
            blocks.sort();
            blocks
        };
        for groups in 2..7 {
            assert_eq!(blocks(groups), blocks(1));
        }
        assert_eq!(blocks(1)[0], [0, 1, 2, 3, 4]);
    }

    /// The smallest largest load over all assignments of pieces to groups.
    fn least_by_force(costs: &[usize], groups: usize) -> usize {
        let ways = groups.pow(costs.len() as u32);
        let most = |way: usize| {
            let mut loads = vec![0; groups];
            let mut rest = way;
            for cost in costs {
                loads[rest % groups] += cost;
                rest /= groups;
            }
            loads.into_iter().max().unwrap_or(0)
        };
        (0..ways).map(most).min().unwrap_or(0)
    }

    proptest! {
        #[test]
        fn every_mode_is_somewhere_once(
            work in prop::collection::vec(1usize..500, 1..200),
            groups in 1usize..9,
            kind in 0usize..3,
        ) {
            let couplings =
                [BatchCoupling::Independent, BatchCoupling::Coupled, BatchCoupling::Sequential];
            let coupling = couplings[kind];
            let shares = share_out(&work, &BTreeSet::new(), coupling, groups);
            prop_assert_eq!(shares.len(), groups);
            let batches: Vec<&Batch> = shares.iter().flatten().collect();
            let mut modes: Vec<usize> = batches.iter().flat_map(|b| b.modes.clone()).collect();
            modes.sort_unstable();
            prop_assert_eq!(modes, (0..work.len()).collect::<Vec<_>>());
            prop_assert!(batches.iter().all(|b| (1..=LANES).contains(&b.modes.len())));
        }

        #[test]
        fn few_pieces_are_dealt_as_well_as_can_be(
            costs in prop::collection::vec(1usize..100, 1..9),
            groups in 1usize..4,
        ) {
            let dealt = assign_groups(&costs, groups);
            let load = |g: usize| -> usize {
                costs.iter().zip(&dealt).filter(|(_, d)| **d == g).map(|(c, _)| c).sum()
            };
            let most = (0..groups).map(load).max().unwrap_or(0);
            prop_assert_eq!(most, least_by_force(&costs, groups));
        }
    }
}
