"""Settings of a 33220A, ranges of its functions, imperfections of one specimen."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from types import MappingProxyType
from typing import TYPE_CHECKING, ClassVar, Self

from msgspec import Struct, field
from msgspec.structs import replace

from simrack.scpi import ScpiError, Settings

if TYPE_CHECKING:
    import numpy as np

SOURCE_OHM = 50.0
MAX_PEAK_V = 10.0
"""Largest peak voltage into an open circuit; half of it into 50 ohm."""
FUNCTIONS = {
    "SIN": "SINusoid",
    "SQU": "SQUare",
    "RAMP": "RAMP",
    "PULS": "PULSe",
    "NOIS": "NOISe",
    "DC": "DC",
    "USER": "USER",
}


class GeneratorKind(Struct, frozen=True):
    """Abilities of one generator of the family.

    Args:
        frequency_hz: by function, lowest and highest.
        least_vpp: smallest amplitude into an open circuit, Vpp; half of it into 50 ohm.
        edge_s: shortest and longest edge of a pulse.
        least_width_s: least width, high and low, of pulses of a period up to so many seconds.
        narrow_duty_hz: above it square waves have a duty cycle of 40 to 60 %; infinity where they need not.
        burst_hz: frequencies of counted bursts; only infinite ones go beyond.
        longest_burst_s: longest period of the internal timer of bursts.
        arbitrary_clock_hz: clock at which arbitrary points are looked up by their phase; 0 where they have a rate.
    """

    frequency_hz: Mapping[str, tuple[float, float]]
    least_vpp: float
    edge_s: tuple[float, float]
    least_width_s: Mapping[float, float]
    narrow_duty_hz: float
    burst_hz: tuple[float, float]
    longest_burst_s: float
    arbitrary_clock_hz: float = 0.0


KIND_33220A = GeneratorKind(
    frequency_hz=MappingProxyType(
        {
            "SIN": (1e-6, 20e6),
            "SQU": (1e-6, 20e6),
            "RAMP": (1e-6, 200e3),
            "PULS": (500e-6, 5e6),
            "USER": (1e-6, 6e6),
            "NOIS": (1e-6, 20e6),
            "DC": (1e-6, 20e6),
        }
    ),
    least_vpp=0.02,
    edge_s=(5e-9, 100e-9),
    least_width_s=MappingProxyType({10.0: 20e-9, 100.0: 200e-9, 1000.0: 2e-6, math.inf: 20e-6}),  # unverified
    narrow_duty_hz=10e6,
    burst_hz=(2e-3, 6e6),
    longest_burst_s=500.0,
    arbitrary_clock_hz=50e6,  # User's Guide p. 325: at higher frequencies some points are skipped
)


class Modulation(Struct):
    """Modulating waveform of AM, FM, PM or PWM."""

    function: str = "SIN"
    frequency_hz: float = 10.0
    source: str = "INT"


class Keying(Struct):
    """Other frequency of FSK, and rate of its changes."""

    frequency_hz: float = 100.0
    rate_hz: float = 10.0
    source: str = "INT"


class Panel(Settings):
    """Settings that ``*RST`` leaves alone: front panel and interfaces."""

    display: bool = True
    text: str = ""
    beep: bool = True
    lock: bool = False
    exclude: str = "NONE"
    remote: str = "LOC"
    auto_recall: bool = False
    gpib: int = 10
    dhcp: bool = True
    address: str = "169.254.2.20"
    mask: str = "255.255.0.0"
    gateway: str = "169.254.2.1"
    host: str = "A-33220A-21876"
    secured: bool = True
    code: str = "AT33220A"
    """Security code of the factory (guide, as users quote it)."""
    calibration: str = ""


class GeneratorSettings(Settings):
    """Settings of a 33220A.

    Those of ``*RST`` are the record of a 33250A; of PM, PWM and what a 33250A has not they are general knowledge.
    `vpp` and `offset_v` are those into an open circuit.
    """

    function: str = "SIN"
    frequency_hz: float = 1000.0
    vpp: float = 0.2  # open-circuit: 100 mVpp into the 50 ohm of *RST
    offset_v: float = 0.0
    unit: str = "VPP"
    load_ohm: float = 50.0
    output: bool = False
    polarity: str = "NORM"
    sync: bool = True
    range_auto: bool = True
    range: int = 0
    duty_percent: float = 50.0
    symmetry_percent: float = 100.0
    width_s: float = 1e-4
    hold: str = "WIDT"
    edge_s: float = 5e-9
    user: str = "EXP_RISE"
    angle: str = "DEG"
    phase_deg: float = 0.0
    mode: str = ""
    am_depth_percent: float = 100.0
    am: Modulation = field(default_factory=lambda: Modulation(frequency_hz=100.0))
    fm_deviation_hz: float = 100.0
    fm: Modulation = field(default_factory=Modulation)
    pm_deviation_deg: float = 180.0
    pm: Modulation = field(default_factory=Modulation)
    pwm_deviation_s: float = 1e-5
    pwm: Modulation = field(default_factory=Modulation)
    fsk: Keying = field(default_factory=Keying)
    start_hz: float = 100.0
    stop_hz: float = 1000.0
    spacing: str = "LIN"
    sweep_s: float = 1.0
    marker_hz: float = 500.0
    marker_on: bool = False
    burst_mode: str = "TRIG"
    cycles: float = 1.0
    burst_period_s: float = 1e-2
    burst_phase_deg: float = 0.0
    gate: str = "NORM"
    trigger: str = "IMM"
    slope: str = "POS"
    delay_s: float = 0.0
    trigger_out: bool = False
    trigger_out_slope: str = "POS"
    order: str = "NORM"
    unlock_error: bool = False


def conflict(words: str) -> ScpiError:
    """Return -221 with its words."""
    return ScpiError(-221, f"Settings conflict; {words}")


class OutputRange(Struct, frozen=True):
    """One attenuator range of the direct-voltage path, open-circuit volts."""

    upper_v: float
    """Largest peak voltage of the range, V (the breaks of the 33220A are unverified)."""
    gain_error: float
    """Relative gain error of the range."""
    offset_error_v: float
    """Voltage that the range adds, V."""


class GeneratorErrors(Struct, frozen=True):
    """Imperfections of one specimen; each is off at zero."""

    ranges: tuple[OutputRange, ...]
    """Ranges of the direct-voltage path, smallest first."""
    amplitude_error: float
    """Relative error of the alternating amplitude (data sheet, unverified: 1 % at 1 kHz)."""
    frequency_error: float
    """Relative error of the time base (data sheet, unverified: 20 ppm a year)."""
    dac_bits: int
    """Bits of the converter over -upper_v...upper_v of the range: 14; 0 for a continuous output."""
    setting_digits: int
    """Digits to which amplitude, offset and levels are set: 4; 0 for as many as sent."""

    promised: ClassVar[tuple[float, float]] = (0.02, 0.004)
    """The largest error of a level: a part of it, and V (data sheet: 2 mV into 50 ohm, hence 4 mV open)."""

    @classmethod
    def none(cls) -> GeneratorErrors:
        """Return a generator that puts out exactly its settings."""
        return cls(tuple(OutputRange(upper, 0.0, 0.0) for upper in _RANGES_V), 0.0, 0.0, 0, 0)

    @classmethod
    def drawn(cls, rng: np.random.Generator) -> GeneratorErrors:
        """Return a specimen drawn uniformly within the data sheet.

        The data sheet does not tell where its ranges end: their ends are drawn too.
        """
        errors = [(float(rng.uniform(-0.02, 0.02)), float(rng.uniform(-0.004, 0.004))) for _ in _RANGES_V]
        amplitude, frequency = float(rng.uniform(-0.01, 0.01)), float(rng.uniform(-2e-5, 2e-5))
        return cls(drawn_ranges(rng, errors, cls.promised), amplitude, frequency, 14, 4)

    def with_ranges(self, ends_v: Sequence[float]) -> Self:
        """Return a specimen whose ranges end there, with the errors of its own; any beyond them with the last's."""
        lowest_v = [0.0, *(each.upper_v for each in self.ranges[:-1])]
        errors = [
            (of.gain_error, of.offset_error_v / _room(of.gain_error, low_v, self.promised))
            for of, low_v in zip(self.ranges, lowest_v, strict=True)
        ]
        last = len(errors) - 1
        return replace(self, ranges=_ending(ends_v, [errors[min(n, last)] for n in range(len(ends_v))], self.promised))


_RANGES_V = (0.32, 1.0, 3.2, 10.0)
_LEAST_END_V = 0.02
"""Least end of a range that is drawn: a third of the V_Vc at which a calibration compares."""


def drawn_ranges(
    rng: np.random.Generator, errors: Sequence[tuple[float, float]], promised: tuple[float, float]
) -> tuple[OutputRange, ...]:
    """Return ranges with these gain and offset errors whose ends are drawn, as likely in each decade up to 10 V.

    What is promised is the error of a level, not of a range: an offset is as much larger as its range's levels allow.
    """
    decades = math.log10(_LEAST_END_V), math.log10(MAX_PEAK_V)
    ends = sorted(10.0 ** float(rng.uniform(*decades)) for _ in errors[1:])
    return _ending((*ends, MAX_PEAK_V), errors, promised)


def _ending(
    ends_v: Sequence[float], errors: Sequence[tuple[float, float]], promised: tuple[float, float]
) -> tuple[OutputRange, ...]:
    lowest_v = (0.0, *ends_v[:-1])
    return tuple(
        OutputRange(end_v, gain, offset_v * _room(gain, low_v, promised))
        for end_v, low_v, (gain, offset_v) in zip(ends_v, lowest_v, errors, strict=True)
    )


def _room(gain_error: float, low_v: float, promised: tuple[float, float]) -> float:
    """Return how many times the promised volts an offset may be where the levels of its range begin at `low_v`."""
    setting, offset_v = promised
    return 1.0 + max(0.0, setting - abs(gain_error)) * low_v / offset_v
