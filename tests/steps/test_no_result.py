"""Readings that arithmetic cannot do with end a run as an error of the bench, with what was divided by what."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING, Any

import pytest
from msgspec import Struct

from tests.procedures.fakes import FakeBench, MemoryJournal
from vcfbench.errors import MeasurementError
from vcfbench.records.schema import Status
from vcfbench.steps import Done, Settle
from vcfbench.steps.executor import Executor
from vcfbench.steps.step import Effect, Step, does

if TYPE_CHECKING:
    from pathlib import Path

    from vcfbench.steps.step import Context, Plan

WORDS = (
    r"^the readings of step 2 make no result "
    r"\(float division by zero: change_v / over_s, change_v = 1.5, over_s = 0\)"
)


@pytest.fixture(autouse=True)
def _ours(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Let `slope` be a function of a module that comes along."""
    file = tmp_path / "slopes.py"
    file.write_text("def slope(change_v, over_s):\n    return change_v / over_s\n")
    ours: dict[str, Any] = {"__name__": "vcfbench.analysis.slopes"}
    exec(compile(file.read_text(), file, "exec"), ours)  # noqa: S102  # two lines, written above
    monkeypatch.setitem(globals(), "slope", ours["slope"])


def slope(change_v: float, over_s: float) -> float:
    raise NotImplementedError


@does(Effect.MEASURES, "output")
class Divides(Step, Struct, frozen=True):
    def describe(self) -> str:
        return "divides"

    def perform(self, context: Context) -> Done:
        del context
        slope(1.5, 0.0)
        return Done()


def in_the_plan() -> Plan:
    yield Settle(1.0, "rest")
    yield Settle(1.0, "rest")
    slope(1.5, 0.0)


def in_a_step() -> Plan:
    yield Settle(1.0, "rest")
    yield Divides()


@pytest.mark.parametrize("plan", [in_the_plan, in_a_step])
def test_arithmetic_that_fails_ends_the_run_and_says_on_what(plan: Any) -> None:
    execution = Executor(FakeBench(), MemoryJournal()).execute(plan())
    assert execution.status is Status.ABORTED
    assert isinstance(execution.error, MeasurementError)
    with pytest.raises(MeasurementError, match=WORDS):
        raise execution.error


def test_a_mistake_in_somebody_s_own_code_stays_one() -> None:
    def plan() -> Plan:
        yield Settle(1.0, "rest")
        math.sqrt(-1.0)

    with pytest.raises(ValueError, match="domain"):
        Executor(FakeBench(), MemoryJournal()).execute(plan())
