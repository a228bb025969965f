//! The block encoding of `H` in one dimension, with the conservative interface.
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
//! The circuit is its own inverse on the states that it starts from.

use crate::quantum::circuit::arithmetic::{Literal, angle_of, equals};
use crate::quantum::circuit::gates::{Circuit, Gate, Qubit, Role};
use serde::Serialize;
use std::f64::consts::PI;

/// A jump of `V`.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize)]
pub struct Jump {
    /// The cell below the face; the last one for the face that closes a periodic axis.
    pub below: usize,
    /// By how many levels `V` rises from that cell to the next.
    pub levels: i64,
}

/// The transport of a case, in whole numbers.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct Transport {
    /// Cells in space.
    pub cells: usize,
    /// Whether the last cell is before the first.
    pub periodic: bool,
    /// Velocity cells of either sign, `j_max + 1`.
    pub speeds: usize,
    /// `b`: each level is divided into `2^b` bins.
    pub bin_bits: usize,
    /// Jumps of `V`, in bins.
    pub jumps: Vec<Jump>,
    /// `v₁/Δx = Δv/(2Δx)`.
    pub rate: f64,
}

/// Which modes the circuit acts on.
#[derive(Clone, Copy, Debug, PartialEq, Serialize)]
pub enum Modes {
    /// All of a register of `p` of so many qubits on this period.
    Register {
        /// `n_p`.
        qubits: usize,
        /// `P`.
        period: f64,
    },
    /// One, of this wavenumber.
    One(f64),
}

/// The register that numbers the levels of a cell.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, clap::ValueEnum)]
#[serde(rename_all = "lowercase")]
pub enum Levels {
    /// All values of its qubits: Hadamard gates.
    #[default]
    Hadamard,
    /// As many as the fastest cell has levels: rotations; α is least.
    Uniform,
}

impl Modes {
    /// `Σ` of the weights of `−μD`, and of `T` and `T†`.
    fn weights(self) -> [f64; 2] {
        match self {
            Self::Register { qubits, period } => {
                let largest = PI * (1u64 << qubits) as f64 / period;
                [largest, largest + 1.0]
            }
            Self::One(mu) => [mu.abs(), mu.hypot(1.0)],
        }
    }
}

/// Bits that number `count` things.
pub fn bits_of(count: usize) -> usize {
    count.next_power_of_two().trailing_zeros() as usize
}

impl Transport {
    /// `M`.
    fn level_values(&self, levels: Levels) -> usize {
        match levels {
            Levels::Hadamard => 2 << bits_of(self.speeds),
            Levels::Uniform => 2 * self.speeds - 1,
        }
    }

    /// `α`: the block of the circuit is `H/α`.
    pub fn alpha(&self, modes: Modes, levels: Levels) -> f64 {
        let [diagonal, moved] = modes.weights();
        self.rate * self.level_values(levels) as f64 * (diagonal + moved)
    }

    /// The number of the state `(x, velocity cell)`, without the modes; velocities are centred in
    /// their register.
    pub fn state(&self, x: usize, v: usize) -> usize {
        let half = 1 << bits_of(self.speeds);
        x * 2 * half + v + half - self.speeds
    }

    /// The circuit whose block is `H/α`. If `controlled`, a further qubit of the system, above the
    /// others, says whether it is applied.
    pub fn encode(&self, modes: Modes, levels: Levels, controlled: bool) -> Circuit {
        let mut circuit = Circuit::default();
        let wires = Wires::new(&mut circuit, self, modes, controlled);
        let c = &mut circuit;
        let values = self.level_values(levels);
        c.comment("prepare the weights of the sum, and uniform levels");
        let first = c.gates.len();
        wires.prepare(c, modes, values);
        let prepared = c.gates[first..].to_vec();
        wires.phases(c, modes);
        wires.where_moved(c, |c, moved| {
            c.comment("speed and level to energy");
            let [sign, low] = [&wires.velocity[wires.low..], &wires.velocity[..wires.low]];
            c.flip_if(sign[0], low);
            c.inverse_of(|c| c.square_root(&wires.energy));
            let no_level = wires.given((wires.energy[2 * wires.low], true));
            c.where_all(&no_level, |c, no_level| c.push(Gate::Cx(no_level, wires.no_level)));
            c.push(Gate::Cx(wires.reversed, sign[0]));
            self.move_particles(c, &wires, moved);
            c.push(Gate::Cx(wires.reversed, sign[0]));
            c.comment("energy to speed and level");
            c.square_root(&wires.energy);
            c.flip_if(sign[0], low);
        });
        c.push(match wires.control {
            Some(control) => Gate::Cx(control, wires.reversed),
            None => Gate::X(wires.reversed),
        });
        c.comment("undo the preparation");
        c.gates.extend(prepared.iter().rev().map(|gate| gate.inverse()));
        circuit.finish();
        circuit
    }

    /// `U`, where `moved` holds: to the face, across it or back, into the cell behind it.
    fn move_particles(&self, c: &mut Circuit, wires: &Wires, moved: Qubit) {
        let (x, sign) = (&wires.space, wires.velocity[wires.low]);
        let last = (1 << x.len()) - 1;
        let wraps = self.periodic && self.cells != last + 1;
        c.comment("to the face ahead, named by the cell below it");
        c.where_all(&[(sign, false), (moved, true)], |c, down| {
            c.within(|c| c.flip(x), |c| c.add_bit(down, x));
            if wraps {
                replace(c, down, x, [last, self.cells - 1]);
            }
        });
        if let Some(end) = wires.end {
            c.comment("the ends of the box");
            let mut faces = vec![last];
            faces.extend((self.cells - 1 != last).then_some(self.cells - 1));
            for face in faces {
                c.where_all(&at(moved, x, face), |c, here| c.push(Gate::Cx(here, end)));
            }
        }
        if !self.jumps.is_empty() {
            self.outside(c, wires);
            self.cross(c, wires, moved);
            self.outside(c, wires);
        }
        c.comment("into the cell behind the face");
        c.where_all(&[(sign, true), (moved, true)], |c, up| {
            c.add_bit(up, x);
            if wraps {
                replace(c, up, x, [self.cells, 0]);
            }
        });
    }

    /// At a jump: `e − ΔV` uphill where that is not below zero, else back; `e + ΔV` downhill.
    fn cross(&self, c: &mut Circuit, wires: &Wires, moved: Qubit) {
        let (e, downhill) = (&wires.kinetic, wires.velocity[wires.low]);
        let height = c.take(e.len());
        let reflected = c.take(1)[0];
        let load = |c: &mut Circuit| {
            for jump in &self.jumps {
                c.where_all(&at(moved, &wires.space, jump.below), |c, at| {
                    for (q, _) in
                        equals(&height, jump.levels.unsigned_abs() as usize).filter(|bit| bit.1)
                    {
                        c.push(Gate::Cx(at, q));
                    }
                    if jump.levels > 0 {
                        c.push(Gate::Cx(at, downhill));
                    }
                });
            }
        };
        c.comment("the jump at the face; the sign becomes: downhill");
        c.within(load, |c| {
            c.comment("who is reflected");
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
        });
        c.give_back(&[reflected]);
        c.give_back(&height);
    }

    /// Flags energies above the velocity box, where the register has room for some.
    fn outside(&self, c: &mut Circuit, wires: &Wires) {
        let Some(flag) = wires.outside else {
            return;
        };
        c.comment("energies above the velocity box");
        let e = &wires.kinetic[self.bin_bits..];
        let limit = c.take(e.len());
        let load = |c: &mut Circuit| {
            equals(&limit, self.speeds * self.speeds)
                .filter(|bit| bit.1)
                .for_each(|(q, _)| c.push(Gate::X(q)));
        };
        c.within(load, |c| c.less(e, &limit, None, flag));
        c.push(Gate::X(flag));
        c.give_back(&limit);
    }
}

/// The literals that say `number = value`, and that `control` is 1.
fn at(control: Qubit, number: &[Qubit], value: usize) -> Vec<Literal> {
    std::iter::once((control, true)).chain(equals(number, value)).collect()
}

/// Where `control` is 1, the value `from` of `number` becomes `to`, which it does not have.
fn replace(c: &mut Circuit, control: Qubit, number: &[Qubit], [from, to]: [usize; 2]) {
    let here = c.take(1);
    let differ: Vec<Qubit> = equals(number, from ^ to).filter(|bit| bit.1).map(|b| b.0).collect();
    for value in [from, to] {
        c.where_all(&at(control, number, value), |c, all| c.push(Gate::Cx(all, here[0])));
        if value == from {
            c.flip_if(here[0], &differ);
        }
    }
    c.give_back(&here);
}

/// The weights of the sum.
enum Sum {
    /// Of a register of modes.
    Register {
        /// 1 for the part of `T` and `T†` without `D_μ`.
        unit: Qubit,
        /// 1 for `T` and `T†`, 0 for `D`, in the part with `D_μ`.
        half: Qubit,
        /// Its first 1 chooses a bit of the mode.
        first: Vec<Qubit>,
    },
    /// Of one mode: 1 for `T` and `T†`, 0 for `D`.
    One(Qubit),
}

/// The registers of a circuit.
struct Wires {
    modes: Vec<Qubit>,
    /// Bits of a speed.
    low: usize,
    /// The speed, and the sign above it.
    velocity: Vec<Qubit>,
    space: Vec<Qubit>,
    /// Level and speed as one number, whose highest bit says that there is no such level.
    energy: Vec<Qubit>,
    /// Energies in bins, with a bit for what is above the register.
    kinetic: Vec<Qubit>,
    /// Bins and level.
    spread: [Vec<Qubit>; 2],
    no_level: Qubit,
    end: Option<Qubit>,
    outside: Option<Qubit>,
    sum: Sum,
    /// 1 for `T†`.
    reversed: Qubit,
    /// 1 where the circuit is applied; none if always.
    control: Option<Qubit>,
}

impl Wires {
    fn new(c: &mut Circuit, transport: &Transport, modes: Modes, controlled: bool) -> Self {
        let low = bits_of(transport.speeds);
        let mode_qubits = match modes {
            Modes::Register { qubits, .. } => qubits,
            Modes::One(_) => 0,
        };
        let warped = c.register("warped", mode_qubits, Role::System);
        let velocity = c.register("velocity", low + 1, Role::System);
        let space = c.register("space", bits_of(transport.cells).max(1), Role::System);
        let control = c.register("control", usize::from(controlled), Role::System);
        let bins = c.register("bins", transport.bin_bits, Role::Block);
        let level = c.register("level", low + 1, Role::Block);
        let mut flag = |name, wanted: bool| {
            c.register(name, usize::from(wanted), Role::Block).first().copied()
        };
        let jumps = !transport.jumps.is_empty();
        let above = flag("above", jumps);
        let no_level = flag("no_level", true);
        let end = flag("end", !transport.periodic);
        let outside = flag("outside", jumps && !transport.speeds.is_power_of_two());
        let sum = match modes {
            Modes::One(_) => Sum::One(c.register("moved", 1, Role::Block)[0]),
            Modes::Register { qubits, .. } => Sum::Register {
                unit: c.register("unit", 1, Role::Block)[0],
                half: c.register("half", 1, Role::Block)[0],
                first: c.register("first", qubits, Role::Block),
            },
        };
        let reversed = c.register("reversed", 1, Role::Block)[0];
        let energy = [&level[..], &velocity[..low]].concat();
        let kinetic = [&bins, &energy[..2 * low], above.as_slice()].concat();
        Self {
            modes: warped,
            low,
            velocity,
            space,
            energy,
            kinetic,
            spread: [bins, level],
            no_level: no_level.unwrap_or_default(),
            end,
            outside,
            sum,
            reversed,
            control: control.first().copied(),
        }
    }

    /// Weights of the sum, and levels.
    fn prepare(&self, c: &mut Circuit, modes: Modes, values: usize) {
        let [diagonal, moved] = modes.weights();
        match &self.sum {
            Sum::One(q) => c.push(Gate::Ry(angle_of(diagonal / (diagonal + moved)), *q)),
            Sum::Register { unit, half, first } => {
                let with_mode = 2.0 * diagonal / (diagonal + moved);
                c.push(Gate::Ry(angle_of(with_mode), *unit));
                c.push(Gate::H(*half));
                first.iter().for_each(|&q| c.push(Gate::H(q)));
            }
        }
        c.push(Gate::H(self.reversed));
        let [bins, level] = &self.spread;
        bins.iter().for_each(|&q| c.push(Gate::H(q)));
        c.uniform(level, values);
    }

    /// The factors of the sum that act on the modes, and its phases.
    fn phases(&self, c: &mut Circuit, modes: Modes) {
        match (&self.sum, modes) {
            (Sum::One(moved), Modes::One(mu)) => {
                c.comment("phases: -mu of D, mu + i of T, mu - i of its inverse");
                if mu > 0.0 {
                    c.where_all(&self.given((*moved, false)), |c, q| c.push(Gate::Z(q)));
                }
                c.where_all(&self.given((*moved, true)), |c, q| {
                    c.controlled_rz(-2.0 * 1f64.atan2(mu), q, self.reversed);
                });
            }
            (Sum::Register { unit, half, first }, _) => {
                c.comment("phases: i of T, -i of its inverse");
                c.where_all(&self.given((*unit, true)), |c, q| {
                    c.push(Gate::S(q));
                    c.push(Gate::Cz(q, self.reversed));
                });
                c.comment("-D_mu, and once more the sign of T and its inverse with it");
                c.where_all(&self.given((*unit, false)), |c, q| {
                    c.push(Gate::Cz(q, *half));
                    self.signs(c, q, first);
                });
            }
            // The wires are those of the modes.
            (Sum::One(_), Modes::Register { .. }) => {}
        }
    }

    /// `Z` on the bit of the mode at which `first` has its first 1, where `wanted` is 1.
    fn signs(&self, c: &mut Circuit, wanted: Qubit, first: &[Qubit]) {
        let none = c.take(first.len());
        // None of the bits from this one up.
        let above = |bit: usize| none.get(bit + 1).copied().unwrap_or(wanted);
        let chain = |c: &mut Circuit| {
            for bit in (0..first.len()).rev() {
                let zero = |c: &mut Circuit| c.push(Gate::X(first[bit]));
                c.within(zero, |c| c.push(Gate::Ccx(above(bit), first[bit], none[bit])));
            }
        };
        c.within(chain, |c| {
            for (bit, &mode) in self.modes.iter().enumerate() {
                c.push(Gate::Cz(above(bit), mode));
                c.push(Gate::Cz(none[bit], mode));
            }
        });
        c.give_back(&none);
    }

    /// What says that `literal` holds and the circuit is applied.
    fn given(&self, literal: Literal) -> Vec<Literal> {
        std::iter::once(literal).chain(self.control.map(|q| (q, true))).collect()
    }

    /// `body` with the qubit that is 1 for `T` and `T†`, and not for `D`.
    fn where_moved(&self, c: &mut Circuit, body: impl FnOnce(&mut Circuit, Qubit)) {
        match self.sum {
            Sum::One(q) => c.where_all(&self.given((q, true)), body),
            Sum::Register { unit, half, .. } => {
                c.where_all(&[(unit, false), (half, false)], |c, diagonal| {
                    c.where_all(&self.given((diagonal, false)), body);
                });
            }
        }
    }
}
