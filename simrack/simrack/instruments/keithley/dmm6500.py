"""Simulated Keithley DMM6500 set to SCPI: a 34401A's inputs behind its words, trigger models and reading buffer.

Source: PyMeasure's driver, whose tests hold replies of a real one, and other users' code. Unverified: the form of
numbers but for theirs, error texts, which of the words of the trigger model wait.

Not simulated: the command set TSP (``*LANG`` would count from the next power-on), other buffers than
defbuffer1, digitising, current, temperature, capacitance, the scanner, trigger models but SimpleLoop; averaging and
relative values are settings, taken off no reading.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, Any, ClassVar

from simrack import scpi, specifications
from simrack.instruments.hp34401a.imperfections import MeterErrors
from simrack.instruments.keithley import common
from simrack.instruments.truevolt.instrument import SimulatedTruevolt
from simrack.instruments.truevolt.kinds import MeterKind

if TYPE_CHECKING:
    from collections.abc import Mapping

    import numpy as np

    from simrack.instruments.hp34401a.functions import Function
    from simrack.scpi import Interface

ROWS = scpi.Rows()
"""Rows that stand on their handlers."""

_SHEET = specifications.KEITHLEY_DMM6500
_BUFFER = 100_000
_FUNCTIONS = common.functions_of(_SHEET)
_DEFAULT = "defbuffer1"


# Format a reading: no plus sign, seven digits as they come (unverified)
_READINGS = scpi.comma_list(lambda value: f"{value:.6E}")


class Errors6500(MeterErrors, frozen=True):
    """Imperfections of a DMM6500: those of a 34401A, in direct voltage drawn from its own data sheet."""

    @classmethod
    def drawn(cls, rng: np.random.Generator) -> Errors6500:
        """Return a specimen drawn uniformly within the 1-year accuracy of the 10 V range."""
        return cls(**common.drawn(_SHEET, rng))


def _require_buffer(buffer: str | None) -> None:
    if buffer is not None and buffer != _DEFAULT:
        raise scpi.ScpiError(-224)


def _take(meter: KeithleyDMM6500Twin, buffer: str | None) -> None:
    _require_buffer(buffer)
    meter.triggering.trigger_count = 1.0
    meter.triggering.sample_count = meter.samples
    meter.triggering.delay_auto = True
    meter.triggering.start(stored=True)


def _read(meter: KeithleyDMM6500Twin, buffer: str | None) -> Any:
    _take(meter, buffer)
    return common.once_idle(meter, lambda: _last(meter))


def _measure(name: str) -> Any:
    def measure(meter: KeithleyDMM6500Twin, buffer: str | None) -> Any:
        meter.choose(meter.functions[name])
        return _read(meter, buffer)

    return measure


def _last(meter: KeithleyDMM6500Twin) -> list[float]:
    if not meter.stored:
        raise scpi.ScpiError(-230)
    return [meter.stored[-1]]


def _data(meter: KeithleyDMM6500Twin, start: int, end: int, buffer: str | None, element: str | None) -> list[float]:
    _require_buffer(buffer)
    del element
    if not 1 <= start <= end <= len(meter.stored):
        raise scpi.ScpiError(-222)
    return meter.stored[start - 1 : end]


@ROWS.do(
    "TRIGger:LOAD",
    (
        *(scpi.Text(), scpi.Integer(limits=scpi.Limits(1, 268_435_455), named=False)),
        *(scpi.Number(unit="S", limits=scpi.Limits(0.0, 10_000.0), required=False), scpi.Text(required=False)),
    ),
)
def _load(meter: KeithleyDMM6500Twin, model: str, count: int, delay_s: float | None, buffer: str | None) -> None:
    _require_buffer(buffer)
    if model.upper() != "SIMPLELOOP":
        raise scpi.ScpiError(-224)
    meter.loop = (count, delay_s or 0.0)


@ROWS.do("INITiate[:IMMediate]")
def _initiate(meter: KeithleyDMM6500Twin) -> None:
    if meter.loop is None:
        raise scpi.ScpiError(-221)
    count, delay_s = meter.loop
    meter.triggering.sample_count, meter.triggering.trigger_count = 1, float(count)
    meter.triggering.delay_s, meter.triggering.delay_auto = delay_s, False
    meter.triggering.start(stored=True)


def _choose(meter: KeithleyDMM6500Twin, name: str) -> None:
    known = common.spelled(name)
    if known not in common.NAMES:
        raise scpi.ScpiError(-224)
    meter.choose(meter.functions[known])


def _zero(name: str) -> scpi.Command:
    return scpi.Command(
        f"[SENSe:]{_FUNCTIONS[name].header}:AZERo[:STATe]",
        (scpi.Boolean(),),
        do=lambda meter, state: meter.set_autozero(name, on=bool(state)),
        query=lambda meter: meter.autozeroes(name),
        reply=scpi.boolean,
    )


_NAMED = (scpi.Text(required=False),)


@ROWS.query("FETCh", query_parameters=_NAMED, reply=_READINGS)
def _fetch(meter: KeithleyDMM6500Twin, buffer: str | None) -> list[float]:
    _require_buffer(buffer)
    return _last(meter)


@ROWS.do("TRACe:TRIGger", _NAMED)
def _trace(meter: KeithleyDMM6500Twin, buffer: str | None) -> Any:
    """TRACe:TRIGger: make readings; later commands wait for them."""
    _take(meter, buffer)
    return common.once_idle(meter, lambda: None)


@ROWS.do("TRACe:CLEar", _NAMED)
def _clear(meter: KeithleyDMM6500Twin, buffer: str | None) -> None:
    _require_buffer(buffer)
    meter.stored.clear()


_TABLE = scpi.CommandTable(
    *ROWS,
    *scpi.COMMON_COMMANDS,
    scpi.Command("*LANG", (scpi.Choice(("SCPI", "TSP")),), do=common.ignored, query=lambda meter: meter.command_set),
    scpi.Command(
        "[SENSe:]FUNCtion[:ON]",
        (scpi.Text(),),
        do=_choose,
        query=lambda m: common.NAMES[m.function.name],
        reply=scpi.quoted,
    ),
    *common.settings_of_functions(_FUNCTIONS, (0.0005, 12.0), "RELative"),
    *(_zero(name) for name in ("VOLT", "RES", "FRES")),
    *(
        scpi.attribute(
            f"DISPlay:{_FUNCTIONS[name].header}:DIGits",
            scpi.Integer(limits=scpi.Limits(3, 6)),
            f"kept[{name}].digits",
            scpi.signed_integer,
        )
        for name in common.NAMES
    ),
    scpi.Command("[SENSe:]AZERo:ONCE", do=common.ignored),
    scpi.attribute("[SENSe:]COUNt", scpi.Integer(limits=scpi.Limits(1, 1_000_000)), "samples", scpi.signed_integer),
    *(
        scpi.Command(
            f"MEASure:{_FUNCTIONS[name].header}", query=_measure(name), query_parameters=_NAMED, reply=_READINGS
        )
        for name in common.NAMES
    ),
    scpi.Command("READ", query=_read, query_parameters=_NAMED, reply=_READINGS),
    scpi.Command(
        "TRACe:DATA",
        query=_data,
        query_parameters=(
            *(scpi.Integer(limits=scpi.Limits(1, _BUFFER), named=False) for _ in range(2)),
            *(scpi.Text(required=False), scpi.Choice(("READing",), required=False)),
        ),
        reply=_READINGS,
    ),
    scpi.Command("TRACe:ACTual", query=lambda meter, _buffer: len(meter.stored), query_parameters=_NAMED, reply=str),
    scpi.attribute("TRACe:POINts", scpi.Integer(limits=scpi.Limits(10, 7_000_000)), "points", scpi.signed_integer),
    scpi.Command("ABORt", do=lambda meter: meter.triggering.abort()),
    scpi.attribute("FORMat[:DATA]", scpi.Choice(("ASCii",)), "format"),
    scpi.Command("ROUTe:TERMinals", query=lambda _: "FRON"),
    scpi.Command("SYSTem:LFRequency", query=lambda meter: str(meter.line_hz)),
    scpi.Command("SYSTem:BEEPer[:IMMediate]", (scpi.Number(), scpi.Number()), do=common.ignored),
    scpi.Command("SYSTem:ERRor:NEXT", query=scpi.next_error),
    scpi.Command("SYSTem:CLEar", do=lambda meter: meter.engine.errors.clear()),
    scpi.Command("SYSTem:VERSion", query=lambda _: "1999.0"),
    scpi.Command("DISPlay:CLEar", do=common.ignored),
    scpi.Command("DISPlay:SCReen", (scpi.Word(),), do=common.ignored),
    *(scpi.Command(f"DISPlay:USER{line}:TEXT[:DATA]", (scpi.Text(),), do=common.ignored) for line in (1, 2)),
    scpi.Command("*TST", query=lambda _: "0", query_takes_s=2.0),
    scpi.event("STATus:OPERation[:EVENt]", lambda meter: meter.operation),
    scpi.enable("STATus:OPERation:ENABle", "operation"),
    scpi.event("STATus:QUEStionable[:EVENt]", lambda meter: meter.questionable),
    scpi.condition("STATus:QUEStionable:CONDition", lambda meter: meter.questionable),
    scpi.enable("STATus:QUEStionable:ENABle", "questionable"),
    scpi.Command("STATus:PRESet", do=common.ignored),
)


class KeithleyDMM6500Twin(SimulatedTruevolt):
    """The meter; arguments as of the 34401A."""

    errors_class: ClassVar = Errors6500
    kind: ClassVar[MeterKind] = MeterKind("DMM6500", "1.7.12b", _SHEET, memory=_BUFFER, most_readings=1_000_000)
    functions: ClassVar[Mapping[str, Function]] = _FUNCTIONS
    table: ClassVar[scpi.CommandTable] = _TABLE
    dialect: ClassVar[scpi.Dialect] = scpi.Dialect(queue_depth=64, takes_blocks=False)
    interfaces: ClassVar[Mapping[str, Interface]] = {"gpib": scpi.GPIB, "usb": scpi.USB, "lan": scpi.LAN}
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
        self.kept = {name: common.KeptOfFunction(average=False, digits=6) for name in common.NAMES}
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
