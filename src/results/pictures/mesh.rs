//! Uniform meshes on which the polynomials of elements are drawn.

use crate::matrix::elements::{AxisMatrix, apply_in_elements};
use crate::problem::grid::Axis;

/// Least number of points that are drawn for each node of an element.
const POINTS_A_NODE: usize = 2;
/// Least number of points along an axis with elements of a degree above 0.
const SMOOTH: usize = 128;

/// Equal parts of the elements of an axis, and the weights of nodes in each. For degree 0 the parts
/// are the cells.
pub struct FineMesh {
    /// Elements of the axis.
    pub elements: usize,
    /// The weights of an element's nodes, for each of its parts.
    matrix: Vec<Vec<f64>>,
}

impl FineMesh {
    /// A mesh of `axis` for polynomials through the nodes, with about `most` parts at most, but at
    /// least one per element.
    pub fn new(axis: &Axis, most: usize) -> Self {
        Self::with(axis, most, |xi| axis.nodes.reference().values_at(xi))
    }

    /// A mesh of `axis` as [`new`](Self::new) makes it, for averages over cells.
    pub fn of_averages(axis: &Axis, most: usize) -> Self {
        Self::with(axis, most, |xi| {
            let element = axis.nodes.reference();
            let mut upper = -1.0;
            let within = element.weights.iter().position(|w| {
                upper += w;
                xi < upper
            });
            let mut values = vec![0.0; axis.nodes.count()];
            values[within.unwrap_or(axis.nodes.degree)] = 1.0;
            values
        })
    }

    /// A mesh of `axis`. `values_at(ξ)` are the weights of the nodes at a point of the reference
    /// element.
    fn with(axis: &Axis, most: usize, values_at: impl Fn(f64) -> Vec<f64>) -> Self {
        let (nodes, element) = (axis.nodes.count(), axis.nodes.reference());
        let parts = match axis.nodes.degree {
            0 => 1,
            _ => {
                let wanted = (POINTS_A_NODE * nodes).max(SMOOTH.div_ceil(axis.elements()));
                (most / axis.elements()).clamp(1, wanted)
            }
        };
        let middle = |part: usize| (2 * part + 1) as f64 / parts as f64 - 1.0;
        let matrix = match parts {
            1 => vec![element.weights.iter().map(|w| 0.5 * w).collect()],
            _ => (0..parts).map(|part| values_at(middle(part))).collect(),
        };
        Self { elements: axis.elements(), matrix }
    }

    /// Number of parts of the whole axis.
    pub fn len(&self) -> usize {
        self.elements * self.matrix.len()
    }

    /// Number of nodes of an element.
    pub fn nodes(&self) -> usize {
        self.matrix[0].len()
    }
}

/// The values on the parts of two meshes, from nodal `values` on `elements` elements of the first
/// one and all of the second. The second axis runs fastest.
pub fn values_on_parts(values: &[f64], elements: usize, meshes: &[FineMesh; 2]) -> Vec<f64> {
    let [first, second] = meshes;
    let axes = [
        AxisMatrix { elements, matrix: &first.matrix },
        AxisMatrix { elements: second.elements, matrix: &second.matrix },
    ];
    apply_in_elements(values, &axes)
}

/// Values at the nodes of `axis` as points of a line: for degree 0 the values, else the polynomial
/// of each element from face to face.
pub fn line(axis: &Axis, values: &[f64]) -> Vec<[f64; 2]> {
    if axis.nodes.degree == 0 {
        return axis.centres().into_iter().zip(values).map(|(x, value)| [x, *value]).collect();
    }
    let (count, element) = (axis.nodes.count(), axis.nodes.reference());
    let steps = (POINTS_A_NODE * count).max(SMOOTH.div_ceil(axis.elements()));
    let mut points = Vec::with_capacity(axis.elements() * (steps + 1));
    for (e, nodal) in values.chunks_exact(count).enumerate() {
        for step in 0..=steps {
            let xi = 2.0 * step as f64 / steps as f64 - 1.0;
            points.push([axis.at(e as i64, xi), element.interpolate(nodal, xi)]);
        }
    }
    points
}

/// Averages over the cells of `axis` as points in the middle of each.
pub fn averages(axis: &Axis, values: &[f64]) -> Vec<[f64; 2]> {
    let faces = axis.cell_faces();
    (faces.windows(2).zip(values)).map(|(ends, f)| [0.5 * (ends[0] + ends[1]), *f]).collect()
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::problem::element::Nodes;

    /// A polynomial of the degree of the elements is drawn exactly.
    #[test]
    fn polynomials_are_drawn_as_they_are() {
        let f = |x: f64, v: f64| 1.0 - x + 2.0 * x * x * v - v * v;
        let x = Axis::new(-1.0, 2.0, 3).with_nodes(Nodes::of_space(2));
        let v = Axis::new(-1.0, 1.0, 5).with_nodes(Nodes::of_velocity(2));
        let nodal: Vec<f64> =
            x.centres().iter().flat_map(|x| v.centres().into_iter().map(|v| f(*x, v))).collect();
        let meshes = [&x, &v].map(|axis| FineMesh::new(axis, 100));
        let [nx, nv] = [meshes[0].len(), meshes[1].len()];
        assert_eq!([nx, nv], [99, 100]);
        let found = values_on_parts(&nodal, 3, &meshes);
        for i in 0..nx {
            for j in 0..nv {
                let at = |k: usize, n: usize, axis: &Axis| {
                    axis.lower + (k as f64 + 0.5) / n as f64 * (axis.upper - axis.lower)
                };
                let exact = f(at(i, nx, &x), at(j, nv, &v));
                assert!((found[i * nv + j] - exact).abs() < 1e-13, "{i} {j}");
            }
        }
        let points = line(&x, &x.centres().iter().map(|x| f(*x, 0.5)).collect::<Vec<_>>());
        assert_eq!((points[0][0], points[points.len() - 1][0]), (-1.0, 2.0));
        assert!(points.iter().all(|[x, value]| (f(*x, 0.5) - value).abs() < 1e-13));
    }

    /// Averages are drawn as they are, each in its own cell.
    #[test]
    fn averages_stay_in_their_cells() {
        let x = Axis::new(0.0, 2.0, 2).with_nodes(Nodes::of_space(2));
        let values = [1.0, 2.0, 3.0, 4.0, 5.0, 6.0];
        let points = averages(&x, &values);
        // Widths of Gauss–Lobatto nodes: 1/6, 2/3, 1/6.
        assert_eq!(points.len(), 6);
        for (point, middle) in points.iter().zip([1.0 / 12.0, 0.5, 11.0 / 12.0]) {
            assert!((point[0] - middle).abs() < 1e-15, "{point:?}");
        }
        let mesh = FineMesh::of_averages(&x, 1000);
        let one = FineMesh::new(&Axis::new(0.0, 1.0, 1), 1);
        let fine = values_on_parts(&values, 2, &[mesh, one]);
        for (part, found) in fine.iter().enumerate() {
            let at = 2.0 * (part as f64 + 0.5) / fine.len() as f64;
            assert_eq!(*found, values[x.cell_faces().partition_point(|face| *face <= at) - 1]);
        }
    }

    /// Many elements are averaged, and a cell of degree 0 stays as it is.
    #[test]
    fn fine_grids_have_a_part_an_element() {
        let axis = Axis::new(0.0, 1.0, 7).with_nodes(Nodes::of_velocity(3));
        let mesh = FineMesh::new(&axis, 5);
        assert_eq!((mesh.len(), mesh.nodes()), (7, 4));
        assert!((mesh.matrix[0].iter().sum::<f64>() - 1.0).abs() < 1e-15);
        let cells = FineMesh::new(&Axis::new(0.0, 1.0, 7), 100);
        assert_eq!((cells.len(), cells.matrix), (7, vec![vec![1.0]]));
    }
}
