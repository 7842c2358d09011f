"""Definition and conditions of the values of a run, by its settings and metadata.

A setting either defines values, or is a condition of all of them, or a circumstance: what that does is in u, or u is
incomplete without it. Which of them defines was found by changing each alone. Settings of custom procedures
define all their values.
"""

from collections.abc import Callable, Iterable, Iterator, Mapping
from enum import Enum
from fnmatch import fnmatchcase
from types import MappingProxyType
from typing import Any, Final

from msgspec.structs import replace

from vcfbench.instructions.scale_factor import LOOKED, AtRestSettings, scale_factor_used
from vcfbench.instructions.schedule import KvcBy, SweepSettings
from vcfbench.records.metadata import RunMetadata
from vcfbench.station.settings import DeviceSettings, ProcedureSettings
from vcfbench.values.definition import Conditions, Definition, Drive
from vcfbench.values.value import Value

_BY_V_VC: Final = ("scale_factor_by_v_vc", "bias_by_v_vc", "bias_by_v_vc_deg_s", "nonlinearity_by_v_vc")
_OF_K_VC: Final = ("k_vc", "scale_factor_error_percent", "bias_difference_v", "e_n", *_BY_V_VC)
_OFFSETS: Final = ("bias", "bias_deg_s", "bias_by_v_vc", "bias_by_v_vc_deg_s")
_AT_REST: Final = ("bias_at_rest", "bias_at_rest_deg_s")
_NOISE: Final = ("angle_random_walk", "bias_instability", "rate_random_walk", "rate_ramp", "trend")
_STEPS: Final = ("dead_band", "threshold", "resolution")
_BY_LEVEL: Final = ("scale_factor*", "line")

DEFINING: Final[Mapping[str, tuple[str, ...]]] = MappingProxyType(
    {
        "rates_deg_s": (),  # of lines: below
        "earth": _OFFSETS,
        "k_vc_by": _OF_K_VC,
        "match": _OF_K_VC,
        "match_rate_deg_s": _OF_K_VC,
        "v_vc": ("k_vc",),
        "virtual_rates_deg_s": ("scale_factor_by_v_vc", "nonlinearity_by_v_vc"),
        "scale_factor_v_per_deg_s": (),  # of rates: below
        "mode": _NOISE,
        "nplc": _NOISE,
        "sample_interval_s": _NOISE,
        "duration_s": ("rate_random_walk", "rate_ramp", "trend"),
        "turn_on_tolerance_deg_s": ("warm_up",),
        "by": (*_BY_LEVEL, *_STEPS, "*input_rate_limit"),
        "level_deg_s": _BY_LEVEL,
        "rate_deg_s": ("scale_factor_small",),
        "reference_c": ("*",),
        "temperatures_c": ("*hysteresis",),
        "soak_s": ("*hysteresis",),
        "ramp_k_min": ("*hysteresis",),
        "off_s": ("*repeatability", "turn_on_transient", "largest_current_at_power_on*", "time_to_valid_output*"),
        "order_delay_s": ("time_to_valid_output*",),
        "valid_tolerance_deg_s": ("time_to_valid_output*",),
        "short_share": ("*input_rate_limit",),
        "beyond": ("output_beyond*", "after_beyond*"),
        "wires": ("resistance*",),
        "steps_deg_s": _STEPS,
        "share": _STEPS,
        "at_rate_deg_s": ("resolution",),
        "input_axis": ("*",),
        "static_v_vc_v": ("static_v_per_v",),
    }
)
"""Settings that define values, and the kinds of these, or last parts of their names."""


def defined(
    values: Iterable[Value], settings: ProcedureSettings, metadata: RunMetadata, drive: Drive | None = None
) -> Iterator[Value]:
    """Yield the values of a run with their definitions and conditions; an author's own stay."""
    conditions = _conditions(settings, metadata, drive)
    for each in values:
        of = each.definition if each.definition != Definition() else _definition(settings, each)
        members = {name: getattr(each, name) for name in Value.__struct_fields__}  # of whatever kind of value it is
        yield Value(**{**members, "definition": of, "conditions": conditions})


def _definition(settings: ProcedureSettings, value: Value) -> Definition:
    """Return the definition of a value of a run with these settings."""
    part, _, own_name = value.name.partition(".")
    of_parts: Callable[[str], ProcedureSettings] | None = getattr(settings, "of", None)
    if own_name and of_parts is not None:
        return _definition(of_parts(part), replace(value, name=own_name))
    names = {value.kind, value.name.rpartition(".")[2]} if not value.kind else {value.kind}
    choices = {
        key: _printed(getattr(settings, key))
        for key, kinds in DEFINING.items()
        if key in settings.__struct_fields__
        and any(fnmatchcase(name, kind) for name in names for kind in kinds)
        and not (key in _IDLE and _IDLE[key](settings))
    }
    if isinstance(settings, AtRestSettings) and "deg" in value.unit:
        source = LOOKED if settings.looks_on_table else scale_factor_used(settings).source
        choices["divided_by"] = f"scale factor: {source}"
    if names & {*_OFFSETS, *_AT_REST}:
        choices["horizon_h"] = f"{settings.station.sources.horizon_h:g}"
    if not type(settings).__module__.startswith("vcfbench."):
        own = set(settings.__struct_fields__) - {
            *ProcedureSettings.__struct_fields__,
            *DeviceSettings.__struct_fields__,
        }
        choices |= {key: _printed(getattr(settings, key)) for key in sorted(own)}
    on_line = isinstance(settings, SweepSettings) and "k_vc" not in names
    return Definition.of(settings.series_deg_s if isinstance(settings, SweepSettings) and on_line else (), choices)


def _conditions(settings: ProcedureSettings, metadata: RunMetadata, drive: Drive | None) -> Conditions:
    """Return the conditions of a run: the temperature of the device where that was measured, else that of the room."""
    by_drive_c = None if drive is None else drive.temperature_c
    known_c = (getattr(settings, "temperature_c", None), by_drive_c, metadata.ambient_temperature_c)
    return Conditions(settings.rails_v, next((each for each in known_c if each is not None), None), drive)


def _counts_gaps(settings: ProcedureSettings) -> bool:
    """Return True if a zero record counts what goes by between its readings: then these are circumstances."""
    return _printed(getattr(settings, "mode", None)) != "dead-time"


_IDLE: Final[Mapping[str, Callable[[ProcedureSettings], bool]]] = MappingProxyType(
    {
        "match_rate_deg_s": lambda settings: getattr(settings, "k_vc_by", None) is KvcBy.CURVE,
        "nplc": _counts_gaps,
        "sample_interval_s": _counts_gaps,
    }
)
"""Settings that define nothing under others: a curve has a rate of its own for each match."""


def _printed(value: Any) -> str:
    if isinstance(value, tuple | list):
        return ", ".join(map(_printed, value))
    return f"{value:g}" if isinstance(value, float) else str(value.value if isinstance(value, Enum) else value)
