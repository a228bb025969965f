//! Densities on all of space, computed and exact, and their distances.

use crate::base::error::{Error, Result};
use crate::base::quadrature::gauss_legendre;
use crate::matrix::elements::apply_in_elements;
use crate::parallel::communicator::Group;
use crate::parallel::partition::split;
use crate::problem::case::{Case, Exact};
use crate::problem::element::Nodes;
use crate::problem::exact::Tracer;
use crate::problem::exact::sheet::exact_moments;
use crate::problem::grid::{PhaseSpace, describe_point, for_each_cell};
use crate::study::grids::{averaged, grid_name, refined};
use crate::study::trial::Trial;

/// The exact density is averaged over at most so many points of phase space, where the cells
/// themselves are no more.
pub const MOST_POINTS: usize = 200_000;
/// And over so many along an axis of each cell.
const MOST_PARTS: usize = 8;

/// The density of a trial on all of space, averaged over equal cells, of which each element has as
/// many as nodes along an axis. Collective.
///
/// # Errors
/// [`Error::Input`] where it is zero everywhere, or not finite.
pub fn density_of(group: &Group, space: &PhaseSpace, trial: &Trial) -> Result<Vec<f64>> {
    let mut density = vec![0.0; space.space_cells()];
    let mut mine = trial.moments.density.iter();
    for_each_cell(&trial.share, |i| {
        let index = (space.x.iter().zip(i)).fold(0, |k, (axis, i)| k * axis.cells + i);
        if let Some(value) = mine.next() {
            density[index] = *value;
        }
    });
    let density = gathered(group, &density);
    refuse_zero(&density, space)?;
    if space.x.iter().all(|axis| axis.nodes.degree == 0) {
        return Ok(density);
    }
    let matrices: Vec<_> = space.x.iter().map(|axis| part_averages(axis.nodes)).collect();
    let axes: Vec<_> =
        space.x.iter().zip(&matrices).map(|(axis, m)| (axis.elements(), &m[..])).collect();
    Ok(apply_in_elements(&density, &axes))
}

/// `[m][n]`: the average over part `m` of an element, of as many equal ones as nodes, of the
/// polynomial of node `n`.
fn part_averages(nodes: Nodes) -> Vec<Vec<f64>> {
    let count = nodes.count();
    if nodes.degree == 0 {
        return vec![vec![1.0]];
    }
    let rule = gauss_legendre(count);
    let average = |m: usize, node: usize| -> f64 {
        let at = |xi: f64| (2 * m + 1) as f64 / count as f64 - 1.0 + xi / count as f64;
        rule.iter().map(|p| 0.5 * p.weight * nodes.reference().values_at(at(p.node))[node]).sum()
    };
    (0..count).map(|m| (0..count).map(|node| average(m, node)).collect()).collect()
}

/// Values that are zero on all ranks but one, on all ranks. Collective.
fn gathered(group: &Group, mine: &[f64]) -> Vec<f64> {
    // As integers: a sum over the ranks keeps every bit.
    let mut bits: Vec<i64> = mine.iter().map(|value| value.to_bits() as i64).collect();
    group.sum_integers(&mut bits);
    bits.into_iter().map(|b| f64::from_bits(b as u64)).collect()
}

/// Refuses a density to which no error is relative.
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

/// `Σ |a − b| / Σ |b|`.
pub fn distance(a: &[f64], b: &[f64]) -> f64 {
    let difference: f64 = a.iter().zip(b).map(|(a, b)| (a - b).abs()).sum();
    let size: f64 = b.iter().map(|b| b.abs()).sum();
    if difference == 0.0 { 0.0 } else { difference / size }
}

/// `(V ∫f²)^½ / ∫|ρ|` with `V` the volume of the phase-space box: at most by this factor is the
/// relative L1 distance of densities larger than the relative l2 distance of fields (Cauchy and
/// Schwarz). Collective.
pub fn spread(group: &Group, space: &PhaseSpace, trial: &Trial, density: &[f64]) -> f64 {
    let velocities: Vec<_> = space.v.iter().map(|axis| 0..axis.cells).collect();
    let n = space.dimension();
    let mut values = trial.fields[0].iter();
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
    let box_volume: f64 = space.axes().map(|a| a.upper - a.lower).product();
    let cell = space.cell_volume() / space.velocity_volume();
    let mass = density.iter().map(|rho| rho.abs()).sum::<f64>() * cell;
    (box_volume * square).sqrt() / mass
}

/// Averages of the exact density over the space cells of `case`. `f` is taken at the centres of
/// parts of each cell: the error of `f(0)` at the centres of cells is the discretisation's.
/// Collective.
///
/// # Errors
/// Where the exact solution is not finite, or its density is zero everywhere.
pub fn exact_density(group: &Group, case: &Case, exact: &Exact) -> Result<Vec<f64>> {
    let density = match group.agree(exact_moments(case))? {
        Some(moments) => moments.density,
        None => averaged_density(group, case, exact)?,
    };
    refuse_zero(&density, &case.space)?;
    Ok(density)
}

fn averaged_density(group: &Group, case: &Case, exact: &Exact) -> Result<Vec<f64>> {
    let axes = 2 * case.space.dimension() as u32;
    let fits = |&parts: &usize| case.space.cells().saturating_mul(parts.pow(axes)) <= MOST_POINTS;
    let fine = refined(case, (1..=MOST_PARTS).rev().find(fits).unwrap_or(1));
    let tracer = match exact {
        Exact::Characteristics => Some(Tracer::new(&fine)),
        Exact::Formula(_) => None,
    };
    let tracer = group.agree(tracer.transpose())?;
    let value = |point: &[f64; 6]| match (&tracer, exact) {
        (Some(tracer), _) => tracer.value(point, case.end),
        (None, Exact::Formula(f)) => {
            let [x, y, z, vx, vy, vz] = *point;
            f.eval(&[x, y, z, vx, vy, vz, case.end])
        }
        (None, Exact::Characteristics) => f64::NAN,
    };
    let space = &fine.space;
    let velocities = space.velocity_cells();
    let mut failure = None;
    let mut density = vec![0.0; space.space_cells()];
    for point in split(&(0..density.len()), group.size(), group.rank()) {
        for cell in point * velocities..(point + 1) * velocities {
            let at = space.point(&space.cell(cell));
            let f = value(&at);
            if !f.is_finite() && failure.is_none() {
                let formula = match exact {
                    Exact::Formula(formula) => formula,
                    Exact::Characteristics => &case.fields[0].initial,
                };
                failure = Some(formula.undefined(f, describe_point(space.dimension(), &at)));
            }
            density[point] += f * space.velocity_volume();
        }
    }
    group.agree(failure.map_or(Ok(()), Err))?;
    let cells = |space: &PhaseSpace| space.x.iter().map(|a| a.cells).collect::<Vec<_>>();
    Ok(averaged(&gathered(group, &density), &cells(space), &cells(&case.space)))
}
