"""The documents: their blocks run in their order and print what is shown; what they name exists."""

from __future__ import annotations

import functools
import os
import re
import shlex
import subprocess
import tomllib
from collections.abc import Collection, Iterator
from itertools import pairwise
from pathlib import Path

import pytest
from conftest import CASES

import phasewarp as pw

ROOT = CASES.parent
PAGES = [
    *ROOT.glob("*.md"),
    *ROOT.glob("docs/*.md"),
    *(ROOT / folder / "README.md" for folder in ("cases", "jobscripts", "python")),
]

FENCE = re.compile(r'^```(\w*)(?: title="([^"]+)")?\n(.*?)^```', re.MULTILINE | re.DOTALL)
LINK = re.compile(r"\]\(([^)#\s]+)[^)]*\)")
PATH = re.compile(
    r"`((?:benches|cases|docs|examples|jobscripts|python|scripts|src|tests)/[^`\s]*)`"
)
SOURCE = re.compile(r"`([\w/]+\.rs)`")
# `src/a/b.rs` `name` `Type::method`: what a file defines.
DEFINED = re.compile(r"`(src/[\w/]+\.rs)`((?: `[A-Za-z_:]+`)+)")


def squeezed(text: str) -> str:
    """Return `text` with single spaces, without seconds and without dots for what is left out."""
    text = re.sub(r"(done in) [0-9.]+ s", r"\1", text)
    return re.sub(r" +", " ", text).replace(" …", "")


# Commands that build, install or fetch.
NOT_HERE = re.compile(r"^(make|git clone|sudo|apt-get|pip) .*\n?", re.MULTILINE)
# Pages whose blocks run, and the languages of those.
BLOCKS = {
    "README.md": ["sh", "python"],
    "docs/python.md": ["python"],
    "docs/first-hour.md": ["sh", "python"],
    "docs/first-problem.md": ["toml", "sh", "python"],
    "docs/how-to.md": ["toml", "sh", "python"],
}


@pytest.mark.parametrize(("name", "languages"), BLOCKS.items())
@pytest.mark.filterwarnings("ignore::phasewarp.PhasewarpWarning")
def test_blocks_of(
    name: str, languages: list[str], tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    program = pw.find_program()
    monkeypatch.setenv("PHASEWARP", str(program))
    monkeypatch.setenv("PATH", f"{program.parent}{os.pathsep}{os.environ['PATH']}")
    monkeypatch.setenv("MPLBACKEND", "agg")
    monkeypatch.chdir(tmp_path)
    (tmp_path / "cases").symlink_to(CASES)
    names: dict[str, object] = {}
    seen = set()
    output = ""
    for language, title, block in FENCE.findall((ROOT / name).read_text("utf-8")):
        if language == "text" and "sh" in languages:
            for line in squeezed(block).splitlines():
                assert line in output, f"{name} shows what was not printed: {line}"
        if language not in languages:
            continue
        seen.add(language)
        if language == "python":
            exec(compile(block, name, "exec"), names)
        elif language == "sh":
            words = NOT_HERE.sub("", block)
            run = subprocess.run(["bash", "-ec", words], capture_output=True, text=True)
            assert run.returncode == 0, f"{block}\n{run.stdout}\n{run.stderr}"
            output += squeezed(run.stdout + run.stderr)
        else:
            assert title, f"a file without a name: {block}"
            (tmp_path / title).write_text(block, "utf-8")
    assert seen == set(languages)


# What stands for something of the reader's, and what a test takes for it.
PLACEHOLDERS = {
    "--vary KEY=VALUE": "--vary solver.tolerance=1e-2,1e-1",
    "CASE": "small.toml",
    "-np N": "-np 2",
    "-np 64": "-np 2",
    "T2": "0.6",
    "DIR2": "other",
    "DIR": "results/small",
    "~/.local/share/man/man1": "man1",
}
# Commands that take a minute or more, that build, or that take a case of few qubits, as those of
# tests/cli/simulator.rs do.
LONG = re.compile(r"phasewarp (advise|chart|stability)|--accuracy|--calibrate|--complete|scripts/")


def indented(text: str) -> list[str]:
    """Return the indented lines of a page, without comments; those that go on are one."""
    lines = [line for line in FENCE.sub("", text).splitlines() if line.startswith("    ")]
    joined = "\n".join(re.sub(r"\s+#\s.*", "", line[4:]) for line in lines)
    joined = re.sub(r"\s*\\\n\s*|\s*\n\s+(?=[-\[(])", " ", joined)
    return joined.splitlines()


def commands(text: str) -> Iterator[str]:
    """Yield the commands of a page that stand indented, each on one line, as they are written."""
    for line in indented(text):
        if re.match(r"(mpirun .*)?(phasewarp|scripts/\w+\.sh) ", line):
            yield line


def runnable(command: str) -> str:
    """Return a command of a page without what may be left out, for a small case."""
    while "[" in command:
        command = re.sub(r"(?:-o )?\[[^\[\]]*\]…?", "", command)
    for word, meant in PLACEHOLDERS.items():
        command = re.sub(rf"(?<![\w-]){re.escape(word)}\b", meant, command)
    return command.replace("…", "")


# Pages, and the least number of commands that run.
RUN = {"docs/usage.md": 15, "docs/quantum.md": 7, "docs/high-order.md": 2, "cases/README.md": 3}


@pytest.mark.parametrize("name", RUN)
def test_commands_of(
    name: str, small: pw.Case, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Commands of a page run on a small case, in their order, and have the options they name."""
    program = pw.find_program()
    monkeypatch.setenv("PATH", f"{program.parent}{os.pathsep}{os.environ['PATH']}")
    monkeypatch.chdir(tmp_path)
    (tmp_path / "cases").symlink_to(CASES)
    # Of a size that every command takes, with times for a movie.
    settings = {
        "axis.0.x": {"lower": -1.5, "upper": 1.5, "cells": 8},
        "axis.0.v": {"lower": -1.6, "upper": 1.6, "cells": 8},
        "time.end": 0.2,
        "scheme.interface": "conservative",
        "solver.tolerance": 1e-2,
        "solver.warp": {"profile": "exponential", "points": 32},
        "output.field_times": [0.1],
    }
    small.replace(settings).save("small.toml")
    subprocess.run(["phasewarp", "run", "small.toml"], check=True, capture_output=True)
    found = 0
    for written in commands((ROOT / name).read_text("utf-8")):
        command = re.search(r"phasewarp ([a-z-]+)", written)
        if command:
            said = subprocess.run(
                ["phasewarp", "help", command[1]], check=True, capture_output=True, text=True
            ).stdout
            for option in re.findall(r"(?<=[\s\[])--[a-z-]+", written):
                assert option in said, f"{written}: {command[1]} has no {option}"
        words = runnable(written)
        if LONG.search(words):
            continue
        # What is there already is replaced, as by a reader who tries one after the other.
        forced = re.search(r"phasewarp (run|sweep|export\S*) ", words) and "--continue" not in words
        run = subprocess.run(
            ["bash", "-ec", words + (" --force" if forced else "")],
            capture_output=True,
            text=True,
            timeout=60,
        )
        assert run.returncode == 0, f"{written}\n{words}\n{run.stdout}\n{run.stderr}"
        found += 1
    # The same in fences; of a row of sizes the first two.
    for language, _, block in FENCE.findall((ROOT / name).read_text("utf-8")):
        if language == "sh":
            words = re.sub(r"(for N in \d+ \d+)[ \d]*", r"\1", block)
            subprocess.run(["bash", "-ec", words], check=True, capture_output=True, timeout=60)
            found += 1
    assert found >= RUN[name]


# What stands for values in commands, and what a test takes for it.
VALUES = {
    "KEY=VALUE": "solver.tolerance=1e-3",
    "K=V": "solver.tolerance=1e-3",
    "NAME": "example1",
    "exampleN": "example1",
    "cases/CASE.toml": "cases/example1.toml",
    "EPSILON": "1e-2",
    "ε": "1e-2",
    "T": "1e-3",
    "K": "2",
    "N": "2",
}
COMMAND = re.compile(r"(?:mpirun -np \S+ )?phasewarp (?=[a-z])[^`]*")


def all_commands(text: str, languages: Collection[str] = ("sh", "console")) -> Iterator[str]:
    """Yield the commands of a page: in blocks of `languages`, indented, and in the lines."""
    for block in (block for language, _, block in FENCE.findall(text) if language in languages):
        for line in re.sub(r"\s*\\\n\s*", " ", block).splitlines():
            yield re.sub(r"\s#\s.*", "", line.removeprefix("$ "))
    rest = FENCE.sub("", text)
    yield from commands(rest)
    for line in indented(rest):
        if re.match(r"(make|scripts/\w+\.py|jobscripts/|sbatch|bash) ?\S", line):
            yield line
    for span in re.findall(r"`([^`]+)`", rest):
        if re.match(r"make \w|scripts/\S+ ", span) or COMMAND.match(span):
            yield " ".join(span.split())


@functools.cache
def help_of(command: str) -> str | None:
    """Return what the program says of one of its commands, or nothing if there is none."""
    said = subprocess.run(["phasewarp", "help", command], capture_output=True, text=True)
    return said.stdout if said.returncode == 0 else None


@functools.cache
def refusal(*words: str) -> str | None:
    """Return why `phasewarp check` refuses a case."""
    found = subprocess.run(["phasewarp", "check", *words], capture_output=True, text=True)
    return found.stderr if found.returncode else None


def wrong_in(command: str, made: set[str]) -> str | None:
    """Return what is wrong with a command: an option, a case, a script, a target of `make`.

    Nothing is solved: of a command with a case the case is checked with its `--set` options.
    Files that a page makes itself, `made`, are not looked for.
    """
    words = shlex.split(command.replace("…", " "))
    if words[:1] == ["make"]:
        targets = re.findall(r"^([\w-]+)(?=[^=]*:)", (ROOT / "Makefile").read_text("utf-8"), re.M)
        targets += [f"example3-{n}" for n in (8, 16, 32, 64)]
        named = [word for word in words[1:] if re.fullmatch(r"[a-z][\w-]*", word)]
        return next((f"make has no {word}" for word in named if word not in targets), None)
    named = [word for word in words if re.match(r"(cases|scripts|jobscripts)/.+\.\w+$", word)]
    for path in named:
        path = re.sub(r"\b(NAME|CASE|exampleN)\b", "example1", path)
        if not (ROOT / path).exists():
            return f"there is no {path}"
    if "phasewarp" not in words:
        return None
    words = words[words.index("phasewarp") + 1 :]
    said = help_of(words[0])
    if said is None:
        return f"no command {words[0]}"
    for word in words:
        option = re.match(r"\[*(--[a-z-]+)", word)
        if option and not re.search(rf"{option[1]}(?![a-z-])", said):
            return f"{words[0]} has no {option[1]}"
    if len(words) < 2 or not words[1].endswith(".toml") or words[1] in made or words[0] == "init":
        return None
    settings = [word for before, word in pairwise(words) if before == "--set"]
    settings = [f"--set={valued(word)}" for word in settings if not word.endswith("=")]
    return refusal(valued(words[1]), *settings)


def valued(word: str) -> str:
    """Return a word of a command with values in the place of names for them."""
    for name, value in VALUES.items():
        word = re.sub(rf"(?<![\w-]){re.escape(name)}(?!\w)", value, word)
    return word


@pytest.mark.parametrize("page", PAGES, ids=lambda page: str(page.relative_to(ROOT)))
def test_commands_are_those_of_the_program(
    page: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Commands of every page parse, and name cases, keys, scripts and targets that are there."""
    program = pw.find_program()
    monkeypatch.setenv("PATH", f"{program.parent}{os.pathsep}{os.environ['PATH']}")
    monkeypatch.chdir(tmp_path)
    (tmp_path / "cases").symlink_to(CASES)
    text = page.read_text("utf-8")
    made = {title for _, title, _ in FENCE.findall(text)} | {"mine.toml"}
    # Those of blocks that run are tested by that.
    name = str(page.relative_to(ROOT))
    run = name in RUN or "sh" in BLOCKS.get(name, [])
    languages = ["console"] if run else ["console", "sh"]
    found = {command: wrong_in(command, made) for command in set(all_commands(text, languages))}
    assert {command: why for command, why in found.items() if why} == {}


def test_wrong_commands_are_found(monkeypatch: pytest.MonkeyPatch) -> None:
    program = pw.find_program()
    monkeypatch.setenv("PATH", f"{program.parent}{os.pathsep}{os.environ['PATH']}")
    monkeypatch.chdir(ROOT)
    text = (
        "```sh\nphasewarp run cases/example1.toml \\\n    --sett time.end=1   # why\n```\n"
        "```console\n$ sbatch jobscripts/absent.sbatch\n```\n"
        "Of `phasewarp check cases/absent.toml`, `phasewarp rn CASE`, `make absent` and\n"
        "`phasewarp plan cases/example1.toml --set solver.tolerence=T`,\n"
        "`phasewarp plan cases/example1.toml --set solver.tolerance=T`:\n\n"
        "    scripts/absent.sh smooth     # why\n"
    )
    found = [wrong_in(command, set()) or "" for command in all_commands(text)]
    said = ["no --sett", "absent.sbatch", "absent.sh", "absent.toml", "no command rn", "no absent"]
    for why, words in zip(found, [*said, "did you mean", ""], strict=True):
        assert words in why and bool(words) == bool(why), found


def test_parts_of_a_case_in_readout(small: pw.Case) -> None:
    """The tables that the page shows are those of a case."""
    found = 0
    for language, _, block in FENCE.findall((ROOT / "docs/readout.md").read_text("utf-8")):
        if language == "toml":
            tables = tomllib.loads(block)
            assert pw.check(small.replace(tables))["ok"]
            found += 1
    assert found > 0


def test_commands_are_made_runnable() -> None:
    text = (
        "    mpirun -np N phasewarp run CASE [-o DIR] [--set K=V]… [-v]   # why\n"
        "                                    [--ranks-x N[,N…]]\n"
        "    phasewarp run --continue DIR --until T2 [the same options]\n"
    )
    assert [" ".join(runnable(command).split()) for command in commands(text)] == [
        "mpirun -np 2 phasewarp run small.toml",
        "phasewarp run --continue results/small --until 0.6",
    ]


def missing(text: str, folder: Path) -> Iterator[str]:
    """Yield what a page in `folder` names and what does not exist."""
    for path in PATH.findall(text):
        if not re.search(r"[*<…]|NAME|\bN\b", path) and not (ROOT / path).exists():
            yield path
    files = {
        path.name for place in ("src", "tests", "benches") for path in (ROOT / place).rglob("*.rs")
    } | {"build.rs"}
    for path in SOURCE.findall(text):
        if Path(path).name not in files | {"NAME.rs"}:
            yield path
    for path, words in DEFINED.findall(text):
        source = (ROOT / path).read_text("utf-8") if (ROOT / path).is_file() else ""
        for word in re.findall(r"`([^`]+)`", words):
            kinds = r"(?:fn|struct|enum|trait|const|type|mod)"
            if not re.search(rf"\b{kinds} {word.split('::')[-1]}\b", source):
                yield f"{path} {word}"
    for target in LINK.findall(FENCE.sub("", text)):
        if "://" not in target and not (folder / target).exists():
            yield target


@pytest.mark.parametrize("page", PAGES, ids=lambda page: str(page.relative_to(ROOT)))
def test_what_is_named_exists_in(page: Path) -> None:
    assert list(missing(page.read_text("utf-8"), page.parent)) == []


def test_what_is_missing_is_found() -> None:
    text = (
        "[a](docs/absent.md#b) `src/absent.rs` `absent.rs` `src/main.rs` `absent`"
        " [b](docs/usage.md) `src/main.rs` `main` `scripts/setup.sh`"
    )
    found = list(missing(text, ROOT))
    assert found == [
        "src/absent.rs",
        "src/absent.rs",
        "absent.rs",
        "src/main.rs absent",
        "docs/absent.md",
    ]


def test_every_equation_of_the_paper_has_its_place() -> None:
    numbered = {1: 3, 2: 5, 3: 13, 4: 22, 5: 21, 6: 14, 7: 16, 8: 8}  # the last of each section
    text = (ROOT / "docs/theory.md").read_text("utf-8")
    found = set()
    for section, first, last in re.findall(r"\((\d)\.(\d+)\)(?: to \(\1\.(\d+)\))?", text):
        numbers = range(int(first), int(last or first) + 1)
        found |= {(int(section), number) for number in numbers}
    assert found == {(section, k) for section, last in numbered.items() for k in range(1, last + 1)}
