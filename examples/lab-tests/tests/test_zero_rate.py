"""The lab's procedure: right on a good bench, loud on a bad one, and safe in the end."""

from __future__ import annotations

from pathlib import Path

import pytest
from vcfbench.clock import sleep
from vcfbench.errors import DeadlineExceeded, InterlockError, LimitError, LinkLost, MeasurementError, NotSafe

from lab.zero_rate import ZeroRate, zero_rate

INTERLOCK = Path(__file__).parents[1] / "faults" / "interlock.toml"


def test_it_finds_the_gyroscopes_scale_factor(measured: ZeroRate) -> None:
    assert abs(measured.scale_factor_v_per_deg_s) == pytest.approx(0.01255, rel=0.01)
    assert abs(measured.bias_v) < 0.1


def test_the_same_seed_gives_the_same_numbers(open_simulated_bench) -> None:
    results = []
    for seed in (1, 1, 2):
        with open_simulated_bench(seed=seed) as lab:
            results.append(zero_rate(lab.bench))
    assert results[0] == results[1]
    assert results[2] != results[0]


@pytest.mark.vcfbench(parameters="ideal", errors="none")
def test_a_perfect_gyroscope_has_no_bias(measured: ZeroRate) -> None:
    assert abs(measured.bias_v) < 1e-4


def test_rates_beyond_the_stations_limits_are_refused(simulated_bench, simulated_world) -> None:
    with pytest.raises(LimitError):
        zero_rate(simulated_bench, rate_deg_s=10_000.0)
    assert simulated_world.table.rate_deg_s() == 0.0


@pytest.mark.parametrize(
    ("instrument", "kind", "error"),
    [
        ("multimeter", "overload", MeasurementError),
        ("multimeter", "silent", DeadlineExceeded),
        ("multimeter", "disconnect", LinkLost),
    ],
)
def test_no_number_comes_of_a_bad_reading(simulated_bench, fault, instrument, kind, error) -> None:
    fault(instrument, kind, at_s=12.0)
    with pytest.raises(error):
        zero_rate(simulated_bench)


def test_an_interlock_that_opens_half_way_leaves_nothing_turning(open_simulated_bench) -> None:
    with open_simulated_bench() as lab:
        lab.play(INTERLOCK)
        sleep(lab.bench.clock, 2.0)
        with pytest.raises(InterlockError):
            zero_rate(lab.bench)
    assert lab.world.table.rate_deg_s() == 0.0
    assert abs(lab.world.value_v("rail_positive")) < 0.1


def test_a_table_that_cannot_be_reached_is_reported_not_safe(open_simulated_bench) -> None:
    with pytest.raises(NotSafe, match="rate_table"), open_simulated_bench() as lab:
        zero_rate(lab.bench)
        lab.fault("rate_table", "unreachable")
