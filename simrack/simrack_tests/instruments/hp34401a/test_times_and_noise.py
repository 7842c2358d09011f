"""Each time and each noise of the simulated 34401A by itself, against a table written from its User's Guide."""

from __future__ import annotations

import random

import pytest
from simrack.instruments.hp34401a import MeterErrors
from simrack.instruments.hp34401a.imperfections import AcErrors, CounterErrors
from simrack.sources import Sine

from simrack_tests.instruments.hp34401a.bench import MeterBench, bench

ARMED_S = 0.02
CYCLE_S = 0.02
"""Of 50 Hz."""


def took_s(configured: str, *, sines: tuple[Sine, ...] = ()) -> float:
    """Return how long a reading takes once all is set."""
    made = bench()
    if sines:
        made.world.play(*sines)
    made.talk.write(configured)
    made.talk.settle()
    return made.duration_s("READ?")


@pytest.mark.parametrize(
    "integrated",
    [
        (0.02, 400e-6, 0.6e-3),  # 1000 readings a second without autozero and delay (p. 217)
        (0.2, 3e-3, 0.33e-3),  # 300 a second
        (1.0, CYCLE_S, 0.0),
        (10.0, 10.0 * CYCLE_S, 0.0),
        (100.0, 100.0 * CYCLE_S, 0.0),
    ],
)
@pytest.mark.parametrize("autozero", [0, 1])
@pytest.mark.parametrize(
    ("function", "delay_s"), [("VOLT:DC 10", None), ("RES 1E3", None), ("RES 1E6", 0.015), ("RES 1E7", 0.1)]
)
def test_reading_takes_integration_delay_and_overhead(
    integrated: tuple[float, float, float], autozero: int, function: str, delay_s: float | None
) -> None:
    """Integrations over cycles, and what is beside them; delays of p. 81.

    These are 1.5 ms, 1 ms below a cycle; from 1 Mohm on 15 and 10 ms, from 10 Mohm on 100 ms.
    """
    nplc, integrates_s, beside_s = integrated
    waits_s = delay_s if delay_s is not None else 0.0015
    if nplc < 1.0 and delay_s != 0.1:
        waits_s = 0.010 if delay_s else 0.001
    sense = "VOLT" if function.startswith("VOLT") else "RES"
    found = took_s(f"CONF:{function};:{sense}:NPLC {nplc};:ZERO:AUTO {autozero}")
    assert found == pytest.approx(ARMED_S + waits_s + integrates_s * (1 + autozero) + beside_s, abs=2e-5)


@pytest.mark.parametrize(("filter_hz", "delay_s"), [(3.0, 7.0), (20.0, 1.0), (200.0, 0.6)])
def test_alternating_voltage_takes_the_delay_of_its_filter(filter_hz: float, delay_s: float) -> None:
    sine = (Sine(1.0, 1e3, 0.0),)
    configured = f"CONF:VOLT:AC 1;:DET:BAND {filter_hz}"
    assert took_s(configured, sines=sine) == pytest.approx(ARMED_S + delay_s + 0.02, abs=2e-5)
    assert took_s(f"{configured};:TRIG:DEL 0", sines=sine) == pytest.approx(ARMED_S + 0.02, abs=2e-5)


@pytest.mark.parametrize(("volts", "changes_s"), [(5.0, 0.0), (0.5, 0.8)])
def test_a_range_of_alternating_voltage_is_looked_for_and_changed(volts: float, changes_s: float) -> None:
    """A fiftieth of a second to look (unverified), at most 0.8 s to change (p. 219); the reading is its own."""
    made = bench()
    made.world.play(Sine(volts, 1e3, 0.0))
    made.talk.write("CONF:VOLT:AC DEF;:TRIG:DEL 0;:VOLT:AC:RANG 10;:VOLT:AC:RANG:AUTO ON")
    made.talk.settle()
    assert made.duration_s("READ?") == pytest.approx(ARMED_S + 0.02 + changes_s + 0.02, abs=2e-5)


@pytest.mark.parametrize("gate_s", [0.01, 0.1, 1.0])
def test_frequency_takes_second_gate_and_overhead(gate_s: float) -> None:
    """1, 9.8 and 80 readings a second without the delay (p. 219)."""
    sine = (Sine(1.0, 1e5, 0.0),)
    found = took_s(f"CONF:FREQ;:FREQ:APER {gate_s};:FREQ:VOLT:RANG 1", sines=sine)
    assert found == pytest.approx(ARMED_S + 1.0 + gate_s + 2.2e-3, abs=1e-4)


@pytest.mark.parametrize(
    ("message", "seconds"),
    [("CONF:VOLT:DC 10", 1 / 26), ("CONF:RES 1E3", 1 / 26), ('FUNC "RES"', 1 / 26), ("VOLT:RANG 1", 1 / 50)],
)
def test_a_change_of_function_or_range_takes_its_time(message: str, seconds: float) -> None:
    """26 function changes and 50 range changes a second (p. 217)."""
    made = bench()
    made.talk.settle()
    begun = made.world.clock.now()
    made.talk.write(message)
    assert made.talk.ask("*OPC?") is not None
    assert made.world.clock.now() - begun == pytest.approx(seconds, rel=0.1)


def of_one_sigma(made: MeterBench, monkeypatch: pytest.MonkeyPatch) -> MeterBench:
    """Let each noise be one standard deviation above."""
    monkeypatch.setattr(random.Random, "gauss", lambda _, mean, sigma: mean + sigma)
    return made


@pytest.mark.parametrize("range_v", [0.1, 1.0, 10.0, 100.0])
@pytest.mark.parametrize(
    "of_cycles",
    [
        (0.02, 1e-4, 20e-6, 1e-4),
        (0.2, 1e-5, 20e-6, 1e-5),
        (1.0, 1e-5, 0.0, 3e-6),
        (10.0, 0.0, 0.0, 1e-6),
        (100.0, 0.0, 0.0, 3e-7),
    ],
)
def test_noise_of_a_direct_voltage(
    of_cycles: tuple[float, float, float, float], range_v: float, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Of the resolution (p. 55), and of what short integrations add (p. 217): as a part of the range, and volts."""
    nplc, part, volts, resolution = of_cycles
    for errors, expected in (
        (MeterErrors(noise=0.3), 0.3 * resolution * range_v),
        (
            MeterErrors(noise=0.3, short_noise=0.25),
            ((0.3 * resolution * range_v) ** 2 + (0.25 * (part * range_v + volts)) ** 2) ** 0.5,
        ),
    ):
        made = of_one_sigma(bench(errors), monkeypatch)
        made.world.offset_v = 0.0
        made.talk.write(f"CONF:VOLT:DC {range_v};:VOLT:NPLC {nplc}")
        assert made.value() == pytest.approx(expected, rel=1e-6, abs=1e-12)


@pytest.mark.parametrize("range_v", [1.0, 10.0])
def test_ac_noise_is_part_of_range(range_v: float, monkeypatch: pytest.MonkeyPatch) -> None:
    values = []
    for noise in (0.0, 3e-6):
        made = of_one_sigma(bench(MeterErrors(ac=AcErrors(noise=noise))), monkeypatch)
        made.world.play(Sine(0.5, 1e3, 0.0))
        made.talk.write(f"CONF:VOLT:AC {range_v}")
        values.append(made.value())
    assert values[1] - values[0] == pytest.approx(3e-6 * range_v, rel=1e-3)


@pytest.mark.parametrize(("gate_s", "resolution"), [(0.01, 1e-4), (0.1, 1e-5), (1.0, 1e-6)])
def test_noise_of_a_frequency_is_a_part_of_its_resolution(
    gate_s: float, resolution: float, monkeypatch: pytest.MonkeyPatch
) -> None:
    made = of_one_sigma(bench(MeterErrors(counter=CounterErrors(noise=0.3))), monkeypatch)
    made.world.play(Sine(1.0, 1e4, 0.0))
    made.talk.write(f"CONF:FREQ;:FREQ:APER {gate_s};:FREQ:VOLT:RANG 1")
    assert made.value() / 1e4 - 1.0 == pytest.approx(0.3 * resolution, rel=1e-3)
