"""Adjustment of the E3631A over the wire: two points a quantity, measured outside, make new constants.

Source: Keysight E3631A User's Guide E3631-90002, ed. 10, 2018 (p. 104-108, 144-146). The levels of the two points,
what is too far to be taken (712, 713), and that data without a level is 221 are unverified.
"""

from __future__ import annotations

from typing import NamedTuple

from msgspec import Struct, field
from msgspec.structs import replace

from simrack.instruments.e3631a.output import SupplyOutput
from simrack.scpi import ScpiError

_SHARES = {"MIN": 0.05, "MAX": 1.0}
"""The two points, parts of the rated value (of the voltage, the range less its 3 %)."""
_FURTHEST = 0.05
"""Relative error, and error as a part of the rated value, beyond which constants are refused."""


class CalibrationPoint(NamedTuple):
    """Values at a calibration point."""

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


class SupplyCalibration(Struct):
    """The calibration memory, guarded by a code (p. 104), and the adjustment under way."""

    secured: bool = True
    code: str = "HP003631"
    count: int = 1
    text: str = ""
    level: str | None = None
    """The point that the output was sent to, "MIN" or "MAX"."""
    points: dict[str, CalibrationPoint] = field(default_factory=dict)
    """What was measured, by point."""
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

    def take(
        self, output: str, quantity: str, point: CalibrationPoint
    ) -> tuple[CalibrationPoint, CalibrationPoint] | None:
        """Note a measured point; return both points once they are there."""
        if self.subject != (output, quantity) or self.level is None:
            raise ScpiError(-221)
        self.points[self.level] = point
        self.count += 1
        if len(self.points) < len(_SHARES):
            return None
        both = self.points["MIN"], self.points["MAX"]
        self.points, self.level = {}, None
        return both


def level_v(output: SupplyOutput, level: str) -> float:
    """Return the voltage of the point `level`, "MIN" or "MAX"."""
    return output.kind.sign * (_SHARES[level] * _rated_v(output))


def level_a(output: SupplyOutput, level: str) -> float:
    """Return the current of the point `level`, "MIN" or "MAX"."""
    return _SHARES[level] * output.kind.rated_a


def _rated_v(output: SupplyOutput) -> float:
    return abs(output.kind.volts.maximum) / 1.03


def _lines(low: CalibrationPoint, high: CalibrationPoint, rated: float) -> tuple[Correction, Correction]:
    """Return corrections of programming (by measured values) and of display (by shown values)."""
    measured = (low.measured, high.measured)
    programming = Correction.through(measured, (low.programmed, high.programmed), rated, 712)
    return programming, Correction.through((low.shown, high.shown), measured, rated, 713)


def adjust_volts(output: SupplyOutput, low: CalibrationPoint, high: CalibrationPoint) -> None:
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


def adjust_amps(output: SupplyOutput, low: CalibrationPoint, high: CalibrationPoint) -> None:
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
