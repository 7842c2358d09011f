"""Simulated Keithley 2000: a 34401A's inputs behind the 2000's SCPI, trigger model and buffer.

Source: PyMeasure's driver and other users' code with records of ``*IDN?``, the contents of the User's Manual
(2000-900-01) and the data sheet of the 2016. Unverified: the form of numbers, error texts, what ``*RST`` leaves of
averaging, times beside integration, that it comes set to XonXoFF as a 2700 does. From memory of the manual: continuous
initiation is on at power-on and off after ``*RST`` and CONFigure, INITiate is -213 meanwhile; TRACe takes readings when
its feed control is NEXT.

Not simulated: the scanner, timer and manual triggers, binary formats; temperature has no probe. FETCh? gives what has
been through CALCulate1 (the manual calls it post-processed), TRACe with the feed SENSe what has not. CALCulate2 and 3
(statistics of the buffer, limits) are from users' code and memory: what they say without readings, and that 1 is a
failure, is unverified.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from functools import partial
from statistics import fmean
from typing import Any, ClassVar

import numpy as np

from simrack import scpi, specifications
from simrack.instruments.hp34401a.functions import Function
from simrack.instruments.hp34401a.range_commands import RANGED
from simrack.instruments.hp34401a.trigger import TriggerSystem
from simrack.instruments.keithley import common
from simrack.instruments.truevolt.kinds import MeterKind
from simrack.instruments.truevolt.measuring_commands import once_idle
from simrack.scpi import Interface

ROWS = scpi.Rows()

_OVERFLOW, _LOW, _HIGH, _READING, _SOME, _HALF, _FULL = (1 << bit for bit in (0, 1, 2, 5, 7, 8, 9))
"""Bits of the measurement register (manual, p. 5-53)."""
_SHEET = specifications.KEITHLEY_2000
_NR3 = scpi.real(8)
_BUFFER = 1024
_FUNCTIONS = common.functions_of(_SHEET)
_CYCLES, _GATES_S = scpi.Limits(0.01, 10.0, 1.0), scpi.Limits(0.01, 1.0, 1.0)
_WORDS = common.Words("REFerence", (*RANGED, "TEMP"), lambda _meter: _CYCLES, _GATES_S, "THReshold:VOLTage")
"""PyMeasure's driver."""

Errors2000 = common.errors_of(_SHEET)


def _formatted(meter: Keithley2000Twin, readings: Sequence[float | None]) -> str:
    """Return readings with the elements of FORMat:ELEMents, units behind each (form unverified)."""
    unit, number, channel = (
        (common.UNITS[meter.function.name], "RDNG#", "INTCHAN") if "UNIT" in meter.elements else [""] * 3
    )
    texts = []
    for index, value in enumerate(readings):
        elements = {
            "READ": f"{_NR3(math.nan if value is None else value)}{unit}",
            "RNUM": f"{index:+06d}{number}",
            "CHAN": f"00{channel}",
        }
        texts += [text for name, text in elements.items() if name in meter.elements]
    return ",".join(texts)


def _measure(meter: Keithley2000Twin, name: str) -> Any:
    meter.configure_function(name)
    return _read(meter)


def _read(meter: Keithley2000Twin) -> Any:
    """READ?: ABORt, INITiate, FETCh?."""
    if meter.continuous:
        raise scpi.ScpiError(-213)
    meter.triggering.abort()
    meter.triggering.start(stored=True)
    return once_idle(meter, lambda: _formatted(meter, meter.triggering.memory))


@ROWS.do("INITiate[:IMMediate]")
def _initiate(meter: Keithley2000Twin) -> None:
    if meter.continuous:
        raise scpi.ScpiError(-213)
    meter.triggering.start(stored=True)


def _fetch(meter: Keithley2000Twin) -> Any:
    """FETCh?: the latest reading; while it measures by itself the next one."""
    if meter.continuous and meter.triggering.sequence is None:
        meter.triggering.start(stored=True)
        return once_idle(meter, lambda: _formatted(meter, [meter.ring.last]))
    if meter.ring.last is None:
        raise scpi.ScpiError(-230)
    return _formatted(meter, [meter.ring.last])


@ROWS.do(
    "SYSTem:AZERo[:STATe]",
    (scpi.Boolean(),),
    query=lambda meter: meter.autozeroes("VOLT"),
    reply=scpi.boolean,
    reads=True,
)
def _set_azero(meter: Keithley2000Twin, state: object) -> None:
    for name in common.NAMES:
        meter.set_autozero(name, on=bool(state))


@ROWS.do(
    "TRIGger[:SEQuence<1-1>]:DELay",
    (scpi.Number(unit="S", limits=scpi.Limits(0.0, 999_999.999, 0.0)),),
    query=lambda meter: meter.delay_s(),
    reply=_NR3,
    reads=True,
)
def _set_delay(meter: Keithley2000Twin, seconds: float) -> None:
    meter.triggering.delay_s, meter.triggering.delay_auto = seconds, False


@ROWS.query("TRACe:DATA")
def _stored(meter: Keithley2000Twin) -> str:
    if not meter.stored:
        raise scpi.ScpiError(-230)
    return _formatted(meter, meter.stored)


@ROWS.attribute("TRACe:FEED:CONTrol", scpi.Choice(("NEVer", "NEXT")), "control")
def _feed(meter: Keithley2000Twin, control: str) -> None:
    meter.control = control
    if control == "NEXT":
        meter.empty_buffer()


@ROWS.query("CALCulate<2-2>:IMMediate")
@ROWS.query("CALCulate<2-2>:DATA")
def _statistic(meter: Keithley2000Twin) -> str:
    kind = meter.engine.remembered.get((_STATISTIC,), "NONE")
    if kind not in _STATISTICS or not meter.stored:
        raise scpi.ScpiError(-230)
    return _NR3(float(_STATISTICS[kind](meter.stored)))


@ROWS.query("CALCulate<3-3>:LIMit<1-2>:FAIL", reply=scpi.boolean)
def _fails(meter: Keithley2000Twin, limit: int) -> bool:
    last = meter.ring.last
    return last is not None and bool(_beyond(meter, limit, last))


def _beyond(meter: Keithley2000Twin, limit: int, reading: float) -> int:
    """Return the bit of the limit that a reading is beyond."""
    kept = meter.engine.remembered
    upper, lower = (kept.get((f"{_LIMIT}:{side}[:DATA]", limit), usual) for side, usual in _SIDES)
    return (_LOW if reading < lower else 0) | (_HIGH if reading > upper else 0)


@ROWS.do("SYSTem:PRESet")
def _preset(meter: Keithley2000Twin) -> None:
    meter.reset()
    meter.continuous = True


def _hold(meter: Keithley2000Twin, state: object) -> None:
    """Hold the reading that is there, until it is switched off; what would change it (a window) is not simulated."""
    meter.held = (meter.ring.last or 0.0) if state else None


_STATISTIC, _LIMIT = "CALCulate<2-2>:FORMat", "CALCulate<3-3>:LIMit<1-2>"
_SHOWN = "DISPlay[:WINDow<1-1>]:TEXT"
_STATISTICS: Mapping[str, Any] = {"MEAN": fmean, "SDEV": lambda each: np.std(each, ddof=1), "MAX": max, "MIN": min}
_SIDES = (("UPPer", 1.0), ("LOWer", -1.0))
_COUNTS = scpi.Integer(limits=scpi.Limits(1, 9999, 1), words={"INFinity": float("inf")})

_COMMANDS = (
    *ROWS,
    *common.SHARED,
    *(
        scpi.Command(f"CONFigure:{_FUNCTIONS[name].header}", do=lambda meter, name=name: meter.configure_function(name))
        for name in common.NAMES
    ),
    *(
        scpi.Command(f"MEASure:{_FUNCTIONS[name].header}", query=partial(_measure, name=name), query_parameters=())
        for name in common.NAMES
    ),
    scpi.Command("CONFigure", query=lambda meter: common.NAMES[meter.function.name], reply=scpi.quoted, reads=True),
    common.function_command("[SENSe:]FUNCtion"),
    *common.settings_of_functions(_FUNCTIONS, _WORDS),
    *common.digits_commands(_FUNCTIONS, "[SENSe:]", scpi.Limits(4, 7)),
    scpi.Command("[SENSe:]DATA[:LATest]", query=_fetch),
    scpi.Command("[SENSe:]DATA:FRESh", query=_fetch),
    scpi.Command("READ", query=_read),
    scpi.Command("FETCh", query=_fetch),
    scpi.attribute("INITiate:CONTinuous", scpi.Boolean(), "continuous", scpi.boolean),
    scpi.Command("ABORt", do=lambda meter: meter.triggering.abort()),
    scpi.attribute(
        "TRIGger[:SEQuence<1-1>]:COUNt",
        _COUNTS,
        "triggering.trigger_count",
        lambda count: "+9.9E37" if math.isinf(count) else str(int(count)),
        convert=float,
    ),
    scpi.attribute(
        "SAMPle:COUNt", scpi.Integer(limits=scpi.Limits(1, _BUFFER, 1)), "triggering.sample_count", scpi.signed_integer
    ),
    scpi.attribute("TRIGger[:SEQuence<1-1>]:DELay:AUTO", scpi.Boolean(), "triggering.delay_auto", scpi.boolean),
    # no source is the timer here (limits and default unverified)
    scpi.remembered("TRIGger[:SEQuence<1-1>]:TIMer", scpi.Number(limits=scpi.Limits(1e-3, 999999.999, 0.1)), 0.1, _NR3),
    scpi.attribute(
        "TRIGger[:SEQuence<1-1>]:SOURce", scpi.Choice(("IMMediate", "BUS", "EXTernal")), "triggering.source"
    ),
    scpi.Command("*TRG", do=lambda meter: meter.triggering.fire(), urgent=True),
    scpi.Command("TRACe:CLEar", do=lambda meter: meter.empty_buffer()),
    # bytes left and used; 24 a reading and a byte of overhead are what its manual's 1024 readings come to (unverified)
    scpi.Command(
        "TRACe:FREE", query=lambda meter: f"{24 * (_BUFFER - len(meter.stored))},{24 * len(meter.stored)}", reads=True
    ),
    scpi.attribute("TRACe:POINts", scpi.Integer(limits=scpi.Limits(2, _BUFFER)), "points", scpi.signed_integer),
    scpi.attribute(
        "TRACe:FEED",
        scpi.Choice(("SENSe<1-1>", "CALCulate<1-1>", "NONE")),
        "feed",
        convert=lambda word: word.removesuffix("1"),
    ),
    scpi.attribute("FORMat[:DATA]", scpi.Choice(("ASCii",)), "format"),
    # what drivers set of all of the maker's meters (defaults unverified)
    scpi.remembered("SYSTem:POSetup", scpi.Choice(("RST", "PRESet", "SAV0")), "PRES"),
    scpi.Command("SYSTem:KEY", (scpi.Integer(limits=scpi.Limits(1, 31)),), do=common.ignored),
    scpi.Command(
        "FORMat:ELEMents",
        (scpi.Choice(("READing", "UNITs", "CHANnel", "RNUMber")),),
        do=lambda meter, *elements: setattr(meter, "elements", elements),
        query=lambda meter: ",".join(meter.elements),
        repeat=True,
        reads=True,
    ),
    scpi.attribute("SYSTem:BEEPer:STATe", scpi.Boolean(), "beeper", scpi.boolean),
    scpi.remembered(f"{_SHOWN}[:DATA]", scpi.Text(limit=12), "", scpi.quoted),
    *(
        scpi.remembered(f"{each}:STATe", scpi.Boolean(), default=False, reply=scpi.boolean)
        for each in ("CALCulate<2-2>", _LIMIT, _SHOWN)
    ),
    *common.formula_commands("CALCulate<1-1>", "formulas[VOLT]", ("NONE", "MXB", "PERCent"), ":KMATh"),
    scpi.attribute("UNIT:VOLTage:DC", scpi.Choice(("V", "DB", "DBM")), "unit"),
    scpi.attribute("[SENSe:]HOLD:STATe", scpi.Boolean(), "held", lambda held: scpi.boolean(held is not None), do=_hold),
    scpi.remembered("CALCulate<1-1>:KMATh:MUNits", scpi.Text(limit=3), "MXB", scpi.quoted),
    scpi.remembered(_STATISTIC, scpi.Choice(("NONE", "MEAN", "SDEViation", "MAXimum", "MINimum")), "NONE"),
    scpi.Command("CALCulate<2-2>:IMMediate", do=common.ignored),
    *(
        scpi.remembered(f"{_LIMIT}:{side}[:DATA]", scpi.Number(limits=scpi.Limits(-1e8, 1e8)), usual, _NR3)
        for side, usual in _SIDES
    ),
    scpi.Command(f"{_LIMIT}:CLEar[:IMMediate]", do=common.ignored),
    scpi.Command("CALCulate<3-3>:IMMediate", do=common.ignored),
    scpi.remembered("[SENSe:]TEMPerature:TCouple:TYPE", scpi.Choice(tuple("JKT")), "J"),
    scpi.remembered("UNIT:TEMPerature", scpi.Choice(("C", "F", "K")), "C"),
    scpi.Command("CALCulate<1-1>:DATA[:LATest]", query=_fetch),
    scpi.attribute("DISPlay:ENABle", scpi.Boolean(), "display_on", scpi.boolean),
    scpi.Command("SYSTem:FRSWitch", query=lambda meter: not meter.rear, reply=scpi.boolean, reads=True),
    scpi.Command("SYSTem:VERSion", query=lambda _: "1991.0", reads=True),
    *(scpi.Command(f"SYSTem:{word}", do=common.ignored) for word in ("LOCal", "REMote", "RWLock")),
    scpi.Command("*OPT", query=lambda _: "0,0", reads=True),
    *scpi.status_commands("MEASurement", "measurement"),
    scpi.Command("STATus:QUEue[:NEXT]", query=scpi.next_error),
    scpi.Command("STATus:QUEue:CLEar", do=lambda meter: meter.engine.errors.clear()),
)
_TABLE = scpi.CommandTable(*common.with_sense(_COMMANDS))


class Keithley2000Twin(common.SimulatedKeithley):
    """The meter; arguments as of the 34401A."""

    own_name: ClassVar = "2000"
    errors_class: ClassVar = Errors2000
    kind: ClassVar[MeterKind] = MeterKind("2000", "A20  /A02", _SHEET, memory=_BUFFER, most_readings=_BUFFER)
    functions: ClassVar[Mapping[str, Function]] = _FUNCTIONS
    table: ClassVar[scpi.CommandTable] = _TABLE
    dialect: ClassVar[scpi.Dialect] = scpi.Dialect(
        queue_depth=10, words=common.ERROR_WORDS, takes_blocks=False, xonxoff=True
    )
    interfaces: ClassVar[Mapping[str, Interface]] = {"gpib": scpi.GPIB, "rs232": scpi.RS232}
    held: float | None

    def power_on(self) -> None:
        """As after *RST, but it measures by itself."""
        super().power_on()
        self.continuous = True

    def made_trigger_system(self) -> TriggerSystem:
        """Return the trigger system, with the register of what it and the buffer come to."""
        self.engine.status.summaries[0] = self.measurement = scpi.Register()
        return super().made_trigger_system()

    def empty_buffer(self) -> None:
        """Forget the readings of the buffer."""
        self.stored: list[float] = []
        self.measurement.set_bits(_SOME | _HALF | _FULL, 0)

    def service(self) -> None:
        """Finish and begin readings; while it measures by itself the buffer fills."""
        super().service()
        fills = self.control == "NEXT" and len(self.stored) < self.points
        if self.continuous and fills and self.triggering.sequence is None:
            self.triggering.start(stored=True)

    def identity(self) -> str:
        """Return the reply of a real unit (users' record), but for the model that it stands for."""
        return f"KEITHLEY INSTRUMENTS INC.,MODEL {self._model},1308393,{self.kind.firmware}"

    def reset(self) -> None:
        """*RST."""
        self.kept = {name: common.KeptOfFunction(average=True, digits=7) for name in common.NAMES}
        self.points, self.feed, self.control, self.format, self.elements = 100, "CALC", "NEV", "ASC", ("READ",)
        self.beeper = self.display_on = True
        self.formulas = dict.fromkeys(common.NAMES, common.Formula())
        self.unit, self.held = "V", None
        self.empty_buffer()
        self.continuous = False
        super().reset()

    def configure_function(self, name: str) -> None:
        """CONFigure: the function as after *RST, one reading by the bus, mathematics and the buffer off."""
        self.triggering.abort()
        self.continuous = False
        self.configure(self.functions[name], None, None)
        self.kept[name] = common.KeptOfFunction(average=True, digits=7)
        self.formulas[name].on, self.control = False, "NEV"
        for switch in (("CALCulate<2-2>:STATe",), (f"{_LIMIT}:STATe", 1), (f"{_LIMIT}:STATe", 2)):
            self.engine.remembered.pop(switch, None)

    def _finish_reading(self, value: float) -> float:
        reading = super()._finish_reading(value) if self.held is None else self.held
        if self.control == "NEXT" and len(self.stored) < self.points:
            self.stored.append(self.before_mathematics if self.feed == "SENS" else reading)
        count = len(self.stored)
        buffer = _SOME * (count >= 2) | _HALF * (2 * count >= self.points) | _FULL * (count >= self.points)
        judged = self.engine.remembered.get((f"{_LIMIT}:STATe", 1), False)
        events = judged * _beyond(self, 1, reading) | _OVERFLOW * (abs(reading) >= scpi.INFINITY)
        self.measurement.set_condition(buffer | events)
        self.measurement.latch(_READING | events)
        return reading
