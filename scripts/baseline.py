#!/usr/bin/env python3
"""What scripts/baseline.sh keeps of runs, and how it compares two of them; see there for the rules.

Usage: baseline.py record RESULTS RECORDS   from RESULTS/NAME.RANKS/ to RECORDS/NAME.RANKS.json
       baseline.py compare OLD NEW [--some] [--words]   --some: NEW may lack runs that OLD has

A record maps places ("result.h5:/f", "summary.json:fields.0.minimum") to values. A value that a run
may change is kept as UNCOMPARED, so that its loss is seen; a text as its numbers and its words.
"""

import argparse
import csv
import hashlib
import json
import os
import re
import sys
import tomllib

import h5py
import numpy as np

UNCOMPARED = "(not compared)"
MOST_LINES = 12
LONGEST_VALUE = 60

# Keys, attributes and columns that depend on the clock, the machine, or the program's version.
VARIABLE = re.compile(
    r".*seconds.*|timings|memory_(?:(?:peak|anonymous)_)?bytes_per_rank|instruction_set"
    r"|checkpoints|best|best_classical|version|git|command|date|program|rustc|mpi|hdf5|front_.*"
    # Of whole files, whose attributes have the date and the command. Bits of datasets are compared.
    r"|checksum"
    # Sentences with seconds of other methods.
    r"|verdict"
)
# Those that may be others on other ranks.
OF_RANKS = re.compile(
    r"ranks|space_blocks|mode_groups|imbalance|matvecs_here|memory_planned_bytes_per_rank"
    r"|distinct_rows|layout"
)
# HDF5's own attributes.
INTERNAL = {"DIMENSION_LIST", "REFERENCE_LIST", "CLASS", "NAME", "_Netcdf4Dimid"}
NUMBER = re.compile(r"(?<![-\w./])[-+]?\d+(?:\.\d+)?(?:e[-+]?\d+)?(?!\w|\.\d)")
SECONDS = re.compile(r"[-+]?\d[\d.]*(?:e[-+]?\d+)? (?:ms|s|min|h|seconds|minutes|hours)\b")
# The columns of chart.csv that say what was tried.
KNOBS = ("as_given", "points")


def main():
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    tasks = parser.add_subparsers(dest="task", required=True)
    task = tasks.add_parser("record")
    task.add_argument("results")
    task.add_argument("records")
    task = tasks.add_parser("compare")
    task.add_argument("old")
    task.add_argument("new")
    task.add_argument("--some", action="store_true")
    task.add_argument("--words", action="store_true")
    options = parser.parse_args()
    if options.task == "record":
        return record(options.results, options.records)
    return compare(options)


# --- recording ---


def record(results, records):
    os.makedirs(records, exist_ok=True)
    for run in sorted(os.listdir(results)):
        text = json.dumps(of_run(os.path.join(results, run)), indent=0, ensure_ascii=False)
        # The place of temporary files is no result.
        text = text.replace(results, "RESULTS")
        with open(os.path.join(records, run + ".json"), "w", encoding="utf-8") as file:
            file.write(text + "\n")
    return 0


def of_run(directory):
    """Everything that one run left, by place."""
    values = {}
    for folder, _, names in os.walk(directory):
        for name in names:
            path = os.path.join(folder, name)
            place = os.path.relpath(path, directory)
            read = READERS.get(name) or READERS.get(os.path.splitext(name)[1])
            values.update(read(path, place) if read else {place: UNCOMPARED})
    if values["exit"] == "0":
        # Progress; warnings are in summary.json.
        del values["stderr"]
    # What is printed has seconds; the file has them in columns of their own.
    if any(place.startswith(("chart.csv:", "table.csv:")) for place in values):
        values["stdout"] = UNCOMPARED
    return dict(sorted(values.items()))


def of_hdf5(path, place):
    values = {}

    def add(key, item):
        for attribute, value in item.attrs.items():
            if attribute not in INTERNAL:
                variable = key == "timings" or VARIABLE.fullmatch(attribute)
                text = UNCOMPARED if variable else of_text(str(value))
                values[f"{place}:/{key}@{attribute}"] = text
        if not isinstance(item, h5py.Dataset):
            return
        value = item[()]
        if key == "case":
            values.update(flat(tomllib.loads(value.decode()), f"{place}:/case"))
        elif key == "plan":
            values.update(flat(json.loads(value), f"{place}:/plan"))
        else:
            chunks = f", chunks {item.chunks} {item.compression}" if item.chunks else ""
            values[f"{place}:/{key}"] = of_array(value) + chunks

    with h5py.File(path) as file:
        add("", file)
        file.visititems(add)
    return values


def of_array(array):
    """Type, shape, checksum of the bits, and the norm, for who reads the difference."""
    digest = hashlib.sha256(np.ascontiguousarray(array).tobytes()).hexdigest()[:12]
    norm = np.sqrt(np.nansum(np.abs(array) ** 2.0))
    return f"{array.dtype.str} {list(array.shape)} {digest} norm {float(norm)!r}"


def of_json(path, place):
    with open(path, encoding="utf-8") as file:
        return flat(json.load(file), place)


def of_csv(path, place):
    with open(path, encoding="utf-8", newline="") as file:
        return flat(list(csv.DictReader(file)), place)


def of_chart(path, place):
    """Trials by what was tried, as places that other charts may lack; see `compare`."""
    with open(path, encoding="utf-8", newline="") as file:
        rows = csv.DictReader(file)
        columns = list(rows.fieldnames)
        knobs = columns[columns.index(KNOBS[0]) : columns.index(KNOBS[1]) + 1]
        values = {f"{place}:columns": " ".join(columns)}
        for row in rows:
            if row["status"] == "done":
                trial = " ".join(row[knob] or "-" for knob in knobs)
                numbers = {key: row[key] for key in columns if key not in knobs}
                values.update(flat(numbers, f"{place}~{trial}"))
    return values


def of_chart_json(path, place):
    """Names of fields; the numbers are those of chart.csv."""
    fields = (re.sub(r"\.\d+", "", key) for key in of_json(path, place))
    return dict.fromkeys(fields, UNCOMPARED)


def of_output(path, place):
    with open(path, encoding="utf-8", errors="replace") as file:
        text = file.read()
    if text.startswith("{"):
        return flat(json.loads(text), place)
    # After a rule follows what mpirun says of a rank that failed.
    text = re.split(r"^-{20,}$", text, maxsplit=1, flags=re.MULTILINE)[0]
    return {place: of_text(SECONDS.sub("", text).strip())}


def of_numpy(path, place):
    return {place: of_array(np.load(path))}


def of_bytes(path, place):
    with open(path, "rb") as file:
        content = file.read()
    return {place: f"{len(content)} bytes {hashlib.sha256(content).hexdigest()[:12]}"}


# By name or by ending; of any other file the presence counts.
READERS = {
    "stdout": of_output,
    "stderr": of_output,
    "exit": of_output,
    "chart.csv": of_chart,
    "chart.json": of_chart_json,
    ".h5": of_hdf5,
    ".json": of_json,
    ".csv": of_csv,
    ".npy": of_numpy,
    ".xdmf": of_bytes,
    ".mtx": of_bytes,
    ".qasm": of_bytes,
}


def flat(tree, place):
    """The leaves of a tree of JSON, by their keys joined with dots."""
    if isinstance(tree, (dict, list)) and tree:
        values = {}
        for key, item in tree.items() if isinstance(tree, dict) else numbered(tree):
            inner = f"{place}{'.' if ':' in place else ':'}{key}"
            variable = VARIABLE.fullmatch(str(key))
            values.update({inner: UNCOMPARED} if variable else flat(item, inner))
        return values
    return {place: of_text(tree) if isinstance(tree, str) else json.dumps(tree)}


def numbered(items):
    """Items of a list by their names, where each has its own, or by their numbers."""
    names = [item.get("name") if isinstance(item, dict) else None for item in items]
    return zip(range(len(items)) if None in names or len(set(names)) < len(names) else names, items)


def of_text(text):
    """A text of several words as its numbers and its words, a single word as it is."""
    if re.search(r"\s", text):
        return {"numbers": " ".join(NUMBER.findall(text)), "words": text}
    return text


# --- comparing ---


def compare(options):
    old, new = load(options.old), load(options.new)
    differing = 0
    for run in sorted(old.keys() | new.keys(), key=lambda run: (run not in new, run)):
        if run not in old:
            print(f"{shown(run)}: not in {options.old}, so not compared")
        elif run in new:
            lines = [line for _, line in differences(old[run], new[run], options.words)]
            differing += bool(lines)
            print_some(shown(run), lines)
        elif not options.some:
            differing += 1
            print(f"{shown(run)}: was not run")
    before = between_ranks(old)
    for run, places in between_ranks(new).items():
        lines = [line for place, line in places.items() if place not in before.get(run, ())]
        print_some(f"{run}, 1 and 3 ranks differ", lines)
    print(f"baseline: {differing} of {len(new)} runs differ")
    return 1 if differing else 0


def load(directory):
    records = {}
    for name in os.listdir(directory):
        if name.endswith(".json"):
            with open(os.path.join(directory, name), encoding="utf-8") as file:
                records[name[: -len(".json")]] = json.load(file)
    return records


def differences(old, new, words):
    for place in sorted(old.keys() | new.keys()):
        before, after = old.get(place), new.get(place)
        if before == after or ("~" in place and (before is None or after is None)):
            continue
        if isinstance(before, dict) and isinstance(after, dict):
            part = "words" if words else "numbers"
            before, after = before[part], after[part]
        if before != after:
            yield place, "{}: {} -> {}".format(place, *shortened(text(before), text(after)))


def between_ranks(records):
    """By run the places at which values differ between 1 and 3 ranks, with what differs."""
    found = {}
    for run, values in records.items():
        name, ranks = run.rsplit(".", 1)
        other = records.get(f"{name}.3") if ranks == "1" else None
        if other:
            places = dict(differences(values, other, words=False))
            found[name] = {place: places[place] for place in places if not of_ranks(place)}
    return found


def of_ranks(place):
    return any(OF_RANKS.fullmatch(key) for key in re.split(r"[.:@/]", place))


def text(value):
    if value is None:
        return "nothing"
    return value["words"] if isinstance(value, dict) else value


def shortened(before, after):
    """Both texts from shortly before they part."""
    if max(len(before), len(after)) <= LONGEST_VALUE:
        return before, after
    start = max(0, len(os.path.commonprefix([before, after])) - LONGEST_VALUE // 3)
    return tuple(
        ("…" if start else "") + part[start : start + LONGEST_VALUE].replace("\n", " ")
        for part in (before, after)
    )


def shown(run):
    name, ranks = run.rsplit(".", 1)
    return f"{name}, {ranks} rank{'s' if ranks != '1' else ''}"


def print_some(title, lines):
    for line in lines[:MOST_LINES]:
        print(f"{title}: {line}")
    if len(lines) > MOST_LINES:
        print(f"{title}: and {len(lines) - MOST_LINES} more")


if __name__ == "__main__":
    sys.exit(main())
