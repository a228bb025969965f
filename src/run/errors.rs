//! Distances to the exact solution: of `f`, density and momentum, absolute and relative.
//!
//! For degree 0 they are sums over cells. For higher degrees they are integrals of the polynomials
//! over each element by Gauss's rule, with more points than nodes: at the nodes a Galerkin scheme
//! is more accurate than in between. Elements in which a region of `V` begins or ends are cut
//! there, as the exact density may jump. The exact density and momentum are [`VelocityIntegrals`].

use crate::base::error::Result;
use crate::base::progress::Progress;
use crate::base::quadrature::gauss_legendre;
use crate::matrix::elements::{Element, apply_along_all, for_each_element, products};
use crate::matrix::observables::{CellVolumes, Moments};
use crate::parallel::communicator::Group;
use crate::problem::case::{Case, Exact};
use crate::problem::grid::{Axis, MAX_DIMENSION, PhaseSpace};
use crate::problem::potential::oblique::oblique_edges;
use crate::problem::potential::region_edges;
use crate::results::summary::{ErrorNorms, GridErrors};
use crate::run::exact::WITHOUT_EXACT_SOLUTION;
use crate::run::exact::solution::ExactValues;
use crate::run::exact::velocities::VelocityIntegrals;
use crate::run::exact::velocities::limits::expected_points;
use std::collections::BTreeMap;
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

/// The result on a rank's share of the user's grid.
pub struct ResultOnShare<'a> {
    /// The group of all ranks.
    pub world: &'a Group,
    /// The case on the grid of the results.
    pub case: &'a Case,
    /// Space cells of this rank, one range for each x-axis.
    pub share: &'a [Range<usize>],
    /// Volumes of the share's cells.
    pub volumes: &'a CellVolumes,
    /// The first field.
    pub field: &'a [f64],
    /// Its moments.
    pub moments: &'a Moments,
}

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

/// Errors of the `result` of degree 0, whose field has the distance `field` to the exact one.
/// Collective.
pub fn by_cells(result: &ResultOnShare<'_>, field: ErrorNorms, exact: &Moments) -> GridErrors {
    let ResultOnShare { world, volumes, moments: found, .. } = *result;
    let density = over_space(world, volumes, &[(&found.density, &exact.density)]);
    let momenta: Vec<Pair<'_>> = found.momentum.iter().zip(&exact.momentum).collect();
    let momentum = over_space(world, volumes, &momenta);
    GridErrors { field: Some(field), density, momentum: Some(momentum), exact_mass: None }
}

/// Errors of the field of a `result` of a degree above 0, as integrals over elements. A rank that
/// `prints` reports the progress. Collective.
///
/// # Errors
/// If `V` is not finite.
pub fn by_elements(result: &ResultOnShare<'_>, exact: &Exact, prints: bool) -> Result<GridErrors> {
    let ResultOnShare { world, case, share, field, .. } = *result;
    let values_of = ExactValues::new(world, case, exact)?;
    let mut sums = ElementSums::new(world, case, &values_of);
    let velocities: usize = case.space.v.iter().map(Axis::elements).product();
    let nodes: usize = case.space.x.iter().map(|axis| axis.nodes.count()).product();
    let of_share: usize = share.iter().map(Range::len).product();
    let all = of_share / nodes * velocities;
    let mut progress =
        Progress::new(prints, "exact errors", all).with_remedy(WITHOUT_EXACT_SOLUTION);
    for_each_element(&case.space, share, |element| {
        sums.add(element, &element.nodal(share, field));
        progress.advance(1);
    });
    progress.finish();
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

/// The edges at which elements are cut, by axis; none along velocities. None at all if an edge is
/// oblique or curved: the exact solution meets a staircase of faces there, as the scheme does.
fn edges_within_elements(case: &Case) -> impl Iterator<Item = Vec<f64>> {
    let are_planes = oblique_edges(case).is_empty();
    let edges = if are_planes { region_edges(case) } else { Vec::new() };
    edges.into_iter().map(Option::unwrap_or_default).chain(std::iter::repeat(Vec::new()))
}

/// A quadrature rule of an element along an axis.
struct LineRule {
    /// Points on `[−1, 1]`.
    points: Vec<f64>,
    /// Weights of the points times half the element's width.
    weights: Vec<f64>,
    /// Interpolation from nodes to points.
    matrix: Vec<Vec<f64>>,
}

impl LineRule {
    /// Gauss's rule with `count` points in each part of an element of `axis` that is cut at the
    /// ascending `cuts` in `(−1, 1)`.
    fn new(axis: &Axis, count: usize, cuts: &[f64]) -> Self {
        let ends: Vec<f64> = [&[-1.0], cuts, &[1.0]].concat();
        let (mut points, mut weights) = (Vec::new(), Vec::new());
        for part in ends.windows(2) {
            let [centre, half] = [0.5 * (part[0] + part[1]), 0.5 * (part[1] - part[0])];
            for point in gauss_legendre(count) {
                points.push(centre + half * point.node);
                weights.push(0.5 * axis.width() * half * point.weight);
            }
        }
        let matrix = points.iter().map(|x| axis.nodes.reference().values_at(*x)).collect();
        Self { points, weights, matrix }
    }
}

/// The quadrature rules of the elements along an axis.
struct ElementRules {
    /// The rule of whole elements.
    whole: LineRule,
    /// The rules of the elements that are cut.
    cut: BTreeMap<usize, LineRule>,
}

impl ElementRules {
    /// Rules with `count` points in a whole element, or in a part of one between `edges`.
    fn new(axis: &Axis, count: usize, edges: &[f64]) -> Self {
        /// A cut closer to a face, in halves of an element, is on the face.
        const ON_FACE: f64 = 1e-6;
        /// An element with more cuts is not cut: its parts would take too many points.
        const MOST_CUTS: usize = 3;
        let mut cuts: BTreeMap<usize, Vec<f64>> = BTreeMap::new();
        for edge in edges {
            let from_lower = (edge - axis.lower) / axis.width();
            let element = from_lower as usize;
            let at = 2.0 * (from_lower - element as f64) - 1.0;
            if at.abs() < 1.0 - ON_FACE {
                cuts.entry(element).or_default().push(at);
            }
        }
        let rule = |(element, mut cuts): (usize, Vec<f64>)| {
            cuts.sort_by(f64::total_cmp);
            (element, LineRule::new(axis, count, &cuts))
        };
        let few = cuts.into_iter().filter(|(_, cuts)| cuts.len() <= MOST_CUTS);
        let cut = few.map(rule).collect();
        Self { whole: LineRule::new(axis, count, &[]), cut }
    }

    fn of(&self, element: usize) -> &LineRule {
        self.cut.get(&element).unwrap_or(&self.whole)
    }
}

/// Quadrature rules of the elements, and sums over elements.
struct ElementSums<'a> {
    case: &'a Case,
    values_of: &'a ExactValues<'a>,
    /// Density and momentum of the exact solution.
    integrals: VelocityIntegrals<'a>,
    /// The rules of each axis.
    rules: Vec<ElementRules>,
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
        let rules = (space.axes().zip(edges_within_elements(case)))
            .map(|(axis, edges)| ElementRules::new(axis, axis.nodes.count() + more, &edges))
            .collect();
        let places = space.x.iter().map(|a| a.elements() * (a.nodes.count() + more)).product();
        Self {
            case,
            values_of,
            integrals: VelocityIntegrals::new(world, values_of, case, case.end, places),
            rules,
            index: None,
            here: Vec::new(),
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
        let rules = self.rules_of(&element.index);
        let space_weights = weights(&rules[..n]);
        let velocity_weights = weights(&rules[n..]);
        let found = apply_along_all(nodal, rules.iter().map(|rule| &rule.matrix));
        let points: Vec<&[f64]> = rules.iter().map(|rule| &rule.points[..]).collect();
        let exact = self.values_of.values_at(&element.points(&points), self.case.end);
        let velocities = velocities(element, &points);
        self.here.resize(space_weights.len(), [0.0; SUMS]);
        for (q, space_weight) in space_weights.iter().enumerate() {
            for (r, velocity_weight) in velocity_weights.iter().enumerate() {
                let at = q * velocity_weights.len() + r;
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

    /// The rules along the first axes of an element with this `index`.
    fn rules_of(&self, index: &[usize]) -> Vec<&LineRule> {
        self.rules.iter().zip(index).map(|(rules, element)| rules.of(*element)).collect()
    }

    /// Adds the terms of the element of space whose velocities were summed.
    fn flush(&mut self) {
        let Some(element) = self.index.take() else {
            return;
        };
        let n = self.case.space.dimension();
        let rules = self.rules_of(&element);
        let points: Vec<&[f64]> = rules.iter().map(|rule| &rule.points[..]).collect();
        let places = self.case.space.points_in(&element, &points);
        let (mut sums, mut mass) = ([[0.0; NORMS]; 2], 0.0);
        let weights = weights(&rules);
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
        self.here.clear();
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

/// The velocities of the product of the `points` along all axes of an element.
fn velocities(element: &Element<'_>, points: &[&[f64]]) -> Vec<[f64; MAX_DIMENSION]> {
    let n = points.len() / 2;
    let one_place: Vec<&[f64]> =
        points.iter().enumerate().map(|(a, p)| if a < n { &p[..1] } else { p }).collect();
    element.points(&one_place).into_iter().map(|[.., u, v, w]| [u, v, w]).collect()
}

/// The products of one weight of each rule, the last one fastest.
fn weights(rules: &[&LineRule]) -> Vec<f64> {
    products(rules.iter().map(|rule| &rule.weights[..]))
}
