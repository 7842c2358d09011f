"""A bench whose program died: what the watchdog writes down, says and tells."""

from __future__ import annotations

import json
import signal
import sys
from typing import TYPE_CHECKING, Any

import msgspec
import pytest

import vcfbench
from vcfbench.bench.make_safe import MadeSafe, Safed
from vcfbench.cli import left_live
from vcfbench.errors import Aborted, ConnectFailed, NotSafe
from vcfbench.interfaces import SafeReport
from vcfbench.records.journal import Journal, read_journal
from vcfbench.safety.lock import InUse, Owner
from vcfbench.safety.processes import KILL
from vcfbench.safety.signals import StopSignals

if TYPE_CHECKING:
    from collections.abc import Mapping
    from pathlib import Path

PAPER = vcfbench.load_bench("paper")
BENCH = {**json.loads(json.dumps(msgspec.to_builtins(PAPER))), "notify": {"command": ["tell"]}}
CHARGE: dict[str, Any] = {"bench": BENCH, "owner": 4711, "mark": "mark"}
SAFE = MadeSafe((Safed("power", "COM1", "on", safe=True, detail="off"),), ())
LIVE = MadeSafe((), (SafeReport("power", "COM1", safe=False, detail="nobody answers"),))
TAKEN = InUse("in use")
TAKEN.owner = Owner(4712, "Eve", "here", "today", "paper", "COM1")
LEFT = MadeSafe((), (), left_to={"power": TAKEN, "rate_table": TAKEN, "chamber": InUse("in use")})


@pytest.fixture
def journal(tmp_path: Path) -> Path:
    (tmp_path / "run").mkdir()
    path = tmp_path / "run" / "journal.jsonl"
    made = Journal(path)
    made.header({"run": "run"})
    made.close()
    return path


@pytest.fixture
def told(monkeypatch: pytest.MonkeyPatch) -> list[Any]:
    """The signals that are ignored and let through, the words for the terminal, and what is told to a program."""
    told: list[Any] = []
    monkeypatch.setattr("signal.signal", lambda number, handler: told.append((number, handler)))
    monkeypatch.setattr("signal.pthread_sigmask", lambda how, which: told.append((how, which)))
    monkeypatch.setattr("vcfbench.cli.ending.say", lambda words, *, alarm: told.append((words, alarm)))
    monkeypatch.setattr("vcfbench.runs.notified.notify", lambda _notice, outcome: told.append(outcome))
    return told


def made_safe(
    monkeypatch: pytest.MonkeyPatch, made: MadeSafe | Exception, journal: Path | None, **said: bytes
) -> tuple[int, list[bool]]:
    left: list[bool] = []

    def safe(charge: dict[str, Any], *, left: bool) -> MadeSafe:
        assert charge == CHARGE
        asked.append(left)
        if isinstance(made, Exception):
            raise made
        return made

    asked = left
    monkeypatch.setattr("vcfbench.bench.abandoned.safe_abandoned", safe)
    words = {
        b"bench": json.dumps(CHARGE).encode(),
        b"owner": b'4711 "power at COM1"',
        **{kind.encode(): value for kind, value in said.items()},
    }
    if journal is not None:
        words[b"journal"] = json.dumps(str(journal)).encode()
    return left_live.make_safe(words, "it died"), left


def line_of(journal: Path) -> Mapping[str, Any]:
    record = read_journal(journal)
    assert record.damage is None
    return {key: value for key, value in record.lines[-1].items() if key != "utc"}


def test_a_bench_that_was_made_safe_is_said_to_be(
    journal: Path, told: list[Any], monkeypatch: pytest.MonkeyPatch
) -> None:
    code, left = made_safe(monkeypatch, SAFE, journal, step=b'"ramp"')
    assert (code, left) == (0, [False])
    assert line_of(journal) == {
        "type": "watchdog",
        "why": "it died in ramp",
        "safe": True,
        "instruments": [{"instrument": "power", "found": "on", "safe": True, "detail": "off"}],
    }
    ignored, (words, outcome) = told[:-2], told[-2:]
    assert ignored == [
        *((number, signal.SIG_IGN) for number in (signal.SIGINT, signal.SIGTERM, signal.SIGHUP)),
        (signal.SIG_SETMASK, ()),
    ]
    assert words == ("vcfbench watchdog: it died in ramp; the bench was made safe", False)
    assert outcome == {
        "outcome": "failed",
        "exit_code": None,
        "error": "it died in ramp; the bench was made safe",
        "run": "run",
        "directory": str(journal.parent),
        "bench": "paper",
    }


@pytest.mark.parametrize("made", [SAFE, LIVE, OSError("no memory")])
def test_not_safe_is_printed_first_even_if_nothing_loads(
    made: MadeSafe | Exception,
    journal: Path,
    told: list[Any],
    monkeypatch: pytest.MonkeyPatch,
    capfd: pytest.CaptureFixture[str],
) -> None:
    monkeypatch.setattr("vcfbench.records.journal.append_line", lambda *_: told.append("written"))
    code, _ = made_safe(monkeypatch, made, journal)
    (said, _), written, notified = told[-3:]
    assert (written, notified["exit_code"]) == ("written", code or None)
    for module in ("vcfbench.cli.ending", "vcfbench.records.journal", "vcfbench.runs.notified"):
        monkeypatch.setitem(sys.modules, module, None)  # an import raises ImportError
    assert made_safe(monkeypatch, made, journal)[0] == code
    words = capfd.readouterr().err
    assert words.startswith("vcfbench watchdog: it died; ")
    assert ("NOT SAFE: power at COM1: " in words) == (code == 5)
    assert words == f"{said}\n"


@pytest.mark.parametrize(
    ("made", "words"),
    [
        (LIVE, "NOT SAFE: power at COM1: nobody answers; make it safe by hand before anything else"),
        (
            OSError("no\n\nmemory"),
            "NOT SAFE: power at COM1: OSError: no memory; make it safe by hand before anything else",
        ),
        (MemoryError(), "NOT SAFE: power at COM1: MemoryError; make it safe by hand before anything else"),
    ],
)
def test_one_that_is_not_is_said_not_to_be(
    made: MadeSafe | Exception, words: str, journal: Path, told: list[Any], monkeypatch: pytest.MonkeyPatch
) -> None:
    code, _ = made_safe(monkeypatch, made, journal)
    assert code == 5
    line = line_of(journal)
    raised = f"{type(made).__name__}: {made}"
    assert (line["safe"], line.get("error")) == ((False, None) if made is LIVE else (None, raised))
    assert told[-2:] == [
        (f"vcfbench watchdog: it died; {words}", True),
        {
            "outcome": "NOT SAFE",
            "exit_code": 5,
            "error": f"it died; {words}",
            "run": "run",
            "directory": str(journal.parent),
            "bench": "paper",
        },
    ]


def test_what_others_have_taken_over_is_named(journal: Path, told: list[Any], monkeypatch: pytest.MonkeyPatch) -> None:
    code, _ = made_safe(monkeypatch, LEFT, journal)
    others = f"another process, {TAKEN.owner}"
    assert code == 0
    assert (line_of(journal)["left_to"], line_of(journal)["safe"]) == (others, True)
    assert told[-2] == (f"vcfbench watchdog: it died; instruments taken over by {others} were left to it", False)


def test_a_program_that_lives_on_closes_its_own_record(
    journal: Path, told: list[Any], monkeypatch: pytest.MonkeyPatch
) -> None:
    before = journal.read_bytes()
    assert made_safe(monkeypatch, SAFE, journal, left=b"live") == (0, [True])
    assert journal.read_bytes() == before
    assert made_safe(monkeypatch, SAFE, None) == (0, [False])  # it had none yet
    assert (told[-1]["run"], told[-1]["directory"]) == (None, None)


def test_its_line_is_signed_where_the_station_signs(
    journal: Path, told: list[Any], monkeypatch: pytest.MonkeyPatch
) -> None:
    pytest.importorskip("cryptography")
    from vcfbench.records.signing import new_key  # noqa: PLC0415

    new_key(journal.with_name("key"))
    monkeypatch.delenv("VCFBENCH_SIGNING_KEY", raising=False)
    monkeypatch.setitem(CHARGE, "bench", {**BENCH, "laboratory": {"signing_key": str(journal.with_name("key"))}})
    made_safe(monkeypatch, SAFE, journal)
    assert [line["type"] for line in read_journal(journal).lines] == ["header", "watchdog", "signature"]
    journal.with_name("key").unlink()
    made_safe(monkeypatch, SAFE, journal)  # a line that is not signed says more than none
    assert read_journal(journal).lines[-1]["type"] == "watchdog"
    assert told


def test_nobody_is_told_where_the_bench_names_nobody(
    journal: Path, told: list[Any], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setitem(CHARGE, "bench", {**BENCH, "notify": None})
    made_safe(monkeypatch, SAFE, journal)
    assert told[-1] == ("vcfbench watchdog: it died; the bench was made safe", False)


def test_the_program_that_hangs_is_ended_and_no_other(monkeypatch: pytest.MonkeyPatch) -> None:
    ended: list[tuple[int, str, int]] = []

    def end(pid: int, mark: str, number: int) -> None:
        ended.append((pid, mark, number))
        raise PermissionError  # another user's

    monkeypatch.setattr(left_live, "end", end)
    left_live.end_owner({b"bench": json.dumps(CHARGE).encode()})
    assert ended == [(4711, "mark", KILL)]


FATES = {
    "not safe": LIVE,
    "stopped": Aborted("stopped by SIGTERM"),
    "in use": TAKEN,
    "silent": ConnectFailed("nobody answers"),
    "third signal": NotSafe("NOT SAFE: making safe was ended by a third signal"),
}


@pytest.mark.skipif(sys.platform == "win32", reason="no process is told to end there")
@pytest.mark.parametrize("name", ["SIGTERM", "SIGINT", "SIGHUP"])
@pytest.mark.parametrize("fate", FATES)
def test_signal_within_a_try_ends_the_trying(fate: str, name: str, monkeypatch: pytest.MonkeyPatch) -> None:
    tries: list[int] = []

    def tried(_charge: object, *, left: bool) -> MadeSafe:
        tries.append(left)
        assert len(tries) < 4, "it is tried for ever"
        with StopSignals() as signals:
            signals.unwind()
            if len(tries) == 2:
                signal.raise_signal(signal.Signals[name])
            found = FATES[fate]
            if isinstance(found, BaseException):
                raise found
            return found

    before = {each: signal.getsignal(each) for each in (signal.SIGINT, signal.SIGTERM, signal.SIGHUP)}
    monkeypatch.setattr("vcfbench.bench.abandoned.safe_abandoned", tried)
    monkeypatch.setattr(left_live, "_AGAIN_S", 0.01)
    monkeypatch.setattr(left_live, "_read_by_a_program", lambda: False)
    monkeypatch.setattr(left_live, "_say", lambda *_words, **_how: None)
    monkeypatch.setattr(left_live, "_notify", lambda *_words: None)
    try:
        assert left_live.try_again({b"bench": json.dumps(CHARGE).encode()}, "the program died") == 5
    finally:
        for number, handler in before.items():
            signal.signal(number, handler)
    assert len(tries) == 2
