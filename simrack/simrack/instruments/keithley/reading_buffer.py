"""Reading buffer of the simulated DMM6500: what fills it, and its words (sources as of `dmm6500`)."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from datetime import datetime, timedelta
from functools import partial
from statistics import fmean, stdev
from typing import Any

import numpy as np
from msgspec import Struct

from simrack import scpi
from simrack.instruments.hp34401a.functions import Function
from simrack.instruments.hp34401a.inputs import MeterReading
from simrack.instruments.keithley import common
from simrack.instruments.truevolt.measuring_commands import once_idle

ROWS = scpi.Rows()

SAMPLE_RATES_HZ = scpi.Limits(1e3, 1e6, 1e6)
PRECISION = ("FORMat:ASCii:PRECision",)
_BUFFER = 100_000
_MOST_SAMPLES = 1_000_000
"""Of one run that are kept; a real one keeps 7 million, for which this computer would need a gigabyte."""
_FORMAT, _ORDER = ("FORMat[:DATA]",), ("FORMat:BORDer",)
_BINARY = {"REAL": "f8", "SREAL": "f4"}
_BEGUN = datetime(2026, 1, 1)  # noqa: DTZ001  (the meter knows no zone)


class Sampling(Struct):
    """Settings of a function that digitises; the longest aperture fills the interval (default of the range unverified).

    `aperture_s` is None for AUTO.
    """

    range: float
    rate_hz: float = SAMPLE_RATES_HZ.maximum
    aperture_s: float | None = None
    high_impedance: bool = False


class BufferingMeter(common.SimulatedKeithley):
    """A meter whose readings go to a buffer: those of its function, or samples of a digitising one."""

    def reset(self) -> None:
        """*RST."""
        self.samples, self.digitize_count, self.points, self.fill = 1, 100, _BUFFER, "CONT"
        self.digitizing = "NONE"
        self.samplings = {"VOLT": Sampling(10.0), "CURR": Sampling(1.0)}
        self.stored: list[tuple[float, float]] = []
        """Readings and the bench times at which they were made."""
        self.made: dict[str, int] = {}
        super().reset()

    @property
    def count(self) -> int:
        """Number of readings, or samples, that are set."""
        return self.samples if self.digitizing == "NONE" else self.digitize_count

    def begin(self, count: int, **more: float) -> None:
        """Begin so many readings, or samples."""
        if self.digitizing != "NONE" and min(count, self.points) > _MOST_SAMPLES:
            raise scpi.ScpiError(-225)
        self.batch = count
        self.triggering.trigger_count = 1.0
        self.triggering.sample_count = count if self.digitizing == "NONE" else 1
        self.triggering.delay_auto = True
        self.triggering.start(stored=True, **more)

    def choose_digitizing(self, name: str) -> None:
        """Go to a digitising function."""
        self.choose(self.functions[name])
        self.digitizing = name

    def choose(self, function: Function) -> None:
        """Go to a function that measures, which ends digitising."""
        self.digitizing = "NONE"
        super().choose(function)

    def _begin_reading(self, start_s: float) -> MeterReading:
        if self.digitizing == "NONE":
            return super()._begin_reading(start_s)
        own = self.samplings[self.digitizing]
        first = max(0, self.batch - self.points) if self.fill == "CONT" else 0
        times = (
            start_s,
            1.0 / own.rate_hz,
            range(first, self.batch),
        )  # those that the buffer does not keep are not drawn
        return self.inputs.digitised(self.function, times, own.range, self._store, high_impedance=own.high_impedance)

    def _finish_reading(self, value: float) -> float:
        reading = super()._finish_reading(value) if self.digitizing == "NONE" else self.read_at_terminals(value)
        self._store([(reading, self.clock.now())])
        return reading

    def _store(self, readings: Sequence[tuple[float, float]]) -> None:
        self.stored += readings if self.fill == "CONT" else readings[: max(0, self.points - len(self.stored))]
        del self.stored[: -self.points]


NAMED = (scpi.Text(required=False),)
_BUFFERS = ("defbuffer1", "defbuffer2")
ELEMENTS = scpi.Choice(("READing", "RELative", "UNIT", "TSTamp", "SECFractional", "CHANnel", "STATus"), required=False)
"""Of those that the manual lists; the others are -141."""


def formatted(meter: BufferingMeter, entries: Sequence[tuple[float, float]], elements: tuple[str, ...]) -> str | bytes:
    """Return readings with the elements asked for; time counts from the first of the buffer (forms unverified).

    Binary ones have ``#0`` before them, and can be no more than readings and times: 1133 (DMM7510 manual, p. 6-50).
    """
    begun_s = meter.stored[0][1] if meter.stored else 0.0
    if (kind := _BINARY.get(meter.engine.remembered.get(_FORMAT, "ASC"))) is not None:
        if not {"READ", "REL"}.issuperset(elements):
            raise scpi.ScpiError(1133, "Syntax error, expected valid name parameters")
        order = ">" if meter.engine.remembered.get(_ORDER) == "NORM" else "<"
        rows = [
            [value if name == "READ" else at_s - begun_s for name in elements or ("READ",)] for value, at_s in entries
        ]
        return b"#0" + np.array(rows, dtype=order + kind).tobytes()

    def element(name: str, value: float, instant_s: float) -> str:
        match name:
            case "READ":
                return f"{value:.{(meter.engine.remembered.get(PRECISION, 0) or 7) - 1}E}"
            case "UNIT":
                return {"V": "Volt", "A": "Amp", "OHM": "Ohm", "HZ": "Hertz", "S": "Second"}.get(
                    meter.function.unit, ""
                )
            case "TST":
                return stamp(instant_s)
            case "SECF":
                return f"{instant_s % 1.0:.9f}"
        return {"REL": f"{instant_s - begun_s:.6f}", "CHAN": "0", "STAT": "0"}[name]

    return ",".join(element(name, *entry) for entry in entries for name in elements or ("READ",))


def stamp(instant_s: float) -> str:
    """Return a bench time as the clock of a meter shows it that was switched on at the beginning of 2026."""
    return date(instant_s).strftime("%Y/%m/%d %H:%M:%S.%f")[:-3]


def date(instant_s: float) -> datetime:
    """Return a bench time as a day of that clock."""
    return _BEGUN + timedelta(seconds=instant_s)


def require_buffer(meter: BufferingMeter, buffer: str | None) -> None:
    """Refuse a buffer that does not exist (-224)."""
    if buffer is not None and buffer not in (*_BUFFERS, *meter.made):
        raise scpi.ScpiError(-224)


def take(meter: BufferingMeter, buffer: str | None, *, digitizing: bool = False) -> None:
    """Begin a measurement of as many readings as are set; -221 where the function is none of that kind."""
    require_buffer(meter, buffer)
    if (meter.digitizing != "NONE") is not digitizing:
        raise scpi.ScpiError(-221)
    meter.begin(meter.count)


@ROWS.query("READ", query_parameters=(*NAMED, ELEMENTS), repeat=True)
def read(meter: BufferingMeter, buffer: str | None = None, *elements: str) -> Any:
    """READ?: make readings, and return the last."""
    take(meter, buffer)
    return once_idle(meter, lambda: last(meter, elements))


@ROWS.query("READ:DIGitize", query_parameters=(*NAMED, ELEMENTS), repeat=True)
def read_digitized(meter: BufferingMeter, buffer: str | None = None, *elements: str) -> Any:
    """READ:DIGitize?: take samples, and return the last."""
    take(meter, buffer, digitizing=True)
    return once_idle(meter, lambda: last(meter, elements))


def last(meter: BufferingMeter, elements: tuple[str, ...]) -> str | bytes:
    """Return the last reading of the buffer (-230 where there is none)."""
    if not meter.stored:
        raise scpi.ScpiError(-230)
    return formatted(meter, meter.stored[-1:], elements)


_STATISTICS: Mapping[str, Any] = {"AVERage": fmean, "STDDev": stdev, "MAXimum": max, "MINimum": min, "PK2Pk": np.ptp}


def _statistic(of: Any, meter: BufferingMeter, buffer: str | None) -> str:
    """TRACe:STATistics: of the readings in a buffer (manual, p. 13-198 to 13-203; form unverified)."""
    require_buffer(meter, buffer)
    if not meter.stored:
        raise scpi.ScpiError(-230)
    return f"{float(of([value for value, _ in meter.stored])):.6E}"


_OF_A_BUFFER: Mapping[str, Any] = {
    "ACTual": lambda meter, _buffer: len(meter.stored),
    "ACTual:END": lambda meter, _buffer: len(meter.stored),
    "ACTual:STARt": lambda meter, _buffer: min(len(meter.stored), 1),
    **{f"STATistics:{word}": partial(_statistic, of) for word, of in _STATISTICS.items()},
}
_PLACE = scpi.Integer(limits=lambda meter: scpi.Limits(1, meter.points), named=False)


@ROWS.query("TRACe:DATA", query_parameters=(_PLACE, _PLACE, *NAMED, ELEMENTS), repeat=True)
def _data(meter: BufferingMeter, start: int, end: int, buffer: str | None = None, *elements: str) -> str | bytes:
    require_buffer(meter, buffer)
    if not 1 <= start <= end <= len(meter.stored):
        raise scpi.ScpiError(-222)
    return formatted(meter, meter.stored[start - 1 : end], elements)


@ROWS.do(
    "TRACe:MAKE", (scpi.Text(), scpi.Integer(limits=scpi.Limits(10, 7_000_000), named=False), scpi.Word(required=False))
)
def _make_buffer(meter: BufferingMeter, name: str, points: int, _style: str | None) -> None:
    meter.made[name] = points


@ROWS.query("FETCh", query_parameters=(*NAMED, ELEMENTS), repeat=True)
def _fetch(meter: BufferingMeter, buffer: str | None = None, *elements: str) -> str | bytes:
    require_buffer(meter, buffer)
    return last(meter, elements)


def _trace(meter: BufferingMeter, buffer: str | None, *, digitizing: bool) -> Any:
    """TRACe:TRIGger: make readings; later commands wait for them."""
    take(meter, buffer, digitizing=digitizing)
    return once_idle(meter, lambda: None)


ROWS += [
    scpi.remembered(_FORMAT[0], scpi.Choice(("ASCii", "REAL", "SREAL")), "ASC"),
    *(
        scpi.Command(f"TRACe:{header}", query=query, query_parameters=NAMED, reply=str)
        for header, query in _OF_A_BUFFER.items()
    ),
    scpi.Command("TRACe:DELete", (scpi.Text(),), do=lambda meter, name: meter.made.pop(name, None)),
    scpi.Command("TRACe:TRIGger", NAMED, do=partial(_trace, digitizing=False)),
    scpi.Command("TRACe:TRIGger:DIGitize", NAMED, do=partial(_trace, digitizing=True)),
]


@ROWS.do(
    "TRACe:POINts",
    (scpi.Integer(limits=scpi.Limits(10, 7_000_000)), *NAMED),
    query=lambda meter, _buffer: meter.points,
    query_parameters=NAMED,
    reply=scpi.signed_integer,
    reads=True,
)
def _resize(meter: BufferingMeter, points: int, buffer: str | None) -> None:
    """TRACe:POINts: a buffer of another size begins empty."""
    require_buffer(meter, buffer)
    meter.points = points
    meter.stored.clear()


@ROWS.do(
    "TRACe:FILL:MODE",
    (scpi.Choice(("CONTinuous", "ONCE")), *NAMED),
    query=lambda meter, _buffer: meter.fill,
    query_parameters=NAMED,
    reply=str,
    reads=True,
)
def _fill(meter: BufferingMeter, mode: str, buffer: str | None) -> None:
    require_buffer(meter, buffer)
    meter.fill = mode


@ROWS.do("TRACe:CLEar", NAMED)
def _clear(meter: BufferingMeter, buffer: str | None) -> None:
    require_buffer(meter, buffer)
    meter.stored.clear()
