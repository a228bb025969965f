//! The positions at which `V` jumps, for pictures.

use crate::problem::potential::Potential;
use crate::results::pictures::stored::StoredRun;

/// Faces at which `V` jumps along space axis `a`, on the line through the cells of a
/// [`Cut`](crate::results::pictures::cut::Cut); empty if the case is unknown. The end of a periodic
/// axis is listed twice, at both ends.
pub fn jumps(run: &StoredRun, a: usize, cut: &[usize]) -> Vec<f64> {
    let Some(potential) = potential_along(run, &[a], cut) else { return Vec::new() };
    let mut cell = cut[..run.dimension()].to_vec();
    let axis = run.axis(a);
    // Below the first cell there is a jump only on a periodic axis.
    let is_above_jump = |i: &usize| {
        cell[a] = *i;
        potential.jump_below(&cell, a) != 0.0
    };
    let mut found: Vec<usize> = (0..axis.cells).filter(is_above_jump).collect();
    if found.first() == Some(&0) {
        found.push(axis.cells);
    }
    found.into_iter().map(|i| axis.face(axis.element_of(i as i64))).collect()
}

/// `V` on all cells of these axes, through the cells of a cut along others.
fn potential_along(run: &StoredRun, axes: &[usize], cut: &[usize]) -> Option<Potential> {
    let mut ranges: Vec<_> = (0..run.dimension()).map(|b| cut[b]..cut[b] + 1).collect();
    for &a in axes {
        ranges[a] = 0..run.axis(a).cells;
    }
    Potential::new(run.case.as_ref().ok()?, &ranges).ok()
}

/// A sentence of a caption if `V` jumps at the ends of the periodic axis `a`, where the frame hides
/// the line.
pub fn note_on_ends(run: &StoredRun, a: usize, jumps: &[f64]) -> String {
    if jumps.contains(&run.axis(a).lower) {
        format!(" V also jumps at the ends of {}, which is periodic.", run.names()[a])
    } else {
        String::new()
    }
}

/// Borders in a plane of two space axes at which `V` jumps, as pieces of lines with NaN between.
pub fn borders(run: &StoredRun, plane: [usize; 2], cut: &[usize]) -> Vec<[f64; 2]> {
    /// The largest number of cells on which borders are searched. With more cells the search takes
    /// seconds.
    const MOST: usize = 1 << 22;
    // V jumps between elements, and jumps are stored at the first cell of each element.
    let lengths = plane.map(|a| run.axis(a).elements());
    let nodes = plane.map(|a| run.axis(a).nodes.count());
    if lengths[0] * lengths[1] > MOST {
        return Vec::new();
    }
    let Some(potential) = potential_along(run, &plane, cut) else { return Vec::new() };
    let mut points = Vec::new();
    let mut cell = cut[..run.dimension()].to_vec();
    for i in 0..lengths[0] {
        for j in 0..lengths[1] {
            (cell[plane[0]], cell[plane[1]]) = (i * nodes[0], j * nodes[1]);
            for c in (0..2).filter(|c| potential.jump_below(&cell, plane[*c]) != 0.0) {
                // Below the first cell there is a jump only on a periodic axis; it is drawn at both
                // ends.
                let below = [i, j][c];
                for face in [below].into_iter().chain((below == 0).then_some(lengths[c])) {
                    let end = |step: usize| {
                        let mut corner = [i, j];
                        corner[c] = face;
                        corner[1 - c] += step;
                        [0, 1].map(|c| run.axis(plane[c]).face(corner[c] as i64))
                    };
                    points.extend([end(0), end(1), [f64::NAN; 2]]);
                }
            }
        }
    }
    points
}
