"""A gyroscope from a data sheet: the parameters that give its values.

What a data sheet does not say is chosen as for the shipped sets and scaled: forces and loops with frequency and quality
factor, the in-phase mode with the drive frequency, but never near the mode that measures.
"""

import math
from collections.abc import Iterator
from typing import Annotated

import numpy as np
from msgspec import Struct
from msgspec.structs import replace

from vcfbench.errors import ConfigError
from vcfbench.sim.gyro.design import IDEAL_TARGETS, PAPER_TARGETS, PERFECT, demodulated, design, imperfect
from vcfbench.sim.parameters import BenchParameters, SenseMode

FLICKER_MINIMUM = 0.6642824702679
"""sqrt(2 ln 2 / pi): the lowest point of an Allan curve of flicker noise over its coefficient B."""
OUTPUT_SHARE = 0.85
"""Share of the rails that the output stage gives."""
_SENSE_SHARE = 0.5
"""Share of the rails that the sense signal takes at most, quadrature and a rate at the end of the range together."""
_SECONDS = 3600.0
_LEAST_LOOP_S = 0.01
"""Quality factor over frequency of the fastest drive mode whose loop is as fast: its sampled controller locks none."""
_DRIVE_STARTS_S, _OUTPUT_SETTLES_S = 600.0, 20.0
"""Longest times that a drive loop takes to start and an output to settle."""
_BY_V_VC = 1.1
"""Output by a V_Vc for the range, over what is asked for: the paper's modulator and a generator of 2 % make 9 %."""
_ROOM = 4.5
"""Standard deviations of the output between it and its end: beyond, what is cut off its mean is not seen."""
_LEAST_OUTPUT_V = 0.2
"""Output at the end of the range, of which a meter on its range of 10 V still tells a thousandth."""
LEAST_SINE_V = 0.01
"""The smallest sine of a 33220A."""
_WHOLE_RANGE_V = (0.4, 9.0)
"""V_Vc that stands for the whole range, between which generators reach it with 2 % of it as their offset."""
_NOISE_SHARE = 2e-3
"""Share of the range that white noise in a second, and flicker, may have: ten readings then see a step of 4 %."""
_EITHER_SIGN = "either sign"
MOST_RANGE_DEG_S = 900.0
"""The simulated table turns at 1000 deg/s, its own trip above the limit included."""


class DataSheet(Struct, frozen=True, kw_only=True):
    """Data sheet of a gyroscope; each figure is annotated with its least and largest size.

    Args:
        scale_factor_v_per_deg_s: of the output, signed. bias_deg_s: at rest, as a rate. range_deg_s: either way.
        drive_hz: of the drive mode. split_hz: drive less sense frequency, either sign.
        q_drive, q_sense: quality factors. quadrature_deg_s: as the rate that moves the sense mode as much.
        angle_random_walk_deg_sqrt_h: white noise. bias_instability_deg_h: lowest point of the Allan curve.
        bandwidth_hz: where the output is 3 dB down, a quarter to half the split; None: the filter is at four splits.
        k_vc_deg_s_per_v: rate that one volt of V_Vc stands for, signed. rail_v: supply, of as many `rails`, 2 or 1.

    Raises:
        ConfigError: a figure that no such gyroscope has; its name comes first.
    """

    scale_factor_v_per_deg_s: Annotated[float, 1e-5, 10.0, _EITHER_SIGN] = IDEAL_TARGETS.scale_factor_v_s_deg
    bias_deg_s: Annotated[float, 0.0, 1000.0, _EITHER_SIGN] = 0.0
    range_deg_s: Annotated[float, 10.0, MOST_RANGE_DEG_S] = 200.0
    drive_hz: Annotated[float, 1000.0, 50_000.0] = PERFECT.drive_mode.frequency_hz
    q_drive: Annotated[float, 100.0, 1e5] = PERFECT.drive_mode.quality
    split_hz: Annotated[float, 3.0, 80.0, _EITHER_SIGN] = 24.8
    q_sense: Annotated[float, 100.0, 1e5] = PERFECT.sense_anti_phase.quality
    quadrature_deg_s: Annotated[float, 0.0, 300.0] = 0.0
    angle_random_walk_deg_sqrt_h: Annotated[float, 0.0, 100.0] = 0.0
    bias_instability_deg_h: Annotated[float, 0.0, 10_000.0] = 0.0
    bandwidth_hz: Annotated[float | None, 0.5, 40.0] = None
    k_vc_deg_s_per_v: Annotated[float, 0.1, 10_000.0, _EITHER_SIGN] = 150.0
    rail_v: Annotated[float, 3.0, 15.0] = PERFECT.supply.nominal_v
    rails: Annotated[float, 1.0, 2.0] = 2.0

    @property
    def rest_v(self) -> float:
        """Output at rest, V: in the middle of the supply where it is one."""
        return 0.5 * self.rail_v if self.rails < 2.0 else 0.0

    @property
    def swing_v(self) -> float:
        """Largest distance of the output from there, V."""
        return OUTPUT_SHARE * (self.rail_v - self.rest_v)

    def __post_init__(self) -> None:
        for name, annotated in self.__annotations__.items():
            value, (low, high, *either) = getattr(self, name), annotated.__metadata__
            if value is not None and not low <= (abs(value) if either else value) <= high:
                said = f"a size from {low:g} to {high:g}, {_EITHER_SIGN}" if either else f"{low:g} to {high:g}"
                raise ConfigError(f"{name}: expected {said}, got {value:g}")
        for name, expected, came, holds in self._agreements():
            if not holds:
                raise ConfigError(f"{name}: expected {expected}, got {came}")

    def _agreements(self) -> Iterator[tuple[str, str, str, bool]]:
        """Yield what figures must have in common: the key that is named, what is expected, what came, if it holds."""
        split_hz, q, drive_hz = abs(self.split_hz), self.q_sense, self.drive_hz
        yield "split_hz", "at most a tenth of drive_hz", f"{self.split_hz:g}", split_hz <= 0.1 * drive_hz
        peak = f"at least 2 drive_hz / split_hz, or the response has no peak: {2.0 * drive_hz / split_hz:.4g}"
        yield "q_sense", peak, f"{q:g}", q * split_hz >= 2.0 * drive_hz
        if self.bandwidth_hz is not None:
            came = f"{self.bandwidth_hz:g}"
            seen = 0.25 * split_hz <= self.bandwidth_hz <= 0.5 * split_hz
            yield "bandwidth_hz", "a quarter to half the split, else no peak is seen", came, seen
        started, sense_s = started_s(self), settling_s(self)[1]
        yield "q_drive", f"a start within {_DRIVE_STARTS_S:g} s", f"{started:.3g} s", started <= _DRIVE_STARTS_S
        yield "rails", "2, or 1 of one supply", f"{self.rails:g}", self.rails in {1.0, 2.0}
        settled = sense_s <= _OUTPUT_SETTLES_S
        yield "q_sense", f"an output that settles within {_OUTPUT_SETTLES_S:g} s", f"{sense_s:.3g} s", settled
        least_v, most_v = _LEAST_OUTPUT_V, self.swing_v
        slope, bias_deg_s = abs(self.scale_factor_v_per_deg_s), abs(self.bias_deg_s)
        level_v = slope * (_BY_V_VC * self.range_deg_s + bias_deg_s)
        within = f"outputs within {most_v:g} V, V_Vc up to {100.0 * _BY_V_VC - 100.0:.0f} % off"
        yield "range_deg_s", within, f"{level_v:.3g} V", level_v <= most_v
        sine_v = slope * (LEAST_SINE_V * abs(self.k_vc_deg_s_per_v) * peak_response(self) + bias_deg_s)
        within = f"outputs within {most_v:g} V at the peak of the response, by a sine of {LEAST_SINE_V:g} V on V_Vc"
        yield "q_sense", within, f"{sine_v:.3g} V", sine_v <= most_v
        noise_v, most_noise_v = slope * noise_deg_s(self), (most_v - max(level_v, sine_v)) / _ROOM
        within = f"an output that scatters by at most {most_noise_v:.3g} V, or its end cuts it off"
        yield "angle_random_walk_deg_sqrt_h", within, f"{noise_v:.3g} V", noise_v <= most_noise_v
        whole_v = slope * self.range_deg_s
        least = f"an output of at least {least_v:g} V at the end of range_deg_s"
        yield "scale_factor_v_per_deg_s", least, f"{whole_v:.3g} V", whole_v >= least_v
        whole_v = self.range_deg_s / abs(self.k_vc_deg_s_per_v)
        low_v, high_v = _WHOLE_RANGE_V
        stands = f"the range at {low_v:g} to {high_v:g} V of V_Vc"
        yield "k_vc_deg_s_per_v", stands, f"{whole_v:.3g} V", low_v <= whole_v <= high_v
        most_deg_s = _NOISE_SHARE * self.range_deg_s
        white_deg_s = self.angle_random_walk_deg_sqrt_h / math.sqrt(_SECONDS)
        small = f"at most {_NOISE_SHARE:g} of the range in a second"
        yield "angle_random_walk_deg_sqrt_h", small, f"{white_deg_s:.3g} deg/s", white_deg_s <= most_deg_s
        flicker_deg_s = self.bias_instability_deg_h / FLICKER_MINIMUM / _SECONDS
        small = f"flicker of at most {_NOISE_SHARE:g} of the range"
        yield "bias_instability_deg_h", small, f"{flicker_deg_s:.3g} deg/s", flicker_deg_s <= most_deg_s
        leak_deg_s = self.quadrature_deg_s * drive_hz / (2.0 * q * split_hz)
        within = "a leak into the output, by the phase of the sense mode, within the range"
        yield "quadrature_deg_s", within, f"{leak_deg_s:.3g} deg/s", leak_deg_s <= self.range_deg_s

    @property
    def low_pass_hz(self) -> float:
        """Corner of the filter behind the demodulator, Hz."""
        if self.bandwidth_hz is None:
            return 4.0 * abs(self.split_hz)
        rise = rate_response(_modes(PERFECT, self), self.bandwidth_hz)
        return float(self.bandwidth_hz / (2.0 * rise**2 - 1.0) ** (0.5 / PERFECT.sense_path.low_pass_order))

    @property
    def in_phase_split_hz(self) -> float:
        """Amount by which the in-phase sense mode is below the drive mode, Hz."""
        usual = 1.0 - PERFECT.sense_in_phase.frequency_hz / PERFECT.drive_mode.frequency_hz
        return max(usual * self.drive_hz, 6.0 * abs(self.split_hz))


def own_gyro(sheet: DataSheet, *, imperfections: bool, latitude_deg: float) -> BenchParameters:
    """Return the parameters of a bench with the gyroscope of `sheet`; else perfect, or as imperfect as the paper's."""
    base = imperfect() if imperfections else PERFECT
    bench = _modes(base, sheet)
    # The drive loop is as fast, against the time constant of its mode, as that of the shipped sets
    loop, usual, supply, path = base.drive_loop, PERFECT.drive_mode, base.supply, base.sense_path
    slower = _loop_s(sheet) / (usual.quality / usual.frequency_hz)
    stiffer = (sheet.drive_hz / usual.frequency_hz) ** 2 * usual.quality / sheet.q_drive
    higher = sheet.rail_v / supply.nominal_v
    bench = replace(
        bench,
        site=replace(base.site, latitude_deg=latitude_deg),
        drive_loop=replace(
            loop,
            agc_integral_per_s=loop.agc_integral_per_s / slower,
            force_limit_n_per_v=loop.force_limit_n_per_v * stiffer / higher,
            pll_proportional_per_s=loop.pll_proportional_per_s / slower,
            pll_integral_per_s2=loop.pll_integral_per_s2 / slower**2,
            pll_free_running_offset_hz=loop.pll_free_running_offset_hz / slower,
            amplitude_supply_coefficient_per_v=loop.amplitude_supply_coefficient_per_v / higher,
        ),
        sense_path=replace(
            path,
            amplifier_gain=path.amplifier_gain * min(1.0, _SENSE_SHARE * sheet.rail_v / _sense_v(bench, sheet)),
            low_pass_hz=sheet.low_pass_hz,
        ),
        output_stage=replace(base.output_stage, headroom_v=sheet.rail_v - sheet.rest_v - sheet.swing_v),
        supply=replace(
            supply,
            nominal_v=sheet.rail_v,
            rails=sheet.rails,
            start_v=supply.start_v * higher,
            brown_out_v=supply.brown_out_v * higher,
            dead_v=supply.dead_v * higher,
        ),
        noise=replace(
            base.noise,
            angle_random_walk_deg_sqrt_s=sheet.angle_random_walk_deg_sqrt_h / math.sqrt(_SECONDS),
            bias_instability_deg_s=sheet.bias_instability_deg_h / FLICKER_MINIMUM / _SECONDS,
        ),
    )
    shape = PAPER_TARGETS if imperfections else IDEAL_TARGETS
    slope = sheet.scale_factor_v_per_deg_s
    larger, wider = slope / shape.scale_factor_v_s_deg, 200.0 / sheet.range_deg_s
    targets = replace(
        shape,
        bias_v=sheet.rest_v + slope * sheet.bias_deg_s,
        scale_factor_v_s_deg=slope,
        second_order=shape.second_order * larger * wider,
        third_order=shape.third_order * larger * wider**2,
        virtual_scale_deg_s_v=sheet.k_vc_deg_s_per_v,
        switch_on_shift_v=shape.switch_on_shift_v * larger / wider,
    )
    louder = (sheet.range_deg_s / abs(sheet.k_vc_deg_s_per_v)) / (200.0 / shape.virtual_scale_deg_s_v)
    virtual = replace(  # bent as much over the V_Vc of its range
        base.virtual_path,
        second_order_per_v=base.virtual_path.second_order_per_v / louder,
        third_order_per_v2=base.virtual_path.third_order_per_v2 / louder**2,
    )
    return design(replace(bench, virtual_path=virtual), targets)


def _modes(base: BenchParameters, sheet: DataSheet) -> BenchParameters:
    """Return `base` with frequencies, quality factors and quadrature of the sheet.

    The split changes by the same share with the temperature as that of `base`.
    """
    drive = base.drive_mode

    def sense(mode: SenseMode, below_hz: float, quadrature_deg_s: float) -> SenseMode:
        usual = drive.frequency_hz / mode.frequency_hz - 1.0
        apart = (mode.frequency_coefficient_per_k - drive.frequency_coefficient_per_k) / usual
        own_hz = sheet.drive_hz - below_hz
        return replace(
            mode,
            frequency_hz=own_hz,
            quality=sheet.q_sense,
            quadrature_rad_s=math.radians(quadrature_deg_s),
            frequency_coefficient_per_k=drive.frequency_coefficient_per_k + apart * (sheet.drive_hz / own_hz - 1.0),
        )

    return replace(
        base,
        drive_mode=replace(drive, frequency_hz=sheet.drive_hz, quality=sheet.q_drive),
        sense_in_phase=sense(base.sense_in_phase, sheet.in_phase_split_hz, 0.25 * sheet.quadrature_deg_s),
        sense_anti_phase=sense(base.sense_anti_phase, sheet.split_hz, sheet.quadrature_deg_s),
    )


def _sense_v(bench: BenchParameters, sheet: DataSheet) -> float:
    """Return the amplitude of the sense signal at the end of the range, quadrature beside it, V."""
    rate_rad_s = math.radians(math.hypot(sheet.range_deg_s + abs(sheet.bias_deg_s), sheet.quadrature_deg_s))
    path, drive_rad_s = bench.sense_path, 2.0 * math.pi * sheet.drive_hz
    force = 2.0 * bench.drive_loop.amplitude_m * drive_rad_s * rate_rad_s
    own_rad_s = 2.0 * math.pi * bench.sense_anti_phase.frequency_hz
    moved_m = force / abs(own_rad_s**2 - drive_rad_s**2)
    return path.preamplifier_gain * path.amplifier_gain * bench.sense_anti_phase.pick_off_v_per_m * moved_m


def rate_response(bench: BenchParameters, frequency_hz: float) -> float:
    """Return the size of the modes' response to a rate of this frequency over that to a constant one, filter aside."""

    def through(at_hz: float) -> complex:
        total = 0j
        for mode in (bench.sense_in_phase, bench.sense_anti_phase):
            own = mode.frequency_hz
            share = mode.pick_off_v_per_m * (mode.left_participation + mode.right_participation)
            for side in (drive_hz + at_hz, at_hz - drive_hz):
                total += share / complex(own**2 - side**2, side * own / mode.quality)
        return total

    drive_hz = bench.drive_mode.frequency_hz
    return abs(through(frequency_hz)) / abs(through(0.0))


def peak_response(sheet: DataSheet) -> float:
    """Return how much larger the output is at a rate of the split's frequency than at a constant one."""
    passed = 1.0 + (sheet.split_hz / sheet.low_pass_hz) ** (2 * PERFECT.sense_path.low_pass_order)
    return rate_response(_modes(PERFECT, sheet), abs(sheet.split_hz)) / math.sqrt(passed)


def noise_deg_s(sheet: DataSheet) -> float:
    """Return the standard deviation of the output by white noise, deg/s: that of the mode, at the split."""
    white = sheet.angle_random_walk_deg_sqrt_h / math.sqrt(_SECONDS)
    return white * peak_response(sheet) * math.sqrt(2.0 * math.pi * sheet.drive_hz / sheet.q_sense)


def settling_s(sheet: DataSheet) -> tuple[float, float]:
    """Return the settling times of drive loop and output, to 1e-5, s."""
    drive_s = 20.0 / math.pi * _loop_s(sheet)
    sense_s = 12.0 * sheet.q_sense / (math.pi * sheet.drive_hz) + 6.0 / sheet.low_pass_hz
    return drive_s, sense_s


def started_s(sheet: DataSheet) -> float:
    """Return the time after power-on, s, at which an output has settled."""
    times = max(1.0, peak_response(sheet)) * (1.0 + sheet.quadrature_deg_s / sheet.range_deg_s)
    return sum(settling_s(sheet)) + sheet.q_sense / (math.pi * sheet.drive_hz) * math.log(times)


def _loop_s(sheet: DataSheet) -> float:
    return max(_LEAST_LOOP_S, sheet.q_drive / sheet.drive_hz)


def in_phase_share(sheet: DataSheet) -> float:
    """Return the share of the in-phase mode in the response to a constant rate."""
    drive_hz = sheet.drive_hz
    apart = [(drive_hz - below) ** 2 - drive_hz**2 for below in (sheet.split_hz, sheet.in_phase_split_hz)]
    return apart[0] / (apart[0] + apart[1])


def noise_bandwidth_hz(sheet: DataSheet, aperture_s: float) -> float:
    """Return the noise bandwidth of readings, from the white forces of both side bands."""
    bench = _modes(PERFECT, sheet)
    half_hz, split_hz, most_hz = 0.5 * sheet.drive_hz / sheet.q_sense, abs(sheet.split_hz), 8.0 * sheet.low_pass_hz
    near = split_hz + half_hz * np.sinh(np.linspace(-9.0, 9.0, 4001))  # close where the modes are
    f = np.unique(np.concatenate([np.linspace(0.0, most_hz, 4001), near[(near > 0.0) & (near < most_hz)]]))
    drive = 2.0 * math.pi * sheet.drive_hz
    at = np.stack([drive + 2.0 * math.pi * f, drive - 2.0 * math.pi * f])
    owns = [2.0 * math.pi * mode.frequency_hz for mode in (bench.sense_in_phase, bench.sense_anti_phase)]
    bands = np.sum([1.0 / (own**2 - at**2 + 1j * own * at / sheet.q_sense) for own in owns], axis=0)
    passed = np.sinc(f * aperture_s) ** 2 / (1.0 + (f / sheet.low_pass_hz) ** (2 * PERFECT.sense_path.low_pass_order))
    power = 0.5 * (np.abs(bands) ** 2).sum(axis=0) / bands[0, 0].real ** 2 * passed
    return float(np.trapezoid(power, f))


def change_per_k(bench: BenchParameters) -> tuple[float, float]:
    """Return the change by a kelvin of the scale factor, relative, and of what quadrature leaks, deg/s."""
    amplitude_m = bench.drive_loop.amplitude_m
    warmer, cooler = (demodulated(bench, rise_k, amplitude_m) for rise_k in (0.5, -0.5))
    middle = 0.5 * (warmer.per_deg_s + cooler.per_deg_s)
    return (warmer.per_deg_s - cooler.per_deg_s) / middle, (warmer.at_rest_v - cooler.at_rest_v) / middle
