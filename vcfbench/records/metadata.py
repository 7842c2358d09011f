"""Metadata of a run: device, person, conditions, and the equipment with its dates.

None of it reaches a result; the serial number of the device alone may also choose what a procedure knows of it.
"""

import math
import re
from collections.abc import Mapping
from datetime import date
from typing import Any, Final, Literal

import msgspec
from msgspec import Struct, field
from msgspec.structs import asdict, force_setattr

from vcfbench.errors import ConfigError
from vcfbench.files import is_utf8
from vcfbench.interfaces import Identity
from vcfbench.records.plain import ReadOnly
from vcfbench.strict import unknown_key
from vcfbench.typed import typed, unboxed
from vcfbench.values.kinds import in_words

_LINE: Final = 200
_NOTE: Final = 10_000
_MOST_TAGS: Final = 100
_KEY: Final = re.compile(r"[A-Za-z0-9][A-Za-z0-9_.-]{0,63}", re.ASCII)


class RunMetadata(Struct, frozen=True, kw_only=True):
    """Device, operator, conditions, notes and tags of a run.

    `dut` is the serial number of the device under test. `operator` is who ran it, `note` any words, `tags` words by
    key. `ambient_temperature_c` (degC) and `humidity_percent` (relative) are those of the room. `ambient_from` is the
    role whose instrument measures the temperature at the beginning of the run. All may be missing.

    Raises:
        ConfigError: a value cannot be what it is to be; its name comes first.

    >>> run.metadata.dut, run.metadata.operator
    ('G-0042', 'A. Person')
    """

    dut: str | None = None
    operator: str | None = None
    note: str | None = None
    tags: Mapping[str, str] = field(default_factory=dict)
    ambient_temperature_c: float | None = None
    humidity_percent: float | None = None
    ambient_from: Literal["chamber"] | None = None

    def __post_init__(self) -> None:
        """See that each value can be one, and let no tag be changed from now on."""
        for name, most in (("dut", _LINE), ("operator", _LINE), ("note", _NOTE)):
            if (text := unboxed(getattr(self, name))) is not None:
                force_setattr(self, name, _text(name, text, most))
        if self.dut is not None:
            from vcfbench.records.devices import require_serial  # noqa: PLC0415  # many runs are of no device with a name

            try:
                for serial in self.dut.split(","):  # of several devices at once those of all
                    require_serial(serial)
            except ConfigError as error:
                raise ConfigError(error.what if error.what.startswith("dut") else f"dut: {error.what}") from None
        ambient_c = _number("ambient_temperature_c", unboxed(self.ambient_temperature_c), -100.0, 100.0)
        force_setattr(self, "ambient_temperature_c", ambient_c)
        force_setattr(self, "humidity_percent", _number("humidity_percent", unboxed(self.humidity_percent), 0.0, 100.0))
        if self.ambient_from not in (None, "chamber"):  # what came may be a list
            raise ConfigError(f"ambient_from: expected 'chamber', got {_short(self.ambient_from)}")
        tags, kept = self.tags, dict[str, str]()
        if not isinstance(tags, Mapping) or len(tags) > _MOST_TAGS:
            raise ConfigError(f"tags: expected texts by key, at most {_MOST_TAGS}, got {_short(tags)}")
        for tag in tags.items():
            key, value = map(unboxed, tag)
            if not isinstance(key, str) or not _KEY.fullmatch(key):
                expected = "a key of letters, digits, '_', '-' and '.'"
                raise ConfigError(f"tags: expected {expected}, got {_short(key)}")
            kept[key] = _text(f"tag {key}", value, _LINE)
        force_setattr(self, "tags", ReadOnly(kept))

    def as_json(self) -> dict[str, Any]:
        """Return the values that are set, by name."""
        values = {name: value for name, value in asdict(self).items() if name != "tags"}
        given = {name: value for name, value in values.items() if value is not None}
        return {**given, **({"tags": dict(self.tags)} if self.tags else {})}


class Equipment(Struct, frozen=True, kw_only=True):
    """One instrument of a run, with the dates of its calibration from the bench file.

    `identity` is what it answered, None if it was not asked. `serial_number` is the one it answered, else that of the
    bench file, None if neither has one. `inventory_number` is what is written on it. `overdue`: its calibration was due
    before the day of the run.

    >>> [(each.role, each.model) for each in run.equipment][:2]
    [('power', 'E3631A'), ('rate_source', '33220A')]
    """

    role: str
    model: str
    resource: str
    identity: Identity | None = None
    serial_number: str | None = None
    inventory_number: str | None = None
    calibrated: date | None = None
    calibration_due: date | None = None
    certificate: str | None = None
    overdue: bool = False

    @property
    def title(self) -> str:
        """Role of the instrument as it is printed; an output that is a stream of numbers is read by none."""
        return "stream" if self.model == "stream" else in_words(self.role)[0]

    def as_json(self) -> dict[str, Any]:
        """Return all of it but `identity`, which records hold by role; dates as texts, ``2027-01-15``."""
        values = {name: value for name, value in asdict(self).items() if name != "identity"}
        return {name: str(each) if name in _DATES and each is not None else each for name, each in values.items()}


_DATES: Final = ("calibrated", "calibration_due")


def metadata_of(values: Mapping[str, Any] | RunMetadata | None) -> RunMetadata:
    """Return the metadata that a script gives its run: ``{"dut": "G-0042", "tags": {"batch": "7"}}``.

    Raises:
        ConfigError: a key is unknown, or a value cannot be what it is to be.
    """
    if isinstance(values, RunMetadata):
        return values
    known = RunMetadata.__struct_fields__
    if not isinstance(values, Mapping | None):
        raise ConfigError(f"metadata: expected a mapping of {', '.join(known)}, got {_short(values)}")
    for key in values or ():
        if key not in known:
            raise unknown_key(str(key), known, f"metadata: {key}")
    return RunMetadata(**(values or {}))


def metadata_from(header: Mapping[str, Any]) -> RunMetadata:
    """Return the metadata in the header of a record.

    Raises:
        ConfigError: it cannot be what it is to be.
    """
    recorded = header.get("metadata", {})
    if not isinstance(recorded, Mapping):
        raise ConfigError(f"metadata: expected an object, got a {type(recorded).__name__}")
    return RunMetadata(**{key: value for key, value in recorded.items() if key in RunMetadata.__struct_fields__})


def equipment_of(header: Mapping[str, Any]) -> tuple[Equipment, ...]:
    """Return the instruments that the header of a record names.

    Raises:
        ConfigError: it cannot be what it is to be.
    """
    identities = header.get("identities", {})
    try:
        rows = [{**each, "identity": identities.get(each["role"])} for each in header.get("equipment", ())]
        made = typed(rows, tuple[Equipment, ...])
    except (msgspec.ValidationError, AttributeError, KeyError, TypeError) as error:
        raise ConfigError(f"equipment: expected the instruments of a run: {error}") from None
    return made


def _text(name: str, value: object, most: int) -> str:
    if not isinstance(value, str) or not value.strip() or len(value) > most:
        raise ConfigError(f"{name}: expected a text of 1 to {most} characters, got {_short(value)}")
    if not is_utf8(value):  # no record could hold it
        raise ConfigError(f"{name}: expected a text in UTF-8, got {ascii(value)[:60]}")
    return value


def _number(name: str, value: float | None, low: float, high: float) -> float | None:
    fits = isinstance(value, int | float) and not isinstance(value, bool) and math.isfinite(value)
    if value is not None and not (fits and low <= float(str(value)) <= high):
        raise ConfigError(f"{name}: expected a number from {low:g} to {high:g}, got {_short(value)}")
    return value


def _short(value: object) -> str:
    text = repr(value)
    return text if len(text) <= 60 else f"{text[:57]}..."
