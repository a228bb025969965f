//! Gates, circuits, and their counts.

use serde::{Serialize, Serializer};

/// A qubit by its number.
pub type Qubit = usize;

/// A gate. Names are those of OpenQASM's `stdgates.inc`.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Gate {
    /// Pauli X, the not.
    X(Qubit),
    /// Hadamard.
    H(Qubit),
    /// `diag(1, −1)`.
    Z(Qubit),
    /// `diag(1, i)`.
    S(Qubit),
    /// `diag(1, −i)`.
    Sdg(Qubit),
    /// `diag(1, e^{iπ/4})`.
    T(Qubit),
    /// `diag(1, e^{−iπ/4})`.
    Tdg(Qubit),
    /// Rotation about y by an angle.
    Ry(f64, Qubit),
    /// Rotation about z by an angle: `diag(e^{−iθ/2}, e^{iθ/2})`.
    Rz(f64, Qubit),
    /// NOT of the second qubit if the first is 1.
    Cx(Qubit, Qubit),
    /// Sign where both are 1.
    Cz(Qubit, Qubit),
    /// Phase `e^{iθ}` where both are 1.
    Cp(f64, Qubit, Qubit),
    /// Exchange.
    Swap(Qubit, Qubit),
    /// Toffoli: not of the third where the first two are 1.
    Ccx(Qubit, Qubit, Qubit),
}

/// A gate as a name with its arguments.
pub struct GateParts {
    /// The name in OpenQASM.
    pub name: &'static str,
    /// The angle of a rotation or phase.
    pub angle: Option<f64>,
    /// The qubits, the target last.
    pub qubits: Vec<Qubit>,
}

impl Gate {
    /// The gate's name, its angle in radians if it has one, and the qubits that it acts on.
    pub fn parts(self) -> GateParts {
        let (name, angle, qubits) = match self {
            Self::X(q) => ("x", None, vec![q]),
            Self::H(q) => ("h", None, vec![q]),
            Self::Z(q) => ("z", None, vec![q]),
            Self::S(q) => ("s", None, vec![q]),
            Self::Sdg(q) => ("sdg", None, vec![q]),
            Self::T(q) => ("t", None, vec![q]),
            Self::Tdg(q) => ("tdg", None, vec![q]),
            Self::Ry(angle, q) => ("ry", Some(angle), vec![q]),
            Self::Rz(angle, q) => ("rz", Some(angle), vec![q]),
            Self::Cx(a, q) => ("cx", None, vec![a, q]),
            Self::Cz(a, q) => ("cz", None, vec![a, q]),
            Self::Cp(angle, a, q) => ("cp", Some(angle), vec![a, q]),
            Self::Swap(a, q) => ("swap", None, vec![a, q]),
            Self::Ccx(a, b, q) => ("ccx", None, vec![a, b, q]),
        };
        GateParts { name, angle, qubits }
    }

    /// The gate that undoes it.
    pub fn inverse(self) -> Self {
        match self {
            Self::S(q) => Self::Sdg(q),
            Self::Sdg(q) => Self::S(q),
            Self::T(q) => Self::Tdg(q),
            Self::Tdg(q) => Self::T(q),
            Self::Ry(angle, q) => Self::Ry(-angle, q),
            Self::Rz(angle, q) => Self::Rz(-angle, q),
            Self::Cp(angle, a, q) => Self::Cp(-angle, a, q),
            own_inverse => own_inverse,
        }
    }
}

/// A gate is written as `[name, qubits.., angle]`.
impl Serialize for Gate {
    fn serialize<S: Serializer>(&self, serializer: S) -> Result<S::Ok, S::Error> {
        let GateParts { name, angle, qubits } = self.parts();
        match angle {
            Some(angle) => (name, qubits, angle).serialize(serializer),
            None => (name, qubits).serialize(serializer),
        }
    }
}

/// The purpose of a register.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize)]
#[serde(rename_all = "lowercase")]
pub enum RegisterRole {
    /// A register that the operator acts on.
    System,
    /// Zero before. The encoded block are the amplitudes for which it is zero after.
    Block,
    /// Zero before and after.
    Scratch,
    /// Zero before, and read after.
    Readout,
}

/// Neighbouring qubits, the lowest bit first.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct Register {
    /// The name of the register in the OpenQASM program.
    pub name: &'static str,
    /// The lowest qubit of the register.
    pub first: Qubit,
    /// Number of qubits.
    pub size: usize,
    /// The purpose of the register.
    pub role: RegisterRole,
}

/// Gates in their order, on registers. Scratch qubits are taken as needed and given back clean.
#[derive(Clone, Debug, Default)]
pub struct Circuit {
    /// The registers. Scratch qubits are among them only after [`finish`](Self::finish).
    pub registers: Vec<Register>,
    /// The gates, in the order of time.
    pub gates: Vec<Gate>,
    /// The first gate of each part, by number, and the purpose of the part.
    pub comments: Vec<(usize, &'static str)>,
    /// Qubits of the registers.
    named: usize,
    /// Scratch qubits that are in use, and the most that ever were.
    scratch: [usize; 2],
}

impl Circuit {
    /// Adds a register of `size` qubits, and returns them. No register may follow once scratch was
    /// taken.
    pub fn register(&mut self, name: &'static str, size: usize, role: RegisterRole) -> Vec<Qubit> {
        debug_assert!(self.scratch[1] == 0, "registers come before scratch");
        let first = self.named;
        if size > 0 {
            self.registers.push(Register { name, first, size, role });
        }
        self.named += size;
        (first..self.named).collect()
    }

    /// `count` clean qubits, to be given back clean by [`give_back`](Self::give_back), the last
    /// taken first.
    pub fn take(&mut self, count: usize) -> Vec<Qubit> {
        let first = self.named + self.scratch[0];
        self.scratch[0] += count;
        self.scratch[1] = self.scratch[1].max(self.scratch[0]);
        (first..first + count).collect()
    }

    /// Gives back what [`take`](Self::take) gave.
    pub fn give_back(&mut self, qubits: &[Qubit]) {
        self.scratch[0] -= qubits.len();
        debug_assert!(qubits.first().is_none_or(|&q| q == self.named + self.scratch[0]));
    }

    /// The scratch qubits taken so far, which are clean.
    pub fn clean_scratch(&self) -> Vec<Qubit> {
        (self.named + self.scratch[0]..self.qubits()).collect()
    }

    /// The qubits of the registers with this role.
    pub fn qubits_of(&self, role: RegisterRole) -> Vec<Qubit> {
        let registers = self.registers.iter().filter(|r| r.role == role);
        registers.flat_map(|r| r.first..r.first + r.size).collect()
    }

    /// Makes the scratch qubits a register, as the last step.
    pub fn finish(&mut self) {
        let [_, size] = std::mem::take(&mut self.scratch);
        self.register("scratch", size, RegisterRole::Scratch);
    }

    /// All qubits.
    pub fn qubits(&self) -> usize {
        self.named + self.scratch[1]
    }

    /// Adds a gate.
    pub fn push(&mut self, gate: Gate) {
        self.gates.push(gate);
    }

    /// NOT of each of `qubits`.
    pub fn flip(&mut self, qubits: &[Qubit]) {
        self.gates.extend(qubits.iter().map(|&q| Gate::X(q)));
    }

    /// NOT of each of `qubits` if `control` is 1.
    pub fn flip_if(&mut self, control: Qubit, qubits: &[Qubit]) {
        self.gates.extend(qubits.iter().map(|&q| Gate::Cx(control, q)));
    }

    /// Records the purpose of the next gates.
    pub fn comment(&mut self, what: &'static str) {
        self.comments.push((self.gates.len(), what));
    }

    /// The inverse of what `part` adds.
    pub fn inverse_of(&mut self, part: impl FnOnce(&mut Self)) {
        let first = self.gates.len();
        part(self);
        self.gates[first..].reverse();
        self.gates[first..].iter_mut().for_each(|gate| *gate = gate.inverse());
    }

    /// `body` between `around` and its inverse.
    pub fn within(&mut self, around: impl Fn(&mut Self), body: impl FnOnce(&mut Self)) {
        around(self);
        body(self);
        self.inverse_of(around);
    }

    /// Numbers of gates and qubits.
    pub fn counts(&self) -> GateCounts {
        let role = |role: RegisterRole| self.qubits_of(role).len();
        let mut counts = GateCounts {
            system_qubits: role(RegisterRole::System),
            block_qubits: role(RegisterRole::Block),
            scratch_qubits: role(RegisterRole::Scratch),
            qubits: self.qubits(),
            gates: self.gates.len(),
            ..GateCounts::default()
        };
        let (mut all, mut hard) = (vec![0; self.qubits()], vec![0; self.qubits()]);
        for &gate in &self.gates {
            let qubits = gate.parts().qubits;
            let toffoli = matches!(gate, Gate::Ccx(..));
            match gate {
                Gate::Ccx(..) => counts.toffoli += 1,
                Gate::Cx(..) | Gate::Cz(..) => counts.cnot += 1,
                Gate::Swap(..) => counts.cnot += 3,
                Gate::Cp(..) => {
                    (counts.cnot, counts.rotations) = (counts.cnot + 2, counts.rotations + 3)
                }
                Gate::T(_) | Gate::Tdg(_) => counts.t += 1,
                Gate::Ry(..) | Gate::Rz(..) => counts.rotations += 1,
                Gate::H(_) => counts.hadamard += 1,
                _ => {}
            }
            for (depths, step) in [(&mut all, 1), (&mut hard, usize::from(toffoli))] {
                let next = step + qubits.iter().map(|&q| depths[q]).max().unwrap_or(0);
                qubits.iter().for_each(|&q| depths[q] = next);
            }
        }
        counts.t_with_toffoli = counts.t + T_OF_TOFFOLI * counts.toffoli;
        counts.depth = all.into_iter().max().unwrap_or(0);
        counts.toffoli_depth = hard.into_iter().max().unwrap_or(0);
        counts
    }
}

impl GateCounts {
    /// Toffoli gates of a step of the walk by this controlled circuit: with a reflection about the
    /// zeros of the block's qubits, controlled as well.
    pub fn toffoli_a_step(&self) -> usize {
        self.toffoli + self.toffoli_of_reflection()
    }

    /// Rotations of a step: those of a call, and one phase of the sequence. The sequence has one
    /// more phase than steps.
    pub fn rotations_a_step(&self) -> usize {
        self.rotations + 1
    }

    /// Toffoli gates of `steps` forward or back by this circuit, and of two of the `controlled`
    /// one. Each call is between two reflections; neighbours share the qubit that marks the zeros.
    pub fn toffoli_both_ways(&self, controlled: &Self, steps: f64) -> f64 {
        let reflection = self.toffoli_of_reflection();
        let ends = 2 * controlled.toffoli_a_step() + reflection;
        steps * (self.toffoli + reflection) as f64 + ends as f64
    }

    /// Qubits of a sequence of steps by this controlled circuit. A sequence forward and back takes
    /// equally many, since its ends are controlled. A reflection takes a clean ancilla for each
    /// qubit of the block but one; the scratch qubits of the call serve as ancillas as far as they
    /// go.
    pub fn qubits_of_sequence(&self) -> usize {
        self.qubits - self.scratch_qubits + self.ancillas_of_sequence()
    }

    /// Ancillas among them, which are zero before and after a step.
    pub fn ancillas_of_sequence(&self) -> usize {
        self.scratch_qubits.max(self.block_qubits.saturating_sub(1))
    }

    /// Toffoli gates of a reflection about the zeros of the block's qubits, controlled or not.
    pub fn toffoli_of_reflection(&self) -> usize {
        2 * self.block_qubits.saturating_sub(1)
    }
}

/// T gates of a Toffoli gate without measurement.
pub const T_OF_TOFFOLI: usize = 7;

/// Numbers of gates and qubits of a circuit.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize)]
pub struct GateCounts {
    /// Qubits of the state that the operator acts on.
    pub system_qubits: usize,
    /// Qubits of the block, which are zero before. The encoded block is where they are zero after.
    pub block_qubits: usize,
    /// Scratch qubits, which are zero before and after.
    pub scratch_qubits: usize,
    /// Number of all qubits.
    pub qubits: usize,
    /// Number of all gates.
    pub gates: usize,
    /// Number of `ccx`.
    pub toffoli: usize,
    /// Number of `t` and `tdg`.
    pub t: usize,
    /// T gates with [`T_OF_TOFFOLI`] for each `ccx`, without the T gates of rotations.
    pub t_with_toffoli: usize,
    /// Number of `ry` and `rz`; a `cp` counts as three.
    pub rotations: usize,
    /// Number of `cx` and `cz`; a `cp` counts as two, a `swap` as three.
    pub cnot: usize,
    /// Number of `h`.
    pub hadamard: usize,
    /// Number of layers, with each gate as early as its qubits allow.
    pub depth: usize,
    /// Number of layers of `ccx`.
    pub toffoli_depth: usize,
}
