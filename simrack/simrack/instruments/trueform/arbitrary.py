"""Arbitrary waveforms of the Trueform series: as many volatile ones as fit, each with its name."""

from __future__ import annotations

from functools import cache

from simrack.instruments.agilent33220a.arbitrary import BUILT_IN, ArbitraryMemory
from simrack.scpi import ScpiError

MOST_POINTS = 1_000_000
"""Points of the memory, which one waveform may fill (the maker's help page)."""
_POINTS = 250
"""Of a built-in one: 40 kSa/s make 160 Hz of EXP_RISE (users' record of a 33600A)."""
_FOLDER = "INT:\\BUILTIN\\"
"""Where ``FUNC:ARB?`` says that the built-in ones are (users' record of a 33600A)."""


def bare_name(name: str) -> str:
    """Return the name of a waveform without folder and extension, in capitals."""
    return name.upper().rpartition("\\")[2].removesuffix(".ARB")


def path(name: str) -> str:
    """Return the name of a waveform in ``FUNC:ARB?``."""
    return f"{_FOLDER}{name}.ARB" if name in BUILT_IN else name


@cache
def _built_in(name: str) -> tuple[float, ...]:
    return tuple(BUILT_IN[name](index / (_POINTS - 1)) for index in range(_POINTS))


class NamedWaveforms(ArbitraryMemory):
    """Waveforms by name. The built-in ones have the 33220A's shapes (unverified)."""

    def points(self, name: str) -> tuple[float, ...]:
        """Return a waveform; 785 if there is none of that name."""
        return _built_in(name) if name in BUILT_IN else super().points(name)

    def names(self) -> list[str]:
        """Return every waveform in volatile memory, the built-in one that is there after ``*RST`` first."""
        return [path("EXP_RISE"), *self._kept]

    def free(self) -> int:
        """Return the points for which there is room."""
        return MOST_POINTS - sum(map(len, self._kept.values()))

    def load_named(self, name: str, points: list[float], least: int) -> None:
        """Take a waveform; 786 where one of that name is there already, -220 of too few (unverified)."""
        if len(points) < least:
            raise ScpiError(-220, "Parameter error; too little data")
        if len(points) > self.free():
            raise ScpiError(-223)
        if name in self._kept or name in BUILT_IN:
            raise ScpiError(786, "Specified arb waveform already exists")
        self._kept[name] = tuple(points)

    def clear(self) -> None:
        """Forget all that was loaded."""
        self._kept.clear()
