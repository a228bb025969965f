//! The density at a point as an integral over the velocities, by tracing characteristics back.
//!
//! **Quadrature.** Along each axis Simpson's rule on panels of five values, inside the next axis.
//! A panel's error is taken to be twice the change from its three outer values to all five: for one
//! jump of `f` in a panel that is a bound, wherever it is, and for a smooth `f` it is 30 times the
//! error. The worst panels are halved until all errors together are within the tolerance. What is
//! narrower than the distance of the first values ([`first_panels`]) may be overlooked.

use crate::base::error::Result;
use crate::base::random::uniform;
use crate::problem::case::Case;
use crate::problem::exact::{MostCells, Tracer};
use crate::study::grids::on_grid;
use rand_chacha::ChaCha8Rng;
use rand_chacha::rand_core::SeedableRng;
use std::time::Instant;

/// Largest number of values of a quadrature.
pub(super) const MOST_TRACES: usize = 1 << 22;
/// Largest number of traces of Monte Carlo; the number for a smaller error follows from their
/// deviation.
pub(super) const MOST_SAMPLED: usize = 1 << 20;
/// Number of traces of Monte Carlo between two checks of its deviation. No fewer are taken.
pub(super) const BATCH: usize = 4096;

/// `f` at a point of phase space.
pub(super) type Values<'a> = Box<dyn Fn(&[f64; 6]) -> f64 + 'a>;

/// The density at a point, as an integral of `f` over the velocities.
pub(super) struct DensityAtPoint<'a> {
    pub case: &'a Case,
    /// The point, its velocities zero.
    pub point: [f64; 6],
    /// `f(T)` at a point of phase space.
    pub value: Values<'a>,
}

/// The density at a point, by values of `f` there.
#[derive(Default)]
pub(super) struct TracedDensity {
    pub density: f64,
    /// The values that were taken.
    pub traces: usize,
    pub seconds: f64,
    /// Largest `|f|` of these.
    pub largest: f64,
    /// The relative error that was reached.
    pub error: f64,
}

/// Panels along an axis to begin with, in `n` dimensions; a panel has four steps.
fn first_panels(n: usize) -> usize {
    [64, 16, 8][n - 1]
}

/// An integral over the unit interval and its error.
#[derive(Clone, Copy)]
struct SimpsonIntegral {
    value: f64,
    error: f64,
}

/// A part of an axis with five values, a quarter of it apart.
struct SimpsonPanel {
    start: f64,
    width: f64,
    values: [f64; 5],
}

impl SimpsonPanel {
    fn integral(&self) -> SimpsonIntegral {
        let Self { width, values: [a, b, c, d, e], .. } = self;
        let value = width / 12.0 * (a + 4.0 * b + 2.0 * c + 4.0 * d + e);
        SimpsonIntegral { value, error: 2.0 * (width / 6.0 * (a + 4.0 * c + e) - value).abs() }
    }

    /// The two halves of the panel, each with two more values.
    fn halves(&self, value: &mut dyn FnMut(f64) -> f64) -> [Self; 2] {
        let Self { start, width, values } = self;
        [0, 1].map(|half| {
            let (start, width) = (start + 0.5 * width * half as f64, 0.5 * width);
            let old = &values[2 * half..];
            let [b, d] = [0.25, 0.75].map(|part| value(start + part * width));
            Self { start, width, values: [old[0], b, old[1], d, old[2]] }
        })
    }
}

/// The integral of `value` over the unit interval, on `first` panels to begin with, until the error
/// is within `absolute`, or `relative` of the integral, or `may_go_on` says no.
fn adaptive(
    first: usize,
    [absolute, relative]: [f64; 2],
    may_go_on: &dyn Fn() -> bool,
    value: &mut dyn FnMut(f64) -> f64,
) -> SimpsonIntegral {
    /// Panels whose error is less than this part of the largest one are not halved yet.
    const WORST: f64 = 0.25;
    /// A narrower panel has no more numbers between its ends.
    const NARROWEST: f64 = 1e-15;
    let width = (first as f64).recip();
    let ends: Vec<f64> = (0..=4 * first).map(|k| value(0.25 * width * k as f64)).collect();
    let panel = |k: usize| {
        let values = std::array::from_fn(|i| ends[4 * k + i]);
        SimpsonPanel { start: width * k as f64, width, values }
    };
    let mut panels: Vec<SimpsonPanel> = (0..first).map(panel).collect();
    loop {
        let parts: Vec<SimpsonIntegral> = panels.iter().map(SimpsonPanel::integral).collect();
        let sum = parts.iter().map(|part| part.value).sum::<f64>();
        let error = parts.iter().map(|part| part.error).sum::<f64>();
        let worst = parts.iter().map(|part| part.error).fold(0.0, f64::max);
        let narrow = panels
            .iter()
            .zip(&parts)
            .any(|(panel, part)| part.error == worst && panel.width < NARROWEST);
        let met = error.is_nan() || error <= absolute.max(relative * sum.abs());
        if met || narrow || !may_go_on() {
            return SimpsonIntegral { value: sum, error };
        }
        let mut finer = Vec::with_capacity(panels.len() + 1);
        for (panel, part) in panels.into_iter().zip(parts) {
            if part.error >= WORST * worst {
                finer.extend(panel.halves(value))
            } else {
                finer.push(panel)
            }
        }
        panels = finer;
    }
}

impl DensityAtPoint<'_> {
    fn dimension(&self) -> usize {
        self.case.space.dimension()
    }

    /// The point with velocities mapped from the unit cube.
    fn at(&self, part: &[f64]) -> [f64; 6] {
        let mut at = self.point;
        for (a, (axis, part)) in self.case.space.v.iter().zip(part).enumerate() {
            at[3 + a] = axis.lower + part * (axis.upper - axis.lower);
        }
        at
    }

    /// The integral over the axes from `part.len()` on. Along the first of them its error is to be
    /// within `absolute`, or `relative` of it; along the others within a part of `absolute`.
    fn over_axes(
        &self,
        part: &mut Vec<f64>,
        absolute: f64,
        relative: f64,
        found: &mut TracedDensity,
    ) -> SimpsonIntegral {
        /// The error that inner integrals may have, as a part of the tolerance. Their noise must
        /// not be taken for a jump.
        const INNER_PART: f64 = 0.05;
        let (n, axis) = (self.dimension(), part.len());
        let traces = std::cell::Cell::new(found.traces);
        let inner = std::cell::Cell::new(0.0f64);
        let mut value = |x: f64| {
            part.push(x);
            let value = if axis + 1 == n {
                found.traces += 1;
                let value = (self.value)(&self.at(part));
                found.largest = found.largest.max(value.abs());
                value
            } else {
                let below = self.over_axes(part, INNER_PART * absolute, 0.0, found);
                inner.set(inner.get().max(below.error));
                below.value
            };
            part.pop();
            traces.set(found.traces);
            value
        };
        let may_go_on = || traces.get() < MOST_TRACES;
        let wanted = [(1.0 - INNER_PART) * absolute, (1.0 - INNER_PART) * relative];
        let integral = adaptive(first_panels(n), wanted, &may_go_on, &mut value);
        SimpsonIntegral { error: integral.error + inner.get(), ..integral }
    }

    /// The density by quadrature, until its error is at most `accuracy/2` relative to the density.
    pub fn by_quadrature(&self, accuracy: f64) -> TracedDensity {
        /// Passes of several axes, each to the tolerance that follows from the last density.
        const PASSES: usize = 4;
        let started = Instant::now();
        let mut found = TracedDensity::default();
        let wanted = 0.5 * accuracy;
        let mut integral = match self.dimension() {
            1 => self.over_axes(&mut Vec::new(), 0.0, wanted, &mut found),
            _ => self.over_axes(&mut Vec::new(), f64::INFINITY, 0.0, &mut found),
        };
        for _ in 0..PASSES {
            let tolerance = wanted * integral.value.abs();
            let met = integral.error <= tolerance || tolerance == 0.0;
            if met || found.traces >= MOST_TRACES {
                break;
            }
            integral = self.over_axes(&mut Vec::new(), 0.9 * tolerance, 0.0, &mut found);
        }
        found.density = self.case.space.velocity_box_volume() * integral.value;
        found.error = integral.error / integral.value.abs();
        found.seconds = started.elapsed().as_secs_f64();
        found
    }

    /// The density by uniform random velocities, [`BATCH`] by batch. It ends where `1.96 σ/√n` is
    /// `accuracy` times the mean, or with the error that [`MOST_SAMPLED`] velocities reach.
    pub fn by_monte_carlo(&self, accuracy: f64) -> TracedDensity {
        let started = Instant::now();
        let mut random = ChaCha8Rng::seed_from_u64(0);
        let (mut sum, mut squares) = (0.0f64, 0.0f64);
        let mut found = TracedDensity { error: f64::INFINITY, ..TracedDensity::default() };
        while found.error > accuracy && found.traces < MOST_SAMPLED {
            for _ in 0..BATCH {
                let value = (self.value)(&self.at(&self.random_part(&mut random)));
                (sum, squares) = (sum + value, squares + value * value);
                found.largest = found.largest.max(value.abs());
            }
            found.traces += BATCH;
            let count = found.traces as f64;
            let mean = sum / count;
            let deviation = (squares / count - mean * mean).max(0.0).sqrt();
            found.density = self.case.space.velocity_box_volume() * mean;
            found.error = if mean == 0.0 {
                f64::INFINITY
            } else {
                1.96 * deviation / count.sqrt() / mean.abs()
            };
        }
        found.seconds = started.elapsed().as_secs_f64();
        found
    }

    fn random_part(&self, random: &mut ChaCha8Rng) -> Vec<f64> {
        (0..self.dimension()).map(|_| uniform(random)).collect()
    }

    /// The largest number of segments of a characteristic, among 1000 random velocities. Where `V`
    /// curves, a segment is a cell in which `V` is taken as linear. The grid of these cells is then
    /// the coarsest of `2^k` an axis whose density is within `accuracy/2` of `density`.
    ///
    /// # Errors
    /// As [`Tracer::new`].
    pub fn most_segments(&self, density: f64, accuracy: f64) -> Result<usize> {
        /// Velocities that are tried.
        const TRIED: usize = 1000;
        /// Cells an axis of the first grid, and in all of the last.
        const FIRST: usize = 8;
        const MOST: usize = 1 << 12;
        let segments = |tracer: &Tracer<'_>| {
            let mut random = ChaCha8Rng::seed_from_u64(1);
            let mut each =
                |_| tracer.follow(&self.at(&self.random_part(&mut random)), self.case.end).segments;
            (0..TRIED).map(&mut each).max().unwrap_or(1)
        };
        let linear = MostCells { is_linear: true, ..MostCells::EXACT };
        let n = self.dimension();
        let mut cells = FIRST;
        while cells.pow(n as u32) <= MOST {
            let mut shape = self.case.space.elements();
            shape[..n].fill(cells);
            let coarse = on_grid(self.case, &shape);
            let approximated = coarse.space.by_elements().space_cells();
            let tracer = Tracer::with_cells(&coarse, MostCells { approximated, ..linear })?;
            let value = |at: &[f64; 6]| tracer.value(at, coarse.end);
            let there = DensityAtPoint { case: &coarse, value: Box::new(value), ..*self };
            let found = there.by_quadrature(accuracy);
            if (found.density - density).abs() <= 0.5 * accuracy * density.abs() {
                return Ok(segments(&tracer));
            }
            cells *= 2;
        }
        Ok(segments(&Tracer::with_cells(self.case, linear)?))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Sums over `[0, 1]` with jumps that midpoints do not see, to the accuracy that is asked for.
    #[test]
    fn a_jump_does_not_fool_the_quadrature() {
        for edge in [0.1, 1.0 / 3.0, 0.5, 0.500001, 0.77777, 1.0 / 64.0] {
            for tolerance in [1e-2, 1e-5, 1e-9] {
                let mut count = 0;
                let mut value = |x: f64| {
                    count += 1;
                    if x < edge { 1.0 + x * x } else { 0.25 }
                };
                let found = adaptive(4, [0.0, tolerance], &|| true, &mut value);
                let exact = edge + edge.powi(3) / 3.0 + 0.25 * (1.0 - edge);
                let off = (found.value - exact).abs();
                assert!(off <= found.error, "{edge} {tolerance}: {off:e} {:e}", found.error);
                assert!(found.error <= tolerance * found.value, "{edge} {tolerance}");
                assert!(count < 400, "{edge} {tolerance}: {count}");
            }
        }
    }

    /// A trace has a segment for each part of `V` that is linear: across a jump two, and of a
    /// curved `V` as many as the accuracy needs, whatever the case's grid.
    #[test]
    fn segments_follow_from_the_potential() {
        let segments = |potential: &str, cells: usize, accuracy: f64| {
            let text = format!(
                r#"
                [[axis]]
                x = {{ lower = -1.5, upper = 1.5, cells = {cells} }}
                v = {{ lower = -1.4, upper = 1.4, cells = 84 }}
                {potential}
                [initial]
                f = "(1 + cos(pi*min(1, sqrt((x + 0.5)^2 + (v - 0.4)^2)/0.4)))/2"
                [time]
                end = 1.5
                [solver]
                tolerance = 1e-6
                "#
            );
            let case = Case::parse("curved", &text, &[]).expect("a case");
            let tracer = Tracer::new(&case).expect("a tracer");
            let densest = (-14..15).map(|k| {
                let point = [0.1 * f64::from(k), 0.0, 0.0, 0.0, 0.0, 0.0];
                let value = |at: &[f64; 6]| tracer.value(at, case.end);
                let there = DensityAtPoint { case: &case, point, value: Box::new(value) };
                (there.by_quadrature(accuracy).density, there)
            });
            let densest = densest.reduce(|a, b| if b.0 > a.0 { b } else { a });
            let (density, there) = densest.expect("a point");
            assert!(density > 0.05, "{density}");
            there.most_segments(density, accuracy).expect("segments")
        };
        let curved = "[[potential]]\nvalue = \"cos(3*x)/3\"";
        let [rough, close] = [0.3, 0.03].map(|accuracy| segments(curved, 64, accuracy));
        assert!(3 < rough && rough < close, "{rough} {close}");
        assert_eq!(segments(curved, 128, 0.3), rough);
        let step = "[[potential]]\nwhere = \"x < 0\"\nvalue = \"0.1\"\n\
                    [[potential]]\nvalue = \"0\"";
        assert_eq!(segments(step, 64, 0.1), 2);
    }

    /// Where no more values may be taken, the error that is left is returned.
    #[test]
    fn an_error_that_is_not_reached_is_returned() {
        let mut value = |x: f64| f64::from(x < 1.0 / 3.0);
        let found = adaptive(4, [1e-9, 0.0], &|| false, &mut value);
        assert!(found.error > 1e-2 && (found.value - 1.0 / 3.0).abs() <= found.error);
    }
}
