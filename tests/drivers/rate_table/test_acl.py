"""The ACL dialect and the rate-table driver against the ACL manual (TM-8004-C)."""

from __future__ import annotations

import math
import struct
from typing import TYPE_CHECKING, Literal

import pytest
from hypothesis import given
from hypothesis import strategies as st
from msgspec.structs import replace

from vcfbench.clock import Deadline
from vcfbench.drivers.rate_table.acl import AclDialect, detect_header
from vcfbench.drivers.rate_table.dialect import TableSettings
from vcfbench.drivers.rate_table.driver import RateTableDriver
from vcfbench.errors import (
    DeadlineExceeded,
    FramingError,
    InstrumentError,
    InterlockError,
    LimitError,
    OutOfSync,
)
from vcfbench.testing import Exchange, ScriptedWire, expected_exchange, over_serial

if TYPE_CHECKING:
    from collections.abc import Callable

    from vcfbench.clock import Clock, VirtualClock
    from vcfbench.drivers.rate_table.acl import Header

IDENTITY = "Acutronic R&D USA,Acutrol3000,0,A8800-001-01.000-a"
LIMITS = TableSettings(max_rate_deg_s=100.0, max_acceleration_deg_s2=50.0)
IDN: Exchange = ("*IDN?", IDENTITY)
FINE: Exchange = (":Status:STB?", "0")
STILL: Exchange = (":Read:Rate? 1", "0.00001")


def table(sign: Literal[1, -1] = 1, header: Header = "none") -> Callable[[ScriptedWire, VirtualClock], RateTableDriver]:
    return over_serial(
        lambda line: RateTableDriver(
            line, AclDialect(TableSettings(reply_header=header)), replace(LIMITS, axis_sign=sign)
        )
    )


ENABLING: list[Exchange] = [
    (":Utility:Lockout ON", None),
    FINE,
    (":Interlock? 1", "Open"),
    (":Status:CSR? A1STATE", "32"),
    *[STILL] * 3,
    (":Limit:Rate R,1,100;Vtrip R,1,110;Acceleration R,1,50", None),
    FINE,
    (":Demand:Rate 1,0;:Mode:Rate 1", None),
    FINE,
    (":Interlock:Close 1", None),
    FINE,
    (":Status:CSR? A1STATE", "0"),
    (":Status:CSR? A1STATE", "17"),
]
TURNING: list[Exchange] = [(":Limit:Acceleration R,1,20;:Demand:Rate 1,10.5", None), FINE]
RELEASING: list[Exchange] = [
    (":Mode:Off 1", None),
    FINE,
    (":Interlock:Open 1", None),
    FINE,
    (":Status:CSR? A1STATE", "32"),
]
UNLOCKING: list[Exchange] = [(":Utility:Lockout OFF", None), FINE]


def test_demand_zero_precedes_mode_and_mode_precedes_servo() -> None:
    with expected_exchange(table(), [IDN, *ENABLING]) as driver:
        driver.enable()


def test_a_rate_goes_with_its_acceleration_in_one_message() -> None:
    exchanges = [*TURNING, (":Status:CSR? A1DYN,9", "0"), (":Status:CSR? A1DYN,9", "1"), (":Read:Rate? 1", "10.49999")]
    with expected_exchange(table(), [IDN, *ENABLING, *exchanges]) as driver:
        driver.enable()
        driver.set_rate(10.5, 20.0)
        assert not driver.at_rate()
        assert driver.at_rate()
        assert driver.rate_deg_s() == 10.49999


def test_acknowledgements_without_header_may_come_or_not() -> None:
    exchanges: list[Exchange] = [
        (":Utility:Lockout ON", "OK"),
        FINE,
        (":Interlock? 1", "Fault"),
        (":Status:CSR? A1STATE", b"\r\n16\r\n"),
        (":Status:CSR? A1SWFLT", b"OK\r\n6\r\n"),
        (":Status:CSR? A1INTLK", "512"),
    ]
    with expected_exchange(table(), [IDN, *exchanges]) as driver:
        with pytest.raises(InterlockError) as caught:
            driver.enable()
        assert str(caught.value) == (
            "rate_table at script://: over-rate trip, tracking error, master interlock (disabled at the front panel); "
            "remove the cause, then clear the fault"
        )


def test_an_axis_of_the_other_sign() -> None:
    exchanges: list[Exchange] = [
        (":Limit:Acceleration R,1,20;:Demand:Rate 1,-10", None),
        FINE,
        (":Read:Rate? 1", "-9.99999"),
        (":Read:Position? 1", "123.45678"),
    ]
    with expected_exchange(table(-1), [IDN, *ENABLING, *exchanges]) as driver:
        driver.enable()
        driver.set_rate(10.0, 20.0)
        assert driver.rate_deg_s() == 9.99999
        assert driver.angle_deg() == -123.45678


@given(st.floats().filter(lambda r: not abs(r) <= 100.0), st.just(20.0))
def test_rates_beyond_the_limit_are_not_sent(rate: float, acceleration: float) -> None:
    with expected_exchange(table(), [IDN]) as driver, pytest.raises(LimitError):
        driver.set_rate(rate, acceleration)


@pytest.mark.parametrize("acceleration", [0.0, -1.0, 50.1, math.inf, math.nan])
def test_accelerations_that_could_not_be_taken_back_are_not_sent(acceleration: float) -> None:
    with expected_exchange(table(), [IDN]) as driver:
        with pytest.raises(LimitError):
            driver.set_rate(10.0, acceleration)
        with pytest.raises(LimitError):
            driver.stop(acceleration)


def test_no_demand_waits_for_the_servo() -> None:
    with (
        expected_exchange(table(), [IDN]) as driver,
        pytest.raises(InterlockError, match="servo is open, nothing was sent"),
    ):
        driver.set_rate(1.0, 1.0)


def test_a_table_found_turning_is_not_started() -> None:
    exchanges = [*ENABLING[:4], (":Read:Rate? 1", "42.0")]
    with (
        expected_exchange(table(), [IDN, *exchanges]) as driver,
        pytest.raises(InterlockError, match="found turning at 42 deg/s"),
    ):
        driver.enable()


def test_a_turning_table_is_not_disabled() -> None:
    exchanges = [*ENABLING, *TURNING]
    with expected_exchange(table(), [IDN, *exchanges]) as driver:
        driver.enable()
        driver.set_rate(10.5, 20.0)
        with pytest.raises(InterlockError, match=r"was told 10\.5 deg/s"):
            driver.disable()


def test_disabling_holds_and_opens() -> None:
    with expected_exchange(table(), [IDN, *[STILL] * 3, *RELEASING]) as driver:
        driver.disable()


def test_a_refusal_is_raised_with_the_table_s_words() -> None:
    exchanges: list[Exchange] = [
        TURNING[0],
        (":Status:STB?", "128"),
        (":Status:MSG? QERROR", "-222 data out of range"),
        FINE,
    ]
    with expected_exchange(table(), [IDN, *ENABLING, *exchanges]) as driver:
        driver.enable()
        with pytest.raises(InstrumentError, match="rate_table at script://: refused with -222 data out of range"):
            driver.set_rate(10.5, 20.0)


def test_a_question_is_asked_again_a_motion_command_is_not() -> None:
    exchanges: list[Exchange] = [
        (":Read:Rate? 1", None),
        IDN,
        (":Status:STB?", "0"),
        (":Read:Rate? 1", "1.5"),
        (":Read:Rate? 1", "1.5.5"),
        *(IDN, FINE),
        (":Read:Rate? 1", "2.5"),
        TURNING[0],
        (":Status:STB?", None),
    ]
    with expected_exchange(table(), [IDN, *ENABLING, *exchanges]) as driver:
        driver.enable()
        assert driver.rate_deg_s() == 1.5
        assert driver.rate_deg_s() == 2.5
        with pytest.raises(DeadlineExceeded):
            driver.set_rate(10.5, 20.0)


def test_invalid_number_is_error_and_not_rest() -> None:
    with (
        expected_exchange(table(), [IDN, (":Read:Rate? 1", "?"), IDN, FINE, (":Read:Rate? 1", "?")]) as driver,
        pytest.raises(FramingError),
    ):
        driver.rate_deg_s()


def test_a_binary_answer_is_refused() -> None:
    binary: Exchange = (":Read:Rate? 1", b"#14\x00\x00\x80?\n")
    with (
        expected_exchange(table(), [IDN, binary, IDN, FINE, binary]) as driver,
        pytest.raises(FramingError, match="binary"),
    ):
        driver.rate_deg_s()


def test_stop_is_repeated() -> None:
    stopping: Exchange = (":Limit:Acceleration R,1,20;:Demand:Rate 1,0", None)
    exchanges: list[Exchange] = [stopping, (":Status:STB?", None), IDN, FINE, stopping, FINE]
    with expected_exchange(table(), [IDN, *exchanges]) as driver:
        driver.stop(20.0)


def test_a_late_answer_is_not_taken_for_another() -> None:
    exchanges: list[Exchange] = [
        (":Read:Rate? 1", None),
        (b"*IDN?\n", b"99.9\n" + IDENTITY.encode() + b"\n"),
        (":Status:STB?", "0"),
        (":Read:Rate? 1", "0.5"),
    ]
    with expected_exchange(table(), [IDN, *exchanges]) as driver:
        assert driver.rate_deg_s() == 0.5


def test_answers_that_stay_away_close_the_line() -> None:
    with (
        expected_exchange(table(), [IDN, (":Read:Rate? 1", None), ("*IDN?", None)]) as driver,
        pytest.raises(OutOfSync, match="rate_table at script://"),
    ):
        driver.rate_deg_s()


BLIND: Exchange = (b"\n:Demand:Rate 1,0\n", None)
"""What goes out before anything is asked; it may be answered, so the place is found again."""
IN_STEP: list[Exchange] = [IDN, FINE]
ANGLE: Exchange = (":Read:Position? 1", "12.5")
STANDS: list[Exchange] = [STILL, ANGLE, STILL, STILL, ANGLE]
"""Rest by the rate and by the angle."""
SAFE_STOP: list[Exchange] = [
    BLIND,
    *IN_STEP,
    (":Read:Rate? 1", "10.5"),
    (":Limit:Acceleration R,1,20;:Demand:Rate 1,0", None),
    FINE,
]


def test_safe_is_rest_read_back_servo_open_then_local() -> None:
    early: list[Exchange] = [(":Read:Rate? 1", "0.01")] * 6  # 10.5 deg/s take 0.525 s, whatever is read
    slowing: list[Exchange] = [*early, (":Read:Rate? 1", "0.04"), ANGLE, (":Read:Rate? 1", "-0.06")]
    exchanges = [*ENABLING, *TURNING, *SAFE_STOP, *slowing, *STANDS, *RELEASING, *UNLOCKING]
    with expected_exchange(table(), [IDN, *exchanges]) as driver:
        driver.enable()
        driver.set_rate(10.5, 20.0)
        report = driver.make_safe(Deadline.after(driver.clock, 30.0))
        assert report.safe
        assert report.detail == "at rest (rate and way below 0.05 deg/s), servo open"


def test_safe_brakes_harder_when_the_deadline_asks_for_it() -> None:
    stop: list[Exchange] = [
        BLIND,
        *IN_STEP,
        (":Read:Rate? 1", "10.5"),
        (":Limit:Acceleration R,1,21;:Demand:Rate 1,0", None),  # 10.5 deg/s within a half of a half of 2 s
        FINE,
    ]
    exchanges = [*ENABLING, *TURNING, *stop, *[STILL] * 5, *STANDS, *RELEASING, *UNLOCKING]
    with expected_exchange(table(), [IDN, *exchanges]) as driver:
        driver.enable()
        driver.set_rate(10.5, 20.0)
        assert driver.make_safe(Deadline.after(driver.clock, 2.0)).safe


def test_safe_without_ever_having_been_enabled() -> None:
    stop: list[Exchange] = [BLIND, *IN_STEP, STILL, (":Limit:Acceleration R,1,50;:Demand:Rate 1,0", None), FINE]
    turned: list[Exchange] = [STILL, ANGLE, STILL, STILL, (":Read:Position? 1", "12.6")]  # at a rate of nothing
    with expected_exchange(table(), [IDN, *stop, *turned, *STANDS, *RELEASING, *UNLOCKING]) as driver:
        assert driver.make_safe(Deadline.after(driver.clock, 30.0)).safe


def test_table_that_keeps_turning_is_aborted_and_not_safe() -> None:
    with expected_exchange(table(), [IDN]) as driver:
        driver.line._wire = endless = _Turning([], clock=driver.clock)
        report = driver.make_safe(Deadline.after(driver.clock, 5.0))
        assert not report.safe
        assert "do not both show a table at rest, last rate 7 deg/s" in report.detail
        assert "emergency stop" in report.detail
        assert ":Interlock:Open 1" in endless.sent
        assert endless.sent[0] == ":Demand:Rate 1,0"
        assert endless.sent[-3:] == [":Limit:Acceleration R,1,50;:Demand:Rate 1,0", ":Mode:Off 1", ":Interlock:Open 1"]
        assert str(report.unproved) == "told to stop, not proved; last read back: 7 deg/s 0 s ago"
        assert driver.clock.now() <= 6.0


class _Turning(ScriptedWire):
    """Takes every command and goes on at 7 deg/s."""

    def __init__(self, exchanges: list[Exchange], *, clock: Clock) -> None:
        super().__init__(exchanges, clock=clock)
        self.sent: list[str] = []

    def send(self, data: bytes, deadline: Deadline) -> None:
        del deadline
        self.sent.append(data.decode().strip())

    def receive(self, deadline: Deadline) -> tuple[bytes, bool]:
        del deadline
        answers = {"*IDN?": IDENTITY, ":Read:Rate? 1": "7.0"}
        return answers.get(self.sent[-1], "0").encode() + b"\n", False


# Framing: what precedes a reply on a byte stream


def framed(layout: str, body: str, error: int = 0) -> bytes:
    return struct.pack(layout, error, len(body)) + body.encode()


@pytest.mark.parametrize(("header", "layout"), [("u32le2", "<II"), ("u32be2", ">II")])
@pytest.mark.parametrize("configured", ["auto", "itself"])
def test_replies_with_error_code_and_length(header: Header, layout: str, configured: str) -> None:
    exchanges: list[Exchange] = [
        ("*IDN?", framed(layout, IDENTITY + "\r\n")),
        (":Read:Rate? 1", framed(layout, "1.5\r\n")),
        (":Utility:Lockout ON", framed(layout, "OK")),
        (":Status:STB?", framed(layout, "0")),
    ]
    setting: Header = "auto" if configured == "auto" else header
    with expected_exchange(table(header=setting), exchanges) as driver:
        assert driver.rate_deg_s() == 1.5
        driver._command(driver.dialect.claim)
        assert isinstance(driver.dialect, AclDialect)
        assert driver.dialect.header == header


def test_an_error_code_in_the_header_is_a_refusal() -> None:
    exchanges: list[Exchange] = [
        ("*IDN?", framed("<II", IDENTITY)),
        (":Interlock:Reset", framed("<II", "axis is servoed", 321)),
        (":Read:Rate? 1", framed("<II", "0.0")),
    ]
    with expected_exchange(table(header="auto"), exchanges) as driver:
        with pytest.raises(InstrumentError, match="refused with 321 'axis is servoed'") as caught:
            driver.clear_fault()
        assert caught.value.number == 321
        assert caught.value.command == ":Interlock:Reset"
        assert driver.rate_deg_s() == 0.0


def test_without_header_the_first_reply_is_a_plain_line() -> None:
    with expected_exchange(table(header="auto"), [IDN, STILL]) as driver:
        assert driver.rate_deg_s() == 0.00001
        assert isinstance(driver.dialect, AclDialect)
        assert driver.dialect.header == "none"


@given(st.sampled_from(["<II", ">II"]), st.text(st.characters(min_codepoint=32, max_codepoint=126), min_size=9))
def test_headers_are_told_apart(layout: str, body: str) -> None:
    assert detect_header(framed(layout, body)[:8]) == {"<II": "u32le2", ">II": "u32be2"}[layout]
    assert detect_header(body.encode()[:8]) == "none"


STICKS: Exchange = (":Status:STB?", "128")


def test_a_bit_that_outlives_its_messages_does_not_hang() -> None:
    with expected_exchange(table(), [IDN, STICKS, (":Status:MSG? QERROR", "")]) as driver:
        driver.check_errors()


def test_messages_before_an_empty_one_are_raised() -> None:
    said = [IDN, STICKS, (":Status:MSG? QERROR", "2,PARAMETER OUT OF RANGE"), STICKS, (":Status:MSG? QERROR", "")]
    with (
        expected_exchange(table(), said) as driver,
        pytest.raises(InstrumentError, match=r"refused with 2,PARAMETER OUT OF RANGE,"),
    ):
        driver.check_errors()


def test_messages_without_an_end_are_an_error_and_no_hang() -> None:
    said = [IDN, *[STICKS, (":Status:MSG? QERROR", "9,AGAIN")] * 32]
    with expected_exchange(table(), said) as driver, pytest.raises(InstrumentError, match="9,AGAIN"):
        driver.check_errors()


@pytest.mark.parametrize("sign", [1, -1])
def test_the_realised_rate_is_on_the_grid_of_the_table(sign: Literal[1, -1]) -> None:
    with expected_exchange(table(sign), [IDN]) as driver:
        assert driver.realised_deg_s(1 / 3) == pytest.approx(0.33333, abs=1e-12)
