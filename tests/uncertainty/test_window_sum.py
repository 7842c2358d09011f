"""Sums of windows: readings, flicker and last digit through the weights."""

from __future__ import annotations

import math
from types import SimpleNamespace
from typing import Any

import pytest

from vcfbench.instructions.scale_factor import AtRestSettings
from vcfbench.records.schema import Point
from vcfbench.station.settings import PlacedInstrument, Sources, Station
from vcfbench.uncertainty.window_sum import noise_v, output_of

SOURCES = Sources(
    bias_instability_deg_h=5.0, bias_instability_dof=8.0, meter_gain=4e-5, meter_offset_v=8e-5, meter_sigmas=4.0
)
STATION = Station(
    meter_resolution_v=1e-5,
    sources=SOURCES,
    instruments={"multimeter": PlacedInstrument(model="34401A", where="FAKE")},
)
SETTINGS = AtRestSettings(samples=5, station=STATION, scale_factor_v_per_deg_s=-0.02)
WINDOWS: Any = [SimpleNamespace(readings=[SimpleNamespace(t_s=begin_s)]) for begin_s in (0.0, 10.0, 40.0)]
POINTS = [Point(1, 0.0, 0.0, 0.1, std_v, 5) for std_v in (1e-4, 3e-4, 2e-4)]


def test_noise_goes_through_the_weights_of_a_sum() -> None:
    found = {part.source: part for part in noise_v(SETTINGS, WINDOWS, {0: 1.0, 1: -3.0, 2: 2.0}, POINTS)}
    size = math.sqrt(14.0)
    assert found["readings"].u == pytest.approx(size * math.sqrt(14e-8 / 3.0) / math.sqrt(5.0))
    assert found["readings"].dof == 12
    assert found["last digit"].u == pytest.approx(size * 1e-5 / math.sqrt(12.0))
    assert found["flicker"].dof == 8.0


def test_flicker_of_two_windows_is_integral_of_logarithm() -> None:
    (_, flicker, _) = noise_v(SETTINGS, WINDOWS, {0: 1.0, 2: -1.0}, POINTS)

    def twice(x: float) -> float:
        return 0.5 * x**2 * math.log(abs(x)) - 0.75 * x**2 if x else 0.0

    lasts_s, apart_s = 5.0, 40.0
    alone = -2.0 * twice(lasts_s) / lasts_s**2
    between = -(twice(apart_s + lasts_s) + twice(apart_s - lasts_s) - 2.0 * twice(apart_s)) / lasts_s**2
    b_v = 5.0 / 3600.0 * 0.02
    assert flicker.u == pytest.approx(b_v * math.sqrt(2.0 * (alone - between) / math.pi), rel=1e-6)


def test_one_output_has_the_meter_as_well() -> None:
    found = {part.source: part.u for part in output_of(SETTINGS, POINTS[1]).parts}
    assert found["readings"] == pytest.approx(3e-4 / math.sqrt(5.0))
    assert found["meter gain"] == pytest.approx(0.1 * 1e-5)
    assert found["meter offset"] == pytest.approx(2e-5)
