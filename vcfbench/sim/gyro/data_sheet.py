"""A gyroscope of one's own: the parameters that give back the values of a data sheet.

What a data sheet does not say is chosen as for the shipped sets and scaled: forces and loops with frequency and quality
factor, the in-phase mode with the drive frequency, but never near the mode that measures.
"""

import math
from typing import Annotated

from msgspec import Struct
from msgspec.structs import replace

from vcfbench.errors import ConfigError
from vcfbench.sim.gyro.design import IDEAL_TARGETS, PAPER_TARGETS, PERFECT, design, imperfect
from vcfbench.sim.parameters import BenchParameters, SenseMode

FLICKER_MINIMUM = 0.6642824702679
"""sqrt(2 ln 2 / pi): the lowest point of an Allan curve of flicker noise over its coefficient B."""
_HEADROOM_V = 8.5
"""What the output stage gives at rails of 10 V."""
_SECONDS = 3600.0


class DataSheet(Struct, frozen=True, kw_only=True):
    """Data sheet of a gyroscope; each figure is annotated with the least and the largest size that it may have.

    Args:
        scale_factor_v_per_deg_s: of the output, signed. bias_deg_s: at rest, as a rate. range_deg_s: either way.
        drive_hz: of the drive mode. split_hz: drive less sense frequency, either sign.
        q_drive, q_sense: quality factors.
        angle_random_walk_deg_sqrt_h: white noise. bias_instability_deg_h: lowest point of the Allan curve.
        bandwidth_hz: where the output is 3 dB down, at most half the split; None: the filter is at four splits.
        k_vc_deg_s_per_v: rate that one volt of V_Vc stands for.

    Raises:
        ConfigError: a figure that no such gyroscope has; its name comes first.
    """

    scale_factor_v_per_deg_s: Annotated[float, 1e-5, 10.0] = IDEAL_TARGETS.scale_factor_v_s_deg
    bias_deg_s: Annotated[float, 0.0, 1000.0] = 0.0
    range_deg_s: Annotated[float, 1.0, 900.0] = 200.0
    drive_hz: Annotated[float, 500.0, 50_000.0] = PERFECT.drive_mode.frequency_hz
    q_drive: Annotated[float, 10.0, 1e6] = PERFECT.drive_mode.quality
    split_hz: Annotated[float, 1.0, 1000.0] = 24.8
    q_sense: Annotated[float, 10.0, 1e6] = PERFECT.sense_anti_phase.quality
    angle_random_walk_deg_sqrt_h: Annotated[float, 0.0, 100.0] = 0.0
    bias_instability_deg_h: Annotated[float, 0.0, 10_000.0] = 0.0
    bandwidth_hz: Annotated[float | None, 0.5, 500.0] = None
    k_vc_deg_s_per_v: Annotated[float, 0.1, 10_000.0] = 150.0

    def __post_init__(self) -> None:
        for name, annotated in self.__annotations__.items():
            value, (low, high) = getattr(self, name), annotated.__metadata__
            if value is not None and not low <= abs(value) <= high:
                raise ConfigError(f"{name}: expected a size from {low:g} to {high:g}, came {value:g}")
        if abs(self.split_hz) > 0.1 * self.drive_hz:
            raise ConfigError(f"split_hz: expected at most a tenth of drive_hz, came {self.split_hz:g}")
        if self.bandwidth_hz is not None and self.bandwidth_hz > 0.5 * abs(self.split_hz):
            raise ConfigError(f"bandwidth_hz: expected at most half the split, came {self.bandwidth_hz:g}")
        largest_v = abs(self.scale_factor_v_per_deg_s) * (self.range_deg_s + abs(self.bias_deg_s))
        if largest_v > _HEADROOM_V:
            raise ConfigError(f"range_deg_s: expected outputs within {_HEADROOM_V:g} V, came {largest_v:.3g} V")

    @property
    def low_pass_hz(self) -> float:
        """Corner of the filter behind the demodulator, Hz."""
        if self.bandwidth_hz is None:
            return 4.0 * abs(self.split_hz)
        rise = rate_response(_modes(PERFECT, self), self.bandwidth_hz)
        return float(self.bandwidth_hz / (2.0 * rise**2 - 1.0) ** (0.5 / PERFECT.sense_path.low_pass_order))

    @property
    def in_phase_split_hz(self) -> float:
        """How far the in-phase sense mode is below the drive mode, Hz."""
        usual = 1.0 - PERFECT.sense_in_phase.frequency_hz / PERFECT.drive_mode.frequency_hz
        return max(usual * self.drive_hz, 6.0 * abs(self.split_hz))


def own_gyro(sheet: DataSheet, *, imperfections: bool, latitude_deg: float) -> BenchParameters:
    """Return the parameters of a bench with the gyroscope of `sheet`; else perfect, or as imperfect as the paper's."""
    base = imperfect() if imperfections else PERFECT
    bench = replace(_modes(base, sheet), site=replace(base.site, latitude_deg=latitude_deg))
    # The drive loop is as fast, against the time constant of its mode, as that of the shipped sets
    loop, usual = bench.drive_loop, PERFECT.drive_mode
    slower = (sheet.q_drive / sheet.drive_hz) / (usual.quality / usual.frequency_hz)
    stiffer = (sheet.drive_hz / usual.frequency_hz) ** 2 * usual.quality / sheet.q_drive
    bench = replace(
        bench,
        drive_loop=replace(
            loop,
            agc_integral_per_s=loop.agc_integral_per_s / slower,
            force_limit_n_per_v=loop.force_limit_n_per_v * stiffer,
            pll_proportional_per_s=loop.pll_proportional_per_s / slower,
            pll_integral_per_s2=loop.pll_integral_per_s2 / slower**2,
            pll_free_running_offset_hz=loop.pll_free_running_offset_hz / slower,
        ),
        sense_path=replace(bench.sense_path, low_pass_hz=sheet.low_pass_hz),
        noise=replace(
            bench.noise,
            angle_random_walk_deg_sqrt_s=sheet.angle_random_walk_deg_sqrt_h / math.sqrt(_SECONDS),
            bias_instability_deg_s=sheet.bias_instability_deg_h / FLICKER_MINIMUM / _SECONDS,
        ),
    )
    shape = PAPER_TARGETS if imperfections else IDEAL_TARGETS
    slope = sheet.scale_factor_v_per_deg_s
    larger, wider = slope / shape.scale_factor_v_s_deg, 200.0 / sheet.range_deg_s
    targets = replace(
        shape,
        bias_v=slope * sheet.bias_deg_s,
        scale_factor_v_s_deg=slope,
        second_order=shape.second_order * larger * wider,
        third_order=shape.third_order * larger * wider**2,
        virtual_scale_deg_s_v=sheet.k_vc_deg_s_per_v,
        switch_on_shift_v=shape.switch_on_shift_v * larger,
    )
    return design(bench, targets)


def _modes(base: BenchParameters, sheet: DataSheet) -> BenchParameters:
    """Return `base` with the frequencies and quality factors of the sheet."""

    def sense(mode: SenseMode, below_hz: float) -> SenseMode:
        return replace(mode, frequency_hz=sheet.drive_hz - below_hz, quality=sheet.q_sense)

    return replace(
        base,
        drive_mode=replace(base.drive_mode, frequency_hz=sheet.drive_hz, quality=sheet.q_drive),
        sense_in_phase=sense(base.sense_in_phase, sheet.in_phase_split_hz),
        sense_anti_phase=sense(base.sense_anti_phase, sheet.split_hz),
    )


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
    """Return how much larger the response is at a rate of the split's frequency than at a constant one."""
    return rate_response(_modes(PERFECT, sheet), abs(sheet.split_hz))


def settling_s(sheet: DataSheet) -> tuple[float, float]:
    """Return the settling times of drive loop and output, to 1e-5, s."""
    drive_s = 20.0 * sheet.q_drive / (math.pi * sheet.drive_hz)
    sense_s = 12.0 * sheet.q_sense / (math.pi * sheet.drive_hz) + 3.0 / sheet.low_pass_hz
    return drive_s, sense_s
