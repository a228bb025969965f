//! An integral over the velocities at one position, by subdivision of panels.

use crate::base::row_major::number;
use crate::matrix::elements::products;
use crate::matrix::observables::{MOMENTS, add_mass};
use crate::problem::grid::{MAX_DIMENSION, PhaseSpace, for_each_cell};
use crate::run::exact::solution::ExactValues;

/// Points of a panel along an axis.
pub const POINTS: usize = 5;
/// Boole's rule on `[0, 1]`.
pub const BOOLE: [f64; POINTS] = [7.0 / 90.0, 32.0 / 90.0, 12.0 / 90.0, 32.0 / 90.0, 7.0 / 90.0];
/// Simpson's rule at the same points.
pub const SIMPSON: [f64; POINTS] = [1.0 / 6.0, 0.0, 4.0 / 6.0, 0.0, 1.0 / 6.0];
/// The rule of two trapezoids at the same points.
const TRAPEZOIDS: [f64; POINTS] = [0.25, 0.0, 0.5, 0.0, 0.25];
/// Panels are halved together if their errors are at least this part of the largest.
const NEAR_LARGEST: f64 = 0.25;

/// An integral over the velocities at a position.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct VelocityIntegral {
    /// Density, momentum and kinetic energy, in the order of [`MOMENTS`].
    pub moments: [f64; MOMENTS],
    /// An estimate of the density's error.
    pub error: f64,
}

impl VelocityIntegral {
    /// Adds `weight` times another integral.
    pub fn add(&mut self, weight: f64, other: &Self) {
        self.error += weight * other.error;
        for (sum, moment) in self.moments.iter_mut().zip(other.moments) {
            *sum += weight * moment;
        }
    }

    /// The mean over an interval of integrals at [`POINTS`] equal steps, by `rule`.
    pub fn mean(values: &[Self; POINTS], rule: [f64; POINTS]) -> Self {
        let mut mean = Self::default();
        values.iter().zip(rule).for_each(|(value, weight)| mean.add(weight, value));
        mean
    }
}

/// An integral, and the values of the solution that it took.
pub struct SampledIntegral {
    /// The integral.
    pub integral: VelocityIntegral,
    /// Number of these values.
    pub points: usize,
    /// The largest `|f|` of them.
    pub largest: f64,
}

/// A part of the velocity box.
struct VelocityPanel {
    lower: [f64; MAX_DIMENSION],
    width: [f64; MAX_DIMENSION],
    /// `f` at its points, the last axis fastest.
    values: Vec<f64>,
    /// The error of the integral over it.
    error: f64,
    /// The axis with the largest part of that error.
    axis: usize,
}

/// Number of points of a box of `panels` panels along each axis; neighbours share points.
pub fn points_of(panels: &[usize]) -> usize {
    panels.iter().map(|n| (POINTS - 1) * n + 1).product()
}

/// Integrals of the exact solution at a time over the velocity box, by subdivision of panels.
#[derive(Clone)]
pub struct PanelRule<'a> {
    /// The exact solution.
    pub values_of: &'a ExactValues<'a>,
    /// The time.
    pub time: f64,
    /// Phase space.
    pub space: &'a PhaseSpace,
    /// Panels to begin with, by axis.
    pub panels: Vec<usize>,
    /// The allowed error of a density.
    pub tolerance: f64,
    /// The allowed error relative to the density, where that is larger.
    pub relative_tolerance: f64,
    /// Points that an integral may take.
    pub max_points_per_integral: usize,
    /// Points that all integrals may take together, about.
    pub max_points_in_all: usize,
    /// Whether a study with little time limits them, so that nothing is looked for within cells.
    pub is_limited: bool,
    /// The part of a density that may lie between the points of the first panels.
    pub unseen_part: f64,
    /// Boole's weights at the points of a panel.
    pub weights: Vec<f64>,
}

/// The point of phase space at a position with a velocity.
pub fn phase_point(position: &[f64; MAX_DIMENSION], velocity: [f64; MAX_DIMENSION]) -> [f64; 6] {
    let ([x, y, z], [u, v, w]) = (*position, velocity);
    [x, y, z, u, v, w]
}

impl<'a> PanelRule<'a> {
    /// A rule that begins with `panels` along each axis and takes no more points than those.
    pub fn new(
        values_of: &'a ExactValues<'a>,
        space: &'a PhaseSpace,
        time: f64,
        panels: Vec<usize>,
    ) -> Self {
        let weights = products(std::iter::repeat_n(&BOOLE[..], space.dimension()));
        Self {
            values_of,
            time,
            space,
            panels,
            tolerance: 0.0,
            relative_tolerance: 0.0,
            max_points_per_integral: 0,
            max_points_in_all: 0,
            is_limited: false,
            unseen_part: 0.0,
            weights,
        }
    }

    /// The integral at a position.
    pub fn at(&self, position: &[f64; MAX_DIMENSION]) -> VelocityIntegral {
        self.sampled(position).integral
    }

    /// The integral at a position, with the values that it took.
    pub fn sampled(&self, position: &[f64; MAX_DIMENSION]) -> SampledIntegral {
        let mut panels = self.first_panels(position);
        let mut points = points_of(&self.panels);
        let new_points = (POINTS - 1) * self.weights.len() / POINTS;
        loop {
            let error = self.error_of(&panels);
            // Panels with NaN do not count, as `max` ignores it.
            let largest = panels.iter().map(|panel| panel.error).fold(0.0, f64::max);
            let allowed = self.max_points_per_integral.saturating_sub(points) / new_points;
            if error <= self.allowed_error(&panels) || error.is_nan() || allowed == 0 {
                let found = self.integral(&panels, error);
                let error = error + self.unseen_part * found.moments[0].abs();
                let values = panels.iter().flat_map(|panel| &panel.values);
                let largest = values.fold(0.0, |largest, f| f64::max(largest, f.abs()));
                let integral = VelocityIntegral { error, ..found };
                return SampledIntegral { integral, points, largest };
            }
            let (mut open, mut k) = (Vec::new(), 0);
            while k < panels.len() && open.len() < allowed {
                if panels[k].error >= NEAR_LARGEST * largest {
                    open.push(panels.swap_remove(k))
                } else {
                    k += 1
                }
            }
            points += open.len() * new_points;
            panels.extend(self.halves(position, &open));
        }
    }

    /// The error of the density over `panels`: the sum of theirs where an error relative to the
    /// density is asked for, which holds for a jump across many panels. Otherwise the root of the
    /// sum of squares, as errors have either sign.
    fn error_of(&self, panels: &[VelocityPanel]) -> f64 {
        let errors = panels.iter().map(|panel| panel.error);
        if self.relative_tolerance > 0.0 {
            errors.sum()
        } else {
            errors.map(|error| error * error).sum::<f64>().sqrt()
        }
    }

    /// The error that the density over `panels` may have.
    fn allowed_error(&self, panels: &[VelocityPanel]) -> f64 {
        if self.relative_tolerance == 0.0 {
            return self.tolerance;
        }
        self.tolerance.max(self.relative_tolerance * self.integral(panels, 0.0).moments[0].abs())
    }

    /// The integral over `panels`.
    fn integral(&self, panels: &[VelocityPanel], error: f64) -> VelocityIntegral {
        let n = self.space.dimension();
        let mut moments = [0.0; MOMENTS];
        for panel in panels {
            let volume: f64 = panel.width[..n].iter().product();
            for (k, f) in panel.values.iter().enumerate() {
                add_mass(&mut moments, &self.velocity(panel, k), volume * self.weights[k] * f);
            }
        }
        VelocityIntegral { moments, error }
    }

    /// `∫ |f| dv` at a position, by the first panels.
    pub fn size_at(&self, position: &[f64; MAX_DIMENSION]) -> f64 {
        let n = self.space.dimension();
        let size = |panel: &VelocityPanel| -> f64 {
            let volume: f64 = panel.width[..n].iter().product();
            let values = panel.values.iter().zip(&self.weights);
            values.map(|(f, weight)| volume * weight * f.abs()).sum()
        };
        self.first_panels(position).iter().map(size).sum()
    }

    /// Distance in `values` between neighbouring points of a panel along an axis.
    fn stride(&self, axis: usize) -> usize {
        POINTS.pow((self.space.dimension() - 1 - axis) as u32)
    }

    /// The velocity at point `k` of a panel.
    fn velocity(&self, panel: &VelocityPanel, k: usize) -> [f64; MAX_DIMENSION] {
        let mut velocity = [0.0; MAX_DIMENSION];
        for (a, v) in velocity.iter_mut().enumerate().take(self.space.dimension()) {
            let step = (k / self.stride(a) % POINTS) as f64 / (POINTS - 1) as f64;
            *v = panel.lower[a] + panel.width[a] * step;
        }
        velocity
    }

    /// The velocity box in equal panels; neighbours share the points of their common sides.
    fn first_panels(&self, position: &[f64; MAX_DIMENSION]) -> Vec<VelocityPanel> {
        let axes = &self.space.v;
        let counts: Vec<usize> = self.panels.iter().map(|n| (POINTS - 1) * n + 1).collect();
        let mut points = Vec::with_capacity(points_of(&self.panels));
        for_each_cell(&counts.iter().map(|&n| 0..n).collect::<Vec<_>>(), |k| {
            let mut velocity = [0.0; MAX_DIMENSION];
            for (a, axis) in axes.iter().enumerate() {
                let part = k[a] as f64 / (counts[a] - 1) as f64;
                velocity[a] = axis.lower + (axis.upper - axis.lower) * part;
            }
            points.push(phase_point(position, velocity));
        });
        let values = self.values_of.values_at(&points, self.time);
        let mut panels = Vec::new();
        for_each_cell(&self.panels.iter().map(|&n| 0..n).collect::<Vec<_>>(), |j| {
            let (mut lower, mut width) = ([0.0; MAX_DIMENSION], [0.0; MAX_DIMENSION]);
            for (a, axis) in axes.iter().enumerate() {
                width[a] = (axis.upper - axis.lower) / self.panels[a] as f64;
                lower[a] = axis.lower + width[a] * j[a] as f64;
            }
            let value = |k: usize| {
                let along = |a: usize| (POINTS - 1) * j[a] + k / self.stride(a) % POINTS;
                values[number(counts.iter().copied(), (0..axes.len()).map(along))]
            };
            panels.push(self.panel(lower, width, (0..self.weights.len()).map(value).collect()));
        });
        panels
    }

    /// A panel with the values `values` at its points.
    fn panel(
        &self,
        lower: [f64; MAX_DIMENSION],
        width: [f64; MAX_DIMENSION],
        values: Vec<f64>,
    ) -> VelocityPanel {
        let n = self.space.dimension();
        let volume: f64 = width[..n].iter().product();
        let mut errors = [0.0; MAX_DIMENSION];
        for (a, error) in errors.iter_mut().enumerate().take(n) {
            let stride = self.stride(a);
            let first = |k: &usize| (k / stride).is_multiple_of(POINTS);
            for k in (0..values.len()).filter(first) {
                let line: [f64; POINTS] = std::array::from_fn(|d| values[k + d * stride]);
                *error += volume * self.weights[k] / BOOLE[0] * self.line_error(&line);
            }
        }
        let axis = (1..n).fold(0, |most, a| if errors[a] > errors[most] { a } else { most });
        VelocityPanel { lower, width, values, error: errors.iter().sum(), axis }
    }

    /// The error of Boole's rule on a line of a panel, as a mean over it.
    ///
    /// `|Boole − Simpson|` is that of Simpson's rule. For a formula, which is cheap and often
    /// smooth, Romberg's sequence shows how fast errors fall: from `d` to `d' = |Simpson −
    /// trapezoids|` before, that of Boole's rule is about `d min(1, d/d')`. At a jump both are
    /// alike.
    fn line_error(&self, line: &[f64; POINTS]) -> f64 {
        let difference = |a: [f64; POINTS], b: [f64; POINTS]| -> f64 {
            (0..POINTS).map(|d| (a[d] - b[d]) * line[d]).sum::<f64>().abs()
        };
        let of_simpson = difference(BOOLE, SIMPSON);
        let of_trapezoids = difference(SIMPSON, TRAPEZOIDS);
        if self.values_of.are_given() && of_simpson < of_trapezoids {
            of_simpson * of_simpson / of_trapezoids
        } else {
            of_simpson
        }
    }

    /// The halves of `panels` at `position`, each across its axis.
    fn halves(
        &self,
        position: &[f64; MAX_DIMENSION],
        panels: &[VelocityPanel],
    ) -> Vec<VelocityPanel> {
        let whole = |panel: &VelocityPanel| {
            let (mut lower, mut width) = (panel.lower, panel.width);
            width[panel.axis] *= 0.5;
            lower[panel.axis] += width[panel.axis];
            [panel.lower, lower].map(|lower| VelocityPanel {
                lower,
                width,
                values: vec![],
                ..*panel
            })
        };
        let step = |panel: &VelocityPanel, k: usize| k / self.stride(panel.axis) % POINTS;
        let is_new = |panel: &VelocityPanel, k: usize| step(panel, k) % 2 == 1;
        let halves: Vec<[VelocityPanel; 2]> = panels.iter().map(whole).collect();
        let mut points = Vec::new();
        for half in halves.iter().flatten() {
            let new = (0..self.weights.len()).filter(|&k| is_new(half, k));
            points.extend(new.map(|k| phase_point(position, self.velocity(half, k))));
        }
        let mut new = self.values_of.values_at(&points, self.time).into_iter();
        let mut found = Vec::with_capacity(2 * panels.len());
        for (panel, halves) in panels.iter().zip(halves) {
            for (h, half) in halves.into_iter().enumerate() {
                let stride = self.stride(panel.axis);
                let value = |k: usize| {
                    if is_new(panel, k) {
                        new.next().unwrap_or(f64::NAN)
                    } else {
                        let d = step(panel, k);
                        panel.values[k - d * stride + (h * (POINTS - 1) / 2 + d / 2) * stride]
                    }
                };
                let values = (0..self.weights.len()).map(value).collect();
                found.push(self.panel(half.lower, half.width, values));
            }
        }
        found
    }
}
