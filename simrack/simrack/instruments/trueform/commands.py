"""The command table of the Trueform series.

Headers are those of a driver that was made from the maker's own SCPI description of the 33500B (users' code), and
replies have the digits of a users' record of a 33600A after ``*RST``: fifteen decimals, thirteen for amplitude, offset
and phases. What stands here is the 33220A's command under the header of the series, and what the series has of its
own. Of a generator's two channels the first is simulated: ``SOURce2:`` and ``OUTPut2`` are -114.
"""

from __future__ import annotations

import math
from typing import TYPE_CHECKING, Any

from msgspec.structs import replace

from simrack.instruments.agilent33220a import (
    burst_commands,
    level_commands,
    modulation_commands,
    output_commands,
    pulse_commands,
    state_commands,
    sweep_commands,
    system_commands,
)
from simrack.instruments.agilent33220a.declarations import SWITCH_S, TUNE_S, nr3, setting
from simrack.instruments.agilent33220a.settings import conflict
from simrack.instruments.trueform.arbitrary import bare_name, path
from simrack.instruments.trueform.kinds import LONGEST_BURST_S
from simrack.scpi import (
    COMMON_COMMANDS,
    Boolean,
    Choice,
    Command,
    CommandTable,
    Limits,
    Number,
    Parameter,
    ScpiError,
    attribute,
    boolean,
    quoted,
    real,
    signed_integer,
)
from simrack.scpi.lexer import Token, TokenKind

if TYPE_CHECKING:
    from collections.abc import Callable

    from simrack.instruments.trueform.instrument import SimulatedTrueform as _Model

_FIFTEEN = real(15)
_THIRTEEN = ("[SOURce:]VOLTage", "[SOURce:]VOLTage:OFFSet", "[SOURce:]PHASe[:ADJust]", "[SOURce:]BURSt:PHASe")
_HEADERS = {
    "[SOURce:]FUNCtion:PULSe:TRANsition": "[SOURce:]FUNCtion:PULSe:TRANsition[:BOTH]",
    "MARKer:FREQuency": "[SOURce:]MARKer:FREQuency",
    "DATA:ATTRibute": "[SOURce:]DATA:ATTRibute",
}
_LEFT_OUT = (
    *("MARKer[:STATe]", "*LRN", "SYSTem:KLOCk", "SYSTem:COMMunicate:RLSTate", "OUTPut:LOAD", "APPLy:USER"),
    *("APPLy:DC", "[SOURce:]FUNCtion[:SHAPe]", "[SOURce:]FUNCtion:SQUare:DCYCle", "[SOURce:]PULSe:PERiod"),
    *("[SOURce:]BURSt:INTernal:PERiod", "[SOURce:]BURSt:NCYCles"),
)
"""What the series does not have, or has in another way."""


def _nr3(value: float) -> str:
    """Format fifteen decimals; a double cannot hold 9.9E37 to so many."""
    return "+9.900000000000000E+37" if value == math.inf else _FIFTEEN(value)


class _Name(Parameter, frozen=True, kw_only=True):
    """The name of a waveform, with quotes, folder and extension or without them."""

    def parse(self, token: Token) -> str:
        """Return it bare."""
        if token.kind not in {TokenKind.WORD, TokenKind.STRING}:
            raise self.refuse_kind(token)
        return bare_name(token.text)


def _inherited() -> list[Command]:
    """Return the 33220A's commands as they stand in the series."""
    modules = (
        *(output_commands, level_commands, pulse_commands, modulation_commands, sweep_commands, burst_commands),
        *(state_commands, system_commands),
    )
    return [
        _as_here(command)
        for module in modules
        for command in module.COMMANDS
        if not command.pattern.startswith(_LEFT_OUT) and command.pattern != "APPLy"
    ]


def _as_here(command: Command) -> Command:
    digits = nr3 if command.pattern in _THIRTEEN else _nr3
    reply = digits if command.reply is nr3 else command.reply
    return replace(command, pattern=_HEADERS.get(command.pattern, command.pattern), reply=reply)


def _spelled(command: Command) -> tuple[Command, ...]:
    """Return a command as it may be said, with the number of its channel or without it."""
    header = command.pattern
    if header.startswith(("OUTPut", "TRIGger")):
        root = header[: 6 if header.startswith("OUTPut") else 7]
        return (_with_channel(command, f"{root}<1-1>{header.removeprefix(root)}"),)
    if header.startswith("APPLy"):
        return command, _with_channel(command, f"SOURce<1-1>:{header}")
    if header.startswith("[SOURce:]"):
        return command, _with_channel(command, f"SOURce<1-1>:{header.removeprefix('[SOURce:]')}")
    return (command,)


def _with_channel(command: Command, header: str) -> Command:
    query = None if command.query is None else _first_channel(command.query)
    do = None if command.do is None else _first_channel(command.do)
    plain = replace(command, pattern=header.replace("SOURce<1-1>:[:", "SOURce<1-1>["))
    return replace(plain, do=do, query=query)


def _first_channel(handler: Callable[..., Any]) -> Callable[..., Any]:
    def called(model: _Model, _channel: int, *arguments: Any) -> Any:
        return handler(model, *arguments)

    return called


# --- functions ------------------------------------------------------------------------------------------------------


def _select(model: _Model, function: str) -> None:
    model.rules.select("USER" if function == "ARB" else function)
    model.tune_arbitrary()
    model.update()


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


def _applied(model: _Model) -> str:
    amplitude, offset = level_commands.amplitude_shown(model), level_commands.offset_shown(model)
    return quoted(f"{_selected(model)} {_nr3(model.state.frequency_hz)},{nr3(amplitude)},{nr3(offset)}")


def _square_duty_limits(model: _Model) -> Limits:
    """Return the duty cycles that leave the least width of a pulse (users' tests: 0.01 % at low frequency)."""
    least = max(0.01, 100.0 * model.kind.least_width_s[math.inf] * model.state.frequency_hz)
    return Limits(least, 100.0 - least, 50.0)


def _period_limits(model: _Model) -> Limits:
    low, high = model.kind.frequency_hz["PULS"]
    return Limits(1.0 / high, 1.0 / low, 1e-3)


# --- limits and load ------------------------------------------------------------------------------------------------


def _limit(name: str) -> Command:
    def limits(model: _Model) -> Limits:
        most = model.levels.max_v()
        return Limits(-most, most, most if name == "limit_high_v" else -most)

    def write(model: _Model, shown_v: float) -> None:
        before = getattr(model.state, name)
        setattr(model.state, name, shown_v / model.levels.share)
        if model.state.limit_on and not model.limited.within_limits():
            setattr(model.state, name, before)
            raise conflict("limit does not hold the present levels")

    return Command(
        f"[SOURce:]VOLTage:LIMit:{'HIGH' if name == 'limit_high_v' else 'LOW'}",
        (Number(unit="V", limits=limits),),
        do=write,
        query=lambda model: getattr(model.state, name) * model.levels.share,
        reply=_nr3,
    )


def _switch_limits(model: _Model, state: object) -> None:
    """Switch the limits; they stay off where the present levels leave them (unverified)."""
    if state and not model.limited.within_limits():
        raise conflict("output limits do not hold the present levels")
    model.state.limit_on = bool(state)


def _set_load(model: _Model, ohm: float) -> None:
    """Change the shown load; not while limits are on, whose load would not be known (guide p. 62)."""
    if model.state.limit_on:
        raise conflict("output termination cannot be changed while voltage limits are enabled")
    model.state.load_ohm = ohm
    if math.isinf(ohm):
        model.state.unit = "VPP"  # guide p. 62


# --- arbitrary waveforms --------------------------------------------------------------------------------------------


def _load(model: _Model, name: str, *points: float) -> None:
    model.waveforms.load_named(name, list(points), model.series.least_points)


def _load_dac(model: _Model, name: str, *codes: float) -> None:
    if any(not -32767 <= code <= 32767 for code in codes):
        raise ScpiError(-222)
    model.waveforms.load_named(name, [code / 32767.0 for code in codes], model.series.least_points)


def _clear(model: _Model) -> None:
    model.waveforms.clear()
    model.choose_arbitrary("EXP_RISE")


def _points(model: _Model) -> int:
    return len(model.waveforms.points(model.state.user))


def _rate_limits(model: _Model) -> Limits:
    return Limits(1e-6, model.series.sample_rate_hz, 40e3)


def _retune(model: _Model) -> None:
    model.tune_arbitrary()
    model.settle()


def _set_arbitrary_hz(model: _Model, hz: float) -> None:
    model.state.sample_rate_hz = hz * _points(model)
    _retune(model)


_BURST_COUNT: Any = next(each for each in burst_commands.COMMANDS if each.pattern.endswith("NCYCles"))

OWN = (
    Command(
        "[SOURce:]FUNCtion[:SHAPe]",
        (Choice(("SINusoid", "SQUare", "TRIangle", "RAMP", "PULSe", "PRBS", "NOISe", "ARBitrary", "DC")),),
        do=_select,
        query=_selected,
        takes_s=SWITCH_S,
    ),
    Command("APPLy", query=_applied),
    Command(
        "APPLy:DC",
        tuple(Number(unit=unit, required=unit == "V", deferred=True) for unit in ("HZ", ("V", "VPP"), "V")),
        do=_apply_dc,
        takes_s=SWITCH_S,
    ),
    setting(
        "[SOURce:]FUNCtion:SQUare:DCYCle", Number(unit="PCT", limits=_square_duty_limits), "state.duty_percent", _nr3
    ),
    Command(
        "[SOURce:]FUNCtion:PULSe:PERiod",
        (Number(unit="S", limits=_period_limits),),
        do=lambda model, seconds: model.set_frequency(1.0 / seconds),
        query=lambda model: 1.0 / model.state.frequency_hz,
        reply=_nr3,
        takes_s=TUNE_S,
    ),
    replace(_BURST_COUNT, parameters=(replace(_BURST_COUNT.parameters[0], limits=Limits(1, 1e8)),), reply=_nr3),
    setting(
        "[SOURce:]BURSt:INTernal:PERiod",
        Number(unit="S", limits=Limits(1e-6, LONGEST_BURST_S), name="burst period"),
        "state.burst_period_s",
        _nr3,
    ),
    attribute("OUTPut:LOAD", level_commands.LOAD, "state.load_ohm", _nr3, do=_set_load),
    _limit("limit_high_v"),
    _limit("limit_low_v"),
    attribute("[SOURce:]VOLTage:LIMit:STATe", Boolean(), "state.limit_on", boolean, do=_switch_limits),
    Command(
        "[SOURce:]FUNCtion:ARBitrary",
        (_Name(),),
        do=lambda model, name: model.choose_arbitrary(name),
        query=lambda model: path(model.state.user),
        reply=quoted,
    ),
    attribute(
        "[SOURce:]FUNCtion:ARBitrary:SRATe", Number(limits=_rate_limits), "state.sample_rate_hz", _nr3, then=_retune
    ),
    Command(
        "[SOURce:]FUNCtion:ARBitrary:FREQuency",
        (Number(unit="HZ"),),
        do=_set_arbitrary_hz,
        query=lambda model: model.state.sample_rate_hz / _points(model),
        reply=_nr3,
    ),
    attribute(
        "[SOURce:]FUNCtion:PRBS:BRATe",
        Number(limits=lambda model: Limits(1e-3, model.series.bits_hz, 1e3)),
        "state.bit_rate_hz",
        _nr3,
        then=_retune,
    ),
    setting("[SOURce:]FUNCtion:PRBS:DATA", Choice(("PN7",)), "state.sequence"),
    Command("[SOURce:]FUNCtion:ARBitrary:POINts", query=_points, reply=signed_integer),
    setting("[SOURce:]FUNCtion:ARBitrary:FILTer", Choice(("NORMal", "STEP", "OFF")), "state.filter"),
    setting("[SOURce:]FUNCtion:ARBitrary:ADVance", Choice(("TRIGger", "SRATe")), "state.advance"),
    Command("[SOURce:]DATA:ARBitrary", (_Name(), Number(limits=Limits(-1.0, 1.0))), do=_load, repeat=True),
    Command("[SOURce:]DATA:ARBitrary:DAC", (_Name(), Number()), do=_load_dac, repeat=True),
    Command("[SOURce:]DATA:VOLatile:CLEar", do=_clear),
    Command("[SOURce:]DATA:VOLatile:CATalog", query=lambda model: ",".join(map(quoted, model.waveforms.names()))),
    setting("FORMat:BORDer", Choice(("NORMal", "SWAPped")), "state.order"),
)

TABLE = CommandTable(*COMMON_COMMANDS, *(each for command in (*_inherited(), *OWN) for each in _spelled(command)))
