"""The scale factor that turns the output at rest into a rate: given, or expected."""

from collections.abc import Iterator
from enum import Enum
from typing import Annotated

from msgspec import Struct

from vcfbench.instructions.kept import KeptSettings
from vcfbench.station.bounds import ranged, said
from vcfbench.station.invalid_value import InvalidValue
from vcfbench.station.linear_gyro import LinearGyro
from vcfbench.station.settings import DeviceSettings, Station


class ScaleFactorBy(Enum):
    """Method for taking the scale factor."""

    V_VC = "v-vc"
    TABLE = "table"


class AtRestSettings(DeviceSettings, frozen=True, kw_only=True):
    """Settings that turn the output at rest into a rate."""

    scale_factor_v_per_deg_s: Annotated[
        Annotated[float, ranged(-1e9, 1e9)] | None,
        said("of this gyroscope; default what is expected, else the paper's"),
    ] = None
    scale_factor_u_v_per_deg_s: Annotated[
        Annotated[float, ranged(0.0, 1e9)] | None,
        said("its standard uncertainty; without it a bias in deg/s is incomplete"),
    ] = None

    def expected_gyro(self) -> LinearGyro:
        gyro = super().expected_gyro()
        if self.scale_factor_v_per_deg_s is not None:
            gyro.scale_factor = self.scale_factor_v_per_deg_s
        return gyro

    def contradictions(self) -> Iterator[InvalidValue]:
        yield from super().contradictions()
        if self.scale_factor_v_per_deg_s == 0.0:
            expected = "a scale factor other than 0 V/(deg/s); without the key it counts as not told"
            yield InvalidValue("scale_factor_v_per_deg_s", expected, self.scale_factor_v_per_deg_s)


def not_on_bench(by: ScaleFactorBy, station: Station) -> Iterator[InvalidValue]:
    """Yield the setting `by` if the bench has no instrument for it."""
    if by is ScaleFactorBy.TABLE and station.limits.max_rate_deg_s is None:
        yield InvalidValue("by", "v-vc: the bench has no rate table", by.value)
    if by is ScaleFactorBy.V_VC and station.instruments and "rate_source" not in station.instruments:
        yield InvalidValue("by", "table: the bench has no generator on V_Vc", by.value)


class LevelSettings(KeptSettings, AtRestSettings, frozen=True, kw_only=True):
    """Settings of procedures that take the scale factor at a level of both signs, and keep the result."""

    by: Annotated[ScaleFactorBy, said("what the scale factor is taken with: V_Vc or the table", option=True)] = (
        ScaleFactorBy.V_VC
    )
    level_deg_s: Annotated[float, ranged(1.0, 10_000.0, "rate of both signs, of the table or that V_Vc stands for")] = (
        200.0
    )

    @property
    def level_v(self) -> float:
        """The V_Vc that stands for the rate, V."""
        return self.level_deg_s / self.k_vc_guess_deg_s_per_v

    def contradictions(self) -> Iterator[InvalidValue]:
        yield from super().contradictions()
        yield from not_on_bench(self.by, self.station)
        if self.by is ScaleFactorBy.TABLE:
            yield from self.beyond_table("level_deg_s", self.level_deg_s)


class ScaleFactor(Struct, frozen=True):
    """Scale factor of volts to rates, V/(deg/s); `u` is None if not given; `source` names its source."""

    value: float
    u: float | None
    source: str


def tells_scale_factor(settings: AtRestSettings) -> bool:
    """Return True if settings or bench file have the scale factor of this gyroscope."""
    return settings.scale_factor_v_per_deg_s is not None or settings.expected.scale_factor_v_per_deg_s is not None


def scale_factor_used(settings: AtRestSettings) -> ScaleFactor:
    """Return the scale factor that turns volts into rates, with its source."""
    if settings.scale_factor_v_per_deg_s is not None:
        return ScaleFactor(settings.scale_factor_v_per_deg_s, settings.scale_factor_u_v_per_deg_s, "settings")
    expected = settings.expected.scale_factor_v_per_deg_s is not None
    usual = "nominal" if settings.station.stream else "that of the paper"
    source = "middle of what the bench file expects" if expected else f"{usual}: nothing tells this gyroscope's"
    return ScaleFactor(settings.expected_gyro().scale_factor, None, source)
