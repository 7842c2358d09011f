"""Errata of the paper, each executed: what the printed words give, what those that hold give, and what is true.

`docs/theory.md` has the whole list; here are those that a number shows.
"""

from __future__ import annotations

import cmath
from math import atan, atan2, cos, degrees, exp, pi, sin, sqrt, tau
from typing import TYPE_CHECKING, Final

import numpy as np
from msgspec import Struct

from vcfbench.analysis.regression import fit_line
from vcfbench.validation import paper

if TYPE_CHECKING:
    from collections.abc import Callable

_W_D: Final = tau * paper.DRIVE_HZ
_W_Y, _Q_Y = tau * paper.SENSE_HZ, paper.SENSE_Q
_W_IN: Final = tau * paper.FIGURE_2_HZ["sense in phase"]
_P, _R = _W_Y**2 - _W_D**2, _W_Y * _W_D / _Q_Y
_G: Final = _P / (_P**2 + _R**2)
_SPLIT_HZ: Final = paper.DRIVE_HZ - paper.SENSE_HZ
_AT_S: Final = 40.37e-3
"""An instant at which the modes still ring."""
_PHI_X: Final = -1.2
_PHI_D0: Final = 0.3
"""Phases at which an erratum shows, rad."""


class Erratum(Struct, frozen=True):
    """A mistake in print: its place, the printed and the right words, the numbers of both, and the truth."""

    where: str
    printed: str
    holds: str
    by_printed: float
    by_correct: float
    true: float
    unit: str

    @property
    def shown(self) -> bool:
        """True if the words that hold give the true number to a thousandth, and the printed ones do not."""
        near = 1e-3 * max(abs(self.true), abs(self.by_printed))
        return abs(self.by_correct - self.true) <= near < abs(self.by_printed - self.true)


def executed() -> tuple[Erratum, ...]:
    """Return the errata with their numbers, in the order of the paper."""
    return tuple(each() for each in _ERRATA)


def _displacement(w: float, q: float, force: complex, t_s: float) -> float:
    """Return y(t) of y'' + (w/Q) y' + w^2 y = Re(force e^(j w_d t)) from rest, by the eigenvectors of the equation."""
    system = np.array([[0.0, 1.0], [-w * w, -w / q]], complex)
    steady = np.linalg.solve(1j * _W_D * np.eye(2) - system, np.array([0.0, force]))
    values, vectors = np.linalg.eig(system)
    own = np.linalg.solve(vectors, -steady.real)
    return float((steady[0] * cmath.exp(1j * _W_D * t_s) + vectors[0] @ (own * np.exp(values * t_s))).real)


def _abstract() -> Erratum:
    bias_mv = 1e3 * fit_line(paper.RATES_DEG_S, paper.TURNTABLE_V).bias
    return Erratum("abstract", "bias 42.04 mV", "-42.04 mV", 42.04, -42.04, bias_mv, "mV")


def _gap() -> Erratum:
    gap_hz = paper.FIGURE_2_HZ["drive"] - paper.FIGURE_2_HZ["drive in phase"]
    return Erratum("section 2", "drive modes more than 1000 Hz apart", "861 Hz", 1000.0, 861.0, gap_hz, "Hz")


def _equation_2() -> Erratum:
    w, q = tau * paper.DRIVE_HZ + 60.0, paper.DRIVE_Q  # at resonance itself both brackets are small
    d = (w**2 - _W_D**2) ** 2 + (w * _W_D / q) ** 2
    ringing, decay = sqrt(1.0 - 1.0 / (4.0 * q * q)) * w, exp(-w * _AT_S / (2.0 * q))
    steady = sin(_W_D * _AT_S + atan2(-w * _W_D / q, w**2 - _W_D**2)) / sqrt(d)
    cosine = w * _W_D / q / d * cos(ringing * _AT_S)

    def by(bracket: float) -> float:
        return 1e9 * (steady + decay * (cosine + _W_D * bracket / (ringing * d) * sin(ringing * _AT_S)))

    printed, correct = by(w**2 / q + _W_D**2 - w**2), by(w**2 / (2.0 * q * q) + _W_D**2 - w**2)
    true = 1e9 * _displacement(w, q, -1j, _AT_S)
    return Erratum("(2)", "w²/Q + w_d² - w²", "w²/(2 Q²) + w_d² - w²", printed, correct, true, "nm per N/kg")


def _equation_3() -> Erratum:
    w, q = _W_Y, _Q_Y
    d = (w**2 - _W_D**2) ** 2 + (w * _W_D / q) ** 2
    ringing, decay = sqrt(1.0 - 1.0 / (4.0 * q * q)) * w, exp(-w * _AT_S / (2.0 * q))
    steady = sin(_W_D * _AT_S + _PHI_X + pi / 2.0 + atan2(-w * _W_D / q, w**2 - _W_D**2)) / sqrt(d)
    cosine = w * _W_D * sin(_PHI_X) / q + (w**2 - _W_D**2) * cos(_PHI_X)

    def by(bracket: float) -> float:
        ring = bracket / ringing * sin(ringing * _AT_S) - cosine * cos(ringing * _AT_S)
        return 1e9 * (steady + decay / d * ring)

    printed = w * (w**2 - 3.0 * _W_D**2) * cos(_PHI_X) / (2.0 * q)
    printed += _W_D * (w**2 / (2.0 * q) + w**2 - _W_D**2) * sin(_PHI_X)
    correct = -w * (w**2 + _W_D**2) * cos(_PHI_X) / (2.0 * q)
    correct += _W_D * (w**2 - _W_D**2 - w**2 / (2.0 * q * q)) * sin(_PHI_X)
    true = 1e9 * _displacement(w, q, cmath.exp(1j * _PHI_X), _AT_S)
    return Erratum("(3)", "its sine term", "that of docs/theory.md", by(printed), by(correct), true, "nm per N/kg")


def _phases() -> Erratum:
    true = degrees(cmath.phase(1.0 / complex(_P, _R)))
    return Erratum("phases", "-arctan", "atan2", -degrees(atan(_R / _P)), degrees(atan2(-_R, _P)), true, "deg")


def _equation_4() -> Erratum:
    whole_s = 250_000 / paper.DRIVE_HZ  # whole periods, and long enough for the transient to be over
    size = paper.DRIVE_Q / _W_D**2
    true = _displacement(_W_D, paper.DRIVE_Q, -1j, whole_s) / size
    return Erratum("(4)", "x = +A cos w_d t", "x = -A cos w_d t", 1.0, -1.0, true, "A, after whole periods")


def _equation_6() -> Erratum:
    p, r = _W_IN**2 - _W_D**2, _W_IN * _W_D / _Q_Y
    steady = 1.0 / complex(p, r)
    correct = 2e3 * _W_D * p / (p * p + r * r)
    printed, true = 1e3 / (_W_IN - _W_D), 2e3 * _W_D * steady.real
    return Erratum("(6), in phase", "1/(w_y1 - w_x2)", "2 w_d P/(P² + R²)", printed, correct, true, "ms")


def _bandwidth() -> Erratum:
    true = sqrt(1.0 - 1.0 / sqrt(2.0)) * _SPLIT_HZ
    printed = 0.54 * (paper.FIGURE_2_HZ["drive"] - paper.FIGURE_2_HZ["sense"])
    return Erratum("after (6)", "+3 dB by the 16 Hz of figure 2", "by 24.8 Hz", printed, 0.5412 * _SPLIT_HZ, true, "Hz")


def _equation_12() -> Erratum:
    true = (1.0 / complex(_P, _R) + 1.0 / complex(_P, -_R)).real / 2.0 / _G
    return Erratum("(12), (15)", "factors 1/2 and 1/4", "1 and 1/2", 0.5, 1.0, true, "of (11) over G_equal")


def _equation_13() -> Erratum:
    true = (cmath.exp(-1j * _PHI_D0) / complex(_P, _R) + cmath.exp(1j * _PHI_D0) / complex(_P, -_R)).real / 2.0 / _G
    correct = (_P * cos(_PHI_D0) - _R * sin(_PHI_D0)) / (_P**2 + _R**2) / _G
    return Erratum("(13)", "no phase of the carrier", "P cos φ - R sin φ", 1.0, correct, true, "of G_equal, φ 0.3 rad")


def _matching() -> Erratum:
    tens, zero = paper.RATES_DEG_S.index(10), paper.RATES_DEG_S.index(0)
    table, virtual = paper.TURNTABLE_V, paper.VIRTUAL_V
    apart = 100.0 * (virtual[zero] - table[zero]) / (table[tens] - table[zero])
    unit = f"% of K_Vc, by zeros {1e3 * (virtual[zero] - table[zero]):.1f} mV apart"
    return Erratum("section 4.2", "V_Vc10 by equal outputs", "by outputs less their zeros", apart, 0.0, 0.0, unit)


_ERRATA: Final[tuple[Callable[[], Erratum], ...]] = (
    *(_abstract, _gap, _equation_2, _equation_3, _phases, _equation_4, _equation_6),
    *(_bandwidth, _equation_12, _equation_13, _matching),
)
