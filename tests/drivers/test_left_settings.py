"""What a last user has left: with each other value of each setting a driver is right, or refuses it by its name."""

from __future__ import annotations

from contextlib import suppress
from typing import TYPE_CHECKING, Any

import pytest
from msgspec import Struct
from msgspec.structs import replace
from simrack.sources import Drive

from tests.drivers.boxes import GENERATORS, INPUT_V, METERS, SCOPES, SINE, box
from vcfbench.clock import sleep
from vcfbench.drivers.agilent33220a import Agilent33220A
from vcfbench.drivers.dso7104b import Dso7104B
from vcfbench.drivers.e36312a import E36312A
from vcfbench.errors import BenchError, InstrumentError

if TYPE_CHECKING:
    from tests.drivers.boxes import Box


class Left(Struct, frozen=True):
    """What was typed, which of it the refusal names where it is no driver's to set, and whether it changes a number."""

    words: tuple[str, ...]
    named: str = ""
    idle: bool = False
    """Nothing of it is to be seen, even where it stays."""


def left(*words: str, named: str = "", idle: bool = False) -> Left:
    return Left(words, named, idle)


_OF_ALL = (left("REAR", named="terminals"), left("60 HZ", named="mains_hz", idle=True))
_CONFIGURED = (
    *(left(f"CONF:VOLT:DC {volts}", idle=True) for volts in ("0.1", "1000")),
    left("CONF:RES", idle=True),
    left("CONF:VOLT:AC", idle=True),
    left("CONF:FREQ", idle=True),
)
_TRIGGERS = (
    *(left(f"TRIG:SOUR {source}", idle=True) for source in ("BUS", "EXT")),
    *(left(words, idle=True) for words in ("TRIG:DEL 5", "TRIG:COUN 3", "SAMP:COUN 7", "TRIG:DEL:AUTO OFF")),
)
_HP = (
    *_CONFIGURED,
    *_TRIGGERS,
    *(left(f"CALC:FUNC {word};:CALC:STAT ON", idle=True) for word in ("NULL", "DB", "DBM", "AVER", "LIM")),
    left("INP:IMP:AUTO ON", idle=True),
    left("ZERO:AUTO OFF", idle=True),
    left("DET:BAND 3", idle=True),
    left("DISP OFF", idle=True),
    left("VOLT:DC:RANG:AUTO ON", idle=True),
    left('DATA:FEED RDG_STORE,""', idle=True),
)
_TRUEVOLT = (
    *_CONFIGURED,
    *_TRIGGERS,
    left("CALC:SCAL:FUNC SCAL;GAIN 2;OFFS 0;:CALC:SCAL:STAT ON"),
    left("CALC:SCAL:FUNC SCAL;GAIN 1;OFFS 0.5;:CALC:SCAL:STAT ON"),
    *(left(f"CALC:SCAL:FUNC {word};REF 1;:CALC:SCAL:STAT ON") for word in ("DB", "DBM", "PCT", "NULL")),
    *(left(f"CALC:{each}:STAT ON", idle=True) for each in ("LIM", "AVER")),
    left("FORM REAL", idle=True),
    left("VOLT:DC:NULL ON;NULL:VAL 1", idle=True),
    left("VOLT:DC:IMP:AUTO ON", idle=True),
    left("VOLT:DC:ZERO:AUTO OFF", idle=True),
    left("VOLT:DC:RANG:AUTO ON", idle=True),
    left("DISP OFF", idle=True),
)
_2000 = (
    *(left(f"CONF:{each}", idle=True) for each in ("RES", "VOLT:AC", "FREQ", "TEMP")),
    *(left(f"TRIG:SOUR {source}", idle=True) for source in ("BUS", "EXT")),
    *(left(words, idle=True) for words in ("TRIG:DEL 5", "TRIG:COUN 3", "SAMP:COUN 7", "TRIG:DEL:AUTO OFF")),
    left("INIT:CONT ON", idle=True),
    left("CALC:FORM MXB;KMAT:MMF 2;MBF 0;:CALC:STAT ON"),
    left("CALC:FORM MXB;KMAT:MMF 1;MBF 0.5;:CALC:STAT ON"),
    left("CALC:FORM PERC;KMAT:PERC 1;:CALC:STAT ON"),
    left("UNIT:VOLT:DC DB"),
    left("UNIT:VOLT:DC DBM"),
    left("HOLD:STAT ON"),
    left("VOLT:REF 1;REF:STAT ON", idle=True),
    left("VOLT:AVER:TCON MOV;COUN 100;STAT ON", idle=True),
    left("VOLT:DIG 4", idle=True),
    left("SYST:AZER:STAT OFF", idle=True),
    left("FORM:ELEM READ,UNIT,RNUM"),
    left("TRAC:POIN 2;FEED CALC;FEED:CONT NEXT", idle=True),
)
_DMM6500 = (
    *(left(f'FUNC "{each}"', idle=True) for each in ("RES", "VOLT:AC", "FREQ:VOLT", "TEMP", "VOLT:DC:RAT")),
    left("CALC:VOLT:MATH:FORM MXB;MMF 2;MBF 0;STAT ON"),
    left("CALC:VOLT:MATH:FORM MXB;MMF 1;MBF 0.5;STAT ON"),
    left("CALC:VOLT:MATH:FORM PERC;PERC 1;STAT ON"),
    left("CALC:VOLT:MATH:FORM REC;STAT ON"),
    left("VOLT:UNIT DB"),
    left("VOLT:UNIT DBM"),
    left("VOLT:REL 1;REL:STAT ON"),
    left("VOLT:AVER:TCON MOV;COUN 100;STAT ON", idle=True),
    left("VOLT:LINE:SYNC ON", idle=True),
    left("VOLT:DEL:AUTO OFF", idle=True),
    left("VOLT:INP AUTO", idle=True),
    left("VOLT:AZER OFF", idle=True),
    left('DIG:FUNC "VOLT"', idle=True),
    left("FORM:ASC:PREC 1"),
    left("COUN 5", idle=True),
    left('TRAC:POIN 10,"defbuffer1"'),
    left('TRAC:FILL:MODE ONCE,"defbuffer1";:TRAC:POIN 10,"defbuffer1";:COUN 10;:TRAC:TRIG "defbuffer1"'),
)
OF_METERS = {"34401A": _HP, "34461A": _TRUEVOLT, "34465A": _TRUEVOLT, "2000": _2000, "DMM6500": _DMM6500}
EXTRA = {"34465A": (left("CALC:SMO:RESP SLOW;STAT ON", idle=True), left("SAMP:SOUR TIM;TIM 2", idle=True))}
CELLS = [
    (model, each)
    for model in METERS
    for each in (*OF_METERS[model], *EXTRA.get(model, ()), *_OF_ALL)
    if (model, each.words) != ("34401A", ("60 HZ",))  # which it cannot be asked for
]


_MODULATED = ("AM:DEPT 50;INT:FREQ 7;:AM:STAT ON", "FM:DEV 10;STAT ON", "PM:DEV 90;STAT ON", "FSK:FREQ 50;STAT ON")
_OF_A_SINE = (
    *(left("FUNC SIN", each) for each in _MODULATED),
    left("FUNC PULS", "PWM:STAT ON"),
    left("FUNC SIN", "FREQ:STAR 1;STOP 1000;:SWE:STAT ON"),
    left("FUNC SIN", "BURS:NCYC 1;INT:PER 1;:BURS:STAT ON"),
    left("FUNC SIN", "TRIG:SOUR BUS;:BURS:NCYC 5;STAT ON"),
)
_GENERATOR = (
    *_OF_A_SINE,
    left("OUTP:POL INV"),
    left("VOLT:OFFS 0", "VOLT:RANG:AUTO OFF", "FUNC DC", "VOLT:OFFS 5", "VOLT:RANG:AUTO OFF"),
    left("VOLT:UNIT DBM"),
    left("VOLT:UNIT VRMS", idle=True),
    left("OUTP:LOAD 50", idle=True),
    left("OUTP:LOAD 1000", "VOLT:OFFS 1", idle=True),
    left("OUTP:SYNC OFF", idle=True),
    left("OUTP:TRIG ON", idle=True),
    left("UNIT:ANGL RAD", idle=True),
    left("FUNC NOIS", "OUTP ON"),
    left("FUNC SIN", "VOLT 5", "OUTP ON"),
    *(left(f"FUNC {each}", idle=True) for each in ("SQU", "RAMP", "PULS", "USER", "DC")),
)
_TRUEFORM = (
    *_OF_A_SINE,
    left("FUNC SIN", "BPSK:STAT ON"),
    left("FUNC SIN", "SUM:AMPL 20;INT:FREQ 50;:SUM:STAT ON"),
    left("OUTP1:LOAD INF", "VOLT:LIM:HIGH 1;LOW -1;STAT ON"),
    left("OUTP1:LOAD 50", "VOLT:LIM:HIGH 1;LOW -1;STAT ON"),
    left("OUTP1:POL INV"),
    left("OUTP1:MODE GAT"),
    left("VOLT:RANG:AUTO OFF"),
    left("FREQ:MODE LIST", idle=True),
    left("VOLT:UNIT DBM", idle=True),
    left("VOLT:UNIT VRMS", idle=True),
    *(left(f"OUTP2:LOAD INF;:SOUR2:FUNC {each};VOLT:OFFS 1;:SOUR1:COMB:FEED CH2") for each in ("DC", "SIN")),
    *(left(f"SOUR{n}:TRAC {each}") for n, each in ((1, "ON"), (1, "INV"))),
    left("SOUR1:VOLT:COUP:STAT ON"),
    left("SOUR1:FREQ:COUP:STAT ON"),
    left("FUNC SIN", "VOLT 5", "OUTP1 ON"),
    *(left(f"FUNC {each}", idle=True) for each in ("SQU", "RAMP", "TRI", "PULS", "ARB", "PRBS", "DC")),
)
OF_GENERATORS = [
    (model, each) for model, cells in zip(GENERATORS, (_GENERATOR, _TRUEFORM), strict=True) for each in cells
]


def leave(of: Box, cell: Left) -> None:
    for words in cell.words:
        if words == "REAR":
            of.device.rear = True  # type: ignore[attr-defined]
        elif words == "60 HZ":
            of.device.line_hz = 60  # type: ignore[attr-defined]
        else:
            of.say(words)


def read(meter: Any) -> list[float]:
    """Take single readings, then a burst, at its first try."""
    meter.configure_dc_voltage(10.0, 1.0)
    single_v = [meter.read_voltage_v() for _ in range(3)]
    lasts_s = meter.start_sampling(20, 0.05)
    sleep(meter.clock, lasts_s)
    return [*single_v, *meter.sampled_voltages_v()]


def is_right(of: Box, cell: Left) -> bool:
    """Tell whether the readings are the input's; one that is refused by its name counts."""
    leave(of, cell)
    with of.driven(mains_hz=50.0) as meter:
        try:
            readings_v = read(meter)
        except InstrumentError as error:
            return bool(cell.named) and cell.named in str(error)
    return not cell.named and all(abs(each - INPUT_V) < 1e-4 for each in readings_v)


@pytest.mark.parametrize(("model", "cell"), CELLS, ids=lambda each: each if isinstance(each, str) else each.words[0])
def test_a_meter_is_right_whatever_was_left(model: str, cell: Left) -> None:
    assert is_right(box(model), cell)


@pytest.mark.parametrize(
    ("model", "cell"),
    [each for each in CELLS if not each[1].idle],
    ids=lambda each: each if isinstance(each, str) else each.words[0],
)
def test_what_is_left_is_seen_without_the_table(model: str, cell: Left, monkeypatch: pytest.MonkeyPatch) -> None:
    """Of a setting that changes nothing here the test above could not fail."""
    of = box(model)
    leave(of, cell)
    with of.driven(mains_hz=50.0) as meter:
        monkeypatch.setattr(type(meter), "left", ())
        try:
            wrong = any(abs(each - INPUT_V) > 1e-4 for each in read(meter))
        except BenchError:
            wrong = True
    assert wrong


def put_out(of: Box, cell: Left | None) -> list[Any]:
    """Return what comes out at a first try: nothing before it is switched on, a level, a sine; the other channel."""
    if cell is not None:
        leave(of, cell)
    device: Any = of.device
    with of.driven() as generator:
        seen: list[Any] = [generator.configure_dc(2.5), device._driven]
        generator.enable_output()
        sleep(of.clock, 1.0)
        seen += [device._driven, generator.set_dc(0.02), device._driven, device.state.range]
        generator.configure_sine(1234.0, 2.0, 1.0)
        seen += [type(device._driven), device.state.polarity, device.state.mode]
        if isinstance(device._driven, Drive):
            seen += [replace(device._driven, phase_rad=0.0)]
        second = getattr(device, "second", None)
        seen += [] if second is None else [second.state.frequency_hz, second.state.vpp, second.state.offset_v]
    return seen


@pytest.mark.parametrize(
    ("model", "cell"), OF_GENERATORS, ids=lambda each: each if isinstance(each, str) else each.words[-1]
)
def test_a_generator_puts_out_the_same_whatever_was_left(model: str, cell: Left) -> None:
    clean = box(model)
    if "SOUR2" in cell.words[0]:  # the other channel may be as it was
        clean.say(cell.words[0].replace(";:SOUR1:COMB:FEED CH2", ""))
    assert put_out(box(model), cell) == put_out(clean, None)


@pytest.mark.parametrize(
    ("model", "cell"),
    [each for each in OF_GENERATORS if not each[1].idle],
    ids=lambda each: each if isinstance(each, str) else each.words[-1],
)
def test_what_is_left_in_a_generator_is_seen_without_the_table(
    model: str, cell: Left, monkeypatch: pytest.MonkeyPatch
) -> None:
    clean = put_out(box(model), None)
    of = box(model)
    monkeypatch.setattr(Agilent33220A, "_take_over", lambda generator, _left: generator._taken_over.add("nothing"))
    monkeypatch.setattr(Agilent33220A, "_switch", _switch_where_asked)
    try:
        wrong = put_out(of, cell) != clean
    except InstrumentError:
        wrong = True
    assert wrong


def _switch_where_asked(generator: Any, wanted: str, deadline: Any = None) -> None:
    if generator._configured or deadline is not None:
        generator._session.write(f"{generator.output} {wanted.upper()}")


OF_SCOPES = [
    (model, cell)
    for model in SCOPES
    for cell in (
        left(":CHAN1:INV 1"),
        left(":CHAN1:PROB 10", named="probe factor"),
        left(":CHAN1:UNIT AMP", idle=True),
        left(":CHAN1:BWL 1", idle=True),
        left(":CHAN1:PROB:SKEW 1E-7", idle=True),
        left(":CHAN1:COUP AC", idle=True),
        left(":CHAN1:OFFS 3", idle=True),
        left(":CHAN1:SCAL 0.01;OFFS 0.04", idle=True),
        left(":CHAN3:DISP 1;:CHAN4:DISP 1", idle=True),
        left(":ACQ:MODE SEGM", idle=True),
        left(":ACQ:MODE ETIM", idle=True),
        left(":ACQ:TYPE AVER;COUN 4096", idle=True),
        left(":ACQ:TYPE PEAK", idle=True),
        *(left(f":TIM:MODE {each}", idle=True) for each in ("WIND", "XY", "ROLL")),
        *(left(f":TIM:REF {each}", idle=True) for each in ("LEFT", "RIGH")),
        left(":TIM:POS 1E-3", idle=True),
        *(left(f":TRIG:MODE {each}", idle=True) for each in ("GLIT", "TV")),
        left(":TRIG:SWE NORM", idle=True),
        left(":TRIG:EDGE:SOUR EXT;SLOP NEG", idle=True),
        left(":TRIG:HOLD 5"),
        left(":TRIG:EDGE:COUP AC"),
        left(":TRIG:EDGE:REJ LF", idle=True),
        left(":TRIG:HFR 1", idle=True),
        left(":TRIG:NREJ 1", idle=True),
        left(":MEAS:DEF THR,ABS,0.3,0.2,0.1", idle=True),
        left(":WAV:VIEW ALL", idle=True),
        left(":WAV:BYT MSBF;FORM WORD;UNS 0", idle=True),
        left(":FUNC:DISP 1", idle=True),
        left(":RUN", idle=True),
        left(":SYST:LOCK 1", idle=True),
    )
]
CLIPPED = left(":CHAN1:SCAL 0.01;OFFS 0.5")
"""With it a level of 0.5 V is not on the screen until the channel is set."""


def seen_by(of: Box, cell: Left) -> list[float]:
    """Return what a first record tells: frequency, amplitude, volts and times of two samples; and its bench time."""
    leave(of, cell)
    with of.driven() as scope:
        begun_s = of.clock.now()
        scope.configure_timebase(2e-4)
        scope.configure_trigger(1, 0.5)
        scope.configure_channel(1, 1.0)
        scope.configure_channel(2, 1.0)
        scope.acquire(1, 2)
        record = scope.waveform(1)
        scope.acquire_mean(16, 1, 2)
        told = [
            scope.measure_frequency_hz(1),
            scope.measure_amplitude_v(1),
            scope.measure_phase_deg(1, 2),
            float(record.voltage_v[500]),
            float(record.voltage_v[600]),
            float(record.time_s[500]),
            float(record.time_s[600]),
            float(record.time_s.size),
        ]
        return [*told, float(of.clock.now() - begun_s < 1.0)]


RIGHT = [1e3, SINE.amplitude_v, 0.0, 0.5, 2.2, 0.0, 2e-4, 1000.0, 1.0]
WITHIN = [2.0, 0.1, 2.0, 0.2, 0.3, 5e-6, 5e-6, 0.0, 0.0]


def is_seen_right(of: Box, cell: Left) -> bool:
    try:
        seen = seen_by(of, cell)
    except InstrumentError as error:
        return bool(cell.named) and cell.named in str(error)
    return not cell.named and all(
        abs(each - right) <= within for each, right, within in zip(seen, RIGHT, WITHIN, strict=True)
    )


@pytest.mark.parametrize(
    ("model", "cell"),
    [*OF_SCOPES, *((model, CLIPPED) for model in SCOPES)],
    ids=lambda each: each if isinstance(each, str) else each.words[0],
)
def test_an_oscilloscope_is_right_whatever_was_left(model: str, cell: Left) -> None:
    assert is_seen_right(box(model), cell)


@pytest.mark.parametrize(
    ("model", "cell"),
    [each for each in OF_SCOPES if not each[1].idle],
    ids=lambda each: each if isinstance(each, str) else each.words[0],
)
def test_what_is_left_in_an_oscilloscope_is_seen_without_the_table(
    model: str, cell: Left, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(Dso7104B, "left", ())
    monkeypatch.setattr(Dso7104B, "left_of_channel", ())
    with suppress(BenchError):
        assert not is_seen_right(box(model), replace(cell, named=""))


OF_SUPPLIES = [
    *(
        ("E3631A", cell)
        for cell in (
            left("OUTP:TRAC ON", idle=True),
            left("INST:SEL P25V;:VOLT 20;:CURR 1;:OUTP ON", idle=True),
            left("INST:SEL P6V;:VOLT 5;:CURR 5;:OUTP ON", idle=True),
            left("VOLT:TRIG 3;:TRIG:SOUR BUS;:INIT", idle=True),
            left("INST:COUP:TRIG ALL", idle=True),
            left("DISP OFF", idle=True),
        )
    ),
    *(
        ("E36312A", cell)
        for cell in (
            left("VOLT:PROT 6,(@2);:VOLT:PROT:STAT ON,(@2)"),
            left("VOLT:PROT 6,(@2);:VOLT:PROT:STAT ON,(@2);:VOLT 8,(@2);:OUTP ON,(@2)"),
            left("CURR:PROT:STAT ON,(@2)", idle=True),
            left("OUTP:DEL:RISE 5,(@2)"),
            left("OUTP:DEL:RISE 3600,(@1,2,3)"),
            left("OUTP:PAIR SER"),
            left("OUTP:PAIR PAR"),
            left("OUTP:TRAC ON"),
            left("OUTP:COUP:CHAN ALL"),
            left("OUTP:COUP:CHAN CH1,CH2"),
            left("VOLT:SENS EXT,(@2)"),
            left("VOLT 20,(@2);:CURR 1,(@2);:OUTP ON,(@1,2)"),
            left("INST:SEL CH3", idle=True),
        )
    ),
]


def supplied_by(of: Box, cell: Left) -> list[float]:
    """Return what the outputs measure while they are set and are on; and whether one was on amid the setting."""
    leave(of, cell)
    with of.driven() as supply:
        supply.configure_output("P25V", 10.0, 0.1)
        amid = supply.outputs_enabled()
        supply.configure_output("N25V", -9.0, 0.1)
        supply.enable_outputs()
        sleep(of.clock, 1.0)
        levels = [supply.measure_voltage_v(output) for output in ("P25V", "N25V", "P6V")]
        rails = [of.world.value_v(f"rail_{side}") for side in ("positive", "negative")]
        return [*levels, *rails, float(amid)]


SUPPLIED = [10.0, -9.0, 0.0, 10.0, -9.0, 0.0]


@pytest.mark.parametrize(
    ("model", "cell"), OF_SUPPLIES, ids=lambda each: each if isinstance(each, str) else each.words[0]
)
def test_a_supply_gives_the_rails_whatever_was_left(model: str, cell: Left) -> None:
    assert supplied_by(box(model), cell) == pytest.approx(SUPPLIED, abs=0.02)


@pytest.mark.parametrize(
    ("model", "cell"),
    [each for each in OF_SUPPLIES if not each[1].idle],
    ids=lambda each: each if isinstance(each, str) else each.words[0],
)
def test_what_is_left_in_a_supply_is_seen_without_the_table(
    model: str, cell: Left, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(E36312A, "left", ())
    monkeypatch.setattr(E36312A, "_found_off", True)
    with suppress(BenchError):
        assert supplied_by(box(model), cell) != pytest.approx(SUPPLIED, abs=0.02)


@pytest.mark.parametrize(
    "cell",
    [
        left("DUTM 1", idle=True),
        left("FLOW 1", idle=True),
        left("SETN 2", idle=True),
        left("RAMP 1", idle=True),
        left("ULIM 60", named="SETP 80"),
        left("DSNS 1", idle=True),
    ],
    ids=lambda each: each.words[0],
)
def test_a_stream_of_air_is_set_whatever_was_left(cell: Left) -> None:
    of = box("ATS-545")
    leave(of, cell)
    device: Any = of.device
    with of.driven() as chamber:
        if cell.named:
            with pytest.raises(InstrumentError, match=cell.named):
                chamber.set_temperature(80.0, 50.0)
            return
        chamber.set_temperature(80.0, 50.0)
        assert not device.flow
        assert not device.settings.device_mode
        chamber.enable_flow()
        sleep(of.clock, 600.0)
        assert chamber.air_temperature_c() == pytest.approx(80.0, abs=0.2)
