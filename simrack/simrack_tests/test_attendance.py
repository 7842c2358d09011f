"""A clock that stops where devices act."""

from __future__ import annotations

from simrack.attendance import AttendedClock
from simrack.clock import VirtualClock


class Alarm:
    """Acts at given instants and notes when it was looked at."""

    def __init__(self, clock: AttendedClock, *instants: float) -> None:
        self.clock = clock
        self.left = list(instants)
        self.done: list[float] = []

    def wake_at(self) -> float | None:
        while self.left and self.left[0] <= self.clock.now():
            self.left.pop(0)
            self.done.append(self.clock.now())
        return self.left[0] if self.left else None


def test_every_device_acts_at_its_own_instants() -> None:
    clock = AttendedClock(VirtualClock())
    first, second = Alarm(clock, 1.0, 2.5, 7.0), Alarm(clock, 2.0, 2.5)
    clock.attend(first, second)
    clock.sleep_until(5.0)
    assert clock.now() == 5.0
    assert (first.done, second.done) == ([1.0, 2.5], [2.0, 2.5])


def test_wait_for_device_stops_at_next_action() -> None:
    clock = AttendedClock(VirtualClock())
    clock.attend(Alarm(clock, 1.0, 2.5), Alarm(clock, 2.0))
    stops = []
    for _ in range(4):
        clock.sleep_to_next(5.0)
        stops.append(clock.now())
    assert stops == [1.0, 2.0, 2.5, 5.0]
    clock.sleep_to_next(5.0)
    assert clock.now() == 5.0


def test_always_due_device_does_not_stop_time() -> None:
    class Stuck:
        def wake_at(self) -> float:
            return 0.0

    clock = AttendedClock(VirtualClock(), [Stuck()])
    clock.sleep_until(1.0)
    assert clock.now() == 1.0
    clock.sleep_until(0.5)
    assert clock.now() == 1.0
