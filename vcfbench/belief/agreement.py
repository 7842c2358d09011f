"""Agreement of the points of a run with one slope, and with the bench file's expectations of this gyroscope.

Between neighbouring rates the output must move, and in one direction throughout. What leads that fall off or are
swapped leave behind in the middle of a run is refused here; what is wrong from the first reading to the last cannot be
known from the run, and is what `[expected]` is for.
"""

import math
import statistics
from collections.abc import Callable, Sequence
from itertools import pairwise, starmap

from vcfbench.errors import MeasurementError
from vcfbench.instructions.scale_factor import ROUGHLY
from vcfbench.records.schema import Point
from vcfbench.station.parts import Expected

_NOISES = 8.0
"""Allowance for noise, in standard uncertainties: readings are not independent (flicker)."""

SLOPES = (0.5, 1.5)
"""Limits of the slope between two neighbouring rates, relative to that of the whole."""

_ZEROS_APART = 2.0
"""Largest shift of the zero by the generator coming on at 0 V, in outputs of the matching rate."""

_DRIVEN = frozenset({2, 4, 6, 7})
"""Steps with the generator on: 2 and 4 and the zeros between, where the table is at rest."""


def require_same_zero(zero_table: Point, zero_virtual: Point, turning: Point) -> None:
    """Raise MeasurementError if the generator, coming on at 0 V, moves the zero by more than the match can bear."""
    span_v = abs(turning.output_v - zero_table.output_v)
    moved_v = zero_virtual.output_v - zero_table.output_v
    if abs(moved_v) > _ZEROS_APART * span_v:
        raise _disagreement(
            zero_virtual,
            f"the zero moved from {zero_table.output_v:+.6g} V to {zero_virtual.output_v:+.6g} V as the generator came "
            f"on at 0 V; the matching rate changes the output by {span_v:.3g} V",
            "V_Vc has an offset, or the lead of the output is off: check both",
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
    ordered = _distinct(points)
    if len(ordered) < 2:
        return
    slope = _slope(*reference) if reference else statistics.median(starmap(_slope, pairwise(ordered)))
    within_v = _noises_of(points)
    low, high = SLOPES
    for left, right in [(ordered[0], ordered[-1]), *pairwise(ordered)]:
        u_v = math.hypot(within_v(left), within_v(right))
        if limit_v is not None:
            u_v += abs(slope) * (limit_v(_x(left)) + limit_v(_x(right)))
        step = slope * (_x(right) - _x(left))
        moved_v = right.output_v - left.output_v
        if min(low * step, high * step) - u_v <= moved_v <= max(low * step, high * step) + u_v:
            continue
        whence = "the whole sweep"
        if reference:
            whence = "those before" if reference[0].step == right.step else f"step {reference[0].step}"
        raise _disagreement(
            right,
            f"from {_words(left)} to {_words(right)} the output moves by {moved_v:+.4g} V, "
            f"the slope of {whence} predicts {step:+.4g} V",
            "a lead is off or swapped, or a stage is saturated: check the leads of the output and of V_Vc",
        )


def _noises_of(points: Sequence[Point]) -> Callable[[Point], float]:
    """Return the allowance for noise, V, by the mean of a point; the readings of all tell what it is."""
    degrees = sum(point.n - 1 for point in points)
    noise_v = math.sqrt(math.fsum((point.n - 1) * point.std_v**2 for point in points) / max(1, degrees))
    return lambda point: _NOISES * noise_v / math.sqrt(point.n)


def _distinct(points: Sequence[Point]) -> list[Point]:
    """Return the last point of each setting, by rising settings."""
    return sorted({_asked(point): point for point in points}.values(), key=_asked)


def _asked(point: Point) -> float:
    return point.v_vc_v if point.step in _DRIVEN else point.rate_deg_s


def _x(point: Point) -> float:
    """Return the input of the output: V_Vc as measured if it was, else the setting."""
    measured_v = point.v_vc_measured_v
    return measured_v if point.step in _DRIVEN and measured_v is not None else _asked(point)


def _slope(left: Point, right: Point) -> float:
    return (right.output_v - left.output_v) / (_x(right) - _x(left))


def require_expected_column(points: Sequence[Point], expected: Expected) -> None:
    """Raise MeasurementError unless scale factor and bias on the table are those that the bench file expects.

    Points at one rate alone tell neither, and those at two that are near to each other as well as noise lets them.
    """
    ordered = _distinct(points)
    if len(ordered) < 2:
        return
    first, last, within_v = ordered[0], ordered[-1], _noises_of(points)
    scale_factor = _slope(first, last)
    by_noise = math.hypot(within_v(first), within_v(last)) / abs(_x(last) - _x(first))
    zero = min(ordered, key=lambda point: abs(point.rate_deg_s))
    bias_v = zero.output_v - scale_factor * zero.rate_deg_s
    _require("scale_factor_v_per_deg_s", expected.scale_factor_v_per_deg_s, scale_factor, points[-1].step, by_noise)
    _require("bias_v", expected.bias_v, bias_v, points[-1].step, within_v(zero) + by_noise * abs(zero.rate_deg_s))


def require_expected_slope(slope: float, expected: Expected, step: int) -> None:
    """Raise MeasurementError unless a slope on the table, V/(deg/s), is one that the bench file expects."""
    _require("scale_factor_v_per_deg_s", expected.scale_factor_v_per_deg_s, slope, step)


def require_expected_k_vc(k_vc: float, guess: float, expected: Expected) -> None:
    """Raise MeasurementError unless K_Vc, (deg/s)/V, has the guess's sign and rough size, or the expected value."""
    _require("k_vc_deg_s_per_v", expected.k_vc_deg_s_per_v, k_vc, 2)
    if expected.k_vc_deg_s_per_v is None and not 1.0 / ROUGHLY <= k_vc / guess <= ROUGHLY:
        raise MeasurementError(
            f"K_Vc is {k_vc:.5g} (deg/s)/V, the bench file guesses {guess:g}: its sign, or its size by more "
            f"than a factor of {ROUGHLY:g}, is another",
            instrument="multimeter",
            step="2",
            hint="check the leads of the output and of V_Vc; if right, correct procedure.k_vc_guess_deg_s_per_v",
        )


def _require(key: str, window: tuple[float, float] | None, value: float, step: int, by_noise: float = 0.0) -> None:
    if window is None or window[0] - by_noise <= value <= window[1] + by_noise:
        return
    names = {"scale_factor_v_per_deg_s": ("scale factor", "V/(deg/s)"), "bias_v": ("bias", "V")}
    what, unit = names.get(key, ("K_Vc", "(deg/s)/V"))
    raise MeasurementError(
        f"the {what} is {value:.6g} {unit}, the bench file expects {window[0]:g} to {window[1]:g} {unit} "
        f"(expected.{key})",
        instrument="multimeter",
        step=str(step),
        hint="check the leads, and whether this is the right gyroscope",
    )


def _words(point: Point) -> str:
    return f"V_Vc of {point.v_vc_v:+.6g} V" if point.step in _DRIVEN else f"{point.rate_deg_s:+g} deg/s"


def _disagreement(point: Point, what: str, hint: str) -> MeasurementError:
    return MeasurementError(what, instrument="multimeter", step=str(point.step), hint=hint)
