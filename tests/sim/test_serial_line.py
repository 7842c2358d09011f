"""RS-232 between a controller and an instrument: time, buffer, handshake, settings that do not agree."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import pytest
import pyvisa
import serial
from hypothesis import given
from hypothesis import strategies as st
from simrack.attendance import AttendedClock
from simrack.scpi import RS232
from simrack.wires import serial_backend
from simrack.wires.handshake_line import HandshakeLine, XonXoffLine
from simrack.wires.serial_line import CharacterFrame, ReceivedCharacter, heard
from simrack.wires.visa_backend import SimVisaLibrary
from simrack_tests.scpi.lamp import Lamp

from vcfbench.clock import VirtualClock

if TYPE_CHECKING:
    from collections.abc import Iterator

CHARACTER_S = 11 / 9600
"""Start, eight data, two stop bits."""


class Desk:
    """A lamp at the end of a serial line, and a clock that stops wherever something happens."""

    def __init__(self, frame: CharacterFrame | None = None, kind: type[HandshakeLine] = HandshakeLine) -> None:
        self.lamp = Lamp(RS232)
        self.line = kind(self.lamp, self.lamp.clock, frame)
        self.clock = AttendedClock(self.lamp.clock, [self.line])

    def read(self, seconds: float = 1.0) -> bytes:
        self.clock.sleep_until(self.clock.now() + seconds)
        return self.line.read(1 << 20)[0]

    def errors(self) -> list[int]:
        queue = self.lamp.engine.errors
        return [queue.pop()[0] for _ in range(len(queue))]


# --- time -------------------------------------------------------------------------------------------------


def test_an_exchange_takes_the_time_of_its_characters() -> None:
    desk = Desk()
    desk.line.write(b"VOLT?\n")
    arrived: list[tuple[float, bytes]] = []
    while (wake := desk.line.wake_at()) is not None:
        desk.clock.sleep_until(wake)
        if data := desk.line.read(100)[0]:
            arrived.append((desk.clock.now(), data))
    reply = b"+1.00000000E+00\r\n"
    assert b"".join(data for _, data in arrived) == reply
    expected = [(6 + index + 1) * CHARACTER_S for index in range(len(reply))]
    assert [instant for instant, _ in arrived] == pytest.approx(expected, rel=1e-9)


def test_a_command_acts_when_its_newline_has_arrived() -> None:
    desk = Desk(CharacterFrame(baud=300.0))
    desk.line.configure(CharacterFrame(baud=300.0), handshake=True)
    desk.line.write(b"VOLT 2\n")
    desk.clock.sleep_until(7 * 11 / 300 - 1e-6)
    assert desk.lamp.level == 1.0
    desk.clock.sleep_until(7 * 11 / 300 + 1e-6)
    assert desk.lamp.level == 2.0


@pytest.mark.parametrize(
    ("frame", "bits"),
    [
        (CharacterFrame(), 11),
        (CharacterFrame(stop_bits=1.0), 10),
        (CharacterFrame(data_bits=7, parity="even"), 11),
        (CharacterFrame(data_bits=7, parity="odd", stop_bits=1.5), 10.5),
    ],
)
def test_time_of_a_character(frame: CharacterFrame, bits: float) -> None:
    assert frame.character_s == pytest.approx(bits / 9600)


# --- buffer and handshake ---------------------------------------------------------------------------------

LONG = b"SLOW?\n" + b"VOLT 2;" * 30 + b"VOLT 3\n"
"""217 characters while the parser is busy for 0.5 s, which is 436 characters."""


def test_with_the_handshake_nothing_is_lost() -> None:
    desk = Desk()
    desk.line.write(LONG)
    desk.clock.sleep_until(0.45)
    assert desk.line.out_waiting == len(LONG) - 6 - 100
    assert not desk.line.dsr
    assert desk.lamp.level == 1.0
    assert desk.read(2.0) == b"5\r\n"
    assert desk.line.out_waiting == 0
    assert desk.line.dsr
    assert desk.lamp.level == 3.0
    assert desk.errors() == []


def test_overflow_without_handshake_is_lost_and_reported_once() -> None:
    desk = Desk()
    desk.line.configure(CharacterFrame(), handshake=False)
    desk.line.write(LONG)
    assert desk.read(2.0) == b"5\r\n"
    assert desk.errors() == [521]
    desk.line.write(b"\nVOLT?\n")
    assert desk.read() == b"+2.00000000E+00\r\n"
    assert desk.errors() == [-109]  # 110 characters: 15 times VOLT 2, then VOLT and an end


def test_a_hundred_characters_wait_without_any_handshake() -> None:
    desk = Desk()
    desk.line.configure(CharacterFrame(), handshake=False)
    desk.line.write(b"SLOW?\n" + b"VOLT 2;" * 13 + b"VOLT 3\n")
    assert desk.read(2.0) == b"5\r\n"
    assert (desk.lamp.level, desk.errors()) == (3.0, [])


def test_the_buffer_fills_only_while_the_parser_is_busy() -> None:
    desk = Desk()
    desk.line.configure(CharacterFrame(), handshake=False)
    desk.line.write(b"VOLT 2;" * 100 + b"VOLT 3\n")
    assert desk.read(2.0) == b""
    assert (desk.lamp.level, desk.errors()) == (3.0, [])


def test_an_answer_is_to_be_read_before_more_is_sent() -> None:
    """DTR is false from the end of the query until the answer is out; the handshake makes the next query wait."""
    desk = Desk()
    desk.line.write(b"VOLT?\n*OPC?\n")
    desk.clock.sleep_until(10 * CHARACTER_S)
    assert not desk.line.dsr
    assert desk.line.out_waiting == 6
    assert desk.read() == b"+1.00000000E+00\r\n1\r\n"


def test_dtr_of_the_controller_holds_the_answer_back() -> None:
    desk = Desk()
    desk.line.dtr = False
    desk.line.write(b"VOLT?\n")
    assert desk.read(5.0) == b""
    assert not desk.line.dsr
    desk.line.dtr = True
    assert desk.read() == b"+1.00000000E+00\r\n"
    assert desk.line.dsr


def test_control_c_breaks_the_deadlock_of_two_handshakes() -> None:
    desk = Desk()
    desk.line.dtr = False
    desk.line.write(b"VOLT?\n")
    desk.read()
    desk.line.configure(CharacterFrame(), handshake=False)
    desk.line.write(b"\x03")
    desk.read()
    desk.line.dtr = True
    assert desk.read() == b""
    assert desk.lamp.aborted == 1
    desk.line.write(b"*OPC?\n")
    assert desk.read() == b"1\r\n"


def test_a_trigger_reaches_a_parser_that_waits_for_one() -> None:
    desk = Desk()
    desk.line.write(b"ARM\n*TRG\nVOLT?\n")
    assert desk.read(0.5) == b""
    assert desk.lamp.triggers == 1
    assert desk.read() == b"+1.00000000E+00\r\n"


@given(st.lists(st.sampled_from(["VOLT?", "VOLT 2", "SLOW?", "*OPC?", "FOO", "*IDN?"]), max_size=12), st.booleans())
def test_with_the_handshake_the_line_says_what_the_instrument_says(messages: list[str], whole: bool) -> None:  # noqa: FBT001
    desk, near = Desk(), Lamp(RS232)
    expected = b""
    for message in messages:
        near.write(message.encode() + b"\n")
        near.clock.sleep_until(near.clock.now() + 1.0)
        expected += near.read(1000)[0]
        desk.line.write(message.encode() + b"\n")
        if not whole:
            desk.clock.sleep_until(desk.clock.now() + 0.01)
    assert desk.read(30.0) == expected
    assert len(desk.lamp.engine.errors) == len(near.engine.errors)


# --- a handshake by characters ----------------------------------------------------------------------------


@pytest.fixture
def keithley() -> Iterator[Desk]:
    desk = Desk(CharacterFrame(115_200.0), XonXoffLine)
    serial_backend.register("keithley", desk.line, desk.clock)
    yield desk
    serial_backend.unregister("keithley")


LONGER = b"SLOW?\n" + b"VOLT 2;" * 400 + b"VOLT 3\nVOLT?\n"
"""More than the input queue holds, behind what keeps the parser busy for half a second."""


def test_pyserial_heeds_xoff_and_nothing_is_lost(keithley: Desk) -> None:
    with serial.serial_for_url("sim://keithley", 115_200, stopbits=2, xonxoff=True, timeout=9.0) as port:
        port.write(LONGER)
        keithley.clock.sleep_until(0.4)
        assert 2048 * 3 // 4 <= len(keithley.line._buffer) < 2048
        assert port.out_waiting > 1000
        assert port.read_until(b"\n") == b"5\r\n"
        assert port.read_until(b"\n") == b"+3.00000000E+00\r\n"
        assert port.in_waiting == 0
    assert keithley.errors() == []


def test_program_that_ignores_handshake_loses_characters(keithley: Desk) -> None:
    with serial.serial_for_url("sim://keithley", 115_200, stopbits=2, timeout=9.0) as port:
        port.write(LONGER)
        assert port.read_until(b"\n") == b"\x135\r\n"
        assert port.read(1) == b"\x11"
    assert 521 in keithley.errors()


@given(st.integers(0, 3000), st.integers(0, 1200))
def test_it_goes_on_whenever_the_parser_does(more: int, later: int) -> None:
    desk = Desk(kind=XonXoffLine)
    desk.line.configure(CharacterFrame(), handshake=False, xonxoff=True)
    desk.line.write(b"SLOW?\n" + b" " * more)
    desk.clock.sleep_until(later * CHARACTER_S)
    desk.line.write(b"SLOW?\n" + b" " * 3000 + b"\nVOLT?\n")
    assert desk.read(20.0) == b"5\r\n5\r\n+1.00000000E+00\r\n"


@pytest.mark.usefixtures("keithley")
def test_xoff_of_the_controller_holds_the_answer_back() -> None:
    with serial.serial_for_url("sim://keithley", 115_200, stopbits=2, xonxoff=True, timeout=1.0) as port:
        port.write(b"\x13VOLT?\n")
        assert port.read(1) == b""
        port.write(b"\x11")
        assert port.read_until(b"\n") == b"+1.00000000E+00\r\n"


# --- settings that do not agree ---------------------------------------------------------------------------


def test_one_stop_bit_or_two_are_all_the_same() -> None:
    desk = Desk()
    desk.line.configure(CharacterFrame(stop_bits=1.0), handshake=True)
    desk.line.write(b"VOLT?\n")
    assert desk.read() == b"+1.00000000E+00\r\n"
    assert desk.errors() == []


def test_eight_bits_to_seven_and_parity() -> None:
    """The eighth bit, 0, is taken for the parity bit: right for characters with an even number of ones."""
    seven = CharacterFrame(data_bits=7, parity="even")
    found = heard(b"ACGa", CharacterFrame(), seven)
    assert found == [
        ReceivedCharacter(65, 0),
        ReceivedCharacter(67, 513),
        ReceivedCharacter(71, 0),
        ReceivedCharacter(97, 513),
    ]


def test_seven_bits_and_parity_to_eight() -> None:
    """The parity bit is taken for the eighth: characters with an odd number of ones come as those above 127."""
    found = heard(b"ACGa", CharacterFrame(data_bits=7, parity="even"), CharacterFrame())
    assert found == [
        ReceivedCharacter(65, 0),
        ReceivedCharacter(67 + 128, 0),
        ReceivedCharacter(71, 0),
        ReceivedCharacter(97 + 128, 0),
    ]


def test_even_to_odd_is_an_error_every_time() -> None:
    found = heard(b"VOLT?", CharacterFrame(data_bits=7, parity="even"), CharacterFrame(data_bits=7, parity="odd"))
    assert found == [ReceivedCharacter(byte, 513) for byte in b"VOLT?"]


def test_a_break_in_the_middle_of_a_slow_character() -> None:
    """NUL at 4800 is low for 18 bits of 9600: no stop bit where one is due."""
    assert heard(b"\x00", CharacterFrame(baud=4800.0), CharacterFrame())[0] == ReceivedCharacter(0, 511)


def test_twice_the_speed_is_heard_as_something_else() -> None:
    """U is 1010...: at twice the speed every second bit of start, data, stop is seen."""
    assert [each.byte for each in heard(b"UUUU", CharacterFrame(baud=19200.0), CharacterFrame())] != [85] * 4


@given(st.binary(max_size=40), st.sampled_from([0.97, 0.99, 1.01, 1.03]))
def test_speeds_may_differ_by_a_little(data: bytes, off: float) -> None:
    """The last bit is sampled after 9.5 bits: 5 % are half of one."""
    assert [each.byte for each in heard(data, CharacterFrame(baud=9600 * off), CharacterFrame())] == list(data)


FRAMES = st.builds(
    CharacterFrame,
    st.sampled_from([300.0, 1200.0, 2400.0, 4800.0, 9600.0, 19200.0]),
    st.sampled_from([7, 8]),
    st.sampled_from(["none", "even", "odd"]),
    st.sampled_from([1.0, 2.0]),
)


@given(st.binary(max_size=30), FRAMES, FRAMES)
def test_any_settings_are_survived(data: bytes, controller: CharacterFrame, instrument: CharacterFrame) -> None:
    desk = Desk(instrument)
    desk.line.configure(controller, handshake=False)
    desk.line.write(data)
    desk.read(30.0)
    desk.line.configure(instrument, handshake=True)
    desk.line.write(b"\x03*CLS\n*OPC?\n")
    assert desk.read(10.0)[-3:] == b"1\r\n"


@given(st.binary(max_size=40), FRAMES)
def test_equal_settings_bring_every_byte(data: bytes, frame: CharacterFrame) -> None:
    """The sampling agrees with the short cut for equal ends: one stop bit more makes them unequal."""
    other = CharacterFrame(frame.baud, frame.data_bits, frame.parity, 3.0)
    assert heard(data, other, frame) == heard(data, frame, frame)


def test_the_wrong_speed_queues_framing_errors_and_nothing_is_answered() -> None:
    desk = Desk()
    desk.line.configure(CharacterFrame(baud=4800.0), handshake=True)
    desk.line.write(b"*IDN?\n")
    assert desk.read() == b""
    assert 511 in desk.errors()


def test_a_break_is_a_framing_error() -> None:
    desk = Desk()
    desk.line.send_break()
    desk.line.write(b"VOLT?\n")
    assert desk.read() == b"+1.00000000E+00\r\n"
    assert desk.errors() == [511]


# --- what carries it --------------------------------------------------------------------------------------


@pytest.fixture
def desk() -> Iterator[Desk]:
    desk = Desk()
    serial_backend.register("desk", desk.line, desk.clock)
    SimVisaLibrary.register("serial-desk", {"ASRL7::INSTR": desk.line}, desk.clock)
    yield desk
    SimVisaLibrary.unregister("serial-desk")
    serial_backend.unregister("desk")


def test_pyserial_sees_the_pins_and_the_time(desk: Desk) -> None:
    with serial.serial_for_url("sim://desk", baudrate=9600, stopbits=2, dsrdtr=True, timeout=1.0) as port:
        port.write(b"VOLT?\n")
        assert port.out_waiting == 6
        port.flush()
        assert (port.out_waiting, port.dsr) == (0, False)
        assert port.read_until(b"\n") == b"+1.00000000E+00\r\n"
        assert desk.clock.now() == pytest.approx(23 * CHARACTER_S)
        port.dtr = False
        port.write(b"VOLT?\n")
        assert port.read(1) == b""
        port.write(b"VOLT?\n")
        with pytest.raises(serial.SerialException, match="DTR is false"):
            port.flush()
        port.reset_output_buffer()
        port.dtr = True
        assert port.read_until(b"\n") == b"+1.00000000E+00\r\n"
        assert port.dsr


def test_pyserial_settings_and_breaks_reach_the_line(desk: Desk) -> None:
    with serial.serial_for_url("sim://desk", bytesize=7, parity="O", timeout=1.0) as port:
        port.write(b"A")
        port.read(1)
        port.bytesize, port.parity = 8, "N"
        port.break_condition = True
        port.break_condition = False
    assert desk.errors() == [511]


def test_visa_sees_them_too(desk: Desk) -> None:
    manager = pyvisa.ResourceManager("serial-desk@vcfbench")
    session: Any = manager.open_resource("ASRL7::INSTR", read_termination="\r\n", write_termination="\n")
    session.flow_control = pyvisa.constants.ControlFlow.dtr_dsr
    assert session.query("VOLT?") == "+1.00000000E+00"
    assert desk.clock.now() == pytest.approx(6 * 10 / 9600 + 17 * CHARACTER_S)  # VISA sends one stop bit
    assert session.get_visa_attribute(pyvisa.constants.ResourceAttribute.asrl_dsr_state) == 1
    session.baud_rate = 300
    with pytest.raises(pyvisa.VisaIOError, match="TMO"):
        session.query("VOLT?")
    assert 511 in desk.errors()
    session.close()
    manager.close()


def test_visa_without_flow_control_loses_what_does_not_fit(desk: Desk) -> None:
    manager = pyvisa.ResourceManager("serial-desk@vcfbench")
    session: Any = manager.open_resource("ASRL7::INSTR", read_termination="\r\n", write_termination="\n")
    session.write("SLOW?")
    session.write("VOLT 2;" * 30)
    assert session.read() == "5"
    desk.clock.sleep_until(desk.clock.now() + 1.0)
    assert 521 in desk.errors()
    session.close()
    manager.close()


def test_a_plain_clock_will_do() -> None:
    clock = VirtualClock()
    lamp = Lamp(RS232)
    lamp.clock = lamp.engine.clock = clock
    line = HandshakeLine(lamp, clock)
    line.write(b"VOLT?\n")
    clock.sleep_until(1.0)
    line.read(1)
    clock.sleep_until(2.0)
    assert line.read(100)[0].endswith(b"E+00\r\n")
