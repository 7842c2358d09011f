"""Simulated Keithley DMM6500 set to SCPI: a 34401A's inputs behind its words, trigger models and reading buffer.

Source: PyMeasure's driver, whose tests hold replies of a real one, and other users' code. Unverified: the form of
numbers but for theirs, error texts, which of the words of the trigger model wait.

Not simulated: the command set TSP (``*LANG`` would count from the next power-on), other buffers than
defbuffer1, digitising, current, temperature, capacitance, the scanner, trigger models but SimpleLoop; averaging and
relative values are settings, taken off no reading.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, Any, ClassVar

from simrack import specifications
from simrack.instruments.hp34401a.imperfections import MeterErrors
from simrack.instruments.keithley.common import (
    NAMES,
    KeptOfFunction,
    drawn,
    functions_of,
    ignored,
    once_idle,
    settings_of_functions,
    spelled,
)
from simrack.instruments.truevolt.instrument import SimulatedTruevolt
from simrack.instruments.truevolt.kinds import MeterKind
from simrack.scpi import (
    COMMON_COMMANDS,
    GPIB,
    LAN,
    USB,
    Boolean,
    Choice,
    Command,
    CommandTable,
    Dialect,
    Integer,
    Limits,
    Number,
    ScpiError,
    Text,
    Word,
    attribute,
    boolean,
    comma_list,
    condition,
    enable,
    event,
    next_error,
    quoted,
    signed_integer,
)

if TYPE_CHECKING:
    from collections.abc import Mapping

    import numpy as np

    from simrack.instruments.hp34401a.functions import Function
    from simrack.scpi import Interface

_SHEET = specifications.KEITHLEY_DMM6500
_BUFFER = 100_000
_FUNCTIONS = functions_of(_SHEET)
_DEFAULT = "defbuffer1"


def _bare(value: float) -> str:
    """Format a reading: no plus sign, seven digits as they come (unverified)."""
    return f"{value:.6E}"


_READINGS = comma_list(_bare)


class Errors6500(MeterErrors, frozen=True):
    """Imperfections of a DMM6500: those of a 34401A, in direct voltage drawn from its own data sheet."""

    @classmethod
    def drawn(cls, rng: np.random.Generator) -> Errors6500:
        """Return a specimen drawn uniformly within the 1-year accuracy of the 10 V range."""
        return cls(**drawn(_SHEET, rng))


def _require_buffer(buffer: str | None) -> None:
    if buffer is not None and buffer != _DEFAULT:
        raise ScpiError(-224)


def _take(meter: KeithleyDMM6500Twin, buffer: str | None) -> None:
    _require_buffer(buffer)
    meter.triggering.trigger_count = 1.0
    meter.triggering.sample_count = meter.samples
    meter.triggering.delay_auto = True
    meter.triggering.start(stored=True)


def _trace(meter: KeithleyDMM6500Twin, buffer: str | None) -> Any:
    """TRACe:TRIGger: make readings; later commands wait for them."""
    _take(meter, buffer)
    return once_idle(meter, lambda: None)


def _read(meter: KeithleyDMM6500Twin, buffer: str | None) -> Any:
    _take(meter, buffer)
    return once_idle(meter, lambda: _last(meter))


def _measure(name: str) -> Any:
    def measure(meter: KeithleyDMM6500Twin, buffer: str | None) -> Any:
        meter.choose(meter.functions[name])
        return _read(meter, buffer)

    return measure


def _last(meter: KeithleyDMM6500Twin) -> list[float]:
    if not meter.stored:
        raise ScpiError(-230)
    return [meter.stored[-1]]


def _fetch(meter: KeithleyDMM6500Twin, buffer: str | None) -> list[float]:
    _require_buffer(buffer)
    return _last(meter)


def _data(meter: KeithleyDMM6500Twin, start: int, end: int, buffer: str | None, element: str | None) -> list[float]:
    _require_buffer(buffer)
    del element
    if not 1 <= start <= end <= len(meter.stored):
        raise ScpiError(-222)
    return meter.stored[start - 1 : end]


def _clear(meter: KeithleyDMM6500Twin, buffer: str | None) -> None:
    _require_buffer(buffer)
    meter.stored.clear()


def _load(meter: KeithleyDMM6500Twin, model: str, count: int, delay_s: float | None, buffer: str | None) -> None:
    _require_buffer(buffer)
    if model.upper() != "SIMPLELOOP":
        raise ScpiError(-224)
    meter.loop = (count, delay_s or 0.0)


def _initiate(meter: KeithleyDMM6500Twin) -> None:
    if meter.loop is None:
        raise ScpiError(-221)
    count, delay_s = meter.loop
    meter.triggering.sample_count, meter.triggering.trigger_count = 1, float(count)
    meter.triggering.delay_s, meter.triggering.delay_auto = delay_s, False
    meter.triggering.start(stored=True)


def _choose(meter: KeithleyDMM6500Twin, name: str) -> None:
    known = spelled(name)
    if known not in NAMES:
        raise ScpiError(-224)
    meter.choose(meter.functions[known])


def _zero(name: str) -> Command:
    return Command(
        f"[SENSe:]{_FUNCTIONS[name].header}:AZERo[:STATe]",
        (Boolean(),),
        do=lambda meter, state: meter.set_autozero(name, on=bool(state)),
        query=lambda meter: meter.autozeroes(name),
        reply=boolean,
    )


_NAMED = (Text(required=False),)

_TABLE = CommandTable(
    *COMMON_COMMANDS,
    Command("*LANG", (Choice(("SCPI", "TSP")),), do=ignored, query=lambda meter: meter.command_set),
    Command("[SENSe:]FUNCtion[:ON]", (Text(),), do=_choose, query=lambda m: NAMES[m.function.name], reply=quoted),
    *settings_of_functions(_FUNCTIONS, (0.0005, 12.0), "RELative"),
    *(_zero(name) for name in ("VOLT", "RES", "FRES")),
    *(
        attribute(
            f"DISPlay:{_FUNCTIONS[name].header}:DIGits",
            Integer(limits=Limits(3, 6)),
            f"kept[{name}].digits",
            signed_integer,
        )
        for name in NAMES
    ),
    Command("[SENSe:]AZERo:ONCE", do=ignored),
    attribute("[SENSe:]COUNt", Integer(limits=Limits(1, 1_000_000)), "samples", signed_integer),
    *(
        Command(f"MEASure:{_FUNCTIONS[name].header}", query=_measure(name), query_parameters=_NAMED, reply=_READINGS)
        for name in NAMES
    ),
    Command("READ", query=_read, query_parameters=_NAMED, reply=_READINGS),
    Command("FETCh", query=_fetch, query_parameters=_NAMED, reply=_READINGS),
    Command("TRACe:TRIGger", _NAMED, do=_trace),
    Command(
        "TRACe:DATA",
        query=_data,
        query_parameters=(
            *(Integer(limits=Limits(1, _BUFFER), named=False) for _ in range(2)),
            *(Text(required=False), Choice(("READing",), required=False)),
        ),
        reply=_READINGS,
    ),
    Command("TRACe:CLEar", _NAMED, do=_clear),
    Command("TRACe:ACTual", query=lambda meter, _buffer: len(meter.stored), query_parameters=_NAMED, reply=str),
    attribute("TRACe:POINts", Integer(limits=Limits(10, 7_000_000)), "points", signed_integer),
    Command(
        "TRIGger:LOAD",
        (
            *(Text(), Integer(limits=Limits(1, 268_435_455), named=False)),
            *(Number(unit="S", limits=Limits(0.0, 10_000.0), required=False), Text(required=False)),
        ),
        do=_load,
    ),
    Command("INITiate[:IMMediate]", do=_initiate),
    Command("ABORt", do=lambda meter: meter.triggering.abort()),
    attribute("FORMat[:DATA]", Choice(("ASCii",)), "format"),
    Command("ROUTe:TERMinals", query=lambda _: "FRON"),
    Command("SYSTem:LFRequency", query=lambda meter: str(meter.line_hz)),
    Command("SYSTem:BEEPer[:IMMediate]", (Number(), Number()), do=ignored),
    Command("SYSTem:ERRor:NEXT", query=next_error),
    Command("SYSTem:CLEar", do=lambda meter: meter.engine.errors.clear()),
    Command("SYSTem:VERSion", query=lambda _: "1999.0"),
    Command("DISPlay:CLEar", do=ignored),
    Command("DISPlay:SCReen", (Word(),), do=ignored),
    *(Command(f"DISPlay:USER{line}:TEXT[:DATA]", (Text(),), do=ignored) for line in (1, 2)),
    Command("*TST", query=lambda _: "0", query_takes_s=2.0),
    event("STATus:OPERation[:EVENt]", lambda meter: meter.operation),
    enable("STATus:OPERation:ENABle", "operation"),
    event("STATus:QUEStionable[:EVENt]", lambda meter: meter.questionable),
    condition("STATus:QUEStionable:CONDition", lambda meter: meter.questionable),
    enable("STATus:QUEStionable:ENABle", "questionable"),
    Command("STATus:PRESet", do=ignored),
)


class KeithleyDMM6500Twin(SimulatedTruevolt):
    """The meter; arguments as of the 34401A."""

    errors_class: ClassVar = Errors6500
    kind: ClassVar[MeterKind] = MeterKind("DMM6500", "1.7.12b", _SHEET, memory=_BUFFER, most_readings=1_000_000)
    functions: ClassVar[Mapping[str, Function]] = _FUNCTIONS
    table: ClassVar[CommandTable] = _TABLE
    dialect: ClassVar[Dialect] = Dialect(queue_depth=64, takes_blocks=False)
    interfaces: ClassVar[Mapping[str, Interface]] = {"gpib": GPIB, "usb": USB, "lan": LAN}
    fast_apertures_s: ClassVar[Mapping[float, float]] = {}

    def __init__(
        self,
        world: Any,
        *,
        node: str = "output",
        errors: MeterErrors,
        mains_hz: float = 50.0,
        interface: str = "usb",
        model: str | None = None,
        command_set: str = "SCPI",
    ) -> None:
        self.command_set = command_set
        super().__init__(world, node=node, errors=errors, mains_hz=mains_hz, interface=interface, model=model)

    def identity(self) -> str:
        """Return the reply of a real unit (users' record), but for the model that it stands for."""
        return f"KEITHLEY INSTRUMENTS,MODEL {self._model},04592448,{self.kind.firmware}"

    def reset(self) -> None:
        """*RST."""
        self.kept = {name: KeptOfFunction(average=False, digits=6) for name in NAMES}
        self.samples, self.points, self.format = 1, _BUFFER, "ASC"
        self.stored: list[float] = []
        self.loop: tuple[int, float] | None = None
        super().reset()

    def forget(self) -> None:
        """A setting changes: the measurement ends."""
        self.triggering.abort()

    def _finish_reading(self, value: float) -> float:
        reading = super()._finish_reading(value)
        self.stored.append(reading)
        return reading
