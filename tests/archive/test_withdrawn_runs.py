"""A run whose entry was withdrawn from the history of its device is counted nowhere."""

from __future__ import annotations

import json
from itertools import pairwise
from typing import TYPE_CHECKING

import pytest
from simrack_tests.cells import few
from typer.testing import CliRunner

import vcfbench
from vcfbench.archive.batch_sheet import device_rows, sheet_rows
from vcfbench.cli.main import app
from vcfbench.records.device_values import Characteristics, Conditions
from vcfbench.records.devices import Characterisation, DeviceStore

if TYPE_CHECKING:
    from pathlib import Path

GONE = ({0}, {1}, {2}, {0, 1}, {1, 2}, {0, 2})
"""Which of three runs lose their entry."""


@pytest.fixture(scope="module")
def runs(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("records")
    settings = {"rates_deg_s": [100, 50, 0, -50, -100], "samples": 2, "settle_s": 0.5}
    for seed in (1, 2, 3):
        told = {"dut": "G-7", "tags": {"batch": f"b{seed}"}}
        vcfbench.run("turntable", seed=seed, settings=settings, metadata=told, runs=folder)
    return folder


@pytest.mark.parametrize("gone", few(GONE, GONE[1]), ids=str)
def test_withdrawn_run_is_counted_nowhere(gone: set[int], runs: Path, tmp_path: Path) -> None:
    known = vcfbench.run_summaries(runs)
    store = DeviceStore(tmp_path)
    for each in known:
        of_run = Conditions(bench="paper", run=each.run, simulated=True, positive_rail_v=10.0, negative_rail_v=-10.0)
        store.add(
            Characterisation(
                serial="G-7",
                done=each.started,
                procedure="turntable",
                conditions=of_run,
                characteristics=Characteristics(),
            )
        )
    every = device_rows("G-7", runs, tmp_path)
    taken = [store.withdraw("G-7", f"{place + 1:04}", reason="wrong leads", by="P").name for place in gone]
    left = [each for place, each in enumerate(known) if place not in gone]
    scales = [each.results["scale_factor"].value for each in left]
    rows = device_rows("G-7", runs, tmp_path)
    assert [each.run for each in rows] == [each.run for each in left]
    assert [each.drift_ppm for each in rows] == [
        None,
        *(pytest.approx(1e6 * (b / a - 1.0)) for a, b in pairwise(scales)),
    ]
    assert [sheet_rows(f"b{place + 1}", runs, devices=tmp_path)[0].run for place in gone] == [
        known[place].run for place in sorted(gone)
    ]
    command = ["compare", "--dut", "G-7", "--json", "--runs", str(runs), "--devices", str(tmp_path)]
    asked = CliRunner().invoke(app, command)
    if len(left) > 1:
        assert list(json.loads(asked.stdout)["runs"]) == [each.run for each in left]
    else:
        assert "found 1 turntable" in asked.stderr
    for name in taken:
        store.withdraw("G-7", name, reason="they were right", by="P")
    assert device_rows("G-7", runs, tmp_path) == every
