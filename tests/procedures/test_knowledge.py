"""Less knowledge never gives a smaller uncertainty: what a bench file leaves out is assumed, or missing and said so."""

from __future__ import annotations

import math
import re
import tomllib
from datetime import date
from functools import cache
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import TYPE_CHECKING, Any

import numpy as np
import pytest
from simrack_tests.cells import few
from typer.testing import CliRunner

import vcfbench
from vcfbench.archive.results import evaluate
from vcfbench.cli.main import app
from vcfbench.errors import ConfigError
from vcfbench.procedures.bench_file import checked_bench, parse_bench
from vcfbench.procedures.catalogue import PROCEDURES
from vcfbench.procedures.layers import asked_in_python, meter_worth, settings_of
from vcfbench.records.plain import plain
from vcfbench.records.stated import values_of
from vcfbench.specifications import HP_34401A, KEITHLEY_DMM6500
from vcfbench.station.file import embedded_text
from vcfbench.station.parts import CalibrationPoint
from vcfbench.station.settings import MeterKnown
from vcfbench.steps.measured import Measured

if TYPE_CHECKING:
    from collections.abc import Iterator

    from vcfbench.values.value import Value

ROOT = Path(__file__).parents[2]
COVERAGE = 1e-6
"""What a coverage factor by convolution is computed to: a sum of one more source is never narrower."""
OF_FREEDOM = 1e-5
"""One more source takes so much off the factor of few degrees of freedom, after Welch and Satterthwaite."""
OF_TRIALS = 0.02
"""What a 95 % quantile of 2000 trials is known to: by them goes U95 of a non-linearity of several like residuals."""
LATITUDE = ("--set", "site.latitude_deg=48.1")
OF_INSTRUMENTS = ("power", "rate_source", "multimeter", "v_vc_meter", "oscilloscope", "rate_table")


@cache
def by_wizard() -> str:
    """Return the file that the wizard makes of what it proposes."""
    with TemporaryDirectory() as directory:
        file = Path(directory) / "station.toml"
        done = CliRunner().invoke(app, ["bench", "new", str(file), "--yes", "--library", "paper@vcfbench", *LATITUDE])
        assert done.exit_code == 0, done.stderr
        return file.read_text("utf-8")


def shipped() -> dict[str, str]:
    """Return the text of each bench file that the program, its examples or its documentation have."""
    how_to = (ROOT / "docs/howto/acceptance.md").read_text("utf-8")
    written = re.search(r"```toml title=\"station.toml\"\n(.*?)```", how_to, re.DOTALL)
    assert written is not None
    files = {each.stem: each.read_text("utf-8") for each in sorted((ROOT / "examples").glob("*.toml"))}
    return {
        **files,
        "how-to": written[1],
        "wizard": by_wizard(),
        **{name: embedded_text(name) for name in ("paper", "lab", "ideal")},
    }


OTHER_THAN_0 = {
    "temperature_k": 1.0,
    "carrier_phase_deg": 0.5,
    "demodulator_phase_deg": 0.5,
    "bias_deg_s_demodulator_deg": 0.3,
    "misalignment_deg": 0.5,
    "k_vc_ppm_demodulator_deg": 50.0,
}
"""A bench whose values are not those of its run: a 0 that is taken away can make nothing smaller."""


def less(values: dict[str, Any]) -> Iterator[tuple[str, dict[str, Any]]]:
    """Yield what is left of a bench file without one key of its knowledge or of its equipment."""
    for table in ("uncertainty", *OF_INSTRUMENTS):
        for key in values.get(table, {}):
            if key in {"model", "resource", "dialect"}:  # what it is: without, there is no instrument
                continue
            yield f"{table}.{key}", {**values, table: {k: v for k, v in values[table].items() if k != key}}
    if "uncertainty" in values:
        yield "uncertainty", {key: value for key, value in values.items() if key != "uncertainty"}


@cache
def run_of(name: str) -> vcfbench.Run:
    quick = {"samples": 3, "sample_interval_s": 0.5, "settle_s": 0.5, "rates_deg_s": (100.0, 10.0, 0.0, -10.0, -100.0)}
    benches = {"turntable": "paper", "virtual-coriolis": "paper", "virtual-coriolis, measured": "lab"}
    return vcfbench.run(name.partition(",")[0], bench=benches[name], settings=quick, runs=None, seed=1)


def stated(values: dict[str, Any], run: vcfbench.Run) -> Any:
    """Return the statement that the points of `run` come to on another bench."""
    procedure = PROCEDURES[run.procedure]
    description = checked_bench(values, "less.toml")
    return procedure.results(settings_of(procedure, description), Measured(run.points)).uncertainty


NAMES = ("how-to", "ideal", "lab", "paper", "field-bench", "ideal-bench", "paper-bench", "wizard")


def test_all_that_are_shipped_are_here() -> None:
    assert {*shipped()} == {*NAMES}


@pytest.mark.parametrize("kind", few(["turntable", "virtual-coriolis", "virtual-coriolis, measured"], "turntable"))
@pytest.mark.parametrize("known", [{}, OTHER_THAN_0], ids=["its own", "other than 0"])
@pytest.mark.parametrize("name", few(NAMES, "lab"))
def test_no_uncertainty_shrinks_where_a_key_is_taken_away(name: str, kind: str, known: dict[str, float]) -> None:
    values, run = tomllib.loads(shipped()[name]), run_of(kind)
    values["uncertainty"] = {**values.get("uncertainty", {}), **known}
    full = {each.name: each for each in stated(values, run).values}
    for key, fewer in less(values):
        found = stated(fewer, run)
        for each in found.values:
            before = full.get(each.name)
            known_to = OF_TRIALS if each.name.endswith("nonlinearity") else COVERAGE
            assert before is None or each.u95 >= before.u95 * (1.0 - known_to), (key, each.name)
            assert before is None or {*before.missing} <= {*each.missing}, (key, each.name)


OTHERS: dict[str, dict[str, Any]] = {
    "kvc": {"match_rates_deg_s": [20.0, 100.0, 200.0], "cycles": 1, "samples": 4},
    "self-calibration": {"k_vc": "150", "cycles": 1, "samples": 4},
    "online": {"k_vc": "150"},
    "temperature": {"temperatures_c": [20.0, 25.0, 30.0]},
    "g-sensitivity": {"samples": 4, "cycles": 1, "warm_up_s": 60.0, "turn_s": 5.0},
    **{name: {} for name in ("zero", "warmup", "rate-limits", "threshold", "power", "repeatability", "vibration")},
    "phase": {},
}


@pytest.mark.parametrize("name", few(OTHERS, "g-sensitivity"))
def test_nor_does_that_of_any_other_procedure(name: str, tmp_path: Path) -> None:
    procedure, asked = PROCEDURES[name], asked_in_python(OTHERS[name])
    measured = vcfbench.run(name, "lab", settings=OTHERS[name], runs=tmp_path, seed=1).measured
    values = tomllib.loads(embedded_text("lab"))
    values["uncertainty"] |= OTHER_THAN_0

    def found(bench: dict[str, Any]) -> dict[str, Value]:
        return values_of(procedure.results(settings_of(procedure, checked_bench(bench, ""), asked), measured))

    full = found(values)
    for key, fewer in less(values):
        for value, after in found(fewer).items():
            before = full.get(value)
            if before is not None and before.form == after.form:
                widths = [each.high if each.u95 is None else each.u95 for each in (before, after)]
                assert widths[0] is None or (widths[1] or 0.0) >= widths[0] * (1.0 - OF_FREEDOM), (key, value)
                assert {*before.missing} <= {*after.missing}, (key, value)


@pytest.mark.parametrize("name", ["paper", "lab", "ideal"])
def test_what_is_embedded_is_complete(name: str) -> None:
    found = stated(tomllib.loads(embedded_text(name)), run_of("turntable"))
    assert (found.complete, found.missing) == (True, ())


def test_empty_uncertainty_table_gives_wide_u95_with_assumptions() -> None:
    run = run_of("turntable")
    told, silent = (stated(tomllib.loads(shipped()[name]), run) for name in ("paper", "how-to"))
    for before, after in zip(told.values[:3], silent.values[:3], strict=True):
        assert after.u95 > 5.0 * before.u95
    assert silent.complete
    assert sum("assumed" in each for each in silent.known_from) >= 12, silent.known_from
    assert plain(silent)["missing"] == []
    assert not [each for each in silent.not_in_u if each.startswith("MISSING")]


CERTIFICATE = """
[[multimeter.calibration]]
range_v = 10
level_v = 0
correction_v = 20e-6
expanded_v = 10e-6

[[multimeter.calibration]]
range_v = 10
level_v = 10
correction_v = 220e-6
expanded_v = 40e-6

[[multimeter.calibration]]
range_v = 10
level_v = -10
correction_v = -180e-6
expanded_v = 40e-6
"""


@pytest.mark.parametrize(
    ("key", "value"), [("correction_v", 0.12), ("correction_v", -0.12), ("expanded_v", 0.04), ("correction_v", 20e-3)]
)
def test_a_certificate_in_mv_is_refused_as_the_file_is_read(key: str, value: float) -> None:
    known = tomllib.loads(embedded_text("paper") + CERTIFICATE)
    known["multimeter"]["calibration"][1][key] = value
    with pytest.raises(
        ConfigError, match=rf"multimeter\.calibration\[1\]\.{key}: expected at most 0\.004\d* V, .*mV\?"
    ):
        checked_bench(known, "")


def test_a_correction_beyond_the_data_sheet_is_told() -> None:
    known = tomllib.loads(embedded_text("paper") + CERTIFICATE)
    known["multimeter"]["calibration"][1]["correction_v"] = 1e-3
    settings = settings_of(PROCEDURES["turntable"], checked_bench(known, ""))
    assert "CORRECTED at 10 V by 2.5 limits of the data sheet" in settings.station.sources.meter_age_from


@pytest.mark.parametrize(
    ("table", "key", "value", "said"),
    [
        ("multimeter", "calibrated", date(2200, 1, 15), "multimeter.calibrated: expected a day that is past"),
        ("uncertainty", "meter_age_days", 2026, "uncertainty.meter_age_days: at most 365 days"),
    ],
)
def test_what_no_run_could_use_is_refused_as_the_file_is_read(table: str, key: str, value: Any, said: str) -> None:
    known = tomllib.loads(embedded_text("paper"))
    known[table][key] = value
    with pytest.raises(ConfigError, match=said):
        checked_bench(known, "")


def test_certificate_corrects_readings_and_replaces_data_sheet() -> None:
    """Its gain of 20 ppm and offset of 20 uV are added; u is its own and the drift since by the data sheet."""
    run, text = run_of("turntable"), embedded_text("paper")
    known = tomllib.loads(text + CERTIFICATE)
    plain_run, certified = (
        evaluate(PROCEDURES["turntable"], settings_of(PROCEDURES["turntable"], bench), (), Measured(run.points)).results
        for bench in (checked_bench(tomllib.loads(text), ""), checked_bench(known, ""))
    )
    assert certified.scale_factor.value == pytest.approx(plain_run.scale_factor.value * (1.0 + 20e-6), rel=1e-9)
    assert certified.bias.value == pytest.approx(plain_run.bias.value * (1.0 + 20e-6) + 20e-6, rel=1e-9)
    sources = settings_of(PROCEDURES["turntable"], checked_bench(known, "")).station.sources
    assert sources.meter_gain == pytest.approx(math.hypot(2e-6, (35e-6 - 15e-6) / 4.0))
    assert sources.meter_offset_v == pytest.approx(math.hypot(60e-6 / 9.0, 10.0 * (5e-6 - 4e-6) / 4.0))
    assert certified.uncertainty.value("scale_factor").u < plain_run.uncertainty.value("scale_factor").u
    assert "certificate, 3 levels on 10 V" in certified.uncertainty.known_from[0]


@pytest.mark.parametrize(("room", "gain"), [("[18.0, 28.0]", 35e-6), ("[15.0, 30.0]", 50e-6), ("[20.0, 33.0]", 60e-6)])
def test_room_beyond_18_to_28_degc_counts_per_kelvin(room: str, gain: float) -> None:
    """34401A, 10 V: 5 ppm of the reading and 1 ppm of the range each kelvin, User's Guide p. 216."""
    text = embedded_text("paper").replace("mains_hz = 50", f"mains_hz = 50\nambient_c = {room}")
    known = settings_of(PROCEDURES["turntable"], checked_bench(tomllib.loads(text), "")).station.sources
    assert known.meter_gain == pytest.approx(gain)
    silent = settings_of(PROCEDURES["turntable"], checked_bench(tomllib.loads(embedded_text("paper")), ""))
    assert "room assumed within 18 to 28 degC" in silent.station.sources.meter_age_from


@pytest.mark.exhaustive
@pytest.mark.parametrize("seed", few(range(3), 0))
def test_load_of_a_meter_is_within_u95_above_10_v(seed: int) -> None:
    """An output of up to 10 kohm: at the 34401A's 10 Mohm it would be read 1000 ppm low."""
    output_ohm = 10.0 ** np.random.default_rng(seed).uniform(3.0, 4.0)
    quick = {"samples": 3, "sample_interval_s": 0.5, "settle_s": 0.5, "rates_deg_s": (100.0, 10.0, 0.0, -10.0, -100.0)}
    known = embedded_text("paper").replace("output_ohm = 100", f"output_ohm = {output_ohm}")
    loaded = parse_bench(f"{known}\n[simulation.override.source]\noutput_ohm = {output_ohm}\n", "")
    ours, theirs = (
        [
            vcfbench.run("turntable", bench, settings={**quick, "meter_range_v": range_v}, runs=None, seed=seed).results
            for bench in (loaded, parse_bench(embedded_text("paper"), ""))
        ]
        for range_v in (10, 100)
    )
    assert ours[0].scale_factor.value == pytest.approx(ours[1].scale_factor.value, rel=1e-9)
    ppm = 1e6 * (theirs[0].scale_factor.value / theirs[1].scale_factor.value - 1.0)
    assert ppm == pytest.approx(-0.1 * output_ohm, rel=0.1)
    value = theirs[0].uncertainty.value("scale_factor")
    assert 0.8 * abs(ppm) < 1e6 * value.u95 / abs(value.value)


@pytest.mark.parametrize("limits", ["sheet", "rectangular"])
def test_chosen_rule_covers_errors_of_a_meter(limits: str) -> None:
    """A 34401A's are a quarter of its limits, says its maker; where any error is as likely that covers 80 %."""
    known = embedded_text("paper").replace("[uncertainty]", f'[uncertainty]\nmeter_limits = "{limits}"')
    sources = settings_of(PROCEDURES["turntable"], checked_bench(tomllib.loads(known), "")).station.sources
    u = 35e-6 / (sources.meter_sigmas or math.sqrt(3.0))
    drawn = np.random.default_rng(1).uniform(-35e-6, 35e-6, 2000)
    assert (np.mean(np.abs(drawn) <= 1.96 * u) > 0.93) == (limits == "rectangular")


def test_certificate_levels_off_the_line_enter_offset() -> None:
    """20 uV beside it at the most, rectangular."""

    def squared(middle_v: float) -> float:
        points = tuple(
            CalibrationPoint(range_v=10.0, level_v=level_v, correction_v=correction_v, expanded_v=1e-5)
            for level_v, correction_v in ((-10.0, 0.0), (0.0, middle_v), (10.0, 0.0))
        )
        u: float = meter_worth("meter", HP_34401A, MeterKnown(calibration=points), 10.0, 10.0)["meter_offset_v"]
        return u**2

    assert squared(30e-6) - squared(0.0) == pytest.approx((20e-6) ** 2 / 3.0)


@pytest.mark.parametrize(("level_v", "slope", "offset_v"), [(10.0, 8.8e-6, 0.0), (0.0, 0.0, 88e-6)])
def test_certificate_levels_at_one_voltage_count_by_their_u(level_v: float, slope: float, offset_v: float) -> None:
    """100 uV with U95 20 uV counts four times 40 uV with 40 uV."""
    points = tuple(
        CalibrationPoint(range_v=10.0, level_v=level_v, correction_v=correction_v, expanded_v=expanded_v)
        for correction_v, expanded_v in ((100e-6, 20e-6), (40e-6, 40e-6))
    )
    worth = meter_worth("meter", HP_34401A, MeterKnown(calibration=points), 10.0, 10.0)
    assert worth["meter_gain_correction"] == pytest.approx(slope)
    assert worth["meter_offset_correction_v"] == pytest.approx(offset_v)


@pytest.mark.parametrize("age_days", [50.0, 200.0, 365.0])
def test_limits_of_a_sheet_for_a_year_grow_evenly_since_the_calibration(age_days: float) -> None:
    """DMM6500: 25 ppm + 5 ppm of the range in a year, of which so much counts as of the year has passed."""
    points = tuple(
        CalibrationPoint(range_v=10.0, level_v=level_v, correction_v=0.0, expanded_v=1e-9) for level_v in (-10.0, 10.0)
    )
    worth = meter_worth("meter", KEITHLEY_DMM6500, MeterKnown(calibration=points, rectangular=True), 10.0, age_days)
    passed = age_days / 365.0 / math.sqrt(3.0)
    assert worth["meter_gain"] == pytest.approx(25e-6 * passed, rel=1e-3)
    assert worth["meter_offset_v"] == pytest.approx(5e-6 * 10.0 * passed, rel=1e-3)
