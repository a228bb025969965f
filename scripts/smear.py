#!/usr/bin/env python3
"""Measure-valued data against a smooth delta function in their place: docs/quantum.md.

Usage: smear.py [--program FILE] [--quick]

Solves examples 2 and 3 by level sets, and with initial.f = density times normal densities of
standard deviation omega, all by the classical method. Prints the L1 errors of the density, relative
to the exact mass in the box, as a table of Markdown. Needs h5py and numpy (`make readers`).
"""

import argparse
import os
import sys
import tempfile
import tomllib

import h5py
import numpy as np
from study import ROOT, Bad, call

WIDTHS = [0.1, 0.05, 0.025, 0.0125]
# Case, its axes, and cells an axis.
GRIDS = [("example2", 1, [256, 512, 1024]), ("example3", 2, [8, 16, 24, 32])]
QUICK = [("example2", 1, [64]), ("example3", 2, [8])]


def smeared(case, width):
    """The initial section with a function f."""
    with open(case, "rb") as file:
        initial = tomllib.load(file)["initial"]
    velocity = initial["velocity"]
    velocity = velocity if isinstance(velocity, list) else [velocity]
    f = f"({initial['density']})"
    for v, u in zip(["vx", "vy"], velocity):
        f += f" * exp(-({v} - ({' '.join(u.split())}))^2/{2 * width**2})"
        f += f"/{np.sqrt(2 * np.pi) * width}"
    return f


def density(program, case, settings):
    """The density of a run, and the exact one if it has one, with the size of a cell."""
    with tempfile.TemporaryDirectory() as place:
        command = [program, "run", case, "-o", place, "--set", "solver.method=classical"]
        for setting in settings:
            command += ["--set", setting]
        call(command)
        with h5py.File(os.path.join(place, "result.h5")) as file:
            exact = file["density_exact"][:] if "density_exact" in file else None
            return file["density"][:], exact


def without_initial(case, width, place):
    """The case with its data smeared, in a file of its own."""
    lines, skip = [], False
    with open(case, encoding="utf-8") as file:
        for line in file:
            if line.startswith("["):
                skip = line.startswith(("[initial]", "[exact]"))
            if not skip:
                lines.append(line)
    path = os.path.join(place, "case.toml")
    with open(path, "w", encoding="utf-8") as file:
        file.writelines(lines)
        file.write(f'[initial]\nf = "{smeared(case, width)}"\n[inflow]\nvalue = "initial"\n')
    return path


def main():
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--program", default=os.path.join(ROOT, "target", "release", "phasewarp"))
    parser.add_argument("--quick", action="store_true")
    arguments = parser.parse_args()
    print("| case | cells an axis | level sets | " + " | ".join(f"ω = {w}" for w in WIDTHS) + " |")
    print("|---" * (3 + len(WIDTHS)) + "|")
    for name, axes, sizes in QUICK if arguments.quick else GRIDS:
        case = os.path.join(ROOT, "cases", f"{name}.toml")
        for size in sizes:
            cells = [f"axis.{a}.{kind}.cells={size}" for a in range(axes) for kind in "xv"]
            found, exact = density(arguments.program, case, cells)
            errors = [np.abs(found - exact).sum() / exact.sum()]
            for width in WIDTHS:
                with tempfile.TemporaryDirectory() as place:
                    path = without_initial(case, width, place)
                    found, _ = density(arguments.program, path, cells)
                errors.append(np.abs(found - exact).sum() / exact.sum())
            row = " | ".join(f"{error:.3f}" for error in errors)
            print(f"| {name} | {size} | {row} |", flush=True)


if __name__ == "__main__":
    try:
        main()
    except Bad as why:
        sys.exit(str(why))
