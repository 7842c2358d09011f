"""Checks of a bench file that types cannot make: values that must agree with each other."""

from __future__ import annotations

from ipaddress import ip_address
from itertools import chain
from types import MappingProxyType
from typing import TYPE_CHECKING

from msgspec import structs

from vcfbench.models import ROLES, find_language, find_model, languages, models_for
from vcfbench.station.invalid_value import InvalidValue, lost_digits, turned_windows

if TYPE_CHECKING:
    from collections.abc import Iterator, Mapping

    from vcfbench.station.description import BenchDescription
    from vcfbench.station.parts import LimitKey, Node

DRIVE_CHECK_NODES: tuple[Node, ...] = ("drive", "carrier")

LIMITS_OF: Mapping[str, tuple[LimitKey, ...]] = MappingProxyType(
    {
        "rate_table": ("max_rate_deg_s", "max_acceleration_deg_s2"),
        "rate_source": ("max_v_vc_v",),
        "vibration_source": ("max_v_vc_v",),
        "power": ("min_rail_v", "max_rail_v", "max_rail_current_a"),
        "chamber": ("min_temperature_c", "max_temperature_c", "max_ramp_k_min"),
    }
)
"""The limits that an instrument must have before it may be on a bench, by its role."""


def invalid_values(description: BenchDescription) -> Iterator[InvalidValue]:
    """Yield every contradiction within `description`."""
    return chain(
        _roles(description),
        _calibrations(description),
        _temperatures(description),
        _models(description),
        _rails(description),
        _wiring(description),
        _windows(description),
        _resources(description),
        _served(description),
        _table(description),
        _lost_digits(description),
    )


def _roles(description: BenchDescription) -> Iterator[InvalidValue]:
    """Check that there is an instrument, and that each one that drives something has its limits."""
    filled = [role for role in (*ROLES, "rate_table") if getattr(description, role) is not None]
    if not filled:
        yield InvalidValue("power", f"at least one instrument: {', '.join((*ROLES, 'rate_table'))}", None)
    for role in filled:
        for key in LIMITS_OF.get(role, ()):
            if getattr(description.limits, key) is None:
                yield InvalidValue(f"limits.{key}", f"a limit for the {role} of this bench", None)


def _calibrations(description: BenchDescription) -> Iterator[InvalidValue]:
    """Check that a calibration is due after it was made."""
    for role in (*ROLES, "rate_table"):
        part = getattr(description, role)
        if part is None or part.calibrated is None or part.calibration_due is None:
            continue
        if part.calibration_due <= part.calibrated:
            expected = f"a day after {role}.calibrated = {part.calibrated}"
            yield InvalidValue(f"{role}.calibration_due", expected, part.calibration_due)


def _temperatures(description: BenchDescription) -> Iterator[InvalidValue]:
    low, high = description.limits.min_temperature_c, description.limits.max_temperature_c
    if low is not None and high is not None and low >= high:
        yield InvalidValue("limits.min_temperature_c", f"less than limits.max_temperature_c = {high:g} degC", low)


def _models(description: BenchDescription) -> Iterator[InvalidValue]:
    """Check that each role has a model that can fill it, the table a language that somebody speaks."""
    for role in ROLES:
        part = getattr(description, role)
        if part is not None:
            key = "model" if part.like is None else "like"
            model = part.like or part.model
            row = find_model(model)
            if row is None or role not in row.places:
                known = " or ".join(map(repr, models_for(role)))
                speaks = "" if key == "like" else ", or one that speaks the same words (like = ...)"
                yield InvalidValue(f"{role}.{key}", f"{known}{speaks}", model)
    dialect = "" if description.rate_table is None else description.rate_table.dialect
    if dialect and not dialect.endswith(".toml") and find_language(dialect) is None:
        expected = f"a text: one of {', '.join(languages())}, or the name of a profile, FILE.toml"
        yield InvalidValue("rate_table.dialect", expected, dialect)


def _rails(description: BenchDescription) -> Iterator[InvalidValue]:
    low, high = description.limits.min_rail_v, description.limits.max_rail_v
    if low is not None and high is not None and low >= high:
        yield InvalidValue("limits.min_rail_v", f"less than limits.max_rail_v = {high:g} V", low)


def _wiring(description: BenchDescription) -> Iterator[InvalidValue]:
    rails = description.wiring.rails
    if rails.positive == "N25V":
        yield InvalidValue("wiring.rails.positive", "'P6V' or 'P25V', outputs above ground", rails.positive)
    if rails.negative != "N25V":
        yield InvalidValue("wiring.rails.negative", "'N25V', the output below ground", rails.negative)
    for node in DRIVE_CHECK_NODES if description.oscilloscope is not None else ():
        if description.wiring.oscilloscope.channel_of(node) is None:
            yield InvalidValue("wiring.oscilloscope", f"a channel that sees {node!r}, for the start-up check", None)


def _windows(description: BenchDescription) -> Iterator[InvalidValue]:
    yield from turned_windows(description.expected, "expected")
    yield from turned_windows(description.acceptance, "acceptance")


def _resources(description: BenchDescription) -> Iterator[InvalidValue]:
    seen: dict[str, str] = {}
    for role in (*ROLES, "rate_table"):
        part = getattr(description, role)
        if part is None:
            continue
        other = seen.setdefault(part.resource.upper(), role)
        if other != role:
            yield InvalidValue(f"{role}.resource", f"a resource of its own, not that of {other}", part.resource)


def _served(description: BenchDescription) -> Iterator[InvalidValue]:
    """Check that the simulation is either here or elsewhere, and that the port of the latter is one."""
    if description.served is None:
        return
    if description.simulation is not None:
        yield InvalidValue(
            "served", "no [served] beside [simulation]: the bench is simulated here or elsewhere", "both"
        )
    host, port = description.served.address()
    if not 0 < port < 65536:
        yield InvalidValue("served.control", "a port from 1 to 65535", description.served.control)
    if not _is_this_host(host):
        expected = "this host (127.0.0.1, ::1 or localhost): control ports listen nowhere else"
        yield InvalidValue("served.control", expected, description.served.control)


def _is_this_host(host: str) -> bool:
    try:
        return host == "localhost" or ip_address(host).is_loopback
    except ValueError:
        return False


def _table(description: BenchDescription) -> Iterator[InvalidValue]:
    """Check the keys that the table's dialect needs."""
    table = description.rate_table
    if table is not None and table.dialect == "zaber" and table.steps_per_deg is None:
        yield InvalidValue("rate_table.steps_per_deg", "the stage's microsteps per degree", None)


def _lost_digits(description: BenchDescription) -> Iterator[InvalidValue]:
    """Check all but physical parameters, which have units of their own, and settings of procedures."""
    for name, part in structs.asdict(description).items():
        if name not in {"simulation", "procedure_table"}:
            yield from lost_digits(part, name)
