"""The 33500B and 33600A beside the 33220A: data sheet and drawn specimens."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np
import pytest
from simrack.instruments.agilent33220a.modulation import pseudo_random_bits
from simrack.instruments.trueform import TrueformErrors
from simrack.instruments.trueform.commands import table
from simrack.scpi import ScpiError

from tests.conformance import walk
from tests.successors import BENCH
from vcfbench.instructions.v_vc import generator_sheet
from vcfbench.procedures.bench_file import parse_bench
from vcfbench.procedures.layers import settings_of
from vcfbench.procedures.virtual_coriolis.plan import VIRTUAL_CORIOLIS
from vcfbench.specifications import KEYSIGHT_33500B
from vcfbench.station.discovery import recognise

if TYPE_CHECKING:
    from vcfbench.station.description import BenchDescription


@pytest.fixture(scope="module")
def described() -> BenchDescription:
    return parse_bench(BENCH.read_text(encoding="utf-8").replace("max_v_vc_v = 10", "max_v_vc_v = 2"), "lab.toml")


def test_specimens_lie_within_the_sheet_that_the_uncertainties_use(described: BenchDescription) -> None:
    settings = settings_of(VIRTUAL_CORIOLIS, described)
    assert generator_sheet(settings) is KEYSIGHT_33500B
    drawn = [TrueformErrors.drawn(np.random.default_rng(seed)).ranges for seed in range(40)]
    gains = [abs(each.gain_error) for ranges in drawn for each in ranges]
    assert 0.9 < max(gains) / KEYSIGHT_33500B.setting <= 1.0
    smallest = [abs(ranges[0].offset_error_v) for ranges in drawn]  # the others' offsets have more room
    assert 0.9 < max(smallest) / KEYSIGHT_33500B.offset_v <= 1.0


def test_seven_bit_sequence_has_every_word_once() -> None:
    bits = [bit > 0.0 for bit in pseudo_random_bits()]
    words = {tuple((bits + bits)[start : start + 7]) for start in range(127)}
    assert len(words) == 127
    assert (False,) * 7 not in words


@pytest.mark.parametrize("function", ["PRBS", "TRI"])
def test_what_the_series_has_beside_the_33220a_comes_out(function: str) -> None:
    """2 Vpp go from -1 to 1 V, and through the World for half a second."""
    bench = walk.bench("keysight33622a")
    bench.write(f"OUTP1:LOAD INF;:SOUR1:FUNC {function};:SOUR1:VOLT 2;:OUTP1 ON")
    bench.clock.sleep_until(0.5)
    source = bench.device._driven  # type: ignore[attr-defined]  # what the World was given
    volts = source.at(np.linspace(0.1, 0.30017, 4001))
    assert volts.max() == pytest.approx(1.0, abs=0.02)
    assert volts.min() == pytest.approx(-1.0, abs=0.02)
    assert abs(volts.mean()) < 0.05


def test_two_channels_have_settings_of_their_own_and_one_trigger() -> None:
    bench = walk.bench("keysight33622a")
    bench.write("SOUR2:APPL:SQU 5E3,2,0.5;:INIT2:CONT OFF")
    assert bench.ask("SOUR2:APPL?") == '"SQU +5.000000000000000E+03,+2.0000000000000E+00,+5.0000000000000E-01"'
    assert bench.ask("FUNC?;:OUTP1?;:OUTP2?;:INIT1:CONT?;:INIT2:CONT?") == "SIN;0;1;1;0"
    bench.write("*SAV 1;*RST")
    assert bench.ask("SOUR2:FUNC?;:OUTP2?") == "SIN;0"
    bench.write("*RCL 1;:SOUR2:BURS:STAT ON;:TRIG2:SOUR BUS;*TRG;:SOUR2:FREQ 1E12")
    assert str(bench.ask("SOUR2:FUNC?;FREQ?;:SYST:ERR?")).startswith("SQU;+1.000000000000000E+08;-222,")
    bench.write("TRIG1")
    assert str(bench.ask("SYST:ERR?")).startswith("-211,")


def test_a_model_with_one_channel_refuses_the_second() -> None:
    with pytest.raises(ScpiError, match="-114"):
        raise next(step.error for step in table(1).compile("SOUR2:FREQ 1") if step.error)


def test_discovery_finds_both_badges() -> None:
    assert recognise("Agilent Technologies,33510B,MY52201807,3.05-1.19-2.00-52-00") == "33510B"
    assert recognise("Keysight Technologies,33622A,MY53801234,A.02.03-3.15-03-64-02") == "33622A"
