"""The documents: their blocks run in their order and print what is shown; what they name exists."""

from __future__ import annotations

import os
import re
import subprocess
import tomllib
from collections.abc import Iterator
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


# Of the first two only the lines of Python run: their commands build and install.
@pytest.mark.parametrize(
    ("name", "languages"),
    [
        ("README.md", ["python"]),
        ("docs/python.md", ["python"]),
        ("docs/first-hour.md", ["sh", "python"]),
        ("docs/first-problem.md", ["toml", "sh", "python"]),
        ("docs/how-to.md", ["toml", "sh", "python"]),
    ],
)
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
            run = subprocess.run(["bash", "-ec", block], capture_output=True, text=True)
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
# Commands that take a minute or more, or that build.
LONG = re.compile(r"phasewarp (advise|chart|stability)|--accuracy|--calibrate|scripts/")


def commands(text: str) -> Iterator[str]:
    """Yield the commands of a page that stand indented, each on one line, as they are written."""
    lines = [line for line in FENCE.sub("", text).splitlines() if line.startswith("    ")]
    joined = "\n".join(re.sub(r"\s+#\s.*", "", line[4:]) for line in lines)
    joined = re.sub(r"\s*\\?\n\s+(?=[-\[(])", " ", joined)
    for line in joined.splitlines():
        if re.match(r"(mpirun .*)?(phasewarp|scripts/\w+\.sh) ", line):
            yield line


def runnable(command: str) -> str:
    """Return a command of a page without what may be left out, for a small case."""
    while "[" in command:
        command = re.sub(r"(?:-o )?\[[^\[\]]*\]…?", "", command)
    for word, meant in PLACEHOLDERS.items():
        command = re.sub(rf"(?<![\w-]){re.escape(word)}\b", meant, command)
    return command.replace("…", "")


@pytest.mark.parametrize("name", ["usage.md", "quantum.md", "high-order.md"])
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
    for written in commands((ROOT / "docs" / name).read_text("utf-8")):
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
    for language, _, block in FENCE.findall((ROOT / "docs" / name).read_text("utf-8")):
        if language == "sh":
            words = re.sub(r"(for N in \d+ \d+)[ \d]*", r"\1", block)
            subprocess.run(["bash", "-ec", words], check=True, capture_output=True, timeout=60)
            found += 1
    assert found >= {"usage.md": 15, "quantum.md": 7, "high-order.md": 2}[name]


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
