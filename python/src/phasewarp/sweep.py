"""Many runs of one case, as one table."""

from __future__ import annotations

import itertools
import json
import re
import sys
import warnings
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd

from phasewarp.case import Case
from phasewarp.commands import CaseLike, Mode, as_case, run
from phasewarp.program import PhasewarpError, PhasewarpWarning, StrPath
from phasewarp.result import Result, entry

#: Entries of `summary.json` in a table, by default; those that no run knows are left out.
COLUMNS = (
    "cells",
    "modes",
    "matvecs",
    "error_estimate",
    "error_semidiscrete",
    "error_l1_relative",
    "error_density_l1_relative",
    "accuracy.grid",
    "mass",
    "solve_seconds",
    "wall_seconds",
    "memory_peak_bytes_per_rank",
)


def sweep(
    case: CaseLike,
    vary: Mapping[str, Sequence[Any]],
    directory: StrPath,
    *,
    ranks: int = 1,
    columns: Sequence[str] = COLUMNS,
    mode: Mode | None = None,
    timeout: float | None = None,
    program: StrPath | None = None,
    progress: bool = True,
) -> pd.DataFrame:
    """Run a case with every combination of values, and return one row a run.

    Every run has a directory of its own, named after its values and a checksum of its whole case,
    as the command ``phasewarp sweep`` names it: each goes on with what the other has done. So a
    sweep that was interrupted, or that has grown by a value, goes on where it was: finished
    runs of the same case are recognised by the program and not repeated, and one that was
    interrupted continues from its checkpoint. A run that fails does not end the sweep: its row has
    the message in the column ``error``.

    Parameters
    ----------
    case
        The case, or its file.
    vary
        Values by dotted key, as ``{"scheme.degree": [1, 2], "solver.tolerance": [1e-3, 1e-6]}``.
        The last key varies fastest.
    directory
        Where the directories of the runs go.
    ranks, mode, program
        As for :func:`phasewarp.run`.
    timeout
        Seconds that each run may take.
    columns
        Entries of `summary.json`, dotted where they are nested; docs/usage.md lists them.
    progress
        Whether to write a line a run on standard error.

    Returns
    -------
    pandas.DataFrame
        Columns: the keys of `vary`, those of `columns` that any run knows, ``warnings`` and
        ``error`` where there are any, ``directory``. ``to_csv`` and ``to_latex`` write it to a
        file.
    """
    if not vary or any(len(values) == 0 for values in vary.values()):
        raise ValueError("vary: at least one key with at least one value expected")
    case = as_case(case)
    rows = []
    combinations = list(itertools.product(*vary.values()))
    for number, values in enumerate(combinations, start=1):
        point = dict(zip(vary, values, strict=True))
        one = case.replace(point)
        place = Path(directory) / run_name(one, point, mode)
        found = solve(one, place, ranks=ranks, mode=mode, timeout=timeout, program=program)
        row: dict[str, Any] = {**point, **dict.fromkeys((*columns, "warnings", "error"))}
        if isinstance(found, PhasewarpError):
            row["error"] = said = str(found)
        else:
            row.update({name: entry(found.summary, name) for name in columns})
            row["warnings"] = "; ".join(found.summary["warnings"]) or None
            said = f"{found.summary['wall_seconds']:.2f} s"
        rows.append({**row, "directory": str(place)})
        if progress:
            shown = " ".join(f"{key}={value}" for key, value in point.items())
            print(f"[{number}/{len(combinations)}] {shown}: {said}", file=sys.stderr, flush=True)
    table = pd.DataFrame(rows)
    optional = [name for name in (*columns, "warnings", "error") if name not in vary]
    return table.drop(columns=[name for name in optional if table[name].isna().all()])


def solve(case: Case, place: Path, **options: Any) -> Result | PhasewarpError:
    """Run a case, or continue it; return its failure, and leave warnings to the summary."""
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", PhasewarpWarning)
        try:
            return run(case, place, resume=True, **options)
        except PhasewarpError as error:
            return error


def run_name(case: Case, point: Mapping[str, Any], mode: Mode | None) -> str:
    """Return the name of a run's directory, as ``phasewarp sweep`` names it."""
    words = []
    for key in point:
        value = case[key]
        shown = value if isinstance(value, str) else as_json(value)
        words.append(f"{key.rsplit('.', 1)[-1]}={shown}")
    values = re.sub(r"[^A-Za-z0-9.,=+_-]+", "-", "_".join(words))[:80]
    return f"{values}_{checksum(as_json([case.to_dict(), mode]).encode()):016x}"


def as_json(value: Any) -> str:
    """Return JSON without blanks, keys in order."""
    return json.dumps(value, sort_keys=True, ensure_ascii=False, separators=(",", ":"))


def checksum(text: bytes) -> int:
    """Return the checksum of docs/usage.md, "result.h5", of a text."""
    z = np.frombuffer(text, np.uint8).astype(np.uint64)
    z += np.arange(1, len(text) + 1, dtype=np.uint64) * np.uint64(0x9E3779B97F4A7C15)
    for shift, factor in ((30, 0xBF58476D1CE4E5B9), (27, 0x94D049BB133111EB)):
        z = (z ^ (z >> np.uint64(shift))) * np.uint64(factor)
    return int((z ^ (z >> np.uint64(31))).sum(dtype=np.uint64))
