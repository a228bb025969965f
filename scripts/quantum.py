#!/usr/bin/env python3
"""The error budget of docs/quantum.md, from the continuous problem to a measured density.

Usage: quantum.py [--ranks N] [--quick]

Runs examples 1 and 2, reads their results, and replaces the tables between the markers of
docs/quantum.md; docs/quantum.csv holds the same numbers. Needs h5py and numpy (`make readers`).
"""

import argparse
import csv
import json
import os
import sys
import tempfile
import textwrap

import h5py
import numpy as np
from study import ROOT, Bad, call, replaced, words

DOCUMENT, TABLE = (os.path.join(ROOT, "docs", name) for name in ["quantum.md", "quantum.csv"])
POINTS = [-1.2, -0.9, -0.6, -0.3, 0.3, 0.6, 0.9, 1.2]
# One that is found with a probability worth the name.
PROFILE = ["solver.warp.profile=gaussian", "solver.warp.sigma=0.25"]
COLUMNS = [
    "case", "cells", "tolerance", "accuracy", "discretisation", "schrodingerization", "propagation",
    "hadamard", "amplitude_estimation", "bound", "total", "note"
]


def run(case, ranks, settings):
    """Runs the program; gives density, exact density, space axis, summary and readout lines."""
    program = os.path.join(os.environ.get("CARGO_TARGET_DIR", os.path.join(ROOT, "target")),
                           "release", "phasewarp")
    with tempfile.TemporaryDirectory() as place:
        call(["mpirun", "-np", str(ranks), program, "run", *words(case, settings), "-o", place])
        with h5py.File(os.path.join(place, "result.h5")) as file:
            if "density_exact" in file:
                exact = file["density_exact"][()]
            else:
                exact = file["exact"][()].sum(axis=1) * (file["vx"][1] - file["vx"][0])
            density, x = file["density"][()], file["x"][()]
        with open(os.path.join(place, "summary.json"), encoding="utf-8") as file:
            summary = json.load(file)
        path, lines = os.path.join(place, "readout.csv"), []
        if os.path.exists(path):
            with open(path, encoding="utf-8", newline="") as file:
                lines = [line for line in csv.DictReader(file) if line["observable"] == "density"]
        return density, exact, x, summary, lines


def rms(values):
    return float(np.sqrt(np.mean(np.square(values))))


def budget(case, cells, tolerance, accuracy, ranks):
    """Root mean square over the points of every error in the density; None where unknown."""
    grid = [f"axis.0.x.cells={cells}", f"axis.0.v.cells={cells}"]
    points = ",".join(f"[{p}]" for p in POINTS)
    readout = f"readout={{points=[{points}],accuracy={accuracy:g},seed=7}}"
    reference, exact, x, _, _ = run(case, ranks, grid + ["solver.method=classical"])
    planned = grid + [f"solver.tolerance={tolerance:g}"] + PROFILE
    found, _, _, _, lines = run(case, ranks, planned + [readout])
    other, *_ = run(case, ranks, planned + ["solver.propagator.method=krylov"])
    at = [int(np.argmin(np.abs(x - p))) for p in POINTS]
    row = {
        "case": case,
        "cells": cells,
        "tolerance": tolerance,
        "accuracy": accuracy,
        "discretisation": rms((reference - exact)[at]),
        "schrodingerization": rms((found - reference)[at]),
        "propagation": rms((found - other)[at]),
        "note": "",
    }
    if not any(line["estimator"] for line in lines):
        row["note"] = lines[0]["unavailable"] if lines else "nothing is read"
    for name in ["hadamard", "amplitude-estimation"]:
        mine = [line for line in lines if line["estimator"] == name]
        key = name.replace("-", "_")
        if mine and all(line["estimate"] for line in mine):
            values = np.array([float(line["estimate"]) for line in mine])
            cells_read = [int(line["cell"]) for line in mine]
            row[key] = rms(values - found[cells_read])
            if name == "hadamard":
                row["bound"] = max(float(line["bound"]) for line in mine)
                row["total"] = rms(values - exact[cells_read])
        elif mine:
            row["note"] = next(line["unavailable"] for line in mine if not line["estimate"])
    return row


def number(row, key):
    if row.get(key) is None:
        return "-"
    return f"{row[key]}²" if key == "cells" else f"{row[key]:.1e}"


def table(rows):
    head = [
        "cells", "tolerance", "accuracy", "discretisation", "Schrödingerization",
        "Chebyshev less Krylov", "Hadamard test", "amplitude est.", "bound", "total"
    ]
    keys = COLUMNS[1:-1]
    lines = ["| " + " | ".join(head) + " |", "|" + "---|" * len(head)]
    for row in rows:
        lines.append("| " + " | ".join(number(row, key) for key in keys) + " |")
    notes = sorted({row["note"] for row in rows if row["note"]})
    for note in notes:
        lines += ["", textwrap.fill(f"`-`: unavailable, {note}.", 100)]
    return "\n".join(lines)


def main():
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--ranks", type=int, default=2)
    parser.add_argument("--quick", action="store_true")
    options = parser.parse_args()
    cells = [32, 64] if options.quick else [32, 64, 128]
    grids = [(n, 1e-6, 1e-2) for n in cells]
    others = [(cells[-1], t, a) for t, a in [(1e-4, 1e-1), (1e-6, 1e-1), (1e-6, 1e-3)]]
    plans = {"example1": grids + others, "example2": grids}
    rows = {
        case: [budget(case, *plan, options.ranks) for plan in list_]
        for case, list_ in plans.items()
    }
    with open(TABLE, "w", encoding="utf-8", newline="") as file:
        writer = csv.DictWriter(file, COLUMNS)
        writer.writeheader()
        writer.writerows(row for list_ in rows.values() for row in list_)
    with open(DOCUMENT, encoding="utf-8") as file:
        text = file.read()
    for case, list_ in rows.items():
        text = replaced(text, case, table(list_), DOCUMENT)
    with open(DOCUMENT, "w", encoding="utf-8") as file:
        file.write(text)


if __name__ == "__main__":
    try:
        main()
    except Bad as why:
        sys.exit(str(why))
