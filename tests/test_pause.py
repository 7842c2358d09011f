"""A run that pauses between two steps: the bench rests warm, goes on as it was, and counts from a new reference."""

from __future__ import annotations

import json
import os
import select
import signal
import subprocess
import sys
from contextlib import suppress
from http.client import HTTPConnection
from typing import TYPE_CHECKING, Any
from urllib.parse import urlsplit

import pytest
from simrack_tests.cells import few
from simrack_tests.ports import PLENTY_S, eventually

import vcfbench
from tests import warm
from tests.procedures import test_bandwidth, test_resonance
from tests.test_resume import cut
from vcfbench.clock import WallClock, sleep
from vcfbench.drivers.hp34401a import Hp34401A
from vcfbench.errors import Aborted, MeasurementError, PlanError

if TYPE_CHECKING:
    from collections.abc import Callable
    from pathlib import Path

    from vcfbench import Event, Run

QUICK = {"rates_deg_s": (10.0, 0.0, -10.0), "samples": 3, "sample_interval_s": 0.5, "settle_s": 0.5}
SHOWN: dict[str, Any] = {"seed": 3}


class Presser:
    """Wants a pause when the step of a number begins, and has the run go on when it pauses."""

    def __init__(self, *numbers: int, paused: Callable[[], object] = lambda: None) -> None:
        self.control = vcfbench.RunControl()
        self.numbers = numbers
        self.paused = paused
        self.events: list[Event] = []

    def handle(self, event: Event) -> None:
        self.events.append(event)
        if isinstance(event, vcfbench.StepStarted) and event.number in self.numbers:
            self.numbers = tuple(number for number in self.numbers if number != event.number)
            self.control.pause("the test")
        if isinstance(event, vcfbench.Paused):
            assert self.control.state == "pausing"
            self.paused()
            self.control.go_on("the test")

    def run(self, procedure: str, **options: Any) -> Run:
        return vcfbench.run(procedure, **{**SHOWN, **options}, observers=[self], control=self.control)

    def went_on(self) -> list[vcfbench.WentOn]:
        return [event for event in self.events if isinstance(event, vcfbench.WentOn)]


def lines_of(run: Run) -> list[dict[str, Any]]:
    assert run.directory is not None
    return list(map(json.loads, (run.directory / "journal.jsonl").read_text("utf-8").splitlines()))


@pytest.fixture(scope="module")
def whole(tmp_path_factory: pytest.TempPathFactory) -> Run:
    return vcfbench.run("turntable", seed=3, runs=tmp_path_factory.mktemp("whole"))


@pytest.fixture
def moved(monkeypatch: pytest.MonkeyPatch) -> list[float]:
    """What is added to every reading, V."""
    added, read = [0.0], Hp34401A.read_voltage_v
    monkeypatch.setattr(Hp34401A, "read_voltage_v", lambda meter: read(meter) + added[0])
    return added


def test_the_bench_rests_warm_and_goes_on_as_it_was(whole: Run, tmp_path: Path) -> None:
    presser = Presser(36)
    run = presser.run("turntable", runs=tmp_path)
    assert run.observers_lost == ()
    assert run.status == "complete"
    assert run.bench_seconds == pytest.approx(whole.bench_seconds)
    assert [point.rate_deg_s for point in run.points] == [point.rate_deg_s for point in whole.points]
    assert abs(run.results.scale_factor.value - whole.results.scale_factor.value) < 2e-6
    lines = lines_of(run)
    types = [line["type"] for line in lines]
    paused, went_on = types.index("paused"), types.index("went_on")
    assert (lines[paused]["n"], lines[paused]["by"], lines[paused - 1]["n"]) == (36, "the test", 36)
    steps = [(line["step_kind"], line["step"]) for line in lines if line["type"] == "restored"]
    kinds = ["SetRate", "AwaitRate", "ConfigureMeter", "Settle", "VerifyZero", "ConfigureMeter", "Settle", "VerifyZero"]
    assert [kind for kind, _ in steps][: len(kinds)] == kinds
    assert {step["rate_deg_s"] for kind, step in steps[: len(kinds)] if kind == "SetRate"} == {0.0}
    again = [step["rate_deg_s"] for kind, step in steps[len(kinds) :] if kind == "SetRate"]
    assert again == [10.0]
    assert not {"DisableSupply", "EnableSupply"} & {kind for kind, _ in steps}
    assert went_on > paused
    (told,) = (event for event in presser.events if isinstance(event, vcfbench.Paused))
    assert told.number == 36
    assert lines[paused]["t_s"] < told.t_s <= lines[went_on]["t_s"]
    values = lines[went_on]["moved"]
    assert abs(values["after_v"] - values["before_v"]) < 5 * values["u_v"]
    (said,) = run.pauses
    assert said.startswith("after step 36: goes on (the test) after 0 s; the output at rest moved by ")
    assert f"paused {said}" in " ".join(vcfbench.text_of(run.report()).split())
    assert run.points[0].moved_u_v == 0.0
    assert run.points[-1].moved_u_v == values["u_v"]
    assert run.directory is not None
    assert "moved_v,moved_u_v\n" in (run.directory / "points.csv").read_text("utf-8")
    assert vcfbench.load_run(run.directory) == run
    assert json.loads((run.directory / "result.json").read_text("utf-8"))["pauses"] == [said]


@pytest.mark.exhaustive
def test_an_output_that_moved_a_little_is_a_new_reference(whole: Run, tmp_path: Path, moved: list[float]) -> None:
    presser = Presser(52, paused=lambda: moved.__setitem__(0, 2e-4))
    run = presser.run("turntable", runs=tmp_path)
    (went_on,) = presser.went_on()
    assert went_on.moved is not None
    assert went_on.moved.moved_v == pytest.approx(2e-4, abs=1.5e-4)
    assert run.points[-1].output_v - whole.points[-1].output_v == pytest.approx(2e-4, abs=1.5e-4)
    apart = run.results.scale_factor.value - whole.results.scale_factor.value
    assert abs(apart) < 2.0 * run.results.scale_factor.u
    assert run.results.scale_factor.u > whole.results.scale_factor.u
    assert vcfbench.load_run(str(run.directory)).results.scale_factor == run.results.scale_factor


def test_an_output_that_moved_too_far_ends_the_run(tmp_path: Path, moved: list[float]) -> None:
    presser = Presser(36, paused=lambda: moved.__setitem__(0, 3e-3))
    with pytest.raises(
        MeasurementError, match=r"moved by \+0\.003 V, .* at most 0\.\d+ V are noise and drift"
    ) as caught:
        presser.run("turntable", runs=tmp_path)
    assert caught.value.step == "36, in the pause after it"
    assert lines_of(caught.value.run)[-1]["status"] == "aborted"
    assert [line["moved"]["allowed_v"] < 3e-3 for line in lines_of(caught.value.run) if line["type"] == "went_on"]


@pytest.mark.exhaustive
def test_sine_is_off_in_pause_and_on_again_after_it(tmp_path: Path) -> None:
    """To select a level switches no output: `online` goes from sine to 0 V and back with the output on."""
    presser = Presser(68)
    run = presser.run("online", settings={"k_vc": "150"}, runs=tmp_path)
    kinds = [line["step_kind"] for line in lines_of(run) if line["type"] == "restored"]
    assert kinds[0] == "DisableVvc"
    assert "EnableVvc" in kinds
    (went_on,) = presser.went_on()
    assert went_on.moved is not None
    assert went_on.moved.u_v < 1e-3  # the sine is 0.3 V


@pytest.mark.exhaustive
def test_a_record_with_a_pause_is_resumed(tmp_path: Path) -> None:
    whole = Presser(18).run("turntable", bench="ideal", settings=QUICK, runs=tmp_path / "a", seed=None)
    broken = cut(whole, tmp_path / "b", 2)
    again = vcfbench.resume(broken)
    assert again.status == "complete"
    assert [point.moved_u_v > 0.0 for point in again.points] == [point.moved_u_v > 0.0 for point in whole.points]
    assert again.pauses == whole.pauses
    assert vcfbench.resume(cut(again, tmp_path / "c", 2)).pauses == whole.pauses


@pytest.mark.parametrize("left", few([0, 1, 9], 1))
def test_broken_pause_counts_neither_time_nor_shift(left: int, tmp_path: Path) -> None:
    """Also where nothing was measured between the pause and the break: its lines alone tell how the output moved."""
    presser = Presser(20)
    whole = presser.run("turntable", bench="lab", settings=QUICK, runs=tmp_path / "a")
    (went_on,) = presser.went_on()
    assert went_on.pause_s > 8.0
    broken = cut(whole, tmp_path / "b", 1)
    lines = (whole.directory / "journal.jsonl").read_bytes().splitlines(keepends=True)
    place = next(number for number, line in enumerate(lines) if b'"type":"went_on"' in line) + 1
    (broken / "journal.jsonl").write_bytes(b"".join(lines[: place + left]))
    again = vcfbench.resume(broken)
    assert again.pauses == whole.pauses
    assert [point.moved_u_v for point in again.points] == [point.moved_u_v for point in whole.points]
    end_s = lines_of(again)[-2]["end_s"]
    assert again.bench_seconds == pytest.approx(end_s - went_on.pause_s, abs=4.0)


@pytest.mark.exhaustive
@pytest.mark.parametrize("samples", few([30, 31, 200], 30, 31))
def test_allowed_drift_of_a_pause_goes_by_its_time(samples: int, tmp_path: Path) -> None:
    """The two windows of a pause are twice as long as the run's: more than 60 s from 31 readings of 1 s on."""
    settings = {"rates_deg_s": (10.0, 0.0, -10.0), "samples": samples, "sample_interval_s": 1.0}
    presser = Presser(36)
    run = presser.run("turntable", bench="lab", settings=settings, runs=tmp_path)
    windows = [line["result"] for line in lines_of(run) if line.get("step_kind") == "VerifyZero" and "why" in line]
    assert [len(each["readings"]) for each in windows] == [2 * samples] * 2
    first_s, second_s = (each["readings"][0]["t_s"] for each in windows)
    assert second_s - first_s >= 2 * samples
    assert run.status == "complete"


@pytest.mark.exhaustive
def test_a_pause_waits_until_a_ring_down_was_seen() -> None:
    """What one step begins and the next one measures is gone after a pause."""
    settings = test_resonance.QUICK
    steps = [each.step for each in vcfbench.dry_run("resonance", "lab", settings=settings).steps]
    kicked = next(place for place, step in enumerate(steps, 1) if type(step).__name__ == "CaptureDecay")
    presser = Presser(kicked - 1)
    assert presser.run("resonance", bench="lab", settings=settings, runs=None).status == "complete"
    assert [event.number for event in presser.went_on()] == [kicked]


def test_a_run_is_stopped_while_it_pauses(tmp_path: Path) -> None:
    presser = Presser(5)
    presser.paused = lambda: presser.control.stop("the test")
    with pytest.raises(Aborted, match="stopped by the test, step 5, in the pause after it") as caught:
        presser.run("turntable", runs=tmp_path)
    assert presser.control.state == "over"
    assert [line["type"] for line in lines_of(caught.value.run)[-2:]] == ["error", "footer"]
    with pytest.raises(PlanError, match="make a RunControl for each run"):
        presser.run("turntable", runs=tmp_path)


SOME = [("virtual-coriolis", 145), ("kvc", 60), ("zero", 14), ("bandwidth", 30), ("power", 40), ("phase", 30)]
SOME += [("temperature", 40), ("polarity", 30), ("vibration", 30)]
SHORT = {"bandwidth": test_bandwidth.QUICK}


@pytest.mark.exhaustive
@pytest.mark.parametrize(("procedure", "number"), few(SOME, ("virtual-coriolis", 145)))
def test_every_procedure_pauses(procedure: str, number: int) -> None:
    presser = Presser(number, 1)
    run = presser.run(procedure, bench="lab", settings=SHORT.get(procedure), runs=None)
    assert run.status == "complete"
    assert len(presser.went_on()) == 2


@pytest.mark.exhaustive
def test_simulated_time_in_a_pause_follows_the_wall(tmp_path: Path) -> None:
    def wait() -> None:
        sleep(WallClock(), 0.15)

    slow = Presser(2, paused=wait)
    still = Presser(2, paused=wait)
    slow.run("turntable", settings=QUICK, runs=tmp_path, speed=200)
    still.run("turntable", settings=QUICK, runs=tmp_path)
    assert slow.went_on()[0].waited_s * 200.0 <= slow.went_on()[0].pause_s
    assert still.went_on()[0].pause_s == 0.0


@pytest.mark.exhaustive
def test_a_stop_is_heard_at_once_in_a_long_wait() -> None:
    """Of a run in a thread, where no signal comes: three minutes of warm-up; on a busy machine once in three."""
    took_s = []
    while len(took_s) < 3 and min(took_s, default=1.0) > 0.3:
        started = vcfbench.start("turntable", speed=20.0, settings={**QUICK, "warm_up_s": 3600.0}, runs=None)
        eventually(lambda: started.state == "running")  # noqa: B023
        with pytest.raises(TimeoutError, match="the run is not over: it is running"):
            started.result(timeout_s=0.4)
        asked = WallClock()
        started.stop("the test")
        with pytest.raises(Aborted, match=r"stopped by the test"):
            started.result(timeout_s=PLENTY_S)
        took_s.append(asked.now())
        assert started.state == "over"
    assert min(took_s) < 0.3


def test_a_started_run_is_waited_for() -> None:
    started = vcfbench.start("turntable", seed=3, settings=QUICK, runs=None)
    assert started.result().status == "complete"
    started.stop()
    assert started.state == "over"
    with pytest.raises(vcfbench.PlanError, match="no procedure"):
        vcfbench.start("nothing", runs=None).result()


@pytest.mark.exhaustive
def test_the_page_has_it_pause_and_go_on(tmp_path: Path) -> None:
    """With a real client, over its socket."""
    pytest.importorskip("uvicorn", reason="pip install 'vcfbench[page]'")
    command = ["vcfbench", "run", "turntable", "--speed", "40", "--page", "--plain"]
    with warm.running(command, tmp_path, errors=True) as process:
        address = urlsplit(process.stderr.readline().split()[1])
        said = iter(process.stderr.readline, "")
        next(line for line in said if "deg/s" in line)
        client = HTTPConnection("127.0.0.1", address.port or 0, timeout=10)

        def asked(what: str) -> dict[str, Any]:
            client.request("POST", f"/run/live/{what}", headers={"X-Vcfbench-Token": address.fragment})
            return json.loads(client.getresponse().read())  # type: ignore[no-any-return]

        assert asked("pause") == {"state": "pausing"}
        assert "(the page): table at rest" in next(line for line in said if "paused after step" in line)
        assert asked("pause")["state"] == "paused"
        assert asked("go-on") == {"state": "running"}
        assert "goes on (the page)" in next(line for line in said if "goes on" in line)
        assert asked("stop") == {"state": "stopping"}
        process.communicate(timeout=60)
        assert process.returncode == Aborted.exit_code


@pytest.mark.exhaustive
@pytest.mark.skipif(not hasattr(os, "openpty"), reason="Windows has no pseudo-terminals")
def test_keys_on_the_terminal_have_it_pause_and_go_on(tmp_path: Path) -> None:
    main, terminal = os.openpty()
    command = [sys.executable, "-m", "vcfbench", "run", "turntable", "--speed", "40", "--plain"]

    def of_a_terminal() -> None:
        import fcntl  # noqa: PLC0415
        import termios  # noqa: PLC0415

        os.setsid()
        fcntl.ioctl(terminal, termios.TIOCSCTTY, 0)

    process = subprocess.Popen(  # noqa: S603
        command,
        cwd=tmp_path,
        stdin=terminal,
        stdout=terminal,
        stderr=terminal,
        preexec_fn=of_a_terminal,  # noqa: PLW1509
    )
    os.close(terminal)
    said = ""

    def until(words: str) -> None:
        nonlocal said
        clock = WallClock()
        while words not in said and clock.now() < 40.0:
            if select.select([main], [], [], 0.2)[0]:
                with suppress(OSError):
                    said += os.read(main, 65536).decode("utf-8", "replace")
        assert words in said, said
        said = said.partition(words)[2]

    try:
        until("deg/s")
        os.write(main, b"p")
        until("pause requested by the terminal")
        until("p or Enter goes on, Ctrl-C stops")
        os.write(main, b"\r")
        until("goes on (the terminal)")
        os.write(main, b"p")
        until("p or Enter goes on")
        process.send_signal(signal.SIGINT)
        until("the bench was made safe")
        assert process.wait(20.0) == Aborted.exit_code
    finally:
        process.kill()
        process.wait()
        os.close(main)


def test_a_run_that_fails_while_it_is_prepared_is_over() -> None:
    started = vcfbench.start("nothing", runs=None)
    with pytest.raises(PlanError, match="nothing"):
        started.result()
    assert started.state == "over"
