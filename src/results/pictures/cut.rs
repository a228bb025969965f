//! The positions at which a drawn plane cuts the other axes.

use crate::base::error::{Error, Result};
use crate::base::row_major::{DatasetBox, indices};
use crate::base::text::short;
use crate::results::FileResult;
use crate::results::pictures::jumps::jumps;
use crate::results::pictures::stored::{StoredRun, StoredTime};

/// The cell of each axis through which planes of other axes are drawn.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Cut {
    /// The cell of each axis, in storage order.
    pub cells: Vec<usize>,
    /// Whether the cells were chosen from the data.
    by_data: bool,
}

/// The cut takes the cell nearest to the middle among those whose density is at least this part of
/// the largest one.
const DENSE: f64 = 0.9;

impl Cut {
    /// The default cut. In more than one dimension it goes through the space cell with the largest
    /// density, summed over `times`, and there through the velocity with the largest `|f|`, or the
    /// mean velocity of measure-valued data. It avoids cells next to a jump of `V`, where `f` may
    /// be that of either side. In one dimension, and if the file lacks data, it goes through the
    /// middle.
    pub fn densest(run: &StoredRun, times: &[StoredTime]) -> Self {
        match run.dimension() {
            1 => Self::middle(run),
            _ => Self::by_data(run, times).unwrap_or_else(|_| Self::middle(run)),
        }
    }

    fn by_data(run: &StoredRun, times: &[StoredTime]) -> FileResult<Self> {
        let mut cut = Self { by_data: true, ..Self::middle(run) };
        let n = run.dimension();
        let lengths: Vec<usize> = (0..n).map(|a| run.axis(a).cells).collect();
        let mut density = vec![0.0; lengths.iter().product()];
        for time in times {
            for (sum, value) in density.iter_mut().zip(run.moment(*time, "density")?) {
                *sum += if value.is_finite() { value.abs() } else { 0.0 };
            }
        }
        let dense = densest(&density, &lengths, |_| true);
        cut.cells[..n].copy_from_slice(&dense);
        for a in 0..n {
            let (axis, faces) = (run.axis(a), jumps(run, a, &cut.cells));
            let free = |cell: usize| {
                let element = axis.element_of(cell as i64);
                !faces.contains(&axis.face(element)) && !faces.contains(&axis.face(element + 1))
            };
            if free(cut.cells[a]) || !(0..axis.cells).any(free) {
                continue;
            }
            let at = cut.cells.clone();
            let on_line = |cell: &[usize]| (0..n).all(|b| b == a || cell[b] == at[b]);
            cut.cells[a] = densest(&density, &lengths, |cell| on_line(cell) && free(cell[a]))[a];
        }
        let velocities = fastest(run, times, &cut.cells[..n])?;
        cut.cells[n..].copy_from_slice(&velocities);
        Ok(cut)
    }

    /// The sentence of a caption about a [densest](Self::densest) cut; empty for other cuts.
    pub fn sentence(&self, run: &StoredRun) -> &'static str {
        match (self.by_data, run.is_measure()) {
            (false, _) => "",
            (true, true) => " Planes go through the largest density, at the mean velocity there.",
            (true, false) => " Planes go through the largest density, and the largest |f| there.",
        }
    }

    /// The cut through the middle cells (cell N/2, counted from 0), as `fields.xdmf` has it.
    pub fn middle(run: &StoredRun) -> Self {
        let cells = (0..2 * run.dimension()).map(|a| run.axis(a).cells / 2).collect();
        Self { cells, by_data: false }
    }

    /// The cut that `text` gives, such as `x=0.1,vy=0`. Along axes that it does not name it is the
    /// [densest](Self::densest) one at the end of the run.
    ///
    /// # Errors
    /// [`Error::Input`] if it names an unknown axis, or a position outside of the box.
    pub fn parse(run: &StoredRun, text: &str) -> Result<Self> {
        let wrong = |why: String| Error::Input(format!("--slice {text}: {why}"));
        let names = run.names();
        if run.dimension() == 1 {
            let why = "in one dimension all of phase space is shown".to_owned();
            return Err(wrong(why));
        }
        let mut cut = Self { by_data: false, ..Self::densest(run, &[run.end()]) };
        let mut named = Vec::new();
        for part in text.split(',') {
            let (name, place) = (part.split_once('='))
                .ok_or_else(|| wrong(format!("\"{part}\" is not NAME=POSITION, such as x=0.1")))?;
            let a = (names.iter().position(|n| *n == name.trim())).ok_or_else(|| {
                wrong(format!("\"{}\" is no axis; {} are", name.trim(), names.join(", ")))
            })?;
            if named.contains(&a) {
                return Err(wrong(format!("{} is given twice", names[a])));
            }
            named.push(a);
            let axis = run.axis(a);
            let place: f64 = place
                .trim()
                .parse()
                .map_err(|_| wrong(format!("\"{}\" is not a number", place.trim())))?;
            cut.cells[a] = axis.cell_holding(place).ok_or_else(|| {
                wrong(format!("{} goes from {} to {}", names[a], axis.lower, axis.upper))
            })?;
        }
        Ok(cut)
    }

    /// The positions on those of `axes` that are not in `plane`, as the end of a title:
    /// ` at y = 0.1, vy = 0`. It is empty if there are none.
    pub fn at(&self, run: &StoredRun, plane: [usize; 2], axes: std::ops::Range<usize>) -> String {
        let others = axes.filter(|a| !plane.contains(a));
        let place = |a: usize| {
            let centre = run.axis(a).centre(self.cells[a] as i64);
            format!("{} = {}", run.names()[a], short(centre))
        };
        let places = others.map(place).collect::<Vec<_>>().join(", ");
        if places.is_empty() { places } else { format!(" at {places}") }
    }
}

/// The indices of the cell with the largest density among those that are `allowed`. Of cells with
/// almost that density ([`DENSE`]) the nearest to the middle is taken, and of two of these the
/// upper one.
fn densest(density: &[f64], lengths: &[usize], allowed: impl Fn(&[usize]) -> bool) -> Vec<usize> {
    let cells = || {
        (density.iter().enumerate())
            .map(|(place, value)| (indices(place, lengths), *value))
            .filter(|(cell, _)| allowed(cell))
    };
    let largest = cells().fold(0.0, |largest: f64, (_, value)| largest.max(value));
    // Squared distance from the middle, relative to the lengths of the axes.
    let away = |cell: &[usize]| -> f64 {
        let parts = cell.iter().zip(lengths).map(|(i, n)| {
            let part = (*i as f64 - (*n / 2) as f64) / *n as f64;
            part * part
        });
        parts.sum()
    };
    let good = cells().filter(|(_, value)| *value >= DENSE * largest);
    let places = good.map(|(cell, _)| (away(&cell), cell));
    let nearest = places.min_by(|a, b| a.0.total_cmp(&b.0).then_with(|| b.1.cmp(&a.1)));
    nearest.map_or_else(|| lengths.iter().map(|n| n / 2).collect(), |(_, cell)| cell)
}

/// The velocity cell with the largest `|f|`, summed over `times`, in the space cell `at`; for
/// measure-valued data that of the mean velocity at the end.
fn fastest(run: &StoredRun, times: &[StoredTime], at: &[usize]) -> FileResult<Vec<usize>> {
    let n = run.dimension();
    let here = at.iter().map(|i| *i..i + 1);
    if run.is_measure() {
        let one = |a: usize| {
            let ranges: Vec<_> = std::iter::once(a..a + 1).chain(here.clone()).collect();
            let mean = run.slab("velocity", &DatasetBox::of(&ranges))?;
            let (axis, mean) = (run.axis(n + a), mean.first().copied().unwrap_or(f64::NAN));
            Ok(axis.cell_holding(mean).unwrap_or(axis.cells / 2))
        };
        return (0..n).map(one).collect();
    }
    let lengths: Vec<usize> = (n..2 * n).map(|a| run.axis(a).cells).collect();
    let ranges: Vec<_> = here.chain(lengths.iter().map(|cells| 0..*cells)).collect();
    let mut sizes = vec![0.0; lengths.iter().product()];
    for time in times {
        for (sum, value) in sizes.iter_mut().zip(run.field_slab(*time, "f", &ranges)?) {
            *sum += if value.is_finite() { value.abs() } else { 0.0 };
        }
    }
    Ok(densest(&sizes, &lengths, |_| true))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_densest_cell_is_taken_and_of_equals_the_middle() {
        let all = |_: &[usize]| true;
        let mut density = vec![0.0; 20];
        assert_eq!(densest(&density, &[4, 5], all), [2, 2]);
        density[3] = 1.0;
        assert_eq!(densest(&density, &[4, 5], all), [0, 3]);
        // As good, and nearer to the middle.
        density[13] = 0.95;
        assert_eq!(densest(&density, &[4, 5], all), [2, 3]);
        assert_eq!(densest(&density, &[4, 5], |cell| cell[0] != 2), [0, 3]);
        // Beside the middle of an even number of cells.
        assert_eq!(densest(&[0.0, 1.0, 0.0, 1.0], &[4], all), [3]);
        assert_eq!(indices(13, &[4, 5]), [2, 3]);
    }
}
