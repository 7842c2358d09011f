"""Names of the sources of uncertainty that budgets share, each once: a misspelt one is no name, and no silent 0."""

from collections.abc import Mapping
from typing import Any, Final, NewType, TypeAlias

SourceName = NewType("SourceName", str)
"""Name of a source; of those that are made of a column or a range too, see the functions."""
Errors: TypeAlias = Mapping[SourceName, Any]
"""What each source of a run is off by; a source that the run has not is off by nothing."""

METER_GAIN: Final = SourceName("meter gain")
METER_OFFSET: Final = SourceName("meter offset")
V_VC_GAIN: Final = SourceName("V_Vc gain")
V_VC_OFFSET: Final = SourceName("V_Vc offset")
V_VC_NOISE: Final = SourceName("V_Vc readings")
RESOLUTION: Final = SourceName("generator resolution")
TABLE_RATE: Final = SourceName("table rate")
TILT: Final = SourceName("the Earth's rate and the tilt of the axis")
TEMPERATURE: Final = SourceName("temperature")
WARM_UP: Final = SourceName("warm-up")
MISALIGNMENT: Final = SourceName("misalignment")
CARRIER_PHASE: Final = SourceName("carrier phase")
DEMODULATOR_PHASE: Final = SourceName("demodulator phase")
ZEROS_APART: Final = SourceName("difference of the zeros, generator off and on")


def by_readings(value: str) -> SourceName:
    """Return the name of what the scatter of the readings does to a value."""
    return SourceName(f"readings: {value}")


def by_flicker(value: str) -> SourceName:
    """Return the name of what flicker does to a value."""
    return SourceName(f"flicker: {value}")


def noise_of(value: str, q: Errors) -> Any:
    """Return what readings and flicker do to a value together."""
    return q[by_readings(value)] + q[by_flicker(value)]
