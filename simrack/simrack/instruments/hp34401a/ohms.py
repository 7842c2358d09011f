"""Resistance, continuity and diode test of the 34401A: a test current into the node, and the voltage it makes there.

A node under voltage adds its own to what the current makes, so that a powered circuit reads wrong, beyond range or
negative, as in life (User's Guide p. 52, 216, 219).
"""

from __future__ import annotations

import math
from types import MappingProxyType
from typing import NamedTuple

from simrack.instruments.hp34401a.calculation import OVERLOAD

TEST_CURRENT_A = MappingProxyType({1e2: 1e-3, 1e3: 1e-3, 1e4: 1e-4, 1e5: 1e-5, 1e6: 5e-6, 1e7: 5e-7, 1e8: 5e-7})
"""Test current by range (p. 216)."""
_PARALLEL_OHM = 1e7
"""On the 100 Mohm range the current flows beside 10 Mohm (p. 216)."""
_COMPLIANCE_V = 13.0
"""Voltage of the current source without a load; beyond it nothing is read (unverified)."""
BEEP_OHM = 10.0
"""Continuity sounds at or below this; set on the front panel, 1 to 1000 ohm (p. 51)."""
BEEP_DIODE_V = (0.3, 0.8)
"""The diode test sounds in between (p. 51)."""


class OhmsAccuracy(NamedTuple):
    """Published one-year accuracy of a range: parts of reading and of range."""

    reading: float
    range: float


_LIMITS = MappingProxyType(
    {
        1e2: OhmsAccuracy(1e-4, 4e-5),
        1e3: OhmsAccuracy(1e-4, 1e-5),
        1e4: OhmsAccuracy(1e-4, 1e-5),
        1e5: OhmsAccuracy(1e-4, 1e-5),
        1e6: OhmsAccuracy(1e-4, 1e-5),
        1e7: OhmsAccuracy(4e-4, 1e-5),
        1e8: OhmsAccuracy(8e-3, 1e-4),
    }
)
"""Four-wire, or two-wire after null (p. 216)."""


def limits(range_ohm: float) -> OhmsAccuracy:
    """Return the published one-year accuracy of a resistance range."""
    return _LIMITS[range_ohm]


def resistance_ohm(node_v: float, source_ohm: float, range_ohm: float) -> float:
    """Return the reading of a node of `source_ohm` at `node_v`; a node without a path is an overload."""
    current = TEST_CURRENT_A[range_ohm]
    if math.isinf(source_ohm):
        return OVERLOAD
    if range_ohm < 1e8:
        volts = node_v + current * source_ohm
        return volts / current if abs(volts) < _COMPLIANCE_V else math.copysign(OVERLOAD, volts)
    volts = (node_v + current * source_ohm) * _PARALLEL_OHM / (_PARALLEL_OHM + source_ohm)
    through = current - volts / _PARALLEL_OHM
    return volts / through if through > 0.0 else OVERLOAD
