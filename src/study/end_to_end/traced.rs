//! The density at a point as an integral over the velocities, by tracing characteristics back.
//!
//! **Quadrature** is that of [`PanelRule`], the same that errors of runs are measured with. Its
//! error is taken to be twice the rule's own: for one jump of `f` in a panel, twice the difference
//! of Boole's and Simpson's rule is a bound, wherever the jump is. What is narrower than the
//! distance of the first points ([`FIRST_PANELS`]) may be overlooked.

use crate::base::error::Result;
use crate::base::random::uniform;
use crate::problem::case::Case;
use crate::problem::exact::{CellLimits, Tracer};
use crate::run::exact::solution::ExactValues;
use crate::run::exact::velocities::panels::PanelRule;
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

/// Panels along each velocity axis to begin with, by dimension; a panel has four steps.
const FIRST_PANELS: [usize; 3] = [64, 16, 8];

/// The density at a point, as an integral of `f` over the velocities.
pub(super) struct DensityAtPoint<'a> {
    pub case: &'a Case,
    /// The point, its velocities zero.
    pub point: [f64; 6],
    /// The exact solution.
    pub values: &'a ExactValues<'a>,
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

    /// The density by quadrature, until its error is at most `accuracy/2` relative to the density.
    pub fn by_quadrature(&self, accuracy: f64) -> TracedDensity {
        /// The error of the density over that of the rule.
        const ERROR_OF_RULE: f64 = 2.0;
        let started = Instant::now();
        let (space, n) = (&self.case.space, self.dimension());
        let panels = vec![FIRST_PANELS[n - 1]; n];
        let rule = PanelRule {
            relative_tolerance: 0.5 * accuracy / ERROR_OF_RULE,
            max_points_per_integral: MOST_TRACES,
            ..PanelRule::new(self.values, space, self.case.end, panels)
        };
        let [x, y, z, ..] = self.point;
        let found = rule.sampled(&[x, y, z]);
        let density = found.integral.moments[0];
        TracedDensity {
            density,
            traces: found.points,
            seconds: started.elapsed().as_secs_f64(),
            largest: found.largest,
            error: ERROR_OF_RULE * found.integral.error / density.abs(),
        }
    }

    /// The density by uniform random velocities, [`BATCH`] by batch. It ends where `1.96 σ/√n` is
    /// `accuracy` times the mean, or with the error that [`MOST_SAMPLED`] velocities reach.
    pub fn by_monte_carlo(&self, accuracy: f64) -> TracedDensity {
        let started = Instant::now();
        let mut random = ChaCha8Rng::seed_from_u64(0);
        let (mut sum, mut squares) = (0.0f64, 0.0f64);
        let mut found = TracedDensity { error: f64::INFINITY, ..TracedDensity::default() };
        while found.error > accuracy && found.traces < MOST_SAMPLED {
            let points: Vec<[f64; 6]> =
                (0..BATCH).map(|_| self.at(&self.random_part(&mut random))).collect();
            for value in self.values.values_at(&points, self.case.end) {
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
        let linear = CellLimits { is_linear: true, ..CellLimits::EXACT };
        let n = self.dimension();
        let mut cells = FIRST;
        while cells.pow(n as u32) <= MOST {
            let mut shape = self.case.space.elements();
            shape[..n].fill(cells);
            let coarse = on_grid(self.case, &shape);
            let approximated = coarse.space.by_elements().space_cells();
            let tracer = Tracer::with_cells(&coarse, CellLimits { approximated, ..linear })?;
            let most = segments(&tracer);
            let values = &ExactValues::traced(tracer);
            let there = DensityAtPoint { case: &coarse, values, ..*self };
            let found = there.by_quadrature(accuracy);
            if (found.density - density).abs() <= 0.5 * accuracy * density.abs() {
                return Ok(most);
            }
            cells *= 2;
        }
        Ok(segments(&Tracer::with_cells(self.case, linear)?))
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::problem::case::Exact;

    /// Calls `test` with the density of `f(1) = formula` in the unit box of `dimension` axes.
    fn with_density(dimension: usize, formula: &str, test: impl Fn(&DensityAtPoint<'_>)) {
        let axis = "[[axis]]\nx = { lower = 0, upper = 1, cells = 4 }\n\
                    v = { lower = 0, upper = 1, cells = 4 }\n";
        let text = format!(
            "{}[[potential]]\nvalue = 0\n[initial]\nf = 0\n[exact]\nf = \"{formula}\"\n\
             [time]\nend = 1\n",
            axis.repeat(dimension)
        );
        let case = Case::parse("jump", &text, &[]).expect("a case");
        let Some(Exact::Formula(formula)) = &case.exact else { panic!("a formula") };
        let values = &ExactValues::Given(formula);
        test(&DensityAtPoint { case: &case, point: [0.5; 6], values });
    }

    /// In two dimensions the errors of all panels along a jump have one sign.
    #[test]
    fn a_jump_across_panels_does_not_fool_the_quadrature() {
        for edge in [0.0155, 0.0631, 0.1257, 0.3123] {
            with_density(2, &format!("1 if vx < {edge} else 0"), |there| {
                for accuracy in [0.1, 0.02] {
                    let TracedDensity { density, error, .. } = there.by_quadrature(accuracy);
                    let off = (density - edge).abs() / edge;
                    let is_right = off <= error && error <= 0.5 * accuracy;
                    assert!(is_right, "{edge} {accuracy}: {off} {error}");
                }
            });
        }
    }

    /// Where no more values may be taken, the error that is left is returned.
    #[test]
    fn an_error_that_is_not_reached_is_returned() {
        with_density(1, "1 if v < 1/3 else 0", |there| {
            let rule = PanelRule {
                relative_tolerance: 1e-9,
                max_points_per_integral: 20,
                ..PanelRule::new(there.values, &there.case.space, there.case.end, vec![4])
            };
            let found = rule.sampled(&[0.5, 0.0, 0.0]);
            let off = (found.integral.moments[0] - 1.0 / 3.0).abs();
            assert!(found.points <= 21 && found.integral.error > 1e-3, "{}", found.points);
            assert!(off <= 2.0 * found.integral.error, "{off} {}", found.integral.error);
        });
    }

    /// Densities with a jump between velocities, to the accuracy that is asked for.
    #[test]
    fn a_jump_does_not_fool_the_quadrature() {
        for edge in [0.1f64, 1.0 / 3.0, 0.5, 0.500001, 0.77777, 1.0 / 64.0] {
            let exact = edge + edge.powi(3) / 3.0 + 0.25 * (1.0 - edge);
            with_density(1, &format!("1 + v^2 if v < {edge} else 0.25"), |there| {
                for accuracy in [1e-2, 1e-5, 1e-9] {
                    let found = there.by_quadrature(accuracy);
                    let TracedDensity { density, traces, error, .. } = found;
                    let off = (density - exact).abs() / exact;
                    // Beside the bound there is round-off.
                    assert!(off <= error + 1e-14, "{edge} {accuracy}: {off:e} {error:e}");
                    let is_quick = error <= 0.5 * accuracy && traces < 800;
                    assert!(is_quick, "{edge} {accuracy}: {traces}");
                }
            });
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
            let values = ExactValues::traced(Tracer::new(&case).expect("a tracer"));
            let densest = (-14..15).map(|k| {
                let point = [0.1 * f64::from(k), 0.0, 0.0, 0.0, 0.0, 0.0];
                let there = DensityAtPoint { case: &case, point, values: &values };
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
}
