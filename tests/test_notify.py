"""The program that a bench file names is told what a run came to, and whatever it does changes nothing."""

from __future__ import annotations

import json
import sys
from typing import TYPE_CHECKING

import pytest
from msgspec import structs

import vcfbench
from tests.cells import few
from vcfbench.cli import left_live
from vcfbench.clock import WallClock
from vcfbench.errors import Aborted, ConfigError, NotSafe
from vcfbench.procedures.bench_file import parse_bench
from vcfbench.runs.notified import notify, outcome_word
from vcfbench.station.description import Notify

if TYPE_CHECKING:
    from pathlib import Path

    from vcfbench import BenchDescription

QUICK = {"rates_deg_s": (10.0, 0.0, -10.0), "samples": 3, "sample_interval_s": 0.5, "settle_s": 0.5}


def bench(*command: str, timeout_s: float = 10.0) -> BenchDescription:
    return structs.replace(vcfbench.load_bench("ideal"), notify=Notify(command=command, timeout_s=timeout_s))


def keeps(path: Path) -> tuple[str, ...]:
    """Return the command that keeps what it is told, and says much that nobody wants."""
    code = "import pathlib, sys; print('noise'); pathlib.Path(sys.argv[1]).write_bytes(sys.stdin.buffer.read())"
    return sys.executable, "-c", code, str(path)


def test_the_end_of_a_run_is_told(tmp_path: Path, capfd: pytest.CaptureFixture[str]) -> None:
    told = tmp_path / "told.json"
    run = vcfbench.run("turntable", bench(*keeps(told)), settings=QUICK, runs=tmp_path, metadata={"dut": "G7"})
    said = json.loads(told.read_bytes())
    assert (said["outcome"], said["exit_code"], said["error"]) == ("complete", 0, None)
    assert (said["run"], said["directory"], said["dut"]) == (run.name, str(run.directory), "G7")
    assert "noise" not in capfd.readouterr().out
    assert "notify" not in run.header["bench"]


@pytest.mark.exhaustive
def test_a_failure_is_told_and_a_record_names_no_program(tmp_path: Path) -> None:
    told = tmp_path / "told.json"

    class Stops:
        def handle(self, event: vcfbench.Event) -> None:
            if isinstance(event, vcfbench.StepFinished) and event.number == 12:
                raise KeyboardInterrupt

    with pytest.raises(Aborted) as caught:
        vcfbench.run("turntable", bench(*keeps(told)), settings=QUICK, runs=tmp_path, observers=[Stops()])
    said = json.loads(told.read_bytes())
    assert (said["outcome"], said["exit_code"]) == ("stopped", 4)
    assert said["error"] == str(caught.value)
    told.unlink()
    journal = caught.value.run.directory / "journal.jsonl"
    forged = journal.read_bytes().replace(
        b'"bench":{', b'"bench":{"notify":{"command":["touch","%s"]},' % bytes(told), 1
    )
    other = tmp_path / "other"
    other.mkdir()
    (other / "journal.jsonl").write_bytes(b"".join(forged.splitlines(keepends=True)[:-2]))
    with pytest.raises(ConfigError, match="damaged"):  # the seal says that it was changed
        vcfbench.resume(other)
    assert vcfbench.resume(caught.value.run).status == "complete"
    assert not told.exists()


@pytest.mark.parametrize(
    ("command", "words"),
    few(
        [
            (("/no/such/program",), "/no/such/program could not be started: No such file or directory"),
            ((sys.executable, "-c", "raise SystemExit(3)"), "ended with code 3"),
            ((sys.executable, "-c", "import time; time.sleep(60)"), "took longer than 0.3 s and was ended"),
            (("nul\0",), "could not be started: embedded null byte"),
        ],
        (("/no/such/program",), "/no/such/program could not be started: No such file or directory"),
    ),
)
def test_its_failure_is_said_and_changes_nothing(command: tuple[str, ...], words: str, tmp_path: Path) -> None:
    clock = WallClock()
    with pytest.warns(UserWarning, match=f"the notification failed: .*{words}"):
        run = vcfbench.run("turntable", bench(*command, timeout_s=0.3), settings=QUICK, runs=tmp_path)
    assert run.status == "complete"
    assert clock.now() < 20.0


def test_what_the_watchdog_did_is_told(tmp_path: Path) -> None:
    """Of a program that was killed, with what the watchdog is told of the bench."""
    told = tmp_path / "told.json"
    journal = json.dumps(str(tmp_path / "it" / "journal.jsonl")).encode()
    charge = {"bench": {"name": "b", "notify": {"command": list(keeps(told)), "timeout_s": 10.0}}}
    left_live._notify(charge, {b"journal": journal}, "the program died; the bench was made safe", None)
    said = json.loads(told.read_bytes())
    assert (said["outcome"], said["run"], said["bench"]) == ("failed", "it", "b")
    assert notify(Notify(command=(sys.executable, "-c", "")), {"much": "x" * 200_000}) is None
    assert outcome_word(NotSafe("something")) == "NOT SAFE"


@pytest.mark.parametrize("text", ["command = []", 'command = "a b"', 'command = ["a"]\ntimeout_s = 1000'])
def test_what_is_no_command_is_refused(text: str) -> None:
    with pytest.raises(ConfigError, match=r"notify\."):
        parse_bench(f'name = "b"\n[site]\nlatitude_deg = 0\n[notify]\n{text}\n', "b.toml")


def test_a_path_is_found_from_the_bench_file(tmp_path: Path) -> None:
    (tmp_path / "b.toml").write_text(
        'name = "b"\n[site]\nlatitude_deg = 0\n[multimeter]\nmodel = "34401A"\nresource = "GPIB0::22::INSTR"\n'
        '[notify]\ncommand = ["bin/tell", "x"]\n',
        encoding="utf-8",
    )
    notice = vcfbench.load_bench(tmp_path / "b.toml").notify
    assert notice is not None
    assert notice.command == (str(tmp_path / "bin" / "tell"), "x")
