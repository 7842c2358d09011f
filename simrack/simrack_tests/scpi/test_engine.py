"""Message exchange, queues, busy time and status, in simulated time."""

from __future__ import annotations

import pytest
from hypothesis import example, given
from hypothesis import strategies as st
from simrack.scpi import GPIB, LAN, RS232, USB, Dialect, Interface
from simrack.serve.embodied import HISLIP, SOCKET, VXI11

from simrack_tests.instruments.conversation import Conversation
from simrack_tests.scpi.lamp import Lamp


@pytest.fixture
def lamp() -> Lamp:
    return Lamp()


@pytest.fixture
def conversation(lamp: Lamp) -> Conversation:
    return Conversation(lamp, lamp.clock)


@pytest.mark.parametrize("message", [b"VOLT?\n", b"VOLT?\r\n", b" volt? \n", b"VOLT?;\n"])
def test_terminators(lamp: Lamp, message: bytes) -> None:
    lamp.write(message)
    assert lamp.read(100) == (b"+1.00000000E+00\n", True)


def test_end_is_a_terminator(lamp: Lamp) -> None:
    lamp.write(b"VOLT?", end=True)
    assert lamp.read(100) == (b"+1.00000000E+00\n", True)


def test_serial_replies_end_with_both() -> None:
    lamp = Lamp(RS232)
    lamp.write(b"VOLT?\n")
    assert lamp.read(100)[0] == b"+1.00000000E+00\r\n"


@given(st.lists(st.integers(1, 9), max_size=20))
def test_a_message_may_come_in_pieces(cuts: list[int]) -> None:
    lamp = Lamp(LAN)
    message = b"VOLT 2;DATA #13a\nb;:TEXT 'x#9';:VOLT?\nVOLT?\n"
    for size in [*cuts, len(message)]:
        lamp.write(message[:size])
        message = message[size:]
    assert lamp.read(100)[0] + lamp.read(100)[0] == b"+2.00000000E+00\n" * 2
    assert lamp.heard == {"data": (b"a\nb",), "text": ("x#9",)}
    assert Conversation(lamp, lamp.clock).errors() == []


def test_a_reply_may_be_read_in_pieces(lamp: Lamp) -> None:
    lamp.write(b"*IDN?\n")
    pieces = [lamp.read(7), lamp.read(7), lamp.read(7)]
    assert pieces == [(b"MAKER,L", False), (b"AMP,0,1", False), (b".0\n", True)]


def test_interrupted(lamp: Lamp, conversation: Conversation) -> None:
    lamp.write(b"VOLT?\n")
    assert conversation.ask("*IDN?") == "MAKER,LAMP,0,1.0"
    assert conversation.errors() == [-410]
    assert int(conversation.ask("*ESR?") or "0") & 4


@pytest.mark.parametrize("interface", [LAN, RS232])
def test_a_stream_sends_every_answer(interface: object) -> None:
    lamp = Lamp(interface)  # type: ignore[arg-type]
    lamp.write(b"VOLT?\n*OPC?\n")
    assert [lamp.read(100)[0].strip() for _ in range(3)] == [b"+1.00000000E+00", b"1", b""]
    assert Conversation(lamp, lamp.clock).errors() == []


def test_unterminated_once(lamp: Lamp, conversation: Conversation) -> None:
    for _ in range(3):
        assert lamp.read(100) == (b"", False)
    assert conversation.errors() == [-420]


def test_reading_while_busy_is_no_error(lamp: Lamp, conversation: Conversation) -> None:
    lamp.write(b"SLOW?\n")
    assert lamp.read(100) == (b"", False)
    assert conversation.read() == "5"
    assert conversation.errors() == []


def test_identity_must_be_the_last_query(conversation: Conversation) -> None:
    assert conversation.ask("*IDN?;VOLT?") == "MAKER,LAMP,0,1.0"
    assert conversation.errors() == [-440]
    assert conversation.ask("VOLT?;*IDN?") == "+1.00000000E+00;MAKER,LAMP,0,1.0"
    assert conversation.errors() == []


def test_a_busy_parser_lets_messages_wait(lamp: Lamp, conversation: Conversation) -> None:
    lamp.write(b"SLOW?;VOLT 2\n")
    assert lamp.wake_at() == 0.5
    assert lamp.level == 1.0
    assert conversation.read() == "5"
    assert lamp.clock.now() == 0.5
    assert lamp.level == 2.0


def test_waiting_parser_accepts_only_trigger(lamp: Lamp, conversation: Conversation) -> None:
    lamp.write(b"ARM\n")
    lamp.write(b"*TRG\n")
    lamp.write(b"VOLT?\n")
    assert lamp.triggers == 1
    assert lamp.read(100) == (b"", False)
    assert conversation.read() == "+1.00000000E+00"
    assert lamp.clock.now() == 1.0


def test_a_group_trigger_gets_through_too(lamp: Lamp, conversation: Conversation) -> None:
    lamp.write(b"ARM;VOLT 2\n")
    assert lamp.wake_at() is None
    lamp.trigger()
    conversation.settle()
    assert (lamp.triggers, lamp.level) == (1, 2.0)


def test_a_group_trigger_within_a_message_is_refused(lamp: Lamp, conversation: Conversation) -> None:
    lamp.write(b"VOLT 2")
    lamp.trigger()
    lamp.write(b"\n")
    assert conversation.errors() == [-105]


def test_device_clear_drops_buffers_and_keeps_settings(lamp: Lamp, conversation: Conversation) -> None:
    lamp.write(b"VOLT 2;*ESE 60;:FOO\n")
    lamp.write(b"SLOW?\n")
    lamp.write(b"VOLT 3")
    lamp.clear()
    assert lamp.wake_at() is None
    assert lamp.aborted == 1
    assert conversation.ask("VOLT?;*ESE?") == "+2.00000000E+00;+60"
    assert conversation.errors() == [-113]


def test_control_c_clears_on_rs232() -> None:
    lamp = Lamp(RS232)
    lamp.write(b"SLOW?\nVOLT 5\n")
    lamp.write(b"\x03VOLT?\n")
    assert lamp.read(100)[0] == b"+1.00000000E+00\r\n"


@pytest.mark.parametrize(("depth", "words"), [(20, "Too many errors"), (30, "Queue overflow")])
def test_queue_overflow(depth: int, words: str) -> None:
    lamp = Lamp(dialect=Dialect(queue_depth=depth, words={-350: words}))
    conversation = Conversation(lamp, lamp.clock)
    for _ in range(depth + 3):
        conversation.write("FOO")
    entries = [conversation.ask("SYST:ERR?") for _ in range(depth + 1)]
    assert entries[: depth - 1] == ['-113,"Undefined header"'] * (depth - 1)
    assert entries[depth - 1 :] == [f'-350,"{words}"', '+0,"No error"']


def test_errors_outlive_reset_and_not_clear_status(conversation: Conversation) -> None:
    conversation.write("FOO;*RST")
    conversation.write("*RST")
    assert conversation.ask("SYST:ERR?") == '-113,"Undefined header"'
    conversation.write("FOO")
    conversation.write("*CLS")
    assert conversation.errors() == []


@pytest.mark.parametrize(("message", "bit"), [("FOO", 32), ("VOLT 9", 16)])
def test_standard_event_status(conversation: Conversation, message: str, bit: int) -> None:
    assert conversation.ask("*ESR?") == "+128"
    conversation.write(message)
    assert conversation.ask("*ESR?") == f"+{bit}"
    assert conversation.ask("*ESR?") == "+0"


def test_status_byte_and_service_request(lamp: Lamp, conversation: Conversation) -> None:
    conversation.write("*CLS;*ESE 32;*SRE 32")
    assert lamp.status_byte() == 0
    conversation.write("FOO")
    assert lamp.requests_service()
    assert lamp.status_byte() == 32 + 64
    assert lamp.status_byte() == 32
    assert conversation.ask("*STB?") == "+96"
    assert conversation.ask("*STB?") == "+96"
    conversation.ask("*ESR?")
    assert conversation.ask("*STB?") == "+0"


def test_message_available(lamp: Lamp) -> None:
    lamp.write(b"VOLT?\n")
    assert lamp.status_byte() == 16
    lamp.read(100)
    assert lamp.status_byte() == 0


def test_sre_has_no_bit_6(conversation: Conversation) -> None:
    assert conversation.ask("*SRE 255;*SRE?") == "+191"


def test_questionable_chain(lamp: Lamp, conversation: Conversation) -> None:
    conversation.write("STAT:QUES:ENAB 8")
    lamp.questionable.set_condition(8)
    lamp.questionable.set_condition(0)
    assert lamp.status_byte() == 8
    assert conversation.ask("STAT:QUES:COND?;EVEN?;ENAB?") == "+0;+8;+8"
    assert conversation.ask("STAT:QUES?") == "+0"
    assert lamp.status_byte() == 0


def test_operation_complete(lamp: Lamp, conversation: Conversation) -> None:
    conversation.write("*CLS;*OPC")
    assert conversation.ask("*ESR?") == "+1"
    lamp.done_at_s = 2.0
    conversation.write("*OPC")
    assert conversation.ask("*ESR?") == "+0"
    assert conversation.ask("*OPC?") == "1"
    assert lamp.clock.now() == 2.0
    assert conversation.ask("*ESR?") == "+1"


def test_wait_holds_what_follows(lamp: Lamp, conversation: Conversation) -> None:
    lamp.done_at_s = 3.0
    conversation.write("*WAI;VOLT 4")
    assert lamp.level == 1.0
    conversation.settle()
    assert (lamp.level, lamp.clock.now()) == (4.0, 3.0)


def test_power_on_status_clear_flag(conversation: Conversation) -> None:
    assert conversation.ask("*PSC?;*PSC 0;*PSC?") == "1;0"


@pytest.mark.parametrize("pieces", [1, 50])
def test_a_message_beyond_the_buffer_is_one_error(pieces: int) -> None:
    lamp = Lamp(LAN, Dialect(input_limit=100))
    for _ in range(pieces):
        lamp.write(b"VOLT 3;" * (1000 // pieces))
    lamp.write(b"\nVOLT?\n")
    assert lamp.read(100)[0] == b"+1.00000000E+00\n"
    assert Conversation(lamp, lamp.clock).errors() == [521]


@given(st.binary(max_size=60))
def test_noise_is_refused_and_the_parser_survives(noise: bytes) -> None:
    lamp = Lamp()
    lamp.write(noise, end=True)
    lamp.clock.sleep_until(100.0)
    lamp.clear()
    lamp.write(b"*CLS\n")
    assert Conversation(lamp, lamp.clock).ask("*IDN?") == "MAKER,LAMP,0,1.0"


def deadlocking(interface: Interface = GPIB) -> Conversation:
    lamp = Lamp(interface, Dialect(input_buffer=100, output_queue=200))
    return Conversation(lamp, lamp.clock)


def test_both_buffers_full_is_a_deadlock() -> None:
    """The 13th answer of 16 characters does not fit any more, while 180 of the message are still to come."""
    talk = deadlocking()
    talk.write("VOLT 3;" + "VOLT?;" * 20 + "VOLT 4;" * 20)
    assert not talk.device.status_byte() & 16
    assert talk.errors() == [-430]
    assert talk.ask("VOLT?") == "+4.00000000E+00"


def test_rest_of_message_after_deadlock_is_not_answered() -> None:
    talk = deadlocking()
    talk.write("*CLS;" + "VOLT?;" * 60)
    assert not talk.device.status_byte() & 16
    assert talk.ask("*ESR?") == "+4"
    assert talk.errors() == [-430]


@pytest.mark.parametrize("message", ["VOLT?;" * 12, "VOLT?;" * 28, "VOLT 4;" * 100 + "VOLT?"])
def test_one_full_buffer_is_no_deadlock(message: str) -> None:
    """The 28 answers do not fit, but by then the rest of the message is in the input buffer."""
    talk = deadlocking()
    assert len((talk.ask(message) or "").split(";")) == message.count("?")
    assert talk.errors() == []


def test_message_of_usual_buffer_size_makes_no_deadlock() -> None:
    lamp = Lamp(GPIB)
    lamp.write(b"VOLT?;" * 2000 + b"VOLT?\n")  # 32 kB of answers, 12 kB of questions
    assert lamp.read(1 << 16)[0].count(b"+1.00000000E+00") == 2001
    assert Conversation(lamp, lamp.clock).errors() == []


@pytest.mark.parametrize("interface", [GPIB, USB, VXI11])
def test_where_answers_are_fetched_there_are_deadlocks(interface: Interface) -> None:
    talk = deadlocking(interface)
    talk.write("VOLT?;" * 60)
    assert talk.errors() == [-430]


@pytest.mark.parametrize("interface", [LAN, RS232, SOCKET, HISLIP])
def test_a_stream_is_never_deadlocked(interface: Interface) -> None:
    talk = deadlocking(interface)
    assert len((talk.ask("VOLT?;" * 60) or "").split(";")) == 60
    assert talk.errors() == []


@pytest.mark.parametrize(("takes_blocks", "numbers"), [(False, [-161]), (True, [])])
def test_only_who_has_blocks_waits_for_the_end_of_one(takes_blocks: bool, numbers: list[int]) -> None:  # noqa: FBT001
    lamp = Lamp(LAN, Dialect(takes_blocks=takes_blocks))
    lamp.write(b"DATA #14ab\n")
    lamp.write(b"c\n" if takes_blocks else b"")
    assert Conversation(lamp, lamp.clock).errors() == numbers


_SAID = (
    *(b"VOLT?\n", b"VOLT 2\n", b"VOLT 7\n", b"VOLT:STEP?\n", b"TEXT?\n", b"DATA?\n", b"CHAN2:LAB?\n", b"SLOW?\n"),
    *(b"VOLT?;TEXT?\n", b"NONS?\n", b"ARM\n", b"*TRG\n", b"*IDN?\n", b"*ESR?\n", b"*STB?\n", b"*OPC?\n", b"*OPC\n"),
    *(b"*SRE 48\n", b"*SRE 0\n", b"*ESE 255\n", b"*CLS\n", b"SYST:ERR?\n", b"VOLT\n", b"STAT:QUES?\n", b"TEXT 'a'; "),
)
_DONE = ("wake_at", "status_byte", "requests_service", 0.3, 1.0)


@given(
    st.sampled_from([GPIB, LAN, SOCKET, RS232, VXI11]),
    st.lists(st.one_of(st.sampled_from(_SAID), st.sampled_from(_DONE)), max_size=30),
)
@example(SOCKET, [b"*OPC\n", b"VOLT?\n", 1.0, b"*ESR?\n"])
@example(SOCKET, [b"*ESE 255\n", b"*SRE 48\n", b"NONS?\n", "status_byte", b"*ESR?\n", b"NONS?\n"])
@example(GPIB, [b"SLOW?\n", 1.0, "wake_at", b"VOLT?\n"])
@example(LAN, [b"TEXT 'a'; ", b"VOLT?\n"])
def test_an_answer_in_one_is_what_is_written_and_read(interface: Interface, done: list[bytes | str | float]) -> None:
    short, long = Lamp(interface), Lamp(interface)
    for lamp in (short, long):
        for question in (each for each in _SAID if b"?" in each):
            lamp.write(question)
            lamp.clear()
        lamp.done_at_s = 0.5
    for each in [*done, "status_byte"]:
        if isinstance(each, float):
            for lamp in (short, long):
                lamp.clock.sleep_until(lamp.clock.now() + each)
        elif isinstance(each, str):
            assert getattr(short.engine, each)() == getattr(long.engine, each)()
        else:
            long.write(each)
            answer = short.engine.answer(each)
            if answer is None:
                short.write(each)
            assert ((answer, True) if answer else short.read(100)) == long.read(100)
    for lamp in (short, long):
        lamp.clear()
    assert short.heard == long.heard
    assert Conversation(short, short.clock).errors() == Conversation(long, long.clock).errors()


@pytest.mark.parametrize(("message", "answer"), [(b"VOLT?\n", b"+1.00000000E+00\n"), (b"VOLT 2\n", None)])
def test_a_known_question_has_its_answer_in_one(lamp: Lamp, message: bytes, answer: bytes | None) -> None:
    assert lamp.engine.answer(message) is None
    lamp.write(message)
    lamp.read(100)
    assert lamp.engine.answer(message) == answer
