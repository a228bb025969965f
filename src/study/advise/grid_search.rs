//! The search for the coarsest grid on which a scheme meets an accuracy, from a few coarse grids.

use crate::base::error::Result;
use crate::study::advise::reached_grid::{DensityError, Evidence, MeasuredGrid, ReachedGrid};
use crate::study::advise::scheme::SchemeChoice;
use crate::study::advise::trials::Trials;
use crate::study::grids::{AxisGroup, Grids, cells};
use crate::study::order::{Order, OrderRange};

/// Part of the accuracy for the error of the discretisation; the rest is for Schrödingerization.
pub const DISCRETISATION: f64 = 0.9;
/// Largest number of grids in a sequence, each twice as fine as the one before.
const MOST_LEVELS: usize = 12;
/// Largest number of grids tried between two of the sequence, or beyond it.
const MOST_CANDIDATES: usize = 4;
/// Largest factor by which space is refined against velocities, or velocities against space.
const MOST_STRETCH: f64 = 4.0;
/// Cheap grids are tried up to this number even if one reaches the accuracy, since they show the
/// order.
const ENOUGH_LEVELS: usize = 5;
/// A grid is cheap if its trial takes at most this part of the scheme's share of the budget.
const CHEAP: f64 = 0.02;
/// Part of the scheme's share for the sequence of grids; the rest is for grids that follow from it.
const FOR_LEVELS: f64 = 0.6;
/// Factors on the elements along the axes of space, or of velocity, when a grid is trimmed.
const FEWER: [f64; 2] = [0.5, 0.75];
/// Part of the scheme's share for balancing space against velocities on a coarse grid.
const FOR_BALANCE: f64 = 0.3;

/// Errors on a sequence of grids: against the exact solution, or by Richardson's extrapolation.
struct ErrorSequence {
    shapes: Vec<Vec<usize>>,
    /// The error of each grid against the exact solution; or, without one, the distance of each
    /// grid but the last to the next.
    found: Vec<f64>,
    /// Without an exact solution, once the sequence is complete: the distance of each grid to the
    /// finest one, which its error is not counted below.
    to_finest: Vec<f64>,
    exact: bool,
    /// Orders that the scheme may have.
    orders: OrderRange,
}

impl ErrorSequence {
    fn order(&self) -> Order {
        Order::of(&self.found, self.orders)
    }

    fn grids(&self) -> Vec<MeasuredGrid> {
        let order = self.order();
        let grid = |(k, (shape, &found)): (usize, (&Vec<usize>, &f64))| {
            let to_finest = self.to_finest.get(k).copied().unwrap_or(0.0);
            let error = if self.exact { found } else { order.error(found).max(to_finest) };
            MeasuredGrid { shape: shape.clone(), error }
        };
        self.shapes.iter().zip(&self.found).enumerate().map(grid).collect()
    }
}

/// The grid after those that were tried, in the sequence of `reached`. Without an exact solution,
/// the error of a grid takes a trial on the one after it.
pub fn next_grid(trials: &Trials<'_>, reached: &ReachedGrid) -> Vec<usize> {
    let grids = &trials.degree_case(reached.scheme).grids;
    let twice = |shape: &[usize]| grids.doubled(shape, AxisGroup::All);
    match reached.grids.last() {
        Some(last) if !trials.has_exact() => twice(&twice(&last.shape)),
        last => twice(last.map_or(&reached.shape, |last| &last.shape)),
    }
}

/// The error of `scheme` on `shape`, estimated from a grid twice as fine if there is no exact
/// solution. `None` if the trials do not fit into the part `share` of the budget. Collective.
///
/// # Errors
/// As [`Trials::run`].
pub fn error_on(
    trials: &mut Trials<'_>,
    scheme: SchemeChoice,
    shape: &[usize],
    order: &Order,
    share: f64,
) -> Result<Option<DensityError>> {
    if !trials.affords(scheme, shape, share)? {
        return Ok(None);
    }
    if let Some(error) = trials.error(scheme, shape)? {
        return Ok(Some(DensityError { error, known: Evidence::Measured }));
    }
    let twice = trials.degree_case(scheme).grids.doubled(shape, AxisGroup::All);
    if !trials.affords(scheme, &twice, share)? {
        return Ok(None);
    }
    let error = order.error(trials.distance(scheme, shape, &twice)?);
    // Two coarse grids may miss the same.
    let error = error.max(trials.distance_to_finest(scheme, shape).unwrap_or(0.0));
    Ok(Some(DensityError { error, known: Evidence::Estimated }))
}

/// The factor by which space should be refined against velocities if its part of the error is
/// `part`.
///
/// With an error `E_x h_x^q + E_v h_v^q` and a cost `h_x^{−(n+1)} h_v^{−n}`, the least cost has
/// `E_x h_x^q : E_v h_v^q = n + 1 : n`. For degree `k`, `q = k + 1` is assumed. The factor is a
/// power of two, rounded towards 1, as the parts on coarse grids are not those on fine ones.
fn stretch(part: f64, dimension: usize, degree: usize) -> f64 {
    let n = dimension as f64;
    let ratio = part / (1.0 - part).max(1e-6) * n / (n + 1.0);
    let powers = (ratio.max(1e-6).log2() / (degree + 1) as f64).trunc();
    powers.exp2().clamp(1.0 / MOST_STRETCH, MOST_STRETCH)
}

/// The goal of a search, and its limit.
#[derive(Clone, Copy)]
pub struct SearchGoal {
    /// Relative L1 error of the density, at most.
    pub accuracy: f64,
    /// Part of the whole budget up to which trials are made.
    pub share: f64,
}

/// The beginning of a search.
#[derive(Clone, Copy)]
pub struct SearchStart<'a> {
    /// Shape of the coarse grid to begin with.
    pub shape: &'a [usize],
    /// Whether space and velocities are balanced on a coarse grid first.
    pub balance: bool,
}

/// The search for the coarsest grid on which a scheme meets an accuracy.
pub struct GridSearch<'t, 'a> {
    trials: &'t mut Trials<'a>,
    scheme: SchemeChoice,
    /// Part of the whole budget that was used before the search.
    used: f64,
    /// Part of the whole budget up to which trials are made.
    share: f64,
    /// Error of the discretisation, at most.
    wanted: f64,
}

impl<'t, 'a> GridSearch<'t, 'a> {
    /// The search for a grid of `scheme` that meets `goal`, before any trial.
    pub fn new(trials: &'t mut Trials<'a>, scheme: SchemeChoice, goal: SearchGoal) -> Self {
        let SearchGoal { accuracy, share } = goal;
        let used = trials.budget.used().min(share);
        Self { trials, scheme, used, share, wanted: DISCRETISATION * accuracy }
    }

    /// The coarsest grid on which the scheme meets the accuracy, or the grid that comes closest.
    /// Collective.
    ///
    /// # Errors
    /// As [`Trials::run`].
    pub fn coarsest(mut self, start: SearchStart<'_>) -> Result<ReachedGrid> {
        let (scheme, SearchStart { shape: start, balance }) = (self.scheme, start);
        let second = self.grids().doubled(start, AxisGroup::All);
        let part =
            if balance { self.part_of_space(&second, self.up_to(FOR_BALANCE))? } else { None };
        let first = match part {
            Some(part) => {
                let ratio = stretch(part, self.grids().dimension(), scheme.degree);
                self.grids().stretched(start, ratio)
            }
            None => start.to_vec(),
        };
        let sequence = self.sequence_from(first)?;
        let mut result = ReachedGrid {
            scheme,
            shape: sequence.shapes[0].clone(),
            error: f64::NAN,
            known: Evidence::Extrapolated,
            order: sequence.order(),
            grids: sequence.grids(),
            part_of_space: part,
        };
        let Some(finest) = result.grids.last().cloned() else {
            // One grid, and none to compare it with.
            return self.or_own_grid(result);
        };
        (result.shape, result.error) = (finest.shape.clone(), finest.error);
        let wanted = self.wanted;
        let pair = (result.grids.windows(2))
            .rfind(|pair| pair[0].error > wanted && pair[1].error <= wanted)
            .map(|pair| [pair[0].clone(), pair[1].clone()]);
        if pair.is_none() && finest.error > wanted && !result.order.falls() {
            // Finer grids do not help.
            return self.or_own_grid(result);
        }
        result.known = if sequence.exact { Evidence::Measured } else { Evidence::Estimated };
        if let Some(pair) = pair {
            self.between(&pair, &mut result)?;
        } else if finest.error > wanted {
            self.beyond(&finest, &mut result)?;
        } else if let Some(coarsest) = result.grids.iter().find(|grid| grid.error <= wanted) {
            // Every grid of the sequence reaches it.
            (result.shape, result.error) = (coarsest.shape.clone(), coarsest.error);
        }
        result = self.or_own_grid(result)?;
        self.trim(&mut result)?;
        if let Some(part) = self.part_of_space(&result.shape, self.share)? {
            result.part_of_space = Some(part);
        }
        Ok(result)
    }

    /// A grid that meets the accuracy with the scheme's flux, near `known`, the grid for another
    /// flux of the same scheme. Order and grids are those of `known`. `None` if the budget does not
    /// hold the trials that show it. Collective.
    ///
    /// # Errors
    /// As [`Trials::run`].
    pub fn near(mut self, known: &ReachedGrid) -> Result<Option<ReachedGrid>> {
        let Some(found) = self.error_on(&known.shape, &known.order)? else { return Ok(None) };
        let scheme = self.scheme;
        let mut result =
            ReachedGrid { scheme, error: found.error, known: found.known, ..known.clone() };
        if found.error > self.wanted {
            let tried = MeasuredGrid { shape: known.shape.clone(), error: found.error };
            self.beyond(&tried, &mut result)?;
        }
        self.trim(&mut result)?;
        let reaches = result.known != Evidence::Extrapolated && result.error <= self.wanted;
        Ok(reaches.then_some(result))
    }

    /// The part of the whole budget at which this `part` of the scheme's share is used.
    fn up_to(&self, part: f64) -> f64 {
        self.used + part * (self.share - self.used)
    }

    fn grids(&self) -> &Grids {
        &self.trials.degree_case(self.scheme).grids
    }

    fn distance(&mut self, coarse: &[usize], fine: &[usize]) -> Result<f64> {
        self.trials.distance(self.scheme, coarse, fine)
    }

    fn error_on(&mut self, shape: &[usize], order: &Order) -> Result<Option<DensityError>> {
        error_on(self.trials, self.scheme, shape, order, self.share)
    }

    /// The part of space in the error of the density. It follows from the change of the density on
    /// grids that are twice as fine along space alone, and along velocities alone. `None` if the
    /// budget does not hold these grids. Collective.
    fn part_of_space(&mut self, shape: &[usize], share: f64) -> Result<Option<f64>> {
        let finer =
            [AxisGroup::Space, AxisGroup::Velocity].map(|axes| self.grids().doubled(shape, axes));
        for shape in &finer {
            if !self.trials.affords(self.scheme, shape, share)? {
                return Ok(None);
            }
        }
        let space = self.distance(shape, &finer[0])?;
        let both = space + self.distance(shape, &finer[1])?;
        Ok((both > 0.0).then(|| space / both))
    }

    /// The sequence of grids that begins with `first`: finer ones until one reaches the wanted
    /// error, then coarser ones while they reach it too. Collective.
    fn sequence_from(&mut self, first: Vec<usize>) -> Result<ErrorSequence> {
        let scheme = self.scheme;
        let (exact, orders) = (self.trials.has_exact(), scheme.orders());
        let found = Vec::from_iter(self.trials.error(scheme, &first)?);
        let mut sequence =
            ErrorSequence { shapes: vec![first], found, to_finest: vec![], exact, orders };
        self.refine(&mut sequence)?;
        self.coarsen(&mut sequence)?;
        if !exact {
            let to_finest = |shape: &Vec<usize>| self.trials.distance_to_finest(scheme, shape);
            let distances = sequence.shapes.iter().map(|shape| to_finest(shape).unwrap_or(0.0));
            sequence.to_finest = distances.collect();
        }
        Ok(sequence)
    }

    /// Adds finer grids to the `sequence` until one reaches the wanted error. Collective.
    fn refine(&mut self, sequence: &mut ErrorSequence) -> Result<()> {
        let scheme = self.scheme;
        let share = self.up_to(FOR_LEVELS);
        let cheap = CHEAP * (share - self.used);
        while sequence.shapes.len() < MOST_LEVELS {
            let reached = sequence.grids().last().is_some_and(|grid| grid.error <= self.wanted);
            let last = sequence.shapes[sequence.shapes.len() - 1].clone();
            let next = self.grids().doubled(&last, AxisGroup::All);
            if next == last {
                // Nothing varies along any axis.
                if !sequence.exact {
                    sequence.found.push(0.0);
                }
                break;
            }
            let enough = sequence.found.len() >= ENOUGH_LEVELS;
            // Two orders show whether they have settled: three errors.
            let more = sequence.found.len() < 3 || self.trials.is_cheap(scheme, &next, cheap)?;
            if (reached && (enough || !more)) || !self.trials.affords(scheme, &next, share)? {
                break;
            }
            if sequence.exact {
                sequence.found.extend(self.trials.error(scheme, &next)?)
            } else {
                sequence.found.push(self.distance(&last, &next)?)
            }
            sequence.shapes.push(next);
        }
        Ok(())
    }

    /// Adds coarser grids to the `sequence` while they reach the wanted error. Collective.
    fn coarsen(&mut self, sequence: &mut ErrorSequence) -> Result<()> {
        let scheme = self.scheme;
        while sequence.shapes.len() < MOST_LEVELS
            && sequence.grids().first().is_some_and(|grid| grid.error <= self.wanted)
            && let Some(half) = self.grids().halved(&sequence.shapes[0])
        {
            let found = match self.trials.error(scheme, &half)? {
                Some(error) => error,
                None => self.distance(&half, &sequence.shapes[0])?,
            };
            sequence.shapes.insert(0, half);
            sequence.found.insert(0, found);
        }
        Ok(())
    }

    /// The coarsest grid that reaches the wanted error between a coarse one that does not and a
    /// fine one that does, by the order that these two show. Collective.
    fn between(
        &mut self,
        [coarse, fine]: &[MeasuredGrid; 2],
        result: &mut ReachedGrid,
    ) -> Result<()> {
        let wanted = self.wanted;
        // Begin with the fine grid, which reaches it.
        (result.shape, result.error) = (fine.shape.clone(), fine.error);
        let slope = (coarse.error / fine.error).log2();
        let mut scale = (coarse.error / wanted).log2() / slope;
        for _ in 0..MOST_CANDIDATES {
            let shape = self.grids().scaled(&coarse.shape, AxisGroup::All, scale.exp2());
            if cells(&shape) >= cells(&fine.shape) {
                break;
            }
            let Some(found) = self.error_on(&shape, &result.order)? else { break };
            if found.error <= wanted {
                (result.shape, result.error, result.known) = (shape, found.error, found.known);
                break;
            }
            scale += ((found.error / wanted).log2() / slope).max(0.05);
        }
        Ok(())
    }

    /// A grid beyond the `finest` one tried that reaches the wanted error, as the order predicts;
    /// it is tried if the budget allows. Collective.
    fn beyond(&mut self, finest: &MeasuredGrid, result: &mut ReachedGrid) -> Result<()> {
        let mut scale = result.order.refinement(finest.error, self.wanted);
        for _ in 0..MOST_CANDIDATES {
            result.shape = self.grids().scaled(&finest.shape, AxisGroup::All, scale);
            (result.error, result.known) = (self.wanted, Evidence::Extrapolated);
            let Some(found) = self.error_on(&result.shape, &result.order)? else { break };
            (result.error, result.known) = (found.error, found.known);
            if found.error <= self.wanted {
                break;
            }
            scale *= result.order.refinement(found.error, self.wanted).max(1.05);
        }
        Ok(())
    }

    /// Takes fewer elements along the velocities alone, and along space alone, as long as the
    /// wanted error is reached: the balance of both on a coarse grid is not that on a fine one.
    /// Collective.
    fn trim(&mut self, result: &mut ReachedGrid) -> Result<()> {
        // The axes with the smaller part of the error first.
        let order = if result.part_of_space.is_some_and(|part| part < 0.5) {
            [AxisGroup::Space, AxisGroup::Velocity]
        } else {
            [AxisGroup::Velocity, AxisGroup::Space]
        };
        for part in FEWER {
            for axes in order {
                while result.known != Evidence::Extrapolated && result.error <= self.wanted {
                    let shape = self.grids().scaled(&result.shape, axes, part);
                    if cells(&shape) >= cells(&result.shape) {
                        break;
                    }
                    let Some(found) = self.error_on(&shape, &result.order)? else { break };
                    if found.error > self.wanted {
                        break;
                    }
                    (result.shape, result.error, result.known) = (shape, found.error, found.known);
                }
            }
        }
        Ok(())
    }

    /// Replaces `found` by the case's own grid, if that was tried and reaches the wanted error, and
    /// has fewer cells or `found` does not reach the error. Collective.
    fn or_own_grid(&mut self, mut found: ReachedGrid) -> Result<ReachedGrid> {
        let (scheme, wanted) = (self.scheme, self.wanted);
        let own = self.trials.degree_case(scheme).base.space.elements();
        let reaches = |error: f64| error <= wanted;
        let better = !reaches(found.error) || cells(&own) < cells(&found.shape);
        if better
            // No part of the budget: trials that were made cost nothing.
            && let Some(known) = error_on(self.trials, scheme, &own, &found.order, 0.0)?
            && reaches(known.error)
        {
            (found.shape, found.error, found.known) = (own, known.error, known.known);
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
