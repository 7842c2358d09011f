"""Limits of a drift since the certificate."""

from __future__ import annotations

from typing import TYPE_CHECKING

from vcfbench.station.settings import Limit

if TYPE_CHECKING:
    from collections.abc import Sequence

E_N_ACTION = 1.5
"""E_n beyond which a drift fails: three standard uncertainties, the action limit of Shewhart charts (ISO 7870-2)."""
CUSUM_ACTION = 5.0
"""Cumulative sum beyond which a creep fails, with k = 0.5 (NIST/SEMATECH e-Handbook 6.3.2.3): by chance 1 in 465."""


def drift_limits(stated: Sequence[Limit], max_drift_ppm: float | None) -> tuple[Limit, ...]:
    """Return the limits that a drift is judged by beside those `stated` by the bench file.

    A limit of the drift says how much there may be: by it alone the drift is judged then, with U95 as guard band.
    """
    keys = {limit.key for limit in stated}
    never_again = Limit("failed_before", 0.0, 0.0)
    if max_drift_ppm is not None:
        return Limit("drift_ppm", -max_drift_ppm, max_drift_ppm, guarded=True), never_again
    if "drift_ppm" in keys:
        return (never_again,)
    seen = () if "e_n" in keys else (Limit("e_n", 0.0, E_N_ACTION),)
    return *seen, Limit("e_n_since_last", 0.0, E_N_ACTION), Limit("cusum", 0.0, CUSUM_ACTION), never_again
