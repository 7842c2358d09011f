"""Tables of the bench file that settings of procedures hold too: wiring, limits, expected values, acceptance."""

from collections.abc import Iterator, Sequence
from typing import Annotated, Literal

from msgspec import UNSET, Meta, Struct, UnsetType

from vcfbench.drivers.streams.description import Stream
from vcfbench.errors import LimitError
from vcfbench.station import bounds
from vcfbench.station.invalid_value import MOST_V, InvalidValue, turned_windows

Node = Literal["output", "v_vc", "drive", "carrier", "sense", "rail_positive", "rail_negative"]
SupplyOutput = Literal["P6V", "P25V", "N25V"]
Window = tuple[float, float]
LimitKey = Literal[
    "max_rate_deg_s",
    "max_acceleration_deg_s2",
    "max_v_vc_v",
    "min_rail_v",
    "max_rail_v",
    "max_rail_current_a",
    "min_temperature_c",
    "max_temperature_c",
    "max_ramp_k_min",
]


class BenchFileTable(Struct, frozen=True, forbid_unknown_fields=True, kw_only=True):
    """A table of the bench file: frozen, strict."""


class CalibrationPoint(BenchFileTable, frozen=True, kw_only=True):
    """A line of a voltmeter's certificate: range, level, the correction to be added to a reading, and its U.

    `expanded_v` is `k` times the standard uncertainty.
    """

    range_v: Annotated[float, Meta(ge=1e-3, le=1e4)]
    level_v: Annotated[float, Meta(ge=-1e4, le=1e4)]
    correction_v: Annotated[float, Meta(ge=-1.0, le=1.0)] = 0.0
    expanded_v: Annotated[float, Meta(ge=0.0, le=1.0)]
    k: Annotated[float, Meta(ge=1.0, le=15.0)] = 2.0


class RailWiring(BenchFileTable, frozen=True, kw_only=True):
    """Supply output of each rail of the PCB; one with a single supply has no negative rail, "none"."""

    positive: SupplyOutput = "P25V"
    negative: SupplyOutput | Literal["none"] = "N25V"

    @property
    def single(self) -> bool:
        """True of a PCB with one supply, whose other side is ground."""
        return self.negative == "none"


class RailSettings(Struct, frozen=True):
    """One rail of the PCB: its name, the supply output that feeds it, level (V) and current limit (A)."""

    rail: str
    output: str
    voltage_v: float
    current_limit_a: float


def absent_rail_keys(*, supplied: bool, single: bool) -> tuple[str, ...]:
    """Return the settings of rails that are not there: all without a supply, the negative one's of a single rail."""
    if not supplied:
        return "positive_rail_v", "negative_rail_v", "rail_current_limit_a", "rail_tolerance_v"
    return ("negative_rail_v",) if single else ()


class OscilloscopeWiring(BenchFileTable, frozen=True, kw_only=True):
    """Node of the PCB at each oscilloscope channel."""

    channel_1: Node | None = "drive"
    channel_2: Node | None = "carrier"
    channel_3: Node | None = "sense"
    channel_4: Node | None = "output"

    def channels(self) -> dict[int, Node]:
        """Return the wired channels: number to node."""
        nodes = (self.channel_1, self.channel_2, self.channel_3, self.channel_4)
        return {number: node for number, node in enumerate(nodes, start=1) if node is not None}

    def channel_of(self, node: Node) -> int | None:
        """Return the lowest channel that sees `node`, None when none does."""
        return next((number for number, seen in self.channels().items() if seen == node), None)


class Limits(BenchFileTable, frozen=True, kw_only=True):
    """Limits of the station; checked before anything is sent.

    Those of an instrument that the bench has are there; those of one that it has not may be None.
    """

    max_rate_deg_s: bounds.RateLimit | None = None
    max_acceleration_deg_s2: bounds.Acceleration | None = None
    max_v_vc_v: bounds.VVcLimit | None = None
    min_rail_v: bounds.LeastRail | None = None
    max_rail_v: bounds.PositiveRail | None = None
    max_rail_current_a: bounds.Current | None = None
    min_temperature_c: bounds.Temperature | None = None
    max_temperature_c: bounds.Temperature | None = None
    max_ramp_k_min: bounds.TemperatureRamp | None = None

    @property
    def slow_deg_s(self) -> float:
        """Rate that every gyroscope of this bench follows, deg/s: a table may go beyond the range of one."""
        return 10.0 if self.max_rate_deg_s is None else min(10.0, 0.5 * self.max_rate_deg_s)

    def of(self, key: LimitKey) -> float:
        """Return the limit called `key`; LimitError without one."""
        limit: float | None = getattr(self, key)
        if limit is None:
            raise LimitError(f"the bench has no limit for this, so it is refused (limits.{key})")
        return limit


class DeclaredGyro(BenchFileTable, frozen=True, kw_only=True):
    """Declaration of this gyroscope by its maker or user: input range, null, stream, whether it is ratiometric."""

    range_deg_s: bounds.RateLimit | None = None
    """Input range either way: the scale factor of that range is stated beside that of the rates of a run."""

    stream: Stream | UnsetType = UNSET
    """Its output, where that is no voltage; where it is one, records say nothing of it."""

    ratiometric: bool | UnsetType = UNSET
    """Whether its output goes with the supply, which is refused."""

    null_v: bounds.Output | UnsetType = UNSET
    """Its output at no rate by the data sheet, from which a bias counts as a rate."""

    def null_on(self, rails: Sequence[RailSettings]) -> float:
        """Return that output: as declared, else half way up a single rail, else 0."""
        if self.null_v is not UNSET:
            return self.null_v
        return 0.5 * rails[0].voltage_v if len(rails) == 1 else 0.0


class Expected(BenchFileTable, frozen=True, kw_only=True):
    """Expected values of this gyroscope: a run with others is ended. Each window ``[low, high]``."""

    scale_factor_v_per_deg_s: bounds.OutputSlopeWindow | None = None
    bias_v: bounds.OutputWindow | None = None
    k_vc_deg_s_per_v: bounds.SlopeWindow | None = None
    reading_noise_v: bounds.NoiseWindow | None = None
    zero_drift_v: bounds.OutputDrift | None = None
    nonlinearity_ppm: bounds.LargestPpm | None = None


class AcceptanceLimits(BenchFileTable, frozen=True, kw_only=True):
    """Limits of the results, each ``[low, high]``: a run whose results are outside has failed, with exit code 1.

    With the guard band ``"U95"`` a result that is nearer to a limit than its expanded uncertainty is marginal.
    """

    guard_band: Literal["none", "U95"] = "none"
    scale_factor_v_per_deg_s: bounds.OutputSlopeWindow | None = None
    bias_v: bounds.OutputWindow | None = None
    bias_deg_s: bounds.RateWindow | None = None
    nonlinearity_ppm: bounds.PpmWindow | None = None
    reading_noise_v: bounds.NoiseWindow | None = None
    k_vc_deg_s_per_v: bounds.SlopeWindow | None = None
    scale_factor_error_percent: bounds.PercentWindow | None = None
    bias_repeatability_deg_s: bounds.RateWindow | None = None
    scale_factor_repeatability_ppm: bounds.PpmWindow | None = None
    drift_ppm: bounds.DriftWindow | None = None
    e_n: bounds.EnWindow | None = None


class DriveWindow(Struct, frozen=True, forbid_unknown_fields=True, kw_only=True):
    """Limits of the drive signal on the oscilloscope before anything is measured; each ``[low, high]``."""

    frequency_hz: Annotated[bounds.FrequencyWindow, bounds.said("frequency of the drive signal")] = (3475.0, 3503.0)
    amplitude_v: Annotated[bounds.AmplitudeWindow, bounds.said("amplitude of the drive signal")] = (0.05, 10.0)
    phase_deg: Annotated[bounds.PhaseWindow, bounds.said("phase of the carrier against the drive")] = (-180.0, 180.0)
    start_up_s: Annotated[bounds.StartUp, bounds.said("time given to the drive loop after power-on")] = 5.0

    @property
    def foreseen(self) -> tuple[float, float, float]:
        """Frequency (Hz), amplitude (V) and phase (deg) with which a dry run answers; a run measures them."""
        return middle(self.frequency_hz), middle(self.amplitude_v), middle(self.phase_deg)

    def contradictions(self) -> Iterator[InvalidValue]:
        """Yield the windows that no drive is in, or no oscilloscope tells: they are in another unit."""
        yield from turned_windows(self, "drive")
        for key, wrong, expected in (
            ("frequency_hz", self.frequency_hz[0] < 100.0, "from 100 Hz on, in Hz and not kHz"),
            ("amplitude_v", self.amplitude_v[1] > MOST_V, f"up to {MOST_V:g} V, the largest supply, in V and not mV"),
            ("phase_deg", self.phase_deg[1] - self.phase_deg[0] < 2.0, "of 2 degrees and more, in degrees and not rad"),
        ):
            if wrong:
                yield InvalidValue(f"drive.{key}", f"a window {expected}", list(getattr(self, key)))


def middle(window: Window) -> float:
    """Return the middle of a window."""
    return 0.5 * (window[0] + window[1])
