"""Calibration of the 34401A: its memory, and the effect of CALibration? on readings (User's Guide p. 95-98, 146-147).

The guide has the commands and leaves the procedure to the Service Guide, which was not at hand. Unverified are
therefore: that a zero covers all ranges of the function, the bounds of values and corrections, which error each of them
gives, the time a calibration takes, and that a refused one answers nothing.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from types import MappingProxyType

from msgspec.structs import replace

from simrack.instruments.hp34401a.calculation import OVERLOAD
from simrack.instruments.hp34401a.corrections import FLATNESS_HZ
from simrack.instruments.hp34401a.functions import Function
from simrack.instruments.hp34401a.inputs import Inputs, MeasuringConditions, MeterReading
from simrack.instruments.hp34401a.setup import Setup
from simrack.scpi import Pending, ScpiError

_COUNT_LIMIT = 32767
"""After it the count is 0 again (p. 97)."""
_OFFSET_ERRORS = MappingProxyType({"VOLT": 720, "CURR": 721, "RES": 722, "FRES": 723})
"""Functions with a zero, and the error when it is too far off."""
_CALIBRATED = ("VOLT", "VOLT:AC", "CURR", "CURR:AC", "RES", "FRES", "FREQ")
_NOMINAL = MappingProxyType({("VOLT", 1000.0): 500.0, ("CURR", 3.0): 2.0, ("CURR:AC", 3.0): 2.0})
"""Values to calibrate with that are not the range's end."""
_VALUE_SPAN = (0.9, 1.1)
_FREQUENCY_SPAN_HZ = (1e3, 1e5)
_SIGNAL_SPAN = 0.1
_OFFSET_SPAN = 5e-3
_GAIN_SPAN = 0.01
_GAIN_HZ = 1e3


class CalibrationMemory:
    """The calibration memory: guarded by a code (p. 146)."""

    def __init__(self) -> None:
        self.secured = True
        self.code = "HP034401"
        self.count = 1
        self.text = ""
        self.value = 0.0

    def require_unsecured(self) -> None:
        """Raise 702 while secured."""
        if self.secured:
            raise ScpiError(702)

    def count_up(self) -> None:
        """Increase the count of calibrated points."""
        self.count = self.count + 1 if self.count < _COUNT_LIMIT else 0


class MeterCalibration:
    """One CALibration?: the range's end or zero is measured, and the reading corrected.

    Args:
        inputs: the input stage.
        function, setup: what is calibrated.
        value: what is on the input, 0 for a zero.

    Raises:
        ScpiError: 709 for a function without calibration, 706 for a value that is none to calibrate with.
    """

    def __init__(self, inputs: Inputs, function: Function, setup: Setup, value: float) -> None:
        range_ = setup.range
        if function.name not in _CALIBRATED:
            raise ScpiError(709)
        if value == 0.0:
            fits = function.name in _OFFSET_ERRORS
        elif function.name == "FREQ":
            fits = _FREQUENCY_SPAN_HZ[0] <= value <= _FREQUENCY_SPAN_HZ[1]
        else:
            part = value / _NOMINAL.get((function.name, range_), range_)
            part = abs(part) if function.name == "VOLT" else part
            fits = _VALUE_SPAN[0] <= part <= _VALUE_SPAN[1]
        if not fits:
            raise ScpiError(706)
        self._inputs = inputs
        self._function = function
        self._setup = replace(setup, auto=False, nplc=100.0, aperture_s=1.0)
        self._value = value

    def begin(self, start_s: float, conditions: MeasuringConditions, finish: Callable[[], object]) -> Pending:
        """Measure; `finish` is called for the answer when the corrections are made.

        Raises:
            ScpiError: then: 707, 708, 710, 720 to 723.
        """
        zero = self._value == 0.0
        ranges = self._function.ranges if zero else (self._setup.range,)
        begun = {
            range_: self._inputs.begin(self._function, start_s, replace(self._setup, range=range_), conditions)
            for range_ in ranges
        }
        end = max(reading.end_s for reading in begun.values())
        return Pending.at(end, lambda: self._adjust(begun, finish))

    def _adjust(self, begun: dict[float, MeterReading], finish: Callable[[], object]) -> object:
        read = {range_: reading.value() for range_, reading in begun.items()}
        later = {range_: each for range_, each in read.items() if not isinstance(each, float)}
        if later:  # a counter that needs longer
            end = max(reading.end_s for reading in later.values())
            return Pending.at(end, lambda: self._adjust(later, finish))
        for range_, measured in read.items():
            assert isinstance(measured, float)  # noqa: S101  (for the type checker)
            self._correct(range_, measured)
        return finish()

    def _correct(self, range_: float, measured: float) -> None:
        corrections, name = self._inputs.corrections, self._function.name
        if self._value == 0.0:
            if abs(measured) > _OFFSET_SPAN * range_:
                raise ScpiError(_OFFSET_ERRORS[name])
            corrections.shift(name, range_, measured)
            return
        factor = self._factor(measured)
        if name == "VOLT:AC" and self._flatness():
            corrections.tilt(factor)
        else:
            corrections.stretch(name, 0.0 if name == "FREQ" else range_, factor)

    def _factor(self, measured: float) -> float:
        if abs(measured) >= OVERLOAD or abs(measured - self._value) > _SIGNAL_SPAN * abs(self._value):
            raise ScpiError(707)
        factor = self._value / measured
        if abs(factor - 1.0) > _GAIN_SPAN:
            raise ScpiError(710)
        return factor

    def _flatness(self) -> bool:
        frequency = self._inputs.frequency_hz()
        for nominal in (_GAIN_HZ, FLATNESS_HZ):
            if math.isclose(frequency, nominal, rel_tol=_SIGNAL_SPAN):
                return nominal == FLATNESS_HZ
        raise ScpiError(708)
