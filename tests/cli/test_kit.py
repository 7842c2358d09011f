"""``vcfbench kit``: the program is written, and what it recorded is checked."""

from __future__ import annotations

import json
from typing import TYPE_CHECKING

import pytest
from typer.testing import CliRunner

from tests.testing.kit.recording import recorded
from vcfbench.cli.main import app
from vcfbench.drivers.trace import HEADER

if TYPE_CHECKING:
    from pathlib import Path


def test_the_kit_is_written_once(tmp_path: Path) -> None:
    file = str(tmp_path / "kit.py")
    assert CliRunner().invoke(app, ["kit", "write", file]).exit_code == 0
    again = CliRunner().invoke(app, ["kit", "write", file])
    assert (again.exit_code, "cannot be written: File exists" in again.output) == (2, True)


def test_bundle_has_summary_line_and_line_per_difference(tmp_path: Path) -> None:
    path = tmp_path / "a.trace"
    recorded(path, "34401A", driven=False)
    same = CliRunner().invoke(app, ["kit", "check", str(path)])
    assert (same.exit_code, same.output[:47]) == (0, "seen on a 34401A, firmware 11-5-2 (read): 62 co")
    path.write_text(path.read_text().replace("+1.00000000E+01\\n", "10\\n"))
    other = CliRunner().invoke(app, ["kit", "check", str(path)])
    assert other.exit_code == 1
    assert "  VOLT:RANG?: form: expected +1.00000000E+01, got 10\n" in other.output
    (seen,) = json.loads(CliRunner().invoke(app, ["kit", "check", str(path), "--json"]).output)["seen"]
    assert {"command": "VOLT:RANG?", "status": "form", "expected": "+1.00000000E+01", "got": "10"} in seen["findings"]


@pytest.mark.parametrize(
    ("text", "words"),
    [
        ("volts\n", "expected a trace"),
        (f"{HEADER}\n", "0 commands: nothing in it"),
        (f"{HEADER}\n0.0\t34401A\tGPIB::INSTR\topen\tgpib\n", "0 commands: nothing in it"),
    ],
)
def test_what_is_no_bundle_is_refused(tmp_path: Path, text: str, words: str) -> None:
    (tmp_path / "a.trace").write_text(text)
    refused = CliRunner().invoke(app, ["kit", "check", str(tmp_path / "a.trace")])
    assert (refused.exit_code, words in refused.output) == (2, True)
