"""Times of records: what loggers write is read, what cannot be is told with the cure that the file itself holds."""

from __future__ import annotations

import re
import shlex
from typing import TYPE_CHECKING, Any

import numpy as np
import pytest

from tests.cells import few
from vcfbench.analysis.csv_table import Layout
from vcfbench.archive.analyzed_record import analyze_record
from vcfbench.errors import ConfigError

if TYPE_CHECKING:
    from collections.abc import Callable
    from pathlib import Path

RATES = np.random.default_rng(8).standard_normal(3000).round(4).tolist()


def log(path: Path, cell: Callable[[int], str], head: str = "time", count: int = 3000) -> Path:
    rows = [f"{cell(each)},{RATES[each]}" for each in range(count)]
    path.write_text("\n".join([f"{head},gz [deg/s]", *rows]))
    return path


def clock(ms: int) -> str:
    return f"{ms // 3_600_000 % 24:02d}:{ms // 60_000 % 60:02d}:{ms // 1000 % 60:02d}.{ms % 1000:03d}"


BEFORE = 24 * 3_600_000 - 15_000
READ: dict[str, tuple[str, Callable[[int], str]]] = {
    "over midnight": ("time", lambda k: clock(BEFORE + 10 * k)),
    "of twelve hours": (
        "time",
        lambda k: clock(BEFORE // 2 + 7500 + 10 * k).replace("11:", "12:").replace("00:", "01:", 1),
    ),
    "before noon and after": (
        "time",
        lambda k: f"{'11:59' if k < 1500 else '12:00'}:{(45 + 0.01 * k) % 60:06.3f} {'AM' if k < 1500 else 'PM'}",
    ),
    "day and time": ("date,time", lambda k: f"2026-05-0{4 + (k >= 1500)},{clock(BEFORE + 10 * k)}"),
    "days with points": ("time", lambda k: f"0{4 + (k >= 1500)}.05.26 {clock(BEFORE + 10 * k)}"),
    "over the hour": ("time", lambda k: clock(BEFORE + 10 * k)[3:-1]),
}


@pytest.mark.parametrize("kind", few(READ, every=3))
def test_times_go_on_over_their_period(tmp_path: Path, kind: str) -> None:
    head, cell = READ[kind]
    found = analyze_record(log(tmp_path / "a.csv", cell, head))
    assert (found.samples, found.interval_s) == (3000, pytest.approx(0.01))
    assert found.notices == ()


def test_days_of_a_spreadsheet_are_no_seconds(tmp_path: Path) -> None:
    file = log(tmp_path / "a.csv", lambda k: f"{46000.5 + k / 8640000:.10f}")
    with pytest.raises(ConfigError, match="may be days of a spreadsheet") as error:
        analyze_record(file, layout=Layout(units={"time": "s"}))
    assert "--unit TIME=d" in (error.value.hint or "")
    assert analyze_record(file, layout=Layout(units={"time": "d"})).interval_s == pytest.approx(0.01, rel=1e-4)


BEYOND: dict[str, Callable[[int], str]] = {
    "ms": lambda k: f"{1_790_000_000_000 + 10 * k}",
    "us": lambda k: f"{1_790_000_000_000_000 + 10_000 * k}",
    "ns": lambda k: f"{1_790_000_000_000_000_000 + 10_000_000 * k}",
    "digits of a date": lambda k: f"2026102502{k // 6000:02d}{k // 100 % 60:02d}.{k % 100:02d}",
    "ticks from 1601": lambda k: f"{133_000_000_000_000_000 + 100_000 * k}",
}


@pytest.mark.parametrize("kind", few(BEYOND, every=5))
@pytest.mark.parametrize("rate_hz", [None, 100.0, 0.1, 1e-4])
def test_seconds_of_no_date_are_refused(tmp_path: Path, kind: str, rate_hz: float | None) -> None:
    file = log(tmp_path / "a.csv", BEYOND[kind], "timestamp_s")
    with pytest.raises(ConfigError, match="no date in s") as error:
        analyze_record(file, rate_hz)
    assert "--unit timestamp_s=ms" in (error.value.hint or "")
    if kind in {"ms", "us", "ns"}:
        right = Layout(units={"timestamp_s": kind})
        assert analyze_record(file, layout=right).interval_s == pytest.approx(0.01, rel=1e-4)


@pytest.mark.parametrize("hz", [250, 400, 1000])
def test_rate_of_coarse_times_is_that_of_the_file(tmp_path: Path, hz: int) -> None:
    file = log(tmp_path / "a.csv", lambda k: f"{k / hz:.2f}", "t_s")
    with pytest.raises(ConfigError) as error:
        analyze_record(file)
    assert f"--time none --rate {hz}, if each" in (error.value.hint or "")


REFUSED: dict[str, tuple[str, Callable[[int], str], str]] = {
    "axes by turns": ("t_s,axis", lambda k: f"{k // 3 / 100:.2f},{'xyz'[k % 3]}", "lines of x, y, z by turns"),
    "milliseconds without zeros": ("time", lambda k: f"12:00:{k // 100:02d}.{k % 100 * 10}", "without their zeros"),
}


@pytest.mark.parametrize("kind", REFUSED)
def test_no_rate_is_proposed_that_the_file_does_not_have(tmp_path: Path, kind: str) -> None:
    head, cell, words = REFUSED[kind]
    with pytest.raises(ConfigError, match=words) as error:
        analyze_record(log(tmp_path / "a.csv", cell, head))
    assert re.search(r"--rate \d", error.value.hint or "") is None


def test_few_missing_lines_are_told_with_the_option_for_all(tmp_path: Path) -> None:
    steps = np.ones(3000, int)
    steps[np.random.default_rng(2).integers(0, 3000, 10)] = 2
    places = np.cumsum(steps)
    file = log(tmp_path / "a.csv", lambda k: f"{places[k] / 100:.2f}", "t_s")
    found = analyze_record(file)
    assert found.samples < 2000
    assert "10 are missing: --time none --rate 100 takes all lines as even" in found.notices[-1]
    told: dict[str, Any] = {"layout": Layout(time="none")}
    assert analyze_record(file, 100.0, **told).samples == 3000


SOURCES: dict[str, tuple[str, list[str], bool]] = {
    "words": ("sensor", ["ACC", "GYRO"], False),
    "words of one time": ("Sensor type", ["acc", "gyro", "mag"], True),
    "axes": ("axis", ["x", "y", "z"], False),
    "names of one device": ("what", ["Linear Acceleration", "Gyroscope"], True),
    "numbers": ("I", ["0", "1", "2"], False),
    "numbers of events": ("event_id", ["3", "16"], True),
    "units": ("Unit", ["mV", "V"], False),
}


@pytest.mark.parametrize("kind", few(SOURCES, every=4))
@pytest.mark.parametrize(
    ("separator", "longer"), few([(each, more) for each in ",;\t" for more in (False, True)], (";", True))
)
def test_lines_of_several_sensors_are_read_one_by_one(
    tmp_path: Path, kind: str, separator: str, *, longer: bool
) -> None:
    column, words, at_once = SOURCES[kind]
    rows = [["t_ms", column, "x [deg/s]"]]
    for each in range(3000):
        for turn, word in enumerate(words):
            time_ms = 30 * each + (0 if at_once else 3 * turn)
            row = [str(time_ms), word, str(RATES[each] if word == words[-1] else 9.81)]
            rows.append([*row, "7"] if longer and word != words[-1] and each > 200 else row)
    file = tmp_path / "a.csv"
    file.write_text("\n".join(separator.join(row) for row in rows))
    with pytest.raises(ConfigError, match=f"column {column}: lines of {', '.join(words)} by turns") as error:
        analyze_record(file)
    assert any(f"--rows {shlex.quote(f'{column}={word}')} " in (error.value.hint or "") for word in words)
    found = analyze_record(file, layout=Layout(rows=(column, words[-1])))
    assert (found.samples, found.interval_s) == (3000, pytest.approx(0.03))
    assert found.mean_deg_s == pytest.approx(np.mean(RATES))
    assert found.notices == ()


@pytest.mark.parametrize("state", ["ok", "ok   fix", "ok" + " fix" * 40])
def test_words_that_seldom_change_are_no_sensors(tmp_path: Path, state: str) -> None:
    states = state.split(" ")
    file = log(tmp_path / "a.csv", lambda k: f"{k / 100:.2f},{states[k // 10 % len(states)] or 'none'}", "t_s,state")
    assert analyze_record(file).samples == 3000
