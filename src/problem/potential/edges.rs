//! Edges of the pieces of `V` compared with the grid: edges off the faces, and narrow regions.

use crate::base::bisect::bisect;
use crate::base::random::evenly_spread;
use crate::problem::case::{Case, Region};
use crate::problem::grid::{Axis, MAX_DIMENSION, box_cells, for_each_cell};
use crate::problem::potential::pieces::{PotentialPiece, is_one_piece, piece, region, space_point};

/// Width, in elements, of a region of `V` that lies between others.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct RegionWidth {
    /// Index of the region.
    pub region: usize,
    /// The space axis along which it is narrowest.
    pub axis: usize,
    /// Number of elements across it.
    pub elements: usize,
}

/// The widths of the regions that lie between others. A line along an axis crosses a region once or
/// more often; the width on that line is the least of these. The width along the axis is the
/// largest on any line, so that a disc is as wide as its diameter. Returned is the least width over
/// the axes.
pub fn region_widths(case: &Case) -> Vec<RegionWidth> {
    if case.potential.len() == 1 {
        return Vec::new();
    }
    let space = case.space.by_elements();
    let axes = &space.x;
    // Undefined conditions are reported by `Potential::new`.
    let at =
        |i: [usize; MAX_DIMENSION]| region(&case.potential, &space_point(axes, &i)).unwrap_or(0);
    let regions: Vec<usize> = box_cells(&space.space_ranges()).map(at).collect();
    let mut least: Vec<Option<RegionWidth>> = vec![None; case.potential.len()];
    for (axis, along) in axes.iter().enumerate() {
        let stride: usize = axes[axis + 1..].iter().map(|a| a.cells).product();
        let mut widest = vec![0; least.len()];
        for first in (0..regions.len()).filter(|k| (k / stride).is_multiple_of(along.cells)) {
            let line = (0..along.cells).map(|i| regions[first + i * stride]).collect();
            let mut narrow = vec![usize::MAX; least.len()];
            for [region, elements] in inner_runs(line, case.space.is_periodic(axis)) {
                narrow[region] = narrow[region].min(elements);
            }
            for (widest, narrow) in widest.iter_mut().zip(narrow) {
                *widest = if narrow == usize::MAX { *widest } else { narrow.max(*widest) };
            }
        }
        for (region, elements) in widest.into_iter().enumerate().filter(|(_, w)| *w > 0) {
            let found = &mut least[region];
            if found.is_none_or(|f| elements < f.elements) {
                *found = Some(RegionWidth { region, axis, elements });
            }
        }
    }
    least.into_iter().flatten().collect()
}

/// `[region, elements]` of the runs of equal regions on a line, except the runs at its ends.
fn inner_runs(mut line: Vec<usize>, periodic: bool) -> Vec<[usize; 2]> {
    if periodic {
        // A periodic line has no ends; it is rotated to begin at a change of region.
        let Some(change) = line.windows(2).position(|w| w[0] != w[1]) else { return Vec::new() };
        line.rotate_left(change + 1);
    }
    let runs = line.chunk_by(|a, b| a == b);
    let mut runs: Vec<[usize; 2]> = runs.map(|run| [run[0], run.len()]).collect();
    if !periodic {
        runs.pop();
        runs.drain(..runs.len().min(1));
    }
    runs
}

/// An edge of a piece of `V` that misses the faces of the grid.
#[derive(Clone, Debug, PartialEq)]
pub struct StrayEdge {
    /// Axis along which it was found.
    pub axis: usize,
    /// Position of the edge along that axis.
    pub at: f64,
    /// The face to which the scheme moves it.
    pub face: f64,
}

/// Largest number of edges off the faces that are collected. A curved edge misses the faces in
/// every cell.
pub const MOST_STRAY_EDGES: usize = 256;

/// The parts of the regions that the grid does not resolve.
#[derive(Clone, Debug, Default)]
pub struct UnresolvedRegions {
    /// Edges inside cells, one per position, at most [`MOST_STRAY_EDGES`]. The scheme moves them to
    /// the nearest face, which changes the problem by that distance.
    pub edges: Vec<StrayEdge>,
    /// Indices of the regions that contain no cell's centre.
    pub empty: Vec<usize>,
}

/// Halvings of the interval in which an edge is sought.
const HALVINGS: usize = 60;
/// Least number of points along each axis between which edges are searched, by dimension.
const SCANNED: [usize; 3] = [4096, 256, 48];
/// In two and three dimensions this number of lines along each axis, spread over the box, is
/// searched as finely as the axis in one: for narrow regions between parallel planes.
const FINE_LINES: usize = 16;
/// Largest number of edges along an axis, by dimension. In one there are no curved edges.
const MOST_EDGES: [usize; 3] = [2048, 64, 64];

/// The edges of the pieces of a potential that are found so far.
struct FoundEdges<'c> {
    potential: &'c [Region],
    /// By axis; `None` for an axis with more than `most`.
    by_axis: Vec<Option<Vec<f64>>>,
    /// Largest number along an axis.
    most: usize,
}

impl FoundEdges<'_> {
    /// The piece at `point`. Where a condition is undefined, there is no piece.
    fn piece(&self, point: &[f64; 6]) -> Option<PotentialPiece> {
        piece(self.potential, point).ok()
    }

    /// Searches for an edge from `point`, which belongs to the piece `own`, along axis `a` to the
    /// position `end`. Edges nearer than `tolerance` are one. Returns the piece at `end`.
    fn search(
        &mut self,
        point: [f64; 6],
        own: Option<PotentialPiece>,
        a: usize,
        end: f64,
        tolerance: f64,
    ) -> Option<PotentialPiece> {
        let at = |x: f64| {
            let mut moved = point;
            moved[a] = x;
            self.piece(&moved)
        };
        let other = at(end);
        if other == own {
            return other;
        }
        let [inside, _] = bisect(point[a], end, HALVINGS, |x| at(x) == own);
        if let Some(edges) = &mut self.by_axis[a]
            && !edges.iter().any(|e| (e - inside).abs() < tolerance)
        {
            edges.push(inside);
            if edges.len() > self.most {
                self.by_axis[a] = None;
            }
        }
        other
    }

    /// Searches between the centres of the cells of `axes`.
    fn search_cells(&mut self, axes: &[Axis]) {
        let ranges: Vec<_> = axes.iter().map(|a| 0..a.cells).collect();
        for_each_cell(&ranges, |i| {
            let centre = space_point(axes, i);
            let own = self.piece(&centre);
            for (a, axis) in axes.iter().enumerate() {
                if i[a] + 1 < axis.cells && self.by_axis[a].is_some() {
                    let end = axis.centre(i[a] as i64 + 1);
                    self.search(centre, own, a, end, 1e-6 * axis.width());
                }
            }
        });
    }

    /// Searches [`FINE_LINES`] lines along each of `axes`, between the centres of as many cells as
    /// an axis has in one dimension.
    fn search_lines(&mut self, axes: &[Axis]) {
        for (a, along) in axes.iter().enumerate() {
            let fine = finer(along, SCANNED[0]);
            for line in 0..FINE_LINES {
                let mut point = [0.0; 6];
                for (b, axis) in axes.iter().enumerate() {
                    // Each axis takes other numbers of the sequence.
                    let at = evenly_spread((1 + line) * [1, 5, 7][b]);
                    point[b] = axis.lower + at * (axis.upper - axis.lower);
                }
                point[a] = fine.centre(0);
                let mut own = self.piece(&point);
                for i in 1..fine.cells {
                    if self.by_axis[a].is_none() {
                        break;
                    }
                    let end = fine.centre(i as i64);
                    own = self.search(point, own, a, end, 1e-6 * along.width());
                    point[a] = end;
                }
            }
        }
    }
}

/// The axis with its elements cut into equal cells, at least `least` of them.
fn finer(axis: &Axis, least: usize) -> Axis {
    let elements = axis.elements();
    Axis::new(axis.lower, axis.upper, elements * least.div_ceil(elements))
}

/// The positions along each space axis at which the piece of `V` changes: the region, or the value
/// of a table that is constant around its points. `None` for an axis with more than 64 of them
/// (2048 in one dimension), as of a curved edge. Pieces narrower than 1/4096 of an axis may be
/// missed; in two and three dimensions so may those narrower than the distance of the `SCANNED`
/// points that none of the `FINE_LINES` crosses.
pub fn region_edges(case: &Case) -> Vec<Option<Vec<f64>>> {
    let dimension = case.space.dimension();
    let mut found = FoundEdges {
        potential: &case.potential,
        by_axis: vec![Some(Vec::new()); dimension],
        most: MOST_EDGES[dimension - 1],
    };
    if is_one_piece(&case.potential) {
        return found.by_axis;
    }
    let scanned: Vec<Axis> =
        case.space.x.iter().map(|axis| finer(axis, SCANNED[dimension - 1])).collect();
    found.search_cells(&scanned);
    if dimension > 1 {
        found.search_lines(&scanned);
    }
    found.by_axis
}

/// Searches lines through cell centres for edges of regions and of tables, and finds regions that
/// contain no centre.
pub fn unresolved_regions(case: &Case) -> UnresolvedRegions {
    if is_one_piece(&case.potential) {
        return UnresolvedRegions::default();
    }
    let space = case.space.by_elements();
    let axes = &space.x;
    let mut found: Vec<StrayEdge> = Vec::new();
    let mut used = vec![false; case.potential.len()];
    // Undefined conditions are reported by `Potential::new`.
    let at = |point: &[f64; 6]| piece(&case.potential, point).ok();
    for_each_cell(&space.space_ranges(), |i| {
        let centre = space_point(axes, i);
        let own = at(&centre);
        used[own.map_or(0, |piece| piece.region)] = true;
        for (a, axis) in axes.iter().enumerate() {
            for side in [0, 1] {
                let face = axis.face((i[a] + side) as i64);
                // The search ends just inside the face, so that it does not find an edge on it.
                let end = face + (centre[a] - face) * 1e-6;
                let probe = |x: f64| {
                    let mut point = centre;
                    point[a] = x;
                    at(&point) == own
                };
                if found.len() >= MOST_STRAY_EDGES || probe(end) {
                    continue;
                }
                let [inside, outside] = bisect(centre[a], end, HALVINGS, probe);
                let at = 0.5 * (inside + outside);
                let known = |e: &StrayEdge| e.axis == a && (e.at - at).abs() < 1e-6 * axis.width();
                if !found.iter().any(known) {
                    found.push(StrayEdge { axis: a, at, face });
                }
            }
        }
    });
    UnresolvedRegions { edges: found, empty: (0..used.len()).filter(|&r| !used[r]).collect() }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::problem::potential::nodal_values;

    #[test]
    fn runs_between_others() {
        let line = || vec![0, 0, 1, 2, 2, 0];
        assert_eq!(inner_runs(line(), false), [[1, 1], [2, 2]]);
        assert_eq!(inner_runs(line(), true), [[1, 1], [2, 2], [0, 3]]);
        assert!(inner_runs(vec![1; 4], true).is_empty());
        assert!(inner_runs(vec![1; 4], false).is_empty());
        assert!(inner_runs(vec![1, 0], false).is_empty());
    }

    /// Two hundred regions, of odd widths.
    #[test]
    fn many_edges_are_found_in_one_dimension() {
        let edges: Vec<f64> = (1..200).map(|k| f64::from(k * k + 50 * k) / 50000.0).collect();
        let regions = edges.iter().enumerate();
        let regions: String = regions
            .map(|(k, end)| format!("[[potential]]\nwhere = \"x < {end:?}\"\nvalue = \"{k}\"\n"))
            .collect();
        let text = format!(
            "{regions}[[potential]]\nvalue = \"-1\"\n[[axis]]\n\
             x = {{ lower = 0, upper = 1, cells = 17 }}\n\
             v = {{ lower = -1, upper = 1, cells = 4 }}\n\
             [initial]\nf = \"1\"\n[time]\nend = 1.0\n"
        );
        let case = Case::parse("stairs", &text, &[]).expect("a case");
        let found = region_edges(&case)[0].clone().expect("edges");
        assert_eq!(found.len(), edges.len());
        for (found, edge) in found.iter().zip(&edges) {
            assert!((found - edge).abs() < 1e-12, "{found} {edge}");
        }
    }

    /// Slabs and beams a thousandth of an axis wide are found in all dimensions.
    #[test]
    fn narrow_regions_are_found_in_all_dimensions() {
        for (dimension, condition, axis, edges) in [
            (2, "abs(y - 0.3117) < 0.0007", 1, [0.3110, 0.3124]),
            (2, "abs(x + 0.4203) < 0.0005 && y > 0.5", 0, [-0.4208, -0.4198]),
            (3, "abs(z - 0.1) < 0.001 && x < 0 && y < 0", 2, [0.099, 0.101]),
        ] {
            let box_axis = "[[axis]]\nx = { lower = -1, upper = 1, cells = 9 }\n\
                            v = { lower = -1, upper = 1, cells = 4 }\n";
            let text = format!(
                "{}[[potential]]\nwhere = \"{condition}\"\nvalue = \"1\"\n\
                 [[potential]]\nvalue = \"0\"\n[initial]\nf = \"1\"\n[time]\nend = 1.0\n",
                box_axis.repeat(dimension)
            );
            let case = Case::parse("narrow", &text, &[]).expect("a case");
            let found = region_edges(&case)[axis].clone().expect("edges");
            for edge in edges {
                let off = found.iter().map(|e| (e - edge).abs()).fold(f64::INFINITY, f64::min);
                assert!(off < 1e-12, "{condition}: {edge} is not in {found:?}");
            }
        }
    }

    #[test]
    fn a_disc_is_as_wide_as_its_diameter_and_a_slab_as_its_thickness() {
        let axis = "[[axis]]\nx = { lower = -1, upper = 1, cells = 20 }\n\
                    v = { lower = -1, upper = 1, cells = 4 }\n";
        let case = |condition: &str| {
            let text = format!(
                "{}[[potential]]\nwhere = \"{condition}\"\nvalue = \"1\"\n\
                 [[potential]]\nvalue = \"x\"\n[initial]\nf = \"1\"\n[time]\nend = 1.0\n",
                axis.repeat(2)
            );
            Case::parse("disc", &text, &[]).expect("a case")
        };
        let widths = |condition: &str| region_widths(&case(condition));
        let width = |axis, elements| [RegionWidth { region: 0, axis, elements }];
        assert_eq!(widths("x^2 + y^2 < 0.25"), width(0, 10));
        assert_eq!(widths("abs(y) < 0.2"), width(1, 4));
        assert!(widths("x < 0").is_empty());
        let values = nodal_values(&case("x < 0"), &[9..11, 0..1]);
        assert_eq!(values, [1.0, case("x < 0").space.x[0].centre(10)]);
    }
}
