"""What an InfiniiVision X has beside a DSO7104B: voltmeter, annotation, digital channels of an MSO."""

from __future__ import annotations

import math

import pytest
from simrack.instruments.infiniivision import InfiniiVisionXTwin, XSeriesErrors

from simrack_tests.instruments.dso7104b.bench import Bench, F


def bench_of(model: str) -> Bench:
    return Bench(XSeriesErrors.none(), InfiniiVisionXTwin.of_model(model))


@pytest.mark.parametrize(
    ("mode", "channel", "expected"),
    [
        ("DC", 1, 0.1),
        ("ACRM", 1, 1.5 / math.sqrt(2.0)),
        ("DCRM", 1, math.hypot(0.1, 1.5 / math.sqrt(2.0))),
        ("DC", 3, 0.25),
        ("ACRM", 3, 0.0),
    ],
)
def test_voltmeter_reads_screen_to_three_digits(mode: str, channel: int, expected: float) -> None:
    bench = bench_of("DSOX3024A")
    bench.send(f":CHAN{channel}:DISP ON;SCAL 0.5;:TIM:SCAL 1E-3;:DVM:SOUR CHAN{channel};MODE {mode}")
    assert bench.ask(":DVM:CURR?") == "+9.900000000000E+37"  # switched off
    bench.send(":DVM:ENAB ON")
    reading = bench.number(":DVM:CURR?")
    assert reading == pytest.approx(expected, abs=4.0 / 256)  # a code of the converter over 4 V
    assert reading == float(f"{reading:.2e}")
    assert bench.errors() == []


def test_the_voltmeter_counts_frequency() -> None:
    bench = bench_of("DSOX3024A")
    bench.send(":CHAN1:DISP ON;SCAL 0.5;:DVM:SOUR CHAN1;MODE FREQ;ENAB ON")
    assert bench.ask(":DVM:MODE?") == "FREQ"
    assert bench.number(":DVM:CURR?") == bench.number(":DVM:FREQ?") == pytest.approx(F, rel=1e-4)


def test_preset_forgets_the_voltmeter_and_the_annotation() -> None:
    bench = bench_of("DSOX3024A")
    bench.send(':DVM:ENAB ON;:DISP:ANN:TEXT "sense";COL CH1;BACK TRAN;:DISP:ANN ON;:CHAN1:OFFS 1')
    assert bench.ask(":DISP:ANN?;ANN:TEXT?;COL?;BACK?") == '1;"sense";CH1;TRAN'
    bench.send(":SYST:PRES")
    assert bench.ask(":DVM:ENAB?;:DISP:ANN?;ANN:TEXT?;:CHAN1:OFFS?") == '0;0;"";+0.000000000000E+00'
    assert bench.errors() == []


def test_an_mso_keeps_settings_of_digital_channels() -> None:
    bench = bench_of("MSOX3104T")
    bench.send(':DIG0:DISP ON;LAB "clock";THR 1.2;:DIG15:SIZE LARG;:POD2:THR CMOS;DISP 1')
    assert bench.ask(":DIG0:DISP?;LAB?;THR?") == '1;"clock";+1.200000000000E+00'
    assert bench.ask(":DIG1:DISP?;:DIG15:SIZE?;:POD2:THR?;DISP?") == "0;LARG;+2.500000000000E+00;1"
    assert bench.errors() == []


@pytest.mark.parametrize("header", [":DIG1:DISP ON", ":POD1:DISP ON"])
def test_a_dso_has_no_digital_channels(header: str) -> None:
    bench = bench_of("DSOX3024A")
    bench.send(header)
    assert bench.errors() == [-113]


@pytest.mark.parametrize(
    ("header", "expected"),
    [
        ("PEDG", 5.0),
        ("NEDG", 4.0),
        ("PPUL", 4.0),
        ("NPUL", 4.0),
        ("BRAT", 2 * F),
        ("BWID", 4.0 / F),
        ("ARE", 0.1 * 5 / F),
        ("ARE? CYCL,CHAN1", 0.1 / F),
        ("NDUT", 50.0),
        ("SLEW", 0.8 * 3.0 * F * math.pi / math.asin(0.8)),
        ("SLEW? CHAN1,FALL", -0.8 * 3.0 * F * math.pi / math.asin(0.8)),
        (f"YATX? {0.25 / F:.6e},CHAN1", 1.6),
    ],
)
def test_x_series_measurements_count_and_integrate_screen(header: str, expected: float) -> None:
    """Five cycles of a sine from a rising edge to the next but four, 0.1 V above ground."""
    bench = bench_of("MSOX3104T")
    bench.send(f":CHAN1:DISP ON;SCAL 0.5;:TRIG:LEV 0.1;:TIM:REF LEFT;SCAL {0.5 / F}")
    bench.send(f":TIM:POS {-0.05 / F:.6e}")
    query, _, words = header.partition("?")
    assert bench.number(f":MEAS:{query}? {words}") == pytest.approx(expected, rel=0.03)
    assert bench.errors() == []
