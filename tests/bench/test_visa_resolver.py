"""What a script may ask of `@vcfbench`: simulated time, a seed, a bench of its own."""

from __future__ import annotations

import gc
import statistics
from contextlib import contextmanager
from typing import TYPE_CHECKING, Any

import pytest
import pyvisa

if TYPE_CHECKING:
    from collections.abc import Iterator

METER, SUPPLY = "GPIB0::22::INSTR", "GPIB0::5::INSTR"


@contextmanager
def opened(library: str) -> Iterator[Any]:
    manager = pyvisa.ResourceManager(library)
    try:
        yield manager
    finally:
        manager.close()


def readings(manager: Any, count: int, every_s: float) -> list[float]:
    """Power the gyroscope and read its output: a plain PyVISA script."""
    supply, meter = manager.open_resource(SUPPLY), manager.open_resource(METER)
    supply.write("APPL P25V,10,0.2;:APPL N25V,-10,0.2;:OUTP ON")
    meter.write("CONF:VOLT:DC 10;:SENS:VOLT:DC:NPLC 10")
    meter.timeout = 5000
    clock = manager.visalib.clock
    start_s = clock.now() + 10.0
    found = []
    for number in range(count):
        clock.sleep_until(start_s + number * every_s)
        found.append(float(meter.query("READ?")))
    return found


@pytest.mark.exhaustive
def test_hour_of_readings_takes_bench_time_only() -> None:
    with opened("?speed=max@vcfbench") as manager:
        values = readings(manager, 3600, 1.0)
        assert 3609.0 < manager.visalib.clock.now() < 3611.0
    assert statistics.mean(values[60:]) == pytest.approx(-0.042, abs=0.02)
    assert 0.0 < statistics.stdev(values[60:]) < 0.01


def test_same_seed_gives_same_digits() -> None:
    found = []
    for library in ("?speed=max&seed=5@vcfbench", "?speed=max&seed=5@vcfbench", "?speed=max&seed=6@vcfbench"):
        with opened(library) as manager:
            found.append(readings(manager, 3, 1.0))
    assert found[0] == found[1] != found[2]


def test_two_managers_have_two_benches_where_their_strings_differ() -> None:
    with opened("?speed=max&name=a@vcfbench") as first, opened("?speed=max&name=b@vcfbench") as second:
        first.visalib.clock.sleep_until(100.0)
        first.open_resource(SUPPLY).write("VOLT 3")
        assert second.visalib.clock.now() == 0.0
        assert float(second.open_resource(SUPPLY).query("VOLT?")) == 0.0


def test_time_can_be_fast_for_scripts_that_sleep_by_themselves() -> None:
    with opened("?speed=1000@vcfbench") as manager:
        start_s = manager.visalib.clock.now()
        manager.open_resource(METER).query("READ?")
        assert manager.visalib.clock.now() - start_s > 0.4


def test_what_cannot_be_asked_is_told() -> None:
    for asked, words in {
        "speed=quick": "speed=quick: expected a number of at least 0.001, or 'max'",
        "speed=0": "speed=0: expected",
        "speed=inf": "speed=inf: expected",
        "speed=": "speed=: expected",
        "seed=x": "seed=x: expected a whole number",
        "sped=max": "expected speed, seed, name, got 'sped'",
    }.items():
        with pytest.raises(OSError, match=words):
            pyvisa.ResourceManager(f"?{asked}@vcfbench")
    gc.collect()
