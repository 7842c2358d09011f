from __future__ import annotations

import math

import pytest
from simrack.clock import WallClock
from simrack.serve.clock import MAX_SPEED, ServedClock


class HandWound(WallClock):
    """A wall clock that is set by hand."""

    __slots__ = ("time_s",)

    def __init__(self) -> None:
        self.time_s = 100.0

    def now(self) -> float:
        return self.time_s


@pytest.fixture
def wall() -> HandWound:
    return HandWound()


def test_time_begins_with_the_first_client(wall: HandWound) -> None:
    clock = ServedClock(10.0, wall)
    wall.time_s += 2.0
    assert clock.reached() == 0.0
    clock.start()
    wall.time_s += 2.0
    clock.start()
    assert clock.reached() == 20.0


def test_time_stands_still_until_it_is_brought_up_to_date(wall: HandWound) -> None:
    clock = ServedClock(10.0, wall)
    clock.start()
    wall.time_s += 2.0
    assert clock.now() == 0.0
    clock.move(clock.reached())
    assert clock.now() == 20.0


def test_time_never_goes_back(wall: HandWound) -> None:
    clock = ServedClock(1.0, wall)
    clock.start()
    clock.sleep_until(5.0)
    clock.move(3.0)
    clock.sleep_until(2.0)
    assert clock.now() == 5.0


def test_time_goes_on_from_where_it_jumped_to(wall: HandWound) -> None:
    clock = ServedClock(2.0, wall)
    clock.start()
    wall.time_s += 1.0
    clock.sleep_until(50.0)
    wall.time_s += 1.0
    assert clock.reached() == 52.0


def test_a_new_speed_holds_from_now_on(wall: HandWound) -> None:
    clock = ServedClock(1.0, wall)
    clock.start()
    wall.time_s += 3.0
    clock.move(clock.reached())
    clock.speed = 100.0
    wall.time_s += 1.0
    assert clock.reached() == 103.0


def test_paused_time_is_not_made_up(wall: HandWound) -> None:
    clock = ServedClock(1.0, wall)
    clock.start()
    clock.paused = True
    wall.time_s += 10.0
    assert clock.reached() == 0.0
    assert clock.wall_until(1.0) == math.inf
    clock.paused = False
    wall.time_s += 1.0
    assert clock.reached() == 1.0


def test_max_runs_like_the_wall_clock_and_jumps(wall: HandWound) -> None:
    clock = ServedClock(MAX_SPEED, wall)
    clock.start()
    assert clock.jumps
    wall.time_s += 1.0
    assert clock.reached() == 1.0


def test_a_led_clock_does_not_run(wall: HandWound) -> None:
    clock = ServedClock(5.0, wall)
    clock.start()
    clock.lockstep = True
    wall.time_s += 1.0
    assert clock.reached() == 0.0
    assert clock.jumps


def test_how_long_until(wall: HandWound) -> None:
    clock = ServedClock(4.0, wall)
    clock.start()
    assert clock.wall_until(8.0) == 2.0
    assert clock.wall_until(math.inf) == math.inf
    assert clock.wall_until(-1.0) == 0.0


@pytest.mark.parametrize("speed", [0.0, -1.0, math.nan])
def test_a_speed_is_positive(speed: float) -> None:
    with pytest.raises(ValueError, match="greater than 0"):
        ServedClock(speed)
