"""Calibration history of each gyroscope by its serial number: certificates, self-calibrations, noise; only added to.

A directory a device (``devices/G-0042``), a JSON file an entry (``0001.json``), numbered in the order in
which they were added. An entry appears whole or not at all, and no entry replaces another.
"""

import math
import os
import re
from collections.abc import Iterable, Sequence
from datetime import datetime
from itertools import chain
from pathlib import Path
from typing import Annotated, Any, Literal, cast

import msgspec
from msgspec import Meta, Struct, structs

from vcfbench.clock import utc_now
from vcfbench.errors import ConfigError
from vcfbench.files import MOST_SETTINGS, failing_as, read_text, shown
from vcfbench.records.device_values import (
    Characteristics,
    Conditions,
    Freedom,
    Frozen,
    Measured,
    Sensitivity,
    Text,
    Uncertainty,
)
from vcfbench.records.numbered import numbered, placed, seal_of
from vcfbench.typed import typed

FORMAT = 1  # Version of the entries' layout; raised when a reader of the old one would misread the new one

_SERIAL = re.compile(r"[A-Za-z0-9][A-Za-z0-9_-]{0,63}(?:\.[A-Za-z0-9_-]{1,63}){0,7}", re.ASCII)
_RESERVED = re.compile(r"(?:con|prn|aux|nul|com\d|lpt\d)(?:\..*)?", re.IGNORECASE)  # Windows has them itself

Instant = Annotated[datetime, Meta(tz=True)]


class CurveShare(Frozen, frozen=True, kw_only=True):
    """Contribution of one source to the covariance of a curve."""

    source: Text  # Name of the source, in words
    of: Text | None = None  # Instrument or certificate, as of a :class:`Share`
    dof: Freedom | None = None  # Its degrees of freedom; None is as many as one likes
    covariance: tuple[tuple[float, ...], ...]  # Covariance from this source; all add up to that of the curve


_HIGHEST_V, _LARGEST = 1e3, 1e100
"""Numbers of a curve of which sums of products cannot overflow, and no curve that was measured has larger ones."""


class KvcCurve(Frozen, frozen=True, kw_only=True):
    """The rate that a V_Vc stands for: the sum of ``coefficients[i] * V_Vc**i``, deg/s for V_Vc in V."""

    coefficients: Annotated[tuple[float, ...], Meta(min_length=2, max_length=8)]  # k0 deg/s, k1 deg/s/V, ...
    covariance: tuple[tuple[float, ...], ...]  # Of the coefficients, row by row, in the products of their units
    v_vc_min_v: float  # Lowest V_Vc at which it was measured; the curve says nothing below
    v_vc_max_v: float  # Highest V_Vc at which it was measured
    shares: tuple[CurveShare, ...] = ()  # Contributions to the covariance, where they are known
    lack_of_fit_deg_s: float | None = None  # Root mean square of what uncertainties do not explain; in no uncertainty
    missing: tuple[Text, ...] = ()  # Contributions that the covariance lacks, because nobody told them

    def __post_init__(self) -> None:
        """See that the parts fit together; ValueError when they do not."""
        size, rows = len(self.coefficients), self.covariance
        if len(rows) != size or any(len(row) != size for row in rows):
            raise ValueError(f"expected a covariance of {size} rows of {size} numbers")
        for i in range(size):
            # two elements that should be one may differ by the rounding error of their variances: of 0, that is all
            if rows[i][i] < 0.0 or any(
                abs(rows[i][j] - rows[j][i]) > (1e-6 * math.sqrt(abs(rows[i][i] * rows[j][j]))) for j in range(i)
            ):
                raise ValueError("expected a covariance that is symmetric, with variances of at least 0")
        if not -_HIGHEST_V <= self.v_vc_min_v < self.v_vc_max_v <= _HIGHEST_V:
            raise ValueError(f"expected v_vc_min_v below v_vc_max_v, both within {_HIGHEST_V:g} V")
        if any(abs(each) > _LARGEST for each in chain(self.coefficients, *rows)):
            raise ValueError(f"expected coefficients and a covariance up to {_LARGEST:g}")

    def rate_deg_s(self, v_vc_v: float) -> float:
        """Return the rate that `v_vc_v` stands for; ValueError outside the measured range."""
        if not self.v_vc_min_v <= v_vc_v <= self.v_vc_max_v:
            between = f"{self.v_vc_min_v:g} to {self.v_vc_max_v:g} V, where K_Vc is known"
            raise ValueError(f"V_Vc of {v_vc_v:g} V is outside of {between}")
        powers = (v_vc_v**power for power in range(len(self.coefficients)))
        return math.fsum(c * p for c, p in zip(self.coefficients, powers, strict=True))


class Certificate(Frozen, frozen=True, kw_only=True, tag_field="kind", tag="certificate"):
    """Certificate from a calibration on a rate table, by which a device can calibrate itself from then on."""

    serial: str  # Serial number of the device
    issued: Instant  # Time of the measurement
    valid_until: Instant | None = None  # After that it is out of date; None is no end
    procedure: Text  # Name of the procedure
    k_vc: KvcCurve  # The rate against V_Vc
    conditions: Conditions  # Conditions of the measurement
    scale_factor_v_per_deg_s: Measured | None = None  # Scale factor on the table on that day, to compare with
    bias_v: Measured | None = None  # Output at rest on that day, V
    characteristics: Characteristics | None = None  # Properties on that day, to compare with; None: not measured
    sensitivities: tuple[Sensitivity, ...] = ()  # Sensitivities of K_Vc to each quantity
    k_vc_drift_ppm_per_year: Uncertainty | None = None  # Most of K_Vc in a year, ppm, by what no table has seen
    wanted_u95_ppm: Uncertainty | None = None  # U95 of K_Vc that was wanted of it, ppm
    u95_until: Instant | None = None  # When U95 of K_Vc comes to that, `issued` if it is more already; None: never
    unseen: tuple[Text, ...] = ()  # Changes that a self-calibration by this certificate cannot see, in words
    remarks: tuple[Text, ...] = ()  # Further remarks

    @property
    def beyond_u95(self) -> bool:
        """Return True if U95 of K_Vc was more than was wanted of it on the day of the measurement."""
        u95_ppm = 1.96e6 * math.sqrt(self.k_vc.covariance[1][1]) / max(abs(self.k_vc.coefficients[1]), 1e-300)
        return u95_ppm >= (self.wanted_u95_ppm or math.inf) if self.u95_until is None else self.u95_until <= self.issued

    def valid_at(self, instant: datetime) -> bool:
        """Return True if it is valid at `instant`, which has a time zone."""
        return self.issued <= instant and (self.valid_until is None or instant <= self.valid_until)


class SelfCalibration(Frozen, frozen=True, kw_only=True, tag_field="kind", tag="self-calibration"):
    """Result of a calibration without a table: one entry of the device's history."""

    serial: str  # Serial number of the device
    done: Instant  # Time of the measurement
    procedure: Text  # Name of the procedure
    certificate: Text | None  # Entry whose K_Vc it used; None: from elsewhere, as `remarks` tells
    scale_factor_v_per_deg_s: Measured  # Scale factor
    bias_v: Measured  # Output at rest, V
    nonlinearity_ppm: Measured | None = None  # Largest residual over the span of the outputs, ppm
    conditions: Conditions  # Conditions of the measurement
    drift_ppm: Measured | None = None  # Change of the scale factor since the certificate, ppm of it
    e_n: float | None = None  # Normalised error of that change
    since_last_ppm: Measured | None = None  # Since the one before by the same certificate; None: it is the first
    cusum: float | None = None  # Creep: the certificate's entries summed up, in standard uncertainties
    drift_verdict: Literal["pass", "marginal", "fail"] | None = None  # After ``fail`` it has failed until certified
    verdict: Literal["pass", "marginal", "fail"] | None = None  # Verdict of all acceptance limits
    characteristics: Characteristics | None = None  # Properties of the device, as far as they were measured
    remarks: tuple[Text, ...] = ()  # Further remarks


class StaticNoise(Frozen, frozen=True, kw_only=True, tag_field="kind", tag="static-noise"):
    """Noise of a device from a static record, for the budgets of later runs."""

    serial: str  # Serial number of the device
    done: Instant  # Time of the measurement
    valid_until: Instant | None = None  # After that it is out of date; None is no end
    procedure: Text  # Name of the procedure
    bias_instability_deg_h: Measured  # Coefficient B of the flicker
    duration_s: Annotated[float, Meta(gt=0.0)]  # Length of the record
    conditions: Conditions  # Conditions of the measurement
    remarks: tuple[Text, ...] = ()  # Further remarks

    def valid_at(self, instant: datetime) -> bool:
        """Return True if it is valid at `instant`, which has a time zone."""
        return self.done <= instant and (self.valid_until is None or instant <= self.valid_until)


class Characterisation(Frozen, frozen=True, kw_only=True, tag_field="kind", tag="characterisation"):
    """Properties of a device on which K_Vc depends, as a procedure measured them, for the next certificate."""

    serial: str  # Serial number of the device
    done: Instant  # Time of the measurement
    procedure: Text  # Name of the procedure
    characteristics: Characteristics  # Properties that were measured
    conditions: Conditions  # Conditions of the measurement
    remarks: tuple[Text, ...] = ()  # Further remarks


class Withdrawal(Frozen, frozen=True, kw_only=True, tag_field="kind", tag="withdrawal"):
    """Entry that withdraws an earlier one, which stays and no longer counts."""

    serial: str  # Serial number of the device
    done: Instant  # Time of the withdrawal
    withdraws: Text  # Name of the entry that counts no more; that of a withdrawal: what it took back counts again
    reason: Text  # Why
    by: Text  # Who
    last: Text  # Name of the last entry before it
    seal: Text  # Of all entries up to that, in their order: none of them can be changed or removed unseen


DeviceRecord = Certificate | SelfCalibration | StaticNoise | Characterisation | Withdrawal


class NewEntry(Struct, frozen=True):
    """An entry to be added to a device store."""

    record: DeviceRecord
    store: Path


class Entry(Struct, frozen=True):
    """One entry of a device, and its file."""

    path: Path
    record: DeviceRecord

    @property
    def name(self) -> str:
        """Its name, by which other entries refer to it: ``0001``."""
        return self.path.stem

    @property
    def done(self) -> datetime:
        """Time of the measurement."""
        return self.record.issued if isinstance(self.record, Certificate) else self.record.done

    @property
    def run(self) -> str | None:
        """Name of the record that it is from; None: from none."""
        return None if isinstance(self.record, Withdrawal) else self.record.conditions.run

    @property
    def simulated(self) -> bool:
        """Return True if it is from a simulated bench."""
        return not isinstance(self.record, Withdrawal) and self.record.conditions.simulated


class Device(Struct, frozen=True):
    """Calibration history of one gyroscope: all its entries, oldest first by their days.

    What it says of the device, it says by those that stand: none that was withdrawn, none from a simulated bench where
    there is one from a real bench.

    >>> device = vcfbench.load_device("G-0042")
    >>> len(device.entries), f"{device.certificate.issued:%Y-%m-%d}"
    (1, '2026-11-22')
    """

    serial: str
    entries: tuple[Entry, ...]

    @property
    def standing(self) -> tuple[Entry, ...]:
        """The entries that count."""
        return standing(self.entries)

    @property
    def certificate(self) -> Certificate | None:
        """The last certificate, or None."""
        found = last_certificate(self.standing)
        return None if found is None else cast("Certificate", found.record)

    @property
    def failed_since(self) -> Entry | None:
        """The entry by which the drift failed first since the last certificate, None where none did."""
        return next(iter(failed_drifts(self.standing)), None)

    @property
    def self_calibrations(self) -> tuple[SelfCalibration, ...]:
        """The self-calibrations, oldest first."""
        return tuple(each.record for each in self.standing if isinstance(each.record, SelfCalibration))


class DeviceStore(Struct, frozen=True):
    """The devices under one directory, which need not be there before the first entry.

    `simulated` tells from which benches entries count, simulated or real ones; None: from real ones, where a device
    has any.
    """

    root: Path = Path("devices")
    simulated: bool | None = None

    def serials(self) -> tuple[str, ...]:
        """Return the serial numbers of the devices with entries, in alphabetical order."""
        return tuple(sorted(each.name for each in self._directories() if any(numbered(each))))

    def entries(self, serial: str) -> tuple[Entry, ...]:
        """Return all entries of a device, oldest first by their days.

        ConfigError: it can have none, one cannot be read, or one from before a withdrawal was changed or removed.
        """
        require_serial(serial)
        paths = [path for _, path in numbered(self.root / serial)]
        found = tuple(Entry(path, read_entry(path)) for path in paths)
        for each in (one for one in found if one.record.serial != serial):
            raise ConfigError(f"{shown(each.path)}: expected device {serial!r}, got {each.record.serial!r}")
        for path, record in ((each.path, each.record) for each in found if isinstance(each.record, Withdrawal)):
            if record.seal != seal_of([each for each in paths if int(each.stem) <= int(record.last)]):
                raise ConfigError(
                    f"{shown(path)}: an entry up to {record.last} was changed or removed since this was written"
                )
        return tuple(sorted(found, key=lambda each: each.done))

    def standing(self, serial: str) -> tuple[Entry, ...]:
        """Return the entries of a device that count, oldest first by their days; errors as above."""
        return standing(self.entries(serial), simulated=self.simulated)

    def left_out(self, serial: str) -> str:
        """Say which entries of a device do not count because they are from benches of the other kind; empty: none."""
        entries = self.entries(serial)
        others = [each.name for each in standing(entries, simulated=not self.simulated)]
        if self.simulated is None or not others:
            return ""
        kind = "real" if self.simulated else "simulated"
        return f"device {serial}: left out, from a {kind} bench: {', '.join(others)}"

    def withdraw(self, serial: str, name: str, *, reason: str, by: str) -> Entry:
        """Add an entry that withdraws an earlier one; withdrawing a withdrawal restores its entry.

        Raises:
            ConfigError: there is no such entry, it is withdrawn already, reason or name are empty, or it cannot be
                written.
        """
        entries = self.entries(serial)
        found = next((each for each in entries if each.name == name), None)
        if found is None:
            known = ", ".join(each.name for each in entries) or "none"
            wrong = f"device {serial}: expected the name of an entry ({known}), got {name!r}"
            raise ConfigError(wrong, hint="a run leaves its history by vcfbench runs amend RUN --set dut= --reason ...")
        if name in withdrawn(entries):
            raise ConfigError(f"{shown(found.path)}: it is withdrawn already")
        if not reason.strip() or not by.strip():
            raise ConfigError("withdraw: expected a reason and the name of the person, got an empty text")
        paths = [path for _, path in numbered(self.root / serial)]
        said = {"withdraws": name, "reason": reason, "by": by, "last": paths[-1].stem, "seal": seal_of(paths)}
        return self.add(Withdrawal(serial=serial, done=utc_now(), **said))

    def device(self, serial: str) -> Device:
        """Return the calibration history of a device; ConfigError without entries, or if they cannot be read."""
        entries = self.entries(serial)
        if not entries:
            raise ConfigError(
                f"{shown(self.root)}: there is no entry of device {serial!r}",
                hint=f"known devices: {', '.join(self.serials()) or 'none'}",
            )
        return Device(serial, entries)

    def certificate(self, serial: str) -> Entry:
        """Return the last certificate of a device; ConfigError when it has none."""
        found = last_certificate(self.standing(serial))
        if found is None:
            raise ConfigError(
                "; ".join(
                    filter(None, [f"{shown(self.root)}: device {serial!r} has no certificate", self.left_out(serial)])
                ),
                hint=f"known devices: {', '.join(self.serials()) or 'none'}; vcfbench run kvc --dut {serial} makes one",
            )
        return found

    def static_noise(self, serial: str) -> Entry | None:
        """Return the last static record of a device; None where it has none."""
        return next((each for each in reversed(self.standing(serial)) if isinstance(each.record, StaticNoise)), None)

    def characteristics(self, serial: str) -> Characteristics | None:
        """Return the properties on which K_Vc depends, each from its last characterisation, or None."""
        records = (each.record for each in self.standing(serial))
        seen = [each.characteristics for each in records if isinstance(each, Characterisation)]
        return together(seen) if seen else None

    def require_room(self, serial: str) -> None:
        """See, before a run of hours, that an entry of a device could be added; ConfigError if not."""
        require_serial(serial)
        self._require_own(serial)
        place = self.root / serial
        while not place.exists() and place != place.parent:
            place = place.parent
        if not place.is_dir() or not os.access(place, os.W_OK | os.X_OK):
            raise ConfigError(f"{shown(self.root)}: no entry can be kept there: {shown(place)} takes no files")

    def add(self, record: DeviceRecord) -> Entry:
        """Add an entry after all others of its device; it is on the disk, whole, when this returns.

        Raises:
            ConfigError: a number in it is none, its serial number cannot be one, or it cannot be written.
        """
        require_serial(record.serial)
        text = msgspec.json.format(msgspec.json.encode({"format": FORMAT, **msgspec.to_builtins(record)}), indent=2)
        source = f"the {type(record).__struct_config__.tag} of {record.serial}".replace("static-noise", "static noise")
        if _record(text.decode() + "\n", source) != record:  # as with a NaN
            raise ConfigError(f"{source}: the entry changes when it is written and read again")
        directory = self.root / record.serial
        self._require_own(record.serial)
        with failing_as(ConfigError, f"{shown(directory)}: no entry can be kept there"):
            directory.mkdir(parents=True, exist_ok=True)
            path = placed(directory, text + b"\n")
        return Entry(path, record)

    def _require_own(self, serial: str) -> None:
        """See that no other device has a name that some file systems take for the same."""
        others = (each.name for each in self._directories() if each.name != serial)
        if same := next((each for each in others if each.lower() == serial.lower()), None):
            raise ConfigError(f"{shown(self.root)}: there is a device {same!r}; {serial!r} differs in case alone")

    def _directories(self) -> list[Path]:
        try:
            return [each for each in self.root.iterdir() if each.is_dir()]
        except FileNotFoundError:
            return []
        except OSError as error:
            raise ConfigError(f"{shown(self.root)}: expected a directory of devices: {error.strerror}") from error


def together(found: Iterable[Characteristics]) -> Characteristics:
    """Return the last value of each characteristic, and the changes of K_Vc from pairs of them.

    Where the frequency was found last at a temperature that nobody told, that of all is not known.
    """
    last: dict[str, Any] = {}
    for each in found:
        values = {name: value for name, value in structs.asdict(each).items() if value is not None}
        if "drive_hz" in values:
            last.pop("temperature_c", None)
        if "split_hz" in values:
            last.pop("split_size_hz", None)
        elif "split_size_hz" in values and "split_hz" in last:  # of which the sign is known
            values["split_hz"] = values.pop("split_size_hz").signed(last["split_hz"].value)
        last |= values
    for unit in ("ppm_k", "ppm_v"):
        table, v_vc = last.get(f"table_slope_{unit}"), last.get(f"v_vc_slope_{unit}")
        if table is not None and v_vc is not None:
            last[f"k_vc_{unit}"] = Measured(value=v_vc.value - table.value, u=math.hypot(v_vc.u, table.u))
    return Characteristics(**last)


def withdrawn(entries: Sequence[Entry]) -> dict[str, Withdrawal]:
    """Return the withdrawn entries, each with the entry that withdrew it."""
    found: dict[str, Withdrawal] = {}
    for each in sorted(entries, key=lambda each: each.name, reverse=True):  # a withdrawal may be withdrawn later on
        if isinstance(each.record, Withdrawal) and each.name not in found:
            found[each.record.withdraws] = each.record
    return found


def standing(entries: Sequence[Entry], *, simulated: bool | None = None) -> tuple[Entry, ...]:
    """Return the entries of a device that count: of one kind of bench, by default the real one."""
    gone = withdrawn(entries)
    kept = [each for each in entries if each.name not in gone and not isinstance(each.record, Withdrawal)]
    kind = all(each.simulated for each in kept) if simulated is None else simulated
    return tuple(each for each in kept if each.simulated is kind)


def last_certificate(entries: Sequence[Entry]) -> Entry | None:
    """Return the last valid certificate among the entries of a device, or None."""
    return next((each for each in reversed(entries) if isinstance(each.record, Certificate)), None)


def since_certificate(entries: Sequence[Entry]) -> tuple[Entry, ...]:
    """Return the self-calibrations by the last certificate; without one, those by a given K_Vc."""
    certificate, own = last_certificate(entries), [each for each in entries if isinstance(each.record, SelfCalibration)]
    name = None if certificate is None else certificate.name
    return tuple(each for each in own if cast("SelfCalibration", each.record).certificate == name)


def failed_drifts(entries: Sequence[Entry]) -> tuple[Entry, ...]:
    """Return the entries with a failed drift, except one that the next self-calibration did not confirm."""
    own = since_certificate(entries)
    failed = [getattr(each.record, "drift_verdict", None) == "fail" for each in own]
    near = zip([False, *failed], [*failed[1:], True], strict=False)  # the last waits for its second look
    return tuple(each for each, fails, others in zip(own, failed, near, strict=False) if fails and any(others))


def load_device(serial: str, devices: Path | str = "devices") -> Device:
    """Return the calibration history of a gyroscope: its certificates, self-calibrations and static records.

    `devices` is the directory in which they are kept. ConfigError: nothing is known of it, or an entry cannot be read.

    >>> vcfbench.load_device("G-0042").certificate.procedure
    'kvc'
    """
    return DeviceStore(Path(devices)).device(serial)


def require_serial(serial: str) -> None:
    """See that `serial` can be the serial number of a device; ConfigError when it cannot."""
    if not _SERIAL.fullmatch(serial) or _RESERVED.fullmatch(serial):
        raise ConfigError(
            f"serial number {serial!a}: expected letters A to Z, digits, '-', '_' and '.' within: it names a directory"
        )


def _record(text: str, source: str) -> DeviceRecord:
    try:
        values: Any = msgspec.json.decode(text)
    except (msgspec.DecodeError, RecursionError) as error:
        raise ConfigError(f"{source}: expected JSON: {error}") from error
    if not isinstance(values, dict) or type(values.get("format")) is not int:
        raise ConfigError(f"{source}: expected an entry of a device, with a key format")
    if values.pop("format") != FORMAT:
        raise ConfigError(f"{source}: expected format {FORMAT}; it was written by another version of vcfbench")
    try:
        return typed(values, DeviceRecord)  # type: ignore[no-any-return]  # it is a union
    except msgspec.ValidationError as error:
        raise ConfigError(f"{source}: {error}") from error


def require_not_withdrawn(path: Path, record: DeviceRecord) -> None:
    """See that the entry in a file was not withdrawn, where it lies with its device; ConfigError: it was."""
    directory = path.resolve().parent
    if directory.name == record.serial:
        gone = withdrawn(DeviceStore(directory.parent).entries(record.serial)).get(path.stem)
        if gone is not None:
            raise ConfigError(f"{shown(path)}: it was withdrawn by {gone.by}, {gone.done:%Y-%m-%d}: {gone.reason}")


def read_entry(path: Path) -> DeviceRecord:
    """Return the entry in a file, wherever it lies; ConfigError when it is none."""
    return _record(read_text(path, "an entry of a device", MOST_SETTINGS), shown(path))
