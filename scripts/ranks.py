#!/usr/bin/env python3
"""Seconds on many ranks: by the plan's model, by a simulation of the messages, and as measured.

Usage: ranks.py [--program FILE] [--ranks N[,N...]] [NETWORK]
       ranks.py [--program FILE] --measured FILE.csv [--csv FILE] [NETWORK]

The first writes docs/ranks.csv, the tables of docs/scaling.md and, with Matplotlib, docs/ranks.svg.
The second prints a table of what a job of jobscripts/strong_scaling.sbatch or weak_scaling.sbatch
measured, beside model and simulation; the line with the fewest ranks gives the time of a row.
--csv adds the columns of docs/ranks.csv.

NETWORK, of one node and of the messages between nodes: --latency S --bandwidth B (bytes a second of
a node, each way) --ranks-per-node N; within a node --near-latency S; of a processor --overhead S (a
message at each end) --copy B (bytes a second) --nanoseconds NS (of a row, mode and step).

scripts/messages.py describes the simulation.
"""

import argparse
import csv
import json
import os
import shlex
import sys

sys.path.insert(0, os.path.join(os.path.dirname(os.path.abspath(__file__)), "bench"))
from messages import Network, Run  # noqa: E402
from report import ROOT, Bad, prose, replaced, short, table  # noqa: E402
from study import call, cells, pyplot, words  # noqa: E402


def planned(program, case, ranks):
    """The plan on so many ranks of a case, given with its options."""
    return json.loads(call([program, "plan", *case, "--ranks", str(ranks), "--json"]))


def modelled(plan, row_seconds):
    """Seconds by the plan's own model of its mesh."""
    return row_seconds * plan["advice"]["row_applications"]


# What the table has, and the files of the job scripts: these fill in what they measure.
MEASURED = [
    "command", "ranks", "space_blocks", "mode_groups", "oversubscribed", "cells", "applications",
    "solve_seconds", "wall_seconds", "nanoseconds_a_row_and_application_a_rank", "speed_up",
    "efficiency", "memory_bytes_per_rank"
]
COLUMNS = ["case", *MEASURED[1:], "model_seconds", "rows_seconds", "simulated_seconds", "ghosts",
           "norms", "recovery", "blocked_seconds"]


def row(scene, ranks, options, row_seconds, network):
    """A line of the table."""
    plan = planned(options.program, scene.words(ranks), ranks)
    mesh = plan["layout"]["mesh"]
    parts = Run(plan, network, row_seconds).seconds()
    whole = sum(parts.values())
    blocking = Run(plan, network, row_seconds, depth=scene.depth)
    blocked = whole if blocking.depth == 1 else sum(blocking.seconds().values())
    found = {
        "case": scene.name, "ranks": ranks, "mode_groups": mesh["groups"],
        "space_blocks": " x ".join(str(parts) for parts in mesh["space"]),
        "cells": plan["cells"], "applications": plan["warp"]["applications"],
        "model_seconds": modelled(plan, row_seconds), "rows_seconds": parts["rows"],
        "simulated_seconds": whole, "blocked_seconds": blocked,
        **{part: parts[part] / whole for part in ("ghosts", "norms", "recovery")}
    }
    print("ranks:", *(f"{found[key]:.4g}" if isinstance(found[key], float) else found[key]
                      for key in found), flush=True)
    return found


def shown(rows):
    """The table of a scene."""
    percent = lambda share: f"{100 * share:.0f} %"
    header = ["ranks", "space × modes", "rows alone, s", "model, s", "simulated, s",
              "model / simulated", "of it ghosts", "norms", "recovery", "steps blocked, s"]
    return table(header, [[
        row["ranks"], f"{row['space_blocks'].replace('x', '×')} × {row['mode_groups']}",
        short(row["rows_seconds"]), short(row["model_seconds"]), short(row["simulated_seconds"]),
        f"{row['model_seconds'] / row['simulated_seconds']:.2f}",
        *(percent(row[part]) for part in ("ghosts", "norms", "recovery")),
        short(row["blocked_seconds"])
    ] for row in rows])


class Scene:
    """A case and what of it depends on the ranks; `depth` is the steps of a blocked trip, as in
    docs/performance.md."""
    def __init__(self, name, case, settings, depth, options=lambda ranks: []):
        self.name, self.depth, self.options = name, depth, options
        self.common = words(case, settings)

    def words(self, ranks):
        return [*self.common, *self.options(ranks)]


SCENES = [
    Scene("example 1, 4096²", "example1", cells(4096, 1), 16),
    Scene("example 3, 64⁴", "example3", cells(64, 2), 4),
    Scene("step and slope in 3D, 24⁶", "step_slope3d", cells(24, 3), 2),
    # As jobscripts/weak_scaling.sbatch.
    Scene("example 1, 256 × 128 a rank, T = 1/ranks", "example1", [], 16,
          lambda ranks: ["--set", f"axis.0.x.cells={256 * ranks}", "--set", f"time.end={1 / ranks}",
                         "--ranks-x", str(ranks)]),
]
RANKS = [64, 128, 256, 512, 1024, 2048, 4096, 6400]


def compared(path, options, network):
    """Lines of a file of the job scripts, beside the model and the simulation."""
    with open(path, newline="", encoding="utf-8") as file:
        lines = sorted(csv.DictReader(file), key=lambda line: int(line["ranks"]))
    if not lines or set(MEASURED) - set(lines[0]):
        raise Bad(f"{path}: the columns {', '.join(MEASURED)} expected, and a line")
    rows, row_seconds = [], None
    for line in lines:
        ranks, solve = int(line["ranks"]), float(line["solve_seconds"])
        plan = planned(options.program, shlex.split(line["command"]), ranks)
        row_seconds = row_seconds or solve / modelled(plan, 1.0)
        parts = Run(plan, network, row_seconds).seconds()
        rows.append({**line, "case": plan["title"], "model_seconds": modelled(plan, row_seconds),
                     "rows_seconds": parts["rows"], "simulated_seconds": sum(parts.values()),
                     **{part: parts[part] / sum(parts.values())
                        for part in ("ghosts", "norms", "recovery")}})
    header = ["ranks", "space × modes", "measured, s", "model, s", "simulated, s",
              "measured / model", "measured / simulated", "efficiency"]
    text = table(header, [[
        line["ranks"] + (" (more than cores)" if line["oversubscribed"] == "yes" else ""),
        f"{line['space_blocks'].replace('x', '×')} × {line['mode_groups']}",
        *(short(float(line[key])) for key in ("solve_seconds", "model_seconds",
                                              "simulated_seconds")),
        *(f"{float(line['solve_seconds']) / line[key]:.2f}" for key in ("model_seconds",
                                                                        "simulated_seconds")),
        f"{float(line['efficiency']):.2f}"
    ] for line in rows])
    print(f"{text}\n\n{stated(network, row_seconds)}")
    return rows


def stated(network, row_seconds):
    """What the table was computed with."""
    return (f"{1e9 * row_seconds:.3g} ns a row, mode and step; "
            f"{network.ranks_per_node} ranks a node; between nodes a latency of "
            f"{1e6 * network.latency:g} µs and {network.bandwidth / 1e9:g} GB/s a node each way; "
            f"within a node {1e6 * network.near_latency:g} µs; of the processor, "
            f"{1e6 * network.overhead:g} µs a message at each end and {network.copy / 1e9:g} GB/s "
            "to pack, copy, unpack and add.")


def draw(rows, path):
    """Seconds against ranks; False where there is no Matplotlib."""
    plt = pyplot()
    if plt is None:
        return False
    figure, axis = plt.subplots(figsize=(7, 4.4))
    for color, scene in enumerate(dict.fromkeys(row["case"] for row in rows)):
        mine = [row for row in rows if row["case"] == scene]
        x = [row["ranks"] for row in mine]
        for key, style, label in (("rows_seconds", ":", None), ("model_seconds", "-", scene),
                                  ("simulated_seconds", "o", None)):
            axis.plot(x, [row[key] for row in mine], style, color=f"C{color}", label=label,
                      markersize=4, linewidth=1)
    axis.set_xscale("log", base=2)
    axis.set(yscale="log", xlabel="ranks", ylabel="seconds to solve",
             title="Lines: the plan's model; points: simulated; dotted: rows alone")
    axis.grid(True, which="major", linewidth=0.3)
    axis.legend(fontsize=7)
    figure.tight_layout()
    figure.savefig(path, metadata={"Date": None})
    return True


def write_csv(rows, path):
    with open(path, "w", newline="", encoding="utf-8") as file:
        writer = csv.DictWriter(file, COLUMNS, extrasaction="ignore", lineterminator="\n")
        writer.writeheader()
        writer.writerows({key: f"{value:.5g}" if isinstance(value, float) else value
                          for key, value in row.items()} for row in rows)


NETWORK = {
    "latency": 2e-6, "bandwidth": 25e9, "near-latency": 5e-7, "overhead": 1e-6, "copy": 1e10,
    "nanoseconds": 1.0, "ranks-per-node": 64
}


def document(rows, text_of_network):
    """Writes docs/ranks.csv, docs/ranks.svg and the tables of docs/scaling.md."""
    documents = os.path.join(ROOT, "docs")
    write_csv(rows, os.path.join(documents, "ranks.csv"))
    if not draw(rows, os.path.join(documents, "ranks.svg")):
        print("ranks: no Matplotlib: the chart stays as it was")
    path = os.path.join(documents, "scaling.md")
    with open(path, encoding="utf-8") as file:
        text = file.read()
    scenes = dict.fromkeys(row["case"] for row in rows)
    tables = [f"### {scene}\n\n{shown([row for row in rows if row['case'] == scene])}"
              for scene in scenes]
    text = replaced(text, "ranks", "\n\n".join([prose(text_of_network), *tables]), path)
    with open(path, "w", encoding="utf-8") as file:
        file.write(text)


def main():
    parser = argparse.ArgumentParser()
    target = os.environ.get("CARGO_TARGET_DIR", os.path.join(ROOT, "target"))
    parser.add_argument("--program", default=os.path.join(target, "release/phasewarp"))
    parser.add_argument("--ranks", default=",".join(str(n) for n in RANKS))
    parser.add_argument("--measured")
    parser.add_argument("--csv")
    for name, value in NETWORK.items():
        parser.add_argument(f"--{name}", type=type(value), default=value)
    options = parser.parse_args()
    network = Network(options.latency, options.bandwidth, options.ranks_per_node,
                      options.near_latency, options.overhead, options.copy)
    row_seconds = 1e-9 * options.nanoseconds
    if options.measured:
        rows = compared(options.measured, options, network)
        if options.csv:
            write_csv(rows, options.csv)
        return
    ranks = [int(n) for n in options.ranks.split(",")]
    rows = [row(scene, n, options, row_seconds, network) for scene in SCENES for n in ranks]
    document(rows, stated(network, row_seconds))


if __name__ == "__main__":
    try:
        main()
    except (Bad, OSError, ValueError) as error:
        sys.exit(f"ranks: {error}")
