"""The command list of the E36312A (E36300 Series Programming Guide, as users' drivers quote it)."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

from simrack import scpi
from simrack.instruments.e3631a.kinds import KINDS
from simrack.instruments.e3631a.system_commands import STATUS_COMMANDS
from simrack.instruments.e36312a.instrument import SimulatedE36312A
from simrack.scpi.lexer import Token, TokenKind

ROWS = scpi.Rows()

_NAMES = tuple(kind.name for kind in KINDS)
_PROGRAMMING_S, _READBACK_S = 0.01, 0.02
"""Command processing is below 10 ms (EDU36311A data sheet, as quoted); a read-back is unverified."""
_NR3 = scpi.real(8)

Names = tuple[str, ...]


class _Channels(scpi.Parameter, frozen=True, kw_only=True):
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
            return scpi.Special[scpi.Choice(tuple(each.value for each in scpi.Special)).parse(token)]
        return super().parse(token)


def _range(text: str) -> range:
    first, colon, last = (piece.strip() for piece in text.partition(":"))
    if not first.isdecimal() or (colon and not last.isdecimal()):
        raise scpi.ScpiError(-171)
    low, high = int(first), int(last) if colon else int(first)
    if not 1 <= low <= high <= len(_NAMES):
        raise scpi.ScpiError(-224)
    return range(low, high + 1)


_LIST = _Channels(required=False)
_ON_OFF = scpi.Boolean()


def _of(supply: SimulatedE36312A, names: Names | None) -> Names:
    return (supply.selected,) if names is None else names


def _listed(reply: Callable[[Any], str]) -> Callable[[list[Any]], str]:
    return lambda values: ",".join(map(reply, values))


def _terminal(name: str, value: float) -> float:
    """Return a voltage at the terminals of the output, of one of its rail, and the other way round."""
    return (-value if name == "N25V" else value) + 0.0


# --- levels ---------------------------------------------------------------------------------------------------------


def _limits(supply: SimulatedE36312A, name: str, what: str) -> scpi.Limits:
    kind = supply.outputs[name].kind
    if what == "VOLT":
        return scpi.Limits(0.0, abs(kind.volts.maximum), 0.0)
    return scpi.Limits(2e-3 if name == "P6V" else 1e-3, kind.amps.maximum, kind.rated_a)


def _level(what: str, unit: str, header: str, *, triggered: bool = False) -> scpi.Command:
    immediate = "volts" if what == "VOLT" else "amps"
    waiting = f"triggered_{immediate}"

    def parameter(supply: SimulatedE36312A, name: str) -> scpi.Number:
        return scpi.Number(unit=unit, limits=_limits(supply, name, what))

    def write(supply: SimulatedE36312A, value: Any, names: Names | None) -> None:
        levels = {name: parameter(supply, name).settle(value, supply) for name in _of(supply, names)}
        for name, level in levels.items():
            if triggered:
                setattr(supply.outputs[name], waiting, _terminal(name, level) if what == "VOLT" else level)
            elif what == "VOLT":
                if supply.pair != "OFF" and name == "N25V":  # it follows output 2 (number unverified)
                    raise scpi.ScpiError(-221)
                supply.program(name, volts=_terminal(name, level))
            else:
                supply.program(name, amps=level)

    def read(supply: SimulatedE36312A, which: Any, names: Names | None) -> list[float]:
        if isinstance(which, scpi.Special):
            return [parameter(supply, name).special(which, supply) for name in _of(supply, names)]
        outputs = [(name, supply.outputs[name]) for name in _of(supply, which)]
        levels = [(name, getattr(each, immediate)) for name, each in outputs]
        if triggered:
            coming = [getattr(each, waiting) for _, each in outputs]
            levels = [(name, now if then is None else then) for (name, now), then in zip(levels, coming, strict=True)]
        return [_terminal(name, level) if what == "VOLT" else level for name, level in levels]

    return scpi.Command(
        header,
        (scpi.Number(unit=unit, deferred=True), _LIST),
        do=write,
        query=read,
        query_parameters=(_ChannelsOrWord(required=False), _LIST),
        reply=_listed(_NR3),
        takes_s=_PROGRAMMING_S,
        reads=True,
    )


_IDENTIFIER = scpi.Choice((*_NAMES, "CH<1-3>"))


def _named(identifier: str) -> str:
    return _NAMES[int(identifier[2:]) - 1] if identifier.startswith("CH") else identifier


def _applied(supply: SimulatedE36312A, identifier: str | None) -> str:
    name = supply.selected if identifier is None else _named(identifier)
    output = supply.outputs[name]
    return f"{_terminal(name, output.volts):.6f},{output.amps:.6f}"


@ROWS.attribute(
    "INSTrument:NSELect",
    scpi.Integer(limits=scpi.Limits(1, 3), named=False),
    "output.kind.number",
    scpi.signed_integer,
    query_parameters=(),
)
def _select_number(supply: SimulatedE36312A, number: int) -> None:
    supply.selected = _NAMES[number - 1]


# --- switches, protection, measurements -----------------------------------------------------------------------------

_OVER = scpi.Number(unit="V", limits=scpi.Limits(0.0, 27.5))


def _kept(name: str, header: str, parameter: scpi.Parameter, reply: Callable[[Any], str]) -> scpi.Command:
    def write(supply: SimulatedE36312A, value: Any, names: Names | None) -> None:
        kept = bool(value) if isinstance(parameter, scpi.Boolean) else value
        getattr(supply, name).update(dict.fromkeys(_of(supply, names), kept))
        supply.regulate()

    def read(supply: SimulatedE36312A, names: Names | None) -> list[Any]:
        return [getattr(supply, name)[each] for each in _of(supply, names)]

    return scpi.Command(
        header, (parameter, _LIST), do=write, query=read, query_parameters=(_LIST,), reply=_listed(reply), reads=True
    )


def _tripped(header: str, cause: str) -> scpi.Command:
    def read(supply: SimulatedE36312A, names: Names | None) -> list[bool]:
        supply.observe()
        return [supply.tripped[name] == cause for name in _of(supply, names)]

    return scpi.Command(header, query=read, query_parameters=(_LIST,), reply=_listed(scpi.boolean), reads=True)


def _clear(supply: SimulatedE36312A, names: Names | None) -> None:
    supply.tripped.update(dict.fromkeys(_of(supply, names), ""))


def _measure_volts(supply: SimulatedE36312A, names: Names | None) -> list[float]:
    supply.observe()
    read = {name: _terminal(name, supply.outputs[name].voltage_reading()) for name in _of(supply, names)}
    return [0.0 if supply.sense[name] == "EXT" else volts for name, volts in read.items()]


def _measure_amps(supply: SimulatedE36312A, names: Names | None) -> list[float]:
    supply.observe()
    return [supply.outputs[name].current_reading() for name in _of(supply, names)]


def _measurement(header: str, read: Callable[..., list[float]]) -> scpi.Command:
    return scpi.Command(header, query=read, query_parameters=(_LIST,), reply=_listed(_NR3), query_takes_s=_READBACK_S)


_SLOT = (scpi.Integer(limits=scpi.Limits(0, 9), named=False),)


@ROWS.do(
    "APPLy",
    (
        _IDENTIFIER,
        scpi.Number(unit="V", deferred=True, required=False),
        scpi.Number(unit="A", deferred=True, required=False),
    ),
    query=_applied,
    query_parameters=(scpi.Choice((*_NAMES, "CH<1-3>"), required=False),),
    reply=scpi.quoted,
    takes_s=_PROGRAMMING_S,
    reads=True,
)
def _apply(supply: SimulatedE36312A, identifier: str, volts: Any, amps: Any) -> None:
    name = _named(identifier)
    if volts is not None:
        volts = _terminal(name, scpi.Number(unit="V", limits=_limits(supply, name, "VOLT")).settle(volts, supply))
    if amps is not None:
        amps = scpi.Number(unit="A", limits=_limits(supply, name, "CURR")).settle(amps, supply)
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
        raise scpi.ScpiError(-211)
    for name in sorted(supply.awaiting):
        supply.transfer_of(name)


@ROWS.do("STATus:PRESet")
def _preset_status(supply: SimulatedE36312A) -> None:
    for register in (supply.questionable, supply.operation, supply.instrument_summary):
        register.enable = 0


def _couple(supply: SimulatedE36312A, *words: str) -> None:
    """OUTPut:COUPle:CHANnel: these outputs are switched together."""
    named = tuple(_NAMES[int(word[2:]) - 1] for word in words if word.startswith("CH"))
    supply.together = _NAMES if "ALL" in words else named


TABLE = scpi.CommandTable(
    *ROWS,
    *scpi.COMMON_COMMANDS,
    *STATUS_COMMANDS,
    _level("VOLT", "V", "[SOURce:]VOLTage[:LEVel][:IMMediate][:AMPLitude]"),
    _level("CURR", "A", "[SOURce:]CURRent[:LEVel][:IMMediate][:AMPLitude]"),
    _level("VOLT", "V", "[SOURce:]VOLTage[:LEVel]:TRIGgered[:AMPLitude]", triggered=True),
    _level("CURR", "A", "[SOURce:]CURRent[:LEVel]:TRIGgered[:AMPLitude]", triggered=True),
    _kept("trigger_sources", "TRIGger[:SEQuence]:SOURce", scpi.Choice(("BUS", "IMMediate")), str),
    scpi.Command("ABORt", (_LIST,), do=lambda supply, names: supply.awaiting.difference_update(_of(supply, names))),
    _kept("sense", "[SOURce:]VOLTage:SENSe[:SOURce]", scpi.Choice(("INTernal", "EXTernal")), str),
    _kept("rise_delay_s", "OUTPut[:STATe]:DELay:RISE", scpi.Number(unit="S", limits=scpi.Limits(0.0, 3600.0)), _NR3),
    _kept("fall_delay_s", "OUTPut[:STATe]:DELay:FALL", scpi.Number(unit="S", limits=scpi.Limits(0.0, 3600.0)), _NR3),
    scpi.remembered("SYSTem:COMMunicate:RLSTate", scpi.Choice(("LOCal", "REMote", "RWLock")), "REM"),
    scpi.Command(
        "SYSTem:ERRor:COUNt", query=lambda supply: len(supply.engine.errors), reply=scpi.signed_integer, reads=True
    ),
    *scpi.status_commands("QUEStionable", "questionable", lacking=("event", "enable")),
    *scpi.status_commands("OPERation", "operation"),
    scpi.attribute(
        "INSTrument[:SELect]", _IDENTIFIER, "selected", lambda name: f"CH{_NAMES.index(name) + 1}", convert=_named
    ),
    scpi.Command(
        "OUTPut[:STATe]",
        (_ON_OFF, _LIST),
        do=lambda supply, state, names: supply.switch(_of(supply, names), on=bool(state)),
        query=lambda supply, names: [supply.switched[name] for name in _of(supply, names)],
        query_parameters=(_LIST,),
        reply=_listed(scpi.boolean),
        takes_s=_PROGRAMMING_S,
        reads=True,
    ),
    scpi.attribute("OUTPut:PAIR", scpi.Choice(("OFF", "PARallel", "SERies")), "pair"),
    scpi.attribute("OUTPut:TRACk[:STATe]", scpi.Boolean(), "tracking", scpi.boolean, convert=bool),
    scpi.Command(
        "OUTPut[:STATe]:COUPle:CHANnel",
        (scpi.Choice(("ALL", "NONE", "CH<1-3>")),),
        repeat=True,
        do=_couple,
        query=lambda supply: ",".join(f"CH{_NAMES.index(name) + 1}" for name in supply.together) or "NONE",
        reads=True,
    ),
    scpi.Command("OUTPut:PROTection:CLEar", (_LIST,), do=_clear),
    _kept("over_v", "[SOURce:]VOLTage:PROTection[:LEVel][:AMPLitude]", _OVER, _NR3),
    _kept("over_v_on", "[SOURce:]VOLTage:PROTection:STATe", _ON_OFF, scpi.boolean),
    _kept("over_a_on", "[SOURce:]CURRent:PROTection:STATe", _ON_OFF, scpi.boolean),
    _tripped("[SOURce:]VOLTage:PROTection:TRIPped", "OV"),
    _tripped("[SOURce:]CURRent:PROTection:TRIPped", "OC"),
    scpi.Command("[SOURce:]VOLTage:PROTection:CLEar", (_LIST,), do=_clear),
    scpi.Command("[SOURce:]CURRent:PROTection:CLEar", (_LIST,), do=_clear),
    *(
        _measurement(f"{word}[:SCALar]{what}", read)
        for word in ("MEASure", "FETCh")  # it measures all the time
        for what, read in (("[:VOLTage][:DC]", _measure_volts), (":CURRent[:DC]", _measure_amps))
    ),
    scpi.attribute(
        "DISPlay[:WINDow]:TEXT[:DATA]", scpi.Text(), "display_text", scpi.quoted, convert=lambda text: text[:12]
    ),
    scpi.Command("DISPlay[:WINDow]:TEXT:CLEar", do=lambda supply: setattr(supply, "display_text", "")),
    scpi.Command("SYSTem:BEEPer[:IMMediate]", do=lambda _: None),
    scpi.Command("SYSTem:ERRor:NEXT", query=scpi.next_error),
    scpi.Command("SYSTem:VERSion", query=lambda _: "1999.0", reads=True),
    *(scpi.Command(f"SYSTem:{word}", do=lambda _: None) for word in ("LOCal", "REMote", "RWLock")),
    scpi.Command("*OPT", query=lambda _: "0", reads=True),  # IEEE 488.2, 10.20: there is none (unverified of the model)
    scpi.Command("*TST", query=lambda _: 0, reply=scpi.signed_integer, query_takes_s=1.0),
    scpi.Command("*SAV", _SLOT, do=lambda supply, slot: supply.save(slot)),
    scpi.Command("*RCL", _SLOT, do=lambda supply, slot: supply.recall(slot)),
)
