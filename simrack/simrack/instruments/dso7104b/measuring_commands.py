"""Measurements of the DSO7104B: commands, traces, and the results that stay on the screen."""

from __future__ import annotations

import math
from collections.abc import Callable, Generator, Sequence
from typing import Any

from simrack import scpi
from simrack.instruments.dso7104b import declarations
from simrack.instruments.dso7104b.installed import INVALID, Installed, Preparation
from simrack.instruments.dso7104b.instrument import SimulatedDso7104B
from simrack.instruments.dso7104b.measurements import MeasuredTrace
from simrack.scpi.lexer import Token, TokenKind

ROWS = scpi.Rows()

_INSTALLED_MOST = 4
EDGES = MeasuredTrace.finding_edges


class _Definition(scpi.Parameter, frozen=True):
    """A word or a number of :MEASure:DEFine."""

    def parse(self, token: Token) -> str | float:
        """Return the number, or the word's short form."""
        if token.kind is TokenKind.NUMBER:
            return token.number
        return scpi.Choice(("STANdard", "PERCent", "ABSolute")).parse(token)


class _Averaging(scpi.Choice, frozen=True):
    """A word or a source of VAVerage and VRMS."""

    words: tuple[str, ...] = ("CYCLe", "DISPlay", "AUTO", "AC", "DC", "CHANnel<1-4>", "FUNCtion", "MATH")

    def parse(self, token: Token) -> str:
        """Return the short form, FUNC for MATH."""
        word = scpi.Choice.parse(self, token)
        return "FUNC" if word == "MATH" else word


# --- values


def measured(
    model: SimulatedDso7104B,
    source: str | None,
    of: Callable[[MeasuredTrace], float | None],
    prepare: Preparation | None = None,
) -> Any:
    """Return the value of a source, or of the one that :MEASure:SOURce names, once there is a record."""
    return _measured_of(model, (source or model.state.measure.sources[0],), of, prepare)


def _measured_pair(
    model: SimulatedDso7104B,
    first: str | None,
    second: str | None,
    of: Callable[[MeasuredTrace, MeasuredTrace], float | None],
    prepare: Preparation | None = None,
) -> Any:
    one, two = first or model.state.measure.sources[0], second or model.state.measure.sources[1]
    if two == "NONE":
        return model.nr3(INVALID)
    return _measured_of(model, (one, two), of, prepare)


def _measured_of(
    model: SimulatedDso7104B, sources: tuple[str, ...], of: Callable[..., float | None], prepare: Preparation | None
) -> Any:
    def measure() -> Generator[None, None, str]:
        return model.nr3((yield from Installed("", sources, of, prepare).measuring(model.shown.measuring)))

    return model.look(lambda: scpi.Pending.worked_out(measure()))


def install(
    model: SimulatedDso7104B,
    name: str,
    sources: Sequence[str | None],
    of: Callable[..., float | None],
    prepare: Preparation | None = None,
) -> None:
    """Put a measurement on the screen, for :MEASure:RESults?; there is room for four (unverified)."""
    defaults = model.state.measure.sources
    named = tuple(source or default for source, default in zip(sources, defaults, strict=False))
    if "NONE" in named:
        raise scpi.ScpiError(-221)  # there is no second source to measure (number unverified)
    label = f"{name}({','.join(source.removeprefix('CHAN') for source in named)})"
    model.installed.append(Installed(label, named, of, prepare))
    del model.installed[:-_INSTALLED_MOST]


@ROWS.do("MEASure:CLEar")
def _clear(model: SimulatedDso7104B) -> None:
    model.installed.clear()
    model.shown.analysed = False


# --- results


@ROWS.query("MEASure:RESults")
def _results(model: SimulatedDso7104B) -> Any:
    return model.look(lambda: scpi.Pending.worked_out(_results_now(model)))


def _results_now(model: SimulatedDso7104B) -> Generator[None, None, str]:
    """Return installed measurements: label, current, minimum, maximum, mean, deviation, count (ON), or one of these.

    Statistics are of the one record, or of all segments once they have been analysed.
    """
    kind = model.state.measure.statistics
    rows = []
    for each in tuple(model.installed):
        label, values = yield from _row(model, each)
        rows.append((label, values))
    if kind == "ON":
        return ",".join(",".join((label, *map(model.nr3, values[:-1]), f"{values[-1]:.0f}")) for label, values in rows)
    index = ("CURR", "MIN", "MAX", "MEAN", "STDD", "COUN").index(kind)
    return ",".join(f"{values[5]:+.0f}" if index == 5 else model.nr3(values[index]) for _, values in rows)


def _row(model: SimulatedDso7104B, installed: Installed) -> Generator[None, None, tuple[str, tuple[float, ...]]]:
    try:
        shown, records = model.shown.record, model.shown.records if model.shown.analysed else [model.shown.record]
    except scpi.ScpiError:
        return installed.label, (*(INVALID,) * 4, 0.0, 1.0)
    current, values = (yield from installed.measuring(model.shown.measuring, shown)), list[float]()
    for record in records:
        if (value := (yield from installed.measuring(model.shown.measuring, record))) != INVALID:
            values.append(value)
    if not values:
        return installed.label, (*(INVALID,) * 4, 0.0, 1.0)
    mean = math.fsum(values) / len(values)
    deviation = math.sqrt(math.fsum((value - mean) ** 2 for value in values) / max(1, len(values) - 1))
    return installed.label, (current, min(values), max(values), mean, deviation, float(len(values)))


# --- declarations


def measurement(
    name: str, of: Callable[[MeasuredTrace], float | None], prepare: Preparation | None = None
) -> scpi.Command:
    """Declare `:MEASure:<name> [<source>]` (install) and `:MEASure:<name>? [<source>]`."""
    return scpi.Command(
        f"MEASure:{name}",
        (declarations.OPTIONAL_SOURCE,),
        do=lambda model, source: install(model, name, (source,), of, prepare),
        query=lambda model, source: measured(model, source, of, prepare),
        query_parameters=(declarations.OPTIONAL_SOURCE,),
    )


def averaging(name: str, of: Callable[[MeasuredTrace, set[str]], float | None]) -> scpi.Command:
    """Declare VAVerage or VRMS, whose words before the source are all optional."""

    def sorted_out(words: tuple[str | None, ...]) -> tuple[str | None, set[str], Preparation | None]:
        given = {word for word in words if word is not None}
        source = next((word for word in given if word.startswith(("CHAN", "FUNC"))), None)
        return source, given, None if "DISP" in given and "CYCL" not in given else EDGES

    def read(model: SimulatedDso7104B, *words: str | None) -> Any:
        source, given, prepare = sorted_out(words)
        return measured(model, source, lambda trace: of(trace, given), prepare)

    def put(model: SimulatedDso7104B, *words: str | None) -> None:
        source, given, prepare = sorted_out(words)
        install(model, name, (source,), lambda trace: of(trace, given), prepare)

    words = (_Averaging(required=False),) * 3
    return scpi.Command(f"MEASure:{name}", words, do=put, query=read, query_parameters=words)


def _of_cycle(trace: MeasuredTrace, words: set[str]) -> bool:
    """Return True if one cycle is meant: by default where there is one on the screen (5000 series guide: AUTO)."""
    return "CYCL" in words or ("DISP" not in words and trace.period() is not None)


def _pair_measurement(
    name: str, of: Callable[[MeasuredTrace, MeasuredTrace], float | None], prepare: Preparation | None = None
) -> scpi.Command:
    return scpi.Command(
        f"MEASure:{name}",
        (declarations.OPTIONAL_SOURCE, declarations.OPTIONAL_SOURCE),
        do=lambda model, *sources: install(model, name, sources, of, prepare),
        query=lambda model, first, second: _measured_pair(model, first, second, of, prepare),
        query_parameters=(declarations.OPTIONAL_SOURCE, declarations.OPTIONAL_SOURCE),
    )


def _delay(model: SimulatedDso7104B, first: str | None, second: str | None) -> Any:
    edges = model.state.measure.delay_edges
    return _measured_pair(model, first, second, lambda one, two: one.delay_to(two, *edges), EDGES)


def _ratio_db(one: MeasuredTrace, two: MeasuredTrace) -> float | None:
    first, second = one.rms(cycle=False, ac=True), two.rms(cycle=False, ac=True)
    return 20.0 * math.log10(first / second) if first and second else None


# --- settings


def _definition(model: SimulatedDso7104B, what: str, source: str | None = None) -> str:
    """Return a definition; the standard thresholds as their percentages (from memory, unverified)."""
    del source
    if what == "DEL":
        return ",".join(("DEL", *map(scpi.signed_integer, model.state.measure.delay_edges)))
    kind, *numbers = model.state.measure.thresholds
    return ",".join(("THR", "PERC" if kind == "STAN" else kind, *map(model.nr3, numbers)))


def _threshold_definition(model: SimulatedDso7104B, values: tuple[Any, ...]) -> tuple[str, float, float, float]:
    if values == ("STAN",):
        return "STAN", 90.0, 50.0, 10.0
    kind, numbers = (values[0], values[1:]) if isinstance(values[0], str) else ("PERC", values)
    if kind == "STAN" or len(numbers) != 3 or any(isinstance(number, str) for number in numbers):
        raise scpi.ScpiError(-109 if len(numbers) < 3 else -224)
    upper, middle, lower = numbers
    if kind == "PERC":
        upper, middle, lower = (declarations.clipped(model, number, 5.0, 95.0) for number in numbers)
    if not lower < middle < upper:
        raise scpi.ScpiError(-221)
    return kind, upper, middle, lower


def counted(model: SimulatedDso7104B, source: str | None) -> Any:
    """Return the count of the hardware counter at the end of its gate; it looks at channels alone."""
    name = source or model.state.measure.sources[0]
    if name == "FUNC" or not model.state.is_shown(name):
        return model.nr3(INVALID)
    return model.count(int(name[4:]))


def _edge_number(value: float) -> int:
    if value != int(value) or not value:
        raise scpi.ScpiError(-224)
    return int(value)


@ROWS.query("MEASure:TEDGe", query_parameters=(scpi.Number(), declarations.OPTIONAL_SOURCE))
def _edge_time(model: SimulatedDso7104B, number: float, source: str | None) -> Any:
    return measured(model, source, lambda trace: trace.time_of_edge(_edge_number(number)), EDGES)


@ROWS.query("MEASure:TVALue", query_parameters=(declarations.VOLTS, scpi.Number(), declarations.OPTIONAL_SOURCE))
def _value_time(model: SimulatedDso7104B, level: float, number: float, source: str | None) -> Any:
    return measured(model, source, lambda trace: trace.time_of_value(level, _edge_number(number)))


@ROWS.query("MEASure:VTIMe", query_parameters=(declarations.SECONDS, declarations.OPTIONAL_SOURCE))
def _value_at(model: SimulatedDso7104B, seconds: float, source: str | None) -> Any:
    return measured(model, source, lambda trace: trace.voltage_at(seconds))


def _sources(model: SimulatedDso7104B) -> str:
    return ",".join(model.state.measure.sources)


@ROWS.do("MEASure:SOURce", (declarations.SOURCE, declarations.OPTIONAL_SOURCE), query=_sources, reads=True)
def _set_sources(model: SimulatedDso7104B, first: str, second: str | None) -> None:
    model.state.measure.sources = (first, second or model.state.measure.sources[1])


@ROWS.do(
    "MEASure:DEFine",
    (scpi.Choice(("THResholds", "DELay")), _Definition()),
    query=_definition,
    query_parameters=(scpi.Choice(("THResholds", "DELay")), declarations.OPTIONAL_SOURCE),
    repeat=True,
)
def _define(model: SimulatedDso7104B, what: str, *values: Any) -> None:
    """Take `DEFine THResholds,...` or `DEFine DELay,...`."""
    if what == "DEL":
        if len(values) != 2 or not all(isinstance(value, float) and value for value in values):
            raise scpi.ScpiError(-109 if len(values) < 2 else -224)
        first, second = values
        model.state.measure.delay_edges = int(first), int(second)
    else:
        model.state.measure.thresholds = _threshold_definition(model, values)
    model.shown.forget_traces()


@ROWS.do(
    "MEASure:DELay",
    (declarations.OPTIONAL_SOURCE, declarations.OPTIONAL_SOURCE),
    query=_delay,
    query_parameters=(declarations.OPTIONAL_SOURCE, declarations.OPTIONAL_SOURCE),
)
def _install_delay(model: SimulatedDso7104B, *sources: str | None) -> None:
    install(model, "DELay", sources, lambda one, two: one.delay_to(two, *model.state.measure.delay_edges), EDGES)


MEASURE_COMMANDS = (
    *ROWS,
    scpi.Command("MEASure", query=lambda model: f":MEAS:SOUR {_sources(model)}", reads=True),
    scpi.attribute("MEASure:SHOW", scpi.Boolean(), "state.measure.shown", scpi.boolean),
    scpi.attribute(
        "MEASure:STATistics",
        scpi.Choice(("ON", "CURRent", "MINimum", "MAXimum", "MEAN", "STDDev", "COUNt")),
        "state.measure.statistics",
    ),
    measurement("VPP", MeasuredTrace.peak_to_peak),
    measurement("VMAX", MeasuredTrace.maximum),
    measurement("VMIN", MeasuredTrace.minimum),
    measurement("VAMPlitude", MeasuredTrace.amplitude, MeasuredTrace.leveling),
    measurement("VTOP", MeasuredTrace.top, MeasuredTrace.leveling),
    measurement("VBASe", MeasuredTrace.base, MeasuredTrace.leveling),
    averaging("VAVerage", lambda trace, words: trace.average(cycle=_of_cycle(trace, words))),
    averaging("VRMS", lambda trace, words: trace.rms(cycle=_of_cycle(trace, words), ac="AC" in words)),
    measurement("SDEViation", lambda trace: trace.rms(cycle=False, ac=True)),
    measurement("OVERshoot", MeasuredTrace.overshoot, MeasuredTrace.leveling),
    measurement("PREShoot", MeasuredTrace.preshoot, MeasuredTrace.leveling),
    measurement("FREQuency", MeasuredTrace.frequency, EDGES),
    measurement("PERiod", MeasuredTrace.period, EDGES),
    scpi.Command(
        "MEASure:COUNter",
        (declarations.OPTIONAL_SOURCE,),
        do=lambda model, source: install(model, "COUNter", (source,), MeasuredTrace.mean_frequency, EDGES),
        query=counted,
        query_parameters=(declarations.OPTIONAL_SOURCE,),
    ),
    measurement("RISetime", MeasuredTrace.rise_time, EDGES),
    measurement("FALLtime", MeasuredTrace.fall_time, EDGES),
    measurement("PWIDth", MeasuredTrace.positive_width, EDGES),
    measurement("NWIDth", MeasuredTrace.negative_width, EDGES),
    measurement("DUTYcycle", MeasuredTrace.duty_cycle, EDGES),
    measurement("XMAX", MeasuredTrace.time_of_maximum),
    measurement("XMIN", MeasuredTrace.time_of_minimum),
    _pair_measurement("PHASe", lambda one, two: one.phase_to(two), EDGES),
    _pair_measurement("VRATio", _ratio_db),
)
"""What is said to :MEASure."""
