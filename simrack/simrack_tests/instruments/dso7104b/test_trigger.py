"""Triggers on analytic waveforms, against instants known in closed form."""

from __future__ import annotations

import cmath
import math
from typing import TYPE_CHECKING

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from simrack_tests.instruments.dso7104b.bench import Bench, F

if TYPE_CHECKING:
    from collections.abc import Callable

    from numpy.typing import NDArray

    Wave = Callable[[NDArray[np.float64]], NDArray[np.float64]]

NANOSECOND = 1e-9
"""The step of a search of one millisecond; edges of these waveforms have no duration, so they are known to no less."""


def pulses(*spans_s: tuple[float, float]) -> Wave:
    """1 V within the spans (bench time), else -1 V."""
    return lambda t: np.where(np.any([(t >= a) & (t < b) for a, b in spans_s], axis=0), 1.0, -1.0)


def train(period_s: float, *spans_s: tuple[float, float]) -> Wave:
    """The same again and again."""
    return lambda t: pulses(*spans_s)(t % period_s)


def bench_with(**nodes: Wave) -> Bench:
    """Channels 1 to 4 see `drive`, `carrier`, `flat` and `pulse`; 8 V screens, NORMal sweep."""
    bench = Bench()
    bench.nodes.update(nodes)
    for channel in (1, 2, 3, 4):
        bench.send(f":CHAN{channel}:RANG 8")
    bench.send(":TIM:RANG 1E-3;:TRIG:SWE NORM")
    return bench


def triggered(bench: Bench, limit_s: float = 5.0) -> float:
    """Arm and return the bench time of the trigger."""
    bench.send(":SING")
    wait(bench, limit_s)
    return bench.scope.shown.record.trigger_s


def wait(bench: Bench, limit_s: float) -> None:
    stop = bench.clock.now() + limit_s
    while int(bench.ask(":OPER:COND?")) & 8 and bench.clock.now() < stop:
        bench.clock.sleep_until(bench.clock.now() + 1e-3)


def never(bench: Bench, wait_s: float = 0.3) -> bool:
    """Arm and tell whether it still waits later."""
    bench.send(":TER?")
    bench.scope.read(100)
    bench.send(":SING")
    bench.clock.sleep_until(bench.clock.now() + wait_s)
    still = int(bench.ask(":OPER:COND?")) == 8 + 32 and bench.ask(":TER?") == "+0"
    bench.send(":STOP")
    return still


# --- edges


@settings(max_examples=20, deadline=None)
@given(level=st.floats(-1.3, 1.5), rising=st.booleans())
def test_an_edge_is_where_the_sine_crosses_the_level(level: float, rising: bool) -> None:  # noqa: FBT001
    bench = bench_with()
    bench.finest_s["drive"] = 1e-6
    bench.send(f":TRIG:LEV {level!r};SLOP {'POS' if rising else 'NEG'}")
    armed_s = bench.clock.now()
    phase = 2 * math.pi * F * triggered(bench)
    wanted = math.asin((level - 0.1) / 1.5)
    assert math.remainder(phase - (wanted if rising else math.pi - wanted), 2 * math.pi) == pytest.approx(0.0, abs=1e-6)
    assert bench.scope.shown.record.trigger_s <= armed_s + 0.5e-3 + 1.01 / F  # the first one after half a screen


def test_edge_narrower_than_search_grid_is_found() -> None:
    bench = bench_with(drive=pulses((0.8e-3, 0.8e-3 + 20e-9), (1.1e-3, 1.3e-3)))
    assert triggered(bench) == pytest.approx(0.8e-3, abs=NANOSECOND)


def test_a_single_edge_is_not_missed_however_long_it_takes() -> None:
    """Nobody asks for anything meanwhile, and it lies between what would be two searches."""
    edge_s = 0.123456789
    bench = bench_with(drive=lambda t: np.where(t < edge_s, -1.0, 1.0))
    bench.finest_s["drive"] = 1e-6
    bench.send(":SING")
    bench.clock.sleep_until(1.0)
    assert bench.ask(":TER?") == "+1"
    assert bench.scope.shown.record.trigger_s == pytest.approx(edge_s, abs=NANOSECOND)


def test_line_is_the_mains_and_external_is_not_plugged_in() -> None:
    bench = bench_with()
    bench.send(":TRIG:SOUR LINE;SLOP NEG")
    assert triggered(bench) % 0.02 == pytest.approx(0.01, abs=1e-8)
    bench.send(":TRIG:SOUR EXT")
    assert never(bench)


# --- coupling, rejects, hysteresis


def filtered_phase(frequency_hz: float, *, high_pass: bool) -> complex:
    ratio = 1j * frequency_hz / 50e3
    return ratio / (1 + ratio) if high_pass else 1 / (1 + ratio)


@pytest.mark.parametrize(("setup", "high_pass"), [(":TRIG:COUP LFR", True), (":TRIG:HFR ON", False)])
@pytest.mark.parametrize("frequency_hz", [20e3, 150e3])
def test_a_reject_turns_the_phase_of_a_sine(setup: str, *, high_pass: bool, frequency_hz: float) -> None:
    bench = bench_with(drive=lambda t: 2.0 + np.sin(2 * np.pi * frequency_hz * t))
    gain = filtered_phase(frequency_hz, high_pass=high_pass)
    level = 0.3 * abs(gain) + (0.0 if high_pass else 2.0)
    bench.send(f"{setup};:TRIG:LEV {level!r}")
    phase = 2 * math.pi * frequency_hz * triggered(bench) + cmath.phase(gain)
    assert math.remainder(phase - math.asin(0.3), 2 * math.pi) == pytest.approx(0.0, abs=2e-3)


def test_a_reject_takes_from_the_swing() -> None:
    bench = bench_with(drive=lambda t: np.sin(2 * np.pi * 5e3 * t))
    bench.send(":TRIG:COUP LFR;LEV 0.2")  # 0.0995 V are left
    assert never(bench)
    bench.send(":TRIG:LEV 0.09")
    assert triggered(bench)
    bench = bench_with(drive=lambda t: np.sin(2 * np.pi * 500e3 * t))
    bench.send(":TRIG:HFR ON;LEV 0.2")
    assert never(bench, 0.01)
    bench.send(":TRIG:HFR OFF")
    assert triggered(bench)


def test_ac_coupling_takes_the_mean_off() -> None:
    bench = bench_with(drive=lambda t: 3.0 + np.sin(2 * np.pi * 10e3 * t))
    bench.send(":TRIG:COUP AC;LEV 0.5")
    assert math.sin(2 * np.pi * 10e3 * triggered(bench)) == pytest.approx(0.5, abs=2e-3)


def test_noise_reject_asks_for_a_division() -> None:
    bench = bench_with(drive=lambda t: 0.4 * np.sin(2 * np.pi * 10e3 * t))  # 0.8 divisions, peak to peak
    bench.send(":TRIG:NREJ ON")
    assert never(bench, 0.05)
    bench.send(":TRIG:NREJ OFF")
    assert triggered(bench)
    bench = bench_with(drive=lambda t: 1.2 * np.sin(2 * np.pi * 10e3 * t))
    bench.send(":TRIG:NREJ ON")
    assert math.sin(2 * np.pi * 10e3 * triggered(bench)) == pytest.approx(0.0, abs=1e-3)


def test_reject_and_coupling_are_one_setting() -> None:
    bench = bench_with()
    assert bench.ask(":TRIG:REJ LF;COUP?;:TRIG:REJ?") == "LFR;LF"
    assert bench.ask(":TRIG:REJ HF;COUP?;REJ?;:TRIG:HFR?") == "DC;HF;1"
    assert bench.ask(":TRIG:REJ OFF;:TRIG:HFR?") == "0"


# --- pulses


@pytest.mark.parametrize(
    ("setup", "end_s"),
    [
        ("POL POS;QUAL LESS;LESS 15E-6", 0.710e-3),
        ("POL POS;QUAL GRE;GRE 100E-6", 1.450e-3),
        ("POL POS;QUAL RANG;RANG 60E-6,40E-6", 1.050e-3),
        ("POL POS;QUAL RANG;RANG 40E-6,60E-6", 1.050e-3),
        ("POL NEG;QUAL RANG;RANG 280E-6,300E-6", 1.000e-3),
    ],
)
def test_a_pulse_of_the_wanted_width_triggers_at_its_end(setup: str, end_s: float) -> None:
    bench = bench_with(drive=pulses((0.7e-3, 0.71e-3), (1e-3, 1.05e-3), (1.3e-3, 1.45e-3)))
    bench.send(f":TRIG:MODE GLIT;GLIT:SOUR CHAN1;LEV 0;{setup}")
    assert triggered(bench) == pytest.approx(end_s, abs=NANOSECOND)


@settings(max_examples=15, deadline=None)
@given(width_s=st.floats(1e-6, 200e-6), share=st.floats(0.98, 1.02).filter(lambda s: abs(s - 1) > 2e-4))
def test_a_width_is_compared_exactly(width_s: float, share: float) -> None:
    bench = bench_with(drive=pulses((0.7e-3, 0.7e-3 + width_s)))
    bench.finest_s["drive"] = 2e-7
    bench.send(f":TRIG:MODE GLIT;GLIT:SOUR CHAN1;POL POS;QUAL GRE;GRE {width_s * share!r}")
    bench.send(":SING")
    bench.clock.sleep_until(0.01)
    assert bench.ask(":TER?") == ("+1" if share < 1.0 else "+0")


CLOCK = train(100e-6, (0.0, 50e-6))

# --- television

LINE_S = 63.556e-6


def ntsc(t: NDArray[np.float64]) -> NDArray[np.float64]:
    """Lines of 1 V above sync tips of 0.3 V; each field of 262 begins with six broad pulses at twice the rate."""
    field, line = np.divmod(t, 262 * LINE_S)[1], t % LINE_S
    broad = (field < 3 * LINE_S) & (t % (LINE_S / 2) < 27.1e-6)
    sync = np.where(field < 3 * LINE_S, broad, line < 4.7e-6)
    return np.where(sync, -0.3, 0.35 + 0.35 * np.sin(2 * np.pi * 3.58e6 * t))


def test_television_lines_and_fields() -> None:
    bench = bench_with(drive=ntsc)
    bench.finest_s["drive"] = 1e-7
    bench.send(":CHAN1:RANG 2;:TRIG:MODE TV;TV:SOUR CHAN1;MODE ALIN;STAN NTSC")
    place = triggered(bench) % (262 * LINE_S)
    assert place > 3 * LINE_S
    assert math.remainder(place, LINE_S) == pytest.approx(0.0, abs=1e-7)
    bench.send(":TRIG:TV:MODE AFI")
    assert triggered(bench) % (262 * LINE_S) == pytest.approx(27.1e-6, abs=1e-7)
    bench.send(":TRIG:TV:POL POS")
    assert never(bench, 0.02)


@pytest.mark.parametrize("frequency_hz", [3488.9, 15734.0, 100e3])
def test_what_is_no_television_never_synchronises(frequency_hz: float) -> None:
    bench = bench_with(drive=lambda t: np.sin(2 * np.pi * frequency_hz * t))
    bench.finest_s["drive"] = 1e-7
    bench.send(":TRIG:MODE TV;TV:MODE ALIN")
    assert never(bench, 0.05)


# --- holdoff, levels, registers


def test_holdoff_keeps_the_next_trigger_away() -> None:
    bench = bench_with(drive=CLOCK)
    bench.finest_s["drive"] = 1e-7
    bench.send(":TRIG:HOLD 30E-3")
    first, second = triggered(bench), triggered(bench)
    assert 30e-3 <= second - first <= 30e-3 + 101e-6
    bench.send(":TRIG:HOLD 60E-9")
    assert triggered(bench) - second < 10e-3


@pytest.mark.parametrize(
    ("setup", "query", "value"),
    [
        (":CHAN1:RANG 4;OFFS 1;:TRIG:LEV 4", ":TRIG:LEV?", 4.0),
        (":CHAN1:RANG 4;OFFS 1;:TRIG:LEV 4.5", ":TRIG:LEV?", 4.0),
        (":CHAN1:RANG 4;OFFS 1;:TRIG:LEV -3", ":TRIG:LEV?", -2.0),
        (":TRIG:SOUR EXT;LEV 9", ":TRIG:LEV?", 8.0),
    ],
)
def test_levels_stay_near_the_screen(setup: str, query: str, value: float) -> None:
    bench = bench_with()
    bench.send(setup)
    assert bench.number(query) == pytest.approx(value)
    assert set(bench.errors()) <= {-222}


REPLIES = {
    ":TRIG:GLIT:RANG 2E-6,1E-6;RANG?": "+2.00000000E-006,+1.00000000E-006",
    ":TRIG:GLIT:RANG 1E-6,2E-6;RANG?": "+2.00000000E-006,+1.00000000E-006",
    ":TRIG:TV:MODE FIE2;MODE?;MODE LFIELD1;MODE?;LINE 20;LINE?": "FIE2;LFI1;+20",
}


@pytest.mark.parametrize(("asked", "reply"), REPLIES.items())
def test_replies_to_the_character(asked: str, reply: str) -> None:
    bench = bench_with()
    assert bench.ask(asked) == reply
    assert bench.errors() == []


@pytest.mark.parametrize(
    ("command", "number"),
    [
        (":TRIG:MODE PATT", -224),
        (":TRIG:PATT 1,1", -113),
        (":TRIG:SEQ:COUN?", -113),
        (":MARK:MODE?", -113),
        (":MTES:ENAB ON", -113),
        (":TRIG:TV:SOUR EXT", -224),
    ],
)
def test_refusals(command: str, number: int) -> None:
    bench = bench_with()
    bench.send(command)
    assert bench.errors() == [number]


def test_a_run_tells_of_its_triggers() -> None:
    bench = bench_with()
    bench.send(":TRIG:LEV 4;:RUN")
    bench.clock.sleep_until(1.0)
    assert (bench.ask(":OPER:COND?"), bench.ask(":TER?")) == (f"+{8 + 32}", "+0")
    bench.send(":TRIG:LEV 0.5;:RUN")
    bench.clock.sleep_until(2.0)
    assert (bench.ask(":OPER:COND?"), bench.ask(":TER?"), bench.ask(":TER?")) == ("+8", "+1", "+0")
    bench.clock.sleep_until(3.0)
    assert bench.ask(":TER?") == "+1"
    bench.send(":STOP")
    bench.clock.sleep_until(4.0)
    assert bench.ask(":OPER:COND?") == "+0"
    assert int(bench.ask(":OPER?")) & (8 + 32) == 8 + 32


def test_what_is_given_up_is_not_recorded_any_longer() -> None:
    bench = bench_with()
    bench.send(":TRIG:LEV 4;:SING")
    assert len(bench.recording) == 1
    for command in (":SING", ":RUN", ":SING", ":STOP"):
        bench.send(command)
    bench.clock.sleep_until(1.0)
    bench.scope.clear()
    assert not bench.recording
