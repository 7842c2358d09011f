"""Settings of a function of the 34401A, and their choice by CONFigure (User's Guide p. 53-61, 111-117)."""

from __future__ import annotations

from typing import Any

from msgspec import Struct

from simrack.instruments.hp34401a.functions import APERTURES_S, Function
from simrack.scpi import ScpiError, Special


class Setup(Struct):
    """Settings of one function. `resolution` is a fraction of the range, `nplc` and `aperture_s` go with it."""

    range: float
    auto: bool = True
    nplc: float = 10.0
    resolution: float = 1e-6
    aperture_s: float = 0.1

    @classmethod
    def of(cls, function: Function) -> Setup:
        """Return the settings after *RST; continuity and diode test have 5.5 digits, 300 a second (p. 51, 217)."""
        nplc = 0.2 if function.fixed else 10.0
        return cls(function.default_range, nplc=nplc, resolution=function.fraction_of(nplc))


def configured(function: Function, expected: Any, resolution: Any) -> Setup:
    """Return the settings that CONFigure makes of an expected value and a resolution (p. 111-113).

    Raises:
        ScpiError: -221 for a resolution together with autorange, -222 beyond the top range, 532 for a resolution that
            cannot be had.
    """
    setup = Setup.of(function)
    if not function.ranges:
        _configure_gate(setup, function, expected, resolution)
    elif expected is None or expected is Special.DEF:
        if resolution not in (None, Special.DEF):
            raise ScpiError(-221)
    else:
        setup.auto = False
        setup.range = function.range_for(_expected(function, expected))
        setup.resolution = attainable_fraction(function, setup.range, resolution)
        setup.nplc = function.nplc_for(setup.resolution)
    return setup


def _expected(function: Function, expected: Any) -> float:
    if isinstance(expected, Special):
        return function.ranges[0] if expected is Special.MIN else function.ranges[-1]
    return float(expected)


def attainable_fraction(function: Function, range_: float, resolution: Any) -> float:
    """Return the resolution as a fraction of the range, the coarsest attainable one that is fine enough (p. 55)."""
    legal = function.resolutions
    if resolution in (None, Special.DEF):
        return function.fractions[10.0] if function.integrating else 1e-6
    if isinstance(resolution, Special):
        return min(legal) if resolution is Special.MIN else max(legal)
    wanted = resolution / range_
    fine_enough = [fraction for fraction in legal if fraction <= wanted * (1 + 1e-9)]
    if not fine_enough:
        raise ScpiError(532)
    return max(fine_enough)


def _configure_gate(setup: Setup, function: Function, expected: Any, resolution: Any) -> None:
    """Frequency, period, continuity and diode have one range; a resolution picks the gate time (p. 61)."""
    if isinstance(expected, float) and not function.lowest <= expected <= function.highest:
        raise ScpiError(-222)
    if isinstance(resolution, Special) or resolution is None:
        setup.aperture_s = 1.0 if resolution is Special.MIN else 0.01 if resolution is Special.MAX else 0.1
        return
    usual = function.slowest if function.gated else function.default_range
    wanted = resolution / (expected if isinstance(expected, float) else usual)
    gates = [aperture for aperture, fraction in APERTURES_S.items() if fraction <= wanted * (1 + 1e-9)]
    if not gates:
        raise ScpiError(532)
    setup.aperture_s = min(gates)
