"""Every honest record passes in a process that has verified nothing before: of each procedure, however its run went."""

from __future__ import annotations

import json
import shutil
import subprocess
import sys
from pathlib import Path
from typing import Any

import pytest

import vcfbench
from tests import warm
from tests.cells import few
from tests.cli.test_batch import PLAN
from tests.seals import sealed
from tests.test_by_hand import BENCH, Person
from tests.test_pause import Presser
from vcfbench.archive.amending import amend_run
from vcfbench.archive.verified import verify_run
from vcfbench.errors import Aborted
from vcfbench.instructions.titles import BUILT_IN
from vcfbench.steps.step import Step

HYSTERESIS = Path(__file__).parents[2] / "examples" / "own-procedure" / "hysteresis.py"
SHORT: dict[str, dict[str, Any]] = {
    "turntable": {"samples": 3, "warm_up_s": 60.0},
    "virtual-coriolis": {"samples": 3, "warm_up_s": 60.0, "rates_deg_s": [100.0, 0.0, -100.0]},
    "zero": {"duration_s": 200.0},
    "kvc": {"cycles": 1, "samples": 4},
    "repeatability": {"power_cycles": 3, "off_s": 60.0, "warm_up_s": 60.0, "samples": 4},
    "rate-limits": {"warm_up_s": 60.0, "samples": 4},
    "phase": {"warm_up_s": 0.0, "records": 2, "rotation_records": 1, "most_cycles": 3},
    "self-calibration": {"k_vc": "150", "health": False, "cycles": 1, "samples": 5},
    "polarity": {"samples": 2},
    "threshold": {"at_most_s": 60.0, "samples": 3},
    "g-sensitivity": {"samples": 4, "cycles": 1, "warm_up_s": 60.0, "turn_s": 5.0},
    "vibration": {"record_samples": 256, "vibration_hz": [2.0, 10.0, 20.0, 35.0]},
    "online": {"k_vc": "150"},
    "characterize": {
        "parts": ["zero", "polarity", "turntable", "temperature"],
        "samples": 6,
        "turntable": {"rates_deg_s": [200.0, 50.0, 0.0, -50.0, -200.0]},
        "zero": {"duration_s": 200.0, "samples": 4},
    },
}
PROCEDURES = [*BUILT_IN, str(HYSTERESIS)]
SHARES = ((0.1, 0.3), (0.5, 0.51), (0.55, 0.7))  # of the steps, where it pauses and where it is stopped


class PausesAndStops(Presser):
    """Wants a pause in one step of the run and a stop in a later one."""

    def __init__(self, pause: int, stop: int) -> None:
        super().__init__(pause)
        self.stop = stop

    def handle(self, event: vcfbench.Event) -> None:
        super().handle(event)
        if isinstance(event, vcfbench.StepStarted) and event.number == self.stop:
            self.control.stop("the test")


def run(procedure: str, presser: Presser, runs: Path) -> vcfbench.Run:
    return presser.run(procedure, bench="lab", settings=SHORT.get(procedure), runs=runs)


def verified(*records: Path) -> list[dict[str, Any]]:
    """Verify records in that order, in a process that has verified nothing before: an answer for each."""
    command = [sys.executable, "-m", "vcfbench", "runs", "verify", "--json", *map(str, records)]
    done = subprocess.run(command, capture_output=True, encoding="utf-8", check=False)  # noqa: S603  # our own
    return list(json.loads(done.stdout)["runs"])


def assert_each_passes(runs: Path) -> None:
    for record in runs.iterdir():
        (found,) = verified(record)
        assert (found["verdict"], found["wrong"]) == ("PASS", None)
        unknown = [note for note in found["notes"] if "not looked into" in note or "not computed" in note]
        assert not unknown or "hysteresis" in record.name


@pytest.mark.parametrize("procedure", few(PROCEDURES, str(HYSTERESIS)))
def test_a_record_of_each_procedure_passes(procedure: str, tmp_path: Path) -> None:
    assert run(procedure, Presser(), tmp_path).status == "complete"
    assert_each_passes(tmp_path)


@pytest.mark.exhaustive
@pytest.mark.parametrize(
    ("procedure", "paused", "stopped"),
    few(
        [("turntable", 0.5, 0.51), *((each, 0.1, 0.3) for each in PROCEDURES[::3])],
        ("turntable", 0.5, 0.51),
    ),
)
def test_paused_stopped_amended_and_resumed_record_passes(
    procedure: str, paused: float, stopped: float, tmp_path: Path
) -> None:
    steps = len(vcfbench.dry_run(procedure, "lab", settings=SHORT.get(procedure)).steps)
    presser = PausesAndStops(max(1, int(paused * steps)), max(3, int(stopped * steps)))
    with pytest.raises(Aborted) as broken_off:
        run(procedure, presser, tmp_path)
    before = broken_off.value.run
    amend_run(before.directory, {"operator": "B. Person"}, reason="another shift")
    if procedure not in {"warmup", "repeatability"}:  # which are in one piece
        assert vcfbench.resume(before.directory, trust=True).pauses == before.pauses
    assert_each_passes(tmp_path)


@pytest.mark.exhaustive
def test_records_by_hand_and_of_a_batch_pass(tmp_path: Path) -> None:
    (tmp_path / "by-hand.toml").write_text(BENCH, encoding="utf-8")
    vcfbench.run("turntable", tmp_path / "by-hand.toml", operator=Person(), runs=tmp_path / "runs")
    (tmp_path / "plan.toml").write_text(PLAN, encoding="utf-8")
    assert warm.run(["vcfbench", "batch", "plan.toml", "--quiet"], tmp_path).returncode == 0
    assert len([*(tmp_path / "runs").iterdir()]) == 3
    assert_each_passes(tmp_path / "runs")


def changed(record: Path, kind: str) -> Path:
    """Copy a record with the first step of a kind under another key, sealed anew."""
    copied = shutil.copytree(record, record.with_name(f"{record.name}-{kind}"))
    lines = list(map(json.loads, (copied / "journal.jsonl").read_bytes().splitlines()))
    next(line for line in lines if line.get("step_kind") == kind)["key"] = "another"
    (copied / "journal.jsonl").write_bytes(sealed(b"".join(json.dumps(line).encode() + b"\n" for line in lines)))
    return copied


@pytest.mark.exhaustive
def test_no_verdict_depends_on_what_was_verified_before(tmp_path: Path) -> None:
    """Nor on what else is loaded: a step of phase's own is looked into, one of another file's is not."""
    phase, own = (run(each, Presser(), tmp_path).directory for each in ("phase", str(HYSTERESIS)))
    assert phase is not None
    assert own is not None
    records = [changed(phase, "CaptureSense"), changed(phase, "SetRate"), changed(own, "SetRate"), phase, own]
    answers = [{each["run"]: each for each in verified(*order)} for order in (records, records[::-1])]
    assert answers[0] == answers[1]
    assert [answers[0][each.name]["verdict"] for each in records] == [*("FAIL", "FAIL", "FAIL"), "PASS", "PASS"]


def test_kind_of_another_package_does_not_replace_records_kind(tmp_path: Path) -> None:
    """Two files may each have a step of one name; the one that is loaded now says nothing of the other's record."""
    record = run("turntable", Presser(), tmp_path).directory
    assert record is not None
    journal = record / "journal.jsonl"
    journal.write_bytes(sealed(journal.read_bytes().replace(b'"step_kind":"Note"', b'"step_kind":"Blinks"')))
    before = verify_run(record)
    type("Blinks", (Step,), {"__module__": "acme"})
    try:
        assert verify_run(record) == before
    finally:
        del Step.kinds["Blinks"]
