"""Times an independent discontinuous Galerkin program, NGSolve, beside phasewarp.

Usage: galerkin.py PROGRAM [--rounds R]

Needs NGSolve (`pip install ngsolve`). Prints the table of docs/performance.md. The case is one that
NGSolve can express and whose exact solution is a formula: a Gaussian beam in a constant force,

    f_t + v f_x - V'(x) f_v = 0,    V = x/2,    T = 1,
    f0 = exp(-((x + 0.5)^2 + (v - 0.6)^2)/0.02),

on [-1.5, 1.5] x [-1.5, 1.5]. Both programs take elements of the same degree on a square grid, with
upwind fluxes, and the least even number of elements that reaches the error. NGSolve integrates by
the classical Runge-Kutta method of order 4, in the largest step (to 5 %) that does not add a tenth
to the error. Its matrix-free operator and its assembled matrix are both timed, on two threads;
phasewarp runs on two ranks. Clocks start when meshes, operators and matrices are there.
"""

import argparse
import json
import math
import os
import statistics
import subprocess
import sys
import tempfile
import time

try:
    import ngsolve as ng
    from ngsolve.meshes import MakeStructured2DMesh
except ImportError as error:
    sys.exit(f"galerkin: {error}; pip install ngsolve")

TIME = 1.0
FORCE = -0.5
HALF = 1.5
CASE = f"""
title = "Beam in a constant force"
potential = [{{ value = "x/2" }}]
[[axis]]
x = {{ lower = -{HALF}, upper = {HALF}, cells = 20 }}
v = {{ lower = -{HALF}, upper = {HALF}, cells = 20 }}
[scheme]
flux = 1.0
[initial]
f = "exp(-((x + 0.5)^2 + (v - 0.6)^2)/0.02)"
[time]
end = {TIME}
[exact]
kind = "characteristics"
"""


def beam(time):
    """f at `time`, by the particles' places before."""
    x = ng.x - ng.y * time + 0.5 * FORCE * time**2
    v = ng.y - FORCE * time
    return ng.exp(-((x + 0.5) ** 2 + (v - 0.6) ** 2) / 0.02)


class Galerkin:
    """NGSolve's elements of `degree`, so many an axis."""

    def __init__(self, degree, elements, assembled):
        place = lambda s, t: (HALF * (2 * s - 1), HALF * (2 * t - 1))
        mesh = MakeStructured2DMesh(quads=True, nx=elements, ny=elements, mapping=place)
        space = ng.L2(mesh, order=degree, all_dofs_together=True, dgjumps=assembled)
        wind = ng.CoefficientFunction((ng.y, FORCE))
        u, w = space.TnT()
        normal = wind * ng.specialcf.normal(2)
        upwind = ng.IfPos(normal, u, u.Other(bnd=0))
        form = ng.BilinearForm(space, nonassemble=not assembled)
        form += u * wind * ng.grad(w) * ng.dx
        form += -normal * upwind * w * ng.dx(element_boundary=True)
        if assembled:
            form.Assemble()
        self.mesh = mesh
        self.field = ng.GridFunction(space)
        self.rate = space.Mass(1).Inverse() @ form.mat
        self.stages = [self.field.vec.CreateVector() for _ in range(4)]
        self.sum = self.field.vec.CreateVector()

    def run(self, steps):
        """Seconds of so many steps of RK4 from f0."""
        self.field.Set(beam(0.0), bonus_intorder=6)
        f, stages, point, dt = self.field.vec, self.stages, self.sum, TIME / steps
        start = time.perf_counter()
        for _ in range(steps):
            stages[0].data = self.rate * f
            for k, part in ((1, 0.5), (2, 0.5), (3, 1.0)):
                point.data = f + part * dt * stages[k - 1]
                stages[k].data = self.rate * point
            f.data += dt / 6 * stages[0] + dt / 3 * stages[1]
            f.data += dt / 3 * stages[2] + dt / 6 * stages[3]
        return time.perf_counter() - start

    def error(self):
        """Relative L2 distance to the exact solution."""
        exact = beam(TIME)
        integral = lambda f: ng.Integrate(f * f, self.mesh, order=20)
        return math.sqrt(integral(self.field - exact) / integral(exact))

    def error_by(self, steps):
        """The same after so many steps; infinite where they are too long."""
        self.run(steps)
        error = self.error()
        return error if error < 10 else math.inf


def phasewarp(program, place, degree, elements, *options):
    """Two ranks of phasewarp: `summary.json` of a run."""
    case = os.path.join(place, "case.toml")
    with open(case, "w", encoding="utf-8") as file:
        file.write(CASE)
    results = os.path.join(place, "results")
    settings = [f"scheme.degree={degree}", f"axis.0.x.cells={elements}",
                f"axis.0.v.cells={elements}", *options]
    command = ["mpirun", "-np", "2", program, "run", case, "-o", results, "--force"]
    for setting in settings:
        command += ["--set", setting]
    done = subprocess.run(command, capture_output=True, text=True, check=False)
    if done.returncode != 0:
        sys.exit(f"galerkin: {' '.join(command)}\n{done.stderr}")
    with open(os.path.join(results, "summary.json"), encoding="utf-8") as file:
        return json.load(file)


def least_elements(wanted, error_of):
    """The least even number of elements whose error is at most `wanted`."""
    elements = 6
    while error_of(elements) > wanted:
        elements += 2
    return elements


def least_steps(elements):
    """The least number of steps, to 5 %, that adds at most a tenth to the error of the grid."""
    steps, fine = 64, None
    while True:
        error = elements.error_by(steps)
        if fine is not None and abs(error - fine) < 0.02 * error:
            break
        steps, fine = 2 * steps, error
    allowed, low = 1.1 * error, 8
    while steps > 1.05 * low:
        middle = (steps + low) // 2
        if elements.error_by(middle) <= allowed:
            steps = middle
        else:
            low = middle
    return steps


def seconds(values):
    """The median with the range."""
    return f"{statistics.median(values):.3g} ({min(values):.3g}–{max(values):.3g})"


def main():
    """Prints the table."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("program")
    parser.add_argument("--rounds", type=int, default=5)
    given = parser.parse_args()
    place = tempfile.mkdtemp()
    print("| wanted | degree | program | elements an axis | reached | applications | solve, s "
          "| over the modes' |")
    print("|---|---|---|---|---|---|---|---|")
    classical = ["solver.method=classical"]
    for wanted, degree in ((5e-2, 4), (1e-2, 4), (1e-3, 6)):
        modes = [f"solver.tolerance={wanted / 10}"]
        measure = lambda n: phasewarp(given.program, place, degree, n, *classical)
        mine = least_elements(wanted, lambda n: measure(n)["error_l2_relative"])
        kinds = {
            "phasewarp, modes": modes,
            "phasewarp, exp(AT)": classical,
            "phasewarp, SSP-RK3": [*classical, "solver.classical.integrator=ssp-rk3"],
        }
        rows = {kind: [] for kind in kinds}
        with ng.TaskManager():
            theirs = least_elements(
                wanted, lambda n: Galerkin(degree, n, True).error_by(64 * n))
            peers = {"NGSolve, matrix-free, RK4": Galerkin(degree, theirs, False),
                     "NGSolve, assembled, RK4": Galerkin(degree, theirs, True)}
            steps = least_steps(peers["NGSolve, assembled, RK4"])
            times = {kind: [] for kind in peers}
            for _ in range(given.rounds):
                for kind, options in kinds.items():
                    rows[kind].append(phasewarp(given.program, place, degree, mine, *options))
                for kind, peer in peers.items():
                    times[kind].append(peer.run(steps))
        base = statistics.median(row["solve_seconds"] for row in rows["phasewarp, modes"])
        lines = []
        for kind, found in rows.items():
            lines.append((kind, mine, found[0]["error_l2_relative"], found[0]["matvecs"],
                          [row["solve_seconds"] for row in found]))
        for kind, found in times.items():
            lines.append((kind, theirs, peers[kind].error(), 4 * steps, found))
        for kind, elements, reached, applications, taken in lines:
            print(f"| {wanted:.0e} | {degree} | {kind} | {elements} | {reached:.1e} "
                  f"| {applications} | {seconds(taken)} "
                  f"| {statistics.median(taken) / base:.2f} |", flush=True)


if __name__ == "__main__":
    main()
