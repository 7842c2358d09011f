"""Non-linearity by every definition in use; each result is named, since they differ by a factor of ten.

All are relative to the span or to the one-sided full scale, in ppm. `None` stands where the points do not allow the
definition: no two rates on one side of zero, no rate of 10 deg/s or more, a slope that rounds to nothing.
"""

import numpy as np
from numpy.typing import ArrayLike

from vcfbench.analysis.arrays import Floats
from vcfbench.analysis.regression import LineFit, checked_points, slope

READING_FLOOR_DEG_S = 10.0
"""The least rate that counts for `reading`, deg/s."""
_OFF = 0.1
"""Part by which it may be missed: a V_Vc of so many digits, or as it was measured, stands for 9.9996 deg/s or 10.0003.
"""

PAPER_DECIMALS = 5
"""The paper prints its slopes and intercepts with five decimals, and takes its residuals from them."""

DEFINITIONS: dict[str, str] = {
    "max_span": "max |residual| / output span",
    "max_span_rounded": "same, line rounded to 5 decimals",
    "max_fs": "max |residual| / full scale",
    "max_out": "max |residual| / max |output|",
    "rms_fs": "rms residual / full scale",
    "sd_fs": "residual std (n - 2) / full scale",
    "pp_fs": "residual band / full scale",
    "bsl_fs": "half minimax band / full scale",
    "endpoint_span": "max off end-point chord / span",
    "reading": "max |residual| / reading",
    "asym": "slope change at 0, own intercepts",
    "asym_common": "slope change at 0, one intercept",
}
"""Meaning of each id, in the order of reports; full scale is one-sided: |slope| times the largest rate."""


def nonlinearity_ppm(rate_deg_s: ArrayLike, output_v: ArrayLike, fit: LineFit) -> dict[str, float | None]:
    """Return every definition by its id, ppm, in the order of :data:`DEFINITIONS`."""
    rate, output = checked_points(rate_deg_s, output_v)
    residuals = fit.residuals_v
    gain = abs(fit.scale_factor)
    largest = float(np.abs(residuals).max())
    full_scale = gain * float(np.abs(rate).max())
    counted = np.abs(rate) >= (1.0 - _OFF) * READING_FLOOR_DEG_S
    reading = float((np.abs(residuals[counted]) / np.abs(rate[counted])).max()) if counted.any() else None
    rounded = round(fit.scale_factor, PAPER_DECIMALS)
    rounded_v = float(np.abs(output - rounded * rate - round(fit.bias, PAPER_DECIMALS)).max())
    sides = rate >= 0.0, rate <= 0.0  # the zero belongs to both
    two = all(len(set(rate[side].tolist())) > 1 for side in sides)
    own = [slope(rate[side], output[side]) for side in sides] if two else None
    kinked = np.column_stack([np.maximum(rate, 0.0), np.minimum(rate, 0.0), np.ones_like(rate)])
    found, _, rank, _ = np.linalg.lstsq(kinked, output, rcond=None)
    common = found[:2].tolist() if rank == 3 else None
    first, last = float(rate.min()), float(rate.max())
    begin, end = (float(output[rate == each].mean()) for each in (first, last))  # an end may be measured twice
    span = last - first
    chord = (end - begin) / span
    chord_v = float(np.abs(output - begin - chord * (rate - first)).max())
    best_gain, _, half_band = best_straight_line(rate, output)
    ratios: dict[str, tuple[float | None, float | None]] = {
        "max_span": (largest, gain * float(np.ptp(rate))),
        "max_span_rounded": (rounded_v, abs(rounded) * float(np.ptp(rate))),
        "max_fs": (largest, full_scale),
        "max_out": (largest, float(np.abs(output).max())),
        "rms_fs": (float(np.sqrt(np.mean(residuals**2))), full_scale),
        "sd_fs": (fit.s_v, full_scale),
        "pp_fs": (float(np.ptp(residuals)), full_scale),
        "bsl_fs": (half_band, abs(best_gain) * float(np.abs(rate).max())),
        "endpoint_span": (chord_v, abs(chord) * span),
        "reading": (reading, gain),
        "asym": _asymmetry(own),
        "asym_common": _asymmetry(common),
    }
    return {name: None if part is None or not whole else 1e6 * part / whole for name, (part, whole) in ratios.items()}


def best_straight_line(rate_deg_s: ArrayLike, output_v: ArrayLike) -> tuple[float, float, float]:
    """Return slope, intercept and half band of the line with the smallest largest residual.

    The width of the band around the points is a convex, piecewise linear function of the slope whose corners are the
    slopes of the edges of the points' convex hull, so the least width is found exactly, at one of them.
    """
    rate, output = checked_points(rate_deg_s, output_v)
    lower, upper = _lower_hull(rate, output), _lower_hull(rate, -output)
    edges = np.concatenate([_slopes(lower), -_slopes(upper)])
    widths = -_least_offset(upper, -edges) - _least_offset(lower, edges)
    gain = float(edges[widths.argmin()])
    offsets = output - gain * rate
    return gain, float(offsets.max() + offsets.min()) / 2.0, float(np.ptp(offsets)) / 2.0


def _lower_hull(rate: Floats, output: Floats) -> Floats:
    """Return the corners of the lower convex hull, rate and output a row, by Andrew's monotone chain."""
    order = np.lexsort((output, rate))
    hull: list[tuple[float, float]] = []
    for x, y in zip(rate[order].tolist(), output[order].tolist(), strict=True):
        if hull and x == hull[-1][0]:
            continue  # an inner point of the same rate
        while len(hull) > 1:
            (ax, ay), (bx, by) = hull[-2:]
            if (bx - ax) * (y - ay) - (by - ay) * (x - ax) > 0.0:
                break
            hull.pop()
        hull.append((x, y))
    return np.array(hull)


def _slopes(hull: Floats) -> Floats:
    return np.asarray(np.diff(hull[:, 1]) / np.diff(hull[:, 0]))


def _least_offset(hull: Floats, slope: Floats) -> Floats:
    """Return the least output - slope * rate, at the corner where the lower hull turns past each slope."""
    corner = hull[np.searchsorted(_slopes(hull), slope)]
    return np.asarray(corner[:, 1] - slope * corner[:, 0])


def _asymmetry(slopes: list[float] | None) -> tuple[float | None, float | None]:
    if slopes is None:
        return None, None
    positive, negative = map(abs, slopes)
    return positive - negative, (positive + negative) / 2.0
