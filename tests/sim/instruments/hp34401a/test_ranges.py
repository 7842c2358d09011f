"""What a reading of direct voltage has of errors by range and integration time, and what overloads it (p. 216-217)."""

from __future__ import annotations

import math

import numpy as np
import pytest
from simrack.attendance import AttendedClock
from simrack.instruments.agilent33220a.phases import Steady
from simrack.instruments.agilent33220a.playing import Playing
from simrack.instruments.agilent33220a.waveforms import PulseCycle
from simrack.instruments.hp34401a import Hp34401ATwin, MeterErrors
from simrack.sources import Drive
from simrack_tests.instruments.conversation import Conversation
from simrack_tests.instruments.hp34401a.bench import MeterBench, bench

from vcfbench.clock import VirtualClock
from vcfbench.sim.gyro.design import ideal_bench
from vcfbench.sim.world import World

ONE_YEAR = {
    0.1: (50e-6, 35e-6),
    1.0: (40e-6, 7e-6),
    10.0: (35e-6, 5e-6),
    100.0: (45e-6, 6e-6),
    1000.0: (45e-6, 10e-6),
}
"""User's Guide p. 216: parts of reading and of range."""
ADDED = {0.02: (1e-4, 20e-6), 0.2: (1e-5, 20e-6), 1.0: (1e-5, 0.0), 10.0: (0.0, 0.0), 100.0: (0.0, 0.0)}
"""Additional noise, parts of range and volts; resolutions are 100, 10, 3, 1, 0.3 ppm of range."""
FRACTIONS = {0.02: 1e-4, 0.2: 1e-5, 1.0: 3e-6, 10.0: 1e-6, 100.0: 3e-7}


def reading(errors: MeterErrors, range_v: float, volts: float, setting: str = "") -> float:
    made = bench(errors)
    made.world.offset_v = volts
    made.talk.write(f"CONF:VOLT {range_v}{setting}")
    return made.value()


@pytest.mark.parametrize("range_v", ONE_YEAR)
def test_specimen_at_limit_is_at_limit_on_all_ranges(range_v: float) -> None:
    """Gain and offset of the 10 V range at the end of its limits."""
    of_reading, of_range = ONE_YEAR[range_v]
    full = 0.9 * range_v
    assert reading(MeterErrors(gain_error=35e-6), range_v, full) == pytest.approx(full * (1 + of_reading), rel=1e-9)
    assert reading(MeterErrors(offset_v=50e-6), range_v, 0.0) == pytest.approx(of_range * range_v, rel=1e-6)


@pytest.mark.parametrize("range_v", ONE_YEAR)
def test_without_autozero(range_v: float) -> None:
    errors = MeterErrors(unzeroed_offset_v=25e-6)
    assert reading(errors, range_v, 0.0, ";:ZERO:AUTO OFF") == pytest.approx(2e-6 * range_v + 5e-6, rel=1e-6)


@pytest.mark.parametrize("range_v", [0.1, 10.0])
@pytest.mark.parametrize("nplc", [0.02, 0.2, 1.0, 10.0])
def test_short_integrations_have_the_additional_noise(range_v: float, nplc: float) -> None:
    made = bench(MeterErrors(noise=0.3, short_noise=0.25, noise_seed=1))
    made.world.offset_v = 0.0
    made.talk.write(f"CONF:VOLT {range_v};:VOLT:NPLC {nplc};:SAMP:COUN 400")
    spread = float(np.std([float(text) for text in (made.talk.ask("READ?") or "").split(",")]))
    part, volts = ADDED[nplc]
    expected = math.hypot(0.3 * FRACTIONS[nplc] * range_v, 0.25 * (part * range_v + volts))
    assert spread == pytest.approx(expected, rel=0.13)  # 3.5 sigma of the spread of 400 readings


def test_default_unit_reads_the_10_v_range_unchanged() -> None:
    """The digits of a seed: the terms of other ranges and integration times take no number from its stream."""
    specimen = MeterErrors.drawn(np.random.default_rng(5))
    rng = np.random.default_rng(5)
    assert specimen.gain_error == rng.normal(0.0, 35e-6 / 4)
    assert specimen.offset_v == rng.normal(0.0, 50e-6 / 4)


def sounding(volts: float, hertz: float, setting: str) -> MeterBench:
    world = World(AttendedClock(VirtualClock()), ideal_bench(), 0)
    meter = Hp34401ATwin(world, node="v_vc", errors=MeterErrors.none())
    world.clock.attend(meter)  # type: ignore[attr-defined]
    world.drive("v_vc", Drive(0.0, volts, hertz, 0.4, source_ohm=0.0))
    talk = Conversation(meter, world.clock)
    talk.write(setting)
    return MeterBench(world, meter, talk)  # type: ignore[arg-type]


@pytest.mark.parametrize(("range_v", "overloads"), [(0.1, True), (1.0, True), (10.0, False)])
@pytest.mark.parametrize("hertz", [50.0, 12_345.0])
def test_peaks_overload_though_their_mean_is_nothing(range_v: float, overloads: bool, hertz: float) -> None:  # noqa: FBT001
    made = sounding(10.0, hertz, f"CONF:VOLT {range_v}")
    read = made.value()
    assert (abs(read) > 1e37) is overloads
    assert made.talk.ask("STAT:QUES?") == ("+1" if overloads else "+0")


def test_what_fits_the_range_with_its_peaks_is_read() -> None:
    assert sounding(0.11, 50.0, "CONF:VOLT 0.1").value() == pytest.approx(0.0, abs=1e-6)


def test_autorange_takes_a_range_that_holds_the_peaks() -> None:
    made = sounding(10.0, 50.0, "CONF:VOLT:DC 0.1;:VOLT:RANG:AUTO ON")
    assert made.value() == pytest.approx(0.0, abs=1e-5)
    assert made.value("VOLT:RANG?") == 10.0


@pytest.mark.parametrize(("volts", "overloads"), [(4.4, False), (4.9, True)])
def test_ac_ranges_overload_beyond_a_crest_of_five(volts: float, overloads: bool) -> None:  # noqa: FBT001
    """Pulses of 1 % at 1 kHz on the 1 V range, below 1 V rms: the amplifier overshoots them by 4.3 %."""
    made = bench()
    made.world.play(source=Playing(volts / 2, volts / 2, PulseCycle(0.01, 2e-5), Steady(1e3)))
    made.talk.write("CONF:VOLT:AC 1")
    assert (made.value() > 1e37) is overloads
