"""What a calibration procedure is told before it starts: frozen numbers, no instruments."""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from enum import Enum
from typing import TYPE_CHECKING, Any

from vcfbench.errors import ConfigError
from vcfbench.models import find_model, resolve
from vcfbench.procedures.linear_gyro import LinearGyro
from vcfbench.specifications import HP_34401A

if TYPE_CHECKING:
    from collections.abc import Mapping

    from vcfbench.bench.description import BenchDescription, Node
    from vcfbench.specifications import VoltmeterSpecification

__all__ = [
    "PAPER_RATES_DEG_S",
    "CalibrationSettings",
    "DriveWindows",
    "Expected",
    "Limit",
    "Match",
    "RailSettings",
    "settings_of",
]

PAPER_RATES_DEG_S = (
    *(200.0, 100.0, 50.0, 20.0, 10.0, 5.0, 2.0, 1.0, 0.0),
    *(-1.0, -2.0, -5.0, -10.0, -20.0, -50.0, -100.0, -200.0),
)
"""The 17 rates of the paper's Table 1 in its order, deg/s."""


class Match(Enum):
    """How step 2 compares the two outputs.

    `ZERO` subtracts from each its own zero output, so that a difference of the zeros does not enter K_Vc. `ABSOLUTE`
    does the paper's words literally; an offset between the two zeros then goes into K_Vc in full.
    """

    ZERO = "zero"
    ABSOLUTE = "absolute"


@dataclass(frozen=True, slots=True)
class RailSettings:
    """One rail of the PCB: its name, the supply output that feeds it, level (V) and current limit (A)."""

    rail: str
    output: str
    voltage_v: float
    current_limit_a: float


@dataclass(frozen=True, slots=True)
class DriveWindows:
    """Where the drive signal must lie at the start-up check, each (least, most), and the channels that see it.

    It counts as settled when two records, `interval_s` apart, differ by less than `amplitude_tolerance`: 3 %, somewhat
    above what 8 bit resolve. The drive loop's time constant is 0.13 s (gyro-metrology 1.3), so 0.5 s is four of them.
    """

    drive_channel: int
    carrier_channel: int
    frequency_hz: tuple[float, float]
    amplitude_v: tuple[float, float]
    phase_deg: tuple[float, float]
    amplitude_tolerance: float = 0.03
    interval_s: float = 0.5
    deadline_s: float = 5.0


@dataclass(frozen=True, slots=True)
class Expected:
    """What this gyroscope should show, each (least, most); None where nothing is known of it.

    `scale_factor_v_per_deg_s` and `bias_v` (V) are those of the output on the table, `k_vc_deg_s_per_v` is K_Vc,
    `reading_noise_v` the standard deviation of one reading within a window, V; `zero_drift_v` is the most that the
    output may drift at one setting from one time it is measured to another, V.
    """

    scale_factor_v_per_deg_s: tuple[float, float] | None = None
    bias_v: tuple[float, float] | None = None
    k_vc_deg_s_per_v: tuple[float, float] | None = None
    reading_noise_v: tuple[float, float] | None = None
    zero_drift_v: float | None = None


@dataclass(frozen=True, slots=True)
class Limit:
    """A result, by its key in the bench file's ``[acceptance]``, passes from `low` to `high`, both included."""

    key: str
    low: float
    high: float


@dataclass(frozen=True, slots=True)
class CalibrationSettings:
    """All that turntable and virtual Coriolis calibration need to know.

    `k_vc_guess` is the K_Vc from which step 2 starts, (deg/s)/V; `match_iterations` is the most settings of V_Vc it
    may take, `match_windows` how many windows each mean that K_Vc hangs on is made of. `start_up_s` is the wait after
    power-on, `rate_deadline_s` what a table may take beyond twice its ramp. A run that does not show what is `expected`
    is ended; `acceptance` are the limits that its results are judged by. `meter_resolution_v` is that of one reading.
    `drive` is None where no oscilloscope sees the drive signal.
    """

    rails: tuple[RailSettings, ...]
    rail_tolerance_v: float
    drive: DriveWindows | None
    meter_range_v: float
    nplc: float
    meter_resolution_v: float
    samples: int
    sample_interval_s: float
    settle_s: float
    start_up_s: float
    acceleration_deg_s2: float
    rate_tolerance_deg_s: float
    k_vc_guess: float
    rates_deg_s: tuple[float, ...] = PAPER_RATES_DEG_S
    match: Match = Match.ZERO
    match_rate_deg_s: float = 10.0
    match_iterations: int = 4
    match_windows: int = 4
    rate_deadline_s: float = 10.0
    expected: Expected = Expected()
    acceptance: tuple[Limit, ...] = ()

    @classmethod
    def from_json(cls, values: Mapping[str, Any]) -> CalibrationSettings:
        """Return the settings that were written into a record; those without a meter's resolution had a 34401A."""
        import msgspec  # noqa: PLC0415  # only records need it

        known = {"meter_resolution_v": math.nan, **values} if isinstance(values, dict) else values
        told = msgspec.convert(known, cls)
        if not math.isnan(told.meter_resolution_v):
            return told
        return replace(told, meter_resolution_v=HP_34401A.resolution.get(told.nplc, 1e-6) * told.meter_range_v)

    def expected_gyro(self) -> LinearGyro:
        """Return the gyro that the bench file expects: the middle of what it should show, or the guess of K_Vc."""
        expected = self.expected
        return LinearGyro(
            self.k_vc_guess if expected.k_vc_deg_s_per_v is None else _middle(expected.k_vc_deg_s_per_v),
            -0.0125 if expected.scale_factor_v_per_deg_s is None else _middle(expected.scale_factor_v_per_deg_s),
            0.0 if expected.bias_v is None else _middle(expected.bias_v),
        )


def _middle(window: tuple[float, float]) -> float:
    return 0.5 * (window[0] + window[1])


def settings_of(description: BenchDescription, match: Match = Match.ZERO) -> CalibrationSettings:
    """Take the settings of both calibrations from a bench file.

    Raises:
        ConfigError: the oscilloscope does not see the drive signal or the carrier, or the meter has no data sheet.
    """
    from msgspec import structs  # noqa: PLC0415  # the description is made of it, so it is there

    told, wiring = description.procedure, description.wiring.rails
    limit_a = told.rail_current_limit_a
    return CalibrationSettings(
        rails=(
            RailSettings("positive", wiring.positive, told.positive_rail_v, limit_a),
            RailSettings("negative", wiring.negative, told.negative_rail_v, limit_a),
        ),
        rail_tolerance_v=told.rail_tolerance_v,
        drive=_drive_windows(description),
        meter_range_v=float(told.meter_range_v),
        nplc=float(told.nplc),
        meter_resolution_v=_meter_resolution_v(description),
        samples=told.samples,
        sample_interval_s=told.sample_interval_s,
        settle_s=told.settle_s,
        start_up_s=max(told.warm_up_s, told.settle_s),
        acceleration_deg_s2=told.acceleration_deg_s2,
        rate_tolerance_deg_s=told.rate_tolerance_deg_s,
        k_vc_guess=told.k_vc_guess_deg_s_per_v,
        rates_deg_s=told.rates_deg_s,
        match=match,
        match_rate_deg_s=told.match_rate_deg_s,
        expected=Expected(**structs.asdict(description.expected)),
        acceptance=tuple(
            Limit(key, *window) for key, window in structs.asdict(description.acceptance).items() if window
        ),
    )


def _meter_resolution_v(description: BenchDescription) -> float:
    """Return the resolution of one reading of the bench's meter, V, after its data sheet."""
    part, told = description.multimeter, description.procedure
    if part is None:
        raise ConfigError("the bench has no multimeter", instrument="multimeter")
    row = find_model(part.like or part.model)
    if row is None or row.specifications is None:
        raise ConfigError(
            f"multimeter.model: nothing tells the resolution of a {part.model}",
            hint="its row in vcfbench.models names a data sheet (specifications)",
        )
    sheet: VoltmeterSpecification = resolve(row.specifications)
    try:
        return sheet.resolution_v(float(told.meter_range_v), float(told.nplc))
    except ValueError as error:
        raise ConfigError(f"procedure.nplc: {error}") from error


def _drive_windows(description: BenchDescription) -> DriveWindows | None:
    if description.oscilloscope is None:
        return None
    window = description.procedure.drive
    return DriveWindows(
        drive_channel=_channel(description, "drive"),
        carrier_channel=_channel(description, "carrier"),
        frequency_hz=window.frequency_hz,
        amplitude_v=window.amplitude_v,
        phase_deg=window.phase_deg,
        deadline_s=window.start_up_s,
    )


def _channel(description: BenchDescription, node: Node) -> int:
    channel = description.wiring.oscilloscope.channel_of(node)
    if channel is None:
        raise ConfigError(f"wiring.oscilloscope: the start-up check needs a channel that sees {node!r}, none does")
    return channel
