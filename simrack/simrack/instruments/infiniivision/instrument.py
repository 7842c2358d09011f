"""Simulated InfiniiVision 3000 X and 4000 X: a DSO7104B with a longer measurement record, other memory and numbers.

Sources: users' records of ``*IDN?``; pages of the 3000T programmer's guide that also stand behind the DSO7104B; and
PyMeasure's driver of the DSOX1102G with its tests on a real one, the smallest of the X series: 62 500 points in the
measurement record, two digits of exponent, twelve decimals. That the larger ones answer like it is unverified; memory
and sample rates are general knowledge of the data sheets.

Beside a DSO7104B it has the voltmeter (from the record on the screen, three digits; its frequency from the counter),
annotation, and an MSO the settings of digital channels: headers of the maker's SCPI description of the 2000 X-Series
and of the 3000T guide. All but the voltmeter is kept and told; defaults, and that the voltmeter switched off answers
9.9E+37, are unverified. So is what its own measurements count, and that a bit rate is one over the shortest width. The
negative duty cycle is of the 4000 X guide (p. 596), the slew rate of the M9241A's of the same series (p. 504; that a
falling edge's is negative is unverified), ``YATX`` has the form of users' programs. Not simulated beside what a
DSO7104B's twin leaves out: measurements of spectra, what is on digital channels, the generator inside, reference
waveforms, the second math trace.
"""

from __future__ import annotations

from collections.abc import Callable
from functools import partial
from typing import Any, ClassVar, Self

import numpy as np
from msgspec.structs import replace

from simrack import scpi
from simrack.instruments.dso7104b import COMMANDS, Dso7104BTwin, ScopeErrors
from simrack.instruments.dso7104b.declarations import OPTIONAL_SOURCE, SECONDS
from simrack.instruments.dso7104b.installed import INVALID
from simrack.instruments.dso7104b.kinds import KIND_7000B, ScopeKind
from simrack.instruments.dso7104b.measurements import MeasuredTrace
from simrack.instruments.dso7104b.measuring_commands import (
    EDGES,
    averaging,
    counted,
    install,
    measured,
    measurement,
)

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
    """Imperfections of an X series oscilloscope, drawn within the DSO7104B's data sheet: its own was not at hand."""

    exponent_digits: int = 2


_KINDS = {
    each.name: each
    for each in (
        _kind("DSOX3024A", "AGILENT TECHNOLOGIES,{},MY51360123,02.38.2014110300", 4, 4e9),
        _kind("MSOX3104T", "KEYSIGHT TECHNOLOGIES,{},MY55510123,07.30.2019051434", 4, 5e9),
        _kind("DSOX4104A", "KEYSIGHT TECHNOLOGIES,{},MY54100123,04.08.2016071800", 4, 5e9),
    )
}
"""200 MHz, 1 GHz and 1 GHz, four channels each; the digital ones of the MSOX3104T are settings only."""

_ENABLED, _SOURCE, _MODE, _NOTE = "DVM:ENABle", "DVM:SOURce", "DVM:MODE", "DISPlay:ANNotation<1-1>"
_LOGIC = scpi.Number(unit="V", limits=scpi.Limits(-8.0, 8.0), words={"CMOS": 2.5, "ECL": -1.3, "TTL": 1.4})
_GROUPS = ("DIGital<0-15>", "POD<1-2>")


def _voltmeter(model: Dso7104BTwin) -> Any:
    kept = model.engine.remembered
    source, mode = kept.get((_SOURCE,), "CHAN1"), kept.get((_MODE,), "DC")
    if not kept.get((_ENABLED,)):
        return model.nr3(INVALID)
    if mode == "FREQ":
        return counted(model, source)

    def volts(trace: MeasuredTrace) -> float | None:
        cycle = trace.period() is not None
        value = trace.average(cycle=cycle) if mode == "DC" else trace.rms(cycle=cycle, ac=mode == "ACRM")
        return None if value is None else float(f"{value:.2e}")

    return measured(model, source, volts, EDGES)


def _switch(header: str, *, on: bool = False) -> scpi.Command:
    return scpi.remembered(header, scpi.Boolean(), default=on, reply=scpi.boolean)


def _edges(trace: MeasuredTrace, *, rising: bool) -> float:
    return float(np.count_nonzero(trace.edges().rising == rising))


def _pulses(trace: MeasuredTrace, *, positive: bool) -> float:
    """Return the number of edges that have the opposite one behind them: edges alternate."""
    return float(np.count_nonzero(trace.edges().rising[:-1] == positive))


def _bit_rate_hz(trace: MeasuredTrace) -> float | None:
    widths_s = np.diff(trace.edges().middle_s)
    return 1.0 / float(widths_s.min()) if len(widths_s) else None


def _burst_s(trace: MeasuredTrace) -> float | None:
    middles_s = trace.edges().middle_s
    return float(middles_s[-1] - middles_s[0]) if len(middles_s) > 1 else None


def _area_v_s(trace: MeasuredTrace, words: set[str]) -> float | None:
    cycle = "CYCL" in words
    mean_v, lasts_s = trace.average(cycle=cycle), trace.period() if cycle else float(np.ptp(trace.times_s))
    return None if mean_v is None or lasts_s is None else mean_v * lasts_s


_SLOPES = {"RIS": True, "FALL": False, "EITH": None}


def _slew(slope: str | None) -> Callable[[MeasuredTrace], float | None]:
    return partial(MeasuredTrace.slew_rate, rising=_SLOPES[slope or "RIS"])


_SLEW = (OPTIONAL_SOURCE, scpi.Choice(("RISing", "FALLing", "EITHer"), required=False))
_AT = (SECONDS, OPTIONAL_SOURCE)
_MEASUREMENTS = (
    measurement("NDUTy", MeasuredTrace.negative_duty_cycle, EDGES),
    scpi.Command(
        "MEASure:SLEWrate",
        _SLEW,
        do=lambda model, source, slope: install(model, "SLEWrate", (source,), _slew(slope), EDGES),
        query=lambda model, source, slope: measured(model, source, _slew(slope), EDGES),
        query_parameters=_SLEW,
    ),
    scpi.Command(
        "MEASure:YATX",
        _AT,
        do=lambda model, at_s, source: install(model, "YATX", (source,), lambda trace: trace.voltage_at(at_s)),
        query=lambda model, at_s, source: measured(model, source, lambda trace: trace.voltage_at(at_s)),
        query_parameters=_AT,
    ),
    averaging("AREa", _area_v_s),
    measurement("BRATe", _bit_rate_hz, EDGES),
    measurement("BWIDth", _burst_s, EDGES),
    *(
        measurement(f"{letter}EDGes", partial(_edges, rising=rising), EDGES)
        for letter, rising in (("P", True), ("N", False))
    ),
    *(
        measurement(f"{letter}PULses", partial(_pulses, positive=positive), EDGES)
        for letter, positive in (("P", True), ("N", False))
    ),
)
_OWN = (
    *_MEASUREMENTS,
    *(_switch(each) for each in (_ENABLED, _NOTE, "MEASure:STATistics:DISPlay")),
    _switch("DVM:ARANge", on=True),
    scpi.remembered(_SOURCE, scpi.Choice(("CHANnel<1-4>",)), "CHAN1"),
    scpi.remembered(_MODE, scpi.Choice(("ACRMs", "DC", "DCRMs", "FREQuency")), "DC"),
    scpi.Command("DVM:CURRent", query=_voltmeter),
    scpi.Command("DVM:FREQuency", query=lambda model: counted(model, model.engine.remembered.get((_SOURCE,), "CHAN1"))),
    scpi.remembered(f"{_NOTE}:BACKground", scpi.Choice(("OPAQue", "INVerted", "TRANsparent")), "OPAQ"),
    scpi.remembered(f"{_NOTE}:COLor", scpi.Choice(("CH<1-4>", "DIG", "MATH", "REF", "MARKer", "WHITe", "RED")), "WHIT"),
    scpi.remembered(f"{_NOTE}:TEXT", scpi.Text(limit=254), "", scpi.quoted),
)

_DIGITAL = (
    *(_switch(f"{each}:DISPlay") for each in _GROUPS),
    *(scpi.remembered(f"{each}:SIZE", scpi.Choice(("SMALl", "MEDium", "LARGe")), "SMAL") for each in _GROUPS),
    *(scpi.remembered(f"{each}:THReshold", _LOGIC, 1.4, scpi.real(12)) for each in _GROUPS),
    scpi.remembered("DIGital<0-15>:LABel", scpi.Text(limit=10), "", scpi.quoted),
    scpi.remembered("DIGital<0-15>:POSition", scpi.Integer(limits=scpi.Limits(0, 15)), 0, scpi.signed_integer),
)
"""Of an MSO: each digital channel keeps a threshold of its own, which the pod's does not change."""


class InfiniiVisionXTwin(Dso7104BTwin):
    """An oscilloscope of the X series, made by :meth:`of_model`; arguments as of the DSO7104B."""

    errors_class: ClassVar = XSeriesErrors

    @classmethod
    def of_model(cls, model: str) -> type[Self]:
        """Return the simulated model of the series."""
        digital = _DIGITAL if model.startswith("MSO") else ()
        table = scpi.CommandTable(*COMMANDS, *_OWN, *digital, limit_queries=False)
        return type(cls.__name__, (cls,), {"kind": _KINDS[model], "table": table, "__doc__": cls.__doc__})

    def identity(self) -> str:
        """Return the reply of a real unit (users' records), which writes DSO-X 3024A, but for the model."""
        model = f"{self._model[:3]}-X {self._model[4:]}" if self._model[3:4] == "X" else self._model
        return self.kind.identity.format(model)
