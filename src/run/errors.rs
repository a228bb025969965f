//! Distances to the exact solution: of `f`, density and momentum, absolute and relative.
//!
//! Of degree 0, sums over cells. Of a higher degree, integrals of the polynomials over each
//! element by Gauss's rule, with more points than nodes: nothing is compared at nodes only, where a
//! Galerkin scheme is better than in between.

use crate::base::error::Result;
use crate::base::quadrature::{QuadraturePoint, gauss_legendre};
use crate::matrix::elements::{Element, apply_along_all, for_each_element};
use crate::matrix::observables::{CellVolumes, Moments, VelocityFactors, moments};
use crate::matrix::projection::legendre_transform;
use crate::parallel::communicator::Group;
use crate::parallel::partition::LocalIndex;
use crate::problem::case::{Case, Data, Exact, Limiter};
use crate::problem::exact::Tracer;
use crate::problem::grid::{Cell, MAX_DIMENSION, Part, PhaseSpace};
use crate::results::summary::{ErrorNorms, GridErrors};
use crate::scheme::rows::Scheme;
use crate::solve::prepared::Prepared;
use std::ops::Range;

/// Points beyond the nodes of an element, along each axis, where that is no more than so many.
const MORE_POINTS: [(usize, f64); 3] = [(3, 2e7), (1, 1e8), (0, f64::INFINITY)];

/// Numbers summed at a point of space: density, momenta.
const SUMS: usize = 1 + MAX_DIMENSION;

/// A function of space and its exact values, at the points of a rank's share.
type Pair<'a> = (&'a Vec<f64>, &'a Vec<f64>);

/// Norms over space of the distances of `pairs`, summed over them. Collective.
pub fn over_space(world: &Group, volumes: &CellVolumes, pairs: &[Pair<'_>]) -> ErrorNorms {
    let sum = |k: usize| -> f64 {
        let of = |(a, b): &Pair<'_>| {
            let terms: Vec<f64> = a.iter().zip(*b).map(|(a, b)| norm_terms(*a, *b)[k]).collect();
            volumes.integral(world, &terms)
        };
        pairs.iter().map(of).sum()
    };
    let [l1, l2, exact_l1, exact_l2] = std::array::from_fn(sum);
    ErrorNorms { l1, l2: l2.sqrt(), exact_l1, exact_l2: exact_l2.sqrt() }
}

/// Errors of a field of degree 0 whose distance to `exact` is `field`. Collective.
pub fn by_cells(
    world: &Group,
    case: &Case,
    share: &[Range<usize>],
    field: ErrorNorms,
    found: &Moments,
    exact: &[f64],
) -> GridErrors {
    let volumes = &CellVolumes::new(&case.space, share);
    let exact = moments(world, case, share, &[exact]);
    let density = over_space(world, volumes, &[(&found.density, &exact.density)]);
    let momenta: Vec<Pair<'_>> = found.momentum.iter().zip(&exact.momentum).collect();
    let momentum = over_space(world, volumes, &momenta);
    GridErrors { field: Some(field), density, momentum: Some(momentum) }
}

/// Errors of the field `f` of a degree above 0 on a rank's `share` of space, in integrals over
/// elements. Collective.
///
/// # Errors
/// Where `V` is not finite.
pub fn by_elements(
    world: &Group,
    case: &Case,
    exact: &Exact,
    share: &[Range<usize>],
    f: &[f64],
) -> Result<GridErrors> {
    let tracer = match exact {
        Exact::Characteristics => Some(Tracer::new(case)),
        Exact::Formula(_) => None,
    };
    let tracer = world.agree(tracer.transpose())?;
    let value = |point: &[f64; 6]| match (&tracer, exact) {
        (Some(tracer), _) => tracer.value(point, case.end),
        (None, Exact::Formula(formula)) => formula.at_point(point, case.end),
        (None, Exact::Characteristics) => f64::NAN,
    };
    let mut sums = ElementSums::new(case);
    for_each_element(&case.space, share, |element| {
        let mut nodal = vec![0.0; element.shape().iter().product()];
        element.for_each_cell(share, |cell, node| nodal[node] = f[cell]);
        sums.add(element, &nodal, &value);
    });
    Ok(sums.finish(world))
}

/// Estimates of the relative L2 errors of the grid, of `f` and of the density, at the end of a run
/// without a solution to compare with; none where the discretisation gives no clue. Collective.
///
/// Of degree 0 the leading error is the numerical dissipation: `‖e‖ ≈ T ‖D f(T)‖` (the modified
/// equation of the upwind scheme), times a factor. Of a higher degree it is at most of the size of
/// the highest Legendre coefficients of each element, times another: an order less than the error
/// where data are smooth. How far both may be trusted is in docs/limits.md, and tested in
/// tests/cli/accuracy.rs.
///
/// # Errors
/// Where `V` is not finite.
pub fn estimated(prepared: &mut Prepared, f: &[f64]) -> Result<[Option<f64>; 2]> {
    let case = &prepared.case;
    // Of degree 0 what another flux than upwind does is dispersion.
    let central = case.space.degree() == 0 && case.flux < 1.0;
    let unknown = case.limiter != Limiter::None || !matches!(case.data, Data::Density) || central;
    let mixed = case.space.axes().any(|a| {
        let merged = matches!(a.part, Part::Merged { .. });
        (a.nodes.degree == 0) != (case.space.degree() == 0) && !merged
    });
    if unknown || mixed {
        return Ok([None; 2]);
    }
    let found = match case.space.degree() {
        0 => by_dissipation(prepared, f)?,
        _ => by_tails(prepared, f),
    };
    // Where nothing is left of the field there is no relative error.
    Ok(found.map(|e| Some(e).filter(|e| !e.is_nan()).map(|e| e.min(1.0))))
}

/// Error of degree 0 beside `T ‖D f(T)‖`.
const OF_DISSIPATION: f64 = 2.0;
/// Error of a higher degree beside the norm of the highest coefficients.
const OF_TAILS: f64 = 2.0;

/// `T ‖D f‖ / ‖f‖` with the numerical dissipation `D = Σ_a ½ |c_a| h_a ∂²/∂a²`, and the same of the
/// integrals over the velocities. Along an axis on which a cell is at an end of the box or at a
/// jump of `V`, nothing is added. Collective.
///
/// # Errors
/// Where `V` is not finite.
fn by_dissipation(prepared: &mut Prepared, f: &[f64]) -> Result<[f64; 2]> {
    let Prepared { case, communicator, place, system, .. } = prepared;
    let (space, block) = (&case.space, &system.matrix.block);
    let scheme = communicator.world.agree(Scheme::new(case, &block.wide_ranges()))?;
    // The block's field, of which the mode groups have a share each: as integers, zero elsewhere.
    let (cells, rows) = (block.cells(), system.matrix.rows());
    let mut bits = vec![0i64; cells];
    for (bits, f) in bits[place.mine.clone()].iter_mut().zip(f) {
        *bits = f.to_bits() as i64;
    }
    communicator.modes.sum_integers(&mut bits);
    let mut state = vec![0.0; system.matrix.length()];
    for (x, bits) in state.iter_mut().zip(bits) {
        *x = f64::from_bits(bits as u64);
    }
    let (own, ghosts) = state.split_at_mut(rows);
    system.exchange.start(own);
    system.exchange.finish(ghosts);
    let value = |cell: &Cell| match block.local(space.index(cell)) {
        Some(LocalIndex::Own(i)) => Some(state[i]),
        Some(LocalIndex::Ghost(g)) => Some(state[rows + g]),
        None => None,
    };
    let n = space.dimension();
    let along = |cell: &Cell, axis: usize| -> f64 {
        let next = |above: bool| -> Option<f64> {
            if axis < n {
                return scheme.plain_neighbour(cell, axis, above).and_then(|c| value(&c));
            }
            let mut cell = *cell;
            cell[axis] = if above { cell[axis] + 1 } else { cell[axis].checked_sub(1)? };
            (cell[axis] < space.v[axis - n].cells).then(|| value(&cell))?
        };
        let second = || Some(next(true)? - 2.0 * value(cell)? + next(false)?);
        match scheme.speed(cell, axis) {
            0.0 => 0.0,
            speed => 0.5 * speed.abs() * second().unwrap_or(0.0),
        }
    };
    let mut dissipated = Vec::with_capacity(cells);
    block.for_each_own(|global, _| {
        for v in 0..block.velocity_cells {
            let cell = space.cell(global + v);
            dissipated.push((0..2 * n).map(|axis| along(&cell, axis)).sum::<f64>());
        }
    });
    let volumes = CellVolumes::new(space, &place.share);
    let world = &communicator.world;
    let nv = space.velocity_cells();
    let norm = |f: &[f64]| volumes.power_sum(world, 2, |i| f[i]).sqrt();
    let density = |f: &[f64]| -> f64 {
        let squares = f.chunks(nv).map(|here| here.iter().sum::<f64>().powi(2));
        volumes.integral(world, &squares.collect::<Vec<_>>()).sqrt()
    };
    let scale = OF_DISSIPATION * case.end;
    let mine = &dissipated[place.mine.clone()];
    Ok([scale * norm(mine) / norm(f), scale * density(mine) / density(f)])
}

/// The norm of the highest Legendre coefficients beside that of all, of `f` and of its integral
/// over the velocities. Collective.
fn by_tails(prepared: &Prepared, f: &[f64]) -> [f64; 2] {
    let (space, share) = (&prepared.case.space, &prepared.place.share);
    let n = space.dimension();
    let world = &prepared.communicator.world;
    let all: Vec<Vec<Vec<f64>>> = space.axes().map(|a| legendre_transform(a.nodes)).collect();
    // `[all, highest]` of the squares of the coefficients, by element.
    let squares = |nodal: &[f64], transforms: &[Vec<Vec<f64>>]| -> [f64; 2] {
        let mut sums = [0.0; 2];
        for (at, c) in apply_along_all(nodal, transforms).into_iter().enumerate() {
            let (mut rest, mut norm, mut highest) = (at, 1.0, false);
            for transform in transforms.iter().rev() {
                let j = rest % transform.len();
                rest /= transform.len();
                norm /= (2 * j + 1) as f64;
                highest |= j > 0 && j + 1 == transform.len();
            }
            sums[0] += norm * c * c;
            sums[1] += if highest { norm * c * c } else { 0.0 };
        }
        sums
    };
    let mut field: [Vec<f64>; 2] = Default::default();
    for_each_element(space, share, |element| {
        let mut nodal = vec![0.0; element.shape().iter().product()];
        element.for_each_cell(share, |cell, node| nodal[node] = f[cell]);
        let found = squares(&nodal, &all);
        field.iter_mut().zip(found).for_each(|(list, sum)| list.push(sum));
    });
    let factors = VelocityFactors::new(space);
    let density: Vec<f64> = factors.at_points(f).map(|sums| sums[0]).collect();
    let of_space = PhaseSpace { v: Vec::new(), ..space.clone() };
    let mut moments: [Vec<f64>; 2] = Default::default();
    for_each_element(&of_space, share, |element| {
        let mut nodal = vec![0.0; element.shape().iter().product()];
        element.for_each_cell(share, |cell, node| nodal[node] = density[cell]);
        let found = squares(&nodal, &all[..n]);
        moments.iter_mut().zip(found).for_each(|(list, sum)| list.push(sum));
    });
    [field, moments]
        .map(|[all, highest]| OF_TAILS * (world.sum_terms(&highest) / world.sum_terms(&all)).sqrt())
}

/// Rules of an element, and sums over elements.
struct ElementSums<'a> {
    case: &'a Case,
    /// Points of each axis.
    points: Vec<Vec<f64>>,
    /// Their weights times half the element's width.
    weights: Vec<Vec<f64>>,
    /// Interpolation from nodes to points, by axis.
    matrices: Vec<Vec<Vec<f64>>>,
    /// Points of space and of velocity in an element.
    counts: [usize; 2],
    /// The element of space whose velocities are being summed.
    place: Option<Vec<usize>>,
    /// Sums over velocities at its points, of the field and of the exact one.
    here: [Vec<[f64; SUMS]>; 2],
    /// Terms by element of space: norms of `f`, density, momentum.
    terms: [[Vec<f64>; 4]; 3],
    /// Terms of the element of space whose velocities are being summed.
    field: [f64; 4],
}

/// `|a − b|`, `(a − b)²`, `|b|`, `b²`.
fn norm_terms(a: f64, b: f64) -> [f64; 4] {
    [(a - b).abs(), (a - b) * (a - b), b.abs(), b * b]
}

impl<'a> ElementSums<'a> {
    fn new(case: &'a Case) -> Self {
        let space = &case.space;
        let total = |more: usize| -> f64 {
            space.axes().map(|a| (a.elements() * (a.nodes.count() + more)) as f64).product()
        };
        let fits = |&&(more, most): &&(usize, f64)| total(more) <= most;
        let more = MORE_POINTS.iter().find(fits).map_or(0, |m| m.0);
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
        let here = [vec![[0.0; SUMS]; counts[0]], vec![[0.0; SUMS]; counts[0]]];
        Self {
            case,
            points,
            weights,
            matrices,
            counts,
            place: None,
            here,
            terms: Default::default(),
            field: [0.0; 4],
        }
    }

    /// Adds an element with the values `nodal` at its nodes.
    fn add(&mut self, element: &Element<'_>, nodal: &[f64], value: &impl Fn(&[f64; 6]) -> f64) {
        let n = self.case.space.dimension();
        let place = element.place[..n].to_vec();
        if self.place.as_ref() != Some(&place) {
            self.flush();
            self.place = Some(place);
        }
        let found = apply_along_all(nodal, &self.matrices);
        let exact = element.values_at(&self.points, &mut |point| value(point));
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
                for (here, f) in self.here.iter_mut().zip(pair) {
                    here[q][0] += velocity_weight * f;
                    for (a, v) in velocities[r].iter().enumerate().take(n) {
                        here[q][1 + a] += velocity_weight * f * v;
                    }
                }
            }
        }
    }

    /// Velocities at the points of an element.
    fn velocities(&self, element: &Element<'_>) -> Vec<[f64; MAX_DIMENSION]> {
        let n = self.case.space.dimension();
        let mut points = self.points.clone();
        points[..n].iter_mut().for_each(|axis| axis.truncate(1));
        let mut found = Vec::with_capacity(self.counts[1]);
        element.values_at(&points, &mut |point| {
            found.push([point[3], point[4], point[5]]);
            0.0
        });
        found
    }

    /// Ends the element of space whose velocities were summed.
    fn flush(&mut self) {
        if self.place.take().is_none() {
            return;
        }
        let n = self.case.space.dimension();
        let mut sums = [[0.0; 4]; 2];
        for (q, weight) in products(&self.weights[..n]).iter().enumerate() {
            for k in 0..=n {
                let terms = norm_terms(self.here[0][q][k], self.here[1][q][k]);
                for (sum, term) in sums[usize::from(k > 0)].iter_mut().zip(terms) {
                    *sum += weight * term;
                }
            }
        }
        let all = [std::mem::take(&mut self.field), sums[0], sums[1]];
        for (terms, sums) in self.terms.iter_mut().zip(all) {
            for (terms, sum) in terms.iter_mut().zip(sums) {
                terms.push(sum);
            }
        }
        self.here.iter_mut().for_each(|here| here.fill([0.0; SUMS]));
    }

    /// The norms over all elements. Collective.
    fn finish(mut self, world: &Group) -> GridErrors {
        self.flush();
        let norms = |terms: &[Vec<f64>; 4]| {
            let [l1, l2, exact_l1, exact_l2] = terms.each_ref().map(|t| world.sum_terms(t));
            ErrorNorms { l1, l2: l2.sqrt(), exact_l1, exact_l2: exact_l2.sqrt() }
        };
        let [field, density, momentum] = self.terms.each_ref().map(norms);
        GridErrors { field: Some(field), density, momentum: Some(momentum) }
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
