"""A bench whose program died or hangs is made safe by the watchdog, without a person."""

from __future__ import annotations

import io
import json
import os
import shutil
import signal as signals
import subprocess
import sys
import threading
from pathlib import Path
from types import SimpleNamespace
from typing import TYPE_CHECKING, Any, cast

import pytest
from msgspec import structs
from simrack_tests.cells import few
from simrack_tests.ports import PLENTY_S, eventually

import vcfbench
from tests.bench.test_holding import what_is_on
from tests.cli.test_safe import UNWATCHED, bench_file, left_live
from vcfbench.cli.watchdog import SILENT_TURNS, TURN_S
from vcfbench.clock import WallClock, sleep
from vcfbench.drivers.calls import Calls
from vcfbench.errors import BenchError, ConnectFailed, InterlockError
from vcfbench.records.journal import append_line, read_journal
from vcfbench.safety.processes import mark_of
from vcfbench.safety.watchdog import SILENT_S, Watchdog
from vcfbench.station.description import Safety
from vcfbench.station.writing import bench_text
from vcfbench.testing.benches import serve_simulated

if TYPE_CHECKING:
    from collections.abc import Callable, Iterator

    from vcfbench.testing.benches import ServedLab

pytestmark = pytest.mark.skipif(sys.platform == "win32", reason="the system has no SIGKILL")
GENEROUS_S = 30.0


def safe_after_s(lab: ServedLab) -> float:
    clock = WallClock()
    while what_is_on(lab) and clock.now() < GENEROUS_S:
        sleep(clock, 0.1)
    return clock.now()


@pytest.mark.parametrize("signal", few(["SIGKILL", "SIGSTOP"], "SIGKILL"))
def test_a_bench_whose_program_died_or_hangs_is_made_safe(signal: str, tmp_path: Path) -> None:
    with serve_simulated() as lab:
        path = bench_file(lab, tmp_path)
        with left_live(path, f"os.kill(os.getpid(), signal.{signal})") as process:
            assert safe_after_s(lab) < GENEROUS_S
            assert process.wait(GENEROUS_S) == -9  # one that hangs is ended: it might switch things on again


WITHOUT = """
import os, signal, sys
from pathlib import Path
from vcfbench.drivers.calls import Calls
from vcfbench.safety.watchdog import SILENT_S, Watchdog
from vcfbench import load_bench

without = sys.argv[1]
sys.path.insert(0, without)
dog = Watchdog(load_bench("paper"), print, Calls(), print)
dog.require_ready()
"""
"""A program whose watchdog finds of the package no more than what it has loaded."""


@pytest.mark.exhaustive
@pytest.mark.parametrize(
    ("end", "why"),
    [
        ("os.kill(os.getpid(), signal.SIGKILL)", "the program died"),
        ("os.kill(os.getpid(), signal.SIGSTOP)", "the program did not respond for 2 s and was ended"),
    ],
)
def test_moved_package_is_reported_and_a_hanging_program_ended(end: str, why: str, tmp_path: Path) -> None:
    (tmp_path / "vcfbench" / "cli").mkdir(parents=True)
    for part in ("__init__.py", "cli/__init__.py", "cli/last_words.py", "cli/watchdog.py"):
        shutil.copy(Path(str(vcfbench.__file__)).parent / part, tmp_path / "vcfbench" / part)
    command = [sys.executable, "-c", WITHOUT + end, str(tmp_path)]
    done = subprocess.run(command, capture_output=True, text=True, check=False, timeout=GENEROUS_S)  # noqa: S603
    assert done.returncode == -9
    assert done.stderr == (
        f"vcfbench watchdog: {why}; NOT SAFE: rate_table at sim://paper, rate_source at "
        "USB0::0x0957::0x0407::MY44021876::INSTR, power at GPIB0::5::INSTR: ModuleNotFoundError: No module named "
        "'vcfbench.cli.left_live'; make it safe by hand before anything else\n"
    )


@pytest.mark.exhaustive
def test_a_bench_whose_instruments_take_long_to_open_is_opened(tmp_path: Path) -> None:
    """A program that waits for an instrument lives."""
    with serve_simulated() as lab:
        bench = lab.on_wires()
        assert bench.multimeter is not None
        lab.fault("multimeter", "silent")
        path = tmp_path / "slow.toml"
        slow = structs.replace(bench, multimeter=structs.replace(bench.multimeter, timeout_s=SILENT_TURNS * TURN_S + 1))
        path.write_text(bench_text(slow), encoding="utf-8")
        command = [sys.executable, "-m", "vcfbench", "run", "turntable", "--bench", str(path), "--quiet"]
        done = subprocess.run(command, capture_output=True, text=True, check=False, cwd=tmp_path)  # noqa: S603
    assert "multimeter" in done.stderr
    assert done.returncode == ConnectFailed.exit_code


def test_a_call_that_never_returns_is_ended(tmp_path: Path) -> None:
    end = """
import ctypes
from vcfbench.drivers.visa_wire import SocketWire
def never(wire, deadline):
    while True:
        ctypes.CDLL(None).pause()
SocketWire.receive = never
bench.power.outputs_enabled()
"""
    with serve_simulated() as lab, left_live(bench_file(lab, tmp_path, "power"), end) as process:
        assert process.wait(GENEROUS_S) == -9
        assert safe_after_s(lab) < GENEROUS_S


def test_the_death_of_the_watchdog_stops_a_run(tmp_path: Path) -> None:
    with serve_simulated() as lab:
        wait = "    sleep(vcfbench.clock.WallClock(), 2.0)\n    sleep(bench.clock, 1.0)\n"
        end = f"import vcfbench.clock\nwith bench:\n    {UNWATCHED.splitlines()[0]}\n{wait}"
        with left_live(bench_file(lab, tmp_path), end) as process:
            assert process.wait(GENEROUS_S) != 0
        assert what_is_on(lab) == []


@pytest.mark.exhaustive
@pytest.mark.filterwarnings("ignore:process .* died with this bench")  # ports are given again
def test_run_without_watchdog_goes_on_if_the_bench_allows(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    def die_soon(watchdog: Watchdog) -> None:
        ready(watchdog)
        watchdog._process.kill()
        clock = WallClock()
        while not watchdog.lost and clock.now() < GENEROUS_S:  # a short run may end before the next beat
            sleep(clock, 0.05)

    ready = Watchdog.require_ready
    monkeypatch.setattr(Watchdog, "require_ready", die_soon)
    settings = {"rates_deg_s": (10.0, 0.0, -10.0), "samples": 2}
    with serve_simulated() as lab:
        bench = structs.replace(lab.on_wires(), safety=Safety(watchdog_lost="go on"))
        run = vcfbench.run("turntable", bench, settings=settings, runs=tmp_path)
    assert run.status == "complete"
    assert "the death of the watchdog of bench paper; it goes on as its bench file says" in capsys.readouterr().err
    assert run.directory is not None
    footer = read_journal(run.directory / "journal.jsonl").footer
    assert footer is not None
    assert footer["watchdog_lost"] is True


def test_who_died_with_a_table_that_turns_is_named(tmp_path: Path) -> None:
    with serve_simulated() as lab:
        path = bench_file(lab, tmp_path)
        with left_live(path, UNWATCHED + "os.kill(os.getpid(), signal.SIGKILL)") as process:
            pass
        with pytest.raises(InterlockError, match=f"turns .* process {process.pid} of .* died with this bench"):
            vcfbench.open_bench(path)
        assert what_is_on(lab) == []


def test_a_watchdog_that_acts_does_not_wait_for_numpy() -> None:
    act = """
import site, sys
from vcfbench.cli.watchdog import loaded
site.main = lambda: print("what an editable installation needs")
sys.modules["vcfbench.drivers.visa_wire"] = None
loaded()  # without PyVISA: whoever needs it will say so
del sys.modules["vcfbench.drivers.visa_wire"], sys.modules["vcfbench.cli.left_live"]
loaded()
loaded()
print({"pyvisa", "numpy"} & {*sys.modules})
import numpy  # the driver of another package may want it
"""
    done = subprocess.run([sys.executable, "-c", act], capture_output=True, text=True, check=True)  # noqa: S603
    assert done.stdout == "what an editable installation needs\n" * 2 + "{'pyvisa'}\n"


def test_a_bench_that_is_not_safe_is_left_without_waiting(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    """`Thread.start` waits for ever for a thread that has no memory to begin with."""
    with serve_simulated() as lab:
        watchdog = Watchdog(
            vcfbench.load_bench(bench_file(lab, tmp_path)), lambda _why: None, Calls(), lambda _why: None
        )
        watchdog.require_ready()
        monkeypatch.setattr(threading.Thread, "start", lambda _: pytest.fail("a program without memory hangs here"))
        watchdog.leave(safe=False)


def test_a_torn_line_makes_room_for_the_watchdog_s(tmp_path: Path) -> None:
    journal = tmp_path / "journal.jsonl"
    journal.write_bytes(b'{"type":"header"}\n{"type":"st')
    append_line(journal, {"type": "watchdog", "safe": True})
    first, second = journal.read_bytes().splitlines()
    assert first == b'{"type":"header"}'
    assert second.startswith(b'{"type":"watchdog","safe":true,"utc":"')


# What the program tells its watchdog


class Process:
    """A watchdog process that only listens."""

    def __init__(self, command: list[str], **options: Any) -> None:
        self.command = command
        self.options = options
        self.blocked = set(signals.pthread_sigmask(signals.SIG_BLOCK, ()))
        self.stdin = Path("said").open("wb")  # noqa: SIM115
        self.stdout: Any = io.BytesIO(b"ready\n")
        self.waits: list[float | None] = []
        self.killed = False
        self.stays = False

    def kill(self) -> None:
        self.killed = True

    def wait(self, timeout: float | None = None) -> int:
        self.waits.append(timeout)
        if self.stays and not self.killed:
            raise subprocess.TimeoutExpired("watchdog", timeout or 0.0)
        return 0


class OverdueCalls(Calls):
    """Calls, of which one is overdue at each beat that is marked so."""

    def __init__(self, at_beats: str) -> None:
        super().__init__()
        self.script = list(at_beats)

    def overdue(self) -> str | None:
        return "power: sending" if self.script and self.script.pop(0) == "!" else None


def said(kinds: tuple[str, ...] = ()) -> list[str]:
    lines = Path("said").read_text("utf-8").splitlines()
    return [line for line in lines if not kinds or line.startswith(kinds)]


@pytest.fixture
def listener(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Iterator[Callable[..., tuple[Watchdog, Process]]]:
    """Start watchdogs whose processes only listen, with a beat in so many seconds."""
    monkeypatch.chdir(tmp_path)
    monkeypatch.setattr("subprocess.Popen", Process)
    made: list[tuple[Watchdog, Process]] = []

    def start(
        beat_s: float = PLENTY_S, calls: Calls | None = None, lost: list[str] | None = None, silent_s: float = SILENT_S
    ) -> Any:
        monkeypatch.setattr("vcfbench.safety.watchdog.BEAT_S", beat_s)
        on_loss = [] if lost is None else lost
        dog = Watchdog(vcfbench.load_bench("paper"), on_loss.append, calls or Calls(), on_loss.append, silent_s)
        made.append((dog, cast("Process", dog._process)))
        return made[-1]

    yield start
    for dog, process in made:
        dog._over.set()
        process.stdin.close()
        dog._alone.close()  # else the next file with this number would be kept from forks


def test_watchdog_gets_bench_journal_steps_and_end(listener: Callable[..., tuple[Watchdog, Process]]) -> None:
    dog, process = listener()
    assert [each.daemon for each in threading.enumerate() if each.name == "watchdog beat"][-1:] == [True]  # Python ends
    dog.require_ready()
    dog.keep_in(Path("runs/journal.jsonl"))
    dog.step("ramp", 2.5)
    dog.step("wait", None)
    dog.making_safe(9.0)
    owner, bench, *others = said()
    assert owner.startswith(f'owner {os.getpid()} "rate_table at sim://paper, rate_source at ')
    kind, _, words = bench.partition(" ")
    charge = json.loads(words)
    assert (kind, charge["owner"], charge["mark"]) == ("bench", os.getpid(), mark_of(os.getpid()))
    assert charge["bench"]["name"] == "paper"
    journal = json.dumps(str(Path("runs/journal.jsonl").absolute()))
    assert others == [f"journal {journal}", 'step 2.5 "ramp"', 'step inf "wait"', 'step 9.0 "making safe"']
    dog.leave(safe=True)
    assert said()[-1] == "left safe"
    assert process.stdin.closed
    assert process.stdout.closed
    assert (process.waits, process.killed) == ([2.0], False)
    dog.step("too late", None)  # nobody hears it, and nothing is raised


def test_only_an_owner_of_a_bench_is_not_killed(
    listener: Callable[..., tuple[Watchdog, Process]],
) -> None:
    for safe in (True, False):
        dog, process = listener()
        process.stays = safe
        dog.leave(safe=safe)
        eventually(lambda: process.waits == ([2.0, None] if safe else [None]))  # noqa: B023
        assert process.killed is safe
    assert said()[-1] == "left live"


@pytest.mark.parametrize("error", [RuntimeError, MemoryError])
def test_unsafe_bench_is_left_if_no_thread_starts(
    error: type[Exception], listener: Callable[..., tuple[Watchdog, Process]], monkeypatch: pytest.MonkeyPatch
) -> None:
    def refuse(_target: Callable[[], object]) -> None:
        raise error

    dog, process = listener()
    monkeypatch.setattr("vcfbench.safety.watchdog.start_thread", refuse)
    dog.leave(safe=False)
    assert said()[-1] == "left live"
    assert (process.waits, process.killed) == ([], False)


def test_a_call_that_does_not_return_is_late_then_overdue(listener: Callable[..., tuple[Watchdog, Process]]) -> None:
    listener(0.001, OverdueCalls(".!!.!!!!!!!!!"))
    eventually(lambda: len(said(("beat", "late", "overdue"))) > 13)
    call = "power: sending"
    *words, after = said(("beat", "late", "overdue"))[:14]
    assert (
        words
        == ["beat ", *[f"beat {call}"] * 2, "beat ", *[f"beat {call}"] * 3]
        + [f"late {call}"] * 4
        + [f"overdue {call}"] * 2
    )
    assert after == "beat "


def test_call_that_never_returned_is_overdue(
    listener: Callable[..., tuple[Watchdog, Process]],
) -> None:
    listener(0.001, OverdueCalls("!!!!!!!!"))
    eventually(lambda: len(said(("beat", "late", "overdue"))) > 8)
    kinds = [line.partition(" ")[0] for line in said(("beat", "late", "overdue"))]
    assert kinds[:9] == [*["beat"] * 3, *["late"] * 4, "overdue", "beat"]


def test_no_call_is_overdue_while_the_bench_is_made_safe(listener: Callable[..., tuple[Watchdog, Process]]) -> None:
    dog, _ = listener(0.01, OverdueCalls("!" * 100_000))
    dog.making_safe(9.0)
    eventually(lambda: said()[-1] == "beat ")


def test_watchdog_death_is_reported_once_unless_released(
    listener: Callable[..., tuple[Watchdog, Process]],
) -> None:
    lost: list[str] = []
    dog, process = listener(0.01, lost=lost)
    process.stdin.close()
    eventually(lambda: lost)
    assert (dog.lost, lost) == (True, ["the death of the watchdog"])
    left, process = listener(0.01, lost=lost)
    left.leave(safe=True)
    with pytest.raises(ValueError, match="closed"):
        left._put("beat")
    sleep(WallClock(), 0.03)
    assert (left.lost, lost) == (False, ["the death of the watchdog"])


def test_watchdog_released_during_a_message_has_not_died(
    listener: Callable[..., tuple[Watchdog, Process]], monkeypatch: pytest.MonkeyPatch
) -> None:
    lost: list[str] = []
    told = threading.Event()

    def let_go(dog: Watchdog, _line: str) -> None:
        dog._over.set()
        told.set()
        raise ValueError("closed")

    dog, _ = listener(0.01, lost=lost)
    monkeypatch.setattr(Watchdog, "_put", let_go)
    assert told.wait(PLENTY_S)
    sleep(WallClock(), 0.03)
    assert (dog.lost, lost) == (False, [])


@pytest.mark.parametrize("answer", ["none", "wrong", "died"])
def test_one_that_does_not_get_ready_is_an_error(
    answer: str, listener: Callable[..., tuple[Watchdog, Process]], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("vcfbench.safety.watchdog._STARTING_S", 0.05)
    dog, process = listener()
    over, waits = threading.Event(), list[bool]()

    def never_ready() -> bytes:
        waits.append(threading.current_thread().daemon)
        over.wait(PLENTY_S)
        return b""  # as at the end of a pipe: else its reader would go round and round to the end of the run

    never = SimpleNamespace(readline=never_ready, close=lambda: None)
    process.stdout = {"none": never, "wrong": io.BytesIO(b"Traceback\n"), "died": io.BytesIO()}[answer]
    with pytest.raises(BenchError, match="the watchdog did not start"):
        dog.require_ready()
    over.set()
    assert process.killed
    assert all(waits)  # else Python could not end


def test_neither_signals_nor_forks_of_the_program_reach_it(listener: Callable[..., tuple[Watchdog, Process]]) -> None:
    _, process = listener()
    assert {signals.SIGINT, signals.SIGTERM, signals.SIGHUP} <= process.blocked
    assert not signals.pthread_sigmask(signals.SIG_BLOCK, ()) & {signals.SIGINT, signals.SIGTERM, signals.SIGHUP}
    assert process.options["start_new_session"] is True
    if (child := os.fork()) == 0:
        os.write(process.stdin.fileno(), b"left safe\n")
        os._exit(0)
    os.waitpid(child, 0)
    assert "left safe" not in said()


@pytest.mark.exhaustive
def test_later_file_with_pipe_number_is_inherited_by_forks(
    listener: Callable[..., tuple[Watchdog, Process]], tmp_path: Path
) -> None:
    dog, process = listener()
    number = process.stdin.fileno()
    dog.leave(safe=True)
    with (tmp_path / "other").open("wb") as other:
        os.dup2(other.fileno(), number)
        if (child := os.fork()) == 0:
            os.write(number, b"from the fork")
            os._exit(0)
        os.waitpid(child, 0)
        if number != other.fileno():
            os.close(number)
    assert (tmp_path / "other").read_bytes() == b"from the fork"
