"""Guard of the supply (E3631A, commands after guide E3631-90002 p. 84-108)."""

from __future__ import annotations

from dataclasses import dataclass, field
from functools import partial
from types import MappingProxyType
from typing import TYPE_CHECKING

from vcfbench.bench.guard.message import AMPERE, VOLT, Unreadable, quantity, switch
from vcfbench.bench.guard.rules import BeyondLimit, acted_out, at_most, is_one_of, rule_of

if TYPE_CHECKING:
    from collections.abc import Callable, Mapping

    from vcfbench.bench.description import BenchDescription, Limits, RailWiring
    from vcfbench.bench.guard.message import MessagePart
    from vcfbench.bench.guard.rules import Ask

_OUTPUTS = ("P6V", "P25V", "N25V")
_VOLT_WORDS: Mapping[str, Mapping[str, float]] = MappingProxyType(
    {
        # guide p. 91: the maximum of the negative output is its most negative voltage
        "P6V": {"MINimum": 0.0, "MAXimum": 6.18, "DEFault": 0.0},
        "P25V": {"MINimum": 0.0, "MAXimum": 25.75, "DEFault": 0.0},
        "N25V": {"MINimum": 0.0, "MAXimum": -25.75, "DEFault": 0.0},
    }
)
_AMP_WORDS: Mapping[str, Mapping[str, float]] = MappingProxyType(
    {
        "P6V": {"MINimum": 0.0, "MAXimum": 5.15, "DEFault": 5.0},
        "P25V": {"MINimum": 0.0, "MAXimum": 1.03, "DEFault": 1.0},
        "N25V": {"MINimum": 0.0, "MAXimum": 1.03, "DEFault": 1.0},
    }
)
_HARMLESS = (
    *("*CLS", "*ESE", "*SRE", "*OPC", "*PSC", "*WAI", "*SAV", "STATus...", "DISPlay...", "SYSTem...", "ABORt"),
    *("INSTrument:COUPle...", "TRIGger[:SEQuence]:DELay", "TRIGger[:SEQuence]:SOURce"),
)
"""INITiate and ``*TRG`` are not among them: levels that wait for a trigger cannot all be read back. Nor is ``*RCL``."""


@dataclass(slots=True)
class _State:
    """Settings of the supply."""

    selected: str
    tracking: bool
    on: bool
    volts: dict[str, float] = field(default_factory=dict)
    amps: dict[str, float] = field(default_factory=dict)

    @classmethod
    def asked(cls, ask: Ask) -> _State:
        """Ask the supply."""
        levels = {name: ask(f"APPL? {name}").strip('" ').split(",") for name in _OUTPUTS}
        # asked last: the guide does not say whether APPLy? selects the output that it is asked for
        state = cls(ask("INST:SEL?").strip().upper(), switch(ask("OUTP:TRAC?")), switch(ask("OUTP?")))
        for name, (volts, amps) in levels.items():
            state.volts[name], state.amps[name] = float(volts), float(amps)
        return state


def supply_rules(description: BenchDescription) -> SupplyRules:
    """Return the rules of the bench's supply."""
    return SupplyRules(description.limits, description.wiring.rails)


class RailWindow:
    """Limits of the bench for an output: its voltage by the rail that it feeds, and its current."""

    def __init__(self, limits: Limits, rails: RailWiring) -> None:
        self._limits = limits
        self._polarity: dict[str, float] = {rails.positive: 1.0, rails.negative: -1.0}

    def require_level(self, name: str, volts: float) -> None:
        """Raise Beyond for a voltage, with the sign of its rail, that is neither 0 nor in the window."""
        if volts == 0.0:
            return
        if name not in self._polarity:
            raise BeyondLimit(f"{name} {volts:g} V: the output feeds no rail of the bench")
        low, high = self._limits.of("min_rail_v"), self._limits.of("max_rail_v")
        if not low <= volts * self._polarity[name] <= high:
            raise BeyondLimit(
                f"{name} {volts:g} V is outside the bench's rail window of {low:g} to {high:g} V, either sign"
            )

    def require_current(self, name: str, amps: float) -> None:
        """Raise Beyond for a current limit above that of the rails."""
        at_most(f"{name} current limit", amps, self._limits.of("max_rail_current_a"), "A")


class SupplyRules:
    """Voltages within the window of the rails, current limits within theirs; outputs that feed no rail stay at 0 V.

    What is set counts whether the outputs are on or not; when they are or go on, everything that is set already too.
    """

    def __init__(self, limits: Limits, rails: RailWiring) -> None:
        self._window = RailWindow(limits, rails)
        self._rules: dict[str, Callable[[_State, MessagePart], None]] = {
            "APPLy": self._apply,
            "INSTrument[:SELect]": self._select,
            "INSTrument:NSELect": self._select_number,
            "[SOURce:]VOLTage[:LEVel][:IMMediate][:AMPLitude]": self._volts,
            "[SOURce:]VOLTage[:LEVel]:TRIGgered[:AMPLitude]": self._waiting_volts,
            "[SOURce:]CURRent[:LEVel][:IMMediate][:AMPLitude]": self._amps,
            "[SOURce:]CURRent[:LEVel]:TRIGgered[:AMPLitude]": self._waiting_amps,
            "OUTPut[:STATe]": self._switch,
            "OUTPut:TRACk[:STATe]": self._track,
            "*RST": self._reset,
        }

    def judge(self, message: str, ask: Ask) -> None:
        """Raise Beyond or Unreadable when `message` may not be sent."""
        for state, _ in acted_out(message, ask, _State.asked, partial(rule_of, self._rules), _passes):
            if state.on:
                self._require_ready(state)

    def _apply(self, state: _State, part: MessagePart) -> None:
        name = self._known(part.argument(0))
        state.selected = name
        if len(part.arguments) > 1:
            self._level(state, name, quantity(part.arguments[1], VOLT, _VOLT_WORDS[name]))
        if len(part.arguments) > 2:
            self._limit(state, name, quantity(part.arguments[2], AMPERE, _AMP_WORDS[name]))

    def _select(self, state: _State, part: MessagePart) -> None:
        state.selected = self._known(part.argument(0))

    def _select_number(self, state: _State, part: MessagePart) -> None:
        number = quantity(part.argument(0), {"": 1.0})
        if number not in {1.0, 2.0, 3.0}:
            raise Unreadable(f"there is no output {number:g}")
        state.selected = _OUTPUTS[int(number) - 1]

    def _volts(self, state: _State, part: MessagePart) -> None:
        part.require(1)
        name = self._known(state.selected)
        self._level(state, name, quantity(part.arguments[0], VOLT, _VOLT_WORDS[name]))

    def _waiting_volts(self, state: _State, part: MessagePart) -> None:
        part.require(1)
        name = self._known(state.selected)
        self._window.require_level(name, quantity(part.arguments[0], VOLT, _VOLT_WORDS[name]))

    def _amps(self, state: _State, part: MessagePart) -> None:
        part.require(1)
        name = self._known(state.selected)
        self._limit(state, name, quantity(part.arguments[0], AMPERE, _AMP_WORDS[name]))

    def _waiting_amps(self, state: _State, part: MessagePart) -> None:
        part.require(1)
        name = self._known(state.selected)
        self._window.require_current(name, quantity(part.arguments[0], AMPERE, _AMP_WORDS[name]))

    def _switch(self, state: _State, part: MessagePart) -> None:
        part.require(1)
        state.on = switch(part.arguments[0])

    def _track(self, state: _State, part: MessagePart) -> None:
        part.require(1)
        state.tracking = switch(part.arguments[0])
        if state.tracking:  # enabling copies the +25 V level to -25 V (guide p. 92)
            self._level(state, "P25V", state.volts["P25V"])

    @staticmethod
    def _reset(state: _State, _part: MessagePart) -> None:
        state.selected, state.tracking, state.on = "P6V", False, False
        state.volts = {name: words["DEFault"] for name, words in _VOLT_WORDS.items()}
        state.amps = {name: words["DEFault"] for name, words in _AMP_WORDS.items()}

    @staticmethod
    def _known(name: str) -> str:
        if name not in _OUTPUTS:
            raise Unreadable(f"{name!r} is no output of the supply")
        return name

    def _level(self, state: _State, name: str, volts: float) -> None:
        self._window.require_level(name, volts)
        state.volts[name] = volts
        if state.tracking and name != "P6V":
            twin = "N25V" if name == "P25V" else "P25V"
            self._window.require_level(twin, -volts)
            state.volts[twin] = -volts

    def _limit(self, state: _State, name: str, amps: float) -> None:
        self._window.require_current(name, amps)
        state.amps[name] = amps

    def _require_ready(self, state: _State) -> None:
        """Check everything that is set: the outputs are on."""
        for name, volts in state.volts.items():
            if volts != 0.0:
                self._window.require_level(name, volts)
                self._window.require_current(name, state.amps[name])


def _passes(part: MessagePart) -> bool:
    return is_one_of(part, _HARMLESS)
