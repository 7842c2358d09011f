"""What was written of a step and its result can be read into values again."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import msgspec
import pytest

from tests.procedures.fakes import CALIBRATIONS, FakeBench, Gyro, MemoryJournal, make_settings
from tests.steps.test_long_window import acquire, bench, plan
from vcfbench.procedures.catalogue import PROCEDURES
from vcfbench.steps import SetVvc, VerifyZero, VvcSetting
from vcfbench.steps.decode import Recorded, result_of, step_of
from vcfbench.steps.events import StepFailed, StepFinished
from vcfbench.steps.executor import Executor
from vcfbench.steps.step import Step, StepResult

if TYPE_CHECKING:
    from vcfbench.steps.events import Event
    from vcfbench.steps.step import Plan


class Kept:
    """Keeps the steps that were performed or failed, and what came of them."""

    def __init__(self) -> None:
        self.steps: list[Step] = []
        self.results: list[StepResult] = []

    def handle(self, event: Event) -> None:
        if isinstance(event, StepFinished | StepFailed):
            self.steps.append(event.step)
        if isinstance(event, StepFinished):
            self.results.append(event.result)


def run(steps: Plan, on: FakeBench) -> tuple[Kept, list[dict[str, Any]]]:
    """Perform a plan; return what it was, and the lines of its journal as they come from the disk."""
    kept, journal = Kept(), MemoryJournal()
    Executor(on, journal, [kept]).execute(steps)
    return kept, [msgspec.json.decode(msgspec.json.encode(line)) for line in journal.lines]


def assert_comes_back(steps: Plan, on: FakeBench) -> list[dict[str, Any]]:
    kept, lines = run(steps, on)
    done = [line for line in lines if line["type"] == "step"]
    assert [step_of(line) for line in lines if line["type"] != "readings"] == kept.steps
    assert [step_of(line).key for line in done if isinstance(step_of(line), Step)] == [line["key"] for line in done]
    assert [result_of(line) for line in done] == kept.results
    return lines


@pytest.mark.parametrize("name", CALIBRATIONS)
def test_each_step_and_result_of_a_run_comes_back(name: str) -> None:
    settings = make_settings()
    lines = assert_comes_back(PROCEDURES[name].plan(settings), FakeBench(Gyro(noise_v=1e-4)))
    assert len(lines) > 80


def test_a_step_that_failed_comes_back() -> None:
    made = FakeBench()
    made.multimeter.overload_at = 6
    lines = assert_comes_back(PROCEDURES["turntable"].plan(make_settings()), made)
    assert "error" in [line["type"] for line in lines]


def test_long_windows_come_back_without_their_readings() -> None:
    lines = assert_comes_back(plan(acquire(150, 1.0), acquire(150, 1.0, VerifyZero)), bench())
    assert step_of(lines[0]) == acquire(150, 1.0)  # that of a chunk


LINE = {"step_kind": "SetVvc", "step": {"v_vc_v": 1}, "result_kind": "VvcSetting", "result": {"v_vc_v": 1.0}}


def test_fields_that_are_not_known_are_ignored() -> None:
    assert step_of({**LINE, "step": {"v_vc_v": 1.0, "slew_v_s": 2.0}}) == SetVvc(1.0)
    assert result_of(LINE) == VvcSetting(1.0)


@pytest.mark.parametrize(
    ("changes", "step", "result"),
    [
        ({"step_kind": "Own", "step": {"times": 3}}, Recorded("Own", {"times": 3}), Recorded),
        ({"result_kind": "Own", "result": {"lit": True}}, SetVvc(1.0), Recorded),
        ({"step": {"volts": 1.0}}, Recorded("SetVvc", {"volts": 1.0}), Recorded),
        ({"result": {"v_vc_v": "1 V"}}, SetVvc(1.0), Recorded),
    ],
)
def test_unknown_kinds_are_read_back_unchanged(changes: dict[str, Any], step: Step | Recorded, result: type) -> None:
    assert step_of({**LINE, **changes}) == step
    assert isinstance(result_of({**LINE, **changes}), result)
    assert Recorded("Own", {"times": 3}).describe() == "Own(times=3)"
