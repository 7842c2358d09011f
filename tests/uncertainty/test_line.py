"""The sources of a line's errors, each against its closed form."""

from __future__ import annotations

import math
from typing import Any

import numpy as np
import pytest

from tests.procedures.fakes import make_settings
from vcfbench.analysis.budget import Source
from vcfbench.instructions.schedule import Earth
from vcfbench.records.schema import Point
from vcfbench.station.settings import Sources, Station
from vcfbench.uncertainty.line import (
    Line,
    earth_sources,
    instrument_sources,
    limited,
    line_sums,
    table_values,
)
from vcfbench.uncertainty.windows import Sweep
from vcfbench.values.sources import noise_of

ROOT3 = math.sqrt(3.0)
RATES = [0.0, 1.0, 2.0, 4.0, 8.0]


def line_of(rates: list[float], outputs: list[float], mixing: np.ndarray | None = None) -> Line:
    points = [Point(1, rate, 0.0, out, 0.0, 1) for rate, out in zip(rates, outputs, strict=True)]
    return Line.of(
        Sweep(1, tuple(range(len(points))), tuple(points), np.eye(len(points)) if mixing is None else mixing)
    )


def test_line_is_the_least_squares_one() -> None:
    outputs = [0.3, -0.1, -1.4, -3.9, -7.7]
    line = line_of(RATES, outputs)
    slope, bias = np.polyfit(RATES, outputs, 1)
    assert (line.scale_factor, line.bias_v) == pytest.approx((slope, bias))
    assert line.slope_weights @ np.array(outputs) == pytest.approx(slope)
    assert line.bias_weights @ np.array(outputs) == pytest.approx(bias)
    mixing = np.random.default_rng(1).normal(size=(5, 5))
    sums = line_sums("table", line_of(RATES, outputs, mixing))
    assert [(each.name, each.unit, each.steady) for each in sums] == [
        ("table slope", "V/(deg/s)", False),
        ("table bias", "V", True),
    ]
    for each, weights in zip(sums, (line.slope_weights, line.bias_weights), strict=True):
        assert each.weights == pytest.approx(weights @ mixing)


@pytest.mark.parametrize(("rates", "cubic"), [(RATES, True), ([*RATES[:4], 4.0], False)])
def test_slope_at_each_rate_is_that_of_a_cubic(rates: list[float], *, cubic: bool) -> None:
    outputs = [0.5 * x - 0.03 * x**3 + 1e-3 * x**4 for x in rates]
    expected = np.polyval(np.polyder(np.polyfit(rates, outputs, 3 if cubic else 1)), rates)
    assert line_of(rates, outputs).derivative == pytest.approx(expected)


@pytest.mark.parametrize(
    ("limit", "sigmas", "u", "rectangular"),
    [
        (6.0, None, 6.0 / ROOT3, True),
        (6.0, 2.0, 3.0, False),
        (None, 2.0, 0.0, False),
        (None, None, 0.0, False),
    ],
)
def test_limit_is_rectangle_or_multiple_of_u(
    limit: float | None, sigmas: float | None, u: float, *, rectangular: bool
) -> None:
    assert limited("gain", limit, "V", sigmas) == Source("gain", 0.0, u, "V", math.inf, rectangular)


def test_multimeter_and_table_are_sources_of_every_line() -> None:
    known = Sources(meter_gain=4e-5, meter_offset_v=2e-5, meter_sigmas=2.0, table_rate=1e-4)
    assert instrument_sources(known) == [
        Source("meter gain", 0.0, 2e-5, "1"),
        Source("meter offset", 0.0, 1e-5, "V"),
        Source.within("table rate", 0.0, 1e-4, "1"),
    ]


def test_rest_of_the_earths_rate_is_in_the_bias() -> None:
    """Its level part by the tilt of the axis; nothing where the bias keeps it."""
    tilted: dict[str, Any] = {"station": Station(latitude_deg=60.0), "axis_tilt_deg": 1.0}
    (source,) = earth_sources(make_settings(earth=Earth.RATE, **tilted), -0.0125)
    left_deg_s = 360.0 / 86164.1 * 0.5 * math.sin(math.radians(1.0))
    assert source == Source(
        *("the Earth's rate and the tilt of the axis", 0.0, pytest.approx(0.0125 * left_deg_s / ROOT3, rel=1e-5), "V"),
        rectangular=True,
    )
    assert earth_sources(make_settings(earth=Earth.BIAS, **tilted), -0.0125) == []


QUIET = {
    **{f"{kind}: table {what}": 0.0 for kind in ("readings", "flicker") for what in ("slope", "bias")},
    "meter gain": 0.0,
    "meter offset": 0.0,
    "table rate": 0.0,
}


@pytest.mark.parametrize(
    ("moved", "slope", "bias"),
    [
        ({}, -2.0, 0.5),
        ({"meter gain": 0.25}, -2.0 / 1.25, 0.5 / 1.25),
        ({"table rate": 0.25}, -2.0 / 1.25, 0.5),
        ({"meter offset": 0.1}, -2.0, 0.4),
        ({"the Earth's rate and the tilt of the axis": 0.1}, -2.0, 0.4),
        ({"readings: table slope": 0.1, "flicker: table slope": 0.2}, -2.3, 0.5),
        ({"readings: table bias": 0.1, "flicker: table bias": 0.2}, -2.0, 0.2),
    ],
)
def test_tables_line_is_reading_less_errors(moved: dict[str, float], slope: float, bias: float) -> None:
    line = line_of([-1.0, 0.0, 1.0], [2.5, 0.5, -1.5])
    found = table_values(line, {**QUIET, **moved})
    assert found == pytest.approx({"scale_factor": slope, "bias": bias, "bias_deg_s": bias / slope})
    assert noise_of("table slope", {**QUIET, **moved}) == pytest.approx(-2.0 - slope if "slope" in str(moved) else 0.0)
