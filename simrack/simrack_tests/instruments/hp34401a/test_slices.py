"""What a reading of a fast signal costs: so many evaluations of the signal in a slice, and in all."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np
import pytest
from simrack.bench_faults import begin_on_bench
from simrack.clock import VirtualClock
from simrack.faults import Fault
from simrack.instruments.agilent33220a.banded import Banded
from simrack.rack import Rack
from simrack.scpi import ScpiTwin

if TYPE_CHECKING:
    from collections.abc import Callable

    from simrack.components import Values

MOST_IN_A_SLICE = 1 << 15
SIGNALS = {
    "fast FM": ("APPL:SIN 20E6,2,0;:FM:DEV 1;:FM:STAT ON", 0.0, 1 << 18),
    "FM": ("APPL:SIN 200E3,2,0;:FM:INT:FREQ 1E3;:FM:DEV 1E3;:FM:STAT ON", 200e3, 1 << 18),
    "FSK": ("APPL:SQU 1E3,2,0;:FSK:FREQ 100;:FSK:INT:RATE 100E3;:FSK:STAT ON", 550.0, 1 << 18),
    "phase jumps": ("APPL:SIN 20E6,2,0;:PM:INT:FUNC SQU;:PM:INT:FREQ 2E3;:PM:STAT ON", None, 1 << 22),
    "AM": ("APPL:SIN 20E6,2,0;:AM:INT:FREQ 20E3;:AM:STAT ON", 0.0, 1 << 22),
}


@pytest.mark.parametrize("signal", SIGNALS)
def test_a_frequency_is_counted_in_bounded_slices(signal: str, monkeypatch: pytest.MonkeyPatch) -> None:
    applied, expected_hz, most = SIGNALS[signal]
    clock = VirtualClock()
    desk = Rack.build(clock)
    generator, meter = desk.devices["generator"], desk.devices["multimeter"]
    assert isinstance(meter, ScpiTwin)
    generator.write(applied.encode() + b"\n", end=True)
    clock.sleep_until(1.0)
    generator.write(b"OUTP ON\n", end=True)
    clock.sleep_until(3.0)
    looks = [0]

    def counted(evaluate: Callable[..., object]) -> Callable[..., object]:
        def counting(self: Banded, edges_s: Values, *path: object) -> object:
            looks[-1] += len(edges_s)
            return evaluate(self, edges_s, *path)

        return counting

    monkeypatch.setattr(Banded, "means", counted(Banded.means))
    monkeypatch.setattr(Banded, "powers", counted(Banded.powers))
    meter.engine.hand_over = lambda: None
    meter.write(b"MEAS:FREQ?\n", end=True)
    answer = b""
    while not answer:
        looks.append(0)
        if meter.engine.working:
            meter.engine.work()
        else:
            answer, _ = meter.read(100)
            clock.sleep_until(meter.wake_at() or clock.now())
    assert max(looks) <= MOST_IN_A_SLICE
    assert sum(looks) <= most
    if expected_hz is not None:
        assert float(answer) == pytest.approx(expected_hz, rel=1e-6)


def test_offset_reading_is_computed_in_slices() -> None:
    said, slices = [], [0, 0]
    for index, offset in enumerate((1e-12, 0.5)):
        clock = VirtualClock()
        desk = Rack.build(clock)
        meter = desk.devices["multimeter"]
        assert isinstance(meter, ScpiTwin)
        desk.devices["generator"].write(b"APPL:SQU 1E3,2,0\n", end=True)
        clock.sleep_until(1.0)
        desk.devices["generator"].write(b"OUTP ON\n", end=True)
        clock.sleep_until(2.0)
        end = begin_on_bench(meter, Fault("multimeter", "offset", offset=offset))
        meter.engine.hand_over = lambda: None
        meter.write(b"MEAS:VOLT:AC?\n", end=True)
        answer = b""
        while not answer:
            while meter.engine.working:
                slices[index] += 1
                meter.engine.work()
            answer, _ = meter.read(100)
            clock.sleep_until(meter.wake_at() or clock.now())
        end()
        said.append(float(answer))
    assert said[1] - said[0] == pytest.approx(0.5, abs=1e-6)
    assert slices[0] == slices[1] > 4


def test_device_clear_drops_sliced_computation() -> None:
    clock = VirtualClock()
    desk = Rack.build(clock)
    meter = desk.devices["multimeter"]
    assert isinstance(meter, ScpiTwin)
    handed: list[None] = []
    meter.engine.hand_over = lambda: handed.append(None)
    desk.devices["generator"].write(b"APPL:SIN 20E6,2,0;:AM:STAT ON\n", end=True)
    meter.write(b"MEAS:FREQ?\n", end=True)
    while not handed:
        clock.sleep_until(meter.wake_at() or np.inf)
    assert meter.engine.working
    meter.clear()
    assert not meter.engine.working
    meter.write(b"*IDN?\n", end=True)
    assert meter.read(100)[0].startswith(b"HEWLETT-PACKARD")
