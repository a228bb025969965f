//! Integrals of the exact solution over the velocities, in one dimension.
//!
//! Where particles pass jumps of `V`, the exact solution jumps along the velocities, and slow ones
//! leave filaments that are far narrower than an element. A rule of fixed points, however many an
//! element has, is wrong by as much as the run it is compared with. So the velocity axis is divided
//! where halves of a panel do not add up to the whole.

use crate::base::quadrature::{QuadraturePoint, gauss_legendre};
use crate::matrix::observables::MOMENTS;
use crate::parallel::communicator::Group;
use crate::problem::case::Case;
use crate::problem::grid::Axis;
use crate::run::exact::Exactly;
use std::ops::Range;

/// Panels of the velocity axis to begin with.
const PANELS: usize = 64;
/// Gauss's points in a panel.
const POINTS: usize = 4;
/// Points across a cell of space over which moments are averaged.
const ACROSS: usize = 2;
/// A panel is divided where its halves change the density by more than this part of the largest.
const TOLERANCE: f64 = 1e-5;
/// A panel is left as it is where all of it is less than this part of the tolerance.
const NOTHING: f64 = 0.01;
/// Most times that a panel is halved.
const MOST_HALVINGS: usize = 20;

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
        Some(Self { exactly, time, ends, rule: gauss_legendre(POINTS) })
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

    /// The integrals over `panels` at `x`, which are halved until halves change the density by no
    /// more than `tolerance`.
    fn refined(&self, x: f64, panels: Vec<Panel>, tolerance: f64) -> [f64; 3] {
        let mut total = [0.0; 3];
        let mut add = |moments: [f64; 3]| {
            total.iter_mut().zip(moments).for_each(|(sum, term)| *sum += term);
        };
        let (nothing, mut open): (Vec<Panel>, Vec<Panel>) =
            panels.into_iter().partition(|panel| panel.size <= NOTHING * tolerance);
        nothing.iter().for_each(|panel| add(panel.moments));
        for halving in 1..=MOST_HALVINGS {
            let halves = |panel: &Panel| {
                let [lower, upper] = panel.ends;
                let middle = 0.5 * (lower + upper);
                [[lower, middle], [middle, upper]]
            };
            let ends: Vec<[f64; 2]> = open.iter().flat_map(halves).collect();
            let halves = self.integrals(x, &ends);
            let mut unsettled = Vec::new();
            for (whole, halves) in open.iter().zip(halves.chunks_exact(2)) {
                let change = halves[0].moments[0] + halves[1].moments[0] - whole.moments[0];
                match change.abs() > tolerance && halving < MOST_HALVINGS {
                    true => unsettled.extend_from_slice(halves),
                    false => halves.iter().for_each(|half| add(half.moments)),
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
