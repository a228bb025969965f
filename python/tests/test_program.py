"""Finding and calling the program, and its failures."""

from __future__ import annotations

import os
import re
import stat
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from conftest import CASES

import phasewarp as pw
from phasewarp.program import call, launcher, unwrapped


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


@pytest.mark.filterwarnings("ignore::phasewarp.PhasewarpWarning")
def test_a_mistake_in_a_case_without_a_file(made: pw.Case, tmp_path: Path) -> None:
    """The message names a line of its text, and no file that is gone."""
    made["time.end"] = -1
    for ask in (pw.check, pw.describe, lambda case: pw.run(case, tmp_path / "a" / "b")):
        with pytest.raises(pw.CaseError, match=r"^case\.toml:(\d+):\d+: time\.end = -1") as caught:
            ask(made)
        line = int(str(caught.value).split(":")[1])
        assert made.to_toml().splitlines()[line - 1] == "end = -1"
    with pytest.raises(pw.CaseError) as caught:
        pw.check(made)
    details = caught.value.details
    assert details is not None and details["file"] == "case.toml" and details["line"] == line
    # A refused run leaves nothing.
    assert not list(tmp_path.iterdir())
    # Long lines are joined as those of a short name.
    made["time.end"], made["solver.tolerence"] = 1.0, 1
    with pytest.raises(
        pw.CaseError, match=r'\(did you mean "tolerance"\?\); known here: .*reduce\n'
    ):
        pw.check(made)


@pytest.mark.filterwarnings("ignore::phasewarp.PhasewarpWarning")
def test_words_of_this_package_in_messages(made: pw.Case, tmp_path: Path) -> None:
    pw.run(made, tmp_path / "run")
    with pytest.raises(pw.CaseError, match=r"resume=True keeps it .*, force=True replaces it, ano"):
        pw.run(made, tmp_path / "run")
    other = made.replace({"title": "Another"})
    with pytest.raises(
        pw.CaseError, match=r"another result: title .*; force=True replaces"
    ) as told:
        pw.run(other, tmp_path / "run")
    assert "-o" not in str(told.value).split()


def test_ranks_are_whole_numbers(small: pw.Case, tmp_path: Path) -> None:
    wrong: list[Any] = ["2", 2.0, None]
    for ranks in wrong:
        with pytest.raises(TypeError, match=rf"^ranks = {ranks!r}: a whole number expected"):
            pw.run(small, tmp_path / "run", ranks=ranks)
    assert not (tmp_path / "run").exists()
    texts: list[Any] = ["1..8", "2"]
    for text in texts:
        with pytest.raises(TypeError, match=r"a whole number or a list of them expected"):
            pw.plan(small, text)
    number: Any = np.int64(4)
    assert np_of(pw.plan(small, number)["layout"]["mesh"]) == 4
    assert pw.plan(small, np.array([1, 2]), ranks_x=np.array([1]))["ranks"].tolist() == [1, 2]
    assert pw.plan(small, range(1, 4))["ranks"].tolist() == [1, 2, 3]


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


def test_a_missed_tolerance_is_a_warning(small: pw.Case, tmp_path: Path) -> None:
    small["solver.verify"] = True
    small["solver.propagator"] = {"method": "backward-euler", "step": 0.1}
    with pytest.warns(pw.PhasewarpWarning, match=r"^tolerance \S+ MISSED: .*measured"):
        found = pw.run(small, tmp_path)
    assert found.summary["verdict"] == "missed"
    assert found.open().attrs["verdict"] == "missed"


def test_an_unknown_error_is_a_warning(tmp_path: Path) -> None:
    cells = {f"axis.{axis}.{of}.cells": 6 for axis in (0, 1) for of in "xv"}
    case = pw.Case(CASES / "example3.toml").replace({**cells, "exact": {}})
    with pytest.warns(pw.PhasewarpWarning, match=r"^accuracy: .*error of the grid not estimated"):
        pw.run(case, tmp_path)


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
    every: dict[str, Any] = {
        "output.fields_every": np.float64(0.3 * end),
        "title": "second part",
    }
    second = pw.continue_run(first, end, tmp_path / "second", settings=every, ranks=2)
    assert second.summary["title"] == "second part"
    assert second.summary["continued"]["time"] == 0.5 * end
    times = second.open()["time"].to_numpy()
    assert times.tolist() == pytest.approx([0.5 * end, 0.6 * end, 0.9 * end, end])


@pytest.mark.filterwarnings("ignore::phasewarp.PhasewarpWarning")
def test_the_directory_has_one_name(small: pw.Case, tmp_path: Path) -> None:
    """`directory`, by default beside the first run's; the former name `output` works, too."""
    end = float(small["time.end"])
    first = pw.run(small.replace({"time.end": 0.25}), directory=tmp_path / "first")
    former = pw.run(small.replace({"time.end": 0.25}), output=tmp_path / "former")
    assert former.summary["mass"] == first.summary["mass"]
    second = pw.continue_run(first, end, directory=tmp_path / "second")
    third = pw.continue_run(first, end, output=tmp_path / "third")
    fourth = pw.continue_run(f"{tmp_path}/first/", end)
    assert fourth.directory == tmp_path / f"first-until-{end:g}"
    for result in (third, fourth):
        assert result.open()["f"].equals(second.open()["f"])
    # As the command names it.
    call(["run", "--continue", str(first.directory), "--until", repr(end), "--resume"])
    assert len(list(tmp_path.iterdir())) == 5
    with pytest.raises(TypeError, match="directory and output are one"):
        pw.run(small, tmp_path, output=tmp_path)
    with pytest.raises(TypeError, match="directory: missing"):
        pw.run(small)


@pytest.mark.filterwarnings("ignore::phasewarp.PhasewarpWarning")
def test_the_case_of_a_run_is_kept(made: pw.Case, tmp_path: Path) -> None:
    """A case without a file is stored with the results, and what they name is there."""
    place = tmp_path / "run"
    result = pw.run(made, place)
    file = place / "case.toml"
    assert result.open().attrs["case_file"] == str(file)
    assert f"phasewarp advise {file} --accuracy" in result.summary["accuracy"]["advice"]
    assert pw.Case(file) == made
    text, date = file.read_text("utf-8"), file.stat().st_mtime_ns
    assert text.startswith(made.to_toml())
    # It belongs to the results: a run that is refused, or that finds them, leaves it alone.
    pw.run(made, place, resume=True)
    with pytest.raises(pw.CaseError, match="force=True replaces it"):
        pw.run(made.replace({"time.end": 0.25}), place)
    with pytest.raises(pw.CaseError, match=r"^case\.toml:"):
        pw.run(made.replace({"time.end": -1}), place, force=True)
    with pytest.raises(ValueError, match="ranks"):
        pw.run(made.replace({"time.end": 0.25}), place, force=True, ranks=0)
    assert file.read_text("utf-8") == text and pw.Case(result.open().attrs["case_file"]) == made
    pw.run(made.replace({"time.end": 0.25}), place, force=True)
    assert pw.Case(file)["time.end"] == 0.25 and file.stat().st_mtime_ns > date
    # It does not describe the results of a case with a file.
    pw.run(made.replace({"time.end": 0.1}).save(tmp_path / "mine.toml"), place, force=True)
    assert not file.exists()
    # A file of another's is not replaced, and the results are the same.
    made.save(file)
    again = pw.run(made, place, force=True)
    assert file.read_text("utf-8") == made.to_toml()
    assert "phasewarp-" in again.open().attrs["case_file"]
    assert again.open()["f"].equals(pw.run(made, tmp_path / "other").open()["f"])


@pytest.mark.filterwarnings("ignore::phasewarp.PhasewarpWarning")
def test_long_values_beside_a_file(small: pw.Case, tmp_path: Path) -> None:
    """The title is by default the name of the file, also where the case is written anew."""
    del small["title"]
    path = small.save(tmp_path / "mine.toml")
    edges = np.linspace(-1.5, 1.5, 401)
    table = pw.potential_table(np.where(np.arange(400) % 2, 0.2, 0.0), edges)
    long = pw.Case(path).replace({"axis.0.x.cells": 400, "potential": table})
    with long.arguments() as words:
        assert not words[0].endswith("mine.toml")
    assert pw.check(long)["title"] == "mine.toml"


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


def test_negative_numbers_are_refused_by_name(small: pw.Case, tmp_path: Path) -> None:
    with pytest.raises(pw.CaseError, match="--ranks"):
        pw.plan(small, -1)
    with pytest.raises(pw.CaseError, match="--walltime"):
        pw.run(small, tmp_path / "negative", walltime=-1)


def np_of(mesh: dict[str, list[int] | int]) -> int:
    """Return the number of ranks of a mesh in one dimension."""
    space, groups = mesh["space"], mesh["groups"]
    assert isinstance(space, list) and isinstance(groups, int)
    return space[0] * groups


def test_other_commands(small: pw.Case) -> None:
    advice = pw.advise(small, accuracy=0.3, budget="2s", reproducible=True)
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
