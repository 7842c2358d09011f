"""A number that was told wrongly costs minutes, not the half hour of the warm-up or the record by it."""

from __future__ import annotations

import json
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from msgspec import structs

import vcfbench
from vcfbench.errors import MeasurementError
from vcfbench.steps import Note
from vcfbench.testing.gyroscopes import drawn_bench, drawn_sheet

TRUE = -0.0125527
LONG: dict[str, dict[str, Any]] = {
    "zero": {"powered_s": 10.0},
    "warmup": {},
    "power": {},
    "rate-limits": {},
    "repeatability": {},
    "g-sensitivity": {},
    "temperature": {},
    "turntable": {"warm_up_s": 1800.0},
    "virtual-coriolis": {"warm_up_s": 1800.0},
    "kvc": {"warm_up_s": 1800.0},
    "self-calibration": {"k_vc": "150", "warm_up_s": 1800.0},
    "online": {"k_vc": "150"},
}
BY_EXPECTED = {"turntable", "virtual-coriolis", "kvc", "self-calibration", "online"}
"""Procedures without a setting for it."""
BY_V_VC = {"g-sensitivity", "temperature", "self-calibration", "online"}
EARLY_S = 150.0


def waited_s(name: str, value: float, *, expected: bool) -> float:
    """Return the bench time at which a run by `value` is refused, s; 0 before anything is opened."""
    bench = vcfbench.load_bench("lab")
    window = (min(0.99 * value, 1.01 * value), max(0.99 * value, 1.01 * value)) if expected else None
    known = structs.replace(bench.expected, scale_factor_v_per_deg_s=window, k_vc_deg_s_per_v=(140.0, 160.0))
    asked = {} if expected else {"scale_factor_v_per_deg_s": value}
    bench = structs.replace(bench, expected=known)
    with TemporaryDirectory() as runs:
        with pytest.raises(MeasurementError, match=r"cannot be|sign of the scale factor|the scale factor is"):
            vcfbench.run(name, bench, settings={**LONG[name], **asked}, runs=runs)
        (journal,) = Path(runs).rglob("journal.jsonl")
        lines = map(json.loads, journal.read_text(encoding="utf-8").splitlines())
        return max(float(each.get("end_s", 0.0)) for each in lines)


@settings(max_examples=4, deadline=None)
@given(
    name=st.sampled_from(sorted(LONG)),
    off=st.one_of(st.floats(-3.0, -0.3), st.floats(0.2, 0.75), st.floats(1.4, 5.0)),
    expected=st.booleans(),
)
def test_scale_factor_wrongly_told_ends_before_the_wait(name: str, off: float, *, expected: bool) -> None:
    assert waited_s(name, off * TRUE, expected=expected or name in BY_EXPECTED) < EARLY_S


@pytest.mark.parametrize("name", LONG)
def test_early_look_comes_before_the_wait(name: str) -> None:
    bench = vcfbench.load_bench("lab")
    known = structs.replace(bench.expected, scale_factor_v_per_deg_s=(-0.0135, -0.0115))
    told = structs.replace(bench, expected=known)
    steps = vcfbench.dry_run(name, told, settings=LONG[name]).steps
    assert next(each.t_s for each in steps if each.step == Note("Does the output answer?")) < EARLY_S
    assert max(each.t_s for each in steps) > 10.0 * EARLY_S


@settings(max_examples=6, deadline=None)
@given(seed=st.sampled_from([0, 2, 11, 22, 62, 67, 104, 125, 172, 184]), off=st.sampled_from([0.85, 1.18]))
def test_k_vc_15_percent_off_is_refused_with_quadrature(seed: int, off: float) -> None:
    with TemporaryDirectory() as files:
        bench = Path(files) / "bench.toml"
        bench.write_text(drawn_bench(seed), encoding="utf-8")
        with pytest.raises(MeasurementError, match=f"told is {off * drawn_sheet(seed).k_vc_deg_s_per_v:g}"):
            vcfbench.run("online", bench, settings={"k_vc": repr(off * drawn_sheet(seed).k_vc_deg_s_per_v)}, runs=files)
