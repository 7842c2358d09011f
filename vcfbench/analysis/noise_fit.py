"""Noise coefficients Q, N, B, K, R of an Allan curve (IEEE 952 Annex C), with their uncertainties.

sigma^2(tau) = 3 Q^2/tau^2 + N^2/tau + (2 ln 2/pi) B^2 + K^2 tau/3 + R^2 tau^2/2 is linear in the squares, so these are
fitted by least squares, none below zero, each point weighted by its equivalent degrees of freedom under that noise.
Points of one curve come from one record: their covariances enter the stated uncertainties.

Under such noise the scatter of readings over the root of their number is too small for the u of a mean: flicker leaves
as much in the mean of an hour as in that of ten seconds (Witt and Reymann 2000). :func:`u_of_combination` has it.
"""

import math
from collections.abc import Callable, Iterable, Sequence
from functools import partial

import numpy as np
from msgspec import Struct, field, structs
from numpy.typing import ArrayLike

from vcfbench.analysis.allan import BIAS_INSTABILITY_FACTOR, AllanPoint, Sampling, Term, deviation_factor
from vcfbench.analysis.arrays import Floats
from vcfbench.analysis.model_fit import not_negative
from vcfbench.analysis.phase_noise import PhaseNoise, correlated_squares
from vcfbench.errors import ConfigError

_ROUNDS = 4
_CONFIDENCE = 0.95
_EXACTLY = 1e-6
"""Least relative scatter of a point that a fit counts with."""
_HARDLY = 1e-3
"""Relative growth of an uncertainty below which it counts as that of a normal distribution."""

_USUAL = (Term.ANGLE_RANDOM_WALK, Term.BIAS_INSTABILITY, Term.RATE_RANDOM_WALK, Term.RATE_RAMP)


class Coefficients(Struct, frozen=True):
    """Noise coefficients of the whole curve; unit of the record (deg/s) and seconds.

    Q, deg, negative where its square is: a filter takes from short averages; N, deg/sqrt(s), 60 times that is
    deg/sqrt(h); B, deg/s, 3600 times that is deg/h; K, (deg/s)/sqrt(s); R, deg/s^2.
    """

    quantisation: float = 0.0
    angle_random_walk: float = 0.0
    bias_instability: float = 0.0
    rate_random_walk: float = 0.0
    rate_ramp: float = 0.0

    def squares(self) -> Floats:
        """Return Q^2, N^2, B^2, K^2, R^2."""
        values = np.array(structs.astuple(self))
        return np.asarray(values * np.abs(values))

    def variance(self, tau_s: ArrayLike) -> Floats:
        """Return sigma^2(tau) of a gapless record."""
        return np.asarray(_columns(np.asarray(tau_s, dtype=np.float64)) @ self.squares())

    def phase_noise(self, sampling: Sampling) -> PhaseNoise:
        """Return the noise of a record so sampled, time in samples; noise folded in by dead time counts as white."""
        white = (
            deviation_factor(sampling, Term.ANGLE_RANDOM_WALK) ** 2 * self.angle_random_walk**2 / sampling.interval_s
        )
        folded = deviation_factor(sampling, Term.BIAS_INSTABILITY) ** 2 - 1.0
        white += folded * (BIAS_INSTABILITY_FACTOR * self.bias_instability) ** 2
        # No process has less in neighbouring readings than a mean over both
        quantisation = max(self.quantisation / sampling.interval_s, -0.5 * math.sqrt(white))
        if not sampling.gapless:
            white += 2.0 * max(0.0, self.quantisation / sampling.aperture_s) ** 2
            quantisation = 0.0
        return PhaseNoise(
            quantisation=quantisation,
            white=math.sqrt(white),
            flicker=self.bias_instability,
            random_walk=self.rate_random_walk * math.sqrt(sampling.interval_s),
        )


class NoiseTerm(Struct, frozen=True):
    """One fitted coefficient, of the gapless noise."""

    value: float
    u: float | None
    """Standard uncertainty; None where the coefficient is 0, because its square is the estimate."""
    upper_95: float
    """With 95 % the true one is not above that."""
    u_square_if_0: float
    """Standard uncertainty of its square if that were 0."""


class NoiseFit(Struct, frozen=True):
    """The coefficients that describe a curve; those that were not asked for are 0. By default they are known."""

    coefficients: Coefficients
    terms: dict[Term, NoiseTerm] = {}
    covariance_of_squares: Floats = field(default_factory=lambda: np.zeros((len(Term), len(Term))))
    """Covariance of Q^2, N^2, B^2, K^2, R^2, in that order; rows of terms that were not fitted are 0."""

    def variance(self, sampling: Sampling, factor: int) -> tuple[float, float]:
        """Return the Allan variance of a record so sampled at `factor` intervals, and its degrees of freedom."""
        (column,) = design_of([factor], sampling)
        return self.combined(column)

    def combined(self, shares: Floats) -> tuple[float, float]:
        """Return ``shares @ (Q^2, N^2, B^2, K^2, R^2)`` and the degrees of freedom that its uncertainty is worth."""
        value = float(shares @ self.coefficients.squares())
        variance = float(shares @ self.covariance_of_squares @ shares)
        return value, 2.0 * value**2 / variance if variance > 0.0 else math.inf


def fit_noise(
    curve: Sequence[AllanPoint], samples: int, sampling: Sampling, terms: Iterable[Term] = _USUAL
) -> NoiseFit:
    """Fit the terms to an overlapping Allan curve of a record of `samples` readings.

    Dead time is corrected: the coefficients are those of the instrument, not of the record. Terms that cannot be told
    apart (quantisation and angle random walk of a record with dead time) share what they explain arbitrarily.

    Raises:
        ConfigError: fewer points than terms, a point that is no multiple of the interval, or a record without noise.
    """
    chosen = [term for term in Term if term in set(terms)]
    factors = [round(point.tau_s / sampling.interval_s) for point in curve]
    if not chosen or len(curve) < len(chosen):
        raise ConfigError(f"{len(curve)} points of an Allan curve do not determine {len(chosen)} terms")
    for point, factor in zip(curve, factors, strict=True):
        if factor < 1 or abs(factor * sampling.interval_s - point.tau_s) > 1e-6 * point.tau_s:
            raise ConfigError(f"{point.tau_s:g} s is not a multiple of the interval of {sampling.interval_s:g} s")
        if point.deviation <= 0.0:
            raise ConfigError(f"the Allan deviation at {point.tau_s:g} s is 0: the record has no noise to fit")
    places = [list(Term).index(term) for term in chosen]
    design = design_of(factors, sampling)[:, places]
    variance = np.array([point.deviation**2 for point in curve])
    squares = _weighted(design, variance, 1.0 / variance**2)
    for _ in range(_ROUNDS):
        found = _coefficients(squares, places)
        spread = np.array([_covariance(found, sampling, samples, m, m) for m in factors])
        spread = np.maximum(spread, (_EXACTLY * (design @ squares)) ** 2)  # a ramp alone has none
        squares = _weighted(design, variance, 1.0 / spread)

    # Carry the covariances of the points through the least-squares sums. Terms that came out as 0 take no part in the
    # uncertainty of the others; that of each of them is what it would have beside the others alone
    def covariance(law: Coefficients, among: list[int]) -> Floats:
        of_points = partial(_covariance, law, sampling, samples)
        return _covariance_of_squares(design[:, among], 1.0 / spread, of_points, factors)

    free, found = np.flatnonzero(squares > 0.0).tolist(), _coefficients(squares, places)
    part = np.zeros((len(places), len(places)))
    part[np.ix_(free, free)] = covariance(found, free)
    fitted = {}
    for row, place in enumerate(places):
        beside = free if row in free else [*free, row]
        if row not in free:
            part[row, row] = covariance(found, beside)[-1, -1]
        value, u_square = math.sqrt(squares[row]), math.sqrt(float(part[row, row]))
        without = squares.copy()
        without[row] = 0.0
        at_0 = covariance(_coefficients(without, places), beside)[beside.index(row), beside.index(row)]
        u_at_0 = min(math.sqrt(max(0.0, at_0)), u_square)
        u = u_square / (2.0 * value) if value > 0.0 else None
        upper = math.sqrt(upper_square(squares[row], u_square, u_at_0))
        fitted[list(Term)[place]] = NoiseTerm(value, u, upper, u_at_0)
    whole = np.zeros((len(Term), len(Term)))
    whole[np.ix_(places, places)] = part
    return NoiseFit(found, fitted, whole)


def _weighted(design: Floats, variance: Floats, weight: Floats) -> Floats:
    """Return the non-negative least-squares solution."""
    root = np.sqrt(weight)
    rows = design * root[:, None]
    size = np.linalg.norm(rows, axis=0)
    return np.asarray(not_negative(rows / size, variance * root) / size)


def _coefficients(squares: Floats, places: list[int]) -> Coefficients:
    every = np.zeros(len(Term))
    every[places] = np.sqrt(squares)
    return Coefficients(*every.tolist())


def _covariance_of_squares(
    design: Floats, weight: Floats, of_points: Callable[[int, int], float], factors: Sequence[int]
) -> Floats:
    """Return the covariance of squares that are fitted with these weights, by those of all points of the curve."""
    whole = np.empty((len(factors), len(factors)))
    for i, first in enumerate(factors):
        for j, second in enumerate(factors[: i + 1]):
            whole[i, j] = whole[j, i] = of_points(first, second)
    root = np.sqrt(weight)
    gain = np.linalg.pinv(design * root[:, None]) * root
    return np.asarray(gain @ whole @ gain.T)


def upper_square(square: float, u: float, u_at_0: float) -> float:
    """Return the square that is so large that with 95 % more than `square` would have been found.

    What is found of a square is a chi-square's multiple less the others' share: its uncertainty grows with it, from
    `u_at_0` to `u` here. A bound by `u` alone is too low where chance has made both small.
    """
    from scipy.special import chdtri, ndtri  # noqa: PLC0415 - SciPy costs more to import than all the rest

    grows = (u - u_at_0) / square if square > 0.0 else 0.0
    if grows < _HARDLY:
        return square + float(ndtri(_CONFIDENCE)) * u
    others, dof = u_at_0 / grows, 2.0 / grows**2
    least = float(chdtri(dof, _CONFIDENCE))
    return (square + others) * dof / least - others if least > 0.0 else square + float(ndtri(_CONFIDENCE)) * u


def _covariance(noise: Coefficients, sampling: Sampling, samples: int, first: int, second: int) -> float:
    """Return the covariance of the estimated Allan variances at two factors; a ramp shifts the differences."""
    law = noise.phase_noise(sampling)
    squares = correlated_squares(law, samples + 1 - 2 * first, first, samples + 1 - 2 * second, second)
    ramp = (noise.rate_ramp * sampling.interval_s) ** 2 * float(first) ** 2 * float(second) ** 2
    total = squares.covariance + 4.0 * ramp * squares.covariance_of_means
    return total / (4.0 * float(first) ** 2 * float(second) ** 2)


def design_of(factors: Sequence[int], sampling: Sampling) -> Floats:
    """Return the addition of each squared coefficient to the Allan variance of the record, one row a factor."""
    columns = _columns(np.array(factors, dtype=np.float64) * sampling.interval_s)
    return np.asarray(columns * [[deviation_factor(sampling, term, each) ** 2 for term in Term] for each in factors])


def _columns(tau_s: Floats) -> Floats:
    tau = np.atleast_1d(tau_s)
    flat = np.full_like(tau, BIAS_INSTABILITY_FACTOR**2)
    return np.column_stack([3.0 / tau**2, 1.0 / tau, flat, tau / 3.0, tau**2 / 2.0])


class TypeAUncertainty(Struct, frozen=True):
    """A standard uncertainty in the unit of the record, and its effective degrees of freedom."""

    u: float
    dof: float


def u_of_combination(
    fit: NoiseFit, sampling: Sampling, begin_s: ArrayLike, end_s: ArrayLike, weights: ArrayLike
) -> TypeAUncertainty:
    """Return the uncertainty of ``sum weights * mean``, each mean over `begin_s` to `end_s`, correlations included.

    The weights must add up to 0: a slope, a difference, a mean less its zeros. Then slow noise has a finite share. The
    order of the windows counts: a drift goes into a slope of rising rates and not into one of alternating signs.

    Raises:
        ConfigError: the weights do not add up to 0, or a window does not last.
    """
    begin, end, weight = (np.asarray(values, dtype=np.float64) for values in (begin_s, end_s, weights))
    if begin.ndim != 1 or not begin.shape == end.shape == weight.shape or not (end > begin).all():
        raise ConfigError("windows need a begin, a later end and a weight each")
    if abs(float(weight.sum())) > 1e-9 * float(np.abs(weight).sum()):
        raise ConfigError(f"expected weights that add up to 0 (slow noise has no mean), got {float(weight.sum()):g}")
    times = np.concatenate([end, begin]) / sampling.interval_s
    shares = np.concatenate([weight, -weight]) / np.tile((end - begin) / sampling.interval_s, 2)
    # What a coefficient of 1 contributes; the ramp is no noise but a line of slope 1, with phases of t^2 / 2
    squares = []
    for name in Coefficients.__struct_fields__[:-1]:
        unit = Coefficients(**{name: 1.0}).phase_noise(sampling)
        squares.append(float(shares @ unit.among(times) @ shares))
    squares.append(float(shares @ ((times[0] - times) ** 2 / 2.0)) ** 2 * sampling.interval_s**2)
    variance, dof = fit.combined(np.array(squares))
    return TypeAUncertainty(math.sqrt(variance), dof)
