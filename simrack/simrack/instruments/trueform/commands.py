"""The command table of the Trueform series.

Headers are those of a driver that was made from the maker's own SCPI description of the 33500B (users' code), and
replies have the digits of a users' record of a 33600A after ``*RST``: fifteen decimals, thirteen for amplitude, offset
and phases. What stands here is the 33220A's command under the header of the series, and what the series has of its
own. ``SOURce2:``, ``OUTPut2`` and ``TRIGger2`` are -114 where there is one channel.
"""

from __future__ import annotations

import math
import re
from functools import cache
from typing import Any

from msgspec.structs import replace

from simrack import scpi
from simrack.instruments import agilent33220a
from simrack.instruments.agilent33220a import arbitrary_commands, level_commands
from simrack.instruments.agilent33220a.declarations import SWITCH_S, TUNE_S, mode_switch, nr3, setting
from simrack.instruments.agilent33220a.settings import conflict
from simrack.instruments.trueform.arbitrary import bare_name, path
from simrack.instruments.trueform.instrument import SimulatedTrueform as _Model
from simrack.instruments.trueform.kinds import LONGEST_BURST_S
from simrack.scpi.lexer import Token, TokenKind

ROWS = scpi.Rows()

_FIFTEEN = scpi.real(15)
_SOURCES = scpi.Choice(("INTernal", "EXTernal"))
_OTHER_CHANNEL = scpi.Choice(("INTernal", "EXTernal", "CH<1-2>"))
_SWEEP_REST_S = scpi.Limits(0.0, 3600.0, 0.0)
_THIRTEEN = ("[SOURce:]VOLTage", "[SOURce:]VOLTage:OFFSet", "[SOURce:]PHASe[:ADJust]", "[SOURce:]BURSt:PHASe")
_HEADERS = {
    "[SOURce:]FUNCtion:PULSe:TRANsition": "[SOURce:]FUNCtion:PULSe:TRANsition[:BOTH]",
    "MARKer:FREQuency": "[SOURce:]MARKer:FREQuency",
}
_LEFT_OUT = (
    *("MARKer[:STATe]", "*LRN", "SYSTem:KLOCk", "SYSTem:COMMunicate:RLSTate", "OUTPut:LOAD", "APPLy:USER"),
    *("APPLy:DC", "[SOURce:]FUNCtion[:SHAPe]", "[SOURce:]FUNCtion:SQUare:DCYCle", "[SOURce:]PULSe:PERiod"),
    *("[SOURce:]BURSt:INTernal:PERiod", "[SOURce:]BURSt:NCYCles", "*TRG"),
    *("SYSTem:LOCal", "SYSTem:REMote", "SYSTem:RWLock"),
)
"""What the series does not have, or has in another way."""


def _nr3(value: float) -> str:
    """Format fifteen decimals; a double cannot hold 9.9E37 to so many."""
    return "+9.900000000000000E+37" if value == math.inf else _FIFTEEN(value)


class _Name(scpi.Parameter, frozen=True, kw_only=True):
    """The name of a waveform, with quotes, folder and extension or without them."""

    def parse(self, token: Token) -> str:
        """Return it bare."""
        if token.kind not in {TokenKind.WORD, TokenKind.STRING}:
            raise self.refuse_kind(token)
        return bare_name(token.text)


def _inherited() -> list[scpi.Command]:
    """Return the 33220A's commands as they stand in the series."""
    return [
        _as_here(command)
        for command in agilent33220a.COMMANDS
        if not command.pattern.startswith(_LEFT_OUT) and command.pattern != "APPLy"
    ]


def _as_here(command: scpi.Command) -> scpi.Command:
    digits = nr3 if command.pattern in _THIRTEEN else _nr3
    reply = digits if command.reply is nr3 else command.reply
    return replace(command, pattern=_HEADERS.get(command.pattern, command.pattern), reply=reply)


def _spelled(command: scpi.Command) -> tuple[scpi.Command, ...]:
    """Return a command of the first channel as it may be said, with the number of the channel or without it."""
    header = command.pattern
    for root in ("OUTPut", "TRIGger", "INITiate"):
        if header.startswith(root):
            return (replace(command, pattern=f"{root}<1-1>{header.removeprefix(root)}"),)
    if header.startswith("APPLy"):
        return command, replace(command, pattern=f"SOURce<1-1>:{header}")
    return (replace(command, pattern=header.replace("[SOURce:]", "[SOURce<1-1>:]")),)


def _of_second(command: scpi.Command) -> tuple[scpi.Command, ...]:
    """Return the same of the second channel, where it is a command of a channel."""
    header = command.pattern.replace("[SOURce:]", "SOURce:")
    header = f"SOURce:{header}" if header.startswith("APPLy") else header
    root = next((root for root in ("SOURce", "OUTPut", "TRIGger", "INITiate") if header.startswith(root)), None)
    header = "" if root is None else f"{root}<2-2>{header.removeprefix(root)}"
    return (replace(command, pattern=header, part="second"),) if header else ()


def _initiate(model: _Model) -> None:
    """INITiate: -213 while triggers are taken anyway (SCPI-99; what a real one says is unverified)."""
    if model.state.continuous:
        raise scpi.ScpiError(-213)


# --- functions ------------------------------------------------------------------------------------------------------


def _selected(model: _Model) -> str:
    return "ARB" if model.state.function == "USER" else str(model.state.function)


def _apply_dc(model: _Model, frequency: Any, amplitude: Any, offset: Any) -> None:
    """Take the offset; the parameters for frequency and amplitude are ignored."""
    del frequency, amplitude
    model.state.mode, model.state.trigger, model.state.range_auto = "", "IMM", True
    model.rules.select("DC")
    model.levels.set_offset(model.levels.rounded(level_commands.OFFSET.settle(offset, model)))
    model.state.output = True
    model.update()


@ROWS.query("APPLy", reads=True)
def _applied(model: _Model) -> str:
    amplitude, offset = level_commands.amplitude_shown(model), level_commands.offset_shown(model)
    return scpi.quoted(f"{_selected(model)} {_nr3(model.state.frequency_hz)},{nr3(amplitude)},{nr3(offset)}")


def _square_duty_limits(model: _Model) -> scpi.Limits:
    """Return the duty cycles that leave the least width of a pulse (users' tests: 0.01 % at low frequency)."""
    least = max(0.01, 100.0 * model.kind.least_width_s[math.inf] * model.state.frequency_hz)
    return scpi.Limits(least, 100.0 - least, 50.0)


def _period_limits(model: _Model) -> scpi.Limits:
    low, high = model.kind.frequency_hz["PULS"]
    return scpi.Limits(1.0 / high, 1.0 / low, 1e-3)


# --- limits and load ------------------------------------------------------------------------------------------------


def _limit(name: str) -> scpi.Command:
    def limits(model: _Model) -> scpi.Limits:
        most = model.levels.max_v()
        return scpi.Limits(-most, most, most if name == "limit_high_v" else -most)

    def write(model: _Model, shown_v: float) -> None:
        before = getattr(model.state, name)
        setattr(model.state, name, shown_v / model.levels.share)
        if model.state.limit_on and not model.limited.within_limits():
            setattr(model.state, name, before)
            raise conflict("limit does not hold the present levels")

    return scpi.Command(
        f"[SOURce:]VOLTage:LIMit:{'HIGH' if name == 'limit_high_v' else 'LOW'}",
        (scpi.Number(unit="V", limits=limits),),
        do=write,
        query=lambda model: getattr(model.state, name) * model.levels.share,
        reply=_nr3,
        reads=True,
    )


@ROWS.attribute("[SOURce:]VOLTage:LIMit:STATe", scpi.Boolean(), "state.limit_on", scpi.boolean)
def _switch_limits(model: _Model, state: object) -> None:
    """Switch the limits; they stay off where the present levels leave them (unverified)."""
    if state and not model.limited.within_limits():
        raise conflict("output limits do not hold the present levels")
    model.state.limit_on = bool(state)


@ROWS.attribute("OUTPut:LOAD", level_commands.LOAD, "state.load_ohm", _nr3)
def _set_load(model: _Model, ohm: float) -> None:
    """Change the shown load; not while limits are on, whose load would not be known (guide p. 62)."""
    if model.state.limit_on:
        raise conflict("output termination cannot be changed while voltage limits are enabled")
    model.state.load_ohm = ohm
    if math.isinf(ohm):
        model.state.unit = "VPP"  # guide p. 62


# --- arbitrary waveforms --------------------------------------------------------------------------------------------


@ROWS.do("[SOURce:]DATA:ARBitrary", (_Name(), scpi.Number(limits=scpi.Limits(-1.0, 1.0))), repeat=True)
def _load(model: _Model, name: str, *points: float) -> None:
    model.waveforms.load_named(name, list(points), model.series.least_points)


@ROWS.do("[SOURce:]DATA:ARBitrary:DAC", (_Name(), scpi.Number()), repeat=True)
def _load_dac(model: _Model, name: str, *codes: float) -> None:
    if any(not -32767 <= code <= 32767 for code in codes):
        raise scpi.ScpiError(-222)
    model.waveforms.load_named(name, [code / 32767.0 for code in codes], model.series.least_points)


@ROWS.do("MMEMory:LOAD:DATA", (scpi.Text(),))
def _load_file(_model: _Model, _name: str) -> None:
    """MMEMory:LOAD:DATA: its memory has no files (number of SCPI, unverified)."""
    raise scpi.ScpiError(-256, "File name not found")


@ROWS.do("*TRG", urgent=True)
def _bus_trigger(model: _Model) -> None:
    waiting = [each for each in (model, model.second) if each is not None and each.state.trigger == "BUS"]
    if not waiting:
        raise scpi.ScpiError(-211)
    for each in waiting:
        each.fire()


@ROWS.do("[SOURce:]DATA:VOLatile:CLEar")
def _clear(model: _Model) -> None:
    model.waveforms.clear()
    model.choose_arbitrary("EXP_RISE")


def _points(model: _Model) -> int:
    return len(model.waveforms.points(model.state.user))


def _retune(model: _Model) -> None:
    model.tune_arbitrary()
    model.settle()


def _arbitrary_rate(word: str, unit: str, power: int) -> scpi.Command:
    def limits(model: _Model) -> scpi.Limits:
        ends = ((each / _points(model)) ** power for each in (1e-6, model.series.sample_rate_hz))
        return scpi.Limits(*sorted(ends))

    def write(model: _Model, value: float) -> None:
        model.state.sample_rate_hz = value**power * _points(model)
        _retune(model)

    return scpi.Command(
        f"[SOURce:]FUNCtion:ARBitrary:{word}",
        (scpi.Number(unit=unit, limits=limits),),
        do=write,
        query=lambda model: (model.state.sample_rate_hz / _points(model)) ** power,
        reply=_nr3,
        reads=True,
    )


_EDGE, _BURST_COUNT, _AMPLITUDE = (
    next(each for each in agilent33220a.COMMANDS if each.pattern == f"[SOURce:]{header}")
    for header in ("FUNCtion:PULSe:TRANsition", "BURSt:NCYCles", "VOLTage")
)
_COUNT: Any = _BURST_COUNT.parameters[0]


@ROWS.do(
    "[SOURce:]FUNCtion[:SHAPe]",
    (scpi.Choice(("SINusoid", "SQUare", "TRIangle", "RAMP", "PULSe", "PRBS", "NOISe", "ARBitrary", "DC")),),
    query=_selected,
    takes_s=SWITCH_S,
    reads=True,
)
def _select(model: _Model, function: str) -> None:
    model.rules.select("USER" if function == "ARB" else function)
    model.tune_arbitrary()
    model.update()


OWN = (
    *ROWS,
    scpi.Command(
        "APPLy:DC",
        tuple(scpi.Number(unit=unit, required=unit == "V", deferred=True) for unit in ("HZ", ("V", "VPP"), "V")),
        do=_apply_dc,
        takes_s=SWITCH_S,
    ),
    setting(
        "[SOURce:]FUNCtion:SQUare:DCYCle",
        scpi.Number(unit="PCT", limits=_square_duty_limits),
        "state.duty_percent",
        _nr3,
    ),
    scpi.Command(
        "[SOURce:]FUNCtion:PULSe:PERiod",
        (scpi.Number(unit="S", limits=_period_limits),),
        do=lambda model, seconds: model.set_frequency(1.0 / seconds),
        query=lambda model: 1.0 / model.state.frequency_hz,
        reply=_nr3,
        takes_s=TUNE_S,
        reads=True,
    ),
    replace(_BURST_COUNT, parameters=(replace(_COUNT, limits=scpi.Limits(1, 1e8)),), reply=_nr3),
    setting(
        "[SOURce:]BURSt:INTernal:PERiod",
        scpi.Number(unit="S", limits=scpi.Limits(1e-6, LONGEST_BURST_S), name="burst period"),
        "state.burst_period_s",
        _nr3,
    ),
    _limit("limit_high_v"),
    _limit("limit_low_v"),
    scpi.Command(
        "[SOURce:]FUNCtion:ARBitrary",
        (_Name(),),
        do=lambda model, name: model.choose_arbitrary(name),
        query=lambda model: path(model.state.user),
        reply=scpi.quoted,
        reads=True,
    ),
    scpi.attribute(
        "[SOURce:]FUNCtion:ARBitrary:SRATe",
        scpi.Number(limits=lambda model: scpi.Limits(1e-6, model.series.sample_rate_hz, 40e3)),
        "state.sample_rate_hz",
        _nr3,
        then=_retune,
    ),
    *(_arbitrary_rate(*row) for row in (("FREQuency", "HZ", 1), ("PERiod", "S", -1))),
    replace(_AMPLITUDE, pattern="[SOURce:]FUNCtion:ARBitrary:PTPeak"),
    scpi.attribute(
        "[SOURce:]FUNCtion:PRBS:BRATe",
        scpi.Number(limits=lambda model: scpi.Limits(1e-3, model.series.bits_hz, 1e3)),
        "state.bit_rate_hz",
        _nr3,
        then=_retune,
    ),
    setting("[SOURce:]FUNCtion:PRBS:DATA", scpi.Choice(("PN7",)), "state.sequence"),
    scpi.Command("[SOURce:]FUNCtion:ARBitrary:POINts", query=_points, reply=scpi.signed_integer, reads=True),
    setting("[SOURce:]FUNCtion:ARBitrary:FILTer", scpi.Choice(("NORMal", "STEP", "OFF")), "state.filter"),
    setting("[SOURce:]FUNCtion:ARBitrary:ADVance", scpi.Choice(("TRIGger", "SRATe")), "state.advance"),
    # both edges are one: what is set of one is set of the other
    *(replace(_EDGE, pattern=f"[SOURce:]FUNCtion:PULSe:TRANsition:{edge}") for edge in ("LEADing", "TRAiling")),
    scpi.Command("[SOURce:]PHASe:SYNChronize", do=lambda _: None),
    scpi.Command("ABORt", do=lambda _: None),
    scpi.Command("INITiate[:IMMediate][:ALL]", do=_initiate),
    scpi.attribute("INITiate:CONTinuous", scpi.Boolean(), "state.continuous", scpi.boolean),
    mode_switch("[SOURce:]BPSK:STATe", "BPSK"),
    setting(
        "[SOURce:]BPSK:INTernal:RATE", scpi.Number(unit="HZ", limits=scpi.Limits(1e-3, 1e6)), "state.bpsk.rate_hz", _nr3
    ),
    setting("[SOURce:]BPSK:SOURce", _SOURCES, "state.bpsk.source"),
    setting("[SOURce:]BPSK[:PHASe]", scpi.Number(limits=scpi.Limits(0.0, 360.0)), "state.bpsk_phase_deg", _nr3),
    mode_switch("[SOURce:]SUM:STATe", "SUM"),
    setting("[SOURce:]SUM:AMPLitude", scpi.Number(limits=scpi.Limits(0.0, 100.0)), "state.sum_percent", _nr3),
    setting(
        "[SOURce:]SUM:INTernal:FREQuency",
        scpi.Number(unit="HZ", limits=scpi.Limits(1e-6, 20e6)),
        "state.sum.frequency_hz",
        _nr3,
    ),
    setting("[SOURce:]SUM:SOURce", _SOURCES, "state.sum.source"),
    setting("OUTPut:MODE", scpi.Choice(("NORMal", "GATed")), "state.gating"),
    *(
        _as_here(replace(each, pattern=f"[SOURce:]{each.pattern}", query_parameters=(_Name(required=False),)))
        for each in arbitrary_commands.COMMANDS
        if each.pattern.startswith("DATA:ATTRibute")
    ),
    scpi.Command(
        "[SOURce:]DATA:VOLatile:FREE", query=lambda m: m.waveforms.free(), reply=scpi.signed_integer, reads=True
    ),
    setting("[SOURce:]COMBine:FEED", scpi.Choice(("NONE", "CH<1-2>")), "state.combined"),
    setting("[SOURce:]TRACk", scpi.Choice(("OFF", "ON", "INVerted")), "state.tracking"),
    setting("[SOURce:]VOLTage:COUPle[:STATe]", scpi.Boolean(), "state.levels_coupled", scpi.boolean),
    setting("[SOURce:]FREQuency:COUPle[:STATe]", scpi.Boolean(), "state.frequencies_coupled", scpi.boolean),
    # told, and nothing else: there are no lists, no timer, one Sync connector (limits and defaults unverified)
    scpi.attribute("[SOURce:]AM:DSSC", scpi.Boolean(), "state.suppressed", scpi.boolean),
    scpi.attribute("[SOURce:]SWEep:HTIMe", scpi.Number(unit="S", limits=_SWEEP_REST_S), "state.hold_s", _nr3),
    scpi.attribute("[SOURce:]SWEep:RTIMe", scpi.Number(unit="S", limits=_SWEEP_REST_S), "state.return_s", _nr3),
    scpi.attribute(
        "[SOURce:]FUNCtion:NOISe:BANDwidth",
        scpi.Number(unit="HZ", limits=lambda model: scpi.Limits(1e-3, model.kind.frequency_hz["NOIS"][1], 1e5)),
        "state.noise_hz",
        _nr3,
    ),
    scpi.attribute("[SOURce:]FREQuency:MODE", scpi.Choice(("CW", "LIST", "SWEep", "FIXed")), "state.frequency_mode"),
    scpi.attribute("TRIGger:COUNt", scpi.Number(limits=scpi.Limits(1, 1e6, 1)), "state.trigger_count", _nr3),
    scpi.attribute("TRIGger:TIMer", scpi.Number(unit="S", limits=scpi.Limits(1e-6, 8e3, 1)), "state.timer_s", _nr3),
    scpi.remembered("OUTPut:SYNC:SOURce", scpi.Choice(("CH1", "CH2")), "CH1"),
    scpi.remembered("ROSCillator:SOURce", scpi.Choice(("INTernal", "EXTernal")), "INT"),
    scpi.remembered("ROSCillator:SOURce:AUTO", scpi.Boolean(), default=False, reply=scpi.boolean),
    scpi.Command(
        "*OPT", query=lambda _model: "0", reads=True
    ),  # IEEE 488.2, 10.20: there is none (unverified of the series)
    scpi.Command(
        "SYSTem:ERRor:COUNt", query=lambda model: len(model.engine.errors), reply=scpi.signed_integer, reads=True
    ),
    *scpi.status_commands("OPERation", "operation"),
    scpi.Command(
        "[SOURce:]DATA:VOLatile:CATalog",
        query=lambda model: ",".join(map(scpi.quoted, model.waveforms.names())),
        reads=True,
    ),
    setting("FORMat:BORDer", scpi.Choice(("NORMal", "SWAPped")), "state.order"),
)


_TIES = re.compile(r"COUPle\[|COMBine|TRACk")
_MODULATING = re.compile(r"(AM|FM|PM|PWM):SOURce$")


@cache
def table(channels: int) -> scpi.CommandTable:
    """Return the commands of a model with so many channels; what ties channels needs two."""
    commands = tuple(each for each in (*_inherited(), *OWN) if channels == 2 or not _TIES.search(each.pattern))
    if channels == 2:
        commands = tuple(
            replace(each, parameters=(_OTHER_CHANNEL,)) if _MODULATING.search(each.pattern) else each
            for each in commands
        )
    ways = (_spelled, _of_second)[:channels]
    return scpi.CommandTable(*scpi.COMMON_COMMANDS, *(each for way in ways for row in commands for each in way(row)))
