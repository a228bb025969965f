//! Where planes cut the axes that they do not run along.

use crate::base::error::{Error, Result};
use crate::base::text::short;
use crate::results::pictures::jumps::jumps;
use crate::results::pictures::stored::Stored;

/// Where planes cut the axes that they do not run along: cell by axis in storage order.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Cut(pub Vec<usize>);

impl Cut {
    /// The default cut, in the middle; along axes of space at the nearest cell to the middle that
    /// is not next to a jump of `V`, where `f` may be of either side.
    pub fn usual(run: &Stored) -> Self {
        let mut cut = Self::middle(run);
        for a in 0..run.dimension() {
            let (axis, faces) = (run.axis(a), jumps(run, a, &cut.0));
            let at_jump = |cell: usize| {
                let element = axis.split(cell as i64).0;
                faces.contains(&axis.face(element)) || faces.contains(&axis.face(element + 1))
            };
            let away = |cell: &usize| cell.abs_diff(cut.0[a]);
            let free = (0..axis.cells).filter(|cell| !at_jump(*cell));
            // Of two the upper one, as of an even number of cells.
            if let Some(cell) = free.rev().min_by_key(away) {
                cut.0[a] = cell;
            }
        }
        cut
    }

    /// Through the middle cells (cell N/2, counted from 0), as `fields.xdmf` does.
    pub fn middle(run: &Stored) -> Self {
        Self((0..2 * run.dimension()).map(|a| run.axis(a).cells / 2).collect())
    }

    /// As `text` says, `x=0.1,vy=0`; as [usual](Self::usual) along axes that it does not name.
    ///
    /// # Errors
    /// [`Error::Input`] where it names no axis of the run, or a place outside of the box.
    pub fn parse(run: &Stored, text: &str) -> Result<Self> {
        let wrong = |why: String| Error::Input(format!("--slice {text}: {why}"));
        let names = run.names();
        if run.dimension() == 1 {
            let why = "in one dimension all of phase space is shown".to_owned();
            return Err(wrong(why));
        }
        let mut cut = Self::usual(run);
        let mut named = Vec::new();
        for part in text.split(',') {
            let (name, place) = (part.split_once('='))
                .ok_or_else(|| wrong(format!("\"{part}\" is not NAME=POSITION, as x=0.1")))?;
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
            if !(axis.lower..=axis.upper).contains(&place) {
                let (lower, upper) = (axis.lower, axis.upper);
                let name = names[a];
                return Err(wrong(format!("{name} goes from {lower} to {upper}")));
            }
            cut.0[a] = axis.cell_at(place);
        }
        Ok(cut)
    }

    /// Where it lies along the axes other than `plane`, in words.
    pub fn place(&self, run: &Stored, plane: [usize; 2], axes: std::ops::Range<usize>) -> String {
        let others = axes.filter(|a| !plane.contains(a));
        let at = |a: usize| {
            let centre = run.axis(a).centre(self.0[a] as i64);
            format!("{} = {}", run.names()[a], short(centre))
        };
        others.map(at).collect::<Vec<_>>().join(", ")
    }
}
