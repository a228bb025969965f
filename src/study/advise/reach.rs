//! From a few coarse grids to the coarsest one whose density is as exact as asked for.

use crate::base::error::Result;
use crate::study::advise::order::Order;
use crate::study::advise::trials::{Scheme, Trials};
use serde::Serialize;

/// Grids are looked for whose discretisation takes so much of the accuracy; a tenth is left for the rest.
pub const DISCRETISATION: f64 = 0.9;
/// Most grids, each twice as fine as the one before.
const MOST_LEVELS: usize = 12;
/// Most grids tried between two of them.
const MOST_CANDIDATES: usize = 4;
/// Space is made at most so many times finer or coarser against velocities than in the case.
const MOST_STRETCH: f64 = 4.0;
/// So many grids are tried where they are cheap, whether or not they are needed: they tell the order.
const ENOUGH_LEVELS: usize = 5;
/// What is cheap, as a part of what the scheme has.
const CHEAP: f64 = 0.02;
/// Part of the budget for the grids that orders are found on; the rest is for what follows from them.
const FOR_LEVELS: f64 = 0.6;

/// A grid and the error of the density on it.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct Level {
    /// Cells along each axis.
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
    /// How large a part of the error discretisation in space has beside that in velocity, by the change that a grid twice as fine
    /// along these axes alone makes.
    pub part_of_space: f64,
}

/// Errors from grid to grid: against the exact solution, or by Richardson's extrapolation.
struct Ladder {
    shapes: Vec<Vec<usize>>,
    /// Against the exact solution, of each; or each but the last from the next.
    found: Vec<f64>,
    exact: bool,
}

impl Ladder {
    fn order(&self) -> Order {
        Order::of(&self.found)
    }

    fn levels(&self) -> Vec<Level> {
        let order = self.order();
        let error = |&e: &f64| if self.exact { e } else { order.error(e) };
        let errors = self.found.iter().map(error);
        (self.shapes.iter().zip(errors))
            .map(|(shape, error)| Level { shape: shape.clone(), error })
            .collect()
    }

    /// The grids that the coarsest `scheme` grid `start` leads to: coarser while they reach `wanted` too, finer until one does.
    fn climb(
        trials: &mut Trials<'_>,
        scheme: Scheme,
        start: Vec<usize>,
        wanted: f64,
        share: f64,
    ) -> Result<Self> {
        let exact = trials.knows();
        let mut ladder = Self { shapes: vec![start.clone()], found: Vec::new(), exact };
        if let Some(error) = trials.error(scheme, &start)? {
            ladder.found.push(error);
        }
        while ladder.shapes.len() < MOST_LEVELS {
            let levels = ladder.levels();
            let there = levels.last().is_some_and(|level| level.error <= wanted);
            let last = &ladder.shapes[ladder.shapes.len() - 1];
            let next = trials.grids.twice(last);
            if next == *last {
                // Nothing varies along any axis.
                if !exact {
                    ladder.found.push(0.0);
                }
                break;
            }
            let enough = ladder.found.len() >= ENOUGH_LEVELS;
            // Two orders tell whether they are settled.
            let more = ladder.found.len() < 3 || trials.is_cheap(scheme, &next, CHEAP * share)?;
            if (there && (enough || !more)) || !trials.may(scheme, &next, share)? {
                break;
            }
            if exact {
                ladder.found.extend(trials.error(scheme, &next)?);
            } else {
                let distance = trials.distance(scheme, &last.clone(), &next)?;
                ladder.found.push(distance);
            }
            ladder.shapes.push(next);
        }
        while ladder.shapes.len() < MOST_LEVELS
            && ladder.levels().first().is_some_and(|level| level.error <= wanted)
            && let Some(half) = trials.grids.halved(&ladder.shapes[0])
        {
            let found = match trials.error(scheme, &half)? {
                Some(error) => error,
                None => trials.distance(scheme, &half, &ladder.shapes[0])?,
            };
            ladder.shapes.insert(0, half);
            ladder.found.insert(0, found);
        }
        Ok(ladder)
    }
}

/// The error of `scheme` on `shape`, where the budget allows to find out; without an exact solution from a grid twice as fine. Collective.
pub fn look(
    trials: &mut Trials<'_>,
    scheme: Scheme,
    shape: &[usize],
    order: &Order,
    share: f64,
) -> Result<Option<(f64, Known)>> {
    if !trials.may(scheme, shape, share)? {
        return Ok(None);
    }
    if let Some(error) = trials.error(scheme, shape)? {
        return Ok(Some((error, Known::Measured)));
    }
    let twice = trials.grids.twice(shape);
    if !trials.may(scheme, &twice, share)? {
        return Ok(None);
    }
    let distance = trials.distance(scheme, shape, &twice)?;
    Ok(Some((order.error(distance), Known::Estimated)))
}

/// Part of space in the change that a grid makes which is twice as fine along space, and along velocities. Collective.
fn part_of_space(trials: &mut Trials<'_>, scheme: Scheme, shape: &[usize]) -> Result<f64> {
    let [space, velocity] = [true, false].map(|of_space| trials.grids.doubled(shape, of_space));
    let space = trials.distance(scheme, shape, &space)?;
    let velocity = trials.distance(scheme, shape, &velocity)?;
    Ok(if space + velocity > 0.0 { space / (space + velocity) } else { 0.5 })
}

/// How many times finer space should be against velocities where its part of the error is `part`. With an error `E_x h_x^q + E_v h_v^q` and a
/// cost `h_x^{−(n+1)} h_v^{−n}`, the least cost has `E_x h_x^q : E_v h_v^q = n + 1 : n`. A power of two; the order is taken to be 1, and
/// less than the whole of it is made good, as parts on coarse grids are not those on fine ones.
fn stretch(part: f64, dimension: usize) -> f64 {
    let n = dimension as f64;
    let ratio = part / (1.0 - part).max(1e-6) * n / (n + 1.0);
    let powers = ratio.max(1e-6).log2().trunc();
    powers.exp2().clamp(1.0 / MOST_STRETCH, MOST_STRETCH)
}

/// The coarsest grid on which the density by `scheme` is within `accuracy`, beginning with the coarse grid `start`, or on the case's `own`; no more than the `share` of the
/// budget is spent. Collective.
///
/// # Errors
/// As [`crate::study::trial::trial`].
pub fn reach(
    trials: &mut Trials<'_>,
    scheme: Scheme,
    (start, own): (&[usize], &[usize]),
    accuracy: f64,
    share: f64,
) -> Result<Reach> {
    let wanted = DISCRETISATION * accuracy;
    let second = trials.grids.twice(start);
    let mut part = 0.5;
    let mut first = start.to_vec();
    let affordable = trials.may(scheme, &trials.grids.doubled(&second, true), 0.3 * share)?;
    if affordable && trials.may(scheme, &trials.grids.doubled(&second, false), 0.3 * share)? {
        part = part_of_space(trials, scheme, &second)?;
        first = (trials.grids).stretched(start, stretch(part, trials.grids.dimension()));
    }
    let ladder = Ladder::climb(trials, scheme, first, wanted, FOR_LEVELS * share)?;
    let (order, levels) = (ladder.order(), ladder.levels());
    let Some(finest) = levels.last().cloned() else {
        // One grid and nothing to compare it with.
        let shape = ladder.shapes[0].clone();
        return Ok(Reach {
            shape,
            error: f64::NAN,
            known: Known::Extrapolated,
            order,
            levels,
            part_of_space: part,
        });
    };
    let known = if ladder.exact { Known::Measured } else { Known::Estimated };
    let between =
        (levels.windows(2)).rfind(|pair| pair[0].error > wanted && pair[1].error <= wanted);
    let mut result = Reach {
        shape: finest.shape.clone(),
        error: finest.error,
        known,
        order,
        levels: levels.clone(),
        part_of_space: part,
    };
    if let Some([coarse, fine]) = between {
        // Between two grids, by the order that they show; all finer ones reach it too, not one by chance.
        (result.shape, result.error) = (fine.shape.clone(), fine.error);
        let slope = (coarse.error / fine.error).log2();
        let mut scale = (coarse.error / wanted).log2() / slope;
        for _ in 0..MOST_CANDIDATES {
            let shape = trials.grids.scaled(&coarse.shape, scale.exp2());
            if cells(&shape) >= cells(&fine.shape) {
                break;
            }
            let Some((error, known)) = look(trials, scheme, &shape, &result.order, share)? else {
                break;
            };
            if error <= wanted {
                (result.shape, result.error, result.known) = (shape, error, known);
                break;
            }
            scale += ((error / wanted).log2() / slope).max(0.05);
        }
    } else if finest.error > wanted {
        if !result.order.falls() {
            // No finer grid does.
            result.known = Known::Extrapolated;
            return as_it_stands(trials, scheme, own, wanted, result);
        }
        let mut scale = result.order.refinement(finest.error, wanted);
        result.known = Known::Extrapolated;
        for _ in 0..MOST_CANDIDATES {
            result.shape = trials.grids.scaled(&finest.shape, scale);
            result.error = wanted;
            let Some((error, known)) = look(trials, scheme, &result.shape, &result.order, share)?
            else {
                result.known = Known::Extrapolated;
                break;
            };
            (result.error, result.known) = (error, known);
            if error <= wanted {
                break;
            }
            scale *= result.order.refinement(error, wanted).max(1.05);
        }
    } else if let Some(coarsest) = levels.iter().find(|level| level.error <= wanted) {
        // No grid is too coarse.
        (result.shape, result.error) = (coarsest.shape.clone(), coarsest.error);
    }
    result = as_it_stands(trials, scheme, own, wanted, result)?;
    let affordable = trials.may(scheme, &trials.grids.doubled(&result.shape, true), share)?;
    if affordable && trials.may(scheme, &trials.grids.doubled(&result.shape, false), share)? {
        result.part_of_space = part_of_space(trials, scheme, &result.shape)?;
    }
    Ok(result)
}

/// The case's `own` grid instead, where it was measured there, and does with fewer cells or where nothing else does. Collective.
fn as_it_stands(
    trials: &mut Trials<'_>,
    scheme: Scheme,
    own: &[usize],
    wanted: f64,
    mut found: Reach,
) -> Result<Reach> {
    let better = found.error > wanted || cells(own) < cells(&found.shape);
    if better
        && trials.knows_run(scheme, own)
        && let Some(error) = trials.error(scheme, own)?
        && error <= wanted
    {
        (found.shape, found.error, found.known) = (own.to_vec(), error, Known::Measured);
    }
    Ok(found)
}

fn cells(shape: &[usize]) -> f64 {
    shape.iter().map(|&n| n as f64).product()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn axes_are_balanced_in_part() {
        // Two thirds of the error belong to space in one dimension.
        assert_eq!(stretch(2.0 / 3.0, 1), 1.0);
        assert_eq!(stretch(0.9, 1), 4.0);
        assert_eq!(stretch(0.75, 2), 2.0);
        assert_eq!(stretch(0.1, 1), 1.0 / 4.0);
        assert_eq!(stretch(0.0, 3), 1.0 / 4.0);
        assert_eq!(stretch(1.0, 1), 4.0);
    }
}
