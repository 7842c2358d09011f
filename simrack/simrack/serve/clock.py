"""The clock of a served bench: bench time stops while an instrument is queried, and passes in between.

Other programs wait with clocks of their own, so bench time follows the wall clock. It is brought up to date once per
turn of the server's loop, never in the middle of a command: whatever a command does, it does at one instant.
"""

from __future__ import annotations

import math
import time

from simrack.clock import WallClock

MAX_SPEED = math.inf
"""As a speed: bench time passes as wall time does, and jumps to whatever a client waits for."""
SLOWEST, FASTEST = 1e-6, 1e6
"""Times real time: a second in eleven days, eleven days in a second."""


class ServedClock:
    """Bench time at `speed` times the wall clock's; it is 0 until :meth:`start`.

    At :data:`MAX_SPEED` it runs like the wall clock, for programs that wait by themselves, and jumps to the end of
    whatever a client waits for. A *lockstep* clock does not run at all: one client says how far it goes, and the
    results are those of a simulation in one process.
    """

    __slots__ = (
        "_anchor_s",
        "_anchor_wall_s",
        "_lockstep",
        "_now",
        "_paused",
        "_rate",
        "_speed",
        "_started",
        "_wall_now",
        "attended",
    )

    def __init__(self, speed: float = 1.0, wall: WallClock | None = None) -> None:
        self._wall_now = time.monotonic if wall is None else wall.now  # noqa: TID251  (looked at every turn)
        self._now = 0.0
        self._speed = _checked(speed)
        self._started = False
        self._paused = False
        self._lockstep = False
        self.attended = False
        """Whether anybody has been here since time began."""
        self._anchor()

    def start(self) -> None:
        """Start bench time with the first client, so that a run sees the same bench after any wait."""
        self.attended = True
        self.run_ahead()

    def run_ahead(self) -> None:
        """Start bench time before the first client."""
        if not self._started:
            self._started = True
            self._anchor()

    def restart(self) -> None:
        """Return to 0 until :meth:`start`, unpaused; a leading run goes on."""
        self._now = 0.0
        self._started = self._paused = self.attended = False
        self._anchor()

    def now(self) -> float:
        """Return the bench time, s."""
        return self._now

    def sleep_until(self, instant_s: float) -> None:
        """Jump to `instant_s`; time goes on from there."""
        self.move(instant_s)
        self._anchor()

    def move(self, instant_s: float) -> None:
        """Bring bench time up to `instant_s`, which the wall clock has reached; it never goes back."""
        self._now = max(self._now, instant_s)

    def reached(self) -> float:
        """Return the bench time that the wall clock has reached."""
        return self._anchor_s + (self._wall_now() - self._anchor_wall_s) * self._rate

    def catch_up(self, limit_s: float) -> float:
        """Bring bench time up to the wall clock, unless that is past `limit_s`; return the wall clock's bench time."""
        reached = self._anchor_s + (self._wall_now() - self._anchor_wall_s) * self._rate
        if self._now < reached < limit_s:
            self._now = reached
        return reached

    def wall_until(self, instant_s: float) -> float:
        """Return the wall seconds until bench time `instant_s`; inf while time is stopped."""
        if math.isinf(instant_s) or self._rate == 0:
            return math.inf
        return max(0.0, (instant_s - self.reached()) / self._rate)

    @property
    def jumps(self) -> bool:
        """True if time jumps to the instant that a client waits for."""
        return (self._lockstep or math.isinf(self._speed)) and not self._paused

    @property
    def speed(self) -> float:
        """The speed asked for."""
        return self._speed

    @speed.setter
    def speed(self, speed: float) -> None:
        self._speed = _checked(speed)
        self._anchor()

    @property
    def paused(self) -> bool:
        """True while time is stopped."""
        return self._paused

    @paused.setter
    def paused(self, paused: bool) -> None:
        self._paused = paused
        self._anchor()

    @property
    def lockstep(self) -> bool:
        """True if a client controls the clock."""
        return self._lockstep

    @lockstep.setter
    def lockstep(self, lockstep: bool) -> None:
        self._lockstep = lockstep
        self._anchor()

    def _anchor(self) -> None:
        """Let time go on from here, at the rate that holds now."""
        self._anchor_s = self._now
        self._anchor_wall_s = self._wall_now()
        if self._paused or self._lockstep or not self._started:
            self._rate = 0.0
        else:
            self._rate = 1.0 if math.isinf(self._speed) else self._speed


def _checked(speed: float) -> float:
    if not speed > 0:
        raise ValueError(f"a speed is greater than 0, not {speed}")
    if not SLOWEST <= speed <= FASTEST and speed != MAX_SPEED:
        raise ValueError(f"a speed is from {SLOWEST:g} to {FASTEST:g} times real time, or 'max', not {speed:g}")
    return speed
