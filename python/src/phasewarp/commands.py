"""The program's commands as functions."""

from __future__ import annotations

import json
import warnings
from collections.abc import Iterable, Mapping, Sequence
from pathlib import Path
from typing import Any, Literal, get_args, overload

import numpy as np
import pandas as pd

from phasewarp.case import Case, plain, toml
from phasewarp.program import CaseError, PhasewarpWarning, StrPath, call, whole
from phasewarp.result import Result

CaseLike = Case | StrPath
Mode = Literal["streamed", "full"]
Option = str | float | bool | Iterable[int] | None


def as_case(case: CaseLike) -> Case:
    """Return a case; of a path, the case in that file."""
    return case if isinstance(case, Case) else Case(case)


def refuse_unknown_mode(mode: Mode | None) -> None:
    """Raise `ValueError` for a mode that is none."""
    if mode not in (None, *get_args(Mode)):
        raise ValueError(f"mode = {mode!r}: one of {get_args(Mode)} expected")


def options(**values: Option) -> list[str]:
    """Return the words of those options that are given: ``memory_per_rank`` as its option."""
    words = []
    for name, value in values.items():
        option = "--" + name.replace("_", "-")
        if isinstance(value, np.generic):
            value = value.item()
        if value is True:
            words.append(option)
        elif isinstance(value, str | int | float) and value is not False:
            words.append(f"{option}={value}")
        elif isinstance(value, Iterable):
            words.append(f"{option}=" + ",".join(str(whole(name, item)) for item in value))
    return words


def check(case: CaseLike, *, program: StrPath | None = None) -> dict[str, Any]:
    """Return the case as the program understands it: what ``check --json`` prints.

    ``axes``, ``cells``, ``settings``, ``bounds`` of the matrix, what is left out (``dropped``,
    ``kept``), the ``ledger`` and ``warnings``, which are also given as :class:`PhasewarpWarning`.

    Raises
    ------
    CaseError
        With file, line, key, value and limit, if there is a mistake; the same in parts in its
        ``details``.
    """
    with as_case(case).arguments() as words:
        try:
            found = json.loads(call(["check", *words, "--json"], program=program))
        except CaseError as error:
            if error.output.startswith("{"):
                error.details = json.loads(error.output)["error"]
            raise
    for warning in found["warnings"]:
        warnings.warn(warning, PhasewarpWarning, stacklevel=2)
    return dict(found)


def describe(case: CaseLike, *, program: StrPath | None = None) -> str:
    """Return the case as the program understands it, in lines for people.

    Raises
    ------
    CaseError
        With file, line, key, value and limit, if there is a mistake.
    """
    with as_case(case).arguments() as words:
        return call(["check", *words], program=program)


@overload
def plan(
    case: CaseLike,
    ranks: int = 1,
    *,
    ranks_x: Iterable[int] | None = None,
    memory_per_rank: str | None = None,
    memory_per_node: str | None = None,
    ranks_per_node: int | None = None,
    calibrate: int | None = None,
    mode: Mode | None = None,
    program: StrPath | None = None,
) -> dict[str, Any]: ...


@overload
def plan(
    case: CaseLike,
    ranks: Iterable[int],
    *,
    ranks_x: Iterable[int] | None = None,
    memory_per_rank: str | None = None,
    memory_per_node: str | None = None,
    ranks_per_node: int | None = None,
    calibrate: int | None = None,
    mode: Mode | None = None,
    program: StrPath | None = None,
) -> pd.DataFrame: ...


def plan(
    case: CaseLike,
    ranks: int | Iterable[int] = 1,
    *,
    ranks_x: Iterable[int] | None = None,
    memory_per_rank: str | None = None,
    memory_per_node: str | None = None,
    ranks_per_node: int | None = None,
    calibrate: int | None = None,
    mode: Mode | None = None,
    program: StrPath | None = None,
) -> dict[str, Any] | pd.DataFrame:
    """Return what a run will cost: every derived number, memory array by array, process meshes.

    Nothing is solved. docs/usage.md, "Plan", says what the entries are: ``advice`` has the process
    meshes (`memory` in bytes a rank) and ``layout`` the arrays of the fullest rank in bytes.

    Of several numbers of ranks, return a table: one row a number, with `time` over that of the
    first, `efficiency` against one rank, `memory`, and which number is ``recommended``: the last
    that is worth it, or the first that fits if none is.

    Parameters
    ----------
    case
        The case, or its file.
    ranks
        MPI ranks of the run, or several numbers of them to compare.
    ranks_x
        Blocks along each space axis; by default chosen.
    memory_per_rank, memory_per_node
        Memory that may be taken, as ``"4GiB"``.
    ranks_per_node
        Ranks that share the memory of a node; by default all.
    calibrate
        Start so many ranks, here, run a few steps, and predict the seconds of `ranks` ranks,
        under ``calibration``; in a table in the columns `seconds` and `core_hours`.
    mode
        As for :func:`run`.
    program
        As for :func:`phasewarp.find_program`.

    Raises
    ------
    CaseError
        If the case or an option is wrong.
    ValueError
        For an unknown `mode`.
    """
    several = isinstance(ranks, Iterable)
    if isinstance(ranks, str):
        raise TypeError(
            f"ranks = {ranks!r}: a whole number or a list of them expected, as range(1, 9)"
        )
    refuse_unknown_mode(mode)
    numbers = list(ranks) if isinstance(ranks, Iterable) else [whole("ranks", ranks)]
    given = options(
        # The last twice: so a list of one number is a list, too.
        ranks=[*numbers, *numbers[-1:]] if several else numbers,
        ranks_x=ranks_x,
        memory_per_rank=memory_per_rank,
        memory_per_node=memory_per_node,
        ranks_per_node=ranks_per_node,
        calibrate=calibrate is not None,
        mode=mode,
        json=True,
    )
    with as_case(case).arguments() as words:
        text = call(["plan", *words, *given], ranks=calibrate or 1, program=program)
    return pd.DataFrame(json.loads(text)) if several else as_dict(text)


def advise(
    case: CaseLike,
    accuracy: float = 1e-2,
    *,
    budget: str = "60s",
    reproducible: bool = False,
    ranks: int = 1,
    timeout: float | None = None,
    program: StrPath | None = None,
) -> dict[str, Any]:
    """Return which grid and set-up bring the density to an accuracy, from runs on coarse grids.

    Each of ``entries`` has `settings`, ``KEY=VALUE`` words for the case, beside its `error`,
    `seconds` and `memory_bytes_per_rank`; ``best`` and ``best_classical`` are numbers of entries.

    Parameters
    ----------
    case
        The case, or its file.
    accuracy
        Relative L1 error of the density at the end.
    budget
        Time for the trials, as ``"60s"``.
    reproducible
        Count the work of the trials in place of their time: the same advice on every machine.
    ranks, timeout, program
        As for :func:`run`.
    """
    given = options(accuracy=accuracy, budget=budget, reproducible=reproducible, json=True)
    with as_case(case).arguments() as words:
        return as_dict(
            call(["advise", *words, *given], ranks=ranks, timeout=timeout, program=program)
        )


def resources(case: CaseLike, *, ranks: int = 1, program: StrPath | None = None) -> dict[str, Any]:
    """Return what the case takes on a quantum computer: sparsity, queries, qubits, probabilities.

    Of the set-up that is cheapest on a quantum computer, and under `own` of the case's. The
    entries are described in docs/quantum.md. Every number has a `label`: exact, emitted (gates that
    were counted), upper-bound, estimate, model or unavailable.

    Parameters
    ----------
    case
        The case, or its file.
    ranks, program
        As for :func:`run`.
    """
    given = options(format="json")
    with as_case(case).arguments() as words:
        return as_dict(call(["resources", *words, *given], ranks=ranks, program=program))


def optimise(
    case: CaseLike, *, ranks: int = 1, program: StrPath | None = None
) -> list[dict[str, Any]]:
    """Return what profiles, recovery points and `δ` take on a quantum computer, the least first.

    Each choice has `probability` as a pair, of the slice at the recovery point and of the window
    above it, and `cost`, Toffoli gates until the field is found, with T gates and rotations as
    such, repeated and amplified. `unitary_scheme` marks the unitary scheme beside another.

    Parameters
    ----------
    case
        The case, or its file.
    ranks, program
        As for :func:`run`.
    """
    given = options(format="json", optimise=True)
    with as_case(case).arguments() as words:
        found = call(["resources", *words, *given], ranks=ranks, program=program)
    return list(json.loads(found))


def spectrum(
    case: CaseLike,
    *,
    refine: Sequence[int] | None = None,
    ranks: int = 1,
    program: StrPath | None = None,
) -> dict[str, Any]:
    """Return both ends of the spectrum of `S`, measured, beside the bounds that a run relies on.

    Parameters
    ----------
    case
        The case, or its file.
    refine
        Repeat with so many times the cells on every axis.
    ranks, program
        As for :func:`run`.
    """
    given = options(refine=refine, json=True)
    with as_case(case).arguments() as words:
        return as_dict(call(["spectrum", *words, *given], ranks=ranks, program=program))


def run(
    case: CaseLike,
    directory: StrPath | None = None,
    *,
    output: StrPath | None = None,
    ranks: int = 1,
    mode: Mode | None = None,
    ranks_x: Iterable[int] | None = None,
    resume: bool = False,
    force: bool = False,
    walltime: str | float | None = None,
    timeout: float | None = None,
    program: StrPath | None = None,
) -> Result:
    """Solve a case.

    Parameters
    ----------
    case
        The case, or its file.
    directory
        Where the results go. It is refused if it holds other results, unless `force`. A case that
        comes from no file is written there, too, as ``case.toml``.
    output
        The same, as this argument was called before.
    ranks
        MPI ranks, started by ``mpirun -np`` or as ``PHASEWARP_LAUNCHER`` says.
    mode
        ``"full"`` keeps all modes and writes `w(t, x, v, p)`; ``"streamed"`` drops them.
    ranks_x
        Blocks along each space axis; the other ranks split the modes.
    resume
        Continue from the newest checkpoint in `directory`, on any number of ranks. A run that is
        finished there, of this case, is not repeated.
    force
        Replace the results of another run in `directory`.
    walltime
        Stop with a checkpoint before so much time has passed: seconds, or ``"90m"``.
    timeout
        Seconds after which the run is ended; what it did since its last checkpoint is lost.
    program
        As for :func:`phasewarp.find_program`.

    Raises
    ------
    CaseError
        If the case, an option or the directory is wrong, with the program's message.
    StoppedError
        If it stopped with a checkpoint: `walltime`, or a signal.
    TimedOutError
        After `timeout`.
    PhasewarpError
        For any other failure.
    ValueError
        For an unknown `mode`.
    """
    place = one_of(directory, output)
    if place is None:
        raise TypeError("directory: missing; where the results go")
    refuse_unknown_mode(mode)
    given = options(
        output=str(place),
        mode=mode,
        ranks_x=ranks_x,
        resume=resume,
        force=force,
        walltime=walltime,
    )
    with as_case(case).arguments(place) as words:
        call(["run", *words, *given], ranks=ranks, timeout=timeout, program=program)
    return Result(place)


def one_of(directory: StrPath | None, output: StrPath | None) -> Path | None:
    """Return the directory of a run, by either name of the argument."""
    if directory is not None and output is not None:
        raise TypeError("directory and output are one argument; give the first")
    given = output if directory is None else directory
    return None if given is None else Path(given)


def continue_run(
    result: Result | StrPath,
    until: float,
    directory: StrPath | None = None,
    *,
    output: StrPath | None = None,
    settings: Mapping[str, str | float | bool | Sequence[float]] | None = None,
    ranks: int = 1,
    resume: bool = False,
    force: bool = False,
    walltime: str | float | None = None,
    timeout: float | None = None,
    program: StrPath | None = None,
) -> Result:
    """Go on from the results of a finished run, with a plan of its own.

    Parameters
    ----------
    result
        The run, or its directory. It is not changed.
    until
        The final time, counted from 0 as all times.
    directory
        Where the new results go; by default ``DIR-until-T``, beside the directory of the run.
    output
        The same, as this argument was called before.
    settings
        Changes to the case by dotted keys, such as ``{"output.fields_every": 0.1}``. The grid
        stays.
    ranks, resume, force, walltime, timeout, program
        As for :func:`run`, which says what is raised.
    """
    begun = result.directory if isinstance(result, Result) else Path(result)
    place = one_of(directory, output)
    if place is None:
        beside = begun.resolve() if begun.name in ("", "..") else begun
        time = np.format_float_positional(float(until), trim="-")
        place = beside.with_name(f"{beside.name}-until-{time}")
    words = ["run", "--continue", str(begun), "--until", repr(float(until))]
    for key, value in (settings or {}).items():
        words += ["--set", f"{key}={toml(plain(value))}"]
    words += options(output=str(place), resume=resume, force=force, walltime=walltime)
    call(words, ranks=ranks, timeout=timeout, program=program)
    return Result(place)


def as_dict(text: str) -> dict[str, Any]:
    """Return the JSON object that the program printed."""
    found: dict[str, Any] = json.loads(text)
    return found
