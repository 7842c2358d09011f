"""Entries of a certificate that are not measured: laboratory, customer, device, responsible person."""

import re
from collections.abc import Mapping
from datetime import date
from typing import Any, Final

from msgspec import Struct

from vcfbench.archive.days import days_of
from vcfbench.archive.run import Run
from vcfbench.errors import ConfigError

NOT_ADJUSTED: Final = "none during the run"


class CertificateWords(Struct, frozen=True, kw_only=True):
    """Laboratory, customer, device and responsible person of a calibration; entries with a default may be left out.

    `country` is that of the laboratory, two capital letters (ISO 3166-1); `identifier` the certificate's own number, to
    which that of the revision is added;
    `responsible` the person who answers for it, with `responsible_function`; `item` what the device is, `serial` its
    serial number; `issued` is the day of issue, 2026-11-23. `place` is where it was calibrated, `received` when the
    device came in, `method` by which method and edition, `adjustment` and `deviations` what was adjusted, and what
    deviates from the method.
    """

    laboratory: str
    laboratory_address: str
    country: str
    customer: str
    customer_address: str
    responsible: str
    serial: str
    identifier: str
    item: str = "MEMS gyroscope"
    item_manufacturer: str = ""
    item_model: str = ""
    laboratory_email: str = ""
    laboratory_code: str = ""
    customer_email: str = ""
    issued: str = ""
    place: str = ""
    received: str = ""
    method: str = ""
    adjustment: str = NOT_ADJUSTED
    deviations: str = ""
    responsible_function: str = ""


_KNOWN: Final = CertificateWords.__struct_fields__
_NEEDED: Final = {
    "laboratory": "name in [laboratory] of the bench file",
    "laboratory_address": "address in [laboratory] of the bench file",
    "country": "country in [laboratory] of the bench file",
    "customer": "",
    "customer_address": "",
    "responsible": "--operator of the run, or operator in [laboratory] of the bench file",
    "serial": "--dut of the run",
}
"""Entries without a default, and the places to give them beside `--set` and the tags of the run."""


def certificate_words(run: Run, given: Mapping[str, str] | None = None) -> CertificateWords:
    """Return the entries of a certificate of `run`: those `given`, else the run's tags, its record, and its bench file.

    Raises:
        ConfigError: something is missing, all of it in one; a key is unknown; a country is no two capital letters.
    """
    found = stated_words(run, given)
    missing = [key for key in _NEEDED if key not in found]
    if missing:
        words = "; ".join(f"{key} ({_NEEDED[key]})" if _NEEDED[key] else key for key in missing)
        raise ConfigError(
            f"a calibration certificate of {run.name or 'a run without a record'} needs {words}",
            hint=f"{' '.join(f'--set {key}=...' for key in missing)}, or as --tag KEY=VALUE of the run",
        )
    if not re.fullmatch("[A-Z]{2}", found["country"]):
        raise ConfigError(f"country: expected two capital letters (ISO 3166-1), got {found['country']!r}")
    return CertificateWords(**found)


def stated_words(run: Run, given: Mapping[str, str] | None = None) -> dict[str, str]:
    """Return as many entries of a certificate of `run` as are known, by the fields of `CertificateWords`.

    Raises:
        ConfigError: a key is unknown, or the device was received, measured and its certificate issued in no such order.
    """
    given = given or {}
    unknown = [key for key in given if key not in _KNOWN]
    if unknown:
        raise ConfigError(f"certificate: expected keys of {', '.join(_KNOWN)}, got {', '.join(map(repr, unknown))}")
    laboratory: Mapping[str, Any] = run.header.get("bench", {}).get("laboratory") or {}
    versions = run.header.get("versions", {})
    edition = versions.get("vcfbench")
    recorded = {
        "laboratory": laboratory.get("name"),
        "laboratory_address": laboratory.get("address"),
        "laboratory_email": laboratory.get("email"),
        "country": laboratory.get("country"),
        "responsible": run.metadata.operator or laboratory.get("operator"),
        "serial": run.metadata.dut,
        "method": f"{run.procedure}, vcfbench {edition}, evaluation {versions.get('evaluation', 0)}"
        if edition
        else None,
        "identifier": run.name,
    }
    tags = {key: value for key, value in run.metadata.tags.items() if key in _KNOWN}
    stated = {**recorded, **tags, **given}
    found = {key: " ".join(value.split()) for key, value in stated.items() if value and value.strip()}
    if "identifier" in found:
        found["identifier"] = revised(run, found["identifier"])
    _in_order(run, found)
    return found


def revised(run: Run, identifier: str | None) -> str:
    """Return an identifier with the revision of the record, from the second on."""
    return f"{identifier or ''} revision {run.revision}" if run.amendments else identifier or ""


def _in_order(run: Run, found: Mapping[str, str]) -> None:
    """Refuse days that cannot be; those of a record are of UTC, so all are."""
    given = [key for key in ("received", "issued") if key in found]
    first, last = (days_of(run) if given else None) or (None, None)
    amended = run.amendments[-1].utc[:10] if run.amendments else None
    days = (
        *(("received", found.get("received")), ("the first day measured", first), ("the last day measured", last)),
        *(("the last amendment", amended), ("issued", found.get("issued"))),
    )
    latest: tuple[str, date] | None = None
    for key, day in days:
        if day is None:
            continue
        try:
            on = date.fromisoformat(day)
        except ValueError:
            raise ConfigError(f"{key}: expected a day such as 2026-11-23, got {day!r}") from None
        if latest is not None and on < latest[1]:
            raise ConfigError(
                f"{key}, {on}, is before {latest[0]}, {latest[1]} (UTC)",
                hint=" or ".join(f"--set {each}=DAY" for each in given),
            )
        latest = key, on
