"""Runs the program phasewarp and opens its results.

phasewarp emulates a quantum algorithm for the Liouville equation with potential barriers. This
package writes cases, starts the program (on MPI ranks), and hands over what it found as labelled
arrays, tables and sparse matrices. The program computes; this package does not.

>>> import phasewarp as pw
>>> case = pw.Case("cases/example1.toml")
>>> case["solver.tolerance"] = 1e-9
>>> result = pw.run(case, "results/example1", ranks=2)
>>> density = result.open()["density"]
"""

from phasewarp.case import Case, potential_table, write_table, write_warped
from phasewarp.commands import (
    advise,
    check,
    continue_run,
    describe,
    optimise,
    plan,
    resources,
    run,
    spectrum,
)
from phasewarp.matrices import Matrices, matrices
from phasewarp.program import (
    CaseError,
    PhasewarpError,
    PhasewarpWarning,
    ProgramNotFoundError,
    StoppedError,
    TimedOutError,
    find_program,
)
from phasewarp.result import Result, open_result
from phasewarp.sweep import latex, sweep

__all__ = [
    "Case",
    "CaseError",
    "Matrices",
    "PhasewarpError",
    "PhasewarpWarning",
    "ProgramNotFoundError",
    "Result",
    "StoppedError",
    "TimedOutError",
    "advise",
    "check",
    "continue_run",
    "describe",
    "find_program",
    "latex",
    "matrices",
    "open_result",
    "optimise",
    "plan",
    "potential_table",
    "resources",
    "run",
    "spectrum",
    "sweep",
    "write_table",
    "write_warped",
]
