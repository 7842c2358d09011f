from __future__ import annotations

import json
from typing import TYPE_CHECKING

from tests.cli.test_run import Station, call, station
from vcfbench.errors import ConfigError

if TYPE_CHECKING:
    from pathlib import Path

__all__ = ["Station", "station"]


def test_no_records(station: Station, tmp_path: Path) -> None:  # pytest's way with fixtures
    assert call("runs", "list").stdout == "no records in runs\n"
    assert json.loads(call("runs", "list", "--json").stdout) == {"runs": []}
    assert station.opened == []
    assert list(tmp_path.iterdir()) == []


def test_list_and_show_what_was_run(station: Station) -> None:
    ran = json.loads(call("run", "virtual-coriolis", "--json", "--quiet").stdout)
    listed = json.loads(call("runs", "list", "--json").stdout)["runs"]
    assert [(line["run"], line["status"], line["points"]) for line in listed] == [(ran["run"], "complete", 51)]
    shown = json.loads(call("runs", "show", "last", "--json").stdout)
    assert shown["points"] == ran["points"]
    assert shown["results"] == ran["results"]  # made again from the journal
    assert "virtual Coriolis / V" in call("runs", "show", ran["run"]).stdout
    assert station.opened


def test_a_cut_record_is_incomplete_and_has_no_results(station: Station, tmp_path: Path) -> None:
    call("run", "turntable", "--quiet")
    journal = next((tmp_path / "runs").iterdir()) / "journal.jsonl"
    journal.write_bytes(journal.read_bytes()[:-40])
    shown = json.loads(call("runs", "show", "last", "--json").stdout)
    assert (shown["status"], shown["results"], len(shown["points"])) == ("incomplete", {}, 17)
    assert ": incomplete" in call("runs", "show", "last").stdout
    assert station.opened


def test_a_record_that_cannot_be_read_does_not_hide_the_others(station: Station, tmp_path: Path) -> None:
    call("run", "turntable", "--quiet")
    foreign = tmp_path / "runs" / "20990101T000000Z-turntable-000000"
    foreign.mkdir()
    (foreign / "journal.jsonl").write_text('{"type":"header","format":99}\n')
    listed = call("runs", "list", "--json")
    assert [line["status"] for line in json.loads(listed.stdout)["runs"]] == ["complete", "unreadable"]
    assert "format 99" in listed.stderr
    assert isinstance(call("runs", "show", "last").exception, ConfigError)
    assert station.opened


def test_settings_of_another_version_are_one_sentence(station: Station, tmp_path: Path) -> None:
    call("run", "turntable", "--quiet")
    journal = next((tmp_path / "runs").iterdir()) / "journal.jsonl"
    journal.write_bytes(journal.read_bytes().replace(b'"settings":{', b'"settings":{},"before":{', 1))
    shown = call("runs", "show", "last")
    assert isinstance(shown.exception, ConfigError)
    assert "header is not one of this version" in str(shown.exception)
    assert station.opened
