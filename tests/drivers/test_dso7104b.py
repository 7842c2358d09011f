"""The DSO7104B's driver against what is known of its programmer's guide."""

from __future__ import annotations

import numpy as np
import pytest

from tests.drivers.openings import NO_ERROR, opening, taken_over
from vcfbench.clock import Deadline
from vcfbench.drivers.dso7104b import Dso7104B, Preamble
from vcfbench.errors import DeadlineExceeded, FramingError, InstrumentError, LimitError, MeasurementError
from vcfbench.testing import Exchange, expected_exchange, over_visa

OPENING = opening("AGILENT TECHNOLOGIES,DSO7104B,MY49520121,06.00.0003")
LEFT = taken_over(Dso7104B.left)
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


def left_of(channel: int) -> list[Exchange]:
    """What is said once of the oscilloscope, then of a channel."""
    return [*LEFT, *taken_over(Dso7104B.left_of_channel, source=f"CHAN{channel}", probe="1")]


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
    with expected_exchange(OPEN, [*OPENING, *left_of(2), *exchanges]) as scope:
        scope.configure_channel(2, 0.5, -0.1)


TRIGGER: list[Exchange] = [
    (":TRIG:MODE EDGE", None),
    (":TRIG:EDGE:SOUR CHAN2", None),
    (":TRIG:EDGE:SLOP POS", None),
    (":TRIG:EDGE:LEV 0.25", None),
    (":TRIG:SWE AUTO", None),
    NO_ERROR,
]
CHANNEL: list[Exchange] = [
    *((f":CHAN2:{each}", None) for each in ("DISP 1", "COUP DC", "IMP ONEM", "SCAL 0.5", "OFFS 0")),
    NO_ERROR,
]
RECORD: list[Exchange] = [(":ACQ:TYPE NORM", None), (":DIG CHAN2", None), ("*OPC?", "1"), NO_ERROR]


def test_timebase() -> None:
    timebase = [":TIM:MODE MAIN", ":TIM:REF CENT", ":TIM:SCAL 0.0002", ":TIM:POS 0"]
    with expected_exchange(OPEN, [*OPENING, *LEFT, *((each, None) for each in timebase), NO_ERROR]) as scope:
        scope.configure_timebase(200e-6)


def test_the_trigger_is_set_after_its_channel_and_read_back() -> None:
    level: Exchange = (":TRIG:EDGE:LEV?", "+2.50E-001")
    finer: list[Exchange] = [(sent.replace("SCAL 0.5", "SCAL 0.2"), answer) for sent, answer in CHANNEL]  # type: ignore[union-attr, arg-type]
    exchanges = [*left_of(2), *CHANNEL, *TRIGGER, level, *RECORD, *CHANNEL, *RECORD, *finer, *TRIGGER, level, *RECORD]
    with expected_exchange(OPEN, [*OPENING, *exchanges]) as scope:
        scope.configure_trigger(2, 0.25)
        scope.configure_channel(2, 0.5)
        scope.acquire(2)
        scope.configure_channel(2, 0.5)
        scope.acquire(2)  # it is set already
        scope.configure_channel(2, 0.2)
        scope.acquire(2)


@pytest.mark.parametrize("found", ["+0.00E+000", "+3.00E-002", "+2.30E-001", "-2.50E-001"])
def test_level_clipped_to_screen_is_error(found: str) -> None:
    exchanges = [*left_of(2), *CHANNEL, *TRIGGER, (":TRIG:EDGE:LEV?", found)]
    with expected_exchange(OPEN, [*OPENING, *exchanges]) as scope:
        scope.configure_channel(2, 0.5)
        scope.configure_trigger(2, 0.25)
        with pytest.raises(InstrumentError, match=r"was set to 0\.25 V but reads back"):
            scope.acquire(2)


def test_probe_factor_other_than_bench_files_is_refused() -> None:
    asked: list[Exchange] = [*LEFT, (":CHAN2:PROB?", "+1.00000E+001")]
    with expected_exchange(OPEN, [*OPENING, *asked]) as scope, pytest.raises(InstrumentError, match="probe factor"):
        scope.configure_channel(2, 0.5)


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


NONE = ("+9.9E+37", "-9.9E37", "9.91E37", "9.8999999999999999E+37", "1E400", "NAN", "INF", "")


@pytest.mark.parametrize(
    "preamble",
    [
        *("+0", ",".join("0" * 9), "4" + ",1" * 9, "0,0,1,1,0,1,1,1,1,1", "0,0,1,1,1,1,1,0,1,1", "0,0,0,1,1,1,1,1,1,1"),
        *(",".join(["0,0", *("1" * field), none, *("1" * (7 - field))]) for field in range(8) for none in NONE),
    ],
)
def test_preambles_that_are_none(preamble: str) -> None:
    with (
        expected_exchange(OPEN, [*OPENING, *DOWNLOAD[:-1], (":WAV:PRE?", preamble)]) as scope,
        pytest.raises(FramingError, match=r"^oscilloscope at SCRIPT: expected .*, got .*, command ':WAV:PRE\?'"),
    ):
        scope.waveform(1)


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


@pytest.mark.parametrize("scale", [2e-3, 5e3])
def test_the_ends_of_the_vertical_scale_are_sent(scale: float) -> None:
    """2 mV/div, and 5 V/div at a probe of 1000:1; the offset is 0 unless it is told."""
    setting = ["DISP 1", "COUP DC", "IMP ONEM", f"SCAL {scale:g}", "OFFS 0"]
    with expected_exchange(
        OPEN, [*OPENING, *left_of(4), *((f":CHAN4:{each}", None) for each in setting), NO_ERROR]
    ) as scope:
        scope.configure_channel(4, scale)


@pytest.mark.parametrize("scale", [500e-12, 50.0])
def test_the_ends_of_the_time_base_are_sent(scale: float) -> None:
    setting = ["MODE MAIN", "REF CENT", f"SCAL {scale:g}", "POS 0"]
    with expected_exchange(OPEN, [*OPENING, *LEFT, *((f":TIM:{each}", None) for each in setting), NO_ERROR]) as scope:
        scope.configure_timebase(scale)


def test_scales_it_does_not_have_are_not_sent() -> None:
    with expected_exchange(OPEN, OPENING) as scope:
        for volts in (1.9e-3, 5.1e3, -1.0, float("nan")):
            with pytest.raises(LimitError, match="scale of channel 2"):
                scope.configure_channel(2, volts)
        for seconds in (4.9e-10, 51.0, -1.0, float("nan")):
            with pytest.raises(LimitError, match="time base"):
                scope.configure_timebase(seconds)
        for points in (99, 8_000_001):
            with pytest.raises(LimitError, match="number of points"):
                scope.waveform(1, points)


@pytest.mark.parametrize(("scale_s", "waits_s"), [(None, 1.0 + 1.0 + 2e-3), (0.5, 1.0 + 1.0 + 10.0)])
def test_record_is_waited_for_twice_its_length(scale_s: float | None, waits_s: float) -> None:
    """Ten divisions, twice; a second for the automatic trigger, and the time-out of 1 s. After a reset, 100 us/div."""
    timebase = [":TIM:MODE MAIN", ":TIM:REF CENT", ":TIM:SCAL 0.5", ":TIM:POS 0"]
    before: list[Exchange] = [] if scale_s is None else [*LEFT, *((each, None) for each in timebase), NO_ERROR]
    record: list[Exchange] = [(":ACQ:TYPE NORM", None), (":DIG CHAN1", None), ("*OPC?", None)]
    with expected_exchange(OPEN, [*OPENING, *before, *record]) as scope:
        if scale_s is not None:
            scope.configure_timebase(scale_s)
        begin_s = scope.clock.now()
        with pytest.raises(DeadlineExceeded):
            scope.acquire(1)
        assert scope.clock.now() - begin_s == pytest.approx(waits_s, rel=1e-6)


def test_what_a_record_was_refused_for_is_raised() -> None:
    record: list[Exchange] = [(":ACQ:TYPE NORM", None), (":DIG CHAN1", None), ("*OPC?", "1")]
    with (
        expected_exchange(OPEN, [*OPENING, *record, ("SYST:ERR?", '-221,"Settings conflict"'), NO_ERROR]) as scope,
        pytest.raises(InstrumentError, match="-221"),
    ):
        scope.acquire(1)


def test_long_records_are_given_the_time_that_they_take() -> None:
    """250 kB/s beside the time-out of 1 s."""
    exchanges: list[Exchange] = [*DOWNLOAD[:3], (":WAV:POIN:MODE RAW", None), (":WAV:POIN 1000000", None), NO_ERROR]
    exchanges += [(":WAV:PRE?", PREAMBLE.replace("+1000", "+1000000")), (":WAV:DATA?", None)]
    with expected_exchange(OPEN, [*OPENING, *exchanges]) as scope:
        begin_s = scope.clock.now()
        with pytest.raises(DeadlineExceeded):
            scope.waveform(1, 1_000_000)
        assert scope.clock.now() - begin_s == pytest.approx(1.0 + 4.0)


def test_instants_count_from_the_reference_point() -> None:
    """Steps from the reference, and the origin: (i - reference) step + origin."""
    preamble = Preamble.parse("0,0,3,1,2,5,1,0.5,10,100")
    waveform = preamble.waveform(np.array([98, 100, 102], np.uint8))
    assert waveform.time_s.tolist() == [3.0, 5.0, 7.0]
    assert waveform.voltage_v.tolist() == [9.0, 10.0, 11.0]


@pytest.mark.parametrize(("points", "mode"), [(100, "NORM"), (1000, "NORM"), (1001, "RAW")])
def test_beyond_a_thousand_points_the_memory_is_read(points: int, mode: str) -> None:
    exchanges: list[Exchange] = [
        *DOWNLOAD[:3],
        (f":WAV:POIN:MODE {mode}", None),
        (f":WAV:POIN {points}", None),
        NO_ERROR,
        (":WAV:PRE?", PREAMBLE.replace("+1000", f"+{points}")),
        (":WAV:DATA?", block(b"\x80" * points)),
    ]
    with expected_exchange(OPEN, [*OPENING, *exchanges]) as scope:
        assert scope.waveform(1, points).voltage_v.tolist() == [pytest.approx(0.0125)] * points
