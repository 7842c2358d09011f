"""Reports of runs as files."""

from __future__ import annotations

import json
import re
import sys
from pathlib import Path
from typing import TYPE_CHECKING

import pytest

import vcfbench
from tests.seals import sealed
from vcfbench.archive.reported import command_of, full_report
from vcfbench.errors import ConfigError
from vcfbench.reports.document import Figure, Heading, Notice
from vcfbench.reports.text import text_of
from vcfbench.station.file import embedded_text

if TYPE_CHECKING:
    from vcfbench import Run

QUICK = {"rates_deg_s": (10.0, 0.0, -10.0), "samples": 3, "sample_interval_s": 0.5, "settle_s": 0.5}

METER = """[multimeter]
calibrated = 2020-08-01
calibration_due = 2021-08-01
certificate = "DKD-4711"
"""
MORE = """
[acceptance]
bias_v = [-0.05, 0.05]
nonlinearity_ppm = [0, 1e-3]

[laboratory]
name = "Gyroscope Laboratory"
address = "1 Example Street, Example Town"
"""
TOLD = {
    "dut": "G-0042",
    "operator": "A. Person",
    "note": "after <script>alert(1)</script> rework",
    "tags": {"batch": "7"},
    "ambient_temperature_c": 23.1,
    "humidity_percent": 41.0,
}


@pytest.fixture(scope="module")
def quick(tmp_path_factory: pytest.TempPathFactory) -> Run:
    bench = tmp_path_factory.mktemp("bench") / "bench.toml"
    bench.write_text(embedded_text("paper").replace("[multimeter]\n", METER) + MORE, encoding="utf-8")
    runs = tmp_path_factory.mktemp("runs")
    with pytest.warns(UserWarning, match="multimeter"):
        return vcfbench.run("turntable", bench, seed=3, settings=QUICK, runs=runs, metadata=TOLD)


def recorded(run: Run, folder: Path, **changes: object) -> Run:
    """Return the run of a record like that of `run`, with other words in its header."""
    assert run.directory is not None
    header, *lines = (run.directory / "journal.jsonl").read_text(encoding="utf-8").splitlines()
    copy = folder / "20260821T142530Z-own-0a1b2c"
    copy.mkdir()
    answer = json.dumps({**json.loads(header), **changes})
    (copy / "journal.jsonl").write_bytes(sealed("\n".join([answer, *lines, ""]).encode()))
    return vcfbench.load_run(copy)


def test_a_report_says_who_what_and_by_what_means(quick: Run) -> None:
    report = full_report(quick)
    heads = [part.text for part in report.parts if isinstance(part, Heading)]
    assert heads == [
        *("Calibration report: turntable of G-0042", "Method", "Conditions", "Equipment", "Results", "Verdict"),
        *("Undetected faults", "Settings", "Record", "Provenance"),
    ]
    notices = [part.text for part in report.parts if isinstance(part, Notice)]
    assert notices == [
        "SIMULATED: instruments and gyroscope were simulated (seed 3). Nothing here was measured.",
        "OVERDUE: the calibration of multimeter (34401A) was due 2021-08-01.",
        "Verdict: FAIL",
    ]
    titles = [part.title for part in report.parts if isinstance(part, Figure)]
    assert titles == ["Residuals of the least-squares line", "Output against the table's rate"]
    words = text_of(report)
    for said in (quick.name, "A least-squares line", "MY44021876", "GPIB0::22::INSTR", "SHA-256", "rates_deg_s"):
        assert str(said) in words
    for said in ("A. Person", "after <script>", "23.1 degC", "41 %", "2021-08-01 OVERDUE", "DKD-4711", "Gyroscope Lab"):
        assert said in words


@pytest.mark.exhaustive
def test_the_record_of_a_long_window_is_drawn(tmp_path: Path) -> None:
    settings = {"powered_s": 0.0, "duration_s": 200.0}
    run = vcfbench.run("zero", seed=1, settings=settings, runs=tmp_path)
    figures = [part for part in full_report(run).parts if isinstance(part, Figure)]
    assert [each.title for each in figures] == ["Allan deviation of the output at rest", "Record of the raw readings"]
    assert figures[0].series[0].low is not None
    assert figures[1].series[0].y == tuple(each.voltage_v for each in run.readings)


def test_the_command_can_be_typed_again(quick: Run) -> None:
    header = {**quick.header, "options": {"bench": "a b.toml", "quiet": True, "seed": 3, "metadata": dict(TOLD)}}
    assert command_of(header) == (
        "vcfbench run turntable --bench 'a b.toml' --quiet --seed 3 --dut G-0042 --operator 'A. Person' "
        "--note 'after <script>alert(1)</script> rework' --tag batch=7 --ambient-temperature-c 23.1 "
        "--humidity-percent 41.0"
    )


@pytest.mark.exhaustive
def test_report_of_same_record_has_same_bytes(quick: Run, tmp_path: Path) -> None:
    (page,) = vcfbench.write_report(quick, tmp_path / "one.html")
    assert quick.directory is not None
    (again,) = vcfbench.write_report(vcfbench.load_run(quick.directory), tmp_path / "two.html")
    assert page.read_bytes() == again.read_bytes()
    assert "<svg" in page.read_text(encoding="utf-8")
    assert "<script" not in page.read_text(encoding="utf-8")
    assert "&lt;script&gt;alert(1)" in page.read_text(encoding="utf-8")


@pytest.mark.exhaustive
def test_the_figures_of_a_markdown_report_lie_beside_it(quick: Run, tmp_path: Path) -> None:
    text, *figures = vcfbench.write_report(quick, str(tmp_path / "my run.md"))
    assert [each.name for each in figures] == ["my run-1.svg", "my run-2.svg"]
    assert all(each.read_bytes().startswith(b"<?xml") for each in figures)
    assert "(my%20run-2.svg)" in text.read_text(encoding="utf-8")
    assert not re.search(r"(?<!\\)<", text.read_text(encoding="utf-8"))
    assert "| scale factor |" in text.read_text(encoding="utf-8")


@pytest.mark.exhaustive
def test_pdf_has_run_name_and_page_number_everywhere(quick: Run, tmp_path: Path) -> None:
    pypdf = pytest.importorskip("pypdf")
    try:
        pytest.importorskip("weasyprint")
    except OSError:
        pytest.skip("this system has no Pango")
    (tmp_path / "l.svg").write_text('<svg xmlns="http://www.w3.org/2000/svg"><text y="9">us</text></svg>', "utf-8")
    (path,) = vcfbench.write_report(quick, tmp_path / "run.pdf", {"logo": str(tmp_path / "l.svg")})
    pages = [page.extract_text() for page in pypdf.PdfReader(path).pages]
    for number, page in enumerate(pages, start=1):
        assert str(quick.name) in page
        assert f"page {number} of {len(pages)}" in page
    assert "SIMULATED" in pages[0]


@pytest.mark.exhaustive
def test_a_pdf_without_its_library_says_what_to_install(
    quick: Run, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setitem(sys.modules, "weasyprint", None)
    with pytest.raises(ConfigError, match=r'a report as PDF needs weasyprint.*pip install "weasyprint'):
        vcfbench.write_report(quick, tmp_path / "run.pdf")


@pytest.mark.exhaustive
def test_a_pdf_without_the_system_s_pango_says_so(quick: Run, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    broken = tmp_path / "library"
    broken.mkdir()
    (broken / "weasyprint.py").write_text("raise OSError('cannot load library libpango-1.0-0')\n", encoding="utf-8")
    monkeypatch.delitem(sys.modules, "weasyprint", raising=False)
    monkeypatch.syspath_prepend(str(broken))
    with pytest.raises(ConfigError, match=r"cannot be loaded: cannot load library libpango-1.0-0.*install Pango"):
        vcfbench.write_report(quick, tmp_path / "run.pdf")


@pytest.mark.exhaustive
def test_what_cannot_be_written_is_refused(quick: Run, tmp_path: Path) -> None:
    with pytest.raises(ConfigError, match=r"expected a name that ends in \.html, \.pdf, \.md"):
        vcfbench.write_report(quick, tmp_path / "run.doc")
    with pytest.raises(ConfigError, match=r"cannot be written: No such file"):
        vcfbench.write_report(quick, tmp_path / "nowhere" / "run.html")


def test_a_record_whose_procedure_is_not_here_gives_a_report(quick: Run, tmp_path: Path) -> None:
    run = recorded(quick, tmp_path, procedure="own", title="<script>of mine", method="")
    words = text_of(full_report(run))
    assert "no results: the procedure 'own' is not known here" in words
    assert "<script>of mine" in words
    (path,) = vcfbench.write_report(run, tmp_path / "own.html")
    assert "<script" not in path.read_text(encoding="utf-8")


def test_an_incomplete_record_gives_a_report_that_says_so(quick: Run, tmp_path: Path) -> None:
    run = recorded(quick, tmp_path)
    assert run.directory is not None
    journal = run.directory / "journal.jsonl"
    journal.write_bytes(b"".join(journal.read_bytes().splitlines(keepends=True)[:-1]))
    notices = [p for p in full_report(vcfbench.load_run(run.directory)).parts if isinstance(p, Notice)]
    assert (notices[1].kind, notices[1].text) == ("fail", "This run is not complete, its record is incomplete")


def test_a_run_that_was_not_recorded_has_a_report() -> None:
    run = vcfbench.Run("own", vcfbench.Status.COMPLETE)
    assert "not recorded" in text_of(full_report(run))


def test_figures_of_a_custom_procedure_are_kept_with_its_run(tmp_path: Path) -> None:
    settings = {"rates_deg_s": (0.0, 50.0, 100.0), "samples": 3}
    run = vcfbench.run(
        Path(__file__).parents[2] / "examples" / "own-procedure" / "hysteresis.py", settings=settings, runs=tmp_path
    )
    assert run.directory is not None
    again = vcfbench.load_run(run.directory)
    assert "is not known here" in str(again.no_results)
    page = vcfbench.write_report(again, tmp_path / "again.html")[0].read_text("utf-8")
    assert (page.count(">rail tolerance<"), page.count(">rail_tolerance_v<")) == (1, 1)
    assert "station." not in page
    assert again.report().parts[: len(run.report().parts)] == run.report().parts
    figures = [part for part in full_report(again).parts if isinstance(part, Figure)]
    assert (
        [each.title for each in figures]
        == [each.title for each in run.report().parts if isinstance(each, Figure)]
        != []
    )
