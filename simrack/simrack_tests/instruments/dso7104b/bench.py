"""A world of analytic nodes for the oscilloscope, and a host that reads as a transport does."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np
from msgspec.structs import replace
from simrack.clock import VirtualClock
from simrack.instruments.dso7104b import Dso7104BTwin, ScopeErrors
from simrack.trace import Piece

if TYPE_CHECKING:
    from collections.abc import Callable

    from numpy.typing import NDArray
    from simrack.sources import Sine

F = 3488.9


@dataclass
class SineCapture:
    world: Bench
    start_s: float
    stop_s: float

    def samples(self, node: str, times_s: NDArray[np.float64]) -> NDArray[np.float64]:
        assert self.world.clock.now() >= min(self.stop_s, float(times_s.max())), "looked at before it has happened"
        assert times_s.min() >= self.start_s
        assert times_s.max() <= self.stop_s
        return self.world.nodes[node](times_s)

    def finest_s(self, node: str) -> float:
        return self.world.finest_s.get(node, 0.0)

    def whole(self, start_s: float, stop_s: float) -> bool:
        return start_s < stop_s

    def pieces(self, node: str) -> list[Piece]:
        stop_s = min(self.stop_s, self.world.clock.now())
        return [self.world.piece(node, self.start_s, stop_s)]

    def forget(self, before_s: float) -> None:
        assert before_s <= self.world.clock.now()
        self.start_s = max(self.start_s, before_s)

    def close(self) -> None:
        self.world.recording.discard(id(self))
        self.stop_s = self.world.clock.now()


@dataclass
class AnalyticHistory:
    """The past of analytic nodes, which were always so."""

    world: Bench
    span_s: float

    def pieces(self, node: str) -> list[Piece]:
        now = self.world.clock.now()
        return [self.world.piece(node, now - self.span_s, now)]

    def end(self) -> None:
        self.world.histories.remove(self)


class Bench:
    """A world of analytic nodes, and a host that reads as a transport does."""

    def __init__(self, errors: ScopeErrors | None = None, twin: type[Dso7104BTwin] = Dso7104BTwin) -> None:
        self.clock = VirtualClock()
        self.finest_s: dict[str, float] = {}
        self.recording: set[int] = set()
        self.histories: list[AnalyticHistory] = []
        self.sines: dict[str, tuple[float, tuple[Sine, ...]]] = {}
        self.loads_ohm: dict[str, float] = {}
        self.nodes: dict[str, Callable[[NDArray[np.float64]], NDArray[np.float64]]] = {
            "drive": lambda t: 0.1 + 1.5 * np.sin(2 * np.pi * F * t),
            "carrier": lambda t: 2.0 * np.sin(2 * np.pi * F * t + np.radians(-40.0)),
            "flat": lambda t: np.full(len(t), 0.25),
            "pulse": lambda t: np.where((t * 1000.0) % 1.0 < 0.3, 1.0, -1.0),
        }
        wired = {1: "drive", 2: "carrier", 3: "flat", 4: "pulse"}
        self.scope = twin(self, wired, errors or ScopeErrors.none())

    def capture(self, start_s: float, stop_s: float) -> SineCapture:
        assert start_s >= self.clock.now()
        return SineCapture(self, start_s, stop_s)

    def record(self) -> SineCapture:
        recording = SineCapture(self, self.clock.now(), math.inf)
        self.recording.add(id(recording))
        return recording

    def trace(self, span_s: float) -> AnalyticHistory:
        self.histories.append(AnalyticHistory(self, span_s))
        return self.histories[-1]

    def piece(self, node: str, start_s: float, stop_s: float) -> Piece:
        """What a node does, in closed form if it is one of `sines` (phases at bench time 0)."""
        if node not in self.sines:
            return Piece(start_s, stop_s, 0.0, None, self.nodes[node], endless=True)
        dc_v, sines = self.sines[node]
        here = tuple(replace(s, phase_rad=s.phase_rad + 2 * math.pi * s.frequency_hz * start_s) for s in sines)
        return Piece(start_s, stop_s, dc_v, here, self.nodes[node], endless=True)

    def put(self, node: str, dc_v: float, *sines: Sine) -> None:
        """Let a node carry sines that are known in closed form."""
        self.sines[node] = (dc_v, sines)
        self.nodes[node] = lambda t: dc_v + np.sum([s.at(np.asarray(t)) for s in sines], axis=0)
        fastest = max((s.frequency_hz for s in sines), default=0.0)
        self.finest_s[node] = 0.05 / (2 * math.pi * fastest) if fastest else math.inf

    def load_node(self, who: object, node: str, resistance_ohm: float) -> None:
        del who
        self.loads_ohm[node] = resistance_ohm

    def send(self, text: str) -> None:
        self.scope.write(text.encode() + b"\n")

    def raw(self, text: str, limit_s: float = 100.0) -> bytes:
        self.send(text)
        deadline = self.clock.now() + limit_s
        while not (reply := self.scope.read(1 << 26)[0]):
            wake = self.scope.wake_at()
            if wake is None or wake > deadline:
                raise TimeoutError(text)
            self.clock.sleep_until(wake)
        return reply

    def ask(self, text: str) -> str:
        return self.raw(text).decode("latin-1").removesuffix("\n")

    def number(self, text: str) -> float:
        return float(self.ask(text))

    def errors(self) -> list[int]:
        found = []
        while (text := self.ask("SYST:ERR?")) != '+0,"No error"':
            found.append(int(text.split(",")[0]))
        return found


def waveform(bench: Bench) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Read the source out as a programmer's guide says."""
    preamble = [float(field) for field in bench.ask(":WAV:PRE?").split(",")]
    data = bench.raw(":WAV:DATA?")
    count = int(data[2:10])
    assert data[:2] == b"#8"
    assert len(data) == 10 + count + 1
    codes = np.frombuffer(data[10:-1], ">u2" if preamble[0] == 1 else "u1").astype(float)
    assert len(codes) == preamble[2]
    times = np.asarray((np.arange(len(codes)) - preamble[6]) * preamble[4] + preamble[5], dtype=np.float64)
    return times, (codes - preamble[9]) * preamble[7] + preamble[8]


def errors_with(**changes: object) -> ScopeErrors:
    return replace(ScopeErrors.none(), **changes)  # type: ignore[arg-type]
