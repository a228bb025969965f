//! The field of a result from which a run continues (`initial.field`), read by each rank for its
//! block.

use crate::base::checksum;
use crate::base::error::{Error, Result};
use crate::base::row_major::{DatasetBox, volume};
use crate::parallel::communicator::{Communicator, Group};
use crate::parallel::files::{SharedFile, read_slab, stored_checksum};
use crate::parallel::partition::Block;
use crate::problem::case::StartField;
use crate::problem::grid::PhaseSpace;
use hdf5::Dataset;
use std::ops::Range;

/// Numbers read at a time: 4 MiB.
const PIECE: usize = 1 << 19;

/// `/f` of the file `start` on the cells of `block`, velocities fastest. An axis that the file's
/// run merged has one cell, whose value all cells get. Collective over the world.
///
/// # Errors
/// [`Error::Input`] if the file cannot be read, was changed, or contains NaN or infinity.
pub fn read(
    communicator: &Communicator,
    space: &PhaseSpace,
    block: &Block,
    start: &StartField,
) -> Result<Vec<f64>> {
    let world = &communicator.world;
    let wrong = |what: &dyn std::fmt::Display| start.wrong(what);
    SharedFile::read(world, &start.path, &wrong, |file| {
        let dataset = world.agree(file.dataset("f").map_err(|e| wrong(&e)))?;
        let part = StoredPart::of(&dataset, space, block);
        let part = world.agree(part.ok_or_else(|| wrong(&"/f has another shape than the grid")))?;
        part.read(&communicator.space, world, &dataset, &wrong)
    })
}

/// A rank's part of the dataset `/f`.
struct StoredPart {
    shape: Vec<usize>,
    /// Cells of the rank's block along each axis.
    wanted: Vec<Range<usize>>,
    /// These cells in the file: one cell along an axis that was merged.
    stored: Vec<Range<usize>>,
}

impl StoredPart {
    /// The part of `block`; `None` if the dataset does not have the shape of `space`.
    fn of(dataset: &Dataset, space: &PhaseSpace, block: &Block) -> Option<Self> {
        let shape = dataset.shape();
        let velocities = space.v.iter().map(|v| 0..v.cells);
        let wanted: Vec<Range<usize>> = block.ranges.iter().cloned().chain(velocities).collect();
        let cells = space.shape();
        let fits = |(found, cells): (&usize, &usize)| found == cells || *found == 1;
        if shape.len() != cells.len() || !shape.iter().zip(&cells).all(fits) {
            return None;
        }
        let axes = wanted.iter().zip(shape.iter().zip(&cells));
        let stored =
            axes.map(
                |(range, (found, cells))| {
                    if found == cells || range.is_empty() { range.clone() } else { 0..1 }
                },
            );
        Some(Self { stored: stored.collect(), shape, wanted })
    }

    /// Reads the numbers. Collective over `space`, whose blocks make up the grid, and `world`.
    fn read(
        &self,
        space: &Group,
        world: &Group,
        dataset: &Dataset,
        wrong: &dyn Fn(&dyn std::fmt::Display) -> Error,
    ) -> Result<Vec<f64>> {
        // Of the ranks that share a merged cell, only the first adds it to the checksum.
        let mut both = self.wanted.iter().zip(&self.stored);
        let adds = both.all(|(wanted, stored)| wanted == stored || wanted.start == 0);
        let mut sum = 0u64;
        let mine = self.pieces().try_fold(Vec::new(), |mut values: Vec<f64>, slab| {
            let piece = read_slab(dataset, &slab).map_err(|e| wrong(&e))?;
            if let Some(place) = piece.iter().position(|f| !f.is_finite()) {
                let what = format!("the {place}-th number from {:?}", slab.start);
                return Err(wrong(&format!("/f is {} at {what}", piece[place])));
            }
            if adds {
                sum = sum.wrapping_add(checksum::of_slab(&self.shape, &slab, &piece));
            }
            values.extend(piece);
            Ok(values)
        });
        let values = world.agree(mine)?;
        let expected = stored_checksum(dataset).map_err(|e| wrong(&e));
        let is_whole = space.sum_modulo(sum) == world.agree(expected)?;
        let damaged = || wrong(&"/f is not as it was written (its checksum differs)");
        world.agree(is_whole.then_some(()).ok_or_else(damaged))?;
        Ok(self.repeated(values))
    }

    /// The boxes of which the selection consists, in the order of reading.
    fn pieces(&self) -> impl Iterator<Item = DatasetBox> {
        let DatasetBox { start: first, count } = DatasetBox::of(&self.stored);
        let empty = count.contains(&0);
        DatasetBox::pieces(&count, PIECE).filter(move |_| !empty).map(move |mut slab| {
            slab.start.iter_mut().zip(&first).for_each(|(at, first)| *at += first);
            slab
        })
    }

    /// Repeats the value of a merged cell for all cells that it replaces.
    fn repeated(&self, values: Vec<f64>) -> Vec<f64> {
        if self.wanted == self.stored {
            return values;
        }
        let axes = self.wanted.iter().zip(&self.stored);
        axes.enumerate().fold(values, |values, (a, (wanted, stored))| {
            if wanted.len() == stored.len() {
                return values;
            }
            let inner = volume(&self.stored[a + 1..]);
            let lines = values.chunks_exact(inner.max(1));
            lines.flat_map(|line| line.repeat(wanted.len())).collect()
        })
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// A field that does not vary along an axis has one number for all cells along it.
    #[test]
    fn numbers_that_stand_for_others_are_repeated() {
        let cells = [2, 3, 2, 4];
        for stored in [[2, 3, 2, 4], [2, 1, 2, 4], [1, 3, 1, 4], [2, 1, 1, 4], [1, 1, 1, 1]] {
            let ranges = |lengths: [usize; 4]| lengths.map(|length| 0..length).to_vec();
            let part = StoredPart {
                shape: stored.to_vec(),
                wanted: ranges(cells),
                stored: ranges(stored),
            };
            let count: usize = stored.iter().product();
            let values: Vec<f64> = (0..count).map(|i| i as f64).collect();
            let number = |mut i: usize| {
                let mut place = [0; 4];
                for a in (0..4).rev() {
                    (place[a], i) = (i % cells[a] % stored[a], i / cells[a]);
                }
                (0..4).fold(0, |number, a| number * stored[a] + place[a])
            };
            let expected: Vec<f64> =
                (0..cells.iter().product()).map(|i| number(i) as f64).collect();
            assert_eq!(part.repeated(values), expected, "{stored:?}");
        }
    }
}
