"""What was found and answered, in the commented template."""

from __future__ import annotations

import tomllib
from datetime import date

import pytest
from hypothesis import given
from hypothesis import strategies as st
from simrack_tests.cells import few

from vcfbench.errors import ConfigError
from vcfbench.instructions.titles import BUILT_IN
from vcfbench.procedures.bench_file import parse_bench
from vcfbench.procedures.catalogue import PROCEDURES
from vcfbench.procedures.layers import asked_in_python, settings_of
from vcfbench.station.file import template
from vcfbench.station.new_station import Draft, filled_template

METER = {"model": "34401A", "resource": "GPIB0::22::INSTR"}


def test_filled_template_has_given_values_only() -> None:
    draft = Draft("new.toml")
    draft.add_instrument("multimeter", METER)
    draft.add_instrument("chamber", {"model": "ATS-545", "resource": "GPIB0::18::INSTR"})
    draft.add_instrument("power", {"model": "E3631A", "resource": "ASRL3::INSTR", "serial": {"baud_rate": 4800}})
    draft.change({"multimeter.calibrated": date(2026, 1, 5), "chamber.certificate": "K-1", "title": 'a "good" bench'})
    draft.change({"procedure.turntable": {"samples": 20}, "acceptance.bias_deg_s": [-1, 1]})
    text = draft.text("Written by a test.")
    read = tomllib.loads(text)
    assert {key: value for key, value in read.items() if value != {} and key != "procedure"} | {
        "wiring": {},
        "procedure": {"turntable": {"samples": 20}},
    } == draft.values | {"wiring": {}}
    assert parse_bench(text, "new.toml") is not None
    assert text.startswith("# Written by a test.\n")
    assert "# [rate_source]                           # the virtual rate: V_Vc" in text
    assert "put yours" not in "\n".join(line for line in text.splitlines() if not line.startswith("#"))


@given(st.integers(1, 60))
def test_a_remark_never_touches_the_value_before_it(length: int) -> None:
    template_text = "[procedure]\n# key = 1.0    # a remark\n"
    text = filled_template(template_text, {"procedure": {"key": "v" * length}}, "head")
    assert f'"{"v" * length}" ' in text


def test_every_key_of_the_template_is_still_explained() -> None:
    draft = Draft("new.toml")
    draft.add_instrument("multimeter", METER)
    text = draft.text("x")
    for line in template().splitlines():
        key = line.removeprefix("# ").partition(" = ")[0]
        assert key in text


@given(st.text(st.characters(exclude_categories=["Cc", "Cs", "Zl", "Zp"]), min_size=1, max_size=30))
def test_any_title_comes_back(title: str) -> None:
    text = filled_template(template(), {"name": "x", "title": title, "site": {"latitude_deg": 1.5}}, "head")
    assert tomllib.loads(text)["title"] == title
    assert tomllib.loads(text)["site"] == {"latitude_deg": 1.5}


def test_a_change_that_makes_no_bench_changes_nothing() -> None:
    draft = Draft("new.toml")
    draft.add_instrument("power", {"model": "E3631A", "resource": "GPIB0::5::INSTR"})
    before = dict(draft.values)
    with pytest.raises(ConfigError, match=r"new\.toml: limits\.max_rail_v: expected .*, got 100"):
        draft.change({"limits.max_rail_v": 100})
    with pytest.raises(ConfigError, match=r"limits\.min_rail_v"):
        draft.change({"limits.min_rail_v": 11})
    with pytest.raises(ConfigError, match="a resource of its own, not that of power"):
        draft.add_instrument("multimeter", {**METER, "resource": "GPIB0::5::INSTR"})
    assert draft.values == before


def test_limits_come_with_what_they_limit() -> None:
    draft = Draft("new.toml")
    draft.add_instrument("multimeter", METER)
    assert draft.value("limits") is None
    draft.add_instrument("rate_table", {"dialect": "acl", "resource": "COM3"})
    assert draft.value("limits") == {"max_rate_deg_s": 50.0, "max_acceleration_deg_s2": 50.0}


ALL = {
    "power": {"model": "E3631A", "resource": "GPIB0::5::INSTR"},
    "rate_source": {"model": "33220A", "resource": "GPIB0::10::INSTR"},
    "multimeter": METER,
    "v_vc_meter": {"model": "34401A", "resource": "GPIB0::23::INSTR"},
    "vibration_source": {"model": "33220A", "resource": "GPIB0::11::INSTR"},
    "oscilloscope": {"model": "DSO7104B", "resource": "GPIB0::7::INSTR"},
    "rate_table": {"dialect": "acl", "resource": "COM3"},
    "chamber": {"model": "ATS-545", "resource": "GPIB0::18::INSTR"},
}


@pytest.mark.parametrize("limit_deg_s", few([5.0, 8.0, 20.0, 50.0, 75.0, 120.0, 199.0, 200.0, 300.0], every=3))
def test_no_procedure_leaves_the_rates_that_a_new_bench_allows(limit_deg_s: float) -> None:
    draft = Draft("new.toml")
    for role, keys in ALL.items():
        draft.add_instrument(role, keys)
    draft.set({"limits.max_rate_deg_s": limit_deg_s})
    bench = parse_bench(draft.text("Written by a test."), "new.toml")
    for name in BUILT_IN:
        settings_of(
            PROCEDURES[name], bench, asked_in_python({"k_vc": "150"} if name in {"self-calibration", "online"} else {})
        )
