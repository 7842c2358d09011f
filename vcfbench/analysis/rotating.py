"""The phase of a demodulator's reference from records of its input and its output.

A force at f_d + delta makes the phasor of the sense signal turn against the drive once in 1/delta; the demodulated
output is its projection on the reference, a sine of |delta|. So the reference lies where the phasor is when the output
peaks, apart from half a turn and from the delay of the filter behind the demodulator, which changes its sign with
delta.
"""

import math
from collections.abc import Sequence

import numpy as np
from msgspec import Struct
from numpy.typing import ArrayLike, NDArray

from vcfbench.analysis.arrays import Floats
from vcfbench.analysis.sine_fit import fit_sine
from vcfbench.errors import ConfigError

_ROUNDS = 30
_SETTLED = 1e-9
_TIME_BASES = 6e-5
"""Largest relative difference of their time bases: 33220A 20 ppm (unverified), DSO7104B 25 ppm after five years."""

_IN_STEP = 0.05
"""Turns over a record by which a line is lost to 0.4 % of its amplitude."""
_LEAST_LAG_DEG = -5.0
"""Of a filter: it never leads, but noise may have it so. Up to half a turn more the records tell how much it lags."""


class Rotation(Struct, frozen=True):
    """One record in which the sense signal has a part that turns against the drive.

    `difference_hz` is the frequency of that part less that of the drive. `reference_deg`, -180 to 180, is the phase of
    the reference against the drive signal plus what the filter delays at `difference_hz` (odd in it), apart from half
    a turn. `turning` and `output` are the amplitudes of the turning part and of the output's sine, in their units.
    """

    drive_hz: float
    difference_hz: float
    reference_deg: float
    turning: float
    output: float


class ReferencePhase(Struct, frozen=True):
    """Phase of a demodulator's reference against the drive signal, deg, -90 to 90: half turns are not seen.

    `delay_s` is that of the filter behind the demodulator. The uncertainties are the scatter of the records;
    `scatter_deg` is that of the phase of one.
    """

    phase_deg: float
    u_phase_deg: float
    delay_s: float
    u_delay_s: float
    dof: int
    scatter_deg: float


def fit_rotation(
    drive: ArrayLike, sense: ArrayLike, output: ArrayLike, interval_s: float, difference_hz: float
) -> Rotation:
    """Fit the drive, both parts of the sense signal and the output; `difference_hz` is where to look, with its sign.

    Raises:
        ConfigError: records of different lengths, without a sine, or less than two turns of the difference long.
    """
    channels = [np.asarray(each, dtype=np.float64) for each in (drive, sense, output)]
    count = channels[0].size
    if any(each.shape != (count,) for each in channels):
        raise ConfigError(f"records must be as long as each other, got {[each.shape for each in channels]}")
    if abs(difference_hz) * count * interval_s < 2.0:
        raise ConfigError(f"a record of {count * interval_s:g} s is shorter than two periods of {difference_hz:g} Hz")
    driven = fit_sine(channels[0], interval_s)
    times: Floats = np.asarray((np.arange(count) - (count - 1) / 2.0) * interval_s, dtype=np.float64)
    turning_hz, turning = _turning(channels[1], times, driven.frequency_hz, driven.frequency_hz + difference_hz)
    difference = turning_hz - driven.frequency_hz
    slow = _amplitudes(channels[2], times, [abs(difference), 2.0 * abs(difference)])[0]
    middle_s = (count - 1) / 2.0 * interval_s
    drive_rad = driven.phase_rad + 2.0 * math.pi * driven.frequency_hz * middle_s
    against_rad = float(np.angle(turning)) - drive_rad
    swing_rad = math.copysign(1.0, difference) * float(np.angle(slow))
    return Rotation(
        driven.frequency_hz,
        difference,
        math.degrees(math.remainder(against_rad - swing_rad, 2.0 * math.pi)),
        float(abs(turning)),
        float(abs(slow)),
    )


def _amplitudes(samples: Floats, times: Floats, frequencies_hz: Sequence[float]) -> NDArray[np.complex128]:
    """Return the phasors of cosines of these frequencies, fitted beside a straight line."""
    found = _solved(_basis(times, frequencies_hz), samples)
    count = len(frequencies_hz)
    return np.asarray(found[2 : 2 + count] - 1j * found[2 + count :])


def _solved(rows: Floats, samples: Floats) -> Floats:
    """Return the least-squares solution by normal equations: whole turns are in a record, so it is well conditioned."""
    return np.asarray(np.linalg.solve(rows.T @ rows, rows.T @ samples))


def _basis(times: Floats, frequencies_hz: Sequence[float]) -> Floats:
    angle = 2.0 * math.pi * np.outer(times, frequencies_hz)
    return np.column_stack([np.ones_like(times), times / times[-1], np.cos(angle), np.sin(angle)])


def _turning(samples: Floats, times: Floats, drive_hz: float, start_hz: float) -> tuple[float, complex]:
    """Return frequency and phasor of the part that is not at the drive's frequency, by Gauss and Newton."""
    length_s = float(times[-1] - times[0])
    # So short a record knows less of the frequency than the generator does: what noise hides is where it was sent
    in_step = 2.0 * _TIME_BASES * drive_hz * length_s < _IN_STEP
    frequency = _line_hz(samples, times, drive_hz, start_hz)
    for _ in range(_ROUNDS):
        basis = _basis(times, [drive_hz, frequency])
        found = _solved(basis, samples)
        phasor = complex(found[3], -found[5])
        swing = np.exp(2j * math.pi * frequency * times)
        by_frequency = (2j * math.pi * times * phasor * swing).real
        left = samples - basis @ found
        change = _solved(np.column_stack([by_frequency, basis]), left)
        step = float(change[0])
        frequency += step
        if in_step and abs(frequency - start_hz) * length_s > 1.0:
            break
        if abs(step) * length_s < _SETTLED:
            return frequency, complex(_amplitudes(samples, times, [drive_hz, frequency])[1])
    if in_step:
        return start_hz, complex(_amplitudes(samples, times, [drive_hz, start_hz])[1])
    raise ConfigError(f"no part of the sense signal turns against the drive near {start_hz:g} Hz")


def _line_hz(samples: Floats, times: Floats, drive_hz: float, expected_hz: float) -> float:
    """Return `expected_hz`, or the strongest line near it that is not the drive's, where that is another one.

    V_Vc is at twice the drive and a little: what the time bases of generator and oscilloscope differ by can be more of
    a drive at 36 kHz than the little.
    """
    apart_hz = 1.0 / float(times[-1] - times[0])
    drive = _basis(times, [drive_hz])
    left = samples - drive @ _solved(drive, samples)
    count = 4 * left.size
    level = np.abs(np.fft.rfft(left * np.hanning(left.size), count))
    at_hz = np.fft.rfftfreq(count, float(times[1] - times[0]))
    near = np.abs(at_hz - expected_hz) <= apart_hz + 2.0 * _TIME_BASES * drive_hz
    near &= np.abs(at_hz - drive_hz) > apart_hz
    found = float(at_hz[np.where(near, level, 0.0).argmax()]) if near.any() else expected_hz
    return found if abs(found - expected_hz) > 0.5 * apart_hz else expected_hz


def reference_phase(rotations: Sequence[tuple[float, float]]) -> ReferencePhase:
    """Return the phase of the reference without the filter's delay, from `difference_hz` and `reference_deg` of some.

    All records share the half turn that is not seen, so that the lag at either difference is known apart from one.

    Raises:
        ConfigError: fewer than two in either direction.
    """
    difference = np.array([difference_hz for difference_hz, _ in rotations])
    if min(int((difference > 0.0).sum()), int((difference < 0.0).sum())) < 2:
        raise ConfigError("the phase of the reference needs two records at least of either direction")
    seen = np.exp(1j * np.radians([reference_deg for _, reference_deg in rotations]))
    above, below = (np.angle(seen[sign * difference > 0.0].mean(), deg=True) for sign in (1.0, -1.0))
    late_deg = _LEAST_LAG_DEG + (0.5 * (above - below) - _LEAST_LAG_DEG) % 180.0
    foreseen_deg = above - late_deg + np.sign(difference) * late_deg
    phase_deg = foreseen_deg + np.angle(seen * np.exp(-1j * np.radians(foreseen_deg)), deg=True)
    design = np.column_stack([np.ones_like(difference), difference])
    found, *_ = np.linalg.lstsq(design, phase_deg, rcond=None)
    dof = difference.size - 2
    left = phase_deg - design @ found
    covariance = np.linalg.inv(design.T @ design) * float(left @ left) / dof
    return ReferencePhase(
        math.remainder(float(found[0]), 180.0),
        math.sqrt(covariance[0, 0]),
        float(found[1]) / 360.0,
        math.sqrt(covariance[1, 1]) / 360.0,
        dof,
        math.sqrt(float(left @ left) / dof),
    )
