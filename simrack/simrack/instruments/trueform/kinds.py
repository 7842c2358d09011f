"""Differences within the Trueform series, as data.

Highest frequencies are those that the models are sold by; ranges of ramps, pulses and sample rates, and edges of a
pulse are general knowledge of the data sheets, unverified but for the 33600A's edges at power-on (users' record).
"""

from __future__ import annotations

import math
from types import MappingProxyType

from msgspec import Struct

from simrack.instruments.agilent33220a.settings import GeneratorKind

PRBS_BITS = 127
"""Bits of PN7, the only sequence that is simulated."""
LONGEST_BURST_S = 8000.0
"""Longest period of bursts of the internal timer (PyMeasure's tests of a real 33500B)."""


class TrueformSeries(Struct, frozen=True):
    """One of the two series.

    Args:
        identity: what ``*IDN?`` says around the model's name.
        ramp_hz: highest frequency of ramps and triangles.
        square_hz: highest frequency of squares and pulses, where it is less than that of sines.
        width_s: least width of a pulse.
        edge_s: shortest and longest edge of a pulse.
        edge_reset_s: edge after ``*RST``.
        sample_rate_hz: highest sample rate of an arbitrary waveform.
        bits_hz: highest bit rate of PRBS.
        least_points: of an arbitrary waveform (the maker's help page: 8 and 32).
    """

    identity: str
    ramp_hz: float
    square_hz: float
    width_s: float
    edge_s: tuple[float, float]
    edge_reset_s: float
    sample_rate_hz: float
    bits_hz: float
    least_points: int


SERIES_33500B = TrueformSeries(
    "Agilent Technologies,{},MY52701054,3.05-1.19-2.00-52-00",  # users' records of real ones
    ramp_hz=200e3,
    square_hz=30e6,
    width_s=16e-9,
    edge_s=(8.4e-9, 1e-6),
    edge_reset_s=10e-9,
    sample_rate_hz=250e6,
    bits_hz=50e6,
    least_points=8,
)
SERIES_33600A = TrueformSeries(
    "Keysight Technologies,{},MY53801234,A.02.03-3.15-03-64-02",  # the form is unverified
    ramp_hz=800e3,
    square_hz=100e6,
    width_s=5e-9,
    edge_s=(2.9e-9, 1e-6),
    edge_reset_s=4e-9,
    sample_rate_hz=660e6,
    bits_hz=200e6,
    least_points=32,
)


def kind(series: TrueformSeries, highest_hz: float) -> GeneratorKind:
    """Return the abilities of a model of `series` whose sines go up to `highest_hz`."""
    square_hz = min(highest_hz, series.square_hz)
    highest = {
        "SIN": highest_hz,
        "SQU": square_hz,
        "TRI": series.ramp_hz,
        "RAMP": series.ramp_hz,
        "PULS": square_hz,
        "USER": highest_hz,
        "PRBS": series.bits_hz / PRBS_BITS,
        "NOIS": highest_hz,
        "DC": highest_hz,
    }
    return GeneratorKind(
        frequency_hz=MappingProxyType({function: (1e-6, hz) for function, hz in highest.items()}),
        least_vpp=2e-3,  # 1 mVpp into 50 ohm: users' tests find 354 uVrms to be the least
        edge_s=series.edge_s,
        least_width_s=MappingProxyType({math.inf: series.width_s}),
        narrow_duty_hz=math.inf,
        burst_hz=(1e-6, highest_hz),
        longest_burst_s=LONGEST_BURST_S,
    )
