"""Guard of a supply with channel lists (E36312A, words as users' drivers quote the E36300 Series guide)."""

from __future__ import annotations

from dataclasses import dataclass
from functools import partial
from typing import TYPE_CHECKING

from vcfbench.bench.guard.message import AMPERE, VOLT, Unreadable, header_pattern, quantity, switch
from vcfbench.bench.guard.rules import acted_out, is_one_of, rule_of
from vcfbench.bench.guard.supply import RailWindow

if TYPE_CHECKING:
    from collections.abc import Callable

    from vcfbench.bench.description import BenchDescription
    from vcfbench.bench.guard.message import MessagePart
    from vcfbench.bench.guard.rules import Ask

_OUTPUTS = ("P6V", "P25V", "N25V")
_LARGEST_V = {"P6V": 6.18, "P25V": 25.75, "N25V": 25.75}
_LARGEST_A = {"P6V": 5.15, "P25V": 1.03, "N25V": 1.03}
_HARMLESS = (
    *("*CLS", "*ESE", "*SRE", "*OPC", "*PSC", "*WAI", "*SAV", "STATus...", "DISPlay...", "SYSTem...", "ABORt..."),
    *("[SOURce:]VOLTage:PROTection[:LEVel]", "[SOURce:]VOLTage:PROTection:STATe"),
    *("[SOURce:]CURRent:PROTection:STATe", "[SOURce:]CURRent:PROTection:DELay...", "SENSe..."),
)
"""Protection only switches off. Clearing it, INITiate, TRIGger and ``*RCL`` may bring back any level (unknown)."""


@dataclass(slots=True)
class _State:
    """Settings of the supply, volts as it says them."""

    selected: str
    on: dict[str, bool]
    volts: dict[str, float]
    amps: dict[str, float]

    @classmethod
    def asked(cls, ask: Ask) -> _State:
        """Ask the supply."""
        on, volts, amps = (ask(f"{what}? (@1,2,3)").split(",") for what in ("OUTP", "VOLT", "CURR"))
        return cls(
            _OUTPUTS[int(ask("INST:NSEL?")) - 1],
            {name: switch(text.strip()) for name, text in zip(_OUTPUTS, on, strict=True)},
            {name: float(text) for name, text in zip(_OUTPUTS, volts, strict=True)},
            {name: float(text) for name, text in zip(_OUTPUTS, amps, strict=True)},
        )


def channel_rules(description: BenchDescription) -> ChannelRules:
    """Return the rules of the bench's supply."""
    return ChannelRules(RailWindow(description.limits, description.wiring.rails))


class ChannelRules:
    """Voltages within the window of the rails, current limits within theirs; an output without a rail stays at 0 V.

    Output 3 is positive by itself and wired the other way round: its voltage counts as that of the negative rail.
    """

    def __init__(self, window: RailWindow) -> None:
        self._window = window
        self._rules: dict[str, Callable[[_State, MessagePart], None]] = {
            "APPLy": self._apply,
            "INSTrument[:SELect]": self._select,
            "INSTrument:NSELect": self._select_number,
            "[SOURce:]VOLTage[:LEVel][:IMMediate][:AMPLitude]": self._volts,
            "[SOURce:]CURRent[:LEVel][:IMMediate][:AMPLitude]": self._amps,
            "OUTPut[:STATe]": self._switch,
            "OUTPut:PAIR": self._pair,
        }

    def judge(self, message: str, ask: Ask) -> None:
        """Raise Beyond or Unreadable when `message` may not be sent."""
        for state, _ in acted_out(message, ask, _State.asked, partial(rule_of, self._rules), _passes):
            for name in _OUTPUTS:
                if state.on[name] and state.volts[name]:
                    self._window.require_level(name, _of_rail(name, state.volts[name]))
                    self._window.require_current(name, state.amps[name])

    def _apply(self, state: _State, part: MessagePart) -> None:
        name = _identified(part.argument(0))
        if len(part.arguments) > 1:
            self._set_volts(state, name, part.arguments[1])
        if len(part.arguments) > 2:
            self._set_amps(state, name, part.arguments[2])

    @staticmethod
    def _select(state: _State, part: MessagePart) -> None:
        state.selected = _identified(part.argument(0))

    @staticmethod
    def _select_number(state: _State, part: MessagePart) -> None:
        state.selected = _numbered(part.argument(0))

    def _volts(self, state: _State, part: MessagePart) -> None:
        for name in _listed(state, part):
            self._set_volts(state, name, part.arguments[0])

    def _amps(self, state: _State, part: MessagePart) -> None:
        for name in _listed(state, part):
            self._set_amps(state, name, part.arguments[0])

    def _set_volts(self, state: _State, name: str, text: str) -> None:
        volts = quantity(text, VOLT, {"MINimum": 0.0, "MAXimum": _LARGEST_V[name], "DEFault": 0.0})
        self._window.require_level(name, _of_rail(name, volts))
        state.volts[name] = volts

    def _set_amps(self, state: _State, name: str, text: str) -> None:
        amps = quantity(text, AMPERE, {"MINimum": 0.0, "MAXimum": _LARGEST_A[name], "DEFault": _LARGEST_A[name]})
        self._window.require_current(name, amps)
        state.amps[name] = amps

    @staticmethod
    def _switch(state: _State, part: MessagePart) -> None:
        for name in _listed(state, part):
            state.on[name] = switch(part.arguments[0])

    @staticmethod
    def _pair(_state: _State, part: MessagePart) -> None:
        if part.argument(0) != "OFF":
            raise Unreadable("what two outputs do as one is not known here")


def _passes(part: MessagePart) -> bool:
    return is_one_of(part, _HARMLESS) or _switches_off(part)


def _switches_off(part: MessagePart) -> bool:
    is_switch = header_pattern("OUTPut[:STATe]").fullmatch(part.path) is not None
    return is_switch and bool(part.arguments) and part.argument(0) in {"OFF", "0"}


def _of_rail(name: str, volts: float) -> float:
    return -volts if name == "N25V" else volts


def _identified(text: str) -> str:
    if text in _OUTPUTS:
        return text
    if not text.startswith("CH"):
        raise Unreadable(f"{text!r} is no output of the supply")
    return _numbered(text[2:])


def _numbered(text: str) -> str:
    if text not in {"1", "2", "3"}:
        raise Unreadable(f"there is no output {text!r}")
    return _OUTPUTS[int(text) - 1]


def _listed(state: _State, part: MessagePart) -> tuple[str, ...]:
    """Return the outputs of a channel list behind the first parameter, the selected one where there is none.

    The commas in the list have made parameters of it.
    """
    text = ",".join(part.arguments[1:]).replace(" ", "")
    if not part.arguments:
        raise Unreadable(f"{part.path} lacks a parameter")
    if not text:
        return (state.selected,)
    if not (text.startswith("(@") and text.endswith(")")):
        raise Unreadable(f"{text!r} is no channel list")
    names: list[str] = []
    for piece in text[2:-1].split(","):
        first, colon, last = piece.partition(":")
        low, high = _OUTPUTS.index(_numbered(first)), _OUTPUTS.index(_numbered(last if colon else first))
        names += _OUTPUTS[low : high + 1]
    return tuple(names)
