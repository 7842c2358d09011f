"""Records: segments and their time tags, peak detection, long records in blocks, against analytic waveforms."""

from __future__ import annotations

import math
import tracemalloc

import numpy as np
import pytest
from simrack.instruments.dso7104b import Dso7104BTwin, ScopeErrors
from simrack_tests.instruments.dso7104b.bench import Bench, F, errors_with, waveform

from vcfbench.clock import VirtualClock
from vcfbench.sim.gyro.design import ideal_bench
from vcfbench.sim.world import World

# --- segments


def segmented(count: int, setup: str = "", errors: ScopeErrors | None = None) -> Bench:
    """Pulses at 10, 13, 17, 24 ms ... (gaps of 3, 4, 7 ms again and again), each 0.1 V higher than the one before."""
    bench = Bench(errors)
    starts = np.cumsum(np.tile([3e-3, 4e-3, 7e-3], 40)) + 7e-3

    def pulse(t: np.ndarray) -> np.ndarray:
        index = np.searchsorted(starts, t, side="right") - 1
        inside = (index >= 0) & (t - starts[np.clip(index, 0, None)] < 100e-6)
        return np.where(inside, 0.5 + 0.1 * (index % 20), 0.0)

    bench.nodes["drive"] = pulse
    bench.finest_s["drive"] = 1e-6
    bench.send(f":CHAN1:RANG 8;:TIM:RANG 1E-3;:TRIG:SWE NORM;LEV 0.25;:ACQ:MODE SEGM;SEGM:COUN {count};{setup}")
    return bench


def tags_s(bench: Bench, count: int) -> list[float]:
    return [bench.number(f":ACQ:SEGM:IND {index};:WAV:SEGM:TTAG?") for index in range(1, count + 1)]


def test_segments_have_their_own_records_and_time_tags() -> None:
    bench = segmented(5)
    assert bench.ask(":DIG CHAN1;*OPC?") == "1"
    assert bench.ask(":WAV:SEGM:COUN?") == "+5"
    assert tags_s(bench, 5) == pytest.approx([0.0, 4e-3, 11e-3, 14e-3, 18e-3], abs=1e-8)
    tops = [bench.number(f":ACQ:SEGM:IND {index};:MEAS:VMAX? CHAN1") for index in range(1, 6)]
    assert tops == pytest.approx([0.5, 0.6, 0.7, 0.8, 0.9], abs=1e-3)
    for index, top in enumerate(tops, 1):
        bench.send(f":ACQ:SEGM:IND {index}")
        times, volts = waveform(bench)
        assert volts.max() == pytest.approx(top, abs=8 / 256)
        assert times[np.flatnonzero(volts > 0.25)[0]] == pytest.approx(0.0, abs=1.1e-6)
    assert bench.errors() == []


def test_time_tags_follow_the_time_base_and_the_clock() -> None:
    bench = segmented(3, errors=errors_with(time_base_error=1e-3))
    bench.ask(":DIG CHAN1;*OPC?")
    assert tags_s(bench, 3)[-1] == pytest.approx(11e-3 * 1.001, rel=1e-7)
    # the third trigger was at 7 + 3 + 4 + 7 ms, and the screen goes on for half a millisecond
    assert 21.5e-3 <= bench.clock.now() < 25e-3


def test_holdoff_leaves_segments_out() -> None:
    bench = segmented(3, ":TRIG:HOLD 5E-3")
    bench.ask(":DIG CHAN1;*OPC?")
    assert tags_s(bench, 3) == pytest.approx([0.0, 11e-3, 18e-3], abs=1e-8)


def test_an_index_is_of_an_acquired_segment() -> None:
    bench = segmented(3)
    bench.ask(":DIG CHAN1;*OPC?")
    assert bench.ask(":ACQ:SEGM:IND 7;IND?") == "+3"
    assert bench.errors() == [-222]
    bench.send(":DIG CHAN1")
    assert bench.ask(":ACQ:SEGM:IND?") == "+1"


def test_segments_share_the_memory() -> None:
    bench = segmented(8, ":TIM:RANG 10E-3")
    assert bench.ask(":ACQ:POIN?") == "+1000000"


def test_analysis_takes_the_statistics_of_all_segments() -> None:
    bench = segmented(4)
    bench.ask(":DIG CHAN1;*OPC?")
    bench.send(":MEAS:VMAX CHAN1;:ACQ:SEGM:IND 2;ANAL;:MEAS:STAT ON")
    label, *numbers = bench.ask(":MEAS:RES?").split(",")
    assert label == "VMAX(1)"
    tops = np.array([0.5, 0.6, 0.7, 0.8])
    wanted = [0.6, 0.5, 0.8, tops.mean(), tops.std(ddof=1), 4]
    assert [float(number) for number in numbers] == pytest.approx(wanted, abs=1e-3)
    assert bench.ask(":MEAS:STAT COUN;RES?") == "+4"


def test_what_is_not_segmented_has_no_segments() -> None:
    bench = Bench()
    bench.send(":DIG CHAN1")
    assert bench.ask(":WAV:SEGM:COUN?;TTAG?") == "+0;+0.00000000E+000"
    bench.send(":ACQ:SEGM:ANAL")
    assert bench.errors() == [-221]


def test_auto_sweep_fills_segments_by_itself() -> None:
    bench = segmented(3, ":TRIG:LEV 4;SWE AUTO")
    assert bench.ask(":DIG CHAN1;*OPC?") == "1"
    tags = tags_s(bench, 3)
    assert np.diff(tags) == pytest.approx([0.021, 0.021], abs=1e-4)  # a screen and 20 ms of patience each


# --- peak detection


def test_peak_detection_finds_what_falls_between_points() -> None:
    bench = Bench()
    bench.nodes["drive"] = lambda t: np.where(np.abs(t % 0.1 - 60.00005e-3) < 1e-6, 1.5, 0.0)  # 2 us in 0.1 s
    bench.send(":CHAN1:RANG 8;:TIM:RANG 0.1;:TRIG:SOUR CHAN3;LEV 9;:WAV:FORM WORD")
    for kind, found in (("NORM", 0.0), ("PEAK", 1.5)):
        bench.send(f":ACQ:TYPE {kind};:DIG CHAN1")
        assert abs(waveform(bench)[1]).max() == pytest.approx(found, abs=1e-3)


def test_a_long_record_of_peaks_comes_in_blocks() -> None:
    bench = Bench()
    bench.finest_s["drive"] = 1e-4
    bench.send(":CHAN1:RANG 8;:TIM:RANG 1;:TRIG:LEV 0.1;:ACQ:TYPE PEAK;:DIG CHAN1")
    bench.ask("*OPC?")
    tracemalloc.start()
    volts = np.concatenate(list(bench.scope.shown.record.peak_blocks(1, 500_000)))
    _, most = tracemalloc.get_traced_memory()
    tracemalloc.stop()
    assert most < 60e6  # four million samples at once would be 32 MB apiece
    assert len(volts) == 500_000
    assert (volts[0::2] <= volts[1::2]).all()
    # each pair holds 4 us: of a sine of 3.5 kHz that is 1.5 w 4 us = 0.13 V at its steepest
    assert (volts[1::2] - volts[0::2]).max() == pytest.approx(1.5 * 2 * math.pi * F * 4e-6, abs=2 * 8 / 256)


# --- long records of the real World


@pytest.fixture(scope="module")
def real() -> tuple[VirtualClock, World, Dso7104BTwin]:
    clock = VirtualClock()
    world = World(clock, ideal_bench(), 0)
    scope = Dso7104BTwin(world, {1: "drive", 2: "v_vc", 3: "rail_positive", 4: "output"}, ScopeErrors.none())
    world.set_rail("positive", 10.0)
    world.set_rail("negative", -10.0)
    clock.sleep_until(5.0)
    return clock, world, scope


def tell(real: tuple[VirtualClock, World, Dso7104BTwin], text: str) -> bytes:
    clock, _, scope = real
    scope.write(text.encode() + b"\n")
    while not (reply := scope.read(1 << 26)[0]):
        wake = scope.wake_at()
        assert wake is not None
        clock.sleep_until(wake)
    return reply[:-1]


@pytest.mark.parametrize("sweep", ["AUTO", "NORM"])
@pytest.mark.parametrize("form", ["BYTE", "WORD"])
def test_a_long_record_is_the_short_one_in_between(
    real: tuple[VirtualClock, World, Dso7104BTwin], form: str, sweep: str
) -> None:
    """What is interpolated agrees with what is looked at point by point, within a code of 2^-16."""
    tell(real, f":CHAN1:RANG 4;:TIM:RANG 10E-3;:TRIG:SWE {sweep};SOUR CHAN1;LEV 0;:DIG CHAN1;*OPC?")
    tell(real, f":WAV:FORM {form};POIN:MODE RAW;:WAV:POIN 2000000;*OPC?")
    kind = np.dtype("u1" if form == "BYTE" else ">u2")
    long = np.frombuffer(tell(real, ":WAV:DATA?")[10:], kind).astype(int)
    short = np.frombuffer(tell(real, ":WAV:POIN 1000;DATA?")[10:], kind).astype(int)
    assert len(long) == 2_000_000
    assert np.abs(long[::2000] - short).max() <= 1
    assert np.abs(np.diff(long)).max() <= (1 if form == "BYTE" else 4)


def test_a_record_across_a_jump_keeps_it_sharp(real: tuple[VirtualClock, World, Dso7104BTwin]) -> None:
    clock, world, scope = real
    tell(real, ":CHAN3:RANG 40;:TIM:RANG 10E-3;:TRIG:SOUR CHAN3;LEV 9;SLOP NEG;SWE NORM;:SING;*OPC?")
    scope.write(b":CHAN3:DISP ON\n")
    clock.sleep_until(clock.now() + 0.05)
    instant = clock.now()
    world.set_rail("positive", 8.5)
    clock.sleep_until(clock.now() + 0.05)
    assert tell(real, ":TER?").startswith(b"+1")
    assert scope.shown.record.trigger_s == pytest.approx(instant, abs=1e-8)
    tell(real, ":WAV:SOUR CHAN3;FORM BYTE;POIN:MODE RAW;:WAV:POIN 500000;*OPC?")
    codes = np.frombuffer(tell(real, ":WAV:DATA?")[10:], np.uint8)
    assert set(codes.tolist()) == {128 + 64, 128 + round(8.5 / 40 * 256)}
    world.set_rail("positive", 10.0)
    tell(real, ":WAV:SOUR CHAN1;:TRIG:SLOP POS;SWE AUTO;*OPC?")
