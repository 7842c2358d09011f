"""Where settings come from, and what goes before what."""

from __future__ import annotations

from datetime import timedelta
from typing import TYPE_CHECKING, Annotated, Any

import pytest
from msgspec import Meta, structs

import vcfbench
from vcfbench.cli.set_option import asked_by_command
from vcfbench.clock import utc_now
from vcfbench.errors import ConfigError
from vcfbench.procedures.bench_file import parse_bench
from vcfbench.procedures.catalogue import PROCEDURES
from vcfbench.procedures.keys import settable_keys
from vcfbench.procedures.layers import asked_in_python, recorded_settings, settings_of, with_settings
from vcfbench.procedures.turntable import TURNTABLE
from vcfbench.procedures.virtual_coriolis.plan import VIRTUAL_CORIOLIS
from vcfbench.station.file import embedded_text
from vcfbench.station.layering import setting_keys
from vcfbench.station.settings import Match
from vcfbench.steps import Note, Plan

if TYPE_CHECKING:
    from vcfbench.station.description import BenchDescription


class LoopSettings(vcfbench.ProcedureSettings, frozen=True, kw_only=True):
    samples: int = 30
    loops: Annotated[int, Meta(ge=1, le=9, description="times up and down")] = 1
    quick: bool = False


def plan(_settings: LoopSettings) -> Plan:
    yield Note("nothing")


LOOP = vcfbench.Procedure(
    name="loop", title="Go up and down.", settings=LoopSettings, plan=plan, results=lambda _s, _p: {}
)


def bench(*lines: str) -> BenchDescription:
    tables = "\n".join(lines)
    return parse_bench(embedded_text("ideal").replace("[procedure.drive]", f"{tables}\n[procedure.drive]"), "lab.toml")


def refusal(call: Any) -> str:
    with pytest.raises(ConfigError) as caught:
        call()
    return str(caught.value)


def test_each_place_goes_before_the_one_above_it() -> None:
    lab = bench("[procedure]", "samples = 3", "settle_s = 3", "[procedure.turntable]", "samples = 4", "nplc = 1")
    chosen = settings_of(TURNTABLE, lab, asked_in_python({"samples": 5}))
    assert (chosen.rail_tolerance_v, chosen.settle_s, chosen.nplc, chosen.samples) == (0.1, 3.0, 1, 5)
    assert settings_of(TURNTABLE, lab).samples == 4
    assert settings_of(VIRTUAL_CORIOLIS, lab).samples == 3
    assert settings_of(VIRTUAL_CORIOLIS, lab).nplc == 10


def test_bench_file_overrides_procedures_default() -> None:
    assert settings_of(LOOP, bench()).samples == 30
    assert settings_of(LOOP, bench("[procedure]", "samples = 7")).samples == 7
    assert settings_of(LOOP, bench("[procedure]", "samples = 7", "[procedure.loop]", "samples = 8")).samples == 8


def test_tables_within_are_merged() -> None:
    lab = bench("[procedure.turntable.drive]", "start_up_s = 7")
    drive = settings_of(TURNTABLE, lab, asked_in_python({"drive": {"phase_deg": (0, 100)}})).drive
    assert (drive.start_up_s, drive.phase_deg) == (7.0, (0.0, 100.0))
    assert drive.amplitude_v == settings_of(VIRTUAL_CORIOLIS, lab).drive.amplitude_v


def test_old_bench_files_keep_procedure_keys_among_common_ones() -> None:
    lab = bench("[procedure]", "match_rate_deg_s = 20", 'match = "absolute"', "k_vc_guess_deg_s_per_v = 40")
    chosen = settings_of(VIRTUAL_CORIOLIS, lab)
    assert (chosen.match_rate_deg_s, chosen.match, chosen.k_vc_guess_deg_s_per_v) == (20.0, Match.ABSOLUTE, 40.0)
    assert settings_of(TURNTABLE, lab).k_vc_guess_deg_s_per_v == 40.0


@pytest.mark.parametrize(
    ("lines", "said"),
    [
        (["[procedure]", "sample = 3"], "procedure.sample: expected a known key ('samples'?), got an unknown key"),
        (["[procedure]", "loops = 3"], "procedure.loops: expected"),
        (["[procedure]", 'match = "nearly"'], "procedure.match: expected 'zero' or 'absolute', got 'nearly'"),
        (["[procedure]", "match_rate_deg_s = 400"], "procedure.match_rate_deg_s: expected a rate of at most 300"),
        (["[procedure.turntable]", "sample = 3"], "procedure.turntable.sample: expected a known key ('samples'?)"),
        (["[procedure.turntable]", "match = 3"], "procedure.turntable.match: expected"),
        (["[procedure.turntable]", "rates_deg_s = [1, 2, 400]"], "procedure.turntable.rates_deg_s[2]: expected a rate"),
        (["[procedure.turntable]", "station = 3"], "procedure.turntable.station: expected one of"),
        (["[procedure.turntabel]", "samples = 3"], "procedure.turntabel: expected a known key ('turntable'?)"),
        (["[procedure]", "turntable = 3"], "procedure.turntable: expected a table, got 3"),
        (["[procedure]", "station = 3"], "procedure.station: expected"),
    ],
)
def test_what_cannot_be_is_one_line_with_file_and_key(lines: list[str], said: str) -> None:
    assert refusal(lambda: bench(*lines)).startswith(f"lab.toml: {said}")


def test_table_of_a_custom_procedure_is_checked_when_run() -> None:
    lab = bench("[procedure.loop]", "loops = 10")
    assert settings_of(TURNTABLE, lab).samples == 10
    said = refusal(lambda: settings_of(LOOP, lab, source="lab.toml"))
    assert said == "lab.toml: procedure.loop.loops: expected a whole number at least 1 and at most 9, got 10"


def test_impossible_default_is_named_with_its_place() -> None:
    text = embedded_text("ideal").replace("max_rate_deg_s = 300", "max_rate_deg_s = 9")
    slow = parse_bench(text, "lab.toml")  # another rate may be asked for
    said = refusal(lambda: settings_of(TURNTABLE, slow, source="lab.toml"))
    assert said.startswith("lab.toml: procedure.rates_deg_s[0]: expected a rate of at most 9 deg/s either way")
    assert said.endswith("got 200.0, the default; set rates_deg_s in [procedure] of the bench file")
    assert settings_of(TURNTABLE, slow, asked_in_python({"rates_deg_s": [9, 0, -9]})).fastest_deg_s == 9.0
    lab = parse_bench(text.replace("[procedure.drive]", "[procedure]\nrates_deg_s = [5, 0, -5]\n[procedure.drive]"), "")
    assert settings_of(TURNTABLE, lab).rates_deg_s == (5.0, 0.0, -5.0)
    said = refusal(lambda: settings_of(VIRTUAL_CORIOLIS, lab, source="lab.toml"))
    assert said.startswith("lab.toml: procedure.match_rate_deg_s: expected a rate of at most 9 deg/s")


def test_the_bench_is_opened_with_what_was_chosen() -> None:
    chosen = settings_of(TURNTABLE, bench(), asked_in_python({"acceleration_deg_s2": 20}))
    opened = with_settings(bench(), chosen)
    assert opened.procedure.acceleration_deg_s2 == 20.0
    assert settings_of(TURNTABLE, opened) == chosen


NEEDED = {name: ['k_vc="150"'] for name in ("online", "self-calibration")}
"""What procedures cannot do without."""


@pytest.mark.parametrize("name", PROCEDURES)
def test_key_accepts_its_default_and_is_explained(name: str) -> None:
    kind = PROCEDURES[name].settings
    keys = list(settable_keys(kind))
    assert {key.path.partition(".")[0] for key in keys} == set(setting_keys(kind))
    assert all(key.meaning and key.expected for key in keys)
    needed = NEEDED.get(name, [])
    asked = asked_by_command([*(f"{key.path}={key.default}" for key in keys if key.default), *needed], {}, {})
    default = settings_of(PROCEDURES[name], bench(), asked_by_command(needed, {}, {}))
    assert settings_of(PROCEDURES[name], bench(), asked).station == default.station
    assert asked.values["drive"]["start_up_s"] == 5.0


@pytest.mark.parametrize("name", PROCEDURES)
def test_settings_come_back_from_a_record(name: str) -> None:
    import msgspec  # noqa: PLC0415

    description = bench("[acceptance]", "bias_v = [-1, 1]", "[procedure]", "samples = 3")
    chosen = settings_of(PROCEDURES[name], description, asked_by_command(NEEDED.get(name, []), {}, {}))
    written = msgspec.json.decode(msgspec.json.encode(msgspec.to_builtins(chosen)))
    assert recorded_settings(PROCEDURES[name], written) == chosen


@pytest.mark.parametrize("name", ["", "a.b", "a/b", "drive", "samples", "x" * 65])
def test_a_name_that_no_table_can_have_is_refused(name: str) -> None:
    with pytest.raises(ConfigError, match="procedure"):
        vcfbench.Procedure(name=name, title="Loops.", settings=LoopSettings, plan=plan, results=lambda _s, _p: {})


def on_day(days: float, stated: float | None = None) -> BenchDescription:
    """Return a bench whose multimeter was calibrated so many days ago."""
    lab = bench()
    assert lab.multimeter is not None
    meter = structs.replace(lab.multimeter, calibrated=utc_now().date() - timedelta(days=days))
    return structs.replace(lab, multimeter=meter, uncertainty=structs.replace(lab.uncertainty, meter_age_days=stated))


@pytest.mark.parametrize(("days", "gain"), [(1, 15e-6), (80, 20e-6), (91, 35e-6), (730, 70e-6)])
def test_meter_limits_follow_day_of_calibration(days: int, gain: float) -> None:
    """34401A, 10 V, User's Guide p. 216: 24 hours, 90 days, a year; beyond, its limits are taken to grow on."""
    known = settings_of(TURNTABLE, on_day(days)).station.sources
    assert known.meter_age_days == days
    assert known.meter_gain == pytest.approx(gain)
    said = known.meter_age_from
    assert said.startswith(f"calibrated {utc_now().date() - timedelta(days=days)}")
    assert ("assumed to grow" in said) == (days > 365)


def test_stated_age_overrides_day_of_calibration() -> None:
    known = settings_of(TURNTABLE, on_day(800, stated=90.0)).station.sources
    assert known.meter_age_days == 90.0
    assert known.meter_age_from.startswith("uncertainty.meter_age_days; room assumed")
    assert known.meter_gain == pytest.approx(20e-6)
    usual = settings_of(TURNTABLE, bench()).station.sources
    assert (usual.meter_age_days, usual.meter_gain) == (365.0, pytest.approx(35e-6))
    assert usual.meter_age_from.startswith("assumed")


@pytest.mark.parametrize("days", [0, -1])
def test_a_meter_calibrated_today_or_where_it_is_tomorrow_has_no_age(days: int) -> None:
    assert settings_of(TURNTABLE, on_day(days)).station.sources.meter_age_days == 0.0


def test_ages_that_cannot_be_are_refused() -> None:
    assert "multimeter.calibrated: expected a day that is past" in refusal(lambda: settings_of(TURNTABLE, on_day(-3)))
    old = refusal(lambda: settings_of(TURNTABLE, on_day(0, stated=800.0)))
    assert old == "uncertainty.meter_age_days: at most 365 days after calibration: a 34401A has no limits beyond"


@pytest.mark.parametrize(("procedure", "counts"), [("zero", "powered_s"), ("warmup", "shortest_s")])
def test_wait_that_does_not_count_is_refused(procedure: str, counts: str) -> None:
    said = rf"warm_up_s: expected {counts}, which counts here and is 1800 s, got 100"
    with pytest.raises(ConfigError, match=said):
        vcfbench.dry_run(procedure, settings={"warm_up_s": 100.0})
    bench = vcfbench.load_bench()
    shared = structs.replace(bench, procedure_table={**bench.procedure_table, "warm_up_s": 100.0})
    vcfbench.dry_run(procedure, shared)
    vcfbench.dry_run(procedure, settings={"warm_up_s": 2000.0, counts: 2000.0})


@pytest.mark.parametrize(
    ("asked", "nested"),
    [
        ({"settings": {"drive.start_up_s": 8}}, "{'drive': {'start_up_s': ...}}"),
        ({"metadata": {"tags.batch": "7"}}, "{'tags': {'batch': ...}}"),
    ],
)
def test_a_dotted_key_in_python_is_told_as_a_mapping(asked: dict[str, Any], nested: str) -> None:
    assert f"in Python a table is a mapping, {nested}" in refusal(lambda: vcfbench.dry_run("turntable", **asked))


@pytest.mark.parametrize("key", ["samples.", "kvc.samples", "."])
def test_a_dotted_key_of_no_table_is_an_unknown_one(key: str) -> None:
    assert refusal(lambda: vcfbench.dry_run("turntable", settings={key: 3})).endswith("got an unknown key")
