//! From a few coarse grids to the coarsest one whose density is as exact as asked for.

use crate::base::error::Result;
use crate::study::advise::order::{Order, Range};
use crate::study::advise::scheme::Scheme;
use crate::study::advise::trials::{Trials, cells};
use crate::study::grids::Grids;
use serde::Serialize;

/// Part of the accuracy for the discretisation; the rest is for Schrödingerization.
pub const DISCRETISATION: f64 = 0.9;
/// Most grids, each twice as fine as the one before.
const MOST_LEVELS: usize = 12;
/// Most grids tried between two of them.
const MOST_CANDIDATES: usize = 4;
/// Space is made at most so many times finer or coarser against velocities than in the case.
const MOST_STRETCH: f64 = 4.0;
/// So many grids are tried where they are cheap, needed or not: the order follows from them.
const ENOUGH_LEVELS: usize = 5;
/// What is cheap, as a part of what the scheme has.
const CHEAP: f64 = 0.02;
/// Part of the budget for the grids that orders are found on; the rest is for grids that follow.
const FOR_LEVELS: f64 = 0.6;
/// Parts of the elements along the axes of space, or of velocity, that are tried instead of all.
const FEWER: [f64; 2] = [0.5, 0.75];
/// Part of the budget for balancing space against velocities on a coarse grid.
const FOR_BALANCE: f64 = 0.3;

/// A grid and the error of the density on it.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct Level {
    /// Elements along each axis.
    pub shape: Vec<usize>,
    /// Relative L1 error of the density.
    pub error: f64,
}

/// How the error on the grid that is advised is known.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize)]
#[serde(rename_all = "kebab-case")]
pub enum Known {
    /// By comparison with the exact solution.
    Measured,
    /// By comparison with a grid twice as fine, and the order.
    Estimated,
    /// From coarser grids and the order.
    Extrapolated,
}

/// The coarsest grid on which a scheme reaches the accuracy.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct Reach {
    /// Cells along each axis.
    pub shape: Vec<usize>,
    /// Relative L1 error of the density on it.
    pub error: f64,
    /// How that is known.
    pub known: Known,
    /// What the grids show.
    pub order: Order,
    /// The grids that show it.
    pub levels: Vec<Level>,
    /// Part of the discretisation in space in the error, the rest being that in velocity: by the
    /// changes that grids make which are twice as fine along these axes alone. None where the
    /// budget does not hold these grids, or nothing changes.
    pub part_of_space: Option<f64>,
}

impl Reach {
    /// The error on another grid by the order, each part by the cells of its own axes; none without
    /// a grid that was tried.
    pub fn extrapolated(&self, shape: &[usize]) -> Option<KnownError> {
        let level = self.levels.last()?;
        // Where the grid itself was tried its parts are known.
        let (tried, error) = match self.known {
            Known::Extrapolated => (&level.shape, level.error),
            _ => (&self.shape, self.error),
        };
        let [space, velocity] = self.parts(tried, shape, self.part_of_space.unwrap_or(0.5));
        let ratio = space + velocity;
        Some(KnownError { error: error * ratio, known: Known::Extrapolated })
    }

    /// The part of space in the error on another grid, by the order.
    pub fn part_of_space_on(&self, shape: &[usize]) -> Option<f64> {
        let [space, velocity] = self.parts(&self.shape, shape, self.part_of_space?);
        Some(space / (space + velocity))
    }

    /// What space and velocity add to the error on the grid `to`, beside that on the grid `from`,
    /// where space has the given part of it: each falls with the cells of its own axes.
    fn parts(&self, from: &[usize], to: &[usize], part_of_space: f64) -> [f64; 2] {
        let n = to.len() / 2;
        let finer = |axes: std::ops::Range<usize>| {
            let ratio = |k: usize| to[k] as f64 / from[k] as f64;
            let product: f64 = axes.map(ratio).product();
            product.powf(-self.order.counted_on / n as f64)
        };
        [part_of_space * finer(0..n), (1.0 - part_of_space) * finer(n..2 * n)]
    }
}

/// An error, and how it is known.
#[derive(Clone, Copy, Debug)]
pub struct KnownError {
    /// Relative L1 error of the density.
    pub error: f64,
    /// How it is known.
    pub known: Known,
}

/// What is looked for.
#[derive(Clone, Copy)]
pub struct Goal<'a> {
    /// The scheme.
    pub scheme: Scheme,
    /// The coarse grid to begin with.
    pub start: &'a [usize],
    /// The case's own grid.
    pub own: &'a [usize],
    /// The accuracy of the density.
    pub accuracy: f64,
    /// Part of the budget that may be used.
    pub share: f64,
}

/// Errors from grid to grid: against the exact solution, or by Richardson's extrapolation.
struct Ladder {
    shapes: Vec<Vec<usize>>,
    /// Against the exact solution, of each; or each but the last from the next.
    found: Vec<f64>,
    exact: bool,
    /// Orders that the scheme may have.
    orders: Range,
}

impl Ladder {
    fn order(&self) -> Order {
        Order::of(&self.found, self.orders)
    }

    fn levels(&self) -> Vec<Level> {
        let order = self.order();
        let error = |&e: &f64| if self.exact { e } else { order.error(e) };
        let errors = self.found.iter().map(error);
        (self.shapes.iter().zip(errors))
            .map(|(shape, error)| Level { shape: shape.clone(), error })
            .collect()
    }
}

/// The coarsest grid on which the density by the goal's scheme is as exact as wanted. Collective.
///
/// # Errors
/// As [`Trials::run`].
pub fn reach(trials: &mut Trials<'_>, goal: Goal<'_>) -> Result<Reach> {
    let used = trials.budget.used().min(goal.share);
    Search { trials, goal, used, wanted: DISCRETISATION * goal.accuracy }.reach()
}

/// The grid of a scheme that differs by its flux from that of `known`, near the grid found there.
/// Its order and its levels are those found there. None where the budget does not hold what tells
/// that it reaches the accuracy. Collective.
///
/// # Errors
/// As [`Trials::run`].
pub fn near(trials: &mut Trials<'_>, goal: Goal<'_>, known: &Reach) -> Result<Option<Reach>> {
    let used = trials.budget.used().min(goal.share);
    Search { trials, goal, used, wanted: DISCRETISATION * goal.accuracy }.near(known)
}

/// The error of `scheme` on `shape`, where this part of the budget allows to find out; without an
/// exact solution from a grid twice as fine. Collective.
///
/// # Errors
/// As [`Trials::run`].
pub fn look(
    trials: &mut Trials<'_>,
    scheme: Scheme,
    shape: &[usize],
    order: &Order,
    share: f64,
) -> Result<Option<KnownError>> {
    if !trials.may(scheme, shape, share)? {
        return Ok(None);
    }
    if let Some(error) = trials.error(scheme, shape)? {
        return Ok(Some(KnownError { error, known: Known::Measured }));
    }
    let twice = trials.scene(scheme).grids.twice(shape);
    if !trials.may(scheme, &twice, share)? {
        return Ok(None);
    }
    let error = order.error(trials.distance(scheme, shape, &twice)?);
    Ok(Some(KnownError { error, known: Known::Estimated }))
}

/// How many times finer space should be against velocities where its part of the error is `part`.
///
/// With an error `E_x h_x^q + E_v h_v^q` and a cost `h_x^{−(n+1)} h_v^{−n}`, the least cost has
/// `E_x h_x^q : E_v h_v^q = n + 1 : n`. A power of two; `q = k + 1` is assumed of degree `k`, and
/// the ratio is rounded towards 1, as parts on coarse grids are not those on fine ones.
fn stretch(part: f64, dimension: usize, degree: usize) -> f64 {
    let n = dimension as f64;
    let ratio = part / (1.0 - part).max(1e-6) * n / (n + 1.0);
    let powers = (ratio.max(1e-6).log2() / (degree + 1) as f64).trunc();
    powers.exp2().clamp(1.0 / MOST_STRETCH, MOST_STRETCH)
}

/// The search for the coarsest grid.
struct Search<'t, 'a> {
    trials: &'t mut Trials<'a>,
    goal: Goal<'t>,
    /// Part of the budget that was used before.
    used: f64,
    /// Error of the discretisation.
    wanted: f64,
}

impl Search<'_, '_> {
    fn reach(mut self) -> Result<Reach> {
        let Goal { scheme, start, share, .. } = self.goal;
        let second = self.grids().twice(start);
        let part = self.part_of_space(&second, self.share(FOR_BALANCE))?;
        let first = match part {
            Some(part) => {
                let ratio = stretch(part, self.grids().dimension(), scheme.degree);
                self.grids().stretched(start, ratio)
            }
            None => start.to_vec(),
        };
        let ladder = self.climb(first)?;
        let mut result = Reach {
            shape: ladder.shapes[0].clone(),
            error: f64::NAN,
            known: Known::Extrapolated,
            order: ladder.order(),
            levels: ladder.levels(),
            part_of_space: part,
        };
        let Some(finest) = result.levels.last().cloned() else {
            // One grid and nothing to compare it with.
            return Ok(result);
        };
        (result.shape, result.error) = (finest.shape.clone(), finest.error);
        let wanted = self.wanted;
        let pair = (result.levels.windows(2))
            .rfind(|pair| pair[0].error > wanted && pair[1].error <= wanted)
            .map(|pair| [pair[0].clone(), pair[1].clone()]);
        if pair.is_none() && finest.error > wanted && !result.order.falls() {
            // No finer grid reaches it.
            return self.or_own_grid(result);
        }
        result.known = if ladder.exact { Known::Measured } else { Known::Estimated };
        if let Some(pair) = pair {
            self.between(&pair, &mut result)?;
        } else if finest.error > wanted {
            self.beyond(&finest, &mut result)?;
        } else if let Some(coarsest) = result.levels.iter().find(|level| level.error <= wanted) {
            // No grid is too coarse.
            (result.shape, result.error) = (coarsest.shape.clone(), coarsest.error);
        }
        result = self.or_own_grid(result)?;
        self.trim(&mut result)?;
        if let Some(part) = self.part_of_space(&result.shape, share)? {
            result.part_of_space = Some(part);
        }
        Ok(result)
    }

    fn near(mut self, known: &Reach) -> Result<Option<Reach>> {
        let Some(found) = self.look(&known.shape, &known.order)? else {
            return Ok(None);
        };
        let mut result = Reach { error: found.error, known: found.known, ..known.clone() };
        if found.error > self.wanted {
            self.beyond(&Level { shape: known.shape.clone(), error: found.error }, &mut result)?;
        }
        self.trim(&mut result)?;
        let reaches = result.known != Known::Extrapolated && result.error <= self.wanted;
        Ok(reaches.then_some(result))
    }

    /// The part of the budget at which this part of what the scheme has is used.
    fn share(&self, part: f64) -> f64 {
        self.used + part * (self.goal.share - self.used)
    }

    fn grids(&self) -> &Grids {
        &self.trials.scene(self.goal.scheme).grids
    }

    fn distance(&mut self, coarse: &[usize], fine: &[usize]) -> Result<f64> {
        self.trials.distance(self.goal.scheme, coarse, fine)
    }

    fn look(&mut self, shape: &[usize], order: &Order) -> Result<Option<KnownError>> {
        look(self.trials, self.goal.scheme, shape, order, self.goal.share)
    }

    /// Part of space in the changes that grids make which are twice as fine along space, and along
    /// velocities; none where the budget does not allow them. Collective.
    fn part_of_space(&mut self, shape: &[usize], share: f64) -> Result<Option<f64>> {
        let finer = [true, false].map(|of_space| self.grids().doubled(shape, of_space));
        for shape in &finer {
            if !self.trials.may(self.goal.scheme, shape, share)? {
                return Ok(None);
            }
        }
        let space = self.distance(shape, &finer[0])?;
        let both = space + self.distance(shape, &finer[1])?;
        Ok((both > 0.0).then(|| space / both))
    }

    /// Grids from `first` on: finer ones until one reaches the wanted error, coarser ones while
    /// they reach it too. Collective.
    fn climb(&mut self, first: Vec<usize>) -> Result<Ladder> {
        let scheme = self.goal.scheme;
        let share = self.share(FOR_LEVELS);
        let cheap = CHEAP * (share - self.used);
        let (exact, orders) = (self.trials.has_exact(), scheme.orders());
        let mut ladder = Ladder { shapes: vec![first.clone()], found: Vec::new(), exact, orders };
        ladder.found.extend(self.trials.error(scheme, &first)?);
        while ladder.shapes.len() < MOST_LEVELS {
            let reached = ladder.levels().last().is_some_and(|level| level.error <= self.wanted);
            let last = ladder.shapes[ladder.shapes.len() - 1].clone();
            let next = self.grids().twice(&last);
            if next == last {
                // Nothing varies along any axis.
                if !exact {
                    ladder.found.push(0.0);
                }
                break;
            }
            let enough = ladder.found.len() >= ENOUGH_LEVELS;
            // Whether orders are settled takes two.
            let more = ladder.found.len() < 3 || self.trials.is_cheap(scheme, &next, cheap)?;
            if (reached && (enough || !more)) || !self.trials.may(scheme, &next, share)? {
                break;
            }
            match exact {
                true => ladder.found.extend(self.trials.error(scheme, &next)?),
                false => ladder.found.push(self.distance(&last, &next)?),
            }
            ladder.shapes.push(next);
        }
        while ladder.shapes.len() < MOST_LEVELS
            && ladder.levels().first().is_some_and(|level| level.error <= self.wanted)
            && let Some(half) = self.grids().halved(&ladder.shapes[0])
        {
            let found = match self.trials.error(scheme, &half)? {
                Some(error) => error,
                None => self.distance(&half, &ladder.shapes[0])?,
            };
            ladder.shapes.insert(0, half);
            ladder.found.insert(0, found);
        }
        Ok(ladder)
    }

    /// The coarsest grid that reaches the wanted error between a coarse one that does not and a
    /// fine one that does, by the order that these two show. Collective.
    fn between(&mut self, [coarse, fine]: &[Level; 2], result: &mut Reach) -> Result<()> {
        let wanted = self.wanted;
        // All finer grids reach it too, not one by chance.
        (result.shape, result.error) = (fine.shape.clone(), fine.error);
        let slope = (coarse.error / fine.error).log2();
        let mut scale = (coarse.error / wanted).log2() / slope;
        for _ in 0..MOST_CANDIDATES {
            let shape = self.grids().scaled(&coarse.shape, scale.exp2());
            if cells(&shape) >= cells(&fine.shape) {
                break;
            }
            let Some(found) = self.look(&shape, &result.order)? else {
                break;
            };
            if found.error <= wanted {
                (result.shape, result.error, result.known) = (shape, found.error, found.known);
                break;
            }
            scale += ((found.error / wanted).log2() / slope).max(0.05);
        }
        Ok(())
    }

    /// A grid beyond the `finest` one tried that reaches the wanted error: as the order predicts,
    /// and tried where the budget allows. Collective.
    fn beyond(&mut self, finest: &Level, result: &mut Reach) -> Result<()> {
        let mut scale = result.order.refinement(finest.error, self.wanted);
        for _ in 0..MOST_CANDIDATES {
            result.shape = self.grids().scaled(&finest.shape, scale);
            (result.error, result.known) = (self.wanted, Known::Extrapolated);
            let Some(found) = self.look(&result.shape, &result.order)? else {
                break;
            };
            (result.error, result.known) = (found.error, found.known);
            if found.error <= self.wanted {
                break;
            }
            scale *= result.order.refinement(found.error, self.wanted).max(1.05);
        }
        Ok(())
    }

    /// Fewer elements along the velocities alone, and along space alone, as long as the wanted
    /// error is reached: what balances both on a coarse grid need not on a fine one. Collective.
    fn trim(&mut self, result: &mut Reach) -> Result<()> {
        // What has the smaller part of the error first.
        let space_first = result.part_of_space.is_some_and(|part| part < 0.5);
        for part in FEWER {
            for of_space in [space_first, !space_first] {
                while result.known != Known::Extrapolated && result.error <= self.wanted {
                    let shape = self.grids().fewer(&result.shape, of_space, part);
                    if cells(&shape) >= cells(&result.shape) {
                        break;
                    }
                    let Some(found) = self.look(&shape, &result.order)? else {
                        break;
                    };
                    if found.error > self.wanted {
                        break;
                    }
                    (result.shape, result.error, result.known) = (shape, found.error, found.known);
                }
            }
        }
        Ok(())
    }

    /// The case's own grid instead, where it was tried and reaches the wanted error, if it has
    /// fewer cells or nothing else reaches it. Collective.
    fn or_own_grid(&mut self, mut found: Reach) -> Result<Reach> {
        let Goal { scheme, own, .. } = self.goal;
        let better = found.error > self.wanted || cells(own) < cells(&found.shape);
        if better
            && self.trials.has_run(scheme, own)
            && let Some(error) = self.trials.error(scheme, own)?
            && error <= self.wanted
        {
            (found.shape, found.error, found.known) = (own.to_vec(), error, Known::Measured);
        }
        Ok(found)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn axes_are_balanced_in_part() {
        // Two thirds of the error belong to space in one dimension.
        assert_eq!(stretch(2.0 / 3.0, 1, 0), 1.0);
        assert_eq!(stretch(0.9, 1, 0), 4.0);
        assert_eq!(stretch(0.75, 2, 0), 2.0);
        assert_eq!(stretch(0.1, 1, 0), 1.0 / 4.0);
        assert_eq!(stretch(0.0, 3, 0), 1.0 / 4.0);
        assert_eq!(stretch(1.0, 1, 0), 4.0);
        // The parts of a high order change faster.
        assert_eq!(stretch(0.9, 1, 4), 1.0);
    }
}
