//! The transport of a case in whole numbers, and which modes and levels a circuit takes.

use crate::quantum::circuit::force::Force;
use serde::Serialize;
use std::f64::consts::{PI, TAU};

/// A jump of `V`.
#[derive(Clone, Debug, PartialEq, Eq, Serialize)]
pub struct PotentialJump {
    /// The cell below the face; the last one for the face that closes a periodic axis.
    pub below: usize,
    /// The number of bins by which `V` rises from that cell to the next.
    pub levels: i64,
    /// Where on the face: bits, and their values, of the cells along the other space axes, the last
    /// axis in the lowest bits. Everywhere if there are none.
    pub part: Vec<(usize, bool)>,
}

/// The transport along an axis, in whole numbers.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct AxisTransport {
    /// Cells in space.
    pub cells: usize,
    /// Whether the last cell is before the first.
    pub periodic: bool,
    /// Velocity cells of either sign, `j_max + 1`.
    pub speeds: usize,
    /// Jumps of `V`.
    pub jumps: Vec<PotentialJump>,
    /// `v₁/Δx = Δv/(2Δx)`; 0 without transport.
    pub rate: f64,
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
    /// All of a register of `p` of so many qubits on this period.
    Register {
        /// `n_p`.
        qubits: usize,
        /// `P`.
        period: f64,
    },
    /// All of such a register, each with weights of its own, by uniformly controlled rotations.
    Rotated {
        /// `n_p`.
        qubits: usize,
        /// `P`.
        period: f64,
        /// The highest wavenumber that carries something; beyond it modes have this one.
        highest: f64,
    },
    /// One, of this wavenumber.
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

    /// Qubits of the register of modes.
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

/// Bits that number `count` things.
pub fn bits_of(count: usize) -> usize {
    count.next_power_of_two().trailing_zeros() as usize
}
