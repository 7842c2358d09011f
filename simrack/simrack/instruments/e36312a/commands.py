"""The command list of the E36312A (E36300 Series Programming Guide, as users' drivers quote it)."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

from simrack.instruments.e3631a.kinds import KINDS
from simrack.instruments.e3631a.system_commands import STATUS_COMMANDS
from simrack.instruments.e36312a.instrument import SimulatedE36312A
from simrack.scpi import (
    COMMON_COMMANDS,
    Boolean,
    Choice,
    Command,
    CommandTable,
    Integer,
    Limits,
    Number,
    Parameter,
    Rows,
    ScpiError,
    Special,
    Text,
    attribute,
    boolean,
    next_error,
    quoted,
    real,
    remembered,
    signed_integer,
    status_commands,
)
from simrack.scpi.lexer import Token, TokenKind

ROWS = Rows()

_NAMES = tuple(kind.name for kind in KINDS)
_PROGRAMMING_S, _READBACK_S = 0.01, 0.02
"""Command processing is below 10 ms (EDU36311A data sheet, as quoted); a read-back is unverified."""
_NR3 = real(8)

Names = tuple[str, ...]


class _Channels(Parameter, frozen=True, kw_only=True):
    """A channel list, ``(@1,3)`` or ``(@1:3)``, or ``CH1``; the selected output where there is none."""

    def parse(self, token: Token) -> Any:
        """Return the names of the outputs; -224 for a channel that is not there (unverified)."""
        if token.kind is TokenKind.WORD and token.text[:2] == "CH":
            return tuple(_NAMES[number - 1] for number in _range(token.text[2:]))
        if token.kind is not TokenKind.EXPRESSION or not token.text.startswith("@"):
            raise self.refuse_kind(token)
        return tuple(_NAMES[number - 1] for part in token.text[1:].split(",") for number in _range(part))


class _ChannelsOrWord(_Channels, frozen=True, kw_only=True):
    """A channel list, or MIN, MAX or DEF."""

    def parse(self, token: Token) -> Any:
        """Return names, or the special number of a word."""
        if token.kind is TokenKind.WORD and token.text[:2] != "CH":
            return Special[Choice(tuple(each.value for each in Special)).parse(token)]
        return super().parse(token)


def _range(text: str) -> range:
    first, colon, last = (piece.strip() for piece in text.partition(":"))
    if not first.isdecimal() or (colon and not last.isdecimal()):
        raise ScpiError(-171)
    low, high = int(first), int(last) if colon else int(first)
    if not 1 <= low <= high <= len(_NAMES):
        raise ScpiError(-224)
    return range(low, high + 1)


_LIST = _Channels(required=False)
_ON_OFF = Boolean()


def _of(supply: SimulatedE36312A, names: Names | None) -> Names:
    return (supply.selected,) if names is None else names


def _listed(reply: Callable[[Any], str]) -> Callable[[list[Any]], str]:
    return lambda values: ",".join(map(reply, values))


def _terminal(name: str, value: float) -> float:
    """Return a voltage at the terminals of the output, of one of its rail, and the other way round."""
    return (-value if name == "N25V" else value) + 0.0


# --- levels ---------------------------------------------------------------------------------------------------------


def _limits(supply: SimulatedE36312A, name: str, what: str) -> Limits:
    kind = supply.outputs[name].kind
    if what == "VOLT":
        return Limits(0.0, abs(kind.volts.maximum), 0.0)
    return Limits(2e-3 if name == "P6V" else 1e-3, kind.amps.maximum, kind.rated_a)


def _level(what: str, unit: str, header: str, *, triggered: bool = False) -> Command:
    immediate = "volts" if what == "VOLT" else "amps"
    waiting = f"triggered_{immediate}"

    def parameter(supply: SimulatedE36312A, name: str) -> Number:
        return Number(unit=unit, limits=_limits(supply, name, what))

    def write(supply: SimulatedE36312A, value: Any, names: Names | None) -> None:
        levels = {name: parameter(supply, name).settle(value, supply) for name in _of(supply, names)}
        for name, level in levels.items():
            if triggered:
                setattr(supply.outputs[name], waiting, _terminal(name, level) if what == "VOLT" else level)
            elif what == "VOLT":
                supply.program(name, volts=_terminal(name, level))
            else:
                supply.program(name, amps=level)

    def read(supply: SimulatedE36312A, which: Any, names: Names | None) -> list[float]:
        if isinstance(which, Special):
            return [parameter(supply, name).special(which, supply) for name in _of(supply, names)]
        outputs = [(name, supply.outputs[name]) for name in _of(supply, which)]
        levels = [(name, getattr(each, immediate)) for name, each in outputs]
        if triggered:
            coming = [getattr(each, waiting) for _, each in outputs]
            levels = [(name, now if then is None else then) for (name, now), then in zip(levels, coming, strict=True)]
        return [_terminal(name, level) if what == "VOLT" else level for name, level in levels]

    return Command(
        header,
        (Number(unit=unit, deferred=True), _LIST),
        do=write,
        query=read,
        query_parameters=(_ChannelsOrWord(required=False), _LIST),
        reply=_listed(_NR3),
        takes_s=_PROGRAMMING_S,
    )


_IDENTIFIER = Choice((*_NAMES, "CH<1-3>"))


def _named(identifier: str) -> str:
    return _NAMES[int(identifier[2:]) - 1] if identifier.startswith("CH") else identifier


def _applied(supply: SimulatedE36312A, identifier: str | None) -> str:
    name = supply.selected if identifier is None else _named(identifier)
    output = supply.outputs[name]
    return f"{_terminal(name, output.volts):.6f},{output.amps:.6f}"


@ROWS.attribute(
    "INSTrument:NSELect",
    Integer(limits=Limits(1, 3), named=False),
    "output.kind.number",
    signed_integer,
    query_parameters=(),
)
def _select_number(supply: SimulatedE36312A, number: int) -> None:
    supply.selected = _NAMES[number - 1]


# --- switches, protection, measurements -----------------------------------------------------------------------------


def _kept(attribute: str, header: str, parameter: Parameter, reply: Callable[[Any], str]) -> Command:
    def write(supply: SimulatedE36312A, value: Any, names: Names | None) -> None:
        kept = getattr(supply, attribute)
        kept.update({name: bool(value) if isinstance(parameter, Boolean) else value for name in _of(supply, names)})
        supply.regulate()

    def read(supply: SimulatedE36312A, names: Names | None) -> list[Any]:
        return [getattr(supply, attribute)[name] for name in _of(supply, names)]

    return Command(header, (parameter, _LIST), do=write, query=read, query_parameters=(_LIST,), reply=_listed(reply))


def _tripped(cause: str) -> Callable[..., list[bool]]:
    def read(supply: SimulatedE36312A, names: Names | None) -> list[bool]:
        supply.observe()
        return [supply.tripped[name] == cause for name in _of(supply, names)]

    return read


def _clear(supply: SimulatedE36312A, names: Names | None) -> None:
    supply.tripped.update(dict.fromkeys(_of(supply, names), ""))


def _measure_volts(supply: SimulatedE36312A, names: Names | None) -> list[float]:
    supply.observe()
    return [_terminal(name, supply.outputs[name].voltage_reading()) for name in _of(supply, names)]


def _measure_amps(supply: SimulatedE36312A, names: Names | None) -> list[float]:
    supply.observe()
    return [supply.outputs[name].current_reading() for name in _of(supply, names)]


def _measurement(header: str, read: Callable[..., list[float]]) -> Command:
    return Command(header, query=read, query_parameters=(_LIST,), reply=_listed(_NR3), query_takes_s=_READBACK_S)


_SLOT = (Integer(limits=Limits(0, 9), named=False),)


@ROWS.do(
    "APPLy",
    (_IDENTIFIER, Number(unit="V", deferred=True, required=False), Number(unit="A", deferred=True, required=False)),
    query=_applied,
    query_parameters=(Choice((*_NAMES, "CH<1-3>"), required=False),),
    reply=quoted,
    takes_s=_PROGRAMMING_S,
)
def _apply(supply: SimulatedE36312A, identifier: str, volts: Any, amps: Any) -> None:
    name = _named(identifier)
    if volts is not None:
        volts = _terminal(name, Number(unit="V", limits=_limits(supply, name, "VOLT")).settle(volts, supply))
    if amps is not None:
        amps = Number(unit="A", limits=_limits(supply, name, "CURR")).settle(amps, supply)
    supply.program(name, volts=volts, amps=amps)


@ROWS.do("INITiate[:IMMediate]", (_LIST,))
def _initiate(supply: SimulatedE36312A, names: Names | None) -> None:
    """INITiate: outputs wait for their trigger; with the source IMMediate it has come."""
    for name in _of(supply, names):
        if supply.trigger_sources[name] == "IMM":
            supply.transfer_of(name)
        else:
            supply.awaiting.add(name)


@ROWS.do("*TRG")
def _trigger(supply: SimulatedE36312A) -> None:
    if not supply.awaiting:
        raise ScpiError(-211)
    for name in sorted(supply.awaiting):
        supply.transfer_of(name)


@ROWS.do("STATus:PRESet")
def _preset_status(supply: SimulatedE36312A) -> None:
    for register in (supply.questionable, supply.operation, supply.instrument_summary):
        register.enable = 0


TABLE = CommandTable(
    *ROWS,
    *COMMON_COMMANDS,
    *STATUS_COMMANDS,
    _level("VOLT", "V", "[SOURce:]VOLTage[:LEVel][:IMMediate][:AMPLitude]"),
    _level("CURR", "A", "[SOURce:]CURRent[:LEVel][:IMMediate][:AMPLitude]"),
    _level("VOLT", "V", "[SOURce:]VOLTage[:LEVel]:TRIGgered[:AMPLitude]", triggered=True),
    _level("CURR", "A", "[SOURce:]CURRent[:LEVel]:TRIGgered[:AMPLitude]", triggered=True),
    _kept("trigger_sources", "TRIGger[:SEQuence]:SOURce", Choice(("BUS", "IMMediate")), str),
    Command("ABORt", (_LIST,), do=lambda supply, names: supply.awaiting.difference_update(_of(supply, names))),
    _kept("sense", "[SOURce:]VOLTage:SENSe[:SOURce]", Choice(("INTernal", "EXTernal")), str),
    _kept("rise_delay_s", "OUTPut:DELay:RISE", Number(unit="S", limits=Limits(0.0, 3600.0)), _NR3),
    _kept("fall_delay_s", "OUTPut:DELay:FALL", Number(unit="S", limits=Limits(0.0, 3600.0)), _NR3),
    remembered("SYSTem:COMMunicate:RLSTate", Choice(("LOCal", "REMote", "RWLock")), "REM"),
    Command("SYSTem:ERRor:COUNt", query=lambda supply: len(supply.engine.errors), reply=signed_integer),
    *status_commands("QUEStionable", "questionable", lacking=("event", "enable")),
    *status_commands("OPERation", "operation"),
    attribute(
        "INSTrument[:SELect]", _IDENTIFIER, "selected", lambda name: f"CH{_NAMES.index(name) + 1}", convert=_named
    ),
    Command(
        "OUTPut[:STATe]",
        (_ON_OFF, _LIST),
        do=lambda supply, state, names: supply.switch(_of(supply, names), on=bool(state)),
        query=lambda supply, names: [supply.switched[name] for name in _of(supply, names)],
        query_parameters=(_LIST,),
        reply=_listed(boolean),
        takes_s=_PROGRAMMING_S,
    ),
    remembered("OUTPut:PAIR", Choice(("OFF",)), "OFF"),
    Command("OUTPut:PROTection:CLEar", (_LIST,), do=_clear),
    _kept("over_v", "[SOURce:]VOLTage:PROTection[:LEVel]", Number(unit="V", limits=Limits(0.0, 27.5)), _NR3),
    _kept("over_v_on", "[SOURce:]VOLTage:PROTection:STATe", _ON_OFF, boolean),
    _kept("over_a_on", "[SOURce:]CURRent:PROTection:STATe", _ON_OFF, boolean),
    Command(
        "[SOURce:]VOLTage:PROTection:TRIPped", query=_tripped("OV"), query_parameters=(_LIST,), reply=_listed(boolean)
    ),
    Command(
        "[SOURce:]CURRent:PROTection:TRIPped", query=_tripped("OC"), query_parameters=(_LIST,), reply=_listed(boolean)
    ),
    Command("[SOURce:]VOLTage:PROTection:CLEar", (_LIST,), do=_clear),
    Command("[SOURce:]CURRent:PROTection:CLEar", (_LIST,), do=_clear),
    _measurement("MEASure[:SCALar][:VOLTage][:DC]", _measure_volts),
    _measurement("MEASure[:SCALar]:CURRent[:DC]", _measure_amps),
    attribute("DISPlay[:WINDow]:TEXT[:DATA]", Text(), "display_text", quoted, convert=lambda text: text[:12]),
    Command("DISPlay[:WINDow]:TEXT:CLEar", do=lambda supply: setattr(supply, "display_text", "")),
    Command("SYSTem:BEEPer[:IMMediate]", do=lambda _: None),
    Command("SYSTem:ERRor:NEXT", query=next_error),
    Command("SYSTem:VERSion", query=lambda _: "1999.0"),
    *(Command(f"SYSTem:{word}", do=lambda _: None) for word in ("LOCal", "REMote", "RWLock")),
    Command("*OPT", query=lambda _: "0"),  # IEEE 488.2, 10.20: there is none (unverified of the model)
    Command("*TST", query=lambda _: 0, reply=signed_integer, query_takes_s=1.0),
    Command("*SAV", _SLOT, do=lambda supply, slot: supply.save(slot)),
    Command("*RCL", _SLOT, do=lambda supply, slot: supply.recall(slot)),
)
