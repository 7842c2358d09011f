"""``--trace`` writes what passes, for every command that opens instruments."""

from __future__ import annotations

from typing import TYPE_CHECKING

import pytest
from simrack_tests.cells import few
from typer.testing import CliRunner

from vcfbench.cli.main import app
from vcfbench.testing import read_trace

if TYPE_CHECKING:
    from pathlib import Path


@pytest.fixture(autouse=True)
def _here(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("XDG_STATE_HOME", str(tmp_path))
    monkeypatch.chdir(tmp_path)


SHORT = ("--set", "rates_deg_s=10,0,-10", "--set", "samples=2", "--set", "settle_s=0.5", "--quiet")
COMMANDS = {
    "bench check": (("bench", "check"), {"power", "rate_source", "multimeter", "oscilloscope", "rate_table"}),
    "discover": (("bench", "discover", "--library", "@vcfbench"), {"GPIB0::5::INSTR"}),
    "safe": (("safe", "--bench", "paper"), {"power", "rate_source", "rate_table"}),
    "talk": (("talk", "-c", "multimeter *IDN?"), {"multimeter"}),
    "run": (("run", "turntable", *SHORT), {"power", "rate_source", "multimeter", "oscilloscope", "rate_table"}),
}


@pytest.mark.parametrize("name", few(COMMANDS, every=3))
def test_what_passes_is_written(name: str, tmp_path: Path) -> None:
    words, roles = COMMANDS[name]
    done = CliRunner().invoke(app, [*words, "--trace", "x.trace"])
    assert done.exit_code == 0, done.stderr
    lines = read_trace(tmp_path / "x.trace")
    assert {line.role for line in lines} >= roles
    assert any(line.mark == ">" and line.data == b"*IDN?\n" for line in lines)
    assert not (tmp_path / "y.trace").exists()


@pytest.mark.exhaustive
def test_simulated_run_has_same_trace_every_time(tmp_path: Path) -> None:
    for name in ("a", "b"):
        done = CliRunner().invoke(app, ["run", "turntable", *SHORT, "--seed", "3", "--trace", name])
        assert done.exit_code == 0
    assert (tmp_path / "a").read_bytes() == (tmp_path / "b").read_bytes()


def test_a_trace_that_cannot_be_written_is_said_first(tmp_path: Path) -> None:
    done = CliRunner().invoke(app, ["run", "turntable", *SHORT, "--trace", str(tmp_path)])
    assert done.exit_code == 2
    assert "cannot be written" in done.stderr
    assert not (tmp_path / "runs").exists()
