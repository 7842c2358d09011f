"""The scale factor that turns the output at rest into a rate: told, read from a record, or expected."""

from collections.abc import Iterator
from enum import Enum
from pathlib import Path
from typing import Annotated, Any

import msgspec
from msgspec import Struct

from vcfbench.errors import ConfigError
from vcfbench.files import MOST_TABLE, read_file, shown
from vcfbench.procedures.shared.kept import KeptSettings
from vcfbench.station.bounds import ranged, said, several
from vcfbench.station.invalid_value import InvalidValue
from vcfbench.station.linear_gyro import LinearGyro
from vcfbench.station.settings import DeviceSettings
from vcfbench.steps.measured import Measured
from vcfbench.steps.step import Context, Plan, Step, StepResult


class ScaleFactorBy(Enum):
    """Method for taking the scale factor."""

    V_VC = "v-vc"
    TABLE = "table"


class AtRestSettings(DeviceSettings, frozen=True, kw_only=True):
    """Settings that turn the output at rest into a rate."""

    scale_factor_v_per_deg_s: Annotated[
        Annotated[float, ranged(-1e3, 1e3)] | None,
        said("of this gyroscope; default that of a record, else what is expected, else the paper's"),
    ] = None
    scale_factor_u_v_per_deg_s: Annotated[
        Annotated[float, ranged(0.0, 1e3)] | None,
        said("its standard uncertainty; without it a bias in deg/s is incomplete"),
    ] = None
    scale_factor_from: Annotated[
        str, several(1, 4096, "record (a directory) of a calibration that tells it, or none")
    ] = "none"

    def contradictions(self) -> Iterator[InvalidValue]:
        yield from super().contradictions()
        if self.scale_factor_v_per_deg_s == 0.0:
            expected = "a scale factor other than 0 V/(deg/s); without the key it counts as not told"
            yield InvalidValue("scale_factor_v_per_deg_s", expected, self.scale_factor_v_per_deg_s)


class LevelSettings(KeptSettings, AtRestSettings, frozen=True, kw_only=True):
    """Settings of procedures that take the scale factor at a level of both signs, and keep what they find."""

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
        most_deg_s = self.station.limits.max_rate_deg_s
        if self.by is ScaleFactorBy.TABLE and most_deg_s is None:
            yield InvalidValue("by", "v-vc: the bench has no rate table", self.by.value)
        elif self.by is ScaleFactorBy.TABLE and most_deg_s is not None and self.level_deg_s > most_deg_s:
            yield InvalidValue("level_deg_s", f"at most {most_deg_s:g} deg/s (limits)", self.level_deg_s)


class ScaleFactor(Struct, frozen=True):
    """Scale factor of volts to rates, V/(deg/s); `u` None where nobody tells it; `source` names its source."""

    value: float
    u: float | None
    source: str


class ScaleFactorRead(StepResult, ScaleFactor, frozen=True):
    """The scale factor of a record."""

    def describe(self) -> str:
        return f"{self.value:.6g} V/(deg/s), {self.source}"


class ReadScaleFactor(Step, Struct, frozen=True):
    """Take the scale factor from the record of a calibration, once, so that this run's record holds it too."""

    record: str

    def describe(self) -> str:
        return f"the scale factor is that of {self.record}"

    def perform(self, context: Context) -> ScaleFactorRead:
        """Read the record's ``result.json``; ConfigError where it has no scale factor."""
        return scale_factor_of(Path(self.record))

    def predict(self, gyro: LinearGyro) -> ScaleFactorRead:
        """Read it as well: a dry run finds out that there is none."""
        return scale_factor_of(Path(self.record))


def scale_factor_of(record: Path) -> ScaleFactorRead:
    """Return the scale factor that stands in the record of a calibration, that on the table first.

    ConfigError: there is no such record, or no scale factor in it.
    """
    path = record / "result.json" if record.is_dir() else record
    text = read_file(path, "the result of a calibration", MOST_TABLE)
    try:
        results: Any = msgspec.json.decode(text, type=dict[str, Any]).get("results") or {}
        column = results.get("turntable", results)["scale_factor"]
        return ScaleFactorRead(float(column["value"]), float(column["u"] or column["u_fit"]), f"record {record.name}")
    except (msgspec.DecodeError, RecursionError, AttributeError, KeyError, TypeError, ValueError) as error:
        raise ConfigError(f"{shown(path)}: expected a calibration's scale factor, found none: {error!r}") from None


def scale_factor_read(settings: AtRestSettings, work: Plan) -> Plan:
    """Read the scale factor where a record tells it, then do `work`."""
    if settings.scale_factor_v_per_deg_s is None and settings.scale_factor_from != "none":
        yield ReadScaleFactor(settings.scale_factor_from)
    return (yield from work)


def scale_factor_used(settings: AtRestSettings, measured: Measured) -> ScaleFactor:
    """Return the scale factor that turns volts into rates, with its source."""
    if settings.scale_factor_v_per_deg_s is not None:
        return ScaleFactor(settings.scale_factor_v_per_deg_s, settings.scale_factor_u_v_per_deg_s, "settings")
    for _, read in measured.found(ScaleFactorRead):
        return ScaleFactor(read.value, read.u, read.source)
    expected = settings.expected.scale_factor_v_per_deg_s is not None
    source = (
        "middle of what the bench file expects" if expected else "that of the paper: nothing tells this gyroscope's"
    )
    return ScaleFactor(settings.expected_gyro().scale_factor, None, source)
