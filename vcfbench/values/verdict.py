"""Agreement of results with each other and with a limit: E_n (ISO 13528) and guard bands (JCGM 106, ILAC-G8)."""

import math
from typing import Literal

from vcfbench.errors import ConfigError


def e_n(first: float, expanded_u_first: float, second: float, expanded_u_second: float) -> float:
    """Return |second - first| over the root of the sum of the squared expanded uncertainties; above 1 they disagree.

    Only for independent results: the difference of those that share instruments is a result of their budget.

    Raises:
        ConfigError: neither has an uncertainty.
    """
    difference, expanded_u = second - first, math.hypot(expanded_u_first, expanded_u_second)
    if not (expanded_u > 0.0 and math.isfinite(expanded_u) and math.isfinite(difference)):
        raise ConfigError(f"E_n of a difference of {difference:g} needs a positive uncertainty, got {expanded_u:g}")
    return abs(difference) / expanded_u


def conformity(value: float, expanded_u: float, low: float, high: float) -> Literal["pass", "marginal", "fail"]:
    """Judge a value against limits with its expanded uncertainty as guard band.

    What is nearer to a limit than that, on either side of it, is marginal. With 95 % a value passes that conforms with
    at least 97.5 %; with 0 the uncertainty is ignored (simple acceptance), and nothing is marginal.

    Raises:
        ConfigError: a lower limit above the upper one, or an uncertainty that is negative or not finite.
    """
    if not low <= high or not 0.0 <= expanded_u < math.inf:
        raise ConfigError(f"no verdict with limits {low:g} to {high:g} and U {expanded_u:g}")
    if not math.isfinite(value):
        raise ConfigError(f"no verdict on {value}")
    if value < low - expanded_u or value > high + expanded_u:
        return "fail"
    return "pass" if low + expanded_u <= value <= high - expanded_u else "marginal"
