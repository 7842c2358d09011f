"""What is sent is what is compared when it is read back: over all that may be set."""

from __future__ import annotations

import math
from random import Random
from typing import TYPE_CHECKING, Any

import pytest

from tests.drivers.boxes import METERS, SCOPES, box
from vcfbench.drivers.e3631a import E3631A
from vcfbench.drivers.e36312a import E36312A
from vcfbench.errors import InstrumentError

if TYPE_CHECKING:
    from collections.abc import Callable

GENERATORS = {"33220A": (20e6, 20e-3), "33522B": (30e6, 2e-3)}
"""Highest frequency of a sine, Hz, and least amplitude, Vpp."""
SUPPLIES = {"E3631A": E3631A, "E36312A": E36312A}


def many(few: int) -> Any:
    """Return how many numbers are drawn: a few each time, ten thousand where all is tried."""
    return pytest.mark.parametrize("draws", [few, pytest.param(10_000, marks=pytest.mark.exhaustive)])


def drawn() -> Random:
    return Random(0)  # noqa: S311


def log_uniform(random: Random, low: float, high: float) -> float:
    return min(max(math.exp(random.uniform(math.log(low), math.log(high))), low), high)


@many(100)
@pytest.mark.parametrize("model", GENERATORS)
def test_every_sine_that_a_generator_can_make_is_set(model: str, draws: int) -> None:
    random, (highest_hz, least_vpp) = drawn(), GENERATORS[model]
    with box(model).driven() as generator:
        for _ in range(draws):
            amplitude_vpp = log_uniform(random, least_vpp, 20.0)
            room_v = 10.0 - amplitude_vpp / 2.0
            generator.configure_sine(
                log_uniform(random, 1e-6, highest_hz), amplitude_vpp, random.uniform(-room_v, room_v)
            )


@many(200)
@pytest.mark.parametrize("model", GENERATORS)
def test_every_level_that_a_generator_has_is_set(model: str, draws: int) -> None:
    random = drawn()
    with box(model).driven() as generator:
        generator.configure_dc(0.0)
        for _ in range(draws):
            level_v = random.choice((-1.0, 1.0)) * log_uniform(random, 1e-6, 10.0)
            assert abs(generator.set_dc(level_v) - level_v) <= max(1e-3 * abs(level_v), 1e-6)


@many(100)
@pytest.mark.parametrize("model", SUPPLIES)
def test_every_level_and_limit_that_a_supply_has_is_set(model: str, draws: int) -> None:
    random = drawn()
    with box(model).driven() as supply:
        for _ in range(draws):
            output, ratings = random.choice(tuple(SUPPLIES[model].outputs.items()))
            supply.configure_output(
                output, random.uniform(ratings.low_v, ratings.high_v), random.uniform(0.002, ratings.high_a)
            )


@many(100)
def test_every_temperature_and_window_of_the_chamber_is_set(draws: int) -> None:
    random = drawn()
    with box("ATS-545").driven() as chamber:
        for _ in range(draws):
            chamber.set_temperature(random.uniform(-40.0, 120.0), log_uniform(random, 0.1, 9999.0))
            chamber.set_settled(random.uniform(0.1, 9.9), random.uniform(0.0, 9999.0))


@many(50)
@pytest.mark.parametrize("model", SCOPES)
def test_every_screen_and_trigger_of_an_oscilloscope_is_set(model: str, draws: int) -> None:
    random = drawn()
    with box(model).driven() as scope:
        for _ in range(draws):
            channel, scale_v = random.randint(1, 4), log_uniform(random, scope.least_scale_v, 5.0)
            offset_v = random.uniform(-1.0, 1.0) * min(8.0 * scale_v, 5.0)
            scope.configure_channel(channel, scale_v, offset_v)
            scope.configure_timebase(log_uniform(random, 500e-12, 1e-3))
            scope.configure_trigger(channel, offset_v + random.uniform(-3.5, 3.5) * scale_v)
            scope.acquire(channel)


@many(10)
@pytest.mark.parametrize("model", METERS)
def test_every_number_and_interval_of_samples_is_taken(model: str, draws: int) -> None:
    random, wired = drawn(), box(model)
    with wired.driven() as meter:
        for _ in range(draws):
            meter.configure_dc_voltage(
                10.0, random.choice([each for each in meter.integration_times_nplc if each >= 0.02])
            )
            count = random.randint(meter.least_samples, min(meter.memory_readings, 30))
            lasts_s = meter.start_sampling(count, meter.aperture_s + log_uniform(random, 1e-6, 1.0))
            wired.clock.sleep_until(wired.clock.now() + lasts_s)
            assert len(meter.sampled_voltages_v()) == count


@pytest.mark.parametrize("model", METERS)
def test_every_range_and_integration_time_of_a_meter_is_set(model: str) -> None:
    with box(model).driven() as meter:
        for nplc in (each for each in meter.integration_times_nplc if model != "34465A" or each >= 0.02):  # its option
            for range_v in meter.ranges_v:
                meter.configure_dc_voltage(range_v, nplc)
            for range_ohm in meter.ranges_ohm:
                meter.configure_resistance(range_ohm, nplc)


def _sine(generator: Any, random: Random) -> None:
    generator.configure_sine(log_uniform(random, 1.0, 20e6), log_uniform(random, 0.02, 10.0), random.uniform(-5.0, 5.0))


def _output(supply: Any, random: Random) -> None:
    supply.configure_output("P25V", random.uniform(1.0, 25.0), random.uniform(0.1, 1.0))


def _temperature(chamber: Any, random: Random) -> None:
    chamber.set_temperature(random.uniform(-40.0, 120.0), random.uniform(1.0, 99.0))


def _range(meter: Any, random: Random) -> None:
    meter.configure_dc_voltage(random.choice(meter.ranges_v), random.choice(meter.integration_times_nplc))


@pytest.mark.parametrize(
    ("model", "configure", "question", "step"),
    [
        ("33220A", _sine, "FREQ?", lambda _: 1e-6),
        ("33220A", _sine, "VOLT?", lambda volts: 10.0 ** (math.floor(math.log10(volts)) - 3)),
        ("33220A", _sine, "VOLT:OFFS?", lambda _: 1e-3),
        ("33522B", _sine, "SOUR1:FREQ?", lambda _: 1e-6),
        ("E3631A", _output, "VOLT?", lambda _: 1.5e-3),
        ("E3631A", _output, "CURR?", lambda _: 0.1e-3),
        ("E36312A", _output, "VOLT? (@2)", lambda _: 3e-3),
        ("E36312A", _output, "CURR? (@2)", lambda _: 0.4e-3),
        ("ATS-545", _temperature, "SETP?", lambda _: 0.05),
        ("ATS-545", _temperature, "RAMP?", lambda _: 0.05),
        *((model, _range, "VOLT:DC:RANG?", lambda volts: 1e-6 * volts) for model in ("34401A", "34461A")),
        ("2000", _range, "VOLT:NPLC?", lambda nplc: 1e-6 * nplc),
    ],
)
def test_what_is_off_by_more_than_the_resolution_is_refused(
    model: str,
    configure: Callable[[Any, Random], None],
    question: str,
    step: Callable[[float], float],
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    random = drawn()
    with box(model).driven() as driver:
        answered, off = driver.session.query_number, 0.0

        def query_number(command: str, *args: Any, **named: Any) -> float:
            found = float(answered(command, *args, **named))
            return found + (off * step(abs(found)) if command == question else 0.0)

        monkeypatch.setattr(driver.session, "query_number", query_number)
        for _ in range(30):
            off = 0.0
            configure(driver, random)
            off = random.choice((-1.0, 1.0)) * (2.01 + 10.0 * random.random() ** 4)  # and where it rounds by itself
            with pytest.raises(InstrumentError, match="reads back"):
                configure(driver, random)
