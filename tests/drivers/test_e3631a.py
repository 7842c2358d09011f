"""The E3631A's driver against the E3631A's manual (E3631-90002)."""

from __future__ import annotations

import math
from contextlib import nullcontext

import pytest

from tests.drivers.openings import NO_ERROR, opening
from tests.drivers.openings import OFF_BLIND as BLIND
from vcfbench.clock import Deadline
from vcfbench.drivers.e3631a import E3631A
from vcfbench.errors import InstrumentError, LimitError, MeasurementError, PlanError, WrongInstrument
from vcfbench.interfaces import Regulation
from vcfbench.testing import Exchange, expected_exchange, over_visa

OPENING = opening("HEWLETT-PACKARD,E3631A,0,2.1-5.0-1.0")
FOUND_OFF: Exchange = ("OUTP?", "0")
"""Asked before the first setting."""
CONFIGURED: list[Exchange] = [
    FOUND_OFF,
    ("OUTP:TRAC OFF;:INST:SEL P25V;:CURR 0.1;:VOLT 10", None),
    NO_ERROR,
    ("VOLT?", "+1.00000000E+01"),
    ("CURR?", "+1.00000000E-01"),
]
OPEN = over_visa(E3631A, name="power")


def test_current_limit_precedes_voltage_and_both_are_read_back() -> None:
    with expected_exchange(OPEN, [*OPENING, *CONFIGURED]) as supply:
        supply.configure_output("P25V", 10.0, 0.1)


def test_the_negative_output_takes_negative_voltages() -> None:
    exchanges: list[Exchange] = [
        FOUND_OFF,
        ("OUTP:TRAC OFF;:INST:SEL N25V;:CURR 0.1;:VOLT -10", None),
        NO_ERROR,
        ("VOLT?", "-1.00000000E+01"),
        ("CURR?", "+1.00000000E-01"),
    ]
    with expected_exchange(OPEN, [*OPENING, *exchanges]) as supply:
        supply.configure_output("N25V", -10.0, 0.1)


@pytest.mark.parametrize(
    ("output", "voltage_v", "current_a"),
    [
        ("P25V", 25.76, 0.1),
        ("P25V", -0.1, 0.1),
        ("P6V", 6.19, 0.1),
        ("N25V", 10.0, 0.1),
        ("P25V", 10.0, 1.04),
        ("P25V", 10.0, -0.1),
        ("P25V", math.nan, 0.1),
        ("P25V", 10.0, math.nan),
        ("P25V", math.inf, 0.1),
        ("P26V", 10.0, 0.1),
    ],
)
def test_what_is_out_of_range_is_not_sent(output: str, voltage_v: float, current_a: float) -> None:
    with expected_exchange(OPEN, OPENING) as supply, pytest.raises(LimitError, match="power at SCRIPT"):
        supply.configure_output(output, voltage_v, current_a)


def test_refused_command_raises_all_entries_of_error_queue() -> None:
    exchanges: list[Exchange] = [
        FOUND_OFF,
        ("OUTP:TRAC OFF;:INST:SEL P25V;:CURR 0.1;:VOLT 10", None),
        ("SYST:ERR?", '-222,"Data out of range"'),
        ("SYST:ERR?", '+800,"P25V and N25V coupled by track system"'),
        NO_ERROR,
    ]
    with expected_exchange(OPEN, [*OPENING, *exchanges]) as supply:
        with pytest.raises(InstrumentError) as caught:
            supply.configure_output("P25V", 10.0, 0.1)
        assert (caught.value.number, caught.value.words) == (-222, "Data out of range")
        assert str(caught.value) == (
            'power at SCRIPT: refused with -222 "Data out of range", '
            'then 800 "P25V and N25V coupled by track system", '
            "command 'OUTP:TRAC OFF;:INST:SEL P25V;:CURR 0.1;:VOLT 10'"
        )


def test_a_setting_that_reads_back_otherwise_is_an_error() -> None:
    exchanges = [*CONFIGURED[:3], ("VOLT?", "+9.90000000E+00")]
    with expected_exchange(OPEN, [*OPENING, *exchanges]) as supply, pytest.raises(InstrumentError, match="reads back"):
        supply.configure_output("P25V", 10.0, 0.1)


def test_outputs_go_on_together_and_those_not_configured_at_zero() -> None:
    exchanges: list[Exchange] = [
        ("INST:SEL P6V;:VOLT 0", None),
        NO_ERROR,
        ("INST:SEL N25V;:VOLT 0", None),
        NO_ERROR,
        ("OUTP ON", None),
        NO_ERROR,
        ("OUTP?", "1"),
    ]
    with expected_exchange(OPEN, [*OPENING, *CONFIGURED, *exchanges]) as supply:
        supply.configure_output("P25V", 10.0, 0.1)
        supply.enable_outputs()


def test_nothing_goes_on_before_something_was_configured() -> None:
    with expected_exchange(OPEN, OPENING) as supply, pytest.raises(PlanError):
        supply.enable_outputs()


def test_outputs_that_stay_off_are_an_error() -> None:
    with (
        expected_exchange(OPEN, [*OPENING, ("OUTP OFF", None), NO_ERROR, ("OUTP?", "1")]) as supply,
        pytest.raises(InstrumentError, match="do not read back so"),
    ):
        supply.disable_outputs()


def test_measuring_names_the_output() -> None:
    exchanges: list[Exchange] = [
        ("MEAS:VOLT? N25V", "-9.99871000E+00"),
        ("MEAS:CURR? N25V", "+3.21000000E-02"),
    ]
    with expected_exchange(OPEN, [*OPENING, *exchanges]) as supply:
        assert supply.measure_voltage_v("N25V") == -9.99871
        assert supply.measure_current_a("N25V") == 0.0321


@pytest.mark.parametrize(
    ("answers", "regulation"),
    [
        (["+2"], Regulation.CONSTANT_VOLTAGE),
        (["1"], Regulation.CONSTANT_CURRENT),
        (["3"], Regulation.FAULT),
        (["0", "0"], Regulation.OFF),
        (["0", "1"], Regulation.FAULT),
    ],
)
def test_regulation_is_read_from_the_condition_register(answers: list[str], regulation: Regulation) -> None:
    exchanges = list(zip(["STAT:QUES:INST:ISUM2:COND?", "OUTP?"], answers, strict=False))
    with expected_exchange(OPEN, [*OPENING, *exchanges]) as supply:
        assert supply.regulation("P25V") is regulation


def test_safe_is_off_and_measured_near_zero() -> None:
    exchanges: list[Exchange] = [
        BLIND,
        ("OUTP OFF", None),
        NO_ERROR,
        ("OUTP?", "0"),
        *[(f"MEAS:VOLT? {output}", answer) for output, answer in (("P6V", "0"), ("P25V", "+6.1"), ("N25V", "-0.1"))],
        *[
            (f"MEAS:VOLT? {output}", answer)
            for output, answer in (("P6V", "-0.69"), ("P25V", "+0.19"), ("N25V", "+0.5"))
        ],
    ]
    with expected_exchange(OPEN, [*OPENING, *exchanges]) as supply:
        report = supply.make_safe(Deadline.after(supply.clock, 10.0))
        assert report.safe
        assert report.detail == "outputs off, P6V -0.69 V, P25V +0.19 V, N25V +0.5 V at the terminals"


def test_a_terminal_that_stays_live_is_not_safe() -> None:
    once: list[Exchange] = [("OUTP OFF", None), NO_ERROR, ("OUTP?", "0")]
    measured: list[Exchange] = [("MEAS:VOLT? P6V", "0"), ("MEAS:VOLT? P25V", "+9.9"), ("MEAS:VOLT? N25V", "0")]
    with expected_exchange(OPEN, [*OPENING, BLIND, *[*once, *measured] * 3, BLIND]) as supply:
        report = supply.make_safe(Deadline.after(supply.clock, 0.1))
        assert not report.safe
        assert "P25V +9.9 V: not discharged yet" in report.detail


def test_a_measured_overload_is_no_voltage() -> None:
    with (
        expected_exchange(OPEN, [*OPENING, ("MEAS:VOLT? P6V", "+9.90000000E+37")]) as supply,
        pytest.raises(MeasurementError),
    ):
        supply.measure_voltage_v("P6V")


@pytest.mark.parametrize(
    "identity", ["HEWLETT-PACKARD,34401A,0,10-5-2", "ACME,E3631A,0,1", "Agilent Technologies,E3632A,0,1"]
)
def test_another_instrument_is_refused_and_nothing_is_sent_to_it(identity: str) -> None:
    with pytest.raises(WrongInstrument, match="expected E3631A"), expected_exchange(OPEN, [("*IDN?", identity)]):
        pass


@pytest.mark.parametrize("maker", ["HEWLETT-PACKARD", "Agilent Technologies", "Keysight Technologies"])
def test_all_makers_of_the_instrument_are_accepted(maker: str) -> None:
    with expected_exchange(OPEN, opening(f"{maker},E3631A,0,2.1-5.0-1.0")):
        pass


def test_another_specimen_is_refused() -> None:
    with (
        pytest.raises(WrongInstrument, match="serial number MY1"),
        expected_exchange(
            over_visa(lambda session: E3631A(session, serial_number="MY1")), [("*IDN?", "Keysight,E3631A,MY2,1")]
        ),
    ):
        pass


def test_on_rs232_supply_is_made_remote_and_given_pauses() -> None:
    exchanges: list[Exchange] = [("SYST:REM", None), *OPENING, ("OUTP OFF", None), NO_ERROR, ("OUTP?", "0")]
    opener = over_visa(E3631A, write_pause_s=0.5, timeout_s=5.0)
    with expected_exchange(opener, exchanges, interface="asrl") as supply:
        begin_s = supply.clock.now()
        supply.disable_outputs()
        assert supply.clock.now() - begin_s == pytest.approx(0.5)


RATINGS = {"P6V": (6.18, 5.15), "P25V": (25.75, 1.03), "N25V": (-25.75, 1.03)}
"""Guide p. 91: what can be programmed."""


@pytest.mark.parametrize("output", RATINGS)
@pytest.mark.parametrize("share", [0.0, 1.0])
def test_the_ends_of_what_can_be_programmed_are_sent(output: str, share: float) -> None:
    volts, amps = (share * end for end in RATINGS[output])
    exchanges: list[Exchange] = [
        FOUND_OFF,
        (f"OUTP:TRAC OFF;:INST:SEL {output};:CURR {amps:g};:VOLT {volts + 0.0:g}", None),
        NO_ERROR,
        ("VOLT?", f"{volts + 0.0:+.8E}"),
        ("CURR?", f"{amps:+.8E}"),
    ]
    with expected_exchange(OPEN, [*OPENING, *exchanges]) as supply:
        supply.configure_output(output, volts, amps)


@pytest.mark.parametrize("output", RATINGS)
def test_beyond_the_ends_nothing_is_sent(output: str) -> None:
    volts, amps = RATINGS[output]
    beyond = math.copysign(0.01, volts)
    with expected_exchange(OPEN, OPENING) as supply:
        for wrong_v, wrong_a in ((volts + beyond, amps), (-beyond, amps), (volts, amps + 0.01), (volts, -0.001)):
            with pytest.raises(LimitError):
                supply.configure_output(output, wrong_v, wrong_a)


@pytest.mark.parametrize(
    ("output", "step_v", "step_a"), [("P6V", 5e-4, 5e-4), ("P25V", 1.5e-3, 1e-4), ("N25V", 1.5e-3, 1e-4)]
)
@pytest.mark.parametrize(
    ("off_v", "off_a"), [(1.0, 1.0), (-1.0, -1.0), (1.1, 0.0), (-1.1, 0.0), (0.0, 1.1), (0.0, -1.1)]
)
def test_settings_agree_within_one_step(output: str, step_v: float, step_a: float, off_v: float, off_a: float) -> None:
    """Steps of the programming resolution, guide p. 186; read back so many of them off."""
    volts = math.copysign(5.0, RATINGS[output][0])
    exchanges: list[Exchange] = [
        FOUND_OFF,
        (f"OUTP:TRAC OFF;:INST:SEL {output};:CURR 0.1;:VOLT {volts:g}", None),
        NO_ERROR,
        ("VOLT?", f"{volts + off_v * step_v:+.8E}"),
        ("CURR?", f"{0.1 + off_a * step_a:+.8E}"),
    ]
    within = max(abs(off_v), abs(off_a)) <= 1.0
    sent = exchanges if abs(off_v) <= 1.0 else exchanges[:-1]
    expected = nullcontext() if within else pytest.raises(InstrumentError, match="reads back")
    with expected_exchange(OPEN, [*OPENING, *sent]) as supply, expected:
        supply.configure_output(output, volts, 0.1)


def test_measuring_an_output_that_is_none_sends_nothing() -> None:
    with expected_exchange(OPEN, OPENING) as supply:
        for measure in (supply.measure_voltage_v, supply.measure_current_a, supply.regulation):
            with pytest.raises(LimitError, match="there is no output 'P26V'"):
                measure("P26V")


@pytest.mark.parametrize(("output", "number"), [("P6V", 1), ("P25V", 2), ("N25V", 3)])
def test_output_reads_its_register_and_ignores_other_bits(output: str, number: int) -> None:
    """Bits 0 and 1 say how it is regulated (guide p. 118)."""
    with expected_exchange(OPEN, [*OPENING, (f"STAT:QUES:INST:ISUM{number}:COND?", "+22")]) as supply:
        assert supply.regulation(output) is Regulation.CONSTANT_VOLTAGE


def test_a_switch_that_stays_on_is_not_safe() -> None:
    attempt: list[Exchange] = [("OUTP OFF", None), NO_ERROR, ("OUTP?", "1")]
    with expected_exchange(OPEN, [*OPENING, BLIND, *attempt * 3, BLIND]) as supply:
        report = supply.make_safe(Deadline.after(supply.clock, 10.0))
        assert (report.safe, "the outputs stay on" in report.detail) == (False, True)


@pytest.mark.parametrize("live", ["P6V", "P25V", "N25V"])
def test_a_terminal_that_discharges_is_waited_for_whatever_its_sign(live: str) -> None:
    def measured(volts: float) -> list[Exchange]:
        return [(f"MEAS:VOLT? {name}", f"{volts if name == live else 0.0:+.8E}") for name in RATINGS]

    sign = -1.0 if live == "N25V" else 1.0
    safe: list[Exchange] = [("OUTP OFF", None), NO_ERROR, ("OUTP?", "0")]
    with expected_exchange(
        OPEN, [*OPENING, BLIND, *safe, *measured(5.0 * sign), *measured(0.2 * sign), *measured(-0.6 * sign)]
    ) as supply:
        begin_s = supply.clock.now()
        report = supply.make_safe(Deadline.after(supply.clock, 10.0))
        assert (report.safe, f"{live} {-0.6 * sign:+.3g} V" in report.detail) == (True, True)
        assert supply.clock.now() - begin_s == pytest.approx(0.2)
