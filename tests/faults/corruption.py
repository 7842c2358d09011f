"""One corrupted byte in one reply of a run in one process, and runs whose leads or read-backs go wrong amid it.

The instruments of a simulated bench are wrapped: replies are counted, and one of them is changed in one place.
"""

from __future__ import annotations

from dataclasses import dataclass, field
from functools import partial
from typing import TYPE_CHECKING, Any, Literal

from msgspec.structs import replace

from vcfbench.bench.bench import open_bench
from vcfbench.errors import BenchError
from vcfbench.procedures.bench_file import parse_bench
from vcfbench.procedures.catalogue import procedure
from vcfbench.procedures.layers import settings_of
from vcfbench.procedures.turntable import TurntableResult
from vcfbench.procedures.virtual_coriolis.results import VirtualCoriolisResult
from vcfbench.records.schema import Status
from vcfbench.sim.builder import SimulatedBench
from vcfbench.station.file import embedded_text
from vcfbench.steps.executor import Executor
from vcfbench.steps.measured import Measured

if TYPE_CHECKING:
    from collections.abc import Callable, Iterable, Mapping

    from vcfbench.analysis.column import CalibrationColumn
    from vcfbench.clock import Clock
    from vcfbench.sim.world import World
    from vcfbench.station.description import BenchDescription

__all__ = ["Behind", "Came", "Change", "Spoiler", "bench_of", "changes_of", "perform"]

How = Literal["lost", "flipped", "doubled"]


@dataclass(frozen=True, slots=True)
class Change:
    """What happens to byte `at` of reply `reply`; `bit` is the one that is flipped."""

    reply: int
    at: int
    how: How
    bit: int = 0

    def spoil(self, data: bytes) -> bytes:
        """Return the reply as it arrives."""
        head, here, tail = data[: self.at], data[self.at : self.at + 1], data[self.at + 1 :]
        middle = {"lost": b"", "doubled": here * 2, "flipped": bytes(byte ^ 1 << self.bit for byte in here)}[self.how]
        return head + middle + tail

    def __str__(self) -> str:
        return f"reply {self.reply}, byte {self.at} {self.how}" + (
            f" (bit {self.bit})" if self.how == "flipped" else ""
        )


class Spoiler:
    """An instrument's connector that counts replies and changes one; everything else is the instrument's."""

    def __init__(self, device: Any) -> None:
        self._device = device
        self.replies: list[bytes] = []
        self.change: Change | None = None
        self.offset_v = 0.0

    def read(self, limit: int) -> tuple[bytes, bool]:
        """Return what the instrument says, or what becomes of it."""
        data, end = self._device.read(limit)
        if data:
            if self.change is not None and self.change.reply == len(self.replies):
                self.replies.append(data)
                return self.change.spoil(data), end
            self.replies.append(data)
            if self.offset_v and data[2:3] == b".":
                return f"{float(data) + self.offset_v:+.8E}\n".encode(), end
        return data, end

    def __getattr__(self, name: str) -> Any:
        return getattr(self._device, name)


@dataclass(frozen=True, slots=True)
class Came:
    """How a run ended: its error, or its results; what the instruments had said; what was not safe."""

    error: str | None
    results: TurntableResult | VirtualCoriolisResult | None
    replies: Mapping[str, list[bytes]]

    def readings(self) -> list[bytes]:
        """Return what the multimeter has said that differs from what it had said just before."""
        said = self.replies["multimeter"]
        return [reply for before, reply in zip([b"", *said], said, strict=False) if reply != before]

    def numbers(self) -> dict[str, tuple[float, float]]:
        """Return each result that counts with its standard uncertainty, none of a run that did not end well."""
        found: dict[str, tuple[float, float]] = {}
        columns: dict[str, CalibrationColumn] = {}
        match self.results:
            case VirtualCoriolisResult() as four_steps:
                found["k_vc"] = (four_steps.k_vc.value, four_steps.k_vc.u)
                columns = {"turntable": four_steps.turntable, "virtual": four_steps.virtual}
            case TurntableResult() as one:
                columns = {"column": one}
            case None:
                return found
        for name, column in columns.items():
            for key, quantity in (("scale_factor", column.scale_factor), ("bias", column.bias)):
                found[f"{name} {key}"] = (quantity.value, quantity.u)
        return found


@dataclass(slots=True)
class Behind:
    """Builds the simulated bench with its connectors wrapped."""

    changes: Mapping[str, Change]
    spoilers: dict[str, Spoiler] = field(default_factory=dict)
    built: SimulatedBench | None = None

    @property
    def world(self) -> World:
        """The physics."""
        assert self.built is not None
        return self.built.world

    def __call__(self, description: BenchDescription, seed: int, clock: Clock, /) -> SimulatedBench:
        built = SimulatedBench.build(description, seed, clock)
        self.built = built
        self.spoilers = {role: Spoiler(device) for role, device in built.devices.items()}
        for role, change in self.changes.items():
            self.spoilers[role].change = change
        return replace(built, devices=dict(self.spoilers))


@dataclass(slots=True)
class _NoJournal:
    """Takes the steps of a run and keeps none; lets the world be changed amid it."""

    at_point: Mapping[int, Callable[[], None]]
    points: int = 0

    def write(self, kind: str, values: Mapping[str, Any]) -> None:
        if kind == "step" and "point" in values:
            self.points += 1
            self.at_point.get(self.points, lambda: None)()


def bench_of(dialect: str = "acl", procedure_words: str = "", meter: str = "GPIB0::22::INSTR") -> BenchDescription:
    """Return the paper's bench with few rates and few readings."""
    text = (
        embedded_text("paper").replace('dialect = "acl"', f'dialect = "{dialect}"').replace("GPIB0::22::INSTR", meter)
    )
    if dialect == "zaber":
        text = text.replace('dialect = "zaber"', 'dialect = "zaber"\nsteps_per_deg = 1777.7777777777778')
    words = procedure_words or "rates_deg_s = [40, 20, 0, -20]\nsamples = 4\nmatch_rate_deg_s = 20"
    return parse_bench(
        text.replace("\n[procedure.drive]", f"\n[procedure]\n{words}\n[procedure.drive]"), "a test of corrupted replies"
    )


def perform(
    bench: BenchDescription,
    name: str = "turntable",
    changes: Mapping[str, Change] | None = None,
    at_point: Mapping[int, Callable[[Behind], None]] | None = None,
) -> Came:
    """Carry out procedure `name` on a simulated bench of seed 7; never raises what the bench says.

    `changes` by role; what `at_point` has for the number of a point happens when that point has been taken.
    """
    behind, work = Behind(changes or {}), procedure(name)
    settings = settings_of(work, bench)
    try:
        with open_bench(bench, seed=7, build=behind) as opened:
            later = {number: partial(act, behind) for number, act in (at_point or {}).items()}
            execution = Executor(opened, _NoJournal(later)).execute(work.plan(settings))
    except BenchError as error:
        return Came(str(error), None, _said(behind))
    if execution.status is not Status.COMPLETE:
        return Came(str(execution.error), None, _said(behind))
    return Came(None, work.results(settings, Measured(execution.points)), _said(behind))


def _said(behind: Behind) -> dict[str, list[bytes]]:
    return {role: spoiler.replies for role, spoiler in behind.spoilers.items()}


def changes_of(replies: Iterable[tuple[int, bytes]]) -> list[Change]:
    """Return each byte of each reply: lost, flipped (another bit each), doubled."""
    ways: tuple[How, ...] = ("lost", "flipped", "doubled")
    return [
        Change(number, at, how, bit=(number + at) % 7)
        for number, reply in replies
        for at in range(len(reply))
        for how in ways
    ]
