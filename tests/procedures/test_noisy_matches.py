"""V_Vc is matched on a gyroscope whose noise is much of the least rate, and not where it does nothing."""

from __future__ import annotations

import tomllib
from typing import TYPE_CHECKING, Any, cast

import numpy as np
import pytest
from msgspec import structs

from vcfbench.errors import MeasurementError
from vcfbench.procedures.bench_file import checked_bench
from vcfbench.procedures.catalogue import PROCEDURES
from vcfbench.procedures.layers import settings_of
from vcfbench.procedures.null_comparison.plan import nulled
from vcfbench.station.file import embedded_text
from vcfbench.steps import Acquire, Window

if TYPE_CHECKING:
    from vcfbench.procedures.kvc import KVcSettings

SETTINGS = cast("KVcSettings", settings_of(PROCEDURES["kvc"], checked_bench(tomllib.loads(embedded_text("lab")), "")))
RATE_DEG_S, SPAN_V = 10.0, 0.125


def matched(seed: int, noise: float, answers: float = 1.0) -> None:
    """Match one rate with means whose noise is a share of its output; V_Vc moves it by a share of what it should."""
    rng, gyro = np.random.default_rng(seed), SETTINGS.expected_gyro()
    plan = nulled(SETTINGS, [RATE_DEG_S], 1, 4, (1, 2, 3))
    result: Any = None
    while True:
        try:
            step = plan.send(result)
        except StopIteration:
            return
        result = step.predict(gyro)
        if isinstance(step, Acquire) and isinstance(result, Window):
            point = result.point
            rate_deg_s = (
                point.rate_deg_s if step.step == 1 else answers * SETTINGS.k_vc_guess_deg_s_per_v * point.v_vc_v
            )
            output_v = gyro.scale_factor * rate_deg_s + noise * SPAN_V * rng.standard_normal()
            std_v = noise * SPAN_V * np.sqrt(point.n * rng.chisquare(point.n - 1) / (point.n - 1))
            result = structs.replace(result, point=structs.replace(point, output_v=output_v, std_v=float(std_v)))


def test_a_noisy_gyroscope_is_matched() -> None:
    for seed in range(60):
        matched(seed, float(np.random.default_rng(seed).uniform(0.0, 0.05)))


def test_an_output_that_does_not_answer_to_v_vc_is_not() -> None:
    for seed in range(20):
        with pytest.raises(MeasurementError):
            matched(seed, 0.01, answers=0.0)
