"""The program is started as a user does; MPI may run as root and with more ranks than cores."""

from __future__ import annotations

import os
from pathlib import Path

import pytest

import phasewarp as pw

CASES = Path(__file__).resolve().parents[2] / "cases"


@pytest.fixture(autouse=True, scope="session")
def mpi_environment() -> None:
    """As the Makefile sets it for `make run`."""
    for name, value in {
        "OMPI_ALLOW_RUN_AS_ROOT": "1",
        "OMPI_ALLOW_RUN_AS_ROOT_CONFIRM": "1",
        "OMPI_MCA_rmaps_base_oversubscribe": "1",
        "OMPI_MCA_mpi_yield_when_idle": "1",
        "PRTE_MCA_rmaps_default_mapping_policy": ":oversubscribe",
    }.items():
        os.environ.setdefault(name, value)


@pytest.fixture
def small() -> pw.Case:
    """Return example 1 of the paper on 16 x 16 cells."""
    return pw.Case(CASES / "example1.toml").replace(
        {"axis.0.x.cells": 16, "axis.0.v.cells": 16, "solver.tolerance": 1e-4}
    )


@pytest.fixture
def made() -> pw.Case:
    """Return a case without a file: a cloud that meets a barrier, half of it below its energy."""
    return pw.Case(
        title='A "barrier" \\ of tests',
        axis=[
            {
                "x": {"lower": -1.0, "upper": 1.0, "cells": 16},
                "v": {"lower": -1.5, "upper": 1.5, "cells": 18},
            }
        ],
        potential=[{"where": "abs(x) < 0.25", "value": 0.2}, {"value": 0}],
        initial={"f": "exp(-20*((x + 0.6)^2 + (v - 0.6)^2))"},
        time={"end": 0.5},
        solver={"tolerance": 1e-4},
    )
