"""Uncertainty of an output at rest: the meter, the flicker, temperature, warm-up and phases.

A bias is the mean over the horizon (`horizon_h`, a day) about the run. Flicker has as much in an hour as in a minute,
so a short run tells little of that mean however well it is read; how little follows from B alone.
"""

import math
from collections.abc import Iterator

import numpy as np
from msgspec.structs import replace
from numpy.typing import ArrayLike

from vcfbench.analysis.phase_noise import PhaseNoise
from vcfbench.instructions.v_vc import away_from_warm_k, meter_error
from vcfbench.station.settings import ProcedureSettings, Sources
from vcfbench.uncertainty.measurand import finite, measurand
from vcfbench.uncertainty.phases import PhaseErrors
from vcfbench.uncertainty.windows import ENOUGH_DOF, Flicker
from vcfbench.values.sources import METER_GAIN, METER_OFFSET
from vcfbench.values.value import Measurand, UncertaintyPart

_CONTRADICTS = 1.645
"""Excess of the observed flicker, in its own uncertainties, from which it replaces the stated one."""


def flicker_counted(stated: Flicker | None, square: float, u_square: float, where: str) -> Flicker:
    """Return the flicker that counts: the stated one, or that of `where`, if it is larger by more than chance.

    `square` is B squared as it was found, (deg/h)^2, 0 where the noise hides it, `u_square` its standard uncertainty.
    """
    if stated is not None and square - _CONTRADICTS * u_square <= stated.deg_h**2:
        return stated
    expected, dof = _not_negative(square, u_square)
    return Flicker(math.sqrt(expected), dof, f"{where}, dof {dof:.1f}")


def flicker_found(known: Sources, square: float, u_square: float) -> Flicker:
    """Return the flicker that counts where a record has found it, (deg/h)^2: its own, if that is known well enough."""
    expected, dof = _not_negative(square, u_square)
    own, stated = Flicker(math.sqrt(expected), dof, f"this record, dof {dof:.1f}"), Flicker.stated(known)
    assumed = "bias_instability_deg_h" in known.assumed
    return own if stated is None or assumed or dof >= ENOUGH_DOF or own.deg_h > stated.deg_h else stated


def _not_negative(square: float, u: float) -> tuple[float, float]:
    """Return the expectation of a square that was found with so large a `u`, and its degrees of freedom.

    A square that came out as 0 is not known to be 0: of a normal distribution about it, the part above 0 counts.
    """
    if not u > 0.0:
        return square, math.inf
    at = square / u
    above = math.exp(-0.5 * at**2) / math.sqrt(2.0 * math.pi) / (0.5 * math.erfc(-at / math.sqrt(2.0)))
    expected, variance = square + u * above, u**2 * (1.0 - at * above - above**2)
    return expected, 2.0 * expected**2 / variance


def flicker_part(flicker: Flicker, per_deg_h: float) -> UncertaintyPart:
    """Return the contribution of a flicker to a value that 1 deg/h of it makes uncertain by `per_deg_h`."""
    source = f"flicker: B {flicker.deg_h:.3g} deg/h ({flicker.said})"
    return UncertaintyPart(source, per_deg_h * flicker.deg_h, finite(flicker.dof))


def as_rate(output: Measurand, scale_factor: float, u_scale_factor: float | None, null_v: float = 0.0) -> Measurand:
    """Return an output at rest (V) as a rate (deg/s) from `null_v`.

    Without a `u_scale_factor`, V/(deg/s), it is incomplete.
    """
    value, per_v = (output.value - null_v) / scale_factor, 1.0 / abs(scale_factor)
    parts = [replace(part, u=per_v * part.u) for part in output.parts]
    if u_scale_factor is None:
        return measurand(value, "deg/s", parts, (*output.missing, "scale factor"), "bias_at_rest_deg_s")
    parts.append(UncertaintyPart("scale factor", abs(value) * per_v * u_scale_factor))
    return measurand(value, "deg/s", parts, output.missing, "bias_at_rest_deg_s")


def about_horizon(begin_s: ArrayLike, end_s: ArrayLike, horizon_h: float) -> float:
    """Return the standard uncertainty that a flicker of B = 1 leaves the mean of windows, in the unit of B.

    It is that of the windows' mean, from `begin_s` to `end_s`, (n,), as a statement about the mean over the horizon
    around them.
    """
    begin, end = np.asarray(begin_s, dtype=np.float64), np.asarray(end_s, dtype=np.float64)
    middle = 0.5 * float(begin.min() + end.max())
    begin, end = np.append(begin, middle - 1800.0 * horizon_h), np.append(end, middle + 1800.0 * horizon_h)
    share = np.append(np.full(begin.size - 1, 1.0 / (begin.size - 1)), -1.0) / (end - begin)
    times, shares = np.concatenate([end, begin]), np.concatenate([share, -share])
    return math.sqrt(max(0.0, float(shares @ PhaseNoise(flicker=1.0).among(times) @ shares)))


def parts_at_rest(
    settings: ProcedureSettings, output_v: float, scale_factor: float, lasted_s: float
) -> Iterator[UncertaintyPart]:
    """Yield the contributions of meter, temperature, warm-up and phases to an output at rest, V.

    The `scale_factor` is in V/(deg/s); the output was averaged for `lasted_s`.
    """
    if "multimeter" in settings.station.instruments and settings.station.stream is None:
        meter = meter_error(settings, "multimeter")
        yield UncertaintyPart(METER_GAIN, abs(output_v) * meter.u_gain, None, meter.owner)
        yield UncertaintyPart(METER_OFFSET, meter.u_offset_v, None, meter.owner)
    known = settings.station.sources
    per_k = abs(scale_factor) * (known.bias_deg_h_k or 0.0) / 3600.0
    for name, u_k in away_from_warm_k(settings, lasted_s).items():
        yield UncertaintyPart(name, per_k * u_k)
    for name, u_deg_s in PhaseErrors.of(known).u("bias_deg_s").items():
        yield UncertaintyPart(name, abs(scale_factor) * u_deg_s)
