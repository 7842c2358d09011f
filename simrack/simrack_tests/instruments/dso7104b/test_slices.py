"""How often noise, of which every look costs most, is looked at in one slice of work."""

from __future__ import annotations

from typing import TYPE_CHECKING

import pytest
from simrack.attendance import AttendedClock
from simrack.clock import VirtualClock
from simrack.instruments.agilent33220a import Agilent33220ATwin, GeneratorErrors
from simrack.instruments.agilent33220a.noise import NoiseSource
from simrack.instruments.dso7104b import Dso7104BTwin, ScopeErrors
from simrack.instruments.dso7104b.filters import UNKNOWN_AT_ONCE
from simrack.wired import WiredWorld

if TYPE_CHECKING:
    import numpy as np
    from numpy.typing import NDArray


@pytest.mark.parametrize(
    "question",
    [":CHAN1:COUP AC;BWL ON;:TIM:RANG 1E-7;:DIG CHAN1;*OPC?;:WAV:POIN 1000;:WAV:DATA?", ":AUT;*OPC?"],
)
def test_noise_is_looked_at_in_bounded_slices(question: str, monkeypatch: pytest.MonkeyPatch) -> None:
    clock = AttendedClock(VirtualClock())
    world = WiredWorld(clock)
    scope = Dso7104BTwin(world, {1: "input"}, ScopeErrors.none())
    generator = Agilent33220ATwin(world, GeneratorErrors.none(), node="input")
    clock.attend(scope, generator)
    generator.write(b"APPL:NOIS DEF,2,0\n")
    clock.sleep_until(1.0)
    looks, look = list[int](), NoiseSource.at

    def counted(source: NoiseSource, times_s: NDArray[np.float64]) -> NDArray[np.float64]:
        looks.append(len(times_s))
        return look(source, times_s)

    monkeypatch.setattr(NoiseSource, "at", counted)
    scope.write(question.encode() + b"\n")
    clock.sleep_until(4.0)
    assert scope.read(1 << 20)[0]
    assert sum(looks) > UNKNOWN_AT_ONCE
    assert max(looks) < 2 * UNKNOWN_AT_ONCE
