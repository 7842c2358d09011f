"""Input axes: angles and their changes by finite differences, and what they state over drawn directions."""

from __future__ import annotations

import math

import numpy as np
import pytest
from simrack_tests.cells import few

from vcfbench.analysis.input_axis import angle_of, tilts

Z = np.array([0.0, 0.0, 1.0])


def at(degrees: float, seed: int = 0) -> tuple[np.ndarray, np.ndarray]:
    """Two directions at an angle, turned at random."""
    turn = np.linalg.qr(np.random.default_rng(seed).standard_normal((3, 3)))[0]
    radians = math.radians(degrees)
    return turn @ Z, turn @ np.array([math.sin(radians), 0.0, math.cos(radians)])


@pytest.mark.parametrize("degrees", [2.0, 10.0, 30.0, 54.7, 89.0, 90.0, 133.0, 170.0, 178.5])
def test_changes_of_angles_are_those_of_finite_differences(degrees: float) -> None:
    one, two = at(degrees, seed=int(degrees))
    found, step = angle_of(one, two, np.zeros((3, 3))), 1e-6
    for part in np.eye(3):
        moved = []
        for a, b in ((one + step * part, two), (one, two + step * part)):
            unit = a / np.linalg.norm(a), b / np.linalg.norm(b)
            moved.append((angle_of(*unit, np.zeros((3, 3))).rad - found.rad) / step)
        assert moved == pytest.approx([found.by_one @ part, found.by_two @ part], abs=1e-4)
    for other, angle, by in tilts(one):
        along = int(np.abs(one).argmax())
        for part in np.eye(3):
            a = one + step * part
            assert (math.atan(a[other] / a[along]) - angle) / step == pytest.approx(by @ part, abs=1e-4)


@pytest.mark.parametrize(
    ("degrees", "words"),
    few(
        [
            (90.0, "above 90 deg"),
            (54.7, "above 90 deg"),
            *((each, "apart") for each in (30.0, 2.0, 0.01, 0.0)),
            *((each, "from opposite") for each in (180.0, 179.99, 150.0)),
        ],
        every=4,
    ),
)
def test_angles_lie_within_what_is_stated(degrees: float, words: str) -> None:
    u, draw, held = 1e-4, np.random.default_rng(7), 0
    truth = {"above 90 deg": degrees - 90.0, "apart": degrees, "from opposite": 180.0 - degrees}[words]
    for seed in range(400):
        one, two = (each + u * draw.standard_normal(3) for each in at(degrees, seed))
        found = angle_of(one / np.linalg.norm(one), two / np.linalg.norm(two), 2.0 * u**2 * np.eye(3))
        assert found.words == words
        own = 1.96 * u * math.hypot(*found.by_one, *found.by_two)
        away = abs(found.rad - math.radians(truth))
        held += away <= own if found.below is None else math.radians(truth) <= found.below
    assert held / 400 >= 0.92
    assert held / 400 <= (0.98 if min(degrees, 180.0 - degrees) > 1.0 else 1.0)  # a bound from 0 holds more often
