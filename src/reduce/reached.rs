//! Velocities that nothing ever reaches.
//!
//! Each term of a row of the scheme changes the indices along one axis only, `(i_a, j_a)`. So the cells that `f` reaches lie, for every axis
//! `a`, over those that it reaches in the plane `(x_a, v_a)`: begun with what is there at time zero and what enters, and closed under the
//! sources of the scheme with every jump that a face along `x_a` has anywhere, and every slope. In one dimension these are exactly the
//! cells of which a path of entries of `A` leads from data; in more, the product of the planes holds them all. What lies outside
//! stays exactly zero, so that rows there need not be computed; a source there counts as nothing.

use super::Reductions;
use crate::case::{Case, Limiter};
use crate::communicator::Group;
use crate::error::Result;
use crate::grid::{Cell, PhaseSpace};
use crate::output::hdf5::axis_names;
use crate::potential::{Potential, for_each_cell};
use crate::scheme::interface::{Side, Source, sources, velocity};
use crate::scheme::{Row, Scheme};
use std::collections::{BTreeMap, BTreeSet};
use std::ops::Range;

/// So many cells are looked at: a second or two.
const MOST_CELLS: usize = 20_000_000;
/// So many where rows of the scheme are looked at, as something enters.
const MOST_ROWS: usize = 4_000_000;
/// Of an axis with more jumps than this all velocities are kept.
const MOST_JUMPS: usize = 512;

/// Crops the velocity axes of `case` to what is reached. Collective over `world`.
///
/// # Errors
/// [`crate::error::Error::Formula`] where `V` is not finite.
pub(super) fn crop(world: &Group, case: &mut Case, said: &mut Reductions) -> Result<()> {
    if case.fields.len() > 1 {
        // Level sets vanish at single velocities only.
        return Ok(());
    }
    let cells = case.space.cells();
    let most = if case.enters() { MOST_ROWS } else { MOST_CELLS };
    let why = if case.varies() {
        Some("what enters depends on time".to_owned())
    } else if case.limiter != Limiter::None {
        Some("slopes (scheme.limiter) reach further than rows".to_owned())
    } else if cells > most {
        Some(format!("{cells} cells; at most {most} are looked through"))
    } else {
        None
    };
    if let Some(why) = why {
        said.kept.push(format!("velocities: all of them; {why}"));
        return Ok(());
    }
    let Some(mut planes) = filled(world, case)? else {
        return Ok(());
    };
    let potential = Potential::whole(case)?;
    let names = axis_names(case.space.dimension());
    let boxes: Vec<Range<usize>> = (planes.iter_mut().enumerate())
        .map(|(a, plane)| {
            Faces::new(&case.space, &potential, a).map_or(0..case.space.v[a].cells, |faces| {
                plane.close(&case.space, &faces, case);
                plane.velocities()
            })
        })
        .collect();
    for (a, range) in boxes.into_iter().enumerate() {
        let axis = &case.space.v[a];
        if range.is_empty() || range.len() == axis.cells {
            continue;
        }
        let window = axis.window(&range);
        let name = names[case.space.dimension() + a];
        said.dropped.push(format!(
            "{name}: nothing is ever outside of [{:.6}, {:.6}]; {} cells -> {}",
            window.lower, window.upper, axis.cells, window.cells
        ));
        case.space.v[a] = window;
    }
    Ok(())
}

/// Which cells of the plane of an axis are reached.
struct Plane {
    axis: usize,
    /// Velocities.
    cells: usize,
    /// 1 where it is, by space cell and velocity.
    reached: Vec<f64>,
}

impl Plane {
    fn at(&self, i: usize, j: usize) -> usize {
        i * self.cells + j
    }

    fn holds(&self, i: usize, j: i64) -> bool {
        (0..self.cells as i64).contains(&j) && self.reached[self.at(i, j as usize)] != 0.0
    }

    /// From the lowest velocity that is reached anywhere to the highest.
    fn velocities(&self) -> Range<usize> {
        let any = |j: &usize| self.reached[*j..].iter().step_by(self.cells).any(|r| *r != 0.0);
        let first = (0..self.cells).find(any).unwrap_or(0);
        let end = (0..self.cells).rev().find(any).map_or(0, |last| last + 1);
        first..end
    }

    /// Adds what takes from cells that are reached, until there is no more.
    fn close(&mut self, space: &PhaseSpace, faces: &Faces, case: &Case) {
        let a = self.axis;
        let (x, v) = (&space.x[a], &space.v[a]);
        // What a velocity finds behind a face with a jump.
        let mut behind: BTreeMap<u64, Vec<Vec<Source>>> = BTreeMap::new();
        for jump in faces.jumps.iter().flatten() {
            behind.entry(*jump).or_insert_with(|| {
                let list = |j: i64| {
                    let up = velocity(v, j) > 0.0;
                    let jump = f64::from_bits(*jump);
                    let mut list = Vec::new();
                    sources(&mut list, v, case.interface, j, if up { jump } else { -jump });
                    list
                };
                (0..v.cells as i64).map(list).collect()
            });
        }
        let takes = |plane: &Self, i: usize, j: usize| {
            let speed = velocity(v, j as i64);
            let (step, face) = if speed > 0.0 { (-1, i) } else { (1, (i + 1) % x.cells) };
            let across = i as i64 + step;
            let across = match space.is_periodic(a) {
                true => Some(across.rem_euclid(x.cells as i64) as usize),
                false => (0..x.cells as i64).contains(&across).then_some(across as usize),
            };
            let holds = |source: &Source| match (source.side, across) {
                (Side::Same, _) => plane.holds(i, source.velocity),
                (Side::Across, Some(across)) => plane.holds(across, source.velocity),
                (Side::Across, None) => false,
            };
            // What is behind the ends of the box is the inflow's, which is there from the start.
            let moved = speed != 0.0
                && across.is_some()
                && faces.jumps[face].iter().any(|jump| behind[jump][j].iter().any(holds));
            let [up, down] = faces.pushed[i];
            moved || up && plane.holds(i, j as i64 - 1) || down && plane.holds(i, j as i64 + 1)
        };
        // Back and forth along both axes, so that what moves one way gets there in one sweep.
        let order = |n: usize, back: bool| (0..n).map(move |k| if back { n - 1 - k } else { k });
        let mut changed = true;
        while changed {
            changed = false;
            for [back, down] in [[false, false], [false, true], [true, false], [true, true]] {
                for i in order(x.cells, back) {
                    for j in order(v.cells, down) {
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

/// What `V` does along an axis, anywhere across it.
struct Faces {
    /// The jumps at the lower face of each cell, by their bits.
    jumps: Vec<BTreeSet<u64>>,
    /// Whether the velocity of what is in each cell is pushed up, and down.
    pushed: Vec<[bool; 2]>,
}

impl Faces {
    /// Those along space axis `a`; none where there are too many jumps.
    fn new(space: &PhaseSpace, potential: &Potential, a: usize) -> Option<Self> {
        let cells = space.x[a].cells;
        let mut faces = Self {
            jumps: vec![BTreeSet::new(); cells],
            pushed: vec![[false; 2]; cells],
        };
        let ranges: Vec<Range<usize>> = space.x.iter().map(|x| 0..x.cells).collect();
        for_each_cell(&ranges, |i| {
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
}

/// The planes with what is there at time zero and where something enters; none where that is at all velocities. Collective.
fn filled(world: &Group, case: &Case) -> Result<Option<Vec<Plane>>> {
    let (space, n) = (&case.space, case.space.dimension());
    let mut planes: Vec<Plane> = (0..n)
        .map(|axis| Plane {
            axis,
            cells: space.v[axis].cells,
            reached: vec![0.0; space.x[axis].cells * space.v[axis].cells],
        })
        .collect();
    let scheme = case.enters().then(|| Scheme::whole(case)).transpose()?;
    let mut row = Row::default();
    let velocities = space.velocity_cells();
    let mut holds = |index: usize, cell: &Cell| {
        let field = &case.fields[0];
        // What is no number is found, and refused, later.
        field.initial.eval(&space.point(cell)) != 0.0
            || scheme.as_ref().is_some_and(|scheme| {
                scheme.row(&mut row, index);
                row.inflow[0] != 0.0
            })
    };
    let full = |planes: &[Plane]| {
        let ends = |plane: &Plane| plane.velocities().len() == plane.cells;
        planes.iter().all(ends)
    };
    for point in (world.rank()..space.space_cells()).step_by(world.size()) {
        let mut any = false;
        for index in point * velocities..(point + 1) * velocities {
            let cell = space.cell(index);
            if holds(index, &cell) {
                any = true;
                for plane in &mut planes {
                    let at = plane.at(cell[plane.axis], cell[n + plane.axis]);
                    plane.reached[at] = 1.0;
                }
            }
        }
        // Most that is no more than a decay is everywhere at once.
        if any && full(&planes) {
            break;
        }
    }
    for plane in &mut planes {
        world.max_into(&mut plane.reached);
    }
    Ok((!full(&planes)).then_some(planes))
}
