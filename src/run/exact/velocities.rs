//! Integrals of the exact solution over the velocities, in one dimension.
//!
//! Where particles pass jumps of `V`, the exact solution jumps along the velocities, and slow ones
//! leave filaments that are far narrower than an element. A rule of fixed points, however many an
//! element has, is wrong by as much as the run it is compared with. So the velocity axis is divided
//! where the two parts of a panel do not add up to the whole.

use crate::base::quadrature::{QuadraturePoint, gauss_legendre, gauss_lobatto};
use crate::matrix::observables::MOMENTS;
use crate::parallel::communicator::Group;
use crate::problem::case::Case;
use crate::problem::grid::Axis;
use crate::run::exact::solution::Exactly;
use std::ops::Range;

/// Panels of the velocity axis to begin with.
const PANELS: usize = 64;
/// Points of Lobatto's rule in a panel: with its ends, between which no jump is overlooked.
const POINTS: usize = 5;
/// Points across a cell of space over which moments are averaged.
const ACROSS: usize = 2;
/// A panel is divided where that changes the density by more than this part of the largest.
const TOLERANCE: f64 = 1e-5;
/// A panel is left as it is where all of it is less than this part of the tolerance.
const NOTHING: f64 = 0.01;
/// The lower part of a panel that is divided. In halves, a jump near the middle would leave the sum
/// as it was: half of the weights are below it before and after. Here the sums of weights below any
/// place differ by 0.02 at least.
const LOWER_PART: f64 = 0.44;
/// Most times that a panel is divided.
const MOST_DIVISIONS: usize = 24;

/// A part of the velocity axis, with `∫ (1, v, ½v²) f dv` and `∫ |f| dv` over it.
#[derive(Clone, Copy)]
struct Panel {
    ends: [f64; 2],
    moments: [f64; 3],
    size: f64,
}

/// The exact solution at a time, to be integrated over the velocity box.
pub struct VelocityIntegrals<'a> {
    exactly: &'a Exactly<'a>,
    time: f64,
    ends: [f64; 2],
    rule: Vec<QuadraturePoint>,
}

impl<'a> VelocityIntegrals<'a> {
    /// Of the exact solution of `case` at `time`; none in more than one dimension.
    pub fn new(exactly: &'a Exactly<'a>, case: &Case, time: f64) -> Option<Self> {
        let [axis] = &case.space.v[..] else { return None };
        let ends = [axis.lower, axis.upper];
        Some(Self { exactly, time, ends, rule: gauss_lobatto(POINTS) })
    }

    /// Density, momentum and kinetic energy at the points of space `places`, as [`MOMENTS`] has
    /// them. Collective over `world` (the largest density).
    pub fn at(&self, world: &Group, places: &[f64]) -> Vec<[f64; MOMENTS]> {
        let coarse: Vec<Vec<Panel>> = places.iter().map(|&x| self.panels(x)).collect();
        let size = |panels: &Vec<Panel>| panels.iter().map(|panel| panel.size).sum::<f64>();
        let largest = world.max(coarse.iter().map(size).fold(0.0, f64::max));
        let refined = |(panels, &x)| {
            let [density, momentum, energy] = self.refined(x, panels, TOLERANCE * largest);
            [density, momentum, 0.0, 0.0, energy]
        };
        coarse.into_iter().zip(places).map(refined).collect()
    }

    /// Density, momentum and kinetic energy at the nodes `nodes` of `axis`; of degree 0 averages
    /// over its cells. Collective over `world`.
    pub fn on_axis(&self, world: &Group, axis: &Axis, nodes: Range<usize>) -> Vec<[f64; MOMENTS]> {
        if axis.nodes.degree > 0 {
            let places: Vec<f64> = nodes.map(|j| axis.inner_centre(j as i64)).collect();
            return self.at(world, &places);
        }
        let rule = gauss_legendre(ACROSS);
        let across = |j| rule.iter().map(move |point| axis.at(j as i64, point.node));
        let places: Vec<f64> = nodes.flat_map(across).collect();
        let average = |points: &[[f64; MOMENTS]]| {
            let mean = |k: usize| -> f64 {
                rule.iter().zip(points).map(|(at, moments)| 0.5 * at.weight * moments[k]).sum()
            };
            std::array::from_fn(mean)
        };
        self.at(world, &places).chunks_exact(ACROSS).map(average).collect()
    }

    /// The velocity axis at `x` in equal panels.
    fn panels(&self, x: f64) -> Vec<Panel> {
        let [lower, upper] = self.ends;
        let end = |k: usize| lower + (upper - lower) * k as f64 / PANELS as f64;
        let ends: Vec<[f64; 2]> = (0..PANELS).map(|k| [end(k), end(k + 1)]).collect();
        self.integrals(x, &ends)
    }

    /// The panels between these ends at `x`.
    fn integrals(&self, x: f64, ends: &[[f64; 2]]) -> Vec<Panel> {
        let places: Vec<QuadraturePoint> = (ends.iter())
            .flat_map(|ends| self.rule.iter().map(|point| point.moved_to(*ends)))
            .collect();
        let points: Vec<[f64; 6]> =
            places.iter().map(|place| [x, 0.0, 0.0, place.node, 0.0, 0.0]).collect();
        let values = self.exactly.values_at(&points, self.time);
        let panel = |(&ends, (places, values)): (&[f64; 2], (&[QuadraturePoint], &[f64]))| {
            let mut panel = Panel { ends, moments: [0.0; 3], size: 0.0 };
            for (place, f) in places.iter().zip(values) {
                let (v, term) = (place.node, place.weight * f);
                let terms = [term, v * term, 0.5 * v * v * term];
                panel.moments.iter_mut().zip(terms).for_each(|(sum, term)| *sum += term);
                panel.size += term.abs();
            }
            panel
        };
        let each = places.chunks_exact(POINTS).zip(values.chunks_exact(POINTS));
        ends.iter().zip(each).map(panel).collect()
    }

    /// The integrals over `panels` at `x`, which are divided until that changes the density by no
    /// more than `tolerance`.
    fn refined(&self, x: f64, panels: Vec<Panel>, tolerance: f64) -> [f64; 3] {
        let mut total = [0.0; 3];
        let mut add = |moments: [f64; 3]| {
            total.iter_mut().zip(moments).for_each(|(sum, term)| *sum += term);
        };
        let (nothing, mut open): (Vec<Panel>, Vec<Panel>) =
            panels.into_iter().partition(|panel| panel.size <= NOTHING * tolerance);
        nothing.iter().for_each(|panel| add(panel.moments));
        for division in 1..=MOST_DIVISIONS {
            let divided = |panel: &Panel| {
                let [lower, upper] = panel.ends;
                let between = lower + LOWER_PART * (upper - lower);
                [[lower, between], [between, upper]]
            };
            let ends: Vec<[f64; 2]> = open.iter().flat_map(divided).collect();
            let parts = self.integrals(x, &ends);
            let mut unsettled = Vec::new();
            for (whole, parts) in open.iter().zip(parts.chunks_exact(2)) {
                let change = parts[0].moments[0] + parts[1].moments[0] - whole.moments[0];
                match change.abs() > tolerance && division < MOST_DIVISIONS {
                    true => unsettled.extend_from_slice(parts),
                    false => parts.iter().for_each(|part| add(part.moments)),
                }
            }
            if unsettled.is_empty() {
                break;
            }
            open = unsettled;
        }
        total
    }
}
