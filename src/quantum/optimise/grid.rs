//! The cheapest of many candidates, with as few of them priced as that takes.
//!
//! A candidate has a lower bound of its cost, which takes its plan and a few coefficients
//! ([`PlannedCandidate::least_possible`]). Candidates are priced in the order of their bounds, up
//! to the first bound that is above the cost that is sought: what is cheapest is known for certain,
//! and so are all of its numbers.

use crate::quantum::optimise::candidate::{CostedChoice, ProfileCandidate, System};
use crate::quantum::optimise::pricing::{PlannedCandidate, choice};

/// Candidates, with costs of those whose cost was asked for.
pub(super) struct PricedGrid<'a> {
    system: &'a System<'a>,
    candidates: Vec<CandidateCost>,
    /// Whether `S = 0`.
    one_mode: bool,
}

/// A candidate and what is known of its cost.
struct CandidateCost {
    candidate: ProfileCandidate,
    /// A lower bound of the cost.
    bound: f64,
    /// The cost, once it is known.
    cost: Option<f64>,
    /// The choice with all of its numbers, on the rank that priced it.
    choice: Option<CostedChoice>,
}

impl<'a> PricedGrid<'a> {
    /// The candidates with their bounds, of which every rank computes a share. Collective.
    pub fn new(system: &'a System<'a>, candidates: Vec<ProfileCandidate>) -> Self {
        let (rank, ranks) = rank_of(system);
        let mut bounds = vec![f64::NEG_INFINITY; candidates.len()];
        for (k, bound) in bounds.iter_mut().enumerate().skip(rank).step_by(ranks) {
            *bound = match PlannedCandidate::of(system, &candidates[k]) {
                Ok(planned) => planned.least_possible(system),
                Err(_) => f64::INFINITY,
            };
        }
        largest_of_ranks(system, &mut bounds);
        let all = candidates.into_iter().zip(bounds);
        let priced =
            |(candidate, bound)| CandidateCost { candidate, bound, cost: None, choice: None };
        let one_mode = system.bounds.is_skew();
        Self { system, candidates: all.map(priced).collect(), one_mode }
    }

    /// The cheapest candidates of up to `most` values of the parameter, the cheapest first, of
    /// those that cost `limit` at most. Collective.
    pub fn cheapest(&mut self, most: usize, limit: f64) -> Vec<CostedChoice> {
        /// Costs within this relative distance of each other count as equal. Bounds are below the
        /// costs by less.
        const TIE: f64 = 1e-8;
        let (_, ranks) = rank_of(self.system);
        let mut order: Vec<usize> = (0..self.candidates.len()).collect();
        order.sort_by(|&a, &b| self.candidates[a].bound.total_cmp(&self.candidates[b].bound));
        order.retain(|&k| self.candidates[k].cost.is_none());
        for due in order.chunks(ranks) {
            let known = self.of_values(most);
            let sought = if known.len() < most {
                limit
            } else {
                known.last().map_or(limit, |&k| self.cost(k).min(limit))
            };
            // Where one mode is the field, profiles are compared with it only: of those that cost
            // the same, of which there are many, the first will do.
            let least = if self.one_mode { (1.0 - TIE) * sought } else { sought };
            if self.candidates[due[0]].bound > least {
                break;
            }
            self.price(due);
        }
        let mut found = self.of_values(most);
        found.retain(|&k| self.cost(k) <= limit);
        found.into_iter().map(|k| self.choice(k)).collect()
    }

    /// The cheapest of the priced candidates, each of another value of the parameter.
    fn of_values(&self, most: usize) -> Vec<usize> {
        let priced = |k: &usize| self.candidates[*k].cost.is_some();
        let mut order: Vec<usize> = (0..self.candidates.len()).filter(priced).collect();
        order.sort_by(|&a, &b| self.cost(a).total_cmp(&self.cost(b)));
        let mut found: Vec<usize> = Vec::new();
        for k in order {
            let value = |k: usize| self.candidates[k].candidate.value;
            if found.len() < most && found.iter().all(|&other| value(other) != value(k)) {
                found.push(k);
            }
        }
        found
    }

    fn cost(&self, k: usize) -> f64 {
        self.candidates[k].cost.unwrap_or(f64::INFINITY)
    }

    /// Prices the candidates `due`, one a rank. Collective.
    fn price(&mut self, due: &[usize]) {
        let (rank, _) = rank_of(self.system);
        let mut costs = vec![f64::NEG_INFINITY; due.len()];
        if let Some(&k) = due.get(rank) {
            let choice = choice(self.system, &self.candidates[k].candidate);
            costs[rank] = choice.least_cost();
            self.candidates[k].choice = Some(choice);
        }
        largest_of_ranks(self.system, &mut costs);
        due.iter().zip(costs).for_each(|(&k, cost)| self.candidates[k].cost = Some(cost));
    }

    fn choice(&self, k: usize) -> CostedChoice {
        let CandidateCost { candidate, choice: known, .. } = &self.candidates[k];
        known.clone().unwrap_or_else(|| choice(self.system, candidate))
    }
}

fn rank_of(system: &System<'_>) -> (usize, usize) {
    system.world.map_or((0, 1), |world| (world.rank(), world.size()))
}

fn largest_of_ranks(system: &System<'_>, values: &mut [f64]) {
    if let Some(world) = system.world {
        world.max_into(values);
    }
}
