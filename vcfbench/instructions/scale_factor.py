"""The scale factor that turns the output at rest into a rate: given, or expected."""

import itertools
from collections.abc import Iterator
from enum import Enum
from pathlib import Path
from typing import Annotated, Self, cast

from msgspec import Struct, structs

from vcfbench.errors import ConfigError, MeasurementError
from vcfbench.instructions.kept import KeptSettings
from vcfbench.records import devices
from vcfbench.station.bounds import ranged, said
from vcfbench.station.invalid_value import MOST_V, InvalidValue, beyond_output
from vcfbench.station.linear_gyro import LinearGyro
from vcfbench.station.settings import DeviceSettings, ProcedureSettings, Station

_MOST_OFF = 0.1
"""Part by which the output may answer otherwise than the scale factor used: warm-up, curvature, an axis askew."""
_LEAST_SLOPE = 1e-5
"""V/(deg/s): 10 deg/s are ten last digits of the meter's range."""
ROUGHLY = 10.0
"""Factor by which K_Vc may differ from the guess of the bench file, either way."""


class ScaleFactorBy(Enum):
    """Method for taking the scale factor."""

    V_VC = "v-vc"
    TABLE = "table"


class AtRestSettings(DeviceSettings, frozen=True, kw_only=True):
    """Settings that turn the output at rest into a rate."""

    scale_factor_v_per_deg_s: Annotated[
        Annotated[float, ranged(-1e9, 1e9)] | None,
        said("scale factor of this gyroscope; default: the expected one, else the paper's"),
    ] = None
    scale_factor_u_v_per_deg_s: Annotated[
        Annotated[float, ranged(0.0, 1e9)] | None,
        said("standard uncertainty of the scale factor; without it a bias in deg/s is incomplete"),
    ] = None

    def recalled(self) -> Self:
        """Return these settings with the K_Vc of the device's certificate, where the bench file expects none.

        ConfigError: the scale factor is not about that of the certificate.
        """
        settings, given = super().recalled(), self.scale_factor_v_per_deg_s
        entry = None
        if self.dut is not None:
            entry = devices.last_certificate(
                devices.DeviceStore(Path(self.devices), self.station.simulated).standing(self.dut)
            )
        if entry is None:
            return settings
        record, expected = cast("devices.Certificate", entry.record), self.station.expected
        known = record.scale_factor_v_per_deg_s
        may = [] if known is None else far((known.value, known.value))
        if given is not None and may and not min(may) <= given <= max(may):
            raise ConfigError(
                f"scale_factor_v_per_deg_s = {given:g}: expected {min(may):.4g} to {max(may):.4g} V/(deg/s), about "
                f"that of certificate {entry.name}",
                hint="correct it, or leave it out; vcfbench run turntable measures it",
            )
        if expected.k_vc_deg_s_per_v is not None:
            return settings
        low, high = sorted(factor * record.k_vc.coefficients[1] for factor in (0.999, 1.001))
        expected = structs.replace(expected, k_vc_deg_s_per_v=(low, high))
        return structs.replace(settings, station=structs.replace(settings.station, expected=expected))

    @property
    def looks_on_table(self) -> bool:
        """True where nobody gives the scale factor, and the look whether the output answers tells it, on the table."""
        return False

    @property
    def early_look(self) -> tuple[str, ...]:
        return ("rate_table", "rate_source") if tells_scale_factor(self) else ()

    def require_known_answer(self, slope: float, within: float, *, by_v_vc: bool) -> None:
        require_as_used(self, slope, within, by_v_vc=by_v_vc)

    def expected_gyro(self) -> LinearGyro:
        gyro = super().expected_gyro()
        if self.scale_factor_v_per_deg_s is not None:
            gyro.scale_factor = self.scale_factor_v_per_deg_s
        return gyro

    def contradictions(self) -> Iterator[InvalidValue]:
        yield from super().contradictions()
        stream, slow_deg_s, given = self.station.stream, self.station.limits.slow_deg_s, self.scale_factor_v_per_deg_s
        most = stream.largest if stream else max(map(abs, self.rails_v or (MOST_V,)))
        yield from beyond_output(self, "", most, slow_deg_s)
        if given and not stream and abs(given) < _LEAST_SLOPE:
            expected = f"at least {_LEAST_SLOPE:g} either way, for a slow rate to be seen: volts by deg/s, not by deg/h"
            yield InvalidValue("scale_factor_v_per_deg_s", expected, given)
        window = self.expected.scale_factor_v_per_deg_s
        if given and window and not min(far(window)) <= given <= max(far(window)):
            expected = f"within 10 % of {window[0]:g} to {window[1]:g} V/(deg/s) (expected.scale_factor_v_per_deg_s)"
            yield InvalidValue("scale_factor_v_per_deg_s", expected, given)
        if given == 0.0:
            expected = "a scale factor other than 0 V/(deg/s); without the key it counts as not given"
            yield InvalidValue("scale_factor_v_per_deg_s", expected, given)


def not_on_bench(by: ScaleFactorBy, station: Station) -> Iterator[InvalidValue]:
    """Yield the setting `by` if the bench has no instrument for it."""
    if by is ScaleFactorBy.TABLE and station.limits.max_rate_deg_s is None:
        yield InvalidValue("by", "v-vc: the bench has no rate table", by.value)
    if by is ScaleFactorBy.V_VC and station.instruments and "rate_source" not in station.instruments:
        yield InvalidValue("by", "table: the bench has no generator on V_Vc", by.value)


class LevelSettings(KeptSettings, AtRestSettings, frozen=True, kw_only=True):
    """Settings of procedures that take the scale factor at a level of both signs, and keep the result."""

    by: Annotated[ScaleFactorBy, said("source of the rates: V_Vc or the table", option=True)] = ScaleFactorBy.V_VC
    level_deg_s: Annotated[float, ranged(1.0, 10_000.0, "rate of both signs, by the table or by V_Vc")] = 200.0

    @property
    def level_v(self) -> float:
        """The V_Vc that stands for the rate, V."""
        return self.level_deg_s / self.k_vc_guess_deg_s_per_v

    def contradictions(self) -> Iterator[InvalidValue]:
        yield from super().contradictions()
        yield from not_on_bench(self.by, self.station)
        if self.by is ScaleFactorBy.TABLE:
            yield from self.beyond_table("level_deg_s", self.level_deg_s)


class LookedAtSettings(AtRestSettings, frozen=True, kw_only=True):
    """Settings of procedures whose rates are by their own look on the table, where nobody gives the scale factor."""

    @property
    def looks_on_table(self) -> bool:
        return self.scale_factor_v_per_deg_s is None and self.station.limits.max_rate_deg_s is not None


LOOKED = "by this run's look at a slow rate of the table"


class ScaleFactor(Struct, frozen=True):
    """Scale factor of volts to rates, V/(deg/s); `u` is None if not given; `source` names its source."""

    value: float
    u: float | None
    source: str


def _given(settings: ProcedureSettings) -> tuple[float | None, float | None]:
    if not isinstance(settings, AtRestSettings):
        return None, None
    return settings.scale_factor_v_per_deg_s, settings.scale_factor_u_v_per_deg_s


def tells_scale_factor(settings: ProcedureSettings) -> bool:
    """Return True if settings or bench file have the scale factor of this gyroscope."""
    return _given(settings)[0] is not None or settings.expected.scale_factor_v_per_deg_s is not None


def scale_factor_used(settings: ProcedureSettings) -> ScaleFactor:
    """Return the scale factor that turns volts into rates, with its source."""
    given, u = _given(settings)
    if given is not None:
        return ScaleFactor(given, u, "settings")
    expected = settings.expected.scale_factor_v_per_deg_s is not None
    usual = "nominal value" if settings.station.stream else "value of the paper"
    source = "middle of the expected range" if expected else f"{usual}, not measured on this gyroscope"
    return ScaleFactor(settings.expected_gyro().scale_factor, None, source)


def far(ends: tuple[float, float], part: float = 0.0) -> list[float]:
    """Return the ends of what was told with a tenth more either way, or the `part` that it may be off."""
    return [each * (1.0 + sign * max(_MOST_OFF, part)) for each in ends for sign in (-1.0, 1.0)]


def require_as_used(settings: ProcedureSettings, found: float, within: float = 0.0, *, by_v_vc: bool) -> None:
    """See that the output answers as the scale factor that is used has it; MeasurementError: it does not."""
    if words := unlike_used(settings, found, within, by_v_vc=by_v_vc):
        raise MeasurementError(
            words,
            instrument="multimeter",
            hint="correct scale_factor_v_per_deg_s of the run, or [expected] of the bench file (V, deg/s, its sign); "
            "if they are right, look at the leads: vcfbench run polarity",
        )


def unlike_used(settings: ProcedureSettings, found: float, within: float = 0.0, *, by_v_vc: bool) -> str:
    """Return how the output answers otherwise than the scale factor that is used has it; empty if it does not.

    `found` is its slope, V/(deg/s), known to `within`; of V_Vc by `k_vc_guess_deg_s_per_v`, which is a rough one.
    """
    used, expected, k_vc = scale_factor_used(settings), settings.expected, settings.k_vc_guess_deg_s_per_v
    factors, said = [1.0], f"{used.value:+.4g} V/(deg/s) ({used.source})"
    scale = used.value, used.value
    if _given(settings)[0] is None and expected.scale_factor_v_per_deg_s is not None:
        scale = expected.scale_factor_v_per_deg_s
    if by_v_vc:
        of_guess = [each / k_vc for each in expected.k_vc_deg_s_per_v or ()]
        factors = of_guess or [1.0 / ROUGHLY, ROUGHLY]
        said += f" and a K_Vc of {'what is expected' if of_guess else f'some {k_vc:g} (deg/s)/V'}"
    part = 2.0 * (used.u or 0.0) / abs(used.value)
    may = [each * factor for each, factor in itertools.product(far(scale, part), factors)]
    if min(may) - within <= found <= max(may) + within:
        return ""
    moves = f"{found * k_vc:+.4g} V a volt of V_Vc" if by_v_vc else f"{found:+.4g} V/(deg/s)"
    return f"the output changes by {moves}, which cannot be {said}"


def seen_from(settings: ProcedureSettings, *, by_v_vc: bool) -> float:
    """Return the share from which a scale factor that is not as told is refused, by V_Vc with what K_Vc may be."""
    used, window = scale_factor_used(settings), settings.expected.k_vc_deg_s_per_v
    part = max(_MOST_OFF, 2.0 * (used.u or 0.0) / abs(used.value))
    spread = ROUGHLY if window is None else max(map(abs, window)) / min(map(abs, window))
    return (1.0 + part) * (spread if by_v_vc else 1.0) - 1.0


def rates_by(value: float, source: str) -> str:
    """Return a report's words for the scale factor that turns volts into rates."""
    return f"rates by the scale factor {value:.6g} V/(deg/s) ({source})"
