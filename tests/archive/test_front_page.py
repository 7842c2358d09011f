"""First page of a report."""

from __future__ import annotations

import re
from typing import TYPE_CHECKING

import pytest
from msgspec.structs import replace
from simrack_tests.cells import few

import vcfbench
from tests.archive.test_written import QUICK
from vcfbench.archive.batch_sheet import device_parts, device_rows
from vcfbench.archive.certificate import CertificateWords, stated_words
from vcfbench.archive.days import days_of
from vcfbench.archive.front_page import BLANK, front_page, seal_of
from vcfbench.archive.reported import full_report
from vcfbench.archive.verified import verify_run
from vcfbench.errors import ConfigError
from vcfbench.records.amendments import Amendment
from vcfbench.records.stated import values_of
from vcfbench.reports.document import Report, Table
from vcfbench.reports.html_page import page_of
from vcfbench.reports.text import text_of
from vcfbench.specifications import WORST_OF_CLASS
from vcfbench.station.file import embedded_text
from vcfbench.values.printing import grouped

if TYPE_CHECKING:
    from pathlib import Path

    from vcfbench import Run

LIMITS = """
[acceptance]
guard_band = "U95"
scale_factor_v_per_deg_s = [-0.013, -0.012]
bias_v = [-0.05, 0.05]
reading_noise_v = [0.0, 1e-6]
"""


@pytest.fixture(scope="module")
def judged(tmp_path_factory: pytest.TempPathFactory) -> Run:
    folder = tmp_path_factory.mktemp("front")
    bench = re.sub(r"(?m)^temperature_k = .*$", "temperature_k = 0.5", embedded_text("paper"))
    (folder / "bench.toml").write_text(bench + LIMITS, encoding="utf-8")
    return vcfbench.run("turntable", folder / "bench.toml", seed=3, settings=QUICK, runs=folder / "runs")


def shown(run: Run, **words: str) -> tuple[dict[str, str], list[tuple[str, ...]], str]:
    """Return the facts of the first page, the rows of its results, and all of its text."""
    parts = list(front_page(run, "Title", words, None))
    tables = [part for part in parts if isinstance(part, Table)]
    facts = {row[0]: row[1] for table in tables if not table.has_heads for row in table.printed()}
    return facts, [row for table in tables if table.has_heads for row in table.printed()], text_of(Report(parts))


def test_unset_fields_are_blank_lines_and_set_fields_printed(judged: Run) -> None:
    facts, _, _ = shown(judged)
    asked = ("laboratory", "customer", "model", "serial number", "operator", "checked by", "issued on")
    asked += ("received on", "deviations from it", "place", "name, function, signature")
    assert {name: facts[name] for name in asked} == dict.fromkeys(asked, BLANK)
    assert facts["method"].startswith("turntable, vcfbench ")
    assert facts["adjustment"] == "none during the run"
    assert facts["traceable by"] == f"34401A (multimeter) {BLANK}; acl (rate table) {BLANK}"
    facts, _, _ = shown(judged, laboratory="L", laboratory_address="here", serial="G-1", issued="2126-11-23")
    assert (facts["laboratory"], facts["serial number"], facts["issued on"]) == ("L, here", "G-1", "2126-11-23")
    with pytest.raises(ConfigError, match="got 'custommer'"):
        shown(judged, custommer="x")


def test_results_have_uncertainty_factor_limits_and_verdict(judged: Run) -> None:
    _, rows, text = shown(judged)
    by_name = {row[0]: row[1:] for row in rows}
    value, u95, k, limits, verdict = by_name["scale factor"]
    stated = values_of(judged.results)["scale_factor"]
    assert float(value.partition("(")[0].replace(" ", "")) == pytest.approx(
        1e3 * stated.value, abs=1e3 * (stated.u or 0.0)
    )
    assert (value.endswith(") mV/(deg/s)"), u95.endswith(" mV/(deg/s)")) == (True, True)
    assert float(u95.removesuffix(" mV/(deg/s)").replace(" ", "")) == pytest.approx(1e3 * (stated.u95 or 0.0), rel=0.05)
    assert (k, limits, verdict) == (f"{stated.coverage_factor:.2f}", "-13 to -12", "PASS; guarded, w = U95")
    assert by_name["bias (output)"][3:] == ("-50 to 50", "PASS; guarded, w = U95")
    assert by_name["reading noise"][1:] == ("not known", "", "0 to 1e-06", "FAIL; no U95: simple acceptance")
    assert "Decision rule, guarded, w = U95: a value nearer to a limit than its U95 is marginal" in text
    assert "U95 does not contain: " in text


AMENDED = Amendment(revision=2, utc="2126-01-02T00:00:00+00:00", by="A", reason="label", changes=())


def test_every_word_of_a_certificate_is_on_the_first_page(judged: Run) -> None:
    dated = {"issued": "2126-03-04", "received": "2020-01-01"}
    words = {key: dated.get(key, f"its {key}") for key in CertificateWords.__struct_fields__}
    for run, more in ((judged, ""), (replace(judged, amendments=(AMENDED,)), " revision 2")):
        assert run.directory is not None
        facts, _, text = shown(run, **words)
        left_out = {"country"}  # which is for machines: an address has it
        assert [each for key, each in words.items() if each not in text and key not in left_out] == []
        assert facts["certificate"] == f"its identifier{more}"
        assert "certificate" not in shown(run)[0]
        assert stated_words(run)["identifier"] == f"{run.name}{more}"


def test_days_that_cannot_be_are_refused_with_both(judged: Run) -> None:
    days = days_of(judged)
    assert days is not None
    cases = [
        ({"received": "2126-12-25"}, f"the first day measured, {days[0]}, is before received, 2126-12-25"),
        ({"issued": "2020-01-02"}, f"issued, 2020-01-02, is before the last day measured, {days[1]}"),
        ({"received": "soon"}, "received: expected a day such as 2026-11-23, got 'soon'"),
    ]
    for words, said in cases:
        with pytest.raises(ConfigError, match=said):
            stated_words(judged, words)
    with pytest.raises(ConfigError, match="issued, 2126-01-01, is before the last amendment, 2126-01-02"):
        stated_words(replace(judged, amendments=(AMENDED,)), {"issued": "2126-01-01"})
    assert stated_words(judged, {"received": days[0], "issued": days[1]})["issued"] == days[1]


def test_signature_and_day_of_issue_stand_before_all_notes(judged: Run) -> None:
    text = shown(judged)[2]
    assert text.index("scale factor") < text.index("issued on") < text.index("name, function, signature")
    assert text.index("seal of the record") < text.index("In parentheses: ")


def test_inputs_of_uncertainties_are_listed_and_the_temperature_that_u95_contains(judged: Run) -> None:
    given = judged.header["bench"]["uncertainty"]
    tables = [part for part in full_report(judged).parts if isinstance(part, Table)]
    (listed,) = (dict(each.printed()) for each in tables if each.title.startswith("Inputs of the uncertainties"))
    assert listed.keys() == {key for key, value in given.items() if value is not None}
    assert listed["temperature_k"] == "0.5"
    assert "a device that is up to 0.5 K away from the temperature" in " ".join(shown(judged)[2].split())


def test_nothing_is_said_of_a_meter_that_was_not_used(judged: Run) -> None:
    assert "Limits of the data sheet of the multimeter count" in shown(judged)[2]
    others = tuple(each for each in judged.equipment if each.role != "multimeter")
    assert "Limits of the data sheet" not in shown(replace(judged, equipment=others))[2]
    meter = replace(judged.equipment[0], role="v_vc_meter", certificate="K-2")
    assert "(V_Vc meter) K-2" in shown(replace(judged, equipment=(meter,)))[0]["traceable by"]


@pytest.fixture(scope="module")
def lacking(tmp_path_factory: pytest.TempPathFactory) -> Run:
    """A run whose uncertainties lack what no class tells, judged with a guard band."""
    folder = tmp_path_factory.mktemp("lacking")
    bench = re.sub(r"\[uncertainty\].*?\n(?=\[)", "", embedded_text("paper"), flags=re.DOTALL)
    bench = bench.replace("[multimeter]", '[multimeter]\ncertificate = "K-1, Lab Ltd"\ncalibrated = 2026-01-15')
    limits = '[acceptance]\nguard_band = "U95"\nscale_factor_v_per_deg_s = [-0.02, -0.01]\n'
    (folder / "bench.toml").write_text(bench + limits, encoding="utf-8")
    known = {key: each for key, each in WORST_OF_CLASS.items() if key not in {"temperature_k", "demodulator_phase_deg"}}
    asked = {"seed": 3, "settings": QUICK, "runs": folder / "runs", "metadata": {"dut": "G-1"}}
    with pytest.MonkeyPatch.context() as patched:
        patched.setattr("vcfbench.procedures.layers.WORST_OF_CLASS", known)
        return vcfbench.run("turntable", folder / "bench.toml", **asked)


def test_what_u95_lacks_is_said_with_the_verdict(lacking: Run) -> None:
    facts, rows, text = shown(lacking)
    assert facts["traceable by"] == f"34401A (multimeter) K-1, Lab Ltd, 2026-01-15; acl (rate table) {BLANK}"
    assert "Verdict: PASS with an incomplete U95, without temperature" in text
    assert "data sheet of the multimeter count as 4 standard deviations, as its maker says" in text
    assert (rows[0][0][:36], rows[0][-1]) == (
        "scale factor; INCOMPLETE without tem",
        "PASS with an incomplete U95; guarded, w = U95",
    )
    assert "\nPASS with an incomplete U95, without temperature" in text_of(lacking.report())
    sheet, footnote = device_parts(device_rows("G-1", lacking.directory.parent))[2:]
    assert footnote.text == "* U95 is incomplete: without temperature, demodulator phase."
    assert sheet.rows[0][-1] == "PASS*"


@pytest.mark.parametrize(
    "procedure", few(["kvc", "self-calibration", pytest.param("online", marks=pytest.mark.exhaustive)], every=3)
)
def test_first_page_of_k_vc_procedures_names_missing_u95(procedure: str, tmp_path: Path) -> None:
    settings = {"k_vc": "150", **QUICK} if procedure == "self-calibration" else {"k_vc": "150"}
    if procedure == "kvc":
        settings = {"match_rates_deg_s": [20.0, 100.0, 200.0], "cycles": 1, "samples": 3, "health": False}
    run = vcfbench.run(procedure, "lab", seed=1, settings=settings, runs=tmp_path)
    _, _, text = shown(run)
    assert ("Source of K_Vc: K_Vc = 150" in text) is (procedure != "kvc")
    assert "U95 does not contain: " in text
    first = run.results.holds_not[0].split(" ", 3)[:3]
    assert " ".join(first) in " ".join(text.split())


@pytest.mark.exhaustive
@pytest.mark.filterwarnings("ignore:HarfBuzz-Subset:DeprecationWarning")
def test_the_results_fit_on_the_first_page(lacking: Run) -> None:
    try:
        weasyprint = pytest.importorskip("weasyprint")
    except OSError:
        pytest.skip("this system has no Pango")
    page = page_of(Report(list(front_page(lacking, "Title", {}, None))), "Title", "run", printed=True, logo="")
    laid = weasyprint.HTML(string=page).render().pages[0]
    assert "seal of the record" in " ".join(each.text for each in laid._page_box.descendants() if hasattr(each, "text"))
    ends = [each.position_x + each.width for each in laid._page_box.descendants() if hasattr(each, "text")]
    assert max(ends) < laid.width - 17.0 / 25.4 * 96.0 + 1.0  # its margin, in pixels of CSS


def test_value_that_errors_may_make_is_a_bound(tmp_path: Path) -> None:
    run = vcfbench.run("virtual-coriolis", seed=8, settings=QUICK, runs=tmp_path)
    *_, bound = run.results.uncertainty.bounds
    _, rows, text = shown(run)
    *before, row = [row for row in rows if row[1].startswith("below ")]
    assert (len(before), row[0]) == (len(run.results.uncertainty.bounds) - 1, "non-linearity, of the span, by V_Vc")
    assert row[1:4] == (f"below {grouped(bound.high)} ppm", "in its value", "-")
    assert "virtual.nonlinearity" not in text
    assert "rail_tolerance_v" not in text


def test_the_seal_is_that_which_verification_holds(judged: Run) -> None:
    assert judged.directory is not None
    seal = verify_run(judged.directory).seal
    assert seal is not None
    assert (seal_of(judged), shown(judged)[0]["seal of the record"]) == (seal, seal)
    assert seal_of(vcfbench.Run("own", vcfbench.Status.COMPLETE)) is None


@pytest.mark.exhaustive
def test_each_point_of_each_line_has_its_residual_and_uncertainty(tmp_path: Path) -> None:
    run = vcfbench.run("virtual-coriolis", seed=3, runs=tmp_path)
    tables = {part.title: part for part in full_report(run).parts if isinstance(part, Table)}
    for name, column in (("turntable", run.results.turntable), ("virtual Coriolis", run.results.virtual)):
        rows = tables[f"Residuals of the least-squares line: {name}"].rows
        assert max(abs(float(row[1])) for row in rows) == pytest.approx(column.nonlinearity_ppm.max_span)
        assert all(float(row[2]) > 0.0 for row in rows)
