"""Cells that can be read in one way are read so; all others are asked about, with the option that answers."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np
import pytest

from vcfbench.analysis.cells import clock_period_s, clock_s, number
from vcfbench.analysis.csv_table import Layout
from vcfbench.archive.analyzed import analyze
from vcfbench.errors import ConfigError

if TYPE_CHECKING:
    from pathlib import Path


def grouped(value: float, decimals: int, sign: str) -> str:
    """Return a number as people write it whose decimals stand behind `sign`, thousands behind the other."""
    text = f"{value:,.{decimals}f}"
    return text if sign == "." else text.translate(str.maketrans(",.", ".,"))


@pytest.mark.parametrize("sign", [".", ","])
@pytest.mark.parametrize("told", [True, False])
def test_thousands_are_read_where_sure_and_asked_about_elsewhere(sign: str, *, told: bool) -> None:
    draw = np.random.default_rng(5)
    for value in (10.0 ** draw.uniform(0, 8, 60) * draw.choice([-1, 1], 60)).tolist():
        for decimals in (0, 1, 2, 3):
            cell, true = grouped(value, decimals, sign), float(f"{value:.{decimals}f}")
            groups = cell.count("." if sign == "," else ",")
            if groups == 1 and not decimals and not told:
                with pytest.raises(ConfigError) as error:
                    number(cell, "a", decimal_comma=sign == ",", thousands=told)
                assert error.value.hint == "--decimal comma, or point"
            else:
                assert number(cell, "a", decimal_comma=sign == ",", thousands=told) == true


ROWS = (-20000.0, -10000.0, -5000.0, 0.0, 5000.0, 10000.0, 20000.0)


@pytest.mark.parametrize("sign", [".", ","])
@pytest.mark.parametrize("millis", [0, 1])
def test_thousands_of_a_whole_table_are_never_taken_for_decimals(tmp_path: Path, sign: str, millis: int) -> None:
    file = tmp_path / "table.csv"
    rows = [f"{grouped(rate, 0, sign)};{grouped(500.0 + 0.001 * rate, millis, sign)}" for rate in ROWS]
    file.write_text("\n".join(["rate [deg/h];output [mV]", *rows]))
    if not (millis and sign == ","):  # a decimal comma elsewhere says what the point is
        with pytest.raises(ConfigError) as error:
            analyze(file)
        assert error.value.hint == "--decimal comma, or point"
    found = analyze(file, layout=Layout(decimal="comma" if sign == "," else "point")).series["output [mV]"]
    assert found.line.scale_factor == pytest.approx(3.6e-3)


@pytest.mark.parametrize(
    ("cell", "words"),
    [
        ("1'000", '"1\'000" is not a number'),
        ("0.0000 \N{PLUS-MINUS SIGN} 0.0002", "is not a number"),
        ("0.01 sec", "write its unit sec into the name"),
        ("12h", "write its unit h into the name"),
        *((cell, "hexadecimal: write counts as decimals") for cell in ("FFE1", "c568", "0xFF", "7Fh")),
    ],
)
def test_cell_that_is_no_number_has_no_false_cure(cell: str, words: str) -> None:
    with pytest.raises(ConfigError) as error:
        number(cell, "a", decimal_comma=False, thousands=False)
    assert words in str(error.value)
    assert error.value.hint is None


def test_exponents_of_fortran_are_read() -> None:
    assert number("-1.25D+01", "a", decimal_comma=False, thousands=False) == -12.5


@pytest.mark.parametrize(
    ("cell", "expected", "period_s"),
    [
        ("2000-01-02T01:00:00.5", 90000.5, None),
        ("2000-01-02 01:00:00+01:00", 86400.0, None),
        ("01:00:00.25", 3600.25, 43200.0),
        ("1:00:00,25", 3600.25, 43200.0),
        ("12:00:01 AM", 1.0, 43200.0),
        ("04/05/2026 1:00:00.250 p.m.", 46800.25, 43200.0),
        ("04.05.26 13:14:15", 47655.0, 43200.0),
        ("05-May-2026 13:14:15", 47655.0, 43200.0),
        ("13:14:15:005", 47655.005, 43200.0),
        ("10:00", 36000.0, 43200.0),
        ("00:59.99", 59.99, 3600.0),
    ],
)
def test_times_are_read_as_loggers_write_them(cell: str, expected: float, period_s: float | None) -> None:
    assert clock_s(cell, "a") == pytest.approx(expected)
    assert clock_period_s(cell) == period_s


@pytest.mark.parametrize("cell", ["2026-13-01T00:00:00", "soon", "2026-11-29", ""])
def test_what_is_no_time_is_refused(cell: str) -> None:
    with pytest.raises(ConfigError, match="expected a date such as"):
        clock_s(cell, "a")
