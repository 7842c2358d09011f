"""V_Vc that is set alike is read alike, whatever the meter on it does on the way."""

from __future__ import annotations

import tomllib

import numpy as np
import pytest
from msgspec import structs

from vcfbench.errors import MeasurementError
from vcfbench.procedures.bench_file import checked_bench
from vcfbench.procedures.catalogue import PROCEDURES
from vcfbench.procedures.layers import settings_of
from vcfbench.procedures.null_comparison.blocks import levels_of
from vcfbench.records.schema import Point
from vcfbench.station.file import embedded_text

RATES = (10.0, 50.0, 200.0)
KVC = PROCEDURES["kvc"]
SETTINGS = settings_of(KVC, checked_bench(tomllib.loads(embedded_text("lab")), ""))


def driven(rng: np.random.Generator, jump: float, at: int) -> list[list[Point]]:
    """Return two cycles of blocks, whose V_Vc is read larger by the share `jump` from window `at` on."""
    windows = [
        Point(3, sign * rate, sign * rate / 150.0, 0.0, 1e-5, 10)
        for _ in range(2)
        for rate in RATES
        for sign in (0.0, 1.0, -1.0, -1.0, 1.0, 0.0)
    ]
    read = [
        structs.replace(
            each,
            v_vc_measured_v=each.v_vc_v * (1.0 + jump * (place >= at)) + 1e-6 * rng.standard_normal(),
            v_vc_std_v=3e-6,
        )
        for place, each in enumerate(windows)
    ]
    return [read[start : start + 6] for start in range(0, len(read), 6)]


def test_meter_jump_between_readings_of_one_setting_is_refused() -> None:
    for seed in range(40):
        rng = np.random.default_rng(seed)
        jump = float(rng.choice([-1.0, 1.0]) * 10.0 ** rng.uniform(-2.9, -2.0))
        at = int(rng.integers(5, 32))  # before the last window at 200 deg/s
        blocks = driven(rng, jump, at)
        with pytest.raises(MeasurementError, match=r"was set to .* each time and was read from"):
            levels_of(SETTINGS, (), blocks, RATES)


def test_one_that_does_not_is_believed() -> None:
    for seed in range(40):
        levels_v, _ = levels_of(SETTINGS, (), driven(np.random.default_rng(seed), 0.0, 0), RATES)
        assert levels_v[1] == pytest.approx(10.0 / 150.0, abs=5e-6)
