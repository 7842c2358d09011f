"""Runs as Digital Calibration Certificates, read back by an independent library."""

from __future__ import annotations

import json
import sys
from base64 import b64decode
from decimal import Decimal
from types import SimpleNamespace
from typing import TYPE_CHECKING, Any
from xml.etree import ElementTree as ET

import pytest
from msgspec.structs import replace
from simrack_tests.cells import few

import vcfbench
from tests import warm
from tests.archive.test_written import QUICK
from vcfbench.archive.certificate import certificate_words
from vcfbench.archive.dcc import dcc_of
from vcfbench.errors import ConfigError
from vcfbench.procedures.catalogue import PROCEDURES
from vcfbench.records.stated import values_of
from vcfbench.station.acceptance import Acceptance, Verdict
from vcfbench.station.settings import Limit
from vcfbench.values.value import Value

if TYPE_CHECKING:
    from pathlib import Path

    from vcfbench import Run

SPACES = {"dcc": "https://ptb.de/dcc", "si": "https://ptb.de/si"}
WORDS = {
    "laboratory": "Gyroscope Laboratory",
    "laboratory_address": "1 Example Street",
    "country": "GR",
    "customer": "ACME & Sons <b>",
    "customer_address": "2 Some  Road\nTown",
    "responsible": "A. Person",
}


@pytest.fixture(scope="module")
def quick(tmp_path_factory: pytest.TempPathFactory) -> Run:
    metadata = {"dut": "G-0042", "tags": {"item_model": "VCF-1", "batch": "7"}, "ambient_temperature_c": 23.1}
    return vcfbench.run("turntable", seed=3, settings=QUICK, runs=tmp_path_factory.mktemp("runs"), metadata=metadata)


@pytest.fixture(scope="module")
def written(quick: Run, tmp_path_factory: pytest.TempPathFactory) -> Path:
    return vcfbench.write_certificate(quick, tmp_path_factory.mktemp("dcc") / "run.xml", WORDS)


def text_at(tree: ET.Element, path: str) -> str | None:
    return tree.findtext(path, namespaces=SPACES)


@pytest.fixture
def dcc(monkeypatch: pytest.MonkeyPatch) -> Any:
    """PyDCC without what it does beside reading.

    Its check of signatures, of which there are none here, fails to load beside OpenSSL 3.0.10 and later; its validator
    asks the network for schemas.
    """
    unused = SimpleNamespace(CertificateValidator=None, errors=None, ValidationContext=None)
    monkeypatch.setitem(sys.modules, "certvalidator", unused)
    module = pytest.importorskip("dcc.dcc")
    monkeypatch.setattr(module, "DCCXMLValidator", SimpleNamespace)
    return module


@pytest.mark.exhaustive
def test_an_independent_library_reads_it(dcc: Any, quick: Run, written: Path) -> None:
    certificate: Any = dcc.DCC(str(written))
    assert certificate.is_loaded()
    assert (certificate.version(), certificate.uid()) == ("3.3.0", quick.name)
    assert certificate.calibration_laboratory_name() == "Gyroscope Laboratory"
    assert certificate.mandatory_language() == "en"
    assert certificate.item_id()["identifications"]["identification"]["value"] == "G-0042"
    assert not certificate.status_report.is_signed
    found = {name.split(": ")[-1]: quantity for name, quantity in certificate.get_calibration_results("name", "en")}
    found = {name: found[key] for name in ("scale factor", "output") for key in found if key.endswith(name)}
    scale_factor, expected = found["scale factor"]["real"], values_of(quick.results)["scale_factor"]
    assert float(scale_factor["value"]) == pytest.approx(expected.value, abs=1e-3 * (expected.u95 or 0.0))
    assert scale_factor["unit"] == r"\volt\degree\tothe{-1}\second"
    expanded = scale_factor["measurementUncertaintyUnivariate"]["expandedMU"]
    assert float(expanded["valueExpandedMU"]) == pytest.approx(expected.u95, rel=0.01)
    assert expanded["coverageProbability"] == "0.95"
    assert float(expanded["coverageFactor"]) == pytest.approx(expected.coverage_factor, abs=5e-4)
    assert [float(each) for each in found["output"]["realListXMLList"]["valueXMLList"].split()] == [
        pytest.approx(point.output_v, rel=1e-9) for point in quick.points
    ]


def test_dcc_names_owner_means_and_limits(written: Path) -> None:
    tree = ET.parse(written).getroot()  # noqa: S314  # ours
    assert text_at(tree, ".//dcc:customer/dcc:name/dcc:content") == "ACME & Sons <b>"
    assert text_at(tree, ".//dcc:customer/dcc:location/dcc:further/dcc:content") == "2 Some Road Town"
    assert text_at(tree, ".//dcc:item/dcc:model") == "VCF-1"
    assert text_at(tree, ".//dcc:influenceCondition//si:value") == "23.1"
    said = " ".join(filter(None, (each.text for each in tree.iterfind(".//dcc:declaration/dcc:content", SPACES))))
    assert "It is not signed" in said
    assert "SIMULATED" in said
    models = [each.text for each in tree.iterfind(".//dcc:measuringEquipment/dcc:model", SPACES)]
    assert "34401A" in models
    assert "least-squares line" in (text_at(tree, ".//dcc:usedMethod/dcc:description/dcc:content") or "")


def test_conditions_of_the_values_stand_in_it(quick: Run, written: Path) -> None:
    found = {}
    for each in ET.parse(written).iterfind(".//dcc:influenceCondition", SPACES):  # noqa: S314  # ours
        numbers = [each.findtext(f".//si:{key}", None, SPACES) for key in ("value", "valueExpandedMU", "unit")]
        found[each.findtext("dcc:name/dcc:content", None, SPACES)] = numbers
    drive = quick.values["scale_factor"].conditions.drive
    assert drive is not None
    value, u95, unit = found.pop("frequency of the drive")
    assert (float(value or 0.0), unit) == (pytest.approx(drive.frequency_hz, abs=1e-3 * drive.u_hz), r"\hertz")
    assert float(u95 or 0.0) == pytest.approx(1.959964 * drive.u_hz, rel=0.01)
    assert found == {
        "temperature of the room": ["23.1", None, r"\degreecelsius"],
        "positive rail": ["10", None, r"\volt"],
        "negative rail": ["-10", None, r"\volt"],
    }


def test_the_same_record_gives_the_same_bytes(quick: Run, written: Path, tmp_path: Path) -> None:
    assert vcfbench.write_certificate(quick, tmp_path / "again.xml", WORDS).read_bytes() == written.read_bytes()


def test_all_that_is_missing_is_said_at_once(quick: Run) -> None:
    with pytest.raises(ConfigError) as refused:
        certificate_words(quick)
    for key in WORDS:
        assert f"--set {key}=..." in str(refused.value)
    assert "serial" not in str(refused.value)
    with pytest.raises(ConfigError, match=r"expected keys of laboratory, .* got 'custommer'"):
        certificate_words(quick, {"custommer": "x"})
    with pytest.raises(ConfigError, match="expected two capital letters"):
        certificate_words(quick, {**WORDS, "country": "Greece"})


def test_what_the_bench_file_tells_need_not_be_told_again(quick: Run, tmp_path: Path) -> None:
    assert quick.directory is not None
    header, *lines = (quick.directory / "journal.jsonl").read_text(encoding="utf-8").splitlines()
    answer = json.loads(header)
    answer["bench"]["laboratory"] = {"name": "L", "address": "here", "country": "DE", "operator": "B. Person"}
    (tmp_path / "run").mkdir()
    (tmp_path / "run" / "journal.jsonl").write_text("\n".join([json.dumps(answer), *lines, ""]), encoding="utf-8")
    words = certificate_words(
        vcfbench.load_run(tmp_path / "run"), {"customer": "C", "customer_address": "there", "responsible": "D. Person"}
    )
    assert (words.laboratory, words.laboratory_address, words.country) == ("L", "here", "DE")
    assert (words.serial, words.item_model, words.responsible) == ("G-0042", "VCF-1", "D. Person")


def test_without_uncertainties_or_a_whole_run_there_is_none(tmp_path: Path) -> None:
    run = vcfbench.Run("own", vcfbench.Status.COMPLETE, results={"gain": 2.0})
    with pytest.raises(ConfigError, match="needs results with uncertainties"):
        vcfbench.write_certificate(run, tmp_path / "x.xml", {**WORDS, "serial": "G-1", "identifier": "1"})
    run = vcfbench.Run("own", vcfbench.Status.ABORTED)
    with pytest.raises(ConfigError, match="needs a run that is complete, this one is aborted"):
        vcfbench.write_certificate(run, tmp_path / "x.xml", {**WORDS, "serial": "G-1", "identifier": "1"})


def test_the_command_writes_it_or_says_what_is_missing(quick: Run, tmp_path: Path) -> None:
    assert quick.directory is not None
    words = [word for key, value in WORDS.items() for word in ("--set", f"{key}={value}")]
    done = warm.run(["vcfbench", "report", str(quick.directory), "--dcc", "-o", "a.xml", *words], tmp_path)
    assert (done.returncode, done.stdout) == (0, "a.xml\n"), done.stderr
    assert (tmp_path / "a.xml").read_bytes().startswith(b"<?xml")
    refused = warm.run(["vcfbench", "report", str(quick.directory), "--dcc"], tmp_path)
    assert refused.returncode == 2
    assert "--set customer_address=..." in refused.stderr


def test_quantities_have_types_and_names_in_two_languages(written: Path) -> None:
    tree = ET.parse(written).getroot()  # noqa: S314  # ours
    (found,) = tree.findall(".//dcc:quantity[@refType='basic_measuredValue vcf_scaleFactor']", SPACES)
    names = {each.get("lang"): each.text for each in found.findall("dcc:name/dcc:content", SPACES)}
    assert names == {"en": "scale factor", "de": "Skalenfaktor"}
    assert [each.text for each in tree.iterfind(".//dcc:usedLangCodeISO639_1", SPACES)] == ["en", "de"]
    used = {word.split("_")[0] for each in tree.iter() for word in (each.get("refType") or "").split()}
    assert used == {each.text for each in tree.iterfind(".//dcc:refTypeDefinition/dcc:namespace", SPACES)}


def test_dcc_holds_report_and_day_of_issue(quick: Run, tmp_path: Path) -> None:
    report = tmp_path / "report.pdf"
    report.write_bytes(b"%PDF-1.7 of ours")
    path = vcfbench.write_certificate(quick, tmp_path / "run.xml", {**WORDS, "issued": "2126-11-23"}, report)
    tree = ET.parse(path).getroot()  # noqa: S314  # ours
    assert text_at(tree, "dcc:document/dcc:fileName") == "report.pdf"
    assert b64decode(text_at(tree, "dcc:document/dcc:dataBase64") or "") == report.read_bytes()
    assert text_at(tree, ".//dcc:coreData/dcc:issueDate") == "2126-11-23"
    report.write_bytes(b"no such thing")
    with pytest.raises(ConfigError, match="expected a report as PDF"):
        vcfbench.write_certificate(quick, tmp_path / "run.xml", WORDS, report)


def test_the_days_of_the_readings_have_their_time_zone(written: Path, quick: Run) -> None:
    tree = ET.parse(written).getroot()  # noqa: S314  # ours
    for name in ("beginPerformanceDate", "endPerformanceDate"):
        assert text_at(tree, f".//dcc:{name}") == f"{str(quick.header['utc'])[:10]}Z"


@pytest.mark.parametrize(
    ("values", "word"),
    few(
        [
            ((0.5,), "pass"),
            ((0.5, 0.95), "conditionalPass"),
            ((0.05,), "conditionalPass"),
            ((0.95, 1.05), "conditionalFail"),
            ((-0.05, 0.5), "conditionalFail"),
            ((1.05, 1.5, 0.5), "fail"),
            ((None, 0.5), "fail"),
        ],
        ((0.5, 0.95), "conditionalPass"),
        ((None, 0.5), "fail"),
    ),
)
def test_within_the_guard_band_one_passes_or_fails_on_condition(
    quick: Run, values: tuple[float | None, ...], word: str
) -> None:
    found = [None if value is None else Value("v", value, u95=0.1) for value in values]
    limits = tuple(Verdict.of(Limit(f"limit_{at}", 0.0, 1.0, guarded=True), each) for at, each in enumerate(found))
    of_none = Verdict("k_vc_deg_s_per_v", None, 0.0, 1.0)
    judged = replace(quick, verdict=Acceptance((*limits, of_none)))
    tree = ET.fromstring(dcc_of(judged, certificate_words(judged, WORDS)))  # noqa: S314  # ours
    (statement,) = tree.findall(".//dcc:statement[dcc:conformity]", SPACES)
    assert statement.findtext("dcc:conformity", namespaces=SPACES) == word
    said = [str(each.text) for each in statement.findall("dcc:declaration/dcc:content", SPACES)]
    assert f"limit_{len(values) - 1} from 0 to 1" in said[-2]
    assert all("marginal" not in each for each in said)


def test_no_text_of_an_export_is_a_repr(quick: Run, monkeypatch: pytest.MonkeyPatch) -> None:
    methods = " ".join(str(each.method) for each in PROCEDURES.loaded())
    monkeypatch.setattr("vcfbench.archive.dcc.method_of", lambda _: f"{methods} It's at 5 degC.")
    of = "line over 200, -200 deg/s, \u00b1 5 degC, the declared range\x1b"
    run = replace(quick, _values=tuple(replace(each, of=f"{each.of} {of}") for each in quick.values.values()))
    root = ET.fromstring(dcc_of(run, certificate_words(run, WORDS)))  # noqa: S314  # ours
    said = [each.text or "" for each in root.iterfind(".//dcc:content", SPACES)]
    assert not [each for each in said if each[0] in "'\"" or "\\u" in each or "\\xb" in each]
    assert sum("-200 \u00b0/s, \u00b1 5 \u00b0C, the declared range\\x1b" in each for each in said) == len(run.values)
    assert sum(each.endswith("It's at 5 \u00b0C.") for each in said) == 1


@pytest.mark.exhaustive
def test_values_have_digits_of_their_uncertainty_which_is_rounded_up(quick: Run, written: Path) -> None:
    tree = ET.parse(written).getroot()  # noqa: S314  # ours
    for quantity in tree.iterfind(".//dcc:quantity", SPACES):
        u95, value = (quantity.findtext(f".//si:{key}", None, SPACES) for key in ("valueExpandedMU", "value"))
        if u95 is not None and value is not None:
            assert len(u95.lower().partition("e")[0].replace(".", "").strip("0")) <= 3
            assert Decimal(value) % Decimal(1).scaleb(Decimal(u95).adjusted() - 4) == 0
    for each in (*quick.values.values(), Value("bias", 1234.56789, "deg/s", u=345.678)):
        run = replace(quick, _values=(each,))
        root = ET.fromstring(dcc_of(run, certificate_words(run, WORDS)))  # noqa: S314  # ours
        stated = root.findtext(".//dcc:result//si:valueExpandedMU", None, SPACES)
        if stated is not None and each.u95:
            assert 0.0 <= float(stated) / (each.u95 * (1e-6 if each.unit == "ppm" else 1.0)) - 1.0 < 0.011


def test_only_calibrated_instruments_are_standards(quick: Run) -> None:
    first, *others = quick.equipment
    run = replace(quick, equipment=(replace(first, certificate="K-1"), *others))
    root = ET.fromstring(dcc_of(run, certificate_words(run, WORDS)))  # noqa: S314  # ours
    found = [each.get("refType") for each in root.iterfind(".//dcc:measuringEquipment", SPACES)]
    assert found == ["basic_measurementStandard", *[None] * len(others)]
