"""Adjustment of the E3631A over the wire: two points a quantity, measured outside, make new constants.

Source: Keysight E3631A User's Guide E3631-90002, ed. 10, 2018 (p. 104-108, 144-146). The levels of the two points,
what is too far to be taken (712, 713), and that data without a level is 221 are unverified.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, NamedTuple

from msgspec import Struct, field
from msgspec.structs import replace

from vcfbench.sim.instruments.e3631a.system_commands import remote_only
from vcfbench.sim.scpi import (
    Boolean,
    Choice,
    Command,
    Number,
    ScpiError,
    Text,
    Word,
    bare_integer,
    boolean,
    quoted,
)

if TYPE_CHECKING:
    from vcfbench.sim.instruments.e3631a.instrument import E3631A
    from vcfbench.sim.instruments.e3631a.output import Output

__all__ = ["CALIBRATION_COMMANDS", "Calibration"]

_SHARES = {"MIN": 0.05, "MAX": 1.0}
"""The two points, parts of the rated value (of the voltage, the range less its 3 %)."""
_FURTHEST = 0.05
"""Relative error, and error as a part of the rated value, beyond which constants are refused."""


class Point(NamedTuple):
    """What is known at a calibration point."""

    programmed: float
    measured: float
    shown: float
    """What the supply itself reads there."""


class Correction(NamedTuple):
    """New constants: `right = gain x wrong + offset`."""

    gain: float
    offset: float

    @classmethod
    def through(cls, wrong: tuple[float, float], right: tuple[float, float], rated: float, number: int) -> Correction:
        """Return the line through two points; ScpiError(`number`) when it is too far from no correction."""
        span = wrong[1] - wrong[0]
        if abs(span) < _FURTHEST * rated:
            raise ScpiError(number)
        gain = (right[1] - right[0]) / span
        offset = right[0] - gain * wrong[0]
        if abs(gain - 1.0) > _FURTHEST or abs(offset) > _FURTHEST * rated:
            raise ScpiError(number)
        return cls(gain, offset)


class Calibration(Struct):
    """The calibration memory, guarded by a code (p. 104), and the adjustment under way."""

    secured: bool = True
    code: str = "HP003631"
    count: int = 1
    text: str = ""
    level: str | None = None
    """The point that the output was sent to, "MIN" or "MAX"."""
    points: dict[str, Point] = field(default_factory=dict)
    """What has been told, by point."""
    subject: tuple[str, str] = ("", "")
    """Output and quantity that are being adjusted."""

    def require_unsecured(self) -> None:
        """Raise 702 while secured."""
        if self.secured:
            raise ScpiError(702)

    def begin(self, output: str, quantity: str, level: str) -> None:
        """Note that `output` goes to the point `level` of `quantity`."""
        if self.subject != (output, quantity):
            self.points.clear()
        self.subject, self.level = (output, quantity), level

    def take(self, output: str, quantity: str, point: Point) -> tuple[Point, Point] | None:
        """Note what was measured; return both points once they are there."""
        if self.subject != (output, quantity) or self.level is None:
            raise ScpiError(-221)
        self.points[self.level] = point
        self.count += 1
        if len(self.points) < len(_SHARES):
            return None
        both = self.points["MIN"], self.points["MAX"]
        self.points, self.level = {}, None
        return both


def _signed(output: Output, magnitude: float) -> float:
    return output.kind.sign * magnitude


def _rated_v(output: Output) -> float:
    return abs(output.kind.volts.maximum) / 1.03


def _require_on(supply: E3631A) -> None:
    supply.calibration.require_unsecured()
    if not supply.output_on:
        raise ScpiError(708)


@remote_only
def _go_to_volts(supply: E3631A, level: str) -> None:
    _require_on(supply)
    supply.calibration.begin(supply.selected, "VOLT", level)
    supply.program(supply.selected, volts=_signed(supply.output, _SHARES[level] * _rated_v(supply.output)))


@remote_only
def _go_to_amps(supply: E3631A, level: str) -> None:
    _require_on(supply)
    supply.calibration.begin(supply.selected, "CURR", level)
    supply.program(supply.selected, amps=_SHARES[level] * supply.output.kind.rated_a)


@remote_only
def _take_volts(supply: E3631A, measured: float) -> None:
    _require_on(supply)
    supply.observe()
    output = supply.output
    shown = output.voltage_reading()
    both = supply.calibration.take(supply.selected, "VOLT", Point(output.volts, measured, shown))
    if both is not None:
        adjust_volts(output, *both)
        supply.drive()


@remote_only
def _take_amps(supply: E3631A, measured: float) -> None:
    _require_on(supply)
    supply.observe()
    output = supply.output
    shown = output.current_reading()
    both = supply.calibration.take(supply.selected, "CURR", Point(output.amps, measured, shown))
    if both is not None:
        adjust_amps(output, *both)
        supply.drive()


def _lines(low: Point, high: Point, rated: float) -> tuple[Correction, Correction]:
    """Return what has to be programmed for a measured value, and what has to be shown for a shown one."""
    measured = (low.measured, high.measured)
    programming = Correction.through(measured, (low.programmed, high.programmed), rated, 712)
    return programming, Correction.through((low.shown, high.shown), measured, rated, 713)


def adjust_volts(output: Output, low: Point, high: Point) -> None:
    """Give `output` the voltage constants that two measured points ask for."""
    errors, sign = output.errors, output.kind.sign
    programming, shown = _lines(low, high, _rated_v(output))
    output.errors = replace(
        errors,
        programming_gain=programming.gain * (1.0 + errors.programming_gain) - 1.0,
        programming_offset_v=errors.programming_offset_v + sign * programming.offset * (1.0 + errors.programming_gain),
        readback_gain=shown.gain * (1.0 + errors.readback_gain) - 1.0,
        readback_offset_v=shown.gain * errors.readback_offset_v + shown.offset,
    )


def adjust_amps(output: Output, low: Point, high: Point) -> None:
    """Give `output` the current constants that two measured points ask for."""
    errors = output.errors
    gain = 1.0 + errors.current_programming_gain
    programming, shown = _lines(low, high, output.kind.rated_a)
    output.errors = replace(
        errors,
        current_programming_gain=programming.gain * gain - 1.0,
        current_programming_offset_a=errors.current_programming_offset_a + programming.offset * gain,
        current_readback_gain=shown.gain * (1.0 + errors.current_readback_gain) - 1.0,
        current_readback_offset_a=shown.gain * errors.current_readback_offset_a + shown.offset,
    )


def _count(supply: E3631A) -> int:
    return supply.calibration.count


@remote_only
def _set_code(supply: E3631A, code: str) -> None:
    supply.calibration.require_unsecured()
    supply.calibration.code = code


@remote_only
def _set_secured(supply: E3631A, state: object, code: str) -> None:
    if code != supply.calibration.code:
        raise ScpiError(703)
    supply.calibration.secured = bool(state)


def _secured(supply: E3631A) -> bool:
    return supply.calibration.secured


@remote_only
def _set_text(supply: E3631A, text: str) -> None:
    supply.calibration.require_unsecured()
    supply.calibration.text = text


def _text(supply: E3631A) -> str:
    return supply.calibration.text


_CODE = Word(word_too_long=704)
_LEVEL = (Choice(("MINimum", "MAXimum")),)

CALIBRATION_COMMANDS = (
    Command("CALibration:COUNt", query=_count, reply=bare_integer),
    Command("CALibration:SECure:CODE", (_CODE,), do=_set_code),
    Command("CALibration:SECure:STATe", (Boolean(), _CODE), do=_set_secured, query=_secured, reply=boolean),
    Command("CALibration:STRing", (Text(limit=40),), do=_set_text, query=_text, reply=quoted),
    Command("CALibration:VOLTage[:DATA]", (Number(unit="V"),), do=_take_volts),
    Command("CALibration:CURRent[:DATA]", (Number(unit="A"),), do=_take_amps),
    Command("CALibration:VOLTage:LEVel", _LEVEL, do=_go_to_volts),
    Command("CALibration:CURRent:LEVel", _LEVEL, do=_go_to_amps),
)
