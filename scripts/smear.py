#!/usr/bin/env python3
"""Measure-valued data against a smooth delta function in their place: docs/quantum.md.

Usage: smear.py [--program FILE] [--quick]

Solves examples 2 and 3 by level sets, and with initial.f = density times normal densities of
standard deviation omega, all by the classical method. Prints two tables of Markdown: L1 errors of
the density, relative to the exact mass in the box, and those of the mean velocity u, weighted with
the exact density, relative to the exact |u| weighted so. Needs h5py and numpy (`make readers`).
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


def moments(program, case, settings):
    """The moments of a run and the exact ones if it has them, each density and velocity."""
    with tempfile.TemporaryDirectory() as place:
        command = [program, "run", case, "-o", place, "--set", "solver.method=classical"]
        for setting in settings:
            command += ["--set", setting]
        call(command)
        with h5py.File(os.path.join(place, "result.h5")) as file:
            names = ["density", "velocity"]
            found = [file[name][:] for name in names]
            if "density_exact" not in file:
                return found, None
            return found, [file[f"{name}_exact"][:] for name in names]


def errors(found, exact):
    """Relative L1 errors of density and velocity; a vacuum of the run has the velocity 0."""
    density, velocity = exact
    there = density > 0
    off = np.where(there, np.nan_to_num(found[1]) - np.nan_to_num(velocity), 0)
    size = np.where(there, velocity, 0)
    momentum = (density * np.linalg.norm(size, axis=0)).sum()
    return [
        np.abs(found[0] - density).sum() / density.sum(),
        (density * np.linalg.norm(off, axis=0)).sum() / momentum,
    ]


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
    rows = []
    for name, axes, sizes in QUICK if arguments.quick else GRIDS:
        case = os.path.join(ROOT, "cases", f"{name}.toml")
        for size in sizes:
            cells = [f"axis.{a}.{kind}.cells={size}" for a in range(axes) for kind in "xv"]
            found, exact = moments(arguments.program, case, cells)
            both = [errors(found, exact)]
            for width in WIDTHS:
                with tempfile.TemporaryDirectory() as place:
                    path = without_initial(case, width, place)
                    found, _ = moments(arguments.program, path, cells)
                both.append(errors(found, exact))
            rows.append((name, size, both))
    for moment, title in enumerate(["density", "u"]):
        widths = " | ".join(f"ω = {w}" for w in WIDTHS)
        print(f"| error of {title} | cells an axis | level sets | {widths} |")
        print("|---" * (3 + len(WIDTHS)) + "|")
        for name, size, both in rows:
            row = " | ".join(f"{error[moment]:.3f}" for error in both)
            print(f"| {name} | {size} | {row} |")
        print(flush=True)


if __name__ == "__main__":
    try:
        main()
    except Bad as why:
        sys.exit(str(why))
