#!/usr/bin/env python3
"""How much larger the error of a field is than that of the profile, where S and K do not commute.

Usage: commutator.py PROGRAM [--systems N] [--seed S]

Draws small systems (elements in a box that empties), exports S and K, and applies the modes of the
planned profile and exp((S + K)T) with 34 digits. Prints the norm of their difference over the
largest error of the profile on its domain: for the worst data, and for the data of the case. For
docs/numerics.md, "From the profile to the field". Needs NumPy, SciPy and mpmath.
"""

import argparse
import json
import pathlib
import random
import subprocess
import tempfile

import numpy as np
from mpmath import cos, exp, expm, matrix, mp, mpc, mpf, pi
from scipy.io import mmread

CASE = """
potential = [{ value = "0" }]
initial.f = "1"
time.end = 1
scheme.degree = 1
[[axis]]
x = { lower = -1, upper = -0.5, cells = 1 }
v = { lower = 0.3, upper = 2, cells = 1 }
"""
DATA = ["1", "exp(-9*(x+0.9)^2)", "x*v", "sin(30*x)", "1 if x < -0.8 else 0", "v"]


def settings(choose):
    """Random settings of a case."""
    return {
        "initial.f": f"'{choose(DATA)}'",
        "axis.0.v.lower": choose([0, 0.3, 1, -2]),
        "potential.0.value": f"'{choose(['0', '0', '0.3*x', 'x^2'])}'",
        "axis.0.x.degree": choose([0, 1, 2, 3, 5, 8]),
        "axis.0.x.cells": choose([1, 2, 3, 5, 8]),
        "axis.0.v.cells": choose([1, 2]),
        "scheme.flux": choose([0.2, 0.5, 1]),
        "time.end": choose([0.3, 1, 2]),
        "scheme.degree": choose([0, 1]),
        "solver.reduce": "false",
        "solver.tolerance": f"{10 ** -choose(np.linspace(1, 8, 701)):.3e}",
    }


def ratios(program, place, choose):
    """Both ratios for one system; None for one that is refused, too large, or without modes."""
    case = place / "case.toml"
    case.write_text(CASE)
    chosen = [f"--set={key}={value}" for key, value in settings(choose).items()]

    def run(command, *more):
        call = [program, command, case, *more, *chosen]
        return subprocess.run(call, capture_output=True, text=True, check=False)

    exported, planned = run("export-matrix", "-o", place / "matrix"), run("plan", "--json")
    if exported.returncode or planned.returncode:
        return None
    s, k = (mmread(place / "matrix" / f"{name}.mtx").toarray() for name in "SK")
    data = np.load(place / "matrix" / "initial_f.npy")
    plan = json.loads(planned.stdout)
    warp, time = plan["warp"], plan["time"]
    enough = len(data) <= 20 and 3 <= warp["modes"] <= 40 and np.linalg.norm(data) > 0
    if not enough or warp["profile"]["kind"] != "designed":
        return None
    weights = [mpc(*pair) for pair in warp["series"]["coefficients"]]
    numbers = [2 * pi * l / mpf(warp["series"]["period"]) for l in range(len(weights))]
    lower, upper = map(mpf, warp["profile"]["domain"])

    def error(p):
        terms = ((c * exp(mpc(0, mu * p))).real for c, mu in zip(weights[1:], numbers[1:]))
        return abs(weights[0].real + 2 * sum(terms) - exp(-p))

    count = 30 * len(weights)
    places = (lower + (upper - lower) * (1 - cos(pi * i / count)) / 2 for i in range(count + 1))
    largest = float(max(map(error, places)))
    s, k = matrix(s.tolist()) * time, matrix(k.tolist()) * time
    found = expm(k, method="taylor") * weights[0].real
    for c, mu in zip(weights[1:], numbers[1:]):
        # A mode of the program has -iμS.
        found += (expm(s * mpc(0, -mu) + k, method="taylor") * c).apply(lambda z: 2 * z.real)
    off = np.array((found - expm(s + k, method="taylor")).tolist(), dtype=float) / largest
    return np.linalg.norm(off, 2), np.linalg.norm(off @ data) / np.linalg.norm(data)


def main():
    """Prints median and largest of both ratios."""
    parser = argparse.ArgumentParser(description=__doc__.split("\n", maxsplit=1)[0])
    parser.add_argument("program", type=pathlib.Path)
    parser.add_argument("--systems", type=int, default=50)
    parser.add_argument("--seed", type=int, default=1)
    options = parser.parse_args()
    mp.dps = 34
    choose = random.Random(options.seed).choice
    found = []
    while len(found) < options.systems:
        with tempfile.TemporaryDirectory() as place:
            found += filter(None, [ratios(options.program, pathlib.Path(place), choose)])
    for name, column in zip(["worst data", "data of the case"], np.array(found).T):
        print(f"{name}: median {np.median(column):.2f}, at most {column.max():.2f}")


if __name__ == "__main__":
    main()
