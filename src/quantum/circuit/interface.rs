//! The block encoding of `H`, with the conservative interface at jumps of `V`.
//!
//! **Levels.** The velocities are `±(j + ½)Δv`. In units of `Δv²/2` cell `j` of either sign holds
//! the kinetic energies `[j², (j+1)²)`: the levels `e = j² + m`, `0 ≤ m < 2j + 1`, or `2^b` times
//! as many with `b` bits of bins. At a face where `V` jumps by a whole number of levels, particles
//! move from level to level, one to one:
//!
//! ```text
//! U: (x, s, e) → (x + s, s, e − ΔV)     where e ≥ ΔV, else (x, −s, e)
//! ```
//!
//! The overlap of energy intervals is a number of levels, so that with `v₁ = Δv/2`
//!
//! ```text
//! A = −(v₁/Δx)(diag(2j + 1) − 2^{−b} P U P†),     P: level → cell.
//! ```
//!
//! **Block.** A register `m` in a uniform superposition of `M ≥ 2j_max + 1` values, and the bins in
//! one of all their values, make `P†/√(2^b M)` of a cell: `(j, m) → e` is the inverse of the square
//! root with remainder ([`Circuit::square_root`]), and what is no level, `m > 2j`, has the highest
//! bit set and is flagged. `U` is between; without it the block is the diagonal. Time reversal,
//! `s → −s`, turns `U` into its inverse, so that one `U` serves `T = P U P†/(2^b M)` and `T†`:
//!
//! ```text
//! H = (v₁M/Δx)(−D_μ D + ½(D_μ + i)T + ½(D_μ − i)T†),     D = diag(2j + 1)/M
//! ```
//!
//! `−D_μ/μ_max = 2^{−n_p}(1 + Σ_b 2^b Z_b)` for `μ_l = 2π(l − N_p/2)/P` and `μ_max = πN_p/P`: a
//! uniform register of `n_p` qubits has its first 1 at bit `b` with just that weight.
//!
//! **More dimensions.** `H` is the sum of such terms, one an axis, with the same `−D_μ` and phases.
//! A register chooses the axis with the weight `v₁/Δx`; all take the same uniform levels, those of
//! the axis with the most. A jump may hold on a part of a face only: on boxes of the other axes'
//! bits.
//!
//! **Forces** are terms of the same kind, with weights of their own ([`force`]).
//!
//! [`force`]: crate::quantum::circuit::force
//!
//! The circuit is its own inverse on the states that it starts from.

use crate::quantum::circuit::arithmetic::{Literal, equals, ones};
use crate::quantum::circuit::gates::{Circuit, Gate, Qubit};
use crate::quantum::circuit::transport::{
    AxisTransport, CaseTransport, CircuitModes, Levels, bits_of,
};
use crate::quantum::circuit::wires::{AxisRegisters, Wires};

impl CaseTransport {
    /// The largest number of velocity cells of either sign, over the axes.
    fn speeds(&self) -> usize {
        self.axes.iter().map(|axis| axis.speeds).max().unwrap_or(1)
    }

    /// `M`.
    fn level_values(&self, levels: Levels) -> usize {
        match levels {
            Levels::Hadamard => 2 << bits_of(self.speeds()),
            Levels::Uniform => 2 * self.speeds() - 1,
        }
    }

    /// `α`: the block of the circuit is `H/α`.
    pub fn alpha(&self, modes: CircuitModes, levels: Levels) -> f64 {
        let [diagonal, moved] = modes.weights();
        self.rates(levels).iter().sum::<f64>() * (diagonal + moved)
    }

    /// Weights of the terms: `v₁M/Δx` of the axes, `d_max` of the forces.
    fn rates(&self, levels: Levels) -> Vec<f64> {
        let values = self.level_values(levels) as f64;
        let axes = self.axes.iter().map(|axis| axis.rate * values);
        axes.chain(self.forces.iter().map(|force| force.rate)).collect()
    }

    /// The number of the state `(x1..xn, v1..vn)`, without the modes; velocities are centred in
    /// their registers.
    pub fn state(&self, cell: &[usize]) -> usize {
        let (x, v) = cell.split_at(self.axes.len());
        let space =
            self.axes.iter().zip(x).fold(0, |state, (axis, x)| state << bits_of(axis.cells) | x);
        self.axes.iter().zip(v).fold(space, |state, (axis, v)| {
            let half = 1 << bits_of(axis.speeds);
            state * 2 * half + v + half - axis.speeds
        })
    }

    /// The circuit whose block is `H/α`. If `controlled`, a further qubit of the system, above the
    /// others, controls whether it is applied.
    pub fn encode(&self, modes: CircuitModes, levels: Levels, controlled: bool) -> Circuit {
        let mut circuit = Circuit::default();
        let wires = Wires::new(&mut circuit, self, modes, controlled);
        self.call(&mut circuit, &wires, modes, levels);
        circuit.finish();
        circuit
    }

    /// Appends the gates of the block encoding to `c`, which has the registers `wires` already.
    pub(in crate::quantum) fn call(
        &self,
        c: &mut Circuit,
        wires: &Wires,
        modes: CircuitModes,
        levels: Levels,
    ) {
        c.comment("prepare the weights of the sum, and uniform levels");
        let first = c.gates.len();
        wires.prepare(c, modes, self.level_values(levels));
        wires.terms.choose(c, &self.rates(levels));
        let prepared = c.gates[first..].to_vec();
        wires.phases(c, modes);
        wires.where_moving(c, |c, moving| {
            for (axis, along) in self.axes.iter().zip(&wires.along) {
                if axis.rate != 0.0 {
                    axis.apply(c, wires, along, moving);
                }
            }
            for (term, force) in (self.axes.len()..).zip(&self.forces) {
                let chosen = wires.terms.chosen(term);
                force.apply(c, wires, &wires.along[force.axis], &chosen, moving);
            }
        });
        c.flip_where(&wires.given(&[]), wires.reversed);
        c.comment("undo the preparation");
        c.gates.extend(prepared.iter().rev().map(|gate| gate.inverse()));
    }
}

impl AxisTransport {
    /// Appends the term of this axis, where it is chosen: `T` or `T†` where `moving` holds, else
    /// `D`.
    fn apply(&self, c: &mut Circuit, wires: &Wires, along: &AxisRegisters, moving: Literal) {
        c.comment("speed and level to energy");
        let (sign, low) = (along.sign(), along.speed());
        c.flip_if(sign, low);
        c.inverse_of(|c| c.square_root(&along.energy));
        // A level has the highest bit 0, and those of the register that this axis does not need.
        let chosen = wires.given(&along.chosen);
        let zeros = along.energy.last().into_iter().chain(&along.spare).map(|&q| (q, false));
        let is_level: Vec<Literal> = chosen.iter().copied().chain(zeros).collect();
        c.flip_where(&chosen, wires.no_level);
        c.flip_where(&is_level, wires.no_level);
        c.push(Gate::Cx(wires.reversed, sign));
        let moved: Vec<Literal> = std::iter::once(moving).chain(chosen).collect();
        c.where_all(&moved, |c, moved| self.move_particles(c, wires, along, moved));
        c.push(Gate::Cx(wires.reversed, sign));
        c.comment("energy to speed and level");
        c.square_root(&along.energy);
        c.flip_if(sign, low);
    }

    /// Appends `U` where `moved` holds: a particle moves to the face, across it or back, and into
    /// the cell behind it.
    fn move_particles(&self, c: &mut Circuit, wires: &Wires, along: &AxisRegisters, moved: Qubit) {
        let (x, sign) = (&along.space, along.sign());
        let last = (1 << x.len()) - 1;
        let wraps = self.periodic && self.cells != last + 1;
        c.comment("to the face ahead, named by the cell below it");
        c.where_all(&[(sign, false), (moved, true)], |c, down| {
            c.within(|c| c.flip(x), |c| c.add_bit(down, x));
            if wraps {
                replace(c, down, x, [last, self.cells - 1]);
            }
        });
        if let Some(end) = wires.end.filter(|_| !self.periodic) {
            c.comment("the ends of the box");
            let mut faces = vec![last];
            faces.extend((self.cells - 1 != last).then_some(self.cells - 1));
            for face in faces {
                c.flip_where(&at(moved, x, face), end);
            }
        }
        if !self.jumps.is_empty() {
            self.outside(c, wires, along);
            self.cross(c, along, moved);
            self.outside(c, wires, along);
        }
        c.comment("into the cell behind the face");
        c.where_all(&[(sign, true), (moved, true)], |c, up| {
            c.add_bit(up, x);
            if wraps {
                replace(c, up, x, [self.cells, 0]);
            }
        });
    }

    /// Crosses a jump of `V` of height `ΔV`. Uphill the energy `e` becomes `e − ΔV` where that is
    /// not below zero; else the particle is reflected. Downhill `e` becomes `e + ΔV`.
    fn cross(&self, c: &mut Circuit, along: &AxisRegisters, moved: Qubit) {
        let (e, downhill) = (&along.kinetic, along.sign());
        let height = c.take(e.len());
        let load = |c: &mut Circuit| {
            for jump in &self.jumps {
                let part = jump.part.iter().map(|&(bit, value)| (along.others[bit], value));
                let face = at(moved, &along.space, jump.below).into_iter().chain(part);
                c.where_all(&face.collect::<Vec<_>>(), |c, at| {
                    c.flip_if(at, &ones(&height, jump.levels.unsigned_abs() as usize));
                    if jump.levels > 0 {
                        c.push(Gate::Cx(at, downhill));
                    }
                });
            }
        };
        c.comment("the jump at the face; the sign becomes: downhill");
        c.within(load, |c| {
            // Reserved here, since the loading circuit has scratch of its own.
            let reflected = c.take(1)[0];
            c.comment("which particles are reflected");
            let not_downhill = |c: &mut Circuit| c.push(Gate::X(downhill));
            c.within(not_downhill, |c| c.less(e, &height, Some(downhill), reflected));
            c.comment("the others gain or lose the height of the jump");
            let negated = |c: &mut Circuit| {
                c.push(Gate::X(reflected));
                c.within(not_downhill, |c| c.flip_if(downhill, e));
            };
            c.within(negated, |c| c.add(&height, e, Some(reflected)));
            c.comment("reflection");
            c.push(Gate::Cx(reflected, downhill));
            c.less(e, &height, Some(downhill), reflected);
            c.give_back(&[reflected]);
        });
        c.give_back(&height);
    }

    /// Flags energies above the velocity box, where the register has room for some.
    fn outside(&self, c: &mut Circuit, wires: &Wires, along: &AxisRegisters) {
        let Some(flag) = wires.outside.filter(|_| !self.speeds.is_power_of_two()) else {
            return;
        };
        c.comment("energies above the velocity box");
        let e = &along.kinetic[wires.bins.len()..];
        let limit = c.take(e.len());
        let fastest = ones(&limit, self.speeds * self.speeds);
        c.within(|c| c.flip(&fastest), |c| c.less(e, &limit, None, flag));
        c.push(Gate::X(flag));
        c.give_back(&limit);
    }
}

/// The literals of the conditions `number = value` and `control = 1`.
pub(super) fn at(control: Qubit, number: &[Qubit], value: usize) -> Vec<Literal> {
    std::iter::once((control, true)).chain(equals(number, value)).collect()
}

/// Replaces the value `from` of `number` by `to` where `control` is 1. `number` does not have the
/// value `to` before.
fn replace(c: &mut Circuit, control: Qubit, number: &[Qubit], [from, to]: [usize; 2]) {
    let here = c.take(1);
    let differ = ones(number, from ^ to);
    for value in [from, to] {
        c.flip_where(&at(control, number, value), here[0]);
        if value == from {
            c.flip_if(here[0], &differ);
        }
    }
    c.give_back(&here);
}
