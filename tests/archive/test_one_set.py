"""What is shown of a run, wherever it is shown, is one set: the values that its results state."""

from __future__ import annotations

import json
import re
from typing import TYPE_CHECKING, Any

import pytest

import vcfbench
from tests.archive.test_dcc import WORDS
from vcfbench.archive.certificate import certificate_words
from vcfbench.archive.dcc import _ref_type, dcc_of
from vcfbench.archive.reported import full_report
from vcfbench.archive.summary import summary_of
from vcfbench.instructions.titles import BUILT_IN
from vcfbench.procedures.characterize.data_sheet import sheet_rows
from vcfbench.records.directory import RunDirectory
from vcfbench.reports.document import Table

if TYPE_CHECKING:
    from pathlib import Path

SETTINGS: dict[str, dict[str, Any]] = {
    "turntable": {"rates_deg_s": [100, 50, 0, -50, -100], "samples": 4},
    "characterize": {"parts": ["turntable", "zero", "power"], "zero": {"duration_s": 400.0}},
}
QUICK = ("turntable", "electrical")


@pytest.mark.parametrize(
    "procedure", [pytest.param(name, marks=[pytest.mark.exhaustive] * (name not in QUICK)) for name in BUILT_IN]
)
def test_every_reader_of_a_run_shows_one_set_of_values(procedure: str, tmp_path: Path) -> None:
    runs, of_device = tmp_path / "runs", {"dut": "G-1", "devices": str(tmp_path / "devices")}
    if procedure in {"self-calibration", "online"}:
        vcfbench.run("kvc", "lab", seed=1, settings=of_device, runs=runs)
    known_keys = vcfbench.PROCEDURES[procedure].settings.__struct_fields__
    settings = {**(of_device if "devices" in known_keys else {}), **SETTINGS.get(procedure, {})}
    run = vcfbench.run(procedure, "lab", seed=2, settings=settings, runs=runs, metadata={"dut": "G-1"})
    assert run.directory is not None
    values = run.values
    assert values
    assert list(vcfbench.load_run(run.directory).values.values()) == list(values.values())
    assert [each["name"] for each in run.as_json()["values"]] == list(values)
    stored = json.loads((run.directory / "result.json").read_text(encoding="utf-8"))["values"]
    assert [(each["name"], each["value"], each["u95"]) for each in stored] == [
        (each.name, each.value, each.u95) for each in values.values()
    ]
    assert list(summary_of(RunDirectory(run.directory)).results) == list(values)
    tables = [part for part in full_report(run).parts if isinstance(part, Table) and part.title == "Results"]
    shown = [re.sub("; INCOMPLETE.*", "", str(row[0])) for row in tables[-1].rows]
    assert shown == [each.named.words for each in values.values()]
    assert len(list(sheet_rows(procedure, run.results, ""))) == len(values)
    known = [each for each in values.values() if each.u95 is not None or each.form != "plus-minus"]
    if known:
        found = set(
            re.findall('refType="basic_measuredValue ([^"]*)"', dcc_of(run, certificate_words(run, WORDS)).decode())
        )
        assert found == {_ref_type(each.name) for each in known}
