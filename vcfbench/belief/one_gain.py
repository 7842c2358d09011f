"""One gain of the meter for all gains of a response: residuals of the closed form, in the order of time."""

import math

import numpy as np

from vcfbench.analysis.arrays import Floats
from vcfbench.analysis.model_fit import derivatives
from vcfbench.analysis.rate_band import RateBand, split_response
from vcfbench.belief.jumps import GAIN
from vcfbench.belief.patterns import patterns_of
from vcfbench.errors import MeasurementError

_SIGMAS = 5.5
_MOST_T = 6.5
"""Student's t of the largest pattern by what else is left: a closed form that lacks something everywhere is no change
of a gain. Beyond both is by chance less than one sweep of 35 gains in 1e4."""
_STEP = 1e-4
_FEW = 3


def require_one_gain(band: RateBand, drive_hz: float, taken: Floats, close: float) -> None:
    """See that the gains of a response neither step nor creep while they are taken.

    Args:
        band: the fitted response.
        drive_hz: frequency of the drive.
        taken: place in time of each of its gains, (n,).
        close: as close as gains without noise need to be to the closed form.

    Raises:
        MeasurementError: a change of the gain explains most of what the closed form leaves.
    """
    f, parameters = band.frequency_hz, band.parameters

    def log_gain(at: Floats) -> Floats:
        return np.asarray(np.log(np.abs(at[2]) * split_response(f, drive_hz, np.delete(at, 2))))

    order = np.argsort(taken)
    free = derivatives(log_gain, parameters, _STEP * np.maximum(np.abs(parameters), 0.01))
    u = np.hypot(band.u_gain / band.gain, close)[order]
    count = order.size
    found = next(
        patterns_of(
            band.residual[order], free[order], np.diag(u**2), np.arange(count, dtype=float), {GAIN: np.ones(count)}
        )
    )
    # A step from one gain on to the end, or a walk; the first few alone, or the last, are outliers and no change
    begin = np.concatenate([np.where(found.end == count, found.begin, 0), np.arange(1, count - 1)])
    sizes = np.abs(found.sigmas) * ((begin >= _FEW) & (begin <= count - _FEW))
    place = int(sizes.argmax())
    sigmas = float(sizes[place])
    rest = math.fsum(np.square(band.residual[order] / u)) - sigmas**2
    t = sigmas * math.sqrt((band.dof - 1.0) / max(rest, 1e-9))
    if sigmas <= _SIGMAS or t <= _MOST_T:
        return
    pattern, size = found.pattern(place), 100.0 * float(found.sizes[place])
    raise MeasurementError(
        f"the gain {'creeps' if pattern.walks else 'steps'} by {size:+.2g} % in the sweep, "
        f"from {f[order[pattern.first]]:.4g} Hz on ({sigmas:.0f} standard uncertainties)",
        instrument="multimeter",
        hint="check leads and contacts, and events at that time",
    )
