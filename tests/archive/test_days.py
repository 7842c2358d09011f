"""The days of a run are those of its readings, whatever came between them."""

from __future__ import annotations

import json
from typing import TYPE_CHECKING, Any

import pytest

from vcfbench.archive.days import days_of
from vcfbench.archive.run import Run
from vcfbench.records.schema import Status

if TYPE_CHECKING:
    from pathlib import Path

READ, SET = "Acquire", "SetRate"


def line(utc: str, kind: str = READ, took_s: float = 10.0, **more: Any) -> dict[str, Any]:
    return {"type": "step", "utc": f"{utc}+00:00", "n": 1, "step_kind": kind, "t_s": 5.0, "end_s": 5.0 + took_s, **more}


@pytest.mark.parametrize(
    ("lines", "simulated", "days"),
    [
        ([line("2026-05-04T12:00:00"), line("2026-05-04T13:00:00")], False, ("2026-05-04", "2026-05-04")),
        # a record of eight hours over midnight, whose one line is written in the morning
        ([line("2026-05-05T03:00:00", took_s=8 * 3600.0)], False, ("2026-05-04", "2026-05-05")),
        ([line("2026-05-05T03:00:00", took_s=8 * 3600.0)], True, ("2026-05-05", "2026-05-05")),
        # a pause over the night: bench time does not have it
        ([line("2026-05-04T20:00:00"), line("2026-05-05T08:00:00")], False, ("2026-05-04", "2026-05-05")),
        # resumed three days later: what was taken over keeps its time
        (
            [line("2026-05-01T20:00:00", taken_over="earlier"), line("2026-05-04T09:00:00")],
            False,
            ("2026-05-01", "2026-05-04"),
        ),
        # what is no reading: the ramps before and after
        (
            [line("2026-05-03T23:59:59", SET), line("2026-05-04T00:30:00"), line("2026-05-05T00:00:01", SET)],
            False,
            ("2026-05-04", "2026-05-04"),
        ),
        ([line("2026-05-05T09:00:00", "OwnStep")], False, ("2026-05-05", "2026-05-05")),  # of a kind not known here
        ([line("2026-05-05T09:00:00", SET)], False, ("2026-05-04", "2026-05-04")),  # no reading: when it began
        (
            [line("2026-05-05T09:00:00", READ, type="readings"), line("2026-05-06T09:00:00", SET)],
            False,
            ("2026-05-05",) * 2,
        ),
    ],
)
def test_the_days_are_those_of_the_readings(
    tmp_path: Path, lines: list[dict[str, Any]], days: tuple[str, str], *, simulated: bool
) -> None:
    header = {"type": "header", "format": 3, "utc": "2026-05-04T12:00:00+00:00", "procedure": "zero"}
    text = "".join(json.dumps(each, separators=(",", ":")) + "\n" for each in (header, *lines))
    (tmp_path / "journal.jsonl").write_text(text, "utf-8")
    assert days_of(Run("zero", Status.COMPLETE, directory=tmp_path, simulated=simulated)) == days
