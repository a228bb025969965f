//! Coarser and finer grids over the box of a case, with the edges of `V` on faces where possible.
//!
//! A grid is named by its *shape*, the number of elements along each axis, and by their degree. Of
//! degree 0 elements are cells.

use crate::base::error::Result;
use crate::base::text::joined;
use crate::matrix::bounds::Bounds;
use crate::problem::case::{Case, SchemeSettings};
use crate::problem::element::Nodes;
use crate::problem::grid::{Axis, PhaseSpace};
use crate::problem::potential::{region_edges, unresolved_regions};
use std::cmp::Reverse;

/// Largest distance from a face, in cells, of an edge that counts as on it.
const ON_FACE: f64 = 1e-6;
/// Numbers of elements are equally good if their mismatches ([`mismatch`]) differ by less than
/// this.
const ALIKE: f64 = 0.02;
/// Largest unit (fewest elements with all edges of `V` on faces) that is searched for, by
/// dimension; larger if the case itself has more elements.
const LARGEST_UNIT: [usize; 3] = [1000, 64, 16];
/// Fewest elements along an axis, by dimension, of degree 0 and of higher degrees; fewer only if
/// the case itself has fewer.
const FEWEST: [[usize; 3]; 2] = [[8, 4, 4], [4, 2, 2]];
/// Binary logarithm of the largest ratio of the case's number of elements along an axis to that of
/// the coarsest grid.
const COARSEST: u32 = 3;

/// Largest number of cells of space of a grid that is planned for.
pub const MOST_PLANNED_SPACE_CELLS: f64 = (1u64 << 22) as f64;

/// `shape` as text: `64 x 48`.
pub fn shape_text(shape: &[usize]) -> String {
    joined(shape, " x ")
}

/// The grid of `space` as text: `64 x 48`, `26 x 26 of degree 4`.
pub fn grid_name(space: &PhaseSpace) -> String {
    let mut name = shape_text(&space.elements());
    let degrees: Vec<String> = space.axes().map(|a| a.nodes.degree.to_string()).collect();
    if degrees.iter().any(|degree| *degree != degrees[0]) {
        name += &format!(" of degrees {}", degrees.join(", "));
    } else if space.degree() > 0 {
        name += &format!(" of degree {}", degrees[0]);
    }
    name
}

/// `case` on `shape` elements.
pub fn on_grid(case: &Case, shape: &[usize]) -> Case {
    Case { space: case.space.with_elements(shape), ..case.clone() }
}

/// `case` with `factor` times the elements along every axis.
pub fn refined(case: &Case, factor: usize) -> Case {
    let shape: Vec<usize> = case.space.elements().iter().map(|n| n * factor).collect();
    on_grid(case, &shape)
}

/// `case` with elements of `degree` along all axes and about as many unknowns. Flux and interface
/// are those that its file gives with that degree. Axes that runs merge (`merged`, one flag for
/// each of the `2n`) keep their elements. A case of that degree is returned as it is.
///
/// # Errors
/// As [`Case::parse`], if the case has a setting that elements of that degree do not allow.
pub fn of_degree(case: &Case, degree: usize, merged: &[bool]) -> Result<Case> {
    if degree == case.space.degree() {
        return Ok(case.clone());
    }
    let mut set = case.overrides.clone();
    set.extend(degree_settings(case, degree));
    // Settings that are refused together with a degree, and that studies set themselves.
    set.extend(["scheme.limiter=none", "output.positive=false"].map(str::to_owned));
    let read = Case::parse(&case.name, &case.text, &set)?;
    let mut case = case.clone();
    let SchemeSettings { flux, interface, limiter, .. } = read.scheme;
    case.scheme = SchemeSettings { flux, interface, limiter, ..case.scheme };
    case.output.positive &= degree > 0;
    let n = case.space.dimension();
    let axes = case.space.x.iter_mut().chain(&mut case.space.v);
    for (k, axis) in axes.enumerate() {
        let nodes = if k < n { Nodes::of_space(degree) } else { Nodes::of_velocity(degree) };
        let elements = if merged[k] { axis.elements() } else { axis.cells.div_ceil(nodes.count()) };
        *axis = Axis { cells: elements * nodes.count(), nodes, ..axis.clone() };
    }
    let grids = Grids::new(&case).with_merged(merged.to_vec());
    Ok(on_grid(&case, &grids.scaled(&case.space.elements(), AxisGroup::All, 1.0)))
}

/// The `--set` options that give all axes of `case` this degree.
pub fn degree_settings(case: &Case, degree: usize) -> Vec<String> {
    let axes =
        (0..case.space.dimension()).flat_map(|a| ["x", "v"].map(|x| format!("axis.{a}.{x}")));
    let own = axes.map(|axis| format!("{axis}.degree")).filter(|k| case.settings.contains_key(k));
    let mut set: Vec<String> = own.map(|key| format!("{key}={degree}")).collect();
    set.push(format!("scheme.degree={degree}"));
    if degree == 0 && case.settings.contains_key("scheme.flux") {
        set.push("scheme.flux=1".to_owned());
    }
    set
}

/// The product of `shape`, as a float: it may exceed every integer.
pub fn cells(shape: &[usize]) -> f64 {
    shape.iter().map(|&n| n as f64).product()
}

/// Number of edges of `V` on no face of the case's grid, plus regions that hold no cell centre.
pub fn stray_edges(case: &Case) -> usize {
    let found = unresolved_regions(case);
    found.edges.len() + found.empty.len()
}

/// `case` on at most `most` cells. Axes are halved, the longest first. Axes that keep as many edges
/// of `V` on faces are preferred.
pub fn coarsened(case: &Case, most: usize) -> Case {
    let mut case = case.clone();
    let grids = Grids::new(&case);
    // Fewest elements along an axis.
    let least = if case.space.degree() == 0 { 4 } else { 2 };
    while case.space.cells() > most {
        let shape = case.space.elements();
        let half = |a: usize| grids.half(a, shape[a]);
        let mut axes: Vec<usize> = (0..shape.len()).collect();
        axes.retain(|&a| (least..shape[a]).contains(&half(a)));
        axes.sort_by_key(|&a| Reverse(shape[a]));
        let halved = |&a: &usize| {
            let mut shape = shape.clone();
            shape[a] = half(a);
            on_grid(&case, &shape)
        };
        let before = stray_edges(&case);
        let keeps = |case: &Case| stray_edges(case) <= before;
        let next = (axes.iter().map(halved).find(keeps)).or_else(|| axes.first().map(halved));
        let Some(next) = next else { break };
        case = next;
    }
    case
}

/// The axes along which a grid changes.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum AxisGroup {
    /// All axes.
    All,
    /// The axes of space.
    Space,
    /// The axes of velocity.
    Velocity,
}

/// Grids over the box of a case.
pub struct Grids {
    axes: Vec<Axis>,
    /// Positions that must be on faces, by axis. Along x these are the edges of regions of `V`;
    /// `None` if there are too many, as with a curved edge. Along v it is `v = 0` if [`check_axis`]
    /// requires a face there, and `None` otherwise.
    ///
    /// [`check_axis`]: crate::scheme::interface::rest_face::check_axis
    edges: Vec<Option<Vec<f64>>>,
    /// The fewest elements along each axis that have faces at all its edges, as their multiples
    /// have. `None` if that would be too many.
    units: Vec<Option<usize>>,
    /// Fewest elements along an axis, by dimension, for the degree of the case.
    fewest: [usize; 3],
    /// One flag for each of the `2n` axes: whether nothing varies along it. A run then has one cell
    /// there, and grids keep the number of elements of the case.
    merged: Vec<bool>,
}

impl Grids {
    /// Grids over the box of `case`.
    pub fn new(case: &Case) -> Self {
        let inside = |axis: &Axis| axis.lower < 0.0 && axis.upper > 0.0;
        // There are no bounds of a grid without a face at v = 0 if `V` jumps. Any other error in
        // `V` is reported when the case is solved.
        let needs_rest =
            case.is_galerkin() && Bounds::new(case).map_or(true, |bounds| bounds.jumps);
        let at_rest = |axis: &Axis| (needs_rest && inside(axis)).then(|| vec![0.0]);
        let edges: Vec<_> =
            region_edges(case).into_iter().chain(case.space.v.iter().map(at_rest)).collect();
        let fewest = FEWEST[usize::from(case.space.degree() > 0)];
        Self::over(case.space.axes().cloned().collect(), edges, fewest)
    }

    /// Grids over a box with these axes and edges.
    fn over(axes: Vec<Axis>, edges: Vec<Option<Vec<f64>>>, fewest: [usize; 3]) -> Self {
        let largest = LARGEST_UNIT[axes.len() / 2 - 1];
        let unit = |(axis, edges): (&Axis, &Option<Vec<f64>>)| {
            let Some(edges) = edges else { return Some(1) };
            (1..=largest.max(axis.elements())).find(|&n| keeps(axis, edges, n))
        };
        let units = axes.iter().zip(&edges).map(unit).collect();
        let merged = vec![false; axes.len()];
        Self { axes, edges, units, fewest, merged }
    }

    /// These grids, with a flag `merged` for each of the `2n` axes that runs merge.
    pub fn with_merged(self, merged: Vec<bool>) -> Self {
        Self { merged, ..self }
    }

    /// `shape` with `cells(k, n)` instead of `n` elements along each of the `axes` `k` that are not
    /// merged.
    fn mapped(
        &self,
        shape: &[usize],
        axes: AxisGroup,
        cells: impl Fn(usize, usize) -> usize,
    ) -> Vec<usize> {
        let changes = |k: usize| {
            let in_group = match axes {
                AxisGroup::All => true,
                AxisGroup::Space => k < self.dimension(),
                AxisGroup::Velocity => k >= self.dimension(),
            };
            in_group && !self.merged[k]
        };
        let of = |(k, &n)| if changes(k) { cells(k, n) } else { n };
        shape.iter().enumerate().map(of).collect()
    }

    /// `shape`, twice as fine along the `axes` that are not merged.
    pub fn doubled(&self, shape: &[usize], axes: AxisGroup) -> Vec<usize> {
        self.mapped(shape, axes, |_, n| 2 * n)
    }

    /// Number of space dimensions.
    pub fn dimension(&self) -> usize {
        self.axes.len() / 2
    }

    /// Whether `n` elements along axis `k` have faces at all its edges.
    fn keeps(&self, k: usize, n: usize) -> bool {
        self.edges[k].as_ref().is_none_or(|edges| keeps(&self.axes[k], edges, n))
    }

    /// Whether axis `k` is a velocity axis that needs an even number of elements, but no face at 0.
    fn needs_even(&self, k: usize) -> bool {
        k >= self.dimension() && self.edges[k].is_none()
    }

    /// The axes on which `shape` moves an edge of `V`.
    pub fn moved(&self, shape: &[usize]) -> Vec<usize> {
        (0..self.dimension()).filter(|&a| !self.keeps(a, shape[a])).collect()
    }

    /// About `wanted` elements along axis `k` of the `2n`, at least `fewest`: the nearest number
    /// with edges on faces, if there is one. Along v it is otherwise even: with an odd number a
    /// cell is at rest, and errors of such grids fall differently.
    fn near(&self, k: usize, wanted: f64, fewest: usize) -> usize {
        let wanted = (wanted.ceil().min(1e15) as usize).max(fewest);
        let unit = if self.needs_even(k) { 2 } else { self.units[k].unwrap_or(1) };
        let above = wanted.next_multiple_of(unit);
        match above.checked_sub(unit) {
            // Small units are always rounded up.
            Some(below) if unit > 2 && below >= fewest && wanted - below < above - wanted => below,
            _ => above,
        }
    }

    /// About half of `n` elements along axis `k`, with a face at `v = 0` if one must be there.
    fn half(&self, k: usize, n: usize) -> usize {
        if k >= self.dimension() && !self.needs_even(k) {
            self.near(k, 0.5 * n as f64, 1)
        } else {
            n.div_ceil(2)
        }
    }

    /// The coarsest grid that is tried.
    pub fn coarsest(&self, own: &[usize]) -> Vec<usize> {
        let fewest = self.fewest[self.dimension() - 1];
        let enough = |k: u32| {
            let mut axes = own.iter().zip(&self.merged);
            axes.all(|(&n, merged)| *merged || n >> k >= fewest.min(n))
        };
        let halvings = (0..=COARSEST).rev().find(|&k| enough(k)).unwrap_or(0);
        let divisor = f64::from(1u32 << halvings);
        self.mapped(own, AxisGroup::All, |k, n| self.near(k, n as f64 / divisor, fewest.min(n)))
    }

    /// About `scale` times `shape` along the `axes` that are not merged.
    pub fn scaled(&self, shape: &[usize], axes: AxisGroup, scale: f64) -> Vec<usize> {
        // Not a cell more where a product misses a whole number by round-off.
        self.mapped(shape, axes, |k, n| self.near(k, n as f64 * scale * (1.0 - 1e-12), 2))
    }

    /// About `scale` times `shape`, with the edges of `V` at nearly the same positions within cells
    /// as on `shape`: errors of edges on faces and of edges within cells fall differently.
    pub fn alike(&self, shape: &[usize], scale: f64) -> Vec<usize> {
        self.mapped(shape, AxisGroup::All, |k, n| {
            let wanted = n as f64 * scale * (1.0 - 1e-12);
            if self.keeps(k, n) {
                return self.near(k, wanted, 2);
            }
            let edges = self.edges[k].as_deref().unwrap_or_default();
            // A finer grid is no coarser than wanted.
            let [least, most] = if scale < 1.0 { [0.8, 1.25] } else { [1.0, 1.25] };
            let [least, most] = [least, most].map(|part| ((part * wanted).ceil() as usize).max(2));
            let off = |m: usize| mismatch(&self.axes[k], edges, [n, m]) + ON_FACE;
            let away = |m: usize| (m as f64 - wanted).abs();
            // The nearest of those that are nearly as good as the best.
            let best = (least..=most).map(off).fold(f64::INFINITY, f64::min);
            let good = (least..=most).filter(|&m| off(m) <= best + ALIKE);
            good.min_by(|&a, &b| away(a).total_cmp(&away(b))).unwrap_or(most)
        })
    }

    /// Whether half of `cells` along axis `k` keeps its edges on faces, or is even where it must
    /// be.
    fn can_halve(&self, k: usize, cells: usize) -> bool {
        if self.needs_even(k) {
            cells.is_multiple_of(4)
        } else {
            cells.is_multiple_of(2) && self.keeps(k, cells / 2)
        }
    }

    /// Half of `shape` along all axes that are not merged; `None` if an edge would leave its face,
    /// or if that is less than half of the fewest elements that are tried.
    pub fn halved(&self, shape: &[usize]) -> Option<Vec<usize>> {
        let mut free = (0..shape.len()).filter(|&k| !self.merged[k]).peekable();
        free.peek()?;
        let fewest = self.fewest[self.dimension() - 1];
        let enough = |k: usize| shape[k] >= fewest.min(self.axes[k].elements());
        free.all(|k| enough(k) && self.can_halve(k, shape[k]))
            .then(|| self.mapped(shape, AxisGroup::All, |_, n| n / 2))
    }

    /// `shape` with the space axes `ratio` times finer relative to the velocity axes; `ratio` is a
    /// power of two. Above 1, each factor of two halves the velocity axes if they can be halved,
    /// and else doubles the space axes; below 1, the other way round.
    pub fn stretched(&self, shape: &[usize], ratio: f64) -> Vec<usize> {
        let n = self.dimension();
        let mut shape = shape.to_vec();
        let free = |axes: std::ops::Range<usize>| -> Vec<usize> {
            axes.filter(|&k| !self.merged[k]).collect()
        };
        let (space, velocity) = (free(0..n), free(n..2 * n));
        if space.is_empty() || velocity.is_empty() {
            return shape;
        }
        for _ in 0..ratio.log2().abs().round() as usize {
            let (finer, coarser) =
                if ratio > 1.0 { (&space, &velocity) } else { (&velocity, &space) };
            let can_halve = coarser.iter().all(|&k| shape[k] >= 8 && self.can_halve(k, shape[k]));
            if can_halve {
                coarser.iter().for_each(|&k| shape[k] /= 2);
            } else {
                finer.iter().for_each(|&k| shape[k] *= 2);
            }
        }
        shape
    }
}

/// Largest difference, in cells, between the positions of `edges` within their cells for two
/// numbers of elements along `axis`.
fn mismatch(axis: &Axis, edges: &[f64], numbers: [usize; 2]) -> f64 {
    let apart = |edge: &f64| {
        let part = (edge - axis.lower) / (axis.upper - axis.lower);
        let [a, b] = numbers.map(|n| part * n as f64);
        (a - b - (a - b).round()).abs()
    };
    edges.iter().map(apart).fold(0.0, f64::max)
}

/// Whether `n` elements along `axis` have faces at all `edges`.
fn keeps(axis: &Axis, edges: &[f64], n: usize) -> bool {
    edges.iter().all(|edge| {
        let place = (edge - axis.lower) / (axis.upper - axis.lower) * n as f64;
        (place - place.round()).abs() < ON_FACE
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    fn grids(edges: &[f64]) -> Grids {
        let axes = vec![Axis::new(-1.0, 2.0, 30); 2];
        Grids::over(axes, vec![Some(edges.to_vec()), None], FEWEST[0])
    }

    #[test]
    fn edges_stay_on_faces_and_velocities_even() {
        // Faces at 0 and 0.5: multiples of 6.
        let grids = grids(&[0.0, 0.5]);
        assert_eq!(grids.coarsest(&[30, 31]), [18, 16]);
        assert_eq!(grids.scaled(&[12, 8], AxisGroup::All, 1.6), [18, 14]);
        assert_eq!(grids.moved(&[16, 7]), [0]);
        assert!(grids.moved(&[18, 7]).is_empty());
        assert_eq!(grids.halved(&[12, 8]), Some(vec![6, 4]));
        assert_eq!(grids.halved(&[6, 8]), None);
        assert_eq!(grids.stretched(&[12, 16], 4.0), [12, 4]);
        // 3 would miss an edge and be coarser than what is tried; v gets finer instead.
        assert_eq!(grids.stretched(&[12, 16], 0.25), [6, 32]);
    }

    /// On coarser and finer grids, edges within cells have the same positions within cells as on
    /// the case's grid, to a few hundredths of a cell; edges on faces stay on faces.
    #[test]
    fn edges_within_cells_lie_alike() {
        let within = grids(&[0.313, 0.771]);
        let place = |edge: f64, n: usize| (edge + 1.0) / 3.0 * n as f64;
        for own in [128, 101] {
            for scale in [0.5, 0.25, 3.7, 20.0] {
                let found = within.alike(&[own, 64], scale);
                let ratio = found[0] as f64 / (own as f64 * scale);
                assert!((0.79..1.26).contains(&ratio), "{own} {scale}: {found:?}");
                assert_eq!(found[1], ((64.0 * scale).ceil() as usize).next_multiple_of(2));
                for edge in [0.313, 0.771] {
                    let off = place(edge, own) - place(edge, found[0]);
                    let off = (off - off.round()).abs();
                    // Coarse grids are few.
                    let allowed = if scale < 1.0 { 0.16 } else { 0.05 };
                    assert!(off < allowed, "{own} {scale}: {found:?} {edge} {off}");
                }
            }
        }
        let on_faces = grids(&[0.0, 0.5]);
        assert_eq!(on_faces.alike(&[48, 64], 0.5), on_faces.scaled(&[48, 64], AxisGroup::All, 0.5));
    }

    #[test]
    fn merged_axes_keep_their_cells() {
        let axis = || Axis::new(-1.0, 1.0, 32);
        let axes = vec![axis(), axis(), axis(), axis()];
        let grids = Grids::over(axes, vec![None; 4], FEWEST[0]);
        let grids = grids.with_merged(vec![false, true, false, true]);
        let shape = [32, 3, 16, 5];
        assert_eq!(grids.coarsest(&shape), [8, 3, 4, 5]);
        assert_eq!(grids.scaled(&shape, AxisGroup::All, 1.5), [48, 3, 24, 5]);
        assert_eq!(grids.doubled(&shape, AxisGroup::All), [64, 3, 32, 5]);
        assert_eq!(grids.doubled(&shape, AxisGroup::Velocity), [32, 3, 32, 5]);
        assert_eq!(grids.halved(&shape), Some(vec![16, 3, 8, 5]));
        assert_eq!(grids.stretched(&shape, 2.0), [32, 3, 8, 5]);
    }
}
