//! Blocks beside the scheme's own rows; particles; inverses.

use super::*;

/// Compares all columns of the block with `H/α`; the number of columns.
fn check_block(grid: &JumpGrid, modes: CircuitModes, levels: Levels) -> usize {
    let transport = grid.transport();
    let alpha = transport.alpha(modes, levels);
    let circuit = transport.encode(modes, levels, false);
    let wavenumbers = match modes {
        CircuitModes::One(mu) => vec![mu],
        CircuitModes::Register { qubits, period }
        | CircuitModes::Rotated { qubits, period, .. } => {
            let points = 1i32 << qubits;
            (0..points).map(|l| TAU * f64::from(l - points / 2) / period).collect()
        }
    };
    let points = wavenumbers.len();
    let states = grid.states();
    for (l, mu) in wavenumbers.into_iter().enumerate().filter(|(l, _)| modes.carries(*l)) {
        let h = grid.hamiltonian(mu);
        for &column in &states {
            let mut left = h.clone();
            left.retain(|place, _| place.1 == column);
            for (row, value) in block_column(&circuit, column * points + l) {
                assert_eq!(row % points, l);
                let entry = left.remove(&(row / points, column)).unwrap_or_default();
                let apart = (alpha * value - entry).norm();
                assert!(apart < 1e-12, "{modes:?} {row} {column}: {value} {entry}");
            }
            assert!(left.values().all(|entry| entry.norm() < 1e-12), "{left:?}");
        }
    }
    states.len() * points
}

#[test]
fn blocks_are_the_hamiltonian_of_the_scheme() {
    let register = CircuitModes::Register { qubits: 2, period: 7.3 };
    for grid in GRIDS {
        let highest = TAU / 7.3;
        let rotated = CircuitModes::Rotated { qubits: 2, period: 7.3, highest };
        let all = CircuitModes::Rotated { qubits: 2, period: 7.3, highest: 2.0 * highest };
        for modes in [
            register,
            rotated,
            all,
            CircuitModes::One(3.7),
            CircuitModes::One(-0.4),
            CircuitModes::One(0.0),
        ] {
            for levels in [Levels::Hadamard, Levels::Uniform] {
                check_block(grid, modes, levels);
            }
        }
    }
}

/// The qubits of a register; none if the circuit has no such register.
fn qubits_of(circuit: &Circuit, name: &str) -> Vec<usize> {
    let found = circuit.registers.iter().find(|register| register.name == name);
    found.map_or(Vec::new(), |r| (r.first..r.first + r.size).collect())
}

/// `value` in these qubits.
fn set(qubits: &[usize], value: u128) -> u128 {
    assert!(value >> qubits.len() == 0, "{value} in {} bits", qubits.len());
    qubits.iter().enumerate().map(|(bit, &q)| (value >> bit & 1) << q).sum()
}

/// Grids of states of up to 20 bits.
const LARGE_GRIDS: [JumpGrid; 2] = [
    JumpGrid {
        cells: 64,
        periodic: true,
        speeds: 64,
        bin_bits: 1,
        jumps: &[(7, 900.5), (63, -8.0), (8, -0.5)],
    },
    JumpGrid {
        cells: 25,
        periodic: false,
        speeds: 100,
        bin_bits: 0,
        jumps: &[(3, 77.0), (4, -9000.0), (20, 10000.0)],
    },
];

/// Between preparations, every state moves as a classical particle.
#[test]
fn particles_move_one_to_one() {
    for grid in GRIDS.iter().chain(&LARGE_GRIDS) {
        let transport = grid.transport();
        let circuit = transport.encode(CircuitModes::One(1.0), Levels::Hadamard, false);
        let place = |what: &str| {
            let found = circuit.comments.iter().find(|comment| comment.1.starts_with(what));
            found.unwrap_or_else(|| panic!("{what}")).0
        };
        // Without the gate that reverses time.
        let moves = &circuit.gates[place("to the face")..place("energy to speed") - 1];
        let [space, velocity, level, bins, above, end, outside, moved] =
            ["space", "velocity", "level", "bins", "above", "boundary", "outside", "moved"]
                .map(|name| qubits_of(&circuit, name));
        let low = velocity.len() - 1;
        let levels = [&bins[..], &[&level[..], &velocity[..low]].concat()[..2 * low]].concat();
        let bin = 1i64 << grid.bin_bits;
        let most = (grid.speeds * grid.speeds) as i64 * bin;
        let cells = grid.cells as i64;
        assert!(space.len() + 1 + levels.len() <= 20);
        let state = |x: i64, up: bool, e: i64| {
            set(&space, x as u128)
                | set(&velocity[low..], u128::from(up))
                | set(&levels, e as u128)
                | set(&moved, 1)
        };
        let particles: Vec<(i64, bool, i64)> = (0..cells)
            .flat_map(|x| [false, true].map(|up| (x, up)))
            .flat_map(|(x, up)| (0..most).map(move |e| (x, up, e)))
            .collect();
        let starts = || particles.iter().map(|&(x, up, e)| state(x, up, e));
        for (&(x, up, e), after) in particles.iter().zip(images(moves, starts())) {
            // The face ahead, and where it leads.
            let to = if up { x + 1 } else { x - 1 };
            let to = if grid.periodic { to.rem_euclid(cells) } else { to };
            let face = if up { x } else { to };
            let jump = transport.axes[0].jumps.iter().find(|jump| jump.below as i64 == face);
            let rise = jump.map_or(0, |jump| if up { jump.levels } else { -jump.levels });
            let leaves = !grid.periodic && !(0..cells).contains(&to);
            let flag = |qubits: &[usize]| qubits.iter().any(|&q| after >> q & 1 == 1);
            if leaves {
                assert!(flag(&end), "{x} {up} {e}: not at the end");
            } else if e < rise {
                assert_eq!(after, state(x, !up, e), "{x} {up} {e}: not reflected");
            } else if e - rise >= most {
                assert!(flag(&above) || flag(&outside), "{x} {up} {e}: not too fast");
            } else {
                assert_eq!(after, state(to, up, e - rise), "{x} {up} {e}");
            }
        }
        // An operator that is not selected has no effect.
        let resting = || starts().map(|start| start ^ set(&moved, 1));
        assert!(images(moves, resting()).into_iter().eq(resting()));
    }
}

/// Applied twice it is the identity on its initial states; under control it is applied zero times
/// or once.
#[test]
fn circuits_are_their_own_inverses() {
    for grid in GRIDS {
        let rotated = CircuitModes::Rotated { qubits: 1, period: 2.0, highest: 3.2 };
        for modes in
            [CircuitModes::One(0.8), CircuitModes::Register { qubits: 1, period: 2.0 }, rotated]
        {
            let encode = |controlled| grid.transport().encode(modes, Levels::Uniform, controlled);
            let (circuit, controlled) = (encode(false), encode(true));
            let points = if matches!(modes, CircuitModes::One(_)) { 1 } else { 2 };
            let on = qubits_of(&controlled, "control")[0];
            for state in grid.states().iter().flat_map(|s| (0..points).map(move |l| s * points + l))
            {
                let near = |found: SparseState, expected: u128| {
                    let amplitude = found.terms.iter().find(|term| term.0 == expected);
                    let apart = amplitude.map_or(1.0, |term| (term.1 - 1.0).norm());
                    assert!(apart < 1e-12, "{state}: {apart}");
                };
                let start = state as u128;
                let once = SparseState::basis(start).after(&circuit.gates);
                near(once.after(&circuit.gates), start);
                near(SparseState::basis(start).after(&controlled.gates), start);
                let with = start | 1 << on;
                let block = block_column(&controlled, with as usize);
                let own = block_column(&circuit, state);
                assert_eq!(block.len(), own.len());
                for (number, value) in block {
                    let own = own.iter().find(|term| term.0 | 1 << on == number);
                    assert!((own.expect("the same rows").1 - value).norm() < 1e-13);
                }
            }
        }
    }
}

/// A system of 11 qubits: 16 modes, 8 velocities, 16 cells; all of its 2048 columns.
#[test]
fn a_block_on_eleven_qubits() {
    let jumps: &[_] = &[(3, 9.0), (7, -25.0), (15, 16.0)];
    let grid = JumpGrid { cells: 16, periodic: true, speeds: 4, bin_bits: 0, jumps };
    let modes = CircuitModes::Register { qubits: 4, period: 5.5 };
    assert_eq!(check_block(&grid, modes, Levels::Hadamard), 2048);
}

/// Without jumps on a long box, α of the fewest levels is the norm of `H`, nearly.
#[test]
fn alpha_is_the_norm() {
    let grid = JumpGrid { cells: 64, periodic: false, speeds: 2, bin_bits: 0, jumps: &[] };
    let mu = 2.5;
    let h = grid.hamiltonian(mu);
    let (mut x, mut norm) = (HashMap::new(), 0.0);
    // Long waves of the fastest particles are the extreme ones, with the sign of T's phase.
    let phase = Complex64::new(mu, 1.0).arg();
    for cell in 0..64usize {
        let place = grid.transport().state(&[cell, 3]);
        x.insert(place, Complex64::cis((std::f64::consts::PI + phase) * cell as f64));
    }
    for _ in 0..400 {
        let mut y: HashMap<usize, Complex64> = HashMap::new();
        for ((i, j), value) in &h {
            *y.entry(*i).or_default() += value * x.get(j).copied().unwrap_or_default();
        }
        norm = y.values().map(Complex64::norm_sqr).sum::<f64>().sqrt();
        x = y.into_iter().map(|(i, y)| (i, y / norm)).collect();
    }
    let least = grid.transport().alpha(CircuitModes::One(mu), Levels::Uniform);
    assert!(norm < least * (1.0 + 1e-12) && norm > 0.995 * least, "{norm} {least}");
    // That of Hadamard gates is larger by one level of the fastest cell.
    let hadamard = grid.transport().alpha(CircuitModes::One(mu), Levels::Hadamard);
    assert!((hadamard / least - 4.0 / 3.0).abs() < 1e-14);
}
