"""The DSO7104B's driver against what is known of its programmer's guide."""

from __future__ import annotations

import numpy as np
import pytest

from tests.drivers.openings import NO_ERROR, opening
from vcfbench.clock import Deadline
from vcfbench.drivers.dso7104b import Dso7104B, Preamble
from vcfbench.errors import FramingError, InstrumentError, LimitError, MeasurementError
from vcfbench.testing import Exchange, expected_exchange, over_visa

OPENING = opening("AGILENT TECHNOLOGIES,DSO7104B,MY49520121,06.00.0003")
OPEN = over_visa(Dso7104B, name="oscilloscope")

# A live preamble of the 6000 series: 1000 points, 20 ns/div, 1 V/div, offset 12.5 mV.
PREAMBLE = "+0,+0,+1000,+1,+2.00000000E-010,-1.00000000E-007,+0,+3.12500000E-002,+1.25000000E-002,+128"
DOWNLOAD: list[Exchange] = [
    (":WAV:SOUR CHAN1", None),
    (":WAV:FORM BYTE", None),
    (":WAV:UNS 1", None),
    (":WAV:POIN:MODE NORM", None),
    (":WAV:POIN 1000", None),
    NO_ERROR,
    (":WAV:PRE?", PREAMBLE),
]


def block(data: bytes) -> bytes:
    return f"#8{len(data):08d}".encode() + data + b"\n"


def test_channel() -> None:
    exchanges: list[Exchange] = [
        (":CHAN2:DISP 1", None),
        (":CHAN2:COUP DC", None),
        (":CHAN2:IMP ONEM", None),
        (":CHAN2:SCAL 0.5", None),
        (":CHAN2:OFFS -0.1", None),
        NO_ERROR,
    ]
    with expected_exchange(OPEN, [*OPENING, *exchanges]) as scope:
        scope.configure_channel(2, 0.5, -0.1)


def test_timebase_and_trigger() -> None:
    exchanges: list[Exchange] = [
        (":TIM:MODE MAIN", None),
        (":TIM:REF CENT", None),
        (":TIM:SCAL 0.0002", None),
        (":TIM:POS 0", None),
        NO_ERROR,
        (":TRIG:MODE EDGE", None),
        (":TRIG:EDGE:SOUR CHAN1", None),
        (":TRIG:EDGE:SLOP POS", None),
        (":TRIG:EDGE:LEV 0", None),
        (":TRIG:SWE AUTO", None),
        NO_ERROR,
    ]
    with expected_exchange(OPEN, [*OPENING, *exchanges]) as scope:
        scope.configure_timebase(200e-6)
        scope.configure_trigger(1)


def test_a_record_is_digitized_and_waited_for() -> None:
    exchanges: list[Exchange] = [(":ACQ:TYPE NORM", None), (":DIG CHAN1,CHAN3", None), ("*OPC?", "1"), NO_ERROR]
    with expected_exchange(OPEN, [*OPENING, *exchanges]) as scope:
        scope.acquire(1, 3)


def test_measurements() -> None:
    exchanges: list[Exchange] = [
        (":MEAS:FREQ? CHAN1", "+3.48890000E+003"),
        (":MEAS:VPP? CHAN1", "+2.50000000E+000"),
        (":MEAS:PHAS? CHAN2,CHAN1", "+9.00000000E+001"),
        (":MEAS:PHAS? CHAN2,CHAN1", "+2.70000000E+002"),
        (":MEAS:PHAS? CHAN2,CHAN1", "-1.80000000E+002"),
    ]
    with expected_exchange(OPEN, [*OPENING, *exchanges]) as scope:
        assert scope.measure_frequency_hz(1) == 3488.9
        assert scope.measure_amplitude_v(1) == 1.25
        assert scope.measure_phase_deg(2, 1) == 90.0
        assert scope.measure_phase_deg(2, 1) == -90.0
        assert scope.measure_phase_deg(2, 1) == 180.0


def test_what_cannot_be_measured_is_no_number() -> None:
    with (
        expected_exchange(OPEN, [*OPENING, (":MEAS:FREQ? CHAN1", "+9.9E+37")]) as scope,
        pytest.raises(MeasurementError, match="not measurable"),
    ):
        scope.measure_frequency_hz(1)


def test_waveform_in_volts_and_seconds() -> None:
    codes = np.full(1000, 128, np.uint8)
    codes[:3] = 2, 254, 0x0A  # the newline among the data is data
    with expected_exchange(OPEN, [*OPENING, *DOWNLOAD, (":WAV:DATA?", block(codes.tobytes()))]) as scope:
        waveform = scope.waveform(1)
    assert waveform.time_s[[0, 500, 999]] == pytest.approx([-100e-9, 0.0, 99.8e-9], abs=1e-15)
    expected_v = [(2 - 128) * 0.03125 + 0.0125, (254 - 128) * 0.03125 + 0.0125, (10 - 128) * 0.03125 + 0.0125, 0.0125]
    assert waveform.voltage_v[:4] == pytest.approx(expected_v)


@pytest.mark.parametrize(("code", "words"), [(0, "1 are missing"), (1, "1 of 1000"), (255, "1 of 1000")])
def test_clipped_and_missing_points_are_not_handed_out(code: int, words: str) -> None:
    codes = np.full(1000, 128, np.uint8)
    codes[7] = code
    with (
        expected_exchange(OPEN, [*OPENING, *DOWNLOAD, (":WAV:DATA?", block(codes.tobytes()))]) as scope,
        pytest.raises(MeasurementError, match=words),
    ):
        scope.waveform(1)


def test_a_record_of_another_length_than_promised_is_an_error() -> None:
    with (
        expected_exchange(OPEN, [*OPENING, *DOWNLOAD, (":WAV:DATA?", block(b"\x80" * 999))]) as scope,
        pytest.raises(FramingError, match="999 came"),
    ):
        scope.waveform(1)


def test_long_records_are_raw() -> None:
    exchanges: list[Exchange] = [*DOWNLOAD[:3], (":WAV:POIN:MODE RAW", None), (":WAV:POIN 100000", None), NO_ERROR]
    preamble = PREAMBLE.replace("+1000", "+100000")
    exchanges += [(":WAV:PRE?", preamble), (":WAV:DATA?", block(b"\x80" * 100_000))]
    with expected_exchange(OPEN, [*OPENING, *exchanges]) as scope:
        assert scope.waveform(1, 100_000).voltage_v.shape == (100_000,)


@pytest.mark.parametrize("fields", [(0.0,) * 9, (1.0, *(1.0,) * 9), (0.0, 0.0, 1.0, 1.0, 0.0, *(1.0,) * 5)])
def test_preambles_that_are_none(fields: tuple[float, ...]) -> None:
    with pytest.raises(FramingError):
        Preamble.parse(fields)


def test_channels_it_does_not_have_are_not_sent() -> None:
    with expected_exchange(OPEN, OPENING) as scope, pytest.raises(LimitError, match="no channel 5"):
        scope.acquire(1, 5)


def test_safe_is_stopped() -> None:
    with expected_exchange(OPEN, [*OPENING, (":STOP", None), NO_ERROR, (":OPER:COND?", "+32")]) as scope:
        assert scope.make_safe(Deadline.after(scope.clock, 3.0)).safe


def test_running_is_not_safe() -> None:
    with expected_exchange(OPEN, [*OPENING, *[(":STOP", None), NO_ERROR, (":OPER:COND?", "+8")] * 3]) as scope:
        report = scope.make_safe(Deadline.after(scope.clock, 3.0))
        assert not report.safe
        assert "keeps running" in report.detail


def test_running_is_an_instrument_error() -> None:
    with (
        expected_exchange(OPEN, [*OPENING, ("SYST:ERR?", '-113,"Undefined header"'), NO_ERROR]) as scope,
        pytest.raises(InstrumentError),
    ):
        scope.check_errors()
