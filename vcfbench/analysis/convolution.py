"""Coverage factors of sums in which sources within limits prevail: their distributions convolved, without trials."""

import math
from collections.abc import Iterable, Mapping

import numpy as np

from vcfbench.analysis.arrays import Floats
from vcfbench.analysis.budget import Distribution, Result, Source
from vcfbench.analysis.tails import t_quantile

_CELLS = 3**8
"""An odd number, so that one is in the middle, and one that suits the Fourier transform."""
_LEFT_OUT = 1e-5
"""Probability of the normal part that may lie outside the grid."""


def convolved_coverage_factor(result: Result, sources: Iterable[Source]) -> float:
    """Return the half width of the interval of ``result.confidence`` over its u, to 0.1 %.

    The result is taken as its sensitivities say, a sum. Its sources within limits keep their distributions; the normal
    ones make up the rest of its variance, as one Student's t with the degrees of freedom that remain. A result without
    uncertainty keeps its factor.
    """
    kinds = {source.name: source.distribution for source in sources}
    bounded = [line for line in result.contributions if kinds[line.source] is not Distribution.NORMAL and line.u]
    if not bounded:
        return result.coverage_factor
    limits = [(kinds[line.source], _HALF_WIDTH[kinds[line.source]] * abs(line.u)) for line in bounded]
    normal = (line.share for line in result.contributions if kinds[line.source] is Distribution.NORMAL)
    rest_share = max(0.0, math.fsum(normal))
    rest_u = result.u * math.sqrt(rest_share)
    rest_dof = result.dof * rest_share**2 if rest_share else math.inf  # Welch and Satterthwaite backwards
    reach = math.fsum(half_width for _, half_width in limits) + rest_u * t_quantile(_LEFT_OUT, rest_dof)
    edges = np.linspace(-reach, reach, _CELLS + 1)
    # The same of the normal or t part, by its density in the middles
    middles = 0.5 * (edges[1:] + edges[:-1])
    if rest_u < edges[1] - edges[0]:  # narrower than a cell
        density = (np.arange(middles.size) == middles.size // 2).astype(float)
    elif math.isinf(rest_dof):
        density = np.exp(-0.5 * (middles / rest_u) ** 2)
    else:
        density = np.exp(-0.5 * (rest_dof + 1.0) * np.log1p((middles / rest_u) ** 2 / rest_dof))
    together = np.fft.rfft(np.asarray(np.fft.ifftshift(density / density.sum())))
    half_a_cell = float(edges[_CELLS // 2 + 1])
    for kind, half_width in limits:
        if half_width > half_a_cell:  # what stays within the middle cell moves nothing
            together = together * np.fft.rfft(_cells(kind, edges, half_width))
    return _upper_end(np.fft.irfft(together, _CELLS), edges, result.confidence) / result.u


_HALF_WIDTH: Mapping[Distribution, float] = {
    Distribution.RECTANGULAR: math.sqrt(3.0),
    Distribution.TRIANGULAR: math.sqrt(6.0),
    Distribution.ARCSINE: math.sqrt(2.0),
}
"""In standard uncertainties."""


def _cells(kind: Distribution, edges: Floats, half_width: float) -> Floats:
    """Return the probability of each cell, the middle one first, of a source that goes beyond the middle cell."""
    first = int(edges.searchsorted(-half_width, "right")) - 1
    stop = int(edges.searchsorted(half_width)) + 1
    x = np.clip(edges[first:stop] / half_width, -1.0, 1.0)
    match kind:
        case Distribution.TRIANGULAR:
            below = 0.5 + x - 0.5 * x * np.abs(x)
        case Distribution.ARCSINE:
            below = np.arcsin(x) / math.pi
        case _:
            below = 0.5 * x
    middle = edges.size // 2 - 1
    inside, cells = np.diff(below), np.zeros(edges.size - 1)
    cells[: stop - 1 - middle] = inside[middle - first :]
    cells[first - middle :] = inside[: middle - first]
    return cells


def _upper_end(cells: Floats, edges: Floats, confidence: float) -> float:
    """Return the upper end of the interval with equal tails about the middle."""
    below = np.concatenate([[0.0], np.cumsum(np.fft.fftshift(cells))])
    return float(np.interp(0.5 * (1.0 + confidence), below, edges))
