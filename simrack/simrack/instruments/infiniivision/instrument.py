"""Simulated InfiniiVision 3000 X and 4000 X: a DSO7104B with a longer measurement record, other memory and numbers.

Sources: users' records of ``*IDN?``; pages of the 3000T programmer's guide that also stand behind the DSO7104B; and
PyMeasure's driver of the DSOX1102G with its tests on a real one, the smallest of the X series: 62 500 points in the
measurement record, two digits of exponent, twelve decimals. That the larger ones answer like it is unverified; memory
and sample rates are general knowledge of the data sheets.

Not simulated beside what a DSO7104B's twin leaves out: the X series' own measurements, digital channels, the generator
inside, reference waveforms, the second math trace.
"""

from __future__ import annotations

from typing import ClassVar, Self

import numpy as np
from msgspec.structs import replace

from simrack.instruments.dso7104b import Dso7104BTwin, ScopeErrors
from simrack.instruments.dso7104b.kinds import KIND_7000B, ScopeKind

_LENGTHS = (*(100, 250, 500, 1000, 2000, 5000, 10_000, 20_000, 50_000, 62_500), *(100_000, 200_000, 500_000, 1_000_000))


def _kind(name: str, identity: str, millions: int, rate_hz: float) -> ScopeKind:
    """Return a model with so many million points, half of them and half the rate with both channels of a pair."""
    deepest = tuple(each * 1_000_000 for each in (2, 4) if each <= millions)
    return replace(
        KIND_7000B,
        name=name,
        identity=identity,
        screen_points=62_500,
        record_lengths=(*_LENGTHS, *deepest),
        memory=(millions * 1_000_000, millions * 500_000),
        rate_hz=(rate_hz, rate_hz / 2.0),
        decimals=12,
        least_range_v=8e-3,
        limit_hz=20e6,
    )


class XSeriesErrors(ScopeErrors, frozen=True):
    """Imperfections of an X series oscilloscope, of a DSO7104B's kinds; its exponents have two digits."""

    @classmethod
    def none(cls) -> XSeriesErrors:
        """Return an oscilloscope without errors."""
        return _two_digits(cls, ScopeErrors.none())

    @classmethod
    def drawn(cls, rng: np.random.Generator) -> XSeriesErrors:
        """Return a specimen drawn within the DSO7104B's data sheet; its own was not at hand."""
        return _two_digits(cls, ScopeErrors.drawn(rng))


def _two_digits(kind: type[XSeriesErrors], like: ScopeErrors) -> XSeriesErrors:
    fields = {name: getattr(like, name) for name in ScopeErrors.__struct_fields__}
    return kind(**{**fields, "exponent_digits": 2})


_KINDS = {
    each.name: each
    for each in (
        _kind("DSOX3024A", "AGILENT TECHNOLOGIES,{},MY51360123,02.38.2014110300", 4, 4e9),
        _kind("MSOX3104T", "KEYSIGHT TECHNOLOGIES,{},MY55510123,07.30.2019051434", 4, 5e9),
        _kind("DSOX4104A", "KEYSIGHT TECHNOLOGIES,{},MY54100123,04.08.2016071800", 4, 5e9),
    )
}
"""200 MHz, 1 GHz and 1 GHz, four channels each; the digital ones of the MSOX3104T are not simulated."""


class InfiniiVisionXTwin(Dso7104BTwin):
    """An oscilloscope of the X series, made by :meth:`of_model`; arguments as of the DSO7104B."""

    errors_class: ClassVar = XSeriesErrors

    @classmethod
    def of_model(cls, model: str) -> type[Self]:
        """Return the simulated model of the series."""
        return type(cls.__name__, (cls,), {"kind": _KINDS[model], "__doc__": cls.__doc__})

    def identity(self) -> str:
        """Return the reply of a real unit (users' records), which writes DSO-X 3024A, but for the model."""
        model = f"{self._model[:3]}-X {self._model[4:]}" if self._model[3:4] == "X" else self._model
        return self.kind.identity.format(model)
