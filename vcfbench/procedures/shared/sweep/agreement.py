"""Agreement of the points of a run with one slope, and with the bench file's expectations of this gyroscope.

Between neighbouring rates the output must move, and in one direction throughout. What leads that fall off or are
swapped leave behind in the middle of a run is refused here; what is wrong from the first reading to the last cannot be
known from the run, and is what `[expected]` is for.
"""

from __future__ import annotations

import math
import statistics
from itertools import pairwise, starmap
from types import MappingProxyType
from typing import TYPE_CHECKING

from vcfbench.errors import MeasurementError

if TYPE_CHECKING:
    from collections.abc import Callable, Sequence

    from vcfbench.records.schema import Point
    from vcfbench.station.parts import Expected

_NOISES = 8.0
"""Allowance for noise, in standard uncertainties: readings are not independent (flicker)."""

_SLOPES = (0.5, 1.5)
"""Limits of the slope between two neighbouring rates, relative to that of the whole."""

_ZEROS_APART = 2.0
"""Largest shift of the zero by the generator coming on at 0 V, in outputs of the matching rate."""

_ROUGHLY = 10.0
"""Factor by which K_Vc may differ from the guess of the bench file, either way."""

_STATIONARY_DEG_S = 1e-9


def _driven(point: Point) -> bool:
    """Tell whether the generator was on: in steps 2 and 4 and the zeros between, where the table is at rest."""
    return point.step in {2, 4, 6, 7}


def require_same_zero(zero_table: Point, zero_virtual: Point, turning: Point) -> None:
    """See that the generator, coming on at 0 V, does not move the zero by more than the match can bear.

    Raises:
        MeasurementError: it does: V_Vc has an offset.
    """
    span_v = abs(turning.output_v - zero_table.output_v)
    moved_v = zero_virtual.output_v - zero_table.output_v
    if abs(moved_v) > _ZEROS_APART * span_v:
        raise _disagreement(
            zero_virtual,
            f"the zero moved from {zero_table.output_v:+.6g} V to {zero_virtual.output_v:+.6g} V as the generator came "
            f"on at 0 V; the matching rate is worth {span_v:.3g} V",
            "V_Vc has an offset, or the lead of the output has come off: look at both",
        )


def require_steady_slope(
    points: Sequence[Point], reference: Sequence[Point] = (), limit_v: Callable[[float], float] | None = None
) -> None:
    """See that the output moves between all neighbouring rates, and everywhere in one direction.

    Args:
        points: the points of one sweep.
        reference: two points of an earlier step whose slope has to be that of the sweep too.
        limit_v: how far a level of V_Vc may be off, V, where it is believed as it was set: small levels on two ranges
            of a generator may be some millivolts nearer or further apart.

    Raises:
        MeasurementError: between two rates the slope is not within 0.5 to 1.5 of that of the whole.
    """
    ordered = sorted(_distinct(points), key=_x)
    if len(ordered) < 2:
        return
    slope = _slope(*reference) if reference else statistics.median(starmap(_slope, pairwise(ordered)))
    degrees = sum(point.n - 1 for point in points)
    noise_v = math.sqrt(math.fsum((point.n - 1) * point.std_v**2 for point in points) / max(1, degrees))
    low, high = _SLOPES
    for left, right in [(ordered[0], ordered[-1]), *pairwise(ordered)]:
        u_v = _NOISES * noise_v * math.sqrt(1.0 / left.n + 1.0 / right.n)
        if limit_v is not None:
            u_v += abs(slope) * (limit_v(_x(left)) + limit_v(_x(right)))
        step = slope * (_x(right) - _x(left))
        moved_v = right.output_v - left.output_v
        if min(low * step, high * step) - u_v <= moved_v <= max(low * step, high * step) + u_v:
            continue
        whence = f"step {reference[0].step}" if reference else "the whole sweep"
        raise _disagreement(
            right,
            f"from {_words(left)} to {_words(right)} the output moves by {moved_v:+.4g} V, "
            f"the slope of {whence} lets expect {step:+.4g} V",
            "a lead came off or was swapped, or something is saturated: look at the leads of the output and of V_Vc",
        )


def _distinct(points: Sequence[Point]) -> list[Point]:
    return list({_x(point): point for point in points}.values())


def _x(point: Point) -> float:
    return point.v_vc_v if _driven(point) else point.rate_deg_s


def _slope(left: Point, right: Point) -> float:
    return (right.output_v - left.output_v) / (_x(right) - _x(left))


def require_expected_column(points: Sequence[Point], expected: Expected) -> None:
    """Raise MeasurementError unless scale factor and bias on the table are those that the bench file expects.

    Raises:
        MeasurementError: they are not.
    """
    ordered = sorted(_distinct(points), key=_x)
    scale_factor = _slope(ordered[0], ordered[-1])
    zero = min(ordered, key=lambda point: abs(point.rate_deg_s))
    bias_v = zero.output_v - scale_factor * zero.rate_deg_s
    step = points[-1].step
    _require("scale_factor_v_per_deg_s", expected.scale_factor_v_per_deg_s, scale_factor, step)
    _require("bias_v", expected.bias_v, bias_v, step)


def require_expected_k_vc(k_vc: float, guess: float, expected: Expected) -> None:
    """Raise MeasurementError unless K_Vc, (deg/s)/V, has the guess's sign and rough size, or the expected value.

    Raises:
        MeasurementError: it is not.
    """
    _require("k_vc_deg_s_per_v", expected.k_vc_deg_s_per_v, k_vc, 2)
    if expected.k_vc_deg_s_per_v is None and not 1.0 / _ROUGHLY <= k_vc / guess <= _ROUGHLY:
        raise MeasurementError(
            f"K_Vc comes out as {k_vc:.5g} (deg/s)/V, the bench file guesses {guess:g}: its sign, or its size by more "
            f"than a factor of {_ROUGHLY:g}, is another",
            instrument="multimeter",
            step="2",
            hint="are the leads of the output or of V_Vc swapped? else correct procedure.k_vc_guess_deg_s_per_v",
        )


_NAMES = MappingProxyType(
    {
        "scale_factor_v_per_deg_s": ("scale factor", "V/(deg/s)"),
        "bias_v": ("bias", "V"),
        "k_vc_deg_s_per_v": ("K_Vc", "(deg/s)/V"),
    }
)
"""Names of the keys of ``[expected]``, and their units."""


def _require(key: str, window: tuple[float, float] | None, value: float, step: int) -> None:
    if window is None or window[0] <= value <= window[1]:
        return
    what, unit = _NAMES[key]
    raise MeasurementError(
        f"the {what} is {value:.6g} {unit}, the bench file expects {window[0]:g} to {window[1]:g} {unit} "
        f"(expected.{key})",
        instrument="multimeter",
        step=str(step),
        hint="are leads off or swapped, or is it another gyroscope?",
    )


def _words(point: Point) -> str:
    if _driven(point):
        return f"V_Vc of {point.v_vc_v:+.6g} V"
    return f"{point.rate_deg_s:+g} deg/s"


def _disagreement(point: Point, what: str, hint: str) -> MeasurementError:
    return MeasurementError(what, instrument="multimeter", step=str(point.step), hint=hint)
