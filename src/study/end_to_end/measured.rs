//! Errors of a scheme, measured on three grids, and the grid that a smaller error needs.

use crate::base::error::{Error, Result};
use crate::parallel::communicator::World;
use crate::problem::case::{Case, Exact};
use crate::study::density::{density_of, distance, exact_density, spread};
use crate::study::grids::{Grids, MOST_PLANNED_SPACE_CELLS, cells, on_grid, shape_text};
use crate::study::order::{Order, OrderRange, orders_text};
use crate::study::trial::{final_fields_only, seconds_of_result, trial};

/// Grids on which errors are measured.
const GRIDS: i32 = 3;
/// The least order of a smooth part of a solution: that of a jump.
const ORDER_OF_JUMP: f64 = 0.5;
/// The highest order that counts for degree 0; of a higher degree `k` it is `k + 1`.
const MOST: f64 = 2.0;

/// Errors and seconds of a scheme by trials on three grids.
pub(super) struct MeasuredScheme {
    /// Elements, from coarse to fine.
    pub grids: Vec<Vec<usize>>,
    /// Relative L1 errors of the density on them.
    pub errors: Vec<f64>,
    /// The order at which the errors fall.
    pub order: Order,
    /// Seconds of the finest trial, without comparisons.
    pub seconds: f64,
    /// The largest ratio of the error of the density to that of `f`.
    pub spread: f64,
}

impl MeasuredScheme {
    /// Trials of `case`, by the classical integrator that it names. Collective.
    ///
    /// # Errors
    /// [`Error::Input`] where errors do not fall, or the grid has no two coarser ones; as a trial.
    pub fn new(world: &World, case: &Case, exact: &Exact) -> Result<Self> {
        let group = world.group();
        let grids = Grids::new(case);
        let own = case.space.elements();
        let coarser = (1..GRIDS).rev().map(|k| grids.alike(&own, 0.5f64.powi(k)));
        let shapes: Vec<Vec<usize>> = coarser.chain([own.clone()]).collect();
        if let Some(pair) = shapes.windows(2).find(|pair| pair[0] == pair[1]) {
            return Err(Error::Input(format!(
                "{}: errors are measured on {GRIDS} grids, each half as fine as the one before, \
                 and {} cannot be made coarser; more cells are needed",
                case.name,
                shape_text(&pair[0])
            )));
        }
        let (mut errors, mut last) = (Vec::new(), (f64::NAN, f64::NAN));
        for shape in &shapes {
            let plain = Case { exact: None, ..final_fields_only(&on_grid(case, shape)) };
            let found = trial(world, &plain)?;
            let density = density_of(&group, &plain.space, &found, 1)?;
            errors.push(distance(&density, &exact_density(&group, &plain, exact)?));
            let seconds = seconds_of_result(&found.summary);
            last = (seconds, spread(&group, &plain.space, &found, &density));
        }
        let steps: Vec<f64> = shapes.windows(2).map(|pair| finer(&pair[0], &pair[1])).collect();
        let most = MOST.max(case.space.degree() as f64 + 1.0);
        let order = Order::of_steps(&errors, &steps, OrderRange { least: ORDER_OF_JUMP, most });
        if !order.falls() {
            let trials = shapes.iter().zip(&errors);
            let trials = trials.map(|(grid, e)| format!("{e:.1e} on {}", shape_text(grid)));
            return Err(Error::Input(format!(
                "{}: errors of the density do not fall with the grid: {}; another number of cells, \
                 with faces where V jumps, may help",
                case.name,
                trials.collect::<Vec<_>>().join(", ")
            )));
        }
        // All ranks count on the same seconds.
        Ok(Self { grids: shapes, order, seconds: group.max(last.0), spread: last.1, errors })
    }

    /// The refinement that an error `wanted` takes, relative to the finest grid (2 is twice as
    /// fine). Between two measured errors it is interpolated; else it follows from the order. It is
    /// at least that of the coarsest grid.
    pub fn factor(&self, wanted: f64) -> f64 {
        let last = self.errors.len() - 1;
        let doublings = |k: usize| -finer(&self.grids[k], &self.grids[last]);
        match self.errors.iter().rposition(|&error| error > wanted) {
            Some(k) if k < last => {
                let [coarse, fine] = [self.errors[k], self.errors[k + 1]];
                let part = (coarse / wanted).ln() / (coarse / fine).ln();
                (doublings(k) + part * (doublings(k + 1) - doublings(k))).exp2()
            }
            _ => self.order.refinement(self.errors[last], wanted).max(doublings(0).exp2()),
        }
    }

    /// A remark on the order that the prediction uses; `None` where the last two grids show that
    /// order.
    pub fn remark(&self) -> Option<String> {
        let last = &self.order.pairs[self.order.pairs.len().saturating_sub(2)..];
        let lower = last.iter().copied().fold(f64::INFINITY, f64::min);
        let counted = self.order.counted_on;
        let what =
            if counted > lower { "the order of a jump" } else { "the highest of the degree" };
        ((counted - lower).abs() > 1e-9)
            .then(|| format!("the grids show {}; {counted:.2} is used, {what}", orders_text(last)))
    }
}

/// The binary logarithm of the refinement from `coarse` to `fine`, the mean over the axes.
fn finer(coarse: &[usize], fine: &[usize]) -> f64 {
    let each = coarse.iter().zip(fine).map(|(&a, &b)| (b as f64 / a as f64).log2());
    each.sum::<f64>() / coarse.len() as f64
}

/// Elements along each axis of a grid of `scheme` that is `factor` times finer, as the `order` of
/// its error asks for.
///
/// # Errors
/// [`Error::Input`] for a grid that is too large to be planned.
pub(super) fn finer_grid(scheme: &Case, factor: f64, order: f64) -> Result<Vec<usize>> {
    let shape = Grids::new(scheme).alike(&scheme.space.elements(), factor);
    let cells = cells(&shape[..scheme.space.dimension()]);
    if cells > MOST_PLANNED_SPACE_CELLS {
        return Err(Error::Input(format!(
            "{}: a grid of {cells:.1e} cells of space, {factor:.1} times finer along each axis \
             (order {order:.2}); up to {MOST_PLANNED_SPACE_CELLS:.1e} are looked at",
            scheme.name
        )));
    }
    Ok(shape)
}

#[cfg(test)]
mod tests {
    use super::*;

    fn measured(sizes: &[usize], error: impl Fn(f64) -> f64) -> MeasuredScheme {
        let grids: Vec<Vec<usize>> = sizes.iter().map(|&n| vec![n; 2]).collect();
        let errors: Vec<f64> = sizes.iter().map(|&n| error(n as f64)).collect();
        let steps: Vec<f64> = grids.windows(2).map(|pair| finer(&pair[0], &pair[1])).collect();
        let order =
            Order::of_steps(&errors, &steps, OrderRange { least: ORDER_OF_JUMP, most: MOST });
        MeasuredScheme { grids, errors, order, seconds: 1.0, spread: 1.0 }
    }

    /// Grids that are not twice as fine show the same order, and the grid of an error is found
    /// between them and beyond.
    #[test]
    fn uneven_grids_show_the_order() {
        for q in [0.5, 0.9, 1.7] {
            let error = |n: f64| 3.0 * n.powf(-q);
            let found = measured(&[27, 50, 101], error);
            assert!((found.order.counted_on - q).abs() < 1e-12);
            assert!(found.remark().is_none(), "{:?}", found.remark());
            for n in [30.0, 64.0, 99.0, 400.0] {
                let cells = 101.0 * found.factor(error(n));
                assert!((cells / n - 1.0).abs() < 1e-9, "{q} {n}: {cells}");
            }
            assert!((101.0 * found.factor(1e9) - 27.0).abs() < 1e-9);
        }
        // A remark says where the order of a jump is counted on instead of a measured one.
        let uneven = measured(&[32, 64, 128], |n| if n > 100.0 { 0.2 } else { 16.0 / n });
        assert_eq!(uneven.order.counted_on, 0.5);
        let remark = uneven.remark().unwrap_or_default();
        assert!(remark.contains("1.00, 0.32; 0.50 is used"), "{remark}");
    }
}
