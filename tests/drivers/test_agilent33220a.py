"""The 33220A's driver against what is known of its manual (33220-90002)."""

from __future__ import annotations

import math

import pytest
from hypothesis import given
from hypothesis import strategies as st

from tests.drivers.openings import NO_ERROR, opening, taken_over
from tests.drivers.openings import OFF_BLIND as BLIND
from vcfbench.clock import Deadline
from vcfbench.drivers.agilent33220a import Agilent33220A
from vcfbench.errors import DeadlineExceeded, FramingError, InstrumentError, LimitError, PlanError
from vcfbench.testing import Exchange, expected_exchange, over_visa

OPENING = opening("Agilent Technologies,33220A,MY44008868,2.00-2.00-22-2")
STARTED: list[Exchange] = [
    *OPENING,
    *[("OUTP OFF", None), NO_ERROR, ("OUTP?", "0")],
    *taken_over(Agilent33220A.left),
]
"""Before the first setting."""
OPEN = over_visa(Agilent33220A, name="rate_source")
OPEN_CIRCUIT: list[Exchange] = [("OUTP:LOAD INF", None), NO_ERROR, ("OUTP:LOAD?", "+9.9000000000000E+37")]
ZERO_DC: list[Exchange] = [
    *OPEN_CIRCUIT,
    ("FUNC DC", None),
    ("VOLT:OFFS 0", None),
    NO_ERROR,
    ("VOLT:OFFS?", "+0.0000000000000E+00"),
    ("VOLT:OFFS?", "+0.0000000000000E+00"),
]


def test_dc_goes_through_the_offset_into_an_open_circuit() -> None:
    exchanges: list[Exchange] = [
        *OPEN_CIRCUIT,
        ("FUNC DC", None),
        ("VOLT:OFFS 1.23456", None),
        NO_ERROR,
        ("VOLT:OFFS?", "+1.2350000000000E+00"),
        ("VOLT:OFFS?", "+1.2350000000000E+00"),
    ]
    with expected_exchange(OPEN, [*STARTED, *exchanges]) as generator:
        assert generator.configure_dc(1.23456) == 1.235


def test_the_level_changes_alone() -> None:
    level: Exchange = ("VOLT:OFFS?", "-5.0000000000000E+00")
    exchanges: list[Exchange] = [("VOLT:OFFS -5", None), NO_ERROR, level, level]
    with expected_exchange(OPEN, [*STARTED, *ZERO_DC, *exchanges]) as generator:
        generator.configure_dc(0.0)
        assert generator.set_dc(-5.0) == -5.0


def test_a_level_needs_dc_configured() -> None:
    with expected_exchange(OPEN, OPENING) as generator, pytest.raises(PlanError):
        generator.set_dc(1.0)


@given(st.floats().filter(lambda v: not abs(v) <= 10.0))
def test_levels_beyond_ten_volts_are_not_sent(voltage_v: float) -> None:
    with expected_exchange(OPEN, OPENING) as generator, pytest.raises(LimitError):
        generator.configure_dc(voltage_v)


def test_a_clipped_level_is_an_error() -> None:
    exchanges: list[Exchange] = [
        ("VOLT:OFFS 9.9", None),
        ("SYST:ERR?", '-222,"Data out of range; offset; value clipped to upper limit"'),
        NO_ERROR,
    ]
    with expected_exchange(OPEN, [*STARTED, *ZERO_DC, *exchanges]) as generator:
        generator.configure_dc(0.0)
        with pytest.raises(InstrumentError, match="value clipped to upper limit") as caught:
            generator.set_dc(9.9)
        assert caught.value.number == -222


def test_a_level_that_reads_back_otherwise_is_an_error() -> None:
    exchanges: list[Exchange] = [("VOLT:OFFS 5", None), NO_ERROR, ("VOLT:OFFS?", "+4.9980000000000E+00")]
    with expected_exchange(OPEN, [*STARTED, *ZERO_DC, *exchanges]) as generator:
        generator.configure_dc(0.0)
        with pytest.raises(InstrumentError, match=r"was set to 5 V but reads back 4\.998 V"):
            generator.set_dc(5.0)


@pytest.mark.parametrize("again", ["+6.6670000000000E-02", "+6.6680000000000E-02", "+6.667E-02", "0.06667"])
def test_level_needs_two_equal_well_formed_answers(again: str) -> None:
    """The level is a number of the results; one changed digit may be within what a setting may be off."""
    exchanges: list[Exchange] = [("VOLT:OFFS 0.06667", None), NO_ERROR, ("VOLT:OFFS?", "+6.6660000000000E-02")]
    with expected_exchange(OPEN, [*STARTED, *ZERO_DC, *exchanges, ("VOLT:OFFS?", again)]) as generator:
        generator.configure_dc(0.0)
        with pytest.raises(FramingError, match=r"one setting was answered as|expected a number of the form"):
            generator.set_dc(0.06667)


def test_a_load_of_50_ohm_would_halve_all_voltages() -> None:
    exchanges: list[Exchange] = [*OPEN_CIRCUIT[:2], ("OUTP:LOAD?", "+5.0000000000000E+01")]
    words = r"was set to a high-impedance load but reads back 50 ohm, command 'OUTP:LOAD\?'"
    with expected_exchange(OPEN, [*STARTED, *exchanges]) as generator, pytest.raises(InstrumentError, match=words):
        generator.configure_dc(1.0)


def test_sine_is_set_up_without_conflicts() -> None:
    exchanges: list[Exchange] = [
        *OPEN_CIRCUIT,
        ("VOLT:OFFS 0", None),
        ("FUNC SIN", None),
        ("VOLT:UNIT VPP", None),
        ("FREQ 3464.1", None),
        ("VOLT 2", None),
        ("VOLT:OFFS 1", None),
        NO_ERROR,
        ("FREQ?", "+3.4641000000000E+03"),
        ("VOLT?", "+2.0000000000000E+00"),
        ("VOLT:OFFS?", "+1.0000000000000E+00"),
    ]
    with expected_exchange(OPEN, [*STARTED, *exchanges]) as generator:
        generator.configure_sine(3464.1, 2.0, 1.0)


@pytest.mark.parametrize(
    ("frequency_hz", "amplitude_vpp", "offset_v"),
    [(21e6, 1, 0), (0, 1, 0), (1e3, 20.1, 0), (1e3, 0.01, 0), (1e3, 10, 5.1), (1e3, math.nan, 0), (1e3, 1, math.nan)],
)
def test_sines_out_of_range_are_not_sent(frequency_hz: float, amplitude_vpp: float, offset_v: float) -> None:
    with expected_exchange(OPEN, OPENING) as generator, pytest.raises(LimitError):
        generator.configure_sine(frequency_hz, amplitude_vpp, offset_v)


def test_the_relay_closes_only_on_something_configured() -> None:
    exchanges: list[Exchange] = [("OUTP ON", None), NO_ERROR, ("OUTP?", "1")]
    with expected_exchange(OPEN, [*STARTED, *ZERO_DC, *exchanges]) as generator:
        with pytest.raises(PlanError):
            generator.enable_output()
        generator.configure_dc(0.0)
        generator.enable_output()


def test_safe_is_the_relay_open_by_read_back() -> None:
    exchanges: list[Exchange] = [BLIND, ("OUTP OFF", None), NO_ERROR, ("OUTP?", "0")]
    with expected_exchange(OPEN, [*OPENING, *exchanges]) as generator:
        report = generator.make_safe(Deadline.after(generator.clock, 3.0))
        assert report.safe
        assert report.detail == "output relay open"


def test_a_relay_that_stays_closed_is_not_safe() -> None:
    exchanges: list[Exchange] = [("OUTP OFF", None), NO_ERROR, ("OUTP?", "1")] * 3
    with expected_exchange(OPEN, [*OPENING, BLIND, *exchanges, BLIND]) as generator:
        report = generator.make_safe(Deadline.after(generator.clock, 3.0))
        assert not report.safe
        assert "was set to off but reads back on, command 'OUTP?'" in report.detail


def test_generator_is_safe_after_lost_answer_and_stale_error() -> None:
    exchanges: list[Exchange] = [
        ("OUTP?", None),
        BLIND,
        ("*IDN?", OPENING[0][1]),
        ("*OPC?", "1"),
        ("SYST:ERR?", '-410,"Query INTERRUPTED"'),
        ("SYST:ERR?", '-222,"Data out of range"'),
        NO_ERROR,
        ("OUTP OFF", None),  # reported as refused, for the stale error: what is read back counts
        NO_ERROR,
        ("OUTP?", "0"),
    ]
    with expected_exchange(OPEN, [*OPENING, *exchanges]) as generator:
        with pytest.raises(DeadlineExceeded):
            generator.output_enabled()
        assert generator.make_safe(Deadline.after(generator.clock, 10.0)).safe


@pytest.mark.parametrize("interface", ["socket", "instr"])
def test_on_lan_it_is_made_remote_first(interface: str) -> None:
    with expected_exchange(OPEN, [("SYST:COMM:RLST REM", None), *OPENING], interface=interface):  # type: ignore[arg-type]
        pass


def sine(
    frequency_hz: float, amplitude_vpp: float, offset_v: float, found: tuple[float, ...] | None = None
) -> list[Exchange]:
    """What setting up a sine says, and what is read back: what was *sent*, or `found`."""
    sent = [f"{value:.9g}" for value in (frequency_hz, amplitude_vpp, offset_v)]
    frequency, amplitude, offset = found or tuple(map(float, sent))
    return [
        *OPEN_CIRCUIT,
        ("VOLT:OFFS 0", None),
        ("FUNC SIN", None),
        ("VOLT:UNIT VPP", None),
        (f"FREQ {sent[0]}", None),
        (f"VOLT {sent[1]}", None),
        (f"VOLT:OFFS {sent[2]}", None),
        NO_ERROR,
        ("FREQ?", f"{frequency:+.13E}"),
        ("VOLT?", f"{amplitude:+.13E}"),
        ("VOLT:OFFS?", f"{offset:+.13E}"),
    ]


@given(st.floats(1e-6, 20e6), st.floats(0.02, 16.0), st.floats(-2.0, 2.0).filter(lambda v: abs(v) > 1e-9))
def test_a_sine_is_what_was_sent_of_it(frequency_hz: float, amplitude_vpp: float, offset_v: float) -> None:
    with expected_exchange(OPEN, [*STARTED, *sine(frequency_hz, amplitude_vpp, offset_v)]) as generator:
        generator.configure_sine(frequency_hz, amplitude_vpp, offset_v)


@given(st.floats().filter(lambda v: not abs(v) <= 10.0))
def test_a_change_beyond_ten_volts_is_not_sent_either(voltage_v: float) -> None:
    with expected_exchange(OPEN, [*STARTED, *ZERO_DC]) as generator:
        generator.configure_dc(0.0)
        with pytest.raises(LimitError, match="nothing was sent"):
            generator.set_dc(voltage_v)


@pytest.mark.parametrize(
    ("frequency_hz", "amplitude_vpp", "offset_v"),
    [(1e-6, 0.02, 0.0), (20e6, 20.0, 0.0), (3464.1, 2.0, 9.0), (3464.1, 2.0, -9.0), (1.0, 1.0, 0.0)],
)
def test_the_ends_of_the_ranges_are_sent(frequency_hz: float, amplitude_vpp: float, offset_v: float) -> None:
    """1 uHz to 20 MHz, 20 mVpp to 20 Vpp into an open circuit, peaks up to 10 V."""
    with expected_exchange(OPEN, [*STARTED, *sine(frequency_hz, amplitude_vpp, offset_v)]) as generator:
        generator.configure_sine(frequency_hz, amplitude_vpp, offset_v)


@pytest.mark.parametrize(
    ("frequency_hz", "amplitude_vpp", "offset_v"),
    [(0.9e-6, 1.0, 0.0), (20.1e6, 1.0, 0.0), (1e3, 0.019, 0.0), (1e3, 20.1, 0.0), (1e3, 2.0, 9.1), (1e3, 2.0, -9.1)],
)
def test_beyond_the_ends_nothing_is_sent(frequency_hz: float, amplitude_vpp: float, offset_v: float) -> None:
    with expected_exchange(OPEN, OPENING) as generator, pytest.raises(LimitError, match="nothing was sent"):
        generator.configure_sine(frequency_hz, amplitude_vpp, offset_v)


def test_sine_without_offset_may_be_put_out() -> None:
    exchanges: list[Exchange] = [*sine(1e3, 1.0, 0.0), ("OUTP ON", None), NO_ERROR, ("OUTP?", "1")]
    with expected_exchange(OPEN, [*STARTED, *exchanges]) as generator:
        generator.configure_sine(1e3, 1.0)
        generator.enable_output()


@pytest.mark.parametrize(
    ("found", "read"),
    [
        ((3464.0, 2.0, 1.0), 1),
        ((3464.1 + 1e-4, 2.0, 1.0), 1),
        ((3464.1, 1.998, 1.0), 2),
        ((3464.1, 2.0, 1.002), 3),
        ((3464.1, 2.0, -1.0), 3),
    ],
)
def test_a_sine_that_reads_back_otherwise_is_an_error(found: tuple[float, ...], read: int) -> None:
    exchanges = sine(3464.1, 2.0, 1.0, found)
    with (
        expected_exchange(OPEN, [*STARTED, *exchanges[: len(exchanges) - 3 + read]]) as generator,
        pytest.raises(InstrumentError, match="reads back"),
    ):
        generator.configure_sine(3464.1, 2.0, 1.0)


@pytest.mark.parametrize("sign", [1.0, -1.0])
@pytest.mark.parametrize(("level_v", "step_v"), [(0.5, 1e-3), (2.0, 1e-3), (9.999, 1e-3), (10.0, 1e-2)])
def test_a_level_agrees_within_one_unit_of_its_fourth_digit(level_v: float, step_v: float, sign: float) -> None:
    def answers(off_v: float) -> list[Exchange]:
        answer: Exchange = ("VOLT:OFFS?", f"{sign * level_v + off_v:+.13E}")
        return [(f"VOLT:OFFS {sign * level_v:g}", None), NO_ERROR, answer, answer]

    agreeing = [*answers(step_v), *answers(-step_v)]
    with expected_exchange(OPEN, [*STARTED, *ZERO_DC, *agreeing, *answers(1.01 * step_v)[:-1]]) as generator:
        generator.configure_dc(0.0)
        for _ in range(2):
            generator.set_dc(sign * level_v)
        with pytest.raises(InstrumentError, match="reads back"):
            generator.set_dc(sign * level_v)


def test_a_relay_that_does_not_follow_is_an_error() -> None:
    switched: list[Exchange] = [
        ("OUTP ON", None),
        NO_ERROR,
        ("OUTP?", "0"),
        ("OUTP OFF", None),
        NO_ERROR,
        ("OUTP?", "1"),
    ]
    with expected_exchange(OPEN, [*STARTED, *ZERO_DC, *switched]) as generator:
        generator.configure_dc(0.0)
        with pytest.raises(InstrumentError, match=r"was set to on but reads back off, command 'OUTP\?'"):
            generator.enable_output()
        with pytest.raises(InstrumentError, match=r"was set to off but reads back on, command 'OUTP\?'"):
            generator.disable_output()


def test_a_relay_that_may_not_open_says_so() -> None:
    refused: list[Exchange] = [("OUTP OFF", None), ("SYST:ERR?", '-113,"Undefined header"'), NO_ERROR]
    with expected_exchange(OPEN, [*OPENING, *refused]) as generator, pytest.raises(InstrumentError, match="-113"):
        generator.disable_output()


REFUSED: list[Exchange] = [("SYST:ERR?", '-221,"Settings conflict"'), NO_ERROR]


@pytest.mark.parametrize(
    "exchanges",
    [[*ZERO_DC[:-3], *REFUSED], [*ZERO_DC[:-2], ("VOLT:OFFS?", "+1.0000000000000E+00")]],
    ids=["refused", "reads back otherwise"],
)
def test_unset_level_may_not_be_put_out(exchanges: list[Exchange]) -> None:
    with expected_exchange(OPEN, [*STARTED, *exchanges]) as generator:
        with pytest.raises(InstrumentError):
            generator.configure_dc(0.0)
        with pytest.raises(PlanError, match="nothing was sent"):
            generator.enable_output()


@pytest.mark.parametrize(
    "exchanges",
    [[*sine(1e3, 1.0, 0.0)[:-4], *REFUSED], sine(1e3, 1.0, 0.0, (1e3, 1.0, 0.5))],
    ids=["refused", "reads back otherwise"],
)
def test_unset_sine_may_not_be_put_out(exchanges: list[Exchange]) -> None:
    with expected_exchange(OPEN, [*STARTED, *exchanges]) as generator:
        with pytest.raises(InstrumentError):
            generator.configure_sine(1e3, 1.0)
        with pytest.raises(PlanError, match="nothing was sent"):
            generator.enable_output()


def test_a_frequency_agrees_within_a_microhertz() -> None:
    well = sine(1e-3, 1.0, 0.0, (1e-3 + 0.9e-6, 1.0, 0.0)) + sine(20e6, 1.0, 0.0, (20e6 - 0.9e-6, 1.0, 0.0))
    ill = [sine(1e-3, 1.0, 0.0, (1e-3 + 1.05e-6, 1.0, 0.0))[:-2], sine(20e6, 1.0, 0.0, (20e6 - 2e-6, 1.0, 0.0))[:-2]]
    with expected_exchange(OPEN, [*STARTED, *well, *ill[0], *ill[1]]) as generator:
        generator.configure_sine(1e-3, 1.0)
        generator.configure_sine(20e6, 1.0)
        for frequency_hz in (1e-3, 20e6):
            with pytest.raises(InstrumentError, match="reads back"):
                generator.configure_sine(frequency_hz, 1.0)
