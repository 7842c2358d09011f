"""The current input of the 34401A: nothing is wired to it, so it reads its own offset (User's Guide p. 216, 218)."""

from __future__ import annotations

from types import MappingProxyType

from simrack.instruments.hp34401a.imperfections import CurrentErrors

_DC_LIMITS = MappingProxyType({0.01: 2e-4, 0.1: 5e-5, 1.0: 1e-4, 3.0: 2e-4})
_AC_LIMITS = MappingProxyType({1.0: 4e-4, 3.0: 6e-4})
"""Published one-year error as a part of the range."""


def open_dc_input_a(errors: CurrentErrors, range_a: float) -> float:
    """Return the direct current that an open input shows."""
    return errors.dc_range_share * _DC_LIMITS.get(range_a, _DC_LIMITS[0.01]) * range_a


def open_ac_input_a(errors: CurrentErrors, range_a: float) -> float:
    """Return the alternating current that an open input shows; a true-rms converter shows none below 0."""
    return abs(errors.ac_range_share) * _AC_LIMITS[range_a] * range_a
