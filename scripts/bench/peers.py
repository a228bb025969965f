"""Times other programs on the modes of example 1, beside phasewarp and in the same rounds.

Usage: peers.py PROGRAM OUTPUT.json [--quick] [--cells N] [--tolerance T] [--rounds R]

Every peer gets the modes that phasewarp planned and the accuracy that each mode needs. All of them
solve the whole grid: phasewarp leaves out no velocities here. A peer must reproduce the modes:
w_l(T) is compared mode by mode, and where a peer runs all modes, its field is compared with
exp(AT) f0 and with phasewarp's field. Slow peers are timed on a sample of modes, evenly spread, and
scaled; OUTPUT names the number of modes. Each peer is timed in one process and in two that share
the modes, like phasewarp's two ranks. Matrices, workers and imports are ready before a clock
starts; phasewarp's wall time includes all of that.
"""

import argparse
import importlib.metadata
import json
import os
import shutil
import subprocess
import sys
import tempfile
import time
import types

# One thread a process: the vectors are short, and two processes share the cores.
for name in ("OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS", "OMP_NUM_THREADS"):
    os.environ.setdefault(name, "1")

try:
    import h5py
    import numpy as np
    import scipy
    import scipy.sparse.linalg as spla
except ImportError as error:
    sys.exit(f"peers: {error}")

import multiprocessing

import chebyshev
from example1 import Modes
from report import busy_cores

HERE = os.path.dirname(os.path.abspath(__file__))
ROOT = os.path.dirname(os.path.dirname(HERE))
# The peers' matrix has every velocity, so phasewarp's is to have every velocity too.
WHOLE_GRID = "solver.reduce={axes=false,velocities=false}"


def note(text):
    print(text, flush=True)


def relative(a, b):
    return float(np.linalg.norm(a - b) / np.linalg.norm(b))


# --- the peers: each yields l, w_l(T) -------------------------------------------------------------


def scipy_expm(modes, chosen):
    """SciPy's expm_multiply: truncated Taylor series, always to double precision."""
    for l in chosen:
        yield l, spla.expm_multiply(-1j * modes.time * modes.hamiltonian(l), modes.start)


def quspin(modes, chosen):
    """The same algorithm in C++ with threads."""
    from parallel_sparse_tools.expm_multiply_parallel_core import ExpmMultiplyParallel

    for l in chosen:
        work = ExpmMultiplyParallel(modes.hamiltonian(l), a=-1j * modes.time)
        yield l, work.dot(modes.start.astype(complex))


# --- running them ---------------------------------------------------------------------------------


def solve(modes, method, chosen, keep):
    """Σ weight_l w_l over the modes chosen, and those asked for."""
    total = np.zeros(len(modes.start), dtype=complex)
    kept = {}
    for l, w in method(modes, chosen):
        total += modes.weight[l] * w
        if l in keep:
            kept[l] = np.array(w)
    return total, kept


def work(modes, method, threads, keep, pipe):
    """A worker: waits for lists of modes, answers with their sum."""
    os.environ["OMP_NUM_THREADS"] = str(
        threads)  # read once, when the first library that uses it is loaded
    while (chosen := pipe.recv()) is not None:
        try:
            pipe.send(solve(modes, method, chosen, keep))
        except Exception as error:  # reported to the parent, which ends with it
            pipe.send(f"{type(error).__name__}: {error}")


class Workers:
    """Processes that share the modes: one, or two with every second mode each."""
    def __init__(self, modes, method, processes, threads, chosen, keep):
        self.parts = [chosen[k::processes] for k in range(processes)]
        self.pipes, self.processes = [], []
        context = multiprocessing.get_context("fork")
        for _ in self.parts:
            ours, theirs = context.Pipe()
            process = context.Process(target=work,
                                      args=(modes, method, threads, keep, theirs),
                                      daemon=True)
            process.start()
            self.pipes.append(ours)
            self.processes.append(process)

    def run(self):
        """Seconds, the sum, the modes kept."""
        begin = time.perf_counter()
        for pipe, part in zip(self.pipes, self.parts):
            pipe.send(part)
        answers = [pipe.recv() for pipe in self.pipes]
        for answer in answers:
            if isinstance(answer, str):
                raise RuntimeError(answer)
        total = sum(total for total, _ in answers)
        seconds = time.perf_counter() - begin
        kept = {}
        for _, found in answers:
            kept |= found
        return seconds, total, kept

    def close(self):
        for pipe, process in zip(self.pipes, self.processes):
            pipe.send(None)
            process.join()


class Slepc:
    """SLEPc's MFN in processes of the interpreter it is installed for."""
    def __init__(self, modes, python, method, processes, chosen, keep, place):
        self.keep, self.place = keep, place
        self.parts = [chosen[k::processes] for k in range(processes)]
        pattern = (abs(modes.S) + abs(modes.K)).tocsr()
        pattern.sort_indices()
        rows = np.repeat(np.arange(pattern.shape[0]), np.diff(pattern.indptr))
        entries = lambda M: np.asarray(M[rows, pattern.indices]).ravel()
        common = dict(
            indptr=pattern.indptr,
            indices=pattern.indices,
            S=entries(modes.S),
            K=entries(modes.K),
            start=modes.start,
            time=modes.time,
        )
        self.processes = []
        for number, part in enumerate(self.parts):
            path = os.path.join(place, f"{method}{processes}{number}.npz")
            np.savez(path, mu=modes.mu[part], tolerance=modes.tolerance[part], **common)
            self.processes.append(self.start(python, method, path))

    def start(self, python, method, path):
        def fresh():
            process = subprocess.Popen(
                [python, os.path.join(HERE, "slepc_mfn.py"), method, path],
                stdin=subprocess.PIPE,
                stdout=subprocess.PIPE,
                text=True,
            )
            if process.stdout.readline().strip() != "ready":
                raise RuntimeError(f"SLEPc {method} did not start")
            return process

        return [fresh, fresh()]

    def run(self):
        begin = time.perf_counter()
        targets = []
        for number, (_, process) in enumerate(self.processes):
            targets.append(os.path.join(self.place, f"slepc{number}.npy"))
            process.stdin.write(targets[-1] + "\n")
            process.stdin.flush()
        seconds = []
        for _, process in self.processes:
            line = process.stdout.readline()
            if process.wait() != 0 or not line:
                raise RuntimeError("SLEPc failed")
            seconds.append(float(line))
        kept = {}
        for part, target in zip(self.parts, targets):
            kept |= {l: w for l, w in zip(part, np.load(target)) if l in self.keep}
        # A process solves once: others for the next round, before its clock starts.
        self.processes = [[fresh, fresh()] for fresh, _ in self.processes]
        return max(seconds), None, kept

    def close(self):
        for _, process in self.processes:
            process.kill()
            process.wait()


def slepc_python():
    """An interpreter that has SLEPc for complex numbers, and its version; or why there is none."""
    said = "not looked for"
    for python in dict.fromkeys(
            filter(None, [os.environ.get("SLEPC_PYTHON"), "/usr/bin/python3", sys.executable])):
        if not shutil.which(python):
            continue
        found = subprocess.run([python, os.path.join(HERE, "slepc_mfn.py"), "--version"],
                               capture_output=True,
                               text=True)
        if found.returncode == 0:
            return python, found.stdout.strip()
        said = found.stderr.strip().splitlines()[-1] if found.stderr.strip(
        ) else f"exit code {found.returncode}"
    return None, said


# --- phasewarp ------------------------------------------------------------------------------------


def phasewarp(program, place, cells, tolerance, ranks, more=()):
    """Wall seconds of the whole job, its summary, its directory."""
    directory = os.path.join(place, "run")
    settings = [
        f"axis.0.x.cells={cells}", f"axis.0.v.cells={cells}", f"solver.tolerance={tolerance}",
        WHOLE_GRID, *more
    ]
    command = [
        "mpirun", "-np",
        str(ranks), program, "run",
        os.path.join(ROOT, "cases/example1.toml"), "-o", directory, "--force"
    ]
    for setting in settings:
        command += ["--set", setting]
    begin = time.perf_counter()
    found = subprocess.run(command, capture_output=True, text=True)
    wall = time.perf_counter() - begin
    if found.returncode != 0:
        sys.exit(f"peers: {' '.join(command)} failed:\n{found.stderr}")
    with open(os.path.join(directory, "summary.json")) as file:
        return wall, json.load(file), directory


def stored(directory):
    """The plan it ran with, and the field."""
    with h5py.File(os.path.join(directory, "result.h5")) as file:
        plan = file["plan"][()].decode().rstrip("\0")
        return json.loads(plan), file["f"][()].ravel()


def peak():
    """Multiply-adds a second of one core, nearly: those of a product of matrices."""
    n = 768
    matrix = np.full((n, n), 0.5)
    seconds = []
    for _ in range(10):
        begin = time.perf_counter()
        matrix @ matrix
        seconds.append(time.perf_counter() - begin)
    return n**3 / min(seconds)


def main():
    parser = argparse.ArgumentParser()
    parser.add_argument("program")
    parser.add_argument("output")
    parser.add_argument("--quick", action="store_true")
    parser.add_argument("--cells", type=int)
    parser.add_argument("--tolerance", default="1e-9")
    parser.add_argument("--rounds", type=int)
    options = parser.parse_args()
    cells = options.cells or (64 if options.quick else 128)
    rounds = options.rounds or (1 if options.quick else 5)
    tolerance = float(options.tolerance)

    with tempfile.TemporaryDirectory() as place:
        run(options, cells, rounds, tolerance, place)


def run(options, cells, rounds, tolerance, place):
    task = prepared(options, cells, tolerance, place)
    methods, versions, skipped = available(task)
    python, said = slepc_python()
    if python is None:
        skipped.append(f"SLEPc MFN: {said}")
    else:
        versions["SLEPc"] = said
    for line in skipped:
        note(f"peers: skipped {line}")
    peers = started(task, methods, python)
    mine, classical, summary = timed(task, peers, rounds)
    for peer in peers:
        peer.pop("workers").close()
        peer["modes"] = len(peer.pop("chosen"))
    modes = task.modes
    result = dict(
        quick=options.quick,
        cells=cells,
        tolerance=tolerance,
        modes=task.count,
        applications=summary["matvecs"],
        entries_a_row=(abs(modes.S) + abs(modes.K)).nnz / len(modes.start),
        peak=peak(),
        peer_applications=int(chebyshev.applications(modes, task.everything)),
        error=task.theirs,
        rounds=rounds,
        versions=versions,
        skipped=skipped,
        phasewarp=mine,
        classical=classical,
        peers=peers,
        commit=described(),
        load=busy_cores(),
    )
    os.makedirs(os.path.dirname(os.path.abspath(options.output)), exist_ok=True)
    with open(options.output, "w") as file:
        json.dump(result, file, indent=1)
        file.write("\n")
    note(options.output)


def prepared(options, cells, tolerance, place):
    """The modes of phasewarp's plan, and the references that all programs are compared with."""
    _, _, directory = phasewarp(options.program, place, cells, options.tolerance, 2)
    plan, field = stored(directory)
    modes = Modes(cells, plan)
    count = len(modes.mu)
    everything = list(range(count))
    exact = spla.expm_multiply(modes.time * modes.A, modes.f0)

    # The assembly is right if exp(AT) f0 is what phasewarp computes to its tolerance.
    theirs = relative(field, exact)
    note(f"example 1, {cells} x {cells}, tolerance {options.tolerance}: {count} modes; "
         f"phasewarp's distance to exp(AT) f0: {theirs:.1e}")
    if not theirs <= tolerance:
        sys.exit(f"peers: phasewarp is {theirs:e} from exp(AT) f0 of the assembly in example1.py, "
                 f"tolerance {tolerance:e}")

    # References for single modes, to round-off.
    step = max(1, count // 8)
    checked = everything[step // 2::step]
    reference = dict(scipy_expm(modes, checked))

    # About a dozen for those that take long, evenly spread, about their middle.
    stride = max(1, count // (4 if options.quick else 12))
    sample = everything[stride // 2::stride]
    return types.SimpleNamespace(
        options=options,
        cells=cells,
        tolerance=tolerance,
        place=place,
        field=field,
        modes=modes,
        count=count,
        everything=everything,
        exact=exact,
        theirs=theirs,
        checked=checked,
        reference=reference,
        sample=sample,
    )


def available(task):
    """The methods of Python, the versions of programs, and what is not installed."""
    methods = []  # name, how, processes, threads, modes
    for processes in (1, 2):
        for name, method in [
            ("NumPy Chebyshev, as written down", chebyshev.plain),
            ("NumPy Chebyshev, in place", chebyshev.in_place),
            ("NumPy Chebyshev, 8 modes at once", chebyshev.batched),
        ]:
            methods.append((name, method, processes, 1, task.everything))
        methods.append(("SciPy expm_multiply", scipy_expm, processes, 1, task.sample))
    skipped = []
    versions = {
        "Python": sys.version.split()[0], "NumPy": np.__version__, "SciPy": scipy.__version__
    }
    try:
        # Not imported here: it reads the number of threads then, and each worker has its own.
        versions["parallel-sparse-tools"] = importlib.metadata.version("parallel-sparse-tools")
        methods.append(("parallel-sparse-tools", quspin, 1, 2, task.sample))
        methods.append(("parallel-sparse-tools", quspin, 2, 1, task.sample))
    except importlib.metadata.PackageNotFoundError:
        skipped.append("parallel-sparse-tools: not installed")
    return methods, versions, skipped


def started(task, methods, python):
    """The peers with their workers: `methods`, and SLEPc if there is a `python` for it."""
    modes, sample = task.modes, task.sample
    peers = []
    for name, method, processes, threads, chosen in methods:
        workers = Workers(modes, method, processes, threads, chosen, set(task.checked))
        peers.append(
            dict(name=name,
                 processes=processes,
                 threads=threads,
                 chosen=chosen,
                 workers=workers,
                 seconds=[]))
    if python is not None:
        for kind in ("krylov", "expokit"):
            for processes in (1, 2):
                workers = Slepc(modes, python, kind, processes, sample, set(task.checked),
                                task.place)
                peers.append(
                    dict(name=f"SLEPc MFN {kind}",
                         processes=processes,
                         threads=1,
                         chosen=sample,
                         workers=workers,
                         seconds=[]))
    return peers


def timed(task, peers, rounds):
    """Times phasewarp, the classical exponential and the `peers` in turn.

    Returns phasewarp's seconds, those of the classical exponential, and a summary of phasewarp.
    """
    options, modes = task.options, task.modes
    mine = {
        key: []
        for key in ("wall2", "solve2", "wall1", "solve1", "classical_wall1", "classical_solve1")
    }
    classical = []
    for number in range(rounds):
        for ranks in (2, 1):
            wall, summary, _ = phasewarp(options.program, task.place, task.cells,
                                         options.tolerance, ranks)
            mine[f"wall{ranks}"].append(wall)
            mine[f"solve{ranks}"].append(summary["solve_seconds"])
        wall, direct, _ = phasewarp(options.program, task.place, task.cells, options.tolerance, 1,
                                    ["solver.method=classical"])
        mine["classical_wall1"].append(wall)
        mine["classical_solve1"].append(direct["solve_seconds"])
        begin = time.perf_counter()
        spla.expm_multiply(modes.time * modes.A, modes.f0)
        classical.append(time.perf_counter() - begin)
        for peer in peers:
            # Those that take long, in the first three rounds only.
            if number < 3 or len(peer["chosen"]) == task.count:
                time_peer(task, peer, number)
    return mine, classical, summary


def time_peer(task, peer, number):
    """Runs a peer in round `number`, and checks its modes and, if it has all, its field."""
    part = len(peer["chosen"]) / task.count
    modes, reference, tolerance = task.modes, task.reference, task.tolerance
    seconds, total, kept = peer["workers"].run()
    peer["seconds"].append(seconds / part)
    errors = [
        relative(w, reference[l]) / max(modes.tolerance[l], 1e-12) for l, w in kept.items()
        if l in reference
    ]
    peer["mode_error"] = max(errors, default=None)
    if errors and not max(errors) <= 1.5:
        sys.exit(f"peers: {peer['name']}: a mode is {max(errors):.1f} times its tolerance off")
    if part == 1:
        peer["field_error"] = relative(modes.recovered(total), task.exact)
        peer["field_difference"] = relative(modes.recovered(total), task.field)
        if not max(peer["field_error"], peer["field_difference"] / 2) <= tolerance:
            off = peer["field_error"]
            sys.exit(f"peers: {peer['name']}: the field is {off:e} off, tolerance {tolerance:e}")
    if number == 0:
        how = f"{peer['processes']} x {peer['threads']}"
        note(f"  {peer['name']}, {how}: {seconds / part:.3f} s")


def described():
    found = subprocess.run(["git", "describe", "--always", "--dirty"],
                           cwd=ROOT,
                           capture_output=True,
                           text=True)
    return found.stdout.strip() or "unknown"


if __name__ == "__main__":
    main()
