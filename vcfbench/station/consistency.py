"""Checks of a bench file that types cannot make: values that must agree with each other."""

from collections.abc import Iterator, Mapping
from ipaddress import ip_address
from types import MappingProxyType
from typing import Any

from msgspec import UNSET, structs

from vcfbench.models import ROLES, find_language, find_model, languages, models_for
from vcfbench.station.description import BenchDescription, Device, RateTableRole
from vcfbench.station.invalid_value import MOST_V, InvalidValue, beyond_output, lost_digits, turned_windows
from vcfbench.station.parts import LimitKey, Node

NOT_BESIDE_STREAM = ("multimeter", "rate_source", "v_vc_meter", "vibration_source")
"""Roles that a bench has no use for where the output is a stream: they read or make volts of the device."""
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
    yield from _instruments(description)
    limits, wiring = description.limits, description.wiring
    for low_key, low, high_key, high, unit in (
        ("min_temperature_c", limits.min_temperature_c, "max_temperature_c", limits.max_temperature_c, "degC"),
        ("min_rail_v", limits.min_rail_v, "max_rail_v", limits.max_rail_v, "V"),
    ):
        if low is not None and high is not None and low >= high:
            yield InvalidValue(f"limits.{low_key}", f"less than limits.{high_key} = {high:g} {unit}", low)
    if wiring.rails.positive == "N25V":
        yield InvalidValue("wiring.rails.positive", "'P6V' or 'P25V', outputs above ground", wiring.rails.positive)
    if wiring.rails.negative not in {"N25V", "none"}:
        expected = "'N25V', the output below ground, or 'none' of a device with one supply"
        yield InvalidValue("wiring.rails.negative", expected, wiring.rails.negative)
    if description.gyro.ratiometric is True:
        expected = (
            "no output that goes with the supply: the rail is known to 1500 ppm by the read-back of an E3631A, and so "
            "would the scale factor be; feed the device from a reference, or measure output over supply by other means"
        )
        yield InvalidValue("gyro.ratiometric", expected, description.gyro.ratiometric)
    for node in DRIVE_CHECK_NODES if description.oscilloscope is not None else ():
        if wiring.oscilloscope.channel_of(node) is None:
            yield InvalidValue("wiring.oscilloscope", f"a channel on {node!r}, for the start-up check", None)
    yield from windows_of_results(description)
    yield from _served(description)
    yield from _stream(description)
    for name, part in structs.asdict(description).items():
        # physical parameters have units of their own, settings of procedures are checked with their procedure
        if name not in {"simulation", "procedure_table", "devices"}:
            yield from lost_digits(structs.replace(part, stream=UNSET) if name == "gyro" else part, name)


def windows_of_results(description: BenchDescription) -> Iterator[InvalidValue]:
    """Check that windows of results are none that the output cannot reach."""
    limits, stream = description.limits, description.stream
    most = stream.largest if stream else limits.max_rail_v or MOST_V
    for path, windows in (("expected", description.expected), ("acceptance", description.acceptance)):
        yield from turned_windows(windows, path)
        yield from beyond_output(windows, f"{path}.", most, limits.slow_deg_s)


def _instruments(description: BenchDescription) -> Iterator[InvalidValue]:
    """Check that there is one, and of each: limits, dates, a model that can fill its role, a resource of its own."""
    parts = {role: part for role in (*ROLES, "rate_table") if (part := getattr(description, role)) is not None}
    if not parts:
        yield InvalidValue("power", f"at least one instrument: {', '.join((*ROLES, 'rate_table'))}", None)
    seen: dict[str, str] = {}
    for role, part in parts.items():
        for key in LIMITS_OF.get(role, ()):
            if getattr(description.limits, key) is None:
                yield InvalidValue(f"limits.{key}", f"a limit for the {role} of this bench", None)
        if part.calibrated and part.calibration_due and part.calibration_due <= part.calibrated:
            expected = f"a day after {role}.calibrated = {part.calibrated}"
            yield InvalidValue(f"{role}.calibration_due", expected, part.calibration_due)
        if not (role == "multimeter" and description.stream):
            yield from _table(part) if role == "rate_table" else _model(role, part)
        if (other := seen.setdefault(part.resource.upper(), role)) != role:
            yield InvalidValue(f"{role}.resource", f"a resource of its own, not that of {other}", part.resource)


def _model(role: str, part: Any) -> Iterator[InvalidValue]:
    """Check that a role has a model that can fill it."""
    if getattr(part, "by", None):
        if role == "power":  # no data sheet of it reaches a result
            return
        if part.resolution_v is None:
            yield InvalidValue(f"{role}.resolution_v", "the step of the last digit that is typed, V", None)
    key, model = ("model", part.model) if part.like is None else ("like", part.like)
    row = find_model(model)
    if row is None or role not in row.places:
        known = " or ".join(map(repr, models_for(role)))
        speaks = "" if key == "like" else ", or one that speaks the same words (like = ...)"
        yield InvalidValue(f"{role}.{key}", f"{known}{speaks}", model)


def _table(part: RateTableRole) -> Iterator[InvalidValue]:
    """Check that somebody speaks the table's language, and that the keys are there that it needs."""
    if part.by and part.dialect == "hand":
        return
    if not part.dialect.endswith(".toml") and find_language(part.dialect) is None:
        expected = f"a text: one of {', '.join(languages())}, or the name of a profile, FILE.toml"
        yield InvalidValue("rate_table.dialect", expected, part.dialect)
    elif part.dialect == "zaber" and part.steps_per_deg is None:
        yield InvalidValue("rate_table.steps_per_deg", "the stage's microsteps per degree", None)


def _stream(description: BenchDescription) -> Iterator[InvalidValue]:
    """Check the stream that is the output, and that nothing is beside it that needs volts."""
    if not description.stream:
        return
    for role in NOT_BESIDE_STREAM[1:]:
        if getattr(description, role) is not None:
            yield InvalidValue(role, "no such table with [gyro.stream]: the device has no input for V_Vc", role)
    for key, expected, came in description.stream.contradictions():
        yield InvalidValue(f"gyro.stream.{key}", expected, came)


def shared_wires(description: BenchDescription) -> Iterator[InvalidValue]:
    """Check the gyroscopes of a bench with several: outputs of one kind, each its own, or fields of one stream."""
    seen: dict[str, Device] = {}
    for number, each in enumerate(description.devices or (), 1):
        if bool(each.gyro.stream) != bool(description.stream):
            yield InvalidValue(f"device {number}", "streams of numbers, or multimeters, for all devices", each.name)
        resource = each.multimeter.resource
        other = seen.setdefault(resource.upper(), each)
        if other is each:
            continue
        if not (each.gyro.stream and other.gyro.stream):
            expected = f"a resource of its own, not that of {other.name}"
            yield InvalidValue(f"device {number}.resource", expected, resource)
        elif each.gyro.stream.frame != other.gyro.stream.frame:
            expected = f"frames as those of {other.name} at the same resource: only value may be another"
            yield InvalidValue(f"device {number}.stream", expected, each.name)


def _served(description: BenchDescription) -> Iterator[InvalidValue]:
    """Check that the simulation is either here or elsewhere, and that the port of the latter is one of this host."""
    if description.served is None:
        return
    if description.simulation is not None:
        expected = "no [served] beside [simulation]: the bench is simulated here or elsewhere"
        yield InvalidValue("served", expected, "both")
    host, port = description.served.address()
    if not 0 < port < 65536:
        yield InvalidValue("served.control", "a port from 1 to 65535", description.served.control)
    try:
        here = host == "localhost" or ip_address(host).is_loopback
    except ValueError:
        here = False
    if not here:
        expected = "this host (127.0.0.1, ::1 or localhost): control ports listen nowhere else"
        yield InvalidValue("served.control", expected, description.served.control)
