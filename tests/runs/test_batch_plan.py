"""What of a batch is done: the runs that this plan asks for, passed, and nothing that looks like them."""

from __future__ import annotations

import io
import sys
from typing import TYPE_CHECKING, Any

import pytest
from msgspec import structs, to_builtins
from msgspec.json import decode, encode
from simrack_tests.cells import few

import vcfbench
from tests.procedures.test_own_code import GOOD
from vcfbench.archive.amending import amend_run
from vcfbench.archive.batch_sheet import batch_sheet
from vcfbench.archive.summary import RunSummary
from vcfbench.cli.main import app
from vcfbench.clock import utc_now
from vcfbench.procedures.catalogue import PROCEDURES
from vcfbench.records.device_values import Conditions
from vcfbench.records.devices import Certificate, DeviceStore, KvcCurve
from vcfbench.records.schema import Status
from vcfbench.reports.text import text_of
from vcfbench.runs import batch
from vcfbench.runs.batch import Batch, read_batch
from vcfbench.runs.request import prepare
from vcfbench.station.description import Served
from vcfbench.station.file import embedded_text

if TYPE_CHECKING:
    from pathlib import Path

SETTINGS = {"rates_deg_s": [-10.0, 0.0, 10.0], "samples": 2}
RUN = '[[runs]]\nprocedure = "turntable"\nsettings = { rates_deg_s = [-10, 0, 10], samples = 2 }\n'
PLAN = f'name = "b7"\nbench = "ideal"\ndevices = ["G-1"]\n{RUN}'


def plan(folder: Path, text: str = PLAN) -> Batch:
    (folder / "plan.toml").write_text(text, encoding="utf-8")
    return read_batch(folder / "plan.toml")


def measured(folder: Path, procedure: str = "turntable", bench: str = "ideal", **settings: Any) -> vcfbench.Run:
    told = {"dut": "G-1", "tags": {"batch": "b7"}}
    return vcfbench.run(procedure, bench, settings={**SETTINGS, **settings}, runs=folder / "runs", metadata=told)


def left(asked: Batch, folder: Path) -> list[str]:
    return [each.procedure.name for each in asked.left("G-1", folder / "runs")]


def test_run_as_planned_counts_as_done_for_any_seed(tmp_path: Path) -> None:
    asked = plan(tmp_path)
    assert left(asked, tmp_path) == ["turntable"]
    measured(tmp_path)
    assert left(asked, tmp_path) == []
    assert asked.left_out(tmp_path / "runs") == {}


@pytest.mark.parametrize(
    ("was", "now", "words"),
    few(
        [
            ("samples = 2", "samples = 200", "samples 2, the plan asks for 200"),
            ("[-10, 0, 10]", "[-10, 0, 20]", "rates_deg_s"),
            ('"ideal"', '"paper"', "bench ideal, the plan asks for paper"),
            ('"turntable"', '"zero"', "the plan has no turntable"),
        ],
        every=2,
    ),
)
def test_run_that_does_not_fit_the_plan_is_left_out(tmp_path: Path, was: str, now: str, words: str) -> None:
    done = measured(tmp_path)
    asked = plan(tmp_path, PLAN.replace(was, now))
    assert len(left(asked, tmp_path)) == 1
    ((name, reason),) = asked.left_out(tmp_path / "runs").items()
    assert name == done.name
    assert words in reason
    rows = asked.rows(tmp_path / "runs", {}, [name])
    assert all(row.waits for row in rows)
    assert f"Left out: {name}, G-1" in text_of(batch_sheet("b7", rows, {name: reason}))


@pytest.mark.parametrize("kind", ["real", "served"])
def test_a_rehearsal_is_not_the_measurement(tmp_path: Path, kind: str) -> None:
    measured(tmp_path)
    asked = plan(tmp_path)
    there = structs.replace(asked.description, simulation=None, rate_table=None)
    if kind == "served":
        there = structs.replace(there, served=Served(control="127.0.0.1:5000"))
    real = structs.replace(asked, description=there)
    assert left(real, tmp_path) == ["turntable"]
    assert "the plan asks for" in "".join(real.left_out(tmp_path / "runs").values())


def test_limits_of_another_bench_file_are_another_run(tmp_path: Path) -> None:
    measured(tmp_path)
    asked = plan(tmp_path)
    narrow = structs.replace(asked.description.acceptance, nonlinearity_ppm=(0.0, 1.0))
    stricter = structs.replace(asked, description=structs.replace(asked.description, acceptance=narrow))
    assert left(stricter, tmp_path) == ["turntable"]


def test_amended_record_belongs_to_its_amended_device(tmp_path: Path) -> None:
    asked = plan(tmp_path, PLAN.replace('["G-1"]', '["G-1", "G-2"]'))
    done = measured(tmp_path)
    amend_run(done.directory, {"dut": "G-2"}, reason="misread", by="A. Person")
    assert [len(asked.left(serial, tmp_path / "runs")) for serial in ("G-1", "G-2")] == [1, 0]


@pytest.mark.parametrize("name", list(PROCEDURES))
def test_batch_run_follows_plan_for_any_procedure(tmp_path: Path, name: str, monkeypatch: pytest.MonkeyPatch) -> None:
    """With a certificate, from which some look up what the plan leaves open."""
    curve = KvcCurve(coefficients=(0.0, 150.0), covariance=((0.0, 0.0), (0.0, 1e-6)), v_vc_min_v=-3.0, v_vc_max_v=3.0)
    here = Conditions(bench="lab", run="r", simulated=True, positive_rail_v=10.0, negative_rail_v=-10.0)
    DeviceStore(tmp_path).add(Certificate(serial="G-1", issued=utc_now(), procedure="kvc", k_vc=curve, conditions=here))
    plan(tmp_path, f'name = "b7"\nbench = "lab"\n[[runs]]\nprocedure = "{name}"\n')
    asked = read_batch(tmp_path / "plan.toml", None, tmp_path)
    prepared = prepare(asked.request(asked.runs[0], "G-1", tmp_path))
    stated = {"bench": prepared.description, "simulated": True, "settings": prepared.settings}
    header = decode(encode(to_builtins(stated)))
    monkeypatch.setattr(batch, "read_header", lambda _: header)
    found = RunSummary(
        run="r", directory=tmp_path, started=utc_now(), status=Status.COMPLETE, procedure=name, dut="G-1"
    )
    monkeypatch.setattr(batch, "run_summaries", lambda *_, **__: (found,))
    assert asked.left_out(tmp_path) == {}
    assert asked.left("G-1", tmp_path) == ()


def test_half_done_device_is_neither_done_nor_good(tmp_path: Path) -> None:
    measured(tmp_path)
    asked = plan(tmp_path, f'{PLAN}[[runs]]\nprocedure = "polarity"\n')
    assert left(asked, tmp_path) == ["polarity"]
    text = text_of(batch_sheet("b7", asked.rows(tmp_path / "runs", {})))
    assert "Yield: 0 of 1 devices (0 %); not good: G-1." in text
    assert "Not measured yet: G-1 (polarity)." in text


@pytest.mark.exhaustive
def test_failed_device_is_tried_again(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)
    monkeypatch.setattr(sys, "stdin", io.StringIO())
    limits = "\n[acceptance]\nnonlinearity_ppm = [0, 1]\n"
    (tmp_path / "strict.toml").write_text(embedded_text("paper") + limits, encoding="utf-8")
    plan(tmp_path, PLAN.replace('"ideal"', '"strict.toml"'))
    for runs in (1, 2):
        code = app(["batch", "plan.toml", "--quiet"], standalone_mode=False)
        assert (code, len(vcfbench.run_summaries(tmp_path / "runs"))) == (1, runs)
    typed = PLAN.replace('"ideal"', '"strict.toml"').replace('devices = ["G-1"]\n', "")
    plan(tmp_path, typed)
    assert app(["batch", "plan.toml", "--quiet"], standalone_mode=False) == 1


def test_new_device_uses_its_certificate_of_the_same_batch(tmp_path: Path) -> None:
    asked = plan(
        tmp_path,
        'name = "b7"\nbench = "lab"\ndevices = ["G-1"]\n[[runs]]\nprocedure = "kvc"\n[[runs]]\n'
        'procedure = "self-calibration"\n',
    )
    asked.check("G-1", tmp_path / "runs")
    with pytest.raises(vcfbench.ConfigError, match="self-calibration"):
        structs.replace(asked, runs=asked.runs[1:]).check("G-1", tmp_path / "runs")


def test_the_devices_are_kept_where_the_command_says(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    plan(tmp_path)
    monkeypatch.chdir(tmp_path)
    assert not app(["batch", "plan.toml", "--quiet", "--devices", "store"], standalone_mode=False)
    (done,) = vcfbench.list_runs(tmp_path / "runs")
    assert done.header["settings"]["devices"] == "store"
    assert read_batch(tmp_path / "plan.toml", None, tmp_path / "d").kept_in == tmp_path / "d"


def test_a_procedure_of_ones_own_that_was_changed_is_another(tmp_path: Path) -> None:
    (tmp_path / "wait.py").write_text(GOOD, "utf-8")
    asked = plan(tmp_path, 'name = "b7"\nbench = "ideal"\n[[runs]]\nprocedure = "wait.py"\n')
    told = {"dut": "G-1", "tags": {"batch": "b7"}}
    vcfbench.run(tmp_path / "wait.py", "ideal", runs=tmp_path / "runs", metadata=told)
    assert left(asked, tmp_path) == []
    (tmp_path / "wait.py").write_text(f"{GOOD}\n# another\n", "utf-8")
    assert left(read_batch(tmp_path / "plan.toml"), tmp_path) == ["wait"]
