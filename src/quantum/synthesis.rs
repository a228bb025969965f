//! T gates of rotations: a model of their synthesis from Clifford and T gates.
//!
//! A rotation about z to accuracy `ε` in norm takes `3 log₂ 1/ε` T gates and a few more (Ross and
//! Selinger 2016, without ancillas); one about y takes the same between Clifford gates. All
//! rotations of an evolution have equal shares of [`ROTATIONS_PART`] of its tolerance.
//!
//! To compare gates of both kinds a Toffoli gate counts as [`T_OF_TOFFOLI_STATE`] T gates: as many
//! prepare its state, where a measurement undoes what is left (Jones 2013; Gidney 2018).

use crate::quantum::labelled_number::LabelledNumber;
use crate::quantum::walk::ROTATIONS_PART;
use serde::Serialize;
use std::fmt;

/// Number of T gates that count as a Toffoli gate.
pub const T_OF_TOFFOLI_STATE: f64 = 4.0;

/// T gates of a rotation to accuracy `ε`: `factor log₂ 1/ε + constant`.
#[derive(Clone, Copy, Debug, PartialEq, Serialize)]
pub struct RotationSynthesis {
    /// T gates for each bit of accuracy.
    pub factor: f64,
    /// T gates beside them.
    pub constant: f64,
}

/// The synthesis of Ross and Selinger, with a constant that their examples do not exceed.
impl Default for RotationSynthesis {
    fn default() -> Self {
        Self { factor: 3.0, constant: 4.0 }
    }
}

/// The synthesis as the option of `resources` is written.
impl fmt::Display for RotationSynthesis {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "{},{}", self.factor, self.constant)
    }
}

impl RotationSynthesis {
    /// T gates of each of `rotations` rotations, for an evolution that is exact to `tolerance`.
    pub fn t_of_each(self, rotations: f64, tolerance: f64) -> LabelledNumber {
        let Self { factor, constant } = self;
        let why = format!(
            "{factor} log2(1/e) + {constant} T gates of a rotation to e, all of them to \
             {ROTATIONS_PART} of the tolerance"
        );
        let bits = (rotations.max(1.0) / (ROTATIONS_PART * tolerance)).log2().max(0.0);
        LabelledNumber::model((factor * bits + constant).ceil(), &why)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// All rotations together are within their part of the tolerance, and with one T gate fewer
    /// each they are not.
    #[test]
    fn rotations_keep_their_part_of_the_tolerance() {
        let synthesis = RotationSynthesis::default();
        for (rotations, tolerance) in [(1.0, 0.1), (3e4, 1e-3), (1e9, 1e-10)] {
            let each = synthesis.t_of_each(rotations, tolerance).value().expect("a number");
            let off = |t: f64| rotations * ((synthesis.constant - t) / synthesis.factor).exp2();
            assert!(off(each) <= ROTATIONS_PART * tolerance, "{rotations} {tolerance}: {each}");
            assert!(
                off(each - 1.0) > ROTATIONS_PART * tolerance,
                "{rotations} {tolerance}: {each}"
            );
        }
    }
}
