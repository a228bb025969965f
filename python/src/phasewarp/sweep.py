"""Many runs of one case, as one table."""

from __future__ import annotations

import difflib
import itertools
import json
import math
import re
import sys
import warnings
from collections.abc import Iterable, Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd

from phasewarp.case import Case, plain
from phasewarp.commands import CaseLike, Mode, as_case, refuse_unknown_mode, run
from phasewarp.program import CaseError, PhasewarpError, PhasewarpWarning, StrPath, call
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
    "accuracy.grid_source",
    "verdict",
    "mass",
    "solve_seconds",
    "wall_seconds",
    "memory_peak_bytes_per_rank",
)

_ENTRIES = """
accuracy cells checkpoints checksum continued decay_bound distinct_rows error_density_l1
error_density_l1_relative error_density_l2 error_density_l2_relative error_estimate
error_estimate_reliable error_l1 error_l1_relative error_l2 error_l2_relative error_momentum_l1
error_momentum_l1_relative error_momentum_l2 error_momentum_l2_relative error_semidiscrete
error_velocity_l1 exact_density_error exact_field_error exact_l1 exact_l2 fields files git
group_seconds growth_bound growth_certificate imbalance inflow_unknowns instruction_set interface
kinetic_energy ledger mass mass_exact mass_initial matvecs matvecs_here maximum
memory_anonymous_bytes_per_rank memory_peak_bytes_per_rank memory_planned_bytes_per_rank method
minimum minimum_before_limiting missed mode_groups modes norm_kept norm_ratio norm_ratio_planned
points potential_energy probabilities ranks readout reductions resumed seconds solve_seconds solves
space_blocks step_error time_error time_steps title tolerance unitarity_defect verdict version
wall_seconds warnings weight_spread weight_sweeps
"""
#: First parts of the keys of `columns`: the entries of `summary.json` (docs/usage.md).
ENTRIES = frozenset(_ENTRIES.split())


def sweep(
    case: CaseLike,
    vary: Mapping[str, Iterable[Any]],
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

    What cannot give a table is refused before the first run, as the command refuses it: values of
    which no combination is a case, such as those of an unknown key, and unknown `columns`.

    Parameters
    ----------
    case
        The case, or its file.
    vary
        Lists of values by dotted key, as
        ``{"scheme.degree": [1, 2], "solver.tolerance": [1e-3, 1e-6]}``. The last key varies
        fastest.
    directory
        Where the directories of the runs go.
    ranks, mode, program
        As for :func:`phasewarp.run`.
    timeout
        Seconds that each run may take.
    columns
        Entries of `summary.json`, dotted where they are nested; docs/usage.md lists them. By
        default some, without those that no run knows.
    progress
        Whether to write a line a run on standard error.

    Returns
    -------
    pandas.DataFrame
        Columns: the keys of `vary`, `columns`, ``warnings`` and ``error`` where there are any,
        ``directory``. ``to_csv`` writes it to a file; :func:`latex` makes a table for an article
        of it.

    Raises
    ------
    CaseError
        Before the first run, if no combination is a case: what is wrong with the first one.
    ValueError
        If values are no list, for unknown `columns`, and for an unknown `mode`.
    """
    points = combinations(vary)
    refuse_unknown(columns)
    refuse_unknown_mode(mode)
    case = as_case(case)
    cases = [case.replace(point) for point in points]
    refuse_all_wrong(cases, program)
    rows = []
    summaries = []
    for number, (point, one) in enumerate(zip(points, cases, strict=True), start=1):
        place = Path(directory) / run_name(one, point, mode)
        before = written(place)
        found = solve(one, place, ranks=ranks, mode=mode, timeout=timeout, program=program)
        row: dict[str, Any] = {**point, **dict.fromkeys((*columns, "warnings", "error"))}
        if isinstance(found, PhasewarpError):
            row["error"] = said = str(found)
        else:
            summaries.append(found.summary)
            row.update({name: entry(found.summary, name) for name in columns})
            row["warnings"] = "; ".join(found.summary["warnings"]) or None
            kept = before is not None and written(place) == before
            said = "finished before" if kept else f"{found.summary['wall_seconds']:.2f} s"
        rows.append({**row, "directory": str(place)})
        if progress:
            shown = " ".join(f"{key}={value}" for key, value in point.items())
            print(f"[{number}/{len(points)}] {shown}: {said}", file=sys.stderr, flush=True)
    warn_of_absent(columns, summaries)
    table = pd.DataFrame(rows)
    by_default = columns if columns is COLUMNS else ()
    optional = [name for name in (*by_default, "warnings", "error") if name not in vary]
    return table.drop(columns=[name for name in optional if table[name].isna().all()])


def combinations(vary: Mapping[str, Iterable[Any]]) -> list[dict[str, Any]]:
    """Return every combination of values by key; the last key varies fastest."""
    lists = {}
    for key, values in vary.items():
        if isinstance(values, str | bytes | Mapping) or not isinstance(values, Iterable):
            kinds = {str: "a text", bytes: "bytes"}
            found = kinds.get(type(values), "a table" if isinstance(values, Mapping) else "")
            raise ValueError(f"{key}: a list of values expected, not {found or repr(values)}")
        lists[key] = list(values)
    if not lists or not all(lists.values()):
        raise ValueError("vary: at least one key with at least one value expected")
    return [dict(zip(lists, point, strict=True)) for point in itertools.product(*lists.values())]


def refuse_unknown(columns: Sequence[str]) -> None:
    """Raise `ValueError` for columns that no `summary.json` has."""
    if isinstance(columns, str):
        raise ValueError(f"columns: a list of entries of summary.json expected, not {columns!r}")
    for name in columns:
        first = name.split(".", 1)[0]
        if first not in ENTRIES:
            near = difflib.get_close_matches(first, ENTRIES, 1)
            hint = f' (did you mean "{near[0]}"?)' if near else ""
            raise ValueError(f"columns: summary.json has no entry {name}{hint}")


def warn_of_absent(columns: Sequence[str], summaries: Sequence[dict[str, Any]]) -> None:
    """Warn of nested columns that no summary has, though each has what they are part of."""
    for name in columns:
        whole, _, part = name.rpartition(".")
        tables = [entry(summary, whole) for summary in summaries] if whole else []
        if not tables or not all(isinstance(table, dict) for table in tables):
            continue
        known = sorted({key for table in tables for key in table})
        if part not in known and name not in COLUMNS:
            near = difflib.get_close_matches(part, known, 1)
            hint = f'did you mean "{near[0]}"?' if near else "it has " + ", ".join(known)
            message = f"columns: {whole} has no entry {part} in any run ({hint})"
            warnings.warn(message, PhasewarpWarning, stacklevel=3)


def refuse_all_wrong(cases: Iterable[Case], program: StrPath | None) -> None:
    """Raise the first case's `CaseError` if the program takes none of the cases."""
    first: CaseError | None = None
    for case in cases:
        with warnings.catch_warnings(), case.arguments() as words:
            warnings.simplefilter("ignore", PhasewarpWarning)
            try:
                call(["check", *words], program=program)
                return
            except CaseError as error:
                first = first or error
    if first is not None:
        raise first


def solve(case: Case, place: Path, **options: Any) -> Result | PhasewarpError:
    """Run a case, or continue it; return its failure, and leave warnings to the summary."""
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", PhasewarpWarning)
        try:
            return run(case, place, resume=True, **options)
        except PhasewarpError as error:
            return error


def written(place: Path) -> int | None:
    """Return when the result in a directory was written; none where there is none."""
    try:
        return (place / "result.h5").stat().st_mtime_ns
    except OSError:
        return None


def latex(table: pd.DataFrame) -> str:
    r"""Return a table as a LaTeX ``tabular`` for the package booktabs.

    It looks like the ``table.tex`` of ``phasewarp sweep``: numbers have four digits, small and
    large ones as ``$2.9 \times 10^{-7}$``, names are escaped, what is missing is ``--``. The
    columns ``warnings``, ``error`` and ``directory`` are left out.

    Examples
    --------
    >>> Path("table.tex").write_text(pw.latex(table))
    """
    shown = table.drop(columns=["warnings", "error", "directory"], errors="ignore")
    columns = [shown[name].tolist() for name in shown.columns]
    sides = "".join("l" if any(map(is_text, cells)) else "r" for cells in columns)
    head = " & ".join(latex_text(str(name)) for name in shown.columns)
    rows = [" & ".join(map(latex_cell, row)) + r" \\" for row in zip(*columns, strict=True)]
    begin = [rf"\begin{{tabular}}{{{sides}}}", r"\toprule", head + r" \\", r"\midrule"]
    return "\n".join([*begin, *rows, r"\bottomrule", r"\end{tabular}"]) + "\n"


def is_text(value: Any) -> bool:
    """Return whether a cell of a table is no number."""
    return isinstance(value, str | list)


def latex_cell(value: Any) -> str:
    """Return a value of a table in LaTeX."""
    if isinstance(value, bool | np.bool_ | str | list | dict):
        return latex_text(value if isinstance(value, str) else as_json(plain(value)))
    if value is None or pd.isna(value):
        return "--"
    text = str(value) if isinstance(value, int | np.integer) else short(float(value))
    digits, _, exponent = text.partition("e")
    if not exponent:
        return f"${text}$"
    power = f"10^{{{int(exponent)}}}"
    return f"${power}$" if digits == "1" else rf"${digits} \times {power}$"


def short(value: float) -> str:
    """Return four digits, without trailing zeros."""
    if value == 0 or not np.isfinite(value):
        return f"{value:.0f}"
    if 1e-3 <= abs(value) < 1e5:
        decimals = max(0, 3 - math.floor(math.log10(abs(value))))
        text = f"{value:.{decimals}f}"
        return text.rstrip("0").rstrip(".") if "." in text else text
    digits, _, exponent = f"{value:.3e}".partition("e")
    return f"{digits.rstrip('0').rstrip('.')}e{exponent}"


def latex_text(text: str) -> str:
    """Return text in LaTeX."""
    names = {
        "\\": r"\textbackslash{}",
        "^": r"\textasciicircum{}",
        "~": r"\textasciitilde{}",
        "<": r"\textless{}",
        ">": r"\textgreater{}",
        "\n": " ",
    }
    names |= {sign: "\\" + sign for sign in "&%$#_{}"}
    return "".join(names.get(sign, sign) for sign in text)


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
