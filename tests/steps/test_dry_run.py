"""Plans walked without a bench."""

from __future__ import annotations

from itertools import count
from typing import TYPE_CHECKING

import pytest

from vcfbench import Note, PlanError, Settle
from vcfbench.station.linear_gyro import LinearGyro
from vcfbench.steps import dry_run

if TYPE_CHECKING:
    from vcfbench import Plan


def _notes(number: int) -> Plan:
    for each in range(number):
        yield Note(f"{each}")


def _no_end() -> Plan:
    for each in count():
        yield Settle(0.0, f"look {each}")


def test_a_plan_without_an_end_is_refused(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(dry_run, "_MOST_STEPS", 1000)
    gyro = LinearGyro(-100.0)
    assert len(list(dry_run.walk(_notes(1000), gyro))) == 1000
    for plan, last in ((_notes(1001), "1000"), (_no_end(), "look 1000")):
        with pytest.raises(PlanError, match=rf"^the plan has more than 1000 steps, the last .*{last}.*does not end$"):
            list(dry_run.walk(plan, gyro))
