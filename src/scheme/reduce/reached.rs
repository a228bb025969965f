//! Velocities that no particle ever reaches.
//!
//! Each term of a row of the scheme changes the indices along one axis only, `(i_a, j_a)`. So, for
//! every axis `a`, the cells that `f` reaches project into a set of cells of the plane `(x_a,
//! v_a)`: the smallest set that contains the initial data and the inflow and is closed under the
//! sources of the scheme, with every jump and slope that occurs anywhere along `x_a`. In one
//! dimension the set is exact: a path of entries of `A` leads from data to each of its cells. In
//! more dimensions the product of the sets contains all reached cells. Cells outside stay exactly
//! zero: their rows are not computed, and sources there are zero. For degrees above 0 the same
//! holds for elements.

mod elements;

use crate::base::error::Result;
use crate::base::text::coordinate_text;
use crate::parallel::communicator::Group;
use crate::problem::case::{Case, Limiter, Reductions};
use crate::problem::grid::{Cell, PhaseSpace, axis_names, for_each_cell};
use crate::problem::potential::Potential;
use crate::scheme::interface::energy::FaceSide;
use crate::scheme::interface::{FluxSource, SourceSide, sources, velocity};
use crate::scheme::reduce::reached::elements::{Links, PlaneFace, Points};
use crate::scheme::rows::{Row, Scheme};
use std::collections::{BTreeMap, BTreeSet};
use std::ops::Range;

/// Largest number of cells that are examined: a second or two.
const MOST_CELLS: usize = 20_000_000;
/// Largest number of cells if rows of the scheme are examined because of inflow.
const MOST_ROWS: usize = 4_000_000;
/// All velocities of an axis with more jumps than this are kept.
const MOST_JUMPS: usize = 512;

/// Crops the velocity axes of `case` to the velocities that are reached. Collective over `world`.
///
/// # Errors
/// [`crate::base::error::Error::Formula`] where `V` is not finite.
pub(crate) fn crop(world: &Group, case: &mut Case, reductions: &mut Reductions) -> Result<()> {
    if case.fields.len() > 1 {
        // Level sets vanish at single velocities only.
        return Ok(());
    }
    let cells = match case.space.whole_degree() {
        0 => case.space.cells(),
        _ => case.space.by_elements().cells().saturating_mul(Points::new(&case.space).count()),
    };
    let most = if case.enters() { MOST_ROWS } else { MOST_CELLS };
    let why = if case.varies() {
        Some("what enters depends on time".to_owned())
    } else if case.scheme.limiter != Limiter::None {
        Some("slopes (scheme.limiter) reach further than rows".to_owned())
    } else if cells > most {
        Some(format!("a search for empty ones takes at most {most} cells, and there are {cells}"))
    } else {
        None
    };
    if let Some(why) = why {
        reductions.kept.push(format!("velocities: all of them; {why}"));
        return Ok(());
    }
    // An error is that of the potential, the same on all ranks.
    let mut planes = filled(case, world.rank(), world.size())?;
    for plane in &mut planes {
        world.max_into(&mut plane.reached);
    }
    if planes.iter().all(ReachedPlane::is_full) {
        return Ok(());
    }
    let boxes = boxes(case, planes)?;
    let names = axis_names(case.space.dimension());
    for (a, range) in boxes.into_iter().enumerate() {
        let axis = &case.space.v[a];
        if range.is_empty() || range.len() == axis.elements() {
            continue;
        }
        let window = axis.window(&range);
        let name = names[case.space.dimension() + a];
        reductions.dropped.push(format!(
            "{name}: nothing is ever outside of [{}, {}]; {} cells -> {}",
            coordinate_text(window.lower, window.width()),
            coordinate_text(window.upper, window.width()),
            axis.cells,
            window.cells
        ));
        case.space.v[a] = window;
    }
    Ok(())
}

/// The velocities that are reached along each axis, from those in `planes`.
fn boxes(case: &Case, planes: Vec<ReachedPlane>) -> Result<Vec<Range<usize>>> {
    let potential = Potential::whole(case)?;
    let close = |mut plane: ReachedPlane| {
        let a = plane.axis;
        let closed = if case.is_galerkin() {
            Links::new(case, &potential, a, MOST_JUMPS).map(|links| {
                plane.close(|plane, i, j| links.take(|i, j| plane.holds(i, j), i, j));
            })
        } else {
            Faces::new(&case.space, &potential, a).map(|faces| {
                let takes = faces.takes(case, a);
                plane.close(takes);
            })
        };
        closed.map_or(0..plane.cells, |()| plane.velocities())
    };
    Ok(planes.into_iter().map(close).collect())
}

/// The reached cells in the plane of an axis; for degrees above 0, the reached elements.
struct ReachedPlane {
    axis: usize,
    /// Cells of velocity.
    cells: usize,
    /// By space cell and velocity: 1 for a cell that is reached, else 0.
    reached: Vec<f64>,
}

impl ReachedPlane {
    fn at(&self, i: usize, j: usize) -> usize {
        i * self.cells + j
    }

    fn holds(&self, i: usize, j: i64) -> bool {
        (0..self.cells as i64).contains(&j) && self.reached[self.at(i, j as usize)] != 0.0
    }

    /// Whether the lowest and the highest velocity are reached somewhere.
    fn is_full(&self) -> bool {
        self.velocities().len() == self.cells
    }

    /// From the lowest velocity that is reached anywhere to the highest.
    fn velocities(&self) -> Range<usize> {
        let any = |j: &usize| self.reached[*j..].iter().step_by(self.cells).any(|r| *r != 0.0);
        let first = (0..self.cells).find(any).unwrap_or(0);
        let end = (0..self.cells).rev().find(any).map_or(0, |last| last + 1);
        first..end
    }

    /// Adds cells whose rows depend on reached ones, by `takes`, until there are no more.
    fn close(&mut self, takes: impl Fn(&Self, usize, usize) -> bool) {
        let cells = self.reached.len() / self.cells;
        // Back and forth along both axes, so that motion in any direction takes one sweep.
        let order = |n: usize, back: bool| (0..n).map(move |k| if back { n - 1 - k } else { k });
        let mut changed = true;
        while changed {
            changed = false;
            for [back, down] in [[false, false], [false, true], [true, false], [true, true]] {
                for i in order(cells, back) {
                    for j in order(self.cells, down) {
                        let at = self.at(i, j);
                        if self.reached[at] == 0.0 && takes(self, i, j) {
                            self.reached[at] = 1.0;
                            changed = true;
                        }
                    }
                }
            }
        }
    }
}

/// The jumps and slopes of `V` along an axis, for all positions across it.
struct Faces {
    /// The jumps at the lower face of each cell, by their bits.
    jumps: Vec<BTreeSet<u64>>,
    /// Whether `V` pushes the velocity of particles in each cell up, and down.
    pushed: Vec<[bool; 2]>,
}

impl Faces {
    /// The faces along space axis `a`; none where there are too many jumps.
    fn new(space: &PhaseSpace, potential: &Potential, a: usize) -> Option<Self> {
        let cells = space.x[a].cells;
        let mut faces =
            Self { jumps: vec![BTreeSet::new(); cells], pushed: vec![[false; 2]; cells] };
        for_each_cell(&space.space_ranges(), |i| {
            let slope = potential.slope(i, a);
            let [up, down] = &mut faces.pushed[i[a]];
            *up |= slope < 0.0;
            *down |= slope > 0.0;
            if faces.jumps[i[a]].len() <= MOST_JUMPS {
                faces.jumps[i[a]].insert(potential.jump_below(i, a).to_bits());
            }
        });
        let all: BTreeSet<&u64> = faces.jumps.iter().flatten().collect();
        (all.len() <= MOST_JUMPS).then_some(faces)
    }

    /// Whether the row of a cell depends on a reached cell.
    fn takes<'a>(
        &'a self,
        case: &'a Case,
        a: usize,
    ) -> impl Fn(&ReachedPlane, usize, usize) -> bool + 'a {
        let space = &case.space;
        let v = &space.v[a];
        // The velocities behind a face with a jump.
        let mut behind: BTreeMap<u64, Vec<Vec<FluxSource>>> = BTreeMap::new();
        for jump in self.jumps.iter().flatten() {
            behind.entry(*jump).or_insert_with(|| {
                let list = |j: i64| {
                    let up = velocity(v, j) > 0.0;
                    let jump = f64::from_bits(*jump);
                    let mut list = Vec::new();
                    sources(&mut list, v, case.scheme.interface, j, if up { jump } else { -jump });
                    list
                };
                (0..v.cells as i64).map(list).collect()
            });
        }
        move |plane, i, j| {
            let speed = velocity(v, j as i64);
            let side = if speed > 0.0 { FaceSide::Above } else { FaceSide::Below };
            let PlaneFace { number, across } = PlaneFace::of(space, a, i, side);
            let holds = |source: &FluxSource| match (source.side, across) {
                (SourceSide::Same, _) => plane.holds(i, source.velocity),
                (SourceSide::Across, Some(across)) => plane.holds(across, source.velocity),
                (SourceSide::Across, None) => false,
            };
            // Cells beyond the ends of the box are inflow, which is in the set from the start.
            let moved = speed != 0.0
                && across.is_some()
                && self.jumps[number].iter().any(|jump| behind[jump][j].iter().any(holds));
            let [up, down] = self.pushed[i];
            moved || up && plane.holds(i, j as i64 - 1) || down && plane.holds(i, j as i64 + 1)
        }
    }
}

/// The planes with the initial data and the inflow at every `of`-th point of space from `first` on.
/// The walk ends early when the planes are full.
fn filled(case: &Case, first: usize, of: usize) -> Result<Vec<ReachedPlane>> {
    // For degree 0, elements are cells.
    let (space, n) = (case.space.by_elements(), case.space.dimension());
    let mut planes: Vec<ReachedPlane> = (0..n)
        .map(|axis| ReachedPlane {
            axis,
            cells: space.v[axis].cells,
            reached: vec![0.0; space.x[axis].cells * space.v[axis].cells],
        })
        .collect();
    // Whether the lowest and the highest velocity of each plane are reached somewhere.
    let mut ends = vec![[false; 2]; n];
    let points = (case.space.whole_degree() > 0).then(|| Points::new(&case.space));
    let scheme = case.enters().then(|| Scheme::whole(case)).transpose()?;
    let mut row = Row::default();
    let velocities = space.velocity_cells();
    let initial = &case.fields[0].initial;
    let ranges = space.space_ranges();
    let mut enters = |element: &Cell| {
        scheme.as_ref().is_some_and(|scheme| {
            case.space.cells_of(element, &ranges).any(|index| {
                scheme.row(&mut row, index);
                row.inflow[0] != 0.0
            })
        })
    };
    for point in (first..space.space_cells()).step_by(of) {
        let elements: Vec<Cell> =
            (point * velocities..(point + 1) * velocities).map(|index| space.cell(index)).collect();
        let holds: Vec<bool> = match &points {
            // NaN is detected and refused later.
            None => {
                let centres: Vec<[f64; 6]> = elements.iter().map(|e| space.point(e)).collect();
                initial.at_points(&centres, 0.0).into_iter().map(|f| f != 0.0).collect()
            }
            Some(points) => elements.iter().map(|e| points.find(&case.space, initial, e)).collect(),
        };
        for (element, holds) in elements.into_iter().zip(holds) {
            if holds || enters(&element) {
                for (plane, [lowest, highest]) in planes.iter_mut().zip(&mut ends) {
                    let (i, j) = (element[plane.axis], element[n + plane.axis]);
                    let at = plane.at(i, j);
                    plane.reached[at] = 1.0;
                    *lowest |= j == 0;
                    *highest |= j + 1 == plane.cells;
                }
            }
        }
        // Data that are nowhere zero, such as a Gaussian, reach both ends of every plane at once.
        if ends.iter().all(|ends| *ends == [true; 2]) {
            break;
        }
    }
    Ok(planes)
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Dimension and settings.
    const SCENES: [(&str, &[&str]); 17] = [
        ("1", &[]),
        ("1", &["scheme.interface=conservative"]),
        ("1", &["potential.0.value=0", "potential.1.value=0.2"]),
        ("1", &["potential.0.where=abs(x) < 0.5", "potential.0.value=-0.2"]),
        ("1", &["potential.0.value=0.1*x"]),
        ("1", &["axis.0.x.boundary=periodic"]),
        ("1", &["initial.f=0", "inflow.value=1 if x < 0 && v > 0.2 && v < 0.5 else 0"]),
        ("2", &[]),
        ("1", &["scheme.degree=2", CENTRED, "axis.0.v.lower=-1.4"]),
        (
            "1",
            &[
                "scheme.degree=3", "axis.0.v.degree=1", "scheme.flux=1", CENTRED,
                "axis.0.v.lower=-1.4",
            ],
        ),
        ("1", &["scheme.degree=1", CENTRED, "axis.0.v.lower=-1.4", "potential.0.value=0.1*x"]),
        (
            "1",
            &["scheme.degree=2", CENTRED, "axis.0.v.lower=-1.4", "potential.0.reflection=exp(-E)"],
        ),
        ("1", &[CENTRED, "axis.0.v.lower=-1.4", "potential.0.reflection=exp(-E)"]),
        (
            "2",
            &[
                "scheme.degree=1", "axis.0.v.upper=1.5", "axis.0.v.lower=-1.5",
                "axis.1.v.upper=1.5", "axis.1.v.lower=-1.5", "axis.0.v.cells=6",
                "axis.1.v.cells=6",
            ],
        ),
        // The walk over the data fills one plane before the other.
        ("2", &["initial.f=abs(vy) < 0.2 if x < 0 else abs(vx) < 0.2 && abs(vy - 0.3) < 0.7"]),
        // Only the last nodes of elements draw from what enters at an upper end.
        (
            "1",
            &[
                "scheme.degree=2",
                "scheme.flux=1",
                CENTRED,
                "axis.0.v.lower=-1.4",
                "initial.f=0",
                "inflow.value=1 if x > 0 && v > -0.5 && v < -0.2 else 0",
            ],
        ),
        // Only what goes around the axis meets the slope.
        (
            "1",
            &[
                "scheme.degree=1",
                "scheme.flux=1",
                CENTRED,
                "axis.0.v.lower=-1.4",
                "axis.0.x.boundary=periodic",
                "potential.0.where=x < -0.75",
                "potential.0.value=0.1*x",
                "initial.f=abs(x) < 0.3 && abs(v - 0.4) < 0.3",
            ],
        ),
    ];
    /// The choice puts `v = 0` on a face.
    const CENTRED: &str = "axis.0.v.upper=1.4";

    fn scene(dimension: &str, settings: &[&str]) -> Case {
        let axis = "[[axis]]\nx = { lower = -1, upper = 1, cells = 8 }\n\
                    v = { lower = -1.3, upper = 1.5, cells = 14 }\n";
        let (axes, f) = match dimension {
            "1" => (axis.to_owned(), "abs(x + 0.5) < 0.3 && abs(v - 0.4) < 0.3"),
            _ => (
                axis.replace("14", "7").repeat(2),
                "abs(x + 0.5) < 0.3 && abs(vx - 0.4) < 0.3 && abs(y) < 0.3 && abs(vy) < 0.3",
            ),
        };
        let text = format!(
            "{axes}[[potential]]\nwhere = \"x < 0\"\nvalue = \"0.2\"\n[[potential]]\n\
             value = \"0\"\n\
             [initial]\nf = \"{f}\"\n[time]\nend = 1.0\n"
        );
        let settings: Vec<String> = settings.iter().map(|s| (*s).to_owned()).collect();
        Case::parse("scene", &text, &settings).expect("a case")
    }

    /// A walk over the rows of the whole grid reaches no cell outside of the boxes, and in one
    /// dimension the boxes are the smallest possible.
    #[test]
    fn boxes_hold_what_rows_reach() {
        for (dimension, settings) in SCENES {
            let case = scene(dimension, settings);
            let (space, n) = (&case.space, case.space.dimension());
            let ranges = space.space_ranges();
            let scheme = Scheme::whole(&case).expect("a potential");
            let mut row = Row::default();
            let elements = space.by_elements();
            let points = (space.degree() > 0).then(|| Points::new(space));
            let initial = &case.fields[0].initial;
            let begun: BTreeSet<usize> = (0..elements.cells())
                .map(|index| elements.cell(index))
                .filter(|element| match &points {
                    None => initial.eval(&space.point(element)) != 0.0,
                    Some(points) => points.find(space, initial, element),
                })
                .flat_map(|element| space.cells_of(&element, &ranges))
                .collect();
            let mut reached = vec![false; space.cells()];
            let (mut before, mut now) = (0, 1);
            while now != before {
                before = now;
                for index in 0..space.cells() {
                    scheme.row(&mut row, index);
                    reached[index] |= begun.contains(&index)
                        || row.inflow[0] != 0.0
                        || row.entries.iter().any(|(column, _)| reached[*column]);
                }
                now = reached.iter().filter(|r| **r).count();
            }
            let planes = filled(&case, 0, 1).expect("planes");
            let boxes = boxes(&case, planes).expect("boxes");
            for (a, range) in boxes.iter().enumerate() {
                let found = (0..space.cells()).filter(|&i| reached[i]);
                let element = |j: usize| j / space.v[a].nodes.count();
                let found: BTreeSet<usize> = found.map(|i| element(space.cell(i)[n + a])).collect();
                let least = *found.first().expect("data")..found.last().expect("data") + 1;
                let holds = range.start <= least.start && least.end <= range.end;
                assert!(holds, "{settings:?}: {least:?} in {range:?}");
                if n == 1 {
                    assert_eq!(*range, least, "{settings:?}");
                }
            }
            let cropped = boxes.iter().any(|r| r.len() < space.v[0].elements());
            let spreads = space.degree() > 0 && case.scheme.flux < 1.0 && !case.reflects();
            let slopes = settings.iter().any(|s| s.contains("0.1*x"));
            assert!(cropped || spreads || slopes, "{settings:?}: {boxes:?}");
        }
    }

    /// The formula of the inflow may be nonzero at cells that were left out. Their field is zero
    /// all the same, and no inflow comes from there.
    #[test]
    fn removed_cells_have_no_inflow() {
        let inside = "inflow.value=1 if abs(x) < 0.9 && abs(v) < 1.2 else 0";
        let steps = [inside, "scheme.degree=2", "scheme.flux=1", CENTRED, "axis.0.v.lower=-1.4"];
        for settings in [&[inside][..], &[inside, "scheme.interface=conservative"], &steps] {
            let whole = scene("1", settings);
            let planes = filled(&whole, 0, 1).expect("planes");
            let range = boxes(&whole, planes).expect("boxes")[0].clone();
            let mut cropped = whole.clone();
            cropped.space.v[0] = whole.space.v[0].window(&range);
            let first = range.start * whole.space.v[0].nodes.count();
            // Cells that depend on cells outside the reduced grid, by their numbers in the whole
            // grid.
            let drawing = |case: &Case, first: usize| -> BTreeSet<[usize; 2]> {
                let scheme = Scheme::whole(case).expect("a potential");
                let mut row = Row::default();
                let mut draws = |index: &usize| {
                    scheme.row(&mut row, *index);
                    assert_eq!(row.inflow[0], 0.0, "{settings:?}: row {index}");
                    row.inflow_rate > 1e-12
                };
                let cells: Vec<usize> = (0..case.space.cells()).filter(|i| draws(i)).collect();
                let cells = cells.into_iter().map(|index| case.space.cell(index));
                cells.map(|cell| [cell[0], cell[1] + first]).collect()
            };
            assert!(!drawing(&cropped, first).is_subset(&drawing(&whole, 0)), "{settings:?}");
        }
    }
}
