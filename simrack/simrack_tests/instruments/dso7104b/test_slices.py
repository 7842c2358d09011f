"""Long work of the oscilloscope in slices: so many samples in each, the answers the same as in one piece."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np
import pytest
from simrack.clock import VirtualClock
from simrack.desk import Desk
from simrack.instruments.dso7104b.inputs import Signals
from simrack.scpi import ScpiTwin

if TYPE_CHECKING:
    from numpy.typing import NDArray

MOST_IN_A_SLICE = (1 << 16) + 2
QUESTIONS = (
    ":MEAS:FREQ? CHAN1",
    ":MEAS:VTOP? CHAN1;:MEAS:RIS? CHAN1;:MEAS:VRMS? CYCL,CHAN1;:MEAS:DUTY? CHAN1;:MEAS:TEDG? -2,CHAN1",
    ":CHAN2:DISP ON;:MEAS:PHAS? CHAN1,CHAN2;:MEAS:DEL? CHAN1,CHAN2",
    ":MEAS:FREQ CHAN1;:MEAS:VPP CHAN1;:MEAS:RES?",
    ":TIM:RANG 0.02;:DIG CHAN1;*OPC?;:MEAS:PER? CHAN1;:MEAS:NWID? CHAN1",
    ":ACQ:TYPE PEAK;:TIM:RANG 0.02;:DIG CHAN1;*OPC?;:MEAS:VPP? CHAN1;:MEAS:OVER? CHAN1",
    ":ACQ:TYPE HRES;:TIM:RANG 0.02;:DIG CHAN1;*OPC?;:MEAS:VMAX? CHAN1",
    ":MEAS:COUN? CHAN1;:ACT?",
    ":DISP:DATA? BMP8,SCR,GRAY",
    ":MEAS:VPP? CHAN3",
)


def desk_with(signal: str) -> tuple[VirtualClock, ScpiTwin]:
    clock = VirtualClock()
    desk = Desk.build(clock, seed=3)
    generator, scope = desk.devices["generator"], desk.devices["oscilloscope"]
    assert isinstance(scope, ScpiTwin)
    generator.write(signal.encode() + b"\n", end=True)
    clock.sleep_until(1.0)
    generator.write(b"OUTP ON\n", end=True)
    clock.sleep_until(2.0)
    return clock, scope


def answer(clock: VirtualClock, scope: ScpiTwin, question: str, looks: list[int]) -> bytes:
    scope.write(question.encode() + b"\n", end=True)
    said, ended = b"", False
    while not ended:
        while scope.engine.working:
            looks.append(0)
            scope.engine.work()
        part, ended = scope.read(1 << 24)
        said += part
        if not part:
            due = scope.wake_at()
            assert due is not None or scope.engine.working, "waits for nothing"
            clock.sleep_until(clock.now() if due is None else due)
    return said


@pytest.mark.parametrize("signal", ["APPL:SIN 5E6,2,0", "APPL:SQU 20E3,2,0;:AM:STAT ON"])
def test_answers_in_slices_are_those_in_one_piece(signal: str, monkeypatch: pytest.MonkeyPatch) -> None:
    whole = [answer(*desk_with(signal), question, []) for question in QUESTIONS]
    looks, volts = [0], Signals.volts

    def counted(self: Signals, channel: int, times_s: NDArray[np.float64], *, ac: bool = False) -> NDArray[np.float64]:
        looks[-1] += len(times_s)
        return volts(self, channel, times_s, ac=ac)

    monkeypatch.setattr(Signals, "volts", counted)
    sliced = []
    for question in QUESTIONS:
        clock, scope = desk_with(signal)
        scope.engine.hand_over = lambda: None
        sliced.append(answer(clock, scope, question, looks))
    assert sliced == whole
    assert max(looks) <= MOST_IN_A_SLICE
    assert len(looks) > 100


def test_a_search_that_is_given_up_between_two_slices_shows_nothing() -> None:
    clock, scope = desk_with("APPL:SIN 20E6,2,0")
    scope.engine.hand_over = lambda: None
    scope.write(b":TIM:RANG 1;:SING\n", end=True)
    while not scope.engine.working:
        clock.sleep_until(scope.wake_at() or np.inf)
    scope.engine.work()
    assert scope.engine.working
    scope.write(b":STOP\n", end=True)
    while scope.engine.working:
        scope.engine.work()
    scope.write(b":MEAS:VPP? CHAN1\n", end=True)
    while scope.engine.working:
        scope.engine.work()
    assert scope.read(100)[0].startswith(b"+9.90000000E+037")
