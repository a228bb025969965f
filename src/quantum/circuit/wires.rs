//! The registers of the block encoding, and what acts on the weights of its sum.

use crate::quantum::circuit::arithmetic::{Literal, angle_of};
use crate::quantum::circuit::gates::{Circuit, Gate, Qubit, RegisterRole};
use crate::quantum::circuit::transport::{
    AxisTransport, CaseTransport, CircuitModes, Force, bits_of,
};

/// The weights of the sum.
enum WeightedSum {
    /// Weights for a register of modes.
    Register {
        /// A qubit that is 1 for the part of `T` and `T†` without `D_μ`.
        unit: Qubit,
        /// A qubit that is 1 for `T` and `T†`, 0 for `D`, in the part with `D_μ`.
        half: Qubit,
        /// A register whose first 1 chooses a bit of the mode.
        first: Vec<Qubit>,
    },
    /// Weights for each mode of a register, by a qubit that is 1 for `T` and `T†`, 0 for `D`.
    Each(Qubit),
    /// Weights for one mode, by a qubit that is 1 for `T` and `T†`, 0 for `D`.
    One(Qubit),
}

impl WeightedSum {
    fn new(c: &mut Circuit, modes: CircuitModes) -> Self {
        let mut one = |name| c.register(name, 1, RegisterRole::Block)[0];
        match modes {
            CircuitModes::One(_) => Self::One(one("moved")),
            CircuitModes::Rotated { .. } => Self::Each(one("moved")),
            CircuitModes::Register { qubits, .. } => Self::Register {
                unit: one("unit"),
                half: one("half"),
                first: c.register("first", qubits, RegisterRole::Block),
            },
        }
    }
}

/// The registers of an axis.
pub(in crate::quantum) struct AxisRegisters {
    /// The speed, and the sign above it: the number of the velocity cell.
    pub velocity: Vec<Qubit>,
    /// Number of velocity cells of either sign.
    pub speeds: usize,
    /// The number of the space cell.
    pub space: Vec<Qubit>,
    /// The cells along the other space axes, the last one lowest.
    pub others: Vec<Qubit>,
    /// Level and speed as one number, whose highest bit marks a level that does not exist.
    pub energy: Vec<Qubit>,
    /// Bits of the level that no level of this axis has.
    pub spare: Vec<Qubit>,
    /// Energies in bins, with a bit for energies above the register.
    pub kinetic: Vec<Qubit>,
    /// The literals that select this axis.
    pub chosen: Vec<Literal>,
}

/// The registers of which each axis has a part.
struct SharedRegisters<'a> {
    spaces: &'a [Vec<Qubit>],
    bins: &'a [Qubit],
    level: &'a [Qubit],
    above: Option<Qubit>,
    terms: &'a TermRegister,
}

impl AxisRegisters {
    /// The registers of axis `a` with this `velocity`.
    fn new(a: usize, speeds: usize, velocity: Vec<Qubit>, common: &SharedRegisters<'_>) -> Self {
        let SharedRegisters { spaces, bins, level, above, terms } = common;
        let speed = &velocity[..velocity.len() - 1];
        let energy = [&level[..velocity.len()], speed].concat();
        let others = (0..spaces.len()).rev().filter(|b| *b != a);
        Self {
            space: spaces[a].clone(),
            others: others.flat_map(|b| spaces[b].clone()).collect(),
            kinetic: [bins, &energy[..2 * speed.len()], above.as_slice()].concat(),
            spare: level[velocity.len()..].to_vec(),
            chosen: terms.chosen(a),
            speeds,
            energy,
            velocity,
        }
    }

    /// The qubit of the sign, which is 1 for velocities above 0.
    pub fn sign(&self) -> Qubit {
        self.velocity[self.velocity.len() - 1]
    }

    /// The speed, as a number or its complement.
    pub fn speed(&self) -> &[Qubit] {
        &self.velocity[..self.velocity.len() - 1]
    }
}

/// The qubits that choose a term of the sum over axes and forces.
pub(in crate::quantum) struct TermRegister(Vec<Qubit>);

impl TermRegister {
    /// The literals that say that this term is chosen: its own qubit is 1, and those of the later
    /// terms are 0. The first term has no qubit of its own.
    pub fn chosen(&self, term: usize) -> Vec<Literal> {
        let own = term.checked_sub(1).map(|a| (self.0[a], true));
        own.into_iter().chain(self.0[term..].iter().map(|&q| (q, false))).collect()
    }

    /// Prepares the weights `rates` of the terms.
    pub fn choose(&self, c: &mut Circuit, rates: &[f64]) {
        for (a, &q) in self.0.iter().enumerate() {
            let before: f64 = rates[..=a].iter().sum();
            let all = before + rates[a + 1];
            if all > 0.0 {
                c.push(Gate::Ry(angle_of(before / all), q));
            }
        }
    }
}

/// The registers of a circuit.
pub(in crate::quantum) struct Wires {
    modes: Vec<Qubit>,
    /// The registers of each axis.
    pub along: Vec<AxisRegisters>,
    /// The register of the bins of a level.
    pub bins: Vec<Qubit>,
    /// The register of the levels of a cell.
    level: Vec<Qubit>,
    /// A qubit that is 1 where there is no such level.
    pub no_level: Qubit,
    /// A qubit that is 1 where a particle leaves the box in space; `None` if space has no ends.
    pub end: Option<Qubit>,
    /// All bits of space cells, the last axis lowest.
    pub space: Vec<Qubit>,
    /// The qubit that is rotated where a force is weaker than the largest one, so that the block is
    /// less than 1 there. `None` if all forces are equal.
    pub weaker: Option<Qubit>,
    /// A qubit that is 1 where a force pushes a particle out of the velocity box; `None` without
    /// forces.
    pub end_of_velocity: Option<Qubit>,
    /// A qubit that is 1 where an energy is above the velocity box, if a register has room for one.
    pub outside: Option<Qubit>,
    sum: WeightedSum,
    /// The qubits that choose a term: an axis or a force.
    pub terms: TermRegister,
    /// A qubit that is 1 for `T†`.
    pub reversed: Qubit,
    /// A qubit that is 1 where the circuit is applied; `None` if it always is.
    pub control: Option<Qubit>,
}

/// Names of registers by axis, of one dimension and of more.
const VELOCITIES: [&[&str]; 2] = [&["velocity"], &["velocity_x", "velocity_y", "velocity_z"]];
const SPACES: [&[&str]; 2] = [&["space"], &["space_x", "space_y", "space_z"]];

/// A register of the system for each of `axes`, of so many `bits`. The last axis is the lowest.
fn registers_by_axis(
    c: &mut Circuit,
    names: [&[&'static str]; 2],
    axes: &[AxisTransport],
    bits: impl Fn(&AxisTransport) -> usize,
) -> Vec<Vec<Qubit>> {
    let names = names[usize::from(axes.len() > 1)];
    let each = names.iter().zip(axes).rev();
    let mut all: Vec<Vec<Qubit>> =
        each.map(|(name, axis)| c.register(name, bits(axis), RegisterRole::System)).collect();
    all.reverse();
    all
}

impl Wires {
    pub fn new(
        c: &mut Circuit,
        transport: &CaseTransport,
        modes: CircuitModes,
        controlled: bool,
    ) -> Self {
        let axes = &transport.axes;
        let warped = c.register("warped", modes.qubits(), RegisterRole::System);
        let velocities = registers_by_axis(c, VELOCITIES, axes, |axis| bits_of(axis.speeds) + 1);
        let spaces = registers_by_axis(c, SPACES, axes, |axis| bits_of(axis.cells));
        let control = c.register("control", usize::from(controlled), RegisterRole::System);
        let bins = c.register("bins", transport.bin_bits, RegisterRole::Block);
        let levels = velocities.iter().map(Vec::len).max().unwrap_or_default();
        let level = c.register("level", levels, RegisterRole::Block);
        let mut flag = |name, wanted: bool| {
            c.register(name, usize::from(wanted), RegisterRole::Block).first().copied()
        };
        let jumps = |axis: &AxisTransport| !axis.jumps.is_empty();
        let above = flag("above", axes.iter().any(jumps));
        let no_level = flag("no_level", true);
        let end = flag("boundary", axes.iter().any(|axis| !axis.periodic));
        let rest = |axis: &AxisTransport| jumps(axis) && !axis.speeds.is_power_of_two();
        let outside = flag("outside", axes.iter().any(rest));
        let forces = &transport.forces;
        let end_of_velocity = flag("end_of_velocity", !forces.is_empty());
        let varies = |force: &Force| force.shares.iter().any(|&share| share < 1.0);
        let weaker = flag("weaker", forces.iter().any(varies));
        let sum = WeightedSum::new(c, modes);
        let name = if forces.is_empty() { "axis" } else { "term" };
        let terms =
            TermRegister(c.register(name, axes.len() + forces.len() - 1, RegisterRole::Block));
        let reversed = c.register("reversed", 1, RegisterRole::Block)[0];
        let common =
            SharedRegisters { spaces: &spaces, bins: &bins, level: &level, above, terms: &terms };
        let along = velocities.into_iter().zip(axes).enumerate();
        let along = along
            .map(|(a, (velocity, axis))| AxisRegisters::new(a, axis.speeds, velocity, &common));
        let along = along.collect();
        Self {
            modes: warped,
            along,
            space: spaces.iter().rev().flatten().copied().collect(),
            weaker,
            end_of_velocity,
            no_level: no_level.unwrap_or_default(),
            end,
            outside,
            sum,
            reversed,
            bins,
            level,
            terms,
            control: control.first().copied(),
        }
    }

    /// Prepares the weights of the sum, and the levels.
    pub fn prepare(&self, c: &mut Circuit, modes: CircuitModes, values: usize) {
        let [diagonal, moved] = modes.weights();
        match &self.sum {
            WeightedSum::Each(_) => {}
            WeightedSum::One(q) if diagonal == 0.0 => c.push(Gate::X(*q)),
            WeightedSum::One(q) => c.push(Gate::Ry(angle_of(diagonal / (diagonal + moved)), *q)),
            WeightedSum::Register { unit, half, first } => {
                let with_mode = 2.0 * diagonal / (diagonal + moved);
                c.push(Gate::Ry(angle_of(with_mode), *unit));
                c.push(Gate::H(*half));
                first.iter().for_each(|&q| c.push(Gate::H(q)));
            }
        }
        c.push(Gate::H(self.reversed));
        if let WeightedSum::Each(moved) = self.sum {
            self.rotate_each(c, modes, moved);
        }
        self.bins.iter().for_each(|&q| c.push(Gate::H(q)));
        c.uniform(&self.level, values);
    }

    /// The weights of each mode, `1 − w` of `D` and `w` of `T` and `T†`, and phases. With `α'` the
    /// sum of the highest mode's, `w = √(1 + μ²)/α'`, and `reversed`, which is flipped between this
    /// and its inverse, has the block `⟨+|X e^{iχZ}|+⟩ = cos χ`: of `D` with
    /// `cos χ = −μ/(α' − √(1 + μ²))`, and of `T` and `T†` the phases `e^{±iχ}`, `tan χ = 1/μ`.
    fn rotate_each(&self, c: &mut Circuit, modes: CircuitModes, moved: Qubit) {
        let all: f64 = modes.weights().iter().sum();
        let (mut weights, mut phases) = (Vec::new(), [Vec::new(), Vec::new()]);
        for mu in modes.wavenumbers() {
            let of_moved = mu.hypot(1.0);
            let left = all - of_moved;
            weights.push(angle_of(left / all));
            let cos = if left > 0.0 { (-mu / left).clamp(-1.0, 1.0) } else { 0.0 };
            phases[0].push(-cos.acos());
            phases[1].push(-1f64.atan2(mu));
        }
        c.rotate(Gate::Ry, &self.modes, moved, &weights);
        let controls = [&self.modes[..], &[moved]].concat();
        c.rotate(Gate::Rz, &controls, self.reversed, &phases.concat());
    }

    /// Appends the factors of the sum that act on the modes, and its phases.
    pub fn phases(&self, c: &mut Circuit, modes: CircuitModes) {
        match (&self.sum, modes) {
            (WeightedSum::One(moved), CircuitModes::One(0.0)) => self.opposite_phases(c, *moved),
            (WeightedSum::One(moved), CircuitModes::One(mu)) => {
                c.comment("phases: -mu of D, mu + i of T, mu - i of its inverse");
                if mu > 0.0 {
                    c.where_all(&self.given(&[(*moved, false)]), |c, q| c.push(Gate::Z(q)));
                }
                c.where_all(&self.given(&[(*moved, true)]), |c, q| {
                    c.controlled(Gate::Rz, -2.0 * 1f64.atan2(mu), q, self.reversed);
                });
            }
            (WeightedSum::Register { unit, half, first }, _) => {
                self.opposite_phases(c, *unit);
                c.comment("-D_mu, and once more the sign of T and its inverse with it");
                c.where_all(&self.given(&[(*unit, false)]), |c, q| {
                    c.push(Gate::Cz(q, *half));
                    self.signs(c, q, first);
                });
            }
            // These have them in their preparation; the wires are those of the modes.
            (WeightedSum::Each(_), _) | (WeightedSum::One(_), _) => {}
        }
    }

    /// Appends the factor `i` of `T` and `−i` of its inverse, where `wanted` is 1.
    fn opposite_phases(&self, c: &mut Circuit, wanted: Qubit) {
        c.comment("phases: i of T, -i of its inverse");
        c.where_all(&self.given(&[(wanted, true)]), |c, q| {
            c.push(Gate::S(q));
            c.push(Gate::Cz(q, self.reversed));
        });
    }

    /// Appends `Z` on the bit of the mode at which `first` has its first 1, where `wanted` is 1.
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

    /// The literals of the condition that `literals` hold and the circuit is applied.
    pub fn given(&self, literals: &[Literal]) -> Vec<Literal> {
        literals.iter().copied().chain(self.control.map(|q| (q, true))).collect()
    }

    /// Appends `body` with the literal that selects `T` or `T†`, not `D`.
    pub fn where_moving(&self, c: &mut Circuit, body: impl FnOnce(&mut Circuit, Literal)) {
        match self.sum {
            WeightedSum::One(q) | WeightedSum::Each(q) => body(c, (q, true)),
            WeightedSum::Register { unit, half, .. } => {
                let none = [(unit, false), (half, false)];
                c.where_all(&none, |c, diagonal| body(c, (diagonal, false)));
            }
        }
    }
}
