//! The reflections of amplitude amplification, as gates.
//!
//! A round has two of them. One is about the wanted outcomes: zeros of the block's qubits, and a
//! point of `p` in a window. The other is about the start, between the inverse of what prepares it
//! and that itself: there it is about the zeros of all qubits. A further qubit lowers the amplitude
//! so that the last round reaches 1 exactly; it is among those zeros.

use crate::quantum::circuit::arithmetic::{Literal, ones};
use crate::quantum::circuit::gates::{Circuit, Gate, Qubit, RegisterRole};

/// Sizes of the registers of an amplified state, in qubits.
#[derive(Clone, Copy, Debug)]
pub struct AmplifiedRegisters {
    /// Qubits of the register of the points of `p`.
    pub warped: usize,
    /// Qubits of the registers of the other unknowns.
    pub system: usize,
    /// Qubits of the block encoding. The wanted outcomes have zeros there.
    pub block: usize,
}

impl AmplifiedRegisters {
    /// The two reflections of a round, without the preparation of the start. The wanted points of
    /// `p` are `first..end`. All gates are of Clifford + Toffoli.
    pub fn round(self, [first, end]: [usize; 2]) -> Circuit {
        let mut circuit = Circuit::default();
        let c = &mut circuit;
        let warped = c.register("warped", self.warped, RegisterRole::System);
        let system = c.register("system", self.system, RegisterRole::System);
        let block = c.register("block", self.block, RegisterRole::Block);
        let lowered = c.register("lowered", 1, RegisterRole::Block);
        let zeros: Vec<Literal> = block.iter().chain(&lowered).map(|&q| (q, false)).collect();
        let flags = c.take(2);
        let compare = |c: &mut Circuit| {
            for (&flag, limit) in flags.iter().zip([first, end]) {
                below(c, &warped, limit, flag);
            }
        };
        let inside = [(flags[0], false), (flags[1], true)];
        let wanted = if warped.is_empty() { zeros.clone() } else { [&inside, &zeros[..]].concat() };
        c.comment("about the wanted outcomes");
        if warped.is_empty() {
            change_sign(c, &wanted)
        } else {
            c.within(compare, |c| change_sign(c, &wanted))
        }
        c.give_back(&flags);
        c.comment("about the start");
        let others = warped.iter().chain(&system).map(|&q| (q, false));
        change_sign(c, &others.chain(zeros).collect::<Vec<_>>());
        circuit.finish();
        circuit
    }
}

/// Flips `flag` where `number < limit`; `limit` is at most `2^number.len()`.
fn below(c: &mut Circuit, number: &[Qubit], limit: usize, flag: Qubit) {
    let zero = c.take(1);
    let constant = c.take(number.len() + 1);
    let longer = [number, &zero].concat();
    let ones = ones(&constant, limit);
    c.within(|c| c.flip(&ones), |c| c.less(&longer, &constant, None, flag));
    c.give_back(&constant);
    c.give_back(&zero);
}

/// Changes the sign where all `literals` hold.
fn change_sign(c: &mut Circuit, literals: &[Literal]) {
    c.where_all(literals, |c, all| c.push(Gate::Z(all)));
}
