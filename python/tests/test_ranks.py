"""The simulation of many ranks keeps what must hold; the table of the job scripts is read."""

from __future__ import annotations

import csv
import json
import subprocess
import sys
from pathlib import Path
from typing import Any

import pytest

import phasewarp as pw

ROOT = Path(__file__).resolve().parents[2]
sys.path.insert(0, str(ROOT / "scripts"))

import messages  # noqa: E402
import ranks  # noqa: E402

ROW_SECONDS = 1e-9
# Between nodes of two ranks each.
NODES = {"ranks_per_node": 2, "near_latency": 5e-7, "overhead": 1e-6, "copy": 1e10}


def network(**changed: float) -> messages.Network:
    return messages.Network(**{"latency": 2e-6, "bandwidth": 25e9, **NODES, **changed})


def planned(case: str, cells: int, number: int, *words: str) -> dict[str, Any]:
    path = str(ROOT / "cases" / f"{case}.toml")
    axes = 2 if case == "example3" else 1
    settings = [f"--set={setting}" for setting in ranks.cells(cells, axes)]
    plan: dict[str, Any] = ranks.planned(str(pw.find_program()), [path, *settings, *words], number)
    return plan


def seconds(plan: dict[str, Any], of: messages.Network, **options: int) -> float:
    total: float = sum(messages.Run(plan, of, ROW_SECONDS, **options).seconds().values())
    return total


CASES = [("example1", 24), ("example3", 6)]


@pytest.mark.parametrize(("case", "cells"), CASES)
def test_one_rank_takes_what_the_plan_says_and_sends_nothing(case: str, cells: int) -> None:
    plan = planned(case, cells, 1)
    parts = messages.Run(plan, network(), ROW_SECONDS).seconds()
    assert parts["rows"] == pytest.approx(ranks.modelled(plan, ROW_SECONDS), rel=1e-12)
    assert [abs(parts[name]) < 1e-15 for name in ("ghosts", "norms", "recovery")] == [True] * 3


@pytest.mark.parametrize(("number", "blocks"), [(4, "4"), (6, "3"), (4, "1"), (10, "5")])
@pytest.mark.parametrize(("case", "cells"), CASES)
def test_messages_that_cost_nothing_leave_the_balance(
    case: str, cells: int, number: int, blocks: str
) -> None:
    """The rank with most rows and steps is busy all the time, with the steps blocked or not."""
    plan = planned(case, cells, number, f"--ranks-x={blocks}")
    ideal = messages.Network.ideal()
    bound = messages.Run(plan, ideal, ROW_SECONDS).balance()
    assert seconds(plan, ideal) == pytest.approx(bound, rel=1e-9)
    assert seconds(plan, network()) > bound


@pytest.mark.parametrize(("case", "cells"), CASES)
def test_slower_networks_take_longer(case: str, cells: int) -> None:
    plan = planned(case, cells, 6, "--ranks-x=3")
    taken = [seconds(plan, network(latency=t)) for t in (0.0, 1e-6, 1e-5, 1e-4)]
    assert taken == sorted(taken) and taken[3] > 3 * taken[0]
    taken = [seconds(plan, network(bandwidth=b)) for b in (1e11, 1e10, 1e9, 1e8)]
    assert taken == sorted(taken) and taken[3] > 1.5 * taken[0]
    # Within one node, neither counts.
    within = [seconds(plan, network(latency=t, ranks_per_node=6)) for t in (0.0, 1e-4)]
    assert within[0] == within[1]


def test_a_window_of_steps_tells_what_all_steps_take() -> None:
    plan = planned("example1", 48, 6, "--ranks-x=3")
    steps = min(batch["cost"] for group in plan["layout"]["groups"] for batch in group) // 8
    whole, window = (seconds(plan, network(), window=n) for n in (steps, 12))
    assert steps > 40
    assert window == pytest.approx(whole, rel=0.02)


@pytest.mark.parametrize(("case", "cells", "blocks"), [("example1", 23, "5"), ("example3", 6, "4")])
def test_blocks_are_those_of_the_program(case: str, cells: int, blocks: str) -> None:
    """The fullest block has the planned ghosts, and the model the rows of that block."""
    plan = planned(case, cells, 2 * int(blocks), f"--ranks-x={blocks}")
    run = messages.Run(plan, network(), ROW_SECONDS)
    arrays = dict(plan["layout"]["arrays"])
    layer = run.most_rows // max(block.sizes[0] for block in run.blocks)
    assert arrays["ghost exchange"] == 2 * messages.BYTES_A_ROW * 2 * layer
    modelled = ranks.modelled(plan, ROW_SECONDS)
    # Rows and, as the plan counts them, a round of messages and the ghosts of both neighbours.
    most = max(run.steps) * run.row_seconds
    assert modelled == pytest.approx(most * (run.most_rows + 300 + 3 * 2 * layer), rel=1e-9)
    # Every cell is in one block.
    total = sum(block.rows for block in run.blocks)
    assert total == plan["cells"]


@pytest.mark.parametrize("kind", ["strong", "weak"])
def test_the_table_of_a_cluster_is_read(
    kind: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """The job scripts, here without a queue, fill in what they measure; the rest is added."""
    program = pw.find_program()
    for name, value in {"PHASEWARP": str(program), "SLURM_NTASKS": "2", "CELLS": "16"}.items():
        monkeypatch.setenv(name, value)
    for name in ("SLURM_JOB_ID", "SLURM_SUBMIT_DIR"):
        monkeypatch.delenv(name, raising=False)
    odd = ["--set", "axis.0.v.cells=24", "--set", 'title="two, of \\"them\\""']
    subprocess.run(
        ["bash", f"jobscripts/{kind}_scaling.sbatch", "cases/example1.toml", str(tmp_path), *odd],
        cwd=ROOT,
        check=True,
        capture_output=True,
    )
    measured, all_columns = tmp_path / f"{kind}.csv", tmp_path / "all.csv"
    script = [sys.executable, "scripts/ranks.py", "--program", str(program)]
    said = subprocess.run(
        [*script, "--measured", str(measured), "--csv", str(all_columns)],
        cwd=ROOT,
        check=True,
        capture_output=True,
        text=True,
    ).stdout
    assert "measured / simulated" in said
    with all_columns.open(newline="", encoding="utf-8") as file:
        lines = list(csv.DictReader(file))
    assert [line["ranks"] for line in lines] == ["1", "2"]
    for line in lines:
        summary = json.loads((tmp_path / line["ranks"] / "summary.json").read_text("utf-8"))
        assert float(line["solve_seconds"]) == pytest.approx(summary["solve_seconds"], rel=1e-4)
        assert line["case"] == 'two, of "them"'
        assert float(line["simulated_seconds"]) >= float(line["rows_seconds"]) > 0
    # The first line sets the seconds of a row, without messages.
    for name in ("model_seconds", "simulated_seconds"):
        assert float(lines[0][name]) == pytest.approx(float(lines[0]["solve_seconds"]), rel=1e-4)
    # A file that is none of the scripts' is refused.
    measured.write_text("ranks\n1\n", "utf-8")
    refused = subprocess.run(
        [*script, "--measured", str(measured)], cwd=ROOT, capture_output=True, text=True
    )
    assert refused.returncode == 1 and "columns" in refused.stderr
