"""Simulated Keithley DMM6500 set to SCPI: a 34401A's inputs behind its words, trigger models and reading buffer.

Source: PyMeasure's driver, whose tests hold replies of a real one (one suite is for a connected one, at 60 Hz), pages
of the Reference Manual (DMM6500-901-01) as a public project quotes them, and other users' code. Unverified: the form
of numbers but for theirs, error texts, which of the words of the trigger model wait.

Not simulated: the command set TSP (``*LANG`` would count from the next power-on; its lines are -113, and a ``print`` is
answered by what is wrong, so that nobody waits), buffers with readings of their own
(one that is made holds those of defbuffer1), the analog trigger, the scanner, ready-made trigger models but SimpleLoop;
temperature and capacitance have nothing to measure.
"""

from __future__ import annotations

import re
from collections.abc import Mapping
from functools import partial
from typing import Any, ClassVar

from msgspec.structs import replace

from simrack import scpi, specifications
from simrack.instruments.hp34401a.functions import Function
from simrack.instruments.hp34401a.range_commands import zero_command
from simrack.instruments.keithley import common, digitizing_commands, reading_buffer, trigger_model
from simrack.instruments.truevolt.kinds import MeterKind
from simrack.scpi import Interface

_SHEET = specifications.KEITHLEY_DMM6500
_BUFFER = 100_000
_NR3 = "{:G}".format
"""Numbers as PyMeasure's tests have them of a real one: 0.01, 30, 0.0166667."""
_FUNCTIONS = common.functions_of(_SHEET, "CAP", FREQ="FREQuency[:VOLTage]", PER="PERiod[:VOLTage]")
_NAMES = {**common.NAMES, "CAP": "CAP", "FREQ": "FREQ:VOLT", "PER": "PER:VOLT", "VOLT:RAT": "VOLT:DC:RAT"}
"""The functions, and what they are called in replies (PyMeasure's suite for connected devices)."""
_INTEGRATING = ("VOLT", "CURR", "RES", "FRES", "DIOD", "TEMP", "VOLT:RAT")
_WORDS = common.Words(
    "RELative",
    _INTEGRATING,
    lambda meter: scpi.Limits(0.0005, 15.0 if meter.line_hz == 60 else 12.0, 1.0),  # manual, p. 13-108
    scpi.Limits(2e-3, 0.273, 0.2),
    "THReshold",
    more=("DIOD", "CAP"),
    number=_NR3,
)
_BEGUN_S = 1_767_225_600

Errors6500 = common.errors_of(_SHEET)


_OF_READINGS = (*reading_buffer.NAMED, reading_buffer.ELEMENTS)


def _error_suffix(number: int, instant_s: float) -> str:
    """Return type and time of an event (records of a real one: ``;0;0 0``, ``;1;2018/05/26 14:00:14.871``)."""
    return f";1;{reading_buffer.stamp(instant_s)}" if number else ";0;0 0"


def _measure(meter: KeithleyDMM6500Twin, buffer: str | None = None, *elements: str, name: str) -> Any:
    meter.choose(meter.functions[name])
    return reading_buffer.read(meter, buffer, *elements)


def _measure_digitized(meter: KeithleyDMM6500Twin, buffer: str | None = None, *elements: str, name: str) -> Any:
    if name:
        meter.choose_digitizing(name)
    return reading_buffer.read_digitized(meter, buffer, *elements)


_SECONDS = scpi.Number(
    unit="S", limits=lambda meter: scpi.Limits(8.33e-6, 0.25, 0.0166667 if meter.line_hz == 60 else 0.02)
)
"""MIN, MAX and DEF as PyMeasure's suite for connected devices expects them, at 60 Hz."""
_TSP = re.compile(rb"\s*[A-Za-z_][\w.\[\]]*\s*[(=]")
"""Begins a line of TSP, a call or an assignment, and no message of SCPI."""
_NO_TSP = "TSP is not simulated, the command set is SCPI"
_STIMULI = ("NONE", "TIMer<1-4>", "NOTify<1-8>", "DISPlay", "COMMand", "EXTernal")


def _refuse_tsp(meter: KeithleyDMM6500Twin) -> str:
    meter.engine.report(scpi.ScpiError(-113, f"Undefined header; {_NO_TSP}"))
    return _NO_TSP


_COMMANDS = (
    *reading_buffer.ROWS,
    *digitizing_commands.ROWS,
    *trigger_model.ROWS,
    *common.SHARED,
    scpi.Command(
        "*LANG", (scpi.Choice(("SCPI", "TSP")),), do=common.ignored, query=lambda meter: meter.command_set, reads=True
    ),
    scpi.Command("TSP", do=_refuse_tsp, query=_refuse_tsp),
    # without quotation marks (PyMeasure's tests of a real one, QCoDeS' driver); NONE while one digitises (manual)
    replace(
        common.function_command("[SENSe:]FUNCtion[:ON]", str, _NAMES),
        query=lambda meter: _NAMES[meter.function.name] if meter.digitizing == "NONE" else "NONE",
    ),
    scpi.attribute(
        "[SENSe:]VOLTage[:DC]:INPutimpedance",
        scpi.Choice(("MOHM10", "AUTO")),
        "high_impedance",
        lambda high: "AUTO" if high else "MOHM10",
        convert=lambda word: word == "AUTO",
    ),
    scpi.remembered("[SENSe:]DIODe:BIAS:LEVel", scpi.Number(unit="A", limits=scpi.Limits(1e-5, 1e-2)), 1e-3, _NR3),
    *common.settings_of_functions(_FUNCTIONS, _WORDS),
    *(
        each
        for name in ("VOLT", "RES", "FRES")
        for each in (
            *common.formula_commands(
                f"CALCulate<1-1>:{_FUNCTIONS[name].header}:MATH", f"formulas[{name}]", ("MXB", "PERCent", "RECiprocal")
            ),
            scpi.attribute(
                f"[SENSe:]{_FUNCTIONS[name].header}:LINE:SYNC", scpi.Boolean(), f"kept[{name}].line_sync", scpi.boolean
            ),
            scpi.attribute(
                f"[SENSe:]{_FUNCTIONS[name].header}:DELay:AUTO",
                scpi.Boolean(),
                f"kept[{name}].auto_delay",
                scpi.boolean,
            ),
        )
    ),
    scpi.attribute("[SENSe:]VOLTage[:DC]:UNIT", scpi.Choice(("VOLT", "DB", "DBM")), "unit"),
    *(
        common.integration(name, f"{_FUNCTIONS[name].header}:APERture", _SECONDS, _NR3, lambda meter: 1 / meter.line_hz)
        for name in _INTEGRATING
    ),
    *(zero_command(name, f"{_FUNCTIONS[name].header}:AZERo[:STATe]", scpi.Boolean()) for name in _INTEGRATING),
    scpi.remembered("[SENSe:]CAPacitance:RANGe[:UPPer]", scpi.Number(limits=scpi.Limits(1e-9, 1e-4, 1e-4)), 1e-4, _NR3),
    scpi.remembered("[SENSe:]CAPacitance:RANGe:AUTO", scpi.Boolean(), default=True, reply=scpi.boolean),
    *common.digits_commands(_FUNCTIONS, "DISPlay:", scpi.Limits(3, 6), _NAMES),
    # a zero is taken now and none after (manual, p. 13-140; PyMeasure's suite for connected devices)
    scpi.Command("[SENSe:]AZERo:ONCE", do=lambda meter: meter.set_autozero(meter.function.name, on=False)),
    scpi.attribute("[SENSe:]COUNt", scpi.Integer(limits=scpi.Limits(1, 1_000_000)), "samples", scpi.signed_integer),
    *(
        scpi.Command(
            f"MEASure:{_FUNCTIONS[name].header}",
            query=partial(_measure, name=name),
            query_parameters=_OF_READINGS,
            repeat=True,
        )
        for name in _NAMES
    ),
    *(
        scpi.Command(header, query=partial(_measure_digitized, name=name), query_parameters=_OF_READINGS, repeat=True)
        for header, name in (
            ("MEASure:DIGitize", ""),
            ("MEASure:DIGitize:VOLTage", "VOLT"),
            ("MEASure:DIGitize:CURRent", "CURR"),
        )
    ),
    scpi.remembered(reading_buffer.PRECISION[0], scpi.Integer(limits=scpi.Limits(0, 16, 0)), 0, scpi.bare_integer),
    scpi.Command("SYSTem:EVENtlog:NEXT", query=scpi.next_error),
    scpi.Command("SYSTem:ERRor:COUNt", query=lambda meter: len(meter.engine.errors), reads=True),
    scpi.Command(
        "SYSTem:EVENtlog:COUNt",
        query=lambda meter, kind: 0 if kind in {"WARN", "INF"} else len(meter.engine.errors),
        query_parameters=(scpi.Choice(("ALL", "ERRor", "WARNing", "INFormational"), required=False),),
        reads=True,
    ),
    scpi.Command("ROUTe:TERMinals", query=lambda meter: "REAR" if meter.rear else "FRON", reads=True),
    # its clock: seconds since 1970, or after a 1 as text (both from memory of the manual, unverified)
    scpi.Command(
        "SYSTem:TIME",
        (scpi.Number(),),
        repeat=True,
        do=common.ignored,
        query=lambda meter, text: (
            reading_buffer.date(meter.clock.now()).ctime() if text else int(_BEGUN_S + meter.clock.now())
        ),
        query_parameters=(scpi.Integer(required=False),),
        reads=True,
    ),
    scpi.Command("SYSTem:VERSion", query=lambda _: "1999.0", reads=True),
    scpi.Command("DISPlay:CLEar", do=common.ignored),
    scpi.Command("DISPlay:SCReen", (scpi.Word(),), do=common.ignored),
    *(scpi.Command(f"DISPlay:USER{line}:TEXT[:DATA]", (scpi.Text(),), do=common.ignored) for line in (1, 2)),
    # of the scanner, the timers of trigger models, buffers and the display what drivers set (defaults unverified)
    *(
        scpi.remembered(*row)
        for row in (
            ("DISPlay:LIGHt:STATe", scpi.Choice(("ON100", "ON75", "ON50", "ON25", "OFF", "BLACkout")), "ON50"),
            ("DISPlay:BUFFer:ACTive", scpi.Text(), "defbuffer1"),
            ("[SENSe:]FRESistance:OCOMpensated", scpi.Choice(("ON", "OFF", "AUTO")), "AUTO"),
            ("SYSTem:PCARd<1-1>", scpi.Integer(limits=scpi.Limits(0, 2001)), 0, scpi.bare_integer),
            ("ROUTe:SCAN:COUNt:SCAN", scpi.Integer(limits=scpi.Limits(1, 100_000_000, 1)), 1, scpi.bare_integer),
            ("ROUTe:SCAN:INTerval", scpi.Number(unit="S", limits=scpi.Limits(0.0, 1e6)), 0.0, _NR3),
            ("TRIGger:TIMer<1-4>:DELay", scpi.Number(unit="S", limits=scpi.Limits(0.0, 1e6)), 1e-5, _NR3),
            ("TRIGger:TIMer<1-4>:STARt:STIMulus", scpi.Choice(_STIMULI), "NONE"),
        )
    ),
    # no card is in the slot (form of the replies unverified)
    scpi.Command("SYSTem:CARD1:IDN", query=lambda _: "Empty Slot", reads=True),
    *(
        scpi.Command(f"SYSTem:CARD1:{each}", query=lambda _: "0", reads=True)
        for each in ("VCHannel[:STARt]", "VCHannel:END", "VMAX")
    ),
    scpi.Command("ROUTe:SCAN[:CREate]", query=lambda _: "(@)", reads=True),
)
_TABLE = scpi.CommandTable(*common.with_sense(_COMMANDS))


class KeithleyDMM6500Twin(trigger_model.ModelledMeter):
    """The meter; arguments as of the 34401A."""

    own_name: ClassVar = "DMM6500"
    errors_class: ClassVar = Errors6500
    kind: ClassVar[MeterKind] = MeterKind("DMM6500", "1.7.12b", _SHEET, memory=_BUFFER, most_readings=1_000_000)
    functions: ClassVar[Mapping[str, Function]] = _FUNCTIONS
    table: ClassVar[scpi.CommandTable] = _TABLE
    dialect: ClassVar[scpi.Dialect] = scpi.Dialect(
        queue_depth=64,
        words=common.ERROR_WORDS,
        error_number=scpi.bare_integer,
        error_suffix=_error_suffix,
        takes_blocks=False,
    )
    interfaces: ClassVar[Mapping[str, Interface]] = {"usb": scpi.USB, "gpib": scpi.GPIB, "lan": scpi.LAN}
    command_set: ClassVar = "SCPI"

    def write(self, data: bytes, *, end: bool = False) -> None:
        """Take bytes; a line of TSP gets an error at once."""
        if _TSP.match(data):
            data = b"TSP?\n" if b"print" in data else b"TSP\n"
        super().write(data, end=end)

    def identity(self) -> str:
        """Return the reply of a real unit (users' record), but for the model that it stands for."""
        return f"KEITHLEY INSTRUMENTS,MODEL {self._model},04592448,{self.kind.firmware}"

    def reset(self) -> None:
        """*RST."""
        self.kept = {name: common.KeptOfFunction(average=False, digits=6) for name in _NAMES}
        self.formulas = {name: common.Formula() for name in ("VOLT", "RES", "FRES")}
        self.unit = "VOLT"
        super().reset()
        for name in _INTEGRATING[:-1]:  # a cycle: DEF (manual, p. 13-108; so has PyMeasure's suite the aperture)
            setup, fraction = self.setups[name], self.functions[name].fraction_of(1.0)
            setup.nplc, setup.resolution = 1.0, fraction

    def delay_s(self) -> float:
        """Return the delay before a reading; synchronised to the line it waits for the mains' next period."""
        own = self.kept[self.function.name]
        delay_s = super().delay_s() if own.auto_delay or not self.triggering.delay_auto else 0.0
        return delay_s + (-(self.clock.now() + delay_s) % (1.0 / self.line_hz) if own.line_sync else 0.0)
