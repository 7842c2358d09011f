"""Limits that only a driver knows: a dry run finds each, and `bench check` names it."""

from __future__ import annotations

import itertools
from functools import partial
from typing import TYPE_CHECKING

import pytest
from hypothesis import given
from hypothesis import strategies as st

from tests.tables.test_profile_file import LEAST
from vcfbench.clock import VirtualClock
from vcfbench.drivers.rate_table.line import TableLine
from vcfbench.errors import LimitError
from vcfbench.models import models_for
from vcfbench.procedures.bench_file import load_bench, parse_bench
from vcfbench.runs.able import what_would_run
from vcfbench.runs.request import dry_run
from vcfbench.station.file import embedded_text
from vcfbench.station.limits import LimitChecks
from vcfbench.station.parts import Limits, RailWiring
from vcfbench.steps import SetRate, SetSine
from vcfbench.testing import ScriptedWire, open_simulated
from vcfbench_tables.configurable import ConfigurableDialect
from vcfbench_tables.profile import parse_profile

if TYPE_CHECKING:
    from collections.abc import Callable
    from pathlib import Path

    from vcfbench.station.description import BenchDescription

WIDE = Limits(max_rate_deg_s=5e3, max_acceleration_deg_s2=5e4, max_v_vc_v=10.0)
UNITS = "rate_quantum = 0.001, rate_max = 100"


def language(units: str) -> ConfigurableDialect:
    return ConfigurableDialect(parse_profile(LEAST.replace(UNITS, units), "lab.toml"))


@given(
    st.sampled_from(["deg/s", "deg/min", "rpm"]),
    st.floats(1e-3, 1e3),
    st.floats(1e-3, 1e6),
    st.floats(1e-3, 1.0),
    st.tuples(st.floats(-5e3, 5e3), st.floats(1e-2, 5e4)),
)
def test_dry_run_refuses_what_the_profile_cannot_turn(
    unit: str, factor: float, most: float, quantum_share: float, motion: tuple[float, float]
) -> None:
    table = language(
        f'rate = "{unit}", velocity_factor = {factor}, rate_quantum = {most * quantum_share}, rate_max = {most}, '
        f"acceleration_min = {most * quantum_share}, acceleration_max = {most}"
    )
    clock = VirtualClock()
    wire = ScriptedWire([], clock=clock, interface="serial")
    line = TableLine(wire, name="rate_table", resource="script://", clock=clock, timeout_s=1.0)
    step, checks = SetRate(*motion, 0.0), LimitChecks(WIDE, RailWiring(), table)
    sent = _refusal(partial(table.motion, line, *motion))
    assert sent.removesuffix(", nothing was sent") == _refusal(partial(step.within, checks))


def with_table(folder: Path, most: float) -> BenchDescription:
    (folder / "own.toml").write_text(
        ("twin = 'acl'" + LEAST).replace(UNITS, f"velocity_factor = 1000, rate_quantum = 1, rate_max = {most}")
    )
    text = embedded_text("ideal").replace('dialect = "acl"', 'dialect = "own.toml"', 1)
    assert "own.toml" in text
    (folder / "lab.toml").write_text(text)
    return load_bench(folder / "lab.toml")


@pytest.mark.exhaustive
def test_profile_that_counts_otherwise_is_found_by_plan_and_check(tmp_path: Path) -> None:
    words = r"a rate of .* is beyond the 0\.1 deg/s of its profile \(units\.rate_max = 100, where 1000 are 1 deg/s\)"
    slow = with_table(tmp_path, 100)
    with pytest.raises(LimitError, match=words + r", step \d+ .* nothing was opened"):
        dry_run("turntable", slow)
    assert "beyond the 0.1 deg/s" in str(what_would_run(slow)["turntable"])
    fast = with_table(tmp_path, 1_000_000)
    assert dry_run("turntable", fast).steps
    assert what_would_run(fast)["turntable"] is None


@pytest.mark.parametrize("model", models_for("rate_source"))
def test_sine_is_refused_by_plan_and_generator_alike(model: str) -> None:
    described = parse_bench(embedded_text("ideal").replace('"33220A"', f'"{model}"'), "lab.toml")
    checks = LimitChecks.of(described)
    with open_simulated(described) as lab:
        source = lab.bench.rate_source
        for peak_v, frequency_hz in itertools.product((5e-4, 2e-3, 0.02, 5.0, 10.0), (10.0, 15e6, 25e6, 5e7)):
            planned = _refusal(partial(SetSine(frequency_hz, peak_v).within, checks))
            assert bool(planned) == bool(_refusal(partial(source.configure_sine, frequency_hz, 2.0 * peak_v)))


def _refusal(act: Callable[[], object]) -> str:
    try:
        act()
    except LimitError as error:
        return error.what
    return ""
