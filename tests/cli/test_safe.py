"""``vcfbench safe``: a bench that was left live is brought to rest, switched off, and both are proved."""

from __future__ import annotations

import json
import os
import re
import signal
import subprocess
import sys
from contextlib import contextmanager
from pathlib import Path
from typing import TYPE_CHECKING, Any

import pytest
from msgspec import structs
from simrack_tests.cells import few
from simrack_tests.ports import PLENTY_S
from typer.testing import CliRunner

from tests import warm
from tests.bench.test_holding import SCRIPT, what_is_on
from vcfbench.bench import make_safe as safing
from vcfbench.bench.make_safe import safe_bench
from vcfbench.cli.main import app
from vcfbench.procedures.bench_file import load_bench
from vcfbench.station.writing import bench_text
from vcfbench.testing.benches import serve_simulated

if TYPE_CHECKING:
    from collections.abc import Iterator

    from vcfbench.testing.benches import ServedLab

UNWATCHED = "bench.watchdog._process.kill()\nbench.watchdog._process.wait()\n"
"""The watchdog is killed first: else it makes the bench safe."""


@pytest.fixture
def lab() -> Iterator[ServedLab]:
    with serve_simulated() as served:
        yield served


def bench_file(lab: ServedLab, folder: Path, deaf: str | None = None) -> Path:
    """Write the bench file; who is deaf is not waited for long."""
    bench = lab.on_wires()
    quick = {} if deaf is None else {deaf: structs.replace(getattr(bench, deaf), timeout_s=0.5)}
    path = folder / "served.toml"
    path.write_text(bench_text(structs.replace(bench, **quick)), encoding="utf-8")
    return path


@contextmanager
def left_live(path: Path, end: str) -> Iterator[Any]:
    """Start a program that turns the table, switches everything on, and then does `end`; wait for its end."""
    (path.parent / "live.py").write_text(SCRIPT + end, encoding="utf-8")
    for _ in range(20):
        with warm.running(["python", "live.py", str(path)], path.parent, errors=True) as process:
            if (said := process.stdout.readline()) == "<Bench paper, open> 50\n":
                yield process
                process.wait(PLENTY_S)
                return
            said += process.communicate()[1]
        assert "leads the clock" in said  # the watchdog of the program before does, until the bench is safe
    raise AssertionError(said)


def call(path: Path, *options: str) -> tuple[int, str, str]:
    while True:
        done = CliRunner().invoke(app, ["safe", "--bench", str(path), *options])
        if "leads the clock" not in done.stderr:  # the server has not yet seen that the one before has gone
            return done.exit_code, done.stdout, done.stderr


def test_unnamed_bench_is_not_reported_safe(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.delenv("VCFBENCH_BENCH", raising=False)
    done = CliRunner().invoke(app, ["safe"])
    assert (done.exit_code, done.stdout) == (2, "")
    assert "vcfbench safe --bench FILE" in done.stderr
    monkeypatch.setenv("VCFBENCH_BENCH", "paper")
    assert CliRunner().invoke(app, ["safe"]).exit_code == 0


@pytest.mark.skipif(sys.platform == "win32", reason="the system has no SIGKILL")
@pytest.mark.parametrize("deaf", few([None, "power"], "power"))
def test_a_bench_whose_program_was_killed_is_made_safe(lab: ServedLab, tmp_path: Path, deaf: str | None) -> None:
    path = bench_file(lab, tmp_path)
    with left_live(path, UNWATCHED + "os.kill(os.getpid(), signal.SIGKILL)"):
        pass
    assert len(what_is_on(lab)) == 4
    if deaf is not None:
        path = bench_file(lab, tmp_path, deaf)
        lab.fault(deaf, "silent")
    code, out, err = call(path, "--json", *([] if deaf is None else ["--once"]))
    answer: dict[str, Any] = json.loads(out)
    instruments = answer["instruments"]
    assert what_is_on(lab) == []
    assert list(instruments) == ["rate_table", "rate_source", "power"]
    assert instruments["rate_table"]["found"].startswith("turning at ")
    assert instruments["rate_source"]["found"] == "on, level 0.5 V"
    assert {role for role, each in instruments.items() if not each["safe"]} == ({deaf} if deaf else set())
    assert (code, answer["safe"]) == ((0, True) if deaf is None else (5, False))
    if deaf is None:
        assert re.fullmatch(r"on, P6V \S+ V, P25V (10|9\.99) V, N25V -(10|9\.99) V", instruments["power"]["found"])
        assert err == ""
    else:
        assert instruments["power"]["found"] is None
        assert instruments["power"]["detail"].startswith("told to switch off, not proved; ")
        assert "NOT SAFE: power at " in err


@pytest.mark.skipif(sys.platform == "win32", reason="the system has no pause")
def test_bench_of_another_process_is_left_unless_forced(lab: ServedLab, tmp_path: Path) -> None:
    path = bench_file(lab, tmp_path)
    with left_live(path, "signal.pause()") as process:
        code, _, err = call(path)
        assert code == 3
        assert f"in use by process {process.pid} of " in err
        assert "end it with --end-owner, it makes its bench safe; or --force" in err
        assert len(what_is_on(lab)) == 4
        code, out, err = call(path, "--force")
        assert (code, err) == (0, "")
        assert what_is_on(lab) == []
        assert [line.split()[0] for line in out.splitlines()[-3:]] == ["rate_table", "rate_source", "power"]
        process.kill()


@pytest.mark.skipif(sys.platform == "win32", reason="the system has no SIGKILL")
@pytest.mark.parametrize("hangs", [True, pytest.param(False, marks=pytest.mark.exhaustive)])
def test_the_process_that_has_the_bench_is_ended_on_request(
    lab: ServedLab, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, *, hangs: bool
) -> None:
    path = bench_file(lab, tmp_path)
    monkeypatch.setattr("vcfbench.bench.make_safe._STOPPING_S", 0.3 if hangs else PLENTY_S)
    end = UNWATCHED + "signal.signal(signal.SIGTERM, signal.SIG_IGN)\n" if hangs else ""
    with left_live(path, end + "print('ready', flush=True)\nsignal.pause()") as process:
        assert process.stdout.readline() == "ready\n"  # a signal before would end also one that is to hang
        code, out, err = call(path, "--end-owner", "--json")
        assert process.wait(PLENTY_S) == (-9 if hangs else 4)
    assert code == 0, err
    assert f"vcfbench: process {process.pid} of " in err
    assert err.endswith(" was ended\n")
    found = json.loads(out)["instruments"]["rate_table"]["found"]
    assert hangs or found == "at rest"  # of one that was killed its watchdog may have come first
    assert what_is_on(lab) == []


def test_free_instruments_are_made_safe_and_locked_ones_left(lab: ServedLab, tmp_path: Path) -> None:
    path = bench_file(lab, tmp_path)
    power = load_bench(path).power
    assert power is not None  # it is a bench with a supply
    hold = (
        "import sys\nfrom vcfbench.safety.lock import instrument_locks\n"
        f"with instrument_locks('other', {{'power': '{power.resource}'}}):\n    print(flush=True)\n    sys.stdin.read()"
    )
    with subprocess.Popen([sys.executable, "-c", hold], stdin=subprocess.PIPE, stdout=subprocess.PIPE) as holder:  # noqa: S603
        assert holder.stdout is not None
        holder.stdout.readline()
        code, out, err = call(path, "--json")
        holder.kill()
    answer = json.loads(out)
    assert (code, answer["safe"]) == (3, False)
    assert list(answer["instruments"]) == ["rate_table", "rate_source"]
    assert list(answer["left_to"]) == ["power"]
    assert f"in use by process {holder.pid} of " in err


def test_unusable_locks_do_not_prevent_making_safe(
    lab: ServedLab, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    path = bench_file(lab, tmp_path)
    monkeypatch.setenv("VCFBENCH_LOCKS", str(path))  # no directory
    code, out, err = call(path)
    assert code == 0
    assert "the instruments are not locked, another process may have them: lock file " in err
    assert [line.split()[0] for line in out.splitlines()[-3:]] == ["rate_table", "rate_source", "power"]


def test_a_bench_at_rest_is_found_at_rest() -> None:
    done = safe_bench(load_bench(None))
    assert [(each.role, each.found) for each in done.instruments] == [
        ("rate_table", "at rest"),
        ("rate_source", "off"),
        ("power", "off"),
    ]
    assert done.failure() is None


def test_missing_instrument_does_not_prevent_proof_of_others(lab: ServedLab) -> None:
    bench = lab.on_wires()
    gone = structs.replace(bench.rate_source, resource="TCPIP::127.0.0.1::1::SOCKET", timeout_s=0.3)
    done = safe_bench(structs.replace(bench, rate_source=gone))
    assert [each.safe for each in done.instruments] == [True, False, True]
    untold = "could not be told to switch off; its state was never read back; "
    assert f"rate_source at TCPIP::127.0.0.1::1::SOCKET: {untold}no instrument answers there" in str(done.failure())
    assert done.instruments[1].detail.startswith(untold)


@pytest.mark.skipif(sys.platform == "win32", reason="a signal to oneself")
def test_two_signals_do_not_break_it_off(lab: ServedLab, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """There is nothing to be stopped half-way: interrupts are only counted."""
    made_safe = safing._made_safe

    def interrupted(*arguments: Any) -> safing.MadeSafe:
        for _ in range(2):
            os.kill(os.getpid(), signal.SIGINT)
        return made_safe(*arguments)

    monkeypatch.setattr(safing, "_made_safe", interrupted)
    made = safe_bench(bench_file(lab, tmp_path))
    assert made.failure() is None
    assert {report.instrument for report in made.reports} >= {"rate_table", "rate_source", "power"}
