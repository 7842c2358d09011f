"""Probabilities of a value: Student's t and Fisher's F, exact, without heavy imports."""

import math
from statistics import NormalDist

from vcfbench.errors import ConfigError

_TINY = 1e-300
_ENOUGH = 1e-14
_CLEARLY = 1e-6
"""By how much logarithms of two probabilities differ beyond their rounding."""
_MOST_TERMS = 10_000
_MANY_DEGREES = 1000.0
"""From here on the series in 1/degrees is exact to 1e-13, while the difference of two logarithms of gamma is not."""


def t_tail(t: float, degrees: float) -> float:
    """Return the probability that ``|T| > |t|`` for Student's t with `degrees` of freedom."""
    return _incomplete_beta(0.5 * degrees, 0.5, degrees / (degrees + t * t))


def t_quantile(tail: float, degrees: float) -> float:
    """Return the t that ``|T|`` exceeds with probability `tail`, for Student's t with `degrees` of freedom.

    By Newton's method. The tail bends one way for t > 0, so from the left it comes nearer with every step. With many
    degrees of freedom, or infinitely many, from the normal distribution (Abramowitz and Stegun 26.7.5).

    Raises:
        ConfigError: `degrees` is below 0.01, where t is beyond 1e127.
    """
    if degrees < 0.01:
        raise ConfigError(f"expected at least 0.01 degrees of freedom, got {degrees:g}")
    if degrees > _MANY_DEGREES:
        x = -NormalDist().inv_cdf(0.5 * tail)
        terms = (
            (x**3 + x) / 4.0,
            (5.0 * x**5 + 16.0 * x**3 + 3.0 * x) / 96.0,
            (3.0 * x**7 + 19.0 * x**5 + 17.0 * x**3 - 15.0 * x) / 384.0,
            (79.0 * x**9 + 776.0 * x**7 + 1482.0 * x**5 - 1920.0 * x**3 - 945.0 * x) / 92160.0,
        )
        most = min(degrees, 1e60)  # whose fourth power is a float
        return x + math.fsum(term / most**power for power, term in enumerate(terms, start=1))
    log_height = math.lgamma(0.5 * (degrees + 1.0)) - math.lgamma(0.5 * degrees) - 0.5 * math.log(math.pi * degrees)
    t = 0.0
    step = math.inf
    while step > _ENOUGH * t:  # a step back is round-off
        density = 2.0 * math.exp(log_height - 0.5 * (degrees + 1.0) * math.log1p(t * t / degrees))
        step = (t_tail(t, degrees) - tail) / density
        t += step
    return t


def t_of_largest(number: int, degrees: float) -> float:
    """Return the 95 % limit of the largest of `number` ``|T|``, independent (Sidak) or dependent."""
    return t_quantile(1.0 - 0.95 ** (1.0 / number), degrees)


def chi_square_tail(chi_square: float, degrees: int) -> float:
    """Return the probability that chi-square exceeds `chi_square`: a finite sum (Abramowitz and Stegun 26.4.4, .5)."""
    half = 0.5 * chi_square
    if half <= 0.0:
        return 1.0
    first, odd = (math.erfc(math.sqrt(half)), 0.5) if degrees % 2 else (0.0, 0.0)
    powers = (odd + n for n in range((degrees + (0 if odd else 1)) // 2))
    return first + math.fsum(math.exp(power * math.log(half) - half - math.lgamma(power + 1.0)) for power in powers)


def f_tail(ratio: float, degrees: float, degrees_below: float) -> float:
    """Return the probability that F exceeds `ratio`: two variances of `degrees` and, below, `degrees_below`."""
    if ratio <= 0.0:
        return 1.0
    if math.isinf(ratio):
        return 0.0
    return _incomplete_beta(0.5 * degrees_below, 0.5 * degrees, degrees_below / (degrees_below + degrees * ratio))


def f_is_improbable(ratio: float, degrees: float, degrees_below: float, *, chance: float) -> bool:
    """Return True if F exceeds `ratio`, as of :func:`f_tail`, with a probability below `chance` (> 0).

    The first term of a series of positive terms (Abramowitz and Stegun 26.5.4) is the least that the probability is:
    it settles what is nowhere near `chance`.
    """
    if 0.0 < ratio < math.inf:
        a, b = 0.5 * degrees_below, 0.5 * degrees
        x = degrees_below / (degrees_below + degrees * ratio)
        if 0.0 < x < 1.0 and _log_front(a, b, x) - math.log(a) > math.log(chance) + _CLEARLY:
            return False
    return f_tail(ratio, degrees, degrees_below) < chance


def _log_front(a: float, b: float, x: float) -> float:
    """Return the logarithm of x^a (1 - x)^b / B(a, b)."""
    return math.lgamma(a + b) - math.lgamma(a) - math.lgamma(b) + a * math.log(x) + b * math.log1p(-x)


def _incomplete_beta(a: float, b: float, x: float) -> float:
    """Return the regularised incomplete beta function I_x(a, b) (Abramowitz and Stegun 26.5.8)."""
    if x <= 0.0 or x >= 1.0:
        return min(1.0, max(0.0, x))
    log_front = _log_front(a, b, x)
    if x > (a + 1.0) / (a + b + 2.0):  # there the fraction of the complement converges
        return 1.0 - math.exp(log_front) * _fraction(b, a, 1.0 - x) / b
    return math.exp(log_front) * _fraction(a, b, x) / a


def _fraction(a: float, b: float, x: float) -> float:
    """Return the continued fraction of the incomplete beta function by Lentz's method; no divisor is left at zero."""
    under = 1.0 - (a + b) * x / (a + 1.0)
    c, d = 1.0, 1.0 / (under if abs(under) > _TINY else _TINY)
    value = d
    for m in range(1, _MOST_TERMS):
        for term in (
            m * (b - m) * x / ((a + 2 * m - 1) * (a + 2 * m)),
            -(a + m) * (a + b + m) * x / ((a + 2 * m) * (a + 2 * m + 1)),
        ):
            # not by a function of its own: this is gone through thousands of times a budget
            under = 1.0 + term * d
            d = 1.0 / (under if abs(under) > _TINY else _TINY)
            c = 1.0 + term / c
            c = c if abs(c) > _TINY else _TINY
            value *= c * d
        if abs(c * d - 1.0) < _ENOUGH:
            break
    return value
