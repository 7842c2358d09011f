"""Instruments without a wire, for tests of what a bench does with them."""

from __future__ import annotations

import threading
from typing import TYPE_CHECKING

from vcfbench.errors import ConnectFailed, LinkLost
from vcfbench.interfaces import Identity, SafeReport, UnprovedCommand

if TYPE_CHECKING:
    from vcfbench.bench.ground import UnopenedBench
    from vcfbench.clock import Deadline
    from vcfbench.interfaces import Instrument
    from vcfbench.station.description import BenchDescription


class FakeInstrument:
    """Has a switch that make_safe turns off; `behaviour` says how it misbehaves: fails, hangs, refuses, lies, dumb.

    One that is dumb hears, as does one that hangs; `commands` counts how often it was told without being asked.
    """

    def __init__(self, name: str, log: list[str], behaviour: str = "obeys") -> None:
        self.name = name
        self.resource = f"FAKE::{name}"
        self.log = log
        self.behaviour = behaviour
        self.energised = True
        self.rate = 0.0
        self.commands = 0
        self.released = threading.Event()

    def identify(self) -> Identity:
        return Identity("Fakes", self.name, "1", "0")

    def check_errors(self) -> None:
        self.log.append(f"{self.name} errors")

    def command_safe(self) -> UnprovedCommand:
        self.commands += 1
        if self.behaviour in {"obeys", "dumb", "hangs"}:
            self.energised = False
        return UnprovedCommand("to switch off", self.behaviour != "fails", "on", 3.0)

    def make_safe(self, deadline: Deadline) -> SafeReport:
        self.log.append(f"{self.name} safe")
        if self.behaviour in {"fails", "dumb"}:
            raise LinkLost("the cable is out", instrument=self.name)
        if self.behaviour == "hangs":
            self.released.wait(60)
        if self.behaviour == "lies":
            return SafeReport(self.name, self.resource, safe=True, detail="off")
        self.energised = self.behaviour == "refuses"
        self.rate = self.rate if self.behaviour == "spins" else 0.0
        detail = f"with {deadline.remaining():g} s left"
        return SafeReport(self.name, self.resource, safe=not self.energised, detail=detail)

    def verify(self) -> str | None:
        return "it is still on" if self.energised else None

    def close(self) -> None:
        self.log.append(f"{self.name} closed")
        if self.behaviour == "fails":
            raise LinkLost("the cable is out", instrument=self.name)
        if self.behaviour == "hangs":
            self.released.wait(60)

    def outputs_enabled(self) -> bool:
        return self.energised

    def output_enabled(self) -> bool:
        return self.energised

    def rate_deg_s(self) -> float:
        return self.rate

    def fault(self) -> str | None:
        return None


class FakeRack:
    """Opens fakes in place of what the bench file names; `behaviours` by role, ``missing`` does not open.

    A table that ``turns`` can be stopped, one that ``spins`` cannot.
    """

    def __init__(self, **behaviours: str) -> None:
        self.behaviours = behaviours
        self.log: list[str] = []
        self.instruments: dict[str, FakeInstrument] = {}

    def open_role(self, role: str, description: BenchDescription, stand: UnopenedBench) -> tuple[Instrument, Identity]:
        del stand
        behaviour = self.behaviours.get(role, "obeys")
        if behaviour == "missing":
            resource = getattr(description, role).resource
            raise ConnectFailed("nobody answers", instrument=role, resource=resource)
        fake = FakeInstrument(role, self.log, behaviour)
        fake.rate = 12.5 if behaviour in {"turns", "spins"} else 0.0
        self.log.append(f"{role} opened")
        self.instruments[role] = fake
        return fake, fake.identify()
