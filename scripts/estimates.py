#!/usr/bin/env python3
"""How far error estimates are from measured errors: some hundred short runs on tiny grids.

    scripts/estimates.py [--program PATH] [PROFILE…]

Needs `make build`. By profile and for inflow that depends on time: how many runs called their
estimate reliable, the least and the largest ratio of estimate and measured error among them, and
the runs outside of the factor that docs/verification.md promises. Exit code 1 if there are any, or
if a run misses its tolerance. A run that is refused (round-off, too many modes) is left out.
"""

import argparse
import concurrent.futures
import itertools
import json
import subprocess
import sys
import tempfile
from pathlib import Path

FACTOR = 3.0
ROOT = Path(__file__).resolve().parent.parent
# Profiles with a kink take many modes for few digits.
PROFILES = {
    "designed": ["1e-2", "1e-4", "1e-6", "1e-8", "1e-10", "1e-11"],
    "gaussian": ["1e-2", "1e-4", "1e-6", "1e-8", "1e-10", "1e-11"],
    "low-somma": ["1e-2", "1e-4", "1e-6", "1e-8", "1e-10"],
    "smooth": ["1e-2", "1e-3", "1e-4", "1e-6"],
    "acl": ["1e-2", "1e-3"],
    "exponential": ["1e-1", "1e-2"],
}
ENDS = ["0.05", "0.1", "0.3", "1"]
CASES = [
    ("example1.toml", ["axis.0.x.cells=12", "axis.0.v.cells=10"]),
    ("well.toml", ["axis.0.x.cells=21", "axis.0.v.cells=10"]),
    ("inflow_barrier.toml", ["axis.0.x.cells=30", "axis.0.v.cells=9"]),
    ("example1.toml", ["axis.0.x.cells=8", "axis.0.v.cells=6", "scheme.degree=2"]),
]
# Inflow in time: formulas, ends and tolerances of the default profile.
PULSES = ["exp(-((t - 0.3)/0.2)^2)", "0.5 + 0.5*cos(3*t)", "exp(-vx^2)*(1 + 0.2*sin(9*t))"]
PULSED_TOLERANCES = ["1e-3", "1e-5", "1e-7", "1e-8", "1e-9", "1e-10"]


def scenes(wanted):
    for profile in wanted:
        for end, tolerance, (case, sets) in itertools.product(ENDS, PROFILES[profile], CASES):
            own = [f"solver.warp.profile={profile}", f"time.end={end}"]
            yield profile, case, [*sets, *own], tolerance


def scenes_in_time():
    grid = ["axis.0.x.cells=20", "axis.0.v.cells=14"]
    for value, end, tolerance in itertools.product(PULSES, ENDS[1:], PULSED_TOLERANCES):
        own = [f"inflow.value='{value}'", f"time.end={end}"]
        yield "inflow in time", "pulsed_inflow.toml", [*grid, *own], tolerance


def solve(program, scene):
    kind, case, sets, tolerance = scene
    sets = [*sets, f"solver.tolerance={tolerance}", "solver.verify=true"]
    options = [word for key in sets for word in ("--set", key)]
    with tempfile.TemporaryDirectory() as place:
        command = [program, "run", str(ROOT / "cases" / case), "-o", place, *options]
        done = subprocess.run(command, capture_output=True, text=True, check=False)
        if done.returncode == 2:
            return None
        if done.returncode != 0:
            sys.exit(f"{' '.join(command)}\n{done.stderr}")
        summary = json.loads((Path(place) / "summary.json").read_text())
    found = {key: summary[key] for key in ("error_estimate", "error_semidiscrete", "modes")}
    return found | {
        "kind": kind,
        "reliable": summary["error_estimate_reliable"],
        "tolerance": float(tolerance),
        "words": " ".join([case, *sets]),
    }


def main():
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--program", default=str(ROOT / "target/release/phasewarp"))
    parser.add_argument("--jobs", type=int, default=2)
    parser.add_argument("profiles", nargs="*", default=[*PROFILES, "time"])
    given = parser.parse_args()
    todo = list(scenes(p for p in given.profiles if p != "time"))
    todo += scenes_in_time() if "time" in given.profiles else []
    with concurrent.futures.ThreadPoolExecutor(given.jobs) as pool:
        runs = [run for run in pool.map(lambda s: solve(given.program, s), todo) if run]
    runs = [run for run in runs if run["error_semidiscrete"] and run["error_estimate"]]
    wrong = 0
    print("| | runs | reliable | estimate/error, reliable | estimate/error, others | missed |")
    print("|---|---|---|---|---|---|")
    for kind in dict.fromkeys(run["kind"] for run in runs):
        of_kind = [run for run in runs if run["kind"] == kind]
        ratios = {True: [], False: []}
        missed = 0
        for run in of_kind:
            ratio = run["error_estimate"] / run["error_semidiscrete"]
            ratios[run["reliable"]].append(ratio)
            missed += run["error_semidiscrete"] > run["tolerance"]
            off = run["reliable"] and not 1 / FACTOR <= ratio <= FACTOR
            if off or run["error_semidiscrete"] > run["tolerance"]:
                wrong += 1
                error = f"{run['modes']} modes, error {run['error_semidiscrete']:.2e}"
                print(f"{ratio:.2f}: {error}: {run['words']}", file=sys.stderr)
        spans = [f"{min(r):.2f} to {max(r):.2f}" if r else "" for r in ratios.values()]
        reliable = len(ratios[True])
        print(f"| {kind} | {len(of_kind)} | {reliable} | {spans[0]} | {spans[1]} | {missed} |")
    sys.exit(wrong > 0)


if __name__ == "__main__":
    main()
