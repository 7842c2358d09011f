"""Recalibration without a table: scale factor, bias and non-linearity of a gyroscope from V_Vc alone, by its K_Vc.

What a rate table once told of the device, the curve of K_Vc with its covariance, turns V_Vc into rates. The output is
chopped at each level, 0, +, -, -, + and 0, the bias taken with the generator off. Neither table nor oscilloscope is
needed: supply, generator, a multimeter, and where there is one a second on V_Vc.
"""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Annotated

from msgspec import Meta, Struct, field, structs

from vcfbench.analysis.chopped import CHOPPED
from vcfbench.bench.bounds import Rate  # noqa: TC001 - msgspec reads it
from vcfbench.bench.misfit import Misfit
from vcfbench.bench.settings import Station
from vcfbench.clock import utc_now
from vcfbench.errors import ConfigError
from vcfbench.files import shown
from vcfbench.interfaces import MeasuresWaveforms, PowersRails, ReadsVoltage, SetsVoltage
from vcfbench.procedures.agreement import MATCH_DRIFT, require_agreement
from vcfbench.procedures.catalogue import BUILT_IN
from vcfbench.procedures.known_v_vc import KnownVvcSettings, measured_levels, ready_meters, take_level
from vcfbench.procedures.procedure import Procedure
from vcfbench.procedures.routines import energised, look_at_drive, set_v_vc, take, v_vc_on
from vcfbench.procedures.self_calibration_results import (
    AT_REST,
    DRIVEN,
    entry_of,
    self_calibration_report,
    self_calibration_results,
)
from vcfbench.procedures.steps import DisableVvc, Note, Outcome, Plan, Settle
from vcfbench.record.devices import Certificate, KvcCurve, Measured, SelfCalibration, read_entry

if TYPE_CHECKING:
    from collections.abc import Iterator
    from datetime import datetime
    from typing import Self

    from vcfbench.procedures.step import Routine
    from vcfbench.record.devices import Entry
    from vcfbench.record.schema import Point

__all__ = ["SELF_CALIBRATION", "KnownDevice", "Reference", "SelfCalibrationSettings", "self_calibration"]


class Reference(Struct, frozen=True, forbid_unknown_fields=True, kw_only=True):
    """What the scale factor is compared with: an earlier entry of the device."""

    name: str
    """Of the entry: ``0003``."""
    kind: str
    done: str
    """When, as ISO 8601 has it."""
    scale_factor_v_per_deg_s: Measured


class KnownDevice(Struct, frozen=True, forbid_unknown_fields=True, kw_only=True):
    """What is known of the device before it is measured."""

    k_vc: KvcCurve
    source: str
    """Where the curve comes from: ``certificate 0001``, a file, a number."""
    certificate: str | None
    """Name of the device's own certificate; None where the curve comes from elsewhere."""
    unseen: tuple[str, ...] = ()
    reference: Reference | None = None


class DeviceStation(Station, frozen=True, kw_only=True):
    """What the place gives, and what is known of the device: the record holds all that the results are made of."""

    known: KnownDevice | None = None


class SelfCalibrationSettings(KnownVvcSettings, frozen=True, kw_only=True):
    """What a self-calibration is told beside what all procedures are."""

    k_vc: Annotated[
        Annotated[str, Meta(min_length=1, max_length=4096)] | None,
        Meta(
            description="a certificate's file, or (deg/s)/V as a number; default the last certificate of --dut",
            extra={"option": True},
        ),
    ] = None
    k_vc_u_deg_s_per_v: Annotated[float, Meta(ge=0.0, le=1e6, description="u of a K_Vc that is a number")] = 0.0
    virtual_rates_deg_s: Annotated[
        tuple[Rate, ...], Meta(min_length=2, max_length=100, description="rates that V_Vc stands for, with both signs")
    ] = (10.0, 20.0, 50.0, 100.0, 200.0)
    max_drift_ppm: Annotated[
        Annotated[float, Meta(ge=0.0, le=1e6)] | None,
        Meta(description="of the scale factor since the last entry, for the verdict; without it E_n decides"),
    ] = None
    outdated: Annotated[bool, Meta(description="whether a certificate may be used that is out of date")] = False
    station: DeviceStation = field(default_factory=DeviceStation)

    @property
    def magnitudes_deg_s(self) -> tuple[float, ...]:
        """The rates without sign, each once, rising."""
        return tuple(sorted({abs(rate) for rate in self.virtual_rates_deg_s}))

    @property
    def known(self) -> KnownDevice:
        """What is known of the device.

        Raises:
            ConfigError: it was not looked up.
        """
        if self.station.known is None:
            raise ConfigError("K_Vc is not known: name the device (--dut) or K_Vc itself (--k-vc)")
        return self.station.known

    def recalled(self) -> Self:
        """Return these settings with what is known of the device.

        Raises:
            ConfigError: no K_Vc is known, its certificate is out of date, or a rate is beyond its curve.
        """
        known = _known(self, utc_now())
        station = DeviceStation(**{**structs.asdict(self.station), "known": known})
        recalled = structs.replace(self, station=station)
        for rate_deg_s in recalled.magnitudes_deg_s:
            for sign in (1.0, -1.0):
                level_for(known.k_vc, sign * rate_deg_s)
        return recalled

    def contradictions(self) -> Iterator[Misfit]:
        """Yield what the ranges cannot say."""
        yield from super().contradictions()
        if self.magnitudes_deg_s[0] == 0.0 or len(self.magnitudes_deg_s) < 2:
            expected = "at least two rates of different size, none of them 0"
            yield Misfit("virtual_rates_deg_s", expected, list(self.virtual_rates_deg_s))


def _known(settings: SelfCalibrationSettings, now: datetime) -> KnownDevice:
    """Look up what is known of the device, `now`."""
    entries = () if settings.dut is None else settings.store.entries(settings.dut)
    reference = _reference(entries)
    if settings.k_vc is not None:
        return _given(settings, settings.k_vc, reference, now)
    if settings.dut is None:
        raise ConfigError(
            "self-calibration needs K_Vc: --dut SERIAL takes that of its certificate, --k-vc FILE or VALUE any",
            hint="vcfbench run kvc --dut SERIAL makes a certificate on a rate table",
        )
    found = settings.store.certificate(settings.dut)
    record = found.record
    assert isinstance(record, Certificate)  # noqa: S101  # the store says so
    _require_valid(record, shown(found.path), settings, now)
    return KnownDevice(
        k_vc=record.k_vc,
        source=f"certificate {found.name}",
        certificate=found.name,
        unseen=record.unseen,
        reference=reference,
    )


def _given(settings: SelfCalibrationSettings, given: str, reference: Reference | None, now: datetime) -> KnownDevice:
    """Return the K_Vc that was given: a number, or the file of a certificate."""
    try:
        number = float(given)
    except ValueError:
        record = read_entry(Path(given))
        if not isinstance(record, Certificate):
            raise ConfigError(f"{shown(given)}: expected a certificate, it is a self-calibration") from None
        _require_valid(record, shown(given), settings, now)
        source = f"certificate of {record.serial}, {shown(given)}"
        return KnownDevice(k_vc=record.k_vc, source=source, certificate=None, unseen=record.unseen, reference=reference)
    if not 0.0 < abs(number) <= 1e6:
        raise ConfigError(f"--k-vc {given}: expected a certificate's file, or (deg/s)/V other than 0, at most 1e6")
    most_v = 1.1 * settings.magnitudes_deg_s[-1] / abs(number)
    variance = settings.k_vc_u_deg_s_per_v**2
    curve = KvcCurve(
        coefficients=(0.0, number), covariance=((0.0, 0.0), (0.0, variance)), v_vc_min_v=-most_v, v_vc_max_v=most_v
    )
    return KnownDevice(k_vc=curve, source=f"K_Vc = {given} (deg/s)/V, as told", certificate=None, reference=reference)


def _require_valid(record: Certificate, where: str, settings: SelfCalibrationSettings, now: datetime) -> None:
    if record.valid_at(now) or settings.outdated:
        return
    until = "" if record.valid_until is None else f" to {record.valid_until:%Y-%m-%d %H:%M}"
    raise ConfigError(
        f"{where}: the certificate is valid from {record.issued:%Y-%m-%d %H:%M}{until}, not now",
        hint="calibrate K_Vc anew (vcfbench run kvc); --set outdated=true takes it all the same",
    )


def _reference(entries: tuple[Entry, ...]) -> Reference | None:
    """Return the last entry that has a scale factor."""
    for entry in reversed(entries):
        record = entry.record
        measured = record.scale_factor_v_per_deg_s
        if measured is None:
            continue
        is_calibration = isinstance(record, SelfCalibration)
        done = record.done if isinstance(record, SelfCalibration) else record.issued
        kind = "self-calibration" if is_calibration else "certificate"
        return Reference(name=entry.name, kind=kind, done=done.isoformat(), scale_factor_v_per_deg_s=measured)
    return None


def level_for(curve: KvcCurve, rate_deg_s: float) -> float:
    """Return the V_Vc that stands for a rate, by bisection; 0 V for none.

    Raises:
        ConfigError: the curve does not go so far.
    """
    low_v, high_v = curve.v_vc_min_v, curve.v_vc_max_v
    if rate_deg_s == 0.0:
        return 0.0
    ends = sorted((curve.rate_deg_s(low_v), curve.rate_deg_s(high_v)))
    tolerance = 1e-3 * (ends[1] - ends[0])
    if not ends[0] - tolerance <= rate_deg_s <= ends[1] + tolerance:
        raise ConfigError(
            f"virtual_rates_deg_s: K_Vc is known from {ends[0]:.5g} to {ends[1]:.5g} deg/s, not at {rate_deg_s:g}"
        )
    rising = curve.rate_deg_s(high_v) > curve.rate_deg_s(low_v)
    for _ in range(60):
        middle_v = 0.5 * (low_v + high_v)
        below = (curve.rate_deg_s(middle_v) < rate_deg_s) == rising
        low_v, high_v = (middle_v, high_v) if below else (low_v, middle_v)
    return 0.5 * (low_v + high_v)


def self_calibration(settings: SelfCalibrationSettings) -> Plan:
    """Calibrate by V_Vc alone."""
    return (yield from energised(settings, _calibrated(settings)))


def _calibrated(settings: SelfCalibrationSettings) -> Routine[Outcome]:
    yield from look_at_drive(settings)
    yield from ready_meters(settings)
    curve, levels_v = settings.known.k_vc, {0.0: 0.0}
    for rate_deg_s in settings.magnitudes_deg_s:
        levels_v |= {signed: level_for(curve, signed) for signed in (rate_deg_s, -rate_deg_s)}
    for cycle in range(settings.cycles):
        for rate_deg_s in settings.magnitudes_deg_s:
            yield Note(f"Cycle {cycle + 1}, {rate_deg_s:g} deg/s: generator off, then V_Vc")
            yield from _at_rest(settings)
            yield from v_vc_on()
            yield Settle(settings.settle_s, "gyro settles after the generator came on")
            yield from _block(settings, rate_deg_s, levels_v)
            yield DisableVvc()
    yield from _at_rest(settings)
    if settings.v_vc_role == "multimeter":
        yield Note("V_Vc by the one multimeter, at every level that was used")
        yield from v_vc_on()
        yield from measured_levels(settings, levels_v.values())
    return Outcome(f"V_Vc at {2 * len(settings.magnitudes_deg_s)} levels, {settings.cycles} times")


def _at_rest(settings: SelfCalibrationSettings) -> Routine[None]:
    yield Settle(settings.settle_s, "gyro settles, generator off")
    yield from take(settings, AT_REST, rate_deg_s=0.0, v_vc_v=0.0)


def _block(settings: SelfCalibrationSettings, rate_deg_s: float, levels_v: dict[float, float]) -> Routine[None]:
    """Take a chopped block; its levels in `levels_v` become those that were read back."""
    points: list[Point] = []
    previous_v = 0.0
    for sign in CHOPPED:
        signed = sign * rate_deg_s
        level_v = levels_v[signed]
        if level_v != previous_v:
            levels_v[signed] = level_v = yield from set_v_vc(settings, level_v)
        points.append((yield from take_level(settings, DRIVEN, rate_deg_s=signed, v_vc_v=level_v, table_deg_s=None)))
        previous_v = level_v
        if len(points) > 1:
            require_agreement(points, settings, MATCH_DRIFT)


SELF_CALIBRATION = Procedure(
    name="self-calibration",
    title=BUILT_IN["self-calibration"][1],
    settings=SelfCalibrationSettings,
    plan=self_calibration,
    results=self_calibration_results,
    report=self_calibration_report,
    entry=entry_of,
    needs={"power": PowersRails, "rate_source": SetsVoltage, "multimeter": ReadsVoltage},
    uses={"oscilloscope": MeasuresWaveforms, "v_vc_meter": ReadsVoltage},
)
"""Self-calibration by V_Vc."""
