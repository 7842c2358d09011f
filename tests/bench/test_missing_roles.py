"""Benches that have not every instrument: what is missing need not be described, and nothing else is any different."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from msgspec import structs

from vcfbench.bench.bench import open_bench
from vcfbench.bench.check import check_bench
from vcfbench.bench.ground import station
from vcfbench.bench.make_safe import safe_bench
from vcfbench.errors import BenchError, ConfigError, LimitError
from vcfbench.procedures.bench_file import load_bench, parse_bench
from vcfbench.procedures.catalogue import PROCEDURES
from vcfbench.procedures.layers import settings_of
from vcfbench.sim.inventory import inventory
from vcfbench.station.consistency import LIMITS_OF, invalid_values
from vcfbench.station.description import BenchDescription, VisaRole
from vcfbench.station.limits import LimitChecks
from vcfbench.station.parts import Limits
from vcfbench.station.writing import bench_text
from vcfbench.testing import serve_simulated

if TYPE_CHECKING:
    from pathlib import Path

ALL = ("power", "rate_source", "multimeter", "oscilloscope", "rate_table")
DRIVES = ("power", "rate_source", "rate_table")
PAPER = load_bench(None)


def bench_with(*roles: str) -> BenchDescription:
    """The paper's bench with these roles alone, and with the limits that they need."""
    keys = {key for role in roles for key in LIMITS_OF.get(role, ())}
    limits = Limits(**{key: getattr(PAPER.limits, key) for key in keys})
    changes: dict[str, Any] = {"limits": limits, **{role: None for role in ALL if role not in roles}}
    return structs.replace(PAPER, **changes)


SMALL = bench_with("power", "rate_source", "multimeter")


@pytest.fixture(autouse=True)
def _locks(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("VCFBENCH_LOCKS", str(tmp_path))


@given(st.sets(st.sampled_from(ALL), min_size=1))
def test_any_subset_of_roles_survives_its_bench_file(roles: set[str]) -> None:
    bench = bench_with(*roles)
    assert list(invalid_values(bench)) == []
    assert parse_bench(bench_text(bench), "lab.toml") == bench


@settings(max_examples=12, deadline=None)
@given(st.sets(st.sampled_from(ALL), min_size=1))
def test_what_is_there_is_opened_checked_and_made_safe(roles: set[str]) -> None:
    bench = bench_with(*roles)
    there = [role for role in ALL if role in roles]
    with open_bench(bench) as opened:
        assert list(opened.identities) == list(opened.instruments) == there
    assert sorted(report.instrument for report in opened.safe_reports) == sorted(there)
    assert all(report.safe for report in opened.safe_reports)
    done = check_bench(bench)
    assert [each.role for each in done.instruments] == there
    assert done.failure() is None
    safe = safe_bench(bench)
    assert {each.role for each in safe.instruments} == {role for role in DRIVES if role in roles}
    assert safe.failure() is None
    errors = {row.path.split(".")[1] for row in inventory(bench) if row.path.startswith("errors.")}
    assert errors == roles


def test_a_bench_without_instruments_is_refused() -> None:
    with pytest.raises(ConfigError, match=r"lab\.toml: power: expected at least one instrument: power, rate_source"):
        parse_bench('name = "lab"\n[site]\nlatitude_deg = 37.9\n', "lab.toml")


@pytest.mark.parametrize(("role", "key"), [(role, key) for role, keys in LIMITS_OF.items() for key in keys])
def test_what_drives_something_has_its_limits(role: str, key: str) -> None:
    role = "rate_source" if role == "vibration_source" else role
    bench = bench_with(role)
    if role == "chamber":
        part = VisaRole(model="ATS-545", resource="GPIB0::18::INSTR")
        limits = Limits(min_temperature_c=0.0, max_temperature_c=60.0, max_ramp_k_min=60.0)
        bench = structs.replace(bench, chamber=part, limits=limits)
    bench = structs.replace(bench, limits=structs.replace(bench.limits, **{key: None}))
    with pytest.raises(ConfigError, match=rf"lab: limits\.{key}: expected a limit for the {role} of this bench, got n"):
        parse_bench(bench_text(bench), "lab")


def test_limit_of_missing_instrument_is_checked_if_given() -> None:
    text = bench_text(SMALL).replace("[limits]", "[limits]\nmax_rate_deg_s = 100")
    with pytest.raises(ConfigError, match=r"procedure\.rates_deg_s\[0\]: expected a rate of at most 100 deg/s"):
        settings_of(PROCEDURES["turntable"], parse_bench(text, "lab"))


def test_the_drive_need_be_wired_to_an_oscilloscope_only() -> None:
    wiring = structs.replace(PAPER.wiring.oscilloscope, channel_1=None)
    unwired = structs.replace(PAPER, wiring=structs.replace(PAPER.wiring, oscilloscope=wiring))
    assert [each.path for each in invalid_values(unwired)] == ["wiring.oscilloscope"]
    assert list(invalid_values(structs.replace(unwired, oscilloscope=None))) == []


@pytest.mark.parametrize("role", ["rate_table", "oscilloscope", "vibration_source"])
def test_missing_instrument_error_names_table_of_bench_file(role: str) -> None:
    said = rf"{role}: bench paper has none; its bench file needs a table \[{role}\]"
    with open_bench(SMALL) as bench, pytest.raises(ConfigError, match=said) as caught:
        getattr(bench, role)
    assert caught.value.exit_code == 2
    with pytest.raises(ConfigError, match=said):
        open_bench(SMALL, needs=["power", role])


def test_what_only_measures_is_opened_when_it_is_needed() -> None:
    with open_bench(PAPER, needs=["multimeter"]) as bench:
        assert list(bench.instruments) == ["power", "rate_source", "multimeter", "rate_table"]
        with pytest.raises(ConfigError, match=r"oscilloscope: it was not opened, .* name it in the `needs`"):
            assert bench.oscilloscope
    assert len(bench.safe_reports) == 4


def test_what_is_not_needed_is_left_to_others() -> None:
    """An oscilloscope that somebody else has keeps no bench from being opened that does not need it."""
    with serve_simulated(PAPER) as lab:
        real = structs.replace(lab.on_wires(), served=None)
        with station(real, None, None, roles=["oscilloscope"]):
            with pytest.raises(BenchError, match="oscilloscope at"):
                open_bench(real)
            with open_bench(real, needs=["multimeter"]) as bench:
                assert "oscilloscope" not in bench.instruments


def test_missing_table_has_no_limits() -> None:
    checks = LimitChecks.of(SMALL)
    checks.v_vc(5.0)
    with pytest.raises(LimitError, match=r"it is refused \(limits\.max_rate_deg_s\)"):
        checks.rate(0.0)


def test_a_served_bench_without_a_table_is_led_over_tcp() -> None:
    with serve_simulated(SMALL, seed=3) as lab:
        assert set(lab.wires) == {"power", "rate_source", "multimeter"}
        with open_bench(lab.on_wires()) as bench:
            assert bench.seed == 3
            bench.multimeter.configure_dc_voltage(10.0, 10.0)
            over_tcp = bench.multimeter.read_voltage_v()
    with open_bench(SMALL, seed=3) as bench:
        bench.multimeter.configure_dc_voltage(10.0, 10.0)
        assert bench.multimeter.read_voltage_v() == over_tcp
