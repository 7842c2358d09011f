"""The model of a record's noise: the averaging times that powers of the time describe, and N, B, K, R from them.

One generalised least squares with the full covariance of the points of an Allan curve. The term in 1/tau^2 may have
either sign: behind a filter that a record's readings have in common, or where they are held, the variance is exactly
N^2/tau - 1.5 N^2 mu/tau^2 beyond the filter's memory, mu its mean square lag. The start is the first from which the
next two octaves agree with the fit of all, and an octave of margin, since what is not yet refuted need not hold. A
chi-square of the residuals, and of their cube roots, which sees points that are too low, says whether the fit holds.
Where it does not, N is that of the piece that it describes, and of B, K and R only bounds are known, as every other
noise adds.
"""

import math
from collections.abc import Sequence
from typing import Final

import numpy as np
from msgspec import Struct

from vcfbench.analysis.allan import AllanPoint, Sampling, Term
from vcfbench.analysis.arrays import Floats
from vcfbench.analysis.model_fit import not_negative
from vcfbench.analysis.noise_fit import Coefficients, NoiseFit, NoiseTerm, design_of, upper_square
from vcfbench.analysis.phase_noise import sums_of_lags

_P_START: Final = 0.1
_NEXT: Final = 4
"""Points that must agree with a start: two octaves."""
_MARGIN: Final = 2
_TAKEN: Final = 0.5
"""Part of the white noise that a filter may take from the shortest averages that are fitted.

More is within its memory, where the variance is no sum of powers yet: a mean of M takes 1/2 at M, where it ends; a
filter of the first order takes 1/2 at three time constants. A short record does not see that its fit is wrong there.
"""
_LEAST: Final = 8
_SHORTER: Final = 2
"""Points by which a curve is shortened that powers of the time describe from no start on."""
_LEAST_OF_PIECE: Final = 7
_SHOWN: Final = 3.0
"""A term is stated where its square is so many of the uncertainties that it would have if it were 0."""
_P_FIT: Final = 0.01
_P_PIECE: Final = 0.05
_FLOOR: Final = 0.01
"""Part of the variance to which no record follows powers of the time better (ours)."""
_EXACTLY: Final = 1e-6
_ROUNDS: Final = 6
_AT_REST: Final = 1e-4
_ONE_SIDED: Final = 1.645
_Q, _N, _B, _K, _R = range(5)


class NoiseModel(Struct, frozen=True):
    """Model of a record's noise from its curve.

    `fit` has the law of all noise in its coefficients, for budgets, with K and R only where they stand out; in its
    terms what can be stated. `begin` and `end` are the points of the curve of which N is stated.
    """

    fit: NoiseFit
    begin: int
    end: int
    started: bool
    """False: powers of the time describe the curve from no averaging time on."""
    described: bool
    """False: B, K and R have bounds alone, and so has N where there is no piece that the fit describes."""
    chi_square: float
    dof: int
    p: float
    white_alone: float
    """Probability of the curve, or of a higher one, with no slow noise in it."""


class _Fitted(Struct, frozen=True):
    """Squares of all five terms, in samples, those of `columns` fitted: none below 0 but the first, and without bounds.

    `covariance` is that of the unbounded ones, in the order of `columns`; `of_points` that of the curve.
    """

    columns: list[int]
    bounded: Floats
    signed: Floats
    covariance: Floats
    of_points: Floats

    def u(self, term: int) -> float:
        place = self.columns.index(term)
        return math.sqrt(max(0.0, float(self.covariance[place, place])))


class _Curve(Struct, frozen=True):
    """Variances of a curve over their median, what a square of each term adds, and sums over lags for covariances."""

    variance: Floats
    design: Floats
    phase: Floats
    """From the squares of the terms to those of the laws of the phase, (4, 5)."""
    of_means: Floats
    """(n, n, 4)"""
    of_products: Floats
    """(n, n, 4, 4)"""
    high: Floats
    """Upper bounds of the variances, 97.5 %."""

    def covariance(self, squares: Floats) -> Floats:
        """Return the covariance of the points under a law that is one of a real process, floor included."""
        law = np.maximum(squares, 0.0)
        law[_Q] = max(squares[_Q], -0.25 * law[_N])
        phases = self.phase @ law
        whole = np.einsum("abij,i,j->ab", self.of_products, phases, phases) + law[_R] * (self.of_means @ phases)
        fitted, ramp = self.design @ law, self.design[:, _R] * law[_R]
        return np.asarray(whole + np.diag((_FLOOR * (fitted - ramp) + _EXACTLY * self.variance) ** 2))

    def fit(self, begin: int, end: int, columns: list[int]) -> _Fitted:
        """Fit terms to some points, the weights by the law that is found."""
        here, v = self.design[begin:end, columns], self.variance[begin:end]
        root, squares = np.diag(v), np.zeros(5)
        size = np.linalg.norm(here / v[:, None], axis=0)
        for _ in range(_ROUNDS):
            rows, values = np.linalg.solve(root, here / size), np.linalg.solve(root, v)
            split = np.column_stack([rows, -rows[:, 0]]) if columns[0] == _Q else rows
            found = not_negative(np.asarray(split, np.float64), np.asarray(values, np.float64))
            before = self.design[begin:end] @ squares
            squares = np.zeros(5)
            squares[columns] = found[: len(columns)] / size
            if columns[0] == _Q:
                squares[_Q] -= found[-1] / size[0]
            of_points = self.covariance(squares)[begin:end, begin:end]
            root = np.asarray(np.linalg.cholesky(of_points), np.float64)
            after = self.design[begin:end] @ squares
            if (np.abs(after - before) <= _AT_REST * np.abs(after)).all():
                break
        rows, values = np.linalg.solve(root, here / size), np.linalg.solve(root, v)
        signed = np.zeros(5)
        signed[columns] = np.linalg.lstsq(rows, values, rcond=None)[0] / size
        return _Fitted(columns, squares, signed, self.covariance_of(begin, end, columns, squares), of_points)

    def covariance_of(self, begin: int, end: int, columns: list[int], law: Floats) -> Floats:
        """Return the covariance of fitted squares under a law."""
        here = self.design[begin:end, columns]
        rows = np.linalg.solve(np.linalg.cholesky(self.covariance(law)[begin:end, begin:end]), here)
        size = np.linalg.norm(rows, axis=0)
        rows = rows / size
        return np.asarray(np.linalg.pinv(rows.T @ rows, hermitian=True) / np.outer(size, size))

    def chi_square(self, begin: int, end: int, columns: list[int], of_points: Floats) -> float:
        """Return that of the best fit without bounds, the covariance of the points given."""
        root = np.linalg.cholesky(of_points)
        rows, values = (
            np.linalg.solve(root, self.design[begin:end, columns]),
            np.linalg.solve(root, self.variance[begin:end]),
        )
        rows /= np.linalg.norm(rows, axis=0)
        left = values - rows @ np.linalg.lstsq(rows, values, rcond=None)[0]
        return float(left @ left)

    def p(self, begin: int, end: int, fitted: _Fitted) -> tuple[float, int, float]:
        """Return chi-square, degrees of freedom and probability of a fit, by residuals or their cube roots."""
        dof, v = end - begin - len(fitted.columns), self.variance[begin:end]
        plain = self.chi_square(begin, end, fitted.columns, fitted.of_points)
        f, spread = self.design[begin:end] @ fitted.bounded, np.diag(fitted.of_points)
        if not (f > 0.0).all():
            return plain, dof, 0.0
        share = spread / (9.0 * f**2)  # 2/(9 e) of Wilson and Hilferty, e the degrees of freedom of a point
        z = (np.cbrt(v / f) - (1.0 - share)) / np.sqrt(share)
        cubic = float(z @ np.linalg.solve(fitted.of_points / np.sqrt(np.outer(spread, spread)), z))
        largest = max(plain, cubic)
        return largest, dof, _beyond(largest, dof)


def noise_model(curve: Sequence[AllanPoint], samples: int, sampling: Sampling) -> NoiseModel:
    """Return the model of the noise of `samples` readings from their Allan curve; no deviation may be 0.

    With dead time there is no term in 1/tau^2, as readings share nothing; its effect on the others is taken out.
    """
    points, scale = _curve_of(curve, samples, sampling)
    every = [_N, _B, _K, _R] if not sampling.gapless else [_Q, _N, _B, _K, _R]
    size = len(curve)
    margin, whole = _MARGIN if sampling.gapless else 0, size
    found = _start(points, whole, every, margin)
    while found is None and whole > _LEAST + margin:  # from the long end on, where what drifts is largest
        whole -= _SHORTER
        found = _start(points, whole, every, margin)
    started, begin = found is not None, found or 0
    wide = every[:-1]
    if size - begin > len(every):
        fitted = points.fit(begin, size, every)
        if min(fitted.signed[_R], fitted.bounded[_R]) >= _SHOWN * _u_if_0(points, begin, size, fitted, _R) > 0.0:
            wide = every
    fitted = points.fit(begin, size, wide)
    chi_square, dof, p = points.p(begin, size, fitted) if started else (0.0, 0, 0.0)
    described, end = whole == size and started and p >= _P_FIT, size
    if started and not described:
        end = _piece(points, begin, whole, wide)
    limits = _envelope(points, begin if started else 0)
    terms = _terms(points, begin, end, wide, limits) if end > begin and started else {}
    if not described:
        terms = {term: each for term, each in terms.items() if term is Term.ANGLE_RANDOM_WALK}
        for term, limit in zip(Term, limits, strict=True):
            if term is not Term.QUANTISATION and term not in terms:
                terms[term] = NoiseTerm(0.0, None, math.sqrt(limit), 0.0)
    law = points.fit(begin, size, [at for at in every if at < _K])
    if points.p(begin, size, law)[2] < _P_PIECE or _R in wide:  # else flicker is enough, and B is not below the truth
        shown = [at for at in (_K, _R) if at in wide and _stands_out(points, begin, size, fitted, at)]
        law = points.fit(begin, size, [*law.columns, *shown])
    white = points.p(begin, size, points.fit(begin, size, [at for at in every if at < _B]))[2]
    fit = _in_seconds(law, _whole_covariance(points, begin, size, law), terms, scale, sampling.interval_s)
    return NoiseModel(fit, begin, end, started, described, chi_square, dof, p, white)


def _curve_of(curve: Sequence[AllanPoint], samples: int, sampling: Sampling) -> tuple[_Curve, float]:
    """Return the curve in samples, over its median variance, and that."""
    band = sampling.noise_bandwidth_hz
    each = Sampling(1.0, sampling.aperture_s / sampling.interval_s, band and band * sampling.interval_s)
    factors = [round(point.tau_s / sampling.interval_s) for point in curve]
    size = len(factors)
    of_means, of_products = np.empty((size, size, 4)), np.empty((size, size, 4, 4))
    for i, first in enumerate(factors):
        for j, second in enumerate(factors[: i + 1]):
            terms = float(samples + 1 - 2 * first), float(samples + 1 - 2 * second)
            _, means, products = sums_of_lags(int(terms[0]), first, int(terms[1]), second)
            whole = terms[0] * terms[1]
            of_means[i, j] = of_means[j, i] = means / whole
            of_products[i, j] = of_products[j, i] = products / (2.0 * whole * float(first * second) ** 2)
    # One law of the phase is that of each term alone; a ramp is no noise
    alone = [Coefficients(**{name: 1.0}).phase_noise(each).squares() for name in Coefficients.__struct_fields__[:-1]]
    variance = np.array([point.deviation**2 for point in curve])
    scale = float(np.median(variance))
    high = np.array([point.high**2 for point in curve]) / scale
    phase = np.column_stack([*alone, np.zeros(4)])
    return _Curve(variance / scale, design_of(factors, each), phase, of_means, of_products, high), scale


def _start(points: _Curve, size: int, columns: list[int], margin: int) -> int | None:
    """Return the first point from which the next ones agree with the fit, and the margin; None if there is none."""
    for start in range(size - _LEAST - margin + 1):
        fitted = points.fit(start, size, columns)
        beyond = points.chi_square(start + _NEXT, size, columns, fitted.of_points[_NEXT:, _NEXT:])
        more = points.chi_square(start, size, columns, fitted.of_points) - beyond
        begin = start + margin
        if _beyond(max(0.0, more), _NEXT) >= _P_START and _taken(points, begin, size, columns) <= _TAKEN:
            return begin
    return None


def _taken(points: _Curve, begin: int, size: int, columns: list[int]) -> float:
    """Return the part of the white noise that a filter takes from the first point of a fit."""
    if columns[0] != _Q:
        return 0.0
    added = points.design[begin] * points.fit(begin, size, columns).bounded
    return -float(added[_Q] / added[_N]) if added[_N] > 0.0 else math.inf if added[_Q] < 0.0 else 0.0


def _beyond(chi_square: float, dof: int) -> float:
    """Return the probability of so large a chi-square, or a larger one."""
    from scipy.special import chdtrc  # noqa: PLC0415 - SciPy costs more to import than all the rest

    return float(chdtrc(dof, chi_square))


def _piece(points: _Curve, begin: int, size: int, columns: list[int]) -> int:
    """Return the end of the longest piece from `begin` on that the fit describes, with margin; `begin` if none."""
    for end in range(size, begin + _LEAST_OF_PIECE + _MARGIN - 1, -1):
        if points.p(begin, end, points.fit(begin, end, columns))[2] >= _P_PIECE:
            return end - _MARGIN
    return begin


def _envelope(points: _Curve, begin: int) -> Floats:
    """Return bounds of the squares that need no model, as every other noise adds; of N by the longest times."""
    limits = np.min(points.high[begin:, None] / points.design[begin:], axis=0)
    limits[_N] = float(np.max(points.high[begin:] / points.design[begin:, _N]))
    return np.asarray(limits)


def _u_if_0(points: _Curve, begin: int, end: int, fitted: _Fitted, term: int) -> float:
    """Return the uncertainty of a square that it would have if it were 0."""
    law = fitted.bounded.copy()
    law[term] = 0.0
    place = fitted.columns.index(term)
    found = points.covariance_of(begin, end, fitted.columns, law)[place, place]
    return min(math.sqrt(max(0.0, float(found))), fitted.u(term))


def _stands_out(points: _Curve, begin: int, end: int, fitted: _Fitted, term: int) -> bool:
    """Return True if a term is shown beside the others, and B too where the others alone are fitted.

    A walk of a few hundred readings is a little better described by B than by K; by chance it then looks like flicker.
    """
    if not 0.0 < _SHOWN * _u_if_0(points, begin, end, fitted, term) <= fitted.bounded[term]:
        return False
    if term != _B:
        return True
    without = points.fit(begin, end, [each for each in fitted.columns if each != _B]).bounded
    place = fitted.columns.index(_B)
    variance = float(points.covariance_of(begin, end, fitted.columns, without)[place, place])
    return bool(fitted.bounded[_B] >= _ONE_SIDED * math.sqrt(max(0.0, variance)))


def _terms(points: _Curve, begin: int, end: int, wide: list[int], limits: Floats) -> dict[Term, NoiseTerm]:
    """Return each term, in samples, by the model with all of them; R as one more."""
    fitted, terms = points.fit(begin, end, wide), {}
    for place, term in enumerate(Term):
        stated = fitted
        if place not in wide:
            if place != _R or end - begin <= len(wide) + 1:
                continue
            stated = points.fit(begin, end, [*wide, _R])
        square, u = float(stated.bounded[place]), stated.u(place)
        u_0 = _u_if_0(points, begin, end, stated, place)
        shown = place in wide and _stands_out(points, begin, end, stated, place)
        if place == _Q:
            if shown:
                terms[term] = NoiseTerm(
                    math.sqrt(square), u / (2.0 * math.sqrt(square)), math.sqrt(square + 2 * u), u_0
                )
            continue
        most = max(square, float(stated.signed[place]), 0.0)
        upper = max(upper_square(most, u, u_0), most)
        if place != _N or _R in wide:
            upper = max(upper, _solved_upper(points, begin, end, stated, place))
        # Of the bounds of many points the least is no bound of 95 % where several of them are near to what was found
        if not math.isfinite(upper) or (place != _N and not shown):
            upper = min(upper, float(limits[place])) if math.isfinite(upper) else float(limits[place])
        value = math.sqrt(square) if shown else 0.0
        terms[term] = NoiseTerm(value, u / (2.0 * value) if shown else None, math.sqrt(max(upper, square)), u_0)
    return terms


def _solved_upper(points: _Curve, begin: int, end: int, fitted: _Fitted, term: int) -> float:
    """Return the S of which the found value lies 1.645 of its own uncertainties below."""
    square = max(0.0, float(fitted.bounded[term]), float(fitted.signed[term]))
    law, place, upper = fitted.bounded.copy(), fitted.columns.index(term), square
    for _ in range(_ROUNDS):
        law[term] = upper
        u = math.sqrt(max(0.0, float(points.covariance_of(begin, end, fitted.columns, law)[place, place])))
        upper = square + _ONE_SIDED * u
        if not math.isfinite(upper):
            break
    return upper


def _whole_covariance(points: _Curve, begin: int, end: int, law: _Fitted) -> Floats:
    """Return the covariance of the squares of a law: those that came out as 0 take no part in that of the others."""
    whole, free = np.zeros((5, 5)), [at for at in law.columns if law.bounded[at] != 0.0]
    if free:
        whole[np.ix_(free, free)] = points.covariance_of(begin, end, free, law.bounded)
    for at in law.columns:
        if at not in free:
            whole[at, at] = points.covariance_of(begin, end, [*free, at], law.bounded)[-1, -1]
    return whole


def _in_seconds(
    law: _Fitted, covariance: Floats, terms: dict[Term, NoiseTerm], scale: float, interval_s: float
) -> NoiseFit:
    """Return a fit in the unit of the record and seconds: squares of samples times the interval to their power."""
    of_squares = scale * interval_s ** np.array([2.0, 1.0, 0.0, -1.0, -2.0])
    squares = law.bounded * of_squares
    values = np.copysign(np.sqrt(np.abs(squares)), squares)
    stated = {}
    for square, term in zip(of_squares.tolist(), Term, strict=True):
        if term in terms:
            each, by = terms[term], math.sqrt(square)
            u = None if each.u is None else by * each.u
            stated[term] = NoiseTerm(by * each.value, u, by * each.upper_95, square * each.u_square_if_0)
    return NoiseFit(Coefficients(*values.tolist()), stated, covariance * np.outer(of_squares, of_squares))
