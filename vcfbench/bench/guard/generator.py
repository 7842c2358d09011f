"""Guard of a generator (33220A, commands after its guide 33220-90002 as public drivers quote it).

The 33500B and 33600A take the same with the number of the channel behind SOURce, OUTPut and TRIGger.
"""

from __future__ import annotations

import re
from dataclasses import dataclass
from types import MappingProxyType
from typing import TYPE_CHECKING

from vcfbench.bench.guard.message import OHM, VOLT, VPP, Unreadable, header_pattern, quantity, switch
from vcfbench.bench.guard.rules import acted_out, at_most, is_one_of, rule_of

if TYPE_CHECKING:
    from collections.abc import Callable, Mapping

    from vcfbench.bench.description import BenchDescription
    from vcfbench.bench.guard.message import MessagePart
    from vcfbench.bench.guard.rules import Ask

_OPEN_OHM = 9.9e37
_SOURCE_OHM = 50.0
_DEFAULT_VPP = 0.1
_SMALLEST_VPP, _LARGEST_VPP = 0.02, 20.0
"""Into an open circuit (data sheet: 10 mVpp to 10 Vpp into 50 ohm)."""

_LOAD_WORDS: Mapping[str, float] = MappingProxyType(
    {"INFinity": _OPEN_OHM, "MINimum": 1.0, "MAXimum": 10_000.0, "DEFault": 50.0}
)
_HARMLESS = (
    *("*CLS", "*ESE", "*SRE", "*OPC", "*PSC", "*WAI", "*SAV", "*TRG", "TRIGger..."),
    *(
        "STATus...",
        "DISPlay...",
        "SYSTem...",
        "FORMat...",
        "UNIT:ANGLe",
        "PHASe...",
        "OUTPut:POLarity",
        "OUTPut:SYNC...",
    ),
    *("OUTPut:TRIGger...", "[SOURce:]FREQuency...", "[SOURce:]VOLTage:RANGe:AUTO"),
    *("[SOURce:]FUNCtion:SQUare...", "[SOURce:]FUNCtion:RAMP...", "[SOURce:]FUNCtion:PULSe..."),
    *(
        "[SOURce:]FUNCtion:USER",
        "[SOURce:]FUNCtion:ARBitrary...",
        "[SOURce:]VOLTage:LIMit...",
        "[SOURce:]PULSe...",
        "[SOURce:]AM:STATe",
        "[SOURce:]AM:INTernal...",
        "[SOURce:]FM...",
    ),
    *("[SOURce:]PM...", "[SOURce:]PWM...", "[SOURce:]FSKey...", "[SOURce:]SWEep...", "[SOURce:]BURSt..."),
    *("[SOURce:]MARKer...", "[SOURce:]DATA..."),
)
"""None of those makes the peak voltage higher; a waveform in memory is a share of the amplitude."""

_FUNCTIONS = ("SINusoid", "SQUare", "RAMP", "PULSe", "NOISe", "DC", "USER")
_TRUEFORM_FUNCTIONS = (*_FUNCTIONS[:-1], "TRIangle", "ARBitrary", "PRBS")


@dataclass(slots=True)
class _State:
    """Settings of the generator, V as it shows them for the load that it is told.

    `vpp` is None when the amplitude is not known in Vpp; `in_vpp` tells what an amplitude without a unit is taken for.
    """

    function: str
    vpp: float | None
    offset_v: float
    load_ohm: float
    in_vpp: bool

    @classmethod
    def asked(cls, ask: Ask) -> _State:
        """Ask the generator; an amplitude that is not in Vpp is not known."""
        peak_to_peak = ask("VOLT:UNIT?").strip().upper() == "VPP"
        vpp = float(ask("VOLT?")) if peak_to_peak else None
        return cls(
            ask("FUNC?").strip().upper(), vpp, float(ask("VOLT:OFFS?")), float(ask("OUTP:LOAD?")), in_vpp=peak_to_peak
        )

    @property
    def factor(self) -> float:
        """Ratio of the open-circuit voltage to that at the load that the generator is told."""
        return 1.0 if self.load_ohm >= _OPEN_OHM * (1.0 - 1e-9) else (self.load_ohm + _SOURCE_OHM) / self.load_ohm

    def peak_v(self) -> float:
        """Return the peak voltage into an open circuit."""
        if self.function == "DC":
            return self.factor * abs(self.offset_v)
        return self.factor * (abs(self.offset_v) + self.known_vpp() / 2.0)

    def known_vpp(self) -> float:
        """Return the amplitude, which must be known."""
        if self.vpp is None:
            raise Unreadable("the amplitude is not in Vpp; send VOLT:UNIT VPP first")
        return self.vpp

    def smallest_vpp(self) -> float:
        """Return the least amplitude; it keeps low below high."""
        return _SMALLEST_VPP / self.factor

    def levels_v(self) -> tuple[float, float]:
        """Return low and high level."""
        half_v = self.known_vpp() / 2.0
        return self.offset_v - half_v, self.offset_v + half_v


def generator_rules(description: BenchDescription) -> GeneratorRules:
    """Return the rules of a generator of the bench."""
    return GeneratorRules(description.limits.of("max_v_vc_v"))


def trueform_rules(description: BenchDescription) -> TrueformRules:
    """Return the rules of a 33500B or 33600A of the bench."""
    return TrueformRules(GeneratorRules(description.limits.of("max_v_vc_v"), _TRUEFORM_FUNCTIONS))


_FIRST_SOURCE = re.compile(r"(?i)(?:(?<=;)|^)(\s*:?)SOUR(?:CE)?1?:")
_FIRST_OUTPUT = re.compile(r"(?i)(?:(?<=;)|^)(\s*:?(?:OUTP(?:UT)?|TRIG(?:GER)?))1(?=[\s:;?]|$)")


class TrueformRules:
    """The rules of a generator whose first channel is on the bench; they know no command to another channel."""

    def __init__(self, rules: GeneratorRules) -> None:
        self._rules = rules

    def judge(self, message: str, ask: Ask) -> None:
        """Raise Beyond or Unreadable when `message` may not be sent."""
        self._rules.judge(_FIRST_OUTPUT.sub(r"\1", _FIRST_SOURCE.sub(r"\1", message)), ask)


class GeneratorRules:
    """The peak voltage, offset included, stays within the limit into an open circuit, whatever load is told."""

    def __init__(self, max_v: float, functions: tuple[str, ...] = _FUNCTIONS) -> None:
        self._max_v = max_v
        self._functions = functions
        self._rules: dict[str, Callable[[_State, MessagePart], None]] = {
            "[SOURce:]FUNCtion": self._function,
            "[SOURce:]VOLTage[:LEVel][:IMMediate][:AMPLitude]": self._amplitude,
            "[SOURce:]VOLTage[:LEVel][:IMMediate]:OFFSet": self._offset,
            "[SOURce:]VOLTage[:LEVel][:IMMediate]:HIGH": self._high,
            "[SOURce:]VOLTage[:LEVel][:IMMediate]:LOW": self._low,
            "[SOURce:]VOLTage:UNIT": self._unit,
            "[SOURce:]AM:DEPTh": self._depth,
            "OUTPut[:STATe]": self._switch,
            "OUTPut:LOAD": self._load,
            "*RST": self._reset,
        }

    def judge(self, message: str, ask: Ask) -> None:
        """Raise Beyond or Unreadable when `message` may not be sent."""
        for state, rule in acted_out(message, ask, _State.asked, self._rule, _passes):
            if rule != self._unit:  # which changes nothing but what the next amplitude means
                at_most("peak voltage", state.peak_v(), self._max_v, "V (open circuit)")

    def _rule(self, part: MessagePart) -> Callable[[_State, MessagePart], None]:
        if part.path.startswith("APPL"):
            return self._apply
        return rule_of(self._rules, part)

    def _apply(self, state: _State, part: MessagePart) -> None:
        """Take frequency, amplitude, offset; one left out may be the present value or the default: the worse."""
        word = part.path.partition(":")[2]
        state.function = self._known_function(word)
        given = part.arguments
        if state.function == "DC":  # an amplitude is ignored, the one that was set may come back with another function
            pass
        elif len(given) > 1:
            state.vpp = self._vpp(state, given[1])
        elif state.vpp is not None:
            state.vpp = max(state.vpp, _DEFAULT_VPP)
        if len(given) > 2:
            state.offset_v = self._volts(state, given[2])

    def _function(self, state: _State, part: MessagePart) -> None:
        part.require(1)
        state.function = self._known_function(part.argument(0))

    def _amplitude(self, state: _State, part: MessagePart) -> None:
        part.require(1)
        state.vpp = self._vpp(state, part.arguments[0])

    def _offset(self, state: _State, part: MessagePart) -> None:
        part.require(1)
        state.offset_v = self._volts(state, part.arguments[0])

    def _high(self, state: _State, part: MessagePart) -> None:
        part.require(1)
        high = self._volts(state, part.arguments[0])
        self._span(state, min(state.levels_v()[0], high - state.smallest_vpp()), high)

    def _low(self, state: _State, part: MessagePart) -> None:
        part.require(1)
        low = self._volts(state, part.arguments[0])
        self._span(state, low, max(state.levels_v()[1], low + state.smallest_vpp()))

    def _span(self, state: _State, low_v: float, high_v: float) -> None:
        at_most("level", state.factor * max(abs(low_v), abs(high_v)), self._max_v, "V (open circuit)")
        state.vpp, state.offset_v = high_v - low_v, (high_v + low_v) / 2.0

    @staticmethod
    def _unit(state: _State, part: MessagePart) -> None:
        part.require(1)
        state.in_vpp = part.argument(0) == "VPP"

    @staticmethod
    def _depth(_state: _State, part: MessagePart) -> None:
        """Above 100 % the envelope exceeds the amplitude."""
        part.require(1)
        at_most("modulation depth", quantity(part.arguments[0], {"": 1.0, "PCT": 1.0}, {"MINimum": 0.0}), 100.0, "%")

    @staticmethod
    def _switch(_state: _State, part: MessagePart) -> None:
        part.require(1)
        switch(part.arguments[0])

    @staticmethod
    def _load(state: _State, part: MessagePart) -> None:
        """Another load changes the display, not the output (sibling's guide 33210A p. 168)."""
        part.require(1)
        before = state.factor
        state.load_ohm = quantity(part.arguments[0], OHM, _LOAD_WORDS)
        if not state.load_ohm >= 1.0:
            raise Unreadable(f"a load of {state.load_ohm:g} ohm cannot be told")
        scale = before / state.factor
        state.offset_v *= scale
        state.vpp = None if state.vpp is None else state.vpp * scale

    @staticmethod
    def _reset(state: _State, _part: MessagePart) -> None:
        state.function, state.vpp, state.offset_v, state.load_ohm = "SIN", _DEFAULT_VPP, 0.0, _SOURCE_OHM
        state.in_vpp = True

    def _known_function(self, word: str) -> str:
        for spelling in self._functions:
            if header_pattern(spelling).fullmatch(word):
                return spelling
        raise Unreadable(f"there is no function {word!r}")

    def _vpp(self, state: _State, text: str) -> float:
        """Return an amplitude; the largest is the output's, and less than the smallest sets the smallest."""
        if not state.in_vpp and not text.upper().endswith("VPP"):
            raise Unreadable("the amplitude is not in Vpp; send VOLT:UNIT VPP first")
        words = {"MINimum": 0.0, "MAXimum": _LARGEST_VPP / state.factor, "DEFault": _DEFAULT_VPP}
        return max(quantity(text, VPP, words), state.smallest_vpp())

    def _volts(self, state: _State, text: str) -> float:
        largest = 10.0 / state.factor
        return quantity(text, VOLT, {"MINimum": -largest, "MAXimum": largest, "DEFault": 0.0})


def _passes(part: MessagePart) -> bool:
    return is_one_of(part, _HARMLESS) or _switches_off(part)


def _switches_off(part: MessagePart) -> bool:
    """Tell whether `part` opens the output relay, which must never need a look at anything first."""
    is_switch = header_pattern("OUTPut[:STATe]").fullmatch(part.path) is not None
    return is_switch and len(part.arguments) == 1 and part.argument(0) in {"OFF", "0"}
