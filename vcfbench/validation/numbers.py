"""Checks of the arithmetic against published figures."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING, Any, Final

import numpy as np
from uncertainties import umath

from vcfbench.analysis import budget
from vcfbench.analysis.allan import allan_deviation
from vcfbench.analysis.regression import fit_line
from vcfbench.analysis.scale_factor import characterise, compare
from vcfbench.errors import ConfigError
from vcfbench.extras import need
from vcfbench.validation import paper
from vcfbench.validation.check import Found, check, same
from vcfbench.values.quantile import t_quantile
from vcfbench.values.verdict import e_n

if TYPE_CHECKING:
    from collections.abc import Mapping

# NIST Statistical Reference Datasets, Norris: x and y of 36 observations
_NORRIS: Final = (
    (0.2, 0.1), (337.4, 338.8), (118.2, 118.1), (884.6, 888.0), (10.1, 9.2), (226.5, 228.1), (666.3, 668.5),
    (996.3, 998.5), (448.6, 449.1), (777.0, 778.9), (558.2, 559.2), (0.4, 0.3), (0.6, 0.1), (775.5, 778.1),
    (666.9, 668.8), (338.0, 339.3), (447.5, 448.9), (11.6, 10.8), (556.0, 557.7), (228.1, 228.3), (995.8, 998.0),
    (887.6, 888.8), (120.2, 119.6), (0.3, 0.3), (0.3, 0.6), (556.8, 557.6), (339.1, 339.3), (887.2, 888.0),
    (999.0, 998.5), (779.0, 778.9), (11.1, 10.2), (118.3, 117.6), (229.2, 228.9), (669.1, 668.4), (448.9, 449.2),
    (0.5, 0.2),
)  # fmt: skip


@check(
    "table of the paper",
    "Do scale factors, biases and their difference follow from the printed outputs?",
    "Wang, Cao, Shen, Chai, Micromachines 9 (2018), table 1 and section 4.2",
)
def _paper() -> Found:
    table, virtual = (characterise(paper.RATES_DEG_S, column) for column in (paper.TURNTABLE_V, paper.VIRTUAL_V))
    came = (
        f"{1e3 * table.line.scale_factor:.2f} and {1e3 * virtual.line.scale_factor:.2f} mV/(deg/s), "
        f"{1e3 * table.line.bias:.2f} and {1e3 * virtual.line.bias:.2f} mV, "
        f"error {compare(table, virtual).scale_factor_error_percent_rounded:.3f} %"
    )
    return same("-12.54 and -12.73 mV/(deg/s), -42.04 and 0.66 mV, error 1.515 %", came)


@check(
    "straight line",
    "Slope, intercept, their standard deviations and that of the residuals",
    "NIST Statistical Reference Datasets, Norris, certified values",
)
def _norris() -> Found:
    x, y = np.array(_NORRIS).T
    line = fit_line(x, y)
    slope = f"{line.scale_factor:.11f} ({line.u_scale_factor:.11f})"
    came = f"{slope}, {line.bias:.10f} ({line.u_bias:.10f}), {line.s_v:.10f}"
    return same("1.00211681802 (0.00042979685), -0.2623230738 (0.2328182343), 0.8847963961", came)


@check("Allan deviation", "Overlapping, of 1000 points at factors 1, 10, 100", "NIST SP 1065 (2008), table 31")
def _allan() -> Found:
    modulus, value, record = 2147483647, 1234567890, []
    for _ in range(1000):
        record.append(value / modulus)
        value = 16807 * value % modulus
    came = " ".join(f"{point.deviation:.6e}" for point in allan_deviation(record, 1.0, (1, 10, 100)))
    return same("2.922319e-01 9.159953e-02 3.241343e-02", came)


@check("Student's t", "97.5 % points at 1, 2, 5, 10, 30, 100 degrees of freedom", "NIST/SEMATECH e-Handbook, 1.3.6.7.2")
def _student() -> Found:
    came = " ".join(f"{t_quantile(0.05, dof):.3f}" for dof in (1, 2, 5, 10, 30, 100))
    return same("12.706 4.303 2.571 2.228 2.042 1.984", came)


def _impedance(x: Mapping[str, Any]) -> Mapping[str, Any]:
    z = x["V"] / x["I"]
    return {"R": z * umath.cos(x["phase"]), "X": z * umath.sin(x["phase"]), "Z": z}


@check("correlated sources", "Resistance, reactance, impedance", "JCGM 100:2008 (GUM), H.2, table H.2")
def _gum() -> Found:
    observed = np.array(
        [
            [5.007, 4.994, 5.005, 4.990, 4.999],
            [19.663e-3, 19.639e-3, 19.640e-3, 19.685e-3, 19.678e-3],
            [1.0456, 1.0438, 1.0468, 1.0428, 1.0433],
        ]
    )
    covariance = np.cov(observed) / 5
    u = np.sqrt(np.diag(covariance))
    names = ("V", "I", "phase")
    sources = [
        budget.Source(name, float(row.mean()), float(u_mean), "", 4)
        for name, row, u_mean in zip(names, observed, u, strict=True)
    ]
    pairs = {(names[i], names[j]): float(covariance[i, j] / u[i] / u[j]) for i, j in ((0, 1), (0, 2), (1, 2))}
    results = budget.evaluate(sources, _impedance, pairs).results
    # the GUM prints 0.295 for u(X), the scatter of the five reactances; first order gives 0.296
    return same(
        "R 127.732 (0.071), X 219.847 (0.296), Z 254.260 (0.236)",
        ", ".join(f"{each.name} {each.value:.3f} ({each.u:.3f})" for each in results),
    )


@check("data-sheet limits", "A weight of 10 kg", "EA-4/02 M:2022, S2")
def _weight() -> Found:
    sources = [
        budget.Source("standard", 10_000.005, 0.0225, "g"),
        budget.Source.within("drift", 0.0, 0.015, "g"),
        budget.Source("difference", 0.020, 0.025 / math.sqrt(3.0), "g"),
        budget.Source.within("eccentricity", 0.0, 0.010, "g"),
        budget.Source.within("buoyancy", 0.0, 0.010, "g"),
    ]
    found = budget.evaluate(sources, lambda x: {"mass": sum(x.values())}, confidence=0.9545).result("mass")
    came = f"{found.value:.3f} g, u {1e3 * found.u:.1f} mg, U {1e3 * found.expanded_u:.0f} mg"
    return same("10000.025 g, u 29.3 mg, U 59 mg", came)


@check("another calculator", "A budget with correlations", "GUM Tree Calculator (GTC)")
def _tree_calculator() -> Found:
    expected = "value, u and degrees of freedom alike to 1e-9"
    try:
        gtc = need("GTC", "validate", "this check")
    except ConfigError as error:
        return Found(expected, str(error), passed=None)
    volts, amperes = gtc.multiple_ureal([4.9990, 19.6610e-3], [0.0032, 0.0095e-3], 4)
    gtc.set_correlation(-0.36, volts, amperes)
    phase = gtc.ureal(1.04446, 0.00075, 7)
    theirs = volts / amperes * gtc.cos(phase)
    sources = [
        budget.Source("V", 4.9990, 0.0032, "V", 4),
        budget.Source("I", 19.6610e-3, 0.0095e-3, "A", 4),
        budget.Source("phase", 1.04446, 0.00075, "rad", 7),
    ]
    ours = budget.evaluate(sources, _impedance, {("V", "I"): -0.36}).result("R")
    apart = max(
        abs(one / other - 1.0) for one, other in ((ours.value, theirs.x), (ours.u, theirs.u), (ours.dof, theirs.df))
    )
    return Found(expected, f"largest relative difference {apart:.1e}", passed=apart < 1e-9)


@check("agreement", "E_n of 10.0 +- 0.3 and 10.4 +- 0.4", "ISO 13528:2022, 9.7, by hand")
def _agreement() -> Found:
    return same("0.80", f"{e_n(10.0, 0.3, 10.4, 0.4):.2f}")


CHECKS = (_paper, _norris, _allan, _student, _gum, _weight, _tree_calculator, _agreement)
"""Checks of the arithmetic, in their order."""
