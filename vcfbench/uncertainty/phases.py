"""Effect of the phases of carrier and demodulator on values, from the bench file.

The demodulator sees a signal with the cosine of its angle to the reference, so a change of the carrier's phase changes
what V_Vc does, and with it K_Vc; one of the demodulator's changes both columns alike, and lets quadrature through.
"""

import math
from collections.abc import Mapping
from typing import Any, Literal, Self, TypeAlias

from msgspec import Struct

from vcfbench.analysis.budget import Source
from vcfbench.station.settings import Sources
from vcfbench.values.sources import CARRIER_PHASE, DEMODULATOR_PHASE, Errors, SourceName

_Value: TypeAlias = Literal["k_vc", "scale_factor", "self_calibrated", "bias_deg_s"]
"""K_Vc, a scale factor on the table, one by V_Vc, whose K_Vc was found at other phases, and a bias by quadrature."""


class PhaseErrors(Struct, frozen=True):
    """Limits of both phases about those that values are stated for, and the effect of a degree of each."""

    sources: tuple[Source, ...]
    per_deg: Mapping[_Value, Mapping[SourceName, float]]
    """By value and source: relative, of a bias deg/s."""

    @classmethod
    def of(cls, known: Sources) -> Self:
        """Return the known errors of the phases: no source without a limit."""
        limits = {CARRIER_PHASE: known.carrier_phase_deg, DEMODULATOR_PHASE: known.demodulator_phase_deg}
        sources = [Source.within(name, 0.0, limit, "deg") for name, limit in limits.items() if limit]
        carrier = _per_deg(known.k_vc_ppm_carrier_deg, known.carrier_phase_deg)
        demodulator = _per_deg(known.scale_factor_ppm_demodulator_deg, known.demodulator_phase_deg)
        of_k_vc = 1e-6 * known.k_vc_ppm_demodulator_deg
        per_deg: dict[_Value, dict[SourceName, float]] = {
            "k_vc": {CARRIER_PHASE: carrier, DEMODULATOR_PHASE: of_k_vc},
            "scale_factor": {DEMODULATOR_PHASE: demodulator},
            "self_calibrated": {CARRIER_PHASE: carrier, DEMODULATOR_PHASE: demodulator + of_k_vc},
            "bias_deg_s": {DEMODULATOR_PHASE: known.bias_deg_s_demodulator_deg or 0.0},
        }
        return cls(tuple(sources), per_deg)

    def effect(self, value: _Value, q: Errors) -> Any:
        """Return the effect of the phases `q`, deg, on a value."""
        return sum(by * q.get(name, 0.0) for name, by in self.per_deg[value].items())

    def u(self, value: _Value) -> dict[str, float]:
        """Return the contributions of each to a value, standard uncertainties."""
        by = self.per_deg[value]
        return {each.name: size for each in self.sources if (size := abs(by.get(SourceName(each.name), 0.0)) * each.u)}


def _per_deg(ppm_deg: float, limit_deg: float | None) -> float:
    """Return the relative effect of a degree, such that the limit has its largest effect, the cosine's included."""
    curved = (1.0 - math.cos(math.radians(limit_deg))) / limit_deg if limit_deg else 0.0
    return math.copysign(1e-6 * abs(ppm_deg) + curved, ppm_deg)
