//! From a case to whole numbers of cells and levels, or the reason why there are none.

use crate::base::error::{Error, Result};
use crate::problem::case::{Case, Interface};
use crate::problem::grid::{Axis, describe_point};
use crate::problem::potential::Potential;
use crate::quantum::circuit::interface::{Jump, Transport};
use crate::scheme::interface::{Side, sources, velocity};
use std::collections::HashMap;

/// Most bits of the bins.
pub const MOST_BIN_BITS: usize = 20;
/// Distance from a whole number that is round-off, relative.
const WHOLE: f64 = 1e-12;

/// A case as the circuit has it.
#[derive(Clone, Debug)]
pub struct Scene {
    /// In whole numbers.
    pub transport: Transport,
    /// How far a jump was rounded at most, in levels; 0 if all are whole.
    pub rounded: f64,
    /// Bound of the norm of what that changes of `A`.
    pub change: f64,
}

/// A jump of `V` before it is rounded.
struct Height {
    below: usize,
    /// `ΔV`.
    rise: f64,
    /// `2ΔV/Δv²`.
    levels: f64,
}

/// Refuses what the circuit does not have, before it is assembled.
///
/// # Errors
/// [`Error::Input`] with the key, the value and what would do.
pub fn refuse(case: &Case) -> Result<()> {
    let wrong = |what: String| Err(Error::Input(format!("{}: {what}", case.name)));
    let space = &case.space;
    if space.dimension() != 1 {
        return wrong(format!("{} space axes; the circuit has 1", space.dimension()));
    }
    if space.degree() > 0 {
        let degree = space.degree();
        return wrong(format!("scheme.degree = {degree}; the circuit is of degree 0"));
    }
    if case.reflects() {
        let what = "potential.reflection: the circuit transmits or reflects all of a level";
        return wrong(what.to_owned());
    }
    if case.interface != Interface::Conservative {
        let what = "scheme.interface = \"hat\"; the circuit moves whole levels of energy, as \
                    scheme.interface = \"conservative\" does";
        return wrong(what.to_owned());
    }
    if case.embeds() {
        let what = "inflow.value: the auxiliary unknowns of what enters have no circuit; \
                    inflow.value = 0 has none of them";
        return wrong(what.to_owned());
    }
    let (x, v) = (&space.x[0], &space.v[0]);
    if v.cells % 2 == 1 || (v.lower + v.upper).abs() > WHOLE * v.width() {
        return wrong(format!(
            "axis.0.v has {} cells from {} to {}; the circuit has velocities ±(j + 1/2)Δv: \
             an even number of cells, from -{} to {}",
            v.cells, v.lower, v.upper, v.upper, v.upper
        ));
    }
    if space.is_single(0) {
        return wrong(
            "axis.0.x.cells = 1 on a periodic axis, along which nothing moves; \
                      2 or more have a circuit"
                .to_owned(),
        );
    }
    let potential = Potential::whole(case)?;
    let steep = (0..x.cells).find(|&i| potential.slope(&[i, 0, 0], 0) != 0.0);
    if let Some(i) = steep {
        return wrong(format!(
            "dV/dx = {:.6} at {}; the circuit has jumps of V and no forces: potential.value \
             constant in each region",
            potential.slope(&[i, 0, 0], 0),
            describe_point(1, &[x.centre(i as i64), 0.0, 0.0, v.centre(0), 0.0, 0.0])
        ));
    }
    Ok(())
}

impl Scene {
    /// The scene of a case that [`refuse`] lets pass; each level is divided into `2^bin_bits` bins,
    /// to which jumps are rounded, or into the fewest that make them whole.
    ///
    /// # Errors
    /// [`Error::Input`] where none do.
    pub fn new(case: &Case, bin_bits: Option<usize>) -> Result<Self> {
        let (x, v) = (&case.space.x[0], &case.space.v[0]);
        let heights = heights(case)?;
        let off = |height: &Height, bits: usize| {
            let levels = height.levels * (1u64 << bits) as f64;
            let off = (levels - levels.round()).abs();
            if off <= WHOLE * levels.abs().max(1.0) { 0.0 } else { off }
        };
        let fits = |&bits: &usize| heights.iter().all(|height| off(height, bits) == 0.0);
        let Some(bin_bits) = bin_bits.or_else(|| (0..=MOST_BIN_BITS).find(fits)) else {
            let odd = heights.iter().find(|height| off(height, MOST_BIN_BITS) > 0.0);
            let odd = odd.map_or((0.0, 0.0), |height| (height.rise, height.levels));
            return Err(Error::Input(format!(
                "{}: V jumps by {} = {:.6} levels of dv²/2 = {:.6e}, which is no multiple of \
                 2^-{MOST_BIN_BITS}; --sub-bins B rounds it to a multiple of 2^-B of a level, \
                 another axis.0.v.cells may make it whole",
                case.name,
                odd.0,
                odd.1,
                0.5 * v.width() * v.width()
            )));
        };
        let scale = (1u64 << bin_bits) as f64;
        let speeds = v.cells / 2;
        // Beyond all energies of the box one wall is as high as another.
        let highest = (speeds * speeds) as f64 * scale;
        let whole = |height: &Height| (height.levels * scale).round().clamp(-highest, highest);
        let jumps = heights
            .iter()
            .map(|height| Jump { below: height.below, levels: whole(height) as i64 })
            .filter(|jump| jump.levels != 0);
        let rounded = heights.iter().map(|height| off(height, bin_bits) / scale);
        let change = heights.iter().filter(|height| off(height, bin_bits) > 0.0).map(|height| {
            let level = 0.5 * v.width() * v.width();
            change(v, height.rise, whole(height) / scale * level) / x.width()
        });
        Ok(Self {
            rounded: rounded.fold(0.0, f64::max),
            change: change.fold(0.0, f64::max),
            transport: Transport {
                cells: x.cells,
                periodic: case.space.is_periodic(0),
                speeds,
                bin_bits,
                jumps: jumps.collect(),
                rate: 0.5 * v.width() / x.width(),
            },
        })
    }
}

/// The jumps of `V`.
fn heights(case: &Case) -> Result<Vec<Height>> {
    let potential = Potential::whole(case)?;
    let width = case.space.v[0].width();
    let height = |below: usize| {
        let rise = potential.jump_above(&[below, 0, 0], 0);
        Height { below, rise, levels: 2.0 * rise / (width * width) }
    };
    let cells = 0..case.space.x[0].cells;
    Ok(cells.map(height).filter(|height| height.rise != 0.0).collect())
}

/// Bound of the norm of what another height of a jump changes of `|v| weight`, the rates of the
/// scheme: the root of the largest sums of a row and of a column.
fn change(axis: &Axis, rise: f64, rounded: f64) -> f64 {
    let mut rates: HashMap<(bool, i64, bool, i64), f64> = HashMap::new();
    let mut found = Vec::new();
    for j in 0..axis.cells as i64 {
        let v = velocity(axis, j);
        // Moving right it has left the face to the upper side.
        let upper = v > 0.0;
        for (height, sign) in [(rise, 1.0), (rounded, -1.0)] {
            let height = if upper { height } else { -height };
            sources(&mut found, axis, Interface::Conservative, j, height);
            for source in found.iter().filter(|s| (0..axis.cells as i64).contains(&s.velocity)) {
                let from = upper == (source.side == Side::Same);
                let rate = rates.entry((upper, j, from, source.velocity)).or_insert(0.0);
                *rate += sign * v.abs() * source.weight;
            }
        }
    }
    let (mut rows, mut columns) = (HashMap::new(), HashMap::new());
    for ((upper, j, from, k), rate) in rates {
        *rows.entry((upper, j)).or_insert(0.0) += rate.abs();
        *columns.entry((from, k)).or_insert(0.0) += rate.abs();
    }
    let largest = |sums: HashMap<(bool, i64), f64>| sums.into_values().fold(0.0, f64::max);
    (largest(rows) * largest(columns)).sqrt()
}
