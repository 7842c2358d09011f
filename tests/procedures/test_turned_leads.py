"""Leads that somebody turns round between two windows of a run: whatever the procedure, it does not believe them."""

from __future__ import annotations

from random import Random
from typing import TYPE_CHECKING, Any, cast

import pytest
from simrack_tests.cells import few

from tests.procedures.fakes import MemoryJournal
from vcfbench.errors import MeasurementError
from vcfbench.procedures.catalogue import Catalogue
from vcfbench.procedures.layers import asked_in_python, settings_of
from vcfbench.steps import Acquire, AcquireWithVvc, Plan
from vcfbench.steps.executor import Executor
from vcfbench.testing import open_simulated, simulated

if TYPE_CHECKING:
    from collections.abc import Callable

SETTINGS: dict[str, dict[str, Any]] = {
    "repeatability": {"power_cycles": 3, "off_s": 60.0, "warm_up_s": 60.0, "samples": 4},
    "temperature": {"temperatures_c": [20.0, 40.0, 60.0], "samples": 4},
    "rate-limits": {"warm_up_s": 0.0, "samples": 4},
    "power": {"warm_up_s": 0.0, "samples": 4},
    "warmup": {"shortest_s": 300.0, "longest_s": 300.0, "window_s": 20.0},
}


def windows_of(plan: Plan, before: Callable[[int], None]) -> Plan:
    """Do `plan`; `before` is called with the number of each window, from 0, before it is taken."""
    number, result = 0, cast("Any", None)
    while True:
        try:
            step = plan.send(result)
        except StopIteration:
            return
        if isinstance(step, Acquire | AcquireWithVvc):
            before(number)
            number += 1
        result = yield step


def turned(name: str, by: str | None, at: int, **told: float) -> tuple[int, bool]:
    """Run with the output's lead turned round before window `at`; return how many were begun, and if it was seen."""
    procedure, begun, bench = Catalogue()[name], 0, simulated("lab")
    chosen = settings_of(procedure, bench, asked_in_python({**SETTINGS[name], **told, **({"by": by} if by else {})}))
    with open_simulated(bench, seed=at) as lab:

        def before(number: int) -> None:
            nonlocal begun
            begun = number + 1
            if number == at:
                lab.world.leads["multimeter"].turn("input", reversed_=True)

        executed = Executor(lab.bench, MemoryJournal()).execute(windows_of(procedure.plan(chosen), before))
    return begun, isinstance(executed.error, MeasurementError)


@pytest.mark.parametrize(
    ("name", "by"),
    few(
        [("repeatability", "v-vc"), ("rate-limits", "table"), ("temperature", "table"), ("warmup", None)],
        ("rate-limits", "table"),
    ),
)
def test_output_lead_turned_in_mid_run_ends_it(name: str, by: str | None) -> None:
    at = Random(f"{name} {by}").randrange(2, 14)  # noqa: S311  # a place, no secret
    begun, seen = turned(name, by, at)
    assert begun > at
    assert seen


@pytest.mark.exhaustive
@pytest.mark.parametrize("by", ["v-vc", "table"])
@pytest.mark.parametrize("name", ["repeatability", "temperature", "rate-limits", "power"])
def test_wherever_it_is_turned_round(name: str, by: str) -> None:
    """But before the first window with a rate: from there on it is another gyroscope, if nobody tells which it is."""
    windows, _ = turned(name, by, at=10_000)
    first = 2 if name in {"repeatability", "rate-limits"} else 1
    assert [at for at in range(first, windows) if not turned(name, by, at)[1]] == []


@pytest.mark.exhaustive
@pytest.mark.parametrize("by", ["v-vc", "table"])
@pytest.mark.parametrize("name", ["repeatability", "temperature", "rate-limits"])
def test_leads_swapped_throughout_contradict_expected_sign(name: str, by: str) -> None:
    assert turned(name, by, at=0, scale_factor_v_per_deg_s=-0.0125)[1]
    assert not turned(name, by, at=10_000, scale_factor_v_per_deg_s=-0.0125)[1]
