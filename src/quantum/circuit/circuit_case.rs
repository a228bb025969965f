//! A case as its circuit has it ([`CircuitCase`]): whole numbers of cells and levels, or the reason
//! why there are none.

use crate::base::error::{Error, Result};
use crate::base::text::choice_text;
use crate::matrix::bounds::Bounds;
use crate::problem::case::{Case, Interface};
use crate::problem::grid::{Axis, Cell, MAX_DIMENSION, PhaseSpace, axis_names, for_each_cell};
use crate::problem::potential::Potential;
use crate::quantum::circuit::transport::{
    AxisTransport, CaseTransport, Force, PotentialJump, bits_of,
};
use crate::scheme::interface::{SourceSide, sources, velocity};
use std::collections::{BTreeMap, HashMap};

/// The largest number of bits that number the bins of a level.
pub const MOST_BIN_BITS: usize = 20;
/// The largest number of bits of bins that is chosen by the change of the jumps. Beyond it a jump
/// has no further digits.
pub const MOST_ROUNDED_BITS: usize = 32;
/// Relative distance from a whole number that counts as round-off.
const WHOLE: f64 = 1e-12;

/// A case as the circuit has it.
#[derive(Clone, Debug)]
pub struct CircuitCase {
    /// The transport of the case, in whole numbers.
    pub transport: CaseTransport,
    /// The largest change of a jump by rounding, in levels; 0 if all jumps are whole.
    pub rounded: f64,
    /// Bound on the norm of the change of `A` by that rounding.
    pub change: f64,
}

/// The number of bins into which each level is divided, `2^b`.
#[derive(Clone, Copy, Debug)]
pub enum Bins {
    /// The fewest bins that make all jumps whole.
    Whole,
    /// A given number of bits `b`. Jumps are rounded to these bins.
    Given(usize),
    /// The fewest bins that change `A` by at most this in norm.
    Within(f64),
}

/// A height of jumps of `V`.
#[derive(Clone, Copy)]
struct JumpHeight {
    /// `ΔV`.
    rise: f64,
    /// `2ΔV/Δv²`.
    levels: f64,
}

impl JumpHeight {
    /// The distance of the height from a whole number of bins, in bins; 0 if it is round-off.
    fn off(self, bin_bits: usize) -> f64 {
        let levels = self.levels * (1u64 << bin_bits) as f64;
        let off = (levels - levels.round()).abs();
        if off <= WHOLE * levels.abs().max(1.0) { 0.0 } else { off }
    }
}

/// Jumps of one height at faces of one number along an axis.
struct JumpFaces {
    below: usize,
    height: JumpHeight,
    /// The places along the other axes that have this jump, as numbers of the bits of their cells.
    places: Vec<usize>,
}

/// Refuses cases that the circuit does not support, before it is assembled.
///
/// # Errors
/// [`Error::Input`] with the key, the value and what would do; as [`Bounds::new`] and `Force::new`.
pub fn refuse(case: &Case) -> Result<()> {
    let unknown = match unknown_choice(case) {
        None if case.scheme.flux < 1.0 && !has_skew_flow(case)? => Some(format!(
            "scheme.flux = {}; the circuit has 1, upwind, and 0 where the flow is unitary, as with \
             scheme.ends = \"closed\"",
            case.scheme.flux
        )),
        unknown => unknown.or_else(|| unknown_grid(&case.space)),
    };
    match unknown {
        Some(what) => Err(Error::Input(format!("{}: {what}", case.name))),
        None => forces(case, &Potential::whole(case)?).map(drop),
    }
}

/// Whether the flow of a case with the central flux is unitary: its ends are closed, or nothing
/// leaves through open ones (a ring without a force).
///
/// # Errors
/// As [`Bounds::new`].
fn has_skew_flow(case: &Case) -> Result<bool> {
    Ok(case.scheme.flux == 0.0 && (case.is_closed() || Bounds::new(case)?.is_skew()))
}

/// The first choice of the case, other than the flux, that the circuit does not have, and what
/// would do instead.
fn unknown_choice(case: &Case) -> Option<String> {
    let degree = case.space.degree();
    if degree > 0 {
        let keys = case.degree_keys(degree);
        return Some(format!("{keys} = {degree}; the circuit is of degree 0"));
    }
    if case.reflects() {
        let what = "potential.reflection: the circuit transmits or reflects all of a level";
        return Some(what.to_owned());
    }
    if case.scheme.interface != Interface::Conservative {
        return Some(format!(
            "scheme.interface = \"{}\"; the circuit moves whole levels of energy, as \
             scheme.interface = \"conservative\" does, which `export-circuit` takes where the case \
             names no interface",
            choice_text(&case.scheme.interface)
        ));
    }
    case.embeds().then(|| {
        format!(
            "{}: the auxiliary unknowns of what enters have no circuit; inflow.value = 0 has none \
             of them",
            case.inflow_key()
        )
    })
}

/// The properties of a grid that the circuit does not support, and what is supported.
fn unknown_grid(space: &PhaseSpace) -> Option<String> {
    let n = space.dimension();
    for (v, name) in space.v.iter().zip(&axis_names(n)[n..]) {
        if v.cells % 2 == 1 || (v.lower + v.upper).abs() > WHOLE * v.width() {
            return Some(format!(
                "{name} has {} cells from {} to {}; the circuit has velocities ±(j + 1/2)Δv: an \
                 even number of cells from -{} to {}",
                v.cells, v.lower, v.upper, v.upper, v.upper
            ));
        }
    }
    (0..n).all(|a| space.is_single(a)).then(|| {
        "axis.0.x.cells = 1 on a periodic axis, along which nothing moves; 2 or more have a circuit"
            .to_owned()
    })
}

impl CircuitCase {
    /// A case that [`refuse`] does not refuse, with these bins.
    ///
    /// # Errors
    /// [`Error::Input`] where no bins make all jumps whole, and as `Force::new`.
    pub fn new(case: &Case, bins: Bins) -> Result<Self> {
        let potential = Potential::whole(case)?;
        let n = case.space.dimension();
        let faces: Vec<Vec<JumpFaces>> =
            (0..n).map(|a| faces(&case.space, &potential, a)).collect();
        let fits = |&bits: &usize| faces.iter().flatten().all(|f| f.height.off(bits) == 0.0);
        let forces = forces(case, &potential)?;
        let of = |bin_bits: usize| {
            let transport = CaseTransport { axes: Vec::new(), forces: forces.clone(), bin_bits };
            let mut found = Self { rounded: 0.0, change: 0.0, transport };
            for (a, faces) in faces.iter().enumerate() {
                found.add_axis(case, a, faces);
            }
            found
        };
        let found = match bins {
            Bins::Given(bits) => Some(of(bits)),
            Bins::Whole => (0..=MOST_BIN_BITS).find(fits).map(of),
            Bins::Within(change) => {
                (0..=MOST_ROUNDED_BITS).map(of).find(|found| found.change <= change)
            }
        };
        found.ok_or_else(|| {
            let odd = faces.iter().flatten().find(|f| f.height.off(MOST_BIN_BITS) > 0.0);
            let odd = odd.map_or(JumpHeight { rise: 0.0, levels: 0.0 }, |face| face.height);
            let why = match bins {
                Bins::Within(change) => format!(
                    "no rounding to 2^-{MOST_ROUNDED_BITS} of a level or more changes A by \
                     {change:.1e} or less, which the tolerance of the field allows"
                ),
                Bins::Whole | Bins::Given(_) => format!(
                    "which is no multiple of 2^-{MOST_BIN_BITS}; `export-circuit --sub-bins B` \
                     rounds it to a multiple of 2^-B of a level, a complete circuit does not"
                ),
            };
            Error::Input(format!(
                "{}: V jumps by {} = {:.6} levels of dv²/2, {why}; another number of velocity \
                 cells may make it whole",
                case.name, odd.rise, odd.levels
            ))
        })
    }

    fn add_axis(&mut self, case: &Case, a: usize, faces: &[JumpFaces]) {
        let (space, bin_bits) = (&case.space, self.transport.bin_bits);
        let (x, v) = (&space.x[a], &space.v[a]);
        let scale = (1u64 << bin_bits) as f64;
        let speeds = v.cells / 2;
        // Walls above all energies of the box are equivalent.
        let highest = (speeds * speeds) as f64 * scale;
        let others = bits_of_others(space, a);
        let (mut jumps, mut change) = (Vec::new(), 0.0f64);
        for face in faces {
            let levels = (face.height.levels * scale).round().clamp(-highest, highest);
            let off = face.height.off(bin_bits);
            if off > 0.0 {
                self.rounded = self.rounded.max(off / scale);
                let level = 0.5 * v.width() * v.width();
                let to = levels / scale * level;
                change = change.max(change_of(v, face.height.rise, to) / x.width());
            }
            if levels != 0.0 {
                let parts = boxes(&face.places, &others.padding, others.bits);
                let jump = |part| PotentialJump { below: face.below, levels: levels as i64, part };
                jumps.extend(parts.into_iter().map(jump));
            }
        }
        // The parts of A by axis add up.
        self.change += change;
        let rate =
            if space.is_single(a) && jumps.is_empty() { 0.0 } else { 0.5 * v.width() / x.width() };
        let periodic = space.is_periodic(a);
        self.transport.axes.push(AxisTransport { cells: x.cells, periodic, speeds, jumps, rate });
    }
}

fn forces(case: &Case, potential: &Potential) -> Result<Vec<Force>> {
    let (space, n) = (&case.space, case.space.dimension());
    // Of all axes.
    let places = bits_of_others(space, n);
    let mut found = Vec::new();
    for axis in 0..n {
        let mut speeds = vec![None; 1 << places.bits];
        for_each_cell(&space.space_ranges(), |i| {
            let speed = -potential.slopes(i)[axis] / space.v[axis].width();
            speeds[number_of_others(&case.space, n, i)] = Some(speed);
        });
        let boxes = |wanted: &[usize], free: &[usize]| boxes(wanted, free, places.bits);
        found.extend(Force::new(&case.name, axis, &speeds, boxes)?);
    }
    Ok(found)
}

/// The numbers of the bits of the space axes but one.
struct OtherAxes {
    bits: usize,
    /// Numbers of the bits that are not cells.
    padding: Vec<usize>,
}

/// The number of `cell` in the bits of the space axes but `a`, if there is an axis `a`; the last
/// axis lowest.
fn number_of_others(space: &PhaseSpace, a: usize, cell: &[usize]) -> usize {
    let others = space.x.iter().zip(cell).enumerate().filter(|(b, _)| *b != a);
    others.fold(0, |number, (_, (x, i))| number << bits_of(x.cells) | i)
}

fn bits_of_others(space: &PhaseSpace, a: usize) -> OtherAxes {
    let axes = space.x.iter().enumerate().filter(|(b, _)| *b != a);
    let bits: usize = axes.map(|(_, x)| bits_of(x.cells)).sum();
    let mut cells = vec![false; 1 << bits];
    for_each_cell(&space.space_ranges(), |i| cells[number_of_others(space, a, i)] = true);
    OtherAxes { bits, padding: (0..1 << bits).filter(|&number| !cells[number]).collect() }
}

/// The jumps of `V` along axis `a`, by face and height.
fn faces(space: &PhaseSpace, potential: &Potential, a: usize) -> Vec<JumpFaces> {
    let width = space.v[a].width();
    let mut found: BTreeMap<(usize, u64), JumpFaces> = BTreeMap::new();
    for_each_cell(&space.space_ranges(), |i| {
        let mut cell: Cell = [0; 2 * MAX_DIMENSION];
        cell[..MAX_DIMENSION].copy_from_slice(i);
        let rise = potential.jump_above(&cell, a);
        if rise != 0.0 {
            let height = JumpHeight { rise, levels: 2.0 * rise / (width * width) };
            let face = found.entry((i[a], rise.to_bits()));
            let face = face.or_insert(JumpFaces { below: i[a], height, places: Vec::new() });
            face.places.push(number_of_others(space, a, i));
        }
    });
    found.into_values().collect()
}

/// Boxes of bits that hold all `places`, each once, and nothing else but `padding`: bits and their
/// values. Boxes that differ in one bit only are merged, bit by bit.
fn boxes(places: &[usize], padding: &[usize], bits: usize) -> Vec<Vec<(usize, bool)>> {
    // By the bits that are free and the values of the others: whether a place is among them.
    let start =
        places.iter().map(|&p| ((0, p), true)).chain(padding.iter().map(|&p| ((0, p), false)));
    let mut boxes: BTreeMap<(usize, usize), bool> = start.collect();
    for bit in (0..bits).map(|bit| 1 << bit) {
        let mut merged = BTreeMap::new();
        while let Some(((free, value), real)) = boxes.pop_first() {
            match boxes.remove(&(free, value ^ bit)) {
                Some(other) => merged.insert((free | bit, value & !bit), real | other),
                None => merged.insert((free, value), real),
            };
        }
        boxes = merged;
    }
    let fixed = |free: usize, value: usize| {
        (0..bits)
            .filter(move |bit| free >> bit & 1 == 0)
            .map(move |bit| (bit, value >> bit & 1 == 1))
    };
    let real = boxes.into_iter().filter(|found| found.1);
    real.map(|((free, value), _)| fixed(free, value).collect()).collect()
}

/// Bound on the norm of the change of the scheme's rates `|v| weight` when a jump has the height
/// `rounded` instead of `rise`: the root of the largest sums of a row and of a column.
fn change_of(axis: &Axis, rise: f64, rounded: f64) -> f64 {
    let mut rates: HashMap<(bool, i64, bool, i64), f64> = HashMap::new();
    let mut found = Vec::new();
    for j in 0..axis.cells as i64 {
        let v = velocity(axis, j);
        // A particle that moves right has left the face to the upper side.
        let upper = v > 0.0;
        for (height, sign) in [(rise, 1.0), (rounded, -1.0)] {
            let height = if upper { height } else { -height };
            sources(&mut found, axis, Interface::Conservative, j, height);
            for source in found.iter().filter(|s| (0..axis.cells as i64).contains(&s.velocity)) {
                let from = upper == (source.side == SourceSide::Same);
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
