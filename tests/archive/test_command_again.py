"""The command in a report, typed: it makes the same run again, whoever began it."""

from __future__ import annotations

import shlex
from typing import TYPE_CHECKING, Any

import pytest
from hypothesis import given
from hypothesis import strategies as st

import vcfbench
from tests import warm
from vcfbench.archive.reported import command_of
from vcfbench.cli.set_option import asked_by_command

if TYPE_CHECKING:
    from pathlib import Path

    from vcfbench import Run

ASKED: dict[str, Any] = {"rates_deg_s": [10.0, 0.0, -10.0], "samples": 2, "settle_s": 0.5}
KEYS = st.text("abcdefgh_", min_size=1, max_size=8)
PLAIN = st.one_of(
    st.booleans(),
    st.integers(-(10**6), 10**6),
    st.floats(allow_nan=False, allow_infinity=False, allow_subnormal=False),
    st.text(st.characters(exclude_categories=["Cs", "Cc"]), max_size=12),
    st.sampled_from(["150", "true", "1:5:1", "a,b", "[1]", " x ", '"']),
)
VALUES = st.one_of(PLAIN, st.lists(PLAIN, max_size=3))


@given(st.dictionaries(KEYS, st.one_of(VALUES, st.dictionaries(KEYS, VALUES, min_size=1, max_size=2)), max_size=4))
def test_settings_come_back_from_the_command_as_they_were(settings: dict[str, Any]) -> None:
    command = command_of({"procedure": "turntable", "options": {"settings": settings}})
    words = shlex.split(command or "")[3:]
    assert words[::2] == ["--set"] * (len(words) // 2)
    assert asked_by_command(words[1::2], {}, {}).values == settings


def typed_again(run: Run, folder: Path) -> Run:
    """Type the command that the report of `run` has, in `folder`, and return the run that it makes."""
    command = command_of(run.header)
    assert command is not None
    done = warm.run([*shlex.split(command), "--quiet"], folder)
    assert done.returncode == 0, done.stderr
    return vcfbench.load_run("last", folder / "runs")


def same(first: Run, again: Run) -> bool:
    """Tell whether two runs have the same points, results, settings, seed and metadata."""
    settings = [{k: v for k, v in each.header["settings"].items() if k != "station"} for each in (first, again)]
    stated = [(each.points, each.results, each.seed, each.metadata) for each in (first, again)]
    return settings[0] == settings[1] and stated[0] == stated[1]


def test_a_run_from_python_with_seed_0(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)
    told = {"dut": "G-1", "operator": "A. Person", "tags": {"batch": "7"}, "humidity_percent": 0.0}
    run = vcfbench.run("turntable", "ideal", seed=0, settings=ASKED, metadata=told)
    assert "--seed 0" in str(command_of(run.header))
    assert same(run, typed_again(run, tmp_path))


@pytest.mark.exhaustive
def test_a_run_of_a_batch(tmp_path: Path) -> None:
    (tmp_path / "plan.toml").write_text(
        'name = "b"\nbench = "ideal"\ndevices = ["G-1"]\n[[runs]]\nprocedure = "turntable"\n'
        "settings = { rates_deg_s = [10, 0, -10], samples = 2, settle_s = 0.5 }\n".replace("\\\n", "\n"),
        "utf-8",
    )
    assert warm.run(["vcfbench", "batch", "plan.toml", "--quiet"], tmp_path).returncode == 0
    run = vcfbench.load_run("last", tmp_path / "runs")
    assert same(run, typed_again(run, tmp_path))


def test_a_run_that_was_resumed_is_resumed_again() -> None:
    header = {
        "procedure": "zero",
        "simulated": True,
        "seed": 4,
        "options": {"resume": "runs/a", "runs": "runs", "speed": None, "quiet": True},
        "metadata": {"dut": "G-1"},
        "resumed_from": {"directory": "/data/runs/a"},
    }
    assert command_of(header) == "vcfbench resume /data/runs/a --quiet"


def test_command_again_has_measured_temperature_and_procedure_file() -> None:
    header = {
        "procedure": "hysteresis",
        "procedure_file": {"path": "/data/my own.py", "sha256": "0"},
        "options": {},
        "metadata": {"ambient_from": "chamber", "ambient_temperature_c": 23.4},
    }
    assert command_of(header) == "vcfbench run '/data/my own.py' --ambient-temperature-c chamber"
