"""Smallest and largest numbers of a bench file, each with its unit and its reason.

They do not say what is wise on a station (that is what its ``[limits]`` are for) but what no station can mean: a
number outside is a slip of the pen. the page Formats of the site lists them.
"""

from typing import Annotated, Any

from msgspec import Meta


def ranged(least: float, most: float, meaning: str | None = None, **extra: Any) -> Meta:
    """Return the range of a setting, both ends included, with its meaning and `extra` as of :func:`said`."""
    return Meta(ge=least, le=most, description=meaning, extra=extra or None)


def several(least: int, most: int, meaning: str) -> Meta:
    """Return the least and the largest number of values of a setting that is a list, and its meaning."""
    return Meta(min_length=least, max_length=most, description=meaning)


def said(meaning: str, **extra: Any) -> Meta:
    """Return the meaning of a setting; ``option=True`` gives it an option of its own, or the name of that."""
    return Meta(description=meaning, extra=extra or None)


LEAST = 1e-6
"""Smallest number but 0, whatever the unit: no instrument of a bench resolves less."""
LEAST_V_VC_V = 1e-3
"""V: below, the generator's level is a few of its own steps, and its offset is as large."""

LINE_PATTERN = r"\A[^\x00-\x1f\x7f\x85\u2028\u2029]+\Z"

Seconds = Annotated[float, Meta(ge=1e-3, le=86_400.0)]
"""s, time-outs: no exchange is over sooner than a millisecond; nobody waits for longer than a day."""
Temperature = Annotated[float, Meta(ge=-99.9, le=225.0)]
"""degC, settings of streams of air."""
RoomWindow = tuple[Annotated[float, Meta(ge=-50.0, le=60.0)], Annotated[float, Meta(ge=-50.0, le=60.0)]]
"""degC, lowest and highest of the room."""
TemperatureRamp = Annotated[float, Meta(ge=0.1, le=9999.0)]
"""K/min, ramps that can be set there."""
Pause = Annotated[float, Meta(ge=0.0, le=60.0)]
"""s, between messages on a serial line."""
BaudRate = Annotated[int, Meta(ge=300, le=921_600)]
"""Bd: the slowest and the fastest of serial ports."""
StepsPerDegree = Annotated[float, Meta(ge=1e-3, le=1e9)]
"""1/deg: from a few steps a turn to more than encoders have."""

Rate = Annotated[float, Meta(ge=-5_000.0, le=5_000.0)]
"""deg/s: no table for gyroscopes turns faster."""
Rates = Annotated[tuple[Rate, ...], Meta(min_length=3, max_length=1_000)]
"""A line with its scatter needs three."""
RateLimit = Annotated[float, Meta(ge=1e-3, le=5_000.0)]
"""deg/s: less than the Earth's rate (0.004) is not measured on a table; none for gyroscopes turns faster."""
RateTolerance = Annotated[float, Meta(ge=1e-5, le=10.0)]
"""deg/s: the last digit that tables read back."""
Acceleration = Annotated[float, Meta(ge=1e-3, le=50_000.0)]
"""deg/s^2: slower, a ramp to 1 deg/s takes a quarter of an hour."""

VVcLimit = Annotated[float, Meta(ge=LEAST_V_VC_V, le=10.0)]
"""V: a generator's least level and its largest."""
LeastRail = Annotated[float, Meta(ge=0.0, le=25.0)]
"""V: the supply's outputs."""
PositiveRail = Annotated[float, Meta(ge=0.1, le=25.0)]
"""V: below, an output is off."""
NegativeRail = Annotated[float, Meta(ge=-25.0, le=-0.1)]
"""V: as positive ones."""
VoltageTolerance = Annotated[float, Meta(ge=1e-3, le=5.0)]
"""V: from the resolution of the supply's read-back."""
Current = Annotated[float, Meta(ge=1e-3, le=1.0)]
"""A: from the resolution of the supply's limit to its largest output above 6 V."""

Latitude = Annotated[float, Meta(ge=-90.0, le=90.0)]
"""deg: from pole to pole."""

WarmUp = Annotated[float, Meta(ge=0.0, le=86_400.0)]
"""s: none to a day."""
Settling = Annotated[float, Meta(ge=0.01, le=3_600.0)]
"""s: no gyroscope's loop has settled sooner; without, the ramp is in the first reading."""
Interval = Annotated[float, Meta(ge=0.01, le=3_600.0)]
"""s, from reading to reading: at least the multimeter's shortest integration and its transmission."""
Samples = Annotated[int, Meta(ge=2, le=1_000_000)]
"""A scatter needs two; ten hours at the fastest interval are fewer than the most."""
Slope = Annotated[float, Meta(ge=-1e6, le=1e6)]
"""(deg/s)/V: the fastest table by a few millivolts."""

FrequencyWindow = tuple[Annotated[float, Meta(ge=1.0, le=1e7)], Annotated[float, Meta(ge=1.0, le=1e7)]]
"""Hz: frequencies of vibration and of signals on the oscilloscope."""
AmplitudeWindow = tuple[Annotated[float, Meta(ge=0.0, le=400.0)], Annotated[float, Meta(ge=0.0, le=400.0)]]
"""V: amplitudes that the oscilloscope's inputs stand."""
PhaseWindow = tuple[Annotated[float, Meta(ge=-360.0, le=360.0)], Annotated[float, Meta(ge=-360.0, le=360.0)]]
"""deg: a turn either way."""
StartUp = Annotated[float, Meta(ge=0.01, le=600.0)]
"""s: a drive loop's start."""

_Output = Annotated[float, Meta(ge=-1e10, le=1e10)]
_OutputSize = Annotated[float, Meta(ge=0.0, le=1e10)]
Output = _Output
OutputWindow = tuple[_Output, _Output]
"""V, or of a stream 32-bit words, LSB."""
OutputDrift = _OutputSize
"""V, or as the output: from none to all that can be read."""
NoiseWindow = tuple[_OutputSize, _OutputSize]
"""V, or as the output: standard deviation of one reading."""
OutputSlopeWindow = tuple[_Output, _Output]
"""V/(deg/s), or as the output."""
SlopeWindow = tuple[Slope, Slope]
"""(deg/s)/V: as the guess of K_Vc."""
RateWindow = tuple[Rate, Rate]
"""deg/s: as rates."""
PpmWindow = tuple[Annotated[float, Meta(ge=0.0, le=1e6)], Annotated[float, Meta(ge=0.0, le=1e6)]]
"""ppm: from straight to all of the whole."""
LargestPpm = Annotated[float, Meta(ge=0.0, le=1e6)]
"""ppm: as those windows."""
DriftWindow = tuple[Annotated[float, Meta(ge=-1e6, le=1e6)], Annotated[float, Meta(ge=-1e6, le=1e6)]]
"""ppm: from gone to twice the value before."""
EnWindow = tuple[Annotated[float, Meta(ge=0.0, le=1e6)], Annotated[float, Meta(ge=0.0, le=1e6)]]
"""A difference over its expanded uncertainty, without sign."""
PercentWindow = tuple[Annotated[float, Meta(ge=-100.0, le=100.0)], Annotated[float, Meta(ge=-100.0, le=100.0)]]
"""%: from one to the other."""

Kelvins = Annotated[float, Meta(ge=0.0, le=100.0)]
ScaleFactorCoefficient = Annotated[float, Meta(ge=0.0, le=1e5)]
BiasCoefficient = Annotated[float, Meta(ge=0.0, le=1e6)]
WarmUpTime = Annotated[float, Meta(ge=1.0, le=86_400.0)]
Misalignment = Annotated[float, Meta(ge=0.0, le=45.0)]
PhaseLimit = Annotated[float, Meta(ge=0.0, le=45.0)]
"""deg."""
PpmPerDegree = Annotated[float, Meta(ge=-1e5, le=1e5)]
"""ppm/deg: the tangent of 80 degrees, and no demodulator is further off."""
PpmPerYear = Annotated[float, Meta(ge=0.0, le=1e6)]
"""ppm a year: all of it within one."""
BiasPerDegree = Annotated[float, Meta(ge=-100.0, le=100.0)]
"""deg/s a degree: that of 5700 deg/s of quadrature."""
MeterAge = Annotated[float, Meta(ge=0.0, le=3650.0)]
"""days: ten years; data sheets promise nothing beyond one or two."""
TableRateError = Annotated[float, Meta(ge=0.0, le=0.1)]
"""Relative: no table for gyroscopes is worse than a tenth."""
LevelError = Annotated[float, Meta(ge=0.0, le=0.1)]
"""Relative: no generator is worse than a tenth of its level."""
OutputResistance = Annotated[float, Meta(ge=0.0, le=1e6)]
"""Ohm: a megohm is no output any more."""
LevelOffset = Annotated[float, Meta(ge=0.0, le=1.0)]
"""V: beyond a volt it is no offset any more."""
GeneratorRanges = Annotated[tuple[Annotated[float, Meta(ge=1e-3, le=100.0)], ...], Meta(min_length=1, max_length=20)]
"""V: no attenuator goes further down, no generator further up."""
BiasInstability = Annotated[float, Meta(ge=0.0, le=1e5)]
"""deg/h: from none to that of the worst gyroscopes."""
Horizon = Annotated[float, Meta(ge=1.0, le=8_760.0)]
"""h: longer than a calibration, up to a year."""
