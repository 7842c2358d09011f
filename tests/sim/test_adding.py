"""Two generators in series on V_Vc."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np
import pytest
from simrack.adding import added
from simrack.sources import Drive, Piece, Sine

from vcfbench.clock import VirtualClock
from vcfbench.sim.gyro.design import ideal_bench
from vcfbench.sim.world import World

if TYPE_CHECKING:
    from numpy.typing import NDArray
    from simrack.sources import Bend

TIMES_S = np.linspace(0.3, 2.3, 50)


class Ramp:
    """A source that plays: 0.1 V/s from bench time 0, an hour long, seen by an input of first order."""

    source_ohm = 50.0

    def at(self, times_s: NDArray[np.float64]) -> NDArray[np.float64]:
        return 0.1 * times_s

    def piece(self, start_s: float, bend: Bend) -> Piece:
        return Piece(start_s, 3600.0, bend[0] + bend[1] * 0.1 * start_s, bend[1] * 0.1)

    def divided(self, share: float) -> Ramp:
        del share
        return self


def of_piece(piece: Piece) -> NDArray[np.float64]:
    """Return the volts that a piece tells."""
    own = TIMES_S - piece.start_s
    turning = sum((size * np.exp(speed * own) for size, speed in piece.terms), start=np.zeros_like(own, dtype=complex))
    return np.asarray(piece.constant + piece.slope_per_s * own + turning.real)


def test_two_that_go_on_for_ever_are_one() -> None:
    first = Drive(0.2, 0.1, 3.0, 0.4, 50.0, (Sine(0.01, 50.0, 0.0),))
    second = Drive(-0.05, 0.3, 7.0, 1.0, 600.0)
    both = added(first, second)
    assert isinstance(both, Drive)
    assert both.source_ohm == 50.0
    assert both.at(TIMES_S) == pytest.approx(first.at(TIMES_S) + second.at(TIMES_S))
    assert added(first, None) is first
    assert added(None, second) is second
    assert added(None, None) is None


@pytest.mark.parametrize("swapped", [False, True])
def test_one_that_plays_and_one_that_goes_on(swapped: bool) -> None:  # noqa: FBT001  # a parameter of the test
    ramp, sine = Ramp(), Drive(0.05, 0.3, 1.5, 1.0)
    both = added(sine, ramp) if swapped else added(ramp, sine)
    assert both is not None
    assert not isinstance(both, Drive)
    expected = ramp.at(TIMES_S) + sine.at(TIMES_S)
    assert both.at(TIMES_S) == pytest.approx(expected)
    assert of_piece(both.piece(0.3, (0.0, 1.0, 0.0, 0.0))) == pytest.approx(expected)
    assert both.divided(0.5).source_ohm == 50.0


def test_two_that_play() -> None:
    both = added(Ramp(), Ramp())
    assert both is not None
    assert not isinstance(both, Drive)
    assert of_piece(both.piece(0.3, (0.1, 2.0, 0.0, 0.0))) == pytest.approx(0.1 + 0.4 * TIMES_S)


def test_node_has_the_sum_of_both() -> None:
    clock = VirtualClock()
    world = World(clock, ideal_bench(), 0)
    share = 1e6 / (1e6 + 50.0)
    world.drive("v_vc", Drive(0.2))
    world.drive("vibration", Drive(0.3))
    assert world.value_v("v_vc") == pytest.approx(0.5 * share, rel=1e-4)
    world.drive("v_vc", None)
    assert world.value_v("v_vc") == pytest.approx(0.3 * share, rel=1e-4)
    world.drive("vibration", None)
    assert world.value_v("v_vc") == pytest.approx(0.0, abs=1e-9)
