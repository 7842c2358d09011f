"""Two generators in series on one input of the PCB."""

from __future__ import annotations

import cmath
import math
from typing import TYPE_CHECKING

from msgspec import Struct
from msgspec.structs import replace

from simrack.sources import Drive, Piece, Played, Sine

if TYPE_CHECKING:
    import numpy as np
    from numpy.typing import NDArray

    from simrack.components import Component
    from simrack.sources import Bend


def added(first: Drive | Played | None, second: Drive | Played | None) -> Drive | Played | None:
    """Return two sources in series, with the resistance of the first; one that is not there is a wire."""
    if first is None or second is None:
        return second if first is None else first
    if isinstance(first, Drive):
        return _drives(first, second) if isinstance(second, Drive) else _Added(second, first)
    return _Added(first, second)


def _drives(first: Drive, second: Drive) -> Drive:
    own = Sine(second.amplitude_v, second.frequency_hz, second.phase_rad)
    sines = (own, *second.overtones) if second.amplitude_v else second.overtones
    return replace(first, dc_v=first.dc_v + second.dc_v, overtones=(*first.overtones, *sines))


class _Added(Struct, frozen=True):
    """Two sources, of which the first plays: of the curvature of an input the second sees none."""

    first: Played
    second: Drive | Played

    @property
    def source_ohm(self) -> float:
        """Series resistance of the first, ohm."""
        return self.first.source_ohm

    def at(self, times_s: NDArray[np.float64]) -> NDArray[np.float64]:
        """Return the open-circuit volts at bench times."""
        return self.first.at(times_s) + self.second.at(times_s)

    def piece(self, start_s: float, bend: Bend) -> Piece:
        """Return both after the input's non-linearity, from `start_s`."""
        own, slope = self.first.piece(start_s, bend), bend[1]
        if isinstance(self.second, Drive):
            # `slope` times a source that goes on for ever, over the time of another piece
            drive = self.second
            sines = (Sine(drive.amplitude_v, drive.frequency_hz, drive.phase_rad), *drive.overtones)
            terms = []
            for each in sines:
                speed = math.tau * each.frequency_hz
                size = -1j * cmath.rect(slope * each.amplitude_v, speed * own.start_s + each.phase_rad)
                terms.append((size, 1j * speed))
            more = Piece(own.start_s, own.stop_s, slope * drive.dc_v, 0.0, tuple(terms))
        else:
            more = self.second.piece(own.start_s, (0.0, slope, 0.0, 0.0))
        return Piece(
            own.start_s,
            min(own.stop_s, more.stop_s),
            own.constant + more.constant,
            own.slope_per_s + more.slope_per_s,
            (*own.terms, *more.terms),
        )

    def divided(self, share: float) -> _Added:
        """Return both behind a resistance that leaves `share` of the open voltage (Thevenin)."""
        return _Added(self.first.divided(share), self.second.divided(share))

    def components(self) -> tuple[Component, ...]:
        """Return the components of both."""
        return *self.first.components(), *self.second.components()
