"""The session's promise: the answer to the question, or an error; never another answer."""

from __future__ import annotations

import math
from collections import deque
from contextlib import nullcontext
from typing import TYPE_CHECKING

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from vcfbench.clock import Deadline, VirtualClock, sleep
from vcfbench.drivers.session import Session, visa_resource
from vcfbench.errors import (
    BenchError,
    ConnectFailed,
    DeadlineExceeded,
    FramingError,
    InstrumentError,
    LinkLost,
    MeasurementError,
    OutOfSync,
    TransportError,
)
from vcfbench.testing import Exchange, expected_exchange, over_visa

if TYPE_CHECKING:
    from collections.abc import Callable, Sequence

    from vcfbench.drivers.wire import Interface, Wire

IDENTITY = "ACME,X1,0,1"
OPEN = over_visa(lambda session: session, name="device", timeout_s=1.0)
SYNC: list[Exchange] = [("*IDN?", IDENTITY), ("*OPC?", "1"), ("SYST:ERR?", '+0,"No error"')]


class SlowWire:
    """An instrument that answers in order, each time after a delay of its own, not always, and not always whole."""

    def __init__(self, clock: VirtualClock, moods: Sequence[tuple[float, str]]) -> None:
        self.interface: Interface = "socket"
        self._clock = clock
        self._moods = deque(moods)
        self._free_s = 0.0
        self._coming: deque[tuple[float, bytes]] = deque()

    def send(self, data: bytes, deadline: Deadline) -> None:
        del deadline
        question = data.decode().strip()
        delay_s, mood = self._moods.popleft() if self._moods else (0.0, "well")
        self._free_s = max(self._free_s, self._clock.now()) + delay_s
        known = {"*IDN?": IDENTITY, "*OPC?": "1", "SYST:ERR?": '+0,"No error"'}
        answer = known.get(question, question.removesuffix("?")).encode() + b"\n"
        shapes = {"well": answer, "lost": b"", "cut": answer[:-2], "twice": answer * 2, "noise": b"\xff" + answer}
        if shapes[mood]:
            self._coming.append((self._free_s, shapes[mood]))

    def receive(self, deadline: Deadline) -> tuple[bytes, bool]:
        if not self._coming or self._coming[0][0] > deadline.expires_s:
            self._clock.sleep_until(deadline.expires_s)
            raise DeadlineExceeded("no answer")
        at_s, data = self._coming.popleft()
        self._clock.sleep_until(at_s)
        return data, False

    def pending(self) -> bytes:
        data = b""
        while self._coming and self._coming[0][0] <= self._clock.now():
            data += self._coming.popleft()[1]
        return data

    def clear(self, deadline: Deadline) -> None:
        del deadline
        self.pending()

    def close(self) -> None: ...


MOODS = st.tuples(
    st.sampled_from([0.0, 0.0, 0.0, 0.4, 0.9, 1.1, 2.5]),
    st.sampled_from(["well", "well", "well", "lost", "cut", "twice", "noise"]),
)


@settings(max_examples=120)
@given(st.lists(MOODS, max_size=12), st.lists(st.sampled_from(["Q", "*IDN?", "*OPC?"]), min_size=1, max_size=12))
def test_answer_is_of_its_query_or_error(moods: list[tuple[float, str]], asked: list[str]) -> None:
    clock = VirtualClock()
    session = Session(SlowWire(clock, moods), name="device", resource="X", clock=clock, timeout_s=1.0)
    session._identity = IDENTITY
    named: list[str | None] = []
    for n, kind in enumerate(asked):
        question = f"Q{n}?" if kind == "Q" else kind
        begin_s = clock.now()
        try:
            answer = session.query(question)
        except TransportError as error:
            named.append(error.instrument)
        else:
            assert answer == {"*IDN?": IDENTITY, "*OPC?": "1"}.get(question, f"Q{n}")
        assert clock.now() - begin_s <= 1.0 + 1e-9
        if n % 3 == 2:
            sleep(clock, 3.0)
    assert set(named) <= {"device"}


def test_a_write_is_followed_by_the_error_queue() -> None:
    with expected_exchange(OPEN, [("A 1", None), ("B 2", None), ("SYST:ERR?", '+0,"No error"')]) as session:
        session.write("A 1", "B 2")


def test_an_error_queue_that_does_not_empty_does_not_hang() -> None:
    with (
        expected_exchange(OPEN, [("SYST:ERR?", '-350,"Queue overflow"')] * 64) as session,
        pytest.raises(InstrumentError),
    ):
        session.check_errors()


def test_error_queue_is_read_within_one_time_out() -> None:
    class Slow(PieceWire):
        def receive(self, deadline: Deadline) -> tuple[bytes, bool]:
            sleep(self._clock, 0.4)
            return super().receive(deadline)

    session = on(Slow(VirtualClock(), b'-350,"Queue overflow"\n', 64))
    with pytest.raises(DeadlineExceeded):
        session.check_errors()
    assert session.clock.now() < 1.3


def test_errors_found_while_resynchronising_are_raised_at_the_next_check() -> None:
    exchanges: list[Exchange] = [
        ("*IDN?", IDENTITY),
        ("READ?", None),
        *SYNC[:2],
        ("SYST:ERR?", '-410,"Query INTERRUPTED"'),
        ("SYST:ERR?", '+550,"Command not allowed in local"'),
        ("SYST:ERR?", '+0,"No error"'),
        ("A?", "1"),
        ("SYST:ERR?", '+0,"No error"'),
        ("SYST:ERR?", '+0,"No error"'),
    ]
    with expected_exchange(OPEN, exchanges) as session:
        session.identify()
        with pytest.raises(DeadlineExceeded):
            session.query("READ?")
        assert session.query("A?") == "1"
        with pytest.raises(InstrumentError, match="550") as caught:
            session.check_errors()
        assert "-410" not in str(caught.value)
        session.check_errors()


@pytest.mark.parametrize(("number", "kept"), [(-399, True), (-400, False), (-499, False), (-500, True)])
def test_only_query_errors_are_the_doing_of_a_broken_exchange(number: int, kept: bool) -> None:  # noqa: FBT001
    """-400 to -499 are query errors (SCPI-99 vol. 2, 21.8.12); whatever else is queued is somebody's business."""
    exchanges: list[Exchange] = [
        ("*IDN?", IDENTITY),
        ("READ?", None),
        *SYNC[:2],
        ("SYST:ERR?", f'{number},"Something"'),
        SYNC[2],
        ("A?", "1"),
        SYNC[2],
    ]
    with expected_exchange(OPEN, exchanges) as session:
        session.identify()
        with pytest.raises(DeadlineExceeded):
            session.query("READ?")
        assert session.query("A?") == "1"
        with pytest.raises(InstrumentError, match=str(number)) if kept else nullcontext():
            session.check_errors()


def test_no_time_left_sends_nothing_and_gives_nothing_up() -> None:
    with expected_exchange(OPEN, []) as session:
        with pytest.raises(DeadlineExceeded, match="before anything was sent"):
            session.query("A?", Deadline.after(session.clock, 0.0))
        session.dirty = True
        with pytest.raises(DeadlineExceeded, match="before anything was sent"):
            session.query("A?", Deadline.after(session.clock, 0.0))
        assert not session.closed


def test_without_a_known_answer_a_failed_session_is_closed() -> None:
    with expected_exchange(OPEN, [("A?", None)]) as session:
        with pytest.raises(DeadlineExceeded):
            session.query("A?")
        with pytest.raises(OutOfSync):
            session.query("B?")
        with pytest.raises(LinkLost, match="connection is closed"):
            session.query("C?")


def test_the_deadline_covers_command_pause_and_error_queue() -> None:
    opener = over_visa(lambda session: session, timeout_s=1.0, write_pause_s=0.4)
    with expected_exchange(opener, [("A", None), ("B", None), ("SYST:ERR?", None)]) as session:
        with pytest.raises(DeadlineExceeded):
            session.write("A", "B")
        assert session.clock.now() == 1.0


def test_every_kind_of_question() -> None:
    exchanges: list[Exchange] = [
        ("F?", "+1.5E+00"),
        ("N?", "9.8E37"),
        ("O?", "9.9E37"),
        ("L?", "1,2,3"),
        ("I?", "+7"),
        ("B?", "0"),
        ("D?", "#13abc"),
    ]
    with expected_exchange(OPEN, exchanges) as session:
        assert session.query_reading("F?") == 1.5
        assert session.query_number("N?") == 9.8e37
        assert session.query_ohms("O?") == math.inf
        assert session.query_numbers("L?") == (1.0, 2.0, 3.0)
        assert session.query_int("I?") == 7
        assert session.query_bool("B?") is False
        assert session.query_block("D?") == b"abc"


def test_errors_say_who_where_what_and_after_how_long() -> None:
    with expected_exchange(OPEN, [("READ?", None)]) as session:
        with pytest.raises(BenchError) as caught:
            session.query("READ?")
        assert str(caught.value) == "device at SCRIPT: no answer, command 'READ?', after 1 s"


def test_overload_says_who_where_and_what() -> None:
    with (
        expected_exchange(OPEN, [("READ?", "+9.90000000E+37")]) as session,
        pytest.raises(MeasurementError, match=r"device at SCRIPT: overload .*, command 'READ\?'"),
    ):
        session.query_reading("READ?")


@pytest.mark.parametrize(
    ("answer", "came"),
    [
        (b"10 V\r\n", b"10 V"),
        (b"#15a\nb\nc\n", b"#15a\nb\nc"),
        (b"+4,+0,3;#13\n\n;;1\n", b"+4,+0,3;#13\n\n;;1"),
        (b"\xff\x00\n", b"\xff\x00"),
    ],
)
@pytest.mark.parametrize("pieces", [1, 3])
def test_raw_answers_come_as_they_are_in_however_many_pieces(answer: bytes, came: bytes, pieces: int) -> None:
    clock = VirtualClock()
    wire = PieceWire(clock, answer, pieces)
    session = Session(wire, name="device", resource="PIECES", clock=clock, timeout_s=1.0)
    assert session.query_raw("ANY?") == came
    assert not session.dirty
    assert wire.left == b""


def test_endless_raw_answer_ends_at_deadline() -> None:
    clock = VirtualClock()
    session = Session(PieceWire(clock, b"#210abc", 2), name="device", resource="PIECES", clock=clock, timeout_s=1.0)
    with pytest.raises(DeadlineExceeded, match=r"command 'ANY\?'"):
        session.query_raw("ANY?")
    assert session.dirty


@pytest.mark.parametrize("size", [1, 3, 7, 64])
@pytest.mark.parametrize("end", [b"\n", b"\r\n"])
def test_a_block_comes_whole_in_however_many_pieces(size: int, end: bytes) -> None:
    """Newlines in the data are data; the one after it belongs to the message (IEEE 488.2, 8.7.9)."""
    clock = VirtualClock()
    wire = PieceWire(clock, b"#215" + b"a\nb#3\r\nefghijk\n" + end, size)
    session = Session(wire, name="device", resource="PIECES", clock=clock, timeout_s=1.0)
    assert session.query_block("ANY?") == b"a\nb#3\r\nefghijk\n"
    assert not session.dirty
    assert clock.now() == 0.0


def test_a_block_may_be_ended_by_end_alone() -> None:
    with expected_exchange(OPEN, [("D?", b"#13abc"), ("D?", b"#13abc\n")]) as session:
        assert session.query_block("D?") == session.query_block("D?") == b"abc"


def test_a_line_without_end_is_given_up_after_four_mebibytes() -> None:
    clock = VirtualClock()
    wire = PieceWire(clock, b"1" * 9_000_000, 1 << 20)
    session = Session(wire, name="device", resource="PIECES", clock=clock, timeout_s=1.0)
    with pytest.raises(FramingError, match=r"5242880 bytes came without an end of line, command 'ANY\?'"):
        session.query("ANY?")
    assert session.dirty


def test_every_command_is_followed_by_instruments_pause() -> None:
    opener = over_visa(lambda session: session, timeout_s=5.0, write_pause_s=0.4)
    with expected_exchange(opener, [("A", None), ("B", None), ("C?", "1")]) as session:
        session.send("A", "B")
        assert session.clock.now() == pytest.approx(0.8)
        session.query("C?")
        assert session.clock.now() == pytest.approx(0.8)


@pytest.mark.parametrize(("asked", "pause_s"), [({}, 0.0), ({"write_pause_s": 0.5}, 0.5)])
def test_a_session_has_the_pauses_that_are_asked_for(
    asked: dict[str, float], pause_s: float, monkeypatch: pytest.MonkeyPatch
) -> None:
    clock = VirtualClock()
    monkeypatch.setattr("vcfbench.drivers.visa_wire.open_wire", lambda *_: PieceWire(clock, b"", 1))
    connect = visa_resource("X", "@py")
    Session.opened(connect, name="device", resource="X", clock=clock, timeout_s=1.0, **asked).send("A")
    assert clock.now() == pause_s


def test_closed_session_refuses_every_call() -> None:
    with expected_exchange(OPEN, []) as session:
        session.close()
        attempts: list[Callable[[], object]] = [session.clear, session.revive, session.resync, session.check_errors]
        for attempt in attempts:
            with pytest.raises(LinkLost, match=r"device at SCRIPT: the connection is closed \(it was given back\)"):
                attempt()


def test_a_command_that_was_interrupted_leaves_the_session_dirty() -> None:
    class Interrupted(PieceWire):
        def send(self, data: bytes, deadline: Deadline) -> None:
            del data, deadline
            raise KeyboardInterrupt

    for act in (lambda session: session.send("A"), lambda session: session.query("A?")):
        session = on(Interrupted(VirtualClock(), b"", 1))
        with pytest.raises(KeyboardInterrupt):
            act(session)
        assert session.dirty


@pytest.mark.parametrize("ask", ["query", "query_raw"])
def test_an_answer_that_drips_in_runs_into_its_deadline_too(ask: str) -> None:
    class Dripping(PieceWire):
        def receive(self, deadline: Deadline) -> tuple[bytes, bool]:
            del deadline
            sleep(self._clock, 0.3)
            assert self._clock.now() < 60.0
            return b"1", False

    with pytest.raises(DeadlineExceeded, match=r"no answer but b'1+', command 'ANY\?', after 1\.2 s"):
        getattr(on(Dripping(VirtualClock(), b"", 1)), ask)("ANY?")


@pytest.mark.parametrize(
    ("ask", "answer"), [("query", b"+1.5\n"), ("query_raw", b"+1,2\n"), ("query_block", b"#13abc\n")]
)
def test_answer_cut_anywhere_is_reported_as_far_as_it_came(ask: str, answer: bytes) -> None:
    for cut in range(len(answer)):
        with pytest.raises(DeadlineExceeded) as caught:
            getattr(on(PieceWire(VirtualClock(), answer[:cut], 2)), ask)("ANY?")
        begun = answer[: min(cut, 4 if ask == "query_block" else cut)]  # of a block, its header and what came with it
        came = f" but {begun!r}" if cut else ""
        assert str(caught.value).startswith(f"device at X: no answer{came}, command 'ANY?', after 1 s")


def test_a_line_may_be_ended_by_end_alone() -> None:
    with expected_exchange(OPEN, [("A?", b"5"), ("B?", "6")]) as session:
        assert (session.query("A?"), session.query("B?")) == ("5", "6")


def test_command_after_a_failed_query_waits_for_resynchronisation() -> None:
    with expected_exchange(OPEN, [("*IDN?", IDENTITY), ("A?", None), *SYNC, ("B 1", None)]) as session:
        session.identify()
        with pytest.raises(DeadlineExceeded):
            session.query("A?")
        session.send("B 1")


def test_session_is_resynchronised_once_by_clear() -> None:
    with expected_exchange(OPEN, [("*IDN?", IDENTITY), *SYNC, ("A?", "1"), *SYNC, ("A?", "1")]) as session:
        session.identify()
        for bring in (session.revive, session.resync):
            session.dirty = True
            bring()
            assert session._wire.clears > 0  # type: ignore[attr-defined]
            assert session.query("A?") == "1"
        session.revive()  # it is in step


def test_endless_error_queue_does_not_hang_resynchronising() -> None:
    full: list[Exchange] = [("SYST:ERR?", '-350,"Queue overflow"')] * 64
    with expected_exchange(OPEN, [("*IDN?", IDENTITY), *SYNC[:2], *full, ("A?", "1")]) as session:
        session.identify()
        session.dirty = True
        assert session.query("A?") == "1"


def test_own_deadline_limits_search_for_next_reply() -> None:
    session = on(PieceWire(VirtualClock(), b"", 1))
    session._identity = IDENTITY
    with pytest.raises(OutOfSync, match=r"device at X: .*after 0\.2 s"):
        session.resync(Deadline.after(session.clock, 0.2))
    assert session.closed


def test_late_second_answer_is_dropped() -> None:
    class Doubling(SlowWire):
        def send(self, data: bytes, deadline: Deadline) -> None:
            super().send(data, deadline)
            at_s, answer = self._coming[-1]
            self._coming.append((at_s + 0.05, answer))

    session = on(Doubling(VirtualClock(), []))
    session._identity = IDENTITY
    session.dirty = True
    assert session.query("Q1?") == "Q1"


def test_a_device_clear_has_the_deadline_of_its_caller() -> None:
    class Clearing(PieceWire):
        def clear(self, deadline: Deadline) -> None:
            self.left = f"{deadline.remaining():g}".encode()

    wire = Clearing(VirtualClock(), b"", 1)
    session = on(wire)
    session.clear(Deadline.after(session.clock, 0.25))
    assert wire.left == b"0.25"
    session.clear()
    assert wire.left == b"1"


@pytest.mark.parametrize(("bring", "command"), [("clear", "device clear"), ("resync", "*IDN?")])
def test_connection_lost_during_clear_names_the_reason(bring: str, command: str) -> None:
    class Gone(PieceWire):
        def clear(self, deadline: Deadline) -> None:
            del deadline
            sleep(self._clock, 0.25)
            raise LinkLost("the connection broke")

    session = on(Gone(VirtualClock(), b"", 1))
    session._identity = IDENTITY
    with pytest.raises(LinkLost, match="device at X: the connection broke") as lost:
        getattr(session, bring)()
    assert (lost.value.command, lost.value.elapsed_s, session.closed) == (command, 0.25, True)


def test_what_came_before_a_device_clear_is_forgotten() -> None:
    session = on(PieceWire(VirtualClock(), b"5\n", 64))
    session._received = b"4\n"
    session.clear()
    assert session.query("A?") == "5"


def test_half_the_time_resynchronises_and_the_rest_reconnects() -> None:
    clock, tried = VirtualClock(), list[tuple[float, float]]()

    def reconnect(deadline: Deadline) -> Wire:
        tried.append((clock.now(), deadline.remaining()))
        sleep(clock, 0.125)
        raise ConnectFailed("nobody answers")

    session = Session(
        PieceWire(clock, b"", 1), name="device", resource="X", clock=clock, timeout_s=9.0, reconnect=reconnect
    )
    session._identity, session.dirty = IDENTITY, True
    with pytest.raises(ConnectFailed, match="device at X: nobody answers") as failed:
        session.revive(Deadline.after(clock, 1.0))
    assert tried == [(0.5, 0.5)]
    assert (failed.value.command, failed.value.elapsed_s) == (None, 0.625)


def test_error_queue_is_read_before_callers_deadline() -> None:
    session = on(PieceWire(VirtualClock(), b"", 1))
    with pytest.raises(DeadlineExceeded, match=r"after 0\.25 s"):
        session.check_errors(Deadline.after(session.clock, 0.25))


def test_lost_instrument_is_named_before_sending() -> None:
    class Gone(PieceWire):
        def pending(self) -> bytes:
            raise LinkLost("the other end has closed the connection")

    session = on(Gone(VirtualClock(), b"", 1))
    with pytest.raises(LinkLost, match="device at X: the other end has closed"):
        session.query("A?")
    assert session.closed


def test_late_words_are_no_answer() -> None:
    """A second answer or noise, in the library's buffer when all questions have been answered."""

    class Late(SlowWire):
        goes = False

        def pending(self) -> bytes:
            if self.goes and not self._coming:
                raise LinkLost("the other end has closed the connection")
            return super().pending()

        def send(self, data: bytes, deadline: Deadline) -> None:
            super().send(data, deadline)
            if data == b"SYST:ERR?\n" and not self.goes:
                self._coming.append((self._clock.now(), b"noise\n"))

    wire = Late(VirtualClock(), [])
    session = on(wire)
    session._identity, session.dirty = IDENTITY, True
    assert session.query("Q1?") == "Q1"
    wire.goes, session.dirty = True, True
    session._wire.clear = lambda _: None  # type: ignore[method-assign]
    with pytest.raises(LinkLost, match="device at X: the other end has closed") as lost:
        session.query("Q2?")
    assert lost.value.elapsed_s == 0.0
    assert session.closed


def test_a_second_answer_beside_the_first_is_nobody_s() -> None:
    with expected_exchange(OPEN, [("*IDN?", IDENTITY), ("A?", b"1\n2\n"), *SYNC, ("B?", "5")]) as session:
        session.identify()
        assert session.query("A?") == "1"
        assert session.query("B?") == "5"


@pytest.mark.parametrize(("end", "brought_into_step"), [(b"\n", False), (b"\r\n", False), (b"\n2\n", True)])
def test_what_follows_a_block_is_nobody_s_answer(end: bytes, *, brought_into_step: bool) -> None:
    sync = SYNC if brought_into_step else []
    with expected_exchange(OPEN, [("*IDN?", IDENTITY), ("D?", b"#13abc" + end), *sync, ("A?", "5")]) as session:
        session.identify()
        assert session.query_block("D?") == b"abc"
        assert session.query("A?") == "5"


def test_refusals_without_error_queue_are_read_from_event_status() -> None:
    """Bits 2 to 5 of it (IEEE 488.2, 11.5.1): power on and operation complete are no refusals."""
    with expected_exchange(OPEN, [("*ESR?", "+48"), ("*ESR?", "0"), ("*ESR?", "+129")]) as session:
        session.use_event_status()
        with pytest.raises(
            InstrumentError, match=r"""reports 48 "execution error, command error", command '\*ESR\?'"""
        ):
            session.check_errors()
        session.check_errors()


def test_safe_words_end_a_torn_line_and_may_be_none() -> None:
    sent: list[bytes] = []

    class Noting(PieceWire):
        def send(self, data: bytes, deadline: Deadline) -> None:
            del deadline
            sent.append(data)

    session = on(Noting(VirtualClock(), b"", 1))
    assert session.command_safe() is True
    assert sent == []
    session.declare_safe("OUTP OFF", "VOLT 0")
    assert session.command_safe() is True
    assert sent == [b"\nOUTP OFF\nVOLT 0\n"]
    session.declare_safe()
    assert session.command_safe() is True
    assert len(sent) == 1


def test_instrument_with_pauses_gets_one_after_its_safe_words() -> None:
    clock = VirtualClock()
    session = on(PieceWire(clock, b"", 1), write_pause_s=0.4)
    session.revive()
    assert clock.now() == 0.0
    session.declare_safe("STOP")
    session.revive()
    assert clock.now() == 0.4
    session.revive(Deadline.after(clock, 0.1))
    assert clock.now() == 0.5


def test_a_session_is_closed_where_its_context_ends() -> None:
    session = on(PieceWire(VirtualClock(), b"", 1))
    with session as entered:
        assert entered is session
    assert session.closed


def on(wire: Wire, **more: float) -> Session:
    return Session(wire, name="device", resource="X", clock=wire._clock, timeout_s=1.0, **more)  # type: ignore[attr-defined]


class PieceWire:
    """A socket: it answers one question in pieces, and knows no END."""

    def __init__(self, clock: VirtualClock, answer: bytes, size: int) -> None:
        self.interface: Interface = "socket"
        self.left = b""
        self._clock = clock
        self._answer = answer
        self._size = size

    def send(self, data: bytes, deadline: Deadline) -> None:
        del data, deadline
        self.left = self._answer

    def receive(self, deadline: Deadline) -> tuple[bytes, bool]:
        if not self.left:
            self._clock.sleep_until(deadline.expires_s)
            raise DeadlineExceeded("no answer")
        piece, self.left = self.left[: self._size], self.left[self._size :]
        return piece, False

    def pending(self) -> bytes:
        return b""

    def clear(self, deadline: Deadline) -> None:
        del deadline

    def close(self) -> None:
        pass
