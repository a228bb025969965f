"""Finding and calling the program, and its failures."""

from __future__ import annotations

import os
import re
import stat
from pathlib import Path

import pytest
from conftest import CASES

import phasewarp as pw
from phasewarp.program import launcher, unwrapped


def script(path: Path, text: str) -> Path:
    path.write_text(f"#!/bin/sh\n{text}\n")
    path.chmod(path.stat().st_mode | stat.S_IXUSR)
    return path


def test_where_the_program_is_looked_for(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    named = script(tmp_path / "named", "echo named")
    variable = script(tmp_path / "variable", "echo variable")
    on_path = script(tmp_path / "phasewarp", "echo path")
    monkeypatch.setenv("PHASEWARP", str(variable))
    monkeypatch.setenv("PATH", str(tmp_path))
    assert pw.find_program(named) == named
    assert pw.find_program() == variable
    monkeypatch.delenv("PHASEWARP")
    assert pw.find_program() == on_path
    checkout = tmp_path / "checkout"
    built = checkout / "target" / "release"
    built.mkdir(parents=True)
    (checkout / "Cargo.toml").touch()
    program = script(built / "phasewarp", "echo built")
    monkeypatch.setenv("PATH", "")
    monkeypatch.chdir(checkout / "target")
    assert pw.find_program() == program


def test_no_program(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    with pytest.raises(pw.ProgramNotFoundError, match=r"program = .*nowhere: no executable"):
        pw.check(CASES / "example1.toml", program=tmp_path / "nowhere")
    monkeypatch.setenv("PHASEWARP", str(tmp_path / "nowhere"))
    with pytest.raises(pw.ProgramNotFoundError, match="PHASEWARP = "):
        pw.find_program()


def test_no_launcher(small: pw.Case, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("PHASEWARP_LAUNCHER", "no-such-launcher -n {ranks}")
    with pytest.raises(pw.ProgramNotFoundError, match="PHASEWARP_LAUNCHER"):
        pw.run(small, tmp_path, ranks=2)


def test_launcher(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.delenv("PHASEWARP_LAUNCHER", raising=False)
    assert launcher(1) == []
    assert launcher(3) == ["mpirun", "-np", "3"]
    monkeypatch.setenv("PHASEWARP_LAUNCHER", "srun -n {ranks} --cpu-bind=cores")
    assert launcher(1) == ["srun", "-n", "1", "--cpu-bind=cores"]
    with pytest.raises(ValueError, match="ranks = 0"):
        launcher(0)


@pytest.mark.parametrize("ranks", [1, 2])
def test_a_mistake_in_the_case(small: pw.Case, tmp_path: Path, ranks: int) -> None:
    small["solver.tolerance"] = 5
    with pytest.raises(pw.CaseError, match="must be above 0 and at most") as caught:
        pw.run(small, tmp_path / "out", ranks=ranks)
    assert caught.value.exit_code == 2
    assert str(caught.value).startswith("--set solver.tolerance=5")
    # The launcher's own lines are left out.
    assert "mpirun" not in str(caught.value) and "---" not in str(caught.value)


def test_a_mistake_points_into_the_file(tmp_path: Path) -> None:
    text = (CASES / "example1.toml").read_text().replace("cells = 128", "cells = 0", 1)
    (tmp_path / "mine.toml").write_text(text)
    with pytest.raises(pw.CaseError, match=r"mine\.toml:\d+:\d+: axis\.0\.x\.cells = 0"):
        pw.check(tmp_path / "mine.toml")


def test_any_other_failure(tmp_path: Path) -> None:
    program = script(tmp_path / "failing", "echo 'error: a rank died' >&2; exit 3")
    with pytest.raises(pw.PhasewarpError, match=r"^a rank died$") as caught:
        pw.check(CASES / "example1.toml", program=program)
    assert caught.value.exit_code == 3 and not isinstance(caught.value, pw.CaseError)
    program = script(tmp_path / "silent", "exit 1")
    with pytest.raises(pw.PhasewarpError, match="it said nothing"):
        pw.check(CASES / "example1.toml", program=program)


def test_a_coarse_grid_is_a_warning(small: pw.Case, tmp_path: Path) -> None:
    small["scheme.degree"] = 0
    words = r"^UNDER-RESOLVED: error of the grid.*; pw.advise\(case, ε\) finds a grid$"
    with pytest.warns(pw.PhasewarpWarning, match=words):
        pw.run(small, tmp_path)


def test_warnings(small: pw.Case) -> None:
    small["potential.0.where"] = "x < 0.05"
    with pytest.warns(pw.PhasewarpWarning, match="misses the faces of the grid"):
        pw.check(small)


def test_timeout_ends_the_program(tmp_path: Path) -> None:
    # What the program's process is, it writes down itself.
    program = script(tmp_path / "slow", f"echo $$ > {tmp_path}/pid; exec sleep 60")
    with pytest.raises(pw.TimedOutError, match=r"not done after 0\.5 s"):
        pw.run(CASES / "example1.toml", tmp_path / "out", timeout=0.5, program=program)
    with pytest.raises(ProcessLookupError):
        os.kill(int((tmp_path / "pid").read_text()), 0)


def test_stop_and_resume(tmp_path: Path) -> None:
    case = pw.Case(CASES / "example1.toml").replace(
        {"solver.tolerance": 1e-9, "axis.0.x.cells": 256, "axis.0.v.cells": 256}
    )
    whole = pw.run(case, tmp_path / "whole")
    seconds = whole.summary["wall_seconds"]
    stopped = stops(case, tmp_path / "parts", [0.5 * seconds, seconds, 2 * seconds])
    assert stopped.exit_code == 75
    assert re.fullmatch(r"stopped by --walltime .* goes on from there", str(stopped))
    parts = pw.run(case, tmp_path / "parts", ranks=2, resume=True)
    assert parts.summary["resumed"]
    assert parts.summary["matvecs_here"] < parts.summary["matvecs"]
    assert parts.open()["f"].identical(whole.open()["f"])


def stops(case: pw.Case, place: Path, walltimes: list[float]) -> pw.StoppedError:
    """Return how a run stopped in the first time that a batch fits into: machines are shared."""
    for walltime in walltimes:
        try:
            pw.run(case, place, walltime=walltime, force=True)
        except pw.StoppedError as stopped:
            return stopped
        except pw.CaseError as too_short:
            assert "--walltime" in str(too_short)
    raise AssertionError("it did not stop")


def test_going_on(small: pw.Case, tmp_path: Path) -> None:
    """A finished run goes on to a later time."""
    end = float(small["time.end"])
    first = pw.run(small.replace({"time.end": 0.5 * end}), tmp_path / "first")
    every: dict[str, str | float] = {
        "output.fields_every": 0.3 * end,
        "title": "second part",
    }
    second = pw.continue_run(first, end, tmp_path / "second", settings=every, ranks=2)
    assert second.summary["title"] == "second part"
    assert second.summary["continued"]["time"] == 0.5 * end
    times = second.open()["time"].to_numpy()
    assert times.tolist() == pytest.approx([0.5 * end, 0.6 * end, 0.9 * end, end])


def test_plan(small: pw.Case) -> None:
    plan = pw.plan(small, ranks=4, memory_per_rank="1GiB")
    assert plan["cells"] <= 256 and plan["warp"]["modes"] > 0
    meshes = plan["advice"]["meshes"]
    assert all(np_of(mesh) == 4 and mesh["memory"] < 2**30 for mesh in meshes)
    assert np_of(pw.plan(small, ranks=4, ranks_x=[2])["layout"]["mesh"]) == 4
    predicted = pw.plan(small, ranks=4, calibrate=2)["calibration"]
    assert predicted["wall_seconds"] >= predicted["solve_seconds"] > 0


def test_plans_of_many_ranks(small: pw.Case) -> None:
    table = pw.plan(small, ranks=[1, 2, 64], ranks_per_node=4)
    assert table["ranks"].tolist() == [1, 2, 64]
    assert table["time"][0] == table["efficiency"][0] == 1
    assert table["worth_it"][0] and not table["worth_it"][2]
    worth = table["ranks"][table["worth_it"]].tolist()
    assert table["ranks"][table["recommended"]].tolist() == worth[-1:]
    assert table["nodes"].tolist() == [1, 1, 16] and "seconds" not in table
    one = pw.plan(small, ranks=[2], calibrate=1)
    assert len(one) == 1 and one["seconds"][0] > 0


def np_of(mesh: dict[str, list[int] | int]) -> int:
    """Return the number of ranks of a mesh in one dimension."""
    space, groups = mesh["space"], mesh["groups"]
    assert isinstance(space, list) and isinstance(groups, int)
    return space[0] * groups


def test_other_commands(small: pw.Case) -> None:
    advice = pw.advise(small, accuracy=0.3, budget="2s")
    assert advice["entries"][advice["best"]]["error"] <= 0.3
    assert pw.resources(small)["qubits"]
    choices = pw.optimise(small)
    assert choices[0]["walk_steps"]["value"] > 0 and len(choices[0]["cost"]) == 2
    assert pw.spectrum(small, refine=[1, 2])


def test_lines_of_the_program_are_joined_again() -> None:
    words = " ".join(["word"] * 19)
    lines = [
        f"warning: {words}",
        "  goes on",
        "  short",
        f"phasewarp run {words} \\",
        "    --set a=b",
    ]
    assert unwrapped("\n".join([*lines, "end"])).splitlines() == [
        f"warning: {words} goes on",
        "  short",
        f"phasewarp run {words} --set a=b",
        "end",
    ]
