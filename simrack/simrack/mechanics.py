"""Mechanics of a rate table: motion of its shaft without its controller."""

from __future__ import annotations

from typing import Protocol


class TableMechanics(Protocol):
    """Loop, error of the mean rate, ripple, flutter and friction of a table."""

    @property
    def loop_hz(self) -> float:
        """Natural frequency of the rate loop, Hz."""

    @property
    def loop_damping(self) -> float:
        """Damping of the rate loop."""

    @property
    def rate_error(self) -> float:
        """Relative error of the mean rate."""

    @property
    def ripple_arcsec(self) -> tuple[float, ...]:
        """Amplitude of the angle error of each harmonic, arcsec."""

    @property
    def ripple_harmonic(self) -> tuple[int, ...]:
        """Periods of each harmonic in a turn."""

    @property
    def ripple_phase_rad(self) -> tuple[float, ...]:
        """Phase of each harmonic at angle zero, rad."""

    @property
    def flutter_per_sqrt_hz(self) -> float:
        """Flutter of the true rate, a share of it, at the frequency of the loop, 1/sqrt(Hz)."""

    @property
    def friction_deg_s2(self) -> float:
        """Dry friction with the servo open, deg/s^2."""

    @property
    def friction_time_s(self) -> float:
        """Time constant of viscous friction with the servo open, s."""
