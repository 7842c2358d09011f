"""Instruments that a person sets, reads and switches off: drivers that ask the operator.

What drives something is safe when the person has typed that it is: the word `off`, or a rate of 0.
"""

from collections.abc import Callable, Mapping
from threading import Lock
from types import MappingProxyType
from typing import Any, Final

from vcfbench.clock import Deadline
from vcfbench.errors import BenchError, MeasurementError
from vcfbench.interfaces import Identity, Operator, Regulation, Request, SafeReport, UnprovedCommand, nobody

_TRIES: Final = 5
_STILL_DEG_S: Final = 0.05
_JUMP: Final = 0.01
"""Part of the range by which a reading may differ from the one before without being typed twice, and part of a rate by
which the read-back may differ from it without a remark."""
_ALIKE: Final = 0.001
"""Part of the range within which a reading that was typed twice agrees: a last digit may flicker, a slip is more."""
_OUTPUTS: Final = MappingProxyType({"N25V": "negative output", "P25V": "positive output", "P6V": "6 V output"})


class Hands:
    """The person at the bench, asked one thing at a time; questions and answers are kept for the record."""

    def __init__(self) -> None:
        self.operator: Operator | None = None
        self._said: list[tuple[str, str]] = []
        self._turn = Lock()
        self.left = False
        """Whether the bench was left: an answer that is still waited for is of no use any more."""

    def taken(self) -> list[tuple[str, str]]:
        """Return questions and answers since the last call."""
        said, self._said = self._said, []
        return said

    def do(self, words: str, types: str = "") -> str:
        """Ask for an action; return the typed answer."""
        with self._turn:
            request = Request(words, types=types, wanted=lambda: not self.left)
            answer = (self.operator or nobody)(request).strip()
            self._said.append((words, answer))
        return answer

    def word(self, words: str, *choice: str) -> str:
        """Ask for one of the words of `choice`; MeasurementError without one."""
        return self._typed(
            words, " or ".join(choice), lambda answer: answer.lower() if answer.lower() in choice else ""
        )

    def number(self, what: str, unit: str, largest: float, decimals: int = 0) -> float:
        """Ask for a number within +-`largest` with at least so many decimals; MeasurementError without one."""
        limits = f"{unit}, at most {largest:g}" + f", {decimals} decimals" * (decimals > 0)

        def as_number(answer: str) -> str:
            text = answer.replace(",", ".").replace("\N{MINUS SIGN}", "-")
            try:
                fits = abs(float(text)) <= largest and len(text.partition(".")[2]) >= decimals
            except ValueError:
                fits = False
            return text if fits else ""

        return float(self._typed(f"type {what} ({limits})", unit, as_number))

    def twice(self, what: str, unit: str, largest: float, expected: float = 0.0, before: str = "") -> float:
        """Ask for a number twice, or once if it is `expected`; MeasurementError if the entries differ.

        `before` says what was typed before.
        """
        for _ in range(_TRIES):
            first = self.number(f"{what}{before}", unit, largest)
            if first == expected:
                return first
            second = self.number(f"{what} again", unit, largest)
            if second == first:
                return first
            before = f", {first:g} and then {second:g} were typed"
        raise MeasurementError(f"{what}: expected the same entry twice, got different ones")

    def _typed(self, words: str, types: str, accepted: Callable[[str], str]) -> str:
        asked = words
        for _ in range(_TRIES):
            answer = self.do(asked, types)
            if found := accepted(answer):
                return found
            asked = f"{words}, not {repr(answer) if answer else 'Enter alone'}"
        raise MeasurementError(f"asked the operator to {words}; after {_TRIES} tries got {answer!r}")


class _ByHand:
    """An instrument in the hands of a person: `part` is its table of the bench file."""

    safe_words = ""
    _last_read: str | None = None

    def __init__(self, name: str, part: Any, hands: Hands, limits: Mapping[str, float | None]) -> None:
        self.name = name
        self.resource = str(part.resource)
        self._part = part
        self._hands = hands
        self._limits = limits

    def identify(self) -> Identity:
        """Return the identity in the bench file."""
        number = getattr(self._part, "serial_number", None) or ""
        return Identity("by hand", self._part.model or self.name.replace("_", " "), number, "")

    def check_errors(self) -> None:
        """Do nothing: the operator reports errors at once."""

    def command_safe(self) -> UnprovedCommand:
        """Return the last request; `make_safe` asks the operator, who cannot be reached at once."""
        return UnprovedCommand(self.safe_words, sent=not self.safe_words, last_read=self._last_read)

    def make_safe(self, deadline: Deadline) -> SafeReport:
        """Ask the person to switch it off and to confirm; without the word it is not safe."""
        try:
            said = self._confirmed()
        except BenchError as error:
            return SafeReport(self.name, self.resource, safe=False, detail=f"not confirmed as safe: {error}")
        return SafeReport(self.name, self.resource, safe=True, detail=said)

    def _confirmed(self) -> str:
        return "read by hand, it has no output"

    def close(self) -> None:
        """Ask the operator no more questions."""
        self._hands.left = True


class HandMeter(_ByHand):
    """A voltmeter whose readings a person types."""

    _range_v = 1000.0
    _before_v: float | None = None

    def configure_dc_voltage(self, range_v: float, nplc: float) -> None:
        """Ask the operator to set the range; the integration time is the meter's own."""
        self._hands.do(f"set the multimeter to DC volts, {range_v:g} V range")
        self._range_v = range_v

    def read_voltage_v(self) -> float:
        """Ask for one reading, V; ask again until two agree if it differs much from the previous one."""
        largest_v, step = 1.2 * self._range_v, f"{self._part.resolution_v:.9f}".rstrip("0")
        what, near_v, within_v = "the multimeter's reading", self._before_v, _JUMP * self._range_v
        for _ in range(_TRIES):
            reading_v = self._hands.number(what, "V", largest_v, len(step.partition(".")[2]))
            if near_v is None or abs(reading_v - near_v) <= within_v:
                self._before_v = reading_v
                return reading_v
            near_v, within_v = reading_v, _ALIKE * self._range_v
            what = "the multimeter's reading again, as it shows now, for it has moved"
        raise MeasurementError(f"of {_TRIES} readings of the multimeter no two in a row were within {within_v:g} V")


class HandSupply(_ByHand):
    """A supply that a person sets, reads and switches."""

    safe_words = "to switch off"
    _on = False

    def configure_output(self, output: str, voltage_v: float, current_limit_a: float) -> None:
        """Ask the operator to set level and current limit."""
        level = f"{_OUTPUTS[output]} of the supply ({output}) to {voltage_v:+g} V"
        self._hands.do(f"set the {level}, current limit {current_limit_a:g} A, outputs off")

    def enable_outputs(self) -> None:
        """Ask the operator to switch the outputs on."""
        self._on = True
        self._hands.do("switch the outputs of the supply on")

    def disable_outputs(self) -> None:
        """Ask the operator to switch the outputs off."""
        self._hands.do("switch the outputs of the supply off")
        self._on = False

    def outputs_enabled(self) -> bool:
        """Return True if the outputs are on, by the operator's last answer."""
        return self._on

    def measure_voltage_v(self, output: str) -> float:
        """Ask for the voltage that the supply shows, V."""
        return self._hands.twice(f"the voltage of the {_OUTPUTS[output]}, with its sign", "V", 100.0)

    def measure_current_a(self, output: str) -> float:
        """Ask for the current that the supply shows, A."""
        return self._hands.number(f"the current of the {_OUTPUTS[output]}", "A", 10.0)

    def regulation(self, output: str) -> Regulation:
        """Ask for the regulation of the output."""
        said = self._hands.word(
            f"type whether the {_OUTPUTS[output]} is in constant voltage (cv) or not (cc)", "cv", "cc"
        )
        return Regulation.CONSTANT_VOLTAGE if said == "cv" else Regulation.CONSTANT_CURRENT

    def _confirmed(self) -> str:
        self._hands.word("switch the outputs of the supply off and type off", "off")
        self._on = False
        return "off, as typed by the operator"


class HandTable(_ByHand):
    """A rate table that a person sets, reads and stops."""

    safe_words = "to stop"
    _set_deg_s = 0.0
    _shown_deg_s = 0.0
    _typed = False
    """Whether the rate was typed since it was set."""
    _safe = False

    def enable(self) -> None:
        """Ask the operator to make the table ready, at rest."""
        self._hands.do("make the rate table ready to turn, at rest")

    def disable(self) -> None:
        """Do nothing: the table is at rest, and stays ready."""

    def set_rate(self, rate_deg_s: float, acceleration_deg_s2: float) -> None:
        """Ask the operator to set the rate, with the table's own sign."""
        self._safe = self._typed = False
        self._set_deg_s = shown = self._part.axis_sign * rate_deg_s
        how = f"turn the rate table at {shown:+g} deg/s" if shown else "bring the rate table to rest"
        self._hands.do(f"{how}, with at most {acceleration_deg_s2:g} deg/s^2")

    def stop(self, acceleration_deg_s2: float) -> None:
        """Ask the operator to bring the table to rest."""
        self.set_rate(0.0, acceleration_deg_s2)

    def at_rate(self) -> bool:
        """Return True: the operator has confirmed the rate."""
        return True

    def rate_deg_s(self) -> float:
        """Ask for the rate that the table shows, deg/s."""
        if self._safe:
            return 0.0
        largest = 2.0 * (self._limits["max_rate_deg_s"] or 0.0)
        off_deg_s, before = abs(self._shown_deg_s - self._set_deg_s), ""
        if self._typed and off_deg_s > max(_STILL_DEG_S, _JUMP * abs(self._set_deg_s)):
            before = f", expected {self._set_deg_s:g}, {self._shown_deg_s:g} was typed"
        what = "the rate that the table shows"
        self._shown_deg_s = self._hands.twice(what, "deg/s", largest, self._shown_deg_s, before)
        self._typed = True
        rate_deg_s: float = self._part.axis_sign * self._shown_deg_s + 0.0
        self._last_read = f"{rate_deg_s:g} deg/s"
        return rate_deg_s

    def angle_deg(self) -> float:
        """Ask for the angle that the table shows, deg."""
        return float(self._part.axis_sign * self._hands.twice("the angle that the table shows", "deg", 1e6))

    def fault(self) -> str | None:
        """Return None: a person stops the run on a fault."""
        return None

    def _confirmed(self) -> str:
        words = "at which the rate table turns once it is stopped"
        for _ in range(_TRIES):
            rate_deg_s = self._hands.number(f"the rate {words}", "deg/s", 1e4)
            if abs(rate_deg_s) <= _STILL_DEG_S:
                self._safe = True
                return f"{rate_deg_s:g} deg/s, as typed by the operator"
        raise MeasurementError(f"expected the table at rest, the operator typed {rate_deg_s:g} deg/s")


BY_HAND: Final[Mapping[str, type]] = MappingProxyType(
    {"power": HandSupply, "multimeter": HandMeter, "rate_table": HandTable}
)
"""What a person can be, by role."""
