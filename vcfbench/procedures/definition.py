"""Definition and conditions of the values of a run, by its settings and what was told of it.

A setting either defines values, those of the kinds beside it or all of them, or is a circumstance: what that does is in
u, or u is incomplete without it. Settings of procedures of one's own define all values.
"""

from collections.abc import Mapping
from enum import Enum
from types import MappingProxyType
from typing import Any, Final

from vcfbench.procedures.shared.sweep.schedule import KvcBy, SweepSettings
from vcfbench.records.metadata import RunMetadata
from vcfbench.station.settings import ProcedureSettings
from vcfbench.values.definition import Conditions, Definition
from vcfbench.values.value import Value

_BY_V_VC: Final = ("scale_factor_by_v_vc", "bias_by_v_vc", "bias_by_v_vc_deg_s", "nonlinearity_by_v_vc")
_OF_K_VC: Final = ("k_vc", "scale_factor_error_percent", "bias_difference_v", "e_n", *_BY_V_VC)
_OFFSETS: Final = ("bias", "bias_deg_s", "bias_by_v_vc", "bias_by_v_vc_deg_s", "output_v")

DEFINING: Final[Mapping[str, tuple[str, ...]]] = MappingProxyType(
    {
        "earth": _OFFSETS,
        "k_vc_by": _OF_K_VC,
        "match_rate_deg_s": _OF_K_VC,
    }
)
"""Settings that define values, by name, and the kinds of these, or last parts of their names; none: all values."""


def definition_of(settings: ProcedureSettings, value: Value) -> Definition:
    """Return what a value of a run with these settings is of."""
    kind = value.kind or value.name.rpartition(".")[2]
    choices = [
        (key, _printed(getattr(settings, key)))
        for key, kinds in DEFINING.items()
        if key in settings.__struct_fields__ and (not kinds or kind in kinds) and not _idle(key, settings)
    ]
    if not isinstance(settings, SweepSettings) or kind == "k_vc":
        return Definition.of(choices=choices)
    return Definition.of(settings.series_deg_s, choices)


def conditions_of(settings: ProcedureSettings, metadata: RunMetadata) -> Conditions:
    """Return the conditions of a run: the temperature of the device where that was measured, else that of the room."""
    measured_c = getattr(settings, "temperature_c", None)
    rails_v = settings.positive_rail_v, settings.negative_rail_v
    return Conditions(rails_v, metadata.ambient_temperature_c if measured_c is None else measured_c)


def _idle(key: str, settings: ProcedureSettings) -> bool:
    """Tell whether another setting makes this one do nothing: a curve has a rate of its own for each match."""
    return key == "match_rate_deg_s" and getattr(settings, "k_vc_by", None) is KvcBy.CURVE


def _printed(value: Any) -> str:
    return str(value.value if isinstance(value, Enum) else value)
