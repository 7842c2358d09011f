"""The example project, as its owner would run it."""

from __future__ import annotations

import re
import shutil
from pathlib import Path
from typing import TYPE_CHECKING

from tests.testing.test_plugin import run
from vcfbench.bench.file import load_bench
from vcfbench.sim.faults import read_faults

if TYPE_CHECKING:
    import pytest

ROOT = Path(__file__).parents[1]
LAB = ROOT / "examples" / "lab-tests"


def test_the_labs_tests_pass_away_from_here(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("XDG_STATE_HOME", str(tmp_path / "state"))
    folder = tmp_path / "lab"
    shutil.copytree(LAB, folder, ignore=shutil.ignore_patterns("__pycache__", ".*"))
    done = run(folder, "-q")
    assert done.returncode == 0, done.stdout
    passed = re.search(r"(\d+) passed in", done.stdout)
    assert passed is not None
    assert int(passed[1]) >= 14
    assert "skipped" not in done.stdout


def test_the_labs_files_are_what_they_say() -> None:
    station = load_bench(LAB / "lab.toml")
    assert not station.simulated
    for script in (LAB / "faults").glob("*.toml"):
        assert read_faults(script)
