#!/usr/bin/env python3
"""Charts accuracy against speed: docs/performance.csv and, where Matplotlib is at hand, docs/performance.svg.

Usage: chart.py [--results DIR] [--documents DIR]
"""

import argparse
import csv
import os
import sys

from report import ROOT, Bad, Run, load, median, of


def points(runs):
    """Panel, method, what varies along its line, seconds, error."""
    for run in of(runs, "methods"):
        setting = run.node.text("command").rsplit("=", 1)[1]
        yield "exp(AT)", run, setting, run.node.number("error_semidiscrete")
    for run in of(runs, "exact"):
        yield "exact", run, f"{run.label('cells'):.0f} cells an axis", run.summary.number("error_l1")


def draw(rows, path):
    """Two panels; False where there is no Matplotlib."""
    try:
        import matplotlib
    except ImportError:
        return False
    matplotlib.use("svg")
    matplotlib.rcParams |= {"svg.hashsalt": "phasewarp", "svg.fonttype": "none", "font.size": 9}
    import matplotlib.pyplot as plt

    figure, axes = plt.subplots(1, 2, figsize=(10, 4.4))
    titles = {
        "exp(AT)": ("distance to exp(AT) f0, relative l2", "Example 1 at one grid; along a line tolerance or step"),
        "exact": ("L1 distance to the exact solution", "Example 1; along a line the grid"),
    }
    for axis, (panel, (label, title)) in zip(axes, titles.items()):
        mine = [row for row in rows if row[0] == panel]
        methods = list(dict.fromkeys(row[1] for row in mine))
        for method, marker in zip(methods, "os^vDPX*<>"):
            line = [row for row in mine if row[1] == method]
            x, low, high, y = ([row[k] for row in line] for k in (3, 4, 5, 6))
            if not any(y):  # exp(AT) itself
                axis.axvline(x[0], color="black", linestyle=":", linewidth=1, label=f"{method}: exp(AT) itself")
                continue
            ends = [[a - b for a, b in zip(x, low)], [b - a for a, b in zip(x, high)]]
            axis.errorbar(x, y, xerr=ends, marker=marker, markersize=4, linewidth=1, elinewidth=0.6, label=method)
        axis.set(xscale="log", yscale="log", xlabel="seconds to solve, 2 ranks (median, range)", ylabel=label, title=title)
        axis.grid(True, which="major", linewidth=0.3)
        axis.legend(fontsize=7)
    figure.tight_layout()
    figure.savefig(path, metadata={"Date": None})
    return True


def main():
    parser = argparse.ArgumentParser()
    parser.add_argument("--results", default=os.path.join(ROOT, "results/bench"))
    parser.add_argument("--documents", default=os.path.join(ROOT, "docs"))
    options = parser.parse_args()
    path = os.path.join(options.results, "programs.json")
    programs = load(path)
    if programs is None:
        raise Bad(f"{path}: no such file")
    rows = [
        (panel, run.method, setting, median(run.solve), min(run.solve), max(run.solve), error)
        for panel, run, setting, error in points([Run(node) for node in programs["rows"]])
    ]
    with open(os.path.join(options.documents, "performance.csv"), "w", newline="", encoding="utf-8") as file:
        writer = csv.writer(file, lineterminator="\n")
        writer.writerow(["compared_with", "method", "setting", "seconds", "seconds_min", "seconds_max", "error"])
        writer.writerows([*row[:3], *(f"{v:.4g}" for v in row[3:])] for row in rows)
    if not draw(rows, os.path.join(options.documents, "performance.svg")):
        print("chart: no Matplotlib: performance.csv only")


if __name__ == "__main__":
    try:
        main()
    except (Bad, OSError) as error:
        sys.exit(f"chart: {error}")
