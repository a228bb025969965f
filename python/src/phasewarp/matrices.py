"""`A`, `b` and `(S, K)` of a case as SciPy's sparse matrices."""

from __future__ import annotations

import tempfile
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from phasewarp.commands import CaseLike, as_case
from phasewarp.program import StrPath, call

if TYPE_CHECKING:
    from scipy.sparse import csr_array


@dataclass(frozen=True)
class Matrices:
    """The semi-discrete problem of a case.

    Cells are in the order ``(x1..xn, v1..vn)``, the last axis fastest, as in
    ``f.values.reshape(-1)``; of a degree above 0 they are nodes.

    Attributes
    ----------
    A : csr_array, shape (cells, cells)
        Of `f' = A f + b`.
    b : dict of ndarray, shape (cells,)
        What enters, by field: ``"f"``, or ``"phi"``, ``"psi_x"``, ….
    S, K : csr_array, shape (unknowns, unknowns)
        Symmetric and skew part of ``D A D⁻¹``, with the auxiliary unknowns of the inflow behind
        the cells. Mode `l` obeys ``w' = (-iμ_l S + K) w``.
    weights : ndarray, shape (unknowns,)
        The diagonal of `D`, ``√π``.
    initial : dict of ndarray, shape (unknowns,)
        ``D f`` at time zero, then the auxiliary unknowns, by field.
    """

    A: csr_array
    b: dict[str, np.ndarray]
    S: csr_array
    K: csr_array
    weights: np.ndarray
    initial: dict[str, np.ndarray]


def matrices(
    case: CaseLike, *, timeout: float | None = None, program: StrPath | None = None
) -> Matrices:
    """Return the matrices of a case, of its whole grid.

    Needs SciPy (``pip install "phasewarp[matrices]"``). The program writes them as text; take this
    for up to some 10⁵ cells.

    Parameters
    ----------
    case
        The case, or its file.
    timeout, program
        As for :func:`phasewarp.run`.

    Raises
    ------
    CaseError
        If there is a mistake in the case, or the inflow depends on time.
    """
    from scipy.io import mmread

    with tempfile.TemporaryDirectory(prefix="phasewarp-") as place, as_case(case).arguments() as w:
        call(["export-matrix", *w, "--output", place], timeout=timeout, program=program)
        directory = Path(place)

        def matrix(name: str) -> csr_array:
            from scipy.sparse import csr_array

            return csr_array(mmread(directory / f"{name}.mtx"))

        def vectors(kind: str) -> dict[str, np.ndarray]:
            found = sorted(directory.glob(f"{kind}_*.npy"))
            return {path.stem.removeprefix(f"{kind}_"): np.load(path) for path in found}

        return Matrices(
            A=matrix("A"),
            b=vectors("b"),
            S=matrix("S"),
            K=matrix("K"),
            weights=np.load(directory / "weights.npy"),
            initial=vectors("initial"),
        )
