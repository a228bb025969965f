//! `g = 1` for `S = 0`: one mode of wavenumber 0.
//!
//! With `A = K` skew, `w_t = K w` for every `p`: the Schrödinger system is the equation itself, and
//! its one mode, read at `p◇ = 0`, is the solution.

use crate::schrodingerization::profile::series::Series;
use crate::schrodingerization::profile::shape::{EstimatorQuality, Planned, ProfileForm};
use num_complex::Complex64;
use serde::Serialize;
use std::f64::consts::TAU;

/// The profile with its one mode.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct Constant {
    /// The series of one mode.
    #[serde(skip)]
    pub series: Series,
}

impl Default for Constant {
    /// The profile with the period `2π`. Any other period gives the same.
    fn default() -> Self {
        Self {
            series: Series {
                period: TAU,
                coefficients: vec![Complex64::ONE],
                last_is_unpaired: false,
            },
        }
    }
}

impl Planned for Constant {
    fn form(&self) -> ProfileForm<'_> {
        ProfileForm::Series(&self.series)
    }

    fn description(&self) -> String {
        "constant, as S = 0: the flow is unitary by itself, and its one mode is the solution"
            .to_owned()
    }

    fn estimate_doubt(&self, _modes: usize, _quality: EstimatorQuality) -> Option<&'static str> {
        None
    }
}
