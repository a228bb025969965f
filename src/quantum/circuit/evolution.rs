//! `e^{−iHT}` by calls of a controlled block encoding, with the [`Phases`] of its sequence.
//!
//! A step is the controlled circuit `G`, a reflection about the zeros of the block's qubits, a
//! phase `±i` and one `ry` of the controlling qubit. With the projection `Π` on these zeros,
//! `(1 − 2Π)G` has the eigenvalues `z = −e^{±iφ}` of `H/α = cos φ`, and `y = iz`. The first half of
//! the steps has `y` where the controlling qubit is 0, the second half `1/y` where it is 1:
//! together the series `y^{−K}P(y)`.

use crate::quantum::circuit::arithmetic::Literal;
use crate::quantum::circuit::gates::{Circuit, Gate, Qubit, RegisterRole};
use crate::quantum::circuit::transport::{CaseTransport, CircuitModes, Levels};
use crate::quantum::circuit::wires::Wires;
use crate::quantum::phases::Phases;

/// The walk on the registers of a circuit.
pub struct Walk {
    /// The controlled block encoding.
    pub(super) call: Vec<Gate>,
    block: Vec<Qubit>,
    /// The qubit of the sequence, which controls the block encoding.
    pub control: Qubit,
}

impl Walk {
    /// The walk on the registers `wires` of `c`, which have a control. `c` has no gates yet. It has
    /// none afterwards, but the scratch qubits that the walk needs.
    pub(in crate::quantum) fn new(
        c: &mut Circuit,
        wires: &Wires,
        transport: &CaseTransport,
        modes: CircuitModes,
        levels: Levels,
    ) -> Self {
        debug_assert!(c.gates.is_empty() && wires.control.is_some());
        transport.call(c, wires, modes, levels);
        let call = std::mem::take(&mut c.gates);
        c.comments.clear();
        let block = c.qubits_of(RegisterRole::Block);
        let walk = Self { call, block, control: wires.control.unwrap_or_default() };
        walk.reflect(c);
        c.gates.clear();
        walk
    }

    /// Changes the sign where the control is 1 and all qubits of the block are 0.
    pub(super) fn reflect(&self, c: &mut Circuit) {
        let Some((&last, zeros)) = self.block.split_last() else { return };
        let zeros = zeros.iter().map(|&q| (q, false));
        let literals: Vec<Literal> = std::iter::once((self.control, true)).chain(zeros).collect();
        c.push(Gate::X(last));
        c.where_all(&literals, |c, all| c.push(Gate::Cz(all, last)));
        c.push(Gate::X(last));
    }

    /// Appends the steps of the walk with the rotations `phases`.
    pub fn evolve(&self, c: &mut Circuit, phases: &Phases) {
        for (step, &angle) in phases.angles.iter().enumerate() {
            if step > phases.degree {
                self.reflect(c);
                c.gates.extend(&self.call);
                c.push(Gate::Sdg(self.control));
            } else if step > 0 {
                c.push(Gate::X(self.control));
                c.gates.extend(&self.call);
                self.reflect(c);
                c.push(Gate::S(self.control));
                c.push(Gate::X(self.control));
            }
            c.push(Gate::Ry(angle, self.control));
        }
    }
}
