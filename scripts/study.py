#!/usr/bin/env python3
"""Memory and time against N_p, planned and measured: full runs (all modes kept) and streamed ones.

Usage: study.py [--program FILE] [--launch WORDS] [--ranks N[,N...]] [--quick] [--counts]
                [--csv FILE]

Writes docs/scaling.csv, the tables of docs/scaling.md between their markers and, with Matplotlib,
docs/scaling.svg.

--quick   a short form of all three, into results/study-quick/
--counts  without seconds, and without the extrapolation, which consists of them: for a machine that
          others use
--csv     that file only, which is what jobscripts/memory_vs_np.sbatch does
--launch  the words that start an MPI program, up to the number of ranks

Results of a run are in results/study/ until they have been read: at most 2 GiB. If a command fails,
the script prints its message and ends with exit code 1.
"""

import argparse
import csv
import json
import os
import shutil
import subprocess
import sys

sys.path.insert(0, os.path.join(os.path.dirname(os.path.abspath(__file__)), "bench"))
from report import ROOT, Bad, Node, fitted, replaced, short, table  # noqa: E402

# The paper's profile on its intervals. Times are short, so that the study takes minutes: memory is
# the same for any time, and seconds grow with it.
EXPONENTIAL = [
    "solver.warp.profile=exponential", "solver.warp.coefficients=sampled", "solver.tolerance=0.1"
]


def cells(n, axes):
    return [f"axis.{a}.{kind}.cells={n}" for a in range(axes) for kind in "xv"]


class Scene:
    def __init__(self, name, case, settings, exponents, modes):
        self.name, self.case, self.settings = name, case, settings
        self.exponents, self.modes = exponents, modes


SCENES = [
    Scene("example 1, 128²",
          "example1", [*EXPONENTIAL, "solver.warp.interval=[-131.93,6.5962]", "time.end=0.01"],
          range(8, 15), ("streamed", "full")),
    Scene("example 3, 8⁴",
          "example3", [*EXPONENTIAL, "solver.warp.interval=[-29.753,5.1905]", "time.end=0.04"],
          range(8, 13), ("streamed", "full")),
    Scene("example 3, 16⁴", "example3",
          [*EXPONENTIAL, "solver.warp.interval=[-62,5.2]", "time.end=0.005", *cells(16, 2)],
          range(8, 13), ("streamed", )),
]
QUICK = [
    Scene("example 1, 32²", "example1",
          [*EXPONENTIAL, "solver.warp.interval=[-40,6.5]", "time.end=0.02", *cells(32, 1)],
          range(8, 11), ("streamed", "full")),
    Scene("example 3, 8⁴", "example3", SCENES[1].settings, range(8, 10), ("streamed", "full")),
]
RANKS = [1, 2, 4]
# The machine that is extrapolated to.
NODES, RANKS_PER_NODE, MEMORY_PER_NODE = 100, 64, "256GiB"
TARGETS = [8, 16, 32, 64]
COLUMNS = [
    "case", "mode", "points", "modes", "ranks", "space_blocks", "mode_groups",
    "planned_bytes_per_rank", "measured_bytes_per_rank", "kept_bytes_per_rank",
    "buffer_bytes_per_rank", "applications", "solve_seconds", "write_seconds", "wall_seconds"
]
SECONDS = COLUMNS[-3:]
# As root, and on fewer cores than ranks, as in a container; Open MPI's 4.x names.
ENVIRONMENT = {
    "OMPI_ALLOW_RUN_AS_ROOT": "1",
    "OMPI_ALLOW_RUN_AS_ROOT_CONFIRM": "1",
    "OMPI_MCA_rmaps_base_oversubscribe": "1",
    "OMPI_MCA_mpi_yield_when_idle": "1",
}


def call(command):
    done = subprocess.run(command,
                          capture_output=True,
                          text=True,
                          env=ENVIRONMENT | os.environ,
                          check=False)
    if done.returncode != 0:
        text = (done.stderr or done.stdout).strip()[-500:]
        raise Bad(f"{' '.join(command)}: exit code {done.returncode}: {text}")
    return done.stdout


def words(case, settings):
    found = [os.path.join(ROOT, "cases", f"{case}.toml")]
    for setting in settings:
        found += ["--set", setting]
    return found


def plan(program, case, settings, *options, launch=()):
    arguments = words(case, settings)
    return Node(json.loads(call([*launch, program, "plan", *arguments, *options, "--json"])),
                f"plan {' '.join(arguments)}")


def arrays(planned):
    """Bytes by name, on the fullest rank."""
    return {entry.value[0]: entry.value[1] for entry in planned["layout"]["arrays"]}


def measure(options, scene, mode, points, ranks, scratch):
    """A row of the table."""
    settings = [
        *scene.settings, f"solver.warp.points={points}",
        f"output.warped_field={'true' if mode == 'full' else 'false'}"
    ]
    call([
        *options.launch.split(),
        str(ranks), options.program, "run", *words(scene.case, settings), "-o", scratch
    ])
    path = os.path.join(scratch, "summary.json")
    with open(path, encoding="utf-8") as file:
        summary = Node(json.load(file), path)
    shutil.rmtree(scratch)
    blocks = [str(node.value) for node in summary["space_blocks"]]
    planned = arrays(
        plan(options.program, scene.case, settings, "--ranks", str(ranks), "--ranks-x",
             ",".join(blocks)))
    values = [
        scene.name, mode, points,
        int(summary.number("modes")), ranks, " x ".join(blocks),
        int(summary.number("mode_groups")),
        int(summary.positive("memory_planned_bytes_per_rank")),
        int(summary.positive("memory_peak_bytes_per_rank")),
        planned.get("kept modes", 0),
        planned.get("buffers of the transpose", 0),
        int(summary.number("matvecs")),
        *(float(f"{v:.5g}")
          for v in (summary.number("solve_seconds"), summary["seconds"].number("write"),
                    summary.number("wall_seconds")))
    ]
    row = dict(zip(COLUMNS, values))
    if options.counts:
        row |= dict.fromkeys(SECONDS)
    print("study:",
          scene.name,
          mode,
          f"N_p {points}, {ranks} ranks: {row['applications']} applications,",
          "MiB measured / planned:",
          memory(row),
          flush=True)
    return row


def memory(row):
    measured, planned = row["measured_bytes_per_rank"], row["planned_bytes_per_rank"]
    return f"{mebibytes(measured)} / {mebibytes(planned)}"


def mebibytes(value):
    return f"{value / 2**20:.0f}" if value >= 100 * 2**20 else f"{value / 2**20:.1f}"


def measured(rows, scene):
    """Memory, measured and planned, and seconds; a line for each N_p and mode."""
    mine = [row for row in rows if row["case"] == scene]
    fits = {"measured_bytes_per_rank": "memory a rank", "applications": "applications"}
    if timed := all(row["solve_seconds"] for row in mine):
        fits["solve_seconds"] = "solve, s"
    ranks = sorted({row["ranks"] for row in mine})
    lines, exponents = [], []
    for mode in dict.fromkeys(row["mode"] for row in mine):
        of_mode = [row for row in mine if row["mode"] == mode]
        for points in sorted({row["points"] for row in of_mode}):
            line = [mode, f"2^{points.bit_length() - 1}"]
            found = {row["ranks"]: row for row in of_mode if row["points"] == points}
            line.append(found[ranks[0]]["modes"])
            line += [memory(found[n]) for n in ranks]
            line.append(
                mebibytes(found[ranks[0]]["kept_bytes_per_rank"]) if mode == "full" else "–")
            line.append(found[ranks[0]]["applications"])
            if timed:
                line += [short(found[n]["solve_seconds"]) for n in ranks]
            lines.append(line)
        alone = [row for row in of_mode if row["ranks"] == ranks[0]]
        x = [row["points"] for row in alone]
        exponents.append([mode, *(fitted(x, [row[key] for row in alone]) for key in fits)])
    number = lambda n: f"{n} rank" if n == 1 else f"{n} ranks"
    header = [
        "mode", "N_p", "modes", *(f"MiB a rank, {number(n)}: measured / planned" for n in ranks),
        f"of it modes, {number(ranks[0])}", "applications",
        *(f"solve, s, {number(n)}" for n in ranks if timed)
    ]
    text = table(header, lines)
    return text + f"\n\nExponents in N_p, {number(ranks[0])}:\n\n" + table(["mode", *fits.values()],
                                                                           exponents)


def agreement(rows):
    """How far measured memory is from planned, for runs whose arrays outweigh the program."""
    large = [row for row in rows if row["planned_bytes_per_rank"] > 4 * 28 * 2**20]
    if not large:
        return "In every run the program itself takes a good part of the memory."
    ratios = [row["measured_bytes_per_rank"] / row["planned_bytes_per_rank"] for row in large]
    return (
        f"Over the {len(large)} runs that take more than 112 MiB a rank, measured / planned memory "
        f"is {min(ratios):.3f} to {max(ratios):.3f}.")


def extrapolated(options):
    """What the plan says about a large machine."""
    ranks = NODES * RANKS_PER_NODE
    node = [
        "--ranks",
        str(ranks), "--memory-per-node", MEMORY_PER_NODE, "--ranks-per-node",
        str(RANKS_PER_NODE)
    ]
    lines = []
    for n in TARGETS:
        settings = [
            *EXPONENTIAL, f"solver.warp.interval=[{-29.753 * n / 8},5.2]",
            "solver.warp.points=4096", *cells(n, 2)
        ]
        line = [f"{n}⁴"]
        for mode in ("streamed", "full"):
            full = [*settings, f"output.warped_field={'true' if mode == 'full' else 'false'}"]
            planned = plan(options.program,
                           "example3",
                           full,
                           *node,
                           "--calibrate",
                           launch=[*options.launch.split(),
                                   str(options.here)])
            advice, predicted = planned["advice"], planned["calibration"]
            memory = sum(arrays(planned).values())
            line += [
                " × ".join(str(b.value) for b in planned["layout"]["mesh"]["space"]) +
                f" × {planned['layout']['mesh'].number('groups'):.0f}",
                mebibytes(memory),
                short(predicted.positive("solve_seconds"))
            ]
            if mode == "full":
                # Of each of the three fields.
                line += [
                    f"{8 * 4096 * n**4 / 2**30:.2f}", f"{advice.number('largest_points'):.0f}"
                    if advice.has("largest_points") else "–"
                ]
        lines.append(line)
        print("study: extrapolated", *line, sep="  ", flush=True)
    header = [
        "cells", "streamed: ranks, space × modes", "MiB a rank", "solve, s",
        "full: ranks, space × modes", "MiB a rank", "solve, s", "GiB of w, a field", "largest N_p"
    ]
    return table(header, lines)


def pyplot():
    """Matplotlib, set up for pictures that are the same each time; None where there is none."""
    try:
        import matplotlib
    except ImportError:
        return None
    matplotlib.use("svg")
    matplotlib.rcParams |= {"svg.hashsalt": "phasewarp", "svg.fonttype": "none", "font.size": 9}
    import matplotlib.pyplot as plt
    return plt


def draw(rows, path):
    """Memory and seconds against N_p; False where there is no Matplotlib."""
    plt = pyplot()
    if plt is None:
        return False
    figure, axes = plt.subplots(1, 2, figsize=(10, 4.4))
    ranks = sorted({row["ranks"] for row in rows})
    scenes = list(dict.fromkeys(row["case"] for row in rows))
    timed = all(row["solve_seconds"] for row in rows)
    panels = [
        ("measured_bytes_per_rank", 2**20, "MiB a rank", "Memory: points measured, lines planned"),
        ("solve_seconds", 1, "seconds to solve",
         "Time of the short runs of this study") if timed else
        ("applications", 1, "applications", "Work of the short runs of this study"),
    ]
    for axis, (key, unit, label, title) in zip(axes, panels):
        for color, scene in enumerate(scenes):
            for mode, style in (("streamed", "--"), ("full", "-")):
                for n, marker in zip(ranks, "osv^D"):
                    line = [
                        row for row in rows
                        if (row["case"], row["mode"], row["ranks"]) == (scene, mode, n)
                    ]
                    if not line:
                        continue
                    x = [row["points"] for row in line]
                    name = f"{scene}, {mode}" if n == ranks[0] else None
                    shown = {
                        "color": f"C{color}", "marker": marker, "markersize": 4, "linewidth": 1
                    }
                    if unit == 1:
                        axis.plot(x, [row[key] for row in line],
                                  linestyle=style,
                                  label=name,
                                  **shown)
                        continue
                    axis.plot(x, [row[key] / unit for row in line],
                              label=name,
                              **(shown | {"linestyle": "none"}),
                              fillstyle="full" if mode == "full" else "none")
                    axis.plot(x, [row["planned_bytes_per_rank"] / unit for row in line],
                              linestyle=style,
                              color=f"C{color}",
                              linewidth=0.8)
        axis.set_xscale("log", base=2)
        axis.set(yscale="log", xlabel="N_p", ylabel=label, title=title)
        axis.grid(True, which="major", linewidth=0.3)
        axis.legend(fontsize=7)
    figure.text(0.01,
                0.005,
                "Ranks: " +
                ", ".join(f"{n} {m}" for n, m in zip(ranks, ["circle", "square", "triangle down"])),
                fontsize=7)
    figure.tight_layout()
    figure.savefig(path, metadata={"Date": None})
    return True


def write_csv(rows, path):
    with open(path, "w", newline="", encoding="utf-8") as file:
        writer = csv.DictWriter(file, COLUMNS, lineterminator="\n")
        writer.writeheader()
        writer.writerows(rows)


def main():
    parser = argparse.ArgumentParser()
    target = os.environ.get("CARGO_TARGET_DIR", os.path.join(ROOT, "target"))
    parser.add_argument("--program", default=os.path.join(target, "release/phasewarp"))
    parser.add_argument("--launch", default="mpirun --bind-to none -np")
    parser.add_argument("--ranks", default=",".join(str(n) for n in RANKS))
    parser.add_argument("--quick", action="store_true")
    parser.add_argument("--counts", action="store_true")
    parser.add_argument("--csv")
    options = parser.parse_args()
    try:
        ranks = [int(n) for n in options.ranks.split(",")]
    except ValueError:
        raise Bad(f"--ranks {options.ranks}: whole numbers expected, separated by commas") from None
    options.here = min(2, os.cpu_count() or 1)
    place = os.path.join(ROOT, "results/study-quick" if options.quick else "results/study")
    os.makedirs(place, exist_ok=True)
    load, rows = os.getloadavg()[0], []
    for scene in QUICK if options.quick else SCENES:
        for mode in scene.modes:
            for exponent in scene.exponents:
                for n in ranks:
                    rows.append(
                        measure(options, scene, mode, 2**exponent, n, os.path.join(place, "run")))
    if options.csv:
        write_csv(rows, options.csv)
        return
    documents = os.path.join(ROOT, "docs")
    if options.quick:
        shutil.copy(os.path.join(documents, "scaling.md"), place)
        documents = place
    write_csv(rows, os.path.join(documents, "scaling.csv"))
    if not draw(rows, os.path.join(documents, "scaling.svg")):
        print("study: no Matplotlib: the chart stays as it was")
    path = os.path.join(documents, "scaling.md")
    with open(path, encoding="utf-8") as file:
        text = file.read()
    scenes = list(dict.fromkeys(row["case"] for row in rows))
    tables = "\n\n".join(f"### {scene}\n\n{measured(rows, scene)}" for scene in scenes)
    about = "" if options.counts else f" Load of the machine before: {load:.1f}."
    text = replaced(text, "measured", f"{tables}\n\n{agreement(rows)}{about}", path)
    if not options.counts:
        text = replaced(text, "extrapolated", extrapolated(options), path)
    with open(path, "w", encoding="utf-8") as file:
        file.write(text)


if __name__ == "__main__":
    try:
        main()
    except (Bad, OSError) as error:
        sys.exit(f"study: {error}")
