from __future__ import annotations

import json
import os
from pathlib import Path
from typing import TYPE_CHECKING

import pytest
from simrack_tests.cells import few

from tests.cli.test_run import Station, call, station
from tests.seals import sealed
from vcfbench.cli.runs import list_
from vcfbench.errors import ConfigError
from vcfbench.station.file import embedded_text

if TYPE_CHECKING:
    from collections.abc import Callable

__all__ = ["Station", "station"]


def test_no_records(station: Station, tmp_path: Path) -> None:  # pytest's way with fixtures
    assert call("runs", "list").stdout == "no records in runs\n"
    assert json.loads(call("runs", "list", "--json").stdout) == {"runs": []}
    assert station.opened == []
    assert list(tmp_path.iterdir()) == []


@pytest.mark.exhaustive
def test_list_and_show_what_was_run(station: Station) -> None:
    ran = json.loads(call("run", "virtual-coriolis", "--json", "--quiet").stdout)
    listed = json.loads(call("runs", "list", "--json").stdout)["runs"]
    assert [(line["run"], line["status"], line["points"]) for line in listed] == [(ran["run"], "complete", 51)]
    shown = json.loads(call("runs", "show", "last", "--json").stdout)
    assert shown["points"] == ran["points"]
    assert shown["results"] == ran["results"]  # made again from the journal
    told = call("runs", "show", ran["run"]).stdout
    assert call("runs", "show", f"runs/{ran['run']}").stdout == told  # as the run's last line names it
    assert "virtual Coriolis / V" in told
    for name, version in shown["versions"].items():
        assert f"{name} {version}" in told
    assert f"E3631A {shown['identities']['power']['firmware']}" in told
    assert station.opened


def test_the_list_has_the_verdict_of_each_record(station: Station, tmp_path: Path) -> None:
    """It is that of the limits of the bench file of then."""
    bench = tmp_path / "strict.toml"
    for low, high in ((-1.0, 1.0), (1.0, 2.0)):
        bench.write_text(embedded_text("paper") + f"\n[acceptance]\nbias_v = [{low}, {high}]\n", encoding="utf-8")
        call("run", "turntable", "--quiet", "--bench", str(bench))
    call("run", "turntable", "--quiet")
    listed = json.loads(call("runs", "list", "--json").stdout)["runs"]
    assert [line["verdict"] for line in listed] == ["pass", "fail", None]
    assert [line.split()[-1] for line in call("runs", "list").stdout.splitlines()[2:]] == ["PASS", "FAIL", "-"]
    assert station.opened


def test_list_of_complete_records_reads_no_readings(
    station: Station, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """So that thousands are listed in seconds; a bench with limits is no exception, its verdict was stored."""
    bench = tmp_path / "strict.toml"
    bench.write_text(embedded_text("paper") + "\n[acceptance]\nbias_v = [1.0, 2.0]\n", encoding="utf-8")
    call("run", "turntable", "--quiet", "--bench", str(bench))
    call("run", "turntable", "--quiet")

    def read(path: Path) -> None:
        raise AssertionError(f"{path} was read in full")

    monkeypatch.setattr("vcfbench.records.directory.read_journal", read)
    listed = json.loads(call("runs", "list", "--json").stdout)["runs"]
    rows = [(line["status"], line["bench"], line["points"], line["verdict"]) for line in listed]
    assert rows == [("complete", "paper", 17, "fail"), ("complete", "paper", 17, None)]
    assert station.opened


def test_a_list_computes_the_verdict_where_none_was_stored(station: Station, tmp_path: Path) -> None:
    bench = tmp_path / "strict.toml"
    bench.write_text(embedded_text("paper") + "\n[acceptance]\nbias_v = [1.0, 2.0]\n", encoding="utf-8")
    call("run", "turntable", "--quiet", "--bench", str(bench))
    next((tmp_path / "runs").iterdir()).joinpath("result.json").unlink()
    assert json.loads(call("runs", "list", "--json").stdout)["runs"][0]["verdict"] == "fail"
    assert station.opened


def test_a_cut_record_is_incomplete_and_has_no_results(station: Station, tmp_path: Path) -> None:
    call("run", "turntable", "--quiet")
    journal = next((tmp_path / "runs").iterdir()) / "journal.jsonl"
    journal.write_bytes(journal.read_bytes()[:-40])
    shown = json.loads(call("runs", "show", "last", "--json").stdout)
    assert (shown["status"], shown["results"], len(shown["points"])) == ("incomplete", {}, 17)
    assert ": incomplete" in call("runs", "show", "last").stdout
    assert station.opened


def test_unreadable_record_does_not_hide_others(station: Station, tmp_path: Path) -> None:
    call("run", "turntable", "--quiet")
    foreign = tmp_path / "runs" / "20990101T000000Z-turntable-000000"
    foreign.mkdir()
    (foreign / "journal.jsonl").write_text('{"type":"header","format":99}\n')
    listed = call("runs", "list", "--json")
    assert [line["status"] for line in json.loads(listed.stdout)["runs"]] == ["complete", "unreadable"]
    assert "format 99" in listed.stderr
    assert isinstance(call("runs", "show", "last").exception, ConfigError)
    assert station.opened


def test_settings_of_another_version_cost_the_reckoning_and_nothing_else(station: Station, tmp_path: Path) -> None:
    """Results are those that were stored, the settings are shown as they are."""
    ran = json.loads(call("run", "turntable", "--quiet", "--json").stdout)
    journal = next((tmp_path / "runs").iterdir()) / "journal.jsonl"
    words = journal.read_bytes().replace(b'"settings":{"', b'"settings":{"before":{"that":7},"', 1)
    journal.write_bytes(sealed(words.replace(b'"samples":', b'"sample_count":', 1)))
    shown = json.loads(call("runs", "show", "last", "--json").stdout)
    assert (shown["results"], shown["points"]) == (ran["results"], ran["points"])
    assert "this version cannot read" in shown["no_results"]
    text = call("runs", "show", "last").stdout
    assert "results as stored: this version cannot read the settings" in text
    assert "\nscale_factor  " in text
    assert "\nbefore.that  " in text
    assert station.opened


@pytest.mark.parametrize("keys", [("samples",), ("station", "meter_resolution_v")])
def test_settings_that_lack_a_key_are_not_filled_in(keys: tuple[str, ...], station: Station, tmp_path: Path) -> None:
    call("run", "turntable", "--quiet")
    journal = next((tmp_path / "runs").iterdir()) / "journal.jsonl"
    first, rest = journal.read_text().split("\n", 1)
    header = json.loads(first)
    holder = header["settings"]
    for key in keys[:-1]:
        holder = holder[key]
    del holder[keys[-1]]
    journal.write_bytes(sealed(f"{json.dumps(header, separators=(',', ':'))}\n{rest}".encode()))
    shown = json.loads(call("runs", "show", "last", "--json").stdout)
    assert shown["no_results"] == f"this version cannot read the settings of the record: {keys[-1]} missing"
    assert station.opened


def test_a_damaged_record_is_shown_without_results_and_refused(station: Station, tmp_path: Path) -> None:
    call("run", "turntable", "--quiet")
    journal = next((tmp_path / "runs").iterdir()) / "journal.jsonl"
    lines = journal.read_bytes().splitlines(keepends=True)
    journal.write_bytes(b"".join([*lines[:20], *lines[23:]]))
    shown = call("runs", "show", "last", "--json")
    answer, damage = json.loads(shown.stdout), "line 21 was changed: its seal differs"
    assert (answer["status"], answer["damage"], answer["results"]) == ("damaged", damage, {})
    assert isinstance(shown.exception, ConfigError)
    assert shown.exception.exit_code == 2
    assert f"journal.jsonl: the record is damaged: {damage}" in str(shown.exception)
    text = call("runs", "show", "last")
    assert f": damaged: {damage}, turntable, bench" in text.stdout
    assert "no results: the record is damaged" in text.stdout
    assert f"damaged: {damage}" in call("runs", "list").stdout
    assert json.loads(call("runs", "list", "--json").stdout)["runs"][0]["status"] == "damaged"
    assert station.opened


def test_one_bad_record_does_not_end_the_list(station: Station, tmp_path: Path) -> None:
    call("run", "turntable", "--quiet")
    whole = next((tmp_path / "runs").iterdir()) / "journal.jsonl"
    deep = tmp_path / "runs" / "20200101T000000Z-turntable-000000"
    deep.mkdir()
    (deep / "journal.jsonl").write_bytes(
        whole.read_bytes().splitlines(keepends=True)[0] + b"[" * 3000 + b"]" * 3000 + b"\n"
    )
    (tmp_path / "runs" / "fifo").mkdir()
    os.mkfifo(tmp_path / "runs" / "fifo" / "journal.jsonl")
    listed = call("runs", "list", "--json")
    assert listed.exception is None
    lines = {line["run"]: line for line in json.loads(listed.stdout)["runs"]}
    assert lines[deep.name]["damage"] == "line 2 is no JSON object"
    assert lines["fifo"]["status"] == "unreadable"
    assert lines[whole.parent.name]["status"] == "complete"
    assert "this is a pipe" in listed.stderr
    assert station.opened


def test_a_record_is_shown_without_the_procedure_that_made_it(station: Station, tmp_path: Path) -> None:
    ran = json.loads(call("run", "turntable", "--quiet", "--json").stdout)
    _call_it_hysteresis(tmp_path / "runs" / ran["run"])
    shown = call("runs", "show", "last")
    assert shown.exception is None
    assert "hysteresis, bench" in shown.stdout
    assert "results as stored: the procedure 'hysteresis' is not known here" in shown.stdout
    assert "nonlinearity_ppm.max_span" in shown.stdout
    assert shown.stdout.count("  10\n") >= 17
    answer = json.loads(call("runs", "show", "last", "--json").stdout)
    assert (answer["procedure"], answer["results"], len(answer["points"])) == ("hysteresis", ran["results"], 17)
    assert station.opened


def _call_it_hysteresis(record: Path) -> None:
    for name, colon in (("journal.jsonl", b":"), ("result.json", b": ")):
        words = b'"procedure"' + colon
        was = (record / name).read_bytes()
        assert was.count(words + b'"turntable"')
        now = was.replace(words + b'"turntable"', words + b'"hysteresis"', 1)
        (record / name).write_bytes(sealed(now) if name == "journal.jsonl" else now)


@pytest.mark.parametrize(
    ("spoil", "words"),
    few(
        [
            (lambda path: path.unlink(), "there is no such file"),
            (lambda path: path.write_text("["), "expected the result of a run, got no JSON object"),
            (lambda path: path.write_text("[" * 5000 + "]" * 5000), "got no JSON object"),
            (lambda path: path.write_text("[1]"), "got no JSON object"),
            (lambda path: path.write_text("{}"), "expected the result of this run, got the result of another run"),
            (
                lambda path: path.write_text(path.read_text().replace('"n": 10', '"n": 11', 1)),
                "expected the result of this run, got the result of another run",
            ),
        ],
        every=3,
    ),
)
def test_stored_results_of_other_points_are_not_shown(
    station: Station, tmp_path: Path, spoil: Callable[[Path], object], words: str
) -> None:
    ran = json.loads(call("run", "turntable", "--quiet", "--json").stdout)
    _call_it_hysteresis(tmp_path / "runs" / ran["run"])
    spoil(tmp_path / "runs" / ran["run"] / "result.json")
    shown = call("runs", "show", "last")
    assert shown.exception is None
    assert "no results: the procedure 'hysteresis' is not known here; " in shown.stdout
    assert words in shown.stdout
    assert json.loads(call("runs", "show", "last", "--json").stdout)["results"] == {}
    assert station.opened


def test_a_record_without_name_is_not_the_only_one(station: Station) -> None:
    call("run", "turntable", "--quiet")
    assert "expected the name of a run" in str(call("runs", "show", "").exception)
    assert station.opened


def test_a_record_does_not_write_on_the_terminal(station: Station, tmp_path: Path) -> None:
    call("run", "turntable", "--quiet")
    journal = next((tmp_path / "runs").iterdir()) / "journal.jsonl"
    journal.write_bytes(
        sealed(journal.read_bytes().replace(b'"procedure":"turntable"', b'"procedure":"\\u001b[2J"', 1))
    )
    assert "\x1b" not in call("runs", "show", "last").stdout + call("runs", "list").stdout
    assert station.opened


@pytest.mark.parametrize(("width", "lines"), [(60, 10), (200, 3)])
def test_a_narrow_terminal_gets_a_block_a_record(
    station: Station, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str], width: int, lines: int
) -> None:
    call("run", "turntable", "--quiet")
    monkeypatch.setattr("sys.stdout.isatty", lambda: True)
    monkeypatch.setenv("COLUMNS", str(width))
    list_(Path("runs"))
    out = capsys.readouterr().out.splitlines()
    assert len(out) == lines
    assert max(map(len, out)) <= width
    assert station.opened
