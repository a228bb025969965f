//! Distances to the exact solution: of `f`, density and momentum, absolute and relative.
//!
//! For degree 0 they are sums over cells. For higher degrees they are integrals of the polynomials
//! over each element by Gauss's rule, with more points than nodes: at the nodes a Galerkin scheme
//! is more accurate than in between. The exact density and momentum are [`VelocityIntegrals`].

use crate::base::error::Result;
use crate::base::quadrature::{QuadraturePoint, gauss_legendre};
use crate::matrix::elements::{Element, apply_along_all, for_each_element};
use crate::matrix::observables::{CellVolumes, Moments};
use crate::parallel::communicator::Group;
use crate::problem::case::{Case, Exact};
use crate::problem::grid::{Axis, MAX_DIMENSION, PhaseSpace};
use crate::results::summary::{ErrorNorms, GridErrors};
use crate::run::exact::solution::ExactValues;
use crate::run::exact::velocities::VelocityIntegrals;
use crate::run::exact::velocities::limits::expected_points;
use std::ops::Range;

/// Additional points of an element along each axis, and the largest total number of points for
/// which they are used.
const MORE_POINTS: [(usize, f64); 3] = [(3, 2e7), (1, 1e8), (0, f64::INFINITY)];

/// Number of [`norm_terms`].
const NORMS: usize = 4;
/// Terms of an element of space: three times the norms, and the exact mass.
const TERMS: usize = 3 * NORMS + 1;
/// Numbers summed at a point of space: density, momenta.
const SUMS: usize = 1 + MAX_DIMENSION;

/// Values of a function of space and the exact ones, at the points of a rank's share.
type Pair<'a> = (&'a Vec<f64>, &'a Vec<f64>);

/// Norms over space of the differences of `pairs`, summed over the pairs. Collective.
pub fn over_space(world: &Group, volumes: &CellVolumes, pairs: &[Pair<'_>]) -> ErrorNorms {
    let terms = |c: usize| {
        let mut sums = [0.0; NORMS];
        for (a, b) in pairs {
            sums.iter_mut().zip(norm_terms(a[c], b[c])).for_each(|(sum, term)| *sum += term);
        }
        sums
    };
    ErrorNorms::of_sums(volumes.integrals(world, terms))
}

/// Errors of a field of degree 0 whose distance to the exact one is `field`, on the cells of
/// `volumes`. Collective.
pub fn by_cells(
    world: &Group,
    volumes: &CellVolumes,
    field: ErrorNorms,
    found: &Moments,
    exact: &Moments,
) -> GridErrors {
    let density = over_space(world, volumes, &[(&found.density, &exact.density)]);
    let momenta: Vec<Pair<'_>> = found.momentum.iter().zip(&exact.momentum).collect();
    let momentum = over_space(world, volumes, &momenta);
    GridErrors { field: Some(field), density, momentum: Some(momentum), exact_mass: None }
}

/// Errors of the field `f` of a degree above 0 on a rank's `share` of space, as integrals over
/// elements. Collective.
///
/// # Errors
/// If `V` is not finite.
pub fn by_elements(
    world: &Group,
    case: &Case,
    exact: &Exact,
    share: &[Range<usize>],
    f: &[f64],
) -> Result<GridErrors> {
    let values_of = ExactValues::new(world, case, exact)?;
    let mut sums = ElementSums::new(world, case, &values_of);
    for_each_element(&case.space, share, |element| {
        sums.add(element, &element.nodal(share, f));
    });
    Ok(sums.finish(world))
}

/// Points of the rules along all axes of the elements of `space`, with this many `more` than nodes.
fn points(space: &PhaseSpace, more: usize) -> f64 {
    space.axes().map(|a| (a.elements() * (a.nodes.count() + more)) as f64).product()
}

/// Additional points of an element of `space` along each axis.
fn more_points(space: &PhaseSpace) -> usize {
    let fits = |&&(more, most): &&(usize, f64)| points(space, more) <= most;
    MORE_POINTS.iter().find(fits).map_or(0, |m| m.0)
}

/// About the largest number of exact values of which errors on the elements of `case` are made.
pub fn exact_points(case: &Case) -> f64 {
    let more = more_points(&case.space);
    let of_space = |axis: &Axis| (axis.elements() * (axis.nodes.count() + more)) as f64;
    let positions = case.space.x.iter().map(of_space).product();
    points(&case.space, more) + expected_points(case, positions)
}

/// Quadrature rules of an element, and sums over elements.
struct ElementSums<'a> {
    case: &'a Case,
    values_of: &'a ExactValues<'a>,
    /// Density and momentum of the exact solution.
    integrals: VelocityIntegrals<'a>,
    /// Points of each axis.
    points: Vec<Vec<f64>>,
    /// Weights of the points times half the element's width.
    weights: Vec<Vec<f64>>,
    /// Interpolation from nodes to points, by axis.
    matrices: Vec<Vec<Vec<f64>>>,
    /// Points of space and of velocity in an element.
    counts: [usize; 2],
    /// The element of space whose velocities are being summed.
    index: Option<Vec<usize>>,
    /// Sums over velocities at the points of that element.
    here: Vec<[f64; SUMS]>,
    /// Terms by element of space: norms of `f`, density, momentum; the exact mass.
    terms: Vec<[f64; TERMS]>,
    /// Norms of `f` on that element.
    field: [f64; NORMS],
}

/// `|a − b|`, `(a − b)²`, `|b|`, `b²`.
pub fn norm_terms(a: f64, b: f64) -> [f64; NORMS] {
    [(a - b).abs(), (a - b) * (a - b), b.abs(), b * b]
}

impl<'a> ElementSums<'a> {
    /// Empty sums. Collective: the largest exact density is needed.
    fn new(world: &Group, case: &'a Case, values_of: &'a ExactValues<'a>) -> Self {
        let space = &case.space;
        let more = more_points(space);
        let rules: Vec<Vec<QuadraturePoint>> =
            space.axes().map(|a| gauss_legendre(a.nodes.count() + more)).collect();
        let points: Vec<Vec<f64>> =
            rules.iter().map(|rule| rule.iter().map(|p| p.node).collect()).collect();
        let weights = (space.axes().zip(&rules))
            .map(|(axis, rule)| rule.iter().map(|p| 0.5 * axis.width() * p.weight).collect())
            .collect();
        let matrices = (space.axes().zip(&points))
            .map(|(axis, points)| {
                points.iter().map(|x| axis.nodes.reference().values_at(*x)).collect()
            })
            .collect();
        let n = space.dimension();
        let count = |axes: &[Vec<f64>]| axes.iter().map(Vec::len).product();
        let counts = [count(&points[..n]), count(&points[n..])];
        let elements: usize = space.x.iter().map(Axis::elements).product();
        let places = elements * counts[0];
        Self {
            case,
            values_of,
            integrals: VelocityIntegrals::new(world, values_of, case, case.end, places),
            points,
            weights,
            matrices,
            counts,
            index: None,
            here: vec![[0.0; SUMS]; counts[0]],
            terms: Vec::new(),
            field: [0.0; NORMS],
        }
    }

    /// Adds an element with the values `nodal` at its nodes.
    fn add(&mut self, element: &Element<'_>, nodal: &[f64]) {
        let n = self.case.space.dimension();
        let index = element.index[..n].to_vec();
        if self.index.as_ref() != Some(&index) {
            self.flush();
            self.index = Some(index);
        }
        let found = apply_along_all(nodal, &self.matrices);
        let exact = self.values_of.values_at(&element.points(&self.points), self.case.end);
        let space_weights = products(&self.weights[..n]);
        let velocity_weights = products(&self.weights[n..]);
        let velocities = self.velocities(element);
        for (q, space_weight) in space_weights.iter().enumerate() {
            for (r, velocity_weight) in velocity_weights.iter().enumerate() {
                let at = q * self.counts[1] + r;
                let pair = [found[at], exact[at]];
                for (sum, term) in self.field.iter_mut().zip(norm_terms(pair[0], pair[1])) {
                    *sum += space_weight * velocity_weight * term;
                }
                self.here[q][0] += velocity_weight * found[at];
                for (a, v) in velocities[r].iter().enumerate().take(n) {
                    self.here[q][1 + a] += velocity_weight * found[at] * v;
                }
            }
        }
    }

    /// Velocities at the points of an element.
    fn velocities(&self, element: &Element<'_>) -> Vec<[f64; MAX_DIMENSION]> {
        let n = self.case.space.dimension();
        let mut points = self.points.clone();
        points[..n].iter_mut().for_each(|axis| axis.truncate(1));
        element.points(&points).into_iter().map(|[.., u, v, w]| [u, v, w]).collect()
    }

    /// Adds the terms of the element of space whose velocities were summed.
    fn flush(&mut self) {
        let Some(element) = self.index.take() else {
            return;
        };
        let n = self.case.space.dimension();
        let places = self.case.space.points_in(&element, &self.points[..n]);
        let (mut sums, mut mass) = ([[0.0; NORMS]; 2], 0.0);
        let weights = products(&self.weights[..n]);
        for ((here, place), weight) in self.here.iter().zip(places).zip(weights) {
            let [x, y, z, ..] = place;
            let exact = self.integrals.at(&[x, y, z]).moments;
            mass += weight * exact[0];
            for k in 0..=n {
                let terms = norm_terms(here[k], exact[k]);
                for (sum, term) in sums[usize::from(k > 0)].iter_mut().zip(terms) {
                    *sum += weight * term;
                }
            }
        }
        let mut terms = [0.0; TERMS];
        let all = [std::mem::take(&mut self.field), sums[0], sums[1]];
        terms[..3 * NORMS].copy_from_slice(all.as_flattened());
        terms[3 * NORMS] = mass;
        self.terms.push(terms);
        self.here.fill([0.0; SUMS]);
    }

    /// The norms over all elements. Collective.
    fn finish(mut self, world: &Group) -> GridErrors {
        self.flush();
        let elements = world.sum_count(self.terms.len());
        let sums = world.sum_lanes(elements, self.terms.iter().copied());
        let norms =
            |k: usize| ErrorNorms::of_sums(std::array::from_fn(|norm| sums[NORMS * k + norm]));
        let [field, density, momentum] = [0, 1, 2].map(norms);
        let exact_mass = Some(sums[3 * NORMS]).filter(|mass| mass.is_finite());
        GridErrors { field: Some(field), density, momentum: Some(momentum), exact_mass }
    }
}

/// The products of one weight of each axis, the last axis fastest.
fn products(weights: &[Vec<f64>]) -> Vec<f64> {
    let mut products = vec![1.0];
    for axis in weights {
        products = products.iter().flat_map(|p| axis.iter().map(move |w| p * w)).collect();
    }
    products
}
