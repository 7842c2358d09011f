"""Calibration history of each gyroscope by its serial number: certificates, self-calibrations, noise; only added to.

A directory a device (``devices/G-0042``), a JSON file an entry (``0001.json``), numbered in the order in
which they were made. An entry appears whole or not at all, and no entry replaces another.
"""

import math
import os
import re
import secrets
from collections.abc import Iterable, Sequence
from contextlib import suppress
from datetime import datetime
from itertools import chain
from pathlib import Path
from typing import Annotated, Any, Literal, Self, cast

import msgspec
from msgspec import Meta, Struct, structs

from vcfbench.errors import ConfigError
from vcfbench.files import MOST_SETTINGS, failing_as, read_text, shown, synchronise_names
from vcfbench.typed import typed

FORMAT = 1  # Version of the entries' layout; raised when a reader of the old one would misread the new one

_SERIAL = re.compile(r"[A-Za-z0-9][A-Za-z0-9_-]{0,63}(?:\.[A-Za-z0-9_-]{1,63}){0,7}", re.ASCII)
_RESERVED = re.compile(r"(?:con|prn|aux|nul|com\d|lpt\d)(?:\..*)?", re.IGNORECASE)  # Windows has them itself
_ENTRY = re.compile(r"(\d{4,})\.json", re.ASCII)

Uncertainty = Annotated[float, Meta(ge=0.0)]
Text = Annotated[str, Meta(min_length=1, max_length=1000)]
Freedom = Annotated[float, Meta(gt=0.0)]
Instant = Annotated[datetime, Meta(tz=True)]


class _Value(Struct, frozen=True, forbid_unknown_fields=True, kw_only=True):
    """A part of an entry: frozen, strict."""


class Share(_Value, frozen=True, kw_only=True):
    """Contribution of one source to a standard uncertainty, in the unit of the value."""

    source: Text  # Name of the source, in words
    u: float  # Contribution; the sign is that of its effect, the same in all entries
    of: Text | None = None  # Instrument or certificate that gives other entries the same; it cancels
    dof: Freedom | None = None  # Its degrees of freedom; None is as many as one likes


class Measured(_Value, frozen=True, kw_only=True):
    """A value with its standard uncertainty; the unit is in the name of the field that holds it."""

    value: float
    u: Uncertainty  # Standard uncertainty (k = 1), in the unit of the value
    dof: Freedom | None = None  # Effective degrees of freedom of `u`; None is as many as one likes
    shares: tuple[Share, ...] = ()  # Contributions to `u`, where they are known: their squares add up to its square
    missing: tuple[Text, ...] = ()  # Contributions that `u` lacks, because nobody told them

    def signed(self, sign: float) -> Self:
        """Return this size with the sign of a number."""
        return structs.replace(self, value=math.copysign(self.value, sign))


class CurveShare(_Value, frozen=True, kw_only=True):
    """Contribution of one source to the covariance of a curve."""

    source: Text  # Name of the source, in words
    of: Text | None = None  # Instrument or certificate, as of a :class:`Share`
    dof: Freedom | None = None  # Its degrees of freedom; None is as many as one likes
    covariance: tuple[tuple[float, ...], ...]  # Covariance from this source; all add up to that of the curve


_HIGHEST_V, _LARGEST = 1e3, 1e100
"""Numbers of a curve of which sums of products cannot overflow, and no curve that was measured has larger ones."""


class KvcCurve(_Value, frozen=True, kw_only=True):
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
        """Return the rate that `v_vc_v` stands for; ValueError: it lies outside of what was measured."""
        if not self.v_vc_min_v <= v_vc_v <= self.v_vc_max_v:
            between = f"{self.v_vc_min_v:g} to {self.v_vc_max_v:g} V, where K_Vc is known"
            raise ValueError(f"V_Vc of {v_vc_v:g} V is outside of {between}")
        powers = (v_vc_v**power for power in range(len(self.coefficients)))
        return math.fsum(c * p for c, p in zip(self.coefficients, powers, strict=True))


class Conditions(_Value, frozen=True, kw_only=True):
    """Conditions of a measurement."""

    bench: Text  # Name of the station
    run: Text  # Name of the record
    simulated: bool  # True on a simulated bench
    positive_rail_v: float  # Positive rail of the PCB, V
    negative_rail_v: float  # Negative rail, V
    temperature_c: float | None = None  # Of the device or of the air at it, degC; None where nobody measured it
    instruments: dict[str, str] = {}  # Instruments used: ``*IDN?`` by role


class Characteristics(_Value, frozen=True, kw_only=True):
    """Properties of a device on which K_Vc depends; None where nobody has measured one.

    The names of what `vcfbench.analysis.k_vc_model` knows are those that it has there.
    """

    temperature_c: Measured | None = None  # Temperature at which the rest was measured, degC
    drive_hz: Measured | None = None  # Drive frequency, locked
    split_hz: Measured | None = None  # Drive less anti-phase sense frequency, below 0 where the mode is above the drive
    split_size_hz: Measured | None = None  # Its size, where only that was seen: a beat has no sign
    q_anti_phase: Measured | None = None  # Quality factor of that mode
    in_phase_split_hz: Measured | None = None  # Drive less in-phase sense frequency
    q_in_phase: Measured | None = None  # Quality factor of that mode
    in_phase_share: Measured | None = None  # Part of that mode in the static response to V_Vc, by stiffness, signed
    carrier_phase_deg: Measured | None = None  # Against the drive's velocity, apart from half turns; 0 is ideal
    demodulator_phase_deg: Measured | None = None  # Phase of the demodulator's reference against the same
    comb_mismatch: Measured | None = None  # In-phase over anti-phase force, over that of a rate, less 1; 0: equal combs
    v_vc_feedthrough: Measured | None = None  # Of V_Vc into the sense signal without motion, over the modes' response
    drive_amplitude_v: Measured | None = None  # Amplitude of the drive signal, V
    carrier_amplitude_v: Measured | None = None  # Amplitude of the carrier, V
    modulator_second_per_v: Measured | None = None  # Of the modulator, which acts as V + second V^2 + third V^3; 1/V
    modulator_third_per_v2: Measured | None = None  # Its third order, 1/V^2
    output_second_per_deg_s: Measured | None = None  # Of output against rate, as rate + second rate^2 + ...; 1/(deg/s)
    output_third_per_deg_s2: Measured | None = None  # Its third order, 1/(deg/s)^2
    sense_phase_deg: Measured | None = None  # Of the response to V_Vc, less that by carrier, splits and Q
    positive_rail_v: Measured | None = None  # Positive rail as it was read back, V
    negative_rail_v: Measured | None = None  # Negative rail
    drive_ppm_k: Measured | None = None  # Change of the drive frequency with temperature, ppm of it a kelvin
    split_hz_k: Measured | None = None  # Change of the size of `split_hz`, Hz/K
    q_per_k: Measured | None = None  # Change of both quality factors, relative, 1/K
    table_slope_ppm_k: Measured | None = None  # Change of output over rate with temperature, ppm/K, the table turning
    v_vc_slope_ppm_k: Measured | None = None  # Change of output over V_Vc with temperature
    table_slope_ppm_v: Measured | None = None  # Change of output over rate with the size of both rails, ppm a volt
    v_vc_slope_ppm_v: Measured | None = None  # Change of output over V_Vc with the same
    k_vc_ppm_k: Measured | None = None  # Change of K_Vc itself: that of output over V_Vc less that of output over rate
    k_vc_ppm_v: Measured | None = None  # The same with the size of both rails
    least_temperature_c: float | None = None  # Lowest temperature at which any coefficient was measured, degC
    most_temperature_c: float | None = None  # Highest


class Sensitivity(_Value, frozen=True, kw_only=True):
    """By how much K_Vc changes with one quantity, the others held, ppm for one `unit` of it."""

    quantity: Text  # Name of the quantity; `rails_v` is the level of both rails
    unit: str  # Its unit; empty for a ratio
    ppm_per_unit: float  # Change of K_Vc, ppm, for one unit of it
    u_ppm_per_unit: Uncertainty  # Standard uncertainty of that
    assumed: bool  # True where the value is that of the device's class, because nobody measured the quantity itself


class Certificate(_Value, frozen=True, kw_only=True, tag_field="kind", tag="certificate"):
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
    u95_until: Instant | None = None  # When U95 of K_Vc comes to that; None: it is beyond it, or never will be
    unseen: tuple[Text, ...] = ()  # Changes that a self-calibration by this certificate cannot see, in words
    remarks: tuple[Text, ...] = ()  # Further remarks

    def valid_at(self, instant: datetime) -> bool:
        """Tell whether it is valid at `instant`, which has a time zone."""
        return self.issued <= instant and (self.valid_until is None or instant <= self.valid_until)


class SelfCalibration(_Value, frozen=True, kw_only=True, tag_field="kind", tag="self-calibration"):
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


class StaticNoise(_Value, frozen=True, kw_only=True, tag_field="kind", tag="static-noise"):
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
        """Tell whether it is valid at `instant`, which has a time zone."""
        return self.done <= instant and (self.valid_until is None or instant <= self.valid_until)


class Characterisation(_Value, frozen=True, kw_only=True, tag_field="kind", tag="characterisation"):
    """Properties of a device on which K_Vc depends, as a procedure measured them, for the next certificate."""

    serial: str  # Serial number of the device
    done: Instant  # Time of the measurement
    procedure: Text  # Name of the procedure
    characteristics: Characteristics  # Properties that were measured
    conditions: Conditions  # Conditions of the measurement
    remarks: tuple[Text, ...] = ()  # Further remarks


DeviceRecord = Certificate | SelfCalibration | StaticNoise | Characterisation


class NewEntry(Struct, frozen=True):
    """An entry to be added to a device store."""

    record: DeviceRecord
    store: Path


class Entry(Struct, frozen=True):
    """One entry of a device, and the file that it stands in."""

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


class Device(Struct, frozen=True):
    """Calibration history of one gyroscope: its entries, oldest first."""

    serial: str
    entries: tuple[Entry, ...]

    @property
    def certificate(self) -> Certificate | None:
        """The last certificate, None where there is none."""
        found = last_certificate(self.entries)
        return None if found is None else cast("Certificate", found.record)

    @property
    def failed_since(self) -> Entry | None:
        """The entry by which the drift failed first since the last certificate, None where none did."""
        return next(iter(failed_drifts(self.entries)), None)

    @property
    def self_calibrations(self) -> tuple[SelfCalibration, ...]:
        """The self-calibrations, oldest first."""
        return tuple(each.record for each in self.entries if isinstance(each.record, SelfCalibration))


class DeviceStore(Struct, frozen=True):
    """The devices under one directory, which need not be there before the first entry."""

    root: Path = Path("devices")

    def serials(self) -> tuple[str, ...]:
        """Return the serial numbers of the devices that have entries, in the order of the alphabet."""
        return tuple(sorted(each.name for each in self._directories() if any(_numbered(each))))

    def entries(self, serial: str) -> tuple[Entry, ...]:
        """Return all entries of a device, oldest first; ConfigError: it can have none, or one cannot be read."""
        require_serial(serial)
        found = tuple(Entry(path, read_entry(path)) for _, path in _numbered(self.root / serial))
        for each in (one for one in found if one.record.serial != serial):
            raise ConfigError(f"{shown(each.path)}: it is of device {each.record.serial!r}, and lies with {serial!r}")
        return found

    def device(self, serial: str) -> Device:
        """Return the calibration history of a device; ConfigError: nothing is known of it, or it cannot be read."""
        entries = self.entries(serial)
        if not entries:
            raise ConfigError(
                f"{shown(self.root)}: nothing is known of device {serial!r}",
                hint=f"known devices: {', '.join(self.serials()) or 'none'}",
            )
        return Device(serial, entries)

    def certificate(self, serial: str) -> Entry:
        """Return the last certificate of a device; ConfigError when it has none."""
        found = last_certificate(self.entries(serial))
        if found is None:
            raise ConfigError(
                f"{shown(self.root)}: device {serial!r} has no certificate",
                hint=f"known devices: {', '.join(self.serials()) or 'none'}; vcfbench run kvc --dut {serial} makes one",
            )
        return found

    def static_noise(self, serial: str) -> Entry | None:
        """Return the last static record of a device; None where it has none."""
        return next((each for each in reversed(self.entries(serial)) if isinstance(each.record, StaticNoise)), None)

    def characteristics(self, serial: str) -> Characteristics | None:
        """Return the properties on which K_Vc depends, each by its last characterisation; None where there is none."""
        records = (each.record for each in self.entries(serial))
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
            raise ConfigError(f"{source}: it cannot be written so that it comes back as it is")
        directory = self.root / record.serial
        self._require_own(record.serial)
        with failing_as(ConfigError, f"{shown(directory)}: no entry can be kept there"):
            directory.mkdir(parents=True, exist_ok=True)
            path = _placed(directory, text + b"\n")
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
    """Return each value as it was found last, and the changes of K_Vc that two of them give.

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


def last_certificate(entries: Sequence[Entry]) -> Entry | None:
    """Return the last certificate among the entries of a device, None where there is none."""
    return next((each for each in reversed(entries) if isinstance(each.record, Certificate)), None)


def since_certificate(entries: Sequence[Entry]) -> tuple[Entry, ...]:
    """Return the self-calibrations by the last certificate; without one, those by a K_Vc from elsewhere."""
    certificate, own = last_certificate(entries), [each for each in entries if isinstance(each.record, SelfCalibration)]
    name = None if certificate is None else certificate.name
    return tuple(each for each in own if cast("SelfCalibration", each.record).certificate == name)


def failed_drifts(entries: Sequence[Entry]) -> tuple[Entry, ...]:
    """Return those of them whose drift failed: the device has failed until it has a new certificate."""
    return tuple(each for each in since_certificate(entries) if getattr(each.record, "drift_verdict", None) == "fail")


def load_device(serial: str, devices: Path | str = "devices") -> Device:
    """Return the calibration history of a gyroscope: its certificates, self-calibrations and static records.

    Args:
        serial: its serial number.
        devices: directory in which the devices are kept.

    Raises:
        ConfigError: nothing is known of it, or an entry cannot be read.
    """
    return DeviceStore(Path(devices)).device(serial)


def require_serial(serial: str) -> None:
    """See that `serial` can be the serial number of a device; ConfigError when it cannot."""
    if not _SERIAL.fullmatch(serial) or _RESERVED.fullmatch(serial):
        raise ConfigError(
            f"serial number {serial!a}: expected letters, digits, '-', '_' and '.' within: it names a directory"
        )


def _numbered(directory: Path) -> list[tuple[int, Path]]:
    """Return the files of entries with their numbers, in order."""
    try:
        found = [(match, path) for path in directory.iterdir() if (match := _ENTRY.fullmatch(path.name))]
    except (FileNotFoundError, NotADirectoryError):
        return []
    return sorted((int(match[1]), path) for match, path in found)


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
        made: DeviceRecord = typed(values, DeviceRecord)
    except msgspec.ValidationError as error:
        raise ConfigError(f"{source}: {error}") from error
    return made


def read_entry(path: Path) -> DeviceRecord:
    """Return the entry in a file, wherever it lies; ConfigError when it is none."""
    return _record(read_text(path, "an entry of a device", MOST_SETTINGS), shown(path))


def _placed(directory: Path, data: bytes) -> Path:
    """Write a new file under the next number that is free, whole or not at all; return where."""
    draft = directory / f".draft-{secrets.token_hex(6)}"
    try:
        with draft.open("xb") as file:
            file.write(data)
            file.flush()
            os.fsync(file.fileno())
        while True:
            number = max((taken for taken, _ in _numbered(directory)), default=0) + 1
            path = directory / f"{number:04d}.json"
            with suppress(FileExistsError):  # another program took the number meanwhile
                # Give `draft` its name; FileExistsError if there is one of that name: an entry replaces no other
                if os.name == "nt":
                    draft.rename(path)  # which refuses there what it would replace elsewhere
                else:
                    path.hardlink_to(draft)
                for each in (directory, directory.parent, directory.parent.parent):  # they may be new
                    synchronise_names(each)
                return path
    finally:
        with suppress(OSError):
            draft.unlink(missing_ok=True)
