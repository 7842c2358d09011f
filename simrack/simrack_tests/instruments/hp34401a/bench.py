"""A 34401A on a World of closed forms, and a controller."""

from __future__ import annotations

import math
from functools import cache
from typing import NamedTuple

import numpy as np
from simrack.instruments.hp34401a import Hp34401ATwin, MeterErrors

from simrack_tests.instruments.conversation import Conversation
from simrack_tests.instruments.fake_world import FakeWorld


class MeterBench(NamedTuple):
    world: FakeWorld
    meter: Hp34401ATwin
    talk: Conversation

    def value(self, query: str = "READ?") -> float:
        return float(self.talk.ask(query) or "nan")

    def duration_s(self, query: str) -> float:
        start = self.world.clock.now()
        assert self.talk.ask(query) is not None
        return self.world.clock.now() - start


@cache
def specimens() -> list[MeterErrors]:
    """A thousand meters."""
    return [MeterErrors.drawn(np.random.default_rng(seed)) for seed in range(1000)]


def bench(
    errors: MeterErrors | None = None, interface: str = "gpib", source_ohm: float = math.inf, sense: str | None = None
) -> MeterBench:
    world = FakeWorld()
    world.resistance_ohm = source_ohm
    meter = Hp34401ATwin(world, errors=errors or MeterErrors.none(), interface=interface, sense=sense)
    world.clock.attend(meter)
    return MeterBench(world, meter, Conversation(meter, world.clock))
