"""What real units have been seen to answer: the simulated ones answer in the same form, the drivers understand it.

The recordings come from public code: identities, a learn string and a preamble of a DSO6014A, the power-on dump of a
33250A (whose family the 33220A belongs to; that one is an exchange in expectations/agilent33220a.toml).
"""

from __future__ import annotations

import re

import numpy as np
import pytest

from tests.conformance import walk
from vcfbench.drivers import replies
from vcfbench.drivers.dso7104b import Preamble
from vcfbench.errors import TransportError

IDENTITIES = [
    ("agilent33220a", "Agilent Technologies,33220A,MY44008868,2.00-2.00-22-2"),
    ("agilent33220a", "Agilent Technologies,33220A,MY44021876,2.02-2.02-22-2"),
    ("dso7104b", "AGILENT TECHNOLOGIES,DSO7104B,MY49520121,06.00.0003"),
    ("hp34401a", "HEWLETT-PACKARD,34401A,0,10-5-2"),
    ("hp34401a", "HEWLETT-PACKARD,34401A,0,11-5-2"),
    ("hp34401a", "HEWLETT-PACKARD,34401A,0,3-1-1"),
    ("hp34401a", "HEWLETT-PACKARD,34401A,0,7-5-2"),
    ("agilent33220a", "Agilent Technologies,33220A,MY44053237,2.07-2.06-22-2"),
    ("agilent33220a", "Agilent Technologies,33220A,MY44022852,2.07-2.02-22-2"),
    ("e3631a", "HEWLETT-PACKARD,E3631A,0,2.1-5.0-1.0"),
    ("e3631a", "HEWLETT-PACKARD,E3631A,0,1.4-5.0-1.0"),
    ("e3631a", "HEWLETT-PACKARD,E3631A,0,3.2-6.0-2.0"),
]
"""Of real units, as their owners' programs compare or print them."""

ERROR_WORDS = [
    # https://github.com/pymeasure/pymeasure/issues/1081: a 34401A on a serial line whose setting was another one
    ("hp34401a", "CONF:VOLT#DC", '-101,"Invalid character"'),
    # https://github.com/xyphro/UsbGpib/issues/39: a 34401A and an E3632A after half a *IDN?
    ("hp34401a", "DN?", '-113,"Undefined header"'),
    ("e3631a", "DN?", '-113,"Undefined header"'),
]
"""Model, what provokes the entry, and the entry as it was read from the real unit."""

UNTERMINATED = '-420,"Query UNTERMINATED"'
"""https://github.com/xyphro/UsbGpib/issues/39, 34401A and E3632A; https://github.com/ngscopeclient/scopehal/pull/1015,
a DSO-X 2022A."""

READINGS = [
    # https://github.com/PY1CX/HP-34401A-Python, and print-outs in two more READMEs
    ("+1.00010310E+01", 10.001031),
    ("+1.60750000E-05", 1.6075e-5),
    ("+2.29700000E-05", 2.297e-5),
]
"""Replies of 34401As to READ? and MEASure?, and their values."""

PREAMBLE = "+0,+0,+1000,+1,+2.00000000E-010,-1.00000000E-007,+0,+3.12500000E-002,+1.25000000E-002,+128"
CHANNEL = (
    ":CHAN1:RANG +40.0E+00;OFFS +0.00000E+00;COUP DC;IMP ONEM;DISP 1;BWL 0;INV 0;"
    'LAB "1";UNIT VOLT;PROB +10E+00;PROB:SKEW +0.00E+00;STYP SING'
)
TIMEBASE = ":TIM:MODE MAIN;REF CENT;MAIN:RANG +1.00E-03;POS +0.0E+00"
POWER_ON = [
    "+1.0000000000000E+03", "+1.0000000000000E-01", "-5.0000000000000E-02", "+5.0000000000000E-09",
    "+6.7156300000000E-01", "+2.1119900000000E+00",
]  # fmt: skip


def shape(text: str) -> str:
    """Return the text with every digit written as 0."""
    return re.sub(r"\d", "0", text)


@pytest.mark.parametrize(("model", "identity"), IDENTITIES)
def test_identities_have_the_form_of_real_ones(model: str, identity: str) -> None:
    real, simulated = identity.split(","), (walk.bench(model).ask("*IDN?") or "").split(",")
    assert simulated[:2] == real[:2]
    assert shape(simulated[2]) == shape(real[2])
    assert re.split(r"\d+", simulated[3]) == re.split(r"\d+", real[3])


@pytest.mark.parametrize(("model", "identity"), IDENTITIES)
def test_drivers_understand_real_identities(model: str, identity: str) -> None:
    fields = replies.identity_fields(identity)
    assert fields[1].upper() in {"33220A", "DSO7104B", "34401A", "E3631A"}
    assert model.upper().endswith(fields[1].upper())


def test_driver_understands_a_recorded_preamble() -> None:
    waveform = Preamble.parse(PREAMBLE).waveform(np.array([128, 2, 254], dtype=np.uint8))
    times = waveform.time_s
    assert len(times) == 1000
    assert times[0] == pytest.approx(-100e-9)
    assert times[-1] == pytest.approx(99.8e-9)
    assert waveform.voltage_v == pytest.approx([0.0125, 0.0125 - 126 * 0.03125, 0.0125 + 126 * 0.03125])


def test_simulated_preamble_of_the_recorded_settings() -> None:
    scope = walk.bench("dso7104b")
    scope.write(":CHAN1:PROB 1;SCAL 1;OFFS 0.0125;:TIM:SCAL 20E-9;:DIG CHAN1;:WAV:FORM BYTE;POIN 1000")
    assert scope.ask(":WAV:PRE?") == PREAMBLE


def test_simulated_learn_strings_are_the_recorded_ones() -> None:
    scope = walk.bench("dso7104b")
    scope.write("*RST;:CHAN1:PROB 10;RANG 40")
    assert scope.ask(":CHAN1?") == CHANNEL
    assert scope.ask(":TIM?") == TIMEBASE


def test_a_recorded_learn_string_can_be_sent_back() -> None:
    scope = walk.bench("dso7104b")
    scope.write("*RST;:CHAN1:PROB 10;RANG 10;COUP AC")
    scope.write(CHANNEL)
    assert scope.error() == 0
    assert scope.ask(":CHAN1?") == CHANNEL


@pytest.mark.parametrize("reply", POWER_ON)
def test_numbers_of_a_recorded_power_on_dump(reply: str) -> None:
    assert f"{replies.number(reply):+.13E}" == reply


@pytest.mark.parametrize(("model", "stimulus", "entry"), ERROR_WORDS)
def test_error_entries_are_the_recorded_ones(model: str, stimulus: str, entry: str) -> None:
    bench = walk.bench(model)
    bench.write(stimulus)
    assert (bench.ask("SYST:ERR?") or "").rstrip() == entry
    assert replies.error_entry(entry) == (int(entry.partition(",")[0]), entry.partition(",")[2].strip('"'))


@pytest.mark.parametrize("model", ["hp34401a", "e3631a", "dso7104b"])
def test_a_read_with_nothing_to_say_leaves_the_recorded_entry(model: str) -> None:
    bench = walk.bench(model)
    assert bench.read(0.1) is None
    assert (bench.ask("SYST:ERR?") or "").rstrip() == UNTERMINATED
    assert replies.error_entry(UNTERMINATED) == (-420, "Query UNTERMINATED")


@pytest.mark.parametrize(("reply", "value"), READINGS)
def test_recorded_readings_are_understood_and_of_the_simulated_form(reply: str, value: float) -> None:
    assert replies.reading(reply) == value
    simulated = walk.bench("hp34401a").ask("READ?") or ""
    assert re.fullmatch(r"[+-]\d\.\d{8}E[+-]\d\d", simulated)
    assert len(simulated) == len(reply) == 15


def test_a_preamble_that_is_only_a_zero_is_refused() -> None:
    """A DSO-X 2022A has answered +0 to :WAV:PRE? (https://github.com/ngscopeclient/scopehal/pull/1015)."""
    with pytest.raises(TransportError):
        Preamble.parse("+0")


@pytest.mark.parametrize(
    ("reply", "value"),
    [("+1.00000000E+01", 10.0), ("-1.23456780E-03", -1.2345678e-3), ("+0.00000000E+00", 0.0)],
)
def test_readings_of_the_manuals(reply: str, value: float) -> None:
    assert replies.reading(reply) == value


@pytest.mark.parametrize("reply", ["+0", "0", "+512", "512"])
def test_integers_signed_and_bare(reply: str) -> None:
    assert replies.integer(reply) == int(reply)


@pytest.mark.parametrize(
    ("entry", "number"),
    [('+0,"No error"', 0), ('-113,"Undefined header"', -113), ('+514,"Command allowed only with RS-232"', 514)],
)
def test_entries_of_the_error_queue(entry: str, number: int) -> None:
    assert replies.error_entry(entry)[0] == number


def test_block_headers_of_either_length() -> None:
    assert replies.block_length(b"#800001000") == (10, 1000)
    assert replies.block_length(b"#9000001000") == (11, 1000)
