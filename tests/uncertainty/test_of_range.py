"""The scale factor of the range that a device is declared to have, whatever the rates of the run."""

from __future__ import annotations

from typing import Any

import pytest

import vcfbench
from vcfbench.procedures.bench_file import parse_bench
from vcfbench.station.file import embedded_text
from vcfbench.values.value import Value

DECLARED = "\n[gyro]\nrange_deg_s = 200\n[acceptance]\nscale_factor_v_per_deg_s = [-0.012542, -0.012540]\n"


@pytest.fixture(scope="module")
def bench() -> Any:
    return parse_bench(embedded_text("paper") + DECLARED, "declared")


def ran(bench: Any, *rates: float) -> vcfbench.Run:
    settings = {"rates_deg_s": list(rates), "warm_up_s": 1800.0}
    return vcfbench.run("turntable", bench, seed=5, settings=settings, runs=None)


@pytest.mark.exhaustive
def test_declared_range_gives_same_value_for_different_plans(bench: Any) -> None:
    runs = [ran(bench, 200, 100, 0, -100, -200), ran(bench, 220, 150, 30, -80, -190)]
    found = [next(iter(run.values.values())) for run in runs]
    lines = [run.values["scale_factor"].value or 0.0 for run in runs]
    assert {each.kind for each in found} == {"scale_factor_of_range"}
    assert found[0].definition.levels_words == found[1].definition.levels_words == "200, 100, 0, -100, -200 deg/s"
    assert abs(lines[1] / lines[0] - 1.0) > 150e-6

    def stated(value: Value) -> tuple[float, float]:
        assert value.value is not None
        assert value.u95 is not None
        return value.value, value.u95

    (one, u95), (two, wider) = map(stated, found)
    assert one == pytest.approx(lines[0], rel=1e-6)
    assert abs(two - one) < wider
    assert 3e-5 < u95 / abs(one) < wider / abs(two) < 2e-4
    verdicts = [run.verdict for run in runs]
    assert [verdict and verdict.limits[0].value for verdict in verdicts] == [one, two]
    assert "scale factor of the declared range" in str(runs[1].report())


def test_a_plan_that_cannot_bear_the_range_states_none(bench: Any) -> None:
    run = ran(bench, 150, 75, 0, -75, -200)
    assert run.values["scale_factor"].kind == "scale_factor"
    assert "scale_factor_of_range" not in run.values
    assert run.verdict is not None
    assert run.verdict.limits[0].value == run.values["scale_factor"].value
