//! The transport and the forces of a case in whole numbers, and which modes and levels a circuit
//! takes.

use crate::base::error::{Error, Result};
use serde::Serialize;
use std::f64::consts::{PI, TAU};

/// The largest number of bits on which a table of coefficients may depend.
pub const MOST_TABLE_BITS: usize = 12;
/// Relative differences of coefficients below this are round-off: slopes are differences of `V`.
const ROUND_OFF: f64 = 1e-13;

/// A jump of `V`.
#[derive(Clone, Debug, PartialEq, Eq, Serialize)]
pub struct PotentialJump {
    /// The cell below the face; the last one for the face that closes a periodic axis.
    pub below: usize,
    /// The number of bins by which `V` rises from that cell to the next.
    pub levels: i64,
    /// The part of the face where the jump is: bits, and their values, of the cells along the other
    /// space axes, the last axis in the lowest bits. An empty list is the whole face.
    pub part: Vec<(usize, bool)>,
}

/// The transport along an axis, in whole numbers.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct AxisTransport {
    /// Number of cells in space.
    pub cells: usize,
    /// Whether the axis is periodic: the last cell is before the first.
    pub periodic: bool,
    /// Number of velocity cells of either sign, `j_max + 1`.
    pub speeds: usize,
    /// Jumps of `V`.
    pub jumps: Vec<PotentialJump>,
    /// `v₁/Δx = Δv/(2Δx)`; 0 without transport.
    pub rate: f64,
}

/// The force along an axis.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct Force {
    /// The axis.
    pub axis: usize,
    /// `d_max`.
    pub rate: f64,
    /// The bits of the space register on which the coefficient depends, of several axes the last
    /// one lowest.
    pub bits: Vec<usize>,
    /// `|d_i|/d_max` by the values of these bits.
    pub shares: Vec<f64>,
    /// The space cells where particles are pushed to lower velocities, as sets of bits of the space
    /// register and their values.
    pub down: Vec<Vec<(usize, bool)>>,
}

/// The transport of a case.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct CaseTransport {
    /// The transport along each axis.
    pub axes: Vec<AxisTransport>,
    /// Forces, at most one an axis.
    pub forces: Vec<Force>,
    /// `b`: each level is divided into `2^b` bins.
    pub bin_bits: usize,
}

/// The modes that the circuit acts on.
#[derive(Clone, Copy, Debug, PartialEq, Serialize)]
pub enum CircuitModes {
    /// All modes of a register of `p` with `qubits` qubits on the period `period`.
    Register {
        /// `n_p`.
        qubits: usize,
        /// `P`.
        period: f64,
    },
    /// All modes of such a register, each with a weight of its own by uniformly controlled
    /// rotations.
    Rotated {
        /// `n_p`.
        qubits: usize,
        /// `P`.
        period: f64,
        /// The highest wavenumber that carries something; modes beyond it get this wavenumber.
        highest: f64,
    },
    /// One mode, of this wavenumber.
    One(f64),
}

/// The register that numbers the levels of a cell.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Hash, Serialize, clap::ValueEnum)]
#[serde(rename_all = "lowercase")]
pub enum Levels {
    /// All values of its qubits: Hadamard gates.
    #[default]
    Hadamard,
    /// As many as the fastest cell has levels: rotations; α is least.
    Uniform,
}

impl Force {
    /// The force along `axis` in the case of this name; `None` where nothing is pushed. `speeds`
    /// are `d_i` by the number of a space cell, `None` for numbers that are no cells. `boxes`
    /// covers the numbers in its first argument by boxes, which may include any of those in its
    /// second.
    ///
    /// # Errors
    /// [`Error::Input`] where the coefficient depends on more than [`MOST_TABLE_BITS`] bits.
    pub(super) fn new(
        name: &str,
        axis: usize,
        speeds: &[Option<f64>],
        boxes: impl Fn(&[usize], &[usize]) -> Vec<Vec<(usize, bool)>>,
    ) -> Result<Option<Self>> {
        let bits = bits_of(speeds.len());
        let rate = speeds.iter().flatten().fold(0.0, |most: f64, d| most.max(d.abs()));
        if rate == 0.0 {
            return Ok(None);
        }
        let near_one = |share: f64| if 1.0 - share <= ROUND_OFF { 1.0 } else { share };
        let share = |d: Option<f64>| d.map(|d| near_one(d.abs() / rate));
        let mut shares: Vec<Option<f64>> = speeds.iter().map(|&d| share(d)).collect();
        let mut depends: Vec<usize> = (0..bits).collect();
        // From the highest bit down, so that those below keep their places.
        for bit in (0..bits).rev() {
            if let Some(without) = without_bit(&shares, bit) {
                shares = without;
                depends.remove(bit);
            }
        }
        if depends.len() > MOST_TABLE_BITS {
            return Err(Error::Input(format!(
                "{name}: dV/dx depends on {} bits of the numbers of cells along axis {}; the \
                 circuit loads it from a table of at most 2^{MOST_TABLE_BITS} numbers: fewer \
                 cells, or a V of few slopes",
                depends.len(),
                axis + 1
            )));
        }
        let of = |wanted: &dyn Fn(f64) -> bool| -> Vec<usize> {
            let places = speeds.iter().enumerate();
            places.filter(|(_, d)| wanted(d.unwrap_or(0.0))).map(|(place, _)| place).collect()
        };
        Ok(Some(Self {
            axis,
            rate,
            bits: depends,
            shares: shares.into_iter().map(|share| share.unwrap_or(1.0)).collect(),
            down: boxes(&of(&|d| d < 0.0), &of(&|d| d == 0.0)),
        }))
    }
}

/// The table without the bit `bit`; `None` if the table depends on it.
fn without_bit(shares: &[Option<f64>], bit: usize) -> Option<Vec<Option<f64>>> {
    let mask = 1 << bit;
    let places = (0..shares.len()).filter(|place| place & mask == 0);
    let merged = places.map(|place| match (shares[place], shares[place | mask]) {
        (Some(a), Some(b)) if (a - b).abs() > ROUND_OFF => None,
        (a, b) => Some(a.or(b)),
    });
    merged.collect()
}

impl CircuitModes {
    /// `Σ` of the weights of `−μD`, and of `T` and `T†`.
    pub(super) fn weights(self) -> [f64; 2] {
        match self {
            Self::Register { qubits, period } => {
                let largest = PI * (1u64 << qubits) as f64 / period;
                [largest, largest + 1.0]
            }
            Self::Rotated { highest: mu, .. } | Self::One(mu) => [mu.abs(), mu.hypot(1.0)],
        }
    }

    /// Number of qubits of the register of modes.
    pub fn qubits(self) -> usize {
        match self {
            Self::Register { qubits, .. } | Self::Rotated { qubits, .. } => qubits,
            Self::One(_) => 0,
        }
    }

    /// Whether the circuit has mode `l` of the register with its own wavenumber.
    pub fn carries(self, l: usize) -> bool {
        match self {
            Self::Rotated { qubits, period, highest } => {
                let mode = l as f64 - (1u64 << qubits) as f64 / 2.0;
                (TAU * mode / period).abs() <= highest * (1.0 + 1e-12)
            }
            Self::Register { .. } | Self::One(_) => true,
        }
    }

    /// The wavenumber of each mode, in the order of the register.
    pub fn wavenumbers(self) -> Vec<f64> {
        let (period, highest) = match self {
            Self::Register { period, .. } => (period, f64::INFINITY),
            Self::Rotated { period, highest, .. } => (period, highest),
            Self::One(mu) => return vec![mu],
        };
        let points = 1i64 << self.qubits();
        let of = |l: i64| (TAU * (l - points / 2) as f64 / period).clamp(-highest, highest);
        (0..points).map(of).collect()
    }
}

/// How the modes of a register have their wavenumbers.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, clap::ValueEnum)]
#[serde(rename_all = "lowercase")]
pub enum ModeWeights {
    /// As a sum of signs of the register's bits: one weight for all, Toffoli gates.
    #[default]
    Sum,
    /// Each mode its own, by as many rotations: α is least.
    Rotations,
}

impl ModeWeights {
    /// The modes of a register of `points` points on the period `period`, of which those up to the
    /// wavenumber `highest` carry something.
    pub fn of_register(self, points: usize, period: f64, highest: f64) -> CircuitModes {
        let qubits = bits_of(points);
        match self {
            Self::Sum => CircuitModes::Register { qubits, period },
            Self::Rotations => CircuitModes::Rotated { qubits, period, highest },
        }
    }
}

/// Number of bits that number `count` things.
pub fn bits_of(count: usize) -> usize {
    count.next_power_of_two().trailing_zeros() as usize
}
