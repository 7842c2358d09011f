"""No run that is complete has a wrong number, whichever byte of whichever reply was lost, flipped or doubled.

A result is wrong when it is further than a third of its stated standard uncertainty from that of the run without a
fault (what a different draw of the same noise does included: where readings are taken again, later ones are others; the
bar is then four times the uncertainties of both), or when a larger uncertainty hides it.
"""

from __future__ import annotations

import math
from functools import cache
from typing import TYPE_CHECKING

import pytest
from simrack_tests.cells import few

from tests.faults.corruption import Behind, Came, Change, bench_of, changes_of, perform

if TYPE_CHECKING:
    from collections.abc import Callable

pytestmark = pytest.mark.slow

QUICK = "rates_deg_s = [40, 0, -20]\nsamples = 4\nmatch_rate_deg_s = 20"
BENCH = bench_of(procedure_words=QUICK)
ROLES = ("multimeter", "rate_table", "power", "rate_source")
OPENING = 5
"""Replies before the first that belong to the procedure: identities, errors."""


@cache
def clean(procedure: str) -> Came:
    """The run without a fault."""
    came = perform(BENCH, procedure)
    assert came.error is None
    return came


def wrong(expects: Came, came: Came) -> str | None:
    """Say which number of a complete run is wrong."""
    if came.error is not None:
        return None
    expected = expects.numbers()
    again = came.readings() != expects.readings()
    for name, (value, u) in came.numbers().items():
        true, true_u = expected[name]
        bar = 4.0 * math.hypot(u, true_u) if again else true_u / 3.0
        if abs(value - true) > bar or u > 4.0 * true_u:
            return f"{name}: {value} (u {u}), not {true} (u {true_u})"
    return None


def changes(procedure: str, role: str, count: int) -> list[Change]:
    """Return `count` changes, spread over all bytes of all replies of a role."""
    replies = list(enumerate(clean(procedure).replies[role]))[OPENING:]
    every = changes_of(replies)
    return [every[number * len(every) // count] for number in range(count)]


def believed(procedure: str, role: str, chosen: list[Change]) -> list[str]:
    """Return the changes after which a complete run had a wrong number."""
    found = [(change, wrong(clean(procedure), perform(BENCH, procedure, {role: change}))) for change in chosen]
    return [f"{role} {change}: {words}" for change, words in found if words is not None]


@pytest.mark.parametrize("role", few(ROLES[:3], "rate_table"))
def test_a_few_corrupted_replies(role: str) -> None:
    assert not believed("turntable", role, changes("turntable", role, 6))


@pytest.mark.fault_matrix
def test_500_corrupted_readings() -> None:
    chosen = changes("turntable", "multimeter", 500)
    assert len(chosen) == 500
    assert not believed("turntable", "multimeter", chosen)


@pytest.mark.fault_matrix
@pytest.mark.parametrize("role", ROLES)
def test_corrupted_read_backs(role: str) -> None:
    assert not believed("virtual-coriolis", role, changes("virtual-coriolis", role, 60))


def lead_off(behind: Behind) -> None:
    behind.world.leads["multimeter"].connect("input", None)


def leads_swapped(behind: Behind) -> None:
    behind.world.leads["multimeter"].turn("input", reversed_=True)


def another_node(behind: Behind) -> None:
    behind.world.leads["multimeter"].connect("input", "v_vc")


def offset(behind: Behind) -> None:
    behind.spoilers["multimeter"].offset_v = 0.5


def warmer(behind: Behind) -> None:
    behind.world.set_ambient_c(65.0)


WIDE = bench_of(procedure_words=QUICK.replace("[40, 0, -20]", "[40, 20, 0, -20, -40]"))
"""Of three rates nobody can tell which is wrong; of five one can."""
MISHAPS = (lead_off, leads_swapped, another_node, offset)
POINTS = {"turntable": 5, "virtual-coriolis": 34}


@cache
def clean_wide(procedure: str) -> Came:
    came = perform(WIDE, procedure)
    assert came.error is None
    return came


def mistaken(procedure: str, mishap: Callable[[Behind], None], point: int) -> str | None:
    """Say which number is wrong after a mishap when `point` points have been taken."""
    return wrong(clean_wide(procedure), perform(WIDE, procedure, at_point={point: mishap}))


@pytest.mark.parametrize("mishap", MISHAPS)
def test_a_mishap_amid_a_run(mishap: Callable[[Behind], None]) -> None:
    assert mistaken("turntable", mishap, 2) is None


@pytest.mark.fault_matrix
@pytest.mark.parametrize("procedure", POINTS)
@pytest.mark.parametrize("mishap", MISHAPS)
def test_a_mishap_after_every_point(mishap: Callable[[Behind], None], procedure: str) -> None:
    words = {number: mistaken(procedure, mishap, number) for number in range(1, POINTS[procedure])}
    assert not {number: line for number, line in words.items() if line is not None}


@pytest.mark.fault_matrix
def test_a_jump_of_temperature_is_refused_or_small() -> None:
    """The gyroscope then really has another scale factor: what one sweep cannot tell apart stays below 0.1 %."""
    true = clean_wide("turntable").numbers()["column scale_factor"][0]
    for point in range(1, POINTS["turntable"]):
        came = perform(WIDE, "turntable", at_point={point: warmer})
        if came.results is not None:
            assert came.numbers()["column scale_factor"][0] == pytest.approx(true, rel=1e-3)
