"""A table that follows its trapezoid exactly and a world around it."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING

from simrack.clock import VirtualClock, sleep

if TYPE_CHECKING:
    from simrack.device import Device
    from simrack.motion import RateRipple, Swing


class IdealMotion:
    """Closed-form trapezoid; an open servo coasts down at `friction_deg_s2`."""

    def __init__(self, clock: VirtualClock, friction_deg_s2: float = 20.0) -> None:
        self.clock = clock
        self.friction_deg_s2 = friction_deg_s2
        self.servo_closed = False
        self.commands = 0
        self._t0 = self._angle0 = self._rate0 = self._target = 0.0
        self._acceleration = friction_deg_s2

    def _restart(self, target: float, acceleration: float) -> None:
        self.commands += 1
        self._angle0, self._rate0, self._t0 = self.angle_deg(), self.rate_deg_s(), self.clock.now()
        self._target, self._acceleration = target, acceleration

    def demand_rate(self, rate_deg_s: float, acceleration_deg_s2: float, jerk_deg_s3: float = math.inf) -> None:
        assert self.servo_closed
        assert jerk_deg_s3 >= 1e6, "an ideal table follows trapezoids only"
        self._restart(rate_deg_s, acceleration_deg_s2)

    def close_servo(self) -> None:
        self._restart(self.rate_deg_s(), self.friction_deg_s2)
        self.servo_closed = True

    def open_servo(self) -> None:
        self._restart(0.0, self.friction_deg_s2)
        self.servo_closed = False

    def _ramp_s(self) -> float:
        return abs(self._target - self._rate0) / self._acceleration

    def rate_deg_s(self) -> float:
        elapsed = self.clock.now() - self._t0
        if elapsed >= self._ramp_s():
            return self._target
        return self._rate0 + math.copysign(self._acceleration * elapsed, self._target - self._rate0)

    def angle_deg(self) -> float:
        elapsed = self.clock.now() - self._t0
        ramp = min(elapsed, self._ramp_s())
        return self._angle0 + 0.5 * (self._rate0 + self.rate_deg_s()) * ramp + self._target * (elapsed - ramp)

    def past_angle_deg(self, ago_s: float) -> float:
        raise NotImplementedError("an ideal read-back never looks back")

    def profile_rate_deg_s(self) -> float:
        return self.rate_deg_s()

    def profile_acceleration_deg_s2(self) -> float:
        return 0.0 if self.profile_complete() else math.copysign(self._acceleration, self._target - self._rate0)

    @property
    def complete_s(self) -> float:
        return self._t0 + self._ramp_s()

    def goal_deg_s(self) -> float:
        return self._target if self.servo_closed else 0.0

    def beyond_s(self, rate_deg_s: float) -> float:
        if abs(self.goal_deg_s()) <= rate_deg_s:
            return math.inf
        return self._t0 + self._ramp_s() - (abs(self._target) - rate_deg_s) / self._acceleration

    @property
    def oscillating(self) -> bool:
        return False

    def add_ripple(self, *ripples: RateRipple) -> None:
        raise NotImplementedError("an ideal table has no ripple")

    def oscillate(self, swing: Swing) -> None:
        raise NotImplementedError("an ideal table follows trapezoids only")

    def profile_complete(self) -> bool:
        return self.clock.now() - self._t0 >= self._ramp_s()


class IdealWorld:
    def __init__(self) -> None:
        self.clock = VirtualClock()
        self.table = IdealMotion(self.clock)


def exchange(device: Device, clock: VirtualClock, message: bytes, wait_s: float = 2.0) -> bytes:
    """Send, then wait as a transport does until the reply is complete."""
    device.write(message)
    deadline = clock.now() + wait_s
    received = b""
    while True:
        part, end = device.read(65536)
        received += part
        wake = device.wake_at()
        if end or wake is None or wake > deadline:
            return received
        clock.sleep_until(wake)


__all__ = ["IdealMotion", "IdealWorld", "exchange", "sleep"]
