"""Dates, times and words for no value in logs at rest."""

from __future__ import annotations

import json
from typing import TYPE_CHECKING

import pytest
from msgspec import structs
from typer.testing import CliRunner

from tests.archive.test_layouts import log
from vcfbench.analysis.csv_table import Layout
from vcfbench.archive.analyzed_record import analyze_record
from vcfbench.cli.main import app
from vcfbench.errors import ConfigError

if TYPE_CHECKING:
    from pathlib import Path

WORDS = ("NA", "#N/A", "-", "--", "---.--", "1.#QNAN", "-1.#IND", "nan(ind)", "OVLD", "\u221e", "?", "", "-OL", "+OL")


def interval_s(path: Path, head: str, row: str) -> float:
    path.write_text(log(head + "\n", row))
    done = CliRunner().invoke(app, ["analyze", str(path), "--json"])
    assert done.exit_code == 0, done.output
    return float(json.loads(done.stdout)["interval_s"])


@pytest.mark.parametrize(("day", "clock"), [("Datum", "Uhrzeit"), ("Day", "Received"), ("Fecha", "Hora"), ("", "")])
@pytest.mark.parametrize("written", ["2026-03-29", "29.03.2026", "03/29/2026"])
def test_dates_beside_times_of_day_need_no_option(day: str, clock: str, written: str, tmp_path: Path) -> None:
    for head, row in (
        (f"{day};{clock};gyro [deg/s]", f"{written};10:00:00.{{k:02d}};{{x}}"),
        (f"gyro [deg/s];{day};{clock}", f"{{x}};{written};10:00:00.{{k:02d}}"),
    ):
        assert interval_s(tmp_path / "log.csv", head, row) == pytest.approx(0.01)


@pytest.mark.parametrize("head", [",gyro [deg/s]", "received,gyro [deg/s]", "index,gyro [deg/s]"])
def test_dates_with_times_need_no_name(head: str, tmp_path: Path) -> None:
    assert interval_s(tmp_path / "log.csv", head, "2026-03-29 10:00:00.{k:02d}0,{x}") == pytest.approx(0.01)


@pytest.mark.parametrize("word", WORDS)
def test_every_word_for_no_value_has_one_cure(word: str, tmp_path: Path) -> None:
    (tmp_path / "log.csv").write_text(log("t_s,gyro_dps\n") + f"0.8,{word}\n", "utf-8")
    with pytest.raises(ConfigError, match=r"line 82, column gyro_dps: ") as error:
        analyze_record(tmp_path / "log.csv")
    assert error.value.hint == "take the line out, if times tell of the gap"


@pytest.mark.parametrize("unit", ["degree C", "Degrees C", "degree Celsius", "Grad C"])
def test_temperature_in_words_is_no_time(unit: str, tmp_path: Path) -> None:
    assert interval_s(tmp_path / "log.csv", f"t_s,gyro_dps,T ({unit})", "{t:.2f},{x},25.1") == pytest.approx(0.01)


PICO = "Time,Channel A\n(s),(dps)\n\n"
SEGMENT = "Channels\t1\n***End_of_Header***\nX_Value\tgyro\tComment\n"


@pytest.mark.parametrize("head", [PICO, PICO + "\r\n", "t_s,gyro_dps\n\n", "t_s,gyro_dps\n \n\n"])
def test_blank_lines_above_the_numbers_hide_none(head: str, tmp_path: Path) -> None:
    (tmp_path / "log.csv").write_text(log(head))
    found = analyze_record(tmp_path / "log.csv")
    assert (found.samples, found.interval_s) == (80, pytest.approx(0.01))


@pytest.mark.parametrize(
    ("text", "layout", "said"),
    [
        (log("t_s,id,gyro_dps\n", "{t},A,{x}"), Layout(rows=("id", "a")), "column id: no line has 'a'"),
        (log("t_s,gyro_dps\n") + "; door\n", Layout(), "line 82: 2 columns expected, got 1, '; door'"),
        (log("t_s,gyro_dps\n") + "$a,1,2\n", Layout(), "line 82: 2 columns expected, got 3, '$a,1,2'"),
        ("***End_of_Header***", Layout(), "line 1: expected the names .*; --skip 1$"),
        ("A\n\n***End_of_Header***\n\nX\n1\n", Layout(), "line 1: expected the names .*; --skip 3$"),
        (2 * log(SEGMENT, "{t}\t{x}\t"), Layout(), "line 1: expected the names .*; --skip 2$"),
        (2 * log(SEGMENT, "{t}\t{x}\t"), Layout(skip=2), "line 84: 3 columns expected, got 2, 'Channels 1'"),
    ],
)
def test_line_that_cannot_be_read_is_shown(text: str, layout: Layout, said: str, tmp_path: Path) -> None:
    (tmp_path / "log.csv").write_text(text)
    given = structs.replace(layout, units={"X_Value": "s", "gyro": "dps"} if "X_Value" in text else {})
    given = structs.replace(given, time="X_Value" if "X_Value" in text else None)
    with pytest.raises(ConfigError, match=said.replace("$a", r"\$a")):
        analyze_record(tmp_path / "log.csv", layout=given)
