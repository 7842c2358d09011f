"""The line through the points of a calibration that is still being measured."""

from __future__ import annotations

from collections.abc import Sequence

from vcfbench.analysis.regression import LineFit, fit_line
from vcfbench.errors import ConfigError

_LEAST_RATES = 3
"""Through two rates every line goes: its residuals say nothing."""


def line_so_far(rate_deg_s: Sequence[float], output_v: Sequence[float]) -> LineFit | None:
    """Return the least-squares line through the points so far, with their residuals; None while there is none.

    Args:
        rate_deg_s: rates of the points of one calibration, in the order in which they were measured.
        output_v: their outputs.
    """
    if len(set(rate_deg_s)) < _LEAST_RATES:
        return None
    try:
        return fit_line(rate_deg_s, output_v)
    except ConfigError:  # values that are no measurement: the results will say so
        return None
