"""`vcfbench analyze`: the paper's numbers from its table, and one clear sentence for every unusable file."""

from __future__ import annotations

import json
from io import BytesIO
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

import vcfbench
from vcfbench.analysis.csv_table import Layout
from vcfbench.archive.analyzed import read_table
from vcfbench.cli.analyze import analyze
from vcfbench.errors import ConfigError
from vcfbench.reports.document import Figure
from vcfbench.reports.text import text_of

if TYPE_CHECKING:
    from collections.abc import Callable

TABLE_1 = Path(__file__).parents[2] / "examples" / "paper-table1.csv"


@pytest.fixture
def written(tmp_path: Path) -> Callable[[bytes], Path]:
    def write(content: bytes) -> Path:
        path = tmp_path / "data.csv"
        path.write_bytes(content)
        return path

    return write


def analysed(capsys: pytest.CaptureFixture[str], file: Path, compare: str | None = None) -> Any:
    analyze(file, compare, json=True)
    out = capsys.readouterr().out
    assert out.count("\n") == 1
    return json.loads(out)


def test_paper_table(capsys: pytest.CaptureFixture[str]) -> None:
    result = analysed(capsys, TABLE_1)
    assert result["notices"] == []  # that it bends at its ends is no fault
    table, virtual = result["series"]["turntable_v"], result["series"]["virtual_v"]
    assert round(table["scale_factor"]["value"], 9) == -0.012542052
    assert round(table["bias"]["value"], 9) == -0.042041176
    assert round(virtual["scale_factor"]["value"], 9) == -0.012734330
    assert round(virtual["bias"]["value"], 9) == 0.000658824
    assert [round(one["nonlinearity_ppm"]["max_span"], 1) for one in (table, virtual)] == [831.0, 3218.2]
    assert [round(one["nonlinearity_ppm"]["max_span_rounded"], 1) for one in (table, virtual)] == [749.6, 3389.6]
    assert round(result["comparison"]["scale_factor_error_percent"], 3) == 1.533
    assert round(result["comparison"]["scale_factor_error_percent_rounded"], 3) == 1.515
    assert (result["comparison"]["reference"], result["comparison"]["other"]) == ("turntable_v", "virtual_v")


@pytest.mark.parametrize("columns", ["0", "20"])
def test_no_terminal_is_too_narrow_for_the_figures(
    capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch, columns: str
) -> None:
    monkeypatch.setenv("COLUMNS", columns)
    analyze(TABLE_1)
    out = capsys.readouterr().out
    assert all(figure in out for figure in ("turntable_v", "-12.542052", "max_span_rounded", "3389.6", "1.533"))


def test_tables_for_people(capsys: pytest.CaptureFixture[str]) -> None:
    analyze(TABLE_1)
    out = capsys.readouterr().out
    for figure in ("-12.542052", "-12.734330", "-42.0412", "0.6588", "749.6", "3389.6", "1.533", "1.515", "3.50"):
        assert figure in out
    assert max(map(len, out.splitlines())) <= 80


def test_a_table_has_a_report_too(written: Callable[[bytes], Path], tmp_path: Path) -> None:
    analyze(written(b"rate_deg_s,a\n-1,1\n0,2.1\n1,3\n2,4\n"), output=tmp_path / "out.md")
    said = (tmp_path / "out.md").read_text("utf-8")
    assert "| scale factor, mV/(deg/s) | 990.000000 |" in said
    assert len(list(tmp_path.glob("*.svg"))) == 1


def test_figure_of_very_many_points_has_their_extremes(tmp_path: Path) -> None:
    rates = np.linspace(-100.0, 100.0, 20_001)
    outputs = 0.01 * rates + 1e-5 * np.random.default_rng(1).standard_normal(rates.size)
    outputs[777] += 1e-3
    np.savetxt(tmp_path / "t.csv", np.column_stack([rates, outputs]), "%.9g", ",", header="table_dps,a_v", comments="")
    (figure,) = [each for each in vcfbench.analyze(tmp_path / "t.csv").report().parts if isinstance(each, Figure)]
    (series,) = figure.series
    assert len(series.y) == 2000
    assert max(series.y) == pytest.approx(500.0, rel=0.05)  # ppm of the span


def test_a_column_of_times_tells_the_rate(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    rows = "".join(f"{0.01 * place:.2f},{(-1) ** place}\n" for place in range(100))
    (tmp_path / "zero.csv").write_text(f"t_s,rate_deg_s\n{rows}", "utf-8")
    analyze(tmp_path / "zero.csv", json=True)
    assert json.loads(capsys.readouterr().out)["interval_s"] == pytest.approx(0.01)


def test_comparison_in_the_order_asked(capsys: pytest.CaptureFixture[str]) -> None:
    comparison = analysed(capsys, TABLE_1, "virtual_v, turntable_v")["comparison"]
    assert comparison["reference"] == "virtual_v"
    assert round(comparison["scale_factor_error_percent"], 3) == round(100 * (0.012542052 / 0.012734330 - 1), 3)


def test_one_column_and_three_are_not_compared_unasked(
    written: Callable[[bytes], Path], capsys: pytest.CaptureFixture[str]
) -> None:
    assert analysed(capsys, written(b"rate_deg_s,a\n-1,1\n0,2\n1,3\n"))["comparison"] is None
    three = written(b"rate_deg_s,a,b,c\n-1,1,1,1\n0,2,3,4\n1,3,5,7\n")
    assert analysed(capsys, three)["comparison"] is None
    assert analysed(capsys, three, "a,c")["comparison"]["scale_factor_error_percent"] == pytest.approx(200.0)


@pytest.mark.parametrize(
    ("asked", "words"),
    [("a", "names of two columns"), ("a,b,c", "names of two columns"), ("a,x", "has no column 'x', only a, b")],
)
def test_unknown_columns_are_named(asked: str, words: str, written: Callable[[bytes], Path]) -> None:
    table = written(b"rate_deg_s,a,b\n-1,1,1\n0,2,3\n1,3,5\n")
    with pytest.raises(ConfigError, match=words):
        analyze(table, asked)
    with pytest.raises(ConfigError, match=r"names of two columns|has no column 'x', only a, b"):
        vcfbench.analyze(str(table), asked.split(",") if "x" in asked else asked)


def test_a_script_gets_what_the_command_prints(
    written: Callable[[bytes], Path], capsys: pytest.CaptureFixture[str]
) -> None:
    table = written(b"rate_deg_s,a,b\n-1,1,1\n0,2,3\n1,3,5\n")
    found = vcfbench.analyze(table)
    assert found.compared == ("a", "b")
    assert found.comparison is not None
    assert found.comparison.scale_factor_error_percent == pytest.approx(100.0)
    assert found.as_json() == analysed(capsys, table)
    assert "E_n of the fits' scatter alone, no verdict" in text_of(found.report())


def test_points_of_a_record(written: Callable[[bytes], Path], capsys: pytest.CaptureFixture[str]) -> None:
    lines = ["step,rate_deg_s,v_vc_v,output_v,std_v,n", "1,10,0,-0.17,4e-5,10", "2,0,0.25,-0.17,4e-5,10"]
    for step, gain in ((3, -0.0125), (4, -0.0127)):
        lines += [f"{step},{rate},{rate / 40},{gain * rate},4e-5,16" for rate in (-100, 0, 100)]
    result = analysed(capsys, written("\n".join(lines).encode()))
    assert list(result["series"]) == ["turntable", "virtual"]
    assert result["series"]["virtual"]["scale_factor"]["value"] == pytest.approx(-0.0127)
    assert result["series"]["virtual"]["type_a"]["u_output_v"] == pytest.approx(1e-5)
    assert result["comparison"]["scale_factor_error_percent"] == pytest.approx(1.6)


HEADER = b"rate_deg_s,a\n"
UNUSABLE = {
    "empty": (b"", ": the file is empty"),
    "blank": (b" \n\n", ": the file is empty"),
    "text": (HEADER + b"1,2\n2,high\n3,4\n", ", line 3, column a: 'high' is not a number"),
    "gap": (HEADER + b"1,2\n2,\n3,4\n", ", line 3, column a: the value is missing"),
    "blank line": (HEADER + b"1,2\n\n3,4\n4,5\n", ", line 3: the line is empty"),
    "ragged": (HEADER + b"1,2\n2\n3,4\n", ", line 3: 2 columns expected, got 1"),
    "decimal comma": (
        HEADER + b"1,5,2,5\n",
        ", line 2: 2 columns expected, got 4, '1,5,2,5'; are there decimal commas?",
    ),
    "quoted decimal comma": (HEADER + b'1,"2,5"\n', ", line 2, column a: '2,5' has a decimal comma"),
    "not a number": (HEADER + b"1,2\n2,NaN\n3,4\n", ", line 3, column a: NaN is not a measured value"),
    "overload": (HEADER + b"1,2\n2,9.9E37\n3,4\n", ", line 3, column a: 9.9E37 is an instrument's word for overload"),
    "infinite": (HEADER + b"1,2\n-inf,2\n3,4\n", ", line 3, column rate_deg_s: -inf is not a measured value"),
    "too large": (HEADER + b"1,1e999\n", ", line 2, column a: 1e999 is too large"),
    "endless": (HEADER + b"1," + b"9" * 5000 + b"\n", ", line 2, column a: [...] is too large"),
    "absurd": (HEADER + b"1,1e200\n2,3\n3,4\n", ", line 2, column a: 1e200 is an instrument's word for overload"),
    "underscore": (HEADER + b"1,1_0\n", ", line 2, column a: '1_0' is not a number"),
    "minus sign": (HEADER + "1,\u22122\n".encode(), ", line 2, column a: '\u22122' has a typographic minus sign"),
    "too few": (HEADER + b"1,2\n2,3\n", ": at least 3 points are needed, the file has 2"),
    "constant rate": (HEADER + b"5,2\n5,3\n5,3\n", ", column rate_deg_s: every rate is 5"),
    "dead output": (HEADER + b"1,2\n2,2\n3,2\n", ", column a: the output does not follow the rate"),
    "first header": (
        b"rate,a\n1,2\n",
        ", line 1, column 1: the header must begin with rate_deg_s, or another rate",
    ),
    "no output": (b"rate_deg_s\n1\n2\n3\n", ", line 1: expected an output column"),
    "twice": (b"rate_deg_s,a,a\n1,2,3\n", ", line 1, column 3: there is already a column a"),
    "thousands": (
        b"rate_deg_s;a\n1,500;2\n",
        ", line 2: '1,500' may be a decimal comma, or one of",
    ),
    "unknown unit": (b"rate_deg_s,a [furlong]\n1,2\n", ", column a [furlong]: expected the unit of an output"),
    "two rates": (b"x [deg/s],y [deg/s]\n1,2\n", ", line 1, x [deg/s], y [deg/s] may each be the applied rate"),
    "formula": (b"rate_deg_s,=cmd|' /C calc'!A0\n1,2\n2,3\n3,4\n", ', line 1, column 2: "=cmd'),
    "escape": (
        b"rate_deg_s,a\x1b[2J\n1,2\n2,3\n3,4\n",
        ", line 1, column 2: 'a\\x1b[2J' is a spreadsheet formula or not printable",
    ),
    "latin-1": (HEADER + b"1,2\n2,\xb5\n", ", line 3: this is not UTF-8 text"),
    "UTF-16": ("rate_deg_s,a\n1,2\n".encode("utf-16")[:-1], ": expected whole UTF-16 text"),
    "binary": (b"rate_deg_s,a\n1,\0\n", ", line 2: this is not a text file"),
    "open quote": (HEADER + b'1,"2\n', ", line 2: this is not CSV"),
    "single points": (b"step,rate_deg_s,v_vc_v,output_v,std_v,n\n1,10,0,1,0,1\n", ": no step has 3 points"),
}


@pytest.mark.parametrize("case", UNUSABLE)
def test_unusable_file_is_one_sentence(case: str, written: Callable[[bytes], Path]) -> None:
    content, words = UNUSABLE[case]
    file = written(content)
    with pytest.raises(ConfigError) as caught:
        analyze(file)
    message = str(caught.value)
    assert message.startswith(f"{file}{words}")
    assert "\n" not in message
    assert caught.value.exit_code == 2


def test_missing_file_and_directory_are_named(tmp_path: Path) -> None:
    with pytest.raises(ConfigError, match=r"none\.csv: expected a table, there is no such file"):
        vcfbench.analyze(tmp_path / "none.csv")
    with pytest.raises(ConfigError, match=r"expected a table, this is a directory"):
        vcfbench.analyze(tmp_path)


@pytest.mark.parametrize(
    "content",
    [
        b"\xef\xbb\xbfrate_deg_s,a\n1,2\n2,3.5\n3,4\n",
        b"rate_deg_s,a\r\n1,2\r\n2,3.5\r\n3,4\r\n\r\n\r\n",
        b' rate_deg_s , "a"\n+1, 2.\n2e0 ,3.5\n"3",4',
    ],
)
def test_harmless_variants_are_read(content: bytes) -> None:
    (series,) = read_table(BytesIO(content), "t.csv", Layout(), []).values()
    assert (series.rate_deg_s.tolist(), series.output.tolist()) == ([1, 2, 3], [2, 3.5, 4])


@given(st.binary(max_size=200))
def test_any_bytes_give_series_or_a_sentence(content: bytes) -> None:
    try:
        read_table(BytesIO(content), "t.csv", Layout(), [])
    except ConfigError as error:
        assert str(error).startswith("t.csv")  # noqa: PT017 - either outcome is right, not this one alone


@given(st.text(alphabet="rate_deg_s,ab\n\r\"';\t-.0123456789e ", max_size=120))
def test_any_text_after_good_header_gives_series_or_message(text: str) -> None:
    try:
        series = read_table(BytesIO(f"rate_deg_s,a\n{text}".encode()), "t.csv", Layout(), [])
    except ConfigError as error:
        assert str(error).startswith("t.csv")  # noqa: PT017 - as above
    else:
        assert len(series["a"].output) >= 3
