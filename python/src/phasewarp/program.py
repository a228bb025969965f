"""Finds the program, starts it on MPI ranks, and turns its failures into exceptions."""

from __future__ import annotations

import operator
import os
import re
import shlex
import shutil
import subprocess
import warnings
from collections.abc import Sequence
from pathlib import Path
from typing import Any

StrPath = str | os.PathLike[str]

#: Seconds that the program has for ending by itself before it is killed.
GRACE = 10.0

#: How the names of directories begin that hold a case for the time of a call.
TEMPORARY = "phasewarp-"

#: Options in the program's messages, and what they are here.
IN_PYTHON = {
    r"(?<![\w-])--resume(?![\w-])": "resume=True",
    r"(?<![\w-])--force(?![\w-])": "force=True",
    r"-o gives another directory": "another directory can be given",
    r"phasewarp advise .* --accuracy ε": "pw.advise(case, ε)",
}

#: Lines of the program that become warnings: its own, and those that put a result in doubt.
NOTEWORTHY = re.compile(
    r"warning: |UNDER-RESOLVED: |STAIRCASE: |(tolerance|accuracy) \S+ .*(MISSED|NOT SHOWN)"
    r"|accuracy: (.*; )?error of the grid not estimated|error (inherited|since t = 0).* not known"
)

#: Columns of the lines that the program prints for people.
COLUMNS = 100


class PhasewarpError(RuntimeError):
    """The program failed: its message, and its exit code.

    Attributes
    ----------
    exit_code : int
        What the program (or the MPI launcher) returned.
    command : list of str
        The command as it was started.
    output : str
        What it wrote to standard output.
    """

    def __init__(
        self, message: str, exit_code: int, command: Sequence[str], output: str = ""
    ) -> None:
        super().__init__(message)
        self.exit_code = exit_code
        self.command = list(command)
        self.output = output


class CaseError(PhasewarpError, ValueError):
    """The case, an option or the output directory is wrong (exit code 2).

    Attributes
    ----------
    details : dict or None
        Of :func:`check`: `key`, `value`, `message`, `file`, `line`, `column` and `set`, each None
        where there is none, `exit_code` and `text`.
    """

    details: dict[str, Any] | None = None


class StoppedError(PhasewarpError):
    """The run stopped early and left a checkpoint (exit code 75); `resume=True` continues."""


class TimedOutError(PhasewarpError, TimeoutError):
    """The run was ended because it took longer than `timeout`.

    `exit_code` is 75 where the program stopped by itself, -9 where it had to be killed, and with
    a launcher whatever that returned.
    """


class ProgramNotFoundError(FileNotFoundError):
    """There is no program, or no MPI launcher, to start."""


class PhasewarpWarning(UserWarning):
    """A warning of the program."""


def find_program(program: StrPath | None = None) -> Path:
    """Find the program phasewarp.

    Looks at `program`, the environment variable ``PHASEWARP``, ``PATH``, and ``target/release`` of
    the checkout around the working directory or around this package, in this order.

    Raises
    ------
    ProgramNotFoundError
        If it is in none of these places, or if the named one is no executable file.
    """
    for source, named in [("program", program), ("PHASEWARP", os.environ.get("PHASEWARP"))]:
        if named:
            found = shutil.which(named)
            if found is None:
                raise ProgramNotFoundError(f"{source} = {named}: no executable file")
            return Path(found).absolute()
    found = shutil.which("phasewarp")
    if found is not None:
        return Path(found).absolute()
    for place in (Path.cwd(), Path(__file__).resolve().parent):
        for root in (place, *place.parents):
            candidate = root / "target" / "release" / "phasewarp"
            if (root / "Cargo.toml").is_file() and os.access(candidate, os.X_OK):
                return candidate
    raise ProgramNotFoundError(
        "the program phasewarp was not found: build it with `make` in its checkout, then put "
        "target/release on PATH or set the environment variable PHASEWARP to the program"
    )


def launcher(ranks: int) -> list[str]:
    """Return the words that start `ranks` MPI ranks; none for one rank.

    The environment variable ``PHASEWARP_LAUNCHER`` replaces ``mpirun -np {ranks}``, for example by
    ``srun -n {ranks}``.
    """
    ranks = whole("ranks", ranks)
    if ranks < 1:
        raise ValueError(f"ranks = {ranks}: must be at least 1")
    template = os.environ.get("PHASEWARP_LAUNCHER")
    if template is None and ranks == 1:
        return []
    words = shlex.split(template or "mpirun -np {ranks}")
    return [word.replace("{ranks}", str(ranks)) for word in words]


def whole(name: str, value: Any) -> int:
    """Return a whole number; `TypeError` for anything else, also for 2.0 and "2"."""
    try:
        return operator.index(value)
    except TypeError:
        raise TypeError(f"{name} = {value!r}: a whole number expected") from None


def call(
    arguments: Sequence[StrPath],
    *,
    ranks: int = 1,
    timeout: float | None = None,
    program: StrPath | None = None,
) -> str:
    """Run the program to its end and return what it wrote on standard output.

    Warnings of the program become :class:`PhasewarpWarning`. If the caller is interrupted, so is
    the program.

    Parameters
    ----------
    arguments
        Command and options.
    ranks
        MPI ranks.
    timeout
        Seconds after which the program is ended.
    program
        As for :func:`find_program`.

    Raises
    ------
    PhasewarpError
        As the exit code says: :class:`CaseError`, :class:`StoppedError` or itself.
    TimedOutError
        After `timeout`.
    ProgramNotFoundError
        If there is nothing to start.
    """
    command = [
        *launcher(ranks),
        str(find_program(program)),
        *(os.fspath(word) for word in arguments),
    ]
    try:
        process = subprocess.Popen(
            command,
            stdin=subprocess.DEVNULL,
            stdout=subprocess.PIPE,
            stderr=subprocess.PIPE,
            encoding="utf-8",
            errors="replace",
        )
    except FileNotFoundError as error:
        raise ProgramNotFoundError(
            f"{command[0]}: not found; PHASEWARP_LAUNCHER names another way to start MPI ranks"
        ) from error
    try:
        output, errors = process.communicate(timeout=timeout)
    except subprocess.TimeoutExpired as error:
        end(process)
        message = f"not done after {timeout:g} s, and ended"
        raise TimedOutError(message, process.returncode, command) from error
    except BaseException:
        end(process)
        raise
    # Lines are joined first: a shorter name leaves room for the word that follows.
    errors = without_places(unwrapped(errors), arguments)
    output, lines = (without_places(text, arguments) for text in (output, unwrapped(output)))
    if process.returncode != 0:
        kinds = {2: CaseError, 75: StoppedError}
        kind = kinds.get(process.returncode, PhasewarpError)
        raise kind(in_python(message_of(errors)), process.returncode, command, output)
    for line in (*errors.splitlines(), *lines.splitlines()):
        if NOTEWORTHY.match(line):
            said = in_python(line).removeprefix("warning: ")
            warnings.warn(said, PhasewarpWarning, stacklevel=3)
    return output


def without_places(text: str, arguments: Sequence[StrPath]) -> str:
    """Return `text` with the bare names of files that are gone after the call."""
    for word in arguments:
        place = os.path.dirname(os.fspath(word))  # noqa: PTH120
        if os.path.basename(place).startswith(TEMPORARY):  # noqa: PTH119
            text = text.replace(place + os.sep, "")
    return text


def in_python(message: str) -> str:
    """Return a message of the program with the words of this package for its options."""
    for option, words in IN_PYTHON.items():
        message = re.sub(option, words, message)
    return message


def end(process: subprocess.Popen[str]) -> None:
    """Ask `process` to end, and kill it if it does not within :data:`GRACE`."""
    process.terminate()
    try:
        process.communicate(timeout=GRACE)
    except subprocess.TimeoutExpired:
        process.kill()
        process.communicate()


def unwrapped(text: str) -> str:
    """Return `text` without the ends of lines that are there only so that lines fit.

    Such a line has no room for the word that follows, which is indented.
    """
    joined: list[str] = []
    last = ""
    for line in text.splitlines():
        word = next(iter(line.split()), "")
        # What a command for a shell goes on behind is a backslash; rows of tables have wide gaps.
        full = "  " not in line.strip() and len(last) + 1 + len(word) > COLUMNS
        if joined and line.startswith(" ") and (full or last.endswith(" \\")):
            joined[-1] = joined[-1].removesuffix(" \\") + " " + line.lstrip(" ")
        else:
            joined.append(line)
        last = line
    return "\n".join(joined)


def message_of(errors: str) -> str:
    """Return what the program said on standard error, without the launcher's own lines."""
    _, marker, after = errors.partition("error: ")
    said = (after if marker else errors).split("\n-----", 1)[0].strip()
    stopped = [line for line in said.splitlines() if line.startswith("stopped by ")]
    return "\n".join(stopped) or said or "it said nothing on standard error"
