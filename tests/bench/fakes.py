"""Instruments without a wire, for tests of what a bench does with them."""

from __future__ import annotations

import threading
from typing import TYPE_CHECKING

from vcfbench.errors import LinkLost
from vcfbench.interfaces import Identity, SafeReport

if TYPE_CHECKING:
    from vcfbench.clock import Deadline


class FakeInstrument:
    """Has a switch that make_safe turns off; `behaviour` says how it misbehaves: fails, hangs, refuses."""

    def __init__(self, name: str, log: list[str], behaviour: str = "obeys") -> None:
        self.name = name
        self.resource = f"FAKE::{name}"
        self.log = log
        self.behaviour = behaviour
        self.energised = True
        self.released = threading.Event()

    def identify(self) -> Identity:
        return Identity("Fakes", self.name, "1", "0")

    def check_errors(self) -> None:
        self.log.append(f"{self.name} errors")

    def make_safe(self, deadline: Deadline) -> SafeReport:
        self.log.append(f"{self.name} safe")
        if self.behaviour == "fails":
            raise LinkLost("the cable is out", instrument=self.name)
        if self.behaviour == "hangs":
            self.released.wait(60)
        if self.behaviour == "lies":
            return SafeReport(self.name, self.resource, safe=True, detail="off")
        self.energised = self.behaviour == "refuses"
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
