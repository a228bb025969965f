//! Averages over elements, for a degree above 0: `/averages/f` and `/averages/density`.
//!
//! Their axes are the centres of the elements, `/axis/element_x`, …, `/axis/element_vz`. Along an
//! axis of degree 0 the elements are the cells.

use crate::base::error::Result;
use crate::base::row_major::DatasetBox;
use crate::matrix::elements::{AxisMatrix, apply_in_elements};
use crate::problem::case::Case;
use crate::problem::grid::{Axis, MAX_DIMENSION, PhaseSpace};
use crate::results::dataset::Results;
use crate::results::writer::Writer;
use std::ops::Range;

/// Names of the axes of elements, in space and in velocity.
const NAMES: [[&str; MAX_DIMENSION]; 2] =
    [["element_x", "element_y", "element_z"], ["element_vx", "element_vy", "element_vz"]];

/// The names for `n` space dimensions, in storage order.
fn names(n: usize) -> Vec<&'static str> {
    NAMES.iter().flat_map(|names| &names[..n]).copied().collect()
}

/// Upper bound on how many numbers are written: averages, axes and weights.
pub fn numbers(space: &PhaseSpace) -> usize {
    if space.degree() == 0 {
        return 0;
    }
    let product = |axes: &[Axis]| axes.iter().map(Axis::elements).product::<usize>();
    let nodes: usize = space.axes().map(|a| 2 * a.cells).sum();
    product(&space.x) * (1 + product(&space.v)) + nodes
}

/// Writes the axes of the elements.
pub fn axes(writer: &Writer<'_>, case: &Case) -> hdf5::Result<()> {
    if case.space.degree() == 0 {
        return Ok(());
    }
    let names = names(case.space.dimension());
    for (a, (name, axis)) in names.into_iter().zip(case.space.axes()).enumerate() {
        let chunk = case.output.storage.chunks.as_ref();
        let chunk = chunk.map(|chunks| chunks[a].div_ceil(axis.nodes.count()));
        writer.scale(name, &axis.by_elements().centres(), chunk)?;
    }
    Ok(())
}

/// Writes the averages of this rank's share. Collective.
///
/// # Errors
/// [`crate::base::error::Error::Output`].
pub fn write(writer: &Writer<'_>, results: &Results<'_>) -> Result<()> {
    let space = &results.case.space;
    if space.degree() == 0 || results.case.is_measure_valued() {
        return Ok(());
    }
    writer.group("averages")?;
    let n = space.dimension();
    let all: Vec<&Axis> = space.axes().collect();
    let share = results.share.iter().zip(&space.x);
    let mut ranges: Vec<Range<usize>> = share
        .map(|(range, axis)| range.start / axis.nodes.count()..range.end / axis.nodes.count())
        .collect();
    ranges.extend(space.v.iter().map(|axis| 0..axis.elements()));
    for (name, values, over) in
        [("f", results.fields[0], 2 * n), ("density", &results.moments.density[..], n)]
    {
        let averages = averages(&all[..over], &ranges[..over], values);
        let slab = DatasetBox::of(&ranges[..over]);
        let (path, axes) = (format!("averages/{name}"), &names(n)[..over]);
        let what = format!("average of {name} over each element");
        writer.field(&path, axes, &[(slab, &averages)], &what)?;
    }
    Ok(())
}

/// Averages of nodal `values` over the elements `ranges` of `axes`.
fn averages(axes: &[&Axis], ranges: &[Range<usize>], values: &[f64]) -> Vec<f64> {
    if values.is_empty() {
        return Vec::new();
    }
    let matrices: Vec<Vec<Vec<f64>>> = (axes.iter())
        .map(|axis| vec![axis.nodes.reference().weights.iter().map(|w| 0.5 * w).collect()])
        .collect();
    let lines = ranges.iter().zip(&matrices);
    let lines = lines.map(|(range, matrix)| AxisMatrix { elements: range.len(), matrix });
    apply_in_elements(values, &lines.collect::<Vec<_>>())
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::problem::element::Nodes;

    #[test]
    fn averages_of_polynomials() {
        let x = Axis::new(0.0, 3.0, 3).with_nodes(Nodes::of_space(2));
        let v = Axis::new(-1.0, 1.0, 2).with_nodes(Nodes::of_velocity(1));
        let f = |x: f64, v: f64| x * x + v;
        // The last two elements of x on this rank.
        let nodal: Vec<f64> = (x.centres()[3..].iter())
            .flat_map(|x| v.centres().into_iter().map(|v| f(*x, v)))
            .collect();
        let found = averages(&[&x, &v], &[1..3, 0..2], &nodal);
        let mean = |a: f64| a * a + a + 1.0 / 3.0;
        let exact = [mean(1.0) - 0.5, mean(1.0) + 0.5, mean(2.0) - 0.5, mean(2.0) + 0.5];
        assert_eq!(found.len(), 4);
        for (found, exact) in found.iter().zip(exact) {
            assert!((found - exact).abs() < 1e-13, "{found} {exact}");
        }
        assert!(averages(&[&x], std::slice::from_ref(&(1..1)), &[]).is_empty());
    }
}
