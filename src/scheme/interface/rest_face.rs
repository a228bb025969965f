//! Whether `v = 0` is a face of the velocity elements, as the coupling of traces at jumps of `V`
//! demands: an element around it would have traces in both directions.

use crate::base::error::{Error, Result};
use crate::base::text::{coordinate_text, short};
use crate::problem::case::Case;
use crate::problem::exact::MOST_EXAMINED;
use crate::problem::grid::Axis;
use crate::problem::potential::Potential;

/// Distance of `v = 0` from a face, in elements, that is round-off.
const ON_FACE: f64 = 1e-9;
/// Largest multiple of the given number of elements that is suggested.
const MOST_MORE: usize = 2;

/// Follows the name of a degree above 0 where [`allows_elements`] does not hold.
pub const WITH_REST_ON_A_FACE: &str = " on velocity cells with a face at v = 0";

/// Whether an element of `axis` is around `v = 0`: it would have traces in both directions.
fn splits_rest(axis: &Axis) -> bool {
    let whole = axis.whole();
    let at = whole.position(0.0);
    at > 0.0 && at < whole.elements() as f64 && (at - at.round()).abs() > ON_FACE
}

/// Whether `case` may have elements on its velocity cells: `v = 0` is a face of them along each
/// axis where `V` jumps. Where there are too many cells of space to look for jumps, along each
/// axis.
pub fn allows_elements(case: &Case) -> bool {
    let splits = |a: &usize| splits_rest(&case.space.v[*a]);
    let mut split = (0..case.space.dimension()).filter(splits).peekable();
    if split.peek().is_none() {
        return true;
    }
    if case.space.space_cells() > MOST_EXAMINED {
        return false;
    }
    // Values of `V` that are not finite are an error elsewhere.
    Potential::whole(case).map_or(true, |potential| {
        let jumps = potential.largest_jumps(&case.space);
        split.all(|a| jumps[a].is_none())
    })
}

/// The next larger number of elements on the box of `axis` with a face at `v = 0`; `None` if it is
/// larger by more than a factor [`MOST_MORE`].
fn more_cells_with_a_face_at_rest(axis: &Axis) -> Option<usize> {
    let rest = -axis.lower / (axis.upper - axis.lower);
    let is_face = |count: &usize| {
        let at = rest * *count as f64;
        (at - at.round()).abs() <= ON_FACE
    };
    (axis.elements() + 1..=MOST_MORE * axis.elements()).find(is_face)
}

/// Refuses velocity axes with an element around `v = 0`, which would have traces in both
/// directions. `V` jumps by at most `height` along the axis, at `place`.
///
/// # Errors
/// [`Error::Input`], naming the jump, the nearest box with a face at 0, and the number of cells
/// that have one there.
pub fn check_axis(axis: &Axis, name: &str, height: f64, place: &str) -> Result<()> {
    /// About the last digit of values of `V` that were written with ten.
    const FEW_DIGITS: f64 = 1e-9;
    let whole = axis.whole();
    let (at, elements) = (whole.position(0.0), whole.elements() as f64);
    if !splits_rest(axis) {
        return Ok(());
    }
    let below = at.round().clamp(1.0, (elements - 1.0).max(1.0));
    let hint = if elements < 2.0 {
        String::new()
    } else {
        // A width of few digits, so that the ends have few, too.
        let width = short(whole.width()).parse().unwrap_or(whole.width());
        let end = |faces: f64| coordinate_text(faces * width, 1e-6 * width);
        format!("The box [{}, {}] has it on a face. ", end(-below), end(elements - below))
    };
    let more = more_cells_with_a_face_at_rest(&whole);
    let more =
        more.map_or(String::new(), |more| format!("{more} cells on the same box have it there. "));
    let fastest = whole.largest_magnitude();
    let doubt = if height < FEW_DIGITS * 0.5 * fastest * fastest {
        ". If V should not jump there, give it the same digits on both sides"
    } else {
        ""
    };
    Err(Error::Input(format!(
        "{name}: v = 0 must be a face of the cells, as V jumps by {} at {place} and faces are \
         matched by energy. With {elements} cells on [{}, {}] it is inside of a cell. \
         {hint}{more}An even number of cells on a box that is symmetric about 0 has it on a face, \
         too{doubt}",
        short(height),
        whole.lower,
        whole.upper
    )))
}
