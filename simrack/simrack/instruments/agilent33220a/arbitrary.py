"""The arbitrary waveforms of a 33220A: five built in, one volatile, four kept."""

from __future__ import annotations

import math
from functools import cache
from typing import TYPE_CHECKING

from simrack.scpi import ScpiError

if TYPE_CHECKING:
    from collections.abc import Callable, Sequence

    from simrack.instruments.agilent33220a.waveforms import Segments

ARBITRARY_POINTS = 16384
"""Length of the built-in arbitrary waveforms (unverified for the 33220A; the 33250A has 4096)."""
PLACES = 4
MOST_POINTS = 65536
_FALLS = 5.9994
"""Time constants in the built-in exponentials: gives the average on record, the crest factor 0.05 % above it."""


def _fall(place: float) -> float:
    end = math.exp(-_FALLS)
    return (math.exp(-_FALLS * place) - end) / (1.0 - end)


def _sinc(place: float) -> float:
    argument = (place - 0.5) * 20.0 * math.pi
    return math.sin(argument) / argument if argument else 1.0


def _cardiac(place: float) -> float:
    beats = ((0.2, 0.025, 0.12), (0.32, 0.008, -0.15), (0.35, 0.01, 1.0), (0.38, 0.008, -0.25), (0.6, 0.05, 0.25))
    return sum(height * math.exp(-(((place - centre) / width) ** 2)) for centre, width, height in beats)


BUILT_IN: dict[str, Callable[[float], float]] = {
    "EXP_RISE": lambda place: 1.0 - 2.0 * _fall(place),
    "EXP_FALL": lambda place: 2.0 * _fall(place) - 1.0,
    "NEG_RAMP": lambda place: 1.0 - 2.0 * place,
    "SINC": _sinc,
    "CARDIAC": _cardiac,
}
"""By place 0...1 in the period; of some only the names are known, the shapes are ours."""


@cache
def _built_in(name: str) -> tuple[float, ...]:
    shape = BUILT_IN[name]
    return tuple(shape(index / (ARBITRARY_POINTS - 1)) for index in range(ARBITRARY_POINTS))


def mean(points: Sequence[float]) -> float:
    """Return the average of points."""
    return math.fsum(points) / len(points)


def crest(points: Sequence[float]) -> float:
    """Return the crest factor: peak over deviation."""
    average = mean(points)
    rms = math.sqrt(math.fsum((point - average) ** 2 for point in points) / len(points))
    return max(abs(point) for point in points) / rms if rms else 0.0


class ArbitraryMemory:
    """Waveforms that can be selected as USER, each in -1...1.

    Args:
        full_scale: codes of the converter for 1, to which points are rounded as they come out; 0 for none.
    """

    def __init__(self, full_scale: int) -> None:
        self._full_scale = full_scale
        self._volatile: tuple[float, ...] = ()
        self._kept: dict[str, tuple[float, ...]] = {}
        self._played: tuple[tuple[float, ...], Segments] | None = None

    def names(self) -> list[str]:
        """Return every waveform that can be selected."""
        return [*(["VOLATILE"] if self._volatile else []), *BUILT_IN, *self._kept]

    def kept_names(self) -> list[str]:
        """Return the waveforms in the four non-volatile places."""
        return list(self._kept)

    def points(self, name: str) -> tuple[float, ...]:
        """Return a waveform; 785 if there is none of that name."""
        if name == "VOLATILE" and self._volatile:
            return self._volatile
        if name in BUILT_IN:
            return _built_in(name)
        if name not in self._kept:
            raise ScpiError(785, "Specified arb waveform does not exist")
        return self._kept[name]

    def waveform(self, name: str) -> Segments:
        """Return a waveform as it comes out: each point is held until the next (unverified)."""
        points = self.points(name)
        if self._played is None or self._played[0] is not points:
            from simrack.instruments.agilent33220a.waveforms import held  # noqa: PLC0415  (numpy only where played)

            scale = self._full_scale
            self._played = points, held([round(each * scale) / scale for each in points] if scale else list(points))
        return self._played[1]

    def load(self, points: list[float]) -> None:
        """Take 1...65536 points as VOLATILE."""
        if len(points) > MOST_POINTS:
            raise ScpiError(-223)
        self._volatile = tuple(points)

    def keep(self, name: str, source: str = "VOLATILE") -> None:
        """Copy the volatile waveform to `name`; `source` must be VOLATILE."""
        if source != "VOLATILE":
            raise ScpiError(784, "Name of source arb waveform for copy must be VOLATILE")
        if name == "VOLATILE":
            raise ScpiError(788, "Cannot copy to VOLATILE arb waveform")
        if name in BUILT_IN:
            raise ScpiError(782, "Cannot overwrite a built-in waveform")
        points = self.points("VOLATILE")
        if name not in self._kept and len(self._kept) >= PLACES:
            raise ScpiError(781, "Not enough memory to store new arb waveform; use DATA:DELETE")
        self._kept[name] = points

    def delete(self, name: str, playing: str) -> None:
        """Forget a waveform, unless it is built in or `playing`."""
        if name in BUILT_IN:
            raise ScpiError(786, "Not able to delete a built-in arb waveform")
        self.points(name)
        if name == playing:
            raise ScpiError(787, "Not able to delete the currently selected active arb waveform")
        if name == "VOLATILE":
            self._volatile = ()
        else:
            del self._kept[name]
