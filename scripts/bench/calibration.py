#!/usr/bin/env python3
"""Compares predictions of `phasewarp plan --calibrate` with runs, and meshes with each other: two
tables of docs/performance.md.

Usage: calibration.py [--program FILE] [--document FILE] [--rounds N] [--quick]
       [--only calibration|meshes]

Needs the standard library only. A round calibrates and then runs, case by case, or runs each mesh
in turn. The tables show medians, with the range of the runs. --quick: one round of the shortest
predictions, printed; the document is left as it was. If a command fails, the script prints its
message and ends with exit code 1.
"""

import argparse
import json
import os
import subprocess
import sys
import tempfile

from report import ROOT, Bad, Node, busy_cores, median, prose, replaced, short, spread, table


def cells(n, axes=1):
    return [f"axis.{a}.{kind}.cells={n}" for a in range(axes) for kind in "xv"]


CRANK_NICOLSON = "solver.propagator={method='crank-nicolson',step=0.02}"
# What is shown, case file, settings.
CASES = [
    ("example 1, 1e-6", "example1", []),
    ("example 1, 1e-9", "example1", ["solver.tolerance=1e-9"]),
    ("example 1, 256²", "example1", cells(256)),
    ("example 3, 16⁴", "example3", cells(16, 2)),
    ("example 3, 24⁴", "example3", cells(24, 2)),
    ("steady inflow", "inflow_barrier", []),
    ("inflow that varies", "pulsed_inflow", []),
    ("example 1, ten output times", "example1",
     ["solver.tolerance=1e-9", "output.moments_every=0.1"]),
    ("example 1, Crank–Nicolson", "example1", [CRANK_NICOLSON]),
    ("example 1, Krylov", "example1", ["solver.propagator.method=krylov"]),
    ("example 1, 256², classical, ssp-rk3", "example1", cells(256) +
     ["solver.method=classical", "solver.classical.integrator=ssp-rk3", "solver.classical.cfl=0.1"
      ]),
]
QUICK = ["example 1, 1e-6", "steady inflow"]
# For meshes of two ranks: what is shown, case file, settings, axes of space.
MESHES = [
    ("`example1` at 1e-6", "example1", [], 1),
    ("`example1`, 256²", "example1", cells(256), 1),
    ("`example1`, 512² at 1e-3", "example1", cells(512) + ["solver.tolerance=1e-3"], 1),
    ("`example3`, 16⁴ at 1e-3", "example3", cells(16, 2) + ["solver.tolerance=1e-3"], 2),
    ("`example3`, 24⁴ at 1e-3", "example3", cells(24, 2) + ["solver.tolerance=1e-3"], 2),
    ("`barrier2d`", "barrier2d", [], 2),
    ("`inflow_barrier`", "inflow_barrier", [], 1),
    ("`example2`", "example2", [], 1),
    ("`lens2d`", "lens2d", [], 2),
    ("`quadrant2d`", "quadrant2d", [], 2),
    ("`pulsed_inflow`", "pulsed_inflow", [], 1),
    ("`slope_jump`", "slope_jump", [], 1),
    ("`step3d`", "step3d", [], 3),
]
RANKS = [1, 2]
# As root, and on fewer cores than ranks, as in a container; Open MPI's 4.x names.
SETTINGS = {
    "OMPI_ALLOW_RUN_AS_ROOT": "1",
    "OMPI_ALLOW_RUN_AS_ROOT_CONFIRM": "1",
    "OMPI_MCA_rmaps_base_oversubscribe": "1",
}


def call(ranks, *words):
    command = ["mpirun", "-np", str(ranks), "--bind-to", "none", *words]
    done = subprocess.run(command,
                          capture_output=True,
                          text=True,
                          env=SETTINGS | os.environ,
                          check=False)
    if done.returncode != 0:
        text = (done.stderr or done.stdout).strip()[-500:]
        raise Bad(f"{' '.join(command)}: exit code {done.returncode}: {text}")
    return done.stdout


def arguments(case, settings):
    words = [os.path.join(ROOT, "cases", f"{case}.toml")]
    for setting in settings:
        words += ["--set", setting]
    return words


def solved(program, ranks, *words):
    """The summary of a run."""
    with tempfile.TemporaryDirectory() as folder:
        call(ranks, program, "run", *words, "-o", folder)
        path = os.path.join(folder, "summary.json")
        with open(path, encoding="utf-8") as file:
            return Node(json.load(file), path)


def measure(program, case, settings, ranks):
    """Expected and taken, each as (solve, wall), and the seconds that calibrating took."""
    words = arguments(case, settings)
    place = f"plan --calibrate {' '.join(words)}"
    predicted = Node(json.loads(call(ranks, program, "plan", *words, "--calibrate", "--json")),
                place)["calibration"]
    pair = lambda node: (node.positive("solve_seconds"), node.positive("wall_seconds"))
    return pair(predicted), pair(solved(program, ranks, *words)), predicted.positive("took")


def predictions(options, rounds):
    """The table of predictions beside runs."""
    rows, within, worst = [], 0, 0.0
    load = busy_cores()
    for name, case, settings in CASES:
        if options.quick and name not in QUICK:
            continue
        for ranks in RANKS:
            found = [measure(options.program, case, settings, ranks) for _ in range(rounds)]
            row = [name, ranks]
            for k in range(2):
                expected, taken = median([f[0][k] for f in found]), [f[1][k] for f in found]
                ratio = expected / median(taken)
                within += 0.8 <= ratio <= 1.2
                worst = max(worst, ratio, 1 / ratio)
                row += [short(expected), spread(taken), f"{ratio:.2f}"]
            rows.append([*row, short(median([f[2] for f in found]))])
            print("calibration:", *rows[-1], sep="  ", flush=True)
    header = [
        "case", "ranks", "solve expected, s", "taken, s", "ratio", "in all expected, s", "taken, s",
        "ratio", "calibrating, s"
    ]
    return table(header, rows) + "\n\n" + prose(
        f"{within} of {2 * len(rows)} ratios are within 20 %; the furthest is off by a factor of "
        f"{worst:.2f}. Rounds: {rounds}; cores at work before: {load:.1f}.")


def meshes(options, rounds):
    """The table of meshes of two ranks: mode groups alone, and two blocks along each axis."""
    rows, within = [], 0
    load = busy_cores()
    for name, case, settings, axes in MESHES:
        split = [[2 if a == b else 1 for b in range(axes)] for a in range(axes)]
        ways, found = [[1] * axes, *split], {}
        for _ in range(rounds):
            for way in ways:
                blocks = ",".join(map(str, way))
                run = solved(options.program, 2, *arguments(case, settings), "--ranks-x", blocks)
                found.setdefault(tuple(way), []).append(run.positive("solve_seconds"))
        # The choice of the program, once; its times are those of the same mesh above.
        chosen = tuple(solved(options.program, 2, *arguments(case, settings))["space_blocks"].value)
        medians = {way: median(times) for way, times in found.items()}
        ratio = medians[chosen] / min(medians.values())
        within += ratio <= 1.15
        alone, *others = (spread(found[tuple(way)]) for way in ways)
        rows.append([name, alone, ", ".join(others), " × ".join(map(str, chosen)), f"{ratio:.2f}"])
        print("meshes:", *rows[-1], sep="  ", flush=True)
    header = [
        "case", "mode groups alone, s", "two blocks along x, y, z, s", "blocks chosen",
        "chosen / best"
    ]
    return table(header, rows) + "\n\n" + prose(
        f"{within} of {len(rows)} choices are within 15 % of the best mesh. Rounds: {rounds}; "
        f"cores at work before: {load:.1f}.")


def main():
    parser = argparse.ArgumentParser()
    target = os.environ.get("CARGO_TARGET_DIR", os.path.join(ROOT, "target"))
    parser.add_argument("--program", default=os.path.join(target, "release/phasewarp"))
    parser.add_argument("--document", default=os.path.join(ROOT, "docs/performance.md"))
    parser.add_argument("--rounds", type=int, default=5)
    parser.add_argument("--quick", action="store_true")
    parser.add_argument("--only", choices=["calibration", "meshes"])
    options = parser.parse_args()
    rounds = 1 if options.quick else options.rounds
    texts = {}
    if options.only != "meshes":
        texts["calibration"] = predictions(options, rounds)
    if options.only != "calibration" and not options.quick:
        texts["meshes"] = meshes(options, rounds)
    if options.quick:
        print(texts["calibration"])
        return
    with open(options.document, encoding="utf-8") as file:
        document = file.read()
    for name, text in texts.items():
        document = replaced(document, name, text, options.document)
    with open(options.document, "w", encoding="utf-8") as file:
        file.write(document)


if __name__ == "__main__":
    try:
        main()
    except (Bad, OSError) as error:
        sys.exit(f"calibration: {error}")
