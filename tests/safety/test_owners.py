"""The protocol of who has the wires, walked through whole; mistakes that are planted in it are found."""

from __future__ import annotations

import pytest

from tests.safety.owners import FAULTS, MISTAKES, explored

QUICK = ("on before it watches", "let go too early", "hung and left alive", "number alone", "a full pipe blocks")


@pytest.mark.parametrize("mistake", QUICK)
def test_a_planted_mistake_is_found(mistake: str) -> None:
    assert explored(mistake, faults=1)[1] is not None


@pytest.mark.exhaustive
def test_wires_have_one_owner_in_every_live_state() -> None:
    states, found, way = explored(faults=FAULTS)
    assert found is None, way
    assert states > 100_000


@pytest.mark.exhaustive
@pytest.mark.parametrize("mistake", sorted(set(MISTAKES) - set(QUICK)))
def test_mistakes_that_need_more_steps_are_found(mistake: str) -> None:
    assert explored(mistake, faults=1)[1] is not None
