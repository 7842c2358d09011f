"""Modulation of the amplitude or the width of a waveform."""

from __future__ import annotations

import numpy as np
from msgspec import Struct

from simrack.instruments.agilent33220a.phases import Rhythm
from simrack.instruments.agilent33220a.waveforms import Values

HIGHEST_PEAK_V = 10.0
"""Where the output amplifier ends, open circuit; only more than 100 % of AM gets there."""


class Envelope(Struct, frozen=True):
    """Amplitude modulation: (1 + depth rhythm)/2 of the amplitude, at most `most` of it."""

    depth: float
    rhythm: Rhythm
    most: float

    def values(self, times_s: Values) -> Values:
        """Return the factor at bench times."""
        return np.minimum((1 + self.depth * self.rhythm.values(times_s)) / 2, self.most)

    def means(self, edges_s: Values) -> Values:
        """Return its mean between each two of the edges."""
        swung = np.diff(self.rhythm.integral_s(edges_s)) / np.diff(edges_s)
        return np.minimum((1 + self.depth * swung) / 2, self.most)


class WidthSwing(Struct, frozen=True):
    """Pulse width modulation: duty + swing rhythm."""

    duty: float
    swing: float
    rhythm: Rhythm

    def values(self, times_s: Values) -> Values:
        """Return the duty at bench times."""
        return np.clip(self.duty + self.swing * self.rhythm.values(times_s), 0.0, 1.0)
