from __future__ import annotations

import itertools
import os
import signal
import sys
import threading
from typing import TYPE_CHECKING

import pytest
from hypothesis import given
from hypothesis import strategies as st
from msgspec.structs import replace
from simrack_tests.ports import PLENTY_S, eventually

from tests.bench.fakes import FakeInstrument
from vcfbench.clock import VirtualClock, WallClock, sleep
from vcfbench.errors import NotSafe
from vcfbench.interfaces import SafeReport, UnprovedCommand
from vcfbench.safety.signals import LeaveNow, StopSignals
from vcfbench.safety.stack import SafeAction, SafetyStack, Stage, not_safe

if TYPE_CHECKING:
    from collections.abc import Iterator

    from vcfbench.clock import Deadline

GRACE_S = 0.05


def action(instrument: FakeInstrument, stage: Stage = Stage.POWER, deadline_s: float = 0.0) -> SafeAction:
    return SafeAction(stage, instrument, deadline_s, instrument.verify)


def stack_of(*actions: SafeAction) -> SafetyStack:
    stack = SafetyStack(VirtualClock(), grace_s=GRACE_S)
    for each in actions:
        stack.register(each)
    return stack


@pytest.fixture
def log() -> list[str]:
    return []


@pytest.fixture
def hanging(log: list[str]) -> Iterator[FakeInstrument]:
    instrument = FakeInstrument("hanging", log, "hangs")
    yield instrument
    instrument.released.set()


@pytest.mark.parametrize("order", list(itertools.permutations(Stage)))
def test_order_is_motion_stimulus_power_rest(order: tuple[Stage, ...]) -> None:
    log: list[str] = []
    stack = stack_of(*(action(FakeInstrument(stage.name, log), stage) for stage in order))
    assert all(report.safe for report in stack.make_safe())
    assert log == ["MOTION safe", "STIMULUS safe", "POWER safe", "REST safe"]


def test_within_a_stage_the_last_opened_comes_first(log: list[str]) -> None:
    stack_of(action(FakeInstrument("first", log)), action(FakeInstrument("second", log))).make_safe()
    assert log == ["second safe", "first safe"]


def test_one_that_fails_keeps_no_other_from_being_made_safe(log: list[str]) -> None:
    broken, supply = FakeInstrument("table", log, "fails"), FakeInstrument("power", log)
    reports = stack_of(action(broken, Stage.MOTION), action(supply, Stage.POWER)).make_safe()
    assert [report.safe for report in reports] == [False, True]
    assert "the cable is out" in reports[0].detail
    assert not supply.energised


def test_hanging_instrument_is_skipped(log: list[str], hanging: FakeInstrument) -> None:
    supply = FakeInstrument("power", log)
    reports = stack_of(action(hanging, Stage.MOTION), action(supply, Stage.POWER)).make_safe()
    assert [report.safe for report in reports] == [False, True]
    assert "still busy" in reports[0].detail


@pytest.mark.skipif(sys.platform == "win32", reason="a signal in the middle of a wait")
def test_third_signal_names_energised_instruments_only(log: list[str]) -> None:
    """Sent while the table slows down: the supply stays on, the meter is no danger."""

    class Interrupted(FakeInstrument):
        def make_safe(self, deadline: Deadline) -> SafeReport:
            os.kill(os.getpid(), signal.SIGUSR1)
            self.released.wait(60)
            return super().make_safe(deadline)

    def leave(_number: int, _frame: object) -> None:
        raise LeaveNow

    table, supply, meter = Interrupted("table", log), FakeInstrument("power", log), FakeInstrument("meter", log)
    stack = SafetyStack(VirtualClock(), grace_s=60.0)
    for each, stage in ((meter, Stage.REST), (supply, Stage.POWER), (table, Stage.MOTION)):
        stack.register(action(each, stage))
    before = signal.signal(signal.SIGUSR1, leave)
    try:
        reports = stack.make_safe()
    finally:
        signal.signal(signal.SIGUSR1, before)
        table.released.set()
    assert [(report.instrument, report.safe) for report in reports] == [
        ("table", False),
        ("power", False),
        ("meter", True),
    ]
    assert not supply.energised  # it heard the words that the third signal sends to all
    words = "power at FAKE::power: told to switch off, not proved; last read back: on 3 s ago"
    assert f"{words}; a third signal ended the making safe" in str(not_safe(reports))
    assert "meter" not in str(not_safe(reports))


def test_one_that_lies_is_found_out_by_the_read_back(log: list[str]) -> None:
    reports = stack_of(action(FakeInstrument("power", log, "lies"))).make_safe()
    assert [(report.safe, report.detail) for report in reports] == [(False, "reported safe, but it is still on")]


def test_one_that_says_itself_that_it_is_on_is_believed(log: list[str]) -> None:
    reports = stack_of(action(FakeInstrument("power", log, "refuses"))).make_safe()
    assert [(report.safe, report.detail) for report in reports] == [(False, "with 0 s left")]


def test_longest_making_safe_is_sum_of_deadlines(log: list[str]) -> None:
    plain, patient = SafetyStack(VirtualClock()), SafetyStack(VirtualClock(), patience=3.0, grace_s=0.5)
    for each in (plain, patient):
        each.register(action(FakeInstrument("power", log), deadline_s=7.0))
        each.register(action(FakeInstrument("table", log), deadline_s=1.0))
    assert plain.longest_s == 5.0 + (7.0 + 2.0) + (1.0 + 2.0)
    assert patient.longest_s == 5.0 + (21.0 + 0.5) + (3.0 + 0.5)


def test_silent_measuring_instrument_is_not_unsafe(log: list[str]) -> None:
    broken, good = FakeInstrument("multimeter", log, "fails"), FakeInstrument("oscilloscope", log)
    said, report = stack_of(action(broken, Stage.REST), action(good, Stage.REST)).make_safe()
    assert (said.safe, said.detail) == (True, "with 0 s left")
    assert report.safe
    assert report.detail.startswith("it only listens, but: LinkLost: ")


def test_one_whose_read_back_fails_is_not_safe(log: list[str]) -> None:
    def broken() -> str | None:
        raise OSError("gone")

    (report,) = stack_of(SafeAction(Stage.POWER, FakeInstrument("power", log), 0.0, broken)).make_safe()
    assert not report.safe
    assert "gone" in report.detail


def test_the_instrument_is_given_its_deadline(log: list[str]) -> None:
    (report,) = stack_of(action(FakeInstrument("power", log), deadline_s=7.0)).make_safe()
    assert report.detail == "with 7 s left"


def test_instrument_that_uses_its_deadline_and_grace_is_safe(log: list[str]) -> None:
    class Slow(FakeInstrument):
        def make_safe(self, deadline: Deadline) -> SafeReport:
            self.released.wait(0.15)
            return super().make_safe(deadline)

    stack = SafetyStack(VirtualClock(), patience=0.1, grace_s=0.3)  # 0.1 s of its own
    stack.register(action(Slow("power", log), deadline_s=1.0))
    assert [report.safe for report in stack.make_safe()] == [True]


@pytest.mark.exhaustive
def test_telling_takes_half_a_second_however_many_hang(log: list[str]) -> None:
    over = threading.Event()

    class Stuck(FakeInstrument):
        def command_safe(self) -> UnprovedCommand:
            over.wait(30.0)
            return super().command_safe()

    stack = stack_of(*(action(Stuck(f"power {number}", log)) for number in range(8)))
    wall = WallClock()
    try:
        stack.command_safe()
    finally:
        over.set()
    assert 0.4 < wall.now() < 0.7  # 8 turns of 0.1 s are more


@given(st.lists(st.tuples(st.sampled_from(Stage), st.sampled_from(["obeys", "fails", "refuses", "lies"])), max_size=8))
def test_every_instrument_is_tried_once_and_reported_as_it_is(crowd: list[tuple[Stage, str]]) -> None:
    log: list[str] = []
    instruments = [FakeInstrument(str(index), log, behaviour) for index, (_, behaviour) in enumerate(crowd)]
    stages = [stage for stage, _ in crowd]
    reports = stack_of(*map(action, instruments, stages)).make_safe()
    assert sorted(log) == sorted(f"{instrument.name} safe" for instrument in instruments)
    truly_safe = {
        instrument.name: not instrument.energised or stage is Stage.REST
        for instrument, stage in zip(instruments, stages, strict=True)
    }
    assert {report.instrument: report.safe for report in reports} == truly_safe


def test_closing_continues_after_failure_and_hang(log: list[str], hanging: FakeInstrument) -> None:
    broken, good = FakeInstrument("broken", log, "fails"), FakeInstrument("good", log)
    stack_of(action(good), action(hanging), action(broken)).close()
    assert log == ["broken closed", "hanging closed", "good closed"]


def test_not_safe_names_everything_that_is_not_and_nothing_else(log: list[str]) -> None:
    crowd = [FakeInstrument("table", log, "fails"), FakeInstrument("power", log), FakeInstrument("source", log, "lies")]
    error = not_safe(stack_of(*map(action, crowd)).make_safe())
    assert isinstance(error, NotSafe)
    assert error.exit_code == 5
    assert "table at FAKE::table" in str(error)
    assert "source at FAKE::source" in str(error)
    assert "power" not in str(error)
    assert not_safe([]) is None


def test_not_safe_names_instrument_once() -> None:
    error = not_safe([SafeReport("power", "COM1", safe=False, detail="power at COM1: nobody answers")])
    assert str(error) == "NOT SAFE: power at COM1: nobody answers; make it safe by hand before anything else"


# What all are told


def test_all_are_told_in_order_before_anything_is_proved(log: list[str]) -> None:
    commanded: list[str] = []

    class Listening(FakeInstrument):
        def command_safe(self) -> UnprovedCommand:
            commanded.append(self.name)
            return super().command_safe()

        def make_safe(self, deadline: Deadline) -> SafeReport:
            assert len(commanded) == 3
            return super().make_safe(deadline)

    crowd = {stage: Listening(stage.name, log) for stage in (Stage.POWER, Stage.STIMULUS, Stage.MOTION)}
    reports = stack_of(*(action(instrument, stage) for stage, instrument in crowd.items())).make_safe()
    assert commanded == ["MOTION", "STIMULUS", "POWER"]
    assert all(report.safe and report.unproved is None for report in reports)


def test_silent_instrument_is_off_and_named(log: list[str]) -> None:
    dumb = FakeInstrument("power", log, "dumb")
    (report,) = stack_of(action(dumb)).make_safe()
    assert (report.safe, dumb.energised, dumb.commands) == (False, False, 2)
    words = "power at FAKE::power: told to switch off, not proved; last read back: on 3 s ago; LinkLost: "
    assert words in str(not_safe([report]))


def test_one_that_cannot_be_told_is_said_to_be_so(log: list[str]) -> None:
    stack = stack_of(action(FakeInstrument("power", log, "fails")))
    (report,) = stack.make_safe()
    stack.close()
    assert "power at FAKE::power: could not be told to switch off; last read back: on 3 s ago" in str(
        not_safe([report])
    )


def test_one_whose_words_hang_keeps_nothing_from_the_others(log: list[str]) -> None:
    over = threading.Event()

    class Stuck(FakeInstrument):
        def command_safe(self) -> UnprovedCommand:
            over.wait(30.0)
            return super().command_safe()

    stuck, dumb = Stuck("table", log, "dumb"), FakeInstrument("power", log, "dumb")
    try:
        reports = stack_of(action(stuck, Stage.MOTION), action(dumb, Stage.POWER)).make_safe()
    finally:
        over.set()
    assert not dumb.energised
    assert [report.unproved is None for report in reports] == [True, False]


def test_one_whose_words_raise_keeps_nothing_from_the_others(log: list[str]) -> None:
    class Careless(FakeInstrument):
        def command_safe(self) -> UnprovedCommand:
            raise ZeroDivisionError

    dumb = FakeInstrument("power", log, "dumb")
    stack = stack_of(action(Careless("table", log), Stage.MOTION), action(dumb, Stage.POWER))
    stack.command_safe()
    stack.close()
    assert not dumb.energised


def test_slow_instrument_is_awaited_while_others_are_commanded(log: list[str], monkeypatch: pytest.MonkeyPatch) -> None:
    class Slow(FakeInstrument):
        def command_safe(self) -> UnprovedCommand:
            sleep(WallClock(), 0.05)
            return super().command_safe()

    monkeypatch.setattr("vcfbench.safety.stack._TURN_S", 0.001)
    monkeypatch.setattr("vcfbench.safety.stack._TELLING_S", PLENTY_S)
    wall = WallClock()
    reports = stack_of(action(Slow("table", log, "dumb")), action(FakeInstrument("power", log, "dumb"))).make_safe()
    assert all(report.unproved is not None for report in reports)
    assert wall.now() < PLENTY_S


def test_own_knowledge_of_driver_survives_silence(log: list[str]) -> None:
    words = UnprovedCommand("to stop", sent=True)

    class Careless(FakeInstrument):
        def make_safe(self, deadline: Deadline) -> SafeReport:
            return replace(super().make_safe(deadline), safe=False, unproved=words)

        def command_safe(self) -> UnprovedCommand:
            raise ZeroDivisionError

    stack = stack_of(action(Careless("table", log)))
    (report,) = stack.make_safe()
    stack.close()
    assert report.unproved is words


def test_one_whose_connection_comes_back_is_told_then(log: list[str]) -> None:
    """While others are being made safe, or have failed to be."""
    back = threading.Event()

    class Away(FakeInstrument):
        def command_safe(self) -> UnprovedCommand:
            super().command_safe()
            if self.commands == 3:
                back.set()
            return UnprovedCommand("to switch off", sent=self.commands >= 3)

    stack = stack_of(action(Away("power", log)))
    stack.command_safe()
    assert back.wait(10.0)
    stack.close()


@pytest.mark.parametrize("end", ["closed", "in time"])
def test_reconnected_instrument_gets_off_command(end: str, log: list[str], monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("vcfbench.safety.stack._BETWEEN_S", 0.005)
    monkeypatch.setattr("vcfbench.safety.stack._RETURN_S", 0.1 if end == "in time" else PLENTY_S)
    away, there = FakeInstrument("power", log, "fails"), FakeInstrument("table", log)
    stack = stack_of(action(away), action(there))
    stack.command_safe()
    eventually(lambda: away.commands > (2 if end == "closed" else 0))
    if end == "closed":
        stack.close()
    sleep(WallClock(), 0.15)
    told = away.commands
    sleep(WallClock(), 0.05)
    assert (away.commands, there.commands) == (told, 1)


def test_without_threads_each_is_told_once(log: list[str], monkeypatch: pytest.MonkeyPatch) -> None:
    """As the interpreter ends none can be started."""

    def none(_act: object) -> None:
        raise RuntimeError("can't start new thread")

    monkeypatch.setattr("vcfbench.safety.stack.start_thread", none)
    crowd = [FakeInstrument("table", log, "fails"), FakeInstrument("power", log)]
    stack_of(*map(action, crowd)).command_safe()
    assert [(each.commands, each.energised) for each in crowd] == [(1, True), (1, False)]


@pytest.mark.skipif(sys.platform == "win32", reason="a signal in the middle of a wait")
def test_third_signal_does_not_cut_last_message(log: list[str]) -> None:
    class Interrupted(FakeInstrument):
        def command_safe(self) -> UnprovedCommand:
            if self.commands == 1 and not self.released.is_set():
                self.released.set()
                os.kill(os.getpid(), signal.SIGUSR1)
                sleep(WallClock(), 0.05)
            return super().command_safe()

    def leave(_number: int, _frame: object) -> None:
        raise LeaveNow

    table, supply = Interrupted("table", log, "dumb"), FakeInstrument("power", log, "dumb")
    before = signal.signal(signal.SIGUSR1, leave)
    try:
        reports = stack_of(action(table, Stage.MOTION), action(supply)).make_safe()
    finally:
        signal.signal(signal.SIGUSR1, before)
    assert [(report.safe, report.unproved is None) for report in reports] == [(False, False)] * 2
    assert table.commands >= 2
    assert supply.commands >= 2


def test_once_all_is_proved_signals_change_nothing(log: list[str]) -> None:
    with StopSignals() as signals:
        signals.unwind()
        assert [each.safe for each in stack_of(action(FakeInstrument("power", log))).make_safe_until_ended(signals)]
        for _ in range(4):
            signal.raise_signal(signal.SIGINT)


def test_signals_behind_the_last_proof_leave_none_untold(log: list[str], monkeypatch: pytest.MonkeyPatch) -> None:
    def late(_stack: SafetyStack) -> list[SafeReport]:
        for _ in range(3):
            signal.raise_signal(signal.SIGINT)
        pytest.fail("the third one ends it")

    supply = FakeInstrument("power", log)
    monkeypatch.setattr(SafetyStack, "make_safe", late)
    with StopSignals() as signals:
        signals.unwind()
        with pytest.raises(NotSafe, match="by a third signal; go and look at every instrument"):
            stack_of(action(supply)).make_safe_until_ended(signals)
        assert (supply.energised, supply.commands) == (False, 1)
        signal.raise_signal(signal.SIGINT)
