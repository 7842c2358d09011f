"""Simulated Keithley 2000: a 34401A's inputs behind the 2000's SCPI, trigger model and buffer.

Source: PyMeasure's driver and other users' code with records of ``*IDN?``, the contents of the User's Manual
(2000-900-01) and the data sheet of the 2016. Unverified: the form of numbers, error texts, what ``*RST`` leaves of
averaging, times beside integration. From memory of the manual: continuous initiation is on at power-on and off after
``*RST`` and CONFigure, INITiate is -213 meanwhile; TRACe takes readings when its feed control is NEXT.

Not simulated: current, temperature, CALCulate, the scanner, timer and manual triggers, binary formats; averaging and
relative values are settings, taken off no reading.
"""

from __future__ import annotations

import math
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
    RS232,
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
    attribute,
    boolean,
    comma_list,
    condition,
    enable,
    event,
    next_error,
    quoted,
    real,
    signed_integer,
)

if TYPE_CHECKING:
    from collections.abc import Mapping

    import numpy as np

    from simrack.instruments.hp34401a.functions import Function
    from simrack.scpi import Interface

_SHEET = specifications.KEITHLEY_2000
_NR3 = real(8)
_READINGS = comma_list(_NR3)
_BUFFER = 1024
_FUNCTIONS = functions_of(_SHEET)


class Errors2000(MeterErrors, frozen=True):
    """Imperfections of a 2000: those of a 34401A, in direct voltage drawn from its own data sheet."""

    @classmethod
    def drawn(cls, rng: np.random.Generator) -> Errors2000:
        """Return a specimen drawn uniformly within the 1-year accuracy of the 10 V range."""
        return cls(**drawn(_SHEET, rng))


def _configure(name: str) -> Any:
    def configure(meter: Keithley2000Twin) -> None:
        meter.configure_function(name)

    return configure


def _measure(name: str) -> Any:
    def measure(meter: Keithley2000Twin) -> Any:
        meter.configure_function(name)
        return _read(meter)

    return measure


def _read(meter: Keithley2000Twin) -> Any:
    """READ?: ABORt, INITiate, FETCh?."""
    if meter.continuous:
        raise ScpiError(-213)
    meter.triggering.abort()
    meter.triggering.start(stored=True)
    return once_idle(meter, lambda: list(meter.triggering.memory))


def _initiate(meter: Keithley2000Twin) -> None:
    if meter.continuous:
        raise ScpiError(-213)
    meter.triggering.start(stored=True)


def _fetch(meter: Keithley2000Twin) -> Any:
    """FETCh?: the latest reading; while it measures by itself the next one."""
    if meter.continuous and meter.triggering.sequence is None:
        meter.triggering.start(stored=True)
        return once_idle(meter, lambda: [meter.ring.last])
    if meter.ring.last is None:
        raise ScpiError(-230)
    return [meter.ring.last]


def _choose(meter: Keithley2000Twin, name: str) -> None:
    known = spelled(name)
    if known not in NAMES:
        raise ScpiError(-224)
    meter.choose(meter.functions[known])


def _set_azero(meter: Keithley2000Twin, state: object) -> None:
    for name in NAMES:
        meter.set_autozero(name, on=bool(state))


def _count(count: float) -> str:
    return "+9.9E37" if math.isinf(count) else str(int(count))


def _set_delay(meter: Keithley2000Twin, seconds: float) -> None:
    meter.triggering.delay_s, meter.triggering.delay_auto = seconds, False


def _stored(meter: Keithley2000Twin) -> list[float]:
    if not meter.stored:
        raise ScpiError(-230)
    return list(meter.stored)


def _feed(meter: Keithley2000Twin, control: str) -> None:
    meter.control = control
    if control == "NEXT":
        meter.stored = []


def _preset(meter: Keithley2000Twin) -> None:
    meter.reset()
    meter.continuous = True


_COUNTS = Integer(limits=Limits(1, 9999, 1), words={"INFinity": float("inf")})

_TABLE = CommandTable(
    *COMMON_COMMANDS,
    *(Command(f"CONFigure:{_FUNCTIONS[name].header}", do=_configure(name)) for name in NAMES),
    *(
        Command(f"MEASure:{_FUNCTIONS[name].header}", query=_measure(name), query_parameters=(), reply=_READINGS)
        for name in NAMES
    ),
    Command("CONFigure", query=lambda meter: NAMES[meter.function.name], reply=quoted),
    Command("[SENSe:]FUNCtion", (Text(),), do=_choose, query=lambda meter: NAMES[meter.function.name], reply=quoted),
    *settings_of_functions(_FUNCTIONS, (0.01, 10.0), "REFerence"),
    *(
        attribute(
            f"[SENSe:]{_FUNCTIONS[name].header}:DIGits",
            Integer(limits=Limits(4, 7)),
            f"kept[{name}].digits",
            signed_integer,
        )
        for name in NAMES
    ),
    Command("[SENSe:]DATA[:LATest]", query=_fetch, reply=_READINGS),
    Command("[SENSe:]DATA:FRESh", query=_fetch, reply=_READINGS),
    Command("READ", query=_read, reply=_READINGS),
    Command("FETCh", query=_fetch, reply=_READINGS),
    Command("INITiate[:IMMediate]", do=_initiate),
    attribute("INITiate:CONTinuous", Boolean(), "continuous", boolean),
    Command("ABORt", do=lambda meter: meter.triggering.abort()),
    attribute("TRIGger[:SEQuence]:COUNt", _COUNTS, "triggering.trigger_count", _count, convert=float),
    attribute("SAMPle:COUNt", Integer(limits=Limits(1, _BUFFER, 1)), "triggering.sample_count", signed_integer),
    Command(
        "TRIGger[:SEQuence]:DELay",
        (Number(unit="S", limits=Limits(0.0, 999_999.999, 0.0)),),
        do=_set_delay,
        query=lambda meter: meter.delay_s(),
        reply=_NR3,
    ),
    attribute("TRIGger[:SEQuence]:DELay:AUTO", Boolean(), "triggering.delay_auto", boolean),
    attribute("TRIGger[:SEQuence]:SOURce", Choice(("IMMediate", "BUS", "EXTernal")), "triggering.source"),
    Command("*TRG", do=lambda meter: meter.triggering.fire(), urgent=True),
    Command("TRACe:CLEar", do=lambda meter: meter.stored.clear()),
    attribute("TRACe:POINts", Integer(limits=Limits(2, _BUFFER)), "points", signed_integer),
    attribute("TRACe:FEED", Choice(("SENSe", "CALCulate", "NONE")), "feed"),
    attribute("TRACe:FEED:CONTrol", Choice(("NEVer", "NEXT")), "control", do=_feed),
    Command("TRACe:DATA", query=_stored, reply=_READINGS),
    attribute("FORMat[:DATA]", Choice(("ASCii",)), "format"),
    attribute("FORMat:ELEMents", Choice(("READing",)), "elements"),
    Command(
        "SYSTem:AZERo[:STATe]", (Boolean(),), do=_set_azero, query=lambda meter: meter.autozeroes("VOLT"), reply=boolean
    ),
    Command("SYSTem:BEEPer[:IMMediate]", (Number(), Number()), do=ignored),
    attribute("SYSTem:BEEPer:STATe", Boolean(), "beeper", boolean),
    attribute("DISPlay:ENABle", Boolean(), "display_on", boolean),
    Command("SYSTem:ERRor:NEXT", query=next_error),
    Command("SYSTem:FRSWitch", query=lambda _: 1, reply=signed_integer),
    Command("SYSTem:VERSion", query=lambda _: "1991.0"),
    Command("SYSTem:PRESet", do=_preset),
    *(Command(f"SYSTem:{word}", do=ignored) for word in ("LOCal", "REMote", "RWLock")),
    Command("*OPT", query=lambda _: "0,0"),
    Command("*TST", query=lambda _: "0", query_takes_s=2.0),
    event("STATus:OPERation[:EVENt]", lambda meter: meter.operation),
    enable("STATus:OPERation:ENABle", "operation"),
    event("STATus:QUEStionable[:EVENt]", lambda meter: meter.questionable),
    condition("STATus:QUEStionable:CONDition", lambda meter: meter.questionable),
    enable("STATus:QUEStionable:ENABle", "questionable"),
    Command("STATus:PRESet", do=ignored),
    Command("STATus:QUEue[:NEXT]", query=next_error),
    Command("STATus:QUEue:CLEar", do=lambda meter: meter.engine.errors.clear()),
)


class Keithley2000Twin(SimulatedTruevolt):
    """The meter; arguments as of the 34401A."""

    errors_class: ClassVar = Errors2000
    kind: ClassVar[MeterKind] = MeterKind("2000", "A20  /A02", _SHEET, memory=_BUFFER, most_readings=_BUFFER)
    functions: ClassVar[Mapping[str, Function]] = _FUNCTIONS
    table: ClassVar[CommandTable] = _TABLE
    dialect: ClassVar[Dialect] = Dialect(queue_depth=10, takes_blocks=False)
    interfaces: ClassVar[Mapping[str, Interface]] = {"gpib": GPIB, "rs232": RS232}
    fast_apertures_s: ClassVar[Mapping[float, float]] = {}

    def __init__(
        self,
        world: Any,
        *,
        node: str = "output",
        errors: MeterErrors,
        mains_hz: float = 50.0,
        interface: str = "gpib",
        model: str | None = None,
    ) -> None:
        super().__init__(world, node=node, errors=errors, mains_hz=mains_hz, interface=interface, model=model)
        self.continuous = True

    def identity(self) -> str:
        """Return the reply of a real unit (users' record), but for the model that it stands for."""
        return f"KEITHLEY INSTRUMENTS INC.,MODEL {self._model},1308393,{self.kind.firmware}"

    def reset(self) -> None:
        """*RST."""
        self.kept = {name: KeptOfFunction(average=True, digits=7) for name in NAMES}
        self.points, self.feed, self.control, self.format, self.elements = 100, "CALC", "NEV", "ASC", "READ"
        self.beeper = self.display_on = True
        self.stored: list[float] = []
        self.continuous = False
        super().reset()

    def configure_function(self, name: str) -> None:
        """CONFigure: the function as after *RST, one reading by the bus, the buffer off."""
        self.triggering.abort()
        self.continuous = False
        self.configure(self.functions[name], None, None)
        self.control = "NEV"

    def forget(self) -> None:
        """A setting changes: the measurement ends."""
        self.triggering.abort()

    def _finish_reading(self, value: float) -> float:
        reading = super()._finish_reading(value)
        if self.control == "NEXT" and len(self.stored) < self.points:
            self.stored.append(reading)
        return reading
