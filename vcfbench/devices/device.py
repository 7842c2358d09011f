"""Prior knowledge of a device: its K_Vc from a certificate, a file or a number, and its history."""

from collections.abc import Sequence
from datetime import datetime
from pathlib import Path
from typing import Annotated, ClassVar, Self, cast

from msgspec import Meta, Struct, field, structs

from vcfbench.clock import utc_now
from vcfbench.devices.k_vc_change import require_characterised
from vcfbench.errors import ConfigError, MeasurementError
from vcfbench.files import shown
from vcfbench.instructions.kept import require_valid, with_flicker
from vcfbench.instructions.scale_factor import ROUGHLY, far
from vcfbench.instructions.v_vc import KnownVvcSettings
from vcfbench.records import device_values, devices
from vcfbench.station.bounds import ranged, said
from vcfbench.station.gaps import Gap
from vcfbench.station.settings import Limit, ProcedureSettings, Station
from vcfbench.strict import refusal, words

UNSEEN = (
    "the feedback combs (K_FBY) and their mismatch: their change of K_Vc appears as a change of the gyroscope",
    "the ratio of carrier to drive amplitude (V_dac over A_x); a common change of both has no effect",
    "the phase of the carrier against the drive",
    "the modulator: its gain, its reference, its curvature",
    "masses and their shares in the modes",
)
"""Causes that a self-calibration by K_Vc cannot see: all quantities within K_Vc itself (equation 16 of the paper)."""

E_N_ACTION, CUSUM_ACTION = 2.25, 10.0
"""E_n, and cumulative sum with k = 0.5 (NIST/SEMATECH e-Handbook 6.3.2.3), beyond which a drift fails.

Together, of the change since the certificate, since the last entry and of the creep, they fail a device that has not
changed in 1 of 100 years of mornings, 365 looks, and in 1 of 1000 again at the second look (computed, 2500 years each
with certificates 0.3, 1 and 2 times as uncertain as a morning). With 1.5 and 5 it were 9 of 10.
"""

_AS_STATED = "the modulator's curve and the validity of K_Vc, which only a certificate has"
_NO_U = "the u of K_Vc, if k_vc_u_deg_s_per_v is not given: values by it are incomplete"


class Reference(Struct, frozen=True, forbid_unknown_fields=True, kw_only=True):
    """Reference of the scale factor: an earlier entry of the device."""

    name: str
    """Name of the entry: ``0003``."""
    kind: str
    done: str
    """Date, as ISO 8601 has it."""
    scale_factor_v_per_deg_s: device_values.Measured
    temperature_c: float | None = None
    rails_v: tuple[float, float] | None = None


class KnownDevice(Struct, frozen=True, forbid_unknown_fields=True, kw_only=True):
    """Prior knowledge of the device."""

    k_vc: devices.KvcCurve
    source: str
    """Source of the curve: ``certificate 0001``, a file, a number."""
    certificate: str | None
    """Name of the device's own certificate; None where the curve comes from elsewhere."""
    issued: str | None = None
    """Date of the certificate's measurement, as ISO 8601 has it; None where there is none."""
    days_since: float | None = None
    """Age of the certificate as the run began, whole days."""
    characteristics: device_values.Characteristics | None = None
    """Characteristics of the device then, as far as the certificate has them."""
    unseen: tuple[str, ...] = UNSEEN
    holds_not: tuple[str, ...] = ()
    """Sources that are in no uncertainty because K_Vc comes from there."""
    reference: Reference | None = None
    """Reference from the certificate; from its first self-calibration where it has no scale factor itself."""
    history: tuple[Reference, ...] = ()
    """The self-calibrations by that certificate, oldest first."""
    failed_before: tuple[str, ...] = ()
    """Those of them whose drift failed."""


class DeviceStation(Station, frozen=True, kw_only=True):
    """Station with the known device: the record holds all inputs of the results."""

    known: KnownDevice | None = None


class KnownDeviceSettings(KnownVvcSettings, frozen=True, kw_only=True):
    """Settings of procedures that use the K_Vc of a device: of its certificate, of a file, or a number."""

    k_vc: Annotated[
        Annotated[str, Meta(min_length=1, max_length=4096)] | None,
        said("a certificate's file, or (deg/s)/V as a number; default the last certificate of --dut", option=True),
    ] = None
    k_vc_u_deg_s_per_v: Annotated[float, ranged(0.0, 1e6, "standard uncertainty of K_Vc if that is a number")] = 0.0
    station: DeviceStation = field(default_factory=DeviceStation)

    max_drift_ppm: Annotated[
        Annotated[float, ranged(0.0, 1e6)] | None,
        said(
            "largest drift of the scale factor since the certificate, for the verdict; without it E_n and CUSUM decide"
        ),
    ] = None

    rates_key: ClassVar[str] = "virtual_rates_deg_s"
    """Name of the key with the requested virtual rates."""

    @property
    def acceptance(self) -> tuple[Limit, ...]:
        """The limits of the bench file, and those of the drift where something earlier is known of the device."""
        stated = super().acceptance
        known = self.station.known
        if known is None or known.reference is None:
            return stated
        keys, never_again = {limit.key for limit in stated}, Limit("failed_before", 0.0, 0.0)
        if (most := self.max_drift_ppm) is not None:  # how much there may be: by it alone a drift is judged then
            return (*stated, Limit("drift_ppm", -most, most, guarded=True), never_again)
        if "drift_ppm" in keys:
            return (*stated, never_again)
        since_last = [Limit("e_n_since_last", 0.0, E_N_ACTION)] if known.history else []
        seen = [] if "e_n" in keys else [Limit("e_n", 0.0, E_N_ACTION)]
        return (*stated, *seen, *since_last, Limit("cusum", 0.0, CUSUM_ACTION), never_again)

    @property
    def magnitudes_deg_s(self) -> tuple[float, ...]:
        """The virtual rates that are asked for, without sign, each once, rising."""
        raise NotImplementedError

    def own_gaps(self) -> list[Gap]:
        """Return the unknown quantities that do not concern a table."""
        return [gap for gap in self.station.sources.gaps() if gap.name not in {"table rate", "misalignment"}]

    @property
    def missing_without_table(self) -> tuple[str, ...]:
        """Missing contributions of a scale factor by V_Vc: those of the device's K_Vc, and those here."""
        here = (gap.name for gap in self.own_gaps() if {"scale_factor", "k_vc"} & {*gap.kinds})
        return tuple(dict.fromkeys([*self.known.k_vc.missing, *here]))

    @property
    def known(self) -> KnownDevice:
        """Known device; ConfigError: it was not looked up."""
        if self.station.known is None:
            raise ConfigError("K_Vc is not known: name the device (--dut) or K_Vc itself (--k-vc)")
        return self.station.known

    @property
    def known_scale_factor(self) -> float | None:
        """Scale factor of the certificate, else the middle of what the bench file expects, V/(deg/s); None: neither."""
        reference, expected = self.known.reference, self.expected.scale_factor_v_per_deg_s
        if reference is not None:
            return reference.scale_factor_v_per_deg_s.value
        return None if expected is None else 0.5 * (expected[0] + expected[1])

    @property
    def early_look(self) -> tuple[str, ...]:
        """V_Vc by its K_Vc, where the scale factor is known."""
        return () if self.known_scale_factor is None else ("rate_source",)

    def require_known_answer(self, slope: float, within: float, *, by_v_vc: bool) -> None:  # noqa: ARG002  # no table turns
        """See that the output answers to V_Vc as scale factor and K_Vc have it, as :meth:`require_known` does."""
        per = self.k_vc_guess_deg_s_per_v / self.known.k_vc.coefficients[1]
        self.require_known(per * slope, abs(per) * within)

    def require_known(self, found: float, within: float = 0.0) -> None:
        """See that a scale factor has the sign that is known, and is within 10 % of what the bench file expects.

        How far it is from an earlier one is a result by the device's certificate. By a K_Vc that was told it is within
        10 % as well. MeasurementError: it is another one.
        """
        known, reference = self.known_scale_factor, self.known.reference
        if known is not None and found * known < 0.0:
            raise MeasurementError(
                f"the sign of the scale factor is wrong: expected {known:.4g} V/(deg/s)",
                instrument="multimeter",
                hint="check the leads of the meters and of V_Vc, and the sign of --k-vc (vcfbench run polarity)",
            )
        expected, whose = self.expected.scale_factor_v_per_deg_s, "expected.scale_factor_v_per_deg_s"
        if expected is None and self.known.issued is None and reference is not None:
            expected = (reference.scale_factor_v_per_deg_s.value,) * 2
            whose = f"{reference.kind} {reference.name} of the device"
        if expected is not None and not min(far(expected)) - within <= found <= max(far(expected)) + within:
            raise MeasurementError(
                f"the scale factor is {found:.4g} V/(deg/s), expected {expected[0]:g} to {expected[1]:g} V/(deg/s) "
                f"({whose}): by {self.known.source}",
                instrument="multimeter",
                hint="one of the two is wrong: K_Vc (--k-vc, the certificate), or what is expected; or the leads are",
            )

    def recalled(self) -> Self:
        """Return these settings with the known device.

        ConfigError: no K_Vc is known, its certificate is out of date, or the V_Vc of a rate is beyond the curve, the
        bench's limit or the range of the meter on V_Vc.
        """
        now, entries = utc_now(), () if self.dut is None else self.store.standing(self.dut)
        if self.k_vc is not None:
            known = _given(self, self.k_vc, entries, now)
        elif self.dut is not None:
            found = self.store.certificate(self.dut)
            record = cast("devices.Certificate", found.record)
            require_valid(record, shown(found.path), now, outdated=self.outdated)
            known = _of_certificate(record, found.name, entries, now)
        else:
            raise ConfigError(
                "K_Vc is not known: --dut SERIAL uses the certificate of the device, --k-vc a FILE or VALUE",
                hint="vcfbench run kvc --dut SERIAL makes a certificate on a rate table",
            )
        require_characterised(known.characteristics, self.temperature_c)
        station = structs.asdict(with_flicker(self, outdated=self.outdated).station)
        recalled = structs.replace(self, station=DeviceStation(**{**station, "known": known}))
        most_v = self.station.limits.max_v_vc_v
        for rate_deg_s in (sign * rate for rate in recalled.magnitudes_deg_s for sign in (1.0, -1.0)):
            level_v = level_for(known.k_vc, rate_deg_s, self.rates_key)
            if most_v is not None and abs(level_v) > most_v:
                raise ConfigError(
                    f"{self.rates_key}: {rate_deg_s:g} deg/s needs {abs(level_v):.4g} V of V_Vc, the bench allows "
                    f"{most_v:g} V (limits.max_v_vc_v)"
                )
            for wrong in recalled.beyond_range(level_v, rate_deg_s):
                raise refusal(wrong.path, wrong.expected, words(wrong.came))
        return recalled


def _of_certificate(
    record: devices.Certificate, name: str, entries: tuple[devices.Entry, ...], now: datetime, *, own: bool = True
) -> KnownDevice:
    """Return the known device by a certificate, its own or another's."""
    at_c, seen = record.conditions.temperature_c, record.characteristics or device_values.Characteristics()
    if seen.temperature_c is None and at_c is not None:
        seen = structs.replace(seen, temperature_c=device_values.Measured(value=at_c, u=0.0))
    known = KnownDevice(
        k_vc=record.k_vc,
        source=f"certificate {name}",
        certificate=name if own else None,
        unseen=record.unseen,
        issued=record.issued.isoformat(),
        days_since=max(0.0, float((now - record.issued).days)),
        characteristics=seen,
    )
    return _with_history(known, entries)


def _given(settings: KnownDeviceSettings, given: str, entries: tuple[devices.Entry, ...], now: datetime) -> KnownDevice:
    """Return the K_Vc that was given: a number, or the file of a certificate."""
    try:
        number = float(given)
    except ValueError:
        record = devices.read_entry(Path(given))
        if not isinstance(record, devices.Certificate):
            raise ConfigError(f"{shown(given)}: expected a certificate, got another entry of a device") from None
        devices.require_not_withdrawn(Path(given), record)
        if settings.station.simulated not in {None, record.conditions.simulated}:
            benches = ("a real bench", "a simulated bench")
            of, here = benches[record.conditions.simulated], benches[not record.conditions.simulated]
            raise ConfigError(f"{shown(given)}: the certificate is from {of}, this is {here}") from None
        require_valid(record, shown(given), now, outdated=settings.outdated)
        if (own := devices.last_certificate(entries)) is not None and own.record == record:
            return _of_certificate(record, own.name, entries, now)
        name = f"of {record.serial}, {shown(given)}"
        known = _of_certificate(record, name, entries, now, own=False)
        since = _reference(name, record)
        return known if since is None else structs.replace(known, reference=since, history=())
    if not 0.0 < abs(number) <= 1e6:
        raise ConfigError(f"--k-vc {given}: expected a certificate's file, or (deg/s)/V other than 0, at most 1e6")
    require_like_known(settings, number, f"--k-vc {given}", entries)
    most_v = 1.1 * settings.magnitudes_deg_s[-1] / abs(number)
    variance = settings.k_vc_u_deg_s_per_v**2
    missing = () if variance else ("K_Vc",)
    curve = devices.KvcCurve(
        missing=missing,
        coefficients=(0.0, number),
        covariance=((0.0, 0.0), (0.0, variance)),
        v_vc_min_v=-most_v,
        v_vc_max_v=most_v,
    )
    source, holds_not = f"K_Vc = {given} (deg/s)/V, as given", (_AS_STATED, *([] if variance else [_NO_U]))
    return _with_history(KnownDevice(k_vc=curve, source=source, certificate=None, holds_not=holds_not), entries)


def require_like_known(settings: ProcedureSettings, k_vc: float, named: str, entries: Sequence[devices.Entry]) -> None:
    """See that a K_Vc that was told is about that of the device's certificate, or of the bench file.

    ConfigError: it is more than 10 % off, or by more than a factor of ten where only the guess is known.
    """
    own, window = devices.last_certificate(entries), settings.expected.k_vc_deg_s_per_v
    usual = settings.expected_gyro().k_vc
    if own is not None:
        usual = cast("devices.Certificate", own.record).k_vc.coefficients[1]
        may, where = far((usual, usual)), f"certificate {own.name}"
    elif window is not None:
        may, where = far(window), "expected.k_vc_deg_s_per_v"
    else:
        may, where = [usual / ROUGHLY, usual * ROUGHLY], "k_vc_guess_deg_s_per_v"
    if not min(may) <= k_vc <= max(may):
        raise ConfigError(
            f"{named}: expected {min(may):.4g} to {max(may):.4g} (deg/s)/V, about {usual:g} ({where})",
            hint="vcfbench run kvc measures it, vcfbench run polarity its sign",
        )


def _with_history(known: KnownDevice, entries: tuple[devices.Entry, ...]) -> KnownDevice:
    """Return `known` with the references of the scale factor: the last certificate, and the later entries."""
    certificate, failed = devices.last_certificate(entries), devices.failed_drifts(entries)
    own = devices.since_certificate(entries)
    names = {each.name for each in failed}
    # A failure at the last look alone waits for a second one, which is made without it; so is one that was not found
    # again no entry to compare with
    waits = own[-1:] if failed[-1:] == own[-1:] and not {each.name for each in own[-2:-1]} & names else ()
    sure = [each for each in failed if each not in waits]
    good = [each for each in own if getattr(each.record, "drift_verdict", None) != "fail" or each in sure]
    compared = [*([] if certificate is None else [certificate]), *good]
    references = [found for each in compared if (found := _reference(each.name, each.record)) is not None]
    return structs.replace(
        known,
        reference=references[0] if references else None,
        history=tuple(references[1:]),
        failed_before=tuple(each.name for each in sure),
    )


def _reference(name: str, record: devices.DeviceRecord) -> Reference | None:
    """Return the scale factor of an entry."""
    match record:
        case devices.SelfCalibration(scale_factor_v_per_deg_s=found):
            kind, done = "self-calibration", record.done
        case devices.Certificate(scale_factor_v_per_deg_s=device_values.Measured() as found):
            kind, done = "certificate", record.issued
        case _:
            return None
    under = record.conditions
    return Reference(
        name=name,
        kind=kind,
        done=done.isoformat(),
        scale_factor_v_per_deg_s=found,
        temperature_c=under.temperature_c,
        rails_v=under.rails_v,
    )


def level_for(curve: devices.KvcCurve, rate_deg_s: float, key: str) -> float:
    """Return the V_Vc that stands for a rate, by bisection; 0 V for none. `key` names the rate in errors.

    ConfigError: the curve does not go so far.
    """
    low_v, high_v = curve.v_vc_min_v, curve.v_vc_max_v
    if rate_deg_s == 0.0:
        return 0.0
    ends = sorted((curve.rate_deg_s(low_v), curve.rate_deg_s(high_v)))
    tolerance = 1e-3 * (ends[1] - ends[0])
    if not ends[0] - tolerance <= rate_deg_s <= ends[1] + tolerance:
        raise ConfigError(f"{key}: K_Vc is known from {ends[0]:.5g} to {ends[1]:.5g} deg/s, not at {rate_deg_s:g}")
    rising = curve.rate_deg_s(high_v) > curve.rate_deg_s(low_v)
    for _ in range(60):
        middle_v = 0.5 * (low_v + high_v)
        below = (curve.rate_deg_s(middle_v) < rate_deg_s) == rising
        low_v, high_v = (middle_v, high_v) if below else (low_v, middle_v)
    return 0.5 * (low_v + high_v)
