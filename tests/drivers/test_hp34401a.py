"""The 34401A's driver against the 34401A's manual (34401-90004)."""

from __future__ import annotations

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from tests.drivers.openings import NO_ERROR, opening, taken_over
from vcfbench.clock import Deadline
from vcfbench.drivers.hp34401a import Hp34401A
from vcfbench.errors import DeadlineExceeded, FramingError, InstrumentError, LimitError, MeasurementError
from vcfbench.testing import Exchange, expected_exchange, over_visa

OPENING = opening("HEWLETT-PACKARD,34401A,0,10-5-2")
TAKEN = taken_over(Hp34401A.left, header="VOLT:DC", mains="50")
OPEN = over_visa(Hp34401A, name="multimeter")
CONFIGURED: list[Exchange] = [
    *TAKEN,
    ("CONF:VOLT:DC 10", None),
    ("VOLT:DC:NPLC 10", None),
    ("ZERO:AUTO ON", None),
    ("INP:IMP:AUTO ON", None),
    ("TRIG:SOUR IMM", None),
    NO_ERROR,
    ("VOLT:DC:RANG?", "+1.00000000E+01"),
    ("VOLT:DC:NPLC?", "+1.00000000E+01"),
]


def after_range(range_v: float, start: int) -> list[Exchange]:
    """Return what follows the range, from the `start` on: 10 V and less can have more than 10 Gohm."""
    return [each for each in CONFIGURED[start:-2] if range_v <= 10.0 or each[0] != "INP:IMP:AUTO ON"]


def reading(*answers: str | None) -> list[Exchange]:
    """Taking one reading: both times it is fetched the same answer, or the two `answers`."""
    first, again = answers if len(answers) == 2 else answers * 2
    return [("INIT", None), ("FETC?", first), ("FETC?", again)]


def test_range_and_integration_time_are_fixed_and_read_back() -> None:
    with expected_exchange(OPEN, [*OPENING, *CONFIGURED, *reading("-1.67463210E-01")]) as meter:
        meter.configure_dc_voltage(10.0, 10.0)
        assert meter.read_voltage_v() == -0.16746321


@pytest.mark.parametrize(("range_v", "nplc"), [(5.0, 10.0), (10.0, 5.0), (float("nan"), 10.0), (0.0, 10.0)])
def test_unknown_ranges_and_integration_times_are_not_sent(range_v: float, nplc: float) -> None:
    with expected_exchange(OPEN, OPENING) as meter, pytest.raises(LimitError, match="is not one of"):
        meter.configure_dc_voltage(range_v, nplc)


def test_another_range_than_asked_for_is_an_error() -> None:
    exchanges = [*CONFIGURED[:-2], ("VOLT:DC:RANG?", "+1.00000000E+02")]
    with (
        expected_exchange(OPEN, [*OPENING, *exchanges]) as meter,
        pytest.raises(InstrumentError, match="reads back 100"),
    ):
        meter.configure_dc_voltage(10.0, 10.0)


@pytest.mark.parametrize("answer", ["+9.90000000E+37", "-9.90000000E+37"])
def test_overload_is_no_reading(answer: str) -> None:
    with (
        expected_exchange(OPEN, [*OPENING, *reading(answer)[:2]]) as meter,
        pytest.raises(MeasurementError, match="multimeter at SCRIPT: overload"),
    ):
        meter.read_voltage_v()


def test_a_garbled_reading_is_no_reading() -> None:
    exchanges = [*OPENING, *reading("+1.0000000E+0/")[:2]]
    with expected_exchange(OPEN, exchanges) as meter, pytest.raises(FramingError):
        meter.read_voltage_v()


@pytest.mark.parametrize(
    "answer",
    [
        *("-1.67", "-1.67E-01", "-1.6746321E-01", "1.67463210E-01", "-1.67463210E-1", "-1.67463210e-01"),
        *("-16.7463210E-01", "-1.674632100E-01", "-1674632100E-01", "-1.67463210E-001", "-1.67463210E01"),
    ],
)
def test_what_lost_or_gained_a_character_is_no_reading(answer: str) -> None:
    words = r"multimeter at SCRIPT: expected a number of the form \+d\.ddddddddE\+dd, got"
    with (
        expected_exchange(OPEN, [*OPENING, *reading(answer)[:2]]) as meter,
        pytest.raises(FramingError, match=words),
    ):
        meter.read_voltage_v()


@settings(max_examples=25)
@given(st.integers(0, 14), st.characters(min_codepoint=33, max_codepoint=126))
def test_no_single_character_can_be_exchanged(place: int, character: str) -> None:
    answer = "-1.67463210E-01"
    changed = answer[:place] + character + answer[place + 1 :]
    if changed == answer:
        return
    outcome: list[Exchange] = reading(answer, changed)
    with expected_exchange(OPEN, [*OPENING, *CONFIGURED, *outcome]) as meter:
        meter.configure_dc_voltage(10.0, 10.0)
        with pytest.raises((FramingError, MeasurementError)):
            meter.read_voltage_v()


@pytest.mark.parametrize(("range_v", "answer"), [(10.0, "-1.20000001E+01"), (1.0, "+1.67463210E+00")])
def test_no_range_gives_more_than_a_fifth_above_it(range_v: float, answer: str) -> None:
    exchanges: list[Exchange] = [
        *TAKEN,
        (f"CONF:VOLT:DC {range_v:g}", None),
        *after_range(range_v, 4),
        ("VOLT:DC:RANG?", f"{range_v:+.8E}"),
        CONFIGURED[-1],
    ]
    with expected_exchange(OPEN, [*OPENING, *exchanges, *reading(answer)]) as meter:
        meter.configure_dc_voltage(range_v, 10.0)
        with pytest.raises(FramingError, match=f"which the {range_v:g} V range cannot give"):
            meter.read_voltage_v()


def test_a_fifth_above_the_range_is_a_reading() -> None:
    with expected_exchange(OPEN, [*OPENING, *CONFIGURED, *reading("-1.20000000E+01")]) as meter:
        meter.configure_dc_voltage(10.0, 10.0)
        assert meter.read_voltage_v() == -12.0


@pytest.mark.parametrize(
    ("nplc", "mains_hz", "expected_s"), [(10.0, 50.0, 0.40), (10.0, 60.0, 1 / 3), (100.0, 50.0, 4.0), (1.0, 50.0, 0.04)]
)
def test_reading_time_is_two_integrations(nplc: float, mains_hz: float, expected_s: float) -> None:
    exchanges: list[Exchange] = [
        *TAKEN,
        ("CONF:VOLT:DC 10", None),
        (f"VOLT:DC:NPLC {nplc:g}", None),
        *CONFIGURED[5:-1],
        ("VOLT:DC:NPLC?", f"{nplc:+.8E}"),
    ]
    opener = over_visa(lambda session: Hp34401A(session, mains_hz=mains_hz))
    with expected_exchange(opener, [*OPENING, *exchanges]) as meter:
        meter.configure_dc_voltage(10.0, nplc)
        assert expected_s < meter.reading_time_s < expected_s + 0.1


def test_reading_is_awaited_for_its_duration_plus_timeout() -> None:
    with expected_exchange(OPEN, [*OPENING, *CONFIGURED, *reading(None)[:2]]) as meter:
        meter.configure_dc_voltage(10.0, 10.0)
        begin_s = meter.clock.now()
        with pytest.raises(DeadlineExceeded):
            meter.read_voltage_v()
        assert meter.clock.now() - begin_s == pytest.approx(1.0 + meter.reading_time_s)


def test_safe_is_idle() -> None:
    with expected_exchange(OPEN, [*OPENING, ("*OPC?", "1")]) as meter:
        assert meter.make_safe(Deadline.after(meter.clock, 3.0)).safe


def test_a_meter_that_says_nothing_is_not_safe() -> None:
    exchanges: list[Exchange] = [("*OPC?", None), ("*IDN?", None)]
    with expected_exchange(OPEN, [*OPENING, *exchanges]) as meter:
        report = meter.make_safe(Deadline.after(meter.clock, 3.0))
        assert not report.safe
        assert meter.clock.now() <= 3.0 + 1e-9


def test_on_rs232_it_is_made_remote_before_anything() -> None:
    with expected_exchange(OPEN, [("SYST:REM", None), *OPENING], interface="asrl"):
        pass


@pytest.mark.parametrize("range_v", [0.1, 1.0, 10.0, 100.0, 1000.0])
@pytest.mark.parametrize("nplc", [0.02, 0.2, 1.0, 10.0, 100.0])
def test_every_range_and_integration_time_of_the_manual(range_v: float, nplc: float) -> None:
    exchanges: list[Exchange] = [
        *TAKEN,
        (f"CONF:VOLT:DC {range_v:g}", None),
        (f"VOLT:DC:NPLC {nplc:g}", None),
        *after_range(range_v, 5),
        ("VOLT:DC:RANG?", f"{range_v:+.8E}"),
        ("VOLT:DC:NPLC?", f"{nplc:+.8E}"),
    ]
    with expected_exchange(OPEN, [*OPENING, *exchanges]) as meter:
        meter.configure_dc_voltage(range_v, nplc)


@pytest.mark.parametrize("found", ["+1.00000000E+00", "+9.99980000E+00", "-1.00000000E+01"])
def test_a_lower_range_than_asked_for_is_an_error_too(found: str) -> None:
    with (
        expected_exchange(OPEN, [*OPENING, *CONFIGURED[:-2], ("VOLT:DC:RANG?", found)]) as meter,
        pytest.raises(InstrumentError, match="reads back"),
    ):
        meter.configure_dc_voltage(10.0, 10.0)


def test_first_reading_takes_as_long_as_after_a_reset() -> None:
    """10 power-line cycles (guide p. 61), of 50 Hz unless the bench says otherwise; and 50 ms around them."""
    with expected_exchange(OPEN, OPENING) as meter:
        assert meter.reading_time_s == pytest.approx(2 * 10 / 50.0 + 0.05)


def test_configuring_waits_for_reading_under_way() -> None:
    exchanges: list[Exchange] = [*CONFIGURED[:-3], ("SYST:ERR?", None)]
    with expected_exchange(OPEN, [*OPENING, *exchanges]) as meter:
        begin_s = meter.clock.now()
        with pytest.raises(DeadlineExceeded):
            meter.configure_dc_voltage(10.0, 10.0)
        assert meter.clock.now() - begin_s == pytest.approx(1.0 + meter.reading_time_s)


@pytest.mark.parametrize(("range_v", "found_v"), [(1000.0, 1000.0005), (0.1, 0.10000005)])
def test_a_range_agrees_within_a_millionth(range_v: float, found_v: float) -> None:
    exchanges: list[Exchange] = [
        *TAKEN,
        (f"CONF:VOLT:DC {range_v:g}", None),
        *after_range(range_v, 4),
        ("VOLT:DC:RANG?", f"{found_v:+.8E}"),
        CONFIGURED[-1],
    ]
    with expected_exchange(OPEN, [*OPENING, *exchanges]) as meter:
        meter.configure_dc_voltage(range_v, 10.0)


def test_refused_integration_time_is_not_waited_for() -> None:
    exchanges = [*CONFIGURED[:-1], ("VOLT:DC:NPLC?", "+1.00000000E+00")]
    exchanges[4] = ("VOLT:DC:NPLC 100", None)
    with expected_exchange(OPEN, [*OPENING, *exchanges]) as meter:
        before_s = meter.reading_time_s
        with pytest.raises(InstrumentError, match=r"was set to 100 but reads back 1, command 'VOLT:DC:NPLC\?'"):
            meter.configure_dc_voltage(10.0, 100.0)
        assert meter.reading_time_s == before_s
