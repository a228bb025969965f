"""Sweeps: their table, and what is not run again."""

from __future__ import annotations

import re
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd
import pytest
from conftest import CASES

import phasewarp as pw
from phasewarp.program import call
from phasewarp.sweep import ENTRIES, run_name


def test_table(small: pw.Case, tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    vary: dict[str, list[float]] = {"scheme.degree": [0, 1], "solver.tolerance": [1e-2, 1e-4]}
    table = pw.sweep(small, vary, tmp_path)
    assert table["scheme.degree"].tolist() == [0, 0, 1, 1]
    assert table["solver.tolerance"].tolist() == [1e-2, 1e-4, 1e-2, 1e-4]
    assert "error" not in table and "error_semidiscrete" not in table
    assert (table["error_estimate"] < table["solver.tolerance"]).all()
    for _, row in table.iterrows():
        summary = pw.Result(row["directory"]).summary
        assert summary["tolerance"] == row["solver.tolerance"]
        assert summary["accuracy"]["grid"] == row["accuracy.grid"]
    lines = capsys.readouterr().err.splitlines()
    assert len(lines) == 4
    assert lines[1].startswith("[2/4] scheme.degree=0 solver.tolerance=0.0001: ")
    table.to_csv(tmp_path / "table.csv", index=False)
    again = pd.read_csv(tmp_path / "table.csv")
    pd.testing.assert_frame_equal(again, table, check_dtype=False)
    pw.sweep(small, vary, tmp_path)
    lines = capsys.readouterr().err.splitlines()
    assert lines[1] == "[2/4] scheme.degree=0 solver.tolerance=0.0001: finished before"


def dates(table: pd.DataFrame) -> list[str]:
    """Return when each result was written."""
    return [pw.open_result(place).attrs["history"] for place in table["directory"]]


def test_finished_runs_are_not_repeated(made: pw.Case, tmp_path: Path) -> None:
    first = pw.sweep(made, {"solver.tolerance": [1e-2, 1e-3]}, tmp_path, progress=False)
    files = [Path(place, "result.h5").stat().st_mtime_ns for place in first["directory"]]
    second = pw.sweep(made, {"solver.tolerance": [1e-2, 1e-3, 1e-4]}, tmp_path, progress=False)
    assert second["directory"].tolist()[:2] == first["directory"].tolist()
    again = [Path(place, "result.h5").stat().st_mtime_ns for place in first["directory"]]
    assert again == files
    pd.testing.assert_frame_equal(second.head(2), first)
    # Another case under the same values is another run.
    other = pw.sweep(
        made.replace({"potential.0.value": 0.1}),
        {"solver.tolerance": [1e-2]},
        tmp_path,
        progress=False,
    )
    assert other["directory"][0] not in set(second["directory"])
    assert other["mass"][0] != second["mass"][0]
    # A damaged result is computed anew.
    damaged = Path(first["directory"][0]) / "summary.json"
    damaged.unlink()
    third = pw.sweep(made, {"solver.tolerance": [1e-2]}, tmp_path, progress=False)
    assert damaged.is_file() and third["mass"][0] == first["mass"][0]


def test_a_failure_is_a_row(small: pw.Case, tmp_path: Path) -> None:
    table = pw.sweep(small, {"solver.tolerance": [5, 1e-2]}, tmp_path, progress=False)
    assert "must be above 0" in table["error"][0] and pd.isna(table["mass"][0])
    assert pd.isna(table["error"][1]) and table["mass"][1] > 0


def test_chosen_columns(small: pw.Case, tmp_path: Path) -> None:
    # One that this run does not know stays, too.
    columns = ["modes", "probabilities.at_slice.all.value", "error_velocity_l1"]
    table = pw.sweep(small, {"solver.tolerance": [1e-2]}, tmp_path, columns=columns, progress=False)
    # Runs on few cells have warnings, which are a column of their own.
    found = [column for column in table.columns if column != "warnings"]
    assert found == ["solver.tolerance", *columns, "directory"]


def test_a_nested_column_that_no_run_has_is_warned_of(small: pw.Case, tmp_path: Path) -> None:
    columns = ["accuracy.grd", "accuracy.grid", "exact_l1"]
    with pytest.warns(pw.PhasewarpWarning) as caught:
        pw.sweep(small, {"solver.tolerance": [1e-2]}, tmp_path, columns=columns, progress=False)
    expected = 'columns: accuracy has no entry grd in any run (did you mean "grid"?)'
    assert [str(warning.message) for warning in caught] == [expected]


def test_directories_are_those_of_the_command(small: pw.Case, tmp_path: Path) -> None:
    vary: dict[str, list[Any]] = {"solver.tolerance": [1e-2, 1e-5], "output.field_times": [[0.1]]}
    table = pw.sweep(small, vary, tmp_path, progress=False)
    words = ["--vary", "solver.tolerance=1e-2,1e-5", "--vary", "output.field_times=[0.1]"]
    with small.arguments() as case:
        call(["sweep", *case, *words, "-o", str(tmp_path), "--table"])
    again = pd.read_csv(tmp_path / "table.csv")
    # Beside the comment of the command, the same text.
    head, _, tabular = (tmp_path / "table.tex").read_text().partition("\n")
    assert head.startswith("% ") and pw.latex(table) == tabular
    table["output.field_times"] = table["output.field_times"].map(str)
    pd.testing.assert_frame_equal(again, table, check_dtype=False)
    # The same case as in src/study/sweep/name.rs.
    case_of_name = pw.Case(
        {
            "time": {"end": 1e-5},
            "title": 'é "\x7f\n',
            "solver": {"verify": True},
            "output": {"field_times": [0.1, 2]},
        }
    )
    point = dict.fromkeys(["time.end", "output.field_times", "title"])
    name = run_name(case_of_name, point, "full")
    assert name == "end=1e-05_field_times=-0.1,2-_title=-_f18ba48d0e2ddcc6"


def test_latex() -> None:
    table = pd.DataFrame(
        {
            "a_b": [2.9e-7, 1e-5, -0.0012346],
            "count": [64, 0, 123456789],
            "seconds": [12345.6, float("nan"), 1.0],
            "formula": ["exp(-x^2), 50 %", "a~<b>", "\\{}#&$"],
            "times": [[0.1, 2], [], [1e-7]],
            "verify": [True, False, True],
            "warnings": ["a warning", None, None],
            "directory": ["a", "b", "c"],
        }
    )
    lines = pw.latex(table).splitlines()
    assert lines[0] == r"\begin{tabular}{rrrllr}" and lines[-1] == r"\end{tabular}"
    assert lines[2] == r"a\_b & count & seconds & formula & times & verify \\"
    assert lines[4] == (
        r"$2.9 \times 10^{-7}$ & $64$ & $12346$ & exp(-x\textasciicircum{}2), 50 \% & [0.1,2] "
        r"& true \\"
    )
    assert lines[5].startswith(
        r"$10^{-5}$ & $0$ & -- & a\textasciitilde{}\textless{}b\textgreater{}"
    )
    assert lines[6].startswith(
        r"$-0.001235$ & $123456789$ & $1$ & \textbackslash{}\{\}\#\&\$ & [1e-07] & true"
    )


def test_nothing_to_vary(small: pw.Case, tmp_path: Path) -> None:
    with pytest.raises(ValueError, match="vary"):
        pw.sweep(small, {}, tmp_path)
    with pytest.raises(ValueError, match="vary"):
        pw.sweep(small, {"time.end": []}, tmp_path)


def test_what_gives_no_table_is_refused_before_the_first_run(
    small: pw.Case, made: pw.Case, tmp_path: Path
) -> None:
    def refused(vary: dict[str, Any], **options: Any) -> str:
        with pytest.raises(ValueError) as caught:
            pw.sweep(small, vary, tmp_path / "sweep", **options)
        assert not (tmp_path / "sweep").exists()
        return str(caught.value)

    expected = "scheme.interface: a list of values expected, not a text"
    assert refused({"scheme.interface": "hat"}) == expected
    assert refused({"axis.0.x.cells": 16}) == "axis.0.x.cells: a list of values expected, not 16"
    assert "not a table" in refused({"exact": {"kind": "characteristics"}})
    one = {"solver.tolerance": [1e-2]}
    assert 'modez (did you mean "modes"?)' in refused(one, columns=["modez"])
    assert "no entry accurazy.grid" in refused(one, columns=["modes", "accurazy.grid"])
    assert "not 'modes'" in refused(one, columns="modes")
    assert "mode = 'ful'" in refused(one, mode="ful")
    with pytest.raises(ValueError, match="mode = 'ful'"):
        pw.run(small, tmp_path / "sweep", mode="ful")  # type: ignore[arg-type]
    assert "initial.f: a formula" in refused({"initial.f": ["1*(abs(x)<1)", [1, 2]]})
    # As the command says it, and of a case without a file, too.
    said = 'unknown key solver.tolerence (did you mean "tolerance"?)'
    assert said in refused({"solver.tolerence": [1e-2, 1e-3]})
    with pytest.raises(pw.CaseError, match=r"unknown key solver\.tolerence"):
        pw.sweep(made, {"solver.tolerence": [1e-2]}, tmp_path / "sweep")
    assert not (tmp_path / "sweep").exists()


def test_values_may_be_any_row(small: pw.Case, tmp_path: Path) -> None:
    rows: list[Any] = [np.array([1e-2, 1e-3]), (1e-2, 1e-3), pd.Series([1e-2, 1e-3])]
    for values in rows:
        table = pw.sweep(small, {"solver.tolerance": values}, tmp_path, progress=False)
        assert table["solver.tolerance"].tolist() == [1e-2, 1e-3]
    degrees = pw.sweep(small, {"scheme.degree": range(2)}, tmp_path, progress=False)
    assert degrees["scheme.degree"].tolist() == [0, 1]


@pytest.mark.filterwarnings("ignore::phasewarp.PhasewarpWarning")
def test_entries_are_those_of_the_program(small: pw.Case, tmp_path: Path) -> None:
    """A summary has no entry that `columns` refuses, and the page names every one."""
    assert ENTRIES.issuperset(pw.run(small, tmp_path / "ordinary").summary)
    classical = small.replace({"solver.method": "classical"})
    assert ENTRIES.issuperset(pw.run(classical, tmp_path / "classical").summary)
    page = (CASES.parent / "docs/usage.md").read_text("utf-8")
    table = page.split("### summary.json", 1)[1].split("\n### ", 1)[0]
    named = set()
    for line in table.splitlines():
        if line.startswith("| `"):
            named |= set(re.findall(r"`(\w+)`", line.split("|")[1]))
    # A row that stands for its relative entries names them by an ellipsis.
    assert named <= ENTRIES and len(named) > 60, named - ENTRIES
