//! The methods for a density at a point, and their numbers.

use crate::problem::case::ProfileChoice;
use crate::quantum::cost::Cost;
use crate::quantum::labelled_number::{LabelledNumber, Trust};
use crate::quantum::surface_code::PhysicalCost;
use crate::quantum::synthesis::RotationSynthesis;
use serde::Serialize;

/// The cost of a degree.
#[derive(Clone, Debug, Serialize)]
pub struct DegreeCost {
    /// The degree.
    pub degree: usize,
    /// The order that is counted on.
    pub order: Option<f64>,
    /// Elements along each axis of the grid that is needed.
    pub grid: Option<Vec<usize>>,
    /// Gates until the density is measured, or why there is no number.
    pub gates: LabelledNumber,
}

/// Names of methods on a quantum computer.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize)]
pub enum QuantumName {
    /// A scheme that dissipates, on a grid.
    #[serde(rename = "Schrödingerization, dissipative")]
    Dissipative,
    /// A unitary scheme, on a grid.
    #[serde(rename = "one mode, unitary")]
    Unitary,
    /// Traces over characteristics, without a grid.
    #[serde(rename = "reversible characteristics")]
    OverCharacteristics,
}

/// A method on a quantum computer.
#[derive(Clone, Debug, Serialize)]
pub struct QuantumMethod {
    /// Name of the method.
    pub name: QuantumName,
    /// The degree that takes the fewest gates; `None` without a grid.
    pub degree: Option<usize>,
    /// The cost of every degree.
    pub degrees: Vec<DegreeCost>,
    /// Elements along each axis, of the grids on which errors were measured and of the one needed;
    /// empty without a grid.
    pub grids: Vec<Vec<usize>>,
    /// Relative L1 errors of the density on the former.
    pub errors: Vec<f64>,
    /// The order that is counted on.
    pub order: Option<f64>,
    /// The orders from each grid to the next.
    pub orders: Vec<f64>,
    /// The order that the prediction uses, where it is none of the measured ones.
    pub order_remark: Option<String>,
    /// The profile; `None` where there is no `p`.
    pub profile: Option<ProfileChoice>,
    /// The recovery point `p◇`.
    pub recovery: LabelledNumber,
    /// The number `N_p` of points in `p`.
    pub points: LabelledNumber,
    /// Relative l2 error of `f` that profile and evolution may make.
    pub tolerance: LabelledNumber,
    /// Error of the state that the evolution may make.
    pub walk_tolerance: LabelledNumber,
    /// The probability with which the state holds the field.
    pub probability: LabelledNumber,
    /// Evolutions (over characteristics: traces) of all runs of amplitude estimation.
    pub evolutions: LabelledNumber,
    /// The largest number of segments of a trace, parts of its path on which `V` is linear; `None`
    /// for grid methods.
    #[serde(rename = "legs")]
    pub segments: Option<usize>,
    /// Cost of an evolution; `None` where it is unknown.
    pub cost: Option<Cost>,
    /// Toffoli gates alone of an evolution by `2K` steps, or of a trace.
    pub toffoli: LabelledNumber,
    /// Gates of all evolutions, in Toffoli gates, by the cheaper sequence.
    pub gates_until_measured: LabelledNumber,
    /// Physical qubits, distance and seconds, of a model of the surface code.
    #[serde(flatten)]
    pub physical: PhysicalCost,
}

impl QuantumMethod {
    /// A method without a grid and without numbers; `why` is the reason.
    pub(super) fn unavailable(name: QuantumName, why: &str) -> Self {
        let none = || LabelledNumber::unavailable(why);
        Self {
            name,
            degree: None,
            degrees: Vec::new(),
            grids: Vec::new(),
            errors: Vec::new(),
            order: None,
            orders: Vec::new(),
            order_remark: None,
            profile: None,
            recovery: none(),
            points: none(),
            tolerance: none(),
            walk_tolerance: none(),
            probability: none(),
            evolutions: none(),
            segments: None,
            cost: None,
            toffoli: none(),
            gates_until_measured: none(),
            physical: PhysicalCost::unavailable(why),
        }
    }
}

/// Names of classical methods.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize)]
pub enum ClassicalName {
    /// Time stepping by the exponential integrator.
    #[serde(rename = "time stepping, exponential")]
    Exponential,
    /// Explicit time stepping with limited slopes.
    #[serde(rename = "time stepping, van Leer")]
    VanLeer,
    /// Quadrature over characteristics.
    #[serde(rename = "quadrature over characteristics")]
    Quadrature,
    /// Monte Carlo over characteristics.
    #[serde(rename = "Monte Carlo over characteristics")]
    MonteCarlo,
}

impl ClassicalName {
    /// What the size of the method counts.
    pub(super) fn unit(self) -> &'static str {
        match self {
            Self::Exponential | Self::VanLeer => "cells",
            Self::Quadrature | Self::MonteCarlo => "traces",
        }
    }
}

/// A classical method.
#[derive(Clone, Debug, Serialize)]
pub struct ClassicalMethod {
    /// Name of the method.
    pub name: ClassicalName,
    /// The degree of the method's elements; `None` without a grid.
    pub degree: Option<usize>,
    /// Unknowns of the method's grid, or number of traces; `None` where it is not known.
    pub size: Option<f64>,
    /// Seconds on this machine.
    pub seconds: LabelledNumber,
}

impl ClassicalMethod {
    /// A method that cannot be compared, for this reason.
    pub(super) fn unavailable(name: ClassicalName, why: &str) -> Self {
        Self { name, degree: None, size: None, seconds: LabelledNumber::unavailable(why) }
    }

    /// The method's size with a label. The size of a grid is extrapolated. Traces are counted,
    /// unless their seconds are extrapolated.
    pub(super) fn labelled_size(&self) -> LabelledNumber {
        const WHY: &str = "by the measured order, or by 1/eps^2";
        let Some(size) = self.size else { return LabelledNumber::unavailable("not known") };
        if self.degree.is_some() || self.seconds.trust() == Trust::Model {
            LabelledNumber::model(size, WHY)
        } else {
            LabelledNumber::exact(size)
        }
    }
}

/// The task and all methods for it.
#[derive(Clone, Debug, Serialize)]
pub struct EndToEnd {
    /// Title of the case.
    pub title: String,
    /// The relative error `ε` of the density.
    pub accuracy: f64,
    /// The number of T gates that a rotation takes.
    pub t_of_rotation: RotationSynthesis,
    /// The point where the density is wanted.
    pub point: Vec<f64>,
    /// The density there, by quadrature over characteristics, or of the exact formula where `V`
    /// reflects in part.
    pub density: f64,
    /// The ratio of that density to the mean density. The error of a grid is that of the whole
    /// density.
    pub density_of_mean: f64,
    /// The methods on a quantum computer.
    pub quantum: Vec<QuantumMethod>,
    /// The classical methods.
    pub classical: Vec<ClassicalMethod>,
    /// Sentences on which of them needs least.
    pub verdict: Vec<String>,
}
