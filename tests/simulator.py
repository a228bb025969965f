"""Runs what `phasewarp export-quantum` wrote in Qiskit, and compares amplitudes.

    python tests/simulator.py DIR [DIR...]
        what went wrong as an exception, otherwise one line a directory
    python tests/simulator.py --packages
        nothing, if every package is there

The circuit is the one of the paper: preparation, inverse transform of the p-register, exp(-iHT) as
a gate, transform. Then the p-register is found at the recovery point and the label at 0, and
overlaps are read by Hadamard tests, from what is left and from the whole state.

`complete.json`, where it is, is one circuit of all steps without that gate. It is run as it is, and
after every stage its amplitudes are compared within the bound that it states.
"""

import json
import pathlib
import sys

import numpy as np
import qiskit_qasm3_import  # noqa: F401  (what qasm3.loads needs)
import scipy.io
import scipy.linalg
from qiskit import QuantumCircuit, qasm3
from qiskit.circuit.library import UnitaryGate
from qiskit.quantum_info import Statevector

try:
    from qiskit_aer import AerSimulator
except ModuleNotFoundError:
    # Slower.
    AerSimulator = None

TOLERANCE = 1e-10
GATES = {"x", "h", "z", "s", "sdg", "t", "tdg", "ry", "rz", "cx", "cz", "cp", "swap", "ccx"}


def same(found, expected, what, by=TOLERANCE):
    found, expected = np.asarray(found), np.asarray(expected)
    assert found.shape == expected.shape, f"{what}: shape {found.shape}, {expected.shape} expected"
    worst = np.max(np.abs(found - expected))
    assert worst <= by, f"{what}: differs by {worst:.2e}, {by:.0e} allowed"
    return worst


def reflection(state):
    """A unitary whose first column is `state`, by a Householder reflection and a phase."""
    phase = state[0] / abs(state[0]) if state[0] != 0 else 1.0
    v = state / phase - np.eye(len(state))[0]
    if np.linalg.norm(v) < 1e-14:
        return phase * np.eye(len(state))
    v /= np.linalg.norm(v)
    return phase * (np.eye(len(state)) - 2.0 * np.outer(v, v.conj()))


def hadamard_test(first, second):
    """2 p_0 - 1 of (|0>|first> + |1>|second>)/sqrt(2), after a Hadamard gate on the ancilla."""
    qubits = int(np.log2(len(first)))
    circuit = QuantumCircuit(qubits + 1)
    system, ancilla = list(range(qubits)), qubits
    circuit.h(ancilla)
    for state, value in [(first, 0), (second, 1)]:
        gate = UnitaryGate(reflection(np.asarray(state, dtype=complex)))
        circuit.append(gate.control(1, ctrl_state=value, annotated=True), [ancilla, *system])
    circuit.h(ancilla)
    return 2.0 * Statevector(circuit).probabilities([ancilla])[0] - 1.0


def parts(complete):
    """The circuit of each stage of a complete circuit, by the name of the stage."""
    qubits = sum(register["size"] for register in complete["registers"])
    gates, stages = complete["gates"], complete["description"]["stages"]
    ends = [stage["first"] for stage in stages[1:]] + [len(gates)]
    circuits = {}
    for stage, end in zip(stages, ends):
        circuit = QuantumCircuit(qubits)
        for name, places, *angle in gates[stage["first"] : end]:
            assert name in GATES, name
            getattr(circuit, name)(*angle, *places)
        circuits[stage["name"]] = circuit
    return circuits


def states_after(circuits):
    """The state after each of these circuits, one after the other, from zeros."""
    if AerSimulator is None:
        state, after = Statevector.from_label("0" * next(iter(circuits.values())).num_qubits), {}
        for name, circuit in circuits.items():
            state = after[name] = state.evolve(circuit)
        return {name: state.data for name, state in after.items()}
    whole = QuantumCircuit(next(iter(circuits.values())).num_qubits)
    for name, circuit in circuits.items():
        whole.compose(circuit, inplace=True)
        whole.save_statevector(label=name)
    result = AerSimulator(method="statevector").run(whole).result()
    assert result.success, result.status
    return {name: np.asarray(result.data()[name]) for name in circuits}


def lines_of(complete):
    """The gates of a complete circuit as lines of OpenQASM 3."""
    names = [
        f"{register['name']}[{bit}]"
        for register in complete["registers"]
        for bit in range(register["size"])
    ]
    for name, places, *angle in complete["gates"]:
        yield name, angle, ", ".join(names[q] for q in places)


def same_program(folder, complete):
    """The program has the same gates, and Qiskit reads its beginning as the same circuit."""
    text = (folder / "complete.qasm").read_text()
    gates = [line for line in text.splitlines() if line.endswith("];") and line[:6] != "qubit["]
    expected = list(lines_of(complete))
    assert len(gates) == len(expected)
    for line, (name, angle, places) in zip(gates, expected):
        head, at = line[:-1].split(" ", 1)
        assert at == places and head.split("(")[0] == name, line
        assert [float(x) for x in head.split("(")[1:] and [head.split("(")[1][:-1]]] == angle, line
    head = text.split("// evolution")[0]
    circuits = parts(complete)
    start = circuits["start"].compose(circuits["modes"])
    assert qasm3.loads(head).count_ops() == start.count_ops()


def estimates(amplitude, qubits):
    """Probabilities of canonical amplitude estimation with so many qubits."""
    values = 2**qubits
    phase = np.arcsin(min(abs(amplitude), 1.0)) / np.pi
    both = 0.0
    for sign in [1.0, -1.0]:
        off = sign * phase - np.arange(values) / values
        waves = np.exp(2j * np.pi * np.outer(np.arange(values), off))
        both = both + 0.5 * np.abs(waves.sum(axis=0) / values) ** 2
    return both


def check_complete(folder, about, states, field):
    complete = json.loads((folder / "complete.json").read_text())
    described = complete["description"]
    qubits = sum(register["size"] for register in complete["registers"])
    assert qubits == described["counts"]["qubits"] <= 20 and described["bound"] < 0.05
    same_program(folder, complete)
    after = states_after(parts(complete))
    size, points = 2 ** about["qubits"], 2 ** about["qubits_p"]
    root = described["probability_start"] ** 0.5
    blocks = {name: state.reshape(-1, size)[0] / root for name, state in after.items()}
    bound = described["bound"]
    bounds = {"start": 0.0, "modes": 0.0, "evolution": bound, "points": bound}
    worst = 0.0
    for stage, name in [
        ("start", "initial"),
        ("modes", "initial_modes"),
        ("evolution", "final_modes"),
        ("points", "final"),
    ]:
        off = np.linalg.norm(blocks[stage] - states[name])
        assert off <= bounds[stage] + TOLERANCE, f"{stage}: {off:.2e}, bound {bounds[stage]:.2e}"
        worst = max(worst, off)
    # The field, after postselection.
    found = described["scale"] * blocks["points"][about["recovery_index"] :: points].real
    off = np.linalg.norm(found[: len(field)] - field)
    assert off <= described["field_bound"] * (1.0 + TOLERANCE), f"field: {off:.2e}"
    # A moment: the amplitude of zeros.
    amplitude = after["moment"][0] / root
    exact = complex(*described["amplitude"]) / root
    assert abs(amplitude - exact) <= described["bound"] + TOLERANCE, f"moment: {amplitude}, {exact}"
    density = described["moment_scale"] * amplitude.real
    number = 0
    for cell, bits in zip(described["cell"], about["qubits_phase_space"]):
        number = number * 2**bits + cell
    velocities = len(about["velocities"][0])
    expected = field[number * velocities :][:velocities].sum() * about["velocity_volume"]
    assert abs(density - expected) <= described["moment_bound"], f"density: {density}, {expected}"
    # Amplitude estimation of it: all probabilities.
    said = ""
    if described["estimate"] > 0:
        register = next(r for r in complete["registers"] if r["name"] == "estimate")
        place = range(register["first"], register["first"] + register["size"])
        probabilities = Statevector(after["estimation"]).probabilities(list(place))
        ideal = estimates(after["moment"][0], described["estimate"])
        same(probabilities, ideal, "amplitude estimation", 1e-9)
        # Control: another amplitude is noticed.
        other = estimates(1.1 * after["moment"][0], described["estimate"])
        assert np.max(np.abs(probabilities - other)) > 1e-6
        said = f", {len(ideal)} estimates"
    return (
        f"; complete circuit: {qubits} qubits, {described['steps']} steps, states within "
        f"{worst:.1e} of {bound:.1e}, field within {off:.1e} of {described['field_bound']:.1e}, "
        f"density {density:.6f}, {expected:.6f} expected{said}"
    )


def check(folder):
    about = json.loads((folder / "description.json").read_text())
    n_p, n = about["qubits_p"], about["qubits"]
    points, p = 2**n_p, list(range(n_p))
    states = {
        name: np.load(folder / f"{name}.npy")
        for name in ["initial", "initial_modes", "final_modes", "final"]
    }
    weights, field = np.load(folder / "weights.npy"), np.load(folder / "field.npy")
    worst = 0.0

    # H, and the unitary of the evolution: H does not couple modes, so mode by mode.
    hamiltonian = scipy.io.mmread(folder / "hamiltonian.mtx").tocsr()
    assert hamiltonian.shape == (2**n, 2**n) and abs(hamiltonian - hamiltonian.getH()).max() == 0.0
    evolution = np.zeros((2**n, 2**n), dtype=complex)
    for mode in range(points):
        block = np.arange(mode, 2**n, points)
        inside = hamiltonian[block][:, block]
        assert inside.nnz == hamiltonian[block].nnz, f"mode {mode} is coupled to others"
        evolution[np.ix_(block, block)] = scipy.linalg.expm(-1j * about["time"] * inside.toarray())

    # The circuit, in stages.
    transform = qasm3.loads((folder / "transform.qasm").read_text())
    assert transform.num_qubits == n_p
    if about["preparation"] is None:
        preparation = qasm3.loads((folder / "preparation.qasm").read_text())
        state = Statevector(preparation)
        worst = max(worst, same(state.data, states["initial"], "prepared state"))
    else:
        assert not (folder / "preparation.qasm").exists()
        state = Statevector(states["initial"])
    for gate, qubits, name in [
        (transform.inverse(), p, "initial_modes"),
        (UnitaryGate(evolution), list(range(n)), "final_modes"),
        (transform, p, "final"),
    ]:
        # One mode has no register of p.
        state = state.evolve(gate, qargs=qubits) if qubits else state
        worst = max(worst, same(state.data, states[name], name))

    # Postselection of p, then of the label.
    found = about["recovery_index"]
    in_p = state.probabilities(p)[found] if p else 1.0
    same(in_p, about["probability_p"], "probability of p", TOLERANCE * in_p**0.5)
    left = state.data.reshape(-1, points)[:, found] / in_p**0.5
    left = Statevector(left)
    in_block = left.probabilities([n - n_p - 1])[0] if about["qubits_label"] else 1.0
    same(
        in_block,
        about["probability_field_given_p"],
        "probability of the block",
        TOLERANCE / in_p**0.5,
    )
    block = left.data[: len(weights)] / in_block**0.5
    norm = np.exp(about["recovery"]) * about["norm_of_state"] * (in_p * in_block) ** 0.5
    # A slice of small probability has few digits of the amplitudes' 1e-10.
    digits = TOLERANCE / (in_p * in_block) ** 0.5
    size = np.max(np.abs(field))
    assert digits < 1e-3, f"{digits:.1e}"
    same((norm * block / weights).real / size, field / size, "f", 2.0 * digits * norm / size)

    # Hadamard tests of density and momenta at every cell.
    charges = [np.ones(len(about["velocities"][0])), *map(np.array, about["velocities"])]
    cells = len(weights) // len(charges[0])
    for q, overlaps in zip(charges, about["overlaps"]):
        if not q.any():
            # One velocity, which is 0: there is no momentum, and no state of it.
            assert overlaps == [None] * cells
            continue
        for cell in range(cells):
            chi = np.zeros(len(weights))
            here = slice(cell * len(q), (cell + 1) * len(q))
            chi[here] = q / weights[here]
            chi /= np.linalg.norm(chi)
            expected = overlaps[cell]
            same(hadamard_test(chi, block), expected, "overlap", 2.0 * digits)
    # The same from the whole state, at the last cell.
    zeta = np.zeros((2 ** (n - n_p), points))
    zeta[: len(weights), found] = chi
    direct = hadamard_test(zeta.reshape(-1), state.data)
    same(direct, (in_p * in_block) ** 0.5 * expected, "overlap of the enlarged state")
    # Control: the point next to it, or the cell, is another state.
    other = np.roll(zeta, 1, axis=1 if p else 0).reshape(-1)
    assert abs(hadamard_test(other, state.data) - direct) > 0.0
    said = f"{n} qubits, P = {in_p * in_block:.2e}, amplitudes within {worst:.1e}"
    if (folder / "complete.json").exists():
        said += check_complete(folder, about, states, field)
    return said


if sys.argv[1:] != ["--packages"]:
    for directory in sys.argv[1:]:
        print(f"{directory}: {check(pathlib.Path(directory))}")
