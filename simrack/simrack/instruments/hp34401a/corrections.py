"""Corrections of the 34401A's readings by calibrations, by function and range."""

from __future__ import annotations

from typing import NamedTuple

FLATNESS_HZ = 5e4
"""Where the flatness of ac is calibrated."""
_FULL_FLATNESS_HZ = 3e5


class _Correction(NamedTuple):
    offset: float = 0.0
    gain: float = 1.0


class Corrections:
    """Corrections by calibrations, by function and range; none to begin with."""

    def __init__(self) -> None:
        self._held: dict[tuple[str, float], _Correction] = {}
        self.flatness = 0.0
        """Added to the specimen's ac flatness error, at 300 kHz."""

    def apply(self, name: str, range_: float, reading: float) -> float:
        """Return the corrected reading."""
        held = self._held.get((name, range_))
        return reading if held is None else (reading - held.offset) * held.gain

    def shift(self, name: str, range_: float, reading: float) -> None:
        """Shift readings such that the present `reading` becomes 0."""
        held = self._held.get((name, range_), _Correction())
        self._held[name, range_] = _Correction(held.offset + reading / held.gain, held.gain)

    def stretch(self, name: str, range_: float, factor: float) -> None:
        """Multiply readings by `factor`."""
        held = self._held.get((name, range_), _Correction())
        self._held[name, range_] = _Correction(held.offset, held.gain * factor)

    def tilt(self, factor: float) -> None:
        """Multiply readings at the frequency of the flatness calibration by `factor`, more above, less below."""
        self.flatness += (factor - 1.0) * (_FULL_FLATNESS_HZ / FLATNESS_HZ) ** 2
