"""The certificate of a voltmeter in XML: what is read of it, and what is refused by its name."""

from __future__ import annotations

from datetime import date
from pathlib import Path

import pytest

from vcfbench import ConfigError, load_bench
from vcfbench.procedures.catalogue import PROCEDURES
from vcfbench.procedures.layers import settings_of
from vcfbench.station.file import embedded_text
from vcfbench.station.meter_dcc import read_meter_dcc

EXAMPLE = Path(__file__).parents[2] / "examples" / "34401A-certificate.xml"
TEXT = EXAMPLE.read_text("utf-8")
END = "</si:measurementUncertaintyUnivariateXMLList>"
STATED = TEXT[TEXT.index(END.replace("/", "")) : TEXT.index(END) + len(END)]
UNIVARIATE = END.replace("/", "") + "{}" + END
STANDARD = UNIVARIATE.format(
    "<si:standardMUXMLList><si:valueStandardMUXMLList>1 3 3 4 12.5 20 12.5 20</si:valueStandardMUXMLList>"
    "</si:standardMUXMLList>"
)
BEFORE_2_2 = (
    "<si:expandedUncXMLList><si:uncertaintyXMLList>2 6 6 8 25 40 25 40</si:uncertaintyXMLList>"
    "<si:coverageFactorXMLList>2</si:coverageFactorXMLList></si:expandedUncXMLList>"
)
ERROR = TEXT[TEXT.index('<dcc:quantity refType="basic_measurementError">') : TEXT.index("</dcc:list>")]
CORRECTION = (
    ERROR.replace("basic_measurementError", "basic_measurementError_correction")
    .replace("Error of indication", "Correction")
    .replace("2 12 -9 10 40 70 -21 -50", "-2 -12 9 -10 -40 -70 21 50")
)
RANGE = TEXT[TEXT.index('<dcc:quantity refType="basic_measurementRange">') : TEXT.index("Range</dcc:content>")]


def bench(directory: Path, certificate: str, *keys: str) -> Path:
    (directory / "meter.xml").write_text(certificate, "utf-8")
    said = "[multimeter]\n" + "\n".join([*keys, 'calibration_dcc = "meter.xml"'])
    file = directory / "station.toml"
    file.write_text(embedded_text("lab").replace("[multimeter]", said), "utf-8")
    return file


def points(text: str, directory: Path) -> list[tuple[float, ...]]:
    (directory / "meter.xml").write_text(text, "utf-8")
    return [
        (each.range_v, each.level_v, each.correction_v, each.expanded_v / each.k)
        for each in read_meter_dcc(directory / "meter.xml").points
    ]


def test_bench_file_reads_table_number_and_day_of_example(tmp_path: Path) -> None:
    meter = load_bench(bench(tmp_path, TEXT, 'inventory_number = "DMM 7"')).multimeter
    assert meter is not None
    assert (meter.certificate, meter.calibrated, meter.calibration_dcc) == ("EXAMPLE-2026-0815", date(2026, 3, 3), None)
    assert [(each.range_v, each.level_v) for each in meter.calibration][:4] == [(1, 0), (1, 1), (1, -1), (10, 0)]
    assert (meter.calibration[5].correction_v, meter.calibration[5].expanded_v) == pytest.approx((-70e-6, 40e-6))
    known = settings_of(PROCEDURES["turntable"], load_bench(tmp_path / "station.toml")).station.sources
    assert known.meter_gain_correction == pytest.approx(-6e-6, abs=1e-6)
    assert "certificate, 5 levels on 10 V" in known.meter_age_from


CONFORMITY = (
    "<dcc:measurementMetaData><dcc:metaData><dcc:conformity>{}</dcc:conformity></dcc:metaData>"
    "</dcc:measurementMetaData></dcc:result>"
)


@pytest.mark.parametrize(
    ("was", "now"),
    [
        ("</dcc:result>", CONFORMITY.format("pass")),
        (STATED, STANDARD),
        (STATED, BEFORE_2_2),
        (ERROR, CORRECTION),
        (' refType="basic_measurementRange"', ""),  # by its name
    ],
)
def test_all_forms_of_a_table_say_the_same(was: str, now: str, tmp_path: Path) -> None:
    assert points(TEXT.replace(was, now), tmp_path) == [pytest.approx(each) for each in points(TEXT, tmp_path)]


@pytest.mark.parametrize(
    ("was", "now", "said"),
    [
        (RANGE, RANGE.replace(' refType="basic_measurementRange"', "") + "not the ", "DC voltage: no range"),
        ('refType="basic_measurementRange"', 'refType="basic_range"', "refType basic_range is not known"),
        (STATED, "", "DC voltage: no U of its Error of indication"),
        (r"\micro\volt", r"\one", r"expected a number or a list of them in \volt, got \one"),
        (STATED, UNIVARIATE.format("<si:coverageIntervalMUXMLList/>"), "si:coverageIntervalMUXMLList is not known"),
        ("2 12 -9 10", "-2 -12 9 -10", "contradicts its reading and reference value"),
        ("0 1 -1 0 5 10", "0 1 -1 0 5", "expected 8 values in each list, got 7"),
        ("1 1 1 10 10", "1 1 1 10 1", "5 V is not on a range of 1 V"),
        ("DC voltage", "Voltage", "neither direct (DC) nor alternating voltage"),
        ("DC voltage", "AC voltage", "no table of direct voltage"),
        ("EXAMPLE-2026-0815", "", "no number (dcc:uniqueIdentifier)"),
        ("2026-03-03", "soon", "expected a day as dcc:endPerformanceDate, got soon"),
        ('schemaVersion="3.3.0"', 'schemaVersion="2.4.0"', "expected schemaVersion 3.x, got 2.4.0"),
        ("by hand", "vcfbench", "got one of a gyroscope by vcfbench"),
        ("<dcc:digital", '<!DOCTYPE a [<!ENTITY b "c">]><dcc:digital', "without DOCTYPE and entities"),
        ("</dcc:list>", "", "expected XML"),
        ("DC voltage", "DC voltage as found", "its tables are as found, before an adjustment"),
        ("</dcc:result>", CONFORMITY.format("fail"), "DC voltage: conformity fail"),
        ("1 1 1 10 10", "1 1 1 1 10", "0 V on the 1 V range stand twice and differ"),
    ],
)
def test_what_is_missing_or_not_understood_is_named(was: str, now: str, said: str, tmp_path: Path) -> None:
    assert was in TEXT
    with pytest.raises(ConfigError) as refused:
        points(TEXT.replace(was, now), tmp_path)
    assert said in str(refused.value)


@pytest.mark.parametrize(
    ("keys", "said"),
    [
        ((), "inventory_number (or serial_number): expected the number of the instrument"),
        (
            ('serial_number = "MY41000816"',),
            "expected the certificate of serial_number MY41000816, got one of 34401A MY",
        ),
        (('inventory_number = "DMM-7"', 'serial_number = "MY1"'), "got one of 34401A MY41000815 (manufacturer)"),
        (('inventory_number = "DMM-7"', 'certificate = "another"'), "certificate: expected EXAMPLE-2026-0815"),
        (('inventory_number = "DMM-7"', "calibrated = 2026-01-01"), "calibrated: expected 2026-03-03"),
    ],
)
def test_the_certificate_of_another_instrument_is_refused(keys: tuple[str, ...], said: str, tmp_path: Path) -> None:
    with pytest.raises(ConfigError) as refused:
        load_bench(bench(tmp_path, TEXT, *keys))
    assert said in str(refused.value)
