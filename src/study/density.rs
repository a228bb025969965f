//! Densities on all of space, computed and exact, and their distances.

use crate::base::error::{Error, Result};
use crate::base::quadrature::gauss_legendre;
use crate::matrix::elements::{AxisMatrix, apply_in_elements};
use crate::parallel::communicator::Group;
use crate::problem::case::{Case, Exact};
use crate::problem::element::Nodes;
use crate::problem::grid::{PhaseSpace, for_each_cell};
use crate::run::Solution;
use crate::run::exact::averaged_density;
use crate::study::grids::grid_name;

/// The density of a trial on all of space, averaged over equal cells. Along an axis, an element of
/// a degree above 0 has `parts` of these cells for each node. Collective.
///
/// # Errors
/// [`Error::Input`] if it is zero everywhere, or not finite.
pub fn density_of(
    group: &Group,
    space: &PhaseSpace,
    trial: &Solution,
    parts: usize,
) -> Result<Vec<f64>> {
    let mut density = vec![0.0; space.space_cells()];
    let mut mine = trial.results.moments.density.iter();
    for_each_cell(&trial.share, |i| {
        let index = space.space_index(i);
        if let Some(value) = mine.next() {
            density[index] = *value;
        }
    });
    let density = group.gathered(density);
    refuse_zero(&density, space)?;
    if space.x.iter().all(|axis| axis.nodes.degree == 0) {
        return Ok(density);
    }
    let matrices: Vec<_> = space.x.iter().map(|axis| part_averages(axis.nodes, parts)).collect();
    let axes: Vec<_> = (space.x.iter().zip(&matrices))
        .map(|(axis, matrix)| AxisMatrix { elements: axis.elements(), matrix })
        .collect();
    Ok(apply_in_elements(&density, &axes))
}

/// Averages of the nodal polynomials of an element over its parts, as `[m][n]`: part `m`, node `n`.
/// The element is cut into equal parts, `parts` for each node.
fn part_averages(nodes: Nodes, parts: usize) -> Vec<Vec<f64>> {
    if nodes.degree == 0 {
        return vec![vec![1.0]];
    }
    let (rule, count) = (gauss_legendre(nodes.count()), parts * nodes.count());
    let average = |m: usize, node: usize| -> f64 {
        let at = |xi: f64| (2 * m + 1) as f64 / count as f64 - 1.0 + xi / count as f64;
        rule.iter().map(|p| 0.5 * p.weight * nodes.reference().values_at(at(p.node))[node]).sum()
    };
    (0..count).map(|m| (0..nodes.count()).map(|node| average(m, node)).collect()).collect()
}

/// Refuses a density that is zero or not finite: no error relative to it is defined.
fn refuse_zero(density: &[f64], space: &PhaseSpace) -> Result<()> {
    let size: f64 = density.iter().map(|rho| rho.abs()).sum();
    if size > 0.0 && size.is_finite() {
        return Ok(());
    }
    let what = if size == 0.0 { "zero" } else { "not finite" };
    Err(Error::Input(format!(
        "the density is {what}: a relative error has no meaning (at the end, on {} cells)",
        grid_name(space)
    )))
}

/// The relative L1 distance `Σ |a − b| / Σ |b|`.
pub fn distance(a: &[f64], b: &[f64]) -> f64 {
    let difference: f64 = a.iter().zip(b).map(|(a, b)| (a - b).abs()).sum();
    let size: f64 = b.iter().map(|b| b.abs()).sum();
    if difference == 0.0 { 0.0 } else { difference / size }
}

/// The mean of `|ρ|`.
pub fn mean_size(density: &[f64]) -> f64 {
    density.iter().map(|rho| rho.abs()).sum::<f64>() / density.len() as f64
}

/// `(V ∫f²)^½ / ∫|ρ|` with `V` the volume of the phase-space box. By Cauchy and Schwarz the
/// relative L1 distance of densities is at most this factor times the relative l2 distance of the
/// fields. Collective.
pub fn spread(group: &Group, space: &PhaseSpace, trial: &Solution, density: &[f64]) -> f64 {
    let velocities = space.velocity_ranges();
    let n = space.dimension();
    let mut values = trial.results.fields[0].iter();
    let mut squares = Vec::new();
    for_each_cell(&trial.share, |i| {
        let mut sum = 0.0;
        for_each_cell(&velocities, |j| {
            let f = values.next().copied().unwrap_or(0.0);
            let here = space.axes().zip(i[..n].iter().chain(&j[..n]));
            let volume: f64 = here.map(|(axis, &k)| axis.relative_weight(k)).product();
            sum += volume * f * f;
        });
        squares.push(sum);
    });
    let square = group.sum_terms(&squares) * space.cell_volume();
    let mass = mean_size(density) * space.box_volume() / space.velocity_box_volume();
    (space.box_volume() * square).sqrt() / mass
}

/// [`averaged_density`] of the exact solution. Collective.
///
/// # Errors
/// As [`averaged_density`]; [`Error::Input`] if the density is zero everywhere, or not finite.
pub fn exact_density(group: &Group, case: &Case, exact: &Exact) -> Result<Vec<f64>> {
    let density = averaged_density(group, case, exact)?;
    refuse_zero(&density, &case.space)?;
    Ok(density)
}
