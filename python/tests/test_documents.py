"""The documents: their blocks run in their order and print what is shown; what they name exists."""

from __future__ import annotations

import os
import re
import subprocess
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
