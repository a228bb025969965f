"""The exported matrices: their structure, and that they are the ones that a run solves with."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from conftest import CASES
from scipy.sparse import diags_array
from scipy.sparse.linalg import expm_multiply

import phasewarp as pw


@pytest.mark.parametrize("settings", [{}, {"scheme.degree": 2, "axis.0.x.cells": 6}])
def test_a_run_solves_with_them(small: pw.Case, tmp_path: Path, settings: dict[str, int]) -> None:
    case = small.replace({**settings, "solver.tolerance": 1e-9})
    m = pw.matrices(case)
    cells = m.A.shape[0]
    field = (m.initial["f"] / m.weights)[:cells]
    found = pw.run(case, tmp_path).open()["f"].values.reshape(-1)
    expected = expm_multiply(m.A * case["time.end"], field)
    assert np.linalg.norm(found - expected) < 1e-8 * np.linalg.norm(expected)
    assert np.linalg.norm(field - expected) > 0.1 * np.linalg.norm(expected)


def test_parts(small: pw.Case) -> None:
    m = pw.matrices(small)
    assert abs(m.S - m.S.T).max() == 0.0 and abs(m.K + m.K.T).max() == 0.0
    d = diags_array(m.weights)
    assert abs(d @ m.A - (m.S + m.K) @ d).max() < 1e-12 * abs(m.A).max()
    assert not m.b["f"].any()


def test_inflow(small: pw.Case) -> None:
    """What enters is in b, and in the couplings of the auxiliary unknowns."""
    m = pw.matrices(small.replace({"inflow.value": 0.3}))
    cells = m.A.shape[0]
    assert m.S.shape[0] > cells and m.b["f"].max() > 0
    extended = diags_array(1 / m.weights) @ (m.S + m.K) @ diags_array(m.weights)
    # Rows of the auxiliary unknowns are zero: what is behind the cells stays as it is.
    entering = extended.tocsr()[:cells, cells:] @ (m.initial["f"] / m.weights)[cells:]
    np.testing.assert_allclose(entering, m.b["f"], atol=1e-12)
    assert abs(extended.tocsr()[cells:]).max() < 1e-12


def test_measure_valued_data() -> None:
    case = pw.Case(CASES / "example2.toml").replace({"axis.0.x.cells": 8, "axis.0.v.cells": 8})
    m = pw.matrices(case)
    assert set(m.b) == set(m.initial) == {"phi", "psi_x"}


def test_refused(small: pw.Case) -> None:
    with pytest.raises(pw.CaseError, match=r"inflow\.value depends on t"):
        pw.matrices(small.replace({"inflow.value": "t"}))
