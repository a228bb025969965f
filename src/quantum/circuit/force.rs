//! Forces: shifts in velocity, with a coefficient by space cell.
//!
//! Along velocity axis `a` the scheme of degree 0 has `A^v = −d_max(D − T)`. A particle crosses
//! `d_i = −∂_a V(x_i)/Δv` velocity cells in a unit of time, and
//!
//! ```text
//! d_max = max_i |d_i|,   D = diag(|d_i|/d_max),   T = D S^{sgn d_i},
//! ```
//!
//! where `S` shifts velocities by one cell and loses what leaves the box. `D` depends on `x` only
//! and commutes with `S`. So `A^v` is a term of the same kind as a transport, and `T†` has the
//! opposite shift. The sum of `H` chooses this term with weight `d_max`.
//!
//! **Coefficient.** `⟨0|R Z R†|0⟩ = cos θ` for `R = ry(θ)`; `θ_i = arccos(|d_i|/d_max)` is
//! loaded by a uniformly controlled rotation of the bits of space on which it depends. There are
//! none if `|d_i|` is constant. `Z` acts where this term is chosen, so that the rotations need no
//! control, and `R Z R†` is its own inverse.

use crate::quantum::circuit::arithmetic::Literal;
use crate::quantum::circuit::gates::{Circuit, Gate, Qubit};
use crate::quantum::circuit::interface::at;
use crate::quantum::circuit::transport::Force;
use crate::quantum::circuit::wires::{AxisRegisters, Wires};

impl Force {
    /// Appends the term of this force, where it is chosen: `T` or `T†` where `moving` holds, else
    /// `D`.
    pub(super) fn apply(
        &self,
        c: &mut Circuit,
        wires: &Wires,
        along: &AxisRegisters,
        chosen: &[Literal],
        moving: Literal,
    ) {
        let chosen = wires.given(chosen);
        if let Some(flag) = wires.weaker.filter(|_| self.shares.iter().any(|&share| share < 1.0)) {
            c.comment("the strength of the force at this cell");
            let controls: Vec<Qubit> = self.bits.iter().map(|&bit| wires.space[bit]).collect();
            let angles: Vec<f64> = self.shares.iter().map(|share| -share.acos()).collect();
            c.within(
                |c| c.rotate(Gate::Ry, &controls, flag, &angles),
                |c| c.where_all(&chosen, |c, all| c.push(Gate::Cz(all, flag))),
            );
        }
        c.comment("shift the velocity by one cell");
        let moved: Vec<Literal> = std::iter::once(moving).chain(chosen).collect();
        c.where_all(&moved, |c, moved| self.shift(c, wires, along, moved));
    }

    /// Shifts the velocity up or down by one cell where `moved` holds. A shift down is a shift up
    /// of the complement.
    fn shift(&self, c: &mut Circuit, wires: &Wires, along: &AxisRegisters, moved: Qubit) {
        let v = &along.velocity;
        let half = 1usize << (v.len() - 1);
        let down = c.take(1)[0];
        let direction = |c: &mut Circuit| {
            c.push(Gate::Cx(wires.reversed, down));
            for part in &self.down {
                let literals: Vec<Literal> =
                    part.iter().map(|&(bit, value)| (wires.space[bit], value)).collect();
                c.flip_where(&literals, down);
            }
            c.flip_if(down, v);
        };
        c.within(direction, |c| {
            // The last cell of the box; and the place from which the inverse comes back to its
            // first one.
            let mut ends = vec![half + along.speeds - 1];
            ends.extend((along.speeds != half).then(|| half - along.speeds - 1));
            if let Some(end) = wires.end_of_velocity {
                ends.iter().for_each(|&place| c.flip_where(&at(moved, v, place), end));
            }
            c.add_bit(moved, v);
        });
        c.give_back(&[down]);
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::quantum::circuit::simulate::{SparseState, block_column};
    use crate::quantum::circuit::transport::{
        AxisTransport, CaseTransport, CircuitModes, Levels, bits_of,
    };
    use num_complex::Complex64;
    use std::collections::HashMap;

    /// A ring of cells in space without jumps, and `d` of each.
    struct Ring {
        speeds: usize,
        d: &'static [f64],
    }

    const RINGS: &[Ring] = &[
        Ring { speeds: 4, d: &[0.7, 0.7, 0.7, 0.7] },
        Ring { speeds: 2, d: &[-0.3, -0.3, 0.0, 0.0] },
        Ring { speeds: 3, d: &[0.5, -1.5, -0.5, 1.5] },
        Ring { speeds: 1, d: &[0.25, 0.0, -2.0] },
        Ring { speeds: 5, d: &[1.0, 2.0, 3.0, -3.0, -2.0, -1.0] },
        Ring { speeds: 3, d: &[0.0, 0.0, 0.0, -4.0, 0.0, 0.0, 0.0, 0.0] },
        // Equal but for round-off.
        Ring { speeds: 2, d: &[0.3, 0.3 + 5e-16, 0.1 * 3.0, -0.3] },
    ];
    const RATE: f64 = 0.25;

    impl Ring {
        /// The transport of the ring. Sets of cells are not merged into boxes: each cell is a set
        /// of its own.
        fn transport(&self) -> CaseTransport {
            let cells = self.d.len();
            let bits = bits_of(cells);
            let speeds: Vec<_> = (0..1 << bits).map(|i| self.d.get(i).copied()).collect();
            let one = |place: &usize| (0..bits).map(|bit| (bit, place >> bit & 1 == 1)).collect();
            let force =
                Force::new("ring", 0, &speeds, |wanted, _| wanted.iter().map(one).collect());
            let axis = AxisTransport {
                cells,
                periodic: true,
                speeds: self.speeds,
                jumps: Vec::new(),
                rate: RATE,
            };
            let forces = force.expect("a small table").into_iter().collect();
            CaseTransport { axes: vec![axis], forces, bin_bits: 0 }
        }

        /// `A`, by cells.
        fn entries(&self) -> Vec<([usize; 2], [usize; 2], f64)> {
            let (cells, velocities) = (self.d.len(), 2 * self.speeds);
            let mut found = Vec::new();
            for x in 0..cells {
                for v in 0..velocities {
                    let speed = (2 * v + 1) as f64 - velocities as f64;
                    let behind = if speed > 0.0 { x + cells - 1 } else { x + 1 } % cells;
                    let rate = RATE * speed.abs();
                    found.push(([x, v], [behind, v], rate));
                    found.push(([x, v], [x, v], -rate - self.d[x].abs()));
                    let source = if self.d[x] > 0.0 { v.checked_sub(1) } else { Some(v + 1) };
                    if let Some(source) = source.filter(|&w| w < velocities) {
                        found.push(([x, v], [x, source], self.d[x].abs()));
                    }
                }
            }
            found
        }
    }

    /// All columns of the block are those of `H/α`; twice is nothing.
    #[test]
    fn forces_are_blocks() {
        for (ring, mu) in RINGS.iter().flat_map(|r| [0.0, 2.3, -0.6].map(|mu| (r, mu))) {
            let transport = ring.transport();
            let mut h: HashMap<(usize, usize), Complex64> = HashMap::new();
            for (row, column, a) in ring.entries() {
                let [i, j] = [row, column].map(|cell| transport.state(&cell));
                *h.entry((i, j)).or_default() += 0.5 * a * Complex64::new(mu, 1.0);
                *h.entry((j, i)).or_default() += 0.5 * a * Complex64::new(mu, -1.0);
            }
            for levels in [Levels::Hadamard, Levels::Uniform] {
                let modes = CircuitModes::One(mu);
                let alpha = transport.alpha(modes, levels);
                let circuit = transport.encode(modes, levels, false);
                let all = (0..ring.d.len()).flat_map(|x| (0..2 * ring.speeds).map(move |v| [x, v]));
                for column in all.map(|cell| transport.state(&cell)) {
                    let mut left = h.clone();
                    left.retain(|place, _| place.1 == column);
                    for (row, value) in block_column(&circuit, column) {
                        let entry = left.remove(&(row, column)).unwrap_or_default();
                        assert!((alpha * value - entry).norm() < 1e-12, "{row} {column}");
                    }
                    assert!(left.values().all(|entry| entry.norm() < 1e-12), "{left:?}");
                    let start = SparseState::basis(column as u128);
                    let twice = start.after(&circuit.gates).after(&circuit.gates);
                    let same = twice.terms.iter().find(|term| term.0 == column as u128);
                    assert!(same.is_some_and(|term| (term.1 - 1.0).norm() < 1e-12));
                }
            }
        }
    }

    /// `α` is `v_max/Δx + d_max`, times the weights of the mode; a table has only the bits that it
    /// needs.
    #[test]
    fn normalisation_and_tables() {
        for (ring, bits) in RINGS.iter().zip([0, 1, 1, 2, 3, 3, 0]) {
            let transport = ring.transport();
            let largest = ring.d.iter().fold(0.0f64, |m, d| m.max(d.abs()));
            let rate = RATE * (2 * ring.speeds - 1) as f64 + largest;
            let alpha = transport.alpha(CircuitModes::One(0.0), Levels::Uniform);
            assert!((alpha - rate).abs() < 1e-14);
            assert_eq!(transport.forces[0].bits.len(), bits, "{:?}", ring.d);
        }
    }
}
