"""Effect of the phases of carrier and demodulator on values, as far as the bench file knows them.

The demodulator sees a signal with the cosine of its angle to the reference, so a change of the carrier's phase changes
what V_Vc does, and with it K_Vc; one of the demodulator's changes both columns alike, and lets quadrature through.
"""

import math
from collections.abc import Mapping
from typing import Any, Self

from msgspec import Struct

from vcfbench.analysis.budget import Source
from vcfbench.station.settings import Sources

CARRIER_PHASE, DEMODULATOR_PHASE = "carrier phase", "demodulator phase"


class PhaseErrors(Struct, frozen=True):
    """Limits of both phases about those that values are stated for, and the effect of a degree of each."""

    sources: tuple[Source, ...]
    k_vc_per_carrier_deg: float
    """Relative."""
    k_vc_per_demodulator_deg: float
    scale_factor_per_demodulator_deg: float
    bias_deg_s_per_demodulator_deg: float

    @classmethod
    def of(cls, known: Sources) -> Self:
        """Return the known errors of the phases: no source without a limit."""
        limits = {CARRIER_PHASE: known.carrier_phase_deg, DEMODULATOR_PHASE: known.demodulator_phase_deg}
        sources = [Source.within(name, 0.0, limit, "deg") for name, limit in limits.items() if limit]
        return cls(
            tuple(sources),
            _per_deg(known.k_vc_ppm_carrier_deg, known.carrier_phase_deg),
            1e-6 * known.k_vc_ppm_demodulator_deg,
            _per_deg(known.scale_factor_ppm_demodulator_deg, known.demodulator_phase_deg),
            known.bias_deg_s_demodulator_deg or 0.0,
        )

    def k_vc(self, q: Mapping[str, Any]) -> Any:
        """Return the factor of K_Vc."""
        by_carrier = self.k_vc_per_carrier_deg * q.get(CARRIER_PHASE, 0.0)
        return 1.0 + by_carrier + self.k_vc_per_demodulator_deg * q.get(DEMODULATOR_PHASE, 0.0)

    def scale_factor(self, q: Mapping[str, Any]) -> Any:
        """Return the factor of the scale factor of either column."""
        return 1.0 + self.scale_factor_per_demodulator_deg * q.get(DEMODULATOR_PHASE, 0.0)

    def bias_deg_s(self, q: Mapping[str, Any]) -> Any:
        """Return the bias by quadrature, deg/s."""
        return self.bias_deg_s_per_demodulator_deg * q.get(DEMODULATOR_PHASE, 0.0)

    @property
    def u_k_vc(self) -> dict[str, float]:
        """Contributions of each to K_Vc, relative standard uncertainties."""
        return self._relative(self.k_vc_per_carrier_deg, self.k_vc_per_demodulator_deg)

    @property
    def u_scale_factor(self) -> dict[str, float]:
        """Contributions of each to a scale factor on the table."""
        return self._relative(0.0, self.scale_factor_per_demodulator_deg)

    @property
    def u_self_calibrated(self) -> dict[str, float]:
        """Contributions of each to a scale factor by V_Vc, whose K_Vc was found at other phases."""
        by_demodulator = self.scale_factor_per_demodulator_deg + self.k_vc_per_demodulator_deg
        return self._relative(self.k_vc_per_carrier_deg, by_demodulator)

    @property
    def u_bias_deg_s(self) -> dict[str, float]:
        """Contributions of each to a bias, deg/s."""
        by = {DEMODULATOR_PHASE: self.bias_deg_s_per_demodulator_deg}
        return {source.name: abs(by[source.name]) * source.u for source in self.sources if by.get(source.name)}

    def _relative(self, by_carrier: float, by_demodulator: float) -> dict[str, float]:
        by = {CARRIER_PHASE: by_carrier, DEMODULATOR_PHASE: by_demodulator}
        return {source.name: abs(by[source.name]) * source.u for source in self.sources if by[source.name]}


def _per_deg(ppm_deg: float, limit_deg: float | None) -> float:
    """Return the relative effect of a degree, such that the limit has its largest effect, the cosine's included."""
    curved = (1.0 - math.cos(math.radians(limit_deg))) / limit_deg if limit_deg else 0.0
    return math.copysign(1e-6 * abs(ppm_deg) + curved, ppm_deg)
