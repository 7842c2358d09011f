"""Records in turn of which some show another phase, size or quality factor: refused from the size on that is told."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray
from simrack_tests.cells import few

from vcfbench.belief.in_turn import DEG, InTurn, Visit, require_alike
from vcfbench.belief.unseen import unseen_in_turn
from vcfbench.errors import MeasurementError
from vcfbench.steps import Done

SHAPES = [(4, 3, 5), (4, 8, 2), (2, 3, 2), (1, 8, 1), (2, 5, 1)]
"""States, visits of each, records of a visit; of one record the scatter is what a fault leaves."""
CELLS = few([(each,) for each in SHAPES], (SHAPES[0],), (SHAPES[3],))
Sizes = NDArray[np.float64]


def in_turn(shape: tuple[int, int, int], seed: int, fault: Sizes | float = 0.0) -> InTurn:
    states, visits, records = shape
    rng, count = np.random.default_rng(seed), states * visits
    levels, noise = rng.normal(0.0, 50.0, states), rng.lognormal()
    values = noise * rng.standard_normal((count, records)) + (np.zeros(count) + fault)[:, None]
    taken = tuple(
        Visit(at % states, tuple((own + levels[at % states]).tolist()), Done()) for at, own in enumerate(values)
    )
    return InTurn("the phase", DEG, 0.1 * noise, taken, lambda result, _: result)


def is_refused(each: InTurn) -> bool:
    try:
        require_alike([each])
    except MeasurementError:
        return True
    return False


@pytest.mark.parametrize("shape", CELLS)
def test_noise_is_no_fault(shape: tuple[int, int, int]) -> None:
    assert not any(is_refused(in_turn(shape, seed)) for seed in range(40))


@pytest.mark.parametrize("shape", CELLS)
def test_what_lies_above_its_size_is_refused(shape: tuple[int, int, int]) -> None:
    count, refused = shape[0] * shape[1], list[bool]()
    for seed in range(40):
        rng, compared = np.random.default_rng([1, seed]), in_turn(shape, seed).compared()
        assert compared is not None
        sizes = compared.found.smallest(compared.refused_from)
        place = int(rng.choice(np.flatnonzero(np.isfinite(sizes))))
        pattern, at = compared.found.pattern(place), np.arange(count)
        stretch = (at >= pattern.first) & (at <= pattern.last)
        course = np.maximum(0.0, at - pattern.first + 1) / (count - 1) if pattern.walks else stretch
        refused.append(is_refused(in_turn(shape, seed, rng.choice([-1.5, 1.5]) * sizes[place] * course)))
    assert np.mean(refused) >= 0.95


def test_what_may_have_moved_a_mean_is_told_with_its_size() -> None:
    each = in_turn((1, 12, 4), 1)

    def mean(sizes: Sizes) -> dict[str, Any]:
        return {"phase": float(sizes.mean())}

    told = {row.kind: row for row in unseen_in_turn(each, {"phase": 0.1}, {"phase": 0.0}, mean)}
    assert set(told) == {"change", "creep"}
    size = told["change"].size
    assert size is not None
    assert 0.0 < told["change"].effects["phase"] <= size
    assert not list(unseen_in_turn(each, {"phase": 1e3}, {"phase": 0.0}, mean))
