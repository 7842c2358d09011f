"""All numbers of a run are as they were, on any kind of processor."""

from __future__ import annotations

import pytest
from simrack_tests.cells import few

from tests.procedures.parts import values
from tests.procedures.parts.procedures import PROCEDURES

QUICK = ("repeatability", "turntable, there and back", "rate limits by the table")
QUICK_OF_TABLE = ("kvc", "virtual-coriolis", "vibration")
"""Of each kind one: the others are measured by tests of their procedures each time, and held here in turn."""

OF_TABLE = {
    held.procedure: held for held in PROCEDURES if held.slow and held.procedure not in {"bandwidth", "resonance"}
}
"""Runs that the table of parts holds in the exhaustive tests alone, without the dear ones."""


def test_every_run_has_kept_figures() -> None:
    assert values.kept().keys() == values.jobs().keys()


@pytest.mark.parametrize("name", few(values.NOISY, *QUICK))
def test_runs_state_what_they_stated(name: str) -> None:
    """Where a number was changed on purpose: ``python -m tests.procedures.parts.values``."""
    assert values.differing(values.noisy_runs(name), values.kept()[name]) == []


@pytest.mark.parametrize("procedure", few(OF_TABLE, *QUICK_OF_TABLE))
def test_what_the_table_of_parts_holds_is_stated(procedure: str) -> None:
    held = OF_TABLE[procedure]
    gyroscope = held.gyroscopes[0]
    assert values.differing(values.of_run(held.run(gyroscope)), values.kept()[held.key(gyroscope)]) == []


def test_a_number_that_moves_by_a_thousandth_is_seen() -> None:
    before = {
        "a": {"parts": [{"source": "x", "u": 1e-7, "dof": 12}, {"source": "y", "u": 3e-8, "dof": None}]},
        "b": 1.0,
    }
    for source, key, after in ((1, "u", 3.003e-8), (0, "u", -1e-7), (0, "dof", 13), (1, "dof", 5)):
        parts = [{**each, key: after} if place == source else each for place, each in enumerate(before["a"]["parts"])]  # type: ignore[index]
        moved = values.figures_of({"a": {"parts": parts}, "b": 1.0})
        assert len(values.differing(moved, values.figures_of(before))) == 1
