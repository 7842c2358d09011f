"""What a run says of its own uncertainty."""

from __future__ import annotations

import math
import pickle

import numpy as np
import pytest
from simrack.instruments.agilent33220a import GeneratorErrors

from vcfbench.analysis.column import Nonlinearity
from vcfbench.analysis.nonlinearity import DEFINITIONS
from vcfbench.errors import ConfigError
from vcfbench.instructions.schedule import SweepSettings
from vcfbench.procedures.turntable import turntable_results
from vcfbench.procedures.virtual_coriolis.results import virtual_coriolis_results
from vcfbench.procedures.virtual_coriolis.settings import VirtualCoriolisSettings
from vcfbench.records.plain import plain
from vcfbench.records.schema import Point, pooled_std_v
from vcfbench.specifications import AGILENT_33220A
from vcfbench.station.settings import Station
from vcfbench.uncertainty.columns import repeat_std_v, u_output_v

RATES = [200.0, 100.0, 50.0, 20.0, 10.0, 5.0, 2.0, 1.0, 0.0, -1.0, -2.0, -5.0, -10.0, -20.0, -50.0, -100.0, -200.0]
K, K_VC, READINGS = -0.0125, 150.0, 10
EXACT = Station(meter_resolution_v=0.0)
SETTINGS, SWEEP = VirtualCoriolisSettings(station=EXACT), SweepSettings(station=EXACT)


def point(step: int, rate: float, v_vc: float, output_v: float, std_v: float = 0.0) -> Point:
    return Point(step, rate, v_vc, output_v, std_v, READINGS)


def calibration(
    rng: np.random.Generator, *, noise_v: float = 0.0, wander_v: float = 0.0, level: float = 0.0
) -> list[Point]:
    """A straight gyro: white noise of a reading, a zero that moves from window to window, a DAC's uniform error."""

    def taken(step: int, rate: float, v_vc: float) -> Point:
        readings = rng.normal(0.0, noise_v, READINGS) if noise_v else np.zeros(READINGS)
        really = v_vc * (1.0 + level * errors.setdefault(v_vc, rng.uniform(-0.5, 0.5)))
        output = K * (K_VC * really if step in {2, 4} else rate) + rng.normal(0.0, wander_v) + readings.mean()
        return point(step, rate, v_vc, float(output), float(readings.std(ddof=1)))

    errors: dict[float, float] = {}
    turns = [False, True, True, False] * 2
    points = [taken(1, 10.0 * turn, 0.0) for turn in turns]
    points += [taken(2, 0.0, 10.0 / K_VC * pushed) for pushed in turns]
    k_vc = virtual_coriolis_k_vc(points)
    points += [taken(3, rate, 0.0) for rate in RATES]
    return points + [taken(4, rate, rate / k_vc) for rate in RATES]


def virtual_coriolis_k_vc(points: list[Point]) -> float:
    means = {
        key: np.mean([p.output_v for p in points if (p.step, bool(p.rate_deg_s or p.v_vc_v)) == key])
        for key in ((1, False), (1, True), (2, False), (2, True))
    }
    return float(K_VC * (means[2, True] - means[2, False]) / (means[1, True] - means[1, False]))


@pytest.mark.exhaustive
@pytest.mark.parametrize(
    ("noise_v", "wander_v", "level"),
    [(1.2e-4, 25e-6, 0.0), (1e-6, 0.0, 3.86e-4)],
)
def test_stated_uncertainties_are_not_below_the_scatter_of_200_runs(
    noise_v: float, wander_v: float, level: float
) -> None:
    """A scatter of 200 is known to 5 %: 10 % low at most. The DAC's worst range is stated, so twice as much at most."""
    rng = np.random.default_rng(1)
    results = []
    for _ in range(200):
        points = calibration(rng, noise_v=noise_v, wander_v=wander_v, level=level)
        results.append(virtual_coriolis_results(SETTINGS, points))
    for value, u in (
        ([r.k_vc.value for r in results], [r.k_vc.u_fit for r in results]),
        ([r.scale_factor_error_percent for r in results], [r.scale_factor_error_u_readings_percent for r in results]),
        (
            [r.turntable.scale_factor.value for r in results],
            [r.turntable.type_a.u_scale_factor for r in results if r.turntable.type_a is not None],
        ),
    ):
        assert 0.5 < np.std(value) / np.sqrt(np.mean(np.square(u))) < 1.1


def test_noise_of_a_reading_is_pooled_by_degrees_of_freedom() -> None:
    windows = [Point(3, 0.0, 0.0, 0.0, 1e-4, 2), Point(3, 1.0, 0.0, 0.0, 3e-4, 4)]
    assert pooled_std_v(windows) == pytest.approx(math.sqrt((1e-8 + 3 * 9e-8) / 4))
    with pytest.raises(ConfigError, match="no window has two readings"):
        pooled_std_v([])


def test_windows_taken_again_tell_what_readings_within_one_do_not() -> None:
    again = [point(1, 0.0, 0.0, v, 1e-6) for v in (0.0, 2e-5)] + [
        point(1, 10.0, 0.0, v, 1e-6) for v in (-0.1, -0.10004)
    ]
    assert repeat_std_v(again) == pytest.approx(math.sqrt((2 * 1e-5**2 + 2 * 2e-5**2) / 2))
    assert u_output_v(again, 0.0) == pytest.approx(repeat_std_v(again))
    assert repeat_std_v(again[::2]) == 0.0
    assert u_output_v(again[::2], 0.0) == pytest.approx(1e-6 / math.sqrt(READINGS))


def test_generator_specimens_are_drawn_within_stated_accuracy() -> None:
    random = np.random.default_rng(1)
    drawn = [GeneratorErrors.drawn(random).ranges for _ in range(400)]
    assert 0.98 < max(abs(each.gain_error) for ranges in drawn for each in ranges) / AGILENT_33220A.setting <= 1.0
    smallest = [ranges[0] for ranges in drawn]  # the others' offsets have more room
    assert 0.98 < max(abs(each.offset_error_v) for each in smallest) / AGILENT_33220A.offset_v <= 1.0
    assert GeneratorErrors.promised == (AGILENT_33220A.setting, AGILENT_33220A.offset_v)


def test_a_level_that_nobody_measured_is_known_to_per_cents() -> None:
    """2 % and 4 mV (2 mV into 50 ohm, open) at 66.7 mV: 8 %, rectangular."""
    results = virtual_coriolis_results(SETTINGS, calibration(np.random.default_rng(2)))
    assert results.k_vc_u_generator / results.k_vc.value == pytest.approx(0.08 / math.sqrt(3), rel=1e-6)
    assert results.k_vc.u_fit is not None
    assert results.k_vc.u_fit / results.k_vc.value == pytest.approx(3.86e-4 / math.sqrt(12), rel=1e-3)


def test_a_turntable_run_has_no_generator() -> None:
    run = turntable_results(SWEEP, [point(1, rate, 0.0, K * rate, 1e-4) for rate in RATES])
    assert run.type_a is not None
    assert run.type_a.u_scale_factor == pytest.approx(1e-4 / math.sqrt(READINGS * 106060.0))


def test_results_are_values_that_cannot_be_changed() -> None:
    points = calibration(np.random.default_rng(3), noise_v=1e-4)
    results = virtual_coriolis_results(SETTINGS, points)
    assert results == virtual_coriolis_results(SETTINGS, points)
    assert results == pickle.loads(pickle.dumps(results))  # noqa: S301  # ours
    assert len({results, results}) == 1
    with pytest.raises(AttributeError):
        results.k_vc = results.k_vc  # type: ignore[misc]


def test_what_is_written_has_the_names_of_the_fields() -> None:
    """Every number of a column is a field, and the definitions of non-linearity are those of the analysis."""
    assert list(Nonlinearity.__struct_fields__) == list(DEFINITIONS)
    written = plain(turntable_results(SWEEP, [point(1, rate, 0.0, K * rate, 1e-4) for rate in RATES]))
    assert list(written)[:4] == ["scale_factor", "bias", "nonlinearity_ppm", "asymmetry_ppm"]
    assert list(written["scale_factor"]) == ["value", "u", "unit", "u_fit", "complete", "missing"]
    assert list(written["polynomial"]) == ["c0", "c1", "c2", "c3", "s_v", "max_span_ppm"]
    assert len(written["residuals_v"]) == 17
    assert list(written["pairs"][0]) == ["rate_deg_s", "scale_factor", "even_v"]
