"""A directory that is a copy of a record counts in no list twice."""

from __future__ import annotations

import shutil
from typing import TYPE_CHECKING

import pytest
from simrack_tests.cells import few
from typer.testing import CliRunner

import vcfbench
from vcfbench.archive.amending import amend_run
from vcfbench.archive.batch_sheet import device_parts, device_rows, sheet_rows
from vcfbench.archive.summary import run_summaries
from vcfbench.cli.main import app
from vcfbench.reports.document import Report

if TYPE_CHECKING:
    from pathlib import Path

NAMES = ("copy", "000", "zzz", "20990101T000000Z-turntable-abcdef", "{}-2", "a {}")
"""Of copies: before and behind the record's own in the order of names."""


@pytest.fixture(scope="module")
def runs(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("records")
    for seed in (1, 2):
        settings = {"rates_deg_s": [100, 0, -100], "samples": 2, "settle_s": 0.5}
        told = {"dut": "G-7", "tags": {"batch": "b"}}
        vcfbench.run("turntable", seed=seed, settings=settings, metadata=told, runs=folder)
    return folder


@pytest.mark.parametrize("name", few(NAMES, NAMES[0], NAMES[-1]))
def test_copied_record_counts_once(name: str, runs: Path, tmp_path: Path) -> None:
    folder = tmp_path / "runs"
    shutil.copytree(runs, folder)
    before, drifts = run_summaries(folder), [each.drift_ppm for each in device_rows("G-7", folder, tmp_path)]
    copies = {}
    for each in before:
        copies[each.run] = name.format(each.run) if "{" in name else f"{name}{each.seed}"
        shutil.copytree(folder / each.run, folder / copies[each.run])
    after = run_summaries(folder)
    assert [each.run for each in after] == [each.run for each in before]
    assert {each.run: each.copies for each in after} == {own: (copy,) for own, copy in copies.items()}
    assert [each.name for each in vcfbench.list_runs(folder)] == [each.run for each in before]
    rows = device_rows("G-7", folder, tmp_path)
    assert [each.drift_ppm for each in rows] == drifts
    said = str(Report(device_parts(rows)))
    listed = CliRunner().invoke(app, ["runs", "list", "--runs", str(folder)])
    for own, copy in copies.items():
        assert f"{copy}: copies of {own}" in listed.stderr
        assert f"{copy}: copies of {own}" in said
    assert [each.run for each in sheet_rows("b", folder, devices=tmp_path)] == [before[-1].run]


def test_renamed_record_is_no_copy(runs: Path, tmp_path: Path) -> None:
    folder = tmp_path / "runs"
    shutil.copytree(runs, folder)
    for each in run_summaries(folder):
        (folder / each.run).rename(folder / f"renamed{each.seed}")
    assert [(each.run, each.copies) for each in run_summaries(folder)] == [("renamed1", ()), ("renamed2", ())]


@pytest.mark.parametrize("name", few(NAMES, NAMES[0], NAMES[-1]))
def test_amended_copy_counts_for_its_record(name: str, runs: Path, tmp_path: Path) -> None:
    folder = tmp_path / "runs"
    shutil.copytree(runs, folder)
    first, second = run_summaries(folder)
    copy = name.format(first.run)
    shutil.copytree(folder / first.run, folder / copy)
    amend_run(folder / copy, {"dut": "G-8"}, reason="label misread", by="P")
    assert {each.run: (each.dut, each.copies) for each in run_summaries(folder)} == {
        copy: ("G-8", (first.run,)),
        second.run: ("G-7", ()),
    }
    assert [each.drift_ppm for each in device_rows("G-7", folder, tmp_path)] == [None]
    assert [each.run for each in device_rows("G-8", folder, tmp_path)] == [copy]
