"""Data sheets within their stated ranges: each gives a bench for all procedures, or is refused with its key."""

from __future__ import annotations

import math
from typing import Any

import pytest
from hypothesis import HealthCheck, assume, example, given, settings
from hypothesis import strategies as st
from msgspec import structs

import vcfbench
from vcfbench.errors import ConfigError
from vcfbench.instructions.titles import BUILT_IN
from vcfbench.procedures.bench_file import parse_bench
from vcfbench.sim.gyro.data_sheet import DataSheet
from vcfbench.sim.own_gyro import own_gyro_bench

KEYS = DataSheet.__struct_fields__
USUAL = structs.asdict(DataSheet())
RANGES = {key: each.__metadata__ for key, each in DataSheet.__annotations__.items()}
KNOWS_K_VC = frozenset({"self-calibration", "online"})


def sizes(low: float, high: float) -> st.SearchStrategy[float]:
    """Both ends, and what is between them by its logarithm."""
    logs = st.floats(math.log(low), math.log(high)).map(lambda each: min(max(math.exp(each), low), high))
    return st.one_of(st.sampled_from((low, high)), logs)


@st.composite
def data_sheets(draw: st.DrawFn) -> dict[str, Any]:
    """Figures within all stated ranges; those of one gyroscope go together more often than by chance."""
    sheet: dict[str, Any] = {}
    for key, (low, high, *either) in RANGES.items():
        size = draw(sizes(low or 1e-3, high))
        sheet[key] = size * draw(st.sampled_from((-1.0, 1.0))) if either else size
    least_q = max(100.0, 2.0 * sheet["drive_hz"] / abs(sheet["split_hz"]))
    most_q = min(1e5, 4.5 * sheet["drive_hz"])
    assume(least_q < most_q)
    sheet["q_sense"] = draw(sizes(least_q, most_q))
    sheet["bias_deg_s"] = draw(st.floats(-0.1, 0.1)) * sheet["range_deg_s"]
    sheet["rails"] = draw(st.sampled_from((1.0, 2.0)))
    share = draw(sizes(0.21, 0.375 * sheet["rails"] * sheet["rail_v"])) / sheet["range_deg_s"]
    sheet["scale_factor_v_per_deg_s"] = math.copysign(share, sheet["scale_factor_v_per_deg_s"])
    noise_deg_s = draw(sizes(1e-7, 1.99e-3)) * sheet["range_deg_s"]
    sheet["angle_random_walk_deg_sqrt_h"] = min(60.0 * noise_deg_s, 100.0)
    sheet["bias_instability_deg_h"] = draw(sizes(1e-3, 2000.0)) * noise_deg_s
    whole_v = draw(sizes(0.41, 8.9))
    sheet["k_vc_deg_s_per_v"] = math.copysign(sheet["range_deg_s"] / whole_v, sheet["k_vc_deg_s_per_v"])
    narrow = draw(st.one_of(st.none(), sizes(0.251, 0.499)))
    sheet["bandwidth_hz"] = None if narrow is None else narrow * abs(sheet["split_hz"])
    return sheet


def dry_runs(sheet: DataSheet, *, imperfections: bool) -> list[str]:
    """What keeps procedures from a bench of such a sheet."""
    bench = parse_bench(own_gyro_bench(sheet, "own", imperfections=imperfections), "own")
    known = {"k_vc": f"{sheet.k_vc_deg_s_per_v!r}", "k_vc_u_deg_s_per_v": 1e-3 * abs(sheet.k_vc_deg_s_per_v)}
    wrong = []
    for name in BUILT_IN:
        try:
            vcfbench.dry_run(name, bench, settings=known if name in KNOWS_K_VC else {})
        except Exception as error:  # noqa: BLE001  # all of them are told
            wrong.append(f"{name}: {type(error).__name__}: {error}")
    return wrong


def require_measurable_or_refused(figures: dict[str, Any], *, imperfections: bool) -> None:
    sheet, refused = None, ""
    try:
        sheet = DataSheet(**figures)
    except ConfigError as error:
        refused = str(error)
    if sheet is None:
        assert refused.split(":")[0] in KEYS, refused
    assume(sheet)
    assert sheet is not None
    assert dry_runs(sheet, imperfections=imperfections) == []


@pytest.mark.exhaustive
@given(data_sheets(), st.booleans())
@settings(max_examples=3, deadline=None, suppress_health_check=[HealthCheck.filter_too_much, HealthCheck.too_slow])
@example({**USUAL, "split_hz": 76.0}, False)  # noqa: FBT003
@example({**USUAL, "k_vc_deg_s_per_v": -150.0}, False)  # noqa: FBT003
@example({**USUAL, "range_deg_s": 100.0, "k_vc_deg_s_per_v": 75.0}, False)  # noqa: FBT003
def test_a_data_sheet_gives_a_bench_for_all_procedures(figures: dict[str, Any], imperfections: bool) -> None:  # noqa: FBT001
    require_measurable_or_refused(figures, imperfections=imperfections)


@pytest.mark.exhaustive
@given(data_sheets(), st.booleans())
@settings(max_examples=100, deadline=None, suppress_health_check=[HealthCheck.filter_too_much, HealthCheck.too_slow])
def test_many_data_sheets_do(figures: dict[str, Any], imperfections: bool) -> None:  # noqa: FBT001
    require_measurable_or_refused(figures, imperfections=imperfections)
