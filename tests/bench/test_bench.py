from __future__ import annotations

import signal
import subprocess
import sys
import textwrap
from pathlib import Path
from typing import TYPE_CHECKING

import pytest
from simrack_tests.cells import few

from tests.bench.fakes import FakeRack
from vcfbench.bench import bench as bench_module
from vcfbench.bench.bench import open_bench
from vcfbench.clock import sleep
from vcfbench.errors import Aborted, BenchError, ConfigError, InterlockError, LimitError, NotSafe
from vcfbench.procedures.bench_file import load_bench, parse_bench
from vcfbench.station.file import template

if TYPE_CHECKING:
    from collections.abc import Callable, Iterator

    from vcfbench.bench.bench import Bench
    from vcfbench.station.description import BenchDescription

SAFE_ORDER = [
    "rate_table safe",
    "rate_source safe",
    "power safe",
    "oscilloscope safe",
    "multimeter safe",
]
ROOT = Path(__file__).parents[2]


@pytest.fixture(autouse=True)
def _state(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("VCFBENCH_LOCKS", str(tmp_path))


@pytest.fixture
def real() -> BenchDescription:
    return parse_bench(template(), "template")


@pytest.fixture
def rack(monkeypatch: pytest.MonkeyPatch) -> Iterator[Callable[..., FakeRack]]:
    """Make a rack of fakes stand where the bench opens its instruments."""
    made: list[FakeRack] = []

    def make(**behaviours: str) -> FakeRack:
        fakes = FakeRack(**behaviours)
        monkeypatch.setattr(bench_module, "open_role", fakes.open_role)
        made.append(fakes)
        return fakes

    yield make
    for fakes in made:
        for instrument in fakes.instruments.values():
            instrument.released.set()


def safe_and_closed(fakes: FakeRack) -> None:
    done = [line for line in fakes.log if line.endswith("safe")]
    assert done == [line for line in SAFE_ORDER if line.split()[0] in fakes.instruments]
    assert {line for line in fakes.log if line.endswith("closed")} == {f"{role} closed" for role in fakes.instruments}


def test_leaving_makes_everything_safe_in_order(real: BenchDescription, rack: Callable[..., FakeRack]) -> None:
    fakes = rack()
    with open_bench(real) as bench:
        assert not bench.simulated
        assert bench.seed is None
        assert list(bench.identities) == ["power", "rate_source", "multimeter", "oscilloscope", "rate_table"]
    safe_and_closed(fakes)
    assert [report.safe for report in bench.safe_reports] == [True] * 5


def test_an_error_in_the_run_leaves_through_the_safety_stack(
    real: BenchDescription, rack: Callable[..., FakeRack]
) -> None:
    fakes = rack()
    with pytest.raises(ZeroDivisionError), open_bench(real):
        raise ZeroDivisionError
    safe_and_closed(fakes)


def test_unopened_instruments_are_named_and_the_rest_made_safe(
    real: BenchDescription, rack: Callable[..., FakeRack]
) -> None:
    fakes = rack(rate_source="missing", oscilloscope="missing")
    with pytest.raises(BenchError, match="2 instruments did not open: ") as caught, open_bench(real):
        pytest.fail("the bench opened")
    assert str(caught.value).endswith(", step opening the bench")
    assert "rate_source at USB0::0x0957::0x0407::MY00000000::INSTR: nobody answers" in str(caught.value)
    assert "oscilloscope at USB0::0x0957::0x175D::MY00000000::INSTR: nobody answers" in str(caught.value)
    assert caught.value.exit_code == 3
    safe_and_closed(fakes)


def test_a_table_that_turns_is_refused_and_stopped(real: BenchDescription, rack: Callable[..., FakeRack]) -> None:
    fakes = rack(rate_table="turns")
    with pytest.raises(InterlockError, match=r"it turns at 12\.5 deg/s before") as caught, open_bench(real):
        pytest.fail("the bench opened")
    assert caught.value.exit_code == 3
    safe_and_closed(fakes)


def test_a_table_that_cannot_be_stopped_is_not_safe(real: BenchDescription, rack: Callable[..., FakeRack]) -> None:
    fakes = rack(rate_table="spins")
    with pytest.raises(NotSafe, match=r"it turns at 12\.5 deg/s") as caught, open_bench(real):
        pytest.fail("the bench opened")
    assert isinstance(caught.value.__cause__, InterlockError)
    assert "before that: rate_table at FAKE::rate_table: it turns" in str(caught.value)
    safe_and_closed(fakes)


@pytest.mark.parametrize("behaviour", ["fails", "refuses", "lies"])
def test_what_is_not_safe_is_named_with_what_went_before(
    real: BenchDescription, rack: Callable[..., FakeRack], behaviour: str
) -> None:
    fakes = rack(power=behaviour)
    first = BenchError("the reading is nonsense")
    with pytest.raises(NotSafe, match="NOT SAFE: power at FAKE::power: ") as caught, open_bench(real):
        raise first
    assert caught.value.exit_code == 5
    assert caught.value.__cause__ is first
    assert "before that: the reading is nonsense" in str(caught.value)
    safe_and_closed(fakes)


def test_limits_hold_on_the_open_bench(real: BenchDescription, rack: Callable[..., FakeRack]) -> None:
    rack()
    with open_bench(real) as bench:
        with pytest.raises(LimitError):
            bench.rate_table.set_rate(301.0, 100.0)
        with pytest.raises(LimitError):
            bench.rate_source.set_dc(10.1)
        with pytest.raises(LimitError):
            bench.power.configure_output("P25V", 24.0, 0.1)


def test_a_real_bench_has_one_owner_and_no_speed(real: BenchDescription, rack: Callable[..., FakeRack]) -> None:
    rack()
    with open_bench(real), pytest.raises(BenchError, match=r"in use by process \d+ of .* for station lab-1 since"):
        open_bench(real)
    for speed in (2.0, "max"):
        with pytest.raises(ConfigError, match="only such a bench has a speed"):
            open_bench(real, speed=speed).__enter__()


@pytest.mark.parametrize("speed", ["fast", 0, -1, 1e-9, "nan", "inf"])
def test_a_speed_is_a_number_not_absurdly_small(speed: str | float) -> None:
    with pytest.raises(ConfigError, match=r"expected a number of at least 0\.001, or 'max'"):
        open_bench(load_bench(None), speed=speed).__enter__()


def test_the_handlers_are_given_back(real: BenchDescription, rack: Callable[..., FakeRack]) -> None:
    rack()
    before = signal.getsignal(signal.SIGINT), signal.getsignal(signal.SIGTERM)
    with open_bench(real):
        assert signal.getsignal(signal.SIGINT) != before[0]
    assert (signal.getsignal(signal.SIGINT), signal.getsignal(signal.SIGTERM)) == before


def interrupted(bench: Bench, log: list[str], signals: int) -> None:
    """A run that gets its own signals in the middle of an exchange and then waits."""
    for _ in range(signals):
        signal.raise_signal(signal.SIGTERM)
    log.append("the exchange goes on")
    sleep(bench.clock, 0.0)
    log.append("the wait went on")


def test_a_signal_stops_the_run_at_its_next_wait(real: BenchDescription, rack: Callable[..., FakeRack]) -> None:
    fakes = rack()
    with pytest.raises(Aborted, match="stopped by SIGTERM") as caught, open_bench(real) as bench:
        interrupted(bench, fakes.log, 1)
    assert "the exchange goes on" in fakes.log
    assert "the wait went on" not in fakes.log
    assert caught.value.exit_code == 4
    safe_and_closed(fakes)


def test_a_second_signal_stops_the_run_at_once(real: BenchDescription, rack: Callable[..., FakeRack]) -> None:
    fakes = rack()
    with pytest.raises(Aborted), open_bench(real) as bench:
        interrupted(bench, fakes.log, 2)
    assert "the exchange goes on" not in fakes.log
    safe_and_closed(fakes)


# --- signals from outside, in a process of its own ---

CHILD = """
import signal, sys
from tests.bench.fakes import FakeInstrument, FakeRack
from vcfbench.bench import bench as module
from vcfbench.procedures.bench_file import parse_bench
from vcfbench.station.file import template
from vcfbench.clock import WallClock, sleep
from vcfbench.errors import BenchError
import vcfbench.safety.stack as safety

rack = FakeRack(power=sys.argv[1])
module.open_role = rack.open_role
stopping = FakeInstrument.make_safe
def make_safe(self, deadline):
    print(self.name, flush=True)
    return stopping(self, deadline)
FakeInstrument.make_safe = make_safe
try:
    with module.open_bench(parse_bench(template(), "t")) as bench:
        print("open", flush=True)
        sleep(bench.clock, 30.0)
except BenchError as error:
    print(type(error).__name__, error, flush=True)
    sys.exit(error.exit_code)
"""

posix = pytest.mark.skipif(sys.platform == "win32", reason="signals are sent to another process")


@pytest.fixture
def child() -> Iterator[Callable[[str], subprocess.Popen[str]]]:
    """Start a process whose bench is open and whose supply behaves as told."""
    started: list[subprocess.Popen[str]] = []

    def start(behaviour: str) -> subprocess.Popen[str]:
        command = [sys.executable, "-c", textwrap.dedent(CHILD), behaviour]
        process = subprocess.Popen(command, stdout=subprocess.PIPE, text=True, cwd=ROOT)  # noqa: S603
        started.append(process)
        assert line_of(process) == "open"
        return process

    yield start
    for process in started:
        process.kill()
        process.communicate()


def line_of(process: subprocess.Popen[str]) -> str:
    assert process.stdout is not None
    return process.stdout.readline().strip()


@posix
@pytest.mark.parametrize("number", few(["SIGINT", "SIGTERM", "SIGHUP"], "SIGTERM"))
def test_signal_ends_wait_and_leaves_bench_safe(child: Callable[[str], subprocess.Popen[str]], number: str) -> None:
    process = child("obeys")
    process.send_signal(signal.Signals[number])
    output, _ = process.communicate(timeout=10)
    assert process.returncode == 4
    assert output.splitlines()[:3] == ["rate_table", "rate_source", "power"]
    assert output.splitlines()[-1] == f"Aborted stopped by {number}"


@posix
def test_signals_while_switching_off_only_count(
    child: Callable[[str], subprocess.Popen[str]],
) -> None:
    process = child("hangs")
    process.send_signal(signal.SIGINT)
    assert [line_of(process) for _ in range(3)] == ["rate_table", "rate_source", "power"]
    process.send_signal(signal.SIGTERM)
    with pytest.raises(subprocess.TimeoutExpired):
        process.wait(timeout=0.3)
    process.send_signal(signal.SIGINT)
    output, _ = process.communicate(timeout=10)
    assert process.returncode == 5
    unsafe = "power at FAKE::power: told to switch off, not proved; last read back: on 3 s ago"
    assert output.startswith(f"NotSafe NOT SAFE: {unsafe}; a third signal ended the making safe")
