"""A run seen by its events, and the same one seen by its journal as it grows."""

from __future__ import annotations

from typing import TYPE_CHECKING

import pytest

import vcfbench
from vcfbench.page.following import JournalFollower, introduce
from vcfbench.page.view import BrowserPosition, View
from vcfbench.records.journal import Journal, being_written
from vcfbench.runs.request import Request, prepare

if TYPE_CHECKING:
    from pathlib import Path

    from vcfbench.steps.events import Event


class Watching:
    """Follows a run by its events, and looks at its journal now and then."""

    def __init__(self, runs: Path) -> None:
        self.view = View()
        introduce(self.view, prepare(Request("turntable")))
        self._runs = runs
        self.journal: JournalFollower | None = None
        self.written: bool | None = None
        self.counts: list[int] = []

    def handle(self, event: Event) -> None:
        self.view.handle(event)
        if self.journal is None:
            path = next(self._runs.glob("*/journal.jsonl"))
            self.journal, self.written = JournalFollower(path), being_written(path)
        if self.view.version % 40 == 0:
            self.journal.read_on()
            self.counts.append(len(self.journal.view.points))


@pytest.fixture(scope="module")
def watched(tmp_path_factory: pytest.TempPathFactory) -> Watching:
    runs = tmp_path_factory.mktemp("runs")
    watching = Watching(runs)
    vcfbench.run("turntable", runs=runs, observers=[watching])
    assert watching.journal is not None
    watching.journal.read_on()
    return watching


def test_both_tell_the_same(watched: Watching) -> None:
    assert watched.journal is not None
    live, read = watched.view, watched.journal.view
    assert live.points == read.points
    assert read.planned_s == pytest.approx(live.planned_s)  # so that the page knows when it ends
    assert len(live.points) == 17
    assert [each["what"] for each in live.steps] == [each["what"] for each in read.steps]
    assert live.log == read.log
    assert live.state == read.state
    assert live.readings == read.readings == 190
    assert live.drawn(None, None, 1000)["v"] == read.drawn(None, None, 1000)["v"]
    assert live.about["limits"] == read.about["limits"]
    assert ["max rate", "300 deg/s"] in live.about["limits"]


def test_a_journal_is_followed_while_it_grows(watched: Watching) -> None:
    assert watched.written is True
    assert 0 < watched.counts[len(watched.counts) // 2] < 17
    assert watched.counts == sorted(watched.counts)


def test_when_it_is_whole_nobody_writes_it(watched: Watching) -> None:
    assert watched.journal is not None
    assert not being_written(watched.journal.path)
    assert watched.journal.view.end == {"status": "complete", "error": None}


def test_who_comes_late_is_told_everything_then_only_news(watched: Watching) -> None:
    view, seen = watched.view, BrowserPosition()
    first = view.news(seen)
    assert first is not None
    assert len(first["steps"]) == len(view.steps)
    assert len(first["points"]) == 17
    assert view.news(seen) is None
    view.say(1.0, "something", "note")
    later = view.news(seen)
    assert later is not None
    assert later["steps"] == []
    assert [each["what"] for each in later["log"]] == ["something"]
    assert "points" not in later
    assert "about" not in later


def test_early_listener_gets_name_of_run_at_its_begin() -> None:
    view, seen = View(), BrowserPosition()
    before = view.news(seen)
    assert before is not None
    assert "about" not in before
    view.about = {"run": "it"}
    view.say(0.0, "begun", "note")
    after = view.news(seen)
    assert after is not None
    assert after["about"] == {"run": "it"}


def test_the_line_through_the_points_is_that_of_the_results(watched: Watching) -> None:
    news = watched.view.news(BrowserPosition())
    assert news is not None
    (line,) = news["lines"]
    assert line["step"] == 1
    assert line["scale_factor"] == pytest.approx(-0.01254, rel=1e-3)
    assert len(line["residuals_v"]) == 17


def test_readings_of_a_stretch(watched: Watching) -> None:
    shown = watched.view.drawn(30.0, 60.0, 1000)
    assert shown["all"]
    assert shown["count"] == 190
    assert shown["shown"] == len(shown["t_s"])
    assert 30.0 <= min(shown["t_s"]) <= max(shown["t_s"]) <= 60.0


def test_a_torn_line_is_read_when_it_is_whole(tmp_path: Path, watched: Watching) -> None:
    assert watched.journal is not None
    data = watched.journal.path.read_bytes()
    torn = tmp_path / "journal.jsonl"
    torn.write_bytes(data[:-100])
    follower = JournalFollower(torn)
    follower.read_on()
    assert follower.view.end is None
    torn.write_bytes(data)
    follower.read_on()
    assert follower.view.end is not None
    assert len(follower.view.points) == 17


def test_lines_that_are_none_are_passed_over(tmp_path: Path) -> None:
    path = tmp_path / "journal.jsonl"
    step = b'{"type":"step","n":1,"end_s":1,"step_kind":"x","step":{},"result_kind":"x","result":1}\n'
    deep = b'{"type":"step","n":' + b"[" * 100_000 + b"\n"
    footer = b'{"type":"footer","status":"complete","error":"no object"}\n'
    path.write_bytes(b'no json\n{"type":"step"}\n{"type":"readings"}\n[]\n{"type":"unknown"}\n' + step + deep + footer)
    follower = JournalFollower(path)
    follower.read_on()
    assert follower.view.steps == []


def test_a_journal_is_being_written_until_it_is_closed(tmp_path: Path) -> None:
    path = tmp_path / "journal.jsonl"
    assert not being_written(path)
    journal = Journal(path)
    journal.header({"run": "r"})
    assert being_written(path)
    journal.close()
    assert not being_written(path)
