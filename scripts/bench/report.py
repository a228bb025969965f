#!/usr/bin/env python3
"""Writes the tables of docs/performance.md from what `make bench` and `make example3` measured.

Usage: report.py [--results DIR] [--document FILE] [--example3 DIR]
       [--only example3|error|peers]

Needs the standard library only, and Matplotlib for peers.svg, a picture of the tables of other
programs as they stand in the document. A table stands between `<!-- begin NAME -->` and
`<!-- end NAME -->` and is replaced; a table that was not measured is kept, and its name printed.
Runs that were counted but not timed (`make bench ARGS=--counts`) give tables without seconds.
Bad input (a file that is not JSON, a missing key or marker, text in place of a number) ends with
exit code 1 and its place.
"""

import argparse
import json
import math
import os
import re
import sys
import textwrap
import time

ROOT = os.path.dirname(os.path.dirname(os.path.dirname(os.path.abspath(__file__))))
# Bytes a row, mode and step of a series summed forwards, as peers do it: read v_k; read and write
# v_{k-1} and the sum. Summed backwards, as phasewarp does it, they are 49.
MODEL_BYTES = 80

# Marks the header of a column of seconds; see `columns`.
TIMED = " (timed)"


class Bad(Exception):
    """What is wrong with the input, and where."""


def busy_cores():
    """Cores at work on average over two seconds in which this process sleeps; -1 if unknown."""
    def ticks():
        with open("/proc/stat", encoding="ascii") as file:
            kinds = [int(word) for word in file.readline().split()[1:9]]
        return sum(kinds), sum(kinds) - sum(kinds[3:5])  # without idle and iowait

    try:
        before = ticks()
        time.sleep(2)
        after = ticks()
    except OSError:
        return -1.0
    return (os.cpu_count() or 1) * (after[1] - before[1]) / max(after[0] - before[0], 1)


# --- reading --------------------------------------------------------------------------------------


def load(path):
    """The JSON in `path`, None where there is no such file."""
    try:
        with open(path, encoding="utf-8") as file:
            return Node(json.load(file), path)
    except FileNotFoundError:
        return None
    except (json.JSONDecodeError, UnicodeDecodeError) as error:
        raise Bad(f"{path}: {error}") from None


class Node:
    """A value of a JSON file that knows where it stands."""
    def __init__(self, value, place):
        self.value, self.place = value, place

    def __getitem__(self, key):
        place = f"{self.place}: {key}"
        if not isinstance(self.value, dict) or key not in self.value:
            raise Bad(f"{place}: missing")
        return Node(self.value[key], place)

    def __iter__(self):
        if not isinstance(self.value, list):
            raise Bad(f"{self.place}: a list expected")
        return (Node(v, f"{self.place}[{k}]") for k, v in enumerate(self.value))

    def has(self, key):
        return isinstance(self.value, dict) and self.value.get(key) is not None

    def number(self, key):
        node = self[key]
        if isinstance(node.value,
                      bool) or not isinstance(node.value,
                                              (int, float)) or not math.isfinite(node.value):
            raise Bad(f"{node.place}: {node.value!r} is not a finite number")
        return node.value

    def positive(self, key):
        value = self.number(key)
        if value <= 0:
            raise Bad(f"{self.place}: {key}: {value!r} is not above 0")
        return value

    def text(self, key):
        node = self[key]
        if not isinstance(node.value, str):
            raise Bad(f"{node.place}: {node.value!r} is not a text")
        return node.value

    def times(self, key):
        """Seconds of repeated runs: positive, at least one."""
        values = [Node({"seconds": n.value}, n.place).positive("seconds") for n in self[key]]
        if not values:
            raise Bad(f"{self.place}: {key}: empty")
        return values


# --- numbers --------------------------------------------------------------------------------------


def median(values):
    values = sorted(values)
    n = len(values)
    return (values[(n - 1) // 2] + values[n // 2]) / 2


def short(value):
    """Three digits."""
    if value == 0:
        return "0"
    if value >= 1000:
        return f"{value:.0f}"
    return f"{value:.{max(0, 2 - math.floor(math.log10(value)))}f}"


def spread(values):
    """Median, and where there are several the range."""
    if len(values) == 1:
        return short(values[0])
    return f"{short(median(values))} ({short(min(values))}–{short(max(values))})"


def power(value):
    """1e-6 as one writes it."""
    mantissa, exponent = f"{value:e}".split("e")
    return f"1e{int(exponent)}" if float(mantissa) == 1 else f"{value:g}"


def fit(x, y):
    """Exponent a of y ~ x^a by least squares of the logarithms, its standard error, the points."""
    if len(x) < 3 or min(*x, *y) <= 0:
        return None
    X, Y = [math.log(v) for v in x], [math.log(v) for v in y]
    n = len(X)
    mx, my = sum(X) / n, sum(Y) / n
    square = sum((a - mx)**2 for a in X)
    if square == 0:
        return None
    slope = sum((a - mx) * (b - my) for a, b in zip(X, Y)) / square
    rest = sum((b - my - slope * (a - mx))**2 for a, b in zip(X, Y))
    return slope, math.sqrt(rest / (n - 2) / square), n


def fitted(x, y):
    found = fit(x, y)
    return "–" if found is None else f"{found[0]:.2f} ± {found[1]:.2f}"


def prose(text):
    return textwrap.fill(text, 100, break_long_words=False, break_on_hyphens=False)


def table(header, rows):
    lines = ["| " + " | ".join(header) + " |", "|" + "---|" * len(header)]
    return "\n".join(lines + ["| " + " | ".join(str(c) for c in row) + " |" for row in rows])


def columns(runs, *chosen):
    """A table with a row a run and a column for each (header, value of a run).

    A header that ends with `TIMED` belongs to a column that needs seconds. Such a column is left
    out if a run was not timed.
    """
    timed = all(run.timed for run in runs)
    kept = [(name, value) for name, value in chosen if timed or not name.endswith(TIMED)]
    header = [name.removesuffix(TIMED) for name, _ in kept]
    return table(header, [[value(run) for _, value in kept] for run in runs])


# --- whole-program runs ---------------------------------------------------------------------------


class Run:
    """A row of programs.json."""
    def __init__(self, node):
        self.node = node
        self.labels, self.plan = node["labels"], node["plan"]
        self.case, self.table = node.text("case"), node.text("table")
        self.solved, self.timed = node.has("summary"), node.has("wall_seconds")
        if self.solved:
            self.summary = node["summary"]
        if self.timed:
            self.wall, self.solve = node.times("wall_seconds"), node.times("solve_seconds")
            self.triad = median(node.times("triad"))

    def label(self, name):
        return self.labels.number(name)

    @property
    def seconds(self):
        return median(self.solve)

    @property
    def cells(self):
        return self.plan.positive("cells")

    @property
    def span(self):
        """Λ: length of the spectrum of S, guaranteed, times T."""
        p = self.plan
        return (p.positive("decay") + p.number("growth")) * p.positive("time")

    @property
    def phases(self):
        """Σ τ_l, τ_l half the length of H_l's spectrum times T: the least that series take."""
        p = self.plan
        rate, time, period = (p.positive(k) for k in ("rate", "time", "period"))
        wave = 2 * math.pi / period
        modes = int(p.positive("modes"))
        tau = sum(rate * time * math.hypot(1, wave * l) for l in range(modes))
        return tau * p.positive("fields")

    @property
    def applications(self):
        """Those of the run; those planned where nothing was solved."""
        return self.summary.positive("matvecs") if self.solved else self.plan.positive(
            "applications")

    @property
    def work(self):
        """Rows times applications."""
        return self.cells * self.applications

    @property
    def nanoseconds(self):
        """Wall clock a row and application."""
        return 1e9 * self.seconds / self.work

    @property
    def share(self):
        """The bandwidth that the model accounts for, over the triad's."""
        return MODEL_BYTES * self.work / self.seconds / self.triad

    @property
    def reached(self):
        return f"{self.node.number('error_semidiscrete'):.1e}"

    @property
    def mebibytes(self):
        return f"{self.summary.positive('memory_peak_bytes_per_rank') / 2**20:.0f}"


def of(runs, name):
    found = [run for run in runs if run.table == name]
    if not found:
        raise Bad(f"programs.json: no rows of table {name!r}")
    return found


def machine(programs):
    m = programs["machine"]
    load = m.number("load")
    program = f"phasewarp {m.text('version')}, commit {m.text('commit')}"
    triads = [value for row in programs["rows"] if row.has("triad") for value in row.times("triad")]
    if not triads:
        return f"Counts, errors and memory of runs, not timed: {program}."
    lines = [
        f"{m.text('processor')}, {m['cores'].value} cores, {m.text('l1')} L1 and {m.text('l2')} L2 "
        f"a core, {m.text('l3')} L3, {m.text('memory')} of memory; {m.text('rustc')}; "
        f"{m.text('mpi')}; {program}.",
        f"Cores at work when the runs began: {load:.1f}" +
        (". **Others used the machine: times are too long and ratios noisy.**"
         if load > 0.5 else "."),
    ]
    lines.append(
        f"Triad before each timed run, one core: {spread([t / 1e9 for t in triads])} GB/s.")
    return "\n".join(prose(line) for line in lines)


def by_tolerance(runs):
    errors = ("error_l1", "error_density_l1", "error_velocity_l1")
    return columns(
        of(runs, "tolerance"),
        ("case", lambda r: r.case),
        ("cells computed", lambda r: f"{r.cells:.0f}"),
        ("tolerance", lambda r: power(r.label("tolerance"))),
        ("modes", lambda r: r.summary.number("modes")),
        ("applications", lambda r: r.summary.number("matvecs")),
        ("solve, s" + TIMED, lambda r: spread(r.solve)),
        ("whole job, s" + TIMED, lambda r: spread(r.wall)),
        ("distance to exp(AT)", lambda r: r.reached),
        ("L1 to exact", lambda r: ", ".join(f"{r.summary.number(k):.4f}"
                                            for k in errors if r.summary.has(k))),
        ("MiB a rank", lambda r: r.mebibytes),
        ("80-byte model / triad" + TIMED, lambda r: f"{r.share:.2f}"),
    )


def by_error(runs, origin):
    """Seconds to an error of the exact solution; the error of the smooth case is L2."""
    def reached(run):
        norm = "error_l2_relative" if run.case == "smooth-beams" else "error_l1_relative"
        return f"{run.summary.number(norm):.1e}"

    def grid(run):
        cells = f"{run.label('cells'):.0f}"
        degree = run.labels.has("degree") and run.label("degree")
        return f"{cells} of degree {degree:.0f}" if degree else f"{cells} cells"

    found = of(runs, "error")

    def beside_modes(seconds):
        def ratio(run):
            modes = next(r for r in found if r.case == run.case and r.label("error") ==
                         run.label("error") and r.labels.text("method") == "modes")
            return f"{seconds(run) / seconds(modes):.2f}"

        return ratio

    text = columns(
        found,
        ("case", lambda r: r.case),
        ("wanted", lambda r: f"{r.label('error'):.0e}"),
        ("method", lambda r: r.labels.text("method")),
        ("an axis", grid),
        ("reached", reached),
        ("modes", lambda r: r.summary.number("modes")),
        ("applications, steps", lambda r: r.summary.number("matvecs")),
        ("solve, s" + TIMED, lambda r: spread(r.solve)),
        ("whole job, s" + TIMED, lambda r: spread(r.wall)),
        ("solve over the modes'" + TIMED, beside_modes(lambda r: r.seconds)),
        ("job over the modes'" + TIMED, beside_modes(lambda r: median(r.wall))),
    )
    if not all(run.timed for run in found):
        return text
    about = (f"Commit {origin.text('commit')}; cores at work when the runs began: "
             f"{origin.number('load'):.1f}.")
    return f"{prose(about)}\n\n{text}"


def parts(runs):
    names, rows = [], []
    chosen = [r for r in of(runs, "tolerance") if r.label("tolerance") in (1e-6, 1e-9)]
    for run in chosen:
        names += [n for n in run.summary["seconds"].value if n not in names]
    for run in chosen:
        seconds = run.summary["seconds"]
        each = [f"{1e3 * seconds.number(n):.1f}" if seconds.has(n) else "–" for n in names]
        wall = 1e3 * run.summary.positive("wall_seconds")
        rows.append([
            run.case,
            power(run.label("tolerance")), *each, f"{wall:.0f}", f"{1e3 * median(run.wall):.0f}"
        ])
    return table(["case", "tolerance", *names, "all", "whole job"], rows)


def by_ranks(runs):
    rows = []
    found = of(runs, "ranks")
    for run in found:
        alone = next((r for r in found
                      if r.label("tolerance") == run.label("tolerance") and r.label("ranks") == 1),
                     None)
        if alone is None:
            raise Bad(f"{run.node.place}: no row of one rank to compare with")
        rows.append([
            run.case,
            power(run.label("tolerance")),
            f"{run.label('ranks'):.0f}",
            spread(run.solve),
            spread(run.wall),
            f"{alone.seconds / run.seconds:.2f}",
        ])
    return table(
        ["case", "tolerance", "ranks", "solve, s", "whole job, s", "speed-up of the solve"], rows)


def exponents(runs, x, *more):
    """Fitted exponents in `x` beside those of the model."""
    rows = [[
        "applications",
        fitted(x, [r.applications for r in runs]), "Σ τ",
        fitted(x, [r.phases for r in runs])
    ]]
    if all(r.timed for r in runs):
        rows.append([
            "solve, s",
            fitted(x, [r.seconds for r in runs]), "rows × applications",
            fitted(x, [r.work for r in runs])
        ])
    return table(["measured", "", "model", ""], [*rows, *more])


def growth(runs, name, what, value, unknown):
    """A table of runs over `value`, and the exponents."""
    found = of(runs, name)
    rows = columns(
        found,
        (unknown, what),
        ("Λ", lambda r: f"{r.span:.1f}"),
        ("modes", lambda r: f"{r.plan.positive('modes'):.0f}"),
        ("applications", lambda r: f"{r.applications:.0f}"),
        ("/ Σ τ", lambda r: f"{r.applications / r.phases:.2f}"),
        ("solve, s" + TIMED, lambda r: spread(r.solve)),
        ("ns a row and application" + TIMED, lambda r: f"{r.nanoseconds:.3f}"),
        ("80-byte model / triad" + TIMED, lambda r: f"{r.share:.2f}"),
        ("MiB a rank", lambda r: r.mebibytes),
    )
    return rows + f"\n\nExponents in {unknown}:\n\n" + exponents(found, [value(r) for r in found])


def by_points(runs):
    found = of(runs, "points")
    x = [r.label("points") for r in found]
    rows = columns(
        found,
        ("N_p", lambda r: f"{r.label('points'):.0f}"),
        ("modes", lambda r: f"{r.plan.positive('modes'):.0f}"),
        ("applications", lambda r: f"{r.applications:.0f}"),
        ("solve, s" + TIMED, lambda r: spread(r.solve)),
        ("distance to exp(AT)", lambda r: r.reached),
        ("MiB a rank", lambda r: r.mebibytes),
    )
    errors = fitted(x, [r.node.number("error_semidiscrete") for r in found])
    corner = ["distance to exp(AT)", errors, "order at a kink", "-1 to -2"]
    return rows + "\n\nExponents in N_p:\n\n" + exponents(found, x, corner)


def by_span(runs):
    found = of(runs, "span")
    tolerances = list(dict.fromkeys(r.label("tolerance") for r in found))
    # The growth allowed for differs a little with the tolerance.
    spans = sorted({round(r.span) for r in found})
    at = {(r.label("tolerance"), round(r.span)): r for r in found}
    rows = []
    for tolerance in tolerances:
        mine = [r for r in found if r.label("tolerance") == tolerance]
        cells = [
            f"{r.plan.number('modes'):.0f} / {r.applications:.0f}" if (r := at.get(
                (tolerance, s))) else "–" for s in spans
        ]
        upper = [r for r in mine if r.span > 100]
        exponent = fitted([r.span for r in upper], [r.applications for r in upper])
        rows.append([power(tolerance), *cells, exponent])
    header = ["tolerance", *(f"Λ = {s}" for s in spans), "exponent of the applications, Λ > 100"]
    return f"Profile `{found[0].plan.text('profile')}`; modes / applications.\n\n" + table(
        header, rows)


def by_digits(runs):
    found = of(runs, "digits")
    rows = [[power(r.label("tolerance")), f"{r.plan.number('modes'):.0f}", f"{r.applications:.0f}"]
            for r in found]
    loose = [r for r in found if r.label("tolerance") > 0.5e-9]
    digits = [math.log(1 / r.label("tolerance")) for r in loose]
    modes = fitted(digits, [r.plan.number("modes") for r in loose])
    applications = fitted(digits, [r.applications for r in loose])
    return (table(["tolerance", "modes", "applications"], rows) +
            "\n\nFrom 1e-2 to 1e-9, exponent in ln 1/ε: "
            f"modes {modes}, applications {applications}.")


# --- peers ----------------------------------------------------------------------------------------


def over(peer, mine):
    """Ratio of the medians, and the range that both spreads allow."""
    ratio = short(median(peer) / median(mine))
    if len(peer) == len(mine) == 1:
        return ratio
    return f"{ratio} ({short(min(peer) / max(mine))}–{short(max(peer) / min(mine))})"


def by_peer(peers):
    mine = peers["phasewarp"]
    solve, wall, alone = mine.times("solve2"), mine.times("wall2"), mine.times("solve1")
    count = peers.positive("modes")
    rows, best = [], None
    for peer in peers["peers"]:
        seconds = peer.times("seconds")
        if best is None or median(seconds) < median(best[1]):
            best = (peer, seconds)
        modes = peer.positive("modes")
        how = f"{peer.number('processes')} × {peer.number('threads')}"
        checked = f"{peer.number('field_error'):.1e}" if peer.has("field_error") else "by mode"
        rows.append([
            peer.text("name"), how,
            f"{modes:.0f}" + ("" if modes == count else f" of {count:.0f}, scaled"),
            spread(seconds), checked,
            over(seconds, solve),
            over(seconds, wall)
        ])
    if best is None:
        raise Bad(f"{peers.place}: no peers")
    versions = ", ".join(f"{k} {v}" for k, v in peers["versions"].value.items())
    cells = peers.number("cells")
    text = [
        f"Example 1, {cells}², tolerance {power(peers.positive('tolerance'))}, {count:.0f} modes, "
        f"{peers.number('applications'):.0f} applications (the Chebyshev peers, by their count: "
        f"{peers.number('peer_applications'):.0f}); rounds: {peers.number('rounds')}; "
        f"commit {peers.text('commit')}, cores at work before: {peers.number('load'):.1f}; "
        f"{versions}.",
    ]
    text += [f"Skipped: {line.value}." for line in peers["skipped"]]
    text = [prose(line) for line in text]
    text += [
        "",
        table(["", "solve, s", "whole job, s", "distance to exp(AT)"], [
            ["phasewarp, 2 ranks",
             spread(solve),
             spread(wall), f"{peers.number('error'):.1e}"],
            ["phasewarp, 1 rank",
             spread(alone),
             spread(mine.times("wall1")), "the same bits"],
        ]), "",
        table([
            "peer", "processes × threads", "modes", "seconds", "distance to exp(AT)", "/ solve",
            "/ whole job"
        ], rows), ""
    ]
    fastest = best[0]
    name = (f"{fastest.text('name')}, "
            f"{fastest.number('processes')} × {fastest.number('threads')}")
    classical, ours = peers.times("classical"), mine.times("classical_solve1")
    text += [limit_of_peers(peers, alone), ""]
    text.append(
        table(["comparison", "ratio", "goal"], [
            [
                f"best peer ({name}) / phasewarp's solve",
                over(best[1], solve),
                "20, met" if median(best[1]) >= 20 * median(solve) else "20, not met"
            ],
            [
                f"SciPy's classical `expm_multiply(A)`, {spread(classical)} s / phasewarp's solve",
                over(classical, solve),
                "1, met" if median(classical) >= median(solve) else "1, not met"
            ],
            [
                "best peer / the whole job of phasewarp, MPI's start included",
                over(best[1], wall), "none: the start of a peer's process is not counted"
            ],
            ["SciPy's classical / the whole job of phasewarp",
             over(classical, wall), "none"],
            [
                f"the same / phasewarp's own classical exponential, 1 rank, {spread(ours)} s",
                over(classical, ours), "none"
            ],
        ]))
    return "\n".join(text)


def limit_of_peers(peers, alone):
    """How near one core is to its peak, and what 20 times the best peer would take; the least of
    the seconds of both. An entry of a row is four multiply-adds, real and imaginary parts of S x
    and K x here, a complex product there; then there is the rest of a step."""
    entries, peak = peers.positive("entries_a_row"), peers.positive("peak")
    applied = peers.positive("cells")**2 * peers.positive("applications")
    [theirs] = [min(peer.times("seconds")) for peer in peers["peers"]
                if peer.text("name") == "NumPy Chebyshev, in place"
                and peer.number("processes") == 1]
    rows = []
    for name, others, seconds in (("phasewarp", 7, min(alone)),
                                  ("NumPy Chebyshev, in place", 4, theirs),
                                  ("20 times as fast as that", 7, theirs / 20)):
        work = 4 * entries + others
        rate = work * applied / seconds
        rows.append([name, f"{work:.1f}", f"{1e9 * seconds / applied:.3f}", f"{rate / 1e9:.1f}",
                     f"{rate / peak:.2f}"])
    rows.append(["a product of matrices", "–", "–", f"{peak / 1e9:.1f}", "1"])
    header = ["one core", "multiply-adds a row and application", "ns", "10⁹ a second",
              "of the peak"]
    return table(header, rows)


# --- example 3 ------------------------------------------------------------------------------------


def by_example3(folder):
    rows = []
    for n in (8, 16, 32, 64):
        s = load(os.path.join(folder, f"example3-{n}", "summary.json"))
        if s is None:
            rows.append([f"{n}⁴", *["not measured"] + ["–"] * 8])
            continue
        if s.number("cells") != n**4:
            raise Bad(f"{s.place}: {s.number('cells')} cells, {n**4} expected")
        planned, peak, ranks = (s.positive(k) for k in ("memory_planned_bytes_per_rank",
                                                        "memory_peak_bytes_per_rank", "ranks"))
        estimate = f"{s.number('error_estimate'):.1e}" if s.has("error_estimate") else "–"
        rows.append([
            f"{n}⁴",
            s.number("modes"),
            s.number("matvecs"),
            short(s.positive("solve_seconds")),
            short(s.positive("wall_seconds")),
            f"{ranks * peak / 2**30:.2f}, {ranks * planned / 2**30:.2f}",
            estimate,
            f"{s.number('error_density_l1'):.4f}",
            f"{s.number('error_velocity_l1'):.4f}",
            f"{s.number('mass'):.5f}",
        ])
    return table([
        "cells", "modes", "applications", "solve, s", "all, s", "GiB in all: measured, planned",
        "error estimate", "density, L1 to exact", "mean velocity, L1 to exact", "mass"
    ], rows)


# --- the picture ----------------------------------------------------------------------------------


def body(text, name, path):
    """The cells of the lines of tables between the markers, headers included."""
    found = re.search(rf"<!-- begin {name} -->\n(.*?)<!-- end {name} -->", text, re.DOTALL)
    if found is None:
        raise Bad(f"{path}: markers 'begin {name}', 'end {name}' expected")
    lines = [line for line in found[1].splitlines() if line.startswith("| ")]
    return [[cell.strip() for cell in line.strip("|").split("|")] for line in lines]


def draw_peers(text, document):
    """Seconds of other programs beside phasewarp's, by the tables of the document; False where
    there is no Matplotlib."""
    try:
        import matplotlib
    except ImportError:
        return False
    matplotlib.use("svg")
    matplotlib.rcParams |= {"svg.hashsalt": "phasewarp", "svg.fonttype": "none", "font.size": 9}
    import matplotlib.pyplot as plt

    figure, (left, right) = plt.subplots(1, 2, figsize=(10, 4.4))
    seconds = lambda cell: float(cell.split()[0])
    bars = [(line[0], seconds(line[1])) for line in body(text, "peers", document)
            if line[0].startswith("phasewarp, ")]
    bars += [(f"{line[0]}, {line[1]}", seconds(line[3])) for line in body(text, "peers", document)
             if re.match(r"\d+ × \d+$", line[1])]
    bars.sort(key=lambda bar: -bar[1])
    colors = ["C1" if name.startswith("phasewarp") else "C0" for name, _ in bars]
    left.barh([name for name, _ in bars], [value for _, value in bars], color=colors)
    left.set(xscale="log", xlabel="seconds to solve", title="The same modes: example 1, 1e-9")
    left.tick_params(axis="y", labelsize=6)
    lines = [line for line in body(text, "galerkin", document) if re.match(r"\de", line[0])]
    for name, marker in zip(dict.fromkeys(line[2] for line in lines), "os^vD"):
        mine = [line for line in lines if line[2] == name]
        right.plot([float(line[4]) for line in mine], [seconds(line[6]) for line in mine],
                   marker=marker, markersize=4, linewidth=1, label=name)
    right.set(xscale="log", yscale="log", xlabel="error reached, relative L2",
              ylabel="seconds to solve", title="The same physics: a beam in a constant force")
    right.invert_xaxis()
    right.grid(True, which="major", linewidth=0.3)
    right.legend(fontsize=7)
    figure.tight_layout()
    path = os.path.join(os.path.dirname(document), "peers.svg")
    figure.savefig(path, metadata={"Date": None})
    return True


# --- the document ---------------------------------------------------------------------------------


def replaced(text, name, content, path):
    pattern = re.compile(rf"(<!-- begin {name} -->\n).*?(<!-- end {name} -->)", re.DOTALL)
    if len(pattern.findall(text)) != 1:
        raise Bad(f"{path}: one pair of markers 'begin {name}', 'end {name}' expected")
    return pattern.sub(lambda m: f"{m[1]}\n{content}\n\n{m[2]}", text)


def rates(path):
    """The table of the inner loop, from what `cargo bench --bench application` printed."""
    number = r"([\d.]+)"
    rate = rf": {number} ns a row, mode and step, {number} us a mode; {number} of the triad"
    rate += rf"[^;]*; {number} of the FMA peak"
    shape = r"\d+ steps, strips of \d+, \d+ ranges"
    plain, blocked, head = {}, {}, None
    with open(path, encoding="utf-8") as file:
        for line in file:
            if line.startswith("triad: "):
                head = line.strip().removeprefix("triad: ")
            elif found := re.match(rf"(.+), step after step{rate}", line):
                plain[found[1]] = found.groups()[1:]
            elif found := re.match(rf"(.+), ({shape}) of velocities{rate}.*; {number} times", line):
                # Of several candidates the fastest, which a run takes.
                blocked[found[1]] = max(found.groups()[1:], blocked.get(found[1], ()),
                                        key=lambda groups: float(groups[-1]) if groups else 0.0)
    if head is None or not plain:
        raise Bad(f"{path}: no line about the triad, or none about a grid")
    rows = []
    for grid, measured in plain.items():
        rows.append([grid, *measured, *blocked.get(grid, ("in cache: not blocked", *["–"] * 5))])
    each = ["ns a row, mode and step", "µs a mode", "of the triad", "of the FMA peak"]
    header = ["grid", f"step by step: {each[0]}", *each[1:], "blocked", *each, "speed-up"]
    return prose(f"Triad: {head}.") + "\n\n" + table(header, rows)


def main():
    parser = argparse.ArgumentParser()
    parser.add_argument("--results", default=os.path.join(ROOT, "results/bench"))
    parser.add_argument("--example3", default=os.path.join(ROOT, "results"))
    parser.add_argument("--document", default=os.path.join(ROOT, "docs/performance.md"))
    parser.add_argument("--only", choices=["example3", "error", "peers"], help="this table alone")
    options = parser.parse_args()
    content = {}
    programs = None
    if options.only not in ("example3", "peers"):
        programs = load(os.path.join(options.results, "programs.json"))
    if programs is not None and options.only == "error":
        runs = [Run(node) for node in programs["rows"]]
        content["error"] = by_error(runs, programs["machine"])
    elif programs is not None:
        runs = [Run(node) for node in programs["rows"]]
        number = lambda name: lambda run: run.label(name)
        content |= {
            "machine": machine(programs),
            "tolerance": by_tolerance(runs),
            "error": by_error(runs, programs["machine"]),
            "cells": growth(runs, "cells",
                            lambda r: f"{r.label('cells'):.0f}², {r.cells:.0f} computed",
                            lambda r: r.cells, "cells"),
            "cells4": growth(runs, "cells4",
                             lambda r: f"{r.label('cells'):.0f}⁴, {r.cells:.0f} computed",
                             lambda r: r.cells, "cells"),
            "time": growth(runs, "time", lambda r: f"{r.label('time'):g}", number("time"), "T"),
            "points": by_points(runs),
            "span": by_span(runs),
            "digits": by_digits(runs),
        }
        if all(run.timed for run in runs if run.solved):
            content |= {"parts": parts(runs), "ranks": by_ranks(runs)}
    if not options.only and os.path.exists(
            path := os.path.join(options.results, "application.txt")):
        content["rates"] = rates(path)
    peers = None
    if options.only in (None, "peers"):
        peers = load(os.path.join(options.results, "peers.json"))
    if peers is not None:
        content["peers"] = by_peer(peers)
    if options.only in (None, "example3") and any(
            os.path.exists(os.path.join(options.example3, f"example3-{n}", "summary.json"))
            for n in (8, 16, 32, 64)):
        content["example3"] = by_example3(options.example3)
    with open(options.document, encoding="utf-8") as file:
        text = file.read()
    for name in re.findall(r"<!-- begin (\S+) -->", text):
        if name not in content and not options.only:
            print(f"report: {name}: not measured, left as it was")
    for name, table_text in content.items():
        text = replaced(text, name, table_text, options.document)
    with open(options.document, "w", encoding="utf-8") as file:
        file.write(text)
    print(f"report: {', '.join(content) or 'nothing'} written into {options.document}")
    if options.only in (None, "peers") and not draw_peers(text, options.document):
        print("report: no Matplotlib: peers.svg stays as it was")


if __name__ == "__main__":
    try:
        main()
    except (Bad, OSError) as error:
        sys.exit(f"report: {error}")
