"""A 33220A on a World that remembers what is put on it, and a host that reads as a transport does."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np
from simrack.clock import VirtualClock
from simrack.instruments.agilent33220a import Agilent33220ATwin, GeneratorErrors
from simrack.sources import Drive

if TYPE_CHECKING:
    from numpy.typing import ArrayLike, NDArray
    from simrack.sources import Played


class Socket:
    """A world that remembers the drive, and a host that reads as a transport does."""

    def __init__(self, errors: GeneratorErrors | None = None) -> None:
        self.clock = VirtualClock()
        self.drives: list[Drive | Played | None] = []
        self.generator = Agilent33220ATwin(self, errors or GeneratorErrors.none(), noise_seed=5)

    def drive(self, _node: str, source: Drive | Played | None) -> None:
        self.drives.append(source)

    @property
    def source(self) -> Drive | Played:
        """What is put out, the relay being closed."""
        source = self.drives[-1]
        assert source is not None
        return source

    @property
    def sine(self) -> Drive:
        """The same where it is a sine for ever."""
        assert isinstance(self.source, Drive)
        return self.source

    def volts(self, times_s: ArrayLike) -> NDArray[np.float64]:
        """Open-circuit volts at bench times."""
        return self.source.at(np.atleast_1d(np.asarray(times_s, dtype=float)))

    def send(self, text: str | bytes) -> None:
        self.generator.write((text.encode() if isinstance(text, str) else text) + b"\n")
        self._settle()

    def ask(self, text: str) -> str:
        self.generator.write(text.encode() + b"\n")
        while not (reply := self.generator.read(1 << 20)[0]):
            wake = self.generator.wake_at()
            assert wake is not None, f"no answer to {text!r}: {self.generator.engine.errors.pop()}"
            self.clock.sleep_until(wake)
        return reply.decode("latin-1").removesuffix("\n")

    def _settle(self) -> None:
        while self.generator.engine._pending is not None:
            wake = self.generator.wake_at()
            if wake is None or self.generator.engine._pending is None:
                return
            self.clock.sleep_until(wake)

    def errors(self) -> list[str]:
        found = []
        while (text := self.ask("SYST:ERR?")) != '+0,"No error"':
            found.append(text)
        return found
