"""The lines of Python in the documents run as they stand, in their order."""

from __future__ import annotations

import re
from pathlib import Path

import pytest
from conftest import CASES

import phasewarp as pw

ROOT = CASES.parent


@pytest.mark.parametrize("name", ["README.md", "docs/python.md"])
@pytest.mark.filterwarnings("ignore::phasewarp.PhasewarpWarning")
def test_lines_of(name: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    program = pw.find_program()
    monkeypatch.setenv("PHASEWARP", str(program))
    monkeypatch.setenv("MPLBACKEND", "agg")
    monkeypatch.chdir(tmp_path)
    (tmp_path / "cases").symlink_to(CASES)
    text = (ROOT / name).read_text("utf-8")
    blocks = re.findall(r"^```python\n(.*?)^```", text, flags=re.MULTILINE | re.DOTALL)
    assert blocks
    names: dict[str, object] = {}
    for block in blocks:
        exec(compile(block, name, "exec"), names)
